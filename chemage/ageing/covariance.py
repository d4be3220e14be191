"""The error of a simulated curve over all hold times, from a few independent samples of it.

Hold times share their bonds, so that their errors are correlated, and fewer samples than hold times have a singular
covariance. It is therefore a model, whose scales come from the samples. Bonds that have not formed at an earlier time
t thin those at the last time T: given x(T), the mean of x(t) is φ(t) x(T), with φ = μ(t)/μ(T) of the mean curve μ. This
holds for scatter between surfaces as well, which scales the curve. The covariance of the mean is

    v φφᵀ + s (B + c W),   B(t, u) = min(μ(t), μ(u)) − μ(t) μ(u)/μ(T)

with v of x(T), B a Brownian bridge in μ (independent sites that do not break their bonds), and W of bonds that form and
break between hold times, which are independent at each of them. Samples and hold times together give s; the unknown c
is averaged over its likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.quantities import Curve
from chemage.foundation.statistics import student_limits

#: the values of c that are averaged over
EXCHANGES = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: part of the mean at the last hold time below which means are not distinguished
SMALLEST = 1e-6
#: values of v and of s in each of PANELS panels of probability over which is averaged, each panel half as wide as the one
#: of smaller values: the largest decide how improbable a large deviation is
VARIANCES, SCALES, PANELS = 4, 1, 12
#: probability below which a value of c is left out
UNLIKELY = 1e-3
#: part of the degrees of freedom of s that counts, as its shape is not exactly that of sites that interact or break
#: their bonds: with it a true model is called different at the 5 % level in 2 to 7 % (tests/benchmarks/verdicts.py)
TRUSTED = 0.75
#: how often the mean curve is found again from samples and measurements together
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class CurveError:
    """The covariance of the mean of a curve; all arrays over the m hold times of the curve."""

    #: (m,) φ
    along: np.ndarray
    #: (terms,) the parts of v, of which each term of the mean has one, and their degrees of freedom
    variances: np.ndarray
    freedoms: np.ndarray
    #: (k,) probabilities of the values of c, and (k, m, m) the covariances beside v φφᵀ
    weights: np.ndarray
    rests: np.ndarray
    #: degrees of freedom of s
    rest_freedom: float

    @classmethod
    def of(cls, samples: Sequence[np.ndarray], mean: np.ndarray) -> CurveError:
        """Find the covariance of a curve that is the sum of the means of ``samples``.

        Parameters
        ----------
        samples
            (n, m) each, n ≥ 2, in the unit of the curve: replicas, or of a mean over surfaces the terms of its sum.
        mean
            (m,) the mean curve, as well as it is known.
        """
        mean = np.maximum.accumulate(np.maximum(mean, 0.0))
        last = max(float(mean[-1]), np.finfo(float).tiny)
        mean = np.maximum(mean, SMALLEST * last)
        along = mean / last
        deviations = [values - values.mean(axis=0) for values in samples]
        # whole numbers of bonds may be equal by chance: Sheppard's correction, Proc. London Math. Soc. 29, 353 (1898)
        squares = [
            float(away[:, -1] @ away[:, -1])
            + (len(away) - 1) * _step(away, SMALLEST * last) ** 2 / 12
            for away in deviations
        ]
        counts = np.array([len(values) for values in samples])
        variances = np.array(squares) / (counts - 1) / counts
        bridge = (
            np.minimum.outer(mean, mean)
            - np.outer(mean, along)
            + SMALLEST * np.diag(mean)
        )
        exchange = np.diag(mean) + np.outer(along, mean)
        likelihoods, rests, freedoms = [], [], []
        for ratio in EXCHANGES:
            shape = (bridge + ratio * exchange)[:-1, :-1]
            factor = np.linalg.cholesky(shape)
            determinant = 2 * np.log(np.diag(factor)).sum()
            squares, likelihood = [], 0.0
            for away in deviations:
                left = (away - np.outer(away[:, -1], along))[:, :-1]
                squares.append(
                    max(
                        float((np.linalg.solve(factor, left.T) ** 2).sum()),
                        np.finfo(float).tiny,
                    )
                )
                likelihood -= (
                    0.5
                    * (len(away) - 1)
                    * (left.shape[1] * np.log(squares[-1]) + determinant)
                )
            scale, own = _sum(squares, samples, mean.size - 1)
            likelihoods.append(likelihood)
            rests.append(np.pad(scale * shape, (0, 1)))
            freedoms.append(own)
        weights = np.exp(np.array(likelihoods) - max(likelihoods))
        weights /= weights.sum()
        return cls(
            along,
            variances,
            counts - 1,
            weights,
            np.stack(rests),
            TRUSTED * float(weights @ freedoms),
        )

    @property
    def variance(self) -> float:
        """v"""
        return float(self.variances.sum())

    def matrix(self, level: float | None = None) -> np.ndarray:
        """(m, m) the covariance of the mean; with a ``level`` of a normal error whose interval of that probability is
        Student's."""
        wider = np.ones(2)
        if level is not None:
            below = float((self.variances**2 / self.freedoms).sum())
            freedom = self.variance**2 / below if below else 1.0
            freedoms = np.array([freedom, self.rest_freedom, np.inf])
            limits = student_limits(freedoms, level)
            wider = (limits[:2] / limits[2]) ** 2
        rest = np.einsum("k,kij->ij", self.weights, self.rests)
        shared = self.variance * np.outer(self.along, self.along)
        return wider[0] * shared + wider[1] * rest

    def chance(
        self, residual: np.ndarray, noise: np.ndarray, places: np.ndarray
    ) -> float:
        """Return the probability of a larger deviation by chance.

        The residual along φ and what is left of it are independent of each other. Each is tested with what is known of
        its variance (for the first the fiducial distribution of Behrens and Fisher), and the two probabilities are
        combined (Fisher, Statistical Methods for Research Workers (1932), section 21.1).

        Parameters
        ----------
        residual, noise
            (j,) measured minus curve, and (j, j) the covariance of all other errors.
        places
            (j, m) takes the curve from its own hold times to those of the measurements.
        """
        from scipy import stats

        along = places @ self.along
        variances, shares = np.zeros(1), np.ones(1)
        for variance, freedom in zip(self.variances, self.freedoms, strict=True):
            factors, parts = _drawn(freedom, VARIANCES)
            variances = np.add.outer(variances, variance * factors).ravel()
            variances, shares = _gathered(
                variances, np.outer(shares, parts).ravel(), parts
            )
        likely = self.weights > UNLIKELY
        rests = (places @ self.rests[likely] @ places.T)[:, None]
        scales, parts = _drawn(self.rest_freedom, SCALES)
        factors = np.linalg.cholesky(noise + scales[:, None, None] * rests)
        both = np.linalg.solve(factors, np.stack([residual, along], axis=1))
        scaled, direction = both[..., 0], both[..., 1]
        error = 1 / (direction**2).sum(axis=-1)
        part = (direction * scaled).sum(axis=-1) * error
        left = (scaled**2).sum(axis=-1) - part**2 / error
        weights = self.weights[likely] / self.weights[likely].sum()
        above = stats.chi2.sf(
            (part**2)[..., None] / (variances + error[..., None]), 1
        )
        first = weights @ (above @ shares @ parts)
        second = weights @ (stats.chi2.sf(left, residual.size - 1) @ parts)
        return float(
            stats.chi2.sf(
                -2 * (np.log(max(first, 1e-300)) + np.log(max(second, 1e-300))), 4
            )
        )


