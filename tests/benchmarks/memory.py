"""Memory that `chemage check` predicts against the peak of `chemage run`, for scenes of all kinds.

    python tests/benchmarks/memory.py [NAME ...]

Each scene runs as a command with the kernels compiled before and no tables kept, writes its result, draws its figures,
and its largest resident memory is compared. The prediction should be within 15 %.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import tomli_w

from chemage.foundation.machine import kernel_folder
from chemage.plugin import override, scene_data

KERNELS = str(kernel_folder())
PULL = {"kind": "pulled", "speed": "1 um/s", "distance": "1 nm", "bond_stiffness": "10 nN/nm",
        "transition_distance": "0.03 nm"}  # fmt: skip
ADHESIVE = {"kind": "adhesive-bem", "modulus": "35.3 GPa", "work_of_adhesion": "50 mJ/m^2", "range": "0.5 nm",
            "coarse": "note", "tolerance": 1e-3}  # fmt: skip
SPHERE = {"modulus": "35.3 GPa", "load": "50 nN", "work_of_adhesion": "50 mJ/m^2"}
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
    "larger tip": ("silica-tip", {"surface.pixels": 4096}),
    "larger tip, hardness, gap": ("silica-tip", {"surface.pixels": 4096, "contact.hardness": "3 GPa",
                                                 "contact.gap": True}),
    "larger tip, JKR": ("silica-tip", {"surface.pixels": 4096, "contact": SPHERE | {"kind": "jkr"}}),
    "larger tip, DMT": ("silica-tip", {"surface.pixels": 2048, "contact": SPHERE | {"kind": "dmt"}}),
    "larger tip, Maugis": ("silica-tip", {"surface.pixels": 4096,
                                          "contact": SPHERE | {"kind": "maugis", "range": "0.3 nm"}}),
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


def measured(scene: tuple[str, dict]) -> tuple[float, float]:
    """Predicted and largest memory, bytes."""
    name, changes = scene
    with tempfile.TemporaryDirectory() as folder:  # no tables of earlier runs
        environment = {**os.environ, "NUMBA_CACHE_DIR": KERNELS, "CHEMAGE_CACHE": folder}
        file = Path(folder) / "scene.toml"
        file.write_text(tomli_w.dumps(override(scene_data(name)[0], changes)), encoding="utf-8")

        def chemage(*words: object) -> tuple[str, int]:
            """What the command prints, and its largest resident memory, kB."""
            line = [sys.executable, "-m", "chemage", *map(str, words)]
            with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=environment, cwd=folder) as process:
                told = process.stdout.read()
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise SystemExit(f"chemage {' '.join(line[3:])} ended with {process.returncode}")
            return told, used.ru_maxrss

        chemage("warmup", file)
        foreseen = json.loads(chemage("check", file, "--json")[0])["memory"]
        return foreseen, 1024 * chemage("run", file)[1]


def main(names: list[str]) -> int:
    outside = 0
    for name in names or SCENES:
        foreseen, peak = measured(SCENES[name])
        ratio = foreseen / peak
        outside += not 0.85 <= ratio <= 1.15
        print(f"{name:26} {foreseen / 1e6:7.0f} MB predicted, {peak / 1e6:7.0f} MB at most: {100 * (ratio - 1):+.0f} %")
    return outside


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1:])))
