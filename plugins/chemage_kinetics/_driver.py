"""What all engines do around their kernels: arrays from a lattice, a history from arrays, a start from a history."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event

import numpy as np

from chemage import InputError, ReactionLattice
from chemage.plugin import KB, BondHistory, Seed
from chemage.plugin import threads as processors
from chemage_kinetics import _common
from chemage_kinetics._common import Holds, Key, Model
from chemage_kinetics._identity import fingerprint, noise_key
from chemage_kinetics._resume import Pending

#: Position of a number's lowest byte in memory.
LOWEST_BYTE = 0 if sys.byteorder == "little" else 7
#: Events between interrupt checks.
SLICE = 1 << 19


def _frozen_empty(*shape: int, dtype: type[np.generic] = np.float64) -> np.ndarray:
    # read-only like the arrays of a lattice, so that kernels are not compiled a second time
    array = np.empty(shape, dtype)
    array.setflags(write=False)
    return array


def model_of(lattice: ReactionLattice, temperature: float) -> Model:
    """The lattice at ``temperature`` (K) as the kernels take it."""
    n = lattice.sites.size
    return Model(
        neighbours=_frozen_empty(n, 0, dtype=np.int32) if lattice.neighbours is None else lattice.neighbours,
        coupling=_frozen_empty(n, 0, dtype=np.float32) if lattice.coupling is None else lattice.coupling,
        breaking=_frozen_empty(0) if lattice.breaking is None else lattice.breaking,
        nu=float(lattice.attempt_frequency),
        per_unit=1.0 / (KB * temperature * _common.UNITS_PER_EV),
    )


def bonded(words: np.ndarray) -> np.ndarray:
    """(n,) bool: the lowest bit of each int64."""
    return (words.view(np.uint8).reshape(words.size, 8)[:, LOWEST_BYTE] & 1).view(np.bool_)


def _check_couplings(lattice: ReactionLattice) -> None:
    """Refuse so many and so strong couplings that their sum would overflow a word of energy."""
    if lattice.coupling is None or lattice.coupling.shape[1] <= 64:
        return
    largest = min(float(np.abs(lattice.coupling).max(initial=0.0)), _common.LARGEST_COUPLING)
    if lattice.coupling.shape[1] * largest > 2 * _common.LARGEST_BARRIER:
        raise InputError(
            f"coupling: {lattice.coupling.shape[1]} neighbours of up to {largest:g} eV each are out of range; "
            "give fewer neighbours or weaker couplings"
        )


@dataclass
class Job:
    """One run: the arguments of `Engine._run`, and the arrays made from them."""

    kind: str
    lattice: ReactionLattice
    hold_times: np.ndarray
    temperature: float
    seed: Seed
    start: BondHistory | np.ndarray | None
    key: Key = field(init=False)
    model: Model = field(init=False)
    mark: np.ndarray = field(init=False)
    """uint64 (1,), see `fingerprint`"""
    state: np.ndarray = field(init=False)
    """(n,) bool at the start"""
    time: float = field(init=False)
    """of the start, s"""
    pending: Pending | None = field(init=False)
    """pending events of the history to continue, whatever engine or lattice it had"""
    resume: Pending | None = field(init=False)
    """the same, where they still hold"""
    tally: np.ndarray = field(init=False)
    """(m, 3) int64, see `Holds`"""

    def __post_init__(self) -> None:
        self.key = noise_key(self.seed, _common.STREAMS[self.kind], self.lattice)
        self.model = model_of(self.lattice, self.temperature)
        self.mark = fingerprint(self.lattice)
        self.tally = np.zeros((self.hold_times.size, 3), np.int64)
        self.time = 0.0
        self.pending = self.resume = None
        _check_couplings(self.lattice)
        if self.start is None:
            self.state = np.zeros(self.lattice.sites.size, np.bool_)
        elif isinstance(self.start, BondHistory):
            self.state = np.array(self.start.state)
            self.time = self.start.time
            self.pending = Pending(self.start, self.state.size)
            if self._same(self.start):
                self.resume = self.pending
        else:
            self.state = np.array(self.start)

    def _identity(self) -> dict[str, np.ndarray]:
        """What must be equal, besides the temperature, for pending events to hold: engine, random numbers, lattice."""
        return {
            "engine": np.array([_common.STREAMS[self.kind]]),
            "key": np.array(self.key),
            "lattice": self.mark,
        }

    def _same(self, start: BondHistory) -> bool:
        """Whether the history's pending events still hold."""
        return start.temperature == self.temperature and all(
            np.array_equal(start.resume.get(name, ()), array) for name, array in self._identity().items()
        )

    def carried(self, name: str) -> int:
        """A counter of the history to continue, whatever engine or lattice it had; 0 without one."""
        return self.pending.count(name) if self.pending is not None and name in self.pending else 0

    def carried_draws(self) -> np.ndarray:
        """(n,) int64: random numbers each site has used in the history to continue; 0 without one."""
        if self.pending is not None and "draws" in self.pending:
            return np.array(self.pending.draws("draws"))
        return np.zeros(self.state.size, np.int64)

    @property
    def holds(self) -> Holds:
        """The hold times and the counts of the whole run."""
        return Holds(self.hold_times, self.tally)

    def words(self) -> np.ndarray:
        """(n,) int64, 2 * energy + bonded; see `_common`."""
        words = np.empty(self.lattice.sites.size, np.int64)
        _common.start_words(self.lattice.forming, self.model, self.state, words)
        return words

    def history(self, state: np.ndarray, **resume: np.ndarray) -> BondHistory:
        """The finished history. ``resume`` holds the engine's pending events."""
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
            resume={**self._identity(), **resume},
        )


