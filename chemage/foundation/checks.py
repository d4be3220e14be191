"""Validation of the arguments that users pass to stages: type, load, temperature, seed, hold times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage.foundation.errors import InputError, shortened
from chemage.foundation.units import convert

#: what users give as a seed: a whole number, or one of numpy's seed sequences
Seed = int | np.random.SeedSequence


def expect(name: str, value: object, kind: type, remedy: str) -> None:
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        given = f"{shortened(repr(value))} ({type(value).__name__})"
        raise InputError(f"{name} must be {article} {kind.__name__}, got {given}; {remedy}")


def force(load: float | str) -> float:
    """``load`` in nN, finite and ≥ 0."""
    value = convert(load, "nN")
    if not np.isfinite(value) or value < 0:
        raise InputError.of("load", load, "must be finite and not negative", "give a force such as 20 uN")
    return value


def temperature_value(temperature: float | str) -> float:
    """``temperature`` in K, finite and > 0."""
    value = convert(temperature, "K")
    if not np.isfinite(value) or value <= 0:
        raise InputError.of("temperature", temperature, "must be finite and above zero", "give kelvin, such as 300 K")
    return value


def checked_seed(seed: Any) -> int:
    """``seed`` as a non-negative int."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError.of("seed", seed, "must be a whole number, 0 or larger")
    return int(seed)


def check_times(hold_times: Sequence[float] | np.ndarray) -> np.ndarray:
    """``hold_times`` as (m,) float64, non-decreasing, finite, ≥ 0, m ≥ 1."""
    try:
        times = np.array(hold_times, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise InputError.of("hold_times", hold_times, "not a list of numbers", "give seconds") from None
    if times.ndim != 1 or times.size == 0:
        raise InputError.of("hold_times", times.shape, "must be a list with at least one time", "give seconds")
    bad = np.flatnonzero(~np.isfinite(times) | (times < 0))
    if bad.size:
        raise InputError.of(
            f"hold_times[{bad[0]}]",
            float(times[bad[0]]),
            "must be finite and not negative",
            "give seconds since the contact was made",
        )
    falls = np.flatnonzero(np.diff(times) < 0)
    if falls.size:
        at = int(falls[0]) + 1
        raise InputError.of(
            f"hold_times[{at}]", float(times[at]), f"comes after {float(times[at - 1])}", "sort the hold times"
        )
    return times
