"""docs/plugins.md, done as it says: the package is built from its code blocks, installed, tested and used."""

from __future__ import annotations

import json
import re
import tomllib

import pytest
from tutorial import Tutorial, run_python

from chemage.plugin import registry

PAGE = Tutorial("plugins.md", end="## A plugin that changes a stage")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The folder of the tutorial, and an environment in which the package is installed as pip would do it."""
    return PAGE.install(tmp_path_factory.mktemp("tutorial"))


def chemage(project, *commands):
    """What ``chemage`` prints for each of ``commands``, all in one process, because it takes longest to start."""
    program = """
import json, sys
from typer.testing import CliRunner
from chemage.cli.app import app

for command in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, (command, done.output, done.exception)
    print(done.stdout, end="\\0")
"""
    return run_python(project, "-c", program, json.dumps(commands)).split("\0")[:-1]


def test_the_page_shows_every_file_it_lists():
    (tree,) = [code for language, code in PAGE.blocks if not language and "pyproject.toml" in code]
    top, *listed = tree.split()
    assert set(listed) | {"tip.toml"} == set(PAGE.files)
    assert top == f"{tomllib.loads(PAGE.files['pyproject.toml'])['project']['name']}/"


@pytest.mark.long
def test_its_own_tests_pass(project):
    said = run_python(project, "-W", "error", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests")
    passed = int(re.search(r"(\d+) passed", said)[1])  # pyright: ignore[reportOptionalSubscript]
    assert passed > 25
    assert "failed" not in said
    assert "skipped" not in said


@pytest.mark.long
def test_its_own_tests_can_fail(project):
    """The kit sees a density that does not belong to the quantile function."""
    source = project / "chemage_weibull" / "weibull.py"
    right = source.read_text()
    wrong = right.replace("self.shape - 1)", "self.shape - 2)")
    assert wrong != right
    try:
        source.write_text(wrong)
        with pytest.raises(AssertionError, match="density_agrees_with_quantile"):
            run_python(project, "-B", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests")
    finally:
        source.write_text(right)


@pytest.mark.long
def test_it_is_listed_and_checked(project):
    listed, checked, shown = chemage(
        project, ["plugins", "list", "--json"], ["plugins", "check"], ["plugins", "show", "weibull"]
    )
    (row,) = [row for row in json.loads(listed)["components"] if row["kind"] == "weibull"]
    assert row["role"] == "barriers"
    assert "chemage-weibull 1.0" in str(row)
    assert "0 problems" in checked
    for text in ("scale", "width s above the threshold, eV", "Weibull, J. Appl. Mech."):
        assert text in shown


@pytest.mark.long
def test_the_scene_is_valid_and_runs(project):
    words = ["run", "tip.toml", "--json", "--out", "tip.h5", "--no-figures"]
    result = json.loads(chemage(project, ["check", "tip.toml"], words)[-1])
    assert result["engine"] == "rejection-free"
    assert result["friction_drop"]["value"][-1] > result["friction_drop"]["value"][0] >= 0
    assert (project / "tip.h5").exists()


def test_the_python_lines_run(project):
    (code,) = [code for _, code in PAGE.blocks if code.startswith("import chemage as ca")]
    run_python(project, "-c", code + "\nassert silica.forming is by_name or silica.forming == by_name")


def python_block(text):
    (code,) = [code for language, code in PAGE.blocks if language == "python" and text in code]
    return code


@pytest.mark.long
def test_the_components_without_a_package_meet_their_roles_and_draw(project):
    use = """
import chemage as ca
from chemage.results.drawing import figures
from chemage.testing import check_component

ca.register(DrawnWeibull)
check_component(DrawnWeibull(scale=0.3, shape=3, threshold=0.8))
check_component(barriers)
scene = {
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 48, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "exponential"},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "replicas": 4},
}
result = ca.run(scene)
assert any(name.endswith("Exponential") and "source" in version for name, version in result.versions.items())
drawn = {**scene, "forming": {"kind": "drawn-weibull", "scale": 0.3, "shape": 3, "threshold": 0.8}}
assert len(figures(ca.run(drawn))["weibull"].axes[0].lines) == 1
ca.unregister(Exponential)
try:
    ca.barriers("exponential")
except ca.plugin.UnknownKindError:
    pass
else:
    raise AssertionError("still known")
"""
    file = project / "notebook.py"
    blocks = ("class DrawnWeibull", "@chemage.register")
    file.write_text("".join(python_block(text) for text in blocks) + use)
    run_python(project, "-W", "error", file.name)


@pytest.mark.long
def test_the_law_for_friction_and_the_map_meet_their_roles_and_reach_results(project):
    blocks = [python_block("class BellEvans"), python_block("class BondMap")]
    assert all(len(block.splitlines()) < 60 for block in blocks)
    use = """
