"""Which scenes each figure and table needs. One sweep a study; stages are shared between studies by content."""

from __future__ import annotations

from typing import Any

from chemage.scene import override, scene_data
from chemage_silica.reproduction.published import TABLE_1

#: µN
LOADS = (5, 10, 20, 50, 100, 200, 350, 500)
SLOPES = (0.05, 0.075, 0.1, 0.15, 0.2)
STRENGTHS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
#: seeds of the surfaces; the first is the one of the scene silica-rough
SURFACE_SEEDS = (7, 8, 9, 10, 11, 12, 13, 14)

#: which studies a target needs
TARGETS: dict[str, tuple[str, ...]] = {
    "fig1": ("loads",),
    "fig2": ("loads",),
    "fig3": ("slopes",),
    "fig4": ("interaction",),
    "fig5": ("rows",),
    "fig6": ("front",),
    "table1": ("rows",),
    "kappa": ("loads", "rows"),
}


def base() -> dict[str, Any]:
    """The scene all studies vary: silica-rough with the spectra the figures need."""
    data, _ = scene_data("silica-rough")
    data["observe"] = [{"kind": "barrier-spectrum"}, {"kind": "pressure-spectrum"}]
    return data


def study(name: str, seeds: tuple[int, ...], pixels: int | None = None) -> dict[str, Any]:
    """Scene data with its ``[sweep]``. ``pixels`` coarsens every surface, for quick looks and tests."""
    changes: dict[str, Any] = {"name": f"reproduce-{name}"}
    if pixels is not None:
        changes |= {"surface.pixels": pixels, "surface.pixel_size": 1129.5 / pixels}
    sweep = _axes(name)
    sweep["surface"] = {**sweep.get("surface", {}), "seed": list(seeds)}
    if name == "front":
        changes |= {"surface.rms_slope": 0.4, "chemistry.hydroxylation": 0.5, "chemistry.front_factor": 0.15}
    return {**override(base(), changes), "sweep": sweep}


def _axes(name: str) -> dict[str, Any]:
    match name:
        case "loads":
            return {"contact": {"load": [1000.0 * load for load in LOADS]}}
        case "slopes":
            return {
                "surface": {"rms_slope": list(SLOPES)},
                "chemistry": {"activation_volume": ["6.4 angstrom**3", 0.0]},
            }
        case "interaction":
            return {"interaction": {"strength": list(STRENGTHS)}}
        case "rows":
            rows = {
                "hurst": [row.hurst for row in TABLE_1],
                "zeta": [row.zeta for row in TABLE_1],
                "eta": [row.eta for row in TABLE_1],
                "rms_slope": [0.05 for _ in TABLE_1],
            }
            return {"zip": [{"surface": rows}]}
        case "front":
            return {}
    raise KeyError(name)
