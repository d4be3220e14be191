"""Contacts: ``fft-bem`` (any surface), ``hertz`` (the closed form of a sphere), ``persson`` (theory without a map)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_contact.fft_bem import FFTBEM as FFTBEM
    from chemage_contact.hertz import Hertz as Hertz
    from chemage_contact.persson import Persson as Persson

_HOME = {"FFTBEM": "fft_bem", "Hertz": "hertz", "Persson": "persson"}

__all__ = ["FFTBEM", "Hertz", "Persson"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    return {
        "contact": {
            "fft-bem": "chemage_contact.fft_bem:FFTBEM",
            "hertz": "chemage_contact.hertz:Hertz",
            "persson": "chemage_contact.persson:Persson",
        }
    }


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
