"""Several plugins for one stage: the order in which they are asked, and how a user changes it."""

from __future__ import annotations

import pytest

import chemage
from chemage import InputError, parse_scene
from chemage.plugin import SceneError, registry

#: answers a stage with its own name in the notes
ANSWER = """
    import chemage

    @chemage.plugin.hookimpl{marks}
    def chemage_solve_contact(solver, surface, load):
        found = solver.solve(surface, load)
        return found.model_copy(update={{"notes": ({name!r},)}})
"""
WRAP = """
    import chemage

    @chemage.plugin.hookimpl(wrapper=True{marks})
    def chemage_solve_contact():
        found = yield
        return found.model_copy(update={{"notes": (*found.notes, {name!r})}})
"""


def install(site, source, *names, **marks):
    for name in names:
        text = source.format(name=name, marks=marks.get(name, ""))
        site.install(f"chemage-{name}", {f"chemage_{name}.py": text}, {name: f"chemage_{name}"})


def notes(tiny, **section):
    return chemage.run(parse_scene(tiny.scene(**({"plugins": section} if section else {})))).contact.notes


@pytest.fixture
def answers(tiny, site):
    """Two plugins that answer the contact."""
    install(site, ANSWER, "apple", "pear")
    with registry.using(site.registry()):
        yield tiny


def test_installed_plugins_are_asked_by_name_and_one_by_hand_before_them(answers, site):
    run = chemage.run(parse_scene(answers.scene()))
    assert run.contact.notes == ("apple",)
    assert "pear" not in run.plugins
    by_hand = site.registry().implementation("pear")
    with registry.using(registry.Registry([])) as mine:
        mine.register(by_hand, "later")
        mine.register(site.registry().implementation("apple"), "latest")
        solver_notes = mine.manager.hook.chemage_solve_contact.get_hookimpls()
        assert [one.plugin_name for one in reversed(solver_notes)][:2] == [
            "latest (chemage_apple)",
            "later (chemage_pear)",
        ]


def test_a_scene_a_block_or_the_environment_prefers_one(answers, monkeypatch):
    plain = chemage.run(parse_scene(answers.scene()))
    assert notes(answers, prefer=["pear"]) == ("pear",)
    with chemage.prefer_plugins("pear"):
        assert notes(answers) == ("pear",)
        assert notes(answers, prefer=["apple"]) == ("apple",)
        with chemage.prefer_plugins():
            assert notes(answers) == ("apple",)
    monkeypatch.setenv("CHEMAGE_PREFER", "pear, apple")
    assert notes(answers) == ("pear",)
    monkeypatch.setenv("CHEMAGE_PREFER", "")
    assert notes(answers) == ("apple",)
    # the preference is in results by who took part, and in no other way
    preferred = chemage.run(parse_scene(answers.scene(plugins={"prefer": ["apple"]})))
    assert preferred.keys == plain.keys
    assert preferred.plugins == plain.plugins


def test_the_last_word_of_wrappers(tiny, site):
    install(site, WRAP, "apple", "pear", "plum")
    with registry.using(site.registry()):
        assert notes(tiny) == ("even", "plum", "pear", "apple")
        assert notes(tiny, prefer=["plum", "pear"]) == ("even", "apple", "pear", "plum")


def test_a_preference_comes_before_what_plugins_ask_for(tiny, site):
    install(site, ANSWER, "apple", "pear", "plum", apple="(trylast=True)", pear="(tryfirst=True)")
    with registry.using(site.registry()):
        assert notes(tiny) == ("pear",)
        assert notes(tiny, prefer=["apple"]) == ("apple",)
        assert notes(tiny, prefer=["plum", "apple"]) == ("plum",)


def test_what_is_not_installed_cannot_be_preferred(answers, monkeypatch):
    with pytest.raises(
        SceneError, match=r"plugins.prefer: it names 'paer', which is not installed \(did you mean 'pear'"
    ):
        notes(answers, prefer=["paer"])
    with pytest.raises(InputError, match="'paer', which is not installed"):
        chemage.prefer_plugins("paer").__enter__()
    monkeypatch.setenv("CHEMAGE_PREFER", "paer")
    with pytest.raises(InputError, match="'paer', which is not installed"):
        notes(answers)


def test_the_command_line_prefers(answers, command, tmp_path, monkeypatch):
    import tomli_w

    monkeypatch.setenv("CHEMAGE_PREFER", "")  # which the command sets
    (tmp_path / "tiny.toml").write_text(tomli_w.dumps(answers.scene()))
    for words, expected in (((), "apple"), (("--prefer", "pear"), "pear"), (("--prefer=apple",), "apple")):
        out = tmp_path / f"{expected}{len(words)}.h5"
        done = command(*words, "run", tmp_path / "tiny.toml", "--json", "--no-figures", "--out", out)
        assert done.status == 0, done.err
        assert f'"notes": ["{expected}"' in done.out
    wrong = command("--prefer", "paer", "plugins", "list")
    assert wrong.status == 2
    assert "CHEMAGE_PREFER names 'paer', which is not installed (did you mean 'pear'?)" in wrong.err


def test_plugins_check_says_who_comes_first_and_how_to_change_it(answers, site, command):
    install(site, WRAP, "plum", "fig")
    with registry.using(site.registry()) as plugins:
        one, two = plugins.notes()
        done = command("plugins", "check")
        assert done.status == 0
        assert f"note: {one}" in done.out
        with chemage.prefer_plugins("plum"):
            assert "'plum' has the last word" in plugins.notes()[1]
    assert one.startswith("'apple' (chemage-apple 1.0) and 'pear' (chemage-pear 1.0) answer chemage_solve_contact; ")
    assert "'apple' is asked first; to change this, write prefer = [\"pear\"] below [plugins] in the scene" in one
    assert "'fig' (chemage-fig 1.0) and 'plum' (chemage-plum 1.0) wrap chemage_solve_contact; 'fig' has the last" in two


@pytest.mark.parametrize("executor", ["serial", pytest.param("processes", marks=pytest.mark.long)])
def test_a_sweep_prefers_too_and_does_not_mix(answers, tmp_path, executor):
    one = {"executor": executor, **({"workers": 1} if executor == "processes" else {})}
    scene = answers.scene(sweep={"contact.load": [5.0, 10.0]})
    with chemage.prefer_plugins("pear"):
        result = chemage.sweep(scene, tmp_path / "out", **one)
    assert [point.contact().notes for point in result] == [("pear",)] * 2
    with pytest.raises(chemage.plugin.StoreError, match="holds another sweep"):
        chemage.sweep(scene, tmp_path / "out", **one)
    both = answers.scene(sweep={"plugins.prefer": [["pear"], ["apple"]]})
    result = chemage.sweep(both, tmp_path / "both", **one)
    assert [point.contact().notes for point in result] == [("pear",), ("apple",)]
