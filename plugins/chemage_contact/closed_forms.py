"""Contacts without iteration: the closed form of a sphere on an elastic half-space, and Persson's theory, which gives
the area and the distribution of the pressure from the rms slope alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import (
    ContactModulus,
    ContactStatistics,
    ContactTheory,
    Pressure,
    Roughness,
    theory,
)
from chemage_contact._solvers import GRID, NO_LOAD, SphereSolver
from chemage_contact._yielding_sphere import YieldingSphere, yielding_sphere
from chemage_contact.paths import Loop, Path

_HERTZ = """@article{hertz1881,
  author = {Hertz, H.},
  title = {{\\"U}ber die Ber{\\"u}hrung fester elastischer K{\\"o}rper},
  journal = {Journal f{\\"u}r die reine und angewandte Mathematik},
  volume = {92},
  pages = {156--171},
  year = {1881},
  doi = {10.1515/crll.1882.92.156},
}"""

_JOHNSON = """@book{johnson1985,
  author = {Johnson, K. L.},
  title = {Contact Mechanics},
  publisher = {Cambridge University Press},
  year = {1985},
  doi = {10.1017/CBO9781139171731},
}"""


class Hertz(SphereSolver):
    """Sphere of radius R on an elastic half-space: a = (3FR/4E*)^(1/3), p(r) = p0 sqrt(1 − r²/a²), p0 = 3F/(2πa²).

    A pixel is in contact if its centre is, so that the contact area is πa² without bias, and carries the exact mean
    of p over its square; the small force on pixels just outside is distributed in proportion, so that the pixels
    add up to the load. The radius is the one the surface was made with, ``surface.provenance["radius"]`` in nm; its
    apex is the middle of the grid.

    With a ``hardness`` below p0 the pressure is at most that: the axisymmetric solution, of one dimension
    (``chemage_contact._yielding_sphere``). Pixels then carry the mean of p by quadrature, and what is left of the load
    raises all that do not yield equally.
    """

    kind = "hertz"
    implemented_properties = ("pressure", "gap", "displacement")
    cite = (
        "H. Hertz, J. reine angew. Math. 92, 156 (1881)",
        "K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), ch. 4",
    )
    bibtex = (_HERTZ, _JOHNSON)
    general = "fft-bem"
    costs = 0.005, 3e-7, 52.0
    later = ("gap", "hardness")

    hardness: Pressure | None = None
    """largest pressure, GPa: the material flows where it is reached, and the contact grows; default: elastic"""
    gap: bool = False
    """whether the solution contains the gap, at the centre of each pixel"""

    @property
    def declared_error(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """More where the sphere may yield: its pressure is a step at the rim, which pixels are inside of or not."""
        return 0.01 if self.hardness is None else 0.05

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """See :meth:`SphereSolver.expected`; with the memory of further maps."""
        found = super().expected(surface, load)
        maps = self.gap + (self.hardness is not None)
        if found and maps:
            pixels = surface["nx"] * surface["ny"]
            found["gap_bytes"] = 8.0 * maps * pixels
            # where it may flow, its distances from the apex as well
            yields = self.hardness is not None
            found["bytes"] += found["gap_bytes"] + 8.0 * yields * pixels
        if found and self.hardness is not None:
            found["max_pressure"] = self.hardness
        return found

    def _edge(self, radius: float, load: float) -> float:
        least = load / self.hardness if self.hardness is not None else 0.0
        return max(super()._edge(radius, load), math.sqrt(least / math.pi))

    def pressed(
        self, shape: tuple[int, int], size: float, radius: float, load: float
    ) -> tuple[float, YieldingSphere | None]:
        """Radius of the contact, nm, and where the sphere yields, its contact."""
        edge = math.cbrt(0.75 * load * radius / self.modulus)
        self.require_room(edge, shape, size, load)
        if load > 0 and not (
            edge > 1e-60 * size and 1e-290 < load / size**2 < 1e100
        ):
            raise InputError.of(
                "load",
                load,
                f"leaves the range of numbers on pixels of {size:g} nm",
                "give nN and nm",
            )
        if self.hardness is None or not load > 0:
            return edge, None
        room, least = (
            0.5 * min(shape) * size,
            math.sqrt(load / self.hardness / math.pi),
        )
        if least > room:
            raise InputError.of(
                "hardness",
                self.hardness,
                f"bears {load:.6g} nN on a radius of at least {least:.4g} nm, but the surface reaches only {room:.4g} "
                "nm from the apex",
                f"give a hardness of at least {load / (math.pi * room**2):.6g} GPa, a smaller load, or more pixels",
            )
        sphere = yielding_sphere(load, radius, self.modulus, self.hardness)
        if sphere is not None:
            self.require_room(sphere.edge, shape, size, load)
        return (edge if sphere is None else sphere.edge), sphere

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        radius, size = self.radius(surface.provenance), surface.pixel_size
        edge, sphere = self.pressed(surface.shape, size, radius, load)
        pressure = np.zeros(surface.shape)
        if sphere is not None:
            pressure = self._yielding_pressure(surface, sphere, load)
        elif load > 0:
            pressure = self._forces(surface, edge, load) / size**2
        total = float(pressure.sum()) * size**2
        gap, flow = None, None if self.hardness is None else np.zeros(surface.shape)
        if self.gap:
            gap = self._open_gap(surface, edge, radius)
        if sphere is not None:
            overlap = -sphere.gap(self.distances(surface))
            flow = np.where(pressure > 0, np.maximum(overlap, 0.0), 0.0)
            gap = np.maximum(-overlap, 0.0) if self.gap else None
        if gap is not None:
            gap[pressure > 0] = 0.0
        approach = edge * edge / radius if sphere is None else sphere.approach
        contact = self.solution(
            surface,
            pressure=pressure,
            gap=gap,
            plastic_displacement=flow,
            load=load,
            contact_pixels="centres",
            displacement=approach,
            convergence={
                "force_error": abs(total / load - 1.0) if load > 0 else 0.0
            },
            notes=() if load > 0 else NO_LOAD,
        )
        if not load > 0:
            return contact
        area = math.pi * edge**2
        highest = 1.5 * load / area if sphere is None else sphere.hardness
        r = np.linspace(0.0, edge, 2001)
        p = (
            highest * np.sqrt(1 - (r / edge) ** 2)
            if sphere is None
            else sphere.pressure(r)
        )
        squares = float(np.trapezoid(2 * math.pi * r * p**2, r))
        return self.exactly(
            contact,
            area=area,
            max_pressure=highest,
            rms_pressure=math.sqrt(squares / contact.nominal_area),
            displacement=approach,
        )

    def loop(self, surface: Surface, path: Path | Sequence[float | str]) -> Loop:
        """See :meth:`SphereSolver.loop`; under loads the approaches follow from them."""
        radius, path = self.radius(surface.provenance), Path.of(path)
        if path.control == "load":
            loads = [self.normal_force(load, surface) for load in path.values]
            path = Path(
                tuple(self.at_load(radius, load).displacement for load in loads)
            )
        loop = super().loop(surface, path)
        deepest = float(loop.load.max())
        if self.pressed(surface.shape, surface.pixel_size, radius, deepest)[1]:
            raise InputError.of(
                "hardness",
                self.hardness,
                "is reached on this path, and a sphere that has flowed is none",
                "use contact 'fft-bem'",
            )
        return loop

    def _open_gap(self, surface: Surface, edge: float, radius: float) -> np.ndarray:
        """Gap at the centres of pixels, nm: (a²/πR) [√(ρ² − 1) + (ρ² − 2) acos(1/ρ)] at ρ = r/a > 1 (Johnson, eq.
        3.42)."""
        r = self.distances(surface)
        if not edge > 0:
            return r * r / (2 * radius)
        rho = np.maximum(r / edge, 1.0)
        return np.maximum(
            edge**2
            / (math.pi * radius)
            * (np.sqrt(rho**2 - 1) + (rho**2 - 2) * np.arccos(1 / rho)),
            0.0,
        )

    def _forces(self, surface: Surface, edge: float, load: float) -> np.ndarray:
        """Force in nN on each pixel of a contact of radius ``edge``."""
        x, y = (edges / edge for edges in self.edges(surface))
        # p0·edge² = 3F/2π
        force = _pixels(_corner_force, x, y) * (1.5 * load / math.pi)
        centre = self.distances(surface)
        inside = centre < edge
        if not inside.any():  # the contact is smaller than a pixel
            inside = centre <= centre.min()
        force = np.where(inside, np.maximum(force, 0.0), 0.0)
        return force * (load / force.sum())

    def _yielding_pressure(
        self, surface: Surface, sphere: YieldingSphere, load: float
    ) -> np.ndarray:
        """Pressure of each pixel of a sphere that yields, GPa: the mean over its square where its centre is inside."""
        size, r = surface.pixel_size, self.distances(surface)
        inside = r < sphere.edge
        least = load / sphere.hardness / size**2 * (1 - 1e-12)
        if (
            np.count_nonzero(inside) < least
        ):  # their number is near πa²/size², not always above it
            inside = r <= np.sort(r, axis=None)[math.ceil(least) - 1]
        away = r[inside]
        means = np.full(away.size, sphere.hardness)
        places = [
            (v - 0.5 * (n - 1)) * size
            for v, n in zip(np.nonzero(inside), r.shape, strict=True)
        ]
        rim = (
            np.minimum(np.abs(away - sphere.core), np.abs(away - sphere.edge))
            < size
        )
        for points, there in ((16, rim), (3, ~rim & (away > sphere.core))):
            offsets = ((np.arange(points) + 0.5) / points - 0.5) * size
            for some in np.array_split(
                np.flatnonzero(there),
                max(1, np.count_nonzero(there) * points**2 >> 13),
            ):
                fine = np.hypot(
                    (places[0][some, None] + offsets)[:, :, None],
                    (places[1][some, None] + offsets)[:, None, :],
                )
                means[some] = (
                    sphere.pressure(fine.ravel())
                    .reshape(fine.shape)
                    .mean(axis=(1, 2))
                )
        mean = load / size**2 / away.size
        means *= min(1.0, mean / float(means.mean()))
        # whose module loads the kernels of the boundary elements
        from chemage_contact._bounds import projected

        pressure = np.zeros(r.shape)
        pressure[inside] = projected(means, mean, sphere.hardness)
        return pressure


def _corner(
    x: np.ndarray,
    y: np.ndarray,
    inner: Callable[..., np.ndarray],
    half_strip: float,
    cubed: float,
) -> np.ndarray:
    """∫₀ˣ∫₀ʸ of a function over the part of the rectangle inside the unit circle, for x, y ≥ 0; broadcast.

    Inside the circle it is ``inner(x, y, w)`` with the root w = √(1 − x² − y²). Outside, the corner is moved onto the
    circle along y; the strip that is left, up to the circle, adds ``half_strip`` (x − ``cubed`` x³).
    """
    x, y = np.broadcast_arrays(np.minimum(x, 1.0), np.minimum(y, 1.0))
    w2 = 1.0 - x * x - y * y
    c = np.where(w2 > 0, x, np.sqrt(np.maximum(1.0 - y * y, 0.0)))
    strip = half_strip * ((x - cubed * x**3) - (c - cubed * c**3))
    return inner(c, y, np.sqrt(np.maximum(w2, 0.0))) + strip


def _corner_force(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of √(1 − s² − t²): (1/3) x y w + ½ (x − x³/3) atan(y/w) + ½ (y − y³/3) atan(x/w) − (1/3) atan(x y/w)."""

    def inner(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> np.ndarray:
        return (
            x * y * w / 3.0
            + 0.5 * (x - x**3 / 3.0) * np.arctan2(y, w)
            + 0.5 * (y - y**3 / 3.0) * np.arctan2(x, w)
            - np.arctan2(x * y, w) / 3.0
        )

    return _corner(x, y, inner, 0.25 * math.pi, 1 / 3)


def _corner_punch(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of 1/√(1 − s² − t²): x atan(y/w) + y atan(x/w) − atan(x y/w)."""

    def inner(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> np.ndarray:
        return x * np.arctan2(y, w) + y * np.arctan2(x, w) - np.arctan2(x * y, w)

    return _corner(x, y, inner, 0.5 * math.pi, 0.0)


def _pixels(corner: Any, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Integrals over each pixel from those over rectangles at the apex, which are taken around the unit circle alone."""
    forces = np.zeros((x.size - 1, y.size - 1))
    i, j = (
        slice(
            max(int(np.searchsorted(edges, -1.0)) - 1, 0),
            int(np.searchsorted(edges, 1.0)) + 1,
        )
        for edges in (x, y)
    )
    x, y = x[i], y[j]
    signed = (np.sign(x)[:, None] * np.sign(y)) * corner(
        np.abs(x)[:, None], np.abs(y)[None, :]
    )
    pixels = np.diff(np.diff(signed, axis=0), axis=1)
    forces[i.start :, j.start :][: x.size - 1, : y.size - 1] = pixels
    return forces


#: classes of pressure, and standard deviations beyond the mean pressure up to which they reach
CLASSES, REACH = 512, 8.0
#: largest relative error of the contact area of many patches, measured (``tests/benchmarks/persson_errors.py``)
LARGEST_ERROR = 0.32
#: κ of solved contacts at small loads, rather high (2.06 to 2.29)
SOLVED = 2.25
#: 95 of 100 contact areas are within |ln A/A(κ)| = 0.05 + 0.18/(n + ¼)^¾ of the calibrated theory, n being the contact
#: area in squares of the wavelength 2π h_rms/h'_rms: few peaks differ from surface to surface. Measured on 200 random
#: surfaces, and tested on others by ``tests/benchmarks/stated_errors.py``
WITHIN, FEW_PEAKS, SHIFT, POWER = 0.05, 0.18, 0.25, 0.75

_SMOOTH = (
    "contact 'persson' is a theory of randomly rough surfaces, and this surface is a sphere; use contact 'hertz' or "
    "'fft-bem'"
)

_PERSSON = """@article{persson2001,
  author = {Persson, B. N. J.},
  title = {Theory of rubber friction and contact mechanics},
  journal = {The Journal of Chemical Physics},
  volume = {115},
  pages = {3840--3861},
  year = {2001},
  doi = {10.1063/1.1388626},
}"""

_PERSSON_ENERGY = """@article{persson2008,
  author = {Persson, B. N. J.},
  title = {On the elastic energy and stress correlation in the contact between elastic solids with randomly rough surfaces},
  journal = {Journal of Physics: Condensed Matter},
  volume = {20},
  pages = {312001},
  year = {2008},
  doi = {10.1088/0953-8984/20/31/312001},
}"""

_MANNERS = """@article{manners2006,
  author = {Manners, W. and Greenwood, J. A.},
  title = {Some observations on {Persson's} diffusion theory of elastic contact},
  journal = {Wear},
  volume = {261},
  pages = {600--610},
  year = {2006},
  doi = {10.1016/j.wear.2006.01.007},
}"""


class Persson(ContactTheory):
    """Persson's theory of the contact of a Gaussian surface with an elastic half-space, without a solve.

    As roughness is added to a flat body in full contact, the pressure diffuses from the nominal pressure p̄; it is
    absorbed at zero pressure, where contact is lost. Over the nominal area the density of p > 0 is the difference of
    two Gaussians of mean ±p̄ and variance (E* h'_rms/2)², and A/A0 = erf(√2 p̄/(E* h'_rms)). At small loads the area
    is proportional to the load, with κ = √(8/π) = 1.60 where solutions have 2.1 to 2.3, so that area is too small and
    pressure too high. It has no patches and no rim. B. N. J. Persson, J. Chem. Phys. 115, 3840 (2001); W. Manners,
    J. A. Greenwood, Wear 261, 600 (2006).

    With ``kappa`` roughness that is added where the share f of the area is in contact spreads the pressure by
    γ + (1 − γ) f² of its variance, γ = 8/(π κ²) (B. N. J. Persson, J. Phys.: Condens. Matter 20, 312001 (2008), who has
    it for the elastic energy, with γ of about 0.45): the area at small loads is that of κ, and full contact is exact.
    """

    kind = "persson"
    declared_error = LARGEST_ERROR
    cite = (
        "B. N. J. Persson, J. Chem. Phys. 115, 3840 (2001)",
        "W. Manners, J. A. Greenwood, Wear 261, 600 (2006)",
        "B. N. J. Persson, J. Phys.: Condens. Matter 20, 312001 (2008)",
    )
    bibtex = (_PERSSON, _MANNERS, _PERSSON_ENERGY)

    modulus: ContactModulus
    """contact modulus E* = E/(1−ν²) of the elastic body (or of both, combined), GPa; or their young
    and poisson"""
    kappa: float | None = Field(default=None, ge=1, le=4)
    """calibrated area–load coefficient κ = A h'_rms E*/F_N at small loads, such as that of a solved contact of the same
    spectrum; full contact does not depend on it; default: that of the theory, √(8/π) = 1.60"""

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """Area fraction where the rms slope is known; time and memory, which are those of nothing."""
        estimate = {"cpu_seconds": 0.01, "bytes": 1e6, "gap_bytes": 0.0}
        if not surface.keys() >= {*GRID, "rms_slope"}:
            return estimate
        area = surface["nx"] * surface["ny"] * surface["pixel_size"] ** 2
        mean = load / area
        sigma = self._deviation(
            load / area, 0.5 * self.modulus * surface["rms_slope"]
        )
        fraction = (
            theory.persson_area_fraction(0.5 * mean / sigma)
            if sigma > 0
            else float(load > 0)
        )
        return {**estimate, "area_fraction": float(fraction)}

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        if "radius" in surface:
            raise InputError(_SMOOTH)

    def relative_error(self, roughness: Roughness, load: float) -> float | None:
        """See :meth:`chemage.plugin.ContactTheory.relative_error`: uncalibrated, mostly that the area is too small."""
        mean = load / roughness.nominal_area
        full = 0.5 * self.modulus * roughness.rms_slope
        if not mean > 0 or not full > 0 or not roughness.rms_height > 0:
            return self.declared_error
        solved = self if self.kappa is not None else self.replace(kappa=SOLVED)
        deviations = (contact._deviation(mean, full) for contact in (solved, self))
        area, own = (
            theory.persson_area_fraction(0.5 * mean / deviation)
            for deviation in deviations
        )
        peaks = (
            area
            * roughness.nominal_area
            * (roughness.rms_slope / (2 * math.pi * roughness.rms_height)) ** 2
        )
        # no area is larger than the nominal one
        limit = min(WITHIN + FEW_PEAKS / (peaks + SHIFT) ** POWER, -math.log(area))
        return float(
            limit if self.kappa is not None else 1 - own / area * math.exp(-limit)
        )

    def _deviation(self, mean: float, full: float) -> float:
        """Standard deviation of the pressure before it is absorbed, of which that at full contact is ``full``; GPa."""
        if self.kappa is None or not 0 < mean < 1e3 * full:
            return full
        return full * math.sqrt(
            self._spread(min(full / mean, 1e100) ** 2, self.kappa)
        )

    def _statistics(self, roughness: Roughness, load: float) -> ContactStatistics:
        if "radius" in roughness.provenance:
            raise InputError(_SMOOTH)
        mean = load / roughness.nominal_area
        pressure, share = self._classes(
            mean, 0.5 * self.modulus * roughness.rms_slope
        )
        return ContactStatistics(
            pressure=pressure,
            area=share * roughness.nominal_area,
            load=load,
            nominal_area=roughness.nominal_area,
            modulus=self.modulus,
            rms_slope=roughness.rms_slope,
            rms_height=roughness.rms_height,
            notes=(
                "the contact is that of Persson's theory: no map, no patches, no rim, which leaves out 0.3 to 6 % of "
                "the bonds of sites that interact"
                + (
                    ""
                    if self.kappa is None
                    else f"; calibrated to an area–load coefficient of {self.kappa:g}"
                ),
            ),
            provenance=self.provenance(roughness),
        )

    def _spread(self, variance: float, kappa: float) -> float:
        """By which part of ``variance`` (of full contact, over p̄²) the pressure has spread.

        w with dw/dv = γ + (1 − γ) f², where f = erf(1/√(2w)) is the share in contact and γ is ``least``; integrated
        over w.
        """
        from scipy import special

        least = 8 / math.pi / kappa**2
        nodes, weights = np.polynomial.legendre.leggauss(200)

        def excess(part: float) -> float:
            """How much more variance than ``variance`` the part needs, relatively."""
            # below the first limit all is in contact, far below the last one is nothing of the sum
            last = math.log(part * variance)
            first = max(math.log(0.01), last - 40)
            if last <= first:
                return part - 1
            w = np.exp(0.5 * (last - first) * (nodes + 1) + first)
            rate = least + (1 - least) * special.erf(1 / np.sqrt(2 * w)) ** 2
            return (
                math.exp(first)
                + 0.5 * (last - first) * float(np.sum(weights * (w / rate)))
            ) / variance - 1

        low, high = min(least, 1.0), max(least, 1.0)
        for _ in range(52):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle) < 0 else (low, middle)
        return 0.5 * (low + high)

    def _classes(self, mean: float, full: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean pressure of each class, GPa, and its share of the nominal area."""
        if not mean > 0:
            return np.zeros(0), np.zeros(0)
        sigma = self._deviation(mean, full)
        if sigma <= 1e-12 * mean:
            return np.array([mean]), np.array([1.0])
        edges = np.linspace(
            max(mean - REACH * sigma, 0.0), mean + REACH * sigma, CLASSES + 1
        )
        nodes, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * np.diff(edges)
        points = 0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * nodes
        # the density of the theory for a modulus of 2 GPa and a slope of sigma
        density = theory.persson_pressure_density(points, mean, 2.0, sigma) * (
            half[:, None] * weights
        )
        share = density.sum(axis=1)
        there = share > 0
        pressure = (density * points).sum(axis=1)[there] / share[there]
        total = float(np.sum(pressure * share[there]))
        # what is beyond the last class, 1e-14 of the load, is distributed in proportion
        return pressure * (mean / total) if math.isfinite(
            total
        ) and total > 0 else pressure, share[there]
