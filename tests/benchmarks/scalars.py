"""Unknown scalars of `chemage.infer`: how well chains mix, and simulation-based calibration.

    python tests/benchmarks/scalars.py mixing [bond_force,attempt_frequency,...]
    python tests/benchmarks/scalars.py ranks bond_force+attempt_frequency [--cases 40] [--first 0]

Four curves of 25 points (50 and 150 nN, 300 and 350 K, errors of 3 % and 0.2 nN). `mixing` infers a normal density with
each scalar and each two, and prints R-hat and effective samples. `ranks` draws densities, scalars and errors from the
prior, measures them with a forward model at those scalars, which is not interpolated, and prints the ranks of the true
scalars among the samples and their p of Kolmogorov and Smirnov (Talts et al., arXiv:1804.06788), and how many cases
`infer` would call not converged, which count as well. Its sites are 16 times as many, each with a 16th of the force: of
156, five per cent come into contact at once as the load rises.
"""

from __future__ import annotations

import argparse
import itertools
import time
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import kstest

import chemage as ca
from chemage_inference import sampling
from chemage_inference.calibrate import _errors, _rank, densities_of_prior
from chemage_inference.families import linear_problem
from chemage_inference.forward import check_scene, make_model
from chemage_inference.infer import calibrations
from chemage_inference.noise import ErrorModel, State
from chemage_inference.problem import LOAD, UNITS, Prior, unknowns_of
from chemage_inference.result import APART, FEW

TIMES = np.logspace(-3, 5, 25)
CONDITIONS = [(load, kelvin) for load in (50.0, 150.0) for kelvin in (300.0, 350.0)]
#: what instruments may get wrong -> standard error
CALIBRATIONS = {"force": 0.10, "load": 0.05, "drift": 0.05, "offset": 2.0}
SCENE = {
    "name": "tip",
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 64, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "gaussian", "mean": "0.95 eV", "std": "0.1 eV"},
    "chemistry": {"activation_volume": "6.4 angstrom**3", "bond_force": "3 nN"},
    "engine": {"kind": "rejection-free"},
    "hold": {"times": TIMES.tolist()},
}


def options(names: list[str]) -> dict[str, Any]:
    """Unknowns and calibrations of `chemage.infer`."""
    return {
        "unknown": [name for name in names if name in UNITS],
        "calibration": {name: CALIBRATIONS[name] for name in names if name in CALIBRATIONS},
    }


def measured(seed: int) -> list[ca.MeasuredCurve]:
    """Curves of the density of the scene, by the quadrature of the method ``closure``."""
    rng, curves = np.random.default_rng(seed), []
    for load, kelvin in CONDITIONS:
        scene = ca.parse_scene(ca.plugin.override(SCENE, {"contact.load": load}))
        contact = ca.solve_contact(scene.solver, ca.make_surface(scene.surface), load)
        call = {"engine": scene.engine, "hold_times": TIMES, "temperature": kelvin, "replicas": 1}
        ageing = ca.age(contact, check_scene(scene), method=ca.ageing_method("closure"), **call)
        errors = np.hypot(0.03 * ageing.friction_drop[0], 0.2)
        values = ageing.friction_drop[0] + errors * rng.standard_normal(TIMES.size)
        name = f"{load:g} nN, {kelvin:g} K"
        call = {"name": name, "load": load, "temperature": kelvin, "hold_times": TIMES}
        curves.append(ca.MeasuredCurve(values=values, errors=errors, **call))
    return curves


def mixing(cases: list[list[str]]) -> None:
    """Print R-hat and effective samples of every scalar."""
    curves = measured(1)
    for names in cases:
        begin = time.process_time()
        found = ca.infer(curves, SCENE, families=(), threads=1, **options(names))
        seconds, numbers = time.process_time() - begin, found.statistics()
        del numbers["density"]
        each = {name: f"{float(one['r_hat']):.3f}, {float(one['ess_bulk']):.0f}" for name, one in numbers.items()}
        print("+".join(names), f"{seconds:.1f} CPU s, {found.diagnostics['sweeps']} sweeps:", each, flush=True)


