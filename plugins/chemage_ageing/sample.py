"""Ageing from the kinetics of a random sample of the sites."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from chemage import Chemistry, InputError, ReactionLattice
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    BondHistory,
    Engine,
    Unit,
    build_lattice,
    run_kinetics,
    threads,
)
from chemage_ageing._independent import grouped_bonds
from chemage_ageing._references import HANSEN
from chemage_ageing._windows import Windows, fitting, square_of

#: windows of a replica, and of all together, that the error can be estimated from
FEWEST, FEWEST_IN_ALL = 6, 20


class Sample(AgeingMethod):
    """The bonds of the whole contact from the kinetics of windows of it that are drawn at random.

    The grid of sites is cut into squares. Each replica draws squares with replacement, with a probability in proportion
    to their sites in contact, and follows the bonds of their sites and of a margin around them, which interacts with
    them but is not counted. The bonds are scaled up by the probabilities (Hansen & Hurwitz, Ann. Math. Stat. 14, 333
    (1943)), which is free of bias, and corrected by the bonds of independent sites, which are known for every square
    without simulation: a regression estimator, whose coefficient comes from the other half of the windows, so that it
    is free of bias too. Estimates of a replica may therefore be below zero or above the sites where bonds are few or
    nearly all formed. What is left is the bias of a margin of finite width.
    """

    kind = "sample"
    cite: ClassVar[tuple[str, ...]] = ("M. H. Hansen, W. N. Hurwitz, Ann. Math. Stat. 14, 333 (1943)",)
    bibtex: ClassVar[tuple[str, ...]] = (HANSEN,)
    trade: ClassVar[Mapping[str, tuple[Any, ...]]] = {"share": (0.02, 0.05, 0.1, 0.2)}

    share: Annotated[float, Unit("", gt=0, le=0.5)]
    """share of the sites that each replica counts, on average; above one half, every site costs no more"""
    window: int = Field(default=16, ge=1, le=4096)
    """side of a window, in sites"""
    margin: int = Field(default=4, ge=0, le=64)
    """width of the margin around a window, in sites"""

    def check(self, chemistry: Chemistry, engine: Engine) -> None:
        """See :meth:`chemage.plugin.AgeingMethod.check`."""
        if not engine.restart:
            raise InputError(
                f"ageing 'sample' asks for the states of sites, and engine {engine.kind!r} cannot resume from a "
                "history (restart = False), so that they are not known; use another engine"
            )

    def check_sites(self, shape: tuple[int, int], touching: float | None) -> None:
        """See :meth:`chemage.plugin.AgeingMethod.check_sites`."""
        fitting(self.window, shape)

    def expected(self, sites: float, kinetics: Mapping[str, float], replicas: int) -> dict[str, float]:
        """The cost of the sites in windows and margins."""
        simulated = min(1.0, self.share * (1 + 2 * self.margin / self.window) ** 2)
        known = {}
        for name in ("cpu_seconds", "cpu_seconds_least", "cpu_seconds_most"):
            if name in kinetics:
                known[name] = replicas * (0.005 + simulated * kinetics[name] + 1e-6 * sites)
        if "bytes" in kinetics:
            known["bytes"] = simulated * kinetics["bytes"] + 40.0 * sites
        return known

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.plugin.AgeingMethod.age`.

        Raises
        ------
        InputError
            A window is larger than the contact.
        """
        chemistry, contact = request.chemistry, request.solution
        touching = chemistry.sites_of(contact)
        if not touching.sites.size:
            nothing = np.zeros((request.replicas, request.hold_times.size), np.int64)
            return AgedBonds(nothing, nothing[:, 0])
        windows = Windows.of(touching.shape, touching.periodic, touching.sites, self.window)
        count = round(self.share * touching.sites.size / windows.mean_held)
        if count < FEWEST or count * request.replicas < FEWEST_IN_ALL:
            return self._every_site(request)
        square = np.searchsorted(windows.squares, square_of(touching.sites, touching.shape, self.window))
        compared = grouped_bonds(
            chemistry, request.temperature, request.hold_times, touching.pressure, square, windows.squares.size
        )

        def replica(number: int) -> _Replica:
            return self._replica(request, windows, count, number)

        done = _each(replica, request)
        return self._estimated(request, windows, compared, done)

    def _every_site(self, request: AgeingRequest) -> AgedBonds:
        """The bonds of a contact that is too small to be sampled."""

        def replica(number: int) -> _Replica:
            lattice, history = _followed(request, number, None)
            return _Replica.of(lattice, history, history.bonds, np.empty(0, np.int64))

        done = _each(replica, request)
        why = f"every site was followed: a share of {self.share:g} is too few windows to know the error from"
        sites = np.array([one.sites for one in done])
        return AgedBonds(np.stack([one.bonds for one in done]), sites, **_joined(done, why))

    def _replica(self, request: AgeingRequest, windows: Windows, count: int, number: int) -> _Replica:
        drawn = windows.drawn(request.seeds(number)[0], count)
        chosen = np.unique(drawn)
        lattice, history = _followed(request, number, windows.sites_around(chosen, self.margin))
        assert history.states is not None
        squares, square = windows.squares[chosen], square_of(lattice.sites, windows.shape, windows.side)
        at = np.minimum(np.searchsorted(squares, square), chosen.size - 1)
        counted = squares[at] == square
        bonds = np.stack([np.bincount(at[counted & state], minlength=chosen.size) for state in history.states], axis=-1)
        return _Replica.of(lattice, history, bonds[np.searchsorted(chosen, drawn)], drawn)

    def _estimated(
        self, request: AgeingRequest, windows: Windows, compared: np.ndarray, done: list[_Replica]
    ) -> AgedBonds:
        """Scale the windows up; ``compared`` are the bonds of independent sites in every square, (squares, m)."""
        sites = int(windows.held.sum())
        # what each window says of the whole: (replicas, windows, m)
        scale = np.stack([sites / windows.held[one.drawn] for one in done])[..., None]
        bonds = np.stack([one.bonds for one in done]) * scale
        known = np.stack([compared[one.drawn] for one in done]) * scale - compared.sum(axis=0)
        values = np.empty_like(bonds)
        for half in (0, 1):
            own, other = slice(half, None, 2), slice(1 - half, None, 2)
            values[:, own] = bonds[:, own] - _coefficient(bonds[:, other], known[:, other]) * known[:, own]
        estimates = values.mean(axis=1)
        count = bonds.shape[1]
        mean, windowed = estimates.mean(axis=0), values.var(axis=1, ddof=1) / count
        error = np.sqrt(windowed.sum(axis=0)) / len(done)
        reactive = sites * request.chemistry.hydroxylation
        followed = np.mean([one.sites for one in done]) / reactive
        note = f"{done[0].drawn.size} windows a replica; {100 * followed:.2g} % of the sites were followed"
        return AgedBonds(
            # not limited to what is possible, which would bias their mean where bonds are few or nearly all there
            estimates,
            np.full(len(done), reactive),
            errors={"sampling": np.divide(error, mean, out=np.full(mean.shape, np.nan), where=mean > 0)},
            error_sources={"sampling": "from the scatter of the windows; part of the scatter of the replicas"},
            **_joined(done, note),
        )


