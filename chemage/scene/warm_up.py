"""Compile the kernels of a scene before they are needed: by command, or in a second process during the first run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from subprocess import TimeoutExpired

from chemage.foundation import compiling
from chemage.foundation.aliases import Fields
from chemage.foundation.progress import Report
from chemage.plugins import registry
from chemage.scene.files import load_scene, parse_scene
from chemage.scene.scene import Scene


@contextmanager
def compiled_ahead(
    scene: Scene,
    report: Report,
    threads: int | None = None,
    early: compiling.Helpers | None = None,
) -> Iterator[Report]:
    """Report the kernels that are compiled during a block, and compile in other processes what it will need later.

    The block is given the function to report the stages of the run with. The processes are started when the first
    kernel is compiled before the ageing, unless there are ``early`` ones, so that nothing happens where all kernels are
    cached. They share the cache on disk with this process and end with the block; the ageing waits for the one that
    compiles the same, for a minute at most. What becomes of them does not matter otherwise.
    """
    helpers: compiling.Helpers = {}
    stages: set[str] = set()
    count = 0

    def follow(stage: str, done: int, total: int, note: str = "") -> None:
        if stage == "ageing" and stage not in stages:
            _wait({**(early or {}), **helpers}.get(stage), report, count)
        stages.add(stage)
        report(stage, done, total, note)

    def begin(compiled: int) -> None:
        report(compiling.STAGE, compiled, 0, compiling.NOTE)
        if compiled == 0 and not early and "ageing" not in stages:
            helpers.update(
                compiling.begin(
                    scene.todict(), None, threads, registry.current().installed()
                )
            )

    def end(compiled: int) -> None:
        nonlocal count
        count = compiled
        report(compiling.STAGE, compiled, 0)

    try:
        with compiling.watched(begin, end):
            yield follow
    finally:
        compiling.end(helpers.values())


def _wait(helper: compiling.Process | None, report: Report, compiled: int) -> None:
    """Wait for a process that has begun to compile what is needed now; also said of one that was faster than this."""
    if helper is None:
        return
    report(compiling.STAGE, compiled, 0, compiling.NOTE)
    with suppress(TimeoutExpired):
        helper.wait(compiling.PATIENCE)
    report(compiling.STAGE, compiled, 0)


def compile_stage(
    stage: str,
    scene: Fields | str,
    changes: Fields | None,
    plugins: registry.InUse,
) -> None:
    """Compile the kernels of a stage of a scene, given as data, or by name with ``changes``, with these plugins."""
    registry.use_only(plugins)
    known = isinstance(scene, str)
    read = load_scene(scene, changes) if known else parse_scene(scene)
    read.warm_up(stage)
