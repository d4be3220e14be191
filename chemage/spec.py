"""A choice is one frozen class: its fields are its options, ``kind`` is its name, one method does the work.

The abstract classes below are the roles a choice can fill. A plugin subclasses one of them, gives it a ``kind``,
declares its options as pydantic fields (with units from :mod:`chemage.units`) and writes the one method. A method
never changes meaning; arguments are only ever added.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)

from chemage.errors import InputError

if TYPE_CHECKING:
    from os import PathLike

    from chemage.objects import BondHistory, ContactSolution, ReactionLattice, Surface

Seed = int | np.random.SeedSequence
_IDENTITY = {"chemage": "identity"}


def explain(error: ValidationError, prefix: str = "") -> list[tuple[str, str]]:
    """Pydantic's error as ``(path, message)`` pairs in plain words."""
    problems = []
    for item in error.errors(include_url=False):
        path = ".".join(str(part) for part in (*([prefix] if prefix else []), *item["loc"]))
        message = item["msg"].removeprefix("Value error, ")
        value = item.get("input")
        if item["type"] == "extra_forbidden":
            message = "no such option"
        elif item["type"] == "missing":
            message = "is required"
        elif isinstance(value, int | float | str | bool):
            # many messages begin with the value already; that 0 is in "greater than 0" does not count
            said = message.startswith((repr(value), f'"{value}"'))
            message = message if said else f"{value!r}: {message}"
        problems.append((path, message))
    return problems


def nearest(word: str, known: Sequence[str]) -> str:
    """``" (did you mean 'x'?)"`` when a known word is close, else nothing."""
    import difflib

    match = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" (did you mean {match[0]!r}?)" if match else ""


