"""Barriers that are wrong with members, with many sites or in threads, each found by the check named for it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from kit_examples import Flat, mutant

from chemage import testing

pytestmark = pytest.mark.long


class Ensemble(Flat):
    """A distribution of which the data allow two others."""

    kind = "ensemble"
    allowed: tuple[float, ...] = (0.75, 0.85)
    """lower ends of the others, eV"""

    def members(self, count):
        return [self.replace(low=low, allowed=()) for low in self.allowed[:count]]


_work = np.zeros(100_000)


def _shared(self, uniform):
    """All threads work in one array."""
    if uniform.ndim != 1:
        return Flat.quantile(self, uniform)
    mine = _work[: uniform.size]
    mine[:] = uniform
    time.sleep(1e-3)
    return Flat.quantile(self, mine)


def _short(self, uniform):
    """Numbers sites in 16 bits."""
    flat = uniform.ravel()
    return Flat.quantile(self, flat[np.arange(flat.size).astype(np.uint16)]).reshape(uniform.shape)


def _of_members(right: Any, wrong: Any) -> Any:
    """Right for the distribution, wrong for its members."""
    return lambda self, given: (right if self.allowed else wrong)(self, given)


def _parent(self, energy):
    return Flat.density(self.replace(low=0.8), energy)


def _falling(self, uniform):
    return Flat.quantile(self, 1 - uniform)


def _in_kj(self, uniform):
    return 96.5 * Flat.quantile(self, uniform)


def _ranked(self, uniform):
    order = np.argsort(np.argsort(uniform, axis=None)).reshape(uniform.shape)
    return Flat.quantile(self, (order + 0.5) / max(uniform.size, 1))


SOUND = "members_are_sound"
MUTANTS: dict[str, tuple[dict[str, Any], str]] = {
    "members with the density of the whole": ({"density": _of_members(Flat.density, _parent)}, SOUND),
    "members that fall": ({"quantile": _of_members(Flat.quantile, _falling)}, SOUND),
    "members in kJ/mol": ({"quantile": _of_members(Flat.quantile, _in_kj)}, SOUND),
    "members with ranks in place of numbers": ({"quantile": _of_members(Flat.quantile, _ranked)}, SOUND),
    "numbers of sites in 16 bits": ({"quantile": _short}, "barrier_is_the_pixels_own"),
    "threads that share an array": ({"quantile": _shared}, "calls_are_independent"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_wrong_barriers(name, caught):
    changes, check = MUTANTS[name]
    found, said = caught(mutant(Ensemble, name, **changes)(), check)
    assert found == check, said


def test_right_barriers_with_members_pass():
    testing.check_barriers(Ensemble(), all=True)
