"""Scenes as a study: what they have in common is computed once."""

from __future__ import annotations

import pytest

import chemage as ca
from chemage import ChemageError
from chemage.studies.study import Study
from chemage.studies.tasks import Outcome, Task


class Scenes:
    """Scenes as a design: all of them are asked for at once."""

    def __init__(self, scenes: list[ca.Scene]) -> None:
        self.tasks = [Task.of(scene, number=number) for number, scene in enumerate(scenes)]
        self.left = {task.key: task for task in self.tasks}
        self.outcomes: dict[str, Outcome] = {}

    def ask(self) -> list[Task]:
        left, self.left = list(self.left.values()), {}
        return left

    def tell(self, task: Task, outcome: Outcome) -> None:
        if outcome.error is not None:
            raise outcome.error
        self.outcomes[task.key] = outcome


def run_scenes(scenes: list[ca.Scene], workers: int | None = None):
    design = Scenes(scenes)
    with Study("threads" if workers else "serial", workers) as study:
        study.carry_out(design, None)
    return [design.outcomes[task.key].run for task in design.tasks]


@pytest.mark.parametrize("workers", [None, 2])
def test_scenes_with_one_contact_solve_it_once(tiny, workers):
    scenes = [ca.parse_scene(tiny.scene(hold={"times": [1.0, 10.0], "replicas": 1, "seed": seed})) for seed in (1, 2)]
    runs = run_scenes([*scenes, scenes[0]], workers=workers)
    assert [run.scene["hold"]["seed"] for run in runs] == [1, 2, 1]
    assert runs[0].aging == ca.run(scenes[0]).aging
    assert len(tiny.computed("kinetics")) == 3
    assert len(tiny.computed("contact")) == 2  # and that of the run


def test_the_first_error_ends_them(tiny):
    scene = ca.parse_scene(tiny.scene(contact={"kind": "tiny-even", "load": 10.0, "trouble": "raise"}))
    with pytest.raises(ChemageError, match="meant to fail"):
        run_scenes([scene])
