"""The commands of an experiment: run, check, status, tradeoff, schema, init."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chemage.cli import terminal
from chemage.cli.options import (
    ExecutorOpt,
    ForceOpt,
    JsonOpt,
    SceneArg,
    SetOpt,
    ThreadsOpt,
    WorkersOpt,
    YesOpt,
    changed_fields,
    known_figure,
    user_error,
)
from chemage.cli.results import print_run
from chemage.foundation.progress import progress_bars, reported

if TYPE_CHECKING:
    from chemage.experiments.run import Run
    from chemage.experiments.scene import Scene


def run(
    scene: SceneArg,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="result file (default: NAME.h5), or folder of a sweep (default: NAME-sweep)"),
    ] = None,
    changes: SetOpt = None,
    replicas: Annotated[int | None, typer.Option(help="number of replicas; short for --set hold.replicas=N")] = None,
    seed: Annotated[
        int | None, typer.Option(help="seed of the disorder and the kinetics; short for --set hold.seed=N")
    ] = None,
    threads: ThreadsOpt = None,
    workers: WorkersOpt = None,
    executor: ExecutorOpt = None,
    yes: YesOpt = False,
    checkpoints: Annotated[
        Path | None,
        typer.Option(help="folder for checkpoints of the contact and of each replica, from which a run resumes"),
    ] = None,
    figures: Annotated[bool, typer.Option(help="draw the figures")] = True,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Run a scene, or all points of a sweep.

    Writes one result file and its figures. The points of a scene with [sweep] are computed into a folder; completed
    points are skipped; rerun the same command to resume.
    """
    from chemage.experiments.scene_files import is_sweep, load_scene

    if is_sweep(scene):
        from chemage.cli import sweeps

        if checkpoints is not None:
            raise user_error("--checkpoints is for a single run; a sweep resumes from its own folder")

        return sweeps.run(
            scene,
            out,
            changed_fields(changes, replicas, seed),
            executor=executor or ("processes" if (workers or 1) > 1 else "serial"),
            workers=workers,
            threads=threads,
            yes=yes,
            as_json=as_json,
            force=force,
        )
    for option, given in (("--executor", executor), ("--workers", workers)):
        if given is not None:
            raise user_error(f"{option} is for sweeps, and {scene} has no [sweep]; --threads is for a single run")
    one = load_scene(scene, changed_fields(changes, replicas, seed))
    path = out or Path(f"{one.name}.h5")
    _protect_inputs(path, scene, one)
    _run_one(one, path, threads=threads, checkpoints=checkpoints, figures=figures, as_json=as_json, force=force)


def _run_one(
    one: Scene,
    path: Path,
    *,
    threads: int | None,
    checkpoints: Path | None,
    figures: bool,
    as_json: bool,
    force: bool,
) -> None:
    from chemage.experiments import run as experiments
    from chemage.experiments.estimate import plan
    from chemage.foundation.files import preflight
    from chemage.store.results import write

    result = _without_figures(one, path) if figures and not force else None
    if result is None:
        preflight(path, force=force, size=plan(one).numbers.get("file", 0))
        if figures:
            _preflight_folder(_figures_of(path), force)
    pictures: list[Path] = []
    with progress_bars() as report:
        if result is None:
            result = experiments.run(one, progress=report, threads=threads, checkpoints=checkpoints)
            with reported(report, "writing"):
                write(path, result, force=force)
        if figures:
            with _result_written(path), reported(report, "drawing"):
                pictures = _drawn(result, _figures_of(path))
    if as_json:
        print(json.dumps({**result.summary(), "file": str(path), "figures": [str(p) for p in pictures]}))
        return
    print_run(result)
    terminal.say(f"\nresult   {path}")
    for picture in pictures:
        terminal.say(f"figure   {picture}")


def _figures_of(path: Path) -> Path:
    return path.with_name(f"{path.stem}-figures")


def _without_figures(one: Scene, path: Path) -> Run | None:
    """The result of this very scene, of a run that was interrupted while its figures were drawn."""
    from chemage.experiments.provenance import versions
    from chemage.experiments.run import Run
    from chemage.foundation.errors import ChemageError
    from chemage.store.results import read

    if not path.is_file() or _figures_of(path).exists():
        return None
    try:
        found = read(path)
    except ChemageError:
        return None
    if not isinstance(found, Run) or found.scene != one.todict():
        return None
    if found.versions != versions(one, (found.contact, found.aging)):
        return None
    print(f"{path} is complete; only its figures are drawn", file=sys.stderr)
    return found


def _drawn(result: Run, folder: Path) -> list[Path]:
    """Draw the figures; a new folder gets its name when all of them are in it."""
    import shutil

    from chemage.reports import run_figures

    if folder.exists():
        return run_figures.save(result, folder, force=True)
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        pictures = run_figures.save(result, part)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [folder / picture.name for picture in pictures]


def _protect_inputs(path: Path, source: str, one: Scene) -> None:
    """Refuse to overwrite the scene file, or a file that the scene reads, even with ``--force``."""
    read = [part["path"] for part in one.todict().values() if isinstance(part, dict) and "path" in part]
    for name in (source, *read):
        if "\0" not in str(name) and os.path.realpath(name) == os.path.realpath(path):
            raise user_error(f"{path} is an input of this scene; choose another --out")


