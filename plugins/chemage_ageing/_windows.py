"""Windows of a grid of sites: which are drawn, and which sites they and their margins hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage import InputError
from chemage.plugin import random

STREAM = "chemage-ageing/windows"


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
    def of(cls, shape: tuple[int, int], periodic: bool, sites: np.ndarray, side: int) -> Windows:
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
        lots = random.uniforms(seed, random.stream(STREAM), np.arange(count)) * ends[-1]
        return np.minimum(np.searchsorted(ends, lots, side="right"), ends.size - 1)

    def sites_around(self, chosen: np.ndarray, margin: int) -> np.ndarray:
        """The sites in contact in the windows ``chosen`` (positions in :attr:`squares`) and up to ``margin`` sites
        around them, each once, ascending: (n,) int64 flat indices."""
        nx, ny = self.shape
        along = -(-ny // self.side)
        corner = np.stack(np.divmod(self.squares[chosen], along)) * self.side
        low = corner - margin
        high = np.minimum(corner + self.side, np.array([[nx], [ny]])) + margin
        if not self.periodic:
            low, high = np.maximum(low, 0), np.minimum(high, np.array([[nx], [ny]]))
        high = np.minimum(high, low + np.array([[nx], [ny]]))  # once around at most
        rows = np.arange(int((high - low)[0].max(initial=0)))
        inside = low[0][:, None] + rows < high[0][:, None]
        row = ((low[0][:, None] + rows) % nx)[inside]
        left, right = (np.broadcast_to(side[:, None], inside.shape)[inside] for side in (low[1], high[1]))
        # what reaches over an edge goes on at the other
        pieces = [(np.maximum(left, 0), np.minimum(right, ny)), (left + ny, np.full_like(left, ny))]
        pieces += [(np.zeros_like(right), right - ny)]
        found = [self._between(row, begin, end) for begin, end in pieces]
        return self.sites[np.unique(np.concatenate(found))]

    def _between(self, row: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Positions of the sites in rows ``row`` from column ``begin`` to before ``end``, where that is not empty."""
        some = end > np.maximum(begin, 0)
        first, last = (np.searchsorted(self.sites, row[some] * self.shape[1] + edge[some]) for edge in (begin, end))
        lengths = last - first
        steps = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return np.repeat(first, lengths) + steps


def fitting(side: int, shape: tuple[int, int]) -> None:
    """Refuse windows larger than the grid of sites."""
    if side > min(shape):
        raise InputError.of(
            "window", side, f"is larger than the contact of {shape[0]} x {shape[1]} sites", "take a smaller window"
        )


def square_of(sites: np.ndarray, shape: tuple[int, int], side: int) -> np.ndarray:
    """The square that each site lies in: (n,) int64, row by row."""
    row, column = np.divmod(sites, shape[1])
    return row // side * -(-shape[1] // side) + column // side
