"""Results on disk: one HDF5 file, in the layout of NetCDF4, written whole or not at all.

Each object is a group (``surface``, ``contact``, ``lattice``, ``history``, ``aging``); its arrays are variables with
named dimensions and units, the rest are attributes, so ``xarray.open_dataset(path, group="aging")`` reads it. The root
holds what the run was: scene, hashes, versions, seeds, timings.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import shutil
import socket
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from chemage.errors import InputError, StoreError
from chemage.objects import Aging, BondHistory, ContactSolution, ReactionLattice, Record, Surface
from chemage.results import Run

GROUPS: dict[str, type[Record]] = {
    "surface": Surface,
    "contact": ContactSolution,
    "lattice": ReactionLattice,
    "history": BondHistory,
    "aging": Aging,
}
#: layout of the file; a reader refuses a newer one
FORMAT = 1


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
        _place(part, target, force)
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror or error}; nothing was kept") from error
    finally:
        part.unlink(missing_ok=True)


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


# -- writing ----------------------------------------------------------------------------------------------------------


def write(path: str | os.PathLike[str], thing: Any, *, force: bool = False) -> None:
    """Write a chemage object, or a finished run, to an HDF5 file.

    Raises
    ------
    InputError
        ``thing`` is nothing that can be stored.
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """

    if isinstance(thing, Run):
        parts, attributes = thing.parts(), thing.attributes()
    else:
        names = [name for name, cls in GROUPS.items() if type(thing) is cls]
        if not names:
            raise InputError(f"cannot store a {type(thing).__name__}; give a chemage object such as an Aging, or a Run")
        parts, attributes = {names[0]: thing}, {}
    write_parts(path, parts, attributes, force=force)


def write_parts(
    path: str | os.PathLike[str], parts: Mapping[str, Record], attributes: Mapping[str, Any], *, force: bool = False
) -> None:
    """Write named objects (names from ``GROUPS``) and root attributes (strings, numbers) to ``path``."""
    import h5netcdf

    import chemage

    arrays = [v for part in parts.values() for v in part.todict().values() if isinstance(v, np.ndarray)]
    size = sum(0.02 * array.nbytes if _compresses(array) else array.nbytes for array in arrays)
    with fresh_file(path, force=force, size=size) as part_path:
        # made in memory and written at one go: HDF5 crashes the process when the disk fills up under it
        image = io.BytesIO()
        with h5netcdf.File(image, "w") as file:
            file.attrs["chemage"] = chemage.__version__
            file.attrs["chemage_format"] = FORMAT
            file.attrs["Conventions"] = "CF-1.8"
            for name, value in attributes.items():
                file.attrs[name] = value
            for name, part in parts.items():
                _write_record(file.create_group(name), part)
        part_path.write_bytes(image.getbuffer())


def _write_record(group: Any, record: Record) -> None:
    group.attrs["chemage_object"] = type(record).__name__
    group.attrs["digest"] = record.digest()
    for name, value in record.todict().items():
        if value is None:
            continue
        if isinstance(value, np.ndarray):
            dims, unit, meaning = record.arrays[name]
            _write_array(group, name, value, dims, {"units": unit or "1", "long_name": meaning})
        elif isinstance(value, dict) and value and all(isinstance(v, np.ndarray) for v in value.values()):
            folder = group.create_group(name)
            for key, array in value.items():
                _write_array(folder, key, array, tuple(f"{key}_{axis}" for axis in range(array.ndim)), {})
        elif isinstance(value, dict | tuple):
            group.attrs[name] = json.dumps(value, default=_as_json)
        else:
            group.attrs[name] = int(value) if isinstance(value, bool) else value
    if isinstance(record, Surface | ContactSolution):
        _write_grid(group, record)


def _as_json(value: Any) -> Any:
    """What a plugin put among plain values: a number or list where numpy's, else its text."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def _write_grid(group: Any, record: Surface | ContactSolution) -> None:
    for axis, name in enumerate("xy"):
        centres = (np.arange(record.shape[axis]) + 0.5) * record.pixel_size
        _write_array(group, name, centres, (name,), {"units": "nm", "long_name": "pixel centre"})


def _write_array(group: Any, name: str, values: np.ndarray, dims: tuple[str, ...], attributes: dict[str, str]) -> None:
    for dim, length in zip(dims, values.shape, strict=True):
        if dim not in group.dimensions:
            group.dimensions[dim] = length
    if values.dtype == np.bool_:
        values, attributes = values.astype(np.int8), {**attributes, "dtype": "bool"}
    options: dict[str, Any] = {}
    if _compresses(values):
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    variable = group.create_variable(name, dims, values.dtype, data=values, **options)
    for key, value in attributes.items():
        variable.attrs[key] = value


