"""Neighbours and couplings on extreme grids: empty, tiny, huge."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import chemage as ca

PAIRS = ca.interaction("elastic-pairs", strength=0.5)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("pixels", [(1, 1), (5, 7), (2500, 2500)])
def test_no_sites_no_neighbours(pixels, periodic):
    none = np.zeros(0, dtype=np.int64)
    table = PAIRS.neighbours(pixels, periodic, none)
    assert table.shape == (0, 8)
    assert PAIRS.coupling(none, table, 0).shape == (0, 8)


@pytest.mark.parametrize("pixels", [(1, 1), (1, 2), (2, 2), (9, 9)])
def test_a_lone_site_has_no_neighbour_not_even_itself(pixels):
    assert np.all(PAIRS.neighbours(pixels, True, np.array([0])) == -1)


def test_memory_grows_with_sites_not_with_pixels():
    # four corners of a grid of 1e10 pixels, joined across its edges
    n = 100_000
    sites = np.array([0, n - 1, n * (n - 1), n * n - 1])
    PAIRS.neighbours((3, 3), True, np.array([0]))  # compiled before memory is counted
    tracemalloc.start()
    table = PAIRS.neighbours((n, n), True, sites)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 50 * n
    assert [set(row[row >= 0].tolist()) for row in table] == [{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}]
    assert np.all(PAIRS.neighbours((n, n), False, sites) == -1)
    coupling = PAIRS.coupling(sites, table, 1)
    assert np.unique(coupling[table >= 0]).size == 6


def test_zero_strength_gives_zero_coupling():
    none = ca.interaction("elastic-pairs", strength=0)
    sites = np.arange(25)
    assert not none.coupling(sites, none.neighbours((5, 5), True, sites), 0).any()
