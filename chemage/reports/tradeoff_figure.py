"""The figure of speed against accuracy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from chemage.experiments.tradeoff import Tradeoff
from chemage.reports.figures import BLUE, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure(found: Tradeoff) -> Figure:
    """Draw the error against the CPU time, with a panel for each option whose error was measured."""
    named = dict.fromkeys(row.knob for row in found.rows if row.knob != "engine")  # engines are exact
    options = [option for option in named if _errors(found, option)]
    columns = max(len(options), 1)
    drawn, plots = panels(4.6 * columns, 3.9, columns, dpi=130)
    for option, axes in zip(options, plots, strict=False):
        name, points = _errors(found, option)
        axes.loglog([point[0] for point in points], [point[1] for point in points], "o-", ms=4, color=BLUE)
        for k, (x, y, label) in enumerate(points):  # alternately above and below, for points that are close
            axes.annotate(label, (x, y), textcoords="offset points", xytext=(5, -10 if k % 2 else 4), fontsize=7)
        axes.set(xlabel="CPU time (s)", ylabel=name, title=option)
        _scale(axes.xaxis, [point[0] for point in points])
        _scale(axes.yaxis, [point[1] for point in points])
    return drawn


def _scale(axis: Any, values: list[float]) -> None:
    """Set the limits around positive ``values``, at least a decade apart so that small differences look small."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = min(values), max(values)
    middle, reach = math.sqrt(low * high), max(2.0 * (high / low) ** 0.54, math.sqrt(10.0))
    (axis.axes.set_xlim if axis.axis_name == "x" else axis.axes.set_ylim)(middle / reach, middle * reach)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if reach < 6.0 else (1.0,), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _errors(found: Tradeoff, option: str) -> Any:
    """(name, points) of the first kind of error that was measured; None without one."""
    rows = [row for row in found.rows if row.knob == option]
    labels = {
        "pressure_error": "relative error of the pressure",
        "area_error": "relative error of the area",
        "beta_stderr": "standard error of β",
    }
    for name, label in labels.items():
        points = [
            (row.cpu_seconds, getattr(row, name), row.setting)
            for row in rows
            if row.cpu_seconds > 0 and getattr(row, name) > 0
        ]
        if points:
            return label, points
    return None
