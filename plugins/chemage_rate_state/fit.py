"""Parameters of a rate-and-state law from a trace: least squares with correlated noise, and whether the law explains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from chemage import InputError
from chemage.plugin import Quantity, Rank, statistics
from chemage_rate_state.laws import LAWS, Law, Parameters, change
from chemage_rate_state.traces import Trace

#: order of the autoregressive noise at most, of which that of least BIC is taken, and change of the interval of sampling,
#: relative, at which another noise begins
ORDER, RESAMPLED = 5, 0.5
#: D_c over the way at the first speed in the time after the first change, b/a, and K D_c/a, from which fits begin
STARTS = [
    (way, ratio, pull)
    for way in (0.003, 0.03, 0.3)
    for ratio in (0.5, 1.0, 1.5)
    for pull in (0.3, 3.0, 30.0)
]
#: fits that are completed of them, and points of the trace for that
COMPLETED, SOME = 3, 400
#: times that parameters are fitted with the noise of what was left before
REPEATED = 2
#: what is left, in friction, of parameters at which the slider is unstable, or K D_c/a above RIGID, where no trace tells
#: how stiff the spring is and it is not given
UNSTABLE, RIGID = 1e3, 1e3
#: relative step of the derivatives
DIFFERENCE = 1e-4
#: parts of equal ratios of the slip after each change, in which the mean of what is left is tested, and their end in D_c
PARTS, END = 8, 20.0
#: probability by chance below which a law does not explain a trace
UNLIKELY = 0.01

A = Quantity("a", "1", "direct effect", "a", rank=Rank.FIRST)
B = Quantity("b", "1", "evolution effect", "b", rank=Rank.FIRST)
DIFFERENCE_OF_BOTH = Quantity("a_minus_b", "1", "velocity dependence", "a − b")
SLIP_LENGTH = Quantity("slip_length", "um", "slip length", "D_c", rank=Rank.FIRST)
STIFFNESS = Quantity("stiffness", "1/um", "stiffness over the normal force", "K")
Whiten: TypeAlias = Callable[[np.ndarray], np.ndarray]


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
    #: trend of the friction with displacement, 1/µm
    trend: float
    #: standard deviation of the noise, and minus twice the logarithm of the likelihood
    noise: float
    misfit: float
    #: probability that what is left after the changes of speed is noise
    probability: float
    #: way over which the noise is correlated, µm
    correlated: float
    freedom: int

    def quantities(self) -> list[Quantity]:
        """Parameters with 95 % intervals."""
        limit = statistics.student_limit(self.freedom)
        declared, found = (A, B, SLIP_LENGTH, STIFFNESS), []
        errors = np.sqrt(np.diag(self.covariance))
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
        slopes = np.zeros(errors.size)
        slopes[:2] = a, -b
        error = float(np.sqrt(slopes @ self.covariance @ slopes))
        both = DIFFERENCE_OF_BOTH.but(value=a - b).between(limit * error, error)
        return [*found[:2], both, *found[2:]]

    @property
    def told(self) -> bool:
        """Whether noise is told from a wrong law: it is forgotten within D_c, and smaller than what is explained."""
        change = float(np.ptp(self.fitted - self.trend * self.trace.way))
        return self.correlated < self.parameters.slip_length and self.noise < change

    @property
    def explains(self) -> bool:
        """Whether what the law leaves is noise."""
        return self.told and self.probability >= UNLIKELY

    def words(self) -> str:
        """Whether the law explains the trace."""
        if not self.told:
            return (
                f"cannot be judged: what it leaves ({self.noise:.2g}, correlated over {self.correlated:.2g} µm) is as large "
                "as what it explains, or as long as D_c; intervals mean nothing"
            )
        if self.explains:
            return f"explains the trace (p = {self.probability:.2g})"
        return (
            f"does not explain the trace: within {END:g} D_c of the changes of speed it leaves more than noise "
            f"(p = {self.probability:.1g}); intervals are of a wrong law"
        )


def fit_rate_state(trace: Trace, law: Law = "ageing") -> RateStateFit:
    """``law`` fitted to ``trace``, with a constant and a trend linear in displacement; the stiffness too, unless the
    trace has it.

    The noise is autoregressive, of its own kind in each part of equal sampling, and estimated from what is left.

    Raises
    ------
    InputError
        There is no such law, or the trace does not tell its parameters.
    """
    if law not in LAWS:
        raise InputError(f"law: {law!r}; there are {', '.join(LAWS)}")
    misfit = _Misfit(law, trace)
    logs = misfit.begun()
    for _ in range(REPEATED):
        noise = _whitening(misfit.left(logs), trace.times)
        _, logs = misfit.completed(logs, noise.apply)
    rest = misfit.left(logs)
    whitening = _whitening(rest, trace.times)
    white = misfit.left(logs, whitening.apply)
    slopes = _slopes(lambda at: misfit.left(at, whitening.apply), logs)
    # points that the noise leaves independent
    points = trace.times.size / max(1.0, whitening.samples)
    freedom = max(1, int(points) - logs.size - 2 - len(whitening.parts))
    try:
        covariance = np.linalg.inv(slopes.T @ slopes) * points / freedom
    except np.linalg.LinAlgError:
        covariance = np.full((logs.size, logs.size), np.nan)
    if not np.isfinite(covariance).all():
        raise InputError(
            f"{trace.name}: the trace does not tell the parameters of the {law} law; give the stiffness, or a trace "
            "with more slip after a change of speed"
        )
    best, way = misfit.parameters(logs), misfit.way
    model = change(law, best, trace.loading, trace.times)
    columns = misfit.columns
    shift = np.linalg.lstsq(columns, trace.friction - model, rcond=None)[0]
    return RateStateFit(
        trace,
        law,
        best,
        model + columns @ shift,
        covariance,
        float(shift[1] / way[-1]),
        float(rest.std()),
        float(white @ white) + 2 * whitening.log_size,
        _probability(white, trace, best),
        whitening.samples * float(way[-1]) / trace.times.size,
        freedom,
    )


def _unchanged(values: np.ndarray) -> np.ndarray:
    return values


class _Misfit:
    """What a law leaves of a trace, for logarithms of a, b, D_c and, unless the trace has it, K."""

    def __init__(self, law: Law, trace: Trace) -> None:
        self.law: Law = law
        self.trace = trace
        self.way = trace.way
        #: (m, 2) constant and trend
        ones = np.ones(self.way.size)
        self.columns = np.stack([ones, self.way / self.way[-1]], axis=1)

    def parameters(self, logs: np.ndarray) -> Parameters:
        a, b, length, *free = (float(one) for one in np.exp(logs))
        given = self.trace.stiffness
        return Parameters(a, b, length, free[0] if given is None else given)

    def left(self, logs: np.ndarray, whiten: Whiten = _unchanged) -> np.ndarray:
        """(m,) what no constant and no trend explain either."""
        trace, law, at = self.trace, self.law, self.parameters(logs)
        free = trace.stiffness is None
        if free and at.stiffness * at.slip_length > RIGID * at.a:
            return np.full(trace.times.size, UNSTABLE)
        try:
            model = change(law, at, trace.loading, trace.times)
        except FloatingPointError:
            return np.full(trace.times.size, UNSTABLE)
        rest, columns = whiten(trace.friction - model), whiten(self.columns)
        return rest - columns @ np.linalg.lstsq(columns, rest, rcond=None)[0]

    def completed(
        self, start: np.ndarray, whiten: Whiten = _unchanged
    ) -> tuple[float, np.ndarray]:
        """Least sum of squares, and where it is."""
        from scipy.optimize import least_squares

        how = {"diff_step": DIFFERENCE, "args": (whiten,), "max_nfev": 60}
        found = least_squares(self.left, start, "3-point", **how)
        return float(found.cost), found.x

    def begun(self) -> np.ndarray:
        """The best of the starts that were completed, on some of the points; a follows from the size of the change."""
        some = _Misfit(self.law, self.trace.thinned(SOME))
        trace, guess, tried = some.trace, 0.01, []
        loading, given = trace.loading, trace.stiffness
        after = float(loading.speeds[0] * (trace.times[-1] - loading.times[1]))
        for part, ratio, pull in STARTS:
            length = part * after
            stiffness = given or pull * guess / length
            one = Parameters(guess, guess * ratio, length, stiffness)
            try:
                shape = change(self.law, one, loading, trace.times)[:, None]
            except FloatingPointError:
                continue
            columns = np.concatenate([some.columns, shape], axis=1)
            solved = np.linalg.lstsq(columns, trace.friction, rcond=None)[0]
            size = max(float(solved[2]), 0.01)
            values = [size * guess, size * guess * ratio, length, size * stiffness]
            logs = np.log(values[: 4 if given is None else 3])
            tried.append((float(np.sum(some.left(logs) ** 2)), logs))
        if not tried:
            raise InputError(
                f"{trace.name}: the {self.law} law is unstable from every start; check units and stiffness"
            )
        tried.sort(key=lambda one: one[0])
        ends = [some.completed(logs) for _, logs in tried[:COMPLETED]]
        return min(ends, key=lambda one: one[0])[1]


def _slopes(of: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """(m, k) central differences."""
    steps = DIFFERENCE * np.eye(at.size)
    return np.stack(
        [(of(at + step) - of(at - step)) / (2 * DIFFERENCE) for step in steps],
        axis=1,
    )


@dataclass(frozen=True)
class _Whitening:
    """Autoregressive noise of parts of a trace."""

    #: of each part its points, its coefficients (p,), its standard deviation and that of the innovations
    parts: list[tuple[slice, np.ndarray, float, float]]

    def apply(self, values: np.ndarray) -> np.ndarray:
        """(m, ...) values as multiples of independent noise."""
        from scipy.signal import lfilter

        found = np.empty_like(values)
        for part, memory, whole, innovation in self.parts:
            own = values[part]
            found[part] = lfilter(np.append(1.0, -memory), [1.0], own, axis=0)
            found[part] /= innovation
            found[part][: memory.size] = own[: memory.size] / whole
        return found

    @property
    def samples(self) -> float:
        """Points over which the noise is correlated at most: its power at frequency 0 over its variance."""
        powers = (
            (innovation / whole / max(1.0 - memory.sum(), 1e-12)) ** 2
            for _, memory, whole, innovation in self.parts
        )
        return float(max(powers))

    @property
    def log_size(self) -> float:
        """Logarithm of the product of all standard deviations."""
        return sum(
            memory.size * np.log(whole)
            + (part.stop - part.start - memory.size) * np.log(innovation)
            for part, memory, whole, innovation in self.parts
        )


def _whitening(rest: np.ndarray, times: np.ndarray) -> _Whitening:
    """From what is left, (m,), in each part of equal sampling."""
    steps = np.log(np.diff(times))
    ends = np.flatnonzero(np.abs(np.diff(steps)) > RESAMPLED) + 2
    ends = [0, *(end for end in ends if 10 * ORDER < end < times.size - 10 * ORDER)]
    kept = [ends[0]]
    for end in ends[1:]:
        if end - kept[-1] > 10 * ORDER:
            kept.append(int(end))
    parts = []
    for low, high in zip(kept, [*kept[1:], times.size], strict=True):
        own = rest[low:high]
        memory, innovation = min(
            (_remembered(own, order) for order in range(1, ORDER + 1)),
            key=lambda one: (
                np.log(one[1]) + 0.5 * one[0].size * np.log(own.size) / own.size
            ),
        )
        least = 1e-12 * max(float(np.abs(own).max()), 1e-300)
        whole = max(float(own.std()), least)
        parts.append((slice(low, high), memory, whole, max(innovation, least)))
    return _Whitening(parts)


def _remembered(own: np.ndarray, order: int) -> tuple[np.ndarray, float]:
    """Coefficients (order,) of autoregressive noise, and the standard deviation of its innovations."""
    past = np.stack([own[ORDER - 1 - k : -1 - k] for k in range(order)], axis=1)
    memory = np.linalg.lstsq(past, own[ORDER:], rcond=None)[0]
    left = own[ORDER:] - past @ memory
    return memory, max(float(np.std(left, ddof=order)), 1e-300)


def _probability(white: np.ndarray, trace: Trace, best: Parameters) -> float:
    """That means over parts of the slip after each change are those of noise."""
    from scipy.stats import chi2

    loading, squares, count = trace.loading, 0.0, 0
    way = trace.way
    places = loading.displacement(loading.times)
    ends = [*places[2:], way[-1]]
    for begin, end, speed in zip(places[1:], ends, loading.speeds[1:], strict=True):
        if not speed:
            continue
        passed = (way - begin) / best.slip_length
        last = min(END, (end - begin) / best.slip_length)
        edges = np.append(0.0, np.geomspace(last / 2**PARTS, last, PARTS + 1))
        for low, high in pairwise(edges):
            inside = (passed > low) & (passed <= high) & (way <= end)
            if number := np.count_nonzero(inside):
                squares += float(white[inside].sum() ** 2 / number)
                count += 1
    return float(chi2.sf(squares, count)) if count else 1.0
