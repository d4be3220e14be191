"""From a scene to its mean over surfaces: as many as are asked for, or as an accuracy or a time needs."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.aging import BARRIERS
from chemage.foundation.errors import InputError, PlanWarning
from chemage.foundation.progress import Report
from chemage.foundation.records import merged_approximations
from chemage.foundation.text import percent
from chemage.foundation.threads import available
from chemage.scene.files import load_scene
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene
from chemage.studies.ensembles import stages
from chemage.studies.ensembles.computations import (
    MEASUREMENT,
    Computation,
    SampleSeries,
    SurfaceLevel,
    area,
    barriers_error,
    fitting,
    measurement_error,
    own_error,
    replicas_of_difference,
    sketched,
    within,
)
from chemage.studies.ensembles.ensemble import Ensemble
from chemage.studies.ensembles.goals import AccuracyGoal, Request, with_request
from chemage.studies.ensembles.quantities import MOST, SurfaceSample
from chemage.studies.study import Design, Selection, carry_out
from chemage.studies.tasks import Outcome, Task
from chemage.studies.trade import TradeMap

#: seconds between two intervals that are shown
PERIOD = 0.25
#: stages that are reported: of the first level, of corrections, and of the control
SAMPLING, CORRECTING, SKETCHING = "sampling", "correcting", "sketching"
#: notes of every ensemble, and of one whose surface is the same at every seed
OWN_ERRORS = "the errors of the scene's own contact grid, tolerance and precision are not in the interval"
ONE_SURFACE = "the surface is the same at every seed: the interval is about disorder and noise alone"


def ensemble(
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    surfaces: int | None = None,
    accuracy: Mapping[str, Any] | None = None,
    budget: float | str | None = None,
    most: int | None = None,
    measured: str | Path | TradeMap | None = None,
    samples: str | Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
    threads: int | None = None,
    patience: float | str | None = None,
    points: str | None = None,
    progress: Report | None = None,
) -> Ensemble:
    """The mean of a scene over random surfaces, each with its own disorder.

    Where the seed does not change the surface (a tip, a measured one), the mean is over replicas on it.

    Parameters
    ----------
    scene
        A :class:`Scene`, a scene file, the name of an installed scene, or scene data.
    surfaces
        How many surfaces, computed as the scene is written; in place of an ``accuracy`` and ``budget`` of the scene.
        What is not given here is as the scene says in ``[ensemble]`` and ``[accuracy]``.
    accuracy
        Quantity -> relative half width of its 95 % interval, such as ``{"beta": "2 %", "friction_coefficient_drop@1e3
        s": 0.05}``. The cheapest computations that reach it are chosen: grids, surfaces and replicas.
    budget
        Wall time, s or with a unit; the interval is as narrow as it allows. With ``accuracy``: whichever comes first.
    most
        Surfaces that are allowed; default: as the scene says, or 10,000.
    measured
        The map of this scene, or its file (``chemage tradeoff SCENE -o FILE``): the settings are chosen by costs and
        errors that were measured, and no longer by estimates.
    samples
        Folder in which samples are kept, and from which they are taken; default: none are kept.
    executor, workers, threads, patience
        Where to compute, the number of surfaces at the same time, and the threads of each, as for
        :func:`chemage.sweep`; default: as many threads of this process as there are processors, a surface in each.
        Results do not depend on them.
    points
        Compute a share of the samples while other processes compute the others into the same folder ``samples``:
        ``"3/16"``, or ``"auto"``, the share of this task of a job array. Each of them waits for the others, at most
        ``patience`` without a new sample, and returns the same mean.
    progress
        Called as samples are taken, with stage, number, expected total, and the interval so far.

    Raises
    ------
    InputError
        What is asked for contradicts itself, or cannot be reached.
    """
    map, file = (measured, None) if isinstance(measured, TradeMap) else (None, measured)
    asked = with_request(
        load_scene(scene).completed(),
        surfaces=surfaces,
        accuracy=accuracy,
        budget=budget,
        most=most,
        map=file,
    )
    return Sampler(
        asked,
        samples=samples,
        executor=executor,
        workers=workers,
        threads=threads,
        patience=patience,
        points=points,
        measured=map,
    ).run(progress)


def _silent(stage: str, done: int, total: int, note: str = "") -> None:
    pass


class Sampler(Design):
    """Takes the samples of one ensemble, as a design of a study."""

    def __init__(
        self,
        scene: Scene,
        *,
        samples: str | Path | None = None,
        executor: str | Executor = "threads",
        workers: int | None = None,
        threads: int | None = None,
        patience: float | str | None = None,
        points: str | None = None,
        measured: TradeMap | None = None,
        warn: bool = True,
    ) -> None:
        with scene.in_use():
            self.request = Request.of(scene, measured)
            costs = cost(scene)
            costs.check()
            for doubt in costs.doubts() if warn else ():
                if (
                    doubt.kind != "long"
                ):  # how long an ensemble takes is another question
                    warnings.warn(doubt.text, PlanWarning, stacklevel=4)
        #: how many samples were taken from the folder
        self.taken = 0
        if samples is not None and any(Path(samples).glob("*.samples")):
            text = "samples of chemage 0.2 (*.samples) are not used; they are computed again, and may be removed"
            warnings.warn(f"{samples}: {text}", UserWarning, stacklevel=4)
        self.scene, self._quantities = scene, self.request.quantities
        self._executor, self._workers, self._threads, self._patience = (
            executor,
            workers,
            threads,
            patience,
        )
        self._folder, self._points = samples, points
        if points is not None and self.request.budget is not None:
            raise InputError.of(
                "points", points, "a wall time cannot be shared", "ask for an accuracy"
            )
        self._progress: Report = _silent
        self._routes: list[stages.Route] = []
        self._rule: Iterator[stages.Need] | None = None
        self._state: stages.SamplingState | None = None
        #: key of a task that was asked for -> the samples that it belongs to
        self._waiting: dict[str, tuple[SampleSeries, Task]] = {}
        #: (quantities,) relative standard errors of the barriers, and how they are known; measured when sampling begins
        self._barriers, self._barriers_how = np.zeros(self.request.quantities.count), ""
        #: the same of what is not known of a measured surface
        self._measured, self._measured_how = self._barriers, ""
        #: the route and the levels that are sampled since the last stage, and the counts that are aimed at
        self._route: stages.Route | None = None
        self._levels: Sequence[stages.Level] = ()
        self._aimed: dict[str, int] = {}
        self._shown = (-math.inf, "")

    def run(self, progress: Report | None = None) -> Ensemble:
        """Sample until the request is fulfilled, and call ``progress`` as samples are taken.

        Raises
        ------
        InputError
            It cannot be fulfilled.
        """
        self._progress = progress or _silent
        try:
            carry_out(
                self,
                self._folder,
                **self._where(),
                patience=self._patience,
                points=self._points,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(self._so_far()) from None
        return self.ensemble()

    @property
    def writes(self) -> bool:
        """Whether this process writes the result, and not another share."""
        share = None if self._points is None else Selection.read(self._points).share
        return share is None or share[0] == 1

    def _where(self) -> dict[str, Any]:
        """Executor, workers and threads of each; threads of this process are a surface each, if memory allows two."""
        where = {
            "executor": self._executor,
            "workers": self._workers,
            "threads": self._threads,
        }
        if self._executor != "threads" or self._workers is not None:
            return where
        threads = self._threads or available()
        if fitting(self.request.computations()[0], threads) > 1:
            return where | {"workers": threads, "threads": 1}
        return where | {"executor": "serial", "threads": threads}

    # -- as a design --------------------------------------------------------------------------------------------------

    def ask(self) -> list[Task]:
        """The tasks of the samples that are needed now.

        Raises
        ------
        InputError
            What is asked cannot be reached.
        """
        with self.scene.in_use():
            if self._rule is None:
                self._measure_members()
                self._routes = self.possible_routes()
                self._rule = self._steps()
            try:
                for level, count in self._rule:
                    self._waiting = {}
                    for part in level.parts:
                        self._waiting |= {
                            task.key: (part, task) for task in part.missing(count)
                        }
                    if self._waiting:
                        return [task for _, task in self._waiting.values()]
            except stages.Unreachable as error:
                raise InputError(self._explained(error)) from None
            return []

    def tell(self, task: Task, outcome: Outcome) -> None:
        """Receive a sample."""
        part, _ = self._waiting[task.key]
        self.taken += outcome.kept
        part.receive(task.number, SurfaceSample.of(outcome))

    def ensemble(self) -> Ensemble:
        """The result, when nothing more is asked."""
        assert self._state is not None
        counted = self.request.surfaces is not None
        with self.scene.in_use():
            stopped = (
                "the number of surfaces that was asked for"
                if counted
                else self._ending(self._state)
            )
            return self._made(self._state, stopped)

    def _steps(self) -> Iterator[stages.Need]:
        """The rule, which stops where samples have to be taken."""
        asked = self.request
        clock = stages.Clock(asked.budget if asked.budget is not None else math.inf)
        if asked.surfaces is not None:
            counted = stages.Sampled(self._routes[0].levels[0])
            yield from clock.upto(counted, asked.surfaces)
            nothing = np.zeros(self._quantities.count, dtype=bool)
            self._state = stages.SamplingState(self._routes[0], [counted], nothing)
            return
        rule = stages.steps(
            self._routes,
            asked.accuracy(),
            most=asked.most,
            clock=clock,
            watch=self._watch,
        )
        self._state = yield from rule

    def _ending(self, state: stages.SamplingState) -> str:
        """Why sampling ended, in words."""
        if state.reached(self.request.accuracy()):
            return "the accuracy was reached"
        if self.request.budget is None:
            half = state.half_width()
            equal = ", ".join(
                goal.name
                for goal in self.request.goals
                if math.isnan(half[goal.column])
            )
            return f"{equal}: all samples are equal, so that nothing is known of their scatter"
        if max(state.counts) >= self.request.most:
            return f"the {self.request.counted} are as many as are allowed"
        return "the time was over"

    def possible_routes(self) -> list[stages.Route]:
        """Ways to the answer, the one without corrections first."""
        ways = self.request.computations()
        base = np.hypot(self.request.approximation(), self._barriers)
        base = np.hypot(base, self._measured)
        coarse, fine = ways[0], ways[-1]
        row = self._quantities.row
        single = SurfaceLevel(SAMPLING, row, self._samples(coarse, 0, SAMPLING))
        sketch = (
            sketched(coarse)
            if self.request.random and self.request.surfaces is None
            else None
        )
        control = (
            None
            if sketch is None
            else SurfaceLevel(SKETCHING, area, self._samples(sketch, 0, SKETCHING))
        )
        if len(ways) == 1 or (coarse.errors is not None and not coarse.errors.any()):
            return [stages.Route("own grid", (single,), lambda mean: base, control)]
        replicas = replicas_of_difference(fine, coarse)
        pair = [
            self._samples(way.with_replicas(replicas), 1, CORRECTING * (way is fine))
            for way in (fine, coarse)
        ]
        difference = SurfaceLevel(CORRECTING, row, *pair)
        corrected = stages.Route(
            "corrected", (single, difference), lambda mean: base, control
        )

        def before(mean: np.ndarray) -> np.ndarray:
            return np.sqrt(base**2 + self._coarsening(coarse, mean) ** 2)

        return [stages.Route("not corrected", (single,), before, control), corrected]

    def _samples(
        self, computation: Computation, level: int, stage: str = ""
    ) -> SampleSeries:
        return SampleSeries(
            computation,
            level=level,
            varied=self.request.random,
            taken=partial(self._taken, stage) if stage else None,
        )

    # -- errors that are known before ---------------------------------------------------------------------------------

    def _measure_members(self) -> None:
        """Age members of the distribution of barriers on the first surface, and compute those of the surface, where
        there are some."""
        cheapest = self.request.computations()[0]
        self._barriers, self._barriers_how = barriers_error(
            cheapest,
            self._samples(cheapest, 0).seeds(0),
            self._quantities,
            self._threads,
            lambda done, total: self._progress(BARRIERS, done, total),
        )
        self._measured, self._measured_how = measurement_error(
            self._samples(cheapest, 0),
            self._quantities,
            self._threads,
            lambda done, total: self._progress(MEASUREMENT, done, total),
        )

    def _coarsening(self, computation: Computation, mean: np.ndarray) -> np.ndarray:
        """(quantities,) relative standard errors of a coarse grid, as far as the maker of the surface knows them; or of
        other settings, as the map has them."""
        if computation.errors is not None:
            return computation.errors
        measures = dict(
            zip(
                self._quantities.measures,
                mean[self._quantities.curve.stop :].tolist(),
                strict=True,
            )
        )
        return self._quantities.columns(
            self.scene.surface.coarser_errors(computation.factor, measures)
        )

    # -- progress and messages ----------------------------------------------------------------------------------------

    def _watch(self, state: stages.SamplingState, aimed: list[int]) -> None:
        self._route, self._levels = (
            state.route,
            [sampled.level for sampled in state.sampled],
        )
        self._aimed = {
            level.name: count for level, count in zip(self._levels, aimed, strict=True)
        }

    def _taken(self, stage: str, done: int) -> None:
        """Report one more sample."""
        first = {
            SAMPLING: self.request.surfaces or stages.FIRST,
            CORRECTING: stages.FIRST_DIFFERENCES,
        }
        total = self._aimed.get(stage, first.get(stage, done))
        now = time.monotonic()
        if now - self._shown[0] > PERIOD:
            self._shown = (now, self._interval())
        if done < total:  # more may be needed: the end is reported when it is certain
            self._progress(stage, done, total, self._shown[1])

    def _interval(self) -> str:
        """The interval of what is asked from the samples so far, in words; "" where there are too few."""
        route = self._route or self._routes[0]
        looks = 0 if self.request.surfaces is not None else stages.LOOKS
        sampled = [
            stages.Sampled(level, level.sample(0, MOST), looks=looks)
            for level in self._levels or route.levels
        ]
        if min(part.count for part in sampled) < 2:
            return ""
        if len(sampled) > len(route.levels):  # a sample may be there before its control
            pairs = min(sampled[0].count, sampled[-1].count)
            sampled[0].values = sampled[0].values[:pairs]
        state = stages.SamplingState(
            route, sampled, np.zeros(self._quantities.count, dtype=bool)
        )
        return self._in_words(state.mean, state.half_width())

    def _in_words(self, mean: np.ndarray, half: np.ndarray) -> str:
        shown = self.request.goals or [AccuracyGoal(self._quantities.names[0], 0, 0.0)]
        parts = []
        for goal in shown:
            reached = (
                half[goal.column] / abs(mean[goal.column])
                if mean[goal.column]
                else math.nan
            )
            if math.isfinite(reached):
                goal_text = f" of {100 * goal.accuracy:.3g} %" if goal.accuracy else ""
                parts.append(f"{goal.name} ± {percent(reached)}{goal_text}")
        return ", ".join(parts)

    def _so_far(self) -> str:
        """What an interrupted ensemble leaves, in words."""
        route = self._route or self._routes[0]
        counts = " and ".join(str(len(level.sample(0, MOST))) for level in route.levels)
        kept = ""
        if self._folder is not None:
            kept = (
                f", kept in {self._folder}; the same command takes them up and goes on"
            )
        return f"so far {self._interval() or 'too few for an interval,'} from {counts} samples{kept}"

    def _explained(self, error: stages.Unreachable) -> str:
        state, asked = error.state, self.request
        words = self._in_words(state.mean, state.half_width())
        so_far = f"{words or 'no interval'} from {state.sampled[0].count} samples"
        if error.reason == "zero":
            text = f"its mean is 0 within its interval ({so_far}), so that no relative accuracy can be reached"
            return f"{asked.wishes}: {text}"
        if error.reason == "unknown":
            undefined = [
                goal.name for goal in asked.goals if math.isnan(state.mean[goal.column])
            ]
            if undefined:
                return f"accuracy.{undefined[0]}: some contacts of this scene do not have this quantity; leave it out"
            return (
                f"{asked.wishes}: an approximate part of the scene does not say how large its error of this quantity "
                "is; leave the part out, or ask for the friction drop"
            )
        scale = state.sampled[0].level.parts[0].computation.scale
        seconds = scale * sum(
            count * sampled.level.cost
            for count, sampled in zip(error.needed or (), state.sampled, strict=False)
        )
        return asked.refusal(
            max(error.needed) if error.needed else None, seconds, f" ({so_far})"
        )

    # -- the result ---------------------------------------------------------------------------------------------------

    def _made(self, state: stages.SamplingState, stopped: str) -> Ensemble:
        interval = self._in_words(state.mean, state.half_width())
        levels, rows, inside = [], {}, None
        for number, sampled in enumerate(state.sampled):
            name, parts = sampled.level.name, sampled.level.parts
            self._progress(name, sampled.count, sampled.count, interval)
            levels.append(self._described(sampled, parts))
            rows[str(number)] = np.array(sampled.values)
            if name == SKETCHING:
                levels[-1]["control"] = True
            else:
                inside = within(parts, self._quantities) or inside
        errors, how = {}, {}
        approximation = self.request.approximation()
        if not np.all(approximation == 0):
            errors["approximation"], how["approximation"] = (
                approximation,
                "declared by the approximate parts",
            )
        if self._barriers_how:
            errors[BARRIERS], how[BARRIERS] = self._barriers, self._barriers_how
        if self._measured_how:
            errors[MEASUREMENT] = self._measured
            how[MEASUREMENT] = self._measured_how
        if state.route.name == "not corrected":
            part = state.sampled[0].level.parts[0].computation
            name = "discretisation" if part.grid_only else "settings"
            errors[name] = self._coarsening(part, state.mean)
            how[name] = (
                f"measured before on other surfaces, pixels {part.factor} times larger"
            )
            if part.errors is not None:
                how[name] = f"measured for the map: {part.settings}"
        return Ensemble(
            hold_times=self._quantities.hold_times,
            load=self._quantities.load,
            window=self._quantities.window,
            measures=self._quantities.measures,
            levels=tuple(levels),
            rows=rows,
            within={} if inside is None else {"variance": inside[0]},
            known=errors,
            known_how=how,
            goals={goal.name: goal.accuracy for goal in self.request.goals},
            stopped=stopped,
            notes=self._notes(),
            provenance=self._provenance(state),
        )

    def _notes(self) -> tuple[str, ...]:
        notes = (OWN_ERRORS,) if self.request.random else (ONE_SURFACE, OWN_ERRORS)
        if doubt := self._quantities.doubt:
            notes = (*notes, doubt)
        if self.request.map is None or not (
            text := own_error(self.request.map, self._quantities)
        ):
            return notes
        return (*notes, text)

    def _provenance(self, state: stages.SamplingState) -> dict[str, Any]:
        samples = [
            sample
            for level in state.sampled
            for part in level.level.parts
            for sample in part.samples
        ]
        plugins = {
            name: source
            for sample in samples
            for name, source in sample.plugins.items()
        }
        approximate = merged_approximations(*(sample.approximate for sample in samples))
        return {
            "scene": self.scene.todict(),
            "versions": {**versions(self.scene), **plugins},
            "cite": list(self.scene.cite()),
            **({"plugins": plugins} if plugins else {}),
            **({"approximate": approximate} if approximate else {}),
        }

    def _described(
        self, sampled: stages.Sampled, parts: tuple[SampleSeries, ...]
    ) -> dict[str, Any]:
        """A level as it is in the record."""
        return {
            "words": " minus ".join(part.computation.words for part in parts),
            "replicas": parts[0].computation.replicas,
            "samples": sampled.count,
            "cpu_seconds": sampled.level.cost,
            "variance_of": sampled.frozen or sampled.count,
            "freedom": sampled.freedom,
            "random": self.request.random,
            "seeds": [list(parts[0].seeds(k)) for k in range(min(sampled.count, 10))],
        }
