"""Results on disk: one HDF5 file each, in the layout of NetCDF4, written whole or not at all.

Each object is a group (``surface``, ``contact``, ``lattice``, ``history``, ``aging``), so that
``xarray.open_dataset(path, group="aging")`` reads it. The root holds what the run was: scene, keys, versions, timings.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from chemage.ageing.aging import Aging
from chemage.ageing.derived import derived
from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.foundation.codec import Derived, is_ours, read_records, write_records
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.inputs import regular_file
from chemage.foundation.records import Record
from chemage.foundation.text import with_article
from chemage.inference.curves import MeasuredCurve
from chemage.inference.forecast import Forecast
from chemage.inference.result import Inference
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


def write(path: str | os.PathLike[str], thing: Any, *, force: bool = False) -> None:
    """Write a chemage object, or a finished run, to an HDF5 file.

    Raises
    ------
    InputError
        ``thing`` is nothing that can be stored.
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    more: dict[str, Derived] = {}
    if isinstance(thing, Run):
        parts, attributes = thing.parts(), thing.attributes()
        if thing.aging is not None:
            more["aging"] = derived(thing.aging, thing.window)
    else:
        names = [name for name, cls in GROUPS.items() if type(thing) is cls]
        if not names:
            raise InputError(
                f"cannot store {with_article(type(thing).__name__)}; give a chemage object such as an Aging, or a Run"
            )
        parts, attributes = {names[0]: thing}, {}
        if isinstance(thing, Aging):
            more["aging"] = derived(thing)
    write_records(path, parts, attributes, derived=more, force=force)


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
    try:
        there = source.exists()
    except (OSError, ValueError):  # a loop of links, a null byte in the name
        there = True
    if not there:
        raise StoreError(f"{source} does not exist")
    if source.is_dir():
        raise StoreError(f"{source} is a folder; name a file")
    regular_file(source)
    if not is_ours(source):
        return reader_for(source).read(source)
    groups = GROUPS if maps else {name: cls for name, cls in GROUPS.items() if name != "surface"}
    parts, attributes = read_records(source, groups)
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
