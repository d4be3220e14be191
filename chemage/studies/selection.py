"""What one of several processes computes: the third of sixteen shares, or points by their numbers."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from chemage.foundation.errors import InputError

#: largest number of shares
MANY_SHARES = 1_000_000
_FORM = "write the third of 16 shares as 3/16, points by their numbers as 3,7,12-20, or in a job array auto or auto/16"
_SHARE = re.compile(r"(\d{1,9})/(\d{1,9})")
_NUMBERS = re.compile(r"\d{1,12}(-\d{1,12})?(,\d{1,12}(-\d{1,12})?)*")
#: the number of a task in a job array, by scheduler; first, last and step where the scheduler gives them
_ARRAYS = {
    "SLURM": ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_STEP"),
    "PBS": ("PBS_ARRAY_INDEX",),
    "Torque": ("PBS_ARRAYID",),
    "Grid Engine": ("SGE_TASK_ID", "SGE_TASK_FIRST", "SGE_TASK_LAST", "SGE_TASK_STEPSIZE"),
    "LSF": ("LSB_JOBINDEX",),
}


@dataclass(frozen=True)
class Selection:
    """The points that one process computes: one of several shares, or points by their numbers."""

    #: share and number of shares, the first is 1; None for numbers
    share: tuple[int, int] | None = None
    #: first and last number of each range, the first point is 0
    ranges: tuple[tuple[int, int], ...] = ()

    @classmethod
    def read(cls, text: str, environment: Mapping[str, str] | None = None) -> Selection:
        """Read ``3/16``, ``3,7,12-20``, ``auto`` or ``auto/16``.

        ``auto`` is the share that belongs to this task of a job array, by the variables of
        ``environment`` (default: that of this process).

        Raises
        ------
        InputError
            It is none of these, or the environment does not say which share it is.
        """
        compact = text.replace(" ", "")
        if compact == "auto" or compact.startswith("auto/"):
            compact = _share_of_array(text, compact, os.environ if environment is None else environment)
        if match := _SHARE.fullmatch(compact):
            number, count = int(match[1]), int(match[2])
            if not 1 <= number <= count <= MANY_SHARES:
                raise InputError.of(
                    "points", text, f"there is no share {number} of {count}; shares count from 1", _FORM
                )
            return cls(share=(number, count))
        if not _NUMBERS.fullmatch(compact):
            raise InputError.of("points", text, "not understood", _FORM)
        ranges = []
        for part in compact.split(","):
            first, _, last = part.partition("-")
            ranges.append((int(first), int(last or first)))
            if ranges[-1][0] > ranges[-1][1]:
                raise InputError.of("points", text, f"{part} ends before it begins", _FORM)
        return cls(ranges=tuple(ranges))

    def __str__(self) -> str:
        if self.share is not None:
            return f"{self.share[0]}/{self.share[1]}"
        return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in self.ranges)

    def describe(self) -> str:
        """What is computed, in words."""
        if self.share is not None:
            return f"share {self.share[0]} of {self.share[1]}"
        return f"points {self}"


def _share_of_array(text: str, compact: str, environment: Mapping[str, str]) -> str:
    arrays = {
        name: variables for name, variables in _ARRAYS.items() if _number(environment.get(variables[0])) is not None
    }
    if not arrays:
        every = ", ".join(variables[0] for variables in _ARRAYS.values())
        raise InputError.of("points", text, f"this is no task of a job array: none of {every} is set", _FORM)
    if len(arrays) > 1:
        names = " and ".join(variables[0] for variables in arrays.values())
        raise InputError.of("points", text, f"{names} are both set; {_FORM}")
    ((scheduler, variables),) = arrays.items()
    at = _number(environment[variables[0]])
    option = f"--points ${variables[0]}/16"
    assert at is not None
    if compact != "auto":
        count = _number(compact.removeprefix("auto/"))
        if count is None:
            raise InputError.of("points", text, "not understood", _FORM)
        if not 1 <= at <= count:
            raise InputError.of(
                "points",
                text,
                f"{variables[0]} is {at}, which is no share of {count}; number the tasks from 1 to {count}",
            )
        return f"{at}/{count}"
    first, last, step = [*(_number(environment.get(name)) for name in variables[1:]), None, None, None][:3]
    if first is None or last is None:
        raise InputError.of(
            "points",
            text,
            f"{scheduler} does not say how many tasks the array has; give the number: auto/16, or {option}",
        )
    step = step or 1
    count = (last - first) // step + 1
    told = _number(environment.get("SLURM_ARRAY_TASK_COUNT")) if scheduler == "SLURM" else count
    if told not in (None, count) or (at - first) % step or not first <= at <= last:
        raise InputError.of(
            "points",
            text,
            f"the numbers of the array's tasks are no range, so that shares are not clear; give {option}",
        )
    return f"{(at - first) // step + 1}/{count}"


def _number(text: str | None) -> int | None:
    return int(text) if text is not None and re.fullmatch(r"\d{1,9}", text) else None


def in_ranges(numbers: Iterable[int]) -> str:
    """Whole numbers as text, such as ``3,7,12-20``."""
    ranges: list[list[int]] = []
    for number in sorted(set(numbers)):
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)