class Spec(BaseModel):
    """Frozen, validated options of one choice. Equal options mean equal objects and equal :meth:`digest`."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, use_attribute_docstrings=True)

    role: ClassVar[str] = ""
    #: the name users give this choice in a scene
    kind: ClassVar[str] = ""
    #: what to cite when a result used this choice
    cite: ClassVar[tuple[str, ...]] = ()
    #: options that change how fast an answer comes and never the answer, such as a number of threads: no part of
    #: :meth:`digest`, nor of the keys by which a sweep knows what it has computed
    speed_only: ClassVar[tuple[str, ...]] = ()
    #: option -> values from fast to accurate, which ``chemage tradeoff`` tries
    trade: ClassVar[Mapping[str, tuple[Any, ...]]] = {}

    def __init__(self, /, **options: Any) -> None:
        try:
            super().__init__(**options)
        except ValidationError as error:
            known = list(type(self).model_fields)
            problems = []
            for path, message in explain(error):
                if message == "no such option":
                    message = f"no such option{nearest(path, known)}; the options are {', '.join(known) or 'none'}"
                problems.append((path, message))
            name = f"{self.role} {self.kind!r}" if self.kind else type(self).__name__
            lines = [f"{path}: {message}" if path else message for path, message in problems]
            raise InputError(f"{name}: " + "; ".join(lines), problems) from None

    @model_serializer(mode="wrap")
    def _with_kind(self, handler: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        fields = handler(self)
        if self.speed_only and info.context is _IDENTITY:
            fields = {name: value for name, value in fields.items() if name not in self.speed_only}
        # a choice inside a choice must keep its kind too: without it two chemistries would have one digest
        return {"kind": self.kind, **fields} if self.kind else fields

    def __eq__(self, other: object) -> bool:
        # by options alone: pydantic would compare what a class keeps in private attributes as well
        return type(other) is type(self) and all(
            getattr(self, name) == getattr(other, name) for name in type(self).model_fields
        )

    def __hash__(self) -> int:
        return hash((type(self), *(getattr(self, name) for name in type(self).model_fields)))

    def todict(self) -> dict[str, Any]:
        """``{"kind": ..., option: value}`` of plain JSON values; :meth:`fromdict` reads it back."""
        return self.model_dump(mode="json")

    def identity(self) -> dict[str, Any]:
        """What decides the answer: :meth:`todict` without the options that only change the speed."""
        return self.model_dump(mode="json", context=_IDENTITY)

    @classmethod
    def fromdict(cls, fields: Mapping[str, Any]) -> Self:
        """The inverse of :meth:`todict`; :func:`chemage.fromdict` finds the class by its kind as well."""
        options = dict(fields)
        kind = options.pop("kind", cls.kind)
        if kind != cls.kind:
            raise InputError.of("kind", kind, f"these are not the options of {cls.role or cls.__name__} {cls.kind!r}")
        return cls(**options)

    def digest(self) -> str:
        """Content hash of kind and options (see :attr:`speed_only`), the same in every process."""
        text = json.dumps({"role": self.role, **self.identity()}, sort_keys=True)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def replace(self, **changes: Any) -> Self:
        """A copy with some options changed, validated again."""
        options = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**options, **changes})


class SurfaceMaker(Spec, ABC):
    """Role ``surface``: makes the rough body."""

    role = "surface"

    @abstractmethod
    def make(self, seed: Seed = 0) -> Surface:
        """The surface. The same seed gives the same bytes; a deterministic maker ignores it."""

    def expected(self) -> dict[str, float]:
        """What is known before anything is computed, as far as it is: ``nx``, ``ny`` (pixels), ``pixel_size`` (nm),
        ``rms_slope``, ``shortest_wavelength`` (nm). Used by ``chemage check``."""
        return {}

    def coarser(self, factor: int) -> Self | None:
        """A maker of the same surface at the same size on pixels ``factor`` times larger; None where there is none."""
        return None


class ContactSolver(Spec, ABC):
    """Role ``contact``: presses a surface against an elastic half-space."""

    role = "contact"
    #: what a solution of this solver carries
    implemented_properties: ClassVar[tuple[str, ...]] = ("pressure",)

    @abstractmethod
    def _solve(self, surface: Surface, load: float, start: ContactSolution | None) -> ContactSolution:
        """Solve for ``load`` in nN (finite, ≥ 0). ``start`` is a neighbouring solution to begin from, or None."""

    def expected(self, surface: Mapping[str, float], load: float) -> dict[str, float]:
        """What a solve will give and cost, estimated from :meth:`SurfaceMaker.expected`, as far as it can be told:
        ``area_fraction``, ``cpu_seconds``, ``bytes`` (peak memory). Used by ``chemage check``."""
        return {}

    def solve(self, surface: Surface, load: float | str, *, start: ContactSolution | None = None) -> ContactSolution:
        """The contact of ``surface`` under ``load`` (nN, or a string with its unit).

        Raises
        ------
        InputError
            The load is negative or not finite, or the solver cannot treat this surface.
        ConvergenceError
            The tolerance was not reached.
        """
        return self._solve(surface, force(load), start)


class Barriers(Spec, ABC):
    """Role ``barriers``: a distribution of energy barriers.

    It is given as its quantile function, so that every pixel's barrier is a pure function of the pixel's own uniform
    number: the same pixel keeps its barrier rank when load, temperature or the distribution change.
    """

    role = "barriers"

    @abstractmethod
    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        """Barriers in eV at ``uniform`` numbers in (0, 1); same shape, non-decreasing."""

    @abstractmethod
    def density(self, energy: np.ndarray) -> np.ndarray:
        """Probability density in 1/eV at ``energy`` in eV; same shape. A point mass has density ``inf`` there."""


class Interaction(Spec, ABC):
    """Role ``interaction``: which sites feel each other, and how strongly."""

    role = "interaction"

    @abstractmethod
    def neighbours(self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray) -> np.ndarray:
        """The graph: (n, k) int32, entry ``[i, s]`` the position in ``sites`` of a neighbour of ``i``, or -1.

        It depends on geometry alone, so replicas share it. ``sites`` are sorted flat pixel indices, (n,) int64.
        """

    @abstractmethod
    def coupling(self, sites: np.ndarray, neighbours: np.ndarray, seed: Seed) -> np.ndarray:
        """What a bonded neighbour adds to a site's forming barrier, (n, k) eV, symmetric, 0 where there is none."""


