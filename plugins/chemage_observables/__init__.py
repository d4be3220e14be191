"""Observables: ``barrier-spectrum``, ``pressure-spectrum``."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_observables.barrier_spectrum import BarrierSpectrum as BarrierSpectrum
    from chemage_observables.pressure_spectrum import PressureSpectrum as PressureSpectrum

_HOME = {"BarrierSpectrum": "barrier_spectrum", "PressureSpectrum": "pressure_spectrum"}
__all__ = ["BarrierSpectrum", "PressureSpectrum"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {
        "observable": {
            "barrier-spectrum": "chemage_observables.barrier_spectrum:BarrierSpectrum",
            "pressure-spectrum": "chemage_observables.pressure_spectrum:PressureSpectrum",
        }
    }


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
