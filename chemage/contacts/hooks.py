"""What can be plugged into this stage: contact solvers, and the hook that solves a contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import (
    Beside,
    Doubt,
    Parts,
    Stage,
    StageInputs,
    Stated,
    hookimpl,
    hookspec,
    options_in,
)

if TYPE_CHECKING:
    from chemage.contacts.role import ContactSolver
    from chemage.contacts.solution import Contact, ContactSolution
    from chemage.surfaces.surface import Surface

ROLES = {"contact": "chemage.contacts.role:ContactSolver"}


@hookspec(firstresult=True)
def chemage_solve_contact(
    solver: ContactSolver,
    surface: Surface,
    load: float,
    start: ContactSolution | None,
) -> ContactSolution | None:
    """Solve a contact at ``load`` nN. Return None to leave it to the next plugin; chemage itself answers last.

    Wrap it (``hookimpl(wrapper=True)``) to change a solution, for example to cap the pressure at a hardness.
    """


class OwnContactMethod:
    """The solver's own method."""

    @hookimpl(trylast=True)
    def chemage_solve_contact(
        self,
        solver: ContactSolver,
        surface: Surface,
        load: float,
        start: ContactSolution | None,
    ) -> ContactSolution:
        return solver.solve(surface, load, start=start)


ANSWERS = OwnContactMethod


#: CPU seconds of each pixel beside surface and solver, measured on a 2-core Intel Xeon machine
#: (``tests/benchmarks/estimates.py``)
PIXEL_SECONDS = 2e-8
#: sites below which a scene gives no number
NO_SITE = 1.0
#: the expected mean contact pressure, over the one asked for, that is warned of
WELL_ABOVE = 1.1
#: the load in a section of a scene
_LOAD = {
    "anyOf": [{"type": "number"}, {"type": "string"}],
    "description": "normal force (nN), or a nominal pressure such as 10 MPa, on the nominal area of the surface, or a "
    "mean contact pressure such as 3 GPa over contact, whose force is found; below zero only with adhesion",
    "unit": "nN",
}


