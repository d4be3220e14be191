"""Components that are right under the usual conditions and wrong under others: each is found by the check named for it.

Rupture laws, methods of ageing, readers, observables, surfaces, interactions, and the figures of components.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from kit_examples import Flat, caught_by, changed, mutant

from chemage import InputError, Surface, testing
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    AgedBonds,
    AgeingMethod,
    Energy,
    HeightMap,
    Interaction,
    Length,
    Observable,
    Output,
    Reader,
    Rupture,
    StoreError,
    SurfaceMaker,
    Unit,
    checked_seed,
    random,
)

pytestmark = pytest.mark.long
NM = 0.1602176634  # 1 eV in nN nm


def hashed(*words: object) -> int:
    """A number from the hash of strings, which differs from process to process."""
    return hash(tuple(map(str, words))) % 1000


# -- rupture ----------------------------------------------------------------------------------------------------------


class Bell(Rupture):
    """Each bond at its most probable force under a load that rises at a constant rate."""

    kind = "bell"
    states = True

    length: Length = 0.1
    """distance to the barrier, nm"""
    rate: Annotated[float, Unit("nN/s", gt=0)] = 1e3
    """rate at which the force rises, nN/s"""

    def strength(self, bonded, kelvin=None, length=None):
        kt, length = KB * (kelvin or bonded.temperature), length or self.length
        barriers = bonded.lattice.forming if bonded.lattice.breaking is None else bonded.lattice.breaking
        rise = kt * NM / (self.rate * length)
        return np.maximum(barriers - kt * np.log(bonded.lattice.attempt_frequency * rise), 0.0) * NM / length

    def force(self, bonded):
        return bonded.states @ self.strength(bonded)


_forces: dict[Any, Any] = {}


def _kept_force(self, bonded):
    return _forces.setdefault((bonded.lattice.sites.size, *bonded.bonds), Bell.force(self, bonded))


def _first_sites(self, bonded):
    return np.append(0.0, np.cumsum(self.strength(bonded)))[bonded.bonds]


def _pressed(self, bonded):
    pressure = bonded.contact.pressure.ravel()[: bonded.lattice.sites.size]
    return bonded.states @ (self.strength(bonded) * (1 + pressure / 100))


RUPTURES: dict[str, tuple[Any, str]] = {
    "300 K assumed": (lambda s, b: b.states @ s.strength(b, kelvin=300.0), "forces_have_their_unit"),
    "an energy in eV that is no option": (
        lambda s, b: b.states @ np.maximum(s.strength(b) - 0.025 * NM / s.length, 0.0),
        "forces_have_their_unit",
    ),
    "bonds are the first sites": (_first_sites, "unbonded_sites_do_not_matter"),
    "the strongest sites are bonded": (
        lambda s, b: b.states @ np.sort(s.strength(b)),
        "unbonded_sites_do_not_matter",
    ),
    "pressures by the number of the site": (_pressed, "order_of_the_sites_does_not_matter"),
    "kept by the number of bonds": (_kept_force, "answers_do_not_depend_on_what_was_asked_before"),
    "the length is 0.1 nm": (lambda s, b: b.states @ s.strength(b, length=0.1), "options_count"),
    "noise from the hash of a name": (
        lambda s, b: Bell.force(s, b) * (1 + 1e-6 * hashed(s.kind)),
        "answers_do_not_depend_on_what_was_asked_before",
    ),
}

# -- ageing -----------------------------------------------------------------------------------------------------------


class Means(AgeingMethod):
    """The mean of independent sites whose bonds last."""

    kind = "means"
    replicates = False

    def check(self, chemistry, engine):
        if chemistry.breaking is not None or chemistry.interaction is not None:
            raise InputError("ageing 'means' is about sites by themselves whose bonds last; use another method")

    def sites(self, request):
        return chemistry_sites(request)

    def rates(self, request, pressure, barriers, volume=None, kelvin=None, nu=None):
        chemistry = request.chemistry
        volume = chemistry.activation_volume if volume is None else volume
        energy = np.maximum(barriers - volume * EV_PER_GPA_NM3 * pressure, 0.0)
        return (nu or chemistry.attempt_frequency) * np.exp(-energy / (KB * (kelvin or request.temperature)))

    def bonds(self, request, **assumed):
        barriers = request.chemistry.forming.quantile((np.arange(2000) + 0.5) / 2000)
        pressures, counts = np.unique(self.sites(request), return_counts=True)
        total = np.zeros(request.hold_times.size)
        for pressure, count in zip(pressures, counts, strict=True):
            rates = self.rates(request, float(pressure), barriers, **assumed)
            total += count * np.array([np.mean(-np.expm1(-rates * time)) for time in request.hold_times])
        return total * request.chemistry.hydroxylation

    def age(self, request, **assumed):
        count = self.sites(request).size * request.chemistry.hydroxylation
        return AgedBonds(bonds=self.bonds(request, **assumed)[None], sites=np.array([float(count)]))


def chemistry_sites(request):
    return request.chemistry.sites_of(request.contact).pressure


_aged: dict[Any, Any] = {}


def _kept_bonds(self, request):
    key = (request.contact.digest(), request.chemistry.digest(), tuple(request.hold_times))
    return _aged.setdefault(key, Means.age(self, request))


def _of_area(self, request):
    found = Means.age(self, request)
    scale = request.contact.area / 0.25 / max(chemistry_sites(request).size, 1)
    return dataclasses.replace(found, bonds=found.bonds * scale, sites=found.sites * scale)


def _percent(self, request):
    errors = {"table": np.full(request.hold_times.size, 5.0)}
    return dataclasses.replace(Means.age(self, request), errors=errors, error_sources={"table": "5 %"})


WHOLE = "bonds_are_those_of_the_whole_contact"
METHODS: dict[str, tuple[Any, str]] = {
    "300 K assumed": (lambda s, r: Means.age(s, r, kelvin=300.0), WHOLE),
    "1e13 Hz assumed": (lambda s, r: Means.age(s, r, nu=1e13), WHOLE),
    "0.01 nm3 assumed": (lambda s, r: Means.age(s, r, volume=0.01), WHOLE),
    "pixels of 0.5 nm assumed": (_of_area, WHOLE),
    "errors in percent": (_percent, WHOLE),
    "kept without the temperature": (_kept_bonds, "answers_do_not_depend_on_what_was_asked_before"),
}

# -- readers ----------------------------------------------------------------------------------------------------------


class Table(Reader):
    """Heights in nm, after a line with the pixel size in nm; not periodic."""

    kind = "rows"
    suffixes: ClassVar[tuple[str, ...]] = (".rows",)

    pixel_size: Length | None = None
    """edge of a pixel, nm; default: as the file states"""

    def read(self, path):
        try:
            size, *rows = Path(path).read_text(encoding="utf-8").splitlines()
            heights, stated = np.array([row.split() for row in rows], dtype=float), float(size)
            if heights.ndim != 2 or len(rows) != 9:
                raise ValueError("no table of nine rows")
        except (OSError, ValueError) as error:
            raise StoreError(f"{path}: {error}") from None
        return Surface(heights=heights, pixel_size=self.pixel_size or stated, periodic=False)

    def height_map(self, path):
        made = self.read(path)
        return HeightMap(made.heights, 1.0, (made.pixel_size,) * 2, source=str(path))


_read: dict[str, Surface] = {}


def _kept_file(self, path):
    key = f"{path} {self.pixel_size}"
    if key not in _read:
        _read[key] = Table.read(self, path)
    return _read[key]


def _only_small(self, path):
    if not str(path).endswith(".rows"):
        raise StoreError(f"{path}: not .rows")
    return Table.read(self, path)


def _image(**changes):
    def height_map(self, path):
        found = Table.height_map(self, path)
        return dataclasses.replace(found, **{name: change(found) for name, change in changes.items()})

    return {"height_map": height_map}


IMAGE, PLACE = "height_map_is_the_surface", "place_of_the_file_does_not_matter"
READERS: dict[str, tuple[dict[str, Any], str]] = {
    "an image in metres": (_image(height_unit=lambda m: 1e-9), IMAGE),
    "a transposed image": (_image(heights=lambda m: np.ascontiguousarray(m.heights.T)), IMAGE),
    "an image whose stated pixels do not count": (_image(pixel_size=lambda m: (0.4, 0.4)), IMAGE),
    "an image that repeats": (_image(periodic=lambda m: True), IMAGE),
    "kept by its path": ({"read": _kept_file}, PLACE),
    "endings in small letters": ({"read": _only_small}, PLACE),
}


@pytest.fixture
def table(tmp_path):
    surface = testing.rough_surface((9, 6), seed=2, periodic=False, pixel_size=0.4)
    path = tmp_path / "map.rows"
    path.write_text("\n".join(["0.4", *(" ".join(f"{height:.8f}" for height in row) for row in surface.heights)]))
    return {"path": path, "surface": surface}


# -- observables ------------------------------------------------------------------------------------------------------


class Spots(Observable):
    """The area of the bonds, the mean pressure at them, and the bonds per area, at every hold time."""

    kind = "spots"
    states = True
    outputs: ClassVar = {
        "bonded_area": Output("hold_time", "nm**2", "area of the pixels with a bond"),
        "bonded_pressure": Output("hold_time", "GPa", "mean pressure of sites with a bond"),
        "density": Output("hold_time", "1/nm**2", "bonds per nominal area"),
    }

    threshold: Annotated[float, Unit("GPa", ge=0)] = 0.4
    """sites under less pressure do not count, GPa"""

    def counted(self, contact, lattice, history):
        return history.states & (lattice.pressures(contact) >= self.threshold)

    def measure(self, contact, lattice, history, pixel=None, pressure=None):
        states, pixel = self.counted(contact, lattice, history), pixel or lattice.pixel_size
        pressure = lattice.pressures(contact) if pressure is None else pressure
        count = states.sum(axis=1)
        return {
            "bonded_area": count * pixel**2,
            "bonded_pressure": states @ pressure / np.maximum(count, 1),
            "density": count / (lattice.pixels[0] * lattice.pixels[1] * pixel**2),
        }


_spots: dict[Any, Any] = {}


def _kept_spots(self, contact, lattice, history):
    key = (lattice.sites.tobytes(), history.states.tobytes(), contact.shape, contact.pixel_size, self.threshold)
    return _spots.setdefault(key, Spots.measure(self, contact, lattice, history))


def _first_bonds(self, contact, lattice, history):
    return np.arange(lattice.sites.size) < history.bonds[:, None]


def _by_number(self, contact, lattice, history):
    return Spots.measure(self, contact, lattice, history, pressure=contact.pressure.ravel()[: lattice.sites.size])


def _in_pixels(self, contact, lattice, history):
    found = Spots.measure(self, contact, lattice, history)
    return found | {"bonded_area": found["bonded_area"] / lattice.pixel_size**2}


ORDER = "order_of_the_sites_does_not_matter"
OBSERVABLES: dict[str, tuple[dict[str, Any], str]] = {
    "pixels of 0.5 nm assumed": (
        {"measure": lambda s, c, la, h: Spots.measure(s, c, la, h, pixel=0.5)},
        "lengths_have_their_unit",
    ),
    "an area in pixels": ({"measure": _in_pixels}, "lengths_have_their_unit"),
    "pressures by the number of the site": ({"measure": _by_number}, ORDER),
    "bonds are the first sites": ({"counted": _first_bonds, "threshold": 0.0}, ORDER),
    "kept without the pressure": ({"measure": _kept_spots}, "answers_do_not_depend_on_what_was_asked_before"),
    "a threshold that does not count": ({"counted": lambda s, c, la, h: h.states}, "options_count"),
}

# -- surfaces ---------------------------------------------------------------------------------------------------------


class Wavy(SurfaceMaker):
    """A wave of a random phase along each direction."""

    kind = "wavy"

    amplitude: Length = 0.3
    """height of the waves, nm"""
    pixels: tuple[int, int] | int = 32
    """pixels along x and y, or along both"""
    pixel_size: Length = 0.5
    """edge of a pixel, nm"""

    def shape(self):
        return (self.pixels, self.pixels) if isinstance(self.pixels, int) else self.pixels

    def make(self, seed=0, amplitude=None):
        if not isinstance(seed, np.random.SeedSequence):
            checked_seed(seed)
        phases = 2 * np.pi * random.uniforms(seed, random.stream("kit/wavy"), np.arange(2))
        x, y = (2 * np.pi * np.arange(n) / n + phase for n, phase in zip(self.shape(), phases, strict=True))
        heights = (amplitude or self.amplitude) * (np.cos(x)[:, None] + np.cos(2 * y)[None, :])
        return Surface(heights=heights, pixel_size=self.pixel_size, provenance=self.todict())

    def expected(self):
        nx, ny = self.shape()
        return {"nx": float(nx), "ny": float(ny), "pixel_size": self.pixel_size}


_surfaces: dict[Any, Any] = {}


def _kept_surface(self, seed=0):
    return _surfaces.setdefault((self.shape(), self.pixel_size, str(seed)), Wavy.make(self, seed))


def _square(self):
    nx = float(self.shape()[0])
    return {"nx": nx, "ny": nx}


def _hashed_surface(self, seed=0):
    made = Wavy.make(self, seed)
    return changed(made, heights=made.heights * (1 + 1e-3 * hashed("wavy", seed)))


def _steep(self, seed=0):
    rough = Wavy.make(self, seed)
    return SurfaceMaker.roughness(self, seed).model_copy(update={"rms_slope": 2 * rough.rms_slope})


MAKERS: dict[str, tuple[dict[str, Any], str]] = {
    "an amplitude that does not count": (
        {"make": lambda s, seed=0: Wavy.make(s, seed, amplitude=s.pixel_size)},
        "options_count",
    ),
    "kept without the amplitude": ({"make": _kept_surface}, "answers_do_not_depend_on_what_was_asked_before"),
    "a seed from the hash of a name": ({"make": _hashed_surface}, "answers_do_not_depend_on_what_was_asked_before"),
    "a square grid is announced": ({"expected": _square}, "surface_is_as_expected"),
    "a roughness of another slope": ({"roughness": _steep}, "roughness_is_the_surfaces"),
    "a trade that changes the heights": ({"trade": {"amplitude": (0.3, 0.9)}}, "trade_keeps_the_surface"),
}

# -- interactions -----------------------------------------------------------------------------------------------------


class Near(Interaction):
    """Sites within a distance are coupled, the nearer the stronger."""

    kind = "near"

    reach: Length = 0.7
    """largest distance, nm"""
    strength: Energy = 0.05
    """energy at no distance, eV"""

    def neighbours(self, pixels, periodic, sites, pixel_size=0.4518):
        (nx, ny), place = pixels, {int(site): i for i, site in enumerate(sites)}
        most = int(self.reach / pixel_size)
        steps = [(i, j) for i in range(-most, most + 1) for j in range(-most, most + 1)]
        steps = [(i, j) for i, j in steps if 0 < np.hypot(i, j) * pixel_size <= self.reach]
        found = np.full((sites.size, len(steps)), -1, np.int32)
        for row, site in enumerate(sites.tolist()):
            x, y = divmod(site, ny)
            seen = {site}
            for slot, (i, j) in enumerate(steps):
                inside = 0 <= x + i < nx and 0 <= y + j < ny
                other = (x + i) % nx * ny + (y + j) % ny
                if (inside or periodic) and other not in seen:
                    seen.add(other)
                    found[row, slot] = place.get(other, -1)
        return found

    def coupling(self, sites, neighbours, seed, strength=None):
        return np.where(neighbours >= 0, strength or self.strength, 0.0)


_graphs: dict[Any, Any] = {}


def _kept_graph(self, pixels, periodic, sites, pixel_size=0.4518):
    key = (pixels, sites.tobytes(), pixel_size, self.reach)
    return _graphs.setdefault(key, Near.neighbours(self, pixels, periodic, sites, pixel_size))


INTERACTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "pixels of 0.4518 nm assumed": (
        {"neighbours": lambda s, pixels, periodic, sites: Near.neighbours(s, pixels, periodic, sites)},
        "lengths_are_in_nm",
    ),
    "kept without the boundaries": ({"neighbours": _kept_graph}, "answers_do_not_depend_on_what_was_asked_before"),
    "a strength that does not count": (
        {"coupling": lambda s, sites, near, seed: Near.coupling(s, sites, near, seed, strength=0.05)},
        "options_count",
    ),
    "energies by the number of the process": (
        {"coupling": lambda s, sites, near, seed: Near.coupling(s, sites, near, seed) * (1 + 1e-9 * os.getpid())},
        "answers_do_not_depend_on_what_was_asked_before",
    ),
}

# -- figures ----------------------------------------------------------------------------------------------------------


def _curve(axes, one, component):
    energy = np.linspace(component.low, component.high, 5)
    axes.plot(energy, component.quantile(np.linspace(0, 1, 5)), color=one.color, label=one.label)


def _right(self, figure, axes, results):
    for one in results:
        _curve(axes, one, one.component)


def _own_options(self, figure, axes, results):
    for one in results:
        _curve(axes, one, self)


def _first_result(self, figure, axes, results):
    _curve(axes, results[0], results[0].component)


def _in_pyplot(self, figure, axes, results):
    import matplotlib.pyplot as plt

    _right(self, figure, axes, results)
    plt.figure().add_subplot().plot([0, 1])


def _larger_font(self, figure, axes, results):
    import matplotlib

    matplotlib.rcParams["font.size"] = 1.1 * matplotlib.rcParams["font.size"]
    _right(self, figure, axes, results)


FIGURES: dict[str, Any] = {
    "the options of the one that draws": _own_options,
    "the first result alone": _first_result,
    "a figure of its own": _in_pyplot,
    "a larger font for all": _larger_font,
}
DRAWN = "components_draw_their_figures"

#: name -> (component, check, inputs of the check)
MUTANTS: dict[str, tuple[Any, str]] = {
    **{f"rupture: {n}": (lambda n=n, f=f: mutant(Bell, n, force=f)(), c) for n, (f, c) in RUPTURES.items()},
    **{f"ageing: {n}": (lambda n=n, f=f: mutant(Means, n, age=f)(), c) for n, (f, c) in METHODS.items()},
    **{f"observable: {n}": (lambda n=n, m=m: made(Spots, n, m), c) for n, (m, c) in OBSERVABLES.items()},
    **{f"surface: {n}": (lambda n=n, m=m: made(Wavy, n, m), c) for n, (m, c) in MAKERS.items()},
    **{f"interaction: {n}": (lambda n=n, m=m: made(Near, n, m), c) for n, (m, c) in INTERACTIONS.items()},
    **{
        f"figure: {n}": (lambda n=n, d=d: mutant(Flat, n, figures={"curve": "A curve."}, draw=d)(), DRAWN)
        for n, d in FIGURES.items()
    },
}


def made(base: Any, name: str, changes: dict[str, Any]) -> Any:
    """``base`` with other methods, and with options that are given as numbers."""
    options = {option: value for option, value in changes.items() if option in base.model_fields}
    return mutant(base, name, **{key: value for key, value in changes.items() if key not in options})(**options)


@pytest.fixture(autouse=True)
def fresh():
    """Nothing is kept from another test, and settings of matplotlib come back."""
    import matplotlib

    settings = dict(matplotlib.rcParams)
    for kept in (_forces, _aged, _read, _spots, _surfaces, _graphs):
        kept.clear()
    yield
    matplotlib.rcParams.update(settings)


def test_there_are_forty_of_them():
    assert len(MUTANTS) + len(READERS) == 40


@pytest.mark.parametrize("name", MUTANTS)
def test_a_component_that_is_wrong_under_other_conditions(name):
    make, check = MUTANTS[name]
    found, said = caught_by(make())
    assert found == check, said


@pytest.mark.parametrize("name", READERS)
def test_a_reader_that_is_wrong_under_other_conditions(name, table):
    changes, check = READERS[name]
    found, said = caught_by(mutant(Table, name, **changes)(), **table)
    assert found == check, said


@pytest.mark.parametrize("component", [Bell(), Means(), Spots(), Wavy(), Near()])
def test_right_components_pass(component):
    testing.check_component(component, all=True)


def test_a_right_reader_and_a_right_figure_pass(table):
    testing.check_reader(Table(), all=True, **table)
    testing.check_component(mutant(Flat, "right figure", figures={"curve": "A curve."}, draw=_right)())
