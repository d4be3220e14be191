"""The plugin of docs/plugins.md that changes a stage: built from its code blocks, installed, tested and used."""

from __future__ import annotations

import json

import pytest
from tutorial import Tutorial, run_python

PAGE = Tutorial("plugins.md", "## A plugin that changes a stage", "## Hooks")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The folder of the tutorial, and an environment in which the package is installed as pip would do it."""
    project = PAGE.install(tmp_path_factory.mktemp("tutorial-hooks"))
    chemage(project, "init", "tip.toml", "--like", "silica-tip")
    (options,) = [code for language, code in PAGE.blocks if code.startswith("[plugins.hardness]")]
    with (project / "tip.toml").open("a") as scene:
        scene.write(options)
    return project


def chemage(project, *arguments, status=0):
    return run_python(project, "-c", "from chemage.cli.app import main; main()", *arguments, status=status)


def test_the_page_shows_every_file_it_lists():
    (tree,) = [code for language, code in PAGE.blocks if not language and "pyproject.toml" in code]
    _, *listed = tree.split()
    assert set(listed) | {"limits.toml"} == set(PAGE.files)


def test_the_plugin_is_short():
    code = [text for path, text in PAGE.files.items() if path.startswith("chemage_hardness/")]
    assert sum(len(text.splitlines()) for text in code) < 65


@pytest.mark.long
def test_its_own_tests_pass(project):
    assert "3 passed" in run_python(project, "-W", "error", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests")


@pytest.mark.long
def test_it_is_checked_and_explained(project):
    assert "0 problems" in chemage(project, "plugins", "check")
    shown = chemage(project, "plugins", "show", "hardness")
    for text in ("plugin hardness  (chemage-hardness 1.0)", "hook: chemage_solve_contact", "limit", "GPa", "None"):
        assert text in shown


@pytest.mark.long
def test_the_scene_runs_and_the_result_names_the_option(project):
    chemage(project, "check", "tip.toml")
    result = json.loads(chemage(project, "run", "tip.toml", "--json", "--out", "tip.h5"))
    named = "chemage-hardness 1.0 [limit = 2.0 GPa]"
    assert named in PAGE.text
    assert result["plugins"]["hardness"] == named
    assert result["max_pressure"]["value"] == 2
    assert "pressure limited to 2 GPa on" in result["notes"][0]
    assert list(project.rglob("*limited-pressure.png"))
    shown = " ".join(chemage(project, "show", "tip.h5", "--all").split())
    assert named in shown
    wrong = chemage(project, "check", "tip.toml", "--set", "plugins.hardness.limit=-1", status=2)
    assert "plugins.hardness.limit: -1" in wrong


@pytest.mark.long
def test_a_sweep_over_the_limit_solves_each_contact_once(project):
    (project / "limits.toml").write_text((project / "tip.toml").read_text() + PAGE.files["limits.toml"])
    chemage(project, "run", "limits.toml", "--out", "limits")
    manifest = json.loads((project / "limits" / "sweep.json").read_text())
    assert len(manifest["contacts"]) == 4
    assert manifest["units"] == {"plugins.hardness.limit": "GPa"}
    lines = (project / "limits" / "results.csv").read_text().splitlines()
    assert len(lines) >= 5
