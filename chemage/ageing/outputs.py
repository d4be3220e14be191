"""What an observable declares of the numbers that it measures, and those numbers as summaries and tables show them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.foundation.errors import PluginError
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import mean_text

#: the dimension whose length is the number of hold times
HOLD_TIME = "hold_time"
#: how it was called at first, which is understood as well
_HOLD_TIMES = "hold_times"
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
#: names of variables and dimensions that a result or the table of a sweep has anyway
_TAKEN = ("hold_times", "hold_time", "replica", "point", "bonds", "sites", "events", "rupture_force")


@dataclass(frozen=True)
class Output:
    """The dimensions, the unit and the meaning of one measured number or array.

    Replicas are no dimension of it: they are added when those of all replicas are put together.
    """

    #: names of the dimensions in order; () for a single number; ``"hold_time"`` has one entry for each hold time
    dims: tuple[str, ...] = ()
    #: "" for a pure number
    unit: str = ""
    description: str = ""

    def __post_init__(self) -> None:
        names = (self.dims,) if isinstance(self.dims, str) else tuple(self.dims)
        dims = tuple(HOLD_TIME if dim == _HOLD_TIMES else dim for dim in names)
        object.__setattr__(self, "dims", dims)

    def of(self, values: Any) -> Declared:
        """``values`` with this declaration, for plugins that answer the hook ``chemage_observe``."""
        return Declared(self, values)

    def todict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {"dims": list(self.dims), "unit": self.unit, "description": self.description}


@dataclass(frozen=True)
class Declared:
    """A measured number or array, and what it is."""

    output: Output
    values: Any


def name_problem(name: Any) -> str:
    """Why ``name`` cannot be that of a declared output, or of one of its dimensions; "" where it can."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        return f"{name!r} is no name for a file and a column; use letters, digits, '_', '-' and '.', not first"
    return ""


def file_problem(name: Any) -> str:
    """Why an output that is not declared cannot be stored under ``name``; "" where it can."""
    if not isinstance(name, str):
        return f"the name {name!r} is not a string"
    bad = [letter for letter in name if letter in "/\\" or unicodedata.category(letter)[0] == "C"]
    if bad or not name or name != name.strip() or name in (".", "..") or len(name) > 100:
        return f"the name {name!r} cannot be that of a variable in a file"
    return ""


def declaration_problems(outputs: Any) -> list[str]:
    """What is wrong with ``outputs`` of an observable, a sentence each; it must map names to :class:`Output`."""
    if not isinstance(outputs, Mapping):
        return [f"outputs = {outputs!r}: give a mapping from names to chemage.plugin.Output"]
    problems = []
    for name, output in outputs.items():
        if problem := name_problem(name):
            problems.append(f"output {problem}")
        elif name in _TAKEN:
            problems.append(f"output {name!r}: every result has this name already; rename it")
        if not isinstance(output, Output):
            problems.append(f"output {name!r} is a {type(output).__name__}; give a chemage.plugin.Output")
            continue
        for dim in output.dims:
            if problem := name_problem(dim):
                problems.append(f"output {name!r}: dimension {problem}")
            elif dim in outputs or (dim in _TAKEN and dim != HOLD_TIME):
                problems.append(f"output {name!r}: the dimension {dim!r} has the name of a variable; rename it")
        if len(set(output.dims)) < len(output.dims):
            problems.append(f"output {name!r}: dims = {output.dims} lists one dimension twice")
        if not isinstance(output.unit, str) or not isinstance(output.description, str):
            problems.append(f"output {name!r}: unit and description must be strings")
    return problems


class Checker:
    """Compares what one observable measured on one replica with what it declares."""

    def __init__(self, who: str, hold_times: int) -> None:
        self._who = who
        self._lengths = {HOLD_TIME: hold_times}

    def names(self, measured: Any, outputs: Mapping[str, Output]) -> None:
        """Require that what is measured are just the outputs."""
        if not isinstance(measured, Mapping):
            raise PluginError(f"{self._who} measured {type(measured).__name__}; give a mapping from names to numbers")
        for name in {**dict.fromkeys(outputs), **dict.fromkeys(measured)}:
            if outputs and name not in measured:
                raise PluginError(f"{self._who} declares the output {name!r} and does not measure it")
            if outputs and name not in outputs:
                raise PluginError(f"{self._who} measured {name!r}, which it does not declare; add it to outputs")

    def values(self, name: Any, values: Any, output: Output | None) -> np.ndarray:
        """``values`` as an array, which must have the number and the lengths of the declared dimensions."""
        array = np.asarray(values)
        if output is None:
            if problem := file_problem(name):
                raise PluginError(f"{self._who}: {problem}; rename it")
            return array
        if array.dtype.kind not in "fiub":
            raise PluginError(f"{self._who}: output {name!r} has values of type {array.dtype}; give numbers")
        if array.ndim != len(output.dims):
            raise PluginError(
                f"{self._who}: output {name!r} has the shape {array.shape}, but declares the dimensions {output.dims}"
            )
        for dim, length in zip(output.dims, array.shape, strict=True):
            if self._lengths.setdefault(dim, length) != length:
                raise PluginError(
                    f"{self._who}: output {name!r} has {length} entries along {dim!r}, expected {self._lengths[dim]}"
                )
        return array


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
        return (self.output or Output()).unit

    @property
    def description(self) -> str:
        """What it is, in words; may be empty."""
        return (self.output or Output()).description

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
        finite = self.values[np.isfinite(self.values)]
        if finite.size:
            text += f" from {float(finite.min()):.4g} to {float(finite.max()):.4g} {self.unit}".rstrip()
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
