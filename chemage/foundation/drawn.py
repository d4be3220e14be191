"""What a figure shows, as numbers: read from what was drawn, so that table and picture cannot differ."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat
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


def drawn_data(figure: Figure) -> str:
    """All curves, error bars, bands, bars and maps of a figure as CSV, one point a row."""
    rows = []
    plots = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    for number, axes in enumerate(plots, 1):
        for label, parts in _drawn(axes):
            name = (
                "" if label.startswith("_") else label.strip().replace(r"\$", "$")
            )
            labels = (
                " ".join(text().split())
                for text in (axes.get_xlabel, axes.get_ylabel)
            )
            head = (number, *labels, name)
            cells = [
                map(repr, map(float, parts[column]))
                if column in parts
                else repeat("")
                for column in COLUMNS[len(head) :]
            ]
            rows += [(*head, *row) for row in zip(*cells, strict=False)]
    return csv_text(COLUMNS, rows)


#: name of a column -> its values
Drawn = dict[str, np.ndarray]


def _drawn(axes: Axes) -> Iterator[tuple[str, Drawn]]:
    """The label and the numbers of what is drawn with the scales of the axes."""
    from matplotlib.container import BarContainer, ErrorbarContainer
    from matplotlib.patches import StepPatch

    taken: set[Any] = set()
    for container in axes.containers:
        if isinstance(container, ErrorbarContainer):
            line, caps, bars = container.lines
            taken |= {line, *caps, *bars}
            found = _of_line(line)
            ends = [part[:, 1] for part in bars[0].get_segments()] if bars else []
            if len(ends) == found["x"].size:
                found["low"], found["high"] = np.transpose(ends)
            yield str(container.get_label()), found
        elif isinstance(container, BarContainer):
            yield str(container.get_label()), _bars(container)
    for line in axes.lines:
        found = _of_line(line)
        shown = found["x"].size and line.get_transform() == axes.transData
        if shown and line not in taken:
            yield str(line.get_label()), found
    for patch in axes.patches:
        if isinstance(patch, StepPatch):
            values, edges, _ = patch.get_data()
            middles = 0.5 * (edges[1:] + edges[:-1])
            yield str(patch.get_label()), {"x": middles, "y": values}
    for collection in axes.collections:
        if (
            collection not in taken
            and (found := _of_collection(collection)) is not None
        ):
            yield str(collection.get_label()), found
    for image in axes.images:
        values, (x0, x1, y0, y1) = image.get_array(), image.get_extent()
        if values is not None:
            x = np.linspace(x0, x1, values.shape[1] + 1)
            y = np.linspace(y0, y1, values.shape[0] + 1)
            yield str(image.get_label()), _map(x, y, values)


def _of_line(line: Any) -> Drawn:
    x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data())
    return {"x": x, "y": y}


def _bars(container: Any) -> Drawn:
    """Middle and length of bars."""
    upright = container.orientation != "horizontal"
    boxes = [bar.get_bbox() for bar in container.patches]
    if upright:
        x = [0.5 * (box.x0 + box.x1) for box in boxes]
        return {"x": np.array(x), "y": np.array([box.height for box in boxes])}
    y = [0.5 * (box.y0 + box.y1) for box in boxes]
    return {"x": np.array([box.width for box in boxes]), "y": np.array(y)}


def _of_collection(collection: Any) -> Drawn | None:
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
        ends = np.transpose([(part[0, 0], *sorted(part[:, 1])) for part in upright])
        return dict(zip(("x", "low", "high"), ends, strict=True))
    if not isinstance(collection, PolyCollection):
        return None
    found = []
    for part in paths:  # to the right along one edge, and back along the other
        count = (len(part) - 3) // 2
        forth, back = part[1 : count + 1], part[count + 2 : 2 * count + 2][::-1]
        if not count or not np.array_equal(forth[:, 0], back[:, 0]):
            return None
        low, high = np.sort([forth[:, 1], back[:, 1]], axis=0)
        found.append([forth[:, 0], low, high])
    if not found:
        return None
    band = np.concatenate(found, axis=1)
    return dict(zip(("x", "low", "high"), band, strict=True))


def _map(x: np.ndarray, y: np.ndarray, values: Any) -> Drawn:
    """The middles of the cells between edges ``x`` and ``y``, row by row, and their ``values``."""
    columns, rows = 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])
    shown = ~np.ma.getmaskarray(values).ravel()
    if shown.sum() > MOST_CELLS:
        shown[:] = False
    return {
        "x": np.tile(columns, rows.size)[shown],
        "y": np.repeat(rows, columns.size)[shown],
        "value": np.ma.getdata(values).ravel()[shown],
    }
