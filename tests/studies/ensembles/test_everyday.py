"""An ensemble as a result like any other: shown, drawn, compared, reported, as a table and in notebooks."""

from __future__ import annotations

import csv
import io
import json
import re

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt
from seen import comparison_figures, report, result_of

import chemage as ca
from chemage import Ensemble, compare_files

SCENE = {
    "name": "rough",
    "title": "Rough silica",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 100.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5, "temperature": 300.0},
}  # fmt: skip
TIMES = np.geomspace(1e-2, 1e4, 7)


def made(random: bool = True, ages: bool = True, seed: int = 0) -> Ensemble:
    """An ensemble of 20 samples that scatter by 10 %, corrected by nothing, with an error of the grid of 1 % of the
    friction."""
    rng = np.random.default_rng(seed)
    times = TIMES if ages else np.zeros(0)
    scale = 1 + 0.1 * rng.normal(size=(20, 1))
    drop = 10 * np.arange(1.0, times.size + 1) * scale
    measures = np.column_stack([0.02 * scale[:, 0], 12 * scale[:, 0]])
    x = np.log10(times[3:])
    beta = (drop[:, 3:] @ (x - x.mean()) / ((x - x.mean()) @ (x - x.mean())) / 100)[:, None] if ages else drop[:, :0]
    rows = np.concatenate([beta, drop, measures], axis=1)
    known = np.full(rows.shape[1], 0.01)
    scene = SCENE if ages else {name: SCENE[name] for name in ("name", "title", "surface", "contact")}
    level = {"words": "64 x 64 pixels, 1 replica", "replicas": 1, "samples": 20, "cpu_seconds": 0.1, "random": random}
    return Ensemble(
        hold_times=times,
        load=100.0,
        window=(10.0, 1e4),
        measures=("area_fraction", "patches"),
        levels=({**level, "seeds": [[1, 2], [3, 4]]},),
        rows={"0": rows},
        known={"discretisation": known} if random else {},
        known_how={"discretisation": "measured before on other surfaces"} if random else {},
        goals={"beta": 0.06} if ages else {"area_fraction": 0.06},
        stopped="the accuracy was reached",
        notes=("a note",),
        provenance={
            "scene": ca.parse_scene(scene).todict(),
            "versions": {"chemage": "0.2.0"},
            "cite": ["A. Author, doi:10.1/1"],
        },
    )


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """An ensemble over surfaces, one over replicas, one without ageing, and a run of one surface."""
    folder = tmp_path_factory.mktemp("everyday")
    ca.write(folder / "mean.h5", made())
    ca.write(folder / "other.h5", made(seed=1))
    ca.write(folder / "tip.h5", made(random=False))
    ca.write(folder / "bare.h5", made(ages=False))
    ca.write(folder / "one.h5", ca.run(SCENE))
    return folder


def test_a_notebook_shows_its_picture_and_the_parts_of_the_error():
    shown = made()._repr_html_()
    assert shown.count("data:image/png;base64,") == 1
    assert len(shown) < 200_000
    assert not re.search(r"(src|href)=\"(?!data:)", shown)
    for words in (
        "20 random surfaces",
        "scatter between surfaces",
        "grid of the contact",
        "95 %",
        "a note",
        "± 6 %",
    ):
        assert words in shown


