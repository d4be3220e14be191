"""Simulation-based calibration: whether the bands of an inference hold as often as they say, for a scene and a plan.

Truths are drawn from the prior, measured as planned, and inferred. Over many, the rank of the truth among the samples
is uniform if everything is right (Talts, Betancourt, Simpson, Vehtari, Gelman, arXiv:1804.06788).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from chemage import InputError, Scene, load_scene
from chemage.plugin import (
    algebra,
    checked_count,
    checked_seed,
    progress,
    text,
    units,
)
from chemage_inference.curves import MeasuredCurve
from chemage_inference.families import estimated, sampled
from chemage_inference.forward import Model, check_scene, make_model
from chemage_inference.infer import calibrations, widened, with_hidden
from chemage_inference.noise import (
    LARGEST,
    RARE,
    SMALLEST,
    SPREAD,
    TIME,
    TIME_SPREAD,
    WIDER,
    ErrorModel,
    Noise,
    State,
    fixed,
)
from chemage_inference.problem import (
    REACH,
    Prior,
    Problem,
    Unknowns,
    redrawn_outside,
)
from chemage_inference.result import UnexplainedError
from chemage_inference.sampling import Chain, warm

#: sweeps of the prior between two truths, and of each chain of an inference; samples that are kept
APART, SWEEPS, KEPT = 200, 1200, 400
#: levels whose coverage is stated
LEVELS = (0.68, 0.90)


@dataclass(frozen=True)
class Calibration:
    """Ranks of truths among the samples of their inferences."""

    #: quantity -> ranks between 0 and 1
    ranks: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: truths that were refused as unexplained
    refused: int = 0

    def chance(self, name: str) -> float:
        """Probability of ranks that are less uniform, by Kolmogorov and Smirnov."""
        from scipy.stats import kstest

        return float(kstest(self.ranks[name], "uniform").pvalue)

    def coverage(self, name: str, level: float) -> float:
        """Share of the truths inside the central interval of ``level``."""
        return float(np.mean(np.abs(self.ranks[name] - 0.5) <= level / 2))

    def rows(self) -> list[tuple[str, ...]]:
        """(quantity, p of uniform ranks, coverage of each level)."""
        count = len(next(iter(self.ranks.values()), ()))
        rows = []
        for name in self.ranks:
            held = (
                f"{100 * self.coverage(name, level):.0f} ± {100 * (level * (1 - level) / max(count, 1)) ** 0.5:.0f} %"
                for level in LEVELS
            )
            rows.append((name, f"{self.chance(name):.3f}", *held))
        return rows

    def todict(self) -> dict[str, Any]:
        """Plain JSON values."""
        each = {
            name: {
                "ranks": ranks,
                "uniform": self.chance(name),
                "coverage": {
                    f"{level:g}": self.coverage(name, level) for level in LEVELS
                },
            }
            for name, ranks in self.ranks.items()
        }
        return text.jsonable({"quantities": each, "refused": self.refused})


def calibrate(
    plan: Sequence[MeasuredCurve],
    scene: Scene | str | Mapping[str, Any],
    *,
    count: int = 50,
    errors: str | Sequence[str] = ("scaled", "robust"),
    calibration: units.QuantityLike | Mapping[str, units.QuantityLike] = 0.0,
    seed: int = 0,
    threads: int | None = None,
    progress: progress.Report | None = None,
) -> Calibration:
    """Calibrate the inference of a plan of measurements by ``count`` simulated truths.

    Parameters
    ----------
    plan
        Curves whose hold times, loads, temperatures and errors are those that will be measured; values are not used.
    scene
        As of :func:`chemage.infer`, without an interaction.
    errors, calibration
        As of :func:`chemage.infer`; truths have such errors.

    Raises
    ------
    InputError
        The scene has an interaction, whose simulated part belongs to one density; or a loads' calibration was given.
    """
    scene = load_scene(scene).completed()
    chemistry = check_scene(scene)
    if chemistry.interaction is not None:
        raise InputError(
            f"scene {scene.name!r}: neighbours are simulated at one density, which takes hours for {count} truths; "
            "leave out [interaction] for the calibration"
        )
    load, nuisances = calibrations(calibration)
    if load:
        raise InputError.of(
            "calibration.load",
            load,
            "is not drawn here",
            "give those of the instruments alone",
        )
    error_model = ErrorModel.of(errors, **nuisances)
    seed, count = checked_seed(seed), checked_count("count", count, 10)
    report = progress or (lambda stage, done, total, note="": None)
    with scene.in_use():
        model = make_model(
            scene, chemistry, Unknowns(), tuple(plan), seed, None, error_model
        )
        wide = model.on(model.grid.wider(*REACH))
        truths = densities_of_prior(
            model, count, np.random.default_rng([seed, 151])
        )
        truths = redrawn_outside(
            wide.grid,
            wide.seen(),
            widened(model, wide, truths),
            np.random.default_rng([seed, 157]),
        )
        ranks: dict[str, list[float]] = {}
        refused = 0
        for number, truth in enumerate(truths):
            report("calibration", number, count)
            found = _ranks(model, wide, truth, number, threads)
            refused += found is None
            for name, rank in (found or {}).items():
                ranks.setdefault(name, []).append(rank)
        report("calibration", count, count)
    return Calibration(
        {name: np.array(values) for name, values in ranks.items()}, refused
    )


def densities_of_prior(
    model: Model, count: int, rng: np.random.Generator
) -> np.ndarray:
    """(count, n) densities of the prior: a chain without measurements."""
    grid, size = model.grid, model.values.size
    matrix = model.without_neighbours(model.middle)[None]
    known = fixed(np.full(size, 1e12))
    nothing = np.zeros(size), known, matrix, np.zeros((1, size))
    problem = Problem(Prior(grid.nodes), grid.areas, *nothing)
    chain = Chain(problem, np.full(grid.count, 0.3 / grid.areas.sum()), rng)
    warm([chain], 800)
    chain.forget()
    chain.run(count * APART)
    return chain.densities[APART - 1 :: APART]


def _errors(
    noise: Noise, fitted: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, State]:
    """Measured values (m,) and their errors, drawn from the prior of errors."""
    model, start = noise.model, noise.start
    changes: dict[str, Any] = {}
    if model.scaled:
        count = start.scales.size
        scales = np.exp(SPREAD * np.abs(rng.standard_normal((1000, count))))
        first = ((scales >= SMALLEST) & (scales <= LARGEST)).argmax(axis=0)
        changes["scales"] = scales[first, np.arange(count)]
    if model.robust:
        off = rng.random(fitted.size) < RARE
        changes["inflation"] = np.where(off, WIDER, 1.0)
    if model.correlated:
        changes["log_time"] = np.log(TIME) + TIME_SPREAD * rng.standard_normal()
    changes["nuisances"] = noise.widths * rng.standard_normal(noise.widths.size)
    state = replace(start, **changes)
    drawn = rng.standard_normal(fitted.size)
    near = noise.correlation(state)
    for at in range(1, drawn.size):
        drawn[at] = (
            near[at] * drawn[at - 1] + np.sqrt(1 - near[at] ** 2) * drawn[at]
        )
    measured = noise.factor(state) * fitted + noise.added(state)
    return measured + noise.errors(state) * drawn, state


def _ranks(
    model: Model,
    wide: Model,
    truth: np.ndarray,
    number: int,
    threads: int | None,
) -> dict[str, float] | None:
    """Ranks of a truth; None where its measurements are refused."""
    rng = np.random.default_rng([model.seed, 163, number])
    fitted, _ = wide.linear(truth, 0)
    values, state = _errors(model.noise, fitted, rng)
    curves = tuple(
        curve.model_copy(
            update={
                "values": values[model.curve == at],
                "errors": curve.friction_drop_errors,
                "quantity": "friction_drop",
            }
        )
        for at, curve in enumerate(model.curves)
    )
    measured = replace(
        model,
        curves=curves,
        seed=model.seed + 1000 + number,
        conditions=dict(model.conditions),
    )
    measured.floors = model.floors
    silent = lambda stage, done, total, note="": None  # noqa: E731
    try:
        density, changes = estimated(measured, threads, silent)
    except UnexplainedError:
        return None
    problem, samples, _ = sampled(
        measured, density, KEPT, threads, silent, changes, SWEEPS
    )
    there = measured.on(wide.grid)
    problem, samples = with_hidden(measured, there, samples, problem.prior)
    values = samples.fitted(problem)
    drawn = _ranked(wide, samples.densities, values, samples.states)
    true = _ranked(wide, truth[None], fitted[None], [state])
    return {
        name: _rank(values, float(true[name][0]), rng)
        for name, values in drawn.items()
    }


def _ranked(
    model: Model,
    densities: np.ndarray,
    fitted: np.ndarray,
    states: Sequence[State],
) -> dict[str, np.ndarray]:
    """Name -> (S,) what is ranked of ``densities`` (S, n), their values (S, m), and errors."""
    grid, seen = model.grid, np.flatnonzero(model.seen())
    found: dict[str, np.ndarray] = {}
    for share in (0.25, 0.5, 0.75):
        end = seen[int(share * (seen.size - 1))] + 1
        name = f"share of the sites below {grid.nodes[end - 1]:.2f} eV"
        found[name] = algebra.product(densities[:, :end], grid.areas[:end])
    last = int(np.argmax(model.hold_times))
    found[f"friction drop at {model.hold_times[last]:.3g} s"] = fitted[:, last]
    if model.error_model.scaled:
        scales = [state.scales[0] for state in states]
        found["scale of the errors"] = np.array(scales)
    for number, (name, instrument) in enumerate(model.noise.nuisances):
        if not instrument:
            found[name] = np.array([state.nuisances[number] for state in states])
    return found


def _rank(drawn: np.ndarray, true: float, rng: np.random.Generator) -> float:
    """The rank of a truth among samples, between 0 and 1; among equal ones, such as zeros, at random."""
    close = np.abs(drawn - true) <= 1e-9 * max(abs(true), 1e-9)
    below = np.sum((drawn < true) & ~close)
    return float((below + rng.random() * (close.sum() + 1)) / (drawn.size + 1))
