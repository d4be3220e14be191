"""What is asked of an ensemble: how many surfaces, or how accurate, or how long."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from chemage.contacts.solution import MEASURES
from chemage.foundation.checks import checked_count
from chemage.foundation.errors import InputError
from chemage.foundation.statistics import NORMAL_LIMIT
from chemage.foundation.text import percent
from chemage.foundation.threads import available
from chemage.scene.plan import cost, in_hours
from chemage.scene.scene import (
    LEAST,
    SURFACES_LIMIT,
    EnsembleOptions,
    Scene,
    accuracies,
    budget_seconds,
)
from chemage.studies.ensembles import stages
from chemage.studies.ensembles.computations import (
    DIFFERENCE,
    Computation,
    computations,
    mapped_computations,
    replicas_of_difference,
)
from chemage.studies.ensembles.quantities import (
    MOST,
    AccuracyGoal,
    Quantities,
    limit,
    recorded_measures,
)
from chemage.studies.trade import TradeMap

#: scatter of a quantity between surfaces that is expected where nothing is known, over the mean
SCATTER = 0.05


def time_text(seconds: float) -> str:
    """CPU time in words."""
    return in_hours(seconds) if seconds >= 120 else f"{seconds:.2g} s"


@dataclass(frozen=True)
class Request:
    """What a scene asks of its ensemble, as far as it can be validated before anything is computed."""

    scene: Scene
    quantities: Quantities
    goals: list[AccuracyGoal]
    #: None: as many as the goals or the budget decide
    surfaces: int | None
    #: wall time, s
    budget: float | None
    #: surfaces that are allowed
    most: int
    #: measured costs and errors of settings
    map: TradeMap | None = None

    @classmethod
    def of(cls, scene: Scene, measurements: TradeMap | None = None) -> Request:
        """The request in the sections ``[ensemble]`` and ``[accuracy]`` of a scene; ``measurements`` in place of the
        map that these name.

        Raises
        ------
        InputError
            The request contradicts itself or the scene.
        """
        options = scene.ensemble or EnsembleOptions()
        surfaces, timed = options.surfaces, options.budget is not None
        if surfaces is None and not scene.accuracy and not timed:
            raise InputError("surfaces: give how many, or an accuracy, or a budget")
        if surfaces is not None:
            checked_count("surfaces", surfaces, least=2)
            if scene.accuracy or timed:
                raise InputError(
                    "surfaces, accuracy: give the number of surfaces, or the accuracy (or budget) that decides it"
                )
        if not scene.contact.gives_map:
            raise InputError(
                f"contact {scene.contact.kind!r} is a theory of the mean; it has no surfaces to average over"
            )
        if surfaces is not None and not scene.is_random:
            problem = "but this surface is the same at every seed"
            raise InputError.of(
                "surfaces", surfaces, problem, "use replicas, or an accuracy"
            )
        quantities = Quantities.of(scene, (*MEASURES, *recorded_measures(scene)))
        wishes = [
            AccuracyGoal(name, quantities.asked(name), value)
            for name, value in accuracies(scene.accuracy).items()
        ]
        if scene.load == 0 and wishes:
            raise InputError(
                f"accuracy.{wishes[0].name}: the load is 0, so that its mean is 0; ask at a load"
            )
        if measurements is None and options.map is not None:
            measurements = TradeMap.read(options.map)
        if measurements is not None:
            if surfaces is not None:
                raise InputError(
                    "map: a number of surfaces is computed as the scene is written; leave the map out, or ask for an "
                    "accuracy or a budget"
                )
            measurements.check(scene, options.map or "the map")
        request = cls(
            scene,
            quantities,
            wishes,
            surfaces,
            options.budget,
            options.most,
            measurements,
        )
        if wishes and not timed:
            request._refuse_unreachable()
        return request

    @property
    def random(self) -> bool:
        """Whether another seed gives another surface; else the mean is over replicas on the one surface."""
        return self.scene.is_random

    @property
    def aims(self) -> list[AccuracyGoal]:
        """The goals, or that the first quantity is to be as accurate as the time allows."""
        return self.goals or [AccuracyGoal(self.quantities.names[0], 0, 0.0)]

    def approximation(self) -> np.ndarray:
        """(quantities,) relative standard errors that approximate components of the scene declare; nan: not known."""
        total = np.zeros(self.quantities.count)
        for _, errors in self._declared():
            total += errors**2
        return np.sqrt(total)

    def _declared(self) -> Iterator[tuple[str, np.ndarray]]:
        """The same of each of them."""
        ageing = self.scene.ageing
        for component in self.scene.components():
            own = component is ageing and ageing is not None and ageing.replicates
            if component.exact or own:
                continue
            declared = component.declared_error
            known = {} if declared is None else {"friction_drop": declared}
            errors = self.quantities.columns(known)
            if component not in (self.scene.surface, self.scene.contact):
                # the contact is solved before
                errors[self.quantities.curve.stop :] = 0.0
            yield f"{component.role} {component.kind!r}", errors

    def _refuse_unreachable(self) -> None:
        """Raise an InputError where what is asked has no answer, as far as that is known before."""
        total = NORMAL_LIMIT * self.approximation()
        for goal in self.goals:
            asked, column = (
                f"accuracy.{goal.name} = {100 * goal.accuracy:g} %",
                goal.column,
            )
            if total[column] < goal.accuracy:
                continue
            parts = {
                part: errors[column]
                for part, errors in self._declared()
                if errors[column] != 0
            }
            if unknown := [
                part for part, error in parts.items() if math.isnan(error)
            ]:
                number = ", or give a number of surfaces" if self.random else ""
                raise InputError(
                    f"{asked}: an approximate part of the scene does not say how large its error of this quantity is; "
                    f"replace {unknown[0]} by an exact one{number}"
                )
            listed = ", ".join(
                f"{part} {percent(error)}" for part, error in parts.items()
            )
            raise InputError(
                f"{asked}: errors that no number of {self.counted} makes smaller are larger, ± {percent(total[column])} "
                f"(standard errors: {listed}); ask for a wider interval, or use exact parts"
            )

    @property
    def counted(self) -> str:
        """What is counted: ``surfaces``, or ``replicas`` on the one surface."""
        return "surfaces" if self.random else "replicas"

    @property
    def asked(self) -> dict[int, str]:
        """Column -> name of what is to be accurate: of the goals, or of the first quantity."""
        return {goal.column: goal.name for goal in self.aims}

    @property
    def wishes(self) -> str:
        """The goals in words."""
        return ", ".join(
            f"accuracy.{goal.name} = {100 * goal.accuracy:g} %"
            for goal in self.goals
        )

    def refusal(self, needed: int | None, seconds: float, so_far: str = "") -> str:
        """That more samples are needed than are allowed, with their CPU time, or that no number is enough (None)."""
        if needed is None:
            return (
                f"{self.wishes}: errors that no number of {self.counted} makes smaller are larger{so_far}; ask for a wider "
                "interval"
            )
        about = f"more than {MOST:,}"
        if needed < MOST:
            about = f"about {round(needed, 2 - len(str(needed))):,}"
        return (
            f"{self.wishes}: would need {about} {self.counted} ({time_text(seconds)} of CPU time), and {self.most:,} "
            f"are allowed{so_far}; ask for a wider interval, or allow more with [ensemble] most"
        )

    def computations(self) -> list[Computation]:
        """The computations that may be used, the cheapest first."""
        if self.map is not None:
            budget = math.inf if self.budget is None else self.budget * available()
            chosen = mapped_computations(
                self.map, self.scene, self.quantities, self.aims, budget
            )
            if chosen:
                return chosen
        ways = computations(self.scene)
        if not self.random or self.surfaces is not None:
            ways = ways[-1:]
        elif self.goals:
            ways = ways[self._beginning(ways) :]
        if self.surfaces is not None and self.scene.hold is not None:
            ways = [ways[0].with_replicas(self.scene.hold.replicas)]
        return ways

    def _beginning(self, ways: list[Computation]) -> int:
        """The grid to begin with, which is expected to lead to the goals at the lowest cost: the coarsest one where
        many surfaces are needed, a finer one where its error leaves too little of the interval to few surfaces."""
        surface, area = self.scene.surface, cost(self.scene).area_fraction
        means = {} if area is None else {"area_fraction": area}
        scatter = surface.scatter(means)
        spread = (scatter and scatter.relative) or SCATTER
        left = (min(goal.accuracy for goal in self.goals) / limit(math.inf)) ** 2
        fitted = self.quantities.has_beta
        names = {
            "beta" if fitted and goal.column == 0 else "friction_drop"
            for goal in self.goals
        }

        def seconds(way: Computation) -> float:
            error = 0.0
            if way.factor > 1:
                errors = surface.coarser_errors(way.factor, means)
                error = max(errors.get(name, math.inf) for name in names)
            alone = math.inf
            if error**2 < left:
                alone = (
                    max(stages.FIRST, spread**2 / (left - error**2)) * way.seconds
                )
            own = ways[-1].with_replicas(replicas_of_difference(ways[-1], way))
            both = own.seconds + way.with_replicas(own.replicas).seconds
            corrections = max(stages.FIRST_DIFFERENCES, DIFFERENCE**2 / left) * both
            many = max(stages.FIRST, spread**2 / left) * way.seconds
            return min(alone, many + corrections)

        return min(range(len(ways)), key=lambda number: seconds(ways[number]))

    def accuracy(self) -> np.ndarray:
        """(quantities,) the relative half widths that are asked for; inf where none is, 0 for the first quantity if it
        is to be as accurate as the time allows."""
        accuracy = np.full(self.quantities.count, np.inf)
        for goal in self.aims:
            accuracy[goal.column] = min(accuracy[goal.column], goal.accuracy)
        return accuracy


def with_request(
    scene: Scene,
    *,
    surfaces: int | None = None,
    accuracy: Mapping[str, Any] | None = None,
    budget: float | str | None = None,
    most: int | None = None,
    map: str | Path | None = None,
) -> Scene:
    """``scene`` with these in place of its own sections: a number of surfaces takes the place of an accuracy and a
    budget, and each of these that of a number of surfaces.

    Raises
    ------
    InputError
        A value is not valid, or they contradict each other.
    """
    options: dict[str, Any] = (scene.ensemble or EnsembleOptions()).model_dump()
    goals = dict(scene.accuracy)
    if surfaces is not None:
        checked_count("surfaces", surfaces, 2, SURFACES_LIMIT)
        options |= {"budget": None, "map": None}
        goals = {}
    if surfaces is not None or accuracy or budget is not None:
        options["surfaces"] = surfaces
    if accuracy:
        goals = accuracies(accuracy)
    if budget is not None:
        options["budget"] = budget_seconds(budget)
    if map is not None:
        options["map"] = str(map)
    if most is not None:
        options["most"] = checked_count("most", most, LEAST, SURFACES_LIMIT)
    wish = EnsembleOptions(**options)
    if scene.ensemble is None and wish == EnsembleOptions():
        wish = None
    return scene.model_copy(update={"ensemble": wish, "accuracy": goals})
