"""What the kernels share: how they are compiled, fixed-point energies, rates, a clock that does not stall, counts of
events, the chain of a site that flickers, and the patches of a lattice.

Energies are whole multiples of 2**-40 eV in int64. A bond adds its pair energies to its neighbours and takes the same
whole numbers away when it breaks, so the energy of a site depends on the present bonds and not on their history: no
drift, and a restart is bit-exact. Where a site's energy and its state are needed together they share one word,
``2 * energy + bonded``, so that a neighbour costs one cache line.

Times are unevaluated sums ``high + low`` of two doubles. At t = 1e5 s and a total rate of 1e13 Hz a single double would
not advance at all.

Two things about memory that numba itself cannot express are written as LLVM code, here and nowhere else. They read and
set members of numba's array structure: ``data``, ``strides``, ``meminfo`` and ``parent``, which are the same in numba
0.59 to 0.68.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from chemage.plugin import kernel, random

#: Numbers in kernels: int64 and float64. To a type checker they are Any, as are the elements of arrays.
Int: TypeAlias = Any
Float: TypeAlias = Any

#: For functions that Python calls.
jit = kernel(nogil=True, error_model="numpy")
_KERNELS_ONLY: Any = {
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
#: For functions that only kernels call: part of their machine code, without a wrapper for Python or a cache entry.
inner = nb.njit(**_KERNELS_ONLY)
#: For functions that a kernel runs at every event: always inlined, because an array takes up to ten machine words as
#: an argument of a call.
hot = nb.njit(forceinline=True, **_KERNELS_ONLY)


def _typed_prefetch(typingctx: Any, array: Any, row: Any) -> Any:
    """Prefetch the cache line where a row of an array starts. Does not wait; harmless outside the array."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, args[0])
        byte, word, long = ir.IntType(8).as_pointer(), ir.IntType(32), ir.IntType(64)
        fetch = builder.module.declare_intrinsic(
            "llvm.prefetch",
            (byte,),
            ir.FunctionType(ir.VoidType(), [byte, word, word, word]),
        )
        step = builder.mul(args[1], builder.extract_value(view.strides, 0))
        address = builder.add(builder.ptrtoint(view.data, long), step)
        builder.call(
            fetch, [builder.inttoptr(address, byte), word(0), word(3), word(1)]
        )
        return context.get_dummy_value()

    return types.void(array, types.int64), codegen


prefetch: Any = intrinsic(_typed_prefetch)


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value of an array without its owner; of a tuple, the tuple of such values; of anything else, itself."""
    if isinstance(kind, types.Array):
        view = context.make_array(kind)(context, builder, value)
        view.meminfo = ir.Constant(view.meminfo.type, None)
        view.parent = ir.Constant(view.parent.type, None)
        return view._getvalue()
    if isinstance(kind, types.BaseTuple):
        for at, part in enumerate(kind):  # pyright: ignore[reportArgumentType]
            inside = _without_owner(
                context, builder, part, builder.extract_value(value, at)
            )
            value = builder.insert_value(value, inside, at)
    return value


def _typed_borrowed(typingctx: Any, bundle: Any) -> Any:
    """The same bundle of arrays without their owners, so that passing them about in a kernel counts no references.

    Numba counts references by atomic operations, which take more than half of the time of an event where it cannot see
    that they cancel. Only for arguments of the running function, because its caller keeps them alive.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _without_owner(context, builder, signature.args[0], args[0])

    return bundle(bundle), codegen


borrowed: Any = intrinsic(_typed_borrowed)


#: Fixed-point units in an electronvolt.
UNITS_PER_EV = 2.0**40
#: Barriers and couplings are limited to these, in eV; below 1e6 K, exp has long overflowed or underflowed there.
LARGEST_BARRIER = 2.0**20
LARGEST_COUPLING = 2.0**15
#: A rate below exp(-COLDEST) times the attempt frequency is zero.
COLDEST = 745.0
#: Places in the clock and the counters of a run that is followed event by event.
HIGH, LOW = 0, 1
EVENT, HOLD, LAST, DONE, DRAWN = 0, 1, 2, 3, 4
#: Event counts stop here instead of overflowing.
MOST = np.int64(2**61)

