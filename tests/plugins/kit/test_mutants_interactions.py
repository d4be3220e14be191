"""Interactions that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Shell, calls, caught_by, mutant
from scipy.spatial import cKDTree

from chemage import testing
from chemage.plugin import Energy, Interaction, Length, random

pytestmark = pytest.mark.long

#: what an interaction of twenty neighbours does wrong -> the check that finds it
FAULTS = {
    "always wraps": "patch_keeps_its_graph",
    "never wraps": "graph_is_the_same_everywhere",
    "wraps along y only": "graph_is_the_same_everywhere",
    "rows and columns mixed up": "graph_is_the_same_everywhere",
    "nothing at the edges": "patch_keeps_its_graph",
    "runs on into the next row": "graph_is_the_same_everywhere",
    "twice on narrow grids": "graph_is_sound",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_graph(fault):
    found, said = caught_by(mutant(Shell, fault, fault=fault)())
    assert found == FAULTS[fault], said


def energies(name: str, change: Any) -> Any:
    """An interaction whose energies are passed through ``change``."""

    def coupling(self: Any, sites: Any, neighbours: Any, seed: Any) -> Any:
        return change(Shell.coupling(self, sites, neighbours, seed), sites, neighbours, seed)

    return mutant(Shell, name, coupling=coupling)


def graph(name: str, change: Any) -> Any:
    """An interaction whose graph is passed through ``change``."""

    def neighbours(self: Any, pixels: Any, periodic: Any, sites: Any) -> Any:
        return change(Shell.neighbours(self, pixels, periodic, sites), pixels, periodic, sites)

    return mutant(Shell, name, neighbours=neighbours)


def _by_place(energy, sites, neighbours, seed):
    i = np.arange(sites.size)[:, None]
    return np.where(neighbours >= 0, 0.01 + 0.001 * (i + neighbours), 0.0)


def _by_call(energy, *given):
    return energy * (1 + 0.01 * (next(calls) % 7))


def _global(energy, *given):
    return energy * np.random.rand()  # noqa: NPY002


def _same_for_children(energy, sites, neighbours, seed):
    return energy * random.uniforms(seed.entropy if isinstance(seed, np.random.SeedSequence) else seed, 77, 3)


def _overwriting(energy, sites, neighbours, seed):
    sites.sort()
    sites += 0
    return energy


_graphs: dict[int, np.ndarray] = {}


def _remembered(found, pixels, periodic, sites):
    """Kept by the number of sites, which is not enough."""
    return _graphs.setdefault(sites.size, found) if sites.size > 100 else found


class Quick(Shell):
    """Leaves out distant neighbours where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("quick",)
    quick: bool = False
    """whether to leave them out"""

    def coupling(self, sites, neighbours, seed):
        found = super().coupling(sites, neighbours, seed)
        return np.where(found < 0.1, 0.0, found) if self.quick else found