class _Replica(NamedTuple):
    """What is kept of a replica."""

    #: (windows, m) bonds in each window that was drawn, or (m,) in all
    bonds: np.ndarray
    #: (windows,) their positions among the squares
    drawn: np.ndarray
    #: sites that were followed, those of margins included
    sites: int
    engine: str
    notes: tuple[str, ...]
    plugins: Mapping[str, Any]
    approximate: list[Any]

    @classmethod
    def of(cls, lattice: ReactionLattice, history: BondHistory, bonds: np.ndarray, drawn: np.ndarray) -> _Replica:
        return cls(
            bonds,
            drawn,
            lattice.sites.size,
            history.engine,
            history.notes,
            lattice.plugins | history.plugins,
            [*lattice.approximate, *history.approximate],
        )


def _followed(request: AgeingRequest, number: int, sites: np.ndarray | None) -> tuple[ReactionLattice, BondHistory]:
    """The kinetics of a replica on ``sites`` with their states, or on every site without."""
    disorder, noise = request.seeds(number)
    lattice = build_lattice(request.chemistry, request.solution, disorder, sites=sites)
    history = run_kinetics(
        request.engine,
        lattice,
        request.hold_times,
        temperature=request.temperature,
        seed=noise,
        states=sites is not None,
        contact=request.solution,
        chemistry=request.chemistry,
    )
    return lattice, history


def _joined(done: list[_Replica], note: str) -> dict[str, Any]:
    """What the replicas say beside their bonds."""
    return {
        "notes": (note, *done[0].notes),
        "engine": done[0].engine,
        "plugins": {name: source for one in done for name, source in one.plugins.items()},
        "approximate": [entry for one in done for entry in one.approximate],
    }


def _coefficient(bonds: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The coefficient of the regression of ``bonds`` on ``known``, (replicas, windows, m) both: (m,)."""
    centred = known - known.mean(axis=(0, 1))
    spread = (centred**2).sum(axis=(0, 1))
    together = (centred * bonds).sum(axis=(0, 1))
    return np.divide(together, spread, out=np.zeros(spread.shape), where=spread > 0)


def _each(task: Callable[[int], _Replica], request: AgeingRequest) -> list[_Replica]:
    """``task`` of every replica."""
    at_once = max(1, min(request.replicas, request.threads // request.engine.concurrency()))
    return list(threads.in_order(task, request.replicas, at_once, request.progress))
