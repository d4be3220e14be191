"""`chemage run`: what it prints, what it writes, what it refuses to touch."""

from __future__ import annotations

import json
import re
import time

import faults
import numpy as np
import pytest

import chemage
from chemage.plugin import progress
from chemage_surfaces import SelfAffine

KEYS = {
    *("area_fraction", "kappa", "mean_contact_pressure", "patches", "perimeter_to_area", "sites", "hold_time"),
    *("friction_drop", "friction_coefficient_drop", "beta", "timings", "solver", "engine"),
}


def test_the_table_shows_what_the_file_holds(command, small):
    done = command("run", small)
    assert done.status == 0
    # on a busy machine more stages are slow
    progress = r"^(loading chemage(: \d+ s)?|\w+: (done in )?[\d.]+ s|ageing: \d+ of \d+, \d+ s)\n"
    assert not re.sub(progress, "", done.err, flags=re.MULTILINE)
    result = chemage.read("small.h5")
    fit = result.fit()
    for text in (
        "A small rough contact",
        result.contact.quantity("area_fraction").text(),
        result.contact.quantity("area").text(),
        result.contact.quantity("mean_contact_pressure").text(),
        "small.h5",
    ):
        assert text in done.out, text
    assert f"{fit.texts()[0]} over 7 hold times from 10 to 10000 s" in done.out
    every = " ".join(command("show", "small.h5", "--all").out.split())
    for text in (result.contact.quantity("kappa").text(), "rejection-free", "3 replicas on one surface"):
        assert text in every, text
    assert "independent of runs with another contact, chemistry, temperature or engine" in every
    assert "figures  small-figures\n" in done.out
    assert {"surface", "pressure", "barriers", "friction"} <= {p.stem for p in small.parent.glob("small-figures/*.png")}


