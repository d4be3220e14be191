"""Activation energies of a temperature sweep: its results collected, and the figure.

Apparent activation energies: how the times of ageing shift with temperature.

Where the time t at which ageing reaches a given level depends on temperature as t = t₀ exp(E_a/k_B T), a line through
ln t against 1/(k_B T) has the slope E_a. For sites that react independently over one barrier E under a pressure P, E_a
is E − P ΔV at every level. For a distribution of barriers E_a grows with the level, because higher barriers are crossed
later: it is the barrier below which that share of the sites lies.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from chemage.ageing.ageing import Ageing
from chemage.ageing.fitting import FIT_WINDOW, UNIT, Fit, fit_ageing
from chemage.ageing.models import UNKNOWN, Interval, solve
from chemage.foundation.checks import within
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.figures import BLACK, PALETTE, legend, plain
from chemage.foundation.quantities import NONE, headed
from chemage.foundation.result import (
    Medium,
    Panel,
    Picture,
    Result,
    Rows,
    Table,
    displays,
    is_result,
    result_of,
)
from chemage.foundation.statistics import jackknife_error, student_limits
from chemage.foundation.text import jsonable, with_interval
from chemage.foundation.units import KB, convert
from chemage.results.files import read
from chemage.studies.sweeps.grid import listed, shown
from chemage.studies.sweeps.result import Point, SweepResult, load_sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Level = Literal["friction_coefficient_drop", "friction_drop", "bonds_per_site"]

#: quantity -> how it is written
SYMBOLS: dict[str, str] = {
    "friction_coefficient_drop": "Δμ",
    "friction_drop": "ΔF",
    "bonds_per_site": "bonds per site",
}
#: fewer temperatures make no line with an error
LEAST = 3
#: levels that are chosen where none are given
CHOSEN = 5
#: replicas from which on the temperatures are weighted by their errors; the errors of fewer are too uncertain
FOR_WEIGHTS = 5


@dataclass(frozen=True, eq=False)
class ActivationEnergy:
    """The line through ln t against 1/(k_B T) at one level."""

    #: of the quantity; None: the cut-off time of the fit of β
    level: float | None
    #: (n,) K, those at which the level is reached within the hold times
    temperatures: np.ndarray
    #: (n,) s
    times: np.ndarray
    #: (n,) standard errors of ln t, jackknife over replicas; nan for a single replica
    log_time_errors: np.ndarray
    #: (n,) half the widths of the intervals of ln t, Student's t over replicas
    log_time_half_widths: np.ndarray
    #: E_a, eV
    energy: float
    energy_stderr: float
    energy_interval: Interval
    #: t₀, s
    prefactor: float
    prefactor_interval: Interval
    #: root mean square distance of ln t from the line
    rms_residual: float
    #: how the interval was found, in words
    intervals: str

    def __call__(self, temperature: np.ndarray | float) -> np.ndarray:
        """The time of the line at ``temperature`` (K), s."""
        beta = 1 / (KB * np.asarray(temperature, dtype=np.float64))
        return self.prefactor * np.exp(self.energy * beta)

    def todict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return jsonable(vars(self))


def _with(value: float, interval: Interval) -> str:
    finite = math.isfinite(interval.low) and math.isfinite(interval.high)
    return (
        with_interval(value, interval.low, interval.high)
        if finite
        else f"{value:.4g} (no interval)"
    )


@dataclass(frozen=True, eq=False)
class Arrhenius:
    """The summary of ageing at several temperatures."""

    quantity: Level
    #: (n,) K, ascending
    temperatures: np.ndarray
    #: β and cut-off time at each temperature; None where there is no fit
    fits: tuple[Fit | None, ...]
    #: the levels in ascending order, and last the cut-off time where it is known at enough temperatures
    energies: tuple[ActivationEnergy, ...]
    notes: tuple[str, ...] = ()
    confidence: float = 0.95

    @property
    def unit(self) -> str:
        """Unit of the levels."""
        return UNIT.get(self.quantity, "")

    def label(self, energy: ActivationEnergy) -> str:
        """What the times of ``one`` are the times of, in words."""
        if energy.level is None:
            return "cut-off time"
        return f"{SYMBOLS[self.quantity]} = {energy.level:.4g} {self.unit}".strip()

    def todict(self) -> dict[str, Any]:
        """Plain JSON values."""
        fits = []
        for kelvin, fit in zip(self.temperatures, self.fits, strict=True):
            of_fit = {} if fit is None else fit.todict()
            fits.append({"temperature": float(kelvin)} | of_fit)
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "temperatures": self.temperatures.tolist(),
            "energies": [energy.todict() for energy in self.energies],
            "fits": fits,
            "confidence": self.confidence,
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class _Curve:
    """One temperature: the quantity of every replica at the hold times above 0."""

    temperature: float
    #: (m,) s
    times: np.ndarray
    #: (replicas, m)
    values: np.ndarray

    @property
    def left_out(self) -> np.ndarray:
        """(replicas, m): means with each replica left out in turn; (1, m), the mean itself, for a single one."""
        r = len(self.values)
        return (
            self.values
            if r < 2
            else (self.values.sum(axis=0) - self.values) / (r - 1)
        )


def _check(curves: Sequence[Ageing]) -> None:
    """Refuse curves that are not at three temperatures of one contact and one chemistry."""
    kelvins = sorted(curve.temperature for curve in curves)
    if len(kelvins) < LEAST:
        raise InputError(
            f"results: {len(kelvins)} temperatures; a line with an error needs {LEAST} or more"
        )
    for first, second in pairwise(kelvins):
        if second - first <= 1e-9 * second:
            raise InputError(
                f"results: two of them are at {first:g} K; give one for each temperature"
            )
    for name in ("load", "bond_force", "front_factor"):
        values = sorted({getattr(curve, name) for curve in curves})
        if len(values) > 1:
            raise InputError(
                f"results: differ in {name} ({', '.join(f'{value:g}' for value in values)}), not in "
                "temperature alone; give results of one contact and one chemistry"
            )
    for name in ("chemistry", "contact"):
        first, *others = [curve.provenance.get(name) for curve in curves]
        if any(other != first for other in others):
            raise InputError(
                f"results: differ in their {name}, not in temperature alone; give results of one {name}"
            )


def _quantity(quantity: Level | None, curves: Sequence[Ageing]) -> Level:
    load = curves[0].load
    if quantity is None:
        return "friction_coefficient_drop" if load > 0 else "friction_drop"
    if quantity not in SYMBOLS:
        raise InputError.of("quantity", quantity, f"choose {', '.join(SYMBOLS)}")
    if quantity == "friction_coefficient_drop" and load == 0:
        raise InputError(
            "load = 0: the friction coefficient is undefined; choose quantity = 'friction_drop'"
        )
    return quantity


def _curve(ageing: Ageing, quantity: Level) -> _Curve:
    if quantity == "bonds_per_site":
        values = (
            ageing.bonds / np.where(ageing.sites > 0, ageing.sites, np.nan)[:, None]
        )
    else:
        values = (
            ageing.friction_drop
            if quantity == "friction_drop"
            else ageing.friction_coefficient_drop
        )
    shown = ageing.hold_times > 0
    return _Curve(
        ageing.temperature,
        ageing.hold_times[shown],
        np.asarray(values, dtype=np.float64)[:, shown],
    )


def _given(levels: float | str | Sequence[float | str], unit: str) -> list[float]:
    listed = (
        levels
        if isinstance(levels, Sequence) and not isinstance(levels, str)
        else [levels]
    )
    numbers = sorted({convert(level, unit) for level in listed})
    if not numbers:
        raise InputError("levels: an empty list; give levels, or leave them out")
    for level in numbers:
        if not (math.isfinite(level) and level > 0):
            raise InputError.of(
                "level",
                level,
                "must be finite and positive",
                "give a level that is reached",
            )
    return numbers


def _default(curves: Sequence[_Curve]) -> list[float]:
    """Levels between those that the first and the last hold times reach at the largest number of temperatures."""
    ranges = [
        (max(float(mean[0]), 0.0), float(mean.max()))
        for curve in curves
        if (mean := curve.values.mean(axis=0)).size
    ]
    ranges = [(low, high) for low, high in ranges if high > low]
    ends = sorted({end for pair in ranges for end in pair})
    best, counted = (0.0, 0.0), 0
    for low, high in pairwise(ends):
        count = sum(first <= low and high <= last for first, last in ranges)
        if count > counted or (count == counted and high - low > best[1] - best[0]):
            best, counted = (low, high), count
    if counted < LEAST:
        return []
    low, high = best
    levels = [low + (high - low) * (k + 0.5) / CHOSEN for k in range(CHOSEN)]
    short = [float(f"{level:.3g}") for level in levels]
    return (
        short
        if len(set(short)) == CHOSEN and low < short[0] and short[-1] < high
        else levels
    )


def _log_time(times: np.ndarray, means: np.ndarray, level: float) -> np.ndarray:
    """(b,) ln t at which each row of ``means`` (b, m) first reaches ``level``; nan where it is not within the times."""
    logs = np.full(len(means), np.nan)
    for row, mean in enumerate(means):
        above = np.flatnonzero(mean >= level)
        if above.size and (at := int(above[0])) > 0:
            below, log_t = mean[at - 1], np.log(times[at - 1 : at + 1])
            logs[row] = log_t[0] + (log_t[1] - log_t[0]) * (level - below) / (
                mean[at] - below
            )
    return logs


def _at_level(
    level: float, curves: Sequence[_Curve], confidence: float
) -> ActivationEnergy:
    logs = np.array(
        [
            _log_time(curve.times, curve.values.mean(axis=0)[None, :], level)[0]
            for curve in curves
        ]
    )
    reached = np.isfinite(logs)
    if np.count_nonzero(reached) < LEAST:
        kelvins = ", ".join(
            f"{curve.temperature:g} K"
            for curve, there in zip(curves, reached, strict=True)
            if there
        )
        raise InputError.of(
            "level",
            level,
            f"is reached between the first and the last hold time at {np.count_nonzero(reached)} temperatures"
            + (f" ({kelvins})" if kelvins else "")
            + f", and a line needs {LEAST}",
            "give another level, or more hold times",
        )
    used = [curve for curve, there in zip(curves, reached, strict=True) if there]
    left_out = [_log_time(curve.times, curve.left_out, level) for curve in used]
    return _line(
        level,
        np.array([curve.temperature for curve in used]),
        logs[reached],
        left_out,
        confidence,
    )


def _line(
    level: float | None,
    kelvins: np.ndarray,
    logs: np.ndarray,
    left_out: Sequence[np.ndarray],
    confidence: float,
) -> ActivationEnergy:
    """The line through ln t (n,); ``left_out`` are its values with each replica left out, for each temperature."""
    counts = [len(logs_of_one) for logs_of_one in left_out]
    errors = np.array(
        [
            float(jackknife_error(logs_of_one))
            if len(logs_of_one) > 1
            else math.nan
            for logs_of_one in left_out
        ]
    )
    x = 1 / (KB * kelvins)
    weighted = min(counts) >= FOR_WEIGHTS and bool(
        (np.isfinite(errors) & (errors > 0)).all()
    )
    weight = 1 / errors**2 if weighted else np.ones(x.size)
    rows = _rows(x, weight)
    energy, log_prefactor = rows @ logs
    residual = logs - log_prefactor - energy * x
    freedom: np.ndarray | float
    if min(counts) < 2:
        share = weight / weight.sum()
        freedom = x.size - 2.0
        error = np.sqrt(
            share @ residual**2 / freedom * (rows**2 / share).sum(axis=1)
        )
        words = f"Student's t, scatter about the line, {x.size} temperatures"
    elif len(set(counts)) == 1:
        error = _jackknife(x, weight, logs, left_out, weighted, range(x.size))
        freedom = counts[0] - 1.0
        words = f"Student's t, jackknife over {counts[0]} replicas"
    else:
        # the degrees of freedom are those of the temperature with the largest part: those of Welch and Satterthwaite
        # are too many where a few replicas decide
        parts = [
            _jackknife(x, weight, logs, left_out, weighted, [k]) ** 2
            for k in range(x.size)
        ]
        error = np.sqrt(np.sum(parts, axis=0))
        freedom = np.array(counts)[np.argmax(parts, axis=0)] - 1.0
        words = (
            f"Student's t, jackknife over {min(counts)} to {max(counts)} replicas"
        )
    half = error * student_limits(np.broadcast_to(freedom, 2), confidence)
    finite = bool(np.isfinite(half).all())
    return ActivationEnergy(
        level=level,
        temperatures=kelvins,
        times=np.exp(logs),
        log_time_errors=errors,
        log_time_half_widths=errors
        * student_limits(np.maximum(np.array(counts) - 1.0, 1.0), confidence),
        energy=float(energy),
        energy_stderr=float(error[0]),
        energy_interval=Interval(float(energy - half[0]), float(energy + half[0]))
        if finite
        else UNKNOWN,
        prefactor=math.exp(log_prefactor),
        prefactor_interval=Interval(
            *np.exp([log_prefactor - half[1], log_prefactor + half[1]]).tolist()
        )
        if finite
        else UNKNOWN,
        rms_residual=float(np.sqrt(np.mean(residual**2))),
        intervals=words,
    )


def _rows(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(2, n): E_a and ln t₀ of the weighted line are these times ln t (n,)."""
    share = weight / weight.sum()
    away = x - share @ x
    slope = share * away / (share @ away**2)
    return np.array([slope, share - slope * (share @ x)])