#: Each engine has its own stream of random numbers.
STREAMS = {
    "rejection-free": random.KINETICS,
    "bkl": random.KINETICS + 1,
    "next-reaction": random.KINETICS + 2,
    "independent": random.KINETICS + 3,
}


class Key(NamedTuple):
    """The key of a run's random numbers, see `chemage_kinetics._driver`."""

    k0: np.uint64
    k1: np.uint64


class KineticModel(NamedTuple):
    """Everything about a lattice at one temperature that does not change during a run, but the forming barriers.

    neighbours: (n, k) int32, -1 where there is none; k = 0 where nothing interacts. coupling: (n, k) eV. breaking: (n,)
    eV, or empty where bonds never break. nu: Hz. per_unit: 1/k_B T over one fixed-point unit of energy.
    """

    neighbours: np.ndarray
    coupling: np.ndarray
    breaking: np.ndarray
    nu: float
    per_unit: float


class Sites(NamedTuple):
    """All sites in their present states. What takes ``sites`` takes any tuple with these two."""

    words: np.ndarray
    """(n,) int64, see above"""
    model: KineticModel


class Holds(NamedTuple):
    """Hold times (m,) s, and the (m, 3) int64 counts of bonds formed, bonds broken, and their difference, each between
    the hold time before and this one."""

    times: np.ndarray
    tally: np.ndarray


# -- memory --------------------------------------------------------------------------------------------------------


@hot
def prefetch_rows(i: Int, model: KineticModel) -> None:
    """Prefetch the graph rows of site i, which may lie across two cache lines."""
    prefetch(model.neighbours, i)
    prefetch(model.neighbours, i + 1)
    prefetch(model.coupling, i)
    prefetch(model.coupling, i + 1)


@hot
def prefetch_site(i: Int, words: np.ndarray, model: KineticModel) -> None:
    """Prefetch everything that belongs to site i alone."""
    prefetch(words, i)
    prefetch_rows(i, model)
    if model.breaking.size > 0:
        prefetch(model.breaking, i)


# -- energies and rates --------------------------------------------------------------------------------------------


@inner
def fixed_barrier(energy: Float) -> Int:
    """eV to fixed point, limited to ±2**20 eV."""
    return np.int64(
        np.rint(min(max(energy, -LARGEST_BARRIER), LARGEST_BARRIER) * UNITS_PER_EV)
    )


@inner
def fixed_coupling(energy: Float) -> Int:
    """eV to fixed point, limited to ±2**15 eV."""
    return np.int64(
        np.rint(
            min(max(np.float64(energy), -LARGEST_COUPLING), LARGEST_COUPLING)
            * UNITS_PER_EV
        )
    )


@jit
def start_words(
    forming: np.ndarray, model: KineticModel, state: np.ndarray, words: np.ndarray
) -> None:
    """Fill ``words`` (n,) int64 with 2 * (forming barrier with the present neighbours) + bonded."""
    forming = borrowed(forming)
    model = borrowed(model)
    state = borrowed(state)
    words = borrowed(words)
    n, k = model.neighbours.shape
    for i in range(n):
        words[i] = 2 * fixed_barrier(forming[i]) + state[i]
    for i in range(n):
        if state[i]:
            for s in range(k):
                j = model.neighbours[i, s]
                if j >= 0:
                    words[j] += 2 * fixed_coupling(model.coupling[i, s])


@inner
def rate(barrier: Int, nu: Float, per_unit: Float) -> Float:
    """nu exp(-E/kT) for a fixed-point barrier; nu where E <= 0. ``per_unit`` is 1/kT over one fixed-point unit."""
    if barrier <= 0:
        return nu
    return nu * math.exp(-(barrier * per_unit))


@inner
def site_rate(site: Int, words: np.ndarray, model: KineticModel) -> Float:
    """The rate at which a site changes its state: forms its bond or breaks it. 0 for a bond that never breaks."""
    word = words[site]
    if word & 1 == 0:
        return rate(word >> 1, model.nu, model.per_unit)
    if model.breaking.size > 0:
        return rate(fixed_barrier(model.breaking[site]), model.nu, model.per_unit)
    return 0.0


