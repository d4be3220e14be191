"""The one codec of stored records: a record as plain values and arrays, and back; in HDF5, in one JSON object, in npz.

Every field of a record is stored, by introspection, so that no container can lose one. In an HDF5 file each record is a
group in the layout of NetCDF4: its arrays are variables with named dimensions and units, the rest are attributes.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import math
import os
import typing
from collections import ChainMap
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from chemage.foundation.errors import ChemageError, DamagedError, StoreError
from chemage.foundation.files import fresh_file
from chemage.foundation.records import Record
from chemage.foundation.seals import check_seal, has_seal, seal, unsealed

#: layout of the file; a reader refuses a newer one. Since 2 files are sealed and name the fields of each record.
FORMAT = 2
R = TypeVar("R", bound=Record)
_FLOAT = "$float"
#: the first bytes of an HDF5 file
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Maps above this many bytes are stored in squares of _CHUNK pixels, so that a part can be read without the rest.
_LARGE, _CHUNK = 1 << 24, 512


@dataclass(frozen=True)
class Derived:
    """Numbers that follow from a record, stored beside it for programs that do not know how."""

    #: name -> (dimensions of the record, values, unit, meaning)
    variables: Mapping[str, tuple[tuple[str, ...], np.ndarray, str, str]]
    #: name -> number or text
    attributes: Mapping[str, Any]


# -- values and arrays ------------------------------------------------------------------------------------------------


def encode(record: Record) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A record as plain JSON values and arrays by name; a field of named arrays becomes ``field/name``."""
    values: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in record.todict().items():
        if record.is_left_out(name, value):
            continue
        if isinstance(value, np.ndarray):
            arrays[name] = value
        elif isinstance(value, dict) and value and all(isinstance(item, np.ndarray) for item in value.values()):
            arrays |= {f"{name}/{key}": array for key, array in value.items()}
        elif value is not None:
            values[name] = value
    return values, arrays


