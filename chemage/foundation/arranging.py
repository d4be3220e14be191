"""A drawn figure is made to fit its size: long words are broken, legends without room go below their plot, tick labels
that touch are thinned, and no text is smaller than a page allows. Plots keep their size: the figure becomes higher."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.figures import PALETTE, decades_only, legend_entries
from chemage.foundation.looks import SMALLEST_FONT, colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

#: a legend inside a plot has at most this part of its area
_MOST_LEGEND = 0.25
#: pt between a plot's labels and the legend below them
_GAP = 4.0
#: a longer axis has no ticks between decades
_DECADES = 1e4
#: pixels of a figure at 100 dpi between tick labels, at least
_APART = 3.0


def arrange(figure: Figure) -> None:
    """Make everything in a drawn figure fit; the height of the figure may grow."""
    _recolour(figure)
    for axes in figure.axes:
        decades_only(*(axis for axis in (axes.xaxis, axes.yaxis) if _is_long(axis)))
    for text in _texts(figure):
        text.set_fontsize(max(text.get_fontsize(), SMALLEST_FONT))
    for axes in figure.axes:
        # what is inside plots does not make them smaller
        for inside in (
            *axes.texts,
            *((legend,) if (legend := axes.get_legend()) is not None else ()),
        ):
            inside.set_in_layout(False)
    # the size that plots would have alone, which they keep
    beside = [*figure.legends, *filter(None, [_title_of(figure)])]
    for artist in beside:
        artist.set_in_layout(False)
    _lay_out(figure)
    before = _height_of_plots(figure)
    for artist in beside:
        artist.set_in_layout(True)
    changed = _break_texts(figure) | _move_legends(figure)
    if changed or beside:
        _lay_out(figure)
        # what was added above and below the plots is added to the figure
        lost = before - _height_of_plots(figure)
        if lost > 0:
            width, height = figure.get_size_inches()
            figure.set_size_inches(width, height + lost / figure.dpi)
            _lay_out(figure)
    _thin_ticks(figure)
    figure.set_layout_engine("none")  # it is laid out


def _lay_out(figure: Figure) -> None:
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def _height_of_plots(figure: Figure) -> float:
    """Pixels of the first column of plots."""
    first = [
        axes
        for axes in figure.axes
        if (place := axes.get_subplotspec()) is not None and place.is_first_col()
    ]
    return sum(axes.get_position().height for axes in first) * figure.bbox.height


# -- texts ------------------------------------------------------------------------------------------------------------


def _texts(figure: Figure) -> list[Text]:
    from matplotlib.text import Text

    return [text for text in figure.findobj(Text) if isinstance(text, Text)]


def _title_of(figure: Figure) -> Text | None:
    return figure._suptitle  # pyright: ignore[reportAttributeAccessIssue]


def _break_texts(figure: Figure) -> bool:
    """Break titles and labels of axes into lines that have room."""
    changed = False
    if (above := _title_of(figure)) is not None:
        changed |= broken(above, 0.98 * figure.bbox.width)
    for axes in figure.axes:
        plot = axes.get_window_extent()
        left, right = _column(axes)
        middle = 0.5 * (plot.x0 + plot.x1)
        beside = 2 * min(middle - left, right - middle)
        for text, room in (
            (axes.title, beside),
            (axes.xaxis.label, beside),
            (axes.yaxis.label, plot.height),
        ):
            changed |= broken(text, room)
        for text in axes.texts:
            broken(text, plot.x1 - text.get_window_extent().x0)
    return changed


def _column(axes: Axes) -> tuple[float, float]:
    """Left and right edge of what belongs to a plot, in pixels."""
    width, place = axes.figure.bbox.width, axes.get_subplotspec()
    if place is None:
        return 0.0, width
    columns = place.get_gridspec().ncols
    return (
        width * place.colspan.start / columns,
        width * place.colspan.stop / columns,
    )


def broken(text: Text, room: float) -> bool:
    """Break a text at blanks into lines of at most ``room`` pixels; whether it was changed."""
    words = text.get_text()
    vertical = text.get_rotation() in (90.0, 270.0)

    def size() -> float:
        box = text.get_window_extent()
        return box.height if vertical else box.width

    if not words.strip() or (whole := size()) <= room:
        return False
    # lines that were broken at another width
    lines = words.split("\n")
    characters = max(8, int(max(map(len, lines)) * room / whole) + 2)
    while characters >= 8:
        made = [part for line in lines for part in _wrapped(line, characters)]
        text.set_text("\n".join(made))
        if size() <= room:
            break
        characters -= 1
    return text.get_text() != words


def _wrapped(line: str, characters: int) -> list[str]:
    return textwrap.wrap(
        line, characters, break_long_words=False, break_on_hyphens=False
    ) or [line]


# -- legends ----------------------------------------------------------------------------------------------------------


def _move_legends(figure: Figure) -> bool:
    changed = False
    for axes in figure.axes:
        if (legend := axes.get_legend()) is not None:
            changed |= _move_legend(axes, legend)
    for legend in figure.legends:
        changed |= _narrowed(legend, 0.97 * figure.bbox.width)
    return changed


def _move_legend(axes: Axes, legend: Legend) -> bool:
    """Put a legend that covers much of its plot, or a line in it, below it."""
    from matplotlib.transforms import ScaledTranslation

    plot, box = axes.get_window_extent(), legend.get_window_extent()
    inside = box.width < 0.9 * plot.width and box.height < 0.6 * plot.height
    small = box.width * box.height < _MOST_LEGEND * plot.width * plot.height
    if inside and small and not any(_crosses(line, box) for line in axes.lines):
        return False
    figure = legend.figure
    beside, under = (axis.get_tightbbox() for axis in (axes.yaxis, axes.xaxis))
    room = plot.x1 - min(beside.x0 if beside else plot.x0, plot.x0)
    title = legend.get_title()
    if legend._ncols > 1 and box.width > room:  # pyright: ignore[reportAttributeAccessIssue]
        handles, labels = legend_entries(axes)
        kept = {
            "title": title.get_text() or None,
            "frameon": legend.get_frame_on(),
            "alignment": "left",
        }
        legend = axes.legend(handles, labels, **kept)
    _narrowed(legend, room)
    below = (
        plot.y0
        - min(under.y0 if under else plot.y0, plot.y0)
        + _GAP * figure.dpi / 72
    )
    shift = ScaledTranslation(0, -below / figure.dpi, figure.dpi_scale_trans)
    # as wide as the plot at most, or else under its label as well
    fits = legend.get_window_extent().width <= plot.width
    legend.set_loc("upper left" if fits else "upper right")
    legend.set_bbox_to_anchor(
        (0.0 if fits else 1.0, 0.0), transform=axes.transAxes + shift
    )
    legend.borderaxespad = 0.0
    legend.set_in_layout(True)
    return True


def _crosses(line: Line2D, box: Bbox) -> bool:
    """Whether a line, or a point of it, is seen inside a box."""
    path = line.get_path().transformed(line.get_transform())
    points = np.asarray(path.vertices)
    if line.get_linestyle() == "None" or len(points) < 2:
        return bool(box.count_contains(points))
    return bool(path.intersects_bbox(box, filled=False))


def _narrowed(legend: Legend, room: float) -> bool:
    """Break the texts of a legend until it is at most ``room`` pixels wide."""
    texts = [*legend.get_texts(), legend.get_title()]
    whole, changed = legend.get_window_extent().width, False
    handles = whole - max(text.get_window_extent().width for text in texts)
    for text in texts if whole > room else ():
        changed |= broken(text, room - handles)
    return changed


# -- ticks ------------------------------------------------------------------------------------------------------------


def _thin_ticks(figure: Figure) -> None:
    for plot in (
        *figure.axes,
        *(child for axes in figure.axes for child in axes.child_axes),
    ):
        for name, axis in (("x", plot.xaxis), ("y", plot.yaxis)):
            for _ in range(4):
                if not _touch(name, axis, _APART * figure.dpi / 100):
                    break
                _thinned(axis)


def _is_long(axis: Axis) -> bool:
    """Whether an axis is logarithmic over many decades, whose ticks between them nobody reads and take long to draw."""
    low, high = sorted(axis.get_view_interval())
    return axis.get_scale() == "log" and low > 0 and high / low > _DECADES


def _touch(name: str, axis: Axis, apart: float) -> bool:
    """Whether labels of neighbouring ticks come nearer than ``apart`` pixels."""
    shown = [
        label
        for label in (*axis.get_majorticklabels(), *axis.get_minorticklabels())
        if label.get_text()
    ]
    boxes = [label.get_window_extent() for label in shown]
    ends = sorted(
        (box.x0, box.x1) if name == "x" else (box.y0, box.y1) for box in boxes
    )
    rotated = any(label.get_rotation() % 90 for label in axis.get_majorticklabels())
    return not rotated and any(
        after[0] - before[1] < apart for before, after in pairwise(ends)
    )


def _thinned(axis: Axis) -> None:
    """Leave out every second label; ticks that matplotlib has chosen become fewer."""
    from matplotlib.ticker import (
        FuncFormatter,
        LogLocator,
        MaxNLocator,
        NullFormatter,
    )

    if any(label.get_text() for label in axis.get_minorticklabels()):
        few = isinstance(axis.get_minor_formatter(), FuncFormatter)
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(
            NullFormatter() if few else FuncFormatter(lambda value, _: f"{value:g}")
        )
        return
    locator = axis.get_major_locator()
    if isinstance(locator, MaxNLocator):
        axis.set_major_locator(
            MaxNLocator(
                max(2, len(axis.get_majorticklocs()) // 2), steps=[1, 2, 5, 10]
            )
        )
        return
    places = axis.get_majorticklocs()
    words = axis.get_major_formatter().format_ticks(list(places))
    axis.set_ticks(
        list(places),
        [text if not number % 2 else "" for number, text in enumerate(words)],
    )


# -- colours ----------------------------------------------------------------------------------------------------------

_COLOURED = (
    "color",
    "facecolor",
    "edgecolor",
    "markerfacecolor",
    "markeredgecolor",
)


def _recolour(figure: Figure) -> None:
    """Give curves the colours of the style where it has others than chemage."""
    own = colours()
    changes = {
        old.upper(): new
        for old, new in zip(PALETTE, own, strict=False)
        if old.upper() != new
    }
    if not changes:
        return
    for artist in figure.findobj():
        for name in _COLOURED:
            get: Callable[[], Any] | None = getattr(artist, f"get_{name}", None)
            put: Callable[[Any], Any] | None = getattr(artist, f"set_{name}", None)
            if get is not None and put is not None:
                _exchange(get(), put, changes)


def _exchange(
    value: Any, put: Callable[[Any], Any], changes: dict[str, str]
) -> None:
    from matplotlib.colors import is_color_like, to_hex, to_rgba

    if is_color_like(value):
        if (new := changes.get(to_hex(value).upper())) is not None:
            put(to_rgba(new, to_rgba(value)[3]))
        return
    if (
        isinstance(value, np.ndarray)
        and value.ndim == 2
        and 0 < len(value) <= len(PALETTE)
    ):
        made = [changes.get(to_hex(one).upper()) for one in value]
        if any(made):
            put(
                [
                    to_rgba(new, old[3]) if new else tuple(old)
                    for new, old in zip(made, value, strict=True)
                ]
            )
