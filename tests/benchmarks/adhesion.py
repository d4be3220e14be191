"""Adhesive contacts: random surfaces over decades, spheres against JKR and DMT, rough contacts against Tamaas.

    python tests/benchmarks/adhesion.py random --cases 250
    python tests/benchmarks/adhesion.py spheres
    python tests/benchmarks/adhesion.py tamaas --pixels 256 --python /path/to/python-with-tamaas

``tamaas`` (AGPL) is run by another interpreter, and only by this script. Times are CPU seconds of one thread.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import chemage as ca
from chemage import InputError
from chemage.plugin import ConvergenceError

E = 35.3

TAMAAS = """
import sys, time
import numpy as np, tamaas as tm
case = np.load(sys.argv[1])
tm.set_log_level(tm.LogLevel.error)
h, n, side = case["h"], case["h"].shape[0], float(case["side"])
model = tm.ModelFactory.createModel(tm.model_type.basic_2d, [side, side], [n, n])
model.E, model.nu = float(case["modulus"]), 0.0
begin = time.process_time()
solver = tm.PolonskyKeerRey(model, h, float(case["tolerance"]), tm.PolonskyKeerRey.gap, tm.PolonskyKeerRey.pressure)
attraction = tm.ExponentialAdhesionFunctional(h)
attraction.parameters = {"rho": float(case["range"]), "surface_energy": float(case["work"])}
solver.addFunctionalTerm(attraction)
solver.max_iter = 3000
error = solver.solve(float(case["pressure"]))
np.savez(sys.argv[2], gap=np.array(model["gap"]), traction=np.array(model.traction), error=error,
         seconds=time.process_time() - begin)
"""


def rough(pixels: int, slope: float, seed: int, hurst: float = 0.8) -> Any:
    maker = ca.surface(
        "self-affine", pixels=pixels, pixel_size=0.4518, hurst=hurst, zeta=pixels / 8, eta=3, rms_slope=slope
    )
    return maker.make(seed)


def bem(**options: Any) -> Any:
    return ca.contact("adhesive-bem", modulus=E, **options)


def random_cases(cases: int) -> None:
    """Loads of 1e-4 to 1 of full contact, both signs; w and ρ over four and three decades; both laws and boundaries."""
    rng = np.random.default_rng(33)
    counts = {"converged": 0, "pixels refused": 0, "apart": 0, "not converged": 0, "wrong": 0}
    iterations = []
    for number in range(cases):
        slope, pixels = 10 ** rng.uniform(-2, 0), int(rng.choice([32, 48, 63, 64]))
        free = rng.random() < 0.3
        if free:
            radius = 10 ** rng.uniform(0.5, 2.5)
            surface = ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=0.4518).make()
        else:
            surface = rough(pixels, slope, number, rng.uniform(0.2, 0.9))
        load = 10 ** rng.uniform(-4, -0.3) * E * min(surface.rms_slope, 1) * surface.nominal_area
        load *= -0.01 if rng.random() < 0.2 else 0.03 if free else 1
        solver = bem(
            work_of_adhesion=10 ** rng.uniform(-4, 0),
            range=10 ** rng.uniform(-1.5, 1.5),
            law=str(rng.choice(["exponential", "dugdale"])),
            start=str(rng.choice(["apart", "contact"])),
            gap=True,
        )
        try:
            contact = solver.solve(surface, load)
        except InputError as error:
            counts["apart" if "apart" in str(error) else "pixels refused"] += 1
            continue
        except ConvergenceError as error:
            counts["not converged"] += 1
            print(number, solver, load, error)
            continue
        iterations.append(contact.iterations)
        right = contact.converged and contact.residual <= solver.tolerance and not contact.load_fault(0.0)
        counts["converged" if right and _balanced(solver, surface, contact) else "wrong"] += 1
        if not right:
            print(number, solver, load, contact, contact.convergence)
    print(counts, f"iterations: median {np.median(iterations):.0f}, largest {max(iterations)}")


def _balanced(solver: Any, surface: Any, contact: Any) -> bool:
    """Whether, on periodic surfaces, the gap that follows from the pressure is that of the solution, and open pixels
    are under no more tension than the attraction."""
    least = contact.pressure[contact.touching] + solver.work_of_adhesion / solver.range
    size = math.sqrt(float(np.mean(contact.pressure**2)))
    if least.size and least.min() < -1e-3 * max(size, solver.work_of_adhesion / solver.range):
        return False
    if not surface.periodic:
        return True
    q = np.hypot(*np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n, 0.4518) for n in surface.shape), indexing="ij"))
    q[0, 0] = np.inf
    gap = np.fft.ifft2(2 * np.fft.fft2(contact.pressure) / (E * q)).real - surface.heights
    difference = gap - contact.gap
    return float(np.ptp(difference)) < 1e-6 * surface.rms_height


def spheres() -> None:
    """Pull-off and radius of a sphere against JKR (Tabor's parameter 5 and 8) and DMT (0.1 and 0.05)."""
    radius, work = 30.0, 0.1
    for tabor in (8.0, 5.0, 1.0, 0.1, 0.05):
        reach = (radius * work**2 / E**2 / tabor**3) ** (1 / 3)
        jkr: Any = ca.contact("jkr", modulus=E, work_of_adhesion=work)
        maugis: Any = ca.contact("maugis", modulus=E, work_of_adhesion=work, range=reach)
        wide = 2.8 * jkr.at_load(radius, 3.0).edge + 8 * math.sqrt(2 * radius * reach) * (tabor < 5)
        pixels = 2 * math.ceil(0.5 * max(wide / (0.5 * E * reach**2 / work), 192))
        surface = ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=wide / pixels).make()
        for law in ("exponential", "dugdale"):
            solver = bem(work_of_adhesion=work, range=reach, law=law, threads=1)
            begin = time.process_time()
            loop = solver.loop(surface, np.linspace(jkr.at_load(radius, 3.0).displacement, -0.1 - reach, 40))
            stable = slice(0, max(int(np.argmin(loop.load)) - 1, 1))
            away = np.sqrt(loop.area[stable] / math.pi) / [
                jkr.at_load(radius, max(load, -jkr.pull_off(radius))).edge for load in loop.load[stable]
            ]
            unit = math.pi * work * radius
            print(
                f"Tabor {tabor}, {law}: {pixels} pixels a side, pull-off {loop.pull_off.value / unit:.4f} πwR "
                f"(Maugis {maugis.pull_off(radius) / unit:.4f}), radius over that of JKR {away.min():.4f} to "
                f"{away.max():.4f}, {time.process_time() - begin:.1f} s"
            )


