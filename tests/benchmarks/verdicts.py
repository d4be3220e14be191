"""How often ``compare`` calls a true model different, and how often a false one.

Both sides are drawn from one pool of replicas of a simulated contact: a run of a few of them beside measurements of the
pool's mean with normal errors, or beside a second run. Sites bond for good, interact, break their bonds, or are a
sample; the curves of surfaces are scaled by 15 %. False models: values times 1.1, values and a tenth of the last one,
10 K more, and uniform barriers in place of those of silica.

``python tests/benchmarks/verdicts.py [TRIALS] [POOL ...]`` prints per cent at the 5 % and at the .1 % level.
"""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np

import chemage as ca
from chemage.ageing.fitting import DROPS
from chemage.foundation.result import Comparable
from chemage.results.verdicts import AGREE, DIFFER, between, verdict

TIMES = np.geomspace(0.1, 1e4, 11)
MEASURED = np.geomspace(0.1, 1e4, 8)
POOL = 2000
ERRORS = (0.005, 0.02, 0.05)
REPLICAS = (2, 3, 5, 10, 30, 100)
#: of two runs
PAIRS = ((2, 2), (2, 10), (5, 5), (10, 30), (100, 2), (100, 100))
NAMES = ("alone", "interacting", "breaking", "sample", "surfaces")


def contact() -> ca.ContactSolution:
    """About a thousand sites under up to 3.5 GPa."""
    rows, columns = np.indices((40, 40))
    pressure = np.maximum(3.0 * np.sin(rows / 7.0) * np.cos(columns / 5.0) + 0.5, 0.0)
    load = float(pressure.sum()) * 0.4518**2
    return ca.ContactSolution(pressure=pressure, load=load, pixel_size=0.4518, modulus=35.3)


def pool(name: str, replicas: int = POOL, temperature: float = 300.0) -> np.ndarray:
    """(replicas, m) curves of ΔF in nN."""
    options: dict[str, Any] = {"forming": ca.barriers("md-silica")}
    method = None
    if name == "uniform":
        options["forming"] = ca.barriers("uniform", lower=0.5, upper=1.5)
    if name in ("interacting", "sample"):
        options["interaction"] = ca.interaction("elastic-pairs", strength=0.3)
    if name == "breaking":
        options["breaking"] = ca.barriers("gaussian", mean=0.85, std=0.05)
    if name == "sample":
        method = ca.ageing_method("sample", share=0.3, window=4)
    chemistry = ca.chemistry(activation_volume="6.4 angstrom**3", site_density="pixel", **options)
    engine = ca.engine("next-reaction" if "interaction" in options else "independent")
    held = {"hold_times": TIMES, "temperature": temperature, "replicas": replicas}
    curves = ca.age(contact(), chemistry, engine=engine, method=method, **held).friction_drop
    if name == "surfaces":
        curves = curves * (1 + 0.15 * np.random.default_rng(0).standard_normal((replicas, 1)))
    return curves


def run_of(curves: np.ndarray, name: str = "run") -> SimpleNamespace:
    """A run with these replicas."""
    curve = DROPS["friction_drop"].of_replicas(TIMES, curves)
    return SimpleNamespace(name=name, comparable=Comparable(load=50.0), curves={"friction_drop": curve})


def chances(curves: np.ndarray, truth: np.ndarray, replicas: int, error: float, trials: int) -> np.ndarray:
    """(trials,) probabilities that runs of ``curves`` state beside measurements of ``truth`` (m,)."""
    rng = np.random.default_rng([replicas, round(1000 * error)])
    found = np.zeros(trials)
    for trial in range(trials):
        run = run_of(curves[rng.choice(len(curves), replicas, replace=False)])
        values = np.interp(np.log(MEASURED), np.log(TIMES), truth)
        stated = error * values
        values = values + stated * rng.standard_normal(values.size)
        data = ca.Measurements("m", MEASURED, values, "friction_drop", stated, load=50.0)
        found[trial] = verdict(data, "run", run.comparable, run.curves).chance
    return found


def of_runs(curves: np.ndarray, others: np.ndarray, counts: tuple[int, int], trials: int) -> np.ndarray:
    """The same of runs of so many of ``curves`` and of ``others``."""
    rng = np.random.default_rng(counts)
    found = np.zeros(trials)
    for trial in range(trials):
        drawn = rng.permutation(min(len(curves), len(others)))[: sum(counts)]
        one, other = curves[drawn[: counts[0]]], others[drawn[counts[0] :]]
        found[trial] = between(run_of(one), run_of(other, "other")).chance
    return found


def shares(found: np.ndarray) -> str:
    """Per cent that differ at both levels."""
    return f"{100 * np.mean(found < AGREE):.1f}, {100 * np.mean(found < DIFFER):.2f}"


def wrong(curves: np.ndarray) -> dict[str, np.ndarray]:
    """Curves of false models."""
    mean = curves.mean(axis=0)
    return {
        "times 1.1": 1.1 * mean,
        "a tenth of the last more": mean + 0.1 * mean[-1],
        "10 K more": pool("alone", temperature=310.0).mean(axis=0),
        "uniform barriers": pool("uniform").mean(axis=0),
    }


def main(trials: int, names: list[str]) -> None:
    """Print the tables."""
    print("% of true models that differ at the 5 % and at the .1 % level", flush=True)
    for name in names:
        curves = pool(name)
        for error in ERRORS:
            cells = [shares(chances(curves, curves.mean(axis=0), count, error, trials)) for count in REPLICAS]
            print(f"| {name}, errors of {100 * error:g} % | " + " | ".join(cells) + " |", flush=True)
        cells = [shares(of_runs(curves, curves, counts, trials)) for counts in PAIRS]
        print(f"| {name}, two runs | " + " | ".join(cells) + " |", flush=True)
    print("% of false models that differ", flush=True)
    curves = pool("alone")
    for name, truth in wrong(curves).items():
        for error in ERRORS:
            cells = [shares(chances(curves, truth, count, error, max(50, trials // 10))) for count in REPLICAS]
            print(f"| {name}, errors of {100 * error:g} % | " + " | ".join(cells) + " |", flush=True)
    for name, others in {"times 1.1": 1.1 * curves, "10 K more": pool("alone", temperature=310.0)}.items():
        cells = [shares(of_runs(curves, others, counts, max(50, trials // 10))) for counts in PAIRS]
        print(f"| {name}, two runs | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000, sys.argv[2:] or [*NAMES])
