"""From curves to densities: known truths are found, nothing is claimed where nothing is seen, bad input is refused."""

from __future__ import annotations

import warnings

import faults
import numpy as np
import pytest
from made_inference import made_inference

import chemage as ca

TIMES = np.logspace(-3, 5, 25)
NOISE = 0.03
SCALE = 300.0


@pytest.fixture(autouse=True)
def fewer_samples(monkeypatch):
    """Means and bands need fewer effective samples than users get."""
    faults.fewer_samples(monkeypatch)


def scene(strength=0.0, **changes):
    data, _ = ca.plugin.scene_data("silica-tip")
    interaction = {"interaction.strength": strength} if strength else {"interaction": None}
    return ca.parse_scene(ca.plugin.override(data, {"observe": [], **interaction, **changes}))


def solved(made):
    return ca.solve_contact(made.solver, ca.make_surface(made.surface), made.load)


def curve(forming, *, made=None, temperature=300.0, seed=7, times=TIMES, noise=NOISE):
    """A curve without interaction, exact but for noise of 3 %."""
    made = made or scene()
    chemistry = made.chemistry.replace(forming=forming)
    call = {"engine": made.engine, "hold_times": times, "temperature": temperature, "replicas": 1}
    ageing = ca.age(solved(made), chemistry, method=ca.ageing_method("closure"), **call)
    values = ageing.friction_drop[0]
    noisy = values * (1 + noise * np.random.default_rng(seed).standard_normal(times.size))
    return ca.MeasuredCurve(
        load=made.load, temperature=temperature, hold_times=times, values=noisy, errors=noise * values
    )


def rising(times=TIMES, errors=1.0):
    values = 50.0 * np.log10(times / times[0] * 10)
    return ca.MeasuredCurve(
        load=50.0, temperature=300.0, hold_times=times, values=values, errors=np.full(times.size, errors)
    )


def distance(found, forming):
    """L1 distance over the visible energies."""
    step = found.energies[1] - found.energies[0]
    fine = found.energies[:, None] + step * ((np.arange(20) + 0.5) / 20 - 0.5)
    truth = forming.density(fine).mean(axis=1)
    return float((np.abs(found.density - truth) * step)[found.visible].sum())


def two_peaks():
    energies = np.linspace(0.4, 1.4, 1001)
    weights = sum(np.exp(-0.5 * ((energies - at) / 0.03) ** 2) for at in (0.73, 1.03))
    return ca.barriers("tabulated", energies=energies.tolist(), weights=weights.tolist())


TRUTHS = {
    "uniform": lambda: ca.barriers("uniform", lower=0.8, upper=1.4),
    "triangle": lambda: ca.barriers("tabulated", energies=[0.8, 1.0, 1.2], weights=[0, 1, 0]),
    "gaussian": lambda: ca.barriers("gaussian", mean=1.05, std=0.08),
    "two peaks": two_peaks,
}


@pytest.mark.parametrize(
    # a triangle is a peak, as the normal distribution is
    "name",
    [pytest.param(name, marks=pytest.mark.long if name == "two peaks" else pytest.mark.campaign) for name in TRUTHS],
)
def test_a_known_density_is_recovered_and_nothing_is_claimed_outside(name):
    forming = TRUTHS[name]()
    found = ca.infer(curve(forming), scene(), families=(), samples=500, seed=3)
    if name == "two peaks":
        # as narrow as the resolution: no further than the data leave open, by the posterior's own account
        step = found.energies[1] - found.energies[0]
        away = (np.abs(found.samples - found.density) * step)[:, found.visible].sum(axis=1)
        assert distance(found, forming) <= np.quantile(away, 0.95)
    else:
        assert distance(found, forming) <= 0.15
    low, high = found.visible_range
    # k_BT ln(νt) of the first and last hold time, less the pressure of up to 0.1 eV, more the width of a step
    assert 0.55 < low < 0.75
    assert 1.05 < high < 1.2
    if name == "uniform":  # more than a third of the barriers lies above what is seen, anywhere
        outside = (found.energies > high + 0.03) & (found.energies < high + 0.3)
        share = found.samples[:, outside].sum(axis=1) * (found.energies[1] - found.energies[0])
        assert np.quantile(share, 0.95) - np.quantile(share, 0.05) > 0.2
    if name == "two peaks":
        valley = found.density[(found.energies > 0.82) & (found.energies < 0.94)].max()
        for peak in (0.73, 1.03):
            near = np.abs(found.energies - peak) < 0.03
            assert found.density[near].max() > 4 * valley
    assert found.chi2 < 45


@pytest.mark.campaign
def test_the_interaction_is_part_of_the_inference_and_leaving_it_out_is_worse():
    forming = ca.barriers("tabulated", energies=[0.8, 1.0, 1.2], weights=[0, 1, 0])
    made = scene(0.5)
    chemistry = made.chemistry.replace(forming=forming)
    call = {"engine": made.engine, "hold_times": TIMES, "temperature": 300.0, "replicas": 600, "seed": 21}
    ageing = ca.age(solved(made), chemistry, **call)
    values, error = np.maximum(ageing.mean_friction_drop, 1e-2), ageing.friction_drop_stderr
    noisy = values * (1 + NOISE * np.random.default_rng(4).standard_normal(TIMES.size))
    measured = ca.MeasuredCurve(
        load=50.0, temperature=300.0, hold_times=TIMES, values=noisy, errors=np.hypot(NOISE * values, error) + 1e-3
    )
    found = ca.infer(measured, made, families=("triangle",), samples=400, seed=3)
    alone = ca.infer(measured, scene(), families=("triangle",), samples=400, seed=3)
    assert distance(found, forming) <= 0.25
    assert distance(alone, forming) > 0.4
    assert found.scores["triangle"] > alone.scores["triangle"] + 3
    assert found.diagnostics["changes"][-1] < 0.1


@pytest.mark.campaign
def test_a_left_out_load_is_predicted_and_a_plan_is_ranked():
    forming = ca.barriers("gaussian", mean=0.95, std=0.1)
    found = ca.infer(curve(forming), scene(), families=(), samples=400, seed=5)
    other = scene(**{"contact.load": 200.0})
    truth = curve(forming, made=other, noise=1e-9, times=np.logspace(-2, 4, 7)).values
    forecast = found.forecast(load="200 nN", hold_times=np.logspace(-2, 4, 7))
    low, high = forecast.band(0.95)
    assert np.mean((truth >= low) & (truth <= high)) > 0.7
    assert forecast.friction_drop == pytest.approx(truth, rel=0.08)
    plans = found.next_experiment([{"hold_time": "1 s"}, {"hold_time": 10.0, "load": 200.0}], target={"energy": 0.85})
    assert plans[0]["reduction"] >= plans[1]["reduction"] >= 0
    assert all(0 <= one["reduction"] < 1 for one in plans)


def test_a_forecast_that_asks_for_energies_which_are_not_visible_says_so():
    def seen(one, kelvin, times):
        """Notes on energies; those of the critic are tested with it."""
        notes = one.forecast(temperature=kelvin, hold_times=times).notes
        return [note for note in notes if not note.startswith("unnoticed, ")]

    one = made_inference((0.85, 1.25), visible=np.linspace(0.55, 1.45, 61) < 1.2)
    assert not seen(one, "300 K", [1e-3, 1.0])
    (note,) = seen(one, "350 K", [1.0, 1e3, 1e6])
    assert note.startswith("from 1e+06 s on, more than 5 % of the predicted friction comes from energies that the data")
    above = made_inference((0.85,), visible=np.linspace(0.55, 1.45, 61) > 0.75)
    (note,) = seen(above, "300 K", [1e-3, 1e4])
    assert note.startswith("up to 0.001 s, more than 5 %")


WRONG = {
    "no time above zero": (lambda one: one.forecast(hold_times=[0.0]), "must have a time above zero"),
    "no samples": (lambda one: one.forecast(samples=0), "samples = 0"),
    "no level": (lambda one: one.band(1.5), "level = 1.5: must be between 0 and 1"),
    "planned at once": (lambda one: one.next_experiment([{"hold_time": 0}]), "hold_time = 0: must be above zero"),
    "negative error": (
        lambda one: one.next_experiment([{"hold_time": 1, "error": "-3 %"}]), "error = '-3 %': must be above"
    ),
    "no error": (lambda one: one.next_experiment([{"hold_time": 1, "error": "x %"}]), "candidates.0.error"),
    "unknown word": (lambda one: one.next_experiment([{"hold_time": 1, "loads": 3}]), "is not known .*load"),
    "no target": (lambda one: one.next_experiment([{"hold_time": 1}], target="1 eV"), "must be a dict"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "message"), WRONG.values(), ids=WRONG)
def test_wrong_questions_to_an_inference_are_refused(call, message):
    with pytest.raises(ca.InputError, match=message):
        call(made_inference())


@pytest.mark.long
def test_the_result_is_stored_whole_and_the_same_seed_gives_the_same_on_one_thread(tmp_path):
    data = curve(ca.barriers("gaussian", mean=0.95, std=0.1))
    found = ca.infer(data, scene(), families=("uniform", "gaussian"), samples=60, seed=1, threads=3)
    ca.write(tmp_path / "i.h5", found)
    again = ca.read(tmp_path / "i.h5")
    assert again == found
    assert again.scene.digest() == found.scene.digest()
    assert found.scores["gaussian"] > found.scores["uniform"]
    other = ca.infer(data, scene(), families=("uniform", "gaussian"), samples=60, seed=1, threads=1)
    assert np.array_equal(other.samples, found.samples)
    assert other.scores == found.scores
    assert found.families["gaussian"]["parameters"]["mean (eV)"] == pytest.approx(0.95, abs=0.02)
    assert len(found.members(17)) == 17
    summary = found.summary()
    assert len(summary["residuals"]) == summary["points"] == 25


@pytest.mark.campaign
def test_an_unknown_activation_volume_is_found_from_two_loads():
    forming = ca.barriers("gaussian", mean=0.95, std=0.1)
    curves = [curve(forming, made=scene(**{"contact.load": load}), seed=int(load)) for load in (20.0, 500.0)]
    unknown = {"activation_volume": ("0 angstrom**3", "15 angstrom**3")}
    found = ca.infer(curves, scene(), unknown=unknown, families=(), samples=400, seed=2)
    low, high = found.interval("activation_volume")
    assert high - low < 0.004
    assert found.scalars["activation_volume"].mean() == pytest.approx(0.0064, abs=0.001)
    assert 0.0061 < low < 0.0064 < high < 0.0067
    with pytest.raises(ca.InputError, match="was not inferred; there are activation_volume"):
        found.interval("bond_force")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"unknown": ("mass",)}, "unknown = 'mass': cannot be inferred"),
        ({"unknown": {"bond_force": (3.0, 1.0)}}, "must be a lower and a larger upper bound"),
        ({"families": ("lorentz",)}, "families = 'lorentz': is no family; choose of uniform"),
        ({"samples": 3}, "samples = 3: must be a whole number of at least 50"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_wrong_arguments_are_refused(given, message):
    with pytest.raises(ca.InputError, match=message):
        ca.infer(rising(), scene(), **given)


@pytest.mark.parametrize("given", [140.0, "140 K", "140 degC"])
def test_kelvin_that_may_be_degrees_celsius_are_asked_about_before_anything_is_computed(given, monkeypatch):
    """But not where the unit is written with the number."""
    cold = rising().model_dump() | {"temperature": given, "name": "cold"}

    def stopped(*args, **how):
        raise ca.InputError("computed")

    monkeypatch.setattr("chemage_inference.infer.make_model", stopped)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        with pytest.raises(ca.InputError, match="computed"):
            ca.infer(ca.MeasuredCurve(**cold), scene())
    asked = (
        'cold: temperature = 140 K: is 140 °C meant? Write "140 degC", which is 413.15 K, or "140 K" if that is meant'
    )
    assert [str(one.message) for one in found] == [asked] * (given == 140.0)
    assert all(one.category is ca.PlanWarning for one in found)


def test_fewer_points_than_unknowns_are_refused():
    few = rising(np.array([0.1, 1.0, 100.0]))
    with pytest.raises(ca.InputError, match=r"3 points are fewer than the unknowns, .* bond_force; measure at more"):
        ca.infer(few, scene(), unknown=("bond_force",))
    with pytest.raises(ca.InputError, match="is no MeasuredCurve"):
        ca.infer([1, 2], scene())  # pyright: ignore[reportArgumentType]


def test_curves_of_another_chemistry_are_refused():
    simulated = rising().model_copy(update={"chemistry": scene().chemistry.todict()})
    other = scene(**{"chemistry.activation_volume": "0 nm**3"})
    with pytest.raises(ca.InputError, match=r"measured with activation_volume = 0.0064, .* has 0.0; infer"):
        ca.infer(simulated, other)


def test_data_that_no_density_explains_are_refused_with_the_best_fit():
    """A jump by a factor of ten within a third of a decade, and more friction than all sites together can give."""
    jump = ca.MeasuredCurve(
        load=50.0, temperature=300.0, hold_times=TIMES, values=np.where(TIMES < 1, 10.0, 100.0), errors=np.ones(25)
    )
    with pytest.raises(
        ca.plugin.UnexplainedError, match="no density of barriers explains them; the best fit has χ² = "
    ) as one:
        ca.infer(jump, scene())
    assert "rises faster with the hold time than a single barrier" in str(one.value)
    assert one.value.chi2 > 100
    assert one.value.density.shape == one.value.energies.shape
    assert np.abs(one.value.residuals).max() > 3
    below = rising().model_copy(update={"values": rising().values - 300})
    with pytest.raises(ca.plugin.UnexplainedError, match="values are below zero, but bonds that form can only add"):
        ca.infer(below, scene())
    much = rising().model_copy(update={"values": 20 * rising().values})
    with pytest.raises(ca.plugin.UnexplainedError, match="all sites of the contact would have to be bonded and more"):
        ca.infer(much, scene())


def independent_sites(made, energies, weights, times):
    """ΔF (nN) of independent sites at 300 K in closed form: a/(a + b) (1 − exp(−(a + b) t)) of every site."""
    kt, chemistry = ca.plugin.units.KB * 300, made.chemistry
    sites = chemistry.sites_of(solved(made))
    ranks = (np.arange(20) + 0.5) / 20
    lowering = chemistry.activation_volume * 6.241509 * np.quantile(sites.pressure, ranks)  # 1 GPa nm³ = 6.24 eV
    total = np.zeros(times.size)
    for breaking in 1e13 * np.exp(-chemistry.breaking.quantile(ranks) / kt):
        for forming in 1e13 * np.exp(-(energies - lowering[:, None]) / kt):
            bonded = forming / (forming + breaking) * -np.expm1(-times[:, None] * (forming + breaking))
            total += bonded @ weights / weights.sum() / ranks.size**2
    return total * sites.pressure.size * chemistry.bond_force * chemistry.front_factor * chemistry.hydroxylation


def outside(peak, times, asked, seed):
    """An inference of hold times before which no site of a narrow peak reacts, a forecast, and its truth."""
    data, _ = ca.plugin.scene_data("silica-linear-tip")
    made = ca.parse_scene(ca.plugin.override(data, {"observe": [], "interaction": None}))
    energies = np.linspace(0.3, 1.5, 1201)
    weights = np.exp(-0.5 * ((energies - peak) / 0.02) ** 2)
    values, truth = (independent_sites(made, energies, weights, at) for at in (times, asked))
    noisy = values * (1 + NOISE * np.random.default_rng(seed).standard_normal(times.size))
    measured = ca.MeasuredCurve(
        load=made.load, temperature=300.0, hold_times=times, values=noisy, errors=NOISE * values
    )
    found = ca.infer(measured, made, families=(), samples=400, seed=seed)
    return found, found.forecast(hold_times=asked), truth


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("times", "peaks", "asked", "least"),
    [
        (np.linspace(0.005, 0.09, 10), np.linspace(0.82, 1.06, 8), np.array([1e2, 1e5]), 6),
        (np.logspace(-2, 2, 13), np.linspace(1.04, 1.18, 8), np.array([1e5, 1e7]), 7),
    ],
    ids=("90 ms", "100 s"),
)
def test_forecasts_hold_narrow_peaks_above_what_linear_ageing_sees(times, peaks, asked, least):
    """90 % bands after points from 5 to 90 ms, or from 0.01 to 100 s; what all sites give is known within 0.1 %."""
    held = []
    for number, peak in enumerate(peaks):
        found, forecast, truth = outside(float(peak), times, asked, 40 + number)
        low, high = forecast.band(0.9)
        held.append((truth >= 0.999 * low) & (truth <= 1.001 * high + 1.6))
        assert forecast.bounds_only
        chemistry = found.scene.chemistry
        few = found.values.max() < chemistry.bond_force * chemistry.front_factor
        begin = "less than one bond of " if few else "barriers lie above the visible energies: "
        assert any(note.startswith(begin) for note in found.notes)
        assert not any("nothing is claimed" in note for note in found.notes)
    assert (np.sum(held, axis=0) >= least).all()


