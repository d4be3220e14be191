"""The reaction lattice: from plain arrays, what is refused, its graph and its picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import chemage as ca
from chemage import InputError, ReactionLattice


@pytest.fixture
def contact(examples):
    return examples.contact


@pytest.fixture
def lattice(examples):
    return examples.lattice


def test_the_neighbour_graph_is_made_once_per_interaction(contact):
    pressed, forming = contact(), ca.barriers("uniform", lower=0.8, upper=1.2)
    pairs = ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1)
    first, second = (
        ca.chemistry(forming=forming, interaction=one, site_density="pixel").on(pressed, seed).neighbours
        for seed, one in enumerate((pairs, pairs.replace(strength=0.5)))
    )
    assert np.shares_memory(first, second)  # equal options, the same graph
    assert first.dtype == np.int32
    assert not first.flags.writeable


def test_a_lattice_from_plain_arrays(lattice):
    made = lattice()
    assert made.interacting
    assert not lattice(neighbours=None, coupling=None).interacting
    assert made.neighbours.dtype == np.int32
    assert made.sites.dtype == np.int64
    assert lattice(sites=[], forming=[], breaking=[], neighbours=np.empty((0, 8), int), coupling=np.empty((0, 8)))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"pixels": (0, 3)}, r"pixels: \(0, 3\); give two positive numbers"),
        ({"sites": [[1, 4, 7]]}, r"sites: shape \(1, 3\)"),
        ({"sites": [1, 4, 9]}, r"sites: from 1 to 9, outside the grid of \(3, 3\)"),
        ({"sites": [-1, 4, 7]}, r"sites: from -1 to 7, outside"),
        ({"sites": [1, 4, 4]}, "sites: pixel 4 is listed twice; list each once"),
        ({"sites": [4, 1, 7]}, "sites: not in ascending order; sort them"),
        ({"sites": [1.0, 4.0, 7.0]}, "sites: expected whole numbers, not float64"),
        ({"forming": [0.8, 0.9]}, r"forming: shape \(2,\), but there are 3 sites; give one value per site"),
        ({"forming": [0.8, 0.9, np.nan]}, "forming: 1 of 3 values are not finite; give barriers in eV"),
        ({"breaking": [1.1]}, r"breaking: shape \(1,\), but there are 3 sites"),
        ({"breaking": [1.1, np.inf, 1.1]}, "breaking: 1 of 3 values are not finite"),
        ({"coupling": None}, "neighbours and coupling: give both, or neither"),
        ({"neighbours": None}, "neighbours and coupling: give both, or neither"),
        ({"coupling": [[0.1], [0.1], [0.1]]}, r"neighbours \(3, 2\) and coupling \(3, 1\): both must be \(3, k\)"),
        ({"coupling": [[0.1, 0], [0.1, np.nan], [np.nan, 0]]}, "coupling: 2 of 6 values are not finite"),
        ({"neighbours": [[1, -1], [0, 3], [1, -1]]}, r"neighbours\[1, 1\] = 3 is not a site; give 0 to 2, or -1"),
        ({"neighbours": [[1, -2], [0, 2], [1, -1]]}, r"neighbours\[0, 1\] = -2 is not a site"),
        ({"neighbours": [[0, -1], [1, 2], [1, -1]]}, r"neighbours\[0, 0\]: site 0 is its own neighbour; remove it"),
        ({"neighbours": [[1, 1], [0, 2], [1, -1]]}, r"neighbours\[0\]: site 1 is listed twice"),
        ({"neighbours": [[1, -1], [-1, 2], [1, -1]]}, "site 0 lists 1, but not the other way round"),
        ({"neighbours": [[-1, -1], [0, 2], [1, -1]]}, "site 1 lists 0, but not the other way round"),
        (
            {"coupling": [[0.3, 0.0], [0.1, -0.2], [-0.2, 0.0]]},
            r"coupling\[0, 0\]: the pair \(0, 1\) has two values; give both ends the same energy",
        ),
        ({"neighbours": np.array([[2**32 + 1, -1], [0, 2], [1, -1]])}, "do not fit int32"),
        ({"attempt_frequency": 0.0}, "attempt_frequency: 0.0"),
    ],
)
def test_lattices_that_are_refused(lattice, changes, problem):
    with pytest.raises(InputError, match=f"ReactionLattice: .*{problem}"):
        lattice(**changes)


@given(st.integers(2, 6), st.integers(1, 4), st.randoms(use_true_random=False))
def test_one_wrong_entry_in_a_sound_graph_is_found(n, k, chance):
    """Any single change of an entry of a complete graph makes it one-sided, doubled, foreign or its own."""
    k = min(k, n - 1)
    ring = [[(i + s) % n for s in range(1, k + 1)] for i in range(n)]
    both = [sorted({*row, *(j for j in range(n) if i in ring[j])}) for i, row in enumerate(ring)]
    wide = max(map(len, both))
    neighbours = np.array([row + [-1] * (wide - len(row)) for row in both])
    coupling = np.where(neighbours >= 0, 0.1, 0.0)
    sound = {"pixels": (n, 1), "sites": np.arange(n), "forming": np.ones(n), "coupling": coupling}
    ReactionLattice(neighbours=neighbours, **sound)
    i, s = chance.randrange(n), chance.randrange(wide)
    wrong = chance.choice([j for j in range(-2, n + 1) if j != neighbours[i, s]])
    changed = neighbours.copy()
    changed[i, s] = wrong
    with pytest.raises(InputError, match=r"ReactionLattice: (neighbours|coupling)"):
        ReactionLattice(neighbours=changed, **sound)


def test_to_atoms_shows_sites_bonds_and_barriers(lattice):
    made = lattice()
    atoms = made.to_atoms(np.array([True, False, True]))
    assert atoms.get_chemical_symbols() == ["O", "H", "O"]
    assert np.allclose(atoms.positions, np.array([[0.5, 1.5, 0], [1.5, 1.5, 0], [2.5, 1.5, 0]]) * 4.5)
    assert atoms.arrays["forming"].tolist() == [0.8, 0.9, 1.0]
    assert atoms.arrays["breaking"].tolist() == [1.1, 1.1, 1.2]
    assert atoms.cell.lengths()[:2].tolist() == [13.5, 13.5]
    assert lattice(breaking=None).to_atoms().get_chemical_symbols() == ["H", "H", "H"]
    assert len(lattice(sites=[], forming=[], breaking=None, neighbours=None, coupling=None).to_atoms()) == 0
