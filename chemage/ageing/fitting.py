"""The one fit of β and the cut-off time, to measurements or to a simulated result.

Two models are fitted, and every result names its model:

``"line"``
    Δμ = β log10(t / t_c) over a window of hold times, the definition of β in the literature.
``"curve"``
    Δμ = β log10(1 + t / t_c), which is 0 at t = 0 and becomes the line for t ≫ t_c; any hold times, 0 included.

Standard errors are jackknife errors over replicas, intervals are Student's or from the bootstrap with a fixed seed: the
same data give the same digits. A single replica has no error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Protocol, get_args

import numpy as np

from chemage.ageing.models import (
    UNKNOWN,
    Bootstrap,
    Interval,
    Model,
    basis,
    basis_slope,
    bootstrapped,
    bounds,
    slopes_of,
    solve,
    student,
    time_of,
)
from chemage.ageing.straightness import BENT, is_bent, local_slopes, longest_line
from chemage.foundation.checks import within
from chemage.foundation.errors import InputError
from chemage.foundation.quantities import ONE, Curve, Quantity, Rank, by_name
from chemage.foundation.statistics import jackknife_error
from chemage.foundation.text import NO_SCATTER, ROUNDING, jsonable, power_text
from chemage.foundation.units import QuantityLike, convert

Friction = Literal["friction_coefficient_drop", "friction_drop"]

#: default of the first and last hold time of the line, s
FIT_WINDOW = (10.0, 1e4)
#: a cut-off time that lies further outside all hold times, in decades, is an extrapolation and not stated
CUTOFF_DECADES = 3
#: β per decade over b per e-fold
LN10 = math.log(10)
#: replicas (or points) from which on bootstrap intervals hold the truth as often as they say
FOR_BOOTSTRAP = 10
#: with fewer hold times, or over fewer decades, a β is doubtful
LEAST_POINTS, LEAST_DECADES = 6, 2.0
#: what is fitted
DROPS: dict[str, Curve] = by_name(
    (
        Curve(
            "friction_drop",
            "nN",
            "friction drop",
            "ΔF",
            "friction drop, mean over replicas",
        ),
        Curve(
            "friction_coefficient_drop",
            "1",
            "friction coefficient drop",
            "Δμ",
            "friction coefficient drop, mean over replicas",
            Rank.FIRST,
        ),
    )
)
#: what is fitted -> its unit, "" for a pure number
UNIT: dict[str, str] = {
    name: "" if one.unit == ONE else one.unit for name, one in DROPS.items()
}
BETA = Quantity(
    "beta",
    "1",
    "ageing rate per decade",
    "β",
    "slope of the friction coefficient drop per decade of hold time",
    Rank.FIRST,
    stated="half_width",
)
B = Quantity(
    "b",
    "1",
    "ageing rate per e-fold",
    "b",
    "beta over ln 10, the slope per factor e of hold time",
    stated="half_width",
)
CUTOFF = Quantity("cutoff_time", "s", "cut-off time", "t_c", stated="ends")
RMS_RESIDUAL = Quantity(
    "rms_residual", "1", "rms residual of the line of β", rank=Rank.REST
)
SLOPE_FROM = Quantity(
    "slope_from", "1", "local slope where the line of β begins", rank=Rank.REST
)
SLOPE_TO = Quantity(
    "slope_to", "1", "local slope where the line of β ends", rank=Rank.REST
)
#: the numbers of a fit
FIT = (BETA, B, CUTOFF, RMS_RESIDUAL, SLOPE_FROM, SLOPE_TO)


class Curves(Protocol):
    """What can be fitted: one curve of measurements, or one per replica."""

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        ...

    def fit_data(self, quantity: Friction | None) -> FitData:
        """The curves of ``quantity``, or of the natural one where that is None."""
        ...


@dataclass(frozen=True)
class FitData:
    """Curves as the fit takes them."""

    #: (replicas, m), or (1, m) for measurements; ``quantity`` is ``scale`` times this
    curves: np.ndarray
    quantity: Friction
    scale: float = 1.0
    #: (m,) standard errors of the curve, in its unit
    error: np.ndarray | None = None
    #: whether the curves were computed
    simulated: bool = False

    def weights(self, use: np.ndarray) -> np.ndarray:
        """Weights of the hold times that are fitted, 1 on average."""
        weight = (
            np.ones(np.count_nonzero(use))
            if self.error is None
            else 1 / self.error[use] ** 2
        )
        return weight / weight.mean()


#: what JSON has of a fit as it is
_PLAIN = (
    "model",
    "quantity",
    "beta",
    "beta_stderr",
    "beta_interval",
    "b",
    "b_stderr",
    "b_interval",
    "cutoff_time",
)
_PLAIN += (
    "cutoff_time_stderr",
    "window",
    "points",
    "rms_residual",
    "slope_from",
    "slope_to",
    "replicas",
    "bootstrap",
    "confidence",
)


@dataclass(frozen=True, eq=False)
class Fit:
    """β and the cut-off time, with standard errors and intervals."""

    model: Model
    quantity: Friction
    #: per decade: a pure number for Δμ, nN for ΔF
    beta: float
    #: jackknife over replicas, or from the scatter of measurements about the fit; nan for a single replica
    beta_stderr: float
    #: where the fit meets zero, s; nan where the data do not determine it, for the reason ``cutoff_reason``
    cutoff_time: float
    cutoff_time_stderr: float
    #: why there is no cut-off time; "" where there is one
    cutoff_reason: str
    #: log10 of the time (s) at which the fit meets zero, wherever that is; nan where it does not rise
    log_cutoff: float
    beta_interval: Interval
    cutoff_interval: Interval
    #: dΔF/dlog10 t, nN per decade; None for measurements of Δμ, whose load is not known
    friction_rate: float | None
    friction_rate_stderr: float | None
    #: s; None: all hold times
    window: tuple[float, float] | None
    #: hold times (or rows) used
    points: int
    #: the first of them above 0, and the last, s
    span: tuple[float, float]
    #: root mean square distance of the data from the fit, in the unit of the quantity
    rms_residual: float
    #: slopes per decade over the first half decade of the hold times used, the one in their middle, and the last; nan
    #: of the model "curve"
    local_slopes: tuple[float, float, float]
    #: whether the curve is no line, see :mod:`chemage.ageing.straightness`; False of the model "curve"
    bent: bool
    #: number of simulated replicas; 0 for measurements
    replicas: int
    #: what was resampled for the intervals; None: they are Student's
    bootstrap: Bootstrap | None
    samples: int
    confidence: float
    #: what is fitted, and all of its hold times, s
    data: tuple[FitData, np.ndarray] = field(repr=False)

    def __eq__(self, other: object) -> bool:
        # by their text, in which what is not known, nan, equals itself; floats are exact in it
        return isinstance(other, Fit) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    def __call__(self, hold_times: np.ndarray | float) -> np.ndarray:
        """The fitted value at ``hold_times`` (s)."""
        return self.beta * basis(
            self.model, np.asarray(hold_times, dtype=np.float64), self.log_cutoff
        )

    @property
    def slope_from(self) -> float:
        """Local slope per decade where the fitted hold times begin."""
        return self.local_slopes[0]

    @property
    def slope_to(self) -> float:
        """Local slope per decade where the fitted hold times end."""
        return self.local_slopes[2]

    @property
    def saturates(self) -> bool:
        """Whether β is not above zero, or the curve levels off within the hold times that are fitted."""
        least = (1 - BENT) * self.slope_from
        return not self.beta > 0 or (self.bent and self.slope_to < least)

    @cached_property
    def line_window(self) -> tuple[float, float] | None:
        """The longest window (s) of the hold times in which the curve is a line, two decades and six hold times at
        least; None: there is none."""
        source, times = self.data
        use = times > 0
        ends = longest_line(
            np.log10(times[use]),
            source.curves[:, use],
            source.weights(use),
            simulated=source.simulated,
            points=LEAST_POINTS,
            decades=LEAST_DECADES,
        )
        return ends and (time_of(ends[0]), time_of(ends[1]))

    def bend_text(self) -> str:
        """That the curve is no line, with the numbers that say so; "" where it is one."""
        if not self.bent:
            return ""
        numbers = [f"{one:.3g}" for one in (self.rms_residual, *self.local_slopes)]
        rest, first, middle, last = (
            f"{one} {UNIT[self.quantity]}".strip() for one in numbers
        )
        ends = sorted((self.slope_from, self.slope_to))
        third = BENT * abs(self.beta)
        outside = not ends[0] - third < self.local_slopes[1] < ends[1] + third
        return (
            f"no line: rms residual {rest}, local slope from {first} "
            f"{f'over {middle} ' if outside else ''}to {last}"
        )

    @property
    def bend_lines(self) -> str:
        """:meth:`bend_text` in two lines, for legends."""
        return self.bend_text().replace(", ", ",\n")

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of β, in words: too few hold times, or a curve that is no line."""
        notes = [self.doubt] if self.doubt else []
        if self.bent:
            window = self.line_window
            where = (
                "no window of two decades is one"
                if window is None
                else f"it is a line from {window[0]:.4g} to {window[1]:.4g} s"
            )
            notes.append(
                f"β from {self.span[0]:g} to {self.span[1]:g} s is of a curve that is {self.bend_text()} per decade; {where}"
            )
        return tuple(notes)

    @property
    def drawable(self) -> bool:
        """Whether the fit is known at every hold time."""
        return math.isfinite(self.beta) and math.isfinite(self.log_cutoff)

    @property
    def beta_half_width(self) -> float:
        """Half the width of the interval of β."""
        return 0.5 * (self.beta_interval.high - self.beta_interval.low)

    @property
    def b(self) -> float:
        """β/ln 10, the rise for each factor e of the hold time: b of rate-and-state friction, Δμ = b ln(t/t_c)
        (Dieterich, J. Geophys. Res. 77, 3690 (1972); Ruina, J. Geophys. Res. 88, 10359 (1983))."""
        return self.beta / LN10

    @property
    def b_stderr(self) -> float:
        """Standard error of :attr:`b`."""
        return self.beta_stderr / LN10

    @property
    def b_interval(self) -> Interval:
        """Interval of :attr:`b`."""
        low, high = self.beta_interval
        return Interval(low / LN10, high / LN10)

    @property
    def b_half_width(self) -> float:
        """Half the width of the interval of :attr:`b`."""
        return self.beta_half_width / LN10

    @property
    def relative_stderr(self) -> float:
        """Standard error of β over its magnitude; nan where it has none."""
        return self.beta_stderr / abs(self.beta) if self.beta != 0 else math.nan

    @property
    def unit(self) -> str:
        """Of β and b."""
        return DROPS[self.quantity].unit

    def quantities(self) -> list[Quantity]:
        """β, b and the cut-off time with their intervals; where there is none, why."""
        over = f"over {self.points} hold times from {self.span[0]:g} to {self.span[1]:g} s"
        reason = self._no_interval() if math.isnan(self.beta_interval.low) else ""
        doubtful = "; ".join(filter(None, (reason, self.doubt, self.bend_text())))
        slopes = [
            one.but(unit=self.unit, value=value, reason=why, of=of).within(
                *ends, error
            )
            for one, value, error, ends, why, of in (
                (
                    BETA,
                    self.beta,
                    self.beta_stderr,
                    self.beta_interval,
                    doubtful,
                    over,
                ),
                (B, self.b, self.b_stderr, self.b_interval, reason, ""),
            )
        ]
        why = (
            f"undetermined: {self.cutoff_reason}" if self.cutoff_reason else reason
        )
        cutoff = CUTOFF.but(value=self.cutoff_time, reason=why).within(
            *self.cutoff_interval, self.cutoff_time_stderr
        )
        shape = [
            one.but(unit=self.unit, value=getattr(self, one.name))
            for one in (RMS_RESIDUAL, SLOPE_FROM, SLOPE_TO)
        ]
        return [*slopes, cutoff, *shape]

    def texts(self) -> tuple[str, ...]:
        """β, b and the cut-off time, for the cells of a table."""
        return tuple(one.but(of="").text() for one in self.quantities()[:3])

    def beta_text(self) -> str:
        """β with its interval and unit."""
        return self.texts()[0]

    def cutoff_text(self) -> str:
        """The cut-off time with its interval, or why there is none."""
        return self.texts()[2]

    def _no_interval(self) -> str:
        """Why β has none, in words."""
        if self.replicas == 1:
            return "one replica: no error"
        scattered = self.beta_stderr > ROUNDING * abs(self.beta)
        return (
            "no interval: too few points" if scattered else NO_SCATTER.strip("()")
        )

    @property
    def doubt(self) -> str:
        """That there are too few hold times, or over too short a time, for a β of any others; else ""."""
        return few_hold_times(self.points, self.span)

    def symbol_text(self) -> str:
        """``β = 0.43(3)``: β with half of its interval in brackets, and its unit."""
        return self.quantities()[0].short()

    def short_text(self) -> str:
        """β with half of its interval in brackets, what was fitted, and what to doubt, for legends."""
        shape = "fitted line" if self.model == "line" else "fitted β log(1 + t/t_c)"
        text = f"{self.symbol_text()} per decade ({shape}, {span_text(self.span)})"
        doubt = self.doubt.partition(";")[0]
        return "\n".join(filter(None, (text, doubt, self.bend_lines)))

    def intervals_text(self) -> str:
        """How the intervals were found, in words."""
        if self.bootstrap is not None:
            drawn = self.replicas if self.bootstrap == "replicas" else self.points
            few = f"; too narrow for {drawn} {'replicas' if self.bootstrap == 'replicas' else 'points'}"
            return f"bootstrap of {self.bootstrap}, {self.samples} samples{few * (drawn < FOR_BOOTSTRAP)}"
        if self.replicas == 1:
            return "none: a single replica has no error"
        return (
            f"Student's t, {self.replicas} replicas"
            if self.replicas
            else f"Student's t, {self.points} points"
        )

    def describe(self) -> str:
        """The model, in words."""
        symbol = DROPS[self.quantity].symbol
        where = (
            f"{self.span[0]:g} s to {self.span[1]:g} s"
            + f"; {self.doubt}" * bool(self.doubt)
            + f"; {self.bend_text()}" * self.bent
        )
        shape = "log10(t/t_c)" if self.model == "line" else "log10(1 + t/t_c)"
        return f"{symbol} = β {shape}, {self.points} points, {where}"

    def todict(self) -> dict[str, object]:
        """Plain JSON values; what is not finite is None."""
        words = {
            "formula": self.describe().partition(",")[0],
            "unit": UNIT[self.quantity],
        }
        words |= {
            "cutoff_reason": self.cutoff_reason or None,
            "intervals": self.intervals_text(),
        }
        renamed = {"cutoff_time_interval": self.cutoff_interval, "range": self.span}
        return jsonable(
            {**words, **renamed, **{name: getattr(self, name) for name in _PLAIN}}
        )


