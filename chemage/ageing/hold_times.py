"""Hold times, evenly spaced in log t."""

from __future__ import annotations

import math

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.units import convert


def hold_times(start: float | str, stop: float | str, per_decade: int = 4) -> np.ndarray:
    """Hold times from ``start`` to ``stop`` (s, both included), ``per_decade`` to a decade, evenly in log t.

    Times are whole multiples of 1/``per_decade`` decades above ``start``; ``stop`` is added if it is not one of them.
    """
    low, high = convert(start, "s"), convert(stop, "s")
    if not (math.isfinite(low) and low > 0):
        raise InputError.of(
            "start", start, "must be above zero", "hold times are spaced in log t; start at 1 ms, for example"
        )
    if not (math.isfinite(high) and high >= low):
        raise InputError.of("stop", stop, f"must be finite and not before start ({low:g} s)")
    if per_decade < 1:
        raise InputError.of("per_decade", per_decade, "must be at least 1")
    decades = math.log10(high / low)
    count = math.floor(decades * per_decade + 1e-9)
    times = low * 10.0 ** (np.arange(count + 1) / per_decade)
    # 0.001 * 10**(4/4) is 0.01, not 0.010000000000000002
    times = np.array([float(f"{t:.12g}") for t in times])
    if high > times[-1] * (1 + 1e-9):
        times = np.append(times, high)
    times[-1] = high
    return times