def correlated_errors(
    curve: Curve, level: float = 0.9
) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors of a simulated curve at its points above 0, and the correlation of each with the point before.

    The errors are a Markov chain where bonds do not break: B and φφᵀ are products of a function of the earlier and one
    of the later time. Else it is the chain that comes closest to them, the one with the same correlations of neighbours
    (Chow & Liu, IEEE Trans. Inf. Theory 14, 462 (1968)).

    Parameters
    ----------
    curve
        With the samples of its mean, or with an error that all points share.
    level
        Normal errors of this size have intervals of this probability that are as wide as Student's.

    Raises
    ------
    InputError
        The curve has no error, as that of a single replica.
    """
    above = curve.x > 0
    shared, mean = np.nan_to_num(curve.shared)[above], curve.mean[above]
    covariance = np.outer(shared, shared)
    if curve.samples:
        samples = [values[:, above] for values in curve.samples]
        # where no bond has formed, half a one may have
        half = 0.5 * _step(samples[0], SMALLEST * float(mean.max(initial=0.0)))
        least = mean + half / len(samples[0])
        covariance = covariance + CurveError.of(samples, least).matrix(level)
    errors = np.sqrt(np.diag(covariance))
    if not errors.all():
        raise InputError(
            f"{curve.label}: its error is not known, as that of a single replica; age several"
        )
    near = np.append(0.0, np.diag(covariance, 1) / (errors[1:] * errors[:-1]))
    return errors, near


def agreement(
    samples: Sequence[np.ndarray],
    mean: np.ndarray,
    values: np.ndarray,
    noise: np.ndarray,
    places: np.ndarray,
) -> tuple[CurveError, float]:
    """Return the error of a curve beside measurements, and the probability of a larger deviation by chance.

    The mean that enters the covariance is that of samples and measurements together, as if they agreed: of few bonds
    the samples alone have too small a variance where they have too few bonds by chance. Arguments as for
    :meth:`CurveError.of` and :meth:`CurveError.chance`; ``values``: (j,) the measurements.
    """
    residual, shape = values - places @ mean, mean
    error = CurveError.of(samples, shape)
    for _ in range(ROUNDS - 1):
        own = error.matrix()
        shape = mean + own @ places.T @ np.linalg.solve(
            noise + places @ own @ places.T, residual
        )
        error = CurveError.of(samples, shape)
    return error, error.chance(residual, noise, places)


def _step(values: np.ndarray, least: float) -> float:
    """The smallest difference above ``least`` between values; 0 without any."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > least]
    return float(steps.min()) if steps.size else 0.0


