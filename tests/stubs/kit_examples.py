"""Components that meet every requirement of their roles, and what makes one of them fail: for tests of the kit."""

from __future__ import annotations

import re
from typing import Any, ClassVar

import numpy as np
import pytest

from chemage import ContactSolution, Surface, testing
from chemage.plugin import (
    Barriers,
    Component,
    ContactSolver,
    Energy,
    Interaction,
    Observable,
    Pressure,
    Reader,
    Rupture,
    StoreError,
    SurfaceMaker,
    checked_seed,
    random,
)


class Flat(Barriers):
    """Any barrier between two energies is as likely."""

    kind = "flat"
    cite: ClassVar[tuple[str, ...]] = ("Nobody (2000)",)

    low: Energy = 0.8
    """lower end, eV"""
    high: Energy = 1.4
    """upper end, eV"""

    def quantile(self, uniform):
        return self.low + (self.high - self.low) * uniform

    def density(self, energy):
        return np.where((energy >= self.low) & (energy <= self.high), 1 / (self.high - self.low), 0.0)


class White(SurfaceMaker):
    """White noise."""

    kind = "white"

    def make(self, seed=0):
        if not isinstance(seed, np.random.SeedSequence):
            checked_seed(seed)
        heights = random.uniforms(seed, 300, np.arange(64).reshape(8, 8))
        return Surface(heights=heights, pixel_size=1.0, provenance=self.todict())


class Chain(Interaction):
    """Each pixel feels the next in its row."""

    kind = "chain"

    def neighbours(self, pixels, periodic, sites):
        found = np.full((sites.size, 2), -1, np.int32)
        place = {int(site): i for i, site in enumerate(sites)}
        ny = pixels[1]
        for i, site in enumerate(sites.tolist()):
            x, y = divmod(site, ny)
            around = []
            for step in (-1, 1):
                other = y + step
                if (periodic or 0 <= other < ny) and other % ny != y and other % ny not in around:
                    around.append(other % ny)
            for slot, other in enumerate(around):
                found[i, slot] = place.get(x * ny + other, -1)
        return found

    def coupling(self, sites, neighbours, seed):
        there = neighbours >= 0
        mine = np.broadcast_to(sites[:, None], neighbours.shape)
        other = sites[np.where(there, neighbours, 0)] if sites.size else mine
        return np.where(there, 0.1 * random.pair_uniforms(seed, 301, mine, other), 0.0)


class Shell(Interaction):
    """Every bonded neighbour within a radius adds an energy that falls with the square of the distance."""

    kind = "shell"
    fault: ClassVar[str] = ""

    strength: Energy = 0.3
    """energy at a distance of one pixel, eV"""
    reach: int = 5
    """square of the largest distance, pixels; 5 makes 20 neighbours"""

    def _steps(self):
        far = range(-int(np.sqrt(self.reach)), int(np.sqrt(self.reach)) + 1)
        return [(i, j) for i in far for j in far if 0 < i * i + j * j <= self.reach]

    def neighbours(self, pixels, periodic, sites):
        nx, ny = pixels[::-1] if self.fault == "rows and columns mixed up" else pixels
        x, y = np.divmod(sites, ny)
        steps = self._steps()
        found = np.full((sites.size, len(steps)), -1, dtype=np.int32)
        for slot, (i, j) in enumerate(steps):
            inside = (x + i >= 0) & (x + i < nx) & (y + j >= 0) & (y + j < ny)
            if self.fault == "nothing at the edges":
                inside &= (x > 0) & (y > 0) & (x + i > 0) & (y + j > 0)
            flat = (x + i) % nx * ny + (y + j) % ny
            wraps = {"always wraps": True, "never wraps": False}.get(self.fault, periodic)
            if self.fault == "wraps along y only":
                wraps = periodic & (x + i >= 0) & (x + i < nx)
            if self.fault == "runs on into the next row":
                flat, inside = sites + i * ny + j, (sites + i * ny + j >= 0) & (sites + i * ny + j < nx * ny)
                flat = flat % (nx * ny)
            at = np.searchsorted(sites, flat).clip(max=max(sites.size - 1, 0))
            there = (sites[at] == flat) if sites.size else np.zeros(0, dtype=bool)
            there &= (flat != sites) & (inside | wraps)
            if self.fault != "twice on narrow grids":
                there &= ~(found == at[:, None]).any(axis=1)
            found[there, slot] = at[there]
        return found

    def coupling(self, sites, neighbours, seed):
        far = int(np.sqrt(self.reach))
        steps = [
            i * i + j * j for i in range(-far, far + 1) for j in range(-far, far + 1) if 0 < i * i + j * j <= self.reach
        ]
        energies = np.where(neighbours >= 0, self.strength / np.array(steps, dtype=float), 0.0)
        return self._symmetric(neighbours, energies)

    @staticmethod
    def _symmetric(neighbours, energies):
        """On narrow periodic grids a pair is seen at one of several distances; the nearest counts."""
        i, s = np.nonzero(neighbours >= 0)
        best: dict[tuple[int, int], float] = {}
        for a, b, energy in zip(i.tolist(), neighbours[i, s].tolist(), energies[i, s].tolist(), strict=True):
            pair = (min(a, b), max(a, b))
            best[pair] = max(best.get(pair, 0.0), energy)
        for a, slot, b in zip(i.tolist(), s.tolist(), neighbours[i, s].tolist(), strict=True):
            energies[a, slot] = best[min(a, b), max(a, b)]
        return energies


