"""Benchmark of the contact solvers: fft-bem, Tamaas and ContactMechanics on the same surfaces, in one run.

    python tests/benchmarks/contact.py                       # 512² and 1024², only fft-bem: about a minute
    python tests/benchmarks/contact.py --peers               # and the other codes, if installed: half an hour
    python tests/benchmarks/contact.py --peers --grids 512 1024 2500 --write docs/data

Every solve runs in a process of its own on one thread, after a small solve that compiles the kernels. Errors are
relative L2 errors of the pressure against a double-precision solution at a tolerance of 1e-10. The codes measure
convergence differently, so the speed-up compares another code at its tolerance 1e-6 with fft-bem at the loosest
tolerance whose measured error is no larger.
Completed cases in FOLDER/contact_benchmark.json (``--write FOLDER``) are skipped.
The other codes need ``pip install -e '.[bench]'``; Tamaas is under the AGPL.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

PIXEL = 0.4518
MODULUS = 35.3
PEERS = ("tamaas", "contactmechanics")
#: (H, ζ, η, h'_rms, mean pressure in GPa), solved on every grid; more than the last surface only on the first grid
LOADS = (2e-4, 0.016, 0.1, 0.4, 1.2, 3.0, 8.0)
SURFACES = ((0.8, 150, 3), (0.8, 75, 3), (0.8, 15, 3), (0.5, 150, 3), (0.3, 150, 3))
CASE = ("grid", "hurst", "zeta", "eta", "pressure")
TOLERANCES = {"mixed": (1e-4, 1e-5, 1e-6, 3e-7, 1e-7, 3e-8), "single": (1e-5,), "double": (1e-6, 3e-7, 1e-7)}


# -- one solve, in a process of its own -------------------------------------------------------------------------------


def solve(
    code: str, heights: np.ndarray, pressure: float, options: dict[str, Any]
) -> tuple[np.ndarray, dict[str, Any]]:
    """The pressure by one of the codes, and what it cost."""
    import chemage as ca

    solver = ca.contact(code, modulus=MODULUS, **options, **({"threads": 1} if code == "fft-bem" else {}))
    if options.get("precision") == "single":
        heights = heights.astype(np.float32)
    small = ca.Surface(heights=np.random.default_rng(0).standard_normal((128, 128)), pixel_size=PIXEL)
    solver.replace(tolerance=1e-4).solve(small, 1e4)
    heights.setflags(write=False)
    surface = ca.Surface(heights=heights, pixel_size=PIXEL)
    contact, timing = timed(lambda: solver.solve(surface, pressure * surface.nominal_area))
    report = {"transforms": contact.convergence["transforms"]} if code == "fft-bem" else {}
    return contact.pressure, report | {"iterations": contact.iterations or None} | timing


def timed(work: Callable[[], Any]) -> tuple[Any, dict[str, float]]:
    """The result, the shortest of up to three times, and the peak memory of the process after the first run; work
    that takes over five seconds runs once."""
    walls, cpus = [], []
    result, memory = None, 0.0
    while len(walls) < 3 and sum(cpus) < 5.0:
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        memory = memory or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return result, {"wall": min(walls), "cpu": min(cpus), "memory": memory}


def worker(job: dict[str, Any]) -> None:
    """Solve one job and print its cost as a line of JSON."""
    heights = np.load(job["heights"])
    pressure, report = solve(job["code"], heights, job["pressure"], dict(job["options"]))
    report["area"] = float(np.mean(pressure > 0))
    np.save(job["out"], pressure)
    print("RESULT " + json.dumps(report))


# -- the whole run ----------------------------------------------------------------------------------------------------


class Runner:
    """Runs each job in a process of its own."""

    def __init__(self, folder: Path, limit: float) -> None:
        self.folder, self.limit = folder, limit
        threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
        self.environment = os.environ | dict.fromkeys(threads, "1")

    def __call__(self, code: str, heights: Path, pressure: float, **options: Any) -> dict[str, Any]:
        job = {
            "code": code,
            "heights": str(heights),
            "pressure": pressure,
            "options": options,
            "out": str(self.folder / "p.npy"),
        }
        command = [sys.executable, __file__, "--worker", json.dumps(job)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=self.limit)
        except subprocess.TimeoutExpired:
            return {"code": code, "failed": f"over {self.limit:g} s"}
        lines = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
        if not lines:
            return {"code": code, "failed": (done.stderr.strip().splitlines() or ["no output"])[-1]}
        return {"code": code, **options, **json.loads(lines[-1].removeprefix("RESULT "))}

    def pressure(self) -> np.ndarray:
        return np.load(self.folder / "p.npy").astype(np.float64)


def surface_file(folder: Path, grid: int, hurst: float, zeta: float, eta: float) -> Path:
    """Heights of the surface of seed 1 with rms slope 0.1, as a file."""
    from chemage_surfaces import SelfAffine

    path = folder / f"h-{grid}-{hurst}-{zeta}-{eta}.npy"
    if not path.exists():
        maker = SelfAffine(
            pixels=grid, pixel_size=PIXEL, hurst=hurst, zeta=min(zeta, grid // 2), eta=eta, rms_slope=0.1
        )
        np.save(path, maker.make(seed=1).heights)
    return path


def compare(run: Runner, case: dict[str, Any], peers: Sequence[str]) -> dict[str, Any]:
    """All codes on one surface at one load."""
    heights = surface_file(run.folder, case["grid"], case["hurst"], case["zeta"], case["eta"])
    load = case["pressure"]
    reference_report = run("fft-bem", heights, load, tolerance=1e-10, precision="double")
    if "failed" in reference_report:
        return case | {"failed": reference_report["failed"]}
    reference = run.pressure()
    area = np.count_nonzero(reference)

    def measured(report: dict[str, Any]) -> dict[str, Any]:
        if "failed" not in report:
            p = run.pressure()
            report["error"] = float(np.linalg.norm(p - reference) / np.linalg.norm(reference))
            report["area_error"] = float(np.count_nonzero(p > 0) / area - 1.0)
        return report

    ours = [
        measured(run("fft-bem", heights, load, tolerance=tolerance, precision=precision))
        for precision, tolerances in TOLERANCES.items()
        for tolerance in tolerances
    ]
    theirs = [measured(run(peer, heights, load, tolerance=1e-6)) for peer in peers]
    for peer in theirs:
        if "failed" in peer:
            continue
        for precision in ("mixed", "double"):
            good = [o for o in ours if o.get("precision") == precision and o.get("error", 1.0) <= peer["error"]]
            if good:
                peer[f"speedup_{precision}"] = peer["cpu"] / good[0]["cpu"]
    return case | {"area": float(area / reference.size), "reference": reference_report, "ours": ours, "peers": theirs}


def cases(grids: list[int]) -> list[dict[str, Any]]:
    """The reference surface at all loads on the smallest grid, at three loads on the others; other surfaces at two."""
    found = []
    for grid in grids:
        for i, (hurst, zeta, eta) in enumerate(SURFACES):
            loads: tuple[float, ...] = LOADS if i == 0 else (0.016, 0.4)
            if grid != grids[0]:
                loads = () if i else (0.016,) if grid > 1024 else (0.016, 0.4, 3.0)
            for load in loads:
                found.append({"grid": grid, "hurst": hurst, "zeta": zeta, "eta": eta, "pressure": load})
    return found


def row(case: dict[str, Any], result: dict[str, Any]) -> str:
    name = {"fft-bem": "fft-bem", "tamaas": "Tamaas", "contactmechanics": "ContactMechanics"}[result["code"]]
    surface = f"{case['grid']}² | {case['hurst']:g}, {case['zeta']:g} | {case['pressure'] * 1e3:g}"
    if "failed" in result:
        return f"| {surface} | {name} | | {result['failed']} | | | | | | | |"
    how = f"{result.get('precision', 'double')} {result['tolerance']:g}"
    gains = [f"{result[key]:.0f}×" for key in ("speedup_mixed", "speedup_double") if key in result]
    return (
        f"| {surface} | {name} | {how} | {result['cpu']:.2f} | {result['wall']:.2f} | {result['memory']:.0f} | "
        f"{result.get('iterations') or '–'} | {result.get('transforms', '–')} | {result['error']:.1e} | "
        f"{result['area_error']:.0e} | {' / '.join(gains) or '–'} |"
    )


def table(results: list[dict[str, Any]]) -> str:
    lines = [
        (
            "| grid | H, ζ | mean pressure (MPa) | code | precision, tolerance | CPU (s) | wall (s) | "
            "peak memory (MB) | iterations | transforms | pressure error | area error | "
            "fft-bem is faster by (mixed / double) |"
        ),
        "|" + "---|" * 13,
    ]
    for case in results:
        if "failed" in case:
            lines.append(f"| {case['grid']}² | {case['hurst']:g}, {case['zeta']:g} | | reference: {case['failed']} |")
            continue
        lines += [row(case, result) for result in [*case["ours"], *case["peers"]]]
    return "\n".join(lines)


def machine() -> str:
    """Processor and cores, for the table's caption."""
    model = platform.processor() or platform.machine()
    try:
        info = Path("/proc/cpuinfo").read_text()
        model = next(line.split(":")[1].strip() for line in info.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores; each solve on one thread"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grids", type=int, nargs="+", default=[512, 1024], help="pixels along an edge")
    parser.add_argument("--peers", nargs="*", choices=PEERS, help="compare with these codes (default: all of them)")
    parser.add_argument("--loads", type=float, nargs="+", help="only these mean pressures, in GPa")
    parser.add_argument("--limit", type=float, default=1200.0, help="largest wall time of one solve in seconds")
    parser.add_argument("--write", type=Path, help="folder for contact_benchmark.json, such as docs/data")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(json.loads(arguments.worker))
        return
    peers = [] if arguments.peers is None else (arguments.peers or list(PEERS))
    kept = arguments.write / "contact_benchmark.json" if arguments.write else None
    results = json.loads(kept.read_text()) if kept and kept.exists() else []
    known = [{name: r[name] for name in CASE} for r in results]
    with tempfile.TemporaryDirectory() as folder:
        run = Runner(Path(folder), arguments.limit)
        for case in cases(arguments.grids):
            if case in known or (arguments.loads and case["pressure"] not in arguments.loads):
                continue
            results.append(compare(run, case, peers))
            print("\n".join(table(results[-1:]).splitlines()[2:]), flush=True)
            results.sort(key=lambda r: [r["grid"], -r["hurst"], -r["zeta"], r["pressure"]])
            if kept:
                kept.write_text(json.dumps(results, indent=1))
    print(f"{machine()}\n\n{table(results)}")


if __name__ == "__main__":
    main()
