"""A component: frozen options, equal by value, refusing what it does not know."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from typing import ClassVar

import numpy as np
import pytest
from pydantic import PrivateAttr, SerializeAsAny, ValidationError

import chemage as ca
from chemage import InputError
from chemage.plugin import Barriers, Component, Energy


class Level(Barriers):
    """One barrier for all."""

    kind = "level"
    speed_only: ClassVar[tuple[str, ...]] = ("threads",)

    energy: Energy = 1.0
    """eV"""
    threads: int = 1
    """how many"""
    _kept: list[int] = PrivateAttr(default_factory=list)

    def quantile(self, uniform):
        self._kept.append(uniform.size)
        return np.full(uniform.shape, self.energy)

    def density(self, energy):
        return np.where(energy == self.energy, np.inf, 0.0)


class Twin(Level):
    kind = "twin"


class Holder(Component):
    kind = "holder"
    inner: SerializeAsAny[Component]


def test_equal_options_are_equal_objects():
    assert Level(energy="1.5 eV") == Level(energy=1.5)
    assert hash(Level(energy="1.5 eV")) == hash(Level(energy=1.5))
    assert Level() == Level(energy=1.0)  # given or by default, it is the same
    assert Level() != Level(energy=2)
    assert Level() != Twin()
    assert Level() != "level"


def test_what_a_component_remembers_is_no_part_of_it():
    used, fresh = Level(), Level()
    used.quantile(np.ones(3))
    assert used == fresh
    assert hash(used) == hash(fresh)


def test_options_are_frozen():
    component = Level()
    with pytest.raises(ValidationError, match="frozen"):
        component.energy = 2.0
    assert component.energy == 1.0


def test_digest_is_of_role_kind_and_options():
    assert Level().digest() == Level(energy="1 eV").digest()
    assert len({Level().digest(), Level(energy=2).digest(), Twin().digest()}) == 3


@pytest.mark.long
def test_digest_is_the_same_in_every_process():
    code = "import chemage as ca; print(ca.barriers('gaussian', mean=1.1, std='20 meV').digest())"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == ca.barriers("gaussian", mean=1.1, std=0.02).digest()


def test_options_that_change_only_the_speed_are_no_part_of_the_digest():
    assert Level(threads=8).digest() == Level().digest()
    assert Level(threads=8) != Level()
    assert "threads" in Level().todict()
    assert "threads" not in Level().identity()
    # also inside another component
    assert Holder(inner=Level(threads=8)).digest() == Holder(inner=Level()).digest()


def test_content_beside_the_options_is_part_of_the_digest_and_not_of_the_options(monkeypatch):
    before, around = Level().digest(), Holder(inner=Level()).digest()
    monkeypatch.setattr(Level, "content", lambda self: {"table": "another"})
    assert Level().digest() != before
    # also inside another component
    assert Holder(inner=Level()).digest() != around
    assert Level().identity()["table"] == "another"
    assert "table" not in Level().todict()
    assert Level.fromdict(Level().todict()) == Level()


def test_a_component_inside_a_component_keeps_its_kind():
    assert Holder(inner=Twin()).todict() == {"kind": "holder", "inner": Twin().todict()}
    assert Holder(inner=Twin()).digest() != Holder(inner=Level()).digest()


def test_todict_is_plain_json_and_goes_back():
    component = Level(energy=1.25, threads=2)
    fields = json.loads(json.dumps(component.todict()))
    assert fields == {"kind": "level", "energy": 1.25, "threads": 2}
    assert Level.fromdict(fields) == component
    assert Level.fromdict({"energy": 1.25, "threads": 2}) == component
    assert pickle.loads(pickle.dumps(component)) == component
    with pytest.raises(InputError, match="kind = 'level': these are not the options of barriers 'twin'"):
        Twin.fromdict(fields)


def test_replace_validates_again_and_keeps_the_rest():
    component = Level(energy=1.25, threads=2)
    assert component.replace(energy="2 eV") == Level(energy=2, threads=2)
    assert component.energy == 1.25
    with pytest.raises(InputError, match="energy"):
        component.replace(energy="2 nm")
    with pytest.raises(InputError, match=r"enrgy: no such option \(did you mean 'energy'\?\)"):
        component.replace(enrgy=2)


def test_every_problem_is_named_at_once():
    with pytest.raises(InputError) as caught:
        Level(energy="1 nm", threads="many", colour="red")
    said = str(caught.value)
    assert said.startswith("barriers 'level': ")
    assert [path for path, _ in caught.value.problems] == ["energy", "threads", "colour"]
    for path, message in caught.value.problems:
        assert f"{path}: {message}" in said


def test_option_names_of_python_itself_are_no_option():
    for name in ("self", "cls", "kind", "role", "model_config"):
        with pytest.raises(InputError, match=f"{name}: no such option"):
            Level(**{name: 1})
