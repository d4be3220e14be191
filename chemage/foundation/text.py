"""Numbers as text, to the digits that their errors justify, and results as plain JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

import numpy as np

from chemage.foundation.statistics import half_width


def mean_text(values: np.ndarray, unit: str = "") -> str:
    """The mean over replicas ± half of Student's 95 % interval; a single replica has no error, nan is "-"."""
    mean = float(np.mean(values))
    return plus_minus(mean, float(half_width(np.asarray(values))), unit) if math.isfinite(mean) else "-"


def plus_minus(value: float, error: float, unit: str = "") -> str:
    """A value with its error, both to the error's second digit; ``unit`` may be empty."""
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


def jsonable(value: Any) -> Any:
    """Plain JSON: numpy scalars and arrays as numbers and lists, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def html_table(title: str, rows: Iterable[tuple[str, ...]]) -> str:
    """A small table for notebooks; everything in it is escaped."""
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<b>{escape(title)}</b><table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
