"""Ageing of the reference contacts with any density of barriers, kept in a folder so that nothing is computed twice.

All densities age the same contacts with the same random numbers: a pixel keeps its uniform number, from which the
quantile function of the density makes its barrier. Rates are therefore smooth functions of the parameters of a density,
and differences between densities have small errors.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import chemage
from chemage import ContactSolution, ReactionLattice, Scene
from chemage.plugin import (
    EV_PER_GPA_NM3,
    FIT_WINDOW,
    StoreError,
    container,
    log_file,
    override,
    random,
    tables,
    threads,
)

#: rms slopes at the load of the scene silica-rough, and activation volumes, nm³
SLOPES = (0.05, 0.1, 0.2)
VOLUMES = (0.0064, 0.0)
#: seeds of the surfaces; the first is that of the scene silica-rough
SURFACES = tuple(range(7, 39))
#: draws of the disorder that are kept in memory
KEPT = 16
TIMES = chemage.hold_times("0.1 s", "1e4 s", per_decade=4)

Report = Callable[[str, int, int], None]


def slope_of(curves: np.ndarray) -> np.ndarray:
    """β, the slope of the line through curves (..., m) of Δμ against log10 t over the window of the paper, (...)."""
    inside = (FIT_WINDOW[0] * (1 - 1e-9) <= TIMES) & (FIT_WINDOW[1] * (1 + 1e-9) >= TIMES)
    x = np.log10(TIMES[inside])
    x = x - x.mean()
    return curves[..., inside] @ x / (x @ x)


@dataclass(frozen=True)
class _Replica:
    """One draw of the disorder on one contact; only the barriers depend on the density."""

    lattice: ReactionLattice
    #: of each site: its uniform number, (n,), and its pressure, GPa, (n,)
    uniform: np.ndarray
    pressure: np.ndarray
    noise: np.random.SeedSequence


@dataclass
class Rates:
    """Δμ of densities on the reference contacts, computed where ``folder`` does not have it yet."""

    folder: Path
    report: Report
    #: pixels per side; fewer than 2500 coarsen the surface, for tests
    pixels: int = 2500
    _known: dict[tuple[str, int, float, int], np.ndarray] = field(default_factory=dict)
    _replicas: dict[tuple[int, float, int], _Replica] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        data, _ = chemage.plugin.scene_data("silica-rough")
        scale: dict[str, Any] = {"surface.pixels": self.pixels, "surface.pixel_size": 2500 * 0.4518 / self.pixels}
        # each pixel is a site of a coarser surface
        scale["chemistry.site_density"] = "pixel"
        self._data = override(data, scale) if self.pixels != 2500 else data
        if self._file.exists():
            for line in tables.read_text(self._file).splitlines():
                try:
                    row = json.loads(line)
                except json.JSONDecodeError:  # the last line of an interrupted run
                    continue
                self._known[row["density"], row["seed"], row["slope"], row["replicas"]] = np.array(row["curves"])

    @property
    def _file(self) -> Path:
        return self.folder / f"rates-{self.pixels}.jsonl"

    def curves(
        self, stage: str, densities: Sequence[chemage.plugin.Barriers], seeds: Sequence[int], replicas: int
    ) -> np.ndarray:
        """Δμ, mean over replicas: (densities, seeds, volumes, slopes, m).

        Parameters
        ----------
        stage
            Name of the progress bar.
        densities, seeds, replicas
            Each density ages every surface, with as many draws of the disorder.
        """
        keys = [density.digest() for density in densities]
        jobs = [(seed, slope) for seed in seeds for slope in SLOPES]
        self.report(stage, 0, len(jobs))
        for done, (seed, slope) in enumerate(jobs):
            missing = {
                key: density
                for key, density in zip(keys, densities, strict=True)
                if (key, seed, slope, replicas) not in self._known
            }
            # drawn before the threads start, so that none is drawn twice
            draws = [self._replica(seed, slope, number) for number in range(replicas)] if missing else []
            with ThreadPoolExecutor(threads.available()) as pool:
                every = pool.map(lambda density: self._aged(density, draws), missing.values())  # noqa: B023
                for key, curves in zip(missing, every, strict=True):
                    self._keep(key, seed, slope, replicas, curves)
            self.report(stage, done + 1, len(jobs))
        return np.array(
            [
                [np.stack([self._known[key, seed, slope, replicas] for slope in SLOPES], axis=1) for seed in seeds]
                for key in keys
            ]
        )

    def _keep(self, key: str, seed: int, slope: float, replicas: int, curves: np.ndarray) -> None:
        self._known[key, seed, slope, replicas] = curves
        row = {"density": key, "seed": seed, "slope": slope, "replicas": replicas, "curves": curves.round(9).tolist()}
        with log_file(self._file) as file:
            file.write(json.dumps(row) + "\n")

    def _aged(self, density: chemage.plugin.Barriers, draws: Sequence[_Replica]) -> np.ndarray:
        """Δμ on one contact, mean over draws of the disorder, (volumes, m)."""
        scene = self._scene(SURFACES[0], SLOPES[0])
        assert scene.chemistry is not None
        assert scene.engine is not None
        assert scene.hold is not None
        bonds = np.zeros((len(VOLUMES), TIMES.size))
        for draw in draws:
            intrinsic = density.quantile(draw.uniform)
            for row, volume in zip(bonds, VOLUMES, strict=True):
                forming = intrinsic - volume * EV_PER_GPA_NM3 * draw.pressure
                lattice = draw.lattice.model_copy(update={"forming": forming})
                row += scene.engine.run(lattice, TIMES, temperature=scene.hold.temperature, seed=draw.noise).bonds
        return bonds * scene.chemistry.bond_force / scene.load / len(draws)

    def _scene(self, seed: int, slope: float) -> Scene:
        return chemage.parse_scene(override(self._data, {"surface.seed": seed, "surface.rms_slope": slope}))

    def _replica(self, seed: int, slope: float, number: int) -> _Replica:
        if (seed, slope, number) not in self._replicas:
            scene = self._scene(seed, slope)
            assert scene.chemistry is not None
            # those of a few surfaces are kept, which serve many densities
            if len(self._replicas) >= KEPT:
                self._replicas.clear()
            contact = self._contact(scene, seed, slope)
            disorder = np.random.SeedSequence([number, 0])
            lattice = scene.chemistry.on(contact, disorder)
            self._replicas[seed, slope, number] = _Replica(
                lattice,
                random.uniforms(disorder, random.FORMING, lattice.sites),
                lattice.pressures(contact).astype(np.float64),
                random.CommonSeed([number, 1]),
            )
        return self._replicas[seed, slope, number]

    def _contact(self, scene: Scene, seed: int, slope: float) -> ContactSolution:
        """The contact, which the folder keeps."""
        path = self.folder / f"contact-{slope:g}-{seed}-{self.pixels}.npz"
        try:
            return container.read(path, {"contact": ContactSolution})[0]["contact"]
        except StoreError:  # missing, or damaged
            solution = scene.contact.solve(scene.surface.make(seed), scene.load)
            container.write(path, {"contact": solution}, compact=True, force=True)
            return solution


def logarithms(curves: np.ndarray) -> np.ndarray:
    """ln β of curves (densities, seeds, volumes, slopes, m): (densities, seeds, 6), with ΔV first."""
    beta = np.log(slope_of(curves))
    return beta.reshape(*beta.shape[:2], -1)


def mean_logarithms(curves: np.ndarray) -> np.ndarray:
    """ln β, mean over surfaces, (densities, 6)."""
    return logarithms(curves).mean(axis=1)