def _weights_without(left_out: np.ndarray) -> np.ndarray:
    """(r,) the weight of a temperature with each of its r replicas left out, from what each adds to ln t."""
    r = len(left_out)
    added = (r - 1) * (left_out.mean() - left_out)
    rest = (added**2).sum() - added**2 - added**2 / (r - 1)
    with np.errstate(divide="ignore"):
        return (r - 1) * (r - 2) / np.maximum(rest, 0.0)


def _jackknife(
    x: np.ndarray,
    weight: np.ndarray,
    logs: np.ndarray,
    left_out: Sequence[np.ndarray],
    weighted: bool,
    at: Sequence[int],
) -> np.ndarray:
    """(2,) jackknife errors of E_a and ln t₀ with replica r left out at the temperatures ``at``.

    The weights are those without it: taken as known they would make the error too small, since temperatures that seem
    to scatter little by chance count most.
    """
    values = []
    weights = {k: _weights_without(left_out[k]) for k in at} if weighted else {}
    for r in range(len(left_out[at[0]])):
        logs_now, weight_now = logs.copy(), weight.copy()
        for k in at:
            logs_now[k] = left_out[k][r]
            if weighted and math.isfinite(weights[k][r]):
                weight_now[k] = weights[k][r]
        values.append(_rows(x, weight_now) @ logs_now)
    return jackknife_error(np.array(values))


