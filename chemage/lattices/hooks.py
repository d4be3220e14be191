"""What can be plugged into this stage: barriers, interactions, and the hook that builds a reaction lattice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import Doubt, Parts, Stage, Stated, hookimpl, hookspec

if TYPE_CHECKING:
    import numpy as np

    from chemage.contacts.solution import ContactSolution
    from chemage.foundation.checks import Seed
    from chemage.lattices.chemistry import Chemistry
    from chemage.lattices.lattice import ReactionLattice

ROLES = {
    "barriers": "chemage.lattices.role:Barriers",
    "interaction": "chemage.lattices.role:Interaction",
}


@hookspec(firstresult=True)
def chemage_build_lattice(
    chemistry: Chemistry,
    contact: ContactSolution,
    seed: Seed,
    sites: np.ndarray | None,
) -> ReactionLattice | None:
    """Turn a contact into reactive sites. Return None to leave it to the next plugin; chemage itself answers last.

    ``sites``, where it is not None, are ascending flat indices of sites in contact: a sample, and no other site is
    wanted.
    """


class OwnChemistryMethod:
    """The chemistry's own method."""

    @hookimpl(trylast=True)
    def chemage_build_lattice(
        self,
        chemistry: Chemistry,
        contact: ContactSolution,
        seed: Seed,
        sites: np.ndarray | None,
    ) -> ReactionLattice:
        return chemistry.on(contact, seed, sites=sites)


ANSWERS = OwnChemistryMethod


class _Chemistry(Stage):
    def key_entries(self, sections: Mapping[str, Any]) -> list[Any]:
        own = sections.get(self.section)
        if (
            own is not None
        ):  # what the density makes of the sites is in the key, see key_ends
            own = {
                name: value for name, value in own.items() if name != "site_density"
            }
        return super().key_entries({**sections, self.section: own})

    def key_ends(self, parts: Parts) -> Mapping[str, Any]:
        chemistry, grids = parts.get(self.section), parts.get("grids")
        if chemistry is None or "hold" not in parts:
            return {}
        ends: dict[str, Any] = {}
        if not (grids and grids[0] == grids[1]):
            ends[self.key] = {
                "sites": grids[1] if grids else chemistry.site_density
            }
        elif chemistry.site_density == "given":
            ends[self.key] = {"sites": chemistry.site_density}
        if limits := chemistry.given_limits():
            ends["result"] = limits
        return ends

    def recorded(
        self, ageing: Mapping[str, Any], contact: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        return {
            name: ageing.get(name) or ageing.get(self.section, {}).get(name)
            for name in self.parts
        }

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        from chemage.lattices.independent import (
            expected_kinetics,
            rough_pressures,
            smooth_pressures,
        )

        chemistry = parts[self.section]
        contact = stated["contact"]
        grids = parts.get("grids")
        fraction = contact.get("area_fraction")
        density = chemistry.site_density
        pressure = contact.get("mean_pressure")
        numbers: dict[str, float] = {}
        whole = contact.get("pixels")
        if whole is None and not isinstance(
            density, str
        ):  # no map, and so no grid of sites
            whole = contact["nominal_area"] * density
        elif whole and grids:
            whole = float(grids[1][0] * grids[1][1])
        if density == "given":
            whole = stated["surface"].get("sites")
        if fraction is not None and whole:
            numbers["sites"] = fraction * whole * chemistry.hydroxylation
        if "hold" in parts and pressure is not None:
            spread = (
                smooth_pressures
                if "radius" in stated["surface"]
                else rough_pressures
            )
            last = float(parts["hold"].hold_times[-1])
            temperature = parts["hold"].temperature
            expected = expected_kinetics(
                chemistry, spread(pressure), last, temperature
            )
            numbers |= {
                "events": expected.events,
                "bonded": expected.bonded,
                "pressure": pressure,
            }
        return numbers

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        from chemage.foundation.errors import InputError
        from chemage.lattices.site_grid import SITE_POSITIONS, adhering

        grids, maker = parts.get("grids"), parts["surface"]
        density: Any = getattr(parts.get(self.section), "site_density", None)
        if density == "given" and SITE_POSITIONS not in maker.outputs:
            raise InputError.of(
                "site_density",
                density,
                f"surface {maker.kind!r} has no sites",
                "use one that has, or give sites per nm²",
            )
        if (
            grids
            and parts["contact"].adheres
            and grids[1][0] * grids[1][1] > grids[0][0] * grids[0][1]
        ):
            raise InputError.of(
                "site_density",
                density,
                *adhering(stated["surface"]["pixel_size"], density),
            )
        return iter(())

    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        import numpy as np

        contact, sites = arguments["contact"], arguments["sites"]
        if sites is not None and not np.isin(answer.sites, sites).all():
            return (
                "gave sites that were not asked for, so that the contact cannot be sampled; the hook must keep to its "
                "argument sites, or leave the plugin out"
            )
        if answer.pressure is None:
            if answer.pixels != contact.shape:
                nx, ny = answer.pixels
                return f"a grid of {nx} x {ny} sites that are not the {contact.shape} pixels needs their pressure"
            if answer.pixel_size != contact.pixel_size:
                return f"pixel_size is {answer.pixel_size:g} nm, but that of the contact is {contact.pixel_size:g} nm"
        elif contact.touching is None and (answer.pressure < 0).any():
            return f"a pressure of {answer.pressure.min():g} GPa on a site; a contact only pushes"
        return ""

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        from chemage.foundation.units import EV_PER_GPA_NM3
        from chemage.lattices.site_grid import in_words, nominal_ratio

        if "hold" not in parts:
            return {self.section: "not modelled: contact mechanics only"}
        chemistry, grids = parts[self.section], parts.get("grids")
        rows = {
            "forming": chemistry.forming.kind
            + (
                f", lowered by {chemistry.activation_volume * EV_PER_GPA_NM3:.3g} eV/GPa"
                if chemistry.activation_volume
                else ", pressure only decides who is in contact"
            ),
            "breaking": chemistry.breaking.kind
            if chemistry.breaking
            else "not modelled: bonds last",
            "interaction": chemistry.interaction.kind
            if chemistry.interaction
            else "not modelled: no neighbour list",
        }
        if grids:
            gap = getattr(parts["contact"], "gap", False) is True
            ratio = nominal_ratio(
                stated["surface"]["pixel_size"], chemistry.site_density
            )
            rows["sites"] = in_words(*grids, gap=gap, ratio=ratio)
        if chemistry.site_density == "given":
            rows["sites"] = "those of the surface"
        for name, each in (chemistry.transitions or {}).items():
            rows[name] = f"{each.reaction}; {each.source or 'no source is given'}"
        return rows


STAGES = (
    _Chemistry(
        "chemistry",
        options="chemage.lattices.chemistry:Chemistry",
        parts={
            "forming": "barriers",
            "breaking": "barriers",
            "interaction": "interaction",
        },
        about="what turns a contact into reactive sites",
        missing={
            "forming": "needs [forming], the barriers to forming a bond; add it, or leave this out"
        },
        needs="forming",
        inputs=("contact",),
        key="ageing",
        always_in_key=True,
        of_material=True,
        hooks=("chemage_build_lattice",),
    ),
)
