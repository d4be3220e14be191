"""Steps with slip: equal sites against the transport equation of the stretch of their bonds; loads, chains, protocols."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from pulled_models import KT, Independent, Transport, drive_of, lattice_of
from rows_in_contact import Rows
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

import chemage as ca
from chemage.plugin import PullHistory, Ramp, pull, run_kinetics
from chemage_history import HistoryStep, Programme, Slider
from chemage_history.programme import follow, on_all_sites, state_of
from chemage_history.steps import Conditions, Segment, segments

SLIDER = Slider(bond_stiffness=10, transition_distance=0.05, partner="kept", shape="constant")


def at(speed: float, spring: float | None = None):
    """What pulls at this speed."""
    return SLIDER.at(Conditions(speed=speed, spring=spring or "rigid"))


def slip_programme(k_on: float, speed: float, sites: float = np.inf, holds: Sequence[str] = ("short", "long")):
    """Of equal sites: slide, then each hold and slide, then the speed times and over ten. The model; of each figure its
    mean by the transport equation, nN per site, and the variance of a site, None of means over time; and the steps:
    their speed, and the times in them that are seen. The first is the longer the fewer ``sites`` there are.

    Extremes are compared at the time at which they are expected: the largest of a force that fluctuates is larger than
    its mean.
    """
    model = Independent(speed, drive_of(speed), 0.8, KT * np.log(1e13 / k_on))
    faster = Independent(10 * speed, drive_of(10 * speed), 0.8, model.forming)
    stretch = model.mean_stretch
    cycles = max(24.0, 1e5 * (1 + speed / (k_on * stretch)) / sites)
    expected = Transport(model)
    exact: dict[str, tuple[float, float | None]] = {"steady": (model.mean_force, None)}
    steps = [(speed, np.array([0.0, 0.5, 1.0]) * cycles * stretch / speed)]

    def add(name: str, moving: float, fine: np.ndarray, pick) -> None:
        """A step, and the time in it of what is compared: ``pick`` gives its place."""
        moments = expected.run(moving, fine)
        at = pick(moments[:, 0])
        steps.append((moving, np.append(0.0, np.unique(fine[[at, -1]]))))
        exact[name] = (moments[at, 0], moments[at, 1])

    way = 8 * stretch * np.linspace(0, 1, 2001)
    rest = stretch / speed / 3
    # the long one so long that free sites bind
    long = max(3 / model.k_on, stretch / speed)
    fine = {"short": np.geomspace(1e-4, 1, 400) * rest, "long": np.geomspace(1e-4 * rest, long, 1500)}
    for hold in holds:
        add(f"after a {hold} hold", 0.0, np.append(0, fine[hold]), lambda force: -1)
        add(f"peak after a {hold} hold", speed, way / speed, np.argmax)
    on = 8 * faster.mean_stretch * np.linspace(0, 1, 2001)
    add("peak of the step up", 10 * speed, on / speed / 10, np.argmax)
    add("faster", 10 * speed, 2 * on / speed / 10, lambda force: 1000)
    exact["faster"] = (faster.mean_force, None)
    soon = np.linspace(0, stretch, 1001)[:-1]
    add("least of the step down", speed, np.append(soon, np.linspace(stretch, 16 * stretch, 1001)) / speed, np.argmin)
    add("slower", speed, 2 * way / speed, lambda force: 1000)
    exact["slower"] = (model.mean_force, None)
    return model, exact, steps


def slip_figures(k_on: float, speed: float, sites: int, replicas: int) -> dict[str, tuple[float, float]]:
    """Each figure of `slip_programme` over that of the transport equation, less 1, and its standard error.

    A figure at one time has the exact error of independent sites; a mean over time that of replicas.
    """
    n = sites // replicas
    model, exact, steps = slip_programme(k_on, speed, sites)
    lattice, found = lattice_of(n, model.forming, 0.8), {name: [] for name in exact}
    peaks = []
    for seed in range(replicas):
        state, before = None, 0.0
        for name, (moving, times) in zip(exact, steps, strict=True):
            at = Conditions(speed=moving, spring="rigid")
            segment = Segment(before + times, at, at)
            before += times[-1]
            state = follow(segment, lattice, state, ca.engine("independent"), SLIDER, temperature=300, seed=seed)
            if exact[name][1] is None:
                found[name].append(np.diff(state.work)[-1] / np.diff(times)[-1] / moving / n)
            else:
                found[name].append(state.force[1] / n)
            if name == "peak after a long hold":
                peaks.append(state.peak / n)
    answer = {}
    for name, (value, variance) in exact.items():
        spread = np.var(found[name], ddof=1) if variance is None else variance / n
        answer[name] = (np.mean(found[name]) / value - 1, (spread / replicas) ** 0.5 / value)
    value, variance = exact["peak after a long hold"]
    answer["largest of a replica"] = (np.mean(peaks) / value - 1, (variance / n) ** 0.5 / value)
    return answer


@pytest.mark.parametrize(
    ("k_on", "speed", "sites"),
    [(1e3, 1e3, 100_000)]
    + [
        pytest.param(*case, marks=pytest.mark.long)
        for case in [
            (1.0, 0.01, 100_000),
            (1.0, 1.0, 1_000_000),
            (1e2, 1.0, 60_000),
            (1e2, 1e2, 600_000),
            (1e4, 0.1, 50_000),
            (1e4, 1e2, 60_000),
            (1e4, 1e4, 500_000),
        ]
    ],
)
def test_slide_hold_slide_and_velocity_steps_against_the_transport_equation(k_on, speed, sites):
    """Steady force, force after a short and a long hold, peaks of sliding again, and a velocity step up and down."""
    found = slip_figures(k_on, speed, sites, 20)
    name, (off, error) = found.popitem()
    # the largest force of a replica is not less than the force where it is largest in the mean
    assert off > -4.5 * error, name
    for name, (off, error) in found.items():
        assert abs(off) <= 4.5 * error, (name, off, error)


def peak_after_rest(k_on: float, speed: float, n: int, seed: int = 0) -> tuple[float, float, float, float]:
    """Force per site of n sites in a pull that begins with all of them bonded, when it is largest in the mean: of the
    engine, of the transport equation, its standard error, and κ max(sS)."""
    model = Independent(speed, drive_of(speed), 0.8, KT * np.log(1e13 / k_on))
    fine = np.linspace(0, 8 * model.mean_stretch / speed, 4001)
    moments = Transport(model, 1.0).run(speed, fine)
    at = int(np.argmax(moments[:, 0]))
    lattice, drive = lattice_of(n, model.forming, 0.8), drive_of(speed)
    pulled = pull(SLIDER.engine, lattice, drive, fine[[at]], temperature=300, seed=seed, start=np.ones(n, bool))
    mean, variance = moments[at]
    return pulled.force[-1] / n, mean, (variance / n) ** 0.5, model.peak_of_old_bonds


@pytest.mark.parametrize(("speed", "low", "high"), [(10.0, 0.999, 1.001), (1.0, 0.999, 1.01), (1e-3, 1.4, 2.0)])
def test_the_peak_after_a_rest_is_that_of_old_bonds_where_none_form_during_the_pull(speed, low, high):
    """κ max(sS) where k_on × the time of the pull is small, here 0.006 for 10 nm/s; more where it is not."""
    force, mean, error, old = peak_after_rest(1.0, speed, 200_000)
    assert abs(force - mean) < 4.5 * error
    assert low < mean / old < high


def place_of_maximum(k_on: float, bonds: float, replicas: int) -> tuple[float, float, float]:
    """The speed of the largest steady force over k_on, nm: of the closed form, of the engine, and its error.

    The forces at seven speeds over those of the closed form are a quadratic in log V, by which its maximum moves.
    """
    forming = KT * np.log(1e13 / k_on)

    def force(log: float) -> float:
        return Independent(np.exp(log), drive_of(np.exp(log)), 0.8, forming).mean_force

    width = np.log(100.0)
    around = np.log(0.012 * k_on)
    best = minimize_scalar(lambda log: -force(log), bounds=(around - width, around + width), method="bounded")
    logs = best.x + np.linspace(-1.5, 1.5, 7)
    ratios = np.empty((replicas, logs.size))
    for column, log in enumerate(logs):
        speed = float(np.exp(log))
        model = Independent(speed, drive_of(speed), 0.8, forming)
        cycle = model.mean_stretch + speed / k_on
        n = int(bonds * cycle / model.mean_stretch / replicas)
        times = np.array([20, 60]) * cycle / speed
        for seed in range(replicas):
            how = {"temperature": 300, "seed": seed}
            pulled = pull(SLIDER.engine, lattice_of(n, forming, 0.8), drive_of(speed), times, **how)
            work = np.diff(pulled.work)[0] / (np.diff(times)[0] * speed * n)
            ratios[seed, column] = work / model.mean_force - 1

    def maximum(ratio: np.ndarray) -> float:
        fit = np.polynomial.Polynomial.fit(logs, ratio, 2)
        found = minimize_scalar(lambda log: -force(log) * (1 + fit(log)), bounds=(logs[0], logs[-1]), method="bounded")
        return float(np.exp(found.x))

    left = [maximum(np.delete(ratios, seed, axis=0).mean(axis=0)) for seed in range(replicas)]
    error = np.std(left) * (replicas - 1) ** 0.5
    return float(np.exp(best.x)) / k_on, maximum(ratios.mean(axis=0)) / k_on, float(error) / k_on


@pytest.mark.long
@pytest.mark.parametrize(("k_on", "place"), [(1.0, 0.0229), (1e3, 0.0105)])
def test_the_place_of_schallamachs_maximum(k_on, place):
    exact, found, error = place_of_maximum(k_on, 2e4, 10)
    assert exact == pytest.approx(place, rel=0.005)
    assert abs(found - exact) < 4.5 * error
    assert error < 0.05 * exact


def test_a_rest_keeps_the_stretch_of_bonds_and_the_force_of_the_spring():
    """At rates of zero nothing changes; a bond that survives the rest goes on from its stretch, a new one has none."""
    lattice = lattice_of(200, 3.0, 2.0)
    start = pull(SLIDER.engine, lattice, at(10.0), [0.01], temperature=300, start=np.arange(200) < 120)
    for spring in (None, 300.0):
        drive = SLIDER.replace(spring=spring)
        steps = [HistoryStep(speed=0, duration=5.0), HistoryStep(speed=10, distance=0.01)]
        state = start
        for segment in segments(steps):
            segment = replace(segment, times=segment.times + start.time)
            state = follow(segment, lattice, state, ca.engine("auto"), drive, temperature=300)
            if not segment.driven:
                np.testing.assert_array_equal(state.stretch, start.stretch)
                assert state.force[-1] == pytest.approx(start.force[-1], rel=1e-12)
        assert state.force[-1] > start.force[-1]
        assert (state.stretch[:120] >= start.stretch[:120]).all()
    young = lattice_of(200, 0.6, 2.0)
    state = pull(SLIDER.engine, young, at(0.0), [1.0], temperature=300, start=start)
    assert state.state.all()
    assert not state.stretch[120:].any()
    np.testing.assert_array_equal(state.stretch[:120], start.stretch[:120])


@pytest.mark.parametrize("spring", [None, 50.0])
def test_sites_that_leave_take_their_share_of_the_force(spring):
    lattice = lattice_of(100, 3.0, 2.0)
    half = np.arange(100) < 50
    less = lattice.model_copy(update={"forming": np.where(half, 3.0, 1000.0)})
    drive = at(10.0, spring)
    before = pull(SLIDER.engine, lattice, drive, [0.02], temperature=300, start=np.ones(100, bool))
    state = state_of(before, lattice, less)
    assert state.fault() == ""
    after = pull(
        SLIDER.engine, less, drive.replace(speed=0), state.time + np.array([0.0, 1e-9]), temperature=300, start=state
    )
    assert after.fault() == ""
    assert (after.bonds[-1], after.broken[-1]) == (50, 50)
    if spring is None:
        assert after.force[-1] == pytest.approx(before.force[-1] / 2, rel=1e-9)
    else:
        # the spring pulls the slider on until it is in balance with the bonds that are left
        held = before.force[-1]
        stiffness = 50 * 10.0
        way = (held - held / 2) / (stiffness + spring)
        assert after.displacement[-1] - before.displacement[-1] == pytest.approx(way, rel=1e-6)
        assert after.force[-1] == pytest.approx(held - spring * way, rel=1e-6)
    back = state_of(after, less, lattice)
    np.testing.assert_array_equal(back.state, after.state)
    np.testing.assert_array_equal(back.stretch, after.stretch)


# -- chains -----------------------------------------------------------------------------------------------------------


def random_steps(rng: np.random.Generator) -> list[dict]:
    """Rests and slips under loads, temperatures and springs, some of which go linearly in time."""
    steps = []
    for _ in range(rng.integers(2, 9)):
        driven = rng.random() < 0.5
        step = {"distance": rng.uniform(0.05, 0.5)} if driven else {"duration": 10 ** rng.uniform(-3, 1)}
        speed = 10 ** rng.uniform(0, 4) if driven else 0.0
        step["speed"] = {"to": speed} if driven and rng.random() < 0.3 else speed
        if rng.random() < 0.5:
            load = rng.uniform(5, 120)
            step["load"] = {"to": load, "contacts": int(rng.integers(1, 4))} if rng.random() < 0.3 else load
        if rng.random() < 0.5:
            kelvin = rng.uniform(280, 320)
            step["temperature"] = {"to": kelvin} if rng.random() < 0.5 else kelvin
        if rng.random() < 0.3:
            step["spring"] = str(rng.choice(["rigid", "500 nN/nm"]))
        steps.append({**step, "points": int(rng.integers(3, 12))})
    return steps


class SeenProgramme(Programme):
    """Its seeds are seen."""

    seeds: ClassVar[list] = []

    def age(self, request):
        self.seeds.append(request.seeds(0))
        return super().age(request)


class ChainTrial:
    """A random programme on up to 72 sites, at once, by hand, and stopped and resumed."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.seed, self.solver = seed, Rows()
        self.surface = ca.Surface(heights=np.zeros((12, 6)), pixel_size=1.7, periodic=True)
        self.contact = self.solver.solve(self.surface, 60.0)
        kinds = ["auto", "rejection-free", "bkl", "next-reaction", "independent"]
        self.engine = ca.engine(str(rng.choice(kinds)))
        pairs = ca.interaction("elastic-pairs", strength=0.05, bias=0.1)
        self.chemistry = ca.chemistry(
            forming=ca.barriers("gaussian", mean=0.65, std=0.05),
            breaking=ca.barriers("gaussian", mean=0.8, std=0.03),
            activation_volume=0.0064,
            interaction=pairs if self.engine.interacting and rng.random() < 0.6 else None,
            site_density="pixel",
        )
        self.slider = SLIDER.replace(partner=str(rng.choice(["kept", "renewed"])))
        self.programme = SeenProgramme(protocol={"kind": "steps", "step": random_steps(rng)}, drive=self.slider)

    def at_once(self, **options):
        return ca.age(
            self.contact, self.chemistry, engine=self.engine, hold_times=self.programme.times(), temperature=300,
            replicas=1, seed=self.seed, method=self.programme, surface=self.surface, solver=self.solver, **options,
        )  # fmt: skip

    def by_hand(self, whole) -> None:
        """Every step by the engine itself, in one piece and in two."""
        seeds = SeenProgramme.seeds[-1]
        pieces = []
        for segment in self.programme.segments:
            load = 60.0 if segment.first.load is None else segment.first.load
            loads = np.linspace(load, segment.last.load, segment.contacts + 1) if segment.contacts else [load]
            parts = [*segment.parts(300.0)] if segment.contacts else [segment]
            pieces += [(segment, part, float(load)) for part, load in zip(parts, loads, strict=True)]
        contacts = {load: self.solver.solve(self.surface, load) for _, _, load in pieces}
        built = [self.chemistry.on(contact, seeds.disorder) for contact in contacts.values()]
        lattices = dict(zip(contacts, on_all_sites(built), strict=True))
        state, cut, before, bonds = None, None, None, []
        for segment, part, load in pieces:
            lattice, times = lattices[load], part.times
            first, last = part.first, part.last
            if before is not None and lattice is not before:
                state, cut = (one.without(lattice.forming > 500) for one in (state, cut))
            before = lattice
            how = {
                "temperature": first.temperature or 300.0, "seed": seeds.noise,
                "contact": contacts[load], "chemistry": self.chemistry,
            }  # fmt: skip
            heated = last.temperature != first.temperature
            moves = first.speed + last.speed > 0 or isinstance(state, PullHistory)
            ramped = heated or first.speed != last.speed
            if ramped:
                kelvin = last.temperature if heated else None
                how["ramp"] = Ramp(kelvin, speed=last.speed if first.speed != last.speed else None)

            def run(start, times, lattice=lattice, moves=moves, first=first, how=how):
                if moves:
                    return pull(self.slider.engine, lattice, self.slider.at(first), times, start=start, **how)
                return run_kinetics(self.engine, lattice, times, start=start, **how)

            def own(start):
                return start.handed_on() if isinstance(start, PullHistory) else start

            state = run(own(state), times)
            cut = own(cut)
            for time in [times] if ramped else np.split(times, [int(self.rng.integers(1, times.size))]):
                if time.size:
                    cut = run(cut, time)
            names = ("state", "stretch", "forming", "breaking") if moves else ("state",)
            # whatever partner a site that is not in contact comes to
            assert not state.state[lattice.forming > 500].any()
            for name in names:
                np.testing.assert_array_equal(getattr(state, name), getattr(cut, name))
            assert state.bonds[-1] == cut.bonds[-1]
            if moves:
                assert (state.force[-1], state.work[-1], state.peak) == (cut.force[-1], cut.work[-1], cut.peak)
            bonds.append(state.bonds[:-1] if segment.contacts else state.bonds)
            if segment.contacts:
                # what is pending at the end of a ramp is no event of the step that follows
                state, cut = state.handed_on(), cut.handed_on()
        np.testing.assert_array_equal(whole.bonds[0], np.concatenate(bonds))
        if moves:
            assert whole.friction_drop[0, -1] == state.force[-1]
        assert whole.observables["step_load"][0, -1] == load

    def resumed(self, whole, folder) -> None:
        """Steps that were not finished are run again."""
        self.at_once(checkpoints=folder)
        files = sorted(folder.glob("replica-*"))
        assert files
        for file in files[int(self.rng.integers(0, len(files))) :]:
            file.unlink()
        assert self.at_once(checkpoints=folder).digest() == whole.digest()


