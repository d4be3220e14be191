"""Ageing of the reference contacts with any density of barriers, kept in a folder so that nothing is computed twice.

All densities age the same contacts with the same random numbers: a pixel keeps its uniform number, from which the
quantile function of the density makes its barrier. Rates are therefore smooth functions of the parameters of a density,
and differences between densities have small errors.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import chemage
from chemage import ContactSolution, ReactionLattice, Scene
from chemage.plugin import (
    EV_PER_GPA_NM3,
    StoreError,
    container,
    override,
    random,
    scene_data,
    threads,
)
from chemage_li2018.sweeps import coarse

#: seeds of the surfaces; the first is that of the scene silica-rough
SURFACES = tuple(range(7, 23))
#: hold times, s, (33,)
TIMES = chemage.hold_times("1 ms", "1e5 s", per_decade=4)
#: draws of the disorder on a tip, which has few sites
TIP_DRAWS = 40

Report = Callable[[str, int, int], None]


class AgeingCondition(NamedTuple):
    """What a density ages: a rough contact at 20 µN, or the tip of the scene silica-afm-tip (``slope`` 0)."""

    slope: float
    #: nm³, K
    volume: float = 0.0064
    temperature: float = 300.0

    def __str__(self) -> str:
        changed = [f"ΔV = {1000 * self.volume:.2g} Å³"] if self.volume != 0.0064 else []
        changed += [f"T = {self.temperature:g} K"] if self.temperature != 300.0 else []
        return ", ".join([f"h' = {self.slope:g}", *changed])


#: those of the six published rates, with ΔV first
FITTED = tuple(
    AgeingCondition(slope, volume)
    for volume in (0.0064, 0.0)
    for slope in (0.05, 0.1, 0.2)
)
#: those that no published rate covers
UNUSED = (
    AgeingCondition(0.07),
    AgeingCondition(0.14),
    AgeingCondition(0.1, volume=0.0032),
    AgeingCondition(0.1, temperature=275.0),
    AgeingCondition(0.1, temperature=325.0),
)
TIP = AgeingCondition(0.0)


@dataclass(frozen=True)
class _Draw:
    """One draw of the disorder on one contact; only the barriers depend on the density."""

    lattice: ReactionLattice
    #: of each site: its uniform number, (n,), and its pressure, GPa, (n,)
    uniform: np.ndarray
    pressure: np.ndarray
    noise: np.random.SeedSequence


@dataclass
class DensityCurves:
    """Δμ of densities on the reference contacts, computed where ``folder`` does not have it yet."""

    folder: Path
    report: Report
    #: pixels per side; fewer than 2500 coarsen the surface, for tests
    pixels: int = 2500

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)

    def curves(
        self,
        stage: str,
        densities: Sequence[chemage.plugin.Barriers],
        seeds: Sequence[int],
        conditions: Sequence[AgeingCondition] = FITTED,
    ) -> np.ndarray:
        """Δμ of every density on every surface under every condition: (densities, seeds, conditions, m).

        ``stage`` is the name of the progress bar.
        """
        digests = [density.digest() for density in densities]
        named = repr((digests, conditions, self.pixels)).encode()
        key = hashlib.blake2b(named, digest_size=8).hexdigest()
        curves = []
        for done, seed in enumerate(seeds):
            self.report(stage, done, len(seeds))
            kept = self._kept(
                f"curves-{key}-{seed}.h5",
                "curves",
                lambda seed=seed: self._of_surface(densities, seed, conditions),
            )
            curves.append(kept.values["drop"])
        self.report(stage, len(seeds), len(seeds))
        return np.stack(curves, axis=1)

    def _of_surface(
        self,
        densities: Sequence[chemage.plugin.Barriers],
        seed: int,
        conditions: Sequence[AgeingCondition],
    ) -> container.Arrays:
        values = np.zeros((len(densities), len(conditions), TIMES.size))
        slopes = np.array([condition.slope for condition in conditions])
        for slope in dict.fromkeys(slopes.tolist()):
            scene = self._scene(seed, slope)
            chosen = np.flatnonzero(slopes == slope)
            asked = [conditions[at] for at in chosen.tolist()]
            aged = partial(_aged, scene, densities, self._draws(scene, slope), asked)
            values[:, chosen] = threads.in_order(
                aged, len(densities), threads.available(), None
            )
        return container.Arrays(values={"drop": values})

    def _scene(self, seed: int, slope: float) -> Scene:
        data, _ = scene_data("silica-rough" if slope else "silica-afm-tip")
        changes: dict[str, Any] = {}
        if slope:
            changes = {"surface.seed": seed, "surface.rms_slope": slope}
            changes |= coarse(self.pixels) if self.pixels != 2500 else {}
        return chemage.parse_scene(override(data, changes))

    def _draws(self, scene: Scene, slope: float) -> list[_Draw]:
        assert scene.chemistry is not None
        contact = self._contact(scene, slope)
        draws = []
        for number in range(1 if slope else TIP_DRAWS):
            disorder = np.random.SeedSequence([number, 0])
            lattice = scene.chemistry.on(contact, disorder)
            uniform = random.uniforms(disorder, random.FORMING, lattice.sites)
            pressure = lattice.pressures(contact).astype(np.float64)
            noise = random.CommonSeed([number, 1])
            draws.append(_Draw(lattice, uniform, pressure, noise))
        return draws

    def _contact(self, scene: Scene, slope: float) -> ContactSolution:
        """The contact; of rough ones the folder keeps the pressures."""
        seed = scene.surface_seed

        def solve() -> ContactSolution:
            return scene.contact.solve(scene.surface.make(seed), scene.load)

        name = f"contact-{slope:g}-{seed}-{self.pixels}.npz"
        return self._kept(name, "contact", solve, compact=True) if slope else solve()

    def _kept(
        self, file: str, name: str, make: Callable[[], Any], *, compact: bool = False
    ) -> Any:
        """What a file holds, or what is made now and kept in it where the file is missing or damaged."""
        path = self.folder / file
        kinds = {"curves": container.Arrays, "contact": ContactSolution}
        try:
            return container.read(path, {name: kinds[name]})[0][name]
        except StoreError:
            made = make()
            container.write(path, {name: made}, force=True, compact=compact)
            return made


def _aged(
    scene: Scene,
    densities: Sequence[chemage.plugin.Barriers],
    draws: Sequence[_Draw],
    conditions: Sequence[AgeingCondition],
    number: int,
) -> np.ndarray:
    """Δμ of one of the densities under each condition, mean over draws of the disorder, (conditions, m)."""
    assert scene.chemistry is not None
    assert scene.engine is not None
    bonds = np.zeros((len(conditions), TIMES.size))
    for row, condition in zip(bonds, conditions, strict=True):
        for draw in draws:
            energies = densities[number].quantile(draw.uniform)
            shift = condition.volume * EV_PER_GPA_NM3 * draw.pressure
            lattice = draw.lattice.model_copy(update={"forming": energies - shift})
            history = scene.engine.run(
                lattice, TIMES, temperature=condition.temperature, seed=draw.noise
            )
            row += history.bonds
    return bonds * scene.chemistry.bond_force / scene.load / len(draws)
