"""The map of speed against accuracy as a design: settings and combinations of them, on several surfaces, repeatedly.

In each round all settings are computed on one surface with one set of random numbers, and compared with a reference
that is more accurate than all of them: the most accurate values of every component, and the kinetics of every site.
Rounds differ by their seeds. A difference from the reference is therefore paired, surface by surface and replica by
replica, and its standard error is that of the differences between rounds; where the seed does not change the surface,
between replicas. An exact engine is compared with a reference that it has aged itself, because engines share the
disorder but not the noise.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.methods import EVERY_SITE
from chemage.contacts.role import no_map
from chemage.foundation.checks import checked_count
from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.records import approximations_in_words
from chemage.plugins.sources import approximations
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene, is_random, question
from chemage.studies.ensembles.quantities import Quantities
from chemage.studies.study import Archive, Study
from chemage.studies.tasks import Outcome, Task, registered_classes
from chemage.studies.trade.choices import (
    ENGINE,
    Choice,
    Combination,
    Timed,
    Timing,
    applied,
    changes,
    choices,
    go_together,
    most_accurate,
)
from chemage.studies.trade.trade_map import BETA, DISTRIBUTION, DROP, SHOWN_MEASURES, Point, TradeMap, machine, pareto

#: called with what was measured
Report = Callable[[str], None]
#: rounds by what the scene itself is expected to cost, CPU seconds: (less than, rounds)
ROUNDS = ((0.3, 6), (1.5, 4), (math.inf, 3))
#: combined values of one choice, combinations that are tried once, and that are measured in every round
MOST_VALUES, MOST_TRIED, MOST_KEPT = 3, 90, 24
#: a value is combined if its stage costs at most this part of that of the scene
CHEAPER = 0.97
#: what takes so many times as long as the scene is left out, unless it takes less than this, CPU seconds
SLOWER, NOT_LONG = 10.0, 1.0


def tradeoff(
    scene: Scene,
    *,
    rounds: int | None = None,
    report: Report | None = None,
    folder: str | Path | None = None,
    executor: str | Executor = "serial",
    workers: int | None = None,
    patience: float | str | None = None,
) -> TradeMap:
    """Measure what each setting of ``scene`` and their combinations cost, and how large their errors are.

    Parameters
    ----------
    rounds
        How often everything is computed, each time on another surface where the surface is random; default: three to
        six, by the cost of the scene.
    report
        Called with what was measured.
    folder
        Where results are kept, and from which they are taken, if they are of these versions and this processor;
        default: none are kept.
    executor, workers, patience
        Where to compute, as for :func:`chemage.sweep`; default: one scene after the other in this process. CPU times
        are measured where a scene is computed, in one thread; beside other work they are longer. Threads of one process
        cannot be told apart and are refused.

    Raises
    ------
    InputError
        The contact has no map, or an argument is not valid.
    """
    if rounds is not None:
        checked_count("rounds", rounds)
    if executor == "threads":
        raise InputError.of("executor", executor, "CPU times of threads cannot be told apart", "choose processes")
    if not scene.contact.gives_map:
        raise InputError(no_map(scene.contact, "there is no pressure whose error could be measured"))
    with scene.in_use():
        archive = Archive(folder, scene, processor=True)
        design = Mapper(scene, rounds=rounds, report=report, archive=archive)
        classes = registered_classes(component for scene in design.scenes() for component in scene.components())
        with Study(executor, workers, 1, patience, classes=classes) as study:
            study.carry_out(design, archive.place)
        archive.tidy()
        return design.map()


def planned(scene: Scene) -> str:
    """What a map of ``scene`` computes, in words."""
    tried = choices(scene, [])
    contacts = sum(choice.stage == "contact" for choice in tried)
    ageings = len(tried) + 2 if scene.ages else 0  # and the scene itself, and the reference
    text = f"{contacts + 2} contacts and {ageings} ageing curves on each of {_rounds(scene)} surfaces"
    return f"{text}, and combinations of those that pay"


@dataclass(frozen=True)
class _Record:
    """What a combination gives in one round, and its difference from the reference."""

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

    @property
    def seconds(self) -> float:
        return self.records[0].contact_seconds + self.records[0].ageing_seconds


class Mapper:
    """Measures the points of one map, as a design of a study."""

    def __init__(
        self,
        scene: Scene,
        *,
        rounds: int | None = None,
        report: Report | None = None,
        archive: Archive | None = None,
    ) -> None:
        self.scene, self._report = scene, report or (lambda _: None)
        self._archive = archive or Archive(None, scene)
        self.notes: list[str] = []
        self.random = is_random(scene)
        self._quantities = Quantities.of(scene, ())
        self.rounds = rounds or _rounds(scene)
        self.choices = choices(scene, self.notes)
        self.reference = most_accurate(scene)
        self.trials: dict[frozenset[tuple[str, str]], _Trial] = {}
        self._stages: Iterator[Sequence[tuple[str, Timed]]] | None = None
        #: by key of a task that was asked for: what it is, in words
        self._asked: dict[str, str] = {}
        self._timings: dict[str, Timing] = {}
        self._errors: dict[str, BaseException] = {}
        #: of each round
        self._references: list[Timing] = []
        self._spent = 0.0

    # -- as a design, see :class:`chemage.studies.study.Design` -------------------------------------------------------

    def ask(self) -> list[Task]:
        """The tasks of the next stage that are not in the folder."""
        if self._stages is None:
            self._stages = self._all_stages()
        for stage in self._stages:
            tasks: dict[str, Task] = {}
            for words, task in stage:
                if task.key in self._timings or task.key in self._errors:
                    continue
                if (outcome := self._archive.find(task)) is not None and outcome.content is not None:
                    self._timings[task.key] = Timing.read(outcome.content)
                    continue
                tasks[task.key], self._asked[task.key] = task, words
            if tasks:
                return list(tasks.values())
        return []

    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive what was measured."""
        words = self._asked.pop(task.key)
        if isinstance(outcome.error, ChemageError):
            self._errors[task.key] = outcome.error
        else:
            content = self._archive.received(task, outcome).content
            assert content is not None
            self._timings[task.key] = Timing.read(content)
            self._spent += self._timings[task.key].seconds
        each = self._spent / max(len(self._timings), 1)
        left = f"; about {seconds:.0f} s left of these" if (seconds := each * len(self._asked)) >= 1 else ""
        self._report(words + left)

    def scenes(self) -> Iterator[Scene]:
        """The scene, its reference, and the scene with each single choice."""
        yield from (self.scene, self.reference, *self._alone("contact").values(), *self._alone("ageing").values())

    def _alone(self, stage: str) -> dict[str, Scene]:
        """The scene with each of the choices of a stage that can be had, by the words of the choice."""
        scenes: dict[str, Scene] = {}
        for choice in self.choices:
            with suppress(ChemageError):  # the reason is noted where it is measured
                scenes |= {choice.words: choice.apply(self.scene)} if choice.stage == stage else {}
        return scenes

    def _all_stages(self) -> Iterator[list[tuple[str, Timed]]]:
        """The tasks of each stage; all of a stage have been computed when the next is asked for."""
        if self.scene.ages:
            yield from self._leave_out_slow()
        for number in range(self.rounds):
            reference = [("reference", self._task(self.reference, number, compared=False))]
            yield self._named(number, reference)
            if (error := self._errors.get(reference[0][1].key)) is not None:
                if number or self.reference is self.scene:
                    raise error
                self.notes.append(f"no reference, so that errors are differences from the scene as it is: {error}")
                self.reference = self.scene
                reference = [("reference", self._task(self.reference, 0, compared=False))]
                yield self._named(0, reference)
                if (error := self._errors.get(reference[0][1].key)) is not None:
                    raise error
            self._references.append(self._timings[reference[0][1].key])
            if number:
                yield from self._measured(number, [trial.combination for trial in self.trials.values()])
                continue
            yield from self._measured(0, [(), *((choice,) for choice in self.choices)])
            if frozenset() not in self.trials:
                raise self._errors[self._task(self.scene, 0).key]
            yield from self._measured(0, self._combinations())
            promising = self._promising()
            if left_out := len(self.trials) - len(promising):
                self.notes.append(
                    f"{left_out} combinations that were slower and less accurate than others in the first round are "
                    "left out"
                )
            self.trials = promising
        self.trials = {key: trial for key, trial in self.trials.items() if len(trial.records) == self.rounds}

    def _named(self, number: int, tasks: Sequence[tuple[str, Timed]]) -> list[tuple[str, Timed]]:
        where = "surface" if self.random else "repetition"
        return [(f"{where} {number + 1} of {self.rounds}: {words}", task) for words, task in tasks]

    def _leave_out_slow(self) -> Iterator[list[tuple[str, Timed]]]:
        """Age one replica of everything, and leave out what is far slower than the scene."""

        def of(scene: Scene) -> Timed:
            assert scene.hold is not None
            return self._task(
                scene.model_copy(update={"hold": scene.hold.model_copy(update={"replicas": 1})}), 0, False
            )

        def seconds(scene: Scene) -> float:
            assert scene.hold is not None
            whole = scene.ageing is not None and not scene.ageing.replicates
            timing = self._timings.get(of(scene).key)
            return 0.0 if timing is None else timing.ageing_seconds * (1 if whole else scene.hold.replicas)

        scenes = self._alone("ageing")
        yield [(f"one replica: {words}", of(scene)) for words, scene in [("scene", self.scene), *scenes.items()]]
        first = self._timings.get(of(self.scene).key)
        own = seconds(self.scene) + (0.0 if first is None else first.contact_seconds)
        for choice in [choice_alone for choice_alone in self.choices if choice_alone.words in scenes]:
            if (expected := seconds(scenes[choice.words])) > max(SLOWER * own, NOT_LONG):
                self.notes.append(f"{choice.words}: left out: about {expected / own:.0f} times slower than the scene")
                self.choices.remove(choice)

    def _measured(self, number: int, combinations: Sequence[Combination]) -> Iterator[list[tuple[str, Timed]]]:
        """Compute combinations in a round, and the references of exact engines among them; record what they give."""
        scenes: dict[frozenset[tuple[str, str]], tuple[Combination, Scene]] = {}
        for combination in combinations:
            try:
                scenes[_key(combination)] = combination, applied(self.scene, combination)
            except ChemageError as error:
                self._refused(combination, error)
        tasks = [(_words(combination), self._task(scene, number)) for combination, scene in scenes.values()]
        tasks += [("reference", self._compared(*combination, number)) for combination in scenes.values()]
        yield self._named(number, tasks)
        for key, (combination, scene) in scenes.items():
            task = self._task(scene, number)
            if (error := self._errors.get(task.key)) is not None:
                self._refused(combination, error)
                continue
            trial = self.trials.setdefault(key, _Trial(combination, scene))
            reference = self._timings[self._compared(combination, scene, number).key]
            if len(trial.records) == number:
                trial.records.append(self._record(self._timings[task.key], reference))

    def _refused(self, combination: Combination, error: BaseException) -> None:
        if len(combination) == 1:
            self.notes.append(f"{combination[0].words}: {str(error).splitlines()[0]}")

    def _task(self, scene: Scene, number: int, compared: bool = True) -> Timed:
        """A scene on the surface of a round, with its random numbers."""
        reference = self._in_round(self.reference, number) if compared else None
        return Timed.of(self._in_round(scene, number), number=number, reference=reference)

    def _in_round(self, scene: Scene, number: int) -> Scene:
        update: dict[str, Any] = {"observe": (), "surface_seed": scene.surface_seed + (number if self.random else 0)}
        if scene.hold is not None:
            update["hold"] = scene.hold.model_copy(update={"seed": scene.hold.seed + number, "common": "all"})
        return scene.model_copy(update=update)

    def _compared(self, combination: Combination, scene: Scene, number: int) -> Timed:
        """The reference that a combination is compared with: with the noise of its engine, if that is exact."""
        exact = any(choice.knob == ENGINE and choice.exact for choice in combination)
        same = self.reference.model_copy(update={"engine": scene.engine}) if exact else self.reference
        return self._task(same, number, compared=False)

    # -- recording ----------------------------------------------------------------------------------------------------

    def _record(self, timing: Timing, reference: Timing) -> _Record:
        values, compared, differences = self._values(timing), self._values(reference), {}
        for name, value in values.items():
            other = compared.get(name)
            if other is None:
                continue
            if len(value) != len(other):  # a method that gives the mean alone
                value, other = value.mean(keepdims=True), other.mean(keepdims=True)
            differences[name] = value - other
        return _Record(timing.contact_seconds, timing.ageing_seconds, values, differences)

    def _values(self, timing: Timing) -> dict[str, np.ndarray]:
        values = {name: np.array([value]) for name, value in timing.measures.items()}
        if (drop := timing.friction_drop) is not None:
            values |= {_drop_at(at): drop[:, k] for k, at in enumerate(self._quantities.hold_times.tolist())}
            if self._quantities.has_beta:
                values[BETA] = self._quantities.slope(drop) / self.scene.load
        return values

    # -- combinations -------------------------------------------------------------------------------------------------

    def observables(self) -> list[str]:
        """The observables that are shown, as far as the reference has them."""
        rounds = [self._values(timing) for timing in self._references]
        mean = {name: float(np.mean([values[name].mean() for values in rounds])) for name in rounds[0]}
        names = [BETA] if BETA in mean else []
        if self.scene.ages and self.scene.hold is not None:
            names += [_drop_at(at) for at in _decades(self.scene.hold.hold_times)]
        return [
            *(name for name in names if mean[name] != 0),
            *(name for name in SHOWN_MEASURES if math.isfinite(mean[name])),
        ]

    def _error(self, trial: _Trial, name: str) -> float:
        """The error of the first round, or what it may be where the replicas hide it."""
        difference = trial.records[0].differences.get(name)
        if difference is None:
            return math.nan
        noise = difference.std(ddof=1) / math.sqrt(len(difference)) if len(difference) > 1 else 0.0
        return max(abs(float(difference.mean())), float(noise))

    def _fronts(self, trials: list[_Trial], seconds: Callable[[_Trial], float]) -> list[_Trial]:
        """The trials on the front of at least one observable, in the first round."""
        on_front: dict[int, _Trial] = {}
        for name in self.observables():
            comparable = [trial for trial in trials if not math.isnan(self._error(trial, name))]
            for trial in pareto(comparable, lambda trial, name=name: (seconds(trial), self._error(trial, name))):
                on_front[id(trial)] = trial
        return list(on_front.values())

    def _useful(self) -> dict[str, list[Choice]]:
        """What is chosen -> the values that make their stage cheaper, and are not beaten by another value."""
        own = self.trials[frozenset()].records[0]
        useful: dict[str, list[Choice]] = {}
        for knob in dict.fromkeys(choice.knob for choice in self.choices):
            singles = [trial for trial in self.trials.values() if len(trial.combination) == 1]
            singles = [trial for trial in singles if trial.combination[0].knob == knob]
            stage = "ageing_seconds" if singles and singles[0].combination[0].stage == "ageing" else "contact_seconds"

            def seconds(trial: _Trial, stage: str = stage) -> float:
                return getattr(trial.records[0], stage)

            cheaper = [trial for trial in singles if seconds(trial) <= CHEAPER * getattr(own, stage)]
            if knob == ENGINE:  # exact engines differ by their speed alone
                exact = [trial for trial in cheaper if trial.combination[0].exact]
                cheaper = [trial for trial in cheaper if trial not in exact] + sorted(exact, key=seconds)[:1]
            front = sorted(self._fronts(cheaper, seconds), key=seconds)
            if len(front) > MOST_VALUES:
                front = [front[0], front[len(front) // 2], front[-1]]
            useful[knob] = [trial.combination[0] for trial in front]
        return useful

    def _combinations(self) -> list[Combination]:
        """Combinations of useful values, the cheapest contacts first."""
        useful = [[None, *values] for values in self._useful().values() if values]
        tried: list[Combination] = []
        for chosen in itertools.product(*useful):
            combination = tuple(choice for choice in chosen if choice is not None)
            if len(combination) > 1 and go_together(combination) and _is_scene(self.scene, combination):
                tried.append(combination)
        tried = sorted(tried, key=self._presumed)[:MOST_TRIED]
        return sorted(tried, key=_contact_of)

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
        front = self._fronts(everything, lambda trial: trial.seconds)
        contacts = [trial for trial in everything if _only_contact(trial.combination)]
        front += self._fronts(contacts, lambda trial: trial.records[0].contact_seconds)
        combined = list({id(trial): trial for trial in front if len(trial.combination) > 1}.values())
        combined = sorted(combined, key=lambda trial: trial.seconds)
        if len(combined) > MOST_KEPT:
            step = len(combined) / MOST_KEPT
            combined = [combined[int(k * step)] for k in range(MOST_KEPT)]
        kept = {id(trial) for trial in combined}
        return {key: trial for key, trial in self.trials.items() if len(trial.combination) < 2 or id(trial) in kept}

    # -- the map ------------------------------------------------------------------------------------------------------

    def map(self) -> TradeMap:
        """The map of what was measured."""
        own = self.trials[frozenset()]
        means = {name: [record.values[name].mean() for record in own.records] for name in own.records[0].values}
        scatter = {}
        if self.random and self.rounds > 1:
            for name, values in means.items():
                total, noise = np.var(values, ddof=1), np.mean([_noise(record.values[name]) for record in own.records])
                mean = abs(float(np.mean(values)))
                scatter[name] = math.sqrt(max(float(total) - float(noise), 0.0)) / mean if mean else math.nan
        map = TradeMap(
            scene=self.scene.todict(),
            question=question(self.scene),
            versions=versions(self.scene),
            machine=machine(),
            rounds=self.rounds,
            random=self.random,
            replicas=self.scene.hold.replicas if self.scene.ages and self.scene.hold is not None else 0,
            observables=self.observables(),
            surface_scatter=scatter,
            points=[self._point(record) for record in self.trials.values()],
            notes=list(self.notes),
        )
        return map.marked()

    def _point(self, trial: _Trial) -> Point:
        records = trial.records
        differences, values, scatter = {}, {}, {}
        for name in records[0].differences:
            reference = [record.values[name].mean() - record.differences[name].mean() for record in records]
            scale = abs(float(np.mean(reference))) if name != DISTRIBUTION else 1.0
            mean, stderr, freedom = _mean_and_error([record.differences[name] for record in records], self.random)
            if stderr < 1e-13 * max(abs(mean), scale):  # equal but for rounding
                stderr = 0.0
            differences[name] = (mean / scale, stderr / scale, freedom) if scale else (math.nan, math.nan, 0)
            values[name] = float(np.mean([record.values[name].mean() for record in records]))
            noise = float(np.mean([_noise(record.values[name]) * len(record.values[name]) for record in records]))
            if len(records[0].values[name]) > 1 and values[name]:
                scatter[name] = math.sqrt(noise) / abs(values[name])
        method = trial.scene.ageing
        return Point(
            choices={choice.knob: choice.label for choice in trial.combination},
            changes=changes(self.scene, trial.scene),
            contact_seconds=[record.contact_seconds for record in records],
            ageing_seconds=[record.ageing_seconds for record in records],
            differences=differences,
            values=values,
            scatter=scatter,
            contact_only=_only_contact(trial.combination),
            replicates=(method or EVERY_SITE).replicates,
            exact=bool(trial.combination) and all(choice.exact for choice in trial.combination),
            own=not trial.combination,
            remark=approximations_in_words(approximations(*_replaced(self.scene, trial.scene))),
        )


def _rounds(scene: Scene) -> int:
    costs = cost(scene)
    seconds = (costs.contact_cpu_seconds or 0.0) + (costs.kinetics_cpu_seconds or 0.0)
    return next(rounds for most, rounds in ROUNDS if seconds < most)


def _replaced(own: Scene, other: Scene) -> Iterator[Any]:
    """The components of ``other`` that are not those of ``own``."""
    before = own.sections()
    for name, component in other.sections().items():
        if before.get(name) != component:
            yield component


def _mean_and_error(rounds: list[np.ndarray], random: bool) -> tuple[float, float, int]:
    """The mean difference, its standard error, and the degrees of freedom of that.

    Where rounds are surfaces, the error is that of the scatter between these. A few surfaces may by chance scatter less
    than their replicas do: the error is then that of the replicas.
    """
    means = np.array([differences.mean() for differences in rounds])
    if not random:
        means = np.concatenate(rounds)
    count = len(means)
    stderr = float(means.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    if random and min(map(len, rounds)) > 1:
        within = math.sqrt(float(np.mean([_noise(differences) for differences in rounds])) / count)
        if not stderr >= within:
            return float(means.mean()), within, sum(len(differences) - 1 for differences in rounds)
    return float(means.mean()), stderr, count - 1


def _noise(values: np.ndarray) -> float:
    """Variance of the mean over replicas; 0 for one."""
    return float(values.var(ddof=1)) / len(values) if len(values) > 1 else 0.0


def _key(combination: Combination) -> frozenset[tuple[str, str]]:
    return frozenset((choice.knob, choice.label) for choice in combination)


def _only_contact(combination: Combination) -> bool:
    return all(choice.stage == "contact" for choice in combination)


def _contact_of(combination: Combination) -> str:
    """The part of a combination on which the contact depends."""
    return _words(tuple(choice for choice in combination if choice.stage == "contact"))


def _words(combination: Combination) -> str:
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
    nearest: dict[int, float] = {}
    for time in times[times > 0].tolist():
        power = math.log10(time)
        whole = round(power)
        if abs(power - whole) < 0.25 and (
            whole not in nearest or abs(power - whole) < abs(math.log10(nearest[whole]) - whole)
        ):
            nearest[whole] = time
    return [nearest[whole] for whole in sorted(nearest)]
