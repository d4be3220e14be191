"""Results in notebooks: the methods ``plot``, and the picture and table that a cell shows of a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.elasticity import elastic_notes
from chemage.ageing.fitting import Fit, Quantity
from chemage.contacts.options import force_text, pressure_text
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.approximations import in_words, merged
from chemage.foundation.errors import InputError
from chemage.foundation.text import html_table, mean_text
from chemage.kinetics.history import BondHistory
from chemage.results import ensemble_figure, ensemble_text
from chemage.results.figures import BLUE, draw_fit, legend, panels, plain, png, replicas_text
from chemage.results.run_figures import draw_friction, draw_heights, draw_pressure
from chemage.scene.run import Run
from chemage.scene.scene import heading
from chemage.studies.ensembles.ensemble import Ensemble
from chemage.surfaces.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = list[tuple[str, str]]
#: blocks of pixels along a side of a map in a cell: the page of a notebook holds every picture
CELL_PIXELS = 160
#: inches of each panel
_SIZE = (3.7, 3.1)
#: surfaces of more pixels show no slope that is not known yet: its spectrum takes longer than the picture
_MOST_PIXELS = 2**22


# -- plot -------------------------------------------------------------------------------------------------------------


def draw(thing: Any, *arguments: Any, **options: Any) -> Any:
    """Draw a result: what its method ``plot`` does."""
    if isinstance(thing, Run):
        return _draw_run(thing, arguments)
    (axes,) = arguments
    if axes is None:
        (axes,) = _new_axes(1)
    _into(axes, thing, **options)
    return axes


def _new_axes(columns: int) -> list[Axes]:
    """The axes of a new figure of pyplot, which a notebook shows when its cell ends."""
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(5.2 * columns, 4.2), layout="constrained")
    return list(np.ravel(figure.subplots(1, columns)))


def _draw_run(run: Run, what: Iterable[str]) -> tuple[Axes, ...]:
    parts = _parts(run)
    chosen = tuple(what) or tuple(parts)
    if missing := [name for name in chosen if name not in parts]:
        raise InputError(f"plot: {run.name} has no {missing[0]!r}; it has {', '.join(parts)}")
    axes = _new_axes(len(chosen))
    for one, name in zip(axes, chosen, strict=True):
        _into(one, parts[name], **({"window": run.window} if name == "aging" else {}))
    return tuple(axes)


def _parts(run: Run) -> dict[str, Any]:
    parts = {"surface": run.surface, "contact": run.contact, "aging": run.aging}
    return {name: part for name, part in parts.items() if part is not None}


def _into(axes: Axes, thing: Any, **options: Any) -> None:
    for cls, (function, _) in SHOWN.items():
        if isinstance(thing, cls):
            function(axes, thing, **options)
            return
    raise InputError(f"a {type(thing).__name__} has no picture")


def _draw_aging(
    axes: Axes,
    aging: Aging,
    quantity: Quantity | None = None,
    fit: bool = True,
    window: tuple[float, float] | None = None,
    color: str | None = None,
    label: str = "",
) -> None:
    chosen: Quantity = quantity or ("friction_coefficient_drop" if aging.load > 0 else "friction_drop")
    named = ", ".join(filter(None, (label, replicas_text(aging))))
    draw_friction(axes, aging, chosen, color or BLUE, plain(named))
    made = _fit(aging, window)
    if fit and made is not None and chosen == "friction_coefficient_drop":
        draw_fit(axes, made)
    legend(axes, fontsize=8)


def _draw_statistics(axes: Axes, contact: ContactStatistics) -> None:
    above = np.cumsum(contact.area[::-1])[::-1]
    axes.step(np.append(0.0, contact.pressure), np.append(above, 0.0), where="post", color=BLUE)
    axes.set(xlabel="pressure (GPa)", ylabel="contact area above it (nm$^2$)")
    axes.set_title(f"A/A$_0$ = {contact.area_fraction:.3g}")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)


def _draw_history(axes: Axes, history: BondHistory) -> None:
    shown = history.hold_times > 0
    axes.plot(history.hold_times[shown], history.bonds[shown], color=BLUE, marker="o", ms=3.5, lw=1)
    axes.set(xscale="log", xlabel="hold time (s)", ylabel="bonds")
    axes.set_ylim(bottom=0)


# -- cells of notebooks -----------------------------------------------------------------------------------------------


def html(thing: Any) -> str:
    """The picture of a result and a table of its main numbers; the table alone where matplotlib is missing."""
    parts = list(_parts(thing).values()) if isinstance(thing, Run) else [thing]
    rows = _run_rows(thing) if isinstance(thing, Run) else _rows(thing)
    title = heading(thing.scene) if isinstance(thing, Run) else repr(thing)
    if isinstance(thing, Ensemble):
        title = f"{thing.title}: {ensemble_text.TITLE}"
    return f"<div>{_picture(parts, title)}<div>{html_table(title, rows)}</div></div>"


def _picture(parts: list[Any], title: str) -> str:
    try:
        if isinstance(parts[0], Ensemble):
            return png(ensemble_figure.ensemble_figure(parts[0], dpi=80), title)
        figure, axes = panels(_SIZE[0] * len(parts), _SIZE[1], len(parts), dpi=96)
    except ImportError:
        return ""
    for one, part in zip(axes, parts, strict=True):
        options: dict[str, Any] = {"most": CELL_PIXELS} if isinstance(part, Surface | ContactSolution) else {}
        if isinstance(part, Surface):
            options["title"] = False  # the table has it
        _into(one, part, **options)
        one.title.set_fontsize(9)
        if (legend := one.get_legend()) is not None:
            for text in legend.get_texts():
                text.set_fontsize(7)
    return png(figure, title)


def _rows(thing: Any) -> Rows:
    return next(rows(thing) for cls, (_, rows) in SHOWN.items() if isinstance(thing, cls))


def _run_rows(run: Run) -> Rows:
    rows = [row for part in _parts(run).values() if not isinstance(part, Aging) for row in _rows(part)]
    if run.aging is not None:
        rows += _aging_rows(run.aging, run.window)
    if run.approximate:
        rows.append(("approximate", run.approximate))
    return [*dict.fromkeys(rows), *(("note", note) for note in run.notes)]


def _surface_rows(surface: Surface) -> Rows:
    nx, ny = surface.shape
    side = surface.pixel_size
    rows = [
        ("surface", f"{nx} x {ny} pixels of {side:g} nm, {nx * side:.5g} nm x {ny * side:.5g} nm"),
        ("rms height", f"{surface.rms_height:.4g} nm"),
    ]
    if surface.heights.size <= _MOST_PIXELS or "rms_slope" in vars(surface):
        rows.append(("rms slope", f"{surface.rms_slope:.4g}"))
    return [*rows, ("periodic", "yes" if surface.periodic else "no")]


def _contact_rows(contact: ContactSolution) -> Rows:
    rows = [
        *_load_rows(contact),
        ("contact area", f"{contact.area:.5g} nm², {contact.area_fraction:.4g} of the nominal area"),
        ("patches", str(contact.patches)),
        ("mean and largest pressure", f"{contact.mean_contact_pressure:.4g} GPa, {contact.max_pressure:.4g} GPa"),
    ]
    if math.isfinite(contact.kappa):
        rows.append(("κ = A h'_rms E* / F_N", f"{contact.kappa:.4g}"))
    if not contact.converged:
        rows.append(("converged", f"NO: residual {contact.residual:.3g} after {contact.iterations} iterations"))
    return rows + _remarks(contact)


def _statistics_rows(contact: ContactStatistics) -> Rows:
    area = f"{contact.contact_area:.5g} nm², {contact.area_fraction:.4g} of the nominal area"
    mean = f"{contact.mean_contact_pressure:.4g} GPa"
    return [*_load_rows(contact), ("contact area", area), ("mean pressure", mean), *_remarks(contact)]


def _load_rows(contact: ContactSolution | ContactStatistics) -> Rows:
    return [
        ("load", f"{force_text(contact.load)}, {pressure_text(contact.nominal_pressure)} over the nominal area"),
        ("contact modulus E*", f"{contact.modulus:.6g} GPa"),
    ]


def _history_rows(history: BondHistory) -> Rows:
    return [
        ("sites", str(history.state.size)),
        (f"bonds at {history.time:g} s", str(int(history.bonds[-1]))),
        ("formed and broken so far", f"{int(history.formed[-1])}, {int(history.broken[-1])}"),
        ("temperature", f"{history.temperature:g} K"),
        ("engine", history.engine),
        *_remarks(history),
    ]


def _fit(aging: Aging, window: tuple[float, float] | None) -> Fit | None:
    try:
        return aging.fit(*window) if window is not None else aging.fit()
    except InputError:
        return None


def _aging_rows(aging: Aging, window: tuple[float, float] | None = None) -> Rows:
    last = f"at {aging.hold_times[-1]:g} s"
    rows = [
        ("temperature, load", f"{aging.temperature:g} K, {force_text(aging.load)}"),
        ("sites", f"{aging.sites[0]:.6g}" if np.ptp(aging.sites) == 0 else mean_text(aging.sites)),
        ("replicas", f"{aging.replicas}" + (": there is no error" if aging.replicas == 1 else "")),
        (f"bonds {last}", mean_text(aging.bonds[:, -1])),
        (f"friction drop ΔF {last}", mean_text(aging.friction_drop[:, -1], "nN")),
        (f"friction coefficient drop Δμ {last}", mean_text(aging.friction_coefficient_drop[:, -1])),
    ]
    if (fit := _fit(aging, window)) is not None and math.isfinite(fit.beta):
        rows.append((f"β from {fit.span[0]:g} s to {fit.span[1]:g} s", f"{fit.beta_text()} per decade"))
        rows.append(("cut-off time", fit.cutoff_text()))
    if aging.errors:
        rows.append((f"further errors {last}", aging.error_words))
    rows += [("method, engine", ", ".join(filter(None, (aging.method, aging.engine))))]
    return rows + [("observable " + name, one.text()) for name, one in aging.measured.items()]


def _all_aging_rows(aging: Aging) -> Rows:
    notes = dict.fromkeys((*aging.notes, *elastic_notes(aging)))
    return _aging_rows(aging) + _approximate(aging) + [("note", note) for note in notes]


def _approximate(thing: Any) -> Rows:
    words = in_words(merged(thing.approximate))
    return [("approximate", words)] if words else []


def _remarks(thing: Any) -> Rows:
    return _approximate(thing) + [("note", note) for note in thing.notes]


def _ensemble_rows(made: Ensemble) -> Rows:
    return ensemble_text.rows(made) + [("note", note) for note in made.notes]


#: class -> function that draws it into axes, function that lists its main numbers
SHOWN: dict[type[Any], tuple[Callable[..., None], Callable[[Any], Rows]]] = {
    Surface: (draw_heights, _surface_rows),
    ContactSolution: (draw_pressure, _contact_rows),
    ContactStatistics: (_draw_statistics, _statistics_rows),
    BondHistory: (_draw_history, _history_rows),
    Aging: (_draw_aging, _all_aging_rows),
    Ensemble: (ensemble_figure.draw, _ensemble_rows),
}
