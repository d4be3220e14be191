"""What can be plugged into reports: figures of plugins that offer no component, and published values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookspec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from chemage.ageing.observables import PlottedResult


@hookspec
def chemage_figures() -> Mapping[str, tuple[str, Callable[[Axes, Sequence[PlottedResult]], None]]]:  # pyright: ignore[reportReturnType]
    """Bring figures: ``{name: (caption, function that draws the results into the axes)}``."""


@hookspec
def chemage_published() -> Sequence[tuple[Mapping[str, object], float, str]]:  # pyright: ignore[reportReturnType]
    """Say what was published: ``[(where, beta, source), ...]``, β per decade of the scenes whose fields are ``where``
    (dotted path -> value, internal units); drawn beside the fitted line of such a result."""
