"""Model against data: how a measured curve and a result differ, with both kinds of error, and what that means."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from chemage.ageing.covariance import SMALLEST, CurveError, agreement
from chemage.ageing.fitting import UNIT
from chemage.ageing.measurements import Measurements
from chemage.foundation.quantities import NONE, Curve
from chemage.foundation.result import Comparable, Table
from chemage.foundation.text import jsonable, plus_minus, power_text

#: probability of a larger deviation by chance from which on curves agree, and below which they surely do not
AGREE, DIFFER = 0.05, 1e-3
#: relative standard error of the slope from which on the errors are too large to tell anything
TELLS_NOTHING = 0.5
#: relative difference of load or temperature (K) up to which conditions are the same
SAME = 0.005


@dataclass(frozen=True, eq=False)
class Verdict:
    """Measurements, or a result, beside a result that is the model: data = offset + slope × model."""

    #: name of what is judged
    data: str
    #: name of the result that is the model
    result: str
    #: in words
    verdict: str
    quantity: str = ""
    #: (m,) s, of the data, and of the model
    hold_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    model: np.ndarray = field(default_factory=lambda: np.zeros(0))
    #: (m,) standard errors of the data and of the model; nan where they are not known
    data_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    model_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    offset: tuple[float, float] = (math.nan, math.nan)
    slope: tuple[float, float] = (math.nan, math.nan)
    chi2: float = math.nan
    #: probability of a larger deviation by chance
    chance: float = math.nan
    #: what is judged, in words
    subject: str = "measured values"

    @property
    def residuals(self) -> np.ndarray:
        """(m,) data minus model over both errors together."""
        return (self.values - self.model) / np.hypot(
            self.data_errors, self.model_errors
        )

    def trend(self) -> str:
        """How the data differ from the model, from offset and slope."""
        (offset, offset_error), (slope, slope_error) = self.offset, self.slope
        scaled = abs(slope - 1) > 2 * slope_error
        shifted = abs(offset) > 2 * offset_error
        factor = f"{plus_minus(slope, slope_error, '')} times the model"
        side = "above" if offset > 0 else "below"
        shift = f"{plus_minus(abs(offset), offset_error, UNIT[self.quantity])} {side} it"
        if scaled and shifted:
            return f"{self.subject} are {factor} and {shift}"
        if scaled:
            return f"{self.subject} are {factor}"
        return (
            f"{self.subject} lie {shift}"
            if shifted
            else "neither an offset nor a factor between them"
        )

    def fitted(self) -> tuple[Verdict, float]:
        """The same with offset and slope of least squares, and χ² of what is left over its degrees of freedom."""
        stated = bool(np.isfinite(self.data_errors).all())
        times = self.hold_times.size
        weight = np.ones(times)
        if stated:
            weight = 1 / np.hypot(self.data_errors, self.model_errors)
        design = np.stack([np.ones(times), self.model], axis=1) * weight[:, None]
        inverse = np.linalg.pinv(design.T @ design)
        offset, slope = inverse @ design.T @ (self.values * weight)
        rest = self.values * weight - design @ (offset, slope)
        left = float(np.sum(rest**2)) / max(times - 2, 1)
        spread = np.diag(inverse) * (max(left, 1.0) if stated else left)
        first, second = np.sqrt(spread).tolist()
        line = {"offset": (float(offset), first), "slope": (float(slope), second)}
        return replace(self, **line), left

    def judged(self, covariance: np.ndarray, chance: float) -> Verdict:
        """The same with a verdict.

        Parameters
        ----------
        covariance
            (m, m) of the errors of both sides.
        chance
            Probability of a larger deviation; nan: that of χ².
        """
        from scipy.stats import chi2 as distribution

        found, left = self.fitted()
        residual, count = self.values - self.model, self.values.size
        chi2 = float(residual @ np.linalg.solve(covariance, residual))
        if math.isnan(chance):
            chance = float(distribution.sf(chi2, count))
        found = replace(found, chi2=chi2, chance=chance)
        freedom = max(count - 2, 1)
        text = found.in_words(float(distribution.sf(left * freedom, freedom)))
        if chance < AGREE and not self.model_errors.any():
            text += "; the result has no error of its own, as a single replica has none: age several"
        return replace(found, verdict=text)

    def in_words(self, fitted: float) -> str:
        """The verdict; ``fitted`` is the probability of the χ² of offset and slope."""
        slope, error = self.slope
        if self.chance >= AGREE:
            if error > TELLS_NOTHING * max(abs(slope), 1.0):
                return "the errors are too large to tell: any rise agrees"
            return "agrees within the errors"
        sure = "differs" if self.chance < DIFFER else "differs somewhat"
        if fitted >= DIFFER and (trend := self.trend()).startswith(self.subject):
            return f"{sure}: the same shape, but {trend}"
        worst = int(np.argmax(np.abs(self.residuals)))
        where = f"{self.residuals[worst]:+.1f} standard errors at {power_text(self.hold_times[worst])} s"
        larger = np.median(self.model_errors) > np.median(self.data_errors)
        largest = self.result if larger else self.data
        return f"{sure} in shape: up to {where}; the errors are mainly those of {largest}"

    def row(self) -> tuple[str, ...]:
        """Its line in a table."""
        if not self.values.size:
            return self.data, self.result, "", "", "", self.verdict
        chi2 = (
            "errors unknown"
            if math.isnan(self.chi2)
            else f"{self.chi2:.1f} of {self.values.size}"
        )
        unit = UNIT[self.quantity]
        offset = plus_minus(*self.offset, unit)
        return (
            self.data,
            self.result,
            offset,
            plus_minus(*self.slope, ""),
            chi2,
            self.verdict,
        )

    def table(self) -> Table:
        """Both kinds of error at every hold time."""
        columns = (
            "hold time (s)",
            "data",
            "its error",
            "model",
            "its error",
            "residual (both errors)",
        )
        arrays = (self.values, self.data_errors, self.model, self.model_errors)
        rows = []
        for time, *row, off in zip(
            self.hold_times, *arrays, self.residuals, strict=True
        ):
            texts = [NONE if np.isnan(x) else f"{x:.4g}" for x in row]
            rows.append(
                (f"{time:.4g}", *texts, NONE if np.isnan(off) else f"{off:+.1f}")
            )
        return Table(
            f"Residuals of {self.data} against {self.result}", columns, rows
        )

    def todict(self) -> dict[str, Any]:
        """Plain JSON values; what is not known is null."""
        return jsonable({**vars(self), "residuals": self.residuals})


COLUMNS = ("data", "model", "offset", "slope", "χ²", "verdict")


def verdict(
    data: Measurements, name: str, ageing: Comparable, curves: Mapping[str, Curve]
) -> Verdict:
    """Judge measurements beside a result, interpolated in log t at the measured hold times."""
    said = _model(data, ageing, curves)
    if isinstance(said, str):
        return Verdict(data.name, name, f"not compared: {said}")
    data, model = said
    inside = np.isfinite(model.mean)
    if inside.sum() < 3:
        return Verdict(
            data.name,
            name,
            f"not compared: only {inside.sum()} hold times in common, which needs 3",
        )
    times, values, mean = (
        array[inside] for array in (data.hold_times, data.values, model.mean)
    )
    stated = data.error is not None
    own = (
        np.full(times.size, math.nan) if data.error is None else data.error[inside]
    )
    known, places = model.known[np.ix_(inside, inside)], model.places[inside]
    noise, chance, error = np.diag(own**2) + known, math.nan, None
    if model.samples and stated:
        error, chance = agreement(model.samples, model.curve, values, noise, places)
    elif model.samples:
        error = CurveError.of(model.samples, model.curve)
    covariance = (
        known if error is None else known + places @ error.matrix() @ places.T
    )
    found = Verdict(
        data.name,
        name,
        "",
        data.quantity,
        times,
        values,
        mean,
        own,
        np.sqrt(np.diag(covariance)),
    )
    if not stated:
        found, _ = found.fitted()
        away = float(np.sqrt(np.mean((values - mean) ** 2)))
        text = f"{found.trend()}; r.m.s. difference {away:.3g} {UNIT[data.quantity]}".rstrip()
        return replace(found, verdict=f"{text}; the measurements state no errors")
    return found.judged(np.diag(own**2) + covariance, chance)


class Curved(Protocol):
    """A result whose curves are judged."""

    @property
    def name(self) -> str: ...
    @property
    def comparable(self) -> Comparable: ...
    @property
    def curves(self) -> Mapping[str, Curve]: ...


def between(one: Curved, other: Curved) -> Verdict:
    """Judge two results beside each other, ``other`` at its hold times: both have samples, of which
    :class:`CurveError` is that of the difference of their means."""
    not_compared: Callable[[str], Verdict] = partial(
        Verdict, other.name, one.name, subject="its values"
    )
    why = _elsewhere(
        other.comparable.load,
        other.comparable.chemistry.get("temperature"),
        one.comparable,
    )
    common = [
        name for name in UNIT if {name} <= one.curves.keys() & other.curves.keys()
    ]
    if why or not common:
        return not_compared(
            f"not compared: {why or 'no friction against hold time'}"
        )
    curve = other.curves[common[0]]
    positive = curve.x > 0
    model = _Model.of(one.curves[common[0]], curve.x[positive])
    theirs = _Model.of(curve, curve.x[positive])
    inside = np.isfinite(model.mean)
    if not (model.samples and theirs.samples):
        return not_compared(
            "not compared: a single replica has no error; age several"
        )
    if inside.sum() < 3:
        return not_compared(
            f"not compared: only {inside.sum()} hold times in common, which needs 3"
        )
    samples = [
        [values @ part.places[inside].T for values in part.samples]
        for part in (model, theirs)
    ]
    mean, values = model.mean[inside], theirs.mean[inside]
    counts = [len(part[0]) for part in samples]
    pooled = np.average([mean, values], axis=0, weights=counts)
    errors = [CurveError.of(part, pooled).matrix() for part in samples]
    both = CurveError.of([*samples[0], *samples[1]], pooled)
    noise = (model.known + theirs.known)[np.ix_(inside, inside)]
    noise[np.diag_indices_from(noise)] += (SMALLEST * np.abs(pooled).max()) ** 2
    chance = both.chance(values - mean, noise, np.eye(mean.size))
    own, its = (np.sqrt(np.diag(each)) for each in errors)
    found = Verdict(
        other.name,
        one.name,
        "",
        common[0],
        curve.x[positive][inside],
        values,
        mean,
        its,
        own,
        subject="its values",
    )
    return found.judged(noise + both.matrix(), chance)


class _Model(NamedTuple):
    """What a result says at the j hold times of measurements."""

    #: (j,) its values; nan where it has none
    mean: np.ndarray
    #: (j, j) covariance of its errors, but for those that its samples show
    known: np.ndarray
    #: (m,) the curve at its own hold times, and its samples, see :class:`chemage.foundation.quantities.Curve`
    curve: np.ndarray
    samples: Sequence[np.ndarray]
    #: (j, m) takes the curve to the hold times of the measurements
    places: np.ndarray

    @classmethod
    def of(cls, curve: Curve, hold_times: np.ndarray) -> _Model:
        """A curve at the hold times of measurements, linear in log t."""
        positive = curve.x > 0
        x, at = np.log(curve.x[positive]), np.log(np.maximum(hold_times, 1e-300))
        places = np.stack(
            [
                np.interp(at, x, one, left=math.nan, right=math.nan)
                for one in np.eye(x.size)
            ],
            axis=1,
        )
        # the errors that samples do not show are taken as one
        shared = places @ np.nan_to_num(curve.shared[positive])
        mean = curve.mean[positive]
        samples = [values[:, positive] for values in curve.samples]
        return cls(places @ mean, np.outer(shared, shared), mean, samples, places)


def _model(
    data: Measurements, ageing: Comparable, curves: Mapping[str, Curve]
) -> tuple[Measurements, _Model] | str:
    """The measurements in the quantity of the result, and what that says of them; or why it says nothing."""
    if ageing.predict is not None:
        if data.load is None or data.temperature is None:
            return "the table has no load and temperature at which the density would be carried forward"
        there = data.as_quantity("friction_drop", data.load)
        assert there is not None
        kept = there.hold_times > 0
        mean = np.full(kept.size, math.nan)
        covariance = np.zeros((kept.size, kept.size))
        mean[kept], covariance[np.ix_(kept, kept)] = ageing.predict(
            data.load, data.temperature, there.hold_times[kept]
        )
        return there, _Model(mean, covariance, mean, (), np.eye(mean.size))
    if why := _elsewhere(data.load, data.temperature, ageing):
        return f"measured {why}"
    for quantity in (data.quantity, *UNIT):
        load = ageing.load if np.isfinite(ageing.load) else None
        there = data.as_quantity(quantity, load)  # pyright: ignore[reportArgumentType]
        curve = curves.get(quantity)
        if there is not None and curve is not None:
            return there, _Model.of(curve, there.hold_times)
    return "the result has no friction against hold time"


def _elsewhere(
    load: float | None, temperature: float | None, ageing: Comparable
) -> str:
    """That a result is at another load or temperature, in words."""
    for own, theirs, unit in (
        (load, ageing.load, "nN"),
        (temperature, ageing.chemistry.get("temperature"), "K"),
    ):
        if own is None or theirs is None:
            continue
        if abs(own - theirs) > SAME * own:
            return f"at {own:g} {unit}, the result is at {theirs:g} {unit}"
    return ""
