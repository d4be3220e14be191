"""Engine ``bkl``: the n-fold way with power-of-two rate classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import Engine
from chemage_kinetics import _bkl as kernel
from chemage_kinetics._driver import SLICE, Job, bonded, expected_cost
from chemage_kinetics._rate_classes import members, new_classes
from chemage_kinetics._references import BORTZ

if TYPE_CHECKING:
    from chemage import ReactionLattice
    from chemage.plugin import BondHistory, Seed


class BKL(Engine):
    """The n-fold way of Bortz, Kalos and Lebowitz for rates that all differ: classes by powers of two, and thinning.

    Memory: 46 bytes per site besides the lattice. Time per event hardly depends on the number of sites.
    """

    kind = "bkl"
    cite = ("Bortz, Kalos and Lebowitz, J. Comput. Phys. 17, 10 (1975), doi:10.1016/0021-9991(75)90060-1",)
    bibtex = (BORTZ,)

    superbasins: bool = False
    """treat a site that flickers (forms and breaks its bond repeatedly) as an absorbing two-state chain: exact, and its
    cost does not depend on the number of its events (Novotny 1995); default: no"""

    def expected(self, sites: float, interacting: bool, events: float | None = None) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        return expected_cost(sites, 650e-9, 25e-9, 46, events, self.superbasins)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        job = Job(self.kind, lattice, hold_times, temperature, seed, start)
        resume = job.resume
        words = job.words()
        order, counts = (None, None) if resume is None else resume.members(words, job.model)
        classes = new_classes(words, job.model, order, counts)
        run = kernel.new_run(job.key, job.holds, classes, job.time)
        counters = run.counters
        if resume is not None:
            run.clock[:] = resume.clock("clock")
            counters[kernel.EVENT] = resume.count("event")
            counters[kernel.LAST] = resume.site("last")
        else:
            counters[kernel.EVENT] = job.carried("event") + 1  # the random numbers of the pending attempt are used up
        while not counters[kernel.DONE]:
            kernel.advance(run, self.superbasins or None, SLICE)
        return job.history(
            bonded(np.ascontiguousarray(classes.records[:, 0])),
            clock=run.clock,
            event=counters[kernel.EVENT : kernel.EVENT + 1].copy(),
            last=counters[kernel.LAST : kernel.LAST + 1].copy(),
            members=members(classes),
            counts=classes.counts,
        )
