"""What a component declares of the numbers, curves and maps that it records, how they reach the record that its stage
gives, and how summaries and tables show them.

A stage collects what is recorded while its component and its hooks run, checks it, and adds it to its record, with
which it is stored, resumed and passed on. An observable returns what it measures; every other component calls its
method ``record``, and a hook :func:`record`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.errors import PluginError
from chemage.foundation.quantities import ONE, Curve, Quantity
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.steadiness import judged

#: the dimension whose length is the number of hold times
HOLD_TIME = "hold_time"
#: how it was called at first, which is understood as well
_HOLD_TIMES = "hold_times"
#: of the name of a quantity that observables measure, or other components record
RECORDED = "observable."
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
#: names of variables and dimensions that a result or the table of a sweep has anyway
_TAKEN = (
    "hold_times",
    "hold_time",
    "replica",
    "point",
    "bonds",
    "sites",
    "events",
    "rupture_force",
)


@dataclass(frozen=True, init=False)
class Output:
    """The dimensions, the unit and the meaning of one recorded number or array.

    Replicas are no dimension of it: they are added when those of all replicas are put together.
    """

    #: names of the dimensions in order; () for a single number; ``"hold_time"``, of what is followed in time, has one
    #: entry for each hold time of the run, or of the part of it that is computed
    dims: tuple[str, ...]
    #: "" for a pure number
    unit: str
    description: str
    #: of a number the means over a window of time on which it rests, by name: itself alone if it is one, beside which
    #: NAME_change, NAME_formed and NAME_per_bond are recorded; see :func:`chemage.foundation.steadiness.judged`
    rests: tuple[str, ...]

    def __init__(
        self,
        dims: str | Sequence[str] = (),
        unit: str = "",
        description: str = "",
        rests: Sequence[str] = (),
    ) -> None:
        names = (dims,) if isinstance(dims, str) else dims
        known = tuple(HOLD_TIME if name == _HOLD_TIMES else name for name in names)
        object.__setattr__(self, "dims", known)
        object.__setattr__(self, "unit", unit)
        object.__setattr__(self, "description", description)
        object.__setattr__(self, "rests", tuple(rests))

    def of(self, values: Any) -> RecordedValue:
        """``values`` with this declaration, for :func:`record` and the hook ``chemage_observe``."""
        return RecordedValue(self, values)

    def todict(self) -> Data:
        """Plain JSON values."""
        return {**vars(self), "dims": list(self.dims), "rests": list(self.rests)}


@dataclass(frozen=True)
class RecordedValue:
    """A recorded number or array, and what it is."""

    output: Output
    values: Any


class Recorded(NamedTuple):
    """What was recorded, and by whom, in words."""

    who: str
    declared: RecordedValue


#: name -> what was recorded in this block
Block = dict[str, Recorded]
_block: ContextVar[Block | None] = ContextVar("chemage_recorded", default=None)


@contextmanager
def recording() -> Iterator[Block]:
    """What is recorded in this block, in this thread."""
    block: Block = {}
    token = _block.set(block)
    try:
        yield block
    finally:
        _block.reset(token)


def recorded() -> Block:
    """What is recorded so far in the block of this thread; nothing outside one."""
    return _block.get() or {}


def record(**values: RecordedValue) -> None:
    """Record numbers, curves or maps beside what a hook answers: ``name=Output(dims, unit, description).of(values)``.

    They are kept with the result of the stage; outside a stage they are dropped. Of a name that is recorded again, the
    last values count. A component declares ``outputs`` and calls its own method ``record``.
    """
    record_by("a hook", values)


def record_by(who: str, values: Fields) -> None:
    """As :func:`record`, by ``who``, which must be a single one for each name."""
    block = _block.get()
    for name, declared in values.items():
        if not isinstance(declared, RecordedValue):
            raise PluginError(
                f"{who}: {name!r} is recorded without its unit; give Output(dims, unit, ...).of(values)"
            )
        if block is not None:
            if (other := block.get(name, (who,))[0]) != who:
                raise PluginError(
                    f"{name!r} is recorded by {other} and by {who}; rename one"
                )
            block[name] = Recorded(who, declared)


def kept(record: Any, block: Mapping[str, Recorded]) -> Data:
    """The fields ``observables`` and ``outputs`` of ``record`` with what was recorded in ``block``.

    Raises
    ------
    PluginError
        A name is taken, or values do not fit their declaration.
    """
    if not block:
        return {}
    times: np.ndarray | None = getattr(record, "hold_times", None)
    observables, outputs = dict(record.observables), dict(record.outputs)
    checkers: dict[str, Checker] = {}
    for name, (who, declared) in block.items():
        output, values = declared.output, declared.values
        if problems := declaration_problems({name: output}):
            raise PluginError(f"{who}: {problems[0]}")
        if times is None and HOLD_TIME in output.dims:
            raise PluginError(
                f"{who}: output {name!r}: there are no hold times at this stage; name the dimension else"
            )
        checker = checkers.setdefault(
            who, Checker(who, None if times is None else times.size)
        )
        observables[name], outputs[name] = (
            checker.values(name, values, output),
            output.todict(),
        )
    return {"observables": observables, "outputs": outputs}


class Observing:
    """What a record with the fields ``observables`` and ``outputs`` has in common with others."""

    if TYPE_CHECKING:
        arrays: ClassVar[dict[str, tuple[tuple[str, ...], str, str]]]
        observables: dict[str, np.ndarray]
        outputs: dict[str, Data]

    def declared(self, name: str) -> tuple[tuple[str, ...], str, str] | None:
        """See :meth:`Record.declared`; of ``observables/...`` what was declared of it."""
        field, _, key = name.partition("/")
        if field != "observables" or key not in self.outputs:
            return type(self).arrays.get(name)
        output = Output(**self.outputs[key])
        return output.dims, output.unit, output.description

    @property
    def measured(self) -> dict[str, MeasuredOutput]:
        """What was recorded on the way to this, with dimensions and units, by name."""
        return measured(
            {name: values[None] for name, values in self.observables.items()},
            self.outputs,
        )

    @property
    def recorded(self) -> Block:
        """The same, to be passed on to the next stage."""
        return {
            name: Recorded(
                "a stage before", Output(**self.outputs[name]).of(values)
            )
            for name, values in self.observables.items()
        }


def name_problem(name: Any) -> str:
    """Why ``name`` cannot be that of a declared output, or of one of its dimensions; "" where it can."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        return f"{name!r} is no name for a file and a column; use letters, digits, '_', '-' and '.', not first"
    return ""


