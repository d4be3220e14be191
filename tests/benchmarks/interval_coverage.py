"""How often the printed 95 % intervals hold the truth, and whether replicas of one seed are independent.

``python tests/benchmarks/interval_coverage.py [TRIALS]`` prints the tables
``interval_coverage.csv`` and ``kinetics_correlation.csv`` of docs/data.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ageing"))

from test_independent_replicas import SILICA, beta_and_drop, contact_of, correlation

import chemage as ca
from chemage import Ageing, Measurements, fit_ageing
from chemage.ageing.models import Model

TRIALS = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
#: surfaces in the table of correlations, 210 pairs
SURFACES = 21
TIMES = np.geomspace(0.1, 1e4, 16)
BETA, CUTOFF = 0.45, 5.0


def shape(model: Model, t: np.ndarray) -> np.ndarray:
    return BETA * np.log10(t / CUTOFF if model == "line" else 1 + t / CUTOFF)


def replicas_covered(model: Model, replicas: int, trials: int) -> np.ndarray:
    """(2,) share of trials whose intervals of β and t_c hold the truth."""
    generator, inside = np.random.default_rng(replicas), np.zeros(2)
    ones = np.full(replicas, 10**7)
    for _ in range(trials):
        scale = generator.normal(1e6, 5e4, (replicas, 1))
        bonds = scale * shape(model, TIMES) + generator.normal(0.0, 3e4, (replicas, TIMES.size))
        bonds = np.rint(np.maximum(bonds, 0)).astype(np.int64)
        ageing = Ageing(hold_times=TIMES, bonds=bonds, sites=ones, events=ones, load=3.0, temperature=300.0)
        fit = fit_ageing(ageing, model=model, window=("10 s", "1e4 s"))
        inside += held(fit, BETA * 1e6)
    return inside / trials


def measurements_covered(model: Model, points: int, trials: int) -> np.ndarray:
    """(2,) as `replicas_covered`, for measurements whose errors grow with time."""
    generator, inside = np.random.default_rng(points), np.zeros(2)
    times, error = np.geomspace(1.0, 1e4, points), np.geomspace(0.02, 0.08, points)
    for _ in range(trials):
        values = shape(model, times) + generator.normal(0, error)
        data = Measurements("m", times, values, "friction_coefficient_drop", error)
        inside += held(fit_ageing(data, model=model), BETA)
    return inside / trials


def held(fit: ca.plugin.Fit, beta: float) -> list[bool]:
    return [
        fit.beta_interval.low <= beta <= fit.beta_interval.high,
        fit.cutoff_interval.low <= CUTOFF <= fit.cutoff_interval.high,
    ]


def means_covered(replicas: int, trials: int) -> tuple[float, float]:
    """Share of runs of the kinetics whose intervals of β and of Δμ at the last hold time hold the mean of all runs."""
    contact = contact_of(0, 0.7, side=20)
    times = np.geomspace(10.0, 1e4, 7)
    ageing = ca.age(
        contact,
        SILICA,
        engine=ca.engine("rejection-free"),
        hold_times=times,
        temperature=300.0,
        replicas=replicas * trials,
    )
    truth = ageing.fit()
    mean, inside = ageing.mean_friction_coefficient_drop[-1], np.zeros(2)
    for group in np.split(ageing.bonds, trials):
        ones = np.full(replicas, group.max())
        one = Ageing(
            hold_times=times, bonds=group, sites=ones, events=ones, load=ageing.load, temperature=300.0, bond_force=3.0
        )
        fit = one.fit()
        drop = one.mean_friction_coefficient_drop[-1]
        inside += [
            fit.beta_interval.low <= truth.beta <= fit.beta_interval.high,
            abs(drop - mean) <= one.friction_coefficient_drop_half_width[-1],
        ]
    return inside[0] / trials, inside[1] / trials


def main() -> None:
    print("| | 95 % interval of β | of the cut-off time |")
    for model in ("line", "curve"):
        trials = TRIALS if model == "line" else TRIALS // 5
        for replicas in (2, 3, 5, 10):
            beta, cutoff = replicas_covered(model, replicas, trials)
            print(f"| {model}, {replicas} replicas | {beta:.1%} | {cutoff:.1%} |", flush=True)
        for points in (4, 8, 25):
            beta, cutoff = measurements_covered(model, points, trials)
            print(f"| {model}, {points} measurements | {beta:.1%} | {cutoff:.1%} |", flush=True)
    print("\n| kinetics, replicas | 95 % interval of β | of Δμ |")
    for replicas in (2, 3, 5, 10):
        beta, drop = means_covered(replicas, TRIALS // 5)
        print(f"| {replicas} | {beta:.1%} | {drop:.1%} |", flush=True)
    print(f"\n| correlation, {SURFACES * (SURFACES - 1) // 2} pairs of surfaces | β | Δμ |")
    for fraction, side in ((0.01, 120), (0.7, 40)):
        for engine in ("rejection-free", "bkl", "next-reaction"):
            found = [beta_and_drop(contact_of(surface, fraction, side), engine) for surface in range(SURFACES)]
            beta, drop = correlation(found)
            print(f"| {engine}, {fraction:.0%} contact | {beta:+.3f} | {drop:+.3f} |", flush=True)
    kinds = ("rejection-free", "bkl", "next-reaction")
    for fraction, side in ((0.01, 120), (0.7, 40)):
        pairs = [
            correlation([beta_and_drop(contact_of(surface, fraction, side), kind) for kind in kinds])
            for surface in range(3 * SURFACES)
        ]
        beta, drop = np.mean(pairs, axis=0)
        print(
            f"| between engines, {fraction:.0%} contact, {9 * SURFACES} pairs | {beta:+.3f} | {drop:+.3f} |", flush=True
        )


if __name__ == "__main__":
    main()
