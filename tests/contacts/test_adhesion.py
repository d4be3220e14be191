"""Spheres that adhere: closed forms, their limits, what the rest of the chain makes of tension."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import contact_statistics
from chemage_contact.paths import Path

E, W, R = 35.3, 0.1, 30.0
SIZE = 0.4518


def sphere(pixels: int = 64, size: float = SIZE, radius: float = R) -> Any:
    return ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=size).make()


def jkr(**options: Any) -> Any:
    return ca.contact("jkr", **{"modulus": E, "work_of_adhesion": W, **options})


def dmt(**options: Any) -> Any:
    return ca.contact("dmt", **{"modulus": E, "work_of_adhesion": W, **options})


def maugis(range: Any, **options: Any) -> Any:
    return ca.contact("maugis", **{"modulus": E, "work_of_adhesion": W, "range": range, **options})


def range_at(strength: float) -> float:
    """Range (nm) at which Maugis' λ has the value."""
    stiffness = 4 * E / 3
    return 2 * W / strength * (R / (math.pi * W * stiffness**2)) ** (1 / 3)


def test_pull_off_and_radius_without_load_are_those_of_jkr_and_dmt():
    assert jkr().pull_off(R) == pytest.approx(1.5 * math.pi * W * R, rel=1e-10)
    assert dmt().pull_off(R) == pytest.approx(2 * math.pi * W * R, rel=1e-10)
    stiffness = 4 * E / 3
    assert jkr().at_load(R, 0.0).edge == pytest.approx((6 * math.pi * W * R**2 / stiffness) ** (1 / 3), rel=1e-10)
    assert dmt().at_load(R, 0.0).edge == pytest.approx((2 * math.pi * W * R**2 / stiffness) ** (1 / 3), rel=1e-10)


def test_the_contact_at_pull_off_is_that_of_jkr():
    """a = a₀/4^(1/3), and the force is stationary in the approach there."""
    solver = jkr()
    pull = solver.pull_off(R)
    assert solver.at_load(R, -pull).edge == pytest.approx(solver.at_load(R, 0.0).edge / 4 ** (1 / 3), rel=1e-8)
    assert solver.solve(sphere(), -pull).load == -pull


def test_maugis_is_jkr_for_short_and_dmt_for_long_ranges():
    """The pull-off lies between both and rises with the range; each end is reached as its correction vanishes."""
    pulls = [maugis(range_at(strength)).pull_off(R) / (math.pi * W * R) for strength in np.geomspace(300, 1e-3, 30)]
    assert np.all(np.diff(pulls) > 0)
    assert 1.5 < pulls[0] < 1.5 * 1.0001
    assert 2 * 0.98 < pulls[-1] < 2
    for load in (-10.0, 0.0, 30.0, 1000.0):
        short, long = maugis(range_at(1e4)).at_load(R, load), maugis(range_at(1e-4)).at_load(R, load)
        assert short.edge == pytest.approx(jkr().at_load(R, load).edge, rel=1e-3)
        assert short.displacement == pytest.approx(jkr().at_load(R, load).displacement, rel=1e-2, abs=1e-3)
        assert long.edge == pytest.approx(dmt().at_load(R, load).edge, rel=1e-3)


