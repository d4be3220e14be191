"""Options of plugins, set in ``[plugins.NAME]``: checked, seen by every thread and process, part of what they touch."""

from __future__ import annotations

import json
import threading
import warnings

import jsonschema
import numpy as np
import pytest

import chemage
from chemage import InputError, parse_scene
from chemage.plugin import SceneError, registry

CAP = '''
"""Caps the pressure."""

import chemage

CHEMAGE_OPTIONS = "cap_options:Options"


@chemage.plugin.hookimpl(wrapper=True)
def chemage_solve_contact():
    import numpy as np
    from cap_options import Options

    found = yield
    peak = Options.current().peak
    if found.max_pressure <= peak:
        return found
    return found.model_copy(update={"pressure": np.minimum(found.pressure, peak), "carries": "capped"})
'''
CAP_OPTIONS = '''
from typing import ClassVar
from chemage.plugin import PluginOptions, Pressure

class Options(PluginOptions):
    """Of the cap."""

    speed_only: ClassVar = ("blocks",)
    peak: Pressure = 0.3
    """hardness"""
    blocks: int = 4
    """changes only the speed"""
'''
SEEN = """
import threading
import chemage

CHEMAGE_OPTIONS = "seen_options:Options"

@chemage.plugin.hookimpl(wrapper=True)
def chemage_run_kinetics():
    from seen_options import Options

    found = yield
    return found.model_copy(update={"notes": (*found.notes, f"level {Options.current().level}")})
"""
SEEN_OPTIONS = """
from chemage.plugin import PluginOptions

class Options(PluginOptions):
    level: int = 1
    \"\"\"a number\"\"\"
"""


@pytest.fixture
def both(tiny, site):
    """Two plugins with options, beside the one of a whole experiment."""
    site.install("chemage-cap", {"chemage_cap.py": CAP, "cap_options.py": CAP_OPTIONS}, {"cap": "chemage_cap"})
    site.install("chemage-seen", {"chemage_seen.py": SEEN, "seen_options.py": SEEN_OPTIONS}, {"seen": "chemage_seen"})
    with registry.using(site.registry()):
        yield tiny


def run(tiny, plugins=None, **sections):
    return chemage.run(parse_scene(tiny.scene(**sections, **({"plugins": plugins} if plugins is not None else {}))))


# -- in use -----------------------------------------------------------------------------------------------------------


def test_a_scene_sets_options_which_hooks_read_and_the_result_names(both):
    plain = run(both)
    assert plain.contact.pressure.max() == 0.3
    assert plain.plugins["cap"] == "chemage-cap 1.0 [peak = 0.3 GPa]"
    capped = run(both, {"cap": {"peak": "200 MPa", "blocks": 2}})
    assert capped.contact.pressure.max() == 0.2
    assert capped.plugins["cap"] == "chemage-cap 1.0 [peak = 0.2 GPa]"
    assert capped.contact.plugins["cap"] == "chemage-cap 1.0 [peak = 0.2 GPa]"
    assert capped.versions["chemage-cap"] == "1.0"
    assert capped.keys["surface"] == plain.keys["surface"]
    assert capped.keys["contact"] != plain.keys["contact"]
    assert capped.keys["ageing"] != plain.keys["ageing"]


def test_the_threads_of_replicas_see_them(both):
    found = chemage.run(parse_scene(both.scene(plugins={"seen": {"level": 7}})), threads=2)
    assert found.ageing.notes == ("tossed", "level 7")
    assert found.ageing.plugins["seen"] == "chemage-seen 1.0 [level = 7]"
    assert run(both).ageing.notes == ("tossed", "level 1")


def test_options_that_change_only_the_speed_or_belong_to_an_idle_plugin_change_nothing(both):
    plain = run(both)
    assert run(both, {"cap": {"blocks": 9}}).keys == plain.keys
    idle = run(both, {"cap": {"peak": 5.0}})  # above every pressure: the cap takes no part
    assert "cap" not in idle.plugins
    higher = run(both, {"cap": {"peak": 6.0}})
    assert higher.keys == idle.keys
    assert higher.contact == idle.contact
    assert higher.ageing == idle.ageing


