"""Memory, time and transforms of a large contact from end to end: surface, solve, kinetics, file, a part of the file.

    python tests/benchmarks/largest.py [PIXELS ...]

Each size runs in a process of its own: pixels of .4518 nm, rms slope .1, H = .8, waves of 7.5 nm to a third of the
side, a nominal pressure of 15.6 MPa (A/A0 = .9 %), in single precision, two replicas. Memory is the largest resident
set. 16384 x 16384 pixels need 13 GB.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

PIXEL = 0.4518
WATCHED = 0.01


def scene(pixels: int) -> dict[str, Any]:
    """The scene on ``pixels`` x ``pixels``, as data."""
    from chemage.plugin import override, scene_data

    data, _ = scene_data("silica-rough")
    side = pixels * PIXEL
    return override(
        data,
        {
            "surface.pixels": pixels,
            "surface.zeta": side / 7.53,
            "surface.eta": 3,
            "contact.load": 15.62e-3 * side**2,
            "contact.precision": "single",
            "hold.replicas": 2,
        },
    )


class Memory:
    """The largest resident set during each stage."""

    def __init__(self) -> None:
        self.stage = "start"
        self.peak: dict[str, float] = {}
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        page = os.sysconf("SC_PAGE_SIZE")
        while True:
            resident = int(Path("/proc/self/statm").read_text().split()[1]) * page
            self.peak[self.stage] = max(self.peak.get(self.stage, 0.0), resident)
            time.sleep(WATCHED)


def measure(pixels: int) -> dict[str, Any]:
    """Run one size in this process."""
    import chemage

    chemage.run("silica-tip")  # kernels are compiled, or loaded
    memory, used = Memory(), {}

    def enter(stage: str) -> None:
        used[memory.stage] = used.get(memory.stage, 0.0) + time.process_time() - enter.begin  # type: ignore[attr-defined]
        memory.stage, enter.begin = stage, time.process_time()  # type: ignore[attr-defined]

    enter.begin = time.process_time()  # type: ignore[attr-defined]

    def report(stage: str, done: int, total: int) -> None:
        if stage != memory.stage:
            enter(stage)

    run = chemage.run(scene(pixels), progress=report)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.h5"
        enter("writing")
        chemage.write(path, run)
        enter("drawing")
        from chemage.plugin import figures
        from chemage.results import drawing

        figures.save_figures(drawing.figures(run), Path(folder) / "figures")
        enter("a part of the file")
        with chemage.open_maps(path) as maps:
            maps["contact/pressure"][:512, :512]
        enter("end")
        size = path.stat().st_size
    convergence = run.contact.convergence
    return {
        "pixels": pixels,
        "area_fraction": run.contact.area_fraction,
        "sites": int(run.ageing.sites[0]) if run.ageing else 0,
        "iterations": run.contact.iterations,
        "transforms": convergence["transforms"],
        "cpu_seconds": {stage: round(value, 2) for stage, value in used.items() if stage not in ("start", "end")},
        "gigabytes": {stage: round(value / 1e9, 2) for stage, value in memory.peak.items()},
        "bytes_per_pixel": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / pixels**2, 1),
        "file_megabytes": round(size / 1e6),
    }


def main() -> None:
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(int(sys.argv[2]))))
        return
    for pixels in sys.argv[1:] or ["2048", "4096", "8192", "16384"]:
        words = [sys.executable, __file__, "--one", pixels]
        done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)
        print(json.dumps(json.loads(done.stdout), indent=1), flush=True)


if __name__ == "__main__":
    main()