def chain_trial(seed: int, folder) -> None:
    """The same bytes whatever the way."""
    folder.mkdir(exist_ok=True)
    trial = ChainTrial(seed)
    whole = trial.at_once()
    trial.by_hand(whole)
    trial.resumed(whole, folder)


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(4, 12))])
def test_random_programmes_at_once_by_hand_and_in_pieces(seed, tmp_path):
    chain_trial(seed, tmp_path)


@pytest.mark.campaign
@pytest.mark.long
def test_two_hundred_random_programmes(tmp_path):
    for seed in range(100, 300):
        chain_trial(seed, tmp_path / str(seed))


@pytest.mark.parametrize(
    ("kind", "partner"),
    [("rejection-free", "kept"), pytest.param("pull", "renewed", marks=pytest.mark.long)]
    + [pytest.param(kind, "kept", marks=pytest.mark.long) for kind in ("bkl", "next-reaction", "independent", "pull")],
)
def test_noise_of_steps_with_one_seed_is_uncorrelated(kind, partner):
    """Every step has the equilibrium at its end, so that bonds of different steps have nothing but noise in common."""
    chemistry = ca.chemistry(
        forming={"kind": "gaussian", "mean": 0.7, "std": 0.0}, breaking={"kind": "gaussian", "mean": 0.7, "std": 0.0},
        site_density="pixel",
    )  # fmt: skip
    loads, replicas = [100.0, 50.0, 100.0, 150.0, 100.0, 100.0], 300
    steps = [{"load": load, "duration": 1.0, "points": 1} for load in loads]
    steps[4]["temperature"] = {"to": 300.0}
    drive = SLIDER.replace(partner=partner)
    if kind == "pull":
        # by so little that no bond notices
        steps[0] |= {"speed": 1e-6, "duration": 1e-9}
        steps[1]["speed"] = 0.0
        loads, steps = [100.0, *loads], [*steps[:1], {**steps[0], "duration": 1.0}, *steps[1:]]
    flat, solver = ca.Surface(heights=np.zeros((20, 10)), pixel_size=1.0, periodic=True), Rows()
    programme = Programme(protocol={"kind": "steps", "step": steps}, drive=drive)
    found = ca.age(
        solver.solve(flat, loads[0]), chemistry, engine=ca.engine("auto" if kind == "pull" else kind),
        hold_times=programme.times(), temperature=300, replicas=replicas, method=programme, surface=flat, solver=solver,
    )  # fmt: skip
    last = len(loads) - 6
    bonds = np.stack([found.observables[f"bonds_{k}"] for k in range(last, len(loads))])
    for row, load in zip(bonds, loads[last:], strict=True):
        assert abs(row.mean() - 5 * load / 10) < 4.5 * np.sqrt(2.5 * load / 10 / replicas)
        assert row.std() == pytest.approx(np.sqrt(2.5 * load / 10), rel=0.2)
    off = np.corrcoef(bonds)[np.triu_indices(6, 1)]
    assert np.abs(off).max() < 4.2 / np.sqrt(replicas)
    assert np.sum(off**2) * replicas < chi2.isf(1e-4, off.size)


