"""A programme of steps on every replica: one state of the contact goes from step to step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

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
#: the same of each step, (step,)
OF_STEPS = {
    "step_peak": ("peak", "nN", "largest force of the drive in each step"),
    "step_peak_at": ("peak_at", "nm", "way of the slider in each step to there"),
    "step_work": ("work", "nN nm", "work of the drive in each step"),
    "step_lost": ("lost", "", "bonds lost as the load changed"),
}


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

    def check_sections(self, parts: Mapping[str, Any]) -> None:
        """Refuse steps that are not complete, and a scene whose sections contradict them."""
        driven = any(one.speed for one in self.segments)
        if driven and parts["chemistry"].breaking is None:
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
        every, sites, plugins, approximate, notes = zip(*replicas, strict=True)

        def curves(name: str) -> np.ndarray:
            joined = [[getattr(one, name) for one in steps] for steps in every]
            return np.stack([np.concatenate(parts) for parts in joined])

        ends = [steps[-1].history for steps in every]
        values, outputs = self._recorded(every, contacts, curves)
        driven = any(one.speed for one in self.segments)
        return AgedBonds(
            bonds=curves("bonds"),
            sites=np.array(sites),
            events=np.array([end.formed[-1] + end.broken[-1] for end in ends]),
            rupture_force=curves("force") if driven else None,
            observables=values,
            outputs=outputs,
            notes=(*notes[0], *self._notes(contacts)),
            engine=every[0][0].history.engine,
            plugins={name: one for each in plugins for name, one in each.items()},
            approximate=[entry for each in approximate for entry in each],
        )

    def _notes(self, contacts: Sequence[ContactSolution]) -> list[str]:
        notes = []
        if any(one.speed for one in self.segments):
            notes.append(
                "friction is the force of the drive, not a drop after a hold"
            )
        if len({contact.load for contact in contacts}) > 1:
            notes.append("friction coefficients are over the load of the scene")
        return notes

    def _replica(
        self, request: AgeingRequest, number: int, contacts: list[ContactSolution]
    ) -> tuple[Any, ...]:
        seeds = request.seeds(number)
        different = {id(contact): contact for contact in contacts}
        built = [
            build_lattice(request.chemistry, contact, seeds.disorder)
            for contact in different.values()
        ]
        lattices = dict(zip(different, on_all_sites(built), strict=True))
        state, before, steps = None, None, []
        for segment, contact in zip(self.segments, contacts, strict=True):
            lattice, lost = lattices[id(contact)], 0
            if state is not None and before is not None and lattice is not before:
                changed = state_of(state, before, lattice)
                lost = int(changed.broken[-1] - state.broken[-1])
                state = changed
            state = self._step(
                request, seeds.noise, number, len(steps), contact, lattice, state
            )
            before = lattice
            steps.append(StepOutcome(segment, state, lost))
        parts = [*built, *(step.history for step in steps)]
        notes = [note for step in steps for note in step.history.notes]
        return (
            steps,
            next(iter(lattices.values())).sites.size,
            {name: one for part in parts for name, one in part.plugins.items()},
            [entry for part in parts for entry in part.approximate],
            dict.fromkeys(notes),
        )

    def _step(
        self,
        request: AgeingRequest,
        seed: Any,
        replica: int,
        number: int,
        contact: ContactSolution,
        lattice: ReactionLattice,
        state: BondHistory | PullHistory | None,
    ) -> BondHistory | PullHistory:
        """One step of a replica, from the checkpoints where it is kept there."""
        segment = self.segments[number]
        how: dict[str, Any] = {
            "temperature": segment.temperature or request.temperature,
            "seed": seed,
            "contact": contact,
            "chemistry": request.chemistry,
        }

        def make() -> BondHistory | PullHistory:
            return follow(
                segment, lattice, state, request.engine, self.drive, **how
            )

        kind, call = (
            BondHistory,
            {"engine": request.engine, "hold_times": segment.times},
        )
        hook = "chemage_run_kinetics"
        if segment.speed or isinstance(state, PullHistory):
            assert self.drive is not None
            kind, hook = PullHistory, "chemage_pull_bonds"
            drive = self.drive.at(segment.speed, segment.spring)
            call = {
                "engine": self.drive.engine,
                "drive": drive,
                "times": segment.times,
                "partners": None,
            }
        return request.kept(
            f"replica-{replica:05d}-step-{number:03d}",
            kind,
            make,
            key=[self.todict(), lattice.digest()],
            hook=hook,
            lattice=lattice,
            start=state,
            **call,
            **how,
        )

    def _recorded(
        self,
        every: Sequence[Sequence[StepOutcome]],
        contacts: Sequence[ContactSolution],
        curves: Any,
    ) -> tuple[dict[str, np.ndarray], dict[str, Output]]:
        """What is kept of the replicas beside the bonds."""
        values: dict[str, np.ndarray] = {}
        outputs: dict[str, Output] = {}

        def keep(name: str, array: Any, dims: Any, unit: str, words: str) -> None:
            values[name] = np.asarray(array)
            outputs[name] = Output(dims, unit, words)

        sizes = [one.times.size for one in self.segments]
        conditions = {
            "applied_load": ("nN", "load", [one.load for one in contacts]),
            "contact_area": ("nm2", "contact area", [one.area for one in contacts]),
            "held_at": ("K", "temperature", self._temperatures(every)),
            "drive_speed": ("nm/s", "speed of the drive", [one.speed for one in self.segments]),
        }  # fmt: skip
        for name, (unit, words, of_steps) in conditions.items():
            curve = np.repeat(np.array(of_steps, np.float64), sizes)
            keep(name, [curve] * len(every), "hold_time", unit, words)
        driven = any(one.speed for one in self.segments)
        if driven:
            keep("slider", curves("slider"), "hold_time", "nm", "way of the slider")
        for name, (attribute, unit, words) in OF_STEPS.items():
            if driven or attribute == "lost":
                array = [
                    [getattr(one, attribute) for one in steps] for steps in every
                ]
                keep(name, array, "step", unit, words)
        measured = [self.protocol.measure(steps) for steps in every]
        for name, output in self.protocol.measures.items():
            values[name] = np.array([one[name] for one in measured], np.float64)
            outputs[name] = output
        return values, outputs

    def _temperatures(self, every: Sequence[Sequence[StepOutcome]]) -> list[float]:
        return [step.history.temperature for step in every[0]]

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.AgeingMethod.expected`: of the rests, as if all were one."""
        return {
            name: value * (1 if name == "bytes" else replicas)
            for name, value in kinetics.items()
        }
