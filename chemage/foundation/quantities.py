"""Quantities and curves: the only forms in which a number leaves a computation.

Each declares once its name, unit, words and symbol; text, tables, JSON, CSV, axes and comparisons are made from that.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import partial
from typing import Any, Literal, NamedTuple, Self, TypeVar

import numpy as np

from chemage.foundation.statistics import (
    NORMAL_LIMIT,
    half_width,
    standard_error,
)
from chemage.foundation.text import percent, plus_minus, with_error, with_interval

#: the unit of a pure number
ONE = "1"
#: a value that is farther from the middle of its interval, over its width, is printed with both ends
UNEVEN = 0.01
#: what stands for a number that is not known
NONE = "-"
_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class Rank(IntEnum):
    """Who looks for a number."""

    #: everybody: large on a page, first in a table
    FIRST = 0
    #: who reads the table of a result
    TABLE = 1
    #: who asks for all of it
    REST = 2


def unit_text(unit: str) -> str:
    """A unit as it is printed: ``nm²`` for ``nm2`` or ``nm**2``, nothing for a pure number."""
    if unit == ONE:
        return ""
    plain = unit.replace("**", "").replace("^", "").replace("angstrom", "Å")
    plain = re.sub(r"\bum", "µm", plain)
    return re.sub(
        r"(?<=[^\W\d_])\d+", lambda power: power[0].translate(_SUPERSCRIPTS), plain
    )


def headed(text: str, unit: str) -> str:
    """The heading of a column, or the label of an axis: ``text (unit)``."""
    return text if unit in ("", ONE) else f"{text} ({unit_text(unit)})"


def _joined(*words: str) -> str:
    return " ".join(filter(None, words))


class ErrorPart(NamedTuple):
    """A part of the error of a number."""

    #: standard error, in the unit of the number; nan where it is not known
    size: float
    #: how it is known, in words
    how: str


@dataclass(frozen=True)
class Declared:
    """What a quantity or a curve is."""

    #: in files, JSON and the options of commands
    name: str
    #: of the values; ``"1"`` for a pure number
    unit: str
    #: in words, without unit
    label: str
    symbol: str = ""
    #: a sentence for files, where the label does not say it all
    meaning: str = ""
    rank: Rank = Rank.TABLE

    def __post_init__(self) -> None:
        if not self.unit or not self.label:
            raise ValueError(
                f'{self.name}: give its unit ("1" for a pure number) and what it is, in words'
            )

    @property
    def title(self) -> str:
        """Words and symbol, for rows and axes."""
        return _joined(self.label, self.symbol)

    @property
    def axis(self) -> str:
        """The label of an axis."""
        return headed(self.title, self.unit)

    def but(self, **changes: Any) -> Self:
        """The same with other fields."""
        return replace(self, **changes)


#: a part of an error, over the largest one, that a table leaves out: it changes the interval by less than 0.5 %
NEGLIGIBLE = 0.1
#: how the error of a number is stated: not at all, by half the width of a 95 % interval, or by both its ends
Stated = Literal["", "half_width", "ends"]
_OF_ERRORS = {
    "stderr": "standard error of {}",
    "half_width": "half the width of the {level} % interval of {}",
    "low": "lower end of the {level} % interval of {}",
    "high": "upper end of the {level} % interval of {}",
}
_COLUMNS = {
    "": (),
    "half_width": ("stderr", "half_width"),
    "ends": ("stderr", "low", "high"),
}


@dataclass(frozen=True)
class Quantity(Declared):
    """A number, with its interval where it has one."""

    value: float = math.nan
    stated: Stated = ""
    stderr: float = math.nan
    half_width: float = math.nan
    low: float = math.nan
    high: float = math.nan
    #: of the interval, per cent
    level: int = 95
    #: what it is of: ``at 1000 s``, ``per decade``
    of: str = ""
    #: why there is no value, or no interval; or what else to know of it
    reason: str = ""
    #: parts of its standard error: what each is due to -> its size
    errors: Mapping[str, ErrorPart] = field(default_factory=dict)

    @property
    def relative(self) -> float:
        """Half the width of the interval over the magnitude of the value."""
        return self.half_width / abs(self.value) if self.value else math.nan

    def parts(self) -> list[tuple[str, str, str]]:
        """The parts of its error that count: what each is due to, its size, relative but of 0, and how it is known."""
        parts = []
        sizes = [part.size for part in self.errors.values()]
        for cause, part in self.errors.items():
            if part.size < NEGLIGIBLE * max(sizes):
                continue
            size = _joined(number_text(part.size), unit_text(self.unit))
            if self.value:
                share = part.size / abs(self.value)
                size = percent(share) if math.isfinite(share) else "not known"
            parts.append((cause, size, part.how))
        return parts

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return math.isfinite(self.value)

    def between(self, half: float, stderr: float = math.nan, **more: Any) -> Self:
        """The same with an interval of this half width about the value."""
        ends = {"low": self.value - half, "high": self.value + half}
        return self.but(
            stated="half_width", stderr=stderr, half_width=half, **ends, **more
        )

    def within(
        self, low: float, high: float, stderr: float = math.nan, **more: Any
    ) -> Self:
        """The same with an interval between these ends."""
        return self.but(
            stderr=stderr, half_width=0.5 * (high - low), low=low, high=high, **more
        )

    def of_replicas(self, values: np.ndarray) -> Self:
        """The same with the mean of independent ``values`` and Student's interval; one value has none."""
        mean = self.but(value=float(np.mean(values)))
        return mean.between(
            float(half_width(values)), float(standard_error(values))
        )

    def row(self) -> tuple[str, str]:
        """Its line in a table: what it is, and its value with error and unit."""
        place = self.of if self.of.startswith("at ") else ""
        return f"{self.title} {place}".strip(), self.text()

    def text(self) -> str:
        """The value with its interval and unit, or why there is none."""
        if not self.known:
            return self.reason or NONE
        about = "" if self.of.startswith("at ") else self.of
        reason = self.reason and f"({self.reason})"
        return _joined(self.bare(), unit_text(self.unit), about, reason)

    def bare(self) -> str:
        """The value with its interval, without unit."""
        beside_middle = abs(self.low + self.high - 2 * self.value) > UNEVEN * (
            self.high - self.low
        )
        if math.isfinite(self.low) and beside_middle:
            return with_interval(self.value, self.low, self.high)
        if self.stated:
            return plus_minus(self.value, self.half_width)
        return number_text(self.value)

    def bare_or_none(self) -> str:
        """For the cell of a column that states the unit."""
        return self.bare() if self.known else NONE

    def short(self) -> str:
        """Symbol, and value with its error in brackets, for legends: ``β = 0.466(12)``."""
        value = with_error(self.value, self.half_width)
        return (
            f"{self.symbol or self.label} = {_joined(value, unit_text(self.unit))}"
        )

    def todict(self) -> dict[str, Any]:
        """For JSON: value, unit and the ends of its interval, nan where they are not known; ``level`` where that is
        no interval of 95 %, and ``reason``, what else is to be said of the value."""
        number = {
            name: getattr(self, name) for name in ("value", "unit", "low", "high")
        }
        number |= {"reason": self.reason} if self.reason else {}
        return number | ({"level": self.level} if self.level != 95 else {})

    def columns(self) -> list[tuple[str, str, str]]:
        """The columns that it takes in a table: (name, unit, meaning)."""
        words = self.meaning or self.label
        columns = [(self.name, self.unit, words)]
        for part in _COLUMNS[self.stated]:
            meaning = _OF_ERRORS[part].format(self.label, level=self.level)
            columns.append((f"{self.name}_{part}", self.unit, meaning))
        return columns

    def numbers(self) -> dict[str, float]:
        """Its numbers by the names of :meth:`columns`."""
        return {self.name: self.value} | {
            f"{self.name}_{part}": getattr(self, part)
            for part in _COLUMNS[self.stated]
        }


