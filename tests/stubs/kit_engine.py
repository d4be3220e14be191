"""The direct method in its simplest form, and the ways in which it can be wrong."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, ClassVar

import numpy as np

from chemage.plugin import KB, BondHistory, Engine, kernel, random


class Fault(IntEnum):
    """What a wrong engine does."""

    NONE = 0
    #: rates of 300 K at every temperature
    TEMPERATURE = 1
    #: an attempt frequency of 1e13 Hz on every lattice
    FREQUENCY = 2
    #: a bonded neighbour lowers the barrier that it should raise
    SIGN = 3
    #: each bond counted twice, from both ends
    TWICE = 4
    #: stops at the first empty slot
    FIRST_EMPTY = 5
    #: takes -1 for the last site, as numpy does
    LAST_SITE = 6
    #: the total rate is kept up by adding and subtracting
    SUBTRACT = 7
    #: the state at a hold time includes the event after it
    AFTER = 8
    #: barriers below zero are taken as they are
    NO_CAP = 9
    #: neighbours change the breaking barrier too
    BREAKING_COUPLED = 10
    #: bonds break over the barrier over which they form
    ONE_BARRIER = 11
    #: waiting times with log10 in place of ln
    LOG10 = 12
    #: the mean waiting time in place of a random one
    MEAN_TIME = 13
    #: every site that can react is as likely as the next
    ANY_SITE = 14
    #: only the first bonded neighbour counts
    ONE_NEIGHBOUR = 15
    #: barriers looked up by pixel
    BY_PIXEL = 16
    #: a barrier is reset to 0 before it is lowered further
    CAP_FIRST = 17
    #: rates of neighbours not updated where a bond breaks
    STALE = 18
    #: half the rate, as if every second attempt went back
    HALF = 19
    #: the clock starts at zero in a run that goes on
    CLOCK = 20
    #: the random numbers of the seed are used again in a run that goes on
    REUSE = 21
    #: the numbers of events start at zero in a run that goes on
    RECOUNT = 22
    #: a run that goes on does so at the temperature that it began with
    OLD_TEMPERATURE = 23
    #: begins with no bond whatever the start
    NO_START = 24
    #: changes the array of bonds that it was given
    OVERWRITE = 25
    #: time in single precision
    SINGLE_TIME = 26
    #: attempts at the present rate are accepted by the largest one since the site's own last event
    BOUND = 27


@kernel
def _rate(fault, i, forming, breaking, neighbours, coupling, pixels, nu, beta, bonded):
    at = min(pixels[i], forming.size - 1) if fault == 16 else i
    barrier = breaking[at] if bonded[i] else forming[at]
    if fault == 11 and bonded[i] and np.isfinite(breaking[at]):
        barrier = forming[at]
    if fault == 17:
        barrier = max(barrier, 0.0)
    if not bonded[i] or fault == 10:
        for slot in range(neighbours.shape[1]):
            j = neighbours[i, slot]
            if j < 0 and fault == 5:
                break
            if j < 0 and fault == 6:
                j = forming.size - 1
                if bonded[j]:
                    barrier += 0.05
                continue
            if j >= 0 and bonded[j]:
                barrier += coupling[i, slot] * (-1.0 if fault == 3 else 2.0 if fault == 4 else 1.0)
                if fault == 15:
                    break
    if fault != 9:
        barrier = max(barrier, 0.0)
    rate = nu * np.exp(-barrier * beta)
    return 0.5 * rate if fault == 19 else rate


@kernel
def _advance(fault, rng, forming, breaking, neighbours, coupling, pixels, nu, beta, stops, bonded, time, counts):
    n = forming.size
    rates = np.zeros(n)
    bounds = np.zeros(n)
    due = -1.0
    total = 0.0
    first = True
    changed = -1
    for at in range(stops.size):
        while n > 0:
            if due < 0.0:
                if fault != 7 or first:
                    total = 0.0
                for i in range(n):
                    if fault == 18 and not first and i != changed:
                        touched = False
                        for slot in range(neighbours.shape[1]):
                            if neighbours[i, slot] == changed and bonded[changed]:
                                touched = True
                        if not touched:
                            total += rates[i]
                            continue
                    before = rates[i]
                    rates[i] = _rate(fault, i, forming, breaking, neighbours, coupling, pixels, nu, beta, bonded)
                    if fault == 27:
                        bounds[i] = rates[i] if i == changed else max(bounds[i], rates[i])
                        if rates[i] > 0.0:
                            rates[i] *= rates[i] / bounds[i]
                    if fault == 7 and not first:
                        total += rates[i] - before
                    else:
                        total += rates[i]
                first = False
                wait = 1.0 if fault == 13 else rng.standard_exponential()
                if fault == 12:
                    wait = wait / np.log(10.0)
                due = time + wait / total if total > 0.0 else np.inf
                if fault == 26:
                    due = float(np.float32(due))
            if due > stops[at] and not (fault == 8 and due < np.inf):
                break
            crossing = due > stops[at]
            time, due = due, -1.0
            site = n - 1
            if fault == 14:
                site = int(rng.random() * n)
                while rates[site] == 0.0:
                    site = int(rng.random() * n)
            else:
                left = rng.random() * total
                for i in range(n):
                    if rates[i] > 0.0:
                        site = i
                        left -= rates[i]
                        if left < 0.0:
                            break
            bonded[site] = not bonded[site]
            changed = site
            counts[at, 1 if bonded[site] else 2] += 1
            if crossing:
                break
        counts[at, 0] = np.sum(bonded)


class Plain(Engine):
    """Selects each event from the sum of all rates."""

    kind = "plain"
    restart = False
    fault: ClassVar[int] = Fault.NONE

    def _run(self, lattice: Any, hold_times: Any, temperature: Any, seed: Any, start: Any) -> BondHistory:
        n, fault = lattice.sites.size, self.fault
        bonded, time, before = np.zeros(n, dtype=bool), 0.0, np.zeros(2, dtype=np.int64)
        used = temperature
        if isinstance(start, BondHistory):
            bonded, time = np.array(start.state), start.time
            before[:] = start.formed[-1], start.broken[-1]
            used = start.temperature if fault == Fault.OLD_TEMPERATURE else temperature
            if fault == Fault.RECOUNT:
                before[:] = np.count_nonzero(bonded), 0
        elif start is not None:
            bonded = start if fault == Fault.OVERWRITE else np.array(start)
        if fault == Fault.NO_START:
            bonded = np.zeros(n, dtype=bool)
        if fault == Fault.CLOCK:
            time = 0.0
        counts = np.zeros((hold_times.size, 3), dtype=np.int64)
        none = lattice.neighbours is None
        words = np.float64(0.0 if fault == Fault.REUSE else time).view(np.uint64)
        _advance(
            int(fault),
            np.random.default_rng([*random.key(seed), words]),
            np.array(lattice.forming),
            np.full(n, np.inf) if lattice.breaking is None else np.array(lattice.breaking),
            np.zeros((n, 0), dtype=np.int32) if none else np.array(lattice.neighbours),
            np.zeros((n, 0)) if none else lattice.coupling.astype(np.float64),
            np.array(lattice.sites),
            1e13 if fault == Fault.FREQUENCY else lattice.attempt_frequency,
            1 / (KB * (300.0 if fault == Fault.TEMPERATURE else used)),
            hold_times,
            bonded,
            time,
            counts,
        )
        formed, broken = before[0] + np.cumsum(counts[:, 1]), before[1] + np.cumsum(counts[:, 2])
        return BondHistory(
            hold_times=hold_times,
            bonds=counts[:, 0],
            formed=formed,
            broken=broken,
            state=np.array(bonded),
            time=float(hold_times[-1]),
            temperature=temperature,
            engine=self.kind,
            lattice_hash=lattice.digest(),
        )
