"""Components written from ``docs/plugins.md`` alone, one of each role, pass the kit as they are."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
import pytest
from pydantic import Field

from chemage import ContactSolution, InputError, Surface, testing
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    AgedBonds,
    AgeingMethod,
    Barriers,
    ContactSolver,
    Energy,
    Interaction,
    Length,
    Observable,
    Output,
    Pressure,
    Reader,
    Rupture,
    StoreError,
    SurfaceMaker,
    Unit,
)


class EggBox(SurfaceMaker):
    """A square array of summits."""

    kind = "egg-box"

    amplitude: Length = 0.2
    """height of a summit above the mean, nm"""
    period: Length = 8.0
    """distance of neighbouring summits, nm"""
    summits: int = Field(default=2, ge=1)
    """summits along each side"""
    pixels: int = Field(default=32, ge=8)
    """pixels along each side"""

    def make(self, seed=0):
        wave = np.cos(2 * np.pi * self.summits * np.arange(self.pixels) / self.pixels)
        return Surface(
            heights=0.5 * self.amplitude * (wave[:, None] + wave),
            pixel_size=self.summits * self.period / self.pixels,
            provenance=self.todict(),
        )


class AsciiGrid(Reader):
    """Numbers of columns and rows and the edge of a pixel (nm) in three lines, then rows of heights (nm) at each y."""

    kind = "ascii-grid"
    suffixes: ClassVar = (".asc",)

    def read(self, path):
        try:
            with open(path, encoding="ascii") as file:
                columns, rows, size = (float(file.readline().split()[1]) for _ in range(3))
                heights = np.loadtxt(file, ndmin=2)
            if heights.shape != (rows, columns):
                raise ValueError(f"{heights.shape[0]} rows of {heights.shape[1]} heights")
        except (OSError, ValueError, IndexError, UserWarning) as error:
            raise StoreError(f"{path}: no ASCII grid: {error}") from None
        return Surface(heights=heights.T, pixel_size=size, periodic=False)


class PolonskyKeer(ContactSolver):
    """Conjugate gradients on the pixels in contact of a periodic half-space."""

    kind = "polonsky-keer"
    cite = ("I. A. Polonsky, L. M. Keer, Wear 231, 206 (1999)",)
    implemented_properties = ("pressure", "gap")

    modulus: Pressure
    """contact modulus, GPa"""

    def _solve(self, surface, load, start):
        if not surface.periodic:
            raise InputError("surface: polonsky-keer repeats it, and it is not periodic; use 'fft-bem'")
        heights, area = np.array(surface.heights, float), surface.pixel_size**2
        q = np.hypot(
            *np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n, surface.pixel_size) for n in surface.shape), indexing="ij")
        )
        q[0, 0] = np.inf
        pressure = np.full(surface.shape, load / (heights.size * area))
        search, before = np.zeros(surface.shape), 1.0
        for _ in range(2000 if load > 0 else 0):
            gap = self._displacement(pressure, q) - heights
            touching = pressure > 0
            gap -= gap[touching].mean()
            size = float((gap[touching] ** 2).sum())
            search = np.where(touching, gap + size / before * search, 0.0)
            change = self._displacement(search, q)
            change -= change[touching].mean()
            bend = float((change * search)[touching].sum())
            step = float((gap * search)[touching].sum()) / bend if bend else 0.0
            pressure = np.where(touching, np.maximum(pressure - step * search, 0.0), 0.0)
            overlap = (pressure == 0) & (gap < 0)
            pressure[overlap] -= step * gap[overlap]
            before = np.inf if overlap.any() else size
            pressure *= load / (pressure.sum() * area)
            if size <= 1e-16 * touching.sum() * max(float(np.ptp(heights)) ** 2, 1e-300) and not overlap.any():
                break
        gap = self._displacement(pressure, q) - heights
        gap -= gap[pressure > 0].mean() if load > 0 else gap.min()
        return ContactSolution(
            pressure=pressure,
            gap=gap,
            load=load,
            pixel_size=surface.pixel_size,
            modulus=self.modulus,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            provenance=self.provenance(surface),
        )

    def _displacement(self, pressure, q):
        return np.fft.ifft2(2 * np.fft.fft2(pressure) / (self.modulus * q)).real


class Triangular(Barriers):
    """Most barriers are near one energy, and none further from it than a width."""

    kind = "triangular"

    middle: Energy = 1.1
    """the most frequent barrier, eV"""
    width: Annotated[float, Unit("eV", gt=0)] = 0.3
    """largest distance from it, eV"""

    def quantile(self, uniform):
        below = self.width * (np.sqrt(2 * np.minimum(uniform, 0.5)) - 1)
        above = self.width * (1 - np.sqrt(2 * (1 - np.maximum(uniform, 0.5))))
        return self.middle + np.where(uniform < 0.5, below, above)

    def density(self, energy):
        return np.maximum(1 - np.abs(energy - self.middle) / self.width, 0.0) / self.width


class Cross(Interaction):
    """A bond makes those of the four nearest sites harder to form."""

    kind = "cross"

    strength: Energy = 0.04
    """by how much the barrier of a neighbour rises, eV"""

    def neighbours(self, pixels, periodic, sites):
        (nx, ny), found = pixels, []
        x, y = np.divmod(sites, ny)
        for i, j in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            inside = (x + i >= 0) & (x + i < nx) & (y + j >= 0) & (y + j < ny)
            pixel = (x + i) % nx * ny + (y + j) % ny
            at = np.minimum(np.searchsorted(sites, pixel), max(sites.size - 1, 0))
            there = (inside | periodic) & (pixel != sites)
            there &= sites[at] == pixel if sites.size else there
            for other in found:
                there &= other != at  # a grid of two pixels has one neighbour on both sides
            found.append(np.where(there, at, -1))
        return np.array(found, np.int32).T.copy()

    def coupling(self, sites, neighbours, seed):
        return np.where(neighbours >= 0, self.strength, 0.0)


class Capped(Rupture):
    """Each bond bears its barrier over a distance, as far as the solid around it bears that."""

    kind = "capped"
    states = True

    distance: Length = 0.1
    """distance to the barrier, nm"""
    strength: Annotated[float, Unit("nN", gt=0)] = 2.0
    """largest force on a bond, nN"""

    def check(self, chemistry, temperature):
        if chemistry.breaking is None:
            raise InputError("rupture 'capped' needs the barriers to breaking a bond; give [breaking]")

    def force(self, bonded):
        if bonded.lattice.breaking is None:
            raise InputError("rupture 'capped' needs the barriers to breaking a bond; give [breaking]")
        forces = np.maximum(bonded.lattice.breaking, 0.0) / EV_PER_GPA_NM3 / self.distance
        return bonded.states @ np.minimum(forces, self.strength)


class Crowding(Observable):
    """How dense bonds are, and how much more pressure there is on them than on all sites, at each hold time."""

    kind = "crowding"
    states = True
    outputs: ClassVar = {
        "bond_density": Output(("hold_time",), "1/nm**2", "bonds per real contact area"),
        "excess_pressure": Output(
            ("hold_time",), "GPa", "mean pressure on bonds less that on all sites, 0 without bonds"
        ),
        "map": Output(("x", "y"), "", "bonds in each pixel of the sites at the end"),
    }

    def measure(self, contact, lattice, history):
        pressure, count = lattice.pressures(contact), history.states.sum(axis=1)
        mean = history.states @ pressure / np.maximum(count, 1)
        return {
            "bond_density": count / max(contact.area, 1e-300),
            "excess_pressure": np.where(count > 0, mean - pressure.sum() / max(pressure.size, 1), 0.0),
            "map": lattice.per_pixel(history.state.astype(float)),
        }


class TwoStates(AgeingMethod):
    """Sites by themselves that form a bond and break it, averaged over the barriers to both."""

    kind = "two-states"
    replicates = False

    ranks: int = Field(default=300, ge=10)
    """barriers of each kind over which a site is averaged"""

    def check(self, chemistry, engine):
        if chemistry.interaction is not None:
            raise InputError("ageing 'two-states' treats sites by themselves; leave [interaction] out")

    def age(self, request):
        chemistry, thermal = request.chemistry, KB * request.temperature
        self.check(chemistry, request.engine)
        ranks = (np.arange(self.ranks) + 0.5) / self.ranks
        broken = 0.0
        if chemistry.breaking is not None:
            energy = np.maximum(chemistry.breaking.quantile(ranks), 0.0)
            broken = chemistry.attempt_frequency * np.exp(-energy / thermal)[:, None]
        pressures, counts = np.unique(chemistry.sites_of(request.solution).pressure, return_counts=True)
        bonds, forming = np.zeros(request.hold_times.size), chemistry.forming.quantile(ranks)
        for pressure, count in zip(pressures, counts, strict=True):
            energy = np.maximum(forming - chemistry.activation_volume * EV_PER_GPA_NM3 * float(pressure), 0.0)
            formed = chemistry.attempt_frequency * np.exp(-energy / thermal)
            both = formed + broken
            share = np.divide(formed, both, out=np.zeros_like(both), where=both > 0)
            bonds += count * np.array([np.mean(share * -np.expm1(-both * time)) for time in request.hold_times])
        return AgedBonds(
            bonds=chemistry.hydroxylation * bonds[None],
            sites=np.array([chemistry.hydroxylation * counts.sum()]),
            errors={"ranks": np.full(bonds.size, 1 / self.ranks)},
            error_sources={"ranks": f"bound, {self.ranks} barriers in place of all"},
        )


WRITTEN = [
    EggBox(),
    EggBox(summits=3, pixels=48),
    PolonskyKeer(modulus="35.3 GPa"),
    Triangular(),
    Cross(),
    Capped(),
    Crowding(),
    TwoStates(),
]


@pytest.mark.parametrize("component", WRITTEN, ids=lambda one: one.kind)
def test_a_component_written_from_the_docs_passes_at_first_go(component):
    testing.check_component(component, all=True)


def test_a_reader_written_from_the_docs_passes_at_first_go(tmp_path):
    surface, path = testing.rough_surface((9, 6), seed=2, periodic=False), tmp_path / "map.asc"
    rows = "\n".join(" ".join(f"{height:.9f}" for height in row) for row in surface.heights.T)
    path.write_text(f"ncols 9\nnrows 6\ncellsize {surface.pixel_size}\n{rows}\n")
    testing.check_reader(AsciiGrid(), path=path, surface=surface, all=True)
