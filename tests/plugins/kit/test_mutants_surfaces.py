"""Surface makers and readers that are wrong in one way, each found first by the check named for it."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import caught_by, changed, mutant
from pydantic import Field

import chemage as ca
from chemage import Surface, testing
from chemage.plugin import Length, Reader, StoreError, SurfaceMaker

pytestmark = pytest.mark.long

ROUGH: Any = type(ca.surface("self-affine", pixels=32, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=8))
SPHERE: Any = type(ca.surface("sphere", radius=30, pixels=32, pixel_size=0.5))
OPTIONS: dict[Any, dict[str, Any]] = {
    ROUGH: {"pixels": 32, "pixel_size": 0.5, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8},
    SPHERE: {"radius": 30, "pixels": 32, "pixel_size": 0.5},
}


def maker(base: Any, name: str, change: Any, **attributes: Any) -> Any:
    """A maker whose surface is passed through ``change``."""

    def make(self: Any, seed: Any = 0) -> Any:
        return change(base.make(self, seed), self, seed)

    return mutant(base, name, make=make, **attributes)(**OPTIONS[base])


def _cropped(surface, self, seed):
    """A piece of a larger surface, still called periodic."""
    nx, ny = self.pixels
    larger = self.replace(pixels=(2 * nx, 2 * ny), zeta=2 * self.zeta)
    piece = ROUGH.make(larger, seed).heights[:nx, :ny]
    return changed(surface, heights=piece * (surface.rms_slope / _slope(piece, surface)))


def _slope(heights, surface):
    return changed(surface, heights=heights).rms_slope


def _nothing_known(self):
    return {}


class Cone(SurfaceMaker):
    """A cone, periodic by mistake."""

    kind = "cone"

    pixels: int = 32
    """pixels along each side"""
    pixel_size: Length = 0.5
    """edge of a pixel"""

    def make(self, seed=0):
        x = (np.arange(self.pixels) - (self.pixels - 1) / 2) * self.pixel_size
        heights = -0.1 * np.sqrt(x[:, None] ** 2 + x**2 + 4 * self.pixel_size**2)
        return Surface(heights=heights, pixel_size=self.pixel_size, provenance=self.todict())


class InPixels(SurfaceMaker):
    """A wave whose length is taken in pixels."""

    kind = "in-pixels"

    wavelength: Length = 8.0
    """length of the wave"""
    pixels: int = 32
    """pixels along each side"""
    pixel_size: Length = 0.5
    """edge of a pixel"""

    def make(self, seed=0):
        x = 2 * np.pi * np.arange(self.pixels) / self.wavelength
        heights = np.repeat(0.1 * self.wavelength * np.cos(x)[:, None], self.pixels, axis=1)
        return Surface(heights=heights, pixel_size=self.pixel_size, provenance=self.todict())


class Blocks(ROUGH):
    """Works in blocks, the last of which is left out."""

    speed_only: ClassVar[tuple[str, ...]] = ("blocks",)
    blocks: int = Field(default=1, ge=1)
    """number of blocks"""

    def make(self, seed=0):
        surface = super().make(seed)
        return changed(surface, heights=surface.heights + 1e-13 * (self.blocks - 1))


_seen: list[int] = []


def _another(self):
    return self.replace(pixels=16, pixel_size=2 * self.pixel_size, zeta=2, hurst=0.1)


def _by_call(surface, self, seed):
    _seen.append(1)
    return changed(surface, heights=surface.heights + 1e-6 * len(_seen))


_calls: list[int] = []


def _like(self, count, **more):
    """Members that differ in their slope, but for what is changed."""
    slopes = [(1.1 + 0.1 * k) * self.rms_slope for k in range(count)]
    return [] if self.zeta < 8 else [self.replace(**({"rms_slope": slope, "zeta": 7} | more)) for slope in slopes]


def _others(self, count):
    _calls.append(1)
    return _like(self, count, hurst=0.1 + 0.01 * len(_calls))


def with_members(name: str, members: Any) -> Any:
    return lambda: maker(ROUGH, name, lambda s, *g: s, members=members)


MEMBERS = "members_are_other_surfaces"
MAKERS: dict[str, tuple[Any, str]] = {
    "members without end": (with_members("many", lambda self, count: _like(self, 5)), MEMBERS),
    "members that have members": (with_members("endless", lambda self, count: _like(self, count, zeta=9)), MEMBERS),
    "members that are the surface": (
        with_members("same", lambda self, count: [self.replace(eta=1.0)] * bool(count) * (self.zeta == 8)),
        MEMBERS,
    ),
    "members on other pixels": (with_members("finer", lambda self, count: _like(self, count, pixels=64)), MEMBERS),
    "members that change with each call": (with_members("drawn", _others), MEMBERS),
    "random, but its scatter is 0": (
        lambda: maker(ROUGH, "no-scatter", lambda s, *g: s, scatter=lambda *_: ca.plugin.Scatter(0.0)),
        "scatter_agrees_with_the_seed",
    ),
    "a tip with scatter": (
        lambda: maker(SPHERE, "scatters", lambda s, *g: s, scatter=lambda *_: ca.plugin.Scatter(0.1)),
        "scatter_agrees_with_the_seed",
    ),
    "scatter as a number": (
        lambda: maker(ROUGH, "number", lambda s, *g: s, scatter=lambda *_: 0.1),
        "scatter_agrees_with_the_seed",
    ),
    "ten times the pixel": (
        lambda: maker(ROUGH, "pixel", lambda s, *g: changed(s, pixel_size=10 * s.pixel_size)),
        "surface_has_its_options",
    ),
    "pixel in metres": (
        lambda: maker(SPHERE, "metres", lambda s, *g: changed(s, pixel_size=1e-9 * s.pixel_size)),
        "surface_has_its_options",
    ),
    "a slope too large by the root of two": (
        lambda: maker(ROUGH, "slope", lambda s, *g: changed(s, heights=2**0.5 * s.heights)),
        "surface_has_its_options",
    ),
    "transposed where not square": (
        lambda: maker(SPHERE, "turned", lambda s, *g: changed(s, heights=s.heights.T)),
        "surface_has_its_options",
    ),
    "the tip upside down": (
        lambda: maker(SPHERE, "pit", lambda s, *g: changed(s, heights=-s.heights)),
        "recorded_radius_is_the_tips",
    ),
    "the tip a pixel off": (
        lambda: maker(SPHERE, "off", lambda s, *g: changed(s, heights=np.roll(s.heights, 1, 0))),
        "recorded_radius_is_the_tips",
    ),
    "a diameter for a radius": (
        lambda: maker(
            SPHERE, "diameter", lambda s, *g: changed(s, provenance={**s.provenance, "radius": 2 * g[0].radius})
        ),
        "recorded_radius_is_the_tips",
    ),
    "a periodic tip": (
        lambda: maker(SPHERE, "loop", lambda s, *g: changed(s, periodic=True)),
        "recorded_radius_is_the_tips",
    ),
    "a periodic cone": (Cone, "edges_fit_where_periodic"),
    "a piece called periodic": (lambda: maker(ROUGH, "piece", _cropped), "edges_fit_where_periodic"),
    "periodic but not called so": (
        lambda: maker(ROUGH, "free", lambda s, *g: changed(s, periodic=False, heights=1.0 * s.heights)),
        "edges_fit_where_periodic",
    ),
    "a wave in pixels": (InPixels, "lengths_scale_together"),
    "a wavelength in pixels": (
        lambda: mutant(ROUGH, "waves", expected=lambda self: {"shortest_wavelength": 40.0})(**OPTIONS[ROUGH]),
        "surface_is_as_expected",
    ),
    "another number of pixels announced": (
        lambda: mutant(ROUGH, "grid", expected=lambda self: {"nx": 64, "ny": 32})(**OPTIONS[ROUGH]),
        "surface_is_as_expected",
    ),
    "coarser without larger pixels": (
        lambda: mutant(ROUGH, "coarse", coarser=lambda self, f: self.replace(pixels=16))(**OPTIONS[ROUGH]),
        "coarser_is_the_same_surface",
    ),
    "coarser and another surface": (
        lambda: mutant(
            ROUGH,
            "other",
            coarser=lambda self, f: self.replace(pixels=16, pixel_size=f * self.pixel_size, zeta=2, hurst=0.1),
        )(**OPTIONS[ROUGH]),
        "coarser_is_the_same_surface",
    ),
    "a sketch of another size": (
        lambda: mutant(ROUGH, "small", sketch=lambda self: self.replace(pixels=16, zeta=2))(**OPTIONS[ROUGH]),
        "sketch_is_the_same_surface",
    ),
    "a sketch of another surface": (
        lambda: mutant(ROUGH, "another", sketch=_another)(**OPTIONS[ROUGH]),
        "sketch_is_the_same_surface",
    ),
    "heights by call": (lambda: maker(ROUGH, "calls", _by_call), "makes_a_surface"),
    "blocks that change bits": (lambda: Blocks(**OPTIONS[ROUGH]), "options_count"),
    "heights that are not numbers": (
        lambda: maker(SPHERE, "list", lambda s, *g: s.heights),
        "makes_a_surface",
    ),
}


_heights: dict[Any, np.ndarray] = {}


def _in_one_array(self, seed=0):
    """All threads work in one array."""
    made = SPHERE.make(self, seed) if isinstance(self, SPHERE) else ROUGH.make(self, seed)
    work = _heights.setdefault(made.shape, np.zeros(made.shape))
    work[:] = made.heights
    time.sleep(2e-3)
    return changed(made, heights=1.0 * work)


def _before(surface, self, seed):
    """The surface of the call before."""
    key = ("before", surface.shape)
    last, _heights[key] = _heights.get(key, surface.heights), surface.heights
    return changed(surface, heights=last)


MAKERS |= {
    "threads that share an array": (
        lambda: mutant(ROUGH, "shared", make=_in_one_array)(**OPTIONS[ROUGH]),
        "calls_are_independent",
    ),
    "the surface of the call before": (lambda: maker(ROUGH, "before", _before), "surface_follows_its_seed"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_wrong_maker(name):
    make, check = MAKERS[name]
    _heights.clear()
    found, said = caught_by(make())
    assert found == check, said


# -- readers ----------------------------------------------------------------------------------------------------------


class Table(Reader):
    """Heights in nm, a row of pixels per line, after a line with the pixel size in nm; not periodic."""

    kind = "table"
    suffixes: ClassVar[tuple[str, ...]] = (".tab",)

    pixel_size: Length | None = None
    """edge of a pixel; default: as the file states"""

    def read(self, path):
        try:
            with open(path, encoding="utf-8") as file:
                rows, size = (int(word) for word in file.readline().split()), file.readline()
                heights = np.array([line.split() for line in file], dtype=float)
                if heights.shape != tuple(rows):
                    raise ValueError(f"heights of shape {heights.shape}")
                stated = float(size)
        except (OSError, ValueError) as error:
            raise StoreError(f"{path}: {error}") from None
        return Surface(heights=heights, pixel_size=self.pixel_size or stated, periodic=False)


@pytest.fixture
def table(tmp_path):
    """A file, and the surface in it."""
    surface = testing.rough_surface((9, 6), seed=2, periodic=False, pixel_size=0.4)
    path = tmp_path / "map.tab"
    lines = [" ".join(f"{height:.8f}" for height in row) for row in surface.heights]
    path.write_text("\n".join(["9 6", "0.4", *lines]) + "\n")
    return {"path": path, "surface": surface}


def test_a_right_reader_passes(table):
    testing.check_reader(Table(), **table)
    testing.check_reader(Table())


def read(name: str, change: Any, **attributes: Any) -> Any:
    """A reader whose surface is passed through ``change``."""
    return mutant(Table, name, read=lambda self, path: change(Table.read(self, path), self, path), **attributes)()


def _deleting(surface, self, path):
    with open(path, "ab") as file:
        file.write(b"\n")
    return surface


READERS: dict[str, tuple[Any, str, str]] = {
    "transposed": (lambda s, *g: changed(s, heights=s.heights.T), "known_surface_is_read", "x and y are swapped"),
    "mirrored": (lambda s, *g: changed(s, heights=s.heights[::-1]), "known_surface_is_read", "mirrored along x"),
    "first line at the top": (
        lambda s, *g: changed(s, heights=s.heights[:, ::-1]),
        "known_surface_is_read",
        "mirrored along y",
    ),
    "upside down": (lambda s, *g: changed(s, heights=-s.heights), "known_surface_is_read", "upside down"),
    "columns before rows": (
        lambda s, *g: changed(s, heights=s.heights.ravel().reshape(s.shape, order="F")),
        "known_surface_is_read",
        "another order|differ by",
    ),
    "in micrometres": (lambda s, *g: changed(s, heights=1e-3 * s.heights), "known_surface_is_read", "0.001 times"),
    "in ångström": (lambda s, *g: changed(s, heights=10 * s.heights), "known_surface_is_read", "10 times as large"),
    "in metres": (lambda s, *g: changed(s, heights=1e-9 * s.heights), "file_is_in_nm", "are heights"),
    "pixels in metres": (lambda s, *g: changed(s, pixel_size=1e-9 * s.pixel_size), "file_is_in_nm", "in m or µm"),
    "twice the pixel": (lambda s, *g: changed(s, pixel_size=2 * s.pixel_size), "known_surface_is_read", "0.8"),
    "periodic by default": (lambda s, *g: changed(s, periodic=True), "known_surface_is_read", "periodic is True"),
    "an array": (lambda s, *g: s.heights, "reads_its_file", "returned ndarray"),
    "a pair": (lambda s, *g: (s.heights, s.pixel_size), "reads_its_file", "returned tuple"),
    "a path": (lambda s, self, path: path, "reads_its_file", "expected a chemage.Surface"),
    "writes into the file": (_deleting, "reads_its_file", "changed the file"),
    "ignores the stated pixel": (
        lambda s, self, path: changed(s, pixel_size=0.4),
        "stated_pixel_size_counts",
        "was given",
    ),
}


@pytest.mark.parametrize("name", READERS)
def test_a_wrong_reader(name, table):
    change, check, said = READERS[name]
    found, message = caught_by(read(name, change), **table)
    assert found == check, message
    assert any(word in message for word in said.split("|")), message


def test_a_reader_of_other_endings(table):
    found, message = caught_by(mutant(Table, "ending", suffixes=(".tabular",))(), **table)
    assert found == "suffixes_are_named", message
