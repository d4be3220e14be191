"""The history of one replica: the number of bonds at each hold time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage.foundation.checks import (
    check_times,
    checked_states,
    temperature_value,
)
from chemage.foundation.codec import dataset, frame
from chemage.foundation.errors import InputError
from chemage.foundation.figures import BLUE, from_zero
from chemage.foundation.outputs import Observing, kept
from chemage.foundation.records import (
    Doubles,
    Flags,
    Indices,
    Named,
    Number,
    Plain,
    PositiveNumber,
    Record,
)
from chemage.foundation.result import (
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    displays,
    draw_result,
    notebook_html,
)

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

    from chemage.lattices.lattice import ReactionLattice

#: counts of events stop here, where the bonds are no longer those formed less broken
MOST_EVENTS = 2**61
#: What says in ``resume`` how many random numbers are used up, whatever engine used them: of a run as a whole, of its
#: selections, and of each site; the state of each site where there are more than two; and where a slider is: its cell, the
#: way within it, and the partner of each bond.
COUNTERS = ("event", "drawn", "draws", "occupied", "cell", "offset", "partner")


class Followed(Observing, Record):
    """What the histories of holds and of pulls have in common."""

    #: the field with its times, and the argument of a run that they are
    of_times: ClassVar[str]

    if TYPE_CHECKING:
        bonds: Indices
        formed: Indices
        broken: Indices
        state: Flags
    time: Number
    """the last of the times, s"""
    temperature: PositiveNumber
    """K"""
    engine: str
    """kind of the engine"""
    notes: tuple[str, ...] = ()
    """what the user should know of this run, in words"""
    resume: Named = {}
    """what the engine needs to resume bit for bit; private to it, except the counters of random numbers that
    :func:`counters_of` gives"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    def fault(self) -> str:
        """What contradicts itself in this history, in words; "" if nothing does. A run goes on from none that does."""
        last = getattr(self, self.of_times)[-1]
        bonded = int(np.count_nonzero(self.state))
        if self.time != last:
            return f"time = {self.time:g} s is not the last of {self.of_times}, {last:g} s"
        if self.bonds[-1] != bonded:
            return f"bonds[-1] = {self.bonds[-1]}, but {bonded} sites are bonded in the state"
        return ""

    @property
    def events(self) -> int:
        """Bonds formed and broken, together."""
        return int(self.formed[-1] + self.broken[-1])

    @classmethod
    def curves(cls) -> list[str]:
        """The arrays with a value at each time."""
        along = cls.arrays[cls.of_times][0]
        return [name for name, (dims, _, _) in cls.arrays.items() if dims == along]

    def time_axes(self) -> dict[str, int]:
        """What was recorded on the way with a value at each time: name -> axis of the times."""
        along = self.arrays[self.of_times][0][0]
        return {
            name: output["dims"].index(along)
            for name, output in self.outputs.items()
            if along in output["dims"]
        }

    @classmethod
    def _in_a_row(
        cls, parts: Sequence[Any], times: slice = slice(None)
    ) -> dict[str, Any]:
        """Curves, and what was recorded at each time, at these ``times`` of each of ``parts``; the rest of the last."""
        last = parts[-1]
        whole: dict[str, Any] = {
            name: np.concatenate([getattr(one, name)[times] for one in parts])
            for name in cls.curves()
        }
        whole["observables"] = dict(last.observables)
        for name, axis in last.time_axes().items():
            if all(name in one.observables for one in parts):
                at = (*[slice(None)] * axis, times)
                values = [one.observables[name][at] for one in parts]
                whole["observables"][name] = np.concatenate(values, axis=axis)
        return whole

    def handed_on(self, **changes: Any) -> Self:
        """The state of the contact at the end, from which something else begins: without what is pending."""
        last: dict[str, Any] = {
            name: getattr(self, name)[-1:] for name in self.curves()
        }
        last |= {"resume": counters_of(self.resume), "observables": {}}
        if "states" in self.arrays:
            last["states"] = None
        return self.model_copy(update={**last, "outputs": {}, **changes})

    @classmethod
    def of_parts(cls, parts: Sequence[Any], **changes: Any) -> Self:
        """The history of what was followed in ``parts``, the last time of each of which is none of the whole; without
        what is pending."""
        changes["resume"] = counters_of(parts[-1].resume)
        whole = cls._in_a_row(parts, slice(-1))
        return parts[-1].model_copy(update={**whole, **changes})

    def finished(self, start: Any, recorded: Any) -> Self:
        """The same with the counters of ``start`` that its engine does not know, and what was recorded on the way."""
        changes = kept(self, recorded)
        if isinstance(start, Followed):
            resume = {**counters_of(start.resume), **self.resume}
            changes = {**changes, "resume": resume}
        return self.model_copy(update=changes) if changes else self

    def without(self, lost: np.ndarray) -> Self:
        """The state at the end without the bonds of the sites ``lost``, (n,) bool, which count as broken."""
        gone = int(np.count_nonzero(self.state & lost))
        return self.handed_on(
            bonds=self.bonds[-1:] - gone,
            broken=self.broken[-1:] + gone,
            state=self.state & ~lost,
        )

    def fault_of(
        self, lattice: Any, temperature: float, start: Any = None, **arguments: Any
    ) -> str:
        """How it contradicts a run on ``lattice`` with these arguments, in words; "" if it does not."""
        to = getattr(arguments.get("ramp"), "temperature", None)
        temperature = temperature if to is None else temperature_value(to)
        ours, times = getattr(self, self.of_times), arguments[self.of_times]
        if not np.array_equal(ours, times):
            return f"its {self.of_times} are {_few(ours)} s, and not those of the run, {_few(times)} s"
        if self.temperature != temperature:
            return f"temperature = {self.temperature:g} K, but the run is at {temperature:g} K"
        if self.state.size != lattice.sites.size:
            return f"state: {self.state.size} sites, but the lattice has {lattice.sites.size}"
        before = 0
        if isinstance(start, Followed):
            before = int(start.bonds[-1] - start.formed[-1] + start.broken[-1])
        elif start is not None:
            before = int(np.count_nonzero(start))
        counted = np.maximum(self.formed, self.broken) < MOST_EVENTS
        if np.any((self.bonds != before + self.formed - self.broken)[counted]):
            return f"bonds {_few(self.bonds)} are not those formed {_few(self.formed)} less broken {_few(self.broken)}"
        return ""


