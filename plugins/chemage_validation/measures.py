"""What is computed for a row of rows.toml, and the number that is made of it.

An observation is a function of a run and gives (samples, k). Samples are groups of replicas of a tip, or surfaces. A
comparison makes one number of their mean (k,), and values (k,) of which it makes a given number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from chemage import Run
from chemage.plugin import KB

#: groups of the replicas of one contact, whose means are samples
GROUPS = 10
#: kJ/mol per eV
MOLAR = 96.485


def _groups(values: np.ndarray) -> np.ndarray:
    """Means of groups of replicas (replicas, k): (groups, k)."""
    parts = np.array_split(values, min(GROUPS, len(values)))
    return np.array([part.mean(axis=0) for part in parts])


def beta(run: Run) -> np.ndarray:
    """Slope of Δμ per decade over the hold times of the scene's fit."""
    assert run.ageing is not None
    return _groups(run.ageing.betas(run.window)[:, None])


def drop(run: Run) -> np.ndarray:
    """Δμ at all hold times."""
    assert run.ageing is not None
    return _groups(run.ageing.friction_coefficient_drop)


def _steady(run: Run) -> list[str]:
    """The names of the steady friction in every step with slip, in their order."""
    return [
        name
        for name, one in run.measured.items()
        if one.output is not None and one.output.rests == (name,)
    ]


def steady(run: Run) -> np.ndarray:
    """Steady friction in every step with slip, nN."""
    return _groups(
        np.transpose([run.measured[name].values for name in _steady(run)])
    )


def unsteady(run: Run) -> str:
    """What is wrong with the steady friction of a run; "" where nothing is."""
    every = [run.measured[name].quantity() for name in _steady(run)]
    return "; ".join(f"{one.label} {one.reason}" for one in every if one.reason)


def least_bonds(run: Run) -> np.ndarray:
    """Bonds just after the second load was set, and the least number under it."""
    assert run.ageing is not None
    first = int(run.ageing.observables["step_points"][0, 0])
    later = run.ageing.bonds[:, first:]
    return _groups(np.stack([later[:, 0], later.min(axis=1)], axis=1))


def activation(run: Run, warm: Run) -> np.ndarray:
    """Activation energy of the time in which a warmer contact reaches the friction of this one, kJ/mol."""
    assert run.ageing is not None
    assert warm.ageing is not None
    times = np.log(run.ageing.hold_times)
    middle = times[len(times) // 2]
    found = []
    for cold, hot in zip(drop(run), drop(warm), strict=True):
        same = np.interp(np.interp(middle, times, cold), hot, times)
        inverse = 1 / run.ageing.temperature - 1 / warm.ageing.temperature
        found.append([MOLAR * KB * (middle - same) / inverse])
    return np.array(found)


class Compared(NamedTuple):
    """How a number is made of values, and values of a number."""

    number: Callable[[np.ndarray], float]
    #: values with this number, like those given
    values: Callable[[float, np.ndarray], np.ndarray]


def _power(values: np.ndarray) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(values)
    if not np.isfinite(logs).all():
        return np.nan
    return float(np.polyfit(_steps(values), logs, 1)[0])


def _steps(values: np.ndarray) -> np.ndarray:
    """Logarithms of hold times at equal ratios, from the first to 18 times that: 5 to 90 ms."""
    return np.linspace(0, np.log(18), values.size)


def _bent(ratio: float, values: np.ndarray) -> np.ndarray:
    slopes = np.geomspace(1, ratio, values.size - 1)
    rise = (values[-1] - values[0]) * slopes / slopes.sum()
    return values[0] + np.concatenate([[0], rise.cumsum()])


COMPARISONS = {
    "value": Compared(lambda x: x[0], lambda c, x: np.full_like(x, c)),
    # of the last over the first
    "ratio": Compared(
        lambda x: x[-1] / x[0], lambda c, x: x[0] * np.array([1.0, c])
    ),
    # the exponent of the hold time, 5 to 90 ms
    "power": Compared(
        _power, lambda c, x: x[-1] * np.exp(c * (_steps(x) - np.log(18)))
    ),
    # slope against log t in the last decade over that in the first
    "bend": Compared(lambda x: (x[-1] - x[-2]) / (x[1] - x[0]), _bent),
}
