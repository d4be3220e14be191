"""Sites that do not interact, exactly, and what the interaction changes, tabulated by pressure, neighbours and time.

The bonded share without interaction is a quadrature over the barriers, without any noise.

At each pressure the kinetics of a periodic contact all of whose sites are in contact, and of some from which sites are
missing at random, run beside those of the same sites without interaction, with the same barriers and the same kinetic
noise. The bonds without interaction are known exactly and serve as a control variate (Law, Simulation Modeling and
Analysis, section 11.4). The sites of the thinned contacts are sorted by the neighbours that they have.

Tables are kept in the cache folder of the user, one container each.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from chemage import Chemistry, ContactSolution, ReactionLattice
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    DamagedError,
    Engine,
    StoreError,
    TwoState,
    build_lattice,
    container,
    content_hash,
    random,
    run_kinetics,
)
from chemage.plugin import threads as processors

#: nodes per k_BT of the grid of energies; cubic interpolation between them errs by 4e-5 of a rate at most
PER_KT = 5
#: nodes above the barriers that interpolation needs; the most of a grid, 517 eV at 300 K
MARGIN, MOST_STEPS = 3, 100_000
#: pressures between which the bonds of groups of sites are interpolated
PRESSURES = 33
#: panels of the quadrature over the barriers, each half as wide as its neighbour towards the middle: the lowest forming
#: barriers react first, and bonds with the highest breaking barriers last longest
PANELS, FINE_PANELS, FINE, COARSE = 48, 10, 256, 32


def shift_per_gpa(chemistry: Chemistry) -> float:
    """By how much pressure lowers the forming barrier, eV/GPa."""
    return chemistry.activation_volume * EV_PER_GPA_NM3


def bonded_share(
    chemistry: Chemistry,
    temperature: float,
    hold_times: np.ndarray,
    pressure: np.ndarray,
) -> np.ndarray:
    """Share of the sites in contact that are bonded if none interacts, (n, m), at each ``pressure`` (n,) GPa.

    A site forms its bond at the rate a = ν exp(−E_f/k_BT) and breaks it at b = ν exp(−E_b/k_BT), a barrier at or below
    0 meaning ν; it is bonded with the probability a/(a + b) [1 − exp(−(a + b) t)], which is averaged over the
    distributions of both barriers.
    """
    kt = KB * temperature
    step = kt / PER_KT
    shift = shift_per_gpa(chemistry) * np.asarray(pressure, dtype=np.float64) / step
    longest = float(hold_times.max(initial=0.0))
    # barriers that are crossed, and those whose share of crossings is in proportion to the rate
    crossed = (
        int(
            (np.log(max(chemistry.attempt_frequency * longest, 1.0)) + 40.0)
            * PER_KT
        )
        + MARGIN
    )
    highest = (
        int(min(chemistry.forming.quantile(_ranks()[0]).max() / step, MOST_STEPS))
        + MARGIN
        + 1
    )
    # a power of two, so that contacts share the result
    shifts = 1 << max(
        4, int(np.ceil(min(shift.max(initial=0.0), MOST_STEPS)) + 3).bit_length()
    )
    shifts = min(shifts, max(crossed, highest) + 4)
    # pressure brings higher barriers into the range
    nodes = max(crossed, min(crossed + shifts, highest))
    curves = _curves(chemistry, kt, hold_times.tobytes(), crossed, nodes, shifts)  # pyright: ignore[reportArgumentType]
    return (
        interpolated(curves, np.minimum(shift, shifts - 2.0))
        * chemistry.hydroxylation
    )


def grouped_bonds(
    chemistry: Chemistry,
    temperature: float,
    hold_times: np.ndarray,
    pressure: np.ndarray,
    group: np.ndarray,
    groups: int,
) -> np.ndarray:
    """Expected bonds in each of ``groups`` groups of sites if none interacts, (groups, m), within about 1e-3.

    Site i is under ``pressure[i]`` GPa and in ``group[i]``; between 33 pressures is interpolated.
    """
    nodes = np.linspace(0.0, float(pressure.max(initial=0.0)) or 1.0, PRESSURES)
    right = np.clip(np.searchsorted(nodes, pressure), 1, PRESSURES - 1)
    part = np.clip(pressure / nodes[1] - (right - 1), 0.0, 1.0)
    at, shape = group * PRESSURES + right, groups * PRESSURES
    weights = np.bincount(at, part, shape) + np.bincount(at - 1, 1 - part, shape)
    share = bonded_share(chemistry, temperature, hold_times, nodes)
    return np.einsum("gp,pm->gm", weights.reshape(groups, PRESSURES), share)


@lru_cache(maxsize=32)
def _curves(
    chemistry: Chemistry,
    kt: float,
    times: bytes,
    crossed: int,
    nodes: int,
    shifts: int,
) -> np.ndarray:
    """The share at ``shifts`` equal steps of the barrier, (shifts + 1, m); the first row is at one step above 0.

    ``crossed`` and ``nodes`` (at least as many): nodes of the energies of breaking and of forming barriers.
    """
    hold_times = np.frombuffer(times)
    step = kt / PER_KT
    forming = _weights(chemistry.forming.quantile(_ranks()[0]), step, nodes)
    share = _of_energy(chemistry, kt, hold_times, crossed, nodes)
    # barriers below 0 react as those at 0
    below = np.concatenate(
        [np.repeat(share[:1], shifts, axis=0), share, share[-1:]]
    )
    rows = [
        np.einsum("i,im->m", forming, below[shifts - j : shifts - j + nodes])
        for j in range(-1, shifts)
    ]
    return np.clip(np.stack(rows), 0.0, 1.0)


def _of_energy(
    chemistry: Chemistry,
    kt: float,
    hold_times: np.ndarray,
    crossed: int,
    nodes: int,
) -> np.ndarray:
    """The share of sites of one forming barrier, averaged over their breaking barriers, (nodes, m)."""
    energy = np.arange(nodes) / PER_KT
    forming = chemistry.attempt_frequency * np.exp(-energy)
    if chemistry.breaking is None:
        return TwoState(forming[:, None]).relaxed(hold_times)
    # higher barriers are not crossed
    barriers = np.minimum(
        chemistry.breaking.quantile(_ranks()[0]), (crossed - MARGIN) * kt / PER_KT
    )
    weights = _weights(barriers, kt / PER_KT, crossed)
    chosen = np.flatnonzero(weights)
    breaking = chemistry.attempt_frequency * np.exp(-energy[chosen])
    sites = TwoState(forming[:, None], breaking)
    settled = sites.equilibrium * weights[chosen]
    return np.stack(
        [
            np.einsum("ij,ij->i", settled, sites.relaxed(time))
            for time in hold_times
        ],
        axis=1,
    )


@lru_cache(maxsize=1)
def _ranks() -> tuple[np.ndarray, np.ndarray]:
    """Ranks in (0, 1) and their weights: midpoints, the finer the nearer to either end."""
    edges = []
    for panel in range(1, PANELS + 1):
        count = FINE if panel <= FINE_PANELS else COARSE
        edges.append(np.linspace(0.5 ** (panel + 1), 0.5**panel, count + 1))
    ranks = np.concatenate([0.5 * (part[1:] + part[:-1]) for part in edges])
    weights = np.concatenate([np.diff(part) for part in edges])
    return np.concatenate([ranks, 1 - ranks]), np.tile(
        weights / (2 * weights.sum()), 2
    )


def _weights(energies: np.ndarray, step: float, nodes: int) -> np.ndarray:
    """The distribution of the barriers of all ranks on the nodes of energy, (nodes,), by cubic interpolation.

    A barrier above the nodes counts at their end with the ratio of both rates, to which such a share is in proportion.
    """
    beyond = np.maximum(energies / step - (nodes - MARGIN), 0.0)
    ranked = _ranks()[1] * np.exp(-beyond / PER_KT)
    place = np.clip(energies / step, 0.0, nodes - float(MARGIN))
    shares = np.zeros(nodes)
    first, parts = cubic(place, lowest=-1)
    for offset, part in enumerate(parts):
        shares += np.bincount(
            np.clip(first + offset, 0, nodes - 1), ranked * part, nodes
        )
    return shares


def cubic(place: np.ndarray, lowest: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Lagrange's cubic interpolation on whole numbers: the first of four nodes, ``lowest`` at least, and the weight of
    each. ``place`` is between the two nodes in the middle, or at the lower end between the first two."""
    first = np.maximum(np.floor(place).astype(np.int64) - 1, lowest)
    a, b, c, d = (place - (first + node) for node in range(4))
    return first, [-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6]


def interpolated(curves: np.ndarray, place: np.ndarray) -> np.ndarray:
    """``curves`` (k + 1, m), of which row 1 is at place 0, at each ``place`` (n,), cubic: (n, m)."""
    first, parts = cubic(place, lowest=-1)
    return sum(
        (
            part[:, None] * curves[np.clip(first + offset + 1, 0, len(curves) - 1)]
            for offset, part in enumerate(parts)
        ),
        np.zeros((place.size, curves.shape[1])),
    )


#: changes with what is computed below, so that tables of an older version are not used
VERSION = 2
#: sites along a side of a contact of the table; columns of the bands of which its scatter is found
SIDE, BAND = 128, 8
#: thinned contacts beside each full one
THINNED = 3
#: hold times per decade
PER_DECADE = 8
#: replicas: those begun with, and the most
FIRST, MOST = 4, 256
#: of the breaking barriers, the share below the one by whose mean times the settling of bonds is counted; after so many
#: of them a contact is in equilibrium but for a change that is counted as an error
SLOWEST, SETTLED = 0.99, 30.0
#: a share of bonded sites of one in so many sites of the table is not resolved any better
RESOLVED = 20.0
#: bonds from which on the coefficient of the control variate is found from the scatter of the bands; 1 below
CONTROLLED = 1000.0
#: pressures are so many k_BT of the barrier apart
STEP = 1.0
#: shares of bonded sites below this are none
NONE = 1e-250
#: what a file of a table begins with, and the fields of a node that it holds
_KINDS = {"table": container.Arrays}


