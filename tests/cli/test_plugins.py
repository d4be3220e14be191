"""The command line among plugins that are broken, clash, or bring commands of their own."""

from __future__ import annotations

import json

import pytest

from chemage.plugin import registry

pytestmark = pytest.mark.filterwarnings("default::chemage.plugins.registry.PluginWarning")

HOOK = """
import chemage

@chemage.plugin.hookimpl
def chemage_register():
    return {"contact": {"%s": "%s:Mine"}}
"""


@pytest.fixture
def everything(site):
    """Make a registry of chemage's own plugins and of what was installed in ``site`` the one in use."""
    stack = []

    def use():
        context = registry.using(registry.Registry())
        stack.append(context)
        return context.__enter__()

    yield use
    for context in reversed(stack):
        context.__exit__(None, None, None)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("raise RuntimeError('out of coffee')", "RuntimeError: out of coffee"),
        pytest.param("import a_package_nobody_has", "No module named 'a_package_nobody_has'", marks=pytest.mark.long),
        pytest.param("x = (", "SyntaxError", marks=pytest.mark.long),
        ("raise SystemExit(3)", "SystemExit: 3"),
    ],
)
def test_a_run_goes_on_beside_a_plugin_that_does_not_load(command, small, site, everything, source, said, monkeypatch):
    site.install("grumpy", {"grumpy.py": source}, {"grumpy": "grumpy"})
    # the registry of the command line is made when it is first asked for, with its warning
    monkeypatch.setattr(registry, "_current", None)
    done = command("run", small, "--no-figures", "--json")
    assert done.status == 0
    assert json.loads(done.out)["sites"]["value"] > 0
    assert "chemage: warning: plugin 'grumpy' (grumpy 1.0) was skipped" in done.err
    assert said in done.err
    listed = command("plugins", "list")
    assert "skipped: grumpy (grumpy 1.0)" in listed.out
    checked = command("plugins", "check")
    assert checked.status == 1
    assert said in checked.out
    assert "1 problems" in checked.out


def test_strict_mode_stops_at_a_broken_plugin(command, small, site, monkeypatch):
    site.install("grumpy", {"grumpy.py": "raise RuntimeError('out of coffee')"}, {"grumpy": "grumpy"})
    monkeypatch.setattr(registry, "_current", None)
    monkeypatch.setenv("CHEMAGE_STRICT", "1")
    done = command("check", small)
    assert done.status == 2
    assert "grumpy" in done.err
    assert "Traceback" not in done.err


def test_two_plugins_with_one_kind_are_both_named(command, small, site, everything):
    for name in ("one", "two"):
        site.install(name, {f"{name}.py": HOOK % ("winkler", name)}, {name: name})
    everything()
    done = command("run", small, "--set", "contact.kind='winkler'")
    assert (done.status, done.out) == (2, "")
    assert (
        '2 plugins have a contact \'winkler\'; write "one:winkler" (one 1.0) or "two:winkler" (two 1.0), or' in done.err
    )
    # who does not use it is not disturbed
    assert command("run", small, "--no-figures").status == 0
    assert command("plugins", "check").status == 1
    schema = command("schema")
    assert schema.status == 0
    assert "FFTBEM" in json.loads(schema.out)["$defs"]
    assert "not in the schema: contact 'winkler' of plugin 'one'" in schema.err


def test_a_kind_whose_class_is_missing_says_which_plugin(command, small, site, everything):
    site.install("ghost", {"ghost.py": HOOK % ("winkler", "ghost")}, {"ghost": "ghost"})
    everything()
    done = command("check", small, "--set", "contact.kind='winkler'")
    assert done.status == 2
    assert "contact 'winkler' of plugin 'ghost' (ghost 1.0)" in done.err


def test_an_installed_scene_that_is_missing(command, small, site, everything):
    source = """
        import chemage

        @chemage.plugin.hookimpl
        def chemage_scenes():
            return {"lost": "nowhere:lost.toml"}
    """
    site.install("lost", {"lost.py": source}, {"lost": "lost"})
    everything()
    for words in (["check", "lost"], ["init", "x.toml", "--like", "lost"]):
        done = command(*words)
        assert done.status == 2
        assert "the installed scene 'lost' (nowhere:lost.toml) cannot be read" in done.err


COMMANDS = """
    import chemage

    def greet(name: str = "you") -> None:
        "Say hello."
        print("hello", name)

    @chemage.plugin.hookimpl
    def chemage_cli():
        {body}
"""


def test_a_plugin_brings_a_command(command, site, everything):
    site.install("greeter", {"greeter.py": COMMANDS.format(body='return [("greet", greet)]')}, {"greeter": "greeter"})
    everything()
    for _ in range(2):
        assert command("greet", "--name", "world").out == "hello world\n"
    assert "Say hello." in command("--help").out


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise RuntimeError('no')", "RuntimeError: no"),
        ('return [("run", greet)]', "the command 'run' exists already"),
        ('return [("plugins", greet)]', "the command 'plugins' exists already"),
        ('return [("x", lambda a: 1), 7]', "TypeError"),
    ],
)
def test_a_broken_command_of_a_plugin_is_skipped(command, small, site, everything, body, said):
    site.install("greeter", {"greeter.py": COMMANDS.format(body=body)}, {"greeter": "greeter"})
    everything()
    done = command("check", small)
    assert done.status == 0
    assert "is valid" in done.out
    assert "commands of plugin greeter (greeter 1.0) were skipped" in done.err
    assert said in done.err
    assert command("plugins", "list").status == 0