def scene(**changes) -> ca.Scene:
    data = ca.load_scene("silica-afm-tip").todict()
    for name in ("fit", "observe"):
        data.pop(name, None)
    data["hold"] = {"replicas": 2, "temperature": 300}
    data["drive"] = {"bond_stiffness": 10, "transition_distance": 0.03}
    return ca.parse_scene({**data, **changes})


STEPS = [
    {"duration": 1},
    {"speed": 100, "distance": 0.5},
    {"speed": 0, "load": 80, "duration": 1},
    {"speed": 100, "distance": 0.5, "load": 30},
    {"duration": 1, "speed": 0, "temperature": 310},
]


def test_a_scene_of_steps_is_stored_resumed_swept_and_drawn(tmp_path, monkeypatch):
    own = scene(step=STEPS)
    assert ca.parse_scene(own.todict()) == own
    run = ca.run(own, checkpoints=tmp_path / "kept")
    kept = sorted((tmp_path / "kept").glob("replica-*"))
    assert len(kept) == 2 * len(STEPS)
    for file in kept[2:5]:
        file.unlink()
    again = ca.run(own, checkpoints=tmp_path / "kept")
    assert again.ageing.digest() == run.ageing.digest() == ca.run(own).ageing.digest()
    ca.write(tmp_path / "run.h5", run)
    stored = ca.read(tmp_path / "run.h5")
    assert stored.ageing.digest() == run.ageing.digest()
    assert ca.run(stored.scene).ageing.digest() == run.ageing.digest()
    assert stored.fit() is None
    seen = stored.ageing.observables
    assert seen["peak_1"].mean() > seen["steady_1"].mean()
    assert seen["step_lost"][:, 3].min() > 0
    study = ca.sweep({**own.todict(), "sweep": {"step.1.speed": [10, 1000]}}, tmp_path / "sweep")
    assert len({point.summary["observables"]["peak_1"]["mean"] for point in study}) == 2