def ranks(names: list[str], cases: int, first: int) -> None:
    """Print the ranks of true scalars."""
    given = options(names)
    load, nuisances = calibrations(given["calibration"])
    fine = {"pixels": 256, "pixel_size": "0.11295 nm"}
    changes = {"surface": SCENE["surface"] | fine, "chemistry.bond_force": "0.1875 nN"}
    scene = ca.parse_scene(ca.plugin.override(SCENE, changes | {"chemistry.site_density": "78.4 nm**-2"})).completed()
    chemistry, curves = check_scene(scene), tuple(measured(1))
    unknowns, found = unknowns_of(given["unknown"], chemistry, load), {}
    apart: list[int] = []
    sampling.CHAINS = 2
    with scene.in_use():
        model = make_model(
            scene, chemistry, unknowns, curves, 0, None, ErrorModel.of(("scaled", "robust"), **nuisances)
        )
        shared = linear_problem(model, Prior(model.grid.nodes), np.zeros(model.grid.count))
        truths = densities_of_prior(model, cases, np.random.default_rng([first, 151]))
        for number, density in enumerate(truths):
            rng = np.random.default_rng([first, number])
            sizes = [axis.size - 1 for axis in unknowns.axes.values()]
            position = rng.uniform(0, np.array(sizes, float)) if sizes else np.zeros(0)
            if load:  # the last axis, ±2.5 standard deviations
                normal = rng.standard_normal(100)
                position[-1] = (normal[np.abs(normal) < 2.5][0] / 5 + 0.5) * sizes[-1]
            log = rng.uniform(*unknowns.factor) if unknowns.factor else 0.0
            values = {name: float(at[0]) for name, at in unknowns.values(position[None]).items()}
            over = values.pop(LOAD, 1.0)
            exact = replace(
                model,
                chemistry=chemistry.replace(**values),
                unknowns=replace(unknowns, axes={}),
                curves=[curve.model_copy(update={"load": over * curve.load}) for curve in curves],
                conditions={},
            )
            fitted = np.exp(log) * (exact.without_neighbours(0) @ density)
            noisy, state = _errors(exact.noise, fitted, rng)
            problem = replace(shared, values=noisy, state=State(state.scales, state.inflation, model.state.nuisances))
            samples = sampling.sample(
                problem, density, samples=200, seed=number, watched=model.seen(), sweeps=1500, threads=1
            )
            apart += [number] if samples.r_hat > APART or samples.effective < FEW else []
            true = {**values, "load": over, "bond_force": np.exp(log)}
            drawn = unknowns.values(samples.positions)
            drawn |= {"bond_force": samples.factors}
            drawn["load"] = drawn.pop(LOAD, np.ones(len(samples.places)))
            # without the sites of an unknown load, the last ones, which the exact contact has
            columns = zip(exact.noise.nuisances, samples.nuisances.T, state.nuisances.tolist(), strict=False)
            for (name, _), column, number_ in columns:
                name = "force" if name == "calibration" else name
                drawn[name], true[name] = column, number_
            for name in names:
                found.setdefault(name, []).append(_rank(drawn[name], float(true[name]), rng))
            shown = {
                name: f"p {kstest(each, 'uniform').pvalue:.3f}, mean {np.mean(each):.2f}, 90 % hold "
                f"{np.mean(np.abs(np.array(each) - 0.5) < 0.45):.2f}"
                for name, each in found.items()
            }
            if number % 5 == 4:
                print(number + 1, f"R-hat {samples.r_hat:.3f}, not converged: {apart}", shown, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("mixing", "ranks"))
    parser.add_argument("names", nargs="?", default="")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    every = [*UNITS, *CALIBRATIONS]
    if given.what == "ranks":
        ranks(given.names.split("+"), given.cases, given.first)
    else:
        alone = [[name] for name in every]
        pairs = [list(two) for two in itertools.combinations(every, 2)]
        mixing([case.split("+") for case in given.names.split(",")] if given.names else [*alone, *pairs])


if __name__ == "__main__":
    main()
