"""The commands of an experiment: run, sweep, check, status, init."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import completion, output
from chemage.cli.options import (
    RESULTS,
    AccuracyOpt,
    AllOpt,
    BudgetOpt,
    ExecutorOpt,
    FiguresOpt,
    ForceOpt,
    JsonOpt,
    MapOpt,
    PatienceOpt,
    PointsOpt,
    ReplicasOpt,
    SceneArg,
    SeedOpt,
    SetOpt,
    SurfacesOpt,
    ThreadsOpt,
    WorkersOpt,
    YesOpt,
    changed_fields,
    check_ending,
    requested_fields,
    user_error,
)
from chemage.cli.output import (
    drawn,
    figures_of,
    preflight_result,
    protect_inputs,
    result_written,
    show_all,
)
from chemage.foundation import compiling
from chemage.foundation.aliases import Data
from chemage.foundation.errors import ChemageError, nearest
from chemage.foundation.progress import (
    loaded,
    loading,
    progress_bars,
    reported,
    watching,
)
from chemage.plugins import registry

if TYPE_CHECKING:
    from chemage.scene.run import Run
    from chemage.scene.scene import Scene


def run(
    scene: SceneArg,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="result file, ending in .h5 or .hdf5; default: NAME.h5, after the name of the scene; of a sweep: its "
            "folder; default: NAME-sweep",
        ),
    ] = None,
    changes: SetOpt = None,
    accuracy: AccuracyOpt = None,
    budget: BudgetOpt = None,
    surfaces: SurfacesOpt = None,
    measured: MapOpt = None,
    replicas: ReplicasOpt = None,
    seed: SeedOpt = None,
    threads: ThreadsOpt = None,
    workers: WorkersOpt = None,
    executor: ExecutorOpt = None,
    patience: PatienceOpt = None,
    points: PointsOpt = None,
    yes: YesOpt = False,
    checkpoints: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="keep the contact and the replicas in this folder while they are computed; the same command resumes "
            "an interrupted run; default: none are kept",
        ),
    ] = None,
    figures: FiguresOpt = True,
    as_json: JsonOpt = False,
    every: AllOpt = False,
    force: ForceOpt = False,
) -> None:
    """Run a scene, its mean over random surfaces, or a sweep.

    Writes one result file and its figures. With an accuracy, a budget or a number of surfaces, from these options or
    from the scene, the result is a mean over surfaces. All points of a scene with [sweep] are computed into a folder.
    The same command resumes an interrupted ensemble or sweep.
    """
    show_all(every)
    loading("loading chemage")
    request = requested_fields(accuracy, budget, surfaces, measured)
    values = changed_fields(changes, replicas, seed) | request
    where = {
        "executor": executor,
        "workers": workers,
        "patience": patience,
        "points": points,
    }
    how: Data = {"threads": threads, "as_json": as_json, "force": force}
    plugins = registry.current().installed()
    with compiling.begun_early(scene, values, threads, plugins) as early:
        from chemage.scene.files import is_sweep, load_scene

        if is_sweep(scene):
            from chemage.cli import studies

            loaded()
            if checkpoints is not None:
                raise user_error(
                    "--checkpoints is for a single run; a sweep resumes from its own folder"
                )
            return studies.run_sweep(scene, out, values, yes=yes, **how, **where)
        one = load_scene(scene, values)
        # also where the locale is ASCII
        path = out or Path(os.fsdecode(f"{one.name}.h5".encode()))
        protect_inputs(path, scene, one)
        if out is not None:
            check_ending(out, RESULTS, "a result file")
        how |= {"early": early, "figures": figures}
        if one.is_ensemble:
            from chemage.cli import studies

            if checkpoints is not None:
                raise user_error(
                    "--checkpoints is for a single run; an ensemble keeps its samples beside its result"
                )
            return studies.run_ensemble(one, path, **how, **where)
        for option, given in where.items():
            if given is not None:
                raise user_error(
                    f"--{option} is for sweeps and for means over surfaces; --threads is for a single run"
                )
        _run_one(one, path, checkpoints=checkpoints, **how)


def _run_one(
    one: Scene,
    path: Path,
    *,
    threads: int | None,
    early: compiling.Helpers,
    checkpoints: Path | None,
    figures: bool,
    as_json: bool,
    force: bool,
) -> None:
    from chemage.ageing.methods import EVERY_SITE
    from chemage.foundation.result import result_of
    from chemage.results.files import write
    from chemage.scene import run as experiments
    from chemage.scene.plan import plan
    from chemage.scene.warm_up import compiled_ahead

    result = _without_figures(one, path) if figures and not force else None
    if result is None:
        preflight_result(
            path,
            force=force,
            figures=figures,
            size=plan(one).numbers.get("file", 0),
        )
    pictures: list[Path] = []
    units = {"contact": "iterations", "ageing": (one.ageing or EVERY_SITE).steps}
    with progress_bars(units) as report, watching(report):
        if result is None:
            with compiled_ahead(one, report, threads, early) as told:
                result = experiments.run(
                    one, progress=told, threads=threads, checkpoints=checkpoints
                )
            with reported(report, "writing"):
                write(path, result, force=force)
        if figures:
            with result_written(path), reported(report, "drawing"):
                pictures = drawn(result_of(result), path)
    output.answer(result_of(result), as_json, file=path, figures=pictures)


def _without_figures(one: Scene, path: Path) -> Run | None:
    """The result of this very scene, of a run that was interrupted while its figures were drawn."""
    from chemage.results.files import read
    from chemage.scene.provenance import versions

    if not path.is_file() or figures_of(path).exists():
        return None
    try:
        found = read(path)
    except ChemageError:
        return None
    if getattr(found, "scene", None) != one.todict():
        return None
    if found.versions != versions(one, (found.contact, found.ageing)):
        return None
    print(f"{path} is complete; only its figures are drawn", file=sys.stderr)
    return found


def sweep(
    scene: Annotated[
        str | None,
        typer.Argument(
            help="a scene file (.toml) with [sweep], or the name of an installed scene"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="folder of the sweep (default: NAME-sweep)"
        ),
    ] = None,
    points: PointsOpt = None,
    collect: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="verify all points in this folder and write the tables; computes nothing",
        ),
    ] = None,
    changes: SetOpt = None,
    accuracy: AccuracyOpt = None,
    surfaces: SurfacesOpt = None,
    replicas: ReplicasOpt = None,
    seed: SeedOpt = None,
    threads: ThreadsOpt = None,
    workers: WorkersOpt = None,
    executor: ExecutorOpt = None,
    patience: PatienceOpt = None,
    yes: YesOpt = False,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Compute a sweep, or a part of it beside other processes.

    Several processes, on one machine or many, may compute parts of one sweep into one folder at the same time: give
    each another share with --points. When all have ended, --collect writes the tables. Completed points are skipped;
    rerun the same command to resume.
    """
    from chemage.cli import studies
    from chemage.scene.files import is_sweep

    if collect is not None:
        given = {
            "SCENE": scene,
            "--out": out,
            "--points": points,
            "--set": changes,
            "--executor": executor,
        }
        if others := [name for name, value in given.items() if value is not None]:
            raise user_error(
                f"--collect FOLDER computes nothing; leave out {', '.join(others)}"
            )
        return studies.collect(collect, as_json=as_json)
    if scene is None:
        raise user_error(
            "name a scene with [sweep], or a folder with --collect FOLDER"
        )
    if not is_sweep(scene):
        raise user_error(
            f"{scene} has no [sweep]; `{output.command_line('run', scene)}` runs it"
        )
    values = changed_fields(changes, replicas, seed) | requested_fields(
        accuracy, None, surfaces
    )
    studies.run_sweep(
        scene,
        out,
        values,
        yes=yes,
        as_json=as_json,
        force=force,
        points=points,
        executor=executor,
        workers=workers,
        threads=threads,
        patience=patience,
    )


