"""Options of every command: help by -h, --quiet, --verbose, --log, completion of words, endings of files."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
import tomllib

import pytest

import chemage
from chemage.plugin import progress


@pytest.fixture(autouse=True)
def _shown_again():
    yield
    progress.silence(False)


def words_offered(folder, line, shell="bash"):
    """What the shell is offered after ``line``, as its script asks for it."""
    words = line.split(" ")
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)} if shell == "bash" else {}
    asked |= {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    done = subprocess.run(
        [sys.executable, "-m", "chemage"],
        env={**os.environ, **asked, "_CHEMAGE_COMPLETE": f"complete_{shell}"},
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    return done.stdout.split("\n")[:-1] if shell == "bash" else done.stdout


# -- help ------------------------------------------------------------------------------------------------------------

COMMANDS = ["run", "check", "status", "tradeoff", "show", "plot", "compare", "report", "schema", "init", "roughness"]
COMMANDS += ["reproduce", "study", "plugins"]


@pytest.mark.parametrize("name", ["", *COMMANDS, "plugins list", "plugins new"])
def test_h_is_help_and_fits_80_columns(command, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "80")
    short, long = command(*name.split(), "-h"), command(*name.split(), "--help")
    assert (short.status, short.err) == (0, "")
    assert short.out == long.out
    assert max(map(len, short.out.splitlines())) <= 80
    for option in ("-q, --quiet", "-v, --verbose", "--log FILE", "-h, --help"):
        assert option in short.out


def test_help_lists_commands_under_headings(command):
    shown = command("-h").out
    _, *parts = re.split(r"^(\w[\w ]*):$", shown, flags=re.MULTILINE)
    sections = dict(zip(parts[::2], parts[1::2], strict=True))
    named = {head: re.findall(r"^  ([\w-]+) ", body, re.MULTILINE) for head, body in sections.items()}
    assert named["Experiments"][:3] == ["init", "check", "run"]
    assert named["Results"][:4] == ["show", "plot", "compare", "report"]
    assert {"roughness", "reproduce", "study"} <= set(named["Commands of plugins"])
    assert "..." not in "".join(sections.values()), "a description is cut off"


# -- quiet and verbose -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(["run", "small.toml", "-q"], id="after"),
        pytest.param(["-q", "run", "small.toml"], id="before", marks=pytest.mark.long),
    ],
)
def test_quiet_prints_only_the_names_of_files(command, small, words):
    done = command(*words)
    assert done.status == 0
    assert done.err == ""
    assert done.out.splitlines() == ["result   small.h5", "figures  small-figures"]


def test_quiet_keeps_errors_and_json(command, small):
    done = command("run", "lost.toml", "--quiet")
    assert done.status == 2
    assert "lost.toml" in done.err
    assert all(line.startswith("warning: ") for line in command("check", small, "-q").out.splitlines())
    assert command("check", small, "-q", "--json").out.startswith("{")


def test_verbose_says_what_each_stage_does(command, small):
    done = command("run", small, "--no-figures", "-v")
    lines = [line[9:] for line in done.err.splitlines()]
    assert all(re.match(r"\d\d:\d\d:\d\d ", line) for line in done.err.splitlines())
    assert lines[0].startswith("command: chemage run")
    assert any(line.startswith("versions: chemage ") for line in lines)
    assert any(line.startswith("compiled kernels are kept in ") for line in lines)
    for stage in ("surface", "contact", "ageing", "writing"):
        assert any(re.match(rf"{stage}: done in [\d.]+ s \([\d.]+ s of CPU time\)", line) for line in lines), stage
    assert any(re.match(r"ageing: replicas \d+/\d+$", line) for line in lines)
    assert "ageing" not in command("run", small, "--no-figures", "--force").err, "an earlier call made this one verbose"


def test_quiet_and_verbose_exclude_each_other(command, small):
    done = command("-q", "check", small, "-v")
    assert done.status == 2
    assert "choose one" in done.err


# -- the log ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("before", [True, False], ids=["before", "after"])
def test_the_log_holds_stages_versions_and_the_end(command, small, before):
    words = ["run", small, "--no-figures", "--force"]
    done = command(*(["--log", "run.log", *words] if before else [*words, "--log", "run.log"]))
    assert done.status == 0
    assert "ageing: done" not in done.err
    lines = (small.parent / "run.log").read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d{4} INFO ", line) for line in lines)
    text = "\n".join(lines)
    for expected in (
        "command: chemage ",
        "versions: chemage ",
        "contact: done in",
        "replicas 3/3",
        "ended with status 0",
    ):
        assert expected in text


def test_the_log_holds_warnings_and_errors(command, small):
    done = command("run", small, "--set", "contact.load=-1", "--log", "bad.log")
    assert done.status == 2
    text = (small.parent / "bad.log").read_text()
    assert re.search(r" ERROR +.*contact\.load", text, re.DOTALL)
    assert text.splitlines()[-1].partition("INFO    ")[2].startswith("ended with status 2")


def test_the_log_is_a_new_file(command, small):
    (small.parent / "old.log").write_text("precious")
    done = command("check", small, "--log", "old.log")
    assert done.status == 2
    assert "old.log: this file is already there" in done.err
    assert (small.parent / "old.log").read_text() == "precious"
    assert "choose another file" in command("check", small, "--log", "lost/x.log").err


def test_stages_log_to_python_logging_too(small, caplog):
    with caplog.at_level("INFO", logger="chemage"):
        chemage.run(chemage.load_scene(small))
    assert any(record.message.startswith("contact: done") for record in caplog.records)
    assert {record.name for record in caplog.records} == {"chemage"}


# -- completion ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_script_for_each_shell(command, monkeypatch, shell):
    import shellingham

    monkeypatch.setattr(shellingham, "detect_shell", lambda *_: (shell, f"/bin/{shell}"))
    done = command("--show-completion")
    assert done.status == 0
    assert "_CHEMAGE_COMPLETE=complete_" in done.out


@pytest.mark.long
def test_names_of_scenes_fields_kinds_and_files_are_completed(small):
    folder = small.parent
    (folder / "a.h5").touch()
    assert words_offered(folder, "chemage ru") == ["run"]
    assert words_offered(folder, "chemage run silica-t") == ["silica-tip", "silica-tips"]
    assert words_offered(folder, "chemage run sm") == ["small.toml"]
    assert words_offered(folder, "chemage run silica-tip --set surface.r") == ["surface.radius="]
    assert words_offered(folder, "chemage plot ") == ["a.h5"]
    assert words_offered(folder, "chemage plugins show fft") == ["fft-bem"]
    assert "silica-tip" in words_offered(folder, "chemage check silica", "zsh")
    assert "silica-tip" in words_offered(folder, "chemage check silica", "fish")


def test_completion_writes_no_log(small):
    assert words_offered(small.parent, "chemage --log x.log ru") == ["run"]
    assert not (small.parent / "x.log").exists()


def test_completion_imports_nothing_heavy(small):
    """So that words come at once. What is imported counts, because seconds depend on the machine and on its load."""
    code = """