@pytest.mark.parametrize(
    ("replicas", "slips", "errors"), [(20, 4, 4.0), pytest.param(200, 12, 3.0, marks=pytest.mark.long)]
)
def test_sliding_at_a_constant_speed_becomes_steady(replicas, slips, errors):
    """The mean friction over each 5 nm is that over the last ones, from 5 nm on."""
    step = {"speed": "10 nm/s", "distance": "5 nm", "points": 1}
    steps = [{"duration": 1}, *([step] * slips)]
    seen = ca.run(scene(step=steps, hold={"replicas": replicas, "temperature": 300}), warn=False).ageing.observables
    work = np.array([seen[f"work_{k}"] for k in range(2, slips + 1)])
    for one in work[:-1]:
        change = one - work[-1]
        assert abs(change.mean()) < errors * change.std(ddof=1) / replicas**0.5


def test_the_least_force_of_a_velocity_step_is_that_of_all_events():
    """Whatever times are recorded, it falls between them as well."""
    steps = {"kind": "velocity-steps", "speeds": [1000, 100], "distance": 0.5}
    run = ca.run(scene(protocol=steps, hold={"replicas": 2, "temperature": 400}), warn=False)
    least = run.ageing.observables["transient_1"] + run.ageing.observables["steady_1"]
    recorded = run.ageing.friction_drop[:, -101:].min(axis=1)
    assert (least <= recorded + 1e-9).all()
    assert (least < recorded - 1e-9).any()


