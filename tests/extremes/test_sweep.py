"""Sweeps that are wrong, interrupted, killed, out of room, or spread over workers that die."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from textwrap import dedent
from types import SimpleNamespace

import numpy as np
import pytest

import chemage
from chemage import InputError
from chemage.plugin import DamagedError, ExecutorError, SceneError, StoreError, WorkerLost

AXES = """
[sweep]
"surface.seed" = [1, 2]
"contact.load" = [5.0, 10.0]
"hold.seed" = [0, 1, 2]
"""


def swept(tiny, text=AXES, **sections):
    return {**tiny.scene(**sections), **tomllib.loads(dedent(text))}


def contents(folder):
    """Everything a sweep found out, without what depends on the clock."""
    seen = {}
    for file in sorted(Path(folder).rglob("points/*/*.json")):
        point = json.loads(file.read_text())
        del point["sha256"]
        if point["status"] == "done":
            del point["summary"]["timings"]
        seen[file.name] = point
    for file in sorted(Path(folder).rglob("contacts/*.npz")):
        with np.load(file) as arrays:
            seen[file.name] = {name: (arrays[name].dtype.str, arrays[name].tobytes()) for name in arrays}
    for name in ("results.csv", "results.h5"):
        seen[name] = (Path(folder) / name).read_bytes()
    return seen


# -- wrong input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sweep]", "sweep: names no field; give lists, such as"),
        ("sweep = 3", "sweep: 3 is not a section"),
        ('[sweep]\n"contact.load" = []', r"sweep\.contact\.load: is an empty list; an axis needs at least one value"),
        ('[sweep]\n"contact.load" = 5.0', r"sweep\.contact\.load: 5\.0 is one value; give a list, such as \[5\.0\]"),
        ('[sweep]\n"contcat.load" = [1]', r"contcat\.load: no such section \(did you mean 'contact'\?\)"),
        ('[sweep]\n"contact.laod" = [1.0, 2.0]', r"contact\.laod: no such option.* \[at point 0: contact\.laod = 1\.0"),
        ('[sweep]\n"contact..load" = [1]', "no such field"),
        ('[sweep]\n"name.x" = [1]', "no such field"),
        ('[sweep]\n"sweep.x" = [1]', "no such section"),
        ('[sweep]\n"contact.load.x" = [1]', r"contact\.load\.x: 'load' is a value \[at point 0"),
        ('[sweep]\n"contact.load" = [1]\n[sweep.contact]\nload = [2]', r"sweep\.contact\.load: is swept twice"),
        ('[sweep]\n"contact.load" = [1]\n[[sweep.zip]]\ncontact.load = [2]', r"contact\.load: is swept twice"),
        ('[[sweep.zip]]\n"contact.load" = [1, 2]\n"hold.seed" = [1]', "equal length: contact.load has 2, hold.seed"),
        ("[[sweep.zip]]", r"sweep\.zip\.0: names no field"),
        ("[sweep.zip]\nhold.seed = [1]", r"write each group .* as \[\[sweep\.zip\]\], in two brackets"),
        (
            '[sweep]\nengine.kind = ["tiny-coin", "tiny-dice"]',
            r"engine\.kind: no engine 'tiny-dice'.*\[at point 1: engin",
        ),
        ("[sweep]\nsurface = [false]", r"surface: False is not a section"),
    ],
)
def test_a_wrong_sweep_is_refused_with_path_and_reason(tiny, tmp_path, text, message):
    with pytest.raises(SceneError, match=message):
        chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert tiny.computed() == []


def test_every_point_is_validated_before_the_first_runs(tiny, tmp_path):
    text = """
    [sweep]
    "hold.seed" = [0, 1]
    "contact.load" = [1.0, "3 eV", -2.0]
    """
    with pytest.raises(SceneError) as caught:
        chemage.sweep(swept(tiny, text), tmp_path / "out")
    quantity = '"3 eV" is a quantity of electron_volt, but this field is in nN; a load is a force, such as "20 uN" '
    quantity += 'or "20 nm * 2.5 N/m" (deflection times spring constant), or a nominal pressure, such as "10 MPa" '
    negative = "-2.0: must be finite and not negative; give a force such as 20 uN "
    assert caught.value.problems == [
        ("contact.load", quantity + "[at point 1: hold.seed = 0, contact.load = 3 eV and at 1 more of 6]"),
        ("contact.load", negative + "[at point 2: hold.seed = 0, contact.load = -2.0 and at 1 more of 6]"),
    ]
    assert tiny.computed() == []
    assert not (tmp_path / "out").exists()


def test_a_scene_that_is_no_plain_data_is_refused(tiny, tmp_path):
    with pytest.raises(InputError, match="numbers, strings, lists and tables only"):
        chemage.sweep({**tiny.scene(), "sweep": {"hold.seed": [object()]}}, tmp_path / "out")


def test_too_little_room_is_told_before_anything_is_written(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=66_000))
    with pytest.raises(InputError, match=r"the 12 points and 4 contacts may need [\d.]+ kB, but .* has 66 kB left"):
        chemage.sweep(swept(tiny), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert chemage.sweep(swept(tiny), tmp_path / "out", confirm=True).states() == ["done"] * 12


class Looked(Exception):
    """The first point was looked at."""


@pytest.mark.parametrize("confirmed", [None, False, True])
def test_a_billion_points_are_counted_at_once_and_told_before_they_are_looked_at(tiny, tmp_path, confirmed):
    scene = {
        **tiny.scene(),
        "sweep": {f"hold.{name}": list(range(1000)) for name in ("seed", "replicas", "per_decade")},
    }
    asked = []

    def looked(state):
        raise Looked

    with pytest.raises(Looked if confirmed else InputError, match=None if confirmed else "1000000000 .*; nothing was"):
        chemage.sweep(
            scene,
            tmp_path / "out",
            progress=looked,
            confirm=None if confirmed is None else lambda text: asked.append(text) or confirmed,
        )
    assert asked == [] if confirmed is None else ["the sweep has 1000000000 points (1000 x 1000 x 1000)"]
    assert not (tmp_path / "out").exists()


def test_foreign_folders_are_left_alone(tiny, tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(StoreError, match="is a file; a sweep is computed into a folder"):
        chemage.sweep(swept(tiny), tmp_path / "file")
    for force in (False, True):
        with pytest.raises(StoreError, match="is not empty and holds no sweep"):
            chemage.sweep(swept(tiny), tmp_path / "full", force=force)
    with pytest.raises(StoreError, match="cannot make the folder"):
        chemage.sweep(swept(tiny), tmp_path / "file" / "below")
    assert list((tmp_path / "full").iterdir()) == [tmp_path / "full" / "thesis.tex"]
    assert tiny.computed() == []


def test_the_folder_of_another_sweep_is_refused(tiny, tmp_path):
    chemage.sweep(swept(tiny), tmp_path / "out")
    before = contents(tmp_path / "out")
    for text, reason in (
        ('[sweep]\n"hold.seed" = [0]', r"over surface\.seed, contact\.load, hold\.seed"),
        (AXES.replace("[0, 1, 2]", "[0, 1]"), "12 points instead of 2 x 2 x 2|2 x 2 x 3 points instead of 2 x 2 x 2"),
        (AXES.replace("10.0", "11.0"), "6 of its 12 points differ"),
    ):
        with pytest.raises(StoreError, match=rf"holds another sweep \(({reason})\); choose another folder"):
            chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert contents(tmp_path / "out") == before


OF_LATER = chemage.plugin.container.sealed_json({"format": 99, "versions": {"chemage": "9.0"}})


@pytest.mark.parametrize("content", [b"{}", b'{"name": "a package"}', OF_LATER])
def test_a_manifest_of_something_else_is_an_error(tiny, tmp_path, content):
    chemage.sweep(swept(tiny), tmp_path / "out")
    (tmp_path / "out" / "sweep.json").write_bytes(content)
    for again in (lambda: chemage.load_sweep(tmp_path / "out"), lambda: chemage.sweep(swept(tiny), tmp_path / "out")):
        with pytest.raises(StoreError, match=r"is no file of chemage|was made by chemage 9\.0; update"):
            again()


@pytest.mark.parametrize(
    "damage", [*(pytest.param(text, marks=pytest.mark.long) for text in ("", "{", "[]", "cut")), "one digit"]
)
def test_a_damaged_manifest_is_written_again(tiny, tmp_path, damage):
    result = chemage.sweep(swept(tiny), tmp_path / "out")
    whole = contents(tmp_path / "out")
    text = result.store.manifest.read_text()
    damaged = {"cut": text[:-100], "one digit": text.replace('"surface.seed"', '"surface.sead"', 1)}.get(damage, damage)
    assert damaged != text
    result.store.manifest.write_text(damaged)
    with pytest.raises(DamagedError, match=r"sweep\.json is "):
        chemage.load_sweep(tmp_path / "out")
    tiny.forget()
    with pytest.warns(UserWarning, match=r"sweep\.json is .* it is written again"):
        chemage.sweep(swept(tiny), tmp_path / "out")
    assert not tiny.computed("kinetics")
    assert contents(tmp_path / "out") == whole
    # of another sweep, it stays as it is
    result.store.manifest.write_text(damaged)
    other = AXES.replace("[0, 1, 2]", "[3, 4]").replace("[5.0, 10.0]", "[7.0]")
    with pytest.raises(DamagedError, match=r"sweep\.json is "):
        chemage.sweep(swept(tiny, other), tmp_path / "out")


def test_no_sweep_there_is_told(tmp_path):
    with pytest.raises(StoreError, match=r"is not the folder of a sweep: it has no sweep\.json"):
        chemage.load_sweep(tmp_path)


# -- points that fail -------------------------------------------------------------------------------------------------


def test_a_failed_point_loses_nothing_else_and_is_tried_again(tiny, tmp_path, monkeypatch):
    text = """
    [sweep]
    "engine.trouble" = ["", "raise", "break", "exit"]
    "hold.seed" = [0, 1]
    """
    result = chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert result.states() == ["done"] * 2 + ["failed"] * 6
    errors = [point.error for point in result]
    for number, said in ((2, "InputError: this one is meant to fail"), (4, "ZeroDivisionError: a bug in a plugin")):
        whose = "in engine 'tiny-coin' of plugin 'tiny' (chemage-tiny 1.0): chemage_tiny.Coin._run"
        assert errors[number].startswith(f"ageing: {said}; {whose}, ")
    assert errors[6].startswith("ageing: SystemExit: 3; in engine 'tiny-coin' of plugin 'tiny'")
    assert "in _trouble" in result.store.read_point(result.keys[4])["error"]["traceback"]
    assert [point.index for point in result.failed] == [2, 3, 4, 5, 6, 7]
    with pytest.raises(StoreError, match=r"point 2 of .* is failed: ageing: InputError: this one is meant to fail"):
        _ = result[2].summary
    table = result.table()
    assert table.status == result.states()
    assert np.isnan(table.results["beta"].values[2:]).all()
    tiny.forget()
    import chemage_tiny  # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(chemage_tiny, "_trouble", lambda kind: None)
    again = chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert again.states() == ["done"] * 8
    assert len(tiny.computed("kinetics")) == 12, "only the six that failed, two replicas each"
    assert tiny.computed("contact") == []


def test_a_contact_that_fails_fails_its_points_alone(tiny, tmp_path):
    text = """
    [sweep]
    "contact.trouble" = ["raise", ""]
    "hold.seed" = [0, 1]
    """
    result = chemage.sweep(swept(tiny, text), tmp_path / "out")
    assert result.states() == ["failed", "failed", "done", "done"]
    assert result[0].error == result[1].error
    assert result[0].error.startswith(
        "contact: InputError: this one is meant to fail; in contact 'tiny-even' of plugin"
    )
    assert len(tiny.computed("contact")) == 2, "not tried anew for every point"


# -- damage and interruption ------------------------------------------------------------------------------------------


def test_what_is_damaged_is_computed_anew(tiny, tmp_path):
    result = chemage.sweep(swept(tiny), tmp_path / "out")
    whole = contents(tmp_path / "out")
    for point, size in ((0, 0), (3, 40), (5, -2)):
        file = result.store.point(result.keys[point])
        file.write_bytes(file.read_bytes()[:size])
    contact = result.store.contact(result.contact_key(3))
    contact.write_bytes(contact.read_bytes()[:-100])
    middle = result.store.contact(result.contact_key(0))
    data = bytearray(middle.read_bytes())
    data[len(data) // 2] ^= 0xFF
    middle.write_bytes(data)
    assert chemage.load_sweep(tmp_path / "out").states().count("damaged") == 3
    tiny.forget()
    with pytest.warns(UserWarning, match=r"out: 5 files are damaged and are computed again: points/.*contacts/.*npz"):
        chemage.sweep(swept(tiny), tmp_path / "out")
    assert len(tiny.computed("kinetics")) == 6
    assert contents(tmp_path / "out") == whole


def test_a_full_disk_keeps_what_is_finished(tiny, tmp_path, monkeypatch):
    real, written = os.open, []

    def write(path, flags, *more, **options):
        handle = real(path, flags, *more, **options)
        if flags & os.O_EXCL:
            written.append(path)
            if len(written) > 9:
                os.write(handle, b"half")
                os.close(handle)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return handle

    with monkeypatch.context() as full:
        full.setattr(os, "open", write)
        with pytest.raises(StoreError, match="No space left on device; completed points are kept"):
            chemage.sweep(swept(tiny), tmp_path / "out")
    states = chemage.load_sweep(tmp_path / "out").states()
    assert 0 < states.count("done") < 12
    assert "failed" not in states
    assert chemage.sweep(swept(tiny), tmp_path / "out").states() == ["done"] * 12
    assert len(tiny.computed("kinetics")) <= 26


def test_one_sweep_at_a_time_in_a_folder(tiny, tmp_path):
    met = []

    def second(state):
        if state.stage == "computing" and not met:
            with pytest.raises(StoreError, match=rf"is being computed by process {os.getpid()} on "):
                chemage.sweep(swept(tiny), tmp_path / "out")
            met.append(state)

    chemage.sweep(swept(tiny, engine={"kind": "tiny-coin", "pause": 0.02}), tmp_path / "out", progress=second)
    assert met


SCRIPT = """
import sys, tomllib
import chemage
from chemage.studies.sweeps import running as sweeps
chemage.sweep({scene!r}, {out!r}, executor={executor!r}, workers={workers}, threads=1)
"""


def children(pid):
    """Processes that process ``pid`` has started."""
    try:
        return [int(word) for file in Path(f"/proc/{pid}/task").glob("*/children") for word in file.read_text().split()]
    except OSError:
        return []


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


#: -1 while it imports, 0 as the manifest appears, else after so many points
KILLS = (-1, 0, 1, 6, 13)


@pytest.mark.parametrize(
    ("executor", "workers", "kills"),
    [
        pytest.param("serial", None, (13,), marks=pytest.mark.long),
        pytest.param("processes", 2, (0, 6), marks=pytest.mark.campaign),
        pytest.param("serial", None, KILLS, marks=pytest.mark.campaign),
        pytest.param("processes", 2, KILLS, marks=pytest.mark.campaign),
    ],
)
def test_killed_anywhere_it_goes_on_and_computes_nothing_twice(tiny, tmp_path, executor, workers, kills):
    """SIGKILL to the whole thing, several times over in one folder."""
    scene = swept(tiny, AXES.replace("[0, 1, 2]", "[0, 1, 2, 3, 4]"))
    chemage.sweep(scene, tmp_path / "whole", threads=1)
    out = tmp_path / "out"
    script = SCRIPT.format(scene=scene, out=str(out), executor=executor, workers=workers)
    finished: dict[Path, int] = {}

    def done():
        return {file: file.stat().st_mtime_ns for file in out.glob("points/*/*.json")}

    def far_enough(points):
        return len(done()) >= points and (points < 0 or (out / "sweep.json").exists())

    for points in kills:
        # what is to be seen is computed, then the kinetics waits to be killed: two replicas a point, and each of two
        # workers may be in the middle of a point
        tiny.forget()
        tiny.hold(max(0, 2 * (points - len(finished))) + 2, 600)
        process = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 300
        time.sleep(0.3)
        while not far_enough(points):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < deadline
            time.sleep(0.002)
        below = children(process.pid)
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stderr.close()
        while any(alive(pid) for pid in below):  # they end when their parent does, but not in no time
            assert time.monotonic() < deadline
            time.sleep(0.02)
        now = done()
        assert all(now[file] == stamp for file, stamp in finished.items()), "a finished point was written again"
        finished = now
    assert kills[-1] <= len(finished) < 20
    tiny.forget()
    tiny.hold(None)
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert process.returncode == 0, process.stderr
    assert len(tiny.computed("kinetics")) == 2 * (20 - len(finished))
    assert all(done()[file] == stamp for file, stamp in finished.items())
    assert not (out / ".parts").exists()
    # the full set of plugins was there in the other process, and is none of the tiny sweep's business
    ours, theirs = contents(tmp_path / "whole"), contents(out)
    for seen in (ours, theirs):
        for point in seen.values():
            if isinstance(point, dict) and "summary" in point:
                del point["summary"]["versions"]
    assert theirs.keys() == ours.keys()
    assert [name for name in ours if theirs[name] != ours[name] and name != "results.h5"] == []


# -- workers ----------------------------------------------------------------------------------------------------------

DEATHS = """
[[sweep.zip]]
"engine.trouble" = ["", "kill-once", "kill"]
"hold.temperature" = [300, 301, 302]
"""


# for Dask, tests/studies/sweeps/test_executors.py shows what the death of a worker costs
@pytest.mark.long
@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.campaign)])
def test_a_killed_worker_costs_its_point_a_retry_and_nothing_else(tiny, tmp_path, executor):
    scene = swept(tiny, DEATHS, hold={"times": [1.0, 10.0], "replicas": 1}, fit={"start": 1.0, "stop": 10.0})
    result = chemage.sweep(scene, tmp_path / "out", executor=executor, workers=2)
    assert result.states() == ["done", "done", "failed"]
    for point in result.failed:
        assert point.error.startswith("ageing: WorkerLost: ")
        assert "died" in point.error
    # Dask may have given a worker a task that waits behind the one it dies of, or have yet to fetch an answer from it:
    # that one is begun once more as well
    more = 1
    assert 1 <= len(tiny.computed("kinetics 300")) <= 1 + more, "what is well runs once, whoever dies beside it"
    assert 2 <= len(tiny.computed("kinetics 301")) <= 2 + more, "one death, one more try"
    assert len(tiny.computed("kinetics 302")) in (2, 3), "beside others, and twice alone"
    assert len(tiny.computed("contact")) == 1


@pytest.mark.long
@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.campaign)])
def test_a_contact_that_kills_its_workers_fails_its_points(tiny, tmp_path, executor):
    text = """
    [sweep]
    "contact.trouble" = ["kill", ""]
    "hold.seed" = [0, 1]
    """
    result = chemage.sweep(swept(tiny, text), tmp_path / "out", executor=executor, workers=2)
    assert result.states() == ["failed", "failed", "done", "done"]
    assert result[1].error.startswith("contact: WorkerLost: ")


REAL = """
[surface]
kind = "self-affine"
pixels = 48
pixel_size = "0.4518 nm"
rms_slope = 0.1
hurst = 0.8
zeta = 8
eta = 3

