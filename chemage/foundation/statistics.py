"""Statistics over independent replicas."""

from __future__ import annotations

import math

import numpy as np


def standard_error(values: np.ndarray) -> np.ndarray:
    """Standard error of the mean over the first axis.

    Parameters
    ----------
    values
        (replicas, ...), independent of each other along the first axis.

    Returns
    -------
    numpy.ndarray
        (...), in the unit of ``values``; nan for fewer than two replicas.
    """
    if values.shape[0] < 2:
        return np.full(values.shape[1:], np.nan)
    return values.std(axis=0, ddof=1) / math.sqrt(values.shape[0])


def jackknife_error(left_out: np.ndarray) -> np.ndarray:
    """Standard error of an estimate, (...), from its values with each of r ≥ 2 replicas left out in turn, (r, ...)."""
    r = len(left_out)
    return np.sqrt(
        (r - 1) / r * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0)
    )


#: standard errors on either side of a normal mean that hold the truth with a probability of 95 %
NORMAL_LIMIT = 1.959963984540054


def student_limit(freedom: int, confidence: float = 0.95) -> float:
    """Standard errors on either side of a mean that hold the truth with probability ``confidence`` (Student's t)."""
    from scipy import special

    return float(special.stdtrit(freedom, 0.5 + 0.5 * confidence))


def student_limits(freedom: np.ndarray, confidence: float = 0.95) -> np.ndarray:
    """:func:`student_limit` of each of many degrees of freedom, which need not be whole numbers."""
    from scipy import special

    return special.stdtrit(freedom, 0.5 + 0.5 * confidence)


def half_width(values: np.ndarray, confidence: float = 0.95) -> np.ndarray:
    """Half the width of Student's confidence interval of the mean over the first axis.

    Parameters
    ----------
    values
        (replicas, ...), independent of each other along the first axis.

    Returns
    -------
    numpy.ndarray
        (...), in the unit of ``values``; nan for fewer than two replicas, which have no error, and where all replicas
        are equal, as few bonds often are by chance: their scatter is not known.
    """
    error = standard_error(values)
    if values.shape[0] < 2:
        return error
    width = error * student_limit(values.shape[0] - 1, confidence)
    return np.where((values == values[0]).all(axis=0), np.nan, width)[()]


def crossed_half_width(values: np.ndarray, factors: int) -> np.ndarray:
    """Half the width of the 95 % interval of the mean over the first ``factors`` axes, each of which is random.

    Values that share a place along one of these axes (the seed of a surface, say) share its scatter, so that they are
    not independent. The variance of the mean is the sum of those of the means along each axis, and its degrees of
    freedom those of the largest of these. Scatter that no axis explains is counted once per axis, so that the interval
    is rather too wide, by the root of ``factors`` at most. One axis gives Student's interval.

    Parameters
    ----------
    values
        (n₁, …, n_factors, ...); what is not finite is left out.

    Returns
    -------
    numpy.ndarray
        (...), in the unit of ``values``; nan where there are fewer than two values along an axis of several.
    """
    finite = np.isfinite(values)
    parts, freedoms = [], []
    for axis in range(factors):
        if values.shape[axis] < 2:
            continue
        others = tuple(other for other in range(factors) if other != axis)
        held = finite.sum(axis=others)
        there = held > 0
        count = there.sum(axis=0)
        # what has nothing to be a mean of is 0/0, that is nan
        with np.errstate(invalid="ignore", divide="ignore"):
            means = np.where(finite, values, 0.0).sum(axis=others) / held
            centre = np.where(there, means, 0.0).sum(axis=0) / count
            squares = np.where(there, means - centre, 0.0) ** 2
            parts.append(squares.sum(axis=0) / (count - 1) / count)
        freedoms.append(np.maximum(count - 1, 1))
    if not parts:
        return np.full(values.shape[factors:], np.nan)
    largest = np.argmax(parts, axis=0)[None]
    return np.sqrt(np.sum(parts, axis=0)) * student_limits(
        np.take_along_axis(np.array(freedoms), largest, axis=0)[0]
    )
