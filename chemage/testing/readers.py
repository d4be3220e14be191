"""Checks of a reader of files."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from chemage.foundation.errors import ChemageError
from chemage.foundation.records import Record
from chemage.surfaces.reading import Reader
from chemage.surfaces.surface import Surface
from chemage.testing.checks import check_of, refuses, require, speed_changes_nothing, whole

check_reader = whole(
    Reader,
    path="a file that the reader can read",
    surface="the Surface in this file: heights in nm, pixel size and whether it is periodic, known from elsewhere",
)


@check_of("reader")
def _suffixes_are_named(component: Reader, path: Any = None) -> None:
    """``suffixes`` names the file endings that the reader accepts, in lower case and with the dot."""
    suffixes = type(component).suffixes
    require(isinstance(suffixes, tuple) and suffixes, f"suffixes = {suffixes!r}: name the file endings that it reads")
    require(
        all(isinstance(s, str) and s.startswith(".") and s == s.lower() and len(s) > 1 for s in suffixes),
        f"{suffixes}: lower case, with the dot",
    )
    if path is not None:
        ending = Path(path).suffix.lower()
        require(ending in suffixes, f"the file ends in {ending!r}, but suffixes = {suffixes}")


@check_of("reader")
def _bad_files_are_refused(component: Reader, path: Any = None) -> None:
    """A missing, empty or truncated file, or one of another format, raises a ChemageError that names the file."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        suffix = type(component).suffixes[0]
        files = {"missing": folder / f"missing{suffix}", "folder": folder}
        contents = {"empty": b"", "foreign": b"\x89not this format at all\r\n\x1a\n\x00" * 20}
        if path is not None:
            good = Path(path).read_bytes()
            contents["truncated"] = good[: len(good) // 2]
            suffix = Path(path).suffix
        for label, content in contents.items():
            files[label] = folder / f"{label}{suffix}"
            files[label].write_bytes(content)
        for label, file in files.items():
            message = refuses(f"a {label} file", lambda file=file: component.read(file), ChemageError)
            require(file.name in message, f"a {label} file: the message does not name it: {message}")


@check_of("reader", needs=("path",))
def _reads_its_file(component: Reader, path: Any = None) -> None:
    """The file is read into a Surface or another object of chemage, the same each time, and stays as it was."""
    before = Path(path).read_bytes()
    first = component.read(path)
    require(Path(path).read_bytes() == before, "reading changed the file")
    require(
        isinstance(first, Record),
        f"read() returned {'None' if first is None else type(first).__name__}; expected a chemage.Surface (or another "
        "object of chemage)",
    )
    require(first == component.read(str(path)), "reading the file as Path and as str gave different objects")
    require(first == component.read(Path(path)), "reading the file twice gave different objects")


@check_of("reader", needs=("path",))
def _file_is_in_nm(component: Reader, path: Any = None) -> None:
    """Heights and pixel size are in nm, as far as it can be told without the surface: slopes are neither below 1e-8 nor
    above 100, and a pixel is between 1e-3 and 1e6 nm."""
    surface = component.read(path)
    if not isinstance(surface, Surface):
        return
    require(
        1e-3 <= surface.pixel_size <= 1e6,
        f"pixels of {surface.pixel_size:.3g} nm; is the pixel size in m or µm? Surface.pixel_size is in nm",
    )
    slope = surface.rms_slope
    require(
        slope == 0 or 1e-8 <= slope <= 100,
        f"an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms, pixels of {surface.pixel_size:.3g} "
        "nm); are heights or pixel size in m? Both are in nm",
    )


@check_of("reader", needs=("path", "surface"))
def _known_surface_is_read(component: Reader, path: Any = None, surface: Surface | None = None) -> None:
    """The file that holds ``surface`` gives just that: heights in nm with x as the first index, pixel size in nm,
    periodicity."""
    read = component.read(path)
    if not isinstance(read, Surface) or surface is None:
        raise AssertionError(f"read() returned {type(read).__name__}; expected a chemage.Surface")
    require(
        read.shape == surface.shape,
        f"{read.shape} pixels (nx, ny), expected {surface.shape}"
        + (": x and y are swapped" if read.shape == surface.shape[::-1] else ""),
    )
    heights, wanted = read.heights.astype(np.float64), surface.heights.astype(np.float64)
    require(_alike(heights, wanted), f"other heights than those in the file{_difference(heights, wanted)}")
    require(
        math.isclose(read.pixel_size, surface.pixel_size, rel_tol=1e-6),
        f"pixels of {read.pixel_size} nm, expected {surface.pixel_size} nm",
    )
    require(
        read.periodic == surface.periodic,
        f"periodic is {read.periodic}, expected {surface.periodic} (the default of chemage.Surface is True)",
    )


def _alike(one: np.ndarray, two: np.ndarray) -> bool:
    """Equal to a ten thousandth of the range, which a format of 16 bits keeps."""
    return one.shape == two.shape and bool(np.abs(one - two).max() <= 1e-4 * max(float(np.ptp(two)), 1e-300))


def _difference(found: np.ndarray, wanted: np.ndarray) -> str:
    """What turns the heights that were read into the expected ones, if it is something simple."""
    turned = {
        "": found,
        "mirrored along x": found[::-1],
        "mirrored along y": found[:, ::-1],
        "turned by 180 degrees": found[::-1, ::-1],
        "transposed": found.T,
        "in another order of rows and columns": found.ravel().reshape(found.shape, order="F"),
    }
    for how, heights in turned.items():
        if heights.shape != wanted.shape:
            continue
        one, two = heights - heights.mean(), wanted - wanted.mean()
        factor = float((one * two).sum() / max(float((two * two).sum()), 1e-300))
        if factor and _alike(one / factor, two):
            parts = [how] if how else []
            if not math.isclose(factor, 1, rel_tol=1e-3):
                parts.append(
                    "upside down" if math.isclose(factor, -1, rel_tol=1e-3) else f"{factor:.4g} times as large"
                )
            elif not parts:
                parts.append(f"{float(heights.mean() - wanted.mean()):.4g} nm higher")
            return ": they are " + " and ".join(parts)
    return f": they differ by up to {np.abs(found - wanted).max():.3g} nm"


@check_of("reader", needs=("path",))
def _stated_pixel_size_counts(component: Reader, path: Any = None) -> None:
    """An option ``pixel_size`` overrides the pixel size in the file; ``speed_only`` options change nothing."""
    stated = component.read(path)
    if "pixel_size" in type(component).model_fields and isinstance(stated, Surface):
        other = component.replace(pixel_size=2.5 * stated.pixel_size).read(path)
        require(
            math.isclose(other.pixel_size, 2.5 * stated.pixel_size),
            f"pixel_size = {2.5 * stated.pixel_size} nm was given, but the surface has pixels of {other.pixel_size} nm",
        )
    speed_changes_nothing(component, lambda variant: variant.read(path), "the surfaces")
