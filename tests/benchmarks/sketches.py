"""How much the area of the contact of a sketch says of β: correlations between surfaces, and what they cost.

    python tests/benchmarks/sketches.py [first last]      # scenes 0 to 27 of unseen_scenes.py, ten minutes

For each scene with a sketch, β of one replica on the coarsest grid and the area of the contact of the sketch on 24
surfaces. The correlation is that with what β has in common on a surface: the variance between replicas, from three
on each surface, is taken off. The median is ``CORRELATION`` of ``chemage.studies.ensembles.planning``.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from unseen_scenes import unseen

from chemage.studies.ensembles.computations import computations, sketched
from chemage.studies.ensembles.goals import Request, with_request

SURFACES, REPLICAS = 24, 3


def measured(number: int) -> tuple[float, float, float, float] | None:
    """Correlation of β with the area of a sketch, with that of its own grid, and CPU seconds of sketch and sample."""
    scene = unseen(number)
    quantities = Request.of(with_request(scene, accuracy={"beta": 0.02})).quantities
    coarse = computations(scene.completed())[0]
    sketch = sketched(coarse)
    if sketch is None:
        return None
    betas, within, areas, own, seconds = [], [], [], [], np.zeros(2)
    for seed in range(700, 700 + SURFACES):
        begin = time.process_time()
        areas.append(sketch.compute(seed, seed).measures["area_fraction"])
        middle = time.process_time()
        one = coarse.with_replicas(REPLICAS).compute(seed, seed)
        seconds += [middle - begin, time.process_time() - middle]
        rows = quantities.replica_rows(one)[:, 0]
        betas.append(rows.mean())
        within.append(rows.var(ddof=1) / REPLICAS)
        own.append(one.measures["area_fraction"])
    kept = np.sqrt(max(1e-12, 1 - np.mean(within) / np.var(betas, ddof=1)))
    of_sketch, of_own = (min(1.0, float(np.corrcoef(betas, one)[0, 1] / kept)) for one in (areas, own))
    return of_sketch, of_own, *(seconds / SURFACES).tolist()


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, 27)
    found = []
    for number in range(first, last + 1):
        if (one := measured(number)) is None:
            print(f"scene {number}: no sketch that pays", flush=True)
            continue
        found.append(one[0])
        print(
            f"scene {number}: correlation {one[0]:.3f} (own grid {one[1]:.3f}), {one[2]:.3f} of {one[3]:.3f} CPU s",
            flush=True,
        )
    print(f"correlation: median {np.median(found):.3f}, {min(found):.3f} to {max(found):.3f}, {len(found)} scenes")


if __name__ == "__main__":
    main()
