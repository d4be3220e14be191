"""Kernel of the pulled contact: bonds are springs between slider and sites, which break the faster the more they are
stretched, and form at the rates of the chemistry.

Between events the slider moves at a constant speed, so that only the rates of bonds change. Its path is divided
into windows in which the force on a bond grows by k_BT/Δx. Every bond has a bound of its rate: the rate that it
has at the end of a window ahead, because rates never fall with the stretch. Forming rates and bounds are the leaves of
one tree of sums; a bond that is selected breaks with the probability of its rate over its bound (thinning; Lewis and
Shedler, Nav. Res. Logist. Q. 26, 403 (1979)). This is exact whatever the speed does, as long as no bond goes beyond the
window of its bound: bonds are listed by that window and get a new bound when the slider comes to it, also where an
avalanche carries the slider over many windows at once.

A position is a whole number of windows and the rest, so that a bond's stretch keeps all digits far from the start. The
rest, sums over it, and the force of a spring at which the slider rests are pairs of doubles: work and losses are
differences of large numbers where stretches or forces are small.

Sites of the counter-body lie a spacing apart, which is divided into CELLS cells. With every spacing of slip a site comes
to another partner, each site in the cell of its own phase. Between the edges of cells the rates of free sites are
constant; at an edge the free sites whose phase it is get the rate of their new partner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.plugin import random
from chemage_kinetics._common import (
    STREAMS,
    UNITS_PER_EV,
    Array,
    Float,
    Instant,
    Int,
    Key,
    KineticModel,
    RampBounds,
    above,
    block_sum,
    borrowed,
    degree,
    fixed_barrier,
    fixed_coupling,
    hot,
    inner,
    jit,
    later,
    neighbour,
    over_bound,
    past,
    prefetch,
    progress,
    rate,
    until,
)
from chemage_kinetics._rejection_free import (
    SiteRates,
    mark,
    prefetch_leaf,
    refresh,
    select,
    sum_leaves,
    tree_total,
)

STREAM = STREAMS["event-driven"]
PARTNER, PHASE = random.KINETICS + 5, random.KINETICS + 7
#: of a spacing, and its binary logarithm
CELLS, CELL_BITS = np.int64(4096), 12
#: windows that are listed, and the furthest window ahead at whose end a bond may have its bound
RING, FURTHEST = np.int64(256), np.int64(128)
#: sites whose memory is fetched while others meet their partners: they lie too far apart for the processor to do so
AHEAD = np.int64(16)
#: a bond is selected with this probability at most before it has come as far ahead, where that is several windows
RARE = 0.2
NONE = np.int64(-1)
#: the force falls from a maximum by more than this part of the largest force: a slip
SLIP = 0.05

# real numbers of the state, and counts
(
    HIGH,
    LOW,
    REST,
    REST_LOW,
    SUM_REST,
    SUM_LOW,
    PULL,
    PULL_LOW,
    WORK,
    WORK_LOW,
    LOST,
    LOST_LOW,
    RUBBED,
    RUBBED_LOW,
) = range(14)
(
    OFFSET,
    OFFSET_LOW,
    LEFT,
    PEAK,
    PEAK_AT,
    PEAK_TIME,
    LEAST,
    TOP,
    BOTTOM,
    LARGEST,
    MOVED_BEFORE,
    CHOICE,
) = range(14, 26)
REALS = 26
(
    EVENT,
    WINDOW,
    SUM_WINDOWS,
    BONDS,
    FORMED,
    BROKEN,
    FALLING,
    FALLS,
    SLIPS,
    HOLD,
    DONE,
    FIRST,
    RESTS,
    CELL,
) = range(14)
COUNTS = 14
# columns of what is sampled
MOVED, FORCE, WORKED, DISSIPATED, STORED, FRICTION = range(6)


class Bonds(NamedTuple):
    """How a bond breaks under force; lengths in nm, forces in nN."""

    barrier: Array
    """(n,) breaking barrier over k_BT, not negative; that of the partner with which each bond formed"""
    exponent: float
    """ν"""
    gain: float
    """by how much the barrier falls with the stretch at first, over k_BT: 1/nm"""
    stiffness: float
    """nN/nm"""
    window: float
    """nm"""
    thermal: float
    """k_BT, eV"""


class SliderDrive(NamedTuple):
    """What pulls: speed nm/s, which rises (nm/s²) from its value at a time (s) on; spring nN/nm, inf where the slider
    itself has the speed; friction nN."""

    speed: float
    spring: float
    friction: float
    rise: float
    since: float


class Counterpart(NamedTuple):
    """What the sites meet on the counter-body; ``forming`` is empty where they keep their partners."""

    key: Key
    """of the seed alone, so that sites keep their partners when the lattice changes"""
    own: tuple[Array, Array]
    """(n,) eV: forming and breaking barrier of each site with its first partner"""
    forming: Array
    """(q,) eV, ascending: quantiles of the intrinsic forming barrier"""
    breaking: Array
    """(q,) eV: those of the breaking barrier"""
    shift: tuple[Array, Array]
    """(n,) eV, what both barriers of a site have beside those of the partner"""
    pixels: Array
    """(n,) int64: index of each site's random numbers"""
    phase: Array
    """(n,) int64: cells by which each site is ahead"""
    width: float
    """of a cell, nm"""
    order: Array
    """(n,) int64: the sites by the cell, modulo CELLS, in which they meet a new partner, ascending within it"""
    first: Array
    """(CELLS + 1,) int64: where the sites of each such cell begin in ``order``"""
    ahead: Array
    """(CELLS,) int64: cells from each to the next one with a site"""
    blocks: Array
    """int64 scratch: blocks whose ancestors are to be summed again"""


