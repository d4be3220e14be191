"""How an inference is shown: the density with its bands, scores of families, forecasts, and planned measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage import __version__
from chemage.plugin import (
    Ageing,
    OfRecord,
    Panel,
    Picture,
    Quantity,
    Result,
    Table,
    displays,
    figures,
    statistics,
)
from chemage_inference.forecast import WIDE, Forecast, band
from chemage_inference.result import (
    Inference,
    InferenceResult,
    quantities,
    unit_of,
)
from chemage_inference.shape import (
    peaks,
    unresolved,
)
from chemage_inference.wording import (
    MOST_EXPERIMENTS,
    NONE,
    Rows,
    density_text,
    experiment_row,
    facts,
    family_rows,
    family_verdict,
    forecast_row,
    title,
    unseen_text,
)

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

#: forecasts that are drawn into one panel
MOST = 4
_LINES = ("-", "--", ":", "-.")


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
        axes.axvspan(
            low,
            high,
            color=figures.GREEN,
            alpha=0.10,
            lw=0,
            label="visible energies",
            zorder=0,
        )
    fill_bands(axes, e, one.samples, figures.BLUE, "{:.0f} % band")
    axes.plot(e, one.density, color=figures.BLUE, lw=1.6, label="mean")
    for fill_style, what, places in (
        ("full", "peak", [peak.energy for peak in peaks(one)]),
        ("none", "maximum, not resolved", unresolved(one)),
    ):
        if places:
            heights = np.interp(places, e, one.density)
            axes.plot(
                places,
                heights,
                "v",
                color=figures.BLUE,
                fillstyle=fill_style,
                ms=7,
                label=what,
            )
    prior = one.prior_band(WIDE)
    axes.plot(
        e,
        prior[1],
        color=figures.GREY,
        lw=0.9,
        ls="--",
        label="prior, upper end of the 90 % band",
    )
    for number, (name, fit) in enumerate(one.possible_families().items()):
        if density := fit.get("density", ()):
            axes.plot(
                e[: len(density)],
                density,
                color=figures.ORANGE,
                lw=1.0,
                ls=_LINES[number % len(_LINES)],
                label=figures.plain(name),
            )
    seen = one.visible if one.visible.any() else np.ones(e.size, dtype=bool)
    top = 1.6 * float(max(one.band(WIDE)[1][seen].max(), one.density.max()))
    beyond = 0.4 if np.isfinite(low) else np.inf
    axes.set_xlim(max(e[0], low - beyond), min(e[-1], high + beyond))
    axes.set_ylim(0, top or 1.0)
    axes.set(xlabel="forming barrier (eV)", ylabel="density (1/eV)")
    axes.set_title(density_text(one))
    figures.legend(axes, ncols=2)


def draw_data(axes: Axes, medium: object, one: Inference) -> None:
    """Draw the measured friction drop and the bands of the fitted curves."""
    for number, about in enumerate(one.curves):
        colour, here = _colour(one, about), one.curve == number
        order = np.argsort(one.hold_times[here], kind="stable")
        times, fitted = one.hold_times[here][order], one.fitted[:, here][:, order]
        fill_bands(axes, times, fitted, colour)
        axes.plot(times, np.median(fitted, axis=0), color=colour, lw=1.0)
        label = figures.plain(
            f"{about['name']}: {about['load']:g} nN, {about['temperature']:g} K"
        )
        bars = statistics.NORMAL_LIMIT * one.errors[here]
        axes.errorbar(
            one.hold_times[here],
            one.values[here],
            bars,
            fmt="o",
            ms=3.2,
            lw=0.9,
            color=colour,
            label=label,
        )
    _ring(axes, one, one.values)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    axes.set_ylim(
        bottom=min(
            0.0, float((one.values - statistics.NORMAL_LIMIT * one.errors).min())
        )
    )
    figures.legend(
        axes, title="points: measured, bars 95 %; bands: 68 and 90 %", alignment="left"
    )


def _ring(axes: Axes, one: Inference, values: np.ndarray) -> None:
    """Mark the suspect points."""
    if (off := one.is_suspect).any():
        axes.plot(
            one.hold_times[off],
            values[off],
            "o",
            ms=9,
            mfc="none",
            color=figures.ORANGE,
            label="suspect",
        )


def draw_residuals(axes: Axes, medium: object, one: Inference) -> None:
    """Draw measured minus fitted in standard errors."""
    residuals = one.residuals
    axes.axhspan(-2, 2, color=figures.GREY, alpha=0.15, lw=0)
    axes.axhline(0, color=figures.GREY, lw=0.8)
    for number in range(len(one.curves)):
        here = one.curve == number
        axes.plot(
            one.hold_times[here],
            residuals[here],
            "o",
            ms=3.2,
            color=_colour(one, one.curves[number]),
        )
    _ring(axes, one, residuals)
    most = 1.15 * max(3.0, float(np.abs(residuals).max(initial=0)))
    axes.set_ylim(-most, most)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="residual (standard errors)")


def draw_predictive(axes: Axes, medium: object, one: Inference) -> None:
    """Draw what prior and posterior predict of the measurements, the scatter of a measurement included."""
    rng = np.random.default_rng(0)
    for number in range(len(one.curves)):
        here = np.flatnonzero(one.curve == number)
        here = here[np.argsort(one.hold_times[here], kind="stable")]
        times = one.hold_times[here]
        for samples, colour, alpha, what in (
            (one.prior_fitted, figures.GREY, 0.25, "prior, 90 % band"),
            (
                one.fitted,
                figures.BLUE,
                0.35,
                "posterior with the errors of the data, 90 % band",
            ),
        ):
            values = samples[:, here] + one.errors[here] * rng.standard_normal(
                (len(samples), here.size)
            )
            label = what if number == 0 else None
            axes.fill_between(
                times, *band(values, WIDE), color=colour, alpha=alpha, lw=0, label=label
            )
        axes.plot(
            times,
            one.values[here],
            "o",
            ms=3,
            color=figures.BLACK,
            label="measured" if number == 0 else None,
        )
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    figures.legend(axes)


def _colour(
    one: Inference,
    curve: Mapping[str, Any],
    forecasts: Mapping[str, Forecast] | None = None,
) -> str:
    """The colour of a load and a temperature: measured ones first, then those that are forecast."""
    conditions = [(about["load"], about["temperature"]) for about in one.curves]
    conditions += [
        (forecast.load, forecast.temperature) for forecast in (forecasts or {}).values()
    ]
    return figures.PALETTE[
        list(dict.fromkeys(conditions)).index((curve["load"], curve["temperature"]))
        % len(figures.PALETTE)
    ]


def draw_forecasts(
    axes: Axes,
    medium: object,
    one: Inference,
    forecasts: Mapping[str, Forecast],
    shown: Sequence[str],
) -> None:
    """Draw the forecasts ``shown`` with their bands, and the measurements, with one colour for each load and
    temperature."""
    for number, about in enumerate(one.curves):
        here = one.curve == number
        style = {"ms": 3.0, "mfc": "none", "color": _colour(one, about)}
        label = figures.plain(
            f"measured: {about['load']:g} nN, {about['temperature']:g} K"
        )
        axes.plot(one.hold_times[here], one.values[here], "o", label=label, **style)
    for label in shown:
        forecast = forecasts[label]
        colour = _colour(
            one, {"load": forecast.load, "temperature": forecast.temperature}, forecasts
        )
        times = forecast.hold_times
        conditions = f" ({forecast.load:g} nN, {forecast.temperature:g} K)"
        name = figures.plain(
            label + conditions * ("=" not in label) + unseen_text(forecast)
        )
        low, high = forecast.band(WIDE)
        single = times.size == 1
        if forecast.bounds_only:
            style = (
                {"marker": "_", "ms": 9, "lw": 0} if single else {"ls": "--", "lw": 1.0}
            )
            axes.plot(times, low, color=colour, label=name, **style)
            axes.plot(times, high, color=colour, **style)
            continue
        fill_bands(axes, times, forecast.samples, colour)
        axes.plot(
            times,
            forecast.median,
            color=colour,
            lw=1.3,
            label=name,
            **({"marker": "o", "ms": 4} if single else {}),
        )
        if single:
            axes.vlines(times, low, high, color=colour, lw=1.2)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction drop ΔF (nN)")
    figures.from_zero(axes)
    figures.legend(axes, title="bands: 68 and 90 %", alignment="left")


def draw_scalar(axes: Axes, medium: object, one: Inference, name: str) -> None:
    """Draw the samples of an unknown, with the bounds of its prior."""
    values = one.scalars[name]
    low, high = one.scalar_bounds.get(name, (float(values.min()), float(values.max())))
    axes.hist(
        values,
        bins=list(np.linspace(low, high, 41)),
        color=figures.BLUE,
        alpha=0.6,
        density=True,
    )
    for end in (low, high):
        axes.axvline(end, color=figures.GREY, lw=0.9, ls="--")
    for end in one.interval(name, WIDE):
        axes.axvline(end, color=figures.ORANGE, lw=1.0)
    axes.set(
        xlabel=Quantity(name, unit_of(name), name.replace("_", " ")).axis,
        ylabel="density of the samples",
    )
    axes.set_title("orange: 90 %; grey: bounds of the prior")
    axes.set_yticks([])


#: inches of one figure, and of one panel on a page
_FILE, _PAGE = (6.4, 4.4), (4.9, 3.6)
_CAPTIONS = {
    "density": "Density of forming barriers: mean, 68 and 90 % bands of the posterior, and upper end of the 90 % band "
    "of the prior (grey).{families} Outside the shaded energies the data tell sums only.",
    "data": "Measured friction drop (bars: 95 %) with the 68 and 90 % bands of the fitted curves.",
    "residuals": "Residuals in standard errors; shaded: two standard errors.",
    "predictive": "What the prior and the posterior predict of the measurements, 90 % bands.",
    "forecasts": "Forecasts at conditions that were not measured: median, 68 and 90 % bands of the posterior; dashed: "
    "bounds of 90 % where nearly all is unseen.",
    "unknowns": "Samples of the unknown scalars within the bounds of their priors.",
}


@displays(InferenceResult)
class InferenceDisplay(OfRecord[Inference]):
    """An inference as users see it, with what was asked of it."""

    width = 80
    errors = "bands of the posterior: they contain the errors of the measurements, and not those of the scene"
    please_cite = "Please cite these works:"

    def __init__(self, result: InferenceResult) -> None:
        super().__init__(result.inference)
        self.result, self.inference = result, result.inference

    @property
    def title(self) -> str:
        return title(self.inference)

    @property
    def heading(self) -> str:
        return f"{self.title}; medians, 90 % intervals"

    def facts(self) -> Rows:
        return facts(self.inference)

    def quantities(self) -> list[Quantity]:
        return quantities(self.inference)

    def numbers(self) -> dict[str, Any]:
        return self.result.summary()

    def summary(self) -> Rows:
        one = self.inference
        low, high = one.visible_range
        seen = f"{low:.2f} to {high:.2f} eV" if math.isfinite(low) else "none"
        rows = [(seen, "energies that the data see")]
        if there := peaks(one):
            places = " and ".join(f"{peak.energy:.2f}" for peak in there)
            rows.append(
                (
                    f"{places} eV",
                    "peak of the density"
                    if len(there) == 1
                    else "peaks of the density",
                )
            )
        return [*rows, *super().summary()]

    def ageing(self) -> Ageing:
        def predict(
            load: float, temperature: float, hold_times: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            made = self.inference.forecast(
                load=load, temperature=temperature, hold_times=hold_times
            )
            return made.median, np.atleast_2d(np.cov(made.samples.T))

        return Ageing(predict=predict)

    def notes(self) -> list[str]:
        of_forecasts = (
            f"forecast {label}: {note}"
            for label, one in self.result.forecasts.items()
            for note in one.notes
        )
        return list(dict.fromkeys([*self.inference.notes, *of_forecasts]))

    def completed(self, path: Path) -> InferenceDisplay:
        return InferenceDisplay(InferenceResult.read(path))

    def parts(self) -> dict[str, Result]:
        return {
            label: ForecastDisplay(one) for label, one in self.result.forecasts.items()
        }

    def cite(self) -> tuple[list[str], str]:
        provenance = self.inference.provenance
        return list(provenance.get("cite", [])), provenance.get("versions", {}).get(
            "chemage", __version__
        )

    def made_by(self) -> Mapping[str, Any]:
        return {"scene": self.inference.provenance.get("scene", {})}

    def stated(self) -> tuple[str, Mapping[str, Any]]:
        about = (
            "The scene that says everything but the density, in internal units (nm, nN, GPa, eV, s, K). Its section "
            "forming, its load, temperature and hold times were not used."
        )
        return about, _without_none(self.inference.provenance.get("scene") or {})

    def tables(self) -> list[Table]:
        result, one, tables = self.result, self.inference, []
        if families := family_rows(one):
            columns = ("density", "log score", "χ²", "parameters")
            verdict = family_verdict(one)
            title = "Left-out hold times: log predictive score less that of the best"
            remarks = [f"{verdict[0].upper()}{verdict[1:]}."] if verdict else []
            tables.append(
                Table(title, columns, families, "Families", remarks, in_detail=False)
            )
        if result.forecasts:
            columns = ("forecast", "ΔF, median", "68 % (nN)", "90 % (nN)")
            rows = [
                forecast_row(label, forecast)
                for label, forecast in result.forecasts.items()
            ]
            tables.append(
                Table(
                    "Forecasts of the friction drop",
                    columns,
                    rows,
                    "Forecasts",
                    in_detail=False,
                )
            )
        if result.experiments:
            columns = ("measurement", "variance falls by", "standard deviation then")
            rows = [experiment_row(experiment) for experiment in result.experiments]
            title = f"Next measurements, by how much they narrow {result.target}"
            most = MOST_EXPERIMENTS
            tables.append(
                Table(
                    title,
                    columns,
                    rows,
                    "Next measurements",
                    in_detail=False,
                    most=most,
                )
            )
        return [*tables, self._measurements()]

    def _measurements(self) -> Table:
        one = self.inference
        low, high = (np.quantile(one.fitted, end, axis=0) for end in (0.05, 0.95))
        rows = []
        for at in range(one.hold_times.size):
            about = one.curves[int(one.curve[at])]
            rows.append(
                (
                    f"{one.hold_times[at]:.5g}",
                    f"{about['name']}: {about['load']:g} nN, {about['temperature']:g} K",
                    f"{one.values[at]:.4g} ± {one.errors[at]:.2g}",
                    f"{low[at]:.4g} to {high[at]:.4g}",
                    f"{one.residuals[at]:+.1f}",
                )
            )
        columns = (
            "hold time (s)",
            "curve",
            "ΔF (nN), standard error",
            "fitted, 90 % (nN)",
            "residual",
        )
        return Table("", columns, rows, "Measurements")

    def columns(self) -> dict[str, Any]:
        one = self.inference
        bands = _band_columns(one, "1/eV")
        return {
            "energy (eV)": one.energies,
            "density (1/eV)": one.density,
            **bands,
            "visible": one.visible,
        }

    def provenance(self) -> Rows:
        one = self.inference
        return [
            ("seed", str(one.seed)),
            *(
                (name.replace("_", " "), _short(value))
                for name, value in one.diagnostics.items()
            ),
            *(
                (f"version of {name}", str(version))
                for name, version in one.provenance.get("versions", {}).items()
            ),
            *super().provenance(),
        ]

    def pictures(self) -> dict[str, Picture]:
        one, forecasts = self.inference, self.result.forecasts

        def panel(
            key: str, alt: str, draw: Any, height: float = _PAGE[1], **more: Any
        ) -> Panel:
            size = (_PAGE[0], height)
            caption = _CAPTIONS[key].format(families=families)
            return Panel(
                partial(draw, one=one, **more),
                caption,
                alt,
                size,
                name=more.get("name", key),
            )

        drawn_families = [
            fit for fit in one.possible_families().values() if fit.get("density", ())
        ]
        families = " Orange: families of densities." if drawn_families else ""
        low, high = one.visible_range
        seen = f"Density of barriers; visible from {low:.2f} to {high:.2f} eV: {density_text(one)}."
        up_to = f"Measured friction drop, up to {one.values[np.argmax(one.hold_times)]:.3g} nN."
        worst = f"Residuals in standard errors; the largest is {np.abs(one.residuals).max():.1f}."
        predicted = "Bands of what prior and posterior predict of the measurements."
        data = (
            panel("data", up_to, draw_data),
            panel("residuals", worst, draw_residuals, 2.6),
        )
        pictures = {
            "density": Picture((panel("density", seen, draw_density, 4.2),), _FILE),
            "data": Picture(data, (6.4, 5.6), columns=1),
            "predictive": Picture(
                (panel("predictive", predicted, draw_predictive),), _FILE
            ),
        }
        if forecasts:
            rows = (
                forecast_row(label, forecast) for label, forecast in forecasts.items()
            )
            texts = "; ".join(
                f"{label}: {end if value == NONE else value}"
                for label, value, _, end in rows
            )
            every, drawn = list(forecasts), []
            for first in range(0, len(every), MOST):
                shown = every[first : first + MOST]
                panel_ = panel(
                    "forecasts",
                    f"Forecasts: {texts}.",
                    draw_forecasts,
                    forecasts=forecasts,
                    shown=shown,
                )
                drawn.append(replace(panel_, name="-".join(shown)))
            columns = min(len(drawn), 2)
            rows_ = -(-len(drawn) // columns)
            pictures["forecasts"] = Picture(
                drawn, (_FILE[0] * columns, _FILE[1] * rows_), columns
            )
        if one.scalars:
            drawn = [
                panel(
                    "unknowns",
                    f"Histogram of the samples of {name}.",
                    draw_scalar,
                    2.8,
                    name=name,
                )
                for name in one.scalars
            ]
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
        conditions = ("temperature, load", f"{one.temperature:g} K, {one.load:g} nN")
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


def _without_none(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Scene data without what is None, for which TOML has no word."""
    return {
        name: _without_none(value) if isinstance(value, Mapping) else value
        for name, value in scene.items()
        if value is not None
    }


def _short(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_short(item) for item in value) or NONE
    return f"{value:.4g}" if isinstance(value, float) else str(value)
