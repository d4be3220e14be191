"""``chemage study challenge``: the Contact-Mechanics Challenge of Müser et al., Tribol. Lett. 65, 118 (2017).

The scene ``contact-challenge`` against load, seed, size of the pixels and of the surface, beside Persson's theory and
what other solvers are installed. Each part is a sweep, so that an interrupted study goes on.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from chemage import ContactSolution, PlanWarning, Surface, make_surface, parse_scene, sweep
from chemage.plugin import Point, override, registry, scene_data, theory

SCENE = "contact-challenge"
#: nominal pressures, GPa: contact areas of about 0.1 to 15 %; and the reference load
PRESSURES = (1.25e-5, 3e-5, 6.25e-5, 1.25e-4, 2.5e-4, 5e-4, 1e-3, 1.9e-3)
REFERENCE = 2.5e-4
SEEDS = (1, 2, 3, 4)
#: solver with adhesion, and the work of adhesion (J/m²) and range (nm) of the challenge
ADHESIVE, WORK, RANGE = "adhesive-bem", 0.05, 2.071
#: pixels along the side of 100 µm; and sides of smaller surfaces of the same pixels, in units of 100 µm -> how many
GRIDS = (2048, 4096, 8192)
SEEDS_OF_SIDES = {0.25: 16, 0.5: 8}
#: bins of the distributions
BINS = 60


@dataclass(frozen=True)
class Distributions:
    """Of one contact: edges of bins and densities over the nominal area of pressure (1/GPa) and gap (1/nm), and the
    patch sizes in nm², largest first."""

    pressure: tuple[np.ndarray, np.ndarray]
    gap: tuple[np.ndarray, np.ndarray]
    patches: np.ndarray

    @classmethod
    def of(cls, contact: ContactSolution) -> Distributions:
        """Those of a contact that has its gap."""
        assert contact.gap is not None
        open_ = contact.gap[~contact.contact]
        counts, edges = np.histogram(open_, bins=BINS)
        pressures, density = contact.pressure_histogram(BINS)
        return cls(
            (pressures, density * contact.area_fraction),
            (edges, counts / (contact.gap.size * np.diff(edges))),
            contact.patch_sizes * contact.pixel_size**2,
        )


@dataclass(frozen=True)
class Row:
    """One contact."""

    part: str
    kind: str
    seed: int
    pixels: int
    pixel_size: float
    pressure: float
    area: float
    """A/A0, pixels with a pressure"""
    corrected: float
    """the same less the excess at the rim"""
    mean_gap: float
    """nm; nan where the solver gives neither gap nor approach"""
    patches: int
    largest: float
    """largest pressure, GPa"""


@dataclass
class Study:
    """What was computed."""

    modulus: float
    slope: float
    rows: list[Row] = field(default_factory=list)
    shape: Distributions | None = None
    #: kind -> relative L2 difference of its pressure from that of fft-bem on the same surface
    differences: dict[str, float] = field(default_factory=dict)

    @property
    def reference(self) -> list[Row]:
        """Those of the surfaces of 100 µm at the reference load."""
        return [row for row in self.of("loads") if abs(row.pressure / REFERENCE - 1) < 1e-6]

    def of(self, part: str) -> list[Row]:
        """The rows of one part."""
        return [row for row in self.rows if row.part == part]

    def persson(self, pressure: float) -> float:
        """A/A0 of Persson's theory."""
        return float(theory.persson_area_fraction(pressure / (self.modulus * self.slope)))