def test_a_mean_of_a_measure_of_a_step_is_as_accurate_as_asked():
    """It holds the mean of many other replicas."""
    own = scene(step=STEPS[:2])
    mean = ca.ensemble(own, accuracy={"observable.peak_1": "8 %"})
    peak = mean.estimate("observable.peak_1")
    assert peak.half_width <= 0.08 * peak.value
    many = ca.run(own.with_hold(replicas=100, seed=77), warn=False)
    peaks = many.ageing.observables["peak_1"]
    error = np.hypot(peak.half_width / 2, peaks.std() / peaks.size**0.5)
    assert abs(peak.value - peaks.mean()) < 4 * error


@pytest.mark.long
def test_an_accuracy_of_a_step_is_asked_for_on_the_command_line(tmp_path):
    path = str(tmp_path / "mean.h5")
    command = [
        sys.executable,
        "-m",
        "chemage",
        "run",
        "silica-history",
        "--accuracy",
        "observable.peak_1=10%",
        "-o",
        path,
    ]
    subprocess.run(command, check=True, capture_output=True)
    peak = ca.read(path).estimate("observable.peak_1")
    assert 0 < peak.half_width <= 0.1 * peak.value


@pytest.mark.long
def test_a_mean_over_random_surfaces_whose_load_changes_is_as_accurate_as_asked(tmp_path):
    data = ca.load_scene("silica-patch").todict()
    for name in ("fit", "observe"):
        data.pop(name, None)
    data["surface"] |= {"pixels": 64, "zeta": 10}
    data["contact"]["load"] = 50.0
    data["hold"] = {"temperature": 300}
    ramp = {"load": {"to": 100.0, "contacts": 2}, "duration": 1}
    mean = ca.ensemble({**data, "step": [{"duration": 10}, ramp]}, accuracy={"observable.bonds_1": "20 %"})
    bonds = mean.estimate("observable.bonds_1")
    assert 0 < bonds.half_width <= 0.2 * bonds.value


