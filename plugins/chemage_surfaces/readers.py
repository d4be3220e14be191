"""Readers of height maps: numpy files, text tables, HDF5.

Heights in the files are in nm. The option ``pixel_size`` overrides the pixel size in a file.
"""

from __future__ import annotations

import math
import re
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from chemage import InputError, Length, Reader, StoreError, Surface, convert
from chemage.foundation.tables import data_lines, numbers, read_text, separator_of

if TYPE_CHECKING:
    import h5py


def _open_error(path: str | PathLike[str], error: OSError) -> StoreError:
    return StoreError(f"{path}: {error.strerror or error}")


def as_surface(
    heights: Any, source: str, *, pixel_size: float | None, stated: object = None, periodic: bool = False
) -> Surface:
    """Make a Surface of the array ``heights`` (nx, ny) nm that was read from ``source``.

    ``pixel_size`` (nm) is that of the user and overrides ``stated``, the value in the file: a number in nm, or a string
    with its unit.

    Raises
    ------
    StoreError
        The array is not two-dimensional or does not consist of real numbers.
    InputError
        Heights are missing (NaN) or infinite, or the pixel size is unknown.
    """
    heights = np.asarray(heights)
    if heights.dtype.kind not in "fiub":
        raise StoreError(f"{source} holds {heights.dtype} values; heights are real numbers")
    if heights.ndim != 2 or heights.size == 0:
        raise StoreError(f"{source} holds an array of shape {heights.shape}; a height map has two dimensions (nx, ny)")
    if heights.dtype.kind != "f" or heights.dtype.itemsize not in (4, 8):
        heights = heights.astype(np.float64)
    bad = np.argwhere(~np.isfinite(heights))
    if bad.size:
        raise InputError(
            f"{source}: {len(bad)} of {heights.size} heights are missing or infinite, the first at pixel "
            f"({bad[0, 0]}, {bad[0, 1]}); fill or crop missing data first"
        )
    if pixel_size is None:
        if stated is None:
            raise InputError(f'pixel_size: {source} does not state one; give it, such as pixel_size = "0.45 nm"')
        pixel_size = convert(stated, "nm")
        if not (math.isfinite(pixel_size) and pixel_size > 0):
            raise StoreError(f"{source} states a pixel size of {stated!r}; give pixel_size")
    # a copy in the byte order of this machine
    heights = np.array(heights, dtype=np.float32 if heights.dtype.itemsize == 4 else np.float64, order="C")
    heights.setflags(write=False)
    return Surface(heights=heights, pixel_size=pixel_size, periodic=periodic)


class Npy(Reader):
    """A two-dimensional array saved with ``numpy.save``, which has no pixel size."""

    kind = "npy"
    suffixes: ClassVar[tuple[str, ...]] = (".npy",)

    pixel_size: Length | None = None
    """edge of a pixel, nm"""

    def read(self, path: str | PathLike[str]) -> Surface:
        """Read the surface (heights in nm, not periodic).

        Raises
        ------
        StoreError
            The file is missing, truncated, or not a numpy array of real numbers.
        InputError
            The pixel size is unknown, or heights are not finite.
        """
        try:
            with open(path, "rb") as file:
                if file.read(6) != b"\x93NUMPY":
                    raise StoreError(f"{path} is not a numpy (.npy) file")
                file.seek(0)
                heights = np.load(file, allow_pickle=False)
        except OSError as error:
            if isinstance(error, StoreError):
                raise
            raise _open_error(path, error) from None
        except (ValueError, EOFError, SyntaxError) as error:
            raise StoreError(f"{path} is truncated or not a plain array of numbers ({error})") from None
        return as_surface(heights, str(path), pixel_size=self.pixel_size)


#: the pixel size in a comment of a text file
_STATED = re.compile(r"pixel[ _]size\s*[:=]\s*(?P<value>[^,;]+?)\s*$", re.IGNORECASE)