def file_problem(name: Any) -> str:
    """Why an output that is not declared cannot be stored under ``name``; "" where it can."""
    if not isinstance(name, str):
        return f"the name {name!r} is not a string"
    allowed = all(
        letter not in "/\\" and unicodedata.category(letter)[0] != "C"
        for letter in name
    )
    proper = (
        name == name.strip() and name not in ("", ".", "..") and len(name) <= 100
    )
    if allowed and proper:
        return ""
    return f"the name {name!r} cannot be that of a variable in a file"


def declaration_problems(outputs: Any) -> list[str]:
    """What is wrong with ``outputs`` of a component, a sentence each; it must map names to :class:`Output`."""
    if not isinstance(outputs, Mapping):
        return [
            f"outputs = {outputs!r}: give a mapping from names to chemage.plugin.Output"
        ]
    problems = []
    for name, output in outputs.items():
        if problem := name_problem(name):
            problems.append(f"output {problem}")
        elif name in _TAKEN:
            problems.append(
                f"output {name!r}: every result has this name already; rename it"
            )
        if not isinstance(output, Output):
            problems.append(
                f"output {name!r} is a {type(output).__name__}; give a chemage.plugin.Output"
            )
            continue
        for dim in output.dims:
            if problem := name_problem(dim):
                problems.append(f"output {name!r}: dimension {problem}")
            elif dim in outputs or (dim in _TAKEN and dim != HOLD_TIME):
                problems.append(
                    f"output {name!r}: the dimension {dim!r} has the name of a variable; rename it"
                )
        if len(set(output.dims)) < len(output.dims):
            problems.append(
                f"output {name!r}: dims = {output.dims} lists one dimension twice"
            )
        if not isinstance(output.unit, str) or not isinstance(
            output.description, str
        ):
            problems.append(
                f"output {name!r}: unit and description must be strings"
            )
    return problems


