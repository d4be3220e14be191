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
    """``value [low, high]`` to the digits the interval bears, at most six."""
    width, largest = high - low, max(abs(value), abs(low), abs(high))
    if not math.isfinite(value):
        return "undetermined"
    sizes = [abs(number) for number in (value, low, high) if number != 0]
    if not math.isfinite(width) or width <= 0 or largest > 100 * min(sizes):
        return f"{value:.4g} [{low:.3g}, {high:.3g}]"
    figures = min(6, max(2, math.floor(math.log10(largest)) - math.floor(math.log10(width)) + 2))
    if 1e-3 <= largest < 1e5:
        digits = max(0, figures - 1 - math.floor(math.log10(largest)))
        return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
    return f"{value:.{figures - 1}e} [{low:.{figures - 1}e}, {high:.{figures - 1}e}]"
