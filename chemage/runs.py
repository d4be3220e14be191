"""Carrying one scene from surface to ageing."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from chemage import registry
from chemage.ageing import age
from chemage.checkpoints import keep, taken_up
from chemage.errors import ChemageError, StoreError
from chemage.objects import ContactSolution, Surface
from chemage.pipeline import make_surface, solve_contact
from chemage.results import Run, jsonable
from chemage.scene import Scene

__all__ = ["Progress", "Run", "jsonable", "run", "versions"]

#: called with (stage, done, total); total is 0 where a stage cannot say how far it is
Progress = Callable[[str, int, int], None]
_Result = TypeVar("_Result")


def run(
    scene: Scene,
    *,
    progress: Progress | None = None,
    workers: int | None = None,
    surface: Surface | None = None,
    contact: ContactSolution | None = None,
    checkpoints: Path | None = None,
) -> Run:
    """Carry a scene through every stage it asks for.

    ``progress`` is called as stages advance, ``workers`` are threads for replicas. A ``surface`` or ``contact`` already
    computed for this very scene (its stage key says so) can be handed in. In the folder ``checkpoints`` the contact and
    every replica are kept as the run goes; an interrupted run goes on from there, with equal results.
    """
    tell = progress or (lambda stage, done, total: None)
    timings: dict[str, float] = {}

    def timed(stage: str, task: Callable[[], _Result]) -> _Result:
        tell(stage, 0, 0)
        begin = time.perf_counter()
        try:
            result = task()
        except ChemageError as error:
            error.add_note(f"in the stage {stage!r} of scene {scene.name!r}")
            raise
        timings[stage] = time.perf_counter() - begin
        tell(stage, 1, 1)
        return result

    if contact is None:
        if surface is None:
            surface = timed("surface", lambda: make_surface(scene.surface, scene.surface_seed))
        body = surface
        contact = timed("contact", lambda: _solved(scene, body, checkpoints))
    solution, aging = contact, None
    if scene.chemistry is not None and scene.hold is not None and scene.engine is not None:
        chemistry, hold, engine = scene.chemistry, scene.hold, scene.engine
        aging = timed(
            "ageing",
            lambda: age(
                solution,
                chemistry,
                engine=engine,
                hold_times=hold.hold_times,
                temperature=hold.temperature,
                replicas=hold.replicas,
                seed=hold.seed,
                observe=scene.observe,
                workers=workers,
                progress=lambda done, total: tell("ageing", done, total),
                checkpoints=checkpoints,
            ),
        )
    return Run(scene.todict(), solution, surface, aging, timings, versions(scene), scene.keys(), tuple(scene.cite()))


def _solved(scene: Scene, surface: Surface, checkpoints: Path | None) -> ContactSolution:
    if checkpoints is None:
        return solve_contact(scene.contact, surface, scene.load)
    try:
        checkpoints.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {checkpoints}: {error.strerror}") from error
    path, key = checkpoints / "contact.h5", " ".join([scene.keys()["contact"], *registry.current().answering()])
    other = f"{checkpoints} holds checkpoints of another scene (or of other plugins); choose another folder"
    solution = taken_up(path, "contact", ContactSolution, key, other)
    if solution is None:
        solution = solve_contact(scene.contact, surface, scene.load)
        keep(path, "contact", solution, key)
    return solution


def versions(scene: Scene | None = None) -> dict[str, str]:
    """Versions of chemage, of the distributions whose plugins ``scene`` uses, and of what they rest on."""
    from chemage import __version__

    found = {"chemage": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "numba", "h5py"):
        found[name] = _version(name)
    if scene is not None:
        for record in registry.current().records:
            if record.distribution and record.distribution not in found and _uses(scene, record.kinds):
                found[record.distribution] = record.version
    return found


@lru_cache
def _version(distribution: str) -> str:
    # reading a distribution's metadata takes a millisecond, and a sweep asks at every point
    return metadata.version(distribution)


def _uses(scene: Scene, kinds: Mapping[str, Mapping[str, str]]) -> bool:
    chemistry = scene.chemistry
    parts: list[Any] = [scene.surface, scene.contact, scene.engine, *scene.observe]
    if chemistry is not None:
        parts += [chemistry.forming, chemistry.breaking, chemistry.interaction]
    return any(part is not None and part.kind in kinds.get(part.role, {}) for part in parts)
