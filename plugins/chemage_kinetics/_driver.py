"""What the engines do alike around their kernels: arrays in, history out, and how a history is taken up again."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event

import numpy as np

from chemage import KB, BondHistory, ReactionLattice, Seed
from chemage.foundation.random import key
from chemage.foundation.threads import available
from chemage_kinetics import _common

#: Where a number's lowest byte stands in memory.
LOWEST_BYTE = 0 if sys.byteorder == "little" else 7
#: Events between two looks at the keyboard.
SLICE = 1 << 19


def frozen_empty(*shape: int, dtype: type[np.generic] = np.float64) -> np.ndarray:
    """An array without entries, read-only like those of a lattice, so that kernels need not be compiled twice."""
    array = np.empty(shape, dtype)
    array.setflags(write=False)
    return array


def aligned(size: int) -> np.ndarray:
    """float64 (size,) starting on a cache line of 64 bytes."""
    room = np.empty(size + 8)
    offset = (-room.ctypes.data // 8) % 8
    return room[offset : offset + size]


def bonded(words: np.ndarray) -> np.ndarray:
    """(n,) bool: the lowest bit of each int64."""
    return (words.view(np.uint8).reshape(words.size, 8)[:, LOWEST_BYTE] & 1).view(np.bool_)


def fingerprint(lattice: ReactionLattice) -> np.ndarray:
    """uint64 (1,): tells whether a history goes on with the lattice it came from; far cheaper than a digest."""
    value = np.array([lattice.attempt_frequency]).view(np.uint64)[0]
    for array in (lattice.sites, lattice.forming, lattice.breaking, lattice.neighbours, lattice.coupling):
        raw = np.empty(0, np.uint8) if array is None else array.reshape(-1).view(np.uint8)
        whole = raw.size - raw.size % 8
        rest = np.zeros(16, np.uint8)
        rest[: raw.size - whole] = raw[whole:]
        rest[8] = array is None
        for part in (raw[:whole], rest):
            words = part.view(np.uint64)
            words.setflags(write=False)
            value = np.uint64(_common.mix(words, value))
    return np.array([value], np.uint64)


@dataclass
class Job:
    """One run as the kernels see it."""

    kind: str
    lattice: ReactionLattice
    hold_times: np.ndarray
    temperature: float
    seed: Seed
    start: BondHistory | np.ndarray | None
    key: np.ndarray = field(init=False)
    mark: np.ndarray = field(init=False)
    state: np.ndarray = field(init=False)
    time: float = field(init=False)
    resume: dict[str, np.ndarray] | None = field(init=False)
    tally: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        lattice = self.lattice
        n = lattice.sites.size
        self.key = key(self.seed)
        self.mark = fingerprint(lattice)
        self.tally = np.zeros((self.hold_times.size, 3), np.int64)
        self.time = 0.0
        self.resume = None
        if self.start is None:
            self.state = np.zeros(n, np.bool_)
        elif isinstance(self.start, BondHistory):
            self.state = np.array(self.start.state)
            self.time = self.start.time
            if self._same(self.start):
                self.resume = self.start.resume
        else:
            self.state = np.array(self.start)

    def _same(self, start: BondHistory) -> bool:
        """Whether the history's pending events still hold: same engine, lattice, temperature and seed."""
        return (
            np.array_equal(start.resume.get("engine", ()), [_common.STREAMS[self.kind]])
            and start.temperature == self.temperature
            and np.array_equal(start.resume.get("lattice", ()), self.mark)
            and np.array_equal(start.resume.get("key", ()), self.key)
        )

    def carried(self, name: str) -> int:
        """A counter of the history to go on from, whatever engine or lattice it had; 0 without one."""
        if isinstance(self.start, BondHistory) and name in self.start.resume:
            return int(self.start.resume[name][0])
        return 0

    def carried_array(self, name: str, otherwise: np.ndarray) -> np.ndarray:
        """An array of the history to go on from, whatever engine or lattice it had; ``otherwise`` where it has none."""
        if isinstance(self.start, BondHistory):
            found = self.start.resume.get(name)
            if found is not None and found.shape == otherwise.shape and found.dtype == otherwise.dtype:
                return np.array(found)
        return otherwise

    @property
    def k0(self) -> np.uint64:
        return np.uint64(self.key[0])

    @property
    def k1(self) -> np.uint64:
        return np.uint64(self.key[1])

    @property
    def neighbours(self) -> np.ndarray:
        """(n, k) int32; k = 0 where nothing interacts."""
        found = self.lattice.neighbours
        return frozen_empty(self.lattice.sites.size, 0, dtype=np.int32) if found is None else found

    @property
    def coupling(self) -> np.ndarray:
        """(n, k) eV, float64 or float32."""
        found = self.lattice.coupling
        return frozen_empty(self.lattice.sites.size, 0, dtype=np.float32) if found is None else found

    @property
    def breaking(self) -> np.ndarray:
        """(n,) eV, or no entries where bonds never break."""
        return frozen_empty(0) if self.lattice.breaking is None else self.lattice.breaking

    @property
    def nu(self) -> float:
        return float(self.lattice.attempt_frequency)

    @property
    def per_unit(self) -> float:
        """1/k_B T over one fixed-point unit of energy."""
        return 1.0 / (KB * self.temperature * _common.UNITS_PER_EV)

    def words(self) -> np.ndarray:
        """(n,) int64, 2 * energy + bonded; see `_common`."""
        words = np.empty(self.lattice.sites.size, np.int64)
        _common.start_words(self.lattice.forming, self.neighbours, self.coupling, self.state, words)
        return words

    def history(self, state: np.ndarray, **resume: np.ndarray) -> BondHistory:
        """The finished history. ``resume`` is the engine's own continuation."""
        for array in (state, *resume.values()):
            array.setflags(write=False)  # handed over: the history need not copy them
        earlier = self.start if isinstance(self.start, BondHistory) else None
        before = np.zeros(2, np.int64) if earlier is None else np.array([earlier.formed[-1], earlier.broken[-1]])
        # Counts stop at 2**61 (see `_common`), so their sums are taken in floating point first.
        sums = []
        for column in range(2):
            exact = before[column] + np.cumsum(self.tally[:, column])
            rough = float(before[column]) + np.cumsum(self.tally[:, column].astype(np.float64))
            sums.append(np.where(rough >= float(_common.MOST), _common.MOST, exact))
        return BondHistory(
            hold_times=self.hold_times,
            bonds=np.count_nonzero(self.state) + np.cumsum(self.tally[:, 2]),
            formed=sums[0],
            broken=sums[1],
            state=state,
            time=float(self.hold_times[-1]),
            temperature=self.temperature,
            engine=self.kind,
            lattice_hash=f"{int(self.mark[0]):016x}",
            resume={
                "engine": np.array([_common.STREAMS[self.kind]]),
                "key": self.key,
                "lattice": self.mark,
                **resume,
            },
        )


