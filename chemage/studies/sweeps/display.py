"""How a sweep is shown: its table, and figures of it: lines with error bands over one axis, or heat maps over two."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.figures import (
    BLUE,
    PALETTE,
    decades_only,
    from_zero,
    plain,
    shared_legend,
)
from chemage.foundation.looks import current
from chemage.foundation.names import __version__
from chemage.foundation.quantities import headed
from chemage.foundation.result import (
    Medium,
    Panel,
    Picture,
    Result,
    Rows,
    Table,
    displays,
    result_of,
)
from chemage.foundation.text import jsonable
from chemage.studies.sweeps.result import Point, SweepResult, in_words
from chemage.studies.sweeps.table import DECLARED
from chemage.studies.sweeps.views import (
    HOLD_TIME,
    SweepData,
    View,
    ViewedQuantity,
    swept_rows,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: rows of the table that are printed
MOST_ROWS = 60
#: more lines are drawn as a heat map
MOST_LINES = 8
#: an axis whose values span more decades is logarithmic
LOG_DECADES = 1.5
_GREY = "#DDDDDD"


@displays(SweepResult)
class SweepDisplay(Result):
    """A sweep as users see it, complete or not: its axes, the table of its results, and these against its axes."""

    width = 80
    errors = "95 % intervals over replicas on one surface, or over seeds where these are averaged"

    def __init__(self, sweep: SweepResult) -> None:
        self.sweep = sweep

    @cached_property
    def data(self) -> SweepData:
        """The table of the sweep."""
        return SweepData(self.sweep)

    @cached_property
    def state(self) -> dict[str, Any]:
        """How many points are done, and why others failed."""
        return self.sweep.status()

    @property
    def name(self) -> str:
        return self.sweep.name

    @property
    def title(self) -> str:
        folder, here = Path(self.sweep.folder), Path.cwd()
        return f"{self.name} in {folder.relative_to(here) if folder.is_relative_to(here) else folder}"

    def facts(self) -> Rows:
        state = self.state
        spoilt = (
            f" ({state['contacts_damaged']} damaged)"
            if state["contacts_damaged"]
            else ""
        )
        words = [
            f"{state['done']} of {state['points']} points done",
            f"{state['contacts']} contacts{spoilt}",
        ]
        return [
            *swept_rows(self.sweep.axes),
            ("points", ", ".join(filter(None, [*words, in_words(state)]))),
        ]

    def numbers(self) -> dict[str, Any]:
        return jsonable(
            {
                **self.state,
                "units": self.sweep.units,
                "results": self.data.objects(),
            }
        )

    def notes(self) -> list[str]:
        """Of the table, and where β could not be fitted."""
        reasons: dict[str, list[str]] = {}
        for point, reason in enumerate(
            self.data.table.marks.get("beta_reason", ())
        ):
            if reason and len(self.sweep) <= MOST_ROWS:
                reasons.setdefault(reason, []).append(str(point))
        words = [
            f"beta not fitted at point{'s' if len(points) > 1 else ''} {', '.join(points)}: {reason}"
            for reason, points in reasons.items()
        ]
        return [*self.data.notes(), *words]

    def tables(self) -> list[Table]:
        if not self.state["done"]:
            return []
        headings, lines = self.data.rows()
        more = len(lines) - MOST_ROWS
        listed = f"{more} more rows; {self.sweep.folder / 'results.csv'} lists every point"
        remarks = (listed,) if more > 0 else ()
        return [
            Table(
                "",
                headings,
                lines,
                "Results",
                remarks,
                in_detail=False,
                most=MOST_ROWS,
            )
        ]

    def columns(self) -> dict[str, Any]:
        """One line for each point: what was swept, and its numbers in internal units; curves at the last hold time."""
        lines = [
            {**record.pop("swept"), **record} for record in self.data.records()
        ]
        return (
            {name: [line.get(name) for line in lines] for name in lines[0]}
            if lines
            else {}
        )

    def cite(self) -> tuple[list[str], str]:
        return [], self.sweep.versions.get("chemage", __version__)

    def made_by(self) -> Mapping[str, Any]:
        return {"components": self.sweep.grid.components()}

    def pictures(
        self,
        *,
        x: str | None = None,
        lines: str | None = None,
        y: Sequence[str] = (),
        where: Mapping[str, str] | None = None,
        heat: bool = False,
    ) -> dict[str, Picture]:
        """Results against one axis, or heat maps over two.

        Parameters
        ----------
        x, lines
            Axes, by the name of their field or its path, or ``"hold_time"`` for ``x``. Default: the numeric axis with
            most values, and the next one. Axes of seeds are averaged over.
        y
            Results, a panel each. Default: β and ΔF at the last hold time; without ageing, the contact area.
        where
            Axis -> its value, for further axes; default: the value in the middle.
        heat
            Draw a heat map over ``x`` and ``lines``; default: where there would be more than 8 lines.

        Without any choice, a second figure shows Δμ against hold time.

        Raises
        ------
        InputError
            An axis, a value or a result does not exist, or no point is done.
        """
        data = self.data
        if "done" not in data.table.status:
            raise InputError(
                f"{self.sweep.folder}: no point is done; there is nothing to draw"
            )
        view = data.view(x, lines, where)
        chosen = list(y) or (
            ["friction_coefficient_drop"] if view.x == HOLD_TIME else data.usual()
        )
        pictures = dict([_picture(data, view, chosen, heat)])
        is_default = not (x or lines or y or where or heat)
        if (
            is_default
            and view.x != HOLD_TIME
            and data.usual()[0] == "beta"
            and data.table.hold_times.ndim == 1
        ):
            few = data.dimensions[data.axis(view.x, "--x")].size <= MOST_LINES
            along = data.view(HOLD_TIME, view.x if few else None)
            pictures |= dict(
                [_picture(data, along, ["friction_coefficient_drop"], False)]
            )
        return pictures


@displays(Point)
def point_display(point: Point) -> Result:
    """A point of a sweep as users see it."""
    return result_of(point.run())


def _picture(
    data: SweepData, view: View, names: Sequence[str], heat: bool
) -> tuple[str, Picture]:
    quantities = [data.quantity(name, view) for name in names]
    lines = view.lines
    as_map = heat or quantities[0].mean.shape[0] > MOST_LINES
    if as_map and lines is None:
        raise InputError(
            "--heat: a heat map needs two axes; this sweep has one, or choose --lines"
        )
    if lines and not (data.is_number(lines) and data.is_number(view.x)):
        if heat:
            raise InputError(
                f"--heat: {view.x} and {lines} must have numbers as values"
            )
        as_map = False
    legend = 0.0 if as_map or lines is None else 1.6
    function = _draw_heat if as_map else _draw_lines
    drawn = []
    for quantity in quantities:
        draw = partial(function, data=data, view=view, quantity=quantity)
        drawn.append(Panel(draw, name=quantity.name))

    def finish(figure: Figure, plots: list[Axes]) -> None:
        if legend:
            handles, _ = plots[0].get_legend_handles_labels()
            title = plain(_label(data, lines or ""))
            shared_legend(figure, handles, title, beside=True)
        title = _title(data, view, quantities, bands=not as_map)
        figure.suptitle(title, parse_math=False)

    name = f"{'-'.join(names)}-against-{view.x}"
    if lines:
        name += f"{'-and-' if as_map else '-by-'}{lines}"
    beside = legend if current().width is None else 0.0
    return name, Picture(drawn, (4.9 * len(drawn) + beside, 4.1), finish=finish)


def _title(
    data: SweepData, view: View, found: Sequence[ViewedQuantity], *, bands: bool
) -> str:
    """What the figure shows beside its axes: fixed values, the meaning of the band, points that are missing."""
    parts = [data.text(dim, place) for dim, place in view.fixed.items()]
    with_errors = bands and any(
        np.isfinite(quantity.low).any() for quantity in found
    )
    if view.averaged:
        count = math.prod(data.dimensions[dim].size for dim in view.averaged)
        band = ", band: its 95 % interval" if with_errors else ""
        parts.append(f"mean over {count} seeds{band}")
    elif with_errors:
        parts.append("band: 95 % interval over replicas")
    fitted = ("beta", "b", "cutoff")
    if data.doubt and any(
        quantity.name.partition("_")[0] in fitted for quantity in found
    ):
        parts.append(data.doubt)
    status = data.table.status
    if rest := len(status) - status.count("done"):
        parts.append(f"{rest} of {len(status)} points are not done")
    if "approximate" in data.table.marks:
        parts.append("approximate")
    return f"{data.name}: {'; '.join(parts)}" if parts else data.name


def _label(
    data: SweepData, name: str, quantity: ViewedQuantity | None = None
) -> str:
    """The label of an axis of the sweep, or of a quantity."""
    label = plain(quantity.meaning if quantity else name.replace("_", " "))
    if name in DECLARED:
        label = DECLARED[name].title
    times = data.table.hold_times
    if quantity is not None and quantity.at_last:
        at = "the last hold time"
        if times.ndim == 1 and times.size:
            at = f"{times[np.isfinite(times)].max():g} s"
        label += f" at {at}"
    return headed(label, data.unit(name))


def is_logarithmic(values: np.ndarray) -> bool:
    """Whether positive values span more than 1.5 decades."""
    finite = values[np.isfinite(values)]
    if finite.size < 2 or finite.min() <= 0:
        return False
    return bool(np.ptp(np.log10(finite)) > LOG_DECADES)


def _scale(values: np.ndarray) -> str:
    return "log" if is_logarithmic(values) else "linear"


def _draw_lines(
    axes: Axes,
    medium: Medium,
    data: SweepData,
    view: View,
    quantity: ViewedQuantity,
) -> None:
    places, is_number = data.values(view.x), data.is_number(view.x)
    x = np.asarray(places if is_number else range(len(places)), dtype=np.float64)
    order = np.argsort(x, kind="stable")
    if view.x == HOLD_TIME:
        order = order[x[order] > 0]
    marker = None if order.size > 20 else "o"
    for number, colour in enumerate(_colours(data, view, quantity.mean.shape[0])):
        mean, low, high = (
            values[number][order]
            for values in (quantity.mean, quantity.low, quantity.high)
        )
        label = plain(data.value_text(view.lines, number)) if view.lines else None
        style: dict[str, Any] = {
            "marker": marker,
            "ms": 3.5,
            "lw": 1.3,
            "zorder": 3,
        }
        axes.plot(x[order], mean, color=colour, label=label, **style)
        band = np.isfinite(low) & np.isfinite(high)
        axes.fill_between(
            x[order], low, high, where=band, color=colour, alpha=0.22, lw=0
        )
    if not is_number:
        texts = [plain(str(value)) for value in places]
        axes.set_xticks(x, texts, rotation=30, ha="right")
    elif x.size <= 10 and places.dtype.kind == "i" and not is_logarithmic(x):
        _tick_values(axes.xaxis, x, "linear")
    else:
        axes.set_xscale(_scale(x[order]))
    # a logarithmic axis would cut a band that reaches zero
    values = np.concatenate([quantity.mean, quantity.low, quantity.high])
    if is_logarithmic(values) and np.nanmin(quantity.low, initial=np.inf) > 0:
        axes.set_yscale("log")
    elif np.nanmin(quantity.mean, initial=0.0) >= 0:
        from_zero(axes)
    axes.set(
        xlabel=_label(data, view.x), ylabel=_label(data, quantity.name, quantity)
    )
    axes.grid(alpha=0.25, lw=0.6)


def _colours(data: SweepData, view: View, number: int) -> list[Any]:
    """Colours of the lines: in the order of a scale for numbers, of the palette for other values."""
    if number == 1:
        return [BLUE]
    if view.lines is None or not data.is_number(view.lines):
        return [PALETTE[place % len(PALETTE)] for place in range(number)]
    from matplotlib import colormaps

    ranks = np.argsort(
        np.argsort(data.values(view.lines), kind="stable"), kind="stable"
    )
    return [colormaps["viridis"](0.92 * rank / (number - 1)) for rank in ranks]


def _draw_heat(
    axes: Axes,
    medium: Medium,
    data: SweepData,
    view: View,
    quantity: ViewedQuantity,
) -> None:
    from matplotlib.colors import LogNorm

    assert view.lines is not None
    sides = []
    for name, axis in ((view.x, axes.xaxis), (view.lines, axes.yaxis)):
        values = np.asarray(data.values(name), dtype=np.float64)
        order = np.argsort(values, kind="stable")
        if name == HOLD_TIME:
            order = order[values[order] > 0]
        sides.append((axis, order, values[order], _scale(values[order])))
    (_, columns, *x), (_, rows, *y) = sides
    values = np.ma.masked_invalid(quantity.mean[np.ix_(rows, columns)])
    norm = LogNorm() if is_logarithmic(quantity.mean) else None
    axes.set_facecolor(_GREY)
    image = axes.pcolormesh(
        _edges(*x), _edges(*y), values, cmap="viridis", norm=norm, rasterized=True
    )
    labels = _label(data, view.x), _label(data, view.lines)
    axes.set(xscale=x[1], yscale=y[1], xlabel=labels[0], ylabel=labels[1])
    for axis, _, ticks, scale in sides:
        _tick_values(axis, ticks, scale)
    bar = axes.figure.colorbar(image, ax=axes)
    bar.set_label(_label(data, quantity.name, quantity))
    if values.mask.any():
        axes.set_title("grey: not done, or not defined")


def _tick_values(axis: Any, values: np.ndarray, scale: str) -> None:
    """Label the values of a short axis themselves."""
    if values.size > 10:
        return
    if scale == "log":
        decades_only(axis)
    axis.set_ticks(values, [f"{value:g}" for value in values])


def _edges(values: np.ndarray, scale: str) -> np.ndarray:
    """Edges of cells around sorted ``values``, half way between them."""
    at = np.log(values) if scale == "log" else values
    steps = np.diff(at) if at.size > 1 else np.ones(1)
    beyond = np.concatenate([[at[0] - steps[0]], at, [at[-1] + steps[-1]]])
    edges = 0.5 * (beyond[1:] + beyond[:-1])
    return np.exp(edges) if scale == "log" else edges