[contact]
kind = "fft-bem"
modulus = "35.3 GPa"
load = "40 nN"

[forming]
kind = "md-silica"

[breaking]
kind = "gaussian"
mean = "1.1 eV"
std = "0.02 eV"

[interaction]
kind = "elastic-pairs"
strength = "0.5 eV"
bias = 0.1

[engine]
kind = "rejection-free"

[hold]
start = "1 ms"
stop = "1e5 s"
per_decade = 2
replicas = 3

[[observe]]
kind = "barrier-spectrum"

[sweep]
"surface.seed" = [1, 2]
"contact.load" = ["20 nN", "60 nN"]
"chemistry.activation_volume" = [0, "6.4 angstrom**3"]
"engine.kind" = ["rejection-free", "bkl"]
"""


@pytest.mark.long
@pytest.mark.parametrize("cluster", [False, pytest.param(True, marks=pytest.mark.campaign)])
def test_every_executor_gives_the_same_bits(tmp_path, cluster):
    """Rough contact, interacting sites, both exact engines: in process, in two processes, on a cluster that runs."""
    scene = {"name": "real", **tomllib.loads(REAL)}
    chemage.sweep(scene, tmp_path / "serial")
    chemage.sweep(scene, tmp_path / "threads", threads=3)
    chemage.sweep(scene, tmp_path / "processes", executor="processes", workers=2)
    others = ["threads", "processes"]
    if cluster:
        from distributed import LocalCluster

        with LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=":0", silence_logs=60) as made:
            chemage.sweep(scene, tmp_path / "dask", executor=f"dask:{made.scheduler_address}")
        others.append("dask")
    one = contents(tmp_path / "serial")
    assert len(one) == 16 + 4 + 2
    for other in others:
        two = contents(tmp_path / other)
        assert two.keys() == one.keys()
        assert [name for name in one if two[name] != one[name]] == [], other


class Broken(Executor):
    """What a pool of the standard library does when one of its processes dies."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("a child process terminated abruptly"))
        return future