class PullRun(NamedTuple):
    """Everything a pull consists of; its arrays carry the state from call to call."""

    key: Key
    model: KineticModel
    bonds: Bonds
    drive: SliderDrive
    partners: Counterpart
    words: Array
    """(n,) int64, see `_common`"""
    base: Array
    """(n,) int64: the part of the forming barrier that is the site's own, in fixed point"""
    rates: SiteRates
    made: Array
    """(n,) int64: window in which each bond formed"""
    rest: Array
    """(n,) float64 nm: where in that window"""
    partner: Array
    """(n,) int64: the partner of each bond"""
    bound: Array
    """(n,) int64: the window at whose beginning the bound of a bond ends"""
    heads: Array
    """(RING,) int64: first bond listed for a window"""
    links: Array
    """(n, 2) int64: next and previous bond of the list"""
    reals: Array
    counts: Array
    slip_sizes: Array
    """(64,) int64: number of slips with 2^j to 2^(j+1) ruptures"""
    times: Array
    samples: Array
    """(m, 6) float64"""
    tallies: Array
    """(m, 3) int64: bonds, formed, broken"""


# -- rates ---------------------------------------------------------------------------------------------------------


@hot
def under_force(
    barrier: Float, lowered: Float, exponent: Float, nu: Float
) -> Float:
    """The rate of a bond whose force times Δx is ``lowered``, both in k_BT; see `chemage_bonds.rupture`."""
    share = 1.0 - exponent * lowered / barrier if barrier > 0.0 else 0.0
    if share <= 0.0:
        return nu
    if exponent == 1.0:
        return nu * math.exp(-barrier * share)
    if exponent == 0.5:
        left = share * share * barrier
        factor = share
    else:
        factor = math.sqrt(share)
        left = share * factor * barrier
    if left < 1.0 - exponent:
        # the largest rate, which stays; a barrier that was lower from the beginning keeps its rate
        if barrier <= 1.0 - exponent:
            return nu * math.exp(-barrier)
        left = 1.0 - exponent
        factor = (left / barrier) ** (1.0 - exponent)
    return nu * factor * math.exp(-left)


@hot
def _stretch(i: Int, run: PullRun, window: Int, rest: Float) -> Float:
    return (window - run.made[i]) * run.bonds.window + (rest - run.rest[i])


@hot
def _present_stretch(i: Int, run: PullRun) -> Float:
    """The stretch of bond i; it is never compressed."""
    return max(
        _stretch(i, run, run.counts[WINDOW], run.reals[REST]) + run.reals[REST_LOW],
        0.0,
    )


