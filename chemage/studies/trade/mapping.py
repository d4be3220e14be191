"""Measures the map of speed against accuracy: every setting and combinations of them, on several surfaces, repeatedly.

In each round all settings are computed on one surface with one set of random numbers, one after the other, and compared
with a reference that is more accurate than all of them: the most accurate values of every component, and the kinetics
of every site. Rounds differ by their seeds. A difference from the reference is therefore paired, surface by surface and
replica by replica, and its standard error is that of the differences between rounds; where the seed does not change the
surface, between replicas. An exact engine is compared with a reference that it has aged itself, because engines share
the disorder but not the noise.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.fitting import line_slopes
from chemage.ageing.hold_times import within
from chemage.ageing.kinetics import EVERY_SITE
from chemage.contacts.solution import ContactSolution
from chemage.contacts.stage import solve_contact
from chemage.foundation.approximations import in_words
from chemage.foundation.errors import ChemageError
from chemage.plugins.sources import approximations
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.run import aged
from chemage.scene.scene import Scene
from chemage.scene.variants import is_random, question
from chemage.scene.warm_up import warm_up
from chemage.studies.trade.choices import ENGINE, Choice, Combination, applied, changes, choices, go_together
from chemage.studies.trade.settings import reference as best_of
from chemage.studies.trade.settings import with_section
from chemage.studies.trade.trade_map import BETA, DISTRIBUTION, DROP, SHOWN_MEASURES, Point, TradeMap, machine, pareto
from chemage.surfaces.stage import make_surface

T = TypeVar("T")
#: called with what is being measured
Report = Callable[[str], None]
#: rounds by what the scene itself is expected to cost, CPU seconds: (less than, rounds)
ROUNDS = ((0.3, 6), (1.5, 4), (math.inf, 3))
#: combined values of one choice, combinations that are tried once, and that are measured in every round
MOST_VALUES, MOST_TRIED, MOST_KEPT = 3, 90, 24
#: a value is combined if its stage costs at most this part of that of the scene
CHEAPER = 0.97
#: what takes so many times as long as the scene is left out, unless it takes less than this, CPU seconds
SLOWER, NOT_LONG = 10.0, 1.0
#: measures of a contact that its settings do not change
_GIVEN = {"load", "modulus", "nominal_area", "nominal_pressure"}


@dataclass(frozen=True)
class Seconds:
    """CPU time over all threads, and wall time."""

    cpu: float
    wall: float


def timed(task: Callable[[], T]) -> tuple[T, Seconds]:
    """What ``task`` returns, and how long it took."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = task()
    return result, Seconds(time.process_time() - cpu, time.perf_counter() - wall)


@dataclass(frozen=True)
class Solved:
    """A contact with its times and measures."""

    contact: ContactSolution
    making: Seconds
    solving: Seconds
    measures: dict[str, float]


@dataclass(frozen=True)
class Computed:
    """What a combination of choices gives on one surface."""

    solved: Solved
    aging: Aging | None
    ageing: Seconds

    @property
    def contact(self) -> ContactSolution:
        """The contact."""
        return self.solved.contact


@dataclass(frozen=True)
class _Record:
    """What is kept of a :class:`Computed`, and its difference from the reference of its round."""

    contact_seconds: float
    ageing_seconds: float
    #: observable -> (replicas,) values, or (1,) of the contact
    values: dict[str, np.ndarray]
    #: observable -> (replicas,) values less those of the reference
    differences: dict[str, np.ndarray]


@dataclass
class _Trial:
    """A combination of choices and what was measured of it."""

    combination: Combination
    scene: Scene
    records: list[_Record] = field(default_factory=list)
    trouble: str = ""

    @property
    def seconds(self) -> float:
        return self.records[0].contact_seconds + self.records[0].ageing_seconds