@pytest.mark.parametrize(
    ("axis", "values", "seen"),
    [("step.3.load.to", [20, 60], "bonds_4")]
    + [
        pytest.param(*case, marks=pytest.mark.long)
        for case in [
            ("step.0.duration", [0.1, 10], "bonds_0"),
            ("step.1.distance", [0.2, 0.8], "work_1"),
            ("step.1.spring", ["100 nN/nm", "rigid"], "work_1"),
            ("step.2.load", [60, "90 nN"], "bonds_2"),
            ("step.3.speed.to", [1e2, 1e4], "peak_3"),
            ("step.4.temperature", [290, "330 K"], "bonds_4"),
            ("drive.bond_stiffness", [5, 10], "peak_1"),
        ]
    ],
)
def test_any_number_of_a_step_is_swept(axis, values, seen, tmp_path):
    ramps = {**STEPS[3], "load": {"to": 30, "contacts": 2}, "speed": {"to": 1000}}
    steps = [*STEPS[:3], ramps, STEPS[4]]
    steps[1] = {**steps[1], "spring": "rigid"}
    study = ca.sweep({**scene(step=steps).todict(), "sweep": {axis: values}}, tmp_path / "sweep")
    assert len({point.summary["observables"][seen]["mean"] for point in study}) == 2


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"step": [{"speed": 3}]}, "step 0: give either duration or distance"),
        ({"step": STEPS, "drive": None}, r"needs \[drive\]"),
        ({"step": [{"duration": "3 nm"}]}, "step.0.duration"),
        ({"step": STEPS, "hold": {"times": [1.0]}}, r"hold.times: \[protocol\] says it; leave this out"),
        ({"step": STEPS, "protocol": {"kind": "heating", "temperatures": [300], "duration": 1}}, "protocol.kind"),
        ({"step": STEPS, "ageing": {"kind": "closure"}}, "the steps follow every site"),
        ({"step": STEPS, "drive": {"bond_stiffness": 10, "transition_distance": 0.03, "speed": 5}}, "drive.speed: 5"),
        ({"step": [{"duration": 1, "load": -5}]}, "step 0: load = -5.0: must be finite and not negative"),
        (
            {"step": [{"duration": 1}, {"duration": 1, "load": "3 nm"}]},
            'step 1: load: "3 nm" is a quantity of nanometer',
        ),
        ({"step": [{"duration": 1, "load": {"to": "5 MPa"}}]}, "step 0: load = '5 MPa': a nominal pressure needs"),
        (
            {"step": [{"duration": 1, "load": {"to": "3 GPa over contact"}}]},
            "step 0: load: a ramp ends at a force or a no",
        ),
        ({"step": [{"duration": 1, "hardness_ratio": 0.5}]}, "step 0: hardness_ratio: this contact has no hardness"),
    ],
)
def test_what_is_wrong_with_a_scene_of_steps(changes, said):
    data = {**scene(step=STEPS).todict(), **changes}
    data = {name: section for name, section in data.items() if section is not None}
    with pytest.raises(ca.plugin.SceneError, match=said):
        ca.parse_scene(data)