def test_json_is_one_object_with_every_number(command, small, monkeypatch):
    # progress is on: every stage pretends to take three seconds
    clock = iter(range(0, 10**6, 3))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(clock)))
    done = command("run", small, "--json", "--no-figures")
    assert done.status == 0
    assert re.search(r"^ageing: done in \d+\.0 s$", done.err, re.MULTILINE)
    numbers = json.loads(done.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert set(numbers) >= KEYS
    result = chemage.read("small.h5")
    assert numbers["area_fraction"]["value"] == result.contact.quantity("area_fraction").value
    assert numbers["friction_drop"]["value"] == result.ageing.mean_friction_drop.tolist()
    assert numbers["beta"]["value"] == result.fit().beta
    assert (numbers["solver"], numbers["engine"]) == ("fft-bem", "rejection-free")
    assert numbers["timings"].keys() == {"surface", "contact", "ageing"}
    assert (numbers["file"], numbers["figures"]) == ("small.h5", [])


def test_set_replicas_seed_and_out_reach_the_run(command, small):
    (small.parent / "deep").mkdir()
    words = ["--set", "contact.load='30 nN'", "--set", "surface.rms_slope=0.15", "--set", "name=other"]
    done = command("run", small, *words, "--replicas", 2, "--seed", 7, "--out", "deep/x.h5", "--no-figures", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["file"] == "deep/x.h5"
    scene = chemage.read("deep/x.h5").scene
    assert (scene["contact"]["load"], scene["surface"]["rms_slope"], scene["name"]) == (30.0, 0.15, "other")
    assert (scene["hold"]["replicas"], scene["hold"]["seed"]) == (2, 7)
    assert sorted(p.name for p in small.parent.iterdir()) == ["deep", "small.toml"]
    assert [p.name for p in (small.parent / "deep").iterdir()] == ["x.h5"]


def test_seeds_decide_everything(command, small):
    for name, words in {
        "a": ["--seed", 1],
        "b": ["--seed", 1, "--threads", 1],
        "noise": ["--seed", 2],
        "rough": ["--seed", 1, "--set", "surface.seed=2"],
    }.items():
        assert command("run", small, *words, "--out", f"{name}.h5", "--no-figures").status == 0
    a, b, noise, rough = (chemage.read(f"{name}.h5") for name in ("a", "b", "noise", "rough"))
    assert (a.surface, a.contact, a.ageing) == (b.surface, b.contact, b.ageing)
    assert a.contact == noise.contact
    assert not np.array_equal(a.ageing.bonds, noise.ageing.bonds)
    assert a.surface != rough.surface
    assert len({tuple(row) for row in a.ageing.bonds.tolist()}) > 1, "replicas are all the same"


# -- what is there already ------------------------------------------------------------------------------------------


@pytest.fixture
def no_computing(monkeypatch):
    def never(*_, **__):
        raise AssertionError("computing began")

    monkeypatch.setattr(SelfAffine, "make", never)


@pytest.mark.usefixtures("no_computing")
@pytest.mark.parametrize(
    ("made", "words", "said"),
    [
        ("small.h5", [], "small.h5 is already there"),
        ("small-figures/mine.png", [], "small-figures is already there"),
        ("small-figures", ["--force"], "is a file"),
        ("x.h5", ["--out", "x.h5"], "x.h5 is already there"),
        ("folder/y", ["--out", "folder", "--force"], "folder is a folder"),
        ("y", ["--out", "."], ". is a folder"),
        ("y", ["--out", "missing/x.h5"], "the folder missing does not exist"),
        ("y", ["--out", "small.toml", "--force"], "small.toml is an input of this command"),
        ("y", ["--out", "./../here/small.toml", "--force"], "is an input of this command"),
        ("y", ["--out", "/dev/null", "--force"], "/dev/null is a device or a pipe"),
        ("y", ["--out", "n" * 300 + ".h5"], "File name too long"),
    ],
)
def test_what_is_there_is_kept_and_nothing_is_computed(command, small, made, words, said):
    file = small.parent / made
    file.parent.mkdir(exist_ok=True)
    file.write_text("precious")
    before = small.read_text()
    done = command("run", small, *words)
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert "Traceback" not in done.err
    assert file.read_text() == "precious"
    assert small.read_text() == before
    assert {p.name for p in small.parent.iterdir()} == {"small.toml", made.split("/")[0]}


@pytest.mark.usefixtures("no_computing")
def test_a_link_to_nowhere_is_not_followed_or_replaced(command, small):
    link = small.parent / "small.h5"
    link.symlink_to("elsewhere.h5")
    assert command("run", small).status == 2
    assert link.is_symlink()


@pytest.mark.usefixtures("no_computing")
def test_a_file_the_scene_reads_is_never_its_output(command, small):
    heights = small.parent / "rough.h5"
    heights.write_bytes(b"a week of measurements")
    small.write_text(
        'name = "rough"\n[surface]\nkind = "from-file"\npath = "rough.h5"\npixel_size = 1.0\n'
        '[contact]\nkind = "fft-bem"\nmodulus = 30.0\nload = 1.0\n'
    )
    done = command("run", small, "--force")
    assert done.status == 2
    assert "rough.h5 is an input of this command" in done.err
    assert heights.read_bytes() == b"a week of measurements"


def test_force_replaces_the_old_result_as_a_whole(command, small):
    assert command("run", small, "--no-figures").status == 0
    first = chemage.read("small.h5").ageing
    assert command("run", small, "--no-figures", "--force", "--seed", 9).status == 0
    assert chemage.read("small.h5").ageing != first
    assert sorted(p.name for p in small.parent.iterdir()) == ["small.h5", "small.toml"]


def test_a_result_that_appeared_meanwhile_is_not_overwritten(command, small, monkeypatch):
    faults.run_by(monkeypatch, lambda _: (small.parent / "small.h5").write_text("another process was first"))
    done = command("run", small, "--no-figures")
    assert done.status == 2
    assert (small.parent / "small.h5").read_text() == "another process was first"
    assert not list(small.parent.glob(".*"))


# -- progress --------------------------------------------------------------------------------------------------------


def test_only_stages_over_two_seconds_report(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    with progress.progress_bars() as tell:
        for stage, seconds in (("quick", 1.9), ("slow", 2.5)):
            tell(stage, 0, 0)
            now[0] += seconds
            tell(stage, 1, 1)
    printed = capsys.readouterr()
    assert printed.err == "slow: done in 2.5 s\n"
    assert printed.out == ""


@pytest.fixture
def quick_lines(monkeypatch):
    """Lines that say that a stage is at work come after hundredths of a second."""
    from chemage.plugin import progress

    monkeypatch.setattr(progress, "SILENCE", 0.01)
    monkeypatch.setattr(progress, "TICK", 0.002)


def lines_until(capsys, wanted, seconds=20.0):
    """What was printed on stderr, as soon as ``wanted`` is in it."""
    begin, text = time.monotonic(), ""
    while wanted not in text and time.monotonic() < begin + seconds:
        time.sleep(0.005)
        text += capsys.readouterr().err
    return text


def test_a_long_stage_says_that_it_is_at_work(capsys, quick_lines):
    with progress.progress_bars() as tell:
        tell("ageing", 3, 10)
        assert "ageing: 3/10, 0 s\n" in lines_until(capsys, "3/10")


def test_kernels_are_announced_at_once_and_their_line_ends_with_them(capsys, quick_lines):
    with progress.progress_bars() as tell:
        tell("contact", 0, 0)
        tell("compiling", 0, 0, "kernels, once")
        assert "compiling kernels, once\n" in capsys.readouterr().err
        tell("compiling", 1, 0)
        tell("compiling", 1, 0, "kernels, once")
        assert "compiling: 1 done, 0 s\n" in lines_until(capsys, "1 done")
        tell("compiling", 2, 0)
        capsys.readouterr()
        text = lines_until(capsys, "contact: 0 s")
        assert "kernels" not in text


def test_a_slow_start_says_so_and_a_quick_one_does_not(capsys, monkeypatch):
    from chemage.plugin import progress

    monkeypatch.setattr(progress, "LOADING", 0.01)
    progress.loading("loading")
    assert lines_until(capsys, "loading") == "loading\n"
    progress.loaded()
    monkeypatch.setattr(progress, "LOADING", 1000.0)
    progress.loading("loading")
    with progress.progress_bars():
        assert capsys.readouterr().err == ""
    assert progress._loading is None


def test_a_slow_start_is_silent_where_progress_is(capsys, monkeypatch):
    from chemage.plugin import progress

    monkeypatch.setattr(progress, "LOADING", 0.001)
    progress.silence(True)
    try:
        progress.loading("loading")
        time.sleep(0.05)
        assert capsys.readouterr().err == ""
    finally:
        progress.loaded()
        progress.silence(False)


def test_a_terminal_gets_bars(monkeypatch):
    import io

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with progress.progress_bars() as tell:
        tell("contact", 0, 0)
        tell("ageing", 3, 10)
    text = screen.getvalue()
    assert "contact" in text
    assert "3/10" in text
