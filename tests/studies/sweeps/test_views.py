"""Views of a sweep: which axes are chosen, and means over seeds with their errors."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from scipy import stats
from seen import HOLD_TIME, SweepData, swept_rows
from seen import figures as sweep_figures

import chemage
from chemage import InputError
from chemage.plugin import statistics, text

GRID = {
    "contact.load": ["5 nN", "10 nN"],
    "hold.temperature": [300, 310, 320],
    "hold.seed": [1, 2, 3, 4],
}


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    return tmp_path_factory.mktemp("sweep") / "out"


@pytest.fixture
def result(tiny, tmp_path, computed):
    """A sweep in a folder of the test, computed once for all of them."""
    if not computed.exists():
        chemage.sweep({**tiny.scene(), "sweep": GRID}, computed)
    shutil.copytree(computed, tmp_path / "out")
    return chemage.load_sweep(tmp_path / "out")


@pytest.fixture
def data(result):
    return SweepData(result)


def test_the_longest_numeric_axis_is_x_and_seeds_are_averaged(data):
    view = data.view(None, None)
    assert (view.x, view.lines, view.averaged, dict(view.fixed)) == ("temperature", "load", ("seed",), {})


def test_a_mean_over_seeds_has_the_interval_of_student(result, data):
    found = data.quantity("beta", data.view(None, None))
    assert found.mean.shape == (2, 3)
    values = result.to_xarray()["beta"].sel(load=10, temperature=310).values
    assert found.mean[1, 1] == pytest.approx(values.mean())
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert (found.low[1, 1], found.high[1, 1]) == (pytest.approx(low), pytest.approx(high))


def test_a_missing_seed_is_left_out_of_the_mean(result):
    gone = result.where({"contact.load": 5.0, "hold.temperature": 300})
    for point in gone[1:]:
        result.store.point(point.key).unlink()
    data = SweepData(chemage.load_sweep(result.folder))
    found = data.quantity("beta", data.view(None, None))
    assert found.mean[0, 0] == gone[0].summary["beta"]
    assert np.isnan(found.low[0, 0]), "one value has no error"
    assert np.isfinite(found.low[1]).all()


def test_one_seed_has_the_interval_over_replicas(data, result):
    view = data.view("temperature", "load", {"seed": "2"})
    assert view.averaged == ()
    found = data.quantity("friction_drop", view)
    summary = result.where({"contact.load": 10.0, "hold.temperature": 320, "hold.seed": 2})[0].summary
    half = summary["friction_drop_half_width"][-1]  # None where all replicas are equal
    assert found.at_last
    assert found.mean[1, 2] == summary["friction_drop"][-1]
    assert found.high[1, 2] - found.mean[1, 2] == pytest.approx(np.nan if half is None else half, nan_ok=True)
    times = data.quantity("cutoff_time", view)
    known = np.isfinite(times.low) & np.isfinite(times.mean)
    assert (times.low[known] <= times.mean[known]).all()


def test_along_hold_times_a_further_axis_has_the_value_in_the_middle(data, result):
    view = data.view(HOLD_TIME, "load")
    assert dict(view.fixed) == {"temperature": 1}
    found = data.quantity("friction_drop", view)
    assert found.mean.shape == (2, 4)
    points = result.where({"contact.load": 5.0, "hold.temperature": 310})
    assert found.mean[0] == pytest.approx(np.mean([point.summary["friction_drop"] for point in points], axis=0))


def test_axes_are_known_by_name_and_by_path(data):
    assert data.view("contact.load", "hold.temperature") == data.view("load", "temperature")
    assert dict(data.view("load", None, {"hold.temperature": "310"}).fixed) == {"temperature": 1}


@pytest.mark.parametrize(
    ("choice", "problem"),
    [
        (
            ("temp", None),
            r"--x = 'temp': is no axis of this sweep \(did you mean 'temperature'\?\); the axes are load, ",
        ),
        ((None, "height"), "--lines = 'height': is no axis .*; the axes are load, temperature, seed, hold_time"),
        (("load", "contact.load"), "--lines = 'contact.load': is the axis of --x"),
        (("load", HOLD_TIME), "--lines = 'hold_time': can only be --x"),
        ((None, None, {"load": "7"}), "--where load = '7': is not swept; the values are 5, 10 nN"),
    ],
)
def test_a_wrong_axis_is_named_with_those_there_are(data, choice, problem):
    with pytest.raises(InputError, match=problem):
        data.view(*choice)


def test_a_wrong_result_is_named_with_those_there_are(data):
    with pytest.raises(InputError, match=r"--y = 'betta': .*did you mean 'beta'\?\); the results are area_fraction, "):
        data.quantity("betta", data.view(None, None))
    with pytest.raises(
        InputError, match="--y = 'beta': is one number per point; with --x hold_time choose friction_dr"
    ):
        data.quantity("beta", data.view(HOLD_TIME, None))


def test_rows_of_a_table_are_means_over_seeds(data):
    headings, lines = data.rows()
    assert headings == ("load (nN)", "temperature (K)", "A/A0", "Δμ", "β")
    assert [line[:2] for line in lines] == [(load, kelvin) for load in ("5", "10") for kelvin in ("300", "310", "320")]
    assert all("±" in line[-1] for line in lines)
    assert data.notes()[0] == "means over 4 seeds with 95 % intervals (Student's t)"


def test_records_are_one_per_point(data, result):
    records = data.records()
    assert [one["point"] for one in records] == list(range(24))
    assert records[5]["swept"] == result[5].values
    assert records[5]["beta"] == result[5].summary["beta"]
    assert records[5]["last_friction_drop"] == result[5].summary["friction_drop"][-1]


def test_axes_are_listed_with_their_values(result):
    assert swept_rows(result.axes)[0] == ("contact.load", "2: 5 nN, 10 nN")


def test_a_sweep_of_seeds_alone_is_drawn_against_hold_time(tiny, tmp_path):
    result = chemage.sweep({**tiny.scene(), "sweep": {"hold.seed": [1, 2, 3]}}, tmp_path / "seeds")
    data = SweepData(result)
    assert data.view(None, None).x == HOLD_TIME
    assert len(data.rows()[1]) == 3


def test_words_come_after_numbers(tiny, tmp_path):
    grid = {"engine.trouble": ["", "none", "other"], "contact.load": [5, 10]}
    data = SweepData(chemage.sweep({**tiny.scene(), "sweep": grid}, tmp_path / "words"))
    view = data.view(None, None)
    assert (view.x, view.lines) == ("load", "trouble")


def test_results_of_one_surface_are_not_counted_as_many_surfaces(tiny, tmp_path):
    """With two axes of seeds the interval is that of the means over each of them."""
    grid = {"contact.load": ["5 nN", "10 nN"], "surface.seed": [1, 2, 3], "hold.seed": [1, 2, 3, 4]}
    result = chemage.sweep({**tiny.scene(), "sweep": grid}, tmp_path / "out")
    data = SweepData(result)
    view = data.view("load", None)
    assert len(view.averaged) == 2
    found = data.quantity("beta", view)
    values = result.to_xarray()["beta"].sel(load=10).transpose("surface_seed", "hold_seed").values
    assert found.mean[0, 1] == pytest.approx(values.mean())
    half = float(statistics.crossed_half_width(values, 2))
    assert found.high[0, 1] - found.mean[0, 1] == pytest.approx(half)
    assert half > stats.t.ppf(0.975, 11) * stats.sem(values.ravel())
    (_, line), headings = data.rows()[1], data.rows()[0]
    assert line[headings.index("β")] == text.plus_minus(values.mean(), half)


ROUGH = {
    "name": "pressed",
    "surface": {"kind": "self-affine", "pixels": 32, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 4},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": "20 MPa"},
}  # fmt: skip


def test_a_sweep_of_pressures_has_them_under_their_own_name_and_loads_as_forces_in_every_table(tmp_path, command):
    """A load is a force everywhere; values are shown in the unit in which they were written."""
    swept = {"contact.load": ["20 MPa", "60 MPa"], "surface.pixel_size": ["4.5 angstrom", "5 angstrom"]}
    result = chemage.sweep({**ROUGH, "sweep": swept}, tmp_path / "out")
    data = SweepData(result)
    headings, lines = data.rows()
    assert headings[:2] == ("nominal_pressure (MPa)", "pixel_size (Å)")
    assert [line[:2] for line in lines] == [("20", "4.5"), ("20", "5"), ("60", "4.5"), ("60", "5")]
    assert data.text("nominal_pressure", 1) == "nominal_pressure = 60 MPa"
    arrays = result.to_xarray()
    assert arrays["nominal_pressure"].values.tolist() == [0.02, 0.06]
    assert arrays["nominal_pressure"].attrs["units"] == "GPa"
    assert arrays["load"].attrs["units"] == "nN"
    area = np.array([(32 * 0.45) ** 2, (32 * 0.5) ** 2])
    assert arrays["load"].values == pytest.approx(np.outer([0.02, 0.06], area))
    # both names lead to the axis, and a value may be given as it was written, as it is shown, or in the unit inside
    view = data.view("load", None, {"pixel_size": "5 angstrom"})
    assert view.x == "nominal_pressure"
    assert (
        data.view("contact.load", None, {"pixel_size": "5"}) == view == data.view("load", None, {"pixel_size": "0.5"})
    )
    (figure,) = sweep_figures(result, x="load", y=["area_fraction"], where={"pixel_size": "5"}).values()
    (axes,) = figure.axes
    assert axes.get_xlabel() == "nominal pressure (MPa)"
    assert axes.lines[0].get_xdata().tolist() == [20.0, 60.0]
    shown = command("show", tmp_path / "out").out
    assert "nominal_pressure (MPa)" in shown
    assert "0.02" not in shown
    # numbers without a unit, and mixed units, are in the unit inside
    mixed = chemage.sweep({**ROUGH, "sweep": {"contact.load": ["20 nN", "0.03 uN", 40]}}, tmp_path / "mixed")
    assert SweepData(mixed).rows()[0][0] == "load (nN)"
    assert [line[0] for line in SweepData(mixed).rows()[1]] == ["20", "30", "40"]
