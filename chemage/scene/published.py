"""Published values beside a result: a plugin that owns a scene says what was published about it.

Only β is compared: a line of the published slope through the middle of the fitted line of the result.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from chemage.foundation.figures import BLACK, plain
from chemage.plugins import registry

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from chemage.ageing.fitting import Fit


class Published(NamedTuple):
    """A published ageing rate."""

    #: per decade
    beta: float
    #: who published it, for the legend
    source: str


def published(scene: Mapping[str, Any]) -> list[Published]:
    """List what plugins say was published for a result of ``scene`` (plain data, in internal units)."""
    plugins = registry.current()
    values = []
    for record, function in plugins.functions("chemage_published"):
        try:
            for where, beta, source in function() or ():
                if where and all(_same(_value(scene, path), value) for path, value in where.items()):
                    values.append(Published(float(beta), str(source)))
        except (Exception, SystemExit) as error:
            if plugins.strict:
                raise
            warnings.warn(
                f"published values of plugin {record.name!r} ({record.source}) were left out: "
                f"{type(error).__name__}: {error}",
                registry.PluginWarning,
                stacklevel=2,
            )
    return values


def draw_published(axes: Axes, scene: Mapping[str, Any], fit: Fit | None) -> None:
    """Draw the published slopes over the hold times of a fit, through the middle of the fitted line."""
    if fit is None or not fit.drawable:
        return
    middle = math.sqrt(fit.span[0] * fit.span[1])
    for number, value in enumerate(published(scene)):
        line = np.geomspace(*fit.span, 50)
        values = float(fit(middle)) + value.beta * np.log10(line / middle)
        label = plain(f"published β = {value.beta:g} ({value.source})")
        axes.plot(line, values, color=BLACK, lw=1.2, ls=("--", ":", "-.")[number % 3], zorder=4, label=label)


def _value(scene: Mapping[str, Any], path: str) -> Any:
    place: Any = scene
    for name in path.split("."):
        place = place.get(name) if isinstance(place, Mapping) else None
    return place


def _same(values: Any, expected: Any) -> bool:
    if isinstance(expected, float | int) and isinstance(values, float | int) and not isinstance(values, bool):
        return math.isclose(values, expected, rel_tol=1e-6)
    return values == expected
