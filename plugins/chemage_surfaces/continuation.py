"""The spectrum of a surface below what its image shows, and how much of it is not known.

ln C(ln q) falls with the slope −2 − 2H, where H(ln q) is a stationary Gauss-Markov process: a prior for surfaces that
need not be self-affine. The bins of the image are data with errors of a Gamma variate, and the doubts about corrections
are unknowns beside them. For a given white noise of the instrument all is Gaussian, so that the rest follows by linear
algebra (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press (2006), ch. 2); levels
of the noise are weighted by their evidence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg
from scipy.integrate import trapezoid

from chemage_surfaces._maps import Floats, stream
from chemage_surfaces.spectra import BINS, ROBUST
from chemage_surfaces.trusted import NOISE_SHARE, Trusted

#: H of solids (B. N. J. Persson, Tribol. Lett. 54, 99 (2014)); its standard deviation between and along spectra, and the
#: e-folds of q over which it is correlated: calibrated with the cases 60 to 119 of tests/benchmarks/any_spectrum.py
HURST, SPREAD, LENGTH = 0.8, 0.35, 1.0
#: variance of the logarithm of the density before it is seen
ANY = 100.0
#: levels of the noise: how many, and the least and the largest over the lowest density of the image
LEVELS, LEAST, MOST = 24, 1e-3, 0.98
#: draws from which intervals are taken, and the probability that they hold
DRAWS, HOLD = 1000, 0.9
#: distinguishes the random numbers of this module from those of other makers with the same seed
_STREAM = 0x636F6E74


def _integrals(x: Floats, spread: float) -> Floats:
    """Covariance of the integrals from ``x[0]`` of a process with the covariance spread²·exp(−|Δx|/LENGTH)."""
    t = (x - x[0]) / LENGTH
    least = np.minimum(t[:, None], t)
    decay = np.exp(-t)
    apart = np.exp(-np.abs(t[:, None] - t))
    return (spread * LENGTH) ** 2 * (2 * least + decay[:, None] + decay - apart - 1)


def _between(x: Floats, nodes: Floats) -> Floats:
    """The matrix (x, nodes) of a linear interpolation."""
    return np.array([np.interp(x, nodes, one) for one in np.eye(len(nodes))]).T


@dataclass(frozen=True, eq=False)
class Drawn:
    """A spectrum that the image allows, or many of them, one in each row."""

    #: ln C at the wavenumbers of the continuation
    logs: Floats
    #: how much each correction is off, in its own uncertainties
    off: Floats
    #: density of the noise, nm⁴; of many (n, 1)
    noise: Any


@dataclass(frozen=True, eq=False)
class _Level:
    """What is known if the noise has this density (nm⁴): the best unknowns (ln C at each wavenumber, and how much each
    correction is off), a factor of their covariance, and the logarithm of the evidence."""

    noise: float
    best: Floats
    root: Floats
    evidence: float
    misfit: float


@dataclass(frozen=True, eq=False)
class _Bins:
    """Logarithms of densities as data: what they are of the unknowns, and what is known of these before."""

    #: (bins, unknowns)
    matrix: Floats
    #: covariance and mean of the unknowns
    prior: Floats
    mean: Floats
    values: Floats
    variance: Floats
    #: densities as the image has them, nm⁴
    raw: Floats

    def level(self, noise: float) -> _Level:
        """What is known with this density of the noise."""
        matrix, prior, mean = self.matrix, self.prior, self.mean
        # how the logarithm of the density changes with that of what is seen
        steep = 1 / (1 - noise / self.raw)
        seen = self.values - np.log(steep)
        errors = self.variance * steep**2
        noisy, gain, best, misfit = errors, prior, mean, 0.0
        covariance = prior
        # bins far from all others count less
        for _ in range(4):
            covariance = matrix @ prior @ matrix.T + np.diag(noisy)
            gain = linalg.solve(covariance, matrix @ prior, assume_a="pos").T
            best = mean + gain @ (seen - matrix @ mean)
            away = np.abs(seen - matrix @ best) / np.sqrt(errors)
            misfit = float(np.mean(np.minimum(away, ROBUST) * away))
            noisy = errors * max(misfit, 1.0) * np.maximum(away / ROBUST, 1.0)
        factor = linalg.cholesky(covariance, lower=True)
        apart = linalg.solve_triangular(factor, seen - matrix @ mean, lower=True)
        evidence = -0.5 * float(apart @ apart)
        evidence -= float(np.log(np.diag(factor) / steep).sum())
        known = prior - gain @ matrix @ prior + 1e-9 * np.eye(len(mean))
        return _Level(
            noise, best, linalg.cholesky(known, lower=True), evidence, misfit
        )


@dataclass(frozen=True, eq=False)
class Continuation:
    """What is known of a spectrum, in the image and on to the shortest wavelength."""

    #: 1/nm, from the first bin of the fit to the shortest wavelength
    q: Floats
    #: wavenumber up to which the image is used, 1/nm
    join: float
    levels: tuple[_Level, ...]
    #: probability of each
    weights: Floats
    #: of the image, and its corrections
    part: Trusted

    @classmethod
    def of(
        cls,
        part: Trusted,
        lowest: float,
        highest: float,
        hurst: float | None,
        floor: float,
        end: float,
        computed: bool,
    ) -> Continuation:
        """The spectrum from ``lowest`` on in the image, which is used up to ``end`` or to where noise is, and on to
        ``highest`` (1/nm); with a given ``hurst`` a power law. Noise is below ``floor`` (nm⁴); whether the image was
        ``computed``, and not measured, decides how probable none is."""
        data = part.data.part(lowest, math.inf)
        first, bins = len(part.data.q) - len(data.q), len(data.q)
        top = float(data.q[-1])
        count = max(2, math.ceil(BINS * math.log(highest / top)) + 1)
        q = np.concatenate([data.q, np.geomspace(top, highest, count)[1:]])
        x, corrections = np.log(q), part.corrections
        matrix = np.zeros((bins, len(q) + len(corrections)))
        matrix[:, :bins] = np.eye(bins)
        for k, (added, doubt) in enumerate(corrections):
            matrix[:, len(q) + k] = doubt * added[first:]
        values, variance, _ = data.logs()
        slope = 2 + 2 * (HURST if hurst is None else hurst)
        mean = np.zeros(len(q) + len(corrections))
        mean[: len(q)] = values.mean() - slope * (x - x[:bins].mean())
        prior = np.eye(len(mean))
        prior[: len(q), : len(q)] = ANY + 4 * _integrals(
            x, SPREAD if hurst is None else 0.0
        )

        raw = part.seen[first:]
        most = MOST * min(floor, float(raw.min()))
        noises = most * np.geomspace(LEAST, 1, LEVELS) if floor > 0 else []
        bins_of = _Bins(matrix, prior, mean, values, variance, raw)
        levels = [bins_of.level(noise) for noise in (0.0, *noises)]
        evidence = np.array([one.evidence for one in levels])
        weights = np.exp(evidence - evidence.max())
        # no instrument is without noise; what repeats was computed
        weights[0] *= max(len(noises), 1) if computed else 1
        found = cls(q, end, tuple(levels), weights / weights.sum(), part)
        noise = found.best.noise
        noisy = np.nonzero(noise > NOISE_SHARE * (raw - noise))[0]
        if not noisy.size:
            return found
        return replace(found, join=float(data.q[max(int(noisy[0]) - 1, 0)]))

    def _level(self, share: float) -> _Level:
        """The level below which the noise is with this probability."""
        return self.levels[int(np.searchsorted(np.cumsum(self.weights), share))]

    def _drawn(self, level: _Level, unknowns: Floats) -> Drawn:
        count = len(self.q)
        return Drawn(unknowns[:count], unknowns[count:], level.noise)

    @property
    def misfit(self) -> float:
        """χ² per degree of freedom of the best spectrum."""
        return self._level(0.5).misfit

    @cached_property
    def best(self) -> Drawn:
        """The spectrum in the middle of all."""
        level = self._level(0.5)
        return self._drawn(level, level.best)

    def draw(self, number: int) -> Drawn:
        """The best spectrum (0), or a draw."""
        if number == 0:
            return self.best
        rng = np.random.Generator(np.random.Philox(stream(number, _STREAM)))
        level = self._level(rng.random() * (1 - 1e-9))
        normal = rng.standard_normal(len(level.best))
        return self._drawn(level, level.best + level.root @ normal)

    @cached_property
    def draws(self) -> Drawn:
        """Those from which intervals are taken."""
        found = [self.draw(number) for number in range(1, DRAWS + 1)]
        logs, off = (
            np.array([getattr(one, name) for one in found])
            for name in ("logs", "off")
        )
        return Drawn(logs, off, np.array([[one.noise] for one in found]))

    @property
    def added(self) -> Floats:
        """Wavenumbers of what is added to the image, 1/nm."""
        return np.concatenate(
            [[self.join], self.q[self.q > self.join * (1 + 1e-9)]]
        )

    def density(self, q: Floats, drawn: Drawn) -> Floats:
        """C at ``q`` (1/nm) of one spectrum, nm⁴."""
        x = np.log(np.maximum(q, self.q[0]))
        return np.exp(np.interp(x, np.log(self.q), drawn.logs))

    def logs(self, q: Floats, drawn: Drawn) -> Floats:
        """ln C at ``q`` (n,) 1/nm of each spectrum."""
        return drawn.logs @ _between(np.log(q), np.log(self.q)).T

    def correction(self, drawn: Drawn) -> Floats:
        """What is added to the logarithms of the bins of the image."""
        least = np.maximum(drawn.noise / (1 - NOISE_SHARE), 1e-300)
        total = np.log1p(-drawn.noise / np.maximum(self.part.seen, least))
        for k, (added, doubt) in enumerate(self.part.corrections):
            total = total + added * (1 - doubt * drawn.off[..., k : k + 1])
        return total

    def moment(self, power: float, drawn: Drawn, low: float = 0.0) -> Any:
        """∫ C q^power dq/(2π) of what is added from ``low`` (1/nm) on: the mean square height is that of 1, of the slope
        that of 3."""
        ends = np.log([min(max(low, self.join), self.q[-1]), self.q[-1]])
        x = np.linspace(ends[0], ends[1], 8 * len(self.q))
        y = self.logs(np.exp(x), drawn) + (power + 1) * x
        return trapezoid(np.exp(y), x) / (2 * math.pi)

    def hurst(self, drawn: Drawn) -> Any:
        """H of what is added as a whole."""
        logs = self.logs(np.array([self.join, self.q[-1]]), drawn)
        slope = (logs[..., 1] - logs[..., 0]) / math.log(self.q[-1] / self.join)
        return -slope / 2 - 1

    def gain(self, q: Floats, drawn: Drawn) -> Floats:
        """By what the mean square of waves at ``q`` (n,) 1/nm is multiplied, of each spectrum."""
        bins = np.log(self.part.data.q)
        return np.exp(self.correction(drawn) @ _between(np.log(q), bins).T)
