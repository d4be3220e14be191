"""Compilation of kernels: who is told of it, and the processes that share it.

Processes in the background do something useful of which nothing depends, and end with this one.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from chemage.foundation import machine
from chemage.foundation.aliases import Fields
from chemage.foundation.threads import available, environment

_BOOT = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from chemage.foundation.compiling import serve; serve()"
)

Process = subprocess.Popen[bytes]
#: the processes that compile the kernels of each stage
Helpers = dict[str, Process]
#: the stage of a run in which kernels are compiled, and what is said of it
STAGE, NOTE = (
    "compiling",
    "kernels, once per installation; all of them take about 20 s",
)
#: the stages whose kernels a process of its own compiles. Two also on two processors: the first has to be done when the
#: contact is solved, and the second one works towards this process from the last kernel of the contact, so that all end
#: at about the same time
STAGES = ("ageing", "contact")
#: longest time to wait for the process that compiles what is needed next, s
PATIENCE = 60.0


def begin(
    scene: str | Fields,
    changes: Fields | None,
    threads: int | None,
    plugins: Any,
) -> Helpers:
    """Start the processes that compile what a scene needs, given by name with ``changes``, or as data, with the
    ``plugins`` of this one; none with ``threads`` 1, or one processor."""
    if min(threads or available(), available()) < 2:
        return {}
    call = "chemage.scene.warm_up:compile_stage"
    started = {
        stage: start(call, stage, scene, changes, plugins) for stage in STAGES
    }
    return {
        stage: process for stage, process in started.items() if process is not None
    }


@contextmanager
def begun_early(
    scene: str, changes: Fields, threads: int | None, plugins: Any
) -> Iterator[Helpers]:
    """Begin to compile what a scene needs while this process still imports what it needs, where nothing is compiled
    yet; yields the processes, which end with the block."""
    helpers = begin(scene, changes, threads, plugins) if machine.is_cold() else {}
    try:
        yield helpers
    finally:
        end(helpers.values())


@contextmanager
def watched(
    begin: Callable[[int], None], end: Callable[[int], None]
) -> Iterator[list[str]]:
    """Call ``begin`` with the number of kernels compiled before, when one is compiled in this block, and ``end`` with
    that number and one when it is done.

    The block is given the kernels that were begun so far, ``module.function`` each. Those that numba keeps count, and
    neither what comes from the cache nor the functions that are compiled into them. ``begin`` and ``end`` may be called
    by any thread.
    """
    from numba.core import event

    compiled: list[str] = []

    class Listener(event.Listener):
        depth = (
            0  # numba compiles one kernel at a time, whatever thread asks for it
        )

        def on_start(self, event: Any) -> None:
            self.depth += 1
            if self.depth == 1 and _is_kept(event):
                begin(len(compiled))
                function = event.data["dispatcher"].py_func
                compiled.append(f"{function.__module__}.{function.__qualname__}")

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0 and _is_kept(event):
                end(len(compiled))

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield compiled
    finally:
        event.unregister("numba:compile", listener)


def _is_kept(event: Any) -> bool:
    """Whether the kernel is kept; else it is compiled again in every process, as its author chose."""
    return bool(
        getattr(
            getattr(event.data["dispatcher"], "_cache", None), "cache_path", None
        )
    )


# -- processes --------------------------------------------------------------------------------------------------------


def start(function: str, *args: Any) -> Process | None:
    """Start a process that calls ``function`` ("module:name") with ``args``; None where there can be none.

    The process has one thread and prints nothing; what the function raises is ignored.
    """
    if not sys.executable:
        return None
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", _BOOT],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **environment(1)},
            start_new_session=os.name == "posix",
        )
    except OSError:
        return None
    assert process.stdin is not None
    with suppress(OSError):  # it has died
        process.stdin.write(pickle.dumps(sys.path) + pickle.dumps((function, args)))
        process.stdin.flush()  # and left open: its end tells the process that this one has ended
    return process


def end(processes: Iterable[Process]) -> None:
    """End the processes, whatever they are doing."""
    for process in processes:
        process.kill()
        with suppress(OSError):
            process.communicate()


def serve() -> None:
    """Call the function that :func:`start` names; the main function of the process."""
    function, args = pickle.load(sys.stdin.buffer)

    def listen() -> None:
        sys.stdin.buffer.read()
        os._exit(0)

    threading.Thread(target=listen, daemon=True).start()
    module, _, name = function.partition(":")
    with suppress(Exception):
        getattr(import_module(module), name)(*args)
    os._exit(0)
