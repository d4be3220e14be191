"""The figures that plugins bring, of one result or of several that are compared.

A component brings those of its class (``figures`` and ``draw``), a plugin of hooks those of ``chemage_figures``. All
results in which components of one kind, or one plugin, took part are drawn into one set of axes. What cannot be drawn
is reported with a warning, and costs neither the result nor another figure.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from chemage.ageing.observables import Observed, PlottedResult
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.foundation.figures import CORE, PALETTE, blank
from chemage.lattices.chemistry import Chemistry
from chemage.plugins import registry
from chemage.plugins.sources import implementing, stage_hooks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from chemage.plugins.registry import PluginRecord

#: a figure is saved as a file of its name
_NAME = re.compile(r"\w[\w .+-]*")


@dataclass(frozen=True)
class Source:
    """A result, and what took part in it."""

    result: PlottedResult
    #: path of the section -> component
    components: Sequence[tuple[str, Component]]
    #: plugins that took part: name -> version
    plugins: Mapping[str, str]


class Brought(NamedTuple):
    """A figure that a plugin has drawn, and its caption."""

    figure: Figure
    caption: str


class _Plan(NamedTuple):
    """A figure to be drawn."""

    name: str
    caption: str
    #: who brings it, in words
    bringer: str
    #: distinguishes it from a figure of the same name
    prefix: str
    draw: Callable[[Axes], None]


def chemistry_of(provenance: Mapping[str, Any]) -> Chemistry | None:
    """The chemistry of an ageing curve; None without provenance, or without the plugins that made it."""
    try:
        return Chemistry.fromdict(provenance["chemistry"])
    except (KeyError, ChemageError):
        return None


def plugin_figures(sources: Sequence[Source], size: tuple[float, float] = (5.4, 4.0)) -> dict[str, Brought]:
    """Draw every figure that plugins bring to these results: name -> figure and caption.

    A name that another plugin, or chemage itself, has given to another figure gets a prefix, with a warning.
    """
    drawn: dict[str, Brought] = {}
    owners = dict.fromkeys(CORE, "chemage itself")
    for plan in (*_of_components(sources), *_of_hooks(sources)):
        if not _NAME.fullmatch(plan.name):
            _warn(f"the figure {plan.name!r} of {plan.bringer} was left out: the name of a figure names a file")
            continue
        name = plan.name
        while name in owners:
            name = f"{plan.prefix}-{name}"
        if name != plan.name:
            _warn(
                f"the figure {plan.name!r} of {plan.bringer} has the name of one of {owners[plan.name]}; "
                f"it is called {name!r} here"
            )
        owners[name] = plan.bringer
        figure = _drawn(plan, size)
        if figure is not None:
            drawn[name] = Brought(figure, plan.caption)
    return drawn


def _drawn(plan: _Plan, size: tuple[float, float]) -> Figure | None:
    figure, axes = blank(*size)
    try:
        plan.draw(axes)
        _rendered(figure)
    except (Exception, SystemExit) as error:
        if registry.current().strict:
            raise
        _warn(
            f"the figure {plan.name!r} of {plan.bringer} was left out: it cannot be drawn: "
            f"{type(error).__name__}: {error}"
        )
        return None
    return figure


def _rendered(figure: Figure) -> None:
    """Find what can only be found when a figure is rendered, such as a formula that is wrong; nothing is moved."""
    layout = figure.get_layout_engine()
    figure.set_layout_engine("none")
    figure.draw_without_rendering()
    figure.set_layout_engine(layout)


def _warn(text: str) -> None:
    warnings.warn(text, registry.PluginWarning, stacklevel=3)


# -- of components ----------------------------------------------------------------------------------------------------


def _of_components(sources: Sequence[Source]) -> Iterator[_Plan]:
    """The figures of each kind, with all the results in which a component of this kind took part."""
    groups: dict[tuple[str, str], list[tuple[int, str, Component]]] = {}
    for number, source in enumerate(sources):
        for path, component in source.components:
            measured = component.role != "observable" or source.result.aging is not None
            if type(component).figures and measured:
                groups.setdefault((component.role, component.kind), []).append((number, path, component))
    for (role, kind), components in groups.items():
        component = components[0][2]
        results = _results(sources, components)
        bringer = f"{role} {kind!r}{_by(registry.current().provider(type(component)))}"
        figures = type(component).figures
        if not isinstance(figures, Mapping):
            _warn(f"the figures of {bringer} were left out: figures = {figures!r} does not map names to captions")
            continue
        for name, caption in figures.items():
            yield _Plan(str(name), str(caption), bringer, kind, _drawing(component, name, results))


def _drawing(component: Component, name: str, results: Sequence[PlottedResult]) -> Callable[[Axes], None]:
    return lambda axes: component.draw(name, axes, results)


def _results(sources: Sequence[Source], components: Sequence[tuple[int, str, Component]]) -> list[PlottedResult]:
    """What to draw of the results; one with several components of the kind is there once for each of them."""
    numbers = [number for number, _, _ in components]
    several = len(set(numbers)) < len(numbers)
    drawn = []
    for count, (number, path, component) in enumerate(components):
        result = sources[number].result
        changes: dict[str, Any] = {"component": component}
        if several:
            changes["color"] = PALETTE[count % len(PALETTE)]
        if numbers.count(number) > 1:
            changes["label"] = f"{result.label}, {path}"
        if component.role == "observable":
            result = Observed(**{field.name: getattr(result, field.name) for field in fields(result)})
        drawn.append(replace(result, **changes))
    return drawn


def _by(record: PluginRecord | None) -> str:
    if record is None or record.distribution == "chemage":
        return ""
    return f" (plugin {record.name}, {record.source})"


# -- of hooks ---------------------------------------------------------------------------------------------------------


def _of_hooks(sources: Sequence[Source]) -> Iterator[_Plan]:
    """The figures of ``chemage_figures``: of the results in which the plugin took part.

    A plugin that answers no stage and offers no component can take part in none; it is given all results.
    """
    plugins = registry.current()
    computing = implementing(*stage_hooks())
    for record, function in plugins.functions("chemage_figures"):
        own = [
            source.result
            for source in sources
            if record.name in source.plugins or not (record.kinds or record.name in computing)
        ]
        if not own:
            continue
        bringer = f"plugin {record.name!r} ({record.source})"
        try:
            offered = [(name, caption, draw) for name, (caption, draw) in (function() or {}).items()]
        except (Exception, SystemExit) as error:
            if plugins.strict:
                raise
            _warn(
                f"the figures of {bringer} were left out: chemage_figures must give "
                f"{{name: (caption, function)}}: {type(error).__name__}: {error}"
            )
            continue
        for name, caption, draw in offered:
            yield _Plan(str(name), str(caption), bringer, record.name, _calling(draw, own))


def _calling(draw: Any, results: Sequence[PlottedResult]) -> Callable[[Axes], None]:
    return lambda axes: draw(axes, results)
