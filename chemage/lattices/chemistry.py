"""A chemistry, and the third stage: it turns a contact into a reaction lattice."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import chain
from typing import Annotated, Any, ClassVar, Self, cast

import numpy as np
from pydantic import Field, model_validator

from chemage.contacts.role import expect_contact
from chemage.contacts.solution import Contact, ContactSolution, ContactStatistics
from chemage.foundation import random
from chemage.foundation.checks import Seed, checked_seed, expect
from chemage.foundation.components import Component, call_with
from chemage.foundation.errors import InputError
from chemage.foundation.records import frozen
from chemage.foundation.threads import OncePerObject
from chemage.foundation.units import (
    EV_PER_GPA_NM3,
    KB,
    Force,
    Frequency,
    Pressure,
    Unit,
    Volume,
)
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers, Interaction
from chemage.lattices.site_grid import (
    ONE_PER_PIXEL,
    ContactSites,
    Density,
    contact_sites,
)
from chemage.lattices.states import TWO_STATES, Transition
from chemage.plugins import registry
from chemage.plugins.options import Choice
from chemage.plugins.sources import noted

#: sites per nm²: hydroxyl groups of fully hydroxylated amorphous silica, the arithmetic mean of Zhuravlev, Colloids
#: Surf. A 173, 1 (2000); least squares give 4.6 there
SITE_DENSITY = 4.9
#: classes of pressure
CLASSES = 512
#: side of the grid, all of it in contact, on which the neighbours of a site are counted
GRID = 32
#: graphs of neighbours of the sites of each contact, by interaction, which its replicas share
_graphs: OncePerObject[np.ndarray] = OncePerObject()


def effective_forming(
    intrinsic: np.ndarray, activation_volume: float, pressure: np.ndarray
) -> np.ndarray:
    """E_intrinsic − ΔV·P in eV; ΔV in nm³, P in GPa. Li, Pastewka & Szlufarska 2018, eq. 3."""
    return intrinsic - activation_volume * EV_PER_GPA_NM3 * pressure.astype(
        np.float64, copy=False
    )


class Chemistry(Component):
    """What can react on a contact, and how fast. Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), eqs. 3–5.

    Only sites in contact react; they lie on a square grid of their own. A site forms a bond over the barrier
    E_intrinsic − ΔV·P + Σ couplings of its bonded neighbours, and breaks it over its breaking barrier. What is left out
    is not modelled: no ``breaking`` means bonds last, no ``interaction`` means sites are not coupled,
    ``activation_volume`` 0 means pressure decides only which sites are in contact.
    """

    #: options with which a result is compared: they change no bond, and are no part of :meth:`identity`
    limits: ClassVar[tuple[str, ...]] = (
        "hardness",
        "shear_strength",
        "work_of_adhesion",
    )

    forming: Choice[Barriers]
    """distribution of the intrinsic barrier to forming a bond"""
    breaking: Choice[Barriers] | None = None
    """distribution of the barrier to breaking it; None: bonds last"""
    interaction: Choice[Interaction] | None = None
    """how bonded neighbours change a forming barrier; None: not at all"""
    activation_volume: Volume = 0.0
    """ΔV, nm³ (an energy per pressure such as "0.04 eV/GPa" is one too)"""
    attempt_frequency: Frequency = 1e13
    """ν, Hz"""
    bond_force: Force = 3.0
    """⟨f⟩, mean force to rupture a bond, nN"""
    front_factor: float = Field(default=1.0, gt=0, le=1)
    """fraction of the bonds that carry load at once as the detachment front passes"""
    hydroxylation: float = Field(default=1.0, ge=0, le=1)
    """probability that a site in contact is reactive"""
    site_density: Annotated[
        Density, Unit("1/nm**2", gt=0, words=("pixel", "given"))
    ] = SITE_DENSITY
    """sites per nm²; where their spacing differs from the pixels of the contact, the pressure is reconstructed below
    the pixel, or averaged; "pixel": one site per pixel, whatever its size; "given": those that the surface gives"""
    tensile_sites: bool = True
    """whether sites of an adhesive contact react that are in contact under tension, with a barrier that is raised by
    ΔV times that tension; no: those under pressure alone"""
    hardness: Pressure | None = None
    """hardness of the material, GPa: the result says which share of contact area and load lies above it; None: not
    compared"""
    shear_strength: Pressure | None = None
    """shear strength of the material, GPa, with which the mean shear stress that the bonds carry is compared; None: not
    compared"""
    work_of_adhesion: Annotated[Any, Unit("J/m**2", gt=0)] | None = None
    """work of adhesion of the two surfaces, J/m²: the result compares the load of a sphere without adhesion with its
    pull-off force; None: not compared"""
    transitions: Mapping[str, Transition] | None = None
    """further transitions by name, each a table of its own; by them a site may have more states than free and bonded"""
    humidity: Annotated[Any, Unit("", ge=0, lt=1)] | None = None
    """relative humidity x, such as 0.4 or "40 %", below saturation, on which transitions may depend; None: 0"""
    initial: str | None = None
    """state in which sites come into contact; None: those to which free sites under the pressure of the contact
    come in time without bonds"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        transitions = self.transitions or {}
        unbonded = {None, *(self.states or TWO_STATES)} - {TWO_STATES[1]}
        if self.initial not in unbonded:
            raise ValueError(
                f"initial: {self.initial!r} is no state without a bond"
            )
        if self.humidity is not None and all(
            each.humidity == "none" for each in transitions.values()
        ):
            raise ValueError(
                "humidity: changes nothing; no transition depends on it"
            )
        for name, each in transitions.items():
            if each.neighbours and self.interaction is None:
                raise ValueError(
                    f"transitions.{name}.neighbours: needs [interaction]"
                )
        return self

    @property
    def states(self) -> tuple[str, ...] | None:
        """Names of the states of a site; None: free and bonded alone."""
        if not self.transitions:
            return None
        every = [each.states for each in self.transitions.values()]
        return tuple(dict.fromkeys([*TWO_STATES, *chain(*every)]))

    def identity(self) -> dict[str, Any]:
        """What decides the bonds: the options without :attr:`limits`, and without the defaults of ``site_density``,
        which changes nothing where the pixels of the contact are sites, of ``tensile_sites``, and of further states."""
        options = {
            name: value
            for name, value in super().identity().items()
            if name not in self.limits
        }
        if options["site_density"] == SITE_DENSITY:
            del options["site_density"]
        if self.tensile_sites:
            del options["tensile_sites"]
        return {
            name: value
            for name, value in options.items()
            if value is not None
            or name not in ("transitions", "humidity", "initial")
        }

    def given_limits(self) -> dict[str, float]:
        """Those of :attr:`limits` that are given: name -> GPa, and J/m² of the work of adhesion."""
        return {
            name: value
            for name in self.limits
            if (value := getattr(self, name)) is not None
        }

    def rates(self, barriers: np.ndarray, temperature: float) -> np.ndarray:
        """ν exp(−E/k_B T) of ``barriers`` E (eV) at ``temperature`` K, Hz; ν where E is not above 0."""
        with np.errstate(under="ignore", over="ignore"):
            return self.attempt_frequency * np.exp(
                -np.maximum(barriers, 0.0) / (KB * temperature)
            )

    def sites_of(self, contact: ContactSolution) -> ContactSites:
        """The sites of ``contact`` in contact, and their pressures; see :func:`chemage.plugin.contact_sites`."""
        expect_contact(contact)
        return contact_sites(
            contact, self.site_density, pressed=not self.tensile_sites
        )

    def sites_per_area(self, contact: Contact) -> float:
        """Sites per nm² on ``contact``: those of its grid of sites, or where its map is not known the option.

        Raises
        ------
        InputError
            The contact has no map, and there is to be one site per pixel.
        """
        if contact.has_map:
            return 1 / self.sites_of(cast("ContactSolution", contact)).spacing ** 2
        if isinstance(self.site_density, str):
            raise InputError(
                f"site_density = {self.site_density!r}: a contact without a map has no pixels; give the sites per nm² "
                "in [chemistry]"
            )
        return self.site_density

    def site_notes(self, contact: Contact) -> dict[str, Any]:
        """How the sites belong to the pixels of ``contact``, see :meth:`ContactSites.describe`; empty where each is
        one."""
        if not contact.has_map:
            return {"words": f"{self.site_density} per nm² of contact, no grid"}
        solution = cast("ContactSolution", contact)
        sites = self.sites_of(solution)
        if self.site_density == "given":
            return {"words": sites.words, "touching": sites.sites.size}
        return {} if sites.words == ONE_PER_PIXEL else sites.describe(solution)

    def on(
        self,
        contact: ContactSolution,
        seed: Seed = 0,
        *,
        sites: np.ndarray | None = None,
    ) -> ReactionLattice:
        """The reactive sites of ``contact``, or those of them that are among ``sites`` (ascending flat indices).

        Every random number belongs to a site (or a pair of sites), known by its place on the grid of sites: at the same
        seed a site keeps its barriers, its couplings and its hydroxylation when load, temperature, activation volume or
        the pixels of the contact change, or when other sites are left out.
        """
        expect_contact(contact)
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        touching = self.sites_of(contact)
        whole = sites is None and self.hydroxylation == 1
        sites, pressure = (
            (touching.sites, touching.pressure)
            if sites is None
            else _chosen(touching, sites)
        )
        graph = None
        if self.hydroxylation < 1:
            kept = (
                random.uniforms(seed, random.HYDROXYLATION, sites)
                < self.hydroxylation
            )
            sites, pressure = sites[kept], pressure[kept]
        if self.interaction is not None:
            # that of every site is shared by the replicas
            graph = (
                neighbours_of(touching, self.interaction)
                if whole
                else graph_of(touching, self.interaction, sites)
            )
        fields: dict[str, Any] = {
            "pixels": touching.shape,
            "sites": sites,
            "forming": effective_forming(
                self.forming.quantile(random.uniforms(seed, random.FORMING, sites)),
                self.activation_volume,
                pressure,
            ),
            "attempt_frequency": self.attempt_frequency,
            "pixel_size": touching.spacing,
            **self._further(sites, pressure, seed),
        }
        if touching.rule != "pixels":
            fields |= {"pressure": pressure, "origin": touching.origin}
        if self.breaking is not None:
            fields["breaking"] = self.breaking.quantile(
                random.uniforms(seed, random.BREAKING, sites)
            )
        if self.interaction is not None and graph is not None:
            fields |= {
                "neighbours": graph,
                "coupling": coupling_of(
                    touching, self.interaction, sites, graph, seed
                ),
            }
        return ReactionLattice(**fields)

    def _further(
        self, sites: np.ndarray, pressure: np.ndarray, seed: Seed
    ) -> dict[str, Any]:
        """The fields of a lattice for :attr:`transitions`."""
        states = self.states
        if states is None or self.transitions is None:
            return {}
        transitions = list(self.transitions.values())
        barriers = np.empty((sites.size, len(transitions)))
        for number, each in enumerate(transitions):
            intrinsic = each.barrier
            if isinstance(intrinsic, Barriers):
                ranks = random.uniforms(seed, random.TRANSITION, sites, number)
                intrinsic = intrinsic.quantile(ranks)
            barriers[:, number] = effective_forming(
                intrinsic, each.activation_volume, pressure
            )
        return {
            "states": states,
            "initial": self.initial and states.index(self.initial),
            "transitions": [
                [*map(states.index, each.states)] for each in transitions
            ],
            "transition_barriers": barriers,
            "transition_terms": [
                [each.neighbours, each.factor(self.humidity or 0.0)]
                for each in transitions
            ],
        }


