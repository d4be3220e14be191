"""`chemage run`, `check` and `status` where a scene is a sweep."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time

import faults
import pytest
from seen import show_progress

import chemage
from chemage.plugin import progress, text

SCENE = """
name = "study"

[surface]
kind = "tiny-tip"

[contact]
kind = "tiny-even"
load = 10.0

[forming]
kind = "tiny-flat"

[engine]
kind = "tiny-coin"

[hold]
times = [1.0, 10.0, 100.0]
replicas = 2

[fit]
start = 1.0
stop = 100.0

[sweep]
"contact.load" = ["5 nN", 20]
"hold.seed" = [0, 1, 2]
"""


@pytest.fixture
def scene(tiny, tmp_path, monkeypatch):
    """The file of a sweep of six points, in an empty working folder."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    file = folder / "study.toml"
    file.write_text(SCENE)
    return file


def rows(text):
    """First cell of each line of a table -> the other cells."""
    cells = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    return {line[0]: line[1:] for line in cells}


def beta_of(point):
    return text.plus_minus(point.summary["beta"], point.summary["beta_half_width"])


def test_run_fills_a_folder_and_says_what_came_out(command, scene, tiny):
    outcome = command("run", scene)
    assert outcome.status == 0
    assert "6 of 6 points done, 2 contacts" in outcome.out
    assert "load (nN)" in outcome.out
    assert "study-sweep/results.csv" in outcome.out
    result = chemage.load_sweep("study-sweep")
    assert result.states() == ["done"] * 6
    assert command("show", "study-sweep").out.rstrip() in outcome.out
    tiny.forget()
    again = command("run", scene)
    assert again.status == 0
    assert again.out == outcome.out
    assert tiny.computed() == []


def test_run_json_is_one_object(command, scene):
    outcome = command("run", scene, "--out", "here", "--json")
    told = json.loads(outcome.out)
    assert (told["points"], told["done"], told["failed"], told["missing"]) == (6, 6, 0, 0)
    assert told["results"]["csv"].endswith("here/results.csv")


def test_changes_go_below_the_sweep(command, scene):
    assert command("run", scene, "--set", "surface.height=3.0", "--replicas", 1, "--seed", 7).status == 0
    result = chemage.load_sweep("study-sweep")
    made = result[1].scene()
    assert (made.surface.height, made.hold.replicas, made.hold.seed) == (3.0, 1, 1), "what is swept wins"


def test_check_counts_and_computes_nothing(command, scene, tiny):
    outcome = command("check", scene)
    assert outcome.status == 0
    lines = rows(outcome.out)
    assert lines["points"] == ["6 (2 x 3)"]
    assert lines["contacts to solve"] == ["2 on 1 surfaces"]
    assert lines["expected cost"] == ["about 0.17 s of CPU time once kernels are compiled"]
    assert "free here" in lines["expected disk space"][0]
    assert tiny.computed() == []
    told = json.loads(command("check", scene, "--json").out)
    assert (told["points"], told["contacts"], told["surfaces"]) == (6, 2, 1)
    assert told["axes"] == {"contact.load": 2, "hold.seed": 3}
    one = scene.with_name("one.toml")
    one.write_text(SCENE.partition("[sweep]")[0])
    cpu_seconds = json.loads(command("check", one, "--json").out)["cpu_seconds"]
    assert told["cpu_seconds"] == pytest.approx(0.02 + 6 * (cpu_seconds - 0.01), rel=0.01)
    assert told["disk"] > 10_000


def test_status_tells_each_axis(command, scene):
    command("run", scene)
    result = chemage.load_sweep("study-sweep")
    result.store.point(result.keys[4]).unlink()
    outcome = command("status", "study-sweep")
    assert outcome.status == 0
    lines = rows(outcome.out)
    assert lines["contact.load = 20"] == ["3", "2", "0", "1", "0"]
    assert lines["hold.seed = 1"] == ["2", "1", "0", "1", "0"]
    assert lines["all"] == ["6", "5", "0", "1", "0"]
    told = json.loads(command("status", "study-sweep", "--json").out)
    assert (told["done"], told["missing"], told["contacts_done"]) == (5, 1, 2)


def test_status_of_no_sweep_is_an_error(command, scene):
    outcome = command("status", ".")
    assert outcome.status == 2
    assert "is not the folder of a sweep" in outcome.err


