"""Seconds that compiling takes, kernel by kernel, and the wall time of a first run with its lines of progress.

    python tests/benchmarks/compile_times.py [SCENE …]            # table of the kernels; default: silica-rough
    python tests/benchmarks/compile_times.py --run [SCENE …]      # transcript of a first run and of a second one

Each scene starts with an empty cache of its own. The seconds of a kernel are processor time of one thread and contain
those of the functions compiled into it for the first time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

TABLE = """
import sys, time
import chemage as ca
from numba.core import event
from chemage.scene.warm_up import warm_up
stack, rows = [], []
class Clock(event.Listener):
    def on_start(self, event):
        stack.append(time.process_time())
    def on_end(self, event):
        seconds, function = time.process_time() - stack.pop(), event.data["dispatcher"].py_func
        print(len(stack), f"{seconds:.3f}", f"{function.__module__}.{function.__name__}", sep="\\t")
event.register("numba:compile", Clock())
one = ca.load_scene(sys.argv[1])
warm_up(one)
"""


def table(scene: str) -> None:
    """Print the kernels of a scene and how long each takes to compile."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", TABLE, scene],
            env={**os.environ, "NUMBA_CACHE_DIR": folder, "CHEMAGE_THREADS": "1"},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    kernels: dict[str, list[float]] = defaultdict(list)
    for depth, seconds, name in rows:
        if depth == "0":
            kernels[name].append(float(seconds))
    print(f"{scene}: {sum(map(len, kernels.values()))} kernels, {len(rows)} compilations")
    print(f"{'CPU s':>7} {'signatures':>10}  kernel")
    for name, seconds in sorted(kernels.items(), key=lambda item: -sum(item[1])):
        print(f"{sum(seconds):7.2f} {len(seconds):10}  {name}")
    print(f"{sum(map(sum, kernels.values())):7.2f} {sum(map(len, kernels.values())):10}  all")


def transcript(scene: str) -> None:
    """Print what a first run and a second one say on stderr, each line with its time."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder + "/kernels", "MPLCONFIGDIR": folder + "/matplotlib"}
        for what in ("first", "second"):
            begin = last = time.monotonic()
            silence = 0.0
            process = subprocess.Popen(
                [sys.executable, "-m", "chemage", "run", scene, "--out", str(Path(folder) / f"{what}.h5")],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            assert process.stderr is not None
            print(f"{scene}, {what} run (load of the machine {os.getloadavg()[0]:.1f})")
            for line in process.stderr:
                now = time.monotonic()
                silence, last = max(silence, now - last), now
                print(f"{now - begin:6.1f} s  {line.rstrip()}")
            process.wait()
            end = time.monotonic()
            silence = max(silence, end - last)
            print(f"{end - begin:6.1f} s  end, status {process.returncode}; longest silence {silence:.1f} s")


if __name__ == "__main__":
    names = sys.argv[1:]
    measure = transcript if "--run" in names else table
    for name in [name for name in names if name != "--run"] or ["silica-rough"]:
        measure(name)
