"""Kill commands at random moments, and see that nothing is corrupt, different or left over.

    python tests/benchmarks/kills.py [KILLS] [run] [sweep] [infer] [reproduce] [workers] [scheduler]

A sweep, a run with checkpoints, an inference and figures of the paper are started again and again and killed with
SIGKILL after a random time, until they are complete; then the next begins. With ``workers`` and ``scheduler`` a sweep
runs on Dask, of which a process is killed. After every kill each file that has its final name must be intact; a
complete result must be that of an uninterrupted one, and nothing but results may be left.
"""

from __future__ import annotations

import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import chemage
from chemage.foundation.codec import to_json
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


MEASURED = "hold_time (s),friction_drop (nN),error (nN),load (nN),temperature (K)\n" + "\n".join(
    f"{time},{drop},8,40,300"
    for time, drop in ((1, 2), (3, 8), (10, 20), (30, 50), (100, 87), (1000, 125), (10000, 188))
)
DASK = """
import sys, chemage
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=60) as cluster:
        print(*(worker.pid for worker in cluster.workers.values()), flush=True)
        chemage.sweep("sweep.toml", sys.argv[1], executor=f"dask:{cluster.scheduler_address}")
"""
#: what is killed -> (words of the command, result); OUT is a name
WAYS = {
    "run": (["run", "run.toml", "--out", "OUT.h5", "--checkpoints", "OUT-checkpoints"], "OUT.h5"),
    "sweep": (["run", "sweep.toml", "--out", "OUT", "--workers", "2"], "OUT"),
    "infer": (["infer", "measured.csv", "--scene", "run.toml", "--out", "OUT.h5"], "OUT.h5"),
    "reproduce": (["reproduce", "fig3", "--seeds", "1", "--pixels", "320", "--workers", "2", "--out", "OUT"], "OUT"),
    "workers": (["OUT"], "OUT"),
    "scheduler": (["OUT"], "OUT"),
}


def content(path: Path) -> Any:
    """What a command found out, without what depends on the clock."""
    if path.suffix == ".h5":
        result = chemage.read(path)
        if isinstance(result, chemage.Run):
            return {name: part.digest() for name, part in result.parts().items()}, result.keys
        # how long it took is in the diagnostics
        return {name: value for name, value in to_json(result).items() if name not in ("diagnostics", "provenance")}
    if not (path / "sweep.json").exists():
        return [content(place.parent) for place in sorted(path.rglob("sweep.json"))]
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


def started(kind: str, words: list[str], here: Path) -> subprocess.Popen[bytes]:
    """Begin a command in a folder."""
    program = ["-c", DASK] if kind in ("workers", "scheduler") else ["-m", "chemage"]
    return subprocess.Popen(
        [sys.executable, *program, *words], cwd=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def killed(kind: str, process: subprocess.Popen[bytes], seconds: float, moments: random.Random) -> bool:
    """Kill a command, or a worker of it, unless it ends before."""
    try:
        process.wait(timeout=seconds)
        return False
    except subprocess.TimeoutExpired:
        victim = process.pid
    if kind == "workers":
        assert process.stdout is not None
        victim = int(moments.choice(process.stdout.readline().split()))
    with suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
    return True


def main() -> None:
    """Kill as often as asked for, and print what was found."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    kinds = sys.argv[2:] or list(WAYS)
    moments = random.Random(0)
    kills, complete = Counter[str](), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inputs = {"run.toml": SCENE, "sweep.toml": SCENE + SWEEP, "measured.csv": MEASURED}
        for file, text in inputs.items():
            (folder / file).write_text(text)
        expected, seconds = {}, {}
        for kind in kinds:
            words = [word.replace("OUT", f"whole-{kind}") for word in WAYS[kind][0]]
            out = folder / WAYS[kind][1].replace("OUT", f"whole-{kind}")
            for _ in range(2):  # the first one may compile kernels
                for left in folder.glob(f"whole-{kind}*"):
                    left.unlink() if left.is_file() else shutil.rmtree(left)
                begin = time.monotonic()
                process = started(kind, words, folder)
                error = process.communicate()[1]
                assert process.returncode == 0, error.decode()[-2000:]
                seconds[kind] = time.monotonic() - begin
            expected[kind] = content(out)
        for number in itertools.count():
            kind = kinds[number % len(kinds)]
            if sum(kills.values()) >= wanted:
                break
            words, out = WAYS[kind]
            here = folder / f"here-{number}"
            here.mkdir()
            for file, text in inputs.items():
                (here / file).write_text(text)
            for attempt in range(1000):
                process = started(kind, words, here)
                hit = killed(kind, process, moments.uniform(0.3, 1.0 + 0.05 * attempt) * seconds[kind], moments)
                _, error = process.communicate()
                if hit:
                    kills[kind] += 1
                    if damaged := intact(here):
                        sys.exit(f"damaged after kill {kills}: {damaged}")
                    if kind != "workers" or process.returncode:  # a sweep goes on without one of its workers
                        continue
                # killed after the figures were complete, the same command says that the result is there
                if process.returncode and b"already there" not in error:
                    sys.exit(f"{kind} failed after {kills}: {error.decode()}")
                break
            if content(here / out) != expected[kind]:
                sys.exit(f"{kind} is different after {kills}")
            left = [str(path) for path in here.rglob("*") if ".part" in path.name]
            if left:
                sys.exit(f"{kind}: left over after {kills}: {left}")
            complete += 1
            shutil.rmtree(here)
    print(f"{dict(kills)} kills, {complete} completed after them: nothing damaged, different or left over")


if __name__ == "__main__":
    warnings.simplefilter("error")
    main()