def test_failed_points_are_listed_at_the_end_with_exit_status_1(command, scene):
    scene.write_text(SCENE + '"engine.trouble" = ["", "raise"]\n')
    outcome = command("run", scene)
    assert outcome.status == 1
    assert "6 of 12 points done" in outcome.out
    lines = [line for line in outcome.err.splitlines() if line.startswith("failed:")]
    assert len(lines) == 6
    assert lines[0].startswith(
        "failed: point 1 (contact.load = 5 nN, hold.seed = 0, engine.trouble = raise): "
        "ageing: InputError: this one is meant to fail; in engine 'tiny-coin' of plugin 'tiny' (chemage-tiny 1.0): "
    )
    assert command("status", "study-sweep").err.splitlines() == lines
    told = json.loads(command("run", scene, "--json").out)
    assert [one["point"] for one in told["failures"]] == [1, 3, 5, 7, 9, 11]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--executor", "cloud"), "executor = 'cloud': no such executor; choose serial, threads, processes"),
        (("--executor", "serial", "--workers", "2"), "serial runs one task at a time"),
        (("--executor", "dask:nowhere.Cluster"), "is no address with host and port"),
        (("--set", "contact.load=1", "--set", "contact.x=1"), "contact.x: no such option"),
    ],
)
def test_wrong_words_leave_nothing_behind(command, scene, words, message):
    outcome = command("run", scene, *words)
    assert outcome.status == 2
    assert message in outcome.err
    assert list(scene.parent.iterdir()) == [scene]


def test_words_for_sweeps_are_refused_for_one_point(command, scene):
    scene.write_text(SCENE.partition("[sweep]")[0])
    outcome = command("run", scene, "--executor", "processes")
    assert outcome.status == 2
    assert "--executor is for sweeps and for means over surfaces" in outcome.err


def test_another_sweep_is_not_overwritten_without_force(command, scene):
    assert command("run", scene).status == 0
    scene.write_text(SCENE.replace("[0, 1, 2]", "[0, 1, 3]"))
    outcome = command("run", scene)
    assert outcome.status == 2
    assert "study-sweep holds another sweep (2 of its 6 points differ); choose another folder" in outcome.err
    assert command("run", scene, "--force").status == 0
    assert chemage.load_sweep("study-sweep")[2].changes["hold.seed"] == 3


def test_many_points_need_a_word_without_a_terminal(command, scene, monkeypatch):
    faults.many_points(monkeypatch, 5)
    outcome = command("run", scene)
    assert outcome.status == 2
    assert "the sweep has 6 points (2 x 3); nothing was computed. Reduce the sweep, or confirm it (--yes" in outcome.err
    assert command("run", scene, "--yes").status == 0


# -- in a process of its own ------------------------------------------------------------------------------------------


def chemage_command(*words):
    return [sys.executable, "-m", "chemage", *map(str, words)]


def slow(scene, seconds=0.05):
    scene.write_text(SCENE.replace('kind = "tiny-coin"', f'kind = "tiny-coin"\npause = {seconds}'))


@pytest.mark.long
@pytest.mark.parametrize("executor", ["serial", "processes", pytest.param("dask", marks=pytest.mark.campaign)])
def test_ctrl_c_keeps_what_is_finished(scene, tiny, executor, command):
    tiny.hold(4, 5)  # two points at least, and then there is time to interrupt
    words = chemage_command("run", scene, "--executor", executor)
    if executor != "serial":  # with a worker for each point, all might be done at the same time
        words += ["--workers", "2"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(words, text=True, start_new_session=True, **pipes)
    deadline = time.monotonic() + 300
    while not list(scene.parent.glob("study-sweep/points/*/*.json")):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to everything in the foreground
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert out == ""
    assert "points are done and kept in study-sweep; rerun the same command to resume" in err
    assert "Traceback" not in err
    done = chemage.load_sweep("study-sweep").states().count("done")
    assert 0 < done < 6
    assert f"interrupted; {done} of 6 points" in err
    tiny.forget()
    tiny.hold(None)
    slow(scene, 0)  # speed is no part of what a sweep is
    assert command("run", scene).status == 0
    assert len(tiny.computed("kinetics")) == 2 * (6 - done)


def test_without_a_terminal_a_line_tells_how_far_it_is(scene, monkeypatch, capsys):
    monkeypatch.setattr(progress, "SILENCE", 0.1)
    slow(scene, 0.3)
    with show_progress() as tell:
        chemage.sweep(scene, "out", progress=tell)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    assert any(re.fullmatch(r"points: points \d/6, .* s left, \d+ s", line) for line in lines)


def on_a_terminal(words, answer=""):
    """Exit status and everything that a command shows on a terminal of its own."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(words[0], words)
    seen = b""
    while True:
        try:
            piece = os.read(terminal, 4096)
        except OSError:
            break
        if not piece:
            break
        seen += piece
        if answer and b"[y/N]" in seen:
            os.write(terminal, answer.encode())
            answer = ""
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status), seen.decode()


@pytest.mark.long
@pytest.mark.parametrize(("answer", "status"), [("n\n", 2), ("y\n", 0)])
def test_a_terminal_is_asked_and_then_shows_bars(scene, answer, status):
    slow(scene, 0.1)
    limit = (
        "from chemage.cli.app import main; from chemage.studies.sweeps import running; running.MANY_POINTS = 5; main()"
    )
    words = [sys.executable, "-c", limit, "run", str(scene)]
    code, seen = on_a_terminal(words, answer)
    assert "the sweep has 6 points (2 x 3); continue? [y/N]" in seen
    assert code == status
    assert (scene.parent / "study-sweep").exists() == (status == 0)
    for shown in ("contacts", "━", "s left", "6 of 6 points done"):
        assert (shown in seen) == (status == 0), shown