class _Contact(Stage):
    def taken(self, parts: Parts) -> tuple[str, ...]:
        return self.takes if parts[self.section].gives_map else ()

    def run(self, inputs: StageInputs) -> Contact:
        from chemage.contacts.role import solve_contact
        from chemage.contacts.theory import ContactTheory

        parts, surface = inputs.parts, inputs.made.get("surface")
        solver, load = parts[self.section], parts["contact.load"]
        if isinstance(solver, ContactTheory):
            return solver.statistics(
                surface or parts["surface"], load, parts["surface.seed"]
            )
        return solve_contact(solver, inputs.made["surface"], load)

    def read_beside(self, name: str, value: Any, parts: Parts) -> Any:
        """The load in nN; a nominal pressure is multiplied by the nominal area that the surface will have."""
        from chemage.contacts.options import nominal_pressure, normal_force
        from chemage.contacts.role import is_sought
        from chemage.foundation.errors import InputError

        if value is None:
            raise InputError(
                'is required; give the normal force, such as load = "20 uN", or a nominal pressure'
            )
        solver, maker = parts.get(self.section), parts.get("surface")
        if nominal_pressure(value) is None and not is_sought(value):
            return normal_force(
                value, None, flat=True, signed=solver is None or solver.adheres
            )
        # what is wrong with them is said by themselves
        return (
            None
            if solver is None or maker is None
            else solver.normal_force(value, maker.expected())
        )

    def locate_beside(self, name: str, value: Any, folder: Path) -> Any:
        from chemage.contacts.role import AS

        if not isinstance(value, str) or not value.startswith(AS):
            return value
        return f"{AS}{folder / value.removeprefix(AS)}"

    def todict(
        self, parts: Parts, options_of: Callable[[Any], Any]
    ) -> dict[str, Any]:
        load = parts.get("contact.load")
        written = {"contact.load": getattr(load, "written", load)}
        return super().todict({**parts, **written}, options_of)

    def recorded(
        self, ageing: Mapping[str, Any], contact: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        return {self.section: options_in(contact)}

    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        solver = arguments["solver"]
        surface = arguments["surface"]
        load = arguments["load"]
        if answer.load != load:
            return f"load = {answer.load:g} nN, but {load:g} nN were asked for"
        for name in ("shape", "pixel_size"):
            mine, its = getattr(answer, name), getattr(surface, name)
            if mine != its:
                return f"{name} is {mine}, but that of the surface is {its}"
        flat = solver.is_nominally_flat(surface.periodic)
        if answer.periodic != flat:
            return f"periodic is {answer.periodic}, but the solver treats this surface as {flat}"
        for name in ("rms_slope", "rms_height"):
            mine, its = getattr(answer, name), getattr(surface, name)
            if not (
                math.isnan(mine)
                or math.isclose(mine, its, rel_tol=1e-6, abs_tol=1e-300)
            ):
                return f"{name} is {mine:g}, but that of the surface is {its:g}"
        return answer.load_fault(solver.declared_error or 0.0)

    def fault_of(self, made: Any, inputs: StageInputs) -> str:
        from chemage.contacts.search import SoughtLoad

        solver, load = inputs.parts[self.section], inputs.parts["contact.load"]
        load = made.load if isinstance(load, SoughtLoad) else load
        surface = inputs.made.get("surface")
        return (
            self.fault(made, {"solver": solver, "surface": surface, "load": load})
            if surface is not None
            else ""
        )

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        from chemage.contacts.search import CONTACTS, SoughtLoad

        surface, load = stated["surface"], parts["contact.load"]
        numbers = dict(parts[self.section].expected(surface, load))
        pixels = surface.get("nx", 0.0) * surface.get("ny", 0.0)
        area = numbers["nominal_area"] = (
            pixels * surface.get("pixel_size", 0.0) ** 2
        )
        touching = area * numbers.get("area_fraction", 0.0)
        if touching > 0:
            numbers["mean_pressure"] = max(load, 0.0) / touching
        if parts[self.section].gives_map:
            numbers["pixels"] = pixels
            if "cpu_seconds" in numbers:
                if isinstance(load, SoughtLoad):
                    numbers["cpu_seconds"] *= CONTACTS
                    # two further maps
                    numbers["bytes"] = numbers.get("bytes", 0.0) + 16 * pixels
                numbers["cpu_seconds"] += (
                    surface.get("cpu_seconds", 0.0) + PIXEL_SECONDS * pixels
                )
        return numbers

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        """Kind, load, nominal pressure where there is one, and contact modulus, in words."""
        from chemage.contacts.options import force_text, modulus_in
        from chemage.contacts.search import CONTACTS, SoughtLoad

        solver = parts[self.section]
        load = parts["contact.load"]
        area = stated[self.section]["nominal_area"]
        text = f"{solver.kind} at {force_text(load)}"
        if isinstance(load, SoughtLoad):
            text = f"{solver.kind} at {load.written}, about {force_text(load)}, found in about {CONTACTS} contacts"
        if area > 0 and solver.is_nominally_flat(
            stated["surface"].get("periodic", 1.0) != 0
        ):
            pressure = load / area
            text += ", nominal pressure "
            text += (
                f"{pressure:.4g} GPa"
                if abs(pressure) >= 0.1
                else f"{1e3 * pressure:.4g} MPa"
            )
        if (modulus := modulus_in(solver)) is not None:
            text += f", E* {modulus:.6g} GPa"
        if "pixels" not in stated[self.section]:
            text += ", a theory: statistics and no map"
        rows = {self.section: text}
        if (tabor := stated[self.section].get("tabor")) is not None:
            rows["Tabor's parameter"] = (
                f"{tabor:.3g}; attraction is short-ranged above 5, long-ranged below 0.1"
            )
        return rows

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        from chemage.contacts.options import beyond_elasticity, modulus_in
        from chemage.contacts.search import SoughtLoad

        surface = stated["surface"]
        load = parts["contact.load"]
        numbers = stated[self.section]
        for text in parts[self.section].check(surface, load) or ():
            yield Doubt("parts", text)
        if load == 0 and not parts[self.section].adheres:
            yield Doubt(
                "load",
                "the load is 0: nothing touches, the friction drop is 0 and its coefficient undefined",
            )
            return
        slope = surface.get("rms_slope", math.nan)
        mean = numbers.get("mean_pressure", math.nan)
        if isinstance(load, SoughtLoad) and mean > WELL_ABOVE * load.pressure:
            yield Doubt(
                "load",
                f"{load.written} is less than most contacts of this surface have: even under a small load about {mean:.3g} "
                "GPa are expected; give a larger pressure, a smaller modulus or rms slope, or a force",
            )
        if beyond := beyond_elasticity(
            modulus_in(parts[self.section]) or math.nan, slope, mean
        ):
            yield Doubt("elasticity", beyond)
        fraction = numbers.get("area_fraction")
        pixels = (
            fraction * numbers["pixels"]
            if fraction is not None and numbers.get("pixels")
            else math.inf
        )
        all_sites = stated.get("chemistry", {"sites": pixels}).get("sites")
        sites, where = (
            (pixels, "pixels")
            if pixels < NO_SITE or all_sites is None
            else (all_sites, "sites")
        )
        if sites < NO_SITE:
            cause = ""
            if fraction and (size := surface.get("pixel_size")):
                area = fraction * numbers["nominal_area"]
                cause = f": the contact area is about {area:.2g} nm², and a pixel {size * size:.2g} nm²"
            yield Doubt(
                "sites",
                f"about {sites:.1g} {where} will be in contact{cause}; no number of this scene will mean anything. Is "
                f'load = {load:g} nN meant? A bare number is in nN; give another unit as text, such as "20 uN", or '
                "use smaller pixels",
            )
        elif all_sites is not None and all_sites < 100:
            yield Doubt(
                "sites",
                f"only about {all_sites:.0f} sites will be in contact; averages need many replicas or seeds",
            )
        if (fraction or 0.0) > 0.95:
            yield Doubt("area", "the contact is expected to be nearly full")

    def warm_up(self, parts: Parts) -> None:
        if parts[self.section].gives_map:
            parts[self.section].warm_up(
                parts["surface"].expected(), parts["contact.load"]
            )


STAGES = (
    _Contact(
        "contact",
        role="contact",
        required=True,
        takes=("surface",),
        makes="contact",
        always_in_key=True,
        of_material=True,
        beside={"load": Beside("load", _LOAD, "nN", required=True)},
        hooks=("chemage_solve_contact",),
    ),
)
