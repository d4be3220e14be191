"""Finding plugins: what one broken plugin may not do, who claims what, and what is said about it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import PluginError, UnknownKindError, registry

FINE = """
    import chemage

    @chemage.plugin.hookimpl
    def chemage_register():
        return {"barriers": {"level": "levels:Level"}}
"""

LEVELS = """
    import numpy as np
    from chemage.plugin import Barriers

    class Level(Barriers):
        "One barrier for all."
        kind = "level"

        def quantile(self, uniform):
            return np.ones(uniform.shape)

        def density(self, energy):
            return np.where(energy == 1, np.inf, 0.0)

    class Rough(Level):
        kind = "rough"

    class Half(Barriers):
        kind = "half"

    class NoBarriers:
        kind = "none"
"""


def offering(targets: str) -> str:
    return f"""
        import chemage

        @chemage.plugin.hookimpl
        def chemage_register():
            return {targets}
    """


def plugin(**functions) -> ModuleType:
    """A module with these functions as hooks."""
    module = ModuleType("by_hand")
    for name, function in functions.items():
        setattr(module, name, ca.plugin.hookimpl(function))
    return module


@pytest.fixture
def fine(site):
    """A plugin that works, to see that it goes on working beside a broken one."""
    site.install("fine", {"fine.py": FINE, "levels.py": LEVELS}, {"fine": "fine"})
    return site


# -- one broken plugin ------------------------------------------------------------------------------------------------

BROKEN = {
    "raises when imported": ("1 / 0", "ZeroDivisionError: division by zero"),
    "exits when imported": ("import sys; sys.exit('no licence')", "SystemExit: no licence"),
    "is not Python": ("def (", "SyntaxError"),
    "lacks a dependency": ("import no_such_package_xyz", "No module named 'no_such_package_xyz'"),
    "raises in chemage_register": (
        "import chemage\n@chemage.plugin.hookimpl\ndef chemage_register():\n    raise RuntimeError('too late')",
        "RuntimeError: too late",
    ),
    "offers nothing": (offering("None"), "chemage_register gave None; expected {role: {kind: 'module:Class'}}"),
    "offers a list": (offering("{'barriers': ['levels:Level']}"), "chemage_register: barriers: expected {name:"),
    "offers a class": (
        offering("{'barriers': {'x': int}}"),
        "'x': expected 'module:thing', got <class 'int'>",
    ),
    "offers no class": (offering("{'barriers': {'x': 'levels'}}"), "expected 'module:thing', got 'levels'"),
    "names an unknown role": (
        offering("{'barrier': {}}"),
        "names the role 'barrier'; the roles are surface, reader,",
    ),
    "is for another version": (
        "import chemage\nCHEMAGE_API = 2\n@chemage.plugin.hookimpl\ndef chemage_register():\n    return {}",
        "made for plugin interface 2, this chemage has 1",
    ),
    "misspells a hook": (
        "import chemage\n@chemage.plugin.hookimpl\ndef chemage_solve_contacts(solver):\n    pass",
        "implements chemage_solve_contacts, which is not a hook (did you mean 'chemage_solve_contact'?)",
    ),
    "misspells the prefix": (
        "import chemage\n@chemage.plugin.hookimpl\ndef chemge_observe(history):\n    pass",
        "implements chemge_observe, which is not a hook (did you mean 'chemage_observe'?)",
    ),
    "forgets hookimpl": ("def chemage_register():\n    return {}", "write @chemage.plugin.hookimpl above it"),
    "takes a wrong argument": (
        "import chemage\n@chemage.plugin.hookimpl\ndef chemage_solve_contact(solver, force):\n    pass",
        "Argument(s) {'force'} are declared in the hookimpl but can not be found in the hookspec",
    ),
    "has no hook at all": ("x = 1", "implements no hook"),
    "ships scenes without a file": (
        "import chemage\n@chemage.plugin.hookimpl\ndef chemage_scenes():\n    return {'x': 'broken'}",
        "chemage_scenes 'x': expected 'module:thing', got 'broken'",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_plugin_is_reported_and_skipped(fine, case):
    source, problem = BROKEN[case]
    fine.install("broken-plugin", {"broken.py": source}, {"broken": "broken"}, version="2.5")
    with pytest.warns(registry.PluginWarning, match=r"plugin 'broken' \(broken-plugin 2.5\) was skipped") as caught:
        found = fine.registry()
    assert problem in str(caught[0].message)
    (record,) = [one for one in found.records if one.error]
    assert problem in record.error
    assert (record.kinds, record.offered) == ({}, {})
    assert [one for one in found.check() if problem in one]
    # no hook of it is left behind, and the other plugin works
    for hook in vars(found.manager.hook).values():
        assert all("broken" not in impl.plugin_name for impl in getattr(hook, "get_hookimpls", list)())
    assert found.make("barriers", "level", {}).kind == "level"


@pytest.mark.parametrize("case", BROKEN)
def test_strict_raises_instead(fine, case, monkeypatch):
    source, problem = BROKEN[case]
    fine.install("broken-plugin", {"broken.py": source}, {"broken": "broken"})
    monkeypatch.setenv("CHEMAGE_STRICT", "1")
    with pytest.raises(PluginError) as caught:
        fine.registry()
    assert "plugin 'broken' (broken-plugin 1.0): " in str(caught.value)
    assert problem in str(caught.value)
    monkeypatch.setenv("CHEMAGE_STRICT", "0")
    with pytest.warns(registry.PluginWarning):
        fine.registry()


def test_a_module_that_is_missing_altogether(fine):
    fine.install("gone", {}, {"gone": "module_that_is_gone"})
    with pytest.warns(registry.PluginWarning, match="No module named 'module_that_is_gone'"):
        found = fine.registry()
    with pytest.raises(UnknownKindError, match=r"skipped because broken: gone"):
        found.component("barriers", "lever")


def test_one_module_under_two_names_registers_once(fine):
    fine.install("again", {}, {"again": "fine"})
    with pytest.warns(registry.PluginWarning, match="fine is registered twice"):
        found = fine.registry()
    assert len(found.offers("barriers", "level")) == 1
    assert found.make("barriers", "level", {}).kind == "level"


def test_a_hook_may_have_another_name(isolated_registry):
    module = ModuleType("renamed")
    module.offer = ca.plugin.hookimpl(specname="chemage_register")(lambda: {"barriers": {"x": "levels:Level"}})  # pyright: ignore
    isolated_registry.register(module, "renamed")
    assert isolated_registry.kinds("barriers") == ["x"]


def test_a_plugin_by_hand_raises_and_leaves_nothing(isolated_registry):
    wrong = plugin(chemage_register=lambda: {"barriers": {"x": "y:Z"}}, chemage_make_surface=lambda makers: None)
    with pytest.raises(PluginError, match=r"(?s)plugin 'mine': .*\{'makers'\} are declared"):
        isolated_registry.register(wrong, "mine")
    assert isolated_registry.records == []
    assert isolated_registry.kinds("barriers") == []


# -- targets ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "problem"),
    [
        ("no_such_module_xyz:Thing", "no_such_module_xyz:Thing cannot be imported: ModuleNotFoundError"),
        ("levels:Missing", "has no attribute 'Missing'"),
        ("levels:NoBarriers", "levels:NoBarriers is not a chemage.plugin.Barriers"),
        ("levels:np", "levels:np is not a chemage.plugin.Barriers"),
        ("levels:Rough", "the class calls itself 'rough'; set kind = 'new'"),
    ],
)
def test_a_target_that_is_not_there_is_found_by_check_and_by_use(fine, target, problem):
    fine.install("other", {"other.py": offering(f"{{'barriers': {{'new': {target!r}}}}}")}, {"other": "other"})
    found = fine.registry()  # discovery does not import it, so nothing is wrong yet
    (said,) = found.check()
    assert said.startswith("barriers 'new' of plugin 'other' (other 1.0): ")
    assert problem in said
    with pytest.raises(PluginError) as caught:
        found.component("barriers", "new")
    assert str(caught.value) == said
    assert found.component("barriers", "level").kind == "level"


def test_a_class_without_its_method_is_found(fine):
    fine.install("other", {"other.py": offering("{'barriers': {'half': 'levels:Half'}}")}, {"other": "other"})
    assert fine.registry().check() == [
        "barriers 'half' of plugin 'other' (other 1.0): levels:Half does not define density, quantile"
    ]


def test_a_scene_that_is_not_there_is_found(fine):
    source = "import chemage\n@chemage.plugin.hookimpl\ndef chemage_scenes():\n    return {'x': 'levels:x.toml'}"
    fine.install("scenes", {"scenes.py": source}, {"scenes": "scenes"})
    (said,) = fine.registry().check()
    assert said.startswith("scene 'x' of plugin 'scenes': levels:x.toml: ")


SIGNATURES = {
    "lacks an argument": (
        "def quantile(self):",
        "Level.quantile(self) cannot be called as quantile(uniform): too many",
    ),
    "needs one more": (
        "def quantile(self, uniform, scale):",
        "Level.quantile(self, uniform, scale) cannot be called as quantile(uniform): missing a required argument",
    ),
    "names it otherwise": ("def quantile(self, u, /, *more):", ""),
    "has one more with a default": ("def quantile(self, uniform, scale=1.0):", ""),
}


@pytest.mark.parametrize("case", SIGNATURES)
def test_a_method_that_chemage_cannot_call_is_found(site, case):
    signature, problem = SIGNATURES[case]
    levels = LEVELS.replace("def quantile(self, uniform):", signature).replace("np.ones(uniform.shape)", "None")
    site.install("fine", {"fine.py": FINE, "levels.py": levels}, {"fine": "fine"})
    found = site.registry()
    if not problem:
        assert found.check() == []
        return
    (said,) = found.check()
    assert said.startswith("barriers 'level' of plugin 'fine' (fine 1.0): ")
    assert problem in said
    with pytest.raises(PluginError) as caught:
        found.make("barriers", "level", {})
    assert str(caught.value) == said


READERS = """
    from chemage.plugin import Reader

    class Odd(Reader):
        "Reads nothing."
        kind = "odd"
        suffixes = (".odd",)
        %s

        def read(self, path):
            return None
