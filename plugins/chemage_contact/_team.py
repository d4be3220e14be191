"""Threads that share out the blocks and rows of a kernel. What they compute does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels

Array = NDArray[Any]

#: Blocks or rows, live ones where that matters, below which waking another thread takes longer than the work.
FEW = 512
#: Cost of a live block over that of one that is skipped.
LIVE_COST = 16


class Team:
    """Runs a kernel on a few threads, the calling one among them; the kernels release the interpreter lock."""

    def __init__(self, threads: int) -> None:
        self.threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def even(self, count: int) -> list[int]:
        """Edges of about equal shares of ``count`` rows; a single share where that is few."""
        shares = 1 if count < FEW else self.threads
        return [count * k // shares for k in range(shares + 1)]

    def run(self, kernel: Callable[..., None], share: int | Sequence[int], *args: Any) -> None:
        """Call ``kernel(lo, hi, *args)`` so that the ranges cover 0 … ``share``, or between the edges given."""
        edges = self.even(share) if isinstance(share, int) else share
        first, *others = pairwise(edges)
        jobs = [self._pool.submit(kernel, *part, *args) for part in others] if self._pool is not None else []
        kernel(*first, *args)
        for job in jobs:
            job.result()

    def table(self, kernel: Callable[..., None], rows: int, columns: int, *args: Any) -> Array:
        """What ``kernel(lo, hi, *args, part)`` notes for each row, (rows, columns) float64."""
        part = np.zeros((rows, columns))
        self.run(kernel, rows, *args, part)
        return part


class Live:
    """Which blocks take part in an iteration, and shares of blocks, rows and coarse rows with as many of them each.

    ``mask`` (rows · per_row,) uint8, block by block.
    """

    def __init__(self, mask: Array, per_row: int, threads: int) -> None:
        self.mask = mask
        rows = mask.size // per_row
        shares = 1 if np.count_nonzero(mask) < FEW else threads
        done = np.concatenate([[0], np.cumsum(1 + LIVE_COST * mask.astype(np.int64))])
        goals = done[-1] * np.arange(1, shares) // shares
        self.blocks = [0, *(int(b) for b in np.searchsorted(done, goals)), mask.size]
        self.rows = [0, *(int(r) for r in np.searchsorted(done[::per_row], goals)), rows]
        self.coarse = [edge // kernels.RATIO for edge in self.rows]
