"""Methods of ageing: ``closure`` (bonds per area from uniform contacts and the rim, integrated over the pressures) and
``sample`` (the kinetics of windows of the contact); observables: ``barrier-spectrum``, ``pressure-spectrum``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_ageing.closure import Closure as Closure
    from chemage_ageing.sample import Sample as Sample
    from chemage_ageing.spectra import BarrierSpectrum as BarrierSpectrum
    from chemage_ageing.spectra import PressureSpectrum as PressureSpectrum

KINDS = {
    "ageing": {
        "closure": "chemage_ageing.closure:Closure",
        "sample": "chemage_ageing.sample:Sample",
    },
    "observable": {
        "barrier-spectrum": "chemage_ageing.spectra:BarrierSpectrum",
        "pressure-spectrum": "chemage_ageing.spectra:PressureSpectrum",
    },
}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS
