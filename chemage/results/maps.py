"""Maps of a result file, read in parts: a contact of 16384 x 16384 pixels is looked at without loading it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from chemage.foundation.container import opened
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.files import regular_file

#: the maps that a result file may hold
MAPS = ("surface/heights", "contact/pressure", "contact/gap")
#: rows that are read at once
_ROWS = 512


class StoredMap:
    """One map of an open file; ``stored[i0:i1, j0:j1]`` reads that part alone."""

    def __init__(self, name: str, data: Any, pixel_size: float) -> None:
        self._name, self._data = name, data
        #: edge of a pixel, nm
        self.pixel_size = pixel_size

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny) pixels."""
        nx, ny = self._data.shape
        return nx, ny

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return str(self._data.attrs["units"])

    def __getitem__(self, part: tuple[slice, slice]) -> np.ndarray:
        """Read a part, such as ``[1000:1400, 0:400]``, or ``[::16, ::16]`` for a coarse view of everything.

        Raises
        ------
        InputError
            ``part`` is not two slices with steps above zero.
        DamagedError
            The part cannot be read.
        """
        two = isinstance(part, tuple) and len(part) == 2 and all(isinstance(one, slice) for one in part)
        if not two or any(one.step is not None and one.step < 1 for one in part):
            raise InputError.of(self._name, part, "is no part of a map", "give two slices, such as [0:512, 0:512]")
        (first, last, every), (left, right, step) = (
            one.indices(length) for one, length in zip(part, self.shape, strict=True)
        )
        values = np.empty((len(range(first, last, every)), len(range(left, right, step))), self._data.dtype)
        if values.size:
            # HDF5 reads every n-th number one by one: a band of rows is read whole
            height = max(1, _ROWS // every)
            for row in range(0, values.shape[0], height):
                begin = first + row * every
                band = self._data[begin : min(begin + height * every, last), left:right]
                values[row : row + height] = band[::every, ::step]
        return values

    def __repr__(self) -> str:
        return f"<StoredMap {self._name} {self.shape[0]}x{self.shape[1]} pixels of {self.pixel_size:g} nm>"


@contextmanager
def open_maps(path: str | os.PathLike[str]) -> Iterator[Mapping[str, StoredMap]]:
    """Open the maps of a result file for reading in parts: ``surface/heights``, ``contact/pressure``, ``contact/gap``.

    The checksums of the whole file are compared once, when it is opened; this reads every byte, but keeps none. ::

        with ca.open_maps("rough.h5") as maps:
            corner = maps["contact/pressure"][0:512, 0:512]     # GPa

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or has no map.
    DamagedError
        What it holds is not what was written.
    """
    source = Path(path)
    if source.exists():
        regular_file(source)
    with opened(source) as file:
        found = {
            name: StoredMap(name, file[name], float(np.ravel(file[name.partition("/")[0]].attrs["pixel_size"])[0]))
            for name in MAPS
            if name in file
        }
        if not found:
            raise StoreError(f"{source} holds no map; `chemage run` writes files with maps")
        yield found
