"""Contacts: ``fft-bem`` (any surface), ``hertz`` (the closed form of a sphere), ``persson`` (theory without a map).

With adhesion: ``adhesive-bem`` (any surface), ``jkr``, ``dmt`` and ``maugis`` (closed forms of a sphere). Two other
codes for comparison: ``tamaas`` (AGPL) and ``contactmechanics``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_contact.adhesion import DMT as DMT
    from chemage_contact.adhesion import JKR as JKR
    from chemage_contact.adhesion import Maugis as Maugis
    from chemage_contact.adhesive_bem import AdhesiveBEM as AdhesiveBEM
    from chemage_contact.closed_forms import Hertz as Hertz
    from chemage_contact.closed_forms import Persson as Persson
    from chemage_contact.fft_bem import FFTBEM as FFTBEM
    from chemage_contact.peers import ContactMechanics as ContactMechanics
    from chemage_contact.peers import Tamaas as Tamaas

KINDS = {
    "contact": {
        "fft-bem": "chemage_contact.fft_bem:FFTBEM",
        "hertz": "chemage_contact.closed_forms:Hertz",
        "adhesive-bem": "chemage_contact.adhesive_bem:AdhesiveBEM",
        "jkr": "chemage_contact.adhesion:JKR",
        "dmt": "chemage_contact.adhesion:DMT",
        "maugis": "chemage_contact.adhesion:Maugis",
        "persson": "chemage_contact.closed_forms:Persson",
        "tamaas": "chemage_contact.peers:Tamaas",
        "contactmechanics": "chemage_contact.peers:ContactMechanics",
    }
}

#: kind -> the library that it needs, which chemage does not install, and its licence
CHEMAGE_NEEDS = {
    "tamaas": "tamaas (AGPL-3.0)",
    "contactmechanics": "ContactMechanics (MIT)",
}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The solvers of this package."""
    return KINDS


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scene of the Contact-Mechanics Challenge."""
    return {"contact-challenge": "chemage_contact:scenes/contact-challenge.toml"}
