"""Ageing of the reference contacts with any density of barriers, kept in a folder so that nothing is computed twice.

All densities age the same contacts with the same random numbers: a pixel keeps its uniform number, from which the
quantile function makes its barrier. Rates are therefore smooth functions of the parameters of a density.
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
from chemage import ContactSolution, Scene
from chemage.plugin import (
    EV_PER_GPA_NM3,
    StoreError,
    container,
    override,
    random,
    scene_data,
    threads,
)
from chemage_li2018.published import SLOPES
from chemage_li2018.sweeps import coarse

#: seeds of the surfaces that calibrate, the first that of the scene silica-rough; and of those that only judge
SURFACES, JUDGES = tuple(range(7, 39)), tuple(range(101, 133))
#: hold times, s, (33,)
TIMES = chemage.hold_times("1 ms", "1e5 s", per_decade=4)


class AgeingCondition(NamedTuple):
    """What a density ages: a rough contact at 20 µN."""

    slope: float
    #: nm³, K
    volume: float = 0.0064
    temperature: float = 300.0


#: those of the six published rates, with ΔV first
FITTED = tuple(AgeingCondition(h, volume) for volume in (0.0064, 0.0) for h in SLOPES)
#: those that no published rate covers
UNUSED = tuple(
    AgeingCondition(*of)
    for of in (
        (0.07,),
        (0.14,),
        (0.1, 0.0032),
        (0.1, 0.0064, 275.0),
        (0.1, 0.0064, 325.0),
    )
)
CONDITIONS = FITTED + UNUSED


@dataclass
class DensityCurves:
    """Δμ of densities on the reference contacts, computed where ``folder`` does not have it yet."""

    folder: Path
    report: Callable[[str, int, int], None]
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
            made = partial(self._of_surface, densities, seed, conditions)
            file = f"curves-{key}-{seed}.h5"
            curves.append(self._kept(file, "curves", container.Arrays, made))
        self.report(stage, len(seeds), len(seeds))
        return np.stack([kept.values["drop"] for kept in curves], axis=1)

    def _of_surface(
        self,
        densities: Sequence[chemage.plugin.Barriers],
        seed: int,
        conditions: Sequence[AgeingCondition],
    ) -> container.Arrays:
        drop = np.zeros((len(densities), len(conditions), TIMES.size))
        for slope in {condition.slope for condition in conditions}:
            changes = {"surface.seed": seed, "surface.rms_slope": slope}
            changes |= coarse(self.pixels) if self.pixels != 2500 else {}
            data = override(scene_data("silica-rough")[0], changes)
            scene = chemage.parse_scene(data)
            file = f"contact-{slope:g}-{seed}-{self.pixels}.npz"
            made = partial(_solved, scene, seed)
            contact = self._kept(file, "contact", ContactSolution, made)
            at = [row for row, of in enumerate(conditions) if of.slope == slope]
            aged = _ageing(scene, contact, densities, [conditions[row] for row in at])
            count = len(densities), threads.available()
            drop[:, at] = threads.in_order(aged, *count, None)
        return container.Arrays(values={"drop": drop})

    def _kept(self, file: str, name: str, kind: type, make: Callable[[], Any]) -> Any:
        """What a file holds, or what is made now and kept in it where the file is missing or damaged."""
        path = self.folder / file
        try:
            return container.read(path, {name: kind})[0][name]
        except StoreError:
            made = make()
            container.write(path, {name: made}, force=True, compact=name == "contact")
            return made


def _solved(scene: Scene, seed: int) -> ContactSolution:
    return scene.contact.solve(scene.surface.make(seed), scene.load)


def _ageing(
    scene: Scene,
    contact: ContactSolution,
    densities: Sequence[chemage.plugin.Barriers],
    conditions: Sequence[AgeingCondition],
) -> Callable[[int], np.ndarray]:
    """Δμ of a density by its number, under each condition, (conditions, m)."""
    chemistry, engine = scene.chemistry, scene.engine
    assert chemistry is not None
    assert engine is not None
    disorder, noise = np.random.SeedSequence([0, 0]), random.CommonSeed([0, 1])
    lattice = chemistry.on(contact, disorder)
    uniform = random.uniforms(disorder, random.FORMING, lattice.sites)
    pressure = lattice.pressures(contact).astype(np.float64)

    def aged(number: int) -> np.ndarray:
        energies, rows = densities[number].quantile(uniform), []
        for of in conditions:
            forming = energies - of.volume * EV_PER_GPA_NM3 * pressure
            at, kelvin = lattice.model_copy(update={"forming": forming}), of.temperature
            rows.append(engine.run(at, TIMES, temperature=kelvin, seed=noise).bonds)
        return np.array(rows) * chemistry.bond_force / scene.load

    return aged