def fit_ageing(
    data: Curves,
    *,
    model: Model = "line",
    window: tuple[QuantityLike, QuantityLike] | None = None,
    quantity: Friction | None = None,
    bootstrap: Bootstrap | None = None,
    samples: int = 2000,
    confidence: float = 0.95,
    seed: int = 0,
) -> Fit:
    """Fit β and the cut-off time t_c to measurements or to a simulated result, with confidence intervals.

    Least squares; rows count by 1/error² where errors are given, equally otherwise.

    Parameters
    ----------
    data
        Measurements, or a simulated result, of which the mean over replicas is fitted.
    model
        ``"line"``: β log10(t/t_c); ``"curve"``: β log10(1 + t/t_c).
    window
        First and last hold time to use (s, or strings with units); None: ``FIT_WINDOW`` for the line of a simulated
        result, all hold times otherwise. The line never uses t = 0.
    quantity
        What to fit of a simulated result: Δμ (default) or ΔF. Measurements are fitted as they are.
    bootstrap
        None: Student's intervals, see :mod:`chemage.ageing.models`. Otherwise what is resampled: ``"residuals"`` of
        measurements, at the same hold times; ``"pairs"``, whole rows of measurements, where the scatter depends on time
        in a way the errors do not state; ``"replicas"``, whole replicas of a simulated result. Its intervals are too
        narrow for fewer than about ten replicas or rows. No interval includes the scatter between surfaces.
    samples, confidence, seed
        Bootstrap samples, coverage of the intervals, and the seed of the bootstrap.

    Raises
    ------
    InputError
        Too few different hold times in the window (two for a simulated result, three for measurements), a coefficient
        of friction without load, or options that do not go together.
    """
    source = data.fit_data(quantity)
    _check_options(model, samples, confidence, bootstrap, source)
    ends = window or (FIT_WINDOW if source.simulated and model == "line" else None)
    limits = ends and (convert(ends[0], "s"), convert(ends[1], "s"))
    use = _inside(
        data.hold_times, limits, model, least=SIMULATED if source.simulated else 3
    )
    t, curves = data.hold_times[use], source.curves[:, use]
    weight = source.weights(use)
    slope, slope_error, log_cutoff, cutoff_error, fitted = _estimate(
        model, t, curves, weight, not source.simulated
    )
    slopes = cutoffs = UNKNOWN
    if bootstrap is not None:
        options = {"confidence": confidence, "samples": samples, "seed": seed}
        slopes, cutoffs = bootstrapped(
            bootstrap, model, t, curves, weight, fitted, **options
        )
    elif not source.simulated or len(curves) > 1:
        slopes, cutoffs = student(
            model, t, curves, weight, slope, slope_error, log_cutoff, confidence
        )
    unit, reason = (
        source.scale,
        _no_cutoff(slope, log_cutoff, slopes, data.hold_times),
    )
    cutoff = math.nan if reason else time_of(log_cutoff)
    forces = (
        source.simulated or source.quantity == "friction_drop"
    )  # curves of a simulated result are ΔF
    local, bent = (math.nan, math.nan, math.nan), False
    if model == "line":
        local = local_slopes(np.log10(t), curves.mean(axis=0), weight)
        bent = is_bent(np.log10(t), curves, weight, simulated=source.simulated)
    return Fit(
        model=model,
        quantity=source.quantity,
        beta=slope * unit,
        beta_stderr=slope_error * unit,
        cutoff_time=cutoff,
        cutoff_time_stderr=cutoff * LN10 * cutoff_error,
        cutoff_reason=reason,
        log_cutoff=log_cutoff,
        beta_interval=Interval(slopes.low * unit, slopes.high * unit),
        cutoff_interval=Interval(0.0, math.inf)
        if reason and math.isfinite(slopes.low)
        else cutoffs,
        friction_rate=slope if forces else None,
        friction_rate_stderr=slope_error if forces else None,
        window=limits,
        points=t.size,
        span=(float(t[t > 0].min()), float(t.max())),
        rms_residual=float(np.sqrt(np.mean((curves.mean(axis=0) - fitted) ** 2)))
        * unit,
        local_slopes=(local[0] * unit, local[1] * unit, local[2] * unit),
        bent=bent,
        replicas=len(curves) if source.simulated else 0,
        bootstrap=bootstrap,
        samples=samples,
        confidence=confidence,
        data=(source, data.hold_times),
    )


