"""Errors of measurements that are inferred: their scale, points that are off, correlation, nuisances of instruments.

The residual of a point is the measured value less exp(c + d ℓ) × the value of the model + o, with a calibration c, a
drift d by the decades ℓ from the middle of the hold times, and an offset o of its instrument. Over its standard error,
``scale`` × the stated one, it is normal, or with the probability :data:`RARE` ten times as wide (contaminated normal
distribution; Tukey 1960; Box & Tiao, Biometrika 55, 119 (1968)). Along a curve residuals may be correlated, as a
Markov chain, whose inverse covariance couples neighbours only: those of simulated curves as their replicas say, others
as exp(−|Δ ln t|/τ), an Ornstein-Uhlenbeck process. Scale, points, τ and the nuisances, each with a normal prior, are
sampled with the density.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from chemage import InputError

#: standard deviation of the normal distribution of the logarithm of a scale, and its bounds: stated errors are lower
#: limits, because a smaller scale makes noise a structure of the density
SPREAD, SMALLEST, LARGEST = 0.7, 1.0, 5.0
#: probability of a point to be off, how much wider its error is then, and share of points that may be off beforehand
RARE, WIDER, MOST_OFF = 0.01, 10.0, 0.08
#: e-folds of the hold time: median of the correlation time, and standard deviation of its logarithm
TIME, TIME_SPREAD = 0.5, 1.0
#: correlation of neighbours at most: repeated measurements at one time are not the same number
NEAREST = 0.99
#: probability of being off above which a point is suspect
SUSPECT = 0.5
#: what may be inferred of errors
KINDS = ("scaled", "robust", "correlated")
#: what all values of an instrument may share -> unit of its standard deviation in the prior: logarithms of a factor,
#: and of one per decade of the hold time, which is 1 in the middle of the hold times of the instrument; what is added
NUISANCES = {"calibration": "", "drift": "", "offset": "nN"}
#: name of a factor of all values under one load, as the model is off there
SITES = "sites"


@dataclass(frozen=True)
class ErrorModel:
    """What is inferred of the errors."""

    scaled: bool = False
    robust: bool = False
    correlated: bool = False
    #: standard deviations of :data:`NUISANCES`; 0: there is none
    calibration: float = 0.0
    drift: float = 0.0
    offset: float = 0.0

    @classmethod
    def of(cls, kinds: str | Sequence[str], **nuisances: float) -> ErrorModel:
        """The model of the names of its parts, such as ``("scaled", "robust")``; none: errors as stated."""
        names = [kinds] if isinstance(kinds, str) else list(kinds)
        names = [name for name in names if name != "as-stated" or len(names) > 1]
        for name in names:
            if name not in KINDS:
                raise InputError.of(
                    "errors",
                    name,
                    "is not known",
                    f"choose of {', '.join(KINDS)}, or as-stated",
                )
        return replace(cls(**dict.fromkeys(names, True)), **nuisances)


@dataclass(frozen=True, eq=False)
class State:
    """Errors at one moment of a chain."""

    #: (curves,) over the stated errors
    scales: np.ndarray
    #: (m,) further factor of each error: 1, or :data:`WIDER` where the point is off
    inflation: np.ndarray
    #: (q,) of :attr:`Noise.nuisances`
    nuisances: np.ndarray
    #: logarithm of the correlation time (e-folds)
    log_time: float = float(np.log(TIME))


@dataclass(frozen=True, eq=False)
class Noise:
    """The likelihood of residuals, (m,) of several curves, each in the order of its hold times."""

    model: ErrorModel
    #: (m,) stated standard errors, and those of the forward model, which are not scaled
    stated: np.ndarray
    floors: np.ndarray
    #: (m,) numbers of the curves, ascending, and hold times, s
    curve: np.ndarray
    hold_times: np.ndarray
    #: (curves,) numbers of their instruments
    instruments: np.ndarray
    #: (m,) correlation of each stated error with that of the point before, nan: not known; empty: none is
    near: np.ndarray = field(default_factory=lambda: np.zeros(0))
    #: (curves,) numbers of their loads, and (loads,) standard deviations of the logarithms of :data:`SITES`, 0: none is
    loads: np.ndarray = field(default_factory=lambda: np.zeros(0))
    site_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def start(self) -> State:
        """Errors as stated."""
        return State(
            np.ones(int(self.curve.max(initial=-1)) + 1),
            np.ones(self.stated.size),
            np.zeros(len(self.nuisances)),
        )

    @cached_property
    def nuisances(self) -> list[tuple[str, int]]:
        """(q,) names, and numbers of the instruments, or of the loads."""
        count = int(self.instruments.max(initial=0)) + 1
        names = [name for name in NUISANCES if getattr(self.model, name)]
        shared = [(name, number) for name in names for number in range(count)]
        loads = np.flatnonzero(self.site_errors).tolist()
        return shared + [(SITES, number) for number in loads]

    @cached_property
    def widths(self) -> np.ndarray:
        """(q,) standard deviations in the prior."""
        return np.array(
            [
                self.site_errors[number]
                if name == SITES
                else getattr(self.model, name)
                for name, number in self.nuisances
            ]
        )

    @cached_property
    def multiplies(self) -> np.ndarray:
        """(q,) whether a nuisance is of a factor, or is added."""
        return np.array([name != "offset" for name, _ in self.nuisances], bool)

    @cached_property
    def columns(self) -> np.ndarray:
        """(m, q): what one of each nuisance adds to the logarithm of a value, or to the value."""
        columns = np.zeros((self.stated.size, len(self.nuisances)))
        decades = np.log10(self.hold_times)
        for column, (name, number) in zip(columns.T, self.nuisances, strict=True):
            numbers = self.loads if name == SITES else self.instruments
            here = np.flatnonzero(numbers[self.curve] == number)
            ends = decades[here].min(), decades[here].max()
            column[here] = decades[here] - np.mean(ends) if name == "drift" else 1.0
        return columns

    def _shared(self, state: State, kind: np.ndarray) -> np.ndarray:
        return np.sum(self.columns[:, kind] * state.nuisances[kind], axis=1)

    def factor(self, state: State) -> np.ndarray:
        """(m,) measured over true value, without what is added."""
        return np.exp(self._shared(state, self.multiplies))

    def added(self, state: State) -> np.ndarray:
        """(m,) nN: what the instruments add."""
        return self._shared(state, ~self.multiplies)

    def linear(self, values: np.ndarray) -> np.ndarray:
        """(m, q): changes of true ``values`` (m,) by one standard deviation of each nuisance."""
        scales = np.where(self.multiplies, values[:, None], 1.0)
        return scales * self.columns * self.widths

    @property
    def fixed(self) -> bool:
        """Whether nothing is inferred."""
        return self.model == ErrorModel()

    def without(self, left_out: np.ndarray) -> Noise:
        """The same of the points that ``left_out`` (m,) does not mark, of independent errors."""
        names = ("stated", "floors", "curve", "hold_times")
        return replace(
            self, **{name: getattr(self, name)[~left_out] for name in names}
        )

    @cached_property
    def _gaps(self) -> np.ndarray:
        """(m,) e-folds since the point before; infinite at the first of a curve."""
        gaps = np.full(self.stated.size, np.inf)
        same = self.curve[1:] == self.curve[:-1]
        gaps[1:][same] = np.diff(np.log(self.hold_times))[same]
        return gaps

    def errors(self, state: State) -> np.ndarray:
        """(m,) standard errors."""
        return np.hypot(
            state.scales[self.curve] * state.inflation * self.stated, self.floors
        )

    @cached_property
    def chained(self) -> bool:
        """Whether errors are correlated."""
        return self.model.correlated or bool(self.near.any())

    def correlation(self, state: State) -> np.ndarray:
        """(m,) of each error with that of the point before."""
        near = np.zeros(self.stated.size)
        if self.model.correlated:
            near = np.exp(-self._gaps / np.exp(state.log_time)).clip(max=NEAREST)
        if self.near.size:  # the errors of the forward model are independent
            share = self.stated / np.hypot(self.stated, self.floors)
            known = self.near * share * np.roll(share, 1)
            near = np.where(np.isnan(known), near, known)
        return near

    def white(self, state: State, rows: np.ndarray) -> np.ndarray:
        """``rows`` (m, ...) as combinations whose errors are independent and 1."""
        scaled = rows / self.errors(state).reshape(-1, *[1] * (rows.ndim - 1))
        if not self.chained:
            return scaled
        near = self.correlation(state).reshape(-1, *[1] * (rows.ndim - 1))
        before = np.roll(scaled, 1, axis=0)
        return (scaled - near * before) / np.sqrt(1 - near**2)

    def _logs(self, state: State, residual: np.ndarray) -> np.ndarray:
        """(m,) logarithms of the probability density of the residuals, each given those before."""
        logs = -0.5 * self.white(state, residual) ** 2 - np.log(self.errors(state))
        return (
            logs - 0.5 * np.log1p(-(self.correlation(state) ** 2))
            if self.chained
            else logs
        )

    def drawn(
        self,
        state: State,
        values: np.ndarray,
        fitted: np.ndarray,
        rng: np.random.Generator,
    ) -> State:
        """Other errors with the same nuisances, given measured ``values`` (m,) and those of the model, ``fitted``."""
        model = self.model
        residual = values - self.added(state) - self.factor(state) * fitted
        if model.scaled:  # whichever points are off, and these right after it
            state = self._scaled(state, residual, rng)
        if model.robust:
            state = self._off(state, residual, rng)
        if model.correlated:
            other = replace(
                state, log_time=state.log_time + 0.5 * float(rng.standard_normal())
            )
            away = [
                ((one.log_time - np.log(TIME)) / TIME_SPREAD) ** 2
                for one in (state, other)
            ]
            gain = (
                self._logs(other, residual).sum()
                - self._logs(state, residual).sum()
                - 0.5 * (away[1] - away[0])
            )
            state = other if np.log(rng.random()) < gain else state
        return state

    def _scaled(
        self, state: State, residual: np.ndarray, rng: np.random.Generator
    ) -> State:
        count = state.scales.size
        sizes = np.maximum(np.bincount(self.curve, minlength=count), 1)
        # without correlation summed over which points are off
        summed = self.model.robust and not self.chained
        calm = np.ones_like(state.inflation) if summed else state.inflation

        def of_curves(scales: np.ndarray) -> np.ndarray:
            one = replace(state, scales=scales, inflation=calm)
            logs = self._logs(one, residual)
            if summed:
                wide = self._logs(replace(one, inflation=WIDER * calm), residual)
                logs = np.logaddexp(np.log(1 - RARE) + logs, np.log(RARE) + wide)
            return np.bincount(self.curve, logs, count)

        scales = state.scales
        here = of_curves(scales)
        for _ in range(3):
            before = np.log(scales)
            after = before + 1.7 / np.sqrt(
                2 * sizes + SPREAD**-2
            ) * rng.standard_normal(count)
            other = np.exp(after)
            there = of_curves(other)
            gain = there - here - 0.5 * (after**2 - before**2) / SPREAD**2
            inside = (after >= np.log(SMALLEST)) & (after <= np.log(LARGEST))
            taken = inside & (np.log(rng.random(count)) < gain)
            scales = np.where(taken, other, scales)
            here = np.where(taken, there, here)
        return replace(state, scales=scales)

    def _off(
        self, state: State, residual: np.ndarray, rng: np.random.Generator
    ) -> State:
        """Draw which points are off; neighbours one after the other, as their errors may be correlated."""
        odds = np.log(RARE / (1 - RARE))
        for first in (0, 1) if self.chained else (None,):
            chosen = np.ones(residual.size, dtype=bool)
            if first is not None:
                chosen = np.arange(residual.size) % 2 == first
            calm, wide = (
                replace(state, inflation=np.where(chosen, factor, state.inflation))
                for factor in (1.0, WIDER)
            )
            change = self._logs(wide, residual) - self._logs(calm, residual)
            if self.chained:  # what the next point says of this one
                change = change + np.append(
                    np.where(chosen[1:], 0.0, change[1:]), 0.0
                )
            off = rng.logistic(size=residual.size) < change + odds
            state = replace(
                state,
                inflation=np.where(
                    chosen, np.where(off, WIDER, 1.0), state.inflation
                ),
            )
        return state

    def guessed(self, residual: np.ndarray, parameters: int) -> State:
        """Errors that about explain the residuals of a fit with so many parameters: where a chain begins."""
        away, state = (
            np.abs(residual) / np.hypot(self.stated, self.floors),
            self.start,
        )
        scales, inflation = state.scales.copy(), state.inflation.copy()
        for number in range(scales.size):
            here = np.flatnonzero(self.curve == number)
            spread = here.size / max(here.size - parameters, here.size / 2)
            typical = 1.48 * float(np.median(away[here])) * np.sqrt(spread)
            if self.model.scaled:
                scales[number] = np.clip(typical, 1.0, LARGEST)
            if self.model.robust:
                most = int(np.ceil(MOST_OFF * here.size))
                worst = here[np.argsort(-away[here])[:most]]
                inflation[worst[away[worst] > 3 * max(typical, 1.0)]] = WIDER
        return replace(state, scales=scales, inflation=inflation)

    def largest(self, state: State) -> np.ndarray:
        """(m,) the largest errors that are thought possible: beyond, no density explains the data."""
        if not self.model.scaled:
            return self.errors(state)
        wider = np.where(state.inflation > 1, WIDER / LARGEST, 1.0)
        return self.errors(
            replace(
                state, scales=np.full_like(state.scales, LARGEST), inflation=wider
            )
        )


def fixed(errors: np.ndarray) -> Noise:
    """Independent normal errors (m,) of which nothing is inferred."""
    zero = np.zeros(errors.size)
    return Noise(
        ErrorModel(),
        errors,
        zero,
        zero.astype(np.int64),
        zero + 1,
        np.zeros(1, dtype=np.int64),
    )
