"""What a bond is: distributions of the energy barriers to form one (``gaussian``, ``uniform``, ``tabulated``,
``inferred``), how it changes the barriers of neighbouring sites (``elastic-pairs``), and the force that ruptures it
(``mean-force``, ``bell``, ``dudko-hummer-szabo``, ``friddle``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_bonds.distributions import EmpiricalQuantile as EmpiricalQuantile
    from chemage_bonds.distributions import Gaussian as Gaussian
    from chemage_bonds.distributions import (
        PiecewiseLinearDensity as PiecewiseLinearDensity,
    )
    from chemage_bonds.distributions import Tabulated as Tabulated
    from chemage_bonds.distributions import Uniform as Uniform
    from chemage_bonds.distributions import parse_columns as parse_columns
    from chemage_bonds.forces import ElasticPairs as ElasticPairs
    from chemage_bonds.forces import MeanForce as MeanForce
    from chemage_bonds.inferred import Inferred as Inferred
    from chemage_bonds.rupture import Bell as Bell
    from chemage_bonds.rupture import DudkoHummerSzabo as DudkoHummerSzabo
    from chemage_bonds.rupture import Friddle as Friddle

KINDS = {
    "barriers": {
        "gaussian": "chemage_bonds.distributions:Gaussian",
        "uniform": "chemage_bonds.distributions:Uniform",
        "tabulated": "chemage_bonds.distributions:Tabulated",
        "inferred": "chemage_bonds.inferred:Inferred",
    },
    "interaction": {"elastic-pairs": "chemage_bonds.forces:ElasticPairs"},
    "rupture": {
        "mean-force": "chemage_bonds.forces:MeanForce",
        "bell": "chemage_bonds.rupture:Bell",
        "dudko-hummer-szabo": "chemage_bonds.rupture:DudkoHummerSzabo",
        "friddle": "chemage_bonds.rupture:Friddle",
    },
}

__getattr__ = lazy_attributes(
    KINDS,
    "chemage_bonds.distributions:EmpiricalQuantile",
    "chemage_bonds.distributions:PiecewiseLinearDensity",
    "chemage_bonds.distributions:parse_columns",
)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS
