"""The figures of the paper, its supplement and our own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from chemage.plugin import figures as plots
from chemage.plugin import theory
from chemage_li2018 import published
from chemage_li2018.claims import barrier_moments, morphology
from chemage_li2018.estimates import variants
from chemage_li2018.sweeps import (
    KELVIN,
    LOAD,
    RADIUS,
    SEED,
    SLOPE,
    STRENGTH,
    PointSet,
    Studies,
    front,
    mean,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: size of the text of legends
SMALL = 7
_COLOURS = dict(zip(published.SLOPES, plots.PALETTE, strict=False))
_TIMES = dict(zip((1.0, 1e3, 1e5), plots.PALETTE, strict=False))
_BETWEEN_SURFACES = "bars and bands: standard deviation between surfaces"

#: name -> what draws the figure into panels, and their columns, rows, width and height (inches)
_DRAW: dict[
    str, tuple[Callable[[Sequence[Axes], Studies], None], tuple[int, int, float, float]]
] = {}
_Draw = Callable[["Sequence[Axes]", Studies], None]


def _figure(
    columns: int, rows: int = 1, width: float = 4.6, height: float = 3.9
) -> Callable[[_Draw], _Draw]:
    """Register the figure of the name of a function."""

    def registered(draw: _Draw) -> _Draw:
        _DRAW[draw.__name__] = draw, (columns, rows, width * columns, height * rows)
        return draw

    return registered


def drawn(name: str, studies: Studies) -> Figure:
    """Draw a figure, in which empty panels are left out and labels make legends."""
    draw, (columns, rows, width, height) = _DRAW[name]
    figure, axes = plots.panels(width, height, columns, rows, dpi=110)
    draw(axes, studies)
    for panel in axes:
        if panel.get_legend_handles_labels()[0] and panel.get_legend() is None:
            panel.legend(frameon=False, fontsize=SMALL, title_fontsize=SMALL)
    return figure


def _spread(values: np.ndarray) -> np.ndarray:
    """Standard deviation between surfaces, (n, ...) -> (...); 0 for a single one."""
    return values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:])


def _bars(
    axes: Axes, x: Iterable[float], values: Iterable[np.ndarray], **style: Any
) -> None:
    """Draw means over surfaces, of values (n,) each, with the standard deviation between them."""
    axes.figure.supxlabel(_BETWEEN_SURFACES, fontsize=SMALL)
    every = list(values)
    style = {
        "ms": 3,
        "lw": 1,
        "fmt": "o-",
        "capsize": 2,
        "elinewidth": 0.8,
        "color": plots.PALETTE[0],
        **style,
    }
    axes.errorbar(
        list(x),
        [one.mean() for one in every],
        yerr=[_spread(one) for one in every],
        **style,
    )


def _band(
    axes: Axes, x: np.ndarray, values: np.ndarray, *, steps: bool = False, **style: Any
) -> None:
    """Draw the mean of curves (n, m) and their standard deviation as a band; ``steps``: of a density between edges."""
    middle, half = values.mean(axis=0), _spread(values)
    if steps:
        axes.stairs(middle, x, **style)
        x = 0.5 * (x[1:] + x[:-1])
    else:
        axes.plot(x, middle, **style)
    if half.any():
        step: Any = {"step": "mid"} if steps else {}
        low = np.maximum(middle - half, 0) if steps else middle - half
        axes.fill_between(
            x, low, middle + half, color=style["color"], alpha=0.2, lw=0, **step
        )
        axes.figure.supxlabel(_BETWEEN_SURFACES, fontsize=SMALL)


#: observable -> its edges, what it is a density of, and the unit of that
_DENSITIES = {
    "barriers_start": ("barrier_edges", "E$_{form}$(t = 0)", "eV"),
    "pressures": ("pressure_edges", "pressure", "GPa"),
}


def _density(axes: Axes, points: PointSet, name: str, **style: Any) -> None:
    edges, label, unit = _DENSITIES[name]
    _band(
        axes, points[0].observables[edges], points.observed(name), steps=True, **style
    )
    axes.set(
        xlabel=f"{label} ({unit})",
        ylabel=f"density per site (1/{unit})",
        ylim=(0, None),
    )


def _at_times(
    axes: Axes,
    x: Iterable[float],
    groups: Iterable[PointSet],
    xlabel: str,
    *,
    coefficient: bool = False,
) -> None:
    """Draw ΔF or Δμ of groups of surfaces at three hold times."""
    every = list(groups)
    for time, colour in _TIMES.items():
        values = [
            one.coefficient_at(time) if coefficient else one.at(time) / 1000
            for one in every
        ]
        _bars(axes, x, values, color=colour, label=f"{time:g} s")
    axes.set(xlabel=xlabel, ylabel="Δμ" if coefficient else "ΔF (µN)", ylim=(0, None))


@_figure(3, width=4.8)
def fig1(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the heights of the first surface, the contact on it, and a part of the contact."""
    point = studies["reference"][0]
    contact, scene = point.computed.contact(), point.computed.scene()
    scene.surface.make(scene.surface_seed).plot(axes[0])
    _contact(axes[1], contact)
    # the square of an eighth of the width with the most contact
    width = max(8, contact.shape[0] // 8)
    share = ndimage.uniform_filter(
        contact.contact.astype(np.float32), width, mode="constant"
    )
    middle = np.array(np.unravel_index(int(np.argmax(share)), share.shape))
    corner = np.clip(middle - width // 2, 0, np.array(contact.shape) - width)
    part = contact.pressure[
        corner[0] : corner[0] + width, corner[1] : corner[1] + width
    ]
    x, y, size = (contact.pixel_size * pixels for pixels in (*corner, width))
    plots.draw_map(
        axes[2],
        np.ma.masked_equal(part, 0.0),
        (x, x + size, y, y + size),
        "pressure (GPa)",
        cmap="viridis",
    )
    axes[1].indicate_inset((x, y, size, size), edgecolor=plots.PALETTE[1], alpha=1)
    axes[2].set_title("pressure in the square", fontsize=9)
    axes[0].set_title(f"surface, seed {point.changes[SEED]}", fontsize=9)
    axes[1].set_title(
        f"contact at 20 µN, A/A$_0$ = {contact.area_fraction:.4f}", fontsize=9
    )


def _contact(axes: Axes, contact: Any) -> None:
    """Draw a contact in black."""
    side = contact.shape[0] * contact.pixel_size
    shown = plots.pooled(contact.contact, np.max, 500)
    axes.imshow(
        shown.T,
        origin="lower",
        extent=(0, side, 0, side),
        cmap="binary",
        interpolation="nearest",
    )
    axes.set(xticks=(0, 500, 1000), yticks=(0, 500, 1000))


@_figure(4, 2, 3.9, 3.4)
def fig2(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw barriers and pressures at three loads, and ΔF and Δμ against time, load and contact area."""
    groups = studies["loads"].by_load()
    for load, colour in zip((20.0, 100.0, 500.0), plots.PALETTE, strict=False):
        _density(
            axes[0],
            groups[load],
            "barriers_start",
            color=colour,
            label=f"E$_{{form}}$(0), {load:g} µN",
        )
        _density(axes[3], groups[load], "pressures", color=colour, label=f"{load:g} µN")
    _intrinsic(axes[0], groups[20.0])
    axes[3].set(xlim=(0, 8))
    for (load, group), colour in zip(groups.items(), plots.PALETTE, strict=False):
        _band(
            axes[1],
            group.times,
            np.maximum(group.drop, 1e-9) / 1000,
            label=f"{load:g} µN",
            color=colour,
            lw=1,
        )
        _band(axes[2], group.times, group.coefficient, color=colour, lw=1)
    axes[1].set(
        xscale="log",
        yscale="log",
        xlabel="hold time (s)",
        ylabel="ΔF (µN)",
        ylim=(1e-2, None),
    )
    axes[2].set(xscale="log", xlabel="hold time (s)", ylabel="Δμ", ylim=(0, None))
    area = [group.of("area_fraction").mean() for group in groups.values()]
    for place, (x, label) in enumerate(
        ((list(groups), "load (µN)"), (area, "A/A$_0$"))
    ):
        _at_times(axes[4 + 2 * place], x, groups.values(), label)
        _at_times(axes[5 + 2 * place], x, groups.values(), label, coefficient=True)
    for axis, name in zip(axes, "abbcdddd", strict=True):
        axis.set_title(f"({name})", loc="left", fontsize=10)


def _intrinsic(axes: Axes, points: PointSet) -> None:
    """Draw the densities of the intrinsic barriers to forming and to breaking."""
    chemistry = points[0].computed.scene().chemistry
    assert chemistry is not None
    energy = np.linspace(0.5, 1.5, 1001)
    forming = chemistry.forming.density(energy)
    if forming is not None:
        axes.plot(
            energy,
            forming,
            color=plots.GREY,
            lw=1.2,
            ls="--",
            label="intrinsic, forming",
        )
    breaking = (
        chemistry.breaking.density(energy) if chemistry.breaking is not None else None
    )
    if breaking is not None:
        style: dict[str, Any] = {"color": plots.PALETTE[3], "alpha": 0.4, "lw": 0}
        axes.fill_between(energy, breaking / 5, label="breaking (density / 5)", **style)
    axes.set(xlabel="barrier (eV)", xlim=(0.5, 1.45), ylim=(0, 6))


@_figure(3, 2, 4.6, 3.7)
def fig3(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ against hold time and against A/A0 for the rows of Table 1 at three slopes, with and without ΔV."""
    volumes = studies["rows"].by_volume()
    for line, (volume, points) in enumerate(volumes.items()):
        over_time, *over_area = axes[3 * line : 3 * line + 3]
        title = "ΔV = 6.4 Å$^3$" if volume else "ΔV = 0"
        for row, of_row in points.by_row().items():
            for slope, group in of_row.by(SLOPE).items():
                style: dict[str, Any] = {
                    "color": _COLOURS[slope],
                    "marker": row.marker,
                    "mfc": "none",
                    "lw": 0.7,
                }
                _band(
                    over_time,
                    group.times,
                    group.coefficient,
                    ms=3.5,
                    markevery=4,
                    **style,
                )
                area = group.of("area_fraction")
                for axis, time in zip(over_area, (1.0, 1e3), strict=True):
                    _bars(
                        axis,
                        [area.mean()],
                        [group.coefficient_at(time)],
                        xerr=_spread(area),
                        fmt="",
                        ms=5,
                        **style,
                    )
        over_time.set(
            xscale="log",
            xlabel="hold time (s)",
            ylabel="Δμ",
            title=title,
            ylim=(0, None),
        )
        for axis, time in zip(over_area, (1.0, 1e3), strict=True):
            axis.set(
                xlabel="A/A$_0$",
                ylabel="Δμ",
                title=f"{title}, {time:g} s",
                xlim=(0, None),
                ylim=(0, None),
            )
            axis.locator_params(axis="x", nbins=5)
    # the hold times at which the order of the slopes reverses, larger
    inset = axes[0].inset_axes((0.09, 0.36, 0.38, 0.34))
    for slope, group in volumes[6.4].circle().by(SLOPE).items():
        inside = (group.times >= 0.3) & (group.times <= 30)
        _band(
            inset,
            group.times[inside],
            group.coefficient[:, inside],
            color=_COLOURS[slope],
            lw=1,
        )
        axes[0].plot([], [], color=_COLOURS[slope], label=f"h' = {slope:g}")
    inset.set(xscale="log", ylim=(0, None))
    inset.set_title("circle", fontsize=SMALL)
    inset.tick_params(labelsize=6)
    for row in published.TABLE_1:
        axes[2].plot(
            [], [], row.marker, color=plots.GREY, ms=5, mfc="none", label=row.name
        )


@_figure(2)
def fig4(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the distributions of local pressure and of E_form(t = 0) at three slopes."""
    for slope, group in studies["slopes"].by_volume()[6.4].by(SLOPE).items():
        _density(
            axes[0], group, "pressures", color=_COLOURS[slope], label=f"h' = {slope:g}"
        )
        _density(axes[1], group, "barriers_start", color=_COLOURS[slope])
    axes[0].set(xlim=(0, 10))
    axes[1].set(xlim=(0.3, 1.5))
    for axis, name in zip(axes, "ab", strict=True):
        axis.set_title(f"({name})", loc="left", fontsize=10)


@_figure(3, 1, 4.0, 3.6)
def fig5(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ·A0/A at 1e3 s against C/A for the rows of Table 1 at three slopes, without ΔV."""
    groups = studies["rows"].by_volume()[0.0].by(SLOPE)
    for axis, (slope, group) in zip(axes, groups.items(), strict=True):
        for (row, of_row), colour in zip(
            group.by_row().items(), plots.PALETTE, strict=False
        ):
            axis.plot(
                *morphology(of_row),
                row.marker,
                ms=4,
                mfc="none",
                mew=0.8,
                color=colour,
                label=row.name,
            )
        x, y = morphology(group)
        ends = np.array([x.min(), x.max()])
        axis.plot(
            ends,
            np.polynomial.Polynomial.fit(x, y, 1)(ends),
            color=plots.GREY,
            lw=0.8,
            zorder=0,
        )
        axis.set_title(
            f"h' = {slope:g}, correlation {np.corrcoef(x, y)[0, 1]:.3f}", fontsize=9
        )
        axis.set(xlabel="C/A (1/nm)", ylabel="Δμ A$_0$/A at 1e3 s (axis not from 0)")


@_figure(2, 1, 5.2, 4.2)
def fig6(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw Δμ against hold time at half hydroxylation, and β by what it depends on, with κ of that contact."""
    left, right = axes
    half = front(studies, 0.5)
    _bars(left, half.times, half.coefficient.T, lw=1)
    left.set(xscale="log", xlabel="hold time (s)", ylabel="Δμ")
    readings = variants(studies)
    for place, (reading, colour) in enumerate(
        zip(readings.values(), plots.PALETTE, strict=False)
    ):
        right.errorbar(
            reading.value,
            -place,
            xerr=np.nan_to_num(reading.scatter),
            fmt="o",
            color=colour,
            capsize=3,
        )
    right.axvline(float(published.FIG_6_BETA), color=plots.GREY, lw=1, ls="--")
    names = [name.replace(" (", "\n(").replace(", ", ",\n", 1) for name in readings]
    right.set_yticks([-place for place in range(len(readings))], names, fontsize=7)
    right.set(xlabel="β", xlim=(0, None))
    right.set_title(
        f"dashed: paper, {published.FIG_6_BETA}; κ = {mean(half.of('kappa'))} at h' = 0.4",
        fontsize=9,
    )


@_figure(4, 2, 3.0, 3.2)
def maps(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the contact of each row of Table 1 on its first surface."""
    for axis, (row, group) in zip(
        axes, studies["table"].by_row().items(), strict=False
    ):
        _contact(axis, group[0].computed.contact())
        axis.set_title(
            f"{row.name}: H {row.hurst:g}, ζ {row.zeta:g}, η {row.eta:g}", fontsize=8
        )
    seed = studies["table"][0].changes[SEED]
    axes[-1].axis("off")
    axes[-1].text(
        0.0,
        0.5,
        f"x and y in nm\nh' = 0.05, 20 µN\nsurface seed {seed}\nblack: contact",
        fontsize=8,
    )


@_figure(1)
def areas(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the contact area against load."""
    (plot,) = axes
    groups = studies["loads"].by_load()
    _bars(plot, groups, [group.of("area_fraction") for group in groups.values()])
    paper = {load: float(value) for load, value in published.AREA_FRACTION.items()}
    plot.plot(
        list(paper),
        list(paper.values()),
        "s",
        ms=8,
        mfc="none",
        color=plots.PALETTE[1],
        label="paper",
    )
    slope = groups[20.0].of("area_fraction").mean() / 20.0
    plot.plot(
        [0, 500],
        [0, 500 * slope],
        color=plots.GREY,
        lw=0.8,
        ls="--",
        label="proportional to load, from 20 µN",
    )
    plot.set(xlabel="load (µN)", ylabel="A/A$_0$", xlim=(0, None), ylim=(0, None))


@_figure(2)
def barriers(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw the distribution of E_form(t = 0) at every load, and its mean against load."""
    groups = studies["loads"].by_load()
    for (load, group), colour in zip(groups.items(), plots.PALETTE, strict=False):
        _density(
            axes[0], group, "barriers_start", color=colour, label=f"{load:g} µN", lw=0.9
        )
    axes[0].set(xlim=(0.5, 1.45))
    edges = studies["loads"][0].observables["barrier_edges"]
    _bars(
        axes[1],
        groups,
        [
            barrier_moments(edges, group.observed("barriers_start"))[0]
            for group in groups.values()
        ],
    )
    axes[1].set(xlabel="load (µN)", ylabel="mean E$_{form}$(t = 0) (eV)", xscale="log")


@_figure(1)
def interaction(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw ΔF against the strength of the interaction."""
    groups = studies["interaction"].by(STRENGTH)
    _at_times(axes[0], groups, groups.values(), "I$_b$ (eV)")


@_figure(2)
def table1(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw our patches and contour lengths of the rows of Table 1 against those of the paper."""
    panels = (
        ("patches", "patches", "log", (8, 1500)),
        ("perimeter_to_area", "C/A (1/nm)", "linear", (0, 1.1)),
    )
    for panel, (name, label, scale, ends) in zip(axes, panels, strict=True):
        for (row, group), colour in zip(
            studies["table"].by_row().items(), plots.PALETTE, strict=False
        ):
            style: dict[str, Any] = {
                "fmt": row.marker,
                "color": colour,
                "ms": 6,
                "mfc": "none",
                "label": row.name,
            }
            _bars(panel, [float(getattr(row, name))], [group.of(name)], **style)
        panel.plot(ends, ends, color=plots.GREY, lw=0.8, zorder=0)
        panel.set(
            xlabel=f"{label}, paper",
            ylabel=f"{label}, ours",
            xscale=scale,
            yscale=scale,
            xlim=ends,
            ylim=ends,
        )


@_figure(3, width=4.3)
def kappa(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw contact area and κ against load with two theories, and κ of the rows of Table 1 and of Fig. 6."""
    left, middle, right = axes
    groups = studies["loads"].by_load()
    # the nominal pressure over modulus and rms slope
    reduced = {}
    for load, group in groups.items():
        summary = group[0].summary
        reduced[load] = summary["nominal_pressure"] / (
            summary["modulus"] * summary["rms_slope"]
        )
    x = np.array(list(reduced.values()))
    for name, label, marker in (
        ("area", "pixels in contact", "o"),
        ("corrected_area", "corrected for pixels", "s"),
    ):
        share = [group.of(name) / group.of("nominal_area") for group in groups.values()]
        style: dict[str, Any] = {
            "fmt": marker,
            "ms": 4,
            "mfc": "none" if name == "corrected_area" else None,
        }
        _bars(left, x, share, label=label, **style)
        _bars(
            middle,
            x,
            [one / place for one, place in zip(share, x, strict=True)],
            **style,
        )
    fine = np.linspace(0, x.max() * 1.05, 200)
    theories = (
        ("Persson", theory.persson_area_fraction, np.sqrt(8 / np.pi)),
        ("Bush, Gibson & Thomas", theory.bgt_area_fraction, np.sqrt(2 * np.pi)),
    )
    for (name, area, limit), colour in zip(theories, plots.PALETTE[1:], strict=False):
        left.plot(fine, area(fine), color=colour, label=name)
        middle.axhline(limit, color=colour, lw=0.8)
    left.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="A/A$_0$")
    middle.plot(
        reduced[20.0],
        float(published.KAPPA),
        "D",
        color=plots.GREY,
        ms=5,
        label="paper, 20 µN",
    )
    middle.set(xlabel="p̄ / (E* h'$_{rms}$)", ylabel="κ", ylim=(1.4, 3.0))
    span = published.PublishedNumber.of(published.KAPPA_ROWS)
    right.axhspan(
        span.low,
        span.high,
        color=plots.GREY,
        alpha=0.3,
        lw=0,
        label=f"paper, {span.text}",
    )
    named = {row.name: group for row, group in studies["table"].by_row().items()}
    named["Fig. 6"] = front(studies, 0.5)
    _bars(
        right,
        range(len(named)),
        [group.of("kappa") for group in named.values()],
        fmt="o",
        ms=4,
    )
    right.set_xticks(
        range(len(named)), list(named), rotation=40, ha="right", fontsize=7
    )
    right.set(ylabel="κ at 20 µN", ylim=(1.4, 3.0))


@_figure(2, width=4.4)
def temperature(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw β and ΔF against temperature, of a piece of the rough contact and of a tip."""
    for name, colour in zip(("rough", "tip"), plots.PALETTE, strict=False):
        groups = studies[f"warm {name}"].by(KELVIN)
        _bars(
            axes[0],
            groups,
            [group.beta() for group in groups.values()],
            color=colour,
            label=name,
        )
        for time, dashes in ((1e2, "--"), (1e4, "-")):
            drop = [group.at(time) for group in groups.values()]
            largest = max(values.mean() for values in drop)
            style = {
                "fmt": f"o{dashes}",
                "color": colour,
                "label": f"{name}, {time:g} s",
            }
            _bars(axes[1], groups, [values / largest for values in drop], **style)
    for panel, label in zip(
        axes, ("β over 10 to 1e4 s", "ΔF / its largest mean"), strict=True
    ):
        panel.axvline(300, color=plots.GREY, lw=0.8, ls=":")
        panel.set(xlabel="temperature (K)", ylabel=label, ylim=(0, None))


@_figure(2)
def tips(axes: Sequence[Axes], studies: Studies) -> None:
    """Draw ΔF and β of tips against load, with the published β of atomic force microscopy."""
    left, right = axes
    for (radius, group), colour in zip(
        studies["tips"].by(RADIUS).items(), plots.PALETTE, strict=False
    ):
        load = group.swept(LOAD)
        style = {"fmt": "o-", "ms": 3, "lw": 1, "color": colour, "capsize": 2}
        left.errorbar(
            load,
            group.at(1e3),
            yerr=group.half_width_at(1e3),
            label=f"R = {radius:g} nm",
            **style,
        )
        right.errorbar(
            load, group.of("beta"), yerr=group.of("beta_half_width"), **style
        )
    paper = {load: float(text) for load, text in published.TIP_BETA.items()}
    right.plot(
        list(paper),
        list(paper.values()),
        "s",
        ms=7,
        mfc="none",
        color=plots.GREY,
        label="paper (AFM)",
    )
    left.set(
        xlabel="load (nN)", ylabel="ΔF at 1e3 s (nN)", xlim=(0, None), ylim=(0, None)
    )
    left.set_title("bars: 95 % intervals over replicas", fontsize=9)
    right.set(xlabel="load (nN)", ylabel="β", xscale="log", yscale="log")


NAMES = tuple(_DRAW)
