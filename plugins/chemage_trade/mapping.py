"""The map of speed against accuracy as a design: settings and combinations of them, on several surfaces, repeatedly.

In each round all settings are computed on one surface with one set of random numbers, and compared with a reference
that is more accurate than all of them: the most accurate values of every component, and the kinetics of every site.
Rounds differ by their seeds. A difference from the reference is therefore paired, surface by surface and replica by
replica, and its standard error is that of the differences between rounds; where the seed does not change the surface,
between replicas. An exact engine is compared with a reference that it has aged itself, because engines share the
disorder but not the noise.

A scene of which the CPU time is measured, as a task: in the process that computes it, on one thread.

The result is what a map of speed against accuracy compares: measures of the contact, the distance of its pressures from
those of a reference, and the friction drop of each replica.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from chemage import ChemageError, ContactSolution, InputError, Run, Scene
from chemage.plugin import (
    Design,
    Outcome,
    Task,
    TradePoint,
    Worker,
    ageing_of,
    carry_out,
    checked_count,
    contact_of,
    content_hash,
    plan,
    statistics,
    text,
    theory,
    versions,
)
from chemage_trade.result import (
    BETA,
    DISTRIBUTION,
    DROP,
    ENGINE,
    SHOWN_MEASURES,
    Combination,
    Tradeoff,
    TradeSetting,
    applied,
    changes,
    choices,
    go_together,
    most_accurate,
    pareto,
)

T = TypeVar("T")
#: forms of scenes that this process has compiled everything for, and whether it has solved a contact
_compiled: set[str] = set()


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """What ``work`` returns, and its CPU seconds over all threads of this process."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


@dataclass(frozen=True)
class Timed(Task):
    """A scene of which the CPU time is measured."""

    #: with whose pressures those of the scene are compared; None: with none
    reference: Scene | None = None

    @classmethod
    def measuring(cls, scene: Scene, **more: Any) -> Timed:
        """The task that measures a scene.

        Raises
        ------
        InputError
            It needs more memory than there is.
        """
        task = cls.of(scene, **more)
        against = None if task.reference is None else _contact_key(task.reference)
        return replace(
            task,
            # options that change the speed alone are in the data of the scene, and in no key of its stages
            key=content_hash([task.key, _data(scene), against]),
            ageing=content_hash([task.ageing, _data(scene)]),
            contact=_contact_key(scene),
        )

    def outcome(self, worker: Worker) -> Outcome:
        """Compute and time the scene; what it needs is compiled before."""
        scene, distance = self.scene, 0.0
        with scene.in_use():
            worker.stage = "contact"
            contact, contact_seconds = _solution(worker, scene)
            if self.reference is not None:
                distance = _distance(contact, _solution(worker, self.reference)[0])
            worker.stage = "ageing"
            _compile(scene, contact)
            ageing, ageing_seconds = timed(lambda: ageing_of(scene, contact))
        run = Run(
            scene.todict(),
            contact,
            ageing=ageing,
            timings={"contact": contact_seconds, "ageing": ageing_seconds},
            versions=versions(scene, (contact, ageing)),
        )
        return Outcome(run, text.jsonable({DISTRIBUTION: distance}))


def _solution(worker: Worker, scene: Scene) -> tuple[ContactSolution, float]:
    """The contact of a scene, and the CPU seconds of making its surface and solving it."""

    def solve() -> ContactSolution:
        return contact_of(scene)

    def measured() -> tuple[ContactSolution, float]:
        scene.warm_up("contact")
        if not _compiled:  # the first contact of a process takes longer
            solve()
            _compiled.add("contact")
        return timed(solve)

    # that of the reference, which every task uses, and that of the task
    return worker.kept("timed contact", _contact_key(scene), measured)


def _compile(scene: Scene, contact: ContactSolution) -> None:
    """Age one replica where no scene of this form was aged, which has other numbers at most, so that compilation, or a
    table that a method of ageing makes once, is in no time."""
    form = f"{scene.form()} {scene.ageing!r}"
    if scene.ages and form not in _compiled:
        ageing_of(scene, contact, replicas=1)
        _compiled.add(form)


def _data(scene: Scene) -> dict[str, Any]:
    return scene.todict() | {"name": "", "title": ""}


def _contact_key(scene: Scene) -> str:
    data = scene.todict()
    return content_hash(
        [scene.task_keys()["contact"], data["surface"], data["contact"]]
    )


