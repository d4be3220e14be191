"""The rupture law that pulls: the friction after a hold is the largest force of a pull that follows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from chemage import Chemistry, InputError
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    Bonded,
    Choice,
    Drive,
    Length,
    Output,
    PlottedResult,
    PullHistory,
    Pulling,
    Rupture,
    figures,
    pull,
    text,
)
from chemage_kinetics.pulling import EventDriven

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: cells along each side of a map of the bonds, at most
CELLS = 48
#: maps end at so many times of the time to the peak, so that one of four to be is just there
AFTER_PEAK = 4.0 / 3.0
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
        "pull_force": Output(("hold_time", "drive_point"), "nN", "force of the drive"),
        "pull_slider": Output(("hold_time", "drive_point"), "nm", "displacement of the slider"),
        "pull_bonds": Output(("hold_time", "drive_point"), "", "number of bonds"),
        "pull_peak_at": Output(("hold_time",), "nm", "displacement of the slider at the largest force"),
        "kinetic_friction": Output(("hold_time",), "nN", "mean force over the last quarter of the pull"),
        "pull_work": Output(("hold_time",), "nN nm", "work of the drive"),
        "pull_dissipated": Output(("hold_time",), "nN nm", "energy lost where bonds broke"),
        "pull_ruptures": Output(("hold_time",), "", "bonds that broke"),
        "pull_slips": Output(("hold_time",), "", "falls of the force by more than 5 % of the largest force"),
        "pull_largest_drop": Output(("hold_time",), "nN", "largest fall of the force in one of these slips"),
        "pull_maps": Output(("frame", "map_x", "map_y"), "", "bonds per cell, pulled after the last hold time"),
        "pull_maps_at": Output(("frame",), "nm", "displacement of the drive at each of these maps"),
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

    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN, (m,)."""
        if bonded.lattice.breaking is None:
            raise InputError(self._lasting())
        times = np.linspace(0.0, self.distance / self.speed, self.points + 1)
        pulls = [self._pull(bonded, number, times) for number in range(bonded.hold_times.size)]
        force = np.stack([one.force for one in pulls])
        at, maps = self._maps(bonded, pulls[-1])
        self.record(
            pull_way=np.linspace(0.0, self.distance, self.points + 1),
            pull_force=force,
            pull_slider=np.stack([one.displacement for one in pulls]),
            pull_bonds=np.stack([one.bonds for one in pulls]),
            pull_peak_at=np.array([one.peak_displacement for one in pulls]),
            kinetic_friction=force[:, -(force.shape[1] // 4) :].mean(axis=1),
            pull_work=np.array([one.work[-1] for one in pulls]),
            pull_dissipated=np.array([one.dissipated[-1] for one in pulls]),
            pull_ruptures=np.array([one.broken[-1] for one in pulls]),
            pull_slips=np.array([one.avalanches.sum() for one in pulls]),
            pull_largest_drop=np.array([one.largest_drop for one in pulls]),
            pull_maps=maps,
            pull_maps_at=at,
        )
        return np.array([max(one.peak - self.friction, 0.0) for one in pulls])

    def _pull(
        self, bonded: Bonded, number: int, times: np.ndarray, start: PullHistory | np.ndarray | None = None
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

    def _maps(self, bonded: Bonded, whole: PullHistory) -> tuple[np.ndarray, np.ndarray]:
        """Where the drive is and the bonds per cell, evenly to a little beyond the peak.

        It is the same pull once more, because what is sampled of a pull does not change it.
        """
        last = bonded.hold_times.size - 1
        end = min(AFTER_PEAK * whole.peak_time, whole.time) or whole.time
        times = np.linspace(0.0, end, self.frames)
        maps, piece = [], None
        for time in times:
            piece = self._pull(bonded, last, np.array([time]), piece)
            maps.append(_map(bonded, piece.state))
        return times * self.speed, np.stack(maps)

    def expected(self, sites: float, hold_times: int, replicas: int) -> dict[str, float]:
        """See :meth:`chemage.plugin.Rupture.expected`."""
        return {"cpu_seconds": replicas * hold_times * (2e-3 + 2e-6 * sites)}

    def _lasting(self) -> str:
        return "rupture 'pulled' needs the barriers to breaking a bond, and here bonds last; give [breaking]"

    def check(self, chemistry: Chemistry, temperature: float) -> Sequence[str]:
        """See :meth:`chemage.plugin.Rupture.check`."""
        if chemistry.breaking is None:
            raise InputError(self._lasting())
        if self.bond_stiffness == 0:
            return ["rupture 'pulled': bond_stiffness = 0, so that no bond carries a force"]
        barrier = max(float(chemistry.breaking.quantile(np.array([0.5]))[0]), 0.0)
        # at the force at which a bond breaks within the time in which its force grows by k_BT/Δx
        thermal = KB * temperature
        scale = thermal / EV_PER_GPA_NM3 / self.transition_distance
        tries = np.log(max(chemistry.attempt_frequency * scale / (self.bond_stiffness * self.speed), 1.0))
        left = min(thermal * tries / barrier, 1.0) if barrier > 0 else 1.0
        force = barrier / EV_PER_GPA_NM3 / (self.exponent * self.transition_distance) * (1 - left**self.exponent)
        stretch = force / self.bond_stiffness
        if self.distance < stretch:
            about = f"rupture 'pulled': bonds break at about {force:.3g} nN, when stretched by {stretch:.3g} nm"
            return [f"{about}, but the drive moves by {self.distance:g} nm: pull further, or there may be no peak"]
        return []

    def draw(self, figure: str, axes: Axes, results: Sequence[PlottedResult]) -> None:
        """Draw force against displacement, or maps of the bonds."""
        there = [one for one in results if one.aging is not None and "pull_force" in one.aging.observables]
        if figure == "pull-maps":
            _draw_maps(axes, there)
            return
        for result in there:
            assert result.aging is not None
            measured, times = result.aging.observables, result.aging.hold_times
            force = measured["pull_force"].mean(axis=0)
            shown = np.unique(np.linspace(0, times.size - 1, CURVES if len(there) == 1 else 1).astype(int))
            for number, at in enumerate(shown if len(there) == 1 else [times.size - 1]):
                colour = figures.PALETTE[number] if len(there) == 1 else result.color
                label = f"after {text.power_text(times[at])} s" if len(there) == 1 else result.label
                axes.plot(measured["pull_way"][0], force[at], color=colour, lw=1.3, label=label)
        axes.set(xlabel="displacement of the drive (nm)", ylabel="force (nN)", ylim=(0, None))
        figures.legend(axes)


def _map(bonded: Bonded, state: np.ndarray) -> np.ndarray:
    """Bonds in each of at most CELLS x CELLS cells of equal size; the last ones may be cut off."""
    counts = bonded.lattice.per_pixel(state)
    rows, columns = (np.arange(0, side, -(-side // CELLS)) for side in counts.shape)
    return np.add.reduceat(np.add.reduceat(counts, rows, axis=0), columns, axis=1)


def _draw_maps(axes: Axes, results: Sequence[PlottedResult]) -> None:
    """The maps of each result in a row, as much of them as ever has a bond."""
    shown = [result for result in results if result.aging is not None]
    if not shown:
        return
    measured: list[Any] = [result.aging.observables for result in shown if result.aging is not None]
    parts = [_with_bonds(one["pull_maps"][0]) for one in measured]
    high, wide = (max(part.shape[axis] for part in parts) for axis in (2, 1))
    rows = []
    for part in parts:
        frames = [np.full((high + 2, wide + 2), np.nan) for _ in part]
        for frame, bonds in zip(frames, part, strict=True):
            frame[1 : bonds.shape[1] + 1, 1 : bonds.shape[0] + 1] = bonds.T
        rows.append(np.hstack(frames))
    longest = max(row.shape[1] for row in rows)
    image = axes.imshow(
        np.vstack([np.pad(row, ((0, 0), (0, longest - row.shape[1])), constant_values=np.nan) for row in rows[::-1]]),
        cmap="viridis",
        interpolation="nearest",
        origin="lower",
    )
    axes.figure.colorbar(image, ax=axes, shrink=0.5, label="bonds per cell")
    axes.set(xticks=[], yticks=[])
    if len(rows) == 1:
        at = measured[0]["pull_maps_at"][0]
        axes.set_xticks((np.arange(at.size) + 0.5) * (wide + 2) - 0.5, [f"{way:.3g}" for way in at])
        axes.set_xlabel("displacement of the drive (nm)")
        return
    axes.set_yticks((np.arange(len(rows)) + 0.5) * (high + 2) - 0.5, [result.label for result in shown][::-1])
    axes.set_xlabel("from the start of the pull to just after its peak")


def _with_bonds(maps: np.ndarray) -> np.ndarray:
    """The part of ``maps`` (k, nx, ny) within which there is ever a bond, and a cell around it."""
    x, y = (np.flatnonzero(maps.any(axis=other)) for other in ((0, 2), (0, 1)))
    if not x.size:
        return maps[:, :1, :1]
    return maps[:, max(x[0] - 1, 0) : x[-1] + 2, max(y[0] - 1, 0) : y[-1] + 2]