def neighbours_of(contact: ContactSites, interaction: Interaction) -> np.ndarray:
    """Which sites in contact are neighbours under ``interaction``: (n, k) int32, -1 = none; read-only."""
    return _graphs.get(
        contact,
        interaction,
        lambda: frozen(graph_of(contact, interaction, contact.sites), np.int32),
    )


def graph_of(
    contact: ContactSites, interaction: Interaction, sites: np.ndarray
) -> np.ndarray:
    """Which of ``sites``, in contact, are neighbours under ``interaction``: (n, k) int32, -1 = none."""
    return call_with(
        interaction.neighbours,
        contact.shape,
        contact.periodic,
        sites,
        pixel_size=contact.spacing,
        positions=None,
    )


def coupling_of(
    contact: ContactSites,
    interaction: Interaction,
    sites: np.ndarray,
    neighbours: np.ndarray,
    seed: Seed,
) -> np.ndarray:
    """What a bonded neighbour adds to the forming barrier of each of ``sites``: (n, k) eV."""
    return call_with(
        interaction.coupling,
        sites,
        neighbours,
        seed,
        pixel_size=contact.spacing,
        positions=None,
        pixels=contact.shape,
        periodic=contact.periodic,
    )


def _chosen(touching: ContactSites, sites: Any) -> tuple[np.ndarray, np.ndarray]:
    """Sites in contact and their pressures, of those that are asked for by their flat indices."""
    chosen = np.asarray(sites)
    if (
        chosen.ndim != 1
        or chosen.dtype.kind not in "iu"
        or (chosen[1:] <= chosen[:-1]).any()
    ):
        raise InputError("sites: give ascending flat indices of sites, each once")
    at = np.searchsorted(touching.sites, chosen)
    if (at == touching.sites.size).any() or (touching.sites[at] != chosen).any():
        raise InputError(
            "sites: some are not in contact; choose from chemistry.sites_of(contact).sites"
        )
    return touching.sites[at], touching.pressure[at]


