"""The gate of performance: CPU time of a contact and of a kinetic run, over that of a reference load in the same run.

Seconds of one machine mean nothing on another, and on a shared machine not even tomorrow. So each subject is measured
in turns with a load of numpy and scipy that resembles it (Fourier transforms; sorting and gathering), the least CPU
time of each counts, and their ratio is compared with the ratio stored in ``gate.json``. Exit status 1 where a ratio is
above ``LIMIT`` times the stored one.

    python tests/benchmarks/gate.py            # compare
    python tests/benchmarks/gate.py --store    # store the ratios of this run as the baseline
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import fft

import chemage as ca

BASELINE = Path(__file__).with_name("gate.json")
LIMIT = 1.6
TURNS = 7


def contact() -> Callable[[], object]:
    """Two solves on 512 x 512 pixels, at small and large contact."""
    surface = ca.surface("self-affine", pixels=512, pixel_size=0.4518, rms_slope=0.1, hurst=0.8, zeta=128, eta=3).make(
        seed=1
    )
    solver = ca.contact("fft-bem", modulus=35.3, threads=1)
    return lambda: [solver.solve(surface, mean * surface.nominal_area) for mean in (0.016, 0.4)]


def transforms() -> Callable[[], object]:
    """Pairs of real Fourier transforms of 512 x 512 numbers."""
    field = np.random.default_rng(0).normal(size=(512, 512))
    return lambda: [fft.irfft2(fft.rfft2(field, workers=1), workers=1) for _ in range(20)]


def kinetics() -> Callable[[], object]:
    """Four replicas on a fully covered patch of 256 x 256 interacting sites, to 10⁴ s."""
    chemistry = ca.chemistry(
        forming=ca.barriers("uniform", lower="0.8 eV", upper="1.4 eV"),
        breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
        interaction=ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1),
    )
    full = ca.ContactSolution(pressure=np.ones((256, 256)), load=256**2 * 0.2, pixel_size=0.4518, modulus=35.3)
    lattice = chemistry.on(full, seed=1)
    times = ca.hold_times("1 ms", "1e4 s", per_decade=1)
    engine = ca.engine("rejection-free")
    return lambda: [engine.run(lattice, times, temperature=300.0, seed=seed) for seed in range(4)]


def gathers() -> Callable[[], object]:
    """Sorting and gathering in memory larger than the caches."""
    values = np.random.default_rng(0).random(500_000)
    return lambda: [values[np.argsort(values)].cumsum() for _ in range(4)]


SUBJECTS = {"contact": (contact, transforms), "kinetics": (kinetics, gathers)}


def cpu(task: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    begin = time.process_time()
    task()
    return time.process_time() - begin


def ratios() -> dict[str, float]:
    """Least CPU time of each subject over that of its reference load."""
    found = {}
    for name, makers in SUBJECTS.items():
        subject, reference = (make() for make in makers)
        subject()  # compiles
        reference()
        turns = [(cpu(subject), cpu(reference)) for _ in range(TURNS)]
        best = [min(column) for column in zip(*turns, strict=True)]
        found[name] = best[0] / best[1]
        print(f"{name}: {best[0]:.3f} s, reference {best[1]:.3f} s, ratio {found[name]:.2f}")
    return found


def main() -> int:
    """Compare, or store; the exit status."""
    found = ratios()
    if "--store" in sys.argv:
        BASELINE.write_text(json.dumps({name: round(value, 3) for name, value in found.items()}, indent=1) + "\n")
        return 0
    stored = json.loads(BASELINE.read_text())
    slower = {name: value / stored[name] for name, value in found.items() if value > LIMIT * stored[name]}
    for name, factor in slower.items():
        print(f"{name} takes {factor:.2f} times the stored ratio; the limit is {LIMIT}", file=sys.stderr)
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
