"""A check finds a component that breaks it: interactions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kit_examples import Chain, broken, calls, failing


def _graph(change: Any) -> Any:
    return {"neighbours": lambda self, *grid: change(Chain.neighbours(self, *grid), *grid)}


def _coupling(change: Any) -> Any:
    return {"coupling": lambda self, *given: change(Chain.coupling(self, *given), *given)}


def _self_listed(graph, pixels, periodic, sites):
    graph = graph.copy()
    graph[:1, 0] = 0
    return graph


def _one_sided(graph, pixels, periodic, sites):
    graph = graph.copy()
    graph[:1] = -1
    return graph


def _directed(energy, sites, neighbours, seed):
    return np.where(neighbours >= 0, energy + 1e-3 * np.arange(sites.size)[:, None], 0.0)


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        (_graph(lambda graph, *grid: graph.astype(np.int64)), "graph_is_sound", "int64"),
        (_graph(lambda graph, *grid: graph.ravel()), "graph_is_sound", "1x1"),
        (_graph(_self_listed), "graph_is_sound", "its own neighbour"),
        (_graph(_one_sided), "graph_is_sound", "not the other way round"),
        (_graph(lambda graph, *grid: np.hstack([graph, graph])), "graph_is_sound", "listed twice"),
        (_coupling(_directed), "graph_is_sound", "two values"),
        (_coupling(lambda energy, *given: energy + 0.1), "graph_is_sound", "without a neighbour"),
        (_coupling(lambda energy, *given: energy[:, :1]), "graph_is_sound", "coupling"),
        (
            _coupling(lambda energy, sites, *given: energy * (1 + sites.size)),
            "pair_keeps_its_energy",
            "other sites were removed",
        ),
        (_graph(lambda graph, *grid: np.full_like(graph, -1)), "pair_keeps_its_energy", "no site has a neighbour"),
        (_coupling(lambda energy, *given: energy * next(calls)), "coupling_follows_its_seed", "same seed"),
    ],
)
def test_interactions(change, check, said):
    assert said in failing(broken(Chain, **change)(), check)
