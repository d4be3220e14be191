"""Rate-and-state laws against closed forms and an independent fit, and what traces tell of them."""

from __future__ import annotations

import importlib.resources
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rate_state import Case, drawn, solved, table_of

import chemage as ca
from chemage import InputError
from chemage_rate_state.fit import fit_rate_state
from chemage_rate_state.laws import LAWS, Loading, Parameters, change
from chemage_rate_state.traces import Trace, loading_of, read_trace

A, B, LENGTH = 0.008, 0.012, 10.0
STEP = Loading(np.array([0.0, 5.0]), np.array([1.0, 10.0]))
BASALT = importlib.resources.files("chemage_rate_state") / "data" / "basalt-velocity-step.txt"


def synthetic(law, seed=1, stiffness=5e-3, size=2e-4):
    truth = Parameters(A, B, LENGTH, stiffness)
    times = np.linspace(0.05, 25, 500)
    noise = size * np.random.default_rng(seed).standard_normal(times.size)
    return Trace("synthetic", times, 0.6 + change(law, truth, STEP, times) + noise, STEP), truth


def test_with_a_rigid_machine_the_ageing_law_evolves_exponentially():
    """Constant V after the step: θ = D_c/V + (D_c/V₀ − D_c/V) exp(−Vt/D_c)."""
    times = np.linspace(5.1, 20, 40)
    found = change("ageing", Parameters(A, B, LENGTH, 100.0), STEP, times)
    state = (1 + 9 * np.exp(-10 * (times - 5) / LENGTH)) / 10
    assert found == pytest.approx(A * np.log(10) + B * np.log(state), abs=2e-6)


def test_with_a_rigid_machine_the_slip_law_forgets_a_step_exponentially():
    """ln(Vθ/D_c) = ln(V/V₀) exp(−Vt/D_c)."""
    times = np.linspace(5.1, 20, 40)
    found = change("slip", Parameters(A, B, LENGTH, 100.0), STEP, times)
    kept = np.log(10) * np.exp(-10 * (times - 5) / LENGTH)
    assert found == pytest.approx((A - B) * np.log(10) + B * kept, abs=2e-6)


