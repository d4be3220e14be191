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
from numpy.typing import NDArray

from chemage.plugin import kernel, random

#: Numbers in kernels: int64 and float64. To a type checker they are Any, as are the elements of arrays.
Int: TypeAlias = Any
Float: TypeAlias = Any
Array: TypeAlias = NDArray[Any]
#: A time (s) as the sum of two doubles.
Instant: TypeAlias = tuple[Float, Float]
#: The instant of what does not happen.
NEVER = (np.inf, 0.0)

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
        byte, word, long = (
            ir.IntType(8).as_pointer(),
            ir.IntType(32),
            ir.IntType(64),
        )
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
#: Places in the counters of a run that is followed event by event.
EVENT, HOLD, LAST, DONE, DRAWN = 0, 1, 2, 3, 4
#: Event counts stop here instead of overflowing.
MOST = np.int64(2**61)

#: Each engine has its own stream of random numbers.
STREAMS = {
    "rejection-free": random.KINETICS,
    "bkl": random.KINETICS + 1,
    "next-reaction": random.KINETICS + 2,
    "independent": random.KINETICS + 3,
    "event-driven": random.KINETICS + 4,
    "many-states": random.KINETICS + 6,
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

    neighbours: Array
    coupling: Array
    breaking: Array
    nu: float
    per_unit: float


class RampBounds(NamedTuple):
    """Conditions that change linearly in time, under the bounds of a model that has the highest of all temperatures and
    the lowest of all barriers meanwhile."""

    begin: float
    """s"""
    span: float
    """s"""
    heat: tuple[float, float]
    """temperature at the beginning and the end over that of the model"""
    forming: Array
    """(2, n) eV that the barriers of the sites lie above those of the model, at the beginning and the end; or (2, 0)"""
    breaking: Array
    """the same of the breaking barriers"""


class Sites(NamedTuple):
    """All sites in their present states. What takes ``sites`` takes any tuple with these two."""

    words: Array
    """(n,) int64, see above"""
    model: KineticModel


class Holds(NamedTuple):
    """Hold times (m,) s, and the (m, 3) int64 counts of bonds formed, bonds broken, and their difference, each between
    the hold time before and this one."""

    times: Array
    tally: Array


class FlickerRates(NamedTuple):
    """Rates (Hz) around a site that flickers: of the site itself, and of everything else together; in its present
    state and in its other state."""

    here: float
    there: float
    around_here: float
    around_there: float


@hot
def degree(model: KineticModel) -> Int:
    """Neighbours that a site has at most."""
    return model.neighbours.shape[1]


@hot
def neighbour(i: Int, s: Int, model: KineticModel) -> Int:
    """The neighbour of site i in its slot s, or -1."""
    return np.int64(model.neighbours[i, s])


# -- memory --------------------------------------------------------------------------------------------------------


@hot
def prefetch_rows(i: Int, model: KineticModel) -> None:
    """Prefetch the graph rows of site i, which may lie across two cache lines."""
    prefetch(model.neighbours, i)
    prefetch(model.neighbours, i + 1)
    prefetch(model.coupling, i)
    prefetch(model.coupling, i + 1)


@hot
def prefetch_site(i: Int, words: Array, model: KineticModel) -> None:
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
    forming: Array, model: KineticModel, state: Array, words: Array
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


@hot
def rate(barrier: Int, model: KineticModel) -> Float:
    """nu exp(-E/kT) for a fixed-point barrier; nu where E <= 0."""
    if barrier <= 0:
        return model.nu
    return model.nu * math.exp(-(barrier * model.per_unit))


@inner
def site_rate(site: Int, words: Array, model: KineticModel) -> Float:
    """The rate at which a site changes its state: forms its bond or breaks it. 0 for a bond that never breaks."""
    word = words[site]
    if word & 1 == 0:
        return rate(word >> 1, model)
    if model.breaking.size > 0:
        return rate(fixed_barrier(model.breaking[site]), model)
    return 0.0


@inner
def progress(now: Instant, ramp: RampBounds) -> tuple[Float, Float]:
    """How far a ramp is, from 0 to 1, and the temperature over that of the model."""
    part = ((now[0] - ramp.begin) + now[1]) / ramp.span
    return part, ramp.heat[0] + part * (ramp.heat[1] - ramp.heat[0])


@inner
def above(levels: Array, i: Int, part: Float) -> Float:
    """What the barrier of site i lies above that of the model, eV."""
    return levels[0, i] + part * (levels[1, i] - levels[0, i])


@inner
def over_bound(
    i: Int, word: Int, now: Instant, ramp: RampBounds, model: KineticModel
) -> Float:
    """The present rate of site i, whose word this is, over that in the model: with this probability an event that the
    model gives takes place (thinning; Lewis and Shedler, Nav. Res. Logist. Q. 26, 403 (1979))."""
    bonded = word & 1
    barrier = fixed_barrier(model.breaking[i]) if bonded else word >> 1
    levels = ramp.breaking if bonded else ramp.forming
    return crossing_over_bound(i, barrier, levels, now, ramp, model)


@inner
def crossing_over_bound(
    i: Int,
    barrier: Int,
    levels: Array,
    now: Instant,
    ramp: RampBounds,
    model: KineticModel,
) -> Float:
    """The same of a fixed-point barrier of site i, which lies above that of the model by ``levels``."""
    part, heat = progress(now, ramp)
    bound = max(barrier, 0) * model.per_unit
    if levels.shape[1] > 0:
        barrier += fixed_barrier(above(levels, i, part))
    return math.exp(bound - max(barrier, 0) * (model.per_unit / heat))


@inner
def rate_around(site: Int, sites: Any) -> Float:
    """Total rate of a site's neighbours."""
    total = 0.0
    for s in range(degree(sites.model)):
        j = neighbour(site, s, sites.model)
        if j >= 0:
            total += site_rate(j, sites.words, sites.model)
    return total


@inner
def choose_around(site: Int, u: Float, sites: Any) -> Int:
    """A neighbour of the site, by its rate; ``u`` uniform on (0, 1)."""
    target = u * rate_around(site, sites)
    chosen = -1
    for s in range(degree(sites.model)):
        j = neighbour(site, s, sites.model)
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
    for s in range(degree(sites.model)):
        j = neighbour(site, s, sites.model)
        if j >= 0:
            sites.words[j] += sign * fixed_coupling(sites.model.coupling[site, s])


# -- eight-way trees of sums ---------------------------------------------------------------------------------------


@hot
def block_sum(tree: Array, b: Int) -> Float:
    """The sum of eight neighbouring numbers from position ``b`` on."""
    return ((tree[b] + tree[b + 1]) + (tree[b + 2] + tree[b + 3])) + (
        (tree[b + 4] + tree[b + 5]) + (tree[b + 6] + tree[b + 7])
    )


@hot
def descend(tree: Array, base: Int, target: Float) -> tuple[Int, Float]:
    """The child at which the running sum passes ``target``, never one of zero rate; and the rest of the target."""
    chosen = 0
    for s in range(8):
        w = tree[base + s]
        if w > 0.0:
            chosen = s
            if target < w:
                break
            target -= w
    return chosen, target


# -- the clock -----------------------------------------------------------------------------------------------------


@inner
def later(now: Instant, step: Float) -> Instant:
    """``now`` and ``step`` seconds, as a normalised pair of doubles; never where that is beyond all numbers."""
    if not step <= 1.0e300:
        return NEVER
    high, low = now
    s = high + step
    b = s - high
    low += (high - (s - b)) + (step - b)
    top = s + low
    return top, low - (top - s)


@inner
def past(now: Instant, time: Float) -> bool:
    """Whether an instant comes after ``time``."""
    return now[0] > time or (now[0] == time and now[1] > 0.0)


@inner
def until(now: Instant, time: Float) -> Float:
    """Seconds from an instant to ``time``, not negative."""
    return max((time - now[0]) - now[1], 0.0)


@hot
def time_of(times: Array, i: Int) -> Instant:
    """The instant in row i of ``times`` (n, 2)."""
    return times[i, 0], times[i, 1]


@hot
def set_time(times: Array, i: Int, instant: Instant) -> None:
    """Write an instant into row i of ``times`` (n, 2)."""
    times[i, 0], times[i, 1] = instant


@hot
def own_uniform(i: Int, sites: Any, stream: Int) -> Float:
    """The next random number of site i; ``sites``: see `next_event`."""
    draw = sites.draws[i]
    sites.draws[i] = draw + 1
    return random.uniform(sites.key.k0, sites.key.k1, stream, sites.pixels[i], draw)


@hot
def next_event(
    i: Int, barrier: Int, now: Instant, sites: Any, stream: Int
) -> Instant:
    """The instant at which site i crosses a fixed-point barrier, from ``now`` on, by the next random number of the site.

    ``sites``: any tuple with its ``key``, ``model``, ``pixels`` and ``draws``.
    """
    wait = -math.log(own_uniform(i, sites, stream)) / sites.model.nu
    if barrier > 0:
        wait *= math.exp(barrier * sites.model.per_unit)
    return later(now, wait)


# -- counts --------------------------------------------------------------------------------------------------------


@inner
def _add(total: Float, more: Float) -> Int:
    if more >= 2.0e18 or total + np.int64(more) > MOST:
        return MOST
    return total + np.int64(more)


@inner
def count_flip(tally: Array, hold: Int, word: Int) -> None:
    """Count an event that has taken place; ``word & 1`` is the new state. tally: see `Holds`."""
    if word & 1:
        tally[hold, 0] += 1
        tally[hold, 2] += 1
    else:
        tally[hold, 1] += 1
        tally[hold, 2] -= 1


@inner
def count_sojourn(
    tally: Array,
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
def two_uniforms(rng: Array) -> tuple[Float, Float]:
    """The next two uniforms of a private sequence."""
    pair = random.uniform_pair(rng[0], rng[1], rng[2], rng[3], rng[4])
    rng[4] += np.uint64(1)
    return pair


@inner
def begin_sequence(
    rng: Array, key: Key, stream: Int, index: Int, block: Int
) -> None:
    """Set ``rng`` to a private sequence, from a block of the random numbers of an index on."""
    rng[0] = key.k0
    rng[1] = key.k1
    rng[2] = np.uint64(stream)
    rng[3] = np.uint64(index)
    rng[4] = np.uint64(block)


@inner
def begin_own_sequence(rng: Array, i: Int, sites: Any, stream: Int) -> None:
    """Set ``rng`` to a sequence of site i, whose next random number it uses; ``sites``: see `next_event`."""
    block = SOJOURN_BLOCKS + np.uint64(sites.draws[i] * SOJOURN_DRAWS)
    begin_sequence(rng, sites.key, stream, sites.pixels[i], block)
    sites.draws[i] += 1


@inner
def gamma(rng: Array, shape: Float) -> Float:
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
    rng: Array,
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
    rng: Array, all_here: Float, all_there: Float, out_there: bool, left: Float
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
    rng: Array,
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
                        gamma(rng, allowed) / all_here
                        + gamma(rng, allowed) / all_there
                    ),
                    0.0,
                )
                done += allowed
                allowed = 0.0
        cycles = min(
            allowed, max(np.floor(expected - 3.0 * math.sqrt(expected)), 1.0)
        )
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


@inner
def stay(
    rng: Array,
    rates: FlickerRates,
    now: Instant,
    holds: Holds,
    hold: Int,
    word: Int,
) -> tuple[Instant, bool, bool]:
    """Follow and count the flips of a site in the state ``word & 1`` until something else happens or the hold time.

    Returns that instant, whether something else happened, and whether the site ended in its other state.
    """
    limit = holds.times[hold]
    spent, exited, other, out_here, out_there = sojourn(
        rng,
        rates.here,
        rates.there,
        rates.around_here,
        rates.around_there,
        until(now, limit),
    )
    count_sojourn(holds.tally, hold, word, out_here, out_there, other)
    if exited:
        now = later(now, spent)
    if not exited or past(now, limit):
        now = (limit, 0.0)
    return now, exited, other


_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xBF58476D1CE4E5B9)
_P3 = np.uint64(0x94D049BB133111EB)
_R27 = np.uint64(27)
_R31 = np.uint64(31)
_R37 = np.uint64(37)


def patches_of(
    neighbours: Array, label: Array | None = None
) -> tuple[Array, Array]:
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
def _find(neighbours: Array, order: Array, starts: Array, label: Array) -> Int:
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
def mix(words: Array, seed: np.uint64) -> np.uint64:
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
