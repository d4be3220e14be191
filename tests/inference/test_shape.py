"""The shape of a density in words: peaks, shares, verdicts; and the figures of an inference."""

from __future__ import annotations

import numpy as np
import pytest
from made_inference import made_forecast, made_inference

from chemage.foundation.result import result_of
from chemage.inference import display
from chemage.inference.result import InferenceResult
from chemage.inference.shape import peaks, shares, three_shares
from chemage.results.drawing import figures as inference_figures


def test_one_two_and_no_peak_are_told_apart():
    (peak,) = peaks(made_inference((1.0,)))
    assert peak.energy == pytest.approx(1.0, abs=0.02)
    assert peak.band[0] <= peak.energy <= peak.band[1]
    assert [round(one.energy, 1) for one in peaks(made_inference((0.85, 1.1)))] == [0.8, 1.1]
    assert peaks(made_inference(())) == []
    assert "flat" in display.density_text(made_inference(()))
    assert display.density_text(made_inference((1.3,))).startswith("no peak inside; rises")


def test_no_barriers_inside_are_neither_flat_nor_falling():
    """Linear ageing: all samples are zero at all visible energies, and the barriers lie above."""
    empty = made_inference((1.4,))
    text = "hardly any inside (at most 0.1 % of the sites); barriers lie above"
    zero = np.where(empty.visible, 0.0, empty.samples)
    for one in (empty, empty.model_copy(update={"samples": zero})):
        assert display.density_text(one) == text
        assert "less than 0.1 % of the sites" in dict(display.shape_rows(one)).values()
        assert text in inference_figures(InferenceResult(one))["density"].axes[0].get_title().replace("\n", " ")


def test_a_maximum_of_the_curve_that_is_no_peak_is_named_and_marked():
    """The curve of the figure is highest at 0.85 eV, inside the visible energies, in half of the samples."""
    one = made_inference(())
    bump = 2 * np.exp(-0.5 * ((one.energies - 0.85) / 0.03) ** 2)
    samples = 0.6 * one.samples
    samples[::2] += 0.6 * bump
    one = one.model_copy(update={"samples": samples})
    high = one.energies[np.argmax(one.density)]
    assert peaks(one) == []
    assert f"the maximum at {high:.3f} eV is not resolved" in display.density_text(one)
    assert "no peak inside" not in display.density_text(one)
    axes = inference_figures(InferenceResult(one))["density"].axes[0]
    (marks,) = [line for line in axes.get_lines() if line.get_label() == "maximum, not resolved"]
    assert high in marks.get_xdata()


def skew_forecast(**more):
    """Most samples between 1157 and 1177 nN, one in six far below, as a forecast of the documentation."""
    samples = np.linspace(1157, 1177, 300)[:, None]
    samples[:45] = np.linspace(700, 1100, 45)[:, None]
    return made_forecast().model_copy(update={"hold_times": np.array([1e6]), "samples": samples, **more})


def test_a_forecast_is_shown_by_its_median_which_lies_in_its_bands():
    one = skew_forecast()
    low, high = one.band(0.68)
    assert one.friction_drop[0] < low[0] < one.median[0] < high[0]
    median = f"{one.median[0]:.4g} nN"
    assert display.forecast_row("a", one)[1] == median
    assert median in repr(one)
    made = InferenceResult(made_inference(), {"a": one})
    (summary,) = made.summary()["forecasts"]
    assert summary["median"] == one.median.tolist()
    assert summary["friction_drop"] == one.friction_drop.tolist()
    (line,) = [line for line in inference_figures(made)["forecasts"].axes[0].get_lines() if line.get_label() == "a"]
    assert line.get_ydata() == pytest.approx(one.median)


def test_where_nearly_all_is_unseen_only_bounds_are_shown():
    one = skew_forecast(unseen=0.97)
    name, value, inner, outer = display.forecast_row("a", one)
    assert "97 % unseen: bounds only" in name
    assert (value, inner) == ("-", "-")
    assert f"{one.median[0]:.4g}" not in outer + repr(one)
    axes = inference_figures(InferenceResult(made_inference(), {"a": one}))["forecasts"].axes[0]
    drawn = np.concatenate([line.get_ydata() for line in axes.get_lines()])
    assert one.median[0] not in drawn
    assert {float(end[0]) for end in one.band(0.95)} <= {*drawn.tolist()}


def test_a_rise_towards_an_end_is_named():
    assert display.density_text(made_inference((0.9, 1.25))).endswith("; rises again towards the upper end")


def test_a_peak_that_only_some_samples_have_is_none():
    one = made_inference(())
    bump = np.exp(-0.5 * ((one.energies - 1.0) / 0.05) ** 2)
    samples = one.samples.copy()
    samples[::2] += bump
    samples *= 0.5
    assert peaks(one.model_copy(update={"samples": samples})) == []


def test_shares_are_integrals_of_the_density():
    one = made_inference()
    found = shares(one)
    low, high = one.visible_range
    assert (found[0].low, found[-1].high) == pytest.approx((low, high))
    inside = (one.energies >= low) & (one.energies <= high)
    whole = np.trapezoid(one.density[inside], one.energies[inside])
    assert sum(part.mean for part in found) == pytest.approx(whole, rel=1e-9)
    assert three_shares(one)[2].mean == pytest.approx(
        1 - np.trapezoid(one.density[one.energies <= high], one.energies[one.energies <= high]), abs=1e-9
    )


def test_data_that_tell_nothing_are_shown_as_such():
    one = made_inference(visible=np.zeros(61, dtype=bool))
    made = InferenceResult(one)
    assert peaks(one) == []
    assert shares(one) == []
    rows = dict(display.rows(made.inference))
    assert rows["visible energies"].startswith("none")
    assert "density" in inference_figures(made)


def test_scores_name_the_best_and_those_as_good():
    one = made_inference()
    assert display.family_rows(one)[0][:2] == ("gaussian", "best")
    assert display.family_verdict(one) == (
        "the data do not tell apart the smooth density and gaussian: scores within 2"
    )
    alone = made_inference(scores={"density": 10.0, "uniform": 1.0})
    assert display.family_verdict(alone).endswith("best by the smooth density")
    assert display.family_rows(made_inference(scores={})) == []


def test_every_figure_has_a_caption_and_what_it_should_show():
    scalars = {"bond_force": np.random.default_rng(0).uniform(2, 4, 60)}
    one = made_inference(scalars=scalars, scalar_bounds={"bond_force": (1.0, 9.0)})
    made = InferenceResult(one, {"load=50 nN": made_forecast(), "at 1 s": made_forecast(80.0, unseen=0.4)})
    figures = inference_figures(made)
    assert figures.keys() == {"density", "data", "predictive", "forecasts", "unknowns"}
    assert all(panel.caption for picture in result_of(made).pictures().values() for panel in picture.panels)
    (density,) = figures["density"].axes
    labels = density.get_legend_handles_labels()[1]
    assert {"visible energies", "95 % band", "68 % band", "mean", "gaussian", "uniform"} <= {*labels}
    data, residuals = figures["data"].axes
    assert data.get_legend().get_title().get_text() == "points: measured, bars 95 %; bands: 68 and 95 %"
    bars = np.array(data.containers[0].lines[2][0].get_segments())
    assert 0.5 * np.ptp(bars[:, :, 1], axis=1) == pytest.approx(1.959964 * one.errors[one.curve == 0])
    assert residuals.get_lines()[-1].get_ydata() == pytest.approx(one.residuals)
    assert data.get_xscale() == "log"
    assert "40 % unseen" in " ".join(figures["forecasts"].axes[0].get_legend_handles_labels()[1])