class Count(Observable):
    """How many bonds."""

    kind = "count"

    def measure(self, contact, lattice, history):
        return {"bonded": float(history.bonds[-1])}


class Breaking(Rupture):
    """Each bond breaks at a force proportional to its own breaking barrier."""

    kind = "breaking"
    states = True

    def force(self, bonded):
        lattice = bonded.lattice
        barriers = lattice.forming if lattice.breaking is None else lattice.breaking
        return bonded.states @ (barriers * 0.1602176634 / 0.1)


class Csv(Reader):
    """Comma-separated heights."""

    kind = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    def read(self, path):
        try:
            heights = np.loadtxt(path, delimiter=",", ndmin=2)
            if heights.size < 2:
                raise ValueError("empty")
        except (OSError, ValueError, UserWarning) as error:
            raise StoreError(f"{path}: {error}") from None
        return Surface(heights=heights, pixel_size=1.0)


class Bed(ContactSolver):
    """A bed of springs (Winkler): the pressure is the overlap times a stiffness."""

    kind = "bed"

    modulus: Pressure = 10.0
    """GPa"""

    def _solve(self, surface, load, start):
        heights = np.sort(surface.heights.ravel())[::-1].astype(float)
        size = surface.pixel_size
        stiffness = self.modulus / (size * max(surface.shape))
        if load == 0:
            level = heights[0]
        else:
            # force at the level of each pixel, then the level within the right interval
            count = np.arange(1, heights.size + 1)
            force = stiffness * size**2 * (np.cumsum(heights) - count * heights)
            n = int(np.searchsorted(force, load))
            level = (np.sum(heights[:n]) - load / (stiffness * size**2)) / n
        pressure = stiffness * np.maximum(surface.heights - level, 0)
        if load > 0:
            pressure *= load / (pressure.sum() * size**2)
        return ContactSolution(
            pressure=pressure,
            load=load,
            pixel_size=size,
            modulus=self.modulus,
            periodic=surface.periodic,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            provenance=self.todict(),
        )


def broken(base: type[Component], **changes: Any) -> Any:
    """``base`` with some attributes or methods replaced."""
    return type(f"Broken{base.__name__}", (base,), {"__module__": __name__, "__doc__": base.__doc__, **changes})


def mutant(base: type[Component], name: str, **changes: Any) -> Any:
    """``base`` with some attributes or methods replaced, as a class of this module, so that it can be pickled."""
    label = "Mutant" + "".join(word.capitalize() for word in re.split(r"\W+", f"{base.__name__} {name}"))
    made = type(label, (base,), {"__module__": __name__, "__doc__": base.__doc__, **changes})
    globals()[label] = made
    return made


def caught_by(component: Component, *names: str, **inputs: Any) -> tuple[str, str]:
    """The first check of the kit that fails, or of those called ``names``, and its message; empty where none does."""
    for check in testing.checks_for(component, **inputs):
        if names and check.name not in names:
            continue
        try:
            check(component)
        except testing.CheckFailed as failure:
            return failure.check, str(failure)
    return "", ""


def failing(component: Component, name: str, **inputs: Any) -> str:
    """The message of check ``name``, which must fail."""
    (check,) = [one for one in testing.checks_for(component, **inputs) if one.name == name]
    with pytest.raises(AssertionError) as caught:
        check(component)
    return str(caught.value)


#: a number that no earlier call had
calls = iter(range(10**9))


def flat_surface(heights: Any, **fields: Any) -> Surface:
    """A surface of pixels of 1 nm."""
    return Surface(heights=heights, pixel_size=1.0, **{"provenance": {"by": "hand"}, **fields})


def changed(solution: Any, **changes: Any) -> Any:
    """The record with some fields replaced."""
    return type(solution).fromdict({**solution.todict(), **changes})


def with_fields(**changes: Any) -> Any:
    """A function of a record that replaces fields by functions of it."""
    return lambda solution, *given: changed(solution, **{name: f(solution) for name, f in changes.items()})
