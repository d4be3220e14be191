"""Checks of the figures that components bring."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.observables import Maps, PlottedResult
from chemage.contacts.solution import ContactSolution
from chemage.foundation.components import Component
from chemage.foundation.figures import CORE
from chemage.lattices.chemistry import Chemistry
from chemage.surfaces.surface import Surface
from chemage.testing.checks import check_of, require
from chemage.testing.replicas import Even


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
    if component.role == "observable":
        return
    for name in type(component).figures:
        for what, results in _results(component).items():
            axes = _axes()
            component.draw(name, axes, results)
            require(
                axes.has_data() or "without" in what, f"draw({name!r}) of {what} left the axes empty; draw the results"
            )
            axes.figure.canvas.draw()


def _axes() -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    return FigureCanvasAgg(Figure()).figure.subplots()


def _results(component: Component) -> dict[str, Sequence[PlottedResult]]:
    """Results to draw, by what they are."""
    x = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    surface = Surface(heights=np.cos(x)[:, None] + np.cos(2 * x)[None, :], pixel_size=0.5)
    pressure = np.maximum(surface.heights - 0.5, 0.0)
    contact = ContactSolution(pressure=pressure, load=float(pressure.sum() / 4), pixel_size=0.5, modulus=35.0)
    chemistry = Chemistry(forming=Even(), activation_volume=0.04)

    def aging(most: int) -> Aging:
        return Aging(
            hold_times=np.array([0.1, 1.0, 10.0]),
            bonds=np.array([[0, most // 2, most], [1, most // 3, most - 1]]),
            sites=np.array([most, most]),
            events=np.array([most, most]),
            load=contact.load,
            temperature=300.0,
            engine="by-hand",
            contact=contact.summary(),
        )

    def result(label: str, most: int, color: str, **changes: Any) -> PlottedResult:
        maps = Maps(contact, surface)
        given = {"aging": aging(most), "chemistry": chemistry, "load_maps": lambda: maps, **changes}
        return PlottedResult(label=label, color=color, component=component, **given)

    found: dict[str, Sequence[PlottedResult]] = {
        "one result": [result("one", 20, "C0")],
        "two results": [result("one", 20, "C0"), result("two", 12, "C1")],
        "a result without maps and chemistry": [result("one", 20, "C0", chemistry=None, load_maps=Maps)],
    }
    if component.role in ("surface", "contact"):
        found["a result without ageing"] = [result("one", 20, "C0", aging=None, chemistry=None)]
    return found