@hot
def _rate_at(i: Int, run: PullRun, stretch: Float) -> Float:
    """The breaking rate of bond i if it is stretched so far."""
    return under_force(
        run.bonds.barrier[i],
        max(stretch, 0.0) * run.bonds.gain,
        run.bonds.exponent,
        run.model.nu,
    )


@hot
def _load(run: PullRun) -> Float:
    """The force of all bonds, nN."""
    counts, reals = run.counts, run.reals
    if counts[BONDS] == 0:
        return 0.0
    whole = counts[WINDOW] * counts[BONDS] - counts[SUM_WINDOWS]
    # the product of the rest and the number of bonds, which is below 2**26, exactly, as a pair
    scaled = 134217729.0 * reals[REST]
    top = scaled - (scaled - reals[REST])
    rest = reals[REST] * counts[BONDS]
    low = (top * counts[BONDS] - rest) + (reals[REST] - top) * counts[BONDS]
    rest = (rest - reals[SUM_REST]) + (
        low - reals[SUM_LOW] + reals[REST_LOW] * counts[BONDS]
    )
    return max(run.bonds.stiffness * (whole * run.bonds.window + rest), 0.0)


@hot
def _force(run: PullRun) -> Float:
    """Of the drive, nN."""
    if run.counts[RESTS]:
        return run.reals[PULL] + run.reals[PULL_LOW]
    return _load(run) + run.drive.friction


@hot
def _slack(run: PullRun) -> Float:
    """How much more bonds and friction hold than the spring pulls, nN, where the slider rests."""
    return (_load(run) + run.drive.friction - run.reals[PULL]) - run.reals[PULL_LOW]


@hot
def _drive_speed(run: PullRun, span: Float) -> Float:
    """Of the drive, nm/s: mean of the next ``span`` seconds."""
    drive = run.drive
    if drive.rise == 0.0:
        return drive.speed
    passed = (run.reals[HIGH] - drive.since) + run.reals[LOW]
    return max(drive.speed + drive.rise * (passed + 0.5 * span), 0.0)


@hot
def _share(run: PullRun) -> Float:
    """The speed of the slider over that of the drive."""
    drive = run.drive
    if run.counts[RESTS] or drive.spring == 0.0:
        return 0.0
    if math.isinf(drive.spring):
        return 1.0
    return drive.spring / (drive.spring + run.counts[BONDS] * run.bonds.stiffness)


@hot
def _speed(run: PullRun, span: Float) -> Float:
    """Of the slider, nm/s: mean of the next ``span`` seconds without an event."""
    return _drive_speed(run, span) * _share(run)


@hot
def _arrives(way: Float, speed: Float, rise: Float) -> Float:
    """In how many seconds what has this speed, which rises, goes so far."""
    if rise == 0.0:
        return way / speed if speed > 0.0 else np.inf
    root = speed * speed + 2.0 * rise * way
    if way <= 0.0:
        return 0.0
    return 2.0 * way / (speed + math.sqrt(root)) if root > 0.0 else np.inf


# -- lists of bonds by window --------------------------------------------------------------------------------------


@hot
def _enlist(i: Int, window: Int, run: PullRun) -> None:
    run.bound[i] = window
    slot = window & (RING - 1)
    first = run.heads[slot]
    run.links[i, 0] = first
    run.links[i, 1] = NONE
    if first >= 0:
        run.links[first, 1] = i
    run.heads[slot] = i


@hot
def _least_barrier(speed: Float, run: PullRun) -> Float:
    """The barrier (k_BT) over which bonds break with probability RARE within the FURTHEST windows; inf at rest."""
    if speed <= 0.0:
        return np.inf
    return math.log(run.model.nu * run.bonds.window * FURTHEST / (RARE * speed))