def _sum(
    squares: Sequence[float], samples: Sequence[np.ndarray], columns: int
) -> tuple[float, float]:
    """The variance of a sum of means from the sums of squares of its terms, and its degrees of freedom (Welch and
    Satterthwaite)."""
    freedoms = np.array(
        [(len(values) - 1) * columns for values in samples], dtype=np.float64
    )
    parts = np.array(squares) / freedoms / [len(values) for values in samples]
    below = float((parts**2 / freedoms).sum())
    return float(parts.sum()), float(
        parts.sum() ** 2 / below
    ) if below > 0 else float(freedoms.sum())


def _drawn(freedom: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Factors of a variance that is known with ``freedom`` degrees of freedom, and their probabilities."""
    from scipy import special

    edges = np.concatenate([[0.0], 2.0 ** np.arange(1.0 - PANELS, 1.0)])
    widths = np.repeat(np.diff(edges) / count, count)
    middles = np.cumsum(widths) - 0.5 * widths
    return freedom / special.chdtri(freedom, 1 - middles), widths


def _gathered(
    values: np.ndarray, shares: np.ndarray, widths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Probable values in groups of about the probabilities ``widths``, the largest first."""
    order = np.argsort(-values)
    values, shares = values[order], shares[order]
    middles = np.cumsum(shares) - 0.5 * shares
    group = np.minimum(np.searchsorted(np.cumsum(widths), middles), widths.size - 1)
    total = np.bincount(group, shares, widths.size)
    mean = np.bincount(group, shares * values, widths.size)
    return mean[total > 0] / total[total > 0], total[total > 0]
