"""Memory that `chemage check` predicts against the peak of `chemage run`, for scenes of all kinds.

    python tests/benchmarks/memory.py [NAME ...]

Each scene runs in a process of its own with the kernels compiled before and no tables kept, writes its result, and the
largest resident memory of that process is compared. The prediction should be at most 25 % too high and never too low.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

from chemage.foundation.machine import kernel_folder

KERNELS = str(kernel_folder())
PULL = {"kind": "pulled", "speed": "1 um/s", "distance": "1 nm", "bond_stiffness": "10 nN/nm",
        "transition_distance": "0.03 nm"}  # fmt: skip
ADHESIVE = {"kind": "adhesive-bem", "modulus": "35.3 GPa", "work_of_adhesion": "50 mJ/m^2", "range": "0.5 nm",
            "coarse": "note", "tolerance": 1e-3}  # fmt: skip
#: name -> installed scene and changes
SCENES = {
    "tip": ("silica-tip", {}),
    "rough 1000": ("silica-rough", {"surface.pixels": 1000, "surface.zeta": 100}),
    "rough 1600, gap, double": ("silica-rough", {"surface.pixels": 1600, "contact.gap": True,
                                                 "contact.precision": "double", "contact.tolerance": 1e-6}),
    "rough 2048, single": ("silica-rough", {"surface.pixels": 2048, "contact.precision": "single",
                                            "contact.tolerance": 1e-4}),
    "free boundaries 1000": ("silica-rough", {"surface.pixels": 1000, "surface.zeta": 100,
                                              "contact.boundary": "free"}),
    "large tip": ("silica-tip", {"surface.pixels": 1500}),
    "Persson": ("silica-rough", {"contact": {"kind": "persson", "modulus": "35.3 GPa", "load": "20 uN"},
                                 "ageing": {"kind": "closure"}, "observe": None}),
    "sample": ("silica-rough", {"surface.pixels": 1500, "ageing": {"kind": "sample", "share": 0.1},
                                "observe": None}),
    "closure": ("silica-rough", {"surface.pixels": 1500, "ageing": {"kind": "closure"}, "observe": None}),
    "many sites": ("silica-rough", {"surface.pixels": 1000, "surface.zeta": 100, "contact.load": "300 uN",
                                    "hold.replicas": 3}),
    "pulled tip": ("silica-afm-tip", {"rupture": PULL, "hold.replicas": 20}),
    "pulled tip, 5000 points": ("silica-afm-tip", {"rupture": {**PULL, "points": 5000}, "hold.replicas": 50}),
    "pulled rough": ("silica-rough", {"rupture": {**PULL, "spring": "1 uN/nm"}, "hold.replicas": 4}),
    "pulled patch, 40 frames": ("silica-patch", {"rupture": {**PULL, "frames": 40}}),
    "adhesive tip": ("silica-tip", {"contact": {**ADHESIVE, "load": "20 nN"}, "surface.pixels": 768,
                                    "surface.pixel_size": 0.1}),
    "adhesive rough": ("silica-patch", {"contact": {**ADHESIVE, "load": "1 uN"}, "surface.pixels": 512,
                                        "contact.gap": True}),
    "adhesive rough, 900": ("silica-patch", {"contact": {**ADHESIVE, "load": "3 uN", "law": "dugdale"},
                                             "surface.pixels": 900}),
    "adhesive, free": ("silica-tip", {"contact": {**ADHESIVE, "load": "20 nN"}, "surface.pixels": 500,
                                      "surface.pixel_size": 0.15}),
}  # fmt: skip
WARM = """
import json, sys
import chemage as ca
from chemage.scene.warm_up import warm_up
warm_up(ca.load_scene(*json.loads(sys.argv[1])))
"""
RUN = """
import json, resource, sys, tempfile, warnings
warnings.simplefilter("ignore")
import chemage as ca
from chemage.scene.plan import plan
name, changes = json.loads(sys.argv[1])
scene = ca.load_scene(name, changes)
foreseen = plan(scene).numbers.get("memory")
with tempfile.TemporaryDirectory() as folder:
    ca.write(folder + "/result.h5", ca.run(scene))
print(json.dumps([foreseen, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))
"""


def measured(scene: tuple[str, dict]) -> tuple[float, float]:
    """Predicted and largest memory, bytes."""
    with tempfile.TemporaryDirectory() as folder:  # no tables of earlier runs
        environment = {**os.environ, "NUMBA_CACHE_DIR": KERNELS, "CHEMAGE_CACHE": folder}
        for program in (WARM, RUN):
            words = [sys.executable, "-c", program, json.dumps(scene)]
            done = subprocess.run(words, check=False, capture_output=True, text=True, env=environment)
            if done.returncode:
                raise SystemExit(done.stderr)
    foreseen, peak = json.loads(done.stdout.splitlines()[-1])
    return foreseen, peak


def main(names: list[str]) -> int:
    outside = 0
    for name in names or SCENES:
        foreseen, peak = measured(SCENES[name])
        ratio = foreseen / peak
        outside += not 1 <= ratio <= 1.25
        print(f"{name:26} {foreseen / 1e6:7.0f} MB predicted, {peak / 1e6:7.0f} MB at most: {100 * (ratio - 1):+.0f} %")
    return outside


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1:])))
