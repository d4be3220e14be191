"""How fits of rate-and-state laws are shown: a column for each law, words, and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import (
    Curve,
    Panel,
    Picture,
    Quantity,
    Rank,
    Result,
    Table,
    displays,
    figures,
    statistics,
    text,
)
from chemage_rate_state.fit import TOLD, RateStateFit
from chemage_rate_state.laws import PAPERS
from chemage_rate_state.renewal import Renewal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: share of sites that a slip did not renew from which it is said to be short
LEFT = 0.1


class RateStateDisplay(Result):
    """Laws fitted to one trace as users see them, and why others could not be."""

    errors = "95 % intervals, with the correlation of the noise"
    please_cite = "Please cite the laws:"

    def __init__(
        self, fits: Sequence[RateStateFit], failed: dict[str, str]
    ) -> None:
        self.fits, self.failed = fits, failed
        self.trace = fits[0].trace

    @property
    def name(self) -> str:
        return self.trace.name

    @property
    def title(self) -> str:
        return f"Rate-and-state friction: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        trace, loading = self.trace, self.trace.loading
        speeds = ", ".join(f"{speed:.4g}" for speed in loading.speeds)
        changes = ", ".join(f"{time:.6g}" for time in loading.times[1:])
        noise = min(fit.noise for fit in self.fits)
        rows = [
            ("points", f"{trace.times.size}, noise {noise:.2g}"),
            ("speeds of the load point", f"{speeds} µm/s, changed at {changes} s"),
        ]
        for fit in self.fits:
            rows.append((f"{fit.law} law", fit.words()))
            rows += [("fits nearly as well", one.text()) for one in fit.rivals]
        rows += [
            (f"{law} law", f"not fitted: {why}") for law, why in self.failed.items()
        ]
        best, *others = sorted(self.fits, key=lambda one: one.misfit)
        for other in others:
            away = other.misfit - best.misfit
            better = (
                f"the {best.law} law fits better: its misfit is less by {away:.1f}"
            )
            near = f"the trace does not tell them apart: misfits differ by {away:.1f}, below {TOLD:g}"
            rows.append(("laws", near if away < TOLD else better))
        return rows

    def tables(self) -> list[Table]:
        """Parameters by law."""
        columns = [fit.quantities() for fit in self.fits]
        rows = [
            (row[0].title, *(one.text() for one in row))
            for row in zip(*columns, strict=True)
        ]
        laws = [f"{fit.law} law" for fit in self.fits]
        return [Table("", ["", *laws], rows, "Parameters", in_detail=False)]

    def numbers(self) -> dict[str, Any]:
        found = {}
        for fit in self.fits:
            numbers: dict[str, Any] = {
                "explains": fit.explains,
                "verdict": fit.words(),
            }
            for name in ("noise", "misfit", "probability"):
                numbers[name] = getattr(fit, name)
            for one in fit.quantities():
                numbers[one.name] = one.todict()
            rivals = [
                one.parameters._asdict() | {"misfit": one.misfit}
                for one in fit.rivals
            ]
            found[fit.law] = numbers | {"rivals": rivals}
        loading = self.trace.loading
        return {
            "name": self.name,
            "speeds": loading.speeds.tolist(),
            "changes": loading.times[1:].tolist(),
            "laws": found,
            "not_fitted": self.failed,
        }

    def columns(self) -> dict[str, Any]:
        trace = self.trace
        return {
            "time (s)": trace.times,
            "displacement (um)": trace.way,
            "friction_coefficient": trace.friction,
            **{f"{fit.law}_law": fit.fitted for fit in self.fits},
        }

    def cite(self) -> tuple[list[str], str]:
        return [PAPERS[fit.law] for fit in self.fits], ""

    def pictures(self) -> dict[str, Picture]:
        """Friction against the displacement of the load point, with the laws."""
        panel = Panel(self._drawn, name="trace")
        return {"rate-state": Picture((panel,), (5.6, 4.2))}

    def _drawn(self, axes: Axes, medium: Any = None) -> None:
        trace, way = self.trace, self.trace.way
        axes.plot(way, trace.friction, ".", ms=1.5, color="0.7", label="trace")
        for fit, style in zip(self.fits, ("-", "--"), strict=False):
            axes.plot(way, fit.fitted, style, label=f"{fit.law} law")
        axes.set(
            xlabel="displacement of the load point (µm)",
            ylabel="friction coefficient",
        )
        figures.legend(axes)


@displays(Renewal)
class RenewalDisplay(Result):
    """How fast slip renews a contact, as users see it."""

    errors = "95 % intervals over pairs of surfaces (Student's t)"

    def __init__(self, renewal: Renewal) -> None:
        self.renewal = renewal

    @property
    def name(self) -> str:
        return self.renewal.name

    @property
    def title(self) -> str:
        return f"Renewal by slip: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        slips = self.renewal.slips
        way = f"{slips[-1]:.4g} nm in steps of {slips[1]:.4g} nm"
        return [
            ("mean over", f"{len(self.renewal.unrenewed)} pairs"),
            ("slip", way),
        ]

    def quantities(self) -> list[Quantity]:
        return self.renewal.quantities()

    def curves(self) -> list[Curve]:
        return self.renewal.curves()

    def tables(self) -> list[Table]:
        return []

    def notes(self) -> list[str]:
        if self.renewal.left < LEFT:
            return []
        share = text.percent(self.renewal.left)
        return [
            f"{share} of the sites stay longer than this slip: give a larger one"
        ]

    def pictures(self) -> dict[str, Picture]:
        """Both shares against slip."""
        return {
            "renewal": Picture((Panel(self._drawn, name="renewal"),), (5.6, 4.2))
        }

    def _drawn(self, axes: Axes, medium: Any = None) -> None:
        # dashed, as both are equal where a surface slides on a flat one
        for curve, style in zip(self.curves(), ("-", "--"), strict=True):
            axes.plot(curve.x, curve.mean, style, label=curve.label)
            low, high = curve.mean - curve.half_width, curve.mean + curve.half_width
            axes.fill_between(curve.x, low, high, alpha=0.2)
        axes.set(xlabel="slip (nm)", ylabel="share", ylim=(0, 1.02), xlim=(0, None))
        figures.legend(axes)


#: power of the slip length in the mean chord of a patch, and the mean of their ratio
POWER = Quantity("power", "1", "power of D_c in 4A/C", rank=Rank.FIRST)
RATIO = Quantity("ratio", "1", "D_c over 4A/C")


class RenewalsDisplay(Result):
    """Slip lengths of the points of a sweep, against the mean chord of a patch."""

    errors = "95 % intervals: of points over pairs of surfaces, of the power over points (Student's t)"

    def __init__(self, points: Sequence[tuple[dict[str, Any], Renewal]]) -> None:
        self.points = points
        self._found = [renewal.quantities() for _, renewal in points]
        self.lengths, self.chords, _ = np.transpose(
            [[one.value for one in row] for row in self._found]
        )

    @property
    def name(self) -> str:
        return self.points[0][1].name

    @property
    def title(self) -> str:
        return f"Renewal by slip: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        ends = f"{self.chords.min():.3g} to {self.chords.max():.3g} nm"
        return [("points", f"{len(self.points)}, mean chords from {ends}")]

    def quantities(self) -> list[Quantity]:
        from scipy.stats import linregress

        ratio = RATIO.of_replicas(self.lengths / self.chords)
        freedom = self.chords.size - 2
        if freedom < 1 or not np.ptp(self.chords):
            return [ratio]
        line: Any = linregress(np.log(self.chords), np.log(self.lengths))
        half = statistics.student_limit(freedom) * line.stderr
        return [POWER.but(value=line.slope).between(half, line.stderr), ratio]

    def tables(self) -> list[Table]:
        """A line for each point."""
        fields = [path.rpartition(".")[2] for path in self.points[0][0]]
        names = [*fields, *(one.title for one in self._found[0])]
        rows = [
            [*map(str, varied.values()), *(one.text() for one in row)]
            for (varied, _), row in zip(self.points, self._found, strict=True)
        ]
        return [Table("", names, rows, "Slip lengths", in_detail=False)]

    def columns(self) -> dict[str, Any]:
        varied = [
            [str(value) for value in point.values()] for point, _ in self.points
        ]
        columns: dict[str, Any] = dict(
            zip(self.points[0][0], zip(*varied, strict=True), strict=True)
        )
        for row in zip(*self._found, strict=True):
            for part in ("value", "low", "high"):
                name = row[0].name if part == "value" else f"{row[0].name}_{part}"
                columns[f"{name} (nm)"] = np.array(
                    [getattr(one, part) for one in row]
                )
        return columns

    def numbers(self) -> dict[str, Any]:
        return super().numbers() | {"points": self.columns()}

    def notes(self) -> list[str]:
        return list(
            dict.fromkeys(
                note
                for _, one in self.points
                for note in RenewalDisplay(one).notes()
            )
        )

    def pictures(self) -> dict[str, Picture]:
        """Slip length against mean chord."""
        return {
            "renewals": Picture((Panel(self._drawn, name="renewals"),), (5.6, 4.2))
        }

    def _drawn(self, axes: Axes, medium: Any = None) -> None:
        half = [row[0].half_width for row in self._found]
        axes.errorbar(
            self.chords, self.lengths, half, fmt="o", ms=4, label="points"
        )
        ends = np.array([self.chords.min(), self.chords.max()])
        ratio = float(np.exp(np.log(self.lengths / self.chords).mean()))
        axes.plot(ends, ratio * ends, "--", label=f"{ratio:.2f} · 4A/C")
        axes.set(
            xlabel="mean chord of a patch 4A/C (nm)",
            ylabel="slip length D_c (nm)",
            xscale="log",
            yscale="log",
        )
        figures.legend(axes, loc="upper left")
