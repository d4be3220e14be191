"""Scenes with ``[accuracy]`` or ``[sweep]``: the parts of ``run`` and ``check`` that are theirs, and ``status``."""

from __future__ import annotations

import math
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from chemage.cli import output
from chemage.cli.options import chosen_executor, user_error
from chemage.cli.output import drawn, preflight_result, result_written
from chemage.foundation import compiling
from chemage.foundation.aliases import Data
from chemage.foundation.errors import ChemageError, printable
from chemage.foundation.progress import LOGGER, progress_bars, reported
from chemage.foundation.result import result_of
from chemage.studies.runner import PROGRAM
from chemage.studies.study import Selection, in_ranges
from chemage.studies.sweeps.grid import (
    agreed_points,
    cpu_seconds,
    listed,
    shares_cost,
)
from chemage.studies.sweeps.result import (
    SweepResult,
    collect_sweep,
    count,
    in_words,
    load_sweep,
)
from chemage.studies.sweeps.running import (
    Report,
    SweepProgress,
    expected_seconds,
    read_grid,
    room_for,
    show_progress,
    survey_of,
    sweep,
)
from chemage.studies.sweeps.views import swept_rows

if TYPE_CHECKING:
    from chemage.scene.scene import Scene


def run_ensemble(
    scene: Scene,
    path: Path,
    *,
    threads: int | None,
    early: compiling.Helpers,
    figures: bool,
    as_json: bool,
    force: bool,
    executor: str | None,
    workers: int | None,
    **how: Any,
) -> None:
    """Sample the ensemble that a scene asks for, write it to ``path`` and print it."""
    from chemage.results.files import write
    from chemage.scene.warm_up import compiled_ahead
    from chemage.studies.ensembles.running import (
        CORRECTING,
        SAMPLING,
        SKETCHING,
        Sampler,
    )

    folder = path.with_name(f"{path.stem}-samples")
    preflight_result(path, force=force, figures=figures)
    if folder.exists() and not folder.is_dir():
        raise user_error(
            f"{folder}, the folder for the samples, is a file; choose another --out"
        )
    pictures: list[Path] = []
    where = {
        "executor": chosen_executor(executor, workers, "threads"),
        "workers": workers,
    }
    sampler = Sampler(scene, samples=folder, threads=threads, **where, **how)
    counted = sampler.request.counted
    with progress_bars(
        {SAMPLING: counted, SKETCHING: counted, CORRECTING: counted}
    ) as report:
        with compiled_ahead(scene, report, threads, early) as told:
            mean = sampler.run(told)
        if not sampler.writes:
            output.show_result(result_of(mean))
            return output.say(f"the first share writes {path}")
        with reported(report, "writing"):
            write(path, mean, force=force)
        if figures:
            with result_written(path), reported(report, "drawing"):
                pictures = drawn(result_of(mean), path)
    kept = sampler.taken
    taken = (
        [f"{kept} sample{'s' if kept > 1 else ''} taken from {folder}"]
        if kept
        else []
    )
    more = "a run with a smaller interval takes these samples up; the folder may be removed otherwise"
    written = {
        "file": path,
        "samples": folder,
        "samples_taken": kept,
        "figures": pictures,
    }
    remarks = [*taken, *[more] * output.every()]
    output.answer(result_of(mean), as_json, remarks, **written)


#: failures are listed up to this many points
_LISTED = 24


def confirm(yes: bool) -> Any:
    """Make a function that asks for confirmation on a terminal; without one only ``yes`` confirms."""

    def ask(question: str) -> bool:
        if yes:
            return True
        return (
            sys.stdin.isatty()
            and sys.stderr.isatty()
            and typer.confirm(f"{question}; continue?", err=True)
        )

    return ask


