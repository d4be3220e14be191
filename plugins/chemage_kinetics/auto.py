"""Engine ``auto``: takes the engine that suits the lattice, and says which and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from chemage import Engine
from chemage.foundation.threads import available
from chemage_kinetics import _next_reaction as graph
from chemage_kinetics.independent import Independent
from chemage_kinetics.next_reaction import NextReaction
from chemage_kinetics.rejection_free import RejectionFree

if TYPE_CHECKING:
    from chemage import BondHistory, ReactionLattice, Seed

#: From this many sites on, sharing patches between threads is worth the start of the threads ...
WORTH_SHARING = 50_000
#: ... if no patch holds more than this part of them.
LARGEST_SHARE = 0.6


class Auto(Engine):
    """The engine that suits the lattice; :meth:`choose` says which it is, and why.

    Nothing interacts: ``independent``. Many sites in patches of which none holds most of them, or flipping to and fro
    to be followed patch by patch: ``next-reaction``. Otherwise ``rejection-free``. All are exact, so the choice changes
    the sample and its cost and not its law; it depends on the lattice alone, so the number of threads changes nothing.
    """

    kind = "auto"
    threads: ClassVar[bool] = True
    speed_only = ("workers",)

    workers: int = Field(default=1, ge=0)
    """threads inside one run; 0 takes one for each processor this process may use"""
    superbasins: bool = False
    """follow a site that flips to and fro as an absorbing two-state chain (exact; Novotny 1995)"""

    def choose(self, lattice: ReactionLattice) -> tuple[Engine, str]:
        """The engine for this lattice, and why."""
        if not lattice.interacting or lattice.neighbours is None:
            return Independent(workers=self.workers), "no site interacts with another, so the closed form holds"
        n = lattice.sites.size
        starts = np.empty(n + 1, np.int32)
        patches = graph.find_patches(lattice.neighbours, np.empty(n, np.int32), starts, np.zeros(n, np.int32))
        largest = int(np.diff(starts[: patches + 1]).max(initial=0))
        shape = f"the largest of {patches} patches holds {largest} of {n} sites"
        if patches > 1 and self.superbasins:
            engine = NextReaction(workers=self.workers, superbasins=True)
            return engine, f"{shape}: sites that flip to and fro are followed patch by patch"
        if n >= WORTH_SHARING and largest <= LARGEST_SHARE * n:
            return NextReaction(workers=self.workers, superbasins=self.superbasins), f"{shape}: threads can share them"
        few = "few sites" if n < WORTH_SHARING else "most sites in one patch"
        return RejectionFree(superbasins=self.superbasins), f"{shape}: with {few} the sum tree costs least"

    def concurrency(self) -> int:
        """Threads of one run: ``workers``."""
        return self.workers or available()

    def expected(self, sites: float, interacting: bool) -> dict[str, float]:
        """See :meth:`chemage.spec.Engine.expected`."""
        return (NextReaction() if interacting else Independent()).expected(sites, interacting)

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
