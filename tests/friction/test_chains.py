"""Holds and pulls one after the other: no step repeats the random numbers of another one, whatever engines follow."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from pulled_models import KT, drive_of, lattice_of
from scipy.stats import binomtest, chi2_contingency, kstest

import chemage as ca
from chemage.plugin import Partners, PullHistory, random

EXACT = ca.pulling("event-driven")
ENGINES = ["independent", "next-reaction", "auto", "rejection-free", "bkl"]
N = 2000
#: the barrier over which a site waits for ln 2 / Hz seconds, half of them for a second
HALF = float(KT * np.log(1e13 / np.log(2)))
#: of other partners the barriers are the same
SAME = Partners(np.full(2, HALF), np.full(2, HALF), np.zeros(N), 1.0)


def step(kind: str, lattice, start, span: float, seed, **drive):
    """A hold with the engine ``kind``, or with "kept" or "renewed" a pull, for ``span`` seconds."""
    time = span if start is None else start.time + span
    if kind in ("kept", "renewed"):
        pulled_by = drive_of(**{"speed": 0.0, "partner": kind, **drive})
        partners = SAME._replace(breaking=lattice.breaking[:2])
        return EXACT.run(lattice, pulled_by, [time], temperature=300, seed=seed, start=start, partners=partners)
    before = start.history if isinstance(start, PullHistory) else start
    return ca.engine(kind).run(lattice, [time], temperature=300, seed=seed, start=before)


def independent(one: np.ndarray, other: np.ndarray) -> float:
    """p-value of two properties of the sites being independent."""
    table = [[np.count_nonzero((one == a) & (other == b)) for b in (False, True)] for a in (False, True)]
    return float(chi2_contingency(table).pvalue)


@pytest.mark.parametrize("seed", [5, random.CommonSeed(5)], ids=["hashed", "common"])
@pytest.mark.parametrize(
    "chain",
    [
        [*ENGINES, *ENGINES],
        ["rejection-free", "kept", "rejection-free", "bkl", "rejection-free", "next-reaction", "rejection-free"],
        ["bkl", "kept", "bkl", "renewed", "kept", "bkl", "independent", "kept"],
        ["next-reaction", "kept", "next-reaction", "rejection-free", "next-reaction", "renewed", "next-reaction"],
        ["independent", "renewed", "independent", "kept", "independent", "bkl", "independent", "kept", "renewed"],
        ["auto", "kept", "auto", "renewed", "auto", "bkl", "auto"],
        ["kept", "auto", "kept", "rejection-free", "kept", "kept", "renewed", "next-reaction", "renewed"],
    ],
    ids=lambda chain: chain[0] + f" and {len(chain) - 1} more",
)
def test_every_step_of_a_chain_flips_sites_of_its_own(chain, seed):
    """Bonds form and break at one rate, so that the flips of a site in each step are Poisson whatever came before."""
    lattice, span = lattice_of(N, HALF, HALF), 1.0
    odd, state, start = [], np.zeros(N, bool), None
    for kind in chain:
        start = step(kind, lattice, start, span, seed)
        odd.append(start.state != state)
        state = start.state
    expected = -np.expm1(-2 * np.log(2) * span) / 2
    assert min(binomtest(int(one.sum()), N, expected).pvalue for one in odd) > 1e-4
    assert min(independent(one, other) for one, other in combinations(odd, 2)) > 1e-5


@pytest.mark.parametrize("partner", ["kept", "renewed"])
@pytest.mark.parametrize(("first", "last"), [*((kind, kind) for kind in ENGINES), ("rejection-free", "bkl")])
def test_a_hold_after_a_pull_goes_on_with_fresh_numbers(first, last, partner):
    """One half-life each: 3/4 bonded after a pull that breaks nothing, half of all after one that breaks everything."""
    lattice = lattice_of(N, HALF, 3.0)
    hold = step(first, lattice, None, 1.0, 1)
    gentle = step(partner, lattice, hold, 1e-9, 1)
    after = step(last, gentle.lattice_after(lattice), gentle, 1.0, 1)
    assert binomtest(int(after.bonds[-1]), N, 0.75).pvalue > 1e-4
    rough = step(partner, lattice, hold, 1e-9, 1, speed=1e10)
    assert (rough.bonds[-1], rough.broken[-1]) == (0, hold.bonds[-1])
    again = step(last, rough.lattice_after(lattice), rough, 1.0, 1)
    assert binomtest(int(again.bonds[-1]), N, 0.5).pvalue > 1e-4
    assert independent(hold.state, again.state) > 1e-4


@pytest.mark.parametrize("seed", [5, random.CommonSeed(5)], ids=["hashed", "common"])
def test_partners_after_a_hold_are_those_of_the_position(seed):
    """Of three slips by two spacings with holds between them, which pass the position on, as of one slip."""
    lattice = lattice_of(N, 0.55, 1.1)
    partners = Partners(np.linspace(0.5, 0.6, 1000), np.full(2, 1.1), np.zeros(N), 0.5)
    drive, start, met, how = drive_of(1e9, partner="renewed"), None, [], {"temperature": 300, "seed": seed}
    for _ in range(3):
        time, there = 1.0 if start is None else start.time + 1.0, lattice
        if start is not None:
            there, start = start.lattice_after(lattice), start.history
        hold = ca.engine("bkl").run(there, [time], start=start, **how)
        assert hold.state.all()
        start = EXACT.run(lattice, drive, [time, time + 1e-9], start=hold, partners=partners, **how)
        met.append(start.forming)
    whole = EXACT.run(lattice, drive, [3e-9], partners=partners, **how)
    assert np.mean(whole.forming == start.forming) > 0.998
    assert min(kstest((one - 0.5) / 0.1, "uniform").pvalue for one in met) > 1e-4
    for one, other in combinations(met, 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / N**0.5


def test_an_engine_hands_on_counters_that_it_does_not_know():
    class Still(ca.plugin.Engine):
        """Nothing happens."""

        kind = "still"

        def _run(self, lattice, hold_times, temperature, seed, start):
            state = np.zeros(lattice.sites.size, bool) if start is None else start.state
            bonds = np.full(hold_times.size, state.sum())
            before = np.zeros_like(bonds)
            return ca.plugin.BondHistory(hold_times=hold_times, bonds=bonds, formed=bonds, broken=before, state=state,
                                         time=hold_times[-1], temperature=temperature, engine="still")  # fmt: skip

    lattice = lattice_of(N, HALF, 3.0)
    for kind in ENGINES:
        hold = step(kind, lattice, None, 1.0, 1)
        still = Still().run(lattice, [2.0], temperature=300, start=hold)
        assert binomtest(int(step(kind, lattice, still, 1.0, 1).bonds[-1]), N, 0.75).pvalue > 1e-4
