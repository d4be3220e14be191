"""Components that are unusual and right: the kit passes them."""

from __future__ import annotations

import random as python_random
import threading
import warnings
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_engine import Plain
from kit_examples import Bed, Shell, mutant
from pydantic import Field

import chemage as ca
from chemage import InputError, Surface, testing
from chemage.plugin import KB, Barriers, BondHistory, Energy, Engine, Length, Observable, SurfaceMaker

FFT: Any = type(ca.contact("fft-bem", modulus=35.3))


class Oblong(Bed):
    """A bed of springs for grids twice as long as wide or more."""

    kind = "oblong"

    def _solve(self, surface, load, start):
        if surface.shape[0] < 2 * surface.shape[1]:
            raise InputError("surface: must be at least twice as long as wide")
        return super()._solve(surface, load, start)


class Loose(FFT):
    """A fast solution with an error of some per cent, which it declares."""

    kind = "loose"
    declared_error: ClassVar[float | None] = 0.2

    def _solve(self, surface, load, start):
        quick = FFT(modulus=self.modulus, tolerance=1e-2, gap=self.gap)
        return quick._solve(surface, load, None)


class OrNothing(Barriers):
    """A share of the sites has no barrier but a threshold, the others are spread above a gap."""

    kind = "or-nothing"
    share: float = Field(default=0.3, gt=0, lt=1)
    """share of the sites at the threshold"""
    threshold: Energy = 0.8
    """lowest barrier"""

    def quantile(self, uniform):
        above = np.maximum(uniform - self.share, 0) / (1 - self.share)
        return np.where(uniform < self.share, self.threshold, self.threshold + 0.2 + 0.4 * above)

    def density(self, energy):
        inside = (energy >= self.threshold + 0.2) & (energy <= self.threshold + 0.6)
        spread = np.where(inside, (1 - self.share) / 0.4, 0.0)
        return np.where(np.isclose(energy, self.threshold, rtol=0, atol=1e-12), np.inf, spread)


class TwoPeaks(Barriers):
    """Two narrow peaks far apart."""

    kind = "two-peaks"

    def quantile(self, uniform):
        low, high = 0.8 + 2e-3 * uniform, 1.4 + 2e-3 * (uniform - 0.5)
        return np.where(uniform < 0.5, low, high)

    def density(self, energy):
        first = (energy >= 0.8) & (energy <= 0.801)
        second = (energy >= 1.4) & (energy <= 1.401)
        return np.where(first | second, 500.0, 0.0)


class FirstReaction(Engine):
    """The first-reaction method with Python's own generator: each site draws a time, the earliest one happens."""

    kind = "first-reaction"
    restart = False

    def _run(self, lattice, hold_times, temperature, seed, start):
        n = lattice.sites.size
        state, time, formed, broken = np.zeros(n, dtype=bool), 0.0, 0, 0
        if isinstance(start, BondHistory):
            state, time = np.array(start.state), start.time
            formed, broken = int(start.formed[-1]), int(start.broken[-1])
        elif start is not None:
            state = np.array(start)
        words = ca.plugin.random.key(seed)
        draw = python_random.Random(f"{words[0]} {words[1]} {time!r}").expovariate
        never = np.inf

        def wait(i: int) -> float:
            if state[i]:
                barrier = never if lattice.breaking is None else lattice.breaking[i]
            else:
                barrier = lattice.forming[i]
                if lattice.neighbours is not None:
                    near = lattice.neighbours[i]
                    barrier += lattice.coupling[i][(near >= 0) & state[near]].sum()
            rate = lattice.attempt_frequency * np.exp(-max(barrier, 0.0) / (KB * temperature))
            return draw(float(rate)) if rate > 0 else never

        due = np.array([time + wait(i) for i in range(n)])
        counts = []
        for stop in hold_times:
            while n and due.min() <= stop:
                i = int(due.argmin())
                time = due[i]
                state[i] = not state[i]
                formed, broken = formed + int(state[i]), broken + int(not state[i])
                due[i] = time + wait(i)
                if lattice.neighbours is not None:
                    for j in lattice.neighbours[i]:
                        if j >= 0:
                            due[j] = time + wait(j)  # without memory, so drawn anew
            counts.append((int(state.sum()), formed, broken))
        bonds, made, gone = np.array(counts).T
        return BondHistory(
            hold_times=hold_times, bonds=bonds, formed=made, broken=gone, state=state, time=float(hold_times[-1]),
            temperature=temperature, engine=self.kind, lattice_hash=lattice.digest(),
        )  # fmt: skip


