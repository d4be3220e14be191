"""Checks of a kinetic Monte Carlo engine."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from chemage.foundation.components import call_with
from chemage.foundation.units import KB
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.testing.answers import as_bytes, independent_calls
from chemage.testing.checks import (
    Checks,
    Questions,
    known,
    naming,
    refuses,
    require,
    require_estimates,
    seeds_are_harmless,
    whole,
)
from chemage.testing.small_systems import (
    COPIES,
    FLICKERING,
    LARGE,
    NU,
    TEMPERATURE,
    Group,
    agree,
    barrier,
    coupled,
    reacting,
    single,
    states,
)
from chemage.testing.trials import TRIALS, Trial, history_of

check_engine = whole(Engine)

#: in which sites are compared with their master equation
SITUATIONS = (
    *TRIALS,
    Trial(idle=70_000, hold_times=1, temperature=450.0),
    Trial(
        idle=70_000, hold_times=1, spacing=0.5, coupled=False, start="after hold"
    ),
)
TWO_TIMES = Trial(hold_times=2)


def _trace(history: BondHistory) -> tuple[bytes, ...]:
    parts = (history.bonds, history.formed, history.broken, history.state)
    return tuple(part.tobytes() for part in parts)


class EngineChecks(Checks[Engine], of=Engine):
    """What every engine must do."""

    def _run(
        self, lattice: ReactionLattice, times: Any, seed: Any = 0, start: Any = None
    ) -> BondHistory:
        return self.component.run(
            lattice, times, temperature=TEMPERATURE, seed=seed, start=start
        )

    def _disordered(
        self, *rings: int, interacting: bool = True, precision: Any = np.float32
    ) -> ReactionLattice:
        """Rings of sites with rates over five decades, by default one of 40; with an interaction of nearest neighbours
        where the engine treats it, by default in single precision, so that few kernels are compiled. An engine can
        distribute several rings over threads: their sites are mixed."""
        rng = np.random.default_rng(7)
        rings = rings or (40,)
        n = sum(rings)
        fields: dict[str, Any] = {"sites": np.arange(n)}
        for name, fastest in (("forming", 2), ("breaking", 1)):
            fields[name] = barrier(10 ** rng.uniform(-3, fastest, n))
        if interacting and self.component.interacting:
            order, pair = rng.permutation(n), rng.uniform(-0.05, 0.1, n)
            blocks = np.split(np.arange(n), np.cumsum(rings)[:-1])
            before, after = (
                np.concatenate([np.roll(block, step) for block in blocks])
                for step in (1, -1)
            )
            fields["neighbours"] = np.argsort(order)[
                np.stack([after, before], axis=1)
            ][order]
            pairs = np.stack([pair, pair[before]], axis=1)[order].astype(precision)
            fields["coupling"] = pairs
        return ReactionLattice(pixels=(n, 1), **fields)

    def questions(self) -> Questions:
        def ask(lattice: ReactionLattice, **changes: Any) -> Any:
            fields = {
                name: changes.pop(name)
                for name in [*changes]
                if name in ReactionLattice.model_fields
            }
            how = {
                "hold_times": np.array([0.013, 1.7, 43.0]),
                "temperature": TEMPERATURE,
                "seed": 31,
                **changes,
            }
            return lambda engine: _trace(
                engine.run(lattice.model_copy(update=fields), **how)
            )

        for number in range(31, 40):
            lattice = self._disordered(number)
            changes: dict[str, dict[str, Any]] = {
                "of which every third is bonded at first": {
                    "start": np.arange(number) % 3 == 0
                },
                "with their forming barriers in another order": {
                    "forming": lattice.forming[::-1]
                },
                "at another temperature": {"temperature": 317.0},
                "with another seed": {"seed": 32},
                "at other hold times": {"hold_times": (0.017, 1.3, 41.0)},
                "with another attempt frequency": {"attempt_frequency": 7e12},
                "in pixels of another size": {"pixel_size": 2.1},
                "with their breaking barriers in another order": {
                    "breaking": np.asarray(lattice.breaking)[::-1]
                },
                "whose bonds last": {"breaking": None},
            }
            what = list(changes)[number - 31]
            yield f"{number} sites", ask(lattice)
            yield f"{number} sites {what}", ask(lattice, **changes[what])
        for interacting in sorted({False, self.component.interacting}):
            yield (
                f"279 sites, interacting={interacting}",
                ask(self._disordered(119, 7, 60, 3, 90, interacting=interacting)),
            )
        for trial in TRIALS:
            if self.component.interacting or not trial.coupled:
                how = {"hold_times": trial.times, "temperature": trial.temperature}
                yield repr(trial), ask(trial.replica().lattice, **how)
        if self.component.interacting:
            group, time, kelvin = FLICKERING["1 by 2 sites"]
            yield (
                "a site that flickers",
                ask(group.lattice(3), hold_times=[time], temperature=kelvin),
            )

    def _trials(self, copies: int = COPIES, runs: int = 200) -> tuple[int, int]:
        """How many groups on how many lattices: of an approximate engine few large ones, as it may round the bonds."""
        return (copies, runs) if self.component.exact else (LARGE, 8)

    def _follows(
        self,
        where: str,
        group: Group,
        time: float,
        trial: Trial = TWO_TIMES,
        *,
        copies: int = COPIES,
        runs: int = 200,
        slots: int = 0,
        begin: int = 0,
    ) -> None:
        """Require that groups follow their master equation to ``time`` s, over many seeds, from their state ``begin``:
        their bonds at as many hold times as the trial has, and their states at the end."""
        copies, runs = self._trials(copies, runs)
        runs = (
            min(runs, 3) if trial.idle else runs
        )  # which the simplest engines search
        m, number = len(group.forming), trial.times.size
        first, times = 0.0, time * np.arange(1, number + 1) / number
        after, probabilities = where, np.zeros(0)
        bonds, counts = np.zeros(number), np.zeros(2**m, np.int64)
        placed = [
            trial.but(seed=seed).placed(group, copies, slots)
            for seed in range(5 if slots else 1)
        ]
        for seed in range(runs):
            lattice, places = placed[seed % len(placed)]
            start: Any = np.zeros(lattice.sites.size, dtype=bool)
            start[:] = begin > 0
            start[places] = np.tile(begin >> np.arange(m) & 1 == 1, copies)
            if trial.start != "fresh":
                first, start = 1e3 * time, trial.before(lattice, start, 1e3 * time)
            history = self.component.run(
                lattice,
                first + times,
                temperature=trial.temperature,
                seed=seed,
                start=start if trial.start != "fresh" or begin else None,
            )
            bonds += history.bonds - (begin > 0) * trial.idle
            counts += states(history.state[places], m)
        with naming(trial):
            for at, count in zip(times, bonds, strict=True):
                probabilities = group.probabilities(
                    at, trial.temperature, trial.attempt_frequency, begin
                )
                after = f"{where}, after {at:.3g} s"
                self._mean(after, count, copies * runs, probabilities)
            self._compare(after, counts, probabilities)

    def _mean(
        self, where: str, count: float, groups: int, probabilities: np.ndarray
    ) -> None:
        """Require that so many ``groups`` have ``count`` bonds, within the noise and the declared error."""
        bonds = np.array([state.bit_count() for state in range(probabilities.size)])
        expected = float(probabilities @ bonds)
        noise = math.sqrt(float(probabilities @ (bonds - expected) ** 2) / groups)
        # and half a bond per lattice, for rounding, or some of rare ones
        more = 10 / groups if self.component.exact else 0.5 / LARGE
        error = self.component.declared_error or 0.0
        require(
            abs(count / groups - expected) <= error * expected + 6.5 * noise + more,
            f"{where}, {count / groups:.4g} bonds per group; the master equation gives {expected:.4g}; "
            f"declared_error={error}",
        )

    def _compare(
        self, where: str, counts: np.ndarray, probabilities: np.ndarray
    ) -> None:
        """Require that ``counts`` of groups in each state agree with the ``probabilities`` of the master equation; of
        an approximate engine, the mean number of bonds."""
        if self.component.exact:
            agree(where, counts, probabilities)
        else:
            bonds = [state.bit_count() for state in range(counts.size)]
            total = int(counts.sum())
            self._mean(where, float(counts @ bonds), total, probabilities)

    def _compare_mean(
        self, where: str, bonds: Sequence[int], of: int, probability: float
    ) -> None:
        """Require that the ``bonds`` of runs with ``of`` independent sites each agree with ``probability``."""
        count, total = int(np.sum(bonds)), of * len(bonds)
        self._compare(
            where,
            np.array([total - count, count]),
            np.array([1 - probability, probability]),
        )

    # -- the form of the answer ----------------------------------------------------------------------------------------

    def history_adds_up(self) -> None:
        """Hold times, temperature and kind are those of the run; bonds are formed less broken; the last count is the
        final state's."""
        times = np.geomspace(1e-3, 1e3, 13)
        lattice = self._disordered(precision=np.float64)
        history = self._run(lattice, times, 1)
        require(
            isinstance(history, BondHistory),
            f"run() returned {type(history).__name__}; expected a BondHistory",
        )
        require(
            np.array_equal(history.hold_times, times),
            "the hold times are not the given ones",
        )
        bonds = history.bonds
        formed = history.formed
        broken = history.broken
        state = history.state
        require(
            state.shape == lattice.sites.shape,
            f"state of {state.shape} for {lattice.sites.size} sites",
        )
        require(
            (bonds >= 0).all() and (bonds <= state.size).all(),
            f"{bonds} bonds on {state.size} sites",
        )
        require(
            bonds[-1] == state.sum(),
            f"the last count is {bonds[-1]} bonds; the final state has {state.sum()}",
        )
        require(
            np.array_equal(bonds, formed - broken),
            "bonds are not formed less broken",
        )
        require(
            (np.diff([formed, broken]) >= 0).all(), "the numbers of events decrease"
        )
        require(
            history.events > 0,
            "nothing happened in 1000 s at rates up to 100 per second",
        )
        require(
            history.time == times[-1] and history.temperature == TEMPERATURE,
            f"wrong time or temperature: {history.time} s at {history.temperature} K; expected {times[-1]} s at 300 K",
        )
        # an engine that selects another one records which
        kinds = {
            self.component.kind,
            *registry.current().kinds(self.component.role),
        }
        require(
            history.engine in kinds,
            f"engine is {history.engine!r}, neither {self.component.kind!r} nor an installed one",
        )

    def engine_cost_is_estimated(self) -> None:
        """``expected()`` returns finite costs, also for no sites and for ten million, no events and 1e12 a site."""
        for sites, events in product((0.0, 1.0, 1e7), (None, 0.0, 1e12)):
            expected = call_with(
                self.component.expected,
                sites,
                self.component.interacting,
                events=events,
            )
            names = (
                "cpu_seconds",
                "cpu_seconds_least",
                "cpu_seconds_most",
                "bytes",
            )
            require_estimates(f"expected({sites})", expected, *names)

    def error_is_declared(self) -> None:
        """An approximate engine (``exact = False``) has a ``declared_error``."""
        require(
            self.component.exact or self.component.declared_error is not None,
            "exact = False and declared_error = None; declare the largest relative error of the mean number of bonds",
        )

    def run_follows_its_seed(self) -> None:
        """The same seed gives the same bytes, other seeds give others (an approximate engine may ignore it), and no
        global random state is used."""
        lattice = self._disordered(100)
        seeds_are_harmless(
            lambda seed: _trace(self._run(lattice, [0.1, 1, 10], seed)),
            "run",
            chance=self.component.exact,
        )

    calls_are_independent = independent_calls

    def no_sites_is_no_bonds(self) -> None:
        """A lattice without sites is run, and has no bonds."""
        graphs: list[dict[str, Any]] = [{}, {"breaking": np.empty(0)}]
        if self.component.interacting:
            graphs += [
                {
                    "neighbours": np.empty((0, k), np.int32),
                    "coupling": np.empty((0, k)),
                }
                for k in (0, 8)
            ]
        for graph in graphs:
            empty = ReactionLattice(
                pixels=(3, 3),
                sites=np.empty(0, np.int64),
                forming=np.empty(0),
                **graph,
            )
            history = self._run(empty, [0, 1e5])
            require(
                history.bonds.tolist() == [0, 0] and history.events == 0,
                f"{history.bonds} bonds without sites",
            )

    def nothing_happens_at_rate_zero(self) -> None:
        """A lattice whose total rate is 0, also by underflow, does not change and is not an error."""
        for energy in (25.0, 1e4):
            history = self._run(Group((energy,)).lattice(7), [0, 1, 1e5])
            require(
                history.events == 0 and history.time == 1e5,
                f"{history.events} events over {energy} eV",
            )

    # -- the rates -----------------------------------------------------------------------------------------------------

    @known
    def one_site_is_the_closed_form(self) -> None:
        """θ(t) = k_f/(k_f + k_b) (1 − exp(−(k_f + k_b) t)), and as many bonds are formed as it takes: one site with
        many seeds, and many sites."""
        forming, total = 2.0, 2.7
        times = np.array([0.02, 0.3, 1.0, 2.5])
        theta = forming / total * (1 - np.exp(-total * times))
        # the mean number of bonds formed by t, ∫ k_f (1 − θ) dt
        formed = forming * (times - (forming * times - theta) / total)
        for copies, number in (
            ((48, 400), (600, 1), (1, 400))
            if self.component.exact
            else ((LARGE, 8),)
        ):
            lattice = single(forming, total - forming).lattice(copies)
            runs = [self._run(lattice, times, seed) for seed in range(number)]
            for at, t in enumerate(times):
                where = f"sites that form bonds at 2 per second and break them at 0.7 per second: after {t} s"
                self._compare_mean(
                    where, [run.bonds[at] for run in runs], copies, float(theta[at])
                )
                events = int(sum(run.formed[at] for run in runs))
                expected = formed[at] * copies * number
                # alternating events scatter less than independent ones
                require(
                    not self.component.exact
                    or abs(events - expected) < 6.5 * math.sqrt(expected) + 6.5,
                    f"{where}, {events} bonds were formed; expected {expected:.0f}",
                )
            states_at_end = np.sum([states(run.state, 1) for run in runs], axis=0)
            self._compare(
                "in the final states",
                states_at_end,
                np.array([1 - theta[-1], theta[-1]]),
            )

    @known
    def sites_keep_their_own_rates(self) -> None:
        """Each site reacts over its own barriers, wherever its pixel is: the positions in the list are not the
        pixels."""
        for time in (0.3, 1.5):
            self._follows(
                "sites with different barriers",
                reacting((4.0, 0.25, 1.0), (0.1, 0.5, 2.0)),
                time,
            )

    @known
    def rates_follow_the_temperature(self) -> None:
        """The same barrier is crossed at the rate ν exp(−E/k_B T) of each temperature."""
        group = single(1.0)
        for kelvin in (260.0, 350.0, 900.0):
            time = math.exp(group.forming[0] / (KB * kelvin)) / NU
            where = f"over {group.forming[0]:.4g} eV"
            self._follows(where, group, time, TWO_TIMES.but(temperature=kelvin))

    def rates_follow_the_attempt_frequency(self) -> None:
        """Rates are proportional to the attempt frequency of the lattice."""
        for nu in (1e10, 4e15):
            trial = TWO_TIMES.but(attempt_frequency=nu)
            self._follows("over one barrier", single(1.0), NU / nu, trial)

    @known
    def barrierless_is_the_attempt_frequency(self) -> None:
        """The rate over a barrier at or below zero is the attempt frequency ν."""
        for energy in (0.0, -0.3, -50.0):
            for time in (2e-14, 1e-13):
                self._follows(
                    f"over a barrier of {energy:g} eV (ν = 1e13 Hz)",
                    Group((energy,)),
                    time,
                )

    def rates_span_many_decades(self) -> None:
        """Slow sites keep their rates of 1e-6 per second beside fast ones of 1e12: a total that is kept up by adding
        and subtracting rates is lost in rounding."""
        slow, time = (1e-6, 4e-6), 2e5
        rng = np.random.default_rng(5)
        copies, runs = self._trials(8, 100)
        many, early, bonded = 2 * copies, [], np.zeros(2, dtype=np.int64)
        for seed in range(runs):
            rates = np.concatenate(
                [np.tile(slow, copies), 10 ** rng.uniform(11, 12.5, many)]
            )
            place = rng.permutation(rates.size)
            history = self._run(
                reacting(rates[place].tolist()).lattice(1), [1.0, time], seed
            )
            state = history.state[np.argsort(place)]
            early.append(int(history.bonds[0]) - many)
            bonded += state[:many].reshape(-1, 2).sum(axis=0)
            require(
                state[many:].all(),
                f"sites with rates above 1e11 per second are not bonded after {time:g} s",
            )
        self._compare_mean("of the slow sites, after 1 s", early, many, 2.5e-6)
        for rate, count in zip(slow, bonded, strict=True):
            where = f"sites with a rate of {rate:g} per second among sites with rates of 1e12, after {time:g} s"
            self._compare_mean(
                where, [int(count)], copies * runs, 1 - math.exp(-rate * time)
            )

    def hold_times_may_coincide(self) -> None:
        """There are no bonds at time 0; repeated hold times have equal counts and do not change the others."""
        lattice = self._disordered()
        once, twice, at_zero, only = (
            self._run(lattice, times, 3)
            for times in ([0.5, 20], [0.5, 0.5, 20, 20], [0, 0, 20], [0.0])
        )
        require(
            twice.bonds.tolist() == np.repeat(once.bonds, 2).tolist(),
            f"{twice.bonds} where once gave {once.bonds}",
        )
        require(
            np.array_equal(once.state, twice.state),
            "a repeated hold time changes the final state",
        )
        require(
            at_zero.bonds[:2].tolist() == [0, 0],
            f"{at_zero.bonds[0]} bonds at time 0",
        )
        require(
            only.bonds.tolist() == [0] and only.events == 0 and only.time == 0,
            f"{only.events} events by time 0",
        )

    def bonds_last_without_breaking(self) -> None:
        """On a lattice without breaking barriers no bond breaks, and every site is bonded in the end."""
        n = 600
        history = self._run(single(1.0).lattice(n), [0.1, 1.0, 1.0, 2.0, 50.0], 5)
        require(
            (history.broken == 0).all(),
            f"{history.broken[-1]} bonds broke on a lattice without breaking",
        )
        require((np.diff(history.bonds) >= 0).all(), f"bonds {history.bonds}")
        require(
            history.bonds[-1] == n,
            f"{history.bonds[-1]} of {n} bonded after fifty times the mean time",
        )

    # -- interaction ---------------------------------------------------------------------------------------------------

    @known
    def coupled_sites_are_refused_or_right(self) -> None:
        """Four coupled sites follow their master equation of 16 states, or are refused with an InputError."""
        if not self.component.interacting:
            message = refuses(
                "a lattice whose sites interact",
                lambda: self._run(coupled().lattice(), [1.0]),
            )
            require(
                self.component.kind in message,
                f"the error does not name the engine: {message}",
            )
            return
        for time in (0.3, 2.0):
            self._follows("four coupled sites", coupled(), time)

    def empty_slots_are_skipped(self) -> None:
        """Entries -1 in ``neighbours`` mean no neighbour, wherever they stand among the slots."""
        if not self.component.interacting:
            return
        self._follows(
            "four coupled sites with empty neighbour slots between the others",
            coupled(),
            1.0,
            slots=3,
        )
        # a single-precision coupling, and sites without any neighbour
        alone = reacting([1.0, 1.0], pair=((0.0, 0.0), (0.0, 0.0)))
        self._follows(
            "sites all of whose neighbour slots are empty",
            alone,
            1.0,
            copies=200,
            runs=1,
            slots=1,
        )

    def barriers_end_at_zero(self) -> None:
        """Neighbours are added to the barrier first, and a sum below zero counts as zero then."""
        if not self.component.interacting:
            return
        lowered = Group((0.0, 0.2), (0.05, 0.3), ((0.0, -1.0), (-1.0, 0.0)))
        raised = Group((-0.3, 0.0), (0.05, 0.3), ((0.0, 0.33), (0.33, 0.0)))
        for group, how in (
            (lowered, "lowers from 0.2 to -0.8 eV"),
            (raised, "raises from -0.3 to 0.03 eV"),
        ):
            self._follows(
                f"over a barrier that a bonded neighbour {how}", group, 2e-13
            )

    # -- starting and going on -----------------------------------------------------------------------------------------

    def start_is_taken(self) -> None:
        """A run begins with the bonds that are given, and goes on from them."""
        lattice = self._disordered()
        start = np.arange(lattice.sites.size) % 3 == 0
        history = self._run(lattice, [0, 100], 4, start)
        require(
            history.bonds[0] == start.sum(),
            f"{history.bonds[0]} bonds at time 0, started with {start.sum()}",
        )
        gained = history.formed - history.broken
        require(
            np.array_equal(history.bonds, start.sum() + gained),
            "bonds are not those at the start plus those formed",
        )
        full = self._run(single(1.0).lattice(7), [1, 1e5], start=np.ones(7, bool))
        require(
            full.bonds.tolist() == [7, 7] and full.events == 0,
            "all sites are bonded for good, but the state changed",
        )
        for wrong in (start[:-1], start.astype(int), np.ones((2, 2), bool)):
            refuses(
                "a wrong start",
                lambda wrong=wrong: self._run(lattice, [1], start=wrong),
            )
        self._follows(
            "from all sites bonded", reacting((2.0, 0.3), (0.7, 1.5)), 0.6, begin=3
        )

    def going_on_counts_from_the_history(self) -> None:
        """A run that goes on from a history has its bonds, its clock and its numbers of events to begin with."""
        lattice = self._disordered()
        first = self._run(lattice, [0.1, 2.0], 6)
        rest = self._run(lattice, [2.0, 2.0, 50.0], 6, first)
        for name in ("bonds", "formed", "broken"):
            was, now = int(getattr(first, name)[-1]), int(getattr(rest, name)[0])
            require(
                was == now,
                f"{name} is {was} at 2 s, and {now} at 2 s in the run that goes on from there",
            )
        require(
            np.array_equal(rest.bonds, rest.formed - rest.broken),
            "bonds are not formed less broken over both runs",
        )
        require(
            rest.hold_times.tolist() == [2.0, 2.0, 50.0],
            f"the hold times are {rest.hold_times}, not 2, 2 and 50 s",
        )
        require(
            rest.time == 50.0, f"the time at the end is {rest.time} s, not 50 s"
        )
        refuses("going back", lambda: self._run(lattice, [0.5], 6, first))
        refuses(
            "another lattice",
            lambda: self._run(single(1.0).lattice(31), [3.0], 6, first),
        )

    def going_on_keeps_the_rates(self) -> None:
        """A run that goes on from a history with the same seed has the right rates from there on: neither the clock nor
        the random numbers begin again, and a new temperature counts."""
        group = single(1.0)
        for copies, runs in (
            ((1, 400), (12, 100)) if self.component.exact else ((LARGE, 8),)
        ):
            lattice = group.lattice(copies)
            for kelvin in (300.0, 330.0):
                end = 1.0 + 0.3 * math.exp(group.forming[0] / (KB * kelvin)) / NU
                unbonded = gained = 0
                for seed in range(runs):
                    first = self._run(lattice, [1.0], seed)
                    rest = self.component.run(
                        lattice, [end], temperature=kelvin, seed=seed, start=first
                    )
                    unbonded += copies - int(first.bonds[-1])
                    gained += int(rest.bonds[-1] - first.bonds[-1])
                where = f"{unbonded} sites unbonded at 1 s, going on to {end:.4g} s at {kelvin:g} K (same seed)"
                self._compare_mean(where, [gained], unbonded, 1 - math.exp(-0.3))
        by_hand = history_of(
            group.lattice(400),
            [1e7],
            np.zeros((1, 400), dtype=bool),
            TEMPERATURE,
            "another",
        )
        bonds = self._run(group.lattice(400), [1e7 + 1], 1, by_hand).bonds.tolist()
        self._compare_mean(
            "1 s after a history of 1e7 s of another engine",
            bonds,
            400,
            1 - math.exp(-1),
        )

    def sites_of_one_pixel_are_independent(self) -> None:
        """Two sites in one pixel, which do not interact, form their bonds independently (not of an approximate
        engine)."""
        if (
            not self.component.exact
        ):  # it may choose the bonded sites without chance
            return
        pixels = 2000
        sites = np.repeat(np.arange(pixels), 2)
        x = np.stack(
            [sites + np.tile([0.25, 0.75], pixels), np.full(sites.size, 0.5)],
            axis=1,
        )
        forming = np.full(sites.size, barrier(math.log(2)))
        lattice = ReactionLattice(
            pixels=(pixels, 1), sites=sites, positions=x, forming=forming
        )
        state = self._run(lattice, [1.0], 4).state.reshape(pixels, 2)
        both, (one, other) = int(state.all(axis=1).sum()), state.sum(axis=0)
        expected = one * other / pixels
        # within five standard deviations; with the same random numbers for both sites it would be 45 of them
        require(
            abs(both - expected) < 5 * math.sqrt(pixels / 16),
            f"{pixels} pixels with two sites each, half of which are bonded: both are in {both} pixels, expected about "
            f"{expected:.0f}; take random numbers by lattice.random_index, not by the pixel",
        )

    @known
    def situations_keep_the_rates(self) -> None:
        """Sites follow their master equation in every situation: wherever they lie, beside 70,000 others, at any
        temperature and attempt frequency, after a hold and after a pull, at each of 1 to 100 hold times."""
        alone = reacting((3.0, 1.0), (0.5, 1.5))
        for trial in SITUATIONS:
            group = alone
            if trial.coupled and self.component.interacting:
                group = coupled()
            if not trial.breaking:
                group = Group(group.forming, None, group.pair)
            group = group.at(trial.temperature, trial.attempt_frequency)
            copies = 100 if trial.idle else COPIES
            where = "coupled sites" if group.pair else "sites"
            begin = 2 if trial.start != "fresh" else 0
            self._follows(
                where, group, 0.8, trial, copies=copies, runs=100, begin=begin
            )

    def later_hold_times_change_nothing(self) -> None:
        """The first of many hold times have the counts that they have alone."""
        trial = Trial(coupled=self.component.interacting, hold_times=100)
        lattice, times = trial.replica().lattice, trial.times
        whole = self._run(lattice, times, 8)
        for number in (1, 5, 64, 99):
            first = self._run(lattice, times[:number], 8)
            for name in ("bonds", "formed", "broken"):
                alone, with_more = (
                    getattr(first, name),
                    getattr(whole, name)[:number],
                )
                require(
                    np.array_equal(alone, with_more),
                    f"{name} at the first {number} of 100 hold times: {alone[-3:]} at the last of them, and "
                    f"{with_more[-3:]} where later ones follow",
                )
            require(
                first.bonds[-1] == first.state.sum(),
                f"the state after {number} hold times has other bonds than are counted",
            )

    @known
    def restart_is_exact(self) -> None:
        """A run continued from any hold time equals the uninterrupted run to the last bit, where ``restart`` is
        true."""
        if not self.component.restart:
            return
        times = np.array([0.0, 1e-3, 0.1, 0.1, 1.0, 30.0, 1e3])
        for lattice in (
            self._disordered(),
            self._disordered(interacting=False),
            single(1.0).lattice(30),
        ):
            whole = self._run(lattice, times, 6)
            for cut in range(1, times.size):
                first = self._run(lattice, times[:cut], 6)
                kept = pickle.loads(pickle.dumps(first))  # also after it was stored
                rest = self._run(lattice, times[cut:], 6, kept)
                where = f"continued from {times[cut - 1]} s"
                for name in ("bonds", "formed", "broken"):
                    mine = np.concatenate(
                        [getattr(first, name), getattr(rest, name)]
                    )
                    its = getattr(whole, name)
                    require(
                        np.array_equal(mine, its),
                        f"{where}: {name} {mine}, uninterrupted {its}",
                    )
                require(
                    np.array_equal(rest.state, whole.state),
                    f"{where}: the final state differs",
                )
                require(rest.time == whole.time, f"{where}: the time differs")
                both = kept.then(rest).observables
                lost = [
                    name
                    for name, values in whole.observables.items()
                    if as_bytes(both.get(name)) != as_bytes(values)
                ]
                require(
                    not lost and both.keys() == whole.observables.keys(),
                    f"{where}: recorded are {', '.join(both) or 'no outputs'}, and {', '.join(lost)} differs; "
                    f"uninterrupted {', '.join(whole.observables)}",
                )

    # -- speed ---------------------------------------------------------------------------------------------------------

    def threads_change_nothing(self) -> None:
        """Results are the same on one thread and on all."""
        import numba

        lattice = self._disordered(100)
        alone = _trace(self._run(lattice, [0.1, 10.0]))
        threads = numba.get_num_threads()
        try:
            numba.set_num_threads(1)
            same = _trace(self._run(lattice, [0.1, 10.0])) == alone
        finally:
            numba.set_num_threads(threads)
        require(same, "one thread and several gave different results")

    def trade_keeps_the_rates(self) -> None:
        """Every value of ``trade`` gives the right mean number of bonds, to within the declared error."""
        group, time = (
            (coupled(), 1.0)
            if self.component.interacting
            else (single(2.0, 0.7), 0.3)
        )
        for _, variants in self.trade_variants():
            for what, variant in variants:
                EngineChecks(variant)._follows(what, group, time, runs=100)

    def options_keep_the_rates(self) -> None:
        """With every switch, choice and option for speed, a site that flickers and those around it follow their master
        equation, at rates over 60 decades."""
        for what, variant in self.option_variants():
            for sites, (group, time, kelvin) in FLICKERING.items():
                if self.component.interacting or group.pair is None:
                    EngineChecks(variant)._follows(
                        f"{what}: {sites}",
                        group,
                        time,
                        TWO_TIMES.but(temperature=kelvin),
                        copies=1,
                        runs=250,
                    )

    def wrong_input_is_refused(self) -> None:
        """Wrong hold times, temperatures and seeds are InputErrors; temperatures may have units."""
        lattice = self._disordered(5, interacting=False)
        right: dict[str, Any] = {
            "hold_times": [1.0],
            "temperature": TEMPERATURE,
            "seed": 1,
        }
        wrong: dict[str, list[Any]] = {
            "hold_times": [
                [],
                [2, 1],
                [-1],
                [math.nan],
                [math.inf],
                ["soon"],
                [[1, 2]],
            ],
            "temperature": [0, -3, math.nan, math.inf, "3 eV", "300"],
            "seed": [-1, 0.5, "x"],
        }
        for name, values in wrong.items():
            for value in values:
                given = right | {name: value}
                refuses(
                    f"{name} {value!r}",
                    lambda given=given: self.component.run(lattice, **given),
                )
        warm = self.component.run(lattice, [1.0], temperature="26.85 degC", seed=1)
        require(
            _trace(warm) == _trace(self.component.run(lattice, **right)),
            "26.85 degC is not 300 K",
        )
