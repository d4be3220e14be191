"""Distributions of energy barriers: ``gaussian``, ``uniform``, ``tabulated``, ``inferred``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_barriers.analytic import Gaussian as Gaussian
    from chemage_barriers.analytic import Uniform as Uniform
    from chemage_barriers.inferred import Inferred as Inferred
    from chemage_barriers.tabulated import EmpiricalQuantile as EmpiricalQuantile
    from chemage_barriers.tabulated import PiecewiseLinearDensity as PiecewiseLinearDensity
    from chemage_barriers.tabulated import Tabulated as Tabulated
    from chemage_barriers.tabulated import parse_columns as parse_columns

_HOME = {
    "EmpiricalQuantile": "tabulated",
    "Gaussian": "analytic",
    "Inferred": "inferred",
    "PiecewiseLinearDensity": "tabulated",
    "Tabulated": "tabulated",
    "Uniform": "analytic",
    "parse_columns": "tabulated",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The distributions of this package."""
    return {
        "barriers": {
            "gaussian": "chemage_barriers.analytic:Gaussian",
            "uniform": "chemage_barriers.analytic:Uniform",
            "tabulated": "chemage_barriers.tabulated:Tabulated",
            "inferred": "chemage_barriers.inferred:Inferred",
        }
    }


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
