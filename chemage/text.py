"""Numbers as text, to the digits their errors bear."""

from __future__ import annotations

import math


def plus_minus(value: float, error: float, unit: str = "") -> str:
    """A value with its standard error, both to the error's second digit; ``unit`` may be empty."""
    if not math.isfinite(value):
        return f"{value:g} {unit}".strip()
    if not (math.isfinite(error) and error > 0):
        return f"{value:.4g} {unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{digits}f} ± {error:.{digits}f} {unit}".strip()


def with_interval(value: float, low: float, high: float) -> str:
    """``value [low, high]`` to the digits the interval bears."""
    width = high - low
    if not math.isfinite(value):
        return "undetermined"
    if not math.isfinite(width) or width <= 0:
        return f"{value:.4g} [{low:.3g}, {high:.3g}]"
    if max(abs(low), abs(high), abs(value)) >= 1e4 or width < 1e-4:
        return f"{value:.3g} [{low:.3g}, {high:.3g}]"
    digits = max(0, 1 - math.floor(math.log10(width)))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
