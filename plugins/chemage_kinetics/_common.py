"""What the kernels share: fixed-point energies, a clock that does not stall, random variates, the two-state chain.

Numba only; nothing of the framework but its counter-based random numbers.

Energies are whole multiples of 2**-40 eV in int64. A bond adds its pair energies to its neighbours and takes the same
whole numbers away when it breaks, so the energy of a site depends on who is bonded and not on how that came about: no
drift, and a restart is bit-exact. Where a site's energy and its state are wanted together they share one word,
``2 * energy + bonded``, so that a neighbour costs one cache line.

Times are unevaluated sums ``high + low`` of two doubles. At t = 1e5 s and a total rate of 1e13 Hz a single double would
not advance at all.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np
from llvmlite import ir
from llvmlite.ir import Constant
from numba.core import types
from numba.extending import intrinsic

from chemage.foundation.random import KINETICS, uniform_pair

#: Fixed-point units in an electronvolt.
UNITS_PER_EV = 2.0**40
#: Barriers and couplings beyond these are cut off; exp has long under- or overflowed there below 1e6 K.
LARGEST_BARRIER = 2.0**20
LARGEST_COUPLING = 2.0**15
#: ln of the smallest rate, over the attempt frequency, that is told from zero.
COLDEST = 745.0
#: Event counts stop here instead of overflowing.
MOST = np.int64(2**61)

#: Each engine has its own random numbers, so that two engines on one seed are independent samples.
STREAMS = {"rejection-free": KINETICS, "bkl": KINETICS + 1, "next-reaction": KINETICS + 2, "independent": KINETICS + 3}

_HUGE = 2.0**50

#: For what Python calls.
jit = nb.njit(cache=True, nogil=True, error_model="numpy")
#: For what only kernels call: compiled into them, so it needs neither wrappers nor a place in the cache.
_INNER: Any = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inner = nb.njit(**_INNER)
#: For what a kernel does at every event: an array costs up to ten arguments in a call, so these are never called.
hot = nb.njit(forceinline=True, **_INNER)


def _typed_touch(typingctx, array, row):
    """Ask for the cache line where a row of an array starts, without waiting for it; harmless outside the array."""

    def codegen(context, builder, signature, args):
        view = context.make_array(signature.args[0])(context, builder, args[0])
        byte, word, long = ir.IntType(8).as_pointer(), ir.IntType(32), ir.IntType(64)
        fetch = builder.module.declare_intrinsic(
            "llvm.prefetch", (byte,), ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        )
        step = builder.mul(args[1], builder.extract_value(view.strides, 0))
        address = builder.add(builder.ptrtoint(view.data, long), step)
        builder.call(fetch, [builder.inttoptr(address, byte), word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), codegen


touch: Any = intrinsic(_typed_touch)


@hot
def touch_rows(i, neighbours, coupling):
    """Ask for the rows of site i, which may lie across two cache lines."""
    touch(neighbours, i)
    touch(neighbours, i + 1)
    touch(coupling, i)
    touch(coupling, i + 1)


@hot
def touch_site(i, words, neighbours, coupling, breaking):
    """Ask for all that belongs to site i alone."""
    touch(words, i)
    touch_rows(i, neighbours, coupling)
    if breaking.size > 0:
        touch(breaking, i)


def _typed_bare(typingctx, array):
    """The same array without its owner, so that passing it about inside a kernel counts no references.

    Numba counts them by atomic operations, which cost more than half of the time of an event where it cannot see that
    they cancel. Only for arguments of the running function: its caller keeps them alive.
    """

    def codegen(context, builder, signature, args):
        view = context.make_array(signature.args[0])(context, builder, args[0])
        view.meminfo = Constant(view.meminfo.type, None)
        view.parent = Constant(view.parent.type, None)
        return view._getvalue()

    return array(array), codegen


bare: Any = intrinsic(_typed_bare)


@inner
def fixed_barrier(energy):
    """eV to fixed point, cut off at ±2**20 eV."""
    return np.int64(np.rint(min(max(energy, -LARGEST_BARRIER), LARGEST_BARRIER) * UNITS_PER_EV))


@inner
def fixed_coupling(energy):
    """eV to fixed point, cut off at ±2**15 eV."""
    return np.int64(np.rint(min(max(np.float64(energy), -LARGEST_COUPLING), LARGEST_COUPLING) * UNITS_PER_EV))


@jit
def start_words(forming, neighbours, coupling, state, words):
    """Fill ``words`` (n,) int64 with 2 * (forming barrier with the present neighbours) + bonded."""
    n, k = neighbours.shape
    for i in range(n):
        words[i] = 2 * fixed_barrier(forming[i]) + state[i]
    for i in range(n):
        if state[i]:
            for s in range(k):
                j = neighbours[i, s]
                if j >= 0:
                    words[j] += 2 * fixed_coupling(coupling[i, s])


@inner
def rate(barrier, nu, per_unit):
    """nu exp(-E/kT) for a fixed-point barrier; nu where E <= 0. ``per_unit`` is 1/kT over one fixed-point unit."""
    if barrier <= 0:
        return nu
    return nu * math.exp(-(barrier * per_unit))


@inner
def own_rate(site, words, breaking, nu, per_unit):
    """The rate of what a site does next, form its bond or break it; 0 for a bond that never breaks."""
    word = words[site]
    if word & 1 == 0:
        return rate(word >> 1, nu, per_unit)
    if breaking.size > 0:
        return rate(fixed_barrier(breaking[site]), nu, per_unit)
    return 0.0


@inner
def later(high, low, step):
    """(high + low) + step, step >= 0 and finite, as a normalised pair of doubles."""
    s = high + step
    b = s - high
    low += (high - (s - b)) + (step - b)
    top = s + low
    return top, low - (top - s)


@inner
def past(high, low, time):
    """Whether the instant high + low comes after ``time``."""
    return high > time or (high == time and low > 0.0)


@inner
def until(high, low, time):
    """Seconds from the instant high + low to ``time``, not negative."""
    return max((time - high) - low, 0.0)


@inner
def _add(total, more):
    if more >= 2.0e18 or total + np.int64(more) > MOST:
        return MOST
    return total + np.int64(more)


@inner
def count_flip(tally, hold, word):
    """Note a flip that has taken place; ``word & 1`` is the new state. tally: (m, 3) formed, broken, difference."""
    if word & 1:
        tally[hold, 0] += 1
        tally[hold, 2] += 1
    else:
        tally[hold, 1] += 1
        tally[hold, 2] -= 1


@inner
def count_sojourn(tally, hold, word, out_here, out_there, other):
    """Note the flips of a sojourn from the state ``word & 1``; counts stop at 2**61, the difference is exact."""
    bonded = word & 1
    tally[hold, 0] = _add(tally[hold, 0], out_there if bonded else out_here)
    tally[hold, 1] = _add(tally[hold, 1], out_here if bonded else out_there)
    if other:
        tally[hold, 2] += -1 if bonded else 1


# -- variates ------------------------------------------------------------------------------------------------------
# `rng` is a uint64 array (k0, k1, stream, index, next block): a private sequence within one index.


@inner
def two_uniforms(rng):
    """The next two uniforms of a private sequence."""
    pair = uniform_pair(rng[0], rng[1], rng[2], rng[3], rng[4])
    rng[4] += np.uint64(1)
    return pair


@inner
def gamma(rng, shape):
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
def _last_cycle(rng, cycles, here, there, sum_here, sum_there, left):
    """Where in ``cycles`` cycles of known total duration the time ``left`` falls.

    The sums of unit exponentials over all cycles are known; they are split by beta variates (the law of a partial sum
    given the whole) until one cycle remains. Returns (whole cycles done, whether the flip out of the first state also
    was, time left).
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
def sojourn(rng, here, there, leave_here, leave_there, span):
    """The absorbing two-state chain: one site flips to and fro until something else happens or ``span`` seconds pass.

    The site leaves its present state at the rate ``here`` and its other state at ``there``; everything else happens at
    the total rate ``leave_here`` or ``leave_there``, depending on the state. Both flip rates are positive.
    Returns (time spent, whether something else ended it, whether the site ended in its other state, flips out of the
    present state, flips out of the other state). Exact: the number of there-and-back cycles is geometric, the time in
    each state is a sum of exponentials (a gamma variate), and where ``span`` ends first, the partial sums given the
    whole are beta variates. Novotny, Phys. Rev. Lett. 74, 1 (1995) has the chain; drawing the cycles keeps the number
    of events as well.
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
                # No double tells single flips apart here: the state is stationary, the count normal to the last bit.
                u, v = two_uniforms(rng)
                spread = math.sqrt(expected) * math.sqrt(1.0 / all_here**2 + 1.0 / all_there**2) / mean
                x = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)
                done += np.floor(expected + spread * x)
                other = two_uniforms(rng)[0] * (all_here + all_there) < all_here
                return span, False, other, done + (1.0 if other else 0.0), done
            if allowed >= 1.0:
                left = max(left - (gamma(rng, allowed) / all_here + gamma(rng, allowed) / all_there), 0.0)
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
            more, other = _last_cycle(rng, cycles, all_here, all_there, sum_here, sum_there, left)
            done += more
            return span, False, other, done + (1.0 if other else 0.0), done
        left -= spent
        done += cycles
        allowed -= cycles
    u, v = two_uniforms(rng)
    spent = -math.log(u) / all_here
    if spent > left:
        return span, False, False, done, done
    left -= spent
    if not out_there:
        return span - left, True, False, done, done
    spent = -math.log(v) / all_there
    if spent > left:
        return span, False, True, done + 1.0, done
    return span - (left - spent), True, True, done + 1.0, done


# -- fingerprints --------------------------------------------------------------------------------------------------

_P1 = np.uint64(0x9E3779B97F4A7C15)
_P2 = np.uint64(0xBF58476D1CE4E5B9)
_P3 = np.uint64(0x94D049BB133111EB)
_R27 = np.uint64(27)
_R31 = np.uint64(31)
_R37 = np.uint64(37)


@jit
def mix(words, seed):
    """A 64-bit fingerprint of uint64 words, to tell arrays apart, not for security."""
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
