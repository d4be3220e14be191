"""The folder of a sweep.

``sweep.json``                  the scene, the axes, the key of every point, the versions of chemage and its plugins
``contacts/<key>.npz``          a contact: its sites, the pressures there, and its measures
``points/<xx>/<key>.json``      a point: its changes to the scene, its results (bonds per replica and hold time), or the
                                error
``results.csv``, ``results.h5`` the table, written at the end

Every file is written under a temporary name in ``.parts`` and then renamed, so that it is either complete or absent.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.codec import from_npz
from chemage.foundation.errors import StoreError
from chemage.foundation.inputs import LARGEST_DESCRIPTION, regular_file
from chemage.sweeps.manifest import checked_manifest

#: version of the layout; newer layouts are refused
FORMAT = 1
#: the remedy in every message of a sweep that ended early
RESUME = "completed points are kept; rerun the same command to resume"
_DONE, _END = b'{"status": "done"', b"}\n"
T = TypeVar("T")


class CannotWrite(StoreError):
    """The disk is full or read-only, which ends the whole sweep rather than one point."""


@dataclass(frozen=True)
class Folder:
    """The folder of a sweep and its files."""

    path: Path

    @property
    def manifest(self) -> Path:
        """The file that describes the sweep."""
        return self.path / "sweep.json"

    def contact(self, key: str) -> Path:
        """The file of a contact."""
        return self.path / "contacts" / f"{key}.npz"

    def point(self, key: str) -> Path:
        """The file of a point."""
        return self.path / "points" / key[:2] / f"{key}.json"

    def read_manifest(self) -> dict[str, Any]:
        """Read ``sweep.json``.

        Raises
        ------
        StoreError
            The file is missing or damaged, or a newer version of chemage wrote it.
        """
        if self.manifest.exists():
            regular_file(self.manifest, LARGEST_DESCRIPTION)
        try:
            data = json.loads(self.manifest.read_bytes())
        except FileNotFoundError:
            raise StoreError(f"{self.path} is not the folder of a sweep: it has no sweep.json") from None
        except (OSError, ValueError, RecursionError) as error:
            raise StoreError(f"{self.manifest} cannot be read: {error}") from None
        if not isinstance(data, dict) or "format" not in data:
            raise StoreError(f"{self.manifest} does not describe a sweep")
        if data["format"] > FORMAT:
            raise StoreError(
                f"{self.path} was made by chemage {data['versions']['chemage']}; update chemage to read it"
            )
        return checked_manifest(data, self.manifest)

    def state(self, key: str) -> str:
        """Find whether a point is ``done``, ``failed`` or ``missing``; an incomplete file counts as missing."""
        try:
            text = self.point(key).read_bytes()
        except OSError:
            return "missing"
        if not text.endswith(_END):
            return "missing"
        return "done" if text.startswith(_DONE) else "failed"

    def read_point(self, key: str) -> dict[str, Any] | None:
        """Read the file of a point; None if it is missing or damaged."""
        try:
            return json.loads(self.point(key).read_bytes())
        except (OSError, ValueError):
            return None

    def write_point(self, key: str, content: Mapping[str, Any]) -> None:
        """Write the file of a point."""
        # not indented, and with the status first: `state` reads the begin and the end only
        self._place(self.point(key), json.dumps(content).encode() + b"\n")

    def write_manifest(self, content: Mapping[str, Any]) -> None:
        """Write ``sweep.json``."""
        # the rest of the folder is useless without it, so it must survive a power failure
        self._place(self.manifest, json.dumps(content, indent=1).encode() + b"\n", durable=True)

    def has_contact(self, key: str) -> bool:
        """Whether the file of a contact exists and is complete."""
        import zipfile

        return zipfile.is_zipfile(self.contact(key))

    def write_contact(self, key: str, content: memoryview) -> None:
        """Write the file of a contact, with the content made by :func:`chemage.foundation.codec.to_npz`."""
        self._place(self.contact(key), content)

    def read_contact(self, key: str) -> ContactSolution | None:
        """Read a contact; None if it is missing or damaged."""
        import zipfile

        try:
            with np.load(self.contact(key), allow_pickle=False) as file:
                return _of_0_1(file) if "told" in file.files else from_npz(ContactSolution, file)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def _place(self, target: Path, content: bytes | memoryview, durable: bool = False) -> None:
        part = self.path / ".parts" / f"{target.name}.{process_name()}.{threading.get_ident()}"
        try:
            part.write_bytes(content)
            if durable:
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
            raise CannotWrite(f"cannot write {target}: {error.strerror or error}; {RESUME}") from None

    def clear_parts(self) -> None:
        """Remove the temporary files of processes that were killed."""
        shutil.rmtree(self.path / ".parts", ignore_errors=True)
        (self.path / ".parts").mkdir(parents=True, exist_ok=True)

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder against a second call; the operating system releases the lock when the process ends."""
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


def process_name() -> str:
    """The host and the number of this process, in one word."""
    return f"{_host()}.{os.getpid()}"


def _of_0_1(file: Mapping[str, np.ndarray]) -> ContactSolution:
    """A contact as chemage 0.1 kept it: its sites, the pressures there, and the rest as a line of JSON."""
    rest = json.loads(bytes(file["told"]))
    pressure = np.zeros(tuple(rest["shape"]), dtype=file["pressure"].dtype)
    pressure.ravel()[file["sites"]] = file["pressure"]
    gap = file.get("gap")
    others = {name: rest[name] for name in ("convergence", "provenance")}
    return ContactSolution(pressure=pressure, gap=gap, notes=tuple(rest["notes"]), **others, **rest["fields"])
