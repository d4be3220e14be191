"""The random numbers of each replica, and its state on disk."""

from __future__ import annotations

import json
import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation import container
from chemage.foundation.checks import (
    Seed,
    checked_seed,
)
from chemage.foundation.errors import (
    AbsentError,
    DamagedError,
    InputError,
    StoreError,
)
from chemage.foundation.random import CommonSeed
from chemage.foundation.records import Record, content_hash
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine, run_kinetics
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.site_grid import site_shape
from chemage.plugins.context import Plugins, note_changes
from chemage.plugins.sources import changed, implementing, would_change

#: the random numbers that replica r of every run with one seed has in common
Common = Literal["none", "disorder", "all"]
#: `Common` -> what it means, for users
COMMON: dict[str, str] = {
    "none": "independent of runs with another contact, chemistry, temperature or engine",
    "disorder": "disorder in common with runs of this seed, kinetic noise independent",
    "all": "disorder and kinetic noise in common with runs of this seed",
}

#: The contact is recognised by the load on so many blocks of pixels along each side, ...
BLOCKS = 16
#: ... each rounded to this part of the load, coarse enough that the last bits of a processor hardly ever matter.
SHARE = 1e-3


class ReplicaSeeds(NamedTuple):
    """Seeds of one replica."""

    disorder: np.random.SeedSequence
    noise: np.random.SeedSequence


def replica_seeds(
    seed: Seed, replica: int, common: Common, run: tuple[int, ...]
) -> ReplicaSeeds:
    """Seeds of a replica's disorder and of its kinetics: functions of the arguments alone.

    Parameters
    ----------
    seed, replica
        The seed of the run, and the number of the replica from 0.
    common
        What replica ``replica`` of every run with this seed has in common.
    run
        What is simulated, see :func:`identity`.
    """
    if isinstance(seed, np.random.SeedSequence):
        entropy, path = seed.entropy, tuple(seed.spawn_key)
    else:
        entropy, path = checked_seed(seed), ()
    disorder = np.random.SeedSequence(
        entropy, spawn_key=(*path, *(run if common == "none" else ()), replica, 0)
    )
    if common == "all":
        return ReplicaSeeds(
            disorder, CommonSeed(entropy, spawn_key=(*path, replica, 1))
        )
    return ReplicaSeeds(
        disorder,
        np.random.SeedSequence(entropy, spawn_key=(*path, *run, replica, 1)),
    )


def identity(
    contact: ContactSolution,
    chemistry: Chemistry,
    engine: Engine,
    temperature: float,
) -> tuple[int, ...]:
    """Four 32-bit words that differ between runs that simulate different things.

    Of the contact enter its grid, that of the sites where it is another, its load, and how the pressure is distributed
    over it; of the chemistry what decides the bonds; of the engine its kind. Options that only change the speed do not
    enter, nor do the hold times.
    """
    chemical = chemistry.identity()
    for name in ("bond_force", "front_factor", "site_density"):
        chemical.pop(name, None)
    sites = site_shape(contact.shape, contact.pixel_size, chemistry.site_density)
    content = [
        contact.shape,
        f"{contact.pixel_size:.9g} {contact.load:.9g} {contact.modulus:.9g}",
        _distribution(contact.pressure),
        chemical,
        engine.kind,
        temperature,
        *([sites] if sites != contact.shape else []),
    ]
    return tuple(
        int(word)
        for word in np.frombuffer(bytes.fromhex(content_hash(content)), "<u4")
    )


