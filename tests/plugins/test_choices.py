"""A component as an option of a component, plugins left out, and everything that takes part named in the result."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

import chemage
from chemage import InputError, parse_scene
from chemage.plugin import Choice, ContactSolver, PluginError, registry

NESTED = """
import chemage
from chemage.plugin import Choice, ContactSolver

CHEMAGE_LIBRARIES = ("numpy",)

@chemage.plugin.hookimpl
def chemage_register():
    return {"contact": {"half": "chemage_half:Half"}}

class Half(ContactSolver):
    kind = "half"
    inner: Choice[ContactSolver]

    def _solve(self, surface, load, start):
        return self.inner.solve(surface, load)
"""
READER = """
import numpy as np
import chemage
from chemage import Surface
from chemage.plugin import Reader

@chemage.plugin.hookimpl
def chemage_register():
    return {"reader": {"spam": "chemage_spam:Spam"}}

class Spam(Reader):
    kind = "spam"
    suffixes = (".spam",)

    def read(self, path):
        return Surface(heights=np.loadtxt(path), pixel_size=1.0)
"""


class Nested(ContactSolver):
    kind = "nested"
    inner: Choice[ContactSolver] = "hertz"  # pyright: ignore[reportAssignmentType]

    def _solve(self, surface, load, start):
        return self.inner.solve(surface, load)


def test_a_choice_may_be_a_component_a_kind_or_a_table_and_is_stored_whole():
    hertz = chemage.contact("hertz", modulus="2 GPa")
    for given in (hertz, hertz.todict(), {"kind": "hertz", "modulus": "2 GPa"}):
        made = Nested(inner=given)
        assert made.inner == hertz
        assert made.todict() == {"kind": "nested", "inner": hertz.todict()}
        assert Nested.fromdict(made.todict()) == made
        assert made.digest() != Nested(inner=hertz.replace(modulus=3.0)).digest()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("hertzz", r"inner: .*no contact 'hertzz' \(did you mean 'hertz'\?\)"),
        ("hertz", "inner: .*contact 'hertz': modulus: is required"),
        ({"kind": "hertz", "modulus": "soft"}, "inner: .*modulus"),
        ({"modulus": 1.0}, "inner: .*contact: kind is required"),
        (3, "inner: .*expected a component made with chemage.contact"),
        (chemage.engine("bkl"), "inner: .*expected a component made with chemage.contact"),
    ],
)
def test_a_wrong_choice_is_named(given, message):
    with pytest.raises(InputError, match=message):
        Nested(inner=given)


def test_a_choice_needs_a_role():
    with pytest.raises(TypeError, match="give the class of a role"):
        Choice[int]


# -- who took part ----------------------------------------------------------------------------------------------------


@pytest.fixture
def lab(tiny, site):
    site.install("chemage-half", {"chemage_half.py": NESTED}, {"half": "chemage_half"}, version="1.5")
    site.install("chemage-spam", {"chemage_spam.py": READER}, {"spam": "chemage_spam"}, version="0.3")
    points = [*registry.metadata.entry_points(group="chemage")]
    with registry.using(registry.Registry(points)):
        yield tiny


def named_everywhere(run, name, source, folder, command):
    """The file, `show` and `compare` say that this plugin took part."""
    assert run.plugins[name] == source
    path = folder / "x.h5"
    chemage.write(path, run)
    with h5py.File(path) as file:
        assert json.loads(file["contact"].attrs["provenance"])["plugins"][name] == source
    assert chemage.read(path).plugins[name] == source
    shown = command("show", path, "--all").out
    assert [line.split() for line in shown.splitlines() if f"plugin {name}" in line] == [
        ["plugin", name, *source.split()]
    ]
    assert source in dict(chemage.compare_files([path]).table())["plugins that took part"][0]


def test_a_solver_inside_a_solver_and_its_library(lab, tmp_path, command):
    nested = {"kind": "half", "inner": {"kind": "tiny-even"}, "load": 10.0}
    run = chemage.run(parse_scene(lab.scene(contact=nested)))
    named_everywhere(run, "half", f"chemage-half 1.5 (numpy {np.__version__})", tmp_path, command)
    assert run.plugins["tiny"] == "chemage-tiny 1.0"
    assert run.versions["chemage-half"] == "1.5"


def test_a_reader_that_its_ending_selects(lab, tmp_path, command):
    np.savetxt(tmp_path / "map.spam", np.arange(36.0).reshape(6, 6))
    surface = {"kind": "from-file", "path": str(tmp_path / "map.spam")}
    for _ in range(2):  # the second time the map is in memory
        run = chemage.run(parse_scene(lab.scene(surface=surface)))
        assert run.surface.plugins == {"spam": "chemage-spam 0.3"}
    named_everywhere(run, "spam", "chemage-spam 0.3", tmp_path, command)
    page = chemage.write_report([tmp_path / "x.h5"], tmp_path / "x.html").read_text(encoding="utf-8")
    assert "chemage-spam 0.3" in page


def test_a_class_from_a_notebook(lab, tmp_path, command):
    chemage.register(Nested)
    try:
        inner = {"kind": "nested", "inner": {"kind": "tiny-even"}, "load": 10.0}
        run = chemage.run(parse_scene(lab.scene(contact=inner)))
    finally:
        chemage.unregister(Nested)
    name = f"{Nested.__module__}.{Nested.__qualname__}"
    assert "(source " in run.plugins[name]
    chemage.write(tmp_path / "y.h5", run)
    assert chemage.read(tmp_path / "y.h5").plugins == run.plugins


# -- leaving plugins out ----------------------------------------------------------------------------------------------


def kinds(value: str | None) -> list[str]:
    environment = {**os.environ, "CHEMAGE_PLUGINS": value or ""}
    code = "import chemage; print(*chemage.plugin.registry.current().kinds('engine'))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    return done.stdout.split() if done.returncode == 0 else [done.stderr.strip().splitlines()[-1]]


@pytest.mark.long
def test_plugins_are_left_out_by_a_variable(tiny):
    assert {"bkl", "tiny-coin"} <= set(kinds(None))
    assert "tiny-coin" not in kinds("-tiny")
    assert {"bkl", "tiny-coin"} <= set(kinds("tiny"))
    assert kinds("-kinetics") == ["tiny-coin"]
    (message,) = kinds("-tinny")
    assert "CHEMAGE_PLUGINS names tinny, which is not installed" in message


@pytest.mark.long
def test_plugins_are_left_out_by_an_option(tiny):
    def listed(*words):
        done = subprocess.run(
            [sys.executable, "-m", "chemage", *words, "plugins", "list", "--json"], capture_output=True, text=True
        )
        return done.returncode, done.stdout, done.stderr

    assert "tiny-coin" in listed()[1]
    for words in (("--without", "tiny"), ("--without=tiny",)):
        status, out, _ = listed(*words)
        assert (status, "tiny-coin" in out) == (0, False)
    status, _, err = listed("--without", "spam")
    assert status == 2
    assert "which is not installed" in err


def test_libraries_that_are_not_there_are_an_error_of_the_plugin(site):
    bad = NESTED.replace('("numpy",)', '("no-such-library",)')
    site.install("chemage-half", {"chemage_half.py": bad}, {"half": "chemage_half"})
    with pytest.warns(registry.PluginWarning, match="no-such-library"):
        assert "half" not in site.registry().kinds("contact")
    with pytest.raises(PluginError):
        site.registry(strict=True)
