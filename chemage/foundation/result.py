"""What every kind of result says of itself: rows, numbers, notes, parts, pictures, tables and what to cite.

``chemage show``, ``plot``, ``report``, ``compare``, notebooks, JSON and CSV are written on :class:`Result` alone. A
kind of result is a subclass; where the numbers are in a class of their own, :func:`displays` says which shows it.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.arranging import arrange
from chemage.foundation.errors import InputError, nearest
from chemage.foundation.figures import panels, plots, png
from chemage.foundation.looks import drawn_as
from chemage.foundation.names import PICTURES
from chemage.foundation.outputs import RECORDED, Observing
from chemage.foundation.ownership import Owned
from chemage.foundation.quantities import NONE as NONE
from chemage.foundation.quantities import ONE, Curve, Quantity, Rank, headed
from chemage.foundation.records import Record
from chemage.foundation.text import (
    approximations_in_words,
    html_table,
    jsonable,
    with_article,
)

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: (name, text)
Rows = list[tuple[str, str]]
#: hold times at which results are compared, s, besides the last
TIMES = (1.0, 1e3)


def compared_time(x: np.ndarray) -> float:
    """The last of :data:`TIMES` that lies within the points ``x``, else the last point."""
    inside = [time for time in TIMES if x[0] <= time <= x[-1]]
    return inside[-1] if inside else float(x[-1])


#: what stands after the name of a number, where a table is flat
_END = re.compile("_(stderr|half_width|low|high)$")


@dataclass(frozen=True)
class Medium:
    """Where something is drawn: blocks of pixels along a side of a map."""

    pixels: int

    @property
    def font(self) -> float:
        """Points of the font of legends, as the style says."""
        import matplotlib as mpl

        return mpl.rcParams["legend.fontsize"]


#: inches of each panel in the cell of a notebook
_CELL_SIZE = (3.7, 3.1)
#: a file or the page of a report, and the cell of a notebook, whose page holds every picture
FILE, CELL = Medium(900), Medium(160)


@dataclass(frozen=True)
class Panel:
    """One plot: on a page a figure of its own, in a file beside the others of its :class:`Picture`."""

    draw: Callable[[Axes, Medium], None]
    #: below it on a page; without a caption it is not on the page
    caption: str = ""
    #: in words and numbers, for readers who cannot see it
    alt: str = ""
    #: of a figure of its own, inches; small, so that the text is legible on a phone
    size: tuple[float, float] = (4.9, 3.6)
    #: a map, which is stored as pixels
    is_map: bool = False
    #: above it on a page
    heading: str = "Figures"
    #: by which it is chosen of a picture of several panels
    name: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure of one or several panels, row by row."""

    panels: Sequence[Panel]
    #: nominal inches; in print panels keep these proportions
    size: tuple[float, float] = (5.6, 4.2)
    columns: int | None = None
    title: str = ""
    #: called with the figure and its plots when all of them are drawn
    finish: Callable[[Figure, list[Axes]], None] | None = None
    #: panels in the cell of a notebook
    in_cell: int = 1
    dpi: float = 150