class Rounded(Plain):
    """An approximation: rates rounded to powers of two."""

    kind = "rounded"
    exact: ClassVar[bool] = False
    declared_error: ClassVar[float | None] = 0.4

    def _run(self, lattice, hold_times, temperature, seed, start):
        step = KB * temperature * np.log(2)
        forming = np.where(lattice.forming > 0, np.round(lattice.forming / step) * step, lattice.forming)
        return super()._run(lattice.model_copy(update={"forming": forming}), hold_times, temperature, seed, start)


class MeanField(Engine):
    """The rate equation of sites that do not interact; the sites most likely to be bonded are. Not random."""

    kind = "mean-field"
    interacting = False
    restart = False
    exact = False
    declared_error: ClassVar[float | None] = 0.05

    def _run(self, lattice, hold_times, temperature, seed, start):
        n = lattice.sites.size
        beta = 1 / (KB * temperature)
        forming = lattice.attempt_frequency * np.exp(-np.maximum(lattice.forming, 0) * beta)
        breaking = np.zeros(n)
        if lattice.breaking is not None:
            breaking = lattice.attempt_frequency * np.exp(-np.maximum(lattice.breaking, 0) * beta)
        state, begin, made, gone = np.zeros(n, dtype=bool), 0.0, 0, 0
        if isinstance(start, BondHistory):
            state, begin = np.array(start.state), start.time
            made, gone = int(start.formed[-1]), int(start.broken[-1])
        elif start is not None:
            state = np.array(start)
        first, total = state.copy(), forming + breaking
        even = np.divide(forming, total, out=np.zeros(n), where=total > 0)
        # low-discrepancy thresholds in place of random numbers, others where a run goes on
        threshold = np.mod((np.arange(n) + 1) * (0.6180339887498949 if begin == 0 else np.sqrt(2)), 1.0)
        bonds, formed, broken = [], [], []
        for stop in hold_times:
            theta = even + (first - even) * np.exp(-total * (stop - begin))
            now = theta > threshold if stop > begin else state
            made, gone = made + int((now & ~state).sum()), gone + int((state & ~now).sum())
            state = now
            bonds.append(int(state.sum()))
            formed.append(made)
            broken.append(gone)
        return BondHistory(
            hold_times=hold_times, bonds=np.array(bonds), formed=np.array(formed), broken=np.array(broken), state=state,
            time=float(hold_times[-1]), temperature=temperature, engine=self.kind, lattice_hash=lattice.digest(),
        )  # fmt: skip


