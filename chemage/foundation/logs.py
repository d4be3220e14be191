"""What a computation does, for the logger ``chemage`` of Python's ``logging``: each stage with its time.

Nothing is printed unless the program that uses chemage asks for it, as ``chemage -v`` and ``chemage --log FILE`` do:
``logging.basicConfig(level="INFO")`` is enough.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LOGGER = logging.getLogger("chemage")
LOGGER.addHandler(logging.NullHandler())  # Python itself prints errors of a logger without a handler


@contextmanager
def logged(stage: str, what: str = "begins") -> Iterator[Callable[[str], None]]:
    """Log the begin of a block as that of ``stage``, and its end with wall and CPU time.

    The block receives a function that adds words about its outcome to the last line.
    """
    LOGGER.info("%s: %s", stage, what)
    outcome: list[str] = []
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        yield outcome.append
    except BaseException as error:
        LOGGER.info("%s: ended by %s after %.2f s", stage, type(error).__name__, time.perf_counter() - wall)
        raise
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    LOGGER.info("%s: done in %.2f s (%.2f s of CPU time)%s", stage, wall, cpu, "".join(f"; {one}" for one in outcome))


def counted(stage: str, unit: str, progress: Callable[[int, int], None] | None) -> Callable[[int, int], None]:
    """A function to report (done, total) with: it logs them, and passes them on to ``progress``."""

    def report(done: int, total: int) -> None:
        LOGGER.info("%s: %s %d/%d", stage, unit, done, total)
        if progress is not None:
            progress(done, total)

    return report


def of_plugins(plugins: dict[str, str]) -> str:
    """Which plugins took part, in words."""
    return "plugins: " + (", ".join(f"{name} ({source})" for name, source in plugins.items()) or "none")
