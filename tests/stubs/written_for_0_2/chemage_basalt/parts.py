"""The components."""

from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from chemage import ContactSolution, InputError, Surface
from chemage.plugin import (
    KB,
    AgedBonds,
    AgeingMethod,
    Barriers,
    BondHistory,
    Choice,
    ContactModulus,
    ContactSolver,
    Energy,
    Engine,
    Interaction,
    Length,
    Observable,
    Output,
    PluginOptions,
    Pressure,
    PullHistory,
    Pulling,
    Reader,
    Rupture,
    StoreError,
    SurfaceMaker,
    Unit,
    random,
)

STREAM = random.stream("chemage-basalt/kinetics")


class Options(PluginOptions):
    """The largest pressure."""

    limit: Pressure | None = None
    """largest pressure; None: no limit"""


class Waves(SurfaceMaker):
    """One cosine along x."""

    kind = "basalt-waves"
    outputs: ClassVar = {"wavelength": Output((), "nm", "of the waves")}

    amplitude: Length = 1.0
    """half the height difference of crest and valley, nm"""
    pixels: int = Field(default=8, ge=1, le=100_000)
    """pixels along each side"""
    pixel_size: Length = 0.5
    """edge of a pixel, nm"""

    def make(self, seed=0):
        self.record(wavelength=self.pixels * self.pixel_size)
        x = 2 * np.pi * np.arange(self.pixels) / self.pixels
        heights = np.repeat(self.amplitude * np.cos(x)[:, None], self.pixels, axis=1)
        return Surface(heights=heights, pixel_size=self.pixel_size, periodic=True, provenance={"maker": self.todict()})

    def expected(self):
        return {"nx": self.pixels, "ny": self.pixels, "pixel_size": self.pixel_size}


class Table(Reader):
    """A square of heights, nm."""

    kind = "basalt-table"
    suffixes = (".basalt",)

    def read(self, path):
        try:
            heights = np.array([line.split() for line in Path(path).read_text().splitlines()], dtype=float)
        except (OSError, ValueError) as error:
            raise StoreError(f"{path} is not a table: {error}") from error
        return Surface(heights=heights, pixel_size=1.0, periodic=False)


class Springs(ContactSolver):
    """Each pixel carries a share of the load that is the larger the higher it is."""

    kind = "basalt-springs"
    speed_only = ("threads",)

    modulus: ContactModulus = 35.3
    """contact modulus E*, GPa"""
    threads: int = 1
    """number of threads"""

    def _solve(self, surface, load, start):
        height = surface.heights.astype(np.float64) - np.median(surface.heights)
        share = np.maximum(height, 0.0)
        return ContactSolution(
            pressure=share * load / (share.sum() * surface.pixel_size**2),
            load=load,
            pixel_size=surface.pixel_size,
            modulus=self.modulus,
            periodic=surface.periodic,
            rms_slope=surface.rms_slope,
            provenance=self.provenance(surface),
        )

    def expected(self, surface, load):
        return {"area_fraction": 0.5, "cpu_seconds": 0.01, "bytes": 1e5}


class Exponential(Barriers):
    """Exponential distribution above a threshold."""

    kind = "basalt-exponential"
    cite = ("an example",)

    threshold: Energy = 0.8
    """lowest barrier, eV"""
    scale: Annotated[float, Unit("eV", gt=0)] = 0.1
    """mean height above the threshold, eV"""

    def quantile(self, uniform):
        return self.threshold - self.scale * np.log1p(-uniform)

    def density(self, energy):
        above = (np.asarray(energy, dtype=np.float64) - self.threshold) / self.scale
        return np.where(above >= 0, np.exp(-np.maximum(above, 0.0)) / self.scale, 0.0)


class AlongX(Interaction):
    """Sites that follow each other in the list are neighbours."""

    kind = "basalt-along-x"

    strength: Energy = 0.01
    """energy that a bonded neighbour adds to the forming barrier, eV"""

    def neighbours(self, pixels, periodic, sites):
        at = np.arange(sites.size, dtype=np.int32)
        after = np.where(at + 1 < at.size, at + 1, -1)
        return np.stack([at - 1, after], axis=1).astype(np.int32)

    def coupling(self, sites, neighbours, seed):
        return np.where(neighbours >= 0, self.strength, 0.0)


