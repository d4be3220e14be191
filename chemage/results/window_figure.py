"""A part of the maps of a stored result, at the resolution of its pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.units import convert
from chemage.results.figures import draw_map, panels, pooled
from chemage.results.files import StoredMap, open_maps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EXPECTED = 'give its edges "X0 X1 Y0 Y1" in nm, or with units, such as "0 1um 200 800"'
_STYLES = {
    "surface/heights": ("height", np.mean, "cividis"),
    "contact/pressure": ("pressure", np.max, "inferno_r"),
    "contact/gap": ("gap", np.mean, "viridis"),
}


def window_figure(path: Path, window: str | Sequence[float | str]) -> Figure:
    """Draw the part ``window`` of every map in the result file ``path``; only this part is read.

    ``window`` holds the edges x0, x1, y0, y1 (nm, or strings with a unit), as text or as a sequence.

    Raises
    ------
    InputError
        ``window`` is not four lengths, is empty, or lies outside the maps.
    StoreError
        The file is missing or damaged, or has no map.
    """
    edges = window.split() if isinstance(window, str) else list(window)
    if len(edges) != 4:
        raise InputError.of("window", window, "is not four lengths", _EXPECTED)
    lengths = [_length(edge) for edge in edges]
    with open_maps(path) as maps:
        figure, axes = panels(5.0 * len(maps) + 0.5, 4.4, len(maps))
        for one, (name, stored) in zip(axes, maps.items(), strict=True):
            label, pool, colours = _STYLES[name]
            part, extent = _part(stored, lengths, window)
            values = pooled(part, pool)
            shown = np.ma.masked_equal(values, 0.0) if name == "contact/pressure" else values
            draw_map(one, shown, extent, f"{label} ({stored.unit})", cmap=colours)
            one.set_title(f"{part.shape[0]} x {part.shape[1]} pixels of {stored.pixel_size:g} nm")
    return figure


def _length(edge: float | str) -> float:
    try:
        return float(edge)
    except ValueError:
        return convert(edge, "nm")


def _part(
    stored: StoredMap, edges: Sequence[float], window: object
) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """The pixels that the window touches, and what they cover: x0, x1, y0, y1, nm."""
    size, parts = stored.pixel_size, []
    for low, high, pixels in zip(edges[::2], edges[1::2], stored.shape, strict=True):
        if not (0 <= low < high <= pixels * size * (1 + 1e-9)):
            sides = " x ".join(f"{side * size:g}" for side in stored.shape)
            raise InputError.of("window", window, f"must lie within the map of {sides} nm", _EXPECTED)
        parts.append(slice(math.floor(low / size), min(math.ceil(high / size), pixels)))
    x, y = parts
    return stored[x, y], (x.start * size, x.stop * size, y.start * size, y.stop * size)
