"""What an inferred density predicts at conditions that were not measured."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from chemage.foundation.errors import InputError
from chemage.foundation.records import Doubles, Plain, PositiveNumber, Record

#: shares of the probability that bands hold
LEVELS = (0.68, 0.90, 0.95)
#: share of a prediction from energies which the data do not see above which only bounds are shown
BOUNDS_ONLY = 0.8


class Forecast(Record):
    """A predicted curve of ageing with its bands: ΔF for every sample of the inferred density."""

    arrays = {
        "hold_times": (("hold_time",), "s", "hold time"),
        "samples": (("sample", "hold_time"), "nN", "friction drop of each sample of the density"),
    }

    load: PositiveNumber
    """nN"""
    temperature: PositiveNumber
    """K"""
    hold_times: Doubles
    """(m,) s"""
    samples: Doubles
    """(S, m) nN: ΔF of each posterior sample, the mean over disorder and noise"""
    unseen: float = 0.0
    """largest share of a predicted value that comes from energies which the data do not see"""
    notes: tuple[str, ...] = ()
    provenance: Plain = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.samples.ndim != 2 or self.samples.shape[1] != self.hold_times.size or not len(self.samples):
            raise ValueError(f"samples: shape {self.samples.shape}; give (samples, {self.hold_times.size})")
        return self

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, nN, (m,): the mean over the samples."""
        return self.samples.mean(axis=0)

    @property
    def median(self) -> np.ndarray:
        """The median of ΔF over the samples, nN, (m,): the mean of skew samples may lie outside of bands."""
        return np.median(self.samples, axis=0)

    @property
    def bounds_only(self) -> bool:
        """Whether nearly all of a prediction is unseen, so that no value within the 95 % band is more likely."""
        return self.unseen > BOUNDS_ONLY

    @property
    def friction_coefficient_drop(self) -> np.ndarray:
        """Δμ = ΔF / load, (m,)."""
        return self.friction_drop / self.load

    def band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the central band of ΔF that holds ``level`` of the probability, nN, (m,) each."""
        return band(self.samples, level)

    def __repr__(self) -> str:
        low, high = self.band()
        ends = f"{low[-1]:.4g} to {high[-1]:.4g}"
        value = f"{ends} nN" if self.bounds_only else f"{self.median[-1]:.4g} nN ({ends})"
        return f"<Forecast {self.load:g} nN, {self.temperature:g} K: {value} at {self.hold_times[-1]:g} s>"

    __str__ = __repr__


def band(samples: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """The central band of ``samples`` (S, n) that holds ``level`` of them: two arrays (n,).

    Raises
    ------
    InputError
        ``level`` is not between 0 and 1.
    """
    if not 0 < level < 1:
        raise InputError.of("level", level, "must be between 0 and 1", "95 % is 0.95")
    low, high = np.quantile(samples, [0.5 - level / 2, 0.5 + level / 2], axis=0)
    return low, high
