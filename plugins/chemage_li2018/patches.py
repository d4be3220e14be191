"""How the number of contact patches N_p, which is below the paper's in the rows of its Table 1, depends on counting."""

from __future__ import annotations

import numpy as np

from chemage.plugin import label_patches
from chemage_li2018.pages import render
from chemage_li2018.published import TABLE_1
from chemage_li2018.sweeps import PointSet, mean

#: way to count -> least pressure over its mean, whether the contact is periodic, whether pixels touch at corners, and
#: least number of pixels of a patch
COUNTS = {
    "as computed": (0, True, True, 1),
    "4 neighbours": (0, True, False, 1),
    "cut at the edges": (0, False, True, 1),
    "both": (0, False, False, 1),
    "without single pixels": (0, True, True, 2),
    "p > 2 % of the mean": (0.02, True, True, 1),
    "p > 10 % of the mean": (0.1, True, True, 1),
}


def number(
    pressure: np.ndarray, share: float, periodic: bool, corners: bool, least: int
) -> int:
    """The number of patches, counted in a way of :data:`COUNTS`."""
    contact = pressure > share * pressure[pressure > 0].mean()
    labels, count = label_patches(contact, periodic, corners=corners)
    return int(
        np.count_nonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] >= least)
    )


def counted(points: PointSet) -> np.ndarray:
    """Count the patches of the rows of Table 1 in every way, (ways, rows, surfaces)."""
    counts = []
    for group in points.by_row().values():
        pressures = [point.computed.contact().pressure for point in group]
        counts.append(
            [
                [number(pressure, *way) for pressure in pressures]
                for way in COUNTS.values()
            ]
        )
    return np.array(counts).swapaxes(0, 1)


def page(counts: np.ndarray, seeds: tuple[int, ...], pixels: int) -> str:
    """Write the page on counts (ways, rows, surfaces) as Markdown."""
    paper = np.array([[float(row.patches)] for row in TABLE_1])
    table = []
    for row, of_row in zip(TABLE_1, counts.swapaxes(0, 1), strict=True):
        table.append([row.name, row.patches, *(mean(of_way) for of_way in of_row)])
    table.append(
        [
            "mean of ours / paper",
            "",
            *(f"{(of_way / paper).mean():.3f}" for of_way in counts),
        ]
    )
    ratios = counts[0] / paper
    shift = ratios.mean(axis=1)
    errors = ratios.std(axis=1, ddof=1) * np.sqrt(1 + 1 / len(seeds))
    return render(
        "patches",
        seeds=seeds,
        pixels=pixels,
        counts=list(COUNTS),
        table=table,
        low=int(np.count_nonzero(shift < 1)),
        shift=shift,
        together=mean(ratios.mean(axis=0)),
        above=int(np.count_nonzero(ratios.mean(axis=0) >= 1)),
        independent=float(np.sum((1 - shift) / errors) / np.sqrt(len(shift))),
    )
