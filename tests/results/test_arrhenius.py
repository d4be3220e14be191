"""A temperature sweep becomes a table and a figure of activation energies, in Python and on the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from seen import figures, result_of

import chemage as ca

SCENE = {
    "name": "warm",
    "surface": {"kind": "sphere", "radius": 30, "pixels": 32, "pixel_size": 0.4518},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": 20},
    "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.1},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-4, "stop": 1e6, "per_decade": 4, "replicas": 4},
    "sweep": {"hold.temperature": [340, "280 K", 310]},
}


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return ca.sweep(SCENE, tmp_path_factory.mktemp("arrhenius") / "warm")


@pytest.fixture(scope="module")
def crossed(tmp_path_factory):
    """A sweep over temperature and load."""
    axes = {"hold.temperature": [280, 310, 340], "contact.load": [10, 20]}
    return ca.sweep({**SCENE, "sweep": axes}, tmp_path_factory.mktemp("arrhenius") / "crossed")


def test_a_sweep_its_folder_and_its_points_give_the_same(swept):
    found = ca.arrhenius(swept)
    assert found.temperatures.tolist() == [280, 310, 340]
    assert found.energies
    for same in (swept.folder, str(swept.folder), list(swept), [point.ageing() for point in swept]):
        assert ca.arrhenius(same).todict() == found.todict()


def test_files_of_runs_give_the_same(swept, tmp_path):
    paths = []
    for point in swept:
        paths.append(tmp_path / f"{point.index}.h5")
        ca.write(paths[-1], point.run())
    assert ca.arrhenius(paths).todict() == ca.arrhenius(swept).todict()


def test_the_energies_lie_within_the_barriers(swept):
    for one in ca.arrhenius(swept, [0.2, 0.5, 0.8], quantity="bonds_per_site").energies[:3]:
        # pressure lowers the barriers of no site here: the activation volume is 0
        assert one.energy == pytest.approx(0.7 + 0.4 * one.level, abs=max(4 * one.energy_stderr, 0.01))


def test_another_axis_must_be_chosen(crossed):
    with pytest.raises(
        ca.InputError, match=r"contact.load is swept as well .*; choose one of its values: where contact"
    ):
        ca.arrhenius(crossed)
    chosen = ca.arrhenius(crossed, where={"contact.load": 20})
    assert chosen.temperatures.size == 3
    with pytest.raises(ca.InputError, match=r"no point has contact\.load = 7"):
        ca.arrhenius(crossed, where={"contact.load": 7})
    with pytest.raises(ca.InputError, match="where: chooses points of a sweep"):
        ca.arrhenius([crossed[0].ageing()], where={"contact.load": 20})


def test_a_sweep_without_temperature_is_refused(tmp_path):
    other = ca.sweep({**SCENE, "sweep": {"contact.load": [10, 20]}}, tmp_path / "other")
    with pytest.raises(ca.InputError, match=r"hold.temperature is not swept; swept are contact.load"):
        ca.arrhenius(other)


def test_what_has_no_ageing_is_refused(swept):
    with pytest.raises(ca.InputError, match="ContactSolution has no ageing curve"):
        ca.arrhenius([swept[0].contact()])
    with pytest.raises(ca.InputError, match="1 temperatures"):
        ca.arrhenius(swept[0].run())


def test_points_that_are_not_done_are_left_out_with_a_note(swept, tmp_path):
    data = {**SCENE, "sweep": {"hold.temperature": [280, 310, 340, 370]}}
    part = ca.sweep(data, tmp_path / "part")
    part.store.point(part.keys[3]).unlink()
    found = ca.arrhenius(part)
    assert found.temperatures.tolist() == [280, 310, 340]
    assert found.notes[0] == "1 of 4 points are not done and left out"


def test_the_command_prints_tables_and_draws_a_figure(swept, tmp_path, command):
    done = command(
        "arrhenius", swept.folder, "--quantity", "bonds_per_site", "--level", "0.5", "-o", tmp_path / "arrhenius.png"
    )
    assert done.status == 0, done.err
    assert "bonds per site = 0.5" in done.out
    assert "activation energy" in done.out
    assert "scatter between surfaces is not included" in done.out
    assert (tmp_path / "arrhenius.png").stat().st_size > 1000
    made = json.loads(
        command("arrhenius", swept.folder, "--level", "0.5", "--quantity", "bonds_per_site", "--json").out
    )
    expected = ca.arrhenius(swept, 0.5, quantity="bonds_per_site").todict()
    assert {name: made[name] for name in expected} == expected


def test_the_command_chooses_points_and_a_window(crossed, command):
    made = json.loads(
        command("arrhenius", crossed.folder, "--where", "contact.load=10", "--window", "1s 1e3", "--json").out
    )
    assert made["fits"][0]["window"] == [1.0, 1000.0]
    assert command("arrhenius", crossed.folder, "--window", "1s", "--where", "contact.load=10").status == 2


def test_the_tables_have_a_row_for_each_temperature_and_level(swept):
    found = ca.arrhenius(swept, [0.3, 0.6], quantity="bonds_per_site")
    by_temperature, by_level = (table.rows for table in result_of(found).tables())
    assert [row[0] for row in by_temperature] == ["280", "310", "340"]
    assert [row[0] for row in by_level][:2] == ["bonds per site = 0.3", "bonds per site = 0.6"]
    assert by_level[0][1].endswith("eV")


def test_the_figure_shows_times_against_one_over_t(swept):
    found = ca.arrhenius(swept, [0.3, 0.6], quantity="bonds_per_site")
    left, right = figures(found)["arrhenius"].axes[:2]
    assert left.get_yscale() == "log"
    lines = [line for line in left.lines if len(line.get_xdata()) == 50]
    assert len(lines) == len(found.energies)
    one = found.energies[0]
    np.testing.assert_allclose(lines[0].get_ydata(), one(1e3 / lines[0].get_xdata()))
    assert right.get_ylabel() == "activation energy (eV)"
    # bars are 95 % intervals everywhere, and say so
    assert right.get_title() == "bars: 95 % intervals"
    assert left.get_legend().get_title().get_text() == "bars: 95 % intervals; activation energy at"
    half = one.log_time_half_widths
    segments = np.array(left.containers[0].lines[2][0].get_segments())
    np.testing.assert_allclose(segments[:, 1, 1], one.times * np.exp(half))
    # Student's of four replicas
    np.testing.assert_allclose(half, 3.182446 * one.log_time_errors, rtol=1e-6)
