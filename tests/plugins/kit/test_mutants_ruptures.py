"""Rupture laws that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Breaking, calls, caught_by, mutant

from chemage import testing
from chemage.plugin import Rupture

pytestmark = pytest.mark.long

#: what a law that sums over the bonded sites does wrong -> the check that finds it
NM = 0.1602176634


def law(name: str, force: Any, **attributes: Any) -> Any:
    """The law of ``Breaking`` with another force."""
    return mutant(Breaking, name, force=lambda self, bonded: force(self, bonded), **attributes)()


def right(self: Any, bonded: Any) -> Any:
    return Breaking.force(self, bonded)


class Ageless(Rupture):
    """The same force for every bond, without states."""

    kind = "ageless"

    def force(self, bonded):
        return 2.0 * bonded.bonds


def _barriers(bonded):
    return bonded.lattice.forming if bonded.lattice.breaking is None else bonded.lattice.breaking


def _written(self, bonded):
    counts = bonded.bonds
    counts.setflags(write=True)
    counts[:] = np.sort(counts)[::-1]
    counts.setflags(write=False)
    return 2.0 * counts


def _with_nan(self, bonded):
    with np.errstate(invalid="ignore", divide="ignore"):
        return right(self, bonded) / bonded.bonds * bonded.bonds


_totals: list[float] = [0.0]


def _running(self, bonded):
    _totals[0] += 1e-3
    return right(self, bonded) * (1 + _totals[0])


class Coarse(Breaking):
    """Leaves out every second site where it is told to be quick."""

    speed_only: ClassVar[tuple[str, ...]] = ("quick",)
    quick: bool = False
    """whether to leave them out"""

    def force(self, bonded):
        found = super().force(bonded)
        return 0.5 * found if self.quick else found


RUPTURES: dict[str, tuple[Any, str]] = {
    "one number": (lambda: law("one", lambda s, b: right(s, b)[-1]), "forces_are_forces"),
    "a force per site": (lambda: law("site", lambda s, b: _barriers(b) * NM), "forces_are_forces"),
    "nan without bonds": (lambda: law("nan", _with_nan), "forces_are_forces"),
    "negative": (lambda: law("negative", lambda s, b: -right(s, b)), "forces_are_forces"),
    "text": (lambda: law("text", lambda s, b: [f"{x:.2f}" for x in right(s, b)]), "forces_are_forces"),
    "states it did not ask for": (lambda: law("unasked", right, states=False), "forces_are_forces"),
    "adhesion as well": (lambda: law("adhesion", lambda s, b: right(s, b) + 5.0), "no_bonds_no_force"),
    "in N": (lambda: law("newton", lambda s, b: 1e-9 * right(s, b)), "forces_are_in_nn"),
    "in pN": (lambda: law("piconewton", lambda s, b: 1e3 * right(s, b)), "forces_are_in_nn"),
    "needs breaking barriers": (
        lambda: law("breaking", lambda s, b: b.states @ (b.lattice.breaking * NM)),
        "parts_may_be_absent",
    ),
    "needs an interaction": (
        lambda: law("neighbours", lambda s, b: right(s, b) * (1.0 + 0.0 * b.lattice.neighbours.shape[1])),
        "parts_may_be_absent",
    ),
    "needs two hold times": (
        lambda: law("rate", lambda s, b: right(s, b) + 0.0 * (b.hold_times[1] - b.hold_times[0])),
        "parts_may_be_absent",
    ),
    "the mean barrier of the bonds at the end": (
        lambda: mutant(
            Ageless,
            "end",
            force=lambda self, b: (
                b.bonds * (_barriers(b)[b.history.state].mean() if b.history.state.any() else 0.0) * NM
            ),
        )(),
        "later_times_do_not_matter",
    ),
    "divided by the last force": (
        lambda: law("normalised", lambda s, b: right(s, b) / max(float(right(s, b)[-1]), 1e-9)),
        "later_times_do_not_matter",
    ),
    "the barriers of all sites": (
        lambda: law("all", lambda s, b: b.bonds * (_barriers(b).mean() if _barriers(b).size else 0.0) * NM),
        "unbonded_sites_do_not_matter",
    ),
    "the barriers in another order": (
        lambda: law("order", lambda s, b: b.states @ (_barriers(b)[::-1] * NM)),
        "unbonded_sites_do_not_matter",
    ),
    "a total over replicas": (lambda: law("running", _running), "calls_are_independent"),
    "a force by call": (
        lambda: law("call", lambda s, b: right(s, b) * (1 + 1e-12 * next(calls))),
        "calls_are_independent",
    ),
    "writes into the history": (lambda: mutant(Ageless, "writes", force=_written)(), "calls_are_independent"),
    "quick and different": (lambda: Coarse(), "options_count"),
}


@pytest.mark.parametrize("name", RUPTURES)
def test_a_wrong_rupture_law(name):
    make, check = RUPTURES[name]
    found, said = caught_by(make())
    assert found == check, said


def test_right_rupture_laws_pass():
    testing.check_rupture(Ageless())
    testing.check_rupture(Breaking(), all=True)
