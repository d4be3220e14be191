"""Barriers against closed forms and independent implementations of the same distributions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

import chemage as ca
from chemage.plugin import KB, random
from chemage_silica import MDSilica

SITES = np.arange(100_000)


def cut(mean, std, lower=-math.inf, upper=math.inf):
    return stats.truncnorm((lower - mean) / std, (upper - mean) / std, loc=mean, scale=std)


CASES = {
    "triangle": (
        ca.barriers("tabulated", energies=[0.8, 1.1, 1.4], weights=[0, 1, 0]),
        stats.triang(0.5, loc=0.8, scale=0.6),
    ),
    "uniform": (ca.barriers("uniform", lower=0.8, upper=1.4), stats.uniform(0.8, 0.6)),
    "gaussian": (ca.barriers("gaussian", mean=1.1, std=0.02), stats.norm(1.1, 0.02)),
    "one bound": (ca.barriers("gaussian", mean=1.1, std=0.1, lower=1.0), cut(1.1, 0.1, lower=1.0)),
    "two bounds": (ca.barriers("gaussian", mean=1.1, std=0.1, lower=0.8, upper=1.15), cut(1.1, 0.1, 0.8, 1.15)),
    "far tail": (ca.barriers("gaussian", mean=1.1, std=0.02, lower=1.25), cut(1.1, 0.02, lower=1.25)),
    "lower tail": (ca.barriers("gaussian", mean=1.1, std=0.02, upper=0.9), cut(1.1, 0.02, upper=0.9)),
    "trapezium": (
        ca.barriers("tabulated", energies=[0.8, 1.0, 1.2, 1.4], weights=[0, 7, 7, 0]),
        stats.trapezoid(1 / 3, 2 / 3, loc=0.8, scale=0.6),
    ),
    "ramp": (ca.barriers("tabulated", energies=[0.0, 2.0], weights=[0, 3]), stats.triang(1, loc=0, scale=2)),
}


@pytest.mark.parametrize("name", CASES)
def test_drawn_barriers_follow_the_distribution(name):
    barriers, reference = CASES[name]
    drawn = barriers.quantile(random.uniforms(3, random.FORMING, SITES))
    assert stats.kstest(drawn, reference.cdf).pvalue > 1e-3
    counts, edges = np.histogram(drawn, bins=reference.ppf(np.linspace(0, 1, 41)[1:-1]))
    assert stats.chisquare(counts, np.full(39 - 1, counts.sum() / 38)).pvalue > 1e-3
    assert edges.size == 39


@pytest.mark.parametrize("name", CASES)
def test_quantile_and_density_equal_the_reference(name):
    barriers, reference = CASES[name]
    u = np.concatenate([np.geomspace(1e-6, 0.5, 40), 1 - np.geomspace(1e-6, 0.5, 40)])
    expected = reference.ppf(u)
    scale = reference.std()
    np.testing.assert_allclose(barriers.quantile(u), expected, rtol=0, atol=2e-9 * scale)
    np.testing.assert_allclose(barriers.density(expected), reference.pdf(expected), rtol=1e-8)


@pytest.mark.parametrize("name", CASES)
def test_density_integrates_to_one(name):
    barriers, reference = CASES[name]
    low, high = reference.ppf([0, 1])
    low, high = max(low, reference.mean() - 12 * reference.std()), min(high, reference.mean() + 12 * reference.std())
    breaks = [0.8, 1.0, 1.1, 1.2]
    total, _ = integrate.quad(lambda e: float(barriers.density(np.array(e))), low, high, points=breaks, limit=200)
    assert total == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("sigmas", [10, 40, 300, 1e4, 1e5])
@pytest.mark.parametrize("side", [-1, 1])
def test_beyond_a_far_bound_barriers_decay_exponentially(sigmas, side):
    # Φ's tail: φ(a + y/a)/φ(a) → exp(−y − y²/2a²), so the excess times a is exponential up to terms of 1/a²
    std = 0.01
    bound = 1.1 + side * sigmas * std
    bounds = {"lower" if side > 0 else "upper": bound}
    barriers = ca.barriers("gaussian", mean=1.1, std=std, **bounds)
    u = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    excess = np.abs(barriers.quantile(u) - bound) * sigmas / std
    expected = -np.log1p(-u) if side > 0 else -np.log(u)
    # x is found to some 1e-14 of itself, and the excess is 1/a² of it
    rounding = 4 * np.spacing(abs(bound)) * sigmas / std + 4e-14 * sigmas**2
    np.testing.assert_allclose(excess, expected, rtol=4 / sigmas**2, atol=rounding)
    if sigmas < 1e4:
        assert barriers.density(np.array(bound)) == pytest.approx(sigmas / std, rel=2 / sigmas**2)


SILICA = [ca.barriers("md-silica", member=member) for member in range(MDSilica.MEMBERS)]


@pytest.mark.parametrize("barriers", SILICA, ids=[str(one.member) for one in SILICA])
def test_members_of_silica_are_distributions_on_the_published_range(barriers):
    energies = np.linspace(0.8, 1.4, 60_001)
    density = barriers.density(energies)
    assert (density >= 0).all()
    assert integrate.trapezoid(density, energies) == pytest.approx(1, abs=1e-6)
    assert not barriers.density(np.array([0.7999, 1.4001])).any()
    values = barriers.quantile(np.linspace(0, 1, 1001))
    assert values[0] == pytest.approx(0.8, abs=1e-12)
    assert values[-1] <= 1.4
    # the share of barriers below a quantile is its probability
    below = integrate.cumulative_trapezoid(density, energies, initial=0)
    np.testing.assert_allclose(np.interp(values, energies, below), np.linspace(0, 1, 1001), rtol=0, atol=1e-6)


def test_members_of_silica_differ():
    u = np.linspace(0.01, 0.99, 99)
    quantiles = np.stack([one.quantile(u) for one in SILICA])
    apart = np.abs(quantiles[:, None] - quantiles[None]).max(axis=-1)
    assert apart[~np.eye(len(SILICA), dtype=bool)].min() > 0.002
    assert len({one.digest() for one in SILICA}) == len(SILICA)


def test_even_barriers_age_logarithmically_at_kt_ln10_over_their_span():
    # irreversible and independent: bonds/site = <1 − exp(−νt exp(−E/kT))>
    barriers = ca.barriers("uniform", lower=0.8, upper=1.4)
    values = barriers.quantile((np.arange(200_000) + 0.5) / 200_000)
    times = np.array([10.0, 1e2, 1e3, 1e4])
    bonds = [np.mean(-np.expm1(-1e13 * t * np.exp(-values / (KB * 300)))) for t in times]
    np.testing.assert_allclose(np.diff(bonds), 0.0992, rtol=3e-3)