def decode(cls: type[R], values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> R:
    """The inverse of :func:`encode`; fields that are not there take their defaults."""
    fields: dict[str, Any] = dict(values)
    for name, array in arrays.items():
        field, slash, key = name.partition("/")
        if slash:
            fields.setdefault(field, {})[key] = array
        else:
            fields[field] = array
    return cls(**fields)


def plain(value: Any) -> Any:
    """A value that a plugin put among plain ones: a number or list where numpy's, else its text."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def _exact(value: Any) -> Any:
    """Plain JSON, in which a float that JSON has no word for is an object of its own."""
    if isinstance(value, Mapping):
        return {str(key): _exact(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_exact(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return {_FLOAT: repr(value)} if isinstance(value, float) and not math.isfinite(value) else value


def _inexact(value: Any) -> Any:
    if isinstance(value, dict):
        return float(value[_FLOAT]) if value.keys() == {_FLOAT} else {k: _inexact(item) for k, item in value.items()}
    return [_inexact(item) for item in value] if isinstance(value, list) else value


# -- JSON -------------------------------------------------------------------------------------------------------------


def to_json(record: Record) -> dict[str, Any]:
    """A record as one JSON object, exact to the last bit: declared arrays as lists, others in base 64."""
    values, arrays = encode(record)
    content = json.loads(json.dumps(_exact(values), default=plain))
    for name, array in arrays.items():
        if name in record.arrays:
            content[name] = array.tolist()
            continue
        field, _, key = name.partition("/")
        content.setdefault(field, {})[key] = {
            "dtype": array.dtype.str,
            "shape": list(array.shape),
            "base64": base64.b64encode(np.ascontiguousarray(array).tobytes()).decode(),
        }
    return content


def from_json(cls: type[R], content: Mapping[str, Any]) -> R:
    """The inverse of :func:`to_json`."""
    fields = {name: _from_base64(value) if _is_packed(value) else _inexact(value) for name, value in content.items()}
    return cls(**fields)


def _is_packed(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and bool(value)
        and all(isinstance(item, dict) and "base64" in item for item in value.values())
    )


def _from_base64(items: Mapping[str, Any]) -> dict[str, np.ndarray]:
    return {
        name: np.frombuffer(base64.b64decode(one["base64"]), dtype=one["dtype"]).reshape(one["shape"])
        for name, one in items.items()
    }


# -- npz --------------------------------------------------------------------------------------------------------------


def to_npz(record: Record) -> memoryview:
    """A record as the bytes of a sealed npz file; of an array that is mostly zeros, only what is not zero is kept."""
    values, arrays = encode(record)
    kept: dict[str, np.ndarray] = {}
    sparse: dict[str, list[int]] = {}
    for name, array in arrays.items():
        where = np.flatnonzero(array)
        if 2 * where.size < array.size:
            sparse[name] = list(array.shape)
            kept[f"{name}:where"] = where.astype(np.int32) if array.size < 2**31 else where
            kept[f"{name}:values"] = array.ravel()[where]
        else:
            kept[name] = array
    text = json.dumps({"values": _exact(values), "sparse": sparse}, default=plain)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, record=np.frombuffer(text.encode(), dtype=np.uint8), **kept)
    return seal(buffer)


def from_npz(cls: type[R], content: bytes | memoryview, path: Path) -> R:
    """The inverse of :func:`to_npz`, of what was read from ``path``.

    Raises
    ------
    DamagedError
        It is not what was written.
    """
    inner = unsealed(content, path)
    if inner is None:
        raise DamagedError(f"{path} is damaged: its checksum is missing")
    with np.load(io.BytesIO(inner), allow_pickle=False) as file:
        stored = json.loads(bytes(file["record"]))
        arrays: dict[str, np.ndarray] = {}
        for name, shape in stored["sparse"].items():
            values = file[f"{name}:values"]
            array = np.zeros(tuple(shape), dtype=values.dtype)
            array.ravel()[file[f"{name}:where"]] = values
            arrays[name] = array
        for name in file.files:
            if name != "record" and ":" not in name:
                arrays[name] = file[name]
    for array in arrays.values():
        array.setflags(write=False)
    return decode(cls, _inexact(stored["values"]), arrays)


# -- HDF5, writing ----------------------------------------------------------------------------------------------------


def write_records(
    path: str | os.PathLike[str],
    records: Mapping[str, Record],
    attributes: Mapping[str, Any],
    *,
    derived: Mapping[str, Derived] | None = None,
    force: bool = False,
) -> None:
    """Write records, each as the group of its name, and root attributes (strings, numbers) to ``path``.

    ``derived`` are numbers to store beside the records of those groups, for other programs: :func:`read_records` does
    not read them.

    Raises
    ------
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    import h5netcdf
    import h5py

    from chemage.foundation.version import __version__

    arrays = [array for record in records.values() for array in encode(record)[1].values()]
    size = sum(0.02 * array.nbytes if _compresses(array) else array.nbytes for array in arrays)
    with fresh_file(path, force=force, size=size) as part_path:
        # made in memory and written at once: HDF5 crashes the process when the disk fills up under it
        image = io.BytesIO()
        with h5py.File(image, "w", track_order=True) as hdf5, h5netcdf.File(hdf5, "w") as file:
            file.attrs["chemage"] = __version__
            file.attrs["chemage_format"] = FORMAT
            file.attrs["Conventions"] = "CF-1.8"
            for name, value in attributes.items():
                file.attrs[name] = value
            parts = []
            for name, record in records.items():
                group = file.create_group(name)
                _write_record(group, hdf5[name], record)
                if derived and name in derived:
                    _write_derived(hdf5[name], derived[name])
                file.flush()
                parts.append((name, image.getbuffer().nbytes))
        part_path.write_bytes(seal(image, parts))


def _write_record(group: Any, hdf5: Any, record: Record) -> None:
    """Write a record into a group of the netCDF file, which is also given as that of the HDF5 file below it."""
    values, arrays = encode(record)
    stored = {*values, *(name.partition("/")[0] for name in arrays)}
    fields = json.dumps({name: name in stored for name in type(record).model_fields})
    named: dict[str, Any] = {"chemage_object": type(record).__name__, "digest": record.digest(), "fields": fields}
    for name, value in values.items():
        if isinstance(value, dict | tuple):
            named[name] = json.dumps(value, default=plain)
        else:
            named[name] = int(value) if isinstance(value, bool) else value
    _set_attributes(hdf5, named)
    sizes: dict[str, int] = {}
    # before the arrays that they belong to: a dimension that is there without its coordinate is made twice
    for name, centres in record.coordinates().items():
        _write_array(group, name, centres, (name,), {"units": "nm", "long_name": "pixel centre"}, sizes)
    own: dict[str, ChainMap[str, int]] = {}
    for name, array in arrays.items():
        field, slash, key = name.partition("/")
        folder, known = group, sizes
        if slash:
            folder = group[field] if field in group.groups else group.create_group(field)
            # dimensions of the group hold in its subgroups
            known = own.setdefault(field, ChainMap({}, sizes))
        shown = key if slash else record.stored_names.get(name, name)
        dims, attributes = tuple(f"{shown}_{axis}" for axis in range(array.ndim)), {}
        if (declared := record.declared(name)) is not None:
            dims, unit, meaning = declared
            attributes = {"units": unit or "1", **({"long_name": meaning} if meaning else {})}
        _write_array(folder, shown, array, dims, attributes, known)


def _write_array(
    group: Any,
    name: str,
    values: np.ndarray,
    dims: tuple[str, ...],
    attributes: dict[str, str],
    sizes: MutableMapping[str, int],
) -> None:
    """Write one array; ``sizes`` are the lengths of the dimensions so far."""
    # of two arrays with dimensions of one name and different lengths, the second has its length in the name
    dims = tuple(
        dim if sizes.get(dim, length) == length else f"{dim}_{length}"
        for dim, length in zip(dims, values.shape, strict=True)
    )
    for dim, length in zip(dims, values.shape, strict=True):
        if dim not in sizes:
            sizes[dim] = length
            group.dimensions[dim] = length
    if values.dtype == np.bool_:
        values, attributes = values.astype(np.int8), {**attributes, "dtype": "bool"}
    options: dict[str, Any] = {}
    if values.ndim == 2 and values.nbytes > _LARGE:
        options["chunks"] = tuple(min(_CHUNK, length) for length in values.shape)
    if _compresses(values):
        options |= {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    variable = group.create_variable(name, dims, values.dtype, data=values, **options)
    for key, value in attributes.items():
        variable.attrs[key] = value


def _write_derived(group: Any, derived: Derived) -> None:
    """Write derived numbers into an HDF5 group whose dimensions are there; as netCDF4 has it, but ten times faster."""
    for name, (dims, values, unit, meaning) in derived.variables.items():
        variable = group.create_dataset(name, data=values, track_order=True)
        for axis, dim in enumerate(dims):
            variable.dims[axis].attach_scale(group[dim])
        _set_attributes(variable, {"units": unit, "long_name": meaning, "comment": "derived"})
    _set_attributes(group, {**derived.attributes, "derived": json.dumps([*derived.variables, *derived.attributes])})


def _set_attributes(hdf5: Any, values: Mapping[str, Any]) -> None:
    """Set attributes of an HDF5 object as h5netcdf does, without its checks, which take longer than the writing."""
    for name, value in values.items():
        hdf5.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def _compresses(values: np.ndarray) -> bool:
    # noise does not compress and costs seconds; a pressure map is mostly zeros and shrinks a hundredfold
    return bool(values.nbytes > 1 << 20 and np.count_nonzero(values) < values.size // 2)


# -- HDF5, reading ----------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A chemage file, verified and open for reading (an h5py file).

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or newer than this chemage.
    DamagedError
        What it holds is not what was written.
    """
    with _verified(path) as (file, _):
        yield file


def is_ours(path: Path) -> bool:
    """Whether ``path`` is a chemage file; a damaged HDF5 file is an error."""
    try:
        if _begin(path) != _HDF5:
            return False
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from error
    if has_seal(path):
        return True
    with _opened(path) as file:
        return "chemage_format" in file.attrs


@contextlib.contextmanager
def _damaged(path: Path) -> Iterator[None]:
    """What h5py raises on a damaged file depends on which byte is wrong."""
    try:
        yield
    except ChemageError:
        raise
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise DamagedError(f"{path} is damaged: {' '.join(str(error).split())}") from error


def _begin(path: Path) -> bytes:
    with open(path, "rb") as stream:
        return stream.read(len(_HDF5))


def _was_hdf5(path: Path) -> bool:
    """Whether a file that cannot be opened begins as HDF5 does, or was cut short before its first byte."""
    try:
        return _begin(path) in (_HDF5, b"")
    except OSError:
        return False


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import h5py

    try:
        file = h5py.File(path, "r")
    except (OSError, KeyError) as error:
        kind = DamagedError if _was_hdf5(path) else StoreError
        raise kind(f"{path} cannot be read: it is damaged or was cut short ({error})") from error
    with _damaged(path), file:
        yield file


@contextlib.contextmanager
def _verified(source: Path) -> Iterator[tuple[Any, bool]]:
    """An open chemage file of a known layout, and whether it carries a seal, which then fits."""
    if not source.exists():
        raise StoreError(f"{source} does not exist")
    try:
        verified = check_seal(source)
    except DamagedError:
        raise
    except OSError as error:
        raise StoreError(f"{source} cannot be read: {error.strerror}") from error
    with _opened(source) as file:
        if "chemage_format" not in file.attrs:
            raise StoreError(f"{source} is an HDF5 file, but not one of chemage's")
        if int(_scalar(file.attrs["chemage_format"])) > FORMAT:
            version = _scalar(file.attrs.get("chemage", "a newer version"))
            raise StoreError(f"{source} was written by chemage {version}; update chemage to read it")
        yield file, verified


def read_records(
    path: str | os.PathLike[str], classes: Mapping[str, type[Record]]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The records in a chemage file whose groups are among ``classes``, by group name, and its root attributes.

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or newer than this chemage.
    DamagedError
        What it holds is not what was written.
    """
    source = Path(path)
    with _verified(source) as (file, verified):
        attributes = {name: _scalar(value) for name, value in file.attrs.items() if not name.startswith("_")}
        records = {}
        for name, cls in classes.items():
            if name in file:
                records[name] = _record_in(source, file, name, cls, verified)
    return records, attributes


def _record_in(path: Path, file: Any, name: str, cls: type[R], verified: bool) -> R:
    try:
        record = _read_record(file[name], cls)
        # a file without a seal, because something shortened it or because another program wrote to it
        if verified or is_intact(file[name], record):
            return record
        problem = "it is not what chemage wrote"
    except DamagedError as error:
        problem = str(error)
    except (ChemageError, OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        problem = " ".join(str(error).split())
    raise DamagedError(f"{path}: {name} is damaged: {problem}")


def is_intact(group: Any, record: Record) -> bool:
    """Whether a record read from ``group`` is what was written there; True where that was not noted (chemage 0.1)."""
    if "fields" not in group.attrs or _fields(group).keys() != type(record).model_fields.keys():
        return True  # written by a version with other fields
    return _scalar(group.attrs["digest"]) == record.digest()


def _fields(group: Any) -> dict[str, bool]:
    """The fields of the record when it was written, and whether each is in the file (it is not if it was None)."""
    return json.loads(_scalar(group.attrs["fields"]))


def _scalar(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.size == 1:
        return value.ravel()[0].item()
    return value.item() if isinstance(value, np.generic) else value


def _read_record(group: Any, cls: type[R]) -> R:
    import h5py

    values: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    members, attributes = set(group), set(group.attrs)
    # the fields' own names in files of chemage 0.1
    shown = {field: name for field, name in cls.stored_names.items() if name in members}
    for name in _expected(group, cls):
        if shown.get(name, name) not in members and name not in attributes:
            raise DamagedError(f"it has no {name}")
    for name, info in cls.model_fields.items():
        if (member := shown.get(name, name)) in members:
            item = group[member]
            if isinstance(item, h5py.Dataset):
                arrays[name] = _read_array(item)
            else:
                arrays |= {f"{name}/{key}": _read_array(item[key]) for key in item if _is_variable(item[key])}
        elif name in attributes:
            value = _scalar(group.attrs[name])
            if isinstance(value, str) and _holds_json(info.annotation):
                value = json.loads(value)
            values[name] = value
    return decode(cls, values, arrays)


def _expected(group: Any, cls: type[Record]) -> set[str]:
    """The fields that must be there."""
    if "fields" in group.attrs:
        return {name for name, stored in _fields(group).items() if stored}
    # chemage 0.1 left out what was None, and the fields that came later
    return {
        name
        for name, info in cls.model_fields.items()
        if name not in cls.later and name not in cls.added and (info.is_required() or info.default is not None)
    }


def _is_variable(dataset: Any) -> bool:
    label = dataset.attrs.get("NAME", b"")
    return not bytes(label).startswith(b"This is a netCDF dimension but not a netCDF variable")


def _holds_json(annotation: Any) -> bool:
    origins = {typing.get_origin(part) or part for part in (annotation, *typing.get_args(annotation))}
    return bool(origins & {dict, tuple})


def _read_array(dataset: Any) -> np.ndarray:
    values = dataset[()]
    if _scalar(dataset.attrs.get("dtype", "")) == "bool":
        values = values.astype(np.bool_)
    values = np.asarray(values)
    values.setflags(write=False)
    return values
