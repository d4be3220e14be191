"""Executors and clusters: whatever they run on, the same answers; what keeps them from starting is one message."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from textwrap import dedent

import pytest
from distributed import Client, LocalCluster
from distributed.cfexecutor import ClientExecutor
from distributed.scheduler import KilledWorker

import chemage
from chemage import InputError
from chemage.plugin import ExecutorError, StoreError, registry, threads
from chemage.studies.runner import Pool, Processes, Serial, open_pool, seconds

# -- executors: whatever they run on, the same answers; a worker that dies costs its own task a second try ------------


WORK = """
import os, signal, sys, time

def double(x):
    return 2 * x

def whoami(_):
    return os.getpid()

def told():
    return {name: os.environ.get(name) for name in ("CHEMAGE_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS")}

def chatter(x):
    print("not an answer", flush=True)
    os.write(1, b"nor this")
    return x

def wrong(x):
    raise KeyError(x)

def refuse(*_):
    raise RuntimeError("no such interpreter")

def die(how=signal.SIGKILL):
    os.kill(os.getpid(), how)

def leave(status):
    os._exit(status)

def die_once(marker):
    if not os.path.exists(marker):
        open(marker, "w").close()
        die()
    return os.getpid()

def slowly(x, seconds):
    time.sleep(seconds)
    return x
"""


@pytest.fixture
def work(tmp_path, monkeypatch):
    """Functions that a worker can import."""
    (tmp_path / "chemage_work.py").write_text(WORK)
    monkeypatch.syspath_prepend(str(tmp_path))
    import chemage_work  # pyright: ignore[reportMissingImports]

    yield chemage_work
    sys.modules.pop("chemage_work", None)


@pytest.fixture
def processes():
    with Processes(2) as made:
        yield made


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as stream:
        return stream.read().rpartition(")")[2].split()[0] != "Z"


def gone(pids, seconds=300.0):
    """Whether all of ``pids`` end in time."""
    deadline = time.monotonic() + seconds
    while any(alive(pid) for pid in pids):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


# -- serial -----------------------------------------------------------------------------------------------------------


def test_serial_runs_at_once_and_keeps_errors_for_later(work):
    with Serial() as serial:
        assert serial.submit(work.double, 3).result() == 6
        assert list(serial.map(work.double, range(3))) == [0, 2, 4]
        with pytest.raises(KeyError):
            serial.submit(work.wrong, 1).result()


# -- processes --------------------------------------------------------------------------------------------------------


def test_processes_answer(work, processes):
    assert list(processes.map(work.double, range(20))) == [2 * x for x in range(20)]
    pids = set(processes.map(work.whoami, range(20)))
    assert os.getpid() not in pids
    assert 1 <= len(pids) <= 2
    assert processes.submit(work.chatter, 5).result() == 5, "what is printed does not get into the answers"


def test_errors_come_back_as_themselves(work, processes):
    with pytest.raises(KeyError, match="7"):
        processes.submit(work.wrong, 7).result()
    assert processes.submit(work.double, 1).result() == 2


@pytest.mark.long
def test_a_task_whose_process_dies_says_how_and_others_run_in_new_ones(work, processes):
    with pytest.raises(BrokenProcessPool, match=r"SIGKILL\(-9\)"):
        processes.submit(work.die).result(300)
    assert processes.submit(work.double, 4).result(300) == 8
    with pytest.raises(BrokenProcessPool, match=r"EXIT\(3\)"):
        processes.submit(work.leave, 3).result(300)
    assert processes.submit(work.double, 5).result(300) == 10


def test_an_interruption_leaves_the_tasks_to_the_pool_that_ends(tiny, tmp_path, monkeypatch):
    """It gives them an error, and cannot where they are cancelled: then its thread would end in a traceback."""
    calls = []
    cancel, abort = Future.cancel, Pool.abort

    def stop(progress):
        if progress.stage != "validating":
            raise KeyboardInterrupt

    monkeypatch.setattr(Future, "cancel", lambda self: (calls.append("cancelled"), cancel(self))[1])
    monkeypatch.setattr(Pool, "abort", lambda self: (calls.append("ended"), abort(self))[1])
    scene = tiny.scene() | {"sweep": {"hold.temperature": [300, 310]}}
    with pytest.raises(KeyboardInterrupt):
        chemage.sweep(scene, tmp_path / "out", executor="processes", workers=2, progress=stop)
    assert calls[0] == "ended"


def test_abort_ends_what_runs(work):
    processes = Processes(2)
    pids = [future.result() for future in [processes.submit(work.whoami, 0)]]
    running = [processes.submit(work.slowly, x, 600) for x in range(4)]
    processes.shutdown(cancel_futures=True)
    assert gone(pids)
    wait(running, timeout=300)
    # had it waited for them, they would have answers
    assert all(future.cancelled() or future.exception() for future in running)


@pytest.mark.long
def test_processes_end_when_their_parent_is_killed(work, tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        dedent(f"""
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import chemage_work
        from chemage.studies.runner import Processes
        made = Processes(2)
        print(*made.map(chemage_work.whoami, range(8)), flush=True)
        [made.submit(chemage_work.slowly, 1, 600) for _ in range(2)]
        import time
        time.sleep(600)
        """)
    )
    # no `if __name__ == "__main__"` above: processes do not run the script again
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    pids = {int(word) for word in parent.stdout.readline().split()}
    assert pids
    assert all(alive(pid) for pid in pids)
    time.sleep(0.2)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert gone(pids)


def test_ctrl_c_does_not_reach_the_processes(work, processes):
    pid = processes.submit(work.whoami, 0).result()
    os.kill(pid, signal.SIGINT)
    assert processes.submit(work.double, 1).result() == 2


def test_a_process_knows_its_share_of_threads(work):
    with Processes(1, threads=3) as processes:
        assert set(processes.submit(work.told).result().values()) == {"3"}
        assert processes.submit(threads.available).result() == 3


def test_no_process_no_answer(tiny, work, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("chemage.studies.runner._begin", work.refuse)
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    with pytest.raises(ExecutorError, match=r"a worker process could not start.*rerun the same command"):
        chemage.sweep(scene, tmp_path / "out", executor="processes", workers=1)
    assert "no such interpreter" in capfd.readouterr().err


STRAY = """
import chemage