def _fit(
    ageing: Ageing, quantity: Level, window: tuple[float, float]
) -> Fit | None:
    of_force = quantity == "friction_drop" or ageing.load == 0
    try:
        return fit_ageing(
            ageing, window=window, quantity="friction_drop" if of_force else None
        )
    except InputError:
        return None


def _of_cutoff(
    results: Sequence[Ageing],
    fits: Sequence[Fit | None],
    window: tuple[float, float],
    confidence: float,
) -> ActivationEnergy | None:
    """The activation energy of the cut-off time; None where it is known at fewer than three temperatures."""
    kelvins, logs, left_out = [], [], []
    for result, fit in zip(results, fits, strict=True):
        curve = _curve(
            result, "friction_drop"
        )  # of which the cut-off time is that of Δμ
        use = within(curve.times, window)
        if fit is None or not (
            math.isfinite(fit.cutoff_time) and fit.cutoff_time > 0
        ):
            continue
        kelvins.append(curve.temperature)
        logs.append(math.log(fit.cutoff_time))
        even = np.ones((1, int(np.count_nonzero(use))))
        left_out.append(
            solve("line", curve.times[use], curve.left_out[:, use], even)[1]
            * math.log(10)
        )
    if len(kelvins) < LEAST:
        return None
    return _line(None, np.array(kelvins), np.array(logs), left_out, confidence)


