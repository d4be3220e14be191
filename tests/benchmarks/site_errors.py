"""The reference rough contact solved on coarser grids, with the sites as they are: errors of bonds and of β.

    python tests/benchmarks/site_errors.py [seeds of the surface]      # 3 7 11: five to ten minutes

Scene silica-rough with sites 0.4518 nm apart. The contact is solved on 2500² pixels, one per site, and on grids 2 and 4
times coarser, which sample the same surface; all replicas have their random numbers in common. Printed are the
difference in bonds at each decade from 1 s to 1e5 s and in β, and the CPU time of the contact alone. "repeated" is what
a coarse contact gives whose pixels are simply repeated.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import chemage as ca

SITES, SPACING, FACTORS, ROUNDS = 2500, 0.4518, (2, 4), 7
#: rows of the second table
TIMES: list[str] = []
DECADES = [10.0**n for n in range(6)]


def solver(scene: ca.Scene, factor: int, threads: int | None) -> ca.plugin.ContactSolver:
    """That of the scene, with the gap where sites are smaller than pixels."""
    return scene.contact.replace(threads=threads, gap=factor > 1)


def solved(scene: ca.Scene, seed: int) -> dict[int, ca.ContactSolution]:
    """Contacts on pixels of 1, 2 and 4 sites a side; printed are the least CPU seconds of ``ROUNDS`` solves of each in
    turn, on one thread and on as many as the scene takes, and those of placing the sites."""
    surfaces, contacts = {}, {}
    for factor in (1, *FACTORS):
        pixels = (SITES // factor, SITES // factor)
        surfaces[factor] = scene.surface.replace(pixels=pixels, pixel_size=SPACING * factor).make(seed)
    spent: dict[tuple[int, int | None], float] = {}
    for _ in range(ROUNDS):
        for threads in (1, None):
            for factor, surface in surfaces.items():
                begin = time.process_time()
                contacts[factor] = solver(scene, factor, threads).solve(surface, scene.load)
                key = (factor, threads)
                spent[key] = min(spent.get(key, 1e9), time.process_time() - begin)
    for factor, contact in contacts.items():
        begin = time.process_time()
        ca.plugin.contact_sites(contact, 4.9)
        more = time.process_time() - begin
        cells = [
            f"{spent[factor, threads]:.3f} | {spent[1, threads] / spent[factor, threads]:.1f}" for threads in (1, None)
        ]
        of = ", ".join(f"{level['pixels'][0]}²: {level['iterations']}" for level in contact.convergence["levels"])
        transforms = contact.convergence["transforms"]
        TIMES.append(f"| {seed} | {SITES // factor}² | {' | '.join(cells)} | {more:.3f} | {of} | {transforms} |")
    return contacts


def repeated(contact: ca.ContactSolution, factor: int) -> ca.ContactSolution:
    """Every pixel as ``factor`` x ``factor`` sites."""
    pressure = np.kron(contact.pressure, np.ones((factor, factor), contact.pressure.dtype))
    return contact.model_copy(update={"pressure": pressure, "pixel_size": contact.pixel_size / factor, "gap": None})


def aged(scene: ca.Scene, contact: ca.ContactSolution) -> ca.Ageing:
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
    for factor in (1, *FACTORS):  # to compile, which is no part of the times
        pixels = (SITES // factor, SITES // factor)
        surface = scene.surface.replace(pixels=pixels, pixel_size=SPACING * factor).make(1)
        compiled = solver(scene, factor, None).solve(surface, scene.load)
    ca.plugin.contact_sites(compiled, 4.9)
    print("| seed | contact | sites | " + " | ".join(f"{t:g} s" for t in DECADES) + " | β |")
    print("|" + " --- |" * 10)
    for seed in [int(word) for word in sys.argv[1:]] or [3, 7, 11]:
        contacts = solved(scene, seed)
        fine = aged(scene, contacts[1])
        at = [int(np.argmin(np.abs(np.log(fine.hold_times / t)))) for t in DECADES]
        beta = fine.fit().beta
        print(f"| {seed} | {SITES}² | {fine.sites[0]} |" + " |" * 7, flush=True)
        for factor in FACTORS:
            for name, one in (("", contacts[factor]), (" repeated", repeated(contacts[factor], factor))):
                made = aged(scene, one)
                off = made.bonds.mean(axis=0)[at] / fine.bonds.mean(axis=0)[at] - 1
                print(
                    f"| {seed} | {SITES // factor}²{name} | {100 * (made.sites[0] / fine.sites[0] - 1):+.1f} % | "
                    + " | ".join(f"{100 * value:+.2f} %" for value in off)
                    + f" | {100 * (made.fit().beta / beta - 1):+.2f} % |",
                    flush=True,
                )
    print(
        "\n| seed | contact | CPU s, 1 thread | ratio | CPU s, default threads | ratio | placing sites, CPU s |", end=""
    )
    print(" iterations per grid | transforms |\n|" + " --- |" * 9)
    print("\n".join(TIMES))


if __name__ == "__main__":
    main()
