"""Every hook is documented, and does what its page says: the examples of docs/plugins.md are the plugins under test."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from internals import figures_of

import chemage as ca
from chemage import InputError
from chemage.plugin import Engine, PluginError, registry

PAGE = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text(encoding="utf-8")
#: hook -> its specification
HOOKS = {
    name: function
    for room in registry.ROOMS
    for name, function in vars(importlib.import_module(room)).items()
    if name.startswith("chemage_")
}


def section(hook: str) -> str:
    found = re.search(rf"^### {hook}$(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None, f"docs/plugins.md has no section {hook}"
    return found[1]


def example(hook: str) -> str:
    (code,) = re.findall(r"```python\n(.*?)```", section(hook), re.DOTALL)
    return code


def as_plugin(source: str, name: str = "example") -> ModuleType:
    module = ModuleType(name)
    exec(compile(source, f"{name}.py", "exec"), module.__dict__)
    return module


@pytest.fixture
def installed():
    """A copy of the registry with chemage's own plugins, in use, to which a test may add."""
    with registry.using(registry.Registry()) as copy:
        yield copy


# -- documented -------------------------------------------------------------------------------------------------------


def test_the_page_has_the_hooks_and_no_others():
    assert sorted(re.findall(r"^### (chemage_\w+)$", PAGE, re.MULTILINE)) == sorted(HOOKS)


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_is_documented(hook):
    spec = HOOKS[hook]
    assert len(inspect.getdoc(spec) or "") > 40
    names = ", ".join(inspect.signature(spec).parameters)
    assert f"`{hook}({names})`" in section(hook)
    assert "Returns " in section(hook)
    assert f"def {hook}(" in example(hook)


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_is_tested_here(hook):
    assert f'example("{hook}")' in Path(__file__).read_text(encoding="utf-8")


# -- each at work -----------------------------------------------------------------------------------------------------


def pressed(load: float = 50.0) -> ca.ContactSolution:
    surface = ca.make_surface(ca.surface("sphere", radius="30 nm", pixels=32, pixel_size="0.45 nm"))
    return ca.solve_contact(ca.contact("hertz", modulus="35.3 GPa"), surface, load)


def silica() -> ca.Chemistry:
    return ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper=0.9), activation_volume="6.4 angstrom**3")


def test_register(installed, site):
    files = {
        "chemage_weibull/__init__.py": example("chemage_register"),
        "chemage_weibull/weibull.py": """
            from chemage.plugin import Barriers

            class Weibull(Barriers):
                kind = "weibull"

                def quantile(self, uniform):
                    return uniform

                def density(self, energy):
                    return energy
        """,
    }
    site.install("chemage-weibull", files, {"weibull": "chemage_weibull"})
    with registry.using(registry.Registry()):
        assert type(ca.barriers("weibull")).__name__ == "Weibull"
        assert ca.plugin.fromdict("barriers", {"kind": "weibull"}) == ca.barriers("weibull")


def test_make_surface(installed):
    maker = ca.surface("sphere", radius=30, pixels=16, pixel_size=0.5)
    plain = ca.make_surface(maker)
    installed.register(as_plugin(example("chemage_make_surface")), "level")
    changed = ca.make_surface(maker)
    assert abs(changed.heights.mean()) < 1e-15 < abs(plain.heights.mean())
    assert np.allclose(changed.heights - plain.heights, -plain.heights.mean())
    # the maker's own method is the maker and nothing else
    assert maker.make() == plain


def test_solve_contact(installed):
    plain = pressed()
    assert plain.pressure.max() > 2
    plugin = as_plugin(example("chemage_solve_contact"))
    installed.register(plugin, "hardness")
    capped = pressed()
    assert capped.pressure.max() == 2
    assert np.array_equal(capped.pressure, np.minimum(plain.pressure, 2))
    assert capped.max_pressure >= capped.mean_contact_pressure
    assert capped.carried < capped.load == 50
    assert capped.approximate == [
        {"kind": "hertz", "carries": f"{capped.carried:.4g} of 50 nN: the pressure is capped at 2.0 GPa"}
    ]
    # too light to reach the hardness: the very solution
    assert pressed(0.1).carries == ""


def test_solve_contact_can_be_replaced(installed):
    flat = """
        import chemage

        @chemage.plugin.hookimpl
        def chemage_solve_contact(solver, surface, load):
            if load != 7:
                return None
            shape, area = surface.shape, surface.nominal_area
            return chemage.ContactSolution(
                pressure=[[load / area] * shape[1]] * shape[0], load=load, pixel_size=surface.pixel_size, modulus=1.0,
                periodic=surface.periodic,
            )
    """
    installed.register(as_plugin(inspect.cleandoc(flat)), "flat")
    assert pressed(7.0).area_fraction == 1
    assert 0 < pressed(8.0).area_fraction < 1


