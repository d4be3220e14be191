"""The chemistry: what turns a contact into a reaction lattice."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from chemage.contacts.solution import ContactSolution
from chemage.foundation import random
from chemage.foundation.checks import Seed, checked_seed, expect
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.units import EV_PER_GPA_NM3, Force, Frequency, Pressure, UnitOrWord, Volume
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.neighbours import coupling_of, graph_of, neighbours_of
from chemage.lattices.role import Barriers, Interaction
from chemage.lattices.site_grid import ContactSites, Density, contact_sites
from chemage.plugins.choices import Choice

#: sites per nm²: hydroxyl groups of fully hydroxylated amorphous silica, the arithmetic mean of Zhuravlev, Colloids
#: Surf. A 173, 1 (2000); least squares give 4.6 there
SITE_DENSITY = 4.9


def effective_forming(intrinsic: np.ndarray, activation_volume: float, pressure: np.ndarray) -> np.ndarray:
    """E_intrinsic − ΔV·P in eV; ΔV in nm³, P in GPa. Li, Pastewka & Szlufarska 2018, eq. 3."""
    return intrinsic - activation_volume * EV_PER_GPA_NM3 * pressure.astype(np.float64, copy=False)


class Chemistry(Component):
    """What can react on a contact, and how fast. Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), eqs. 3–5.

    Only sites in contact react; they lie on a square grid of their own. A site forms a bond over the barrier
    E_intrinsic − ΔV·P + Σ couplings of its bonded neighbours, and breaks it over its breaking barrier. What is left out
    is not modelled: no ``breaking`` means bonds last, no ``interaction`` means sites are not coupled,
    ``activation_volume`` 0 means pressure decides only which sites are in contact.
    """

    #: options with which a result is compared: they change no bond, and are no part of :meth:`identity`
    limits: ClassVar[tuple[str, ...]] = ("hardness", "shear_strength")

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
    site_density: Annotated[Density, UnitOrWord("pixel", "1/nm**2", gt=0)] = SITE_DENSITY
    """sites per nm²; where their spacing differs from the pixels of the contact, the pressure is reconstructed below
    the pixel, or averaged; "pixel": one site per pixel, whatever its size"""
    hardness: Pressure | None = None
    """hardness of the material, GPa: the result says which share of contact area and load lies above it; None: not
    compared"""
    shear_strength: Pressure | None = None
    """shear strength of the material, GPa, with which the mean shear stress that the bonds carry is compared; None: not
    compared"""

    def identity(self) -> dict[str, Any]:
        """What decides the bonds: the options without :attr:`limits`, and without the default ``site_density``, which
        changes nothing where the pixels of the contact are sites."""
        found = {name: value for name, value in super().identity().items() if name not in self.limits}
        if found["site_density"] == SITE_DENSITY:
            del found["site_density"]
        return found

    def given_limits(self) -> dict[str, float]:
        """Those of :attr:`limits` that are given: name -> GPa."""
        return {name: value for name in self.limits if (value := getattr(self, name)) is not None}

    def sites_of(self, contact: ContactSolution) -> ContactSites:
        """The sites of ``contact`` in contact, and their pressures; see :func:`chemage.plugin.contact_sites`."""
        expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
        return contact_sites(contact, self.site_density)

    def on(self, contact: ContactSolution, seed: Seed = 0, *, sites: np.ndarray | None = None) -> ReactionLattice:
        """The reactive sites of ``contact``, or those of them that are among ``sites`` (ascending flat indices).

        Every random number belongs to a site (or a pair of sites), known by its place on the grid of sites: at the same
        seed a site keeps its barriers, its couplings and its hydroxylation when load, temperature, activation volume or
        the pixels of the contact change, or when other sites are left out.
        """
        expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        touching = self.sites_of(contact)
        whole = sites is None and self.hydroxylation == 1
        sites, pressure = (touching.sites, touching.pressure) if sites is None else _chosen(touching, sites)
        graph = None
        if self.hydroxylation < 1:
            kept = random.uniforms(seed, random.HYDROXYLATION, sites) < self.hydroxylation
            sites, pressure = sites[kept], pressure[kept]
        if self.interaction is not None:
            # that of every site is shared by the replicas
            graph = neighbours_of(touching, self.interaction) if whole else graph_of(touching, self.interaction, sites)
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
        }
        if touching.rule != "pixels":
            fields |= {"pressure": pressure, "origin": touching.origin}
        if self.breaking is not None:
            fields["breaking"] = self.breaking.quantile(random.uniforms(seed, random.BREAKING, sites))
        if self.interaction is not None and graph is not None:
            fields |= {"neighbours": graph, "coupling": coupling_of(touching, self.interaction, sites, graph, seed)}
        return ReactionLattice(**fields)


def _chosen(touching: ContactSites, sites: Any) -> tuple[np.ndarray, np.ndarray]:
    """Sites in contact and their pressures, of those that are asked for by their flat indices."""
    chosen = np.asarray(sites)
    if chosen.ndim != 1 or chosen.dtype.kind not in "iu" or (chosen[1:] <= chosen[:-1]).any():
        raise InputError("sites: give ascending flat indices of sites, each once")
    at = np.searchsorted(touching.sites, chosen)
    if (at == touching.sites.size).any() or (touching.sites[at] != chosen).any():
        raise InputError("sites: some are not in contact; choose from chemistry.sites_of(contact).sites")
    return touching.sites[at], touching.pressure[at]


def chemistry(**options: Any) -> Chemistry:
    """A :class:`Chemistry`: ``chemage.chemistry(forming=chemage.barriers("md-silica"), ...)``."""
    return Chemistry(**options)