def test_it_is_drawn_into_given_axes_with_its_interval_and_single_surfaces():
    one = made()
    axes = one.plot()
    assert len(axes.lines) == 22  # 20 surfaces, the mean, the line of β
    assert len(axes.collections) == 1
    low, high = one.friction_drop - one.friction_drop_half_width, one.friction_drop + one.friction_drop_half_width
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert band.min() == pytest.approx(low.min() / 100)
    assert band.max() == pytest.approx(high.max() / 100)
    assert one.plot(axes, singles=False, color="red", label="other") is axes
    assert len(axes.lines) == 24
    assert "other" in [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_line_of_beta_says_over_which_hold_times_it_is_fitted_and_that_they_are_few():
    text = "(line, 10–10⁴ s)\nβ rests on 4 hold times over 3 decades"
    (label,) = [one.get_label() for one in made().plot().lines if str(one.get_label()).startswith("β")]
    assert label.endswith(text)
    shown = dict(result_of(made()).rows())["ageing rate per decade β"]
    assert "over 4 hold times from 10 to 10000 s (β rests on 4 hold times" in shown


def test_without_ageing_the_parts_of_the_error_are_drawn():
    axes = made(ages=False).plot()
    texts = " ".join(text.get_text() for text in axes.texts)
    assert "scatter between surfaces" in texts
    assert "grid of the contact: 1 %" in texts


def test_pandas_has_a_row_for_each_hold_time_with_the_errors_by_name():
    one = made()
    table = one.to_pandas()
    assert table.index.tolist() == TIMES.tolist()
    assert table["friction_drop"].tolist() == one.friction_drop.tolist()
    assert table["friction_drop_half_width"].tolist() == one.friction_drop_half_width.tolist()
    last = one.estimate("friction_coefficient_drop")
    for name, part in last.errors.items():
        assert table[f"friction_coefficient_drop.{name}"].iloc[-1] == part.size
    bare = made(ages=False).to_pandas()
    assert bare.index.tolist() == ["area_fraction", "patches"]
    assert bare["error.discretisation"]["patches"] == pytest.approx(0.12, rel=0.1)


def test_xarray_has_the_samples_and_the_means():
    pytest.importorskip("xarray")
    one = made()
    data = one.to_xarray()
    assert data["rows.0"].shape == (20, one.quantities.count)
    assert data["friction_drop"].values.tolist() == one.friction_drop.tolist()
    assert data["friction_drop.discretisation"].attrs["units"] == "nN"
    assert data["friction_coefficient_drop_half_width"].dims == ("hold_time",)


def test_its_scatter_is_the_standard_deviation_over_the_mean():
    one = made()
    assert one.scatter == pytest.approx(one.rows["0"][:, 0].std(ddof=1) / one.mean[0])
    assert np.isnan(made(ages=False).scatter)


def test_compare_says_which_error_is_of_surfaces_and_which_of_one(files):
    compared = compare_files([files / name for name in ("mean.h5", "one.h5", "tip.h5", "bare.h5")])
    rows = dict(compared.table())
    starts = ("20 random surfaces: ", "3 replicas on one surface", "20 replicas on the one surface", "20 random ")
    assert all(text.startswith(start) for text, start in zip(rows["mean over"], starts, strict=True))
    mean, one, tip, bare = rows["every ± is"]
    assert "with the scatter between surfaces" in mean
    assert "do not include the scatter between surfaces" in one
    assert tip == one
    assert bare == mean
    of_beta = "error of ageing rate per decade β: "
    assert rows[f"{of_beta}scatter between surfaces, each with its own replica"][0].endswith(" %")
    assert rows[f"{of_beta}grid of the contact"][0] == "1 %"
    assert rows[f"{of_beta}replicas"][1].endswith(" %")
    assert "measured here on 20" in rows["scatter of β between surfaces, relative"][0]
    assert "±" in rows["area fraction A/A0"][0]
    assert "±" in rows["friction drop ΔF at 1000 s"][0]
    assert rows["friction drop ΔF at 1000 s"][3] == "-"
    assert compared.statement() == "Chemistry: the same in all results."


def test_compare_gives_the_numbers_of_the_ensemble(files):
    compared = compare_files([files / "mean.h5", files / "one.h5"], times=[1e3, 3e3])
    mean, one = compared.numbers()
    beta = made().estimate("beta")
    assert mean["beta"] == pytest.approx(beta.value)
    assert mean["beta_half_width"] == pytest.approx(beta.half_width)
    assert mean["mean over"] != one["mean over"]
    at = {entry["time"]: entry for entry in mean["at"]}
    known = made().estimate("friction_drop", 1e3)
    assert at[1e3]["friction_drop"] == pytest.approx(known.value)
    assert at[1e3]["friction_drop_half_width"] == pytest.approx(known.half_width)
    # between hold times it is taken evenly in log t
    later = made().estimate("friction_drop", 1e4).value
    part = np.log10(3.0)
    assert at[3e3]["friction_drop"] == pytest.approx((1 - part) * known.value + part * later)
    json.dumps(compared.todict())
    lines = list(csv.DictReader(io.StringIO(compared.csv())))
    assert len(lines) == 2
    assert float(lines[0]["beta"]) == pytest.approx(beta.value)


def test_two_ensembles_are_compared_and_no_runs_are_as_before(files):
    rows = dict(compare_files([files / "mean.h5", files / "other.h5"]).table())
    assert all("with the scatter" in text for text in rows["every ± is"])
    assert "do not include" in dict(compare_files([files / "one.h5"]).table())["every ± is"][0]


def test_in_a_figure_bands_are_of_surfaces_and_bars_of_one(files):
    compared = compare_files([files / name for name in ("mean.h5", "one.h5", "tip.h5")])
    figures = comparison_figures(compared)
    (axes,) = figures["friction-coefficient-drop"].axes
    bands = [one for one in axes.collections if isinstance(one, matplotlib.collections.PolyCollection)]
    assert len(bands) == 1
    bars = [one for one in axes.containers if isinstance(one, matplotlib.container.ErrorbarContainer)]
    assert len(bars) == 2
    labels = axes.get_legend_handles_labels()[1]
    assert "mean, mean of 20 surfaces, 95 % band" in labels
    for start in ("one, mean of 3 replicas on one surface, 95 %", "tip, mean of 20 replicas on one surface, 95 %"):
        assert sum(label.startswith(start) for label in labels) == 1


@pytest.mark.long
def test_a_page_of_an_ensemble_has_its_curve_its_errors_and_its_seeds(files):
    page = report([files / "mean.h5"])
    for words in (
        "20 random surfaces", "Parts of the error", "scatter between surfaces, each with its own replica",
        "measured before on other surfaces", "1 2, 3 4", "A. Author", "± 6 %",
        "Errors are 95 % intervals with the scatter between surfaces, by Student&#39;s t.",
    ):  # fmt: skip
        assert words in page, words
    assert page.count("<svg") == 2
    assert report([files / "mean.h5"]) == page


@pytest.mark.long
def test_a_page_of_several_says_whose_errors_are_which(files):
    page = report([files / name for name in ("mean.h5", "one.h5", "tip.h5", "bare.h5")])
    assert "Errors of mean, bare are 95 % intervals with the scatter between surfaces, by Student&#39;s t" in page
    assert "Errors of one, tip are 95 % intervals over replicas on one surface" in page
    assert "Bands are intervals of means over surfaces, bars of means over replicas on one surface." in page


def test_measurements_are_not_fitted_to_a_mean_again(files, tmp_path):
    measured = tmp_path / "measured.csv"
    lines = [f"{time},{0.1 * k + 0.2}" for k, time in enumerate((10.0, 100.0, 1e3, 1e4))]
    measured.write_text("hold_time (s),friction_coefficient_drop\n" + "\n".join(lines) + "\n")
    compared = compare_files([files / "mean.h5"], measured=[measured])
    reasons = [reason for name, _, reason in compared.not_fitted() if name == "mean"]
    assert reasons
    assert "β of its own window" in reasons[0]


def test_commands_take_its_file(command, files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = command("show", files / "mean.h5", "--all")
    assert "error of β: grid of the contact" in shown.out
    assert command("plot", files / "mean.h5", "--out", "drawn").status == 0
    assert (tmp_path / "drawn" / "ensemble.png").is_file()
    done = command("compare", files / "mean.h5", files / "one.h5", "--all")
    assert done.status == 0, done.err
    assert "every ± is" in done.out
    done = command("report", files / "mean.h5", "-o", "page.html")
    assert done.status == 0, done.err
    assert "A. Author" in command("cite", files / "mean.h5").out


def test_json_has_what_json_of_a_run_has_where_that_has_it(command, files):
    """A script that reads β of a run reads that of a mean over surfaces."""
    mean, one = (json.loads(command("show", files / name, "--json").out) for name in ("mean.h5", "one.h5"))
    missing = (
        set(one)
        - set(mean)
        - set(ca.run(ca.parse_scene({name: SCENE[name] for name in ("name", "surface", "contact")})).contact.summary())
    )
    assert missing == {
        *("solver", "engine", "ageing", "rupture", "converged", "residual", "iterations", "sites"),
        *("site_grid", "events", "common_random_numbers", "cutoff_time", "cutoff_reason", "timings", "keys"),
        *("mean_shear_stress", "bonds", "bonds_per_area", "bonded_fraction", "pressures", "pressures_edges"),
        *("rms_pressure", "displacement"),
    }  # which are of one surface
    beta, drop = made().estimate("beta"), made().estimate("friction_drop")
    wanted = {"value": beta.value, "unit": "1", "low": beta.low, "high": beta.high, "reason": beta.reason}
    assert mean["beta"] == {name: value for name, value in wanted.items() if value != ""}
    assert mean["b"]["high"] - mean["b"]["value"] == pytest.approx(beta.half_width / np.log(10))
    assert mean["hold_time"]["value"] == TIMES.tolist()
    assert (mean["friction_drop"]["value"][-1], mean["friction_drop"]["high"][-1]) == (drop.value, drop.high)
    half = mean["friction_coefficient_drop"]["high"][-1] - mean["friction_coefficient_drop"]["value"][-1]
    assert half == pytest.approx(drop.half_width / 100)
    assert mean["area_fraction"]["value"] == made().estimate("area_fraction").value
    assert mean["load"]["value"] == one["load"]["value"] == 100.0
    assert mean["beta_scatter_between_surfaces"]["value"] == made().scatter
    bare = json.loads(command("show", files / "bare.h5", "--json").out)
    assert (bare["beta"], bare["friction_drop"]) == (None, [])
    assert set(bare) - set(mean) == {"hold_times"}


def test_a_mean_of_curves_that_saturate_says_that_it_is_no_line():
    few = {"surface.pixels": 64, "surface.zeta": 8, "contact.load": "0.3 uN", "hold.temperature": 350.0}
    mean = ca.ensemble(ca.load_scene("silica-patch", few), surfaces=8)
    numbers = mean.summary()
    assert numbers["slope_from"] > 3 * numbers["slope_to"]
    assert any(f"no line: rms residual {numbers['rms_residual']:.3g}, local slope" in note for note in numbers["notes"])
