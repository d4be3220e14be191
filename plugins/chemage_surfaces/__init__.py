"""Surfaces (``self-affine``, ``sphere``, ``from-file``, ``measured``, ``roughened``), and readers of height maps
(``npy``, ``text``, ``hdf5``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_surfaces._maps import HeightUnit as HeightUnit
    from chemage_surfaces._maps import surface_of as surface_of
    from chemage_surfaces.from_file import FromFile as FromFile
    from chemage_surfaces.measured import Measured as Measured
    from chemage_surfaces.readers import Hdf5 as Hdf5
    from chemage_surfaces.readers import Npy as Npy
    from chemage_surfaces.readers import Text as Text
    from chemage_surfaces.roughened import Roughened as Roughened
    from chemage_surfaces.roughness_fit import RoughnessFit as RoughnessFit
    from chemage_surfaces.roughness_fit import fit_roughness as fit_roughness
    from chemage_surfaces.self_affine import SelfAffine as SelfAffine
    from chemage_surfaces.sphere import Sphere as Sphere

_HOME = {
    "FromFile": "from_file",
    "Hdf5": "readers",
    "HeightUnit": "_maps",
    "Measured": "measured",
    "Npy": "readers",
    "Roughened": "roughened",
    "RoughnessFit": "roughness_fit",
    "SelfAffine": "self_affine",
    "Sphere": "sphere",
    "Text": "readers",
    "fit_roughness": "roughness_fit",
    "surface_of": "_maps",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return {
        "surface": {
            "self-affine": "chemage_surfaces.self_affine:SelfAffine",
            "sphere": "chemage_surfaces.sphere:Sphere",
            "from-file": "chemage_surfaces.from_file:FromFile",
            "measured": "chemage_surfaces.measured:Measured",
            "roughened": "chemage_surfaces.roughened:Roughened",
        },
        "reader": {
            "npy": "chemage_surfaces.readers:Npy",
            "text": "chemage_surfaces.readers:Text",
            "hdf5": "chemage_surfaces.readers:Hdf5",
        },
    }


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage roughness``."""
    from chemage_surfaces.command import roughness

    return [("roughness", roughness)]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
