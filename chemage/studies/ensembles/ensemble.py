"""The result of an ensemble: means over random surfaces with intervals, and what their errors are due to."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import model_validator

from chemage.ageing.fitting import (
    BETA,
    DROPS,
    LN10,
    RMS_RESIDUAL,
    SLOPE_FROM,
    SLOPE_TO,
    B,
    Fit,
    FitData,
    Friction,
    fit_ageing,
    why_not_fitted,
)
from chemage.contacts.solution import MEASURES
from chemage.foundation.codec import dataset, frame
from chemage.foundation.outputs import RECORDED, Output
from chemage.foundation.quantities import (
    HOLD_TIME,
    ONE,
    Curve,
    ErrorPart,
    Quantity,
    Rank,
    by_name,
)
from chemage.foundation.records import Doubles, Named, Number, Plain, Record
from chemage.foundation.result import draw_result, notebook_html
from chemage.foundation.steadiness import judged
from chemage.foundation.text import approximations_in_words
from chemage.scene.scene import heading
from chemage.studies.ensembles.quantities import (
    Quantities,
    Spread,
    half_width,
    regressed,
)

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: relative differences that rounding makes
EXACT = 1e-12
#: name of an error -> what it is due to, in words
SOURCES = {
    "surfaces": "scatter between surfaces",
    "replicas": "scatter between replicas on one surface",
    "surfaces and replicas": "scatter between surfaces, each with its own replica",
    "discretisation": "grid of the contact",
    "settings": "settings other than those of the scene",
    "approximation": "approximate methods",
    "barriers": "distributions of barriers that the same data allow",
    "measurement": "what the image does not show",
}


class Ensemble(Record):
    """Samples of a scene on many surfaces, and the means over all surfaces that they give.

    The mean is a sum over levels: of the cheapest computation over many surfaces, and of the difference between a
    better and a cheaper one over few. Where a control was used, the first level is regressed on it
    (:mod:`chemage.studies.ensembles.quantities`).
    """

    arrays = {
        "hold_times": (("hold_time",), "s", "time since the contact was made")
    }
    stored_names = {"hold_times": "hold_time"}

    hold_times: Doubles
    """(m,) s"""
    load: Number
    """nN"""
    window: tuple[float, float]
    """hold times of the fit of β, s"""
    measures: tuple[str, ...] = ()
    """measures of the contact, in the order of the columns"""
    outputs: dict[str, Plain] = {}
    """what was recorded, without ``observable.``: name -> dims, unit, description and rests, see
    :class:`chemage.plugin.Output`"""
    levels: tuple[Plain, ...]
    """of each level: ``words``, ``replicas``, ``samples``, ``cpu_seconds`` (of a sample, as estimated before),
    ``variance_of`` (samples in the variance of the interval), ``freedom`` (its degrees of freedom), ``random`` (another
    surface for each sample) and ``seeds`` (those of surface and hold of the first samples); the last may be a
    ``control``"""
    rows: Named
    """number of a level -> (samples, quantities): β per decade if it can be fitted, ΔF in nN at each hold time,
    measures of the contact; of a control (samples, 1): the area fraction of the contact of a sketch, of the surfaces of
    the first level and of more"""
    within: Named = {}
    """"variance" (quantities,) between replicas on one surface, where some samples have several"""
    known: Named = {}
    """name of an error -> (quantities,) relative standard errors known before; nan: not known"""
    known_how: dict[str, str] = {}
    """the same names -> how they are known, in words"""
    goals: dict[str, float] = {}
    """what was asked: quantity -> relative half width"""
    stopped: str = ""
    """why sampling ended, in words"""
    notes: tuple[str, ...] = ()
    """what the user should know of it, in words"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.levels) != len(self.rows) or not self.levels:
            raise ValueError(
                f"rows: {len(self.rows)} levels of samples, but {len(self.levels)} are described"
            )
        for number in range(len(self.levels)):
            rows, last = self.rows.get(str(number)), number == len(self.levels) - 1
            count = (
                1 if number and last and self.controlled else self.quantities.count
            )
            if (
                rows is None
                or rows.ndim != 2
                or rows.shape[1] != count
                or len(rows) < 2
            ):
                raise ValueError(
                    f"rows: level {number} must have two samples at least, {count} numbers"
                )
        if self.controlled and len(self.rows[str(len(self.levels) - 1)]) < len(
            self.rows["0"]
        ):
            raise ValueError(
                "rows: the control has fewer samples than the first level"
            )
        return self

    def declared(self, name: str) -> tuple[tuple[str, ...], str, str] | None:
        """See :meth:`Record.declared`."""
        field_name, _, key = name.partition("/")
        if field_name == "rows":
            if self.controlled and key == str(len(self.levels) - 1):
                return (
                    (f"sample_{key}", "control"),
                    "1",
                    "area fraction of the contact of a sketch",
                )
            return (
                (f"sample_{key}", "quantity"),
                "",
                "β per decade, friction drop (nN), measures of the contact",
            )
        if field_name in ("within", "known"):
            return ("quantity",), "", ""
        return super().declared(name)

    @property
    def quantities(self) -> Quantities:
        """What the columns of the rows are."""
        return Quantities(self.hold_times, self.load, self.window, self.measures)

    @property
    def surfaces(self) -> int:
        """Surfaces of the first level."""
        return len(self.rows["0"])

    @cached_property
    def _spreads(self) -> list[Spread]:
        spreads = []
        for number, (level, rows) in enumerate(
            zip(self.levels, self._terms, strict=True)
        ):
            chosen = int(level.get("variance_of", len(rows)))
            freedom = int(level.get("freedom", chosen - 1))
            spreads.append(
                Spread.of(rows, chosen, freedom, self.controlled and not number)
            )
        return spreads

    @property
    def controlled(self) -> bool:
        """Whether the last level is a control."""
        return len(self.levels) > 1 and bool(self.levels[-1].get("control", False))

    @cached_property
    def mean(self) -> np.ndarray:
        """(quantities,) the estimates of all quantities."""
        return np.sum([rows.mean(axis=0) for rows in self._terms], axis=0)

    @cached_property
    def _terms(self) -> list[np.ndarray]:
        """(samples, quantities) of each level: independent samples, whose means add up to the mean."""
        rows = [self.rows[str(number)] for number in range(len(self.levels))]
        return regressed(rows) if self.controlled else rows

    def fit_data(self, quantity: Friction | None = None) -> FitData:
        """The curves of the surfaces of the first level, about the mean, for :func:`chemage.fit_ageing`."""
        curves = self._terms[0][:, self.quantities.curve]
        about = curves - curves.mean(axis=0) + self.mean[self.quantities.curve]
        drop = quantity or "friction_coefficient_drop"
        scale = 1 / self.load if drop == "friction_coefficient_drop" else 1.0
        return FitData(about, drop, scale, simulated=True)

    @cached_property
    def line(self) -> Fit | None:
        """The line of β through the mean curve, which says whether the curve is one; None where β cannot be fitted."""
        return (
            fit_ageing(self, window=self.window)
            if self.quantities.has_beta
            else None
        )

    @property
    def every_note(self) -> list[str]:
        """The notes, and those of β."""
        of_line = () if self.line is None else self.line.notes
        return list(dict.fromkeys((*self.notes, *of_line)))

    @cached_property
    def half_widths(self) -> np.ndarray:
        """(quantities,) half the widths of their 95 % intervals."""
        return half_width(
            self._spreads, [len(rows) for rows in self._terms], self._known
        )

    @property
    def _known(self) -> np.ndarray:
        """(quantities,) standard errors that are known before."""
        errors = [np.abs(self.mean) * relative for relative in self.known.values()]
        return (
            np.sqrt(np.sum([error**2 for error in errors], axis=0))
            if errors
            else np.zeros(self.quantities.count)
        )

    def estimate(self, name: str, time: float | None = None) -> Quantity:
        """The mean of a quantity over surfaces; of a curve at a hold time (s), by default the last.

        Raises
        ------
        InputError
            There is no such quantity, or no such hold time.
        """
        column = self.quantities.column(name, time)
        if name in self._measured:
            return self._measured[name]
        if name not in DROPS:
            return self._estimate(self.quantities.declared(name), column)
        at = self.hold_times[column - self.quantities.curve.start]
        return self._estimate(self.quantities.declared(name), column).but(
            of=f"at {at:g} s"
        )

    @cached_property
    def _measured(self) -> dict[str, Quantity]:
        """Recorded numbers by name, with what is wrong with those that rest on means over a window."""
        found, rests = {}, {}
        for name in (name for name in self.measures if name.startswith(RECORDED)):
            output = Output(**self.outputs.get(name.removeprefix(RECORDED), {}))
            declared = self.quantities.declared(name).but(unit=output.unit or ONE)
            declared = declared.but(label=output.description or declared.label)
            found[name] = self._estimate(declared, self.quantities.column(name))
            if output.rests:
                rests[name] = [f"{RECORDED}{mean}" for mean in output.rests]
        replicas = int(self.levels[0].get("replicas", 1))
        return judged(found, rests, self.surfaces * replicas)

    def _estimate(
        self, declared: Quantity, column: int, scale: float = 1.0
    ) -> Quantity:
        scale = (
            scale / self.load
            if declared.name == "friction_coefficient_drop"
            else scale
        )
        parts = {
            name: ErrorPart(scale * part.size, part.how)
            for name, part in self._parts(column).items()
        }
        half = float(self.half_widths[column]) * scale
        stderr = math.hypot(*(part.size for part in parts.values()))
        value = float(self.mean[column]) * scale
        reason = ""
        if half <= EXACT * abs(value) or not any(
            part.size != 0 for part in parts.values()
        ):
            reason = "the same in all samples"
        elif math.isnan(half):
            unknown = [
                SOURCES.get(name, name)
                for name, part in parts.items()
                if math.isnan(part.size)
            ]
            reason = ": ".join(["interval not known", *unknown])
        reason = "; ".join(filter(None, (reason, declared.reason)))
        return declared.but(value=value).between(
            half, stderr, errors=parts, reason=reason
        )

    def _parts(self, column: int) -> dict[str, ErrorPart]:
        """The parts of the error of a column: standard errors."""
        spreads, rows = self._spreads, self._terms
        first, count = float(spreads[0].variance[column]), len(rows[0])
        # of the mean of the control
        more = (
            float(spreads[-1].variance[column]) / len(rows[-1])
            if self.controlled
            else 0.0
        )
        replicas = max(1, int(self.levels[0].get("replicas", 1)))
        how = (
            f"measured here, {count} surfaces"
            if self.random
            else f"measured here, {count * replicas} replicas"
        )
        if self.controlled:
            how += f" and the area of sketches of {len(rows[-1])}"
        cause, inside, is_split = "surfaces and replicas", 0.0, False
        if not self.random:
            cause, how = "replicas", f"{how} on this one surface"
        elif (
            column >= self.quantities.curve.stop
        ):  # the contact is the same for all replicas
            cause = "surfaces"
        elif "variance" in self.within:
            is_split = True
            cause = "surfaces"
            inside = float(self.within["variance"][column]) / replicas
        parts = {
            cause: ErrorPart(
                math.sqrt(max(0.0, first - inside) / count + more), how
            )
        }
        if is_split:
            on_each = (
                f"measured here, {replicas} on each surface"
                if replicas > 1
                else "measured here, on few surfaces"
            )
            parts["replicas"] = ErrorPart(
                math.sqrt(min(inside, first) / count), on_each
            )
        for number in range(1, len(rows) - self.controlled):
            size = math.sqrt(
                float(spreads[number].variance[column]) / len(rows[number])
            )
            parts["discretisation"] = ErrorPart(
                size,
                f"measured here: corrected by {len(rows[number])} surfaces computed both ways",
            )
        for name, relative in self.known.items():
            size = abs(float(self.mean[column])) * float(relative[column])
            parts[name] = ErrorPart(size, self.known_how.get(name, ""))
        return parts

    @property
    def name(self) -> str:
        """Name of the scene."""
        return str(self.provenance.get("scene", {}).get("name", "ensemble"))

    @property
    def title(self) -> str:
        """Title of the scene, or its name with its main values."""
        return heading(self.provenance.get("scene", {}), self.name)

    @property
    def random(self) -> bool:
        """Whether the mean is over surfaces, and not over replicas on one surface."""
        return bool(self.levels[0].get("random", True))

    @property
    def b(self) -> Quantity:
        """b = β/ln 10, per e-fold of the hold time."""
        return self._estimate(B, self.quantities.column("beta"), 1 / LN10)

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, mean over surfaces, nN, (m,)."""
        return self.mean[self.quantities.curve]

    @property
    def single_friction_drops(self) -> np.ndarray:
        """ΔF of each sample of the first level, nN, (samples, m)."""
        return self.rows["0"][:, self.quantities.curve]

    @property
    def friction_drop_half_width(self) -> np.ndarray:
        """Half the width of its 95 % interval, nN, (m,)."""
        return self.half_widths[self.quantities.curve]

    @property
    def scatter(self) -> float:
        """Standard deviation of β between the samples of the first level over its mean; nan without β."""
        if not self.quantities.has_beta or not self.mean[0]:
            return math.nan
        return float(self.rows["0"][:, 0].std(ddof=1) / abs(self.mean[0]))

    def plot(
        self,
        ax: Axes | None = None,
        *,
        singles: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> Axes:
        """Draw Δμ (without load ΔF) against hold time into ``ax`` or a figure of pyplot, and return the axes.

        The mean with its 95 % interval as a band, and the line of β. Without ageing the parts of the error are drawn.

        Parameters
        ----------
        singles
            Whether the curves of single surfaces are drawn, too.
        color, label
            Of the mean; without a label it is said what the mean is over.

        Raises
        ------
        InputError
            matplotlib is missing.
        """
        return draw_result(self, ax, singles=singles, color=color, label=label)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions and units of the file, and the mean curves of friction with half the
        widths of their 95 % intervals and the parts of their errors (standard errors). Needs xarray."""
        derived = {
            name: ((HOLD_TIME.name,), values, {"units": curve.unit})
            for curve in self.curves()
            for name, values in curve.numbers().items()
        }
        return dataset(self, derived)

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each hold time (s): means of ΔF (nN) and Δμ, half the widths of their 95 % intervals
        (``_half_width``), and the parts of their errors by name (``friction_drop.surfaces``: standard errors). Without
        hold times one row for each measure of the contact. Needs pandas."""
        attributes = {
            "surfaces": self.surfaces if self.random else 1,
            "load": self.load,
        }
        if not self.hold_times.size:
            rows = []
            for one in (self.estimate(name) for name in self.measures):
                errors = {
                    f"error.{cause}": part.size
                    for cause, part in one.errors.items()
                }
                rows.append(
                    {
                        "measure": one.name,
                        "value": one.value,
                        "half_width": one.half_width,
                        **errors,
                    }
                )
            names = dict.fromkeys(name for row in rows for name in row)
            columns = {
                name: np.array([row.get(name, math.nan) for row in rows])
                for name in names
            }
            return frame(columns, "measure", attributes)
        columns = {
            name: values
            for curve in self.curves()
            for name, values in curve.numbers().items()
        }
        return frame(
            {HOLD_TIME.name: self.hold_times, **columns}, HOLD_TIME.name, attributes
        )

    def curves(self) -> list[Curve]:
        """ΔF and Δμ against hold time."""
        what = f"mean of {self.over}, 95 %{' band' if self.random else ''}"
        curves = []
        for name in (name for name in DROPS if name in self.quantities.names):
            estimates = [
                self.estimate(name, float(time)) for time in self.hold_times
            ]
            parts = ("value", "stderr", "half_width")
            value, stderr, half = (
                np.array([getattr(one, part) for one in estimates])
                for part in parts
            )
            errors = {
                cause: np.array([one.errors[cause].size for one in estimates])
                for cause in estimates[0].errors
            }
            of = {
                "x": self.hold_times,
                "mean": value,
                "stderr": stderr,
                "half_width": half,
                "errors": errors,
            }
            scale = 1.0 if name == "friction_drop" else 1 / self.load
            samples = [
                scale * rows[:, self.quantities.curve] for rows in self._terms
            ]
            spread = {
                "samples": samples,
                "known": scale * self._known[self.quantities.curve],
            }
            curves.append(
                DROPS[name].but(
                    **of, **spread, over=what, band=self.random, alone=False
                )
            )
        return curves

    @property
    def over(self) -> str:
        """What the mean is over, in few words."""
        if self.controlled:
            return f"{self.surfaces} surfaces and {self.levels[-1]['samples']} sketches"
        return (
            f"{self.surfaces} surfaces"
            if self.random
            else f"{self.surfaces} replicas on one surface"
        )

    def numbers(self) -> list[Quantity]:
        """The measures of the contact, its load, β and b."""
        load = MEASURES["load"].but(value=self.load, rank=Rank.REST)
        found = [*(self.estimate(name) for name in self.measures), load]
        if self.quantities.has_beta:
            found += [self.estimate("beta"), self.b]
        return [one for one in found if one.known or one.name in self._measured]

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the estimates, their intervals and the parts of their errors (standard errors); β,
        the curves and the measures of the contact by the names that they have in :meth:`Run.summary`."""
        curves, numbers = by_name(self.curves()), by_name(self.numbers())
        none = np.full(self.hold_times.size, math.nan)
        without = [
            one.but(mean=none, stderr=none, half_width=none)
            for name, one in DROPS.items()
            if name not in curves
        ]
        without += [one for one in (BETA, B) if one.name not in numbers]
        every = [
            *numbers.values(),
            *(one.but(errors={}) for one in curves.values()),
            *without,
        ]
        fitted = self.quantities.has_beta
        why = (
            why_not_fitted(self.hold_times, self.window)
            if self.hold_times.size and not fitted
            else ""
        )
        approximate = approximations_in_words(self.approximate)
        return {
            "name": self.name,
            "surfaces": self.surfaces if self.random else 1,
            "replicas": int(self.levels[0].get("replicas", 1)),
            "load": self.load,
            "hold_times": self.hold_times.tolist(),
            **{
                name: value
                for one in every
                for name, value in one.numbers().items()
            },
            **{
                one.name: getattr(self.line, one.name, None)
                for one in (RMS_RESIDUAL, SLOPE_FROM, SLOPE_TO)
            },
            "fit_range": list(self.quantities.span) if fitted else None,
            "beta_reason": why or None,
            "beta_scatter_between_surfaces": self.scatter,
            "observables": self._recorded(),
            "levels": [dict(level) for level in self.levels],
            "goals": self.goals,
            "stopped": self.stopped,
            "notes": self.every_note,
            "errors": {
                name: {
                    cause: {"standard_error": part.size, "known": part.how}
                    for cause, part in one.errors.items()
                }
                for name, one in numbers.items()
            }
            | {name: one.errors for name, one in curves.items()},
            "versions": self.provenance.get("versions", {}),
            "plugins": self.plugins,
            "cite": self.provenance.get("cite", []),
            **({"approximate": approximate} if approximate else {}),
        }

    def _recorded(self) -> dict[str, Any]:
        """The means of recorded numbers, as :attr:`Run.measured` summarises them."""
        found = {}
        for name, one in self._measured.items():
            found[name.removeprefix(RECORDED)] = {
                "dims": [],
                "unit": "" if one.unit == ONE else one.unit,
                "description": one.label,
                "shape": [],
                "mean": one.value,
                "stderr": one.stderr,
                "half_width": one.half_width,
                "low": one.low,
                "high": one.high,
                "reason": one.reason,
            }
        return found

    def __repr__(self) -> str:
        if not self.quantities.has_beta:
            return f"<Ensemble of {self.surfaces} samples>"
        beta = self.estimate("beta")
        return f"<Ensemble of {self.surfaces} samples, beta {beta.value:.4g} ± {beta.half_width:.2g}>"

    __str__ = __repr__
