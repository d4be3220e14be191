"""The engines. docs/kinetics.md compares them."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from chemage import ReactionLattice
from chemage.plugin import BondHistory, Engine, Output, Ramp, threads
from chemage_kinetics import (
    _bkl,
    _common,
    _independent,
    _many_states,
    _next_reaction,
    _rejection_free,
)
from chemage_kinetics._bkl import BklRun
from chemage_kinetics._common import (
    DONE,
    DRAWN,
    EVENT,
    LAST,
    Array,
    Holds,
    patches_of,
)
from chemage_kinetics._driver import (
    SLICE,
    Job,
    bonded,
    expected_cost,
    parts_of,
    run_pieces,
)
from chemage_kinetics._event_queue import MOST_BUCKETS, Order, new_queue
from chemage_kinetics._many_states import BONDED, ManyStatesRun
from chemage_kinetics._rate_classes import members, new_classes
from chemage_kinetics._rejection_free import (
    ROOM,
    RejectionFreeRun,
    empty_rates,
    fill,
    relist,
)
from chemage_kinetics._transitions import initial_states, transitions_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from chemage.plugin import Seed

#: Sites in a piece of work of `next-reaction`: small enough to balance the threads, large enough to amortise the call
#: overhead; and of `independent`.
PIECE, SITE_PIECE = 20_000, 50_000
#: From this many sites on, sharing patches between threads pays for starting the threads ...
WORTH_SHARING = 50_000
#: ... if no patch holds more than this fraction of them.
LARGEST_SHARE = 0.6

# the publications that the engines cite
GIBSON = """@article{gibson2000,
  author = {Gibson, M. A. and Bruck, J.},
  title = {Efficient exact stochastic simulation of chemical systems with many species and many channels},
  journal = {The Journal of Physical Chemistry A},
  volume = {104},
  pages = {1876--1889},
  year = {2000},
  doi = {10.1021/jp993732q},
}"""

GILLESPIE = """@article{gillespie1976,
  author = {Gillespie, D. T.},
  title = {A general method for numerically simulating the stochastic time evolution of coupled chemical reactions},
  journal = {Journal of Computational Physics},
  volume = {22},
  pages = {403--434},
  year = {1976},
  doi = {10.1016/0021-9991(76)90041-3},
}"""

BORTZ = """@article{bortz1975,
  author = {Bortz, A. B. and Kalos, M. H. and Lebowitz, J. L.},
  title = {A new algorithm for {Monte Carlo} simulation of {Ising} spin systems},
  journal = {Journal of Computational Physics},
  volume = {17},
  pages = {10--18},
  year = {1975},
  doi = {10.1016/0021-9991(75)90060-1},
}"""

COX = """@book{cox1962,
  author = {Cox, D. R.},
  title = {Renewal Theory},
  publisher = {Methuen},
  year = {1962},
}"""


class KernelEngine(Engine):
    """An engine whose run is a `Job`."""

    #: seconds per event, seconds of set-up per site, and bytes per site, on large lattices
    cost: ClassVar[tuple[float, float, float]]

    def expected(
        self, sites: float, interacting: bool, events: float | None = None
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        superbasins = getattr(self, "superbasins", False)
        return expected_cost(sites, *self.cost, events, superbasins)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: Array,
        temperature: float,
        seed: Seed,
        start: BondHistory | Array | None,
        ramp: Ramp | None = None,
    ) -> BondHistory:
        """A ramp in parts, each followed at constant bounds of the rates; exact, whatever the parts are."""
        if ramp is None:
            how = lattice, hold_times, temperature, seed, start
            return self._follow(Job(self.kind, *how), None)
        begin = getattr(start, "time", 0.0)
        seen: list[BondHistory] = []
        for part in parts_of(lattice, hold_times, begin, temperature, ramp):
            how = part.lattice, part.times, part.temperature, seed, start
            start = self._follow(Job(self.kind, *how), part.bounds)
            seen.append(start)
        return BondHistory.of_parts(seen, temperature=ramp.temperature)

    @abstractmethod
    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        """Follow the bonds to the last hold time, at the rates of the job or, with a ramp, under them."""

    def chains(self, ramp: _common.RampBounds | None) -> bool | None:
        """Whether sites that flicker are two-state chains, as the kernels are told; not in a ramp."""
        return (getattr(self, "superbasins", False) and ramp is None) or None

    def _advanced(
        self,
        job: Job,
        run: BklRun | RejectionFreeRun | ManyStatesRun,
        advance: Callable[..., None],
        ramp: _common.RampBounds | None,
        *counted: tuple[str, int],
    ) -> dict[str, Array]:
        """Follow a run to the last hold time; ``counted``: its counters of random numbers. Returns clock and counters,
        to be resumed from."""
        counters = run.counters
        for name, place in counted:
            counters[place] = (
                job.carried(name) if job.resume is None else job.resume.count(name)
            )
        if job.resume is not None:
            run.clock[:] = job.resume.clock("clock")
            counters[LAST] = job.resume.site("last")
        else:
            counters[EVENT] += (
                1  # the random numbers of the pending event are used up
            )
            counters[LAST] = -1
        while not counters[DONE]:
            advance(run, self.chains(ramp), ramp, SLICE)
        places = ("last", LAST), *counted
        done = {name: counters[[place]] for name, place in places}
        return {"clock": run.clock, **done}


class ThreadedEngine(Engine):
    """An engine with the option ``threads``."""

    speed_only = ("threads",)

    threads: int = Field(default=1, ge=0)
    """threads inside one run; 0: one per processor that this process may use; default: 1"""

    @model_validator(mode="before")
    @classmethod
    def _earlier_name(cls, options: Any) -> Any:
        # scenes and sweeps of 0.1 call it workers
        given = set(options) if isinstance(options, dict) else set()
        if "workers" in given and "threads" not in given:
            options = dict(options)
            options["threads"] = options.pop("workers")
        return options

    def concurrency(self) -> int:
        """Threads of one run: ``threads``."""
        return self.threads or threads.available()


class FlickerEngine(Engine):
    """An engine with the option ``superbasins``."""

    superbasins: bool = False
    """treat a site that flickers (forms and breaks its bond repeatedly) as an absorbing two-state chain: exact, and its
    cost does not depend on the number of its events (Novotny 1995); not in ramps, where rates change; default: no"""


class EventEngine(FlickerEngine, KernelEngine):
    """An engine that follows events one by one."""


class RejectionFree(EventEngine):
    """Direct method on an eight-way sum tree (Gillespie 1976): every attempt is an event, there are no rejections.

    Memory: 18 bytes per site besides the lattice. Time per event grows as log8 of the number of sites.
    """

    kind = "rejection-free"
    cite = (
        "Gillespie, J. Comput. Phys. 22, 403 (1976), doi:10.1016/0021-9991(76)90041-3",
    )
    bibtex = (GILLESPIE,)
    cost = (430e-9, 15e-9, 18)

    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        words = job.words()
        rates = empty_rates(
            words.size,
            job.model.neighbours.shape[1],
            listing=words.size >= _rejection_free.FAR,
        )
        fill(words, job.model, rates)
        run = RejectionFreeRun(
            key=job.key,
            holds=job.holds,
            model=job.model,
            words=words,
            rates=rates,
            near=np.empty((job.model.neighbours.shape[1], 2), np.int64),
            draws=np.zeros((_rejection_free.RING, 3)),
            spots=np.zeros(_rejection_free.RING, np.int64),
            rng=np.empty(5, np.uint64),
            clock=np.array([job.time, 0.0]),
            counters=np.zeros(5, np.int64),
        )
        if job.resume is not None:
            fast = job.resume.chosen("fast", int(ROOM) if rates.listing else 0)
            if fast.size:
                relist(fast, rates)
        done = self._advanced(
            job,
            run,
            _rejection_free.advance,
            ramp,
            ("event", EVENT),
            ("drawn", DRAWN),
        )
        return job.history(
            bonded(words), fast=rates.sites[: rates.listed[0]].copy(), **done
        )


class ManyStates(KernelEngine):
    """Direct method on an eight-way sum tree for sites of any number of states: every transition is an event.

    The number of sites in each state but ``bonded`` is recorded as ``sites_STATE``.
    """

    kind = "many-states"
    cite = RejectionFree.cite
    bibtex = RejectionFree.bibtex
    many_states: ClassVar[bool] = True
    cost = (700e-9, 60e-9, 80)

    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        lattice = job.lattice
        transitions = transitions_of(lattice)
        names = lattice.states or ("free", "bonded")
        heat = 1.0 if ramp is None else ramp.heat[0]
        states = initial_states(
            job, transitions, heat * job.temperature, len(names)
        )
        changes = np.zeros((job.times.size, len(names)), np.int64)
        changes[0] = np.bincount(states, minlength=len(names))
        fields = np.zeros(states.size, np.int64)
        no_barriers = np.zeros(states.size)
        _common.start_words(no_barriers, job.model, job.state, fields)
        fields >>= 1
        run = ManyStatesRun(
            key=job.key,
            holds=job.holds,
            model=job.model,
            transitions=transitions,
            states=states,
            fields=fields,
            rates=empty_rates(
                transitions.barriers.size,
                # blocks that the leaves of a site and its neighbours lie in
                (job.model.neighbours.shape[1] + 1) * (len(transitions.pairs) + 1),
                listing=False,
            ),
            changes=changes,
            clock=np.array([job.time, 0.0]),
            counters=np.zeros(5, np.int64),
        )
        _many_states.fill(run)
        done = self._advanced(
            job, run, _many_states.advance, ramp, ("event", EVENT)
        )
        history = job.history(states == BONDED, occupied=states, **done)
        counts = np.cumsum(changes, axis=0)
        curves = {
            f"sites_{name}": counts[:, at]
            for at, name in enumerate(names)
            if at != BONDED
        }
        outputs = {name: Output("hold_time").todict() for name in curves}
        return history.model_copy(
            update={"observables": curves, "outputs": outputs}
        )


class BKL(EventEngine):
    """The n-fold way of Bortz, Kalos and Lebowitz for rates that all differ: classes by powers of two, and thinning.

    Memory: 46 bytes per site besides the lattice. Time per event hardly depends on the number of sites.
    """

    kind = "bkl"
    cite = (
        "Bortz, Kalos and Lebowitz, J. Comput. Phys. 17, 10 (1975), doi:10.1016/0021-9991(75)90060-1",
    )
    bibtex = (BORTZ,)
    cost = (650e-9, 25e-9, 46)

    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        resume = job.resume
        words = job.words()
        order, counts = (
            (None, None) if resume is None else resume.members(words, job.model)
        )
        classes = new_classes(words, job.model, order, counts)
        run = BklRun(
            key=job.key,
            holds=job.holds,
            classes=classes,
            draws=np.empty((_bkl.RING, 4)),
            spots=np.zeros(_bkl.RING, np.int64),
            predicting=words.size >= _bkl.FAR,
            near=np.empty((job.model.neighbours.shape[1] + 1, 2), np.int64),
            rng=np.empty(5, np.uint64),
            clock=np.array([job.time, 0.0]),
            counters=np.zeros(4, np.int64),
        )
        done = self._advanced(job, run, _bkl.advance, ramp, ("event", EVENT))
        state = bonded(np.ascontiguousarray(classes.records[:, 0]))
        return job.history(
            state, members=members(classes), counts=classes.counts, **done
        )


class NextReaction(EventEngine, ThreadedEngine):
    """Next-reaction method (Gibson & Bruck 2000), patch by patch; every site has random numbers of its own.

    Results are the same to the last bit on any number of threads. Memory: 50 to 60 bytes per site besides the lattice.
    """

    kind = "next-reaction"
    cite = (
        "Gibson and Bruck, J. Phys. Chem. A 104, 1876 (2000), doi:10.1021/jp993732q",
    )
    bibtex = (GIBSON,)
    cost = (600e-9, 70e-9, 50)

    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        n = job.lattice.sites.size
        words = job.words()
        spot = np.zeros((n, 2), np.int32)
        order, starts = patches_of(job.model.neighbours, label=spot.reshape(-1)[:n])
        times, draws = job.of_sites()
        sites = _next_reaction.QueuedSites(
            job.key, job.model, job.lattice.random_index, words, draws
        )
        if job.resume is None:
            _next_reaction.draw_times(sites, job.time, times)
        largest = int(np.diff(starts).max(initial=0))

        def follow(first: int, last: int, tally: Array) -> int:
            most = int(np.diff(starts[first : last + 1]).max(initial=0))
            run = _next_reaction.NextReactionRun(
                sites=sites,
                holds=Holds(job.times, tally),
                queue=new_queue(times, spot, most, float(job.times[-1])),
                order=Order(
                    order,
                    starts,
                    np.empty(MOST_BUCKETS + 2, np.int64),
                    np.empty(most, np.int32),
                ),
                sooner=np.empty(job.model.neighbours.shape[1], np.int64),
                rng=np.empty(5, np.uint64),
            )
            # A patch that is continued sorts its sites anew, so a slice is not much shorter than that takes.
            return _next_reaction.follow(
                run, first, last, self.chains(ramp), ramp, max(SLICE, largest)
            )

        run_pieces(job, follow, _pieces(starts), self.threads)
        return job.history(bonded(words), times=times, draws=draws)


def _pieces(starts: Array) -> list[tuple[int, int]]:
    """Runs of patches of about PIECE sites, the largest first, as (first patch, patch after the last)."""
    pieces = []
    first = 0
    patches = starts.size - 1
    while first < patches:
        last = int(np.searchsorted(starts, starts[first] + PIECE, side="right")) - 1
        last = min(max(last, first + 1), patches)
        pieces.append((first, last))
        first = last
    return sorted(
        pieces, key=lambda piece: int(starts[piece[0]] - starts[piece[1]])
    )


class Independent(KernelEngine, ThreadedEngine):
    """Sites that do not interact: exact, at a cost per site that does not depend on the number of its events.

    Where a site has many events before a hold time, its state and their number are drawn from the distributions of the
    alternating renewal process. Results are the same to the last bit on any number of threads. Lattices whose sites
    interact are refused.
    """

    kind = "independent"
    cite = ("Cox, Renewal Theory (Methuen, 1962), chapter 7",)
    bibtex = (COX,)
    interacting: ClassVar[bool] = False
    cost = (100e-9, 60e-9, 25)

    def expected(
        self, sites: float, interacting: bool, events: float | None = None
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`; whatever the events are."""
        return super().expected(sites, interacting)

    def _follow(self, job: Job, ramp: _common.RampBounds | None) -> BondHistory:
        n = job.lattice.sites.size
        times, draws = job.of_sites()
        sites = _independent.IndependentSites(
            key=job.key,
            pixels=job.lattice.random_index,
            forming=job.lattice.forming,
            model=job.model,
            state=job.state.copy(),
            times=times,
            draws=draws,
        )
        if job.resume is None:
            _independent.draw_times(sites, job.time)

        def follow(first: int, last: int, tally: Array) -> int:
            _independent.follow(
                sites,
                Holds(job.times, tally),
                ramp,
                np.empty(5, np.uint64),
                first,
                last,
            )
            return last

        pieces = [
            (first, min(first + SITE_PIECE, n)) for first in range(0, n, SITE_PIECE)
        ]
        run_pieces(job, follow, pieces, self.threads)
        return job.history(sites.state, times=times, draws=draws)

    def mean(
        self,
        lattice: ReactionLattice,
        hold_times: Sequence[float] | Array,
        *,
        temperature: float | str,
        start: BondHistory | Array | None = None,
    ) -> tuple[Array, Array]:
        """The exact mean number of bonds at each hold time, and its variance; both (m,), no sampling.

        ``start`` as for :meth:`run`: None (nothing bonded at time 0), a bool array (n,), or a history.
        """
        times, kelvin, start = self.checked(lattice, hold_times, temperature, start)
        job = Job(self.kind, lattice, times, kelvin, 0, start)
        mean, variance = np.empty(times.size), np.empty(times.size)
        sites = lattice.forming, job.model, job.state
        _independent.moments(*sites, times - job.time, mean, variance)
        return mean, variance