class BondHistory(Followed):
    """Bonds at each hold time of one run; a run can be resumed from it."""

    of_times = "hold_times"

    arrays = {
        "hold_times": (("hold_time",), "s", "time since the contact was made"),
        "bonds": (("hold_time",), "", "number of bonds"),
        "formed": (("hold_time",), "", "bonds formed so far"),
        "broken": (("hold_time",), "", "bonds broken so far"),
        "state": (("site",), "", "whether each site is bonded at the end"),
        "states": (
            ("hold_time", "site"),
            "",
            "whether each site is bonded at each hold time",
        ),
    }
    stored_names = {"hold_times": "hold_time"}
    added = ("states", "observables", "outputs")

    hold_times: Doubles
    """(m,) s"""
    bonds: Indices
    """(m,) number of bonds"""
    formed: Indices
    """(m,) bonds formed since the start"""
    broken: Indices
    """(m,) bonds broken since the start"""
    state: Flags
    """(n,) bool at the last hold time"""
    states: Flags | None = None
    """(m, n) bool at each hold time; None where nothing asked for them"""
    lattice_hash: str = ""
    """content hash of the lattice"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        shape = self.hold_times.shape
        if self.hold_times.ndim != 1 or not (
            self.bonds.shape == self.formed.shape == self.broken.shape == shape
        ):
            raise ValueError(
                "hold_times, bonds, formed, broken: must be one-dimensional and of equal length"
            )
        if self.states is not None and self.states.shape != (
            *shape,
            *self.state.shape,
        ):
            raise ValueError(
                f"states: shape {self.states.shape}; give ({shape[0]}, {self.state.size})"
            )
        if (
            self.states is not None
            and shape[0]
            and not np.array_equal(self.states[-1], self.state)
        ):
            raise ValueError("states: the last of them is not the state at the end")
        self._check_counts()
        return self

    def _check_counts(self) -> None:
        check_times(self.hold_times)
        if self.state.ndim != 1:
            raise ValueError(
                f"state: shape {self.state.shape}; give one entry per site"
            )
        for name in ("bonds", "formed", "broken"):
            if int(getattr(self, name).min()) < 0:
                raise ValueError(
                    f"{name}: {getattr(self, name).min()} is negative; give counts"
                )

    def fault(self) -> str:
        """See :meth:`Followed.fault`."""
        if int(self.bonds.max()) > self.state.size:
            return f"bonds: up to {self.bonds.max()}, but there are {self.state.size} sites"
        for name in ("formed", "broken"):
            counts = getattr(self, name)
            if int(counts[-1]) > MOST_EVENTS or np.any(counts[1:] < counts[:-1]):
                return f"{name} falls, or exceeds {MOST_EVENTS}"
        return super().fault()

    def then(self, later: BondHistory) -> BondHistory:
        """This history and ``later``, which went on from it, as one.

        Raises
        ------
        InputError
            ``later`` has another number of sites or begins before this one ends.
        """
        if later.state.size != self.state.size or later.hold_times[0] < self.time:
            raise InputError.of(
                "later",
                repr(later),
                "was not resumed from this history",
                "pass what start=... gave",
            )
        both = self._in_a_row((self, later))
        both["states"] = None
        if self.states is not None and later.states is not None:
            both["states"] = np.concatenate([self.states, later.states])
        both["notes"] = tuple(dict.fromkeys((*self.notes, *later.notes)))
        whole = BondHistory(**{**later.todict(), **both})
        return whole.noting(self.plugins, self.approximate)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw bonds against hold time into ``ax``, or into a new figure of pyplot; return the axes."""
        return draw_result(self, ax)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions and units of the file. Needs xarray."""
        return dataset(self)

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each hold time (s): bonds, and those formed and broken so far. Needs pandas."""
        columns = {
            name: getattr(self, name) for name in ("bonds", "formed", "broken")
        }
        return frame(
            {"hold_time": self.hold_times, **columns},
            "hold_time",
            {"temperature": self.temperature},
        )

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def __repr__(self) -> str:
        return f"<BondHistory {self.bonds[-1]} bonds at {self.time:g} s after {self.events} events ({self.engine})>"

    __str__ = __repr__


