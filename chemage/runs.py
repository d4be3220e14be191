"""A run: one scene carried from surface to ageing, and what came of it."""

from __future__ import annotations

import json
import math
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from chemage.ageing import age
from chemage.errors import ChemageError, InputError, StoreError
from chemage.objects import Aging, ContactSolution, Fit, Record, Surface
from chemage.pipeline import make_surface, solve_contact
from chemage.scene import Scene

#: called with (stage, done, total); total is 0 where a stage cannot say how far it is
Progress = Callable[[str, int, int], None]
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Run:
    """A finished run. Everything needed to repeat it is in ``scene`` and ``versions``."""

    scene: dict[str, Any]
    contact: ContactSolution
    surface: Surface | None = None
    aging: Aging | None = None
    #: wall seconds of each stage
    timings: dict[str, float] = field(default_factory=dict)
    #: of chemage, the plugins used, and the libraries below them
    versions: dict[str, str] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    cite: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.scene.get("name", "scene"))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of this result, in words."""
        notes = list(self.contact.notes)
        if self.contact.area_fraction == 1 and not any(note.startswith("full contact") for note in notes):
            notes.append(
                "full contact: every pixel carries pressure, and more load adds pressure but no contact area; "
                "an elastic model says little about a surface pressed flat"
            )
        return tuple(notes)

    def fit(self) -> Fit | None:
        """Line of Δμ against log t over the scene's fit window; None without ageing or without times in the window."""
        if self.aging is None:
            return None
        window = self.scene.get("fit", {})
        try:
            return self.aging.fit(window.get("start", 10.0), window.get("stop", 1e4))
        except InputError:
            return None

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the numbers users compare; what does not exist is None, as is nan."""
        contact, aging, fit = self.contact, self.aging, self.fit()
        numbers: dict[str, Any] = {
            "name": self.name,
            "solver": self.scene["contact"]["kind"],
            "engine": aging.engine if aging else None,
            **contact.summary(),
            "converged": contact.converged,
            "residual": contact.residual,
            "iterations": contact.iterations,
            "notes": list(self.notes),
            "sites": float(aging.sites.mean()) if aging else contact.sites.size,
            "replicas": aging.replicas if aging else 0,
            "events": int(aging.events.sum()) if aging else 0,
            "hold_times": aging.hold_times.tolist() if aging else [],
            "friction_drop": aging.mean_friction_drop.tolist() if aging else [],
            "friction_drop_stderr": aging.friction_drop_stderr.tolist() if aging else [],
            "friction_coefficient_drop": aging.mean_friction_coefficient_drop.tolist() if aging else [],
            "friction_coefficient_drop_stderr": aging.friction_coefficient_drop_stderr.tolist() if aging else [],
            "beta": fit.beta if fit else None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "timings": self.timings,
            "versions": self.versions,
            "keys": self.keys,
            "cite": list(self.cite),
        }
        return jsonable(numbers)

    def parts(self) -> dict[str, Record]:
        """The objects to store, by group name."""
        found = {"surface": self.surface, "contact": self.contact, "aging": self.aging}
        return {name: part for name, part in found.items() if part is not None}

    def attributes(self) -> dict[str, str]:
        """What the root of the file says."""
        return {name: json.dumps(getattr(self, name)) for name in ("scene", "timings", "versions", "keys", "cite")}

    @classmethod
    def from_parts(cls, parts: Mapping[str, Any], attributes: Mapping[str, Any]) -> Run:
        """The inverse of :meth:`parts` and :meth:`attributes`."""
        missing = [name for name in ("scene", "timings", "versions", "keys", "cite") if name not in attributes]
        if missing or "contact" not in parts:
            raise StoreError(f"not a complete run: without {', '.join(missing) or 'a contact'}")
        try:
            fields = {name: json.loads(attributes[name]) for name in ("scene", "timings", "versions", "keys", "cite")}
        except ValueError as error:
            raise StoreError(f"not a complete run: {error}") from error
        return cls(
            contact=parts["contact"],
            surface=parts.get("surface"),
            aging=parts.get("aging"),
            **{**fields, "cite": tuple(fields["cite"])},
        )


def jsonable(value: Any) -> Any:
    """Plain JSON: numpy scalars and arrays as numbers and lists, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
    from chemage.store import read_parts, write_parts

    if checkpoints is None:
        return solve_contact(scene.contact, surface, scene.load)
    try:
        checkpoints.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {checkpoints}: {error.strerror}") from error
    path, key = checkpoints / "contact.h5", scene.keys()["contact"]
    if path.exists():
        parts, attributes = read_parts(path)
        found = parts.get("contact")
        if attributes.get("checkpoint") != key or not isinstance(found, ContactSolution):
            raise StoreError(f"{checkpoints} holds checkpoints of another scene; choose another folder")
        return found
    solution = solve_contact(scene.contact, surface, scene.load)
    write_parts(path, {"contact": solution}, {"checkpoint": key})
    return solution


def versions(scene: Scene | None = None) -> dict[str, str]:
    """Versions of chemage, of the distributions whose plugins ``scene`` uses, and of what they rest on."""
    from chemage import __version__, registry

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
