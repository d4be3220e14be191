"""Parameters of a rate-and-state law from a trace: least squares with correlated noise, whether the law explains it, and
how this is shown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from chemage import InputError
from chemage.plugin import (
    Panel,
    Picture,
    Quantity,
    Rank,
    Result,
    figures,
    statistics,
)
from chemage_rate_state.laws import LAWS, Law, Parameters, change
from chemage_rate_state.traces import Trace

#: from where fits begin: D_c over the way after the first change, b/a, and K D_c/a above that at which sliding is unstable
LENGTHS = (2e-3, 6e-3, 0.02, 0.06, 0.2)
RATIOS, ABOVE = (0.5, 0.9, 1.2, 1.6, 2.5), (0.05, 0.3, 2.0, 15.0)
#: points from which starts are fitted, and of a trace at most
SOME, POINTS = 400, 6000
#: memory of noise, ARFIMA(1, d, 1), that is tried first, and its bounds
WHITE = (0.0, 0.0, 0.0)
MEMORIES = (WHITE, (0.7, 0.0, 0.0), (0.0, 0.5, 0.0), (0.9, 0.0, -0.6))
BOUNDS = ((-0.9, 0.99), (0.0, 1.0), (-0.95, 0.95))
#: difference of misfits, twice the logarithm of the ratio of likelihoods, from which fits are told apart, and from which
#: a minimum is left; difference of logarithms below which two are one
TOLD, NEAR, SAME = 6.0, 50.0, 0.05
#: friction where the slider is unstable, and steps of the integration for each point at most, on average
UNSTABLE, MOST = 1e3, 50
#: how often the time after each change is halved to test what is left
HALVES = 7
#: probability by chance below which a law does not explain a trace, and error of a logarithm above which it is not judged
UNLIKELY, UNTOLD = 0.01, 0.5

DECLARED = (
    Quantity("a", "1", "direct effect", "a", rank=Rank.FIRST),
    Quantity("b", "1", "evolution effect", "b", rank=Rank.FIRST),
    Quantity("slip_length", "um", "slip length", "D_c", rank=Rank.FIRST),
    Quantity("stiffness", "1/um", "stiffness over the normal force", "K"),
)
BOTH = Quantity("a_minus_b", "1", "velocity dependence", "a − b")
NOISE = Quantity("noise", "1", "standard deviation of what is left")


@dataclass(frozen=True, eq=False)
class RateStateFit:
    """One law fitted to one trace."""

    trace: Trace
    law: Law
    parameters: Parameters
    #: (m,) friction of the law, with constant and trends
    fitted: np.ndarray
    #: (k, k) covariance of ln a, ln b, ln D_c and, if it was fitted, ln K
    covariance: np.ndarray
    freedom: int
    #: minus twice the logarithm of the likelihood
    misfit: float
    #: probability that what is left after the changes of speed is noise
    probability: float
    #: other minima, and by how much their misfit is larger
    rivals: list[tuple[Parameters, float]]

    def quantities(self) -> list[Quantity]:
        """Parameters with 95 % intervals."""
        limit, found = statistics.student_limit(self.freedom), []
        errors = np.sqrt(np.diag(self.covariance))
        for one, value, error in zip(
            DECLARED, self.parameters, errors, strict=False
        ):
            ratio = np.exp(limit * error)
            ends = value / ratio, value * ratio
            found.append(
                one.but(value=value, stated="ends").within(*ends, value * error)
            )
        if errors.size < len(DECLARED):
            given = self.parameters.stiffness
            found.append(DECLARED[-1].but(value=given, reason="given"))
        slopes = np.array(self.parameters[:2]) * (1, -1)
        error = float(np.sqrt(slopes @ self.covariance[:2, :2] @ slopes))
        noise = NOISE.but(value=float((self.trace.friction - self.fitted).std()))
        both = BOTH.but(value=slopes.sum()).between(limit * error, error)
        return [*found, both, noise]

    @property
    def explains(self) -> bool:
        """Whether what the law leaves is noise, which leaves a, b and D_c to be seen."""
        return self.words().startswith("explains")

    def words(self) -> str:
        """Whether the law explains the trace."""
        if np.diag(self.covariance)[:3].max() >= UNTOLD**2:
            return "cannot be judged: the noise hides a, b or D_c"
        if self.probability >= UNLIKELY:
            return f"explains the trace (p = {self.probability:.2g})"
        return (
            f"does not explain the trace: after changes of speed it leaves more than noise (p = {self.probability:.1g}); "
            "intervals are of a wrong law"
        )


def fit_rate_state(trace: Trace, law: Law = "ageing") -> RateStateFit:
    """``law`` fitted to ``trace``, with a constant and trends linear in displacement and time; the stiffness too, unless
    the trace has it.

    Fits begin all over the ranges of D_c, b/a and stiffness; the best is kept. The memory of the noise is that of the
    largest restricted likelihood (Patterson & Thompson, Biometrika 58, 545 (1971)).

    Raises
    ------
    InputError
        There is no such law, or the trace does not tell its parameters.
    """
    if law not in LAWS:
        raise InputError(f"law: {law!r}; there are {', '.join(LAWS)}")
    some = _Misfit(law, trace, SOME)
    ends = _distinct(map(some.least, some.starts()))
    if not ends:
        raise InputError(
            f"the {law} law is unstable from every start; check units and stiffness"
        )
    misfit = _Misfit(law, trace, POINTS)
    misfit.whiten(misfit.memory_at(misfit.least(ends[0].x)))
    best, *others = _distinct(misfit.least(one.x) for one in ends)
    freedom = best.fun.size - best.x.size - misfit.base.shape[1]
    try:
        covariance = np.linalg.inv(best.jac.T @ best.jac) * 2 * best.cost / freedom
    except np.linalg.LinAlgError:
        raise InputError(
            f"{trace.name}: does not tell the parameters of the {law} law; give --stiffness, or a trace "
            "with more slip after a change of speed"
        ) from None
    parameters = misfit.parameters(best.x)
    model = change(law, parameters, trace.loading, trace.times)
    drifts = _drifts(trace)
    shift = np.linalg.lstsq(drifts, trace.friction - model, rcond=None)[0]
    rivals = [
        (misfit.parameters(one.x), more)
        for one in others
        if (more := _size(one) - _size(best)) < TOLD
    ]
    return RateStateFit(
        trace,
        law,
        parameters,
        model + drifts @ shift,
        covariance,
        freedom,
        _size(best),
        misfit.probability(best),
        rivals,
    )


def _size(end: Any) -> float:
    """Minus twice the logarithm of the likelihood."""
    return float(end.fun.size * np.log(2 * end.cost / end.fun.size))


def _distinct(ends: Iterable[Any]) -> list[Any]:
    """The best, and others near it."""
    kept: list[Any] = []
    for one in sorted(ends, key=_size):
        new = all(np.abs(one.x - other.x).max() > SAME for other in kept)
        if new and _size(one) < _size((kept or [one])[0]) + NEAR:
            kept.append(one)
    return kept


def _drifts(trace: Trace) -> np.ndarray:
    """(m, 3) constant, and trends with displacement and time."""
    return np.stack([np.ones(trace.times.size), trace.way, trace.times], axis=1)


class _Misfit:
    """What a law leaves of some points, for logarithms of a, b, D_c and, unless the trace has it, K."""

    def __init__(self, law: Law, trace: Trace, points: int) -> None:
        kept = slice(None, None, -(-trace.times.size // points))
        self.law: Law = law
        self.loading = trace.loading
        self.given = [] if trace.stiffness is None else [trace.stiffness]
        self.times, self.friction = trace.times[kept], trace.friction[kept]
        self.drifts = _drifts(trace)[kept]
        self.whiten(WHITE)

    def whiten(self, memory: Sequence[float]) -> None:
        """From here on noise has this ``memory``."""
        self.memory = memory
        self.base = np.linalg.qr(_whitened(self.drifts, memory))[0]

    def parameters(self, logs: np.ndarray) -> Parameters:
        free = np.exp(np.clip(logs, -50, 50)).tolist()
        return Parameters(*free, *self.given)

    def model(self, one: Parameters) -> np.ndarray:
        """(m,) change of friction."""
        steps = MOST * (self.times.size + MOST)
        return change(self.law, one, self.loading, self.times, steps)

    def left(self, logs: np.ndarray) -> np.ndarray:
        """(n,) what no constant and no trend explain either, as multiples of independent noise."""
        model = self.model(self.parameters(logs))
        away = self.friction - np.nan_to_num(model, nan=UNSTABLE)
        rest = _whitened(away[:, None], self.memory)[:, 0]
        return rest - self.base @ (self.base.T @ rest)

    def least(self, start: np.ndarray) -> Any:
        """The minimum of its squares from ``start``."""
        from scipy.optimize import least_squares

        how: Any = {"diff_step": 1e-5, "ftol": 1e-6, "xtol": 1e-10, "max_nfev": 60}
        return least_squares(self.left, start, "3-point", x_scale="jac", **how)

    def starts(self) -> list[np.ndarray]:
        """The best of each D_c; where K is free a follows from the size of the change."""
        found = []
        ends = np.array([self.loading.times[1], self.times[-1]])
        for length in np.diff(self.loading.displacement(ends)) * LENGTHS:
            tried = []
            for ratio, above in product(RATIOS, ABOVE):
                pull = max(ratio - 1.0, 0.0) + above
                one = Parameters(1.0, ratio, length, pull / length)
                shape = self.model(one)
                if not np.isfinite(shape[-1]):
                    continue
                if self.given:
                    size = self.given[0] * length / pull
                else:
                    columns = np.column_stack([self.drifts, shape])
                    solved = np.linalg.lstsq(columns, self.friction, rcond=None)[0]
                    size = max(solved[-1], 1e-4)
                logs = np.log([size, size * ratio, length, size * pull / length])
                tried.append(logs[: 4 - len(self.given)])
            if tried:
                found.append(
                    min(tried, key=lambda one: np.sum(self.left(one) ** 2))
                )
        return found

    def parts(self) -> np.ndarray:
        """(m, parts) functions of the time after each change of speed, linear between its end, its half, its quarter, ..."""
        begins = np.append(self.loading.times, self.times[-1] + 1e-9)
        part = np.searchsorted(begins, self.times, "right") - 1
        share = (self.times - begins[part]) / (begins[part + 1] - begins[part])
        half = np.clip(-np.log2(np.maximum(share, 1e-9)), 0, HALVES)[:, None]
        near = np.maximum(0.0, 1.0 - np.abs(half - np.arange(1, HALVES + 1)))
        found = [near * (part == k)[:, None] for k in range(1, begins.size - 1)]
        every = np.concatenate(found, axis=1)
        return every[:, np.count_nonzero(every, axis=0) > 1]

    def memory_at(self, end: Any) -> Sequence[float]:
        """Of the noise, where its restricted likelihood is largest; of white noise."""
        from scipy.optimize import minimize

        last = slice(-end.fun.size, None)
        every = np.column_stack(
            [self.drifts[last], end.jac, self.parts()[last], end.fun]
        )
        every /= np.abs(every).max(axis=0)

        def cost(memory: Any) -> float:
            white = _whitened(every, memory)
            squares = white.T @ white
            squares += np.diag(1e-12 * np.diag(squares))
            sizes = 2 * np.log(np.diag(np.linalg.cholesky(squares)))
            return (len(white) - sizes.size + 1) * sizes[-1] + sizes[:-1].sum()

        how = {"xatol": 0.01, "fatol": 0.05, "maxfev": 120}
        start = min(MEMORIES, key=cost)
        return minimize(
            cost, start, method="Nelder-Mead", bounds=BOUNDS, options=how
        ).x

    def probability(self, end: Any) -> float:
        """That parts of the time after each change leave nothing but noise (F-test)."""
        from scipy.stats import f

        parts = _whitened(self.parts(), self.memory)
        every = np.column_stack([end.jac, self.base, parts])
        left = end.fun - every @ np.linalg.lstsq(every, end.fun, rcond=None)[0]
        more, freedom = parts.shape[1], len(every) - every.shape[1]
        ratio = (2 * end.cost / (left @ left) - 1) * freedom / more
        return float(f.sf(ratio, more, freedom))


def _whitened(values: np.ndarray, memory: Sequence[float]) -> np.ndarray:
    """(n, k) values (m, k) as multiples of independent noise; without the first points, whose past is not known."""
    from scipy.signal import fftconvolve, lfilter

    ar, power, ma = memory
    size = len(values)
    k = np.arange(1, size)
    past = np.append(1.0, np.cumprod((k - 1 - power) / k))[:, None]
    if power:
        values = fftconvolve(values, past, axes=0)[:size]
    white: Any = lfilter([1.0, -ar], [1.0, ma], values, axis=0)
    return white[size // 50 + 1 :]


class RateStateFits(Result):
    """Laws fitted to one trace as users see them, and why others could not be."""

    errors = "95 % intervals, with the correlation of the noise"

    def __init__(self, trace: Trace, laws: Iterable[Any] = LAWS) -> None:
        self.trace, self.fits = trace, []
        self.failed: dict[str, str] = {}
        for law in laws:
            try:
                self.fits.append(fit_rate_state(trace, law))
            except InputError as error:
                self.failed[f"{law} law"] = f"not fitted: {error}"
        if not self.fits:
            raise InputError("; ".join(self.failed.values()))
        self.fits.sort(key=lambda one: one.misfit)

    @property
    def name(self) -> str:
        return self.trace.name

    def facts(self) -> list[tuple[str, str]]:
        """Whether laws explain the trace, which other minima fit nearly as well, and whether laws are told apart."""
        loading = zip(*self.trace.loading, strict=True)
        speeds = (f"{speed:.4g} µm/s from {time:.6g} s" for time, speed in loading)
        rows = [
            ("speeds of the load point", ", ".join(speeds)),
            *self.failed.items(),
        ]
        for fit in self.fits:
            law, more = f"{fit.law} law", fit.misfit - self.fits[0].misfit
            rows.append((law, fit.words()))
            if more:
                told = (
                    "fits worse" if more >= TOLD else "is not told from the other"
                )
                rows.append(
                    (f"{law} beside the other", f"{told}: misfit {more:.1f} larger")
                )
            for (a, b, length, _), more in fit.rivals:
                other = f"a {a:.3g}, b {b:.3g}, D_c {length:.3g} µm"
                rows.append(
                    (f"{law} fits nearly as well, misfit {more:.1f} larger", other)
                )
        return rows

    def quantities(self) -> list[Quantity]:
        return [
            one.but(
                name=f"{fit.law}_{one.name}", label=f"{fit.law} law: {one.label}"
            )
            for fit in self.fits
            for one in fit.quantities()
        ]

    def numbers(self) -> dict[str, Any]:
        times, speeds = self.trace.loading
        found = {"speeds": speeds.tolist(), "changes": times[1:].tolist()}
        explain = {f"{fit.law}_explains": fit.explains for fit in self.fits}
        return super().numbers() | found | explain

    def columns(self) -> dict[str, Any]:
        return {
            "time (s)": self.trace.times,
            "displacement (um)": self.trace.way,
            "friction_coefficient": self.trace.friction,
            **{f"{fit.law}_law": fit.fitted for fit in self.fits},
        }

    def pictures(self) -> dict[str, Picture]:
        """Friction against the displacement of the load point, with the laws."""
        return {"fits": Picture([Panel(self.plotted)])}

    def plotted(self, axes: Any, medium: Any = None) -> None:
        """Draw the trace and the laws."""
        trace = self.trace
        axes.plot(trace.way, trace.friction, ".", color="0.7", label="trace")
        for fit in self.fits:
            axes.plot(trace.way, fit.fitted, label=f"{fit.law} law")
        axes.set(
            xlabel="displacement of the load point (µm)",
            ylabel="friction coefficient",
        )
        figures.legend(axes)
