"""Engine ``auto``: selects an engine by the lattice, and reports which one and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import Engine
from chemage_kinetics._patches import patches_of
from chemage_kinetics._threads import ThreadedEngine
from chemage_kinetics.independent import Independent
from chemage_kinetics.next_reaction import NextReaction
from chemage_kinetics.rejection_free import RejectionFree

if TYPE_CHECKING:
    from chemage import ReactionLattice
    from chemage.plugin import BondHistory, Seed

#: From this many sites on, sharing patches between threads pays for starting the threads ...
WORTH_SHARING = 50_000
#: ... if no patch holds more than this fraction of them.
LARGEST_SHARE = 0.6


class Auto(ThreadedEngine):
    """The engine that suits the lattice; :meth:`choose` returns it, with the reason.

    ``independent`` where no site interacts with another. ``next-reaction`` for many sites in patches none of which
    holds most of them, and for several patches with ``superbasins``. Otherwise ``rejection-free``. All are exact, so
    the selection affects the sample and its cost and not its distribution. It depends on the lattice and
    ``superbasins`` alone, not on the number of threads.
    """

    kind = "auto"

    superbasins: bool = False
    """treat a site that flickers (forms and breaks its bond repeatedly) as an absorbing two-state chain: exact, and its
    cost does not depend on the number of its events (Novotny 1995); default: no"""

    def choose(self, lattice: ReactionLattice) -> tuple[Engine, str]:
        """The engine for this lattice, and why."""
        if not lattice.interacting or lattice.neighbours is None:
            return Independent(threads=self.threads), "no site interacts with another, so the closed form holds"
        n = lattice.sites.size
        _, starts = patches_of(lattice.neighbours)
        patches, largest = starts.size - 1, int(np.diff(starts).max(initial=0))
        shape = f"the largest of {patches} patches holds {largest} of {n} sites"
        if patches > 1 and self.superbasins:
            engine = NextReaction(threads=self.threads, superbasins=True)
            return engine, f"{shape}: sites that flicker are followed patch by patch"
        if n >= WORTH_SHARING and largest <= LARGEST_SHARE * n:
            return NextReaction(threads=self.threads, superbasins=self.superbasins), f"{shape}: threads can share them"
        few = "few sites" if n < WORTH_SHARING else "most sites in one patch"
        return RejectionFree(superbasins=self.superbasins), f"{shape}: with {few} the sum tree costs least"

    def expected(self, sites: float, interacting: bool, events: float | None = None) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        if not interacting:
            return Independent().expected(sites, interacting)
        return NextReaction(superbasins=self.superbasins).expected(sites, interacting, events)

    def warm_up(self, lattice: ReactionLattice, temperature: float) -> None:
        """Compile the engines between which a lattice of other size and patches may decide; the likelier one first."""
        if not lattice.interacting or lattice.neighbours is None:
            Independent().warm_up(lattice, temperature)
            return
        patches_of(lattice.neighbours)
        RejectionFree(superbasins=self.superbasins).warm_up(lattice, temperature)
        NextReaction(superbasins=self.superbasins).warm_up(lattice, temperature)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        engine, reason = self.choose(lattice)
        history = engine._run(lattice, hold_times, temperature, seed, start)
        note = f"engine auto took {engine.kind}: {reason}"
        return history.model_copy(update={"engine": self.kind, "notes": (note, *history.notes)})
