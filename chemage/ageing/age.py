"""Ageing of a contact under constant load: over replicas, and together with several chemistries."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.ageing import BARRIERS, Ageing, elastic_limits
from chemage.ageing.methods import (
    EVERY_SITE,
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    check_contact,
    check_method,
)
from chemage.ageing.observables import Observable, output_problems
from chemage.ageing.replicas import COMMON, Common
from chemage.contacts.role import ContactSolver, expect_contact
from chemage.contacts.solution import Contact, ContactSolution, ContactStatistics
from chemage.foundation.checks import (
    Seed,
    check_times,
    checked_count,
    checked_seed,
    expect,
    temperature_value,
)
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.memory import require
from chemage.foundation.outputs import Block, Checker, Output, recording
from chemage.foundation.progress import counted, logged, of_plugins
from chemage.foundation.records import merged_changes
from chemage.foundation.threads import available, in_order
from chemage.foundation.units import QuantityLike
from chemage.friction.role import Rupture
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.plugins.context import Plugins, taking_part
from chemage.plugins.sources import (
    approximations,
    components_in,
    implementing,
    providers,
)
from chemage.surfaces.surface import Surface

#: hooks that see the sites of a replica
_SITE_HOOKS = (
    "chemage_build_lattice",
    "chemage_run_kinetics",
    "chemage_rupture_bonds",
    "chemage_observe",
)


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
    surface: Surface | None = None,
    solver: ContactSolver | None = None,
) -> Ageing:
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
        Further measurements on each replica, kept in ``Ageing.observables``.
    threads
        Threads that run replicas at the same time; default: one per processor. Results do not depend on it.
    progress
        Called with (replicas done, replicas in all).
    checkpoints
        A folder in which every replica is kept while it runs; an interrupted call resumes, with equal results.
    method
        Another way to find the bonds, see :class:`chemage.plugin.AgeingMethod`; default: the kinetics of every site.
    surface, solver
        The surface of the contact, and what solves it under other loads, where the method changes the load.
    """
    _check_parts(contact, chemistry, engine, rupture, observe)
    if not isinstance(common, str) or common not in COMMON:
        raise InputError.of(
            "common",
            common,
            f"is not one of {', '.join(COMMON)}",
            "the default is 'none'",
        )
    checked_count("replicas", replicas)
    if not isinstance(seed, np.random.SeedSequence):
        checked_seed(seed)
    threads = available() if threads is None else checked_count("threads", threads)
    method = EVERY_SITE if method is None else method
    expect(
        "method", method, AgeingMethod, 'make one with chemage.ageing_method("...")'
    )
    check_contact("contact: it", contact.has_map, method, chemistry)
    check_method(method, chemistry, engine, rupture, observe)
    times, kelvin = check_times(hold_times), temperature_value(temperature)
    remedy = "ask for fewer replicas, or for fewer hold times"
    require(kept_bytes(replicas, times.size), f"replicas = {replicas}", remedy)
    if checkpoints is not None:
        expect("checkpoints", checkpoints, Path, "give a pathlib.Path")
    if progress is not None and not callable(progress):
        raise InputError.of(
            "progress",
            progress,
            "cannot be called",
            "give a function, or leave it out",
        )
    report = counted("ageing", method.steps, progress)
    how = (
        replicas,
        seed,
        common,
        rupture,
        tuple(observe),
        threads,
        report,
        checkpoints,
        surface,
        solver,
    )
    request = AgeingRequest(contact, chemistry, engine, times, kelvin, *how)
    about = f"{method.kind}: {engine.kind}, {replicas} replicas, {times.size} hold times, {kelvin:g} K"
    with logged("ageing", about) as outcome:
        ageing = _ageing(request, method)
        outcome(f"{ageing.sites.mean():.0f} sites; {of_plugins(ageing.plugins)}")
    return ageing


