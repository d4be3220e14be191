"""What a sweep keeps on disk, and the two tasks that fill it: solve a contact, compute points.

``sweep.json``                  the scene, the axes, the keys of every point; versions of what made it
``contacts/<key>.npz``          a contact: its sites, the pressures there, and its measures
``points/<xx>/<key>.json``      a point: what it changes, its numbers, bonds by replica and hold time; or the error
``results.csv``, ``results.h5`` the table, written at the end

Every file is written under a temporary name in ``.parts`` and renamed, so that it is whole or absent. A task gets a
folder and numbers of points, reads the rest here, and answers with a few words: no array ever travels.
"""

from __future__ import annotations

import base64
import contextlib
import json
import math
import os
import shutil
import socket
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from chemage import threads as thread_budget
from chemage.errors import ChemageError, ExecutorError, StoreError
from chemage.objects import Aging, ContactSolution, Surface, frozen
from chemage.pipeline import make_surface, solve_contact
from chemage.runs import Run, run
from chemage.scene import Scene
from chemage.sweeps.grid import Grid

#: layout of the folder; a reader refuses a newer one
FORMAT = 1
_DONE, _END = b'{"status": "done"', b"}\n"
T = TypeVar("T")


class CannotWrite(StoreError):
    """The disk is full or read-only: a matter of the sweep, not of one point."""


