"""The spectrum of a surface below what its image shows, and how much of it is not known.

ln C(ln q) falls with the slope −2 − 2H, where H(ln q) is a stationary Gauss-Markov process: a prior for surfaces that
need not be self-affine. The bins of the image are data with errors of a Gamma variate, and the doubts about what was
corrected (tip, noise) are unknowns beside them. All is Gaussian, so that the rest follows by linear algebra
(C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press (2006), ch. 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg
from scipy.integrate import trapezoid

from chemage_surfaces._maps import Floats, stream
from chemage_surfaces.spectra import BINS, ROBUST
from chemage_surfaces.trusted import Trusted

#: H of surfaces in general, its standard deviation between and along their spectra, and the e-folds of q over which it
#: is correlated: of solids H is .8 ± .15 (B. N. J. Persson, Tribol. Lett. 54, 99 (2014)), of others .3 to 1.2
HURST, SPREAD, LENGTH = 0.8, 0.25, 1.5
#: variance of the logarithm of the density before it is seen
ANY = 100.0
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


@dataclass(frozen=True, eq=False)
class Continuation:
    """What is known of a spectrum: the fitted bins, and on to the shortest wavelength. Rows are unknowns: ln C at each
    of ``q``, and how much each correction is off, in its own uncertainties."""

    #: 1/nm
    q: Floats
    #: bins that were fitted: the first of ``q``
    bins: int
    #: the best value of each unknown, and a factor of their covariance
    best: Floats
    root: Floats
    #: wavenumbers of the bins of the image (1/nm), what each correction added to their logarithms, and its relative
    #: uncertainty
    corrected: Floats
    added: tuple[Floats, ...]
    doubts: tuple[float, ...]
    #: χ² per degree of freedom
    misfit: float

    @classmethod
    def of(
        cls,
        part: Trusted,
        lowest: float,
        join: float,
        highest: float,
        hurst: float | None,
    ) -> Continuation:
        """The spectrum from ``lowest`` to ``join``, where the image ends, and on to ``highest`` (1/nm); with a given
        ``hurst`` a power law."""
        data = part.data.part(lowest, join * (1 + 1e-9))
        values, variance, _ = data.logs()
        count = max(2, math.ceil(BINS * math.log(highest / join)) + 1)
        q = np.concatenate([data.q, np.geomspace(join, highest, count)])
        x, bins = np.log(q), len(data.q)
        first = len(part.data.q) - len(part.data.part(lowest, math.inf).q)
        corrections = part.corrections
        matrix = np.zeros((bins, len(q) + len(corrections)))
        matrix[:, :bins] = np.eye(bins)
        for k, (added, doubt) in enumerate(corrections):
            matrix[:, len(q) + k] = doubt * added[first : first + bins]
        mean = np.zeros(len(q) + len(corrections))
        middle, slope = x[:bins].mean(), 2 + 2 * (HURST if hurst is None else hurst)
        mean[: len(q)] = values.mean() - slope * (x - middle)
        prior = np.eye(len(mean))
        prior[: len(q), : len(q)] = ANY + 4 * _integrals(
            x, SPREAD if hurst is None else 0.0
        )
        noise, gain, best, misfit = variance, prior, mean, 0.0
        # bins far from all others count less
        for _ in range(8):
            seen = matrix @ prior @ matrix.T + np.diag(noise)
            gain = linalg.solve(seen, matrix @ prior, assume_a="pos").T
            best = mean + gain @ (values - matrix @ mean)
            away = np.abs(values - matrix @ best) / np.sqrt(variance)
            misfit = float(np.mean(np.minimum(away, ROBUST) * away))
            noise = variance * max(misfit, 1.0) * np.maximum(away / ROBUST, 1.0)
        covariance = prior - gain @ matrix @ prior
        covariance += 1e-9 * np.eye(len(mean))
        return cls(
            q=q,
            bins=bins,
            best=best,
            root=linalg.cholesky(covariance, lower=True),
            corrected=part.data.q,
            added=tuple(added for added, _ in part.corrections),
            doubts=tuple(doubt for _, doubt in part.corrections),
            misfit=misfit,
        )

    def unknowns(self, draw: int) -> Floats:
        """The best values (0), or those of a draw."""
        if draw == 0:
            return self.best
        rng = np.random.Generator(np.random.Philox(stream(draw, _STREAM)))
        return self.best + self.root @ rng.standard_normal(len(self.best))

    def density(self, q: Floats, unknowns: Floats) -> Floats:
        """C at ``q`` (1/nm) from ``join`` on, nm⁴."""
        x, y = np.log(self.q[self.bins :]), unknowns[self.bins : len(self.q)]
        return np.exp(np.interp(np.log(np.maximum(q, self.q[0])), x, y))

    def correction(self, q: Floats, unknowns: Floats) -> Floats:
        """What is added to the logarithm of the density of the image at ``q`` (1/nm)."""
        total = np.zeros(len(self.corrected))
        off = unknowns[len(self.q) :]
        for added, doubt, one in zip(self.added, self.doubts, off, strict=True):
            total += added * (1 - doubt * one)
        return np.interp(np.log(np.maximum(q, 1e-300)), np.log(self.corrected), total)

    def moment(self, power: float, unknowns: Floats) -> float:
        """∫ C q^power dq/(2π) of the continuation: the mean square height is that of 1, of the slope that of 3."""
        x = np.log(self.q[self.bins :])
        fine = np.linspace(x[0], x[-1], 16 * len(x))
        y = np.interp(fine, x, unknowns[self.bins : len(self.q)]) + (power + 1) * fine
        return float(trapezoid(np.exp(y), fine)) / (2 * math.pi)

    @cached_property
    def hurst(self) -> tuple[float, float]:
        """H of the continuation as a whole, and its standard error."""
        ends = np.zeros(len(self.best))
        ends[[self.bins, len(self.q) - 1]] = 0.5, -0.5
        ends /= math.log(self.q[-1] / self.q[self.bins])
        error = float(np.linalg.norm(self.root.T @ ends))
        return float(ends @ self.best) - 1, error if error > 1e-4 else 0.0
