"""Silica surfaces with silanol groups that form siloxane bridges.

After Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018): the barrier distribution ``md-silica``, and the scenes
``silica-rough``, ``silica-patch``, ``silica-tip``, ``silica-tips``, ``silica-afm-tip``, ``silica-linear-tip`` and
``silica-humid-tip``, and the material ``silica``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_silica.barriers import MDSilica as MDSilica

KINDS = {"barriers": {"md-silica": "chemage_silica.barriers:MDSilica"}}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The components of this package."""
    return KINDS


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scenes of this package."""
    names = (
        "silica-rough",
        "silica-patch",
        "silica-tip",
        "silica-tips",
        "silica-afm-tip",
        "silica-linear-tip",
        "silica-humid-tip",
    )
    return {name: f"chemage_silica:scenes/{name}.toml" for name in names}


@hookimpl
def chemage_published() -> list[tuple[dict[str, Any], float, str]]:
    """β of Fig. 3 of the paper at 20 µN by rms slope, without and with the activation volume of 6.4 Å³."""
    published = {
        0.0064: {0.05: 0.89, 0.1: 0.45, 0.2: 0.20},
        0.0: {0.05: 0.98, 0.1: 0.49, 0.2: 0.24},
    }
    same: dict[str, Any] = {
        "surface.kind": "self-affine",
        "surface.hurst": 0.8,
        "surface.zeta": 150,
        "surface.eta": 3,
        "contact.load": 20000,
        "forming.kind": "md-silica",
        "interaction.strength": 0.5,
        "hold.temperature": 300,
        "chemistry.front_factor": 1,
        "chemistry.hydroxylation": 1,
    }
    return [
        (
            {
                **same,
                "surface.rms_slope": slope,
                "chemistry.activation_volume": volume,
            },
            beta,
            "Li et al. 2018",
        )
        for volume, rows in published.items()
        for slope, beta in rows.items()
    ]


@hookimpl
def chemage_materials() -> dict[str, str]:
    """The materials of this package."""
    return {"silica": "chemage_silica:materials/silica.toml"}
