"""The load of a contact: a normal force, or a nominal pressure on the nominal area of the surface."""

from __future__ import annotations

import math

from chemage.foundation.checks import force
from chemage.foundation.errors import InputError, UnitError
from chemage.foundation.units import QuantityLike, convert, is_in_table


def nominal_pressure(load: object) -> float | None:
    """``load`` in GPa where it is a pressure, such as ``"10 MPa"``; None where it is a force, a bare number, or
    neither."""
    if isinstance(load, str) and is_in_table(load, "GPa"):  # without pint, whose import takes long
        return convert(load, "GPa")
    if isinstance(load, int | float) or (isinstance(load, str) and is_in_table(load, "nN")):
        return None
    for unit in ("nN", "GPa"):
        try:
            value = convert(load, unit)
        except UnitError:
            continue
        return value if unit == "GPa" else None
    return None


def normal_force(load: QuantityLike, area: float | None, *, flat: bool) -> float:
    """``load`` in nN, finite and ≥ 0; a pressure is multiplied by the nominal ``area`` (nm²; None: not known).

    Raises
    ------
    InputError
        It is negative or out of range; or a pressure, and the surface is not nominally ``flat`` or its area not known.
    UnitError
        It is neither a force nor a pressure.
    """
    pressure = nominal_pressure(load)
    if pressure is None:
        try:
            return force(load)
        except UnitError as error:
            raise UnitError(
                f'{error}; a load is a force, such as "20 uN", or a nominal pressure, such as "10 MPa"'
            ) from None
    give = 'give the normal force, such as load = "20 uN"'
    if not math.isfinite(pressure) or pressure < 0:
        raise InputError.of("load", load, "must be finite and not negative", "give a nominal pressure such as 10 MPa")
    if not flat:
        raise InputError.of(
            "load",
            load,
            "a nominal pressure needs a nominal area, and that of a tip or of a surface that is not periodic has no "
            "meaning",
            give,
        )
    if area is None:
        raise InputError.of("load", load, "the nominal area of this surface is not known before it is made", give)
    return force(pressure * area)


def force_text(force: float) -> str:
    """A force (nN) with the unit in which it is usually given."""
    for unit, size in (("N", 1e9), ("mN", 1e6), ("µN", 1e3)):
        if force >= size:
            return f"{force / size:.4g} {unit}"
    return f"{force:.4g} nN"


def pressure_text(pressure: float) -> str:
    """A nominal pressure (GPa) with the unit in which it is usually given."""
    return f"{pressure:.4g} GPa" if pressure >= 0.1 else f"{1e3 * pressure:.4g} MPa"