class MeanTimes(Engine):
    """Every site bonds at a time drawn from its rate, whatever its neighbours do, and its bond lasts."""

    kind = "basalt-mean"
    exact = False
    declared_error = 0.5
    error_of = "the mean number of bonds"

    def _run(self, lattice, hold_times, temperature, seed, start):
        rates = lattice.attempt_frequency * np.exp(-np.maximum(lattice.forming, 0.0) / (KB * temperature))
        when = -np.log(random.uniforms(seed, STREAM, lattice.sites)) / rates
        before = getattr(start, "state", start)
        states = (when <= hold_times[:, None]) | (False if before is None else before)
        bonds = states.sum(axis=1)
        return BondHistory(
            hold_times=hold_times,
            bonds=bonds,
            formed=bonds,
            broken=np.zeros_like(bonds),
            state=states[-1],
            time=float(hold_times[-1]),
            temperature=temperature,
            engine=self.kind,
            lattice_hash=lattice.digest(),
        )


class Strength(Rupture):
    """Each bond breaks at its barrier over a length."""

    kind = "basalt-strength"
    states = True

    length: Length = 0.1
    """distance from the bound state to the barrier, nm"""
    pulls: Choice[Pulling] = Field(default="basalt-rigid", validate_default=True)
    """what would pull"""

    def force(self, bonded):
        lattice = bonded.lattice
        barriers = lattice.forming if lattice.breaking is None else lattice.breaking
        return np.array([(barriers[state] * 0.1602176634 / self.length).sum() for state in bonded.states])


class Rigid(Pulling):
    """The bonds that there are stretch, and none breaks."""

    kind = "basalt-rigid"
    exact = False
    outputs: ClassVar = {"mean_stretch": Output((), "nm", "mean stretch at the end")}

    def _run(self, lattice, drive, times, temperature, seed, start, partners):
        n = lattice.sites.size
        state = np.zeros(n, bool) if start is None else np.array(getattr(start, "state", start))
        began = getattr(start, "time", 0.0)
        way = drive.speed * (times - began)
        bonds = np.full(times.size, state.sum())
        work = 0.5 * drive.bond_stiffness * bonds * way**2
        follows = isinstance(start, BondHistory | PullHistory)
        formed, broken = (start.formed[-1], start.broken[-1]) if follows else (0, 0)
        zero = np.zeros(times.size)
        force = drive.bond_stiffness * bonds * way
        self.record(mean_stretch=float(way[-1]))
        return PullHistory(
            times=times,
            displacement=way,
            force=force,
            bonds=bonds,
            formed=np.full(times.size, formed),
            broken=np.full(times.size, broken),
            work=work,
            dissipated=zero,
            rubbed=zero,
            stored=work,
            state=state,
            stretch=np.where(state, way[-1], 0.0),
            forming=lattice.forming,
            breaking=lattice.breaking,
            avalanches=np.zeros(1, np.int64),
            peak=float(force.max()),
            peak_displacement=float(way[-1]),
            peak_time=float(times[-1]),
            drive=drive.todict(),
            time=float(times[-1]),
            temperature=temperature,
            engine=self.kind,
        )


class FirstHalf(Observable):
    """Fraction of the bonds on the first half of the sites, at every hold time."""

    kind = "basalt-first"
    states = True
    outputs: ClassVar = {"first_half": Output(("hold_time",), "", "fraction of the bonds on the first half")}
    figures: ClassVar = {"basalt-first": "Fraction of the bonds on the first half."}

    def measure(self, contact, lattice, history):
        half = np.arange(lattice.sites.size) < lattice.sites.size // 2
        return {"first_half": [(state & half).sum() / max(state.sum(), 1) for state in history.states]}

    def draw(self, figure, axes, results):
        for one in results:
            axes.plot(one.ageing.observables["first_half"].mean(axis=0), color=one.color, label=one.label)


class Count(AgeingMethod):
    """The mean number of bonds of independent sites whose bonds last, without the pressure."""

    kind = "basalt-count"
    replicates = False
    exact = False

    ranks: int = Field(default=100, ge=10)
    """number of barriers"""

    def check(self, chemistry, engine):
        if chemistry.interaction is not None or chemistry.breaking is not None:
            raise InputError("ageing 'basalt-count' treats independent sites whose bonds last; use another method")

    def age(self, request):
        chemistry, times = request.chemistry, request.hold_times
        barriers = chemistry.forming.quantile((np.arange(self.ranks) + 0.5) / self.ranks)
        rates = chemistry.attempt_frequency * np.exp(-np.maximum(barriers, 0.0) / (KB * request.temperature))
        sites = chemistry.sites_of(request.contact).pressure.size
        bonds = sites * np.array([np.mean(-np.expm1(-rates * time)) for time in times])
        return AgedBonds(
            bonds=bonds[None],
            sites=np.array([float(sites)]),
            errors={"ranks": np.full(times.size, 1 / self.ranks)},
            error_sources={"ranks": f"bound, {self.ranks} barriers in place of all"},
        )