class Engine(Spec, ABC):
    """Role ``engine``: follows bonds forming and breaking on a graph; knows neither surface nor chemistry."""

    role = "engine"
    #: treats lattices whose sites interact
    interacting: ClassVar[bool] = True
    #: can use several threads inside one run
    threads: ClassVar[bool] = False
    #: can go on from a history bit for bit
    restart: ClassVar[bool] = True
    #: samples the master equation without approximation
    exact: ClassVar[bool] = True

    def concurrency(self) -> int:
        """Threads that one run of this very choice uses; replicas run side by side on what is left."""
        return 1

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """What a replica will cost at room temperature, as far as it can be told: ``cpu_seconds``, ``bytes``."""
        return {}

    @abstractmethod
    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        """Run on validated input: ``hold_times`` (m,) s non-decreasing ≥ 0, ``temperature`` K > 0,
        ``start`` None (nothing bonded), (n,) bool, or a history whose lattice has the same number of sites."""

    def run(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | np.ndarray,
        *,
        temperature: float | str,
        seed: Seed = 0,
        start: BondHistory | np.ndarray | None = None,
    ) -> BondHistory:
        """Follow the bonds on ``lattice`` to each hold time.

        Parameters
        ----------
        lattice
            Sites, barriers and couplings.
        hold_times
            (m,) seconds, non-decreasing, ≥ 0; m ≥ 1. The state at each is the one just after the last event before it.
        temperature
            Kelvin, or a string with its unit.
        seed
            An int or a ``numpy.random.SeedSequence``; the same seed gives the same bytes.
        start
            None (nothing bonded at time 0), a bool array (n,), or a finished history to go on from. Going on with the
            same lattice, temperature and seed equals the uninterrupted run bit for bit where ``restart`` is true.

        Raises
        ------
        InputError
            Naming the argument that is wrong.
        """
        from chemage.objects import BondHistory

        times = check_times(hold_times)
        kelvin = temperature_value(temperature)
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        if isinstance(start, BondHistory):
            if start.state.size != lattice.sites.size:
                raise InputError.of(
                    "start",
                    f"a history of {start.state.size} sites",
                    f"the lattice has {lattice.sites.size}",
                    "go on with the lattice it came from",
                )
            if times[0] < start.time:
                raise InputError.of(
                    "hold_times",
                    float(times[0]),
                    f"the history to go on from ends at {start.time} s",
                    "give later hold times",
                )
        elif start is not None:
            start = np.asarray(start)
            if start.shape != lattice.sites.shape or start.dtype != np.bool_:
                raise InputError.of(
                    "start",
                    f"{start.dtype} array of shape {start.shape}",
                    f"expected bool of shape {lattice.sites.shape}",
                    "one entry a site, True = bonded",
                )
        if not self.interacting and lattice.interacting:
            raise InputError(
                f"engine {self.kind!r} treats sites that do not interact, but this lattice couples neighbours; "
                "leave out the interaction, or use another engine (for example 'rejection-free')"
            )
        return self._run(lattice, times, kelvin, seed, start)


class Observable(Spec, ABC):
    """Role ``observable``: further numbers to take from each replica."""

    role = "observable"

    @abstractmethod
    def measure(
        self, contact: ContactSolution, lattice: ReactionLattice, history: BondHistory
    ) -> Mapping[str, float | np.ndarray]:
        """Named numbers or arrays, the same names and shapes for every replica."""


class Reader(Spec, ABC):
    """Role ``reader``: reads a file format into a Surface or another chemage object."""

    role = "reader"
    #: file name endings this reader answers to, with the dot
    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def read(self, path: str | PathLike[str]) -> Any:
        """The object in the file."""


ROLES: dict[str, type[Spec]] = {
    cls.role: cls for cls in (SurfaceMaker, ContactSolver, Barriers, Interaction, Engine, Observable, Reader)
}


def force(load: float | str) -> float:
    """``load`` in nN, finite and ≥ 0."""
    from chemage.units import convert

    value = convert(load, "nN")
    if not np.isfinite(value) or value < 0:
        raise InputError.of("load", load, "must be finite and not negative", "give a force such as 20 uN")
    return value


def temperature_value(temperature: float | str) -> float:
    """``temperature`` in K, finite and > 0."""
    from chemage.units import convert

    value = convert(temperature, "K")
    if not np.isfinite(value) or value <= 0:
        raise InputError.of("temperature", temperature, "must be finite and above zero", "give kelvin, such as 300 K")
    return value


def checked_seed(seed: Any) -> int:
    """``seed`` as a non-negative int."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError.of("seed", seed, "must be a whole number, 0 or larger")
    return int(seed)


def check_times(hold_times: Sequence[float] | np.ndarray) -> np.ndarray:
    """``hold_times`` as (m,) float64, non-decreasing, finite, ≥ 0, m ≥ 1."""
    try:
        times = np.array(hold_times, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise InputError.of("hold_times", hold_times, "not a list of numbers", "give seconds") from None
    if times.ndim != 1 or times.size == 0:
        raise InputError.of("hold_times", times.shape, "must be a list with at least one time", "give seconds")
    bad = np.flatnonzero(~np.isfinite(times) | (times < 0))
    if bad.size:
        raise InputError.of(
            f"hold_times[{bad[0]}]",
            float(times[bad[0]]),
            "must be finite and not negative",
            "give seconds since the contact was made",
        )
    falls = np.flatnonzero(np.diff(times) < 0)
    if falls.size:
        at = int(falls[0]) + 1
        raise InputError.of(
            f"hold_times[{at}]", float(times[at]), f"comes after {float(times[at - 1])}", "sort the hold times"
        )
    return times
