"""`chemage show`, `plot` and `cite` of the folder of a sweep."""

from __future__ import annotations

import json

import pytest

import chemage

AXES = {"contact.load": ["5 nN", 20], "hold.seed": [0, 1, 2]}


@pytest.fixture
def study(tiny, tmp_path, monkeypatch):
    """The folder of a sweep of six points."""
    monkeypatch.chdir(tmp_path)
    return chemage.sweep({**tiny.scene(), "sweep": AXES}, "study")


def test_show_says_what_was_swept_and_what_came_of_it(study, command):
    study.store.point(study.keys[5]).unlink()
    done = command("show", "study")
    assert done.status == 0
    assert "contact.load   2: 5 nN, 20" in done.out
    assert "points         5 of 6 points done, 2 contacts, 1 missing" in done.out
    assert "means over 3 seeds with 95 % intervals" in done.out
    table = [line.split() for line in done.out.splitlines()]
    assert ["load", "(nN)", "seeds", "A/A0", "Δμ", "β"] in table
    assert [line[:2] for line in table if line[:1] in (["5"], ["20"])] == [["5", "3"], ["20", "2"]]
    assert max(len(line) for line in done.out.splitlines()) <= 80


def test_show_as_json_has_every_point(study, command):
    shown = json.loads(command("show", "study", "--json").out)
    assert (shown["points"], shown["done"]) == (6, 6)
    assert shown["units"]["contact.load"] == "nN"
    assert [one["swept"]["contact.load"] for one in shown["results"]] == [5, 5, 5, 20, 20, 20]
    assert shown["results"][4]["beta"]["value"] == study[4].summary["beta"]


@pytest.mark.long
def test_plot_draws_into_a_folder_beside(study, command, tmp_path):
    done = command("plot", "study")
    assert done.status == 0, done.err
    assert done.out.split() == [
        "study-figures/beta-friction_drop-against-load.png",
        "study-figures/friction_coefficient_drop-against-hold_time-by-load.png",
    ]
    assert all((tmp_path / name).stat().st_size > 5000 for name in done.out.split())
    assert "already there" in command("plot", "study").err
    assert command("plot", "study", "--force").status == 0


def test_plot_draws_what_is_asked_for(study, command, tmp_path):
    words = ("--x", "seed", "--lines", "load", "--y", "area_fraction", "--y", "sites", "--format", "svg", "-o", "fig")
    done = command("plot", "study", *words)
    assert done.out.split() == ["fig/area_fraction-sites-against-seed-by-load.svg"]
    assert (tmp_path / "fig" / "area_fraction-sites-against-seed-by-load.svg").exists()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--x", "height"), "the axes are load, seed, hold_time"),
        (("--where", "load"), "--where load: write it as AXIS=VALUE"),
        (("--where", "load=7"), "the values are 5, 20 nN"),
        (("--window", "0 1 0 1"), "--window: study is a sweep"),
    ],
)
def test_what_cannot_be_plotted_is_explained(study, command, words, problem):
    done = command("plot", "study", *words)
    assert done.status == 2
    assert problem in done.err


def test_options_of_sweeps_are_not_for_files(study, command, tmp_path):
    chemage.write(tmp_path / "one.h5", study[0].ageing())
    assert "--y is for sweeps, and one.h5 is a file" in command("plot", "one.h5", "--y", "beta").err
    (tmp_path / "other").mkdir()
    assert "other is not the folder of a sweep" in command("show", "other").err


def test_cite_knows_the_components_of_all_points(study, command):
    text = command("cite", "study", "--format", "text").out
    assert text.splitlines()[0] == (
        f"The chemage developers, chemage: chemical ageing of frictional contacts, version {chemage.__version__}"
    )
    assert "Phys. Rev. E 98, 023001" in text.splitlines()[1]
