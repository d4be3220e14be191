"""Numbers as text, to the digits that their errors justify, and results as plain JSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from html import escape
from typing import Any

import numpy as np

from chemage.foundation.aliases import Fields

#: errors below this part of the value are rounding
ROUNDING = 1e-12

#: how a text begins that spreadsheets compute; ASCII and full width
_FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")

#: what is written in place of an interval of no width
NO_SCATTER = "(no scatter, so that the error is not known)"


def with_article(noun: str) -> str:
    """``a Run``, ``an Inference``: a name with its article."""
    return f"{'an' if noun[:1] in 'AEIOUaeiou' else 'a'} {noun}"


def decimals(error: float) -> int:
    """Decimal places of a value with this ``error`` > 0: to its second digit if the first is 1, else to its first.

    Everything that prints or draws a value with its error rounds both to this place; negative: tens, hundreds, …
    """
    exponent = int(f"{error:.0e}".partition("e")[2])
    return (
        1 - exponent
        if f"{error:.1e}"[0] == "1" or f"{error:.0e}"[0] == "1"
        else -exponent
    )


def plus_minus(value: float, error: float, unit: str = "") -> str:
    """``0.43 ± 0.03 nN``: a value with its error, both rounded to :func:`decimals`; ``unit`` may be empty.

    An error that is only the rounding of equal numbers is none.
    """
    if not math.isfinite(value):
        return f"{value:g} {unit}".strip()
    if not (math.isfinite(error) and error > ROUNDING * abs(value)):
        return f"{value:.4g} {unit}".strip()
    digits = decimals(error)
    return f"{_rounded(value, digits)} ± {_rounded(error, digits)} {unit}".strip()


def with_error(value: float, error: float) -> str:
    """``0.43(3)``: a value with its error in units of the last digit, rounded to :func:`decimals`, for legends."""
    if not (
        math.isfinite(value)
        and math.isfinite(error)
        and error > ROUNDING * abs(value)
    ):
        return f"{value:.3g}"
    digits = decimals(error)
    if value and digits > 5 - math.floor(
        math.log10(abs(value))
    ):  # more digits than a legend has room for
        return f"{value:.4g}"
    return f"{_rounded(value, digits)}({round(error * 10.0 ** max(digits, 0), min(digits, 0)):.0f})"


def power_text(value: float) -> str:
    """``10⁴`` for a power of ten that is long to write out, else the number."""
    exponent = round(math.log10(value)) if value > 0 and math.isfinite(value) else 0
    if -3 < exponent < 3 or not math.isclose(value, 10.0**exponent):
        return f"{value:g}"
    return "10" + str(exponent).translate(
        str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    )


def percent(part: float) -> str:
    """``4.6 %``: a part to two digits, and no power of ten above 100 %."""
    return f"{100 * part:.2g} %" if abs(part) < 0.995 else f"{100 * part:.0f} %"


def _rounded(value: float, digits: int) -> str:
    return f"{round(value, digits):.{max(0, digits)}f}"


def with_interval(value: float, low: float, high: float) -> str:
    """``value [low, high]``, all rounded to :func:`decimals` of half the width, to six digits at most, ``value ± half``
    where these do not tell the ends apart; without an interval where it has no width, since the data do not scatter.
    A value that does not lie in its interval, as a known bias is left in it, is no estimate of the truth: the text says
    where that is."""
    width, largest = high - low, max(abs(value), abs(low), abs(high))
    if not math.isfinite(value):
        return "undetermined"
    if math.isfinite(width) and width <= ROUNDING * largest:
        return f"{value:.4g} {NO_SCATTER}"
    outside = "" if low <= value <= high else ", truth in"
    sizes = [abs(number) for number in (value, low, high) if number != 0]
    if not math.isfinite(width) or largest > 100 * min(sizes):
        return f"{value:.4g}{outside} [{low:.3g}, {high:.3g}]"
    most = 5 - math.floor(math.log10(largest))  # decimal places that are six digits
    digits = min(most, decimals(0.5 * width))
    if 1e-3 <= largest < 1e5:
        text, *ends = (_rounded(number, digits) for number in (value, low, high))
    else:
        figures = max(0, digits + math.floor(math.log10(largest)))
        text, *ends = (f"{number:.{figures}e}" for number in (value, low, high))
    return (
        f"{text} ± {0.5 * width:.1g}"
        if ends[0] == ends[1] and not outside
        else f"{text}{outside} [{', '.join(ends)}]"
    )


def approximations_in_words(approximations: Iterable[Fields]) -> str:
    """The one sentence by which everything that prints a number marks it: ``KIND (declared error 2 % of ...)``."""
    return "; ".join(
        f"{entry['kind']} ({_error_in_words(entry)})" for entry in approximations
    )


def _error_in_words(entry: Fields) -> str:
    if "carries" in entry:
        return f"carries {entry['carries']}"
    error = entry.get("declared_error")
    if not isinstance(error, int | float):
        return "no error declared"
    return f"declared error {100 * error:.3g} % of {entry.get('of') or 'what it computes'}"


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


def csv_text(names: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """A table as CSV, with the names of its columns on the first line. A text that a spreadsheet would compute, such as
    ``=1+1``, has an apostrophe before it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_inert(cell) for cell in row] for row in (names, *rows))
    return text.getvalue()


def _inert(cell: Any) -> Any:
    if not isinstance(cell, str):
        return cell
    cell = cell.replace("\r", " ")  # which csv does not quote
    with suppress(ValueError):
        float(cell)
        return cell
    return f"'{cell}" if cell.lstrip().startswith(_FORMULA) else cell


def html_table(title: str, rows: Iterable[tuple[str, ...]]) -> str:
    """A small table for notebooks; everything in it is escaped."""
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<b>{escape(title)}</b><table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
