"""The files beside a result: what may be overwritten, and the folder of its figures."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from chemage.cli.options import user_error

if TYPE_CHECKING:
    from chemage.scene.scene import Scene


def figures_of(path: Path) -> Path:
    """The folder of the figures of a result file."""
    return path.with_name(f"{path.stem}-figures")


def drawn(save: Callable[..., list[Path]], folder: Path) -> list[Path]:
    """Draw figures with ``save(folder, force=...)``; a new folder gets its name when all of them are in it."""
    if folder.exists():
        return save(folder, force=True)
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        pictures = save(part)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [folder / picture.name for picture in pictures]


def protect_inputs(path: Path, source: str, one: Scene) -> None:
    """Refuse to overwrite the scene file, or a file that the scene reads, even with ``--force``."""
    read = [part["path"] for part in one.todict().values() if isinstance(part, dict) and "path" in part]
    for name in (source, *read):
        if "\0" not in str(name) and os.path.realpath(name) == os.path.realpath(path):
            raise user_error(f"{path} is an input of this scene; choose another --out")


def preflight_folder(folder: Path, force: bool) -> None:
    """Refuse a folder for figures that cannot be one, or that exists, unless ``force``."""
    if folder.is_symlink():
        raise user_error(f"{folder}, the folder for the figures, is a link; remove it, or choose another --out")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise user_error(f"{folder}, the folder for the figures, is a file; choose another --out, or --no-figures")
    if not force and any(folder.iterdir()):
        raise user_error(f"{folder} is already there; choose another --out, or overwrite it with --force")


@contextmanager
def result_written(path: Path) -> Iterator[None]:
    """Add to the errors of a block that the result itself has been written to ``path``."""
    from chemage.foundation.errors import StoreError

    try:
        yield
    except StoreError as error:
        raise StoreError(f"{error}\nthe result itself is in {path}; `chemage plot {path}` draws its figures") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the result is in {path}, but its figures are incomplete") from None
