"""What a plugin raises names the plugin, its component and method, and the line; it is never a fault of chemage."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path

import chemage_bisection
import chemage_creep
import pytest

import chemage as ca
from chemage.plugin import Design, PluginError, Stage, Task, registry

#: what plugins subclass beside the roles
OTHERS = (Stage, Design, Task)


def classes() -> dict[str, type]:
    """Everything that plugins subclass: the abstract classes of the roles, and ``OTHERS``, by name."""
    roles = registry.Registry(()).roles
    return {cls.__name__: cls for cls in (*map(registry.current().role, roles), *OTHERS)}


def methods(cls: type) -> list[str]:
    """The methods and properties that a subclass may override, as chemage declares them."""
    found = {}
    for base in reversed(cls.__mro__):
        if base.__module__.startswith("chemage."):
            found |= vars(base)
    return sorted(
        name
        for name, member in found.items()
        if (inspect.isfunction(member) or isinstance(member, property | classmethod))
        and not name.startswith("__")
        and not re.match("_title|_with_kind|_no_booleans|model_", name)
    )


def subclass(cls: type, method: str, body) -> object:
    """An object of a subclass of a third party, whose ``method`` has this body; the others that must be there do."""
    declared = inspect.getattr_static(cls, method)
    namespace: dict = {"__module__": "chemage_faulty", "kind": "faulty", "role": getattr(cls, "role", "")}
    if not issubclass(cls, ca.plugin.Component):
        namespace = {"__module__": "chemage_faulty"}
    body.__module__, body.__name__ = "chemage_faulty", method
    for name in {*getattr(cls, "__abstractmethods__", ()), method}:
        namespace[name] = body
    if isinstance(declared, property | classmethod):
        namespace[method] = type(declared)(body)
    made = type("Faulty", (cls,), namespace)
    if cls is Stage:
        return made("creep")
    return object.__new__(made) if cls in OTHERS else made()


def call(thing, method):
    found = getattr(thing, method)
    if isinstance(inspect.getattr_static(thing, method), property):
        return found
    return [*found()] if inspect.isgeneratorfunction(inspect.unwrap(found)) else found()


def returns(cls: type, method: str) -> str:
    """What chemage declares that a method returns; "" where that may be None, or anything."""
    declared = inspect.getattr_static(cls, method)
    annotations = getattr(getattr(declared, "__func__", declared), "__annotations__", {})
    said = annotations.get("return", "Any")
    return "" if "None" in said or said in ("Any", "object") else said


def test_there_are_methods_of_every_role():
    found = {name: methods(cls) for name, cls in classes().items()}
    assert len(found) == len(registry.Registry(()).roles) + len(OTHERS) > 11
    assert sum(map(len, found.values())) > 150
    for name, method in (("Engine", "_run"), ("Reader", "claims"), ("Stage", "doubts"), ("Observable", "states")):
        assert method in found[name] or method == "states"
    assert returns(classes()["Engine"], "_run") == "BondHistory"
    assert returns(classes()["SurfaceMaker"], "scatter") == ""


@pytest.fixture
def faulty(site):
    """A plugin with this name is installed, of which the classes of these tests seem to be."""
    hook = "import chemage\n\n@chemage.plugin.hookimpl\ndef chemage_register():\n    return {}\n"
    site.install("chemage-faulty", {"chemage_faulty.py": hook}, {"faulty": "chemage_faulty"}, version="1.2")
    with registry.using(site.registry()):
        yield "of plugin 'faulty' (chemage-faulty 1.2): chemage_faulty."


@pytest.mark.parametrize("name", classes())
def test_what_a_method_raises_names_its_owner(faulty, name):
    def body(*arguments, **options):
        raise ZeroDivisionError("a bug")

    for method in methods(cls := classes()[name]):
        thing = subclass(cls, method, body)
        with pytest.raises(ZeroDivisionError, match=r"^a bug") as caught:
            call(thing, method)
        (note,) = caught.value.__notes__
        title = {"Stage": "stage 'creep'", "Design": "Faulty", "Task": "Faulty"}.get(name) or f"{thing.role} 'faulty'"
        assert note.startswith(f"in {title} {faulty}"), method
        assert re.search(rf"{re.escape(__file__)}:\d+$", note), method


@pytest.mark.parametrize("name", classes())
def test_a_method_that_returns_nothing_is_told(faulty, name):
    def body(*arguments, **options):
        return None

    for method in methods(cls := classes()[name]):
        thing, expected = subclass(cls, method, body), returns(cls, method)
        if not expected:
            assert call(thing, method) is None, method
            continue
        with pytest.raises(PluginError, match=rf"{method} returned None; expected an? {re.escape(expected)}") as caught:
            call(thing, method)
        assert faulty in caught.value.__notes__[0], method


# -- from end to end --------------------------------------------------------------------------------------------------

WRONG = """
import numpy as np
import typer
from chemage import plugin