def test_a_ramp_of_load_begins_at_the_load_that_was_found(monkeypatch):
    """That of a mean contact pressure is not known before its contact is solved."""
    loads = []

    def seen(*arguments, **options):
        contact = ca.solve_contact(*arguments, **options)
        loads.append(contact.load)
        return contact

    monkeypatch.setattr("chemage_history.programme.solve_contact", seen)
    steps = [{"duration": 1, "load": "3 GPa over contact"}, {"duration": 1, "load": {"to": "40 nN", "contacts": 2}}]
    ca.run(scene(step=steps), warn=False)
    assert loads[1:] == [(loads[0] + 40.0) / 2, 40.0]


def test_protocols_expand_into_steps_and_say_what_they_measure():
    healed = scene(protocol={"kind": "slide-hold-slide", "speed": 100, "distance": 1, "holds": [0.1, 1, 10]})
    run = ca.run(healed)
    seen = run.ageing.observables
    assert run.ageing.hold_times[-1] == pytest.approx(4 * 0.01 + 11.1)
    assert seen["healing_0"].mean() < seen["healing_1"].mean() < seen["healing_2"].mean()
    assert seen["healing_rate"].mean() > 0
    same = Programme(protocol=healed.component("protocol"), drive=healed.component("drive"))
    np.testing.assert_array_equal(same.times(), run.ageing.hold_times)