def _preflight_folder(folder: Path, force: bool) -> None:
    if folder.is_symlink():
        raise user_error(f"{folder}, the folder for the figures, is a link; remove it, or choose another --out")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise user_error(f"{folder}, the folder for the figures, is a file; choose another --out, or --no-figures")
    if not force and any(folder.iterdir()):
        raise user_error(f"{folder} is already there; choose another --out, or overwrite it with --force")


@contextmanager
def _result_written(path: Path) -> Iterator[None]:
    """Add to the errors of a block that the result itself has been written to ``path``."""
    from chemage.foundation.errors import StoreError

    try:
        yield
    except StoreError as error:
        raise StoreError(f"{error}\nthe result itself is in {path}; `chemage plot {path}` draws its figures") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the result is in {path}, but its figures are incomplete") from None


def check(scene: SceneArg, changes: SetOpt = None, yes: YesOpt = False, as_json: JsonOpt = False) -> None:
    """Validate a scene and estimate its cost.

    All points of a sweep are validated; nothing is computed.
    """
    from chemage.experiments.estimate import plan
    from chemage.experiments.scene_files import is_sweep, load_scene
    from chemage.foundation.text import jsonable

    if is_sweep(scene):
        from chemage.cli import sweeps

        return sweeps.check(scene, changed_fields(changes), yes=yes, as_json=as_json)
    made = plan(load_scene(scene, changed_fields(changes)))
    if as_json:
        print(json.dumps(jsonable(made.todict())))
        return
    terminal.show_pairs(f"{scene} is valid", made.rows())
    for note in made.notes:
        terminal.say(f"note: {note}")


def status(folder: Annotated[Path, typer.Argument(help="the folder of a sweep")], as_json: JsonOpt = False) -> None:
    """Count the points of a sweep by state.

    Lists how many are done, failed or missing, in total and for each value of each axis.
    """
    from chemage.cli import sweeps

    sweeps.status(folder, as_json=as_json)


def tradeoff(
    scene: SceneArg,
    changes: SetOpt = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="file of the figure (.png, .pdf or .svg); default: no figure")
    ] = None,
    as_json: JsonOpt = False,
    force: ForceOpt = False,
) -> None:
    """Measure speed against accuracy on a scene.

    The settings that affect both are changed one at a time, and cost and error of each are listed.
    """
    from chemage.experiments.scene_files import load_scene
    from chemage.experiments.settings import planned
    from chemage.experiments.tradeoff import tradeoff as measure
    from chemage.foundation.files import fresh_file, preflight
    from chemage.reports.tradeoff_figure import figure

    one = load_scene(scene, changed_fields(changes))
    if out is not None:
        known_figure(out)
        preflight(out, force=force)
    print(f"{one.name}: {planned(one)}", file=sys.stderr)
    with progress_bars() as report:
        found = measure(one, report=lambda what: report(what, 0, 0))
    if out is not None:
        with fresh_file(out, force=force) as part:
            figure(found).savefig(part, format=out.suffix.removeprefix(".").lower() or "png")
    if as_json:
        print(json.dumps(found.todict()))
        return
    table = terminal.table(
        f"Speed against accuracy: {one.name} (* as in the scene; ± is half the width of a 95 % interval)",
        (
            *("option", "value", "CPU (s)", "wall (s)", "A/A0", "corrected", "area error"),
            *("p error", "estimate", "beta", "difference", ""),
        ),
    )
    for row in found.rows:
        table.add_row(
            row.option,
            row.setting + (" *" if row.own else ""),
            _number(row.cpu_seconds),
            _number(row.wall_seconds),
            _number(row.area_fraction, 5),
            _number(row.corrected_fraction, 5),
            _with_error(row.area_error, row.area_error_half_width, 2),
            _number(row.pressure_error, 2),
            _number(row.pressure_estimate, 2),
            _with_error(row.beta, row.beta_half_width),
            _with_error(row.beta_difference, row.beta_difference_half_width),
            row.remark,
        )
    terminal.show(table, width=200)
    for note in found.notes:
        terminal.say(note)


def _number(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}" if value == value else ""


def _with_error(value: float, error: float, digits: int = 4) -> str:
    from chemage.foundation.text import plus_minus

    return plus_minus(value, error) if error > 0 else _number(value, digits)


def schema() -> None:
    """Print the JSON Schema of scene files.

    It includes the components of all installed plugins.
    """
    from chemage.experiments.schema import scene_schema

    print(json.dumps(scene_schema(), indent=2))


def init(
    file: Annotated[Path, typer.Argument(help="the scene file to write")] = Path("scene.toml"),
    like: Annotated[str, typer.Option("--like", help="installed scene to copy")] = "silica-rough",
    force: ForceOpt = False,
) -> None:
    """Write a scene file as a starting point."""
    from chemage.experiments.scene_files import installed_text
    from chemage.foundation.files import fresh_file
    from chemage.foundation.messages import nearest
    from chemage.plugins import registry

    plugins = registry.current()
    if like not in plugins.scenes():
        names = sorted(plugins.scenes())
        raise user_error(f"no installed scene {like!r}{nearest(like, names)}; installed: {', '.join(names) or 'none'}")
    text = installed_text(like)
    with fresh_file(file, force=force) as part:
        part.write_text(text, encoding="utf-8")
    terminal.say(f"{file} is a copy of {like}; change it, then: chemage check {file} && chemage run {file}")
