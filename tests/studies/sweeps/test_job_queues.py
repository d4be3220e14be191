"""Clusters that submit jobs: what keeps them from starting is one message, in seconds; a fake ``sbatch`` runs jobs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import chemage
from chemage import InputError
from chemage.plugin import ExecutorError
from chemage.studies import clusters
from chemage.studies.clusters import Dask, seconds
from chemage.studies.runner import open_pool

STUBS = Path(__file__).parents[2] / "stubs"
WORDS = "Batch job submission failed: Invalid account or account/partition combination specified"
REFUSES = f'#!/bin/sh\necho "sbatch: error: {WORDS}" >&2\nexit 1\n'
NEVER = "#!/bin/sh\necho Submitted batch job 17\n"
RUNS = """#!/bin/sh
cp "$1" "$HERE/$$.sh"
sh "$HERE/$$.sh" > "$HERE/$$.log" 2>&1 < /dev/null &
echo "Submitted batch job $!"
"""
CANCELS = '#!/bin/sh\necho "$1" >> "$HERE/cancelled"\nkill "$1" 2> /dev/null\nexit 0\n'


@pytest.fixture
def queue(tmp_path, monkeypatch):
    """``queue(text)`` puts a program ``sbatch`` on the PATH; the cluster file is in the working folder."""
    programs = tmp_path / "bin"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    monkeypatch.setenv("HERE", str(programs))
    monkeypatch.setenv("CHEMAGE_CLUSTERS", "job_queue.Queue")
    monkeypatch.syspath_prepend(str(STUBS))
    monkeypatch.setenv("PYTHONPATH", str(STUBS), prepend=os.pathsep)
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    (work / "cluster.toml").write_text('cluster = "job_queue.Queue"\nworkers = 2\n')

    def install(text):
        for name, content in (("sbatch", text), ("scancel", CANCELS)):
            (programs / name).write_text(content)
            (programs / name).chmod(0o755)
        return programs

    return install


def fails(message, executor="dask:cluster.toml", **options):
    """The error of a pool that cannot be opened, after which no thread is left that keeps a program alive."""
    before = {thread for thread in threading.enumerate() if not thread.daemon}
    begin = time.monotonic()
    with pytest.raises(ExecutorError, match=message) as caught, open_pool(executor, **options):
        pass
    assert "\n" not in str(caught.value)
    assert {thread for thread in threading.enumerate() if not thread.daemon} <= before
    return time.monotonic() - begin


def test_without_sbatch_the_program_is_named(queue, monkeypatch):
    assert shutil.which("sbatch") is None
    fails(r"jobs cannot be submitted: the program sbatch is not on the PATH: run this on a login node")


@pytest.mark.parametrize("more", ["workers = 2", "adapt = { minimum = 0, maximum = 4 }"])
def test_what_sbatch_says_is_quoted(queue, capfd, more):
    queue(REFUSES)
    Path("cluster.toml").write_text(f'cluster = "job_queue.Queue"\n{more}\n')
    fails(f"jobs cannot be submitted: RuntimeError: .*Exit code: 1 .*stderr: sbatch: error: {WORDS}$")
    assert "Traceback" not in capfd.readouterr().err


def test_an_sbatch_that_does_not_return_is_an_error(queue, monkeypatch):
    monkeypatch.setattr(clusters, "SUBMIT_TIME", 0.5)
    queue("#!/bin/sh\nexec sleep 3\n")
    fails("submitting jobs has taken more than 0 s; check that the scheduler of the cluster answers")


def test_a_cluster_without_a_number_of_workers_is_refused(queue):
    queue(RUNS)
    with (
        pytest.raises(
            InputError, match="starts without workers; say how many: --workers, or workers or adapt in its file"
        ),
        open_pool("dask:job_queue.Queue"),
    ):
        pass


def test_jobs_that_do_not_start_are_waited_for_as_long_as_said(queue, tiny, capfd):
    queue(NEVER)
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    with pytest.raises(ExecutorError, match=r"no worker for \d s: its jobs have not started.*--patience"):
        chemage.sweep(scene, "out", executor="dask:cluster.toml", patience="1 s")
    assert "Traceback" not in capfd.readouterr().err
    Path("cluster.toml").write_text('cluster = "job_queue.Queue"\nworkers = 1\npatience = "1500 ms"\n')
    with pytest.raises(ExecutorError, match=r"no worker for \d s"):
        chemage.sweep(scene, "out", executor="dask:cluster.toml")
    assert chemage.sweep(scene, "out").states() == ["done", "done"]


class Deserted:
    """A Dask client without workers."""

    def get_executor(self, pure):
        return self

    def nthreads(self):
        return {}


def test_jobs_that_may_be_queued_are_waited_for_with_a_warning(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    pool = Dask(Deserted())
    now[0] += 50
    assert pool.width() == 1
    now[0] += 50
    with pytest.warns(
        UserWarning, match="no worker for 100 s: its jobs may be queued; waiting for them, without limit"
    ):
        pool.width()
    for _ in range(100):
        now[0] += 1e4
        pool.width()


@pytest.mark.parametrize(("value", "expected"), [(3, 3.0), ("3", 3.0), ("2 min", 120.0), ("1.5 h", 5400.0)])
def test_patience_in_any_unit(value, expected):
    assert seconds(value) == expected


@pytest.mark.parametrize("address", ["tcp://", "tcp://node17", "tcp://node17:", "tls://:8786"])
def test_an_address_needs_host_and_port(address):
    with (
        pytest.raises(InputError, match="has no host and port; write it as dask:tcp://host:8786"),
        open_pool(f"dask:{address}"),
    ):
        pass


def command(*words, timeout=300):
    begin = time.monotonic()
    words = [sys.executable, "-m", "chemage.cli", *words]
    done = subprocess.run(words, capture_output=True, text=True, timeout=timeout)
    return done, time.monotonic() - begin


@pytest.fixture
def study(queue, tiny):
    text = "\n".join(
        f"{name} = {value!r}" if name == "name" else f"[{name}]\n" + "\n".join(f"{k} = {v!r}" for k, v in value.items())
        for name, value in tiny.scene().items()
    )
    Path("study.toml").write_text(f'{text}\n[sweep]\n"hold.seed" = [0, 1, 2, 3]\n')


@pytest.mark.long
@pytest.mark.parametrize("script", [None, REFUSES])
def test_the_program_ends_with_one_message_and_status_2(study, queue, script):
    if script is not None:
        queue(script)
    done, _ = command("run", "study.toml", "--out", "out", "--executor", "dask:cluster.toml", timeout=120)
    assert done.returncode == 2
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    said = [line for line in lines if "warning:" not in line and not line.startswith("loading chemage")]
    assert len(said) == 1, done.stderr
    assert not Path("out").exists()


@pytest.mark.long
def test_a_sweep_through_sbatch(study, queue, tiny):
    programs = queue(RUNS)
    done, _ = command("sweep", "study.toml", "--out", "out", "--executor", "dask:cluster.toml", "--patience", "5 min")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert chemage.load_sweep("out").states() == ["done"] * 4
    assert len((programs / "cancelled").read_text().split()) == 2, "its jobs are cancelled at the end"
