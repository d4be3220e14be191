"""Compilation of kernels: who is told of it, where they are kept, and the processes that share it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation import background, kernel_cache
from chemage.foundation.threads import available

#: the processes that compile the kernels of each stage
Helpers = dict[str, background.Process]
#: the stage of a run in which kernels are compiled, and what is said of it
STAGE, NOTE = "compiling", "kernels, once per installation; all of them take about 20 s"


#: the stages whose kernels a process of its own compiles. Two also on two processors: the first has to be done when the
#: contact is solved, and the second one works towards this process from the last kernel of the contact, so that all end
#: at about the same time
STAGES = ("ageing", "contact")
#: longest time to wait for the process that compiles what is needed next, s
PATIENCE = 60.0


def begin(scene: str | Mapping[str, Any], changes: Mapping[str, Any] | None, threads: int | None) -> Helpers:
    """Start the processes that compile what a scene needs, given by name with ``changes``, or as data; none with
    ``threads`` 1, or one processor."""
    if min(threads or available(), available()) < 2:
        return {}
    call = "chemage.scene.warm_up:compile_stage"
    started = {stage: background.start(call, stage, scene, changes) for stage in STAGES}
    return {stage: process for stage, process in started.items() if process is not None}


@contextmanager
def begun_early(scene: str, changes: Mapping[str, Any], threads: int | None) -> Iterator[Helpers]:
    """Begin to compile what a scene needs while this process still imports what it needs, where nothing is compiled
    yet; yields the processes, which end with the block."""
    helpers = begin(scene, changes, threads) if kernel_cache.empty() else {}
    try:
        yield helpers
    finally:
        background.end(helpers.values())


@dataclass
class Compiled:
    """The kernels that were compiled so far; those that come from the cache do not count."""

    #: ``module.function`` of each, in the order in which they were begun
    kernels: list[str] = field(default_factory=list)
    #: where they are kept
    folders: set[str] = field(default_factory=set)


@contextmanager
def watched(begin: Callable[[int], None], end: Callable[[int], None]) -> Iterator[Compiled]:
    """Call ``begin`` with the number of kernels compiled before, when one is compiled in this block, and ``end`` with
    that number and one when it is done.

    Kernels that numba keeps count, and not the functions that are compiled into them. Either may be called by any
    thread.
    """
    from numba.core import event

    compiled = Compiled()

    class Listener(event.Listener):
        depth = 0  # numba compiles one kernel at a time, whatever thread asks for it

        def on_start(self, event: Any) -> None:
            self.depth += 1
            if self.depth == 1 and (folder := _folder(event)):
                begin(len(compiled.kernels))
                function = event.data["dispatcher"].py_func
                compiled.kernels.append(f"{function.__module__}.{function.__qualname__}")
                compiled.folders.add(folder)

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0 and _folder(event):
                end(len(compiled.kernels))

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield compiled
    finally:
        event.unregister("numba:compile", listener)


def _folder(event: Any) -> str:
    """Where the kernel is kept, "" where it is not: compiled again in every process, as its author chose."""
    return str(getattr(getattr(event.data["dispatcher"], "_cache", None), "cache_path", None) or "")
