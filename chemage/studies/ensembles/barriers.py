"""The error of the barriers in a mean over surfaces: members of their distribution, aged on one of the contacts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from chemage.ageing.members import BARRIERS
from chemage.scene.run import run
from chemage.studies.ensembles.computations import Computation
from chemage.studies.ensembles.quantities import Quantities

#: how the error is known
HOW = "measured here on one surface: {}"


def barriers_error(
    computation: Computation,
    seeds: tuple[int, int],
    quantities: Quantities,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[np.ndarray, str]:
    """(quantities,) relative standard errors that the forming barriers make, and how they are known; zeros and "" where
    their distribution has no members.

    The error is relative and the same for all surfaces, so that one of them, with ``seeds`` of surface and hold, is
    enough; more surfaces do not make it smaller.
    """
    found, scene = np.zeros(quantities.count), computation.scene
    if scene.chemistry is None or scene.hold is None or not scene.ages or not scene.chemistry.forming.members(1):
        return found, ""
    hold = scene.hold.model_copy(update={"seed": seeds[1]})
    scene = scene.model_copy(update={"surface_seed": seeds[0], "hold": hold})

    def report(stage: str, done: int, total: int, note: str = "") -> None:
        if stage == BARRIERS and progress is not None and total:
            progress(done, total)

    aging = run(scene, threads=threads, warn=False, progress=report).aging
    assert aging is not None
    assert aging.member_ratios is not None
    drops = aging.member_ratios * aging.mean_friction_drop
    first = int(quantities.has_beta)
    found[first : first + quantities.hold_times.size] = aging.errors[BARRIERS]
    if quantities.has_beta:
        own = float(quantities.slope(aging.mean_friction_drop[None])[0])
        slopes = quantities.slope(drops)
        found[0] = slopes.std(ddof=1) / abs(own) if own else np.nan
    return found, HOW.format(aging.error_sources[BARRIERS])
