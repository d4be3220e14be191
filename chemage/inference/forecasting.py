"""Forecasts from samples of a density, and the measurement that would narrow them most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from chemage.ageing.hold_times import hold_times as spaced
from chemage.foundation.checks import check_times, force, temperature_value
from chemage.foundation.errors import InputError
from chemage.foundation.messages import nearest
from chemage.foundation.units import KB, QuantityLike, convert
from chemage.inference.forecast import Forecast
from chemage.inference.forward import Condition, Contacts, check_scene, largest_lowering, make_condition
from chemage.inference.kernel import EnergyGrid, averaging
from chemage.lattices.chemistry import Chemistry
from chemage.scene.scene import Scene

#: share of a prediction from energies which the data do not see above which a note says so
UNSEEN = 0.05
#: what a planned measurement may state
PLAN = ("hold_time", "load", "temperature", "error")


class Forecaster:
    """ΔF of every sample of a density at any condition; contacts are solved once."""

    def __init__(
        self,
        scene: Scene,
        energies: np.ndarray,
        samples: np.ndarray,
        scalars: Mapping[str, np.ndarray],
        seed: int,
        calibrated: bool = True,
    ) -> None:
        self.scene, self.samples, self.scalars, self.seed = scene, samples, scalars, seed
        self.chemistry = check_scene(scene)
        step = float(energies[-1] - energies[0]) / (energies.size - 1)
        self.grid = EnergyGrid(float(energies[0]), step, energies.size)
        self.contacts, self.calibrated = Contacts(scene), calibrated

    def __call__(self, load: float, temperature: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(S, m) nN of each sample, and its derivative by the density, (m, n)."""
        found = np.empty((len(self.samples), times.size))
        rng = np.random.default_rng([self.seed, 53])
        noise = rng.standard_normal(len(self.samples))
        names = [name for name in self.scalars if name != "bond_force"]
        keys = np.stack([self.scalars[name] for name in names], axis=1) if names else np.zeros((len(self.samples), 0))
        matrix = None
        for values in np.unique(keys, axis=0):
            here = np.flatnonzero((keys == values).all(axis=1))
            changed = (
                self.chemistry.replace(**dict(zip(names, values.tolist(), strict=True))) if names else self.chemistry
            )
            made = self._condition(changed, load, temperature, times)
            mean = self.samples[here].mean(axis=0)
            value, matrix = self._linear(made, mean)
            part = value + (self.samples[here] - mean) @ matrix.T
            if made.correction is not None and made.correction_error is not None:
                part *= 1 + noise[here, None] * made.correction_error / made.correction
            found[here] = part
        if "bond_force" in self.scalars:
            found *= (self.scalars["bond_force"] / self.chemistry.bond_force)[:, None]
        assert matrix is not None
        return np.maximum(found, 0.0), matrix

    def _condition(self, chemistry: Chemistry, load: float, temperature: float, times: np.ndarray) -> Condition:
        return make_condition(chemistry, self.contacts.at(load), temperature, times, self.grid, self.seed)

    def _linear(self, made: Condition, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, matrix = made.linear(mean)
        if made.interacting and self.calibrated:
            made.calibrate(mean, self.scene, self.seed)
            value, matrix = made.linear(mean)
        return value, matrix


def forecast_of(
    forecaster: Forecaster,
    visible: np.ndarray,
    load: QuantityLike | None,
    temperature: QuantityLike | None,
    hold_times: Sequence[float] | np.ndarray | None,
    provenance: dict[str, Any],
) -> Forecast:
    """A forecast; what is None is as in the scene."""
    scene = forecaster.scene
    newton, kelvin, times = _conditions(scene, load, temperature, hold_times)
    unique, place = np.unique(times, return_inverse=True)
    with scene.in_use():
        samples, matrix = forecaster(newton, kelvin, unique)
    density = forecaster.samples.mean(axis=0)
    parts = np.abs(matrix * density)
    unseen = parts[:, ~visible].sum(axis=1) / np.maximum(parts.sum(axis=1), 1e-300)
    notes = []
    nodes, chemistry = forecaster.grid.nodes, forecaster.chemistry
    # a site of this barrier reacts at the hold time, with the width of a step, under the largest pressure
    lowering = largest_lowering(forecaster.contacts.at(newton), chemistry)
    reached = KB * kelvin * (np.log(chemistry.attempt_frequency * unique) + 1.0) + lowering
    if reached.max() > nodes[-1]:
        at = unique[int(np.argmax(reached > nodes[-1]))]
        notes.append(
            f"from {at:.3g} s on, barriers above {nodes[-1]:.3f} eV react, beyond the energies of the inference; "
            "they are counted as never bonding, so that the prediction is a lower bound"
        )
    if unseen.max() > UNSEEN:
        worst = int(np.argmax(unseen))
        notes.append(
            f"{_when(unique, unseen > UNSEEN)}, more than {100 * UNSEEN:.0f} % of the predicted friction comes from "
            f"energies that the data do not see ({100 * unseen[worst]:.0f} % at {unique[worst]:.3g} s); that part and "
            "its band are those of the prior"
        )
    return Forecast(
        load=newton,
        temperature=kelvin,
        hold_times=times,
        samples=samples[:, place],
        unseen=float(unseen.max()),
        notes=tuple(notes),
        provenance=provenance,
    )


def _when(times: np.ndarray, over: np.ndarray) -> str:
    """The hold times (m,), ascending, that ``over`` marks, in words."""
    clear = np.flatnonzero(~over)
    if not clear.size:
        return "at all hold times"
    early = [f"up to {times[clear[0] - 1]:.3g} s"] if over[0] else []
    late = [f"from {times[clear[-1] + 1]:.3g} s on"] if over[-1] else []
    return " and ".join([*early, *late]) or "at some hold times"


def _conditions(
    scene: Scene,
    load: QuantityLike | None,
    temperature: QuantityLike | None,
    hold_times: Sequence[float] | np.ndarray | None,
) -> tuple[float, float, np.ndarray]:
    newton = scene.load if load is None else force(load)
    if not newton > 0:
        raise InputError.of("load", load, "must be above zero", "give a force such as 50 nN")
    hold = scene.hold
    kelvin = (300.0 if hold is None else hold.temperature) if temperature is None else temperature_value(temperature)
    if hold_times is None:
        hold_times = spaced(1e-3, 1e5, 4) if hold is None else hold.hold_times
    times = check_times(hold_times)
    if not (times > 0).any():
        raise InputError.of("hold_times", times.tolist(), "must have a time above zero", "nothing has aged at 0 s")
    return newton, kelvin, times[times > 0]


def ranked(
    forecaster: Forecaster,
    visible: np.ndarray,
    resolution: float,
    candidates: Sequence[Mapping[str, Any]],
    target: Mapping[str, Any] | None,
    relative_error: float,
) -> list[dict[str, Any]]:
    """The candidates by how much each reduces the variance of the target, the best first.

    Of a target g and a measurement f with the error s, the variance of g falls by cov(f, g)²/(var f + s²), if both are
    normal: the covariances are those of the samples.
    """
    if not isinstance(candidates, list | tuple) or not candidates:
        raise InputError.of("candidates", candidates, "must be a list with at least one planned measurement")
    if not 0 < relative_error < 10:
        raise InputError.of("relative_error", relative_error, "must be above zero", "3 % is 0.03")
    goals = _goals(forecaster, visible, resolution, target)
    goals = goals - goals.mean(axis=0)
    variance = goals.var(axis=0)
    total = float(variance.sum())
    if not total > 0:
        raise InputError.of("target", target, "has no variance in the samples, so that nothing can narrow it")
    conditions: dict[tuple[float, float], list[int]] = {}
    plans = [_plan(forecaster.scene, number, one, relative_error) for number, one in enumerate(candidates)]
    for number, (load, kelvin, *_) in enumerate(plans):
        conditions.setdefault((load, kelvin), []).append(number)
    found: list[dict[str, Any]] = [{} for _ in candidates]
    with forecaster.scene.in_use():
        for (load, kelvin), numbers in conditions.items():
            times = np.unique([plans[number][2] for number in numbers])
            samples, _ = forecaster(load, kelvin, times)
            for number in numbers:
                _, _, time, error, relative = plans[number]
                values = samples[:, int(np.searchsorted(times, time))]
                error = relative * float(values.mean()) if relative else error
                covariance = (values - values.mean()) @ goals / len(values)
                gain = float((covariance**2).sum() / (values.var() + error**2))
                found[number] = {
                    **candidates[number],
                    "load": load,
                    "temperature": kelvin,
                    "hold_time": time,
                    "error": error,
                    "expected": float(values.mean()),
                    "reduction": gain / total,
                    "deviation": float(np.sqrt(max(total - gain, 0.0) / goals.shape[1])),
                }
    return sorted(found, key=lambda one: -one["reduction"])


def _plan(
    scene: Scene, number: int, one: Mapping[str, Any], relative_error: float
) -> tuple[float, float, float, float, float]:
    """Load (nN), temperature (K), hold time (s), and the error in nN or relative, else 0, of a planned measurement."""
    if not isinstance(one, Mapping) or "hold_time" not in one:
        raise InputError.of(f"candidates.{number}", one, "has no hold_time", 'give {"hold_time": 10.0, "load": 50.0}')
    for name in one:
        if name not in PLAN:
            raise InputError.of(
                f"candidates.{number}", name, f"is not known{nearest(str(name), PLAN)}", f"give {', '.join(PLAN)}"
            )
    load, kelvin, times = _conditions(
        scene, one.get("load"), one.get("temperature"), [convert(one["hold_time"], "s", "hold_time")]
    )
    if (error := one.get("error")) is not None:
        share = isinstance(error, str) and error.strip().endswith("%")
        value = convert(error, "" if share else "nN", f"candidates.{number}.error")
        if not 0 < value < np.inf:
            raise InputError.of(
                f"candidates.{number}.error", error, "must be above zero", "give nN, or a text such as 3 %"
            )
        return load, kelvin, float(times[0]), 0.0 if share else value, value if share else 0.0
    return load, kelvin, float(times[0]), 0.0, relative_error


def _goals(
    forecaster: Forecaster, visible: np.ndarray, resolution: float, target: Mapping[str, Any] | None
) -> np.ndarray:
    """(S, k) what is wanted, of each sample."""
    nodes = forecaster.grid.nodes
    if target is not None and not isinstance(target, Mapping):
        raise InputError.of("target", target, "must be a dict", 'give {"energy": 1.0}, for example')
    if target is None or "energy" in target:
        mean = averaging(nodes, resolution)
        if target is None:
            return forecaster.samples @ mean[visible if visible.any() else slice(None)].T
        energy = convert(target["energy"], "eV", "target.energy")
        if not nodes[0] <= energy <= nodes[-1]:
            raise InputError.of(
                "target.energy",
                energy,
                "is outside the energies of the density",
                f"{nodes[0]:.3f} to {nodes[-1]:.3f} eV",
            )
        return forecaster.samples @ mean[[int(np.argmin(np.abs(nodes - energy)))]].T
    if "hold_time" not in target:
        raise InputError.of(
            "target", dict(target), "has neither energy nor hold_time", 'give {"energy": 1.0}, for example'
        )
    load, kelvin, times = _conditions(
        forecaster.scene,
        target.get("load"),
        target.get("temperature"),
        [convert(target["hold_time"], "s", "hold_time")],
    )
    with forecaster.scene.in_use():
        return forecaster(load, kelvin, times)[0]
