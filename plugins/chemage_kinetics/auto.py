"""Engine ``auto``: takes the engine that suits the lattice, and says which and why."""

from __future__ import annotations

import logging
import os
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from chemage.spec import Engine
from chemage_kinetics import _next_reaction as graph
from chemage_kinetics.independent import Independent
from chemage_kinetics.next_reaction import NextReaction
from chemage_kinetics.rejection_free import RejectionFree

if TYPE_CHECKING:
    from chemage.objects import BondHistory, ReactionLattice
    from chemage.spec import Seed

log = logging.getLogger("chemage.kinetics")


class Auto(Engine):
    """The engine that suits the lattice; the history's ``engine`` is its name, :meth:`choose` gives the reason.

    Nothing interacts: ``independent``. Several threads, and patches to share between them: ``next-reaction``. Otherwise
    ``rejection-free``. All are exact, so the choice changes the sample and its cost, not its law.
    """

    kind = "auto"
    threads: ClassVar[bool] = True

    workers: int = Field(default=1, ge=0)
    """threads inside one run; 0 takes one for each processor this process may use"""
    superbasins: bool = False
    """follow a site that flips to and fro as an absorbing two-state chain (exact; Novotny 1995)"""

    def choose(self, lattice: ReactionLattice) -> tuple[Engine, str]:
        """The engine for this lattice, and why."""
        if lattice.neighbours is None:
            return Independent(workers=self.workers), "no site interacts with another, so the closed form holds"
        n = lattice.sites.size
        workers = self.workers or len(os.sched_getaffinity(0))
        if workers < 2 and not self.superbasins:
            return (
                RejectionFree(),
                f"{n} sites interact and one thread was asked for: the sum tree costs least for an event",
            )
        starts = np.empty(n + 1, np.int64)
        patches = graph.find_patches(lattice.neighbours, np.empty(n, np.int32), starts, np.zeros(n, np.int32))
        largest = int(np.diff(starts[: patches + 1]).max(initial=0))
        shape = f"the largest of {patches} patches holds {largest} of {n} sites"
        if patches > 1 and self.superbasins:
            return (
                NextReaction(workers=self.workers, superbasins=True),
                f"{shape}: sites that flip to and fro are followed patch by patch",
            )
        if workers > 1 and 2 * largest <= n * (1.0 + 1.0 / workers):
            engine = NextReaction(workers=self.workers, superbasins=self.superbasins)
            return engine, f"{shape}: {workers} threads share them"
        return RejectionFree(superbasins=self.superbasins), f"{shape}: too few to share between threads"

    def _run(
        self, lattice: ReactionLattice, hold_times: np.ndarray, temperature: float, seed: Seed,
        start: BondHistory | np.ndarray | None,
    ) -> BondHistory:
        engine, reason = self.choose(lattice)
        log.info("engine auto takes %s: %s", engine.kind, reason)
        return engine._run(lattice, hold_times, temperature, seed, start)
