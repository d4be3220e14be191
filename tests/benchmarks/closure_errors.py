"""Errors of ageing ``closure`` on five tips and five rough contacts at two strengths of the interaction.

The reference is the kinetics of every site; nothing in the closure was fitted to a contact. The table of the chemistry
is made first, if it is not kept from an earlier run (``--folder`` for a fresh one). Run with
``python tests/benchmarks/closure_errors.py``; it takes about five minutes, and writes a table in Markdown.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

import chemage as ca

TIMES = 10.0 ** np.arange(6)
STRENGTHS = (0.1, 0.5)
#: (radius nm, load nN)
TIPS = ((15.0, 30.0), (30.0, 50.0), (30.0, 300.0), (70.0, 200.0), (150.0, 900.0))
#: (rms slope, Hurst exponent, nominal pressure over that of silica-patch, seed)
ROUGH = ((0.05, 0.8, 1.0, 201), (0.1, 0.8, 1.0, 202), (0.1, 0.5, 2.0, 203), (0.2, 0.8, 1.0, 204), (0.2, 0.8, 4.0, 205))
#: bonds that are counted at the first hold time, over all replicas: their statistical error is 0.4 %
BONDS = 60_000


def contacts() -> Iterator[tuple[str, ca.ContactSolution]]:
    """Name and solution of each contact."""
    for radius, load in TIPS:
        pixels = 2 * math.ceil(1.3 * math.cbrt(0.75 * load * radius / 35.3) / 0.4518) + 4
        tip = ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=0.4518).make()
        yield f"tip {radius:g} nm, {load:g} nN", ca.contact("hertz", modulus=35.3).solve(tip, load)
    patch = ca.parse_scene(ca.scene_data("silica-patch")[0])
    for slope, hurst, factor, seed in ROUGH:
        surface: Any = patch.surface.replace(rms_slope=slope, hurst=hurst)
        solution = patch.contact.solve(surface.make(seed), factor * patch.load)
        yield f"rough {slope:g}, H {hurst:g}, {factor:g}×, seed {seed}", solution


def chemistry(strength: float) -> ca.Chemistry:
    """The chemistry of ``silica-patch`` at a strength of the interaction (eV)."""
    found = ca.parse_scene(ca.scene_data("silica-patch")[0]).chemistry
    assert found is not None
    return found.replace(interaction=ca.interaction("elastic-pairs", strength=strength, bias=0.1))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", default="", help="folder of the tables; default: the cache folder of the user")
    folder = parser.parse_args().folder
    method = ca.ageing_method("closure", **({"folder": folder} if folder else {}))
    run: dict[str, Any] = {"engine": ca.engine("rejection-free"), "temperature": 300.0, "hold_times": TIMES}
    solved = list(contacts())
    print("| contact | sites | I_b (eV) | " + " | ".join(f"{t:g} s" for t in TIMES) + " | kMC ± | ms |")
    print("|" + "---|" * (TIMES.size + 5))
    every, noises = [], []
    for strength in STRENGTHS:
        own = chemistry(strength)
        for name, contact in solved:
            first = ca.age(contact, own, replicas=20, seed=1, **run).bonds[:, 0].mean()
            replicas = max(20, math.ceil(BONDS / max(first, 1.0)))
            full = ca.age(contact, own, replicas=replicas, seed=2, **run)
            ca.age(contact, own, method=method, **run)
            begin = time.perf_counter()
            closed = ca.age(contact, own, method=method, **run)
            wall = time.perf_counter() - begin
            mean = full.bonds.mean(axis=0)
            noise = full.bonds.std(axis=0, ddof=1) / math.sqrt(replicas) / mean
            errors = closed.bonds[0] / mean - 1
            every.append(errors)
            noises.append(noise)
            cells = " | ".join(f"{100 * error:+.2f}" for error in errors)
            print(
                f"| {name} | {contact.sites.size} | {strength:g} | {cells} | {100 * noise.max():.2f} | "
                f"{1e3 * wall:.0f} |",
                flush=True,
            )
    found, noise = np.array(every), np.array(noises)
    rms = math.sqrt(float(np.mean(found**2)))
    own = math.sqrt(max(rms**2 - float(np.mean(noise**2)), 0.0))
    print(
        f"\nPer cent. Largest {100 * np.abs(found).max():.2f}, rms {100 * rms:.2f}, of which the noise of the kinetics "
        f"is {100 * math.sqrt(float(np.mean(noise**2))):.2f} and the closure {100 * own:.2f}."
    )


if __name__ == "__main__":
    main()
