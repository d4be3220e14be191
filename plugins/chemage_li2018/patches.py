"""How the number of contact patches N_p, which is below the paper's in the rows of its Table 1, depends on counting."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from chemage.plugin import label_patches
from chemage_li2018.pages import render
from chemage_li2018.published import TABLE_1
from chemage_li2018.sweeps import PointSet, mean


def _large(contact: np.ndarray, least: int) -> int:
    labels, count = label_patches(contact, True)
    return int(np.count_nonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] >= least))


def _above(pressure: np.ndarray, share: float) -> int:
    return label_patches(pressure > share * pressure[pressure > 0].mean(), True)[1]


COUNTS: dict[str, Callable[[np.ndarray], int]] = {
    "as computed": lambda p: label_patches(p > 0, True)[1],
    "4 neighbours": lambda p: label_patches(p > 0, True, corners=False)[1],
    "cut at the edges": lambda p: label_patches(p > 0, False)[1],
    "both": lambda p: label_patches(p > 0, False, corners=False)[1],
    "without single pixels": lambda p: _large(p > 0, 2),
    "p > 2 % of the mean": lambda p: _above(p, 0.02),
    "p > 10 % of the mean": lambda p: _above(p, 0.1),
}


def counted(points: PointSet) -> np.ndarray:
    """Count the patches of the rows of Table 1 in every way, (ways, rows, surfaces)."""
    counts = []
    for group in points.by_row().values():
        pressures = [point.computed.contact().pressure for point in group]
        counts.append([[count(pressure) for pressure in pressures] for count in COUNTS.values()])
    return np.array(counts).swapaxes(0, 1)


def page(counts: np.ndarray, seeds: tuple[int, ...], pixels: int) -> str:
    """Write the page on counts (ways, rows, surfaces) as Markdown."""
    paper = np.array([[float(row.patches)] for row in TABLE_1])
    table = []
    for row, of_row in zip(TABLE_1, counts.swapaxes(0, 1), strict=True):
        table.append([row.name, row.patches, *(mean(of_way) for of_way in of_row)])
    table.append(["mean of ours / paper", "", *(f"{(of_way / paper).mean():.3f}" for of_way in counts)])
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