@inner
def rate_around(site: Int, sites: Any) -> Float:
    """Total rate of a site's neighbours."""
    total = 0.0
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            total += site_rate(j, sites.words, sites.model)
    return total


@inner
def choose_around(site: Int, u: Float, sites: Any) -> Int:
    """A neighbour of the site, by its rate; ``u`` uniform on (0, 1)."""
    target = u * rate_around(site, sites)
    chosen = -1
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            w = site_rate(j, sites.words, sites.model)
            if w > 0.0:
                chosen = j
                if target < w:
                    break
                target -= w
    return chosen


@inner
def change_state(site: Int, sites: Any) -> None:
    """Form or break the bond of a site: its own word, and its neighbours' energies."""
    sites.words[site] ^= 1
    sign = 2 if sites.words[site] & 1 else -2
    for s in range(sites.model.neighbours.shape[1]):
        j = np.int64(sites.model.neighbours[site, s])
        if j >= 0:
            sites.words[j] += sign * fixed_coupling(sites.model.coupling[site, s])


# -- the clock -----------------------------------------------------------------------------------------------------


@inner
def later(high: Float, low: Float, step: Float) -> tuple[Float, Float]:
    """(high + low) + step, step >= 0 and finite, as a normalised pair of doubles."""
    s = high + step
    b = s - high
    low += (high - (s - b)) + (step - b)
    top = s + low
    return top, low - (top - s)


@inner
def past(high: Float, low: Float, time: Float) -> bool:
    """Whether the instant high + low comes after ``time``."""
    return high > time or (high == time and low > 0.0)


@inner
def until(high: Float, low: Float, time: Float) -> Float:
    """Seconds from the instant high + low to ``time``, not negative."""
    return max((time - high) - low, 0.0)


@hot
def next_event(
    key: Key,
    stream: Int,
    index: Int,
    draw: Int,
    barrier: Int,
    nu: Float,
    per_unit: Float,
    high: Float,
    low: Float,
) -> tuple[Float, Float]:
    """The instant, as a pair, at which a site crosses a fixed-point barrier, from high + low on; inf where the rate is
    zero. From the random number ``draw`` of the site with this ``index``."""
    wait = -math.log(random.uniform(key.k0, key.k1, stream, index, draw)) / nu
    if barrier > 0:
        wait *= math.exp(barrier * per_unit)
    if wait > 1.0e300:
        return np.inf, 0.0
    return later(high, low, wait)


# -- counts --------------------------------------------------------------------------------------------------------


@inner
def _add(total: Float, more: Float) -> Int:
    if more >= 2.0e18 or total + np.int64(more) > MOST:
        return MOST
    return total + np.int64(more)


@inner
def count_flip(tally: np.ndarray, hold: Int, word: Int) -> None:
    """Count an event that has taken place; ``word & 1`` is the new state. tally: see `Holds`."""
    if word & 1:
        tally[hold, 0] += 1
        tally[hold, 2] += 1
    else:
        tally[hold, 1] += 1
        tally[hold, 2] -= 1


@inner
def count_sojourn(
    tally: np.ndarray,
    hold: Int,
    word: Int,
    out_here: Float,
    out_there: Float,
    other: bool,
) -> None:
    """Count the flips of a sojourn from the state ``word & 1``; counts stop at 2**61, the difference is exact."""
    bonded = word & 1
    tally[hold, 0] = _add(tally[hold, 0], out_there if bonded else out_here)
    tally[hold, 1] = _add(tally[hold, 1], out_here if bonded else out_there)
    if other:
        tally[hold, 2] += -1 if bonded else 1


#: A site that flips more than so many times before anything else happens is treated as a two-state chain.
FLICKER = 8.0
#: Where every site has random numbers of its own, the blocks from here on belong to its sojourns, so many to each.
SOJOURN_BLOCKS = np.uint64(1 << 40)
SOJOURN_DRAWS = np.int64(4096)
#: With more cycles than these, a double does not resolve single flips.
_HUGE = 2.0**50


@inner
def two_uniforms(rng: np.ndarray) -> tuple[Float, Float]:
    """The next two uniforms of a private sequence."""
    pair = random.uniform_pair(rng[0], rng[1], rng[2], rng[3], rng[4])
    rng[4] += np.uint64(1)
    return pair


