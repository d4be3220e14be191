"""Paths of loads and approaches, and what a contact makes of them: closed forms, boundary elements, plastic shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage_contact.paths import Path

E, W, R = 35.3, 0.1, 30.0
LOST = 1.3236076  # of a JKR cycle: the integral of the load between first touch and jump-out


contact: Any = ca.contact


def sphere(pixels: int = 64, size: float = 0.4518, radius: float = R) -> Any:
    return ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=size).make()


def jkr(kind: str = "jkr", **options: Any) -> Any:
    given: dict[str, Any] = {"modulus": E, "work_of_adhesion": W, **options}
    return contact(kind, **given)


def soft(**options: Any) -> Any:
    return contact("adhesive-bem", **{"modulus": E, "work_of_adhesion": W, "range": 0.3, "law": "dugdale"} | options)


def hard(hardness: float = 5.0, **options: Any) -> Any:
    return contact("fft-bem", modulus=E, hardness=hardness, **options)


def rough(pixels: int = 64) -> Any:
    maker = ca.surface("self-affine", pixels=pixels, pixel_size=0.5, rms_slope=0.4, hurst=0.8, zeta=8, eta=3)
    return maker.make(seed=1)


def holds(quantity: Any, value: float) -> bool:
    return abs(quantity.value - value) <= quantity.half_width


# -- what a path is ---------------------------------------------------------------------------------------------------


def test_lengths_are_approaches_and_forces_are_loads():
    assert Path.of([0, "2 angstrom"]) == Path((0.0, 0.2), "approach")
    assert Path.of(["0 nN", "1 uN", 3]) == Path((0.0, 1000.0, 3.0), "load")
    assert Path.of(np.array([0.0, 1.0])) == Path((0.0, 1.0))


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ([], r"path = \[\]: has fewer than two values; give approaches such as"),
        ([0.0], "fewer than two values"),
        ("0.1 nm", "fewer than two values"),
        (None, "fewer than two values"),
        ([0.0, math.nan], "not finite"),
        (["deep", "deeper"], 'path: "deep" cannot be read as a quantity in n'),
        (["1 nm", "1 nN"], "path: .*is a quantity of nanonewton.*nm"),
    ],
)
@pytest.mark.parametrize("solver", [jkr(), soft(), hard(), contact("hertz", modulus=E)], ids=lambda one: one.kind)
def test_what_is_no_path_is_refused_in_its_words(solver, path, says):
    with pytest.raises(InputError, match=says):
        solver.loop(sphere(), path)


@pytest.mark.parametrize("solver", [jkr(), jkr("dmt"), jkr("maugis", range=0.3), contact("hertz", modulus=E)])
def test_a_contact_beyond_the_surface_is_refused(solver):
    with pytest.raises(InputError, match=r"but the surface reaches only 14.46 nm"):
        solver.loop(sphere(), ["0 nm", "10 nm"])


# -- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", [[-0.2, 0.0, 0.2, 0.0, -0.2], [-0.2, 0.3, -0.2], Path.down_to("20 nN")])
def test_a_jkr_cycle_is_exact_whatever_its_points(path):
    loop = jkr().loop(sphere(), path)
    assert loop.pull_off.value == pytest.approx(1.5 * math.pi * W * R, rel=1e-12)
    assert loop.jump_in.value == 0
    assert loop.jump_out.value == pytest.approx(-0.75 * (math.pi**2 * W**2 * R / E**2) ** (1 / 3), rel=1e-12)
    assert loop.dissipated.value == pytest.approx(LOST, rel=1e-6)
    assert [one.of for one in loop.jumps] == ["in", "out"]
    assert all(one.half_width == 0 and one.errors["path"].how == "closed form" for one in loop.quantities())


def test_what_an_open_path_dissipates_is_not_known():
    for solver in (jkr(), contact("hertz", modulus=E), hard()):
        lost = solver.loop(sphere(), [-0.2, 0.2]).dissipated
        assert math.isnan(lost.value)
        assert lost.text() == "not known: the path does not end in the state in which it began"


def test_under_given_loads_the_surfaces_part_at_pull_off():
    loop = jkr().loop(sphere(), ["0 nN", "10 nN", "-14 nN", "-15 nN", "-1 nN"])
    assert loop.pull_off.value == pytest.approx(1.5 * math.pi * W * R)
    assert loop.load.tolist() == [0, 10, -14, 0, 0]
    assert loop.area[-1] == 0
    assert "under a given load" in loop.dissipated.text()
    borne = jkr().loop(sphere(), ["0 nN", "-10 nN", "0 nN"])
    assert borne.pull_off.value == 10
    assert borne.pull_off.reason == "not parted"
    assert borne.dissipated.value == 0


@pytest.mark.parametrize("tabor", [0.05, 0.3, 1.0, 5.0])
def test_a_maugis_cycle_is_between_dmt_and_jkr(tabor):
    """The work between the jumps is that of a fine sum over the stable branches, with the attraction before contact."""
    reach = (R * W**2 / E**2 / tabor**3) ** (1 / 3)
    solver = jkr("maugis", range=reach)
    loop = solver.loop(sphere(128), Path.down_to("5 nN", points=2))
    at = np.linspace(-reach - 1.2 * (R * 8 * (W / reach / E / math.pi) ** 2), 0.1, 20001)
    down, up, state = [], [], 0
    every = solver.branches(R)
    for delta in at:
        while delta >= every[state].high:
            state += 1
        down.append(every[state].load(delta) if every[state].load else 0.0)
    for delta in at[::-1]:
        while delta < every[state].low:
            state -= 1
        up.append(every[state].load(delta) if every[state].load else 0.0)
    summed = np.trapezoid(down, at) + np.trapezoid(up, at[::-1])
    assert loop.dissipated.value == pytest.approx(summed, rel=0.01, abs=1e-3)
    assert 0 < loop.dissipated.value < LOST
    assert loop.pull_off.value == pytest.approx(solver.pull_off(R), rel=1e-9)


def test_a_hertz_cycle_loses_nothing():
    loop = contact("hertz", modulus=E).loop(sphere(), ["0 nN", "20 nN", "0 nN"])
    assert loop.dissipated.value == pytest.approx(0, abs=1e-12)
    assert loop.load.max() == pytest.approx(20)
    assert loop.pull_off.value == 0
    with pytest.raises(InputError, match="use contact 'fft-bem'"):
        contact("hertz", modulus=E, hardness=1.0).loop(sphere(), ["0 nN", "20 nN"])


# -- boundary elements ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [5, pytest.param(11, marks=pytest.mark.long)])
def test_any_number_of_points_gives_pull_off_within_its_error(points):
    """Tabor's parameter 0.7, Maugis' sphere."""
    maugis, tip = jkr("maugis", range=0.1), sphere(40, 0.25)
    there = np.linspace(-0.25, 0.25, points // 2 + 1)
    loop = soft(range=0.1).loop(tip, [*there, *there[-2::-1]])
    exact = maugis.loop(sphere(128), Path.down_to("5 nN"))
    for found, true in zip(loop.quantities(), exact.quantities(), strict=True):
        assert holds(found, true.value), (found.name, found.text(), true.value)
        assert {"path", "pixel"} <= found.errors.keys()
    assert len(loop.given) == len(loop.contacts) == 2 * (points // 2) + 1
    assert np.array_equal(loop.displacement[loop.given], [*there, *there[-2::-1]])


@pytest.mark.long
def test_a_path_of_loads_encloses_pull_off():
    tip, solver = sphere(40, 0.25), soft(range=0.1)
    by_load = solver.loop(tip, ["1 nN", "5 nN", "0 nN", "-25 nN"]).pull_off
    by_approach = solver.loop(tip, [-0.25, 0.1, -0.25]).pull_off
    assert by_load.errors["path"].size < 0.01
    # sticking to the grid depends on what is given
    assert abs(by_load.value - by_approach.value) < by_load.half_width + by_approach.half_width


@pytest.mark.long
def test_a_rough_path_down_and_up_begins_and_ends_apart():
    surface = ca.surface("self-affine", pixels=32, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=4, eta=2).make(1)
    load = 0.02 * E * surface.rms_slope * surface.nominal_area
    loop = soft(law="exponential", range=0.5).loop(surface, Path.down_to(load, points=6))
    assert loop.area[0] == loop.area[-1] == 0
    assert loop.load.max() == pytest.approx(load, rel=1e-3)
    assert loop.pull_off.value > 0
    assert loop.dissipated.value >= 0
    # equal where nothing jumps, up to the rounding of the steps there and back
    assert loop.jump_out.value <= loop.jump_in.value + 1e-12


@pytest.mark.parametrize(
    "seed", [1, pytest.param(2, marks=pytest.mark.campaign), pytest.param(3, marks=pytest.mark.campaign)]
)
@pytest.mark.long
def test_smaller_pixels_change_a_rough_path_about_as_much_as_it_states(seed):
    """Of four pixels to the shortest wave, against sixteen."""
    options = {"rms_slope": 0.17, "hurst": 0.8, "zeta": 8, "eta": 2}
    rough, fine = (
        ca.surface("self-affine", pixels=32 * k, pixel_size=0.5 / k, **options).make(seed=seed) for k in (1, 4)
    )
    solver = soft(law="exponential", range=0.08, work_of_adhesion=0.024)
    path = Path.down_to(0.02 * E * 0.17 * rough.nominal_area, points=5)
    found, true = solver.loop(rough, path), solver._follow(fine, path).quantities("approach")
    for one in (found.pull_off, found.work_of_separation, found.dissipated):
        assert holds(one, true[one.name].value), one.name
    assert abs(found.pull_off.value - true["pull_off"].value) > 0.1 * found.pull_off.half_width


# -- plastic shapes ---------------------------------------------------------------------------------------------------


def test_a_sweep_remembers_nothing_and_a_loop_what_has_flowed():
    surface, solver = rough(), hard()
    load = 0.02 * 5 * surface.nominal_area
    loads = [load, load / 2]
    apart = solver.sweep(surface, loads)
    alone = solver.solve(surface, load / 2)
    np.testing.assert_allclose(apart[1].pressure, alone.pressure, atol=1e-3)
    loop = solver.loop(surface, [f"{one} nN" for one in loads])
    unloaded = solver.solve(apart[0].residual_surface(surface), load / 2)
    assert loop.contacts[1].area == unloaded.area > alone.area
    soft_loads = [20.0, -5.0]
    tip = sphere(40, 0.25)
    assert [one.load for one in soft(range=0.1).sweep(tip, soft_loads[:1])] == soft_loads[:1]


def test_unloading_is_elastic_and_loading_again_changes_nothing():
    surface, solver = rough(), hard(tolerance=1e-7)
    load = 0.05 * 5 * surface.nominal_area
    there = np.linspace(0, load, 4)
    path = [*there, *there[-2::-1], *there[1:], 0.0]
    loop = solver.loop(surface, [f"{one!r} nN" for one in map(float, path)])
    peak, again = (loop.contacts[k] for k in (3, 9))
    np.testing.assert_allclose(again.pressure, peak.pressure, atol=2e-4 * 5)
    deepest = float(peak.plastic_displacement.max())
    np.testing.assert_allclose(again.plastic_displacement, peak.plastic_displacement, atol=1e-4 * deepest)
    # as in one step
    once = solver.solve(surface, load)
    np.testing.assert_allclose(peak.plastic_displacement, once.plastic_displacement, atol=1e-3 * deepest)
    left = loop.contacts[-1].residual_surface(surface)
    elastic = contact("fft-bem", modulus=E, tolerance=1e-7).solve(left, load / 3)
    np.testing.assert_allclose(loop.contacts[5].pressure, elastic.pressure, atol=2e-3 * 5)
    assert loop.jump_out.value == pytest.approx(float(surface.heights.max() - left.heights.max()))


def test_flow_does_not_depend_on_steps_and_loses_the_work_of_the_cycle():
    """∮F dδ by sums of 12 and 24 steps, extrapolated."""
    surface, lost, work = rough(), [], []
    for points in (12, 24):
        loop = hard(tolerance=1e-7).loop(surface, Path.down_to(0.05 * 5 * surface.nominal_area, points))
        lost.append(loop.dissipated)
        work.append(np.trapezoid(loop.load, loop.displacement))
    assert abs(lost[0].value - lost[1].value) < lost[0].half_width
    assert lost[0].value == pytest.approx(work[1] + (work[1] - work[0]) / 3, rel=2e-3)


def test_a_path_by_approach_is_the_path_by_load():
    surface, solver = rough(), hard(tolerance=1e-7)
    load = 0.05 * 5 * surface.nominal_area
    one = solver.loop(surface, ["0 nN", f"{load} nN", f"{load / 2} nN", "0 nN"])
    other = solver.loop(surface, [*one.displacement[:3], 0.0])
    np.testing.assert_allclose(other.load, one.load, rtol=1e-4)
    assert other.dissipated.value == pytest.approx(one.dissipated.value, rel=1e-4)


def test_an_elastic_path_is_its_contacts():
    surface, solver = rough(), contact("fft-bem", modulus=E, tolerance=1e-7)
    loop = solver.loop(surface, ["0 nN", "50 nN", "0 nN"])
    assert loop.dissipated.value == 0
    np.testing.assert_array_equal(loop.contacts[1].pressure, solver.solve(surface, 50.0).pressure)
    assert loop.pull_off.reason == "nothing adheres"


@pytest.mark.parametrize(("law", "seed"), [("dugdale", 1), pytest.param("exponential", 2, marks=pytest.mark.campaign)])
@pytest.mark.long
def test_what_a_loose_tolerance_changes_of_a_loop_is_within_its_errors(seed, law):
    surface = ca.surface("self-affine", pixels=36, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=4, eta=2).make(seed)
    solver = soft(law=law, range=0.5, work_of_adhesion=0.3)
    path = [-1.5, 0.0, 0.3, 0.0, -1.5]
    loose, exact = (solver.replace(tolerance=one, max_iterations=9000).loop(surface, path) for one in (1e-2, 1e-7))
    for one, other in zip(loose.quantities(), exact.quantities(), strict=True):
        if not one.known:
            continue
        assert set(one.errors) == {"path", "iteration", "pixel"}
        parts = one.errors["path"].size, one.errors["iteration"].size, other.errors["path"].size
        assert abs(one.value - other.value) <= 1.96 * math.hypot(*parts)
        assert one.errors["iteration"].size < 0.02 * max(abs(one.value), 0.5)