@chemage.plugin.hookimpl(wrapper=True)
def chemage_rupture_bonds():
    return 2 * (yield)
"""
SWEEPS = """
import chemage

if __name__ == "__main__":
    scene = {scene}
    for executor in ("serial", "threads", "processes", "dask"):
        workers = None if executor == "serial" else 2
        sweep = chemage.sweep(scene, executor, executor=executor, workers=workers)
        print(executor, [(point.ageing().digest(), *point.summary["plugins"]) for point in sweep])
"""


@pytest.mark.long
def test_what_lies_in_the_folder_takes_no_part_in_any_worker(tmp_path):
    (tmp_path / "stray.egg-info").mkdir()
    (tmp_path / "stray.egg-info" / "PKG-INFO").write_text("Metadata-Version: 2.1\nName: stray\nVersion: 1.0\n")
    (tmp_path / "stray.egg-info" / "entry_points.txt").write_text("[chemage]\nstray = stray\n")
    (tmp_path / "stray.py").write_text(STRAY)
    sweep = {"contact.load": ["20 nN", "50 nN"], "hold.replicas": [1]}
    scene = {**chemage.load_scene("silica-tip").todict(), "sweep": sweep}
    code = SWEEPS.format(scene=repr(scene))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert [*found] == ["serial", "threads", "processes", "dask"]
    assert len(set(found.values())) == 1
    assert "stray" not in done.stdout + done.stderr


def test_a_worker_uses_the_plugins_of_the_study_and_says_what_it_lacks(tiny, tmp_path, monkeypatch):
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    more = (*registry.current().installed(), ("wear", "chemage-wear 2.0"))
    monkeypatch.setattr(registry.Registry, "installed", lambda self: more)
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0") as made,
        pytest.raises(ExecutorError, match=r"worker .*'wear' \(chemage-wear 2\.0\) is not installed in this process"),
    ):
        chemage.sweep(scene, tmp_path / "out", executor=f"dask:{made.scheduler_address}")


# -- pools ------------------------------------------------------------------------------------------------------------


def test_serial_has_all_threads_and_processes_one_each(monkeypatch):
    monkeypatch.setattr(threads, "processors", lambda: 4)
    monkeypatch.delenv("CHEMAGE_THREADS", raising=False)
    threads.limit(None)
    with open_pool("serial") as pool:
        assert (pool.threads, pool.width()) == (4, 1)
    with open_pool("processes") as pool:
        assert (pool.threads, pool.width()) == (1, 4)
    with open_pool("processes", threads=3) as pool:
        assert (pool.threads, pool.width()) == (3, 1)
    with open_pool("processes", workers=2, threads=2) as pool:
        assert (pool.threads, pool.width()) == (2, 2)


def test_processors_are_not_asked_for_twice(monkeypatch):
    monkeypatch.setattr(threads, "processors", lambda: 4)
    with (
        pytest.raises(InputError, match="workers = 2 with threads = 3 each: that is more than the 4 processors"),
        open_pool("processes", workers=2, threads=3),
    ):
        pass


@pytest.mark.parametrize(
    ("executor", "options", "message"),
    [
        ("prozesses", {}, r"no such executor \(did you mean 'processes'\?\); choose serial, threads, processes, dask"),
        ("serial:x", {}, "no such executor"),
        ("serial", {"workers": 3}, "serial runs one task at a time"),
        ("processes", {"workers": 0}, "must be a whole number of at least 1"),
        ("processes", {"threads": -1}, "must be a whole number of at least 1"),
        ("processes", {"workers": True}, "must be a whole number of at least 1"),
    ],
)
def test_wrong_executors_are_refused(executor, options, message):
    with pytest.raises(InputError, match=message), open_pool(executor, **options):
        pass


def test_any_executor_will_do(work):
    with ThreadPoolExecutor(3) as mine, open_pool(mine) as pool:
        assert pool.width() == 3
        assert pool.threads == 1
        assert pool.executor.submit(work.double, 2).result() == 4


def test_a_sweep_leaves_the_threads_of_its_process_alone(tiny, tmp_path):
    threads.limit(7)
    chemage.sweep({**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}, tmp_path / "out", threads=1)
    assert threads.available() == 7
    threads.limit(None)


def test_the_limit_on_threads_holds_until_it_is_taken_away(monkeypatch):
    monkeypatch.setenv("CHEMAGE_THREADS", "5")
    threads.limit(None)
    assert threads.available() == 5
    threads.limit(2)
    assert threads.available() == 2
    threads.limit(None)
    monkeypatch.setenv("CHEMAGE_THREADS", "many")
    assert threads.available() == threads.processors()


# -- Dask -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "said"), [pytest.param(None, "4", marks=pytest.mark.long), (0.5, r"0\.5")])
def test_an_address_that_does_not_answer_is_told_in_seconds(monkeypatch, seconds, said):
    if seconds is not None:
        monkeypatch.setattr("chemage.studies.runner.ANSWER_TIME", seconds)
    with (
        pytest.raises(ExecutorError, match=rf"no Dask scheduler answers at tcp://127\.0\.0\.1:9 within {said} s"),
        open_pool("dask:tcp://127.0.0.1:9"),
    ):
        pass


def test_a_missing_scheduler_file_is_told():
    with pytest.raises(StoreError, match=r"scheduler file gone\.json does not exist"), open_pool("dask:gone.json"):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ExecutorError, match=r"pip install 'chemage\[dask\]'"), open_pool("dask"):
        pass


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A pool on a cluster of this machine."""
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "chemage_work.py").write_text(WORK)
    sys.path.insert(0, str(folder))
    import chemage_work  # pyright: ignore[reportMissingImports]

    with pytest.MonkeyPatch.context() as patch:
        # what the user has set is no part of a test
        patch.delenv("OMP_NUM_THREADS", raising=False)
        with open_pool("dask", workers=2) as pool:
            yield pool, chemage_work
    sys.path.remove(str(folder))
    sys.modules.pop("chemage_work", None)


