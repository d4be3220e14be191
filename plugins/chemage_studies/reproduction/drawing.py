"""Building blocks of the figures of the reproduction."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import figures
from chemage_studies.reproduction.points import Mean, Point, curve, spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: size of the text of legends
SMALL = 7


def figure(columns: int, rows: int = 1, width: float = 4.6, height: float = 3.9) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels of ``width`` by ``height`` inches, row by row."""
    return figures.panels(width * columns, height * rows, columns, rows, dpi=110)


def say_scatter(axes: Axes) -> None:
    """Say on the figure, once, what its bars and bands are."""
    axes.figure.supxlabel("bars and bands: standard deviation between surfaces", fontsize=SMALL)


def band(
    axes: Axes, points: list[Point], quantity: Callable[[Point], np.ndarray], label: str = "", **style: Any
) -> None:
    """Draw the mean of a curve against hold time, and the standard deviation between surfaces as a band."""
    times, middle, half = points[0].hold_times, curve(points, quantity), spread(points, quantity)
    axes.plot(times, middle, label=label or None, **style)
    if half.any():
        axes.fill_between(times, middle - half, middle + half, color=style.get("color"), alpha=0.2, lw=0)
        say_scatter(axes)


def bars(axes: Axes, x: Iterable[float], means: Iterable[Mean], **style: Any) -> None:
    """Draw means with the standard deviation between surfaces."""
    found = list(means)
    say_scatter(axes)
    axes.errorbar(
        list(x),
        [one.value for one in found],
        yerr=[0.0 if np.isnan(one.scatter) else one.scatter for one in found],
        capsize=2,
        elinewidth=0.8,
        **{"ms": 3, "lw": 1, **style},
    )


def density(axes: Axes, points: list[Point], name: str, edges: str, **style: Any) -> None:
    """Draw the mean of a measured density over surfaces, with its standard deviation as a band."""
    bounds = points[0].observables[edges]
    middle, half = (part(points, lambda p: p.observables[name]) for part in (curve, spread))
    axes.stairs(middle, bounds, **style)
    if half.any():
        centre = 0.5 * (bounds[1:] + bounds[:-1])
        low, high = np.maximum(middle - half, 0), middle + half
        axes.fill_between(centre, low, high, step="mid", color=style.get("color"), alpha=0.2, lw=0)
        say_scatter(axes)


def legend(axes: Axes, **style: Any) -> None:
    """Draw a legend without a frame."""
    axes.legend(**{"frameon": False, "fontsize": SMALL, "title_fontsize": SMALL, **style})


def letter(axes: Iterable[Axes], letters: str) -> None:
    """Write the letters of panels above their left upper corners."""
    for one, name in zip(axes, letters, strict=True):
        one.set_title(f"({name})", loc="left", fontsize=10)
