"""A run cut into pieces, or killed, gives the same bytes as one that was not."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import StoreError

SMALL = {
    "surface.pixels": 128, "surface.zeta": 16, "contact.load": "200 nN", "hold.replicas": 3, "hold.per_decade": 2,
}  # fmt: skip


@pytest.fixture
def small() -> ca.Scene:
    return ca.load_scene("silica-rough", SMALL)


def test_a_checkpointed_run_equals_a_plain_one(small: ca.Scene, tmp_path: Path):
    plain, kept = ca.run(small), ca.run(small, checkpoints=tmp_path / "kept")
    again = ca.run(small, checkpoints=tmp_path / "kept")
    assert plain.ageing == kept.ageing == again.ageing
    assert plain.contact == kept.contact
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == [
        "contact.h5", "replica-00000.h5", "replica-00001.h5", "replica-00002.h5",
    ]  # fmt: skip


def test_what_is_there_is_not_computed_again(small: ca.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ca.run(small, checkpoints=tmp_path / "kept")

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(type(small.engine), "run", refuse)
    monkeypatch.setattr(type(small.contact), "solve", refuse)
    ca.run(small, checkpoints=tmp_path / "kept")


def test_a_run_goes_on_from_the_middle(small: ca.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Interrupted after some pieces of the first replica, each of which is on disk."""
    contact = ca.run(small).contact
    for folder in ("whole", "kept"):
        (tmp_path / folder).mkdir()
    whole = ca.age(contact, checkpoints=tmp_path / "whole", **arguments_of(small))
    engine, calls, clock = type(small.engine), itertools.count(), itertools.count(0, 61)
    run = engine.run

    def fail_later(*arguments, **options):
        if next(calls) == 3:
            raise KeyboardInterrupt
        return run(*arguments, **options)

    monkeypatch.setattr(engine, "run", fail_later)
    monkeypatch.setattr("time.monotonic", lambda: float(next(clock)))  # every piece takes a minute
    with pytest.raises(KeyboardInterrupt):
        ca.age(contact, checkpoints=tmp_path / "kept", threads=1, **arguments_of(small))
    monkeypatch.undo()
    name = "replica-00000.h5"
    assert 0 < ca.read(tmp_path / "kept" / name).hold_times.size < whole.hold_times.size
    assert ca.age(contact, checkpoints=tmp_path / "kept", **arguments_of(small)) == whole
    joined, plain = (ca.read(tmp_path / folder / name) for folder in ("kept", "whole"))
    for field in ("hold_times", "bonds", "formed", "broken", "state"):
        np.testing.assert_array_equal(getattr(joined, field), getattr(plain, field))


def test_checkpoints_of_another_run_are_refused(small: ca.Scene, tmp_path: Path):
    ca.run(small, checkpoints=tmp_path)
    with pytest.raises(StoreError, match="another run"):
        ca.run(ca.load_scene("silica-rough", {**SMALL, "hold.seed": 1}), checkpoints=tmp_path)
    with pytest.raises(StoreError, match="another scene"):
        ca.run(ca.load_scene("silica-rough", {**SMALL, "contact.load": "300 nN"}), checkpoints=tmp_path)


def test_checkpoints_of_another_run_are_refused_whatever_plugins_took_part(small: ca.Scene, tmp_path: Path):
    class Light:
        @ca.plugin.hookimpl(wrapper=True)
        def chemage_solve_contact(self):
            found = yield
            return found.model_copy(update={"pressure": 0.5 * found.pressure, "carries": "half of it"})

    installed = ca.plugin.registry.Registry()
    installed.register(Light(), "light")
    contact = ca.run(small).contact
    with ca.plugin.registry.using(installed):
        changed = ca.run(small).contact
        ca.age(changed, checkpoints=tmp_path, **arguments_of(small))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(StoreError, match="checkpoint of another run"):
        ca.age(contact, checkpoints=tmp_path, **{**arguments_of(small), "temperature": 310.0})
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def arguments_of(scene: ca.Scene) -> dict:
    hold = scene.hold
    return {
        "chemistry": scene.chemistry,
        "engine": scene.engine,
        "hold_times": hold.hold_times,
        "temperature": hold.temperature,
        "replicas": 2,
    }


