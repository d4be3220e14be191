"""The absorbing two-state chain of a site that flickers, and the random variates it needs.

``rng`` is a uint64 array (k0, k1, stream, index, next block): a private sequence of random numbers within one index.
"""

from __future__ import annotations

import math

import numpy as np

from chemage.plugin import random
from chemage_kinetics._memory import Float, inner

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
    rng: np.ndarray, cycles: Float, here: Float, there: Float, sum_here: Float, sum_there: Float, left: Float
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
def _exit(rng: np.ndarray, all_here: Float, all_there: Float, out_there: bool, left: Float) -> tuple[bool, bool, Float]:
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
    rng: np.ndarray, here: Float, there: Float, leave_here: Float, leave_there: Float, span: Float
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
    exited, other, left = _exit(rng, all_here, all_there, out_there, left)
    return span - left if exited else span, exited, other, done + (1.0 if other else 0.0), done