#: Events a site sees to 1e5 s at room temperature on the paper's rough contact: what `Engine.expected` assumes.
EVENTS_PER_SITE = 0.5


def room_temperature_cost(sites: float, event: float, site: float, memory: float) -> dict[str, float]:
    """`Engine.expected` from the seconds of an event, the seconds of a site's set-up and its bytes."""
    return {"cpu_seconds": sites * (EVENTS_PER_SITE * event + site), "bytes": sites * memory}


def run_pieces(
    job: Job, follow: Callable[[int, int, np.ndarray], int], pieces: Sequence[tuple[int, int]], workers: int
) -> None:
    """Follow every piece of a lattice, on ``workers`` threads (0: one for each processor), and add up the tallies.

    ``follow(first, last, tally)`` goes on for a while, adds to ``tally`` and returns where it stopped. Tallies are
    whole numbers, so neither the order of the pieces nor the number of threads can be seen in their sum.
    """
    stop = Event()

    def one(piece: tuple[int, int]) -> np.ndarray:
        tally = np.zeros_like(job.tally)
        first, last = piece
        while first < last and not stop.is_set():
            first = follow(first, last, tally)
        return tally

    workers = min(workers or available(), len(pieces))
    if workers < 2:
        for piece in pieces:
            job.tally += one(piece)
        return
    with ThreadPoolExecutor(workers) as pool:
        try:
            for tally in pool.map(one, pieces):
                job.tally += tally
        except BaseException:
            stop.set()
            raise
