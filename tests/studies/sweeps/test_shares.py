"""Shares of a sweep: many processes, one folder; each task is computed once; the tables are those of one process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from seen import read_grid, survey_of

import chemage
from chemage import InputError
from chemage.plugin import StoreError
from chemage.studies.folder import Folder
from chemage.studies.study import Selection, in_ranges
from chemage.studies.sweeps.grid import agree, partition, points_of, shares_cost

AXES = {"surface.seed": [1, 2], "contact.load": [5.0, 10.0], "hold.seed": [0, 1, 2, 3]}


@pytest.fixture
def scene(tiny):
    """A sweep of 16 points on four contacts."""
    return {**tiny.scene(), "sweep": AXES}


@pytest.fixture
def found(scene):
    return survey_of(read_grid(scene))


def tables(folder):
    return [(Path(folder) / name).read_bytes() for name in ("results.csv", "results.h5")]


# -- which points -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "share", "ranges"),
    [
        ("3/16", (3, 16), ()),
        (" 1 / 1 ", (1, 1), ()),
        ("7", None, ((7, 7),)),
        ("3, 7,12-20", None, ((3, 3), (7, 7), (12, 20))),
    ],
)
def test_shares_and_numbers_are_read(text, share, ranges):
    selection = Selection.read(text)
    assert (selection.share, selection.ranges) == (share, ranges)
    assert Selection.read(str(selection)) == selection


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0/16", "no share 0 of 16; shares count from 1"),
        ("17/16", "no share 17 of 16"),
        ("three", "not understood; write the third of 16 shares as 3/16"),
        ("-3", "not understood"),
        ("7-3", "7-3 ends before it begins"),
        ("1/16/2", "not understood"),
        ("1,,2", "not understood"),
    ],
)
def test_wrong_selections_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        Selection.read(text)


SLURM = {"SLURM_ARRAY_TASK_MIN": "0", "SLURM_ARRAY_TASK_MAX": "30", "SLURM_ARRAY_TASK_STEP": "2"}


@pytest.mark.parametrize(
    ("text", "environment", "share"),
    [
        ("auto", {"SLURM_ARRAY_TASK_ID": "4", "SLURM_ARRAY_TASK_COUNT": "16", **SLURM}, (3, 16)),
        ("auto/20", {"SLURM_ARRAY_TASK_ID": "4", **SLURM}, (4, 20)),
        ("auto/16", {"PBS_ARRAY_INDEX": "3"}, (3, 16)),
        ("auto/16", {"PBS_ARRAYID": "3"}, (3, 16)),
        ("auto", {"SGE_TASK_ID": "3", "SGE_TASK_FIRST": "1", "SGE_TASK_LAST": "16", "SGE_TASK_STEPSIZE": "1"}, (3, 16)),
        ("auto/16", {"LSB_JOBINDEX": "16", "SGE_TASK_ID": "undefined"}, (16, 16)),
    ],
)
def test_the_share_of_a_job_array(text, environment, share):
    assert Selection.read(text, environment).share == share


@pytest.mark.parametrize(
    ("text", "environment", "message"),
    [
        ("auto", {}, "no task of a job array: none of SLURM_ARRAY_TASK_ID, PBS_ARRAY_INDEX"),
        (
            "auto",
            {"PBS_ARRAY_INDEX": "3"},
            r"PBS_ARRAY_INDEX does not say how many.*auto/16, or --points \$PBS_ARRAY_INDEX/16",
        ),
        ("auto", {"SLURM_ARRAY_TASK_ID": "4", "SLURM_ARRAY_TASK_COUNT": "3", **SLURM}, "are no range"),
        ("auto", {"SLURM_ARRAY_TASK_ID": "4"}, "SLURM_ARRAY_TASK_ID does not say how many"),
        ("auto/16", {"PBS_ARRAY_INDEX": "0"}, "PBS_ARRAY_INDEX is 0, which is no share of 16; number the tasks from 1"),
        ("auto/16", {"PBS_ARRAY_INDEX": "3", "SLURM_ARRAY_TASK_ID": "4"}, "are both set"),
        ("auto/x", {"PBS_ARRAY_INDEX": "3"}, "not understood"),
    ],
)
def test_an_array_that_is_not_clear_is_refused(text, environment, message):
    with pytest.raises(InputError, match=message):
        Selection.read(text, environment)


def test_numbers_as_ranges():
    assert in_ranges([7, 3, 12, 13, 14]) == "3,7,12-14"
    assert in_ranges([]) == ""


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 16, 40])
def test_every_point_is_in_one_share_and_shares_are_alike(found, count):
    of = partition(found, count)
    assert all(1 <= share <= count for share in of)
    sizes = Counter(of)
    assert max(sizes.values()) - min(sizes.values()) <= 4, "at most the points of one contact"
    assert len(sizes) == min(count, 16)
    if count in (1, 2, 4):
        assert (
            len({(share, contact) for share, contact in zip(of, [task.contact for task in found.tasks], strict=True)})
            == 4
        ), "no contact is in two shares"
    assert sum(one.points for one in shares_cost(found, count)) == 16
    assert partition(found, count) == of


def test_points_with_the_same_kinetics_are_in_one_share(tiny):
    found = survey_of(read_grid({**tiny.scene(), "sweep": {"hold.seed": [0, 1, 2], "fit.start": [1.0, 2.0, 3.0]}}))
    ageings = [task.ageing for task in found.tasks]
    of = dict(zip(ageings, partition(found, 5), strict=True))
    assert [of[ageing] for ageing in ageings] == partition(found, 5)


def test_the_first_process_decides_the_division(found, tmp_path):
    folder = Folder(tmp_path)
    folder.make_parts()
    agree(folder, found, 3)
    file = tmp_path / ".shares" / "of-3.json"
    before = file.read_bytes()
    found.tasks[0] = replace(found.tasks[0], ageing_seconds=1e6)  # another machine has other estimates
    agree(folder, found, 3)
    assert file.read_bytes() == before

    def of_all():
        return sorted(point for share in (1, 2, 3) for point in points_of(Selection(share=(share, 3)), folder, found))

    assert of_all() == list(range(16))
    file.write_bytes(before.replace(b"1", b"2", 3))
    agree(folder, found, 3)
    assert of_all() == list(range(16))


# -- one folder -------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_shares_one_after_the_other_give_the_tables_of_one_process(tiny, scene, tmp_path):
    chemage.sweep(scene, tmp_path / "whole")
    tiny.forget()
    for share in (3, 1, 2):
        result = chemage.sweep(scene, tmp_path / "shares", points=f"{share}/3")
        assert not (tmp_path / "shares" / "results.csv").exists()
    assert len(tiny.computed("contact")) == 4
    assert len(tiny.computed("kinetics")) == 32
    assert result.states() == ["done"] * 16
    collected = chemage.collect_sweep(tmp_path / "shares")
    assert collected.complete
    assert collected.points == []
    assert tables(tmp_path / "shares") == tables(tmp_path / "whole")
    left = {path.name for path in (tmp_path / "shares").iterdir()}
    assert left == {path.name for path in (tmp_path / "whole").iterdir()}, "nothing else is left"


def test_numbers_of_points(tiny, scene, tmp_path):
    result = chemage.sweep(scene, tmp_path / "out", points="3,14-15")
    assert [point for point, state in enumerate(result.states()) if state == "done"] == [3, 14, 15]
    with pytest.raises(InputError, match="there is no point 16: the sweep has points 0 to 15"):
        chemage.sweep(scene, tmp_path / "out", points="16")


@pytest.mark.long
def test_an_empty_share_is_complete(scene, tmp_path):
    out = tmp_path / "out"
    for share in range(1, 21):
        chemage.sweep(scene, out, points=f"{share}/20")
    assert chemage.collect_sweep(out).complete


def test_a_share_of_another_scene_is_refused(scene, tmp_path):
    chemage.sweep(scene, tmp_path / "out", points="1/3")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(StoreError, match="holds another sweep"):
        chemage.sweep(scene, tmp_path / "out", points="2/3", changes={"hold.temperature": 310})
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_that_another_process_has_just_begun_is_taken_and_one_with_other_files_is_not(scene, tmp_path):
    begun, foreign = tmp_path / "begun", tmp_path / "foreign"
    for folder in (begun, foreign):
        (folder / ".shares").mkdir(parents=True)
        (folder / ".parts").mkdir()
        (folder / ".lock").touch()
    (foreign / "mine.txt").touch()
    chemage.sweep(scene, begun, points="1/2")
    with pytest.raises(StoreError, match="not empty and holds no sweep"):
        chemage.sweep(scene, foreign, points="1/2")


def test_a_share_replaces_nothing(scene, tmp_path):
    with pytest.raises(InputError, match="give force"):
        chemage.sweep(scene, tmp_path / "out", points="1/3", force=True)
    assert not (tmp_path / "out").exists()


def test_collect_says_what_is_missing(tiny, scene, tmp_path):
    out = tmp_path / "out"
    chemage.sweep(scene, out, points="2/4")
    found = chemage.collect_sweep(out)
    assert not found.written
    assert not found.complete
    assert len(found.missing) == 12
    assert found.points == ["1/4", "3/4", "4/4", in_ranges(found.missing)]
    assert not (out / "results.csv").exists()
    for points in found.points[:-1]:
        chemage.sweep(scene, out, points=points)
    damaged = out / "points" / found.result.keys[5][:2] / f"{found.result.keys[5]}.json"
    damaged.write_bytes(damaged.read_bytes().replace(b"done", b"dome"))
    found = chemage.collect_sweep(out)
    assert (found.missing, found.damaged, found.written) == ([], [5], False)
    with pytest.warns(UserWarning, match="1 files are damaged and are computed again"):
        chemage.sweep(scene, out, points=found.points[0])
    assert chemage.collect_sweep(out).written


def test_points_that_fail_are_listed_and_tried_again(tiny, scene, tmp_path):
    out = tmp_path / "out"
    scene["sweep"] = {"contact.load": [5.0, 10.0], "engine.trouble": ["", "raise"]}
    for share in (1, 2):
        chemage.sweep(scene, out, points=f"{share}/2")
    found = chemage.collect_sweep(out)
    assert found.written, "as by one process, of which some points fail"
    assert found.failed == [1, 3]
    assert found.points[-1] == "1,3"
    tiny.forget()
    chemage.sweep(scene, out, points=found.points[-1])
    assert len(tiny.computed("kinetics")) >= 2


def test_the_first_contact_is_the_one_of_all_points(tmp_path, examples):
    folder = Folder(tmp_path)
    folder.make_parts()
    key = "0" * 32
    one, other = examples.contact(load=1.0), examples.contact(load=2.0)
    assert folder.keep_contact(key, one) == one
    assert folder.keep_contact(key, other) == one
    assert folder.read_contact(key) == one
    content = folder.contact(key).read_bytes()
    folder.contact(key).write_bytes(content[:-200])
    assert folder.keep_contact(key, other) == other, "one that is damaged is replaced"
    assert folder.read_contact(key) == other
    assert not list((tmp_path / ".parts").iterdir())


# -- several processes ------------------------------------------------------------------------------------------------


def test_shares_and_a_whole_sweep_exclude_each_other(scene, tmp_path):
    out = tmp_path / "out"
    chemage.sweep(scene, out, points="0")
    with Folder(out).locked(shared=True):
        assert chemage.collect_sweep(out).computing
        with pytest.raises(StoreError, match=r"is being computed by another process"):
            chemage.sweep(scene, out)
    with Folder(out).locked(), pytest.raises(StoreError, match=r"is being computed by process \d+"):
        chemage.sweep(scene, out, points="1/2")
    assert not chemage.collect_sweep(out).computing
    assert chemage.sweep(scene, out).states() == ["done"] * 16


def test_plugins_that_changed_are_no_work_for_shares(tiny, scene, tmp_path, monkeypatch):
    out = tmp_path / "out"
    chemage.sweep(scene, out, points="1/2")
    monkeypatch.setattr("chemage.studies.sweeps.running.changed", lambda *_, **__: {"tiny": ("1", "2")})
    with pytest.raises(StoreError, match="one process must do so: rerun the command without --points"):
        chemage.sweep(scene, out, points="2/2")


# -- the command ------------------------------------------------------------------------------------------------------

FILE = """
name = "study"
surface = { kind = "tiny-tip" }
contact = { kind = "tiny-even", load = 10.0 }
forming = { kind = "tiny-flat" }
chemistry = { site_density = "pixel" }
engine = { kind = "tiny-coin", pause = 0.0 }
hold = { times = [1.0, 10.0, 100.0], replicas = 2 }
fit = { start = 1.0, stop = 100.0 }

