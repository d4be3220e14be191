"""Kernels are compiled once, before or while they are needed, and users see it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding

import chemage as ca
from chemage.foundation import compiling, machine
from chemage.plugin import container, registry
from chemage.scene import warm_up

#: most kernels that a scene compiles in a fresh installation: fewer is better, more needs a reason
MOST = {"silica-rough": 30, "silica-tip": 9}

#: a scene that uses the kernels of silica-rough and takes a second
SMALL = [
    *("--set", "surface.pixels=256", "--set", "surface.zeta=16", "--set", "contact.load=4e2 nN"),
    *("--set", "hold.replicas=2", "--set", "hold.stop=1 s", "--set", "fit.start=1 ms", "--set", "fit.stop=1 s"),
    *("--set", "surface.eta=3"),
]
COUNT = """
import json, sys
from numba.core import event
from chemage.foundation import compiling, machine
with compiling.watched(lambda count: None, lambda count: None) as compiled:
    {code}
print(json.dumps(compiled))
"""


def python(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder), **environment},
        cwd=folder.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done


def command(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return python(
        f"import sys; sys.argv[1:] = {list(words)!r}; from chemage.cli.app import main; main()", folder, **environment
    )


def compiled(code: str, folder: Path, **environment: str) -> list[str]:
    return json.loads(python(COUNT.format(code=code), folder, **environment).stdout.splitlines()[-1])


def warmed(name: str) -> str:
    return f"import chemage as ca; ca.load_scene({name!r}).warm_up()"


RUN = """import chemage as ca
    changes = {"surface.pixels": 256, "surface.zeta": 16, "contact.load": 400, "hold.replicas": 1, "hold.stop": 1.0}
    ca.run(ca.load_scene("silica-rough", changes))"""


@pytest.mark.long
def test_the_command_compiles_few_kernels_and_all_that_runs_need(tmp_path):
    folder = tmp_path / "kernels"
    done = command("warmup", "silica-rough", "--json", folder=folder)
    found = json.loads(done.stdout)
    first = found["kernels"]
    assert 0 < len(first) <= MOST["silica-rough"]
    assert len(set(first)) >= len(first) - 6, "more kernels than these are compiled for two kinds of numbers"
    assert found["folders"] == [str(folder)]
    assert done.stderr.count("compiling kernels, once per installation") == 1
    # not even what only a small grid needs besides
    assert compiled(RUN, folder) == []
    again = command("warmup", "silica-rough", folder=folder)
    assert "all kernels are compiled already" in again.stdout
    assert "compiling" not in again.stderr
    results = results_of("silica-rough", folder, ("2", "1"), SMALL)
    assert not any(says for says, _ in results)
    assert results[0] == results[1], "the number of threads does not change the bytes"


@pytest.mark.long
def test_the_first_run_says_that_it_compiles_and_gives_the_bytes_of_later_ones(tmp_path):
    folder = tmp_path / "kernels"
    results = results_of("silica-tip", folder, ("2", "1"), [])
    assert [says for says, _ in results] == [True, False]
    assert results[0][1] == results[1][1]
    assert 0 < len(list(folder.rglob("*.nbc"))) <= MOST["silica-tip"]
    assert compiled(warmed("silica-tip"), folder) == [], "warm-up compiles nothing that a run does without"


def results_of(scene, folder, threads, options):
    """(whether it says that it compiles, what it writes) of a run of the scene with each number of threads."""
    results = []
    for number, count in enumerate(threads):
        words = ["run", scene, "--no-figures", "--json", "--out", str(folder.parent / f"{number}.h5"), *options]
        done = command(*words, folder=folder, CHEMAGE_THREADS=count)
        found = json.loads(done.stdout)
        for name in ("timings", "file", "versions"):
            found.pop(name)
        results.append(("compiling kernels, once per installation" in done.stderr, found))
    return results


@pytest.mark.parametrize("options", [{}, {"precision": "single"}, {"precision": "double"}, {"boundary": "free"}])
@pytest.mark.parametrize("pixels", [128, 130, 63])
def test_the_contact_calls_no_kernel_that_warm_up_leaves_out(monkeypatch, pixels, options):
    from chemage_contact import _iteration
    from chemage_contact._operators import Team

    solver = ca.contact("fft-bem", modulus=35.3, **options)
    maker = ca.surface("self-affine", pixels=pixels, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=8)

    def signature(kernel, args):
        import numba

        return kernel.__name__, tuple(str(numba.typeof(value)) for value in args)

    ahead, used = set(), set()
    body_calls = _iteration._calls

    def recorded(*args):
        for kernel, given in body_calls(*args):
            ahead.add(signature(kernel, (0, 0, *given)))
            yield kernel, given

    monkeypatch.setattr(_iteration, "_calls", recorded)
    solver.warm_up(maker.expected(), 100.0)
    real = Team.run

    def watched(self, kernel, share, *args):
        if hasattr(kernel, "py_func"):  # compiled
            used.add(signature(kernel, (0, 0, *args)))
        return real(self, kernel, share, *args)

    monkeypatch.setattr(Team, "run", watched)
    solver.solve(maker.make(seed=1), 100.0)
    assert used
    assert used - ahead == set()


def scene(name: str = "silica-tip") -> ca.Scene:
    return ca.load_scene(name)


def test_one_thread_starts_no_process(monkeypatch):
    monkeypatch.setenv("CHEMAGE_THREADS", "1")
    monkeypatch.setattr(compiling, "start", lambda *_: pytest.fail("a process was started"))
    with a_kernel_is_compiled(), warm_up.compiled_ahead(scene("silica-rough"), lambda *_, **__: None):
        pass


class a_kernel_is_compiled:
    """A block at whose begin ``watched`` says that a kernel is compiled."""

    def __enter__(self):
        from contextlib import contextmanager

        @contextmanager
        def one(begin, end):
            begin(0)
            end(1)
            yield []

        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(compiling, "watched", one)

    def __exit__(self, *_):
        self.patch.undo()


def test_a_process_that_cannot_be_started_fails_no_run(monkeypatch):
    monkeypatch.setenv("CHEMAGE_THREADS", "2")

    def broken(*_, **__):
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", broken)
    said = []
    with (
        a_kernel_is_compiled(),
        warm_up.compiled_ahead(scene("silica-rough"), lambda *words, **_: said.append(words)) as report,
    ):
        report("surface", 0, 0)
    assert said[0][:3] == ("compiling", 0, 0)
    assert ("surface", 0, 0, "") in said


def test_the_process_that_compiles_ahead_ends_with_the_block_and_gets_the_scene(monkeypatch):
    monkeypatch.setenv("CHEMAGE_THREADS", "2")
    # it waits for what it is told, as one that compiles would
    monkeypatch.setattr(compiling, "_BOOT", "import sys; sys.stdin.buffer.read()")
    started, asked = [], []
    real = compiling.start

    def kept(function, stage, data, changes, plugins):
        assert function == "chemage.scene.warm_up:compile_stage"
        assert ca.parse_scene(data).name == "silica-rough"
        asked.append(stage)
        started.append(real(function, stage, data, changes, plugins))
        return started[-1]

    monkeypatch.setattr(compiling, "start", kept)
    with a_kernel_is_compiled(), warm_up.compiled_ahead(scene("silica-rough"), lambda *_, **__: None):
        assert asked == ["ageing", "contact"]
        assert [one.poll() for one in started] == [None, None]
    assert None not in [one.poll() for one in started]


def test_a_background_process_calls_what_it_is_given(tmp_path):
    process = compiling.start("os:mkdir", str(tmp_path / "made"))
    process.wait(60)
    assert (tmp_path / "made").is_dir()
    compiling.end([process])
    process = compiling.start("os:no_such_function")
    assert process.wait(60) == 0
    compiling.end([process])


def test_early_only_where_nothing_is_compiled(tmp_path, monkeypatch):
    started = []
    monkeypatch.setenv("CHEMAGE_THREADS", "4")
    monkeypatch.setattr(compiling, "start", lambda *args: started.append(args))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    with compiling.begun_early("silica-tip", {"hold.replicas": 2}, None, ()):
        assert [stage for _, stage, *_ in started] == ["ageing", "contact"]
    started.clear()
    (tmp_path / "chemage.foundation-1").mkdir()
    (tmp_path / "chemage.foundation-1" / "random._fill-1.py311.nbi").touch()
    assert not machine.is_cold()
    with compiling.begun_early("silica-tip", {}, None, ()) as begun:
        assert not begun
    assert started == []


class Slow:
    """A process that is at work until somebody waits for it."""

    waited: float | None = None

    def poll(self):
        return None

    def wait(self, timeout):
        self.waited = timeout
        raise subprocess.TimeoutExpired("it", timeout)


def test_the_ageing_waits_for_the_process_that_compiles_it_but_not_for_ever():
    said, slow = [], Slow()
    with warm_up.compiled_ahead(scene(), lambda *words, **_: said.append(words), early={"ageing": slow}) as report:
        report("contact", 0, 0)
        assert slow.waited is None
        report("ageing", 0, 0)
    assert slow.waited == compiling.PATIENCE
    assert [words[0] for words in said] == ["contact", "compiling", "compiling", "ageing"]


def test_nothing_compiled_starts_nothing_and_says_nothing(monkeypatch):
    monkeypatch.setattr(compiling, "start", lambda *_: pytest.fail("a process was started"))
    said = []
    with warm_up.compiled_ahead(scene(), lambda *words, **_: said.append(words)):
        np.zeros(3)
    assert said == []


@pytest.fixture
def registered():
    """Registers an engine until the end of the test."""
    classes = []

    def add(cls):
        classes.append(cls)
        return ca.register(cls)

    yield add
    for cls in classes:
        ca.unregister(cls)


def test_an_engine_of_another_package_is_warmed_up_on_a_lattice_like_that_of_the_run(registered):
    seen = []

    class Mine(ca.plugin.Engine):
        """An engine."""

        kind = "mine"

        def _run(self, lattice, hold_times, temperature, seed, start):
            seen.append((lattice, list(hold_times), temperature))
            raise RuntimeError("it would compile here")

    registered(Mine)
    one = ca.load_scene("silica-tip", {"engine": {"kind": "mine"}})
    with pytest.raises(RuntimeError, match="compile here"):
        one.warm_up("ageing")
    lattice, times, temperature = seen[0]
    assert lattice.interacting
    assert lattice.breaking is not None
    assert 0 < lattice.sites.size < 1000
    assert (times, temperature) == ([0.0], one.hold.temperature)
    with pytest.raises(RuntimeError, match="compile here"):
        warm_up.compile_stage("ageing", one.todict(), None, registry.current().installed())  # as in the second process


@pytest.mark.parametrize("density", [4.9, "pixel", 100.0, 0.05])
@pytest.mark.parametrize("pixel_size", [0.02, 0.4518, 20.0])
def test_there_are_sites_on_the_small_contact(density, pixel_size):
    changes = {"chemistry.site_density": density, "surface.pixel_size": pixel_size}
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ca.plugin.Engine, "warm_up", lambda self, lattice, temperature: seen.append(lattice))
        ca.load_scene("silica-tip", changes).warm_up("ageing")
    (lattice,) = seen
    assert 4 <= lattice.sites.size < 200_000


def test_scenes_that_differ_in_numbers_have_one_form():
    cold, dense = ({"hold.temperature": 250.0}, {"chemistry.site_density": "pixel"})
    assert scene().form() == ca.load_scene("silica-tip", cold).form()
    assert scene().form() != ca.load_scene("silica-tip", dense).form()
    assert scene().form() != ca.load_scene("silica-tip", {"engine.kind": "bkl"}).form()


def test_a_kernel_that_is_kept_is_told_from_others():
    import numba

    from chemage_contact import _kernels

    class Begun:
        data = {"dispatcher": _kernels.scale}

    assert compiling._is_kept(Begun())
    Begun.data = {"dispatcher": numba.njit(lambda x: x)}
    assert not compiling._is_kept(Begun())


# -- the machine -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("environment", "features", "text"),
    [
        ({}, {"avx2": True}, "host (avx2)"),
        ({}, {"avx2": True, "avx512f": True}, "host (avx2, avx512f)"),
        ({"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"}, {"avx512f": True}, "host (avx512f, numpy without AVX-512)"),
        ({"NUMBA_CPU_NAME": "generic"}, {"avx2": True}, "generic (NUMBA_CPU_NAME)"),
        ({"NUMBA_CPU_NAME": "generic"}, {"avx512f": True}, "generic (NUMBA_CPU_NAME, numpy with AVX-512)"),
    ],
)
def test_processors_whose_bytes_differ_have_different_names(environment, features, text, monkeypatch):
    """Heights depend on whether numpy uses AVX-512, whatever kernels are compiled for; fits on that of BLAS."""
    for name in ("NUMBA_CPU_NAME", "NPY_DISABLE_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(binding, "get_host_cpu_name", lambda: "host")
    monkeypatch.setattr(machine, "blas_kernel", lambda: "Haswell")
    assert machine.processor.__wrapped__() == f"{text}, BLAS Haswell"
    monkeypatch.setattr(machine, "blas_kernel", lambda: "")
    assert machine.processor.__wrapped__() == text


def test_the_kernel_of_blas_is_that_which_numpy_uses():
    asked = "from chemage.foundation import machine; print(machine.blas_kernel())"
    for kernel in ("Haswell", "SkylakeX"):
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        run = subprocess.run([sys.executable, "-c", asked], env=environment, capture_output=True, text=True, check=True)
        assert run.stdout.strip() in (kernel, "")


def test_the_speed_is_measured_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("CHEMAGE_CACHE", str(tmp_path))
    measured = []
    monkeypatch.setattr(machine, "_seconds_of_load", lambda: measured.append(1) or 2 * machine.REFERENCE_SECONDS)
    slowness = machine.slowness.__wrapped__
    assert (slowness(), slowness(), len(measured)) == (2.0, 2.0, 1)
    (file,) = tmp_path.iterdir()
    good = container.read_json(file)
    other = {**good, "processor": "other"}
    for content in (
        "",
        "{",
        "[]",
        "3",
        json.dumps(good),
        container.sealed_json({**good, "seconds": -1}).decode(),
        container.sealed_json({"version": 0}).decode(),
        container.sealed_json(other).decode(),
    ):
        file.write_text(content)
        measured.clear()
        assert (slowness(), len(measured)) == (2.0, 1), content
        assert container.read_json(file) == good
    monkeypatch.setenv("CHEMAGE_CACHE", str(file / "no folder"))
    assert slowness() == 2.0


def test_the_measured_speed_is_a_time():
    assert 1e-5 < machine._seconds_of_load() < 1