def sweeps(quick: bool, file: Path | None) -> dict[str, dict[str, Any]]:
    """Scene data of each part; a surface from a ``file`` has neither other pixels, nor other sizes, nor seeds."""
    base = {**scene_data(SCENE)[0], "material": None}
    base = {name: value for name, value in base.items() if value is not None}
    coarser = 16 if quick else 1
    if file is not None:
        base["surface"] = {"kind": "from-file", "path": str(file), "periodic": True}
    else:
        surface = base["surface"]
        base = override(base, {f"surface.{name}": surface[name] / coarser for name in ("zeta",)})
        base = override(base, {"surface.pixels": GRIDS[1] // coarser, "surface.pixel_size": 1e5 * coarser / GRIDS[1]})

    def of(changes: Mapping[str, Any], **columns: Sequence[Any]) -> dict[str, Any]:
        zipped = {name.replace("__", "."): list(values) for name, values in columns.items()}
        return {**override(base, dict(changes)), "sweep": {"zip": [zipped]}}

    seeds = SEEDS[:2] if quick else SEEDS
    loads = [f"{pressure!r} GPa" for pressure in PRESSURES]
    gap = {"contact.gap": True}
    if file is not None:
        return {"loads": of({}, contact__load=loads), "shape": of(gap, contact__load=[f"{REFERENCE!r} GPa"])}
    points = [(seed, load) for seed in seeds for load in loads]
    sides = [(side, seed) for side, count in SEEDS_OF_SIDES.items() for seed in range(1, 1 + count)]
    grids = [(grid // coarser, seed) for grid in GRIDS for seed in seeds[:2]]
    found = {
        "loads": of({}, surface__seed=[seed for seed, _ in points], contact__load=[load for _, load in points]),
        "shape": of(gap, surface__seed=[1]),
        "pixels": of(
            {},
            surface__seed=[seed for _, seed in grids],
            surface__pixels=[grid for grid, _ in grids],
            surface__pixel_size=[1e5 / grid for grid, _ in grids],
        ),
        "sides": of(
            {},
            surface__seed=[seed for _, seed in sides],
            surface__pixels=[int(GRIDS[1] * side) // coarser for side, _ in sides],
            surface__zeta=[base["surface"]["zeta"] * side for side, _ in sides],
            surface__eta=[base["surface"]["eta"] * side for side, _ in sides],
        ),
    }
    size = 1e5 * coarser / GRIDS[0]
    # half as wide, because other codes take long
    smaller: dict[str, Any] = {"surface.pixels": GRIDS[0] // 2 // coarser, "surface.pixel_size": size}
    smaller |= {f"surface.{name}": base["surface"][name] / 2 for name in ("zeta", "eta")}
    beside: dict[str, dict[str, Any]] = {"fft-bem": {"tolerance": 1e-6}}
    if find_spec("tamaas") is not None:
        beside["tamaas"] = {"tolerance": 1e-6}
    if ADHESIVE in registry.current().kinds("contact"):
        beside[ADHESIVE] = {"work_of_adhesion": WORK, "range": resolved_range(25e-3, size)}
    for kind, options in beside.items():
        contact = {"kind": kind, **{name: base["contact"][name] for name in ("modulus", "load")}, **options}
        found[kind] = {**of(smaller, surface__seed=[1]), "contact": contact}
    return found


def resolved_range(modulus: float, pixel_size: float) -> float:
    """The shortest range of the attraction, nm, of which pixels resolve the zone E* ρ²/w with two, and a margin."""
    return math.sqrt(2.1 * pixel_size * WORK / modulus)


def compute(folder: Path, report: Any, *, quick: bool = False, file: Path | None = None) -> Study:
    """Compute every part in ``folder``, where completed points are taken from.

    Raises
    ------
    ChemageError
        A point failed.
    """
    study, maps = Study(math.nan, math.nan), {}
    parts = sweeps(quick, file)
    for number, (part, data) in enumerate(parts.items()):
        report(part, number, len(parts))
        with warnings.catch_warnings(action="ignore", category=PlanWarning):  # of the pixels, which are a result here
            result = sweep(data, folder / part, executor="serial")
        for point in result:
            if point.error:
                raise RuntimeError(f"{part}: {point.error}")
            contact = point.contact()
            study.rows.append(_row(part, data, point, contact))
            study.modulus, study.slope = contact.modulus, contact.rms_slope
            if part == "shape":
                study.shape = Distributions.of(contact)
            if part in ("fft-bem", "tamaas"):
                maps[part] = contact.pressure
    if "tamaas" in maps:
        exact = maps["fft-bem"].astype(np.float64)
        study.differences["tamaas"] = float(np.linalg.norm(maps["tamaas"] - exact) / np.linalg.norm(exact))
    return study


def _row(part: str, data: Mapping[str, Any], point: Point, contact: ContactSolution) -> Row:
    seed = int(point.values.get("surface.seed", 0))
    gap = math.nan
    if contact.displacement is not None:  # since first touch, of the mean plane
        gap = _top(data, point) - contact.displacement
    return Row(
        part,
        str(contact.provenance["kind"]),
        seed,
        contact.shape[0],
        contact.pixel_size,
        contact.nominal_pressure,
        contact.area_fraction,
        contact.corrected_area / contact.nominal_area,
        gap,
        contact.patches,
        contact.max_pressure,
    )


def _top(data: Mapping[str, Any], point: Point) -> float:
    """Height of the highest point above the mean plane, nm."""
    surface = {path: value for path, value in point.changes.items() if path.startswith("surface.")}
    scene = parse_scene(override({name: value for name, value in data.items() if name != "sweep"}, surface))
    maker: Any = scene.surface
    made = _made(maker, scene.surface_seed)
    return float(made.heights.max()) - float(made.heights.mean(dtype=np.float64))


@lru_cache(maxsize=1)
def _made(maker: Any, seed: int) -> Surface:
    return make_surface(maker, seed)


def extrapolated(coarse: float, fine: float) -> float:
    """A quantity for pixels of vanishing size, from two that halve them: its error is proportional to their size."""
    return 2 * fine - coarse
