"""Where compiled kernels are kept between runs: where numba would keep them, or a temporary folder if it could not."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def provide() -> None:
    """Set ``NUMBA_CACHE_DIR`` to a temporary folder of this user if numba could write to none of its own places.

    Otherwise numba refuses to import any kernel. Called when chemage is imported; it looks at two folders.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if any(map(_writable, [Path(given)] if given else _of_numba())):
        return
    folder = _temporary()
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def places() -> list[str]:
    """Where numba keeps kernels: the folder that was chosen for it, or the first of its own that it can write to."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return [given]
    beside, home = _of_numba()
    return [f"{Path(__file__).parents[1]} (beside the source files)" if _writable(beside) else str(home)]


def folder() -> Path:
    """The folder in which kernels of this package are kept, or would be; other things measured once lie beside them."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    beside, home = _of_numba()
    return Path(given) if given else beside if _writable(beside) else home


def empty() -> bool:
    """Whether no kernel of chemage is kept yet; it looks at two folders and does not need numba."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return not any(Path(given).glob("foundation_*/random.*.nbi"))
    beside, home = _of_numba()
    return not any(beside.glob("random.*.nbi")) and not any(home.glob("foundation_*/random.*.nbi"))


def _of_numba() -> list[Path]:
    """Where numba keeps kernels if it is not told: beside the source, or in the cache folder of the user."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return [Path(__file__).parents[1] / "foundation" / "__pycache__", Path(home) / "numba"]


def _writable(folder: Path) -> bool:
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def _temporary() -> Path:
    import tempfile

    user = str(os.getuid()) if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"chemage-kernels-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        # compiled code is executed, so that nobody else may be able to put any there
        ours = os.name != "posix" or (status.st_uid == os.getuid() and not status.st_mode & 0o022)
        if ours and not folder.is_symlink():
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="chemage-kernels-"))
