"""How an inference is shown: the density with its bands, scores of families, forecasts, and planned measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from chemage.foundation.names import __version__
from chemage.foundation.result import NONE, OfRecord, Panel, Picture, Result, Rows, Table, displays
from chemage.inference import figures, words
from chemage.inference.forecast import Forecast
from chemage.inference.result import Inference, InferenceResult
from chemage.inference.shape import peaks

#: inches of one figure, and of one panel on a page
_FILE, _PAGE = (6.4, 4.4), (4.9, 3.6)
_CAPTIONS = {
    "density": "Density of forming barriers: mean, 68 and 95 % bands of the posterior, families (orange), and upper "
    "end of the 95 % band of the prior (grey). Outside the shaded energies the data tell sums only.",
    "data": "Measured friction drop (bars: 95 %) with the 68 and 95 % bands of the fitted curves.",
    "residuals": "Residuals in standard errors; shaded: two standard errors.",
    "predictive": "What the prior and the posterior predict of the measurements, 95 % bands.",
    "forecasts": "Forecasts at conditions that were not measured: median, 68 and 95 % bands of the posterior; dashed: "
    "bounds of 95 % where nearly all is unseen.",
    "unknowns": "Samples of the unknown scalars within the bounds of their priors.",
}


@displays(InferenceResult)
class InferenceDisplay(Result):
    """An inference as users see it, with what was asked of it."""

    width = 80
    errors = "bands of the posterior: they contain the errors of the measurements, and not those of the scene"
    please_cite = "Please cite these works:"

    def __init__(self, result: InferenceResult) -> None:
        self.result, self.inference = result, result.inference

    @property
    def name(self) -> str:
        return "Inference"

    @property
    def title(self) -> str:
        return words.title(self.inference)

    @property
    def heading(self) -> str:
        return f"{self.title}; bands hold 95 %"

    @property
    def plugins(self) -> Mapping[str, str]:
        return self.inference.plugins

    def rows(self) -> Rows:
        return words.rows(self.inference)

    def numbers(self) -> dict[str, Any]:
        return self.result.summary()

    def summary(self, beside: bool = False) -> Rows:
        one = self.inference
        low, high = one.visible_range
        seen = f"{low:.2f} to {high:.2f} eV" if math.isfinite(low) else "none"
        rows = [(seen, "energies that the data see")]
        if there := peaks(one):
            places = " and ".join(f"{peak.energy:.2f}" for peak in there)
            rows.append((f"{places} eV", "peak of the density" if len(there) == 1 else "peaks of the density"))
        rows.append((f"{one.chi2:.1f} / {one.hold_times.size}", "χ² / measured points"))
        return [*rows, (f"{one.effective_parameters:.1f}", "effective parameters")]

    def notes(self) -> list[str]:
        of_forecasts = (
            f"forecast {label}: {note}" for label, one in self.result.forecasts.items() for note in one.notes
        )
        return list(dict.fromkeys([*self.inference.notes, *of_forecasts]))

    def parts(self) -> dict[str, Result]:
        return {label: ForecastDisplay(one) for label, one in self.result.forecasts.items()}

    def cite(self) -> tuple[list[str], str]:
        provenance = self.inference.provenance
        return list(provenance.get("cite", [])), provenance.get("versions", {}).get("chemage", __version__)

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
        if families := words.family_rows(one):
            columns = ("density", "log score", "χ²", "parameters")
            verdict = words.family_verdict(one)
            title = "Left-out hold times: log predictive score less that of the best"
            remarks = [f"{verdict[0].upper()}{verdict[1:]}."] if verdict else []
            tables.append(Table(title, columns, families, "Families", remarks, in_detail=False))
        if result.forecasts:
            columns = ("forecast", "ΔF, median", "68 % (nN)", "95 % (nN)")
            rows = [words.forecast_row(label, forecast) for label, forecast in result.forecasts.items()]
            tables.append(Table("Forecasts of the friction drop", columns, rows, "Forecasts", in_detail=False))
        if result.experiments:
            columns = ("measurement", "variance falls by", "standard deviation then")
            rows = [words.experiment_row(experiment) for experiment in result.experiments]
            title, most = f"Next measurements, by how much they narrow {result.target}", words.MOST_EXPERIMENTS
            tables.append(Table(title, columns, rows, "Next measurements", in_detail=False, most=most))
        return [*tables, self._measurements()]

    def _measurements(self) -> Table:
        one = self.inference
        low, high = (np.quantile(one.fitted, end, axis=0) for end in (0.025, 0.975))
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
        columns = ("hold time (s)", "curve", "ΔF (nN), standard error", "fitted, 95 % (nN)", "residual")
        return Table("", columns, rows, "Measurements")

    def columns(self) -> dict[str, Any]:
        one, bands = self.inference, {}
        for level in (0.68, 0.95):
            low, high = one.band(level)
            bands |= {f"low {100 * level:.0f} % (1/eV)": low, f"high {100 * level:.0f} % (1/eV)": high}
        return {"energy (eV)": one.energies, "density (1/eV)": one.density, **bands, "visible": one.visible}

    def provenance(self) -> Rows:
        one = self.inference
        return [
            ("seed", str(one.seed)),
            *((name.replace("_", " "), _short(value)) for name, value in one.diagnostics.items()),
            *((f"version of {name}", str(version)) for name, version in one.provenance.get("versions", {}).items()),
            *super().provenance(),
            ("content hash", one.digest()),
        ]

    def pictures(self) -> dict[str, Picture]:
        one, forecasts = self.inference, self.result.forecasts

        def panel(key: str, alt: str, draw: Any, height: float = _PAGE[1], **more: Any) -> Panel:
            return Panel(partial(draw, one=one, **more), _CAPTIONS[key], alt, (_PAGE[0], height))

        low, high = one.visible_range
        seen = f"Density of barriers; visible from {low:.2f} to {high:.2f} eV: {words.density_text(one)}."
        up_to = f"Measured friction drop, up to {one.values[np.argmax(one.hold_times)]:.3g} nN."
        worst = f"Residuals in standard errors; the largest is {np.abs(one.residuals).max():.1f}."
        predicted = "Bands of what prior and posterior predict of the measurements."
        data = panel("data", up_to, figures.draw_data), panel("residuals", worst, figures.draw_residuals, 2.6)
        pictures = {
            "density": Picture((panel("density", seen, figures.draw_density, 4.2),), _FILE),
            "data": Picture(data, (6.4, 5.6), columns=1),
            "predictive": Picture((panel("predictive", predicted, figures.draw_predictive),), _FILE),
        }
        if forecasts:
            rows = (words.forecast_row(label, forecast) for label, forecast in forecasts.items())
            texts = "; ".join(f"{label}: {end if value == NONE else value}" for label, value, _, end in rows)
            drawn = panel("forecasts", f"Forecasts: {texts}.", figures.draw_forecasts, forecasts=forecasts)
            pictures["forecasts"] = Picture((drawn,), _FILE)
        if one.scalars:
            drawn = [
                panel("unknowns", f"Histogram of the samples of {name}.", figures.draw_scalar, 2.8, name=name)
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

    def rows(self) -> Rows:
        one = self.record
        name, median, likely, sure = words.forecast_row("ΔF", one)
        conditions = ("temperature, load", f"{one.temperature:g} K, {one.load:g} nN")
        return [conditions, (name, f"{median}; 68 %: {likely} nN, 95 %: {sure} nN")]

    def columns(self) -> dict[str, Any]:
        one = self.record
        low, high = one.band()
        ends = {"low 95 % (nN)": low, "high 95 % (nN)": high}
        return {"hold_time (s)": one.hold_times, "median (nN)": one.median, **ends}


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
