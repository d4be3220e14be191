"""The figure of ``chemage roughness``: spectrum and height differences, what is not trusted shaded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from chemage import InputError
from chemage.plugin import figures
from chemage_surfaces.images import Image
from chemage_surfaces.measures import Measures
from chemage_surfaces.roughness_fit import RoughnessFit
from chemage_surfaces.spectra import Binned

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def roughness_figure(
    names: Sequence[str],
    images: Sequence[Image],
    measures: Sequence[Measures],
    fit: RoughnessFit | None,
) -> Figure:
    """The spectra of ``images`` that make surfaces, with the fit to all; and rms height differences by distance."""
    figure, (left, right) = figures.panels(9.0, 4.0, 2)
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
        for axis, profile, line in (("x", measured.x, "-"), ("y", measured.y, "--")):
            right.loglog(
                profile.distance,
                profile.difference,
                line,
                marker=".",
                color=color,
                label=f"{label}, along {axis}",
            )
    if fit is not None and fit.data is not None:
        q = np.geomspace(fit.data.q[0], fit.data.q[-1], 200)
        roll = 0.0 if fit.roll_off is None else 2 * math.pi / fit.roll_off
        law = fit.density * (np.maximum(q, roll) * fit.resolution / (2 * math.pi)) ** (
            -2 - 2 * fit.hurst
        )
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
            label=figures.plain(f"not trusted: {fit.limit}"),
        )
        left.set_xlim(right=end)
        start = right.get_xlim()[0]
        if fit.resolution / 2 > start:
            right.axvspan(start, fit.resolution / 2, color="0.9", zorder=0)
            right.set_xlim(left=start)
    else:
        left.text(0.5, 0.9, "no fit", ha="center", transform=left.transAxes)
    left.set(xlabel="wavenumber q (1/nm)", ylabel="power spectral density C (nm⁴)")
    right.set(xlabel="distance (nm)", ylabel="rms height difference (nm)")
    figures.decades_only(right.xaxis, left.xaxis)
    for axes in (left, right):
        figures.legend(axes, fontsize=8)
    return figure