def chemistry(**options: Any) -> Chemistry:
    """A :class:`Chemistry`: ``chemage.chemistry(forming=chemage.barriers("md-silica"), ...)``."""
    return Chemistry(**options)


def contact_statistics(
    contact: ContactSolution | ContactStatistics, chemistry: Chemistry
) -> ContactStatistics:
    """The statistics of ``contact``, at the sites of ``chemistry``; itself where that is all there is of it.

    Each class has the mean pressure of its sites. Without an interaction no site has neighbours, and ``missing`` is
    one column.
    """
    if not contact.has_map:
        return cast("ContactStatistics", contact)
    contact = cast("ContactSolution", contact)
    expect_contact(contact)
    expect(
        "chemistry",
        chemistry,
        Chemistry,
        "make one with chemage.chemistry(forming=...)",
    )
    if chemistry.states:
        raise InputError(
            "transitions: sites of more than two states have no statistics by pressure; simulate every site, without "
            "[ageing]"
        )
    if chemistry.site_density == "given":
        raise InputError(
            "site_density = 'given': the sites of a surface have no statistics by pressure; simulate every site, "
            "without [ageing]"
        )
    sites = chemistry.sites_of(contact)
    pressure = sites.pressure.astype(np.float64)
    if float(pressure.min(initial=0.0)) < 0:
        raise InputError(
            "contact: sites under tension have no statistics by pressure; leave them out with tensile_sites = false in "
            "[chemistry], or simulate every site"
        )
    top = float(pressure.max(initial=0.0))
    place = (
        np.minimum((pressure * (CLASSES / top)).astype(np.int64), CLASSES - 1)
        if top > 0
        else np.zeros(0, np.int64)
    )
    counts = np.bincount(place, minlength=CLASSES)
    there = counts > 0
    mean = np.bincount(place, pressure, CLASSES)[there] / counts[there]
    most, lacking = 0, np.zeros(pressure.size, np.int64)
    if chemistry.interaction is not None and pressure.size:
        most = coordination(chemistry.interaction, sites.spacing)  # pyright: ignore[reportArgumentType]
        present = np.count_nonzero(
            neighbours_of(sites, chemistry.interaction) >= 0, axis=1
        )
        lacking = np.clip(most - present, 0, most)
    joint = np.bincount(
        place * (most + 1) + lacking, minlength=CLASSES * (most + 1)
    ).reshape(CLASSES, most + 1)
    return ContactStatistics(
        pressure=mean,
        area=counts[there] * sites.spacing**2,
        missing=joint[there] * sites.spacing**2,
        load=contact.load,
        nominal_area=contact.nominal_area,
        modulus=contact.modulus,
        rms_slope=contact.rms_slope,
        rms_height=contact.rms_height,
        notes=contact.notes,
        provenance=contact.provenance,
    )


