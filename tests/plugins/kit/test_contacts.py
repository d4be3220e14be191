"""A check finds a component that breaks it: contact solvers."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Bed, broken, calls, changed, failing, with_fields


@pytest.mark.parametrize("said", [{"area_fraction": 1.5}, {"cpu_seconds": -1.0}, {"bytes": math.inf}, {"area": 0.1}])
def test_what_solvers_say_beforehand(said):
    wrong = broken(Bed, expected=lambda self, surface, load: said)()
    assert next(iter(said)) in failing(wrong, "contact_cost_is_estimated")


def _bed(change: Any) -> Any:
    def _solve(self, surface, load, start):
        return change(Bed._solve(self, surface, load, start), surface, start)

    return broken(Bed, _solve=_solve)()


@pytest.mark.parametrize(
    ("component", "check", "said"),
    [
        (broken(Bed, reference=lambda self: None)(), "reference_solves_the_same_contact", "returned None"),
        (
            broken(Bed, reference=lambda self: self.replace(modulus=2 * self.modulus))(),
            "reference_solves_the_same_contact",
            "another contact",
        ),
        (_bed(lambda s, surface, start: s.pressure), "contact_carries_the_load", "returned ndarray"),
        (_bed(with_fields(load=lambda s: 2 * s.load)), "contact_carries_the_load", "the solution has"),
        (_bed(with_fields(pressure=lambda s: s.pressure * 1.001)), "contact_carries_the_load", "integrates to"),
        (
            _bed(with_fields(pressure=lambda s: np.full(s.shape, s.load / s.nominal_area))),
            "contact_carries_the_load",
            "expected some contact",
        ),
        (_bed(with_fields(pixel_size=lambda s: 9.0)), "solution_describes_itself", "pixel_size is 9.0"),
        (_bed(with_fields(periodic=lambda s: False)), "solution_describes_itself", "periodic is False"),
        (_bed(with_fields(rms_slope=lambda s: math.nan)), "solution_describes_itself", "rms_slope"),
        (_bed(with_fields(converged=lambda s: False)), "solution_describes_itself", "did not converge"),
        (_bed(with_fields(provenance=lambda s: {})), "solution_describes_itself", "provenance is empty"),
        (broken(Bed, implemented_properties=("gap",))(), "solution_describes_itself", "implements 'gap'"),
        (_bed(with_fields(gap=lambda s: np.full(s.shape, -1.0))), "gap_is_closed_in_contact", "overlap by 1 nm"),
        (
            _bed(with_fields(gap=lambda s: np.full(s.shape, 1.0))),
            "gap_is_closed_in_contact",
            "where the pressure is positive",
        ),
        (
            _bed(with_fields(pressure=lambda s: s.pressure + 1e-9)),
            "no_load_is_no_contact",
            "pixels in contact at load 0",
        ),
        (
            broken(Bed, solve=lambda self, surface, load, start=None: self._solve(surface, abs(float(load)), start))(),
            "wrong_load_is_refused",
            "load -1.0: returned",
        ),
        (
            _bed(lambda s, surface, start: changed(s, pressure=s.pressure * (1 + 1e-9 * next(calls)))),
            "contact_is_deterministic",
            "two solutions of the same contact differ",
        ),
        (
            _bed(lambda s, surface, start: changed(s, pressure=s.pressure * (1 + (s.modulus > 10)))),
            "contact_scales",
            "twice the modulus",
        ),
        (
            _bed(lambda s, surface, start: changed(s, pressure=s.pressure * surface.pixel_size)),
            "contact_scales",
            "three times the size",
        ),
        (
            _bed(lambda s, surface, start: changed(s, pressure=s.pressure * (1 + 0.1 * (surface.heights.max() > 3)))),
            "contact_scales",
            "raised by 5 nm",
        ),
        (
            _bed(with_fields(pressure=lambda s: s.pressure * (s.pressure > 0.3))),
            "contact_grows_with_load",
            "increasing load",
        ),
        (
            _bed(lambda s, surface, start: s if start is None else changed(s, pressure=start.pressure)),
            "start_changes_nothing",
            "the solution depends on the start",
        ),
        (_bed(with_fields(pressure=lambda s: s.pressure.T)), "odd_grids_are_solved", "a solution of"),
    ],
)
def test_contact_solvers(component, check, said):
    assert said in failing(component, check)


class Hasty(Bed):
    speed_only: ClassVar[tuple[str, ...]] = ("threads",)
    threads: int = 1
    """more is worse"""

    def _solve(self, surface, load, start):
        solution = super()._solve(surface, load, start)
        return changed(solution, pressure=solution.pressure * (1 + 1e-12 * (self.threads > 1)))


def test_speed_that_changes_pressures():
    assert "threads = 2: the answers differ" in failing(Hasty(), "options_count")