[sweep]
"surface.seed" = [1, 2]
"contact.load" = [5.0, 10.0]
"hold.seed" = [0, 1, 2, 3]
"""


@pytest.fixture
def file(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(FILE)
    return tmp_path / "study.toml"


def test_the_command_computes_a_share_and_collects(command, file, monkeypatch):
    for name in list(os.environ):
        if name.startswith(("SLURM_", "PBS_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("PBS_ARRAY_INDEX", "2")
    done = command("sweep", "study.toml", "--out", "out", "--points", "auto/2")
    assert done.status == 0, done.err
    assert "share 2 of 2: 8 of 8 points done in out" in done.out
    assert "chemage sweep --collect out" in done.out
    done = command("sweep", "--collect", "out")
    assert done.status == 1
    assert "8 of 16 points are missing in out; no tables were written" in done.err
    assert "chemage sweep study.toml --out out --points 1/2" in done.err
    done = command("sweep", "--collect", "out", "--json")
    assert done.status == 1
    assert json.loads(done.out)["points_to_compute"][0] == "1/2"
    done = command("sweep", "study.toml", "--out", "out", "--points", "1/2", "--json")
    assert json.loads(done.out)["share"]["done"] == 8
    done = command("sweep", "--collect", "out")
    assert done.status == 0, done.err
    assert "16 of 16 points done" in done.out
    assert command("sweep", "study.toml", "--out", "whole").status == 0
    assert tables("out") == tables("whole")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("sweep",), "name a scene with [sweep], or a folder with --collect FOLDER"),
        (("sweep", "study.toml", "--collect", "out"), "computes nothing; leave out SCENE"),
        (("sweep", "one.toml"), "one.toml has no [sweep]; `chemage run one.toml` runs it"),
        (("sweep", "study.toml", "--points", "9/8"), "no share 9 of 8"),
        (("sweep", "study.toml", "--points", "1/2", "--force"), "cannot replace a sweep"),
        (("sweep", "study.toml", "--patience", "soon"), "soon"),
        (("sweep", "study.toml", "--patience", "-1 s"), "must be positive"),
        (("sweep", "--collect", "nowhere"), "is not the folder of a sweep"),
        (("check", "one.toml", "--shares", "4"), "--shares is for sweeps"),
    ],
)
def test_wrong_words_leave_nothing_behind(command, file, words, message):
    file.with_name("one.toml").write_text(FILE.partition("[sweep]")[0])
    before = sorted(file.parent.rglob("*"))
    done = command(*words)
    assert done.status == 2
    assert message in done.err
    assert sorted(file.parent.rglob("*")) == before


def test_check_says_what_shares_cost(command, file):
    done = command("check", "study.toml", "--shares", "3")
    assert "points in each of 3 shares" in done.out
    shares = json.loads(command("check", "study.toml", "--shares", "3", "--json").out)["shares"]
    assert sum(share["points"] for share in shares) == 16
    assert all(share["cpu_seconds"] > 0 for share in shares)


# -- processes at the same time ---------------------------------------------------------------------------------------


def start(*words):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-m", "chemage", "sweep", *words], text=True, **pipes)


def finish(processes, statuses=(0,)):
    for process in processes:
        _, err = process.communicate(timeout=500)
        assert process.returncode in statuses, err
        assert "Traceback" not in err


@pytest.mark.campaign
def test_sixteen_processes_at_the_same_time(command, file, tiny):
    finish([start("study.toml", "--out", "out", "--points", f"{share}/16") for share in range(1, 17)])
    assert len(tiny.computed("kinetics")) == 32, "each point is computed once"
    assert not list(Path("out/.parts").iterdir())
    assert {path.name for path in Path("out/.shares").iterdir()} == {"of-16.json"}
    assert command("sweep", "--collect", "out").status == 0
    assert command("sweep", "study.toml", "--out", "whole").status == 0
    assert tables("out") == tables("whole")


@pytest.mark.campaign
def test_the_same_share_in_three_processes_at_the_same_time(command, file, tiny):
    file.write_text(FILE.replace("pause = 0.0", "pause = 0.2"))
    finish([start("study.toml", "--out", "out", "--points", "1/1") for _ in range(3)])
    assert command("sweep", "--collect", "out").status == 0
    assert command("sweep", "study.toml", "--out", "whole").status == 0
    assert tables("out") == tables("whole")


@pytest.mark.campaign
def test_kill_and_again(command, file, tiny):
    tiny.hold(6, 1.0)
    for _ in range(2):
        before = len(list(Path("out").glob("points/*/*.json")))
        processes = [start("study.toml", "--out", "out", "--points", f"{share}/2") for share in (1, 2)]
        deadline = time.monotonic() + 300
        while len(list(Path("out").glob("points/*/*.json"))) < before + 3:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        for process in processes:
            process.send_signal(signal.SIGKILL)
        for process in processes:
            process.communicate()
    states = chemage.load_sweep("out").states()
    assert set(states) == {"done", "missing"}, "nothing is damaged"
    assert command("sweep", "--collect", "out").status == 1
    done = states.count("done")
    tiny.forget()
    tiny.hold(None)
    finish([start("study.toml", "--out", "out", "--points", f"{share}/2") for share in (1, 2)])
    assert len(tiny.computed("kinetics")) == 2 * (16 - done)
    assert command("sweep", "--collect", "out").status == 0
    assert command("sweep", "study.toml", "--out", "whole").status == 0
    assert tables("out") == tables("whole")
    assert not Path("out/.parts").exists()


@pytest.mark.campaign
def test_shares_in_several_processes_each(command, file, tiny):
    words = ["--out", "out", "--executor", "processes", "--workers", "2"]
    finish([start("study.toml", *words, "--points", f"{share}/2") for share in (1, 2)])
    assert len(tiny.computed("contact")) == 4
    assert len(tiny.computed("kinetics")) == 32
    assert command("sweep", "--collect", "out").status == 0


@pytest.mark.long
def test_processes_of_two_scenes_cannot_share_a_folder(file):
    """Whichever is first; the other changes nothing."""
    other = file.with_name("other.toml")
    other.write_text(FILE.replace("[0, 1, 2, 3]", "[4, 5, 6, 7]"))
    processes = [start(name, "--out", "out", "--points", "1/2") for name in ("study.toml", "other.toml")]
    finish(processes, (0, 2))
    assert sorted(process.returncode for process in processes) == [0, 2]
    assert np.sum([state == "done" for state in chemage.load_sweep("out").states()]) == 8
    assert len(list(Path("out").glob("points/*/*.json"))) == 8