def check(
    scene: SceneArg,
    changes: SetOpt = None,
    accuracy: AccuracyOpt = None,
    budget: BudgetOpt = None,
    surfaces: SurfacesOpt = None,
    measured: MapOpt = None,
    shares: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="sweeps: show what each of this many shares costs; default: the whole sweep only",
        ),
    ] = None,
    yes: YesOpt = False,
    as_json: JsonOpt = False,
) -> None:
    """Validate a scene and estimate its cost.

    All points of a sweep are validated; nothing is computed.
    """
    try:
        request = requested_fields(accuracy, budget, surfaces, measured)
        _check(scene, changed_fields(changes) | request, shares, yes, as_json)
    except ChemageError as error:
        if as_json:
            problems = getattr(error, "problems", ())
            wrong = [{"field": field, "problem": text} for field, text in problems]
            output.say_json(
                {"valid": False, "error": str(error), "problems": wrong}
            )
        raise


def _check(
    scene: str, values: Data, shares: int | None, yes: bool, as_json: bool
) -> None:
    from chemage.scene.files import is_sweep, load_scene
    from chemage.scene.plan import plan

    if is_sweep(scene):
        from chemage.cli import studies

        return studies.check_sweep(scene, values, yes, as_json, shares)
    if shares is not None:
        raise user_error(f"--shares is for sweeps, and {scene} has no [sweep]")
    one = load_scene(scene, values)
    planned: Any = plan
    if one.is_ensemble:
        from chemage.studies.ensembles.planning import plan as planned
    made = planned(one)
    if as_json:
        output.say_json({"valid": True, **made.todict()})
        return
    output.show_rows(f"{scene} is valid", (), made.rows())
    for note in made.notes:
        output.say(f"warning: {note}")


