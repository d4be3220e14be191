"""The command that compiles kernels before they are needed: warmup."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import terminal
from chemage.cli.options import JsonOpt
from chemage.foundation.progress import loading, progress_bars

if TYPE_CHECKING:
    from chemage.scene.scene import Scene

#: points of a sweep that are looked at
MOST_POINTS = 1000


def warmup(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE]...", help="scene files (.toml), or names of installed scenes; default: all installed ones"
        ),
    ] = None,
    as_json: JsonOpt = False,
) -> None:
    """Compile the kernels that scenes need.

    Nothing of the scenes is computed. Kernels that are compiled already are left as they are. Without this command the
    first run compiles them. Prints where they are kept, which NUMBA_CACHE_DIR decides.
    """
    loading("loading chemage")
    from chemage.foundation import compiling, machine
    from chemage.plugins import registry
    from chemage.scene.warm_up import form, warm_up

    begin = time.perf_counter()
    failed: dict[str, str] = {}
    with ExitStack() as stack:
        report = stack.enter_context(progress_bars())
        compiled = stack.enter_context(
            compiling.watched(
                lambda count: report(compiling.STAGE, count, 0, compiling.NOTE),
                lambda count: report(compiling.STAGE, count, 0),
            )
        )
        seen: set[str] = set()
        for name in scenes or sorted(registry.current().scenes()):
            for one in _forms(name):
                if (what := form(one)) in seen:
                    continue
                seen.add(what)
                try:
                    warm_up(one)
                except Exception as error:
                    if registry.current().strict:
                        raise
                    failed[name] = f"{type(error).__name__}: {error}"
    found: dict[str, Any] = {
        "kernels": compiled.kernels,
        "seconds": round(time.perf_counter() - begin, 2),
        "folders": [str(machine.kernel_folder())],
        "processor": machine.processor(),
        "failed": failed,
    }
    for name, why in failed.items():
        terminal.say(f"chemage: warning: not everything could be compiled for {name}: {why}", file=sys.stderr)
    if as_json:
        print(json.dumps(found))
    else:
        number = len(compiled.kernels)
        terminal.say(
            f"{number} kernel{'' if number == 1 else 's'} compiled in {found['seconds']:.1f} s"
            if number
            else "all kernels are compiled already"
        )
        terminal.say(f"for the processor {found['processor']}")
        for folder in found["folders"]:
            terminal.say(f"in {folder}")
    if failed:
        raise typer.Exit(1)


def _forms(name: str) -> Iterator[Scene]:
    """A scene, or the points of a sweep."""
    from chemage.scene.files import is_sweep, load_scene

    if not is_sweep(name):
        yield load_scene(name)
        return
    from chemage.studies.sweeps.running import read_grid

    grid = read_grid(name)
    for point in range(min(grid.size, MOST_POINTS)):
        yield grid.scene(point)
