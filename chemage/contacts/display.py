"""How a contact is shown: its measures, the maps of its pressure, and the distribution of the pressure."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from chemage.contacts.role import elasticity_notes
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.figures import (
    BLUE,
    GREEN,
    draw_map,
    from_zero,
    pooled,
    pressure_colours,
    seen_blocks,
)
from chemage.foundation.quantities import Curve, Declared, Quantity
from chemage.foundation.result import (
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    displays,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: pixels around the largest patch that are drawn, at least, and the size of what is drawn over that of the patch
_WINDOW = 64, 2.0
#: the same of an only patch
_ONLY = 8, 1.3

PRESSURE = Declared("pressure", "GPa", "contact pressure")
PRESSURES = Curve(
    "pressures", "1/GPa", "density over the contact", axis_of=PRESSURE
)
C = TypeVar("C", ContactSolution, ContactStatistics)


class OfContact(OfRecord[C], Generic[C]):
    """What the two kinds of contact have in common."""

    def notes(self) -> list[str]:
        return [*super().notes(), *elasticity_notes(self.record)]

    def facts(self) -> Rows:
        return [("extent", self.extent())]

    def quantities(self) -> list[Quantity]:
        return self.record.quantities()

    def extent(self) -> str:
        """The size of the surface and its slope, in words."""
        raise NotImplementedError

    def solved(self) -> str:
        """How well it was solved, in words."""
        raise NotImplementedError

    def pressures(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The distribution of the pressure over the contact: bin edges (GPa), density (1/GPa)."""
        raise NotImplementedError

    def made_by(self) -> dict[str, Any]:
        return {"scene": {}, "contact": self.record.provenance}

    def curves(self) -> list[Curve]:
        """The distribution of the pressure."""
        if (distribution := self.pressures()) is None:
            return []
        edges, density = distribution
        return [PRESSURES.but(x=edges, mean=density)]