@dataclass(frozen=True)
class Folder:
    """A sweep's folder."""

    path: Path

    @property
    def manifest(self) -> Path:
        """The file that says what the sweep is."""
        return self.path / "sweep.json"

    def contact(self, key: str) -> Path:
        """The file of a contact."""
        return self.path / "contacts" / f"{key}.npz"

    def point(self, key: str) -> Path:
        """The file of a point."""
        return self.path / "points" / key[:2] / f"{key}.json"

    def read_manifest(self) -> dict[str, Any]:
        """What ``sweep.json`` says.

        Raises
        ------
        StoreError
            There is none, it is damaged, or a newer chemage made it.
        """
        try:
            data = json.loads(self.manifest.read_bytes())
        except FileNotFoundError:
            raise StoreError(f"{self.path} is not the folder of a sweep: it has no sweep.json") from None
        except (OSError, ValueError) as error:
            raise StoreError(f"{self.manifest} cannot be read: {error}") from None
        if not isinstance(data, dict) or "format" not in data:
            raise StoreError(f"{self.manifest} is not of a sweep")
        if data["format"] > FORMAT:
            raise StoreError(
                f"{self.path} was made by chemage {data['versions']['chemage']}; update chemage to read it"
            )
        return data

    def state(self, key: str) -> str:
        """``done``, ``failed`` or ``missing``; a file that is not whole counts as missing."""
        try:
            text = self.point(key).read_bytes()
        except OSError:
            return "missing"
        if not text.endswith(_END):
            return "missing"
        return "done" if text.startswith(_DONE) else "failed"

    def read_point(self, key: str) -> dict[str, Any] | None:
        """What is known of a point; None if nothing is."""
        try:
            return json.loads(self.point(key).read_bytes())
        except (OSError, ValueError):
            return None

    def write_point(self, key: str, content: Mapping[str, Any]) -> None:
        """Put a point's file in its place."""
        # not indented, and what failed never starts like what is done: `state` looks at both ends only
        self._place(self.point(key), json.dumps(content).encode() + b"\n")

    def write_manifest(self, content: Mapping[str, Any]) -> None:
        """Put ``sweep.json`` in its place."""
        # without it nothing else in the folder is of use, so it must outlive a power cut
        self._place(self.manifest, json.dumps(content, indent=1).encode() + b"\n", lasting=True)

    def has_contact(self, key: str) -> bool:
        """Whether a contact is there, and whole."""
        import zipfile

        return zipfile.is_zipfile(self.contact(key))

    def write_contact(self, key: str, solution: ContactSolution) -> None:
        """Put a contact's file in its place."""
        buffer = BytesIO()
        np.savez(buffer, allow_pickle=False, **pack(solution))
        self._place(self.contact(key), buffer.getbuffer())

    def read_contact(self, key: str) -> ContactSolution | None:
        """A contact, or None if there is none or it is damaged."""
        import zipfile

        try:
            with np.load(self.contact(key), allow_pickle=False) as file:
                return unpack(file)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def _place(self, target: Path, content: bytes | memoryview, lasting: bool = False) -> None:
        part = self.path / ".parts" / f"{target.name}.{_own_name()}.{threading.get_ident()}"
        try:
            part.write_bytes(content)
            if lasting:
                with open(part, "rb") as stream:
                    os.fsync(stream.fileno())
            try:
                os.replace(part, target)
            except FileNotFoundError:
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(part, target)
        except OSError as error:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise CannotWrite(
                f"cannot write {target}: {error.strerror or error}; what is finished is kept, the same sweep goes on"
            ) from None

    def clear_parts(self) -> None:
        """Remove what writers that were killed left behind."""
        shutil.rmtree(self.path / ".parts", ignore_errors=True)
        (self.path / ".parts").mkdir(parents=True, exist_ok=True)

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep a second run out of the folder; the lock ends with the process, however that ends."""
        try:
            import fcntl
        except ImportError:  # no such locks on this system
            yield
            return
        with open(self.path / ".lock", "a+") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                stream.seek(0)
                raise StoreError(f"{self.path} is being computed by process {stream.read().strip() or '?'}") from None
            except OSError:  # a file system without locks
                yield
                return
            stream.truncate(0)
            stream.write(f"{os.getpid()} on {socket.gethostname()}")
            stream.flush()
            yield


@lru_cache(maxsize=1)
def _host() -> str:
    return socket.gethostname()


def _own_name() -> str:
    return f"{_host()}.{os.getpid()}"


# -- contacts, compact ------------------------------------------------------------------------------------------------


def pack(solution: ContactSolution) -> dict[str, np.ndarray]:
    """A contact as its sites, the pressures there and a line of JSON; the gap too, where there is one."""
    sites = solution.sites
    fields = {
        name: value
        for name, value in solution.todict().items()
        if name not in ("pressure", "gap", "notes", "provenance", "convergence")
    }
    told = {
        "shape": list(solution.shape),
        "fields": {name: _exact(value) for name, value in fields.items()},
        "notes": list(solution.notes),
        "convergence": solution.convergence,
        "provenance": solution.provenance,
        "measures": {name: _exact(value) for name, value in solution.summary().items()},
    }
    arrays = {
        "sites": sites.astype(np.int32) if solution.pressure.size < 2**31 else sites,
        "pressure": solution.pressure.ravel()[sites],
        "told": np.frombuffer(json.dumps(told, default=_plain).encode(), dtype=np.uint8),
    }
    if solution.gap is not None:
        arrays["gap"] = solution.gap
    return arrays


def _exact(value: Any) -> Any:
    """A float that JSON has no word for, as text."""
    if isinstance(value, np.generic):
        value = value.item()
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def _inexact(value: Any) -> Any:
    return float(value) if isinstance(value, str) and value in ("nan", "inf", "-inf") else value


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def unpack(arrays: Mapping[str, np.ndarray]) -> ContactSolution:
    """The inverse of :func:`pack`."""
    told = json.loads(bytes(arrays["told"]))
    sites = frozen(arrays["sites"].astype(np.int64))
    pressure = np.zeros(tuple(told["shape"]), dtype=arrays["pressure"].dtype)
    pressure.ravel()[sites] = arrays["pressure"]
    pressure.setflags(write=False)
    fields = {name: _inexact(value) for name, value in told["fields"].items()}
    return ContactSolution(
        pressure=pressure,
        gap=arrays.get("gap"),
        notes=tuple(told["notes"]),
        convergence=told["convergence"],
        provenance=told["provenance"],
        **fields,
    )


# -- points -----------------------------------------------------------------------------------------------------------


def pack_aging(aging: Aging) -> dict[str, Any]:
    """Ageing as plain JSON, to the last bit."""
    return {
        "hold_times": aging.hold_times.tolist(),
        "bonds": aging.bonds.tolist(),
        "sites": aging.sites.tolist(),
        "events": aging.events.tolist(),
        "load": aging.load,
        "temperature": aging.temperature,
        "bond_force": aging.bond_force,
        "front_factor": aging.front_factor,
        "engine": aging.engine,
        "contact": {name: _exact(value) for name, value in aging.contact.items()},
        "observables": {
            name: {
                "dtype": values.dtype.str,
                "shape": list(values.shape),
                "base64": base64.b64encode(np.ascontiguousarray(values).tobytes()).decode(),
            }
            for name, values in aging.observables.items()
        },
        "provenance": json.loads(json.dumps(aging.provenance, default=_plain)),
    }


def unpack_aging(fields: Mapping[str, Any]) -> Aging:
    """The inverse of :func:`pack_aging`."""
    observables = {
        name: np.frombuffer(base64.b64decode(one["base64"]), dtype=one["dtype"]).reshape(one["shape"])
        for name, one in fields["observables"].items()
    }
    contact = {name: _inexact(value) for name, value in fields["contact"].items()}
    return Aging(**{**fields, "observables": observables, "contact": contact})


def failure(point: int, changes: Mapping[str, Any], stage: str, error: BaseException) -> dict[str, Any]:
    """What is kept of a point that failed."""
    told: dict[str, Any] = {"stage": stage, "type": type(error).__name__, "message": str(error)}
    if not isinstance(error, ChemageError):
        told["traceback"] = "".join(traceback.format_exception(error)[-6:])
    return {"status": "failed", "point": point, "changes": dict(changes), "error": told}


# -- in the worker ----------------------------------------------------------------------------------------------------


class _Recent(Generic[T]):
    """The few objects used last, by key."""

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


# a surface of 2500 x 2500 pixels takes 50 MB, a contact as much: two of each cover a sweep in the order it is done
_surfaces: _Recent[Surface] = _Recent(2)
_contacts: _Recent[ContactSolution] = _Recent(2)


@lru_cache(maxsize=2)
def _opened(path: str, digest: str) -> tuple[Folder, Grid, dict[str, Any]]:
    folder = Folder(Path(path))
    try:
        manifest = folder.read_manifest()
    except StoreError as error:
        raise ExecutorError(
            f"worker {_own_name()} cannot read the sweep: {error}; every worker must see {path}, on a shared file "
            "system if it is another machine"
        ) from None
    if manifest["digest"] != digest:
        raise ExecutorError(f"worker {_own_name()} finds another sweep in {path}: start the sweep again")
    from chemage import __version__

    if manifest["versions"]["chemage"] != __version__:
        raise ExecutorError(
            f"worker {_own_name()} has chemage {__version__}, but the sweep is run by {manifest['versions']['chemage']}"
        )
    return folder, Grid.fromdict(manifest["grid"]), manifest


def solve(path: str, digest: str, point: int, key: str, threads: int) -> dict[str, Any]:
    """Task: the contact of ``point``, whose key is ``key``, to the folder. Answers with ``seconds`` or an ``error``."""
    begin = time.perf_counter()
    thread_budget.limit(threads)
    folder, grid, _ = _opened(path, digest)
    try:
        solution = _solution(grid.scene(point), f"{path} {digest}")
    except (Exception, SystemExit) as error:  # a plugin that exits must not end the sweep
        return {"seconds": time.perf_counter() - begin, "error": failure(point, {}, "contact", error)["error"]}
    _keep(folder, key, solution, f"{path} {digest}")
    return {"seconds": time.perf_counter() - begin}


def _solution(scene: Scene, owner: str) -> ContactSolution:
    # what is kept belongs to one sweep: in another, other plugins may stand between the options and the surface
    name = f"{owner} {scene.keys()['surface']}"
    surface = _surfaces.get(name)
    if surface is None:
        surface = make_surface(scene.surface, scene.surface_seed)
        _surfaces.put(name, surface)
    return solve_contact(scene.contact, surface, scene.load)


def _keep(folder: Folder, key: str, solution: ContactSolution, owner: str) -> ContactSolution:
    folder.write_contact(key, solution)
    # what points see is what is on disk, whether they come at once or after an interruption
    kept = unpack(pack(solution))
    _contacts.put(f"{owner} {key}", kept)
    return kept


def compute(path: str, digest: str, points: Sequence[int], threads: int) -> dict[str, Any]:
    """Task: ``points`` that differ in their fit alone, to the folder.

    Answers with ``seconds`` and ``failed``, one line for each point that did.
    """
    begin = time.perf_counter()
    thread_budget.limit(threads)
    folder, grid, manifest = _opened(path, digest)
    first, stage, owner = points[0], "contact", f"{path} {digest}"
    contact_key = manifest["contacts"][manifest["contact_of"][first]]
    try:
        scene = grid.scene(first)
        contact = _contacts.get(f"{owner} {contact_key}") or folder.read_contact(contact_key)
        if contact is None:  # damaged, or removed in the meantime
            contact = _keep(folder, contact_key, _solution(scene, owner), owner)
        _contacts.put(f"{owner} {contact_key}", contact)
        stage = "ageing"
        made = run(scene, contact=contact, workers=threads)
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
            made = replace(made, scene=other.todict(), keys=other.keys())
        folder.write_point(manifest["keys"][point], _content(point, grid.changes(point), made))
    return {"seconds": time.perf_counter() - begin, "failed": {}}


def _content(point: int, changes: Mapping[str, Any], made: Run) -> dict[str, Any]:
    return {
        "status": "done",
        "point": point,
        "changes": dict(changes),
        "summary": made.summary(),
        "aging": pack_aging(made.aging) if made.aging is not None else None,
    }
