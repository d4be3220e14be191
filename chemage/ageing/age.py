"""The stage of ageing: every replica draws its disorder and runs its kinetics, several replicas at a time."""

from __future__ import annotations

import contextvars
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.checkpoints import run_with_checkpoints
from chemage.ageing.elasticity import compared
from chemage.ageing.measuring import Seen, check_outputs, measure, stacked
from chemage.ageing.observables import Observable
from chemage.ageing.seeds import Common, check_common, identity, origin, replica_seeds
from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, check_times, checked_count, checked_seed, expect, temperature_value
from chemage.foundation.errors import InputError
from chemage.foundation.hashes import content_hash
from chemage.foundation.memory import require
from chemage.foundation.threads import available
from chemage.friction.bonded import Bonded
from chemage.friction.role import Rupture
from chemage.friction.stage import rupture_bonds
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.kinetics.stage import cannot_give_states, run_kinetics
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.stage import build_lattice
from chemage.plugins.participation import Plugins
from chemage.plugins.sources import approximations, components_in


def age(
    contact: ContactSolution,
    chemistry: Chemistry,
    *,
    engine: Engine,
    hold_times: Sequence[float] | np.ndarray,
    temperature: float | str,
    replicas: int = 10,
    seed: Seed = 0,
    common: Common = "none",
    rupture: Rupture | None = None,
    observe: Sequence[Observable] = (),
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    checkpoints: Path | None = None,
) -> Aging:
    """Age a contact: ``replicas`` times draw the disorder, run the kinetics to every hold time, count the bonds.

    Parameters
    ----------
    contact, chemistry, engine
        The contact, what reacts on it, and the engine that follows it.
    hold_times
        (m,) seconds, non-decreasing; see :func:`chemage.hold_times`.
    temperature
        Kelvin, or a string with its unit.
    replicas
        Each redraws barriers, couplings, hydroxylation and the kinetic noise on the same contact.
    seed
        Replica r does not depend on how many replicas or threads there are.
    common
        What replica r has in common with replica r of other runs with the same ``seed``. ``"none"``: nothing, so that
        runs on different contacts, at other temperatures, with another chemistry or engine are independent samples;
        ``"disorder"``: barriers, couplings and hydroxylation of the pixels that are in contact in both; ``"all"``: the
        kinetic noise as well. With the last two, the difference between two runs has a smaller error, which is that of
        the differences replica by replica.
    rupture
        The law that turns bonds into friction; default: the mean force per bond and the front factor of ``chemistry``.
    observe
        Further measurements on each replica, kept in ``Aging.observables``.
    threads
        Threads that run replicas at the same time; default: one per processor. Results do not depend on it.
    progress
        Called with (replicas done, replicas in all).
    checkpoints
        A folder in which every replica is kept while it runs; an interrupted call resumes, with equal results.
    """
    _check(contact, chemistry, engine, rupture, observe, common, replicas, seed, threads)
    states = wants_states(engine, rupture, observe)
    sites = chemistry.sites_of(contact)
    times, kelvin = _check_run(hold_times, temperature, replicas, checkpoints, progress)
    run = identity(contact, chemistry, engine, kelvin)
    options = content_hash([engine.digest(), chemistry.digest(), times.tolist(), kelvin, origin(seed), common])

    def replica(number: int) -> _Replica:
        disorder, noise = replica_seeds(seed, number, common, run)
        lattice = build_lattice(chemistry, contact, disorder)
        call: dict[str, Any] = {"temperature": kelvin, "seed": noise, "states": states}
        call |= {"contact": contact, "chemistry": chemistry}
        if checkpoints is None:
            history = run_kinetics(engine, lattice, times, **call)
        else:
            place = {"path": checkpoints / f"replica-{number:05d}.h5", "before": contact.plugins | lattice.plugins}
            history = run_with_checkpoints(engine, lattice, times, run=options, **place, **call)
        return _finished(contact, chemistry, lattice, history, rupture, observe)

    # threads inside a run take their processors away from the other replicas
    at_once = max(1, min(replicas, (threads or available()) // engine.concurrency()))
    done = list(_in_order(replica, replicas, at_once, progress))
    provenance = {
        "chemistry": {name: value for name, value in chemistry.todict().items() if name not in chemistry.limits},
        "engine": engine.todict(),
        "seed": str(seed),
        "common": common,
        "contact": contact.provenance,
        **({} if sites.rule == "pixels" else {"sites": sites.describe(contact)}),
        **({} if rupture is None else {"rupture": rupture.todict()}),
        **({"observe": [one.todict() for one in observe]} if observe else {}),
    }
    return _aging(contact, chemistry, done, times, kelvin, provenance)


def wants_states(engine: Engine, rupture: Rupture | None, observe: Sequence[Observable]) -> bool:
    """Whether the rupture law or an observable asks for the state of every site at every hold time.

    Raises
    ------
    InputError
        The engine cannot give them; names what asks for them.
    """
    asking = [
        f"{one.role} {one.kind!r}"
        for one in components_in([rupture, *observe])
        if isinstance(one, Rupture | Observable) and one.states
    ]
    if asking and not engine.restart:
        raise InputError(f"{', '.join(asking)} asks for the states: {cannot_give_states(engine)}")
    return bool(asking)


def _finished(
    contact: ContactSolution,
    chemistry: Chemistry,
    lattice: ReactionLattice,
    history: BondHistory,
    rupture: Rupture | None,
    observe: Sequence[Observable],
) -> _Replica:
    """Take the friction and the measurements from a finished replica."""
    force = rupture_bonds(Bonded(contact, chemistry, lattice, history), rupture)
    seen = measure(contact, lattice, history, observe)
    return _Replica(
        bonds=history.bonds,
        # the constant of the chemistry follows from the bonds, and is not stored
        force=force.force if rupture is not None or force.plugins else None,
        events=history.events,
        sites=lattice.sites.size,
        engine=history.engine,
        notes=history.notes,
        seen=seen,
        plugins=lattice.plugins | history.plugins | force.plugins | seen.plugins,
        approximate=[*lattice.approximate, *history.approximate, *force.approximate, *approximations(*observe)],
    )


def _forces(chemistry: Chemistry, done: Sequence[_Replica]) -> np.ndarray | None:
    """(replicas, m) nN where a rupture law or a plugin gave the force of a replica."""
    if all(one.force is None for one in done):
        return None
    mean = chemistry.bond_force * chemistry.front_factor
    return np.stack([one.bonds * mean if one.force is None else one.force for one in done])


def _aging(
    contact: ContactSolution,
    chemistry: Chemistry,
    done: Sequence[_Replica],
    hold_times: np.ndarray,
    temperature: float,
    provenance: dict[str, Any],
) -> Aging:
    plugins = {name: source for one in (contact, *done) for name, source in one.plugins.items()}
    approximate = [entry for one in (contact, *done) for entry in one.approximate]
    return Aging(
        hold_times=hold_times,
        bonds=np.stack([one.bonds for one in done]),
        sites=np.array([one.sites for one in done]),
        events=np.array([one.events for one in done]),
        load=contact.load,
        temperature=temperature,
        bond_force=chemistry.bond_force,
        front_factor=chemistry.front_factor,
        rupture_force=_forces(chemistry, done),
        engine=done[0].engine,
        notes=done[0].notes,
        contact=contact.summary(),
        elasticity=compared(contact, chemistry),
        observables=stacked([one.seen.values for one in done]),
        outputs={name: output.todict() for name, output in done[0].seen.outputs.items()},
        provenance=provenance,
    ).noting(plugins, approximate)


def _check(
    contact: Any,
    chemistry: Any,
    engine: Any,
    rupture: Any,
    observe: Sequence[Any],
    common: Any,
    replicas: Any,
    seed: Any,
    threads: Any,
) -> None:
    expect("contact", contact, ContactSolution, "make one with chemage.contact(...).solve(surface, load)")
    expect("chemistry", chemistry, Chemistry, "make one with chemage.chemistry(forming=...)")
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    if rupture is not None:
        expect("rupture", rupture, Rupture, 'make one with chemage.rupture("...")')
    if not isinstance(observe, list | tuple):
        raise InputError.of("observe", observe, "is no list", 'give a list of chemage.observable("barrier-spectrum")')
    for one in observe:
        expect("observe", one, Observable, 'give a list of chemage.observable("barrier-spectrum")')
    check_common(common)
    check_outputs(observe)
    checked_count("replicas", replicas)
    if not isinstance(seed, np.random.SeedSequence):
        checked_seed(seed)
    if threads is not None:
        checked_count("threads", threads)


def _check_run(
    hold_times: Any, temperature: Any, replicas: int, checkpoints: Any, progress: Any
) -> tuple[np.ndarray, float]:
    times = check_times(hold_times)
    remedy = "ask for fewer replicas, or for fewer hold times"
    require(kept_bytes(replicas, times.size), f"replicas = {replicas}", remedy)
    if checkpoints is not None and not isinstance(checkpoints, Path):
        raise InputError.of("checkpoints", checkpoints, "is no path", "give a pathlib.Path")
    if progress is not None and not callable(progress):
        raise InputError.of("progress", progress, "cannot be called", "give a function, or leave it out")
    return times, temperature_value(temperature)


def kept_bytes(replicas: int, hold_times: int) -> float:
    """Memory for the results of all replicas, twice, as they are joined at the end."""
    return replicas * (16.0 * hold_times + 500.0)


class _Replica(NamedTuple):
    """What is kept of a finished replica; its lattice and state are not, because they would fill the memory."""

    bonds: np.ndarray
    force: np.ndarray | None
    events: int
    sites: int
    engine: str
    notes: tuple[str, ...]
    seen: Seen
    plugins: Plugins
    approximate: list[dict[str, Any]]


def _in_order(
    task: Callable[[int], Any], count: int, threads: int, progress: Callable[[int, int], None] | None
) -> Iterator[Any]:
    """Results of ``task(0 … count−1)`` in that order; the first failure stops the rest."""
    if threads == 1:
        for number in range(count):
            yield task(number)
            if progress:
                progress(number + 1, count)
        return
    pool = ThreadPoolExecutor(threads, thread_name_prefix="chemage-replica")
    try:
        running: dict[Future[Any], int] = {}
        results: dict[int, Any] = {}
        begun = given = 0
        while given < count:
            # one more for each thread, so that none waits; not all, because there may be 10^9
            while begun < count and len(running) < 2 * threads:
                # options of plugins are context variables, which the threads would not see
                running[pool.submit(contextvars.copy_context().run, task, begun)] = begun
                begun += 1
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                results[running.pop(future)] = future.result()
            if progress:
                progress(begun - len(running), count)
            while given in results:
                yield results.pop(given)
                given += 1
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
