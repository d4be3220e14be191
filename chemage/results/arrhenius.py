"""Activation energies of a temperature sweep: its results collected, and the figure."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.fitting import FIT_WINDOW
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.figures import BLACK, PALETTE, legend, plain
from chemage.foundation.quantities import NONE
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
from chemage.foundation.units import KB
from chemage.results.files import read
from chemage.studies.arrhenius import SYMBOLS, Arrhenius, Level, activation_energies
from chemage.studies.sweeps.grid import listed, shown
from chemage.studies.sweeps.result import Point, SweepResult, load_sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

    Parameters
    ----------
    results
        A sweep over ``hold.temperature``, its folder, or runs, ageing curves, points of sweeps or result files, one for
        each temperature. Points of a sweep that are not done are left out, with a note.
    levels, quantity, confidence
        See :func:`chemage.studies.arrhenius.activation_energies`: levels of Δμ (default), ΔF (nN) or bonds per site, at
        which times are compared; default: five levels that are reached at as many temperatures as possible.
    window
        First and last hold time of the line whose β and cut-off time are listed; default: the fit window of the scene.
    where
        The points of a sweep with more axes than the temperature that are used: dotted path -> value.

    Raises
    ------
    InputError
        Fewer than three temperatures, results that differ in more than temperature, or a level that is not reached.
    StoreError
        A file cannot be read.
    """
    if isinstance(results, str | os.PathLike):
        results = load_sweep(Path(results)) if Path(results).is_dir() else [results]
    agings: list[Aging] = []
    notes: list[str] = []
    limits = FIT_WINDOW
    if isinstance(results, SweepResult):
        points, notes = _points(results, where)
        fit = points[0].scene().fit
        agings, limits = [point.aging() for point in points], (fit.start, fit.stop)
    elif where:
        raise InputError("where: chooses points of a sweep; give a sweep or its folder")
    else:
        for source in (
            [results]
            if is_result(results) or not isinstance(results, Iterable)
            else results
        ):
            shown = result_of(
                read(source, maps=False)
                if isinstance(source, str | os.PathLike)
                else source
            )
            aging = shown.made_by().get("aging")
            if aging is None:
                raise InputError(
                    f"results: {shown.name} has no ageing curve; give runs or ageing curves at several temperatures"
                )
            limits = limits if agings else shown.ageing().window or FIT_WINDOW
            agings.append(aging)
    energies = activation_energies(
        agings,
        levels,
        quantity=quantity,
        window=window or limits,
        confidence=confidence,
    )
    return replace(energies, notes=(*notes, *energies.notes)) if notes else energies


