"""What a sweep keeps on disk.

``sweep.json``                  the scene, the axes, the keys of every point; versions of what made it
``contacts/<key>.npz``          a contact: its sites, the pressures there, and its measures
``points/<xx>/<key>.json``      a point: what it changes, its numbers, bonds by replica and hold time; or the error
``results.csv``, ``results.h5`` the table, written at the end

Every file is written under a temporary name in ``.parts`` and renamed, so that it is whole or absent.
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

    def write_contact(self, key: str, content: memoryview) -> None:
        """Put the file of a contact (see :func:`chemage.foundation.codec.to_npz`) in its place."""
        self._place(self.contact(key), content)

    def read_contact(self, key: str) -> ContactSolution | None:
        """A contact, or None if there is none or it is damaged."""
        import zipfile

        try:
            with np.load(self.contact(key), allow_pickle=False) as file:
                return _of_0_1(file) if "told" in file.files else from_npz(ContactSolution, file)
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


def _of_0_1(file: Mapping[str, np.ndarray]) -> ContactSolution:
    """A contact as chemage 0.1 kept it: its sites, the pressures there, and the rest as a line of JSON."""
    rest = json.loads(bytes(file["told"]))
    pressure = np.zeros(tuple(rest["shape"]), dtype=file["pressure"].dtype)
    pressure.ravel()[file["sites"]] = file["pressure"]
    gap = file.get("gap")
    others = {name: rest[name] for name in ("convergence", "provenance")}
    return ContactSolution(pressure=pressure, gap=gap, notes=tuple(rest["notes"]), **others, **rest["fields"])
