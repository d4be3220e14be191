"""Checks of an interaction between neighbouring sites."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from chemage.foundation.errors import InputError
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Interaction
from chemage.testing.checks import check_of, require, run_checks, seeds_are_harmless


def check_interaction(component: Interaction) -> None:
    """Run every check of the role ``interaction``; raises AssertionError if one fails."""
    run_checks(component, Interaction, {})


_GRIDS = ((1, 1), (1, 2), (2, 2), (1, 7), (2, 5), (3, 3), (7, 5), (13, 11))


def _patches_of_sites(grid: tuple[int, int]) -> Iterator[np.ndarray]:
    size = grid[0] * grid[1]
    yield np.arange(size, dtype=np.int64)
    some = np.flatnonzero(np.random.default_rng(size).random(size) < 0.6).astype(np.int64)
    if some.size < size:
        yield some
    yield np.empty(0, np.int64)


@check_of("interaction")
def _graph_is_sound(component: Interaction) -> None:
    """The graph is symmetric, with one energy per pair, no self-loops and no double edges, on all small grids."""
    for grid in _GRIDS:
        for periodic in (True, False):
            for sites in _patches_of_sites(grid):
                where = f"{grid[0]}x{grid[1]} grid, periodic={periodic}, {sites.size} sites"
                neighbours = component.neighbours(grid, periodic, sites)
                require(neighbours.dtype == np.int32, f"{where}: neighbours are {neighbours.dtype}, not int32")
                require(neighbours.ndim == 2 and neighbours.shape[0] == sites.size, f"{where}: {neighbours.shape}")
                coupling = component.coupling(sites, neighbours, 0)
                require(coupling.shape == neighbours.shape, f"{where}: coupling {coupling.shape}")
                require((coupling[neighbours < 0] == 0).all(), f"{where}: energy without a neighbour")
                try:
                    ReactionLattice(
                        pixels=grid,
                        sites=sites,
                        forming=np.ones(sites.size),
                        neighbours=neighbours,
                        coupling=coupling,
                    )
                except InputError as error:
                    raise AssertionError(f"{where}: {error}") from error


def _pairs(component: Interaction, grid: tuple[int, int], sites: np.ndarray, seed: Any) -> dict[tuple[int, int], float]:
    neighbours = component.neighbours(grid, True, sites)
    coupling = component.coupling(sites, neighbours, seed)
    i, s = np.nonzero(neighbours >= 0)
    return {
        (int(sites[a]), int(sites[b])): float(energy)
        for a, b, energy in zip(i, neighbours[i, s], coupling[i, s], strict=True)
    }


@check_of("interaction")
def _pair_keeps_its_energy(component: Interaction) -> None:
    """The energy of a pair of pixels does not depend on the other sites of the contact."""
    grid = (13, 11)
    everywhere, here = list(_patches_of_sites(grid))[:2]
    all_pairs, some = _pairs(component, grid, everywhere, 3), _pairs(component, grid, here, 3)
    require(all_pairs and some, "no site has a neighbour on a full 13x11 grid")
    chosen = set(here.tolist())
    expected = {pair: energy for pair, energy in all_pairs.items() if chosen.issuperset(pair)}
    require(some == expected, "pairs or their energies changed when other sites were removed")


@check_of("interaction")
def _coupling_follows_its_seed(component: Interaction) -> None:
    grid, sites = (13, 11), np.arange(143, dtype=np.int64)
    seeds_are_harmless(lambda seed: tuple(_pairs(component, grid, sites, seed).items()), "coupling")
