"""Records for xarray and pandas: the names, dimensions, units and meanings that their files have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.codec import PIXEL_CENTRE, distinct, encode, labels
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
        dims, attributes = labels(record, name, array)
        dims = distinct(dims, array.shape, lengths)
        lengths |= zip(dims, array.shape, strict=True)
        shown = record.stored_names.get(name, name).replace("/", ".")
        variables[shown] = (dims, array, {"units": "1", **attributes})
    variables |= derived or {}
    coordinates = {name: ((name,), centres, PIXEL_CENTRE) for name, centres in record.coordinates().items()}
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
