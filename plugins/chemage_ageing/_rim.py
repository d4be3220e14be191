"""How many neighbours the sites of a contact have, and how many these count for under their own pressures."""

from __future__ import annotations

import numpy as np

from chemage import Chemistry, ContactSolution
from chemage.plugin import ContactStatistics, build_lattice

#: effective neighbours beyond those of a site inside a contact, over their number
BEYOND = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
#: sites of a contact whose neighbours are looked at; of a larger one so many, evenly over the pressures
SITES = 65_536
#: sites that are treated at the same time
CHUNK = 8192


def of_statistics(statistics: ContactStatistics, per_area: float, most: int) -> np.ndarray:
    """(classes, most + 1): sites of each class of pressure that have so many neighbours."""
    held = np.zeros((statistics.area.size, most + 1))
    if statistics.missing is None:
        held[:, most] = statistics.area * per_area
        return held
    lacking = np.minimum(np.arange(statistics.missing.shape[1]), most)
    np.add.at(held.T, most - lacking, statistics.missing.T * per_area)
    return held


def of_map(
    contact: ContactSolution, chemistry: Chemistry, statistics: ContactStatistics, independent: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sites of each class of pressure that have so many neighbours, (classes, most + 1); and so many effective ones,
    (classes, most + 1 + beyond, m).

    A neighbour counts as the share of bonded sites without interaction under its pressure over that under the pressure
    of the site; ``independent``, (classes, m), are these shares. Between two whole numbers a site is divided.
    """
    lattice = build_lattice(chemistry.replace(hydroxylation=1.0), contact, 0)
    assert lattice.neighbours is not None
    pressure = np.asarray(chemistry.sites_of(contact).pressure, dtype=np.float64)
    between = 0.5 * (statistics.pressure[1:] + statistics.pressure[:-1])
    place = np.append(np.searchsorted(between, pressure), len(independent))  # the last: no neighbour
    chosen = np.arange(pressure.size)
    if pressure.size > SITES:
        chosen = np.argsort(pressure, kind="stable")[((np.arange(SITES) + 0.5) * (pressure.size / SITES)).astype(int)]
    share = np.concatenate([independent, np.zeros((1, independent.shape[1]))])
    classes, columns = len(independent), np.concatenate([np.arange(most + 1.0), most * np.array(BEYOND)])
    present = np.zeros(classes * (most + 1))
    effective = np.zeros((classes * columns.size, independent.shape[1]))
    for begin in range(0, chosen.size, CHUNK):
        some = chosen[begin : begin + CHUNK]
        graph, own = lattice.neighbours[some], place[some]
        present += np.bincount(
            own * (most + 1) + np.minimum(np.count_nonzero(graph >= 0, axis=1), most), minlength=present.size
        )
        around = place[graph]
        for time in range(independent.shape[1]):
            column = share[:, time]
            count = np.divide(column[around].sum(axis=1), column[own], out=np.zeros(own.size), where=column[own] > 0)
            count = np.minimum(count, columns[-1])
            left = np.clip(np.searchsorted(columns, count, side="right") - 1, 0, columns.size - 2)
            right = (count - columns[left]) / (columns[left + 1] - columns[left])
            at = own * columns.size + left
            effective[:, time] += np.bincount(at, 1 - right, len(effective))
            effective[:, time] += np.bincount(at + 1, right, len(effective))
    scale = pressure.size / chosen.size
    return scale * present.reshape(classes, -1), scale * effective.reshape(classes, columns.size, -1)
