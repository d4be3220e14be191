"""Fits of rate-and-state laws: intervals on synthetic traces, and an independent forward model.

    python tests/benchmarks/rate_state.py coverage --cases 40 --seed 0
    python tests/benchmarks/rate_state.py rivals --cases 20
    python tests/benchmarks/rate_state.py forward --rsfmodel /path/to/rsfmodel

``coverage`` draws laws, parameters, velocity steps up and down, holds and autoregressive noise, and counts how often 95 %
intervals hold them; ``rivals`` how often the other law is refused, or the better fit is that of the right law. ``forward``
compares with rsfmodel (MIT, github.com/jrleeman/rsfmodel). Times are CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np

from chemage_rate_state.display import TOLD
from chemage_rate_state.fit import fit_rate_state
from chemage_rate_state.laws import LAWS, Loading, Parameters, change
from chemage_rate_state.traces import Trace


def synthetic(rng: np.random.Generator, law: Any) -> tuple[Trace, Parameters]:
    """A trace with noise, and the truth."""
    length, a = 10 ** rng.uniform(0, 1.7), 10 ** rng.uniform(-2.5, -1.7)
    b = a * rng.uniform(0.4, 1.6)
    # above the critical stiffness (b − a)/D_c
    stiffness = (max(b - a, 0) * 1.5 + a * 10 ** rng.uniform(-0.5, 1)) / length
    slow = 10 ** rng.uniform(-1, 1)
    speeds = slow * np.array([1, rng.choice([3, 10, 0.0]), 1, rng.choice([3, 10])])[: rng.integers(2, 5)]
    speeds = speeds if speeds[-1] else speeds[:1].repeat(3) * [1, 0, 1]
    ways = 15 * length * rng.uniform(1, 3, speeds.size)
    begins, times, begin = [], [], 0.0
    points = int(rng.choice([300, 1000]))
    for speed, way in zip(speeds, ways, strict=True):
        span = way / (speed or slow)
        begins.append(begin)
        times.append(begin + span * (np.arange(points) + 1) / points)
        begin += span
    loading, at = Loading(np.array(begins), speeds), np.concatenate(times)
    noise, memory = rng.standard_normal(at.size), rng.uniform(0, 0.8)
    for k in range(1, at.size):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * noise[k]
    size = a * 10 ** rng.uniform(-1.5, -0.7)
    truth = Parameters(a, b, length, stiffness)
    trend = rng.uniform(-0.02, 0.02) * loading.displacement(at) / loading.displacement(at)[-1]
    friction = 0.6 + trend + change(law, truth, loading, at) + size * noise
    return Trace("synthetic", at, friction, loading), truth


def coverage(cases: int, seed: int) -> None:
    """How often intervals hold the truth, and how often a true law is refused."""
    held = dict.fromkeys(Parameters._fields, 0)
    refused, widths, seconds = 0, [], time.process_time()
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        law = LAWS[number % 2]
        trace, truth = synthetic(rng, law)
        found = fit_rate_state(trace, law)
        quantities = {one.name: one for one in found.quantities()}
        line = []
        for name, true in truth._asdict().items():
            one = quantities[name]
            held[name] += one.low <= true <= one.high
            line.append(f"{name} {one.value / true:.3f} [{one.low / true:.3f}, {one.high / true:.3f}]")
        refused += not found.explains
        widths.append(np.sqrt(np.diag(found.covariance)))
        print(number, law, trace.loading.speeds.size, *line, f"p {found.probability:.2g}", flush=True)
    print("held of", cases, held, "true laws refused:", refused)
    print("median relative standard errors", np.median(widths, axis=0), f"{time.process_time() - seconds:.0f} CPU s")


def rivals(cases: int) -> None:
    """How often the other law fits worse, is refused, and is told from the right one by the difference that is asked."""
    better = refused = told = wrongly = 0
    for number in range(cases):
        rng, law = np.random.default_rng([7, number]), LAWS[number % 2]
        trace, _ = synthetic(rng, law)
        true, other = (fit_rate_state(trace, one) for one in (law, LAWS[1 - number % 2]))
        away = other.misfit - true.misfit
        better += away > 0
        told += away >= TOLD
        wrongly += away <= -TOLD
        refused += not other.explains
        print(number, law, f"{away:.1f}", f"p {other.probability:.2g}", flush=True)
    print(f"of {cases}: right law better {better}, other law refused {refused},", end=" ")
    print(f"told apart by {TOLD:g}: rightly {told}, wrongly {wrongly}")


def forward(folder: str) -> None:
    """Largest difference from rsfmodel over the largest change."""
    sys.path.insert(0, folder)
    import scipy.integrate

    scipy.integrate.cumtrapz = scipy.integrate.cumulative_trapezoid  # a name that newer scipy has not
    from rsfmodel import rsf, staterelations

    for law, relation in zip(LAWS, (staterelations.DieterichState, staterelations.RuinaState), strict=True):
        model = rsf.Model()
        model.mu0, model.a, model.k, model.vref = 0.6, 0.008, 1e-3, 1.0
        state = relation()
        state.b, state.Dc = 0.01, 10.0
        model.state_relations = [state]
        model.time = np.arange(0, 80.01, 0.01)
        speeds = np.where(model.time < 10, 1.0, 10.0)
        model.loadpoint_velocity = speeds
        theirs = np.array(model.solve().friction) - 0.6
        at = float(model.time[np.argmax(speeds > 5)])
        loading = Loading(np.array([0.0, at]), np.array([1.0, 10.0]))
        ours = change(law, Parameters(0.008, 0.01, 10.0, 1e-3), loading, np.array(model.time))
        print(law, f"{np.abs(ours - theirs).max() / np.abs(ours).max():.1e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["coverage", "rivals", "forward"])
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rsfmodel", default="")
    given = parser.parse_args()
    if given.what == "coverage":
        coverage(given.cases, given.seed)
    elif given.what == "rivals":
        rivals(given.cases)
    else:
        forward(given.rsfmodel)
