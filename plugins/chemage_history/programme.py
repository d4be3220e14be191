"""A programme of steps on every replica: one state of the contact goes from step to step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from chemage import ContactSolution, InputError, ReactionLattice, solve_contact
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    BondHistory,
    Choice,
    Engine,
    Output,
    PullHistory,
    build_lattice,
    pull,
    run_kinetics,
)
from chemage_history.steps import Protocol, Segment, Slider, StepOutcome, segments

#: forming barrier of a site that is not in contact, eV: it forms no bond at any temperature
ABSENT = 1000.0
#: what is kept of each step -> unit and meaning
OF_STEPS = {
    "peak": ("nN", "largest force of the drive in each step"),
    "peak_at": ("nm", "way of the slider in each step to there"),
    "work": ("nN nm", "work of the drive in each step"),
    "lost": ("", "bonds lost as the load changed"),
}


class _Replica(NamedTuple):
    """What is kept of a replica."""

    #: by name, with the curves of bonds, force and slider
    values: dict[str, Any]
    #: of those that are observables
    outputs: dict[str, Output]
    sites: int
    engine: str
    notes: tuple[str, ...]
    plugins: dict[str, str]
    approximate: list[dict[str, Any]]


def state_of(
    state: BondHistory | PullHistory,
    before: ReactionLattice,
    after: ReactionLattice,
) -> BondHistory | PullHistory:
    """The state of a contact whose sites have the barriers of ``after``: those that left have lost their bonds, and all
    keep their partners, stretch, clock and counters."""
    state = state.without(after.forming >= ABSENT / 2)
    if isinstance(state, PullHistory):
        forming = state.forming + (after.forming - before.forming)
        state = state.model_copy(update={"forming": forming})
    return state


def follow(
    segment: Segment,
    lattice: ReactionLattice,
    state: BondHistory | PullHistory | None,
    engine: Engine,
    drive: Slider | None,
    **how: Any,
) -> BondHistory | PullHistory:
    """One step of a replica from its ``state``: by the ``engine``, and once it has been driven by that of the
    ``drive``, with which bonds at rest keep their stretch.

    ``how``: temperature (K), seed, and where they are known contact and chemistry.
    """
    if not segment.speed and not isinstance(state, PullHistory):
        return run_kinetics(engine, lattice, segment.times, start=state, **how)
    assert drive is not None
    # every step is a pull of its own, with its own peak
    start = state.handed_on() if isinstance(state, PullHistory) else state
    moved = drive.at(segment.speed, segment.spring)
    return pull(drive.engine, lattice, moved, segment.times, start=start, **how)


def on_all_sites(lattices: Sequence[ReactionLattice]) -> list[ReactionLattice]:
    """The same on all sites that are in contact at any time; those that are not react with nothing.

    A site keeps its place in every array, and by that its clock and its random numbers.
    """
    sites = lattices[0].sites
    for lattice in lattices[1:]:
        sites = np.union1d(sites, lattice.sites)
    return [
        lattice if lattice.sites.size == sites.size else _embedded(lattice, sites)
        for lattice in lattices
    ]


def _embedded(lattice: ReactionLattice, sites: np.ndarray) -> ReactionLattice:
    if lattice.positions is not None:
        raise InputError("load: sites at positions of their own need one load")
    at = np.searchsorted(sites, lattice.sites)

    def spread(values: np.ndarray, empty: float) -> np.ndarray:
        full = np.full((sites.size, *values.shape[1:]), empty, values.dtype)
        full[at] = values
        return full

    fields: dict[str, Any] = {"sites": sites}
    empty = {"forming": ABSENT, "breaking": 1.0, "pressure": 0.0, "coupling": 0.0}
    for name, value in empty.items():
        if (values := getattr(lattice, name)) is not None:
            fields[name] = spread(values, value)
    if (graph := lattice.neighbours) is not None:
        fields["neighbours"] = spread(
            np.where(graph >= 0, at[graph], -1).astype(graph.dtype), -1
        )
    return ReactionLattice.fromdict({**lattice.todict(), **fields})


class Programme(AgeingMethod):
    """Every replica is followed through all steps; its times are those of the steps.

    It belongs to the section ``[protocol]`` and has no role.
    """

    role = ""
    kind = "programme"
    loads = True
    unfitted = "the times are those of several steps"

    protocol: Choice[Protocol]
    """the steps, and what they measure"""
    drive: Slider | None = None
    """what drives the slider; None: no step has a speed"""

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The steps with all their conditions."""
        return tuple(segments(self.protocol.expand(), self.drive))

    def times(self) -> np.ndarray:
        """(m,) s, of all steps."""
        return np.concatenate([one.times for one in self.segments])

    @property
    def driven(self) -> bool:
        """Whether any step has a speed."""
        return any(one.speed for one in self.segments)

    def check_sections(self, parts: Mapping[str, Any]) -> None:
        """Refuse steps that are not complete, and a scene whose sections contradict them."""
        if self.driven and parts["chemistry"].breaking is None:
            raise InputError("bonds last, so that nothing slides; give [breaking]")

    def contacts(self, request: AgeingRequest) -> list[ContactSolution]:
        """The contact in each step, each solved from the one before; of a load that comes back the same one, unless
        the contact remembers."""
        contact, surface, solver = request.solution, request.surface, request.solver
        solved: dict[Any, ContactSolution] = {None: contact, contact.load: contact}
        found = []
        for segment in self.segments:
            load = segment.load
            if load is not None and load not in solved:
                if surface is None or solver is None:
                    raise InputError(
                        "load: to change it, give the surface and the solver"
                    )
                if contact.plastic_displacement is not None:
                    surface = contact.residual_surface(surface)
                remembers = (
                    solver.adheres or contact.plastic_displacement is not None
                )
                contact = solve_contact(solver, surface, load, start=contact)
                solved = {} if remembers else solved
                solved |= {load: contact, contact.load: contact}
            contact = solved[load]
            found.append(contact)
        return found

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.plugin.AgeingMethod.age`."""
        if not np.array_equal(request.hold_times, self.times()):
            raise InputError("hold_times: are not those of the steps; give times()")
        contacts = self.contacts(request)
        replicas = request.each(lambda n: self._replica(request, n, contacts))
        notes = []
        if self.driven:
            notes.append("friction is the force of the drive, not a drop by a hold")
        if len({contact.load for contact in contacts}) > 1:
            notes.append("friction coefficients are over the load of the scene")

        def stacked(name: str) -> np.ndarray:
            return np.stack([one.values[name] for one in replicas])

        first = replicas[0]
        return AgedBonds(
            bonds=stacked("bonds"),
            sites=np.array([one.sites for one in replicas]),
            events=stacked("events"),
            rupture_force=stacked("force") if self.driven else None,
            observables={name: stacked(name) for name in first.outputs},
            outputs=first.outputs,
            notes=(*first.notes, *notes),
            engine=first.engine,
            plugins={k: v for one in replicas for k, v in one.plugins.items()},
            approximate=[entry for one in replicas for entry in one.approximate],
        )

    def _replica(
        self, request: AgeingRequest, number: int, contacts: list[ContactSolution]
    ) -> _Replica:
        seeds = request.seeds(number)
        different = {id(contact): contact for contact in contacts}
        built = [
            build_lattice(request.chemistry, contact, seeds.disorder)
            for contact in different.values()
        ]
        lattices = dict(zip(different, on_all_sites(built), strict=True))
        state, before, steps = None, built[0], []
        for k, (segment, contact) in enumerate(
            zip(self.segments, contacts, strict=True)
        ):
            lattice, lost = lattices[id(contact)], 0
            if state is not None and lattice is not before:
                state, broken = state_of(state, before, lattice), state.broken[-1]
                lost = int(state.broken[-1] - broken)
            pulled = segment.speed or isinstance(state, PullHistory)
            state = request.kept(
                f"replica-{number:05d}-step-{k:03d}",
                PullHistory if pulled else BondHistory,
                partial(
                    follow,
                    segment,
                    lattice,
                    state,
                    request.engine,
                    self.drive,
                    temperature=segment.temperature or request.temperature,
                    seed=seeds.noise,
                    contact=contact,
                    chemistry=request.chemistry,
                ),
                key=[self.todict(), lattice.digest()],
            )
            before = lattice
            # what is pending fills the memory
            seen = state.model_copy(update={"resume": {}})
            steps.append(StepOutcome(segment, seen, lost))
        return self._measured(
            steps, contacts, [*built, *(o.history for o in steps)]
        )

    def _measured(
        self,
        steps: Sequence[StepOutcome],
        contacts: Sequence[ContactSolution],
        made: Sequence[Any],
    ) -> _Replica:
        """What is kept of a replica, whose lattices and histories were ``made``."""
        values: dict[str, np.ndarray] = {}
        outputs: dict[str, Output] = {}

        def keep(name: str, array: Any, unit: str, words: str, *dims: str) -> None:
            values[name], outputs[name] = (
                np.asarray(array),
                Output(dims, unit, words),
            )

        sizes = [one.times.size for one in self.segments]
        for name, of_steps, unit, words in (
            ("applied_load", [one.load for one in contacts], "nN", "load"),
            ("contact_area", [one.area for one in contacts], "nm2", "contact area"),
            ("held_at", [one.history.temperature for one in steps], "K", "temperature"),
            ("drive_speed", [one.speed for one in self.segments], "nm/s", "speed of the drive"),
        ):  # fmt: skip
            curve = np.repeat(np.array(of_steps, np.float64), sizes)
            keep(name, curve, unit, words, "hold_time")
        curves = {
            name: np.concatenate([getattr(one, name) for one in steps])
            for name in ("bonds", "force", "slider")
        }
        if self.driven:
            keep("slider", curves["slider"], "nm", "way of the slider", "hold_time")
        for name, (unit, words) in OF_STEPS.items():
            if self.driven or name == "lost":
                array = [getattr(one, name) for one in steps]
                keep(f"step_{name}", array, unit, words, "step")
        for name, value, unit, words in self.protocol.measure(steps):
            keep(name, np.float64(value), unit, words)
        end, notes = (
            steps[-1].history,
            [n for one in steps for n in one.history.notes],
        )
        return _Replica(
            values | curves | {"events": end.formed[-1] + end.broken[-1]},
            outputs,
            end.state.size,
            steps[0].history.engine,
            tuple(dict.fromkeys(notes)),
            {name: source for one in made for name, source in one.plugins.items()},
            [entry for one in made for entry in one.approximate],
        )

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.AgeingMethod.expected`: as of one rest."""
        return {
            name: value * (1 if name == "bytes" else replicas)
            for name, value in kinetics.items()
        }