def test_a_cluster_answers(cluster):
    pool, work = cluster
    assert [pool.executor.submit(work.double, x).result(300) for x in range(5)] == [0, 2, 4, 6, 8]
    with pytest.raises(KeyError):
        pool.executor.submit(work.wrong, 1).result(300)
    assert set(pool.executor.submit(work.told).result(300).values()) == {"1"}
    assert pool.width() == 2


@pytest.mark.long
def test_dask_says_which_task_killed_its_worker(cluster):
    """The runner of a study tries it again, beside nothing else: tests/extremes/test_sweep.py."""
    pool, work = cluster
    with pytest.raises(KilledWorker, match=r"on 1 different workers, but all those workers died"):
        pool.executor.submit(work.die).result(300)
    assert pool.executor.submit(work.double, 21).result(300) == 42


@pytest.mark.long
def test_a_scheduler_that_goes_away_ends_the_sweep_in_words(tiny, tmp_path, capfd):
    tiny.hold(4, 5)  # one point at least, and then there is time for the scheduler to go
    cluster = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=60)
    lost = []

    def tell(state):
        if state.stage == "computing" and state.done and not lost:
            lost.append(state)
            cluster.close()

    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1, 2, 3, 4, 5]}}
    where = f"dask:{cluster.scheduler_address}"
    with pytest.raises(ExecutorError, match=r"scheduler is gone.*; completed points are kept; rerun the same command"):
        chemage.sweep(scene, tmp_path / "out", executor=where, progress=tell)
    assert "Traceback" not in capfd.readouterr().err
    done = chemage.load_sweep(tmp_path / "out").states().count("done")
    assert 1 <= done < 6
    tiny.forget()
    tiny.hold(None)
    assert chemage.sweep(scene, tmp_path / "out").states() == ["done"] * 6
    assert len(tiny.computed("kinetics")) == 2 * (6 - done)


