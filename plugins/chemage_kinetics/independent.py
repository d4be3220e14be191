"""Engine ``independent``: sites that do not interact, by the closed form of the two-state chain."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from chemage import KB, Engine, InputError, check_times, temperature_value
from chemage.foundation.threads import available
from chemage_kinetics import _common
from chemage_kinetics import _independent as kernel
from chemage_kinetics._driver import Job, frozen_empty, room_temperature_cost, run_pieces

if TYPE_CHECKING:
    from collections.abc import Sequence

    from chemage import BondHistory, ReactionLattice, Seed

#: Sites in a piece of work.
PIECE = 50_000


class Independent(Engine):
    """Non-interacting sites: exact, and the cost of a site does not depend on how often it flips.

    A site that flips many times before a hold time gets its state and its number of flips from the law of the
    alternating renewal process. The sample is the same to the last bit on any number of threads. Refuses lattices that
    interact.
    """

    kind = "independent"
    cite = ("Cox, Renewal Theory (Methuen, 1962), chapter 7",)
    interacting: ClassVar[bool] = False
    threads: ClassVar[bool] = True
    speed_only = ("workers",)

    workers: int = Field(default=1, ge=0)
    """threads to share the sites between; 0 takes one for each processor this process may use"""

    def concurrency(self) -> int:
        """Threads of one run: ``workers``."""
        return self.workers or available()

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.spec.Engine.expected`."""
        return room_temperature_cost(sites, 100e-9, 60e-9, 25)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        job = Job(self.kind, lattice, hold_times, temperature, seed, start)
        n = lattice.sites.size
        state = job.state.copy()
        if job.resume is not None:
            times, draws = np.array(job.resume["times"]), np.array(job.resume["draws"])
        else:
            times, draws = np.empty((n, 2)), job.carried_array("draws", np.zeros(n, np.int64))
            kernel.draw_times(
                job.k0,
                job.k1,
                lattice.sites,
                lattice.forming,
                job.breaking,
                job.nu,
                job.per_unit,
                job.time,
                state,
                times,
                draws,
            )

        def follow(first: int, last: int, tally: np.ndarray) -> int:
            kernel.follow(
                job.k0,
                job.k1,
                lattice.sites,
                lattice.forming,
                job.breaking,
                job.nu,
                job.per_unit,
                job.hold_times,
                first,
                last,
                state,
                times,
                draws,
                tally,
            )
            return last

        run_pieces(job, follow, [(first, min(first + PIECE, n)) for first in range(0, n, PIECE)], self.workers)
        return job.history(state, times=times, draws=draws)

    def mean(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | np.ndarray,
        *,
        temperature: float | str,
        start: BondHistory | np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The exact mean number of bonds at each hold time, and its variance; both (m,), no sampling.

        ``start`` as for :meth:`run`: None (nothing bonded at time 0), a bool array (n,), or a history.
        """
        times = check_times(hold_times)
        kelvin = temperature_value(temperature)
        if lattice.interacting:
            raise InputError(
                "engine 'independent' has no closed form for a lattice that couples neighbours; "
                "average several runs of 'rejection-free' instead"
            )
        begin = 0.0
        state = np.zeros(lattice.sites.size, np.bool_)
        if start is not None:
            given = start if isinstance(start, np.ndarray) else start.state
            begin = 0.0 if isinstance(start, np.ndarray) else start.time
            if given.shape != state.shape:
                raise InputError.of("start", given.shape, f"expected {state.shape}", "one entry a site")
            state[:] = given
        if times[0] < begin:
            raise InputError.of("hold_times", float(times[0]), f"the start is at {begin} s", "give later hold times")
        mean, variance = np.empty(times.size), np.empty(times.size)
        breaking = frozen_empty(0) if lattice.breaking is None else lattice.breaking
        per_unit = 1.0 / (KB * kelvin * _common.UNITS_PER_EV)
        kernel.moments(
            lattice.forming, breaking, float(lattice.attempt_frequency), per_unit, state, times - begin, mean, variance
        )
        return mean, variance
