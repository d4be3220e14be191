"""How near is the plan of an ensemble (``chemage check``) to what it takes?

    python tests/benchmarks/ensemble_estimates.py [ACCURACY]         # of β, 5 % if it is not given
    python tests/benchmarks/ensemble_estimates.py --differences      # the scatter of what corrects a coarse grid

For every bundled scene with a random surface, and for ten unseen ones, β is asked for. Printed are the surfaces, CPU
seconds and largest memory, each as estimated / measured with their ratio; "OUTSIDE" marks a ratio beyond a factor 2.
Memory is that of the process, whose libraries and kernels are loaded before.

With ``--differences``, β is computed on the own and on the coarsest grid of scenes 0 to 27, six surfaces of each with
ten replicas: the standard deviation of the relative difference between surfaces is ``DIFFERENCE`` of
``chemage.studies.ensembles.computations``.
"""

from __future__ import annotations

import sys
import time
import warnings

import numpy as np
from estimates import peak, warm_up
from unseen_scenes import unseen

import chemage as ca
from chemage.studies.ensembles.computations import DIFFERENCE_REPLICAS, computations, seed_of
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.planning import plan
from chemage.studies.ensembles.quantities import Quantities

BUNDLED = ("silica-patch", "silica-rough")
UNSEEN = range(1000, 1010)
TUNED = range(28)
#: of each scene, for the differences
SURFACES = 6


def compared(name: str, estimated: float | None, measured: float) -> str:
    """One quantity as estimated / measured, with the ratio."""
    if estimated is None:
        return f"{name} not foreseen / {measured:.3g}"
    ratio = estimated / measured
    return f"{name} {estimated:8.3g} / {measured:8.3g} = {ratio:4.2f}" + (" " * 8 if 0.5 <= ratio <= 2 else " OUTSIDE")


def measure(scene: ca.Scene, accuracy: float) -> str:
    """What is foreseen of one scene, and what it takes."""
    asked = with_request(scene.completed(), accuracy={"beta": accuracy})
    foreseen = plan(asked)
    peak()
    begin = time.process_time()
    made = ca.ensemble(asked)
    used, memory = time.process_time() - begin, peak()
    levels = " + ".join(str(level["samples"]) for level in made.levels)
    parts = (
        compared("surfaces", foreseen.expected, made.surfaces),
        compared("CPU s", foreseen.cpu_seconds, used),
        compared("GB", None if foreseen.memory is None else foreseen.memory / 1e9, memory / 1e9),
    )
    return f"{scene.name:14s} {'  '.join(parts)}  levels {levels}"


def difference(number: int) -> tuple[float, float] | None:
    """Mean and standard deviation over surfaces of the relative difference of β between grids, with ten replicas."""
    scene = unseen(number).completed()
    with scene.in_use():
        found = computations(scene)
        if len(found) == 1:
            return None
        quantities = Quantities.of(scene, ())
        assert scene.hold is not None
        betas = []
        for k in range(SURFACES):
            seeds = seed_of(scene.surface_seed, 1, k, 0), seed_of(scene.hold.seed, 1, k, 1)
            pair = [one.with_replicas(DIFFERENCE_REPLICAS).compute(*seeds) for one in (found[-1], found[0])]
            betas.append([float(quantities.row(sample)[0]) for sample in pair])
    fine, coarse = np.array(betas).T
    relative = (fine - coarse) / fine.mean()
    return float(relative.mean()), float(relative.std(ddof=1))


def main() -> None:
    warnings.simplefilter("ignore", ca.PlanWarning)
    warm_up()
    if "--differences" in sys.argv:
        found = []
        for number in TUNED:
            if (one := difference(number)) is not None:
                found.append(one[1])
                print(f"scene {number}: {100 * one[0]:+.2f} %, standard deviation {100 * one[1]:.2f} %", flush=True)
        print(f"standard deviation: rms over scenes {100 * np.sqrt(np.mean(np.square(found))):.2f} %")
        return
    accuracy = float(sys.argv[1]) if len(sys.argv) > 1 else 0.05
    for scene in (*map(ca.load_scene, BUNDLED), *map(unseen, UNSEEN)):
        print(measure(scene, accuracy), flush=True)


if __name__ == "__main__":
    main()
