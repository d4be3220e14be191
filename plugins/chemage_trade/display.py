"""How a map of speed against accuracy is shown: tables, the cheapest settings, and a panel for each observable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from chemage.plugin import (
    Panel,
    Picture,
    Result,
    Table,
    TradePoint,
    displays,
    figures,
    text,
)
from chemage_trade.result import AGEING, ENGINE, SOLVER, Tradeoff, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: panels side by side
_COLUMNS = 4
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
#: an error of 0 is drawn at this part of the smallest other one, and one below the limit (%) at the limit
_NOTHING, _SMALLEST = 0.3, 1e-3
#: observable -> heading of its column
_SHORT = {
    "corrected_area": "area",
    "pressure_distribution": "p distr.",
    "patches": "patches",
    "perimeter_to_area": "C/A",
}


@displays(Tradeoff)
class TradeDisplay(Result):
    """A map of speed against accuracy as users see it."""

    width = 80
    errors = "95 % intervals over the surfaces on which everything was computed"

    def __init__(self, trade: Tradeoff) -> None:
        self.trade = trade

    @property
    def name(self) -> str:
        return self.trade.name

    @property
    def title(self) -> str:
        return f"Speed against accuracy: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        trade = self.trade
        where = "surfaces" if trade.random else "repetitions on the one surface"
        rows = [
            ("computed on", f"{trade.rounds} {where}, CPU times on one thread"),
            (
                "errors",
                "mean difference from the reference in %, ± half the width of its 95 % interval",
            ),
            ("(in brackets)", "not resolved, smaller than that; 0: below 0.005"),
            ("*", "on the Pareto front: nothing else is both faster and more accurate"),
        ]
        if scatter := trade.surface_scatter.get("beta"):
            scatters = f"scatters by about {text.percent(scatter)} between surfaces"
            rows.append(
                ("β", f"{scatters}; `chemage run --accuracy` averages over them")
            )
        return rows

    def numbers(self) -> dict[str, Any]:
        return self.trade.todict()

    def notes(self) -> list[str]:
        return list(self.trade.notes)

    def tables(self) -> list[Table]:
        """Of the ageing four observables at most, and of the contact; and the cheapest settings."""
        names, drops = self.trade.observables, _drops(self.trade)
        shown = {"beta", *drops[len(drops) // 2 :][:1], *drops[-1:]}
        ageing = [name for name in names if name in shown]
        contact = [name for name in names if not TradePoint.of_ageing(name)]
        tables = [self._table("Ageing", ageing)] if ageing else []
        tables.append(self._table("Contact", contact))
        for name, lines in self.trade.sentences().items():
            title = f"The cheapest settings for the {words(name)} of one surface:"
            tables.append(
                Table(
                    title,
                    (),
                    [(line,) for line in lines],
                    "Cheapest settings",
                    in_detail=False,
                )
            )
        return tables

    def _table(self, title: str, names: Sequence[str]) -> Table:
        first, short, rows = names[0], _short_knobs(self.trade), []
        for point in sorted(self.trade.of(first), key=lambda one: one.seconds(first)):
            if len(point.choices) > 1 and not set(names) & set(point.front):
                continue  # a combination that is beaten by another
            settings = "\n".join(
                f"{short[knob]} {label}".strip()
                for knob, label in point.choices.items()
            )
            seconds = _plus_minus(point.seconds(first), point.spread(first))
            rows.append(
                (
                    settings or "as in the scene",
                    seconds,
                    *(_deviation(point, name) for name in names),
                )
            )
        columns = (
            "settings",
            "CPU (s)",
            *(_SHORT.get(name, words(name)) for name in names),
        )
        return Table(title, columns, rows, title, in_detail=False, dense=True)

    def pictures(self) -> dict[str, Picture]:
        """The error against the CPU time, with a panel for each observable.

        The error is the one that is not exceeded with 95 % confidence. Open symbols are single settings, filled ones
        combinations; the step line is the Pareto front.
        """
        style, names = _Style(self.trade), _shown(self.trade)
        columns = min(max(len(names), 1), _COLUMNS)
        height = 2.9 * max(-(-len(names) // columns), 1)
        panels = []
        for name in names:
            caption = f"Error of the {words(name)} against CPU time; filled: combinations; line: Pareto front."
            panels.append(
                Panel(
                    partial(_draw, trade=self.trade, name=name, style=style),
                    caption,
                    name=name,
                )
            )

        def finish(figure: Figure, plots: list[Axes]) -> None:
            figures.shared_legend(figure, style.handles())

        size = (3.1 * max(columns, 2), height)
        return (
            {"trade": Picture(panels, size, columns, finish=finish, dpi=110)}
            if panels
            else {}
        )


def _short_knobs(trade: Tradeoff) -> dict[str, str]:
    """What is chosen -> the last part of its name where this is the only one with it, else the whole name."""
    knobs = {knob for point in trade.points for knob in point.choices}
    last = [knob.rpartition(".")[2] for knob in knobs]
    short = {
        knob: part if last.count(part) == 1 else knob
        for knob, part in zip(knobs, last, strict=True)
    }
    return {**short, TradePoint.GRID: "grid", AGEING: ""}


def _plus_minus(value: float, error: float) -> str:
    shown = text.plus_minus(value, error).replace(" ± ", "±")
    is_zero = not shown.partition("±")[0].strip("-0.")
    return shown.removeprefix("-") if is_zero else shown


def _deviation(point: TradePoint, name: str) -> str:
    deviation = point.deviation(name)
    mark = "*" if name in point.front else ""
    value, half = 100 * deviation.value, 100 * deviation.half_width
    if math.isnan(value):
        return ""
    if math.isnan(half):
        return f"{value:.2g}±?{mark}"
    if half == 0 or abs(value) + half < 0.005:
        return f"{value:.2g}{mark}" if abs(value) + half > 0.005 else f"0{mark}"
    shown = _plus_minus(value, half)
    return (shown if deviation.resolved else f"({shown})") + mark


def _drops(trade: Tradeoff) -> list[str]:
    """The observables of the ageing but β: friction drops, by hold time."""
    names = trade.observables
    return [name for name in names if TradePoint.of_ageing(name) and name != "beta"]


def _shown(trade: Tradeoff) -> list[str]:
    """The observables that are drawn: of the hold times the first, a middle one and the last."""
    drops = _drops(trade)
    shown = {*drops[:1], *drops[len(drops) // 2 :][:1], *drops[-1:]}
    return [name for name in trade.observables if name in shown or name not in drops]


class _Style:
    """Colours of contacts and symbols of ways of ageing."""

    def __init__(self, trade: Tradeoff) -> None:
        contacts = sorted({_contact(point) for point in trade.points})
        ageings = sorted({_ageing(point) for point in trade.points})
        self.colors = {
            name: figures.PALETTE[k % len(figures.PALETTE)]
            for k, name in enumerate(contacts)
        }
        self.markers = {
            name: _MARKERS[k % len(_MARKERS)] for k, name in enumerate(ageings)
        }

    def of(self, point: TradePoint) -> dict[str, Any]:
        """How a point is drawn."""
        color = self.colors[_contact(point)]
        filled = len(point.choices) > 1
        return {
            "marker": "*" if point.own else self.markers[_ageing(point)],
            "color": figures.BLACK if point.own else color,
            "markerfacecolor": figures.BLACK
            if point.own
            else color
            if filled
            else "white",
            "markersize": 11 if point.own else 5,
            "linestyle": "none",
        }

    def handles(self) -> list[Any]:
        """What the legend shows."""
        from matplotlib.lines import Line2D

        def symbol(label: str, **style: Any) -> Any:
            return Line2D(
                [], [], label=label, **{"linestyle": "none", "markersize": 6, **style}
            )

        symbols = [
            symbol("as in the scene", marker="*", color=figures.BLACK, markersize=10)
        ]
        symbols.append(
            symbol(
                "single setting",
                marker="o",
                color=figures.GREY,
                markerfacecolor="white",
            )
        )
        symbols.append(symbol("combination", marker="o", color=figures.GREY))
        symbols.append(Line2D([], [], color=figures.GREY, lw=1, label="Pareto front"))
        symbols += [
            symbol(name or "grid of the scene", marker="o", color=color)
            for name, color in self.colors.items()
        ]
        if len(self.markers) > 1:
            markers = self.markers.items()
            symbols += [
                symbol(name or "ageing of the scene", marker=marker, color=figures.GREY)
                for name, marker in markers
            ]
        return symbols


def _contact(point: TradePoint) -> str:
    """The grid or the solver of a point; "" for those of the scene."""
    if TradePoint.GRID in point.choices:
        return f"grid {point.choices[TradePoint.GRID]}"
    return point.choices.get(SOLVER, "")


def _ageing(point: TradePoint) -> str:
    """How the ageing of a point is computed, without numbers; "" as in the scene."""
    return (point.choices.get(AGEING) or point.choices.get(ENGINE, "")).partition(",")[
        0
    ]


def _draw(axes: Axes, _: Any, trade: Tradeoff, name: str, style: _Style) -> None:
    points = trade.of(name)
    errors = [100 * point.deviation(name).bound for point in points]
    nothing = max(
        _NOTHING * min((error for error in errors if error > 0), default=1.0), _SMALLEST
    )
    for point, error in zip(points, errors, strict=True):
        axes.plot(
            point.seconds(name),
            max(error, nothing),
            zorder=4 if point.own else 3,
            **style.of(point),
        )
    front = [
        (point.seconds(name), max(100 * point.deviation(name).bound, nothing))
        for point in trade.front(name)
    ]
    if front:
        seconds, bounds = zip(*front, strict=True)
        axes.step(
            [*seconds, 1e9],
            [*bounds, bounds[-1]],
            where="post",
            color=figures.GREY,
            lw=1,
            zorder=2,
        )
    axes.set(xscale="log", yscale="log", title=words(name))
    _scale(axes.xaxis, [point.seconds(name) for point in points])
    _scale(axes.yaxis, [max(error, nothing) for error in errors])
    if any(error < nothing for error in errors):
        axes.annotate(
            "0",
            (0, nothing),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
        )
    axes.set(xlabel="CPU time (s)", ylabel="error, at most (%)")


def _scale(axis: Any, values: list[float]) -> None:
    """Set the limits around positive ``values``, at least a decade apart so that small differences look small."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    known = [value for value in values if 0 < value < math.inf]
    if not known:
        return
    low, high = min(known), max(known)
    middle = math.sqrt(low * high)
    reach = max(1.5 * (high / low) ** 0.54, math.sqrt(10.0))
    (axis.axes.set_xlim if axis.axis_name == "x" else axis.axes.set_ylim)(
        middle / reach, middle * reach
    )
    axis.set_major_locator(
        LogLocator(subs=(1.0, 2.0, 5.0) if reach < 16.0 else (1.0,), numticks=8)
    )
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