class Checker:
    """Compares what one observable measured on one replica with what it declares."""

    def __init__(self, who: str, hold_times: int | None) -> None:
        self._who = who
        self._lengths = {} if hold_times is None else {HOLD_TIME: hold_times}

    def names(self, measured: Any, outputs: Mapping[str, Output]) -> None:
        """Require that what is measured are just the outputs."""
        if not isinstance(measured, Mapping):
            raise PluginError(
                f"{self._who} measured {type(measured).__name__}; give a mapping from names to numbers"
            )
        for name in {**dict.fromkeys(outputs), **dict.fromkeys(measured)}:
            if outputs and name not in measured:
                raise PluginError(
                    f"{self._who} declares the output {name!r} and does not measure it"
                )
            if outputs and name not in outputs:
                raise PluginError(
                    f"{self._who} measured {name!r}, which it does not declare; add it to outputs"
                )

    def values(self, name: Any, values: Any, output: Output | None) -> np.ndarray:
        """``values`` as an array, which must have the number and the lengths of the declared dimensions."""
        array = np.asarray(values)
        if output is None:
            if problem := file_problem(name):
                raise PluginError(f"{self._who}: {problem}; rename it")
            return array
        if array.dtype.kind not in "fiub":
            raise PluginError(
                f"{self._who}: output {name!r} has values of type {array.dtype}; give numbers"
            )
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
class MeasuredOutput:
    """One output, of all replicas."""

    name: str
    #: (replicas, ...)
    values: np.ndarray
    #: None where an observable does not declare it
    output: Output | None = None
    #: the mean with what is wrong with it, where it rests on means over a window
    judged: Quantity | None = None

    @property
    def unit(self) -> str:
        """Empty for a pure number, or where it is not known."""
        return (self.output or Output()).unit

    @property
    def description(self) -> str:
        """What it is, in words; may be empty."""
        return (self.output or Output()).description

    @property
    def words(self) -> str:
        """What it is, in words; its name where it is not described."""
        return self.description or self.name

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

    def quantity(self) -> Quantity:
        """A single number, as its mean over the replicas."""
        return self.judged or Quantity(*self._declared()).of_replicas(self.values)

    def curve(self, hold_times: np.ndarray, over: str) -> Curve:
        """A number for each hold time, as its mean over the replicas."""
        return Curve(*self._declared()).of_replicas(hold_times, self.values, over)

    def _declared(self) -> tuple[str, str, str, str, str]:
        name = f"{RECORDED}{self.name}"
        return name, self.unit or ONE, self.words, "", self.description

    def row(self) -> tuple[str, str]:
        """Of an array its name, and size, range of values and meaning."""
        text = f"{' x '.join(str(n) for n in self.values.shape[1:])} values"
        finite = self.values[np.isfinite(self.values)]
        if finite.size:
            text += f" from {float(finite.min()):.4g} to {float(finite.max()):.4g} {self.unit}".rstrip()
        return self.name, "; ".join(filter(None, (text, self.description)))

    def summary(self) -> Data:
        """Dimensions, unit and shape, and of numbers and curves the mean over replicas with its errors."""
        shown: Data = {
            "dims": list(self.output.dims) if self.output is not None else None,
            "unit": self.unit,
            "description": self.description,
            "shape": list(self.values.shape[1:]),
        }
        if self.is_number or self.is_curve:
            values = self.values.astype(np.float64)
            shown |= {
                "mean": values.mean(axis=0),
                "stderr": standard_error(values),
                "half_width": half_width(values),
            }
        if (one := self.judged) is not None:
            if not one.known:
                shown |= {"mean": one.value, "withheld": shown["mean"]}
                shown |= {"stderr": one.stderr, "half_width": one.half_width}
            shown |= {"low": one.low, "high": one.high, "reason": one.reason}
        return shown


def measured(
    observables: Mapping[str, np.ndarray], outputs: Mapping[str, Fields]
) -> dict[str, MeasuredOutput]:
    """What was measured by name: ``observables`` are the values, ``outputs`` the declarations as plain values."""
    found = {
        name: MeasuredOutput(
            name, values, Output(**outputs[name]) if name in outputs else None
        )
        for name, values in observables.items()
    }
    rests = {
        name: one.output.rests
        for name, one in found.items()
        if one.output is not None and one.output.rests
    }
    if rests:
        numbers = {
            name: one.quantity() for name, one in found.items() if one.is_number
        }
        samples = len(next(iter(observables.values())))
        for name, one in judged(numbers, rests, samples).items():
            if one is not numbers[name]:
                found[name] = replace(found[name], judged=one)
    return found
