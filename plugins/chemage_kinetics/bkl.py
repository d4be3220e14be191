"""Engine ``bkl``: the n-fold way with power-of-two rate classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage import Engine
from chemage_kinetics import _bkl as kernel
from chemage_kinetics._driver import SLICE, Job, bonded, room_temperature_cost

if TYPE_CHECKING:
    from chemage import BondHistory, ReactionLattice, Seed


class BKL(Engine):
    """The n-fold way of Bortz, Kalos and Lebowitz for rates that all differ: classes by powers of two, and thinning.

    Memory: 39 bytes a site besides the lattice. Time per event hardly depends on the number of sites.
    """

    kind = "bkl"
    cite = ("Bortz, Kalos and Lebowitz, J. Comput. Phys. 17, 10 (1975), doi:10.1016/0021-9991(75)90060-1",)

    superbasins: bool = False
    """follow a site that flips to and fro as an absorbing two-state chain (exact; Novotny 1995)"""

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.spec.Engine.expected`."""
        return room_temperature_cost(sites, 650e-9, 25e-9, 46)

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
        records = np.empty((n, 2), np.int64)
        first = np.empty(kernel.CLASSES, np.int64)
        room = np.empty(kernel.CLASSES + 1, np.int64)
        counts = np.empty(kernel.CLASSES, np.int64)
        slots = np.empty((kernel.CLASSES, 2), np.int64)
        weights = np.empty(kernel.GROUPS)
        clock = np.array([job.time, 0.0])
        counters = np.zeros(6, np.int64)
        counters[kernel.LAST] = -1
        words = job.words()
        if job.resume is not None:
            clock[:] = job.resume["clock"]
            counters[kernel.EVENT] = job.resume["event"][0]
            counters[kernel.LAST] = job.resume["last"][0]
            order = np.array(job.resume["members"])
            counts[:] = job.resume["counts"]
        else:
            counters[kernel.EVENT] = job.carried("event") + 1  # the pending event's own draw has been looked at
            order = kernel.sort(words, job.breaking, job.per_unit * kernel.SHARE, counts)
        arena = kernel.place(order, words, records, first, room, counts, slots, weights, counters)
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
                n >= kernel.FAR,
                records,
                arena,
                first,
                room,
                counts,
                slots,
                weights,
                clock,
                counters,
                job.tally,
                SLICE,
            )
        return job.history(
            bonded(np.ascontiguousarray(records[:, 0])),
            clock=clock,
            event=counters[kernel.EVENT : kernel.EVENT + 1].copy(),
            last=counters[kernel.LAST : kernel.LAST + 1].copy(),
            members=kernel.members(arena, first, counts, n),
            counts=counts,
        )
