"""Distributions of energy barriers: ``gaussian``, ``uniform``, ``tabulated``, ``inferred``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_barriers.distributions import EmpiricalQuantile as EmpiricalQuantile
    from chemage_barriers.distributions import Gaussian as Gaussian
    from chemage_barriers.distributions import PiecewiseLinearDensity as PiecewiseLinearDensity
    from chemage_barriers.distributions import Tabulated as Tabulated
    from chemage_barriers.distributions import Uniform as Uniform
    from chemage_barriers.distributions import parse_columns as parse_columns
    from chemage_barriers.inferred import Inferred as Inferred

KINDS = {
    "barriers": {
        "gaussian": "chemage_barriers.distributions:Gaussian",
        "uniform": "chemage_barriers.distributions:Uniform",
        "tabulated": "chemage_barriers.distributions:Tabulated",
        "inferred": "chemage_barriers.inferred:Inferred",
    }
}

__getattr__ = lazy_attributes(
    KINDS,
    "chemage_barriers.distributions:EmpiricalQuantile",
    "chemage_barriers.distributions:PiecewiseLinearDensity",
    "chemage_barriers.distributions:parse_columns",
)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The distributions of this package."""
    return KINDS
