"""Ageing from the kinetics of a random sample of the sites."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from chemage import Chemistry, InputError
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    Engine,
    Unit,
    random,
    statistics,
)
from chemage_ageing._table import grouped_bonds

STREAM = "chemage-ageing/windows"
#: what is kept of a replica, see :meth:`Sample._replica`
_Windowed = tuple[np.ndarray, np.ndarray, int, Any]

#: windows of a replica, and of all together, that the error can be estimated from
FEWEST, FEWEST_IN_ALL = 6, 20
#: relative standard error of the bonds, known beforehand, above which so few are counted (20) that their scatter is
#: often too small by chance
FEW_BONDS = 20**-0.5
HANSEN = """@article{hansen1943,
  author = {Hansen, M. H. and Hurwitz, W. N.},
  title = {On the theory of sampling from finite populations},
  journal = {The Annals of Mathematical Statistics},
  volume = {14},
  pages = {333--362},
  year = {1943},
  doi = {10.1214/aoms/1177731356},
}"""


class Sample(AgeingMethod):
    """The bonds of the whole contact from the kinetics of windows of it that are drawn at random.

    The grid of sites is cut into squares. Each replica draws squares with replacement, with a probability in proportion
    to their sites in contact, and follows the bonds of their sites and of a margin around them, which interacts with
    them but is not counted. The bonds are scaled up by the probabilities (Hansen & Hurwitz, Ann. Math. Stat. 14, 333
    (1943)), which is free of bias, and corrected by the bonds of independent sites, which are known for every square
    without simulation: a regression estimator, whose coefficient comes from the other half of the windows, so that it
    is free of bias too. Estimates of a replica may therefore be below zero or above the sites where bonds are few or
    nearly all formed. What is left is the bias of a margin of finite width. Where fewer than about 20 bonds are counted
    in all replicas, the coefficient is 1, and the replicas scatter at least as those of independent sites do.
    """

    kind = "sample"
    cite: ClassVar[tuple[str, ...]] = (
        "M. H. Hansen, W. N. Hurwitz, Ann. Math. Stat. 14, 333 (1943)",
    )
    bibtex: ClassVar[tuple[str, ...]] = (HANSEN,)
    trade: ClassVar[Mapping[str, tuple[Any, ...]]] = {
        "share": (0.02, 0.05, 0.1, 0.2)
    }

    share: Annotated[Any, Unit("", gt=0, le=0.5)]
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

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """The cost of the sites in windows and margins."""
        simulated = min(1.0, self.share * (1 + 2 * self.margin / self.window) ** 2)
        cost = {
            name: replicas * (0.005 + simulated * kinetics[name] + 1e-6 * sites)
            for name in ("cpu_seconds", "cpu_seconds_least", "cpu_seconds_most")
            if name in kinetics
        }
        if "bytes" in kinetics:
            cost["bytes"] = simulated * kinetics["bytes"] + 40.0 * sites
        return cost

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
            nothing = np.zeros(
                (request.replicas, request.hold_times.size), np.int64
            )
            return AgedBonds(nothing, nothing[:, 0])
        windows = Windows.of(
            touching.shape, touching.periodic, touching.sites, self.window
        )
        count = round(self.share * touching.sites.size / windows.mean_held)
        if count < FEWEST or count * request.replicas < FEWEST_IN_ALL:
            return self._every_site(request)
        square = np.searchsorted(
            windows.squares, square_of(touching.sites, touching.shape, self.window)
        )
        compared = grouped_bonds(
            chemistry,
            request.temperature,
            request.hold_times,
            touching.pressure,
            square,
            windows.squares.size,
        )
        replicas = request.each(
            lambda number: self._replica(request, windows, count, number)
        )
        return self._estimated(request, windows, compared, replicas)

    def _every_site(self, request: AgeingRequest) -> AgedBonds:
        """The bonds of a contact that is too small to be sampled."""
        why = f"every site was followed: a share of {self.share:g} is too few windows to know the error from"

        def follow(number: int) -> tuple[np.ndarray, int, Any]:
            replica = request.follow(number)
            return (
                replica.history.bonds,
                replica.lattice.sites.size,
                replica.origin(),
            )

        bonds, sites, origins = zip(*request.each(follow), strict=True)
        return AgedBonds.of(
            origins, bonds=np.stack(bonds), sites=np.array(sites), notes=(why,)
        )

    def _replica(
        self, request: AgeingRequest, windows: Windows, count: int, number: int
    ) -> _Windowed:
        """Bonds in each window that is drawn, (windows, m), the positions of these among the squares, the sites that
        were followed, those of margins included, and where the bonds come from."""
        drawn = windows.drawn(request.seeds(number)[0], count)
        chosen = np.unique(drawn)
        replica = request.follow(
            number, sites=windows.sites_around(chosen, self.margin), states=True
        )
        lattice, history = replica.lattice, replica.history
        assert history.states is not None
        squares = windows.squares[chosen]
        square = square_of(lattice.sites, windows.shape, windows.side)
        at = np.minimum(np.searchsorted(squares, square), chosen.size - 1)
        counted = squares[at] == square
        bonds = np.stack(
            [
                np.bincount(at[counted & state], minlength=chosen.size)
                for state in history.states
            ],
            axis=-1,
        )
        return (
            bonds[np.searchsorted(chosen, drawn)],
            drawn,
            lattice.sites.size,
            replica.origin(),
        )

    def _estimated(
        self,
        request: AgeingRequest,
        windows: Windows,
        compared: np.ndarray,
        replicas: list[_Windowed],
    ) -> AgedBonds:
        """Scale the windows up; ``compared`` are the bonds of independent sites in every square, (squares, m)."""
        sites = int(windows.held.sum())
        # what each window says of the whole: (replicas, windows, m)
        found, drawn, followed, origins = zip(*replicas, strict=True)
        scale = np.stack([sites / windows.held[squares] for squares in drawn])[
            ..., None
        ]
        bonds = np.stack(found) * scale
        total = compared.sum(axis=0)
        alone = np.stack([compared[squares] for squares in drawn]) * scale - total
        # where all windows are alike, only rounding is left, which is nothing to regress on
        alone[np.abs(alone) < 1e-10 * total] = 0.0
        count = bonds.shape[1]
        # standard error of the mean if sites are independent and the coefficient is 1
        share = np.clip(compared / windows.held[:, None], 0.0, 1.0)
        known = np.sqrt(
            sites * (share * (1 - share)).sum(axis=0) / (count * len(replicas))
        )
        few = known > FEW_BONDS * total
        values = np.empty_like(bonds)
        for half in (0, 1):
            own, other = slice(half, None, 2), slice(1 - half, None, 2)
            coefficient = np.where(
                few, 1.0, _coefficient(bonds[:, other], alone[:, other])
            )
            values[:, own] = bonds[:, own] - coefficient * alone[:, own]
        windowed = values.var(axis=1, ddof=1) / count
        error = np.sqrt(windowed.sum(axis=0)) / len(replicas)
        # by so much it is larger because the coefficient comes from so many windows, which adds its own error (Cochran,
        # Sampling Techniques, 3rd ed. (1977), section 12.6), and the error itself (Student's t)
        half = bonds[:, 1::2, 0].size
        error = error * (
            math.sqrt(1 + 1 / (half - 3))
            * statistics.student_limit(half - 2)
            / statistics.NORMAL_LIMIT
        )
        error = np.where(few, np.maximum(error, known), error)
        estimates = values.mean(axis=1)
        mean = estimates.mean(axis=0)
        reactive = sites * request.chemistry.hydroxylation
        part = 100 * np.mean(followed) / reactive
        notes = [
            f"{count} windows a replica; {part:.2g} % of the sites were followed"
        ]
        if (few & (total > 0)).any():
            last = request.hold_times[few & (total > 0)].max()
            notes.append(
                f"fewer than about 20 bonds are counted until {last:g} s: their scatter between replicas is often too "
                "small by chance, the error of sampling that is stated is not; a larger share counts more"
            )
        return AgedBonds.of(
            origins,
            # not limited to what is possible, which would bias their mean where bonds are few or nearly all there
            bonds=estimates,
            sites=np.full(len(replicas), reactive),
            errors={
                "sampling": np.divide(
                    error, mean, out=np.full(mean.shape, np.nan), where=mean > 0
                )
            },
            error_sources={
                "sampling": "from the scatter of the windows; part of the scatter of the replicas"
            },
            notes=tuple(notes),
        )


def _coefficient(bonds: np.ndarray, alone: np.ndarray) -> np.ndarray:
    """The coefficient of the regression of ``bonds`` on ``alone``, (replicas, windows, m) both: (m,)."""
    centred = alone - alone.mean(axis=(0, 1))
    spread = (centred**2).sum(axis=(0, 1))
    together = (centred * bonds).sum(axis=(0, 1))
    return np.divide(together, spread, out=np.zeros(spread.shape), where=spread > 0)


class Windows(NamedTuple):
    """The squares of a grid that hold sites in contact."""

    #: (mx, my) of the grid of sites
    shape: tuple[int, int]
    periodic: bool
    #: sites along the side of a square
    side: int
    #: (n,) int64: flat indices of the sites in contact, ascending
    sites: np.ndarray
    #: (k,) int64: squares with sites in contact, ascending
    squares: np.ndarray
    #: (k,) int64: sites in contact in each of them
    held: np.ndarray

    @classmethod
    def of(
        cls, shape: tuple[int, int], periodic: bool, sites: np.ndarray, side: int
    ) -> Windows:
        """Cut the grid into squares of ``side`` sites; those at the far edges may be smaller.

        Raises
        ------
        InputError
            A square is larger than the grid.
        """
        fitting(side, shape)
        squares, held = np.unique(square_of(sites, shape, side), return_counts=True)
        return cls(shape, periodic, side, sites, squares, held)

    @property
    def mean_held(self) -> float:
        """Sites in a window that is drawn, in the mean: windows are drawn in proportion to their sites."""
        return float((self.held.astype(float) ** 2).sum() / self.held.sum())

    def drawn(self, seed: np.random.SeedSequence, count: int) -> np.ndarray:
        """Draw ``count`` windows with replacement, each with a probability in proportion to its sites: (count,) int64,
        positions in :attr:`squares`."""
        ends = np.cumsum(self.held)
        lots = (
            random.uniforms(seed, random.stream(STREAM), np.arange(count))
            * ends[-1]
        )
        return np.minimum(np.searchsorted(ends, lots, side="right"), ends.size - 1)

    def sites_around(self, chosen: np.ndarray, margin: int) -> np.ndarray:
        """The sites in contact in the windows ``chosen`` (positions in :attr:`squares`) and up to ``margin`` sites
        around them, each once, ascending: (n,) int64 flat indices."""
        inside = np.zeros(self.shape, np.bool_)
        for square in self.squares[chosen]:
            place = divmod(square, -(-self.shape[1] // self.side))
            parts = []
            for first, length in zip(place, self.shape, strict=True):
                begin = first * self.side
                part = np.arange(
                    begin - margin, min(begin + self.side, length) + margin
                )
                # what reaches over an edge goes on at the other
                parts.append(
                    part % length if self.periodic else part.clip(0, length - 1)
                )
            inside[np.ix_(*parts)] = True
        return self.sites[inside.ravel()[self.sites]]


def fitting(side: int, shape: tuple[int, int]) -> None:
    """Refuse windows larger than the grid of sites."""
    if side > min(shape):
        raise InputError.of(
            "window",
            side,
            f"is larger than the contact of {shape[0]} x {shape[1]} sites",
            "take a smaller window",
        )


def square_of(sites: np.ndarray, shape: tuple[int, int], side: int) -> np.ndarray:
    """The square that each site lies in: (n,) int64, row by row."""
    row, column = np.divmod(sites, shape[1])
    return row // side * -(-shape[1] // side) + column // side
