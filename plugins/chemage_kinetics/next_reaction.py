"""Engine ``next-reaction``: every site has the time of its next event; patches are followed one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage_kinetics import _next_reaction as kernel
from chemage_kinetics._common import Holds
from chemage_kinetics._driver import SLICE, Job, bonded, expected_cost, run_pieces
from chemage_kinetics._event_queue import new_order, new_queue
from chemage_kinetics._patches import patches_of
from chemage_kinetics._references import GIBSON
from chemage_kinetics._threads import ThreadedEngine

if TYPE_CHECKING:
    from chemage import ReactionLattice
    from chemage.plugin import BondHistory, Seed

#: Sites in a piece of work: small enough to balance the threads, large enough to amortise the call overhead.
PIECE = 20_000


class NextReaction(ThreadedEngine):
    """Next-reaction method (Gibson & Bruck 2000), patch by patch; every site has random numbers of its own.

    Results are the same to the last bit on any number of threads. Memory: 50 to 60 bytes per site besides the lattice.
    """

    kind = "next-reaction"
    cite = ("Gibson and Bruck, J. Phys. Chem. A 104, 1876 (2000), doi:10.1021/jp993732q",)
    bibtex = (GIBSON,)

    superbasins: bool = False
    """treat a site that flickers (forms and breaks its bond repeatedly) as an absorbing two-state chain: exact, and its
    cost does not depend on the number of its events (Novotny 1995); default: no"""

    def expected(self, sites: float, interacting: bool, events: float | None = None) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        return expected_cost(sites, 600e-9, 70e-9, 50, events, self.superbasins)

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
        order, starts = patches_of(job.model.neighbours, label=spot.reshape(-1)[:n])
        if job.resume is not None:
            times, draws = np.array(job.resume.times("times")), np.array(job.resume.draws("draws"))
        else:
            times, draws = np.empty((n, 2)), job.carried_draws()
        sites = kernel.Sites(job.key, job.model, lattice.random_index, words, draws)
        if job.resume is None:
            kernel.draw_times(sites, job.time, times)
        largest = int(np.diff(starts).max(initial=0))

        def follow(first: int, last: int, tally: np.ndarray) -> int:
            most = int(np.diff(starts[first : last + 1]).max(initial=0))
            run = kernel.Run(
                sites=sites,
                holds=Holds(job.hold_times, tally),
                queue=new_queue(times, spot, most, float(job.hold_times[-1])),
                order=new_order(order, starts, most),
                sooner=np.empty(job.model.neighbours.shape[1], np.int64),
                rng=np.empty(5, np.uint64),
            )
            # A patch that is continued sorts its sites anew, so a slice is not much shorter than that takes.
            return kernel.follow(run, first, last, self.superbasins or None, max(SLICE, largest))

        run_pieces(job, follow, _pieces(starts), self.threads)
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