def _distance(contact: ContactSolution, reference: ContactSolution) -> float:
    """Wasserstein distance of the distributions of pressure over the contact, over the mean pressure."""
    from scipy import stats

    pressure, other = (
        solution.pressure[solution.contact] for solution in (contact, reference)
    )
    if not pressure.size or not other.size:
        return math.nan
    return float(stats.wasserstein_distance(pressure, other)) / float(
        np.abs(other).mean(dtype=np.float64)
    )


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
    executor: str | Executor | None = None,
    workers: int | None = None,
    patience: float | str | None = None,
) -> Tradeoff:
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
        Where to compute, as for :func:`chemage.plugin.carry_out`. CPU times
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
        raise InputError.of(
            "executor",
            executor,
            "CPU times of threads cannot be told apart",
            "choose processes",
        )
    if not scene.contact.gives_map:
        raise InputError(
            theory.no_map(
                scene.contact, "there is no pressure whose error could be measured"
            )
        )
    with scene.in_use():
        design = Mapper(scene, rounds, report)
        carry_out(
            design,
            folder,
            executor=executor,
            workers=workers,
            threads=1,
            patience=patience,
        )
        return design.map()


def planned(scene: Scene) -> str:
    """What a map of ``scene`` computes, in words."""
    tried = choices(scene, [])
    contacts = sum(choice.stage == "contact" for choice in tried)
    ageings = (
        len(tried) + 2 if scene.ages else 0
    )  # and the scene itself, and the reference
    return (
        f"{contacts + 2} contacts and {ageings} ageing curves on each of {_rounds(scene)} surfaces, and combinations of "
        "those that pay"
    )


@dataclass(frozen=True)
class _Timing:
    """What a combination gives in one round."""

    contact_seconds: float
    ageing_seconds: float
    #: observable -> (replicas,) values, or (1,) of the contact; nan where a measure does not exist
    values: dict[str, np.ndarray]

    @property
    def seconds(self) -> float:
        """CPU seconds of contact and ageing of all replicas."""
        return self.contact_seconds + self.ageing_seconds

    def less(self, reference: _Timing, name: str) -> np.ndarray:
        """(replicas,) values less those of a reference; the difference of the means where one has no replicas."""
        value, other = self.values[name], reference.values[name]
        if len(value) != len(other):
            value, other = value.mean(keepdims=True), other.mean(keepdims=True)
        return value - other


@dataclass(eq=False)
class _Trial:
    """A combination of settings, what was measured of it, and what that is compared with, in each round."""

    combination: Combination
    scene: Scene
    rounds: list[_Timing] = field(default_factory=list)
    references: list[_Timing] = field(default_factory=list)

    @property
    def first(self) -> _Timing:
        """Of the first round."""
        return self.rounds[0]

    @property
    def stage(self) -> str:
        """``contact`` if only the contact depends on the settings, else ``ageing``."""
        return (
            "contact"
            if all(one.stage == "contact" for one in self.combination)
            else "ageing"
        )

    def seconds(self, stage: str) -> float:
        """CPU seconds of a stage in the first round."""
        return getattr(self.first, f"{stage}_seconds")

    def differences(self, name: str) -> list[np.ndarray]:
        """(replicas,) from the reference in each round; none where that does not have the observable."""
        pairs = zip(self.rounds, self.references, strict=True)
        return [
            one.less(other, name) for one, other in pairs if name in other.values
        ]


