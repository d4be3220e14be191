"""The stage of ageing: every replica draws its disorder and runs its kinetics, several replicas at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.checkpoints import run_with_checkpoints
from chemage.ageing.elasticity import compared
from chemage.ageing.measuring import Seen, check_outputs, measure, stacked
from chemage.ageing.methods import AgedBonds, AgeingMethod, AgeingRequest, check_contact, check_method, left_out_plugins
from chemage.ageing.observables import Observable
from chemage.ageing.seeds import Common, check_common, identity, origin, replica_seeds
from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.foundation.checks import Seed, check_times, checked_count, checked_seed, expect, temperature_value
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.hashes import content_hash
from chemage.foundation.logs import counted, logged, of_plugins
from chemage.foundation.memory import require
from chemage.foundation.threads import available, in_order
from chemage.foundation.units import QuantityLike
from chemage.friction.bonded import Bonded
from chemage.friction.role import Rupture
from chemage.friction.stage import rupture_bonds
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine
from chemage.kinetics.stage import cannot_give_states, run_kinetics
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.site_grid import ONE_PER_PIXEL
from chemage.lattices.stage import build_lattice
from chemage.plugins.participation import Plugins
from chemage.plugins.sources import approximations, components_in, providers


def age(
    contact: ContactSolution | ContactStatistics,
    chemistry: Chemistry,
    *,
    engine: Engine,
    hold_times: Sequence[float] | np.ndarray,
    temperature: QuantityLike,
    replicas: int = 10,
    seed: Seed = 0,
    common: Common = "none",
    rupture: Rupture | None = None,
    observe: Sequence[Observable] = (),
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    checkpoints: Path | None = None,
    method: AgeingMethod | None = None,
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
    method
        Another way to find the bonds, see :class:`chemage.plugin.AgeingMethod`; default: the kinetics of every site.
    """
    _check(contact, chemistry, engine, rupture, observe, common, replicas, seed, threads)
    if method is not None:
        expect("method", method, AgeingMethod, 'make one with chemage.ageing_method("...")')
    check_contact("contact: it", isinstance(contact, ContactStatistics), method, chemistry)
    times, kelvin = _check_run(hold_times, temperature, replicas, checkpoints, progress)
    request = AgeingRequest(
        contact,
        chemistry,
        engine,
        times,
        kelvin,
        replicas,
        seed,
        common,
        rupture,
        tuple(observe),
        threads or available(),
        counted("ageing", replica_word(method), progress),
        checkpoints,
    )
    about = f"{engine.kind}, {replicas} replicas, {times.size} hold times, {kelvin:g} K"
    with logged("ageing", about if method is None else f"{method.kind}: {about}") as outcome:
        made = _by_kinetics(request) if method is None else _by_method(method, request)
        outcome(f"{made.sites.mean():.0f} sites; {of_plugins(made.plugins)}")
    return made


def replica_word(method: AgeingMethod | None) -> str:
    """What the progress of ageing counts."""
    return "replicas" if method is None or method.replicates else "steps"


def _by_kinetics(request: AgeingRequest) -> Aging:
    """The result of the kinetics of every site, replica by replica."""
    contact, chemistry, engine = request.contact, request.chemistry, request.engine
    assert isinstance(contact, ContactSolution)
    times, kelvin, seed, common = request.hold_times, request.temperature, request.seed, request.common
    rupture, observe, checkpoints = request.rupture, request.observe, request.checkpoints
    states = wants_states(engine, rupture, observe)
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
    at_once = max(1, min(request.replicas, request.threads // engine.concurrency()))
    done = list(in_order(replica, request.replicas, at_once, request.progress))
    provenance = _provenance(request) | {"seed": str(seed), "common": common}
    return _aging(contact, chemistry, done, times, kelvin, provenance)


def _provenance(request: AgeingRequest) -> dict[str, Any]:
    contact, chemistry, rupture, observe = request.contact, request.chemistry, request.rupture, request.observe
    if isinstance(contact, ContactSolution):
        sites = chemistry.sites_of(contact)
        grid = {} if sites.words == ONE_PER_PIXEL else {"sites": sites.describe(contact)}
    else:
        grid = {"sites": {"words": f"{chemistry.site_density} per nm² of contact, no grid"}}
    return {
        "chemistry": {name: value for name, value in chemistry.todict().items() if name not in chemistry.limits},
        "engine": request.engine.todict(),
        "contact": contact.provenance,
        **grid,
        **({} if rupture is None else {"rupture": rupture.todict()}),
        **({"observe": [one.todict() for one in observe]} if observe else {}),
    }


def _by_method(method: AgeingMethod, request: AgeingRequest) -> Aging:
    """The result of a method, which must be of the whole contact and at the hold times that were asked for."""
    contact, chemistry = request.contact, request.chemistry
    check_method(method, chemistry, request.engine, request.rupture, request.observe)
    found = method.age(request)
    if not isinstance(found, AgedBonds):
        raise PluginError(f"ageing {method.kind!r} gave {type(found).__name__}; its method age must give an AgedBonds")
    own = [method, request.engine, chemistry, *request.observe, *([] if request.rupture is None else [request.rupture])]
    plugins = contact.plugins | providers(*own) | found.plugins
    provenance = _provenance(request) | {"ageing": method.todict()}
    if method.replicates:
        provenance |= {"seed": str(request.seed), "common": request.common}
    outputs = {name: output for one in request.observe for name, output in one.outputs.items()}
    try:
        aging = Aging(
            hold_times=request.hold_times,
            bonds=found.bonds,
            sites=found.sites,
            events=found.events,
            load=contact.load,
            temperature=request.temperature,
            bond_force=chemistry.bond_force,
            front_factor=chemistry.front_factor,
            rupture_force=found.rupture_force,
            errors=dict(found.errors),
            error_sources=dict(found.error_sources),
            engine=found.engine or request.engine.kind,
            notes=(*found.notes, *left_out_plugins(method, plugins)),
            contact=contact.summary(),
            elasticity=compared(contact, chemistry),
            observables=dict(found.observables),
            outputs={name: output.todict() for name, output in outputs.items()},
            provenance=provenance,
        )
    except InputError as error:
        raise PluginError(f"ageing {method.kind!r} gave no valid result: {error}") from error
    if aging.replicas != (request.replicas if method.replicates else 1):
        raise PluginError(f"ageing {method.kind!r} gave {aging.replicas} replicas of {request.replicas}")
    return aging.noting(plugins, [*contact.approximate, *found.approximate, *approximations(*own)])


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
    if not isinstance(contact, ContactStatistics):
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
