"""Methods of ageing, and the one where none is chosen: the kinetics of every site of every replica."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from chemage.ageing.observables import Observable, measure, stacked
from chemage.ageing.replicas import (
    Checkpoint,
    Common,
    ReplicaSeeds,
    identity,
    origin,
    replica_seeds,
    run_with_checkpoints,
)
from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.checks import Seed
from chemage.foundation.components import Component, call_with
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.outputs import Output
from chemage.foundation.records import Record, content_hash
from chemage.foundation.threads import in_order
from chemage.friction.role import Bonded, Rupture, rupture_bonds
from chemage.kinetics.history import BondHistory
from chemage.kinetics.role import Engine, cannot_give_states, run_kinetics
from chemage.lattices.chemistry import Chemistry, build_lattice
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.context import Plugins
from chemage.plugins.sources import components_in
from chemage.surfaces.surface import Surface

T = TypeVar("T")
R = TypeVar("R", bound=Record)


class Origin(NamedTuple):
    """Where the bonds of a replica come from."""

    #: kind of the engine
    engine: str = ""
    #: what users should know, in words
    notes: tuple[str, ...] = ()
    #: plugins that answered or changed a stage on the way: name -> distribution and version
    plugins: Plugins = {}
    #: what was approximate on the way
    approximate: Sequence[Mapping[str, Any]] = ()

    def then(self, *parts: Any) -> Origin:
        """The same with that of ``parts``, records or origins, which were made later."""
        every = (self, *parts)
        notes = [note for part in every for note in getattr(part, "notes", ())]
        return Origin(
            self.engine,
            tuple(dict.fromkeys(notes)),
            {name: by for part in every for name, by in part.plugins.items()},
            [entry for part in every for entry in part.approximate],
        )


class Replica(NamedTuple):
    """The sites of a replica, and the kinetics on them."""

    lattice: ReactionLattice
    history: BondHistory

    def origin(self, *later: Record) -> Origin:
        """Where its bonds come from, and what was made of them ``later``."""
        made = self.lattice, self.history, *later
        return Origin(self.history.engine).then(*made)


@dataclass(frozen=True)
class AgeingRequest:
    """What a method of ageing receives: the validated arguments of :func:`chemage.age`."""

    contact: ContactSolution | ContactStatistics
    chemistry: Chemistry
    engine: Engine
    #: (m,) s, non-decreasing
    hold_times: np.ndarray
    #: K
    temperature: float
    replicas: int
    seed: Seed
    common: Common
    rupture: Rupture | None = None
    observe: tuple[Observable, ...] = ()
    #: threads that may compute at the same time
    threads: int = 1
    #: called with (steps done, steps in all)
    progress: Callable[[int, int], None] | None = None
    #: where replicas are kept while they run; None: nowhere
    checkpoints: Path | None = None
    #: the surface, and what solved its contact, for a method with ``loads``; None: not known
    surface: Surface | None = None
    solver: ContactSolver | None = None

    @property
    def solution(self) -> ContactSolution:
        """The contact with its map of the pressure, which a method with ``needs_map`` always has.

        Raises
        ------
        InputError
            The contact has no map.
        """
        if not isinstance(self.contact, ContactSolution):
            raise InputError(
                "contact: it has no map of the pressure; solve the contact, or use a method that needs none"
            )
        return self.contact

    @cached_property
    def _identity(self) -> tuple[int, ...]:
        return identity(
            self.solution, self.chemistry, self.engine, self.temperature
        )

    @cached_property
    def _key(self) -> str:
        """Of the checkpoints."""
        common = [
            self.hold_times.tolist(),
            self.temperature,
            origin(self.seed),
            self.common,
        ]
        return content_hash(
            [self.engine.digest(), self.chemistry.digest(), *common]
        )

    def seeds(self, replica: int) -> ReplicaSeeds:
        """The seeds of the disorder and of the kinetic noise that ``replica`` has in the kinetics of every site."""
        return replica_seeds(self.seed, replica, self.common, self._identity)

    def follow(
        self, replica: int, *, sites: np.ndarray | None = None, states: bool = False
    ) -> Replica:
        """Draw the disorder of ``replica`` and run its kinetics, through the hooks of both stages.

        ``sites``: only those, see :func:`chemage.plugin.build_lattice`, without checkpoints; ``states``: with that of
        every site at every hold time.
        """
        disorder, noise = self.seeds(replica)
        lattice = build_lattice(
            self.chemistry, self.solution, disorder, sites=sites
        )
        run = run_kinetics
        if self.checkpoints is not None and sites is None:
            run = partial(
                run_with_checkpoints,
                path=self.checkpoints / f"replica-{replica:05d}.h5",
                run=self._key,
                before=self.contact.plugins | lattice.plugins,
            )
        history = run(
            self.engine,
            lattice,
            self.hold_times,
            temperature=self.temperature,
            seed=noise,
            states=states,
            contact=self.solution,
            chemistry=self.chemistry,
        )
        return Replica(lattice, history)

    def kept(
        self,
        name: str,
        kind: type[R],
        key: Any,
        make: Callable[..., R],
        *arguments: Any,
        **how: Any,
    ) -> R:
        """What ``make`` gives with these arguments, of this ``kind``; with checkpoints from the file ``name``, where it
        was kept under an equal ``key`` and the same plugins."""
        if self.checkpoints is None:
            return make(*arguments, **how)
        file = Checkpoint(
            self.checkpoints / f"{name}.h5",
            kind,
            content_hash(key),
            self._key,
            self.contact.plugins,
            ("chemage_run_kinetics", "chemage_pull_bonds"),
        )
        return file.kept(partial(make, *arguments, **how))

    def each(self, task: Callable[[int], T]) -> list[T]:
        """``task`` of every replica, several at a time; reports the progress."""
        # threads inside a run take their processors away from the other replicas
        at_once = max(
            1, min(self.replicas, self.threads // self.engine.concurrency())
        )
        return in_order(task, self.replicas, at_once, self.progress)


@dataclass(frozen=True)
class AgedBonds:
    """What a method of ageing gives: the bonds of the whole contact, and how well it knows them."""

    #: (replicas, m), or (1, m) where the method gives the mean alone; of the whole contact, never of a part of it;
    #: float64 where they are estimated: an estimate may be below zero or above the number of sites, as its mean over
    #: replicas must be free of bias
    bonds: np.ndarray
    #: (replicas,) or (1,): reactive sites of the whole contact, float64 where they are expected
    sites: np.ndarray
    #: (replicas,) or (1,): bonds formed and broken on the whole contact; None: not known
    events: np.ndarray | None = None
    #: (replicas, m) nN of the whole contact; None: bonds times the mean force and the front factor of the chemistry
    rupture_force: np.ndarray | None = None
    #: what the error is due to -> (m,) relative standard error, or bound, of the mean number of bonds, beside the
    #: scatter of the replicas, or the part of that which has another cause than the disorder; the words say which
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: the same names -> how that error is known, in words
    error_sources: Mapping[str, str] = field(default_factory=dict)
    #: name -> (replicas, ...), where the method measures observables
    observables: Mapping[str, np.ndarray] = field(default_factory=dict)
    #: the same names -> what they are, beside what the observables of the request declare
    outputs: Mapping[str, Output] = field(default_factory=dict)
    #: what users should know, in words
    notes: tuple[str, ...] = ()
    #: what computed the kinetics
    engine: str = ""
    #: plugins that answered or changed a stage on the way: name -> distribution and version
    plugins: Plugins = field(default_factory=dict)
    #: what was approximate on the way
    approximate: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of(
        cls,
        replicas: Sequence[Origin],
        *,
        notes: tuple[str, ...] = (),
        **fields: Any,
    ) -> Self:
        """The bonds of ``replicas``, with where they come from; notes and engine are those of the first."""
        every = Origin().then(*replicas)
        return cls(
            notes=(*notes, *replicas[0].notes),
            engine=replicas[0].engine,
            plugins=every.plugins,
            approximate=every.approximate,
            **fields,
        )


class AgedReplica(NamedTuple):
    """What is kept of a replica that was followed; its lattice and state are not, because they would fill the memory."""

    #: (m,)
    bonds: np.ndarray
    events: int
    sites: int
    #: (m,) nN; None: it follows from the bonds
    force: np.ndarray | None
    observables: Mapping[str, np.ndarray]
    outputs: Mapping[str, Output]
    origin: Origin


class AgeingMethod(Component, ABC):
    """Role ``ageing``: the bonds of a contact against hold time.

    Without one, every site is followed (:class:`chemage.ageing.methods.Kinetics`).
    """

    role = "ageing"
    error_of = "the mean number of bonds"
    #: gives the bonds of each replica, which has its own disorder and noise; False: the mean of infinitely many alone
    replicates: ClassVar[bool] = True
    #: asks for the surface and its solver, with which it changes the load
    loads: ClassVar[bool] = False
    #: why its times are not those of one hold, so that no line is fitted; "": they are
    unfitted: ClassVar[str] = ""
    #: needs the map of the pressure; False: the statistics of the contact are enough
    needs_map: ClassVar[bool] = True
    #: measures the observables of the request
    observes: ClassVar[bool] = False
    #: applies the rupture law of the request
    ruptures: ClassVar[bool] = False
    #: runs every stage of every replica, so that the hooks of plugins see all its sites
    shows_sites: ClassVar[bool] = False

    @property
    def steps(self) -> str:
        """What its progress counts."""
        return "replicas" if self.replicates else "steps"

    @abstractmethod
    def age(self, request: AgeingRequest) -> AgedBonds:
        """Give the bonds of the whole contact at each hold time."""

    def check(self, chemistry: Chemistry, engine: Engine) -> None:
        """Refuse, before anything is computed, what :meth:`age` would refuse. Used by ``chemage check``.

        Raises
        ------
        InputError
            Naming what the method cannot treat, and the remedy.
        """

    def check_sites(
        self, shape: tuple[int, int], touching: float | None
    ) -> Sequence[str] | None:
        """Refuse, before anything is computed, a grid of ``shape`` sites, about ``touching`` of them in contact (None:
        not known); return doubts as sentences. Used by ``chemage check``.

        Raises
        ------
        InputError
            Naming what does not fit, and the remedy.
        """

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """Estimate the cost, as far as it is known: ``cpu_seconds`` of all replicas, ``bytes`` of one.

        ``kinetics`` is what :meth:`Engine.expected` states for one replica of all ``sites`` of the contact. Where the
        time cannot be known to a factor of 2, ``cpu_seconds_least`` and ``cpu_seconds_most`` are stated as well. A
        component may add any of ``interacting``, whether the sites interact, ``chemistry``, ``temperature`` (K) and
        ``mean_pressure`` (GPa, or None where it is not known), and chemage then passes them.
        """
        return {}


def ageing_method(kind: str, **options: Any) -> Any:
    """A method of ageing: ``chemage.age(contact, chemistry, method=chemage.ageing_method("..."), ...)``."""
    return registry.current().make("ageing", kind, options)


def check_method(
    method: AgeingMethod,
    chemistry: Chemistry,
    engine: Engine,
    rupture: Rupture | None,
    observe: Sequence[Observable],
) -> None:
    """Refuse what a method of ageing cannot give.

    Raises
    ------
    InputError
        With what it cannot give, and the remedy.
    """
    remedy = "or leave out the ageing method, for the kinetics of every site"
    if observe and not method.observes:
        kinds = ", ".join(repr(observable.kind) for observable in observe)
        raise InputError(
            f"ageing {method.kind!r} gives numbers of bonds, not which sites are bonded, so that observable {kinds} "
            f"cannot be measured; leave it out, {remedy}"
        )
    if rupture is not None and not method.ruptures:
        raise InputError(
            f"ageing {method.kind!r} gives numbers of bonds, not which sites are bonded, so that the rupture law "
            f"{rupture.kind!r} cannot be applied; use bond_force and front_factor of the chemistry, {remedy}"
        )
    wants_states(engine, rupture, observe)
    method.check(chemistry, engine)


def wants_states(
    engine: Engine, rupture: Rupture | None, observe: Sequence[Observable]
) -> bool:
    """Whether the rupture law or an observable asks for the state of every site at every hold time.

    Raises
    ------
    InputError
        The engine cannot give them; names what asks for them.
    """
    asking = [
        f"{part.role} {part.kind!r}"
        for part in components_in(rupture, *observe)
        if isinstance(part, Rupture | Observable) and part.states
    ]
    if asking and not engine.restart:
        raise InputError(
            f"{', '.join(asking)} asks for the states: {cannot_give_states(engine)}"
        )
    return bool(asking)


def check_contact(
    contact: str, has_map: bool, method: AgeingMethod, chemistry: Chemistry
) -> None:
    """Refuse to age a contact without a map of the pressure by a method that needs one, or one site per pixel of it.

    Raises
    ------
    InputError
        With the methods that need no map.
    """
    if has_map:
        return
    if method.needs_map:
        enough = [
            repr(kind)
            for kind, cls in registry.current().usable("ageing")
            if not cls.needs_map
        ]
        raise InputError(
            f"{contact} gives statistics and no map of the pressure, so that it has no sites; set the kind of [ageing] "
            f"to {' or '.join(enough) or 'one that needs no map (none is installed)'}, or use a contact that is solved"
        )
    if isinstance(chemistry.site_density, str):
        raise InputError(
            f"site_density = {chemistry.site_density!r}: {contact} gives statistics, and a contact without a map has "
            "no pixels; give the sites per nm² in [chemistry]"
        )


class Kinetics(AgeingMethod):
    """Every replica draws its disorder and runs its kinetics; its bonds are counted, broken and measured.

    It is part of chemage and has no role, so that no scene names it and no key or provenance contains it.
    """

    role = ""
    kind = "kinetics"
    observes = True
    ruptures = True
    shows_sites = True

    def shared(self, request: AgeingRequest) -> Any:
        """What all replicas have in common, see :meth:`replica`: whether the states are wanted."""
        return wants_states(request.engine, request.rupture, request.observe)

    def replica(
        self, request: AgeingRequest, number: int, shared: Any
    ) -> AgedReplica:
        """Follow a replica."""
        replica = request.follow(number, states=shared)
        lattice, history = replica.lattice, replica.history
        seed = request.seeds(number).noise
        force = rupture_bonds(
            Bonded(request.solution, request.chemistry, lattice, history, seed),
            request.rupture,
        )
        seen = measure(request.solution, lattice, history, request.observe)
        for part in (lattice, history, force):
            if twice := part.observables.keys() & seen.values.keys():
                raise PluginError(
                    f"{min(twice)!r} is recorded at two stages of a replica; rename one"
                )
            seen.values.update(part.observables)
            seen.outputs.update(
                {name: Output(**output) for name, output in part.outputs.items()}
            )
        origin = replica.origin(force)
        given = request.rupture is not None or force.plugins
        return AgedReplica(
            history.bonds,
            history.events,
            lattice.sites.size,
            force.force if given else None,
            seen.values,
            seen.outputs,
            origin._replace(plugins={**origin.plugins, **seen.plugins}),
        )

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.plugin.AgeingMethod.age`."""
        shared = self.shared(request)
        replicas = request.each(
            lambda number: self.replica(request, number, shared)
        )
        mean = request.chemistry.bond_force * request.chemistry.front_factor
        forces = None
        if any(one.force is not None for one in replicas):
            forces = np.stack(
                [
                    mean * one.bonds if one.force is None else one.force
                    for one in replicas
                ]
            )
        return AgedBonds.of(
            [one.origin for one in replicas],
            bonds=np.stack([one.bonds for one in replicas]),
            sites=np.array([one.sites for one in replicas]),
            events=np.array([one.events for one in replicas]),
            rupture_force=forces,
            observables=stacked([one.observables for one in replicas]),
            outputs=replicas[0].outputs,
        )

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.AgeingMethod.expected`."""
        return {
            name: value * (1 if name == "bytes" else replicas)
            for name, value in kinetics.items()
        }


#: in place of a method that is not chosen
EVERY_SITE: AgeingMethod = Kinetics()


def expected_cost(
    method: AgeingMethod,
    sites: float,
    kinetics: Mapping[str, float],
    replicas: int,
    *,
    chemistry: Chemistry,
    temperature: float,
    mean_pressure: float | None,
) -> dict[str, float]:
    """What :meth:`AgeingMethod.expected` states, with as much of the conditions as it takes."""
    return dict(
        call_with(
            method.expected,
            sites,
            kinetics,
            replicas,
            interacting=chemistry.interaction is not None,
            chemistry=chemistry,
            temperature=temperature,
            mean_pressure=mean_pressure,
        )
    )