_TEMPERATURE = "hold.temperature"
#: sections whose fields may vary with the temperature: they change the hold times, not what ages
_MAY_VARY = (
    "hold.start",
    "hold.stop",
    "hold.times",
    "hold.per_decade",
    "hold.replicas",
    "fit.start",
    "fit.stop",
)


def arrhenius(
    results: SweepResult | str | os.PathLike[str] | Iterable[Any],
    levels: float | str | Sequence[float | str] | None = None,
    *,
    quantity: Level | None = None,
    window: tuple[float | str, float | str] | None = None,
    where: Mapping[str, Any] | None = None,
    confidence: float = 0.95,
) -> Arrhenius:
    """Apparent activation energies of ageing from results at three temperatures or more.

    At each level the time t at which the mean over replicas first reaches it is interpolated linearly in log t between
    hold times; E_a and t₀ are those of the line ln t = ln t₀ + E_a/(k_B T), by least squares, weighted by the errors of
    ln t from five replicas on.

    Parameters
    ----------
    results
        A sweep over ``hold.temperature``, its folder, or runs, ageing curves, points of sweeps or result files, one for
        each temperature. Points of a sweep that are not done are left out, with a note.
    levels
        Levels of the quantity, in its unit, at which times are compared; default: five that are reached at as many
        temperatures as possible.
    quantity
        ``"friction_coefficient_drop"`` (default), ``"friction_drop"`` (nN; default without load), or
        ``"bonds_per_site"``.
    window
        First and last hold time of the line whose β and cut-off time are listed for each temperature; default: the fit
        window of the scene.
    where
        The points of a sweep with more axes than the temperature that are used: dotted path -> value.
    confidence
        Coverage of the intervals. They are Student's. With equal numbers of replicas the standard error is that of the
        jackknife in which replica r is left out at every temperature at once, so that random numbers that temperatures
        have in common are accounted for, with one degree of freedom less than replicas; with unequal numbers the
        temperatures are taken as independent, with the degrees of freedom of that with the largest part of the error.
        The weights are computed again without each replica. A single replica has no error, and the scatter of ln t
        about the line takes its place. No interval includes the scatter between surfaces, nor the curvature of a line
        that is none.

    Raises
    ------
    InputError
        Fewer than three temperatures, or two results at one; results that differ in more than temperature; a level that
        fewer than three temperatures reach.
    StoreError
        A file cannot be read.
    """
    ageings, notes, limits = _collected(results, where)
    _check(ageings)
    ageings.sort(key=lambda ageing: ageing.temperature)
    chosen = _quantity(quantity, ageings)
    if not 0 < confidence < 1:
        raise InputError.of(
            "confidence", confidence, "must lie between 0 and 1", "give 0.95, say"
        )
    curves = [_curve(ageing, chosen) for ageing in ageings]
    asked = (
        _default(curves) if levels is None else _given(levels, UNIT.get(chosen, ""))
    )
    energies = [_at_level(level, curves, confidence) for level in asked]
    if levels is None:
        energies = [energy for energy in energies if math.isfinite(energy.energy)]
        if not energies:
            notes.append(
                "no level is reached at three temperatures within the hold times; give more hold times"
            )
    first, last = window or limits
    span = convert(first, "s"), convert(last, "s")
    fits = tuple(_fit(ageing, chosen, span) for ageing in ageings)
    notes += dict.fromkeys(
        fit.doubt for fit in fits if fit is not None and fit.doubt
    )
    if (cutoff := _of_cutoff(ageings, fits, span, confidence)) is not None:
        energies.append(cutoff)
    kelvins = np.array([curve.temperature for curve in curves])
    return Arrhenius(
        chosen, kelvins, fits, tuple(energies), tuple(notes), confidence
    )


