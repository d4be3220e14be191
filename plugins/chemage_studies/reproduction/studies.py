"""The scenes of each figure and table; all of them form one sweep, so that figures share contacts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from chemage import InputError, nearest, override, scene_data
from chemage_studies.reproduction.published import TABLE_1

#: nN
LOADS = tuple(1000.0 * load for load in (5, 10, 20, 50, 100, 200, 350, 500))
SLOPES = (0.05, 0.075, 0.1, 0.15, 0.2)
#: eV
STRENGTHS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
#: nm³: 6.4 Å³, and none
VOLUMES = (0.0064, 0.0)
#: seeds of the surfaces; the first is that of the scene silica-rough
SURFACE_SEEDS = tuple(range(7, 7 + 32))

#: the studies of each figure or table
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

#: the reference of every study: the scene silica-rough
_REFERENCE: dict[str, Any] = {
    "surface.rms_slope": 0.1,
    "surface.hurst": 0.8,
    "surface.zeta": 150.0,
    "surface.eta": 3.0,
    "contact.load": 20000.0,
    "chemistry.activation_volume": 0.0064,
    "chemistry.hydroxylation": 1.0,
    "chemistry.front_factor": 1.0,
    "interaction.strength": 0.5,
}


def chosen(names: Sequence[str]) -> list[str]:
    """Check the names of targets and sort them as in the paper; none, or ``all``, means all targets.

    Raises
    ------
    InputError
        There is no such target.
    """
    for name in names:
        if name not in (*TARGETS, "all"):
            known = [*TARGETS, "all"]
            raise InputError(f"no target {name!r}{nearest(name, known)}; the targets are {', '.join(known)}")
    return list(TARGETS) if not names or "all" in names else [name for name in TARGETS if name in names]


def members(study: str) -> list[dict[str, Any]]:
    """List the points of a study for one surface seed: dotted path -> value, with all varied paths in each."""
    match study:
        case "loads":
            varied: Iterable[dict[str, Any]] = ({"contact.load": load} for load in LOADS)
        case "slopes":
            varied = (
                {"surface.rms_slope": slope, "chemistry.activation_volume": volume}
                for volume in VOLUMES
                for slope in SLOPES
            )
        case "interaction":
            varied = ({"interaction.strength": strength} for strength in STRENGTHS)
        case "rows":
            varied = (
                {
                    "surface.rms_slope": 0.05,
                    "surface.hurst": row.hurst,
                    "surface.zeta": row.zeta,
                    "surface.eta": row.eta,
                }
                for row in TABLE_1
            )
        case "front":
            varied = (
                {"surface.rms_slope": 0.4, "chemistry.hydroxylation": 0.5, "chemistry.front_factor": 0.15} for _ in [0]
            )
        case _:
            raise KeyError(study)
    return [{**_REFERENCE, **changes} for changes in varied]


def scene(targets: Sequence[str], seeds: Sequence[int], pixels: int | None = None) -> dict[str, Any]:
    """Make scene data whose sweep has every point of ``targets`` once for every surface seed.

    ``pixels`` coarsens every surface at constant size, for tests.

    Raises
    ------
    InputError
        ``pixels`` cannot resolve the shortest wavelength.
    """
    data, _ = scene_data("silica-rough")
    data = override(data, {"name": "reproduction"})
    data["observe"] = [{"kind": "barrier-spectrum"}, {"kind": "pressure-spectrum"}]
    if pixels is not None:
        if pixels < 320:
            raise InputError.of(
                "pixels", pixels, "cannot resolve the shortest wavelength (ζ = 150)", "give 320 or more"
            )
        data = override(data, {"surface.pixels": pixels, "surface.pixel_size": 2500 * 0.4518 / pixels})
    points: dict[str, dict[str, Any]] = {}
    for study in dict.fromkeys(study for target in targets for study in TARGETS[target]):
        for point in members(study):
            points.setdefault(repr(point), point)
    together: dict[str, Any] = {path: [point[path] for point in points.values()] for path in _REFERENCE}
    return {**data, "sweep": {"zip": [together], "surface.seed": list(seeds)}}