def _compresses(values: np.ndarray) -> bool:
    # noise does not compress and costs seconds; a pressure map is mostly zeros and shrinks a hundredfold
    return bool(values.nbytes > 1 << 20 and np.count_nonzero(values) < values.size // 2)


# -- reading ----------------------------------------------------------------------------------------------------------


def read(path: str | os.PathLike[str]) -> Any:
    """What is in a file: the object :func:`write` put there, a finished :class:`chemage.Run`, or, for other formats,
    whatever an installed reader makes of it (a surface from ``.npy``, say).

    Raises
    ------
    StoreError
        The file is missing, truncated, or neither ours nor of a format some reader knows.
    """
    source = Path(path)
    if not source.exists():
        raise StoreError(f"{source} does not exist")
    if source.is_dir():
        raise StoreError(f"{source} is a folder; name a file")
    if not is_ours(source):
        return _read_foreign(source)
    parts, attributes = read_parts(source)
    if "scene" in attributes:
        try:
            return Run.from_parts(parts, attributes)
        except StoreError as error:
            raise StoreError(f"{source}: {error}") from error
    if len(parts) != 1:
        raise StoreError(f"{source} holds {', '.join(parts) or 'nothing'}; expected one object or a run")
    return next(iter(parts.values()))


def is_ours(path: Path) -> bool:
    """Whether ``path`` is a chemage file; a damaged HDF5 file is an error."""
    import h5py

    try:
        with open(path, "rb") as stream:
            if stream.read(8) != b"\x89HDF\r\n\x1a\n":
                return False
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from error
    with _opened(path) as file:
        return isinstance(file, h5py.File) and "chemage_format" in file.attrs


@contextlib.contextmanager
def _damaged(path: Path) -> Iterator[None]:
    """What h5py raises on a damaged file depends on which byte is wrong."""
    try:
        yield
    except StoreError:
        raise
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise StoreError(f"{path} is damaged: {' '.join(str(error).split())}") from error


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import h5py

    try:
        file = h5py.File(path, "r")
    except (OSError, KeyError) as error:
        raise StoreError(f"{path} cannot be read: it is damaged or was cut short ({error})") from error
    with _damaged(path), file:
        yield file


def read_parts(path: str | os.PathLike[str], only: set[str] | None = None) -> tuple[dict[str, Record], dict[str, Any]]:
    """The objects in a chemage file by group name (all, or ``only`` some), and its root attributes."""
    source = Path(path)
    if not source.exists():
        raise StoreError(f"{source} does not exist")
    with _opened(source) as file:
        if "chemage_format" not in file.attrs:
            raise StoreError(f"{source} is an HDF5 file, but not one of chemage's")
        attributes = {name: _plain(value) for name, value in file.attrs.items() if not name.startswith("_")}
        if int(attributes["chemage_format"]) > FORMAT:
            raise StoreError(f"{source} was written by chemage {attributes.get('chemage')}; update chemage to read it")
        parts = {
            name: _read_record(file[name], cls)
            for name, cls in GROUPS.items()
            if name in file and (only is None or name in only)
        }
    return parts, attributes


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.size == 1:
        return value.ravel()[0].item()
    return value.item() if isinstance(value, np.generic) else value


def _read_record(group: Any, cls: type[Record]) -> Record:
    import h5py

    fields: dict[str, Any] = {}
    for name, info in cls.model_fields.items():
        if name in group:
            item = group[name]
            fields[name] = (
                _read_array(item)
                if isinstance(item, h5py.Dataset)
                else {key: _read_array(item[key]) for key in item if _is_variable(item[key])}
            )
        elif name in group.attrs:
            value = _plain(group.attrs[name])
            if isinstance(value, str) and _holds_json(info.annotation):
                value = json.loads(value)
            fields[name] = value
    return cls(**fields)


def _is_variable(dataset: Any) -> bool:
    label = dataset.attrs.get("NAME", b"")
    return not bytes(label).startswith(b"This is a netCDF dimension but not a netCDF variable")


def _holds_json(annotation: Any) -> bool:
    origins = {typing.get_origin(part) or part for part in (annotation, *typing.get_args(annotation))}
    return bool(origins & {dict, tuple})


def _read_array(dataset: Any) -> np.ndarray:
    values = dataset[()]
    if _plain(dataset.attrs.get("dtype", "")) == "bool":
        values = values.astype(np.bool_)
    values = np.asarray(values)
    values.setflags(write=False)
    return values


def _read_foreign(path: Path) -> Any:
    from chemage import registry

    plugins = registry.current()
    readers = [plugins.choice("reader", kind) for kind in plugins.kinds("reader")]
    for reader in readers:
        if path.suffix.lower() in reader.suffixes:
            return reader().read(path)
    known = sorted({suffix for reader in readers for suffix in reader.suffixes})
    raise StoreError(
        f"{path} is not a chemage file, and no reader knows {path.suffix or 'a file without ending'}; "
        f"known endings: .h5, {', '.join(known)}"
    )
