"""Differences of β between results whose replicas share random numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from chemage.ageing.fitting import Curves, FitData, Quantity, fit_aging
from chemage.foundation.errors import InputError
from chemage.foundation.statistics import jackknife_error, student_limit


@dataclass(frozen=True)
class Difference:
    """A difference of β between results whose replicas are paired."""

    value: float
    #: standard error; nan for one replica
    stderr: float
    #: half the width of Student's 95 % interval; nan for one replica
    half_width: float


@dataclass(frozen=True)
class _Without:
    """The curves of all replicas but one."""

    hold_times: np.ndarray
    curves: Curves
    replica: int

    def fit_data(self, quantity: Quantity | None) -> FitData:
        data = self.curves.fit_data(quantity)
        return replace(data, curves=np.delete(data.curves, self.replica, axis=0))


def paired_difference(first: Curves, second: Curves, **options: Any) -> Difference:
    """β of ``first`` less β of ``second``, and the error of this difference.

    Replica r of one must share its random numbers (disorder, or kinetic noise as well) with replica r of the other, and
    with no further replica. The error is the jackknife error of the difference, each pair of replicas left out in turn:
    what the replicas share cancels, as it does in the difference itself. With one replica it is not known, nan.
    ``options`` are those of :func:`chemage.fit_aging`.

    Raises
    ------
    InputError
        The numbers of replicas differ, or as for :func:`chemage.fit_aging`.
    """
    replicas = [len(one.fit_data(options.get("quantity")).curves) for one in (first, second)]
    if replicas[0] != replicas[1]:
        raise InputError(f"{replicas[0]} and {replicas[1]} replicas cannot be paired; give equal numbers")

    def difference(one: Curves, other: Curves) -> float:
        return fit_aging(one, **options).beta - fit_aging(other, **options).beta

    whole, count = difference(first, second), replicas[0]
    if count < 2:
        return Difference(whole, math.nan, math.nan)
    left_out = np.array(
        [difference(*(_Without(one.hold_times, one, replica) for one in (first, second))) for replica in range(count)]
    )
    error = float(jackknife_error(left_out))
    return Difference(whole, error, error * student_limit(count - 1))
