"""Number of contact patches counted in several ways, beside Table 1 of the paper; the table is docs/data/patches.csv.

python tests/benchmarks/patch_counts.py [SURFACES] > docs/data/patches.csv
"""

from __future__ import annotations

import sys

import numpy as np

import chemage as ca
from chemage.plugin import label_patches
from chemage_li2018.published import TABLE_1
from chemage_li2018.sweeps import SURFACE_SEEDS, Mean, mean

#: way to count -> least pressure over its mean, whether the contact is periodic, whether pixels touch at corners, and
#: least number of pixels of a patch
COUNTS = {
    "as_computed": (0, True, True, 1),
    "four_neighbours": (0, True, False, 1),
    "cut_at_the_edges": (0, False, True, 1),
    "both": (0, False, False, 1),
    "without_single_pixels": (0, True, True, 2),
    "above_2_percent_of_the_mean": (0.02, True, True, 1),
    "above_10_percent_of_the_mean": (0.1, True, True, 1),
}


def number(pressure: np.ndarray, share: float, periodic: bool, corners: bool, least: int) -> int:
    """The number of patches, counted in a way of :data:`COUNTS`."""
    contact = pressure > share * pressure[pressure > 0].mean()
    labels, count = label_patches(contact, periodic, corners=corners)
    return int(np.count_nonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] >= least))


def counted(options: dict[str, float], seed: int) -> list[int]:
    """Count the patches of a surface in every way."""
    scene = ca.load_scene("silica-rough", {**options, "surface.rms_slope": 0.05})
    pressure = ca.solve_contact(scene.contact, scene.surface.make(seed), scene.load).pressure
    return [number(pressure, *way) for way in COUNTS.values()]


def main(surfaces: int) -> None:
    seeds = SURFACE_SEEDS[:surfaces]
    print("# Number of contact patches counted in several ways, beside Table 1 of the paper")
    print(f"# made by: python tests/benchmarks/patch_counts.py {surfaces}")
    between = "mean ± standard deviation between surfaces"
    print(f"# 2500² pixels, rms slope 0.05, 20 uN, surface seeds {seeds[0]} to {seeds[-1]}; {between}")
    print(",".join(["row", "paper", *COUNTS]))
    ratios = []
    for row in TABLE_1:
        counts = np.array([counted(row.options, seed) for seed in seeds])
        ratios.append(counts.mean(axis=0) / float(row.patches))
        means: list[Mean] = [mean(of_way) for of_way in counts.T]
        print(",".join([row.name, row.patches, *map(str, means)]), flush=True)
    print("mean of ours / paper,," + ",".join(f"{ratio:.3f}" for ratio in np.mean(ratios, axis=0)))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8)
