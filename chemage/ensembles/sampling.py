"""Samples of a computation on many surfaces, several at a time, kept so that an interrupted ensemble goes on."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.ensembles.computations import Computation, Sample, compute
from chemage.ensembles.quantities import Quantities
from chemage.foundation import threads
from chemage.foundation.errors import StoreError
from chemage.foundation.text import jsonable

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
    """Samples on disk, one line each with its checksum; lines that are damaged or of other versions are not used."""

    #: None: nothing is kept
    folder: Path | None = None
    #: of everything that takes part in a sample
    versions: dict[str, str] = field(default_factory=dict)
    #: how many samples were found there
    found: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def count_found(self) -> None:
        """Count one more sample that was found; threads may call it."""
        with self._lock:
            self.found += 1

    def load(self, key: str) -> dict[tuple[int, int], Sample]:
        """The samples of a computation, by the seeds of surface and disorder."""
        samples: dict[tuple[int, int], Sample] = {}
        path = self._path(key)
        if path is None or not path.is_file():
            return samples
        try:
            lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise StoreError(f"cannot read {path}: {error.strerror}") from error
        for line in lines:
            text, _, checksum = line.rpartition(" ")
            if not text or _checksum(text) != checksum:
                continue
            data = json.loads(text)
            if data["versions"] == self.versions:
                samples[data["surface_seed"], data["hold_seed"]] = Sample.fromdict(data)
        return samples

    def keep(self, key: str, surface_seed: int, hold_seed: int, sample: Sample) -> None:
        """Add a sample.

        Raises
        ------
        StoreError
            It cannot be written.
        """
        path = self._path(key)
        if path is None:
            return
        data = {"surface_seed": surface_seed, "hold_seed": hold_seed, "versions": self.versions, **sample.todict()}
        text = json.dumps(jsonable(data))
        line = f"{text} {_checksum(text)}\n".encode()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # one write, so that lines of several processes do not mix; what a kill cuts off fails its checksum
            with open(path, "ab", buffering=0) as stream:
                stream.write(line if _ends_a_line(path) else b"\n" + line)
        except OSError as error:
            raise StoreError(f"cannot keep samples in {path.parent}: {error.strerror}") from error

    def _path(self, key: str) -> Path | None:
        return None if self.folder is None else self.folder / f"{key}.samples"


def _ends_a_line(path: Path) -> bool:
    with open(path, "rb") as stream:
        if stream.seek(0, os.SEEK_END) == 0:
            return True
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) == b"\n"


def _checksum(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


class Samples:
    """The samples of one computation on the surfaces (or replicas) of one level."""

    def __init__(
        self,
        computation: Computation,
        *,
        level: int,
        varied: bool,
        store: Store,
        workers: int,
        taken: Taken | None = None,
    ) -> None:
        """``varied``: another surface for each sample; else the surface of the scene with other replicas."""
        self.computation, self.level, self.varied = computation, level, varied
        self.samples: list[Sample] = []
        self._store, self._workers, self._taken = store, workers, taken
        self._key = computation.key()
        self._known = store.load(self._key)
        self._contact: ContactSolution | ContactStatistics | None = None
        self._lock = threading.Lock()

    def seeds(self, number: int) -> tuple[int, int]:
        """The seeds of surface and disorder of a sample."""
        scene = self.computation.scene
        base = scene.hold.seed if scene.hold is not None else 0
        surface = seed_of(scene.surface_seed, self.level, number, 0) if self.varied else scene.surface_seed
        return surface, seed_of(base, self.level, number, 1)

    def upto(self, count: int) -> None:
        """Compute samples until there are ``count``."""
        begin = len(self.samples)
        if count <= begin:
            return

        def task(number: int) -> Sample:
            return self._one(begin + number)

        with threads.restored():
            # surfaces side by side use the processors better than several threads for each
            if self._workers > 1:
                threads.limit(1)
            for sample in threads.in_order(task, count - begin, self._workers, None):
                self.samples.append(sample)
                if self._taken is not None:
                    self._taken(self)

    def _one(self, number: int) -> Sample:
        seeds = self.seeds(number)
        if (known := self._known.get(seeds)) is not None:
            self._store.count_found()
            return known
        sample = self._computed(seeds)
        self._store.keep(self._key, *seeds, sample)
        return sample

    def _computed(self, seeds: tuple[int, int]) -> Sample:
        if self.varied:
            return compute(self.computation, *seeds)[0]
        with self._lock:  # one solves the contact, and the others wait for it
            if self._contact is None:
                sample, self._contact = compute(self.computation, *seeds)
                return sample
        return compute(self.computation, *seeds, self._contact)[0]


class Single:
    """A level of one computation."""

    def __init__(self, samples: Samples, quantities: Quantities) -> None:
        self.parts = (samples,)
        self._quantities = quantities
        self._rows: list[np.ndarray] = []

    @property
    def cost(self) -> float:
        """CPU seconds of a sample."""
        return self.parts[0].computation.seconds

    def so_far(self) -> np.ndarray:
        """(samples, quantities): what is there."""
        for sample in self.parts[0].samples[len(self._rows) :]:
            self._rows.append(self._quantities.row(sample))
        return np.array(self._rows).reshape(-1, self._quantities.count)

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, quantities)."""
        self.parts[0].upto(end)
        return self.so_far()[begin:end]


class Control:
    """What the first level is regressed on: the area of a contact, on the surfaces of its samples and on more."""

    def __init__(self, samples: Samples) -> None:
        self.parts = (samples,)

    @property
    def cost(self) -> float:
        """CPU seconds of a sample."""
        return self.parts[0].computation.seconds

    def so_far(self) -> np.ndarray:
        """(samples, 1): what is there."""
        return np.array([[one.measures["area_fraction"]] for one in self.parts[0].samples]).reshape(-1, 1)

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, 1)."""
        self.parts[0].upto(end)
        return self.so_far()[begin:end]


class Difference:
    """A level of the difference between a finer and a coarser computation on the same surfaces."""

    def __init__(self, fine: Samples, coarse: Samples, quantities: Quantities) -> None:
        self.parts = (fine, coarse)
        self._quantities = quantities

    @property
    def cost(self) -> float:
        """CPU seconds of a sample."""
        return sum(part.computation.seconds for part in self.parts)

    def so_far(self) -> np.ndarray:
        """(samples, quantities): what is there."""
        pairs = zip(*(part.samples for part in self.parts), strict=False)
        rows = [self._quantities.row(fine) - self._quantities.row(coarse) for fine, coarse in pairs]
        return np.array(rows).reshape(-1, self._quantities.count)

    def sample(self, begin: int, end: int) -> np.ndarray:
        """(end − begin, quantities)."""
        for part in self.parts:
            part.upto(end)
        return self.so_far()[begin:end]


def within(parts: tuple[Samples, ...], quantities: Quantities) -> tuple[np.ndarray, int] | None:
    """The variance between replicas on one surface, (quantities,), and its degrees of freedom; None without any."""
    total, freedom = np.zeros(quantities.count), 0
    for sample in parts[0].samples:
        rows = quantities.replica_rows(sample)
        if len(rows) > 1:
            total += rows.var(axis=0, ddof=1) * (len(rows) - 1)
            freedom += len(rows) - 1
    return (total / freedom, freedom) if freedom else None
