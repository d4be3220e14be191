"""The engine that pulls a contact, exactly, event by event; docs/pulling.md."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from chemage import InputError, ReactionLattice
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    Drive,
    Partners,
    PullHistory,
    Pulling,
    Ramp,
    Seed,
    random,
)
from chemage_kinetics import _pulling as kernel
from chemage_kinetics._common import Array, RampBounds, start_words
from chemage_kinetics._driver import SLICE, Start, bonded, parts_of
from chemage_kinetics._foreseen import Renewed, flips_on
from chemage_kinetics._rejection_free import empty_rates, fill

#: part of k_BT/Δx by which the force on a bond grows within a window
WINDOW = 1.0
#: windows that positions are counted in at most, so that their sums over the sites are whole numbers
MOST_WINDOWS = 2**31
#: arrays of a run from which the same pull goes on
_RESUMED = "reals", "counts", "made", "rest", "bound", "partner"
#: sums of a run, and what it has of the history from which it goes on
_CARRIED = (
    (kernel.WORK, "work"),
    (kernel.LOST, "dissipated"),
    (kernel.RUBBED, "rubbed"),
    (kernel.PEAK, "force"),
    (kernel.PEAK_AT, "displacement"),
    (kernel.MOVED_BEFORE, "displacement"),
)
#: columns of what is sampled
_SAMPLED = {
    "displacement": kernel.MOVED,
    "force": kernel.FORCE,
    "work": kernel.WORKED,
    "dissipated": kernel.DISSIPATED,
    "rubbed": kernel.FRICTION,
    "stored": kernel.STORED,
}
#: quantiles by which the barriers of new partners are estimated
FEW = 16


LEWIS = """@article{lewis1979,
  author = {Lewis, P. A. W. and Shedler, G. S.},
  title = {Simulation of nonhomogeneous {Poisson} processes by thinning},
  journal = {Naval Research Logistics Quarterly},
  volume = {26},
  pages = {403--413},
  year = {1979},
  doi = {10.1002/nav.3800260304},
}"""


class EventDriven(Pulling):
    """Every bond that forms and breaks is an event; rates that grow with the force are followed exactly, by thinning.

    A bond has the rate that it would have after a bounded way of the slider, and breaks with the probability of its
    present rate over that one. Between events the balance of spring, bonds and friction is solved in closed form.
    """

    kind = "event-driven"
    cite: ClassVar[tuple[str, ...]] = (
        "P. A. W. Lewis, G. S. Shedler, Nav. Res. Logist. Q. 26, 403 (1979)",
    )
    bibtex: ClassVar[tuple[str, ...]] = (LEWIS,)
    speed_only = ("most_events",)

    most_events: float = Field(default=1e8, gt=0, allow_inf_nan=False)
    """bonds that may form and break in one pull, and a tenth of the partners that sites may come to; a pull that has
    more is refused; 1e8 take 10 s to 2 minutes; default: 1e8"""

    def _run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: Array,
        temperature: float,
        seed: Seed,
        start: Any,
        partners: Partners | None,
        ramp: Ramp | None = None,
    ) -> PullHistory:
        """A ramp in parts, each followed at constant bounds of the rates; exact, whatever the parts are."""
        if ramp is None:
            how = lattice, times, temperature, seed, start, drive, partners
            return self._follow(_Job(self.kind, *how, lattice), None)
        begin = since = getattr(start, "time", 0.0)
        seen: list[PullHistory] = []
        assert ramp.lattice is not None
        assert ramp.speed is not None
        span = float(times[-1]) - begin
        rise = (ramp.speed - drive.speed) / span if span else 0.0
        lowest = lattice
        for part in parts_of(lattice, times, begin, temperature, ramp):
            lowest, until = part.lattice, float(part.times[-1])
            mean = drive.speed + rise * ((since + until) / 2 - begin)
            own, since = drive.replace(speed=mean), until
            how = part.lattice, part.times, part.temperature, seed, start
            job = _Job(self.kind, *how, own, partners, lattice, rise)
            start = self._follow(job, part.bounds)
            seen.append(start)
        end = drive.replace(speed=ramp.speed).todict()
        # the barriers of the last part are the lowest in it
        last = {
            name: getattr(start, name)
            + (getattr(ramp.lattice, name) - getattr(lowest, name))
            for name in ("forming", "breaking")
        }
        at_end = {"temperature": ramp.temperature, "drive": end}
        return PullHistory.of_parts(seen, **at_end, **last)

    def _follow(self, job: _Job, ramp: RampBounds | None) -> PullHistory:
        if job.met > 10 * self.most_events:
            raise InputError(
                f"times: sites are to meet {job.met:.2g} partners, more than ten times most_events = "
                f"{self.most_events:g}; pull less far, from where another pull can go on, or allow more events"
            )
        self._refuse_more(job.foreseen(self.most_events), job, "are expected to")
        run = job.prepared()
        while not run.counts[kernel.DONE]:
            kernel.advance(run, ramp, SLICE)
            done = run.counts[kernel.FORMED] + run.counts[kernel.BROKEN]
            done -= sum(job.counted)
            self._refuse_more(done, job, f"by {run.reals[kernel.HIGH]:.3g} s did")
        return job.finished(run)

    def _refuse_more(self, events: float, job: _Job, how: str) -> None:
        if events > self.most_events:
            raise InputError(
                f"times: about {events:.2g} bonds {how} form or break in a pull of "
                f"{float(job.times[-1]) - job.time:.3g} s, more than most_events = {self.most_events:g}; pull for a "
                "shorter time, from which another pull can go on, at a lower temperature, or with higher barriers, or "
                "allow more events"
            )


@dataclass(eq=False)
class _Job(Start):
    """One pull: the arguments of `Pulling._run`, the arrays made from them, and the result."""

    drive: Drive
    counterpart: Partners | None
    whole: ReactionLattice
    """the lattice for which there are partners; where the conditions change, that at the beginning"""
    rise: float = 0.0
    """nm/s², of the speed of the drive, which is a mean one"""

    def __post_init__(self) -> None:
        super().__post_init__()
        drive = self.drive
        self.before = self.start if isinstance(self.start, PullHistory) else None
        # the random numbers of the pending event are used up
        self.event = self.carried("event") + (
            self.pending is not None and "event" in self.pending
        )
        #: cell of the slider, where in it, and the partner of each bond
        self.cell, self.offset = self.carried("cell"), np.zeros(2)
        if self.pending is not None and "offset" in self.pending:
            self.offset = np.array(self.pending.offset("offset"))
        self.partner = self.carried_draws("partner")
        thermal = KB * self.temperature
        gain = (
            drive.bond_stiffness
            * drive.transition_distance
            * EV_PER_GPA_NM3
            / thermal
        )
        window = WINDOW / gain if gain > 0 else 1.0
        self.bonds = kernel.Bonds(
            np.empty(self.state.size),
            drive.exponent,
            gain,
            drive.bond_stiffness,
            window,
            thermal,
        )
        half = (float(self.times[-1]) - self.time) / 2
        self.pull = kernel.SliderDrive(
            drive.speed - self.rise * half,
            math.inf if drive.spring is None else drive.spring,
            drive.friction,
            self.rise,
            self.time,
        )
        self.partners = self._partners()
        self._refuse_too_much()
        if self.goes_on:
            assert self.before is not None
            self.cell = int(self.before.resume["counts"][kernel.CELL])
        self.forming, self.breaking, self.base = self._present(
            self.cell, self.state, self.partner
        )
        self.bonds.barrier[:] = np.maximum(self.breaking, 0.0) / thermal

    def _present(
        self, cell: int, state: Array, partner: Array
    ) -> tuple[Array, Array, Array]:
        """The barriers (eV) to forming a bond with the present partners and to breaking those there are, the former in
        fixed point as well; ``partner`` of sites without a bond is set."""
        n = state.size
        forming, breaking, base = np.empty(n), np.empty(n), np.empty(n, np.int64)
        where = self.partners, state, partner, forming, breaking, base
        kernel.present_barriers(cell, *where)
        forming.setflags(write=False)
        breaking.setflags(write=False)
        return forming, breaking, base

    def _partners(self) -> kernel.Counterpart:
        """What the sites meet."""
        lattice, there = self.lattice, self.counterpart
        assert lattice.breaking is not None
        assert self.whole.breaking is not None
        key = kernel.Key(*random.key(self.seed))
        own = np.array(lattice.forming), np.array(lattice.breaking)
        if there is None:
            none, empty = np.empty(0), np.empty(0, np.int64)
            kept = none, none, (none, none), empty, empty, math.inf, empty, empty
            return kernel.Counterpart(key, own, *kept, empty, empty)
        shift = (
            own[0] - self.whole.forming + there.shift,
            own[1] - self.whole.breaking,
        )
        pixels = np.array(lattice.random_index)
        phase = random.uniforms(self.seed, kernel.PHASE, pixels) * kernel.CELLS
        phase = phase.astype(np.int64)
        cells = (-phase & (kernel.CELLS - 1)).astype(np.int16)
        counts = np.bincount(cells, minlength=kernel.CELLS)
        some, every = (
            np.append(np.flatnonzero(counts), kernel.CELLS),
            np.arange(kernel.CELLS),
        )
        return kernel.Counterpart(
            key,
            own,
            np.array(there.forming, np.float64),
            np.array(there.breaking, np.float64),
            shift,
            pixels,
            phase,
            there.spacing / float(kernel.CELLS),
            np.argsort(cells, kind="stable"),
            np.append(0, np.cumsum(counts)),
            some[np.searchsorted(some, every, side="right")] - every,
            np.empty(counts.max(initial=0), np.int64),
        )

    def _refuse_too_much(self) -> None:
        """Refuse what would take for ever, or lose digits."""
        drive, span = self.drive, float(self.times[-1]) - self.time
        way = drive.speed * span if drive.spring != 0 else 0.0
        if way > MOST_WINDOWS * self.bonds.window:
            raise InputError(
                f"times: the drive moves by {way:.3g} nm, more than {MOST_WINDOWS} steps of "
                f"{self.bonds.window:.3g} nm, in which the force on a bond grows by k_BT/Δx; pull less far, or "
                "use a smaller bond_stiffness or transition_distance"
            )

    def foreseen(self, enough: float) -> float:
        """About how many bonds form and break, or a bound below ``enough``."""
        met, again = self.partners, None
        span, moves = float(self.times[-1]) - self.time, self.drive.speed
        passing = met.width * kernel.CELLS / moves if moves > 0 else math.inf
        if self.state.size and met.forming.size and passing < span:
            few = np.linspace(0, met.forming.size - 1, FEW).astype(int)
            again = Renewed(met.forming[few] + met.shift[0].mean(), passing)
        lattice = self.lattice.model_copy(update={"forming": self.forming})
        return flips_on(
            lattice, self.drive, span, self.temperature, self.state, again, enough
        )

    @property
    def met(self) -> float:
        """Partners that sites come to."""
        way = self.drive.speed * (float(self.times[-1]) - self.time)
        return self.state.size * way / (self.partners.width * kernel.CELLS)

    def identity(self) -> dict[str, Array]:
        """What must be equal for the pending event to hold."""
        pulled = [self.temperature, *self.bonds[1:], *self.pull[:3]]
        met = self.partners
        partners = [
            met.forming.sum(),
            met.breaking.sum(),
            *map(np.sum, met.shift),
            met.width,
        ]
        return {
            **super().identity(),
            "pulled": np.array(pulled, np.float64),
            "partners": np.array(partners),
        }

    @cached_property
    def goes_on(self) -> bool:
        """Whether the pending event of the pull before still holds: then this is the same pull."""
        return self.before is not None and self.holds_on()

    def prepared(self) -> kernel.PullRun:
        """The state of the contact at the start."""
        n, before = self.state.size, self.before
        words = np.empty(n, np.int64)
        start_words(self.forming, self.model, self.state, words)
        rates = empty_rates(n, self.model.neighbours.shape[1], listing=False)
        fill(words, self.model, rates)
        m = self.times.size
        run = kernel.PullRun(
            key=self.key,
            model=self.model._replace(breaking=np.array(self.breaking)),
            bonds=self.bonds,
            drive=self.pull,
            partners=self.partners,
            words=words,
            base=self.base,
            rates=rates,
            made=np.zeros(n, np.int64),
            rest=np.zeros(n),
            partner=self.partner,
            bound=np.zeros(n, np.int64),
            heads=np.full(kernel.RING, -1, np.int64),
            links=np.full((n, 2), -1, np.int64),
            reals=np.zeros(kernel.REALS),
            counts=np.zeros(kernel.COUNTS, np.int64),
            slip_sizes=np.zeros(64, np.int64),
            times=np.array(self.times),
            samples=np.zeros((m, 6)),
            tallies=np.zeros((m, 3), np.int64),
        )
        if before is not None:
            run.slip_sizes[:] = before.avalanches
        if before is not None and self.goes_on:
            for name in _RESUMED:
                getattr(run, name)[:] = before.resume[name]
        else:
            self._begin(run)
        run.counts[[kernel.HOLD, kernel.DONE]] = 0
        kernel.start(run, self.goes_on)
        return run

    def _begin(self, run: kernel.PullRun) -> None:
        """A pull that begins, or goes on under other conditions: bonds keep their stretch, the rest is drawn anew."""
        before, bonds, reals, counts = (
            self.before,
            self.bonds,
            run.reals,
            run.counts,
        )
        reals[kernel.HIGH] = self.time
        counts[kernel.BONDS] = int(np.count_nonzero(self.state))
        counts[kernel.FORMED], counts[kernel.BROKEN] = self.counted
        counts[kernel.FIRST], counts[kernel.EVENT] = 1, self.event
        counts[kernel.CELL] = self.cell
        reals[[kernel.OFFSET, kernel.OFFSET_LOW]] = self.offset
        force = 0.0
        if before is not None:
            run.rest[:] = -before.stretch
            reals[kernel.SUM_REST] = math.fsum(run.rest[self.state])
            for place, name in _CARRIED:
                reals[place] = getattr(before, name)[-1]
            reals[kernel.LARGEST] = before.largest_drop
            reals[kernel.PEAK_TIME], force = self.time, float(before.force[-1])
        # a spring has the force that there was; what it does not carry is held by the friction of the slider
        reals[kernel.PULL] = force if self.pull.spring > 0 else 0.0
        counts[kernel.RESTS] = math.isfinite(self.pull.spring)
        drive = self.drive.todict()
        if before is not None and any(
            drive[name] != before.drive.get(name)
            for name in ("spring", "bond_stiffness")
        ):
            stored = 0.5 * bonds.stiffness * float((before.stretch**2).sum())
            if 0 < self.pull.spring < math.inf:
                stored += 0.5 * force**2 / self.pull.spring
            # another spring or stiffness: what it takes up counts as work, what it releases as lost
            change = stored - float(before.stored[-1])
            reals[kernel.WORK if change > 0 else kernel.LOST] += abs(change)
        reals[kernel.TOP] = force

    def finished(self, run: kernel.PullRun) -> PullHistory:
        """The result, with what is needed to go on."""
        reals = run.reals
        curves = {name: run.samples[:, at] for name, at in _SAMPLED.items()}
        bonds, formed, broken = run.tallies.T
        state, stretch = bonded(run.words), np.zeros(run.words.size)
        offset = np.zeros(2)
        kernel.ended(run, offset, stretch)
        cell = run.counts[[kernel.CELL]]
        forming, breaking, _ = self._present(int(cell[0]), state, run.partner)
        force, displacement = curves["force"], curves["displacement"]
        highest = int(np.argmax(force))
        peaks = [
            (reals[kernel.PEAK], reals[kernel.PEAK_AT], reals[kernel.PEAK_TIME]),
            (force[highest], displacement[highest], self.times[highest]),
        ]
        if self.goes_on:
            assert self.before is not None
            earlier = self.before
            peaks.append(
                (earlier.peak, earlier.peak_displacement, earlier.peak_time)
            )
        peak, at, when = map(float, max(peaks, key=lambda one: one[0]))
        resume = {name: getattr(run, name) for name in _RESUMED}
        resume |= {"event": run.counts[[kernel.EVENT]], "cell": cell}
        return PullHistory(
            times=self.times,
            **curves,
            bonds=bonds,
            formed=formed,
            broken=broken,
            state=state,
            stretch=stretch,
            forming=forming,
            breaking=breaking,
            avalanches=run.slip_sizes,
            largest_drop=float(reals[kernel.LARGEST]),
            peak=peak,
            peak_displacement=at,
            peak_time=when,
            time=float(self.times[-1]),
            temperature=self.temperature,
            engine=self.kind,
            drive=self.drive.todict(),
            least=float(reals[kernel.LEAST]),
            resume={**self.identity(), **resume, "offset": offset},
        )
