"""A programme of steps on every replica: one state of the contact goes from step to step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, reduce
from typing import Any, TypeAlias

import numpy as np

from chemage import (
    ChemageError,
    Chemistry,
    ContactSolution,
    InputError,
    ReactionLattice,
    solve_contact,
)
from chemage.plugin import (
    ABSENT,
    EV_PER_GPA_NM3,
    AgedReplica,
    AgeingRequest,
    BondHistory,
    Choice,
    ContactSolver,
    Doubt,
    Engine,
    Kinetics,
    Origin,
    Output,
    PullHistory,
    Ramp,
    build_lattice,
    pull,
    run_kinetics,
    steadiness,
)
from chemage_history.steps import (
    LAST,
    Protocol,
    Segment,
    Slider,
    StepOutcome,
    segments,
)

#: what is kept beside the bonds, and what the protocol measures
OUTPUTS = {
    "slider": Output("hold_time", "nm", "way of the slider"),
    "step_points": Output("step", "", "times that are recorded of each step"),
    "step_load": Output("step", "nN", "load at the end of each step"),
    "step_area": Output("step", "nm2", "contact area at the end of each step"),
    "temperature": Output("hold_time", "K", "temperature"),
    "step_speed": Output(
        "step", "nm/s", "speed of the drive at the end of each step"
    ),
    "step_peak": Output("step", "nN", "largest force of the drive in each step"),
    "step_peak_at": Output("step", "nm", "way of the slider in each step to there"),
    "step_work": Output("step", "nN nm", "work of the drive in each step"),
    "step_old": Output(
        "step", "", "bonds at the end, on the first contact's sites"
    ),
    "step_lost": Output("step", "", "bonds lost as the load changed"),
}


State: TypeAlias = BondHistory | PullHistory
#: a contact, and what reacts on it
Reacting: TypeAlias = tuple[ContactSolution, Chemistry]


def state_of(
    state: State, before: ReactionLattice, after: ReactionLattice
) -> State:
    """The state of a contact whose sites have the barriers of ``after``: those that left have lost their bonds, and all
    keep their partners, stretch, clock and counters."""
    state = state.without(after.forming >= ABSENT / 2)
    if (occupied := state.resume.get("occupied")) is None:
        return state
    # of more than two states, sites that come into contact are as new
    absent = np.maximum(before.forming, after.forming) >= ABSENT / 2
    occupied = np.where(absent, -1, occupied)
    return state.model_copy(
        update={"resume": {**state.resume, "occupied": occupied}}
    )


def pulls(segment: Segment, state: State | None) -> bool:
    """Whether a step is a pull: once it has been driven, a contact at rest keeps the stretch of its bonds."""
    return segment.driven or isinstance(state, PullHistory)


def follow(
    segment: Segment,
    lattice: ReactionLattice,
    state: State | None,
    engine: Engine,
    drive: Slider | None,
    *,
    temperature: float,
    **how: Any,
) -> State:
    """One step of a replica from its ``state``: by the ``engine``, or of a pull by that of the ``drive``.

    ``temperature``: K, where the step has none; ``how``: seed, and where they are known contact and chemistry.
    """
    first, last = segment.first, segment.last
    how["temperature"] = first.temperature or temperature
    ramps = {
        name: to
        for name in ("temperature", "speed")
        if (to := getattr(last, name)) != getattr(first, name)
    }
    if ramps:
        how["ramp"] = Ramp(**ramps)
    how["start"] = state
    if not pulls(segment, state):
        rested = run_kinetics(engine, lattice, segment.times, **how)
        return in_contact(rested, lattice)
    assert drive is not None
    # every step is a pull of its own, with its own peak
    if isinstance(state, PullHistory):
        how["start"] = state.handed_on()
    return pull(drive.engine, lattice, drive.at(first), segment.times, **how)


def largest_energy(drive: Slider | None, chemistry: Chemistry) -> float:
    """nN nm, in a bond whose barrier to breaking, one in a million is higher, the force has just removed."""
    if drive is None or chemistry.breaking is None or not drive.bond_stiffness:
        return 0.0
    barrier = chemistry.breaking.quantile(np.array([1 - 1e-6]))[0] / EV_PER_GPA_NM3
    force = barrier / (drive.exponent * drive.transition_distance)
    return float(force**2 / drive.bond_stiffness / 2)


def in_contact(history: BondHistory, lattice: ReactionLattice) -> BondHistory:
    """The same without the sites that are not in contact in the numbers of sites in each state: these are in the one in
    which sites begin."""
    name = f"sites_{(lattice.states or ['free'])[lattice.initial or 0]}"
    if name not in history.observables:
        return history
    absent = np.count_nonzero(lattice.forming >= ABSENT / 2)
    counts = history.observables[name] - absent
    return history.model_copy(
        update={"observables": {**history.observables, name: counts}}
    )


def recorded_of(
    one: StepOutcome, contact: ContactSolution, kelvin: float
) -> dict[str, Any]:
    """What is recorded of a step, which ends on this contact; ``kelvin``: temperature where it has none."""
    segment = one.segment
    values = {
        **vars(one),
        "temperature": segment.along("temperature", segment.times, kelvin),
        "points": segment.times.size,
        "load": contact.load,
        "area": contact.area,
        "speed": segment.last.speed,
    }
    return {
        name: values[name.removeprefix("step_")]
        for name in ("bonds", "force", *OUTPUTS)
    }


def last_force(segment: Segment, solver: ContactSolver, surface: Any) -> float:
    """The load at the end of a step, nN."""
    force = solver.normal_force(segment.last.load, surface)
    if segment.contacts and type(force) is not float:
        raise InputError(
            "load: a ramp ends at a force or a nominal pressure, not at a contact that is to be found"
        )
    return force


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
    sites = reduce(np.union1d, (lattice.sites for lattice in lattices))
    return [
        lattice if lattice.sites.size == sites.size else _embedded(lattice, sites)
        for lattice in lattices
    ]


def _embedded(lattice: ReactionLattice, sites: np.ndarray) -> ReactionLattice:
    if lattice.positions is not None:
        raise InputError(
            "load: sites at positions of their own need one load; give a site_density without them"
        )
    at = np.searchsorted(sites, lattice.sites)
    numbers = np.append(at, -1)
    empty = {
        "forming": ABSENT,
        "transition_barriers": ABSENT,
        "breaking": 1.0,
        "neighbours": -1,
    }
    changed: dict[str, Any] = {"sites": sites}
    for name, (dims, _, _) in lattice.arrays.items():
        values = getattr(lattice, name)
        if values is None or dims[0] != "site" or name == "sites":
            continue
        full = np.full(
            (sites.size, *values.shape[1:]), empty.get(name, 0), values.dtype
        )
        full[at] = numbers[values] if name == "neighbours" else values
        changed[name] = full
    return lattice.model_copy(update=changed)


class Programme(Kinetics):
    """Every replica is followed through all steps; its times are those of the steps.

    It belongs to the section ``[protocol]`` and has no role. Its cost is stated as of one rest.
    """

    kind = "programme"
    observes = False
    ruptures = False
    shows_sites = False
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
        if self.drive is None and any(one.driven for one in found):
            raise InputError("a speed needs [drive], which says how bonds yield")
        return found

    def times(self) -> np.ndarray:
        """(m,) s, of all steps."""
        return np.concatenate([one.times for one in self.segments])

    @property
    def driven(self) -> bool:
        """Whether any step has a speed."""
        return any(one.driven for one in self.segments)

    def check_sections(self, parts: Mapping[str, Any]) -> None:
        """Refuse steps that are not complete, and a scene whose sections contradict them."""
        chemistry, solver = parts["chemistry"], parts["contact"]
        if self.driven and chemistry.breaking is None:
            raise InputError("bonds last, so that nothing slides; give [breaking]")
        if self.driven and chemistry.states is not None:
            raise InputError(
                "a drive pulls at sites that are free or bonded; leave out the transitions, or the speeds"
            )
        if not parts["engine"].restart:
            raise InputError(
                "the engine cannot go on from a history; use another one"
            )
        pressures = any(isinstance(one.last.load, str) for one in self.segments)
        surface = parts["surface"].expected() if pressures else {}
        for number, one in enumerate(self.segments):
            try:
                if one.first.humidity is not None:
                    chemistry.replace(humidity=one.first.humidity)
                softened(solver, one.first.hardness_ratio)
                if one.last.load is not None:
                    last_force(one, solver, surface)
            except ChemageError as error:
                raise InputError(f"step {number}: {error}") from error

    def doubts(
        self, parts: Mapping[str, Any], stated: Mapping[str, Any]
    ) -> Iterator[Doubt]:
        """Say of which steps the steady friction will not be steady, or be an upper bound, as far as barriers and the
        distance of the partners tell."""
        chemistry, hold, drive = parts["chemistry"], parts["hold"], self.drive
        if drive is None or not drive.bond_stiffness or not self.driven:
            return
        spacing = 0.0
        if drive.partner == "renewed" and parts.get("grids"):
            (pixels, _), (sites, _) = parts["grids"]
            spacing = (
                drive.spacing or stated["surface"]["pixel_size"] * pixels / sites
            )
        longest = (
            2 * largest_energy(drive, chemistry) / drive.bond_stiffness
        ) ** 0.5
        count = hold.replicas * stated.get("chemistry", {}).get("sites", math.nan)
        for number, one in enumerate(self.segments):
            if not one.driven:
                continue
            time = float(np.ptp(one.times)) * LAST
            slip = time * (one.first.speed + one.last.speed) / 2
            if slip < spacing + longest:
                yield Doubt(
                    f"short step {number}",
                    f"step {number}: its steady friction is the mean over its last {slip:.3g} nm of slip, but only after "
                    f"{spacing + longest:.3g} nm no bond and no partner of its beginning is left; give a distance of "
                    f"{(spacing + longest) / LAST:.3g} nm or more",
                )
            shift = -chemistry.activation_volume * EV_PER_GPA_NM3
            shift *= stated.get("chemistry", {}).get("pressure", 0.0)
            edges = np.append(0.0, np.geomspace(1e-12, 1.0, 1200))
            forming = chemistry.forming.quantile((edges[1:] + edges[:-1]) / 2)
            kelvin = one.first.temperature or hold.temperature
            rates = chemistry.rates(forming + shift, kelvin)
            # one bond at most with each partner, or one after the other
            occupied = (spacing or longest) * time / slip
            bonds = time * rates / (1 + rates * occupied)
            expected = count * float(np.dot(np.diff(edges), bonds))
            if expected < steadiness.FEWEST_BONDS / 2:
                yield Doubt(
                    f"few bonds in step {number}",
                    f"step {number}: about {expected:.2g} bonds form in the last {slip:.3g} nm of slip, so that its steady "
                    "friction will be an upper bound; slide slower or further, or give more replicas",
                )

    def shared(self, request: AgeingRequest) -> list[list[Reacting]]:
        """The contacts of each step, several where its load changes meanwhile, each solved from the one before; of
        conditions that come back the same one, unless the contact remembers. And the chemistry at the humidity."""
        if not np.array_equal(request.hold_times, self.times()):
            raise InputError("hold_times: are not those of the steps; give times()")
        contact, solver, surface = request.solution, request.solver, request.surface
        solved: dict[Any, ContactSolution] = {(contact.load, 1.0): contact}
        chemistries: dict[Any, Chemistry] = {None: request.chemistry}
        found: list[list[Reacting]] = []
        for segment in self.segments:
            ratio, load = segment.first.hardness_ratio, segment.first.load
            if (humidity := segment.first.humidity) not in chemistries:
                wet = request.chemistry.replace(humidity=humidity)
                chemistries[humidity] = wet
            chemistry = chemistries[humidity]
            load = contact.load if load is None else load
            if surface is None or solver is None:
                if segment.contacts or (load, ratio) not in solved:
                    raise InputError(
                        "load: to change it, give the surface and the solver"
                    )
                found.append([(contact, chemistry)])
                continue
            loads = [load]
            if segment.contacts:
                ends = contact.load, last_force(segment, solver, surface)
                loads = np.linspace(*ends, segment.contacts + 1).tolist()
            found.append([])
            for load in loads:
                if (load, ratio) not in solved:
                    flowed = contact.plastic_displacement is not None
                    if flowed:
                        surface = contact.residual_surface(surface)
                    softer = softened(solver, ratio)
                    contact = solve_contact(softer, surface, load, start=contact)
                    solved = {} if solver.adheres or flowed else solved
                    both = (load, ratio), (contact.load, ratio)
                    solved |= dict.fromkeys(both, contact)
                contact = solved[load, ratio]
                found[-1].append((contact, chemistry))
        return found

    def _notes(self, contacts: list[list[Reacting]]) -> Iterator[str]:
        """What users should know of the numbers, in words."""
        if self.driven:
            yield "friction is the force of the drive, not a drop by a hold"
        if len({contact.load for each in contacts for contact, _ in each}) > 1:
            yield "friction coefficients are over the load of the scene"

    def replica(
        self, request: AgeingRequest, number: int, shared: list[list[Reacting]]
    ) -> AgedReplica:
        """Follow a replica through all steps, on the ``shared`` contacts."""
        seeds = request.seeds(number)
        kelvin = request.temperature
        pairs = {(id(a), id(b)): (a, b) for each in shared for a, b in each}
        built = [build_lattice(b, a, seeds.disorder) for a, b in pairs.values()]
        on = dict(zip(pairs, on_all_sites(built), strict=True))
        state, lattice = None, next(iter(on.values()))
        there = lattice.forming < ABSENT / 2
        origin = Origin().then(*built)
        steps: list[StepOutcome] = []
        rows: list[dict[str, Any]] = []
        for segment, each in zip(self.segments, shared, strict=True):
            parts, lost = [], 0
            pieces = zip(segment.parts(kelvin), each, strict=True)
            for piece, (contact, chemistry) in pieces:
                before, lattice = lattice, on[id(contact), id(chemistry)]
                if state is not None and lattice is not before:
                    broken = state.broken[-1]
                    state = state_of(state, before, lattice)
                    lost += int(state.broken[-1] - broken)
                at = f"-{len(parts):03d}" if segment.contacts else ""
                state = request.kept(
                    f"replica-{number:05d}-step-{len(steps):03d}{at}",
                    PullHistory if pulls(piece, state) else BondHistory,
                    [self.todict(), lattice.digest()],
                    follow,
                    piece,
                    lattice,
                    state,
                    request.engine,
                    self.drive,
                    temperature=kelvin,
                    seed=seeds.noise,
                    contact=contact,
                    chemistry=chemistry,
                )
                parts.append(state)
                origin = origin.then(state)
            state = parts[-1]
            if segment.contacts:
                state = state.of_parts(parts)
            old = int(np.count_nonzero(state.state & there))
            one = StepOutcome.of(
                segment,
                state,
                largest_energy(self.drive, request.chemistry),
                lost=lost,
                old=old,
            )
            steps.append(one)
            rows.append(recorded_of(one, each[-1][0], kelvin))
            for name, axis in state.time_axes().items():
                if axis == 0:
                    rows[-1][name] = state.observables[name]
        assert state is not None
        values: dict[str, Any] = {
            name: np.concatenate([np.atleast_1d(row[name]) for row in rows])
            for name in rows[0]
            if all(name in row for row in rows)
        }
        outputs = {
            name: Output(**state.outputs[name])
            for name in values
            if name in state.outputs
        }
        outputs |= {**OUTPUTS, **self.protocol.outputs}
        for one in self.protocol.measure(steps):
            values[one.name] = np.float64(one.value)
        if not self.driven:
            del outputs["slider"]
        notes = (*origin.notes, *self._notes(shared))
        return AgedReplica(
            values["bonds"],
            state.events,
            state.state.size,
            values["force"] if self.driven else None,
            {name: values[name] for name in outputs},
            outputs,
            origin._replace(notes=notes),
        )
