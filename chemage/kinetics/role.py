"""The role that follows bonds in time, and the fourth stage: an engine follows those of one replica."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import (
    Seed,
    check_times,
    checked_seed,
    expect,
    temperature_value,
)
from chemage.foundation.components import Component, takes
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import recording
from chemage.foundation.units import QuantityLike
from chemage.kinetics.history import BondHistory, checked_start
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.sources import approximation_of, noted


@dataclass(frozen=True)
class Ramp:
    """What the conditions of a run become until its last hold time, linearly in time from those that it begins with.

    Temperature and barriers change at once: a site has the rate ν exp(−E(t)/k_B T(t)).
    """

    temperature: QuantityLike | None = None
    """K, or text with its unit; None: as at the beginning"""
    lattice: ReactionLattice | None = None
    """the same sites with other barriers; None: as at the beginning"""
    speed: float | None = None
    """nm/s, of the drive that pulls; None: as at the beginning"""

    def checked(
        self,
        lattice: ReactionLattice,
        temperature: float,
        speed: float | None = None,
    ) -> Ramp:
        """The ramp with temperature (K), lattice and speed, for a run on ``lattice`` that begins with a drive of this
        ``speed`` (nm/s), or none.

        Raises
        ------
        InputError
            Its lattice has other sites or couplings, or bonds that last on one of the two alone; its speed is negative,
            or nothing pulls.
        """
        if self.speed is not None:
            if speed is None or not 0 <= self.speed < np.inf:
                problem = "give one from 0 nm/s on, and to a pull alone"
                raise InputError(f"ramp.speed: {self.speed}; {problem}")
            speed = self.speed
        end = lattice if self.lattice is None else self.lattice
        expect("ramp.lattice", end, ReactionLattice, "give one with the same sites")
        if (end.breaking is None) != (lattice.breaking is None) or any(
            not np.array_equal(getattr(end, name), getattr(lattice, name))
            for name in (
                "sites",
                "neighbours",
                "coupling",
                "attempt_frequency",
                "states",
                "transitions",
                "transition_barriers",
                "transition_terms",
            )
        ):
            problem = "has other sites, couplings or attempt frequency"
            raise InputError.of(
                "ramp.lattice", end, problem, "change barriers alone"
            )
        kelvin = temperature
        if self.temperature is not None:
            kelvin = temperature_value(self.temperature)
        return Ramp(kelvin, end, speed)


class Engine(Component, ABC):
    """Role ``engine``: follows bonds forming and breaking on a graph; knows neither surface nor chemistry."""

    role = "engine"
    #: of an approximate engine (``exact = False``), the ``declared_error`` is this, and the checks hold it to that
    error_of = "the mean number of bonds"
    # not annotated for type checkers, so that a class can make them properties
    if TYPE_CHECKING:
        interacting = True
        restart = True
    else:
        #: treats lattices whose sites interact
        interacting: ClassVar[bool] = True
        #: can resume from a history bit for bit
        restart: ClassVar[bool] = True
    #: follows sites of more states than free and bonded
    many_states: ClassVar[bool] = False

    def concurrency(self) -> int:
        """Threads that one run with these options uses; concurrent replicas share what is left."""
        return 1

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """Estimate the cost of one replica, as far as it is known: ``cpu_seconds``, ``bytes``.

        Where the time cannot be known to a factor of 2, ``cpu_seconds_least`` and ``cpu_seconds_most`` are stated as
        well, and the plan states that range. A component may add ``events=None``, and chemage then passes the number of
        bonds formed and broken per site that is expected at the scene's temperature and hold time, or None if it is not
        known.
        """
        return {}

    def check(self, interacting: bool) -> Sequence[str] | None:
        """Refuse, before anything is computed, lattices that :meth:`run` would refuse; return doubts as sentences.

        Raises
        ------
        InputError
            The engine treats sites that do not interact, and these do.
        """
        if interacting and not self.interacting:
            raise InputError(
                f"engine {self.kind!r} treats sites that do not interact, but this lattice couples neighbours; "
                "leave out the interaction, or use another engine (for example 'rejection-free')"
            )

    def check_states(self, states: Sequence[str] | None) -> None:
        """Raise an InputError where sites have more states than the engine follows."""
        if states is not None and not self.many_states:
            raise InputError(
                f"engine {self.kind!r} follows sites that are free or bonded, but these are {', '.join(states)}; "
                "leave out the transitions, or use an engine for more states"
            )

    def warm_up(self, lattice: ReactionLattice, temperature: float) -> None:
        """Compile what :meth:`run` will need at ``temperature`` K on a lattice like ``lattice``, which is small: it has
        neighbours and breaking barriers if the lattice of the run has them.

        Default: run to a hold time of zero. Override it if that does not compile everything, or does more than that. In
        the first run after an installation, a second process calls it while the contact is solved; whatever it raises
        there is ignored.
        """
        self.run(lattice, [0.0], temperature=temperature)

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
        ``start`` None (nothing bonded), (n,) bool, or a history whose lattice has the same number of sites.

        An engine that follows ramps adds ``ramp=None``: a :class:`Ramp` as :meth:`Ramp.checked` gives it.
        """

    def run(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | np.ndarray,
        *,
        temperature: QuantityLike,
        seed: Seed = 0,
        start: BondHistory | np.ndarray | None = None,
        ramp: Ramp | None = None,
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
            An int or a ``numpy.random.SeedSequence``; the same seed gives the same bytes. The built-in engines hash it
            with the lattice, so that one seed gives independent noise on different lattices; they use a
            ``chemage.plugin.random.CommonSeed`` as it is.
        start
            None (nothing bonded at time 0), a bool array (n,), or a finished history to resume from. Resuming with the
            same lattice, temperature and seed equals the uninterrupted run bit for bit where ``restart`` is true; with
            others, or after a pull, it takes random numbers that no step before has used. An array begins a new run.
        ramp
            What temperature and barriers become by the last hold time; None: they stay.

        Raises
        ------
        InputError
            Naming the argument that is wrong.
        """
        times, kelvin, start = self.checked(lattice, hold_times, temperature, start)
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        how = {}
        if ramp is not None:
            how["ramp"] = ramp.checked(lattice, kelvin)
            if not takes(self._run, "ramp"):
                raise InputError(
                    f"engine {self.kind!r} takes no ramp; hold in steps, or use another engine "
                    "(for example 'rejection-free')"
                )
        with recording() as recorded:
            history = self._run(lattice, times, kelvin, seed, start, **how)
        return history.finished(start, recorded)

    def checked(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | np.ndarray,
        temperature: QuantityLike,
        start: Any,
    ) -> tuple[np.ndarray, float, Any]:
        """The hold times (m,) s, temperature (K) and start of a run, if it can be made."""
        expect(
            "lattice",
            lattice,
            ReactionLattice,
            "make one with chemistry.on(contact), or from arrays",
        )
        times = check_times(hold_times)
        start = checked_start(start, BondHistory, lattice, times, "hold_times")
        self.check(lattice.interacting)
        self.check_states(lattice.states)
        return times, temperature_value(temperature), start


def engine(kind: str, **options: Any) -> Any:
    """A kinetic Monte Carlo engine: ``chemage.engine("bkl").run(lattice, times, temperature=300, seed=3)``."""
    return registry.current().make("engine", kind, options)


def run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: Sequence[float] | np.ndarray,
    *,
    temperature: QuantityLike,
    seed: Seed = 0,
    start: BondHistory | None = None,
    ramp: Ramp | None = None,
    states: bool = False,
    contact: ContactSolution | None = None,
    chemistry: Chemistry | None = None,
) -> BondHistory:
    """One replica, through the hook ``chemage_run_kinetics``.

    ``contact`` and ``chemistry``, from which the lattice was made, are for plugins; the engine does not see them. The
    plugins that took part are noted in the history's ``provenance``. With ``states``, the history has the state of
    every site at every hold time. The engine then runs from hold time to hold time, which gives the same bytes, because
    a run resumed from a history equals the uninterrupted one.

    Raises
    ------
    InputError
        ``states`` with a ramp, or with an engine that cannot resume from a history.
    PluginError
        What the engine or a plugin gave contradicts itself or the lattice.
    """
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    expect(
        "lattice",
        lattice,
        ReactionLattice,
        "make one with chemistry.on(contact), or from arrays",
    )
    arguments: dict[str, Any] = {
        "lattice": lattice,
        "temperature": temperature_value(temperature),
        "seed": seed,
        "ramp": ramp,
    }
    arguments |= {"contact": contact, "chemistry": chemistry}
    times = check_times(hold_times)
    if not states:
        return _answered(engine, hold_times=times, start=start, **arguments)
    if not engine.restart:
        raise InputError(cannot_give_states(engine))
    if ramp is not None:
        raise InputError("states: not known on the way of a ramp; hold in steps")
    seen, whole = [], None
    for number in range(times.size):
        start = _answered(
            engine, hold_times=times[number : number + 1], start=start, **arguments
        )
        seen.append(start.state)
        whole = start if whole is None else whole.then(start)
    assert whole is not None
    return whole.model_copy(update={"states": np.stack(seen)})


def cannot_give_states(engine: Engine) -> str:
    """Why ``engine``, which cannot resume from a history, gives no states at every hold time, and what to do."""
    return (
        f"engine {engine.kind!r} cannot resume from a history (restart = False), so that the states at every hold time "
        "are not known; use another engine"
    )


def _answered(engine: Engine, **arguments: Any) -> BondHistory:
    history, took_part, recorded = registry.current().answer(
        "chemage_run_kinetics", BondHistory, engine=engine, **arguments
    )
    # an engine that selects another one, and a plugin that answers with one, record which
    used = (
        approximation_of("engine", history.engine)
        if history.engine != engine.kind
        else []
    )
    return noted(history, recorded, took_part, engine).noting({}, used)
