"""How a map of speed against accuracy is shown: tables, the cheapest settings, and a panel for each observable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import cycle
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
            (
                "*",
                "on the Pareto front: nothing else is both faster and more accurate",
            ),
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
            rows = [(line,) for line in lines]
            tables.append(
                Table(title, (), rows, "Cheapest settings", in_detail=False)
            )
        return tables

    def _table(self, title: str, names: Sequence[str]) -> Table:
        first, short, rows = names[0], _short_knobs(self.trade), []
        for point in sorted(
            self.trade.of(first), key=lambda one: one.seconds(first)
        ):
            if len(point.choices) > 1 and not {*names} & {*point.front}:
                continue  # a combination that is beaten by another
            settings = [
                f"{short[knob]} {label}" for knob, label in point.choices.items()
            ]
            lines = "\n".join(text.strip() for text in settings)
            seconds = _plus_minus(point.seconds(first), point.spread(first))
            deviations = [_deviation(point, name) for name in names]
            rows.append((lines or "as in the scene", seconds, *deviations))
        headings = [_SHORT.get(name, words(name)) for name in names]
        columns = ("settings", "CPU (s)", *headings)
        return Table(title, columns, rows, title, in_detail=False, dense=True)

    def pictures(self) -> dict[str, Picture]:
        """The error against the CPU time, with a panel for each observable.

        The error is the one that is not exceeded with 95 % confidence. Open symbols are single settings, filled ones
        combinations; the step line is the Pareto front.
        """
        style, names = _Style(self.trade), _shown(self.trade)
        if not names:
            return {}
        columns = min(len(names), _COLUMNS)
        panels = []
        for name in names:
            caption = f"Error of the {words(name)} against CPU time; filled: combinations; line: Pareto front."
            draw = partial(_draw, trade=self.trade, name=name, style=style)
            panels.append(Panel(draw, caption, name=name))

        def finish(figure: Figure, plots: list[Axes]) -> None:
            figures.shared_legend(figure, style.handles())

        size = 3.1 * max(columns, 2), 2.9 * math.ceil(len(names) / columns)
        return {"trade": Picture(panels, size, columns, finish=finish, dpi=110)}


def _short_knobs(trade: Tradeoff) -> dict[str, str]:
    """What is chosen -> the last part of its name where this is the only one with it, else the whole name."""
    knobs = {
        knob: knob.rpartition(".")[2]
        for point in trade.points
        for knob in point.choices
    }
    last = [*knobs.values()]
    short = {
        knob: part if last.count(part) == 1 else knob
        for knob, part in knobs.items()
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
    return [
        name for name in trade.observables if name in shown or name not in drops
    ]


class _Style:
    """Colours of contacts and symbols of ways of ageing."""

    def __init__(self, trade: Tradeoff) -> None:
        contacts = sorted({_contact(point) for point in trade.points})
        ageings = sorted({_ageing(point) for point in trade.points})
        self.colors = dict(zip(contacts, cycle(figures.PALETTE), strict=False))
        self.markers = dict(zip(ageings, cycle(_MARKERS), strict=False))

    def of(self, point: TradePoint) -> dict[str, Any]:
        """How a point is drawn."""
        style = {"linestyle": "none", "markersize": 5}
        if point.own:
            return style | {"marker": "*", "color": figures.BLACK, "markersize": 11}
        style |= {
            "marker": self.markers[_ageing(point)],
            "color": self.colors[_contact(point)],
        }
        return (
            style
            if len(point.choices) > 1
            else style | {"markerfacecolor": "white"}
        )

    def handles(self) -> list[Any]:
        """What the legend shows."""
        from matplotlib.lines import Line2D

        grey = {"marker": "o", "color": figures.GREY}
        symbols: list[tuple[str, dict[str, Any]]] = [
            (
                "as in the scene",
                {"marker": "*", "color": figures.BLACK, "markersize": 10},
            ),
            ("single setting", {**grey, "markerfacecolor": "white"}),
            ("combination", grey),
            ("Pareto front", {"color": figures.GREY, "linestyle": "-", "lw": 1}),
        ]
        for name, color in self.colors.items():
            symbols.append(
                (name or "grid of the scene", {"marker": "o", "color": color})
            )
        for name, marker in self.markers.items() if len(self.markers) > 1 else ():
            symbols.append(
                (name or "ageing of the scene", {**grey, "marker": marker})
            )
        usual = {"linestyle": "none", "markersize": 6}
        return [
            Line2D([], [], label=label, **{**usual, **style})
            for label, style in symbols
        ]


def _contact(point: TradePoint) -> str:
    """The grid or the solver of a point; "" for those of the scene."""
    if TradePoint.GRID in point.choices:
        return f"grid {point.choices[TradePoint.GRID]}"
    return point.choices.get(SOLVER, "")


def _ageing(point: TradePoint) -> str:
    """How the ageing of a point is computed, without numbers; "" as in the scene."""
    return (point.choices.get(AGEING) or point.choices.get(ENGINE, "")).partition(
        ","
    )[0]


def _draw(axes: Axes, _: Any, trade: Tradeoff, name: str, style: _Style) -> None:
    points = trade.of(name)
    errors = {id(point): 100 * point.deviation(name).bound for point in points}
    least = min((error for error in errors.values() if error > 0), default=1.0)
    nothing = max(_NOTHING * least, _SMALLEST)

    def place(point: TradePoint) -> tuple[float, float]:
        return point.seconds(name), max(errors[id(point)], nothing)

    for point in points:
        axes.plot(*place(point), zorder=4 if point.own else 3, **style.of(point))
    if front := [place(point) for point in trade.front(name)]:
        seconds, bounds = zip(*front, strict=True)
        ends = [*seconds, 1e9], [*bounds, bounds[-1]]
        axes.step(*ends, where="post", color=figures.GREY, lw=1, zorder=2)
    axes.set(xscale="log", yscale="log", title=words(name))
    for axis, values in zip(
        (axes.xaxis, axes.yaxis),
        zip(*map(place, points), strict=True),
        strict=False,
    ):
        _scale(axis, values)
    if any(error < nothing for error in errors.values()):
        at: dict[str, Any] = {
            "xycoords": ("axes fraction", "data"),
            "textcoords": "offset points",
        }
        axes.annotate("0", (0, nothing), xytext=(3, 0), va="center", **at)
    axes.set(xlabel="CPU time (s)", ylabel="error, at most (%)")


def _scale(axis: Any, values: Sequence[float]) -> None:
    """Set the limits around positive ``values``, at least a decade apart so that small differences look small."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    known = [value for value in values if 0 < value < math.inf]
    if not known:
        return
    low, high = min(known), max(known)
    middle = math.sqrt(low * high)
    reach = max(1.5 * (high / low) ** 0.54, math.sqrt(10.0))
    axis.axes.set(**{f"{axis.axis_name}lim": (middle / reach, middle * reach)})
    axis.set_major_locator(
        LogLocator(subs=(1.0, 2.0, 5.0) if reach < 16.0 else (1.0,), numticks=8)
    )
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
