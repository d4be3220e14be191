"""Samples of a computation on many surfaces: the tasks that give them, and what is kept of them."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from chemage.foundation.errors import ExecutorError
from chemage.plugins.sources import changed
from chemage.scene.provenance import versions
from chemage.scene.scene import Scene
from chemage.studies.ensembles.computations import Computation, Sample
from chemage.studies.ensembles.quantities import Quantities
from chemage.studies.tasks import Outcome, Place, Task, forget

#: called when a sample is there, with those of its computation so far
Taken = Callable[["Samples"], None]


def seed_of(base: int, level: int, number: int, what: int) -> int:
    """The seed of sample ``number`` of a level, a function of the arguments alone: of its surface (``what`` 0), or of
    its disorder and noise (1).

    It is a whole number below 2^53, so that ``chemage run --set surface.seed=...`` makes the same surface.
    """
    words = np.random.SeedSequence(base, spawn_key=(level, number, what)).generate_state(2, np.uint32)
    return (int(words[0]) << 21) | (int(words[1]) >> 11)


@dataclass
class Store:
    """Where samples are kept."""

    #: None: nothing is kept
    path: Path | None
    scene: Scene
    #: how many samples were found there
    found: int = 0
    _versions: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._versions = {name: text for name, text in versions(self.scene).items() if name != "processor"}
        if self.path is not None and any(self.path.glob("*.samples")):
            text = "samples of chemage 0.2 (*.samples) are not used; they are computed again, and may be removed"
            warnings.warn(f"{self.path}: {text}", UserWarning, stacklevel=4)

    @property
    def place(self) -> Place | None:
        """The same for workers."""
        return None if self.path is None else Place(str(self.path.absolute()), contacts=False)

    def get(self, task: Task) -> Sample | None:
        """The sample of a task; None if it is not there, damaged, or of other versions."""
        if self.place is None:
            return None
        content = self.place.folder.read_point(task.key)
        if content["status"] != "done" or changed(content["plugins"]):
            return None
        recorded = content["summary"]["versions"]
        if any(recorded.get(name) != text for name, text in self._versions.items()):
            return None
        self.found += 1
        return Sample.of(Outcome(content=content))

    def sample(self, task: Task, outcome: Outcome) -> Sample:
        """The sample that a task gave, which may be in the folder only.

        Raises
        ------
        ExecutorError
            Another version of chemage has computed it.
        """
        if outcome.error is not None:
            raise outcome.error
        if outcome.run is None and outcome.content is None:
            assert self.place is not None
            outcome = Outcome(content=self.place.folder.read_point(task.key))
        if outcome.content is not None:
            version = outcome.content["summary"]["versions"]["chemage"]
            if version != self._versions["chemage"]:
                raise ExecutorError(
                    f"a worker has chemage {version}, but the mean is run by {self._versions['chemage']}"
                )
        return Sample.of(outcome)

    def close(self, *, shared: bool) -> None:
        """Free what this process has in memory; unless other processes use the folder, remove what is needed while
        samples are written."""
        forget("" if self.place is None else self.place.path)
        if self.place is not None and not shared:
            shutil.rmtree(self.place.folder.path / ".parts", ignore_errors=True)


class Samples:
    """The samples of one computation on the surfaces (or replicas) of one level."""

    def __init__(
        self, computation: Computation, *, level: int, varied: bool, store: Store, taken: Taken | None = None
    ) -> None:
        """``varied``: another surface for each sample; else the surface of the scene with other replicas."""
        self.computation, self.level, self.varied = computation, level, varied
        #: without gaps, in the order of their numbers
        self.samples: list[Sample] = []
        self._store, self._taken = store, taken
        self._later: dict[int, Sample] = {}

    def seeds(self, number: int) -> tuple[int, int]:
        """The seeds of surface and disorder of a sample."""
        scene = self.computation.scene
        base = scene.hold.seed if scene.hold is not None else 0
        surface = seed_of(scene.surface_seed, self.level, number, 0) if self.varied else scene.surface_seed
        return surface, seed_of(base, self.level, number, 1)

    def task(self, number: int) -> Task:
        """The task of a sample."""
        one = self.computation
        replicas = one.replicas if one.scene.ages else 0
        return Task.of(
            one.seeded(*self.seeds(number)),
            number=number,
            contact_seconds=one.contact_seconds,
            ageing_seconds=one.replica_seconds * replicas,
            bytes=one.bytes or 0.0,
            members=False,
        )

    def missing(self, count: int) -> list[Task]:
        """The tasks of the samples that are missing to ``count``; those that are kept are taken."""
        tasks = []
        for number in range(len(self.samples), count):
            if number in self._later:
                continue
            task = self.task(number)
            sample = self._store.get(task)
            if sample is None:
                tasks.append(task)
            else:
                self.receive(number, sample)
        return tasks

    def receive(self, number: int, sample: Sample) -> None:
        """Add a sample; those before it may come later."""
        self._later[number] = sample
        while len(self.samples) in self._later:
            self.samples.append(self._later.pop(len(self.samples)))
            if self._taken is not None:
                self._taken(self)


class Parts:
    """A level that is made of the samples of one or two computations."""

    def __init__(self, *parts: Samples) -> None:
        self.parts = parts

    @property
    def cost(self) -> float:
        """CPU seconds of a sample."""
        return sum(part.computation.seconds for part in self.parts)

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, quantities): samples that are there."""
        return self.so_far()[begin:end]

    def so_far(self) -> np.ndarray:
        """(samples, quantities): what is there."""
        raise NotImplementedError


class Single(Parts):
    """A level of one computation."""

    def __init__(self, samples: Samples, quantities: Quantities) -> None:
        super().__init__(samples)
        self._quantities = quantities
        self._rows: list[np.ndarray] = []

    def so_far(self) -> np.ndarray:
        """(samples, quantities): what is there."""
        for sample in self.parts[0].samples[len(self._rows) :]:
            self._rows.append(self._quantities.row(sample))
        return np.array(self._rows).reshape(-1, self._quantities.count)


class Control(Parts):
    """What the first level is regressed on: the area of a contact, on the surfaces of its samples and on more."""

    def so_far(self) -> np.ndarray:
        """(samples, 1): what is there."""
        return np.array([[one.measures["area_fraction"]] for one in self.parts[0].samples]).reshape(-1, 1)


class Difference(Parts):
    """A level of the difference between a finer and a coarser computation on the same surfaces."""

    def __init__(self, fine: Samples, coarse: Samples, quantities: Quantities) -> None:
        super().__init__(fine, coarse)
        self._quantities = quantities

    def so_far(self) -> np.ndarray:
        """(samples, quantities): what is there."""
        pairs = zip(*(part.samples for part in self.parts), strict=False)
        rows = [self._quantities.row(fine) - self._quantities.row(coarse) for fine, coarse in pairs]
        return np.array(rows).reshape(-1, self._quantities.count)


def within(parts: tuple[Samples, ...], quantities: Quantities) -> tuple[np.ndarray, int] | None:
    """The variance between replicas on one surface, (quantities,), and its degrees of freedom; None without any."""
    total, freedom = np.zeros(quantities.count), 0
    for sample in parts[0].samples:
        rows = quantities.replica_rows(sample)
        if len(rows) > 1:
            total += rows.var(axis=0, ddof=1) * (len(rows) - 1)
            freedom += len(rows) - 1
    return (total / freedom, freedom) if freedom else None
