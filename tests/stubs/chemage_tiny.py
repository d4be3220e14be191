"""A whole experiment in a few lines of numpy, with a log of what was computed and ways to fail: for tests of sweeps."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import ClassVar

import numpy as np

import chemage
from chemage import ContactSolution, InputError, Surface
from chemage.plugin import Barriers, BondHistory, ContactSolver, Energy, Engine, Pressure, SurfaceMaker


@chemage.plugin.hookimpl
def chemage_register():
    return {
        "surface": {"tiny-tip": "chemage_tiny:Tip"},
        "contact": {"tiny-even": "chemage_tiny:Even"},
        "barriers": {"tiny-flat": "chemage_tiny:Flat"},
        "engine": {"tiny-coin": "chemage_tiny:Coin"},
    }


def log(word):
    """Add a line to the file that CHEMAGE_TINY_LOG names, in one write."""
    if path := os.environ.get("CHEMAGE_TINY_LOG"):
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.write(handle, f"{word}\n".encode())
        os.close(handle)


class Tip(SurfaceMaker):
    """Random heights."""

    kind = "tiny-tip"
    pixels: int = 6
    """a side"""
    height: float = 1.0
    """nm"""

    def make(self, seed=0):
        log(f"surface {self.height} {seed}")
        heights = self.height * np.random.default_rng(seed).random((self.pixels, self.pixels))
        return Surface(heights=heights, pixel_size=1.0)

    def expected(self):
        return {"nx": self.pixels, "ny": self.pixels, "pixel_size": 1.0}


class Even(ContactSolver):
    """The same pressure on the higher half of the pixels."""

    kind = "tiny-even"
    modulus: Pressure = 1.0
    """GPa"""
    gap: bool = False
    """whether to give a gap"""
    trouble: str = ""
    """raise or kill"""

    def _solve(self, surface, load, start):
        log(f"contact {surface.heights.max():.3f} {load}")
        _trouble(self.trouble)
        high = surface.heights > np.median(surface.heights)
        return ContactSolution(
            pressure=np.where(high, load / max(1, high.sum()), 0.0),
            gap=surface.heights.max() - surface.heights if self.gap else None,
            load=load,
            pixel_size=surface.pixel_size,
            modulus=self.modulus,
            rms_slope=surface.rms_slope,
            notes=("even",),
            convergence={"residuals": [1.0, 0.1]},
            provenance={"kind": self.kind, "surface": [1, 2]},
        )

    def expected(self, surface, load):
        return {"area_fraction": 0.5, "cpu_seconds": 0.01, "bytes": 1e5}


class Flat(Barriers):
    """Uniform between 0.8 eV and ``top``."""

    kind = "tiny-flat"
    top: Energy = 1.4
    """eV"""

    def quantile(self, uniform):
        return 0.8 + (self.top - 0.8) * uniform

    def density(self, energy):
        return np.where((energy >= 0.8) & (energy <= self.top), 1 / (self.top - 0.8), 0.0)


class Coin(Engine):
    """Each site bonds at a random decade."""

    kind = "tiny-coin"
    speed_only: ClassVar[tuple[str, ...]] = ("pause",)
    bias: float = 1.0
    """how early"""
    pause: float = 0.0
    """seconds to sleep"""
    trouble: str = ""
    """raise, break, exit, kill or kill-once"""

    def _run(self, lattice, hold_times, temperature, seed, start):
        log(f"kinetics {temperature} {lattice.sites.size}")
        _hold()
        _trouble(self.trouble)
        time.sleep(self.pause)
        when = 10.0 ** (4 * np.random.default_rng(seed).random(lattice.sites.size) / self.bias)
        bonded = when[None, :] <= hold_times[:, None] * (temperature / 300.0)
        return BondHistory(
            hold_times=hold_times,
            bonds=bonded.sum(axis=1),
            formed=bonded.sum(axis=1),
            broken=np.zeros(hold_times.size, np.int64),
            state=bonded[-1],
            time=float(hold_times[-1]),
            temperature=temperature,
            engine=self.kind,
            notes=("tossed",),
        )

    def expected(self, sites, interacting):
        return {"cpu_seconds": 0.01, "bytes": 1e5}


def _hold():
    """Wait before each replica after the first so many; CHEMAGE_TINY_HOLD is a file with how many, and seconds."""
    try:
        most, seconds = Path(os.environ["CHEMAGE_TINY_HOLD"]).read_text().split()
    except (KeyError, OSError):
        return
    begun = Path(os.environ["CHEMAGE_TINY_LOG"]).read_text().splitlines()
    if sum(line.startswith("kinetics") for line in begun) > int(most):
        time.sleep(float(seconds))


def _trouble(kind):
    if kind == "raise":
        raise InputError("this one is meant to fail")
    if kind == "break":
        raise ZeroDivisionError("a bug in a plugin")
    if kind == "exit":
        raise SystemExit(3)
    if kind == "kill-once":
        marker = Path(os.environ["CHEMAGE_TINY_LOG"] + ".killed")
        try:
            marker.touch(exist_ok=False)
        except FileExistsError:
            return
    if kind.startswith("kill"):
        os.kill(os.getpid(), signal.SIGKILL)
