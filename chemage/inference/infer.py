"""From measured curves of ageing to the density of barriers."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from chemage.experiments.provenance import versions
from chemage.experiments.scene import Scene, parse_scene
from chemage.experiments.scene_files import load_scene
from chemage.foundation.checks import checked_count, checked_seed
from chemage.foundation.errors import InputError, shown
from chemage.foundation.progress import Report
from chemage.foundation.units import KB, QuantityLike
from chemage.inference import families as parametric
from chemage.inference.assembly import Model, make_model
from chemage.inference.curves import MeasuredCurve, check_curves, read_curves
from chemage.inference.estimate import check_explained, first_estimate, smooth_fit
from chemage.inference.forecast import band
from chemage.inference.forward import check_scene
from chemage.inference.inference import Inference
from chemage.inference.prior import Prior
from chemage.inference.problem import Problem, Scalars
from chemage.inference.sampling import Samples, sample
from chemage.inference.unknowns import Unknowns, unknowns_of

#: parametric families with which the smooth density is compared
FAMILIES = ("uniform", "triangle", "gaussian", "piecewise")
#: width over k_BT of the range of barriers that react about one hold time: full width at half maximum of the
#: derivative of 1 − exp(−exp(x))
WIDTH = 2.446
#: rounds of Gauss-Newton steps, each with kinetics simulated at its density; steps in a round
ROUNDS, STEPS = 4, 6
#: change of the density, integrated over the visible energies, that ends the iteration
CONVERGED = 0.01
#: samples of the prior that are kept; samples of short runs, and sweeps of their chains
PRIOR_SAMPLES, SHORT, SHORT_SWEEPS = 400, 400, 200
#: effective samples below which, and R-hat above which, a note says so
FEW, APART = 100, 1.05
#: an energy is visible where the standard deviation of the density, or that over its mean, is below this share of the
#: prior's
NARROWER = 0.7


def infer(
    measured: MeasuredCurve | Sequence[MeasuredCurve] | str | Path,
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    unknown: Mapping[str, tuple[QuantityLike, QuantityLike]] | Sequence[str] = (),
    families: Sequence[str] = FAMILIES,
    samples: int = 1000,
    seed: int = 0,
    threads: int | None = None,
    progress: Report | None = None,
) -> Inference:
    """Infer the density of forming barriers from measured curves of ageing.

    Parameters
    ----------
    measured
        Curves from :func:`chemage.read_curves`, or the CSV file itself.
    scene
        Everything but the density: surface, contact, breaking barriers, interaction, the other values of the chemistry.
        Its ``[forming]``, loads, temperatures and hold times are not used; those of the curves are.
    unknown
        Scalars of the chemistry that are inferred as well, with the bounds of their priors, such as
        ``{"activation_volume": ("0 angstrom**3", "15 angstrom**3")}``: ``bond_force`` and ``attempt_frequency`` (both
        uniform in the logarithm) and ``activation_volume`` (uniform). As a list of names: with default bounds.
    families
        Parametric families to compare, of "uniform", "triangle", "gaussian", "piecewise"; empty: none, and no scores.
    samples
        Samples of the posterior that are kept.
    seed
        Of sampling and of the simulated kinetics: the same seed gives the same result.
    threads
        Threads for the simulated kinetics; default: one per processor.
    progress
        Called as the stages "contact", "interaction", "sampling" and "families" advance.

    Raises
    ------
    InputError
        Naming what is wrong with the measurements or the scene, and the remedy.
    UnexplainedError
        No density explains the data: with the best fit and where it fails.
    """
    begin = time.process_time()
    scene = _scene_of(scene)
    chemistry = check_scene(scene)
    curves = _curves_of(measured)
    unknowns = unknowns_of(unknown, chemistry)
    _check_chemistry(curves, scene, unknowns)
    seed, samples = checked_seed(seed), checked_count("samples", samples, 50)
    for name in families:
        if name not in FAMILIES:
            raise InputError.of("families", name, "is no family", f"choose of {', '.join(FAMILIES)}")
    points = sum(curve.hold_times.size for curve in curves)
    if points < 3 + len(unknowns.bounds):
        raise InputError(
            f"hold_times: {points} points are fewer than the unknowns, a level, a slope and a curvature of the density"
            + "".join(f", {name}" for name in unknowns.bounds)
            + "; measure at more hold times"
        )
    report = progress or (lambda stage, done, total, note="": None)
    with scene.in_use():
        model = make_model(scene, chemistry, unknowns, curves, seed, lambda done, all: report("contact", done, all))
        density, changes = _estimated(model, threads, report)
        problem, found, changes = _sampled(model, density, samples, threads, report, changes)
        scores, fits = _compared(model, problem, found, families, threads, report)
    return _made(model, problem, found, scores, fits, changes, time.process_time() - begin)


def _scene_of(scene: Scene | str | Path | Mapping[str, Any]) -> Scene:
    if not isinstance(scene, Scene):
        scene = parse_scene(scene) if isinstance(scene, Mapping) else load_scene(scene)
    return scene.completed()


def _curves_of(measured: Any) -> tuple[MeasuredCurve, ...]:
    if isinstance(measured, str | Path):
        measured = read_curves(measured)
    curves = (measured,) if isinstance(measured, MeasuredCurve) else measured
    if not isinstance(curves, list | tuple) or not all(isinstance(one, MeasuredCurve) for one in curves):
        raise InputError.of(
            "measured", measured, "is no MeasuredCurve", "give curves from chemage.read_curves, or a file"
        )
    check_curves(curves)
    return tuple(curves)


def _check_chemistry(curves: Sequence[MeasuredCurve], scene: Scene, unknowns: Unknowns) -> None:
    """Refuse curves that are known to come from another chemistry."""
    assert scene.chemistry is not None
    own = scene.chemistry.todict()
    left_out = {"forming", *unknowns.bounds, *scene.chemistry.limits}
    for curve in curves:
        for name in sorted((own.keys() | curve.chemistry.keys()) - left_out):
            theirs, ours = curve.chemistry.get(name), own.get(name)
            if curve.chemistry and theirs != ours:
                raise InputError(
                    f"{curve.name}: measured with {name} = {shown(theirs)}, scene {scene.name!r} has {shown(ours)}; "
                    "infer curves of different chemistries apart, each with its own scene"
                )


# -- from the curves to a linear model --------------------------------------------------------------------------------


def _estimated(model: Model, threads: int | None, report: Report) -> tuple[np.ndarray, list[float]]:
    """The density of best fit, smoothed, and how much each round of the interaction changed it."""
    values, factor = model.values, model.unknowns.factor
    if model.unknowns.points > 1:
        model.middle = _best_point(model)
    middle = model.middle
    matrix = model.without_neighbours(middle)
    errors = model.errors(values)
    if not model.interacting:
        check_explained(model.grid, matrix, values, errors, np.zeros(values.size), model.labels(), _bounds(factor))
        return first_estimate(model.grid, _scaled(model, matrix), values, errors), []
    density = first_estimate(model.grid, _scaled(model, matrix), values, errors)
    seen, changes = model.seen(), []
    total = ROUNDS * STEPS
    for number in range(ROUNDS):
        before = density
        for step in range(STEPS):
            report("interaction", number * STEPS + step, total)
            fitted, slope = model.linear(density, middle)
            offset = fitted - slope @ density
            scale = _common_factor(model, fitted)
            found = first_estimate(model.grid, scale * slope, values - scale * offset, model.errors(values))
            # full steps in the end, half ones while the neighbours' part still changes much
            change = _distance(model, found, density, seen)
            density = found if change < 0.1 else 0.5 * (found + density)
            if change < CONVERGED:
                break
        changes.append(_distance(model, density, before, seen))
        model.calibrate(density, threads)
        if number and changes[-1] < CONVERGED:
            break
    fitted, slope = model.linear(density, middle)
    check_explained(
        model.grid, slope, values, model.errors(values), fitted - slope @ density, model.labels(), _bounds(factor)
    )
    report("interaction", total, total)
    return density, changes


def _best_point(model: Model) -> int:
    """The point of the grid of scalars at which a density fits best, the neighbours left out."""
    found = []
    for point in range(model.unknowns.points):
        matrix = _scaled(model, model.without_neighbours(point))
        found.append(smooth_fit(model.grid, matrix, model.values, model.errors(model.values), 1e-11)[1])
    return int(np.argmin(found))


def _bounds(factor: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if factor is None else (float(np.exp(factor[0])), float(np.exp(factor[1])))


def _scaled(model: Model, matrix: np.ndarray) -> np.ndarray:
    """The derivative, times a common factor with which some density reaches the largest value."""
    return matrix * _common_factor(model, matrix @ np.full(model.grid.count, 0.9 / model.grid.areas.sum()))


def _common_factor(model: Model, fitted: np.ndarray) -> float:
    if model.unknowns.factor is None:
        return 1.0
    ratio = float(np.log(max(model.values.max(), 1e-12) / max(fitted.max(), 1e-12)))
    return float(np.exp(np.clip(ratio, *model.unknowns.factor)))


def _distance(model: Model, one: np.ndarray, other: np.ndarray, seen: np.ndarray) -> float:
    return float((np.abs(one - other) * model.grid.areas)[seen].sum())


def _problem(model: Model, prior: Prior, density: np.ndarray) -> Problem:
    """The linear model of all points of the grid of scalars about ``density``."""
    matrices, offsets = [], []
    for point in range(model.unknowns.points):
        value, slope = model.linear(density, point)
        matrices.append(slope)
        offsets.append(value - slope @ density)
    unknowns = model.unknowns
    return Problem(
        prior,
        model.grid.areas,
        model.values,
        model.errors(model.values),
        np.stack(matrices),
        np.stack(offsets),
        Scalars(
            unknowns.values,
            unknowns.neighbours,
            "bond_force" if unknowns.factor is not None else "",
            unknowns.factor or (0.0, 0.0),
            model.middle,
        ),
    )


def _sampled(
    model: Model, density: np.ndarray, samples: int, threads: int | None, report: Report, changes: list[float]
) -> tuple[Problem, Samples, list[float]]:
    """Samples of the posterior; with an interaction the model is linear about their mean."""
    prior = Prior(model.grid.nodes)
    start = np.where(density > 1e-6, density, -0.1)
    if model.interacting:
        seen = model.seen()
        for number in range(2):
            short = _short(_problem(model, prior, density), start, model.seed + number, threads)
            mean = short.densities.mean(axis=0)
            changes = [*changes, _distance(model, mean, density, seen)]
            density = mean
            model.linear(density, model.middle)
            model.calibrate(density, threads)
            if changes[-1] < CONVERGED:
                break
        start = np.where(density > 1e-3, density, -0.1)
    problem = _problem(model, prior, density)
    found = sample(
        problem,
        start,
        samples=samples,
        seed=model.seed,
        watched=model.seen(),
        threads=threads,
        progress=lambda done, total: report("sampling", done, total),
    )
    return problem, found, changes


def _short(problem: Problem, start: np.ndarray, seed: int, threads: int | None) -> Samples:
    """Fewer samples, where their mean and covariance are enough."""
    return sample(problem, start, samples=SHORT, seed=seed, sweeps=SHORT_SWEEPS, threads=threads)


# -- what follows from the samples ------------------------------------------------------------------------------------


def _compared(
    model: Model, problem: Problem, found: Samples, families: Sequence[str], threads: int | None, report: Report
) -> tuple[dict[str, float], dict[str, Any]]:
    """Scores of the smooth density and of the families on hold times left out, and the fits of the families."""
    if not families:
        return {}, {}
    blocks = parametric.blocks_of(model.curve, model.hold_times)
    total, done = len(families) + blocks.max() + 1, 0
    seen = model.grid.nodes[model.seen()]
    low, high = (float(seen[0]), float(seen[-1])) if seen.size else (model.grid.nodes[0], model.grid.nodes[-1])
    scores, fits = {"density": 0.0}, {}
    start = np.where(found.densities.mean(axis=0) > 1e-3, found.densities.mean(axis=0), -0.1)
    for block in np.unique(blocks):
        report("families", done, total)
        out = blocks == block
        made = _short(problem.without(out), start, model.seed + 100 + int(block), threads)
        values = made.fitted(problem)[:, out]
        covariance = np.atleast_2d(np.cov(values.T)) + np.diag(problem.errors[out] ** 2)
        scores["density"] += parametric.log_score(problem.values[out], values.mean(axis=0), covariance)
        done += 1
    point = int(np.bincount(found.points).argmax())
    data = parametric.Linear(
        model.grid,
        problem.matrices[point],
        problem.offsets[point],
        problem.values,
        problem.errors,
        model.unknowns.factor,
    )
    for name in families:
        report("families", done, total)
        fits[name], scores[name] = parametric.compare(name, data, blocks, low, high)
        done += 1
    report("families", int(total), int(total))
    return scores, fits


def _visible(model: Model, samples: np.ndarray, prior: np.ndarray, resolution: float) -> np.ndarray:
    """(n,) where hold times lie on both sides, and the density averaged over the resolution is narrower than before."""
    away = (model.grid.nodes[:, None] - model.grid.nodes) / (0.5 * resolution)
    mean = np.exp(-0.5 * away**2)
    mean /= mean.sum(axis=1, keepdims=True)
    after, before = samples @ mean.T, prior @ mean.T
    narrower = after.std(axis=0) < NARROWER * before.std(axis=0)
    # where the density is high, its deviation may be large and still small beside it
    relative = after.std(axis=0) * before.mean(axis=0) < NARROWER * before.std(axis=0) * after.mean(axis=0)
    return model.seen() & (narrower | relative)


def _made(
    model: Model,
    problem: Problem,
    found: Samples,
    scores: dict[str, float],
    fits: dict[str, Any],
    changes: list[float],
    seconds: float,
) -> Inference:
    rng = np.random.default_rng([model.seed, 97])
    prior = problem.prior.sample(PRIOR_SAMPLES, model.grid.areas, rng)
    resolution = WIDTH * KB * max(curve.temperature for curve in model.curves)
    visible = _visible(model, found.densities, prior, resolution)
    fitted = found.fitted(problem)
    mean = fitted.mean(axis=0)
    chi2 = float(np.sum(((problem.values - mean) / problem.errors) ** 2))
    every = np.sum(((problem.values - fitted) / problem.errors) ** 2, axis=1)
    middle = problem.matrices[model.middle], problem.offsets[model.middle]
    diagnostics = {
        "effective_samples": found.effective,
        "r_hat": found.r_hat,
        "sweeps": found.sweeps,
        "iterations": len(changes),
        "changes": changes,
        "cpu_seconds": seconds,
    }
    unknowns = model.unknowns
    scalars = {name: values[found.points] for name, values in unknowns.values.items()}
    if unknowns.factor is not None:
        scalars["bond_force"] = found.factors * model.chemistry.bond_force
    conditions = [model.condition(model.middle, number) for number in range(len(model.keys))]
    plugins = {name: source for one in conditions for name, source in one.contact.plugins.items()}
    made = Inference(
        energies=model.grid.nodes,
        samples=found.densities,
        prior=prior,
        visible=visible,
        curve=model.curve,
        hold_times=model.hold_times,
        values=problem.values,
        errors=problem.errors,
        fitted=fitted,
        prior_fitted=middle[1] + prior @ middle[0].T,
        curves=tuple(
            {"name": one.name, "load": one.load, "temperature": one.temperature, "quantity": one.quantity}
            for one in model.curves
        ),
        scalars=scalars,
        scalar_bounds=unknowns.bounds,
        scores=scores,
        families=fits,
        chi2=chi2,
        effective_parameters=float(every.mean() - chi2),
        resolution=resolution,
        diagnostics=diagnostics,
        seed=model.seed,
        notes=tuple(_notes(model, problem, found, visible, scalars, diagnostics, chi2)),
        provenance={
            "scene": model.scene.todict(),
            "versions": versions(model.scene),
            "unknown": list(unknowns.bounds),
            "cite": _cite(model.scene),
        },
    )
    return made.noting(plugins, [entry for one in conditions for entry in one.contact.approximate])


def _cite(scene: Scene) -> list[str]:
    """What to cite: the publications of all parts of the scene but its forming barriers, which are not used."""
    forming = None if scene.chemistry is None else scene.chemistry.forming
    texts = [text for part in scene.components() if part is not forming for text in part.cite]
    return list(dict.fromkeys([*texts, *(one.source for one in scene.from_material)]))


def _notes(
    model: Model,
    problem: Problem,
    found: Samples,
    visible: np.ndarray,
    scalars: Mapping[str, np.ndarray],
    diagnostics: Mapping[str, Any],
    chi2: float,
) -> list[str]:
    notes = []
    if not visible.any():
        notes.append("the data tell nothing: at no energy is the band narrower than that of the prior")
    else:
        seen = model.grid.nodes[visible]
        hidden = model.seen() & ~visible
        notes.append(
            f"energies from {seen[0]:.3f} to {seen[-1]:.3f} eV are visible; outside, the density is that of the prior, "
            "and nothing is claimed"
        )
        if hidden.any():
            at = model.grid.nodes[hidden]
            notes.append(
                f"between {at[0]:.3f} and {at[-1]:.3f} eV the data hardly tell: at some energies the band is "
                "as wide as that of the prior"
            )
    for name, values in scalars.items():
        low, high = band(values[:, None], 0.95)
        bottom, top = model.unknowns.bounds[name]
        if float(high[0] - low[0]) > 0.8 * (top - bottom):
            notes.append(f"{name}: its interval is as wide as its bounds, so that the data do not tell it")
    if diagnostics["r_hat"] > APART or diagnostics["effective_samples"] < FEW:
        notes.append(
            f"sampling has not converged ({diagnostics['effective_samples']:.0f} effective samples, R-hat "
            f"{diagnostics['r_hat']:.2f}); repeat with another seed and compare before relying on the bands"
        )
    if model.interacting and diagnostics["changes"] and diagnostics["changes"][-1] > 0.05:
        notes.append(
            f"the interaction was not iterated to the end: the last round changed the density by "
            f"{diagnostics['changes'][-1]:.2f} in all"
        )
    if chi2 > 1.5 * problem.values.size + 10:
        notes.append(f"χ² = {chi2:.0f} for {problem.values.size} points: the errors are too small, or the scene is off")
    return notes


__all__ = ["FAMILIES", "Unknowns", "infer"]
