"""Figures of results: those of each alone, of several in one plot, and those that plugins bring.

The figures that plugins bring, of one result or of several that are compared.

A component brings those of its class (``figures`` and ``draw``), a plugin of hooks those of ``chemage_figures``. All
results in which components of one kind, or one plugin, took part are drawn into one set of axes. What cannot be drawn
is reported with a warning, and costs neither the result nor another figure.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from chemage.ageing.fitting import DROPS, Fit, span_text
from chemage.ageing.measurements import Measurements
from chemage.ageing.observables import Maps, Observed, PlottedResult
from chemage.foundation.arranging import arrange
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.figures import (
    BLACK,
    CORE,
    PALETTE,
    draw_map,
    legend,
    plain,
    plots,
    pooled,
    pressure_colours,
)
from chemage.foundation.looks import drawn_as
from chemage.foundation.outputs import RECORDED
from chemage.foundation.ownership import in_words
from chemage.foundation.quantities import Curve, Rank
from chemage.foundation.result import (
    Medium,
    Panel,
    Picture,
    drawn_picture,
    result_of,
    single_panels,
)
from chemage.foundation.statistics import NORMAL_LIMIT
from chemage.foundation.units import convert
from chemage.lattices.chemistry import Chemistry
from chemage.plugins import registry
from chemage.plugins.sources import implementing, stage_hooks
from chemage.results.comparison import Comparison, Entry
from chemage.results.files import StoredMap, open_maps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: a figure is saved as a file of its name
_NAME = re.compile(r"\w[\w .+-]*")


#: a result, and what is drawn of it
Source = tuple[Entry, PlottedResult]


class _PlannedFigure(NamedTuple):
    """A figure to be drawn."""

    name: str
    caption: str
    #: who brings it, in words
    bringer: str
    #: distinguishes it from a figure of the same name
    prefix: str
    #: called with axes and results
    draw: Callable[..., None]
    results: Sequence[PlottedResult]

    def drawn(self, size: tuple[float, float]) -> Figure | None:
        """The figure; nothing where it cannot be drawn, or nothing is in it."""
        try:
            with drawn_as():
                figure, (axes,) = plots(*size)
                self.draw(axes, self.results)
                arrange(figure)
                # what is only found when a figure is rendered, such as a formula that is wrong; nothing is moved
                layout = figure.get_layout_engine()
                figure.set_layout_engine("none")
                figure.draw_without_rendering()
                figure.set_layout_engine(layout)
        except (Exception, SystemExit) as error:
            if registry.current().strict:
                raise
            what = f"the figure {self.name!r} of {self.bringer} was left out"
            _warn(f"{what}: it cannot be drawn: {in_words(error)}")
            return None
        return (
            figure
            if any(one.has_data() or one.texts for one in figure.axes)
            else None
        )


def _warn(text: str) -> None:
    warnings.warn(text, registry.PluginWarning, stacklevel=3)


# -- of components ----------------------------------------------------------------------------------------------------


def _of_components(sources: Sequence[Source]) -> Iterator[_PlannedFigure]:
    """The figures of each kind, with all the results in which a component of this kind took part."""
    groups: dict[tuple[str, str], list[tuple[int, str, Component]]] = {}
    for number, (entry, plotted) in enumerate(sources):
        for path, component in entry.components:
            measured = component.role != "observable" or plotted.ageing is not None
            if type(component).figures and measured:
                groups.setdefault(
                    (component.role, component.qualified_kind()), []
                ).append((number, path, component))
    for (role, kind), components in groups.items():
        component = components[0][2]
        results = _results(sources, components)
        bringer = f"{role} {kind!r}"
        record = registry.current().provider(type(component))
        if record is not None and record.owner != "chemage":
            bringer += f" (plugin {record.name}, {record.source})"
        figures = type(component).figures
        if not isinstance(figures, Mapping):
            _warn(
                f"the figures of {bringer} were left out: figures = {figures!r} does not map names to captions"
            )
            continue
        for name, caption in figures.items():
            yield _PlannedFigure(
                str(name),
                str(caption),
                bringer,
                kind,
                partial(component.draw, name),
                results,
            )


def _results(
    sources: Sequence[Source], components: Sequence[tuple[int, str, Component]]
) -> list[PlottedResult]:
    """What to draw of the results; one with several components of the kind is there once for each of them."""
    numbers = [number for number, _, _ in components]
    several = len(set(numbers)) < len(numbers)
    drawn = []
    for count, (number, path, component) in enumerate(components):
        result = sources[number][1]
        changes: dict[str, Any] = {"component": component}
        if several:
            changes["color"] = PALETTE[count % len(PALETTE)]
        if numbers.count(number) > 1:
            changes["label"] = f"{result.label}, {path}"
        kind = Observed if component.role == "observable" else PlottedResult
        drawn.append(kind(**{**vars(result), **changes}))
    return drawn


# -- of hooks ---------------------------------------------------------------------------------------------------------


def _of_hooks(sources: Sequence[Source]) -> Iterator[_PlannedFigure]:
    """The figures of ``chemage_figures``: of the results in which the plugin took part.

    A plugin that answers no stage and offers no component can take part in none; it is given all results.
    """
    plugins = registry.current()
    computing = implementing(*stage_hooks())
    for record, function in plugins.functions("chemage_figures"):
        own = [
            plotted
            for entry, plotted in sources
            if record.name in entry.plugins
            or not (record.kinds or record.name in computing)
        ]
        if not own:
            continue
        bringer = f"plugin {record.name!r} ({record.source})"
        try:
            offered = [
                (name, caption, draw)
                for name, (caption, draw) in (function() or {}).items()
            ]
        except (Exception, SystemExit) as error:
            if plugins.strict:
                raise
            _warn(
                f"the figures of {bringer} were left out: chemage_figures must give "
                f"{{name: (caption, function)}}: {in_words(error)}"
            )
            continue
        for name, caption, draw in offered:
            yield _PlannedFigure(
                str(name), str(caption), bringer, record.name, draw, own
            )


_MARKERS = "osD^vP*X"
#: what is drawn beside curves, such as fits, is drawn for up to this many results
_FITTED = 4
#: label of what has no entry in the legend
_UNNAMED = "_"
#: inches; small, so that the text is legible on a phone
_SIZE = (4.9, 3.6)
#: of a figure in which errors have several meanings
_BARS = " Bands are intervals of means over surfaces, bars of means over replicas on one surface."
_EXPECTED = (
    'give its edges "X0 X1 Y0 Y1" in nm, or with units, such as "0 1um 200 800"'
)
#: map -> its name in words, how blocks of pixels are joined, colours
_MAPS = {
    "surface/heights": ("height", np.mean, "cividis"),
    "contact/pressure": ("pressure", np.max, None),
    "contact/gap": ("gap", np.mean, "viridis"),
}


def figures(
    thing: Any, panels: Sequence[str] = (), **choice: Any
) -> dict[str, Figure]:
    """Draw every figure of a result of any kind, those of plugins last: name -> figure, as ``chemage plot`` does.

    ``panels``: only these panels, each alone. ``choice``: what of a sweep is drawn, see
    :meth:`chemage.studies.sweeps.display.SweepDisplay.pictures`.
    """
    result = result_of(thing)
    pictures = result.pictures(**choice)
    if panels:
        return _drawn(single_panels(pictures, panels))
    brought = brought_figures([Entry.of(result)], (5.4, 4.0))
    return _drawn(pictures) | {
        name: figure for name, (figure, _) in brought.items()
    }


def comparison_figures(comparison: Comparison) -> dict[str, Figure]:
    """Draw every figure of several results for which there are data, those of plugins last: name -> figure."""
    brought = brought_figures(comparison.results)
    drawn = _drawn(curve_pictures(comparison))
    return drawn | {name: figure for name, (figure, _) in brought.items()}


def _drawn(pictures: Mapping[str, Picture]) -> dict[str, Figure]:
    return {name: drawn_picture(picture) for name, picture in pictures.items()}


# -- curves of several results ----------------------------------------------------------------------------------------


def curve_pictures(comparison: Comparison) -> dict[str, Picture]:
    """The curves that results have in common, and measurements: name -> picture of one panel."""
    curves: dict[str, list[tuple[Entry, Curve]]] = {}
    several = len(comparison.results) > 1 or comparison.measured
    for entry in comparison.results:
        for name, curve in sorted(
            entry.curves.items(), key=lambda item: item[1].rank
        ):
            if curve.rank < Rank.REST and (several or curve.alone):
                curves.setdefault(name, []).append((entry, curve))
    return {
        name.replace("_", "-").removeprefix(RECORDED): Picture(
            [_panel(comparison, name, drawn)], _SIZE
        )
        for name, drawn in curves.items()
    }


def _panel(
    comparison: Comparison, name: str, curves: Sequence[tuple[Entry, Curve]]
) -> Panel:
    """One curve of each result with its 95 % interval, what is known beside them, and measurements."""

    def draw(axes: Axes, medium: Medium) -> None:
        legend(
            axes,
            title=_draw_curves(axes, comparison, name, curves) or None,
            alignment="left",
        )

    sample = curves[0][1]
    bars = _BARS if len({curve.band for _, curve in curves}) > 1 else ""
    label = sample.axis_of.label
    if sample.is_distribution:
        caption = f"Distribution of the {label}."
        return Panel(
            draw,
            caption + bars,
            f"{caption} Curves for {', '.join(entry.name for entry, _ in curves)}.",
        )
    caption = f"{sample.title} against {label}, means and 95 % intervals."
    texts = [
        f"{entry.name} goes from {curve.mean[0]:.3g} at {curve.x[0]:g} s to {curve.mean[-1]:.3g} at {curve.x[-1]:g} s"
        for entry, curve in curves
    ]
    return Panel(
        draw,
        caption[0].upper() + caption[1:] + bars,
        f"{sample.axis} against {label}: {'; '.join(texts)}.",
    )


def _draw_curves(
    axes: Axes,
    comparison: Comparison,
    name: str,
    curves: Sequence[tuple[Entry, Curve]],
) -> str:
    """Draw the curves; return the title of their legend, which says what is common to all."""
    alone, few = len(comparison.results) == 1, len(comparison.results) <= _FITTED
    measured = _measurements(comparison, name)
    words, common = (
        _fit_words(comparison, name, measured) if not alone else ({}, "")
    )
    styles = {}
    for number, entry in enumerate(comparison.results):
        marker = _MARKERS[number % len(_MARKERS)]
        styles[entry.name] = {
            "color": PALETTE[number % len(PALETTE)],
            "marker": marker,
        }
    last = [
        _draw_curve(
            axes,
            comparison,
            entry,
            curve,
            styles[entry.name],
            words.get(entry.name, ""),
        )
        for entry, curve in curves
    ]
    sample = curves[0][1]
    axes.set(xlabel=sample.axis_of.axis, ylabel=sample.axis)
    if sample.is_distribution:
        axes.set(xlim=(0, None), ylim=(0, None))
        return ""
    axes.set_xscale("log")
    for entry, _ in curves if few and name == "friction_coefficient_drop" else ():
        if entry.comparable.draw_fit is not None:
            # the legend has its β with the curve
            color = styles[entry.name]["color"]
            darker = "#" + "".join(
                f"{round(0.6 * int(color[at : at + 2], 16)):02X}"
                for at in (1, 3, 5)
            )
            entry.comparable.draw_fit(
                axes, *(("", "") if alone else (_UNNAMED, darker))
            )
    _draw_measurements(axes, measured, words)
    positive = [value for value in last if value > 0]
    if positive and max(positive) > 10 * min(positive):
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], min(positive) / 300))
    else:
        axes.set_ylim(bottom=0)
    return common


def _fit_words(
    comparison: Comparison,
    quantity: str,
    measured: Sequence[tuple[Measurements, Fit | None]],
) -> tuple[dict[str, str], str]:
    """β of the lines of measurements and of a few results, for the legend, and what all have in common for its
    title."""
    fits = {data.name: fit for data, fit in measured if fit is not None}
    few = len(comparison.results) <= _FITTED
    if few and quantity == "friction_coefficient_drop":
        for entry in comparison.results:
            ageing = entry.comparable
            if ageing.fit is not None:
                fit = ageing.fit("line", ageing.window, quantity)
                if isinstance(fit, Fit) and fit.drawable:
                    fits[entry.name] = fit
    if not fits:
        return {}, ""
    spans, words = {span_text(fit.span) for fit in fits.values()}, {}
    for name, fit in fits.items():
        doubt = f", {fit.points} hold times" if fit.doubt else ""
        doubt += ", no line" if fit.bent else ""
        span = f", {span_text(fit.span)}" if len(spans) > 1 else ""
        words[name] = f", {fit.symbol_text()}{doubt}{span}"
    over = f", {spans.pop()}" if len(spans) == 1 else ""
    return words, f"β per decade: fitted lines{over}"


def _draw_curve(
    axes: Axes,
    comparison: Comparison,
    entry: Entry,
    curve: Curve,
    style: dict[str, Any],
    fitted: str,
) -> float:
    """Draw a curve, with β of its ``fitted`` line in the legend; return its last value. A band contains
    the scatter between surfaces; bars are errors of replicas on one surface."""
    if curve.is_distribution:
        axes.stairs(curve.mean, curve.x, color=style["color"], lw=1.4)
        middles = 0.5 * (curve.x[1:] + curve.x[:-1])
        every = max(1, curve.mean.size // 8)
        axes.plot(middles, curve.mean, ls="none", markevery=every, ms=3.5, **style)
        axes.plot(
            [], [], lw=1.4, ms=3.5, label=entry.legend_name, **style
        )  # both in one entry of the legend
        return 0.0
    what = curve.over
    if comparison.has_several_errors and not curve.band and " replicas," in what:
        what = what.replace(" replicas,", " replicas on one surface,")
    label = ", ".join(filter(None, (entry.legend_name, what))) + fitted
    positive = curve.x > 0
    x, mean, half = (
        values[positive] if values.size else values
        for values in (curve.x, curve.mean, curve.half_width)
    )
    error = np.nan_to_num(half)
    if curve.band:
        axes.plot(x, mean, ms=3.5, lw=1, label=label, **style)
        if np.isfinite(half).any():
            axes.fill_between(
                x, mean - half, mean + half, color=style["color"], alpha=0.25, lw=0
            )
    else:
        axes.errorbar(
            x,
            mean,
            yerr=error if error.any() else None,
            ms=3.5,
            lw=1,
            capsize=2,
            label=label,
            **style,
        )
    return float(curve.mean[-1])


def _measurements(
    comparison: Comparison, quantity: str
) -> list[tuple[Measurements, Fit | None]]:
    """Measurements of a quantity, or of another that one common load turns into it, and the line fitted to each."""
    if quantity not in DROPS:
        return []
    loads = {entry.comparable.load for entry in comparison.results}
    load = loads.pop() if len(loads) == 1 else None
    found = []
    for original in comparison.measured:
        data = original.as_quantity(quantity, load)  # pyright: ignore[reportArgumentType]
        if data is not None:
            fit = comparison.measured_fit(data, "line")
            drawable = isinstance(fit, Fit) and fit.drawable
            found.append((data, fit if drawable else None))
    return found


def _draw_measurements(
    axes: Axes,
    measured: Sequence[tuple[Measurements, Fit | None]],
    words: Mapping[str, str],
) -> None:
    """Draw measurements, and the line fitted to each, which is in the legend with them where there are ``words``."""
    style: dict[str, Any] = {"mfc": "none", "ms": 5, "capsize": 2}
    for number, (data, fit) in enumerate(measured):
        positive, bars, label = data.hold_times > 0, None, f"{data.name} (measured)"
        if data.error is not None:
            bars = NORMAL_LIMIT * data.error[positive]
            label = f"{data.name} (measured, 95 %)"
        axes.errorbar(
            data.hold_times[positive],
            data.values[positive],
            yerr=bars,
            fmt="sDo^v"[number % 5],
            color=BLACK,
            lw=1,
            label=plain(label + words.get(data.name, "")),
            **style,
        )
        if fit is not None:
            line, label = np.geomspace(*fit.span, 100), _UNNAMED
            if data.name not in words:
                label = plain(f"{data.name}: {fit.short_text()}")
            dashes = ("--", ":", "-.")[number % 3]
            axes.plot(line, fit(line), color=BLACK, lw=1, ls=dashes, label=label)


# -- of plugins -------------------------------------------------------------------------------------------------------


def brought_figures(
    results: Sequence[Entry], size: tuple[float, float] = _SIZE
) -> dict[str, tuple[Figure, str]]:
    """Draw every figure that plugins bring to one result or several: name -> figure and caption.

    What leaves its axes empty, because these results do not hold what it shows, is no figure. A name that another
    plugin, or chemage itself, has given to another figure gets a prefix, with a warning.
    """

    @lru_cache(maxsize=1)  # the maps of a large contact take 100 MB
    def maps(number: int) -> Maps:
        return Maps(**results[number].whole().maps())

    sources = []
    for number, entry in enumerate(results):
        chemistry = None
        with suppress(
            KeyError, ChemageError
        ):  # without provenance, or without the plugins that made it
            chemistry = (
                Chemistry.fromdict(entry.ageing.provenance["chemistry"])
                if entry.ageing is not None
                else None
            )
        more: Mapping[str, Any] = {
            "scene": entry.scene,
            "load_maps": partial(maps, number),
        }
        plotted = PlottedResult(
            entry.legend_name,
            entry.ageing,
            chemistry,
            PALETTE[number % len(PALETTE)],
            **more,
        )
        sources.append((entry, plotted))
    drawn: dict[str, tuple[Figure, str]] = {}
    owners = dict.fromkeys(CORE, "chemage itself")
    for plan in (*_of_components(sources), *_of_hooks(sources)):
        if not _NAME.fullmatch(plan.name):
            _warn(
                f"the figure {plan.name!r} of {plan.bringer} was left out: the name of a figure names a file"
            )
            continue
        name = plan.name
        while name in owners:
            name = f"{plan.prefix}-{name}"
        if name != plan.name:
            _warn(
                f"the figure {plan.name!r} of {plan.bringer} has the name of one of {owners[plan.name]}; "
                f"it is called {name!r} here"
            )
        owners[name] = plan.bringer
        figure = plan.drawn(size)
        if figure is not None:
            drawn[name] = figure, plan.caption
    return drawn


# -- parts of maps ----------------------------------------------------------------------------------------------------


def window_figure(path: Path, window: str | Sequence[float | str]) -> Figure:
    """Draw the part ``window`` of every map in the result file ``path``; only this part is read.

    ``window`` holds the edges x0, x1, y0, y1 (nm, or strings with a unit), as text or as a sequence.

    Raises
    ------
    InputError
        ``window`` is not four lengths, is empty, or lies outside the maps.
    StoreError
        The file is missing or damaged, or has no map.
    """
    edges = window.split() if isinstance(window, str) else list(window)
    if len(edges) != 4:
        raise InputError.of("window", window, "is not four lengths", _EXPECTED)
    lengths = []
    for edge in edges:
        try:
            lengths.append(float(edge))
        except ValueError:
            lengths.append(convert(edge, "nm"))
    with open_maps(path) as maps, drawn_as():
        figure, axes = plots(5.0 * len(maps) + 0.5, 4.4, len(maps), len(maps))
        for entry, (name, stored) in zip(axes, maps.items(), strict=True):
            label, pool, colours = _MAPS[name]
            part, extent = _part(stored, lengths, window)
            values = pooled(part, pool)
            shown = (
                np.ma.masked_equal(values, 0.0)
                if name == "contact/pressure"
                else values
            )
            draw_map(
                entry,
                shown,
                extent,
                f"{label} ({stored.unit})",
                cmap=colours or pressure_colours(),
            )
            entry.set_title(
                f"{part.shape[0]} x {part.shape[1]} pixels of {stored.pixel_size:g} nm"
            )
        arrange(figure)
    return figure


def _part(
    stored: StoredMap, edges: Sequence[float], window: object
) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """The pixels that the window touches, and what they cover: x0, x1, y0, y1, nm."""
    size, parts = stored.pixel_size, []
    for low, high, pixels in zip(
        edges[::2], edges[1::2], stored.shape, strict=True
    ):
        if not (0 <= low < high <= pixels * size * (1 + 1e-9)):
            sides = " x ".join(f"{side * size:g}" for side in stored.shape)
            raise InputError.of(
                "window",
                window,
                f"must lie within the map of {sides} nm",
                _EXPECTED,
            )
        parts.append(
            slice(math.floor(low / size), min(math.ceil(high / size), pixels))
        )
    x, y = parts
    return stored[x, y], (
        x.start * size,
        x.stop * size,
        y.start * size,
        y.stop * size,
    )
