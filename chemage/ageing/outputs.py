"""What an observable declares of the numbers that it measures: dimensions, unit, description."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.foundation.errors import PluginError

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
        given = (self.dims,) if isinstance(self.dims, str) else tuple(self.dims)
        dims = tuple(HOLD_TIME if dim == _HOLD_TIMES else dim for dim in given)
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
    found = []
    for name, output in outputs.items():
        if problem := name_problem(name):
            found.append(f"output {problem}")
        elif name in _TAKEN:
            found.append(f"output {name!r}: every result has this name already; rename it")
        if not isinstance(output, Output):
            found.append(f"output {name!r} is a {type(output).__name__}; give a chemage.plugin.Output")
            continue
        for dim in output.dims:
            if problem := name_problem(dim):
                found.append(f"output {name!r}: dimension {problem}")
            elif dim in outputs or (dim in _TAKEN and dim != HOLD_TIME):
                found.append(f"output {name!r}: the dimension {dim!r} has the name of a variable; rename it")
        if len(set(output.dims)) < len(output.dims):
            found.append(f"output {name!r}: dims = {output.dims} lists one dimension twice")
        if not isinstance(output.unit, str) or not isinstance(output.description, str):
            found.append(f"output {name!r}: unit and description must be strings")
    return found


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