def run_sweep(
    scene: str,
    out: Path | None,
    changes: Data,
    *,
    yes: bool,
    as_json: bool,
    points: str | None,
    executor: str | None,
    workers: int | None,
    **how: Any,
) -> None:
    """Compute a sweep, or some of its points, with ``how`` of :func:`chemage.sweep`.

    Exit status 1 if points failed, 130 or 143 if it was stopped.
    """
    folder = out or Path(
        f"{read_grid(scene, changes).base.get('name', 'scene')}-sweep"
    )
    chosen = None if points is None else Selection.read(points)
    try:
        with show_progress() as report:
            result = sweep(
                scene,
                folder,
                executor=chosen_executor(executor, workers, None),
                workers=workers,
                changes=changes,
                progress=_logged(report),
                confirm=confirm(yes),
                points=None if chosen is None else str(chosen),
                **how,
            )
    except KeyboardInterrupt:
        word, status = output.stopped()
        print(printable(f"\n{word}; {_kept(folder)}"), file=sys.stderr, flush=True)
        os._exit(
            status
        )  # without waiting for threads that may still be in a compiled kernel
    if chosen is not None:
        return _print_share(result, folder, chosen, as_json=as_json)
    _print_whole(
        result, {**result.status(), "folder": str(folder)}, as_json=as_json
    )


def _print_whole(result: SweepResult, state: Data, *, as_json: bool) -> None:
    folder = Path(state["folder"])
    tables = {
        "csv": str(folder / "results.csv"),
        "hdf5": str(folder / "results.h5"),
    }
    if as_json:
        output.say_json({**state, "results": tables})
    else:
        output.show_result(result_of(result))
        print_failures(state)
        output.say("\n".join(f"results  {file}" for file in tables.values()))
    if state["failed"]:
        raise typer.Exit(1)


def _logged(report: Report) -> Report:
    """Log the progress of a sweep whenever a contact or a point is complete, and pass all of it on."""
    last: tuple[int, ...] = ()

    def tell(state: SweepProgress) -> None:
        nonlocal last
        now = (state.done, state.failed, state.contacts_done)
        if state.stage == "computing" and now != last:
            last = now
            LOGGER.info("%s", state)
        report(state)

    return tell


def _print_share(
    result: SweepResult, folder: Path, chosen: Selection, *, as_json: bool
) -> None:
    """Print what has become of the points of one process; exit status 1 if some of them failed."""
    whole = result.means and chosen.share is not None
    points = (
        range(len(result))
        if whole
        else agreed_points(chosen, result.store, result.digest, len(result))
    )
    states = [result.store.state(result.keys[point]) for point in points]
    counts = count(states)
    failures = result.failures(
        point
        for point, state in zip(points, states, strict=True)
        if state == "failed"
    )
    if as_json:
        share = {
            **counts,
            "points": str(chosen),
            "numbers": list(points),
            "failures": failures,
        }
        output.say_json({"name": result.name, "folder": folder, "share": share})
    else:
        left = in_words(counts)
        output.say(
            f"{chosen.describe()}: {counts['done']} of {len(points)} points done{left and ', '}{left} in {folder}"
        )
        output.say(f"when all are done: chemage sweep --collect {folder}")
        print_failures({"failures": failures})
    if counts["done"] < len(points):
        raise typer.Exit(1)


def collect(folder: Path, *, as_json: bool) -> None:
    """Verify the points of a sweep and write its tables; exit status 1 if some are not done."""
    survey = collect_sweep(folder)
    state = {
        **survey.result.status(),
        "folder": str(folder),
        "points_to_compute": survey.points,
    }
    if survey.written:
        return _print_whole(survey.result, state, as_json=as_json)
    if as_json:
        output.say_json({**state, "results": None})
        raise typer.Exit(1)
    say = partial(output.say, file=sys.stderr)
    print_failures(state)
    for word, numbers in (("missing", survey.missing), ("damaged", survey.damaged)):
        if numbers:
            say(
                f"{len(numbers)} of {state['points']} points are {word} in {folder}; no tables were written"
            )
            say(f"{word}: points {in_ranges(numbers)}")
    if survey.computing:
        say("a process of this machine computes points at present")
    scene = (
        survey.result.grid.source
        if Path(survey.result.grid.source).is_file()
        else "SCENE"
    )
    *parts, everything = survey.points
    told = [("some", part) for part in parts[:_LISTED]]
    for share, points in (*told, ("all", everything)):
        command = output.command_line(
            "sweep", scene, "--out", folder, "--points", points
        )
        say(f"computes {share} of them: {command}")
    raise typer.Exit(1)


