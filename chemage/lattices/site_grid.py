"""The contact at the sites: which sites of the chemistry's own grid are in contact, and under which pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import InputError
from chemage.foundation.memory import require
from chemage.foundation.records import frozen
from chemage.foundation.statistics import NORMAL_LIMIT
from chemage.foundation.threads import OncePerObject

#: what is said of a grid of sites that is that of the pixels
ONE_PER_PIXEL = "one site per pixel"
#: sites are pixels where their spacing is that of the pixels within this part, so that they are as many within twice it
SAME = 0.005
#: ... which is said from this part on
NEGLIGIBLE = 5e-4
#: sites of more pixels a side are in contact where about half of their square is, others where the rim says so
MOST_PIXELS = 4
#: random numbers of pairs of sites are told apart up to here
MOST_SITES = 2**48
#: memory of a site in contact while it is placed
BYTES_PER_SITE = 40.0
#: A contact of "loaded" pixels reaches this many pixels beyond the rim, (π − 1 + ln 2)/24 · 4/π of Yastrebov, Anciaux &
#: Molinari, J. Mech. Phys. Solids 107, 469 (2017), as the outline of pixels is 4/π times as long as the rim, ...
REACH = (math.pi - 1 + math.log(2)) / 24 * 4 / math.pi
#: ... and the rim reconstructed from such a contact reaches this many pixels further; without the gap this many. Then
#: both for pixels in contact if their centres are. Measured by tests/benchmarks/site_constants.py, on rough surfaces
#: (the first two) and on spheres, with a scatter of 0.01, 0.01, 0.01 and 0.03.
BEYOND = 0.04
BEYOND_WITHOUT_GAP = 0.02
BEYOND_CENTRES = 0.0
BEYOND_CENTRES_WITHOUT_GAP = -0.10
#: how fast the share of a site in contact falls as the rim moves, per spacing, where half of it is: the length of the
#: rim in the site, 1/max(|cos|, |sin|) of its direction, averaged over directions
FALL = 4 / math.pi * math.log(1 + math.sqrt(2))
#: Standard deviation of the number of sites, per edge between a site in contact and one outside, which do not average
#: out, in sites per pixel a side (at least the second number): with the gap and without; and of averages. Then what
#: does average out, per root of the edges. Measured on 400, 150 and 80 random contacts; tested on others by
#: tests/benchmarks/stated_errors.py
ALIKE = (0.015, 0.5)
ALIKE_WITHOUT_GAP = (0.045, 0.6)
ALIKE_AVERAGED = 0.024
APART = 0.23
#: passes in which the rim and its normal are found
PASSES = 2

Density = float | Literal["pixel", "given"]
#: what a surface records that has sites of its own: their positions, (n, 2) nm from the corner of its grid
SITE_POSITIONS = "site_positions"
#: how sites belong to pixels: each is a pixel; the rim is found between pixels; each has many pixels
Rule = Literal["pixels", "reconstructed", "averaged"]


def site_shape(
    pixels: tuple[int, int], pixel_size: float, density: Density
) -> tuple[int, int]:
    """The grid of sites on a contact of ``pixels`` of ``pixel_size`` nm: the pixels themselves where ``density`` is
    "pixel" or "given", or where the spacing of ``density`` (1/nm²) agrees with them within half a percent.

    The number of sites along a side is rounded, so that the grid is as periodic as the contact.

    Raises
    ------
    InputError
        There would be no site, or more than random numbers can tell apart.
    """
    if isinstance(density, str):
        return pixels
    ratio = pixel_size * math.sqrt(density)
    if abs(ratio - 1.0) < SAME:
        return pixels
    nx, ny = (count * ratio for count in pixels)
    if not nx * ny <= MOST_SITES:
        remedy = "give a smaller one, fewer pixels or a smaller pixel size"
        raise InputError.of(
            "site_density",
            density,
            f"gives {nx:.3g} x {ny:.3g} sites on this contact",
            remedy,
        )
    if max(nx, ny) < 0.5:
        raise InputError.of(
            "site_density",
            density,
            f"gives less than one site on pixels of {pixel_size:g} nm",
            "give it per nm²",
        )
    return max(round(nx), 1), max(round(ny), 1)


def site_rule(pixels: tuple[int, int], sites: tuple[int, int]) -> Rule:
    """How a grid of ``sites`` belongs to one of ``pixels``."""
    if sites == pixels:
        return "pixels"
    few = all(p <= MOST_PIXELS * s for p, s in zip(pixels, sites, strict=True))
    return "reconstructed" if few else "averaged"


def in_words(
    pixels: tuple[int, int],
    sites: tuple[int, int],
    gap: bool = True,
    ratio: float = 1.0,
) -> str:
    """What a grid of ``sites`` is to one of ``pixels``, in words; ``ratio``: sites per pixel of the chemistry."""
    rule = site_rule(pixels, sites)
    if rule == "pixels":
        more = 1 / ratio - 1
        if abs(more) < NEGLIGIBLE:
            return ONE_PER_PIXEL
        return f"{ONE_PER_PIXEL}, {100 * abs(more):.2g} % {'more' if more > 0 else 'fewer'} than site_density"
    grids = f"{sites[0]} x {sites[1]} sites on {pixels[0]} x {pixels[1]} pixels"
    per = sites[0] * sites[1] / (pixels[0] * pixels[1])
    if rule == "averaged":
        return f"{grids}, {1 / per:.3g} pixels per site: pressure averaged over the pixels of a site"
    if per < 1:
        words = f"{grids}, {1 / per:.3g} pixels per site: pressure averaged over the pixels of a site, the rim "
        return words + (
            "between pixels"
            if gap
            else "halfway between pixels because the contact has no gap"
        )
    if gap:
        return f"{grids}, {per:.3g} sites per pixel: pressure and rim reconstructed below the pixel"
    return (
        f"{grids}, {per:.3g} sites per pixel: pressure reconstructed below the pixel, the rim halfway between pixels "
        "because the contact has no gap (bonds err by several percent; give the solver gap = true)"
    )


def nominal_ratio(pixel_size: float, density: Density) -> float:
    """Sites per pixel as ``density`` has it."""
    return 1.0 if isinstance(density, str) else density * pixel_size**2


@dataclass(frozen=True, eq=False)
class ContactSites:
    """The sites in contact, on the chemistry's own grid."""

    #: (mx, my) sites along each side of the surface
    shape: tuple[int, int]
    #: distance of neighbouring sites, nm
    spacing: float
    #: whether the grid repeats
    periodic: bool
    #: corner of the grid of sites, nm from that of the pixels
    origin: tuple[float, float]
    #: (n,) int64: flat indices of the sites in contact, ascending
    sites: np.ndarray
    #: (n,) GPa, above zero unless the surfaces adhere
    pressure: np.ndarray
    #: how sites and pixels belong together
    rule: Rule
    #: the same in words
    words: str

    def relative_error(self, contact: ContactSolution) -> float:
        """Relative error of the number of sites that 5 of 100 contacts exceed; 0 where sites are pixels."""
        if self.rule == "pixels" or not self.sites.size:
            return 0.0
        edges, size = self._edges(), contact.pixel_size / self.spacing
        slope, least = ALIKE if contact.gap is not None else ALIKE_WITHOUT_GAP
        alike = (
            ALIKE_AVERAGED if self.rule == "averaged" else slope * max(size, least)
        )
        return (
            NORMAL_LIMIT
            * math.hypot(alike * edges, APART * max(size, 1.0) * math.sqrt(edges))
            / self.sites.size
        )

    def _edges(self) -> int:
        """Edges between a site in contact and one that is not, or the end of the grid."""
        within = np.ones(self.sites.size, bool)
        pairs = 0
        for axis in (0, 1):
            row, column = np.divmod(self.sites, self.shape[1])
            (row if axis == 0 else column)[:] += 1
            if self.periodic:
                row, column = row % self.shape[0], column % self.shape[1]
            else:
                within = (row < self.shape[0]) & (column < self.shape[1])
            at = row * self.shape[1] + column
            place = np.minimum(np.searchsorted(self.sites, at), self.sites.size - 1)
            pairs += int(np.count_nonzero((self.sites[place] == at) & within))
        return 4 * self.sites.size - 2 * pairs

    def describe(self, contact: ContactSolution) -> dict[str, Any]:
        """Grids of sites and pixels, what they are to each other, and the error of the number of sites (see
        :meth:`relative_error`), as plain JSON values."""
        error = self.relative_error(contact)
        error_words = f"; their number within {100 * error:.2g} %" if error else ""
        return {
            "relative_error": error,
            "sites": list(self.shape),
            "spacing": self.spacing,
            "touching": self.sites.size,
            "pixels": list(contact.shape),
            "pixel_size": contact.pixel_size,
            "rule": self.rule,
            "words": self.words + error_words,
        }


