"""Does the answer of a sample lie as often within its interval as it says, and what does a sample save?

    python tests/benchmarks/sampling.py [coverage | share | margin]

``coverage``: 400 repetitions of samples of the reference contact; how often Student's 95 % interval over the ten
replicas of a sample, and the stated error of sampling, hold the mean of 400 replicas of every site. ``share``: 2 % of
the sites of the reference contact at 500 µN beside all of them. ``margin``: the bias of a margin of 0 to 6 sites.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

from chemage import Ageing, ContactSolution, age, load_scene, make_surface, solve_contact
from chemage.plugin import fromdict, statistics

REPETITIONS, REPLICAS, TRUTH = 400, 10, 400
DECADES = [1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5]


def contact_of(**changes: Any) -> tuple[Any, ContactSolution]:
    """A variant of ``silica-rough`` and its contact."""
    scene = load_scene("silica-rough", changes)
    return scene, solve_contact(scene.contact, make_surface(scene.surface, scene.surface_seed), scene.load)


def aged(scene: Any, contact: ContactSolution, replicas: int, seed: int, **sample: Any) -> tuple[Ageing, float]:
    """The ageing at every decade, and its CPU seconds; of a sample where its options are given."""
    method = fromdict("ageing", {"kind": "sample", **sample}) if sample else None
    begin = time.process_time()
    found = age(
        contact,
        scene.chemistry,
        engine=scene.engine,
        hold_times=DECADES,
        temperature=300.0,
        replicas=replicas,
        seed=seed,
        method=method,
    )
    return found, time.process_time() - begin


def small() -> dict[str, Any]:
    """The reference contact on a quarter of its area, at its nominal pressure."""
    return {"surface.pixels": 1250, "surface.zeta": 75, "contact.load": "5 uN"}


def coverage() -> None:
    scene, contact = contact_of()
    truth = aged(scene, contact, TRUTH, 1_000_000)[0]
    mean, error = truth.bonds.mean(axis=0), truth.bonds.std(axis=0, ddof=1) / TRUTH**0.5
    print(f"{contact.sites.size} sites; bonds of {TRUTH} replicas: {np.round(mean, 1)} ± {np.round(error, 2)}")
    for share in (0.02, 0.05, 0.2):
        held, off, stated = [], [], []
        for seed in range(REPETITIONS):
            found, _ = aged(scene, contact, REPLICAS, seed, share=share)
            off.append(found.bonds.mean(axis=0) - mean)
            stated.append(found.errors["sampling"] * found.bonds.mean(axis=0))
            held.append(np.abs(off[-1]) <= statistics.half_width(found.bonds))
        print(f"share {share:g}, {REPLICAS} replicas, at {DECADES} s; {found.notes[0]}")
        print("  interval over replicas holds the truth, %", np.round(100 * np.mean(held, axis=0), 1))
        within = np.where(np.isfinite(stated), np.abs(off) <= 1.96 * np.array(stated), np.nan)
        print("  stated error holds, % of those stated    ", np.round(100 * np.nanmean(within, axis=0), 1))
        print("  mean deviation, % of the bonds           ", np.round(100 * np.mean(off, axis=0) / mean, 2))
        scatter = np.std(off, axis=0)
        print("  its standard error                       ", np.round(100 * scatter / mean / REPETITIONS**0.5, 2))
        print("  scatter over the stated error of sampling", np.round(scatter / np.nanmean(stated, axis=0), 2))


def share() -> None:
    scene, contact = contact_of(**{"contact.load": "500 uN"})
    every, cost = aged(scene, contact, REPLICAS, 0)
    mean = every.bonds.mean(axis=0)
    print(f"{contact.sites.size} sites, every one: {cost:.1f} CPU s, bonds {np.round(mean)}")
    for part in (0.02, 0.05):
        found, less = aged(scene, contact, REPLICAS, 0, share=part)
        print(f"share {part:g}: {less:.1f} CPU s; {found.notes[0]}")
        print("  deviation, %       ", np.round(100 * (found.bonds.mean(axis=0) / mean - 1), 2))
        print("  error of sampling, %", np.round(100 * found.errors["sampling"], 2))


def margin() -> None:
    scene, contact = contact_of(**small())
    every = aged(scene, contact, 400, 1)[0].bonds.mean(axis=0)
    for width in (0, 1, 2, 3, 4, 6):
        found, cost = aged(scene, contact, 400, 0, share=0.5, margin=width)
        relative, error = 100 * (found.bonds.mean(axis=0) / every - 1), 100 * found.errors["sampling"]
        print(f"margin {width}: {cost:.1f} CPU s, {np.round(relative, 2)} %, ± {np.round(error, 2)}")


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["coverage", "share", "margin"]
    for name in chosen:
        print(f"# {name}", flush=True)
        {"coverage": coverage, "share": share, "margin": margin}[name]()
