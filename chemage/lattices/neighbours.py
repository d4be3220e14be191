"""The graph of neighbouring sites of a contact, made once and shared by its replicas."""

from __future__ import annotations

import numpy as np

from chemage.foundation.checks import Seed
from chemage.foundation.components import call_with
from chemage.foundation.records import frozen
from chemage.foundation.threads import OncePerObject
from chemage.lattices.role import Interaction
from chemage.lattices.site_grid import ContactSites

#: of the sites of each contact, by interaction
_graphs: OncePerObject[np.ndarray] = OncePerObject()


def neighbours_of(contact: ContactSites, interaction: Interaction) -> np.ndarray:
    """Which sites in contact are neighbours under ``interaction``: (n, k) int32, -1 = none; read-only."""
    return _graphs.get(contact, interaction, lambda: frozen(graph_of(contact, interaction, contact.sites), np.int32))


def graph_of(contact: ContactSites, interaction: Interaction, sites: np.ndarray) -> np.ndarray:
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
    contact: ContactSites, interaction: Interaction, sites: np.ndarray, neighbours: np.ndarray, seed: Seed
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
