"""Paths of a contact: loads or approaches in the order given, and what a contact makes of them that remembers.

A path begins with surfaces that are apart. A solver of spheres in closed form follows it along its branches; the
boundary elements halve their steps until each is either smooth or a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import ErrorPart, Quantity, UnitError, convert, statistics

#: width, relative to the range of the path, to which jumps are enclosed
RESOLUTION = 2.0**-12
#: energy of a step, relative to that of the attraction, and pull, relative to the largest one, that is not resolved
ENERGY, FORCE = 1e-3, 1e-3
#: parts of the elastic energy, and of the attraction at the deepest point, that count as the attraction does
ELASTIC, FLOOR = 0.01, 0.1
#: half the width of an interval that is certain, in standard errors
CERTAIN = math.sqrt(3.0)

_PULL_OFF = Quantity("pull_off", "nN", "pull-off force", meaning="largest pull")
_JUMP_IN = Quantity("jump_in", "nm", "approach at which contact begins")
_JUMP_OUT = Quantity("jump_out", "nm", "approach at which contact ends")
_JUMP = Quantity("jump", "nm", "approach at a jump")
_SEPARATION = Quantity(
    "work_of_separation",
    "nN nm",
    "work of separation",
    meaning="work of the last separation, from no load to the end of the path",
)
_DISSIPATED = Quantity(
    "dissipated", "nN nm", "dissipated energy", meaning="work on a closed path"
)
_OPEN = "not known: the path does not end in the state in which it began"
_FALLS = (
    "not known: under a given load the surfaces fall together or apart; give approaches"
)
_NO_PULL = "nothing adheres"
_ELSEWHERE = "not on this path"


@dataclass(frozen=True)
class Path:
    """Approaches (nm) since first touch, or loads (nN), in the order given; see :meth:`of` and :meth:`down_to`."""

    values: tuple[float, ...] = ()
    control: Literal["approach", "load"] = "approach"
    #: load (nN) to which the surfaces are pressed before they are pulled apart, in ``points`` steps each way
    target: float | None = None
    points: int = 20

    @classmethod
    def of(cls, path: Path | Iterable[Any]) -> Path:
        """A path of lengths, which are approaches, or of forces, which are loads. A number is an approach in nm.

        Raises
        ------
        InputError
            There are fewer than two values, one is not finite, or lengths and forces are mixed.
        """
        if isinstance(path, Path):
            return path
        plain = isinstance(path, Iterable) and not isinstance(path, str | bytes)
        given = list(path) if plain else []
        if len(given) < 2:
            raise InputError.of(
                "path",
                path,
                "has fewer than two values",
                'give approaches such as ["-0.2 nm", "0.2 nm"], loads such as ["0 nN", "5 nN"], or Path.down_to("5 nN")',
            )
        unit = "nm"
        try:
            convert(given[0], unit)
        except UnitError:
            unit = "nN"
        values = tuple(convert(value, unit, "path") for value in given)
        if not all(map(math.isfinite, values)):
            raise InputError.of(
                "path", given, "has a value that is not finite", "give nm or nN"
            )
        return cls(values, "approach" if unit == "nm" else "load")

    @classmethod
    def down_to(cls, load: Any, points: int = 20) -> Path:
        """From surfaces apart down to a ``load`` (nN, or a string with its unit), and up until they have parted."""
        force = convert(load, "nN", "load")
        if not 0 <= force < math.inf:
            raise InputError.of("load", load, "must be finite and not negative")
        if points < 2:
            raise InputError.of("points", points, "must be at least 2")
        return cls(target=force, points=points)

    def there_and_back(self, first: float, last: float) -> Path:
        """The approaches from ``first`` to ``last`` and back."""
        there = np.linspace(first, last, self.points + 1).tolist()
        return Path((*there, *there[-2::-1]))


class PathState(NamedTuple):
    """A contact on a path."""

    displacement: float
    load: float
    area: float
    #: elastic energy and that of the attraction, and the size of the latter, nN nm
    energy: float = 0.0
    attraction: float = 0.0
    #: where the next contact may begin
    memory: Any = None
    contact: ContactSolution | None = None


@dataclass(frozen=True)
class Loop:
    """What a contact made of a path: (m,) approach since first touch (nm; -inf: apart under a given load), load (nN)
    and contact area (nm²; 0: apart) at its values and where it was refined, and quantities with their errors."""

    displacement: np.ndarray
    load: np.ndarray
    area: np.ndarray
    #: (n,) where the values of the path are
    given: np.ndarray
    pull_off: Quantity
    jump_in: Quantity
    jump_out: Quantity
    work_of_separation: Quantity
    dissipated: Quantity
    #: the approach at each jump of the load, in the order of the path; ``of`` says in which direction
    jumps: tuple[Quantity, ...] = ()
    #: the contacts at the values of the path, of boundary elements
    contacts: tuple[ContactSolution, ...] = ()

    @classmethod
    def of(
        cls, states: Sequence[PathState], given: Sequence[int], **quantities: Any
    ) -> Loop:
        """With the arrays of ``states``."""
        columns = np.array([state[:3] for state in states], dtype=np.float64)
        displacement, load, area = columns.T
        return cls(displacement, load, area, np.array(given, np.int64), **quantities)

    def quantities(self) -> list[Quantity]:
        """All but the single jumps."""
        return [
            self.pull_off,
            self.jump_in,
            self.jump_out,
            self.work_of_separation,
            self.dissipated,
        ]

    def __str__(self) -> str:
        return "\n".join(": ".join(one.row()) for one in self.quantities())


def stated(quantity: Quantity, value: float, **errors: tuple[float, str]) -> Quantity:
    """With ``value`` and the parts of its error: cause -> (standard error, how it is known)."""
    parts = {cause: ErrorPart(*part) for cause, part in errors.items()}
    total = math.sqrt(sum(part.size**2 for part in parts.values()))
    return quantity.but(value=value, errors=parts).between(
        statistics.NORMAL_LIMIT * total, total
    )


def more_errors(quantity: Quantity, **errors: tuple[float, str]) -> Quantity:
    """With further parts of its error; without an interval where one is not known."""
    if not quantity.known:
        return quantity
    parts: dict[str, Any] = {**quantity.errors, **errors}
    found = stated(quantity, quantity.value, **parts)
    return found if math.isfinite(found.half_width) else found.but(stated="")


def coarser(surface: Surface) -> Iterator[tuple[int, Surface]]:
    """The surface on pixels that are two, three or four times as large: two of these, or those that its period allows.

    A surface that does not repeat loses pixels on both sides, so that its middle stays that of a pixel, or a corner:
    contacts stick to symmetric grids most.
    """
    factors = [
        k
        for k in (2, 3, 4)
        if not surface.periodic or not any(n % k for n in surface.shape)
    ]
    for k in factors[:2]:
        heights = surface.heights
        for axis, n in enumerate(surface.shape):
            lost = next((m for m in range(0, 2 * k, 2) if (n - m) % k == 0), n % k)
            kept = np.arange(lost // 2, lost // 2 + n - lost)
            heights = np.take(heights, kept, axis)
        nx, ny = heights.shape
        yield (
            k,
            Surface(
                heights=heights.reshape(nx // k, k, ny // k, k).mean(axis=(1, 3)),
                pixel_size=k * surface.pixel_size,
                periodic=surface.periodic,
                provenance=surface.provenance,
            ),
        )


def exact(quantity: Quantity, value: float, reason: str = "") -> Quantity:
    """With a ``value`` of which only rounding is wrong."""
    return stated(quantity, value + 0.0, path=(0.0, "closed form")).but(reason=reason)


def unknown(quantity: Quantity, reason: str) -> Quantity:
    """Without a value."""
    return quantity.but(reason=reason)


# -- closed forms -----------------------------------------------------------------------------------------------------


class Branch(NamedTuple):
    """The equilibria of a sphere between two approaches, in the order from apart to contact."""

    touching: bool
    #: load (nN) at an approach; None: there is none
    load: Callable[[float], float] | None
    low: float
    high: float
    #: approach of the least load
    least: float = math.nan

    def work(self, first: float, last: float) -> float:
        """∫F dδ. In the root of the distance to the end of the branch, where the load has an infinite slope."""
        from scipy.integrate import quad

        load = self.load
        if load is None or first == last:
            return 0.0
        low = self.low
        begin, end = (math.sqrt(max(at - low, 0.0)) for at in (first, last))
        found: Any = quad(
            lambda t: 2 * t * load(low + t * t), begin, end, epsabs=0.0, epsrel=1e-11
        )
        return found[0]

    def lowest(self, first: float, last: float) -> float:
        """The least load between two approaches."""
        if self.load is None:
            return 0.0
        ends = [first, last]
        if min(ends) < self.least < max(ends):
            ends.append(self.least)
        return min(map(self.load, ends))


class _Leg(NamedTuple):
    """A part of a path on one branch."""

    branch: Branch
    first: float
    last: float

    @property
    def work(self) -> float:
        return self.branch.work(self.first, self.last)


def _legs(
    branches: Sequence[Branch], values: Sequence[float]
) -> tuple[list[_Leg], list[int]]:
    """The legs of a path, and the branch at each of its values."""
    legs: list[_Leg] = []
    at, here, places = 0, values[0], []
    while here >= branches[at].high:
        at += 1
    for value in values:
        while not branches[at].low <= value < branches[at].high:
            up = value >= branches[at].high
            end = branches[at].high if up else branches[at].low
            legs.append(_Leg(branches[at], here, end))
            here, at = end, at + (1 if up else -1)
            while end >= branches[at].high if up else end < branches[at].low:
                at += 1 if up else -1
        legs.append(_Leg(branches[at], here, value))
        here = value
        places.append(at)
    return legs, places


def closed_loop(
    branches: Sequence[Branch], values: Sequence[float]
) -> tuple[list[int], dict[str, Any]]:
    """The branch at each of the approaches, and the quantities of :class:`Loop`."""
    legs, places = _legs(branches, values)
    pairs = list(pairwise(legs))
    jumps = []
    for one, other in pairs:
        if one.branch is not other.branch and not _continuous(one, other):
            jumps.append(
                exact(_JUMP, one.last).but(
                    of="in"
                    if branches.index(other.branch) > branches.index(one.branch)
                    else "out"
                )
            )
    begin = [
        one.last for one, other in pairs if other.branch.touching > one.branch.touching
    ]
    end = [
        k
        for k, (one, other) in enumerate(pairs)
        if other.branch.touching < one.branch.touching
    ]
    pull = max(-min(leg.branch.lowest(leg.first, leg.last) for leg in legs), 0.0)
    closed = values[0] == values[-1] and places[0] == places[-1]
    return places, {
        "jumps": tuple(jumps),
        "jump_in": exact(_JUMP_IN, begin[0])
        if begin
        else unknown(_JUMP_IN, _ELSEWHERE),
        "jump_out": exact(_JUMP_OUT, legs[end[-1]].last)
        if end
        else unknown(_JUMP_OUT, _ELSEWHERE),
        "pull_off": exact(_PULL_OFF, pull, "" if end else "not parted"),
        "work_of_separation": _separation(legs, end),
        "dissipated": exact(_DISSIPATED, sum(leg.work for leg in legs))
        if closed
        else unknown(_DISSIPATED, _OPEN),
    }


def _continuous(one: _Leg, other: _Leg) -> bool:
    """Whether the load is the same on both branches where they meet."""
    loads = [
        leg.branch.load(one.last) if leg.branch.load else 0.0 for leg in (one, other)
    ]
    return math.isclose(*loads, rel_tol=1e-6)


def _separation(legs: Sequence[_Leg], ends: Sequence[int]) -> Quantity:
    if not ends:
        return unknown(_SEPARATION, "not known: the path does not part the surfaces")
    work = sum(leg.work for leg in legs[ends[-1] + 1 :])
    for leg in reversed(legs[: ends[-1] + 1]):
        load = leg.branch.load
        if load is None or leg.first < leg.last:
            break
        if load(leg.first) < 0:
            work += leg.work
            continue
        from scipy.optimize import brentq

        free: Any = brentq(load, leg.last, leg.first, xtol=1e-15)
        return exact(_SEPARATION, work + leg.branch.work(free, leg.last))
    return unknown(
        _SEPARATION, "not known: the path does not pass a contact without load before"
    )


def loaded_loop(
    touching: Sequence[bool], loads: Sequence[float], pull: float, last: float
) -> dict[str, Any]:
    """The quantities of a path of loads in closed form, of surfaces that part at a ``pull`` (nN), at the approach
    ``last``."""
    parts = any(one > other for one, other in pairwise(touching))
    closed = (
        exact(_DISSIPATED, 0.0)
        if loads[0] == loads[-1]
        else unknown(_DISSIPATED, _OPEN)
    )
    borne = (
        max(-load for load, touches in zip(loads, touching, strict=True) if touches)
        if any(touching)
        else 0.0
    )
    return {
        "jump_in": unknown(_JUMP_IN, _FALLS),
        "jump_out": exact(_JUMP_OUT, last) if parts else unknown(_JUMP_OUT, _ELSEWHERE),
        "pull_off": exact(_PULL_OFF, pull)
        if parts
        else exact(_PULL_OFF, max(borne, 0.0), "not parted"),
        "work_of_separation": unknown(_SEPARATION, _FALLS),
        "dissipated": closed if all(touching) else unknown(_DISSIPATED, _FALLS),
    }


def wall_loop(
    states: Sequence[PathState], sunk: float, lost: float, error: float
) -> dict[str, Any]:
    """The quantities of a path of surfaces that do not adhere, of which the highest point has ``sunk`` (nm) at the end,
    and whose flow has ``lost`` so much energy (nN nm), with its standard ``error``."""
    one, other = states[0], states[-1]
    closed = one.area == other.area == 0 or (
        not lost and one.displacement == other.displacement
    )
    touches = [state.area > 0 for state in states]
    begins = (False, True) in pairwise(touches)
    ends = touches[-1:] == [False] and True in touches
    flow = (error, "gap left where the material flows")
    return {
        "jump_in": exact(_JUMP_IN, 0.0) if begins else unknown(_JUMP_IN, _ELSEWHERE),
        "jump_out": exact(_JUMP_OUT, sunk) if ends else unknown(_JUMP_OUT, _ELSEWHERE),
        "pull_off": exact(_PULL_OFF, 0.0, _NO_PULL),
        "work_of_separation": exact(_SEPARATION, 0.0, _NO_PULL),
        "dissipated": stated(_DISSIPATED, lost, iteration=flow)
        if closed
        else unknown(_DISSIPATED, _OPEN),
    }


# -- boundary elements ------------------------------------------------------------------------------------------------


def _excess(last: PathState, now: PathState) -> float:
    """What the work between two states is more than the gain in energy, nN nm: lost in a jump, or the error of the
    trapezium."""
    if not math.isfinite(now.displacement - last.displacement):
        return 0.0
    work = 0.5 * (now.load + last.load) * (now.displacement - last.displacement)
    return work - (now.energy - last.energy)


def _uncertain(last: PathState, now: PathState) -> float:
    """Largest error of the energy lost in a jump between two states."""
    step = now.displacement - last.displacement
    return 0.5 * abs((now.load - last.load) * step) if math.isfinite(step) else 0.0


def _dip(last: PathState, now: PathState) -> float:
    """How far the load sinks between two states below both, if it is a parabola of which the energy is the integral."""
    step = now.displacement - last.displacement
    depth = 1.5 * _excess(last, now) / step if step and math.isfinite(step) else 0.0
    rise = abs(now.load - last.load)
    return (4 * depth - rise) ** 2 / (16 * depth) if 4 * depth > rise else 0.0


def _changes(last: PathState, now: PathState) -> bool:
    """Whether contact begins or ends."""
    return (last.area > 0) != (now.area > 0)


@dataclass
class Follower:
    """Follows a path by ``solve(value, state before)``, in steps that it halves."""

    solve: Callable[[float, PathState | None], PathState]
    values: list[float] = field(default_factory=list)
    states: list[PathState] = field(default_factory=list)
    given: list[int] = field(default_factory=list)
    contacts: list[ContactSolution] = field(default_factory=list)
    resolution: float = 0.0
    #: energy that is not resolved anywhere, nN nm
    floor: float = 0.0
    #: the state of the largest pull, which is kept as a whole, and where it is
    lowest: PathState | None = None
    lowest_at: float = 0.0

    def follow(self, values: Sequence[float]) -> None:
        """Go on to each of the values."""
        if not self.states:
            self.resolution = RESOLUTION * (max(values) - min(values))
            deepest = self.solve(max(values), None)
            self.floor = ENERGY * FLOOR * deepest.attraction
        for value in values:
            self._reach(value)
            self.given.append(len(self.states) - 1)
            if (contact := self.states[-1].contact) is not None:
                self.contacts.append(contact)

    def _reach(self, value: float) -> None:
        last = self.states[-1] if self.states else None
        now = self.solve(value, last)
        if last is not None:
            width = abs(value - self.values[-1])
            if width > self.resolution and self._unclear(last, now, width):
                self._reach(0.5 * (value + self.values[-1]))
                return self._reach(value)
            self.states[-1] = last._replace(memory=None, contact=None)
        self.states.append(now)
        self.values.append(value)
        if self.lowest is None or now.load < self.lowest.load:
            self.lowest, self.lowest_at = now, value
        return None

    def _unclear(self, last: PathState, now: PathState, width: float) -> bool:
        if _changes(last, now) or min(
            abs(_excess(last, now)), _uncertain(last, now)
        ) > self._unresolved(last, now):
            return True
        lowest = (1 + FORCE) * min(0.0, now.load, *(one.load for one in self.states))
        # how far the pull goes on growing before a jump
        last_one = len(self.states) - 1
        further = (
            abs(self._slope(last_one, last_one - 1)) * width
            if self._is_large(last, now)
            else 0.0
        )
        return min(last.load - further, now.load, last.load) - _dip(last, now) < lowest

    def _unresolved(self, *states: PathState) -> float:
        """Energy that is not resolved between two states."""
        found = (max(one.attraction, ELASTIC * abs(one.energy)) for one in states)
        return max(self.floor, ENERGY * max(found))

    def _is_large(self, last: PathState, now: PathState) -> bool:
        """Whether energy is lost between two states, in a jump."""
        return _excess(last, now) > self._unresolved(last, now)

    def _jumps_after(self, k: int) -> bool:
        """Whether there is a jump between a state and the next one."""
        one, other = self.states[k : k + 2]
        return _changes(one, other) or self._is_large(one, other)

    def _slope(self, k: int, near: int) -> float:
        """Change of the load with what is given, between two neighbours; 0 where there is none, or a jump."""
        if not 0 <= near < len(self.states) or self.values[k] == self.values[near]:
            return 0.0
        if self._jumps_after(min(k, near)):
            return 0.0
        return (self.states[near].load - self.states[k].load) / (
            self.values[near] - self.values[k]
        )

    def quantities(self, control: str) -> dict[str, Any]:
        """Those of :class:`Loop`, with the error of the path."""
        return {
            "pull_off": self._pull_off(control),
            "jump_in": self._jump(_JUMP_IN, True, control),
            "jump_out": self._jump(_JUMP_OUT, False, control),
            "jumps": tuple(
                _between(_JUMP, one, other).but(
                    of="in" if other.load < one.load else "out"
                )
                for one, other in self._pairs()
                if self._is_large(one, other)
            ),
            "work_of_separation": self._separation(control),
            "dissipated": self._dissipated(control),
        }

    def _pairs(self) -> Iterator[tuple[PathState, PathState]]:
        return pairwise(self.states)

    def _jump(self, quantity: Quantity, begins: bool, control: str) -> Quantity:
        found = [
            pair
            for pair in self._pairs()
            if _changes(*pair) and (pair[1].area > 0) == begins
        ]
        if not found:
            return unknown(quantity, _ELSEWHERE)
        return (
            unknown(quantity, _FALLS)
            if control == "load"
            else _between(quantity, *found[0 if begins else -1])
        )

    def _pull_off(self, control: str) -> Quantity:
        loads = [state.load for state in self.states]
        k = int(np.argmin(loads))
        if not loads[k] < 0:
            return stated(_PULL_OFF, 0.0, path=(0.0, "no pull on this path"))
        pull, error = -loads[k], 0.0
        parted = any(
            _changes(one, other) and not other.area for one, other in self._pairs()
        )
        for near in (k - 1, k + 1):
            if not 0 <= near < len(loads):
                continue
            width, other = abs(self.values[near] - self.values[k]), self.states[near]
            if control == "load":
                if _changes(self.states[k], other):
                    pull, error = pull + 0.5 * width, error + 0.5 * width
            elif self._jumps_after(min(k, near)):
                error += abs(self._slope(k, 2 * k - near)) * width
            else:
                error += _dip(self.states[min(k, near)], self.states[max(k, near)])
        error = max(error, FORCE * pull)
        found = stated(_PULL_OFF, pull, path=(error / CERTAIN, "steps of the path"))
        return found if parted else found.but(reason="not parted")

    def _jumps(self) -> tuple[float, float]:
        """Energy lost in jumps, and its error."""
        lost = error = rest = 0.0
        for one, other in self._pairs():
            excess = _excess(one, other)
            if self._is_large(one, other):
                lost += excess
                error += _uncertain(one, other)
            else:
                rest += excess
        return lost, error + abs(rest)

    def _dissipated(self, control: str) -> Quantity:
        one, other = self.states[0], self.states[-1]
        if any(not math.isfinite(state.displacement) for state in self.states):
            return unknown(_DISSIPATED, _FALLS)
        allowed = ENERGY * max(state.attraction for state in self.states)
        if (
            self.values[0] != self.values[-1]
            or abs(other.energy - one.energy) > allowed
        ):
            return unknown(_DISSIPATED, _OPEN)
        lost, error = self._jumps()
        return stated(_DISSIPATED, lost, path=(error / CERTAIN, "steps of the path"))

    def _separation(self, control: str) -> Quantity:
        if control == "load":
            return unknown(_SEPARATION, _FALLS)
        ends = [
            k
            for k, pair in enumerate(self._pairs())
            if _changes(*pair) and not pair[1].area
        ]
        if not ends:
            return unknown(
                _SEPARATION, "not known: the path does not part the surfaces"
            )
        touching = range(ends[-1], -1, -1)
        free = next(
            (
                k
                for k in touching
                if self.states[k].load >= 0 or not self.states[k].area
            ),
            None,
        )
        if free is None or not self.states[free].area:
            return unknown(
                _SEPARATION,
                "not known: the path does not pass a contact without load before",
            )
        one, other, last = self.states[free], self.states[free + 1], self.states[-1]
        part = (
            one.load / (one.load - other.load) * (other.displacement - one.displacement)
        )
        rest = replace(self, values=self.values[free:], states=self.states[free:])
        lost, error = rest._jumps()
        work = last.energy - one.energy - 0.5 * one.load * part + lost
        return stated(_SEPARATION, work, path=(error / CERTAIN, "steps of the path"))


def _between(quantity: Quantity, one: PathState, other: PathState) -> Quantity:
    """The approach between two states."""
    middle, width = (
        0.5 * (one.displacement + other.displacement),
        abs(other.displacement - one.displacement),
    )
    return stated(quantity, middle, path=(0.5 * width / CERTAIN, "steps of the path"))