def _check_parts(
    contact: Any, chemistry: Any, engine: Any, rupture: Any, observe: Any
) -> None:
    expect_contact(contact, Contact)
    expect(
        "chemistry",
        chemistry,
        Chemistry,
        "make one with chemage.chemistry(forming=...)",
    )
    expect("engine", engine, Engine, 'make one with chemage.engine("bkl")')
    if rupture is not None:
        expect(
            Rupture.role, rupture, Rupture, 'make one with chemage.rupture("...")'
        )
    listed = 'give a list of chemage.observable("barrier-spectrum")'
    if not isinstance(observe, list | tuple):
        raise InputError.of("observe", observe, "is no list", listed)
    for observable in observe:
        expect("observe", observable, Observable, listed)
    for _, problem in output_problems(engine, rupture, chemistry, *observe):
        raise PluginError(problem)


def _ageing(request: AgeingRequest, method: AgeingMethod) -> Ageing:
    """What ``method`` finds, which must be of the whole contact and at the hold times that were asked for."""
    contact, chemistry, observe = (
        request.contact,
        request.chemistry,
        request.observe,
    )
    with recording() as block, taking_part() as took_part:
        aged = method.age(request)
    if not isinstance(aged, AgedBonds):
        raise PluginError(
            f"ageing {method.kind!r} gave {type(aged).__name__}; its method age must give an AgedBonds"
        )
    components = [method, request.engine, chemistry, *observe, request.rupture]
    plugins = contact.plugins | aged.plugins | providers(components)
    declared = dict(aged.outputs)
    declared |= {
        name: output
        for observable in observe
        for name, output in observable.outputs.items()
    }
    recorded = _recorded(method, aged, block)
    declared |= {name: output for name, (output, _) in recorded.items()}
    remarks = (
        () if request.rupture is None else request.rupture.remarks(aged.observables)
    )
    if (
        twice := (aged.observables.keys() | recorded.keys())
        & contact.observables.keys()
    ):
        raise PluginError(
            f"{min(twice)!r} is recorded with the contact and with its ageing; rename one"
        )
    try:
        ageing = Ageing(
            hold_times=request.hold_times,
            bonds=aged.bonds,
            sites=aged.sites,
            events=aged.events,
            load=contact.load,
            temperature=request.temperature,
            bond_force=chemistry.bond_force,
            front_factor=chemistry.front_factor,
            rupture_force=aged.rupture_force,
            errors=dict(aged.errors),
            error_sources=dict(aged.error_sources),
            engine=aged.engine or request.engine.kind,
            notes=(
                *aged.notes,
                *remarks,
                *_left_out(request, method, aged, plugins),
            ),
            contact=contact.summary(),
            elasticity=elastic_limits(contact, chemistry),
            observables=dict(aged.observables)
            | {name: values for name, (_, values) in recorded.items()},
            outputs={name: output.todict() for name, output in declared.items()},
            unfitted=method.unfitted,
            provenance=_provenance(request, method),
        )
    except InputError as error:
        raise PluginError(
            f"ageing {method.kind!r} gave no valid result: {error}"
        ) from error
    if ageing.replicas != (request.replicas if method.replicates else 1):
        raise PluginError(
            f"ageing {method.kind!r} gave {ageing.replicas} replicas of {request.replicas}"
        )
    return ageing.noting(
        plugins,
        [*contact.approximate, *aged.approximate, *approximations(components)],
        changes=merged_changes(contact.changes, took_part.changes),
    )


def _recorded(
    method: AgeingMethod, aged: AgedBonds, block: Block
) -> dict[str, tuple[Output, np.ndarray]]:
    """What the method recorded of the whole contact, the same for each row of its bonds."""
    checker = Checker(f"ageing {method.kind!r}", np.shape(aged.bonds)[-1])
    rows = len(np.atleast_2d(aged.bonds))
    found = {}
    for name, (_, declared) in block.items():
        values = checker.values(name, declared.values, declared.output)
        found[name] = declared.output, np.repeat(values[None], rows, axis=0)
    return found


