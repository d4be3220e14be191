"""A check finds a component that breaks it: barriers."""

from __future__ import annotations

import numpy as np
import pytest
from kit_examples import Flat, broken, calls, failing

from chemage import testing


def _shifted():
    """Another distribution at every call."""
    by = 0.01 + 1e-4 * next(calls)
    return broken(Flat, quantile=lambda self, u: Flat.quantile(self, u) + by)()


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ({"quantile": lambda self, u: 1 - u}, "quantile_is_monotone", "falls"),
        ({"quantile": lambda self, u: np.tan(np.pi * (u - 0.5)) / (u > 1e-9)}, "quantile_is_monotone", ""),
        ({"quantile": lambda self, u: u.astype(np.float32)}, "quantile_is_monotone", "float32"),
        ({"quantile": lambda self, u: np.sort(u)}, "barrier_is_the_pixels_own", "the other numbers in the call"),
        ({"quantile": lambda self, u: u + next(calls)}, "calls_are_independent", "second call"),
        ({"quantile": lambda self, u: (0.8 + 0.6 * u).ravel()}, "barrier_is_the_pixels_own", "shape"),
        ({"density": lambda self, e: Flat.density(self, e) * 1.02}, "density_agrees_with_quantile", "integrates to"),
        ({"density": lambda self, e: np.full(e.shape, 1 / 0.6)}, "density_agrees_with_quantile", "thousand eV"),
        ({"density": lambda self, e: -Flat.density(self, e)}, "density_agrees_with_quantile", "negative or infinite"),
        ({"density": lambda self, e: np.array([1.0])}, "density_agrees_with_quantile", "shape"),
        ({"quantile": lambda self, u: np.ones(u.shape)}, "density_agrees_with_quantile", "point mass"),
        ({"members": lambda self, n: [Flat()][:n]}, "members_are_other_distributions", "the distribution itself"),
        ({"members": lambda self, n: [Flat()]}, "members_are_other_distributions", "members(0)"),
        ({"members": lambda self, n: [0.8, 1.4][:n]}, "members_are_other_distributions", "no distribution"),
        ({"members": lambda self, n: [type(self)()][:n]}, "members_are_other_distributions", "has members itself"),
        ({"members": lambda self, n: [_shifted()][:n]}, "members_are_other_distributions", "second call"),
    ],
)
def test_barriers(change, check, said):
    component = broken(Flat, **change)()
    if said:
        assert said in failing(component, check)
    else:
        (one,) = [one for one in testing.checks_for(component) if one.name == check]
        with pytest.raises((AssertionError, RuntimeWarning)):
            one(component)
