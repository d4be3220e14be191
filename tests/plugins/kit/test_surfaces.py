"""A check finds a component that breaks it: surface makers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from kit_examples import White, broken, calls, failing, flat_surface

from chemage.plugin import random


def _spawned(seed: Any) -> Any:
    return seed.spawn(1)[0] if isinstance(seed, np.random.SeedSequence) else seed


def _entropy(seed: Any) -> Any:
    return seed.entropy if isinstance(seed, np.random.SeedSequence) else seed


@pytest.mark.parametrize(
    ("make", "check", "said"),
    [
        (lambda self, seed=0: np.ones((2, 2)), "makes_a_surface", "returned ndarray"),
        (lambda self, seed=0: flat_surface(np.ones((2, 2)), provenance={}), "makes_a_surface", "provenance is empty"),
        (lambda self, seed=0: flat_surface(np.ones((2, 2)), provenance={"n": (1,)}), "makes_a_surface", "tuple"),
        (lambda self, seed=0: flat_surface(np.ones((2, 2)), provenance={"n": math.nan}), "makes_a_surface", "JSON"),
        (
            lambda self, seed=7: flat_surface(np.full((2, 2), float(seed))),
            "makes_a_surface",
            "make(0) differ",
        ),
        (lambda self, seed=0: flat_surface([[float(next(calls))]]), "surface_follows_its_seed", "same seed gave two"),
        (lambda self, seed=0: flat_surface([[float(seed == 1)]]), "surface_follows_its_seed", "2 different results"),
        (
            lambda self, seed=0: flat_surface(np.random.default_rng(_spawned(seed)).random((2, 2))),
            "surface_follows_its_seed",
            "spawned children of the given SeedSequence",
        ),
        (
            lambda self, seed=0: flat_surface(np.random.default_rng(_entropy(seed)).random((2, 2))),
            "surface_follows_its_seed",
            "two children",
        ),
        (
            lambda self, seed=0: flat_surface([[np.random.rand() * 0]]),  # noqa: NPY002
            "surface_follows_its_seed",
            "global random state",
        ),
        (
            lambda self, seed=0: flat_surface(random.uniforms(seed, 300, np.arange(9).reshape(3, 3))),
            "surface_follows_its_seed",
            "make(-1): raised ValueError",
        ),
    ],
)
def test_surfaces(make, check, said):
    assert said in failing(broken(White, make=make)(), check)


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        (None, "expected a dict"),
        ({"nx": 9.0}, "expected() has nx = 9.0, not 8"),
        ({"pixel_size": 2.0}, "has pixel_size = 2.0"),
        ({"rms_slope": 0.01}, "has rms_slope = 0.01"),
        ({"rms_slope": math.nan}, "rms_slope = nan"),
        ({"slope": 0.01}, "returned 'slope'; known are nx, ny"),
    ],
)
def test_what_surfaces_say_beforehand(said, problem):
    assert problem in failing(broken(White, expected=lambda self: said)(), "surface_is_as_expected")
