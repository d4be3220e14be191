"""The role that follows bonds in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from chemage.foundation.checks import Seed, check_times, checked_seed, checked_states, expect, temperature_value
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.units import QuantityLike
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice


class Engine(Component, ABC):
    """Role ``engine``: follows bonds forming and breaking on a graph; knows neither surface nor chemistry."""

    role = "engine"
    #: treats lattices whose sites interact
    interacting: ClassVar[bool] = True
    #: can resume from a history bit for bit
    restart: ClassVar[bool] = True
    #: samples the master equation without approximation
    exact: ClassVar[bool] = True
    #: of an approximate engine, the largest relative error of the mean number of bonds; the checks hold it to that
    declared_error: ClassVar[float | None] = None
    error_of: ClassVar[str] = "the mean number of bonds"

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
        ``start`` None (nothing bonded), (n,) bool, or a history whose lattice has the same number of sites."""

    def run(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | np.ndarray,
        *,
        temperature: QuantityLike,
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
            An int or a ``numpy.random.SeedSequence``; the same seed gives the same bytes. The built-in engines hash it
            with the lattice, so that one seed gives independent noise on different lattices; they use a
            ``chemage.plugin.random.CommonSeed`` as it is.
        start
            None (nothing bonded at time 0), a bool array (n,), or a finished history to resume from. Resuming with the
            same lattice, temperature and seed equals the uninterrupted run bit for bit where ``restart`` is true.

        Raises
        ------
        InputError
            Naming the argument that is wrong.
        """
        expect("lattice", lattice, ReactionLattice, "make one with chemistry.on(contact), or from arrays")
        times = check_times(hold_times)
        kelvin = temperature_value(temperature)
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        if isinstance(start, BondHistory):
            if fault := start.fault():
                raise InputError(f"start: a history that contradicts itself: {fault}; pass one as an engine gave it")
            if start.state.size != lattice.sites.size:
                raise InputError.of(
                    "start",
                    f"a history of {start.state.size} sites",
                    f"the lattice has {lattice.sites.size}",
                    "resume with the lattice that it came from",
                )
            if times[0] < start.time:
                raise InputError.of(
                    "hold_times",
                    float(times[0]),
                    f"the history to resume from ends at {start.time} s",
                    "give later hold times",
                )
        elif start is not None:
            start = checked_states("start", start, lattice.sites.size)
        self.check(lattice.interacting)
        return self._run(lattice, times, kelvin, seed, start)