@hot
def _bind(i: Int, least: Float, run: PullRun) -> None:
    """Give bond i a bound at the end of a window ahead, and list it there; ``least``: see `_least_barrier`."""
    window, ahead = run.counts[WINDOW], np.int64(1)
    barrier, exponent = run.bonds.barrier[i], run.bonds.exponent
    if 0.0 < least < barrier:
        # the stretch that leaves so much of the barrier
        share = least / barrier
        share = (
            math.sqrt(share)
            if exponent == 0.5
            else share
            if exponent == 1.0
            else share**exponent
        )
        way = barrier * (1.0 - share) / (exponent * run.bonds.gain) - _stretch(
            i, run, window, 0.0
        )
        ahead = np.int64(min(max(way / run.bonds.window, 1.0), FURTHEST))
    run.rates.tree[i] = _rate_at(i, run, _stretch(i, run, window + ahead, 0.0))
    _enlist(i, window + ahead, run)


@inner
def _rebind(passed: Int, run: PullRun) -> None:
    """New bounds for the bonds of the last ``passed`` windows, up to the present one."""
    least, count = _least_barrier(_speed(run, 0.0), run), np.int64(0)
    window = run.counts[WINDOW]
    for back in range(min(passed, RING)):
        slot = (window - back) & (RING - 1)
        i = run.heads[slot]
        run.heads[slot] = NONE
        while i >= 0:
            following = run.links[i, 0]
            _bind(i, least, run)
            count = mark(run.rates, i >> 3, count)
            if count == run.rates.dirty.size:
                refresh(run.rates, count)
                count = np.int64(0)
            i = following
    if count > 0:
        refresh(run.rates, count)


@hot
def _now(run: PullRun) -> Instant:
    return run.reals[HIGH], run.reals[LOW]


# -- motion --------------------------------------------------------------------------------------------------------


@hot
def _two_sum(reals: Array, at: Int, more: Float) -> None:
    """Add to a sum that is kept as a pair."""
    reals[at], reals[at + 1] = later((reals[at], reals[at + 1]), more)


@hot
def _partner(i: Int, run: PullRun) -> Int:
    """The partner of site i at the present position of the slider."""
    if run.partners.forming.size == 0:
        return np.int64(0)
    return (run.counts[CELL] + run.partners.phase[i]) >> CELL_BITS


@hot
def _between(table: Array, u: Float) -> Float:
    """The quantile at probability u."""
    at = u * (table.size - 1)
    low = min(np.int64(at), table.size - 2)
    return table[low] + (at - low) * (table[low + 1] - table[low])


@hot
def _uniforms(i: Int, partner: Int, partners: Counterpart) -> tuple[Float, Float]:
    key = partners.key
    return random.uniform_pair(key.k0, key.k1, PARTNER, partners.pixels[i], partner)


@inner
def _forming(i: Int, partner: Int, partners: Counterpart) -> Float:
    """The barrier of site i to forming a bond with a partner, eV."""
    if partner == 0 or partners.forming.size == 0:
        return partners.own[0][i]
    u, _ = _uniforms(i, partner, partners)
    return _between(partners.forming, u) + partners.shift[0][i]


@inner
def _breaking(i: Int, partner: Int, partners: Counterpart) -> Float:
    """That to breaking it, eV."""
    if partner == 0 or partners.forming.size == 0:
        return partners.own[1][i]
    _, u = _uniforms(i, partner, partners)
    return _between(partners.breaking, u) + partners.shift[1][i]


@inner
def _renew(i: Int, partner: Int, run: PullRun) -> None:
    """Give the free site i the rate of this partner."""
    if run.partners.forming.size > 0:
        new = fixed_barrier(_forming(i, partner, run.partners))
        run.words[i] += 2 * (new - run.base[i])
        run.base[i] = new
    run.rates.tree[i] = rate(run.words[i] >> 1, run.model)


