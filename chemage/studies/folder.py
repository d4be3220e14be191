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
import math
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from chemage.contacts.solution import ContactSolution
from chemage.foundation.container import (
    archive,
    check_json,
    read,
    read_json,
    sealed_json,
)
from chemage.foundation.errors import (
    AbsentError,
    DamagedError,
    InputError,
    StoreError,
    explain,
    in_lines,
)
from chemage.foundation.files import (
    LARGEST_DESCRIPTION,
    check_data,
    create,
    log_file,
    on_disk,
    put,
    read_bytes,
    temporary,
)
from chemage.foundation.records import Record

#: version of the layout; newer layouts are refused. Since 2 every file carries a checksum.
FORMAT = 2
#: the remedy in every message of a sweep that ended early
RESUME = "completed points are kept; rerun the same command to resume"
_NAMES = "sweep.json", ".lock", ".parts", ".shares", "contacts", "points"
T = TypeVar("T")
#: how the file of a point begins; older ones do not say which point it is
_POINT = re.compile(rb'\{"status": "(done|failed)"(?:, "key": "([^"]*)")?,')


class SweepWarning(UserWarning):
    """A warning about a sweep, for example about results of different versions."""


class CannotWrite(StoreError):
    """The disk is full or read-only, which ends the whole sweep rather than one point."""


#: a hash, and also the name of a file: a folder may come from a stranger
_Key = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]


class _Axis(BaseModel):
    paths: list[str]
    values: list[list[Any]] = Field(min_length=1)


class _Grid(BaseModel):
    axes: list[_Axis]
    base: dict[str, Any]
    source: str