@pytest.mark.parametrize("law", LAWS)
def test_steady_friction_changes_by_a_minus_b(law):
    loading = Loading(np.array([0.0, 1.0, 101.0]), np.array([1.0, 10.0, 0.1]))
    found = change(law, Parameters(A, B, LENGTH, 5e-3), loading, np.array([0.5, 100.0, 5000.0]))
    assert found == pytest.approx((A - B) * np.log([1, 10, 0.1]), abs=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_below_the_critical_stiffness_oscillations_grow(law):
    """K_c = (b − a)/D_c (Ruina 1983)."""
    loading, times = Loading(np.array([0.0, 1.0]), np.array([1.0, 1.01])), np.linspace(1, 400, 4000)
    sizes = []
    for over in (0.95, 1.05):
        found = change(law, Parameters(A, B, LENGTH, over * (B - A) / LENGTH), loading, times)
        sizes.append(np.ptp(found[3000:]) / np.ptp(found[:1000]))
    assert sizes[0] > 1 > sizes[1]


@pytest.mark.parametrize("law", LAWS)
def test_in_a_hold_with_a_rigid_machine_only_the_ageing_law_heals(law):
    """θ̇ = 1, or 0, where nothing slips: the force relaxes by slip of the order of D_c ln t alone."""
    loading = Loading(np.array([0.0, 1.0, 1001.0]), np.array([1.0, 0.0, 1.0]))
    times = np.linspace(1001, 1020, 400)
    peak = change(law, Parameters(A, B, LENGTH, 1.0), loading, times).max()
    # dV/dt = −K V²/a: ln(V/V₀) falls as ln(1 + KVt/a), a slip of (a/K) ln(...), far below D_c
    aged = B * np.log(1 + 1000 / LENGTH)
    assert peak == (pytest.approx(aged, rel=0.05) if law == "ageing" else pytest.approx(0, abs=0.05 * aged))


@pytest.mark.parametrize("law", LAWS)
def test_intervals_hold_the_truth_and_the_other_law_fits_worse(law):
    trace, truth = synthetic(law)
    fit, other = fit_rate_state(trace, law), fit_rate_state(trace, LAWS[law == "ageing"])
    for one in fit.quantities():
        if one.name in truth._fields:
            assert one.low < getattr(truth, one.name) < one.high
            assert one.relative < 0.2
    assert fit.explains
    assert other.misfit - fit.misfit > 20
    assert not other.explains


def test_a_given_stiffness_is_kept():
    trace, truth = synthetic("slip")
    fit = fit_rate_state(Trace("t", trace.times, trace.friction, STEP, truth.stiffness), "slip")
    assert fit.parameters.stiffness == truth.stiffness
    assert fit.covariance.shape == (3, 3)
    assert fit.parameters.slip_length == pytest.approx(LENGTH, rel=0.05)


def test_what_is_no_transient_is_not_called_explained():
    """A drift that the law does not have is not taken for noise."""
    times = np.linspace(0.05, 25, 500)
    friction = 0.6 + 0.3 * np.sin(times / 3)
    assert not fit_rate_state(Trace("drift", times, friction, STEP)).explains


def test_speeds_are_found_in_a_noisy_displacement():
    times = np.arange(0, 60, 0.02)
    loading = Loading(np.array([0.0, 15.0, 30.0, 50.0]), np.array([3.0, 10.0, 0.0, 3.0]))
    way = loading.displacement(times) + 0.2 * np.random.default_rng(1).standard_normal(times.size)
    found = loading_of(times, way)
    assert found.times[1:] == pytest.approx(loading.times[1:], abs=0.1)
    assert found.speeds == pytest.approx(loading.speeds, rel=0.01, abs=0.02)


def test_a_basalt_step_agrees_with_an_independent_fit():
    """Least squares of scipy's curve_fit with the forward model of rsfmodel (MIT), at these changes."""
    independent = {"ageing": (8.852e-3, 9.284e-3, 6.874, 1.0829e-2), "slip": (9.216e-3, 9.680e-3, 9.284, 1.0125e-2)}
    found = read_trace(BASALT).loading
    assert found.speeds[[0, -1]] == pytest.approx([3, 10], rel=0.01)
    assert found.times[1] == pytest.approx(11676.4, abs=0.05)
    trace = read_trace(BASALT, None, [3.015, 10.19, 10.0], [11676.443, 11693.343])
    for law in LAWS:
        fit = fit_rate_state(trace, law)
        numbers = {one.name: one for one in fit.quantities()}
        for name, value in zip(Parameters._fields, independent[law], strict=True):
            one = numbers[name]
            if name == "stiffness":  # depends on trends, of which there is one more here
                assert one.low < value < one.high
            else:
                assert abs(one.value - value) < 0.5 * one.half_width
        assert not fit.explains


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["time (s),friction_coefficient"], "no column displacement"),
        (["time (s),displacement (um),temperature (K)"], "no column friction"),
        (["time,displacement (um),friction_coefficient"], "no unit"),
    ],
)
def test_a_table_without_what_is_needed_is_refused(tmp_path, lines, message):
    path = tmp_path / "trace.csv"
    rows = ("1,2,0.6" if lines[0].count(",") == 2 else "1,2" for _ in range(9))
    path.write_text("\n".join([*lines, *rows]))
    with pytest.raises(InputError, match=message):
        read_trace(path)


def test_a_trace_that_tells_nothing_is_refused():
    times = np.arange(50.0)
    with pytest.raises(InputError, match="must change"):
        Trace("t", times, times, Loading(np.zeros(1), np.ones(1)))
    with pytest.raises(InputError, match=r"points \[3\] do not"):
        Trace("t", np.array([0, 1, 1, *range(2, 40)]), np.zeros(41), STEP)
    with pytest.raises(InputError, match="there are ageing, slip"):
        fit_rate_state(synthetic("slip")[0], "ruina")
    with pytest.raises(InputError, match="moves back"):
        loading_of(times, np.where(times < 20, times, 40 - times))


def test_an_unstable_slider_is_not_a_number():
    found = change("slip", Parameters(A, 3 * B, LENGTH, 1e-6), STEP, np.linspace(5, 5000, 10))
    assert found[0] == 0
    assert np.isnan(found[-1])