@inner
def _meet(passed: Int, run: PullRun) -> None:
    """New partners for the free sites whose edges lie in the last ``passed`` cells, up to the present one."""
    partners, rates = run.partners, run.rates
    blocks, tree, last = partners.blocks, rates.tree, run.words.size - 1
    for back in range(min(passed, CELLS)):
        cell = (run.counts[CELL] - back) & (CELLS - 1)
        partner = (run.counts[CELL] + (-cell & (CELLS - 1))) >> CELL_BITS
        count = np.int64(0)
        for at in range(partners.first[cell], partners.first[cell + 1]):
            i = partners.order[min(at + AHEAD, last)]
            prefetch(run.words, i)
            prefetch(run.base, i)
            prefetch(partners.pixels, i)
            prefetch(partners.shift[0], i)
            prefetch_leaf(tree, rates.starts[1], i)
            i = partners.order[at]
            if run.words[i] & 1 == 0:
                _renew(i, partner, run)
                if count == 0 or blocks[count - 1] != i >> 3:
                    blocks[count] = i >> 3
                    count += 1
        # as `refresh`, of many blocks in ascending order
        for level in range(rates.starts.size - 2):
            below, above, kept = (
                rates.starts[level],
                rates.starts[level + 1],
                np.int64(0),
            )
            for at in range(count):
                block = blocks[at]
                tree[above + block] = block_sum(tree, below + 8 * block)
                if kept == 0 or blocks[kept - 1] != block >> 3:
                    blocks[kept] = block >> 3
                    kept += 1
            count = kept


@hot
def _pass(distance: Float, run: PullRun) -> None:
    """Move the slider over the counter-body, where sites meet new partners."""
    reals, width = run.reals, run.partners.width
    if run.partners.forming.size == 0:
        return
    _two_sum(reals, OFFSET, distance)
    if reals[OFFSET] >= width:
        passed = np.int64(math.floor(reals[OFFSET] / width))
        _two_sum(reals, OFFSET, -passed * width)
        if reals[OFFSET] < 0.0:
            reals[OFFSET] = reals[OFFSET_LOW] = 0.0
        run.counts[CELL] += passed
        _meet(passed, run)


@hot
def _shift(distance: Float, run: PullRun) -> None:
    """Move the slider, and give new bounds to the bonds whose window it has come to."""
    reals, counts = run.reals, run.counts
    _two_sum(reals, REST, distance)
    if reals[REST] >= run.bonds.window:
        passed = np.int64(math.floor(reals[REST] / run.bonds.window))
        _two_sum(reals, REST, -passed * run.bonds.window)
        if reals[REST] < 0.0:
            reals[REST] = reals[REST_LOW] = 0.0
        counts[WINDOW] += passed
        _rebind(passed, run)


@hot
def _work(run: PullRun, span: Float) -> tuple[Float, Float, Float]:
    """Of ``span`` seconds ahead, without an event: the work of drive and friction (nN nm), and the way (nm)."""
    drive, speed = run.drive, _drive_speed(run, span)
    way = speed * _share(run) * span
    if run.counts[RESTS]:
        mean = _force(run) + 0.5 * drive.spring * speed * span
    else:
        mean = _force(run) + 0.5 * run.bonds.stiffness * run.counts[BONDS] * way
    return (
        (mean if drive.spring > 0.0 else 0.0) * speed * span,
        drive.friction * way,
        way,
    )


@hot
def _note_peak(run: PullRun) -> None:
    """Compare the force before a bond breaks with the largest one, and with that of the last slip."""
    reals, counts = run.reals, run.counts
    force = _force(run)
    if force > reals[PEAK]:
        reals[PEAK] = force
        reals[PEAK_AT] = reals[MOVED_BEFORE] + (
            counts[WINDOW] * run.bonds.window + reals[REST]
        )
        reals[PEAK_TIME] = reals[HIGH]
    if counts[FALLING] and force > reals[BOTTOM] + SLIP * reals[PEAK]:
        size = np.int64(0)
        while (counts[FALLS] >> (size + 1)) > 0:
            size += 1
        run.slip_sizes[size] += 1
        counts[SLIPS] += 1
        reals[LARGEST] = max(reals[LARGEST], reals[TOP] - reals[BOTTOM])
        counts[FALLING] = 0
        reals[TOP] = force
        counts[FALLS] = 0
    elif not counts[FALLING] and force >= reals[TOP]:
        reals[TOP] = force
        counts[FALLS] = 0