def _left_out(
    request: AgeingRequest,
    method: AgeingMethod,
    aged: AgedBonds,
    took_part: Plugins,
) -> Iterator[str]:
    """Notes of the plugins that would see the sites of a replica and did not, and of what components would record of
    the replicas, which the method does not give."""
    hooks = () if method.shows_sites else _SITE_HOOKS
    if missed := [name for name in implementing(*hooks) if name not in took_part]:
        names = ", ".join(missed)
        yield f"ageing {method.kind!r} does not give the sites of a replica to plugins: {names} took no part"
    parts = components_in(request.engine, request.rupture)
    if missed := [
        name
        for part in parts
        for name in part.outputs
        if name not in aged.observables
    ]:
        yield f"ageing {method.kind!r} does not keep what replicas record: {', '.join(missed)}"


def _provenance(request: AgeingRequest, method: AgeingMethod) -> dict[str, Any]:
    chemistry, rupture, observe = (
        request.chemistry,
        request.rupture,
        request.observe,
    )
    sites = chemistry.site_notes(request.contact)
    return {
        "chemistry": {
            name: value
            for name, value in chemistry.todict().items()
            if name not in chemistry.limits
        },
        "engine": request.engine.todict(),
        "contact": request.contact.provenance,
        **({"sites": sites} if sites else {}),
        **({} if rupture is None else {rupture.role: rupture.todict()}),
        **(
            {"observe": [observable.todict() for observable in observe]}
            if observe
            else {}
        ),
        **{part.role: part.todict() for part in components_in(method)[:1]},
        **(
            {"seed": str(request.seed), "common": request.common}
            if method.replicates
            else {}
        ),
    }


def kept_bytes(replicas: int, hold_times: int) -> float:
    """Memory for the results of all replicas, twice, as they are joined at the end."""
    return replicas * (16.0 * hold_times + 500.0)


#: members that are aged, sites over all replicas of each, and most replicas
MEMBERS, SITES, MOST = 8, 2000, 40


def with_members(
    ageing: Ageing,
    contact: ContactSolution | ContactStatistics,
    chemistry: Chemistry,
    *,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    **how: Any,
) -> Ageing:
    """``ageing`` with the error that its distribution of forming barriers has, where its members are known.

    The distribution and :data:`MEMBERS` of its members are aged with the same disorder and kinetic noise. Each has as
    many replicas as are needed for :data:`SITES` sites, :data:`MOST` at most. The rupture law takes no part: the error
    is that of the mean number of bonds. ``how`` are the other arguments of :func:`chemage.age`.
    """
    members = list(chemistry.forming.members(MEMBERS))
    if not members:
        return ageing
    method, sites = (
        how.get("method") or EVERY_SITE,
        max(float(ageing.sites.mean()), 1.0),
    )
    replicas = int(np.clip(np.ceil(SITES / sites), 1, MOST))
    how |= {
        "replicas": replicas,
        "common": "all",
        Rupture.role: None,
        "observe": (),
        "threads": 1,
    }
    how.pop("checkpoints", None)
    every = [chemistry.forming, *members]

    def aged(number: int) -> np.ndarray:
        return age(
            contact, chemistry.replace(forming=every[number]), **how
        ).bonds.mean(axis=0, dtype=np.float64)

    own, *others = in_order(aged, len(every), threads or available(), progress)
    ratios = np.stack(
        [
            np.divide(bonds, own, out=np.full(own.shape, np.nan), where=own > 0)
            for bonds in others
        ]
    )
    count = (
        f"{replicas} replica{'s' if replicas > 1 else ''} each"
        if method.replicates
        else "each once"
    )
    source = f"scatter of {len(others)} members of the distribution of barriers, {count}, same random numbers"
    return ageing.model_copy(
        update={
            "errors": {**ageing.errors, BARRIERS: ratios.std(axis=0, ddof=1)},
            "error_sources": {**ageing.error_sources, BARRIERS: source},
            "member_ratios": ratios,
        }
    )
