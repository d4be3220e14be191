"""fft-bem with a hardness beside KatoSaturated of Tamaas on the same surfaces, and beside itself without, in one run.

    python tests/benchmarks/hardness.py --peer-python PYTHON       # 512² and 1024², 3 loads, 3 hardnesses: an hour
    python tests/benchmarks/hardness.py                            # fft-bem alone: a minute
    python tests/benchmarks/hardness.py --cost 60                  # random contacts, from full yield to hardly any

Every solve runs in a process of its own on one thread, the kernels compiled before; CPU seconds. Tamaas (AGPL) is run
by the interpreter PYTHON in which it is installed. Both have a tolerance of 1e-7 (that of Tamaas bounds the sum of
pressure times gap, which leaves a pressure as accurate or less so); errors are relative L2 errors of the pressure
against fft-bem in double precision at 1e-9. At 256² Tamaas at 1e-10 differs from fft-bem at 1e-9 by 3e-9 to 5e-9.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

PIXEL, MODULUS = 0.4518, 35.3
#: rms slope 0.4; mean pressures and hardnesses, GPa
SLOPE, PRESSURES, HARDNESSES = 0.4, (0.03, 0.3, 1.5), (20.0, 10.0, 4.0)
#: of both codes
TOLERANCE = 1e-7


def fft_bem(heights: np.ndarray, pressure: float, hardness: float | None, **options: Any) -> dict[str, float]:
    from chemage import Surface
    from chemage_contact import FFTBEM

    solver = FFTBEM(modulus=MODULUS, threads=1, hardness=hardness, **options)
    small = Surface(heights=np.random.default_rng(0).standard_normal((128, 128)), pixel_size=PIXEL)
    solver.replace(hardness=hardness and 1e3).solve(small, 1e4)
    heights.setflags(write=False)
    surface = Surface(heights=heights, pixel_size=PIXEL)
    seconds, found = timed(solver, surface, pressure)
    np.save("p.npy", found.pressure)
    return {"cpu": seconds, "iterations": found.iterations, "area": found.area_fraction}


def timed(solver: Any, surface: Any, pressure: float) -> tuple[float, Any]:
    """Least CPU seconds of three solves after one that compiles, and the contact."""
    times, found = [], solver.solve(surface, pressure * surface.nominal_area)
    for _ in range(3):
        begin = time.process_time()
        found = solver.solve(surface, pressure * surface.nominal_area)
        times.append(time.process_time() - begin)
    return min(times), found


def tamaas(heights: np.ndarray, pressure: float, hardness: float, tolerance: float) -> dict[str, float]:
    import tamaas as tm  # pyright: ignore[reportMissingImports]

    tm.set_log_level(tm.LogLevel.error)
    sides = [n * PIXEL for n in heights.shape]
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, sides, list(heights.shape))
    model.E, model.nu = MODULUS, 0.0
    solver = tm.KatoSaturated(model, heights, tolerance, hardness)
    solver.max_iter = 5000
    begin = time.process_time()
    solver.solve(pressure)
    seconds = time.process_time() - begin
    np.save("p.npy", np.array(model.traction).reshape(heights.shape))
    return {"cpu": seconds}


def run(python: str, code: str, folder: str, *arguments: object) -> tuple[dict[str, float], np.ndarray]:
    """One solve in a process of its own: its report and its pressure."""
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    command = [python, str(Path(__file__).resolve()), "--worker", code, json.dumps(arguments)]
    environment = os.environ | dict.fromkeys(threads, "1")
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, cwd=folder, env=environment)
    return json.loads(done.stdout.splitlines()[-1]), np.load(Path(folder) / "p.npy").astype(np.float64)


def worker(code: str, arguments: str) -> None:
    pressure, hardness, options = json.loads(arguments)
    solve = fft_bem if code == "fft-bem" else tamaas
    print(json.dumps(solve(np.load("h.npy"), pressure, hardness, **options)))


def compared(folder: str, peer: str | None, pressure: float, hardness: float) -> str:
    """One line of the table."""
    elastic, _ = run(sys.executable, "fft-bem", folder, pressure, None, {"tolerance": TOLERANCE})
    ours, mine = run(sys.executable, "fft-bem", folder, pressure, hardness, {"tolerance": TOLERANCE})
    exact = run(sys.executable, "fft-bem", folder, pressure, hardness, {"tolerance": 1e-9, "precision": "double"})[1]
    size = np.linalg.norm(exact)
    yielded = float(mine.sum(where=mine >= hardness) / mine.sum())
    cells = [f"{pressure:g}", f"{hardness:g}", f"{ours['area']:.4f}", f"{yielded:.3f}"]
    cells += [f"{ours['iterations']:.0f}", f"{ours['cpu']:.3f}", f"{ours['cpu'] / elastic['cpu']:.2f}"]
    cells += [f"{np.linalg.norm(mine - exact) / size:.1e}"]
    if peer:
        other_time, theirs = run(peer, "tamaas", folder, pressure, hardness, {"tolerance": TOLERANCE})
        cells += [f"{other_time['cpu']:.1f}", f"{other_time['cpu'] / ours['cpu']:.0f}"]
        cells += [f"{np.linalg.norm(theirs - other) / size:.1e}" for other in (exact, mine)]
    return "| " + " | ".join(cells) + " |"


def cost(count: int) -> None:
    """CPU time over that of the elastic contact, of the installed ``silica-rough`` and ``count`` random contacts."""
    import chemage as ca
    from chemage_surfaces import SelfAffine

    ratios = []
    for number in range(count + 1):
        rng = np.random.default_rng(number)
        pixels, slope = int(rng.choice([256, 400, 512, 512, 1024])), 10 ** rng.uniform(-2, 0)
        zeta, hurst = pixels // int(rng.choice([2, 8, 32])), float(rng.choice([0.3, 0.8]))
        mean = MODULUS * slope * 10 ** rng.uniform(-4, -0.3)
        options = {
            "precision": str(rng.choice(["single", "mixed", "double"])),
            "tolerance": 10.0 ** -rng.integers(3, 7),
        }
        if number == 0:
            pixels, slope, zeta, hurst, mean = 2500, 0.1, 150, 0.8, 20e3 / (2500 * PIXEL) ** 2
            options = {}
        maker = SelfAffine(pixels=pixels, pixel_size=PIXEL, hurst=hurst, zeta=zeta, eta=3, rms_slope=slope)
        surface = ca.Surface(heights=maker.make(7).heights, pixel_size=PIXEL, periodic=number % 5 != 1)
        solver = ca.contact("fft-bem", modulus=MODULUS, threads=1, **options)
        elastic, found = timed(solver, surface, mean)
        most = found.max_pressure / mean
        print(f"{pixels}² {options} p {mean:.2g} elastic {elastic:.3f} s {steps(found)}", flush=True)
        for factor in (1.001, 1 + 10 ** rng.uniform(-3, 0.5), max(most, 1.01) ** rng.uniform()):
            seconds, found = timed(solver.replace(hardness=mean * factor), surface, mean)
            ratios.append(seconds / elastic)
            share = f"yielded {found.yielded.load:.4f}"
            print(f"    H/p {factor:.4g} {share} {seconds:.3f} s {ratios[-1]:.2f} {steps(found)}", flush=True)
    print("median, 90 %, largest:", *(f"{x:.2f}" for x in np.quantile(ratios, [0.5, 0.9, 1])))


def steps(contact: Any) -> str:
    """Iterations, from the coarsest grid to the finest, and transforms of the finest."""
    levels = [level["iterations"] for level in contact.convergence["levels"]]
    return f"iterations {levels} transforms {contact.convergence['transforms']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grids", type=int, nargs="+", default=[512, 1024], help="pixels along an edge")
    parser.add_argument("--peer-python", help="interpreter in which Tamaas is installed")
    parser.add_argument("--cost", type=int, help="random contacts whose time is compared with the elastic one")
    parser.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(*arguments.worker)
        return
    if arguments.cost is not None:
        cost(arguments.cost)
        return
    from chemage_surfaces import SelfAffine

    columns = ["p (GPa)", "H (GPa)", "A/A0", "yielded load", "iterations", "CPU (s)", "over elastic", "error"]
    columns += ["Tamaas (s)", "faster by", "its error", "difference"] if arguments.peer_python else []
    for grid in arguments.grids:
        maker = SelfAffine(pixels=grid, pixel_size=PIXEL, hurst=0.8, zeta=grid // 8, eta=3, rms_slope=SLOPE)
        print(f"{grid}²\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            np.save(Path(folder) / "h.npy", maker.make(seed=1).heights)
            for pressure in PRESSURES:
                for hardness in HARDNESSES:
                    print(compared(folder, arguments.peer_python, pressure, hardness), flush=True)


if __name__ == "__main__":
    main()