def tamaas(python: str, pixels: int) -> None:
    """Area, traction and time at equal tolerance; and the time of the contact without attraction."""
    print(
        "w ρ (J/m², nm): area here, area there, difference of tractions (L2), CPU seconds here, there, ratio; elastic"
    )
    for work, reach in ((0.02, 0.3), (0.05, 0.3), (0.1, 0.5)):
        surface = rough(pixels, 0.1, 1)
        load = 0.01 * E * 0.1 * surface.nominal_area
        options = {"work_of_adhesion": work, "range": reach, "threads": 1}
        solver = bem(tolerance=1e-6, max_iterations=5000, **options)
        plain = ca.contact("fft-bem", modulus=E, tolerance=1e-6, threads=1)
        times = []
        for one in (plain, solver):
            one.solve(surface, load)  # compiles
            begin = time.process_time()
            contact = one.solve(surface, load)
            times.append(time.process_time() - begin)
        elastic, seconds = times
        with tempfile.TemporaryDirectory() as folder:
            given, answer = Path(folder, "case.npz"), Path(folder, "answer.npz")
            np.savez(
                given, h=surface.heights, side=pixels * surface.pixel_size, modulus=E, range=reach, work=work,
                pressure=load / surface.nominal_area, tolerance=1e-6,
            )  # fmt: skip
            subprocess.run([python, "-c", TAMAAS, str(given), str(answer)], check=True, env={"OMP_NUM_THREADS": "1"})
            other = dict(np.load(answer))
        area = float(np.mean(other["gap"] < 1e-6 * surface.rms_height))
        away = float(np.linalg.norm(other["traction"] - contact.pressure) / np.linalg.norm(other["traction"]))
        there = float(other["seconds"])
        print(
            f"{work} {reach}: {contact.area_fraction:.5f} {area:.5f} {away:.2g} {seconds:.2f} {there:.2f} "
            f"{there / seconds:.0f}; {elastic:.3f}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["random", "spheres", "tamaas"])
    parser.add_argument("--cases", type=int, default=250)
    parser.add_argument("--pixels", type=int, default=256)
    parser.add_argument("--python", default="python")
    given = parser.parse_args()
    if given.what == "random":
        random_cases(given.cases)
    elif given.what == "spheres":
        spheres()
    else:
        tamaas(given.python, given.pixels)