def test_an_executor_that_breaks_ends_the_sweep_and_says_so(tiny, tmp_path):
    with pytest.raises(ExecutorError, match=r"the executor gave up .*terminated abruptly.*rerun the same command"):
        chemage.sweep(swept(tiny), tmp_path / "out", executor=Broken())
    assert chemage.sweep(swept(tiny), tmp_path / "out").states() == ["done"] * 12


class Mortal(Executor):
    """Loses the worker of its first calls."""

    def __init__(self, deaths):
        self.deaths = deaths

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.deaths -= 1
        if self.deaths >= 0:
            future.set_exception(WorkerLost("a worker died"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


@pytest.mark.parametrize(("deaths", "state"), [(1, "done"), (2, "done"), (3, "failed")])
def test_a_task_is_lost_when_its_worker_died_twice_while_nothing_else_ran(tiny, tmp_path, deaths, state):
    result = chemage.sweep(swept(tiny, '[sweep]\n"hold.seed" = [0]'), tmp_path / "out", executor=Mortal(deaths))
    assert result.states() == [state]


def test_workers_that_cannot_be_had_are_told_before_anything_is_written(tiny, tmp_path, monkeypatch):
    def refuse(*, timeout, **_):
        raise TimeoutError(f"tried for {timeout} s")

    monkeypatch.setattr("distributed.Client", refuse)
    with pytest.raises(ExecutorError, match=r"no Dask scheduler answers at 127\.0\.0\.1:9 within 4 s \(tried for 4"):
        chemage.sweep(swept(tiny), tmp_path / "out", executor="dask:127.0.0.1:9")
    assert not (tmp_path / "out").exists()


class Elsewhere(ProcessPoolExecutor):
    """Its worker sees another manifest."""

    change: dict | None = None

    def submit(self, fn, /, *args, **kwargs):
        manifest = Path("out", "sweep.json")
        seen = manifest.read_bytes()
        manifest.unlink()
        if self.change is not None:
            manifest.write_bytes(chemage.plugin.container.sealed_json({**json.loads(seen), **self.change}))
        future = super().submit(fn, *args, **kwargs)
        future.exception()
        manifest.write_bytes(seen)
        return future


def test_a_worker_that_does_not_see_the_folder_says_which_and_why(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Elsewhere(1, get_context("spawn")) as executor:
        for change, said in (
            (None, r"worker .* cannot read the sweep: .* every worker must see .*out"),
            ({"digest": "0" * 32}, "finds another sweep"),
            ({"versions": {"chemage": "0.0.1"}}, r"has chemage .*, but the sweep is run by 0\.0\.1"),
        ):
            executor.change = change
            with pytest.raises(ExecutorError, match=said):
                chemage.sweep(swept(tiny), "out", executor=executor)