@dataclass(frozen=True)
class Node:
    """What the interaction changes at one pressure, (neighbours + 1, m): for each number of neighbours in contact and
    each time of the table, relative to the share of bonded sites without interaction."""

    change: np.ndarray
    #: its standard error
    error: np.ndarray
    replicas: int


@dataclass(frozen=True)
class Setting:
    """All on which a node depends, beside its number."""

    chemistry: Chemistry
    engine: Engine
    temperature: float
    #: nm, distance of the sites
    spacing: float
    #: neighbours of a site inside the contact
    most: int
    #: first and last decade of the times
    decades: tuple[int, int]
    accuracy: float
    seed: int = 0

    @property
    def times(self) -> np.ndarray:
        """(m,) s."""
        first, last = self.decades
        return 10.0 ** (
            np.arange(first * PER_DECADE, last * PER_DECADE + 1) / PER_DECADE
        )

    @property
    def pressure_step(self) -> float:
        """Distance of the pressures of the table, GPa; 0 where bonds do not depend on the pressure."""
        return pressure_step(self.chemistry, self.temperature)

    def identity(self) -> dict[str, Any]:
        """As plain JSON values; equal for equal tables."""
        chemistry = self.chemistry.identity()
        for name in ("bond_force", "front_factor", "site_density"):
            chemistry.pop(name, None)
        return {
            "version": VERSION,
            "chemistry": chemistry,
            "engine": self.engine.identity(),
            "temperature": self.temperature,
            "spacing": float(f"{self.spacing:.4g}"),
            "decades": list(self.decades),
            "accuracy": self.accuracy,
            "grid": [SIDE, BAND, THINNED, PER_DECADE, STEP],
        }

    @property
    def own_chemistry(self) -> Chemistry:
        """The chemistry with a site in each pixel, and without what changes no bond."""
        return self.chemistry.replace(
            site_density="pixel", **dict.fromkeys(self.chemistry.limits)
        )

    def pressure(self, number: int) -> float:
        """GPa at a node of this number; a contact without pressure would have no sites."""
        return max(number * self.pressure_step, 1e-9)

    def contact(self, number: int, where: np.ndarray) -> ContactSolution:
        """A contact under the pressure of a node, ``where`` there are sites."""
        pressure = np.where(where, self.pressure(number), 0.0)
        load = float(pressure.sum()) * self.spacing**2
        return ContactSolution(
            pressure=pressure,
            load=load,
            pixel_size=self.spacing,
            modulus=1.0,
            periodic=True,
        )

    def taking_part(self) -> Took:
        """What takes part in the table now, from a small contact."""
        lattice = build_lattice(
            self.own_chemistry, self.contact(0, np.ones((4, 4), dtype=bool)), 0
        )
        history = run_kinetics(
            self.engine,
            lattice,
            self.times[:1],
            temperature=self.temperature,
            seed=0,
        )
        return Took(
            lattice.plugins | history.plugins,
            [*lattice.approximate, *history.approximate],
        )

    def nodes(
        self,
        numbers: list[int],
        threads: int,
        progress: Callable[[int, int], None] | None,
    ) -> dict[int, Node]:
        """The nodes of these numbers; node k is at k times :attr:`pressure_step`."""
        several = max(1, min(threads, len(numbers)))
        nodes = processors.in_order(
            lambda k: _Samples(self, numbers[k]).enough(),
            len(numbers),
            several,
            progress,
        )
        return dict(zip(numbers, nodes, strict=True))

    def path(self, folder: Path) -> Path:
        """The file of the table."""
        return folder / f"closure-{content_hash(self.identity())}.npz"

    def about(self, took: Took) -> dict[str, Any]:
        """What the file says of the table."""
        about = {
            "identity": self.identity(),
            "plugins": took.plugins,
            "approximate": took.approximate,
        }
        return json.loads(json.dumps(about, default=str))

    def load(self, path: Path, took: Took) -> tuple[dict[int, Node], str]:
        """The nodes that a file holds, and what is wrong with it in words; none where it does not exist."""
        try:
            parts, about = container.read(path, _KINDS)
        except FileNotFoundError:
            return {}, ""
        except DamagedError:
            return {}, f"{path} is damaged"
        except StoreError as error:
            return {}, str(error)
        if about != self.about(took):
            return {}, f"{path} was made with other plugins"
        arrays = parts["table"].values
        rows = zip(
            *(arrays[name] for name in ("numbers", "change", "error", "replicas")),
            strict=True,
        )
        return {
            int(number): Node(change, error, int(replicas))
            for number, change, error, replicas in rows
        }, ""

    def keep(self, path: Path, took: Took, nodes: dict[int, Node]) -> str:
        """Write a table; what prevents it in words, else nothing."""
        numbers = sorted(nodes)
        arrays = {
            "numbers": np.array(numbers),
            **{
                name: np.stack([getattr(nodes[number], name) for number in numbers])
                for name in ("change", "error")
            },
            "replicas": np.array([nodes[number].replicas for number in numbers]),
        }
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            table = container.Arrays(values=arrays)
            container.write(
                path, {"table": table}, self.about(took), compact=True, force=True
            )
        except OSError as error:  # a StoreError is one as well
            return f"the table could not be kept in {path.parent} ({error})"
        return ""