def test_a_block_of_python_sets_them_too(both):
    scene = parse_scene(both.scene())
    surface = chemage.make_surface(scene.surface)

    def peak():
        return chemage.solve_contact(scene.contact, surface, scene.load).pressure.max()

    with chemage.plugin_options("cap", peak="200 MPa") as options:
        assert (options.peak, options.blocks) == (0.2, 4)
        assert peak() == 0.2
        with chemage.plugin_options("cap", blocks=2) as inner, chemage.plugin_options("seen", level=3):
            assert (inner.peak, inner.blocks) == (0.2, 2)
            assert peak() == 0.2
            assert chemage.run(scene).ageing.notes == ("tossed", "level 3")
        with chemage.plugin_options("cap", peak=0.1):
            assert peak() == 0.1
        assert peak() == 0.2
    assert peak() == 0.3


def test_a_run_in_a_block_says_so_in_its_scene_and_a_scene_comes_before_the_block(both):
    with chemage.plugin_options("cap", peak=0.2, blocks=2):
        inside, own = run(both), run(both, {"cap": {"peak": 0.25}})
    assert inside.contact.pressure.max() == 0.2
    assert inside.scene["plugins"] == {"cap": {"peak": 0.2, "blocks": 2}}
    assert chemage.run(parse_scene(inside.scene)).keys == inside.keys
    assert own.contact.pressure.max() == 0.25
    assert own.scene["plugins"] == {"cap": {"peak": 0.25, "blocks": 2}}


