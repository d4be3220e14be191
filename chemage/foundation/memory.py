"""The memory that this process may use, against which needs are held before anything is computed."""

from __future__ import annotations

import math
import os
import re
from functools import cache
from pathlib import Path

from chemage.foundation.errors import InputError

#: environment variable that overrides what the machine says, such as "64 GB"
VARIABLE = "CHEMAGE_MEMORY"
#: address space of Python with numba and scipy, bytes
LIBRARIES = 1.0e9
_UNITS = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}
_REMEDY = f"If this machine has more than chemage finds, set {VARIABLE}, such as {VARIABLE}='512 GB'"


def capacity() -> float:
    """Bytes that this process can have at most: of the machine, its control group and its limits; inf: not known.

    Raises
    ------
    InputError
        The environment variable ``CHEMAGE_MEMORY`` is set, but is no amount of memory.
    """
    if text := os.environ.get(VARIABLE, "").strip():
        match = re.fullmatch(
            r"(\d+(?:\.\d*)?(?:e\d+)?)\s*([kmgt]?)i?b?", text.lower()
        )
        if match is None:
            raise InputError.of(
                VARIABLE, text, "is no amount of memory", "write it as '64 GB'"
            )
        return float(match[1]) * _UNITS[match[2]]
    return min(_of_machine(), _of_group(), _of_process())


def require(size: float, what: str, remedy: str) -> None:
    """Refuse a need of ``size`` bytes that this machine cannot meet; ``what`` needs it, ``remedy`` helps.

    Raises
    ------
    InputError
        With both numbers.
    """
    if size > (there := capacity()):
        raise InputError(
            f"{what}: about {readable(size)} of memory needed, but there are {readable(there)}; {remedy}. {_REMEDY}"
        )


def require_address_space() -> None:
    """Refuse a limit of this process with which its libraries cannot be loaded: some end it without a word.

    Raises
    ------
    InputError
        The limit is below :data:`LIBRARIES`.
    """
    limit = _of_process()
    if limit < LIBRARIES:
        raise InputError(
            f"the address space of this process is limited to {readable(limit)}, and the libraries of chemage take "
            f"{readable(LIBRARIES)}; raise the limit (ulimit -v)"
        )


def readable(size: float) -> str:
    """Bytes as text, such as ``1.5 GB``."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.4g} TB"


def _of_machine() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # no such call on this system
        return math.inf


@cache
def _of_group() -> float:
    """The limit of the control group (version 2, else 1), as in containers and batch jobs, when first asked for."""
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        return math.inf
    limits: list[float] = []
    for line in lines:
        if line.count(":") < 2:
            continue
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root = Path("/sys/fs/cgroup/memory" if controllers else "/sys/fs/cgroup")
        name = "memory.limit_in_bytes" if controllers else "memory.max"
        group = root / path.lstrip("/")
        # a limit of any group above holds as well; in a container the path may not be visible
        for folder in (group, *group.parents):
            if root not in (folder, *folder.parents):
                break
            try:
                text = (folder / name).read_text().strip()
            except OSError:
                continue
            if text.isdigit():
                limits.append(float(text))
    return min(limits, default=math.inf)


def _of_process() -> float:
    try:
        import resource
    except ImportError:  # not on this system
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return float(limit) if limit not in (resource.RLIM_INFINITY, -1) else math.inf
