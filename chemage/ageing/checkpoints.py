"""Checkpoints of long runs: the history of a replica is written to disk now and then, and a later call resumes it.

A run resumed from a history equals the uninterrupted run bit for bit (engines with ``restart``), so a run cut into
pieces gives the same bytes as one that was not.
"""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import TypeVar

import numpy as np

from chemage.ageing.seeds import origin
from chemage.foundation.checks import Seed, check_times, temperature_value
from chemage.foundation.codec import read_records, write_records
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.records import Record
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.kinetics.stage import run_kinetics
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry

_Kept = TypeVar("_Kept", bound=Record)


def resumed(path: Path, name: str, kind: type[_Kept], key: str, other: str) -> _Kept | None:
    """The object ``name`` that :func:`keep` wrote to ``path`` under ``key``; None if nothing is there.

    Raises
    ------
    StoreError
        With the message ``other``: the file was kept under another key.
    """
    if not path.exists():
        return None
    records, attributes = read_records(path, {name: kind})
    found = records.get(name)
    if attributes.get("checkpoint") != key or not isinstance(found, kind):
        raise StoreError(other)
    return found


def keep(path: Path, name: str, thing: Record, key: str) -> None:
    """Write ``thing`` to ``path``, in place of what was kept there before."""
    write_records(path, {name: thing}, {"checkpoint": key}, force=True)


def run_with_checkpoints(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    *,
    temperature: float | str,
    seed: Seed,
    path: Path,
    every: float = 60.0,
) -> BondHistory:
    """One replica, written to ``path`` about every ``every`` seconds and at its end, and resumed if it is there.

    Raises
    ------
    InputError
        The engine cannot resume from a history.
    StoreError
        ``path`` holds the checkpoint of another run, or cannot be written.
    """
    if not engine.restart:
        raise InputError(f"engine {engine.kind!r} cannot resume from a history; run it without checkpoints")
    times, kelvin = check_times(hold_times), temperature_value(temperature)
    key = _key(engine, lattice, times, kelvin, seed)
    other = f"{path} is the checkpoint of another run (or of other plugins); remove it, or choose another folder"
    done = resumed(path, "history", BondHistory, key, other)
    at = 0 if done is None else done.hold_times.size
    piece = 1
    written = time.monotonic()
    while at < times.size:
        begin = time.monotonic()
        history = run_kinetics(engine, lattice, times[at : at + piece], temperature=kelvin, seed=seed, start=done)
        done = history if done is None else done.then(history)
        at += piece
        now = time.monotonic()
        # short pieces are joined, so that restarting the engine stays a small part of the work
        piece = piece * 2 if now - begin < every / 8 else max(1, piece // 2)
        if now - written > every or at >= times.size:
            keep(path, "history", done, key)
            written = time.monotonic()
    assert done is not None
    return done


def _key(engine: Engine, lattice: ReactionLattice, times: np.ndarray, temperature: float, seed: Seed) -> str:
    plugins = registry.current().implementing("chemage_run_kinetics")
    content = [engine.digest(), lattice.digest(), times.tolist(), temperature, origin(seed), plugins]
    return hashlib.blake2b(json.dumps(content).encode(), digest_size=16).hexdigest()