@inner
def begin_sequence(
    rng: np.ndarray, key: Key, stream: Int, index: Int, block: Int
) -> None:
    """Set ``rng`` to a private sequence, from a block of the random numbers of an index on."""
    rng[0] = key.k0
    rng[1] = key.k1
    rng[2] = np.uint64(stream)
    rng[3] = np.uint64(index)
    rng[4] = np.uint64(block)


@inner
def gamma(rng: np.ndarray, shape: Float) -> Float:
    """A gamma variate of unit rate and shape >= 1 (Marsaglia & Tsang 2000); the sum of ``shape`` unit exponentials."""
    d = shape - 1.0 / 3.0
    c = 1.0 / math.sqrt(9.0 * d)
    while True:
        u, angle = two_uniforms(rng)
        x = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * angle)
        v = 1.0 + c * x
        if v <= 0.0:
            continue
        v = v * v * v
        u, _ = two_uniforms(rng)
        if math.log(u) < 0.5 * x * x + d * (1.0 - v + math.log(v)):
            return d * v


@inner
def _last_cycle(
    rng: np.ndarray,
    cycles: Float,
    here: Float,
    there: Float,
    sum_here: Float,
    sum_there: Float,
    left: Float,
) -> tuple[Float, bool]:
    """Find where in ``cycles`` cycles of known total duration the time ``left`` ends.

    The sums of unit exponentials over all cycles are given; they are split by beta variates (the distribution of a
    partial sum given the whole) until one cycle remains. Returns the number of complete cycles, and whether the flip
    out of the first state came in time as well.
    """
    done = 0.0
    while cycles > 1.0:
        first = np.floor(0.5 * cycles)
        second = cycles - first
        a = gamma(rng, first)
        part_here = sum_here * (a / (a + gamma(rng, second)))
        a = gamma(rng, first)
        part_there = sum_there * (a / (a + gamma(rng, second)))
        spent = part_here / here + part_there / there
        if spent <= left:
            left -= spent
            done += first
            cycles = second
            sum_here = max(sum_here - part_here, 0.0)
            sum_there = max(sum_there - part_there, 0.0)
        else:
            cycles = first
            sum_here = part_here
            sum_there = part_there
    return done, sum_here / here <= left


@inner
def _exit(
    rng: np.ndarray, all_here: Float, all_there: Float, out_there: bool, left: Float
) -> tuple[bool, bool, Float]:
    """The last, incomplete cycle: whether the exit came in time, whether in the other state, and the time left."""
    u, v = two_uniforms(rng)
    spent = -math.log(u) / all_here
    if spent > left:
        return False, False, left
    left -= spent
    if not out_there:
        return True, False, left
    spent = -math.log(v) / all_there
    if spent > left:
        return False, True, left
    return True, True, left - spent


