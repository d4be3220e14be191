"""Files that are written whole or not at all: a temporary name beside the target, renamed at the end."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

from chemage.foundation.errors import StoreError


def preflight(path: str | os.PathLike[str], *, force: bool = False, size: float = 0) -> Path:
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
        probe = _beside(target)
        probe.touch()
        probe.unlink(missing_ok=True)
    except StoreError:
        raise
    except ValueError as error:  # a null byte in the name
        raise StoreError(f"cannot write {str(target)!r}: {error}") from error
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror}; choose another folder or name") from error
    return target


_HOST = socket.gethostname().partition(".")[0]
_NUMBER = itertools.count()


def _beside(target: Path) -> Path:
    """A temporary name in the same folder; no two threads, processes or hosts get the same."""
    return target.parent / f".{target.name}.{_HOST}.{os.getpid()}.{next(_NUMBER)}.part"


def _remove_stale(target: Path) -> None:
    """Remove what processes of this host, now dead, left under temporary names of ``target``."""
    start = f".{target.name}.{_HOST}."
    for entry in os.scandir(target.parent):
        if entry.name.startswith(start) and entry.name.endswith(".part"):
            owner = entry.name[len(start) :].partition(".")[0]
            if owner.isdigit() and not _alive(int(owner)):
                Path(entry.path).unlink(missing_ok=True)


@contextlib.contextmanager
def fresh_file(path: str | os.PathLike[str], *, force: bool = False, size: float = 0) -> Iterator[Path]:
    """A temporary name beside ``path`` that takes its place when the block ends well, and vanishes otherwise.

    ``size`` in bytes is what is about to be written, checked against the room there is. What a killed process of ours
    left behind under a temporary name of the same target is removed.
    """
    target = preflight(path, force=force, size=size)
    part = _beside(target)
    try:
        _remove_stale(target)
        yield part
        on_disk(part)
        _place(part, target, force)
        on_disk(target.parent)
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror or error}; nothing was kept") from error
    finally:
        part.unlink(missing_ok=True)


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


def _place(part: Path, target: Path, force: bool) -> None:
    if force:
        os.replace(part, target)
        return
    try:
        os.link(part, target)  # unlike a rename, fails where another process was first
    except FileExistsError:
        raise StoreError(f"{target} appeared while the result was made; nothing was overwritten") from None
    except OSError:  # a file system without hard links
        if target.exists():
            raise StoreError(f"{target} appeared while the result was made; nothing was overwritten") from None
        os.replace(part, target)
