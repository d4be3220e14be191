"""Which process computes what, where several compute one sweep into one folder at the same time.

Each process keeps a file ``.shares/<process>.alive`` and renews it every ten seconds. Before it solves a contact or
computes points it links that file to ``.shares/<task>.claim``, which succeeds for one process only, on network file
systems as well. A claim is void once its process has ended, or has not renewed its file for two minutes by the clock of
the file system. No other locks and no clocks of other machines are used.

Claims avoid that work is done twice. They are not needed for correct files: every file is put in its place whole, and
the first version of a contact is the one that all points use.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import socket
import threading
import time
import uuid
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

from chemage.foundation.errors import StoreError

#: time between two renewals, s
BEAT = 10.0
#: age at which a file that was not renewed means that its process is gone, s
STALE = 120.0
#: what a process computes that computes a whole sweep
WHOLE = "all points"
#: the folder of claims within that of a sweep
PLACE = ".shares"


@dataclass(frozen=True)
class Owner:
    """A process that computes points of a sweep."""

    #: unique name, also that of its file
    name: str
    host: str
    pid: int
    #: in which numbers of processes are counted: the boot of the machine and the container; empty where not known
    space: str
    #: when the process was started, as the system counts; empty where not known
    started: str
    #: the points that it computes, as written by the user
    points: str

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host} ({self.points})"


class Claims:
    """The claims of this process on tasks of the sweep in ``folder``; use it in a ``with`` statement.

    Parameters
    ----------
    folder
        The folder of the sweep, which exists.
    points
        What this process computes, in words.

    Raises
    ------
    StoreError
        ``.shares`` cannot be written.
    """

    def __init__(self, folder: Path, points: str) -> None:
        self.place = folder / PLACE
        host = socket.gethostname()
        name = f"{_word(host)}.{os.getpid()}.{uuid.uuid4().hex[:12]}"
        self.me = Owner(name, host, os.getpid(), _space(), _started(os.getpid()), points)
        self._file = self._alive(name)
        self._held: set[str] = set()
        self._stop = threading.Event()
        self._beating: threading.Thread | None = None

    def __enter__(self) -> Claims:
        try:
            self._renew()
        except OSError as error:
            raise StoreError(f"cannot write {self._file}: {error.strerror or error}") from None
        self._beating = threading.Thread(target=self._beat, name="chemage-claims", daemon=True)
        self._beating.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        if self._beating is not None:
            self._beating.join()
        for task in tuple(self._held):
            self.release(task)
        with suppress(OSError):
            self._file.unlink(missing_ok=True)
        with suppress(OSError):
            self.place.rmdir()  # if nothing is left in it

    def take(self, task: str) -> bool:
        """Claim a task; False if a process that is alive has claimed it."""
        path = self._claim(task)
        for _ in range(10):
            if self._create(path):
                self._held.add(task)
                return True
            owner = self._owner_of(path)
            if owner == self.me.name:  # the answer of the file server to the first attempt was lost
                self._held.add(task)
                return True
            if owner is not None and self._lives(owner):
                return False
            if owner is not None:
                self._remove_void(path, owner)
        return False

    def release(self, task: str) -> None:
        """Give up a claim of this process."""
        self._held.discard(task)
        path = self._claim(task)
        if self._owner_of(path) == self.me.name:
            with suppress(OSError):
                path.unlink(missing_ok=True)

    def free(self, task: str) -> bool:
        """Whether no living process has claimed the task."""
        owner = self._owner_of(self._claim(task))
        return owner is None or not self._lives(owner)

    def others(self) -> list[Owner]:
        """The other processes that compute points of this sweep at present."""
        return [owner for owner in living(self.place.parent) if owner.name != self.me.name]

    # what failed is told to the other processes, so that each does not try it again

    def failed(self, task: str, error: Mapping[str, Any]) -> None:
        """Record that a task failed."""
        part = self.place / f"{task}.{self.me.name}.part"
        with suppress(OSError):  # then another process finds out by itself
            part.write_text(json.dumps(dict(error)), encoding="utf-8")
            os.replace(part, self._failure(task))

    def failure(self, task: str) -> tuple[Mapping[str, Any], tuple[int, int]] | None:
        """How a task failed, and the identity of the record, by which a later failure is told from an earlier one."""
        try:
            with open(self._failure(task), encoding="utf-8") as stream:
                found = json.load(stream)
                state = os.fstat(stream.fileno())
        except (OSError, ValueError):
            return None
        return (found, (state.st_ino, state.st_mtime_ns)) if isinstance(found, dict) else None

    # -- files ----------------------------------------------------------------------------------------------------

    def _alive(self, name: str) -> Path:
        return self.place / f"{name}.alive"

    def _claim(self, task: str) -> Path:
        return self.place / f"{task}.claim"

    def _failure(self, task: str) -> Path:
        return self.place / f"{task}.failed"

    def _renew(self) -> None:
        part = self._file.with_suffix(".part")
        for attempt in range(5):
            try:
                os.utime(self._file)  # the time of the file server
                return
            except FileNotFoundError:
                pass
            try:
                self.place.mkdir(parents=True, exist_ok=True)
                part.write_text(json.dumps(vars(self.me)), encoding="utf-8")
                os.replace(part, self._file)
                return
            except FileNotFoundError:  # another process that ended has removed the empty folder
                if attempt == 4:
                    raise

    def _beat(self) -> None:
        while not self._stop.wait(BEAT):
            with suppress(OSError):
                self._renew()

    def _create(self, path: Path) -> bool:
        for _ in range(2):
            try:
                os.link(self._file, path)
                return True
            except FileExistsError:
                return False
            except FileNotFoundError:  # another process has tidied up
                self._renew()
            except OSError:  # a file system without links
                break
        try:
            with open(path, "x", encoding="utf-8") as stream:
                stream.write(json.dumps(vars(self.me)))
        except FileExistsError:
            return False
        except OSError as error:
            raise StoreError(f"cannot write {path}: {error.strerror or error}") from None
        return True

    def _owner_of(self, path: Path) -> str | None:
        owner = _read(path)
        if owner is None:
            return "" if path.exists() else None  # a claim that cannot be read is void
        return owner.name

    def _lives(self, name: str) -> bool:
        owner = _read(self._alive(name)) if name else None
        return owner is not None and _is_alive(owner, self._alive(name))

    def _remove_void(self, path: Path, owner: str) -> None:
        aside = path.with_name(f"{path.name}.{self.me.name}.void")
        with suppress(OSError):
            os.rename(path, aside)
            if self._owner_of(aside) != owner:  # in the meantime another process has removed it and made its own
                with suppress(FileExistsError):
                    os.link(aside, path)
            aside.unlink(missing_ok=True)


def living(folder: Path) -> list[Owner]:
    """The processes that compute points of the sweep in ``folder`` at present."""
    try:
        files = sorted((folder / PLACE).glob("*.alive"))
    except OSError:
        return []
    found = [(owner, file) for file in files if (owner := _read(file)) is not None]
    return [owner for owner, file in found if _is_alive(owner, file)]


def _read(path: Path) -> Owner | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        owner = Owner(**content)
    except (OSError, ValueError, TypeError):
        return None
    texts = (owner.name, owner.host, owner.space, owner.started, owner.points)
    valid = isinstance(owner.pid, int) and all(isinstance(text, str) for text in texts)
    return owner if valid and owner.name == _word(owner.name) else None


def _is_alive(owner: Owner, file: Path) -> bool:
    if owner.host == socket.gethostname() and owner.space == _space() and not _runs(owner):
        return False
    try:
        with open(file, encoding="utf-8") as stream:  # opening it asks the file server
            renewed = os.fstat(stream.fileno()).st_mtime
    except OSError:
        return False
    return _server_time(file.parent) - renewed < STALE


def _runs(owner: Owner) -> bool:
    """Whether a process of this machine runs; one that has got the number of another does not count."""
    if os.name != "posix":  # where signal 0 would end it
        return True
    try:
        os.kill(owner.pid, 0)
    except PermissionError:  # it is of another user
        pass
    except (OSError, OverflowError):
        return False
    return _started(owner.pid) == owner.started


#: clock of the file system of a folder minus that of this machine, and when it was read, s
_offsets: dict[Path, tuple[float, float]] = {}


def _server_time(place: Path) -> float:
    """The present time by the clock of the file system of ``place``, s."""
    read, offset = _offsets.get(place, (-math.inf, 0.0))
    if time.monotonic() > read + STALE / 4:
        probe = place / f"{_word(socket.gethostname())}.{os.getpid()}.{uuid.uuid4().hex[:12]}.part"
        with suppress(OSError):  # a folder that may only be read: the clock of this machine
            probe.touch()
            offset = probe.stat().st_mtime - time.time()
            probe.unlink(missing_ok=True)
        _offsets[place] = time.monotonic(), offset
    return time.time() + offset


@lru_cache(maxsize=1)
def _space() -> str:
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {os.readlink('/proc/self/ns/pid')}"
    except (OSError, ValueError):
        return ""


def _started(pid: int) -> str:
    try:
        # the name of the program, in brackets, may contain anything
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[19].decode("ascii")
    except (OSError, LookupError, ValueError):
        return ""


def tidy(folder: Path) -> None:
    """Remove the files of processes that computed parts of the sweep in ``folder``, unless some still do."""
    if not living(folder):
        shutil.rmtree(folder / PLACE, ignore_errors=True)


def _word(text: str) -> str:
    """The text as part of a name of a file."""
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-._") else "_" for letter in text)
