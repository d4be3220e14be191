"""A choice: frozen options, equal by value, refusing what it does not know."""

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
from chemage.errors import InputError
from chemage.spec import Barriers, Spec, check_times, checked_seed, force, nearest, temperature_value
from chemage.units import Energy


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


class Holder(Spec):
    kind = "holder"
    inner: SerializeAsAny[Spec]


def test_equal_options_are_equal_objects():
    assert Level(energy="1.5 eV") == Level(energy=1.5)
    assert hash(Level(energy="1.5 eV")) == hash(Level(energy=1.5))
    assert Level() == Level(energy=1.0)  # given or by default, it is the same
    assert Level() != Level(energy=2)
    assert Level() != Twin()
    assert Level() != "level"


def test_what_a_choice_remembers_is_no_part_of_it():
    used, fresh = Level(), Level()
    used.quantile(np.ones(3))
    assert used == fresh
    assert hash(used) == hash(fresh)


def test_options_are_frozen():
    choice = Level()
    with pytest.raises(ValidationError, match="frozen"):
        choice.energy = 2.0
    assert choice.energy == 1.0


def test_digest_is_of_role_kind_and_options():
    assert Level().digest() == Level(energy="1 eV").digest()
    assert len({Level().digest(), Level(energy=2).digest(), Twin().digest()}) == 3


def test_digest_is_the_same_in_every_process():
    code = "import chemage as ca; print(ca.barriers('gaussian', mean=1.1, std='20 meV').digest())"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == ca.barriers("gaussian", mean=1.1, std=0.02).digest()


def test_options_that_change_only_the_speed_are_no_part_of_the_digest():
    assert Level(threads=8).digest() == Level().digest()
    assert Level(threads=8) != Level()
    assert "threads" in Level().todict()
    assert "threads" not in Level().identity()
    # also inside another choice
    assert Holder(inner=Level(threads=8)).digest() == Holder(inner=Level()).digest()


def test_a_choice_inside_a_choice_keeps_its_kind():
    assert Holder(inner=Twin()).todict() == {"kind": "holder", "inner": Twin().todict()}
    assert Holder(inner=Twin()).digest() != Holder(inner=Level()).digest()


def test_todict_is_plain_json_and_goes_back():
    choice = Level(energy=1.25, threads=2)
    fields = json.loads(json.dumps(choice.todict()))
    assert fields == {"kind": "level", "energy": 1.25, "threads": 2}
    assert Level.fromdict(fields) == choice
    assert Level.fromdict({"energy": 1.25, "threads": 2}) == choice
    assert pickle.loads(pickle.dumps(choice)) == choice
    with pytest.raises(InputError, match="kind = 'level': these are not the options of barriers 'twin'"):
        Twin.fromdict(fields)


def test_replace_validates_again_and_keeps_the_rest():
    choice = Level(energy=1.25, threads=2)
    assert choice.replace(energy="2 eV") == Level(energy=2, threads=2)
    assert choice.energy == 1.25
    with pytest.raises(InputError, match="energy"):
        choice.replace(energy="2 nm")
    with pytest.raises(InputError, match=r"enrgy: no such option \(did you mean 'energy'\?\)"):
        choice.replace(enrgy=2)


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


def test_nearest():
    assert nearest("hertzz", ["hertz", "fft-bem"]) == " (did you mean 'hertz'?)"
    assert nearest("qqq", ["hertz", "fft-bem"]) == ""
    assert nearest("x", []) == ""


# -- chemistry --------------------------------------------------------------------------------------------------------


def test_chemistry_goes_round_with_its_choices():
    silica = ca.chemistry(
        forming=ca.barriers("md-silica"),
        breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
        activation_volume="6.4 angstrom**3",
        interaction=ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1),
    )
    fields = json.loads(json.dumps(silica.todict()))
    assert ca.Chemistry.fromdict(fields) == silica
    assert ca.Chemistry.fromdict(fields).digest() == silica.digest()
    assert ca.Chemistry(**{**fields, "breaking": None}) != silica


def test_two_chemistries_that_differ_by_a_kind_differ():
    uniform, gaussian = ca.barriers("uniform", lower=1, upper=2), ca.barriers("gaussian", mean=1, std=2)
    assert ca.chemistry(forming=uniform).digest() != ca.chemistry(forming=gaussian).digest()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({}, "forming: is required"),
        ({"forming": "gaussian"}, "forming: .*expected a choice made with chemage.barriers"),
        ({"forming": {}}, "forming: barriers: kind is required; installed: .*gaussian"),
        ({"forming": {"kind": "gausian"}}, r"forming: no barriers 'gausian' \(did you mean 'gaussian'\?\)"),
        ({"forming": {"kind": "gaussian", "mean": 1, "std": -1}}, "forming: .*std"),
        ({"forming": Level(), "interaction": Level()}, "interaction: expected a choice made with chemage.interaction"),
        ({"forming": Level(), "hydroxylation": 1.5}, "hydroxylation: 1.5"),
        ({"forming": Level(), "front_factor": 0}, "front_factor: 0"),
        ({"forming": Level(), "bond_force": "1 GPa"}, "bond_force: .*gigapascal"),
        ({"forming": Level(), "attempt_frequency": 0}, "attempt_frequency: 0"),
        ({"forming": Level(), "volume": 1}, "volume: no such option"),
    ],
)
def test_wrong_chemistry_is_refused(options, problem):
    with pytest.raises(InputError, match=f"Chemistry: {problem}"):
        ca.chemistry(**options)


# -- arguments --------------------------------------------------------------------------------------------------------


def test_force():
    assert force("20 uN") == 20000.0
    assert force(0) == 0.0
    for wrong in (-1, np.nan, np.inf, "nan", "1e400 N"):
        with pytest.raises(InputError, match=r"load = .*must be finite and not negative; give a force such as 20 uN"):
            force(wrong)
    with pytest.raises(InputError, match="gigapascal"):
        force("20 GPa")


def test_temperature():
    assert temperature_value("26.85 degC") == 300.0
    for wrong in (0, -1, np.nan, np.inf, "-300 degC"):
        with pytest.raises(InputError, match=r"temperature = .*must be finite and above zero; give kelvin"):
            temperature_value(wrong)


@pytest.mark.parametrize("times", [[1.0], (0, 1), np.array([0.0, 0.0, 2.0]), 3.0, range(4)])
def test_hold_times(times):
    checked = check_times(times)
    assert checked.dtype == np.float64
    assert checked.ndim == 1


@pytest.mark.parametrize(
    ("times", "problem"),
    [
        ([], r"hold_times = \(0,\): must be a list with at least one time"),
        ([[1, 2]], r"hold_times = \(1, 2\): must be a list"),
        (["soon"], r"hold_times = \['soon'\]: not a list of numbers"),
        ([1, -2], r"hold_times\[1\] = -2.0: must be finite and not negative"),
        ([1, np.nan], r"hold_times\[1\] = nan"),
        ([1, np.inf], r"hold_times\[1\] = inf"),
        ([1, 3, 2], r"hold_times\[2\] = 2.0: comes after 3.0; sort the hold times"),
    ],
)
def test_wrong_hold_times(times, problem):
    with pytest.raises(InputError, match=problem):
        check_times(times)


def test_hold_times_are_a_copy():
    mine = np.array([1.0, 2.0])
    checked = check_times(mine)
    mine[0] = 5
    assert checked[0] == 1.0


def test_seeds():
    assert checked_seed(np.int64(3)) == 3
    for wrong in (-1, 1.5, True, "1", None):
        with pytest.raises(InputError, match=r"seed = .*must be a whole number, 0 or larger"):
            checked_seed(wrong)
