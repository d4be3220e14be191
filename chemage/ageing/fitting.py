"""The one fit of β and the cut-off time, to measurements or to a simulated result.

Two models are fitted, and every result names its model:

``"line"``
    Δμ = β log10(t / t_c) over a window of hold times, the definition of β in the literature.
``"curve"``
    Δμ = β log10(1 + t / t_c), which is 0 at t = 0 and becomes the line for t ≫ t_c; any hold times, 0 included.

Standard errors are jackknife errors over replicas; intervals come from the bootstrap with a fixed seed: the same data
give the same digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.text import jsonable, with_interval
from chemage.foundation.units import convert

Quantity = Literal["friction_coefficient_drop", "friction_drop"]
Model = Literal["line", "curve"]
Bootstrap = Literal["residuals", "pairs", "replicas"]

#: default of the first and last hold time of the line, s
FIT_WINDOW = (10.0, 1e4)
#: quantity -> its unit inside chemage
UNIT: dict[str, str] = {"friction_coefficient_drop": "", "friction_drop": "nN"}
#: quantity -> how it is written
SYMBOL: dict[str, str] = {"friction_coefficient_drop": "Δμ", "friction_drop": "ΔF"}


class Curves(Protocol):
    """What can be fitted: one curve of measurements, or one per replica."""

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        ...

    def fit_data(self, quantity: Quantity | None) -> FitData:
        """The curves of ``quantity``, or of the natural one where that is None."""
        ...


@dataclass(frozen=True)
class FitData:
    """Curves as the fit takes them."""

    #: (replicas, m), or (1, m) for measurements; ``quantity`` is ``scale`` times this
    curves: np.ndarray
    quantity: Quantity
    scale: float = 1.0
    #: (m,) standard errors of the curve, in its unit
    error: np.ndarray | None = None
    #: whether the curves were computed
    simulated: bool = False


@dataclass(frozen=True)
class Interval:
    """Ends of a confidence interval; an end that the data do not bound is infinite (for a time: 0 or infinite)."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Fit:
    """β and the cut-off time, with standard errors over replicas and bootstrap intervals."""

    model: Model
    quantity: Quantity
    #: per decade: a pure number for Δμ, nN for ΔF
    beta: float
    #: jackknife over replicas, or from the scatter about the line for a single curve; nan where neither exists
    beta_stderr: float
    #: where the line meets zero, s; nan where the data do not determine it
    cutoff_time: float
    cutoff_time_stderr: float
    beta_interval: Interval
    cutoff_interval: Interval
    #: dΔF/dlog10 t, nN per decade; None for measurements of Δμ, whose load is not known
    friction_rate: float | None
    friction_rate_stderr: float | None
    #: s; None: all hold times
    window: tuple[float, float] | None
    #: hold times (or rows) used
    points: int
    #: root mean square distance of the data from the fit, in the unit of the quantity
    rms_residual: float
    bootstrap: Bootstrap
    samples: int
    confidence: float

    def __eq__(self, other: object) -> bool:
        # by their text, in which what is not known, nan, equals itself; floats are exact in it
        return isinstance(other, Fit) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    def __call__(self, hold_times: np.ndarray | float) -> np.ndarray:
        """The fitted value at ``hold_times`` (s)."""
        return self.beta * _basis(self.model, np.asarray(hold_times, dtype=np.float64), math.log10(self.cutoff_time))

    def beta_text(self) -> str:
        """β with its interval and unit."""
        text = with_interval(self.beta, self.beta_interval.low, self.beta_interval.high)
        return f"{text} {UNIT[self.quantity]}".strip()

    def cutoff_text(self) -> str:
        """The cut-off time with its interval."""
        return f"{with_interval(self.cutoff_time, self.cutoff_interval.low, self.cutoff_interval.high)} s"

    def describe(self) -> str:
        """The model, in words."""
        symbol = SYMBOL[self.quantity]
        where = "all hold times" if self.window is None else f"{self.window[0]:g} s to {self.window[1]:g} s"
        shape = "log10(t/t_c)" if self.model == "line" else "log10(1 + t/t_c)"
        return f"{symbol} = β {shape}, {self.points} points, {where}"

    def todict(self) -> dict[str, object]:
        """Plain JSON values; what is not finite is None."""
        return jsonable(
            {
                "model": self.model,
                "formula": self.describe().partition(",")[0],
                "quantity": self.quantity,
                "unit": UNIT[self.quantity],
                "beta": self.beta,
                "beta_stderr": self.beta_stderr,
                "beta_interval": [self.beta_interval.low, self.beta_interval.high],
                "cutoff_time": self.cutoff_time,
                "cutoff_time_stderr": self.cutoff_time_stderr,
                "cutoff_time_interval": [self.cutoff_interval.low, self.cutoff_interval.high],
                "window": list(self.window) if self.window else None,
                "points": self.points,
                "rms_residual": self.rms_residual,
                "bootstrap": self.bootstrap,
                "samples": self.samples,
                "confidence": self.confidence,
            }
        )


