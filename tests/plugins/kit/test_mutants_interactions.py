"""Interactions that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Shell, calls, caught_by, mutant

from chemage.plugin import random

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
