"""A run that is stopped leaves no file or a complete one: Ctrl-C, kill -9, a full disk, a read-only folder."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import faults
import pytest

import chemage
from chemage.plugin import StoreError, fresh_file
from chemage_contact import FFTBEM
from chemage_surfaces import SelfAffine

#: the name of this machine in temporary files
HOST = socket.gethostname().partition(".")[0]
#: this run says on stderr what it is writing, and waits to be stopped at a certain moment
SLOW_WRITES = """
import sys, time
from chemage.foundation import codec, files

array, place = codec._write_array, files.put

def say(word):
    print(word, file=sys.stderr, flush=True)
    if word == MOMENT:
        time.sleep(600)

def slow_array(*args):
    say(f"making {args[1]}")
    array(*args)

def slow_bytes(path, data):
    with open(path, "xb") as file:
        file.write(data[: len(data) // 2])
        file.flush()
        say("halfway")
        file.write(data[len(data) // 2 :])

def slow_place(*args, **options):
    say("placing")
    there = place(*args, **options)
    say("placed")
    return there

codec._write_array, files.put, files.create = slow_array, slow_place, slow_bytes
"""


def start(code, folder, more=(), **options):
    """``chemage run small.toml`` in another process, with ``code`` run before it."""
    program = f"{code}\nimport sys\nfrom chemage.cli.app import main\nsys.argv[1:] = sys.argv[1:]\nmain()"
    words = [sys.executable, "-c", program, "run", "small.toml", "--no-figures", *more]
    return subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def wait_for(process, word):
    """Read stderr up to the line with ``word``."""
    for line in process.stderr:
        if word in line:
            return
    raise AssertionError(f"the process ended before it said {word!r}")


def finish(process):
    try:
        return process.communicate(timeout=300)
    finally:
        process.kill()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


# -- Ctrl-C ----------------------------------------------------------------------------------------------------------

#: replicas that would take minutes, in threads as in a real run
ENDLESS = """
import sys, time
from chemage.plugin import registry

class Endless:
    @chemage.plugin.hookimpl(tryfirst=True)
    def chemage_{hook}(self):
        print("begun", file=sys.stderr, flush=True)
        {work}

registry.current().register(Endless(), "endless")
"""


@pytest.mark.parametrize(
    ("hook", "work"),
    [
        pytest.param("solve_contact", "time.sleep(600)", marks=pytest.mark.long),
        ("run_kinetics", "time.sleep(0.5)"),
    ],
)
def test_ctrl_c_exits_130_without_a_file(small, hook, work):
    process = start("import chemage" + ENDLESS.format(hook=hook, work=work), small.parent)
    wait_for(process, "begun")
    process.send_signal(signal.SIGINT)
    out, err = finish(process)
    assert process.returncode == 130
    assert "interrupted; nothing was written" in err
    assert "Traceback" not in err
    assert out == ""
    assert names(small.parent) == ["small.toml"]


@pytest.mark.long
def test_ctrl_c_while_writing_leaves_no_file(small):
    process = start("MOMENT = 'halfway'" + SLOW_WRITES, small.parent)
    wait_for(process, "halfway")
    assert any(name.endswith(".part") for name in names(small.parent))
    process.send_signal(signal.SIGINT)
    _, err = finish(process)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert names(small.parent) == ["small.toml"]


def test_ctrl_c_while_drawing_keeps_the_result_and_says_so(command, small, monkeypatch):
    faults.interrupt_drawing(monkeypatch)
    done = command("run", small)
    assert done.status == 130
    assert "the result is in small.h5" in done.err
    assert chemage.read("small.h5").ageing.replicas == 3


@pytest.mark.long
def test_sigterm_as_of_a_scheduler_says_what_ctrl_c_says_and_exits_143(small):
    slow = """
import time
from chemage.studies import tasks
inner, calls = tasks.run, []
def compute(*given, **more):
    calls.append(given)
    if len(calls) > 7:
        print("begun", file=sys.stderr, flush=True)
        time.sleep(600)
    return inner(*given, **more)
tasks.run = compute
"""
    process = start("import sys" + slow, small.parent, more=("--surfaces", "40", "--threads", "1"))
    wait_for(process, "begun")
    process.send_signal(signal.SIGTERM)
    _, err = finish(process)
    assert process.returncode == 143
    assert re.search(r"terminated; so far beta ± .* from 7 samples, kept in small-samples; the same command", err)
    assert "Traceback" not in err
    assert names(small.parent) == ["small-samples", "small.toml"]


@pytest.mark.long
def test_sigterm_ends_a_run_as_ctrl_c_does(small):
    process = start("import chemage" + ENDLESS.format(hook="run_kinetics", work="time.sleep(0.5)"), small.parent)
    wait_for(process, "begun")
    process.send_signal(signal.SIGTERM)
    _, err = finish(process)
    assert process.returncode == 143
    assert "terminated; nothing was written" in err
    assert names(small.parent) == ["small.toml"]


# -- kill -9 ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "moment",
    [
        pytest.param("making pressure", marks=pytest.mark.campaign),
        "halfway",
        "placing",
        pytest.param("placed", marks=pytest.mark.campaign),
    ],
)
def test_kill_9_leaves_no_file_or_a_complete_one(command, small, moment):
    process = start(f"MOMENT = {moment!r}" + SLOW_WRITES, small.parent)
    wait_for(process, moment)
    process.kill()
    process.wait()
    assert process.returncode == -signal.SIGKILL
    finish(process)
    if moment == "placed":
        assert chemage.read(small.parent / "small.h5").ageing.replicas == 3
        assert command("run", small, "--no-figures").status == 2  # it is there, whole, and kept
        assert command("run", small, "--no-figures", "--force").status == 0
    else:
        left = [name for name in names(small.parent) if name != "small.toml"]
        assert len(left) == (moment != "making pressure")
        assert all(re.fullmatch(r"\.small\.h5\..*\.part", name) for name in left)
        assert command("run", small, "--no-figures").status == 0
    assert names(small.parent) == ["small.h5", "small.toml"]
    assert chemage.read("small.h5").ageing.replicas == 3


def test_the_temporary_file_of_a_living_process_is_left_alone(small):
    living = small.parent / f".x.h5.{HOST}.{os.getpid()}.99.part"
    elsewhere = small.parent / ".x.h5.another-host.1.0.part"
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    stale = small.parent / f".x.h5.{HOST}.{dead.pid}.0.part"
    for file in (living, elsewhere, stale):
        file.write_text("x")
    with fresh_file(small.parent / "x.h5") as part:
        part.write_text("new")
    assert living.exists()
    assert elsewhere.exists()
    assert not stale.exists()


# -- the disk --------------------------------------------------------------------------------------------------------


@pytest.fixture
def tiny_disk(tmp_path):
    """A file system of 64 kB where this process may mount one, else None."""
    folder = tmp_path / "tiny"
    folder.mkdir()
    mount = shutil.which("mount")
    words = [mount, "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)] if mount else ["false"]
    if os.getuid() or subprocess.run(words, capture_output=True).returncode:
        yield None
        return
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_seen_before_anything_is_computed(command, small, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(1000, 1000, 0))
    monkeypatch.setattr(SelfAffine, "make", lambda *_: pytest.fail("computing began"))
    done = command("run", small)
    assert done.status == 2
    assert re.search(r"small\.h5 needs .* MB, but \. has 0 MB left", done.err)
    assert names(small.parent) == ["small.toml"]


@pytest.mark.parametrize("force", [False, True])
def test_a_disk_that_fills_up_while_writing_leaves_nothing_half_written(small, tiny_disk, monkeypatch, force):
    heights = chemage.Surface(
        heights=chemage.make_surface(chemage.surface("sphere", radius=9, pixels=150, pixel_size=1)).heights,
        pixel_size=1,
    )
    folder = tiny_disk or small.parent
    if force:
        (folder / "x.h5").write_text("old")
    # the room was there a moment ago
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**12, 0, 10**12))
    if tiny_disk is None:

        def full(*_):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StoreError, match=r"cannot write .*x\.h5.*nothing was kept"):
        chemage.write(folder / "x.h5", heights, force=force)
    assert [p.name for p in folder.iterdir() if p.name != "small.toml"] == (["x.h5"] if force else [])
    if force:
        assert (folder / "x.h5").read_text() == "old"


@pytest.mark.long
def test_a_disk_that_fills_up_while_drawing_keeps_the_result(command, small, monkeypatch):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    real = FigureCanvasAgg.print_png

    def full(self, target, **more):
        if not isinstance(target, str | os.PathLike):  # in memory
            return real(self, target, **more)
        Path(target).write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr(FigureCanvasAgg, "print_png", full)
        done = command("run", small)
    assert done.status == 2
    assert "No space left on device" in done.err
    assert "the result itself is in small.h5" in done.err
    assert chemage.read("small.h5").ageing.replicas == 3
    assert names(small.parent) == ["small.h5", "small.toml"]
    monkeypatch.setattr(FFTBEM, "_solve", lambda *_: pytest.fail("computed again"))
    done = command("run", small)
    assert "small.h5 is complete; only its figures are drawn" in done.err
    assert sorted(Path("small-figures").iterdir())
    assert command("run", small).status == 2


def test_figures_are_drawn_only_for_a_result_of_this_very_scene(command, small):
    assert command("run", small, "--no-figures").status == 0
    done = command("run", small, "--set", "hold.seed=9")
    assert done.status == 2
    assert "small.h5 is already there" in done.err


def test_what_a_killed_command_left_of_figures_goes_even_where_the_next_refuses(command, small):
    assert command("run", small, "--no-figures").status == 0
    left = small.parent / ".small-figures.part"
    left.mkdir()
    assert command("run", small, "--set", "hold.seed=9").status == 2
    assert not left.exists()


def test_a_read_only_folder_is_seen_before_anything_is_computed(command, small, monkeypatch):
    monkeypatch.setattr(SelfAffine, "make", lambda *_: pytest.fail("computing began"))
    if os.getuid():
        small.parent.chmod(0o555)
    else:  # root may write anywhere but on a read-only file system

        def refuse(self, *_, **__):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))

        monkeypatch.setattr(Path, "touch", refuse)
    try:
        done = command("run", small)
    finally:
        small.parent.chmod(0o755)
    assert done.status == 2
    assert re.search(r"cannot write small\.h5: (Read-only file system|Permission denied)", done.err)
    assert names(small.parent) == ["small.toml"]


def test_too_little_memory_is_said(command, small, monkeypatch):
    def full(*_):
        raise MemoryError("Unable to allocate 8.00 GiB")

    monkeypatch.setattr(SelfAffine, "make", full)
    done = command("run", small)
    assert done.status == 2
    assert "not enough memory: Unable to allocate 8.00 GiB; `chemage check` estimates" in done.err
    assert names(small.parent) == ["small.toml"]


def test_a_standard_output_that_is_full_or_closed(small):
    program = [sys.executable, "-m", "chemage", "plugins", "list"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(program, cwd=small.parent, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(program, cwd=small.parent, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.long
@pytest.mark.skipif(shutil.which("prlimit") is None, reason="prlimit is not installed")
def test_a_log_that_cannot_be_written_is_one_line(small):
    program = [sys.executable, "-m", "chemage", "cite", "silica-tip", "--log", "mine.log"]
    log = small.with_name("mine.log")
    size = 2**20
    for status, words in ((0, []), (0, ["--log", "the log ends here"]), (2, ["--log", "choose another place"])):
        limited = ["prlimit", f"--fsize={size}", *program]
        done = subprocess.run(limited, cwd=small.parent, capture_output=True, text=True)
        assert done.returncode == status
        assert "Traceback" not in done.stderr
        assert len(done.stderr.splitlines()) == bool(words)
        assert all(word in done.stderr for word in words)
        size = log.stat().st_size - 10 if size > 9999 else 10
        log.unlink()
