"""Bonded share of sites that do not interact, exactly: by quadrature over their barriers, without any noise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from chemage import Chemistry
from chemage.plugin import EV_PER_GPA_NM3, KB, TwoState

#: nodes per k_BT of the grid of energies; cubic interpolation between them errs by 4e-5 of a rate at most
PER_KT = 5
#: pressures between which the bonds of groups of sites are interpolated
PRESSURES = 33
#: panels of the quadrature over the barriers, each half as wide as its neighbour towards the middle: the lowest forming
#: barriers react first, and bonds with the highest breaking barriers last longest
PANELS, FINE_PANELS, FINE, COARSE = 48, 10, 256, 32


def shift_per_gpa(chemistry: Chemistry) -> float:
    """By how much pressure lowers the forming barrier, eV/GPa."""
    return chemistry.activation_volume * EV_PER_GPA_NM3


def bonded_share(chemistry: Chemistry, temperature: float, hold_times: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Share of the sites in contact that are bonded if none interacts, (n, m), at each ``pressure`` (n,) GPa.

    A site forms its bond at the rate a = ν exp(−E_f/k_BT) and breaks it at b = ν exp(−E_b/k_BT), a barrier at or below
    0 meaning ν; it is bonded with the probability a/(a + b) [1 − exp(−(a + b) t)], which is averaged over the
    distributions of both barriers.
    """
    kt = KB * temperature
    step = kt / PER_KT
    shift = shift_per_gpa(chemistry) * np.asarray(pressure, dtype=np.float64) / step
    longest = float(hold_times.max(initial=0.0))
    # higher barriers are not crossed
    nodes = int((np.log(max(chemistry.attempt_frequency * longest, 1.0)) + 40.0) * PER_KT) + 3
    # a power of two, so that contacts share the result
    shifts = 1 << max(4, int(np.ceil(shift.max(initial=0.0)) + 3).bit_length())
    shifts = min(shifts, nodes + 4)
    curves = _curves(chemistry, kt, hold_times.tobytes(), nodes, shifts)  # pyright: ignore[reportArgumentType]
    return interpolated(curves, np.minimum(shift, shifts - 2.0)) * chemistry.hydroxylation


def grouped_bonds(
    chemistry: Chemistry,
    temperature: float,
    hold_times: np.ndarray,
    pressure: np.ndarray,
    group: np.ndarray,
    groups: int,
) -> np.ndarray:
    """Expected bonds in each of ``groups`` groups of sites if none interacts, (groups, m), within about 1e-3.

    Site i is under ``pressure[i]`` GPa and in ``group[i]``; between 33 pressures is interpolated.
    """
    nodes = np.linspace(0.0, float(pressure.max(initial=0.0)) or 1.0, PRESSURES)
    right = np.clip(np.searchsorted(nodes, pressure), 1, PRESSURES - 1)
    part = np.clip(pressure / nodes[1] - (right - 1), 0.0, 1.0)
    at, shape = group * PRESSURES + right, groups * PRESSURES
    weights = np.bincount(at, part, shape) + np.bincount(at - 1, 1 - part, shape)
    return weights.reshape(groups, PRESSURES) @ bonded_share(chemistry, temperature, hold_times, nodes)


@lru_cache(maxsize=32)
def _curves(chemistry: Chemistry, kt: float, times: bytes, nodes: int, shifts: int) -> np.ndarray:
    """The share at ``shifts`` equal steps of the barrier, (shifts + 1, m); the first row is at one step above 0."""
    hold_times = np.frombuffer(times)
    step = kt / PER_KT
    forming = _weights(chemistry.forming.quantile(_ranks()[0]), step, nodes)
    share = _of_energy(chemistry, kt, hold_times, nodes)
    # barriers below 0 react as those at 0
    below = np.concatenate([np.repeat(share[:1], shifts, axis=0), share, share[-1:]])
    rows = [forming @ below[shifts - j : shifts - j + nodes] for j in range(-1, shifts)]
    return np.clip(np.stack(rows), 0.0, 1.0)


def _of_energy(chemistry: Chemistry, kt: float, hold_times: np.ndarray, nodes: int) -> np.ndarray:
    """The share of sites of one forming barrier, averaged over their breaking barriers, (nodes, m)."""
    energy = np.arange(nodes) / PER_KT
    forming = chemistry.attempt_frequency * np.exp(-energy)
    if chemistry.breaking is None:
        return TwoState(forming[:, None]).relaxed(hold_times)
    weights = _weights(chemistry.breaking.quantile(_ranks()[0]), kt / PER_KT, nodes)
    chosen = np.flatnonzero(weights)
    breaking = chemistry.attempt_frequency * np.exp(-energy[chosen])
    sites = TwoState(forming[:, None], breaking)
    settled = sites.equilibrium * weights[chosen]
    return np.stack([np.einsum("ij,ij->i", settled, sites.relaxed(time)) for time in hold_times], axis=1)


@lru_cache(maxsize=1)
def _ranks() -> tuple[np.ndarray, np.ndarray]:
    """Ranks in (0, 1) and their weights: midpoints, the finer the nearer to either end."""
    edges = []
    for panel in range(1, PANELS + 1):
        count = FINE if panel <= FINE_PANELS else COARSE
        edges.append(np.linspace(0.5 ** (panel + 1), 0.5**panel, count + 1))
    ranks = np.concatenate([0.5 * (part[1:] + part[:-1]) for part in edges])
    weights = np.concatenate([np.diff(part) for part in edges])
    return np.concatenate([ranks, 1 - ranks]), np.tile(weights / (2 * weights.sum()), 2)


def _weights(energies: np.ndarray, step: float, nodes: int) -> np.ndarray:
    """The distribution of the barriers of all ranks on the nodes of energy, (nodes,), by cubic interpolation."""
    place = np.clip(energies / step, 0.0, nodes - 1.0)
    shares = np.zeros(nodes)
    first, parts = cubic(place, lowest=-1)
    for offset, part in enumerate(parts):
        shares += np.bincount(np.clip(first + offset, 0, nodes - 1), _ranks()[1] * part, nodes)
    return shares


def cubic(place: np.ndarray, lowest: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Lagrange's cubic interpolation on whole numbers: the first of four nodes, ``lowest`` at least, and the weight of
    each. ``place`` is between the two nodes in the middle, or at the lower end between the first two."""
    first = np.maximum(np.floor(place).astype(np.int64) - 1, lowest)
    a, b, c, d = (place - (first + node) for node in range(4))
    return first, [-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6]


def interpolated(curves: np.ndarray, place: np.ndarray) -> np.ndarray:
    """``curves`` (k + 1, m), of which row 1 is at place 0, at each ``place`` (n,), cubic: (n, m)."""
    first, parts = cubic(place, lowest=-1)
    return sum(
        (part[:, None] * curves[np.clip(first + offset + 1, 0, len(curves) - 1)] for offset, part in enumerate(parts)),
        np.zeros((place.size, curves.shape[1])),
    )