def fit_aging(
    data: Curves,
    *,
    model: Model = "line",
    window: tuple[float | str, float | str] | None = None,
    quantity: Quantity | None = None,
    bootstrap: Bootstrap | None = None,
    samples: int = 2000,
    confidence: float = 0.95,
    seed: int = 0,
) -> Fit:
    """Fit β and the cut-off time t_c to measurements or to a simulated result, with bootstrap intervals.

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
        What is resampled. ``"residuals"`` (default for measurements): distances from the fit, at the same hold times;
        ``"pairs"``: whole rows, where the scatter depends on time in a way the errors do not state; ``"replicas"``
        (default for several replicas): whole replicas, so that errors correlated in time are kept. It does not include
        the scatter between surfaces.
    samples, confidence, seed
        Bootstrap samples, coverage, and the seed they are drawn with. Percentile intervals, widened for small numbers
        as Student's t is (Hesterberg, Am. Stat. 69, 371 (2015), expanded percentile interval).

    Raises
    ------
    InputError
        Too few different hold times in the window (two for a simulated result, three for measurements), a coefficient
        of friction without load, or options that do not go together.
    """
    if model not in get_args(Model):
        raise InputError.of("model", model, f"choose {' or '.join(get_args(Model))}")
    if samples < 100:
        raise InputError.of("samples", samples, "is too few for an interval", "give 100 or more")
    if not 0 < confidence < 1:
        raise InputError.of("confidence", confidence, "must lie between 0 and 1", "give 0.95, say")
    given = data.fit_data(quantity)
    kind = _kind_of(bootstrap, given.curves.shape[0])
    if window is None and given.simulated and model == "line":
        window = FIT_WINDOW
    limits = None if window is None else (convert(window[0], "s"), convert(window[1], "s"))
    use = _inside(data.hold_times, limits, model, least=2 if given.simulated else 3)
    t, curves = data.hold_times[use], given.curves[:, use]
    weight = np.ones(t.size) if given.error is None else 1 / given.error[use] ** 2
    weight = weight / weight.mean()
    estimate = _estimate(model, t, curves, weight)
    ends = _expanded(confidence, {"replicas": len(curves) - 1}.get(kind, t.size - 2))
    slopes, cutoffs = _bootstrap(kind, model, t, curves, weight, estimate, samples, seed)
    unit = given.scale
    # the curves of a simulated result are ΔF whatever is fitted
    forces = given.simulated or given.quantity == "friction_drop"
    return Fit(
        model=model,
        quantity=given.quantity,
        beta=estimate.slope * unit,
        beta_stderr=estimate.slope_error * unit,
        cutoff_time=_time(estimate.log_cutoff),
        cutoff_time_stderr=_time(estimate.log_cutoff) * math.log(10) * estimate.cutoff_error,
        beta_interval=_interval(slopes * unit, ends),
        cutoff_interval=_cutoff_interval(cutoffs, slopes, ends),
        friction_rate=estimate.slope if forces else None,
        friction_rate_stderr=estimate.slope_error if forces else None,
        window=limits,
        points=t.size,
        rms_residual=float(np.sqrt(np.mean((curves.mean(axis=0) - estimate.fitted) ** 2))) * unit,
        bootstrap=kind,
        samples=samples,
        confidence=confidence,
    )


def _kind_of(bootstrap: Bootstrap | None, curves: int) -> Bootstrap:
    kind: Bootstrap = bootstrap or ("replicas" if curves > 1 else "residuals")
    if kind not in get_args(Bootstrap):
        raise InputError.of("bootstrap", kind, f"choose {', '.join(get_args(Bootstrap))}")
    if kind == "replicas" and curves < 2:
        raise InputError("bootstrap = 'replicas': there is a single curve; choose residuals or pairs")
    return kind


def _inside(times: np.ndarray, limits: tuple[float, float] | None, model: Model, *, least: int) -> np.ndarray:
    """(m,) bool: the hold times that are fitted."""
    low, high = limits or (0.0, math.inf)
    # a hold time given as 10.000000000000002 belongs to the window that starts at 10
    use = (times >= low * (1 - 1e-9)) & (times <= high * (1 + 1e-9)) & ((times > 0) | (model == "curve"))
    if (count := np.unique(times[use]).size) < least:
        raise InputError.of(
            "fit window",
            (low, high),
            f"holds {count} different hold times, and a fit needs {least}",
            "widen it, or take more hold times per decade",
        )
    return use


