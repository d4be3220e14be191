"""What cannot be computed here is refused before it is begun, by check as by run, with numbers and remedy."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.plugin import memory, threads

#: changes to a small scene that no run survives, and what the message says
BAD_SCENES = [
    (["surface.pixels=60000"], "memory needed"),
    (["hold.replicas=1_000_000_000"], "memory needed"),
    (["surface.pixel_size=1e-300"], "out of range"),
    (["surface.pixel_size=1e160"], "out of range"),
    (["contact.load=1e200"], "out of range"),
    (["contact.load=1e-320"], "range of numbers"),
    (["contact.modulus=1e200"], "out of range"),
    (["contact.thickness=1e-30"], "thickness"),
    (["contact.thickness=1e60"], "thickness"),
    (["contact.precision='single'", "contact.tolerance=1e-4", "contact.load=1e60"], "float32"),
    (["contact.kind='hertz'"], "needs a sphere"),
    (["engine.kind='independent'"], "do not interact"),
    (["hold.start=5e-324"], "out of range"),
    (["hold.stop=1.7e308"], "out of range"),
    (["hold.temperature=1e-300"], "out of range"),
    (["hold.temperature=1e300"], "out of range"),
    (["hold.replicas=true"], "not a number"),
    (["ensemble.surfaces=99999999999999999999"], "less than or equal to"),
    (["ensemble.budget=1e99"], "less than or equal to"),
    (["accuracy.beta=1e-320"], "must lie between"),
    (["plugins.prefer=7"], "7: give a list of names of plugins"),
    (["hold.seed=true"], "not a number"),
    (["surface.hurst=true"], "not a quantity"),
    (["contact.tolerance=true"], "contact.tolerance"),
    (["contact.max_iterations=true"], "not a number"),
    (["chemistry.front_factor=true"], "not a number"),
    (["chemistry.attempt_frequency=1e200"], "out of range"),
    (["interaction.strength=1e30"], "strength"),
    (["forming={kind='gaussian', mean=1e308, std=0.1}"], "forming.mean"),
    (["forming={kind='uniform', lower=-1e308, upper=1e308}"], "forming.lower"),
    (["surface={kind='sphere', radius=1e-90, pixels=64, pixel_size=1e80}"], "below the apex"),
    (["surface={kind='from-file', path=\"a\\u0000b.npy\", pixel_size=1}"], "no name of a file"),
    (["surface={kind='from-file', path='h.txt', reader={kind='text', delimiter=''}}"], "one character"),
    (["surface={kind='from-file', path='h.txt', reader={kind='text', delimiter='1'}}"], "parts of numbers"),
    (["surface={kind='from-file', path='/dev/zero', reader='npy', pixel_size=1}"], "is a device"),
]


@pytest.mark.parametrize(("changes", "said"), BAD_SCENES, ids=lambda value: value[0] if isinstance(value, list) else "")
def test_what_run_refuses_check_refuses(command, small, monkeypatch, changes, said):
    monkeypatch.setenv("CHEMAGE_MEMORY", "64 GB")
    words = [word for change in changes for word in ("--set", change)]
    messages = []
    for name in ("check", "run"):
        done = command(name, small, *words)
        assert (done.status, done.out) == (2, ""), (name, done)
        assert "Traceback" not in done.err
        messages.append(done.err)
    assert said in messages[0]
    assert messages[0] == messages[1]
    assert [path.name for path in small.parent.iterdir()] == ["small.toml"]


def test_both_name_the_numbers_and_the_remedy(command, small, monkeypatch):
    monkeypatch.setenv("CHEMAGE_MEMORY", "64 GB")
    pixels = command("check", small, "--set", "surface.pixels=60000").err
    assert "60000 x 60000 pixels: about 252 GB of memory needed, but there are 64 GB; use fewer pixels" in pixels
    replicas = command("run", small, "--replicas", "1000000000").err
    assert "1000000000 replicas" in replicas
    assert "there are 64 GB; ask for fewer replicas" in replicas
    monkeypatch.setenv("CHEMAGE_MEMORY", "4 TB")
    assert command("check", small, "--set", "surface.pixels=60000").status == 0


def test_the_same_in_python(examples, monkeypatch):
    monkeypatch.setenv("CHEMAGE_MEMORY", "1 GB")
    with pytest.raises(InputError, match="memory needed"):
        ca.surface("sphere", radius=30.0, pixels=60000, pixel_size=1.0).make()
    chemistry = ca.chemistry(forming=ca.barriers("md-silica"))
    with pytest.raises(InputError, match="memory needed"):
        ca.age(
            examples.contact(), chemistry, engine=ca.engine("bkl"), hold_times=[1.0], temperature=300.0, replicas=10**9
        )


def test_the_memory_of_this_machine_is_known(monkeypatch):
    monkeypatch.delenv("CHEMAGE_MEMORY", raising=False)
    found = memory.capacity()
    assert 1e8 < found < 1e18 or found == math.inf
    monkeypatch.setenv("CHEMAGE_MEMORY", "1.5 GB")
    assert memory.capacity() == 1.5e9
    monkeypatch.setenv("CHEMAGE_MEMORY", "plenty")
    with pytest.raises(InputError, match="no amount of memory"):
        memory.capacity()


def test_a_run_of_hours_says_so_first(command, small, monkeypatch):
    from chemage_kinetics import RejectionFree

    monkeypatch.setattr(RejectionFree, "expected", lambda self, sites, interacting: {"cpu_seconds": 1e5, "bytes": 1.0})
    assert "warning: this will take about" in command("check", small).out
    with pytest.warns(ca.PlanWarning, match=r"this will take about .* (hours|days)"):
        ca.run(small)


def test_replicas_are_not_all_queued_at_once():
    """Of 10^5 replicas never more than a few are begun; results come in order, and the first failure ends it."""
    running = []
    most = []
    lock = threading.Lock()

    def task(number):
        with lock:
            running.append(number)
            most.append(len(running))
        time.sleep(0.001 if number % 3 else 0.003)
        with lock:
            running.remove(number)
        if number == 60:
            raise RuntimeError("60")
        return number

    seen = []
    done = []
    with pytest.raises(RuntimeError, match="60"):
        seen.extend(threads.in_order(task, 100_000, 4, lambda ready, count: done.append(ready)))
    assert max(most) <= 4
    assert len(most) < 100
    assert list(threads.in_order(lambda number: number, 50, 4, None)) == list(range(50))


def test_a_history_that_is_not_one_is_refused_before_a_kernel_sees_it(examples):
    lattice = examples.lattice()
    for kind in ("rejection-free", "bkl", "next-reaction"):
        engine = ca.engine(kind)
        history = engine.run(lattice, [1.0], temperature=300.0, seed=1)
        for name, array in history.resume.items():
            if name in ("engine", "key", "lattice"):
                continue  # another of these makes it another run's
            wrong = np.full(array.shape, 2**40 if array.dtype == np.int64 else -7).astype(array.dtype)
            if not array.size:
                wrong = np.array([99], array.dtype)
            elif name in ("event", "drawn", "draws"):
                wrong = np.full(array.shape, -1, array.dtype)
            bad = history.model_copy(update={"resume": {**history.resume, name: wrong}})
            with pytest.raises(InputError, match=rf"resume\['{name}'\]"):
                engine.run(lattice, [2.0], temperature=300.0, seed=1, start=bad)
        for changes in ({"time": 2.0}, {"bonds": [9]}, {"state": ~history.state}):
            with pytest.raises(InputError, match="contradicts itself"):
                engine.run(lattice, [3.0], temperature=300.0, seed=1, start=history.model_copy(update=changes))


def test_nobody_else_can_write_to_the_arrays_of_a_record(examples):
    neighbours = np.array([[1, -1], [0, 2], [1, -1]], np.int32)
    view = neighbours.view()
    view.setflags(write=False)
    lattice = examples.lattice(neighbours=view)
    neighbours[:] = 10**9
    assert lattice.neighbours.max() == 2


def test_wide_graphs_are_checked_as_narrow_ones(examples):
    n = 80
    everyone = np.array([[j for j in range(n) if j != i] for i in range(n)], np.int32)
    fields = {"pixels": (n, 1), "sites": np.arange(n), "forming": np.ones(n), "breaking": None}
    energies = np.zeros(everyone.shape)
    lattice = ca.ReactionLattice(**fields, neighbours=everyone, coupling=energies)
    assert lattice.interacting
    for row, slot, value, said in [
        (3, 5, 90, "is not a site"), (3, 5, 3, "its own neighbour"), (3, 5, 0, "listed twice"),
        (3, 5, -1, "not the other way"),
    ]:  # fmt: skip
        wrong = everyone.copy()
        wrong[row, slot] = value
        with pytest.raises(InputError, match=said):
            ca.ReactionLattice(**fields, neighbours=wrong, coupling=energies)
    energies[3, 5] = 1.0
    with pytest.raises(InputError, match="two values"):
        ca.ReactionLattice(**fields, neighbours=everyone, coupling=energies)


def test_a_tradeoff_figure_of_no_format_is_refused_at_once(command, small):
    done = command("tradeoff", small, "--out", "x.exe")
    assert (done.status, done.out) == (2, "")
    assert "must end in .json, .png, .pdf or .svg" in done.err
