"""The figure of speed against accuracy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from chemage.results.figures import BLACK, GREY, PALETTE, panels
from chemage.studies.trade.choices import AGEING, ENGINE, GRID, SOLVER
from chemage.studies.trade.trade_map import Point, TradeMap, of_ageing, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: panels side by side, and hold times that are drawn
_COLUMNS, _TIMES = 4, 3
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
#: an error of 0 is drawn at this part of the smallest other one, and one below the limit (%) at the limit
_NOTHING, _SMALLEST = 0.3, 1e-3


def figure(found: TradeMap) -> Figure:
    """Draw the error against the CPU time, with a panel for each observable.

    The error is the one that is not exceeded with 95 % confidence. Open symbols are single settings, filled ones
    combinations; the step line is the Pareto front.
    """
    shown = _shown(found)
    columns = min(max(len(shown), 1), _COLUMNS)
    rows = max(-(-len(shown) // columns), 1)
    drawn, plots = panels(3.1 * max(columns, 2), 2.9 * rows + 0.9, columns, rows, dpi=110)
    for axes in plots[max(len(shown), 1) :]:
        axes.remove()
    style = _Style(found)
    for name, axes in zip(shown, plots, strict=False):
        _panel(axes, found, name, style)
    handles = style.handles()
    if shown:
        drawn.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5), frameon=False, fontsize=8)
    return drawn


def _shown(found: TradeMap) -> list[str]:
    """The observables that are drawn: of the hold times the first, a middle one and the last."""
    drops = [name for name in found.observables if of_ageing(name) and name != "beta"]
    if len(drops) > _TIMES:
        drops = [drops[0], drops[len(drops) // 2], drops[-1]]
    return [name for name in found.observables if name in drops or name == "beta" or not of_ageing(name)]


class _Style:
    """Colours of contacts and symbols of ways of ageing."""

    def __init__(self, found: TradeMap) -> None:
        contacts = dict.fromkeys(_contact(point) for point in found.points)
        ageings = dict.fromkeys(_ageing(point) for point in found.points)
        order = sorted(contacts, key=lambda name: (name != "", name))
        self.colors = {name: PALETTE[k % len(PALETTE)] for k, name in enumerate(order)}
        order = sorted(ageings, key=lambda name: (name != "", name))
        self.markers = {name: _MARKERS[k % len(_MARKERS)] for k, name in enumerate(order)}

    def of(self, point: Point) -> dict[str, Any]:
        """How a point is drawn."""
        color = self.colors[_contact(point)]
        filled = len(point.choices) > 1
        return {
            "marker": "*" if point.own else self.markers[_ageing(point)],
            "color": BLACK if point.own else color,
            "markerfacecolor": BLACK if point.own else color if filled else "white",
            "markersize": 11 if point.own else 5,
            "linestyle": "none",
        }

    def handles(self) -> list[Any]:
        """What the legend shows."""
        from matplotlib.lines import Line2D

        def symbol(label: str, **style: Any) -> Any:
            return Line2D([], [], label=label, **{"linestyle": "none", "markersize": 6, **style})

        found = [symbol("as in the scene", marker="*", color=BLACK, markersize=10)]
        found.append(symbol("single setting", marker="o", color=GREY, markerfacecolor="white"))
        found.append(symbol("combination", marker="o", color=GREY))
        found.append(Line2D([], [], color=GREY, lw=1, label="Pareto front"))
        found += [symbol(name or "grid of the scene", marker="o", color=color) for name, color in self.colors.items()]
        if len(self.markers) > 1:
            markers = self.markers.items()
            found += [symbol(name or "ageing of the scene", marker=marker, color=GREY) for name, marker in markers]
        return found


def _contact(point: Point) -> str:
    """The grid or the solver of a point; "" for those of the scene."""
    if GRID in point.choices:
        return f"grid {point.choices[GRID]}"
    return point.choices.get(SOLVER, "")


def _ageing(point: Point) -> str:
    """How the ageing of a point is computed, without numbers; "" as in the scene."""
    return (point.choices.get(AGEING) or point.choices.get(ENGINE, "")).partition(",")[0]


def _panel(axes: Axes, found: TradeMap, name: str, style: _Style) -> None:
    points = found.of(name)
    errors = [100 * point.deviation(name).bound for point in points]
    nothing = max(_NOTHING * min((error for error in errors if error > 0), default=1.0), _SMALLEST)
    for point, error in zip(points, errors, strict=True):
        axes.plot(point.seconds(name), max(error, nothing), zorder=4 if point.own else 3, **style.of(point))
    front = [(point.seconds(name), max(100 * point.deviation(name).bound, nothing)) for point in found.front(name)]
    if front:
        seconds, bounds = zip(*front, strict=True)
        axes.step([*seconds, 1e9], [*bounds, bounds[-1]], where="post", color=GREY, lw=1, zorder=2)
    axes.set(xscale="log", yscale="log", title=words(name))
    _scale(axes.xaxis, [point.seconds(name) for point in points])
    _scale(axes.yaxis, [max(error, nothing) for error in errors])
    if any(error < nothing for error in errors):
        text = {"textcoords": "offset points", "fontsize": 8, "va": "center"}
        axes.annotate("0", (0, nothing), xycoords=("axes fraction", "data"), xytext=(3, 0), **text)
    axes.set(xlabel="CPU time (s)", ylabel="error, at most (%)")


def _scale(axis: Any, values: list[float]) -> None:
    """Set the limits around positive ``values``, at least a decade apart so that small differences look small."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    known = [value for value in values if 0 < value < math.inf]
    if not known:
        return
    low, high = min(known), max(known)
    middle, reach = math.sqrt(low * high), max(1.5 * (high / low) ** 0.54, math.sqrt(10.0))
    (axis.axes.set_xlim if axis.axis_name == "x" else axis.axes.set_ylim)(middle / reach, middle * reach)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if reach < 16.0 else (1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
