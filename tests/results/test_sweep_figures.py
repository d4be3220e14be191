"""Figures of sweeps show the numbers of their points."""

from __future__ import annotations

import faults
import numpy as np
import pytest
from seen import figures as sweep_figures
from seen import result_of

import chemage
from chemage import InputError


@pytest.fixture
def swept(tiny, tmp_path):
    """Compute a sweep over ``axes``."""

    def compute(axes, **sections):
        return chemage.sweep({**tiny.scene(**sections), "sweep": axes}, tmp_path / "out")

    return compute


TWO = {"contact.load": [5, 10, 20], "hold.temperature": [300, 310], "hold.seed": [1, 2, 3]}


def test_the_usual_figures_are_lines_with_bands(swept):
    result = swept(TWO)
    made = sweep_figures(result)
    name, along = list(made)
    assert name == "beta-friction_drop-against-load-by-temperature"
    assert along == "friction_coefficient_drop-against-hold_time-by-load"
    left, right = made[name].axes
    assert (left.get_xlabel(), left.get_ylabel()) == ("load (nN)", "ageing rate per decade β")
    assert right.get_ylabel() == "friction drop ΔF at 1000 s (nN)"
    beta = result.to_xarray()["beta"].mean("seed")
    for line, kelvin in zip(left.lines, (300, 310), strict=True):
        assert line.get_label() == str(kelvin)
        x, y = line.get_data()
        assert x.tolist() == [5, 10, 20]
        assert y == pytest.approx(beta.sel(temperature=kelvin).values)
    assert len(left.collections) == 2, "a band for each line"
    assert "mean over 3 seeds" in made[name].get_suptitle()
    # of β, and in the table as well
    window = result[0].scene().fit
    doubt = result[0].ageing().fit(window.start, window.stop).doubt
    assert doubt.startswith("β rests on ")
    assert doubt in " ".join(made[name].get_suptitle().split())
    assert doubt in result_of(result).notes()
    assert doubt not in " ".join(made[along].get_suptitle().split())
    (legend,) = made[name].legends
    assert legend.get_title().get_text() == "temperature (K)"
    axes = made[along].axes[0]
    assert axes.get_xscale() == "log"
    assert "temperature = 310 K" in made[along].get_suptitle()


@pytest.mark.drawn
@pytest.mark.long
def test_the_legend_is_beside_the_data(swept):
    figure = sweep_figures(swept(TWO), y=["beta"])["beta-against-load-by-temperature"]
    figure.canvas.draw()
    legend = figure.legends[0].get_window_extent()
    assert all(not legend.overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_a_heat_map_has_a_cell_for_each_pair(swept):
    result = swept(TWO)
    figure = sweep_figures(result, heat=True, y=["beta"])["beta-against-load-and-temperature"]
    (mesh,) = figure.axes[0].collections
    beta = result.to_xarray()["beta"].mean("seed").transpose("temperature", "load")
    np.testing.assert_allclose(mesh.get_array(), beta.values)
    assert figure.axes[0].get_xlabel() == "load (nN)"
    assert figure.axes[0].get_ylabel() == "temperature (K)"
    assert figure.axes[1].get_ylabel() == "ageing rate per decade β"


@pytest.mark.long
def test_many_lines_become_a_heat_map(swept, monkeypatch):
    faults.most_lines(monkeypatch, 1)
    result = swept({"contact.load": [5, 10, 20], "hold.temperature": [300, 310]})
    assert next(iter(sweep_figures(result))) == "beta-friction_drop-against-load-and-temperature"


@pytest.mark.long
def test_points_that_are_missing_are_grey_and_counted(swept):
    result = swept(TWO)
    for point in result.where({"contact.load": 5.0, "hold.temperature": 300}):
        result.store.point(point.key).unlink()
    result = chemage.load_sweep(result.folder)
    figure = sweep_figures(result, heat=True, y=["beta"])["beta-against-load-and-temperature"]
    assert np.ma.getmaskarray(figure.axes[0].collections[0].get_array()).sum() == 1
    assert "3 of 18 points are not done" in " ".join(figure.get_suptitle().split())


@pytest.mark.parametrize(("loads", "scale"), [([1, 10, 33], "log"), ([1, 10, 30], "linear"), ([0, 10, 100], "linear")])
def test_axes_are_logarithmic_above_a_decade_and_a_half(swept, loads, scale):
    figure = sweep_figures(swept({"contact.load": loads}), y=["area_fraction"])["area_fraction-against-load"]
    assert figure.axes[0].get_xscale() == scale
    assert not figure.legends


def test_words_are_names_of_lines_and_of_places(swept):
    result = swept({"engine.trouble": ["", "other"], "contact.load": [5, 10]})
    lines = sweep_figures(result, y=["beta"])["beta-against-load-by-trouble"]
    assert len(lines.axes[0].lines) == 2
    places = sweep_figures(result, x="trouble", lines="load", y=["beta"])["beta-against-trouble-by-load"]
    assert [label.get_text() for label in places.axes[0].get_xticklabels()] == ["", "other"]
    with pytest.raises(InputError, match="--heat: load and trouble must have numbers as values"):
        sweep_figures(result, heat=True)


def test_a_contact_alone_has_its_area(tiny, tmp_path):
    scene = {name: part for name, part in tiny.scene().items() if name in ("name", "surface", "contact")}
    result = chemage.sweep({**scene, "sweep": {"contact.load": [5.0, 6.0]}}, tmp_path / "out")
    made = sweep_figures(result)
    assert list(made) == ["area_fraction-against-load"]
    assert made["area_fraction-against-load"].axes[0].get_ylabel() == "area fraction A/A0"


def test_nothing_is_drawn_of_a_sweep_without_results(swept):
    result = swept({"contact.load": [5, 10]})
    for point in result:
        result.store.point(point.key).unlink()
    with pytest.raises(InputError, match="no point is done; there is nothing to draw"):
        sweep_figures(chemage.load_sweep(result.folder))


def test_one_axis_has_no_heat_map(swept):
    with pytest.raises(InputError, match="--heat: a heat map needs two axes"):
        sweep_figures(swept({"contact.load": [5, 10]}), heat=True)
