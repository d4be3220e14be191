"""The rupture law that pulls: the friction after a hold is the largest force of a pull that follows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from chemage import Chemistry, InputError
from chemage.plugin import (
    Bonded,
    Choice,
    Drive,
    Length,
    Output,
    PlottedResult,
    PluginError,
    PullHistory,
    Pulling,
    Rupture,
    TwoState,
    figures,
    pull,
    record,
    text,
    threads,
)
from chemage_kinetics._common import Array
from chemage_kinetics._foreseen import (
    Renewed,
    flips,
    lifetimes,
    rupture_stretch,
    slider_way,
    waiting,
)
from chemage_kinetics.pulling import EventDriven

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: cells along each side of a map of the bonds, at most
CELLS = 48
#: maps end at so many times of the time to the peak, so that one of four to be is just there
AFTER_PEAK = 4.0 / 3.0
#: a pull ends at its largest force if that comes in so small a part of the way before its end, and falls by no more
RISING = 0.05
#: sites by which the events of all are estimated
SAMPLED = 256
#: CPU seconds of a call, of setting up a site, of a sample of a site, of an event (``tests/benchmarks/estimates.py``), and
#: of a new partner of a site (``tests/benchmarks/pulling.py speed``)
CALL_SECONDS, SITE_SECONDS, SAMPLE_SECONDS, EVENT_SECONDS = 3.6e-3, 3e-7, 1e-9, 6e-7
PARTNER_SECONDS = 1e-7
#: nm between the sites of the counter-body where the chemistry does not say it
SPACING = 0.45
#: bytes of a site and of a call, and copies of what is recorded (``tests/benchmarks/memory.py``)
SITE_BYTES, CALL_BYTES, RECORDED = 300.0, 8e6, 3.0
#: curves in a figure, at most
CURVES = 5


DUDKO = """@article{dudko2006,
  author = {Dudko, O. K. and Hummer, G. and Szabo, A.},
  title = {Intrinsic rates and activation free energies from single-molecule pulling experiments},
  journal = {Physical Review Letters},
  volume = {96},
  pages = {108101},
  year = {2006},
  doi = {10.1103/PhysRevLett.96.108101},
}"""
SCHALLAMACH = """@article{schallamach1963,
  author = {Schallamach, A.},
  title = {A theory of dynamic rubber friction},
  journal = {Wear},
  volume = {6},
  pages = {375--382},
  year = {1963},
  doi = {10.1016/0043-1648(63)90206-0},
}"""


class Pulled(Rupture, Drive):
    """The contact is pulled after each hold time; ΔF is the largest force, less the friction of the slider itself.

    All bonds are loaded together, so that ``front_factor`` of the chemistry does not enter. The mean force over the
    last quarter of the way is recorded as the kinetic friction. Bonds rupture as in ``dudko-hummer-szabo``.
    """

    kind = "pulled"
    states = True
    sampled = True
    cite = (
        "O. K. Dudko, G. Hummer, A. Szabo, Phys. Rev. Lett. 96, 108101 (2006)",
        "A. Schallamach, Wear 6, 375 (1963)",
    )
    bibtex = (DUDKO, SCHALLAMACH)
    figures: ClassVar[Mapping[str, str]] = {
        "force-displacement": "Force of the drive against its displacement after some hold times; mean over replicas.",
        "pull-maps": "Bonds on the contact while it is pulled after the last hold time, from left to right; first "
        "replica.",
    }
    outputs: ClassVar[Mapping[str, Output]] = {
        "pull_way": Output(("drive_point",), "nm", "displacement of the drive"),
        "pull_force": Output(
            ("hold_time", "drive_point"), "nN", "force of the drive"
        ),
        "pull_slider": Output(
            ("hold_time", "drive_point"), "nm", "displacement of the slider"
        ),
        "pull_bonds": Output(("hold_time", "drive_point"), "", "number of bonds"),
        "pull_peak_at": Output(
            ("hold_time",), "nm", "displacement of the slider at the largest force"
        ),
        "kinetic_friction": Output(
            ("hold_time",), "nN", "mean force over the last quarter of the pull"
        ),
        "pull_work": Output(("hold_time",), "nN nm", "work of the drive"),
        "pull_dissipated": Output(
            ("hold_time",), "nN nm", "energy lost where bonds broke"
        ),
        "pull_ruptures": Output(("hold_time",), "", "bonds that broke"),
        "pull_slips": Output(
            ("hold_time",),
            "",
            "falls of the force by more than 5 % of the largest force",
        ),
        "pull_largest_drop": Output(
            ("hold_time",), "nN", "largest fall of the force in one of these slips"
        ),
        "pull_maps": Output(
            ("frame", "map_x", "map_y"),
            "",
            "bonds per cell, pulled after the last hold time",
        ),
        "pull_maps_at": Output(
            ("frame",), "nm", "displacement of the drive at each of these maps"
        ),
    }

    distance: Length
    """by which the drive moves, nm"""
    points: int = Field(default=200, ge=2, le=100_000)
    """displacements at which force and bonds are recorded; the largest force is that of all events; default: 200"""
    frames: int = Field(default=4, ge=1, le=1000)
    """maps of the bonds; default: 4"""
    engine: Choice[Pulling] = EventDriven()  # pyright: ignore[reportAssignmentType]
    """the engine that pulls; default: event-driven"""

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.speed == 0:
            raise ValueError("speed = 0: nothing is pulled; give a speed above 0")
        return self

    @property
    def drive(self) -> Drive:
        """What pulls."""
        return Drive(**{name: getattr(self, name) for name in Drive.model_fields})

    def force(self, bonded: Bonded) -> Array:
        """Force in nN, (m,)."""
        if bonded.lattice.breaking is None:
            raise InputError(self._lasting())
        times = np.linspace(0.0, self.distance / self.speed, self.points + 1)
        found: list[dict[str, Any]] = []
        recorded: list[Mapping[str, Array]] = []
        outputs: dict[str, dict[str, Any]] = {}
        forces, end = [], 0.0
        for number in range(bonded.hold_times.size):
            one = self._pull(bonded, number, times)
            found.append(self._numbers(one))
            recorded.append(one.observables)
            outputs |= one.outputs
            forces.append(max(one.peak - self.friction, 0.0))
            end = min(AFTER_PEAK * one.peak_time, one.time) or one.time
        at, maps = self._maps(bonded, end)
        self.record(
            pull_way=np.linspace(0.0, self.distance, self.points + 1),
            pull_maps=maps,
            pull_maps_at=at,
            **{
                name: np.stack([numbers[name] for numbers in found])
                for name in found[0]
            },
        )
        record(
            **{
                name: Output(
                    ("hold_time", *output["dims"]),
                    output["unit"],
                    output["description"],
                ).of(_stacked(name, recorded))
                for name, output in outputs.items()
            }
        )
        return np.array(forces)

    def _numbers(self, pulled: PullHistory) -> dict[str, Any]:
        """What is recorded of each pull."""
        return {
            "pull_force": pulled.force,
            "pull_slider": pulled.displacement,
            "pull_bonds": pulled.bonds,
            "pull_peak_at": pulled.peak_displacement,
            "kinetic_friction": pulled.force[-(pulled.force.size // 4) :].mean(),
            "pull_work": pulled.work[-1],
            "pull_dissipated": pulled.dissipated[-1],
            "pull_ruptures": pulled.broken[-1],
            "pull_slips": pulled.avalanches.sum(),
            "pull_largest_drop": pulled.largest_drop,
        }

    def _pull(
        self,
        bonded: Bonded,
        number: int,
        times: Array,
        start: PullHistory | Array | None = None,
    ) -> PullHistory:
        """The pull after one hold time, or the part of it that follows ``start``."""
        return pull(
            self.engine,
            bonded.lattice,
            self.drive,
            times,
            temperature=bonded.temperature,
            seed=bonded.seed_at(number),
            start=bonded.states[number] if start is None else start,
            contact=bonded.contact,
            chemistry=bonded.chemistry,
        )

    def _maps(self, bonded: Bonded, end: float) -> tuple[Array, Array]:
        """Where the drive is and the bonds per cell, evenly in time to ``end`` (s), a little beyond the peak.

        It is the same pull once more, because what is sampled of a pull does not change it.
        """
        last = bonded.hold_times.size - 1
        times = np.linspace(0.0, end, self.frames)
        maps, piece = [], None
        for time in times:
            piece = self._pull(bonded, last, np.array([time]), piece)
            maps.append(_map(bonded, piece.state))
        return times * self.speed, np.stack(maps)

    def expected(
        self,
        sites: float,
        hold_times: int,
        replicas: int,
        chemistry: Chemistry | None = None,
        times: Array | None = None,
        temperature: float = 0.0,
        pressure: float = 0.0,
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.Rupture.expected`; seconds are those of all events, samples and calls."""
        recorded = 3 * hold_times * (self.points + 1) + self.frames * CELLS**2
        at_once = min(replicas, threads.available())
        numbers = {
            "bytes": 8.0 * RECORDED * replicas * recorded
            + at_once * (SITE_BYTES * sites + CALL_BYTES)
        }
        if chemistry is None or chemistry.breaking is None or times is None:
            return numbers
        events = self._events(sites, chemistry, times, temperature, pressure)
        pulls = hold_times * (
            CALL_SECONDS
            + SITE_SECONDS * sites
            + SAMPLE_SECONDS * sites * self.points
        )
        maps = self.frames * (CALL_SECONDS + SITE_SECONDS * sites)
        if self.partner == "renewed":
            met = sites * self.distance / self._between(chemistry)
            pulls += (hold_times + 1) * PARTNER_SECONDS * met
        seconds = pulls + maps + EVENT_SECONDS * float(events.sum() + events[-1])
        return {**numbers, "cpu_seconds": replicas * seconds}

    def _events(
        self,
        sites: float,
        chemistry: Chemistry,
        times: Array,
        temperature: float,
        pressure: float,
    ) -> Array:
        """Bonds that form and break in the pull after each hold time, (m,); without interaction."""
        assert chemistry.breaking is not None
        share = (np.arange(SAMPLED) + 0.5) / SAMPLED
        nu = chemistry.attempt_frequency
        span = self.distance / self.speed
        forming = (
            chemistry.forming.quantile(share)
            - chemistry.activation_volume * pressure
        )
        # every barrier to forming with another one to breaking
        breaking = chemistry.breaking.quantile((share * SAMPLED * 0.618034) % 1.0)
        wait = waiting(forming, span, nu, temperature)
        passing = self._between(chemistry) / self.speed
        if self.partner == "renewed" and passing < span:
            again = Renewed(forming, passing).waiting(
                np.zeros(1), span, nu, temperature
            )
            wait = np.full(SAMPLED, float(again[0]))
        held = TwoState(
            chemistry.rates(forming, temperature),
            chemistry.rates(breaking, temperature),
        )
        stretches = rupture_stretch(breaking, self.drive, nu, temperature)
        stretch = float(np.median(stretches))
        found = []
        for time in times:
            bonded = held.bonded(time)
            way = slider_way(
                self.drive, float(bonded.mean()) * sites, stretch, span
            )
            last = lifetimes(breaking, self.drive, way, nu, temperature)
            found.append(sites * float(flips(wait, last, bonded, span).mean()))
        return np.array(found)

    def _between(self, chemistry: Chemistry) -> float:
        """nm between the sites of the counter-body."""
        density = chemistry.site_density
        given = SPACING if isinstance(density, str) else density**-0.5
        return given if self.spacing is None else self.spacing

    def remarks(self, observables: Mapping[str, Array]) -> Sequence[str]:
        """Say in how many pulls the force ended at its largest, so that ΔF is no peak."""
        if "pull_force" not in observables:
            return ()
        force, slider = observables["pull_force"], observables["pull_slider"]
        high = (force[..., -1] > self.friction) & (
            force[..., -1] > (1 - RISING) * force.max(axis=-1)
        )
        early = high & (
            observables["pull_peak_at"] >= (1 - RISING) * slider[..., -1]
        )
        if not early.any():
            return ()
        many = f"rupture 'pulled': in {np.count_nonzero(early)} of {early.size} pulls the force was at its largest when"
        end = f"the drive had moved by the distance of {self.distance:g} nm"
        return [f"{many} {end}: ΔF is the force there, not a peak; pull further"]

    def _lasting(self) -> str:
        return "rupture 'pulled' needs the barriers to breaking a bond, and here bonds last; give [breaking]"

    def check(
        self,
        chemistry: Chemistry,
        temperature: float,
        sites: float | None = None,
        times: Array | None = None,
        pressure: float = 0.0,
    ) -> Sequence[str]:
        """See :meth:`chemage.plugin.Rupture.check`."""
        if chemistry.breaking is None:
            raise InputError(self._lasting())
        if self.bond_stiffness == 0:
            return [
                "rupture 'pulled': bond_stiffness = 0, so that no bond carries a force"
            ]
        barrier = chemistry.breaking.quantile(np.array([0.5]))
        (stretch,) = rupture_stretch(
            barrier, self.drive, chemistry.attempt_frequency, temperature
        )
        if self.distance < stretch:
            force = stretch * self.bond_stiffness
            about = f"rupture 'pulled': bonds break at about {force:.3g} nN, when stretched by {stretch:.3g} nm"
            return [
                f"{about}, but the drive moves by {self.distance:g} nm: pull further, or there may be no peak"
            ]
        if (
            sites is None
            or times is None
            or not isinstance(self.engine, EventDriven)
        ):
            return []
        events = self._events(sites, chemistry, times, temperature, pressure)
        most = float(events.max(initial=0.0))
        if most <= self.engine.most_events:
            return []
        about = f"rupture 'pulled': a pull is expected to form and break {most:.2g} bonds"
        limit = f"more than most_events = {self.engine.most_events:g} of its engine, which will refuse it"
        return [
            f"{about}, {limit}; pull less far, faster or at a lower temperature, or allow more events"
        ]

    def draw(
        self, figure: str, axes: Axes, results: Sequence[PlottedResult]
    ) -> None:
        """Draw force against displacement, or maps of the bonds."""
        there = [
            one
            for one in results
            if one.ageing is not None and "pull_force" in one.ageing.observables
        ]
        if figure == "pull-maps":
            _draw_maps(axes, there)
            return
        for result in there:
            assert result.ageing is not None
            measured, times = result.ageing.observables, result.ageing.hold_times
            way = measured["pull_way"][0]
            force = measured["pull_force"].mean(axis=0)
            if len(there) > 1:
                axes.plot(
                    way, force[-1], color=result.color, lw=1.3, label=result.label
                )
                continue
            shown = np.unique(np.linspace(0, times.size - 1, CURVES).astype(int))
            for colour, at in zip(figures.PALETTE, shown, strict=False):
                label = f"after {text.power_text(float(times[at]))} s"
                axes.plot(way, force[at], color=colour, lw=1.3, label=label)
        axes.set(
            xlabel="displacement of the drive (nm)",
            ylabel="force (nN)",
            ylim=(0, None),
        )
        figures.legend(axes)


