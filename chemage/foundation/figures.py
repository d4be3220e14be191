"""Building blocks of figures: empty panels, the palette, maps, saving. pyplot and its global state are not used."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.drawn import drawn_data
from chemage.foundation.errors import printable
from chemage.foundation.files import fresh_file, make_folder, preflight, write_file
from chemage.foundation.looks import Look as Look
from chemage.foundation.looks import current, drawn_as

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

#: colour-blind safe (Okabe & Ito 2008)
BLUE, ORANGE, GREEN, PURPLE, GREY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#777777",
)
BLACK = "#000000"
#: colours of curves, in order
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, GREY, "#E69F00", "#56B4E9", "#8C564B")
#: inches of print that a plot needs
_PLOT = 2.3
#: a figure that is not for print has this part of its nominal inches, and as many pixels
_SCREEN = 0.8
#: blocks of pixels along a side of a map that is drawn
MAP_PIXELS = 900
#: names of chemage's own figures, in the folder of a run, in comparisons and in reports
CORE: tuple[str, ...] = (
    "surface",
    "pressure",
    "friction",
    "ensemble",
    "heights",
    "patch",
    "friction-drop",
    "friction-coefficient-drop",
    "bonds-per-area",
    "pressures",
)


def panels(
    width: float,
    height: float,
    columns: int = 1,
    rows: int = 1,
    *,
    dpi: float = 150,
) -> tuple[Figure, list[Axes]]:
    """Make an empty figure of ``width`` by ``height`` inches; the figure, and its plots row by row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=dpi)
    FigureCanvasAgg(figure)
    return figure, list(np.ravel(figure.subplots(rows, columns)))