def status(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            autocompletion=completion.sweeps,
            help="folder of a sweep",
        ),
    ],
    as_json: JsonOpt = False,
) -> None:
    """Count the points of a sweep that are done, failed or missing.

    The numbers are given in total and for each value of each axis.
    """
    from chemage.cli.studies import print_failures
    from chemage.studies.sweeps.grid import listed
    from chemage.studies.sweeps.result import NOT_DONE, load_sweep

    state = load_sweep(folder).status()
    if as_json:
        output.say_json(state)
        return
    counts = ("points", "done", *NOT_DONE)
    groups = [
        (listed(row["values"]), row)
        for axis in state["axes"]
        for row in axis["rows"]
    ]
    rows = [
        (name, *(str(numbers[count]) for count in counts))
        for name, numbers in [*groups, ("all", state)]
    ]
    contacts = [
        str(state[f"contacts{which}"]) for which in ("", "_done", "_damaged")
    ]
    rows.append(("contacts", *contacts[:2], "", "", contacts[2]))
    output.show_rows(f"{state['name']} in {folder}", ("", *counts), rows)
    print_failures(state)


def init(
    name: Annotated[
        Path,
        typer.Argument(
            metavar="NAME",
            help="name of the new scene, which is written to NAME.toml; or a file FILE.toml, and the scene is called "
            "FILE",
        ),
    ] = Path("scene.toml"),
    like: Annotated[
        str,
        typer.Option(
            "--like",
            metavar="SCENE",
            autocompletion=completion.installed_scenes,
            help="installed scene to copy; `chemage plugins list` lists them",
        ),
    ] = "silica-rough",
    force: ForceOpt = False,
) -> None:
    """Write a scene file to begin with.

    The file is a copy of an installed scene, with comments, and NAME as its name.
    """
    from chemage.foundation.files import write_file
    from chemage.scene.files import installed_text, named
    from chemage.scene.scene import file_name

    file = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    if (
        name.suffix not in ("", ".toml") and not name.suffix[1:].isdigit()
    ):  # tip-0.5 has no ending
        raise user_error(
            f"{name}: the name ends in {name.suffix}; a scene file must end in .toml"
        )
    try:
        file_name(os.fsencode(file.stem).decode(errors="replace"))
    except ValueError as error:
        raise user_error(
            f"{file.stem!r} cannot be the name of a scene: {error}"
        ) from None
    plugins = registry.current()
    if like not in plugins.scenes():
        known = sorted(plugins.scenes())
        raise user_error(
            f"no installed scene {like!r}{nearest(like, known)}; installed: {', '.join(known) or 'none'}"
        )
    text = named(installed_text(like), file.stem)
    write_file(file, text, force=force)
    others = ", ".join(sorted(set(plugins.scenes()) - {like}))
    output.remark(f"another scene to begin with: --like SCENE ({others})")
    check, run = (output.command_line(word, file) for word in ("check", "run"))
    output.say(f"{file} is a copy of {like}; change it, then: {check} && {run}")
