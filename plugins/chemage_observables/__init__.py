"""Observables that come with chemage."""

from typing import Any

from chemage.hookspecs import hookimpl

__all__ = ["BarrierSpectrum"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The kinds of this package."""
    return {"observable": {"barrier-spectrum": "chemage_observables.barrier_spectrum:BarrierSpectrum"}}


def __getattr__(name: str) -> Any:
    if name == "BarrierSpectrum":
        from chemage_observables.barrier_spectrum import BarrierSpectrum

        return BarrierSpectrum
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
