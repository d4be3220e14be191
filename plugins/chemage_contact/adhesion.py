"""Spheres that adhere: the closed forms of JKR, of DMT, and of Maugis between them."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import Length, Unit, convert
from chemage_contact._solvers import GRID, SphereSolver, SphereState, tabor
from chemage_contact.closed_forms import _corner_force, _corner_punch, _pixels
from chemage_contact.paths import Branch

#: work of adhesion: 1 J/m² is 1 nN/nm
Adhesion = Annotated[Any, Unit("J/m**2", gt=0)]
#: nodes of the integral over the zone of cohesion: the load is exact, the pressure of a pixel at the rims within half a
#: percent of the stress
_NODES = 48
#: root of the radius, in units of a₁, at which a JKR contact is lost at a given approach
_LOWEST = 4.0 ** (-1 / 3)
#: range of attraction (nm) with which Tabor's parameter is estimated where the law has none: that of atoms
_ATOMIC = 0.3
#: spans of the logarithm of the angle in which a Maugis contact is sought
_ANGLES = 600

_JKR = """@article{johnson1971,
  author = {Johnson, K. L. and Kendall, K. and Roberts, A. D.},
  title = {Surface energy and the contact of elastic solids},
  journal = {Proceedings of the Royal Society of London A},
  volume = {324},
  pages = {301--313},
  year = {1971},
  doi = {10.1098/rspa.1971.0141},
}"""

_DMT = """@article{derjaguin1975,
  author = {Derjaguin, B. V. and Muller, V. M. and Toporov, Yu. P.},
  title = {Effect of contact deformations on the adhesion of particles},
  journal = {Journal of Colloid and Interface Science},
  volume = {53},
  pages = {314--326},
  year = {1975},
  doi = {10.1016/0021-9797(75)90018-1},
}"""

_MAUGIS = """@article{maugis1992,
  author = {Maugis, D.},
  title = {Adhesion of spheres: the {JKR}--{DMT} transition using a {Dugdale} model},
  journal = {Journal of Colloid and Interface Science},
  volume = {150},
  pages = {243--269},
  year = {1992},
  doi = {10.1016/0021-9797(92)90285-T},
}"""


class AdhesiveSphere(SphereSolver, ABC):
    """A sphere of radius R on an elastic half-space, with adhesion.

    A pixel is in contact if its centre is, and carries the exact mean of the pressure over its square. Where nothing
    acts outside the contact, the force on pixels across its rim goes to their neighbours inside, so that all of it is
    carried by the contact. The radius is ``surface.provenance["radius"]`` in nm, the apex the middle of
    the grid. A load may be negative, down to the pull-off force; below it there is no contact. Of the two contacts
    under a pull the stable one is given.
    """

    adheres = True
    implemented_properties = ("pressure", "displacement")
    #: Tabor's parameters between which the law holds
    tabor: ClassVar[tuple[float, float]] = (0.0, math.inf)
    general = "adhesive-bem"
    costs = 0.02, 5e-6, 84.0

    work_of_adhesion: Adhesion = Field(examples=["50 mJ/m^2"])
    """work of adhesion w of the two surfaces, J/m² (the same number in nN/nm)"""

    def at_approach(
        self, radius: float, displacement: float, *, touching: bool = True
    ) -> SphereState | None:
        """The contact at an approach of ``displacement`` nm since first touch, as it is where the surfaces were
        ``touching`` before, or were not; None: they do not touch."""
        last, first = self._ends(radius)
        apart = displacement < (last if touching else max(first, last))
        return None if apart else self._at(radius, displacement)

    def _punches(self, state: SphereState) -> list[tuple[float, float]]:
        """The flat punches that pull the surfaces together: radius (nm), and tension in the middle (GPa)."""
        return []

    def _tension(self, state: SphereState) -> float:
        """What attraction takes off the pressure of Hertz in the middle, GPa."""
        return sum(tension for _, tension in self._punches(state))

    def _forces(
        self, radius: float, state: SphereState, x: np.ndarray, y: np.ndarray
    ) -> np.ndarray:
        """Force (nN) on each pixel between the edges ``x`` and ``y``, nm from the apex."""
        edge = state.edge
        hertz = _pixels(_corner_force, x / edge, y / edge)
        forces = np.maximum(
            2 * self.modulus * edge**3 / (math.pi * radius) * hertz, 0.0
        )
        for punch, tension in self._punches(state):
            forces -= (
                tension * punch**2 * _pixels(_corner_punch, x / punch, y / punch)
            )
        return forces

    def _carries(self, radius: float) -> str:
        return ""

    def _tabor(self, radius: float) -> float:
        """Tabor's parameter of a sphere of ``radius`` nm, for the range of attraction of the law, or of atoms."""
        reach = getattr(self, "range", _ATOMIC)
        return tabor(radius, self.work_of_adhesion, self.modulus, reach)

    def _beyond(self, radius: float) -> tuple[str, ...]:
        """That a sphere of ``radius`` nm is outside the range of the law, in words; nothing where it is not."""
        found = self._tabor(radius)
        low, high = self.tabor
        if low <= found <= high:
            return ()
        limit = f"above {low:g}" if found < low else f"below {high:g}"
        beyond = (
            f"contact {self.kind!r} holds where Tabor's parameter (Rw²/(E*²z₀³))^(1/3) is {limit}, and here it is "
            f"{found:.2g} for an attraction of range z₀ = {_ATOMIC:g} nm: use contact 'maugis' with the range of the "
            "attraction"
        )
        return (beyond,)

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """See :meth:`SphereSolver.expected`; with Tabor's parameter."""
        found = super().expected(surface, load)
        return found and found | {"tabor": self._tabor(surface["radius"])}

    def check(self, surface: Mapping[str, float], load: float) -> tuple[str, ...]:
        """See :meth:`chemage.plugin.ContactSolver.check`."""
        super().check(surface, load)
        return self._beyond(surface["radius"]) if surface.keys() >= GRID else ()

    def pressed(
        self, shape: tuple[int, int], size: float, radius: float, load: float
    ) -> SphereState:
        """See :meth:`SphereSolver.pressed`."""
        pull = self.pull_off(radius)
        # the last bits are those of the conversion of units
        if load < -pull * (1 + 1e-12):
            raise InputError.of(
                "load",
                load,
                f"pulls the surfaces apart: the pull-off force is {pull:.6g} nN (work of adhesion "
                f"{self.work_of_adhesion:g} J/m², radius {radius:g} nm)",
                f"give a load of at least {-pull:.6g} nN",
            )
        state = self.at_load(radius, max(load, -pull))
        self.require_room(state.outer, shape, size, load)
        if not state.edge > 1e-60 * size:
            raise InputError.of(
                "load",
                load,
                "leaves the range of numbers: no contact is left",
                "give nN and nm",
            )
        return state

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        radius = self.radius(surface.provenance)
        return self._solution(
            surface,
            radius,
            self.pressed(surface.shape, surface.pixel_size, radius, load),
            load,
        )

    def solve_displacement(
        self, surface: Surface, displacement: float | str, *, touching: bool = True
    ) -> ContactSolution | None:
        """The contact at an approach (nm, or a string with its unit) since first touch, see :meth:`at_approach`."""
        radius = self.radius(surface.provenance)
        state = self.at_approach(
            radius, convert(displacement, "nm"), touching=touching
        )
        if state is None:
            return None
        self.pressed(
            surface.shape, surface.pixel_size, radius, max(state.load, 0.0)
        )
        return self._solution(surface, radius, state, state.load)

    def _solution(
        self, surface: Surface, radius: float, state: SphereState, load: float
    ) -> ContactSolution:
        from scipy import ndimage

        size = surface.pixel_size
        x, y = self.edges(surface)
        pressure = self._forces(radius, state, x, y) / size**2
        # the nearest point of each pixel; beyond are rounding errors
        near = [np.maximum(np.maximum(e[:-1], -e[1:]), 0.0) for e in (x, y)]
        pressure[np.hypot(near[0][:, None], near[1]) >= state.outer] = 0.0
        centre = self.distances(surface)
        # a contact smaller than a pixel is the pixel in the middle
        touching = centre < max(state.edge, float(centre.min()) * (1 + 1e-9))
        if (
            state.outer == state.edge
        ):  # that of pixels outside is shared by their eight neighbours in contact
            around = np.ones((3, 3))
            count = ndimage.convolve(
                touching.astype(np.float64), around, mode="constant"
            )
            moves = ~touching & (count > 0)
            share = np.where(moves, pressure / np.maximum(count, 1.0), 0.0)
            gained = ndimage.convolve(share, around, mode="constant")
            pressure = np.where(moves, 0.0, pressure) + np.where(
                touching, gained, 0.0
            )
        carries = self._carries(radius)
        scale = float(np.abs(pressure).sum()) * size**2
        force_error = (
            0.0
            if carries or not scale
            else abs(float(pressure.sum()) * size**2 - load) / scale
        )
        contact = self.solution(
            surface,
            pressure=pressure,
            touching=touching,
            load=load,
            contact_pixels="centres",
            displacement=state.displacement,
            carries=carries,
            convergence={
                "force_error": force_error,
                "pull_off": self.pull_off(radius),
            },
            notes=self._beyond(radius),
        )
        return self.exactly(
            contact,
            area=math.pi * state.edge**2,
            max_pressure=2 * self.modulus * state.edge / (math.pi * radius)
            - self._tension(state),
            rms_pressure=None,
            displacement=state.displacement,
        )


class JKR(AdhesiveSphere):
    """Sphere with adhesion in its contact alone: soft, large, of short-ranged attraction (Tabor's parameter above 5).

    a³ = (3R/4E*)(F + 3πwR + √(6πwRF + (3πwR)²)), p(r) = (2E*a/πR) √(1 − r²/a²) − √(2wE*/πa)/√(1 − r²/a²), approach
    a²/R − √(2πwa/E*). Pull-off at (3/2)πwR. K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324, 301 (1971).
    """

    kind = "jkr"
    tabor = (5.0, math.inf)
    cite = (
        "K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. Lond. A 324, 301 (1971)",
    )
    bibtex = (_JKR,)

    def pull_off(self, radius: float) -> float:
        """(3/2)πwR."""
        return 1.5 * math.pi * self.work_of_adhesion * radius

    def at_load(self, radius: float, load: float) -> SphereState:
        """See :meth:`SphereSolver.at_load`."""
        pull = self.pull_off(radius)
        cubed = (
            0.75
            * radius
            / self.modulus
            * (load + 2 * pull + 2 * math.sqrt(max(pull * (load + pull), 0.0)))
        )
        return self._state(radius, math.cbrt(cubed), load)

    def _state(
        self, radius: float, edge: float, load: float | None = None
    ) -> SphereState:
        w, modulus = self.work_of_adhesion, self.modulus
        force = 4 * modulus * edge**3 / (3 * radius) - math.sqrt(
            8 * math.pi * w * modulus * edge**3
        )
        return SphereState(
            force if load is None else load,
            edge,
            edge,
            edge**2 / radius - math.sqrt(2 * math.pi * w * edge / modulus),
        )

    def _ends(self, radius: float) -> tuple[float, float]:
        """Surfaces apart jump into contact where they touch, at 0."""
        return (_LOWEST**4 - _LOWEST) * self._scale(radius) ** 2 / radius, 0.0

    def _scale(self, radius: float) -> float:
        """a₁, with which a = x² a₁ and x⁴ − x = δR/a₁² on the stable branch beyond its lowest point."""
        return math.cbrt(
            2 * math.pi * self.work_of_adhesion * radius**2 / self.modulus
        )

    def _at(self, radius: float, displacement: float) -> SphereState:
        scale = self._scale(radius)
        roots = np.roots([1.0, 0.0, 0.0, -1.0, -displacement * radius / scale**2])
        root = max(float(value.real) for value in roots if abs(value.imag) < 1e-6)
        return self._state(radius, max(root, _LOWEST) ** 2 * scale)

    def _punches(self, state: SphereState) -> list[tuple[float, float]]:
        w, edge = self.work_of_adhesion, state.edge
        return [(edge, math.sqrt(2 * w * self.modulus / (math.pi * edge)))]


