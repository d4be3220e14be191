"""Checkpoints of long runs: the history of a replica is written to disk now and then, and a later call resumes it.

A run resumed from a history equals the uninterrupted run bit for bit (engines with ``restart``), so a run cut into
pieces gives the same bytes as one that was not.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from chemage.ageing.seeds import origin
from chemage.contacts.solution import ContactSolution
from chemage.foundation import container
from chemage.foundation.checks import Seed, check_times, temperature_value
from chemage.foundation.errors import DamagedError, InputError, StoreError
from chemage.foundation.records import Record, content_hash
from chemage.foundation.units import QuantityLike
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.kinetics.stage import run_kinetics
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins.context import Plugins
from chemage.plugins.sources import changed, implementing, would_change

_R = TypeVar("_R", bound=Record)
_HOOKS = ("chemage_run_kinetics",)


class CheckpointWarning(UserWarning):
    """A checkpoint is computed again."""


def resumed(
    path: Path,
    name: str,
    kind: type[_R],
    key: str,
    other: str,
    *,
    run: str,
    before: Plugins,
    hooks: Sequence[str],
    **arguments: Any,
) -> _R | None:
    """The object ``name`` that :func:`keep` wrote to ``path`` under ``key``; None if nothing is there.

    It is None as well, with a warning, if the plugins in use now would not make the same object: one that took part
    has another version, one that was not asked then would answer or change the last of ``hooks``, which are those of
    the stage, when called with ``arguments``, or others took part in the stages ``before``.

    Raises
    ------
    StoreError
        With the message ``other``: the file was kept for another ``run`` (a key of its options alone), or under another
        key although the same plugins took part before.
    """
    if not path.exists():
        return None
    try:
        records, attributes = container.read(path, {name: kind})
    except DamagedError as error:
        warnings.warn(f"{error}; it is computed again", CheckpointWarning, stacklevel=2)
        return None
    record = records.get(name)
    earlier = json.loads(attributes.get("before", "{}"))
    of_this_run = attributes.get("run") == run and (earlier != before or attributes.get("checkpoint") == key)
    if not of_this_run or not isinstance(record, kind):
        raise StoreError(other)
    reasons = []
    if earlier != before:
        reasons.append(f"{_listed(earlier)} took part in the stages before, and now {_listed(before)}")
    reasons += [f"{plugin} was {then} and is {now}" for plugin, (then, now) in changed(record.plugins).items()]
    asked = json.loads(attributes.get("asked", "{}"))
    new = [plugin for plugin, source in implementing(*hooks).items() if asked.get(plugin) != source]
    if not reasons and new and would_change(new, hooks[-1], record, **arguments):
        reasons = [f"{', '.join(new)} would answer or change it"]
    if reasons:
        warnings.warn(f"{path} is computed again: {'; '.join(reasons)}", CheckpointWarning, stacklevel=2)
        return None
    return record


def keep(path: Path, name: str, record: Record, key: str, *, run: str, before: Plugins, hooks: Sequence[str]) -> None:
    """Write ``record`` to ``path``, in place of what was kept there before; arguments as for :func:`resumed`."""
    plugins = {"asked": json.dumps(implementing(*hooks)), "before": json.dumps(dict(before))}
    container.write(path, {name: record}, {"checkpoint": key, "run": run, **plugins}, force=True)


def _listed(plugins: Plugins) -> str:
    return ", ".join(f"{name} ({source})" for name, source in plugins.items()) or "no plugin"


def run_with_checkpoints(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    *,
    temperature: QuantityLike,
    seed: Seed,
    path: Path,
    run: str = "",
    before: Plugins | None = None,
    every: float = 60.0,
    states: bool = False,
    contact: ContactSolution | None = None,
    chemistry: Chemistry | None = None,
) -> BondHistory:
    """One replica, written to ``path`` about every ``every`` seconds and at its end, and resumed if it is there.

    ``run`` is a key of the options of the whole run, ``before`` the plugins that took part in the stages before;
    ``contact`` and ``chemistry`` are for plugins. With ``states`` the history has the state of every site at every hold
    time; a checkpoint without them is computed again.

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
    other = f"{path} is the checkpoint of another run; remove it, or choose another folder"
    plugins = before or {}
    origins = {"contact": contact, "chemistry": chemistry}
    call = {"engine": engine, "lattice": lattice, "hold_times": times, "temperature": kelvin, "seed": seed, **origins}
    done = resumed(path, "history", BondHistory, key, other, run=run, before=plugins, hooks=_HOOKS, **call, start=None)
    if done is not None and states and done.states is None:
        problem = "it was kept without the states at every hold time"
        warnings.warn(f"{path} is computed again: {problem}", CheckpointWarning, stacklevel=2)
        done = None
    elif done is not None and not states and done.states is not None:
        done = done.model_copy(update={"states": None})
    at = 0 if done is None else done.hold_times.size
    piece = 1
    written = time.monotonic()
    while at < times.size:
        begin = time.monotonic()
        history = run_kinetics(
            engine, lattice, times[at : at + piece], temperature=kelvin, seed=seed, start=done, states=states, **origins
        )
        done = history if done is None else done.then(history)
        at += piece
        now = time.monotonic()
        # short pieces are joined, so that restarting the engine stays a small part of the work
        piece = piece * 2 if now - begin < every / 8 else max(1, piece // 2)
        if now - written > every or at >= times.size:
            keep(path, "history", done, key, run=run, before=plugins, hooks=_HOOKS)
            written = time.monotonic()
    assert done is not None
    return done


def _key(engine: Engine, lattice: ReactionLattice, times: np.ndarray, temperature: float, seed: Seed) -> str:
    return content_hash([engine.digest(), lattice.digest(), times.tolist(), temperature, origin(seed)])