#: of each contact, by density
_kept: OncePerObject[ContactSites] = OncePerObject()


def contact_sites(
    contact: ContactSolution, density: Density, pressed: bool = False
) -> ContactSites:
    """The sites of ``density`` (1/nm², "pixel", or "given") that are in contact, and their pressures.

    Site (0, 0) is at pixel (0, 0) of a periodic contact; on one that is not, both grids cover the same square. Where
    both grids are the same, the pressures are those of the pixels. Otherwise the rim is found between the pixels: with
    the distance d from it the pressure inside is proportional to √d, the gap outside to d^(3/2) (as in the contact of
    Hertz, K. L. Johnson, Contact Mechanics, eqs. 3.39 and 3.42, expanded at its rim), so that the square of the
    pressure and the gap to the power ⅔, both on one scale, are a function that is smooth across the rim. It is
    interpolated by cubic convolution. Sites that are smaller than pixels have its pressures, scaled so that the load on
    every neighbourhood of pixels is kept; larger ones have the mean pressure of the pixels in their square. Those of
    more than four pixels a side are in contact where about half of the square is. The whole load is kept. The sites in
    contact are an estimate of the pixels that would be in contact on a grid of one pixel per site.

    Where the surfaces adhere there is tension at the rim and no such law of it: sites are pixels, or larger than they
    are and averaged. With ``pressed`` those under tension are left out.

    "given" sites are the pixels in which its makers recorded one, as :data:`SITE_POSITIONS`.

    Raises
    ------
    InputError
        The surfaces adhere, and sites are smaller than pixels; the surface has no sites, or several in a pixel.

    Results are kept as long as the contact is, because replicas share them.
    """
    return _kept.get(
        contact, (density, pressed), lambda: _made(contact, density, pressed)
    )