@pytest.mark.parametrize("number", [0, 3, 8, 15, 18, 38])
def test_an_independent_integration_agrees(number):
    """The equations for μ and θ, by LSODA, with other steps."""
    case = drawn(number, 1)
    times = case.interval * np.arange(1, int(sum(case.spans) / case.interval) + 1)
    loading = Loading(np.append(0.0, case.changes), np.array(case.speeds))
    truth = Parameters(case.a, case.b, case.slip_length, case.stiffness)
    found, expected = change(case.law, truth, loading, times), solved(case, times)
    assert found == pytest.approx(expected, abs=1e-6 * np.ptp(expected))


def test_a_simulated_programme_is_a_trace():
    scene = {
        "name": "slides",
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 32, "pixel_size": "0.9 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
        "forming": {"kind": "gaussian", "mean": "0.7 eV", "std": "0.02 eV"},
        "breaking": {"kind": "gaussian", "mean": "1.1 eV", "std": "0.02 eV"},
        "chemistry": {"activation_volume": "6.4 angstrom**3"},
        "engine": {"kind": "rejection-free"},
        "hold": {"temperature": "300 K", "replicas": 2},
        "drive": {"bond_stiffness": "10 nN/nm", "transition_distance": "0.03 nm", "spring": "1000 nN/nm"},
        "protocol": {"kind": "velocity-steps", "speeds": ["10 nm/s", "100 nm/s"], "distance": "4 nm"},
    }
    run = ca.run(scene)
    trace = ca.trace_of(run)
    assert trace.stiffness == pytest.approx(1000 / 50 * 1e3)
    assert trace.loading.speeds == pytest.approx([0.01, 0.1])
    # from the last quarter of the first slide on
    assert trace.times[0] == pytest.approx(0.3, abs=0.005)
    assert trace.loading.times == pytest.approx([0.3, 0.4], abs=0.005)
    assert trace.friction[-1] == pytest.approx(run.ageing.friction_drop[:, -1].mean() / 50)
    slides = [{"speed": "10 nm/s", "distance": "1 nm"}, {"speed": {"to": "100 nm/s"}, "distance": "1 nm"}]
    del scene["protocol"]
    with pytest.raises(InputError, match=r"step\.1\.speed: .*write ramps as steps"):
        ca.trace_of(ca.run(scene | {"step": slides}))
    slides[1] = {"speed": "100 nm/s", "distance": "1 nm", "temperature": "310 K"}
    with pytest.raises(InputError, match=r"temperature: .*one temperature"):
        ca.trace_of(ca.run(scene | {"step": slides}))
    del scene["drive"]
    with pytest.raises(InputError, match="no programme of slides"):
        ca.trace_of(ca.run(scene | {"hold": {"times": [1.0]}}))


#: µm, s: steps and holds of a load point, with a uniform clock
PROGRAMMES = {
    "1-3-1": Case("ageing", 0.008, 0.01, 5.0, 2e-3, (1, 3, 1), (60, 30, 60), 0.1),
    "1-0-1": Case("ageing", 0.008, 0.01, 5.0, 2e-3, (1, 0, 1), (60, 60, 60), 0.1),
    "1-0-1-0-1": Case("slip", 0.008, 0.01, 5.0, 2e-3, (1, 0, 1, 0, 1), (60, 30, 60, 100, 60), 0.1),
    "1-10-1-10": Case("slip", 0.008, 0.01, 5.0, 2e-3, (1, 10, 1, 10), (60, 6, 60, 6), 0.05),
    "near k_c": Case("ageing", 0.008, 0.01, 5.0, 1.1 * 4e-4, (1, 3, 1), (100, 40, 100), 0.2),
    "slip near k_c": Case("slip", 0.008, 0.012, 5.0, 1.3 * 8e-4, (1, 2, 1), (100, 50, 100), 0.2),
}


@pytest.mark.parametrize("jitter", [0.0, 1e-4])
@pytest.mark.parametrize("programme", PROGRAMMES)
def test_a_table_gives_the_speeds_and_the_parameters(command, tmp_path, programme, jitter):
    case = replace(PROGRAMMES[programme], size=2e-4, jitter=jitter, seed=4)
    path = table_of(case, tmp_path / "trace.csv")
    found = json.loads(command("rate-state", str(path), "--law", case.law, "--json").out)
    assert found["speeds"] == pytest.approx(case.speeds, rel=0.01, abs=1e-3)
    assert found["changes"] == pytest.approx(case.changes, abs=0.5 * case.interval)
    for name in ("a", "b", "slip_length", "stiffness"):
        number = found[f"{case.law}_{name}"]
        # twice the half width of a 95 % interval: four standard errors
        ratio = number["high"] / number["low"]
        assert 1 / ratio < number["value"] / getattr(case, name) < ratio
        assert ratio < 2
    assert found[f"{case.law}_explains"]


