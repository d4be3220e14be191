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
    return np.sqrt((r - 1) / r * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))


def student_limit(freedom: int, confidence: float = 0.95) -> float:
    """Standard errors on either side of a mean that hold the truth with probability ``confidence`` (Student's t)."""
    from scipy import special

    return float(special.stdtrit(freedom, 0.5 + 0.5 * confidence))


def half_width(values: np.ndarray, confidence: float = 0.95) -> np.ndarray:
    """Half the width of Student's confidence interval of the mean over the first axis.

    Parameters
    ----------
    values
        (replicas, ...), independent of each other along the first axis.

    Returns
    -------
    numpy.ndarray
        (...), in the unit of ``values``; nan for fewer than two replicas, which have no error.
    """
    error = standard_error(values)
    return error * student_limit(values.shape[0] - 1, confidence) if values.shape[0] > 1 else error
