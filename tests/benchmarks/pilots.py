"""How often do the 80 % ranges of ``chemage check`` of a mean hold what it takes?

    python tests/benchmarks/pilots.py [SEEDS] [NAME ...]      # three seeds of each of twenty scenes: a quarter of an hour
    MOST=3 python tests/benchmarks/pilots.py ...              # pilots of three samples, as of dear scenes

Nothing was tuned on these scenes. Printed are the number of surfaces (or replicas) and the CPU seconds of each, as
foreseen with their ranges, and as used; at last how many of the ranges hold. A mean that is refused counts as one of
more surfaces than are allowed.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from typing import Any

import chemage as ca
from chemage.studies.ensembles import planning
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.planning import plan

Changes = dict[str, Any]
PATCH: Changes = {"surface.pixels": 128, "surface.zeta": 12, "surface.eta": 2, "contact.load": "300 nN",
                  "hold.replicas": 4, "observe": None}  # fmt: skip
HARD = {"contact.hardness": "4 GPa"}
STICKY = {"contact": {"kind": "adhesive-bem", "modulus": 35.3, "load": "200 nN", "work_of_adhesion": "50 mJ/m^2",
                      "range": "0.6 nm"}}  # fmt: skip
TIP: Changes = {"hold.replicas": 4, "observe": None}
PULLED = {"rupture": {"kind": "pulled", "speed": "1 um/s", "distance": "1 nm", "bond_stiffness": "10 nN/nm",
                      "transition_distance": "0.03 nm"},
          "hold.start": 0.1, "hold.stop": 100.0, "hold.per_decade": 1, "fit.start": 0.1, "fit.stop": 100.0}  # fmt: skip
LAW = {"transition_distance": "0.05 nm", "speed": "1 um/s", "stiffness": "10 nN/nm"}
ALONE: Changes = {"interaction": None, "engine": {"kind": "independent"}}
ROUGH_TIP = {"surface": {"kind": "tip", "body": {"kind": "sphere", "radius": "20 nm", "pixels": 96, "pixel_size": 0.4518},
                         "own_roughness": {"kind": "self-affine", "rms_slope": 0.2, "hurst": 0.8, "zeta": 8, "eta": 1,
                                           "pixels": 96, "pixel_size": 0.4518}},
             "contact": {"kind": "fft-bem", "modulus": 35.3, "load": "60 nN"}}  # fmt: skip
#: name -> installed scene, changes, accuracy
SCENES: dict[str, tuple[str, Changes, dict[str, float]]] = {
    "hard": ("silica-patch", PATCH | HARD, {"beta": 0.05}),
    "harder, rougher": ("silica-patch", PATCH | {"contact.hardness": "8 GPa", "surface.rms_slope": 0.3}, {"beta": 0.08}),
    "hard, 256 pixels": ("silica-patch", PATCH | HARD | {"surface.pixels": 256, "surface.zeta": 20}, {"beta": 0.05}),
    "adhesive": ("silica-patch", PATCH | STICKY, {"beta": 0.06}),
    "adhesive, 350 K": ("silica-patch", PATCH | STICKY | {"hold.temperature": 350.0}, {"beta": 0.1}),
    "adhesion of a tip": ("silica-tip", TIP | {"contact": {"kind": "jkr", "modulus": 35.3, "load": "20 nN",
                                                           "work_of_adhesion": "50 mJ/m^2"}}, {"beta": 0.05}),
    "tip": ("silica-tip", TIP, {"beta": 0.05}),
    "afm tip": ("silica-afm-tip", TIP, {"friction_coefficient_drop": 0.02}),
    "rough tip": ("silica-tip", TIP | ROUGH_TIP, {"beta": 0.1}),
    "pulled tip": ("silica-afm-tip", TIP | PULLED, {"beta": 0.1}),
    "slowly pulled tip": ("silica-afm-tip", TIP | PULLED | {"rupture.speed": "1 nm/s"}, {"friction_drop@10 s": 0.08}),
    "pulled patch": ("silica-patch", PATCH | PULLED | {"contact.load": "100 nN"}, {"beta": 0.15}),
    "250 K": ("silica-patch", PATCH | {"hold.temperature": 250.0}, {"beta": 0.08}),
    "400 K, bonds last": ("silica-patch", PATCH | {"hold.temperature": 400.0, "breaking": None}, {"beta": 0.08}),
    "350 K, near balance": ("silica-patch", PATCH | {"hold.temperature": 350.0, "breaking.mean": 0.95, "hold.stop": 1e3,
                                                     "fit.stop": 1e3}, {"beta": 0.15}),
    "strong interaction": ("silica-patch", PATCH | {"interaction.strength": 0.5}, {"beta": 0.05}),
    "no interaction": ("silica-patch", PATCH | ALONE, {"friction_coefficient_drop@1e3 s": 0.03}),
    "bell": ("silica-patch", PATCH | ALONE | {"rupture": {"kind": "bell", **LAW}}, {"beta": 0.05}),
    "dudko": ("silica-patch", PATCH | {"rupture": {"kind": "dudko-hummer-szabo", **LAW}}, {"beta": 0.1}),
    "area": ("silica-patch", PATCH | {"surface.hurst": 0.5, "surface.pixels": 192}, {"area_fraction": 0.02}),
}  # fmt: skip


def measure(name: str, seed: int) -> tuple[str, bool, bool]:
    """What is foreseen of one scene and what it takes, in words; whether the ranges hold."""
    base, changes, accuracy = SCENES[name]
    seeds: Changes = {"hold.seed": seed} | ({"surface.seed": seed} if base == "silica-patch" else {})
    scene = with_request(ca.load_scene(base, changes | seeds).completed(), accuracy=accuracy)
    begin = time.process_time()
    foreseen = plan(scene)
    middle, refused = time.process_time(), ""
    try:
        count, more = (made := ca.ensemble(scene)).surfaces, [level["samples"] for level in made.levels[1:]]
    except ca.InputError as error:
        count, more, refused = foreseen.request.most, [], str(error)
    used = time.process_time() - middle
    seen = foreseen.foreseen
    if seen is None:
        return f"{name:20s} not foreseen: {foreseen.reason}", False, False
    (low, high), (least, most) = seen.range, seen.cpu_range
    held, paid = low <= count <= high, least <= used <= most or bool(refused)
    text = f"{name:20s} {seen.samples[0]:6d} ({low} to {high}) / {count}{more or ''}{'' if held else ' OUTSIDE'}"
    text += f"   CPU {seen.cpu_seconds:.3g} ({least:.2g} to {most:.2g}) / {used:.2g}{'' if paid else ' OUTSIDE'}"
    text += f"   check {middle - begin:.2g} s, {foreseen.reason}"
    return "\n    ".join([text, *seen.doubts, *filter(None, [refused])]), held, paid


def main(seeds: int, names: list[str]) -> None:
    """Print the scenes, and how many ranges hold."""
    warnings.simplefilter("ignore")
    planning.MOST = int(os.environ.get("MOST", planning.MOST))
    held = []
    for name in names:
        # kernels are compiled before
        measure(name, 900)
        for seed in range(1000, 1000 + seeds):
            text, *holds = measure(name, seed)
            held.append(holds)
            print(text, flush=True)
    counts, times = (sum(column) for column in zip(*held, strict=True))
    print(f"of {len(held)} ranges hold: {counts} of the number of surfaces, {times} of the CPU time")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3, sys.argv[2:] or [*SCENES])
