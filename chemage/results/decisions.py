"""How often a test of noisy numbers errs: its false alarm, its power against rivals, and the word that follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from chemage.foundation.text import plus_minus

#: an option was fitted to it; it holds under the reading of the paper that we prefer, and not under others
CALIBRATED, READ_AS = "calibrated", "read as"
PREDICTED, CANNOT, DISAGREES = "predicted", "cannot tell", "disagrees"
#: least power of a test that decides
POWER = 0.8
#: synthetic sets of curves by which both are counted
DRAWS = 200
#: surfaces below which their scatter is not known
FEWEST = 3


class Limits(NamedTuple):
    """A number that a test computes, and between which limits the claim holds."""

    name: str
    low: float = -np.inf
    high: float = np.inf
    percent: bool = False

    def shown(self, value: float, error: float) -> str:
        """The number with its standard error over surfaces and its limits, in words."""
        factor, unit = (100, " %") if self.percent else (1, "")
        ends = [
            f"{word} {factor * end:.3g}{unit}"
            for word, end in (("at least", self.low), ("at most", self.high))
            if np.isfinite(end)
        ]
        ours = plus_minus(factor * value, factor * error)
        return f"{self.name} {ours}{unit} ({', '.join(ends)})"


@dataclass(frozen=True)
class ClaimTest:
    """A test of n independent surfaces, whose scatter is the noise of the synthetic ones by which it is judged."""

    #: (n, ...), none negative
    values: np.ndarray
    #: mean over surfaces (...) -> the numbers of ``limits``
    statistics: Callable[[np.ndarray], Sequence[float]]
    #: numbers that say what is true -> values without noise (...)
    truth: Callable[[Sequence[float]], np.ndarray]
    #: relative standard errors (...) where replicas have them and there is one surface
    errors: np.ndarray | None = None
    #: name -> values (n, ...) as the paper could be read as well
    readings: Mapping[str, np.ndarray] = field(default_factory=dict)
    limits: Sequence[Limits] = ()
    #: numbers of the claim and of its rivals
    claimed: Sequence[float] = ()
    rivals: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def numbers(self, values: np.ndarray) -> Sequence[float]:
        """The numbers of ``limits`` of values (n, ...); nan, or infinite, where they cannot be computed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.statistics(values.mean(axis=0))

    def within(self, numbers: Sequence[float] | np.ndarray) -> bool:
        """Whether numbers are within the limits; what cannot be computed is not."""
        pairs = zip(self.limits, numbers, strict=True)
        return all(one.low <= x <= one.high for one, x in pairs)

    def accepts(self, values: np.ndarray) -> bool:
        """Whether values (n, ...) agree with the claim."""
        return self.within(self.numbers(values))

    @property
    def decidable(self) -> bool:
        """Whether the noise is known."""
        return self.errors is not None or len(self.values) >= FEWEST

    @cached_property
    def noise(self) -> np.ndarray:
        """Relative deviations of synthetic surfaces: drawn from those of ours, or from the errors of replicas."""
        rng = np.random.default_rng(1)
        if self.errors is not None:
            return self.errors * rng.standard_normal((DRAWS, *self.values.shape))
        count = len(self.values)
        middle = self.values.mean(axis=0)
        one = np.ones(self.values.shape)
        shares = np.divide(self.values, middle, out=one, where=middle > 0)
        # a sample deviates less from its own mean than from the true one
        away = (shares - 1) * np.sqrt(count / (count - 1))
        return away[rng.integers(count, size=(DRAWS, count))]

    def drawn(self, truth: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """The numbers of synthetic sets about values (...), (draws, k); ``scale`` multiplies the noise."""
        sets = (np.maximum(truth * (1 + scale * one), 0) for one in self.noise)
        return np.array([self.numbers(values) for values in sets])

    def refused(self, truth: np.ndarray, scale: float = 1.0) -> float:
        """Share of synthetic sets about values (...) that the test refuses."""
        return 1 - float(np.mean([*map(self.within, self.drawn(truth, scale))]))

    @cached_property
    def power(self) -> dict[str, float]:
        """How often each rival is refused."""
        return {
            name: self.refused(self.truth(numbers))
            for name, numbers in self.rivals.items()
        }

    @cached_property
    def false_alarm(self) -> float:
        """How often the claim itself is refused."""
        return self.refused(self.truth(self.claimed))

    @cached_property
    def support(self) -> float:
        """How often surfaces like ours agree with the claim."""
        return 1 - self.refused(self.values.mean(axis=0))

    @cached_property
    def remedy(self) -> str:
        """How many surfaces would make a test that decides."""
        said = self.truth(self.claimed)
        others = [self.truth(numbers) for numbers in self.rivals.values()]
        for factor in (2, 4, 8):
            power = min(self.refused(truth, 1 / factor) for truth in others)
            if power >= POWER and self.refused(said, 1 / factor) <= 1 - POWER:
                return f"{factor**2} times as many surfaces would tell"
        return "more surfaces would not tell"

    def word(self, *, calibrated: bool = False) -> str:
        """One of the five words, by rule."""
        if not self.decidable:
            return CANNOT
        if not self.accepts(self.values):
            sure = self.support <= 1 - POWER and self.false_alarm <= 1 - POWER
            return DISAGREES if sure else CANNOT
        rates = (*self.power.values(), self.support, 1 - self.false_alarm)
        if min(rates) < POWER:
            return CANNOT
        if calibrated:
            return CALIBRATED
        every = all(map(self.accepts, self.readings.values()))
        return PREDICTED if every else READ_AS

    def found(self) -> str:
        """The numbers of ours with their standard errors, and the readings that do not agree, in words."""
        ours = self.numbers(self.values)
        drawn = self.drawn(self.values.mean(axis=0)) if self.decidable else None
        errors = np.full(len(ours), np.nan) if drawn is None else drawn.std(axis=0)
        parts = [
            one.shown(value, error)
            for one, value, error in zip(self.limits, ours, errors, strict=True)
        ]
        for name, values in self.readings.items():
            shown = self.limits[0].shown(self.numbers(values)[0], np.nan)
            parts.append(f"{name}: {shown}")
        return "; ".join(parts)