#: as plugins of before call it
Estimate = Quantity

_no_numbers = partial(np.zeros, 0)
#: the axis along which contacts age
HOLD_TIME = Declared("hold_time", "s", "hold time")


@dataclass(frozen=True, eq=False)
class Curve(Declared):
    """Numbers along an axis, with 95 % intervals where they have some; or a distribution, between the edges ``x``."""

    x: np.ndarray = field(default_factory=_no_numbers)
    mean: np.ndarray = field(default_factory=_no_numbers)
    #: (m,) each; empty: not known
    stderr: np.ndarray = field(default_factory=_no_numbers)
    half_width: np.ndarray = field(default_factory=_no_numbers)
    #: parts of the standard error: what each is due to -> (m,)
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: (n, m) each: independent samples whose means add up to ``mean``
    samples: Sequence[np.ndarray] = ()
    #: (m,) standard error that the samples do not contain, shared by all points; empty: none
    known: np.ndarray = field(default_factory=_no_numbers)
    axis_of: Declared = HOLD_TIME
    #: what the points are, for legends: ``mean of 10 replicas, 95 %``
    over: str = ""
    #: whether the interval is drawn as a band, as those of means over surfaces are
    band: bool = False
    #: whether it is drawn on the page of its result alone
    alone: bool = True

    @property
    def is_distribution(self) -> bool:
        """Whether ``x`` are edges."""
        return self.x.size == self.mean.size + 1

    @property
    def shared(self) -> np.ndarray:
        """(m,) standard error that all points share: the one known beside the samples; without samples that of the
        interval."""
        if self.known.size:
            return self.known
        alone = self.half_width.size and not len(self.samples)
        return self.half_width / NORMAL_LIMIT if alone else np.zeros(self.x.size)

    def of_replicas(
        self, x: np.ndarray, values: np.ndarray, over: str = ""
    ) -> Self:
        """The same with the means of (replicas, m) ``values`` at ``x``."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.but(
                x=x,
                mean=values.mean(axis=0),
                stderr=standard_error(values),
                half_width=half_width(values),
                samples=(values,) if len(values) > 1 else (),
                over=over,
            )

    def at(self, x: float) -> Quantity:
        """The number at ``x``, interpolated linearly in log x; the interval is at most too wide there. Not known
        outside the points."""
        number = self.number()
        where = f"at {x:g} {self.axis_of.unit}"
        same = np.flatnonzero(np.abs(self.x - x) <= 1e-6 * x)
        if same.size:
            low = high = int(same[-1])
            part = 0.0
        else:
            high = int(np.searchsorted(self.x, x))
            low = high - 1
            if not 0 < high < self.x.size or self.x[low] <= 0:
                return number.but(of=where)
            part = math.log(x / self.x[low]) / math.log(self.x[high] / self.x[low])

        def between(values: np.ndarray) -> float:
            return (
                float(values[low] * (1 - part) + values[high] * part)
                if values.size
                else math.nan
            )

        return number.but(value=between(self.mean), of=where).between(
            between(self.half_width), between(self.stderr)
        )

    def last(self) -> Quantity:
        """The number at the last point."""
        return self.at(float(self.x[-1]))

    def todict(self) -> dict[str, Any]:
        """For JSON, as :meth:`Quantity.todict`: lists, with None for ends that are not known."""
        ends = (
            (self.mean - self.half_width, self.mean + self.half_width)
            if self.half_width.size
            else (None, None)
        )
        return {
            "value": self.mean,
            "unit": self.unit,
            "low": ends[0],
            "high": ends[1],
        }

    def columns(self) -> list[tuple[str, str, str]]:
        """As :meth:`Quantity.columns`."""
        return self.number().columns()

    def numbers(self) -> dict[str, np.ndarray]:
        """Its arrays by the names of :meth:`columns`."""
        numbers = {
            self.name: self.mean,
            f"{self.name}_stderr": self.stderr,
            f"{self.name}_half_width": self.half_width,
        }
        return numbers | {
            f"{self.name}.{cause}": part for cause, part in self.errors.items()
        }

    def number(self) -> Quantity:
        """What it is at one point, without a value."""
        return Quantity(
            self.name,
            self.unit,
            self.label,
            self.symbol,
            self.meaning,
            self.rank,
            stated="half_width",
        )


D = TypeVar("D", bound=Declared)


def by_name(declared: Iterable[D]) -> dict[str, D]:
    """Quantities or curves by their names."""
    return {one.name: one for one in declared}


def number_text(value: float) -> str:
    """A number without error, to four digits; whole numbers as they are."""
    whole = isinstance(value, int | np.integer) or (
        abs(value) < 1e6 and float(value).is_integer()
    )
    return f"{value:.0f}" if whole else f"{float(f'{value:.4g}'):g}"
