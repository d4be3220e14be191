"""How an ensemble is shown: its estimates with their intervals, and the parts of their errors by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.display import FIGURES, ON_ONE_SURFACE, TIMES
from chemage.ageing.fitting import short_doubt, span_text
from chemage.contacts.display import COMPARED, compared_measures
from chemage.contacts.options import force_text
from chemage.foundation.figures import BLUE, GREY, ORANGE, from_zero, legend, plain
from chemage.foundation.names import __version__
from chemage.foundation.result import (
    FILE,
    NONE,
    Compared,
    Curve,
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    Table,
    displays,
)
from chemage.foundation.text import jsonable, percent, plus_minus, power_text, with_error
from chemage.scene.display import chemistry_of_scene, of_scene
from chemage.studies.ensembles.ensemble import SOURCES, Ensemble, ErrorPart, Estimate
from chemage.studies.ensembles.goals import column_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what the errors of a mean over surfaces are
OVER_SURFACES = "95 % intervals (Student's t) that include the scatter between surfaces"
#: what every ± of an ensemble is
TITLE = "± is half the width of a 95 % interval"
#: relative differences that rounding makes
EXACT = 1e-12
#: more single surfaces are not drawn, of those there are the first
MOST_CURVES = 200
#: seeds of samples that are shown
_SEEDS = 10
#: curves -> (symbol, unit in tables)
_CURVES = {"friction_drop": ("ΔF", "nN"), "friction_coefficient_drop": ("Δμ", "")}


@displays(Ensemble)
class EnsembleDisplay(OfRecord[Ensemble]):
    """An ensemble as users see it."""

    def __init__(self, ensemble: Ensemble) -> None:
        super().__init__(ensemble)
        self.errors = OVER_SURFACES if ensemble.random else ON_ONE_SURFACE

    @property
    def name(self) -> str:
        return self.record.name

    @property
    def title(self) -> str:
        return self.record.title

    @property
    def heading(self) -> str:
        return f"{self.title}: {TITLE}"

    @property
    def scene(self) -> Mapping[str, Any]:
        return self.record.provenance.get("scene", {})

    @property
    def over(self) -> str:
        """What the mean is over, in few words."""
        ensemble = self.record
        if ensemble.controlled:
            return f"{ensemble.surfaces} surfaces and {ensemble.levels[-1]['samples']} sketches"
        return f"{ensemble.surfaces} surfaces" if ensemble.random else f"{ensemble.surfaces} replicas on one surface"

    @property
    def ages(self) -> bool:
        """Whether there is a curve to draw against hold time."""
        return bool((self.record.hold_times > 0).any())

    # -- words and numbers --------------------------------------------------------------------------------------------

    def rows(self) -> Rows:
        """What was averaged, the main estimates with their intervals, and the parts of the error of the first."""
        ensemble, names = self.record, self.record.quantities.names
        rows = self._averaged()
        if "beta" in names:
            span = "{:g} to {:g} s".format(*ensemble.quantities.span)
            fitted = f", {int(ensemble.quantities.fitted.sum())} hold times from {span}"
            rows.append(("beta", self._text("beta", None, "per decade") + fitted))
            rows.append(("b = beta/ln 10", plus_minus(ensemble.b.value, ensemble.b.half_width, "per e-fold")))
        for curve, (_, unit) in _CURVES.items():
            if curve in names:
                for time in self._moments():
                    rows.append((f"{curve.replace('_', ' ')} at {time:g} s", self._text(curve, time, unit)))
        if "area_fraction" in names:
            rows.append(("area fraction A/A0", self._text("area_fraction")))
        wanted = [name for name in ensemble.quantities.measures if name in ensemble.goals and name != "area_fraction"]
        rows += [(name.replace("_", " "), self._text(name)) for name in wanted]
        for part, size, how in error_parts(ensemble.estimate(names[0])):
            text = f"{size} (standard error)" if size.endswith("%") else size
            rows.append((f"error of {names[0]}: {part}", f"{text}, {how}"))
        rows += self.remarks()
        rows += [(f"plugin {name}", source) for name, source in ensemble.plugins.items()]
        return rows + ([("ended because", ensemble.stopped)] if ensemble.stopped else [])

    def _averaged(self) -> Rows:
        """What was averaged, with its grids and replicas."""
        first, *others = self.record.levels
        mean = f"{first['samples']} random surfaces: {first['words']} each"
        if not self.record.random:
            mean = f"{first['samples']} replicas on the one surface: {first['words'].partition(',')[0]}"
        rows = [("mean over", mean)]
        for level in others:
            of = f"{level['samples']} surfaces: {level['words']}"
            if level.get("control"):
                rows.append(("regressed on", f"the area of the contact of {of}"))
            else:
                rows.append(("corrected by", f"{level['samples']} of these differences: {level['words']}"))
        return rows

    def _moments(self) -> list[float]:
        """The hold times that are shown: the last, and those that were asked for."""
        ensemble = self.record
        if not ensemble.hold_times.size:
            return []
        first = int(ensemble.quantities.has_beta)
        columns = {column_of(name, ensemble.quantities) - first for name in ensemble.goals}
        chosen = {number for number in columns if 0 <= number < ensemble.hold_times.size}
        return [float(ensemble.hold_times[number]) for number in sorted({*chosen, ensemble.hold_times.size - 1})]

    def _text(self, name: str, time: float | None = None, unit: str = "") -> str:
        """An estimate with its interval, and what was asked for."""
        estimate, ensemble = self.record.estimate(name, time), self.record
        text = interval_text(estimate, unit)
        if math.isfinite(estimate.relative) and estimate.half_width > EXACT * abs(estimate.value):
            relative = estimate.relative
            text += f", ± {percent(relative)}" if relative < 1 else ", not distinguishable from 0"
        column = ensemble.quantities.column(name, time)
        for goal, size in ensemble.goals.items():
            if goal.partition("@")[0].strip() == name and column_of(goal, ensemble.quantities) == column:
                text += f" ({100 * size:.3g} % asked)"
        return text

    def numbers(self) -> dict[str, Any]:
        return jsonable(self.record.summary())

    def cite(self) -> tuple[list[str], str]:
        provenance = self.record.provenance
        return list(provenance.get("cite", [])), provenance.get("versions", {}).get("chemage", __version__)

    def summary(self, beside: bool = False) -> Rows:
        ensemble, names, rows = self.record, self.record.quantities.names, []
        sure = f"95 % interval, mean over {self.over}"
        curve = next((name for name in reversed(_CURVES) if name in names), None)
        if curve is not None:
            inside = [time for time in TIMES if ensemble.hold_times[0] <= time <= ensemble.hold_times[-1]]
            time = inside[-1] if inside else float(ensemble.hold_times[-1])
            if (drop := self.estimate(curve, time)) is not None:
                symbol, unit = _CURVES[curve]
                rows.append(
                    (plus_minus(drop.value, drop.half_width, unit), f"{symbol} at {power_text(time)} s, {sure}")
                )
        if "beta" in names:
            beta, span = ensemble.estimate("beta"), span_text(ensemble.quantities.span)
            rows.append((plus_minus(beta.value, beta.half_width), f"β per decade, line fitted {span}, {sure}"))
        more = () if curve else (("mean_contact_pressure", "mean contact pressure", "GPa"), ("patches", "patches", ""))
        for name, words, unit in (("area_fraction", "area fraction A/A₀", ""), *more):
            if (area := self.estimate(name)) is not None and math.isfinite(area.value):
                known = math.isfinite(area.half_width)
                rows.append((plus_minus(area.value, area.half_width, unit) if known else f"{area.value:.3g}", words))
        return rows

    def stated(self) -> tuple[str, Mapping[str, Any]]:
        about, scene = super().stated()
        return f"{about.rstrip('.')}, but for a budget of time, which ends where the time does.", scene

    def tables(self) -> list[Table]:
        ensemble, names = self.record, self.record.quantities.names
        wanted = [name.partition("@")[0].strip() for name in ensemble.goals]
        usual = [name for name in ("beta", "friction_coefficient_drop", "area_fraction") if name in names]
        rows = []
        for name in dict.fromkeys([*usual, *wanted]):
            words = "β" if name == "beta" else name.replace("_", " ")
            when = f" at {ensemble.hold_times[-1]:g} s" if name.endswith("_drop") else ""
            rows += [(words + when, size, part, how) for part, size, how in error_parts(ensemble.estimate(name))]
        columns = ["of", "size", "due to", "how it is known"]
        tables = [Table("Standard errors by name", columns, rows, "Parts of the error")]
        curves = {name: text for name, text in _CURVES.items() if name in names}
        if ensemble.hold_times.size:
            headings = [f"{symbol} ({unit})" if unit else symbol for symbol, unit in curves.values()]
            rows = [
                (f"{time:.6g}", *(interval_text(ensemble.estimate(name, time)) for name in curves))
                for time in ensemble.hold_times.tolist()
            ]
            title = f"Means over {self.over} with 95 % intervals (Student's t)"
            tables.append(Table(title, ["hold time (s)", *headings], rows, "Friction against hold time"))
        if ensemble.measures:
            rows = [(name.replace("_", " "), interval_text(ensemble.estimate(name))) for name in ensemble.measures]
            title = "Means with 95 % intervals, in internal units (nm, nN, GPa)"
            rows = [row for row in rows if row[1] != NONE]
            tables.append(Table(title, ["measure", "mean"], rows, "Contact"))
        return tables

    def columns(self) -> dict[str, Any]:
        columns: dict[str, Any] = {"hold_time (s)": self.record.hold_times}
        for name, values in self.record.curves().items():
            in_nn = name.startswith("friction_drop")
            columns[f"{name} (nN)" if in_nn else name] = values
        return columns if self.record.hold_times.size else {}

    def made_by(self) -> Mapping[str, Any]:
        return {"scene": self.scene}

    def provenance(self) -> Rows:
        ensemble, rows = self.record, []
        for number, level in enumerate(ensemble.levels):
            first = "samples" if number == 0 else "control" if level.get("control") else "corrections"
            rows.append((first, f"{level['samples']} of {level['words']}"))
            pairs = level.get("seeds", [])[:_SEEDS]
            text = ", ".join(f"{surface} {hold}" for surface, hold in pairs)
            more = ", …" if level["samples"] > len(pairs) else ""
            rows.append((f"seeds of {first} (surface, disorder and kinetics)", text + more))
        versions = ensemble.provenance.get("versions", {})
        return [*rows, *((f"version of {name}", str(text)) for name, text in versions.items()), *super().provenance()]

    # -- beside others ------------------------------------------------------------------------------------------------

    def estimate(self, name: str, time: float | None = None) -> Estimate | None:
        """A quantity, of a curve at ``time`` (s); None of what it does not have.

        Between hold times the mean is interpolated linearly in log t, and so is half the width of the interval, which
        is at most too wide.
        """
        ensemble = self.record
        if name not in ensemble.quantities.names:
            return None
        if time is None:
            return ensemble.estimate(name)
        t = ensemble.hold_times
        near = int(np.abs(t - time).argmin())
        if abs(t[near] - time) <= 1e-6 * time:
            return ensemble.estimate(name, float(t[near]))
        after = int(np.searchsorted(t, time))
        if not 0 < after < t.size or t[after - 1] <= 0:
            return None
        part = math.log(time / t[after - 1]) / math.log(t[after] / t[after - 1])
        low, high = (ensemble.estimate(name, float(t[k])) for k in (after - 1, after))
        errors = {
            name: ErrorPart(low.errors[name].size * (1 - part) + high.errors[name].size * part, low.errors[name].how)
            for name in low.errors
        }
        value = low.value * (1 - part) + high.value * part
        return Estimate(value, low.half_width * (1 - part) + high.half_width * part, errors)

    def compared(self, times: Sequence[float]) -> Compared:
        ensemble, quantities = self.record, self.record.quantities
        means = {name: ensemble.estimate(name).value for name in ensemble.measures}
        measures = {name: value for name, value in means.items() if math.isfinite(value)}
        joined = of_scene(self.scene) | compared_measures(measures)
        joined.load = ensemble.load
        joined.rows["load"] = force_text(ensemble.load)
        for name, (label, unit, _) in COMPARED.items():
            measure = self.estimate(name)
            if measure is not None and math.isfinite(measure.half_width):
                joined.rows[label] = interval_text(measure, unit)
        replicas = ensemble.levels[0]["replicas"]
        each = (
            f", {replicas} replica{'s' if replicas > 1 else ''} each"
            if ensemble.hold_times.size and ensemble.random
            else ""
        )
        joined.rows |= {"mean over": self.over + each, "every ± is": self._meaning()}
        joined.numbers |= {
            "load": ensemble.load,
            "surfaces": ensemble.surfaces if ensemble.random else 1,
            "interval_over": "surfaces" if ensemble.random else "replicas on one surface",
            "fit_window": list(ensemble.window),
        }
        if ensemble.hold_times.size:
            self._compare_curves(joined, times)
        if quantities.has_beta:
            self._compare_beta(joined)
        joined.window, joined.fit = ensemble.window, self._fit_like if ensemble.hold_times.size else None
        if ensemble.random and math.isfinite(ensemble.scatter):
            text = f"{percent(ensemble.scatter)} (standard deviation), measured here on {ensemble.surfaces} surfaces"
            joined.rows["scatter of β between surfaces"] = text
            joined.numbers["beta_scatter_between_surfaces"] = ensemble.scatter
        return joined

    def _compare_curves(self, joined: Compared, times: Sequence[float]) -> None:
        ensemble, last = self.record, float(self.record.hold_times[-1])
        for name, (symbol, unit) in _CURVES.items():
            for time, words in (*((time, f"{time:g} s") for time in times), (last, "the last hold time")):
                drop = self.estimate(name, time)
                label = f"{name.replace('_', ' ')} {symbol} at {words}"
                joined.rows[label] = NONE if drop is None else interval_text(drop, unit)
        joined.rows["last hold time"] = f"{last:.5g} s"
        for time in (*times, last):
            entry: dict[str, Any] = {"time": time}
            for name in _CURVES:
                if (drop := self.estimate(name, time)) is not None:
                    entry |= {name: drop.value, f"{name}_stderr": drop.stderr, f"{name}_half_width": drop.half_width}
            joined.at.append(entry)
        joined.units |= {"friction_drop": "nN", "fit_start": "s", "fit_stop": "s", "fit_first": "s", "fit_last": "s"}
        temperature = float(self.scene.get("hold", {}).get("temperature", math.nan))
        joined.chemistry = chemistry_of_scene(self.scene, temperature)
        what = f"mean of {self.over}, 95 %" + (" band" if ensemble.random else "")
        for name in ("friction_coefficient_drop", "friction_drop"):
            if self.ages and name in ensemble.quantities.names:
                figure, words, unit, label, caption = FIGURES[name]
                scale = 1.0 if name == "friction_drop" else 1 / ensemble.load
                mean, half = scale * ensemble.friction_drop, scale * ensemble.friction_drop_half_width
                axes = "hold time (s)", label
                joined.curves[figure] = Curve(
                    words,
                    unit,
                    *axes,
                    caption,
                    ensemble.hold_times,
                    mean,
                    half,
                    what,
                    band=ensemble.random,
                    alone=False,
                    samples=[scale * curves for curves in ensemble.friction_drop_terms],
                    known=scale * ensemble.friction_drop_known,
                )

    def _compare_beta(self, joined: Compared) -> None:
        ensemble, quantities = self.record, self.record.quantities
        beta, b = interval_text(ensemble.estimate("beta"), "per decade"), interval_text(ensemble.b, "per e-fold")
        doubt = f"; {quantities.doubt}" if quantities.doubt else ""
        parts = error_parts(ensemble.estimate("beta"))
        joined.rows |= {
            "hold times of the fit": "{:g} to {:g} s".format(*quantities.span) + doubt,
            "β, 95 % interval": f"{beta}; b = {b}",
            "standard errors of β": "; ".join(f"{part}: {size}" for part, size, _ in parts),
        }
        joined.numbers |= {"fit_range": list(quantities.span), "beta_reason": None}
        for name, estimate in (("beta", ensemble.estimate("beta")), ("b", ensemble.b)):
            ends = [estimate.value - estimate.half_width, estimate.value + estimate.half_width]
            joined.numbers |= {name: estimate.value, f"{name}_stderr": estimate.stderr, f"{name}_interval": ends}

    def _meaning(self) -> str:
        """What the errors contain, so that those of one surface are not taken for those of a mean."""
        if self.record.random:
            return "95 % interval of the mean over surfaces: contains the scatter between surfaces"
        return "95 % interval of the mean over replicas: disorder and noise on this surface alone"

    def _fit_like(self, model: Any, window: Any, quantity: Any) -> str:
        return "a mean over surfaces has the β of its own window, with its errors, in the table of the results"

    # -- pictures -----------------------------------------------------------------------------------------------------

    def pictures(self) -> dict[str, Picture]:
        """Δμ (ΔF without load) against hold time with the 95 % interval of the mean and the single surfaces, and the
        parts of the error of β, or else of the first quantity there is."""
        ensemble, name = self.record, self.record.quantities.names[0]
        sizes = "; ".join(f"{part} {size}" for part, size, _ in error_parts(ensemble.estimate(name)))
        words = "β" if name == "beta" else name.replace("_", " ")
        parts = Panel(
            self._draw_parts,
            f"Standard errors that make up the interval of {words}.",
            f"Parts of the error: {sizes}.",
            (4.9, 2.6),
            heading="Parts of the error",
            name="errors",
        )
        if not self.ages:
            return {"ensemble": Picture((parts,), (5.6, 3.2), title=ensemble.title)}
        what = "surfaces" if ensemble.random else "replicas on the one surface"
        (first, *_, last), (begin, *_, end) = ensemble.friction_drop, ensemble.hold_times
        curve = Panel(
            self._draw_curve,
            f"Mean over {what} with its 95 % interval (band), and single {what.split()[0]} (grey).",
            f"Friction against hold time, mean of {self.over}: from {first:.3g} nN at {begin:g} s to {last:.3g} nN at "
            f"{end:g} s.",
            name="mean",
        )
        return {"ensemble": Picture((curve, parts), (10.5, 4.2), title=ensemble.title, in_cell=2)}

    def draw(
        self, axes: Axes, medium: Medium = FILE, *, singles: bool = True, color: str | None = None, label: str = ""
    ) -> None:
        """Draw the curve, or without ageing the parts of the error."""
        if self.ages:
            self._draw_curve(axes, medium, singles, color, label)
        else:
            self._draw_parts(axes, medium)

    def _draw_curve(
        self, axes: Axes, medium: Medium, singles: bool = True, color: str | None = None, label: str = ""
    ) -> None:
        """Draw the mean curve with its 95 % interval as a band, the single surfaces, and the line of β."""
        ensemble = self.record
        drawn = ensemble.hold_times > 0
        times, scale = ensemble.hold_times[drawn], 1 / ensemble.load if ensemble.load > 0 else 1.0
        if singles:
            text = f"single {'surfaces' if ensemble.random else 'replicas'}: {ensemble.levels[0]['words']}"
            for number, curve in enumerate(scale * ensemble.single_friction_drops[:MOST_CURVES, drawn]):
                axes.plot(times, curve, color=GREY, lw=0.5, alpha=0.4, label=None if number else text)
        mean, half = scale * ensemble.friction_drop[drawn], scale * ensemble.friction_drop_half_width[drawn]
        own = color or BLUE
        axes.plot(times, mean, color=own, lw=1.6, marker="o", ms=3, label=plain(label or f"mean of {self.over}"))
        if np.isfinite(half).any():
            band = "95 % interval of the mean"
            axes.fill_between(times, mean - half, mean + half, color=own, alpha=0.3, lw=0, label=band)
        if ensemble.quantities.has_beta:
            beta, fitted = ensemble.estimate("beta"), ensemble.quantities.fitted[drawn]
            x = np.log10(times[fitted])
            line = mean[fitted].mean() + beta.value * (x - x.mean())
            slope, span = with_error(beta.value, beta.half_width), span_text(ensemble.quantities.span)
            text = f"β = {slope} per decade (line, {span})"
            text += f"\n{short_doubt(ensemble.quantities.doubt)}" * bool(ensemble.quantities.doubt)
            axes.plot(times[fitted], line, color=ORANGE, lw=1.2, zorder=3, label=plain(text))
        axes.set(xscale="log", xlabel="hold time (s)")
        axes.set_ylabel("friction coefficient drop Δμ" if ensemble.load > 0 else "friction drop ΔF (nN)")
        from_zero(axes)
        legend(axes)

    def _draw_parts(self, axes: Axes, medium: Medium) -> None:
        """Draw the standard errors as bars, in percent of the mean, with how each is known."""
        name = self.record.quantities.names[0]
        estimate = self.record.estimate(name)
        parts = [(SOURCES.get(part, part), error) for part, error in estimate.errors.items()]
        for number, (label, error) in enumerate(parts):
            share = 100 * error.size / abs(estimate.value) if estimate.value else math.nan
            is_known = math.isfinite(share)
            axes.barh(number, share if is_known else 0.0, color=BLUE, height=0.4)
            text = percent(share / 100) if is_known else "not known"
            axes.text(0.0, number - 0.28, f" {label}: {text}", va="bottom", parse_math=False)
            how = {"fontsize": medium.font, "color": GREY, "parse_math": False}
            axes.text(0.0, number + 0.24, f" {error.how}", va="top", **how)
        words = {"beta": "β"}.get(name, name.replace("_", " "))
        axes.set_yticks([])
        axes.set_ylim(max(len(parts), 2) - 0.4, -0.6)  # bars of one height, also where there is only one
        axes.set_xlim(left=0)
        title = f"{words}: 95 % interval ± {percent(estimate.relative)}" if math.isfinite(estimate.relative) else words
        axes.set(xlabel=f"standard error of {words} (%)", title=title)


def error_parts(estimate: Estimate) -> list[tuple[str, str, str]]:
    """The parts of the error of an estimate: what each is due to, its standard error, and how it is known."""
    parts = []
    for part, error in estimate.errors.items():
        size = error.size / abs(estimate.value) if estimate.value else math.nan
        text = percent(size) if math.isfinite(size) else "not known"
        parts.append((SOURCES.get(part, part), text, error.how))
    return parts


def interval_text(estimate: Estimate, unit: str = "") -> str:
    """An estimate with its interval, or why there is none."""
    value, half = estimate.value, estimate.half_width
    if not math.isfinite(value):
        return NONE
    if half <= EXACT * abs(value) or not any(part.size != 0 for part in estimate.errors.values()):
        return f"{value:.4g} {unit}".strip() + ", the same in all samples"
    text = plus_minus(value, half, unit)
    if math.isnan(half):
        unknown = [SOURCES.get(part, part) for part, error in estimate.errors.items() if math.isnan(error.size)]
        text += f", interval not known{': ' * bool(unknown)}{', '.join(unknown)}"
    return text
