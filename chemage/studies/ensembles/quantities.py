"""A sample, and its quantities as one row of numbers, so that all of them are averaged and judged in the same way.

How many samples of each level make an interval narrow enough at the lowest cost.

The estimate is a sum of means over independent levels (Giles, Oper. Res. 56, 607 (2008)): of the cheapest computation
on many surfaces, and of the difference between a better and a cheaper one on few. Its variance is Σ v/n, with v the
variance of one sample of a level and n their number; its degrees of freedom are those of Welch, Biometrika 34, 28
(1947), and Satterthwaite, Biometrics Bulletin 2, 110 (1946).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.ageing.fitting import (
    BETA,
    DROPS,
    few_hold_times,
    line_slopes,
    why_not_fitted,
)
from chemage.ageing.hooks import method_of
from chemage.contacts.solution import FLOW_MEASURES, MEASURES
from chemage.foundation.checks import within
from chemage.foundation.errors import InputError, nearest
from chemage.foundation.outputs import HOLD_TIME, RECORDED, Output
from chemage.foundation.quantities import ONE, Quantity
from chemage.foundation.statistics import student_limit, student_limits
from chemage.foundation.units import convert
from chemage.plugins.sources import components_in
from chemage.scene.scene import Scene
from chemage.studies.tasks import GIVEN, Outcome


@dataclass(frozen=True)
class SurfaceSample:
    """What one computation on one surface gives."""

    #: nN, (replicas, m); (0, 0) without ageing
    friction_drop: np.ndarray
    #: measures of the contact
    measures: Mapping[str, float]
    #: plugins that answered or changed a stage: name -> source
    plugins: Mapping[str, str] = field(default_factory=dict)
    #: as in :mod:`chemage.foundation.records`
    approximate: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of(cls, outcome: Outcome) -> SurfaceSample:
        """The sample that a task gave.

        Raises
        ------
        InputError
            The friction is not finite.
        """
        run, ageing, content = outcome.run, outcome.ageing, outcome.content
        if run is not None:
            plugins, approximate = run.plugins, run.contact.approximate
            recorded = {name: one.summary() for name, one in run.measured.items()}
        else:
            assert content is not None
            plugins, approximate = (
                content["plugins"],
                content.get("approximate", ()),
            )
            recorded = content["summary"]["observables"]
        if (
            ageing is not None
        ):  # which has what is approximate about the contact as well
            approximate = ageing.approximate
        measures = outcome.measures | _recorded(recorded)
        numbers = {}
        for name, value in measures.items():
            if (
                isinstance(value, int | float)
                and not isinstance(value, bool)
                and math.isfinite(value)
            ):
                numbers[name] = float(value)
        if ageing is None:
            return cls(np.zeros((1, 0)), numbers, plugins, approximate)
        drop = np.asarray(ageing.friction_drop, dtype=np.float64)
        if not np.isfinite(drop).all():
            raise InputError(
                "friction_drop: has numbers that are not finite; see `chemage run` of one surface"
            )
        return cls(drop, numbers, plugins, approximate)


def declared_outputs(scene: Scene) -> dict[str, Output]:
    """What the components of a scene declare, and the options of plugins that it sets, for their hooks."""
    parts = [*components_in(scene.parts), *scene.plugins.values()]
    return {name: output for part in parts for name, output in part.outputs.items()}


def recorded_measures(scene: Scene) -> dict[str, str]:
    """The numbers among :func:`declared_outputs`, and the curves over hold times, of which the last value counts:
    quantity -> unit."""
    numbers = {
        name: output
        for name, output in declared_outputs(scene).items()
        if output.dims in ((), (HOLD_TIME,))
    }
    return {f"{RECORDED}{name}": output.unit for name, output in numbers.items()}


def _recorded(observables: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The means over replicas by the names of quantities, from the summaries of what was recorded."""
    means = {
        name: np.ravel(output.get("withheld", output["mean"]))
        for name, output in observables.items()
        if "mean" in output
    }
    return {
        f"{RECORDED}{name}": mean[-1]
        for name, mean in means.items()
        if mean.size and mean[-1] is not None
    }


