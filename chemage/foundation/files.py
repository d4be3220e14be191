"""The one door to files: nothing else in chemage or its plugins opens one by its name.

They may come from strangers: a pipe would block for ever, a device never end, and a short file can hold data whose
depth ends the interpreter; see docs/file-format.md. They are written whole or not at all: under a temporary name beside
the target, renamed at the end.
"""

from __future__ import annotations

import contextlib
import errno
import io
import itertools
import os
import shutil
import socket
import stat
import uuid
from collections.abc import Iterator
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import IO, Any

from chemage.foundation.aliases import AnyPath
from chemage.foundation.errors import AbsentError, InputError, StoreError, shortened
from chemage.foundation.memory import capacity, readable

#: identifies the content of a file without reading it: size, modification time (ns), inode, device
FileStamp = tuple[int, int, int, int]
#: tables inside tables, lists inside lists
DEEPEST = 32
#: names in one table of a scene, or tables in one list
MOST_NAMES = 10_000
#: characters of one text, and of a number written out
LONGEST_TEXT = 1_000_000
#: whole numbers beyond this many bits are neither counts nor seeds
MOST_BITS = 256
#: bytes of a file that describes something: a scene, a cluster, the manifest of a sweep
LARGEST_DESCRIPTION = 1 << 30


# -- writing ----------------------------------------------------------------------------------------------------------


def preflight(path: AnyPath, *, force: bool = False, size: float = 0) -> Path:
    """Check, before anything is computed, that a result of about ``size`` bytes can be written to ``path``.

    Raises
    ------
    StoreError
        It exists and ``force`` is false, it is no ordinary file, or its folder is missing, full or read-only.
    """
    target = Path(path)
    try:
        if target.is_dir():
            raise StoreError(f"{target} is a folder; name a file")
        if os.path.lexists(target):
            if not (target.is_file() or target.is_symlink()):
                raise StoreError(f"{target} is a device or a pipe; name a file")
            if not force:
                raise StoreError(
                    f"{target} is already there; choose another name, or overwrite it with force (--force)"
                )
        folder = target.parent
        if not folder.is_dir():
            raise StoreError(f"the folder {folder} does not exist; create it first")
        room = shutil.disk_usage(folder).free
        if size > room:
            raise StoreError(
                f"{target} needs {size / 1e6:.3g} MB, but {folder} has {room / 1e6:.3g} MB left; "
                "free some room or choose another folder"
            )
        probe = temporary(target)
        probe.touch()
        probe.unlink(missing_ok=True)
    except StoreError:
        raise
    except ValueError as error:  # a null byte in the name
        raise StoreError(f"cannot write {str(target)!r}: {error}") from error
    except OSError as error:
        raise StoreError(
            f"cannot write {target}: {error.strerror}; choose another folder or name"
        ) from error
    return target


_HOST = socket.gethostname().partition(".")[0]
_NUMBER = itertools.count()


@lru_cache(maxsize=1)
def _mark(process: int) -> str:
    """A name for this process that no process of another machine or container has."""
    return uuid.uuid4().hex[:12]


def temporary(target: Path, folder: Path | None = None) -> Path:
    """A name for what is to become ``target``, in its folder or another one of the same disk; no two threads, processes
    or hosts get the same."""
    process = os.getpid()
    name = f".{target.name}.{_HOST}.{process}.{_mark(process)}.{next(_NUMBER)}.part"
    return (folder or target.parent) / name


def _remove_stale(target: Path) -> None:
    """Remove what processes of this host, now dead, left under temporary names of ``target``."""
    start = f".{target.name}.{_HOST}."
    for entry in os.scandir(target.parent):
        if entry.name.startswith(start) and entry.name.endswith(".part"):
            owner = entry.name[len(start) :].partition(".")[0]
            if owner.isdigit() and not _alive(int(owner)):
                Path(entry.path).unlink(missing_ok=True)


@contextlib.contextmanager
def fresh_file(
    path: AnyPath, *, force: bool = False, size: float = 0
) -> Iterator[Path]:
    """A temporary name beside ``path`` that takes its place when the block ends well, and vanishes otherwise.

    ``size`` in bytes is what is about to be written, checked against the room there is. What a killed process of ours
    left behind under a temporary name of the same target is removed.
    """
    target = preflight(path, force=force, size=size)
    part = temporary(target)
    try:
        _remove_stale(target)
        yield part
        on_disk(part)
        if not put(part, target, over=force):
            raise StoreError(
                f"{target} appeared while the result was made; nothing was overwritten"
            )
        on_disk(target.parent)
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(
            f"cannot write {target}: {error.strerror or error}; nothing was kept"
        ) from error
    finally:
        part.unlink(missing_ok=True)


