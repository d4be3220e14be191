"""The commands ``run`` and ``check`` for a scene with ``[sweep]``, and ``status``."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import typer

from chemage.cli import terminal
from chemage.foundation.errors import ChemageError
from chemage.foundation.printable import printable
from chemage.foundation.text import jsonable
from chemage.sweeps.grid import Survey, shown
from chemage.sweeps.progress import show_progress
from chemage.sweeps.result import SweepResult, load_sweep
from chemage.sweeps.running import read_grid, room_for, survey_of, sweep

#: the table of results and the list of failures are printed up to this many points
_LISTED = 24


def confirm(yes: bool) -> Any:
    """Make a function that asks for confirmation on a terminal; without one only ``yes`` confirms."""

    def ask(question: str) -> bool:
        if yes:
            return True
        return sys.stdin.isatty() and sys.stderr.isatty() and typer.confirm(f"{question}; continue?", err=True)

    return ask


def run(
    scene: str,
    out: Path | None,
    changes: dict[str, Any],
    *,
    executor: str,
    workers: int | None,
    threads: int | None,
    yes: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Compute a sweep; exit status 1 if points failed, 130 if it was interrupted."""
    folder = out or Path(f"{read_grid(scene, changes).base.get('name', 'scene')}-sweep")
    try:
        with show_progress() as report:
            result = sweep(
                scene,
                folder,
                executor=executor,
                workers=workers,
                threads=threads,
                changes=changes,
                progress=report,
                confirm=confirm(yes),
                force=force,
            )
    except KeyboardInterrupt:
        print(printable(f"\ninterrupted; {_kept(folder)}"), file=sys.stderr, flush=True)
        os._exit(130)  # without waiting for threads that may still be in a compiled kernel
    state = {**result.status(), "folder": str(folder)}
    tables = {"csv": str(folder / "results.csv"), "hdf5": str(folder / "results.h5")}
    if as_json:
        print(json.dumps(jsonable({**state, "results": tables})))
    else:
        _print_result(result, state)
        terminal.say("\n".join(f"results  {file}" for file in tables.values()))
    if state["failed"]:
        raise typer.Exit(1)


def _kept(folder: Path) -> str:
    try:
        states = load_sweep(folder).states()
    except ChemageError:
        return "nothing was computed yet"
    done = states.count("done")
    return f"{done} of {len(states)} points are done and kept in {folder}; rerun the same command to resume"


def check(scene: str, changes: dict[str, Any], *, yes: bool, as_json: bool) -> None:
    """Validate every point and estimate the cost of the sweep without computing anything."""
    with show_progress() as report:
        found = survey_of(read_grid(scene, changes), progress=report, confirm=confirm(yes))
    numbers = _numbers(found)
    if as_json:
        print(json.dumps(jsonable(numbers)))
        return

    rows = []
    for axis in found.grid.axes:
        values = ["; ".join(shown(value) for value in values) for values in axis.values]
        few = values if len(values) <= 8 else [*values[:6], "...", values[-1]]
        rows.append((axis.name, f"{len(axis)}: {', '.join(few)}"))
    rows.append(("points", f"{found.grid.size}" + (f" ({found.grid.product})" if len(found.grid.axes) > 1 else "")))
    rows.append(("contacts to solve", f"{len(found.contacts)} on {found.surfaces} surfaces"))
    if found.hooks:
        rows.append(
            ("plugins that implement hooks", ", ".join(f"{name} ({source})" for name, source in found.hooks.items()))
        )
    cost, memory = numbers["cpu_seconds"], numbers["memory"]
    time = "unknown" if cost is None else f"about {_duration(cost)} of CPU time once kernels are compiled"
    rows.append(("expected cost", time))
    if memory is not None:
        rows.append(("expected memory", f"about {memory / 1e9:.2g} GB per worker"))
    rows.append(
        ("expected disk space", f"{numbers['disk'] / 1e6:.3g} MB of {numbers['disk_free'] / 1e6:.3g} MB free here")
    )
    terminal.show_pairs(f"{scene} is valid at every point", rows)


def _numbers(found: Survey) -> dict[str, Any]:
    return {
        "name": found.grid.base.get("name", "scene"),
        "points": found.grid.size,
        "axes": {axis.name: len(axis) for axis in found.grid.axes},
        "contacts": len(found.contacts),
        "surfaces": found.surfaces,
        "hooks": found.hooks,
        "cpu_seconds": found.total_cpu_seconds,
        "memory": None if found.memory is None else 2e8 + found.memory,
        "disk": found.total_bytes,
        "disk_free": room_for(Path.cwd()),
        "digest": found.digest,
    }


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def status(folder: Path, *, as_json: bool) -> None:
    """Print the number of points done, failed and missing, in total and for each value of each axis."""
    state = load_sweep(folder).status()
    if as_json:
        print(json.dumps(jsonable(state)))
        return

    table = terminal.table(f"{state['name']} in {folder}", ("", "points", "done", "failed", "missing"))
    counts = ("points", "done", "failed", "missing")
    for axis in state["axes"]:
        for row in axis["rows"]:
            name = ", ".join(f"{path} = {shown(value)}" for path, value in row["values"].items())
            table.add_row(name, *(str(row[count]) for count in counts))
    table.add_row("all", *(str(state[count]) for count in counts))
    table.add_row("contacts", str(state["contacts"]), str(state["contacts_done"]), "", "")
    terminal.show(table)
    _print_failures(state)


def _print_result(result: SweepResult, state: dict[str, Any]) -> None:
    from chemage.foundation.text import plus_minus

    title = f"{state['done']} of {state['points']} points done, {state['contacts']} contacts"
    if len(result) <= _LISTED:
        table = terminal.table(title, ("point", *_headings(result), "A/A0", "friction drop (nN)", "beta"))
        for point in result:
            if point.status != "done":
                continue
            numbers = point.summary
            drop, error = (
                numbers[name][-1] if numbers.get(name) else None
                for name in ("friction_drop", "friction_drop_half_width")
            )
            half = _nan(numbers.get("beta_half_width"))
            beta = plus_minus(numbers["beta"], half) if numbers["beta"] is not None else "-"
            table.add_row(
                str(point.index),
                *(f"{value:.6g}" if isinstance(value, float) else shown(value) for value in point.values.values()),
                f"{numbers['area_fraction']:.5f}",
                "-" if drop is None else plus_minus(drop, _nan(error)),
                beta,
            )
        terminal.show(table)
    else:
        terminal.say(title)
    _print_failures(state)


def _headings(result: SweepResult) -> list[str]:
    """Headings of the swept fields with their units; without the section where the name alone is unique."""
    last = [path.rpartition(".")[2] for path in result.swept]
    names = [name if last.count(name) == 1 else path for name, path in zip(last, result.swept, strict=True)]
    units = [result.units.get(path, "") for path in result.swept]
    return [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]


def _nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _print_failures(state: dict[str, Any]) -> None:
    for failed in state["failures"][:_LISTED]:
        where = ", ".join(f"{path} = {shown(value)}" for path, value in failed["changes"].items())
        terminal.say(f"failed: point {failed['point']} ({where}): {failed['error']}", file=sys.stderr)
    if (more := len(state["failures"]) - _LISTED) > 0:
        terminal.say(f"failed: {more} more points; `chemage status --json` lists them all", file=sys.stderr)
