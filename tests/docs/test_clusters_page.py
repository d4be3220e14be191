"""The scripts of the page on clusters, run as they stand, with programs ``sbatch`` and ``qsub`` that run jobs here."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import chemage

PAGE = Path(__file__).parents[2] / "docs" / "clusters.md"
#: runs the tasks of an array at the same time; jobs with a dependency wait for it
SBATCH = r"""
import os, pathlib, re, subprocess, sys, time
here = pathlib.Path(os.environ["HERE"])
words, script, wrap, options = sys.argv[1:], "", "", {}
while words:
    word = words.pop(0)
    if word == "--wrap":
        wrap = words.pop(0)
    elif word.startswith("--"):
        name, _, value = word.partition("=")
        options[name] = value
    else:
        script = word
text = open(script).read() if script else "#!/bin/bash\n" + wrap + "\n"
written = dict(re.findall(r"^#SBATCH (--[\w-]+)=(.*)$", text, re.M))
options = {**written, **options}
for waited in re.findall(r"\d+", options.get("--dependency", "")):
    for pid in (here / waited).read_text().split():
        state = pathlib.Path(f"/proc/{pid}/stat")
        while state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z":
            time.sleep(0.05)
numbers = []
for part in filter(None, options.get("--array", "").split(",")):
    first, _, last = part.partition("-")
    numbers += range(int(first), int(last or first) + 1)
job = str(1000 + len(list(here.glob("[0-9]*"))))
copy = here / f"script-{job}.sh"
copy.write_text(text)
pids = []
for number in numbers or [None]:
    environment = dict(os.environ)
    if number is not None:
        environment |= {"SLURM_ARRAY_TASK_ID": str(number), "SLURM_ARRAY_TASK_COUNT": str(len(numbers)),
            "SLURM_ARRAY_TASK_MIN": str(min(numbers)), "SLURM_ARRAY_TASK_MAX": str(max(numbers)),
            "SLURM_ARRAY_TASK_STEP": "1"}
    log = open(options.get("--output", "slurm.out").replace("%a", str(number)), "w")
    pids.append(subprocess.Popen(["bash", copy], env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log).pid)
(here / job).write_text(" ".join(map(str, pids)))
print(job if "--parsable" in options else f"Submitted batch job {job}")
"""
QSUB = r"""
import os, pathlib, re, subprocess, sys
script = pathlib.Path(sys.argv[1]).resolve()
text = script.read_text()
first, last = map(int, re.search(r"^#PBS -J (\d+)-(\d+)$", text, re.M).groups())
jobs = []
for number in range(first, last + 1):
    environment = {**os.environ, "PBS_ARRAY_INDEX": str(number), "PBS_O_WORKDIR": os.getcwd()}
    log = open(f"study.o17.{number}", "w")
    jobs.append(subprocess.Popen(["bash", script], env=environment, cwd="/", stdout=log, stderr=log))
print("17[].server")
"""


def block(start):
    """The block of the page that begins with, or contains in its first lines, ``start``."""
    blocks = re.findall(r"^```\w+\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (found,) = [text for text in blocks if start in text]
    return found


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """A working folder with the scene of the page, and the programs of a cluster on the PATH."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in (("sbatch", SBATCH), ("qsub", QSUB)):
        (programs / f"{name}.py").write_text(text)
        (programs / name).write_text(f'#!/bin/sh\nexec {sys.executable} "{programs}/{name}.py" "$@"\n')
    (programs / "chemage").write_text(f'#!/bin/sh\nexec {sys.executable} -m chemage "$@"\n')
    for file in programs.iterdir():
        file.chmod(0o755)
    jobs = tmp_path / "jobs"
    jobs.mkdir()
    for name in list(os.environ):
        if name.startswith(("SLURM_", "PBS_", "SGE_", "LSB_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HERE", str(jobs))
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    (work / "study.toml").write_text(block('name = "study"'))
    return work


def shell(text, timeout=550):
    done = subprocess.run(["bash", "-c", f"set -e\n{text}"], capture_output=True, text=True, timeout=timeout)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def until(condition, seconds=500):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "\n".join(file.read_text() for file in Path().glob("*.[lo]*"))
        time.sleep(0.2)


@pytest.mark.long
def test_the_array_of_slurm(cluster):
    # as it stands but for the number of jobs
    text, submit = block("#SBATCH"), block("sbatch --parsable array.sh")
    assert "--array=1-16" in text
    Path("array.sh").write_text(text.replace("1-16", "1-4"))
    shell(submit)
    until(lambda: "results  study/results.h5" in Path("collect.log").read_text())
    logs = [file.read_text() for file in sorted(Path().glob("study-*.log"))]
    assert len(logs) == 4
    assert all(re.search(r"share \d+ of 4: 8 of 8 points done", text) for text in logs), logs
    shell("chemage run study.toml --out serial")
    for name in ("results.csv", "results.h5"):
        assert Path("study", name).read_bytes() == Path("serial", name).read_bytes()


@pytest.mark.campaign
def test_the_array_of_pbs(cluster):
    # as it stands but for the number of jobs
    Path("array.pbs").write_text(block("#PBS -J").replace("-16", "-4").replace("/16", "/4"))
    submit, collect = block("qsub array.pbs").splitlines()
    shell(submit)
    until(lambda: len(list(Path().glob("study.o17.*"))) == 4)
    until(lambda: all("points done" in file.read_text() for file in Path().glob("study.o17.*")))
    assert "32 of 32 points done" in shell(collect)


@pytest.mark.campaign
def test_shares_by_hand(cluster):
    check, first, second, collect = block("chemage sweep study.toml --out study --points 1/16").splitlines()
    assert "points in each of 16 shares" in shell(check)
    shell(f"{first} && {second}")
    done = subprocess.run(["bash", "-c", collect], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "28 of 32 points are missing in study" in done.stderr
    (every,) = re.findall(r"computes all of them: (chemage .*)", done.stderr)
    shell(every)
    assert "32 of 32 points done" in shell(collect)
    assert chemage.load_sweep("study").states() == ["done"] * 32
