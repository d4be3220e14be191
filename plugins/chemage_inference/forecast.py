"""Forecasts from samples of a density at conditions that were not measured, and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Scene
from chemage import hold_times as spaced
from chemage.plugin import (
    KB,
    Doubles,
    Plain,
    PositiveNumber,
    Record,
    algebra,
    check_times,
    convert,
    force,
    nearest,
    temperature_value,
    text,
    units,
)
from chemage_inference.energies import EnergyGrid, averaging
from chemage_inference.forward import (
    Contacts,
    check_scene,
    largest_lowering,
    make_condition,
)
from chemage_inference.problem import LOAD

#: shares of the probability that bands hold
LEVELS = (0.68, 0.90, 0.95)
#: level of the wider of the two intervals that are printed and drawn; the other is 68 %
WIDE = 0.90
#: share of a prediction from energies which the data do not see above which a note says so, and only bounds are shown
UNSEEN, BOUNDS_ONLY = 0.05, 0.8
#: values of an unknown scalar at which neighbours are simulated
FEW = 5
#: what conditions may state -> its unit, and an example
STATED = {
    "hold_time": ("s", "1e5 s"),
    "load": ("nN", "50 nN"),
    "temperature": ("K", "350 K"),
    "error": ("nN", "3 %"),
    "energy": ("eV", "1.0 eV"),
}
#: what a planned measurement, and what it is to narrow, may state
PLAN = ("hold_time", "load", "temperature", "error")
TARGET = ("energy", "load", "temperature", "hold_time")


#: what the summary of a forecast has as it is
_SUMMED = (
    *("load", "temperature", "hold_times", "friction_drop", "median"),
    *("friction_coefficient_drop", "unseen", "notes"),
)


class Forecast(Record):
    """A predicted curve of ageing with its bands: ΔF for every sample of the inferred density."""

    arrays = {
        "hold_times": (("hold_time",), "s", "hold time"),
        "samples": (
            ("sample", "hold_time"),
            "nN",
            "friction drop of each sample of the density",
        ),
    }

    load: PositiveNumber
    """nN"""
    temperature: PositiveNumber
    """K"""
    hold_times: Doubles
    """(m,) s"""
    samples: Doubles
    """(S, m) nN: ΔF of each posterior sample, the mean over disorder and noise"""
    unseen: float = 0.0
    """largest share of a predicted value that comes from energies which the data do not see"""
    notes: tuple[str, ...] = ()
    provenance: Plain = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (
            self.samples.ndim != 2
            or self.samples.shape[1] != self.hold_times.size
            or not len(self.samples)
        ):
            raise ValueError(
                f"samples: shape {self.samples.shape}; give (samples, {self.hold_times.size})"
            )
        return self

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, nN, (m,): the mean over the samples."""
        return self.samples.mean(axis=0)

    @property
    def median(self) -> np.ndarray:
        """The median of ΔF over the samples, nN, (m,): the mean of skew samples may lie outside of bands."""
        return np.median(self.samples, axis=0)

    @property
    def bounds_only(self) -> bool:
        """Whether nearly all of a prediction is unseen, so that no value within the 90 % band is more likely."""
        return self.unseen > BOUNDS_ONLY

    @property
    def friction_coefficient_drop(self) -> np.ndarray:
        """Δμ = ΔF / load, (m,)."""
        return self.friction_drop / self.load

    def band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the central band of ΔF that holds ``level`` of the probability, nN, (m,) each."""
        return band(self.samples, level)

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the values and their bands."""
        values = {name: getattr(self, name) for name in _SUMMED}
        return text.jsonable({**values, **bands(self.samples)})

    def __repr__(self) -> str:
        low, high = self.band(WIDE)
        ends = f"{low[-1]:.4g} to {high[-1]:.4g}"
        value = (
            f"{ends} nN"
            if self.bounds_only
            else f"{self.median[-1]:.4g} nN ({ends})"
        )
        return f"<Forecast {self.load:g} nN, {self.temperature:g} K: {value} at {self.hold_times[-1]:g} s>"

    __str__ = __repr__


