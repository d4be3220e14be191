"""Elastic pairs: who is whose neighbour, and one energy for each pair of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import chemage as ca
from chemage import InputError
from chemage.plugin import random

STEPS = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]
PAIRS = ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1)


@st.composite
def contacts(draw):
    """A grid, its boundary, and some of its pixels."""
    nx, ny = draw(st.tuples(st.integers(1, 7), st.integers(1, 7)))
    chosen = draw(st.lists(st.booleans(), min_size=nx * ny, max_size=nx * ny))
    return (nx, ny), draw(st.booleans()), np.flatnonzero(chosen)


def neighbours_by_hand(pixels, periodic, sites):
    """Sets of positions, found pixel by pixel."""
    nx, ny = pixels
    position = {int(site): i for i, site in enumerate(sites)}
    found = []
    for site in sites:
        x, y = divmod(int(site), ny)
        around = set()
        for dx, dy in STEPS:
            u, v = x + dx, y + dy
            if periodic:
                u, v = u % nx, v % ny
            if 0 <= u < nx and 0 <= v < ny and (u, v) != (x, y) and u * ny + v in position:
                around.add(position[u * ny + v])
        found.append(around)
    return found


def random_contact(seed=0, pixels=(61, 53), share=0.4):
    mask = np.random.default_rng(seed).random(pixels) < share
    return pixels, np.flatnonzero(mask)


@given(contacts())
def test_neighbours_are_the_eight_nearest_pixels_that_are_sites(contact):
    pixels, periodic, sites = contact
    table = PAIRS.neighbours(pixels, periodic, sites)
    assert table.shape == (sites.size, 8)
    assert table.dtype == np.int32
    for row, expected in zip(table, neighbours_by_hand(pixels, periodic, sites), strict=True):
        listed = row[row >= 0].tolist()
        assert len(listed) == len(set(listed))
        assert set(listed) == expected


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(
    "pixels", [(1, 1), (1, 2), (2, 1), (1, 3), (1, 11), (2, 2), (2, 13), (13, 2), (3, 3), (17, 19)]
)
def test_full_small_and_prime_sized_grids(pixels, periodic):
    sites = np.arange(pixels[0] * pixels[1])
    table = PAIRS.neighbours(pixels, periodic, sites)
    assert [set(row[row >= 0].tolist()) for row in table] == neighbours_by_hand(pixels, periodic, sites)
    assert np.count_nonzero(table >= 0) == sum(map(len, neighbours_by_hand(pixels, periodic, sites)))


@pytest.mark.parametrize("periodic", [True, False])
def test_columns_are_directions(periodic):
    pixels, sites = random_contact()
    table = PAIRS.neighbours(pixels, periodic, sites)
    x, y = np.divmod(sites, pixels[1])
    for slot, (dx, dy) in enumerate(STEPS):
        there = table[:, slot] >= 0
        other = table[there, slot]
        assert there.any()
        np.testing.assert_array_equal((x[there] + dx - x[other]) % pixels[0], 0)
        np.testing.assert_array_equal((y[there] + dy - y[other]) % pixels[1], 0)
        np.testing.assert_array_equal(table[other, 7 - slot], np.flatnonzero(there))


@given(contacts(), st.integers(0, 2**40))
def test_every_pair_has_one_energy_and_the_lattice_accepts_it(contact, seed):
    pixels, periodic, sites = contact
    table = PAIRS.neighbours(pixels, periodic, sites)
    coupling = PAIRS.coupling(sites, table, seed)
    here, slot = np.nonzero(table >= 0)
    there = table[here, slot]
    phi = random.pair_uniforms(seed, random.PAIR, sites[here], sites[there])
    np.testing.assert_array_equal(coupling[here, slot], (0.5 * (phi - 0.1)).astype(np.float32))
    assert not coupling[table < 0].any()
    # the lattice itself refuses a graph or couplings that are not symmetric
    ca.ReactionLattice(pixels=pixels, sites=sites, forming=np.ones(sites.size), neighbours=table, coupling=coupling)


def test_phi_is_uniform_and_independent_of_direction():
    pixels, sites = random_contact(share=0.9, pixels=(160, 160))
    table = PAIRS.neighbours(pixels, True, sites)
    coupling = PAIRS.coupling(sites, table, 5)
    forward = table > np.arange(sites.size)[:, None]
    phi = coupling / 0.5 + 0.1
    assert stats.kstest(phi[forward], "uniform").pvalue > 1e-3
    assert coupling[table >= 0].min() >= 0.5 * (0 - 0.1)
    assert coupling[table >= 0].max() < 0.5 * (1 - 0.1)
    for slot in range(8):
        assert stats.kstest(phi[table[:, slot] >= 0, slot], "uniform").pvalue > 1e-3
    both = np.all(table[:, :2] >= 0, axis=1)
    assert abs(np.corrcoef(phi[both, 0], phi[both, 1])[0, 1]) < 4 / np.sqrt(both.sum())


def test_one_bond_in_ten_helps_its_neighbour_at_the_default_bias():
    assert ca.interaction("elastic-pairs", strength=0.5).bias == 0.1
    pixels, sites = random_contact(share=0.9, pixels=(160, 160))
    table = PAIRS.neighbours(pixels, True, sites)
    values = PAIRS.coupling(sites, table, 1)[table > np.arange(sites.size)[:, None]]
    assert np.mean(values < 0) == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / values.size))


def test_a_pair_keeps_its_number_when_the_contact_or_the_strength_changes():
    pixels, sites = random_contact()
    few = sites[np.random.default_rng(1).random(sites.size) < 0.6]

    def by_pair(chosen, interaction, seed=3):
        table = interaction.neighbours(pixels, True, chosen)
        coupling = interaction.coupling(chosen, table, seed)
        here, slot = np.nonzero(table >= 0)
        return {(int(chosen[i]), int(chosen[table[i, s]])): coupling[i, s] for i, s in zip(here, slot, strict=True)}

    all_pairs, some_pairs = by_pair(sites, PAIRS), by_pair(few, PAIRS)
    assert len(some_pairs) > 1000
    assert all(all_pairs[pair] == value for pair, value in some_pairs.items())
    weak = by_pair(sites, PAIRS.replace(strength="0.25 eV"))
    assert all(weak[pair] == 0.5 * value for pair, value in all_pairs.items())
    other = by_pair(sites, PAIRS, seed=4)
    assert np.mean([other[pair] == value for pair, value in all_pairs.items()]) == 0


def test_read_only_lists_and_lists_of_other_integers_are_fine():
    pixels, sites = random_contact(pixels=(9, 9))
    expected = PAIRS.neighbours(pixels, True, sites)
    frozen = sites.copy()
    frozen.setflags(write=False)
    for same in (frozen, sites.astype(np.int32), np.repeat(sites, 2)[::2]):
        np.testing.assert_array_equal(PAIRS.neighbours(pixels, True, same), expected)


@pytest.mark.parametrize(
    "sites",
    [[3, 2], [2, 2], [-1, 2], [0, 12], [12], [-5]],
    ids=["falling", "twice", "negative", "last", "beyond", "one"],
)
def test_a_list_that_is_not_ascending_pixels_of_the_grid_is_refused(sites):
    with pytest.raises(InputError, match="sites"):
        PAIRS.neighbours((3, 4), True, np.array(sites))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "strength: is required"),
        ({"strength": "0.5 nm"}, "nanometer"),
        ({"strength": -0.5}, "strength"),
        ({"strength": 0.5, "bias": float("nan")}, "bias"),
        ({"strength": 0.5, "range": 2}, "no such option"),
    ],
)
def test_wrong_options_are_refused_in_words(options, words):
    with pytest.raises(InputError, match=words):
        ca.interaction("elastic-pairs", **options)
