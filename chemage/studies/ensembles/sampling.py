"""Samples of a computation on many surfaces: the tasks that give them, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from chemage.studies.ensembles.computations import Computation
from chemage.studies.ensembles.quantities import Quantities, Sample
from chemage.studies.study import Archive
from chemage.studies.tasks import Task

#: called when a sample is there, with those of its computation so far
Taken = Callable[["Samples"], None]


def seed_of(base: int, level: int, number: int, what: int) -> int:
    """The seed of sample ``number`` of a level, a function of the arguments alone: of its surface (``what`` 0), or of
    its disorder and noise (1).

    It is a whole number below 2^53, so that ``chemage run --set surface.seed=...`` makes the same surface.
    """
    words = np.random.SeedSequence(base, spawn_key=(level, number, what)).generate_state(2, np.uint32)
    return (int(words[0]) << 21) | (int(words[1]) >> 11)


class Samples:
    """The samples of one computation on the surfaces (or replicas) of one level."""

    def __init__(
        self, computation: Computation, *, level: int, varied: bool, archive: Archive, taken: Taken | None = None
    ) -> None:
        """``varied``: another surface for each sample; else the surface of the scene with other replicas."""
        self.computation, self.level, self.varied = computation, level, varied
        #: without gaps, in the order of their numbers
        self.samples: list[Sample] = []
        self._archive, self._taken = archive, taken
        self._later: dict[int, Sample] = {}

    def seeds(self, number: int) -> tuple[int, int]:
        """The seeds of surface and disorder of a sample."""
        scene = self.computation.scene
        base = scene.hold.seed if scene.hold is not None else 0
        surface = seed_of(scene.surface_seed, self.level, number, 0) if self.varied else scene.surface_seed
        return surface, seed_of(base, self.level, number, 1)

    def task(self, number: int) -> Task:
        """The task of a sample."""
        computation = self.computation
        replicas = computation.replicas if computation.scene.ages else 0
        return Task.of(
            computation.seeded(*self.seeds(number)),
            number=number,
            contact_seconds=computation.contact_seconds,
            ageing_seconds=computation.replica_seconds * replicas,
            bytes=computation.bytes or 0.0,
            members=False,
        )

    def missing(self, count: int) -> list[Task]:
        """The tasks of the samples that are missing to ``count``; those that are kept are taken."""
        tasks = []
        for number in range(len(self.samples), count):
            if number in self._later:
                continue
            task = self.task(number)
            outcome = self._archive.find(task)
            if outcome is None:
                tasks.append(task)
            else:
                self.receive(number, Sample.of(outcome))
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
        return np.array([[sample.measures["area_fraction"]] for sample in self.parts[0].samples]).reshape(-1, 1)


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