"""
ODD = {
    "claims on an object": (
        "def claims(self, head, path): return None",
        "reader 'odd' of plugin 'odd' (odd 1.0): claims is called on the class; write @classmethod above it",
    ),
    "claims too little": (
        "claims = classmethod(lambda cls, head: None)",
        "cannot be called as claims(head, path)",
    ),
    "claims and fails": (
        "claims = classmethod(lambda cls, head, path: 1 / 0)",
        "reader 'odd' (odd 1.0) is left out: ZeroDivisionError",
    ),
    "marks that are no bytes": ("marks = ('ODD',)", "reader 'odd' (odd 1.0) is left out: TypeError"),
    "endings that are no texts": ("suffixes = 3", "reader 'odd' (odd 1.0) is left out: TypeError"),
}


@pytest.mark.parametrize("case", ODD)
def test_a_reader_that_cannot_be_asked_keeps_no_other_from_reading(site, tmp_path, case):
    line, problem = ODD[case]
    source = offering("{'reader': {'odd': 'odds:Odd'}}")
    site.install("odd", {"odd.py": source, "odds.py": READERS % line}, {"odd": "odd"})
    file = tmp_path / "heights.npy"
    np.save(file, np.eye(4))
    with registry.using(registry.Registry()) as found:
        with pytest.warns(registry.PluginWarning) as caught:
            reader = ca.plugin.reader_for(file)
        assert reader.kind == "npy"
        assert problem in str(caught[0].message)
        refused = [said for said in found.check() if "'odd'" in said]
        assert bool(refused) == case.startswith(("claims on", "claims too"))
        assert all(problem in said for said in refused)


@pytest.mark.filterwarnings("default::chemage.plugins.registry.PluginWarning")
def test_a_contact_that_cannot_be_used_keeps_no_material_from_being_checked(site, command):
    site.install("odd", {"odd.py": offering("{'contact': {'odd': 'odds:Odd'}}"), "odds.py": "1 / 0"}, {"odd": "odd"})
    with registry.using(registry.Registry()):
        told = command("plugins", "check")
    assert told.status == 1
    assert "1 problems" in told.out


#: how a plugin brings wear -> what is said of it
WEAR = {
    "the name of the distribution": (("chemage-wear", "tribo", ""), "see plugin 'tribo' (chemage-wear 1.0)"),
    "a kind": (("grit", "grit", ""), "see barriers 'wear-level' of plugin 'grit' (grit 1.0)"),
    "an option": (("grit", "grit", "wear_rate: float = 1.0"), "see the option 'wear_rate' of barriers"),
}


@pytest.mark.parametrize("case", WEAR)
def test_nothing_that_a_plugin_models_is_said_not_to_be_modelled(site, case):
    (distribution, name, line), said = WEAR[case]
    kind = "wear-level" if case == "a kind" else "level"
    levels = LEVELS.replace('kind = "level"', f'kind = "{kind}"\n        {line}')
    files = {"grit.py": FINE.replace('"level"', f'"{kind}"'), "levels.py": levels}
    with registry.using(registry.Registry()), pytest.raises(InputError, match="wear is not modelled"):
        ca.contact("hertz", modulus=35.3, wear=0.1)
    site.install(distribution, files, {name: "grit"})
    with registry.using(registry.Registry()):
        with pytest.raises(InputError) as caught:
            ca.contact("hertz", modulus=35.3, wear=0.1)
        assert said in str(caught.value)
        assert "not modelled" not in str(caught.value)
        with pytest.raises(InputError, match="viscoelasticity is not modelled"):
            ca.contact("viscoelastic")


def test_a_section_of_a_plugin_is_explained_by_its_name(site, command):
    source = """
        import chemage

        class Wear(chemage.plugin.Component):
            "What a slip takes away."
            role = "wear"

        ROLES = {"wear": "grit:Wear"}
        STAGES = (chemage.plugin.Stage("wear", role="wear"),)
    """
    site.install("grit", {"grit.py": source}, {"grit": "grit"})
    with registry.using(registry.Registry()):
        told = command("plugins", "show", "wear")
        assert told.status == 0, told.err
        assert "plugin grit" in told.out
        with pytest.raises(InputError, match=r"see \[wear\] of plugin 'grit' .grit 1.0."):
            ca.contact("hertz", modulus=35.3, wears=0.1)


def test_a_module_that_is_slow_to_import_is_reported(fine):
    fine.install(
        "slow-plugin",
        {"slow.py": "import time\ntime.sleep(0.6)\n" + dedent(FINE).replace("level", "x")},
        {"slow": "slow"},
    )
    found = fine.registry()
    (said,) = [note for note in found.notes() if "'slow'" in note]
    assert said.startswith("plugin 'slow' (slow-plugin 1.0): its module slow takes 0.")
    assert "import, which every command waits for" in said


def test_two_plugins_of_one_name_are_both_named(fine):
    fine.install("other-dist", {"other.py": FINE.replace('"level"', '"other"')}, {"fine": "other"})
    assert "the name 'fine' is claimed by 'fine' (fine 1.0) and by 'fine' (other-dist 1.0); uninstall one of them" in (
        fine.registry().check()
    )


# -- who claims what --------------------------------------------------------------------------------------------------


def test_two_plugins_of_one_name_with_one_kind_are_both_named(fine):
    fine.install("rival-barriers", {"rival.py": offering("{'barriers': {'level': 'levels:Rough'}}")}, {"fine": "rival"})
    found = fine.registry()
    for kind in ("level", "fine:level"):
        with pytest.raises(PluginError) as caught:
            found.component("barriers", kind)
        said = f"barriers {kind!r} is claimed by 'fine' (fine 1.0) and by 'fine' (rival-barriers 1.0)"
        assert str(caught.value) == f"{said}; uninstall one of them"
    assert f"{said}; uninstall one of them" in found.clashes()


def test_one_name_in_two_roles_is_no_clash(fine):
    fine.install("rival", {"rival.py": offering("{'reader': {'level': 'levels:Rough'}}")}, {"r": "rival"})
    found = fine.registry()
    assert found.clashes() == []
    assert found.component("barriers", "level").kind == "level"


def test_two_plugins_that_ship_one_scene_are_both_named(fine):
    for name in ("one", "two"):
        source = "import chemage\n@chemage.plugin.hookimpl\ndef chemage_scenes():\n    return {'x': 'levels:x.toml'}"
        fine.install(f"{name}-dist", {f"{name}.py": source}, {name: name})
    with pytest.raises(PluginError, match=r"'x' is claimed by 'one' \(one-dist 1.0\) and by 'two' \(two-dist 1.0\)"):
        fine.registry().target("scenes", "x")


def test_an_unknown_kind_lists_what_is_installed_and_suggests_the_nearest():
    with pytest.raises(UnknownKindError) as caught:
        ca.engine("rejectionfree")
    said = str(caught.value)
    assert said.startswith("no engine 'rejectionfree' (did you mean 'rejection-free'?); installed: ")
    for kind in registry.current().kinds("engine"):
        assert kind in said


def test_a_word_that_is_near_nothing_gets_no_suggestion(isolated_registry):
    with pytest.raises(UnknownKindError, match=r"^no barriers 'qqq'; installed: none$"):
        ca.barriers("qqq")


def test_an_unknown_role():
    with pytest.raises(InputError, match=r"no such role 'solver'; the roles are surface, reader, contact, barriers"):
        registry.current().component("solver", "hertz")


def test_fromdict_needs_the_kind():
    with pytest.raises(InputError, match=r"barriers: kind is required; installed: .*gaussian"):
        ca.plugin.fromdict("barriers", {"mean": 1.0})


# -- order, use, threads ----------------------------------------------------------------------------------------------


def test_the_order_of_plugins_is_their_names_not_the_file_systems(fine):
    for name in ("zebra", "apple", "mango"):
        fine.install(name, {f"{name}.py": FINE.replace("level", name)}, {name: name})
    assert [record.name for record in fine.registry().records] == ["apple", "fine", "mango", "zebra"]


def test_chemages_own_plugins_come_first(site):
    site.install("aaa", {"aaa.py": FINE.replace("level", "aaa")}, {"aaa": "aaa"})
    records = registry.Registry().records
    assert records[-1].name == "aaa"
    assert {record.distribution for record in records[:-1]} == {"chemage"}


def test_using_gives_the_registry_back(isolated_registry):
    other = registry.Registry([])

    def fail():
        with registry.using(other):
            assert registry.current() is other
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert registry.current() is isolated_registry


def test_threads_that_come_first_share_one_registry(monkeypatch):
    monkeypatch.setattr(registry, "_current", None)
    gate, seen = threading.Barrier(4), []

    def ask():
        gate.wait()
        seen.append(registry.current())

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({id(one) for one in seen}) == 1


def test_trace_prints_every_hook_call(monkeypatch, capsys):
    monkeypatch.setenv("CHEMAGE_TRACE", "1")
    maker = ca.surface("sphere", radius=10, pixels=4, pixel_size=1)
    with registry.using(registry.Registry([])):
        ca.make_surface(maker)
    assert "chemage hook chemage_make_surface(maker, seed) -> ['chemage.surfaces']" in capsys.readouterr().err
    monkeypatch.setenv("CHEMAGE_TRACE", "0")
    with registry.using(registry.Registry([])):
        ca.make_surface(maker)
    assert capsys.readouterr().err == ""


# -- what is imported when --------------------------------------------------------------------------------------------


def modules_after(code: str) -> set[str]:
    """The top-level modules in ``sys.modules`` after ``code`` in a fresh interpreter."""
    code += "\nimport sys\nprint(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_import_chemage_imports_neither_numpy_nor_pydantic():
    loaded = modules_after("import chemage")
    assert "chemage" in loaded
    assert not loaded & {"numpy", "pydantic", "pluggy", "ase", "scipy", "numba", "matplotlib", "pint", "h5py", "typer"}


def test_discovery_imports_nothing_heavy():
    loaded = modules_after("from chemage.plugin import registry\nassert registry.current().kinds('engine')")
    assert "chemage_kinetics" in loaded
    assert not loaded & {"numba", "scipy", "matplotlib", "h5py", "pint", "typer", "rich"}


def test_a_kind_is_imported_when_it_is_asked_for():
    code = "from chemage.plugin import registry\nregistry.current().component('surface', 'sphere')"
    assert "numba" not in modules_after(code)


@pytest.fixture
def lying(tmp_path):
    """A folder in which a plugin lies that is not installed."""
    (tmp_path / "stray.egg-info").mkdir()
    (tmp_path / "stray.egg-info" / "PKG-INFO").write_text("Metadata-Version: 2.1\nName: stray\nVersion: 1.0\n")
    (tmp_path / "stray.egg-info" / "entry_points.txt").write_text("[chemage]\nstray = stray\n")
    (tmp_path / "stray.py").write_text("raise SystemExit('loaded')\n")
    (tmp_path / "script.py").write_text("from chemage.cli import main\nmain()\n")
    return tmp_path


@pytest.mark.parametrize(
    ("words", "path", "there"),
    [
        (["-c", "from chemage.cli import main; main()"], None, False),
        (["-m", "chemage"], None, False),
        (["-m", "chemage"], ".", True),
        (["script.py"], None, False),
        ([str(Path(sys.executable).parent / "chemage")], os.pathsep, False),
    ],
    ids=["-c", "-m", "named in PYTHONPATH", "script", "empty entry of PYTHONPATH"],
)
def test_a_plugin_that_merely_lies_in_the_folder_takes_no_part(lying, monkeypatch, words, path, there):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    if path is not None:
        monkeypatch.setenv("PYTHONPATH", path)
    command = [sys.executable, *words, "plugins", "list", "--json"]
    done = subprocess.run(command, cwd=lying, capture_output=True, text=True, check=True)
    assert ("'stray' (stray 1.0) was skipped: SystemExit: loaded" in done.stderr) == there
    assert ("stray" in done.stdout) == there


def test_what_lies_beside_a_script_is_not_loaded_and_what_is_installed_with_chemage_is(
    lying, tmp_path_factory, monkeypatch
):
    found = {point.name for point in registry.installed(registry.GROUP)}
    own = next(iter(registry.metadata.distributions(name="chemage")))
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    monkeypatch.setattr(sys.modules["__main__"], "__file__", str(lying / "script.py"), raising=False)
    monkeypatch.setattr(sys, "path", [str(lying), *sys.path])
    assert {point.name for point in registry.installed(registry.GROUP)} == found
    # as by pip install --target
    (lying / "chemage-1.dist-info").mkdir()
    for name in ("METADATA", "entry_points.txt"):
        (lying / "chemage-1.dist-info" / name).write_text(own.read_text(name))
    monkeypatch.setattr(sys, "path", [str(lying)])
    assert "stray" in {point.name for point in registry.installed(registry.GROUP)}