def _collected(
    results: Any, where: Mapping[str, Any] | None
) -> tuple[list[Ageing], list[str], tuple[float, float]]:
    """The ageing curves of results, notes, and the fit window of the first."""
    if isinstance(results, str | os.PathLike):
        results = load_sweep(Path(results)) if Path(results).is_dir() else [results]
    if isinstance(results, SweepResult):
        points, notes = _points(results, where)
        fit = points[0].scene().fit
        return [point.ageing() for point in points], notes, (fit.start, fit.stop)
    if where:
        raise InputError(
            "where: chooses points of a sweep; give a sweep or its folder"
        )
    if is_result(results) or not isinstance(results, Iterable):
        results = [results]
    ageings, windows = [], []
    for source in results:
        is_file = isinstance(source, str | os.PathLike)
        shown = result_of(read(source, maps=False) if is_file else source)
        ageing = shown.made_by().get("ageing")
        if ageing is None:
            raise InputError(
                f"results: {shown.name} has no ageing curve; give runs or ageing curves at several temperatures"
            )
        ageings.append(ageing)
        windows.append(shown.comparable().window)
    return ageings, [], next(iter(windows), None) or FIT_WINDOW


def _points(
    result: SweepResult, where: Mapping[str, Any] | None
) -> tuple[list[Point], list[str]]:
    """The points of a sweep that are done, and notes."""
    folder, swept, chosen = result.folder, result.swept, where or {}
    if _TEMPERATURE not in swept:
        raise InputError(
            f"{folder}: {_TEMPERATURE} is not swept; swept are {', '.join(swept)}"
        )
    points = result.where(chosen)
    if not points:
        raise InputError(f"{folder}: no point has {listed(chosen)}")
    for path in swept:
        if path in (_TEMPERATURE, *_MAY_VARY, *chosen):
            continue
        values = list(dict.fromkeys(shown(point.values[path]) for point in points))
        if len(values) > 1:
            raise InputError(
                f"{folder}: {path} is swept as well as the temperature ({', '.join(values[:6])}); choose one of its "
                f"values: where {path} = {values[0]}"
            )
    done = [point for point in points if point.status == "done"]
    if not done:
        raise StoreError(
            f"{folder}: none of {len(points)} points is done; run the sweep first"
        )
    missing = len(points) - len(done)
    note = f"{missing} of {len(points)} points are not done and left out"
    return done, [note] if missing else []


