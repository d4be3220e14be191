"""A programme of steps on every replica: one state of the contact goes from step to step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from chemage import ContactSolution, InputError, ReactionLattice, solve_contact
from chemage.plugin import (
    AgedBonds,
    AgeingMethod,
    AgeingRequest,
    BondHistory,
    Choice,
    ContactSolver,
    Engine,
    Output,
    PullHistory,
    Ramp,
    build_lattice,
    pull,
    run_kinetics,
)
from chemage_history.steps import Protocol, Segment, Slider, StepOutcome, segments

#: forming barrier of a site that is not in contact, eV: it forms no bond at any temperature
ABSENT = 1000.0
#: what is kept beside the bonds, and what the protocol measures
OUTPUTS = {
    "slider": Output("hold_time", "nm", "way of the slider"),
    "step_points": Output("step", "", "times that are recorded of each step"),
    "step_load": Output("step", "nN", "load in each step"),
    "step_area": Output("step", "nm2", "contact area in each step"),
    "temperature": Output("hold_time", "K", "temperature"),
    "step_speed": Output("step", "nm/s", "speed of the drive in each step"),
    "step_peak": Output("step", "nN", "largest force of the drive in each step"),
    "step_peak_at": Output("step", "nm", "way of the slider in each step to there"),
    "step_work": Output("step", "nN nm", "work of the drive in each step"),
    "step_old": Output(
        "step", "", "bonds at the end, on the first contact's sites"
    ),
    "step_lost": Output("step", "", "bonds lost as the load changed"),
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
    if segment.heated is not None:
        how["ramp"] = Ramp(segment.heated)
    if not segment.speed and not isinstance(state, PullHistory):
        return run_kinetics(engine, lattice, segment.times, start=state, **how)
    assert drive is not None
    # every step is a pull of its own, with its own peak
    start = state.handed_on() if isinstance(state, PullHistory) else state
    at = drive.at(segment)
    return pull(drive.engine, lattice, at, segment.times, start=start, **how)


def softened(solver: ContactSolver, ratio: float) -> ContactSolver:
    """``solver`` with its hardness times ``ratio``."""
    if ratio == 1.0:
        return solver
    hardness = getattr(solver, "hardness", None)
    if hardness is None:
        raise InputError(
            "hardness_ratio: this contact has no hardness; give one in [contact]"
        )
    return solver.replace(hardness=hardness * ratio)


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
    if lattice.positions is not None or lattice.states is not None:
        raise InputError(
            "load: sites at positions of their own, or of more than two states, need one load"
        )
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
        found = tuple(segments(self.protocol.expand()))
        if self.drive is None and any(one.speed for one in found):
            raise InputError("a speed needs [drive], which says how bonds yield")
        return found

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
        if not parts["engine"].restart:
            raise InputError(
                "the engine cannot go on from a history; use another one"
            )

    def contacts(self, request: AgeingRequest) -> list[ContactSolution]:
        """The contact in each step, each solved from the one before; of conditions that come back the same one, unless
        the contact remembers."""
        contact, surface, solver = request.solution, request.surface, request.solver
        first = contact.load
        solved: dict[Any, ContactSolution] = {(first, 1.0): contact}
        found = []
        for segment in self.segments:
            load = first if segment.load is None else segment.load
            at = load, segment.hardness_ratio
            if at not in solved:
                if surface is None or solver is None:
                    raise InputError(
                        "load: to change it, give the surface and the solver"
                    )
                if contact.plastic_displacement is not None:
                    surface = contact.residual_surface(surface)
                remembers = (
                    solver.adheres or contact.plastic_displacement is not None
                )
                softer = softened(solver, segment.hardness_ratio)
                contact = solve_contact(softer, surface, load, start=contact)
                solved = {} if remembers else solved
                solved |= {at: contact, (contact.load, at[1]): contact}
            contact = solved[at]
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

        every, provenances, said = zip(*replicas, strict=True)

        def stacked(name: str) -> np.ndarray:
            return np.stack([values[name] for values in every])

        outputs = {**OUTPUTS, **self.protocol.outputs}
        if not self.driven:
            del outputs["slider"]
        made = [one for each in provenances for one in each]
        return AgedBonds(
            bonds=stacked("bonds"),
            sites=stacked("sites"),
            events=stacked("events"),
            rupture_force=stacked("force") if self.driven else None,
            observables={name: stacked(name) for name in outputs},
            outputs=outputs,
            notes=(*said[0], *notes),
            plugins={k: v for plugins, _ in made for k, v in plugins.items()},
            approximate=[entry for _, entries in made for entry in entries],
        )

    def _replica(
        self, request: AgeingRequest, number: int, contacts: list[ContactSolution]
    ) -> tuple[dict[str, Any], list[Any], list[str]]:
        """Its values by name; of what was made on the way plugins and approximations; and notes."""
        seeds = request.seeds(number)
        different = {id(contact): contact for contact in contacts}
        built = [
            build_lattice(request.chemistry, contact, seeds.disorder)
            for contact in different.values()
        ]
        lattices = dict(zip(different, on_all_sites(built), strict=True))
        made = [(one.plugins, one.approximate) for one in built]
        state, before = None, built[0]
        first = lattices[id(contacts[0])].forming < ABSENT / 2
        notes: dict[str, None] = {}
        steps: list[StepOutcome] = []
        for segment, contact in zip(self.segments, contacts, strict=True):
            lattice, lost = lattices[id(contact)], 0
            if state is not None and lattice is not before:
                state, broken = state_of(state, before, lattice), state.broken[-1]
                lost = int(state.broken[-1] - broken)
            pulled = segment.speed or isinstance(state, PullHistory)
            make = partial(
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
            )
            state = request.kept(
                f"replica-{number:05d}-step-{len(steps):03d}",
                PullHistory if pulled else BondHistory,
                make,
                key=[self.todict(), lattice.digest()],
            )
            before = lattice
            old = int(np.count_nonzero(state.state & first))
            steps.append(StepOutcome.of(segment, state, lost, old))
            made.append((state.plugins, state.approximate))
            notes |= dict.fromkeys(state.notes)
        assert state is not None
        values: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in steps])
            for name in ("bonds", "force", "slider")
        }
        for name in ("peak", "peak_at", "work", "lost", "old"):
            values[f"step_{name}"] = np.array([getattr(one, name) for one in steps])
        values |= {
            "step_points": np.array([one.times.size for one in self.segments]),
            "step_load": np.array([one.load for one in contacts]),
            "step_area": np.array([one.area for one in contacts]),
            "temperature": np.concatenate(
                [one.temperatures(request.temperature) for one in self.segments]
            ),
            "step_speed": np.array([one.speed for one in self.segments]),
            "sites": state.state.size,
            "events": state.formed[-1] + state.broken[-1],
        }
        for name, value, _, _ in self.protocol.measure(steps):
            values[name] = np.float64(value)
        return values, made, [*notes]

    def expected(
        self, sites: float, kinetics: Mapping[str, float], replicas: int
    ) -> dict[str, float]:
        """See :meth:`chemage.plugin.AgeingMethod.expected`: as of one rest."""
        return {
            name: value * (1 if name == "bytes" else replicas)
            for name, value in kinetics.items()
        }
