"""Engine ``next-reaction``: every site has its own clock; patches are followed one by one, on any number of threads."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from chemage import Engine
from chemage.foundation.threads import available
from chemage_kinetics import _next_reaction as kernel
from chemage_kinetics._driver import SLICE, Job, bonded, room_temperature_cost, run_pieces

if TYPE_CHECKING:
    from chemage import BondHistory, ReactionLattice, Seed

#: Sites in a piece of work: small enough to share out evenly, large enough to forget the call.
PIECE = 20_000


class NextReaction(Engine):
    """Next-reaction method (Gibson & Bruck 2000), patch by patch, with a counter of random numbers for every site.

    The trajectory is the same to the last bit on any number of threads. Memory: 50 to 60 bytes a site besides the
    lattice.
    """

    kind = "next-reaction"
    cite = ("Gibson and Bruck, J. Phys. Chem. A 104, 1876 (2000), doi:10.1021/jp993732q",)
    threads: ClassVar[bool] = True
    speed_only = ("workers",)

    workers: int = Field(default=1, ge=0)
    """threads to follow patches on; 0 takes one for each processor this process may use"""
    superbasins: bool = False
    """follow a site that flips to and fro as an absorbing two-state chain (exact; Novotny 1995)"""

    def concurrency(self) -> int:
        """Threads of one run: ``workers``."""
        return self.workers or available()

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.spec.Engine.expected`."""
        return room_temperature_cost(sites, 600e-9, 70e-9, 50)

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
        words = job.words()
        spot = np.zeros((n, 2), np.int32)
        order = np.empty(n, np.int32)
        starts = np.empty(n + 1, np.int32)
        patches = kernel.find_patches(job.neighbours, order, starts, spot.reshape(-1)[:n])
        starts = starts[: patches + 1].copy()
        if job.resume is not None:
            times, draws = np.array(job.resume["times"]), np.array(job.resume["draws"])
        else:
            times, draws = np.empty((n, 2)), job.carried_array("draws", np.zeros(n, np.int64))
            clock = np.array([job.time, 0.0])
            kernel.draw_times(
                job.k0, job.k1, lattice.sites, words, job.breaking, job.nu, job.per_unit, clock, times, draws
            )

        # A patch that is taken up again sorts its sites anew, so a slice is not much shorter than that takes.
        events = max(SLICE, int(np.diff(starts).max(initial=0)))

        def follow(first: int, last: int, tally: np.ndarray) -> int:
            return kernel.follow(
                job.k0,
                job.k1,
                lattice.sites,
                job.neighbours,
                job.coupling,
                job.breaking,
                job.nu,
                job.per_unit,
                job.hold_times,
                self.superbasins or None,
                order,
                starts,
                first,
                last,
                words,
                times,
                draws,
                spot,
                tally,
                events,
            )

        run_pieces(job, follow, _pieces(starts), self.workers)
        return job.history(bonded(words), times=times, draws=draws)


def _pieces(starts: np.ndarray) -> list[tuple[int, int]]:
    """Runs of patches of about PIECE sites, the largest first, as (first patch, patch after the last)."""
    pieces = []
    first = 0
    patches = starts.size - 1
    while first < patches:
        last = int(np.searchsorted(starts, starts[first] + PIECE, side="right")) - 1
        last = min(max(last, first + 1), patches)
        pieces.append((first, last))
        first = last
    return sorted(pieces, key=lambda piece: int(starts[piece[0]] - starts[piece[1]]))
