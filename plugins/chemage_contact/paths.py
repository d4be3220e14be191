"""Paths of a contact: loads or approaches in the order given, and what a contact makes of them that remembers.

A path begins with surfaces that are apart. A solver of spheres in closed form follows it along its branches; the
boundary elements halve their steps until each is either smooth or a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Literal, NamedTuple

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

_QUANTITIES = {
    name: Quantity(name, unit, label, meaning=meaning)
    for name, unit, label, meaning in (
        ("pull_off", "nN", "pull-off force", "largest pull"),
        ("jump_in", "nm", "approach at which contact begins", ""),
        ("jump_out", "nm", "approach at which contact ends", ""),
        ("jump", "nm", "approach at a jump", ""),
        (
            "work_of_separation",
            "nN nm",
            "work of separation",
            "work of the last separation, from no load to the end of the path",
        ),
        ("dissipated", "nN nm", "dissipated energy", "work on a closed path"),
    )
}
_OPEN = "not known: the path does not end in the state in which it began"
_FALLS = "not known: under a given load the surfaces fall together or apart; give approaches"
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
        return cls(
            displacement, load, area, np.array(given, np.int64), **quantities
        )

    def quantities(self) -> list[Quantity]:
        """All but the single jumps."""
        return [getattr(self, name) for name in _QUANTITIES if name != "jump"]

    def __str__(self) -> str:
        return "\n".join(": ".join(one.row()) for one in self.quantities())


def stated(name: str, value: float, **errors: tuple[float, str]) -> Quantity:
    """With ``value`` and the parts of its error: cause -> (standard error, how it is known)."""
    parts = {cause: ErrorPart(*part) for cause, part in errors.items()}
    total = math.hypot(*(part.size for part in parts.values()))
    return (
        _QUANTITIES[name]
        .but(value=value, errors=parts)
        .between(statistics.NORMAL_LIMIT * total, total)
    )


def more_errors(quantity: Quantity, **errors: tuple[float, str]) -> Quantity:
    """With further parts of its error; without an interval where one is not known."""
    if not quantity.known:
        return quantity
    parts: dict[str, Any] = {**quantity.errors, **errors}
    found = stated(quantity.name, quantity.value, **parts).but(
        reason=quantity.reason
    )
    return found if math.isfinite(found.half_width) else found.but(stated="")


def finer(surface: Surface) -> Surface:
    """The surface on pixels of half the size: the same waves if it repeats, else cubic splines."""
    from scipy.interpolate import make_interp_spline

    heights = surface.heights
    for axis, n in enumerate(surface.shape):
        if surface.periodic:
            waves = np.fft.rfft(heights, axis=axis)
            heights = 2 * np.fft.irfft(waves, 2 * n, axis=axis)
        else:
            spline = make_interp_spline(
                np.arange(n), heights, min(3, n - 1), axis=axis
            )
            heights = spline(0.5 * np.arange(2 * n) - 0.25)
    return Surface(
        heights=heights,
        pixel_size=surface.pixel_size / 2,
        periodic=surface.periodic,
        provenance=surface.provenance,
    )


#: a value of which only rounding is wrong, why there is none, a value and what to say of it, or with its errors
_Found = float | str | tuple[float, str] | Quantity


def exact(**found: _Found) -> dict[str, Any]:
    """The quantities of closed forms by name."""
    made: dict[str, Any] = {}
    for name, value in found.items():
        if isinstance(value, str):
            value = _QUANTITIES[name].but(reason=value)
        elif not isinstance(value, Quantity):
            value, reason = value if isinstance(value, tuple) else (value, "")
            value = stated(name, value + 0.0, path=(0.0, Leg.how)).but(
                reason=reason
            )
        made[name] = value
    return made


@dataclass(frozen=True)
class Step:
    """From a state on a path to the next: smooth, or a jump."""

    one: PathState
    other: PathState
    #: energy that is not resolved anywhere, nN nm
    floor: float = 0.0
    how: ClassVar[str] = "steps of the path"

    @property
    def change(self) -> int:
        """1 where contact begins, -1 where it ends, else 0."""
        return (self.other.area > 0) - (self.one.area > 0)

    @property
    def length(self) -> float:
        """Change of the approach, nm; not finite to or from apart under a given load."""
        return self.other.displacement - self.one.displacement

    @property
    def gain(self) -> float:
        """Of the energy, nN nm."""
        return self.other.energy - self.one.energy

    @property
    def excess(self) -> float:
        """What the work is more than the gain in energy, nN nm: lost in a jump, or the error of the trapezium."""
        if not math.isfinite(self.length):
            return 0.0
        return 0.5 * (self.other.load + self.one.load) * self.length - self.gain

    @property
    def uncertain(self) -> float:
        """Largest error of the energy lost in a jump."""
        return 0.5 * abs((self.other.load - self.one.load) * self.length)

    @property
    def dip(self) -> float:
        """How far the load sinks below both, if it is a parabola of which the energy is the integral."""
        depth = 1.5 * self.excess / self.length if self.length else 0.0
        rise = abs(self.other.load - self.one.load)
        return (4 * depth - rise) ** 2 / (16 * depth) if 4 * depth > rise else 0.0

    @property
    def unresolved(self) -> float:
        """Energy that is not resolved."""
        ends = (self.one, self.other)
        found = (max(end.attraction, ELASTIC * abs(end.energy)) for end in ends)
        return max(self.floor, ENERGY * max(found))

    @property
    def jumps(self) -> bool:
        """Whether energy is lost, in a jump."""
        return self.excess > self.unresolved

    @property
    def lost(self) -> float:
        """Energy lost, nN nm."""
        return self.excess if self.jumps else 0.0

    @property
    def work(self) -> float:
        """Work done, nN nm."""
        return self.gain + self.lost

    @property
    def unloaded(self) -> float:
        """That from where the load vanishes."""
        part = self.one.load / (self.one.load - self.other.load) * self.length
        return self.work - 0.5 * self.one.load * part

    def place(self, name: str) -> Quantity:
        """Its approach."""
        middle = 0.5 * (self.one.displacement + self.other.displacement)
        return stated(
            name, middle, path=(0.5 * abs(self.length) / CERTAIN, self.how)
        )


def _energy(name: str, value: float, steps: Sequence[Step]) -> Quantity:
    """With the error of what is lost in ``steps``."""
    summed = [step for step in steps if not isinstance(step, Leg)]
    error = sum(step.uncertain for step in summed if step.jumps)
    error += abs(sum(step.excess for step in summed if not step.jumps))
    return stated(name, value, path=(error / CERTAIN, steps[0].how))


def quantities(
    steps: Sequence[Step], pull_off: Quantity, *, open: str, by_load: bool = False
) -> dict[str, Any]:
    """Those of :class:`Loop`, of surfaces that adhere; ``open``: why it is not known what is dissipated, or ""."""
    begins, ends = (
        [k for k, s in enumerate(steps) if s.change == one] for one in (1, -1)
    )

    def place(name: str, found: Sequence[int]) -> _Found:
        if not found:
            return _ELSEWHERE
        return _FALLS if by_load else steps[found[0]].place(name)

    lost = sum(step.lost for step in steps)
    jumps = (step for step in steps if step.jumps)
    return exact(
        pull_off=pull_off if ends else pull_off.but(reason="not parted"),
        jump_in=place("jump_in", begins),
        jump_out=place("jump_out", ends[-1:]),
        work_of_separation=_FALLS if by_load else _separation(steps, ends),
        dissipated=open or _energy("dissipated", lost, steps),
    ) | {
        "jumps": tuple(
            step.place("jump").but(
                of="in" if step.other.load < step.one.load else "out"
            )
            for step in jumps
        )
    }


def _separation(steps: Sequence[Step], ends: Sequence[int]) -> _Found:
    """The work from the last contact without load before the surfaces part in the last of the steps ``ends``."""
    if not ends:
        return "not known: the path does not part the surfaces"
    free = ends[-1]
    while free and steps[free].one.load < 0 and steps[free].one.area:
        free -= 1
    if steps[free].one.load < 0 or not steps[free].one.area:
        return "not known: the path does not pass a contact without load before"
    first, *rest = steps[free:]
    work = first.unloaded + sum(step.work for step in rest)
    return _energy("work_of_separation", work, steps[free:])


# -- closed forms -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SphereState:
    """A sphere in contact: force (nN), radius of the contact and of the zone around it in which there is attraction,
    and approach since first touch (nm)."""

    load: float
    edge: float
    outer: float
    displacement: float


class Branch(NamedTuple):
    """The equilibria of a sphere between two approaches, in the order from apart to contact."""

    low: float
    high: float
    #: the sphere at an approach; None: nothing acts
    at: Callable[[float], SphereState] | None = None
    #: approach of the least load
    least: float = math.nan
    touching: bool = False

    def state(self, at: float) -> SphereState:
        """At an approach."""
        return self.at(at) if self.at else SphereState(0.0, 0.0, 0.0, at)

    def load(self, at: float) -> float:
        """At an approach, nN."""
        return self.state(at).load

    def place(self, at: float) -> PathState:
        """At an approach, the area being only whether the surfaces touch."""
        state = self.state(at)
        return PathState(at, state.load, self.touching)

    def work(self, first: float, last: float) -> float:
        """∫F dδ. In the root of the distance to the end of the branch, where the load has an infinite slope."""
        from scipy.integrate import quad

        load = self.load
        if self.at is None or first == last:
            return 0.0
        low = self.low
        begin, end = (math.sqrt(max(at - low, 0.0)) for at in (first, last))
        found: Any = quad(
            lambda t: 2 * t * load(low + t * t),
            begin,
            end,
            epsabs=0.0,
            epsrel=1e-11,
        )
        return found[0]

    def lowest(self, first: float, last: float) -> float:
        """The least load between two approaches."""
        ends = [first, last]
        if min(ends) < self.least < max(ends):
            ends.append(self.least)
        return min(map(self.load, ends))


@dataclass(frozen=True)
class Leg(Step):
    """A step in closed form: along one branch, or between two of them."""

    branch: Branch | None = None
    how = "closed form"

    @classmethod
    def along(cls, branch: Branch, first: float, last: float) -> Leg:
        """On a branch, between two approaches."""
        return cls(branch.place(first), branch.place(last), branch=branch)

    @property
    def jumps(self) -> bool:
        loads = self.one.load, self.other.load
        return self.branch is None and not math.isclose(*loads, rel_tol=1e-6)

    @property
    def work(self) -> float:
        ends = self.one.displacement, self.other.displacement
        return self.branch.work(*ends) if self.branch else 0.0

    @property
    def lost(self) -> float:
        """On a closed path."""
        return self.work

    @property
    def unloaded(self) -> float:
        from scipy.optimize import brentq

        branch, last = self.branch, self.other.displacement
        if branch is None:
            return 0.0
        free: Any = brentq(branch.load, last, self.one.displacement, xtol=1e-15)
        return branch.work(free, last)


def closed_loop(
    branches: Sequence[Branch], values: Sequence[float]
) -> tuple[list[SphereState], dict[str, Any]]:
    """The sphere at each of the approaches, and the quantities of :class:`Loop`."""
    legs: list[Leg] = []
    at, here, places = 0, values[0], []
    while here >= branches[at].high:
        at += 1
    for value in values:
        while not (one := branches[at]).low <= value < one.high:
            up = value >= one.high
            end = one.high if up else one.low
            legs.append(Leg.along(one, here, end))
            at += 1 if up else -1
            while end >= branches[at].high if up else end < branches[at].low:
                at += 1 if up else -1
            legs.append(Leg(one.place(end), branches[at].place(end)))
            here = end
        legs.append(Leg.along(branches[at], here, value))
        here = value
        places.append(branches[at])
    pull = max(
        -leg.branch.lowest(leg.one.displacement, leg.other.displacement)
        for leg in legs
        if leg.branch
    )
    closed = values[0] == values[-1] and places[0] is places[-1]
    found = exact(pull_off=max(pull, 0.0))["pull_off"]
    states = [branch.state(at) for branch, at in zip(places, values, strict=True)]
    return states, quantities(legs, found, open="" if closed else _OPEN)


def loaded_loop(
    states: Sequence[SphereState], loads: Sequence[float], pull: float, last: float
) -> dict[str, Any]:
    """The quantities of a path of loads in closed form, of surfaces that part at a ``pull`` (nN), at the approach
    ``last``."""
    touching = [state.edge > 0 for state in states]
    parts = any(one > other for one, other in pairwise(touching))
    closed = 0.0 if loads[0] == loads[-1] else _OPEN
    return exact(
        jump_in=_FALLS,
        jump_out=last if parts else _ELSEWHERE,
        # of surfaces that are apart it is 0
        pull_off=pull
        if parts
        else (max(0.0, *(-state.load for state in states)), "not parted"),
        work_of_separation=_FALLS,
        dissipated=closed if all(touching) else _FALLS,
    )


def wall_loop(
    states: Sequence[PathState], sunk: float, lost: float, error: float
) -> dict[str, Any]:
    """The quantities of a path of surfaces that do not adhere, of which the highest point has ``sunk`` (nm) at the end,
    and whose flow has ``lost`` so much energy (nN nm), with its standard ``error``."""
    one, other = states[0], states[-1]
    closed = one.area == other.area == 0 or (
        not lost and one.displacement == other.displacement
    )
    begins = any(Step(*pair).change > 0 for pair in pairwise(states))
    ends = not other.area and any(state.area for state in states)
    flow = (error, "gap left where the material flows")
    return exact(
        jump_in=0.0 if begins else _ELSEWHERE,
        jump_out=sunk if ends else _ELSEWHERE,
        pull_off=(0.0, _NO_PULL),
        work_of_separation=(0.0, _NO_PULL),
        dissipated=stated("dissipated", lost, iteration=flow) if closed else _OPEN,
    )


# -- boundary elements ------------------------------------------------------------------------------------------------


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
            step = Step(last, now, self.floor)
            if width > self.resolution and self._unclear(step, width):
                self._reach(0.5 * (value + self.values[-1]))
                return self._reach(value)
            self.states[-1] = last._replace(memory=None, contact=None)
        self.states.append(now)
        self.values.append(value)
        return None

    def _unclear(self, step: Step, width: float) -> bool:
        lost = min(abs(step.excess), step.uncertain)
        if step.change or lost > step.unresolved:
            return True
        loads = step.one.load, step.other.load
        lowest = (1 + FORCE) * min(0.0, *loads, *(one.load for one in self.states))
        # how far the pull goes on growing before a jump
        last = len(self.states) - 1
        further = abs(self._slope(last, last - 1)) * width if step.jumps else 0.0
        return min(step.one.load - further, *loads) - step.dip < lowest

    def _step(self, k: int) -> Step:
        return Step(self.states[k], self.states[k + 1], self.floor)

    def _slope(self, k: int, near: int) -> float:
        """Change of the load with what is given, between two neighbours; 0 where there is none, or a jump."""
        if not 0 <= near < len(self.states) or self.values[k] == self.values[near]:
            return 0.0
        step = self._step(min(k, near))
        if step.change or step.jumps:
            return 0.0
        return (self.states[near].load - self.states[k].load) / (
            self.values[near] - self.values[k]
        )

    def quantities(self, control: str) -> dict[str, Any]:
        """Those of :class:`Loop`, with the error of the path."""
        one, other = self.states[0], self.states[-1]
        allowed = ENERGY * max(state.attraction for state in self.states)
        closed = self.values[0] == self.values[-1]
        why = "" if closed and abs(other.energy - one.energy) <= allowed else _OPEN
        if not all(math.isfinite(state.displacement) for state in self.states):
            why = _FALLS
        steps = [self._step(k) for k in range(len(self.states) - 1)]
        pull = self._pull_off(control)
        return quantities(steps, pull, open=why, by_load=control == "load")

    def _pull_off(self, control: str) -> Quantity:
        loads = [state.load for state in self.states]
        k = int(np.argmin(loads))
        if not loads[k] < 0:
            return stated("pull_off", 0.0, path=(0.0, "no pull on this path"))
        pull, error = -loads[k], 0.0
        for near in (k - 1, k + 1):
            if not 0 <= near < len(loads):
                continue
            width = abs(self.values[near] - self.values[k])
            step = self._step(min(k, near))
            if control == "load":
                if step.change:
                    pull, error = pull + 0.5 * width, error + 0.5 * width
            elif step.change or step.jumps:
                error += abs(self._slope(k, 2 * k - near)) * width
            else:
                error += step.dip
        error = max(error, FORCE * pull)
        return stated("pull_off", pull, path=(error / CERTAIN, Step.how))