def _points(
    result: SweepResult, where: Mapping[str, Any] | None
) -> tuple[list[Point], list[str]]:
    """The points of a sweep that are done, and notes."""
    if _TEMPERATURE not in result.swept:
        raise InputError(
            f"{result.folder}: {_TEMPERATURE} is not swept; swept are {', '.join(result.swept)}"
        )
    points = result.where(where) if where else list(result)
    if not points:
        raise InputError(f"{result.folder}: no point has {listed(where or {})}")
    others = [
        path
        for path in result.swept
        if path not in (_TEMPERATURE, *_MAY_VARY) and path not in (where or {})
    ]
    for path in others:
        values = list(dict.fromkeys(shown(point.values[path]) for point in points))
        if len(values) > 1:
            raise InputError(
                f"{result.folder}: {path} is swept as well as the temperature ({', '.join(values[:6])}); choose one "
                f"of its values: where {path} = {values[0]}"
            )
    done = [point for point in points if point.status == "done"]
    missing = len(points) - len(done)
    notes = (
        [f"{missing} of {len(points)} points are not done and left out"]
        if missing
        else []
    )
    if not done:
        raise StoreError(
            f"{result.folder}: none of {len(points)} points is done; run the sweep first"
        )
    return done, notes


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
        intervals = dict.fromkeys(energy.intervals for energy in self.energies.energies)
        words = [
            f"intervals: {text}; scatter between surfaces is not included"
            for text in intervals
        ]
        return [*words, *self.energies.notes]

    def tables(self) -> list[Table]:
        """At each temperature β and the cut-off time; for each level the activation energy."""
        by_temperature = []
        for kelvin, fit in zip(
            self.energies.temperatures, self.energies.fits, strict=True
        ):
            texts = (NONE,) * 4
            if fit is not None:
                beta, b, cutoff = fit.texts()
                texts = (beta, b, f"{fit.beta / kelvin:.4g}", cutoff)
            by_temperature.append((f"{kelvin:g}", *texts))
        by_level = []
        for energy in self.energies.energies:
            kelvins = f"{energy.temperatures.size} ({energy.temperatures[0]:g} to {energy.temperatures[-1]:g})"
            texts = (
                energy.energy_text(),
                energy.prefactor_text(),
                f"{energy.rms_residual:.2g}",
                kelvins,
            )
            by_level.append((self.energies.label(energy), *texts))
        columns = ("T (K)", "β per decade", "b per e-fold", "β/T (1/K)", "cut-off time")
        levels = (
            "time at which",
            "activation energy",
            "prefactor t0",
            "rms of ln t",
            "temperatures",
        )
        return [
            Table(
                "Ageing at each temperature, 95 % intervals",
                columns,
                by_temperature,
                in_detail=False,
            ),
            Table(
                "t = t0 exp(E_a/k_B T), 95 % intervals",
                levels,
                by_level,
                in_detail=False,
            ),
        ]

    def pictures(self) -> dict[str, Picture]:
        """The times of each level against 1/T with their lines, and the activation energy against the level."""
        levels = [
            energy for energy in self.energies.energies if energy.level is not None
        ]
        times = Panel(
            self._draw_times,
            "Hold times at which each level is reached, against 1/T.",
            name="times",
        )
        energies = Panel(
            self._draw_energies, "Activation energy against the level.", name="energies"
        )
        drawn = (times, energies) if levels else (times,)
        return {"arrhenius": Picture(drawn, (9.6 if levels else 5.0, 3.9))}

    def _draw_times(self, axes: Axes, medium: Medium) -> None:
        energies = self.energies.energies
        for number, energy in enumerate(energies):
            colour = BLACK if energy.level is None else PALETTE[number % len(PALETTE)]
            x = 1e3 / energy.temperatures
            half = np.nan_to_num(energy.log_time_half_widths)
            lower = energy.times * -np.expm1(-half)
            upper = energy.times * np.expm1(half)
            marker = "s" if energy.level is None else "o"
            axes.errorbar(
                x,
                energy.times,
                yerr=[lower, upper],
                fmt=marker,
                ms=4,
                capsize=2,
                lw=1,
                color=colour,
            )
            line = np.linspace(x.min(), x.max(), 50)
            label = plain(f"{self.energies.label(energy)}: {energy.energy:.3g} eV")
            dashes = "--" if energy.level is None else "-"
            axes.plot(
                line, energy(1e3 / line), color=colour, lw=1.2, ls=dashes, label=label
            )
        axes.set(yscale="log", xlabel="1000 K / T", ylabel="hold time (s)")
        if energies:
            title = f"bars: {self._sure}; activation energy at"
            legend(axes, title=title, loc="upper left", alignment="left")
            # the temperatures along the upper edge
            upper = axes.secondary_xaxis("top")
            kelvins = self.energies.temperatures
            chosen = kelvins[:: max(1, math.ceil(kelvins.size / 7))]
            upper.set_xticks(1e3 / chosen, [f"{kelvin:g}" for kelvin in chosen])
            upper.set_xlabel("T (K)")

    @property
    def _sure(self) -> str:
        return f"{100 * self.energies.confidence:g} % intervals"

    def _draw_energies(self, axes: Axes, medium: Medium) -> None:
        result = self.energies
        levels = [
            energy for energy in self.energies.energies if energy.level is not None
        ]
        energies = np.array([energy.energy for energy in levels])
        ends = np.array(
            [
                [energy.energy_interval.low, energy.energy_interval.high]
                for energy in levels
            ]
        )
        bars = np.nan_to_num(np.abs(ends - energies[:, None])).T
        values = [energy.level or 0.0 for energy in levels]
        axes.errorbar(
            values,
            energies,
            yerr=bars,
            fmt="o-",
            ms=4,
            capsize=3,
            lw=1,
            color=PALETTE[0],
        )
        unit = f" ({result.unit})" if result.unit else ""
        axes.set(
            xlabel=f"{SYMBOLS[result.quantity]}{unit}", ylabel="activation energy (eV)"
        )
        axes.set_title(f"bars: {self._sure}")
        span = max(
            float(np.ptp(ends[np.isfinite(ends)])) if np.isfinite(ends).any() else 0.0,
            KB * 300,
        )
        axes.set_ylim(energies.mean() - span, energies.mean() + span)