@hot
def settle(excess: Float, run: PullRun) -> None:
    """Let the slider go to where spring, bonds and friction balance, if the spring pulls by an ``excess`` (nN) more
    than they hold."""
    if excess <= 0.0 or math.isinf(run.drive.spring):
        return
    stiffness = run.drive.spring + run.counts[BONDS] * run.bonds.stiffness
    way = excess / stiffness
    _two_sum(run.reals, LOST, 0.5 * stiffness * way * way)
    _two_sum(run.reals, RUBBED, run.drive.friction * way)
    run.counts[RESTS] = 0
    _shift(way, run)
    _pass(way, run)


# -- events --------------------------------------------------------------------------------------------------------


@hot
def _break(i: Int, run: PullRun) -> None:
    counts, reals = run.counts, run.reals
    stretch = _present_stretch(i, run)
    _note_peak(run)
    _two_sum(reals, LOST, 0.5 * run.bonds.stiffness * stretch * stretch)
    after, before = run.links[i, 0], run.links[i, 1]
    if before >= 0:
        run.links[before, 0] = after
    else:
        run.heads[run.bound[i] & (RING - 1)] = after
    if after >= 0:
        run.links[after, 1] = before
    counts[SUM_WINDOWS] -= run.made[i]
    _two_sum(reals, SUM_REST, -run.rest[i])
    counts[BONDS] -= 1
    if counts[BONDS] == 0:
        reals[SUM_REST] = reals[SUM_LOW] = 0.0
    counts[BROKEN] += 1
    run.words[i] &= ~1
    _renew(i, _partner(i, run), run)
    settle(-_slack(run) if counts[RESTS] else run.bonds.stiffness * stretch, run)
    counts[FALLS] += 1
    force = _force(run)
    reals[LEAST] = min(reals[LEAST], force)
    if not counts[FALLING] and force < reals[TOP] - SLIP * reals[PEAK]:
        counts[FALLING] = 1
        reals[BOTTOM] = force
    if counts[FALLING]:
        reals[BOTTOM] = min(reals[BOTTOM], force)


@hot
def _change(i: Int, run: PullRun) -> None:
    """Form or break the bond of site i; new rates of its neighbours."""
    model = run.model
    bonded = run.words[i] & 1
    # first the energies: a slider that jumps gives new bounds to other bonds
    sign = -2 if bonded else 2
    for s in range(degree(model)):
        j = neighbour(i, s, model)
        if j >= 0:
            run.words[j] += sign * fixed_coupling(model.coupling[i, s])
    if bonded:
        _break(i, run)
    else:
        counts, reals = run.counts, run.reals
        run.made[i] = counts[WINDOW]
        run.rest[i] = reals[REST]
        counts[SUM_WINDOWS] += counts[WINDOW]
        _two_sum(reals, SUM_REST, reals[REST])
        counts[BONDS] += 1
        counts[FORMED] += 1
        run.words[i] |= 1
        run.partner[i] = _partner(i, run)
        if run.partners.forming.size > 0:
            breaking = _breaking(i, run.partner[i], run.partners)
            model.breaking[i] = breaking
            run.bonds.barrier[i] = max(breaking, 0.0) / run.bonds.thermal
        _bind(i, _least_barrier(_speed(run, 0.0), run), run)
    count = mark(run.rates, i >> 3, np.int64(0))
    for s in range(degree(model)):
        j = neighbour(i, s, model)
        if j >= 0 and run.words[j] & 1 == 0:
            run.rates.tree[j] = rate(run.words[j] >> 1, model)
            count = mark(run.rates, j >> 3, count)
    refresh(run.rates, count)


