"""How an ageing curve is shown: its numbers, the fit of β, friction against hold time, and all of it beside others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.ageing.age import BARRIERS, barriers_error, beta_errors
from chemage.ageing.aging import ELASTIC_MEASURES, Aging, elastic_measures, elastic_notes, elastic_rows, fit_or_reason
from chemage.ageing.fitting import FIT_WINDOW, SYMBOL, UNIT, Fit, Quantity, fit_aging, span_text
from chemage.contacts.display import compared_measures, main_measures
from chemage.contacts.options import force_text
from chemage.foundation.errors import InputError
from chemage.foundation.figures import BLUE, GREY, ORANGE, decades_only, from_zero, legend, plain
from chemage.foundation.result import (
    FILE,
    NONE,
    Compared,
    Curve,
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    Table,
)
from chemage.foundation.statistics import NORMAL_LIMIT, half_width, standard_error
from chemage.foundation.text import jsonable, mean_text, percent, plus_minus, power_text
from chemage.surfaces.role import Scatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what the errors of replicas are
ON_ONE_SURFACE = (
    "95 % intervals over replicas on one surface (Student's t); they do not include the scatter between surfaces"
)
#: least distance, in decades, of the hold times between which a local slope is taken
SLOPE_SPAN = 0.5
#: hold times at which results are compared, s, besides the last
TIMES = (1.0, 1e3)
#: curves that are compared: name -> (label, unit in tables, unit in CSV)
CURVES = {
    "friction_drop": ("friction drop ΔF", "nN", "nN"),
    "friction_coefficient_drop": ("friction coefficient drop Δμ", "", ""),
    "bonds_per_area": ("bonds per contact area", "1/nm²", "1/nm^2"),
    "bonded_fraction": ("fraction of sites bonded", "", ""),
}
#: figures of curves: name of the curve -> (name, in words, unit in words, label of the axis, caption)
FIGURES = {
    "friction_coefficient_drop": (
        "friction-coefficient-drop",
        "Friction coefficient drop",
        "",
        f"friction coefficient drop {SYMBOL['friction_coefficient_drop']}",
        "Friction coefficient drop Δμ against hold time, means and 95 % intervals.",
    ),
    "friction_drop": (
        "friction-drop",
        "Friction drop",
        ", in nN",
        f"friction drop {SYMBOL['friction_drop']} (nN)",
        "Friction drop ΔF against hold time, means and 95 % intervals.",
    ),
    "bonds_per_area": (
        "bonds-per-area",
        "Bonds per contact area",
        ", per square nanometre",
        "bonds per contact area (1/nm²)",
        "Bonds per contact area against hold time.",
    ),
}
#: rows about the limits of the elastic model: name of the measure -> label
_ELASTIC = {
    "hardness": "hardness",
    "area_above_hardness": "share of area above the hardness",
    "load_above_hardness": "share of load above the hardness",
    "mean_shear_stress": "mean shear stress at the last hold time",
    "shear_strength": "shear strength",
    "shear_stress_to_strength": "mean shear stress over shear strength",
    "work_of_adhesion": "work of adhesion",
    "pull_off_to_load": "pull-off force over the load",
}


class AgingDisplay(OfRecord[Aging]):
    """An ageing curve as users see it, with the line of β over ``window`` (first and last hold time, s)."""

    errors = ON_ONE_SURFACE

    def __init__(self, aging: Aging, window: tuple[float, float] = FIT_WINDOW, label: str = "") -> None:
        super().__init__(aging)
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
        return {"scene": {}, "aging": self.record}

    # -- words and numbers --------------------------------------------------------------------------------------------

    def rows(self) -> Rows:
        aging = self.record
        conditions = ("temperature, load", f"{aging.temperature:g} K, {force_text(aging.load)}")
        return [conditions, *self.ageing_rows(), *self.remarks()]

    def ageing_rows(self) -> Rows:
        """The rows without conditions and remarks."""
        aging, last = self.record, f"at {self.record.hold_times[-1]:g} s"
        rows = [
            ("sites", f"{aging.sites.mean():.0f}, {aging.site_grid}"),
            ("engine", _kinetics(aging)),
            ("rupture law", aging.rupture or ("mean force per bond" if aging.rupture_force is None else "a plugin's")),
            ("random numbers", aging.random_numbers or ("none" if aging.method else "not recorded")),
            (f"friction drop {last}", mean_text(aging.friction_drop[:, -1], "nN")),
            (f"friction coefficient drop {last}", mean_text(aging.friction_coefficient_drop[:, -1])),
        ]
        if aging.errors:
            rows.append((f"errors of the mean {last}", aging.error_words))
        return rows + elastic_rows(aging) + self.recorded(last) + self._fit_rows()

    def _fit_rows(self) -> Rows:
        fit, reason = self.fit
        if fit is None:
            return [("beta", f"not fitted: {reason}"), ("cut-off time", "not fitted")]
        over = f"{fit.points} hold times from {fit.span[0]:g} to {fit.span[1]:g} s"
        scatter = self.scatter
        alone = scatter is not None and scatter.relative == 0
        more = "" if alone else ": disorder and noise on this surface; scatter between surfaces is not included"
        rows = [
            ("beta", f"{fit.beta_text()} per decade, {over}"),
            ("b = beta/ln 10", f"{fit.b_text()} per e-fold"),
            ("cut-off time", fit.cutoff_text()),
            ("errors", f"95 %, {fit.intervals_text()}{more}"),
        ]
        if scatter is not None and not alone:
            rows.append(("surfaces", scatter.text(fit.relative_stderr)))
        beside = "" if fit.replicas == 1 else ", beside the interval above"
        sizes = dict(beta_errors(self.record, self.window))
        if (barriers := barriers_error(self.record, self.window)) is not None:
            sizes[BARRIERS] = barriers
        text = "error of beta: {}"
        return rows + [(text.format(name), f"{percent(size)} (standard error){beside}") for name, size in sizes.items()]

    def numbers(self) -> dict[str, Any]:
        aging, numbers = self.record, super().numbers()
        for name in ("elasticity", "errors", "error_sources"):
            del numbers[name]
        if aging.errors:
            numbers["bond_errors"] = {name: error.tolist() for name, error in aging.errors.items()}
            numbers["bond_error_sources"] = aging.error_sources
        return jsonable({**numbers, **elastic_measures(aging)})

    def notes(self) -> list[str]:
        fit = self.fit[0]
        doubt = [fit.doubt] if fit is not None and fit.doubt else []
        return list(dict.fromkeys((*self.record.notes, *elastic_notes(self.record), *doubt)))

    def summary(self, beside: bool = False) -> Rows:
        aging, (fit, _) = self.record, self.fit
        inside = [time for time in TIMES if aging.hold_times[0] <= time <= aging.hold_times[-1]]
        time = inside[-1] if inside else float(aging.hold_times[-1])
        sure = "95 % interval" if aging.replicas > 1 else "one replica: no error"
        sure += ", replicas on one surface" if beside and aging.replicas > 1 else ""
        curves, symbol, unit = aging.friction_drop, "ΔF", "nN"
        if aging.load > 0:
            curves, symbol, unit = aging.friction_coefficient_drop, "Δμ", ""
        rows = [(mean_text(at(aging.hold_times, curves, time), unit), f"{symbol} at {power_text(time)} s, {sure}")]
        if fit is not None and math.isfinite(fit.beta):
            half = fit.beta_half_width if math.isfinite(fit.beta_interval.low) else math.nan
            rows.append((plus_minus(fit.beta, half), f"β per decade, line fitted {span_text(fit.span)}, {sure}"))
        return rows + main_measures(aging.contact, ages=True)

    def tables(self) -> list[Table]:
        aging, bonds = self.record, self.curves_of()
        rows = []
        for number, time in enumerate(aging.hold_times):
            cells = [mean_text(values[:, number]) if values.size else NONE for values in bonds.values()]
            rows.append((f"{time:.6g}", *cells))
        columns = ["hold time (s)", "ΔF (nN)", "Δμ", "bonds per contact area (1/nm²)", "fraction of sites bonded"]
        title = f"Means over {aging.replicas} replicas with 95 % intervals (Student's t)"
        if aging.replicas == 1:
            title = "One replica: there is no error"
        if aging.errors:
            title += f". Errors of the mean at the last hold time: {aging.error_words}"
        return [Table(title, columns, rows, "Friction against hold time")]

    def columns(self) -> dict[str, Any]:
        units = {"hold_time": "s", "friction_drop": "nN"} | {
            f"observable.{name}": output.unit for name, output in self.record.measured.items()
        }
        columns: dict[str, Any] = {}
        for name, values in self.record.columns().items():
            unit = units.get(name.removesuffix("_stderr").removesuffix("_half_width"))
            columns[f"{name} ({unit})" if unit else name] = values
        return columns

    # -- beside others ------------------------------------------------------------------------------------------------

    def curves_of(self) -> dict[str, np.ndarray]:
        """Those of :data:`CURVES`, (replicas, m); (1, 0) where one is not known."""
        aging = self.record
        nothing = np.full((1, 0), np.nan)
        with np.errstate(invalid="ignore"):
            return {
                "friction_drop": aging.friction_drop,
                "friction_coefficient_drop": aging.friction_coefficient_drop,
                "bonds_per_area": aging.bonds / aging.site_area if aging.site_area > 0 else nothing,
                "bonded_fraction": aging.bonds / aging.sites[:, None],
            }

    def compared(self, times: Sequence[float]) -> Compared:
        aging, (fit, _) = self.record, self.fit
        joined = compared_measures(aging.contact)
        last = float(aging.hold_times[-1])
        replicas = f"{aging.replicas} replica{'s' if aging.replicas > 1 else ''}"
        joined.rows |= {
            "load": force_text(aging.load),
            "sites": f"{aging.sites.mean():.5g}",
            "grid of sites": aging.site_grid,
            "replicas": str(aging.replicas),
        }
        joined.rows |= {"mean over": f"{replicas} on one surface", "every ± is": _meaning(aging)}
        joined.only_beside = ("mean over", "every ± is", "standard errors of β")
        moments = [(time, f"{time:g} s", time) for time in times] + [(last, "the last hold time", None)]
        for name, (label, unit, _) in CURVES.items():
            for time, words, _ in moments:
                joined.rows[f"{label} at {words}"] = mean_text(at(aging.hold_times, self.curves_of()[name], time), unit)
        elastic = elastic_measures(aging)
        self._add_details(joined, elastic, moments)
        joined.rows |= {
            "last hold time": f"{last:.5g} s",
            "hold times of the fit": self._fitted_over(),
            "β, 95 % interval": self._beta_text(),
            "cut-off time, 95 % interval": fit.cutoff_text() if fit else "not fitted",
        }
        joined.rows["standard errors of β"] = (
            f"replicas on one surface: {percent(fit.relative_stderr)}"
            if fit is not None and fit.relative_stderr > 0
            else NONE
        )
        if (scatter := self.scatter) is not None:
            joined.rows["scatter of β between surfaces"] = (
                NONE if fit is None else scatter.text(fit.relative_stderr) or "one surface"
            )
        joined.numbers |= self._compared_numbers(elastic)
        for time, _, chosen in moments:
            joined.at.append({"time": time, **self._numbers_at(time, chosen)})
        joined.units |= {"fit_start": "s", "fit_stop": "s", "fit_first": "s", "fit_last": "s", "last": "s"}
        joined.units |= {"cutoff_time": "s", "cutoff_time_low": "s", "cutoff_time_high": "s"}
        joined.units |= {name: unit for name, (_, _, unit) in CURVES.items() if unit}
        joined.units |= {name: unit for name, (unit, _) in ELASTIC_MEASURES.items() if unit != "1"}
        joined.units |= {f"observable.{name}": output.unit for name, output in aging.measured.items() if output.unit}
        joined.curves, joined.load, joined.window, joined.fit = self._curves(), aging.load, self.window, self._fit_like
        joined.chemistry = self._chemistry()
        return joined

    def _add_details(self, joined: Compared, elastic: Mapping[str, float], moments: Sequence[tuple[Any, ...]]) -> None:
        """Rows of errors, limits of the elastic model, and what observables measured."""
        aging = self.record
        if aging.error_words:
            joined.rows["further errors of the mean"] = aging.error_words
        for name, value in elastic.items():
            unit = "" if ELASTIC_MEASURES[name][0] == "1" else ELASTIC_MEASURES[name][0]
            joined.rows[_ELASTIC[name]] = f"{value:.5g} {unit}".strip()
        for output in aging.measured.values():
            if output.is_number:
                joined.rows[output.words] = output.text()
            elif output.is_curve:
                for time, words, chosen in moments:
                    values = output.values[:, -1] if chosen is None else at(aging.hold_times, output.values, time)
                    joined.rows[f"{output.words} at {words}"] = mean_text(values, output.unit)

    def _compared_numbers(self, elastic: Mapping[str, float]) -> dict[str, Any]:
        aging, (fit, reason), scatter = self.record, self.fit, self.scatter
        numbers: dict[str, Any] = {
            "load": aging.load,
            "sites": float(aging.sites.mean()),
            "site_grid": aging.site_grid,
            "replicas": aging.replicas,
            "surfaces": 1,
            "interval_over": "replicas on one surface",
            **({"further_errors": aging.error_words} if aging.error_words else {}),
            "fit_window": list(self.window),
            "fit_range": list(fit.span) if fit else None,
            "beta": fit.beta if fit else None,
            "beta_reason": reason or None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "beta_interval": [fit.beta_interval.low, fit.beta_interval.high] if fit else None,
            "b": fit.b if fit else None,
            "b_stderr": fit.b_stderr if fit else None,
            "b_interval": [fit.b_interval.low, fit.b_interval.high] if fit else None,
            "beta_scatter_between_surfaces": scatter.relative if scatter else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "cutoff_time_interval": [fit.cutoff_interval.low, fit.cutoff_interval.high] if fit else None,
            **elastic,
        }
        for name, output in aging.measured.items():
            if output.is_number:
                numbers |= _with_errors(f"observable.{name}", output.values)
        return numbers

    def _numbers_at(self, time: float, chosen: float | None) -> dict[str, float]:
        aging, numbers = self.record, {}
        for name, values in self.curves_of().items():
            numbers |= _with_errors(name, at(aging.hold_times, values, time))
        for name, output in aging.measured.items():
            if output.is_curve and output.numbers is not None:
                values = output.numbers if chosen is None else at(aging.hold_times, output.values, time)
                numbers |= _with_errors(f"observable.{name}", values)
        return numbers

    def _fitted_over(self) -> str:
        """The first and the last hold time of the fit, and whether they are too few."""
        fit = self.fit[0]
        return NONE if fit is None else "{:g} to {:g} s".format(*fit.span) + (f"; {fit.doubt}" if fit.doubt else "")

    def _beta_text(self) -> str:
        fit, reason = self.fit
        return f"not fitted: {reason}" if fit is None else f"{fit.beta_text()}; b = {fit.b_text()}"

    def _curves(self) -> dict[str, Curve]:
        aging, curves = self.record, {}
        for name, (figure, words, unit, label, caption) in FIGURES.items():
            values = self.curves_of()[name]
            if not np.isfinite(values).any():
                continue
            beside = self._draw_beside if name == "friction_coefficient_drop" else None
            mean = values.mean(axis=0)
            numbers = aging.hold_times, mean, half_width(values)
            curves[figure] = Curve(
                words,
                unit,
                "hold time (s)",
                label,
                caption,
                *numbers,
                replicas_text(aging),
                beside=beside,
                samples=(values,) if aging.replicas > 1 else (),
                known=aging.stated_error * mean,
            )
        return curves

    def _draw_beside(self, axes: Axes, label: str, color: str) -> None:
        """Draw the fit into a figure of several results, and what was published into that of one."""
        draw_fit(axes, self.fit[0], label, *([color] if color else []))
        if not label:
            self.draw_published(axes)

    def _fit_like(self, model: Any, window: Any, quantity: Any) -> Fit | str:
        """A model fitted to this curve as it is to measurements, or why it cannot be."""
        try:
            return fit_aging(self.record, model=model, window=window, quantity=quantity)
        except InputError as error:
            return str(error)

    def _chemistry(self) -> dict[str, Any]:
        whole = dict(self.record.provenance.get("chemistry", {}))
        parts = {name: whole.pop(name, None) for name in ("forming", "breaking", "interaction")}
        return {**parts, "chemistry": whole, "temperature": self.record.temperature}

    # -- pictures -----------------------------------------------------------------------------------------------------

    @property
    def quantity(self) -> Quantity:
        """What is drawn: Δμ, or without load ΔF."""
        return "friction_coefficient_drop" if self.record.load > 0 else "friction_drop"

    def pictures(self) -> dict[str, Picture]:
        """Friction against hold time, and beside it its slope from hold time to hold time, which β averages."""
        times = self.record.hold_times[self.record.hold_times > 0]
        several = np.unique(times).size > 1
        if not times.size:
            return {}
        drawn = (Panel(self.draw, name="friction"), *([Panel(self._draw_local_slope, name="slope")] if several else []))
        return {"friction": Picture(drawn, (10.5 if several else 5.6, 4.2), finish=_finish)}

    def draw(
        self,
        axes: Axes,
        medium: Medium = FILE,
        *,
        quantity: Quantity | None = None,
        fit: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> None:
        """Draw friction against hold time with its 95 % intervals, the fitted line and published values."""
        chosen: Quantity = quantity or self.quantity
        named = ", ".join(filter(None, (label or self.label, replicas_text(self.record))))
        draw_friction(axes, self.record, chosen, color or BLUE, plain(named))
        if fit and chosen == "friction_coefficient_drop":
            draw_fit(axes, self.fit[0])
            self.draw_published(axes)
        legend(axes)

    def _draw_local_slope(self, axes: Axes, medium: Medium) -> None:
        draw_local_slope(axes, self.record, self.quantity, label=replicas_text(self.record))
        if self.fit[0] is not None and self.record.load > 0:
            fit = self.fit[0]
            axes.plot(fit.span, [fit.beta] * 2, color=ORANGE, lw=1.6, zorder=3, label="β of the fitted line")
            scatter = self.scatter.relative if self.scatter is not None else None
            if scatter and fit.beta != 0 and not scatter <= fit.relative_stderr:
                half = NORMAL_LIMIT * scatter * abs(fit.beta)
                label = f"β of other surfaces, 95 % (± {percent(NORMAL_LIMIT * scatter)})"
                axes.fill_between(
                    fit.span, fit.beta - half, fit.beta + half, color=ORANGE, alpha=0.2, lw=0, label=label
                )
        legend(axes)


def at(hold_times: np.ndarray, curves: np.ndarray, time: float) -> np.ndarray:
    """(replicas,) values of ``curves`` (replicas, m) at ``time`` (s).

    Interpolates linearly in log t between hold times; nan outside them.
    """
    if not curves.size:
        return np.full(1, np.nan)
    same = np.flatnonzero(np.abs(hold_times - time) <= 1e-6 * time)
    if same.size:
        return curves[:, same[-1]]
    after = int(np.searchsorted(hold_times, time))
    if not 0 < after < hold_times.size or hold_times[after - 1] <= 0:
        return np.full(len(curves), np.nan)
    part = math.log(time / hold_times[after - 1]) / math.log(hold_times[after] / hold_times[after - 1])
    return curves[:, after - 1] * (1 - part) + curves[:, after] * part


def _with_errors(name: str, values: np.ndarray) -> dict[str, float]:
    return {
        name: float(values.mean()),
        f"{name}_stderr": float(standard_error(values)),
        f"{name}_half_width": float(half_width(values)),
    }


def _kinetics(aging: Aging) -> str:
    """Engine, method of ageing, replicas and events, in words."""
    by = f" by ageing {aging.method!r}" if aging.method else ""
    events = "" if aging.events is None else f", {aging.events.sum()} events"
    return f"{aging.engine}{by}, {aging.replicas} replica{'s' if aging.replicas > 1 else ''}{events}"


def _meaning(aging: Aging) -> str:
    """What the errors contain, so that those of one surface are not taken for those of a mean."""
    if aging.replicas < 2:
        return NONE
    return "95 % interval over replicas: disorder and noise on this one surface, without the scatter between surfaces"


def replicas_text(aging: Aging) -> str:
    """What the points of a curve are, for legends."""
    return f"mean of {aging.replicas} replicas, 95 %" if aging.replicas > 1 else "1 replica"


def draw_fit(axes: Axes, fit: Fit | None, label: str = "", color: str = ORANGE) -> None:
    """Draw the fitted line over the hold times that it is fitted to, by default with β and what was fitted in the
    legend; nothing without a fit."""
    if fit is None or not fit.drawable:
        return
    line = np.geomspace(*fit.span, 50)
    axes.plot(line, fit(line), color=color, lw=1.6, zorder=3, label=label or plain(fit.short_text()))


def draw_friction(axes: Axes, aging: Aging, quantity: Quantity, colour: str = BLUE, label: str = "") -> None:
    """Draw means of ``quantity`` against hold time, with 95 % intervals over replicas."""
    drawn = aging.hold_times > 0
    coefficient = quantity == "friction_coefficient_drop"
    if coefficient and aging.load <= 0:
        _write(axes, "undefined: no load")
    elif not drawn.any():
        _write(axes, "no hold time above 0")
    else:
        mean = aging.mean_friction_coefficient_drop if coefficient else aging.mean_friction_drop
        half = aging.friction_coefficient_drop_half_width if coefficient else aging.friction_drop_half_width
        _errorbars(axes, aging.hold_times[drawn], mean[drawn], half[drawn], colour, label)
    axes.set_ylabel("friction coefficient drop Δμ" if coefficient else "friction drop ΔF (nN)")
    axes.set(xscale="log", xlabel="hold time (s)")
    from_zero(axes)


def draw_local_slope(axes: Axes, aging: Aging, quantity: Quantity, colour: str = BLUE, label: str = "") -> None:
    """Draw the mean slope per decade of ``quantity`` over half a decade or more about each time, with 95 % intervals
    over replicas."""
    drawn = aging.hold_times > 0
    times, first = np.unique(np.log10(aging.hold_times[drawn]), return_index=True)
    values = aging.friction_coefficient_drop if quantity == "friction_coefficient_drop" else aging.friction_drop
    values = values[:, drawn][:, first]
    ends = [(low, int(np.searchsorted(times, start + SLOPE_SPAN - 1e-9))) for low, start in enumerate(times)]
    low, high = np.array([(low, high) for low, high in ends if high < times.size] or [(0, times.size - 1)]).T
    slopes = (values[:, high] - values[:, low]) / (times[high] - times[low])
    middle = 10 ** (0.5 * (times[low] + times[high]))
    _errorbars(axes, middle, slopes.mean(axis=0), half_width(slopes), colour, label)
    axes.set(xscale="log", xlabel="hold time (s)")
    symbol, unit = SYMBOL[quantity], f" ({UNIT[quantity]})" if UNIT[quantity] else ""
    axes.set_ylabel(f"slope d{symbol}/dlog$_{{10}}$t per decade{unit}")


def _finish(figure: Any, plots: list[Axes]) -> None:
    plots[-1].set_xlim(plots[0].get_xlim())
    for axes in plots:
        decades_only(axes.xaxis)


def _write(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", color=GREY)


def _errorbars(axes: Axes, t: np.ndarray, mean: np.ndarray, error: np.ndarray, colour: str, label: str) -> None:
    bars = np.nan_to_num(error) if np.isfinite(error).any() else None
    axes.errorbar(t, mean, yerr=bars, color=colour, marker="o", ms=3.5, lw=1, capsize=2, label=label or None)
