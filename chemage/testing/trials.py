"""The situations in which the checks ask components, and what each is asked about: contact, lattice, chemistry and
history."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.units import KB, Energy
from chemage.friction.role import Bonded
from chemage.kinetics.history import BondHistory
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers, Interaction
from chemage.testing.small_systems import COPIES, NU, TEMPERATURE, Group

#: eV, a barrier over which nothing reacts
NEVER = 1e3


class Even(Barriers):
    """Any barrier between two energies is as likely, for what needs some chemistry."""

    kind = "even"

    lower: Energy = 0.8
    """lowest barrier, eV"""
    upper: Energy = 1.4
    """highest barrier, eV"""

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        return self.lower + (self.upper - self.lower) * uniform

    def density(self, energy: np.ndarray) -> np.ndarray:
        inside = (energy >= self.lower) & (energy <= self.upper)
        return np.where(inside, 1 / (self.upper - self.lower), 0.0)


class Row(Interaction):
    """A bonded site raises the barriers of the sites before and after it in its row."""

    kind = "row"

    energy: Energy = 0.05
    """by how much, eV"""

    def neighbours(
        self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray
    ) -> np.ndarray:
        row, column = np.divmod(sites, pixels[1])
        found = np.full((sites.size, 2), -1, np.int32)
        # on a ring of two sites, both are the same one
        for slot, step in enumerate((1, -1)[: max(min(pixels[1] - 1, 2), 0)]):
            other = column + step
            inside = periodic | ((other >= 0) & (other < pixels[1]))
            wanted = row * pixels[1] + other % pixels[1]
            at = np.searchsorted(sites, wanted)
            there = inside & np.isin(wanted, sites)
            found[there, slot] = at[there]
        return found

    def coupling(
        self, sites: np.ndarray, neighbours: np.ndarray, seed: Any
    ) -> np.ndarray:
        return np.where(neighbours >= 0, self.energy, 0.0).astype(np.float32)


def contact_of(
    pressure: np.ndarray, periodic: bool = True, pixel_size: float = 0.5
) -> ContactSolution:
    """A contact with this pressure (GPa), in pixels of ``pixel_size`` nm."""
    return ContactSolution(
        pressure=pressure,
        load=float(pressure.sum()) * pixel_size**2,
        pixel_size=pixel_size,
        modulus=35.3,
        rms_slope=0.1,
        periodic=periodic,
    )


def history_of(
    lattice: ReactionLattice,
    times: Any,
    states: np.ndarray,
    temperature: float,
    engine: str,
    broken: int = 0,
    **more: Any,
) -> BondHistory:
    """The history of sites with these ``states`` at each time, (m, n), where ``broken`` bonds broke before."""
    bonds = states.sum(axis=1, dtype=np.int64)
    return BondHistory(
        hold_times=np.array(times),
        bonds=bonds,
        formed=bonds + broken,
        broken=np.full_like(bonds, broken),
        state=states[-1],
        time=float(times[-1]),
        temperature=temperature,
        engine=engine,
        lattice_hash=lattice.digest(),
        **more,
    )


def states_of(n: int, bonds: np.ndarray) -> np.ndarray:
    """Which of ``n`` sites have so many bonds, (m, n): a bond that has formed stays."""
    return np.random.default_rng(n).permutation(n) < bonds[:, None]


@dataclass(frozen=True)
class Trial:
    """A situation in which a component is asked: what a scene may vary, and what it is asked about there.

    Barriers and couplings are proportional to k_B T ln ν, so that sites react within the same times everywhere.
    """

    pixels: tuple[int, int] = (8, 8)
    """(nx, ny) of the contact"""
    pixel_size: float = 0.5
    """nm"""
    spacing: float = 1.0
    """of the grid of sites, in pixels: at 0.5 there are four sites in a pixel, at 2 four pixels in a site"""
    periodic: bool = True
    """whether the contact repeats"""
    sites: int = 40
    """of a replica, at most; they are scattered, the last one of the grid is among them"""
    idle: int = 0
    """sites that never react, between groups of sites that do, see :meth:`placed`"""
    bonded: int = 17
    """sites that have a bond at the end, at most"""
    hydroxylation: float = 1.0
    """share of the sites that react"""
    temperature: float = TEMPERATURE
    """K"""
    attempt_frequency: float = NU
    """Hz"""
    coupled: bool = True
    """whether neighbouring sites interact"""
    breaking: bool = True
    """whether bonds break"""
    hold_times: tuple[float, ...] | int = (0.0, 0.1, 10.0, 10.0, 1e4)
    """s, or how many from 0.1 s to 1e4 s"""
    start: Literal["fresh", "after hold", "after pull"] = "fresh"
    """what went before: nothing, a hold, or a pull"""
    partner: Literal["kept", "renewed"] = "kept"
    """whether sites meet others while they slide"""
    seed: int = 3

    def __repr__(self) -> str:
        """Code that makes it: the fields that differ from their defaults."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        given = [
            f"{field.name}={own[field.name]!r}"
            for field in fields(self)
            if own[field.name] != field.default
        ]
        return f"Trial({', '.join(given)})"

    def but(self, **changes: Any) -> Trial:
        """The same with other fields."""
        return replace(self, **changes)

    # -- energies and times --------------------------------------------------------------------------------------------

    @property
    def scale(self) -> float:
        """Energies here over those at 300 K and 1e13 Hz."""
        usual = TEMPERATURE * math.log(NU)
        return self.temperature * math.log(self.attempt_frequency) / usual

    def barrier(self, rate: Any) -> Any:
        """The barriers (eV) over which sites react at ``rate`` (1/s)."""
        thermal = KB * self.temperature
        return thermal * np.log(self.attempt_frequency / np.asarray(rate))

    @property
    def times(self) -> np.ndarray:
        """(m,) s, the hold times."""
        if isinstance(self.hold_times, int):
            return np.geomspace(1e4, 0.1, self.hold_times)[::-1]
        return np.array(self.hold_times)

    # -- what is asked about -------------------------------------------------------------------------------------------

    def contact(self) -> ContactSolution:
        """A contact of a few pixels more than there are sites, under 0.3 to 3 GPa; the last pixel is one of them."""
        pixels = self.pixels[0] * self.pixels[1]
        rng = np.random.default_rng(self.sites + 100 * self.pixels[0])
        wanted = math.ceil(self.sites * max(self.spacing, 1.0) ** 2)
        places = np.append(pixels - 1, rng.permutation(pixels - 1))
        touching = np.sort(places[: wanted + 3 * (self.sites > 1)])
        pressure = np.zeros(pixels)
        pressure[touching] = rng.uniform(0.3, 3.0, touching.size)
        return contact_of(
            pressure.reshape(self.pixels), self.periodic, self.pixel_size
        )

    def chemistry(self, **options: Any) -> Chemistry:
        """Barriers of 0.8 to 1.4 eV to form and to break a bond, at 300 K and 1e13 Hz."""
        even = Even(lower=0.8 * self.scale, upper=1.4 * self.scale)
        density = (self.pixel_size * self.spacing) ** -2
        own = {
            "forming": even,
            "breaking": even if self.breaking else None,
            "interaction": Row(energy=0.05 * self.scale) if self.coupled else None,
            "attempt_frequency": self.attempt_frequency,
            "activation_volume": 0.01 * self.scale,
            "hydroxylation": self.hydroxylation,
            "site_density": "pixel" if self.spacing == 1.0 else density,
        }
        return Chemistry(**{**own, **options})

    def replica(self) -> Bonded:
        """A finished replica: what an observable and a law of rupture receive. As many sites as ``bonded`` have a bond
        at the end, and a bond lasts; after a hold or a pull, three have broken."""
        contact, chemistry = self.contact(), self.chemistry()
        found = chemistry.sites_of(contact).sites
        order = np.random.default_rng(self.sites).permutation(
            max(found.size - 1, 0)
        )
        few = found[np.sort(np.append(order, found.size - 1)[::-1][: self.sites])]
        lattice = chemistry.on(contact, self.seed, sites=few)
        n, m = lattice.sites.size, self.times.size
        counts = np.linspace(min(self.bonded, n), 0, m).astype(np.int64)[::-1]
        history = history_of(
            lattice,
            self.times,
            states_of(n, counts),
            self.temperature,
            "by-hand",
            broken=3 * (self.start != "fresh"),
            resume=self._slid(n),
        )
        return Bonded(contact, chemistry, lattice, history)

    def _slid(self, n: int) -> dict[str, np.ndarray]:
        """What a pull hands on: the counter of its events, where the slider is, and the partners of the bonds."""
        if self.start != "after pull":
            return {}
        numbers = {"event": np.array([7]), "cell": np.array([9000])}
        return {
            **numbers,
            "offset": np.array([1e-6, 0.0]),
            "partner": np.arange(n) % 3,
        }

    def before(
        self, lattice: ReactionLattice, state: np.ndarray, time: float
    ) -> BondHistory:
        """A hold of another engine to ``time`` s, or the history of a pull, from which a run goes on."""
        n = lattice.sites.size
        resume = self._slid(n)
        given = ([time], state[None], self.temperature, "another", 3)
        return history_of(lattice, *given, resume=resume)

    def placed(
        self, group: Group, copies: int = COPIES, slots: int = 0
    ) -> tuple[ReactionLattice, np.ndarray]:
        """``copies`` of a group of sites, none coupled to another, and their places in the list of sites: half of them
        before and half behind the ``idle`` ones. See :meth:`Group.lattice` for ``slots``."""
        near = group.lattice(copies, self.attempt_frequency, slots, self.seed)
        n = near.sites.size
        if not self.idle and self.spacing >= 1.0:
            return near, np.arange(n)
        total = n + self.idle
        places = np.arange(n) + self.idle * (np.arange(n) >= n // 2)

        def among(values: np.ndarray, others: float) -> np.ndarray:
            every = np.full((total, *values.shape[1:]), others, values.dtype)
            every[places] = values
            return every

        per = 4 if self.spacing < 1.0 else 1
        pixel, quarter = np.divmod(np.arange(total), per)
        step = np.stack(np.divmod(quarter, 2), axis=1) / 2 + 0.25
        fields: dict[str, Any] = {
            "pixels": (int(pixel[-1]) + 1, 2),
            "sites": 2 * pixel + 1,
            "positions": np.stack([pixel, np.ones(total)], axis=1) + step
            if per > 1
            else None,
            "forming": among(near.forming, NEVER),
        }
        if near.breaking is not None:
            fields["breaking"] = among(near.breaking, NEVER)
        if near.neighbours is not None and near.coupling is not None:
            ends = np.append(places, -1)[near.neighbours].astype(np.int32)
            fields |= {
                "neighbours": among(ends, -1),
                "coupling": among(near.coupling, 0.0),
            }
        return near.model_copy(update=fields), places


#: each value of each field at least once, and what goes wrong together: small, as checks ask about all of them
TRIALS = (
    Trial(),
    Trial(
        pixels=(13, 5),
        spacing=0.5,
        temperature=150.0,
        attempt_frequency=1e11,
        hold_times=(10.0,),
        start="after hold",
    ),
    Trial(
        pixels=(5, 13),
        pixel_size=0.8,
        periodic=False,
        temperature=600.0,
        attempt_frequency=1e14,
        breaking=False,
        hold_times=100,
    ),
    Trial(
        pixels=(16, 18),
        spacing=2.0,
        temperature=450.0,
        coupled=False,
        hydroxylation=0.7,
        start="after pull",
        partner="renewed",
        seed=4,
    ),
    Trial(
        pixels=(12, 9),
        pixel_size=0.3,
        spacing=0.5,
        periodic=False,
        hydroxylation=0.6,
        attempt_frequency=1e12,
        hold_times=(1.0, 1.0, 10.0),
        partner="renewed",
        seed=5,
    ),
)
