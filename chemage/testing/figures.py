"""Checks of the figures that components bring."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.observables import Maps, Observable, Observed, PlottedResult
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.foundation.figures import CORE
from chemage.lattices.chemistry import Chemistry
from chemage.surfaces.surface import Surface
from chemage.testing.checks import check_of, require
from chemage.testing.replicas import Even, Replica, finished, numbers


@check_of("")
def _figures_are_named(component: Component) -> None:
    """Each figure has a caption, and a name that a file can have and that is none of chemage's own figures'."""
    figures = type(component).figures
    require(isinstance(figures, Mapping), f"figures = {figures!r}; give a mapping from names to captions")
    for name, caption in figures.items():
        require(
            isinstance(name, str) and re.fullmatch(r"\w[\w .+-]*", name),
            f"figures names {name!r}; a figure is saved as a file of this name: use letters, digits, - and _",
        )
        require(name not in CORE, f"figures names {name!r}, which is a figure of chemage; choose another name")
        if component.role != "observable":  # those have a check of their own
            require(isinstance(caption, str) and caption.strip(), f"figure {name!r} has no caption")


@check_of("")
def _components_draw_their_figures(component: Component) -> None:
    """A component that is no observable draws each of its figures, of one result and of several, also where a part of
    the result is not known."""
    for name in () if component.role == "observable" else type(component).figures:
        for what, results in _results(component).items():
            _drawn(component, name, results, f" of {what}", filled="without" not in what)


@check_of("observable")
def _figures_are_drawn(component: Observable) -> None:
    """Each of ``figures`` has a caption and is drawn from all replicas, of one result and of several, also where the
    chemistry is not known."""
    figures = type(component).figures
    require(isinstance(figures, Mapping), f"figures = {figures!r}; give a mapping from names to captions")
    if not figures:
        return
    few, many, some = finished(40, 3), finished(40, 40), finished(40, 17)
    first, second = _measured(component, [some, few, few]), _measured(component, [some, many, many])
    chemistry = Chemistry(forming=Even(), activation_volume=0.04)
    same = all(np.array_equal(first.observables[name], second.observables[name]) for name in first.observables)
    for figure, caption in figures.items():
        require(isinstance(figure, str) and figure, f"figures names {figure!r}; give names as str")
        require(isinstance(caption, str) and caption.strip(), f"figure {figure!r} has no caption")
        shown = _drawn(component, figure, [Observed("one", first, chemistry, "#0072b2")])
        _drawn(component, figure, [Observed("one", first, None, "#0072b2")])
        _drawn(component, figure, [Observed("one", first, chemistry, "C0"), Observed("two", second, None, "C1")])
        other = _drawn(component, figure, [Observed("one", second, chemistry, "#0072b2")])
        require(
            same or shown != other,
            f"figure {figure!r} is the same whatever the second and the third replica have; draw all replicas",
        )


def _drawn(component: Any, figure: str, results: Sequence[Any], what: str = "", filled: bool = True) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = FigureCanvasAgg(Figure())
    axes = canvas.figure.subplots()
    component.draw(figure, axes, results)
    what = what or f" of {len(results)} result(s)"
    require(axes.has_data() or not filled, f"draw({figure!r}){what} left the axes empty; draw the results")
    canvas.draw()
    return bytes(canvas.buffer_rgba())


def _measured(component: Observable, replicas: Sequence[Replica]) -> Aging:
    """The result of these replicas, as ``chemage.age`` makes it."""
    measured = [numbers(component, replica, "a replica") for replica in replicas]
    return _aging(
        replicas[0].contact,
        bonds=np.stack([replica.history.bonds for replica in replicas]),
        hold_times=replicas[0].history.hold_times,
        observables={name: np.stack([values[name] for values in measured]) for name in measured[0]},
        provenance={"observe": [component.todict()]},
    )


def _aging(contact: ContactSolution, bonds: np.ndarray, **fields: Any) -> Aging:
    most = np.full(len(bonds), bonds.max(initial=40))
    own = {"load": contact.load, "temperature": 300.0, "engine": "by-hand", "contact": contact.summary()}
    return Aging(bonds=bonds, sites=most, events=most, **own, **fields)


def _results(component: Component) -> dict[str, Sequence[PlottedResult]]:
    """Results to draw, by what they are."""
    x = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    surface = Surface(heights=np.cos(x)[:, None] + np.cos(2 * x)[None, :], pixel_size=0.5)
    pressure = np.maximum(surface.heights - 0.5, 0.0)
    contact = ContactSolution(pressure=pressure, load=float(pressure.sum() / 4), pixel_size=0.5, modulus=35.0)
    chemistry, maps = Chemistry(forming=Even(), activation_volume=0.04), Maps(contact, surface)

    def result(label: str, most: int, color: str, **changes: Any) -> PlottedResult:
        bonds = np.array([[0, most // 2, most], [1, most // 3, most - 1]])
        aging = _aging(contact, bonds, hold_times=np.array([0.1, 1.0, 10.0]))
        fields = {"aging": aging, "chemistry": chemistry, "load_maps": lambda: maps, **changes}
        return PlottedResult(label=label, color=color, component=component, **fields)

    results: dict[str, Sequence[PlottedResult]] = {
        "one result": [result("one", 20, "C0")],
        "two results": [result("one", 20, "C0"), result("two", 12, "C1")],
        "a result without maps and chemistry": [result("one", 20, "C0", chemistry=None, load_maps=Maps)],
    }
    if component.role in ("surface", "contact"):
        results["a result without ageing"] = [result("one", 20, "C0", aging=None, chemistry=None)]
    return results
