"""Results on disk, one container each; maps of them in parts.

Each object is a group (``surface``, ``contact``, ``lattice``, ``history``, ``ageing``), so that
``xarray.open_dataset(path, group="ageing")`` reads it. The root holds what the run was: scene, keys, versions, timings.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.ageing import Ageing, derived
from chemage.foundation import container
from chemage.foundation.codec import Derived
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.text import with_article
from chemage.plugins import registry
from chemage.scene.run import Run
from chemage.surfaces.reading import reader_for

#: group of a file -> the class of its record; those of plugins come from the hook ``chemage_results``
GROUPS = {
    "surface": "chemage.surfaces.surface:Surface",
    "contact": "chemage.contacts.solution:ContactSolution",
    "statistics": "chemage.contacts.solution:ContactStatistics",
    "lattice": "chemage.lattices.lattice:ReactionLattice",
    "history": "chemage.kinetics.history:BondHistory",
    "ageing": "chemage.ageing.ageing:Ageing",
    "ensemble": "chemage.studies.ensembles.ensemble:Ensemble",
}
#: the maps that a file may hold
MAPS = ("surface/heights", "contact/pressure", "contact/gap")
#: rows of a map that are read at once
_ROWS = 512


def _groups() -> dict[str, str]:
    return registry.current().offered("results") | GROUPS


def write(
    path: str | os.PathLike[str], result: Any, *, force: bool = False
) -> None:
    """Write a chemage object, or a finished run, to an HDF5 file.

    Raises
    ------
    InputError
        ``result`` is nothing that can be stored.
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    more: dict[str, Derived] = {}
    if isinstance(result, Run):
        parts, attributes = result.parts(), result.attributes()
        if result.ageing is not None:
            more["ageing"] = derived(result.ageing, result.window)
    else:
        cls = type(result)
        target = f"{cls.__module__}:{cls.__qualname__}"
        names = [name for name, known in _groups().items() if known == target]
        if not names:
            raise InputError(
                f"cannot store {with_article(cls.__name__)}; give a chemage object such as an Ageing, or a Run"
            )
        parts, attributes = {names[0]: result}, {}
        if isinstance(result, Ageing):
            more["ageing"] = derived(result)
    container.write(path, parts, attributes, derived=more, force=force)


def read(path: str | os.PathLike[str], *, maps: bool = True) -> Any:
    """Read a file: the object :func:`write` put there, a finished :class:`chemage.Run`, or, for other formats, what an
    installed reader makes of it (a surface from ``.npy``, say).

    Without ``maps`` the surface is left out of a run.

    Raises
    ------
    StoreError
        The file is missing, truncated, or neither chemage's nor of a format that some reader knows.
    """
    source = Path(path)
    if not container.is_ours(source):
        return reader_for(source).read(source)
    groups = _groups()
    if not maps:
        del groups["surface"]
    parts, attributes = container.read(source, groups)
    if "scene" in attributes:
        try:
            return Run.from_parts(parts, attributes)
        except StoreError as error:
            raise StoreError(f"{source}: {error}") from error
    if not parts and not maps:
        return read(source)
    if len(parts) != 1:
        raise StoreError(
            f"{source} holds {', '.join(parts) or 'nothing'}; expected one object or a run"
        )
    return next(iter(parts.values()))


# -- maps in parts ----------------------------------------------------------------------------------------------------


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
        two = (
            isinstance(part, tuple)
            and len(part) == 2
            and all(isinstance(axis, slice) for axis in part)
        )
        if not two or any(axis.step is not None and axis.step < 1 for axis in part):
            raise InputError.of(
                self._name,
                part,
                "is no part of a map",
                "give two slices, such as [0:512, 0:512]",
            )
        (first, last, every), (left, right, step) = (
            axis.indices(length)
            for axis, length in zip(part, self.shape, strict=True)
        )
        values = np.empty(
            (len(range(first, last, every)), len(range(left, right, step))),
            self._data.dtype,
        )
        if values.size:
            # HDF5 reads every n-th number one by one: a band of rows is read whole
            height = max(1, _ROWS // every)
            for row in range(0, values.shape[0], height):
                begin = first + row * every
                with container.decoding(self._data.file.filename, self._name):
                    band = self._data[
                        begin : min(begin + height * every, last), left:right
                    ]
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
    with container.opened(source) as file:
        stored = {
            name: StoredMap(
                name,
                file[name],
                float(
                    np.ravel(file[name.partition("/")[0]].attrs["pixel_size"])[0]
                ),
            )
            for name in MAPS
            if name in file
        }
        if not stored:
            raise StoreError(
                f"{source} holds no map; `chemage run` writes files with maps"
            )
        yield stored