def _kept(folder: Path) -> str:
    try:
        states = load_sweep(folder).states()
    except ChemageError:
        return "nothing was computed yet"
    done = states.count("done")
    return f"{done} of {len(states)} points are done and kept in {folder}; rerun the same command to resume"


def check_sweep(
    scene: str,
    changes: Data,
    yes: bool,
    as_json: bool,
    shares: int | None,
) -> None:
    """Validate every point and estimate the cost of the sweep, and of its shares, without computing anything."""
    with show_progress() as report:
        survey = survey_of(
            read_grid(scene, changes), progress=report, confirm=confirm(yes)
        )
    notes = survey.warnings()
    numbers = {
        "name": survey.grid.base.get("name", "scene"),
        "points": survey.grid.size,
        "axes": {axis.name: len(axis) for axis in survey.grid.axes},
        "contacts": len(survey.contacts),
        "surfaces": survey.surfaces,
        "hooks": survey.hooks,
        "cpu_seconds": expected_seconds(survey)
        if survey.means
        else cpu_seconds(survey.tasks),
        "memory": None if math.isnan(survey.memory) else PROGRAM + survey.memory,
        "disk": survey.bytes,
        "disk_free": room_for(Path.cwd()),
        "digest": survey.digest,
        "notes": notes,
    }
    each = [] if shares is None or survey.means else shares_cost(survey, shares)
    if each:
        numbers["shares"] = [vars(share) for share in each]
    if as_json:
        output.say_json({"valid": True, **numbers})
        return

    rows = swept_rows(survey.grid.axes)
    rows.append(
        (
            "points",
            f"{survey.grid.size}"
            + (f" ({survey.grid.product})" if len(survey.grid.axes) > 1 else ""),
        )
    )
    if survey.means:
        rows.append(
            (
                "each point",
                "a mean over surfaces; points have surfaces in common where they can",
            )
        )
    else:
        rows.append(
            (
                "contacts to solve",
                f"{len(survey.contacts)} on {survey.surfaces} surfaces",
            )
        )
    if hooks := ", ".join(
        f"{name} ({source})" for name, source in survey.hooks.items()
    ):
        rows.append(("plugins that implement hooks", hooks))
    cost, memory = numbers["cpu_seconds"], numbers["memory"]
    time = (
        "unknown"
        if cost is None
        else f"about {_duration(cost)} of CPU time once kernels are compiled"
    )
    rows.append(("expected cost", time))
    if memory is not None:
        rows.append(("expected memory", f"about {memory / 1e9:.2g} GB per worker"))
    rows.append(
        (
            "expected disk space",
            f"{numbers['disk'] / 1e6:.3g} MB of {numbers['disk_free'] / 1e6:.3g} MB free here",
        )
    )
    if each:
        points = [share.points for share in each]
        costs = [
            share.cpu_seconds for share in each if share.cpu_seconds is not None
        ]
        rows.append(
            (
                f"points in each of {len(each)} shares",
                f"{min(points)} to {max(points)}",
            )
        )
        if len(costs) == len(each):
            rows.append(
                (
                    "CPU time of a share",
                    f"{_duration(min(costs))} to {_duration(max(costs))}",
                )
            )
    output.show_rows(f"{scene} is valid at every point", (), rows)
    for text in notes:
        output.say(f"warning: {text}")


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.2g} s"
    return (
        f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"
    )


def print_failures(state: Data) -> None:
    for failed in state["failures"][:_LISTED]:
        what = f"point {failed['point']} ({listed(failed['changes'])})"
        output.say(f"failed: {what}: {failed['error']}", file=sys.stderr)
    if (more := len(state["failures"]) - _LISTED) > 0:
        output.say(
            f"failed: {more} more points; `chemage status --json` lists them all",
            file=sys.stderr,
        )
