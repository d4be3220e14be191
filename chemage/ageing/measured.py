"""What observables measured, as every summary, table and report shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.ageing.outputs import HOLD_TIME, Output
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import mean_text

#: in place of the declaration of an output that is not declared
_UNKNOWN = Output()


@dataclass(frozen=True)
class Measured:
    """One output of an observable, measured on all replicas."""

    name: str
    #: (replicas, ...)
    values: np.ndarray
    #: None where the observable does not declare it
    output: Output | None = None

    @property
    def unit(self) -> str:
        """Empty for a pure number, or where it is not known."""
        return (self.output or _UNKNOWN).unit

    @property
    def description(self) -> str:
        """What it is, in words; may be empty."""
        return (self.output or _UNKNOWN).description

    @property
    def is_number(self) -> bool:
        """Whether it is a single number per replica."""
        return self.values.ndim == 1

    @property
    def is_curve(self) -> bool:
        """Whether it is a number for each hold time."""
        return self.output is not None and self.output.dims == (HOLD_TIME,)

    @property
    def numbers(self) -> np.ndarray | None:
        """(replicas,) a single number, or that at the last hold time; None for other arrays."""
        if self.is_number:
            return self.values
        return self.values[:, -1] if self.is_curve else None

    def text(self) -> str:
        """Mean ± half of the 95 % interval with its unit, at the last hold time; of other arrays their size and the
        range of their values."""
        numbers = self.numbers
        if numbers is not None:
            return mean_text(numbers, self.unit)
        text = f"{' x '.join(str(n) for n in self.values.shape[1:])} values"
        known = self.values[np.isfinite(self.values)]
        if known.size:
            text += f" from {float(known.min()):.4g} to {float(known.max()):.4g} {self.unit}".rstrip()
        return text

    def summary(self) -> dict[str, Any]:
        """Dimensions, unit and shape, and of numbers and curves the mean over replicas with its errors."""
        shown: dict[str, Any] = {
            "dims": list(self.output.dims) if self.output is not None else None,
            "unit": self.unit,
            "description": self.description,
            "shape": list(self.values.shape[1:]),
        }
        if self.is_number or self.is_curve:
            values = self.values.astype(np.float64)
            shown |= {"mean": values.mean(axis=0), "stderr": standard_error(values), "half_width": half_width(values)}
        return shown


def measured(observables: Mapping[str, np.ndarray], outputs: Mapping[str, Mapping[str, Any]]) -> dict[str, Measured]:
    """What was measured by name: ``observables`` are the values, ``outputs`` the declarations as plain values."""
    return {
        name: Measured(name, values, Output(**outputs[name]) if name in outputs else None)
        for name, values in observables.items()
    }
