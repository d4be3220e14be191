"""Parameters of a rate-and-state law from a trace: least squares with correlated noise, and whether the law explains it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from chemage import InputError
from chemage.plugin import Quantity, Rank, statistics
from chemage_rate_state.laws import LAWS, Law, Parameters, change
from chemage_rate_state.traces import Trace

#: from where fits begin: D_c over the way after the first change, b/a, and K D_c/a above that at which sliding is unstable
LENGTHS = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)
RATIOS = (0.5, 0.9, 1.2, 1.6, 2.5)
ABOVE = (0.05, 0.3, 1.5, 8.0, 40.0)
#: force of the spring after the largest step of the load point, over a, from which no trace tells how stiff it is, and D_c
#: over the way below which none tells it
RIGID, SHORT = 30.0, 1e-5
#: points of which starts are compared, and means of points that are fitted, at most
SOME, POINTS = 400, 2000
#: memory of the noise from which its likelihood is improved, and between which bounds
WHITE = (0.0, 0.0, 0.0)
MEMORIES = (WHITE, (0.7, 0.0, 0.0), (0.0, 0.5, 0.0), (0.9, 0.0, -0.6))
BOUNDS = ((-0.9, 0.99), (0.0, 1.0), (-0.95, 0.95))
#: difference of misfits, twice the logarithm of the ratio of likelihoods, from which fits are told apart
TOLD = 6.0
#: difference of misfits above which a minimum is left, and of logarithms below which two are the same
NEAR, SAME = 50.0, 0.05
#: what is left, in friction, of parameters at which the slider is unstable, and relative step of the derivatives
UNSTABLE, DIFFERENCE = 1e3, 1e-4
#: parts of equal ratios of the time after each change, in which what is left is tested, and their end in D_c of slip
PARTS, END = 6, 20.0
#: probability by chance below which a law does not explain a trace, and error of a logarithm above which it is not judged
UNLIKELY, UNTOLD = 0.01, 0.5

A = Quantity("a", "1", "direct effect", "a", rank=Rank.FIRST)
B = Quantity("b", "1", "evolution effect", "b", rank=Rank.FIRST)
DIFFERENCE_OF_BOTH = Quantity("a_minus_b", "1", "velocity dependence", "a − b")
SLIP_LENGTH = Quantity("slip_length", "um", "slip length", "D_c", rank=Rank.FIRST)
STIFFNESS = Quantity("stiffness", "1/um", "stiffness over the normal force", "K")


class Rival(NamedTuple):
    """Another minimum, and by how much its misfit is larger."""

    parameters: Parameters
    misfit: float

    def text(self) -> str:
        """Its numbers."""
        a, b, length, _ = self.parameters
        return f"a = {a:.3g}, b = {b:.3g}, D_c = {length:.3g} µm: misfit larger by {self.misfit:.1f}"


@dataclass(frozen=True, eq=False)
class RateStateFit:
    """One law fitted to one trace."""

    trace: Trace
    law: Law
    parameters: Parameters
    #: (m,) friction of the law, with constant and trend
    fitted: np.ndarray
    #: (k, k) covariance of ln a, ln b, ln D_c and, if it was fitted, ln K
    covariance: np.ndarray
    #: standard deviation of the noise, and minus twice the logarithm of the likelihood
    noise: float
    misfit: float
    #: probability that what is left after the changes of speed is noise
    probability: float
    freedom: int
    #: other minima that are not much worse
    rivals: list[Rival]

    def quantities(self) -> list[Quantity]:
        """Parameters with 95 % intervals."""
        limit = statistics.student_limit(self.freedom)
        found = []
        errors = np.sqrt(np.diag(self.covariance))
        declared = (A, B, SLIP_LENGTH, STIFFNESS)
        for k, (one, value) in enumerate(
            zip(declared, self.parameters, strict=True)
        ):
            if k >= errors.size:
                found.append(one.but(value=value, reason="given"))
                continue
            ratio = np.exp(limit * errors[k])
            ends = value / ratio, value * ratio
            found.append(
                one.but(value=value, stated="ends").within(*ends, value * errors[k])
            )
        a, b, *_ = self.parameters
        slopes = np.append([a, -b], np.zeros(errors.size - 2))
        error = float(np.sqrt(slopes @ self.covariance @ slopes))
        both = DIFFERENCE_OF_BOTH.but(value=a - b).between(limit * error, error)
        return [*found[:2], both, *found[2:]]

    @property
    def told(self) -> bool:
        """Whether the noise leaves a, b and D_c to be seen."""
        return bool(np.diag(self.covariance)[:3].max() < UNTOLD**2)

    @property
    def explains(self) -> bool:
        """Whether what the law leaves is noise."""
        return self.told and self.probability >= UNLIKELY

    def words(self) -> str:
        """Whether the law explains the trace."""
        if not self.told:
            return "cannot be judged: a, b or D_c is hidden by the noise"
        if self.explains:
            return f"explains the trace (p = {self.probability:.2g})"
        return (
            f"does not explain the trace: within {END:g} D_c of the changes of speed it leaves more than noise "
            f"(p = {self.probability:.1g}); intervals are of a wrong law"
        )


def fit_rate_state(trace: Trace, law: Law = "ageing") -> RateStateFit:
    """``law`` fitted to ``trace``, with a constant and a trend linear in displacement; the stiffness too, unless the
    trace has it.

    Fits begin all over the ranges of D_c, b/a and stiffness; the best is kept. The noise, ARFIMA(1, d, 1), has the
    largest restricted likelihood (Beran, *Statistics for Long-Memory Processes*, 1994).

    Raises
    ------
    InputError
        There is no such law, or the trace does not tell its parameters.
    """
    if law not in LAWS:
        raise InputError(f"law: {law!r}; there are {', '.join(LAWS)}")
    misfit = _Misfit(law, trace, every=max(1, trace.times.size // SOME))
    found = _distinct([misfit.completed(one, 40) for one in misfit.starts()])
    for _ in range(2):
        misfit = _Misfit(law, trace, _Misfit(law, trace).memory_at(found[0].logs))
        found = _distinct([misfit.completed(one.logs, 60) for one in found])
    logs = found[0].logs
    rest, slopes = misfit.left(logs), misfit.slopes(logs)
    columns = np.concatenate([slopes, misfit.base], axis=1)
    freedom = rest.size - columns.shape[1]
    try:
        covariance = np.linalg.inv(slopes.T @ slopes) * (rest @ rest / freedom)
    except np.linalg.LinAlgError:
        covariance = np.full((logs.size, logs.size), np.nan)
    if not np.isfinite(covariance).all():
        raise InputError(
            f"{trace.name}: the trace does not tell the parameters of the {law} law; give the stiffness, or a trace "
            "with more slip after a change of speed"
        )
    model = misfit.model(logs)
    shift = np.linalg.lstsq(misfit.drifts, trace.friction - model, rcond=None)[0]
    fitted = model + misfit.drifts @ shift
    return RateStateFit(
        trace,
        law,
        misfit.parameters(logs),
        fitted,
        covariance,
        float((trace.friction - fitted).std()),
        found[0].misfit,
        misfit.probability(rest, columns, logs),
        freedom,
        [
            Rival(misfit.parameters(one.logs), one.misfit - found[0].misfit)
            for one in found[1:]
            if one.misfit - found[0].misfit < TOLD
        ],
    )


class _Minimum(NamedTuple):
    """Minus twice the logarithm of the likelihood, and where it is."""

    misfit: float
    logs: np.ndarray


def _distinct(found: list[_Minimum]) -> list[_Minimum]:
    """The best, and others that are near it."""
    kept: list[_Minimum] = []
    for one in sorted(found, key=lambda one: one.misfit):
        new = all(np.abs(one.logs - other.logs).max() > SAME for other in kept)
        if new and (not kept or one.misfit < kept[0].misfit + NEAR):
            kept.append(one)
    return kept


class _Misfit:
    """What a law leaves of a trace, for logarithms of a, b, D_c and, unless the trace has it, K."""

    def __init__(
        self,
        law: Law,
        trace: Trace,
        memory: Sequence[float] = WHITE,
        every: int = 1,
    ) -> None:
        self.law: Law = law
        self.memory = memory
        self.loading, self.given = trace.loading, trace.stiffness
        self.times, self.friction = trace.times[::every], trace.friction[::every]
        way = trace.way
        self.whole, self.finest = way[-1], np.diff(way).max()
        drifts = np.ones(way.size), way / way[-1], trace.times / np.ptp(trace.times)
        #: (m, 3) constant, and trends with displacement and time
        self.drifts = np.stack(drifts, axis=1)[::every]
        self.base = np.linalg.qr(self.whitened(self.drifts))[0]

    def whitened(
        self, values: np.ndarray, memory: Sequence[float] = ()
    ) -> np.ndarray:
        """Means (n, ...) of neighbouring ``values`` (m, ...), as multiples of independent noise."""
        from scipy.signal import fftconvolve, lfilter

        begins = np.arange(0, len(values), -(-len(values) // POINTS))
        counts = np.diff(np.append(begins, len(values)))
        means = np.add.reduceat(values, begins).T / counts
        ar, power, ma = memory or self.memory
        k = np.arange(1, begins.size)
        past = np.append(1.0, np.cumprod((k - 1 - power) / k))
        if power:
            means = fftconvolve(
                means, past.reshape((1,) * (means.ndim - 1) + (-1,)), axes=-1
            )
        found = lfilter([1.0, -ar], [1.0, ma], means[..., : begins.size])
        # of the first points the past is not known
        return found[..., begins.size // 50 + 1 :].T

    def parameters(self, logs: np.ndarray) -> Parameters:
        a, b, length, *free = (float(one) for one in np.exp(logs))
        given = self.given
        return Parameters(a, b, length, free[0] if given is None else given)

    def model(self, logs: np.ndarray) -> np.ndarray:
        """(m,) change of friction; far from any where the slider is unstable, or no trace could tell."""
        at = self.parameters(np.clip(logs, -50, 50))
        told = at.slip_length > SHORT * self.whole and (
            self.given is not None or at.stiffness * self.finest < RIGID * at.a
        )
        if told:
            found = change(self.law, at, self.loading, self.times)
            if np.isfinite(found[-1]):
                return found
        return UNSTABLE * (-1.0) ** np.arange(self.times.size)

    def left(self, logs: np.ndarray) -> np.ndarray:
        """(n,) what no constant and no trend explain either, as multiples of independent noise."""
        rest = self.whitened(self.friction - self.model(logs))
        return rest - self.base @ (self.base.T @ rest)

    def slopes(self, logs: np.ndarray) -> np.ndarray:
        """(n, k) central differences."""
        steps = DIFFERENCE * np.eye(logs.size)
        pairs = [self.left(logs + step) - self.left(logs - step) for step in steps]
        return np.stack(pairs, axis=1) / (2 * DIFFERENCE)

    def completed(self, start: np.ndarray, most: int) -> _Minimum:
        """The minimum from ``start``."""
        from scipy.optimize import least_squares

        how: Any = {"x_scale": "jac", "ftol": 1e-7, "max_nfev": most}
        found = least_squares(self.left, start, self.slopes, **how)
        size = found.fun.size
        return _Minimum(float(size * np.log(2 * found.cost / size)), found.x)

    def starts(self) -> list[np.ndarray]:
        """The best of each D_c; where K is free a follows from the size of the change."""
        found, given = [], self.given
        after = self.whole - self.loading.displacement(self.loading.times[1:2])[0]
        for part in LENGTHS:
            length, tried = part * after, []
            for ratio, above in product(RATIOS, ABOVE):
                pull = max(ratio - 1.0, 0.0) + above
                one = Parameters(1.0, ratio, length, pull / length)
                shape = change(self.law, one, self.loading, self.times)
                if not np.isfinite(shape[-1]):
                    continue
                size = (given or 0.0) * length / pull
                if given is None:
                    base = np.column_stack([self.drifts, shape])
                    size = max(
                        np.linalg.lstsq(base, self.friction, rcond=None)[0][-1],
                        1e-4,
                    )
                logs = np.log([size, size * ratio, length, size * one.stiffness])
                logs = logs[: 4 if given is None else 3]
                tried.append((float(np.sum(self.left(logs) ** 2)), logs))
            if tried:
                found.append(min(tried, key=lambda one: one[0])[1])
        if not found:
            raise InputError(
                f"the {self.law} law is unstable from every start; check units and stiffness"
            )
        return found

    def parts(self, logs: np.ndarray) -> np.ndarray:
        """(m, parts) 1 for the points of each part of the time after a change of speed."""
        length = self.parameters(logs).slip_length
        times, speeds = self.loading.times, self.loading.speeds
        ends, found = np.append(times[2:], self.times[-1]), []
        for begin, end, speed in zip(times[1:], ends, speeds[1:], strict=True):
            last = min(end - begin, END * length / speed if speed else np.inf)
            edges = begin + np.append(0.0, last * 2.0 ** np.arange(1 - PARTS, 1))
            for low, high in pairwise(edges):
                inside = (self.times > low) & (self.times <= high)
                if inside.any():
                    found.append(inside.astype(float))
        return np.stack(found, axis=1)

    def memory_at(self, logs: np.ndarray) -> Sequence[float]:
        """Of the noise, where its restricted likelihood is largest."""
        from scipy.optimize import minimize

        steps = DIFFERENCE * np.eye(logs.size)
        slopes = [
            self.model(logs + step) - self.model(logs - step) for step in steps
        ]
        rest = self.friction - self.model(logs)
        every = np.column_stack(
            [self.drifts, *slopes, self.parts(logs), rest - rest.mean()]
        )
        every /= np.abs(every).max(axis=0)

        def cost(memory: Any) -> float:
            white = self.whitened(every, tuple(memory))
            squares = white.T @ white
            squares += 1e-12 * np.diag(np.diag(squares))
            sizes = np.log(np.diag(np.linalg.cholesky(squares)))
            return float(
                2 * (len(white) - sizes.size + 1) * sizes[-1] + 2 * sizes[:-1].sum()
            )

        how = {"xatol": 0.01, "fatol": 0.05, "maxfev": 120}
        start = min(MEMORIES, key=cost)
        return tuple(
            minimize(
                cost, start, method="Nelder-Mead", bounds=BOUNDS, options=how
            ).x
        )

    def probability(
        self, rest: np.ndarray, columns: np.ndarray, logs: np.ndarray
    ) -> float:
        """That parts of the time after each change leave nothing but noise (F-test)."""
        from scipy.stats import f

        every = np.column_stack([columns, self.whitened(self.parts(logs))])
        left = rest - every @ np.linalg.lstsq(every, rest, rcond=None)[0]
        more, freedom = (
            every.shape[1] - columns.shape[1],
            rest.size - every.shape[1],
        )
        gain = (rest @ rest - left @ left) / more
        return float(f.sf(gain / (left @ left / freedom), more, freedom))