import atexit, os, sys
os.environ |= {"_CHEMAGE_COMPLETE": "complete_bash", "COMP_WORDS": "chemage run sil", "COMP_CWORD": "2"}
atexit.register(lambda: print(*sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr))
from chemage.cli.app import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "silica-rough" in done.stdout
    assert not set(done.stderr.split()) & {"numpy", "numba", "scipy", "h5py", "matplotlib", "pint", "rich"}


# -- names of files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "endings"),
    [
        (["run", "small.toml", "--out", "result.txt"], ".h5 or .hdf5"),
        (["run", "small.toml", "--out", "result"], ".h5 or .hdf5"),
        (["report", "small.h5", "--out", "page.pdf"], ".html or .htm"),
        (["tradeoff", "small.toml", "--out", "figure.jpg"], ".json, .png, .pdf or .svg"),
        (["init", "scene.yaml"], ".toml"),
    ],
)
def test_an_ending_that_is_not_ours_is_refused(command, small, words, endings):
    before = sorted(small.parent.iterdir())
    done = command(*words)
    assert (done.status, done.out) == (2, "")
    assert f"must end in {endings}" in done.err
    assert sorted(small.parent.iterdir()) == before


@pytest.mark.parametrize(("given", "name"), [("rock", "rock"), ("tip-0.5", "tip-0.5"), ("rock.toml", "rock")])
def test_init_names_the_scene(command, small, given, name):
    assert command("init", given, "--like", "silica-tip").status == 0
    text = (small.parent / f"{name}.toml").read_text()
    assert tomllib.loads(text)["name"] == name
    assert text.startswith("# A silica tip"), "the comments stay"
    assert chemage.load_scene(small.parent / f"{name}.toml").name == name


# -- progress --------------------------------------------------------------------------------------------------------


def test_progress_says_what_it_counts(capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 0.01)
    monkeypatch.setattr(progress, "TICK", 0.002)
    with progress.progress_bars({"ageing": "replicas", "contact": "iterations"}) as report:
        for reported, line in (
            (("contact", 20, 0, "residual 1e-2"), "contact: iterations 20, residual 1e-2, 0 s"),
            (("contact", 1, 1), ""),
            (("ageing", 2, 10), "ageing: replicas 2/10, 0 s"),
        ):
            report(*reported)
            begin, printed = time.monotonic(), ""
            while line not in printed and time.monotonic() < begin + 20:
                time.sleep(0.002)
                printed += capsys.readouterr().err
            assert line in printed


def test_the_contact_reports_its_iterations():
    surface = chemage.surface("self-affine", pixels=64, pixel_size=1.0, rms_slope=0.1, hurst=0.8, zeta=8, eta=2).make()
    seen = []
    with progress.watching(lambda *what: seen.append(what)):
        contact = chemage.contact("fft-bem", modulus=35.0).solve(surface, load=100.0)
    assert seen[-1][:3] == ("contact", contact.iterations, 0)
    assert seen[-1][3].startswith("residual ")
