"""Variants of a scene that answer the same question: on other surfaces of the same kind, and on a coarser grid."""

from __future__ import annotations

from typing import Any

from chemage.contacts.role import ContactTheory
from chemage.foundation.records import content_hash
from chemage.scene.scene import Scene


def is_random(scene: Scene) -> bool:
    """Whether another seed gives another surface, as far as its maker says."""
    scatter = scene.surface.scatter({})
    return scatter is None or scatter.relative != 0


def coarser(scene: Scene, factor: int) -> Scene | None:
    """``scene`` with the contact on pixels ``factor`` times larger and the sites where they are; None where its surface
    has no coarser grid. Sites that are pixels get the density of the scene's own pixels."""
    if isinstance(scene.contact, ContactTheory):
        return None
    known = scene.surface.expected()
    maker = scene.surface.coarser(factor)
    if maker is None or "pixel_size" not in known:
        return None
    update: dict[str, Any] = {"surface": maker}
    if scene.chemistry is not None and scene.chemistry.site_density == "pixel":
        update["chemistry"] = scene.chemistry.replace(site_density=known["pixel_size"] ** -2)
    return scene.model_copy(update=update)


def question(scene: Scene) -> str:
    """Content hash of what a scene asks but for seeds, replicas, goals and observables, which change neither costs per
    replica nor errors of its settings."""
    update: dict[str, Any] = {"surface_seed": 0, "observe": (), "ensemble": None, "accuracy": {}}
    if scene.hold is not None:
        update["hold"] = scene.hold.model_copy(update={"replicas": 1, "seed": 0, "common": "all"})
    return content_hash(scene.model_copy(update=update).keys()["result"])
