"""Building blocks of figures: empty panels, the palette, maps, saving. pyplot and its global state are not used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.foundation.errors import StoreError
from chemage.foundation.files import fresh_file, preflight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: colour-blind safe (Okabe & Ito 2008)
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#777777"
BLACK = "#000000"
#: colours of curves, in order
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, GREY, "#E69F00", "#56B4E9", "#8C564B")
_MAP_PIXELS = 900
#: names of chemage's own figures, in the folder of a run, in comparisons and in reports
CORE = (
    *("surface", "pressure", "friction"),
    *("heights", "patch"),
    *("friction-drop", "friction-coefficient-drop", "bonds-per-area", "pressures"),
)


def panels(
    width: float, height: float, columns: int = 1, rows: int = 1, *, dpi: float = 150
) -> tuple[Figure, list[Axes]]:
    """Make an empty figure of ``width`` by ``height`` inches; the figure, and its plots row by row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=dpi)
    FigureCanvasAgg(figure)
    return figure, list(np.ravel(figure.subplots(rows, columns)))


def blank(width: float, height: float) -> tuple[Figure, Axes]:
    """Make an empty figure of one plot, ``width`` by ``height`` inches."""
    figure, (axes,) = panels(width, height)
    return figure, axes


def pooled(values: np.ndarray, pool: Callable[..., np.ndarray], most: int = _MAP_PIXELS) -> np.ndarray:
    """Reduce ``values`` (nx, ny) in blocks by ``pool`` (``np.max``, ``np.mean``) to at most ``most`` blocks a side."""
    step = max(1, -(-max(values.shape) // most))
    if step == 1:
        return values
    nx, ny = (-(-n // step) * step for n in values.shape)
    padded = np.pad(values, ((0, nx - values.shape[0]), (0, ny - values.shape[1])), mode="edge")
    return pool(pool(padded.reshape(nx // step, step, ny // step, step), axis=3), axis=1)


def draw_map(
    axes: Axes, values: np.ndarray, extent: tuple[float, float, float, float], label: str, **style: Any
) -> None:
    """Draw ``values`` (nx, ny) as a map with a colour bar: x to the right, y upwards, ``extent`` in nm.

    A map that is much longer than wide is stretched.
    """
    width, height = extent[1] - extent[0], extent[3] - extent[2]
    aspect = "equal" if max(width, height) < 6 * min(width, height) else "auto"
    image = axes.imshow(values.T, origin="lower", extent=extent, interpolation="nearest", aspect=aspect, **style)
    axes.set(xlabel="x (nm)", ylabel="y (nm)")
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label(label)


def plain(text: str) -> str:
    """Escape ``text`` so that matplotlib shows it unchanged: dollars mark no formula, a leading _ hides no curve."""
    shown = text.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def save_figures(named: Mapping[str, Figure], folder: Path, *, force: bool = False, suffix: str = "png") -> list[Path]:
    """Write figures as ``folder``/name.``suffix``, and return the paths.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or the folder cannot be written; nothing is drawn in the first case.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {folder}: {error.strerror}") from error
    made = {folder / f"{name}.{suffix}": figure for name, figure in named.items()}
    for path in made:
        preflight(path, force=force)
    for path, figure in made.items():
        with fresh_file(path, force=force) as part:
            figure.savefig(part, format=suffix)
    return list(made)
