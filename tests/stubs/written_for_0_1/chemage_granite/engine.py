"""Gillespie's direct method, as short as it can be: exact, and slow on many sites."""

import numpy as np
from ase.units import kB
from chemage.objects import BondHistory
from chemage.spec import Engine


def _advance(rng, forming, breaking, neighbours, coupling, nu, beta, stops, bonded, time, counts):
    n = forming.size
    rates = np.zeros(n)
    due = -1.0  # when the pending event happens; drawn once, kept across hold times
    total = 0.0
    for at in range(stops.size):
        while n > 0:
            if due < 0.0:
                total = 0.0
                for i in range(n):
                    barrier = breaking[i] if bonded[i] else forming[i]
                    if not bonded[i]:
                        for slot in range(neighbours.shape[1]):
                            if neighbours[i, slot] >= 0 and bonded[neighbours[i, slot]]:
                                barrier += coupling[i, slot]
                    rates[i] = nu * np.exp(-max(barrier, 0.0) * beta)
                    total += rates[i]
                due = time + rng.standard_exponential() / total if total > 0.0 else np.inf
            if due > stops[at]:
                break
            time, due = due, -1.0
            left, site = rng.random() * total, n - 1
            for i in range(n):
                if rates[i] > 0.0:
                    site = i  # the last that can happen, should rounding leave a remainder
                    left -= rates[i]
                    if left < 0.0:
                        break
            bonded[site] = not bonded[site]
            counts[at, 1 if bonded[site] else 2] += 1
        counts[at, 0] = np.sum(bonded)


class GraniteEngine(Engine):
    """Draws the next event from all rates, summed anew each time. Gillespie, J. Comput. Phys. 22, 403 (1976)."""

    kind = "granite-engine"
    #: the pending event is not kept beyond a run, so going on is exact in distribution but not bit for bit
    restart = False

    def _run(self, lattice, hold_times, temperature, seed, start):
        n = lattice.sites.size
        bonded, time, before = np.zeros(n, dtype=bool), 0.0, np.zeros(2, dtype=np.int64)
        if isinstance(start, BondHistory):
            bonded, time = np.array(start.state), start.time
            before[:] = start.formed[-1], start.broken[-1]
        elif start is not None:
            bonded = np.array(start)
        counts = np.zeros((hold_times.size, 3), dtype=np.int64)
        none = lattice.neighbours is None
        _advance(
            np.random.default_rng(seed),
            lattice.forming,
            np.full(n, np.inf) if lattice.breaking is None else lattice.breaking,
            np.zeros((n, 0), dtype=np.int32) if none else lattice.neighbours,
            np.zeros((n, 0)) if none else lattice.coupling.astype(np.float64),
            lattice.attempt_frequency,
            1 / (kB * temperature),
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
            state=bonded,
            time=float(hold_times[-1]),
            temperature=temperature,
            engine=self.kind,
            lattice_hash=lattice.digest(),
        )
