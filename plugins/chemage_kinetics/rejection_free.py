"""Engine ``rejection-free``: Gillespie's direct method, every event drawn from the exact total rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage import Engine
from chemage_kinetics import _rejection_free as kernel
from chemage_kinetics._driver import SLICE, Job, aligned, bonded, room_temperature_cost

if TYPE_CHECKING:
    from chemage import BondHistory, ReactionLattice, Seed


class RejectionFree(Engine):
    """Direct method on an eight-way sum tree (Gillespie 1976): one event, one draw, no rejections.

    Memory: 17 bytes a site besides the lattice. Time per event grows as log8 of the number of sites.
    """

    kind = "rejection-free"
    cite = ("Gillespie, J. Comput. Phys. 22, 403 (1976), doi:10.1016/0021-9991(76)90041-3",)

    superbasins: bool = False
    """follow a site that flips to and fro as an absorbing two-state chain (exact; Novotny 1995)"""

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.spec.Engine.expected`."""
        return room_temperature_cost(sites, 430e-9, 15e-9, 18)

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
        starts = kernel.levels(words.size)
        tree = aligned(int(starts[-1]))
        kernel.fill(words, job.breaking, job.nu, job.per_unit, tree, starts)
        clock = np.array([job.time, 0.0])
        sites, rates = np.full(kernel.ROOM, -1), aligned(kernel.ROOM + 8)
        rates[:] = 0.0
        far = words.size >= kernel.FAR
        counters = np.zeros(6, np.int64)
        counters[kernel.LAST] = -1
        if job.resume is not None:
            clock[:] = job.resume["clock"]
            counters[kernel.EVENT] = job.resume["event"][0]
            counters[kernel.DRAWN] = job.resume["drawn"][0]
            counters[kernel.LAST] = job.resume["last"][0]
            if job.resume["fast"].size:
                counters[kernel.LISTED] = kernel.relist(job.resume["fast"], tree, starts, sites, rates)
        else:
            counters[kernel.EVENT] = job.carried("event") + 1  # the pending event's own draw has been looked at
            counters[kernel.DRAWN] = job.carried("drawn")
        while not counters[kernel.DONE]:
            kernel.advance(
                job.k0,
                job.k1,
                job.neighbours,
                job.coupling,
                job.breaking,
                job.nu,
                job.per_unit,
                job.hold_times,
                self.superbasins or None,
                far,
                words,
                tree,
                starts,
                sites,
                rates,
                clock,
                counters,
                job.tally,
                SLICE,
            )
        return job.history(
            bonded(words),
            clock=clock,
            event=counters[kernel.EVENT : kernel.EVENT + 1].copy(),
            drawn=counters[kernel.DRAWN : kernel.DRAWN + 1].copy(),
            fast=sites[: counters[kernel.LISTED]].copy(),
            last=counters[kernel.LAST : kernel.LAST + 1].copy(),
        )
