"""The figures that observables draw, of one result or of several that are compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from chemage.ageing.aging import Aging
from chemage.ageing.observables import Observable, Observed
from chemage.foundation.errors import ChemageError
from chemage.lattices.chemistry import Chemistry
from chemage.plugins import registry
from chemage.reports.figures import blank

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def observed_in(label: str, aging: Aging, color: str) -> Observed:
    """Make the description of a result from which an observable draws it."""
    try:
        chemistry = Chemistry.fromdict(aging.provenance["chemistry"])
    except (KeyError, ChemageError):  # no provenance, or plugins that are not installed here
        chemistry = None
    return Observed(label, aging, chemistry, color)


def observables_of(aging: Aging, scene: Mapping[str, Any] | None = None) -> list[Observable]:
    """Find the observables that were measured in a result and are installed."""
    found = []
    for fields in aging.provenance.get("observe") or (scene or {}).get("observe", ()):
        try:
            found.append(registry.current().fromdict("observable", fields))
        except ChemageError:
            continue
    return found


def observable_figures(
    results: Sequence[tuple[Observed, Sequence[Observable]]], size: tuple[float, float] = (5.4, 4.0)
) -> dict[str, Figure]:
    """Draw the figures of all observables, each with all the results in which it was measured: name -> figure."""
    by_kind: dict[str, tuple[Observable, list[Observed]]] = {}
    for observed, observables in results:
        for one in observables:
            by_kind.setdefault(one.kind, (one, []))[1].append(observed)
    made: dict[str, Figure] = {}
    for one, measured in by_kind.values():
        for name in one.figures:
            figure, axes = blank(*size)
            one.draw(name, axes, measured)
            made[name] = figure
    return made


def captions(observables: Sequence[Observable]) -> dict[str, str]:
    """The captions of the figures of observables: name -> caption."""
    return {name: caption for one in observables for name, caption in one.figures.items()}