def _made(
    contact: ContactSolution, density: Density, pressed: bool
) -> ContactSites:
    shape = site_shape(contact.shape, contact.pixel_size, density)
    rule = site_rule(contact.shape, shape)
    size = contact.pixel_size
    if contact.touching is not None and rule == "reconstructed":
        if shape[0] * shape[1] > contact.pressure.size:
            raise InputError.of(
                "site_density", density, *adhering(contact.pixel_size, density)
            )
        rule = "averaged"
    if rule == "pixels":
        sites, pressure = contact.sites, contact.pressure.ravel()[contact.sites]
    else:
        size *= math.sqrt(contact.pressure.size / (shape[0] * shape[1]))
        expected = contact.sites.size * (contact.pixel_size / size) ** 2
        require(
            BYTES_PER_SITE * expected,
            f"{expected:.3g} sites in contact",
            "use a smaller site_density",
        )
        make = _reconstructed if rule == "reconstructed" else _averaged
        sites, pressure = (
            make(contact, shape, size)
            if contact.sites.size
            else (contact.sites, np.empty(0))
        )
    # site (0, 0) is in the middle of pixel (0, 0) where both grids repeat
    corner = (
        0.5 * (contact.pixel_size - size)
        if contact.periodic and rule != "pixels"
        else 0.0
    )
    words = in_words(
        contact.shape,
        shape,
        contact.gap is not None,
        nominal_ratio(contact.pixel_size, density),
    )
    if density == "given":
        own = _of_surface(contact)
        there = np.isin(sites, own)
        sites, pressure = sites[there], pressure[there]
        words = f"the {own.size} sites of the surface"
    if pressed:
        sites, pressure = sites[pressure > 0], pressure[pressure > 0]
    arrays = frozen(sites, np.int64), frozen(pressure)
    return ContactSites(
        shape, size, contact.periodic, (corner, corner), *arrays, rule, words
    )


