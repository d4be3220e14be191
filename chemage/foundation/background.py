"""Processes that do something useful in the background, of which nothing depends, and which end with this one."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from chemage.foundation.threads import environment

_BOOT = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from chemage.foundation.background import serve; serve()"
)

Process = subprocess.Popen[bytes]


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
    paths = [path or os.getcwd() for path in sys.path]
    with suppress(OSError):  # it has died
        process.stdin.write(pickle.dumps(paths) + pickle.dumps((function, args)))
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
    from importlib import import_module

    function, args = pickle.load(sys.stdin.buffer)

    def listen() -> None:
        sys.stdin.buffer.read()
        os._exit(0)

    threading.Thread(target=listen, daemon=True).start()
    module, _, name = function.partition(":")
    with suppress(Exception):
        getattr(import_module(module), name)(*args)
    os._exit(0)
