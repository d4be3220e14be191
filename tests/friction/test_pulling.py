"""A pulled contact against closed forms, the master equation and linear stability; extremes; one history with holds."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import resources
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from pulled_models import (
    Independent,
    Renewed,
    chi_square,
    codes,
    drive_of,
    lattice_of,
    master_equation,
    patches,
    random_pull,
)
from scipy.stats import kstest

import chemage as ca
from chemage import InputError
from chemage.plugin import Output, PlottedResult, PluginError, PullHistory, hookimpl, plan, record, registry

EXACT = ca.pulling("event-driven")


def partners_of(n: int, forming, breaking, spacing: float = 0.5) -> ca.plugin.Partners:
    """The same for all sites."""
    return ca.plugin.Partners(
        *(np.resize(each, max(np.size(each), 2)) for each in (forming, breaking)), np.zeros(n), spacing
    )


def run(lattice, drive, times, **options) -> PullHistory:
    pulled = EXACT.run(lattice, drive, times, temperature=300, **options)
    assert pulled.fault() == ""
    assert np.abs(pulled.imbalance).max() < 1e-9
    return pulled


def all_bonded(lattice) -> np.ndarray:
    return np.ones(lattice.sites.size, bool)


# -- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "speed"),
    [("cusp", 1e-3), ("cubic", 1e3), ("constant", 1e9)]
    + [
        pytest.param(shape, speed, marks=pytest.mark.long)
        for shape, speeds in {"cusp": (1e3, 1e9), "cubic": (1e-3, 1e9), "constant": (1e-3, 1e3)}.items()
        for speed in speeds
    ],
)
def test_a_slow_pull_after_a_hold_tends_to_the_sum_of_mean_rupture_forces(shape, speed):
    """One bond at a time: the largest force is its rupture force, whose mean and distribution are those of the law."""
    drive = drive_of(speed, shape=shape)
    law = ca.rupture("dudko-hummer-szabo", transition_distance=0.05, speed=speed, stiffness=10, shape=shape)
    one = lattice_of(1, 3.0, 1.1)
    end = 1.5 * law.mean_forces(np.array([1.1]), 300.0)[0] / 10 / speed
    forces = np.array([run(one, drive, [end], seed=seed, start=all_bonded(one)).peak for seed in range(300)])
    ramp = law.ramp(np.array([1.1]), 300.0, 1e13)
    assert kstest(-np.expm1(-ramp.hazard(np.sort(forces) / ramp.thermal)[0]), "uniform").pvalue > 1e-4
    error = forces.std() / 300**0.5
    assert forces.mean() == pytest.approx(law.mean_forces(np.array([1.1]), 300.0)[0], abs=4 * error)


def test_the_sum_over_different_barriers_is_what_the_law_gives():
    """The bonds that are left at each stretch, times κ and summed up, are all rupture forces together."""
    rng = np.random.default_rng(4)
    barriers = rng.normal(1.1, 0.05, 4000)
    lattice, drive = lattice_of(4000, 3.0, barriers), drive_of(1e2)
    pulled = run(lattice, drive, np.linspace(0, 0.5 / 1e2, 500), start=all_bonded(lattice))
    law = ca.rupture("bell", transition_distance=0.05, speed=1e2, stiffness=10)
    # ∫ (bonds left) κ ds = the sum of the rupture forces
    ramp = law.ramp(barriers, 300.0, 1e13)
    summed = float((pulled.bonds[1:] + pulled.bonds[:-1]).sum() / 2 * 10 * 0.5 / 499)
    assert pulled.bonds[-1] == 0
    assert summed == pytest.approx(ramp.thermal * ramp.mean().sum(), rel=4 * 0.06 / 4000**0.5 + 1e-3)


@pytest.mark.parametrize("forming", [0.35, 0.5, 0.71])
def test_steady_sliding_of_independent_sites(forming):
    for speed in (1e0, 1e3, 1e6):
        model = Independent(speed, drive_of(speed), 0.8, forming)
        cycle = speed / model.k_on + model.stretch[np.searchsorted(model.hazard, 1)]
        times = np.array([8, 30]) * cycle / speed
        pulls = [run(lattice_of(300, forming, 0.8), model.drive, times, seed=seed) for seed in range(8)]
        forces = [np.diff(one.work)[0] / (np.diff(times)[0] * speed * 300) for one in pulls]
        assert np.mean(forces) == pytest.approx(model.mean_force, abs=4.5 * np.std(forces, ddof=1) / 8**0.5)


def test_schallamachs_maximum_and_both_limits():
    forces = {v: Independent(v, drive_of(v), 0.8, 0.5).mean_force for v in 10.0 ** np.arange(-8, 11, 2)}
    values = list(forces.values())
    top = int(np.argmax(values))
    assert 0 < top < len(values) - 1
    assert (np.diff(values[: top + 1]) > 0).all()
    assert (np.diff(values[top:]) < 0).all()
    # slow: bonds break by themselves, viscous; fast: no time to form bonds
    assert values[0] == pytest.approx(values[1] / 100, rel=1e-2)
    assert values[-1] < 1e-4 * values[top]


@pytest.mark.parametrize(("seed", "speed"), [(1, 1e4), pytest.param(2, 1e6, marks=pytest.mark.long)])
def test_the_master_equation_of_interacting_patches(seed, speed):
    """The joint states of 3 × 3 interacting sites in a force ramp, by products of matrix exponentials."""
    count, lattice, drive = 8000, patches(8000, seed, forming=0.42 if speed < 1e5 else 0.3), drive_of(speed)
    law = ca.rupture("bell", transition_distance=0.05, speed=speed, stiffness=10)
    end = 1.04 * law.mean_forces(np.array([1.1]), 300.0)[0] / 10 / speed
    expected = master_equation(lattice, drive, end, 100)
    pulled = run(lattice, drive, [end], seed=seed, start=all_bonded(lattice))
    # bonds that form in the pull are too young to break
    first = pulled.stretch > (1 - 1e-9) * pulled.displacement[-1]
    assert pulled.broken[-1] == 9 * count - np.count_nonzero(first)
    assert 0.2 < pulled.formed[-1] / pulled.broken[-1] < 0.8
    assert chi_square(codes(pulled, count), expected, count) > 1e-4


# -- drives -----------------------------------------------------------------------------------------------------------


def test_a_very_stiff_spring_is_a_constant_speed():
    lattice = lattice_of(4000, 0.5, 0.8)
    times = np.linspace(0, 1e-4, 21)
    rigid, stiff = (run(lattice, drive_of(1e4, spring=k), times, seed=2) for k in (None, 1e12))
    np.testing.assert_allclose(rigid.displacement, stiff.displacement, atol=1e-6)
    again = run(lattice, drive_of(1e4), times, seed=3)
    spread = np.abs(rigid.force - again.force).max()
    assert np.abs(rigid.force - stiff.force).max() < max(2 * spread, 1e-3 * rigid.peak)


def test_stick_slip_below_and_smooth_sliding_above_the_critical_stiffness():
    """The benchmark ``pulling.py`` measures where it begins; here far from it on both sides."""
    speed, n = 1e4, 3000
    model = Independent(speed, drive_of(speed), 0.8, 0.5)
    critical = model.critical()[0] * n
    unrest = {}
    for factor in (0.5, 2.0):
        drive = drive_of(speed, spring=factor * critical)
        times = np.linspace(0, 20e-4, 801)
        force = run(lattice_of(n, 0.5, 0.8), drive, times).force[400:]
        unrest[factor] = force.std() / force.mean()
    assert unrest[2.0] < 0.1 < 0.4 < unrest[0.5]


def test_slips_are_counted_with_their_sizes():
    speed, n = 1e4, 2000
    soft = 0.3 * Independent(speed, drive_of(speed), 0.8, 0.5).critical()[0] * n
    pulled = run(lattice_of(n, 0.5, 0.8), drive_of(speed, spring=soft), np.linspace(0, 20e-4, 4001))
    falls = np.diff(pulled.force)
    assert pulled.avalanches.sum() >= 3
    assert pulled.largest_drop > -falls.min()
    sizes = 2.0 ** np.arange(64)
    assert (pulled.avalanches * sizes).sum() <= pulled.broken[-1]


def test_a_pull_goes_on_with_another_drive():
    """The force stays where a spring takes over; energy that another spring or stiffness stores is accounted for."""
    lattice = lattice_of(200, 0.5, 0.8)
    first = run(lattice, drive_of(1e4, friction=3.0), [1e-5], start=all_bonded(lattice))
    for changes in ({"spring": 500.0, "friction": 3.0}, {"friction": 1.0, "speed": 10.0}, {"bond_stiffness": 20.0}):
        drive = drive_of(**{"speed": 1e4, **changes})
        after = run(lattice, drive, first.time + np.array([0.0, 1e-5]), start=first)
        if "spring" in changes:
            assert after.force[0] == pytest.approx(first.force[-1], rel=1e-9)
        back = run(lattice, drive_of(1e4), after.time + np.array([0.0, 1e-5]), start=after)
        assert back.displacement[0] == after.displacement[-1]


# -- extremes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [1e-3, 1.0, 1e9], ids=["1 pm/s", "1 nm/s", "1 m/s"])
@pytest.mark.parametrize("stiffness", [0.0, 1e-6, 10.0, 1e6])
@pytest.mark.parametrize("spring", [None, 0.0, 1e-6, 1e9])
def test_extremes_of_speed_and_stiffness(speed, stiffness, spring):
    lattice = lattice_of(20, 0.9, 1.1)
    drive = drive_of(speed, bond_stiffness=stiffness, spring=spring, friction=0.5)
    pulled = run(lattice, drive, np.linspace(0, 1.0 / speed, 5), start=all_bonded(lattice))
    if spring == 0:
        assert not pulled.displacement.any()
        assert not pulled.force.any()
    elif spring is None:
        assert pulled.displacement[-1] == pytest.approx(1.0)
    if stiffness == 0 and spring is None:
        assert pulled.force == pytest.approx(0.5)


def test_no_bond_one_bond_and_a_pull_without_a_hold():
    lattice = lattice_of(50, 2.0, 1.1)
    none = run(lattice, drive_of(1e3), [1e-3])
    assert (none.peak, none.bonds[-1], none.work[-1]) == (0.0, 0, 0.0)
    single = np.arange(50) == 7
    one = run(lattice, drive_of(1e3), np.linspace(0, 1e-3, 11), start=single)
    assert 1.5 < one.peak < 3
    assert (one.broken[-1], one.bonds[-1]) == (1, 0)
    assert one.dissipated[-1] == pytest.approx(one.peak**2 / 20, rel=1e-9)
    empty = ca.ReactionLattice(pixels=(1, 1), sites=[], forming=[], breaking=[])
    assert run(empty, drive_of(1.0), [1.0]).peak == 0


def test_without_a_barrier_it_is_exact_or_refused():
    quick = lattice_of(5, 2.0, 0.0)
    gone = run(quick, drive_of(1e3), [0.0, 1e-9], start=all_bonded(quick))
    assert gone.bonds.tolist() == [5, 0]
    assert gone.peak < 1e-6
    with pytest.raises(
        InputError, match=r"bonds are expected to form or break .* of 1 s, more than most_events = 1e\+08"
    ):
        EXACT.run(lattice_of(5, 0.0, 0.0), drive_of(1e3), [1.0], temperature=300)
    with pytest.raises(InputError, match="pull less far"):
        EXACT.run(lattice_of(5, 1.0, 1.0), drive_of(1e9), [1e3], temperature=300)


@pytest.mark.parametrize("seed", [16, 17, 26, 30, 47, 49, 52, 59])
def test_energy_is_balanced_in_random_pulls(seed):
    """A resting slider held by friction, a soft spring, nanoseconds: the work is no difference of large numbers; the
    benchmark ``pulling.py fuzz`` runs 400."""
    lattice, drive, times, options = random_pull(seed)
    pulled = EXACT.run(lattice, drive, times, **options)
    assert pulled.fault() == ""
    assert np.abs(pulled.imbalance).max() < 1e-10


def test_the_peak_is_that_of_this_pull():
    """It begins anew where the drive changes, and goes on where nothing does."""
    lattice = lattice_of(200, 3.0, 1.1)
    law = ca.rupture("bell", transition_distance=0.05, speed=1e6, stiffness=10)
    end = 0.7 * float(law.mean_forces(np.array([1.1]), 300.0)[0]) / 10 / 1e6
    fast = run(lattice, drive_of(1e6), [end], start=all_bonded(lattice))
    more = run(lattice, drive_of(1e6), [end, 2 * end], start=fast)
    assert more.peak > fast.peak
    assert run(lattice, drive_of(1e6), [3 * end], start=more).peak == more.peak
    still = run(lattice, drive_of(0.0), [2 * end, 2 * end + 1e3], start=more)
    assert still.peak == pytest.approx(more.force[-1], abs=1e-9)
    assert still.peak < 0.5 * more.peak


def test_events_are_foreseen_with_couplings_and_with_other_partners():
    """What is refused is known before: bonds that help each other to form do so a million times as often."""
    ring = np.arange(40)
    graph = np.stack([(ring + 1) % 40, (ring - 1) % 40], axis=1).astype(np.int32)
    helped = lattice_of(40, 0.65, 0.5).model_copy(
        update={"neighbours": graph, "coupling": np.full((40, 2), -0.15, np.float32)}
    )
    partners = partners_of(40, np.linspace(0.3, 0.5, 100), 0.5, spacing=2e-3)
    for lattice, drive, span in (
        (helped, drive_of(1.0), 1e-3),
        (lattice_of(40, 0.3, 0.5), drive_of(1.0), 1e-3),
        (lattice_of(40, 0.5, 0.5), drive_of(1.0, partner="renewed"), 1e-2),
        (lattice_of(40, 0.4, 1.0), drive_of(1e6), 1e-4),
    ):
        pulled = run(lattice, drive, [span], seed=3, start=all_bonded(lattice), partners=partners)
        events = int(pulled.formed[-1] + pulled.broken[-1])
        with pytest.raises(InputError, match="are expected to form or break") as refused:
            ca.pulling("event-driven", most_events=50.0).run(lattice, drive, [span], temperature=300, partners=partners,
                                                            start=all_bonded(lattice))  # fmt: skip
        foreseen = float(str(refused.value).split("about ")[1].split()[0])
        assert 0.5 < foreseen / events < 2, (foreseen, events)


def test_a_pull_with_more_events_than_foreseen_stops(monkeypatch):
    monkeypatch.setattr("chemage_kinetics.pulling.flips_on", lambda *_: 0.0)
    engine, lattice = ca.pulling("event-driven", most_events=1e5), lattice_of(40, 0.3, 0.3)
    with pytest.raises(InputError, match=r"bonds by .* s did form or break in a pull of 1 s, more than most_events"):
        engine.run(lattice, drive_of(1.0), [1.0], temperature=300)


def test_a_step_of_ten_decades_in_rate():
    """Spring and bonds go from 1 pm/s to 10 mm/s: the force stays, the bonds go on from their stretch."""
    lattice = lattice_of(100, 3.0, 1.1)
    slow = run(lattice, drive_of(1e-3), [30.0], start=all_bonded(lattice))
    fast = run(lattice, drive_of(1e7), [30.0, 30.0 + 1e-7], start=slow)
    assert fast.force[0] == pytest.approx(slow.force[-1], rel=1e-12)
    assert fast.displacement[0] == slow.displacement[-1]
    law = ca.rupture("bell", transition_distance=0.05, speed=1e7, stiffness=10)
    assert fast.bonds[-1] == 0
    assert slow.bonds[-1] == 100
    assert fast.peak == pytest.approx(100 * law.mean_forces(np.array([1.1]), 300.0)[0], rel=0.2)


# -- histories --------------------------------------------------------------------------------------------------------


def test_hold_pull_and_hold_are_one_history():
    lattice = patches(30, 5, forming=0.75, breaking=1.1)
    hold = ca.engine("rejection-free").run(lattice, [0.1, 1.0], temperature=300, seed=1)
    partners = partners_of(270, np.linspace(0.7, 0.9, 100), np.linspace(1.0, 1.2, 100))
    drive = drive_of(1.0, partner="renewed", spring=500.0)
    times = 1.0 + np.linspace(0, 2.0, 21)
    whole = run(lattice, drive, times, seed=2, start=hold, partners=partners)
    first = run(lattice, drive, times[:8], seed=2, start=hold, partners=partners)
    rest = run(lattice, drive, times[8:], seed=2, start=first, partners=partners)
    assert rest.force.tobytes() == whole.force[8:].tobytes()
    assert (rest.digest() == whole.digest()) == (rest.times.size == whole.times.size)
    for name in ("state", "stretch", "forming", "breaking", "avalanches"):
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name))
    assert (rest.peak, rest.least) == (whole.peak, whole.least)
    # most have come to another partner; bonds keep the one with which they formed
    assert np.mean(whole.forming != lattice.forming) > 0.5
    young = whole.state & (whole.stretch < 0.1)
    assert np.mean(whole.breaking[young] == lattice.breaking[young]) < 0.5
    after = ca.engine("rejection-free").run(
        whole.lattice_after(lattice), [10.0, 100.0], temperature=300, seed=3, start=whole.history
    )
    assert after.formed[0] >= whole.formed[-1]
    assert after.fault() == ""


# -- partners ---------------------------------------------------------------------------------------------------------

#: of sites that meet others
ALL = ("force", "work", "state", "stretch", "forming", "breaking")


def same(one: PullHistory, other: PullHistory, names: Sequence[str] = ALL) -> None:
    for name in names:
        np.testing.assert_array_equal(getattr(one, name)[-1:], getattr(other, name)[-1:])
        if name not in ("force", "work"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_partners_are_a_function_of_seed_site_and_slip():
    """Whatever broke, rested, was sampled or was pulled at which speed, temperature and stiffness."""
    n = 400
    lattice, partners = lattice_of(n, 0.5, 0.8), partners_of(n, np.linspace(0.4, 0.6, 1000), np.linspace(0.7, 0.9, 9))
    how = {"seed": 6, "partners": partners._replace(shift=np.full(n, -0.05))}
    one = run(lattice, drive_of(1e4, partner="renewed"), [1.23e-4], **how)
    fast = run(lattice, drive_of(1e6, partner="renewed", bond_stiffness=1), [1e-7, 1.23e-6], **how)
    part = run(lattice, drive_of(1e4, partner="renewed"), [0.7e-4], **how)
    rested = run(lattice, drive_of(0.0, partner="renewed"), [1.0, 10.0], start=part, **how)
    np.testing.assert_array_equal(rested.forming, part.forming)
    np.testing.assert_array_equal(rested.breaking[~part.state], part.breaking[~part.state])
    held = ca.engine("bkl").run(part.lattice_after(lattice), [1.0, 2.0], temperature=310, seed=9, start=part.history)
    for before in (part, rested, held):
        on = run(lattice, drive_of(1e5, partner="renewed"), [before.time + 0.53e-5], start=before, **how)
        np.testing.assert_array_equal(on.forming, one.forming)
    np.testing.assert_array_equal(fast.forming, one.forming)
    other = one.forming != lattice.forming
    # 2.46 spacings: all have met another one, half of them two
    assert other.all()
    assert kstest((one.forming - 0.35) / 0.2, "uniform").pvalue > 1e-4
    assert not np.any(
        run(lattice, drive_of(1e4, partner="renewed"), [1.23e-4], **{**how, "seed": 7}).forming == one.forming
    )


def test_sites_come_to_their_next_partner_one_after_the_other():
    """After any part of a spacing, that part of them; none at once, and none twice."""
    n = 4000
    lattice, partners = lattice_of(n, 3.0, 1.1), partners_of(n, np.linspace(2.0, 2.5, 1000), 1.1)
    pulled, met, last = None, np.zeros(n, int), lattice.forming
    for part in range(1, 21):
        pulled = run(lattice, drive_of(1.0, partner="renewed"), [0.05 * part], start=pulled, partners=partners)
        met, last = met + (pulled.forming != last), pulled.forming
        share = part / 10
        assert abs(met.mean() - share) < 4.5 * (0.25 / n) ** 0.5 + 1e-12
        assert met.max() - met.min() <= 1


@pytest.mark.parametrize("spring", [None, 200.0])
def test_far_partners_are_none(spring):
    """A spacing without end gives the same bytes as sites that keep their partners."""
    lattice = patches(30, 5, forming=0.45, breaking=0.8)
    partners = partners_of(270, np.linspace(0.4, 0.6, 100), 0.7, spacing=1e30)
    times = np.linspace(0, 5e-4, 11)
    kept, far = (
        run(lattice, drive_of(1e4, partner=partner, spring=spring), times, seed=2, partners=partners)
        for partner in ("kept", "renewed")
    )
    for name in (*ALL, "displacement", "bonds", "avalanches"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(far, name))
    assert kept.broken[-1] > 300


@pytest.mark.parametrize("speed", [1.0, 1e3, pytest.param(1e6, marks=pytest.mark.long)])
def test_partners_of_one_height_change_nothing(speed):
    """The closed form of steady sliding, at any speed."""
    model = Independent(speed, drive_of(speed, partner="renewed"), 0.8, 0.5)
    cycle = speed / model.k_on + model.stretch[np.searchsorted(model.hazard, 1)]
    times = np.array([8, 30]) * cycle / speed
    partners = partners_of(300, 0.5, 0.8, spacing=cycle / 3)
    pulls = [run(lattice_of(300, 0.5, 0.8), model.drive, times, seed=seed, partners=partners) for seed in range(8)]
    forces = [np.diff(one.work)[0] / (np.diff(times)[0] * speed * 300) for one in pulls]
    assert np.mean(forces) == pytest.approx(model.mean_force, abs=4.5 * np.std(forces, ddof=1) / 8**0.5)


@pytest.mark.parametrize(
    ("forming", "breaking", "stiffness", "speed"),
    [
        ((0.7, 0.85), (0.8,), 10.0, 10.0),
        ((0.6, 0.75), (0.7, 0.85), 10.0, 1e3),
        ((0.6, 1.0), (0.8,), 1.0, 1e2),
        pytest.param((0.6, 1.0), (0.8,), 10.0, 0.1, marks=pytest.mark.long),
        pytest.param(tuple(np.linspace(0.6, 1.0, 8)), (0.8,), 10.0, 1.0, marks=pytest.mark.long),
        pytest.param((0.6, 1.0), (0.8,), 1.0, 1e4, marks=pytest.mark.long),
    ],
)
def test_steady_sliding_over_partners_is_that_of_a_transport_equation(forming, breaking, stiffness, speed):
    """Two heights of either barrier, a spectrum, and soft bonds that last over many spacings; ``pulling.py renewed`` has
    42 cases."""
    model = Renewed(drive_of(speed, bond_stiffness=stiffness, partner="renewed"), forming, breaking)
    times = np.array([40, 120]) * model.spacing / speed
    forces = []
    for seed in range(10):
        lattice, partners = model.sites(1000, seed)
        pulled = run(lattice, model.drive, times, seed=seed, partners=partners)
        forces.append(np.diff(pulled.work)[0] / (np.diff(times)[0] * speed * 1000))
    error = np.std(forces, ddof=1) / 10**0.5
    exact = model.mean_force
    assert error < 0.02 * exact
    assert abs(np.mean(forces) - exact) < 4.5 * error


def test_a_jump_of_many_spacings_brings_sites_to_the_partners_of_where_it_ends():
    """A soft spring whose last bond breaks carries the slider on at once."""
    n = 200
    lattice, partners = lattice_of(n, 3.0, 0.9), partners_of(n, np.linspace(2.0, 2.5, 1000), 0.9, spacing=0.02)
    drive = drive_of(1e3, partner="renewed", spring=30.0)
    times = np.linspace(0, 0.01, 201)
    jumped = run(lattice, drive, times, start=np.arange(n) < 150, partners=partners)
    assert np.diff(jumped.displacement).max() > 20 * partners.spacing
    stiff = drive_of(1e3, partner="renewed")
    slid = run(lattice, stiff, [jumped.displacement[-1] / 1e3], partners=partners)
    # to within the rounding of the way
    assert np.mean(jumped.forming == slid.forming) > 0.99


def test_what_is_wrong_with_partners_or_too_far_a_way_is_said():
    lattice, partners = lattice_of(40, 0.5, 0.8), partners_of(40, 0.5, 0.8)
    how = {"temperature": 300, "partners": partners}
    with pytest.raises(InputError, match=r"give chemage.plugin.partners_of\(...\), or partner='kept'"):
        EXACT.run(lattice, drive_of(1.0, partner="renewed"), [1.0], temperature=300)
    with pytest.raises(InputError, match="one shift for each site, and a spacing above 0"):
        EXACT.run(
            lattice, drive_of(1.0, partner="renewed"), [1.0], temperature=300, partners=partners._replace(spacing=0)
        )
    slow = lattice_of(40, 3.0, 3.0)
    with pytest.raises(
        InputError, match=r"sites are to meet 8e\+09 partners, more than ten times most_events = 1e\+08"
    ):
        EXACT.run(slow, drive_of(1e4, partner="renewed", bond_stiffness=1e-9), [1e4], **how)


def test_the_least_force_is_that_of_all_events():
    """After a step down of the speed the force falls below what it becomes; how often it is recorded changes nothing."""
    lattice = lattice_of(300, 0.5, 0.8)
    before = run(lattice, drive_of(1e5), [2e-5], seed=1)
    slow = drive_of(1e3)
    ends = before.time + np.array([0.0, 1e-4])
    few, often = (run(lattice, slow, times, seed=1, start=before) for times in (ends, np.linspace(*ends, 20_001)))
    assert few.least == often.least
    assert 0.99 * often.force.min() < often.least <= often.force.min() < few.force.min()
    # in one piece or in two
    half = run(lattice, slow, ends[:1] + 3e-5, seed=1, start=before)
    assert run(lattice, slow, ends[1:], seed=1, start=half).least == few.least <= half.least


# -- the law in a scene -----------------------------------------------------------------------------------------------


def scene(**rupture) -> dict:
    pull = {"kind": "pulled", "speed": "1 um/s", "distance": "0.6 nm", "bond_stiffness": "10 nN/nm"}
    return {
        "name": "pulled",
        "surface": {"kind": "sphere", "radius": 30, "pixels": 32, "pixel_size": 0.4518},
        "contact": {"kind": "hertz", "modulus": 35.3, "load": 50},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "breaking": {"kind": "gaussian", "mean": 1.1, "std": 0.02},
        "engine": {"kind": "rejection-free"},
        "hold": {"temperature": 300, "start": 1, "stop": 1e3, "per_decade": 1, "replicas": 3},
        "rupture": {**pull, "transition_distance": 0.05, "points": 20, **rupture},
    }


def test_the_peak_is_the_friction_and_is_the_same_on_any_number_of_threads():
    made, again = (ca.run(scene(), threads=threads).ageing for threads in (1, 2))
    assert made is not None
    assert again is not None
    np.testing.assert_array_equal(made.friction_drop, again.friction_drop)
    force = made.observables["pull_force"]
    assert force.shape == (3, 4, 21)
    assert (made.friction_drop >= force.max(axis=2) - 1e-9).all()
    law = ca.rupture("dudko-hummer-szabo", transition_distance=0.05, speed=1e3, stiffness=10)
    most = made.bonds * law.mean_forces(np.array([1.1]), 300.0)[0]
    assert (made.friction_drop < 1.05 * most).all()
    assert (made.friction_drop > 0.7 * most).all()
    maps = made.observables["pull_maps"]
    np.testing.assert_array_equal(maps[:, 0].sum(axis=(1, 2)), made.bonds[:, -1])


def test_the_law_says_beforehand_what_it_cannot_pull():
    with pytest.raises(ca.plugin.SceneError, match="nothing is pulled; give a speed above 0"):
        ca.parse_scene(scene(speed=0))
    short = ca.parse_scene(scene(distance="0.05 nm"))
    assert any("there may be no peak" in note for note in plan(short).notes)
    endless = scene(speed="0.01 nm/s", partner="kept", engine={"kind": "event-driven", "most_events": 1e4})
    endless["breaking"]["mean"] = 0.6
    said = plan(ca.parse_scene(endless)).notes
    assert any("bonds, more than most_events = 10000 of its engine, which will refuse it" in note for note in said)


@pytest.mark.parametrize(("distance", "noted"), [("0.06 nm", True), ("0.6 nm", False)])
def test_a_result_says_where_the_force_ended_at_its_largest(distance, noted):
    result = ca.run(scene(distance=distance))
    said = [note for note in result.notes if "pulls the force was at its largest when the drive had moved" in note]
    assert bool(said) == noted
    assert all("ΔF is the force there, not a peak" in note for note in said)


# -- what an engine that pulls, and hooks, leave behind -----------------------------------------------------------------


@pytest.fixture
def stretching():
    """The engine that ``chemage plugins new`` writes, in a module of its own."""
    text = (resources.files("chemage.scaffold") / "templates" / "role_pulling.py.in").read_text()
    module = ModuleType("stretching")
    sys.modules["stretching"] = module
    exec(text.format(cls="Stretching", kind="stretching"), vars(module))
    with registry.using(registry.Registry()):
        yield ca.register(module.Stretching)
    del sys.modules["stretching"]


class OfPulls:
    """A plugin that looks at every pull."""

    @hookimpl(wrapper=True)
    def chemage_pull_bonds(self):
        pulled = yield
        record(longest=Output("end", "nm", "longest stretch").of([pulled.stretch.max()]))
        return pulled


def test_what_a_pulling_engine_and_hooks_record_reaches_results_files_and_tables(stretching, tmp_path, command):
    plain = ca.run(scene()).ageing
    registry.current().register(OfPulls(), "of-pulls")
    run = ca.run(scene(engine="stretching"))
    ageing = run.ageing
    np.testing.assert_array_equal(ageing.friction_drop, plain.friction_drop)
    assert ageing.observables["mean_stretch"].shape == (3, 4)
    assert ageing.measured["mean_stretch"].output == Output(
        "hold_time", "nm", "mean stretch of the bonds at the end, 0 without bonds"
    )
    left = ageing.observables["pull_bonds"][:, :, -1] > 0
    np.testing.assert_array_equal(ageing.observables["mean_stretch"] > 0, left)
    assert ageing.observables["longest"].shape == (3, 4, 1)
    assert (ageing.observables["longest"][..., 0] >= ageing.observables["mean_stretch"]).all()
    assert not [note for note in ageing.notes if "mean_stretch" in note]
    assert "stretching.Stretching" in run.plugins
    ca.write(tmp_path / "a.h5", run)
    assert ca.read(tmp_path / "a.h5").ageing == ageing
    shown = command("show", tmp_path / "a.h5", "--all").out
    assert "pulled (engine stretching (inner event-driven))" in shown
    assert "mean stretch of the bonds" in shown


def test_a_hook_that_records_only_in_some_pulls_is_refused(stretching):
    class Early:
        @hookimpl(wrapper=True)
        def chemage_pull_bonds(self, seed):
            if seed.spawn_key[-1] == 0:
                record(few=Output((), "", "only after the first hold time").of(1))
            return (yield)

    registry.current().register(Early(), "early")
    with pytest.raises(PluginError, match="'few' is not recorded with one shape in every pull"):
        ca.run(scene())


def test_a_pulling_engine_that_breaks_its_word_is_named(stretching, monkeypatch):
    monkeypatch.setattr(stretching, "_run", lambda self, *arguments: EXACT._run(*arguments))
    said = "pulling 'stretching' of .* declares the output 'mean_stretch' and does not record it"
    with pytest.raises(PluginError, match=said):
        ca.run(scene(engine="stretching"))


# -- figures ----------------------------------------------------------------------------------------------------------


def test_maps_of_a_pull_are_cut_around_the_bonds():
    """Those of a centred tip are centred; each of several results has its name, and all one scale."""
    maps = np.zeros((1, 2, 40, 30))
    maps[0, :, 18:22, 12:18] = 1
    maps[0, 1, 21, 17] = 0
    results = []
    for name, size in (("a", 1), ("b", 3)):
        measured = {"pull_force": np.zeros((1, 1, 2)), "pull_maps": size * maps, "pull_maps_at": np.array([[0.0, 0.3]])}
        results.append(PlottedResult(name, SimpleNamespace(observables=measured), None, "C0"))
    law = ca.rupture("pulled", speed=1, distance=1, bond_stiffness=1, transition_distance=0.03)
    for shown in (results[:1], results):
        axes = Figure().add_subplot()
        law.draw("pull-maps", axes, shown)
        image = axes.images[0].get_array().filled(np.nan)
        # 4 x 6 cells with bonds, a cell around them, and a gap around that; two maps beside each other
        assert image.shape == (len(shown) * 10, 2 * 8)
        first = image[-10:, :8]
        assert np.array_equal(first == 1, np.pad(np.ones((6, 4), bool), 2))
        assert np.array_equal(np.isnan(first), np.pad(np.zeros((8, 6), bool), 1, constant_values=True))
    assert [label.get_text() for label in axes.get_yticklabels()] == ["b", "a"]
