"""The statistics of a solved contact: its area by pressure, and by the neighbours that its sites lack."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.foundation.checks import expect
from chemage.foundation.components import call_with
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.neighbours import neighbours_of
from chemage.lattices.role import Interaction

#: classes of pressure
CLASSES = 512
#: side of the grid, all of it in contact, on which the neighbours of a site are counted
GRID = 32


def contact_statistics(contact: ContactSolution, chemistry: Chemistry) -> ContactStatistics:
    """The statistics of ``contact``, at the sites of ``chemistry``.

    Each class has the mean pressure of its sites. Without an interaction no site has neighbours, and ``missing`` is
    one column.
    """
    expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
    expect("chemistry", chemistry, Chemistry, "make one with chemage.chemistry(forming=...)")
    sites = chemistry.sites_of(contact)
    pressure = sites.pressure.astype(np.float64)
    top = float(pressure.max(initial=0.0))
    place = np.minimum((pressure * (CLASSES / top)).astype(np.int64), CLASSES - 1) if top > 0 else np.zeros(0, np.int64)
    counts = np.bincount(place, minlength=CLASSES)
    there = counts > 0
    mean = np.bincount(place, pressure, CLASSES)[there] / counts[there]
    most, lacking = 0, np.zeros(pressure.size, np.int64)
    if chemistry.interaction is not None and pressure.size:
        most = coordination(chemistry.interaction, sites.spacing)  # pyright: ignore[reportArgumentType]
        found = np.count_nonzero(neighbours_of(sites, chemistry.interaction) >= 0, axis=1)
        lacking = np.clip(most - found, 0, most)
    joint = np.bincount(place * (most + 1) + lacking, minlength=CLASSES * (most + 1)).reshape(CLASSES, most + 1)
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
    graph = call_with(interaction.neighbours, (GRID, GRID), True, sites, pixel_size=spacing, positions=None)
    return int(np.count_nonzero(graph >= 0, axis=1).max(initial=0))
