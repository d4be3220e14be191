"""Hold times: evenly spaced in log t, and those that lie in a window."""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.checks import checked_count
from chemage.foundation.errors import InputError
from chemage.foundation.units import LARGEST, SMALLEST, QuantityLike, convert

#: more hold times to a decade than any curve needs
MOST_PER_DECADE = 1000


def hold_times(start: QuantityLike, stop: QuantityLike, per_decade: int = 4) -> np.ndarray:
    """Hold times from ``start`` to ``stop`` (s, both included), ``per_decade`` to a decade, evenly in log t.

    Times are whole multiples of 1/``per_decade`` decades above ``start``; ``stop`` is added if it is not one of them.
    """
    low, high = convert(start, "s", "start"), convert(stop, "s", "stop")
    for name, written, value in (("start", start, low), ("stop", stop, high)):
        if math.isfinite(value) and value != 0 and not SMALLEST <= abs(value) <= LARGEST:
            raise InputError.of(name, written, "is out of range", f"give from {SMALLEST:g} to {LARGEST:g} s")
    if not (math.isfinite(low) and low > 0):
        raise InputError.of(
            "start", start, "must be above zero", "hold times are spaced in log t; start at 1 ms, for example"
        )
    if not (math.isfinite(high) and high >= low):
        raise InputError.of("stop", stop, f"must be finite and not before start ({low:g} s)")
    if checked_count("per_decade", per_decade) > MOST_PER_DECADE:
        raise InputError.of("per_decade", per_decade, f"must be at most {MOST_PER_DECADE}")
    decades = math.log10(high / low)
    count = math.floor(decades * per_decade + 1e-9)
    times = low * 10.0 ** (np.arange(count + 1) / per_decade)
    # 0.001 * 10**(4/4) is 0.01, not 0.010000000000000002
    times = np.array([float(f"{t:.12g}") for t in times])
    if high > times[-1] * (1 + 1e-9):
        times = np.append(times, high)
    times[-1] = high
    return times


def within(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """(m,) bool: which ``times`` (m,) lie in a window, s; one given as 10.000000000000002 belongs to that from 10."""
    return (times >= window[0] * (1 - 1e-9)) & (times <= window[1] * (1 + 1e-9))