class Mapper(Design):
    """Measures the points of one map, as a design of a study."""

    timed = True

    def __init__(
        self, scene: Scene, rounds: int | None, report: Report | None
    ) -> None:
        self.scene, self._report = scene, report or (lambda _: None)
        self.notes: list[str] = []
        self.random = scene.is_random
        self.rounds = rounds or _rounds(scene)
        self.choices = choices(scene, self.notes)
        self.reference = most_accurate(scene)
        self.trials: dict[frozenset[tuple[str, str]], _Trial] = {}
        self._stages = self._all_stages()
        #: by key of a task that was asked for: what it is, in words
        self._asked: dict[str, str] = {}
        #: by key of a task: what was measured, or why nothing was
        self._found: dict[str, _Timing | ChemageError] = {}
        #: of each round
        self._references: list[_Timing] = []
        self._spent = 0.0

    # -- as a design --------------------------------------------------------------------------------------------------

    def ask(self) -> list[Task]:
        """The tasks of the next stage."""
        for stage in self._stages:
            tasks: dict[str, Task] = {}
            for words, task in stage:
                if task.key not in self._found:
                    tasks[task.key], self._asked[task.key] = task, words
            if tasks:
                return list(tasks.values())
        return []

    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive what was measured."""
        words = self._asked.pop(task.key)
        if isinstance(outcome.error, ChemageError):
            self._found[task.key] = outcome.error
        else:
            self._found[task.key] = timing = self._read(outcome)
            if outcome.kept:
                return
            self._spent += timing.seconds
        each = self._spent / max(len(self._found), 1)
        left = (
            f"; about {seconds:.0f} s left of these"
            if (seconds := each * len(self._asked)) >= 1
            else ""
        )
        self._report(words + left)

    def _read(self, outcome: Outcome) -> _Timing:
        """From what a worker sends, or a folder has."""
        summary, content, ageing = outcome.summary, outcome.content, outcome.ageing
        assert content is not None
        measures = outcome.measures | {DISTRIBUTION: content[DISTRIBUTION]}
        values = {
            name: np.array([value], dtype=np.float64)
            for name, value in measures.items()
        }
        if ageing is not None:
            drop = np.asarray(ageing.friction_drop, dtype=np.float64)
            for k, at in enumerate(ageing.hold_times.tolist()):
                values[_drop_at(at)] = drop[:, k]
            if summary["beta"] is not None:
                fit = self.scene.fit
                values[BETA] = ageing.betas((fit.start, fit.stop))
        return _Timing(
            summary["timings"]["contact"], summary["timings"]["ageing"], values
        )

    def _measured_of(self, task: Task) -> _Timing:
        """What was measured of a task; raises the error that it gave."""
        found = self._found[task.key]
        if isinstance(found, ChemageError):
            raise found
        return found

    def _all_stages(self) -> Iterator[list[tuple[str, Timed]]]:
        """The tasks of each stage; all of a stage have been computed when the next is asked for."""
        if self.scene.ages:
            yield from self._leave_out_slow()
        yield from self._referred(0)
        yield from self._measured(
            0, self._tried([(), *((one,) for one in self.choices)])
        )
        if frozenset() not in self.trials:
            self._measured_of(self._task(self.scene, 0))
        yield from self._measured(0, self._combinations())
        promising = self._promising()
        if left_out := len(self.trials) - len(promising):
            slower = "combinations that were slower and less accurate than others in the first round are left out"
            self.notes.append(f"{left_out} {slower}")
        self.trials = promising
        for number in range(1, self.rounds):
            yield from self._referred(number)
            yield from self._measured(number, list(self.trials.values()))
        self.trials = {
            key: trial
            for key, trial in self.trials.items()
            if len(trial.rounds) == self.rounds
        }

    def _referred(self, number: int) -> Iterator[list[tuple[str, Timed]]]:
        """The reference of a round: the scene itself where the most accurate one fails in the first round."""
        try:
            task = self._task(self.reference, number, compared=False)
            yield self._named(number, [("reference", task)])
            self._references.append(self._measured_of(task))
        except ChemageError as error:
            if number or self.reference is self.scene:
                raise
            self.notes.append(
                f"no reference, so that errors are differences from the scene as it is: {error}"
            )
            self.reference = self.scene
            yield from self._referred(0)

    def _named(
        self, number: int, tasks: Sequence[tuple[str, Timed]]
    ) -> list[tuple[str, Timed]]:
        of = f"{number + 1} of {self.rounds}"
        where = f"surface {of}" if self.random else f"repetition {of}"
        return [(f"{where}: {words}", task) for words, task in tasks]

    def _leave_out_slow(self) -> Iterator[list[tuple[str, Timed]]]:
        """Age one replica of everything, and leave out what is far slower than the scene."""

        def of(scene: Scene) -> Timed:
            return self._task(scene.with_hold(replicas=1), 0, False)

        hold, tasks = self.scene.hold, {"scene": of(self.scene)}
        assert hold is not None
        for one in self.choices:
            if one.stage == "ageing":
                with suppress(
                    ChemageError
                ):  # the reason is noted where it is measured
                    tasks[one.words] = of(applied(self.scene, (one,)))

        def seconds(task: Timed) -> float:
            """Of the ageing of all replicas."""
            timing, method = self._measured_of(task), task.scene.ageing
            whole = method is not None and not method.replicates
            return timing.ageing_seconds * (1 if whole else hold.replicas)

        yield [(f"one replica: {words}", task) for words, task in tasks.items()]
        scene = tasks.pop("scene")
        own = seconds(scene) + self._measured_of(scene).contact_seconds
        for one in [one for one in self.choices if one.words in tasks]:
            with suppress(ChemageError):  # it is noted where it is measured
                expected = seconds(tasks[one.words])
                if expected > max(SLOWER * own, NOT_LONG):
                    self.notes.append(
                        f"{one.words}: left out: about {expected / own:.0f} times slower than the scene"
                    )
                    self.choices.remove(one)

    def _tried(self, combinations: Iterable[Combination]) -> list[_Trial]:
        """Trials of the combinations that can be had at all."""
        trials = []
        for combination in combinations:
            try:
                trials.append(_Trial(combination, applied(self.scene, combination)))
            except ChemageError as error:
                self._refused(combination, error)
        return trials

    def _measured(
        self, number: int, trials: Sequence[_Trial]
    ) -> Iterator[list[tuple[str, Timed]]]:
        """Compute trials in a round, and the references of exact engines among them; record what they give."""
        tasks: dict[_Trial, tuple[Timed, Timed]] = {}
        for trial in trials:
            try:
                task = self._task(trial.scene, number)
                tasks[trial] = task, self._compared(trial, number)
            except ChemageError as error:
                self._refused(trial.combination, error)
        named = [(_words(trial.combination), tasks[trial][0]) for trial in tasks]
        named += [("reference", compared) for _, compared in tasks.values()]
        yield self._named(number, named)
        for trial, (task, compared) in tasks.items():
            try:
                timing, reference = (
                    self._measured_of(task),
                    self._measured_of(compared),
                )
            except ChemageError as error:
                self._refused(trial.combination, error)
                continue
            self.trials.setdefault(_key(trial.combination), trial)
            if len(trial.rounds) == number:
                trial.rounds.append(timing)
                trial.references.append(reference)

    def _refused(self, combination: Combination, error: BaseException) -> None:
        if len(combination) == 1:
            self.notes.append(
                f"{combination[0].words}: {str(error).splitlines()[0]}"
            )

    def _task(self, scene: Scene, number: int, compared: bool = True) -> Timed:
        """A scene on the surface of a round, with its random numbers."""
        reference = self._in_round(self.reference, number) if compared else None
        return Timed.measuring(
            self._in_round(scene, number), number=number, reference=reference
        )

    def _in_round(self, scene: Scene, number: int) -> Scene:
        if scene.hold is not None:
            scene = scene.bare(
                replicas=scene.hold.replicas, seed=scene.hold.seed + number
            )
        return scene.model_copy(
            update={
                "surface_seed": scene.surface_seed + (number if self.random else 0)
            }
        )

    def _compared(self, trial: _Trial, number: int) -> Timed:
        """The reference that a trial is compared with: with the noise of its engine, if that is exact."""
        exact = any(one.name == ENGINE and one.exact for one in trial.combination)
        same = (
            self.reference.model_copy(update={"engine": trial.scene.engine})
            if exact
            else self.reference
        )
        return self._task(same, number, compared=False)

    # -- combinations -------------------------------------------------------------------------------------------------

    def observables(self) -> list[str]:
        """The observables that are shown, as far as the reference has them."""
        mean = {
            name: _mean_of(self._references, name)
            for name in self._references[0].values
        }
        names = [BETA] if BETA in mean else []
        if self.scene.ages and self.scene.hold is not None:
            names += [_drop_at(at) for at in _decades(self.scene.hold.hold_times)]
        return [
            *(name for name in names if mean[name] != 0),
            *(name for name in SHOWN_MEASURES if math.isfinite(mean[name])),
        ]

    def _error(self, trial: _Trial, name: str) -> float:
        """The error of the first round, or what it may be where the replicas hide it."""
        differences = trial.differences(name)
        if not differences:
            return math.nan
        return max(
            abs(float(differences[0].mean())), math.sqrt(_noise(differences[0]))
        )

    def _fronts(
        self, trials: list[_Trial], seconds: Callable[[_Trial], float]
    ) -> list[_Trial]:
        """The trials on the front of at least one observable, in the first round."""
        on_front: dict[_Trial, None] = {}
        for name in self.observables():
            comparable = [
                trial
                for trial in trials
                if not math.isnan(self._error(trial, name))
            ]
            on_front |= dict.fromkeys(
                pareto(
                    comparable,
                    lambda one, name=name: (seconds(one), self._error(one, name)),
                )
            )
        return list(on_front)

    def _useful(self) -> dict[str, list[TradeSetting]]:
        """What is chosen -> the values that make their stage cheaper, and are not beaten by another value."""
        own = self.trials[frozenset()]
        useful: dict[str, list[TradeSetting]] = {}
        for name in dict.fromkeys(one.name for one in self.choices):
            singles = [
                trial
                for trial in self.trials.values()
                if [one.name for one in trial.combination] == [name]
            ]

            def seconds(trial: _Trial) -> float:
                return trial.seconds(trial.stage)

            cheaper = [
                trial
                for trial in singles
                if seconds(trial) <= CHEAPER * own.seconds(trial.stage)
            ]
            if name == ENGINE:  # exact engines differ by their speed alone
                exact = [trial for trial in cheaper if trial.combination[0].exact]
                cheaper = [
                    trial for trial in cheaper if trial not in exact
                ] + sorted(exact, key=seconds)[:1]
            front = sorted(self._fronts(cheaper, seconds), key=seconds)
            if len(front) > MOST_VALUES:
                front = [front[0], front[len(front) // 2], front[-1]]
            useful[name] = [trial.combination[0] for trial in front]
        return useful

    def _combinations(self) -> list[_Trial]:
        """Combinations of useful values, the cheapest contacts first."""
        useful = [[None, *values] for values in self._useful().values() if values]
        together: list[Combination] = []
        for chosen in itertools.product(*useful):
            combination = tuple(choice for choice in chosen if choice is not None)
            if len(combination) > 1 and go_together(combination):
                together.append(combination)
        tried = sorted(
            self._tried(together),
            key=lambda trial: self._presumed(trial.combination),
        )[:MOST_TRIED]
        return sorted(tried, key=lambda trial: _contact_of(trial.combination))

    def _presumed(self, combination: Combination) -> float:
        """CPU seconds if every choice saves the same part as alone."""
        own, total = self.trials[frozenset()], 0.0
        for stage in ("contact", "ageing"):
            seconds = own.seconds(stage)
            for one in combination:
                seconds *= self.trials[_key((one,))].seconds(stage) / max(
                    own.seconds(stage), 1e-9
                )
            total += seconds
        return total

    def _promising(self) -> dict[Any, _Trial]:
        """Single choices, and the combinations that may be on a front."""
        everything = list(self.trials.values())
        front = self._fronts(everything, lambda trial: trial.first.seconds)
        contacts = [trial for trial in everything if trial.stage == "contact"]
        front += self._fronts(contacts, lambda trial: trial.first.contact_seconds)
        combined = [
            trial for trial in dict.fromkeys(front) if len(trial.combination) > 1
        ]
        combined.sort(key=lambda trial: trial.first.seconds)
        if len(combined) > MOST_KEPT:
            step = len(combined) / MOST_KEPT
            combined = [combined[int(k * step)] for k in range(MOST_KEPT)]
        return {
            key: trial
            for key, trial in self.trials.items()
            if len(trial.combination) < 2 or trial in combined
        }

    # -- the map ------------------------------------------------------------------------------------------------------

    def map(self) -> Tradeoff:
        """The map of what was measured."""
        own, scatter = self.trials[frozenset()].rounds, {}
        for name in own[0].values if self.random and self.rounds > 1 else ():
            total = np.var([one.values[name].mean() for one in own], ddof=1)
            between = max(
                float(total)
                - float(np.mean([_noise(one.values[name]) for one in own])),
                0.0,
            )
            mean = abs(_mean_of(own, name))
            scatter[name] = math.sqrt(between) / mean if mean else math.nan
        measured = Tradeoff.measured(
            self.scene,
            rounds=self.rounds,
            random=self.random,
            observables=self.observables(),
            surface_scatter=scatter,
            points=[self._point(trial) for trial in self.trials.values()],
            notes=list(self.notes),
        )
        return measured.marked()

    def _point(self, trial: _Trial) -> TradePoint:
        rounds, differences, values, scatter = trial.rounds, {}, {}, {}
        for name in rounds[0].values:
            if not (found := trial.differences(name)):
                continue
            values[name] = _mean_of(rounds, name)
            reference = values[name] - float(np.mean([one.mean() for one in found]))
            scale = abs(reference) if name != DISTRIBUTION else 1.0
            mean, stderr, freedom = _mean_and_error(found, self.random)
            if stderr < 1e-13 * max(abs(mean), scale):  # equal but for rounding
                stderr = 0.0
            differences[name] = (
                (mean / scale, stderr / scale, freedom)
                if scale
                else (math.nan, math.nan, 0)
            )
            if (count := len(rounds[0].values[name])) > 1 and values[name]:
                noise = float(np.mean([_noise(one.values[name]) for one in rounds]))
                scatter[name] = math.sqrt(noise * count) / abs(values[name])
        method = trial.scene.ageing
        return TradePoint(
            choices={one.name: one.label for one in trial.combination},
            changes=changes(self.scene, trial.scene),
            contact_seconds=[one.contact_seconds for one in rounds],
            ageing_seconds=[one.ageing_seconds for one in rounds],
            differences=differences,
            values=values,
            scatter=scatter,
            contact_only=trial.stage == "contact",
            replicates=method is None or method.replicates,
            exact=bool(trial.combination)
            and all(one.exact for one in trial.combination),
            own=not trial.combination,
            remark=_approximate(self.scene, trial.scene),
        )


def _mean_of(rounds: Sequence[_Timing], name: str) -> float:
    """Mean of an observable over rounds."""
    return float(np.mean([one.values[name].mean() for one in rounds]))


def _rounds(scene: Scene) -> int:
    costs = plan(scene)
    seconds = (costs.contact_cpu_seconds or 0.0) + (
        costs.kinetics_cpu_seconds or 0.0
    )
    return next(rounds for most, rounds in ROUNDS if seconds < most)


def _approximate(own: Scene, other: Scene) -> str:
    """What is approximate about the components of ``other`` in sections that are not those of ``own``, in words."""
    before = own.sections()
    changed = [
        name for name, part in other.sections().items() if before.get(name) != part
    ]
    entries = []
    for path, part in other.nested().items():
        if part.role and not part.exact and path.startswith(tuple(changed)):
            error = {"declared_error": part.declared_error, "of": part.error_of}
            entry = {"kind": part.qualified_kind(), **error}
            if entry not in entries:
                entries.append(entry)
    return text.approximations_in_words(entries)


def _mean_and_error(
    rounds: list[np.ndarray], random: bool
) -> tuple[float, float, int]:
    """The mean difference, its standard error, and the degrees of freedom of that.

    Where rounds are surfaces, the error is that of the scatter between these. A few surfaces may by chance scatter less
    than their replicas do: the error is then that of the replicas.
    """
    means = np.array([differences.mean() for differences in rounds])
    if not random:
        means = np.concatenate(rounds)
    count = len(means)
    stderr = float(statistics.standard_error(means))
    if random and min(map(len, rounds)) > 1:
        within = math.sqrt(
            float(np.mean([_noise(differences) for differences in rounds])) / count
        )
        if not stderr >= within:
            return (
                float(means.mean()),
                within,
                sum(len(differences) - 1 for differences in rounds),
            )
    return float(means.mean()), stderr, count - 1


def _noise(values: np.ndarray) -> float:
    """Variance of the mean over replicas; 0 for one."""
    return float(values.var(ddof=1)) / len(values) if len(values) > 1 else 0.0


def _key(combination: Combination) -> frozenset[tuple[str, str]]:
    return frozenset((one.name, one.label) for one in combination)


def _contact_of(combination: Combination) -> str:
    """The part of a combination on which the contact depends."""
    return _words(tuple(one for one in combination if one.stage == "contact"))


def _words(combination: Combination) -> str:
    return ", ".join(one.words for one in combination) or "the scene as it is"


def _drop_at(time: float) -> str:
    return f"{DROP}@{time:g} s"


def _decades(times: np.ndarray) -> list[float]:
    """Of each decade, the hold time that is next to its beginning, where one is within a quarter of a decade."""
    found: dict[int, list[tuple[float, float]]] = {}
    for moment in times[times > 0].tolist():
        power = math.log10(moment)
        away = abs(power - round(power))
        if away < 0.25:
            found.setdefault(round(power), []).append((away, moment))
    return [min(found[power])[1] for power in sorted(found)]
