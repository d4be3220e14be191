"""Measures of a contact map, as plain functions of arrays: patches, perimeter, corrected area, shares above a pressure.

Lengths are in nm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from chemage.foundation.errors import InputError


@dataclass(frozen=True)
class Patches:
    """Connected contact patches: how many, the area of each in pixels (largest first)."""

    count: int
    sizes: np.ndarray


def label_patches(
    contact: np.ndarray, periodic: bool, *, corners: bool = True
) -> tuple[np.ndarray, int]:
    """Connected patches of a bool (nx, ny) map: labels 1…count (0 outside contact), across edges where periodic.

    Pixels that share an edge or a corner are connected (8 neighbours); without ``corners``, an edge (4 neighbours).
    """
    if contact.ndim != 2:
        raise InputError.of(
            "contact", contact.shape, "must have two dimensions (nx, ny)"
        )
    from scipy import ndimage

    labels = np.zeros(contact.shape, dtype=np.int32)
    structure = ndimage.generate_binary_structure(2, 2 if corners else 1)
    count = int(ndimage.label(contact, structure=structure, output=labels))  # pyright: ignore[reportArgumentType]
    if not periodic or count == 0:
        return labels, count
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = []
    for first, second in ((labels[0], labels[-1]), (labels[:, 0], labels[:, -1])):
        for shift in (-1, 0, 1) if corners else (0,):
            other = np.roll(second, shift)
            both = (first > 0) & (other > 0)
            pairs.append(np.stack([first[both], other[both]]))
    joined = np.concatenate(pairs, axis=1) - 1
    graph = coo_array(
        (np.ones(joined.shape[1], dtype=np.int8), (joined[0], joined[1])),
        shape=(count, count),
    )
    merged, component = connected_components(graph, directed=False)
    relabel = np.concatenate([[0], component + 1]).astype(labels.dtype)
    return relabel[labels], int(merged)


def patches(contact: np.ndarray, periodic: bool) -> Patches:
    """Connected (8 neighbours) patches of a bool (nx, ny) contact map."""
    labels, count = label_patches(contact, periodic)
    sizes = np.bincount(labels[contact], minlength=count + 1)[1:]
    return Patches(count, np.sort(sizes)[::-1].astype(np.int64))


def perimeter(
    contact: np.ndarray, pixel_size: float, periodic: bool, border: bool = True
) -> float:
    """Total length (nm) of pixel edges between contact and non-contact; beyond a free boundary there is no contact, but
    without ``border`` edges on it do not count."""
    edges = 0
    for axis in (0, 1):
        edges += int(np.count_nonzero(np.diff(contact, axis=axis)))
        first, last = np.take(contact, 0, axis), np.take(contact, -1, axis)
        edges += int(
            np.count_nonzero(first ^ last)
            if periodic
            else border * (np.count_nonzero(first) + np.count_nonzero(last))
        )
    return edges * pixel_size


def corrected_area(area: float, contour: float, pixel_size: float) -> float:
    """Contact area (nm²) less the pixels' excess at the rim, A − (π − 1 + ln 2)/24 · C · a.

    Yastrebov, Anciaux & Molinari, J. Mech. Phys. Solids 107, 469 (2017), eq. 10. ``contour`` is :func:`perimeter`.
    """
    return area - (math.pi - 1 + math.log(2)) / 24 * contour * pixel_size


class Above(NamedTuple):
    """Shares of the contact that lie above a pressure."""

    area: float
    """of the contact area"""
    load: float
    """of the load; with adhesion, of the force that presses"""


def above(pressure: np.ndarray, limit: float, contact: np.ndarray) -> Above:
    """Which shares of the area of ``contact`` (bool) and of the load lie where the pressure (GPa) is above ``limit``,
    which is above zero; nan without contact."""
    beyond = pressure[pressure > limit]
    pixels = int(np.count_nonzero(contact))
    total = float(np.maximum(pressure, 0).sum(dtype=np.float64))
    if not pixels or not total > 0:
        return Above(math.nan, math.nan)
    return Above(beyond.size / pixels, float(beyond.sum(dtype=np.float64)) / total)
