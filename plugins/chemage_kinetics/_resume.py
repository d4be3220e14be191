"""The pending events of a history, checked before a kernel uses them as positions and counts.

A history may come from a file or be made by hand. What a run of the same engine on the same lattice can have left
behind passes; anything else is refused here, where it can be named, because compiled code does not check positions.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from chemage import InputError
from chemage.plugin import BondHistory
from chemage_kinetics._common import Model
from chemage_kinetics._rate_classes import CLASSES, PER_KT, octaves_of

#: Counters of random numbers end here, with room for what is added to them and multiplied by `SOJOURN_DRAWS`.
MOST_COUNTED = 2**61
MOST_DRAWS = 2**50
#: The second part of a time is at most this fraction of the first.
ROUNDING = 2.0**-52


class Pending:
    """The arrays in ``BondHistory.resume``, each returned as it is if it can be right.

    Every method raises :class:`chemage.InputError` otherwise.
    """

    def __init__(self, start: BondHistory, sites: int) -> None:
        self._start, self._sites = start, sites

    def __contains__(self, name: str) -> bool:
        return name in self._start.resume

    def _wrong(self, name: str, problem: str) -> NoReturn:
        raise InputError(
            f"start: resume[{name!r}] {problem}; resume from a history as the engine gave it, or pass its state alone"
        )

    def _array(self, name: str, dtype: type[np.generic], shape: tuple[int, ...] | None) -> np.ndarray:
        array = self._start.resume.get(name)
        if array is None:
            self._wrong(name, "is missing")
        if array.dtype != dtype or (array.shape != shape if shape is not None else array.ndim != 1):
            expected = "one-dimensional" if shape is None else f"of shape {shape}"
            self._wrong(
                name, f"is {array.dtype} of shape {array.shape}, but should be {np.dtype(dtype).name} {expected}"
            )
        return array

    def count(self, name: str) -> int:
        """A counter of random numbers, ≥ 0."""
        value = int(self._array(name, np.int64, (1,))[0])
        if not 0 <= value <= MOST_COUNTED:
            self._wrong(name, f"is {value}, but should be from 0 to {MOST_COUNTED}")
        return value

    def site(self, name: str) -> int:
        """A site, or -1."""
        value = int(self._array(name, np.int64, (1,))[0])
        if not -1 <= value < self._sites:
            self._wrong(name, f"is {value}, but should be from -1 to {self._sites - 1}")
        return value

    def clock(self, name: str) -> np.ndarray:
        """(2,) float64 s: the time of the last event, not after the end of the history."""
        array = self._array(name, np.float64, (2,))
        high, low = float(array[0]), float(array[1])
        if not (0 <= high <= self._start.time and abs(low) <= ROUNDING * high):
            self._wrong(name, f"is {high} + {low} s, but should be from 0 to {self._start.time} s")
        return array

    def times(self, name: str) -> np.ndarray:
        """(n, 2) float64 s: pending times, not before the end of the history."""
        array = self._array(name, np.float64, (self._sites, 2))
        high, low = array[:, 0], array[:, 1]
        # also false for nan
        if not (np.all(high >= self._start.time) and np.all(np.abs(low) <= ROUNDING * np.minimum(high, 1e300))):
            self._wrong(name, f"has times that are not after {self._start.time} s")
        return array

    def draws(self, name: str) -> np.ndarray:
        """(n,) int64: random numbers used by each site."""
        array = self._array(name, np.int64, (self._sites,))
        if array.size and (int(array.min()) < 0 or int(array.max()) > MOST_DRAWS):
            self._wrong(name, f"is from {array.min()} to {array.max()}, but should be from 0 to {MOST_DRAWS}")
        return array

    def chosen(self, name: str, most: int) -> np.ndarray:
        """Up to ``most`` different sites, (h,) int64."""
        array = self._array(name, np.int64, None)
        if array.size > most:
            self._wrong(name, f"lists {array.size} sites, but there can be {most}")
        if array.size and not (int(array.min()) >= 0 and int(array.max()) < self._sites):
            self._wrong(name, f"has sites from {array.min()} to {array.max()}, but there are {self._sites}")
        if np.unique(array).size != array.size:
            self._wrong(name, "lists a site twice")
        return array

    def members(self, words: np.ndarray, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """All sites by class, (n,) int32, and how many each class has, (CLASSES,) int64.

        Each site must be in a class whose bound is not below its rate, see `_rate_classes`.
        """
        counts, order = self._array("counts", np.int64, (CLASSES,)), self._array("members", np.int32, (self._sites,))
        listed = int(np.minimum(counts, self._sites + 1).sum())
        if int(counts.min()) < 0 or listed > self._sites:
            self._wrong("counts", f"counts {listed} sites, but there are {self._sites}")
        if order.size and not (int(order.min()) >= 0 and int(order.max()) < self._sites):
            self._wrong("members", f"has sites from {order.min()} to {order.max()}, but there are {self._sites}")
        there = np.zeros(self._sites, np.bool_)
        there[order] = True
        if not there.all():
            self._wrong("members", "does not list every site once")
        octaves = octaves_of(words, model.breaking, model.per_unit * PER_KT)[order]
        bounds = np.repeat(np.arange(CLASSES, dtype=np.float64), counts)
        if np.any(octaves[:listed] < bounds) or np.any(octaves[listed:] < CLASSES - 1.0):
            self._wrong("members", "has a site in a class of smaller rates than its own")
        return order, counts
