"""What the machinery of a sweep costs: time a point without the stages themselves, and memory of the parent.

    python tests/benchmarks/sweep.py [POINTS] [--executor processes --workers 2]

Tiny scenes (a sphere on 16 x 16 pixels, two replicas), every point with its own kinetics, one contact for a hundred of
them. Time inside the four stages is taken out by a plugin that wraps them (serial only). Targets: under 20 ms a point,
and under 500 MB for 10,000 points.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import chemage
from chemage.plugin import registry
from chemage.studies.sweeps.running import read_grid, survey_of

SCENE = {
    "name": "tiny",
    "surface": {"kind": "sphere", "radius": 30.0, "pixels": 16, "pixel_size": 0.5},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": 10.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": 1e-3, "stop": 1e5, "per_decade": 4, "replicas": 2},
}


class Stages:
    """Adds up what the stages themselves take."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def _timed(self):
        begin = time.perf_counter()
        answer = yield
        self.seconds += time.perf_counter() - begin
        return answer

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_make_surface(self):
        return (yield from self._timed())

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_solve_contact(self):
        return (yield from self._timed())

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_build_lattice(self):
        return (yield from self._timed())

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_run_kinetics(self):
        return (yield from self._timed())


def peak() -> float:
    """Largest memory of this process so far, MB."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / 1e6 if sys.platform == "darwin" else used / 1e3


def main() -> None:
    """Run the sweep and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", type=int, nargs="?", default=10_000)
    parser.add_argument("--executor", default="serial")
    parser.add_argument("--workers", type=int)
    options = parser.parse_args()
    loads = max(1, options.points // 100)
    swept = {"contact.load": [5.0 + 5.0 * n / loads for n in range(loads)], "hold.seed": list(range(100))}
    scene = {**SCENE, "sweep": swept}
    stages = Stages()
    if options.executor == "serial":
        registry.current().register(stages, "stages")
    started = peak()
    with tempfile.TemporaryDirectory() as folder:
        one = {**SCENE, "sweep": {"hold.seed": [0]}}
        chemage.sweep(one, Path(folder) / "warm-up")
        begin = time.perf_counter()
        found = survey_of(read_grid(scene))
        validated = time.perf_counter() - begin
        count = found.grid.size
        stages.seconds = 0.0
        begin = time.perf_counter()
        result = chemage.sweep(
            scene, Path(folder) / "out", executor=options.executor, workers=options.workers, threads=1, progress=True
        )
        wall = time.perf_counter() - begin
        assert result.status()["done"] == count
        begin = time.perf_counter()
        again = chemage.sweep(scene, Path(folder) / "out")
        resumed = time.perf_counter() - begin
        assert len(again) == count
        size = sum(file.stat().st_size for file in (Path(folder) / "out").rglob("*") if file.is_file())
    print(f"points                     {count} on {len(found.contacts)} contacts, executor {options.executor}")
    print(f"wall time                  {wall:.1f} s, {1e3 * wall / count:.2f} ms a point")
    if options.executor == "serial":
        print(f"without the stages         {1e3 * (wall - stages.seconds) / count:.2f} ms a point (target 20)")
    print(f"  of it validation         {1e3 * validated / count:.2f} ms a point")
    print(f"found done, run again      {1e3 * resumed / count:.2f} ms a point")
    print(f"folder                     {size / 1e6:.1f} MB")
    print(f"memory of the parent       {peak():.0f} MB at most, {started:.0f} MB when it began (target 500)")


if __name__ == "__main__":
    main()
