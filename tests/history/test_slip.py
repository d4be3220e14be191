"""Steps with slip: equal sites against the transport equation of the stretch of their bonds; loads, chains, protocols."""

from __future__ import annotations

import numpy as np
import pytest
from pulled_models import KB, lattice_of
from scipy.integrate import trapezoid
from scipy.stats import t as student

import chemage as ca
from chemage.plugin import PullHistory, pull, run_kinetics
from chemage_history import HistoryStep, Programme, Slider
from chemage_history.programme import follow, state_of
from chemage_history.steps import Segment, StepOutcome, segments

KT = KB * 300.0
EV_NM = 0.1602176634
SLIDER = Slider(bond_stiffness=10, transition_distance=0.05, partner="kept", shape="constant")
BREAKING = 0.8


class Transport:
    """∂n/∂t + V ∂n/∂s = −k(s) n, unstretched bonds forming at k_on on free sites: cohorts of bonds on characteristics,
    a second-order step in time."""

    def __init__(self, k_on: float) -> None:
        self.k_on = k_on
        self.stretch, self.amount = np.zeros(0), np.zeros(0)

    def breaking(self, stretch: np.ndarray) -> np.ndarray:
        lowered = 10.0 * stretch * 0.05 / EV_NM
        return 1e13 * np.exp(-np.maximum(BREAKING - lowered, 0.0) / KT)

    @property
    def force(self) -> float:
        return 10.0 * float(self.stretch @ self.amount)

    def run(self, speed: float, times: np.ndarray) -> np.ndarray:
        """(m,) nN per site at each of ``times``, from 0."""
        forces = [self.force]
        for span in np.diff(times):
            way = speed * span
            lasts = np.exp(-span * self.breaking(self.stretch + way / 2))
            free = 1 - self.amount.sum()
            after = 1 - float(self.amount @ lasts)
            # of the new ones half break as soon as they would on average, at half the way
            born = -np.expm1(-self.k_on * span) * (free + after) / 2
            born *= np.exp(-span / 2 * float(self.breaking(np.array([way / 4]))[0]))
            self.stretch = np.append(self.stretch + way, way / 2)
            self.amount = np.append(self.amount * lasts, born)
            if speed == 0 and self.stretch.size > 1 and self.stretch[-2] == 0:
                self.amount[-2] += self.amount[-1]
                self.stretch, self.amount = self.stretch[:-1], self.amount[:-1]
            alive = self.amount > 1e-14
            self.stretch, self.amount = self.stretch[alive], self.amount[alive]
            forces.append(self.force)
        return np.array(forces)


def at(speed: float, spring: float | None = None):
    """What pulls at this speed."""
    return SLIDER.at(Segment(np.zeros(1), None, None, speed, spring or "rigid"))


def slid(lattice, steps, seed=0, engine="independent"):
    """What a lattice of one replica did in each step."""
    state, found = None, []
    for segment in segments(steps):
        state = follow(segment, lattice, state, ca.engine(engine), SLIDER, temperature=300, seed=seed)
        assert state.fault() == ""
        found.append(StepOutcome.of(segment, state))
    return found


