"""The commands that need no result: materials, schema, selftest, and warmup, which compiles kernels beforehand."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chemage.cli import output
from chemage.cli.options import JsonOpt, user_error
from chemage.foundation.progress import loaded, loading, progress_bars
from chemage.plugins import registry

if TYPE_CHECKING:
    from chemage.scene.scene import Scene

#: points of a sweep that are looked at
MOST_POINTS = 1000


def materials(
    name: Annotated[
        str | None,
        typer.Argument(help="a material, such as silica; default: list all"),
    ] = None,
    as_toml: Annotated[
        bool,
        typer.Option(
            "--toml",
            help="print the sections of a scene, with the sources as comments, to copy",
        ),
    ] = False,
    as_json: JsonOpt = False,
) -> None:
    """List materials, or show the values of one.

    Each value is shown with its source and how it is known: measured, calculated, calibrated or estimated. A scene
    names a material with material = "NAME", which fills what the scene does not say.
    """
    from chemage.scene.materials import material

    if as_toml and (name is None or as_json):
        raise user_error("--toml: give the name of a material, and no --json")
    if name is None:
        entries = [
            material(entry) for entry in sorted(registry.current().materials())
        ]
        if as_json:
            output.say_json([entry.todict() for entry in entries])
            return
        rows = [
            (entry.name, entry.title, str(len(entry.values)), entry.source)
            for entry in entries
        ]
        return output.show_rows("", ("material", "", "values", "from"), rows)
    entry = material(name)
    if as_json:
        output.say_json(entry.todict())
    elif as_toml:
        output.say(entry.toml(), end="")
    else:
        if entry.about:
            output.say(f"{entry.about}\n")
        rows = []
        for value in entry.values:
            rows.append(
                (
                    value.path,
                    value.text,
                    value.how,
                    "; ".join(filter(None, (value.source, value.note))),
                )
            )
        output.show_rows(
            f"{entry.name}: {entry.title}", ("value", "", "how", "source"), rows
        )


def schema() -> None:
    """Print the JSON Schema of scene files.

    Editors check scenes with it. It includes the options of all installed components.
    """
    from chemage.scene.schema import scene_schema

    print(json.dumps(scene_schema(), indent=2))


def warmup(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE]...",
            help="scene files (.toml), or names of installed scenes; default: all installed ones",
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
            for entry in _forms(name):
                if (what := entry.form()) in seen:
                    continue
                seen.add(what)
                try:
                    entry.warm_up()
                except Exception as error:
                    if registry.current().strict:
                        raise
                    failed[name] = f"{type(error).__name__}: {error}"
    told: dict[str, Any] = {
        "kernels": compiled,
        "seconds": round(time.perf_counter() - begin, 2),
        "folders": [str(machine.kernel_folder())],
        "processor": machine.processor(),
        "failed": failed,
    }
    for name, why in failed.items():
        output.say(
            f"chemage: warning: not everything could be compiled for {name}: {why}",
            file=sys.stderr,
        )
    if as_json:
        output.say_json(told)
    else:
        number = len(compiled)
        output.say(
            f"{number} kernel{'' if number == 1 else 's'} compiled in {told['seconds']:.1f} s"
            if number
            else "all kernels are compiled already"
        )
        output.say(f"for the processor {told['processor']}")
        for folder in told["folders"]:
            output.say(f"in {folder}")
    if failed:
        raise typer.Exit(1)


def selftest(as_json: JsonOpt = False) -> None:
    """Test this installation.

    In less than a minute, against closed forms and known numbers.

    Every solver, engine, distribution, interaction, law and reader, the random numbers and the files: what they compute
    on this machine is compared with what is known. Prints the processor, the libraries and the folders of compiled
    kernels. Exit status 1 if something is wrong.
    """
    loading("loading chemage")
    from chemage.foundation import machine
    from chemage.scene.provenance import versions
    from chemage.testing.selftest import selftest as outcomes

    about = {
        **versions(),
        "kernels": str(machine.kernel_folder()),
        "cache": str(machine.cache_folder()),
    }
    if not as_json:
        for name, value in about.items():
            output.say(f"{name} {value}")
    loaded()
    parts, begin = [], time.perf_counter()
    for outcome in outcomes():
        parts.append(outcome)
        state = (outcome.untested and "not tested") or (
            "WRONG" if outcome.problems else "right"
        )
        if not as_json:
            count = (
                outcome.untested
                or f"{outcome.passed} tests in {outcome.seconds:.1f} s"
            )
            output.say(f"{state:10} {outcome.part}: {count}")
            for problem in outcome.problems:
                output.say(f"           {problem}")
    wrong = sum(len(part.problems) for part in parts)
    if as_json:
        output.say_json(
            {
                "machine": about,
                "wrong": wrong,
                "parts": [part._asdict() for part in parts],
            }
        )
    else:
        right = sum(part.passed for part in parts)
        output.say(
            f"{right} tests passed, {wrong} failed, in {time.perf_counter() - begin:.0f} s"
        )
    if wrong:
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