class Auto(FlickerEngine, ThreadedEngine):
    """The engine that suits the lattice; :meth:`choose` returns it, with the reason.

    ``many-states`` where sites have more than two states. ``independent`` where no site interacts with another.
    ``next-reaction`` for many sites in patches none of which holds most of them, and for several patches with
    ``superbasins``. Otherwise ``rejection-free``. All are exact, so the selection affects the sample and its cost and
    not its distribution. It depends on the lattice and ``superbasins`` alone, not on the number of threads.
    """

    kind = "auto"
    many_states: ClassVar[bool] = True

    def choose(self, lattice: ReactionLattice) -> tuple[KernelEngine, str]:
        """The engine for this lattice, and why."""
        if lattice.states is not None:
            return ManyStates(), f"sites are {', '.join(lattice.states)}"
        if lattice.neighbours is None:
            engine = Independent(threads=self.threads)
            return (
                engine,
                "no site interacts with another, so the closed form holds",
            )
        n = lattice.sites.size
        _, starts = patches_of(lattice.neighbours)
        patches, largest = starts.size - 1, int(np.diff(starts).max(initial=0))
        shape = f"the largest of {patches} patches holds {largest} of {n} sites"
        by_patch = NextReaction(threads=self.threads, superbasins=self.superbasins)
        if patches > 1 and self.superbasins:
            return (
                by_patch,
                f"{shape}: sites that flicker are followed patch by patch",
            )
        if n >= WORTH_SHARING and largest <= LARGEST_SHARE * n:
            return by_patch, f"{shape}: threads can share them"
        few = "few sites" if n < WORTH_SHARING else "most sites in one patch"
        by_tree = RejectionFree(superbasins=self.superbasins)
        return by_tree, f"{shape}: with {few} the sum tree costs least"

    def expected(
        self, sites: float, interacting: bool, events: float | None = None
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.Engine.expected`."""
        if not interacting:
            return Independent().expected(sites, interacting)
        return NextReaction(superbasins=self.superbasins).expected(
            sites, interacting, events
        )

    def warm_up(self, lattice: ReactionLattice, temperature: float) -> None:
        """Compile the engines between which a lattice of other size and patches may decide; the likelier one first."""
        if lattice.states is not None or lattice.neighbours is None:
            self.choose(lattice)[0].warm_up(lattice, temperature)
            return
        patches_of(lattice.neighbours)
        RejectionFree(superbasins=self.superbasins).warm_up(lattice, temperature)
        NextReaction(superbasins=self.superbasins).warm_up(lattice, temperature)

    def _run(
        self,
        lattice: ReactionLattice,
        hold_times: Array,
        temperature: float,
        seed: Seed,
        start: BondHistory | Array | None,
        ramp: Ramp | None = None,
    ) -> BondHistory:
        engine, reason = self.choose(lattice)
        how = hold_times, temperature, seed, start, ramp
        history = engine._run(lattice, *how)
        note = f"engine auto took {engine.kind}: {reason}"
        return history.model_copy(
            update={"engine": self.kind, "notes": (note, *history.notes)}
        )
