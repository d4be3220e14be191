"""Records for xarray and pandas: the names, dimensions, units and meanings that their files have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.codec import encode
from chemage.foundation.errors import optional_module
from chemage.foundation.records import Record

if TYPE_CHECKING:
    import pandas
    import xarray

#: what installs the libraries of notebooks
EXTRA = "notebook"


def dataset(record: Record, derived: dict[str, tuple[Any, ...]] | None = None) -> xarray.Dataset:
    """Every array of ``record`` with its dimensions, unit and meaning, as in its file; the rest as attributes.

    Named arrays are ``field.name``. ``derived``: name -> (dimensions, values, attributes) of further variables.
    """
    xarray = optional_module("xarray", EXTRA)
    values, arrays = encode(record)
    variables: dict[str, tuple[Any, ...]] = {}
    lengths: dict[str, int] = {}
    for name, array in arrays.items():
        dims, unit, meaning = record.declared(name) or (
            tuple(f"{name.rpartition('/')[2]}_{axis}" for axis in range(array.ndim)),
            "",
            "",
        )
        # of two arrays with dimensions of one name and different lengths, the second has its length in the name
        dims = tuple(
            dim if lengths.setdefault(dim, length) == length else f"{dim}_{length}"
            for dim, length in zip(dims, array.shape, strict=True)
        )
        attributes = {"units": unit or "1", **({"long_name": meaning} if meaning else {})}
        variables[record.stored_names.get(name, name).replace("/", ".")] = (dims, array, attributes)
    variables |= derived or {}
    coordinates = {
        name: ((name,), centres, {"units": "nm", "long_name": "pixel centre"})
        for name, centres in record.coordinates().items()
    }
    attributes = {name: value for name, value in values.items() if isinstance(value, str | int | float)}
    return xarray.Dataset(variables, coordinates, attributes)


def frame(columns: dict[str, np.ndarray], index: str, attributes: dict[str, Any]) -> pandas.DataFrame:
    """Columns of equal length; that of the name ``index`` numbers the rows."""
    pandas = optional_module("pandas", EXTRA)
    table = pandas.DataFrame(columns).set_index(index)
    table.attrs |= attributes
    return table


def map_frame(values: np.ndarray, coordinates: dict[str, np.ndarray], name: str, unit: str) -> pandas.DataFrame:
    """A map (nx, ny) as a table: rows along x, columns along y, both in nm."""
    pandas = optional_module("pandas", EXTRA)
    along = {axis: pandas.Index(centres, name=f"{axis} (nm)") for axis, centres in coordinates.items()}
    table = pandas.DataFrame(values, index=along["x"], columns=along["y"])
    table.attrs |= {"name": name, "units": unit}
    return table
