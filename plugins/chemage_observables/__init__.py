"""Observables: ``barrier-spectrum``, ``pressure-spectrum``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_observables.spectra import BarrierSpectrum as BarrierSpectrum
    from chemage_observables.spectra import PressureSpectrum as PressureSpectrum

KINDS = {
    "observable": {
        "barrier-spectrum": "chemage_observables.spectra:BarrierSpectrum",
        "pressure-spectrum": "chemage_observables.spectra:PressureSpectrum",
    }
}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS
