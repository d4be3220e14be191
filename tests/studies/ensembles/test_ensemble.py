"""Ensembles of real scenes: what they average, what they keep, what they refuse."""

from __future__ import annotations

import faults
import numpy as np
import pytest

import chemage as ca
from chemage import Ensemble, InputError, ensemble
from chemage.plugin import registry
from chemage.studies.ensembles import running
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.planning import plan

ROUGH = {
    "name": "small",
    "surface": {"kind": "self-affine", "pixels": 128, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 400.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5},
}  # fmt: skip
TIP = {
    **ROUGH,
    "surface": {"kind": "sphere", "radius": 30.0, "pixels": 64, "pixel_size": 0.45},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": 50.0},
}


@pytest.fixture(scope="module")
def rough() -> ca.Scene:
    return ca.parse_scene(ROUGH)


@pytest.fixture(scope="module")
def four(rough) -> Ensemble:
    return ensemble(rough, surfaces=4)


def test_an_ensemble_of_four_is_the_mean_of_four_runs(rough, four):
    betas, drops, areas = [], [], []
    for surface, hold in four.levels[0]["seeds"]:
        one = rough.model_copy(
            update={"surface_seed": surface, "hold": rough.hold.model_copy(update={"seed": hold, "common": "all"})}
        )
        made = ca.run(one)
        betas.append(made.fit().beta)
        drops.append(made.ageing.mean_friction_drop)
        areas.append(made.contact.quantity("area_fraction").value)
    assert len(set(areas)) == 4
    assert four.estimate("beta").value == pytest.approx(np.mean(betas), rel=1e-12)
    assert four.friction_drop == pytest.approx(np.mean(drops, axis=0), rel=1e-12)
    assert four.estimate("area_fraction").value == pytest.approx(np.mean(areas), rel=1e-12)
    # Student's interval of four
    limit = 3.182446305284263
    assert four.estimate("beta").half_width == pytest.approx(limit * np.std(betas, ddof=1) / 2, rel=1e-9)


def test_the_errors_of_surfaces_and_replicas_add_up_to_the_scatter(four):
    beta = four.estimate("beta")
    parts = [part.size for part in beta.errors.values()]
    assert set(beta.errors) == {"surfaces", "replicas"}
    assert np.hypot(*parts) * 3.182446305284263 == pytest.approx(beta.half_width, rel=1e-6)


def test_the_number_of_threads_changes_nothing(rough, four):
    assert ensemble(rough, surfaces=4, threads=1).digest() == four.digest()


@pytest.mark.parametrize(("executor", "workers"), [("threads", 2), ("serial", None)])
def test_workers_that_are_asked_for_are_those_of_the_study(rough, four, monkeypatch, executor, workers):
    asked, real = [], running.carry_out

    def carry_out(*args, **options):
        asked.append((options["executor"], options["workers"]))
        return real(*args, **options)

    monkeypatch.setattr(running, "carry_out", carry_out)
    assert ensemble(rough, surfaces=4, executor=executor, workers=workers).digest() == four.digest()
    assert asked == [(executor, workers)]


def test_an_accuracy_is_reached_on_coarse_and_fine_grids(rough):
    made = ensemble(rough, accuracy={"beta": "8 %", "friction_coefficient_drop@1e3 s": 0.08})
    assert made.estimate("beta").relative <= 0.08
    assert made.estimate("friction_coefficient_drop", 1e3).relative <= 0.08
    assert made.stopped == "the accuracy was reached"


def test_a_tip_is_one_surface_and_says_so():
    made = ensemble(ca.parse_scene(TIP), accuracy={"beta": "3 %"})
    assert set(made.estimate("beta").errors) == {"replicas"}
    assert "disorder" in made.notes[0]
    # every contact is the same
    assert np.ptp(made.rows["0"][:, made.quantities.column("area_fraction")]) == 0


def test_a_number_of_surfaces_is_refused_where_there_is_one():
    with pytest.raises(InputError, match="this surface is the same at every seed; use replicas"):
        ensemble(ca.parse_scene(TIP), surfaces=4)


