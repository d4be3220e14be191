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

from chemage.ageing.ageing import BARRIERS
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
from chemage.studies.ensembles.goals import Request, with_request
from chemage.studies.ensembles.quantities import (
    MOST,
    SurfaceSample,
    declared_outputs,
)
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
    map, file = (
        (measured, None) if isinstance(measured, TradeMap) else (None, measured)
    )
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
        measured: TradeMap | None = None,
        warn: bool = True,
        samples: str | Path | None = None,
        points: str | None = None,
        executor: str | Executor = "threads",
        **where: Any,
    ) -> None:
        """``samples``, ``points``, ``executor`` and ``where`` as for :func:`ensemble`."""
        with scene.in_use():
            self.request = Request.of(scene, measured)
            costs = cost(scene)
            costs.check()
            for doubt in costs.doubts() if warn else ():
                # how long an ensemble takes is another question
                if doubt.kind != "long":
                    warnings.warn(doubt.text, PlanWarning, stacklevel=4)
        #: how many samples were taken from the folder
        self.taken = 0
        if samples is not None and any(Path(samples).glob("*.samples")):
            text = "samples of chemage 0.2 (*.samples) are not used; they are computed again, and may be removed"
            warnings.warn(f"{samples}: {text}", UserWarning, stacklevel=4)
        self.scene, self._quantities = scene, self.request.quantities
        self._folder, self._points = samples, points
        self._where = {"executor": executor, **where}
        if points is not None and self.request.budget is not None:
            raise InputError.of(
                "points",
                points,
                "a wall time cannot be shared",
                "ask for an accuracy",
            )
        self._progress: Report = _silent
        self._rule: Iterator[stages.Need] | None = None
        self._state: stages.SamplingState | None = None
        #: key of a task that was asked for -> the samples that it belongs to
        self._waiting: dict[str, tuple[SampleSeries, Task]] = {}
        #: (quantities,) relative standard errors of what members of barriers and of the surface show, and how they are
        #: known; measured when sampling begins
        self._members: dict[str, tuple[np.ndarray, str]] = {}
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
            carry_out(self, self._folder, points=self._points, **self._place())
        except KeyboardInterrupt:
            raise KeyboardInterrupt(self._so_far()) from None
        return self.ensemble()

    @property
    def writes(self) -> bool:
        """Whether this process writes the result, and not another share."""
        share = None if self._points is None else Selection.read(self._points).share
        return share is None or share[0] == 1

    def _place(self) -> dict[str, Any]:
        """Where to compute; threads of this process are a surface each, if memory allows two."""
        where = self._where
        if where["executor"] != "threads" or where.get("workers") is not None:
            return where
        threads = where.get("threads") or available()
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
                self.measure_members()
                routes = self.possible_routes()
                self._route, self._levels = routes[0], routes[0].levels
                self._rule = self._steps(routes)
            try:
                for level, count in self._rule:
                    self._waiting = {
                        task.key: (part, task)
                        for part in level.parts
                        for task in part.missing(count)
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
        with self.scene.in_use():
            return self._made(self._state)

    def _steps(self, routes: Sequence[stages.Route]) -> Iterator[stages.Need]:
        """The rule, which stops where samples have to be taken."""
        asked = self.request
        clock = stages.Clock(math.inf if asked.budget is None else asked.budget)
        if asked.surfaces is not None:
            counted = stages.Sampled(routes[0].levels[0])
            yield from clock.upto(counted, asked.surfaces)
            nothing = np.zeros(self._quantities.count, dtype=bool)
            self._state = stages.SamplingState(routes[0], [counted], nothing)
            return
        self._state = yield from stages.steps(
            routes,
            asked.accuracy(),
            most=asked.most,
            clock=clock,
            watch=self._watch,
        )

    def _ending(self, state: stages.SamplingState) -> str:
        """Why sampling ended, in words."""
        asked = self.request
        if asked.surfaces is not None:
            return "the number of surfaces that was asked for"
        if state.reached(asked.accuracy()):
            return "the accuracy was reached"
        if asked.budget is None:
            half = state.half_width()
            equal = [
                goal.name for goal in asked.goals if math.isnan(half[goal.column])
            ]
            return f"{', '.join(equal)}: all samples are equal, so that nothing is known of their scatter"
        if max(state.counts) >= asked.most:
            return f"the {asked.counted} are as many as are allowed"
        return "the time was over"

    def possible_routes(self) -> list[stages.Route]:
        """Ways to the answer, the one without corrections first."""
        ways, row = self.request.computations(), self._quantities.row
        base = self.request.approximation()
        for errors, _ in self._members.values():
            base = np.hypot(base, errors)
        coarse, fine = ways[0], ways[-1]
        single = SurfaceLevel(SAMPLING, row, self._samples(coarse, 0, SAMPLING))
        control = None
        if self.request.random and self.request.surfaces is None:
            sketch = sketched(coarse)
            if sketch is not None:
                series = self._samples(sketch, 0, SKETCHING)
                control = SurfaceLevel(SKETCHING, area, series)

        def always(mean: np.ndarray) -> np.ndarray:
            return base

        def before(mean: np.ndarray) -> np.ndarray:
            return np.hypot(base, self._coarsening(coarse, mean))

        if len(ways) == 1 or (
            coarse.errors is not None and not coarse.errors.any()
        ):
            return [stages.Route("own grid", (single,), always, control)]
        replicas = replicas_of_difference(fine, coarse)
        pair = [
            self._samples(
                way.with_replicas(replicas), 1, CORRECTING * (way is fine)
            )
            for way in (fine, coarse)
        ]
        levels = single, SurfaceLevel(CORRECTING, row, *pair)
        return [
            stages.Route("not corrected", (single,), before, control),
            stages.Route("corrected", levels, always, control),
        ]

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

    def measure_members(self) -> None:
        """Age members of the distribution of barriers on the first surface, and compute those of the surface, where
        there are some."""
        cheapest = self.request.computations()[0]
        samples = self._samples(cheapest, 0)
        for name, measured in (
            (BARRIERS, barriers_error),
            (MEASUREMENT, measurement_error),
        ):
            errors, how = measured(
                samples,
                self._quantities,
                self._where.get("threads"),
                partial(self._progress, name),
            )
            if how:
                self._members[name] = errors, how

    def _coarsening(self, computation: Computation, mean: np.ndarray) -> np.ndarray:
        """(quantities,) relative standard errors of a coarse grid, as far as the maker of the surface knows them; or of
        other settings, as the map has them."""
        if computation.errors is not None:
            return computation.errors
        quantities = self._quantities
        measures = mean[quantities.curve.stop :].tolist()
        errors = self.scene.surface.coarser_errors(
            computation.factor,
            dict(zip(quantities.measures, measures, strict=True)),
        )
        return quantities.columns(errors)

    # -- progress and messages ----------------------------------------------------------------------------------------

    def _watch(self, state: stages.SamplingState, aimed: list[int]) -> None:
        self._route = state.route
        self._levels = [sampled.level for sampled in state.sampled]
        names = [level.name for level in self._levels]
        self._aimed = dict(zip(names, aimed, strict=True))

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
        if (
            done < total
        ):  # more may be needed: the end is reported when it is certain
            self._progress(stage, done, total, self._shown[1])

    def _interval(self) -> str:
        """The interval of what is asked from the samples so far, in words; "" where there are too few."""
        looks = 0 if self.request.surfaces is not None else stages.LOOKS
        sampled = [
            stages.Sampled(level, level.sample(0, MOST), looks=looks)
            for level in self._levels
        ]
        if self._route is None or min(part.count for part in sampled) < 2:
            return ""
        nothing = np.zeros(self._quantities.count, dtype=bool)
        state = stages.SamplingState(self._route, sampled, nothing)
        if state.controlled:  # a sample may be there before its control
            sampled[0].values = sampled[0].values[: sampled[-1].count]
        return self._in_words(state)

    def _in_words(self, state: stages.SamplingState) -> str:
        """The interval of what is asked; "" where there is none."""
        relative, parts = state.relative(), []
        for goal in self.request.aims:
            reached = relative[goal.column]
            if math.isfinite(reached):
                asked = f" of {100 * goal.accuracy:.3g} %" if goal.accuracy else ""
                parts.append(f"{goal.name} ± {percent(reached)}{asked}")
        return ", ".join(parts)

    def _so_far(self) -> str:
        """What an interrupted ensemble leaves, in words."""
        levels = self._route.levels if self._route else ()
        counts = [str(len(level.sample(0, MOST))) for level in levels]
        kept = ""
        if self._folder is not None:
            kept = f", kept in {self._folder}; the same command takes them up and goes on"
        return f"so far {self._interval() or 'too few for an interval,'} from {' and '.join(counts) or 0} samples{kept}"

    def _explained(self, error: stages.Unreachable) -> str:
        state, asked = error.state, self.request
        count = state.sampled[0].count
        so_far = f"{self._in_words(state) or 'no interval'} from {count} samples"
        if error.reason == "zero":
            return (
                f"{asked.wishes}: its mean is 0 within its interval ({so_far}), so that no relative accuracy can be "
                "reached"
            )
        if error.reason == "unknown":
            for goal in asked.goals:
                if math.isnan(state.mean[goal.column]):
                    return f"accuracy.{goal.name}: some contacts of this scene do not have this quantity; leave it out"
            return (
                f"{asked.wishes}: an approximate part of the scene does not say how large its error of this quantity "
                "is; leave the part out, or ask for the friction drop"
            )
        needed = error.needed or [0]
        costs = [sampled.level.cost for sampled in state.sampled]
        seconds = float(np.dot(needed[: len(costs)], costs[: len(needed)]))
        scale = state.sampled[0].level.parts[0].computation.scale
        return asked.refusal(max(needed) or None, scale * seconds, f" ({so_far})")

    # -- the result ---------------------------------------------------------------------------------------------------

    def _made(self, state: stages.SamplingState) -> Ensemble:
        interval, quantities = self._in_words(state), self._quantities
        levels, rows, inside = [], {}, {}
        for number, sampled in enumerate(state.sampled):
            name, parts = sampled.level.name, sampled.level.parts
            self._progress(name, sampled.count, sampled.count, interval)
            levels.append(self._described(sampled))
            rows[str(number)] = np.array(sampled.values)
            if name == SKETCHING:
                levels[-1]["control"] = True
            elif (variance := within(parts, quantities)) is not None:
                inside = {"variance": variance}
        known = self._known(state)
        return Ensemble(
            hold_times=quantities.hold_times,
            load=quantities.load,
            window=quantities.window,
            measures=quantities.measures,
            outputs={
                name: output.todict()
                for name, output in declared_outputs(self.scene).items()
            },
            levels=tuple(levels),
            rows=rows,
            within=inside,
            known={name: errors for name, (errors, _) in known.items()},
            known_how={name: how for name, (_, how) in known.items()},
            goals={goal.name: goal.accuracy for goal in self.request.goals},
            stopped=self._ending(state),
            notes=self._notes(),
            provenance=self._provenance(state),
        )

    def _known(
        self, state: stages.SamplingState
    ) -> dict[str, tuple[np.ndarray, str]]:
        """The errors that no sampling makes smaller: relative standard errors, and how they are known."""
        known = {}
        approximation = self.request.approximation()
        if not np.all(approximation == 0):
            known["approximation"] = (
                approximation,
                "declared by the approximate parts",
            )
        known |= self._members
        if state.route.name == "not corrected":
            part = state.sampled[0].level.parts[0].computation
            name = "discretisation" if part.grid_only else "settings"
            how = f"measured before on other surfaces, pixels {part.factor} times larger"
            if part.errors is not None:
                how = f"measured for the map: {part.settings}"
            known[name] = self._coarsening(part, state.mean), how
        return known

    def _notes(self) -> tuple[str, ...]:
        map, quantities = self.request.map, self._quantities
        notes = [
            "" if self.request.random else ONE_SURFACE,
            OWN_ERRORS,
            quantities.doubt,
            "" if map is None else own_error(map, quantities),
        ]
        return tuple(filter(None, notes))

    def _provenance(self, state: stages.SamplingState) -> dict[str, Any]:
        plugins, approximate = {}, []
        for sampled in state.sampled:
            for part in sampled.level.parts:
                for sample in part.samples:
                    plugins |= sample.plugins
                    approximate.append(sample.approximate)
        provenance = {
            "scene": self.scene.todict(),
            "versions": {**versions(self.scene), **plugins},
            "cite": list(self.scene.cite()),
        }
        more = {
            "plugins": plugins,
            "approximate": merged_approximations(*approximate),
        }
        return provenance | {name: value for name, value in more.items() if value}

    def _described(self, sampled: stages.Sampled) -> dict[str, Any]:
        """A level as it is in the record."""
        parts = sampled.level.parts
        return {
            "words": " minus ".join(part.computation.words for part in parts),
            "replicas": parts[0].computation.replicas,
            "samples": sampled.count,
            "cpu_seconds": sampled.level.cost,
            "variance_of": sampled.chosen,
            "freedom": sampled.freedom,
            "random": self.request.random,
            "seeds": [
                list(parts[0].seeds(k)) for k in range(min(sampled.count, 10))
            ],
        }