def _distribution(pressure: np.ndarray) -> list[int]:
    """The share of the load on each block of pixels, and the mean pressure that the load sees, rounded; tension counts
    as pressure."""
    pressure = np.abs(pressure)
    rows, columns = (
        np.unique(np.arange(BLOCKS) * side // BLOCKS) for side in pressure.shape
    )
    sums = np.add.reduceat(
        np.add.reduceat(pressure, rows, axis=0, dtype=np.float64), columns, axis=1
    )
    total = float(sums.sum())
    if not total > 0:
        return []
    seen = float(np.einsum("ij,ij->", pressure, pressure, dtype=np.float64)) / total
    return [
        *np.rint(sums.ravel() / (SHARE * total)).astype(int).tolist(),
        round(math.log(seen) / SHARE),
    ]


def origin(seed: Seed) -> list[object]:
    """A seed as plain JSON values, equal for equal seeds only."""
    if isinstance(seed, np.random.SeedSequence):
        return [
            isinstance(seed, CommonSeed),
            str(seed.entropy),
            list(seed.spawn_key),
        ]
    return [int(seed)]


_R = TypeVar("_R", bound=Record)


class CheckpointWarning(UserWarning):
    """A checkpoint is computed again."""


def again(why: str) -> None:
    """Warn that a checkpoint is computed again."""
    warnings.warn(why, CheckpointWarning, stacklevel=3)


@dataclass(frozen=True)
class Checkpoint(Generic[_R]):
    """A file in which what a stage makes is kept, by which an interrupted run goes on."""

    path: Path
    kind: type[_R]
    #: of all that it depends on
    key: str
    #: of the options alone
    run: str
    #: plugins that took part in the stages before
    before: Mapping[str, str]
    #: those of the stage, its own the last
    hooks: Sequence[str] = ("chemage_run_kinetics",)
    #: of the object in the file
    name: str = "history"
    #: what is said where the file is that of another run
    other: str = ""

    def read(self, **arguments: Any) -> _R | None:
        """What was written with this key; None if nothing is there.

        It is None as well, with a warning, if the plugins in use now would not make the same object: one that took part
        has another version, one that was not asked then would answer or change the hook of the stage when called with
        ``arguments``, or others took part in the stages before.

        Raises
        ------
        StoreError
            The file was kept for another run, or with another key although the same plugins took part before.
        """
        try:
            records, attributes = container.read(
                self.path, {self.name: self.kind}, links=False
            )
        except AbsentError:
            return None
        except DamagedError as error:
            again(f"{error}; it is computed again")
            return None
        record = records.get(self.name)
        earlier = json.loads(attributes.get("before", "{}"))
        of_this_run = attributes.get("run") == self.run and (
            earlier != self.before or attributes.get("checkpoint") == self.key
        )
        if not of_this_run or not isinstance(record, self.kind):
            where = f"{self.path} is the checkpoint of another run; remove it, or choose another folder"
            raise StoreError(self.other or where)
        reasons = []
        if earlier != self.before:
            then, now = (
                ", ".join(f"{name} ({source})" for name, source in plugins.items())
                or "no plugin"
                for plugins in (earlier, self.before)
            )
            reasons.append(f"{then} took part in the stages before, and now {now}")
        reasons += [
            f"{plugin} was {then} and is {now}"
            for plugin, (then, now) in changed(record.plugins).items()
        ]
        asked = json.loads(attributes.get("asked", "{}"))
        new = [
            plugin
            for plugin, source in implementing(*self.hooks).items()
            if asked.get(plugin) != source
        ]
        if (
            not reasons
            and new
            and would_change(new, self.hooks[-1], record, **arguments)
        ):
            reasons = [f"{', '.join(new)} would answer or change it"]
        if reasons:
            again(f"{self.path} is computed again: {'; '.join(reasons)}")
            return None
        for plugin, changes in record.changes.items():
            note_changes(plugin, changes)
        return record

    def write(self, record: _R) -> None:
        """Write ``record`` in place of what was kept before."""
        attributes = {
            "checkpoint": self.key,
            "run": self.run,
            "asked": json.dumps(implementing(*self.hooks)),
            "before": json.dumps(dict(self.before)),
        }
        container.write(self.path, {self.name: record}, attributes, force=True)

    def kept(self, make: Callable[[], _R], **arguments: Any) -> _R:
        """What was written, or else what ``make`` gives, which is written."""
        record = self.read(**arguments)
        if record is None:
            record = make()
            self.write(record)
        return record


#: s between two checkpoints of a replica
KEPT_EVERY = 60.0


def run_with_checkpoints(
    engine: Engine,
    lattice: ReactionLattice,
    times: np.ndarray,
    *,
    path: Path,
    run: str,
    before: Plugins,
    seed: Seed,
    states: bool,
    **how: Any,
) -> BondHistory:
    """One replica, written to ``path`` about every minute and at its end, and resumed if it is there.

    ``run`` is a key of the options of the whole run, ``before`` the plugins that took part in the stages before, ``how``
    further arguments of :func:`chemage.plugin.run_kinetics`. With ``states`` the history has the state of every site at
    every hold time; a checkpoint without them is computed again.

    Raises
    ------
    InputError
        The engine cannot resume from a history.
    StoreError
        ``path`` holds the checkpoint of another run, or cannot be written.
    """
    if not engine.restart:
        raise InputError(
            f"engine {engine.kind!r} cannot resume from a history; run it without checkpoints"
        )
    how["seed"] = seed
    depends = engine.digest(), lattice.digest(), times.tolist()
    key = content_hash([*depends, how["temperature"], origin(seed)])
    file = Checkpoint(path, BondHistory, key, run, before)
    call = {"engine": engine, "lattice": lattice, "hold_times": times, **how}
    done = file.read(**call, start=None, ramp=None)
    if done is not None and not states:
        done = done.model_copy(update={"states": None})
    elif done is not None and done.states is None:
        problem = "it was kept without the states at every hold time"
        again(f"{path} is computed again: {problem}")
        done = None
    at = 0 if done is None else done.hold_times.size
    piece = 1
    written = time.monotonic()
    while at < times.size:
        begin = time.monotonic()
        call["hold_times"] = times[at : at + piece]
        history = run_kinetics(**call, start=done, states=states)
        done = history if done is None else done.then(history)
        at += piece
        now = time.monotonic()
        # short pieces are joined, so that restarting the engine stays a small part of the work
        piece = piece * 2 if now - begin < KEPT_EVERY / 8 else max(1, piece // 2)
        if now - written > KEPT_EVERY or at >= times.size:
            file.write(done)
            written = time.monotonic()
    assert done is not None
    return done