def test_measures_of_contacts_do_not_scatter_between_replicas(four):
    assert set(four.estimate("area_fraction").errors) == {"surfaces"}


def test_samples_are_kept_and_taken_up_again(rough, four, tmp_path, monkeypatch):
    first = ensemble(rough, surfaces=3, samples=tmp_path)
    calls = faults.counted_samples(monkeypatch)
    again = ensemble(rough, surfaces=4, samples=tmp_path)
    assert len(calls) == 1
    assert np.array_equal(again.rows["0"], four.rows["0"])
    assert np.array_equal(first.rows["0"], four.rows["0"][:3])


def test_a_damaged_sample_is_computed_again(rough, four, tmp_path):
    ensemble(rough, surfaces=3, samples=tmp_path)
    path, *_ = sorted(tmp_path.glob("points/*/*.json"))
    text = path.read_bytes()
    path.write_bytes(text.replace(b'"bonds": [[', b'"bonds": [[1', 1))
    assert np.array_equal(ensemble(rough, surfaces=4, samples=tmp_path).rows["0"], four.rows["0"])
    assert np.array_equal(ensemble(rough, surfaces=4, samples=tmp_path).rows["0"], four.rows["0"])


def test_an_interruption_says_what_is_known_so_far(rough, tmp_path, monkeypatch):
    faults.interrupt_after(monkeypatch, 25)
    with pytest.raises(KeyboardInterrupt, match=r"beta ± .* from .* samples, kept in"):
        ensemble(rough, accuracy={"beta": 0.005}, samples=tmp_path, threads=1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "surfaces: give how many, or an accuracy, or a budget"),
        ({"surfaces": 1}, "surfaces = 1: must be a whole number of at least 2"),
        ({"surfaces": 4, "accuracy": {"beta": 0.1}}, "give the number of surfaces, or the accuracy"),
        ({"accuracy": {"beta": 0}}, "accuracy.beta = 0: must lie between 1e-09 and 1"),
        ({"accuracy": {"beta": -0.1}}, "must lie between 1e-09 and 1"),
        ({"accuracy": {"beta": "200 %"}}, "must lie between 1e-09 and 1"),
        ({"accuracy": {"beta": "much"}}, 'is no number; give "2 %" or 0.02'),
        ({"accuracy": {"betta": 0.1}}, "no such quantity (did you mean 'beta'?)"),
        ({"accuracy": {"friction_drop@3 s": 0.1}}, "is not one of the hold times; the nearest is 1 s"),
        ({"accuracy": {"friction_drop@3 nm": 0.1}}, "accuracy.friction_drop@3 nm"),
        ({"accuracy": {"beta@3 s": 0.1}}, "does not depend on the hold time"),
        ({"accuracy": {"beta": 0.0001}, "most": 100}, "and 100 are allowed"),
        ({"accuracy": {"beta": 0.01}, "most": 8}, "most = 8: must be a whole number of at least 10"),
        ({"budget": "-3 s"}, "budget = '-3 s': must be above 0 s"),
        ({"budget": "3 nm"}, "budget"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_words(rough, arguments, message):
    with pytest.raises(InputError) as caught:
        ensemble(rough, **arguments)
    assert message in str(caught.value)


ALONE = {name: ROUGH[name] for name in ("name", "surface", "contact")}
ONE_TIME = {**ROUGH, "hold": {"start": 1.0, "stop": 1.0}}


@pytest.mark.parametrize(
    ("scene", "name", "message"),
    [
        (ALONE, "friction_drop", "for friction add [forming], [engine] and [hold]; this scene has area_fraction,"),
        (ALONE, "beta", "for friction add [forming], [engine] and [hold]"),
        (ONE_TIME, "beta", "it cannot be fitted: no hold time lies between 10 and 10000 s"),
        ({**ROUGH, "ageing": {"kind": "closure"}}, "friction_drop", "(standard errors: ageing 'closure' 14 %); ask for a"),
        ({**TIP, "ageing": {"kind": "closure"}}, "friction_drop@1e4 s", "errors that no number of replicas makes smaller"),
        ({**ROUGH, "engine": {"kind": "guessing"}}, "friction_drop", "replace engine 'guessing' by an exact one, or give"),
        ({**TIP, "engine": {"kind": "guessing"}}, "friction_drop", "replace engine 'guessing' by an exact one"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::chemage.PlanWarning")
def test_an_accuracy_without_an_answer_is_refused_before_anything_is_computed(scene, name, message, monkeypatch):
    class Guessing(type(ca.engine("independent"))):
        """An engine that does not say how wrong it is."""

        kind = "guessing"
        exact = False
        declared_error = None

    with registry.using(registry.Registry()):
        ca.register(Guessing)
        asked = with_request(ca.parse_scene(scene).completed(), accuracy={name: "20 %"})
        monkeypatch.setattr(running, "carry_out", lambda *arguments, **options: pytest.fail("it is computed"))
        for refused in (lambda: ensemble(asked), lambda: plan(asked)):
            with pytest.raises(InputError) as caught:
                refused()
            assert message in str(caught.value)


def test_a_load_of_zero_has_no_relative_accuracy():
    scene = ca.parse_scene({**ROUGH, "contact": {**ROUGH["contact"], "load": 0.0}})
    with pytest.raises(InputError, match="load is 0"):
        ensemble(scene, accuracy={"friction_drop": 0.1})


def test_a_theory_has_no_surfaces():
    contact = {"kind": "persson", "modulus": 35.3, "load": 400.0}
    scene = ca.parse_scene({**ROUGH, "contact": contact, "ageing": {"kind": "closure"}})
    with pytest.raises(InputError, match="theory of the mean"):
        ensemble(scene, surfaces=4)


#: so hot that every site has bonded before the first hold time, and so cold that none does before the last
SATURATED = {**ROUGH, "hold": {**ROUGH["hold"], "per_decade": 3, "temperature": 900.0}}
COLD = {**ROUGH, "hold": {**ROUGH["hold"], "temperature": 150.0}}


@pytest.mark.filterwarnings("ignore::chemage.PlanWarning")
def test_beta_of_a_saturated_scene_is_zero_and_no_relative_accuracy_of_it_is_promised():
    scene = ca.parse_scene(SATURATED)
    made = ensemble(scene, surfaces=4)
    assert np.ptp(made.friction_drop) == 0
    assert made.estimate("beta").value == 0.0
    assert ca.run(scene).fit().beta == 0.0
    with pytest.raises(InputError, match=r"accuracy\.beta = 5 %: its mean is 0 within its interval"):
        ensemble(scene, accuracy={"beta": "5 %"})
    # what is not zero is averaged
    assert ensemble(scene, accuracy={"friction_drop": "30 %"}).stopped == "the accuracy was reached"


@pytest.mark.filterwarnings("ignore::chemage.PlanWarning")
def test_a_budget_without_a_goal_answers_at_any_temperature():
    for data in (SATURATED, COLD):
        made = ensemble(ca.parse_scene(data), budget=0.4)
        assert made.estimate("beta").value == 0.0
        assert made.stopped == "the time was over"


@pytest.mark.filterwarnings("ignore::chemage.PlanWarning")
def test_it_is_said_why_sampling_ended_and_not_what_would_have_been_nice(rough):
    assert "as many as are allowed" in ensemble(rough, accuracy={"beta": 0.001}, budget=60.0, most=10).stopped
    assert "as many as are allowed" in ensemble(rough, budget=60.0, most=10).stopped
    tip = ensemble(ca.parse_scene({**TIP, "hold": SATURATED["hold"]}), accuracy={"friction_drop": 0.05})
    assert np.isnan(tip.estimate("friction_drop").half_width)
    assert tip.stopped == "friction_drop: all samples are equal, so that nothing is known of their scatter"
