"""How near are the estimates of ``chemage check`` to what a run costs?

    python tests/benchmarks/estimates.py [NAME ...]

Every scene is planned and run, one after the other, with kernels that are compiled before; NAME runs those scenes
alone. Printed are the CPU seconds of the process, peak memory, events per site, area fraction and sites, each as
estimated / measured. The last column is the ratio of the CPU seconds, or "range" where the plan states a range that
holds what was measured, and "OUTSIDE" where it is off by more than a factor 2.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import chemage as ca
from chemage.scene.plan import cost, plan

#: what is shorter is stated as less than this, s
SHORT = 0.5
BKL, AUTO, NEXT = {"kind": "bkl"}, {"kind": "auto"}, {"kind": "next-reaction"}
FLICKER = {"kind": "rejection-free", "superbasins": True}
#: name -> (installed scene, changes)
SCENES: dict[str, tuple[str, Mapping[str, Any]]] = {
    "tip": ("silica-tip", {}),
    "afm-tip": ("silica-afm-tip", {}),
    "linear-tip": ("silica-linear-tip", {}),
    "tips": ("silica-tips", {"sweep": None}),
    "patch": ("silica-patch", {}),
    "rough": ("silica-rough", {}),
    "patch 250 K": ("silica-patch", {"hold.temperature": 250.0}),
    "patch 350 K": ("silica-patch", {"hold.temperature": 350.0, "hold.replicas": 4}),
    "patch 400 K to 100 s": ("silica-patch", {"hold.temperature": 400.0, "hold.stop": 100.0, "hold.replicas": 4}),
    "patch to 1e7 s": ("silica-patch", {"hold.stop": 1e7}),
    "patch, 0.5 eV": ("silica-patch", {"interaction.strength": 0.5}),
    "patch 350 K, 0.5 eV": (
        "silica-patch",
        {"interaction.strength": 0.5, "hold.temperature": 350.0, "hold.replicas": 4},
    ),
    "patch, breaking 0.95 eV": ("silica-patch", {"breaking.mean": 0.95, "hold.stop": 1e4, "hold.replicas": 3}),
    "patch, breaking 0.2 eV wide": ("silica-patch", {"breaking.std": 0.2, "hold.stop": 1e3, "hold.replicas": 3}),
    "patch, bonds last": ("silica-patch", {"breaking": None}),
    "patch, no interaction": ("silica-patch", {"interaction": None, "engine": {"kind": "independent"}}),
    "patch, bkl": ("silica-patch", {"engine": BKL}),
    "patch, next-reaction": ("silica-patch", {"engine": NEXT}),
    "patch, auto": ("silica-patch", {"engine": AUTO}),
    "patch 400 K, superbasins": (
        "silica-patch",
        {"engine": FLICKER, "hold.temperature": 400.0, "hold.stop": 300.0, "hold.replicas": 2},
    ),
    "patch 400 K, next-reaction, superbasins": (
        "silica-patch",
        {"engine": {**NEXT, "superbasins": True}, "hold.temperature": 400.0, "hold.stop": 300.0, "hold.replicas": 2},
    ),
    "patch, breaking 0.8 eV, superbasins": (
        "silica-patch",
        {"breaking.mean": 0.8, "engine": FLICKER, "hold.stop": 1e4, "hold.replicas": 3},
    ),
    "patch, 100 replicas": ("silica-patch", {"hold.replicas": 100}),
    "patch at 10 uN": ("silica-patch", {"contact.load": "10 uN", "hold.replicas": 5}),
    "patch, activation volume 0": ("silica-patch", {"chemistry.activation_volume": 0.0, "hold.replicas": 100}),
    "rough at 200 uN": ("silica-rough", {"contact.load": "200 uN", "hold.replicas": 3}),
    "rough at 200 uN, auto": ("silica-rough", {"contact.load": "200 uN", "hold.replicas": 3, "engine": AUTO}),
    "rough, double, 1e-8": (
        "silica-rough",
        {"surface.pixels": 1024, "surface.zeta": 60, "contact.precision": "double", "contact.tolerance": 1e-8},
    ),
    "rough, sample": ("silica-rough", {"ageing": {"kind": "sample", "share": 0.05}, "observe": None}),
    "rough, sites of half a pixel": (
        "silica-patch",
        {"surface.pixels": 256, "surface.pixel_size": 0.9036, "chemistry.site_density": 4.9},
    ),
    "rough, sites of two pixels": (
        "silica-patch",
        {"surface.pixels": 1024, "surface.pixel_size": 0.2259, "chemistry.site_density": 4.9},
    ),
    "closure": ("silica-patch", {"ageing": {"kind": "closure"}, "interaction": None, "observe": None}),
    "closure with a table": ("silica-patch", {"ageing": {"kind": "closure"}, "observe": None}),
    "persson": (
        "silica-rough",
        {
            "contact": {"kind": "persson", "modulus": 35.3, "load": "20 uN"},
            "ageing": {"kind": "closure"},
            "interaction": None,
            "observe": None,
        },
    ),
    "tip, fft-bem": (
        "silica-tip",
        {"contact": {"kind": "fft-bem", "modulus": 35.3, "load": "50 nN"}, "surface.pixels": 256},
    ),
    "large tip, fft-bem": (
        "silica-tip",
        {
            "contact": {"kind": "fft-bem", "modulus": 35.3, "load": "50 uN"},
            "surface.pixels": 512,
            "surface.radius": "1 um",
            "hold.replicas": 20,
        },
    ),
    "contact alone": ("silica-patch", {"forming": None, "hold": None, "engine": None, "breaking": None,
                                       "interaction": None, "chemistry": None, "observe": None,
                                       "surface.pixels": 1024, "contact.load": "3.4 uN"}),
}  # fmt: skip


def warm_up() -> None:
    """Load every compiled kernel."""
    small = {"surface.pixels": 64, "surface.zeta": 8, "surface.eta": 1, "contact.load": 20.0, "hold.replicas": 1}
    for engine in ("rejection-free", "bkl", "next-reaction", "auto"):
        for more in ({}, {"superbasins": True}):
            ca.run(ca.load_scene("silica-patch", {**small, "engine": {"kind": engine, **more}}))
    ca.run(ca.load_scene("silica-patch", {**small, "engine": {"kind": "independent"}, "interaction": None}))
    for more in ({"pixel_size": 0.9036}, {"pixel_size": 0.2259}):
        ca.run(ca.load_scene("silica-patch", {**small, **{f"surface.{n}": v for n, v in more.items()}}))
    for more in ({"contact.precision": "double"}, {"breaking": None}):
        ca.run(ca.load_scene("silica-patch", {**small, **more}))
    for base, changes in (SCENES["tip"], SCENES["tip, fft-bem"]):
        ca.run(ca.load_scene(base, {**changes, "hold.replicas": 1, "surface.pixels": 64}))


def peak() -> float:
    """Largest resident memory since the last call, bytes; nan where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return float("nan")
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def measure(base: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Estimated and measured numbers of one scene."""
    scene = ca.load_scene(base, changes)
    begin = time.process_time()
    made, known = plan(scene), cost(scene)
    planning = time.process_time() - begin
    peak()
    begin, stages = time.process_time(), {}

    def report(stage: str, done: int, total: int) -> None:
        stages.setdefault((stage, total != 0), time.process_time())

    result = ca.run(scene, progress=report)
    used = time.process_time() - begin
    seconds = time.process_time() - stages[("ageing", False)] if ("ageing", False) in stages else 0.0
    ageing, contact = result.ageing, result.contact
    sites = float(ageing.sites.mean()) if ageing is not None else float("nan")
    events = float("nan") if ageing is None or ageing.events is None else float((ageing.events / ageing.sites).mean())
    return {
        "planning": planning,
        "range": made.seconds_range,
        "seconds": (made.numbers.get("cpu_seconds", float("nan")), used),
        "contact": (known.contact_cpu_seconds or float("nan"), used - seconds),
        "ageing": (known.kinetics_cpu_seconds or float("nan"), seconds),
        "memory": (made.numbers.get("memory", float("nan")), peak()),
        "events": (known.events or float("nan"), events),
        "area": (known.area_fraction or float("nan"), contact.area_fraction),
        "sites": (known.sites or float("nan"), sites),
        "iterations": getattr(contact, "iterations", 0),
    }


def verdict(found: Mapping[str, Any]) -> str:
    """The ratio of estimated and measured CPU seconds, and whether the plan was right."""
    expected, used = found["seconds"]
    if max(expected, used) < SHORT:
        return f"short, {expected / used:.2f}"
    ratio = expected / used
    if found["range"]:
        low, high = found["range"]
        return f"range {low:.2g} to {high:.2g}" if low <= used <= high else f"OUTSIDE {low:.2g} to {high:.2g}"
    return f"{ratio:.2f}" + ("" if 0.5 <= ratio <= 2 else "  OUTSIDE")


def main(names: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:  # an empty cache: the tables of closure are made
        os.environ["XDG_CACHE_HOME"] = folder
        warnings.simplefilter("ignore", ca.PlanWarning)
        warm_up()
        columns = ("contact", "ageing", "seconds", "memory", "events", "area", "sites")
        print(f"{'scene':40s}", *(f"{name:>17s}" for name in columns), "  iterations, planning, ratio")
        for name in names or SCENES:
            try:
                found = measure(*SCENES[name])
            except ca.ChemageError as error:
                print(f"{name:40s} {error}", flush=True)
                continue
            pairs = (
                f"{a / s:8.3g}/{b / s:8.3g}"
                for a, b, s in ((*found[c], 1e6 if c == "memory" else 1.0) for c in columns)
            )
            print(
                f"{name:40s}", *pairs, f"  {found['iterations']:4d} {found['planning']:.3f}", verdict(found), flush=True
            )


if __name__ == "__main__":
    main(sys.argv[1:])