@displays(Arrhenius)
class ArrheniusDisplay(Result):
    """Activation energies as users see them."""

    errors = "95 % intervals over replicas on one surface; they do not include the scatter between surfaces"

    def __init__(self, energies: Arrhenius) -> None:
        self.energies = energies

    @property
    def title(self) -> str:
        return "Activation energies of ageing"

    def facts(self) -> Rows:
        kelvins = ", ".join(f"{kelvin:g}" for kelvin in self.energies.temperatures)
        return [
            ("temperatures", f"{kelvins} K"),
            ("compared at levels of", SYMBOLS[self.energies.quantity]),
        ]

    def numbers(self) -> dict[str, Any]:
        return self.energies.todict()

    def notes(self) -> list[str]:
        intervals = dict.fromkeys(
            energy.intervals for energy in self.energies.energies
        )
        words = [
            f"intervals: {text}; scatter between surfaces is not included"
            for text in intervals
        ]
        return [*words, *self.energies.notes]

    def tables(self) -> list[Table]:
        """At each temperature β and the cut-off time; for each level the activation energy."""
        energies, by_temperature, by_level = self.energies, [], []
        for kelvin, fit in zip(energies.temperatures, energies.fits, strict=True):
            texts = (NONE,) * 4
            if fit is not None:
                beta, b, cutoff = fit.texts()
                texts = beta, b, f"{fit.beta / kelvin:.4g}", cutoff
            by_temperature.append((f"{kelvin:g}", *texts))
        for energy in energies.energies:
            first, *_, last = energy.temperatures
            by_level.append(
                (
                    energies.label(energy),
                    f"{_with(energy.energy, energy.energy_interval)} eV",
                    f"{_with(energy.prefactor, energy.prefactor_interval)} s",
                    f"{energy.rms_residual:.2g}",
                    f"{energy.temperatures.size} ({first:g} to {last:g})",
                )
            )
        columns = (
            "T (K)",
            "β per decade",
            "b per e-fold",
            "β/T (1/K)",
            "cut-off time",
        )
        levels = (
            "time at which",
            "activation energy",
            "prefactor t0",
            "rms of ln t",
            "temperatures",
        )
        titles = (
            "Ageing at each temperature, 95 % intervals",
            "t = t0 exp(E_a/k_B T), 95 % intervals",
        )
        return [
            Table(titles[0], columns, by_temperature, in_detail=False),
            Table(titles[1], levels, by_level, in_detail=False),
        ]

    def pictures(self) -> dict[str, Picture]:
        """The times of each level against 1/T with their lines, and the activation energy against the level."""
        drawn = [
            Panel(
                self._draw_times,
                "Hold times at which each level is reached, against 1/T.",
                name="times",
            ),
            Panel(
                self._draw_energies,
                "Activation energy against the level.",
                name="energies",
            ),
        ]
        if not self._levels:
            return {"arrhenius": Picture(drawn[:1], (5.0, 3.9))}
        return {"arrhenius": Picture(drawn, (9.6, 3.9))}

    def _draw_times(self, axes: Axes, medium: Medium) -> None:
        energies, kelvins = self.energies.energies, self.energies.temperatures
        for number, energy in enumerate(energies):
            color, marker, dashes = PALETTE[number % len(PALETTE)], "o", "-"
            if energy.level is None:
                color, marker, dashes = BLACK, "s", "--"
            x, times = 1e3 / energy.temperatures, energy.times
            half = np.nan_to_num(energy.log_time_half_widths)
            ends = [times * -np.expm1(-half), times * np.expm1(half)]
            axes.errorbar(
                x, times, yerr=ends, fmt=marker, ms=4, capsize=2, lw=1, color=color
            )
            line = np.linspace(x.min(), x.max(), 50)
            label = plain(f"{self.energies.label(energy)}: {energy.energy:.3g} eV")
            axes.plot(
                line,
                energy(1e3 / line),
                color=color,
                lw=1.2,
                ls=dashes,
                label=label,
            )
        axes.set(yscale="log", xlabel="1000 K / T", ylabel="hold time (s)")
        if energies:
            title = f"bars: {self._sure}; activation energy at"
            legend(axes, title=title, loc="upper left", alignment="left")
            # the temperatures along the upper edge
            upper = axes.secondary_xaxis("top")
            chosen = kelvins[:: max(1, math.ceil(kelvins.size / 7))]
            upper.set_xticks(1e3 / chosen, [f"{kelvin:g}" for kelvin in chosen])
            upper.set_xlabel("T (K)")

    @property
    def _sure(self) -> str:
        return f"{100 * self.energies.confidence:g} % intervals"

    @property
    def _levels(self) -> list[ActivationEnergy]:
        return [
            energy for energy in self.energies.energies if energy.level is not None
        ]

    def _draw_energies(self, axes: Axes, medium: Medium) -> None:
        result, levels = self.energies, self._levels
        energies = np.array([energy.energy for energy in levels])
        ends = np.array([energy.energy_interval for energy in levels])
        bars = np.nan_to_num(np.abs(ends - energies[:, None])).T
        values = [energy.level or 0.0 for energy in levels]
        style: dict[str, Any] = {
            "ms": 4,
            "capsize": 3,
            "lw": 1,
            "color": PALETTE[0],
        }
        axes.errorbar(values, energies, yerr=bars, fmt="o-", **style)
        axes.set(
            xlabel=headed(SYMBOLS[result.quantity], result.unit),
            ylabel="activation energy (eV)",
        )
        axes.set_title(f"bars: {self._sure}")
        finite = ends[np.isfinite(ends)]
        span = max(float(np.ptp(finite)) if finite.size else 0.0, KB * 300)
        axes.set_ylim(energies.mean() - span, energies.mean() + span)