import chemage as ca
from chemage.results.drawing import figures
from chemage.results.comparison import compare_files
from chemage.results.drawing import comparison_figures
from chemage.testing import check_component

for cls in (BellEvans, BondMap):
    check_component(ca.register(cls)())
scene = {
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 48, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "gaussian", "mean": "1 eV", "std": "0.1 eV"},
    "breaking": {"kind": "gaussian", "mean": "1.1 eV", "std": 0},
    "engine": {"kind": "rejection-free"},
    "rupture": {"kind": "bell-evans", "loading_rate": "4 uN/s"},
    "observe": [{"kind": "bond-map"}],
    "hold": {"start": "1 ms", "stop": "1e5 s", "replicas": 4},
}
result = ca.run(scene)
ageing, kt = result.ageing, ca.plugin.KB * 300.0
# one barrier: the number of bonds times f* = (k_BT/x) ln(r x / (k0 k_BT)), k0 = nu exp(-E/k_BT)
k0 = 1e13 * np.exp(-1.1 / kt)
force = kt / 0.1 * NN_NM * np.log(4e3 * 0.1 / (k0 * kt * NN_NM))
assert 0.9 < force < 1.1
np.testing.assert_allclose(ageing.friction_drop, ageing.bonds * force, rtol=1e-9)
plain = ca.run({**scene, "rupture": {"kind": "mean-force"}, "observe": []})
np.testing.assert_array_equal(ageing.bonds, plain.ageing.bonds)
bonds = ageing.observables["bond_map"].sum(axis=(2, 3)) * (3 * 0.4518) ** 2
np.testing.assert_allclose(bonds, ageing.bonds, rtol=1e-9)
assert ageing.measured["bond_map"].output.dims == ("hold_time", "cell_x", "cell_y")
assert "fullest_cell" in result.summary()["observables"]
assert "bond-map" in figures(result)
ca.write("bell-a.h5", result)
ca.write("bell-b.h5", result)
made = compare_files(["bell-a.h5", "bell-b.h5"])
assert "bond-map" in comparison_figures(made)
assert "bonds per area of the fullest cell at the last hold time" in dict(made.table())
"""
    file = project / "friction.py"
    file.write_text("".join(blocks) + use)
    run_python(project, "-W", "error", file.name)


@pytest.mark.long
def test_a_kind_of_result_is_shown_by_every_command(project):
    use = """
import chemage as ca
from typer.testing import CliRunner
from chemage.cli.app import app

ca.register(WearReader)
np.savetxt("a.wear", [[10, 0.5], [100, 0.8]])
np.savetxt("b.wear", [[10, 0.4], [100, 1.2]])
for words in ("show a.wear", "show a.wear --csv", "plot a.wear", "compare a.wear b.wear", "report a.wear"):
    done = CliRunner().invoke(app, words.split())
    assert done.exit_code == 0, (words, done.output, done.exception)
    print(done.stdout)
"""
    file = project / "wear.py"
    file.write_text(python_block("class WearTrack:") + use)
    said = run_python(project, "-W", "error", file.name)
    assert re.search(r"depth of the track +0\.8 nm", said)
    assert "cycles,depth (nm)\n10.0,0.5\n100.0,0.8\n" in said
    assert re.search(r"depth of the track +0\.8 nm +1\.2 nm", said)
    assert (project / "a-figures" / "wear.png").is_file()


@pytest.mark.long
def test_a_stream_of_its_own(project):
    use = "assert 250 < is_defect(1, range(1000), 0.3).sum() < 350"
    run_python(project, "-c", python_block("random.stream") + use)


@pytest.mark.long
def test_the_stubs_know_the_plugin(project):
    chemage(project, ["plugins", "stubs"])
    stub = (project / "typings" / "chemage" / "__init__.pyi").read_text()
    assert 'Literal["weibull"]' in stub
    assert "threshold: QuantityLike = ..." in stub


def test_the_table_of_roles_is_complete():
    rows = re.findall(r"^\| `(\w+)` \| `(\w+)` \| (.*?) \|", PAGE.text, re.MULTILINE)
    assert [role for role, _, _ in rows] == list(registry.Registry(()).roles)
    for role, name, methods in rows:
        cls = registry.current().role(role)
        assert cls.__name__ == name
        assert set(re.findall(r"`(\w+)\(", methods)) == set(getattr(cls, "__abstractmethods__", ()))


def test_the_page_says_where_to_import_from():
    (sentence,) = re.findall(r"Import from (.*?), and from no other module", PAGE.text, re.DOTALL)
    assert set(re.findall(r"`(chemage[\w.]*)`", sentence)) == {"chemage", "chemage.plugin", "chemage.testing"}


def test_every_command_of_the_page_exists(command):
    for words in re.findall(r"^chemage (\w+ \w+)$", PAGE.text, re.MULTILINE):
        assert command(*words.split(), "--help").status == 0, words