@dataclass(frozen=True)
class _Estimate:
    slope: float
    slope_error: float
    log_cutoff: float
    cutoff_error: float
    #: (m,)
    fitted: np.ndarray


def _estimate(model: Model, t: np.ndarray, curves: np.ndarray, weight: np.ndarray) -> _Estimate:
    """Least squares on the mean over replicas, with jackknife errors over replicas."""
    mean = curves.mean(axis=0)
    even = bool((weight == 1).all())

    def solved(y: np.ndarray) -> tuple[float, float]:
        if model == "line" and even:
            return _straight_line(np.log10(t), y)
        slope, cutoff = _solve(model, t, y[None, :], weight[None, :])
        return float(slope[0]), float(cutoff[0])

    slope, log_cutoff = solved(mean)
    if math.isnan(log_cutoff):
        fitted = np.full(t.size, float((weight * mean).sum() / weight.sum()))
    else:
        fitted = slope * _basis(model, t, float(np.clip(log_cutoff, *_bounds(t))))
    errors = _jackknife(solved, curves) if len(curves) > 1 else (math.nan, math.nan)
    if len(curves) == 1 and model == "line" and even and t.size > 2:
        errors = _scatter(np.log10(t), mean, slope, log_cutoff)
    return _Estimate(slope, errors[0], log_cutoff, errors[1], fitted)


def _straight_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope, and where the line meets zero; nan where it does not rise."""
    slope = float((x - x.mean()) @ (y - y.mean()) / np.sum((x - x.mean()) ** 2))
    intercept = float(y.mean() - slope * x.mean())
    return slope, -intercept / slope if slope > 0 else math.nan


def _jackknife(solved: Callable[[np.ndarray], tuple[float, float]], curves: np.ndarray) -> tuple[float, float]:
    """Standard errors of slope and log10 cut-off time, each replica left out in turn."""
    r, total = len(curves), curves.sum(axis=0)
    left_out = np.array([solved((total - one) / (r - 1)) for one in curves])
    slope, cutoff = np.sqrt((r - 1) / r * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))
    return float(slope), float(cutoff)


def _scatter(x: np.ndarray, y: np.ndarray, slope: float, log_cutoff: float) -> tuple[float, float]:
    """Standard errors from the scatter about the line, which understates them: neighbouring times share bonds."""
    spread = np.sum((y - y.mean() - slope * (x - x.mean())) ** 2) / (x.size - 2)
    slope_error = math.sqrt(spread / np.sum((x - x.mean()) ** 2))
    if not slope > 0:
        return slope_error, math.nan
    height_error = math.sqrt(spread / x.size)
    return slope_error, math.hypot(height_error / slope, slope_error * (x.mean() - log_cutoff) / slope)


def _bootstrap(
    kind: Bootstrap,
    model: Model,
    t: np.ndarray,
    curves: np.ndarray,
    weight: np.ndarray,
    estimate: _Estimate,
    samples: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes and log10 cut-off times of the bootstrap samples, (samples,) each; all nan for two points of one curve."""
    if kind != "replicas" and t.size < 3:
        return np.full(samples, np.nan), np.full(samples, np.nan)
    heights, weights = _resampled(kind, np.random.default_rng(seed), samples, curves, estimate.fitted, weight)
    return _solve(model, t, heights, weights)


def _time(log_time: float) -> float:
    """10**log_time, s; inf beyond the range of numbers, nan where nothing is known."""
    with np.errstate(over="ignore"):
        return float(np.power(10.0, log_time))