#: Events per site to 1e5 s at room temperature on the paper's rough contact, for where the scene's are not known.
EVENTS_PER_SITE = 0.5
#: An event on a lattice of at most so many sites, which stays in the processor's cache, takes so large a part of the
#: time of one on a lattice that does not, of the second number of sites or more.
CACHED, SMALL, LARGE = 0.45, 3e3, 1e5


def expected_cost(
    sites: float, event: float, site: float, memory: float, events: float | None = None, superbasins: bool = False
) -> dict[str, float]:
    """`Engine.expected` from the seconds per event, the seconds of set-up per site and the bytes per site, as of large
    lattices."""
    per_site = EVENTS_PER_SITE if events is None else events
    beyond = math.log(max(sites, SMALL) / SMALL) / math.log(LARGE / SMALL)
    event *= min(1.0, CACHED + (1 - CACHED) * beyond)

    def seconds(per_site: float) -> float:
        return sites * (per_site * event + site)

    cost = {"cpu_seconds": seconds(per_site), "bytes": sites * memory}
    if superbasins and per_site > 2 * EVENTS_PER_SITE:
        # What a site adds by flickering costs nothing where nothing around it reacts meanwhile, and all of it where its
        # neighbours flicker as well: then the chain is interrupted after a few events, which cost up to twice as much,
        # and of sites that interact there are up to twice as many.
        least, most = seconds(2 * EVENTS_PER_SITE), 4 * seconds(per_site)
        cost |= {"cpu_seconds": (least * most) ** 0.5, "cpu_seconds_least": least, "cpu_seconds_most": most}
    return cost


def run_pieces(
    job: Job, follow: Callable[[int, int, np.ndarray], int], pieces: Sequence[tuple[int, int]], threads: int
) -> None:
    """Follow every piece of a lattice, on ``threads`` threads (0: one per processor), and add up the tallies.

    ``follow(first, last, tally)`` goes on for a while, adds to ``tally`` and returns where it stopped. Tallies are
    whole numbers, so their sum depends neither on the order of the pieces nor on the number of threads.
    """
    stop = Event()

    def followed(piece: tuple[int, int]) -> np.ndarray:
        tally = np.zeros_like(job.tally)
        first, last = piece
        while first < last and not stop.is_set():
            first = follow(first, last, tally)
        return tally

    threads = min(threads or processors.available(), len(pieces))
    if threads < 2:
        for piece in pieces:
            job.tally += followed(piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            for tally in pool.map(followed, pieces):
                job.tally += tally
        except BaseException:
            stop.set()
            raise
