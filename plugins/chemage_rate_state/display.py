"""How fits of rate-and-state laws and slips of renewal are shown: tables, words, and a figure."""

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


class _Shown(Result):
    """A result with one plot, of a name that is that of another object."""

    of: Any

    @property
    def name(self) -> str:
        return self.of.name

    def pictures(self) -> dict[str, Picture]:
        """Its plot."""
        panel = Panel(self.plotted, name="plot")
        return {"plot": Picture((panel,), (5.6, 4.2))}

    def plotted(self, axes: Axes, medium: Any = None) -> None:
        """Draw it."""
        raise NotImplementedError


class RateStateDisplay(_Shown):
    """Laws fitted to one trace as users see them, and why others could not be."""

    errors = "95 % intervals, with the correlation of the noise"
    please_cite = "Please cite the laws:"

    def __init__(
        self, fits: Sequence[RateStateFit], failed: dict[str, str]
    ) -> None:
        self.fits, self.failed = sorted(fits, key=lambda one: one.misfit), failed
        self.of = fits[0].trace

    @property
    def title(self) -> str:
        return f"Rate-and-state friction: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        best, loading = self.fits[0], self.of.loading
        speeds = ", ".join(f"{speed:.4g}" for speed in loading.speeds)
        changes = ", ".join(f"{time:.6g}" for time in loading.times[1:])
        rows = [
            ("points", f"{self.of.times.size}, noise {best.noise:.2g}"),
            ("speeds of the load point", f"{speeds} µm/s, changed at {changes} s"),
        ]
        for fit in self.fits:
            rows.append((f"{fit.law} law", fit.words()))
            for (a, b, length, _), more in fit.rivals:
                other = f"a = {a:.3g}, b = {b:.3g}, D_c = {length:.3g} µm"
                rows.append(
                    ("fits nearly as well", f"{other}: misfit {more:.1f} more")
                )
        for law, why in self.failed.items():
            rows.append((f"{law} law", f"not fitted: {why}"))
        for other in self.fits[1:]:
            away = f"misfits differ by {other.misfit - best.misfit:.1f}"
            told = other.misfit - best.misfit >= TOLD
            better = f"the {best.law} law fits better: {away}"
            near = f"the trace does not tell them apart: {away}, below {TOLD:g}"
            rows.append(("laws", better if told else near))
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
        laws = {}
        for fit in self.fits:
            laws[fit.law] = {
                "verdict": fit.words(),
                "rivals": [
                    one._asdict() | {"misfit": more} for one, more in fit.rivals
                ],
            }
            for name in ("explains", "noise", "misfit", "probability"):
                laws[fit.law][name] = getattr(fit, name)
            for one in fit.quantities():
                laws[fit.law][one.name] = one.todict()
        speeds, times = self.of.loading.speeds, self.of.loading.times
        found = {"name": self.name, "laws": laws, "not_fitted": self.failed}
        return found | {"speeds": speeds.tolist(), "changes": times[1:].tolist()}

    def columns(self) -> dict[str, Any]:
        return {
            "time (s)": self.of.times,
            "displacement (um)": self.of.way,
            "friction_coefficient": self.of.friction,
            **{f"{fit.law}_law": fit.fitted for fit in self.fits},
        }

    def cite(self) -> tuple[list[str], str]:
        return [PAPERS[fit.law] for fit in self.fits], ""

    def plotted(self, axes: Axes, medium: Any = None) -> None:
        """Friction against the displacement of the load point, with the laws."""
        axes.plot(self.of.way, self.of.friction, ".", color="0.7", label="trace")
        for fit, style in zip(self.fits, ("-", "--"), strict=False):
            axes.plot(self.of.way, fit.fitted, style, label=f"{fit.law} law")
        axes.set_xlabel("displacement of the load point (µm)")
        axes.set_ylabel("friction coefficient")
        figures.legend(axes)


@displays(Renewal)
class RenewalDisplay(_Shown):
    """How fast slip renews a contact, as users see it."""

    errors = "95 % intervals over pairs of surfaces (Student's t)"

    def __init__(self, renewal: Renewal) -> None:
        self.of = renewal

    @property
    def title(self) -> str:
        return f"Renewal by slip: {self.name}"

    def facts(self) -> list[tuple[str, str]]:
        slips = self.of.slips
        way = f"{slips[-1]:.4g} nm in steps of {slips[1]:.4g} nm"
        return [("mean over", f"{len(self.of.unrenewed)} pairs"), ("slip", way)]

    def quantities(self) -> list[Quantity]:
        return self.of.quantities()

    def curves(self) -> list[Curve]:
        return self.of.curves()

    def tables(self) -> list[Table]:
        return []

    def notes(self) -> list[str]:
        share = text.percent(self.of.left)
        words = (
            f"{share} of the sites stay longer than this slip: give a larger one"
        )
        return [words] if self.of.left >= LEFT else []

    def plotted(self, axes: Axes, medium: Any = None) -> None:
        """Both shares against slip."""
        # dashed, as both are equal where a surface slides on a flat one
        for curve, style in zip(self.curves(), ("-", "--"), strict=True):
            axes.errorbar(
                curve.x, curve.mean, curve.half_width, fmt=style, label=curve.label
            )
        axes.set(xlabel="slip (nm)", ylabel="share", ylim=(0, 1.02))
        figures.legend(axes)


#: power of the slip length in the mean chord of a patch, and the mean of their ratio
POWER = Quantity("power", "1", "power of D_c in 4A/C", rank=Rank.FIRST)
RATIO = Quantity("ratio", "1", "D_c over 4A/C")


class RenewalsDisplay(_Shown):
    """Slip lengths of the points of a sweep, against the mean chord of a patch."""

    errors = "95 % intervals: of points over pairs of surfaces, of the power over points (Student's t)"

    def __init__(self, points: Sequence[tuple[dict[str, Any], Renewal]]) -> None:
        self.points, self.of = points, points[0][1]
        self.found = [renewal.quantities()[:2] for _, renewal in points]
        self.lengths, self.chords = np.transpose(
            [[one.value for one in row] for row in self.found]
        )

    @property
    def title(self) -> str:
        return f"Renewal by slip: {self.name}"

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
        columns = self.columns()
        rows = [
            tuple(one if isinstance(one, str) else f"{one:.4g}" for one in row)
            for row in zip(*columns.values(), strict=True)
        ]
        return [Table("", list(columns), rows, "Slip lengths", in_detail=False)]

    def columns(self) -> dict[str, Any]:
        columns: dict[str, Any] = {}
        for path in self.points[0][0]:
            columns[path] = [str(varied[path]) for varied, _ in self.points]
        for row in zip(*self.found, strict=True):
            for part, end in (("value", ""), ("low", "_low"), ("high", "_high")):
                values = [getattr(one, part) for one in row]
                columns[f"{row[0].name}{end} (nm)"] = np.array(values)
        return columns

    def numbers(self) -> dict[str, Any]:
        return super().numbers() | {"points": self.columns()}

    def notes(self) -> list[str]:
        notes = [
            note for _, one in self.points for note in RenewalDisplay(one).notes()
        ]
        return list(dict.fromkeys(notes))

    def plotted(self, axes: Axes, medium: Any = None) -> None:
        """Slip length against mean chord."""
        half = [row[0].half_width for row in self.found]
        axes.errorbar(self.chords, self.lengths, half, fmt="o", label="points")
        axes.set_xlabel("mean chord of a patch 4A/C (nm)")
        axes.set_ylabel("slip length D_c (nm)")
        axes.loglog()
        figures.legend(axes)
