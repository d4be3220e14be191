"""The two tasks of a worker: solve a contact, compute points.

A task receives the path of a folder and the numbers of points, reads everything else from the folder, and writes its
results there. Only the duration and error messages are sent back, never arrays.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from chemage.ageing.elasticity import compared_again
from chemage.contacts.solution import ContactSolution
from chemage.contacts.stage import solve_contact
from chemage.experiments.run import Run, run, run_keys
from chemage.experiments.scene import Scene
from chemage.foundation import threads as thread_budget
from chemage.foundation.codec import from_npz, to_json, to_npz
from chemage.foundation.errors import ChemageError, ExecutorError, StoreError
from chemage.foundation.version import __version__
from chemage.plugins import registry
from chemage.surfaces.stage import make_surface
from chemage.surfaces.surface import Surface
from chemage.sweeps.by_hand import Known, learn
from chemage.sweeps.folder import CannotWrite, Folder, process_name
from chemage.sweeps.grid import Grid

T = TypeVar("T")


class _Recent(Generic[T]):
    """A small cache of the objects used last, by key."""

    def __init__(self, size: int) -> None:
        self._size, self._lock = size, threading.Lock()
        self._kept: OrderedDict[str, T] = OrderedDict()

    def get(self, key: str) -> T | None:
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
            return self._kept.get(key)

    def put(self, key: str, value: T) -> None:
        with self._lock:
            self._kept[key] = value
            self._kept.move_to_end(key)
            while len(self._kept) > self._size:
                self._kept.popitem(last=False)

    def drop(self, start: str) -> None:
        """Forget the objects whose keys start so."""
        with self._lock:
            for key in [key for key in self._kept if key.startswith(start)]:
                del self._kept[key]


# 50 MB each at 2500 x 2500 pixels; points are computed in an order for which two of each are enough
_surfaces: _Recent[Surface] = _Recent(2)
_contacts: _Recent[ContactSolution] = _Recent(2)


@lru_cache(maxsize=2)
def _opened(path: str, digest: str) -> tuple[Folder, Grid, dict[str, Any]]:
    folder = Folder(Path(path))
    try:
        manifest = folder.read_manifest()
    except StoreError as error:
        raise ExecutorError(
            f"worker {process_name()} cannot read the sweep: {error}; every worker must see {path}; workers on other "
            "machines need a shared file system"
        ) from None
    if manifest["digest"] != digest:
        raise ExecutorError(f"worker {process_name()} finds another sweep in {path}; start the sweep again")
    if (version := manifest["versions"]["chemage"]) != __version__:
        raise ExecutorError(f"worker {process_name()} has chemage {__version__}, but the sweep is run by {version}")
    return folder, Grid.fromdict(manifest["grid"]), manifest


def _owner(path: str, digest: str) -> str:
    """Names the sweep and the plugins in use, which may change between two sweeps of one process."""
    return f"{path} {digest} {registry.current().state()}"


def forget(path: str) -> None:
    """Free the surfaces and contacts of the sweep in the folder ``path`` that this process has in memory."""
    _surfaces.drop(f"{path} ")
    _contacts.drop(f"{path} ")


def solve(path: str, digest: str, point: int, key: str, threads: int, known: Known = ()) -> dict[str, Any]:
    """Task: solve the contact of ``point`` and write it to the folder under ``key``.

    ``known`` are components and plugins that are registered by hand.

    Returns
    -------
    dict
        ``seconds``, the wall time; and ``error`` if the contact could not be solved.
    """
    begin = time.perf_counter()
    thread_budget.limit(threads)
    learn(known)
    folder, grid, _ = _opened(path, digest)
    try:
        solution = _solution(grid.scene(point), _owner(path, digest))
    except (Exception, SystemExit) as error:  # a plugin that calls exit must not end the sweep
        return {"seconds": time.perf_counter() - begin, "error": failure(point, {}, "contact", error)["error"]}
    _keep(folder, key, solution, _owner(path, digest))
    return {"seconds": time.perf_counter() - begin}


def _solution(scene: Scene, owner: str) -> ContactSolution:
    # the cache key contains the sweep: in another sweep other plugins may change the surface of the same options
    name = f"{owner} {scene.task_keys()['surface']}"
    surface = _surfaces.get(name)
    with scene.in_use():
        if surface is None:
            surface = make_surface(scene.surface, scene.surface_seed)
            _surfaces.put(name, surface)
        return solve_contact(scene.solver, surface, scene.load)


def _keep(folder: Folder, key: str, solution: ContactSolution, owner: str) -> ContactSolution:
    content = to_npz(solution)
    mine = folder.write_contact(key, content)
    # points always use the stored contact, so that an interruption or another process does not change them
    stored = None if mine else folder.intact_contact(key)
    kept = stored or from_npz(ContactSolution, content, folder.contact(key))
    _contacts.put(f"{owner} {key}", kept)
    return kept


def compute(path: str, digest: str, points: Sequence[int], threads: int, known: Known = ()) -> dict[str, Any]:
    """Task: compute ``points``, which differ in their fit and in the limits of the material only, and write them to the
    folder.

    Returns
    -------
    dict
        ``seconds``, the wall time; and ``failed``, the error message of each point that failed.
    """
    begin = time.perf_counter()
    thread_budget.limit(threads)
    learn(known)
    folder, grid, manifest = _opened(path, digest)
    first, stage, owner = points[0], "contact", _owner(path, digest)
    contact_key = manifest["contacts"][manifest["contact_of"][first]]
    try:
        scene = grid.scene(first)
        contact = _contacts.get(f"{owner} {contact_key}") or folder.intact_contact(contact_key)
        if contact is None:  # damaged or removed since the sweep began
            contact = _keep(folder, contact_key, _solution(scene, owner), owner)
        _contacts.put(f"{owner} {contact_key}", contact)
        stage = "ageing"
        made = run(scene, contact=contact, threads=threads, warn=False)
    except (Exception, SystemExit) as error:
        if isinstance(error, CannotWrite):
            raise
        failed = {}
        for point in points:
            content = failure(point, grid.changes(point), stage, error)
            folder.write_point(manifest["keys"][point], content)
            failed[point] = content["error"]["message"]
        return {"seconds": time.perf_counter() - begin, "failed": failed}
    for point in points:
        if point != first:
            other = grid.scene(point)
            made = replace(made, scene=other.todict(), keys=run_keys(other, made.contact, made.aging))
            if made.aging is not None and other.chemistry is not None:
                made = replace(made, aging=compared_again(made.aging, made.contact, other.chemistry))
        folder.write_point(manifest["keys"][point], _content(point, grid.changes(point), made))
    return {"seconds": time.perf_counter() - begin, "failed": {}}


def _content(point: int, changes: Mapping[str, Any], made: Run) -> dict[str, Any]:
    return {
        "status": "done",
        "point": point,
        "changes": dict(changes),
        "plugins": made.plugins,
        "summary": made.summary(),
        "aging": to_json(made.aging) if made.aging is not None else None,
    }


def failure(point: int, changes: Mapping[str, Any], stage: str, error: BaseException) -> dict[str, Any]:
    """The content of the file of a point that failed."""
    report: dict[str, Any] = {"stage": stage, "type": type(error).__name__, "message": str(error)}
    if not isinstance(error, ChemageError):
        report["traceback"] = "".join(traceback.format_exception(error)[-6:])
    return {"status": "failed", "point": point, "changes": dict(changes), "error": report}