class DMT(AdhesiveSphere):
    """Sphere with attraction around its contact that does not deform it: hard, small, long-ranged (Tabor's parameter
    below 0.1).

    The contact of Hertz under F + 2πwR. Where the attraction 2πwR acts is not part of the theory, so that the
    pressure adds up to that sum, not to the load. Pull-off at 2πwR. B. V. Derjaguin, V. M. Muller, Yu. P. Toporov, J.
    Colloid Interface Sci. 53, 314 (1975).
    """

    kind = "dmt"
    tabor = (0.0, 0.1)
    cite = (
        "B. V. Derjaguin, V. M. Muller, Yu. P. Toporov, J. Colloid Interface Sci. 53, 314 (1975)",
    )
    bibtex = (_DMT,)

    def pull_off(self, radius: float) -> float:
        """2πwR."""
        return 2 * math.pi * self.work_of_adhesion * radius

    def _carries(self, radius: float) -> str:
        return f"the attraction of {self.pull_off(radius):.6g} nN acts around the contact, where DMT theory does not say"


class Maugis(AdhesiveSphere):
    """Sphere whose surfaces attract each other with a constant stress w/z₀ up to a gap z₀: JKR, DMT and all between.

    The load follows from the angle θ with cos θ = a/c, the zone of attraction reaching to c, by Maugis' equations (his
    6.15 to 6.19) in powers of c, which have no large numbers at either end. D. Maugis, J. Colloid Interface Sci. 150,
    243 (1992).
    """

    kind = "maugis"
    costs = 0.02, 5e-6, 70.0
    cite = ("D. Maugis, J. Colloid Interface Sci. 150, 243 (1992)",)
    bibtex = (_MAUGIS,)

    range: Length = Field(examples=["0.3 nm"])
    """gap z₀ up to which the surfaces attract each other, nm; the stress is w/z₀"""

    def units(self, radius: float) -> tuple[float, float, float, float]:
        """Units of load (nN), contact radius and approach (nm), and Maugis' λ, which is 1.157 times Tabor's
        parameter for a potential of the same stress."""
        stiffness, w = 4 * self.modulus / 3, self.work_of_adhesion
        edge = math.cbrt(math.pi * w * radius**2 / stiffness)
        return (
            math.pi * w * radius,
            edge,
            edge**2 / radius,
            2 * w / self.range * radius / (stiffness * edge),
        )

    def pull_off(self, radius: float) -> float:
        """Of the least load of all contacts, nN."""
        force, _, _, strength = self.units(radius)
        return -force * _load(_lowest(_load, strength), strength)

    def at_load(self, radius: float, load: float) -> SphereState:
        """See :meth:`SphereSolver.at_load`."""
        force, _, _, strength = self.units(radius)
        return self._state(radius, _solved(_load, strength, load / force))

    def _state(self, radius: float, angle: float) -> SphereState:
        force, unit, depth, strength = self.units(radius)
        outer = _outer(angle, strength)
        displacement = _approach(angle, strength) * depth
        return SphereState(
            force * _load(angle, strength),
            unit * outer * math.cos(angle),
            unit * outer,
            displacement,
        )

    def _ends(self, radius: float) -> tuple[float, float]:
        """Surfaces apart jump into contact where their bulge has closed the gap, or at once where the attraction begins
        at a gap z₀."""
        _, _, depth, strength = self.units(radius)
        last = _approach(_lowest(_approach, strength), strength) * depth
        closed, bulge, strain = self._bulge(radius)
        return last, -self.range if closed < 2 * bulge else -2 * strain * closed

    def _at(self, radius: float, displacement: float) -> SphereState:
        _, _, depth, strength = self.units(radius)
        return self._state(
            radius, _solved(_approach, strength, displacement / depth)
        )

    def _bulge(self, radius: float) -> tuple[float, float, float]:
        """Radii (nm) of the disc of attraction around a gap that closes, and of the smallest stable one, and w/(z₀E*).

        A disc of radius c under the stress w/z₀ lifts the surface by 2σc/E* in its middle and 4σc/(πE*) at its rim,
        where the gap is z₀ (Johnson, section 3.4): z₀ + δ = c²/2R - 4σc/(πE*).
        """
        strain = self.work_of_adhesion / self.range / self.modulus
        # the gap in the middle, z₀ − c²/2R + (4/π − 2)σc/E*, is closed at this c
        middle = (2 - 4 / math.pi) * strain * radius
        closed = math.sqrt(middle**2 + 2 * radius * self.range) - middle
        return closed, 4 * strain * radius / math.pi, strain

    def branches(self, radius: float) -> tuple[Branch, ...]:
        """See :meth:`SphereSolver.branches`; between apart and contact the surfaces attract each other."""
        apart, contact = super().branches(radius)
        closed, bulge, strain = self._bulge(radius)
        apart = apart._replace(high=-self.range)
        if closed <= bulge:
            return apart, contact

        def attracted(at: float) -> SphereState:
            squared = bulge**2 + 2 * radius * (self.range + at)
            outer = bulge + math.sqrt(max(squared, 0.0))
            load = -math.pi * outer**2 * self.work_of_adhesion / self.range
            return SphereState(load, 0.0, 0.0, at)

        low, high = -self.range - 0.5 * bulge**2 / radius, -2 * strain * closed
        return (
            apart,
            Branch(low, high, attracted),
            contact._replace(low=min(contact.low, high)),
        )

    def _tension(self, state: SphereState) -> float:
        stress = self.work_of_adhesion / self.range
        return 2 / math.pi * stress * math.acos(min(state.edge / state.outer, 1.0))

    def _punches(self, state: SphereState) -> list[tuple[float, float]]:
        """(2σ/π) ∫ t dt/√(c² − t²) 1/√(t² − r²) over the radii t of punches from a to c."""
        edge, outer = state.edge, state.outer
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * math.sqrt(max((outer - edge) * (outer + edge), 0.0))
        stress = 2 / math.pi * self.work_of_adhesion / self.range
        roots = half * (nodes + 1)
        radii = np.sqrt((outer - roots) * (outer + roots))
        return list(zip(radii, stress * half * weights / radii, strict=True))


