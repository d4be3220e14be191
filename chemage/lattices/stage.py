"""The third stage: a chemistry turns a contact into a reaction lattice."""

from __future__ import annotations

from typing import Any

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, expect
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.sources import approximations, providers


def barriers(kind: str, **options: Any) -> Any:
    """A distribution of energy barriers."""
    return registry.current().make("barriers", kind, options)


def interaction(kind: str, **options: Any) -> Any:
    """An interaction of neighbouring sites."""
    return registry.current().make("interaction", kind, options)


def build_lattice(chemistry: Chemistry, contact: ContactSolution, seed: Seed = 0) -> ReactionLattice:
    """The reactive sites of ``contact``, through the hook ``chemage_build_lattice``.

    The plugins that took part are noted in the lattice's ``provenance``.
    """
    expect("chemistry", chemistry, Chemistry, "make one with chemage.chemistry(forming=...)")
    expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
    lattice, plugins = registry.current().answer(
        "chemage_build_lattice", ReactionLattice, chemistry=chemistry, contact=contact, seed=seed
    )
    return lattice.noting(providers(chemistry) | plugins, approximations(chemistry))