def band(samples: np.ndarray, level: float) -> tuple[Any, Any]:
    """The ends of the central band that holds ``level`` of ``samples`` (S, n), two arrays (n,), or of (S,), numbers.

    Raises
    ------
    InputError
        ``level`` is not between 0 and 1.
    """
    if not 0 < level < 1:
        raise InputError.of(
            "level", level, "must be between 0 and 1", "95 % is 0.95"
        )
    low, high = np.quantile(samples, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    return low, high


def stated(where: str, conditions: Any, names: Sequence[str]) -> dict[str, Any]:
    """Conditions that state some of ``names``, as numbers in internal units; an error in per cent as it is.

    Raises
    ------
    InputError
        What is stated is unknown, no quantity, or not above zero.
    """
    known = ", ".join(names)
    if not isinstance(conditions, Mapping):
        raise InputError.of(
            where,
            conditions,
            f"must be a dict of {known}",
            'give {"hold_time": 10.0}, for example',
        )
    found = {}
    for name, value in conditions.items():
        if name not in names:
            raise InputError.of(
                where,
                name,
                f"is not known{nearest(str(name), names)}",
                f"give {known}",
            )
        if value is None:
            continue
        unit, example = STATED[name]
        share = name == "error" and str(value).strip().endswith("%")
        field, unit = f"{where}.{name}", "" if share else unit
        number = force(value) if name == "load" else convert(value, unit, field)
        if not 0 < number < np.inf:
            problem = "must be above zero and finite"
            raise InputError.of(field, value, problem, f"such as {example}")
        found[name] = value if share else number
    return found


def checked_target(where: str, target: Any) -> dict[str, Any]:
    """What planned measurements are to narrow: an energy, or a forecast with its hold time; empty: the density."""
    wanted = stated(where, target, TARGET)
    if wanted and (
        ("energy" in wanted) == ("hold_time" in wanted)
        or ("energy" in wanted and len(wanted) > 1)
    ):
        example = "an energy, such as 1.0 eV, or a forecast with its hold_time, such as 1e5 s"
        raise InputError.of(
            where, target, "is neither an energy nor a forecast", f"give {example}"
        )
    return wanted


def bands(samples: np.ndarray) -> dict[str, tuple[Any, Any]]:
    """The bands of all :data:`LEVELS`, for JSON."""
    return {f"band_{100 * level:.0f}": band(samples, level) for level in LEVELS}


def in_numbers(values: np.ndarray) -> dict[str, Any]:
    """A sampled number (S,), for JSON."""
    return {"mean": values.mean(), "median": np.median(values), **bands(values)}


def _in_few(values: np.ndarray) -> np.ndarray:
    """``values`` (S,), each replaced by the nearest of :data:`FEW` evenly spaced ones."""
    few = np.linspace(values.min(), values.max(), FEW)
    return few[np.abs(values[:, None] - few).argmin(axis=1)]


class Forecaster:
    """ΔF of ``rows`` of the samples of an inference at any condition; contacts are solved once."""

    def __init__(self, one: Any, scene: Scene, rows: np.ndarray) -> None:
        #: an :class:`chemage_inference.result.Inference`
        self.one, self.scene = one, scene
        self.samples = one.samples[rows]
        # the load is that of the forecast, whatever the stated ones were
        self.scalars = {
            name: values[rows]
            for name, values in one.scalars.items()
            if name != LOAD
        }
        self.chemistry = check_scene(scene)
        first, last = one.energies[[0, -1]].tolist()
        count = one.energies.size
        self.grid = EnergyGrid(first, (last - first) / (count - 1), count)
        self.contacts = Contacts(scene)

    def predicted(
        self,
        load: float,
        temperature: float,
        times: np.ndarray,
        *,
        calibrated: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(S, m) nN of each sample, and its derivative by the density, (m, n).

        ``calibrated``: neighbours are simulated, beyond their mean field.
        """
        size, seed = len(self.samples), self.one.seed
        predicted = np.empty((size, times.size))
        matrix = np.zeros((times.size, self.grid.count))
        noise = np.random.default_rng([seed, 53]).standard_normal(size)
        chemistry, scalars = self.chemistry, dict(self.scalars)
        own = np.full(size, chemistry.bond_force)
        factor = scalars.pop("bond_force", own) / own
        if chemistry.interaction is not None:  # each value is simulated
            scalars = {name: _in_few(values) for name, values in scalars.items()}
        keys = np.stack([*scalars.values(), np.zeros(size)], axis=1)
        for values in np.unique(keys, axis=0):
            here = (keys == values).all(axis=1)
            changed = dict(zip(scalars, values.tolist(), strict=False))
            condition = make_condition(
                chemistry.replace(**changed),
                self.contacts.at(load),
                temperature,
                times,
                self.grid,
                seed,
            )
            mean = self.samples[here].mean(axis=0)
            if calibrated:
                condition.calibrate(mean, self.scene, seed)
            value, matrix = condition.linear(mean)
            part = value + algebra.product(self.samples[here] - mean, matrix.T)
            scatter = noise[here, None] * condition.correction_error
            predicted[here] = part * (1 + scatter / condition.correction)
        return np.maximum(predicted * factor[:, None], 0.0), matrix

    def conditions(
        self,
        load: units.QuantityLike | None,
        temperature: units.QuantityLike | None,
        hold_times: Sequence[float] | np.ndarray | None,
    ) -> tuple[float, float, np.ndarray]:
        """Load (nN), temperature (K) and hold times above zero (s); what is None is as in the scene."""
        newton = (
            self.scene.given_load("a forecast") if load is None else force(load)
        )
        if not newton > 0:
            raise InputError.of(
                "load", load, "must be above zero", "give a force such as 50 nN"
            )
        hold = self.scene.hold
        kelvin = 300.0 if hold is None else hold.temperature
        if temperature is not None:
            kelvin = temperature_value(temperature)
        if hold_times is None:
            hold_times = spaced(1e-3, 1e5, 4) if hold is None else hold.hold_times
        times = check_times(hold_times)
        if not (times > 0).any():
            problem, why = "must have a time above zero", "nothing has aged at 0 s"
            raise InputError.of("hold_times", times.tolist(), problem, why)
        return newton, kelvin, times[times > 0]

    def forecast(self, newton: float, kelvin: float, times: np.ndarray) -> Forecast:
        """A forecast at a load (nN), a temperature (K) and hold times (s)."""
        unique, place = np.unique(times, return_inverse=True)
        with self.scene.in_use():
            samples, matrix = self.predicted(
                newton, kelvin, unique, calibrated=True
            )
        parts = np.abs(matrix * self.samples.mean(axis=0))
        hidden = parts[:, ~self.one.visible].sum(axis=1)
        unseen = hidden / np.maximum(parts.sum(axis=1), 1e-300)
        notes = []
        last, chemistry = float(self.grid.nodes[-1]), self.chemistry
        # a site of this barrier reacts at the hold time, with the width of a step, under the largest pressure
        steps = np.log(chemistry.attempt_frequency * unique) + 1.0
        lowering = largest_lowering(self.contacts.at(newton), chemistry)
        beyond = KB * kelvin * steps + lowering > last
        if beyond.any():
            notes.append(
                f"from {unique[beyond.argmax()]:.3g} s on, barriers above {last:.3f} eV react, beyond "
                "the energies of the inference; they are counted as never bonding, so that the prediction is a lower "
                "bound"
            )
        worst = unseen.argmax()
        if unseen[worst] > UNSEEN:
            notes.append(
                f"{_when(unique, unseen > UNSEEN)}, more than {100 * UNSEEN:.0f} % of the predicted friction comes "
                f"from energies that the data do not see ({100 * unseen[worst]:.0f} % at {unique[worst]:.3g} s); that "
                "part and its band are those of the prior"
            )
        return Forecast(
            load=newton,
            temperature=kelvin,
            hold_times=times,
            samples=samples[:, place],
            unseen=float(unseen[worst]),
            notes=tuple(notes),
            provenance={
                "scene": self.scene.todict(),
                "versions": self.one.provenance.get("versions", {}),
                "seed": self.one.seed,
            },
        )

    def ranked(
        self,
        candidates: Sequence[Mapping[str, Any]],
        target: Mapping[str, Any] | None,
        relative_error: float,
    ) -> list[dict[str, Any]]:
        """The candidates by how much each reduces the variance of the target, the best first.

        Of a target g and a measurement f with the error s, the variance of g falls by cov(f, g)²/(var f + s²), if both
        are normal: the covariances are those of the samples.
        """
        if not isinstance(candidates, list | tuple) or not candidates:
            problem = "must be a list with at least one planned measurement"
            raise InputError.of("candidates", candidates, problem)
        if not 0 < relative_error < 10:
            problem, remedy = "must be above zero", "3 % is 0.03"
            raise InputError.of("relative_error", relative_error, problem, remedy)
        goals = self._goals(target)
        goals = goals - goals.mean(axis=0)
        total = float(goals.var(axis=0).sum())
        if not total > 0:
            problem = (
                "has no variance in the samples, so that nothing can narrow it"
            )
            raise InputError.of("target", target, problem)
        rows = []
        for number, candidate in enumerate(candidates):
            where = f"candidates.{number}"
            plan = stated(where, candidate, PLAN)
            if "hold_time" not in plan:
                remedy = 'give {"hold_time": 10.0, "load": 50.0}'
                raise InputError.of(where, candidate, "has no hold_time", remedy)
            error = {"error": plan.get("error", str(relative_error))}
            rows.append({**candidate, **self._at(plan), **error})
        for values, row in zip(self._expected(rows), rows, strict=True):
            row["expected"] = float(values.mean())
            if isinstance(row["error"], str):  # a share
                row["error"] = convert(row["error"], "") * row["expected"]
            covariance = algebra.product(values - row["expected"], goals)
            squares = float(((covariance / len(values)) ** 2).sum())
            gain = squares / float(values.var() + row["error"] ** 2)
            row["reduction"] = gain / total
            left = max(total - gain, 0.0) / goals.shape[1]
            row["deviation"] = float(np.sqrt(left))
        return sorted(rows, key=lambda row: -row["reduction"])

    def _at(self, plan: Mapping[str, Any]) -> dict[str, float]:
        """Load (nN), temperature (K) and hold time (s) of a plan or target."""
        load, kelvin, (time,) = self.conditions(
            plan.get("load"), plan.get("temperature"), [plan["hold_time"]]
        )
        return {"load": load, "temperature": kelvin, "hold_time": float(time)}

    def _expected(self, plans: Sequence[Mapping[str, Any]]) -> np.ndarray:
        """(k, S) nN: what the samples predict of plans that :meth:`_at` has completed."""
        values = np.empty((len(plans), len(self.samples)))
        conditions = [(plan["load"], plan["temperature"]) for plan in plans]
        for one in dict.fromkeys(conditions):
            here = [at for at, other in enumerate(conditions) if other == one]
            every = [plans[at]["hold_time"] for at in here]
            times, place = np.unique(every, return_inverse=True)
            with self.scene.in_use():
                predicted, _ = self.predicted(*one, times)
            values[here] = predicted.T[place]
        return values

    def _goals(self, target: Mapping[str, Any] | None) -> np.ndarray:
        """(S, k) what is wanted, of each sample."""
        one, nodes = self.one, self.grid.nodes
        wanted = checked_target("target", target or {})
        if "hold_time" in wanted:
            return self._expected([self._at(wanted)]).T
        chosen = one.visible if one.visible.any() else slice(None)
        if wanted:
            energy = wanted["energy"]
            if not nodes[0] <= energy <= nodes[-1]:
                problem = "is outside the energies of the density"
                remedy = f"{nodes[0]:.3f} to {nodes[-1]:.3f} eV"
                raise InputError.of("target.energy", energy, problem, remedy)
            chosen = [np.abs(nodes - energy).argmin()]
        mean = averaging(nodes, one.resolution)
        return algebra.product(self.samples, mean[chosen].T)


def _when(times: np.ndarray, over: np.ndarray) -> str:
    """The hold times (m,), ascending, that ``over`` marks, in words."""
    clear = np.flatnonzero(~over)
    if not clear.size:
        return "at all hold times"
    early = [f"up to {times[clear[0] - 1]:.3g} s"] if over[0] else []
    late = [f"from {times[clear[-1] + 1]:.3g} s on"] if over[-1] else []
    return " and ".join([*early, *late]) or "at some hold times"