class Tip(plugin.SurfaceMaker):
    kind = "wrong-surface"
    def make(self, seed=0):
        return [][1]  # surface

class Solver(plugin.ContactSolver):
    kind = "wrong-contact"
    def _solve(self, surface, load, start):
        return np.zeros(3)[7]  # contact

class Energies(plugin.Barriers):
    kind = "wrong-forming"
    def quantile(self, uniform):
        if uniform.size > 99:
            self._lost()
        return 0.8 + uniform
    def _lost(self):
        raise IndexError("lost")  # forming
    def density(self, energy):
        return np.ones(energy.shape)

class Engine(plugin.Engine):
    kind = "wrong-engine"
    def _run(self, lattice, hold_times, temperature, seed, start):
        return [][1]  # engine

class Law(plugin.Rupture):
    kind = "wrong-rupture"
    def force(self, bonded):
        return [][1]  # rupture

class Number(plugin.Observable):
    kind = "wrong-observe"
    def measure(self, contact, lattice, history):
        return {"n": [][1]}  # observe

class Method(plugin.AgeingMethod):
    kind = "wrong-ageing"
    def age(self, request):
        return [][1]  # ageing

class Planned(plugin.Engine):
    kind = "wrong-plan"
    def _run(self, lattice, hold_times, temperature, seed, start):
        raise NotImplementedError
    def expected(self, sites, interacting):
        return {"cpu_seconds": [][1]}  # plan

class Wrong(plugin.Reader):
    kind = "wrong-reader"
    suffixes = (".wrong",)
    def read(self, path):
        return [][1]  # reader

class Option(plugin.Engine):
    kind = "wrong-option"
    size: int = 3
    def model_post_init(self, context):
        return [][1]  # option
    def _run(self, lattice, hold_times, temperature, seed, start):
        raise NotImplementedError

@plugin.hookimpl
def chemage_register():
    roles = {"surface": "Tip", "contact": "Solver", "barriers": "Energies", "rupture": "Law", "observable": "Number"}
    roles |= {"ageing": "Method", "reader": "Wrong"}
    kinds = {"barriers": "wrong-forming", "observable": "wrong-observe"}
    offered = {role: {kinds.get(role, f"wrong-{role}"): f"chemage_wrong:{name}"} for role, name in roles.items()}
    engines = {"wrong-engine": "Engine", "wrong-plan": "Planned", "wrong-option": "Option"}
    return offered | {"engine": {kind: f"chemage_wrong:{name}" for kind, name in engines.items()}}

def break_(count: int = 1) -> None:
    \"\"\"Break.\"\"\"
    print([][count])  # command

@plugin.hookimpl
def chemage_cli():
    return [("break", break_)]
"""
HOOK = """
from chemage import plugin

@plugin.hookimpl
def {hook}():
    return [][1]  # hook
