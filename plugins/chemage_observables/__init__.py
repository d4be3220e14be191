"""Observables: ``barrier-spectrum``, ``pressure-spectrum``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_observables.spectra import BarrierSpectrum, PressureSpectrum

__all__ = ["BarrierSpectrum", "PressureSpectrum"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {
        "observable": {
            "barrier-spectrum": "chemage_observables.spectra:BarrierSpectrum",
            "pressure-spectrum": "chemage_observables.spectra:PressureSpectrum",
        }
    }


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from chemage_observables import spectra

    return getattr(spectra, name)
