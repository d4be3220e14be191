"""Small things that authors of plugins meet every day."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings

import pytest

import chemage as ca
from chemage.plugin import PluginError, registry

SLOW = """
import time
from chemage.plugin import hookimpl

time.sleep(0.6)
print("imported")

@hookimpl
def chemage_register():
    return {"barriers": {"hidden": "chemage_slow_kind:Hidden"}}
"""
HIDDEN = """
from chemage.plugin import Barriers

class Hidden(Barriers):
    "Its option hides a method."
    kind = "hidden"
    members: int = 3

    def quantile(self, uniform):
        return uniform

    def density(self, energy):
        return energy
"""
OPTIONS = """
from chemage.plugin import PluginOptions, Pressure, hookimpl

CHEMAGE_OPTIONS = "chemage_limit:Options"

class Options(PluginOptions):
    "A limit that need not be there."
    limit: Pressure | None = None

@hookimpl(wrapper=True)
def chemage_solve_contact():
    found = yield
    return found.model_copy(update={"notes": ("seen",)})
"""


def chemage(site, *words):
    path = os.pathsep.join([str(site.folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    program = "from chemage.cli.app import main; main()"
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run([sys.executable, "-c", program, *words], env=environment, capture_output=True, text=True)


@pytest.mark.long
def test_a_slow_plugin_is_named_and_does_not_delay_the_version(site):
    site.install("chemage-slow", {"chemage_slow.py": SLOW, "chemage_slow_kind.py": HIDDEN}, {"slow": "chemage_slow"})
    version = chemage(site, "--version")
    assert (version.returncode, version.stdout) == (0, f"chemage {ca.__version__}\n")
    checked = chemage(site, "plugins", "check")
    assert checked.returncode == 1
    said = checked.stdout + checked.stderr
    assert "plugin 'slow' (chemage-slow 1.0): its module chemage_slow takes 0." in said
    assert "the option 'members' has the name of a method of its role; rename it" in said


def test_an_option_that_hides_a_method_is_refused_when_it_is_registered():
    space: dict = {"__name__": "hidden"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # pydantic says so, too
        exec(HIDDEN, space)
    with pytest.raises(PluginError, match="the option 'members' has the name of a method"):
        ca.register(space["Hidden"])


def test_an_option_that_is_not_set_and_the_table_of_a_sweep(site, tmp_path):
    site.install("chemage-limit", {"chemage_limit.py": OPTIONS}, {"limit": "chemage_limit"})
    scene = {
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 16, "pixel_size": "1 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
        "sweep": {"contact.load": [20, 30]},
    }
    with registry.using(registry.Registry()):
        found = ca.sweep(scene, tmp_path / "out")
    assert found.to_pandas()["plugins"].tolist() == ["limit: chemage-limit 1.0 [limit = none]"] * 2
    header, *rows = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert "plugins" in header.split(",")
    assert all("limit: chemage-limit 1.0 [limit = none]" in row for row in rows)