def test_a_scheduler_that_has_gone_when_a_task_is_handed_over(tiny, tmp_path, monkeypatch):
    made = LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=":0", silence_logs=60)
    submit = ClientExecutor.submit

    def late(executor, *args, **options):
        made.close()
        executor._client.close()
        return submit(executor, *args, **options)

    monkeypatch.setattr(ClientExecutor, "submit", late)
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    with pytest.raises(ExecutorError, match=r"scheduler is gone.*; completed points are kept; rerun the same command"):
        chemage.sweep(scene, tmp_path / "out", executor=f"dask:{made.scheduler_address}")


@pytest.mark.long
def test_a_worker_of_a_cluster_of_our_own_that_dies_is_replaced():
    with open_pool("dask", workers=1) as pool:
        first = pool.executor.submit(os.getpid).result(300)
        with pytest.raises(KilledWorker):
            pool.executor.submit(os._exit, 3).result(300)
        assert pool.executor.submit(os.getpid).result(300) != first


@pytest.mark.parametrize("error", [AttributeError("ncores"), OSError(), RuntimeError()])
def test_a_client_that_has_just_lost_its_scheduler_gives_no_answer(monkeypatch, error):
    def lost(_):
        raise error

    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=":0") as made,
        open_pool(f"dask:{made.scheduler_address}") as pool,
    ):
        monkeypatch.setattr("distributed.Client.nthreads", lost)
        assert pool.width() == 1


def test_a_first_worker_is_waited_for_as_long_as_said(tiny, tmp_path):
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=":0") as made:
        where = f"dask:{made.scheduler_address}"
        with pytest.raises(ExecutorError, match=r"no worker for 1 s.*--patience"):
            chemage.sweep(scene, tmp_path / "out", executor=where, patience="1 s")
    assert not (tmp_path / "out").exists()


def test_the_executor_of_a_client_will_do(tiny, tmp_path):
    scene = {**tiny.scene(), "sweep": {"hold.seed": [0, 1]}}
    with LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as made, Client(made) as client:
        result = chemage.sweep(scene, tmp_path / "out", executor=client.get_executor(pure=False))
    assert result.states() == ["done", "done"]


@pytest.mark.parametrize(("value", "expected"), [(3, 3.0), ("3", 3.0), ("2 min", 120.0), ("1.5 h", 5400.0)])
def test_patience_in_any_unit(value, expected):
    assert seconds(value) == expected


@pytest.mark.parametrize(
    "address", ["tcp://", "tcp://node17", "tcp://node17:", "tls://:8786", "cluster.yaml", "dask_jobqueue.SLURMCluster"]
)
def test_an_address_needs_host_and_port(address):
    with (
        pytest.raises(
            InputError, match=r"is no address with host and port.*dask-jobqueue, and write dask:tcp://host:8786"
        ),
        open_pool(f"dask:{address}"),
    ):
        pass
