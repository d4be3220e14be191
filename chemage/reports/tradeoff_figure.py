"""The figure of speed against accuracy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from chemage.experiments.tradeoff import Tradeoff
from chemage.reports.figures import BLUE, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: panels side by side
_COLUMNS = 4


def figure(found: Tradeoff) -> Figure:
    """Draw the error against the CPU time, with a panel for each option whose error was measured."""
    named = dict.fromkeys(row.option for row in found.rows if row.option != "engine")  # engines are exact
    options = [option for option in named if _errors(found, option)]
    columns = min(max(len(options), 1), _COLUMNS)
    rows = max(-(-len(options) // columns), 1)
    drawn, plots = panels(4.6 * columns, 3.9 * rows, columns, rows, dpi=130)
    for axes in plots[max(len(options), 1) :]:
        axes.remove()
    for option, axes in zip(options, plots, strict=False):
        label, points = _errors(found, option)
        seconds, errors = [point.seconds for point in points], [point.error for point in points]
        axes.loglog(seconds, errors, "o-", ms=4, color=BLUE)
        bars = [point for point in points if point.uncertainty > 0]
        if bars:
            # a logarithmic axis has no place for the end of a bar at or below 0
            below = [min(point.uncertainty, 0.9 * point.error) for point in bars]
            axes.errorbar(
                [point.seconds for point in bars],
                [point.error for point in bars],
                yerr=[below, [point.uncertainty for point in bars]],
                fmt="none",
                ecolor=BLUE,
                capsize=3,
                lw=1,
            )
        for k, point in enumerate(points):  # alternately above and below, for points that are close
            place = {"textcoords": "offset points", "xytext": (5, -10 if k % 2 else 4), "fontsize": 7}
            axes.annotate(point.setting, (point.seconds, point.error), **place)
        axes.set(xlabel="CPU time (s)", ylabel=label, title=option)
        _scale(axes.xaxis, seconds)
        _scale(axes.yaxis, errors)
    return drawn


def _scale(axis: Any, values: list[float]) -> None:
    """Set the limits around positive ``values``, at least a decade apart so that small differences look small."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = min(values), max(values)
    middle, reach = math.sqrt(low * high), max(2.0 * (high / low) ** 0.54, math.sqrt(10.0))
    (axis.axes.set_xlim if axis.axis_name == "x" else axis.axes.set_ylim)(middle / reach, middle * reach)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if reach < 12.0 else (1.0,), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


class _Point(NamedTuple):
    seconds: float
    error: float
    #: half the width of its 95 % interval; nan where there is none
    uncertainty: float
    setting: str


def _errors(found: Tradeoff, option: str) -> Any:
    """(label, points) of the first kind of error that was measured; None without one."""
    rows = [row for row in found.rows if row.option == option]
    kinds = {
        "pressure_error": ("relative error of the pressure", ""),
        "area_error": ("relative error of the corrected area", "area_error_half_width"),
        "beta_difference": ("|difference of β|", "beta_difference_half_width"),
        "beta_stderr": ("standard error of β", ""),
    }
    for name, (label, uncertainty) in kinds.items():
        points = [
            _Point(
                row.cpu_seconds,
                abs(getattr(row, name)),
                getattr(row, uncertainty) if uncertainty else math.nan,
                row.setting,
            )
            for row in rows
            if row.cpu_seconds > 0 and abs(getattr(row, name)) > 0
        ]
        if points:
            return label, points
    return None
