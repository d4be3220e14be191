"""The sections of inferences in the page of a report."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.inference.result import InferenceResult
from chemage.inference.shape import peaks
from chemage.results import inference_figures as draw
from chemage.results import inference_text as words
from chemage.results.figures import blank
from chemage.results.files import read_inference
from chemage.results.page_parts import Part, Picture, Section, Table, markup, scene_toml, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what the errors of the page are
ERRORS = "Bands are those of the posterior: they contain the errors of the measurements, and not those of the scene."


def holds_inference(file: str | Path) -> bool:
    """Whether a file was written by ``chemage infer``; what cannot be read is refused where it is read."""
    import h5py

    try:
        if not Path(file).is_file():
            return False
        with h5py.File(file, "r") as opened:
            return "inference" in opened
    except (OSError, ValueError):
        return False


def inference_section(file: str | Path, key: str, name: str = "") -> tuple[Section, list[str], str]:
    """Make the section of an inference; with its references and its title."""
    made = read_inference(file)
    one = made.inference
    pictures = _pictures(made, key)
    table = Table("", ["quantity", "value"], words.rows(made), wide=True)
    parts = [
        Part(numbers=_main_numbers(made), figures=pictures[:1], notes=words.notes(made)),
        Part("Figures", figures=pictures[1:]),
        Part("Key numbers; bands hold 95 %", tables=[table]),
    ]
    if families := words.family_rows(one):
        columns = ["density", "log score", "χ²", "parameters"]
        caption = "Log predictive score of hold times that were left out, less that of the best"
        verdict = [f"{text[0].upper()}{text[1:]}."] if (text := words.family_verdict(one)) else []
        parts.append(Part("Families", paragraphs=verdict, tables=[Table(caption, columns, families, wide=True)]))
    if made.forecasts:
        columns = ["forecast", "ΔF, median", "68 % (nN)", "95 % (nN)"]
        found = [words.forecast_row(label, forecast) for label, forecast in made.forecasts.items()]
        parts.append(Part("Forecasts", tables=[Table("", columns, found, wide=True)]))
    if made.experiments:
        columns = ["measurement", "variance falls by", "standard deviation then"]
        found = [words.experiment_row(experiment) for experiment in made.experiments]
        parts.append(Part("Next measurements", tables=[Table(f"To narrow {made.target}", columns, found, wide=True)]))
    parts.append(Part("Measurements", tables=[_data_table(made)]))
    if scene := one.provenance.get("scene"):
        about = (
            "The scene that says everything but the density, in internal units (nm, nN, GPa, eV, s, K). Its section "
            "forming, its load, temperature and hold times were not used."
        )
        parts.append(Part("Scene", paragraphs=[about], code=scene_toml(_stated(scene))))
    parts.append(Part("Provenance", tables=[_provenance(made, file)]))
    title = words.title(made)
    return Section(key, name or title, parts=parts), list(one.provenance.get("cite", [])), title


def _stated(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Scene data without what is None, for which TOML has no word."""
    return {
        name: _stated(value) if isinstance(value, Mapping) else value
        for name, value in scene.items()
        if value is not None
    }


def _main_numbers(made: InferenceResult) -> list[tuple[str, str]]:
    one = made.inference
    low, high = one.visible_range
    seen = f"{low:.2f} to {high:.2f} eV" if math.isfinite(low) else "none"
    found = [(seen, "energies that the data see")]
    if there := peaks(one):
        places = " and ".join(f"{peak.energy:.2f}" for peak in there)
        found.append((f"{places} eV", "peak of the density" if len(there) == 1 else "peaks of the density"))
    found.append((f"{one.chi2:.1f} / {one.hold_times.size}", "χ² / measured points"))
    found.append((f"{one.effective_parameters:.1f}", "effective parameters"))
    return found


def _pictures(made: InferenceResult, key: str) -> list[Picture]:
    one, found = made.inference, []

    def add(name: str, alt: str, paint: Callable[[Axes], None], height: float = draw.SIZE[1]) -> None:
        figure, axes = blank(draw.SIZE[0], height)
        paint(axes)
        caption = draw.CAPTIONS.get(name.partition("-")[0], "")
        found.append(Picture(markup(svg(figure, alt, f"{key}-{name}")), caption))

    low, high = one.visible_range
    alt = f"Density of barriers; visible from {low:.2f} to {high:.2f} eV: {words.density_text(one)}."
    add("density", alt, lambda axes: draw.draw_density(axes, one, 6.5), 4.2)
    last = one.values[np.argmax(one.hold_times)]
    add("data", f"Measured friction drop, up to {last:.3g} nN.", lambda axes: draw.draw_data(axes, one, 7))
    alt = f"Residuals in standard errors; the largest is {np.abs(one.residuals).max():.1f}."
    add("residuals", alt, lambda axes: draw.draw_residuals(axes, one), 2.6)
    alt = "Bands of what prior and posterior predict of the measurements."
    add("predictive", alt, lambda axes: draw.draw_predictive(axes, one, 7))
    if made.forecasts:
        rows = (words.forecast_row(label, forecast) for label, forecast in made.forecasts.items())
        texts = "; ".join(f"{label}: {end if value == words.NONE else value}" for label, value, _, end in rows)
        add("forecasts", f"Forecasts: {texts}.", lambda axes: draw.draw_forecasts(axes, made, 6.5))
    for name in one.scalars:
        paint = partial(draw.draw_scalar, one=one, name=name)
        add(f"unknowns-{name}", f"Histogram of the samples of {name}.", paint, 2.8)
    return found


def _data_table(made: InferenceResult) -> Table:
    one = made.inference
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
    columns = ["hold time (s)", "curve", "ΔF (nN), standard error", "fitted, 95 % (nN)", "residual"]
    return Table("", columns, rows, wide=True)


def _provenance(made: InferenceResult, file: str | Path) -> Table:
    one = made.inference
    rows = [
        ("file", str(file)),
        ("seed", str(one.seed)),
        *((name.replace("_", " "), _short(value)) for name, value in one.diagnostics.items()),
        *((f"version of {name}", str(version)) for name, version in one.provenance.get("versions", {}).items()),
        *((f"plugin {name}", source) for name, source in one.plugins.items()),
        ("content hash", one.digest()),
    ]
    return Table("", ["item", "value"], rows)


def _short(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_short(item) for item in value) or "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
