"""Variants of a scene that answer the same question: on other surfaces of the same kind, and on other grids, from whose
contacts that of vanishing pixels is extrapolated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage.contacts.role import ContactTheory
from chemage.contacts.solution import ContactSolution
from chemage.foundation.records import content_hash
from chemage.scene.scene import Scene

#: Order in the pixel size of the error of the corrected area: what the correction leaves of the excess at the contour,
#: whose pixels are a fixed part of all pixels. ``tests/benchmarks/grid_errors.py`` measures it.
ORDER = 1


def is_random(scene: Scene) -> bool:
    """Whether another seed gives another surface, as far as its maker says."""
    scatter = scene.surface.scatter({})
    return scatter is None or scatter.relative != 0


def coarser(scene: Scene, factor: int) -> Scene | None:
    """``scene`` with the contact on pixels ``factor`` times larger and the sites where they are; None where its surface
    has no coarser grid. Sites that are pixels get the density of the scene's own pixels."""
    if isinstance(scene.contact, ContactTheory):
        return None
    expected = scene.surface.expected()
    maker = scene.surface.coarser(factor)
    if maker is None or "pixel_size" not in expected:
        return None
    update: dict[str, Any] = {"surface": maker}
    if scene.chemistry is not None and scene.chemistry.site_density == "pixel":
        update["chemistry"] = scene.chemistry.replace(site_density=expected["pixel_size"] ** -2)
    return scene.model_copy(update=update)


def question(scene: Scene) -> str:
    """Content hash of what a scene asks but for seeds, replicas, goals and observables, which change neither costs per
    replica nor errors of its settings."""
    update: dict[str, Any] = {"surface_seed": 0, "observe": (), "ensemble": None, "accuracy": {}}
    if scene.hold is not None:
        update["hold"] = scene.hold.model_copy(update={"replicas": 1, "seed": 0, "common": "all"})
    return content_hash(scene.model_copy(update=update).keys()["result"])


@dataclass(frozen=True)
class Limit:
    """The corrected area in the limit of vanishing pixels."""

    #: nm²
    area: float
    #: standard error, nm²
    area_stderr: float


def vanishing_pixels(contacts: Sequence[ContactSolution]) -> Limit | None:
    """Extrapolate the corrected area of contacts of one surface on two or more grids to vanishing pixels (Richardson).

    The line through area against pixel size (order 1) is fitted by least squares. The area on each grid is uncertain by
    the pixels along the contour, of length C, each of which is in contact or not: their share that belongs to the
    contact is uniformly distributed, with variance 1/12, and there are C/a of them, so that the standard error is
    a² √(C/12a). From this follow the weights and the standard error of the limit. None where the grids do not
    determine it: one grid, or a contact without a contour.
    """
    sizes = np.array([contact.pixel_size for contact in contacts])
    contours = np.array([contact.perimeter for contact in contacts])
    if np.unique(sizes).size < 2 or not contours.all():
        return None
    areas = np.array([contact.corrected_area for contact in contacts])
    sigma = sizes**2 * np.sqrt(contours / (12.0 * sizes))
    # in units of the coarsest pixels and of the largest error, for any units of length
    design = np.stack([np.ones_like(sizes), (sizes / sizes.max()) ** ORDER], axis=1) * (sigma.max() / sigma)[:, None]
    inverse = np.linalg.inv(design.T @ design)
    limit = float((inverse @ design.T @ (areas * sigma.max() / sigma))[0])
    return Limit(limit, math.sqrt(float(inverse[0, 0])) * float(sigma.max()))
