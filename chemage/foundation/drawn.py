"""What a figure shows, as numbers: read from what was drawn, so that table and picture cannot differ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.text import csv_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: a map with more cells is left to the result file
MOST_CELLS = 50_000
#: of a curve are given x and y, or low and high of a band or an error bar; of a map x, y and value
COLUMNS = (
    "panel",
    "x quantity",
    "y quantity",
    "curve",
    "x",
    "y",
    "low",
    "high",
    "value",
)
_NOTHING = np.zeros(0)


def drawn_data(figure: Figure) -> str:
    """All curves, error bars, bands, bars and maps of a figure as CSV, one point a row."""
    rows = []
    plots = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    for number, axes in enumerate(plots, 1):
        for label, parts in _drawn(axes):
            name = "" if label.startswith("_") else label.strip().replace(r"\$", "$")
            length = max(part.size for part in parts)
            columns = [
                part if part.size == length else [None] * length for part in parts
            ]
            for row in zip(*columns, strict=True):
                cells = ("" if cell is None else repr(float(cell)) for cell in row)
                rows.append(
                    (
                        number,
                        _words(axes.get_xlabel()),
                        _words(axes.get_ylabel()),
                        name,
                        *cells,
                    )
                )
    return csv_text(COLUMNS, rows)


def _words(label: str) -> str:
    return " ".join(label.split())


def _drawn(axes: Axes) -> Iterator[tuple[str, tuple[np.ndarray, ...]]]:
    """(label, (x, y, low, high, value)) of what is drawn with the scales of the axes."""
    from matplotlib.container import BarContainer, ErrorbarContainer
    from matplotlib.patches import StepPatch

    taken: set[Any] = set()
    for container in axes.containers:
        if isinstance(container, ErrorbarContainer):
            line, caps, bars = container.lines
            taken |= {line, *caps, *bars}
            x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data())  # pyright: ignore[reportOptionalMemberAccess]
            ends = (
                np.array([part[:, 1] for part in bars[0].get_segments()])
                if bars
                else np.zeros((0, 2))
            )
            low, high = ends.T if len(ends) == x.size else (_NOTHING, _NOTHING)
            yield str(container.get_label()), (x, y, low, high, _NOTHING)
        elif isinstance(container, BarContainer):
            yield str(container.get_label()), _bars(container)
    for line in axes.lines:
        x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data())
        if line not in taken and x.size and line.get_transform() == axes.transData:
            yield str(line.get_label()), (x, y, _NOTHING, _NOTHING, _NOTHING)
    for patch in axes.patches:
        if isinstance(patch, StepPatch):
            values, edges, _ = patch.get_data()
            yield (
                str(patch.get_label()),
                (0.5 * (edges[1:] + edges[:-1]), values, _NOTHING, _NOTHING, _NOTHING),
            )
    for collection in axes.collections:
        if (
            collection not in taken
            and (found := _of_collection(collection)) is not None
        ):
            yield str(collection.get_label()), found
    for image in axes.images:
        values, (x0, x1, y0, y1) = image.get_array(), image.get_extent()
        if values is not None:
            edges = (
                np.linspace(x0, x1, values.shape[1] + 1),
                np.linspace(y0, y1, values.shape[0] + 1),
            )
            yield str(image.get_label()), _map(*edges, values)


def _bars(container: Any) -> tuple[np.ndarray, ...]:
    """Middle and length of bars."""
    upright = container.orientation != "horizontal"
    boxes = [bar.get_bbox() for bar in container.patches]
    middles = np.array(
        [
            0.5 * (box.x0 + box.x1) if upright else 0.5 * (box.y0 + box.y1)
            for box in boxes
        ]
    )
    lengths = np.array([box.height if upright else box.width for box in boxes])
    return (
        *((middles, lengths) if upright else (lengths, middles)),
        _NOTHING,
        _NOTHING,
        _NOTHING,
    )


def _of_collection(collection: Any) -> tuple[np.ndarray, ...] | None:
    """The lower and upper edge of bands, the ends of upright lines, and the cells of a map."""
    from matplotlib.collections import LineCollection, PolyCollection, QuadMesh

    if isinstance(collection, QuadMesh):
        corners = np.asarray(collection.get_coordinates())
        return _map(corners[0, :, 0], corners[:, 0, 1], collection.get_array())
    paths = [
        np.asarray(path.vertices)
        for path in collection.get_paths()
        if len(path.vertices)
    ]
    if isinstance(collection, LineCollection):
        upright = [
            part for part in paths if len(part) == 2 and part[0, 0] == part[1, 0]
        ]
        if not upright or len(upright) < len(paths):
            return None  # the outlines of patches
        x, low, high = np.array(
            [(part[0, 0], *sorted(part[:, 1])) for part in upright]
        ).T
        return x, _NOTHING, low, high, _NOTHING
    if not isinstance(collection, PolyCollection):
        return None
    found = []
    for part in paths:  # to the right along one edge, and back along the other
        count = (len(part) - 3) // 2
        forth, back = part[1 : count + 1], part[count + 2 : 2 * count + 2][::-1]
        if not count or not np.array_equal(forth[:, 0], back[:, 0]):
            return None
        found.append(
            np.column_stack([forth[:, 0], *np.sort([forth[:, 1], back[:, 1]], axis=0)])
        )
    if not found:
        return None
    x, low, high = np.concatenate(found).T
    return x, _NOTHING, low, high, _NOTHING


def _map(x: np.ndarray, y: np.ndarray, values: Any) -> tuple[np.ndarray, ...]:
    """The middles of the cells between edges ``x`` and ``y``, row by row, and their ``values``."""
    columns, rows = 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])
    shown = ~np.ma.getmaskarray(values).ravel()
    if shown.sum() > MOST_CELLS:
        shown[:] = False
    parts = (
        np.tile(columns, rows.size),
        np.repeat(rows, columns.size),
        np.ma.getdata(values).ravel(),
    )
    x, y, value = (part[shown] for part in parts)
    return x, y, _NOTHING, _NOTHING, value
