"""The figures of ``chemage roughness``: spectrum and height differences, what is not trusted shaded; and the images with
what was found in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chemage import InputError
from chemage.plugin import figures
from chemage_surfaces.findings import labelled
from chemage_surfaces.images import Image
from chemage_surfaces.measures import Measures
from chemage_surfaces.roughness_fit import RoughnessFit
from chemage_surfaces.spectra import Binned
from chemage_surfaces.steps import trend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


def save_figures(
    names: Sequence[str],
    images: Sequence[Image],
    measures: Sequence[Measures],
    fit: RoughnessFit | None,
    folder: Path,
    width: str | None,
    force: bool,
) -> None:
    """Draw and save both figures, for a screen or ``width`` wide for print; errors as of ``figures.save_figures``."""
    with figures.drawn_as(figures.Look.of(width)):
        drawn = {
            "roughness": roughness_figure(names, images, measures, fit),
            "findings": findings_figure(names, images),
        }
        figures.save_figures(drawn, folder, force=force)


def roughness_figure(
    names: Sequence[str],
    images: Sequence[Image],
    measures: Sequence[Measures],
    fit: RoughnessFit | None,
) -> Figure:
    """The spectra of ``images`` that make surfaces, with the fit to all; and rms height differences by distance."""
    figure, (left, right) = figures.plots(9.0, 4.0, 2, 2)
    for i, (name, image, measured) in enumerate(
        zip(names, images, measures, strict=True)
    ):
        color = figures.PALETTE[i % len(figures.PALETTE)]
        label = figures.plain(name)
        if not image.faults:
            try:
                data = Binned.of(image.surface())
                left.loglog(
                    data.q,
                    data.density,
                    "o",
                    ms=3,
                    mfc="none",
                    color=color,
                    label=label,
                )
            except InputError:  # too few pixels
                pass
        for axis, profile, line in (
            ("x", measured.x, "-"),
            ("y", measured.y, "--"),
        ):
            right.loglog(
                profile.distance,
                profile.difference,
                line,
                marker="o",
                ms=2.5,
                color=color,
                label=f"{label}, along {axis}",
            )
    if fit is not None and fit.data is not None:
        q = np.geomspace(fit.data.q[0], fit.data.q[-1], 200)
        roll = 0.0 if fit.roll_off is None else 2 * math.pi / fit.roll_off
        law = fit.density * (
            np.maximum(q, roll) * fit.resolution / (2 * math.pi)
        ) ** (-2 - 2 * fit.hurst)
        left.loglog(
            q,
            law,
            color=figures.BLACK,
            lw=1.2,
            zorder=3,
            label=f"fit, H = {fit.hurst:.2f} ± {fit.hurst_error:.2f}",
        )
        end = left.get_xlim()[1]
        left.axvspan(
            q[-1],
            end,
            color="0.9",
            zorder=0,
            label=figures.plain(f"not trusted:\n{fit.limit}"),
        )
        left.set_xlim(right=end)
        start = right.get_xlim()[0]
        if fit.resolution / 2 > start:
            right.axvspan(start, fit.resolution / 2, color="0.9", zorder=0)
            right.set_xlim(left=start)
    else:
        why = "no fit" if left.lines else "no fit: no image makes a surface"
        left.text(0.5, 0.9, why, ha="center", transform=left.transAxes)
    left.set(xlabel="wavenumber q (1/nm)", ylabel="power spectral density C (nm⁴)")
    right.set(xlabel="distance (nm)", ylabel="rms height difference (nm)")
    if not left.lines:
        left.set(xticks=[], yticks=[])
    for axes, place in ((left, "lower left"), (right, "lower right")):
        if len(images) > 1 and axes.lines:
            # spectra fall and differences rise, so that there is room below
            share = min(0.06 * len(axes.get_legend_handles_labels()[1]), 0.5)
            low, high = axes.get_ylim()
            axes.set_ylim(bottom=low * (low / high) ** (share / (1 - share)))
        for axis in (axes.xaxis, axes.yaxis) if axes.lines else ():
            _few_ticks(axis)
        frame = {"frameon": True, "framealpha": 0.8, "edgecolor": "none"}
        figures.legend(axes, loc=place, handlelength=3.0, **frame)
    return figure


def _few_ticks(axis: Axis) -> None:
    """Label decades, or 1, 2 and 5 of each where there are fewer than two of them."""
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    low, high = axis.get_view_interval()
    figures.decades_only(axis)
    if high < 100 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))


#: marks that show features of a few pixels, at most so many of a kind
MARKS = 40


def findings_figure(names: Sequence[str], images: Sequence[Image]) -> Figure:
    """The images, each with its findings at their places: pixels in colour with circles around small groups of them,
    periodic waves as bars of their length along their direction."""
    figure, plots = figures.plots(5.0 * len(images), 4.6, len(images), len(images))
    for axes, name, image in zip(plots, names, images, strict=True):
        _draw_findings(axes, image)
        axes.set_title(figures.plain(name))
    return figure


def _draw_findings(axes: Axes, image: Image) -> None:
    from matplotlib.colors import to_rgba
    from scipy import ndimage

    nx, ny = image.heights.shape
    dx, dy = image.sides
    extent = (0.0, nx * dx, 0.0, ny * dy)
    level = image.heights - trend(image.heights, 0 if image.periodic else 1)
    low, high = np.nanquantile(level, (0.02, 0.98))
    figures.draw_map(
        axes,
        figures.pooled(level, np.mean),
        extent,
        "height less its plane (nm)",
        cmap="gray",
        vmin=low,
        vmax=high,
    )
    for i, found in enumerate(image.findings):
        color = figures.PALETTE[1 + i % (len(figures.PALETTE) - 1)]
        label = f"{found.kind}: {found.consequence}"
        if found.where is not None and found.where.shape == (nx, ny):
            seen = figures.pooled(found.where, np.max)
            axes.imshow(
                np.where(seen.T[..., None], to_rgba(color, 0.8), 0.0),
                origin="lower",
                extent=extent,
                interpolation="nearest",
                aspect=axes.get_aspect(),
            )
            groups, _ = labelled(found.where)
            places = [
                (
                    0.5 * (box[0].start + box[0].stop) * dx,
                    0.5 * (box[1].start + box[1].stop) * dy,
                )
                for box in ndimage.find_objects(groups)
                if max(part.stop - part.start for part in box) < 0.03 * max(nx, ny)
            ][:MARKS]
            axes.plot(
                *(np.transpose(places) if places else ([], [])),
                "o",
                mfc="none",
                color=color,
                ms=7,
                label=label,
            )
        elif found.waves is not None:
            for wave in found.waves[:3]:
                step = 2 * math.pi * wave / float(wave @ wave)
                middle = 0.5 * np.array([nx * dx, ny * dy])
                ends = np.stack([middle - 2 * step, middle + 2 * step])
                axes.plot(*ends.T, color=color, lw=2, label=label)
                label = None
        else:
            axes.plot([], [], "s", color=color, label=label)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    if image.findings:
        from matplotlib.transforms import ScaledTranslation

        # below the label of the axis, whatever the size of the plot
        down = ScaledTranslation(0.0, -0.4, axes.figure.dpi_scale_trans)
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            bbox_transform=axes.transAxes + down,
            borderaxespad=0.0,
        )