class _Manifest(BaseModel):
    """What is checked of ``sweep.json`` before anything is read or written by the names in it."""

    digest: str
    versions: dict[str, str]
    grid: _Grid
    resolved: list[list[Any]]
    keys: list[_Key]
    contacts: list[_Key]
    contact_of: list[Annotated[int, Field(ge=0)]]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        axes = self.grid.axes
        lengths = [len(axis.values) for axis in axes]
        points = math.prod(lengths)
        if any(
            len(values) != len(axis.paths)
            for axis in axes
            for values in axis.values
        ):
            raise ValueError(
                "an axis of the grid has values for other fields than it names"
            )
        if points != len(self.keys) or list(map(len, self.resolved)) != lengths:
            raise ValueError(
                f"the grid has {points} points, but there are {len(self.keys)} keys"
            )
        known = range(len(self.contacts))
        if len(self.contact_of) != points or not {*self.contact_of} <= {*known}:
            raise ValueError("contact_of does not name a contact for each point")
        if "chemage" not in self.versions:
            raise ValueError("the version of chemage is missing")
        return self


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
        try:
            data = read_json(self.manifest, links=False)
            check_data(data)
            if isinstance(layout := data.get("format"), int) and layout > FORMAT:
                version = data["versions"]["chemage"]
                raise StoreError(
                    f"{self.path} was made by chemage {version}; update chemage to read it"
                )
            _Manifest.model_validate(data, strict=True)
        except FileNotFoundError:
            raise StoreError(
                f"{self.path} is not the folder of a sweep: it has no sweep.json"
            ) from None
        except (ValidationError, InputError) as error:
            problems = (
                error.problems if isinstance(error, InputError) else explain(error)
            )
            raise StoreError(
                f"{self.manifest} does not describe a sweep: {in_lines(problems[:1])}"
            ) from None
        return data

    def intact_manifest(self) -> dict[str, Any] | None:
        """Read ``sweep.json``; None if it is missing or damaged."""
        try:
            return self.read_manifest() if self.manifest.exists() else None
        except DamagedError:
            return None

    def state(self, key: str) -> str:
        """Find whether a point is ``done``, ``failed``, ``missing`` or ``damaged``."""
        path = self.point(key)
        with contextlib.suppress(StoreError):
            text = read_bytes(path, LARGEST_DESCRIPTION, links=False)
            # only the beginning is needed of a file that is as it was written
            begin = _POINT.match(text)
            if (
                begin
                and check_json(text, path)
                and begin[2] in (None, key.encode())
            ):
                return begin[1].decode()
        return self.read_point(key)["status"]

    def read_point(self, key: str) -> dict[str, Any]:
        """Read the file of a point; of one that is missing or damaged, only its ``status``."""
        try:
            content = read_json(self.point(key), links=False)
        except AbsentError:
            return {"status": "missing"}
        except StoreError:
            return {"status": "damaged"}
        # the file of another point, or of something else, is no less wrong than a damaged one
        right = content.pop("key", key) == key
        if right and content.get("status") in ("done", "failed"):
            return content
        return {"status": "damaged"}

    def write_point(self, key: str, content: Mapping[str, Any]) -> None:
        """Write the file of a point."""
        if content["status"] != "done" and self.state(key) == "done":
            return  # another process has computed it
        # with these two first: `state` reads no more of it
        self.place(
            self.point(key),
            sealed_json({"status": content["status"], "key": key, **content}),
        )

    def write_manifest(
        self, content: Mapping[str, Any], *, first: bool = False
    ) -> None:
        """Write ``sweep.json``; with ``first`` only if there is none."""
        self.place(self.manifest, sealed_json(content, indent=1), over=not first)

    def keep_contact(self, key: str, solution: ContactSolution) -> ContactSolution:
        """Write a contact, unless another process has done so before: all points use the one that is returned."""
        path, content = (
            self.contact(key),
            archive({"contact": solution}, {"key": key}),
        )
        if (
            not self.place(path, content, over=False)
            and self.intact_contact(key) is None
        ):
            self.place(path, content)  # it was damaged
        return self.read_contact(key) or solution

    def read_contact(self, key: str) -> ContactSolution | None:
        """Read a contact; None if it is missing.

        Raises
        ------
        DamagedError
            It is not what was written.
        """
        try:
            return self._in_contact(key, {"contact": ContactSolution})["contact"]
        except AbsentError:
            return None

    def _in_contact(
        self, key: str, kinds: dict[str, type[Record]]
    ) -> dict[str, Any]:
        records, about = read(self.contact(key), kinds, links=False)
        if about.get("key", key) != key:
            raise DamagedError(
                f"{self.contact(key)} is damaged: it is the contact of other points"
            )
        return records

    def contact_state(self, key: str) -> str:
        """Find whether a contact is ``done``, ``missing`` or ``damaged``; its numbers are not read."""
        try:
            self._in_contact(key, {})
        except AbsentError:
            return "missing"
        except StoreError:
            return "damaged"
        return "done"

    def intact_contact(self, key: str) -> ContactSolution | None:
        """Read a contact; None if it is missing or damaged."""
        with contextlib.suppress(StoreError):
            return self.read_contact(key)
        return None

    def place(
        self, target: Path, content: bytes | memoryview, *, over: bool = True
    ) -> bool:
        """Put a file in its place, with ``over`` in that of another one; else False where there is one."""
        part = temporary(target, self.path / ".parts")
        try:
            in_folder(part, lambda: create(part, content))
            if self.durable:
                on_disk(part)
            placed = in_folder(target, lambda: put(part, target, over=over))
            if self.durable:
                on_disk(target.parent)
            return placed
        except OSError as error:
            raise self._cannot(target, error) from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)

    def _cannot(self, what: Path | str, error: OSError) -> CannotWrite:
        return CannotWrite(
            f"cannot write {what}: {error.strerror or error}; {RESUME}"
        )

    def clear_parts(self) -> None:
        """Remove the temporary files of processes that were killed."""
        shutil.rmtree(self.path / ".parts", ignore_errors=True)
        self.make_parts()

    def make_parts(self) -> None:
        """Make the folder of temporary files."""
        try:
            (self.path / ".parts").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._cannot(f"in {self.path}", error) from None

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
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        with log_file(self.path / ".lock") as stream:
            try:
                fcntl.flock(stream, kind | fcntl.LOCK_NB)
            except BlockingIOError:
                stream.seek(0)
                # only a process that computes the whole has its name there
                process = stream.read().strip()
                owner = f"process {process}" if process else "another process"
                raise StoreError(
                    f"{self.path} is being computed by {owner}; wait for it, or stop it"
                ) from None
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


def in_folder(path: Path, write: Callable[[], T]) -> T:
    """What ``write`` gives, which puts a file at ``path``; its folder is made if there is none."""
    try:
        return write()
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        return write()


def process_name() -> str:
    """The host and the number of this process, in one word."""
    return f"{socket.gethostname()}.{os.getpid()}"


def refuse_links(folder: Path, *more: str) -> None:
    """Refuse a folder of results in which a link would lead what is written elsewhere; ``more`` are names that are not
    to be links either.

    Raises
    ------
    StoreError
        Naming the link.
    """
    paths = [folder / name for name in (*_NAMES, *more)]
    with contextlib.suppress(OSError), os.scandir(folder / "points") as entries:
        paths += [Path(entry.path) for entry in entries]
    for path in paths:
        if path.is_symlink():
            raise StoreError(
                f"{path} is a link, which is not followed; remove it, or choose another folder"
            )
