"""How fits of rate-and-state laws to one trace are shown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from chemage import InputError
from chemage.plugin import Panel, Picture, Quantity, Result, figures
from chemage_rate_state.fit import TOLD, fit_rate_state
from chemage_rate_state.laws import Law
from chemage_rate_state.traces import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class RateStateDisplay(Result):
    """Laws fitted to one trace as users see them, and why others could not be."""

    errors = "95 % intervals, with the correlation of the noise"

    def __init__(self, trace: Trace, laws: Iterable[Law]) -> None:
        self.trace, self.fits = trace, []
        self.failed: dict[Law, str] = {}
        for law in laws:
            try:
                self.fits.append(fit_rate_state(trace, law))
            except InputError as error:
                self.failed[law] = str(error)
        if not self.fits:
            raise InputError("\n".join(self.failed.values()))
        self.fits.sort(key=lambda one: one.misfit)

    @property
    def name(self) -> str:
        return self.trace.name

    def facts(self) -> list[tuple[str, str]]:
        """The loading, and whether laws explain the trace and are told apart."""
        loading = zip(*self.trace.loading, strict=True)
        speeds = (f"{speed:.4g} µm/s from {time:.6g} s" for time, speed in loading)
        rows = [("speeds of the load point", ", ".join(speeds))]
        rows += [(f"{fit.law} law", fit.words()) for fit in self.fits]
        rows += [
            (f"{law} law", f"not fitted: {why}") for law, why in self.failed.items()
        ]
        for other in self.fits[1:]:
            more = other.misfit - self.fits[0].misfit
            told = "fits worse" if more >= TOLD else "is not told from the other"
            rows.append(
                ("laws", f"the {other.law} law {told}: misfit {more:.1f} larger")
            )
        for rival in self.rivals():
            values = (
                f"{name} {value:.3g}"
                for name, value in rival.items()
                if name != "law"
            )
            rows.append(
                (f"{rival['law']} law fits nearly as well with", ", ".join(values))
            )
        return rows

    def rivals(self) -> list[dict[str, Any]]:
        """Other minima, and by how much their misfit is larger."""
        return [
            {"law": fit.law, **one._asdict(), "misfit": more}
            for fit in self.fits
            for one, more in fit.rivals
        ]

    def quantities(self) -> list[Quantity]:
        return [
            one.but(
                name=f"{fit.law}_{one.name}", label=f"{fit.law} law: {one.label}"
            )
            for fit in self.fits
            for one in fit.quantities()
        ]

    def numbers(self) -> dict[str, Any]:
        found = super().numbers() | {
            "rivals": self.rivals(),
            "not_fitted": self.failed,
        }
        for fit in self.fits:
            for name in ("explains", "misfit", "probability"):
                found[f"{fit.law}_{name}"] = getattr(fit, name)
        begins, speeds = self.trace.loading
        return found | {"speeds": speeds.tolist(), "changes": begins[1:].tolist()}

    def columns(self) -> dict[str, Any]:
        return {
            "time (s)": self.trace.times,
            "displacement (um)": self.trace.way,
            "friction_coefficient": self.trace.friction,
            **{f"{fit.law}_law": fit.fitted for fit in self.fits},
        }

    def pictures(self) -> dict[str, Picture]:
        """Friction against the displacement of the load point, with the laws."""
        return {"fits": Picture([Panel(self.plotted)])}

    def plotted(self, axes: Axes, medium: Any = None) -> None:
        """Draw the trace and the laws."""
        trace = self.trace
        axes.plot(trace.way, trace.friction, ".", color="0.7", label="trace")
        for fit in self.fits:
            axes.plot(trace.way, fit.fitted, label=f"{fit.law} law")
        axes.set(
            xlabel="displacement of the load point (µm)",
            ylabel="friction coefficient",
        )
        figures.legend(axes)
