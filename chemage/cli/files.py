"""The files beside a result: what may be overwritten, and the folder of its figures."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from chemage.cli.options import user_error

if TYPE_CHECKING:
    from chemage.foundation.result import Result
    from chemage.scene.scene import Scene


def figures_of(path: Path) -> Path:
    """The folder of the figures of a result file."""
    return path.with_name(f"{path.stem}-figures")


def drawn(result: Result, path: Path) -> list[Path]:
    """Draw the figures of a result beside its file; a new folder gets its name when all of them are in it."""
    from chemage.foundation.figures import save_figures
    from chemage.results.drawing import figures

    folder, named = figures_of(path), figures(result)
    if folder.exists():
        return save_figures(named, folder, force=True)
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        pictures = save_figures(named, part)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [folder / picture.name for picture in pictures]


def save_picture(result: Result, file: Path, *, force: bool) -> None:
    """Draw the first picture of a result into a file, in the format of its ending."""
    from chemage.foundation.files import fresh_file
    from chemage.foundation.result import drawn_picture

    (picture, *_) = result.pictures().values()
    with fresh_file(file, force=force) as part:
        drawn_picture(picture).savefig(part, format=file.suffix.removeprefix(".").lower() or "png")


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
