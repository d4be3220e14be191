"""Pictures of results: as figures, and in the cells of notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.errors import InputError
from chemage.foundation.figures import panels
from chemage.foundation.result import FILE, Picture, result_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(picture: Picture) -> Figure:
    """Draw a picture as it is in a file."""
    count = len(picture.panels)
    columns = picture.columns or count
    drawn, axes = panels(*picture.size, columns, -(-count // columns), dpi=picture.dpi)
    for empty in axes[count:]:
        empty.remove()
    for panel, plot in zip(picture.panels, axes, strict=False):
        panel.draw(plot, FILE)
    if picture.finish is not None:
        picture.finish(drawn, axes[:count])
    if picture.title:
        drawn.suptitle(picture.title, fontsize=10, parse_math=False)  # a dollar sign in a title is not a formula
    return drawn


def draw(thing: Any, axes: Axes | None = None, **options: Any) -> Axes:
    """Draw the main plot of a result into ``axes``, or into a new figure of pyplot; return the axes."""
    shown = result_of(thing)
    if axes is None:
        (axes,) = _new_axes(1)
    shown.draw(axes, **options)
    return axes


def draw_parts(thing: Any, names: Sequence[str]) -> tuple[Axes, ...]:
    """Draw the parts of a result, or only those named, side by side in a figure of pyplot; return their axes.

    Raises
    ------
    InputError
        It has no such part.
    """
    shown = result_of(thing)
    parts = shown.parts()
    chosen = tuple(names) or tuple(parts)
    if missing := [name for name in chosen if name not in parts]:
        raise InputError(f"plot: {shown.name} has no {missing[0]!r}; it has {', '.join(parts)}")
    axes = _new_axes(len(chosen))
    for plot, name in zip(axes, chosen, strict=True):
        parts[name].draw(plot)
    return tuple(axes)


def _new_axes(columns: int) -> list[Axes]:
    """The axes of a new figure of pyplot, which a notebook shows when its cell ends."""
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(5.2 * columns, 4.2), layout="constrained")
    return list(np.ravel(figure.subplots(1, columns)))


def html(thing: Any) -> str:
    """What the cell of a notebook shows of a result."""
    return result_of(thing)._repr_html_()
