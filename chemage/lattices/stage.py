"""The third stage: a chemistry turns a contact into a reaction lattice."""

from __future__ import annotations

from typing import Any

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, expect
from chemage.foundation.errors import PluginError
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


def build_lattice(
    chemistry: Chemistry, contact: ContactSolution, seed: Seed = 0, *, sites: np.ndarray | None = None
) -> ReactionLattice:
    """The reactive sites of ``contact``, or those among ``sites``, through the hook ``chemage_build_lattice``.

    The plugins that took part are noted in the lattice's ``provenance``.

    Raises
    ------
    PluginError
        ``sites`` are given, and a plugin answers with others.
    """
    expect("chemistry", chemistry, Chemistry, "make one with chemage.chemistry(forming=...)")
    expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
    lattice, plugins = registry.current().answer(
        "chemage_build_lattice", ReactionLattice, chemistry=chemistry, contact=contact, seed=seed, sites=sites
    )
    if sites is not None and not np.isin(lattice.sites, sites).all():
        raise PluginError(
            f"chemage_build_lattice: {', '.join(plugins) or 'a plugin'} gave sites that were not asked for, so that "
            "the contact cannot be sampled; the hook must keep to its argument sites, or leave the plugin out"
        )
    return lattice.noting(providers(chemistry) | plugins, approximations(chemistry))
