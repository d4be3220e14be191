"""What a pulled contact does in theory: independent sites in steady sliding and their stability, and small patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import expm_multiply

import chemage as ca
from chemage.plugin import Drive, Partners

KB, EV_PER_NM = ca.plugin.KB, 0.1602176634
KT = KB * 300.0


def lattice_of(n: int, forming, breaking) -> ca.ReactionLattice:
    """Independent sites."""
    values = {
        name: np.broadcast_to(np.asarray(v, float), n).copy()
        for name, v in (("forming", forming), ("breaking", breaking))
    }
    return ca.ReactionLattice(pixels=(n, 1), sites=np.arange(n), **values)


def drive_of(speed: float, **options) -> Drive:
    fields = {"bond_stiffness": 10.0, "transition_distance": 0.05, "partner": "kept", "shape": "constant"}
    return Drive(speed=speed, **{**fields, **options})


@dataclass
class Independent:
    """Equal sites that do not interact, at 300 K; forces per site."""

    speed: float
    drive: Drive
    breaking: float
    forming: float

    def __post_init__(self) -> None:
        law = ca.rupture(
            "dudko-hummer-szabo",
            transition_distance=self.drive.transition_distance,
            loading_rate=self.drive.bond_stiffness * self.speed,
            shape=self.drive.shape,
        )
        ramp = law.ramp(np.array([self.breaking]), 300.0, 1e13)
        scale = ramp.thermal / self.drive.bond_stiffness
        mean = float(law.mean_forces(np.array([self.breaking]), 300.0)[0]) / self.drive.bond_stiffness
        # logarithmic where bonds break long before they are loaded, even where the hazard rises
        edges = np.concatenate([[0.0], np.geomspace(1e-6 * mean, 60 * mean, 4000), np.linspace(0, 2 * mean, 4001)[1:]])
        edges = np.unique(edges)
        self.stretch = edges
        self.hazard = ramp.hazard(edges / scale)[0]
        self.survival = np.exp(-self.hazard)
        self.k_on = 1e13 * np.exp(-self.forming / KT)

    def integral(self, values: np.ndarray) -> complex:
        """∫ values ds over the stretch."""
        return np.sum((values[1:] + values[:-1]) / 2 * np.diff(self.stretch))

    @property
    def mean_force(self) -> float:
        """Ḟ∫tS dt/(1/k_on + ∫S dt), nN per site."""
        s, survival, v = self.stretch, self.survival, self.speed
        below = v / self.k_on + float(np.real(self.integral(survival)))
        return self.drive.bond_stiffness * float(np.real(self.integral(s * survival))) / below

    @property
    def peak_of_old_bonds(self) -> float:
        """κ max(sS), nN per bond of a contact none of whose sites binds again while it is pulled."""
        return self.drive.bond_stiffness * float((self.stretch * self.survival).max())

    @property
    def mean_stretch(self) -> float:
        """At which a bond breaks, nm."""
        return float(np.real(self.integral(self.survival)))

    def critical(self) -> tuple[float, float]:
        """The stiffness per site below which steady sliding is unstable, and the frequency (rad/s) that grows first.

        A perturbation exp(λt) goes on where K = −λG(λ), G the change of the force per change of the speed
        (`response`): here λ = iω, the imaginary part is zero, and K the largest. 0 where none is.
        """
        omega = np.geomspace(1.0, 300.0, 600) * self.speed
        values = np.array([1j * w * self.response(1j * w) for w in omega])
        cross = np.flatnonzero(np.diff(np.sign(values.imag)))
        share = values.imag[cross] / (values.imag[cross] - values.imag[cross + 1])
        crossings = -(values.real[cross] + share * (values.real[cross + 1] - values.real[cross]))
        if not crossings.size or crossings.max() <= 0:
            return 0.0, 0.0
        first = int(np.argmax(crossings))
        return float(crossings[first]), float(omega[cross[first]])

    def response(self, rate: complex) -> complex:
        """Force per site over a small change of the speed that goes as exp(rate t)."""
        s, survival, v = self.stretch, self.survival, self.speed
        start = 1 / (v / self.k_on + float(np.real(self.integral(survival))))  # bonds per nm at stretch 0
        grow = np.exp(np.minimum((rate * s / v).real, 300.0) + 1j * (rate * s / v).imag)
        # d(hazard) = k ds/v
        steps = (grow[1:] + grow[:-1]) / 2 * np.diff(self.hazard)
        gained = start / v * np.concatenate([[0.0], np.cumsum(steps)])
        # p1 = S e^(−λs/v) (c + gained), c v + start = −k_on ∫p1
        shape = survival / grow
        c = -(start + self.k_on * self.integral(shape * gained)) / (v + self.k_on * self.integral(shape))
        return self.drive.bond_stiffness * self.integral(s * shape * (c + gained))


class Renewed:
    """Steady sliding of sites that meet another partner with every spacing d of slip, at 300 K; the ``forming`` and the
    ``breaking`` barriers (eV) of partners are equally likely. Forces per site; bonds of constant distance to the transition
    state.

    Over one spacing, free sites of each class of partners bind, and bonds that formed within it leave them to the same
    partner when they break; older bonds leave them to any. Births are uniform within each of ``cells`` steps; the error
    falls as their number squared.
    """

    def __init__(self, drive: Drive, forming: Sequence[float], breaking: Sequence[float], spacing: float = 0.5) -> None:
        self.drive, self.forming, self.breaking, self.spacing = drive, forming, breaking, spacing

    def sites(self, n: int, seed: int = 0) -> tuple[ca.ReactionLattice, Partners]:
        """The same for an engine."""
        rng = np.random.default_rng(seed)
        lattice = lattice_of(n, rng.choice(self.forming, n), rng.choice(self.breaking, n))
        levels = (np.repeat(np.sort(each), (1 << 16) // len(each)) for each in (self.forming, self.breaking))
        return lattice, Partners(*levels, np.zeros(n), self.spacing)

    def survival(self, breaking: float, stretch: np.ndarray) -> np.ndarray:
        """Of a bond to a ``stretch`` (nm)."""
        gain = self.drive.bond_stiffness * self.drive.transition_distance / EV_PER_NM / KT
        below = np.minimum(stretch, breaking / KT / gain)
        hazard = np.exp(-breaking / KT) * np.expm1(gain * below) / gain + stretch - below
        return np.exp(-1e13 / self.drive.speed * hazard)

    def force(self, cells: int) -> float:
        """nN, in steps of d over ``cells``."""
        d, h = self.spacing, self.spacing / cells
        # by the largest stretch, where no bond is left
        left = self.survival(max(self.breaking), d * np.arange(1, 1000))
        periods, fine = np.flatnonzero(left < 1e-15)[0] + 3, max(8, 16000 // cells)
        stretch = np.arange(periods * cells * fine + 1) * (h / fine)
        here = np.zeros((cells, cells + 1))
        births, place = [], np.arange(cells)
        classes = list(product(self.forming, self.breaking))
        for forming, breaking in classes:
            s = self.survival(breaking, stretch)
            # of bonds born in a cell, those left at the end of the one so many further on
            left = ((s[1:] + s[:-1]) / 2).reshape(-1, fine).mean(axis=1)
            lost = np.append(1.0, left[:-1]) - left
            binds = 1e13 * np.exp(-forming / KT) / self.drive.speed * h
            soon = -np.expm1(-binds)
            late = 1 - soon / binds if binds > 1e-4 else binds / 2 - binds**2 / 6
            response = []
            for free, given in ((1.0, 0.0), (0.0, 1.0)):
                born = np.zeros(cells)
                for i in range(cells):
                    more = born[:i] @ lost[1 : i + 1][::-1] + given * (i == 0)
                    born[i] = (free * soon + more * late) / (1 - lost[0] * late)
                    free += more + lost[0] * born[i] - born[i]
                response.append(born)
            of_old = np.where(place[:, None] >= place, response[1][place[:, None] - place], 0.0)
            births.append(1 / len(classes) * np.column_stack([response[0], of_old]))
            later = [lost[n * cells + place[:, None] - place] for n in range(1, periods - 1)]
            here += np.sum(later, axis=0) @ births[-1]
        old = np.linalg.solve(np.eye(cells) - here[:, 1:], here[:, 0])
        total, force = 1.0, 0.0
        for (_, breaking), made in zip(classes, births, strict=True):
            born, s = made @ np.append(1.0, old), self.survival(breaking, stretch)
            left = ((s[1:] + s[:-1]) / 2).reshape(-1, fine).mean(axis=1)
            total += born @ left.reshape(periods, cells).sum(axis=0)[::-1]
            force += born.sum() / d * float(np.trapezoid(stretch * s, stretch))
        return self.drive.bond_stiffness * force / total

    @property
    def mean_force(self) -> float:
        """Extrapolated to steps of no size, nN."""
        coarse, fine = self.force(100), self.force(200)
        return fine + (fine - coarse) / 3


class Transport:
    """∂n/∂t + V ∂n/∂s = −k(s) n of equal sites, unstretched bonds forming at k_on on those that are free.

    Cohorts of bonds go along the characteristics; in a step of time, of second order, bonds break at a constant rate
    per site and the free sites relax towards it, so that k_on may be fast.
    """

    def __init__(self, model: Independent, rested: float | None = None) -> None:
        """In the steady sliding of ``model``, or ``rested`` with so large a share of bonds."""
        self.model = model
        if rested is not None:
            self.amount, self.stretch = np.array([rested]), np.zeros(1)
            return
        s = model.stretch
        density = model.survival / (model.speed / model.k_on + float(np.real(model.integral(model.survival))))
        self.amount = (density[1:] + density[:-1]) / 2 * np.diff(s)
        self.stretch = (s[1:] + s[:-1]) / 2

    def breaking(self, stretch: np.ndarray) -> np.ndarray:
        """Hz, at a constant distance to the transition state."""
        drive = self.model.drive
        lowered = drive.bond_stiffness * stretch * drive.transition_distance / EV_PER_NM
        return 1e13 * np.exp(-np.maximum(self.model.breaking - lowered, 0.0) / KT)

    @property
    def moments(self) -> tuple[float, float]:
        """Of the force of a site, nN: mean and variance."""
        force = self.model.drive.bond_stiffness * self.stretch
        mean = float(force @ self.amount)
        return mean, float(force**2 @ self.amount) - mean**2

    def run(self, speed: float, times: np.ndarray) -> np.ndarray:
        """(m, 2) moments at each of ``times`` (s), from the first of them on; each is one step."""
        found, k_on = [self.moments], self.model.k_on
        for span in np.diff(times):
            way = speed * span
            lasts = np.exp(-span * self.breaking(self.stretch + way / 2))
            free = 1 - self.amount.sum()
            lost = float(self.amount @ -np.expm1(-span * self.breaking(self.stretch + way / 2)))
            young = -np.expm1(-span / 2 * float(self.breaking(np.array([way / 4]))[0]))
            # sites that new bonds free again are few, and bind anew
            level = lost / (span * k_on)
            left = level + (free - level) * np.exp(-span * k_on)
            born = (lost + free - left) * (1 - young)
            self.stretch = np.append(self.stretch + way, way / 2)
            self.amount = np.append(self.amount * lasts, born)
            if speed == 0 and self.stretch.size > 1 and self.stretch[-2] == 0:
                self.amount[-2] += self.amount[-1]
                self.stretch, self.amount = self.stretch[:-1], self.amount[:-1]
            alive = self.amount > 1e-16 * self.amount.sum()
            self.stretch, self.amount = self.stretch[alive], self.amount[alive]
            found.append(self.moments)
        return np.array(found)


def patches(count: int, seed: int, forming: float = 0.42, breaking: float = 1.1) -> ca.ReactionLattice:
    """``count`` equal patches of 3 × 3 interacting sites, far from each other."""
    rng = np.random.default_rng(seed)
    one = {
        "forming": forming + 0.02 * rng.standard_normal(9),
        "breaking": breaking + 0.02 * rng.standard_normal(9),
    }
    pairs = {}
    for i, j in product(range(9), range(9)):
        if i < j and max(abs(i // 3 - j // 3), abs(i % 3 - j % 3)) == 1:
            pairs[i, j] = pairs[j, i] = 0.1 * (rng.random() - 0.4)
    neighbours, coupling = np.full((9, 8), -1, np.int32), np.zeros((9, 8), np.float32)
    for i in range(9):
        for slot, j in enumerate(j for j in range(9) if (i, j) in pairs):
            neighbours[i, slot], coupling[i, slot] = j, pairs[i, j]
    start = 9 * np.arange(count)[:, None, None]
    graph = np.where(neighbours >= 0, neighbours + start, -1).reshape(-1, 8).astype(np.int32)
    return ca.ReactionLattice(
        pixels=(9 * count, 1),
        sites=np.arange(9 * count),
        neighbours=graph,
        coupling=np.tile(coupling, (count, 1)),
        **{name: np.tile(values, count) for name, values in one.items()},
    )


def random_pull(seed: int) -> tuple[ca.ReactionLattice, Drive, np.ndarray, dict[str, Any]]:
    """Lattice, drive, times and options of a pull in which everything is drawn over many decades."""
    rng = np.random.default_rng(seed)
    n = int(np.exp(rng.uniform(0, np.log(300))))
    forming = rng.uniform(0.2, 1.4) + rng.uniform(0, 0.2) * rng.standard_normal(n)
    breaking = rng.uniform(0.3, 1.8) + rng.uniform(0, 0.1) * rng.standard_normal(n)
    lattice = lattice_of(n, forming, breaking)
    if n > 4 and rng.random() < 0.5:
        reach = int(rng.integers(1, 3))
        steps = np.concatenate([np.arange(1, reach + 1), -np.arange(1, reach + 1)])
        graph = ((np.arange(n)[:, None] + steps) % n).astype(np.int32)
        coupled = {"neighbours": graph, "coupling": np.full(graph.shape, rng.uniform(-0.3, 0.3), np.float32)}
        lattice = ca.ReactionLattice(pixels=(n, 1), sites=np.arange(n), forming=forming, breaking=breaking, **coupled)
    speed, way = 10 ** rng.uniform(-3, 9), 10 ** rng.uniform(-3, 1.5)
    drive = Drive(
        speed=speed,
        spring=[None, 0.0, 10 ** rng.uniform(-3, 6)][rng.choice(3, p=[0.4, 0.05, 0.55])],
        friction=rng.choice([0.0, 10 ** rng.uniform(-3, 3)]),
        bond_stiffness=10 ** rng.uniform(-2, 3),
        transition_distance=rng.uniform(0.005, 0.2),
        shape=str(rng.choice(["cusp", "cubic", "constant"])),
        partner=str(rng.choice(["kept", "renewed"])),
    )
    times = np.concatenate([[0.0], np.geomspace(10 ** rng.uniform(-9, 0), 1.0, 12) * way / speed])
    quantiles = (np.sort(np.resize(each, max(n, 2))) for each in (forming, breaking))
    return lattice, drive, times, {
        "temperature": rng.uniform(100, 500),
        "start": [None, np.ones(n, bool), rng.random(n) < 0.5][rng.integers(3)],
        "partners": Partners(*quantiles, np.zeros(n), 10 ** rng.uniform(-1, 1)),
        "seed": seed,
    }  # fmt: skip


def master_equation(lattice: ca.ReactionLattice, drive: Drive, end: float, steps: int) -> np.ndarray:
    """The probability of each of 3^9 states of one patch at ``end`` (s), all sites bonded at first.

    A site has its first bond (0), none (1) or another one (2), which is too young to break. The product of the matrix
    exponentials of the rates in the middle of each step (Magnus, second order); site 0 is the first digit.
    """
    n = 9
    digits = np.array(list(product(range(3), repeat=n)))
    weights = 3 ** np.arange(n - 1, -1, -1)
    index = np.arange(len(digits))
    rows, columns, rates, breaks = [], [], [], []
    for i in range(n):
        there = index[digits[:, i] == 0]
        breaks.append((there, there + weights[i]))
        open_ = index[digits[:, i] == 1]
        energy = np.full(open_.size, lattice.forming[i])
        for slot, j in enumerate(lattice.neighbours[i]):
            if j >= 0:
                energy += lattice.coupling[i, slot] * (digits[open_, j] != 1)
        rows += [open_ + weights[i], open_]
        rate = 1e13 * np.exp(-np.maximum(energy, 0) / KT)
        columns += [open_, open_]
        rates += [rate, -rate]
    size = (len(digits),) * 2
    forming = sp.csr_matrix((np.concatenate(rates), (np.concatenate(rows), np.concatenate(columns))), size)
    parts = []
    for source, target in breaks:
        ones = np.ones(source.size)
        parts.append(
            sp.csr_matrix(
                (np.concatenate([ones, -ones]), (np.concatenate([target, source]), np.concatenate([source, source]))),
                size,
            )
        )
    scale = KT * EV_PER_NM / drive.transition_distance
    state = np.zeros(len(digits))
    state[0] = 1.0
    # equal steps where bonds break, one long one before
    times = np.concatenate([[0.0], np.linspace(0.4 * end, end, steps)])
    for low, high in pairwise(times):
        force = drive.bond_stiffness * drive.speed * (low + high) / 2 / scale
        matrix = forming.copy()
        for i, part in enumerate(parts):
            matrix = matrix + part * (1e13 * np.exp(min(force - lattice.breaking[i] / KT, 0.0)))
        state = expm_multiply(matrix * (high - low), state)
    return state


def codes(pulled, count: int) -> np.ndarray:
    """The state of each patch, as `master_equation` numbers them."""
    first = pulled.state & (pulled.stretch > (1 - 1e-9) * pulled.displacement[-1])
    digits = np.where(first, 0, np.where(pulled.state, 2, 1)).reshape(count, 9)
    return digits @ 3 ** np.arange(8, -1, -1)


def chi_square(found: np.ndarray, expected: np.ndarray, count: int) -> float:
    """p-value of the states of ``count`` patches; states that are expected fewer than 8 times are one class."""
    from scipy.stats import chi2

    counts = np.bincount(found, minlength=expected.size)
    often = expected * count >= 8
    observed = np.append(counts[often], counts[~often].sum())
    mean = np.append(expected[often], max(1 - expected[often].sum(), 0.0)) * count
    if mean[-1] < 8:
        observed, mean = observed[:-1], mean[:-1]
    return float(chi2.sf(((observed - mean) ** 2 / mean).sum(), observed.size - 1))
