"""What can be plugged into reports: figures of plugins that offer no component."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookspec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from chemage.ageing.plotted import PlottedResult


@hookspec
def chemage_figures() -> Mapping[str, tuple[str, Callable[[Axes, Sequence[PlottedResult]], None]]]:  # pyright: ignore[reportReturnType]
    """Bring figures: ``{name: (caption, function that draws the results into the axes)}``."""
