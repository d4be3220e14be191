"""A contact without its map: how its area is distributed over the pressure, and over the sites at its rim."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from chemage.contacts import pressures, theory
from chemage.contacts.solution import MEASURES
from chemage.foundation import pictures
from chemage.foundation.datasets import dataset, frame
from chemage.foundation.errors import InputError
from chemage.foundation.records import Doubles, Number, Plain, PositiveNumber, Record, require_finite
from chemage.foundation.units import QuantityLike, convert

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


class ContactStatistics(Record):
    """What is left of a contact when its map is forgotten: area by pressure, and by missing neighbours.

    It is made of a solved contact by :func:`chemage.plugin.contact_statistics`, or given by a theory.
    """

    arrays = {
        "pressure": (("class",), "GPa", "mean pressure of the class"),
        "area": (("class",), "nm2", "contact area of the class"),
        "missing": (("class", "neighbours"), "nm2", "contact area of the class whose sites lack so many neighbours"),
    }

    pressure: Doubles
    """(n,) GPa, ascending, > 0"""
    area: Doubles
    """(n,) nm² ≥ 0"""
    missing: Doubles | None = None
    """(n, k + 1) nm²: area whose sites lack 0, 1, … k neighbours that a site inside the contact has; None: not known,
    which leaves the rim out"""
    load: Number
    """normal force, nN"""
    nominal_area: PositiveNumber
    """A0, nm²"""
    modulus: PositiveNumber
    """contact modulus E*, GPa"""
    rms_slope: float = math.nan
    """of the surface"""
    rms_height: float = math.nan
    """of the surface, nm"""
    notes: tuple[str, ...] = ()
    """what the user should know of this contact, in words"""
    provenance: Plain = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pressure.ndim != 1 or self.area.shape != self.pressure.shape:
            raise ValueError(f"area: shape {self.area.shape}; give one area for each of the pressures")
        for name in ("pressure", "area"):
            require_finite(name, getattr(self, name), "give pressures in GPa, areas in nm²")
        if (self.pressure <= 0).any() or (np.diff(self.pressure) <= 0).any():
            raise ValueError("pressure: must be above zero and ascending; give the mean pressure of each class")
        if (self.area < 0).any():
            raise ValueError(f"area: {self.area.min():g} nm² is negative")
        if self.missing is not None:
            if self.missing.ndim != 2 or len(self.missing) != self.area.size or self.missing.shape[1] < 1:
                raise ValueError(f"missing: shape {self.missing.shape}; give ({self.area.size}, neighbours + 1)")
            if not np.allclose(self.missing.sum(axis=1), self.area, rtol=1e-9, atol=0.0):
                raise ValueError("missing: its rows do not add up to area")
        return self

    @property
    def contact_area(self) -> float:
        """Contact area A, nm²."""
        return float(self.area.sum())

    @property
    def area_fraction(self) -> float:
        """A / A0."""
        return self.contact_area / self.nominal_area

    @property
    def nominal_pressure(self) -> float:
        """F_N / A0, GPa."""
        return self.load / self.nominal_area

    @property
    def mean_contact_pressure(self) -> float:
        """F_N / A, GPa; nan without contact."""
        return self.load / self.contact_area if self.contact_area > 0 else math.nan

    @property
    def kappa(self) -> float:
        """κ = A h'_rms E* / F_N; nan without load."""
        return theory.kappa(self.contact_area, self.rms_slope, self.modulus, self.load)

    @property
    def converged(self) -> bool:
        """Nothing was iterated."""
        return True

    def above(self, hardness: QuantityLike) -> pressures.Above:
        """Which shares of contact area and load lie above a ``hardness``, see :meth:`ContactSolution.above`."""
        value = convert(hardness, "GPa")
        if not 0 < value < math.inf:
            raise InputError.of("hardness", hardness, "must be finite and above zero", "give a pressure in GPa")
        if not self.contact_area > 0:
            return pressures.Above(math.nan, math.nan)
        beyond, force = self.pressure > value, self.area * self.pressure
        return pressures.Above(
            float(self.area[beyond].sum()) / self.contact_area, float(force[beyond].sum()) / float(force.sum())
        )

    def summary(self) -> dict[str, float]:
        """The measures users compare (:data:`chemage.contacts.solution.MEASURES`), nan where this class has none of the
        name, because the measure needs a map."""
        known = {*type(self).model_fields, *dir(type(self))}
        numbers = {name: getattr(self, name) if name in known else math.nan for name in MEASURES}
        return {**numbers, "area": self.contact_area}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the contact area above each pressure into ``ax``, or into a new figure of pyplot; return the axes."""
        return pictures.draw(self, ax)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions and units of the file. Needs xarray."""
        return dataset(self)

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each class of pressure: ``pressure`` (GPa) and ``area`` (nm²). Needs pandas."""
        return frame({"pressure": self.pressure, "area": self.area}, "pressure", self.summary())

    def _repr_html_(self) -> str:
        return pictures.html(self)

    def __repr__(self) -> str:
        return f"<ContactStatistics {self.load:g} nN, area fraction {self.area_fraction:.4g}>"

    __str__ = __repr__