@pytest.mark.parametrize(
    ("k_on", "speed"),
    [(1e3, 1e3)]
    + [
        pytest.param(*case, marks=pytest.mark.long)
        for case in [(1e2, 1e1), (1.0, 1e-2), (1.0, 0.3), (1e2, 1e2), (1e4, 1e4), (1e4, 1e2)]
    ],
)
def test_slide_hold_slide_and_velocity_steps_against_the_transport_equation(k_on, speed):
    """Steady force, force after the hold, peak of sliding again, and a velocity step up and down."""
    n, replicas = 10_000, 8
    forming = KT * np.log(1e13 / k_on)
    lattice = lattice_of(n, forming, BREAKING)
    way, hold = 0.6 + 2.0 * speed / k_on, 0.5
    steps = [
        HistoryStep(speed=speed, distance=way),
        HistoryStep(speed=0, duration=hold),
        HistoryStep(speed=speed, distance=way),
        HistoryStep(speed=10 * speed, distance=way),
        HistoryStep(speed=speed, distance=way),
    ]
    model, expected = Transport(k_on), []
    for step in steps:
        moving = step.distance is not None
        span = step.distance / step.speed if moving else step.duration
        fine = np.linspace(0, span, 6001) if moving else np.append(0, np.geomspace(1e-6, 1, 3000) * span)
        expected.append((fine, model.run(step.speed, fine)))
    runs = [slid(lattice, steps, seed) for seed in range(replicas)]

    def compare(what, own, mean):
        own = np.array(own) / n
        # as rare as beyond three standard errors
        error = student.ppf(0.99865, replicas - 1) * own.std(ddof=1) / replicas**0.5
        assert abs(own.mean() - mean) < max(error, 0.01 * mean), (what, own.mean() / mean - 1, error / mean)

    last = expected[0][1][-1500:].mean()
    compare("steady", [run[0].steady for run in runs], last)
    compare("after the hold", [run[1].force[-1] for run in runs], expected[1][1][-1])
    compare("peak", [run[2].peak for run in runs], expected[2][1].max())
    compare("faster", [run[3].steady for run in runs], expected[3][1][-1500:].mean())
    compare("peak of the step up", [run[3].peak for run in runs], expected[3][1].max())
    fine, forces = expected[4]
    seen = np.interp(runs[0][4].segment.times - runs[0][4].segment.times[0], fine, forces)
    least = int(np.argmin(seen))
    compare("least of the step down", [run[4].force[least] for run in runs], seen[least])
    compare("work", [run[2].work for run in runs], speed * trapezoid(expected[2][1], expected[2][0]))
    compare("slower", [run[4].steady for run in runs], expected[4][1][-1500:].mean())
    for run in runs:
        assert 0 < run[2].peak_at < way


def test_a_rest_keeps_the_stretch_of_bonds_and_the_force_of_the_spring():
    """At rates of zero nothing changes; a bond that survives the rest goes on from its stretch, a new one has none."""
    lattice = lattice_of(200, 3.0, 2.0)
    start = pull(SLIDER.engine, lattice, at(10.0), [0.01], temperature=300, start=np.arange(200) < 120)
    for spring in (None, 300.0):
        drive = SLIDER.replace(spring=spring)
        steps = [HistoryStep(speed=0, duration=5.0), HistoryStep(speed=10, distance=0.01)]
        state = start
        for segment in segments(steps):
            moved = segment.times + start.time
            segment = type(segment)(moved, None, None, segment.speed, segment.spring)
            state = follow(segment, lattice, state, ca.engine("auto"), drive, temperature=300)
            if not segment.speed:
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


def random_steps(rng: np.random.Generator) -> list[HistoryStep]:
    steps = []
    for _ in range(rng.integers(2, 9)):
        driven = rng.random() < 0.5
        span = {"distance": rng.uniform(0.05, 0.5)} if driven else {"duration": 10 ** rng.uniform(-3, 1)}
        more = {"temperature": rng.uniform(280, 320)} if rng.random() < 0.4 else {}
        more |= {"spring": rng.choice(["rigid", "500 nN/nm"])} if rng.random() < 0.3 else {}
        speed = 10 ** rng.uniform(0, 4) if driven else 0.0
        steps.append(HistoryStep(speed=speed, points=int(rng.integers(3, 12)), **span, **more))
    return steps


def chain_trial(seed: int) -> None:
    """At once, by hand, and stopped within and after each step and resumed: the same bytes."""
    rng = np.random.default_rng(seed)
    n, steps = int(rng.integers(1, 80)), random_steps(rng)
    forming, breaking = 0.65 + 0.05 * rng.standard_normal(n), 0.8 + 0.03 * rng.standard_normal(n)
    lattice, slider = lattice_of(n, forming, breaking), SLIDER
    kind = str(rng.choice(["auto", "rejection-free", "bkl", "next-reaction", "independent"]))
    engine, state, by_hand, in_pieces = ca.engine(kind), None, None, None
    for segment in segments(steps):
        kelvin = segment.temperature or 300.0
        how = {"temperature": kelvin, "seed": seed}
        state = follow(segment, lattice, state, engine, slider, **how)
        moves = segment.speed > 0 or isinstance(by_hand, PullHistory)
        drive = slider.at(segment)
        if moves:
            begun = by_hand.handed_on() if isinstance(by_hand, PullHistory) else by_hand
            by_hand = pull(slider.engine, lattice, drive, segment.times, start=begun, **how)
        else:
            by_hand = run_kinetics(engine, lattice, segment.times, start=by_hand, **how)
        first = True
        for time in np.split(segment.times, [int(rng.integers(1, segment.times.size))]):
            if moves:
                handed = first and isinstance(in_pieces, PullHistory)
                begun = in_pieces.handed_on() if handed else in_pieces
                in_pieces = pull(slider.engine, lattice, drive, time, start=begun, **how)
            else:
                in_pieces = run_kinetics(engine, lattice, time, start=in_pieces, **how)
            first = False
        assert state.digest() == by_hand.digest()
        for name in ("state", *(("stretch", "forming") if moves else ())):
            np.testing.assert_array_equal(getattr(state, name), getattr(in_pieces, name))
        assert state.bonds[-1] == in_pieces.bonds[-1]
        if moves:
            assert (state.force[-1], state.work[-1]) == (in_pieces.force[-1], in_pieces.work[-1])
            assert state.peak == in_pieces.peak