@pytest.mark.parametrize("strength", [0.01, 0.3, 1.0, 3.0, 30.0])
def test_maugis_satisfies_his_own_equations(strength):
    """In the form in which they are published (Johnson & Greenwood, J. Colloid Interface Sci. 192, 326 (1997))."""
    solver = maugis(range_at(strength))
    force, unit, depth, found = solver.units(R)
    assert found == pytest.approx(strength, rel=1e-12)
    for load in (-0.9 * solver.pull_off(R), 0.0, 20.0):
        state = solver.at_load(R, load)
        a, m = state.edge / unit, state.outer / state.edge
        root, secant = math.sqrt(m * m - 1), math.acos(1 / m)
        gap = strength * a * a / 2 * (root + (m * m - 2) * secant)
        gap += 4 * strength**2 * a / 3 * (root * secant - m + 1)
        assert gap == pytest.approx(1, rel=1e-6)
        assert load / force == pytest.approx(a**3 - strength * a * a * (root + m * m * secant), rel=1e-7, abs=1e-9)
        assert state.displacement / depth == pytest.approx(a * a - 4 / 3 * strength * a * root, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("solver", [jkr(), maugis(0.3), maugis(1.5)], ids=["jkr", "maugis", "maugis-long"])
@pytest.mark.parametrize("load", [-8.0, 0.0, 23.0])
def test_pixels_carry_the_load_and_the_mean_of_the_pressure(solver, load):
    contact = solver.solve(sphere(), load)
    assert contact.carried == pytest.approx(load, abs=1e-10)
    assert contact.load == load
    state = solver.at_load(R, load)
    assert contact.area == pytest.approx(math.pi * state.edge**2, rel=0.12)
    # the middle four pixels, by a fine sum of the pressure as it is published
    fine = (np.arange(40) + 0.5) / 40 * SIZE
    r = np.hypot(fine[:, None], fine)
    a, c = state.edge, state.outer
    hertz = 2 * E * a / (math.pi * R) * np.sqrt(1 - (r / a) ** 2)
    if c > a:
        tension = 2 * W / solver.range / math.pi * np.arctan(np.sqrt((c * c - a * a) / (a * a - r * r)))
    else:
        tension = math.sqrt(2 * W * E / (math.pi * a)) / np.sqrt(1 - (r / a) ** 2)
    assert contact.pressure[32, 32] == pytest.approx((hertz - tension).mean(), rel=2e-4)


def test_without_adhesion_it_is_hertz():
    plain = ca.contact("hertz", modulus=E).solve(sphere(), 23)
    for solver in (jkr(work_of_adhesion=1e-12), dmt(work_of_adhesion=1e-12)):
        contact = solver.solve(sphere(), 23)
        assert contact.displacement == pytest.approx(plain.displacement, rel=1e-4)
        assert np.array_equal(contact.contact, plain.contact)
        # the force on pixels across the rim is moved to others in another way
        assert np.linalg.norm(contact.pressure - plain.pressure) < 0.1 * np.linalg.norm(plain.pressure)
        assert contact.mean_contact_pressure == pytest.approx(plain.mean_contact_pressure, rel=1e-9)


def test_a_pull_beyond_pull_off_names_it():
    for solver in (jkr(), dmt(), maugis(0.3)):
        pull = solver.pull_off(R)
        with pytest.raises(InputError, match=rf"load = .*the pull-off force is {pull:.6g} nN.*at least -{pull:.6g}"):
            solver.solve(sphere(), -1.01 * pull)


def test_solvers_without_adhesion_refuse_a_pull():
    for kind in ("hertz", "fft-bem"):
        with pytest.raises(InputError, match=r"load = -1.*not negative"):
            ca.contact(kind, modulus=E).solve(sphere(), -1)


def test_the_work_lost_in_a_jkr_cycle_is_the_closed_form():
    """Between jump-in at 0 and jump-out, ∮F dδ is the integral along the stable branch, at δ given."""
    solver = jkr()
    scale = (math.pi * W) ** (2 / 3) * R ** (1 / 3) * E ** (-2 / 3)
    lowest = -0.75 * scale
    # jump-out at given approach: (3/4)(π²w²R/E*²)^(1/3)
    there = np.linspace(lowest - 0.02, 0.3, 7)
    loop = solver.loop(sphere(), [*there, *there[::-1]])
    assert loop.jump_in.value == 0
    assert loop.jump_out.value == pytest.approx(lowest, rel=1e-12)
    assert loop.pull_off.value == pytest.approx(1.5 * math.pi * W * R, rel=1e-12)
    # from 0 back to the jump-out: δ = a²/R − √(2πwa/E*), integrated over a
    a = np.linspace((math.pi * W * R**2 / 8 / E) ** (1 / 3), (2 * math.pi * W * R**2 / E) ** (1 / 3), 20001)
    force = 4 * E * a**3 / (3 * R) - np.sqrt(8 * math.pi * W * E * a**3)
    depth = a**2 / R - np.sqrt(2 * math.pi * W * a / E)
    assert loop.dissipated.value == pytest.approx(-np.trapezoid(force, depth), rel=1e-6)
    assert dmt().loop(sphere(), [*there, *there[::-1]]).dissipated.value == pytest.approx(0, abs=1e-9)


def test_a_maugis_cycle_loses_more_the_shorter_the_range():
    path = Path.down_to("5 nN")
    lost = [maugis(range_at(s)).loop(sphere(128), path).dissipated.value for s in (0.05, 0.5, 2.0, 300.0)]
    assert lost == sorted(lost)
    assert lost[0] < 1e-3 * lost[-1]
    assert lost[-1] == pytest.approx(jkr().loop(sphere(), path).dissipated.value, rel=0.01)


def scene(**changes: Any) -> dict[str, Any]:
    sections: dict[str, Any] = {
        "surface": {"kind": "sphere", "radius": R, "pixels": 64, "pixel_size": SIZE},
        "contact": {"kind": "jkr", "modulus": E, "work_of_adhesion": "0.1 J/m^2", "load": -5},
        "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
        "chemistry": {"activation_volume": "0.04 eV/GPa", "site_density": "pixel"},
        "engine": {"kind": "rejection-free"},
        "hold": {"temperature": 300, "start": 0.1, "stop": 100, "replicas": 4},
    }
    for path, value in changes.items():
        section, _, name = path.partition(".")
        sections[section][name] = value
    return sections


def parsed(**changes: Any) -> Any:
    return ca.parse_scene(scene(**changes))


def test_tension_raises_barriers_and_a_pulled_contact_ages():
    run: Any = ca.run(parsed())
    contact, ageing = run.contact, run.ageing
    assert contact.load == -5
    assert contact.carried == pytest.approx(-5, rel=1e-9)
    assert ageing.load == -5
    assert np.isnan(ageing.friction_coefficient_drop).all()
    assert ageing.bonds[:, -1].mean() > 0
    chemistry = parsed().chemistry
    lattice, bare = chemistry.on(contact), chemistry.replace(activation_volume=0).on(contact)
    pressure = contact.pressure.ravel()[contact.sites]
    assert (pressure < 0).any()
    np.testing.assert_allclose(lattice.forming - bare.forming, -0.04 * pressure, atol=1e-9)


def test_sites_in_all_or_in_pressed_contact():
    contact = parsed().contact.solve(sphere(), 10)
    chemistry = parsed().chemistry
    pressed = chemistry.replace(tensile_sites=False)
    assert chemistry.on(contact).sites.size == np.count_nonzero(contact.touching)
    assert pressed.on(contact).sites.size == np.count_nonzero(contact.touching & (contact.pressure > 0))
    assert 0 < pressed.on(contact).sites.size < chemistry.on(contact).sites.size
    assert chemistry.digest() != pressed.digest()
    # larger sites are averages, smaller ones are refused, in check too
    larger = chemistry.replace(site_density=0.25 / SIZE**2).on(contact)
    assert larger.sites.size == pytest.approx(chemistry.on(contact).sites.size / 4, rel=0.2)
    with pytest.raises(InputError, match=r"smaller than the pixels.*use pixels of"):
        chemistry.replace(site_density=30.0).on(contact)
    with pytest.raises(InputError, match="smaller than the pixels"):
        ca.run(parsed(**{"chemistry.site_density": 30.0}))
    with pytest.raises(InputError, match="tensile_sites"):
        contact_statistics(contact, chemistry)
    assert contact_statistics(contact, pressed).contact_area == pytest.approx(pressed.on(contact).sites.size * SIZE**2)


def test_measures_of_a_contact_under_tension():
    contact = jkr().solve(sphere(), -5)
    within = contact.pressure[contact.touching]
    assert contact.mean_contact_pressure == pytest.approx(within.mean())
    assert contact.mean_contact_pressure == pytest.approx(-5 / contact.area)
    assert math.isnan(contact.kappa)
    edges, density = contact.pressure_histogram(20)
    assert edges[0] == pytest.approx(within.min())
    assert edges[-1] == pytest.approx(within.max())
    assert float(density @ np.diff(edges)) == pytest.approx(1)
    above = contact.above(0.5)
    assert above.area == pytest.approx(np.mean(within > 0.5))
    assert above.load == pytest.approx(within[within > 0.5].sum() / contact.pressure[contact.pressure > 0].sum())
    assert contact.load_fault(0.0) == ""
    assert "adds up" in contact.model_copy(update={"load": -4.0}).load_fault(0.0)


def test_a_contact_with_tension_is_stored(tmp_path):
    run: Any = ca.run(parsed())
    ca.write(tmp_path / "run.h5", run)
    again: Any = ca.read(tmp_path / "run.h5")
    assert again.contact == run.contact
    assert np.array_equal(again.contact.touching, run.contact.touching)


def test_tension_needs_to_know_where_the_surfaces_touch():
    pressure = np.array([[1.0, -1.0]])
    fields: dict[str, Any] = {"pixel_size": 1, "modulus": 1, "load": 0}
    with pytest.raises(InputError, match="hard wall only pushes"):
        ca.ContactSolution(pressure=pressure, **fields)
    with pytest.raises(InputError, match="touching: shape"):
        ca.ContactSolution(pressure=pressure, touching=np.array([[True]]), **fields)
    contact = ca.ContactSolution(pressure=pressure, touching=np.array([[True, True]]), **fields)
    assert contact.sites.size == 2


@pytest.mark.parametrize(
    ("kind", "holds", "fails", "limit"), [("jkr", 6.0, 0.13, "above 5"), ("dmt", 0.09, 0.3, "below 0.1")]
)
def test_a_law_beyond_its_range_says_so_in_check_and_in_its_result(kind, holds, fails, limit):
    """Tabor's parameter (Rw²/(E*²z₀³))^(1/3), z₀ = 0.3 nm; issued with the law that holds there."""
    for tabor, beyond in ((holds, False), (fails, True)):
        work = E * math.sqrt((tabor * 0.3) ** 3 / R)
        solver = ca.contact(kind, modulus=E, work_of_adhesion=work)
        surface = sphere(128, size=1.0)
        said = solver.check({"nx": 128, "ny": 128, "pixel_size": 1.0, "radius": R}, 10.0)
        notes = solver.solve(surface, 10.0).notes
        assert tuple(said) == notes
        assert bool(notes) == beyond
        if beyond:
            assert f"is {limit}, and here it is {tabor:g} for" in notes[0]
            assert "use contact 'maugis'" in notes[0]
