"""Statistics over replicas."""

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
