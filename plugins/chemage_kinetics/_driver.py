"""What all engines do around their kernels: arrays from a lattice, a history from arrays, a start from a history."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event
from typing import Any, NamedTuple, NoReturn

import numpy as np

from chemage import InputError, ReactionLattice
from chemage.plugin import KB, BondHistory, PullHistory, Ramp, Seed, random
from chemage.plugin import threads as processors
from chemage_kinetics import _common
from chemage_kinetics._common import Array, Holds, Key, KineticModel, mix
from chemage_kinetics._rate_classes import CLASSES, PER_KT, octaves_of

#: Sites whose pixel and energies enter the key, spread evenly over the lattice.
PROBES = 256
#: Energies are rounded to 0.7 meV: coarse enough that differences between processors in the last bits do not matter,
#: and irrational, so that no barrier that a user writes down lies between two steps.
STEPS_PER_EV = 1000.0 * np.sqrt(2.0)


def further(lattice: ReactionLattice) -> tuple[Any, ...]:
    """States, barriers and terms of transitions beside forming and breaking; () where there are none."""
    if lattice.states is None:
        return ()
    return (
        lattice.transitions,
        lattice.transition_barriers,
        lattice.transition_terms,
    )


def noise_key(seed: Seed, stream: int, lattice: ReactionLattice) -> Key:
    """The key of the random numbers of an engine with this ``stream`` on ``lattice``.

    It is a hash of the seed, the engine and the lattice, so that one seed gives independent noise on every contact and
    in every engine, and always the same noise on the same lattice. A `chemage.plugin.random.CommonSeed` is used as it
    is: runs with one such seed have common random numbers.
    """
    words = random.key(seed)
    if isinstance(seed, random.CommonSeed):
        return Key(words[0], words[1])
    n = lattice.sites.size
    probes = (
        slice(None) if n <= PROBES else np.arange(PROBES) * (n - 1) // (PROBES - 1)
    )
    more = further(lattice)
    numbers = np.array(
        [
            words[0],
            words[1],
            stream,
            n,
            lattice.attempt_frequency,
            *np.ravel(more[2:]),
        ]
    )
    content = hashlib.blake2b(
        numbers.astype("<f8").tobytes()
        + lattice.sites[probes].astype("<i8").tobytes()
    )
    for energies in (
        lattice.forming,
        lattice.breaking,
        lattice.coupling,
        *more[1:2],
    ):
        content.update(b"/")
        if energies is not None:
            steps = np.rint(energies[probes].astype("<f8") * STEPS_PER_EV)
            content.update(
                (steps + 0.0).tobytes()
            )  # + 0.0, because -0.0 has other bytes
    k0, k1 = np.frombuffer(content.digest()[:8], "<u4").astype(np.uint64)
    return Key(k0, k1)


def fingerprint(lattice: ReactionLattice) -> Array:
    """uint64 (1,), a hash of all that the kinetics depend on: pixels of the sites, barriers, graph, frequency."""
    value = np.array([lattice.attempt_frequency]).view(np.uint64)[0]
    for array in (
        lattice.sites,
        lattice.forming,
        lattice.breaking,
        lattice.neighbours,
        lattice.coupling,
        *further(lattice),
    ):
        raw = (
            np.empty(0, np.uint8)
            if array is None
            else array.reshape(-1).view(np.uint8)
        )
        whole = raw.size - raw.size % 8
        rest = np.zeros(16, np.uint8)
        rest[: raw.size - whole] = raw[whole:]
        rest[8] = array is None
        for part in (raw[:whole], rest):
            words = part.view(np.uint64)
            words.setflags(write=False)
            value = np.uint64(mix(words, value))
    return np.array([value], np.uint64)


#: Counters of random numbers end here, with room for what is added to them and multiplied by `SOJOURN_DRAWS`.
MOST_COUNTED = 2**61
MOST_DRAWS = 2**50
#: The second part of a time is at most this fraction of the first.
ROUNDING = 2.0**-52


class Pending:
    """The arrays in ``BondHistory.resume``, each returned as it is if it can be right.

    Every method raises :class:`chemage.InputError` otherwise.
    """

    def __init__(self, start: BondHistory | PullHistory, sites: int) -> None:
        self._start, self._sites = start, sites

    def __contains__(self, name: str) -> bool:
        return name in self._start.resume

    def _wrong(self, name: str, problem: str) -> NoReturn:
        raise InputError(
            f"start: resume[{name!r}] {problem}; resume from a history as the engine gave it, or pass its state alone"
        )

    def _array(
        self, name: str, dtype: type[np.generic], shape: tuple[int, ...] | None
    ) -> Array:
        array = self._start.resume.get(name)
        if array is None:
            self._wrong(name, "is missing")
        fits, wanted = array.shape == shape, f"of shape {shape}"
        if shape is None:
            fits, wanted = array.ndim == 1, "one-dimensional"
        if array.dtype != dtype or not fits:
            found = f"is {array.dtype} of shape {array.shape}"
            wanted = f"{np.dtype(dtype).name} {wanted}"
            self._wrong(name, f"{found}, but should be {wanted}")
        return array

    def _whole(
        self,
        name: str,
        shape: tuple[int, ...] | None,
        least: int,
        most: int,
        dtype: type[np.generic] = np.int64,
    ) -> Array:
        """Whole numbers between two limits."""
        array = self._array(name, dtype, shape)
        if array.size and not (array.min() >= least and array.max() <= most):
            found = f"is from {array.min()} to {array.max()}"
            if array.size == 1:
                found = f"is {array[0]}"
            self._wrong(name, f"{found}, but should be from {least} to {most}")
        return array

    def count(self, name: str) -> int:
        """A counter of random numbers, ≥ 0."""
        return int(self._whole(name, (1,), 0, MOST_COUNTED)[0])

    def site(self, name: str) -> int:
        """A site, or -1."""
        return int(self._whole(name, (1,), -1, self._sites - 1)[0])

    def clock(self, name: str) -> Array:
        """(2,) float64 s: the time of the last event, not after the end of the history."""
        array = self._array(name, np.float64, (2,))
        high, low = float(array[0]), float(array[1])
        if not (0 <= high <= self._start.time and abs(low) <= ROUNDING * high):
            last = self._start.time
            self._wrong(
                name, f"is {high} + {low} s, but should be from 0 to {last} s"
            )
        return array

    def times(self, name: str) -> Array:
        """(n, 2) float64 s: pending times, not before the end of the history."""
        array = self._array(name, np.float64, (self._sites, 2))
        high, low = array[:, 0], array[:, 1]
        # also false for nan
        if not (
            np.all(high >= self._start.time)
            and np.all(np.abs(low) <= ROUNDING * np.minimum(high, 1e300))
        ):
            self._wrong(name, f"has times that are not after {self._start.time} s")
        return array

    def draws(self, name: str) -> Array:
        """(n,) int64: random numbers used by each site."""
        return self._whole(name, (self._sites,), 0, MOST_DRAWS)

    def offset(self, name: str) -> Array:
        """(2,) float64 nm, not negative."""
        array = self._array(name, np.float64, (2,))
        if not 0 <= array[0] < math.inf or not abs(array[1]) <= array[0]:
            self._wrong(
                name, f"is {array[0]} + {array[1]} nm, but should not be negative"
            )
        return array

    def occupied(self, states: int) -> Array:
        """(n,) int64: the state of each site, -1 where it is not known."""
        return self._whole("occupied", (self._sites,), -1, states - 1)

    def chosen(self, name: str, most: int) -> Array:
        """Up to ``most`` different sites, (h,) int64."""
        array = self._whole(name, None, 0, self._sites - 1)
        if array.size > most:
            self._wrong(name, f"lists {array.size} sites, but there can be {most}")
        if np.unique(array).size != array.size:
            self._wrong(name, "lists a site twice")
        return array

    def members(self, words: Array, model: KineticModel) -> tuple[Array, Array]:
        """All sites by class, (n,) int32, and how many each class has, (CLASSES,) int64.

        Each site must be in a class whose bound is not below its rate, see `_rate_classes`.
        """
        counts = self._whole("counts", (CLASSES,), 0, self._sites)
        order = self._whole("members", (self._sites,), 0, self._sites - 1, np.int32)
        listed = int(counts.sum())
        if listed > self._sites:
            self._wrong(
                "counts", f"counts {listed} sites, but there are {self._sites}"
            )
        there = np.zeros(self._sites, np.bool_)
        there[order] = True
        if not there.all():
            self._wrong("members", "does not list every site once")
        octaves = octaves_of(words, model.breaking, model.per_unit * PER_KT)[order]
        bounds = np.repeat(np.arange(CLASSES, dtype=np.float64), counts)
        if np.any(octaves[:listed] < bounds) or np.any(
            octaves[listed:] < CLASSES - 1.0
        ):
            self._wrong(
                "members", "has a site in a class of smaller rates than its own"
            )
        return order, counts


#: Position of a number's lowest byte in memory.
LOWEST_BYTE = 0 if sys.byteorder == "little" else 7
#: Events between interrupt checks.
SLICE = 1 << 19


def _or_empty(array: Array | None, dtype: Any, *shape: int) -> Array:
    """``array``, or where there is none an empty one: read-only as well, so that kernels are compiled once."""
    if array is None:
        array = np.empty(shape, dtype)
        array.setflags(write=False)
    return array


def bonded(words: Array) -> Array:
    """(n,) bool: the lowest bit of each int64."""
    return (words.view(np.uint8).reshape(words.size, 8)[:, LOWEST_BYTE] & 1).view(
        np.bool_
    )


@dataclass(eq=False)
class Start:
    """The arguments of a run of any engine, and what it begins from."""

    kind: str
    lattice: ReactionLattice
    times: Array
    temperature: float
    seed: Seed
    start: BondHistory | PullHistory | Array | None

    def __post_init__(self) -> None:
        lattice, start = self.lattice, self.start
        self.stream = _common.STREAMS[self.kind]
        self.key = noise_key(self.seed, self.stream, lattice)
        n = lattice.sites.size
        coupling = lattice.coupling
        if coupling is not None and coupling.shape[1] > 64:
            # the sum of so many and so strong couplings would overflow a word of energy
            largest = min(
                float(np.abs(coupling).max(initial=0.0)), _common.LARGEST_COUPLING
            )
            if coupling.shape[1] * largest > 2 * _common.LARGEST_BARRIER:
                raise InputError(
                    f"coupling: {coupling.shape[1]} neighbours of up to {largest:g} eV each are out of range; "
                    "give fewer neighbours or weaker couplings"
                )
        self.model = KineticModel(
            neighbours=_or_empty(lattice.neighbours, np.int32, n, 0),
            coupling=_or_empty(coupling, np.float32, n, 0),
            breaking=_or_empty(lattice.breaking, np.float64, 0),
            nu=float(lattice.attempt_frequency),
            per_unit=1.0 / (KB * self.temperature * _common.UNITS_PER_EV),
        )
        #: uint64 (1,), see `fingerprint`
        self.mark = fingerprint(lattice)
        #: the history to continue, whatever engine or lattice it had
        self.earlier = (
            start if isinstance(start, BondHistory | PullHistory) else None
        )
        #: (n,) bool
        self.state = np.zeros(n, np.bool_)
        #: s; bonds formed and broken until then
        self.time, self.counted = 0.0, (0, 0)
        #: its pending events
        self.pending: Pending | None = None
        if self.earlier is not None:
            self.state = np.array(self.earlier.state)
            self.time = float(self.earlier.time)
            self.counted = (
                int(self.earlier.formed[-1]),
                int(self.earlier.broken[-1]),
            )
            self.pending = Pending(self.earlier, self.state.size)
        elif start is not None:
            self.state = np.array(start)

    def identity(self) -> dict[str, Array]:
        """What must be equal for pending events to hold: random numbers, lattice."""
        return {"key": np.array(self.key), "lattice": self.mark}

    def holds_on(self) -> bool:
        """Whether the pending events of the history to continue still hold."""
        return self.earlier is not None and all(
            np.array_equal(self.earlier.resume.get(name, ()), array)
            for name, array in self.identity().items()
        )

    def carried(self, name: str) -> int:
        """A counter of the history to continue, whatever engine or lattice it had; 0 without one."""
        if self.pending is not None and name in self.pending:
            return self.pending.count(name)
        return 0

    def carried_draws(self, name: str) -> Array:
        """(n,) int64: random numbers each site has used in the history to continue; 0 without one."""
        if self.pending is not None and name in self.pending:
            return np.array(self.pending.draws(name))
        return np.zeros(self.state.size, np.int64)


class Job(Start):
    """One run: the arguments of `Engine._run`, and the arrays made from them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        #: pending events of the history to continue, where they still hold
        self.resume = self.pending if self.holds_on() else None
        #: (m, 3) int64, see `Holds`
        self.tally = np.zeros((self.times.size, 3), np.int64)

    def holds_on(self) -> bool:
        """Whether the pending events of the history to continue still hold."""
        earlier = self.earlier
        return earlier is not None and (
            earlier.temperature == self.temperature and super().holds_on()
        )

    def identity(self) -> dict[str, Array]:
        """What must be equal, besides the temperature, for pending events to hold: engine, random numbers, lattice."""
        return {"engine": np.array([self.stream]), **super().identity()}

    def of_sites(self) -> tuple[Array, Array]:
        """Pending times of the sites, (n, 2) s, to be drawn unless the run is resumed, and their random numbers used so
        far, (n,)."""
        if self.resume is None:
            return np.empty((self.state.size, 2)), self.carried_draws("draws")
        return np.array(self.resume.times("times")), np.array(
            self.resume.draws("draws")
        )

    @property
    def holds(self) -> Holds:
        """The hold times and the counts of the whole run."""
        return Holds(self.times, self.tally)

    def words(self) -> Array:
        """(n,) int64, 2 * energy + bonded; see `_common`."""
        words = np.empty(self.lattice.sites.size, np.int64)
        _common.start_words(self.lattice.forming, self.model, self.state, words)
        return words

    def history(self, state: Array, **resume: Array) -> BondHistory:
        """The finished history. ``resume`` holds the engine's pending events."""
        for array in (state, *resume.values()):
            array.setflags(
                write=False
            )  # handed over: the history need not copy them
        # Counts stop at 2**61 (see `_common`), so their sums are taken in floating point first.
        sums = []
        for column, before in enumerate(self.counted):
            exact = before + np.cumsum(self.tally[:, column])
            rough = float(before) + np.cumsum(
                self.tally[:, column].astype(np.float64)
            )
            sums.append(np.where(rough >= float(_common.MOST), _common.MOST, exact))
        return BondHistory(
            hold_times=self.times,
            bonds=np.count_nonzero(self.state) + np.cumsum(self.tally[:, 2]),
            formed=sums[0],
            broken=sums[1],
            state=state,
            time=float(self.times[-1]),
            temperature=self.temperature,
            engine=self.kind,
            lattice_hash=f"{int(self.mark[0]):016x}",
            resume={**self.identity(), **resume},
        )