class Mapper:
    """Measures the points of one map, round by round."""

    def __init__(self, scene: Scene, *, rounds: int | None = None, report: Report | None = None) -> None:
        self.scene, self.report = scene, report or (lambda _: None)
        self.notes: list[str] = []
        self.random = is_random(scene)
        self.rounds = rounds or _rounds(scene)
        self.choices = choices(scene, self.notes)
        self.best, self._best_is_own = _best(scene), False
        self.trials: dict[frozenset[tuple[str, str]], _Trial] = {}
        self._round, self._contacts, self._ageings = 0, {}, {}
        self._reference: Computed | None = None
        #: (what is chosen, value) -> why it is left out
        self.slow: dict[tuple[str, str], str] = {}

    # -- computing ----------------------------------------------------------------------------------------------------

    def warm_up(self) -> None:
        """Compile what the choices need, so that compilation is not in their times; leave out what is far slower than
        the scene."""
        solved = self._solved(self.scene)
        own = solved.making.cpu + solved.solving.cpu + self._expected_seconds(self.scene, solved.contact)
        for choice in self.choices:
            self.report(f"compiling for {choice.words}")
            try:
                scene = choice.apply(self.scene)
                if choice.stage == "contact":
                    warm_up(scene, "contact")
                    continue
                seconds = self._expected_seconds(scene, solved.contact)
            except ChemageError:
                continue  # the reason is given where it is measured
            if seconds > max(SLOWER * own, NOT_LONG):
                self.slow[choice.knob, choice.label] = (
                    f"left out: about {seconds / own:.0f} times slower than the scene"
                )
                self.notes.append(f"{choice.words}: {self.slow[choice.knob, choice.label]}")
        self.choices = [one for one in self.choices if (one.knob, one.label) not in self.slow]
        self._contacts.clear()

    def _expected_seconds(self, scene: Scene, contact: ContactSolution) -> float:
        """CPU seconds of the ageing of all replicas, from those of one; everything is compiled afterwards."""
        if not scene.ages or scene.hold is None:
            return 0.0
        aged(scene, contact, observe=(), common="all", replicas=1)  # to compile
        _, seconds = timed(lambda: aged(scene, contact, observe=(), common="all", replicas=1))
        whole = scene.ageing is not None and not scene.ageing.replicates
        return seconds.cpu * (1 if whole else scene.hold.replicas)

    def begin(self, number: int) -> None:
        """Begin a round: compute its reference."""
        self._round, self._contacts, self._ageings = number, {}, {}
        self.report(self._text("reference"))
        try:
            self._reference = self.computed(self.best)
        except ChemageError as error:
            if self._best_is_own or number:
                raise
            self.notes.append(f"no reference, so that errors are differences from the scene as it is: {error}")
            self.best, self._best_is_own = self.scene, True
            self._reference = self.computed(self.best)

    @property
    def reference(self) -> Computed:
        """The reference of this round."""
        assert self._reference is not None
        return self._reference

    def compute(self, combination: Combination = ()) -> Computed:
        """What a combination gives in this round; times and differences are recorded.

        Raises
        ------
        ChemageError
            The choices do not go together, or cannot be computed.
        """
        key = frozenset((choice.knob, choice.label) for choice in combination)
        if (trial := self.trials.get(key)) is None:
            trial = _Trial(combination, applied(self.scene, combination))
        found = self.computed(trial.scene)
        self.trials[key] = trial  # only what can be computed
        if len(trial.records) == self._round:
            trial.records.append(self._record(trial, found))
        return found

    def _surface_seed(self) -> int:
        return self.scene.surface_seed + (self._round if self.random else 0)

    def _solved(self, scene: Scene) -> Solved:
        key = scene.keys()["contact"]
        if (known := self._contacts.get(key)) is not None:
            return known
        surface, making = timed(lambda: make_surface(scene.surface, self._surface_seed()))
        contact, solving = timed(lambda: solve_contact(scene.solver, surface, scene.load))
        pressure = contact.pressure[contact.pressure > 0]
        measures = {name: float(value) for name, value in contact.summary().items() if name not in _GIVEN}
        first = self._reference is None or not self._contacts  # the reference itself
        distance = 0.0 if first else _distance(pressure, self.reference.contact)
        found = Solved(contact, making, solving, {**measures, DISTRIBUTION: distance})
        # the reference and the contact of the scene stay, and one more: maps of the pressure are large
        kept = {self.best.keys()["contact"], self.scene.keys()["contact"]}
        self._contacts = {name: one for name, one in self._contacts.items() if name in kept} | {key: found}
        return found

    def computed(self, scene: Scene) -> Computed:
        """What a scene gives on the surface of this round."""
        solved = self._solved(scene)
        aging, seconds = timed(lambda: self._aged(scene, solved.contact))
        return Computed(solved, aging, seconds)

    def _aged(self, scene: Scene, contact: ContactSolution, **more: Any) -> Aging | None:
        if scene.hold is None:
            return None
        return aged(scene, contact, observe=(), common="all", seed=scene.hold.seed + self._round, **more)

    # -- recording ----------------------------------------------------------------------------------------------------

    def _record(self, trial: _Trial, found: Computed) -> _Record:
        values = self._values(found)
        compared = self._values(self._compared(trial))
        differences = {}
        for name, value in values.items():
            other = compared.get(name)
            if other is None:
                continue
            if len(value) != len(other):  # a method that gives the mean alone
                value, other = value.mean(keepdims=True), other.mean(keepdims=True)
            differences[name] = value - other
        making = found.solved.making.cpu + found.solved.solving.cpu
        return _Record(making, found.ageing.cpu, values, differences)

    def _compared(self, trial: _Trial) -> Computed:
        """The reference that a trial is compared with: with the noise of its engine, if that is exact."""
        own = trial.scene
        exact = any(choice.knob == ENGINE and choice.exact for choice in trial.combination)
        if not exact or own.engine is None or self.reference.aging is None:
            return self.reference
        if own.engine.kind not in self._ageings:
            scene = self.best.model_copy(update={"engine": own.engine})
            self._ageings[own.engine.kind] = self._aged(scene, self.reference.contact)
        return Computed(self.reference.solved, self._ageings[own.engine.kind], self.reference.ageing)

    def _values(self, found: Computed) -> dict[str, np.ndarray]:
        values = {name: np.array([value]) for name, value in found.solved.measures.items()}
        if found.aging is not None:
            drop = np.asarray(found.aging.friction_drop, dtype=np.float64)
            values |= {_drop_at(at): drop[:, k] for k, at in enumerate(found.aging.hold_times.tolist())}
            if (betas := self.betas(found.aging)) is not None:
                values[BETA] = betas
        return values

    def betas(self, aging: Aging) -> np.ndarray | None:
        """(replicas,) β of each replica, whose mean is the fitted one, as the fit is linear; None without a fit."""
        use = self._fitted(aging.hold_times)
        if not self.scene.load > 0 or np.unique(aging.hold_times[use]).size < 2:
            return None
        curves = np.asarray(aging.friction_drop, dtype=np.float64)
        return line_slopes(aging.hold_times, curves, (self.scene.fit.start, self.scene.fit.stop)) / self.scene.load

    def _fitted(self, times: np.ndarray) -> np.ndarray:
        return within(times, (self.scene.fit.start, self.scene.fit.stop)) & (times > 0)

    # -- the rounds ---------------------------------------------------------------------------------------------------

    def first_round(self) -> None:
        """Everything that is left to compute in the first round: single choices, and combinations of those that pay."""
        self._all(self._singles())
        tried = self._combinations()
        self._all(tried)
        kept = self._promising()
        if left_out := len(self.trials) - len(kept):
            self.notes.append(
                f"{left_out} combinations that were slower and less accurate than others in the first round are left "
                "out"
            )
        self.trials = kept

    def further_rounds(self) -> None:
        """Compute everything that was kept once more on each of the other surfaces."""
        for number in range(1, self.rounds):
            self.begin(number)
            # all of one contact one after the other
            self._all(sorted((one.combination for one in self.trials.values()), key=_contact_of))
        self.trials = {key: one for key, one in self.trials.items() if len(one.records) == self.rounds}

    def _singles(self) -> list[Combination]:
        return [(), *((choice,) for choice in self.choices)]

    def _all(self, combinations: list[Combination]) -> None:
        missing = [one for one in combinations if not self._is_done(one)]
        for number, one in enumerate(missing):
            self.report(self._text(_named(one), missing[number:]))
            try:
                self.compute(one)
            except ChemageError as error:
                if len(one) == 1:
                    self.notes.append(f"{one[0].words}: {str(error).splitlines()[0]}")

    def _is_done(self, combination: Combination) -> bool:
        trial = self.trials.get(frozenset((choice.knob, choice.label) for choice in combination))
        return trial is not None and len(trial.records) > self._round

    def _text(self, what: str, missing: list[Combination] | None = None) -> str:
        """What is being measured, and how long it will take, in words."""
        where = "surface" if self.random else "repetition"
        text = f"{where} {self._round + 1} of {self.rounds}: {what}"
        left = self._left(missing or []) if self.trials else 0.0
        return text + (f"; about {left:.0f} s left" if left >= 1 else "")

    def _left(self, missing: list[Combination]) -> float:
        """CPU seconds that are left, from the times of the first round."""
        done = [one for one in self.trials.values() if one.records]
        each = sum(one.records[0].ageing_seconds for one in done)
        contacts = {_contact_of(one.combination): one.records[0].contact_seconds for one in done}
        whole = each + sum(contacts.values()) + self._seconds_of(self.reference)
        share = len(missing) / max(len(done), len(missing), 1)
        rounds_left = self.rounds - self._round - 1
        return whole * (share + rounds_left)

    @staticmethod
    def _seconds_of(found: Computed) -> float:
        return found.solved.making.cpu + found.solved.solving.cpu + found.ageing.cpu

    # -- combinations -------------------------------------------------------------------------------------------------

    def observables(self) -> list[str]:
        """The observables that are shown, as far as the reference has them."""
        known = self._values(self.reference)
        found = [BETA] if BETA in known else []
        if self.scene.ages and self.scene.hold is not None:
            found += [_drop_at(at) for at in _decades(self.scene.hold.hold_times)]
        found = [name for name in found if known[name].mean() != 0]
        return found + [name for name in SHOWN_MEASURES if math.isfinite(known[name].mean())]

    def _error(self, trial: _Trial, name: str) -> float:
        """The error of the first round, or what it may be where the replicas hide it."""
        difference = trial.records[0].differences.get(name)
        if difference is None:
            return math.nan
        noise = difference.std(ddof=1) / math.sqrt(len(difference)) if len(difference) > 1 else 0.0
        return max(abs(float(difference.mean())), float(noise))

    def _fronts(self, trials: list[_Trial], seconds: Callable[[_Trial], float]) -> list[_Trial]:
        """The trials on the front of at least one observable, in the first round."""
        found: dict[int, _Trial] = {}
        for name in self.observables():
            known = [one for one in trials if not math.isnan(self._error(one, name))]
            for one in pareto(known, lambda one, name=name: (seconds(one), self._error(one, name))):
                found[id(one)] = one
        return list(found.values())

    def _useful(self) -> dict[str, list[Choice]]:
        """What is chosen -> the values that make their stage cheaper, and are not beaten by another value."""
        own = self.trials[frozenset()].records[0]
        found: dict[str, list[Choice]] = {}
        for knob in dict.fromkeys(choice.knob for choice in self.choices):
            singles = [one for one in self.trials.values() if len(one.combination) == 1]
            singles = [one for one in singles if one.combination[0].knob == knob]
            stage = "ageing_seconds" if singles and singles[0].combination[0].stage == "ageing" else "contact_seconds"

            def seconds(one: _Trial, stage: str = stage) -> float:
                return getattr(one.records[0], stage)

            cheaper = [one for one in singles if seconds(one) <= CHEAPER * getattr(own, stage)]
            if knob == ENGINE:  # exact engines differ by their speed alone
                exact = [one for one in cheaper if one.combination[0].exact]
                cheaper = [one for one in cheaper if one not in exact] + sorted(exact, key=seconds)[:1]
            front = sorted(self._fronts(cheaper, seconds), key=seconds)
            if len(front) > MOST_VALUES:
                front = [front[0], front[len(front) // 2], front[-1]]
            found[knob] = [one.combination[0] for one in front]
        return found

    def _combinations(self) -> list[Combination]:
        """Combinations of useful values, the cheapest contacts first."""
        useful = [[None, *values] for values in self._useful().values() if values]
        found: list[Combination] = []
        for chosen in itertools.product(*useful):
            one = tuple(choice for choice in chosen if choice is not None)
            if len(one) > 1 and go_together(one) and _is_scene(self.scene, one):
                found.append(one)
        found = sorted(found, key=self._presumed)[:MOST_TRIED]
        return sorted(found, key=_contact_of)

    def _presumed(self, combination: Combination) -> float:
        """CPU seconds if every choice saves the same part as alone."""
        own = self.trials[frozenset()].records[0]
        seconds = {"contact_seconds": own.contact_seconds, "ageing_seconds": own.ageing_seconds}
        for choice in combination:
            alone = self.trials[frozenset([(choice.knob, choice.label)])].records[0]
            for stage in seconds:
                seconds[stage] *= getattr(alone, stage) / max(getattr(own, stage), 1e-9)
        return sum(seconds.values())

    def _promising(self) -> dict[Any, _Trial]:
        """Single choices, and the combinations that may be on a front."""
        everything = list(self.trials.values())
        front = self._fronts(everything, lambda one: one.seconds)
        contacts = [one for one in everything if _only_contact(one.combination)]
        front += self._fronts(contacts, lambda one: one.records[0].contact_seconds)
        combined = list({id(one): one for one in front if len(one.combination) > 1}.values())
        combined = sorted(combined, key=lambda one: one.seconds)
        if len(combined) > MOST_KEPT:
            step = len(combined) / MOST_KEPT
            combined = [combined[int(k * step)] for k in range(MOST_KEPT)]
        kept = {id(one) for one in combined}
        return {key: one for key, one in self.trials.items() if len(one.combination) < 2 or id(one) in kept}

    # -- the map ------------------------------------------------------------------------------------------------------

    def made(self) -> TradeMap:
        """The map of what was measured."""
        own = self.trials[frozenset()]
        means = {name: [one.values[name].mean() for one in own.records] for name in own.records[0].values}
        scatter = {}
        if self.random and self.rounds > 1:
            for name, values in means.items():
                total, noise = np.var(values, ddof=1), np.mean([_noise(one.values[name]) for one in own.records])
                mean = abs(float(np.mean(values)))
                scatter[name] = math.sqrt(max(float(total) - float(noise), 0.0)) / mean if mean else math.nan
        found = TradeMap(
            scene=self.scene.todict(),
            question=question(self.scene),
            versions=versions(self.scene),
            machine=machine(),
            rounds=self.rounds,
            random=self.random,
            replicas=self.scene.hold.replicas if self.scene.ages and self.scene.hold is not None else 0,
            observables=self.observables(),
            surface_scatter=scatter,
            points=[self._point(one) for one in self.trials.values()],
            notes=list(self.notes),
        )
        return found.marked()

    def _point(self, trial: _Trial) -> Point:
        records = trial.records
        differences, values, scatter = {}, {}, {}
        for name in records[0].differences:
            reference = [one.values[name].mean() - one.differences[name].mean() for one in records]
            scale = abs(float(np.mean(reference))) if name != DISTRIBUTION else 1.0
            mean, stderr, freedom = _mean_and_error([one.differences[name] for one in records], self.random)
            if stderr < 1e-13 * max(abs(mean), scale):  # equal but for rounding
                stderr = 0.0
            differences[name] = (mean / scale, stderr / scale, freedom) if scale else (math.nan, math.nan, 0)
            values[name] = float(np.mean([one.values[name].mean() for one in records]))
            noise = float(np.mean([_noise(one.values[name]) * len(one.values[name]) for one in records]))
            if len(records[0].values[name]) > 1 and values[name]:
                scatter[name] = math.sqrt(noise) / abs(values[name])
        method = trial.scene.ageing
        return Point(
            choices={choice.knob: choice.label for choice in trial.combination},
            changes=changes(self.scene, trial.scene),
            contact_seconds=[one.contact_seconds for one in records],
            ageing_seconds=[one.ageing_seconds for one in records],
            differences=differences,
            values=values,
            scatter=scatter,
            contact_only=_only_contact(trial.combination),
            replicates=(method or EVERY_SITE).replicates,
            exact=bool(trial.combination) and all(choice.exact for choice in trial.combination),
            own=not trial.combination,
            remark=in_words(approximations(*_replaced(self.scene, trial.scene))),
        )


def _rounds(scene: Scene) -> int:
    known = cost(scene)
    seconds = (known.contact_cpu_seconds or 0.0) + (known.kinetics_cpu_seconds or 0.0)
    return next(rounds for most, rounds in ROUNDS if seconds < most)


def _best(scene: Scene) -> Scene:
    """The most accurate settings of every section, and the kinetics of every site."""
    for name, component in scene.sections().items():
        if not name.startswith("observe"):
            scene = with_section(scene, name, best_of(component))
    return scene.model_copy(update={"ageing": None}) if scene.ageing is not None else scene


def _replaced(own: Scene, other: Scene) -> Iterator[Any]:
    """The components of ``other`` that are not those of ``own``."""
    before = own.sections()
    for name, component in other.sections().items():
        if before.get(name) != component:
            yield component


def _distance(pressure: np.ndarray, reference: ContactSolution) -> float:
    """Wasserstein distance of the distributions of pressure over the contact, over the mean pressure."""
    from scipy import stats

    other = reference.pressure[reference.pressure > 0]
    if not pressure.size or not other.size:
        return math.nan
    return float(stats.wasserstein_distance(pressure, other)) / float(other.mean(dtype=np.float64))


def _mean_and_error(rounds: list[np.ndarray], random: bool) -> tuple[float, float, int]:
    """The mean difference, its standard error, and the degrees of freedom of that.

    Where rounds are surfaces, the error is that of the scatter between these. A few surfaces may by chance scatter less
    than their replicas do: the error is then that of the replicas.
    """
    means = np.array([one.mean() for one in rounds])
    if not random:
        means = np.concatenate(rounds)
    count = len(means)
    stderr = float(means.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    if random and min(map(len, rounds)) > 1:
        within = math.sqrt(float(np.mean([_noise(one) for one in rounds])) / count)
        if not stderr >= within:
            return float(means.mean()), within, sum(len(one) - 1 for one in rounds)
    return float(means.mean()), stderr, count - 1


def _noise(values: np.ndarray) -> float:
    """Variance of the mean over replicas; 0 for one."""
    return float(values.var(ddof=1)) / len(values) if len(values) > 1 else 0.0


def _only_contact(combination: Combination) -> bool:
    return all(choice.stage == "contact" for choice in combination)


def _contact_of(combination: Combination) -> str:
    """The part of a combination on which the contact depends."""
    return _named(tuple(choice for choice in combination if choice.stage == "contact"))


def _named(combination: Combination) -> str:
    return ", ".join(choice.words for choice in combination) or "the scene as it is"


def _is_scene(scene: Scene, combination: Combination) -> bool:
    """Whether a combination can be had at all."""
    try:
        applied(scene, combination)
    except ChemageError:
        return False
    return True


def _drop_at(time: float) -> str:
    return f"{DROP}@{time:g} s"


def _decades(times: np.ndarray) -> list[float]:
    """Of each decade, the hold time that is next to its beginning, where one is within a quarter of a decade."""
    found: dict[int, float] = {}
    for one in times[times > 0].tolist():
        power = math.log10(one)
        whole = round(power)
        if abs(power - whole) < 0.25 and (
            whole not in found or abs(power - whole) < abs(math.log10(found[whole]) - whole)
        ):
            found[whole] = one
    return [found[whole] for whole in sorted(found)]