def test_loads_of_a_rough_contact_and_of_one_that_flows():
    """A load that comes back gives the same elastic contact, so that sites that stay keep their bonds; one that has
    flowed does not flow again."""
    data = ca.load_scene("silica-patch").todict()
    for name in ("fit", "observe"):
        data.pop(name, None)
    data["surface"] |= {"pixels": 64, "zeta": 10}
    data["contact"]["load"] = 50.0
    data["hold"] = {"replicas": 2, "temperature": 300}
    steps = [{"duration": 10}, {"load": 100, "duration": 1e-12}, {"load": 50, "duration": 1e-12}]
    seen = ca.run({**data, "step": steps}, warn=False).ageing.observables
    assert seen["step_area"][0, 1] > seen["step_area"][0, 0] == seen["step_area"][0, 2]
    np.testing.assert_array_equal(seen["bonds_0"], seen["bonds_2"])
    protocol = {"kind": "load-steps", "loads": [50, 100, 50], "durations": [1, 1, 1]}
    data["contact"]["hardness"] = 3.0
    seen = ca.run({**data, "protocol": protocol}, warn=False).ageing.observables
    # the surface that 100 nN has flattened touches more than before
    assert seen["step_area"][0, 0] < seen["step_area"][0, 2] < seen["step_area"][0, 1]
    assert (seen["dip_2"] == 0).all()
    assert seen["step_lost"][:, 2].max() > 0
