"""Results side by side: the same numbers as each alone, what differs, scaling by area, figures with measurements."""

from __future__ import annotations

import csv
import io
import json
import math
import re

import faults
import numpy as np
import pytest
from seen import Comparison, Entry, comparison_figures, report

import chemage as ca
from chemage import InputError, Measurements, Run, compare_files, parse_scene
from chemage.plugin import StoreError, figures, override

TIP = {
    "name": "tip",
    "title": "A $tip$ <of> silica",
    "surface": {"kind": "sphere", "radius": "20 nm", "pixels": 32, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "30 nN"},
    "forming": {"kind": "md-silica"},
    "breaking": {"kind": "gaussian", "mean": "1.1 eV", "std": "0.02 eV"},
    "interaction": {"kind": "elastic-pairs", "strength": "0.1 eV", "bias": 0.1},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "per_decade": 2, "replicas": 20, "seed": 0},
    "observe": [{"kind": "barrier-spectrum"}],
}
ROUGH = {
    **TIP,
    "name": "rough",
    "surface": {
        "kind": "self-affine",
        "pixels": 64,
        "pixel_size": "0.4518 nm",
        "rms_slope": 0.1,
        "hurst": 0.8,
        "zeta": 8,
        "eta": 3,
    },
    "contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "60 nN"},
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Result files by name; each made once."""
    folder = tmp_path_factory.mktemp("results")
    made: dict[str, Run] = {}

    def make(name, base, **changes):
        made[name] = ca.run(parse_scene(override(base, changes)), threads=1)
        ca.write(folder / f"{name}.h5", made[name])

    make("tip", TIP)
    make("rough", ROUGH)
    make("strong", ROUGH, **{"interaction.strength": "0.5 eV"})
    make("hot", ROUGH, **{"hold.temperature": "350 K"})
    make("free", TIP, interaction=None, breaking=None)
    untouched = dict.fromkeys(("forming", "breaking", "interaction", "chemistry", "engine", "hold", "observe"))
    make("dry", ROUGH, **untouched)
    make("unloaded", TIP, **{"contact.load": 0})
    ageing = made["rough"].ageing
    assert ageing is not None
    ca.write(folder / "ageing.h5", ageing)
    ca.write(folder / "contact.h5", made["rough"].contact)
    surface = made["rough"].surface
    assert surface is not None
    ca.write(folder / "surface.h5", surface)
    return folder, made


def of(results, *names, **options):
    folder, _ = results
    return compare_files([folder / f"{name}.h5" for name in names], **options)


# -- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_each_column_tells_what_its_run_tells_alone(results):
    _, made = results
    comparison = of(results, "tip", "rough")
    for told, name in zip(comparison.numbers(), ("tip", "rough"), strict=True):
        alone = made[name].summary()
        for key in (
            "load",
            "area",
            "area_fraction",
            "patches",
            "mean_contact_pressure",
            "sites",
            "beta",
            "beta_stderr",
        ):
            assert told[key] == alone[key], key
        assert told["beta_stderr"] == alone["beta_stderr"]
        assert told["cutoff_time"] == alone["cutoff_time"]
        assert 0 < told["beta_half_width"] < told["beta"]
        last = told["at"][-1]
        assert last["time"] == alone["hold_times"][-1]
        assert last["friction_drop"] == pytest.approx(alone["friction_drop"][-1], rel=1e-12)
        assert last["friction_drop_stderr"] == pytest.approx(alone["friction_drop_stderr"][-1], rel=1e-12)
        # three nanonewtons a bond, on the sites that the grid counts
        area = made[name].contact.area
        assert last["bonds_per_area"] == pytest.approx(alone["friction_drop"][-1] / 3 / area, rel=1e-12)
        assert last["bonded_fraction"] == pytest.approx(alone["friction_drop"][-1] / 3 / alone["sites"], rel=1e-12)
        assert last["friction_coefficient_drop"] == pytest.approx(last["friction_drop"] / told["load"], rel=1e-12)


def test_a_time_between_hold_times_is_taken_evenly_in_log_time(results):
    (one,) = of(results, "tip").results
    ageing = one.ageing
    assert ageing is not None
    place = int(np.argmin(np.abs(ageing.hold_times - 10.0)))
    between = math.sqrt(ageing.hold_times[place] * ageing.hold_times[place + 1])
    times = [between, ageing.hold_times[place], 1e-4, 1e6]
    halfway, there, *outside = (one["friction_drop"] for one in of(results, "tip", times=times).numbers()[0]["at"][:4])
    mean = ageing.mean_friction_drop
    assert halfway == pytest.approx(0.5 * (mean[place] + mean[place + 1]), rel=1e-9)
    assert there == pytest.approx(mean[place], rel=1e-12)
    assert outside == [None, None]


def test_times_are_chosen_with_units_and_wrong_ones_are_named(results):
    told = of(results, "tip", times=["1 min", 30]).numbers()[0]
    assert [entry["time"] for entry in told["at"]] == [60.0, 30.0, 1e5]
    for wrong in ("0 s", "-1 s", math.inf):
        with pytest.raises(InputError, match="times"):
            of(results, "tip", times=[wrong])


def test_the_table_has_a_row_for_everything_asked_and_a_cell_for_every_file(results):
    table = dict(of(results, "tip", "rough", "dry", "unloaded").table())
    assert all(len(cells) == 4 for cells in table.values())
    for label in (
        "load", "contact area A", "sites", "mean contact pressure", "friction drop ΔF at 1 s",
        "friction drop ΔF at 1000 s", "friction drop ΔF at the last hold time",
        "friction coefficient drop Δμ at 1000 s",
        "bonds per contact area at 1 s", "ageing rate per decade β", "cut-off time t_c",
    ):  # fmt: skip
        assert label in table, label
    assert table["ageing rate per decade β"][2] == "-"
    assert table["ageing rate per decade β"][3].startswith("not fitted: load = 0")
    assert table["mean contact pressure"][3] == "-"
    assert [text.partition(",")[0] for text in table["surface"][:2]] == ["sphere", "self-affine"]
    assert [text.partition(",")[0] for text in table["contact"][:2]] == ["hertz", "fft-bem"]


def test_csv_has_one_line_a_file_units_in_the_header_and_the_numbers_of_json(results):
    comparison = of(results, "tip", "rough", "dry")
    rows = list(csv.DictReader(io.StringIO(comparison.csv())))
    assert [row["name"] for row in rows] == ["tip", "rough", "dry"]
    for row, told in zip(rows, comparison.numbers(), strict=True):
        assert float(row["area (nm²)"]) == told["area"]
        for entry, label in zip(told["at"], ("1 s", "1000 s", "last"), strict=True):
            value = row[f"friction_drop at {label} (nN)"]
            assert (float(value) if value else None) == entry["friction_drop"]
    assert rows[2]["beta"] == ""


def test_json_is_plain_and_has_no_nan(results):
    told = json.dumps(of(results, "tip", "dry", "unloaded").todict(), allow_nan=False)
    assert json.loads(told)["results"][1]["beta"] is None


# -- chemistry --------------------------------------------------------------------------------------------------------


def test_one_chemistry_on_different_contacts_is_the_same(results):
    comparison = of(results, "tip", "rough", "ageing")
    assert comparison.chemistry_differences() == {}
    assert comparison.statement() == "Chemistry: the same in all results."
    assert comparison.todict()["same_chemistry"] is True
    # elsewhere they differ, and it is said where; options that only one kind has are no news
    paths = comparison.other_differences()
    assert {"surface.kind", "contact.kind", "contact.load"} <= paths.keys()
    assert "surface.radius" not in paths


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("rough", "strong"), {"interaction.strength": (0.1, 0.5)}),
        (("rough", "hot"), {"temperature": (300.0, 350.0)}),
        (("ageing", "strong"), {"interaction.strength": (0.1, 0.5)}),
        (("strong", "rough", "hot"), {"interaction.strength": (0.5, 0.1, 0.1), "temperature": (300.0, 300.0, 350.0)}),
    ],
)
def test_a_different_chemistry_is_told_field_by_field(results, names, expected):
    comparison = of(results, *names)
    assert comparison.chemistry_differences() == expected
    for path in expected:
        assert path in comparison.statement()
    assert comparison.todict()["same_chemistry"] is False


def test_what_is_not_modelled_is_a_difference_too(results):
    found = of(results, "tip", "free").chemistry_differences()
    assert found["interaction.kind"] == ("elastic-pairs", None)
    assert found["breaking.mean"] == (1.1, None)


def test_contacts_that_were_not_aged_have_no_chemistry_to_compare(results):
    comparison = of(results, "rough", "dry")
    assert "fewer than two" in comparison.statement()
    assert comparison.todict()["same_chemistry"] is None


# -- files ------------------------------------------------------------------------------------------------------------


def test_ageing_and_contacts_alone_are_compared_as_far_as_they_go(results):
    run, ageing, contact = of(results, "rough", "ageing", "contact").numbers()
    assert ageing["area"] == run["area"] == contact["area"]
    assert ageing["beta"] == run["beta"]
    assert ageing["at"] == run["at"]
    assert contact["beta"] is None


def test_files_of_one_name_are_told_apart_and_one_file_twice_is_refused(results, tmp_path):
    folder, _ = results
    other = tmp_path / "tip.h5"
    other.write_bytes((folder / "rough.h5").read_bytes())
    assert [one.name for one in compare_files([folder / "tip.h5", other]).results] == [
        str(folder / "tip.h5"),
        str(other),
    ]
    with pytest.raises(InputError, match="given twice"):
        compare_files([folder / "tip.h5", folder / "." / "tip.h5"])


def test_what_cannot_be_compared_is_named(results, tmp_path):
    folder, _ = results
    assert dict(of(results, "tip", "surface").table())["rms height"][0] == "-", "any result stands beside any other"
    with pytest.raises(StoreError, match="does not exist"):
        compare_files([tmp_path / "none.h5"])
    with pytest.raises(InputError, match="nothing to compare"):
        compare_files([])
    broken = tmp_path / "broken.h5"
    broken.write_bytes((folder / "tip.h5").read_bytes()[:3000])
    with pytest.raises(StoreError):
        compare_files([broken])


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """The folder of a sweep over three loads, one of them left out."""
    from chemage import sweep

    folder = tmp_path_factory.mktemp("sweeps") / "loads"
    scene = {**TIP, "hold": {**TIP["hold"], "replicas": 3}, "sweep": {"contact.load": [20, 30, 40]}}
    sweep(scene, folder, executor="serial")
    return folder


def test_a_folder_of_a_sweep_stands_for_its_points_and_a_number_for_one(swept, results):
    whole = compare_files([swept])
    assert [one.name for one in whole.results] == ["loads/0", "loads/1", "loads/2"]
    assert [one.ageing.load for one in whole.results] == [20, 30, 40]
    assert whole.statement() == "Chemistry: the same in all results."
    folder, _ = results
    mixed = compare_files([swept / "2", folder / "tip.h5"])
    assert [one.name for one in mixed.results] == ["loads/2", "tip"]
    assert mixed.numbers()[0] == {**whole.numbers()[2]}
    # what the sweep computed is what a run of its own computes
    scene = parse_scene(override(TIP, {"contact.load": 40, "hold.replicas": 3}))
    run = ca.run(scene, threads=1)
    assert mixed.numbers()[0]["beta"] == run.summary()["beta"]
    again = mixed.results[0].whole
    assert again is not None
    assert again().maps()["contact"] == run.contact
    assert "key of stage contact" in dict(again().provenance())


def test_wrong_points_of_a_sweep_are_named(swept):
    with pytest.raises(InputError, match=r"has 3 points, from .*/0 on"):
        compare_files([swept / "3"])
    with pytest.raises(InputError, match="given twice"):
        compare_files([swept, swept / "1"])
    with pytest.raises(StoreError, match="does not exist"):
        compare_files([swept / "one"])


def test_more_results_than_a_table_holds_are_refused_with_the_remedy(swept, monkeypatch):
    faults.most_compared(monkeypatch, 2)
    with pytest.raises(InputError, match=r"3 results are too many .* FOLDER/0"):
        compare_files([swept])


def test_maps_are_let_go_so_that_many_files_fit(results):
    for one in of(results, "tip", "rough").results:
        pressures = one.curves["pressures"]
        assert pressures.mean.size <= 50
        assert float(np.sum(pressures.mean * np.diff(pressures.x))) == pytest.approx(1.0)


# -- measurements and figures -----------------------------------------------------------------------------------------


def data(quantity="friction_coefficient_drop", name="afm", scale=1.0):
    t = np.geomspace(0.1, 1e4, 11)
    return Measurements(name, t, scale * np.log10(1 + t / 0.5), quantity, np.full(t.size, 0.05 * scale))


def test_measurements_and_results_are_fitted_alike(results):
    comparison = Comparison(of(results, "tip", "rough").results, [data()])
    fits = comparison.fits()
    assert [name for name, _ in fits] == ["afm", "tip", "rough"] * 2
    assert [fit.model for _, fit in fits] == ["line"] * 3 + ["curve"] * 3
    assert {fit.window for _, fit in fits[:3]} == {(10.0, 1e4)}
    curve = fits[3][1]
    assert curve.beta == pytest.approx(1.0, rel=1e-6)
    assert curve.cutoff_time == pytest.approx(0.5, rel=1e-5)
    # the results over the hold times of the measurements
    assert fits[4][1].window == (pytest.approx(0.1), pytest.approx(1e4))


def test_measurements_short_of_the_window_are_fitted_over_what_there_is(results):
    short = Measurements("short", np.array([0.1, 1.0, 5.0]), np.array([0.1, 0.2, 0.3]), "friction_coefficient_drop")
    fits = Comparison(of(results, "tip").results, [short]).fits()
    assert fits[0][1].window is None
    assert fits[0][1].points == 3


def lines_of(figure):
    (axes,) = figure.axes[:1]
    (legend,) = [axes.get_legend()] if axes.get_legend() else figure.legends  # below the plot where it is long
    return [text.get_text() for text in legend.get_texts()], axes


def test_figures_show_every_result_by_name_and_the_measurements_on_top(results):
    comparison = Comparison(of(results, "tip", "rough", "dry").results, [data(), data("friction_drop", "pull", 40.0)])
    figures = comparison_figures(comparison)
    assert list(figures) == ["friction-coefficient-drop", "friction-drop", "bonds-per-area", "pressures", "barriers"]
    labels, axes = lines_of(figures["friction-coefficient-drop"])
    assert {"tip", "rough", "afm (measured"} <= {label.partition(",")[0] for label in labels}, "each curve is named"
    fitted = {label.partition(",")[0].partition(" (")[0]: label for label in labels if "β = " in label}
    assert set(fitted) == {"tip", "rough", "afm"}, "each fit is with its data"
    # like with like: the line, as to the results, though these data are a curve
    assert axes.get_legend().get_title().get_text() == "β per decade: fitted lines, 10–10⁴ s"
    line = dict(comparison.fits()[:1])["afm"]
    assert (line.model, fitted["afm"]) == ("line", f"afm (measured, 95 %), {line.symbol_text()}")
    assert len(labels) == len(set(labels)), "one entry for each curve and its markers"
    # loads differ, so ΔF and Δμ cannot be turned into each other
    assert not any(label.startswith("pull (measured, 95 %)") for label in labels)
    assert any(label.startswith("pull (measured, 95 %)") for label in lines_of(figures["friction-drop"])[0])
    assert axes.get_xscale() == "log"
    assert {"tip", "rough", "dry"} <= set(lines_of(figures["pressures"])[0])
    drawn = figures["bonds-per-area"].axes[0].containers[0].lines[0]
    one = comparison.results[0]
    np.testing.assert_allclose(drawn.get_ydata(), one.curves["bonds_per_area"].mean)


def test_bars_of_measurements_are_95_percent_as_those_of_results_are_and_say_so(results):
    """An error in a file of measurements is a standard error."""
    error = np.array([0.01, 0.02, 0.03])
    one = Measurements("afm", np.array([0.1, 1.0, 10.0]), np.array([0.1, 0.2, 0.3]), "friction_coefficient_drop", error)
    figure = comparison_figures(Comparison(of(results, "tip").results, [one]))["friction-coefficient-drop"]
    labels, axes = lines_of(figure)
    assert "afm (measured, 95 %)" in labels
    bars = axes.containers[-1].lines[2][0].get_segments()
    assert [0.5 * np.ptp(bar[:, 1]) for bar in bars] == pytest.approx(1.959964 * error)


@pytest.mark.long
def test_under_one_load_measured_friction_is_drawn_as_a_coefficient_too(results):
    comparison = Comparison(of(results, "tip").results, [data("friction_drop", "pull", 40.0)])
    labels, axes = lines_of(comparison_figures(comparison)["friction-coefficient-drop"])
    assert "pull (measured, 95 %)" in labels
    points = next(box for box in axes.containers if box.get_label() == "pull (measured, 95 %)").lines[0]
    np.testing.assert_allclose(points.get_ydata(), comparison.measured[0].values / 30.0)


@pytest.mark.long
def test_results_far_apart_are_drawn_on_a_logarithmic_axis(results):
    near = comparison_figures(of(results, "tip", "free"))["friction-drop"].axes[0]
    assert near.get_yscale() == "linear"
    run = results[1]["rough"]
    ageing = run.ageing.fromdict(
        {**run.ageing.todict(), "bonds": run.ageing.bonds * 1000, "sites": run.ageing.sites * 1000}
    )
    far = comparison_figures(Comparison([*of(results, "tip").results, Entry.of(ageing, "far")]))["friction-drop"].axes[
        0
    ]
    assert far.get_yscale() == "log"


@pytest.mark.parametrize(
    "suffix", ["svg", *(pytest.param(suffix, marks=pytest.mark.campaign) for suffix in ("png", "pdf"))]
)
@pytest.mark.long
def test_figures_are_written_whatever_the_names_look_like(results, tmp_path, suffix):
    folder, _ = results
    odd = [tmp_path / "_hidden $x_1$ <b>.h5", tmp_path / "100 % $.h5"]
    for target, source in zip(odd, ("tip", "rough"), strict=True):
        target.write_bytes((folder / f"{source}.h5").read_bytes())
    comparison = compare_files(odd)
    labels, _ = lines_of(comparison_figures(comparison)["friction-drop"])
    assert len(labels) == 2  # neither hidden from the legend
    paths = figures.save_figures(comparison_figures(comparison), tmp_path / "figures", suffix=suffix)
    assert len(paths) == 5
    assert all(path.stat().st_size > 2000 for path in paths)
    with pytest.raises(StoreError, match="already there"):
        figures.save_figures(comparison_figures(comparison), tmp_path / "figures", suffix=suffix)
    figures.save_figures(comparison_figures(comparison), tmp_path / "figures", suffix=suffix, force=True)


def test_results_with_nothing_to_draw_draw_nothing(results):
    assert list(comparison_figures(of(results, "dry"))) == ["pressures"]
    figures = comparison_figures(of(results, "unloaded"))
    assert "friction-coefficient-drop" not in figures
    assert "bonds-per-area" not in figures


@pytest.mark.long
def test_numbers_at_other_hold_times_say_at_which(tmp_path):
    """The last of a run, and those that a reader looks for first, are not at one time in all results."""
    tip = {
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 32, "pixel_size": "0.4518 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
        "forming": {"kind": "uniform", "lower": "0.8 eV", "upper": "1.4 eV"},
        "chemistry": {"activation_volume": "6.4 angstrom**3", "site_density": "pixel"},
        "engine": {"kind": "rejection-free"},
    }
    for name, stop in (("early", "20 s"), ("late", "1e4 s")):
        hold = {"temperature": "300 K", "start": "0.1 s", "stop": stop, "replicas": 3}
        ca.write(tmp_path / f"{name}.h5", ca.run(ca.parse_scene({**tip, "hold": hold}), warn=False))
    files = [tmp_path / "early.h5", tmp_path / "late.h5"]
    early, late = dict(compare_files(files).table())["mean shear stress"]
    assert early.endswith(" GPa at 20 s")
    assert late.endswith(" GPa at 10000 s")
    ca.write(tmp_path / "again.h5", ca.read(files[0]))
    same = dict(compare_files([files[0], tmp_path / "again.h5"]).table())
    assert same["mean shear stress at 20 s"] == [early.removesuffix(" at 20 s")] * 2
    main = report(files).partition("Main numbers")[2].partition("</table>")[0]
    assert re.search(r">[^<]+ at 20 s<", main)
    assert re.search(r">[^<]+ at 10000 s<", main)