#: a ramp is followed in parts in which barriers change by about so many k_BT, where they are of so many at most, and in
#: no more parts than these: parts save attempts, and the answer does not depend on them
CHANGE, CROSSED, MOST_PARTS = 1.0, 60.0, 256


class RampPart(NamedTuple):
    """A part of a ramp."""

    lattice: ReactionLattice
    """with the lowest barriers of this part"""
    temperature: float
    """the highest, K"""
    times: Array
    """s: those of the run, and the end"""
    bounds: _common.RampBounds | None


def parts_of(
    lattice: ReactionLattice,
    times: Array,
    begin: float,
    temperature: float,
    to: Ramp,
) -> Iterator[RampPart]:
    """The parts of a ramp from ``begin`` (s) to the last of ``times``."""
    end, kelvin = to.lattice, to.temperature
    assert end is not None
    assert isinstance(kelvin, float)
    final = float(times[-1])
    if final <= begin:
        yield RampPart(end, kelvin, np.append(times, final), None)
        return
    barriers = {
        name: (own, there - own)
        for name in ("forming", "breaking")
        if (own := getattr(lattice, name)) is not None
        and np.any((there := getattr(end, name)) != own)
    }
    largest = max(
        (float(np.abs(rise).max()) for _, rise in barriers.values()), default=0.0
    )
    change = largest / (KB * min(temperature, kelvin))
    change += CROSSED * abs(math.log(kelvin / temperature))
    count = math.ceil(min(max(change / CHANGE, 1.0), MOST_PARTS))
    for part in range(count):
        shares = np.array([part, part + 1]) / count
        since, until = begin + (final - begin) * shares
        until = final if part == count - 1 else until
        # the first part has its beginning as well
        inside = (times <= until) & ((times > since) | (part == 0))
        kelvins = temperature + (kelvin - temperature) * shares
        hottest = float(kelvins.max())
        lowest, above = {}, {}
        for name, (own, rise) in barriers.items():
            levels = own + rise * shares[:, None]
            lowest[name] = levels.min(axis=0)
            above[name] = levels - lowest[name]
        none = np.empty((2, 0))
        yield RampPart(
            lattice.model_copy(update=lowest),
            hottest,
            np.append(times[inside], until),
            _common.RampBounds(
                float(since),
                float(until - since),
                tuple((kelvins / hottest).tolist()),
                above.get("forming", none),
                above.get("breaking", none),
            ),
        )


