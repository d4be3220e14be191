"""The reference rough contact solved on coarser grids, with the sites as they are: errors of bonds and of β.

    python tests/benchmarks/site_errors.py [seeds of the surface]      # 3 7 11: about five minutes

Scene silica-rough with sites 0.4518 nm apart. The contact is solved on 2500² pixels, one per site, and on grids 2 and 4
times coarser, which sample the same surface; all replicas have their random numbers in common. Printed are the
difference in bonds at each decade from 1 s to 1e5 s and in β, and the CPU time of the contact. "repeated" is what a
coarse contact gives whose pixels are simply repeated.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import chemage as ca

SITES, SPACING, FACTORS = 2500, 0.4518, (2, 4)
DECADES = [10.0**n for n in range(6)]


def solved(scene: ca.Scene, seed: int, factor: int) -> tuple[ca.ContactSolution, float]:
    """The contact on pixels of ``factor`` sites a side, and CPU seconds: the faster of two solves."""
    pixels = (SITES // factor, SITES // factor)
    surface = scene.surface.replace(pixels=pixels, pixel_size=SPACING * factor).make(seed)
    solver = scene.contact.replace(threads=1, gap=factor > 1)
    spent = []
    for _ in range(2):
        begin = time.process_time()
        solution = solver.solve(surface, scene.load)
        spent.append(time.process_time() - begin)
    return solution, min(spent)


def repeated(contact: ca.ContactSolution, factor: int) -> ca.ContactSolution:
    """Every pixel as ``factor`` x ``factor`` sites."""
    pressure = np.kron(contact.pressure, np.ones((factor, factor), contact.pressure.dtype))
    return contact.model_copy(update={"pressure": pressure, "pixel_size": contact.pixel_size / factor, "gap": None})


def aged(scene: ca.Scene, contact: ca.ContactSolution) -> ca.Aging:
    """Its ageing, with all random numbers in common."""
    assert scene.chemistry is not None
    assert scene.engine is not None
    assert scene.hold is not None
    return ca.age(
        contact,
        scene.chemistry,
        engine=scene.engine,
        hold_times=scene.hold.hold_times,
        temperature=300.0,
        replicas=scene.hold.replicas,
        seed=0,
        common="all",
    )


def main() -> None:
    scene = ca.load_scene("silica-rough")
    aged(scene, solved(scene, 1, 5)[0])  # to compile
    print("| seed | contact | CPU s | ratio | sites | " + " | ".join(f"{t:g} s" for t in DECADES) + " | β |")
    print("|" + " --- |" * 12)
    for seed in [int(word) for word in sys.argv[1:]] or [3, 7, 11]:
        contact, seconds = solved(scene, seed, 1)
        fine = aged(scene, contact)
        at = [int(np.argmin(np.abs(np.log(fine.hold_times / t)))) for t in DECADES]
        beta = fine.fit().beta
        print(f"| {seed} | {SITES}² | {seconds:.2f} | | {fine.sites[0]} |" + " |" * 7, flush=True)
        for factor in FACTORS:
            coarse, spent = solved(scene, seed, factor)
            begin = time.process_time()
            ca.contact_sites(coarse, 4.9)
            more = time.process_time() - begin
            for name, one in (("", coarse), (" repeated", repeated(coarse, factor))):
                made = aged(scene, one)
                off = made.bonds.mean(axis=0)[at] / fine.bonds.mean(axis=0)[at] - 1
                print(
                    f"| {seed} | {SITES // factor}²{name} | {spent:.2f} + {more:.2f} | {seconds / (spent + more):.1f} "
                    f"| {made.sites[0]} ({100 * (made.sites[0] / fine.sites[0] - 1):+.1f} %) | "
                    + " | ".join(f"{100 * value:+.2f} %" for value in off)
                    + f" | {100 * (made.fit().beta / beta - 1):+.2f} % |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
