"""How often ``compare`` calls a true model different at the 5 % level, and how often a false one.

Measurements with normal errors are drawn from the mean of all replicas of a simulated contact, and judged beside runs
of a few of these replicas: of sites that bond for good, that interact, that break their bonds, and of a sample of the
sites; and beside means over surfaces whose curves are scaled by 15 %. For a false model the measurements are steeper
by three standard errors of β, those of run and measurements together.

``python tests/benchmarks/comparisons.py [TRIALS]`` prints the table.
"""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

import chemage as ca
from chemage.ageing.fitting import DROPS, line_weights
from chemage.foundation.quantities import Curve
from chemage.foundation.result import Ageing
from chemage.results.verdicts import AGREE, verdict

TIMES = np.geomspace(0.1, 1e4, 11)
MEASURED = np.geomspace(0.1, 1e4, 8)
POOL = 2000
ERRORS = (0.005, 0.03)
REPLICAS = (2, 5, 10, 20, 100)


def contact() -> ca.ContactSolution:
    """About a thousand sites under up to 3.5 GPa."""
    rows, columns = np.indices((40, 40))
    pressure = np.maximum(3.0 * np.sin(rows / 7.0) * np.cos(columns / 5.0) + 0.5, 0.0)
    load = float(pressure.sum()) * 0.4518**2
    return ca.ContactSolution(pressure=pressure, load=load, pixel_size=0.4518, modulus=35.3)


def pool(name: str, replicas: int = POOL) -> np.ndarray:
    """(replicas, m) curves of ΔF in nN."""
    options: dict[str, Any] = {"forming": ca.barriers("md-silica")}
    method = None
    if name in ("interacting", "sample"):
        options["interaction"] = ca.interaction("elastic-pairs", strength=0.3)
    if name == "breaking":
        options["breaking"] = ca.barriers("gaussian", mean=0.85, std=0.05)
    if name == "sample":
        method = ca.ageing_method("sample", share=0.3, window=4)
    chemistry = ca.chemistry(activation_volume="6.4 angstrom**3", site_density="pixel", **options)
    engine = ca.engine("next-reaction" if "interaction" in options else "independent")
    held = {"hold_times": TIMES, "temperature": 300.0, "replicas": replicas}
    curves = ca.age(contact(), chemistry, engine=engine, method=method, **held).friction_drop
    if name == "surfaces":
        curves = curves * (1 + 0.15 * np.random.default_rng(0).standard_normal((replicas, 1)))
    return curves


def beside(curves: np.ndarray) -> tuple[Ageing, dict[str, Curve]]:
    """A run with these replicas."""
    return Ageing(load=50.0), {"friction_drop": DROPS["friction_drop"].of_replicas(TIMES, curves)}


def share(curves: np.ndarray, replicas: int, error: float, trials: int, wrong: float = 0.0) -> float:
    """The share of trials in which measurements are called different; ``wrong``: of β, in standard errors."""
    rng = np.random.default_rng([replicas, round(1000 * error)])
    truth = curves.mean(axis=0)
    slope, _ = np.polyfit(np.log10(TIMES), truth, 1)
    _, weights = line_weights(TIMES, (0.0, math.inf))
    _, own = line_weights(MEASURED, (0.0, math.inf))
    drawn = np.interp(np.log(MEASURED), np.log(TIMES), truth)
    of_run, of_measured = float(np.std(curves @ weights)) / math.sqrt(replicas), np.linalg.norm(own * error * drawn)
    spread = math.hypot(of_run, float(of_measured))
    steeper = 1 + wrong * spread / slope
    different = 0
    for _ in range(trials):
        chosen = curves[rng.choice(len(curves), replicas, replace=False)]
        values = steeper * np.interp(np.log(MEASURED), np.log(TIMES), truth)
        stated = error * values
        values = values + stated * rng.standard_normal(values.size)
        data = ca.Measurements("m", MEASURED, values, "friction_drop", stated, load=50.0)
        different += verdict(data, "run", *beside(chosen)).chance < AGREE
    return different / trials


def main(trials: int) -> None:
    """Print how often a true and a false model differ, in per cent."""
    print("% called different: of a true model, and of one whose β is wrong by three standard errors", flush=True)
    print("| | " + " | ".join(f"{count} replicas" for count in REPLICAS) + " |", flush=True)
    for name in ("alone", "interacting", "breaking", "sample", "surfaces"):
        curves = pool(name)
        for error in ERRORS:
            true = [100 * share(curves, count, error, trials) for count in REPLICAS]
            false = [100 * share(curves, count, error, trials, 3.0) for count in REPLICAS]
            cells = [f"{one:.1f}, {other:.0f}" for one, other in zip(true, false, strict=True)]
            print(f"| {name}, errors of {100 * error:g} % | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