@lru_cache(maxsize=64)
def coordination(interaction: Interaction, spacing: float) -> int:
    """Neighbours of a site inside a contact, under ``interaction`` on sites at a distance of ``spacing`` nm."""
    sites = np.arange(GRID * GRID)
    graph = call_with(
        interaction.neighbours,
        (GRID, GRID),
        True,
        sites,
        pixel_size=spacing,
        positions=None,
    )
    return int(np.count_nonzero(graph >= 0, axis=1).max(initial=0))


def barriers(kind: str, **options: Any) -> Any:
    """A distribution of energy barriers."""
    return registry.current().make("barriers", kind, options)


def interaction(kind: str, **options: Any) -> Any:
    """An interaction of neighbouring sites."""
    return registry.current().make("interaction", kind, options)


def build_lattice(
    chemistry: Chemistry,
    contact: ContactSolution,
    seed: Seed = 0,
    *,
    sites: np.ndarray | None = None,
) -> ReactionLattice:
    """The reactive sites of ``contact``, or those among ``sites``, through the hook ``chemage_build_lattice``.

    The plugins that took part are noted in the lattice's ``provenance``.

    Raises
    ------
    PluginError
        What a plugin gave contradicts the contact, or are others than the ``sites`` that are given.
    """
    expect(
        "chemistry",
        chemistry,
        Chemistry,
        "make one with chemage.chemistry(forming=...)",
    )
    expect_contact(contact)
    # derived before replicas share it, so that a plugin that changes it is found whichever is the first
    _ = contact.sites
    lattice, took_part, recorded = registry.current().answer(
        "chemage_build_lattice",
        ReactionLattice,
        chemistry=chemistry,
        contact=contact,
        seed=seed,
        sites=sites,
    )
    return noted(lattice, recorded, took_part, chemistry)
