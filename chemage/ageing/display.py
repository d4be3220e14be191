"""How an ageing curve is shown: its numbers, the fit of β, friction against hold time, and all of it beside others."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.ageing import Ageing, bond_errors, elastic_notes, fit_or_reason
from chemage.ageing.fitting import DROPS, FIT_WINDOW, Fit, Friction, fit_ageing
from chemage.contacts.solution import MEASURES
from chemage.foundation.errors import InputError
from chemage.foundation.figures import (
    BLUE,
    GREY,
    ORANGE,
    decades_only,
    from_zero,
    legend,
    plain,
)
from chemage.foundation.quantities import (
    HOLD_TIME,
    Curve,
    Quantity,
    by_name,
    headed,
)
from chemage.foundation.result import (
    FILE,
    Comparable,
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
)
from chemage.foundation.statistics import NORMAL_LIMIT, half_width
from chemage.foundation.text import jsonable, percent
from chemage.friction.role import Rupture
from chemage.surfaces.role import Scatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what the errors of replicas are
ON_ONE_SURFACE = (
    "95 % intervals over replicas on one surface, by Student's t, and of a contact by its own errors; they do not "
    "include the scatter between surfaces"
)
#: least distance, in decades, of the hold times between which a local slope is taken
SLOPE_SPAN = 0.5


class AgeingDisplay(OfRecord[Ageing]):
    """An ageing curve as users see it, with the line of β over ``window`` (first and last hold time, s)."""

    errors = ON_ONE_SURFACE

    def __init__(
        self,
        ageing: Ageing,
        window: tuple[float, float] = FIT_WINDOW,
        label: str = "",
    ) -> None:
        super().__init__(ageing)
        self.window = window
        #: in legends
        self.label = label

    @cached_property
    def fit(self) -> tuple[Fit | None, str]:
        """The line of Δμ, or why there is none."""
        return fit_or_reason(self.record, self.window)

    @property
    def scatter(self) -> Scatter | None:
        """How much β differs between surfaces of other seeds, where that is known."""
        return None

    def draw_published(self, axes: Axes) -> None:
        """Draw what was published of this result, where that is known."""

    def made_by(self) -> Mapping[str, Any]:
        return {"scene": {}, "ageing": self.record}

    # -- words and numbers --------------------------------------------------------------------------------------------

    def facts(self) -> Rows:
        ageing = self.record
        law = _with_parts(ageing.provenance.get(Rupture.role, {})) or (
            "mean force per bond"
            if ageing.rupture_force is None
            else "the force of the drive"
            if ageing.unfitted
            else "a plugin's"
        )
        facts = [
            ("temperature", f"{ageing.temperature:g} K"),
            ("grid of sites", ageing.site_grid),
            (
                "mean over",
                f"{ageing.replicas} replica{'s' if ageing.replicas > 1 else ''} on one surface",
            ),
            (
                "engine",
                f"{ageing.engine}{f' by ageing {ageing.method!r}' if ageing.method else ''}",
            ),
            ("rupture law", law),
            (
                "random numbers",
                ageing.random_numbers
                or ("none" if ageing.method else "not recorded"),
            ),
        ]
        if ageing.errors:
            facts.append(
                (
                    f"errors of the mean at {ageing.hold_times[-1]:g} s",
                    ageing.error_words,
                )
            )
        return facts

    def quantities(self) -> list[Quantity]:
        measures = [
            MEASURES[name].but(value=value)
            for name, value in self.record.contact.items()
            if name in MEASURES
        ]
        return [
            *(one for one in measures if one.known),
            *self.record.quantities(self.window),
        ]

    def curves(self) -> list[Curve]:
        return self.record.curves()

    def numbers(self) -> dict[str, Any]:
        numbers = super().numbers()
        for name in ("elasticity", "errors", "error_sources"):
            del numbers[name]
        return jsonable({**numbers, **bond_errors(self.record)})

    def notes(self) -> list[str]:
        fit = self.fit[0]
        of_fit = () if fit is None else fit.notes
        return list(
            dict.fromkeys(
                (*self.record.notes, *elastic_notes(self.record), *of_fit)
            )
        )

    # -- beside others ------------------------------------------------------------------------------------------------

    def comparable(self) -> Comparable:
        return Comparable(
            self._chemistry(),
            self.record.load,
            self.window,
            self._fit_like,
            self._draw_beside,
        )

    def _draw_beside(self, axes: Axes, label: str, color: str) -> None:
        """Draw the fit into a figure of several results, and what was published into that of one."""
        draw_fit(axes, self.fit[0], label, *([color] if color else []))
        if not label:
            self.draw_published(axes)

    def _fit_like(self, model: Any, window: Any, quantity: Any) -> Fit | str:
        """A model fitted to this curve as it is to measurements, or why it cannot be."""
        try:
            return fit_ageing(
                self.record, model=model, window=window, quantity=quantity
            )
        except InputError as error:
            return str(error)

    def _chemistry(self) -> dict[str, Any]:
        whole = dict(self.record.provenance.get("chemistry", {}))
        parts = {
            name: whole.pop(name, None)
            for name in ("forming", "breaking", "interaction")
        }
        return {**parts, "chemistry": whole, "temperature": self.record.temperature}

    # -- pictures -----------------------------------------------------------------------------------------------------

    @property
    def quantity(self) -> Friction:
        """What is drawn: Δμ, or without load ΔF."""
        return (
            "friction_coefficient_drop" if self.record.load > 0 else "friction_drop"
        )

    def pictures(self) -> dict[str, Picture]:
        """Friction against hold time, and beside it its slope from hold time to hold time, which β averages."""
        times = self.record.hold_times[self.record.hold_times > 0]
        several = np.unique(times).size > 1
        if not times.size:
            return {}
        drawn = (
            Panel(self.draw, name="friction"),
            *([Panel(self._draw_local_slope, name="slope")] if several else []),
        )
        return {
            "friction": Picture(
                drawn, (10.5 if several else 5.6, 4.2), finish=_finish
            )
        }

    def draw(
        self,
        axes: Axes,
        medium: Medium = FILE,
        *,
        quantity: Friction | None = None,
        fit: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> None:
        """Draw friction against hold time with its 95 % intervals, the fitted line and published values."""
        chosen: Friction = quantity or self.quantity
        named = plain(
            ", ".join(filter(None, (label or self.label, self.record.over)))
        )
        drawn, curve = (
            self.record.hold_times > 0,
            by_name(self.curves()).get(chosen),
        )
        if curve is None or not drawn.any():
            reason = (
                "undefined: no load" if curve is None else "no hold time above 0"
            )
            axes.text(
                0.5, 0.5, reason, transform=axes.transAxes, ha="center", color=GREY
            )
        else:
            _errorbars(
                axes,
                curve.x[drawn],
                curve.mean[drawn],
                curve.half_width[drawn],
                color or BLUE,
                named,
            )
        axes.set(xscale="log", xlabel=HOLD_TIME.axis, ylabel=DROPS[chosen].axis)
        from_zero(axes)
        if fit and chosen == "friction_coefficient_drop":
            draw_fit(axes, self.fit[0])
            self.draw_published(axes)
        legend(axes)

    def _draw_local_slope(self, axes: Axes, medium: Medium) -> None:
        """Draw the mean slope per decade over half a decade or more about each time, with 95 % intervals over replicas;
        and that of the fit."""
        ageing = self.record
        drawn = ageing.hold_times > 0
        times, first = np.unique(
            np.log10(ageing.hold_times[drawn]), return_index=True
        )
        values = (
            ageing.friction_coefficient_drop
            if ageing.load > 0
            else ageing.friction_drop
        )
        values = values[:, drawn][:, first]
        ends = [
            (low, int(np.searchsorted(times, start + SLOPE_SPAN - 1e-9)))
            for low, start in enumerate(times)
        ]
        low, high = np.array(
            [(low, high) for low, high in ends if high < times.size]
            or [(0, times.size - 1)]
        ).T
        slopes = (values[:, high] - values[:, low]) / (times[high] - times[low])
        middle = 10 ** (0.5 * (times[low] + times[high]))
        _errorbars(
            axes, middle, slopes.mean(axis=0), half_width(slopes), BLUE, ageing.over
        )
        drop = DROPS[self.quantity]
        axes.set(xscale="log", xlabel=HOLD_TIME.axis)
        axes.set_ylabel(
            headed(f"slope d{drop.symbol}/dlog$_{{10}}$t per decade", drop.unit)
        )
        if self.fit[0] is not None and ageing.load > 0:
            fit = self.fit[0]
            axes.plot(
                fit.span,
                [fit.beta] * 2,
                color=ORANGE,
                lw=1.6,
                zorder=3,
                label="β of the fitted line",
            )
            scatter = self.scatter.relative if self.scatter is not None else None
            if scatter and fit.beta != 0 and not scatter <= fit.relative_stderr:
                half = NORMAL_LIMIT * scatter * abs(fit.beta)
                label = f"β of other surfaces, 95 % (± {percent(NORMAL_LIMIT * scatter)})"
                axes.fill_between(
                    fit.span,
                    fit.beta - half,
                    fit.beta + half,
                    color=ORANGE,
                    alpha=0.2,
                    lw=0,
                    label=label,
                )
        legend(axes)


def draw_fit(
    axes: Axes, fit: Fit | None, label: str = "", color: str = ORANGE
) -> None:
    """Draw the fitted line over the hold times that it is fitted to, by default with β and what was fitted in the
    legend; nothing without a fit."""
    if fit is None or not fit.drawable:
        return
    line = np.geomspace(*fit.span, 50)
    axes.plot(
        line,
        fit(line),
        color=color,
        lw=1.6,
        zorder=3,
        label=label or plain(fit.short_text()),
    )


def _with_parts(component: Mapping[str, Any]) -> str:
    """The kind of a component, as stored, with those of the components inside it; "" of none."""
    parts = [
        f"{name} {_with_parts(option)}"
        for name, option in component.items()
        if isinstance(option, Mapping) and "kind" in option
    ]
    kind = component.get("kind", "")
    return f"{kind} ({', '.join(parts)})" if parts else kind


def _finish(figure: Any, plots: list[Axes]) -> None:
    plots[-1].set_xlim(plots[0].get_xlim())
    for axes in plots:
        decades_only(axes.xaxis)


def _errorbars(
    axes: Axes,
    t: np.ndarray,
    mean: np.ndarray,
    error: np.ndarray,
    colour: str,
    label: str,
) -> None:
    bars = np.nan_to_num(error) if np.isfinite(error).any() else None
    axes.errorbar(
        t,
        mean,
        yerr=bars,
        color=colour,
        marker="o",
        ms=3.5,
        lw=1,
        capsize=2,
        label=label or None,
    )