def test_speeds_of_a_hundred_noisy_slide_hold_slides_are_right():
    rng = np.random.default_rng(5)
    for _ in range(100):
        spans = rng.uniform([20, 10, 20], [100, 1000, 100])
        loading = Loading(np.append(0.0, np.cumsum(spans)[:2]), np.array([1.0, 0.0, 1.0]))
        times = np.arange(0.1, spans.sum(), 0.2)
        way = loading.displacement(times)
        found = loading_of(times, way + 1e-4 * way[-1] * rng.standard_normal(times.size))
        assert found.speeds == pytest.approx(loading.speeds, abs=0.01)
        assert found.times[1:] == pytest.approx(loading.times[1:], abs=0.5)


def test_known_speeds_and_changes_are_used(command, tmp_path):
    case = replace(PROGRAMMES["1-3-1"], size=2e-4)
    path = str(table_of(case, tmp_path / "trace.csv"))
    speeds = "--speeds", "1 um/s, 3 um/s, 0.001 mm/s"
    known = *speeds, "--changes", "61 s, 1.5 min"
    found = json.loads(command("rate-state", path, "--law", "ageing", *known, "--json").out)
    assert found["speeds"] == [1, 3, 1]
    assert found["changes"] == [61, 90]
    for wrong in (speeds, known[2:], (*speeds, "--changes", "61 s, 1 s"), (*speeds, "--changes", "61 s, 500 s")):
        done = command("rate-state", path, *wrong)
        assert done.status == 2
        assert "at times that rise from 0.1 to 150 s" in done.err


def test_a_minimum_that_is_nearly_as_good_is_named(command, tmp_path):
    """A stiff spring is told by few points."""
    case = Case("ageing", 0.004, 0.005, 5.0, 5e-3, (1, 1.5, 1), (40, 40, 40), 0.5, size=4e-4, seed=3)
    path = table_of(case, tmp_path / "trace.csv")
    found = json.loads(command("rate-state", str(path), "--json").out)
    rivals = [re.search(r"fits nearly as well, misfit (.*) larger", name) for name in found]
    assert any(rivals)
    assert all(0 <= float(one[1]) < 6 for one in rivals if one)
    assert "fits nearly as well" in command("rate-state", str(path)).out


def test_a_law_that_cannot_be_fitted_leaves_the_other(command, tmp_path, monkeypatch):
    from chemage_rate_state import fit

    path = str(table_of(replace(PROGRAMMES["1-3-1"], size=2e-4), tmp_path / "trace.csv"))
    starts = fit._Misfit.starts
    monkeypatch.setattr(fit._Misfit, "starts", lambda self: [] if self.law == "slip" else starts(self))
    found = json.loads(command("rate-state", path, "--json").out)
    assert "slip_a" not in found
    assert found["ageing_a"]["value"] > 0
    assert "unstable from every start" in found["slip law"]
    assert "not fitted: the slip law is unstable" in command("rate-state", path).out
    done = command("rate-state", path, "--law", "slip")
    assert done.status == 2
    assert "unstable from every start" in done.err


def test_the_command_prints_both_laws(tmp_path, command):
    trace, _ = synthetic("slip")
    path = tmp_path / "trace.csv"
    rows = zip(trace.times, STEP.displacement(trace.times), trace.friction, strict=True)
    path.write_text(
        "time (s),displacement (um),friction_coefficient\n" + "\n".join(",".join(map(str, row)) for row in rows)
    )
    found = json.loads(command("rate-state", str(path), "--json").out)
    assert {f"{law}_a" for law in LAWS} <= set(found)
    assert found["slip_slip_length"]["value"] == pytest.approx(LENGTH, rel=0.1)
    text = command("rate-state", str(path), "--law", "slip", "--stiffness", "0.005 um**-1").out
    assert "explains the trace" in text
    assert "(given)" in text
    command("rate-state", str(path), "--law", "slip", "--out", str(tmp_path / "fit.png"))
    assert (tmp_path / "fit.png").stat().st_size > 1000
    assert command("rate-state", str(path), "--csv").out.startswith("time (s),displacement (um),friction")
