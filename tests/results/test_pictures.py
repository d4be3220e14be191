"""What notebooks show of results, and the methods plot, to_xarray and to_pandas."""

from __future__ import annotations

import re
import sys
from time import process_time

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import chemage as ca
from chemage import errors

KINDS = ("surface", "contact", "history", "ageing")


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def run(small_text):
    import tomllib

    return ca.run(tomllib.loads(small_text))


@pytest.fixture(scope="module")
def statistics(run):
    return ca.plugin.contact_statistics(run.contact, ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.2)))


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_is_drawn_and_shown(kind, examples):
    thing = getattr(examples, kind)()
    axes = thing.plot()
    assert isinstance(axes, Axes)
    assert axes.has_data()
    assert thing.plot(axes) is axes
    shown = thing._repr_html_()
    assert shown.count("data:image/png;base64,") == 1
    assert "<table>" in shown
    assert len(shown) < 200_000
    assert not re.search(r"(src|href)=\"(?!data:)", shown)


def test_statistics_are_drawn_and_shown(statistics):
    line = statistics.plot().lines[0]
    assert line.get_ydata()[0] == pytest.approx(statistics.contact_area)
    assert "mean contact pressure" in statistics._repr_html_()


def test_a_run_is_drawn_side_by_side_or_in_part(run):
    assert len(run.plot()) == 3
    (axes,) = run.plot("ageing")
    assert axes.get_ylabel() == "friction coefficient drop Δμ"
    shown = run._repr_html_()
    assert run.fit().texts()[0] in shown
    assert len(shown) < 200_000
    with pytest.raises(ca.InputError, match=r"plot: small has no 'gap'; it has surface, contact, ageing"):
        run.plot("gap")


def test_curves_in_one_plot_are_not_cut(examples):
    ageing = examples.ageing()
    higher = ageing.model_copy(update={"rupture_force": 10 * ageing.friction_drop})
    axes = higher.plot(ageing.plot(fit=False), fit=False)
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] > higher.mean_friction_coefficient_drop.max()


def test_ageing_without_load_shows_the_force(examples):
    ageing = examples.ageing(load=0.0)
    assert ageing.plot().get_ylabel() == "friction drop ΔF (nN)"
    assert ageing.plot(quantity="friction_coefficient_drop").texts[0].get_text() == "undefined: no load"


def test_the_bars_of_an_ageing_curve_say_what_they_are(examples):
    def entries(axes):
        return [text.get_text() for text in axes.get_legend().get_texts()]

    ageing = examples.ageing()
    of = f"mean of {ageing.replicas} replicas, 95 %"
    assert entries(ageing.plot(fit=False)) == [of]
    assert entries(ageing.plot(fit=False, label="rough")) == [f"rough, {of}"]


def test_everything_shown_is_escaped(run, examples):
    evil = "<script>alert(1)</script>"
    assert evil not in examples.ageing(notes=(evil,), engine=evil)._repr_html_()
    assert evil not in ca.Run({**run.scene, "title": evil}, run.contact)._repr_html_()


def test_without_matplotlib_the_table_is_left(monkeypatch, examples):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    shown = examples.surface()._repr_html_()
    assert "<img" not in shown
    assert "rms height" in shown


@pytest.mark.long
def test_a_large_surface_is_shown_quickly():
    heights = np.random.default_rng(1).normal(size=(2500, 2500))
    ca.Surface(heights=heights[:4, :4], pixel_size=0.5)._repr_html_()
    surface = ca.Surface(heights=heights, pixel_size=0.5)
    begin = process_time()
    shown = surface._repr_html_()
    assert process_time() - begin < 2
    assert len(shown) < 200_000


@pytest.mark.parametrize("kind", KINDS)
def test_xarray_has_the_names_dimensions_and_units_of_the_file(kind, examples, tmp_path):
    xarray = pytest.importorskip("xarray")
    thing = getattr(examples, kind)()
    made = thing.to_xarray()
    ca.write(tmp_path / "x.h5", thing)
    with xarray.open_dataset(tmp_path / "x.h5", group=kind, engine="h5netcdf") as stored:
        for name, variable in stored.variables.items():
            assert made[name].dims == variable.dims
            assert made[name].attrs.get("units") == variable.attrs.get("units")
            assert np.array_equal(made[name].values, variable.values, equal_nan=made[name].dtype.kind == "f")


def test_xarray_of_a_run_has_all_its_parts(run):
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data.heights.dims == data.pressure.dims == ("x", "y")
    assert data.bonds.dims == ("replica", "hold_time")
    assert np.array_equal(data.friction_drop, run.ageing.mean_friction_drop)
    assert data.friction_drop.attrs["units"] == "nN"
    assert data.attrs["contact.load"] == 40.0


def test_pandas_has_a_row_for_each_hold_time(run, examples):
    pytest.importorskip("pandas")
    table = run.to_pandas()
    assert table.index.name == "hold_time"
    assert np.array_equal(table.index, run.ageing.hold_times)
    assert np.array_equal(table.friction_drop, run.ageing.mean_friction_drop)
    assert np.array_equal(table.friction_drop_half_width, run.ageing.friction_drop_half_width, equal_nan=True)
    assert table.attrs["replicas"] == 3
    heights = examples.surface().to_pandas()
    assert heights.shape == (3, 4)
    assert heights.index.name == "x (nm)"
    assert list(examples.history().to_pandas().columns) == ["bonds", "formed", "broken"]
    contact = ca.Run({"name": "x", "contact": {}}, run.contact)
    with pytest.raises(ca.InputError, match="x ends at the contact"):
        contact.to_pandas()


@pytest.mark.parametrize(("library", "method"), [("xarray", "to_xarray"), ("pandas", "to_pandas")])
def test_a_missing_library_names_the_extra(library, method, monkeypatch, examples):
    monkeypatch.setitem(sys.modules, library, None)
    for kind in KINDS:
        with pytest.raises(
            errors.MissingError, match=rf"{library} is not installed; run: pip install 'chemage\[notebook\]'"
        ):
            getattr(getattr(examples, kind)(), method)()
    assert issubclass(errors.MissingError, ImportError)


def test_dir_lists_what_is_ours(examples):
    for thing in (examples.ageing(), examples.surface(), ca.contact("hertz", modulus=1)):
        names = dir(thing)
        assert not [name for name in names if name.startswith("model_")]
        assert not {"construct", "parse_obj", "copy", "json", "schema"} & set(names)
        assert "todict" in names
    assert {"plot", "fit", "bonds", "to_pandas"} <= set(dir(examples.ageing()))
    assert "modulus" in dir(ca.contact("hertz", modulus=1))


def test_nothing_heavy_is_imported_before_it_is_used():
    import subprocess

    program = (
        "import sys, chemage as ca; ca.Surface(heights=[[1., 2.]], pixel_size=1.0); ca.Ageing; ca.run\n"
        "heavy = {'matplotlib', 'xarray', 'pandas', 'chemage.results.kinds'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