@pytest.mark.long
def test_what_other_plugins_made_is_computed_again_and_said(small: ca.Scene, tmp_path: Path):
    """What a plugin has changed must not be taken up without it, nor the other way round."""

    class Cold:
        @ca.plugin.hookimpl
        def chemage_run_kinetics(self, engine, lattice, hold_times, seed, start):
            return engine.run(lattice, hold_times, temperature=300.0, seed=7, start=start)

    class Light:
        @ca.plugin.hookimpl(wrapper=True)
        def chemage_solve_contact(self):
            found = yield
            return found.model_copy(update={"pressure": 0.5 * found.pressure, "carries": "half of it"})

    class Idle:
        @ca.plugin.hookimpl
        def chemage_run_kinetics(self, engine):
            return None

        @ca.plugin.hookimpl(wrapper=True)
        def chemage_solve_contact(self):
            return (yield)

    plain = ca.run(small, checkpoints=tmp_path)
    for plugin in (Cold(), Light()):
        installed = ca.plugin.registry.Registry()
        installed.register(plugin, "other")
        with ca.plugin.registry.using(installed):
            with pytest.warns(UserWarning, match="would answer or change it|took part in the stages before"):
                changed = ca.run(small, checkpoints=tmp_path)
            assert changed.ageing == ca.run(small).ageing != plain.ageing
            again = ca.run(small, checkpoints=tmp_path)
        assert again.ageing == changed.ageing
        with pytest.warns(UserWarning, match="and is not installed|and now no plugin"):
            back = ca.run(small, checkpoints=tmp_path)
        assert back.ageing == plain.ageing
    idle = ca.plugin.registry.Registry()
    idle.register(Idle(), "idle")
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    with ca.plugin.registry.using(idle):
        assert ca.run(small, checkpoints=tmp_path).ageing == plain.ageing
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == times


#: the command line, which waits to be killed when three replicas are kept
STOPS = """
import sys, time
from pathlib import Path
from chemage.ageing import replicas
from chemage.cli.app import main

write = replicas.Checkpoint.write

def stop(*arguments):
    write(*arguments)
    if len(list(Path("kept").glob("replica-*.h5"))) >= 3:
        print("enough", file=sys.stderr, flush=True)
        time.sleep(600)

replicas.Checkpoint.write = stop
main()
"""


@pytest.mark.long
def test_killed_run_goes_on(small: ca.Scene, tmp_path: Path):
    words = ["run", "silica-rough", "--no-figures", "--checkpoints", "kept"]
    for path, value in {**SMALL, "contact.load": '"200 nN"', "hold.replicas": 8}.items():
        words += ["--set", f"{path}={value}"]
    command = [sys.executable, "-m", "chemage", *words]
    kept = tmp_path / "kept"
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", STOPS, *words], cwd=tmp_path, **pipes) as process:
        assert process.stderr is not None
        assert any("enough" in line for line in process.stderr)
        process.kill()
    assert not (tmp_path / "silica-rough.h5").exists()
    before = {path.name: path.stat().st_mtime_ns for path in kept.glob("replica-*.h5")}
    assert len(before) >= 3
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    after = {path.name: path.stat().st_mtime_ns for path in kept.glob("replica-*.h5")}
    assert {name: after[name] for name in before} == before
    whole = ca.run(ca.load_scene("silica-rough", {**SMALL, "hold.replicas": 8}))
    assert ca.read(tmp_path / "silica-rough.h5").ageing == whole.ageing


def test_histories_that_do_not_follow_are_refused(small: ca.Scene):
    assert small.chemistry is not None
    lattice = small.chemistry.on(ca.run(small).contact, 5)
    engine = ca.engine("rejection-free")
    first = engine.run(lattice, [1.0, 10.0], temperature=300.0)
    with pytest.raises(InputError, match="was not resumed"):
        first.then(first)
    assert first.then(engine.run(lattice, [100.0], temperature=300.0, start=first)).hold_times.size == 3
