"""The folder of a sweep.

``sweep.json``                  the scene, the axes, the key of every point, the versions of chemage and its plugins
``contacts/<key>.npz``          a contact: its sites, the pressures there, and its measures
``points/<xx>/<key>.json``      a point: its changes to the scene, its results (bonds per replica and hold time), or the
                                error
``results.csv``, ``results.h5`` the table, written at the end

Every file is written under a temporary name in ``.parts``, to the disk itself, and then renamed, so that it is either
complete or absent, after a power failure as well. Every file carries a checksum, which is compared when it is read.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import socket
import threading
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.codec import from_npz
from chemage.foundation.errors import DamagedError, InputError, StoreError
from chemage.foundation.files import on_disk
from chemage.foundation.inputs import LARGEST_DESCRIPTION, regular_file
from chemage.foundation.seals import check_json_seal, check_seal, from_sealed_json, to_sealed_json
from chemage.studies.manifest import checked_manifest

#: version of the layout; newer layouts are refused. Since 2 every file carries a checksum.
FORMAT = 2
#: the remedy in every message of a sweep that ended early
RESUME = "completed points are kept; rerun the same command to resume"
_DONE = b'{"status": "done"'


class SweepWarning(UserWarning):
    """A warning about a sweep, for example about results of different versions."""


class CannotWrite(StoreError):
    """The disk is full or read-only, which ends the whole sweep rather than one point."""


@dataclass(frozen=True)
class Folder:
    """The folder of a sweep and its files."""

    path: Path
    #: whether files survive a power failure, for which the disk is waited for
    durable: bool = True

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
            data, is_sealed = from_sealed_json(self.manifest.read_bytes(), self.manifest)
        except FileNotFoundError:
            raise StoreError(f"{self.path} is not the folder of a sweep: it has no sweep.json") from None
        except DamagedError:
            raise
        except OSError as error:
            raise StoreError(f"{self.manifest} cannot be read: {error.strerror}") from None
        if not isinstance(data.get("format"), int):
            raise StoreError(f"{self.manifest} does not describe a sweep")
        if data["format"] > FORMAT:
            raise StoreError(
                f"{self.path} was made by chemage {data['versions']['chemage']}; update chemage to read it"
            )
        if not is_sealed and data["format"] >= 2:
            raise DamagedError(f"{self.manifest} is damaged: its checksum is missing")
        return checked_manifest(data, self.manifest)

    def state(self, key: str) -> str:
        """Find whether a point is ``done``, ``failed``, ``missing`` or ``damaged``."""
        path = self.point(key)
        try:
            text = path.read_bytes()
            # only the beginning is needed of a file that is as it was written
            if check_json_seal(text, path):
                return "done" if text.startswith(_DONE) else "failed"
        except (DamagedError, OSError):
            pass
        return self.read_point(key)["status"]

    def read_point(self, key: str) -> dict[str, Any]:
        """Read the file of a point; of one that is missing or damaged, only its ``status``."""
        path = self.point(key)
        try:
            content, is_sealed = from_sealed_json(path.read_bytes(), path)
        except DamagedError:
            return {"status": "damaged"}
        except OSError:
            return {"status": "missing"}
        if not is_sealed and not _is_of_0_1(content):
            return {"status": "damaged"}
        return content

    def write_point(self, key: str, content: Mapping[str, Any]) -> None:
        """Write the file of a point."""
        if content["status"] != "done" and self.state(key) == "done":
            return  # another process has computed it
        # with the status first: `state` reads no more of it
        self.place(self.point(key), to_sealed_json({"status": content["status"], **content}))

    def write_manifest(self, content: Mapping[str, Any], *, first: bool = False) -> None:
        """Write ``sweep.json``; with ``first`` only if there is none."""
        text = to_sealed_json(content, indent=1)
        if first:
            self.place_first(self.manifest, text)
        else:
            self.place(self.manifest, text)

    def write_contact(self, key: str, content: bytes | memoryview) -> bool:
        """Write the file of a contact, with the content made by :func:`chemage.foundation.codec.to_npz`.

        Returns
        -------
        bool
            False if another process has written it before: all points use that one, and ``content`` is not kept.
        """
        path = self.contact(key)
        if self.place_first(path, content):
            return True
        if self.intact_contact(key) is not None:
            return False
        self.place(path, content)  # it was damaged
        return True

    def read_contact(self, key: str) -> ContactSolution | None:
        """Read a contact; None if it is missing.

        Raises
        ------
        DamagedError
            It is not what was written.
        """
        path = self.contact(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        try:
            return from_npz(ContactSolution, content, path)
        except DamagedError:
            if (old := _of_0_1(content)) is None:
                raise
            return old

    def has_contact(self, key: str) -> bool:
        """Whether a contact is there and as it was written; its numbers are not read."""
        try:
            return check_seal(self.contact(key)) or self.intact_contact(key) is not None
        except (DamagedError, OSError):
            return False

    def intact_contact(self, key: str) -> ContactSolution | None:
        """Read a contact; None if it is missing or damaged."""
        try:
            return self.read_contact(key)
        except DamagedError:
            return None

    def place(self, target: Path, content: bytes | memoryview) -> None:
        """Put a file in its place, or in that of another one."""
        self._place(target, content, _put_over)

    def place_first(self, target: Path, content: bytes | memoryview) -> bool:
        """Put a file in its place; False if there is one, which stays."""
        return self._place(target, content, _put_first)

    def _place(self, target: Path, content: bytes | memoryview, put: Callable[[Path, Path], bool]) -> bool:
        part = self.path / ".parts" / f"{target.name}.{process_name()}.{_mark(os.getpid())}.{threading.get_ident()}"
        try:
            try:
                part.write_bytes(content)
            except FileNotFoundError:
                part.parent.mkdir(parents=True, exist_ok=True)
                part.write_bytes(content)
            if self.durable:
                on_disk(part)
            try:
                placed = put(part, target)
            except FileNotFoundError:
                target.parent.mkdir(parents=True, exist_ok=True)
                placed = put(part, target)
            if self.durable:
                on_disk(target.parent)
            return placed
        except OSError as error:
            raise CannotWrite(f"cannot write {target}: {error.strerror or error}; {RESUME}") from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)

    def clear_parts(self) -> None:
        """Remove the temporary files of processes that were killed."""
        shutil.rmtree(self.path / ".parts", ignore_errors=True)
        self.make_parts()

    def make_parts(self) -> None:
        """Make the folder of temporary files."""
        try:
            (self.path / ".parts").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CannotWrite(f"cannot write in {self.path}: {error.strerror or error}; {RESUME}") from None

    def is_locked(self) -> bool:
        """Whether another process of this machine computes into the folder at present."""
        try:
            with self.locked():
                return False
        except StoreError:
            return True

    @contextlib.contextmanager
    def locked(self, *, shared: bool = False) -> Iterator[None]:
        """Lock the folder against a second call; the operating system releases the lock when the process ends.

        With ``shared`` other processes may lock it so as well.
        """
        try:
            import fcntl
        except ImportError:  # no such locks on this system
            yield
            return
        with open(self.path / ".lock", "a+") as stream:
            try:
                fcntl.flock(stream, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
            except BlockingIOError:
                stream.seek(0)
                # only a process that computes the whole has its name there
                process = stream.read().strip()
                owner = f"process {process}" if process else "another process"
                raise StoreError(f"{self.path} is being computed by {owner}; wait for it, or stop it") from None
            except OSError:  # a file system without locks
                yield
                return
            stream.truncate(0)
            if not shared:
                stream.write(f"{os.getpid()} on {socket.gethostname()}")
            stream.flush()
            try:
                yield
            finally:
                stream.truncate(0)


def _put_over(part: Path, target: Path) -> bool:
    os.replace(part, target)
    return True


def _put_first(part: Path, target: Path) -> bool:
    try:
        os.link(part, target)
        return True
    except FileExistsError:
        # a network file system repeats a request whose answer was lost
        with contextlib.suppress(OSError):
            return os.path.samefile(part, target)
        return False
    except FileNotFoundError:
        raise
    except OSError:  # a file system without links
        if target.exists():
            return False
        return _put_over(part, target)


@lru_cache(maxsize=1)
def _mark(process: int) -> str:
    """A name for this process that no process of another machine or container has."""
    return uuid.uuid4().hex[:12]


@lru_cache(maxsize=1)
def _host() -> str:
    return socket.gethostname()


def process_name() -> str:
    """The host and the number of this process, in one word."""
    return f"{_host()}.{os.getpid()}"


def _is_of_0_1(content: Mapping[str, Any]) -> bool:
    """Whether a point was computed by chemage 0.1, which wrote no checksums."""
    try:
        return str(content["summary"]["versions"]["chemage"]).startswith("0.1.")
    except (KeyError, TypeError):
        return False


def _of_0_1(content: bytes) -> ContactSolution | None:
    """A contact as chemage 0.1 kept it: its sites, the pressures there, and the rest as a line of JSON."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            rest = json.loads(bytes(file["told"]))
            pressure = np.zeros(tuple(rest["shape"]), dtype=file["pressure"].dtype)
            pressure.ravel()[file["sites"]] = file["pressure"]
            gap = file["gap"] if "gap" in file.files else None
            others = {name: rest[name] for name in ("convergence", "provenance")}
            return ContactSolution(pressure=pressure, gap=gap, notes=tuple(rest["notes"]), **others, **rest["fields"])
    except (OSError, ValueError, LookupError, EOFError, TypeError, InputError, zipfile.BadZipFile):
        return None