@dataclass(frozen=True)
class Quantities:
    """The columns of a row: β where it can be fitted, ΔF at every hold time, the measures of the contact."""

    #: (m,) s
    hold_times: np.ndarray
    load: float
    window: tuple[float, float]
    measures: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, measures: Sequence[str]) -> Quantities:
        """Those of a scene, whose contacts have ``measures``."""
        times = (
            scene.hold.hold_times
            if scene.ages and scene.hold is not None
            else np.zeros(0)
        )
        names = tuple(name for name in measures if name not in GIVEN)
        load = scene.given_load("a mean over surfaces")
        method = method_of(scene.parts)
        fits = method is None or not method.unfitted
        window = (scene.fit.start, scene.fit.stop) if fits else (math.inf, math.inf)
        return cls(times, load, window, names)

    @property
    def fitted(self) -> np.ndarray:
        """(m,) bool: hold times of the fit."""
        return within(self.hold_times, self.window) & (self.hold_times > 0)

    @property
    def span(self) -> tuple[float, float]:
        """First and last hold time of the fit, s."""
        return float(self.hold_times[self.fitted].min()), float(
            self.hold_times[self.fitted].max()
        )

    @property
    def doubt(self) -> str:
        """That the fit has too few hold times; "" where it has not, and without one."""
        return (
            few_hold_times(int(self.fitted.sum()), self.span)
            if self.has_beta
            else ""
        )

    @property
    def has_beta(self) -> bool:
        """Whether β can be fitted: a line needs two points."""
        return self.load > 0 and np.unique(self.hold_times[self.fitted]).size >= 2

    @property
    def names(self) -> list[str]:
        """What can be asked for."""
        curves = list(DROPS)[: 1 + (self.load > 0)] if self.hold_times.size else []
        return [*(["beta"] if self.has_beta else []), *curves, *self.measures]

    def declared(self, name: str) -> Quantity:
        """What a quantity is."""
        if name == BETA.name:
            of = f"over {int(self.fitted.sum())} hold times from {self.span[0]:g} to {self.span[1]:g} s"
            return BETA.but(of=of, reason=self.doubt)
        if name in DROPS:
            return DROPS[name].number()
        return (MEASURES | FLOW_MEASURES).get(name) or Quantity(
            name, ONE, name.removeprefix(RECORDED).replace("_", " ")
        )

    @property
    def curve(self) -> slice:
        """The columns of ΔF; those of the measures follow."""
        return slice(int(self.has_beta), int(self.has_beta) + self.hold_times.size)

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.curve.stop + len(self.measures)

    def row(self, sample: SurfaceSample) -> np.ndarray:
        """(count,) of one sample, the mean over its replicas; nan where a measure does not exist."""
        return self._rows(sample.friction_drop.mean(axis=0)[None], sample.measures)[
            0
        ]

    def replica_rows(self, sample: SurfaceSample) -> np.ndarray:
        """(replicas, count): of each replica."""
        return self._rows(sample.friction_drop, sample.measures)

    def _rows(self, drop: np.ndarray, measures: Mapping[str, float]) -> np.ndarray:
        parts = [
            drop,
            np.tile(
                [measures.get(name, math.nan) for name in self.measures],
                (len(drop), 1),
            ),
        ]
        if self.has_beta:
            parts.insert(0, (self.slope(drop) / self.load)[:, None])
        return np.concatenate(parts, axis=1)

    def slope(self, curves: np.ndarray) -> np.ndarray:
        """(n,) rise per decade of the least-squares line through each of ``curves`` (n, m) over the window: the fit of
        β, which is linear in the curve, so that its mean is that of the mean curve."""
        return line_slopes(self.hold_times, curves, self.window)

    def column(self, name: str, time: float | None = None) -> int:
        """The column of a quantity; of a curve at ``time`` (s), or at the last hold time.

        Raises
        ------
        InputError
            There is no such quantity, or ``time`` is not a hold time.
        """
        if name not in self.names:
            raise InputError(
                f"accuracy.{name}: {self._why_not(name)}; this scene has {', '.join(self.names)}"
            )
        if name in DROPS:
            return self.curve.start + self._moment(name, time)
        if time is not None:
            raise InputError(
                f"accuracy.{name}: does not depend on the hold time; leave out the part after @"
            )
        return 0 if name == "beta" else self.curve.stop + self.measures.index(name)

    def _why_not(self, name: str) -> str:
        """Why the scene does not have a quantity, and the remedy."""
        if name != BETA.name and name not in DROPS:
            return f"no such quantity{nearest(name, self.names)}"
        if not self.hold_times.size:
            return "this scene solves the contact alone; for friction add [forming], [engine] and [hold]"
        if self.load <= 0:
            return "there is no coefficient of friction without a load; give one"
        return (
            f"it cannot be fitted: {why_not_fitted(self.hold_times, self.window)}"
        )

    def columns(self, errors: Mapping[str, float]) -> np.ndarray:
        """(count,) errors of β and of ΔF by name as one number for each quantity; nan where nothing is known."""
        columns = np.full(self.count, np.nan)
        if self.has_beta and "beta" in errors:
            columns[0] = errors["beta"]
        if "friction_drop" in errors:
            columns[self.curve] = errors["friction_drop"]
        return columns

    def asked(self, text: str) -> int:
        """The column of a quantity written as ``name`` or ``name@time``."""
        name, at, time = text.partition("@")
        return self.column(
            name.strip(),
            convert(time.strip(), "s", f"accuracy.{text}") if at else None,
        )

    def _moment(self, name: str, time: float | None) -> int:
        if time is None:
            return self.hold_times.size - 1
        distance = np.abs(self.hold_times - time)
        number = int(distance.argmin())
        if distance[number] > 1e-6 * time:
            raise InputError(
                f"accuracy.{name}@{time:g} s: is not one of the hold times; the nearest is "
                f"{self.hold_times[number]:.6g} s; change [hold], or ask at that time"
            )
        return number


