"""Errors beside the scatter of the replicas: other distributions of barriers that the same data allow, aged on the same
contact; and what errors of the bonds make of β."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from chemage.ageing.age import age
from chemage.ageing.aging import Aging, fit_or_reason
from chemage.ageing.fitting import line_slopes, line_weights
from chemage.ageing.kinetics import EVERY_SITE
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.errors import InputError
from chemage.foundation.threads import available, in_order
from chemage.lattices.chemistry import Chemistry

#: name of the error
BARRIERS = "barriers"
#: members that are aged, sites over all replicas of each, and most replicas
MEMBERS, SITES, MOST = 8, 2000, 40


def with_members(
    aging: Aging,
    contact: ContactSolution | ContactStatistics,
    chemistry: Chemistry,
    *,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    **how: Any,
) -> Aging:
    """``aging`` with the error that its distribution of forming barriers has, where its members are known.

    The distribution and :data:`MEMBERS` of its members are aged with the same disorder and kinetic noise. Each has as
    many replicas as are needed for :data:`SITES` sites, :data:`MOST` at most. The rupture law takes no part: the error
    is that of the mean number of bonds. ``how`` are the other arguments of :func:`chemage.age`.
    """
    members = list(chemistry.forming.members(MEMBERS))
    if not members:
        return aging
    method, sites = how.get("method") or EVERY_SITE, max(float(aging.sites.mean()), 1.0)
    replicas = int(np.clip(np.ceil(SITES / sites), 1, MOST))
    how |= {"replicas": replicas, "common": "all", "rupture": None, "observe": (), "threads": 1}
    how.pop("checkpoints", None)
    every = [chemistry.forming, *members]

    def aged(number: int) -> np.ndarray:
        return age(contact, chemistry.replace(forming=every[number]), **how).bonds.mean(axis=0, dtype=np.float64)

    own, *others = in_order(aged, len(every), threads or available(), progress)
    ratios = np.stack([np.divide(bonds, own, out=np.full(own.shape, np.nan), where=own > 0) for bonds in others])
    count = f"{replicas} replica{'s' if replicas > 1 else ''} each" if method.replicates else "each once"
    source = f"scatter of {len(others)} members of the distribution of barriers, {count}, same random numbers"
    return aging.model_copy(
        update={
            "errors": {**aging.errors, BARRIERS: ratios.std(axis=0, ddof=1)},
            "error_sources": {**aging.error_sources, BARRIERS: source},
            "member_ratios": ratios,
        }
    )


def barriers_error(aging: Aging | None, window: tuple[float, float]) -> float | None:
    """Relative standard error of β over ``window`` (s) that is due to the barriers; None where it is not known."""
    if aging is None or aging.member_ratios is None:
        return None
    try:
        own = aging.fit(*window).beta
    except InputError:
        return None
    drops = aging.member_ratios * aging.mean_friction_coefficient_drop
    slopes = line_slopes(aging.hold_times, drops, window)
    return float(slopes.std(ddof=1) / abs(own)) if np.isfinite(slopes).all() and own != 0 else None


def beta_errors(aging: Aging | None, window: tuple[float, float]) -> dict[str, float]:
    """Relative standard errors of β over ``window`` (s) that follow from :attr:`Aging.errors` of a mean without
    replicas, by name; of a mean over replicas, whose scatter gives an error of β, none.

    Errors of the bonds at different hold times may have any signs, also opposite ones early and late, so that their
    parts in the slope are added up by magnitude.
    """
    if aging is None or aging.replicas > 1:
        return {}
    fit, _ = fit_or_reason(aging, window)
    if fit is None or fit.beta == 0:
        return {}
    use, weights = line_weights(aging.hold_times, window)
    parts = np.abs(weights) * aging.mean_friction_coefficient_drop[use]
    return {
        name: float(np.sum(parts * error[use]) / abs(fit.beta))
        for name, error in aging.errors.items()
        if name != BARRIERS
    }