@pytest.mark.long
def test_without_any_bond_a_note_says_that_forecasts_are_bounds_from_none_to_all_sites():
    """Nothing was measured by 90 ms (± 0.1 nN)."""
    data, _ = ca.plugin.scene_data("silica-linear-tip")
    made = ca.parse_scene(ca.plugin.override(data, {"observe": [], "interaction": None}))
    nothing = ca.MeasuredCurve(
        load=made.load,
        temperature=300.0,
        hold_times=np.linspace(0.005, 0.09, 10),
        values=np.zeros(10),
        errors=np.full(10, 0.1),
    )
    found = ca.infer(nothing, made, families=(), samples=400, seed=1)
    (note,) = [note for note in found.notes if note.startswith("less than one bond of ")]
    assert "by 0.09 s" in note
    assert "from none to all sites (0 to 1620 nN under " in note
    forecast = found.forecast(hold_times=np.array([1e5]))
    assert forecast.bounds_only
    low, high = forecast.band(0.9)
    assert low[0] < 0.02 * 1620
    assert high[0] > 0.5 * 1620


@pytest.mark.campaign
def test_linear_ageing_is_a_narrow_peak_at_the_upper_end_and_logarithmic_ageing_a_flat_density():
    """Tian et al., Phys. Rev. Lett. 124, 026801 (2020): linear ageing of 5 to 90 ms at 300 K."""
    times = np.linspace(0.005, 0.09, 18)
    data, _ = ca.plugin.scene_data("silica-linear-tip")
    made = ca.parse_scene(ca.plugin.override(data, {"observe": [], "interaction": None}))
    values = 40.0 * times / 0.09
    measured = ca.MeasuredCurve(
        load=made.load, temperature=300.0, hold_times=times, values=values, errors=NOISE * values
    )
    found = ca.infer(measured, made, families=(), samples=400, seed=1)
    upper = ca.plugin.units.KB * 300 * np.log(1e13 * 0.09)
    below = found.energies < upper - 0.06
    share = found.samples @ np.gradient(found.energies)
    low = found.samples[:, below].sum(axis=1) * np.gradient(found.energies)[0]
    # nearly nothing below; the rise is that of a peak at or above the upper end
    assert low.mean() < 0.15 * share.mean()
    logarithmic = rising(errors=3.0)
    flat = ca.infer(logarithmic, scene(), families=(), samples=400, seed=1)
    inside = flat.visible & (flat.energies > 0.7) & (flat.energies < 1.0)
    assert flat.density[inside].std() < 0.2 * flat.density[inside].mean()
