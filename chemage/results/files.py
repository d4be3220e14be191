"""Results on disk, one container each; maps of them in parts; an inference with its forecasts.

Each object is a group (``surface``, ``contact``, ``lattice``, ``history``, ``aging``), so that
``xarray.open_dataset(path, group="aging")`` reads it. The root holds what the run was: scene, keys, versions, timings.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging, derived
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation import container
from chemage.foundation.codec import Derived
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.records import Record
from chemage.foundation.text import with_article
from chemage.inference.curves import MeasuredCurve
from chemage.inference.forecast import Forecast
from chemage.inference.result import MOST_FORECASTS, Inference, InferenceResult
from chemage.kinetics.history import BondHistory
from chemage.lattices.lattice import ReactionLattice
from chemage.scene.run import Run
from chemage.studies.ensembles.ensemble import Ensemble
from chemage.surfaces.reading import reader_for
from chemage.surfaces.surface import Surface

GROUPS: dict[str, type[Record]] = {
    "surface": Surface,
    "contact": ContactSolution,
    "statistics": ContactStatistics,
    "lattice": ReactionLattice,
    "history": BondHistory,
    "aging": Aging,
    "ensemble": Ensemble,
    "curve": MeasuredCurve,
    "inference": Inference,
    "forecast": Forecast,
}
_FORECASTS = [f"forecast_{number}" for number in range(1, MOST_FORECASTS + 1)]
_OF_INFERENCE: dict[str, type[Record]] = {"inference": Inference, **dict.fromkeys(_FORECASTS, Forecast)}
#: the maps that a file may hold
MAPS = ("surface/heights", "contact/pressure", "contact/gap")
#: rows of a map that are read at once
_ROWS = 512


def write(path: str | os.PathLike[str], result: Any, *, force: bool = False) -> None:
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
        if result.aging is not None:
            more["aging"] = derived(result.aging, result.window)
    else:
        names = [name for name, cls in GROUPS.items() if type(result) is cls]
        if not names:
            raise InputError(
                f"cannot store {with_article(type(result).__name__)}; give a chemage object such as an Aging, or a Run"
            )
        parts, attributes = {names[0]: result}, {}
        if isinstance(result, Aging):
            more["aging"] = derived(result)
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
    groups = GROUPS if maps else {name: cls for name, cls in GROUPS.items() if name != "surface"}
    parts, attributes = container.read(source, groups)
    if "scene" in attributes:
        try:
            return Run.from_parts(parts, attributes)
        except StoreError as error:
            raise StoreError(f"{source}: {error}") from error
    if not parts and not maps:
        return read(source)
    if len(parts) != 1:
        raise StoreError(f"{source} holds {', '.join(parts) or 'nothing'}; expected one object or a run")
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
        two = isinstance(part, tuple) and len(part) == 2 and all(isinstance(axis, slice) for axis in part)
        if not two or any(axis.step is not None and axis.step < 1 for axis in part):
            raise InputError.of(self._name, part, "is no part of a map", "give two slices, such as [0:512, 0:512]")
        (first, last, every), (left, right, step) = (
            axis.indices(length) for axis, length in zip(part, self.shape, strict=True)
        )
        values = np.empty((len(range(first, last, every)), len(range(left, right, step))), self._data.dtype)
        if values.size:
            # HDF5 reads every n-th number one by one: a band of rows is read whole
            height = max(1, _ROWS // every)
            for row in range(0, values.shape[0], height):
                begin = first + row * every
                with container.decoding(self._data.file.filename, self._name):
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
    with container.opened(source) as file:
        stored = {
            name: StoredMap(name, file[name], float(np.ravel(file[name.partition("/")[0]].attrs["pixel_size"])[0]))
            for name in MAPS
            if name in file
        }
        if not stored:
            raise StoreError(f"{source} holds no map; `chemage run` writes files with maps")
        yield stored


# -- inference --------------------------------------------------------------------------------------------------------


def write_inference(path: str | os.PathLike[str], result: InferenceResult, *, force: bool = False) -> None:
    """Write an inference with its forecasts and planned measurements.

    Raises
    ------
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    asked = {"labels": list(result.forecasts), "experiments": list(result.experiments), "target": result.target}
    container.write(path, result.parts(), {"asked": json.dumps(asked)}, force=force)


def read_inference(path: str | os.PathLike[str]) -> InferenceResult:
    """The inverse of :func:`write_inference`; of a file with an inference alone, that.

    Raises
    ------
    StoreError
        The file is missing, damaged, or holds no inference.
    """
    parts, attributes = container.read(path, _OF_INFERENCE)
    inference = parts.pop("inference", None)
    if inference is None:
        raise StoreError(f"{path} holds no inference; `chemage infer` makes such files")
    try:
        asked = json.loads(attributes.get("asked", "{}"))
        labels = asked.get("labels", [])
        experiments, target = tuple(asked.get("experiments", ())), str(asked.get("target", ""))
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise StoreError(f"{path}: what was asked of the inference cannot be read: {error}") from error
    labels += [f"forecast {number}" for number in range(len(labels) + 1, len(parts) + 1)]
    return InferenceResult(inference, dict(zip(labels, parts.values(), strict=False)), experiments, target)
