"""The one codec of records: as plain values and arrays, as one JSON object, as a group in the layout of NetCDF-4, and
for xarray and pandas, with the names, dimensions, units and meanings that files have.

Every field of a record is stored, by introspection, so that no file can lose one. :mod:`chemage.foundation.container`
puts what is encoded here into files.
"""

from __future__ import annotations

import base64
import json
import math
import typing
from collections import ChainMap
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.errors import optional_module
from chemage.foundation.records import Record

if TYPE_CHECKING:
    import pandas
    import xarray

R = TypeVar("R", bound=Record)
_FLOAT = "$float"
#: Maps above this many bytes are stored in squares of _CHUNK pixels, so that a part can be read without the rest.
_LARGE, _CHUNK = 1 << 24, 512
PIXEL_CENTRE = {"units": "nm", "long_name": "pixel centre"}


@dataclass(frozen=True)
class Derived:
    """Numbers that follow from a record, stored beside it for programs that do not know how."""

    #: name -> (dimensions of the record, values, unit, meaning)
    variables: Mapping[str, tuple[tuple[str, ...], np.ndarray, str, str]]
    #: name -> number or text
    attributes: Fields


# -- values and arrays ------------------------------------------------------------------------------------------------


def encode(record: Record) -> tuple[Data, dict[str, np.ndarray]]:
    """A record as plain JSON values and arrays by name; a field of named arrays becomes ``field/name``."""
    values: Data = {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in record.todict().items():
        if record.is_left_out(name, value):
            continue
        if isinstance(value, np.ndarray):
            arrays[name] = value
        elif (
            isinstance(value, dict)
            and value
            and all(isinstance(item, np.ndarray) for item in value.values())
        ):
            arrays |= {f"{name}/{key}": array for key, array in value.items()}
        elif value is not None:
            values[name] = value
    return values, arrays


def decode(cls: type[R], values: Fields, arrays: Mapping[str, np.ndarray]) -> R:
    """The inverse of :func:`encode`; fields that are not there take their defaults."""
    fields: Data = dict(values)
    for name, array in arrays.items():
        field, slash, key = name.partition("/")
        if slash:
            fields.setdefault(field, {})[key] = array
        else:
            fields[field] = array
    return cls(**fields)


def plain(value: Any) -> Any:
    """A value that a plugin put among plain ones: a number or list where numpy's, else its text."""
    return (
        value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)
    )


