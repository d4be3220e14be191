"""The closed form of a sphere on an elastic half-space, sampled on the pixels of the surface."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import ContactModulus, ContactSolver

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


class Hertz(ContactSolver):
    """Sphere of radius R on an elastic half-space: a = (3FR/4E*)^(1/3), p(r) = p0 sqrt(1 − r²/a²), p0 = 3F/(2πa²).

    A pixel is in contact if its centre is, so that the contact area is πa² without bias, and carries the exact mean
    of p over its square; the small force on pixels just outside is distributed in proportion, so that the pixels
    add up to the load. The radius is the one the surface was made with, ``surface.provenance["radius"]`` in nm; its
    apex is the middle of the grid.
    """

    kind = "hertz"
    implemented_properties: ClassVar[tuple[str, ...]] = ("pressure", "gap", "displacement")
    declared_error: ClassVar[float | None] = 0.01
    cite: ClassVar[tuple[str, ...]] = (
        "H. Hertz, J. reine angew. Math. 92, 156 (1881)",
        "K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), ch. 4",
    )
    bibtex: ClassVar[tuple[str, ...]] = (_HERTZ, _JOHNSON)

    modulus: ContactModulus
    """contact modulus E* = E/(1−ν²) of the elastic body (or of both, combined), GPa; or their young
    and poisson"""
    gap: bool = False
    """whether the solution contains the gap, at the centre of each pixel"""

    def identity(self) -> dict[str, Any]:
        """As for every component; without ``gap`` where there is none, as before there was this option."""
        return {name: value for name, value in super().identity().items() if name != "gap" or value}

    def expected(self, surface: Mapping[str, float], load: float) -> dict[str, float]:
        """Area fraction πa²/A0 where the radius is known, and memory of the gap."""
        if not {"nx", "ny", "pixel_size", "radius"} <= surface.keys():
            return {}
        gap = {"gap_bytes": 8.0 * surface["nx"] * surface["ny"]} if self.gap else {}
        edge = math.cbrt(0.75 * load * surface["radius"] / self.modulus)
        nominal = surface["nx"] * surface["ny"] * surface["pixel_size"] ** 2
        pixels = surface["nx"] * surface["ny"]
        cost = {"cpu_seconds": 0.005 + 3e-7 * pixels, "bytes": 100.0 * pixels}
        return {"area_fraction": min(math.pi * edge**2 / nominal, 1.0), **cost, **gap}

    def is_nominally_flat(self, periodic: bool) -> bool:
        """A sphere is not."""
        return False

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        if not {"nx", "ny", "pixel_size"} <= surface.keys():
            return
        if "radius" not in surface:
            raise InputError(
                "contact 'hertz' needs a sphere, but this surface has no radius; "
                "use surface kind 'sphere' or contact 'fft-bem'"
            )
        shape = (int(surface["nx"]), int(surface["ny"]))
        self._edge(shape, surface["pixel_size"], surface["radius"], load)

    def _edge(self, shape: tuple[int, int], size: float, radius: float, load: float) -> float:
        """Radius of the contact, nm."""
        edge = math.cbrt(0.75 * load * radius / self.modulus)
        room = 0.5 * min(shape) * size
        if edge > room:
            raise InputError.of(
                "load",
                load,
                f"the contact has a radius of {edge:.4g} nm, but the surface reaches only {room:.4g} nm from the apex",
                "use more pixels or a smaller load",
            )
        if load > 0 and not (edge > 1e-60 * size and 1e-290 < load / size**2 < 1e100):
            raise InputError.of("load", load, f"leaves the range of numbers on pixels of {size:g} nm", "give nN and nm")
        return edge

    def _solve(self, surface: Surface, load: float, start: ContactSolution | None) -> ContactSolution:
        radius = _radius(surface)
        size = surface.pixel_size
        edge = self._edge(surface.shape, size, radius, load)
        pressure = np.zeros(surface.shape)
        if load > 0:
            nx, ny = surface.shape
            pressure = _pixel_forces(_edges(nx, size), _edges(ny, size), edge, load) / size**2
        total = float(pressure.sum()) * size**2
        gap = None
        if self.gap:
            gap = _gap(surface, edge, radius)
            gap[pressure > 0] = 0.0
            gap.setflags(write=False)
        pressure.setflags(write=False)
        return ContactSolution(
            pressure=pressure,
            gap=gap,
            load=load,
            pixel_size=size,
            modulus=self.modulus,
            periodic=False,
            contact_pixels="centres",
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            displacement=edge * edge / radius,
            convergence={"force_error": abs(total / load - 1.0) if load > 0 else 0.0},
            notes=() if load > 0 else ("no load: the bodies just touch and no pixel carries pressure",),
            provenance=self._provenance(surface),
        )

    def _provenance(self, surface: Surface) -> dict[str, Any]:
        options = self.identity()
        return {"kind": options.pop("kind"), "options": options, "surface": surface.provenance}


def _radius(surface: Surface) -> float:
    radius = surface.provenance.get("radius")
    if isinstance(radius, bool) or not isinstance(radius, int | float) or not (0 < radius < math.inf):
        raise InputError(
            f"contact 'hertz' needs a sphere, but this surface has no radius (provenance['radius'] = {radius!r}); "
            "use surface kind 'sphere' or contact 'fft-bem'"
        )
    return float(radius)


def _edges(n: int, size: float) -> np.ndarray:
    """The n + 1 pixel edges along one side, measured from the middle of the grid, nm."""
    return (np.arange(n + 1) - 0.5 * n) * size


def _gap(surface: Surface, edge: float, radius: float) -> np.ndarray:
    """Gap at the centres of pixels, nm: (a²/πR) [√(ρ² − 1) + (ρ² − 2) acos(1/ρ)] at ρ = r/a > 1 (Johnson, eq. 3.42)."""
    x, y = (_edges(n, surface.pixel_size) for n in surface.shape)
    r = np.hypot((0.5 * (x[1:] + x[:-1]))[:, None], 0.5 * (y[1:] + y[:-1]))
    if not edge > 0:
        return r * r / (2 * radius)
    rho = np.maximum(r / edge, 1.0)
    return np.maximum(edge**2 / (math.pi * radius) * (np.sqrt(rho**2 - 1) + (rho**2 - 2) * np.arccos(1 / rho)), 0.0)


def _corner_force(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """∫₀ˣ∫₀ʸ sqrt(1 − s² − t²) over the part of the rectangle inside the unit circle, for x, y ≥ 0; broadcast.

    Inside the circle: (1/3) x y w + ½ (x − x³/3) atan(y/w) + ½ (y − y³/3) atan(x/w) − (1/3) atan(x y/w), w the root.
    Outside, the corner is moved onto the circle along y and the rest of the strip, which is a full half-ellipse,
    is added.
    """
    x = np.minimum(x, 1.0)
    y = np.minimum(y, 1.0)
    x, y = np.broadcast_arrays(x, y)
    w2 = 1.0 - x * x - y * y
    inside = w2 > 0.0

    def smooth(a: np.ndarray, b: np.ndarray, w: np.ndarray) -> np.ndarray:
        return (
            a * b * w / 3.0
            + 0.5 * (a - a**3 / 3.0) * np.arctan2(b, w)
            + 0.5 * (b - b**3 / 3.0) * np.arctan2(a, w)
            - np.arctan2(a * b, w) / 3.0
        )

    w = np.sqrt(np.where(inside, w2, 0.0))
    full = smooth(np.where(inside, x, 0.0), np.where(inside, y, 0.0), w)
    # Strips s in (c, x) where t runs to the circle: ∫ π/4 (1 − s²) ds; up to c = sqrt(1 − y²) the rectangle is inside.
    c = np.sqrt(np.maximum(1.0 - y * y, 0.0))
    beyond = smooth(c, y, np.zeros_like(c)) + 0.25 * math.pi * ((x - x**3 / 3.0) - (c - c**3 / 3.0))
    return np.where(inside, full, beyond)


def _pixel_forces(x: np.ndarray, y: np.ndarray, edge: float, load: float) -> np.ndarray:
    """Force in nN on each pixel between the given pixel edges (nm from the apex); (x.size − 1, y.size − 1)."""
    # p0·edge² = 3F/2π
    signed = (np.sign(x)[:, None] * np.sign(y)) * _corner_force(np.abs(x)[:, None] / edge, np.abs(y)[None, :] / edge)
    force = np.diff(np.diff(signed, axis=0), axis=1) * (1.5 * load / math.pi)
    centre = np.hypot(0.5 * (x[1:] + x[:-1])[:, None], 0.5 * (y[1:] + y[:-1]))
    inside = centre < edge
    if not inside.any():  # the contact is smaller than a pixel
        inside = centre <= centre.min()
    force = np.where(inside, np.maximum(force, 0.0), 0.0)
    return force * (load / force.sum())
