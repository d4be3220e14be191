"""Engine ``rejection-free``: Gillespie's direct method, every event drawn from the exact total rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import Engine
from chemage_kinetics import _rejection_free as kernel
from chemage_kinetics._driver import SLICE, Job, bonded, expected_cost
from chemage_kinetics._references import GILLESPIE
from chemage_kinetics._sum_tree import ROOM, empty_rates, fill, relist

if TYPE_CHECKING:
    from chemage import ReactionLattice
    from chemage.plugin import BondHistory, Seed


class RejectionFree(Engine):
    """Direct method on an eight-way sum tree (Gillespie 1976): every attempt is an event, there are no rejections.

    Memory: 18 bytes per site besides the lattice. Time per event grows as log8 of the number of sites.
    """

    kind = "rejection-free"
    cite = ("Gillespie, J. Comput. Phys. 22, 403 (1976), doi:10.1016/0021-9991(76)90041-3",)
    bibtex = (GILLESPIE,)

    superbasins: bool = False
    """treat a site that flickers (forms and breaks its bond repeatedly) as an absorbing two-state chain: exact, and its
    cost does not depend on the number of its events (Novotny 1995); default: no"""

    def expected(self, sites: float, interacting: bool, events: float | None = None) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        return expected_cost(sites, 430e-9, 15e-9, 18, events, self.superbasins)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        job = Job(self.kind, lattice, hold_times, temperature, seed, start)
        words = job.words()
        rates = empty_rates(words.size, job.model.neighbours.shape[1], listing=words.size >= kernel.FAR)
        fill(words, job.model, rates)
        run = kernel.new_run(job.key, job.holds, job.model, words, rates, job.time)
        counters = run.counters
        if job.resume is not None:
            run.clock[:] = job.resume.clock("clock")
            counters[kernel.EVENT] = job.resume.count("event")
            counters[kernel.DRAWN] = job.resume.count("drawn")
            counters[kernel.LAST] = job.resume.site("last")
            fast = job.resume.chosen("fast", int(ROOM) if rates.listing else 0)
            if fast.size:
                relist(fast, rates)
        else:
            counters[kernel.EVENT] = job.carried("event") + 1  # the random numbers of the pending event are used up
            counters[kernel.DRAWN] = job.carried("drawn")
        while not counters[kernel.DONE]:
            kernel.advance(run, self.superbasins or None, SLICE)
        return job.history(
            bonded(words),
            clock=run.clock,
            event=counters[kernel.EVENT : kernel.EVENT + 1].copy(),
            drawn=counters[kernel.DRAWN : kernel.DRAWN + 1].copy(),
            fast=rates.sites[: rates.listed[0]].copy(),
            last=counters[kernel.LAST : kernel.LAST + 1].copy(),
        )