def write_file(
    path: AnyPath,
    content: str | bytes | memoryview,
    *,
    force: bool = False,
) -> None:
    """Write a whole file: bytes, or a text in UTF-8.

    Raises
    ------
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    data = (
        content.encode(errors="backslashreplace")
        if isinstance(content, str)
        else content
    )
    with fresh_file(path, force=force, size=len(data)) as part:
        create(part, data)


def create(path: Path, content: bytes | memoryview) -> None:
    """Write a file of a new name; where that is a link, it is not followed."""
    with os.fdopen(
        _handle(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, links=False), "wb"
    ) as stream:
        stream.write(content)


def log_file(path: Path) -> IO[str]:
    """Open a text file of ours to read it and to add to it; it is made where there is none.

    Raises
    ------
    StoreError
        It is a link, which is not followed, or no ordinary file.
    """
    if os.path.lexists(path):
        regular_file(path, links=False)
    with _named(str(path)):
        return os.fdopen(
            _handle(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, links=False),
            "a+",
            encoding="utf-8",
        )


def make_folder(path: Path, *, links: bool = False) -> None:
    """Make a folder for files of ours, unless it is there.

    Raises
    ------
    StoreError
        It is a link, which without ``links`` is not followed, or cannot be made.
    """
    if path.is_symlink() and not links:
        raise StoreError(
            f"{path} is a link, which is not followed; remove it, or name another folder"
        )
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(
            f"cannot make the folder {path}: {error.strerror}"
        ) from error


def on_disk(path: Path) -> None:
    """Return when the content of a file, or the names in a folder, would survive a power failure."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:  # systems on which folders cannot be opened
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise
    finally:
        os.close(handle)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def put(part: Path, target: Path, *, over: bool) -> bool:
    """Give a file its name, with ``over`` in place of what has it; else False where something has it, which stays."""
    if not over:
        try:
            os.link(
                part, target
            )  # unlike a rename, fails where another process was first
            return True
        except FileExistsError:
            # a network file system repeats a request whose answer was lost
            with contextlib.suppress(OSError):
                return os.path.samefile(part, target)
            return False
        except FileNotFoundError:
            raise
        except OSError:  # a file system without hard links
            if target.exists():
                return False
    os.replace(part, target)
    return True


# -- reading ----------------------------------------------------------------------------------------------------------


def regular_file(
    path: AnyPath, most: float | None = None, *, links: bool = True
) -> os.stat_result:
    """Check that ``path`` is an ordinary file, of at most ``most`` bytes (default: what fits into memory).

    Raises
    ------
    AbsentError
        It is missing.
    StoreError
        It is a folder, a pipe, a device or a loop of links, without ``links`` any link, or larger than that.
    """
    shown = shortened(os.fspath(path), 300)
    with _named(shown):
        return _checked(os.stat(path, follow_symlinks=links), shown, most)


def open_file(
    path: AnyPath, most: float | None = None, *, links: bool = True
) -> io.BufferedReader:
    """Open an ordinary file for reading, in bytes; arguments and errors as for :func:`regular_file`.

    Where others may write beside it, ``links`` are not followed.
    """
    regular_file(path, most, links=links)  # a device is not even opened
    shown = shortened(os.fspath(path), 300)
    with _named(shown):
        stream = os.fdopen(_handle(path, os.O_RDONLY, links=links), "rb")
    try:  # what it is now: another file may have its name since
        size = _checked(os.fstat(stream.fileno()), shown, most).st_size
    except StoreError:
        stream.close()
        raise
    if (
        size == 0
    ):  # a file of the kernel, such as /proc/kmsg, may say so and never end
        stream.close()
        return io.BufferedReader(io.BytesIO())  # pyright: ignore[reportArgumentType]
    return stream


