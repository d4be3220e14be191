"""How an ensemble is shown: its estimates with their intervals, and the parts of their errors by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.display import ON_ONE_SURFACE
from chemage.ageing.fitting import DROPS, span_text
from chemage.foundation.figures import BLUE, GREY, ORANGE, from_zero, legend, plain
from chemage.foundation.quantities import HOLD_TIME, Curve, Quantity, Rank
from chemage.foundation.result import (
    FILE,
    Comparable,
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    Table,
    displays,
)
from chemage.foundation.text import jsonable, percent
from chemage.foundation.units import convert
from chemage.scene.display import chemistry_of_scene
from chemage.scene.provenance import scatter_of
from chemage.studies.ensembles.ensemble import SOURCES, Ensemble
from chemage.surfaces.role import Scatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what the errors of a mean over surfaces are
OVER_SURFACES = "95 % intervals with the scatter between surfaces, by Student's t"
#: what every ± of an ensemble is
TITLE = "± is half the width of a 95 % interval"
#: more single surfaces are not drawn, of those there are the first
MOST_CURVES = 200
#: seeds of samples that are shown
_SEEDS = 10


@displays(Ensemble)
class EnsembleDisplay(OfRecord[Ensemble]):
    """An ensemble as users see it."""

    def __init__(self, ensemble: Ensemble) -> None:
        super().__init__(ensemble)
        known = scatter_of(self.scene, None, {}) if ensemble.random else None
        self.over = known.between if known else "surfaces"
        self.errors = (
            OVER_SURFACES.replace("surfaces", self.over)
            if ensemble.random
            else ON_ONE_SURFACE
        )

    @property
    def name(self) -> str:
        return self.record.name

    @property
    def title(self) -> str:
        return self.record.title

    @property
    def heading(self) -> str:
        return f"{self.title}: {TITLE}"

    def notes(self) -> list[str]:
        notes, ended = self.record.every_note, self.record.stopped
        if ended and not ended.endswith(("asked for", "reached")):
            notes = [*notes, f"sampling ended because {ended}"]
        return notes

    @property
    def scene(self) -> Mapping[str, Any]:
        return self.record.provenance.get("scene", {})

    @property
    def ages(self) -> bool:
        """Whether there is a curve to draw against hold time."""
        return bool((self.record.hold_times > 0).any())

    # -- words and numbers --------------------------------------------------------------------------------------------

    def facts(self) -> Rows:
        """What was averaged."""
        ensemble = self.record
        facts = self._averaged()
        for goal, size in ensemble.goals.items():
            facts.append((f"asked of {goal}", f"± {100 * size:.3g} %"))
        facts += [
            (f"plugin {name}", source) for name, source in ensemble.plugins.items()
        ]
        return facts + (
            [("ended because", ensemble.stopped)] if ensemble.stopped else []
        )

    def _source(self, cause: str) -> str:
        """What an error is due to, in words."""
        return SOURCES.get(cause, cause).replace("surfaces", self.over)

    def quantities(self) -> list[Quantity]:
        asked = {goal.partition("@")[0].strip() for goal in self.record.goals}
        names, at_times = ("area_fraction", "beta", "b"), []
        for goal in self.record.goals:
            name, _, time = map(str.strip, goal.partition("@"))
            if time:
                one = self.record.estimate(name, convert(time, "s"))
                at_times.append(
                    one.but(
                        name=goal, label=f"{one.title} {one.of}", symbol="", of=""
                    )
                )
        # those of b are those of β
        found = []
        for one in self.record.numbers():
            errors = {
                self._source(cause): part for cause, part in one.errors.items()
            }
            found.append(one.but(errors=errors if one.name != "b" else {}))
        shown = [
            one
            if one.name in names or one.name in asked
            else one.but(rank=Rank.REST)
            for one in found
        ]
        if self.record.random and math.isfinite(self.record.scatter):
            how = f"measured here on {self.record.surfaces}"
            scatter = Scatter(self.record.scatter, how, self.over)
            shown.append(scatter.quantity())
        return [*shown, *at_times]

    def curves(self) -> list[Curve]:
        return self.record.curves()

    def _averaged(self) -> Rows:
        """What was averaged, with its grids and replicas."""
        first, *others = self.record.levels
        mean = f"{first['samples']} random {self.over}: {first['words']} each"
        if not self.record.random:
            mean = f"{first['samples']} replicas on the one surface: {first['words'].partition(',')[0]}"
        rows = [("mean over", mean)]
        for level in others:
            of = f"{level['samples']} surfaces: {level['words']}"
            if level.get("control"):
                rows.append(("regressed on", f"the area of the contact of {of}"))
            else:
                rows.append(
                    (
                        "corrected by",
                        f"{level['samples']} of these differences: {level['words']}",
                    )
                )
        return rows

    def numbers(self) -> dict[str, Any]:
        return jsonable(self.record.summary())

    def stated(self) -> tuple[str, Mapping[str, Any]]:
        about, scene = super().stated()
        return (
            f"{about.rstrip('.')}, but for a budget of time, which ends where the time does.",
            scene,
        )

    def tables(self) -> list[Table]:
        rows = []
        for one in self.quantities():
            if one.rank <= Rank.TABLE:
                rows += [
                    (one.row()[0], size, cause, how)
                    for cause, size, how in one.parts()
                ]
        parts = Table(
            "Standard errors by name",
            ["of", "size", "due to", "how it is known"],
            rows,
            "Parts of the error",
        )
        return [parts, *super().tables()]

    def made_by(self) -> Mapping[str, Any]:
        return {"scene": self.scene}

    def provenance(self) -> Rows:
        ensemble, rows = self.record, []
        for number, level in enumerate(ensemble.levels):
            first = (
                "samples"
                if number == 0
                else "control"
                if level.get("control")
                else "corrections"
            )
            rows.append((first, f"{level['samples']} of {level['words']}"))
            pairs = level.get("seeds", [])[:_SEEDS]
            text = ", ".join(f"{surface} {hold}" for surface, hold in pairs)
            more = ", …" if level["samples"] > len(pairs) else ""
            rows.append(
                (f"seeds of {first} (surface, disorder and kinetics)", text + more)
            )
        return [*rows, *super().provenance()]

    # -- beside others ------------------------------------------------------------------------------------------------

    def comparable(self) -> Comparable:
        ensemble = self.record
        if not ensemble.hold_times.size:
            return Comparable(load=ensemble.load)
        temperature = float(self.scene.get("hold", {}).get("temperature", math.nan))
        chemistry = chemistry_of_scene(self.scene, temperature)
        return Comparable(chemistry, ensemble.load, ensemble.window, self._fit_like)

    def _fit_like(self, model: Any, window: Any, quantity: Any) -> str:
        return "a mean over surfaces has the β of its own window, with its errors, in the table of the results"

    # -- pictures -----------------------------------------------------------------------------------------------------

    def pictures(self) -> dict[str, Picture]:
        """Δμ (ΔF without load) against hold time with the 95 % interval of the mean and the single surfaces, and the
        parts of the error of β, or else of the first quantity there is."""
        ensemble, name = self.record, self.record.quantities.names[0]
        sizes = "; ".join(
            f"{part} {size}" for part, size, _ in ensemble.estimate(name).parts()
        )
        words = _words(name)
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
        what = self.over if ensemble.random else "replicas on the one surface"
        (first, *_, last), (begin, *_, end) = (
            ensemble.friction_drop,
            ensemble.hold_times,
        )
        curve = Panel(
            self._draw_curve,
            f"Mean over {what} with its 95 % interval (band), and single {what.split()[0]} (grey).",
            f"Friction against hold time, mean of {ensemble.over}: from {first:.3g} nN at {begin:g} s to "
            f"{last:.3g} nN at {end:g} s.",
            name="mean",
        )
        return {
            "ensemble": Picture(
                (curve, parts), (10.5, 4.2), title=ensemble.title, in_cell=2
            )
        }

    def draw(
        self,
        axes: Axes,
        medium: Medium = FILE,
        *,
        singles: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> None:
        """Draw the curve, or without ageing the parts of the error."""
        if self.ages:
            self._draw_curve(axes, medium, singles, color, label)
        else:
            self._draw_parts(axes, medium)

    def _draw_curve(
        self,
        axes: Axes,
        medium: Medium,
        singles: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> None:
        """Draw the mean curve with its 95 % interval as a band, the single surfaces, and the line of β."""
        ensemble = self.record
        drawn = ensemble.hold_times > 0
        times = ensemble.hold_times[drawn]
        scale = 1 / ensemble.load if ensemble.load > 0 else 1.0
        if singles:
            text = f"single {'surfaces' if ensemble.random else 'replicas'}: {ensemble.levels[0]['words']}"
            for number, curve in enumerate(
                scale * ensemble.single_friction_drops[:MOST_CURVES, drawn]
            ):
                axes.plot(
                    times,
                    curve,
                    color=GREY,
                    lw=0.5,
                    alpha=0.4,
                    label=None if number else text,
                )
        mean = scale * ensemble.friction_drop[drawn]
        half = scale * ensemble.friction_drop_half_width[drawn]
        own = color or BLUE
        axes.plot(
            times,
            mean,
            color=own,
            lw=1.6,
            marker="o",
            ms=3,
            label=plain(label or f"mean of {ensemble.over}"),
        )
        if np.isfinite(half).any():
            band = "95 % interval of the mean"
            axes.fill_between(
                times,
                mean - half,
                mean + half,
                color=own,
                alpha=0.3,
                lw=0,
                label=band,
            )
        if ensemble.quantities.has_beta:
            beta, fitted = (
                ensemble.estimate("beta"),
                ensemble.quantities.fitted[drawn],
            )
            x = np.log10(times[fitted])
            line = mean[fitted].mean() + beta.value * (x - x.mean())
            text = f"{beta.short()} per decade (line, {span_text(ensemble.quantities.span)})"
            line_fit = ensemble.line
            doubt = ensemble.quantities.doubt.partition(";")[0]
            bend = "" if line_fit is None else line_fit.bend_lines
            text = "\n".join(filter(None, (text, doubt, bend)))
            axes.plot(
                times[fitted],
                line,
                color=ORANGE,
                lw=1.2,
                zorder=3,
                label=plain(text),
            )
        drop = DROPS[
            "friction_coefficient_drop" if ensemble.load > 0 else "friction_drop"
        ]
        axes.set(xscale="log", xlabel=HOLD_TIME.axis, ylabel=drop.axis)
        from_zero(axes)
        legend(axes)

    def _draw_parts(self, axes: Axes, medium: Medium) -> None:
        """Draw the standard errors as bars, in percent of the mean, with how each is known."""
        name = self.record.quantities.names[0]
        estimate = self.record.estimate(name)
        parts = [
            (self._source(part), error) for part, error in estimate.errors.items()
        ]
        for number, (label, error) in enumerate(parts):
            share = (
                100 * error.size / abs(estimate.value)
                if estimate.value
                else math.nan
            )
            is_known = math.isfinite(share)
            axes.barh(number, share if is_known else 0.0, color=BLUE, height=0.4)
            text = percent(share / 100) if is_known else "not known"
            axes.text(
                0.0,
                number - 0.28,
                f" {label}: {text}",
                va="bottom",
                parse_math=False,
            )
            how = {"fontsize": medium.font, "color": GREY, "parse_math": False}
            axes.text(0.0, number + 0.24, f" {error.how}", va="top", **how)
        words = _words(name)
        axes.set_yticks([])
        axes.set_ylim(
            max(len(parts), 2) - 0.4, -0.6
        )  # bars of one height, also where there is only one
        axes.set_xlim(left=0)
        title = (
            f"{words}: 95 % interval ± {percent(estimate.relative)}"
            if math.isfinite(estimate.relative)
            else words
        )
        axes.set(xlabel=f"standard error of {words} (%)", title=title)


def _words(name: str) -> str:
    return "β" if name == "beta" else name.replace("_", " ")