@inner
def _sample(run: PullRun, span: Float, hold: Int) -> None:
    """What is seen ``span`` seconds ahead, before the next event."""
    reals, counts, bonds, drive = run.reals, run.counts, run.bonds, run.drive
    work, rubbed, way = _work(run, span)
    force = _force(run)
    if counts[RESTS]:
        pulled = drive.spring * _drive_speed(run, span) * span
        force += min(pulled, max(_slack(run), 0.0))
    else:
        force += bonds.stiffness * counts[BONDS] * way
    if math.isinf(drive.spring) or drive.spring > 0.0:
        stored = (
            0.0 if math.isinf(drive.spring) else 0.5 * force * force / drive.spring
        )
    else:
        force = stored = 0.0
    for i in range(run.words.size):
        if run.words[i] & 1:
            stretch = _present_stretch(i, run) + way
            stored += 0.5 * bonds.stiffness * stretch * stretch
    out = run.samples[hold]
    out[MOVED] = reals[MOVED_BEFORE] + (
        counts[WINDOW] * bonds.window + reals[REST] + way
    )
    out[FORCE] = force
    out[WORKED] = reals[WORK] + (reals[WORK_LOW] + work)
    out[DISSIPATED] = reals[LOST] + reals[LOST_LOW]
    out[STORED] = stored
    out[FRICTION] = reals[RUBBED] + (reals[RUBBED_LOW] + rubbed)
    run.tallies[hold, 0] = counts[BONDS]
    run.tallies[hold, 1] = counts[FORMED]
    run.tallies[hold, 2] = counts[BROKEN]


@jit
def present_barriers(
    cell: Int,
    partners: Counterpart,
    state: Array,
    partner: Array,
    forming: Array,
    breaking: Array,
    base: Array,
) -> None:
    """Fill the barriers (eV) of all sites, forming with the present partner of this cell and breaking with that of the
    bond; the former in fixed point; and of sites without a bond the ``partner``."""
    for i in range(state.size):
        now = np.int64(0)
        if partners.forming.size > 0:
            now = (cell + partners.phase[i]) >> CELL_BITS
        if not state[i]:
            partner[i] = now
        forming[i] = _forming(i, now, partners)
        breaking[i] = _breaking(i, partner[i], partners)
        base[i] = fixed_barrier(forming[i])


@jit
def start(run: PullRun, goes_on: bool) -> None:
    """Give every bond its bound, that of before where a pull goes on, and let the slider settle."""
    run = borrowed(run)
    _pass(0.0, run)
    least = _least_barrier(_speed(run, 0.0), run)
    for i in range(run.words.size):
        if run.words[i] & 1:
            if goes_on:
                run.rates.tree[i] = _rate_at(
                    i, run, _stretch(i, run, run.bound[i], 0.0)
                )
                _enlist(i, run.bound[i], run)
            else:
                _bind(i, least, run)
    sum_leaves(run.words.size, run.rates)
    if run.counts[RESTS]:
        settle(-_slack(run), run)
    if not goes_on:
        run.reals[LEAST] = _force(run)


@jit
def ended(run: PullRun, rest: Array, out: Array) -> None:
    """Fill the stretch of every bond, and where in its cell the slider is (2,), at the last time."""
    _, _, way = _work(run, until(_now(run), run.times[run.times.size - 1]))
    rest[0], rest[1] = run.reals[OFFSET], run.reals[OFFSET_LOW]
    if run.partners.forming.size > 0:
        _two_sum(rest, 0, way)
    for i in range(out.size):
        if run.words[i] & 1:
            out[i] = _present_stretch(i, run) + way


@hot
def _draw(run: PullRun) -> None:
    """The random numbers of the next event: how long it is waited for, and what it is."""
    u, run.reals[CHOICE] = random.uniform_pair(
        run.key.k0, run.key.k1, STREAM, run.counts[EVENT], 0
    )
    run.reals[LEFT] = -math.log(u)


@hot
def _takes_place(i: Int, v: Float, run: PullRun, ramp: RampBounds | None) -> bool:
    """Whether an event of site i that the bounds give does, by a uniform number ``v``: its present rate is lower where
    conditions change, and that of a bond before the end of its window."""
    now = _now(run)
    if run.words[i] & 1 == 0:
        if ramp is None:
            return True
        return v < over_bound(i, run.words[i], now, ramp, run.model)
    stretch = max(_present_stretch(i, run), 0.0)
    barrier, gain = run.bonds.barrier[i], run.bonds.gain
    if ramp is not None:
        part, heat = progress(now, ramp)
        if ramp.breaking.shape[1] > 0:
            energy = run.model.breaking[i] + above(ramp.breaking, i, part)
            barrier = max(energy, 0.0) * (run.model.per_unit * UNITS_PER_EV)
        barrier, gain = barrier / heat, gain / heat
    present = under_force(barrier, stretch * gain, run.bonds.exponent, run.model.nu)
    return v * run.rates.tree[i] < present