def _handle(path: AnyPath, flags: int, *, links: bool) -> int:
    """A file, without waiting for the other end of a pipe."""
    optional = [
        "O_NONBLOCK",
        "O_CLOEXEC",
        "O_BINARY",
        *([] if links else ["O_NOFOLLOW"]),
    ]
    for name in optional:  # not all systems have all of them
        flags |= getattr(os, name, 0)
    return os.open(path, flags, 0o666)


@contextlib.contextmanager
def _named(shown: str) -> Iterator[None]:
    """Name the file in the errors of the system."""
    try:
        yield
    except StoreError:
        raise
    except FileNotFoundError:
        raise AbsentError(f"{shown} does not exist") from None
    except OSError as error:
        raise StoreError(
            f"{shown} cannot be read: {error.strerror or error}"
        ) from None
    except (ValueError, TypeError):  # a null byte in the name
        raise StoreError(f"{shown!r} is no name of a file") from None


def _checked(
    status: os.stat_result, shown: str, most: float | None
) -> os.stat_result:
    if stat.S_ISDIR(status.st_mode):
        raise StoreError(f"{shown}: Is a directory; name a file")
    if stat.S_ISLNK(status.st_mode):
        raise StoreError(
            f"{shown} is a link, which is not followed; name the file itself"
        )
    if stat.S_ISFIFO(status.st_mode):
        raise StoreError(f"{shown} is a pipe, not a file; save it to a file first")
    if not stat.S_ISREG(status.st_mode):
        raise StoreError(f"{shown} is a device or a socket; name an ordinary file")
    limit = most if most is not None else capacity()
    if status.st_size > limit:
        raise StoreError(
            f"{shown} has {readable(status.st_size)}, more than the {readable(limit)} that can be read"
        )
    return status


def file_stamp(path: AnyPath) -> FileStamp:
    """What changes when a file is written to; errors as of :func:`regular_file`."""
    status = regular_file(path)
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev


def read_bytes(
    path: AnyPath, most: float | None = None, *, links: bool = True
) -> bytes:
    """The content of an ordinary file; arguments and errors as for :func:`regular_file`."""
    with (
        open_file(path, most, links=links) as stream,
        _named(shortened(os.fspath(path), 300)),
    ):
        return stream.read()


def read_text(path: AnyPath, most: float | None = None) -> str:
    """Read a text file of at most ``most`` bytes, in UTF-8 with or without a byte order mark.

    Raises
    ------
    StoreError
        The file is missing, cannot be read, is too large, or is not text.
    """
    text = io.TextIOWrapper(
        io.BytesIO(read_bytes(path, most)), encoding="utf-8-sig"
    )  # any line ends
    try:
        return text.read()
    except UnicodeDecodeError:
        raise StoreError(f"{path} is not a text file") from None


def described(path: Path) -> str:
    """The text of a file that describes something."""
    return read_text(path, LARGEST_DESCRIPTION)


def check_data(data: Any, most: float = inf) -> None:
    """Check the size of parsed TOML or JSON data: depth, length of texts, size of whole numbers.

    A table has at most ``most`` names, and a list at most as many tables.

    Raises
    ------
    InputError
        Naming the path of what is too deep, too long or too large.
    """
    left: list[tuple[str, Any, int]] = [("", data, 0)]
    while left:
        path, item, depth = left.pop()
        problem, count, inner = "", 0, ()
        if isinstance(item, dict):
            count, inner = len(item), item.items()
            if not all(map(isinstance, item, itertools.repeat(str))):
                problem = "has names that are no texts"
        elif isinstance(item, list):
            count, inner = [*map(type, item)].count(dict), enumerate(item)
        elif isinstance(item, int) and item.bit_length() > MOST_BITS:
            problem = (
                f"a whole number of more than {MOST_BITS} bits; give a smaller one"
            )
        elif isinstance(item, str) and len(item) > LONGEST_TEXT:
            problem = (
                f"a text of {len(item)} characters; give at most {LONGEST_TEXT}"
            )
        if depth > DEEPEST:
            problem = f"is nested more than {DEEPEST} deep; write it flatter"
        elif count > most:
            problem = f"has {count} entries; give at most {most}"
        if problem:
            raise InputError("", [(shortened(path), problem)])
        for name, part in inner:
            # numbers are by far the most frequent, and only large ones matter
            small = isinstance(part, float) or (
                type(part) is int and abs(part) < 2**63
            )
            if not small:
                left.append((f"{path}.{name}".lstrip("."), part, depth + 1))