def plots(
    width: float, height: float, columns: int = 1, count: int = 1, dpi: float = 150
) -> tuple[Figure, list[Axes]]:
    """Make an empty figure of ``count`` plots in the current look, nominally ``width`` by ``height`` inches.

    In print it is as wide as the look says, with as many of the ``columns`` as have room; plots keep their proportions.
    """
    look = current()
    if look.width is None:
        figure, axes = panels(
            _SCREEN * width,
            _SCREEN * height,
            columns,
            -(-count // columns),
            dpi=dpi / _SCREEN,
        )
    else:
        proportion = (height / -(-count // columns)) / (width / columns)
        inches = look.width / 25.4
        columns = max(1, min(columns, int(inches / _PLOT)))
        rows = -(-count // columns)
        figure, axes = panels(
            inches, proportion * inches / columns * rows, columns, rows, dpi=300
        )
    for empty in axes[count:]:
        empty.remove()
    return figure, axes[:count]


def pooled(
    values: np.ndarray, pool: Callable[..., np.ndarray], most: int = MAP_PIXELS
) -> np.ndarray:
    """Reduce ``values`` (nx, ny) in blocks by ``pool`` (``np.max``, ``np.mean``) to at most ``most`` blocks a side."""
    step = max(1, -(-max(values.shape) // most))
    if step == 1:
        return values
    nx, ny = (-(-n // step) * step for n in values.shape)
    if (nx, ny) != values.shape:
        values = np.pad(
            values,
            ((0, nx - values.shape[0]), (0, ny - values.shape[1])),
            mode="edge",
        )
    # rows first: they are contiguous
    rows = pool(values.reshape(nx // step, step, ny), axis=1)
    return pool(rows.reshape(nx // step, ny // step, step), axis=2)


def from_zero(axes: Axes) -> None:
    """Let the vertical axis begin at 0 and end above all that is drawn, what was drawn before an earlier call too."""
    axes.autoscale(axis="y")
    axes.set_ylim(bottom=0)


def decades_only(*axes: Axis) -> None:
    """Leave out the ticks between the decades of logarithmic axes, which are half of the work of drawing a plot."""
    from matplotlib.ticker import NullLocator

    for axis in axes:
        axis.set_minor_locator(NullLocator())


def draw_map(
    axes: Axes,
    values: np.ndarray,
    extent: tuple[float, float, float, float],
    label: str,
    **style: Any,
) -> None:
    """Draw ``values`` (nx, ny) as a map with a colour bar and a scale bar: x to the right, y upwards, ``extent`` in nm.

    A map that is much longer than wide is stretched; it has no scale bar.
    """
    width, height = extent[1] - extent[0], extent[3] - extent[2]
    aspect = "equal" if max(width, height) < 6 * min(width, height) else "auto"
    image = axes.imshow(
        values.T,
        origin="lower",
        extent=extent,
        interpolation="nearest",
        aspect=aspect,
        **style,
    )
    axes.set(xlabel="x (nm)", ylabel="y (nm)")
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label(label)
    if aspect == "equal":
        _draw_scale_bar(axes, width)


def _draw_scale_bar(axes: Axes, width: float) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, a sixth to a third of a map that is ``width`` nm wide."""
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    power = 10.0 ** math.floor(math.log10(width / 3))
    length = max(
        step * power for step in (1, 2, 5) if step * power <= (1 + 1e-9) * width / 3
    )
    words = f"{length / 1000:g} µm" if length >= 1000 else f"{length:g} nm"
    size = FontProperties(size=current().settings()["legend.fontsize"])
    bar = AnchoredSizeBar(
        axes.transData,
        length,
        words,
        "lower left",
        borderpad=0.4,
        sep=2,
        fontproperties=size,
    )
    bar.size_bar.get_children()[0].set(linewidth=1.5, color=BLACK)
    bar.patch.set(alpha=0.8, linewidth=0)
    axes.add_artist(bar)


def pressure_colours() -> Colormap:
    """Colours from orange to black: even the lowest pressure is seen on white."""
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list(
        "pressure", list(colormaps["inferno_r"](np.linspace(0.2, 1.0, 256))), 256
    )


def seen_blocks(axes: Axes) -> int:
    """Blocks of pixels along a side of a map, at most, that are all seen in ``axes``: each is a point of print wide."""
    points = 72 * axes.figure.bbox.width / axes.figure.dpi
    columns = (
        place.get_gridspec().ncols
        if (place := axes.get_subplotspec()) is not None
        else 1
    )
    return max(100, int(0.7 * points / columns))


def legend_entries(axes: Axes) -> tuple[list[Any], list[str]]:
    """Handles and labels of the curves first and then of the lines fitted to them."""
    from matplotlib.container import ErrorbarContainer

    handles, labels = axes.get_legend_handles_labels()
    order = sorted(
        range(len(labels)),
        key=lambda at: not isinstance(handles[at], ErrorbarContainer),
    )
    return [handles[at] for at in order], [labels[at] for at in order]


def legend(axes: Axes, **options: Any) -> None:
    """Make a legend of the curves first and then of the lines fitted to them; none without entries."""
    handles, labels = legend_entries(axes)
    if labels:
        axes.legend(handles, labels, **options)


def shared_legend(
    figure: Figure, handles: list[Any], title: str = "", *, beside: bool = False
) -> None:
    """Make a legend for all plots of a figure below them, in as many columns as have room; ``beside`` them where the
    figure is not for print."""
    if beside and current().width is None:
        figure.legend(
            handles=handles, loc="outside right center", title=title or None
        )
        return
    style: dict[str, Any] = {
        "handles": handles,
        "loc": "outside lower center",
        "title": title or None,
    }
    made = figure.legend(**style)
    columns = max(1, int(0.97 * figure.bbox.width / made.get_window_extent().width))
    made.remove()
    figure.legend(**style, ncols=min(columns, len(handles), 5))


def plain(text: str) -> str:
    """Escape ``text`` so that matplotlib shows it unchanged: dollars mark no formula, a leading _ hides no curve."""
    shown = printable(text).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def canvas_of(figure: Figure) -> FigureCanvasAgg:
    """The canvas of ``figure``, which draws it into pixels; figures of plugins may come with another."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    return (
        figure.canvas
        if isinstance(figure.canvas, FigureCanvasAgg)
        else FigureCanvasAgg(figure)
    )


def png(figure: Figure, alt: str) -> str:
    """Make an HTML element of ``figure`` that holds the picture itself; ``alt`` describes it in words."""
    data = io.BytesIO()
    # the same bytes as savefig, which draws everything twice
    canvas_of(figure).print_png(data, metadata={"Software": None})
    width, height = (
        round(figure.dpi * inches) for inches in figure.get_size_inches()
    )
    source = base64.b64encode(data.getvalue()).decode()
    return f'<img alt="{escape(alt, quote=True)}" width="{width}" height="{height}" src="data:image/png;base64,{source}">'


def save_figures(
    named: Mapping[str, Figure],
    folder: Path,
    *,
    force: bool = False,
    suffix: str = "png",
    data: bool = False,
) -> list[Path]:
    """Write figures as ``folder``/name.``suffix``, and return the paths; ``data``: what they show as well, as name.csv.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or the folder cannot be written; nothing is drawn in the first case.
    """
    make_folder(folder)
    made = {folder / f"{name}.{suffix}": figure for name, figure in named.items()}
    tables = (
        {path.with_suffix(".csv"): figure for path, figure in made.items()}
        if data
        else {}
    )
    for path in (*made, *tables):
        preflight(path, force=force)
    for path, figure in made.items():
        save_figure(figure, path, suffix, force=force)
    for path, figure in tables.items():
        write_file(path, drawn_data(figure), force=force)
    return [*made, *tables]


def save_figure(
    figure: Figure, path: Path, suffix: str, *, force: bool = False
) -> None:
    """Write a figure into one file, of the format ``suffix``, in the current look."""
    with drawn_as(), fresh_file(path, force=force) as part:
        if suffix == "png":
            canvas_of(figure).print_png(part)
        else:
            figure.savefig(part, format=suffix)
