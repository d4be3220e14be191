"""Claims of shape against their rivals: a logarithm of time against a power and a stretched exponential, and a line in
the load against powers.

Each law is fitted to the increments between hold times, whose errors come from the scatter of independent curves
(surfaces, or replicas): increments of counts are nearly independent of each other, values of a curve are not. Laws are
compared by Akaike's information criterion for few values (Hurvich & Tsai, Biometrika 76, 297 (1989)).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from chemage.plugin import statistics

#: laws whose criteria differ by no more explain the data equally well (Burnham & Anderson, Model Selection, 2002)
EQUAL = 2.0
#: rise of the logarithm of a power over all times below which its exponent is not determined: it runs to 0
DEGENERATE = 0.01


class ScalingLaw(NamedTuple):
    """A law of growth fitted to a mean curve."""

    name: str
    #: fitted numbers, such as the exponent of a power; none where that runs to 0, where the power is the logarithm
    parameters: tuple[float, ...]
    #: χ² of the increments, and the criterion
    chi_squared: float
    criterion: float

    @classmethod
    def of(
        cls,
        name: str,
        parameters: Sequence[float] | np.ndarray,
        chi: float,
        count: int,
        numbers: int,
    ) -> ScalingLaw:
        """A law with ``numbers`` fitted numbers and ``chi`` = χ² of ``count`` values."""
        correction = 2.0 * numbers * (numbers + 1) / max(count - numbers - 1, 1)
        return cls(
            name,
            tuple(float(value) for value in parameters),
            chi,
            chi + 2.0 * numbers + correction,
        )


class LawComparison(NamedTuple):
    """Laws of growth with time, the one with the least criterion first."""

    laws: tuple[ScalingLaw, ...]
    #: local slope per decade in the first and the last decade, and standard errors
    first: tuple[float, float]
    last: tuple[float, float]

    def criterion(self, name: str) -> float:
        """Criterion of a law over the least of all."""
        return (
            next(law.criterion for law in self.laws if law.name == name)
            - self.laws[0].criterion
        )

    @property
    def change(self) -> tuple[float, float]:
        """Change of the local slope from the first to the last decade over the first, and its standard error."""
        ratio = self.last[0] / self.first[0]
        error = abs(ratio) * math.hypot(
            self.first[1] / self.first[0], self.last[1] / (self.last[0] or math.nan)
        )
        return ratio - 1, error

    def holds(self, name: str) -> bool:
        """Whether no rival explains the increments better; one with the law as its limit may explain them as well."""
        return self.criterion(name) <= EQUAL


def growth(
    times: np.ndarray, curves: np.ndarray, window: tuple[float, float]
) -> LawComparison:
    """Compare the laws by which curves grow with hold time.

    Parameters
    ----------
    times
        (m,) s.
    curves
        (n, m) independent curves of one kind, n of at least 3.
    window
        First and last hold time, s; two decades at least.
    """
    inside = (times >= window[0] * 0.999) & (times <= window[1] * 1.001)
    x, y = times[inside], curves[:, inside]
    # a factor of all of a curve, such as the area of a contact, is no error of its shape
    y = y / (y[:, -1:] - y[:, :1])
    increments = np.diff(y, axis=1)
    scale = increments.mean()
    middle = increments.mean(axis=0) / scale
    # the scatter of single increments is known badly from few curves: pooled over the window, as a smooth function of t
    spread = statistics.standard_error(increments) / abs(scale)
    error = np.exp(
        np.polynomial.Polynomial.fit(
            np.log(x[1:]), np.log(np.maximum(spread, 1e-12)), 1
        )(np.log(x[1:]))
    )
    total, ratio = middle.sum(), x / x[0]
    laws = {
        law.name: law
        for law in _fitted(
            {
                "logarithm": (lambda p: np.diff(p[0] * np.log10(x)), [[total]]),
                "power": (
                    lambda p: np.diff(p[0] * ratio ** p[1]),
                    [[3 * total, 0.1], [total, 0.4]],
                ),
                "stretched exponential": (
                    lambda p: np.diff(-p[0] * np.exp(-((x / 10.0 ** p[1]) ** p[2]))),
                    [[total, 3.0, 0.2], [total, 5.0, 0.5], [3 * total, 6.0, 0.1]],
                ),
            },
            middle,
            error,
        )
    }
    if abs(laws["power"].parameters[1]) * math.log(x[-1] / x[0]) < DEGENERATE:
        laws["power"] = ScalingLaw.of(
            "power", (), laws["logarithm"].chi_squared, middle.size, 2
        )
    decades = np.log10(x)
    return LawComparison(
        tuple(sorted(laws.values(), key=lambda law: law.criterion)),
        _slope(y, decades <= decades[0] + 1.001, decades),
        _slope(y, decades >= decades[-1] - 1.001, decades),
    )


def _slope(
    y: np.ndarray, inside: np.ndarray, decades: np.ndarray
) -> tuple[float, float]:
    slopes = np.polyfit(decades[inside], y[:, inside].T, 1)[0]
    return float(slopes.mean()), float(statistics.standard_error(slopes))


#: name -> values of a law by its parameters, and first guesses
_Laws = dict[str, tuple[Callable[[np.ndarray], np.ndarray], list[list[float]]]]


def _fitted(laws: _Laws, y: np.ndarray, error: np.ndarray) -> tuple[ScalingLaw, ...]:
    """Fit laws to values with standard errors, the one with the least criterion first."""
    fitted = []
    for name, (law, starts) in laws.items():

        def rest(
            parameters: np.ndarray, law: Callable[[np.ndarray], np.ndarray] = law
        ) -> np.ndarray:
            with np.errstate(over="ignore", under="ignore"):
                return np.nan_to_num(
                    (law(parameters) - y) / error, nan=1e6, posinf=1e6, neginf=-1e6
                )

        fits = [
            least_squares(rest, start, x_scale="jac", max_nfev=2000) for start in starts
        ]
        best = min(fits, key=lambda fit: fit.cost)
        fitted.append(
            ScalingLaw.of(name, best.x, 2.0 * float(best.cost), y.size, best.x.size)
        )
    return tuple(sorted(fitted, key=lambda law: law.criterion))


def of_load(
    load: np.ndarray, y: np.ndarray, error: np.ndarray, area: float = 2 / 3
) -> tuple[ScalingLaw, ...]:
    """Compare a line with an offset with powers of the load, the law with the least criterion first.

    Parameters
    ----------
    load, y, error
        (m,) loads, and values with their standard errors, in one unit.
    area
        Exponent of the contact area of a tip: Hertz.
    """
    start = float(y[-1] / load[-1])
    laws: _Laws = {
        "line": (lambda p: p[0] + p[1] * load, [[0.0, start]]),
        "power": (lambda p: p[0] * load ** p[1], [[start, 1.0]]),
        "area": (lambda p: p[0] * load**area, [[start]]),
    }
    return _fitted(laws, y, error)


class Exponent(NamedTuple):
    """The exponent of a power law, with the 95 % interval from the scatter of independent curves."""

    value: float
    half_width: float

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray) -> Exponent:
        """That n of y ∝ xⁿ from curves y (k, m) of k independent surfaces at x (m,) or (k, m); one has no error."""
        x = np.broadcast_to(x, y.shape)
        slopes = np.array(
            [np.polyfit(np.log(a), np.log(b), 1)[0] for a, b in zip(x, y, strict=True)]
        )
        half = statistics.student_limit(len(slopes) - 1) * statistics.standard_error(
            slopes
        )
        return cls(float(slopes.mean()), float(half))

    def within(self, claim: float, distance: float) -> bool:
        """Whether all of the interval is at most ``distance`` from the claim: close, even if not equal to it.

        The exponent of a single curve has no interval.
        """
        return bool(
            abs(self.value - claim) + np.nan_to_num(self.half_width) <= distance
        )

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.half_width:.3f}"


def first_reaching(
    times: np.ndarray, values: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """Hold time at which ``values`` (..., m) first reach ``level`` (...), or the first one."""
    return _between(
        times, values, np.argmax(values >= level[..., None], axis=-1), level
    )


def last_positive(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Hold time after which ``values`` (..., m) are not positive again; the first or the last one if there is none."""
    positive = values > 0
    after = np.where(
        positive.any(axis=-1), times.size - np.argmax(positive[..., ::-1], axis=-1), 1
    )
    return _between(
        times, values, np.minimum(after, times.size - 1), np.zeros(values.shape[:-1])
    )


def _between(
    times: np.ndarray, values: np.ndarray, at: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """The time between those at − 1 and at where ``values`` (..., m), linear in its logarithm, have ``level``."""
    before, decades = np.maximum(at - 1, 0), np.log10(times)
    first, last = (
        np.take_along_axis(values, place[..., None], -1)[..., 0]
        for place in (before, at)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.clip((level - first) / (last - first), 0, 1))
    return 10 ** (decades[before] + share * (decades[at] - decades[before]))
