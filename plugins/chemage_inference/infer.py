"""From measured curves of ageing to the density of barriers."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from chemage import InputError, PlanWarning, Scene, load_scene
from chemage import errors as in_words
from chemage.plugin import (
    KB,
    algebra,
    checked_count,
    checked_seed,
    convert,
    progress,
    units,
    versions,
)
from chemage_inference.curves import MeasuredCurve, check_curves, read_curves
from chemage_inference.energies import averaging
from chemage_inference.families import compared, estimated, linear_problem, sampled
from chemage_inference.forecast import band
from chemage_inference.forward import Model, check_scene, make_model
from chemage_inference.noise import SITES, ErrorModel
from chemage_inference.problem import (
    REACH,
    Data,
    Prior,
    Problem,
    Unknowns,
    redrawn_outside,
    unknowns_of,
    values_of,
)
from chemage_inference.result import Inference
from chemage_inference.sampling import CHAINS, Samples

#: what is kept of each curve
_STATED = (
    *("name", "load", "temperature", "temperature_unit", "quantity"),
    "instrument",
)
#: parametric families with which the smooth density is compared
FAMILIES = ("uniform", "triangle", "gaussian", "piecewise")
#: width over k_BT of the range of barriers that react about one hold time: full width at half maximum of the
#: derivative of 1 − exp(−exp(x))
WIDTH = 2.446
#: samples of the prior that are kept
PRIOR_SAMPLES = 400
#: share of the friction at the last hold time from above the visible energies from which a note says so
MAINLY = 0.5
#: an energy is visible where the standard deviation of the density, or that over its mean, is below this share of the
#: prior's
NARROWER = 0.7
#: what may be stated of a calibration -> unit of its standard error
CALIBRATIONS = {"force": "", "drift": "", "offset": "nN", "load": ""}
#: unit -> the largest standard error of a calibration, beyond which forces were not measured, what it must be, and how
#: it is written
LARGEST_ERRORS = {
    "": (0.5, "must be between 0 and 50 %", '10 % is 0.1 or "10 %"'),
    "nN": (np.inf, "must be at least 0 nN", "0.5 nN is 0.5"),
}


def infer(
    measured: MeasuredCurve | Sequence[Any] | str | Path | Any,
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    unknown: Mapping[str, tuple[units.QuantityLike, units.QuantityLike]]
    | Sequence[str] = (),
    errors: str | Sequence[str] = ("scaled", "robust"),
    calibration: units.QuantityLike | Mapping[str, units.QuantityLike] = 0.0,
    families: Sequence[str] = FAMILIES,
    samples: int = 1000,
    seed: int = 0,
    threads: int | None = None,
    progress: progress.Report | None = None,
) -> Inference:
    """Infer the density of forming barriers from measured curves of ageing.

    Parameters
    ----------
    measured
        Curves from :func:`chemage.read_curves`, or files, data frames and results of chemage themselves.
    scene
        Everything but the density: surface, contact, breaking barriers, interaction, the other values of the chemistry.
        Its ``[forming]``, loads, temperatures and hold times are not used; those of the curves are.
    unknown
        Scalars of the chemistry that are inferred as well, with the bounds of their priors, such as
        ``{"activation_volume": ("0 angstrom**3", "15 angstrom**3")}``: ``bond_force`` and ``attempt_frequency`` (both
        uniform in the logarithm) and ``activation_volume`` (uniform). As a list of names: with default bounds.
    errors
        What is inferred of the errors: "scaled", a factor of the stated ones, for each curve; "robust", which points
        are off; "correlated", a correlation time along each curve. "as-stated" or none: errors as they are stated.
    calibration
        Relative standard error of a factor that all values of an instrument share, such as "10 %"; or standard errors
        of several: ``force``, that factor; ``drift``, the relative change of it per decade of the hold time, where it
        is 1 in the middle of the decades; ``offset`` (nN), what the instrument adds; and ``load``, the relative one of
        all loads. Default: 0, calibrated.
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

    Warns
    -----
    PlanWarning
        A temperature may be one in °C; not where its unit was written with it, as in "27 K".

    Raises
    ------
    InputError
        Naming what is wrong with the measurements or the scene, and the remedy.
    UnexplainedError
        No density explains the data: with the best fit and where it fails.
    """
    begin = time.process_time()
    scene = load_scene(scene).completed()
    chemistry = check_scene(scene)
    load_error, nuisances = calibrations(calibration)
    error_model = ErrorModel.of(errors, **nuisances)
    several = measured if isinstance(measured, list | tuple) else (measured,)
    read = [
        [one] if isinstance(one, MeasuredCurve) else read_curves(one)
        for one in several
    ]
    curves = tuple(chain.from_iterable(read))
    check_curves(curves, error_model.drift)
    for curve in curves:
        if curve.question:
            warnings.warn(curve.question, PlanWarning, stacklevel=3)
    unknowns = unknowns_of(unknown, chemistry, load_error)
    _check_chemistry(curves, scene, unknowns)
    seed, samples = checked_seed(seed), checked_count("samples", samples, 50)
    for name in families:
        if name not in FAMILIES:
            raise InputError.of(
                "families", name, "is no family", f"choose of {', '.join(FAMILIES)}"
            )
    points = sum(curve.hold_times.size for curve in curves)
    if points < 3 + len(unknowns.bounds):
        raise InputError(
            f"hold_times: {points} points are fewer than the unknowns, a level, a slope and a curvature of the density"
            + "".join(f", {name}" for name in unknowns.bounds)
            + "; measure at more hold times"
        )
    report = progress or (lambda stage, done, total, note="": None)
    with scene.in_use():
        model = make_model(
            scene,
            chemistry,
            unknowns,
            curves,
            seed,
            lambda done, all: report("contact", done, all),
            error_model,
        )
        density, changes = estimated(model, threads, report)
        problem, drawn, changes = sampled(
            model, density, samples, threads, report, changes
        )
        scores, fits = compared(model, problem, drawn, families, threads, report)
    return _inference(
        model, problem, drawn, (scores, fits), changes, time.process_time() - begin
    )


def calibrations(
    given: units.QuantityLike | Mapping[str, units.QuantityLike],
) -> tuple[float, dict[str, float]]:
    """Relative standard error of loads, and standard deviations of :data:`chemage_inference.noise.NUISANCES`.

    Raises
    ------
    InputError
        A name that is none, or an error that is negative or more than 50 %.
    """
    parts = given if isinstance(given, Mapping) else {"force": given}
    errors: dict[str, float] = dict.fromkeys(CALIBRATIONS, 0.0)
    for name, value in parts.items():
        if name not in CALIBRATIONS:
            choice = f"choose of {', '.join(CALIBRATIONS)}"
            raise InputError.of("calibration", name, "is no calibration", choice)
        unit, field = CALIBRATIONS[name], f"calibration.{name}"
        most, problem, remedy = LARGEST_ERRORS[unit]
        errors[name] = convert(value, unit, field)
        if not 0 <= errors[name] <= most:
            raise InputError.of(field, value, problem, remedy)
    errors["calibration"] = errors.pop("force")
    return errors.pop("load"), errors


def _check_chemistry(
    curves: Sequence[MeasuredCurve], scene: Scene, unknowns: Unknowns
) -> None:
    """Refuse curves that are known to come from another chemistry."""
    assert scene.chemistry is not None
    own = scene.chemistry.todict()
    left_out = {"forming", *unknowns.bounds, *scene.chemistry.limits}
    for curve in curves:
        theirs = curve.chemistry
        for name in sorted((own.keys() | theirs.keys()) - left_out):
            if theirs and theirs.get(name) != own.get(name):
                raise InputError(
                    f"{curve.name}: measured with {name} = {in_words.shown(theirs.get(name))}, "
                    f"scene {scene.name!r} has {in_words.shown(own.get(name))}; "
                    "infer curves of different chemistries apart, each with its own scene"
                )


def _visible(
    model: Model, samples: np.ndarray, prior: np.ndarray, resolution: float
) -> np.ndarray:
    """(n,) where hold times lie on both sides, and the density averaged over the resolution is narrower than before."""
    mean = averaging(model.grid.nodes, resolution).T
    after, before = algebra.product(samples, mean), algebra.product(prior, mean)
    spread, least = after.std(axis=0), NARROWER * before.std(axis=0)
    # where the density is high, its deviation may be large and still small beside it
    relative = spread * before.mean(axis=0) < least * after.mean(axis=0)
    return model.seen() & ((spread < least) | relative)


def widened(model: Model, wide: Model, densities: np.ndarray) -> np.ndarray:
    """``densities`` (S, n) that end at the end nodes of a model on ``wide`` energies: as such that go on, of the same
    integral and mean energy."""
    longer, ends = densities.copy(), densities[:, [0, -1]]
    # the inner half of a hat, whose mean lies a third of a step inside
    longer[:, [0, -1]] = ends / 3
    longer[:, [1, -2]] += ends / 6
    return np.pad(longer, ((0, 0), wide.grid.place(model.grid)))


def with_hidden(
    model: Model, wide: Model, samples: Samples, prior: Prior
) -> tuple[Problem, Samples]:
    """Samples of the posterior on ``wide`` energies, with the barriers that hold times do not reach."""
    densities = widened(model, wide, samples.densities)
    problem = linear_problem(wide, prior, densities.mean(axis=0))
    settled = problem.settled(samples.typical)
    data = Data(
        settled.matrices,
        problem.unknowns.weights(samples.positions),
        samples.factors,
        settled.values,
        settled.offsets,
        KB * max(curve.temperature for curve in model.curves),
    )
    rng = np.random.default_rng([model.seed, 101])
    drawn = redrawn_outside(wide.grid, wide.seen(), densities, rng, data)
    return problem, replace(samples, densities=drawn)


def _inference(
    model: Model,
    problem: Problem,
    samples: Samples,
    fits: tuple[dict[str, float], dict[str, Any]],
    changes: list[float],
    seconds: float,
) -> Inference:
    rng = np.random.default_rng([model.seed, 97])
    prior = problem.prior.sample(PRIOR_SAMPLES, model.grid.areas, rng)
    resolution = WIDTH * KB * max(curve.temperature for curve in model.curves)
    visible = _visible(model, samples.densities, prior, resolution)
    wide = model.on(model.grid.wider(*REACH))
    problem, samples = with_hidden(model, wide, samples, problem.prior)
    rng = np.random.default_rng([model.seed, 103])
    prior = widened(model, wide, prior)
    prior = redrawn_outside(wide.grid, wide.seen(), prior, rng)
    visible = np.pad(visible, wide.grid.place(model.grid))
    model = wide
    noise, state = problem.noise, samples.typical
    fitted = samples.expected(problem)
    # in independent combinations of the points, or a correlated error counts as a parameter of the density
    each = noise.white(state, (problem.values - fitted).T)
    chi2 = float(
        np.sum(noise.white(state, problem.values - fitted.mean(axis=0)) ** 2)
    )
    unknowns = problem.unknowns
    scalars = unknowns.values(samples.positions)
    if unknowns.factor is not None:
        scalars["bond_force"] = samples.factors * model.chemistry.bond_force
    # with the scalars that the data allow
    rows = np.arange(len(prior)) % len(samples.positions)
    weights = unknowns.weights(samples.positions[rows])
    # the forming barriers of the scene are not used
    forming = model.chemistry.forming
    used = [part for part in model.scene.components() if part is not forming]
    cite = [text for part in used for text in part.cite]
    cite += [value.source for value in model.scene.from_material]
    inference = Inference(
        energies=model.grid.nodes,
        samples=samples.densities,
        prior=prior,
        visible=visible,
        curve=model.curve,
        hold_times=model.hold_times,
        values=problem.values,
        errors=noise.errors(replace(state, inflation=np.ones(problem.values.size))),
        stated_errors=np.hypot(noise.stated, noise.floors),
        off=samples.off,
        near=noise.correlation(state) if noise.chained else None,
        error_terms=_error_terms(model, samples),
        fitted=fitted,
        prior_fitted=values_of(prior, weights, problem.matrices, problem.offsets),
        curves=tuple(
            {name: getattr(curve, name) for name in _STATED}
            for curve in model.curves
        ),
        scalars=scalars,
        scalar_bounds=dict(unknowns.bounds),
        scores=fits[0],
        families=fits[1],
        chi2=chi2,
        effective_parameters=float(np.sum(each.var(axis=1))),
        resolution=resolution,
        diagnostics={
            "effective_samples": samples.effective,
            "r_hat": samples.r_hat,
            "sweeps": samples.sweeps,
            "chains": CHAINS,
            "iterations": len(changes),
            "changes": changes,
            "cpu_seconds": seconds,
        },
        seed=model.seed,
        provenance={
            "scene": model.scene.todict(),
            "versions": versions(model.scene),
            "unknown": list(unknowns.bounds),
            "cite": list(dict.fromkeys(cite)),
        },
    )
    notes = dict.fromkeys(_notes(model, problem, samples, inference))
    inference = inference.model_copy(update={"notes": tuple(notes)})
    for load in model.loads:
        contact = model.contacts.at(load)
        inference = inference.noting(contact.plugins, contact.approximate)
    return inference


def _error_terms(model: Model, samples: Samples) -> dict[str, np.ndarray]:
    """Name -> (S,) what was inferred of the errors."""
    terms, error_model = {}, model.error_model
    if error_model.scaled:
        for number, scale in enumerate(samples.scales.T):
            terms[f"scale {number}"] = scale
    if error_model.correlated:
        times = [state.log_time for state in samples.states]
        terms["correlation time"] = np.exp(times)
    nuisances = model.noise.nuisances
    for (name, number), drawn in zip(nuisances, samples.nuisances.T, strict=True):
        label = name
        if name == SITES:
            label = f"{name} under {model.loads[number]:g} nN"
        elif len(model.instruments) > 1:
            label = f"{name} of {model.instruments[number]}"
        # a factor by its logarithm
        terms[label] = np.exp(drawn) if name in ("calibration", SITES) else drawn
    return terms


def _notes(
    model: Model, problem: Problem, samples: Samples, inference: Inference
) -> Iterator[str]:
    """What the user should know."""
    visible, diagnostics = inference.visible, inference.diagnostics
    for curve in model.curves:
        yield from (f"{curve.name}: {note}" for note in curve.notes)
        yield from [curve.question] if curve.question else []
    few = list(_hardly_any(model))
    yield from few
    if not visible.any():
        yield "the data tell nothing: at no energy is the band narrower than that of the prior"
    else:
        low, high = inference.visible_range
        yield (
            f"energies from {low:.3f} to {high:.3f} eV are visible; outside, the density is that of the prior, but for "
            "how many sites lie there and for what the first and last hold times still tell of them"
        )
        yield from () if few else _above(problem, samples, inference)
        hidden = model.grid.nodes[model.seen() & ~visible]
        if hidden.size:
            yield (
                f"between {hidden[0]:.3f} and {hidden[-1]:.3f} eV the data hardly tell: at some energies the band is "
                "as wide as that of the prior"
            )
    for name, (bottom, top) in inference.scalar_bounds.items():
        low, high = inference.interval(name)
        if high - low > 0.8 * (top - bottom):
            yield f"{name}: its interval is as wide as its bounds, so that the data do not tell it"
    if not inference.converged:
        yield (
            f"sampling has not converged ({diagnostics['effective_samples']:.0f} effective samples, "
            f"R-hat {diagnostics['r_hat']:.2f}): the bands may be too narrow; repeat with another seed"
        )
    changes = diagnostics["changes"]
    if changes and changes[-1] > 0.05:
        yield (
            f"the interaction was not iterated to the end: the last round changed the density by {changes[-1]:.2f} "
            "in all"
        )
    chi2, count = inference.chi2, problem.values.size
    if chi2 > 1.5 * count + 10:
        yield f"χ² = {chi2:.0f} for {count} points: the errors are too small, or the scene is off"
    yield from inference.critic.notes()
    if suspects := inference.suspects():
        yield f"suspect points, which hardly count: {', '.join(suspects)}; measure them again"


def _above(
    problem: Problem, samples: Samples, inference: Inference
) -> Iterator[str]:
    """A note if the friction at the last hold time comes mainly from barriers above the visible energies."""
    high, energies = inference.visible_range[1], inference.energies
    last = int(np.argmax(inference.hold_times))
    weights = problem.unknowns.weights(samples.positions)
    rows = algebra.product(weights, problem.matrices[:, last])
    parts = np.abs(inference.samples * rows)
    above = parts * (energies > high)
    whole = above.sum(axis=1)
    share = float((whole / np.maximum(parts.sum(axis=1), 1e-300)).mean())
    if share >= MAINLY and whole.all():
        bottom, top = band(algebra.product(above, energies) / whole, 0.95)
        yield (
            f"barriers lie above the visible energies: {100 * share:.0f} % of the friction at "
            f"{inference.hold_times[last]:.3g} s comes from sites above {high:.3f} eV, on average at {bottom:.2f} to "
            f"{top:.2f} eV (95 %); the data tell how fast these react together, and neither how many there are nor how "
            "high their barriers are"
        )


def _hardly_any(model: Model) -> Iterator[str]:
    """A note if less than one bond has formed in every contact."""
    if (
        model.values.max()
        < model.chemistry.bond_force * model.chemistry.front_factor
    ):
        last = int(np.argmax(model.hold_times))
        number = int(model.which[last])
        condition = model.condition(model.middle, number)
        load, *_ = model.keys[number]
        yield (
            f"less than one bond of {condition.sites:.0f} sites has formed by {model.hold_times[last]:.3g} s: the data "
            "hardly say more than that barriers lie above; bands of forecasts where these react are those of the "
            f"prior, and only bounds are sure, from none to all sites (0 to {condition.scale:.4g} nN under {load:g} nN)"
        )
