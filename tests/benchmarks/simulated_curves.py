"""Whether bands hold that are inferred from simulated means, whose hold times share the bonds of few replicas.

    python tests/benchmarks/simulated_curves.py [--count 40] [--replicas 10] [--seed 0] [--quick]

Each case ages a drawn density on two loads of a tip, infers it from the means with their covariance and with independent
errors of the same size, and forecasts a third load and a higher temperature. The truth is the closed form of
independent sites (`troubles.py`). Printed: how often bands of 90 % of the forecasts hold, χ² over the points less the
effective parameters, these, the scale of the errors, and how often the critic names a cause.
"""

from __future__ import annotations

import argparse

import numpy as np
from troubles import ENERGIES, LEFT_OUT, SCENE, drawn, drop

import chemage as ca

TIMES = np.logspace(-2, 4, 19)


def aged(weights: np.ndarray, load: float, replicas: int, seed: int) -> ca.Ageing:
    """Replicas of independent sites on the tip of the scene."""
    scene = ca.parse_scene(SCENE)
    contact = ca.solve_contact(scene.solver, ca.make_surface(scene.surface), load)
    forming = ca.barriers("tabulated", energies=ENERGIES, weights=weights)
    engine, call = ca.engine("independent"), {"hold_times": TIMES, "temperature": 300.0}
    return ca.age(
        contact, scene.chemistry.replace(forming=forming), engine=engine, replicas=replicas, seed=seed, **call
    )


def main() -> None:
    """Infer, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--replicas", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="end sampling at 100 effective samples")
    given = parser.parse_args()
    if given.quick:
        from chemage_inference import sampling

        sampling.ENOUGH, sampling.AGREED = 100, 1.06
    rows: dict[str, list[list[float]]] = {"covariance": [], "independent": []}
    for number in range(given.seed, given.seed + given.count):
        weights = drawn(np.random.default_rng([number, 77]))
        simulated = [aged(weights, load, given.replicas, 1000 + number) for load in (30.0, 100.0)]
        curves = [ca.MeasuredCurve.of_result(one, f"{one.load:g} nN") for one in simulated]
        for name, row in rows.items():
            if name == "independent":
                curves = [curve.model_copy(update={"correlation": None}) for curve in curves]
            found = ca.infer(curves, SCENE, families=(), samples=400, seed=number)
            held = []
            for load, kelvin, times in LEFT_OUT[:2]:
                low, high = found.forecast(load=load, temperature=kelvin, hold_times=times).band(0.9)
                truth, floor = drop(weights, load, kelvin, times), 1e-3 * high.max()
                held += ((truth >= low - floor) & (truth <= high + floor)).tolist()
            left = found.values.size - found.effective_parameters
            scale = np.mean([np.median(found.error_terms[f"scale {k}"]) for k in range(2)])
            accused = bool(found.critic.named)
            row.append([np.mean(held), found.chi2 / left, found.effective_parameters, scale, accused])
        print(number, *(f"{name}: {np.round(row[-1], 2)}" for name, row in rows.items()), flush=True)
    for name, row in rows.items():
        held, chi2, effective, scale, accused = np.mean(row, axis=0)
        print(f"{name:12s} bands of 90 % hold {100 * held:.1f} %, χ²/(points - parameters) {chi2:.2f}, parameters "
              f"{effective:.1f}, scale {scale:.2f}, accused {100 * accused:.0f} %")  # fmt: skip


if __name__ == "__main__":
    main()