def checked_start(
    start: Any,
    kind: type[Followed],
    lattice: ReactionLattice,
    times: np.ndarray,
    name: str,
) -> Any:
    """What a run to ``times``, its argument ``name``, begins from: a history of a ``kind``, states or None.

    Raises
    ------
    InputError
        It contradicts itself, has other sites than ``lattice``, or ends after the first of ``times``.
    """
    sites = lattice.sites.size
    if start is None:
        return None
    if not isinstance(start, kind):
        return checked_states("start", start, sites)
    if fault := start.fault():
        raise InputError(
            f"start: a history that contradicts itself: {fault}; pass one as an engine gave it"
        )
    if start.state.size != sites:
        problem = f"the lattice has {sites}"
        remedy = "resume with the lattice that it came from"
        raise InputError.of(
            "start", f"a history of {start.state.size} sites", problem, remedy
        )
    if times[0] < start.time:
        problem = f"the history to resume from ends at {start.time} s"
        raise InputError.of(name, float(times[0]), problem, "give later times")
    return start


def counters_of(resume: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The counters of random numbers among what an engine needs to resume, and the position of a slider.

    Every step of a chain of holds and pulls hands them on to the next one, so that no number is used twice: ``event``
    (1,) int64, used by the run as a whole, and ``draws`` (n,) int64, used by each site. An engine counts on from them.
    """
    return {name: resume[name] for name in COUNTERS if name in resume}


def _few(values: np.ndarray) -> str:
    shown = ", ".join(f"{value:g}" for value in values[:4])
    return f"{shown}, …" if values.size > 4 else shown


@displays(BondHistory)
class HistoryDisplay(OfRecord[BondHistory]):
    """A history of bonds as users see it."""

    def facts(self) -> Rows:
        history = self.record
        return [
            ("sites", str(history.state.size)),
            (f"bonds at {history.time:g} s", str(int(history.bonds[-1]))),
            (
                "formed and broken so far",
                f"{int(history.formed[-1])}, {int(history.broken[-1])}",
            ),
            ("temperature", f"{history.temperature:g} K"),
            ("engine", history.engine),
        ]

    def pictures(self) -> dict[str, Picture]:
        return {"bonds": Picture((Panel(self._draw, "Bonds against hold time."),))}

    def _draw(self, axes: Axes, medium: Medium) -> None:
        history = self.record
        drawn = history.hold_times > 0
        axes.plot(
            history.hold_times[drawn],
            history.bonds[drawn],
            color=BLUE,
            marker="o",
            ms=3.5,
            lw=1,
        )
        axes.set(xscale="log", xlabel="hold time (s)", ylabel="bonds")
        from_zero(axes)