def _basis(model: Model, t: np.ndarray, log_cutoff: np.ndarray | float) -> np.ndarray:
    """The model at β = 1; ``t`` and ``log_cutoff`` broadcast."""
    if model == "line":
        return np.log10(t) - log_cutoff
    # log10(1 + t/t_c) without overflow where t_c is far below t
    log_t = np.log(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return np.logaddexp(0.0, log_t - np.multiply(log_cutoff, math.log(10))) / math.log(10)


def _solve(model: Model, t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares for each row of ``y`` (b, m) with weights ``w`` (b or 1, m): β and log10 t_c, (b,) each.

    log10 t_c is ±inf or nan where no finite cut-off time is best.
    """
    return _solve_line(t, y, w) if model == "line" else _solve_curve(t, y, w)


def _solve_line(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.log10(t)
    total = w.sum(axis=1)
    centre, height = (w * x).sum(axis=1) / total, (w * y).sum(axis=1) / total
    away = x - centre[:, None]
    spread = (w * away**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (w * away * y).sum(axis=1) / spread
        # a resample of one hold time, or a line that does not rise, crosses zero nowhere that means anything
        return slope, np.where(slope > 0, centre - height / slope, np.nan)


def _bounds(t: np.ndarray) -> tuple[float, float]:
    """Where log10 t_c is searched: beyond, the curve is a constant or a straight line in t, and t_c means nothing."""
    return math.log10(t[t > 0].min()) - 30.0, math.log10(t.max()) + 4.0


def _solve_curve(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For a given t_c the best β is a ratio of sums, so only log10 t_c is searched: a coarse grid, then ever finer."""
    lowest, highest = _bounds(t)
    grid = np.arange(lowest, highest + 0.05, 0.1)
    basis = _basis("curve", t, grid[:, None])
    w = np.broadcast_to(w, y.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = ((w * y) @ basis.T) ** 2 / (w @ (basis**2).T)
        # a resample of t = 0 alone determines nothing: 0/0
        centre, step = grid[np.nan_to_num(gain, nan=-1.0).argmax(axis=1)], 0.1
        at_end = (centre <= grid[0]) | (centre >= grid[-1])
        offsets = np.linspace(-1.0, 1.0, 9)
        while step > 1e-7:
            tried = centre[:, None] + step * offsets
            shapes = _basis("curve", t, tried[:, :, None])
            products = np.einsum("bm,bkm->bk", w * y, shapes)
            gain = products**2 / np.einsum("bm,bkm->bk", w, shapes**2)
            best = np.nan_to_num(gain, nan=-1.0).argmax(axis=1)[:, None]
            centre = np.take_along_axis(tried, best, axis=1)[:, 0]
            step /= 4.0
        shapes = _basis("curve", t, centre[:, None])
        slope = (w * y * shapes).sum(axis=1) / (w * shapes**2).sum(axis=1)
    limit = np.where(centre > 0.5 * (lowest + highest), np.inf, -np.inf)
    return slope, np.where(slope > 0, np.where(at_end, limit, centre), np.nan)


def _resampled(
    kind: Bootstrap,
    generator: np.random.Generator,
    samples: int,
    curves: np.ndarray,
    fitted: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Bootstrap data: values (b, m), weights (b or 1, m)."""
    replicas, points = curves.shape
    if kind == "replicas":
        # deviations are stretched, since a draw from r replicas has (r − 1)/r of the variance
        drawn = generator.multinomial(replicas, np.full(replicas, 1 / replicas), samples) / replicas
        mean = curves.mean(axis=0)
        return mean + (drawn @ curves - mean) * math.sqrt(replicas / (replicas - 1)), weight[None, :]
    mean = curves.mean(axis=0)
    if kind == "pairs":
        times_drawn = generator.multinomial(points, np.full(points, 1 / points), samples)
        return np.broadcast_to(mean, (samples, points)), times_drawn * weight
    scaled = (mean - fitted) * np.sqrt(weight)
    scaled = (scaled - scaled.mean()) * math.sqrt(points / (points - 2))
    drawn = generator.integers(0, points, (samples, points))
    return fitted + scaled[drawn] / np.sqrt(weight), weight[None, :]


def _expanded(confidence: float, freedom: int) -> tuple[float, float]:
    """Percentiles (in per cent) whose normal distance is Student's t for ``freedom``: a small sample's wider tails."""
    from scipy import stats

    tail = float(stats.norm.cdf(stats.t.ppf((1 - confidence) / 2, max(freedom, 1))))
    return 100 * tail, 100 * (1 - tail)


def _interval(values: np.ndarray, ends: tuple[float, float]) -> Interval:
    # order statistics, not interpolated: infinite values must not turn into nan
    finite = np.sort(values[~np.isnan(values)])
    if not finite.size:
        return Interval(math.nan, math.nan)
    low, high = (np.percentile(finite, end, method="nearest") for end in ends)
    return Interval(float(low), float(high))


def _cutoff_interval(log_times: np.ndarray, slopes: np.ndarray, ends: tuple[float, float]) -> Interval:
    """Where more samples than a tail holds do not rise at all, the data set no bounds: 0 to infinity."""
    if np.count_nonzero(~(slopes > 0)) > ends[0] / 100 * slopes.size:
        return Interval(0.0, math.inf)
    logs = _interval(log_times, ends)
    with np.errstate(over="ignore"):
        return Interval(float(np.power(10.0, logs.low)), float(np.power(10.0, logs.high)))