#: Events per site to 1e5 s at room temperature on the paper's rough contact, for where the scene's are not known.
EVENTS_PER_SITE = 0.5
#: An event on a lattice of at most so many sites, which stays in the processor's cache, takes so large a part of the
#: time of one on a lattice that does not, of the second number of sites or more.
CACHED, SMALL, LARGE = 0.45, 3e3, 1e5


def expected_cost(
    sites: float,
    event: float,
    site: float,
    memory: float,
    events: float | None = None,
    superbasins: bool = False,
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
        cost |= {
            "cpu_seconds": (least * most) ** 0.5,
            "cpu_seconds_least": least,
            "cpu_seconds_most": most,
        }
    return cost


def run_pieces(
    job: Job,
    follow: Callable[[int, int, Array], int],
    pieces: Sequence[tuple[int, int]],
    threads: int,
) -> None:
    """Follow every piece of a lattice, on ``threads`` threads (0: one per processor), and add up the tallies.

    ``follow(first, last, tally)`` goes on for a while, adds to ``tally`` and returns where it stopped. Tallies are
    whole numbers, so their sum depends neither on the order of the pieces nor on the number of threads.
    """
    stop = Event()

    def followed(piece: tuple[int, int]) -> Array:
        tally = np.zeros_like(job.tally)
        first, last = piece
        while first < last and not stop.is_set():
            first = follow(first, last, tally)
        return tally

    with ThreadPoolExecutor(
        max(min(threads or processors.available(), len(pieces)), 1)
    ) as pool:
        try:
            for tally in pool.map(followed, pieces):
                job.tally += tally
        except BaseException:
            stop.set()
            raise