@dataclass(frozen=True)
class AccuracyGoal:
    """One quantity, and the relative half width of its 95 % interval that is asked for."""

    #: as it was written, such as ``friction_coefficient_drop@1e3 s``
    name: str
    #: number of its column among the :class:`Quantities`
    column: int
    accuracy: float


#: more samples of a level than this are not asked for
MOST = 10_000_000


@dataclass(frozen=True)
class Spread:
    """The variance of one sample of a level, and how well it is known."""

    #: (quantities,)
    variance: np.ndarray
    #: degrees of freedom of the variance
    freedom: int

    @classmethod
    def of(
        cls, rows: np.ndarray, chosen: int, freedom: int, regressed: bool = False
    ) -> Spread:
        """The spread of a level from its samples: that of the first ``chosen``, or of all of them where it is larger.

        Parameters
        ----------
        rows
            (samples, quantities)
        regressed
            Whether the rows are what remains of a regression, whose coefficient takes a degree of freedom and adds its
            own error to the mean (Cochran, Sampling Techniques, 3rd ed. (1977), section 12.6).
        """
        parts = []
        for part in (rows[:chosen], rows):
            count, variance = len(part), part.var(axis=0, ddof=1)
            if regressed and count > 3:
                variance = (
                    variance * (count - 1) / (count - 2) * (1 + 1 / (count - 3))
                )
            parts.append(variance)
        return cls(
            np.maximum(*parts), max(1, freedom - 1) if regressed else freedom
        )


def regressed(values: list[np.ndarray]) -> list[np.ndarray]:
    """The samples of each level with those of the first freed from what the control, the last of them, explains, and
    those of the control in units of each quantity.

    This is double sampling with a regression estimator (Cochran, Sampling Techniques, 3rd ed. (1977), section 12.6),
    known as multifidelity Monte Carlo where the control is a cheaper model (Peherstorfer, Willcox & Gunzburger, SIAM J.
    Sci. Comput. 38, A3163 (2016)). Of n samples y of the first level and N ≥ n of the control x, a cheap number of
    each surface,

        mean = ȳ_n + α (x̄_N − x̄_n),   variance = σ²(1 − ρ²)/n + σ²ρ²/N

    with the slope α of y against x and their correlation ρ; the two terms are uncorrelated, since the residuals of a
    regression are uncorrelated with x.

    Parameters
    ----------
    values
        (samples, quantities) of each level, and (N, 1) of the control on the surfaces of the first level and on more.
    """
    first, control = values[0], values[-1][:, 0]
    pairs = control[: len(first)]
    centred = pairs - pairs.mean()
    square = float(centred @ centred)
    slope = centred @ first / square if square > 0 else np.zeros(first.shape[1])
    about = control - control.mean()
    return [
        first - np.outer(about[: len(first)], slope),
        *values[1:-1],
        np.outer(about, slope),
    ]