def test_build_lattice(installed):
    contact = pressed()
    plain = ca.plugin.build_lattice(silica(), contact, 3)
    installed.register(as_plugin(example("chemage_build_lattice")), "wet")
    wet = ca.plugin.build_lattice(silica(), contact, 3)
    share = np.mean(wet.forming == 5.0)
    assert 0.02 < share < 0.2
    assert np.array_equal(wet.forming[wet.forming < 5], plain.forming[wet.forming < 5])
    # a pixel stays wet when the load changes
    more = ca.plugin.build_lattice(silica(), pressed(80.0), 3)
    both, at, there = np.intersect1d(wet.sites, more.sites, return_indices=True)
    assert both.size > 50
    assert np.array_equal(wet.forming[at] == 5, more.forming[there] == 5)
    # and ageing goes through the hook as well: wet sites never bond
    end = ca.age(contact, silica(), engine=ca.engine("rejection-free"), hold_times=[1e5], temperature=300, replicas=4)
    assert 0 < (end.sites[:, None] - end.bonds).mean() < 0.2 * end.sites.mean()


def test_run_kinetics(installed):
    plugin = as_plugin(example("chemage_run_kinetics"))
    installed.register(plugin, "timer")
    ageing = ca.age(
        pressed(),
        silica(),
        engine=ca.engine("rejection-free"),
        hold_times=[1, 10],
        temperature=300,
        replicas=3,
        threads=2,
    )
    assert len(plugin.TIMES) == 3  # once a replica, never per event
    assert sorted(events for _, _, events, _ in plugin.TIMES) == sorted(ageing.events)
    assert {(kind, sites) for kind, sites, _, _ in plugin.TIMES} == {("rejection-free", ageing.sites[0])}


def test_rupture_bonds(installed):
    def aged(load):
        options = {"engine": ca.engine("rejection-free"), "hold_times": [1e-6, 1e5], "temperature": 300, "replicas": 2}
        return ca.age(pressed(load), silica(), **options)

    plain = aged(50.0)
    assert plain.rupture_force is None
    installed.register(as_plugin(example("chemage_rupture_bonds")), "substrate")
    weak = aged(50.0)
    limit = 1.0 * pressed().area
    assert plain.friction_drop[:, 0].max() < limit < plain.friction_drop[:, 1].min()
    assert np.array_equal(weak.friction_drop, np.minimum(plain.friction_drop, limit))
    assert weak.plugins == {"substrate": "example"}
    assert np.array_equal(weak.bonds, plain.bonds)


def test_pull_bonds(installed):
    lattice = ca.ReactionLattice(pixels=(9, 1), sites=range(9), forming=[0.9] * 9, breaking=[1.1] * 9)
    drive = ca.plugin.Drive(speed=1e3, bond_stiffness=10, transition_distance=0.05, partner="kept")

    def pulled():
        times, start = np.linspace(0, 1e-3, 11), np.ones(9, bool)
        return ca.plugin.pull(ca.pulling("event-driven"), lattice, drive, times, temperature=300, start=start)

    plain = pulled()
    installed.register(as_plugin(example("chemage_pull_bonds")), "rubbing")
    rubbed = pulled()
    assert np.allclose(rubbed.force, plain.force + 2.0)
    assert rubbed.rubbed[-1] == pytest.approx(2.0 * rubbed.displacement[-1])
    assert rubbed.plugins["rubbing"] == "example"


def test_observe(installed):
    installed.register(as_plugin(example("chemage_observe")), "pressure")
    contact, options = pressed(), {"temperature": 300, "replicas": 3}
    ageing = ca.age(contact, silica(), engine=ca.engine("rejection-free"), hold_times=[1e5], **options)
    seen = ageing.observables["pressure_where_bonded"]
    assert seen.shape == (3,)
    # everything has bonded, so it is the mean over the contact
    assert np.allclose(seen, contact.pressure[contact.contact].mean())
    none = ca.age(pressed(0), silica(), engine=ca.engine("rejection-free"), hold_times=[1], **options)
    assert np.isnan(none.observables["pressure_where_bonded"]).all()


def test_figures(installed, tmp_path):
    installed.register(as_plugin(example("chemage_figures")), "cut")
    sphere = {"kind": "sphere", "radius": "30 nm", "pixels": 32, "pixel_size": "0.45 nm"}
    contact = {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "50 nN"}
    run = ca.run({"surface": sphere, "contact": contact})
    axes = figures_of(run)["cut"].axes[0]
    row, cut = axes.lines
    assert run.surface is not None
    assert np.array_equal(row.get_ydata(), run.surface.heights[:, 16])
    assert max(row.get_ydata()) == cut.get_ydata()[0] == run.surface.heights.max()