def _stacked(name: str, recorded: Sequence[Mapping[str, Array]]) -> Array:
    """What the engine or a hook recorded under ``name`` in each pull, (m, ...)."""
    shapes = {values[name].shape if name in values else None for values in recorded}
    if len(shapes) > 1:
        raise PluginError(
            f"{name!r} is not recorded with one shape in every pull; record it in the pull after each hold time"
        )
    return np.stack([values[name] for values in recorded])


def _map(bonded: Bonded, state: Array) -> Array:
    """Bonds in each of at most CELLS x CELLS cells of equal size; the last ones may be cut off."""
    nx, ny = bonded.lattice.pixels
    along_x, along_y = -(-nx // CELLS), -(-ny // CELLS)
    shape = -(-nx // along_x), -(-ny // along_y)
    x, y = np.divmod(bonded.lattice.sites[state], ny)
    counts = np.bincount(
        x // along_x * shape[1] + y // along_y, minlength=shape[0] * shape[1]
    )
    return counts.reshape(shape).astype(float)


def _draw_maps(axes: Axes, results: Sequence[PlottedResult]) -> None:
    """The maps of each result in a row, as much of them as ever has a bond."""
    if not results:
        return
    measured: list[Any] = [
        result.ageing.observables for result in results if result.ageing is not None
    ]
    parts = [_with_bonds(one["pull_maps"][0]) for one in measured]
    high, wide = (max(part.shape[axis] for part in parts) for axis in (2, 1))
    canvas = np.full((len(parts), max(map(len, parts)), high + 2, wide + 2), np.nan)
    for row, part in zip(canvas[::-1], parts, strict=True):
        row[: len(part), 1 : part.shape[2] + 1, 1 : part.shape[1] + 1] = (
            part.transpose(0, 2, 1)
        )
    image = axes.imshow(
        canvas.transpose(0, 2, 1, 3).reshape(len(parts) * (high + 2), -1),
        cmap="viridis",
        interpolation="nearest",
        origin="lower",
    )
    axes.figure.colorbar(image, ax=axes, shrink=0.5, label="bonds per cell")
    axes.set(xticks=[], yticks=[])
    if len(parts) == 1:
        at = measured[0]["pull_maps_at"][0]
        axes.set_xticks(
            (np.arange(at.size) + 0.5) * (wide + 2) - 0.5,
            [f"{way:.3g}" for way in at],
        )
        axes.set_xlabel("displacement of the drive (nm)")
        return
    axes.set_yticks(
        (np.arange(len(parts)) + 0.5) * (high + 2) - 0.5,
        [result.label for result in results][::-1],
    )
    axes.set_xlabel("from the start of the pull to just after its peak")


def _with_bonds(maps: Array) -> Array:
    """The part of ``maps`` (k, nx, ny) within which there is ever a bond, and a cell around it."""
    x, y = (np.flatnonzero(maps.any(axis=other)) for other in ((0, 2), (0, 1)))
    if not x.size:
        return maps[:, :1, :1]
    return maps[:, max(x[0] - 1, 0) : x[-1] + 2, max(y[0] - 1, 0) : y[-1] + 2]