def half_width(
    spreads: list[Spread], counts: list[int], known: np.ndarray
) -> np.ndarray:
    """Half the width of the interval of the sum of the means, (quantities,); nan where all samples are equal and no
    other error is known, since equal samples say nothing of their scatter.

    Parameters
    ----------
    spreads, counts
        Of each level: its spread, and the number of samples in its mean.
    known
        (quantities,) standard errors from other causes, known before; they are taken as normal.
    """
    parts = np.array(
        [
            spread.variance / count
            for spread, count in zip(spreads, counts, strict=True)
        ]
    )
    total = parts.sum(axis=0) + known**2
    freedoms = np.array([[spread.freedom] for spread in spreads])
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = total**2 / (parts**2 / freedoms).sum(axis=0)
    return np.where(
        total > 0, student_limits(np.minimum(freedom, 1e9)) * np.sqrt(total), np.nan
    )


def limit(freedom: float) -> float:
    """Student's limit; of the normal distribution where the freedom is infinite."""
    return student_limit(min(freedom, 1e9))  # pyright: ignore[reportArgumentType]


def allocated(
    spreads: list[Spread],
    costs: list[float],
    done: list[int],
    known: np.ndarray,
    wanted: np.ndarray,
) -> list[int] | None:
    """The cheapest numbers of samples, none below ``done``, whose interval is within ``wanted`` in every quantity.

    None: no number of samples is enough, because of the errors that are ``known``.
    """
    if np.any(limit(math.inf) * known >= wanted):
        return None
    counts = list(done)
    for k, half in enumerate(wanted):
        if not math.isfinite(half):
            continue
        column = [
            Spread(spread.variance[k : k + 1], spread.freedom) for spread in spreads
        ]
        needed = _of_one(column, costs, done, known[k : k + 1], float(half))
        counts = [max(pair) for pair in zip(counts, needed, strict=True)]
    return counts


def _of_one(
    spreads: list[Spread],
    costs: list[float],
    done: list[int],
    known: np.ndarray,
    wanted: float,
) -> list[int]:
    """As :func:`allocated`, of one quantity."""
    scale = 1.0
    counts = list(done)
    variances = [float(spread.variance[0]) for spread in spreads]
    # Student's limit depends on the counts; it falls as they rise, so that doubling the goal always ends
    for _ in range(200):
        if float(half_width(spreads, counts, known)[0]) <= wanted:
            break
        goal = (wanted / limit(math.inf)) ** 2 - float(known[0]) ** 2
        best = optimal(variances, costs, done, variance=max(goal, 1e-300) / scale)
        counts = [min(MOST, math.ceil(count - 1e-9)) for count in best]
        scale *= 1.05
    return counts


def optimal(
    variances: Sequence[float],
    costs: Sequence[float],
    done: Sequence[int],
    *,
    variance: float = math.inf,
    budget: float = math.inf,
) -> list[float]:
    """Counts n_l ∝ √(v_l/c_l) of samples, none below ``done``, that reach a variance Σ v/n of the mean at the lowest
    cost, or the smallest variance for a ``budget`` of more samples (Giles, Acta Numer. 24, 259 (2015))."""
    v, c, least = (
        np.asarray(values, dtype=np.float64) for values in (variances, costs, done)
    )
    free, counts = v > 0, least
    while free.any():
        share = np.sqrt(v * c)[free].sum()
        if math.isfinite(budget):
            scale = (budget + (c * least)[free].sum()) / share
        else:
            scale = share / max(variance - (v / least)[~free].sum(), 1e-300)
        best = np.sqrt(v / c) * scale
        short = free & (best < least)
        if not short.any():
            counts = np.where(free, best, least)
            break
        free &= ~short
    return counts.tolist()
