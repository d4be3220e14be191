"""What the command line says and asks where a scene is a sweep."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import typer

from chemage.cli import terminal
from chemage.foundation.errors import ChemageError
from chemage.foundation.text import jsonable
from chemage.sweeps.grid import Survey, shown
from chemage.sweeps.progress import show_progress
from chemage.sweeps.result import SweepResult, load_sweep
from chemage.sweeps.running import read_grid, room_for, survey_of, sweep

#: results are listed on the screen up to this many points
_LISTED = 24


def confirm(yes: bool) -> Any:
    """Asks on a terminal; without one, agrees only if ``yes``."""

    def ask(what: str) -> bool:
        if yes:
            return True
        return sys.stdin.isatty() and sys.stderr.isatty() and typer.confirm(f"{what}; go on?", err=True)

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
    """Compute the sweep; exit status 1 when points failed, 130 when interrupted."""
    folder = out or Path(f"{read_grid(scene, changes).base.get('name', 'scene')}-sweep")
    try:
        with show_progress() as tell:
            result = sweep(
                scene,
                folder,
                executor=executor,
                workers=workers,
                threads=threads,
                changes=changes,
                progress=tell,
                confirm=confirm(yes),
                force=force,
            )
    except KeyboardInterrupt:
        print(f"\ninterrupted; {_kept(folder)}", file=sys.stderr, flush=True)
        # threads may still be inside a compiled kernel; waiting for them would not help anyone
        os._exit(130)
    state = {**result.status(), "folder": str(folder)}
    tables = {"csv": str(folder / "results.csv"), "hdf5": str(folder / "results.h5")}
    if as_json:
        print(json.dumps(jsonable({**state, "results": tables})))
    else:
        _print_result(result, state)
        print("\n".join(f"results  {file}" for file in tables.values()))
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
    """Validate every point and say what the sweep needs; nothing is computed."""
    with show_progress() as tell:
        found = survey_of(read_grid(scene, changes), tell=tell, confirm=confirm(yes))
    numbers = _numbers(found)
    if as_json:
        print(json.dumps(jsonable(numbers)))
        return

    table = terminal.table(f"{scene} is valid at every point")
    for axis in found.grid.axes:
        values = ["; ".join(shown(value) for value in values) for values in axis.values]
        few = values if len(values) <= 8 else [*values[:6], "...", values[-1]]
        table.add_row(axis.name, f"{len(axis)}: {', '.join(few)}")
    shape = " x ".join(str(length) for length in found.grid.shape)
    table.add_row("points", f"{found.grid.size}" + (f" ({shape})" if len(found.grid.axes) > 1 else ""))
    table.add_row("contacts to solve", f"{len(found.contacts)} on {found.surfaces} surfaces")
    if found.hooks:
        table.add_row("plugins on the way", ", ".join(found.hooks))
    cost = numbers["cpu_seconds"]
    told = f"about {_duration(cost)} of CPU time once kernels are compiled" if cost is not None else "cannot be told"
    table.add_row("expected cost", told)
    if numbers["memory"] is not None:
        table.add_row("expected memory", f"about {numbers['memory'] / 1e9:.2g} GB a worker")
    table.add_row("expected disk", f"{numbers['disk'] / 1e6:.3g} MB; {numbers['disk_free'] / 1e6:.3g} MB are free here")
    terminal.show(table)


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
    """Print what is done, what failed and what is missing."""
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
                numbers[name][-1] if numbers[name] else None for name in ("friction_drop", "friction_drop_stderr")
            )
            beta = plus_minus(numbers["beta"], _nan(numbers["beta_stderr"])) if numbers["beta"] is not None else "-"
            table.add_row(
                str(point.index),
                *(f"{value:.6g}" if isinstance(value, float) else shown(value) for value in point.values.values()),
                f"{numbers['area_fraction']:.5f}",
                "-" if drop is None else plus_minus(drop, _nan(error)),
                beta,
            )
        terminal.show(table)
    else:
        print(title)
    _print_failures(state)


def _headings(result: SweepResult) -> list[str]:
    """Short names of what was swept: the field's own where that says which, with its unit."""
    last = [path.rpartition(".")[2] for path in result.swept]
    names = [name if last.count(name) == 1 else path for name, path in zip(last, result.swept, strict=True)]
    units = [result.units.get(path, "") for path in result.swept]
    return [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]


def _nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _print_failures(state: dict[str, Any]) -> None:
    for failed in state["failures"][:_LISTED]:
        where = ", ".join(f"{path} = {shown(value)}" for path, value in failed["changes"].items())
        print(f"failed: point {failed['point']} ({where}): {failed['error']}", file=sys.stderr)
    if (more := len(state["failures"]) - _LISTED) > 0:
        print(f"failed: {more} more points; `chemage status --json` lists them all", file=sys.stderr)
