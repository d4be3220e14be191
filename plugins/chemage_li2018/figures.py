"""The figures of the paper, its supplement and our own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from cycler import cycler
from scipy import ndimage

import chemage
from chemage.plugin import figures as plots
from chemage.plugin import theory
from chemage_li2018 import published, sweeps
from chemage_li2018.comparisons import variants
from chemage_li2018.measures import centres, moments, morphology
from chemage_li2018.published import TABLE_1
from chemage_li2018.sweeps import Groups, PointSet, Studies, front, mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, GREY, *_ = plots.PALETTE
_COLOURS = dict(zip(published.SLOPES, plots.PALETTE, strict=False))
_HOLD_TIME: dict[str, Any] = {"xscale": "log", "xlabel": "hold time (s)"}
#: how all figures look
_LOOK: dict[Any, Any] = {
    "axes.prop_cycle": cycler(color=plots.PALETTE),
    "lines.linewidth": 1,
    "lines.markersize": 4,
    "markers.fillstyle": "none",
    "errorbar.capsize": 2,
    "axes.titlesize": 9,
    "legend.fontsize": 7,
    "legend.frameon": False,
}

_Draw = Callable[["Sequence[Axes]", Studies], None]
#: name -> what draws the figure into panels, width and height (inches), columns and rows of these, their letters
_DRAW: dict[str, tuple[_Draw, tuple[float, float, int, int], str]] = {}


def _figure(
    columns: int,
    rows: int = 1,
    width: float = 4.6,
    height: float = 3.9,
    letters: str = "",
) -> Callable[[_Draw], _Draw]:
    """Register the figure of the name of a function."""

    def registered(draw: _Draw) -> _Draw:
        size = width * columns, height * rows, columns, rows
        _DRAW[draw.__name__] = draw, size, letters
        return draw

    return registered


def drawn(name: str, studies: Studies) -> Figure:
    """Draw a figure, in which labels make legends."""
    import matplotlib as mpl

    draw, size, letters = _DRAW[name]
    with mpl.rc_context(_LOOK):
        figure, axes = plots.panels(*size, dpi=110)
        draw(axes, studies)
        for panel, letter in zip_longest(axes, letters):
            plots.legend(panel)
            if letter:
                panel.set_title(f"({letter})", loc="left")
    return figure


def _spread(axes: Axes, values: np.ndarray) -> np.ndarray:
    """Standard deviation between surfaces, (n, ...) -> (...), of which the figure says what it is; 0 for one alone."""
    note = "bars and bands: standard deviation between surfaces"
    axes.figure.supxlabel(note, fontsize=7)
    return values.std(axis=0, ddof=min(1, len(values) - 1))


def _bars(axes: Axes, values: Mapping[Any, np.ndarray], **style: Any) -> None:
    """Draw means over surfaces, of values (n,) by their places, with the standard deviation between them."""
    each = values.values()
    means, spreads = [one.mean() for one in each], [_spread(axes, one) for one in each]
    axes.errorbar(list(values), means, spreads, **{"fmt": "o-", **style})


def _published(axes: Axes, numbers: Mapping[float, float], label: str) -> None:
    """Draw published numbers by their places."""
    axes.plot(*zip(*numbers.items(), strict=True), "s", ms=8, color=GREY, label=label)


def _band(axes: Axes, x: np.ndarray, values: np.ndarray, **style: Any) -> None:
    """Draw the mean of curves (n, m) and their standard deviation as a band."""
    middle, half = values.mean(axis=0), _spread(axes, values)
    (line,) = axes.plot(x, middle, **style)
    colour = line.get_color()
    axes.fill_between(x, middle - half, middle + half, color=colour, alpha=0.2, lw=0)


#: observable -> its edges, what it is a density of, and the unit of that
_DENSITIES = {
    "barriers_start": ("barrier_edges", "E$_{form}$(t = 0)", "eV"),
    "pressures": ("pressure_edges", "pressure", "GPa"),
}


def _density(axes: Axes, points: PointSet, name: str, **style: Any) -> None:
    edges, label, unit = _DENSITIES[name]
    x = centres(points[0].observables[edges])
    _band(axes, x, points.observed(name), **style)
    axes.set(xlabel=f"{label} ({unit})", ylabel=f"density per site (1/{unit})")
    axes.set_ylim(0)


def _at_times(axes: Axes, groups: Groups, xlabel: str, *, coefficient: bool) -> None:
    """Draw ΔF or Δμ of groups of surfaces at three hold times."""
    for time in (1.0, 1e3, 1e5):
        value = PointSet.coefficient_at if coefficient else PointSet.at
        unit = 1 if coefficient else 1000
        found = {x: value(group, time) / unit for x, group in groups.items()}
        _bars(axes, found, label=f"{time:g} s")
    axes.set(xlabel=xlabel, ylabel="Δμ" if coefficient else "ΔF (µN)", ylim=(0, None))


@_figure(3, width=4.8)
def fig1(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the heights of the first surface, the contact on it, and a part of the contact."""
    heights, whole, square = axes
    point = studies["reference"][0]
    contact, scene = point.computed.contact(), point.computed.scene()
    scene.surface.make(scene.surface_seed).plot(heights)
    _contact(whole, contact)
    # the square of an eighth of the width with the most contact
    width = max(8, contact.shape[0] // 8)
    touching = contact.contact.astype(np.float32)
    share = ndimage.uniform_filter(touching, width, mode="constant")
    middle = np.array(np.unravel_index(int(np.argmax(share)), share.shape))
    corner = np.clip(middle - width // 2, 0, np.array(contact.shape) - width)
    part = contact.pressure[tuple(slice(at, at + width) for at in corner)]
    x, y, size = (contact.pixel_size * pixels for pixels in (*corner, width))
    ends = x, x + size, y, y + size
    shown = np.ma.masked_equal(part, 0.0)
    plots.draw_map(square, shown, ends, "pressure (GPa)", cmap="viridis")
    whole.indicate_inset((x, y, size, size), edgecolor=ORANGE, alpha=1)
    heights.set_title(f"surface, seed {point.varied('seed')}")
    whole.set_title(f"contact at 20 µN, A/A$_0$ = {contact.area_fraction:.4f}")
    square.set_title("pressure in the square")


def _contact(axes: Axes, contact: Any) -> None:
    """Draw a contact in black."""
    side = contact.shape[0] * contact.pixel_size
    shown = plots.pooled(contact.contact, np.max, 500)
    look: Any = {"origin": "lower", "cmap": "binary", "interpolation": "nearest"}
    axes.imshow(shown.T, extent=(0, side, 0, side), **look)
    axes.set(xticks=(0, 500, 1000), yticks=(0, 500, 1000))


@_figure(4, 2, 3.9, 3.4, "abbcdddd")
def fig2(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw barriers and pressures at three loads, and ΔF and Δμ against time, load and contact area."""
    start, drop, coefficient, pressures, *against = axes
    groups = studies["loads"].by_load()
    for load in (20.0, 100.0, 500.0):
        label = f"E$_{{form}}$(0), {load:g} µN"
        _density(start, groups[load], "barriers_start", label=label)
        _density(pressures, groups[load], "pressures", label=f"{load:g} µN")
    _intrinsic(start)
    pressures.set(xlim=(0, 8))
    for load, group in groups.items():
        values = np.maximum(group.drop, 1e-9) / 1000
        _band(drop, group.times, values, label=f"{load:g} µN")
        _band(coefficient, group.times, group.coefficient)
    drop.set(**_HOLD_TIME, yscale="log", ylabel="ΔF (µN)", ylim=(1e-2, None))
    coefficient.set(**_HOLD_TIME, ylabel="Δμ", ylim=(0, None))
    of_area = Groups((g.of("area_fraction").mean(), g) for g in groups.values())
    for place, panels in ((groups, against[:2]), (of_area, against[2:])):
        label = "load (µN)" if place is groups else "A/A$_0$"
        for axis in panels:
            _at_times(axis, place, label, coefficient=axis is panels[1])


def _intrinsic(axes: Axes) -> None:
    """Draw the densities of the intrinsic barriers to forming and to breaking."""
    chemistry = chemage.load_scene(sweeps.BASES["rough"]["scene"]).chemistry
    assert chemistry is not None
    assert chemistry.breaking is not None
    energy = np.linspace(0.5, 1.5, 1001)
    forming = chemistry.forming.density(energy)
    breaking = chemistry.breaking.density(energy) / 5
    axes.plot(energy, forming, "--", color=GREY, label="intrinsic, forming")
    label = "breaking (density / 5)"
    axes.fill_between(energy, breaking, alpha=0.4, color=PURPLE, label=label)
    axes.set(xlabel="barrier (eV)", xlim=(0.5, 1.45), ylim=(0, 6))


@_figure(3, 2, 4.6, 3.7)
def fig3(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ against hold time and against A/A0 for the rows of Table 1 at three slopes, with and without ΔV."""
    volumes = studies["rows"].by_volume()
    for line, (volume, points) in enumerate(volumes.items()):
        over_time, *over_area = axes[3 * line : 3 * line + 3]
        title = "ΔV = 6.4 Å$^3$" if volume else "ΔV = 0"
        for (row, of_row), slope in product(points.by_row().items(), _COLOURS):
            group = of_row.by("rms_slope")[slope]
            style: Any = {"color": _COLOURS[slope], "marker": row.marker}
            _band(over_time, group.times, group.coefficient, markevery=4, **style)
            area = group.of("area_fraction")
            for axis, time in zip(over_area, (1.0, 1e3), strict=True):
                value = {area.mean(): group.coefficient_at(time)}
                _bars(axis, value, xerr=_spread(axis, area), fmt="", **style)
                axis.set(xlabel="A/A$_0$", ylabel="Δμ", title=f"{title}, {time:g} s")
        over_time.set(**_HOLD_TIME, ylabel="Δμ", title=title, ylim=(0, None))
        for axis in over_area:
            axis.set(xlim=(0, None), ylim=(0, None))
            axis.locator_params(axis="x", nbins=5)
    # the hold times at which the order of the slopes reverses, larger
    inset = axes[0].inset_axes((0.09, 0.36, 0.38, 0.34))
    for slope, group in volumes[6.4].by_row()[TABLE_1[0]].by("rms_slope").items():
        inside = (group.times >= 0.3) & (group.times <= 30)
        _band(inset, group.times[inside], group.coefficient[:, inside])
        axes[0].plot([], [], color=_COLOURS[slope], label=f"h' = {slope:g}")
    inset.set(xscale="log", ylim=(0, None), title="circle")
    for row in TABLE_1:
        axes[2].plot([], [], row.marker, color=GREY, label=row.name)


@_figure(2, letters="ab")
def fig4(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the distributions of local pressure and of E_form(t = 0) at three slopes."""
    pressures, start = axes
    for slope, group in studies["slopes"].by_volume()[6.4].by("rms_slope").items():
        _density(pressures, group, "pressures", label=f"h' = {slope:g}")
        _density(start, group, "barriers_start")
    pressures.set(xlim=(0, 10))
    start.set(xlim=(0.3, 1.5))


@_figure(3, 1, 4.0, 3.6)
def fig5(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ·A0/A at 1e3 s against C/A for the rows of Table 1 at three slopes, without ΔV."""
    groups = studies["rows"].by_volume()[0.0].by("rms_slope")
    for axis, (slope, group) in zip(axes, groups.items(), strict=True):
        for row, of_row in group.by_row().items():
            x, y = morphology(of_row)
            mark = {"marker": row.marker, "ms": 8, "mew": 1.6, "label": row.name}
            (middle,) = axis.plot(x.mean(), y.mean(), ls="", **mark)
            error = of_row.half_width_at(1e3) / of_row.of("load")
            style: Any = {"fmt": row.marker, "color": middle.get_color(), "alpha": 0.4}
            axis.errorbar(x, y, error / of_row.of("area_fraction"), **style)
        x, y = morphology(group)
        ends = np.array([x.min(), x.max()])
        line = np.polynomial.Polynomial.fit(x, y, 1)
        axis.plot(ends, line(ends), color=GREY, zorder=0)
        straight = np.corrcoef(x, y)[0, 1]
        axis.set_title(f"h' = {slope:g}, correlation {straight:.3f}")
        axis.set(xlabel="C/A (1/nm)", ylabel="Δμ A$_0$/A at 1e3 s (axis not from 0)")
    note = "large: means of rows; small: surfaces, bars: 95 % intervals over replicas"
    axes[0].figure.supxlabel(note, fontsize=7)


@_figure(2, 1, 5.2, 4.2)
def fig6(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ against hold time at half hydroxylation, and β by what it depends on, with κ of that contact."""
    left, right = axes
    half = front(studies, 0.5)
    _band(left, half.times, half.coefficient, marker="o")
    left.set(**_HOLD_TIME, ylabel="Δμ")
    readings = variants(studies)
    for place, beta in enumerate(readings.values()):
        right.errorbar(beta.value, -place, xerr=np.nan_to_num(beta.scatter), fmt="o")
    right.axvline(published.FIG_6_BETA, color=GREY, ls="--")
    names = [name.replace(" (", "\n(").replace(", ", ",\n", 1) for name in readings]
    right.set_yticks([-place for place in range(len(names))], names, fontsize=7)
    right.set(xlabel="β", xlim=(0, None))
    kappas = f"κ = {mean(half.of('kappa'))} at h' = 0.4"
    right.set_title(f"dashed: paper, {published.FIG_6_BETA}; {kappas}")


@_figure(4, 2, 3.0, 3.2)
def maps(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the contact of each row of Table 1 on its first surface."""
    *panels, last = axes
    rows = studies["table"].by_row().items()
    for axis, (row, group) in zip(panels, rows, strict=True):
        _contact(axis, group[0].computed.contact())
        axis.set_title(f"{row.name}: H {row.hurst:g}, ζ {row.zeta:g}, η {row.eta:g}")
    seed = studies["table"][0].varied("seed")
    about = f"x and y in nm\nh' = 0.05, 20 µN\nsurface seed {seed}\nblack: contact"
    last.axis("off")
    last.text(0.0, 0.5, about)


@_figure(1)
def areas(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the contact area against load."""
    (plot,) = axes
    area = studies["loads"].by_load().each(lambda group: group.of("area_fraction"))
    _bars(plot, area)
    paper = published.by_load("kappa", "area_fraction")
    _published(plot, {at / 1000: area for at, area in paper.items()}, "paper")
    end = 500 * area[20.0].mean() / 20.0
    label = "proportional to load, from 20 µN"
    plot.plot([0, 500], [0, end], "--", color=GREY, label=label)
    plot.set(xlabel="load (µN)", ylabel="A/A$_0$", xlim=(0, None), ylim=(0, None))


@_figure(2)
def barriers(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the distribution of E_form(t = 0) at every load, and its mean against load."""
    left, right = axes
    groups = studies["loads"].by_load()
    for load, group in groups.items():
        _density(left, group, "barriers_start", label=f"{load:g} µN")
    left.set(xlim=(0.5, 1.45))
    middle = groups.each(
        lambda group: moments(group, "barriers_start", "barrier_edges")[0]
    )
    _bars(right, middle)
    right.set(xlabel="load (µN)", ylabel="mean E$_{form}$(t = 0) (eV)", xscale="log")


@_figure(1)
def interaction(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw ΔF against the strength of the interaction."""
    groups = studies["interaction"].by("strength")
    _at_times(axes[0], groups, "I$_b$ (eV)", coefficient=False)


@_figure(2)
def table1(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw our patches and contour lengths of the rows of Table 1 against those of the paper."""
    for panel, name, label, scale, ends in (
        (axes[0], "patches", "patches", "log", (8, 1500)),
        (axes[1], "perimeter_to_area", "C/A (1/nm)", "linear", (0, 1.1)),
    ):
        for row, group in studies["table"].by_row().items():
            paper = float(getattr(row, name))
            _bars(panel, {paper: group.of(name)}, fmt=row.marker, label=row.name)
        panel.plot(ends, ends, color=GREY, zorder=0)
        panel.set(xlabel=f"{label}, paper", ylabel=f"{label}, ours")
        panel.set(xscale=scale, yscale=scale, xlim=ends, ylim=ends)


@_figure(3, width=4.3)
def kappa(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw contact area and κ against load with two theories, and κ of the rows of Table 1 and of Fig. 6."""
    left, middle, right = axes
    loads = studies["loads"].by_load()
    # by the nominal pressure over modulus and rms slope
    reduced = loads.each(
        lambda g: (g.of("nominal_pressure") / g.of("modulus") / g.of("rms_slope"))[0]
    )
    groups = Groups((reduced[load], group) for load, group in loads.items())
    for name, style in (
        ("area", {"fmt": "o-", "label": "pixels in contact"}),
        ("corrected_area", {"fmt": "s-", "label": "corrected for pixels"}),
    ):
        share = groups.each(lambda g, name=name: g.of(name) / g.of("nominal_area"))
        _bars(left, share, color=BLUE, **style)
        relative = {x: one / x for x, one in share.items()}
        _bars(middle, relative, fmt=style["fmt"], color=BLUE)
    fine = np.linspace(0, max(groups) * 1.05, 200)
    for name, area, limit, colour in (
        ("Persson", theory.persson_area_fraction, 8 / np.pi, ORANGE),
        ("Bush, Gibson & Thomas", theory.bgt_area_fraction, 2 * np.pi, GREEN),
    ):
        left.plot(fine, area(fine), color=colour, label=name)
        middle.axhline(np.sqrt(limit), color=colour)
    middle.plot(reduced[20.0], published.KAPPA, "D", color=GREY, label="paper, 20 µN")
    span = published.PublishedNumber.of(published.ROWS["kappa"][0][1])
    label = f"paper, {span.text}"
    right.axhspan(span.low, span.high, color=GREY, alpha=0.3, label=label)
    rows = {row.name: group for row, group in studies["table"].by_row().items()}
    rows["Fig. 6"] = front(studies, 0.5)
    _bars(right, {name: one.of("kappa") for name, one in rows.items()}, fmt="o")
    right.set_xticks(range(len(rows)), list(rows), rotation=40, ha="right", fontsize=7)
    left.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="A/A$_0$")
    middle.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="κ", ylim=(1.4, 3.0))
    right.set(ylabel="κ at 20 µN", ylim=(1.4, 3.0))


@_figure(2, width=4.4)
def temperature(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw β and ΔF against temperature, of a piece of the rough contact and of a tip."""
    left, right = axes
    for name in ("rough", "tip"):
        groups = studies[f"warm {name}"].by("temperature")
        _bars(left, groups.each(PointSet.beta), label=name)
        for time in (1e2, 1e4):
            drop = {kelvin: group.at(time) for kelvin, group in groups.items()}
            largest = max(values.mean() for values in drop.values())
            relative = {kelvin: values / largest for kelvin, values in drop.items()}
            _bars(right, relative, label=f"{name}, {time:g} s")
    left.set(ylabel="β over 10 to 1e4 s")
    right.set(ylabel="ΔF / its largest mean")
    for panel in axes:
        panel.axvline(300, color=GREY, ls=":")
        panel.set(xlabel="temperature (K)", ylim=(0, None))


@_figure(2)
def tips(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw ΔF and β of tips against load, with the published β of atomic force microscopy."""
    left, right = axes
    for radius, group in studies["tips"].by("radius").items():
        load, error = group.swept("load"), group.half_width_at(1e3)
        label = f"R = {radius:g} nm"
        left.errorbar(load, group.at(1e3), error, fmt="o-", label=label)
        right.errorbar(load, group.of("beta"), group.of("beta_half_width"), fmt="o-")
    _published(right, published.by_load("tips", "beta"), "paper (AFM)")
    left.set(xlabel="load (nN)", ylabel="ΔF at 1e3 s (nN)")
    left.set(xlim=(0, None), ylim=(0, None), title="bars: 95 % intervals over replicas")
    right.set(xlabel="load (nN)", ylabel="β", xscale="log", yscale="log")


NAMES = tuple(_DRAW)