def pressure_step(chemistry: Chemistry, temperature: float) -> float:
    """Distance of the pressures of a table, GPa; 0 where bonds do not depend on the pressure."""
    shift = abs(shift_per_gpa(chemistry))
    return STEP * KB * temperature / shift if shift else 0.0


class Took(NamedTuple):
    """The plugins that took part in a table, and what is approximate about it."""

    plugins: dict[str, str] = {}
    approximate: list[dict[str, Any]] = []


def decades_of(
    hold_times: np.ndarray, chemistry: Chemistry, temperature: float
) -> tuple[int, int]:
    """The decades that contain the hold times above 0, until bonds that break have settled."""
    positive = hold_times[hold_times > 0]
    if not positive.size:
        return 0, 1
    first = math.floor(math.log10(float(positive.min())) + 1e-9)
    last = math.ceil(math.log10(float(positive.max())) - 1e-9)
    if chemistry.breaking is not None:
        slow = chemistry.breaking.quantile(np.array([SLOWEST]))
        rate = float(chemistry.rates(slow, temperature)[0])
        if rate * 10.0**last > SETTLED:
            last = math.ceil(math.log10(SETTLED / rate))
            first = min(first, last - 1)
    return first, max(last, first + 1)


class _Samples:
    """The replicas of a node."""

    def __init__(self, setting: Setting, number: int) -> None:
        self.setting, self.number, self.replicas = setting, number, 0
        generator = np.random.default_rng(
            np.random.SeedSequence(setting.seed, spawn_key=(number,))
        )
        # from nearly no site to nearly every one, so that sites have every number of neighbours
        share = (np.arange(SIDE)[:, None] + 0.5) / SIDE
        thinned = [generator.random((SIDE, SIDE)) < share for _ in range(THINNED)]
        self.full, *self.thinned = (
            setting.contact(number, where)
            for where in (np.ones((SIDE, SIDE), dtype=bool), *thinned)
        )
        #: class of each pixel of the full contact and of the thinned ones: its band and its neighbours in contact
        self.classes = [
            self._classes(contact) for contact in (self.full, *self.thinned)
        ]
        self.shape = SIDE // BAND, setting.most + 1
        size = self.shape[0] * self.shape[1]
        held = sum(
            np.bincount(place[contact.contact.ravel()], minlength=size)
            for place, contact in zip(self.classes[1:], self.thinned, strict=True)
        )
        #: (bands, neighbours + 1) sites in contact; sites with every neighbour are those of the full contact
        self.held = np.asarray(held, dtype=np.float64).reshape(self.shape)
        self.held[:, -1] = SIDE * BAND
        pressure = np.array([setting.pressure(number)])
        #: (m,) share of bonded sites without interaction
        self.independent = bonded_share(
            setting.chemistry, setting.temperature, setting.times, pressure
        )[0]
        #: (bands, neighbours + 1, m) bonds in each replica
        self.coupled: list[np.ndarray] = []
        self.control: list[np.ndarray] = []

    def _classes(self, contact: ContactSolution) -> np.ndarray:
        lattice = build_lattice(
            self.setting.own_chemistry.replace(hydroxylation=1.0), contact, 0
        )
        assert lattice.neighbours is not None
        place = np.zeros(SIDE * SIDE, np.int64)
        place[lattice.sites] = np.minimum(
            np.count_nonzero(lattice.neighbours >= 0, axis=1), self.setting.most
        )
        return place + (np.arange(SIDE * SIDE) % SIDE // BAND) * (
            self.setting.most + 1
        )

    def enough(self) -> Node:
        """The node from as many replicas as its accuracy needs."""
        count = FIRST
        while True:
            while self.replicas < count:
                self.add(self.replicas)
            node = self.node()
            if count >= MOST or self.sufficient(node):
                return node
            count *= 2

    def add(self, replica: int) -> None:
        setting, chemistry = self.setting, self.setting.own_chemistry
        disorder = np.random.SeedSequence(
            setting.seed, spawn_key=(self.number, replica, 0)
        )
        noise = random.CommonSeed(setting.seed, spawn_key=(self.number, replica, 1))

        def states(
            chemistry: Chemistry, contact: ContactSolution
        ) -> tuple[ReactionLattice, np.ndarray]:
            lattice = build_lattice(chemistry, contact, disorder)
            history = run_kinetics(
                setting.engine,
                lattice,
                setting.times,
                temperature=setting.temperature,
                seed=noise,
                states=True,
            )
            assert history.states is not None
            return lattice, history.states

        alone, independent = states(chemistry.replace(interaction=None), self.full)
        coupled = np.zeros((*self.shape, setting.times.size))
        control = np.zeros_like(coupled)
        for place, contact in zip(
            self.classes, (self.full, *self.thinned), strict=True
        ):
            lattice, bonded = states(chemistry, contact)
            same = independent[:, np.searchsorted(alone.sites, lattice.sites)]
            which = slice(-1, None) if contact is self.full else slice(0, -1)
            coupled[:, which] += self._sums(place[lattice.sites], bonded)[:, which]
            control[:, which] += self._sums(place[lattice.sites], same)[:, which]
        self.coupled.append(coupled)
        self.control.append(control)
        self.replicas += 1

    def _sums(self, place: np.ndarray, states: np.ndarray) -> np.ndarray:
        size = self.shape[0] * self.shape[1]
        counts = [
            np.bincount(place[state], minlength=size)
            for state in states.astype(bool)
        ]
        return np.stack(counts, axis=-1).reshape(*self.shape, len(states))

    def node(self) -> Node:
        coupled, control = (
            np.concatenate(self.coupled),
            np.concatenate(self.control),
        )
        held = np.tile(self.held, (self.replicas, 1))[..., None]
        sites = np.maximum(held.sum(axis=0), 1.0)
        control = control - held * self.independent
        # residuals about the ratio of bonds to sites, and the coefficient of least variance of the control
        away = coupled - held * (coupled.sum(axis=0) / sites)
        spread = (control**2).sum(axis=0)
        factor = np.divide(
            (away * control).sum(axis=0),
            spread,
            out=np.ones_like(spread),
            where=spread > 0,
        )
        enough = sites * self.independent >= CONTROLLED
        factor = np.where(enough, np.clip(factor, 0.0, 1.0), 1.0)
        values = coupled - factor * control
        share = values.sum(axis=0) / sites
        bands = len(coupled)
        error = (
            np.sqrt(
                ((values - held * share) ** 2).sum(axis=0) * bands / (bands - 1)
            )
            / sites
        )
        exact = np.where(self.independent > NONE, self.independent, np.inf)
        # a change in fewer than one site of the table is not seen
        neighbours = np.arange(self.setting.most + 1)[:, None]
        unseen = np.minimum(
            1 / (sites * exact), neighbours * np.minimum(self.independent, 1.0)
        )
        relative = np.where(np.isfinite(exact), share / exact - 1, 0.0)
        alone = neighbours == 0  # nothing changes a site without neighbours
        return Node(
            np.where(alone, 0.0, relative),
            np.where(alone, 0.0, np.hypot(error / exact, unseen)),
            self.replicas,
        )

    def sufficient(self, node: Node) -> bool:
        """Whether the error is below the accuracy at each decade, as far as bonds are there: inside the contact, and in
        the mean over the numbers of neighbours."""
        at = slice(None, None, PER_DECADE)
        alone = self.independent[at]
        rim = (
            math.sqrt(float(self.setting.most - 1))
            if self.setting.most > 1
            else 1.0
        )
        several = (
            np.sqrt((node.error[1:-1, at] ** 2).mean(axis=0)) / rim
            if self.setting.most > 1
            else 0.0 * alone
        )
        share = np.stack(
            [
                alone * (1 + node.change[-1, at]),
                alone * (1 + node.change[1:, at].mean(axis=0)),
            ]
        )
        error = alone * np.stack([node.error[-1, at], several])
        sites = SIDE * SIDE * node.replicas
        return bool(
            (
                error <= self.setting.accuracy * np.maximum(share, RESOLVED / sites)
            ).all()
        )