def _outer(angle: float, strength: float) -> float:
    """c in units of the contact radius, from the condition that the gap at c is z₀."""
    twice = 2 * angle
    if twice < 0.1:  # sin φ − φ cos φ by its series
        square = twice * twice
        first = (
            twice**3 / 3 * (1 - square / 10 * (1 - square / 28 * (1 - square / 54)))
        )
    else:
        first = math.sin(twice) - twice * math.cos(twice)
    second = angle * math.sin(angle) - 2 * math.sin(0.5 * angle) ** 2
    quadratic, linear = 0.25 * strength * first, 4 / 3 * strength**2 * second
    return 2 / (linear + math.sqrt(linear**2 + 4 * quadratic))


def _load(angle: float, strength: float) -> float:
    """Load in units of πwR."""
    outer = _outer(angle, strength)
    edge = outer * math.cos(angle)
    return edge**3 - strength * outer**2 * (
        math.sin(angle) * math.cos(angle) + angle
    )


def _approach(angle: float, strength: float) -> float:
    """Approach in its unit."""
    outer = _outer(angle, strength)
    return (outer * math.cos(angle)) ** 2 - 4 / 3 * strength * outer * math.sin(
        angle
    )


@lru_cache(maxsize=64)
def _lowest(function: Callable[[float, float], float], strength: float) -> float:
    """The angle at which load or approach is least, ½π where the contact vanishes before."""
    from scipy.optimize import minimize_scalar

    last = 0.5 * math.pi
    near = last - np.geomspace(0.07, 1e-12, _ANGLES // 4)
    angles = np.concatenate([np.geomspace(1e-9, 1.5, _ANGLES), near, [last]])
    values = np.array([function(angle, strength) for angle in angles])
    # the first minimum is that of the stable branch
    at = int(np.argmax(np.append(np.diff(values) >= 0, True)))
    low, high = angles[max(at - 1, 0)], angles[min(at + 1, angles.size - 1)]
    if at == angles.size - 1:
        return float(angles[at])
    found: Any = minimize_scalar(
        function,
        bounds=(low, high),
        args=(strength,),
        method="bounded",
        options={"xatol": 1e-12 * high},
    )
    return float(found.x)


def _solved(
    function: Callable[[float, float], float], strength: float, value: float
) -> float:
    """The angle up to that of the least value at which the falling load or approach has ``value``."""
    from scipy.optimize import brentq

    first = last = _lowest(function, strength)
    if value <= function(last, strength):
        return last
    while function(first, strength) < value:
        first *= 0.5
    found: Any = brentq(
        lambda angle: function(angle, strength) - value,
        first,
        last,
        xtol=1e-300,
        rtol=np.float64(1e-14),
    )
    return found