def test_two_threads_can_use_different_options(both):
    gate, found = threading.Barrier(2), {}

    def one(level):
        with chemage.plugin_options("seen", level=level):
            gate.wait()
            found[level] = run(both).ageing.notes[-1]
            gate.wait()

    threads = [threading.Thread(target=one, args=(level,)) for level in (5, 6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == {5: "level 5", 6: "level 6"}


# -- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plugins", "path", "problem"),
    [
        ({"cap": {"pek": 1}}, "plugins.cap.pek", "no such option (did you mean 'peak'?); the options are peak, blocks"),
        ({"cap": {"peak": "3 nm"}}, "plugins.cap.peak", "quantity of nanometer, but this field is in GPa"),
        ({"cap": {"peak": -1}}, "plugins.cap.peak", "greater than 0"),
        ({"cpa": {"peak": 1}}, "plugins.cpa", "no plugin 'cpa' (did you mean 'cap'?) is installed"),
        ({"tiny": {"peak": 1}}, "plugins.tiny", "plugin 'tiny' has no options; plugins with options: cap, seen"),
        ({"cap": 3}, "plugins.cap", "3 is not a section; write [plugins.cap] with options below it"),
        (3, "plugins", "3 is not a section"),
        ({"prefer": "cap"}, "plugins.prefer", "give a list of names of plugins"),
        ({"prefer": ["cpa"]}, "plugins.prefer", "names 'cpa', which is not installed (did you mean 'cap'?)"),
    ],
)
def test_a_scene_with_a_wrong_section_says_what_is_wrong(both, plugins, path, problem):
    with pytest.raises(SceneError) as caught:
        parse_scene(both.scene(plugins=plugins))
    ((where, message),) = caught.value.problems
    assert where == path
    assert problem in message


def test_a_block_with_a_wrong_option_says_what_is_wrong(both):
    with pytest.raises(InputError, match=r"options of plugin 'cap': peak: -1.0: .*greater than 0"):
        chemage.plugin_options("cap", peak=-1).__enter__()
    with pytest.raises(InputError, match=r"no plugin 'cpa' \(did you mean 'cap'\?\)"):
        chemage.plugin_options("cpa", peak=1).__enter__()


@pytest.mark.parametrize(
    ("target", "options", "problem"),
    [
        ("gone_options:Options", "", "gone_options:Options cannot be imported: ModuleNotFoundError"),
        ("bad_options:Other", "class Other: pass", "bad_options:Other is not a chemage.plugin.PluginOptions"),
        (
            "bad_options:Options",
            "from chemage.plugin import PluginOptions\nclass Options(PluginOptions):\n    a: int\n    b: int = 1\n",
            "a must have a default, for scenes that do not set it",
        ),
    ],
)
def test_wrong_options_of_a_plugin_are_found_by_check(site, target, options, problem):
    source = CAP.replace("cap_options:Options", target)
    site.install("chemage-bad", {"chemage_bad.py": source, "bad_options.py": options}, {"bad": "chemage_bad"})
    (said,) = site.registry().check()
    assert said.startswith("the options of plugin 'bad' (chemage-bad 1.0): ")
    assert problem in said


def test_a_target_that_is_none_is_a_broken_plugin(site):
    site.install("chemage-bad", {"chemage_bad.py": CAP.replace("cap_options:", "")}, {"bad": "chemage_bad"})
    with pytest.warns(registry.PluginWarning, match="CHEMAGE_OPTIONS '': expected 'module:thing', got 'Options'"):
        site.registry()


# -- sweeps and checkpoints -------------------------------------------------------------------------------------------


def computed(tiny, axes, folder, **options):
    tiny.forget()
    result = chemage.sweep(tiny.scene(sweep=axes), folder, **options)
    assert set(result.states()) == {"done"}
    return result, len(tiny.computed("surface")), len(tiny.computed("contact")), len(tiny.computed("kinetics"))


@pytest.mark.parametrize("executor", ["serial", pytest.param("processes", marks=pytest.mark.long)])
def test_a_sweep_over_an_option_computes_what_it_touches(both, tmp_path, executor, monkeypatch):
    monkeypatch.delenv("CHEMAGE_PLUGINS", raising=False)
    one = {"executor": executor, **({"workers": 1} if executor == "processes" else {})}
    axes = {"plugins.cap.peak": ["100 MPa", "200 MPa", 0.3]}
    result, surfaces, contacts, replicas = computed(both, axes, tmp_path / "caps", **one)
    assert (surfaces, contacts, replicas) == (1, 3, 6)
    assert [point.summary["max_pressure"] for point in result] == [0.1, 0.2, 0.3]
    assert [point.summary["plugins"]["cap"] for point in result][:2] == [
        "chemage-cap 1.0 [peak = 0.1 GPa]",
        "chemage-cap 1.0 [peak = 0.2 GPa]",
    ]
    axes = {"plugins.seen.level": [1, 2, 3]}
    result, surfaces, contacts, replicas = computed(both, axes, tmp_path / "levels", **one)
    assert (surfaces, contacts, replicas) == (1, 1, 6)
    assert [point.ageing().notes[-1] for point in result] == ["level 1", "level 2", "level 3"]
    # nothing is computed again
    assert computed(both, axes, tmp_path / "levels", **one)[1:] == (0, 0, 0)


def test_the_axis_of_an_option_has_its_unit_and_wrong_values_are_found_first(both, tmp_path):
    result = computed(both, {"plugins.cap.peak": ["100 MPa", "200 MPa"]}, tmp_path / "out")[0]
    assert "plugins.cap.peak (GPa)" in (tmp_path / "out" / "results.csv").read_text().splitlines()[0] or (
        json.loads((tmp_path / "out" / "sweep.json").read_text())["units"] == {"plugins.cap.peak": "GPa"}
    )
    assert len(list(result)) == 2
    with pytest.raises(SceneError, match=r"plugins.cap.peak: .*greater than 0.*at point 1"):
        chemage.sweep(both.scene(sweep={"plugins.cap.peak": [1, -1]}), tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_an_option_of_a_sweep_makes_another_sweep_only_if_it_touches_it(both, tmp_path):
    axes = {"contact.load": [1.0, 10.0]}
    both.forget()
    chemage.sweep(both.scene(sweep=axes), tmp_path / "out")
    both.forget()
    chemage.sweep(both.scene(sweep=axes, plugins={"cap": {"blocks": 2, "peak": 0.3}}), tmp_path / "out")
    assert both.computed() == []
    with pytest.raises(chemage.plugin.StoreError, match="2 of its 2 points differ"):
        chemage.sweep(both.scene(sweep=axes, plugins={"cap": {"peak": 0.2}}), tmp_path / "out")


@pytest.mark.long
def test_a_block_reaches_worker_processes(both, tmp_path):
    with chemage.plugin_options("cap", peak=0.2):
        result, *_ = computed(both, {"contact.load": [10.0, 20.0]}, tmp_path / "out", executor="processes", workers=1)
    assert [point.summary["max_pressure"] for point in result] == [0.2, 0.2]


def test_a_checkpoint_with_other_options_is_computed_again(both, tmp_path):
    def resumed(plugins):
        both.forget()
        scene = parse_scene(both.scene(plugins=plugins, hold={"times": [1.0, 10.0], "replicas": 1}))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", chemage.PlanWarning)
            chemage.run(scene, checkpoints=tmp_path / "parts")
        said = " ".join(str(one.message) for one in caught)
        return len(both.computed("contact")), len(both.computed("kinetics")) > 0, said

    assert resumed({})[0] == 1
    assert resumed({}) == (0, False, "")
    contacts, replicas, said = resumed({"cap": {"peak": 0.2}})
    assert (contacts, replicas) == (1, True)
    assert "cap was chemage-cap 1.0 [peak = 0.3 GPa] and is chemage-cap 1.0 [peak = 0.2 GPa]" in said
    contacts, replicas, said = resumed({"cap": {"peak": 0.2}, "seen": {"level": 2}})
    assert (contacts, replicas) == (0, True)
    assert "[level = 1] and is chemage-seen 1.0 [level = 2]" in said


# -- where they are shown ---------------------------------------------------------------------------------------------


def test_the_schema_knows_them(both, command):
    schema = json.loads(command("schema").out)
    section = schema["properties"]["plugins"]["properties"]
    assert section["cap"]["properties"]["peak"]["unit"] == "GPa"
    assert section["cap"]["properties"]["peak"]["description"] == "hardness"
    assert "cap" in section["prefer"]["items"]["enum"]
    checker = jsonschema.Draft202012Validator(schema)
    checker.validate(both.scene(plugins={"cap": {"peak": "2 GPa"}, "prefer": ["seen"]}))
    for wrong in ({"cap": {"pek": 1}}, {"cpa": {}}, {"prefer": ["cpa"]}):
        assert list(checker.iter_errors(both.scene(plugins=wrong)))


def test_the_command_line_lists_and_explains_them(both, command):
    listed = json.loads(command("plugins", "list", "--json").out)
    assert listed["options"] == ["cap", "seen"]
    shown = command("plugins", "show", "cap")
    for text in ("plugin cap  (chemage-cap 1.0)", "Caps the pressure.", "hook: chemage_solve_contact", "peak", "GPa"):
        assert text in shown.out
    (data,) = json.loads(command("plugins", "show", "cap", "--json").out)
    assert data["section"] == "plugins.cap"
    first = data["options"][0]
    assert (first["name"], first["unit"], first["default"]) == ("peak", "GPa", "0.3")


@pytest.mark.long
def test_show_compare_and_report_print_them(both, command, tmp_path):
    for name, peak in (("a", 0.2), ("b", 0.25)):
        found = run(both, {"cap": {"peak": peak}})
        chemage.write(tmp_path / f"{name}.h5", found)
        assert "[peak = " in command("show", tmp_path / f"{name}.h5", "--all").out
    compared = " ".join(command("compare", tmp_path / "a.h5", tmp_path / "b.h5", "--all").out.split())
    assert "peak = 0.2" in compared
    assert "peak = 0.25" in compared
    assert command("report", tmp_path / "a.h5", "--out", tmp_path / "a.html").status == 0
    assert "[peak = 0.2 GPa]" in (tmp_path / "a.html").read_text()
    again = chemage.read(tmp_path / "a.h5")
    assert again.scene["plugins"]["cap"]["peak"] == 0.2
    assert np.array_equal(again.contact.pressure, run(both, {"cap": {"peak": 0.2}}).contact.pressure)
