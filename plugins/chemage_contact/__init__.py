"""Contacts: ``fft-bem`` (any surface), ``hertz`` (the closed form of a sphere), ``persson`` (theory without a map), and
two other codes for comparison, ``tamaas`` (AGPL) and ``contactmechanics``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_contact.closed_forms import Hertz as Hertz
    from chemage_contact.closed_forms import Persson as Persson
    from chemage_contact.fft_bem import FFTBEM as FFTBEM
    from chemage_contact.peers import ContactMechanics as ContactMechanics
    from chemage_contact.peers import Tamaas as Tamaas

KINDS = {
    "contact": {
        "fft-bem": "chemage_contact.fft_bem:FFTBEM",
        "hertz": "chemage_contact.closed_forms:Hertz",
        "persson": "chemage_contact.closed_forms:Persson",
        "tamaas": "chemage_contact.peers:Tamaas",
        "contactmechanics": "chemage_contact.peers:ContactMechanics",
    }
}

#: kind -> the library that it needs, which chemage does not install, and its licence
CHEMAGE_NEEDS = {"tamaas": "tamaas (AGPL-3.0)", "contactmechanics": "ContactMechanics (MIT)"}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The solvers of this package."""
    return KINDS


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scene of the Contact-Mechanics Challenge."""
    return {"contact-challenge": "chemage_contact:scenes/contact-challenge.toml"}