@displays(ContactSolution)
class ContactDisplay(OfContact[ContactSolution]):
    """A solved contact as users see it."""

    def extent(self) -> str:
        (nx, ny), contact = self.record.shape, self.record
        return f"{nx} x {ny} pixels of {contact.pixel_size:g} nm, rms slope {contact.rms_slope:.4g}"

    def solved(self) -> str:
        contact = self.record
        state = "converged" if contact.converged else "NOT CONVERGED"
        return f"{state}, residual {contact.residual:.3g}, {contact.iterations} iterations"

    def maps(self) -> dict[str, Any]:
        return {"contact": self.record}

    def pressures(self) -> tuple[np.ndarray, np.ndarray] | None:
        sites = self.record.sites.size
        return (
            self.record.pressure_histogram(bins=min(50, max(5, sites // 20)))
            if sites
            else None
        )

    def notes(self) -> list[str]:
        fault = (
            f"The contact did NOT converge: residual {self.record.residual:.3g}."
        )
        return [*([] if self.record.converged else [fault]), *super().notes()]

    def pictures(self) -> dict[str, Picture]:
        """The pressure over the whole contact, and around the largest patch with the outlines of patches.

        A contact of one patch is drawn once, where it is; without contact there is none.
        """
        contact = self.record
        if not contact.patches:
            return {}
        where = f"{contact.patches:g} patches on {100 * contact.area_fraction:.3g} % of the area"
        alt = f"Map of the contact pressure: {where}, mean {contact.mean_contact_pressure:.3g} GPa."
        panel = partial(Panel, size=(4.9, 3.9), is_map=True)
        if contact.patches == 1:
            caption = "Contact pressure; what is not in contact is blank."
            only = panel(self._draw_largest_patch, caption, alt, name="whole")
            return {"pressure": Picture((only,), (6.0, 4.6))}
        whole = panel(
            self._draw_pressure,
            "Contact pressure, the largest in each block of pixels; what is not in contact is blank. Blue: the part "
            "that is drawn around the largest patch.",
            alt,
            name="whole",
        )
        largest = panel(
            self._draw_largest_patch,
            "Pressure around the largest contact patch, outlined in green.",
            f"Map of the contact pressure around the largest of {contact.patches:g} patches.",
            name="largest-patch",
        )
        return {"pressure": Picture((whole, largest), (10.5, 4.8))}

    def _draw_pressure(self, axes: Axes, medium: Medium) -> None:
        """Draw the pressure as a map, each block of pixels that can be seen with its largest pressure, and the box of
        what is drawn around the largest patch."""
        from matplotlib.patches import Rectangle

        contact = self.record
        nx, ny = contact.shape
        extent = (0.0, nx * contact.pixel_size, 0.0, ny * contact.pixel_size)
        most = min(medium.pixels, seen_blocks(axes))
        self._draw_blocks(axes, slice(None), slice(None), most, extent)
        axes.set_title(
            f"{contact.patches} patches, A/A$_0$ = {contact.area_fraction:.3g}"
        )
        (x0, x1), (y0, y1) = np.multiply(
            self._around_largest_patch(), contact.pixel_size
        )
        axes.add_patch(
            Rectangle(
                (x0, y0),
                x1 - x0,
                y1 - y0,
                fill=False,
                edgecolor=BLUE,
                linewidth=1.2,
            )
        )

    def _draw_largest_patch(self, axes: Axes, medium: Medium) -> None:
        from matplotlib.collections import LineCollection

        contact = self.record
        a = contact.pixel_size
        (x0, x1), (y0, y1) = self._around_largest_patch()
        part = contact.contact[x0:x1, y0:y1]
        extent = (x0 * a, x1 * a, y0 * a, y1 * a)
        self._draw_blocks(axes, slice(x0, x1), slice(y0, y1), medium.pixels, extent)
        # thinner where pixels are small, so that outlines leave the pressure to be seen
        width = min(0.8, 160 / max(part.shape))
        # the pixel edges between contact and gap
        i, j = np.nonzero(np.diff(part, axis=0))
        upright = np.stack(
            [np.stack([i + 1, j], -1), np.stack([i + 1, j + 1], -1)], 1
        )
        i, j = np.nonzero(np.diff(part, axis=1))
        level = np.stack(
            [np.stack([i, j + 1], -1), np.stack([i + 1, j + 1], -1)], 1
        )
        edges = (np.concatenate([upright, level]) + np.array([x0, y0])) * a
        axes.add_collection(
            LineCollection(
                list(edges), colors=GREEN, linewidths=width, capstyle="round"
            )
        )
        only = f"1 patch, A/A$_0$ = {contact.area_fraction:.3g}"
        axes.set_title(only if contact.patches == 1 else "around the largest patch")

    def _draw_blocks(
        self,
        axes: Axes,
        rows: slice,
        columns: slice,
        most: int,
        extent: tuple[float, float, float, float],
    ) -> None:
        """Draw the largest pressure in each block of a part of the map, blank where there is no contact."""
        contact = self.record
        within = (
            contact.pressure
            if contact.touching is None
            else contact.pressure[contact.touching]
        )
        low = float(within.min(initial=np.inf))
        top = float(within.max(initial=0.0)) or 1.0
        pressure = np.where(
            contact.contact[rows, columns], contact.pressure[rows, columns], -np.inf
        )
        blocks = np.ma.masked_equal(pooled(pressure, np.max, most), -np.inf)
        style = {
            "cmap": pressure_colours(),
            "vmin": low if low < top else 0.0,
            "vmax": top,
        }
        draw_map(axes, blocks, extent, "pressure (GPa)", **style)

    def _around_largest_patch(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Pixels of a window around the largest patch, which is closer about an only one: (x0, x1), (y0, y1)."""
        from scipy import ndimage

        nx, ny = self.record.shape
        labels, count = ndimage.label(
            self.record.contact, structure=np.ones((3, 3))
        )  # pyright: ignore[reportGeneralTypeIssues]
        largest = (
            int(np.bincount(labels.ravel(), minlength=count + 1)[1:].argmax()) + 1
        )
        box = ndimage.find_objects(labels, max_label=largest)[largest - 1]
        least, margin = _ONLY if self.record.patches == 1 else _WINDOW
        side = max(
            least, math.ceil(margin * max(part.stop - part.start for part in box))
        )
        window = []
        for part, n in zip(box, (nx, ny), strict=True):
            low = max(0, min((part.start + part.stop - side) // 2, n - side))
            window.append((low, min(n, low + side)))
        return window[0], window[1]


@displays(ContactStatistics)
class StatisticsDisplay(OfContact[ContactStatistics]):
    """A contact without a map as users see it."""

    def extent(self) -> str:
        return f"{self.record.nominal_area:.5g} nm² without a map, rms slope {self.record.rms_slope:.4g}"

    def solved(self) -> str:
        return "a theory: nothing is solved"

    def pressures(self) -> tuple[np.ndarray, np.ndarray] | None:
        contact = self.record
        if contact.pressure.size < 2:
            return None
        edges = np.linspace(0.0, float(contact.pressure[-1]), 51)
        counts, _ = np.histogram(contact.pressure, edges, weights=contact.area)
        return edges, counts / (contact.contact_area * np.diff(edges))

    def pictures(self) -> dict[str, Picture]:
        return {"areas": Picture((Panel(self._draw_areas),))}

    def _draw_areas(self, axes: Axes, medium: Medium) -> None:
        contact = self.record
        above = np.cumsum(contact.area[::-1])[::-1]
        axes.step(
            np.append(0.0, contact.pressure),
            np.append(above, 0.0),
            where="post",
            color=BLUE,
        )
        axes.set(xlabel="pressure (GPa)", ylabel="contact area above it (nm$^2$)")
        axes.set_title(f"A/A$_0$ = {contact.area_fraction:.3g}")
        axes.set_xlim(left=0)
        from_zero(axes)