def exact(value: Any) -> Any:
    """Plain JSON, in which a float that JSON has no word for is an object of its own."""
    if isinstance(value, Mapping):
        return {str(key): exact(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [exact(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {_FLOAT: repr(value)}
    return value


def inexact(value: Any) -> Any:
    """The inverse of :func:`exact`."""
    if isinstance(value, list):
        return [inexact(item) for item in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {_FLOAT}:
        return float(value[_FLOAT])
    return {name: inexact(item) for name, item in value.items()}


# -- JSON -------------------------------------------------------------------------------------------------------------


def to_json(record: Record) -> Data:
    """A record as one JSON object, exact to the last bit: declared arrays as lists, others in base 64."""
    values, arrays = encode(record)
    content = json.loads(json.dumps(exact(values), default=plain))
    for name, array in arrays.items():
        if name in record.arrays:
            content[name] = array.tolist()
            continue
        field, _, key = name.partition("/")
        content.setdefault(field, {})[key] = {
            "dtype": array.dtype.str,
            "shape": list(array.shape),
            "base64": base64.b64encode(
                np.ascontiguousarray(array).tobytes()
            ).decode(),
        }
    return content


def from_json(cls: type[R], content: Fields) -> R:
    """The inverse of :func:`to_json`."""
    return cls(**{name: _unpacked(value) for name, value in content.items()})


def _unpacked(value: Any) -> Any:
    """A field, or an array among named ones."""
    if isinstance(value, dict) and "base64" in value:
        data = np.frombuffer(base64.b64decode(value["base64"]), value["dtype"])
        return data.reshape(value["shape"])
    if isinstance(value, dict) and value.keys() != {_FLOAT}:
        return {name: _unpacked(item) for name, item in value.items()}
    return inexact(value)


# -- groups of NetCDF-4 ------------------------------------------------------------------------------------------------


def write_group(group: Any, hdf5: Any, record: Record) -> None:
    """Write a record into a group of the netCDF file, which is also given as that of the HDF5 file below it."""
    values, arrays = encode(record)
    stored = {*values, *(name.partition("/")[0] for name in arrays)}
    fields = json.dumps(
        {name: name in stored for name in type(record).model_fields}
    )
    named: Data = {
        "chemage_object": type(record).__name__,
        "digest": record.digest(),
        "fields": fields,
    }
    for name, value in values.items():
        if isinstance(value, dict | tuple):
            named[name] = json.dumps(value, default=plain)
        else:
            named[name] = int(value) if isinstance(value, bool) else value
    _set_attributes(hdf5, named)
    lengths: dict[str, int] = {}
    # before the arrays that they belong to: a dimension that is there without its coordinate is made twice
    for name, centres in record.coordinates().items():
        _write_array(group, name, centres, (name,), PIXEL_CENTRE, lengths)
    own: dict[str, ChainMap[str, int]] = {}
    for name, array in arrays.items():
        folder, of_folder = group, lengths
        field, slash, shown = name.partition("/")
        if slash:
            folder = (
                group[field] if field in group.groups else group.create_group(field)
            )
            # dimensions of the group hold in its subgroups
            of_folder = own.setdefault(field, ChainMap({}, lengths))
        _write_array(
            folder,
            shown or record.stored_names.get(name, name),
            array,
            *labels(record, name, array),
            of_folder,
        )


def labels(
    record: Record, name: str, array: np.ndarray
) -> tuple[tuple[str, ...], dict[str, str]]:
    """The dimensions of an array of a record, and its attributes."""
    if (declared := record.declared(name)) is not None:
        dims, unit, meaning = declared
        return dims, {
            "units": unit or "1",
            **({"long_name": meaning} if meaning else {}),
        }
    shown = record.stored_names.get(name, name).rpartition("/")[2]
    return tuple(f"{shown}_{axis}" for axis in range(array.ndim)), {}


def distinct(
    dims: tuple[str, ...], shape: tuple[int, ...], lengths: MutableMapping[str, int]
) -> tuple[str, ...]:
    """Names of dimensions: of two with one name and different ``lengths``, the second has its length in the name."""
    return tuple(
        dim if lengths.get(dim, length) == length else f"{dim}_{length}"
        for dim, length in zip(dims, shape, strict=True)
    )


def _write_array(
    group: Any,
    name: str,
    values: np.ndarray,
    dims: tuple[str, ...],
    attributes: Mapping[str, str],
    lengths: MutableMapping[str, int],
) -> None:
    """Write one array; ``lengths`` are those of the dimensions so far."""
    dims = distinct(dims, values.shape, lengths)
    for dim, length in zip(dims, values.shape, strict=True):
        if dim not in lengths:
            lengths[dim] = length
            group.dimensions[dim] = length
    if values.dtype == np.bool_:
        values, attributes = values.astype(np.int8), {**attributes, "dtype": "bool"}
    options: Data = {}
    if values.ndim == 2 and values.nbytes > _LARGE:
        options["chunks"] = tuple(min(_CHUNK, length) for length in values.shape)
    if compresses(values):
        options |= {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    variable = group.create_variable(
        name, dims, values.dtype, data=values, **options
    )
    for key, value in attributes.items():
        variable.attrs[key] = value


def write_derived(group: Any, derived: Derived) -> None:
    """Write derived numbers into an HDF5 group whose dimensions are there; as netCDF4 has it, but ten times faster."""
    for name, (dims, values, unit, meaning) in derived.variables.items():
        variable = group.create_dataset(name, data=values, track_order=True)
        for axis, dim in enumerate(dims):
            variable.dims[axis].attach_scale(group[dim])
        _set_attributes(
            variable, {"units": unit, "long_name": meaning, "comment": "derived"}
        )
    names = json.dumps([*derived.variables, *derived.attributes])
    _set_attributes(group, {**derived.attributes, "derived": names})


def _set_attributes(hdf5: Any, values: Fields) -> None:
    """Set attributes of an HDF5 object as h5netcdf does, without its checks, which take longer than the writing."""
    for name, value in values.items():
        hdf5.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def compresses(values: np.ndarray) -> bool:
    """Whether an array is stored with gzip."""
    # noise does not compress and costs seconds; a pressure map is mostly zeros and shrinks a hundredfold
    return bool(
        values.nbytes > 1 << 20 and np.count_nonzero(values) < values.size // 2
    )


def read_group(group: Any, cls: type[R]) -> R:
    """The inverse of :func:`write_group`; fields that are not there take their defaults."""
    import h5py

    values: Data = {}
    arrays: dict[str, np.ndarray] = {}
    members, attributes = set(group), set(group.attrs)
    for name, info in cls.model_fields.items():
        if (member := cls.stored_names.get(name, name)) in members:
            item = group[member]
            if isinstance(item, h5py.Dataset):
                arrays[name] = _read_array(item)
            else:
                arrays |= {
                    f"{name}/{key}": _read_array(item[key])
                    for key in item
                    if _is_variable(item[key])
                }
        elif name in attributes:
            value = scalar(group.attrs[name])
            if isinstance(value, str) and _holds_json(info.annotation):
                value = json.loads(value)
            values[name] = value
    return decode(cls, values, arrays)


def scalar(value: Any) -> Any:
    """An attribute of an HDF5 object as a plain number or text."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.size == 1:
        return value.ravel()[0].item()
    return value.item() if isinstance(value, np.generic) else value


def _is_variable(dataset: Any) -> bool:
    label = dataset.attrs.get("NAME", b"")
    return not bytes(label).startswith(
        b"This is a netCDF dimension but not a netCDF variable"
    )


def _holds_json(annotation: Any) -> bool:
    origins = {
        typing.get_origin(part) or part
        for part in (annotation, *typing.get_args(annotation))
    }
    return bool(origins & {dict, tuple})


def _read_array(dataset: Any) -> np.ndarray:
    values = dataset[()]
    if scalar(dataset.attrs.get("dtype", "")) == "bool":
        values = values.astype(np.bool_)
    values = np.asarray(values)
    values.setflags(write=False)
    return values


#: what installs the libraries of notebooks
EXTRA = "notebook"


def dataset(
    record: Record, derived: dict[str, tuple[Any, ...]] | None = None
) -> xarray.Dataset:
    """Every array of ``record`` with its dimensions, unit and meaning, as in its file; the rest as attributes.

    Named arrays are ``field.name``. ``derived``: name -> (dimensions, values, attributes) of further variables.
    """
    xarray = optional_module("xarray", EXTRA)
    values, arrays = encode(record)
    variables: dict[str, tuple[Any, ...]] = {}
    lengths: dict[str, int] = {}
    for name, array in arrays.items():
        dims, attributes = labels(record, name, array)
        dims = distinct(dims, array.shape, lengths)
        lengths |= zip(dims, array.shape, strict=True)
        shown = record.stored_names.get(name, name).replace("/", ".")
        variables[shown] = (dims, array, {"units": "1", **attributes})
    variables |= derived or {}
    coordinates = {
        name: ((name,), centres, PIXEL_CENTRE)
        for name, centres in record.coordinates().items()
    }
    attributes = {
        name: value
        for name, value in values.items()
        if isinstance(value, str | int | float)
    }
    return xarray.Dataset(variables, coordinates, attributes)


def frame(
    columns: dict[str, np.ndarray], index: str, attributes: Data
) -> pandas.DataFrame:
    """Columns of equal length; that of the name ``index`` numbers the rows."""
    pandas = optional_module("pandas", EXTRA)
    table = pandas.DataFrame(columns).set_index(index)
    table.attrs |= attributes
    return table


def map_frame(
    values: np.ndarray, coordinates: dict[str, np.ndarray], name: str, unit: str
) -> pandas.DataFrame:
    """A map (nx, ny) as a table: rows along x, columns along y, both in nm."""
    pandas = optional_module("pandas", EXTRA)
    along = {
        axis: pandas.Index(centres, name=f"{axis} (nm)")
        for axis, centres in coordinates.items()
    }
    table = pandas.DataFrame(values, index=along["x"], columns=along["y"])
    table.attrs |= {"name": name, "units": unit}
    return table