class Grooves(SurfaceMaker):
    """Grooves along y on a grid that is not square: three teeth with vertical flanks; float32."""

    kind = "grooves"

    depth: Length = 2.0
    """depth of a groove"""
    pixel_size: Length = 0.5
    """edge of a pixel"""
    rows: int = Field(default=60, ge=6, multiple_of=6)
    """pixels across the grooves"""

    def make(self, seed=0):
        profile = self.depth * (np.arange(self.rows) // (self.rows // 6) % 2)
        heights = np.repeat(profile[:, None], 7, axis=1).astype(np.float32)
        return Surface(heights=heights, pixel_size=self.pixel_size, provenance={"maker": self.todict()})


class RoughTip(SurfaceMaker):
    """A tip with roughness, not periodic; the provenance names no radius because there is no closed form."""

    kind = "rough-tip"

    radius: Length = 20.0
    """radius of curvature"""

    def make(self, seed=0):
        if not isinstance(seed, np.random.SeedSequence):
            seed = ca.plugin.checked_seed(seed)
        x = (np.arange(40) - 19.5) * 0.5
        rough = 0.05 * np.random.default_rng(ca.plugin.random.key(seed)).standard_normal((40, 40))
        heights = rough - (x[:, None] ** 2 + x**2) / (2 * self.radius)
        return Surface(heights=heights, pixel_size=0.5, periodic=False, provenance={"maker": self.todict()})


class Maps(Observable):
    """Maps, a table of numbers for each hold time, flags and a single number."""

    kind = "maps"

    def measure(self, contact, lattice, history):
        bonded = np.zeros(lattice.pixels, dtype=bool)
        bonded.ravel()[lattice.sites] = history.state
        events = np.stack([history.formed, history.broken], axis=1)
        pressure = lattice.pressures(contact)
        strongest = lattice.forming[history.state].max() if history.state.any() else np.nan
        return {"bonded": bonded, "events": events, "strongest": strongest, "map": bonded * lattice.per_pixel(pressure)}


def warning_import(self, uniform):
    """A library that warns when it is imported, as a plugin may import one when it is first used."""
    import warns_on_import  # noqa: F401  # pyright: ignore[reportMissingImports]

    return 0.8 + 0.6 * uniform


UNUSUAL: dict[str, Any] = {
    "a hardness": lambda: FFT(modulus=35.3, hardness=3.0),
    "a low hardness": lambda: FFT(modulus=35.3, hardness=2.5, gap=True),
    "a sphere that yields": lambda: ca.contact("hertz", modulus=35.3, hardness=0.8, gap=True),
    "a solver without gap": lambda: Bed(),
    "a solver with an error that it declares": lambda: Loose(modulus=35.3),
    "a layer": lambda: FFT(modulus=35.3, thickness="5 nm"),
    "twenty neighbours": lambda: Shell(),
    "two hundred neighbours": lambda: Shell(reach=64, strength="0.4 eV"),
    "a point mass and a gap": lambda: OrNothing(),
    "two narrow peaks": lambda: TwoPeaks(),
    "an approximate engine": lambda: Rounded(),
    "an engine without random numbers": lambda: MeanField(),
    "an engine that draws in another way": lambda: FirstReaction(),
    "grooves on an oblong grid": lambda: Grooves(),
    "a rough tip": lambda: RoughTip(),
    "maps and tables": lambda: Maps(),
}


#: engines take longest, and solvers; quick tests check others
MARKS = dict.fromkeys(
    (
        "a sphere that yields",
        "a layer",
        "two hundred neighbours",
        "a low hardness",
        "a hardness",
        "a solver with an error that it declares",
    ),
    pytest.mark.long,
) | dict.fromkeys(("an approximate engine", "an engine that draws in another way"), pytest.mark.campaign)


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in UNUSUAL])
def test_an_unusual_component_passes(name):
    testing.check_component(UNUSUAL[name](), all=True)


def test_a_solver_for_oblong_grids_passes():
    surfaces = [testing.rough_surface((48, 20), seed=9)]
    testing.check_contact_solver(Oblong(), surfaces=surfaces, all=True)


def test_a_library_that_warns_when_it_is_imported_is_no_failure(tmp_path, monkeypatch):
    (tmp_path / "warns_on_import.py").write_text("import warnings\nwarnings.warn('numpy is old', RuntimeWarning)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    from kit_examples import Flat

    testing.check_barriers(mutant(Flat, "importing", quantile=warning_import)(), all=True)

    def old(self, uniform):
        warnings.warn("use the new one", DeprecationWarning, stacklevel=2)
        return 0.8 + 0.6 * uniform

    testing.check_barriers(mutant(Flat, "old", quantile=old)(), all=True)


def test_a_worker_of_the_checks_that_is_restarted_is_no_failure_of_the_component():
    """In the thread of loky, where numba has kept much memory in the worker."""
    from kit_examples import Flat

    def restarted(self, uniform):
        text = "A worker was restarted while some jobs were given to the executor because it was using more memory"
        thread = threading.Thread(target=warnings.warn, args=(text, UserWarning))
        thread.start()
        thread.join()
        return 0.8 + 0.6 * uniform

    testing.check_barriers(mutant(Flat, "restarted", quantile=restarted)(), all=True)