def test_published(installed):
    run = ca.run(
        {
            "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 32, "pixel_size": "0.9 nm"},
            "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
            "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
            "engine": {"kind": "independent"},
            "hold": {"start": "1 ms", "stop": "1e4 s", "replicas": 2},
        }
    )

    def published(of):
        lines = [line for figure in figures_of(of).values() for axes in figure.axes for line in axes.lines]
        return [line for line in lines if str(line.get_label()).startswith("published")]

    assert published(run) == []
    installed.register(as_plugin(example("chemage_published")), "values")
    (line,) = published(run)
    assert line.get_label() == "published β = 0.8 (an example, not a measurement)"
    assert np.polyfit(np.log10(line.get_xdata()), line.get_ydata(), 1)[0] == pytest.approx(0.8)
    other = {**run.scene, "contact": {**run.scene["contact"], "load": 60.0}}
    assert published(dataclasses.replace(run, scene=other)) == []


def test_scenes(installed, site):
    scene = """
        [surface]
        kind = "sphere"
        radius = "30 nm"
        pixels = 32
        pixel_size = "0.45 nm"

        [contact]
        kind = "hertz"
        modulus = "100 GPa"
        load = "50 nN"
    """
    files = {"chemage_example/__init__.py": example("chemage_scenes"), "chemage_example/stiff-tip.toml": scene}
    site.install("chemage-example", files, {"example": "chemage_example"})
    with registry.using(registry.Registry()) as found:
        assert "stiff-tip" in found.scenes()
        assert not [problem for problem in found.check() if "stiff-tip" in problem]
        assert ca.load_scene("stiff-tip").load == 50.0


def test_materials(installed, site):
    material = """
        title = "Soda-lime glass"

        [contact.modulus]
        value = { young = "70 GPa", poisson = 0.22 }
        how = "measured"
        source = "a handbook"
    """
    files = {"chemage_example/__init__.py": example("chemage_materials"), "chemage_example/soda-lime.toml": material}
    site.install("chemage-example", files, {"example": "chemage_example"})
    with registry.using(registry.Registry()) as found:
        assert found.materials()["soda-lime"] == "chemage_example:soda-lime.toml"
        changes = {"material": "soda-lime", "contact.modulus": None}
        assert ca.load_scene("silica-tip", changes).contact.modulus == ca.contact_modulus("70 GPa", 0.22)


WEAR = """
from chemage.plugin import Doubles, Record

class Wear(Record):
    arrays = {"depth": (("cycle",), "nm", "depth of the track")}
    depth: Doubles

def worn(depth: float) -> Wear:
    return Wear(depth=[depth])
"""
SHOWN = """
from chemage.plugin import OfRecord, displays
from chemage_example.wear import Wear

@displays(Wear)
class WearTrack(OfRecord):
    def facts(self):
        return [("depth of the track", f"{self.record.depth[-1]:g} nm")]
"""


def run_with(site, code, *arguments):
    """A process of its own in which the packages of ``site`` are installed."""
    path = [str(site.folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)},
        capture_output=True,
        text=True,
    )


def test_results_and_names(installed, site, tmp_path, command):
    code = example("chemage_results") + example("chemage_names")
    files = {"__init__": code, "wear": WEAR, "display": SHOWN}
    files = {f"chemage_example/{name}.py": text for name, text in files.items()}
    site.install("chemage-example", files, {"example": "chemage_example"})
    file = tmp_path / "worn.h5"
    with registry.using(registry.Registry()) as found:
        assert not [problem for problem in found.check() if "wear" in problem]
        worn = ca.worn(3)
        ca.write(file, worn)
        assert ca.read(file) == worn
        assert "depth of the track 3 nm" in " ".join(command("show", file).out.split())
        with pytest.raises(InputError, match="depth"):
            ca.worn("deep")
    with pytest.raises(AttributeError, match="no attribute 'worn'"):
        ca.worn  # noqa: B018
    with pytest.raises(ca.plugin.StoreError, match="holds nothing"):
        ca.read(file)


def test_a_plugin_that_asks_for_names_of_others_while_it_is_found_is_skipped(site):
    site.install("eager", {"eager.py": "from chemage import infer"}, {"eager": "eager"})
    done = run_with(site, "import chemage; print(chemage.infer.__name__)")
    assert done.stdout == "infer\n"
    assert "cannot import name 'infer'" in done.stderr