def line_slopes(
    hold_times: np.ndarray, curves: np.ndarray, window: tuple[float, float]
) -> np.ndarray:
    """(n,) rise per decade of the line through each of ``curves`` (n, m) over ``window`` (s), the fit of β: β of curves
    of the friction coefficient, or over the load of those of friction.

    It is linear in the curve, so that its mean is that of the mean curve.
    """
    use = within(hold_times, window) & (hold_times > 0)
    return slopes_of(np.log10(hold_times[use]), curves[:, use])


def line_weights(
    hold_times: np.ndarray, window: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool, the hold times in ``window`` (s), and for each of those the weight with which a curve enters
    :func:`line_slopes`."""
    use = within(hold_times, window) & (hold_times > 0)
    decades = np.log10(hold_times[use])
    return use, (decades - decades.mean()) / (np.var(decades) * decades.size)


def _no_cutoff(
    slope: float, log_cutoff: float, slopes: Interval, times: np.ndarray
) -> str:
    """Why a fit that meets zero at 10**``log_cutoff`` s has no cut-off time, in words; "" where it has one."""
    if slopes.high < 0 or (math.isnan(slopes.high) and slope < 0):
        return "β is below zero"
    if math.isnan(log_cutoff) or slopes.low <= 0:
        return "β is not distinguishable from zero"
    positive = times[times > 0]
    if log_cutoff < math.log10(positive.min()) - CUTOFF_DECADES:
        return f"the fit meets zero more than {CUTOFF_DECADES} decades before the hold times"
    if log_cutoff > math.log10(positive.max()) + CUTOFF_DECADES:
        return f"the fit meets zero more than {CUTOFF_DECADES} decades after the hold times"
    return ""


def few_hold_times(points: int, span: tuple[float, float]) -> str:
    """That β rests on fewer than six hold times, or less than two decades of them (``span``, s), in words; else ""."""
    decades = math.log10(span[1] / span[0])
    if points >= LEAST_POINTS and decades > LEAST_DECADES - 1e-6:
        return ""
    over = f"{decades:.2g} decade{'' if math.isclose(decades, 1) else 's'}"
    return f"β rests on {points} hold times over {over}; take at least six over two decades"


def span_text(span: tuple[float, float]) -> str:
    """``10–10⁴ s``: from the first to the last hold time of a fit."""
    return f"{power_text(span[0])}–{power_text(span[1])} s"


def _check_options(
    model: Model,
    samples: int,
    confidence: float,
    bootstrap: Bootstrap | None,
    given: FitData,
) -> None:
    if model not in get_args(Model):
        raise InputError.of(
            "model", model, f"choose {' or '.join(get_args(Model))}"
        )
    if samples < 100:
        raise InputError.of(
            "samples", samples, "is too few for an interval", "give 100 or more"
        )
    if not 0 < confidence < 1:
        raise InputError.of(
            "confidence", confidence, "must lie between 0 and 1", "give 0.95, say"
        )
    if bootstrap is None:
        return
    if bootstrap not in get_args(Bootstrap):
        raise InputError.of(
            "bootstrap",
            bootstrap,
            f"choose {', '.join(get_args(Bootstrap))}, or leave it out",
        )
    if bootstrap == "replicas" and len(given.curves) < 2:
        raise InputError(
            "bootstrap = 'replicas': there is a single curve, which has no scatter between replicas"
        )
    if bootstrap != "replicas" and given.simulated:
        raise InputError.of(
            "bootstrap",
            bootstrap,
            "the hold times of a simulated result share their bonds, so their scatter about the fit is not its error",
            "leave it out, or choose replicas",
        )


#: hold times that the line of a simulated result needs
SIMULATED = 2


def _inside(
    times: np.ndarray,
    limits: tuple[float, float] | None,
    model: Model,
    *,
    least: int,
) -> np.ndarray:
    """(m,) bool: the hold times that are fitted."""
    low, high = limits or (0.0, math.inf)
    use = within(times, (low, high)) & ((times > 0) | (model == "curve"))
    if (count := np.unique(times[use]).size) < least:
        raise InputError.of(
            "fit window",
            (low, high),
            f"holds {count} different hold times, and a fit needs {least}",
            "widen it, or take more hold times per decade",
        )
    return use


def why_not_fitted(times: np.ndarray, window: tuple[float, float]) -> str:
    """Why no line can be fitted to a simulated result at ``times`` within ``window``, both in s; "" where one can."""
    try:
        _inside(times, window, "line", least=SIMULATED)
    except InputError:
        count = np.unique(
            times[(times > 0) & (times >= window[0]) & (times <= window[1])]
        ).size
        lie = {0: "no hold time lies", 1: "one hold time lies"}.get(
            count, f"{count} hold times lie"
        )
        span = (
            f"{times[0]:g} to {times[-1]:g} s"
            if times.size > 1
            else f"{times[0]:g} s"
        )
        return (
            f"{lie} between {window[0]:g} and {window[1]:g} s, {SIMULATED} are needed (the hold times: {span}); change "
            "the fit window, or take more hold times"
        )
    return ""


def _estimate(
    model: Model,
    t: np.ndarray,
    curves: np.ndarray,
    weight: np.ndarray,
    scatter: bool,
) -> tuple[float, float, float, float, np.ndarray]:
    """Least squares on the mean over replicas: β and log10 t_c, each with its jackknife error over replicas, and the
    fit, (m,); ``scatter``: a single curve has errors from its scatter about the fit."""
    mean, replicas = curves.mean(axis=0), len(curves)
    slope, log_cutoff = (
        float(values[0]) for values in solve(model, t, mean[None], weight[None])
    )
    if model == "line":
        x = np.log10(t)
        fitted = np.average(mean, weights=weight) + slope * (
            x - np.average(x, weights=weight)
        )
    elif math.isnan(log_cutoff):
        fitted = np.full(t.size, np.average(mean, weights=weight))
    else:
        fitted = slope * basis(model, t, float(np.clip(log_cutoff, *bounds(t))))
    errors = (math.nan, math.nan)
    if replicas > 1:  # each is left out in turn
        left_out = (curves.sum(axis=0) - curves) / (replicas - 1)
        errors = tuple(
            float(jackknife_error(values))
            for values in solve(model, t, left_out, weight[None])
        )
    elif scatter:
        errors = _scatter(model, t, mean - fitted, weight, slope, log_cutoff)
    return slope, errors[0], log_cutoff, errors[1], fitted


def _scatter(
    model: Model,
    t: np.ndarray,
    rest: np.ndarray,
    weight: np.ndarray,
    slope: float,
    log_cutoff: float,
) -> tuple[float, float]:
    """Standard errors from the scatter ``rest`` of independent measurements about the fit; nan where undetermined."""
    if model == "line" and math.isnan(log_cutoff):
        log_cutoff, slope = float(np.average(np.log10(t), weights=weight)), math.nan
    if t.size < 3 or not math.isfinite(log_cutoff):
        return math.nan, math.nan
    # the derivatives of the fit by β and by log10 t_c, the second divided by β
    parts = np.stack(
        [basis(model, t, log_cutoff), basis_slope(model, t, log_cutoff)]
    )
    (a, b), (_, c) = np.einsum("im,jm->ij", parts, weight * parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (
            np.float64((weight * rest**2).sum()) / (t.size - 2) / (a * c - b * b)
        )
        return float(np.sqrt(spread * c)), float(np.sqrt(spread * a)) / abs(slope)