class Text(Reader):
    """A table of heights with one row of pixels per line: line i, column j is pixel (i, j).

    Columns are separated by commas, semicolons, tabs or blanks. Lines that begin with ``#`` or ``%`` are comments; the
    comment ``# pixel_size = 0.45 nm`` gives the pixel size.
    """

    kind = "text"
    suffixes: ClassVar[tuple[str, ...]] = (".txt", ".dat", ".csv", ".tsv", ".asc")

    pixel_size: Length | None = None
    """edge of a pixel, nm"""
    delimiter: str | None = None
    """separator of columns; None: comma, semicolon or tab, whichever the first row contains, else blanks"""
    comments: str = "#%"
    """characters that begin a comment"""

    def read(self, path: str | PathLike[str]) -> Surface:
        """Read the surface (heights in nm, not periodic).

        Raises
        ------
        StoreError
            The file is missing, or not a table of numbers with rows of equal length.
        InputError
            The pixel size is unknown, or heights are not finite.
        """
        text = read_text(path)
        lines = data_lines(text, self.comments)
        if not lines:
            raise StoreError(f"{path} holds no numbers")
        heights = numbers(lines, str(path), self.delimiter or separator_of(lines[0][1]))
        header = (line for line in text.splitlines()[: lines[0][0]] if line.strip()[:1] in tuple(self.comments))
        stated = [match["value"] for line in header if (match := _STATED.search(line))]
        return as_surface(heights, str(path), pixel_size=self.pixel_size, stated=stated[-1] if stated else None)


class Hdf5(Reader):
    """A two-dimensional dataset of an HDF5 (or NetCDF-4) file.

    The attributes ``pixel_size`` (nm, or a string with its unit) and ``periodic`` are read from the dataset, else from
    its group, else from the file.
    """

    kind = "hdf5"
    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5", ".hdf", ".nc")

    pixel_size: Length | None = None
    """edge of a pixel, nm"""
    dataset: str | None = None
    """name of the dataset, such as "surface/heights"; None: the only two-dimensional dataset of numbers"""

    def read(self, path: str | PathLike[str]) -> Surface:
        """Read the surface (heights in nm).

        Raises
        ------
        StoreError
            The file is missing, truncated, or not HDF5; the dataset is missing or not a map of numbers.
        InputError
            The pixel size is unknown, heights are not finite, or it is unclear which dataset is meant.
        """
        import h5py

        try:
            # for a missing file the message of h5py is a paragraph
            with open(path, "rb"):
                pass
            with h5py.File(path, "r") as file:
                node = self._find(file, path)
                attributes = {
                    name: holder.attrs[name]
                    for holder in (file, node.parent, node)
                    for name in ("pixel_size", "periodic")
                    if name in holder.attrs
                }
                heights, name = node[()], f"{path}:{node.name}"
        except (StoreError, InputError):
            raise
        except OSError as error:
            if error.strerror and "unable to" not in str(error).lower():
                raise _open_error(path, error) from None
            raise StoreError(f"{path} is not an HDF5 file, or is truncated") from None
        stated = attributes.get("pixel_size")
        if isinstance(stated, np.ndarray) and stated.size == 1:
            stated = stated.item()
        return as_surface(
            heights, name, pixel_size=self.pixel_size, stated=stated, periodic=bool(attributes.get("periodic", False))
        )

    def _find(self, file: h5py.File, path: str | PathLike[str]) -> h5py.Dataset:
        import h5py

        maps: list[str] = []

        def visit(name: str, node: Any) -> None:
            if isinstance(node, h5py.Dataset) and node.ndim == 2 and node.dtype.kind in "fiu":
                maps.append(name)

        if self.dataset is not None:
            node = file.get(self.dataset)
            if isinstance(node, h5py.Dataset):
                return node
            problem = f"{path} has no dataset {self.dataset!r}"
        else:
            problem = f"{path}: which dataset holds the heights?"
        file.visititems(visit)
        if self.dataset is None and len(maps) == 1:
            return file[maps[0]]  # pyright: ignore[reportReturnType]
        known = ", ".join(maps) or "none"
        error = InputError if self.dataset is None and maps else StoreError
        raise error(f"{problem}; two-dimensional datasets of numbers in it: {known}")