@dataclass(frozen=True)
class Table:
    """A table of text; the first column names the rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    #: above it on a page
    heading: str = ""
    #: sentences below it
    remarks: Sequence[str] = ()
    #: whether it is on pages only
    in_detail: bool = True
    #: rows that are printed, at most
    most: int | None = None
    #: printed without space between columns
    dense: bool = False


@dataclass(frozen=True)
class Comparable:
    """What of an aged result other results and measurements are held against."""

    #: fields that determine the kinetics of the sites: dotted path -> value
    chemistry: Fields = field(default_factory=dict)
    #: nN
    load: float = np.nan
    #: hold times of the line of β, s
    window: tuple[float, float] | None = None
    #: fits a model (quantity, window) as to measurements: a fit, or why there is none
    fit: Callable[[Any, Any, Any], Any] | None = None
    #: draws the fit beside the curve of the friction coefficient: called with axes, label ("" alone) and colour
    draw_fit: Callable[[Axes, str, str], None] | None = None
    #: ΔF (nN, (m,)) at a load (nN), a temperature (K) and hold times (s), and its covariance (m, m), where a result can
    #: say it
    predict: (
        Callable[[float, float, np.ndarray], tuple[np.ndarray, np.ndarray]] | None
    ) = None


class Result(Owned):
    """A result as users see it: facts, quantities, curves and pictures; everything that is shown is made from these."""

    #: characters of a line, where it is printed into a file or a pipe
    width: int = 110
    #: what its errors are, in words, for the foot of a page
    errors: str = ""
    #: what stands below the heading of its references
    please_cite: str = "Please cite these works together with the results:"

    @property
    def name(self) -> str:
        """For files and legends."""
        return type(self).__name__

    @property
    def title(self) -> str:
        """For headings; may be empty."""
        return self.name

    @property
    def heading(self) -> str:
        """Above its rows."""
        return self.title

    @property
    def scene(self) -> Fields:
        """Plain data of the scene; empty where there is none."""
        return {}

    @property
    def approximation(self) -> str:
        """What is approximate about it, in words; "" if nothing is."""
        return ""

    @property
    def plugins(self) -> Mapping[str, str]:
        """Plugins that took part: name -> distribution and version."""
        return {}

    def facts(self) -> Rows:
        """What its numbers are of, in words: (what, how)."""
        return []

    def quantities(self) -> list[Quantity]:
        """Its numbers."""
        return []

    def curves(self) -> list[Curve]:
        """Its numbers along an axis; the first are drawn with those of other results."""
        return []

    def remarks(self) -> Rows:
        """The last rows of its table."""
        return [("approximate", self.approximation)] if self.approximation else []

    def rows(self, every: bool = False) -> Rows:
        """The table of its main numbers, or of ``every`` one: (what, text with error and unit)."""
        rows = self.facts()
        curves = [curve for curve in self.curves() if not curve.is_distribution]
        numbers = sorted(
            [*(curve.last() for curve in curves), *self.quantities()],
            key=lambda one: one.rank,
        )
        for one in numbers:
            if every or one.rank <= Rank.TABLE:
                rows.append(one.row())
                for cause, size, how in one.parts():
                    rows.append(
                        (
                            f"error of {one.symbol or one.label}: {cause}",
                            f"{size} (standard error), {how}",
                        )
                    )
        if self.errors and any(math.isfinite(one.half_width) for one in numbers):
            rows.append(("every ± is", self.errors))
        return [*rows, *self.remarks()]

    def arrays(self) -> Rows:
        """What was recorded and is no number or curve: (name, size and range), printed with ``--all``."""
        return [row for part in self.parts().values() for row in part.arrays()]

    def numbers(self) -> Data:
        """One JSON-able object."""
        numbers: Data = dict(self.facts())
        for one in (*self.quantities(), *self.curves()):
            numbers |= one.numbers()
        return jsonable(numbers)

    def todict(self) -> Data:
        """:meth:`numbers` for ``--json``: every number under one name, with value, unit and the ends of its interval,
        None where they are not known; those of a curve are lists, beside its axis."""
        found = self.numbers()
        declared: list[Quantity | Curve] = [*self.quantities(), *self.curves()]
        for one in declared:
            for name in one.numbers():
                found.pop(name, None)
        for name in [name for name in found if _END.sub("", name) in found]:
            if _END.search(name):  # of what does not exist
                del found[name]
        for name, value in found.items():  # counts and residuals
            if declared and type(value) in (int, float):
                found[name] = Quantity(name, ONE, name, value=value).todict()
        for one in declared:
            if isinstance(one, Curve):
                axis = one.axis_of
                name = f"{one.name}_edges" if one.is_distribution else axis.name
                if isinstance(found.get(f"{name}s"), list):
                    del found[f"{name}s"]
                edges = Curve(name, axis.unit, axis.label, mean=one.x)
                found[name] = edges.todict()
            found[one.name] = one.todict()
        if recorded := found.get("observables"):
            found["observables"] = {
                name: about
                for name, about in recorded.items()
                if f"{RECORDED}{name}" not in found
            }
        return jsonable(found)

    def summary(self) -> Rows:
        """The numbers that a reader looks for first: (value with its error, what it is)."""
        return [(one.text(), one.row()[0]) for one in self.first()]

    def first(self) -> list[Quantity]:
        """The quantities of the first rank; curves at a time that other results have, too."""
        curves = [curve for curve in self.curves() if curve.rank is Rank.FIRST]
        numbers = [
            one for one in self.quantities() if one.rank is Rank.FIRST and one.known
        ]
        return [*(curve.at(compared_time(curve.x)) for curve in curves), *numbers]

    def notes(self) -> list[str]:
        """Doubts, faults and remarks, in words, each once."""
        return []

    def parts(self) -> dict[str, Result]:
        """Results inside it, such as contact and ageing of a run."""
        return {}

    def pictures(self) -> dict[str, Picture]:
        """Its figures by name; nothing is drawn, or imported for drawing, before a panel is asked to draw."""
        return {}

    def stated(self) -> tuple[str, Fields]:
        """The scene on a page, and what it is, in words."""
        about = "All options, in internal units (nm, nN, GPa, eV, s, K). Saved as a file, this scene reproduces"
        return f"{about} the result with `chemage run`.", self.scene

    def tables(self) -> list[Table]:
        """Tables beside the rows: here its curves against their axis."""
        curves = [curve for curve in self.curves() if not curve.is_distribution]
        if not curves:
            return []
        axis, x = curves[0].axis_of, curves[0].x
        rows = [
            (f"{at:.6g}", *(curve.at(at).bare_or_none() for curve in curves))
            for at in x.tolist()
        ]
        title = f"{curves[0].over}" if curves[0].over else ""
        return [
            Table(
                title,
                [axis.axis, *(curve.axis for curve in curves)],
                rows,
                f"Against {axis.label}",
            )
        ]

    def columns(self) -> Data:
        """Its many values, for CSV: name and unit of a column -> values; empty: the rows are all there is."""
        curves = [curve for curve in self.curves() if not curve.is_distribution]
        columns: Data = {}
        for curve in curves:
            columns[headed(curve.axis_of.name, curve.axis_of.unit)] = curve.x
            columns |= {
                headed(name, curve.unit): values
                for name, values in curve.numbers().items()
            }
        return columns

    def cite(self) -> tuple[list[str], str]:
        """Texts to cite, and the version of chemage that made it ("": not recorded)."""
        return [], ""

    def made_by(self) -> Fields:
        """What made it: ``scene`` (plain data), ``ageing`` (an ageing curve) and ``contact`` (provenance), or its
        ``components``."""
        return {"scene": self.scene}

    def maps(self) -> Fields:
        """Its large arrays, for figures of plugins: ``contact`` and ``surface``, as far as it has them."""
        return {}

    def provenance(self) -> Rows:
        """Seeds, versions and content hashes: (item, value)."""
        return [
            (f"plugin {name}", version) for name, version in self.plugins.items()
        ]

    def comparable(self) -> Comparable:
        """What others are held against; nothing without ageing."""
        return Comparable()

    def completed(self, path: Path) -> Result:
        """The same with all that its file holds, where that is more than what :func:`chemage.read` gives."""
        return self

    def draw(self, axes: Axes, medium: Medium = FILE) -> None:
        """Draw its main plot: the first panel of the first picture; a kind may have options for it."""
        panels = [
            panel
            for picture in self.pictures().values()
            for panel in picture.panels
        ]
        if not panels:
            raise InputError(f"{with_article(self.name)} has no picture")
        panels[0].draw(axes, medium)

    def _repr_html_(self) -> str:
        """Its picture and a table of its main numbers and notes, as HTML without references to anything else; the table
        alone where matplotlib is missing."""
        rows = [*self.rows(), *(("note", note) for note in self.notes())]
        return (
            f"<div>{self._cell()}<div>{html_table(self.heading, rows)}</div></div>"
        )

    def _cell(self) -> str:
        """The first panels of its parts, or of its own pictures."""
        drawn = [part.pictures() for part in self.parts().values()]
        chosen: list[Panel] = []
        for pictures in drawn if any(drawn) else [self.pictures()]:
            for picture in list(pictures.values())[:1]:
                chosen += picture.panels[: picture.in_cell]
        if not chosen:
            return ""
        try:
            with drawn_as():
                figure, axes = panels(
                    _CELL_SIZE[0] * len(chosen), _CELL_SIZE[1], len(chosen), dpi=96
                )
                for plot, panel in zip(axes, chosen, strict=True):
                    panel.draw(plot, CELL)
                return png(figure, self.heading)
        except ImportError:
            return ""


R = TypeVar("R", bound=Record)


class OfRecord(Result, Generic[R]):
    """A result that is a :class:`Record`."""

    def __init__(self, record: R) -> None:
        self.record = record

    @property
    def name(self) -> str:
        return type(self.record).__name__

    @property
    def title(self) -> str:
        return repr(self.record)

    @property
    def approximation(self) -> str:
        return approximations_in_words(self.record.approximate)

    @property
    def plugins(self) -> Mapping[str, str]:
        return self.record.plugins

    def arrays(self) -> Rows:
        found = (
            self.record.measured.values()
            if isinstance(self.record, Observing)
            else ()
        )
        return [output.row() for output in found if output.numbers is None]

    def numbers(self) -> Data:
        fields = {
            name: f"array {value.shape} {value.dtype}"
            if isinstance(value, np.ndarray)
            else value
            for name, value in self.record.todict().items()
        }
        if isinstance(self.record, Observing):
            del fields["outputs"]
            fields["observables"] = {
                name: output.summary()
                for name, output in self.record.measured.items()
            }
        numbers = {
            name: value
            for one in self.quantities()
            for name, value in one.numbers().items()
        }
        return {"object": self.name, **jsonable({**numbers, **fields})}

    def notes(self) -> list[str]:
        return list(dict.fromkeys(getattr(self.record, "notes", ())))

    @property
    def _made(self) -> Fields:
        return getattr(self.record, "provenance", {})

    def cite(self) -> tuple[list[str], str]:
        version = self._made.get("versions", {}).get("chemage", "")
        return list(self._made.get("cite", [])), version

    def provenance(self) -> Rows:
        versions = self._made.get("versions", {})
        return [
            *((f"version of {name}", str(text)) for name, text in versions.items()),
            *super().provenance(),
            (f"content hash of {self.name}", self.record.digest()),
        ]


#: class of a result -> the class that shows it
_DISPLAYS: dict[type, Callable[[Any], Result]] = {}
D = TypeVar("D", bound=Callable[[Any], Result])


def displays(cls: type) -> Callable[[D], D]:
    """Say that the decorated class shows the objects of ``cls``: it is called with one of them. ::

    @displays(Grains)
    class GrainsResult(Result): ...
    """

    def registered(display: D) -> D:
        _DISPLAYS[cls] = display
        return display

    return registered


@displays(Record)
class RecordDisplay(OfRecord[Record]):
    """A record without a display of its own: its fields."""

    def facts(self) -> Rows:
        fields = {
            name: value
            for name, value in self.numbers().items()
            if name != "object"
        }
        return [
            *self.remarks(),
            *((name, str(value)) for name, value in fields.items()),
        ]


def _display_of(cls: type) -> Callable[[Any], Result] | None:
    """What shows objects of a class; the displays of a package are imported when one of its results is shown."""
    for base in cls.__mro__:
        package = base.__module__.rpartition(".")[0]
        if (
            base not in _DISPLAYS
            and hasattr(sys.modules.get(package), "__path__")
            and find_spec(f"{package}.display")
        ):
            import_module(f"{package}.display")
    if cls not in _DISPLAYS:
        import_module(
            f"chemage.{PICTURES}"
        )  # chemage's own kinds; what shows them is in rooms above this one
    return next(
        (_DISPLAYS[base] for base in cls.__mro__ if base in _DISPLAYS), None
    )


def is_result(thing: Any) -> bool:
    """Whether something can be shown."""
    return isinstance(thing, Result) or _display_of(type(thing)) is not None


def result_of(thing: Any) -> Result:
    """How something is shown.

    Raises
    ------
    InputError
        It is no result.
    """
    if isinstance(thing, Result):
        return thing
    if (display := _display_of(type(thing))) is not None:
        return display(thing)
    raise InputError(
        f"{with_article(type(thing).__name__)} is no result that can be shown"
    )


def drawn_picture(picture: Picture) -> Figure:
    """Draw a picture as it is in a file, in the current look."""
    count = len(picture.panels)
    with drawn_as():
        drawn, axes = plots(
            *picture.size, picture.columns or count, count, picture.dpi
        )
        for panel, plot in zip(picture.panels, axes, strict=True):
            panel.draw(plot, FILE)
        if picture.finish is not None:
            picture.finish(drawn, axes)
        if picture.title:
            drawn.suptitle(
                picture.title, parse_math=False
            )  # a dollar sign in a title is not a formula
        arrange(drawn)
    return drawn


def single_panels(
    pictures: Mapping[str, Picture], names: Sequence[str]
) -> dict[str, Picture]:
    """Pictures of one panel each: those called ``names``, or all of a picture with this name.

    Raises
    ------
    InputError
        There is no such panel.
    """
    every: dict[str, list[tuple[str, Picture]]] = {}
    for of, picture in pictures.items():
        rows = -(-len(picture.panels) // (picture.columns or len(picture.panels)))
        width = picture.size[0] * rows / len(picture.panels)
        height = picture.size[1] / rows
        for panel in picture.panels:
            name = of if panel.name in ("", of) else f"{of}-{panel.name}"
            alone = replace(
                picture, panels=(panel,), size=(width, height), columns=1
            )
            for called in dict.fromkeys((panel.name or of, name, of)):
                every.setdefault(called, []).append((name, alone))
    if missing := [name for name in names if name not in every]:
        known = ", ".join(
            dict.fromkeys(
                panel.name or of
                for of, one in pictures.items()
                for panel in one.panels
            )
        )
        problem = f"is no panel of this result{nearest(missing[0], list(every))}"
        raise InputError.of("panel", missing[0], problem, f"choose of {known}")
    return dict(entry for name in names for entry in every[name])


def draw_result(thing: Any, axes: Axes | None = None, **options: Any) -> Axes:
    """Draw the main plot of a result into ``axes``, or into a new figure of pyplot; return the axes."""
    shown = result_of(thing)
    if axes is None:
        (axes,) = _new_axes(1)
    shown.draw(axes, **options)
    return axes


def draw_parts(thing: Any, names: Sequence[str]) -> tuple[Axes, ...]:
    """Draw the parts of a result, or only those named, side by side in a figure of pyplot; return their axes.

    Raises
    ------
    InputError
        It has no such part.
    """
    shown = result_of(thing)
    parts = shown.parts()
    chosen = tuple(names) or tuple(parts)
    if missing := [name for name in chosen if name not in parts]:
        raise InputError(
            f"plot: {shown.name} has no {missing[0]!r}; it has {', '.join(parts)}"
        )
    axes = _new_axes(len(chosen))
    for plot, name in zip(axes, chosen, strict=True):
        parts[name].draw(plot)
    return tuple(axes)


def _new_axes(columns: int) -> list[Axes]:
    """The axes of a new figure of pyplot, which a notebook shows when its cell ends."""
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(5.2 * columns, 4.2), layout="constrained")
    return list(np.ravel(figure.subplots(1, columns)))


def notebook_html(thing: Any) -> str:
    """What the cell of a notebook shows of a result."""
    return result_of(thing)._repr_html_()