@jit
def advance(run: PullRun, ramp: RampBounds | None, events: Int) -> None:
    """Go on for about ``events`` events, or to the last time (then ``counts[DONE]`` is 1).

    The state is that of the last event; it is followed to a time only to be sampled, so that what is sampled changes
    nothing.
    """
    run = borrowed(run)
    reals, counts, times = run.reals, run.counts, run.times
    if counts[FIRST]:
        counts[FIRST] = 0
        _draw(run)
    while events > 0:
        events -= 1
        total, share = tree_total(run.rates), _share(run)
        speed, rise = _drive_speed(run, 0.0), run.drive.rise
        step, event = (reals[LEFT] / total if total > 0.0 else np.inf), 0
        edge, ahead = np.inf, RING
        if counts[BONDS] > 0 and share > 0.0 and (speed > 0.0 or rise > 0.0):
            # the next window for which bonds are listed
            ahead = np.int64(1)
            while (
                ahead < RING
                and run.heads[(counts[WINDOW] + ahead) & (RING - 1)] < 0
            ):
                ahead += 1
            way = ahead * run.bonds.window - reals[REST] - reals[REST_LOW]
            edge = _arrives(max(way, 0.0), speed * share, rise * share)
        if edge < step:
            step, event = edge, 1
        cells = np.int64(0)
        if (
            run.partners.forming.size > 0
            and share > 0.0
            and (speed > 0.0 or rise > 0.0)
        ):
            cells = run.partners.ahead[counts[CELL] & (CELLS - 1)]
            way = cells * run.partners.width - reals[OFFSET] - reals[OFFSET_LOW]
            met = _arrives(max(way, 0.0), speed * share, rise * share)
            if met < step:
                step, event = met, 3
        if counts[RESTS] and run.drive.spring > 0.0:
            spring = run.drive.spring
            free = _arrives(max(_slack(run), 0.0), spring * speed, spring * rise)
            if free < step:
                step, event = free, 2
        then = later(_now(run), step)
        while counts[HOLD] < times.size and past(then, times[counts[HOLD]]):
            _sample(run, until(_now(run), times[counts[HOLD]]), counts[HOLD])
            counts[HOLD] += 1
        if counts[HOLD] == times.size:
            counts[DONE] = 1
            return
        work, rubbed, way = _work(run, step)
        pulled = run.drive.spring * _drive_speed(run, step) * step
        _two_sum(reals, WORK, work)
        _two_sum(reals, RUBBED, rubbed)
        reals[HIGH], reals[LOW] = then
        if event != 0:
            reals[LEFT] = max(reals[LEFT] - total * step, 0.0)
            # exactly to the beginning of the window or cell, whatever the way was rounded to
            if event == 1:
                reals[REST] = reals[REST_LOW] = 0.0
                counts[WINDOW] += ahead
                _rebind(ahead, run)
                _pass(way, run)
            elif event == 2:
                counts[RESTS] = 0
            else:
                _shift(way, run)
                reals[OFFSET] = reals[OFFSET_LOW] = 0.0
                counts[CELL] += cells
                _meet(cells, run)
                at = counts[CELL] & (CELLS - 1)
                events -= (run.partners.first[at + 1] - run.partners.first[at]) >> 3
            continue
        if counts[RESTS]:
            _two_sum(reals, PULL, pulled)
        _shift(way, run)
        _pass(way, run)
        i = select(run.rates, reals[CHOICE] * tree_total(run.rates), 0.0)
        v, _ = random.uniform_pair(run.key.k0, run.key.k1, STREAM, counts[EVENT], 1)
        accepted = _takes_place(i, v, run, ramp)
        counts[EVENT] += 1
        _draw(run)
        if accepted:
            _change(i, run)