@inner
def sojourn(
    rng: np.ndarray,
    here: Float,
    there: Float,
    leave_here: Float,
    leave_there: Float,
    span: Float,
) -> tuple[Float, bool, bool, Float, Float]:
    """Sample the absorbing two-state chain: one site flickers until something else happens or ``span`` seconds pass.

    The site leaves its present state at the rate ``here`` and its other state at ``there``, both positive; everything
    else happens at the total rate ``leave_here`` or ``leave_there``, depending on the state. Returns the time spent,
    whether something else ended it, whether the site ended in its other state, the number of flips out of the present
    state, and that out of the other state.

    Exact: the number of complete cycles is geometric, the time in each state is a sum of exponentials (a gamma
    variate), and where ``span`` ends first, the partial sums given the whole are beta variates. The chain is that of
    Novotny, Phys. Rev. Lett. 74, 1 (1995); drawing the cycles gives the number of events as well.
    """
    all_here = here + leave_here
    all_there = there + leave_there
    miss_here = leave_here / all_here
    miss_there = leave_there / all_there
    u, v = two_uniforms(rng)
    stay = math.log1p(-miss_here) + math.log1p(-miss_there)
    allowed = np.floor(math.log(u) / stay) if stay < 0.0 else np.inf
    out_there = v * (miss_here + (1.0 - miss_here) * miss_there) > miss_here
    mean = 1.0 / all_here + 1.0 / all_there
    left = span
    done = 0.0
    while True:
        expected = left / mean
        if expected > _HUGE:
            if allowed > expected:
                # The state is stationary here, and the count normal to the last bit.
                u, v = two_uniforms(rng)
                spread = (
                    math.sqrt(expected)
                    * math.sqrt(1.0 / all_here**2 + 1.0 / all_there**2)
                    / mean
                )
                x = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)
                done += np.floor(expected + spread * x)
                other = two_uniforms(rng)[0] * (all_here + all_there) < all_here
                return span, False, other, done + (1.0 if other else 0.0), done
            if allowed >= 1.0:
                left = max(
                    left
                    - (
                        gamma(rng, allowed) / all_here + gamma(rng, allowed) / all_there
                    ),
                    0.0,
                )
                done += allowed
                allowed = 0.0
        cycles = min(allowed, max(np.floor(expected - 3.0 * math.sqrt(expected)), 1.0))
        if cycles < 1.0:
            break
        if cycles < 1.5:
            u, v = two_uniforms(rng)
            sum_here = -math.log(u)
            sum_there = -math.log(v)
        else:
            sum_here = gamma(rng, cycles)
            sum_there = gamma(rng, cycles)
        spent = sum_here / all_here + sum_there / all_there
        if spent > left:
            more, other = _last_cycle(
                rng, cycles, all_here, all_there, sum_here, sum_there, left
            )
            done += more
            return span, False, other, done + (1.0 if other else 0.0), done
        left -= spent
        done += cycles
        allowed -= cycles
    exited, other, left = _exit(rng, all_here, all_there, out_there, left)
    return (
        span - left if exited else span,
        exited,
        other,
        done + (1.0 if other else 0.0),
        done,
    )


_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xBF58476D1CE4E5B9)
_P3 = np.uint64(0x94D049BB133111EB)
_R27 = np.uint64(27)
_R31 = np.uint64(31)
_R37 = np.uint64(37)


def patches_of(
    neighbours: np.ndarray, label: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The sites patch by patch, (n,) int32, and where each patch begins there and the last ends, (patches + 1,) int32.

    label: (n,) int32 zeros to be overwritten; None: allocated here.
    """
    n = neighbours.shape[0]
    order = np.empty(n, np.int32)
    starts = np.empty(n + 1, np.int32)
    patches = _find(
        neighbours, order, starts, np.zeros(n, np.int32) if label is None else label
    )
    return order, starts[: patches + 1].copy()


@jit
def _find(
    neighbours: np.ndarray, order: np.ndarray, starts: np.ndarray, label: np.ndarray
) -> Int:
    """Breadth-first search; returns the number of patches."""
    n, k = neighbours.shape
    patches = 0
    filled = 0
    for seed in range(n):
        if label[seed]:
            continue
        starts[patches] = filled
        patches += 1
        label[seed] = 1
        order[filled] = seed
        read = filled
        filled += 1
        while read < filled:
            i = np.int64(order[read])
            read += 1
            for s in range(k):
                j = np.int64(neighbours[i, s])
                if j >= 0 and not label[j]:
                    label[j] = 1
                    order[filled] = j
                    filled += 1
    starts[patches] = filled
    return patches


@jit
def mix(words: np.ndarray, seed: np.uint64) -> np.uint64:
    """A 64-bit hash of uint64 words, to distinguish arrays; not for security."""
    a = seed ^ _P1
    b = seed + _P2
    c = seed ^ _P3
    d = seed + _P1
    n = words.size
    for i in range(0, n - 3, 4):
        a = ((a ^ words[i]) * _P1) ^ (a >> _R27)
        b = ((b ^ words[i + 1]) * _P2) ^ (b >> _R31)
        c = ((c ^ words[i + 2]) * _P3) ^ (c >> _R37)
        d = ((d ^ words[i + 3]) * _P1) ^ (d >> _R31)
    for i in range(n - n % 4, n):
        a = ((a ^ words[i]) * _P2) ^ (a >> _R31)
    h = a
    for lane in (b, c, d, np.uint64(n)):
        h = (h ^ lane) * _P3
        h ^= h >> _R31
        h = h * _P2
        h ^= h >> _R27
    return h
