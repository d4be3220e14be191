"""Samples of the posterior: chains that are continued until there are enough, and the measures of that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from chemage.foundation.threads import available, in_order
from chemage.inference.chains import Chain
from chemage.inference.problem import Problem

#: chains, and sweeps of each before samples are kept
CHAINS, WARM = 4, 400
#: effective samples and R-hat at which sampling ends, and the most sweeps of a chain for it
ENOUGH, AGREED, MOST_SWEEPS = 300, 1.03, 4000


@dataclass(frozen=True, eq=False)
class Samples:
    """What sampling gives."""

    #: (S, n) densities, (S,) points of the grid of scalars, (S,) factors
    densities: np.ndarray
    points: np.ndarray
    factors: np.ndarray
    #: least effective number of samples and largest R-hat over the nodes watched, and sweeps of each chain
    effective: float
    r_hat: float
    sweeps: int

    def fitted(self, problem: Problem) -> np.ndarray:
        """(S, m) values of each sample."""
        found = (
            problem.offsets[self.points]
            + np.einsum("smn,sn->sm", problem.matrices[self.points], self.densities, optimize=False)
            if len(problem.matrices) > 1
            else problem.offsets[0] + self.densities @ problem.matrices[0].T
        )
        return self.factors[:, None] * found


def sample(
    problem: Problem,
    start: np.ndarray,
    *,
    samples: int,
    seed: int,
    watched: np.ndarray | None = None,
    sweeps: int = MOST_SWEEPS,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Samples:
    """At least ``samples`` samples of the posterior from chains that begin near ``start`` (n,).

    The chains are continued until the ``watched`` nodes (n,) have :data:`ENOUGH` effective samples and agree, or
    each has made ``sweeps`` sweeps; of the sweeps, evenly spaced ones are kept.
    """
    each = -(-samples // CHAINS)
    watched = np.ones(start.size, dtype=bool) if watched is None else watched
    chains = [Chain(problem, start, np.random.default_rng([seed, number, 41])) for number in range(CHAINS)]
    workers = min(threads or available(), CHAINS)
    warm = min(WARM, sweeps)
    total, made, more = warm + sweeps, 0, min(2 * each, max(sweeps, each))
    list(in_order(lambda number: chains[number].warm(warm), CHAINS, workers, None))
    while True:
        if progress:
            progress(warm + made, total)
        more = min(more, sweeps - made) if made else more
        list(in_order(lambda number, more=more: chains[number].run(more), CHAINS, workers, None))
        made += more
        kept = np.linspace(0, made - 1, each).round().astype(int)
        every = np.stack([np.array(chain.densities) for chain in chains])
        effective, r_hat = convergence(every[:, :, watched] if watched.any() else every)
        if (effective >= ENOUGH and r_hat <= AGREED) or made >= sweeps:
            break
        more = made
    effective = min(effective, float(CHAINS * each))
    if progress:
        progress(total, total)
    points = np.concatenate([np.array(chain.points)[kept] for chain in chains])
    factors = np.concatenate([np.array(chain.factors)[kept] for chain in chains])
    return Samples(every[:, kept].reshape(CHAINS * each, -1), points, factors, effective, r_hat, made)


def convergence(chains: np.ndarray) -> tuple[float, float]:
    """Least effective number of samples and largest R-hat over the columns of ``chains`` (chains, S, n).

    Gelman et al., Bayesian Data Analysis, 3rd edition, section 11.4, of halves of the chains.
    """
    count = chains.shape[1] // 2
    halves = np.concatenate([chains[:, :count], chains[:, count : 2 * count]])
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    between = count * halves.mean(axis=1).var(axis=0, ddof=1)
    # where the density hardly ever differs from zero, a single bump would decide
    moving = within > max(1e-12, 0.01 * float(within.max()))
    if not moving.any():
        return float(chains.shape[0] * chains.shape[1]), 1.0
    total = (count - 1) / count * within + between / count
    r_hat = np.sqrt(total[moving] / within[moving])
    effective = []
    for column in np.flatnonzero(moving):
        values = halves[:, :, column] - halves[:, :, column].mean(axis=1, keepdims=True)
        spectrum = np.abs(np.fft.rfft(values, 2 * count, axis=1)) ** 2
        covariance = np.fft.irfft(spectrum, axis=1)[:, :count].mean(axis=0) / count
        correlation = 1 - (within[column] - covariance * count / (count - 1)) / total[column]
        pairs = correlation[: 2 * (count // 2)].reshape(-1, 2).sum(axis=1)
        end = int(np.argmax(pairs < 0)) if (pairs < 0).any() else pairs.size
        effective.append(halves.shape[0] * count / max(-1 + 2 * float(pairs[:end].sum()), 1e-3))
    return float(min(min(effective), halves.shape[0] * count)), float(r_hat.max())
