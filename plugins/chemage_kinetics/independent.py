"""Engine ``independent``: sites that do not interact, each a two-state chain."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from chemage import InputError, ReactionLattice
from chemage.plugin import BondHistory, check_times, checked_states, temperature_value
from chemage_kinetics import _independent as kernel
from chemage_kinetics._common import Holds
from chemage_kinetics._driver import Job, expected_cost, model_of, run_pieces
from chemage_kinetics._references import COX
from chemage_kinetics._threads import ThreadedEngine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from chemage.plugin import Seed

#: Sites in a piece of work.
PIECE = 50_000


class Independent(ThreadedEngine):
    """Sites that do not interact: exact, at a cost per site that does not depend on the number of its events.

    Where a site has many events before a hold time, its state and their number are drawn from the distributions of the
    alternating renewal process. Results are the same to the last bit on any number of threads. Lattices whose sites
    interact are refused.
    """

    kind = "independent"
    cite = ("Cox, Renewal Theory (Methuen, 1962), chapter 7",)
    bibtex = (COX,)
    interacting: ClassVar[bool] = False

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        return expected_cost(sites, 100e-9, 60e-9, 25)

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
        if job.resume is not None:
            times, draws = np.array(job.resume.times("times")), np.array(job.resume.draws("draws"))
        else:
            times, draws = np.empty((n, 2)), job.carried_draws()
        model = job.model
        sites = kernel.Sites(
            key=job.key,
            pixels=lattice.random_index,
            forming=lattice.forming,
            breaking=model.breaking,
            nu=model.nu,
            per_unit=model.per_unit,
            state=job.state.copy(),
            times=times,
            draws=draws,
        )
        if job.resume is None:
            kernel.draw_times(sites, job.time)

        def follow(first: int, last: int, tally: np.ndarray) -> int:
            kernel.follow(sites, Holds(job.hold_times, tally), np.empty(5, np.uint64), first, last)
            return last

        run_pieces(job, follow, [(first, min(first + PIECE, n)) for first in range(0, n, PIECE)], self.threads)
        return job.history(sites.state, times=times, draws=draws)

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
        if not isinstance(lattice, ReactionLattice):
            raise InputError.of("lattice", lattice, "is no ReactionLattice", "make one with chemistry.on(contact)")
        if lattice.interacting:
            raise InputError(
                "engine 'independent' has no closed form for a lattice that couples neighbours; "
                "average several runs of 'rejection-free' instead"
            )
        begin = 0.0
        state = np.zeros(lattice.sites.size, np.bool_)
        if start is not None:
            begin = start.time if isinstance(start, BondHistory) else 0.0
            state = checked_states("start", start.state if isinstance(start, BondHistory) else start, state.size)
        if times[0] < begin:
            raise InputError.of("hold_times", float(times[0]), f"the start is at {begin} s", "give later hold times")
        mean, variance = np.empty(times.size), np.empty(times.size)
        model = model_of(lattice, kelvin)
        kernel.moments(lattice.forming, model.breaking, model.nu, model.per_unit, state, times - begin, mean, variance)
        return mean, variance