"""
SCENE = {
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 24, "pixel_size": "0.6 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "uniform", "lower": 0.7, "upper": 0.9},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 us", "stop": "1 s", "per_decade": 1, "replicas": 2},
    "fit": {"start": "1 us", "stop": "1 s"},
}
#: what is at fault -> changes of the scene, which component and method it is
PARTS = {
    "surface": ({"surface": {"kind": "wrong-surface"}}, "surface 'wrong-surface'", "Tip.make"),
    "contact": ({"contact": {"kind": "wrong-contact", "load": 9}}, "contact 'wrong-contact'", "Solver._solve"),
    "forming": ({"forming": {"kind": "wrong-forming"}}, "barriers 'wrong-forming'", "Energies.quantile"),
    "engine": ({"engine": {"kind": "wrong-engine"}}, "engine 'wrong-engine'", "Engine._run"),
    "rupture": ({"rupture": {"kind": "wrong-rupture"}}, "rupture 'wrong-rupture'", "Law.force"),
    "observe": ({"observe": [{"kind": "wrong-observe"}]}, "observable 'wrong-observe'", "Number.measure"),
    "ageing": ({"ageing": {"kind": "wrong-ageing"}}, "ageing 'wrong-ageing'", "Method.age"),
    "plan": ({"engine": {"kind": "wrong-plan"}}, "engine 'wrong-plan'", "Planned.expected"),
    "reader": ({"surface": {"kind": "from-file", "path": "map.wrong"}}, "reader 'wrong-reader'", "Wrong.read"),
    "option": ({"engine": {"kind": "wrong-option"}}, "engine 'wrong-option'", "Option"),
}


def line_of(source: str, mark: str) -> int:
    (number,) = (number for number, line in enumerate(source.splitlines(), 1) if line.endswith(f"# {mark}"))
    return number


@pytest.fixture
def wrong(site, tmp_path, monkeypatch):
    """Installs a package; gives what is said of a line of it."""
    monkeypatch.chdir(tmp_path)
    with registry.using(registry.Registry()):

        def install(source, mark, what, method):
            site.install("chemage-wrong", {"chemage_wrong.py": source}, {"wrong": "chemage_wrong"}, version="2.0")
            line = line_of(source, mark)
            where = f"chemage_wrong.{method}, {site.folder / 'chemage_wrong.py'}:{line}"
            return f"in {what} of plugin 'wrong' (chemage-wrong 2.0): {where}"

        yield install


def _toml(value) -> str:
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name} = {_toml(one)}' for name, one in value.items())}}}"
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, list) else json.dumps(value)


def run(command, *words, **sections):
    lines = [f"{name} = {_toml(value)}\n" for name, value in (SCENE | sections).items()]
    Path("scene.toml").write_text("".join(lines), encoding="utf-8")
    with registry.using(registry.Registry()):
        return command(*(words or ("run", "scene.toml", "--no-figures")))


def is_said(done, owner, error="IndexError"):
    assert done.status == 3, done
    assert "this is a fault of plugin 'wrong' (chemage-wrong 2.0), please report it" in done.err
    assert error in done.err
    assert owner in done.err
    assert "fault of chemage" not in done.err


@pytest.mark.parametrize("part", PARTS)
def test_a_run_says_whose_fault_it_is(wrong, command, part):
    changes, what, method = PARTS[part]
    owner = wrong(WRONG, part, what, method)
    Path("map.wrong").write_bytes(b"wrong")
    is_said(run(command, **changes), owner)


def test_so_does_a_command(wrong, command):
    owner = wrong(WRONG, "command", "the command 'break'", "break_")
    is_said(run(command, "break"), owner)


HOOKS = ["chemage_make_surface", "chemage_solve_contact", "chemage_build_lattice", "chemage_run_kinetics"]


@pytest.mark.parametrize("hook", [*HOOKS, "chemage_rupture_bonds", "chemage_observe"])
def test_so_does_a_hook(wrong, command, hook):
    owner = wrong(HOOK.format(hook=hook), "hook", f"the hook {hook}", hook)
    is_said(run(command), owner)


def test_so_does_a_stage(wrong, command):
    text = Path(chemage_creep.__file__).read_text("utf-8")
    source = text.replace("        if not rows:", "        rows = [][rows]  # stage\n        if not rows:")
    owner = wrong(source, "stage", "stage 'creep'", "CreepStage.run")
    is_said(run(command, creep={"time": "1 h"}), owner)


def test_so_does_a_design(wrong, command):
    text = Path(chemage_bisection.__file__).read_text("utf-8")
    source = text.replace('= outcome.summary["beta"]', '= outcome.summary["Beta"]  # design')
    owner = wrong(source, "design", "Bisection", "Bisection.tell")
    is_said(run(command, "bisect", "scene.toml", "--beta", "0.8"), owner, "KeyError: 'Beta'")


def test_what_was_wrong_with_the_input_says_where_it_was_found(wrong, command):
    source = WRONG.replace("return [][1]  # engine", "raise InputError('not on a Sunday')  # engine")
    source = source.replace("import typer", "from chemage import InputError")
    owner = wrong(source, "engine", "engine 'wrong-engine'", "Engine._run")
    done = run(command, engine={"kind": "wrong-engine"})
    assert done.status == 2
    assert f"not on a Sunday\n{owner}\n" in done.err


WRAPPER = """
from chemage import plugin

@plugin.hookimpl(wrapper=True)
def chemage_solve_contact():
    return (yield)
"""


def test_what_others_raise_through_a_wrapper_is_theirs(wrong, command, site):
    owner = wrong(WRONG, "contact", "contact 'wrong-contact'", "Solver._solve")
    site.install("chemage-idle", {"chemage_idle.py": WRAPPER}, {"idle": "chemage_idle"})
    done = run(command, contact={"kind": "wrong-contact", "load": 9})
    is_said(done, owner)
    assert "idle" not in done.err


def test_a_fault_of_chemage_is_called_one(wrong, command, monkeypatch):
    wrong(WRAPPER + "# idle", "idle", "", "")
    monkeypatch.setattr(ca.ContactSolution, "unloaded", lambda self: [][1])
    done = run(command)
    assert done.status == 3
    assert "this is a fault of chemage, please report it: IndexError" in done.err
    assert "wrong" not in done.err
