"""Surfaces (``self-affine``, ``sphere``, ``spherical-cap``, ``cone``, ``tip``, ``from-file``, ``measured``,
``roughened``, ``atoms``), and readers of height maps (``npy``, ``text``, ``hdf5``, ``x3p``, ``gwy``, ``netcdf``, ``xyz``, and
``topography`` for other files of instruments, with the library SurfaceTopography)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_surfaces._maps import HeightUnit as HeightUnit
    from chemage_surfaces._maps import surface_of as surface_of
    from chemage_surfaces.atoms import Atoms as Atoms
    from chemage_surfaces.generated import SelfAffine as SelfAffine
    from chemage_surfaces.images import FromFile as FromFile
    from chemage_surfaces.images import Measured as Measured
    from chemage_surfaces.instruments import Gwy as Gwy
    from chemage_surfaces.instruments import NetCdf as NetCdf
    from chemage_surfaces.instruments import X3p as X3p
    from chemage_surfaces.instruments import Xyz as Xyz
    from chemage_surfaces.readers import Hdf5 as Hdf5
    from chemage_surfaces.readers import Npy as Npy
    from chemage_surfaces.roughened import Roughened as Roughened
    from chemage_surfaces.roughness_fit import RoughnessFit as RoughnessFit
    from chemage_surfaces.roughness_fit import fit_roughness as fit_roughness
    from chemage_surfaces.texts import Text as Text
    from chemage_surfaces.tips import Cone as Cone
    from chemage_surfaces.tips import Sphere as Sphere
    from chemage_surfaces.tips import SphericalCap as SphericalCap
    from chemage_surfaces.tips import Tip as Tip
    from chemage_surfaces.topographies import Topography as Topography

KINDS = {
    "surface": {
        "self-affine": "chemage_surfaces.generated:SelfAffine",
        "sphere": "chemage_surfaces.tips:Sphere",
        "spherical-cap": "chemage_surfaces.tips:SphericalCap",
        "cone": "chemage_surfaces.tips:Cone",
        "tip": "chemage_surfaces.tips:Tip",
        "from-file": "chemage_surfaces.images:FromFile",
        "measured": "chemage_surfaces.images:Measured",
        "roughened": "chemage_surfaces.roughened:Roughened",
        "atoms": "chemage_surfaces.atoms:Atoms",
    },
    "reader": {
        "npy": "chemage_surfaces.readers:Npy",
        "text": "chemage_surfaces.texts:Text",
        "hdf5": "chemage_surfaces.readers:Hdf5",
        "x3p": "chemage_surfaces.instruments:X3p",
        "gwy": "chemage_surfaces.instruments:Gwy",
        "netcdf": "chemage_surfaces.instruments:NetCdf",
        "xyz": "chemage_surfaces.instruments:Xyz",
        "topography": "chemage_surfaces.topographies:Topography",
    },
}
CHEMAGE_NEEDS = {"topography": "SurfaceTopography (MIT)"}
__getattr__ = lazy_attributes(
    KINDS,
    "chemage_surfaces._maps:HeightUnit",
    "chemage_surfaces._maps:surface_of",
    "chemage_surfaces.roughness_fit:RoughnessFit",
    "chemage_surfaces.roughness_fit:fit_roughness",
)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage roughness``."""
    from chemage_surfaces.command import roughness

    return [("roughness", roughness)]