def test_cli(site):
    site.install("chemage-example", {"radius.py": example("chemage_cli")}, {"radius": "radius"})

    def run(*arguments):
        return run_with(site, "from chemage.cli.app import main; main()", *arguments)

    done = run("hertz-radius", "50", "30")
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx((0.75 * 50 * 30 / 35.3) ** (1 / 3))
    assert "Contact radius (nm) of a sphere" in run("hertz-radius", "--help").stdout


# -- wrong answers ----------------------------------------------------------------------------------------------------

ANSWERS = {
    "chemage_make_surface": lambda: ca.make_surface(ca.surface("sphere", radius=9, pixels=4, pixel_size=1)),
    "chemage_solve_contact": lambda: pressed(),
    "chemage_build_lattice": lambda: ca.plugin.build_lattice(silica(), pressed()),
    "chemage_run_kinetics": lambda: ca.age(
        pressed(), silica(), engine=ca.engine("rejection-free"), hold_times=[1], temperature=300, replicas=2
    ),
    "chemage_rupture_bonds": lambda: ca.age(
        pressed(), silica(), engine=ca.engine("rejection-free"), hold_times=[1], temperature=300, replicas=2
    ),
}


@pytest.mark.parametrize("hook", ANSWERS)
def test_an_answer_of_the_wrong_type_names_the_hook(installed, hook):
    installed.register(
        as_plugin(f"import chemage\n@chemage.plugin.hookimpl\ndef {hook}():\n    return 'something'"), "wrong"
    )
    with pytest.raises(PluginError, match=rf"plugin 'wrong' \(example\) answered {hook} with str; expected "):
        ANSWERS[hook]()


@pytest.mark.parametrize("hook", ANSWERS)
def test_an_error_in_a_hook_stops_the_run_and_is_not_hidden(installed, hook):
    source = f"""
        import chemage
        from chemage import InputError

        @chemage.plugin.hookimpl
        def {hook}():
            raise InputError("not on a Sunday")
    """
    installed.register(as_plugin(inspect.cleandoc(source)), "sunday")
    with pytest.raises(InputError, match="not on a Sunday"):
        ANSWERS[hook]()


@pytest.mark.parametrize("hook", ANSWERS)
def test_none_leaves_it_to_the_next(installed, hook):
    plain = ANSWERS[hook]()
    installed.register(as_plugin(f"import chemage\n@chemage.plugin.hookimpl\ndef {hook}():\n    return None"), "shy")
    assert ANSWERS[hook]() == plain


def observing(name: str, value: str) -> ModuleType:
    return as_plugin(
        f"import chemage\n@chemage.plugin.hookimpl\ndef chemage_observe(history):\n    return {{{name}: {value}}}"
    )


def test_two_observables_of_one_name_clash(installed):
    installed.register(observing("'n'", "1"), "one")
    installed.register(observing("'n'", "2"), "two")
    with pytest.raises(PluginError, match="two observables give 'n'; rename one"):
        ANSWERS["chemage_run_kinetics"]()


@pytest.mark.parametrize(("name", "value"), [("f'n{history.bonds[0]}'", "1"), ("'n'", "[0.0] * int(history.bonds[0])")])
def test_an_observable_that_differs_between_replicas_is_named(installed, name, value):
    installed.register(observing(name, value), "fickle")
    with pytest.raises(PluginError, match="observables differ between replicas"):
        ANSWERS["chemage_run_kinetics"]()


def test_arrow_hooks_receive_plain_validated_values(installed):
    """Strings with units have become numbers, and times an array, before any plugin sees them."""
    seen = {}
    source = """
        import chemage

        @chemage.plugin.hookimpl
        def chemage_solve_contact(load):
            SEEN["load"] = load

        @chemage.plugin.hookimpl
        def chemage_run_kinetics(engine, hold_times, temperature, seed):
            SEEN.update(hold_times=hold_times, temperature=temperature, seed=seed, engine=engine)
    """
    module = ModuleType("spy")
    module.__dict__["SEEN"] = seen
    exec(inspect.cleandoc(source), module.__dict__)
    installed.register(module, "spy")
    surface = ca.surface("sphere", radius=30, pixels=32, pixel_size=0.45).make()
    contact = ca.solve_contact(ca.contact("hertz", modulus=35.3), surface, "0.05 uN")
    engine = ca.engine("rejection-free")
    ca.age(contact, silica(), engine=engine, hold_times=[1], temperature="26.85 degC", replicas=1)
    assert seen["load"] == 50.0
    assert seen["temperature"] == 300.0
    assert isinstance(seen["hold_times"], np.ndarray)
    assert isinstance(seen["seed"], np.random.SeedSequence)
    assert isinstance(seen["engine"], Engine)
