"""The result of an inference: the density of barriers with its bands, and what follows from it.

:class:`InferenceResult` is what ``chemage infer`` stores; :class:`UnexplainedError` says that there is no density.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Scene, load_scene, parse_scene, prefer_plugins
from chemage.plugin import (
    Doubles,
    Flags,
    Indices,
    Named,
    Plain,
    Quantity,
    Rank,
    Record,
    StoreError,
    checked_count,
    container,
    text,
    units,
)
from chemage_inference.critic import Critic
from chemage_inference.curves import MeasuredCurve
from chemage_inference.forecast import (
    WIDE,
    Forecast,
    Forecaster,
    band,
    bands,
    in_numbers,
)
from chemage_inference.noise import SUSPECT
from chemage_inference.open import datatree, statistics
from chemage_inference.problem import UNITS

#: the unit of a pure number
ONE = "1"
#: forecasts that one file can hold
MOST_FORECASTS = 100
#: effective samples below which, and R-hat above which, chains have not converged
FEW, APART = 100, 1.05
#: scores that are lower by more exclude a model: it is probable to less than one in a hundred
EXCLUDED = 5.0


class UnexplainedError(InputError):
    """No non-negative density of barriers explains the data; carries the density that comes closest."""

    def __init__(
        self,
        message: str,
        *,
        energies: np.ndarray,
        density: np.ndarray,
        fitted: np.ndarray,
        residuals: np.ndarray,
        chi2: float,
    ) -> None:
        super().__init__(message)
        #: (n,) eV, and (n,) 1/eV: the non-negative density of least χ²
        self.energies, self.density = energies, density
        #: (m,) nN, and (m,) (measured − fitted)/error
        self.fitted, self.residuals = fitted, residuals
        self.chi2 = chi2


class Inference(Record):
    """A density of forming barriers inferred from measured curves of ageing.

    The density is a density over all reactive sites in contact: its integral over the energies is at most 1, and what
    is missing to 1 lies at energies above the last. It is piecewise linear between ``energies``.
    """

    arrays = {
        "energies": (
            ("energy",),
            "eV",
            "forming barrier without pressure and without bonded neighbours",
        ),
        "samples": (
            ("sample", "energy"),
            "1/eV",
            "density of each posterior sample",
        ),
        "prior": (
            ("prior_sample", "energy"),
            "1/eV",
            "density of each sample of the prior",
        ),
        "visible": (("energy",), "", "whether the data see this energy"),
        "curve": (("point",), "", "number of the measured curve, from 0"),
        "hold_times": (("point",), "s", "hold time"),
        "values": (("point",), "nN", "measured friction drop"),
        "errors": (
            ("point",),
            "nN",
            "standard error of the measured friction drop, as inferred",
        ),
        "stated_errors": (
            ("point",),
            "nN",
            "standard error of the measured friction drop, as stated",
        ),
        "off": (
            ("point",),
            "",
            "probability that the point is off by more than its error",
        ),
        "near": (
            ("point",),
            "",
            "correlation of the error with that of the point before",
        ),
        "fitted": (
            ("sample", "point"),
            "nN",
            "friction drop of each posterior sample",
        ),
        "prior_fitted": (
            ("prior_sample", "point"),
            "nN",
            "friction drop of each sample of the prior",
        ),
    }

    added = ("near",)

    energies: Doubles
    """(n,) eV, ascending"""
    samples: Doubles
    """(S, n) 1/eV, samples of the posterior"""
    prior: Doubles
    """(P, n) 1/eV, samples of the prior"""
    visible: Flags
    """(n,) the energies that the data see: some hold times are before and some after a site of this barrier reacts, and
    the band is narrower than that of the prior"""
    curve: Indices
    """(m,) number of the curve of each point"""
    hold_times: Doubles
    """(m,) s"""
    values: Doubles
    """(m,) measured ΔF, nN"""
    errors: Doubles
    """(m,) its standard errors, nN: the stated ones times their inferred scale"""
    stated_errors: Doubles
    """(m,) the standard errors as stated, with that of the forward model, nN"""
    off: Doubles
    """(m,) probability that a point is off, by far more than its error"""
    near: Doubles | None = None
    """(m,) correlation of the error of each point with that of the point before, 0 at the first of a curve; None: errors
    are independent"""
    error_terms: Named = {}
    """what was inferred of the errors -> (S,): ``scale N`` of the stated errors of curve N, ``correlation time``
    (e-folds of the hold time), ``calibration`` (measured over true friction), ``drift`` (change of its logarithm per
    decade of the hold time), ``offset`` (nN), ``sites under N nN`` (in contact, over those of a smooth model)"""
    fitted: Doubles
    """(S, m) ΔF of each posterior sample as it would be measured, with calibration, drift and offset, nN"""
    prior_fitted: Doubles
    """(P, m) ΔF of each sample of the prior of the density, with scalars of the posterior, nN"""
    curves: tuple[Plain, ...]
    """of each curve: ``name``, ``load`` (nN), ``temperature`` (K), ``quantity``, ``instrument``"""
    scalars: Named = {}
    """name of an unknown -> (S,) its posterior samples, in its unit"""
    scalar_bounds: dict[str, tuple[float, float]] = {}
    """the same names -> lower and upper bound of its prior"""
    scores: dict[str, float] = {}
    """family -> sum of its log predictive densities of hold times that were left out; "density" is the smooth one"""
    families: dict[str, Plain] = {}
    """parametric family -> ``parameters`` (name -> value), ``errors`` (name -> standard error), ``chi2``,
    ``density`` (at the energies)"""
    chi2: float
    """χ² of the mean of the posterior"""
    effective_parameters: float
    """effective number of parameters: mean χ² of the samples minus χ² of their mean"""
    resolution: float
    """eV: width of the range of barriers that react about one hold time, 2.45 k_BT at the highest temperature"""
    diagnostics: Plain = {}
    """``effective_samples`` (least over the energies between the hold times), ``r_hat`` (largest), ``sweeps`` of each
    of the ``chains``, ``iterations`` of the interaction with the ``changes`` of the density at each, ``cpu_seconds``"""
    seed: int = 0
    notes: tuple[str, ...] = ()
    """what the user should know, in words"""
    provenance: Plain = {}
    """``scene``, ``versions``, ``unknown``, ``cite``"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        n, m = self.energies.size, self.hold_times.size
        for name, width in (
            ("samples", n),
            ("prior", n),
            ("fitted", m),
            ("prior_fitted", m),
        ):
            array = getattr(self, name)
            if array.ndim != 2 or array.shape[1] != width:
                raise ValueError(
                    f"{name}: shape {array.shape}; give (samples, {width})"
                )
        if self.visible.shape != (n,) or self.curve.shape != (m,):
            raise ValueError(
                "visible and curve: give one for each energy, and one for each point"
            )
        return self

    @cached_property
    def density(self) -> np.ndarray:
        """(n,) 1/eV: the mean of the posterior."""
        return self.samples.mean(axis=0)

    def band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the central band of the density that holds ``level``, 1/eV, (n,) each."""
        return band(self.samples, level)

    def prior_band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """The same of the prior: where it is as wide as :meth:`band`, the data tell nothing."""
        return band(self.prior, level)

    @property
    def visible_range(self) -> tuple[float, float]:
        """Lowest and highest visible energy, eV; nan where there is none."""
        seen = self.energies[self.visible]
        return (float(seen[0]), float(seen[-1])) if seen.size else (np.nan, np.nan)

    @property
    def converged(self) -> bool:
        """Whether the chains agree, and bands are those of the posterior."""
        effective, r_hat = (
            self.diagnostics[name] for name in ("effective_samples", "r_hat")
        )
        return effective >= FEW and r_hat <= APART

    @property
    def residuals(self) -> np.ndarray:
        """(m,) measured minus mean of the fitted, over the standard error."""
        return (self.values - self.fitted.mean(axis=0)) / self.errors

    def statistics(self) -> dict[str, dict[str, np.ndarray]]:
        """Of everything that was sampled: ``mean``, ``sd``, ``ess_bulk`` and ``r_hat`` of the samples that are kept.

        Vehtari et al., Bayesian Anal. 16, 667 (2021), as ArviZ 1 has them.
        """
        return statistics(self)

    def datatree(self) -> Any:
        """An xarray.DataTree with the groups that ArviZ 1 reads: ``az.summary(found.datatree())``."""
        return datatree(self)

    def possible_families(self) -> dict[str, Mapping[str, Any]]:
        """The families that left-out hold times do not exclude: name -> fit."""
        best = max(self.scores.values(), default=0.0)
        return {
            name: fit
            for name, fit in self.families.items()
            if best - self.scores.get(name, best) <= EXCLUDED
        }

    @property
    def is_suspect(self) -> np.ndarray:
        """(m,) whether a point is probably off."""
        return self.off > SUSPECT

    def suspects(self) -> list[str]:
        """The points that are probably off, in words."""
        words = "{:.3g} s of {} ({:+.1f} standard errors, probability {:.2f})"
        return [
            words.format(
                self.hold_times[at],
                self.curves[self.curve[at]]["name"],
                self.residuals[at],
                self.off[at],
            )
            for at in np.flatnonzero(self.is_suspect)
        ]

    @property
    def scene(self) -> Scene:
        """The scene that says everything but the density."""
        with (
            prefer_plugins()
        ):  # what is stored does not depend on what is preferred now
            return parse_scene(
                self.provenance["scene"], "the scene of this inference"
            )

    @property
    def measured(self) -> tuple[MeasuredCurve, ...]:
        """The measured curves, as ΔF."""
        curves = []
        for number, about in enumerate(self.curves):
            here = self.curve == number
            own = {
                "quantity": "friction_drop",
                "hold_times": self.hold_times[here],
                "values": self.values[here],
                "errors": self.errors[here],
                "correlation": None if self.near is None else self.near[here],
            }
            curves.append(MeasuredCurve(**{**about, **own}))
        return tuple(curves)

    @cached_property
    def critic(self) -> Critic:
        """What the residuals say: which undeclared trouble is likely, and which would go unnoticed."""
        return Critic(self)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Interval of a scalar unknown.

        Raises
        ------
        InputError
            It was not among the unknowns.
        """
        if name not in self.scalars:
            raise InputError.of(
                "name",
                name,
                f"was not inferred; there are {', '.join(self.scalars) or 'none'}",
            )
        return band(self.scalars[name], level)

    def members(self, count: int, seed: int = 0) -> np.ndarray:
        """``count`` different samples of the density drawn at random, (count, n) 1/eV, for an ensemble of tables.

        Sites whose barriers lie above the last energy, 1 minus the integral of a row, never bond within the hold times.
        """
        if not 1 <= count <= len(self.samples):
            raise InputError.of(
                "count",
                count,
                f"there are {len(self.samples)} samples",
                "ask for fewer",
            )
        return self.samples[
            np.sort(
                np.random.default_rng(seed).permutation(len(self.samples))[:count]
            )
        ]

    def forecast(
        self,
        *,
        load: units.QuantityLike | None = None,
        temperature: units.QuantityLike | None = None,
        hold_times: Sequence[float] | np.ndarray | None = None,
        scene: Scene | str | Path | Mapping[str, Any] | None = None,
        samples: int = 400,
    ) -> Forecast:
        """Predict ΔF at other conditions, with bands.

        Parameters
        ----------
        load, temperature, hold_times
            Default: as in the scene.
        scene
            Another surface or tip with the same chemistry; default: the scene of this inference. Its ``[forming]`` is
            not used.
        samples
            Posterior samples that are carried on.
        """
        there = self.scene if scene is None else load_scene(scene)
        rows = self._rows(checked_count("samples", samples))
        forecaster = Forecaster(self, there, rows)
        asked = forecaster.conditions(load, temperature, hold_times)
        made = forecaster.forecast(*asked)
        notes = self.critic.of_forecast(made.hold_times, made.samples, rows)
        return made.model_copy(update={"notes": (*made.notes, *notes)})

    def next_experiment(
        self,
        candidates: Sequence[Mapping[str, Any]],
        *,
        target: Mapping[str, Any] | None = None,
        relative_error: float = 0.03,
    ) -> list[dict[str, Any]]:
        """Rank planned measurements by how much each narrows what is wanted, the best first.

        Parameters
        ----------
        candidates
            Of each: ``hold_time`` (s), and ``load`` and ``temperature`` where they differ from the scene; optionally
            ``error`` (nN, or a text with %).
        target
            What is wanted: ``{"energy": 1.0}``, the density there (averaged over the resolution);
            ``{"load": ..., "temperature": ..., "hold_time": ...}``, a forecast; default: the density, all visible
            energies alike.
        relative_error
            Standard error of a candidate over its value, where it states none.

        Returns
        -------
        list of dict
            The candidates, each with ``reduction`` (expected reduction of the variance of the target, as a share of it)
            and ``deviation`` (standard deviation of the target afterwards).
        """
        forecaster = Forecaster(self, self.scene, self._rows(1000))
        return forecaster.ranked(candidates, target, relative_error)

    def _rows(self, count: int) -> np.ndarray:
        """Numbers of up to ``count`` samples, evenly spaced."""
        last = len(self.samples) - 1
        return np.linspace(0, last, min(count, last + 1)).astype(int)

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the density, its bands, the scalars, scores and diagnostics."""
        families = {
            name: {key: value for key, value in fit.items() if key != "density"}
            for name, fit in self.families.items()
        }
        scalars, errors = (
            {name: in_numbers(values) for name, values in each.items()}
            for each in (self.scalars, self.error_terms)
        )
        return text.jsonable(
            {
                **{name: getattr(self, name) for name in _SUMMED},
                **bands(self.samples),
                "scalars": scalars,
                "errors": errors,
                "suspects": self.suspects(),
                "families": families,
                "points": self.hold_times.size,
                "versions": self.provenance.get("versions", {}),
            }
        )

    def __repr__(self) -> str:
        low, high = self.visible_range
        return f"<Inference of {self.hold_times.size} points, visible from {low:.3g} to {high:.3g} eV, χ² {self.chi2:.3g}>"

    __str__ = __repr__


#: what a summary has as it is
_SUMMED = (
    *("energies", "density", "visible", "visible_range", "resolution", "scores"),
    *("chi2", "effective_parameters", "residuals", "curves", "diagnostics", "seed"),
    *("notes", "plugins"),
)


#: units of what was inferred beside the density, but for pure numbers
_UNITS = {
    "correlation time": "e-folds of the hold time",
    "drift": "per decade",
    "offset": "nN",
    **{name: unit for name, (unit, _) in UNITS.items()},
}


def quantities(one: Inference) -> list[Quantity]:
    """χ² and parameters, and what was sampled beside the density."""
    first: Any = {"of": f"of {one.hold_times.size} points", "rank": Rank.FIRST}
    fixed = Quantity("effective_parameters", ONE, "effective parameters", **first)
    found = [
        Quantity("chi2", ONE, "χ²", value=one.chi2, **first),
        fixed.but(value=one.effective_parameters),
    ]
    scales = {
        f"scale {number}": f"errors of {about['name']} over the stated ones"
        for number, about in enumerate(one.curves)
    }
    for name, values in {**one.error_terms, **one.scalars}.items():
        bounds = one.scalar_bounds.get(name)
        prior = "(prior {:.3g} to {:.3g})".format(*bounds) if bounds else ""
        unit = _UNITS.get(name.partition(" of ")[0], ONE)
        label = scales.get(name, name.replace("_", " "))
        each = Quantity(name, unit, label, of=prior)
        found.append(sampled_quantity(each, values))
    return found


def sampled_quantity(one: Quantity, values: np.ndarray) -> Quantity:
    """The median of samples (S,), with the interval that is printed."""
    with_value = one.but(
        value=float(np.median(values)), stated="ends", level=round(100 * WIDE)
    )
    return with_value.within(*band(values, WIDE), float(values.std()))


#: group of a file of ``chemage infer`` -> class
_PARTS: dict[str, type[Record]] = {
    f"forecast_{number}": Forecast for number in range(1, MOST_FORECASTS + 1)
}
_PARTS["inference"] = Inference


@dataclass(frozen=True)
class InferenceResult:
    """An inference with what was asked of it."""

    inference: Inference
    #: label, as it was asked for -> forecast
    forecasts: Mapping[str, Forecast] = field(default_factory=dict)
    #: planned measurements, the best first; see :meth:`Inference.next_experiment`
    experiments: tuple[dict[str, Any], ...] = ()
    #: what they are to narrow, in words
    target: str = ""

    def write(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write it with its forecasts and planned measurements.

        Raises
        ------
        StoreError
            ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
        """
        asked = {
            "labels": list(self.forecasts),
            "experiments": list(self.experiments),
            "target": self.target,
        }
        parts: dict[str, Record] = {"inference": self.inference}
        for number, forecast in enumerate(self.forecasts.values(), 1):
            parts[f"forecast_{number}"] = forecast
        container.write(path, parts, {"asked": json.dumps(asked)}, force=force)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> InferenceResult:
        """The inverse of :meth:`write`; of a file with an inference alone, that.

        Raises
        ------
        StoreError
            The file is missing, damaged, or holds no inference.
        """
        parts, attributes = container.read(path, _PARTS)
        inference = parts.pop("inference", None)
        if inference is None:
            raise StoreError(
                f"{path} holds no inference; `chemage infer` makes such files"
            )
        with container.decoding(path, "what was asked of the inference"):
            asked = json.loads(attributes.get("asked", "{}"))
            labels = asked.get("labels", [])
            experiments = tuple(asked.get("experiments", ()))
            target = str(asked.get("target", ""))
            forecasts = dict(zip(labels, parts.values(), strict=True))
        return cls(inference, forecasts, experiments, target)

    def summary(self) -> dict[str, Any]:
        """One JSON-able object."""
        forecasts = [
            {"label": label, **forecast.summary()}
            for label, forecast in self.forecasts.items()
        ]
        rest = {
            "forecasts": forecasts,
            "experiments": list(self.experiments),
            "target": self.target,
        }
        return {**self.inference.summary(), **text.jsonable(rest)}