def _of_surface(contact: ContactSolution) -> np.ndarray:
    """Flat indices of the pixels that have a site of the surface."""
    positions = contact.observables.get(SITE_POSITIONS)
    if positions is None:
        raise InputError(
            'site_density = "given": this surface has no sites; use one that has, and solve the contact with '
            "chemage.solve_contact"
        )
    x, y = (positions // contact.pixel_size).astype(np.int64).T
    nx, ny = contact.shape
    pixels = np.minimum(x, nx - 1) * ny + np.minimum(y, ny - 1)
    if np.unique(pixels).size < pixels.size:
        raise InputError.of(
            "pixel_size",
            contact.pixel_size,
            "two sites of the surface lie in one pixel",
            "use smaller pixels",
        )
    return pixels


def adhering(pixel_size: float, density: Density) -> tuple[str, str]:
    """What is wrong with sites smaller than the pixels of surfaces that adhere, and the remedy."""
    size = 1.0 if isinstance(density, str) else density**-0.5
    why = (
        f"sites of {size:.4g} nm are smaller than the pixels of {pixel_size:.4g} nm"
    )
    why += ", and where surfaces adhere the pressure below the pixel is not known"
    return why, f'use pixels of {size:.4g} nm or less, or site_density = "pixel"'


def _bearing(
    contact: ContactSolution, pressure: np.ndarray, area: float
) -> np.ndarray:
    """``pressure`` in arbitrary units, scaled so that sites of ``area`` nm² carry the load of the pixels; that of
    surfaces that adhere, whose sites carry less, as it is, in GPa."""
    if contact.touching is not None:
        return pressure
    load = float(contact.pressure.sum(dtype=np.float64)) * contact.pixel_size**2
    return pressure * (load / area / float(pressure.sum()))


def _reconstructed(
    contact: ContactSolution, shape: tuple[int, int], spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    from chemage.lattices import kernels

    nx, ny = grid = contact.shape
    periodic = contact.periodic
    place = np.full(nx * ny, -1, np.int32)
    listed = [contact.sites]
    place[contact.sites] = np.arange(contact.sites.size, dtype=np.int32)
    for _ in range(2):
        neighbours = kernels.around(listed[-1], place, nx, ny, periodic)
        place[neighbours] = np.arange(neighbours.size, dtype=np.int32) + sum(
            pixels.size for pixels in listed
        )
        listed.append(neighbours)
    pixels, inside = np.concatenate(listed), contact.sites.size
    bounds = (inside, inside + listed[1].size, pixels.size)
    highest = float(contact.pressure.max())
    pressure = np.zeros(pixels.size)
    pressure[:inside] = (
        contact.pressure.ravel()[contact.sites].astype(np.float64) / highest
    )
    opening = np.full(pixels.size, -1.0)
    if contact.gap is not None:
        gap = contact.gap.ravel()[pixels].astype(np.float64)
        with np.errstate(over="ignore", under="ignore"):
            opening = np.clip(
                0.75 * contact.modulus / contact.pixel_size / highest * gap,
                0.0,
                1e100,
            )
    level = pressure**2
    kernels.rim(pixels, bounds, place, opening, level, nx, ny, periodic, PASSES)
    sizes = spacing / contact.pixel_size
    if contact.contact_pixels == "centres":
        shift = (
            BEYOND_CENTRES
            if contact.gap is not None
            else BEYOND_CENTRES_WITHOUT_GAP
        )
    else:
        shift = (
            BEYOND if contact.gap is not None else BEYOND_WITHOUT_GAP
        ) - REACH * sizes
    most = kernels.most_sites(place, inside, grid, shape, periodic)
    require(
        16.0 * most,
        f"{most:.3g} places for sites in and around the contact",
        "use a smaller site_density",
    )
    sites, values = np.empty(most, np.int64), np.empty(most)
    count = kernels.place_sites(
        place, inside, level, grid, shape, periodic, shift, sites, values
    )
    if not count:  # the contact is smaller than the distance of sites
        sites, values = _nearest(contact, shape)
        return sites, _bearing(contact, values, spacing**2)
    sites, values = sites[:count].copy(), values[:count].copy()
    if sizes > 1:
        squares, _, mean = _squares(contact, shape)
        sites, at, _ = np.intersect1d(
            squares, sites, assume_unique=True, return_indices=True
        )
        values = mean[at]
    else:
        kernels.balance(
            place, pixels, pressure, grid, shape, periodic, sites, values
        )
    return sites, _bearing(contact, values, spacing**2)


def _nearest(
    contact: ContactSolution, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The site nearest to each pixel in contact, and the sum of their pressures."""
    offset = 0.0 if contact.periodic else 0.5
    at = [
        np.floor((where + offset) * (sites / pixels) + (0.5 - offset)).astype(
            np.int64
        )
        % sites
        for where, sites, pixels in zip(
            np.divmod(contact.sites, contact.shape[1]),
            shape,
            contact.shape,
            strict=True,
        )
    ]
    sites, which = np.unique(at[0] * shape[1] + at[1], return_inverse=True)
    return sites, np.bincount(
        which, weights=contact.pressure.ravel()[contact.sites]
    )


def _squares(
    contact: ContactSolution, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Larger sites with a pixel in contact, the share of each that is in contact, and its mean pressure."""
    from chemage.lattices import kernels

    pixels = contact.sites
    index = np.empty(4 * pixels.size, np.int64)
    share = np.empty(4 * pixels.size)
    carried = np.empty(4 * pixels.size)
    pressure = contact.pressure.ravel()[pixels].astype(np.float64)
    call = (
        pixels,
        pressure,
        contact.shape,
        shape,
        contact.periodic,
        index,
        share,
        carried,
    )
    count = kernels.overlaps(*call)
    sites, which = np.unique(index[:count], return_inverse=True)
    shares, mean = (
        np.bincount(which, weights=values[:count]) for values in (share, carried)
    )
    return sites, shares, mean


def _averaged(
    contact: ContactSolution, shape: tuple[int, int], spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    sites, shares, mean = _squares(contact, shape)
    # the outline of small pixels is nearer to the rim than that of pixels as large as sites would be
    reach = (
        0.0
        if contact.contact_pixels == "centres"
        else REACH * (1 - contact.pixel_size / spacing)
    )
    # against rounding where exactly half is in contact, and never above what the best site has
    least = min(0.5 - FALL * reach - 1e-9, float(shares.max()))
    chosen = shares >= least
    return sites[chosen], _bearing(contact, mean[chosen], spacing**2)
