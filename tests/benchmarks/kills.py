"""Kill runs and sweeps at random moments, and see that nothing is corrupt, different or left over.

    python tests/benchmarks/kills.py [KILLS]

A sweep, and a run with checkpoints, are started again and again and killed with SIGKILL after a random time, until they
are complete; then the next begins. After every kill each file that has its final name must be intact; a complete result
must be that of an uninterrupted run, and nothing but results may be left.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import chemage
from chemage.studies.folder import Folder

SCENE = """
name = "small"
[surface]
kind = "self-affine"
pixels = 64
pixel_size = "0.45 nm"
rms_slope = 0.1
hurst = 0.8
zeta = 16
seed = 1
[contact]
kind = "fft-bem"
modulus = "35.3 GPa"
load = "40 nN"
[forming]
kind = "md-silica"
[engine]
kind = "bkl"
[hold]
start = "1 ms"
stop = "1e4 s"
replicas = 40
"""
SWEEP = '\n[sweep]\n"contact.load" = [10, 20, 30, 40]\n"hold.seed" = [0, 1, 2]\n'


def content(path: Path) -> Any:
    """What a run or sweep found out, without what depends on the clock."""
    if path.suffix == ".h5":
        run = chemage.read(path)
        return run.contact.digest(), run.aging.digest(), run.keys
    result = chemage.load_sweep(path)
    points = [result.store.read_point(key) for key in result.keys]
    for point in points:
        del point["summary"]["timings"]
    return json.dumps(points), (path / "results.csv").read_bytes()


def intact(folder: Path) -> list[str]:
    """Read every file that has its final name; what is damaged."""
    found = []
    for path in folder.rglob("*"):
        if not path.is_file() or path.name.startswith(".") or ".parts" in path.parts:
            continue
        try:
            if path.suffix == ".json" and path.name != "sweep.json":
                if Folder(path.parents[2]).read_point(path.stem)["status"] not in ("done", "failed"):
                    found.append(str(path))
            elif path.name == "sweep.json":
                Folder(path.parent).read_manifest()
            elif path.suffix == ".npz":
                Folder(path.parents[1]).read_contact(path.stem)
            elif path.suffix == ".h5" and path.name != "results.h5":
                chemage.read(path)
        except chemage.ChemageError as error:
            found.append(f"{path}: {error}")
    return found


def main() -> None:
    """Kill as often as asked for, and print what was found."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    moments = random.Random(0)
    kills = complete = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "run.toml").write_text(SCENE)
        (folder / "sweep.toml").write_text(SCENE + SWEEP)
        ways = {
            "run": (["run", "run.toml", "--out", "OUT.h5", "--checkpoints", "OUT-checkpoints"], "OUT.h5"),
            "sweep": (["run", "sweep.toml", "--out", "OUT", "--workers", "2"], "OUT"),
        }
        expected, seconds = {}, {}
        for kind, (words, out) in ways.items():
            begin = time.monotonic()
            command = [sys.executable, "-m", "chemage.cli", *(word.replace("OUT", f"whole-{kind}") for word in words)]
            subprocess.run(command, cwd=folder, check=True, capture_output=True)
            seconds[kind] = time.monotonic() - begin
            expected[kind] = content(folder / out.replace("OUT", f"whole-{kind}"))
        number = 0
        while kills < wanted:
            number += 1
            kind = ("run", "sweep")[number % 2]
            words, out = ways[kind]
            here = folder / f"here-{number}"
            here.mkdir()
            for scene in ("run.toml", "sweep.toml"):
                (here / scene).write_text((folder / scene).read_text())
            command = [sys.executable, "-m", "chemage.cli", *words]
            for attempt in range(1000):
                process = subprocess.Popen(command, cwd=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
                try:
                    _, error = process.communicate(timeout=moments.uniform(0.3, 1.0 + 0.05 * attempt) * seconds[kind])
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGKILL)
                    process.communicate()
                    kills += 1
                    if damaged := intact(here):
                        sys.exit(f"damaged after kill {kills}: {damaged}")
                    continue
                # killed after the figures were complete, the same command says that the result is there
                if process.returncode and b"already there" not in error:
                    sys.exit(f"{kind} failed after kill {kills}: {error.decode()}")
                break
            if content(here / out) != expected[kind]:
                sys.exit(f"{kind} is different after kill {kills}")
            left = [str(path) for path in here.rglob("*") if ".part" in path.name]
            if left:
                sys.exit(f"left over after kill {kills}: {left}")
            complete += 1
    print(f"{kills} kills, {complete} runs and sweeps completed after them: nothing damaged, different or left over")


if __name__ == "__main__":
    warnings.simplefilter("error")
    main()
