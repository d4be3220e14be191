"""Threads that share the blocks and rows of a kernel. The results do not depend on the number of threads."""

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

#: Numbers of rows, and of pixels in active blocks, below which waking another thread takes longer than the work or
#: gains nothing.
FEW, FEW_PIXELS = 700, 1 << 19
#: Cost of an active block relative to that of one that is skipped.
ACTIVE_COST = 16


class Team:
    """Runs a kernel on a few threads, including the calling one; the kernels release the interpreter lock."""

    def __init__(self, threads: int) -> None:
        self.threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def even(self, count: int) -> list[int]:
        """Edges of about equal shares of ``count`` rows; a single share if the rows are few."""
        shares = 1 if count < FEW else self.threads
        return [count * k // shares for k in range(shares + 1)]

    def run(self, kernel: Callable[..., None], share: int | Sequence[int], *args: Any) -> None:
        """Call ``kernel(lo, hi, *args)`` so that the ranges cover 0 … ``share``, or between the edges given."""
        edges = self.even(share) if isinstance(share, int) else share
        if len(edges) == 2:
            kernel(edges[0], edges[1], *args)
            return
        first, *others = pairwise(edges)
        jobs = [self._pool.submit(kernel, *part, *args) for part in others] if self._pool is not None else []
        kernel(*first, *args)
        for job in jobs:
            job.result()

    def table(self, kernel: Callable[..., None], rows: int, columns: int, *args: Any) -> Array:
        """The table (rows, columns) float64 that ``kernel(lo, hi, *args, part)`` fills row by row."""
        part = np.zeros((rows, columns))
        self.run(kernel, rows, *args, part)
        return part


class Active:
    """The active blocks of an iteration, and ranges of blocks, rows and coarse rows of about equal work per thread.

    ``mask`` (rows · per_row,) bool or uint8, block by block; ``width`` pixels per block.
    """

    def __init__(self, mask: Array, width: int, per_row: int, threads: int) -> None:
        mask = mask.astype(np.uint8)
        #: as the kernels take them
        self.blocks = kernels.Blocks(width, per_row, mask)
        rows = mask.size // per_row
        shares = 1 if np.count_nonzero(mask) * width < FEW_PIXELS else threads
        self.block_edges, self.row_edges = [0, mask.size], [0, rows]
        self.coarse_edges = [0, rows // kernels.RATIO]
        if shares == 1:
            return
        done = np.concatenate([np.zeros(1, np.int64), np.cumsum(1 + ACTIVE_COST * mask.astype(np.int64))])
        goals = done[-1] * np.arange(1, shares) // shares
        self.block_edges = [0, *(int(b) for b in np.searchsorted(done, goals)), mask.size]
        self.row_edges = [0, *(int(r) for r in np.searchsorted(done[::per_row], goals)), rows]
        self.coarse_edges = [edge // kernels.RATIO for edge in self.row_edges]