OTHERS: dict[str, tuple[Any, str]] = {
    "energies in kJ/mol": (lambda: energies("kj", lambda e, *g: 96.5 * e), "energies_are_in_ev"),
    "energies in J": (lambda: energies("joule", lambda e, *g: 1.6e-19 * e), "energies_are_in_ev"),
    "energies by place in the list": (lambda: energies("place", _by_place), "pair_keeps_its_energy"),
    "energies by call": (lambda: energies("call", _by_call), "calls_are_independent"),
    "numpy's global state": (lambda: energies("global", _global), "calls_are_independent"),
    "one number for all replicas": (lambda: energies("children", _same_for_children), "coupling_follows_its_seed"),
    "energies from one end only": (
        lambda: energies("directed", lambda e, s, n, seed: np.where(n > np.arange(s.size)[:, None], 2 * e, e)),
        "graph_is_sound",
    ),
    "energy in empty slots": (lambda: energies("empty", lambda e, *g: e + 0.1), "graph_is_sound"),
    "pairs listed twice": (lambda: graph("twice", lambda f, *g: np.hstack([f, f])), "graph_is_sound"),
    "neighbours as pixels": (
        lambda: graph("pixels", lambda f, p, q, s: np.where(f >= 0, s[f], -1).astype(np.int32) if s.size else f),
        "graph_is_sound",
    ),
    "a graph kept by the number of sites": (lambda: graph("kept", _remembered), "graph_is_the_same_everywhere"),
    "writes into its argument": (lambda: energies("writes", _overwriting), "graph_is_sound"),
    "quick and different": (lambda: Quick, "options_count"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_wrong_interaction(name):
    make, check = OTHERS[name]
    _graphs.clear()
    found, said = caught_by(make()())
    assert found == check, said


# -- under other conditions -------------------------------------------------------------------------------------------


class Placed(Interaction):
    """Sites within a distance are coupled, wherever they lie in their pixels."""

    kind = "placed"

    reach: Length = 0.7
    """largest distance, nm"""
    strength: Energy = 0.05
    """energy of a pair, eV"""

    def neighbours(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
        if positions is None:
            positions = (np.stack(np.divmod(sites, pixels[1]), axis=1) + 0.5) * pixel_size
        box = np.array(pixels) * pixel_size if periodic else None
        ends = cKDTree(positions, boxsize=box).query_pairs(1.0001 * self.reach, output_type="ndarray")
        ends = np.concatenate([ends, ends[:, ::-1]]).reshape(-1, 2)
        ends = ends[np.lexsort((ends[:, 1], ends[:, 0]))]
        counts = np.bincount(ends[:, 0], minlength=sites.size)
        slot = np.arange(len(ends)) - np.repeat(np.cumsum(counts) - counts, counts)
        found = np.full((sites.size, max(int(counts.max(initial=0)), 1)), -1, np.int32)
        found[ends[:, 0], slot] = ends[:, 1]
        return found

    def coupling(self, sites, neighbours, seed):
        return np.where(neighbours >= 0, self.strength, 0.0)


def _in_pixels(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
    """Takes positions for pixels."""
    places = None if positions is None else positions * pixel_size
    return Placed.neighbours(self, pixels, periodic, sites, pixel_size, places)


def _one_per_pixel(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
    """Knows one site of each pixel, the last one."""
    found = Placed.neighbours(self, pixels, periodic, sites, pixel_size, positions)
    last = {site: number for number, site in enumerate(sites.tolist())}
    same = np.array([last[site] for site in sites.tolist()], np.int32)
    return np.where(found >= 0, same[found], -1).astype(np.int32) if sites.size else found


def _short(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
    """Numbers sites in 16 bits."""
    found = Placed.neighbours(self, pixels, periodic, sites, pixel_size, positions)
    return np.where(found >= 0, found & 0xFFFF, -1).astype(np.int32)


def _square(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
    """Repeats what is not square."""
    return Placed.neighbours(self, pixels, periodic or pixels[0] != pixels[1], sites, pixel_size, positions)


_work = np.zeros(100_000, np.int64)
_returned: dict[Any, np.ndarray] = {}


def _in_one_array(self, pixels, periodic, sites, pixel_size=0.4518, positions=None):
    mine = _work[: sites.size]
    mine[:] = sites
    time.sleep(1e-3)
    return Placed.neighbours(self, pixels, periodic, mine, pixel_size, positions)


def _same_array(self, sites, neighbours, seed):
    """Returns one array again and again."""
    found = _returned.setdefault(neighbours.shape, np.zeros(neighbours.shape))
    found[:] = Placed.coupling(self, sites, neighbours, seed) * (1 + 0.1 * random.uniforms(seed, 78, np.arange(1)))
    return found


CONDITIONS: dict[str, tuple[dict[str, Any], str]] = {
    "positions in pixels": ({"neighbours": _in_pixels}, "sites_need_not_be_pixels"),
    "one site in a pixel assumed": ({"neighbours": _one_per_pixel}, "sites_need_not_be_pixels"),
    "numbers of sites in 16 bits": ({"neighbours": _short}, "sites_may_be_many"),
    "a window that is not square repeats": ({"neighbours": _square}, "patch_keeps_its_graph"),
    "threads that share an array": ({"neighbours": _in_one_array}, "calls_are_independent"),
    "one array for all answers": ({"coupling": _same_array}, "calls_are_independent"),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_an_interaction_that_is_wrong_under_other_conditions(name, caught):
    changes, check = CONDITIONS[name]
    found, said = caught(mutant(Placed, name, **changes)(), check)
    assert found == check, said


def test_an_interaction_that_is_right_under_all_conditions_passes():
    testing.check_interaction(Placed(), all=True)
