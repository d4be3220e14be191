"""How a surface is shown: its size and roughness, its map, and its spectrum or a profile."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.figures import BLUE, decades_only, draw_map, pooled
from chemage.foundation.result import (
    CELL,
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    displays,
)
from chemage.surfaces.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: surfaces of more pixels show no slope that is not known yet: its spectrum takes longer than the picture
_MOST_PIXELS = 2**22


@displays(Surface)
class SurfaceDisplay(OfRecord[Surface]):
    """A surface as users see it."""

    def facts(self) -> Rows:
        surface = self.record
        (nx, ny), side = surface.shape, surface.pixel_size
        rows = [
            (
                "surface",
                f"{nx} x {ny} pixels of {side:g} nm, {nx * side:.5g} nm x {ny * side:.5g} nm",
            ),
            ("rms height", f"{surface.rms_height:.4g} nm"),
        ]
        if surface.heights.size <= _MOST_PIXELS or "rms_slope" in vars(surface):
            rows.append(("rms slope", f"{surface.rms_slope:.4g}"))
        return [*rows, ("periodic", "yes" if surface.periodic else "no")]

    def pictures(self) -> dict[str, Picture]:
        heights = Panel(
            self._draw_heights,
            "Heights of the surface; higher points are nearer to the counter-body.",
            f"Map of the heights of the surface, {self.record.shape[0]} x {self.record.shape[1]} pixels.",
            (4.9, 3.9),
            is_map=True,
            name="heights",
        )
        return {
            "surface": Picture(
                (heights, Panel(self._draw_spectrum, name="spectrum")), (10.5, 4.2)
            )
        }

    def _draw_heights(self, axes: Axes, medium: Medium) -> None:
        """Draw the heights as a map."""
        surface = self.record
        nx, ny = surface.shape
        extent = (0.0, nx * surface.pixel_size, 0.0, ny * surface.pixel_size)
        draw_map(
            axes,
            pooled(surface.heights, np.mean, medium.pixels),
            extent,
            "height (nm)",
            cmap="cividis",
        )
        if medium is not CELL:  # where the rows are beside it
            axes.set_title(
                f"rms height {surface.rms_height:.3g} nm, rms slope {surface.rms_slope:.3g}"
            )

    def _draw_spectrum(self, axes: Axes, medium: Medium) -> None:
        """Draw the power spectral density of a periodic surface, or else a profile."""
        surface = self.record
        nx, ny = surface.shape
        if surface.periodic and surface.rms_height > 0 and min(nx, ny) > 3:
            q, density = surface.psd()
            drawn = density > density.max() * 1e-14
            axes.loglog(
                q[drawn], density[drawn], color=BLUE, marker=".", ms=3, lw=1
            )
            axes.set(
                xlabel="wavenumber q (1/nm)",
                ylabel="power spectral density C(q) (nm$^4$)",
            )
            decades_only(axes.yaxis)
        else:
            x = (np.arange(nx) + 0.5) * surface.pixel_size
            axes.plot(
                x,
                surface.heights[:, ny // 2],
                color=BLUE,
                marker="." if nx < 3 else None,
            )
            axes.set(
                xlabel="x (nm)", ylabel="height (nm)", title="through the middle"
            )

    def maps(self) -> dict[str, Any]:
        return {"surface": self.record}

    def made_by(self) -> dict[str, Any]:
        return {"scene": {}, "contact": {"surface": self.record.provenance}}