@pytest.mark.parametrize("seed", range(30))
def test_random_programmes_at_once_by_hand_and_in_pieces(seed):
    chain_trial(seed)


@pytest.mark.campaign
@pytest.mark.long
def test_two_hundred_random_programmes():
    for seed in range(100, 300):
        chain_trial(seed)


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
    assert again.aging.digest() == run.aging.digest() == ca.run(own).aging.digest()
    ca.write(tmp_path / "run.h5", run)
    stored = ca.read(tmp_path / "run.h5")
    assert stored.aging.digest() == run.aging.digest()
    assert ca.run(stored.scene).aging.digest() == run.aging.digest()
    assert stored.fit() is None
    seen = stored.aging.observables
    assert seen["peak_1"].mean() > seen["steady_1"].mean()
    assert seen["step_lost"][:, 3].min() > 0
    study = ca.sweep({**own.todict(), "sweep": {"step.1.speed": [10, 1000]}}, tmp_path / "sweep")
    assert len({point.summary["observables"]["peak_1"]["mean"] for point in study}) == 2


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"step": [{"speed": 3}]}, "step 0: give either duration or distance"),
        ({"step": STEPS, "drive": None}, r"needs \[drive\]"),
        ({"step": [{"duration": "3 nm"}]}, "step.0.duration"),
        ({"step": STEPS, "hold": {"times": [1.0]}}, r"hold.times: \[protocol\] says it; leave this out"),
        ({"step": STEPS, "protocol": {"kind": "heating", "temperatures": [300], "duration": 1}}, "protocol.kind"),
        ({"step": STEPS, "ageing": {"kind": "closure"}}, "the steps follow every site"),
    ],
)
def test_what_is_wrong_with_a_scene_of_steps(changes, said):
    data = {**scene(step=STEPS).todict(), **changes}
    data = {name: section for name, section in data.items() if section is not None}
    with pytest.raises(ca.plugin.SceneError, match=said):
        ca.parse_scene(data)


def test_protocols_expand_into_steps_and_say_what_they_measure():
    healed = scene(protocol={"kind": "slide-hold-slide", "speed": 100, "distance": 1, "holds": [0.1, 1, 10]})
    run = ca.run(healed)
    seen = run.aging.observables
    assert run.aging.hold_times[-1] == pytest.approx(4 * 0.01 + 11.1)
    assert seen["healing_0"].mean() < seen["healing_1"].mean() < seen["healing_2"].mean()
    assert seen["healing_rate"].mean() > 0
    same = Programme(protocol=healed.component("protocol"), drive=healed.component("drive"))
    np.testing.assert_array_equal(same.times(), run.aging.hold_times)


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
    seen = ca.run({**data, "step": steps}, warn=False).aging.observables
    assert seen["step_area"][0, 1] > seen["step_area"][0, 0] == seen["step_area"][0, 2]
    np.testing.assert_array_equal(seen["bonds_0"], seen["bonds_2"])
    protocol = {"kind": "load-steps", "loads": [50, 100, 50], "durations": [1, 1, 1]}
    data["contact"]["hardness"] = 3.0
    seen = ca.run({**data, "protocol": protocol}, warn=False).aging.observables
    # the surface that 100 nN has flattened touches more than before
    assert seen["step_area"][0, 0] < seen["step_area"][0, 2] < seen["step_area"][0, 1]
    assert (seen["dip_2"] == 0).all()
    assert seen["step_lost"][:, 2].max() > 0
