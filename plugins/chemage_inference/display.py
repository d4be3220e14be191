"""How an inference is shown: in words, with scores of families, forecasts and planned measurements, and in figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import (
    Comparable,
    OfRecord,
    Panel,
    Picture,
    Quantity,
    Result,
    Table,
    displays,
    figures,
    statistics,
    text,
)
from chemage_inference.forecast import UNSEEN, WIDE, Forecast, band
from chemage_inference.result import (
    EXCLUDED,
    Inference,
    InferenceResult,
    quantities,
)
from chemage_inference.shape import (
    between,
    empty,
    peaks,
    rises,
    shares,
    trend,
    unresolved,
)

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

#: (name, text)
Rows = list[tuple[str, str]]
BLUE, ORANGE, GREEN, _, GREY, *_ = figures.PALETTE
#: load and temperature in words
CONDITIONS = "{:g} nN, {:g} K"
#: forecasts that are drawn into one panel
MOST = 4
#: what stands for a number that is not known
NONE = "-"
#: samples that have to agree on a slope
SURE = 0.95
#: scores that differ by less do not tell two models apart
APART = 2.0
#: name of the smooth density among the scores
SMOOTH = "density"
#: planned measurements that are shown
MOST_EXPERIMENTS = 5


def facts(one: Inference) -> Rows:
    """What the numbers are of; medians, and intervals of 90 % of the posterior."""
    count, times, kept = len(one.curves), one.hold_times, len(one.samples)
    low, high = one.visible_range
    worst = int(np.abs(one.residuals).argmax())
    conditions = [
        f"{times.size} points of {count} curve{'s' if count > 1 else ''}",
        f"{text.power_text(times.min())} to {text.power_text(times.max())} s",
        _several([curve["load"] for curve in one.curves], "nN"),
        _several([curve["temperature"] for curve in one.curves], "K"),
    ]
    visible = "none: at every energy the band is as wide as that of the prior"
    if one.visible.any():
        visible = f"{low:.3f} to {high:.3f} eV, resolution {one.resolution:.3f} eV"
    samples = (
        "{} kept, {effective_samples:.0f} effective, R-hat {r_hat:.3f}; seed {}"
    )
    rows = {
        "measured": ", ".join(conditions),
        "visible energies": visible,
        "density": density_text(one) if one.visible.any() else "",
        "largest residual": f"{one.residuals[worst]:+.1f} standard errors at {text.power_text(times[worst])} s",
        "suspect points": "; ".join(one.suspects()),
        "samples": samples.format(kept, one.seed, **one.diagnostics),
    }
    return [(name, text) for name, text in rows.items() if text]


def density_text(one: Inference) -> str:
    """The peaks that the data support, or how the density runs."""
    if not one.visible.any():
        return "nothing is visible"
    below, inside, above = (
        band(part, WIDE)[1] for part in between(one, one.visible_range)
    )
    if empty(one):
        sides = [
            side
            for side, most in (("below", below), ("above", above))
            if most > 0.01
        ]
        share = "0.1" if inside < 1e-3 else f"{100 * inside:.1f}"
        return f"hardly any inside (at most {share} % of the sites); barriers lie {' and '.join(sides)}"
    unsure = "".join(
        f"; the maximum at {energy:.3f} eV is not resolved"
        for energy in unresolved(one)
    )
    step = one.energies[1] - one.energies[0]
    if places := [peak.text(step) for peak in peaks(one)]:
        *others, last = places
        found = f"one peak at {last}"
        if others:
            found = f"{len(places)} peaks: {', '.join(others)} and {last}"
        sides = zip(("lower", "upper"), rises(one), strict=True)
        if ends := " and the ".join(end for end, up in sides if up):
            found += f"; rises again towards the {ends} end"
        return found + unsure
    up, down = trend(one)
    run = "rises" if up >= SURE else "falls" if down >= SURE else ""
    towards = (
        f"{run} towards the upper end of the visible energies"
        if run
        else "flat within the band"
    )
    return f"no peak {'that the data support' if unsure else 'inside'}; {towards}{unsure}"


def family_rows(one: Inference) -> list[tuple[str, str, str, str]]:
    """Models by their score, the best first: (name, score less that of the best, χ², parameters)."""
    if not one.scores:
        return []
    best = max(one.scores.values())
    rows = []
    for name, score in sorted(one.scores.items(), key=lambda item: -item[1]):
        less = "best" if score == best else f"{score - best:.1f}"
        if name == SMOOTH:
            rows.append(("smooth density", less, f"{one.chi2:.1f}", "as above"))
            continue
        fit = one.families.get(name, {})
        chi2 = f"{fit['chi2']:.1f}" if fit else ""
        about = _parameters(fit) if best - score <= EXCLUDED else "excluded"
        rows.append((name, less, chi2, about))
    return rows


def family_verdict(one: Inference) -> list[str]:
    """What the scores say, a sentence; none without scores."""
    if len(one.scores) < 2:
        return []
    best = max(one.scores.values())
    close = [name for name, score in one.scores.items() if best - score < APART]
    *others, last = (
        "the smooth density" if name == SMOOTH else name for name in close
    )
    if not others:
        return [f"Hold times that were left out are predicted best by {last}."]
    return [
        f"The data do not tell apart {', '.join(others)} and {last}: scores within {APART:g}."
    ]


def forecast_row(label: str, one: Forecast) -> tuple[str, str, str, str]:
    """(label, median of ΔF at the last hold time, its 68 and 90 % bands), or only bounds of 90 %."""
    name = f"{label} at {text.power_text(one.hold_times[-1])} s{unseen_text(one)}"
    inner, outer = (
        "{:.4g} to {:.4g}".format(*(end[-1] for end in one.band(level)))
        for level in (0.68, WIDE)
    )
    if one.bounds_only:
        return name, NONE, NONE, outer
    return name, f"{one.median[-1]:.4g} nN", inner, outer


def unseen_text(one: Forecast) -> str:
    """The largest share of a forecast that comes from energies which the data do not see, where it matters."""
    if one.unseen <= UNSEEN:
        return ""
    alone = ": bounds only" if one.bounds_only else ""
    return f" (up to {100 * one.unseen:.0f} % unseen{alone})"


def experiment_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    """(planned measurement, expected reduction of the variance, standard deviation afterwards)."""
    plan = [f"{text.power_text(float(one['hold_time']))} s"]
    for name, unit in (("load", "nN"), ("temperature", "K")):
        if name in one:
            plan.append(f"{one[name]:g} {unit}")
    falls, deviation = f"{100 * one['reduction']:.0f} %", f"{one['deviation']:.3g}"
    return ", ".join(plan), falls, deviation


def _parameters(fit: Mapping[str, Any]) -> str:
    texts = []
    for name, value in fit.get("parameters", {}).items():
        word, _, unit = name.removesuffix(")").partition(" (")
        error = fit["errors"].get(name, math.nan)
        texts.append(f"{word} {text.plus_minus(value, error, unit)}")
    return "; ".join(texts) if len(texts) <= 3 else f"{len(texts)} weights"


def _several(values: list[float], unit: str) -> str:
    different = sorted(set(values))
    if len(different) > 3:
        return f"{different[0]:g} to {different[-1]:g} {unit}"
    return f"{', '.join(f'{value:g}' for value in different)} {unit}"


def fill_bands(
    axes: Axes, x: np.ndarray, samples: np.ndarray, colour: str, label: str = ""
) -> None:
    """Draw the bands of ``samples`` (S, n) at ``x`` (n,); ``label`` has a place for the percentage."""
    for level, alpha in ((WIDE, 0.2), (0.68, 0.35)):
        name = label.format(100 * level) or None
        axes.fill_between(
            x, *band(samples, level), color=colour, alpha=alpha, lw=0, label=name
        )


def draw_density(axes: Axes, medium: object, one: Inference) -> None:
    """Draw the density with its bands, the visible energies shaded, families as lines, and the band of the prior."""
    e = one.energies
    low, high = one.visible_range
    if np.isfinite(low):
        axes.axvspan(low, high, color=GREEN, alpha=0.1, label="visible energies")
    fill_bands(axes, e, one.samples, BLUE, "{:.0f} % band")
    axes.plot(e, one.density, color=BLUE, label="mean")
    for fill_style, what, places in (
        ("full", "peak", [peak.energy for peak in peaks(one)]),
        ("none", "maximum, not resolved", unresolved(one)),
    ):
        if places:
            heights = np.interp(places, e, one.density)
            axes.plot(
                places, heights, "v", color=BLUE, fillstyle=fill_style, label=what
            )
    _, top = one.prior_band(WIDE)
    axes.plot(e, top, "--", color=GREY, label="prior, upper end of the 90 % band")
    families = _families(one).items()
    for dashes, (name, fit) in zip(("-", "--", ":", "-."), families, strict=False):
        density = fit["density"]
        label = figures.plain(name)
        axes.plot(e[: len(density)], density, dashes, color=ORANGE, label=label)
    seen = one.visible | (not one.visible.any())
    top = 1.6 * float(max(one.band(WIDE)[1][seen].max(), one.density.max()))
    beyond = 0.4 if np.isfinite(low) else np.inf
    axes.set_xlim(max(e[0], low - beyond), min(e[-1], high + beyond))
    axes.set_ylim(0, top or 1.0)
    axes.set(xlabel="forming barrier (eV)", ylabel="density (1/eV)")
    axes.set_title(density_text(one))
    figures.legend(axes, ncols=2)


def _families(one: Inference) -> dict[str, Mapping[str, Any]]:
    """The families that are drawn."""
    possible = one.possible_families()
    return {name: fit for name, fit in possible.items() if fit.get("density", ())}


def _curves(one: Inference) -> Iterator[tuple[str, str, str, np.ndarray]]:
    """Of each curve its name, its conditions in words, its colour, and the numbers of its points."""
    for number, about in enumerate(one.curves):
        key = about["load"], about["temperature"]
        here = np.flatnonzero(one.curve == number)
        yield about["name"], CONDITIONS.format(*key), _colours(one)[key], here


def _against_time(axes: Axes, ylabel: str = "friction drop ΔF (nN)") -> None:
    axes.set(xscale="log", xlabel="hold time (s)", ylabel=ylabel)


def draw_data(axes: Axes, medium: object, one: Inference) -> None:
    """Draw the measured friction drop and the bands of the fitted curves."""
    bars = statistics.NORMAL_LIMIT * one.errors
    for name, conditions, colour, here in _curves(one):
        times, fitted = one.hold_times[here], one.fitted[:, here]
        fill_bands(axes, times, fitted, colour)
        axes.plot(times, np.median(fitted, axis=0), color=colour)
        label = figures.plain(f"{name}: {conditions}")
        axes.errorbar(
            times,
            one.values[here],
            bars[here],
            fmt="o",
            ms=3,
            color=colour,
            label=label,
        )
    _ring(axes, one, one.values)
    _against_time(axes)
    axes.set_ylim(bottom=min(0.0, float((one.values - bars).min())))
    note = "points: measured, bars 95 %; bands: 68 and 90 %"
    figures.legend(axes, title=note, alignment="left")


def _ring(axes: Axes, one: Inference, values: np.ndarray) -> None:
    """Mark the suspect points."""
    if (off := one.is_suspect).any():
        times = one.hold_times[off]
        axes.plot(
            times, values[off], "o", ms=9, mfc="none", color=ORANGE, label="suspect"
        )


def draw_residuals(axes: Axes, medium: object, one: Inference) -> None:
    """Draw measured minus fitted in standard errors."""
    axes.axhspan(-2, 2, color=GREY, alpha=0.15)
    for *_, colour, here in _curves(one):
        axes.plot(
            one.hold_times[here], one.residuals[here], "o", ms=3, color=colour
        )
    _ring(axes, one, one.residuals)
    most = 1.15 * max(3.0, float(np.abs(one.residuals).max(initial=0)))
    axes.set_ylim(-most, most)
    _against_time(axes, "residual (standard errors)")


def draw_predictive(axes: Axes, medium: object, one: Inference) -> None:
    """Draw what prior and posterior predict of the measurements, the scatter of a measurement included."""
    rng = np.random.default_rng(0)
    for number, (*_, here) in enumerate(_curves(one)):
        times = one.hold_times[here]
        for samples, colour, what in (
            (one.prior_fitted, GREY, "prior, 90 % band"),
            (one.fitted, BLUE, "posterior with the errors of the data, 90 % band"),
        ):
            noise = rng.standard_normal((len(samples), here.size))
            ends = band(samples[:, here] + one.errors[here] * noise, WIDE)
            label = None if number else what
            axes.fill_between(
                times, *ends, color=colour, alpha=0.3, lw=0, label=label
            )
        label = None if number else "measured"
        axes.plot(
            times, one.values[here], "o", ms=3, color=figures.BLACK, label=label
        )
    _against_time(axes)
    figures.legend(axes)


def _colours(
    one: Inference, forecasts: Iterable[Forecast] = ()
) -> dict[tuple[float, float], str]:
    """Load and temperature -> colour: measured ones first, then those that are forecast."""
    conditions = [(about["load"], about["temperature"]) for about in one.curves]
    conditions += [(forecast.load, forecast.temperature) for forecast in forecasts]
    return dict(
        zip(dict.fromkeys(conditions), cycle(figures.PALETTE), strict=False)
    )


def draw_forecasts(
    axes: Axes,
    medium: object,
    one: Inference,
    of: Mapping[str, Forecast],
    shown: Sequence[str],
) -> None:
    """Draw the forecasts ``shown`` with their bands, and the measurements, with one colour for each load and
    temperature."""
    for _, conditions, colour, here in _curves(one):
        label = figures.plain(f"measured: {conditions}")
        times, values = one.hold_times[here], one.values[here]
        axes.plot(times, values, "o", ms=3, mfc="none", color=colour, label=label)
    colours = _colours(one, of.values())
    for label in shown:
        forecast = of[label]
        key = forecast.load, forecast.temperature
        colour, times = colours[key], forecast.hold_times
        low, high = forecast.band(WIDE)
        where = "" if "=" in label else f" ({CONDITIONS.format(*key)})"
        name = figures.plain(label + where + unseen_text(forecast))
        # a single hold time is a mark
        marker = "o" if times.size == 1 else ""
        if forecast.bounds_only:
            # a name for the first of the two
            ends, marker = np.transpose([low, high]), marker and "_"
            labels = [name, None]
            axes.plot(times, ends, "--", color=colour, marker=marker, label=labels)
            continue
        fill_bands(axes, times, forecast.samples, colour)
        axes.plot(times, forecast.median, color=colour, marker=marker, label=name)
        if marker:
            axes.vlines(times, low, high, color=colour)
    _against_time(axes)
    figures.from_zero(axes)
    figures.legend(axes, title="bands: 68 and 90 %", alignment="left")


def draw_scalar(axes: Axes, medium: object, one: Inference, scalar: str) -> None:
    """Draw the samples of an unknown, with the bounds of its prior."""
    values = one.scalars[scalar]
    low, high = one.scalar_bounds.get(scalar, (values.min(), values.max()))
    bins = list(np.linspace(low, high, 41))
    axes.hist(values, bins=bins, alpha=0.6, density=True)
    ends = low, high, *one.interval(scalar, WIDE)
    for end, colour in zip(ends, (GREY, GREY, ORANGE, ORANGE), strict=True):
        axes.axvline(end, color=colour)
    label = next(each.axis for each in quantities(one) if each.name == scalar)
    axes.set(xlabel=label, ylabel="density of the samples", yticks=[])
    axes.set_title("orange: 90 %; grey: bounds of the prior")


#: inches of one figure
_FILE = 6.4, 4.4
#: what errors are of chains that do not agree
NOT_CONVERGED = "no band of the posterior: chains have not converged"


@displays(InferenceResult)
class InferenceDisplay(OfRecord[Inference]):
    """An inference as users see it, with what was asked of it."""

    width = 80
    errors = "bands of the posterior: they contain the inferred errors, and neither undeclared ones nor those of the scene"
    please_cite = "Please cite these works:"

    def __init__(self, result: InferenceResult) -> None:
        super().__init__(result.inference)
        self.result = result
        if not result.inference.converged:
            self.errors = NOT_CONVERGED

    @property
    def title(self) -> str:
        names = ", ".join(dict.fromkeys(one["name"] for one in self.record.curves))
        what = names if len(names) < 40 else "measured curves"
        return f"Density of forming barriers inferred from {what}"

    @property
    def heading(self) -> str:
        one, bands = self.record, "medians, 90 % intervals"
        return f"{self.title}; {bands if one.converged else 'not converged'}"

    def facts(self) -> Rows:
        return facts(self.record)

    def quantities(self) -> list[Quantity]:
        return [*quantities(self.record), *shares(self.record)]

    def numbers(self) -> dict[str, Any]:
        return self.result.summary()

    def summary(self) -> Rows:
        low, high = self.record.visible_range
        seen = f"{low:.2f} to {high:.2f} eV" if math.isfinite(low) else "none"
        rows = [(seen, "energies that the data see")]
        if there := peaks(self.record):
            places = " and ".join(f"{peak.energy:.2f}" for peak in there)
            what = "peak" if len(there) == 1 else "peaks"
            rows.append((f"{places} eV", f"{what} of the density"))
        return [*rows, *super().summary()]

    def comparable(self) -> Comparable:
        def predict(
            load: float, temperature: float, hold_times: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            made = self.record.forecast(
                load=load, temperature=temperature, hold_times=hold_times
            )
            return made.median, np.atleast_2d(np.cov(made.samples.T))

        return Comparable(predict=predict)

    def notes(self) -> list[str]:
        of_forecasts = (
            f"forecast {label}: {note}"
            for label, one in self.result.forecasts.items()
            for note in one.notes
        )
        return [*self.record.notes, *dict.fromkeys(of_forecasts)]

    def completed(self, path: Path) -> InferenceDisplay:
        return InferenceDisplay(InferenceResult.read(path))

    def parts(self) -> dict[str, Result]:
        return {
            label: ForecastDisplay(one)
            for label, one in self.result.forecasts.items()
        }

    def made_by(self) -> Mapping[str, Any]:
        return {"scene": self.record.provenance.get("scene", {})}

    def stated(self) -> tuple[str, Mapping[str, Any]]:
        about = (
            "The scene that says everything but the density, in internal units (nm, nN, GPa, eV, s, K). Its section "
            "forming, its load, temperature and hold times were not used."
        )
        return about, self.made_by()["scene"]

    def tables(self) -> list[Table]:
        result, one, tables = self.result, self.record, []
        if families := family_rows(one):
            title = (
                "Left-out hold times: log predictive score less that of the best"
            )
            columns = "density", "log score", "χ²", "parameters"
            verdict = family_verdict(one)
            tables.append(Table(title, columns, families, "Families", verdict))
        if forecasts := [forecast_row(*each) for each in result.forecasts.items()]:
            columns = "forecast", "ΔF, median", "68 % (nN)", "90 % (nN)"
            title = "Forecasts of the friction drop"
            tables.append(Table(title, columns, forecasts, "Forecasts"))
        if plans := [experiment_row(each) for each in result.experiments]:
            columns = "measurement", "variance falls by", "standard deviation then"
            title = f"Next measurements, by how much they narrow {result.target}"
            head, most = "Next measurements", MOST_EXPERIMENTS
            tables.append(Table(title, columns, plans, head, most=most))
        printed = [replace(table, in_detail=False) for table in tables]
        measured = "hold time (s)", "curve", "ΔF (nN), standard error"
        columns = *measured, "fitted, 90 % (nN)", "residual"
        return [*printed, Table("", columns, self._measurements(), "Measurements")]

    def _measurements(self) -> list[tuple[str, ...]]:
        one = self.record
        low, high = band(one.fitted, WIDE)
        return [
            (
                f"{one.hold_times[at]:.5g}",
                f"{name}: {conditions}",
                f"{one.values[at]:.4g} ± {one.errors[at]:.2g}",
                f"{low[at]:.4g} to {high[at]:.4g}",
                f"{one.residuals[at]:+.1f}",
            )
            for name, conditions, _, here in _curves(one)
            for at in here
        ]

    def columns(self) -> dict[str, Any]:
        one = self.record
        bands = _band_columns(one, "1/eV")
        return {
            "energy (eV)": one.energies,
            "density (1/eV)": one.density,
            **bands,
            "visible": one.visible,
        }

    def provenance(self) -> Rows:
        one = self.record
        return [
            ("seed", str(one.seed)),
            *(
                (name.replace("_", " "), _short(value))
                for name, value in one.diagnostics.items()
            ),
            *super().provenance(),
        ]

    def pictures(self) -> dict[str, Picture]:
        one, forecasts = self.record, self.result.forecasts

        def panel(
            draw: Any, name: str, caption: str, alt: str, height: float, **more: Any
        ) -> Panel:
            drawn = partial(draw, one=one, **more)
            return Panel(drawn, caption, alt, (4.9, height), name=name)

        low, high = one.visible_range
        families = " Orange: families of densities." if _families(one) else ""
        density = panel(
            draw_density,
            "density",
            "Density of forming barriers: mean, 68 and 90 % bands of the posterior, and upper end of the 90 % band of "
            f"the prior (grey).{families} Outside the shaded energies the data tell sums only.",
            f"Density of barriers; visible from {low:.2f} to {high:.2f} eV: {density_text(one)}.",
            4.2,
        )
        data = panel(
            draw_data,
            "data",
            "Measured friction drop (bars: 95 %) with the 68 and 90 % bands of the fitted curves.",
            f"Measured friction drop, up to {one.values[np.argmax(one.hold_times)]:.3g} nN.",
            3.6,
        )
        residuals = panel(
            draw_residuals,
            "residuals",
            "Residuals in standard errors; shaded: two standard errors.",
            f"Residuals in standard errors; the largest is {np.abs(one.residuals).max():.1f}.",
            2.6,
        )
        predictive = panel(
            draw_predictive,
            "predictive",
            "What the prior and the posterior predict of the measurements, 90 % bands.",
            "Bands of what prior and posterior predict of the measurements.",
            3.6,
        )
        pictures = {
            "density": Picture([density], _FILE),
            "data": Picture([data, residuals], (6.4, 5.6), columns=1),
            "predictive": Picture([predictive], _FILE),
        }
        texts, every = [], list(forecasts)
        for each in forecasts.items():
            name, value, _, ends = forecast_row(*each)
            texts.append(f"{name}: {ends if value == NONE else value}")
        groups = [every[at : at + MOST] for at in range(0, len(every), MOST)]
        drawn = [
            panel(
                draw_forecasts,
                "-".join(some),
                "Forecasts at conditions that were not measured: median, 68 and 90 % bands of the posterior; dashed: "
                "bounds of 90 % where nearly all is unseen.",
                f"Forecasts: {'; '.join(texts)}.",
                3.6,
                of=forecasts,
                shown=some,
            )
            for some in groups
        ]
        if drawn:
            columns = min(len(drawn), 2)
            size = _FILE[0] * columns, _FILE[1] * -(-len(drawn) // columns)
            pictures["forecasts"] = Picture(drawn, size, columns)
        drawn = [
            panel(
                draw_scalar,
                name,
                "Samples of the unknown scalars within the bounds of their priors.",
                f"Histogram of the samples of {name}.",
                2.8,
                scalar=name,
            )
            for name in one.scalars
        ]
        if drawn:
            pictures["unknowns"] = Picture(drawn, (4.2 * len(drawn), 3.4))
        return pictures


@displays(Inference)
def inference_display(inference: Inference) -> InferenceDisplay:
    """An inference of which nothing more was asked."""
    return InferenceDisplay(InferenceResult(inference))


@displays(Forecast)
class ForecastDisplay(OfRecord[Forecast]):
    """A forecast as users see it."""

    def facts(self) -> Rows:
        one = self.record
        name, median, likely, sure = forecast_row("ΔF", one)
        conditions = (
            "temperature, load",
            f"{one.temperature:g} K, {one.load:g} nN",
        )
        return [conditions, (name, f"{median}; 68 %: {likely} nN, 90 %: {sure} nN")]

    def columns(self) -> dict[str, Any]:
        one = self.record
        return {
            "hold_time (s)": one.hold_times,
            "median (nN)": one.median,
            **_band_columns(one, "nN"),
        }


def _band_columns(one: Inference | Forecast, unit: str) -> dict[str, Any]:
    """The ends of the bands, for CSV."""
    ends = {}
    for level in (0.68, WIDE):
        for end, values in zip(("low", "high"), one.band(level), strict=True):
            ends[f"{end} {100 * level:.0f} % ({unit})"] = values
    return ends


def _short(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_short(item) for item in value) or NONE
    return f"{value:.4g}" if isinstance(value, float) else str(value)
