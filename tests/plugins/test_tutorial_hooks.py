"""docs/tutorial_hooks.md, done as it says: the plugin is built from its code blocks, installed, tested and used."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial_hooks.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
#: files of the tutorial: each block begins with the file's path in a comment
FILES = {found[1]: code for _, code in BLOCKS if (found := re.match(r"# (\S+\.\w+)\n", code))}


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The folder of the tutorial, and an environment in which the package is installed as pip would do it."""
    root = tmp_path_factory.mktemp("tutorial-hooks")
    for path, code in FILES.items():
        file = root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(code, encoding="utf-8")
    settings = tomllib.loads(FILES["pyproject.toml"])["project"]
    info = root / f"{settings['name'].replace('-', '_')}-{settings['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {settings['name']}\nVersion: {settings['version']}\n")
    points = "".join(f"{name} = {value}\n" for name, value in settings["entry-points"]["chemage"].items())
    (info / "entry_points.txt").write_text(f"[chemage]\n{points}")
    return root


def run(project, *command, status=0):
    path = os.pathsep.join([str(project), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *command],
        cwd=project,
        env={**os.environ, "PYTHONPATH": path, "CHEMAGE_STRICT": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr if status else done.stdout


def chemage(project, *arguments, status=0):
    return run(project, "-c", "from chemage.cli.app import main; main()", *arguments, status=status)


def test_the_page_shows_every_file_it_lists():
    (tree,) = [code for language, code in BLOCKS if not language and "pyproject.toml" in code]
    _, *listed = tree.split()
    assert set(listed) | {"tip.toml", "limits.toml"} == set(FILES)


def test_the_plugin_is_short():
    code = [text for path, text in FILES.items() if path.startswith("chemage_hardness/")]
    assert sum(len(text.splitlines()) for text in code) < 60


def test_its_own_tests_pass(project):
    assert "3 passed" in run(project, "-W", "error", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests")


def test_it_is_checked_and_explained(project):
    assert "0 problems" in chemage(project, "plugins", "check")
    shown = chemage(project, "plugins", "show", "hardness")
    for text in ("plugin hardness  (chemage-hardness 1.0)", "hook: chemage_solve_contact", "limit", "GPa", "None"):
        assert text in shown


def test_the_scene_runs_and_the_result_names_the_option(project):
    chemage(project, "check", "tip.toml")
    result = json.loads(chemage(project, "run", "tip.toml", "--json", "--out", "tip.h5"))
    named = "chemage-hardness 1.0 [limit = 2.0 GPa]"
    assert named in PAGE
    assert result["plugins"]["hardness"] == named
    assert result["max_pressure"] == 2
    assert "pressure limited to 2 GPa on" in result["notes"][0]
    assert list(project.rglob("*limited-pressure.png"))
    shown = " ".join(chemage(project, "show", "tip.h5").split())
    assert named in shown
    wrong = chemage(project, "check", "tip.toml", "--set", "plugins.hardness.limit=-1", status=2)
    assert "plugins.hardness.limit: -1" in wrong


def test_a_sweep_over_the_limit_solves_each_contact_once(project):
    (project / "limits.toml").write_text(FILES["tip.toml"] + FILES["limits.toml"])
    chemage(project, "run", "limits.toml", "--out", "limits")
    manifest = json.loads((project / "limits" / "sweep.json").read_text())
    assert len(manifest["contacts"]) == 4
    assert manifest["units"] == {"plugins.hardness.limit": "GPa"}
    lines = (project / "limits" / "results.csv").read_text().splitlines()
    assert len(lines) >= 5
