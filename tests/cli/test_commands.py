"""Every command but `run`: what it prints and with which status it ends."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata

import numpy as np
import pytest

import chemage
from chemage import load_scene
from chemage.plugin import registry

PNG, PDF = b"\x89PNG\r\n\x1a\n", b"%PDF-"


@pytest.fixture(scope="module")
def made():
    """The content of the file that :func:`result` made the first time."""
    return []


@pytest.fixture
def result(command, small, made):
    file = small.parent / "small.h5"
    if not made:
        assert command("run", small, "--no-figures").status == 0
        made.append(file.read_bytes())
    file.write_bytes(made[0])
    return file


# -- help and usage --------------------------------------------------------------------------------------------------


def test_help_names_every_command(command):
    done = command("--help")
    assert done.status == 0
    for name in ("run", "check", "show", "plot", "schema", "plugins", "init"):
        assert re.search(rf"^  {name} ", done.out, re.MULTILINE), name


HELP = """
import sys
from chemage.cli.app import main
sys.argv = ["chemage", "--help"]
try:
    main()
except SystemExit:
    pass
"""


@pytest.mark.parametrize("code", ["import chemage", HELP], ids=["import chemage", "chemage --help"])
def test_nothing_heavy_is_imported_before_it_is_needed(code):
    """So that help comes at once. What is imported counts, because seconds depend on the machine and on its load."""
    code += "\nimport sys; print(*sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert "chemage" in loaded
    assert not loaded & {"numpy", "numba", "scipy", "h5py", "h5netcdf", "matplotlib", "pint", "ase", "jinja2"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["chek"], "check"),
        (["check"], "Missing argument"),
        (["check", "a", "b"], "unexpected extra argument"),
        (["run", "silica-tip", "--colour"], "--colour"),
        (["plugins", "lst"], "list"),
    ],
)
def test_wrong_usage_is_explained(command, words, said):
    done = command(*words)
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert "Traceback" not in done.err


# -- check -----------------------------------------------------------------------------------------------------------


def test_check_tells_what_is_modelled_and_computes_nothing(command, small, monkeypatch):
    monkeypatch.setattr("chemage_surfaces.generated.SelfAffine.make", lambda *_: pytest.fail("computing began"))
    done = command("check", small)
    assert (done.status, done.err) == (0, "")
    for text in ("is valid", "self-affine", "fft-bem at 40 nN", "md-silica, lowered by 0.0399 eV/GPa", "3 replicas"):
        assert text in done.out, text
    assert sorted(p.name for p in small.parent.iterdir()) == ["small.toml"]


def test_check_json_is_one_object(command, small):
    done = command("check", small, "--json", "--set", "contact.load=0")
    plan = json.loads(done.out)
    assert plan["keys"] == load_scene(small, {"contact.load": 0}).keys()
    assert any("the load is 0" in note for note in plan["notes"])
    assert list(plan["stages"]) == [
        "surface",
        "contact",
        "forming",
        "breaking",
        "interaction",
        "sites",
        "kinetics",
        "rupture",
    ]


@pytest.mark.parametrize("name", ["silica-rough", "silica-tip", "silica-afm-tip", "silica-linear-tip"])
def test_installed_scenes_are_valid(command, name):
    done = command("check", name)
    assert (done.status, done.err) == (0, "")


# -- show and plot ---------------------------------------------------------------------------------------------------


def test_show_prints_the_table_of_the_run(command, small, result):
    shown = command("show", result)
    again = command("run", small, "--no-figures", "--force")
    assert shown.status == 0

    def table(text):
        return [line.rstrip() for line in text.splitlines() if "wall time" not in line and "result" not in line]

    assert len(table(shown.out)) > 8
    assert table(shown.out) == table(again.out)[: len(table(shown.out))]


def test_show_json_is_the_summary(command, result):
    told = json.loads(command("show", result, "--json").out)
    summary = json.loads(json.dumps(chemage.read(result).summary()))
    for name, value in summary.items():
        if name in told and name != "observables":
            number = isinstance(told[name], dict) and "value" in told[name]
            assert value == (told[name]["value"] if number else told[name]), name
    assert {"hold_times", "beta_stderr"} & summary.keys() - told.keys()


@pytest.mark.parametrize("name", ["surface", "contact", "ageing"])
def test_show_an_object_alone(command, result, name):
    thing = getattr(chemage.read(result), name)
    chemage.write("one.h5", thing)
    done = command("show", "one.h5")
    assert done.status == 0
    assert type(thing).__name__ in done.out
    numbers = json.loads(command("show", "one.h5", "--json").out)
    assert numbers["object"] == type(thing).__name__
    for key, (dims, _, _) in thing.arrays.items():
        if isinstance(numbers.get(key), str):
            assert numbers[key].startswith(f"array {getattr(thing, key).shape}"), dims


def test_show_reads_other_formats_through_readers(command, small):
    np.save("heights.npy", np.ones((3, 4)))
    done = command("show", "heights.npy")
    assert done.status == 2
    assert "pixel_size" in done.err  # a bare .npy does not say


@pytest.mark.long
@pytest.mark.parametrize(("suffix", "begins"), [("pdf", PDF), ("svg", b"<?xml")])
def test_plot_draws_every_figure(command, result, suffix, begins):
    done = command("plot", result, "--format", suffix)
    assert done.status == 0, done.err
    made = sorted(result.parent.glob(f"small-figures/*.{suffix}"))
    assert {p.stem for p in made} >= {"surface", "pressure", "barriers", "friction"}
    assert sorted(done.out.split()) == [str(p) for p in made]
    for picture in made:
        assert picture.read_bytes().startswith(begins)


@pytest.mark.long
def test_plot_overwrites_nothing_and_then_draws_nothing(command, result):
    folder = result.parent / "mine"
    folder.mkdir()
    (folder / "pressure.png").write_text("mine")
    done = command("plot", result, "--out", folder)
    assert (done.status, done.out) == (2, "")
    assert "pressure.png is already there" in done.err
    assert [p.name for p in folder.iterdir()] == ["pressure.png"]
    done = command("plot", result, "--out", folder, "--force")
    assert done.status == 0
    made = sorted(folder.iterdir())
    assert {p.name for p in made} >= {"surface.png", "pressure.png", "barriers.png", "friction.png"}
    assert sorted(done.out.split()) == [str(p) for p in made]
    assert all(p.read_bytes().startswith(PNG) for p in made)


# -- init ------------------------------------------------------------------------------------------------------------


def test_init_writes_a_scene_that_is_valid_and_is_the_installed_one(command, small):
    done = command("init", "mine.toml", "--like", "silica-tip")
    assert done.status == 0
    assert "chemage run mine.toml" in done.out
    text = (small.parent / "mine.toml").read_text()
    assert "#" in text
    assert load_scene("mine.toml").keys() == load_scene("silica-tip").keys()
    assert command("check", "mine.toml").status == 0


def test_init_says_what_it_copies_and_keeps_no_title_of_another_scene(command, small):
    done = command("init", "gouge")
    assert "gouge.toml is a copy of silica-rough" in done.out
    assert "another scene to begin with: --like SCENE (contact-challenge, " in done.out
    text = (small.parent / "gouge.toml").read_text()
    assert 'name = "gouge"' in text
    assert "title = " not in text
    assert load_scene(small.parent / "gouge.toml").title == ""


def test_init_overwrites_only_with_force(command, small):
    before = small.read_text()
    done = command("init", "small.toml")
    assert done.status == 2
    assert "already there" in done.err
    assert small.read_text() == before
    assert command("init", "small.toml", "--force").status == 0
    assert tomllib.loads(small.read_text())["name"] == "small"


def test_init_like_what_is_not_there(command, small):
    done = command("init", "x.toml", "--like", "silica-rouhg")
    assert done.status == 2
    assert "did you mean 'silica-rough'?" in done.err
    assert not (small.parent / "x.toml").exists()


# -- schema and plugins ----------------------------------------------------------------------------------------------


def test_schema_prints_json_schema(command):
    done = command("schema")
    assert done.status == 0
    assert json.loads(done.out)["$schema"].startswith("https://json-schema.org/")


def test_plugins_list_names_every_kind_and_scene(command):
    done = command("plugins", "list")
    assert done.status == 0
    plugins = registry.current()
    for role in plugins.roles:
        for kind in plugins.kinds(role):
            assert re.search(rf"{role} +{kind} +\S+ +chemage ", done.out), (role, kind)
    for name in registry.current().scenes():
        assert re.search(rf"scene +{name} +\S+ +chemage ", done.out)
    listed = json.loads(command("plugins", "list", "--json").out)
    assert {(c["role"], c["kind"]) for c in listed["components"]} == {
        (r, k) for r in plugins.roles for k in plugins.kinds(r)
    }
    assert listed["broken"] == []


def test_plugins_show_explains_a_kind(command):
    done = command("plugins", "show", "fft-bem")
    assert done.status == 0
    assert done.out.startswith("contact fft-bem  (chemage ")
    assert re.search(r"modulus +GPa +required +contact modulus", done.out)
    assert "cite: I. A. Polonsky" in done.out
    one = json.loads(command("plugins", "show", "from-file", "--json").out)[0]
    units = {option["name"]: option["unit"] for option in one["options"]}
    assert units["pixel_size"] == "nm"
    assert units["periodic"] == ""


def test_plugins_show_what_is_not_there(command):
    done = command("plugins", "show", "fftbem")
    assert done.status == 2
    assert "did you mean 'fft-bem'?" in done.err


def test_plugins_check_is_content(command):
    done = command("plugins", "check")
    assert done.status == 0
    assert done.out.endswith("0 problems\n")


# -- terminals -------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_terminal_without_greek_letters(small):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    words = [sys.executable, "-m", "chemage", "check", "silica-rough"]
    done = subprocess.run(words, cwd=small.parent, env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
    words = [sys.executable, "-m", "chemage", "check", "µ.toml"]
    done = subprocess.run(words, cwd=small.parent, env=environment, capture_output=True)
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr


def test_the_command_is_installed():
    (point,) = [p for p in metadata.entry_points(group="console_scripts") if p.name == "chemage"]
    assert point.load().__name__ == "main"


def test_version_is_the_installed_one(command):
    done = command("--version")
    assert done.status == 0
    assert done.out == f"chemage {metadata.version('chemage')}\n"
