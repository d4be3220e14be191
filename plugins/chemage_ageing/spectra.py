"""Distributions over the sites of a contact: of their forming barriers, and of their pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from chemage import ContactSolution, ReactionLattice
from chemage.plugin import (
    BondHistory,
    Energy,
    Observable,
    Observed,
    Output,
    Pressure,
    figures,
    text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def _density(values: np.ndarray, edges: np.ndarray, sites: int) -> np.ndarray:
    """The histogram of ``values`` as a density per site of ``sites``."""
    counts, _ = np.histogram(values, bins=edges)
    return counts / (max(sites, 1) * np.diff(edges))


class BarrierSpectrum(Observable):
    """Histograms of the forming barriers as densities per site, 1/eV. Li et al. 2018, Fig. 2(a).

    ``barriers_start``: all sites before any bond has formed; ``barriers_open``: the sites unbonded at the end, with the
    coupling of bonded neighbours; ``barriers_bonded``: initial barriers of the sites bonded at the end.
    """

    kind = "barrier-spectrum"
    figures: ClassVar[Mapping[str, str]] = {
        "barriers": "Distributions of the forming barrier: before any bond has formed, and of the sites that are still "
        "unbonded at the last hold time."
    }

    outputs: ClassVar[Mapping[str, Output]] = {
        "barrier_edges": Output(
            ("barrier_edge",), "eV", "edges of the bins of the barrier"
        ),
        "barriers_start": Output(
            ("barrier",), "1/eV", "density per site before any bond has formed"
        ),
        "barriers_open": Output(
            ("barrier",),
            "1/eV",
            "density per site of the sites unbonded at the end",
        ),
        "barriers_bonded": Output(
            ("barrier",),
            "1/eV",
            "density per site of the initial barriers of bonded sites",
        ),
    }

    lower: Energy = 0.0
    """lower edge of the histogram, eV"""
    upper: Energy = 2.5
    """upper edge of the histogram, eV; a density integrates to the fraction of sites between the edges"""
    bins: int = Field(default=125, ge=1, le=100_000)
    """number of bins of equal width"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.upper <= self.lower:
            raise ValueError(
                f"upper ({self.upper:g} eV) must be above lower ({self.lower:g} eV)"
            )
        return self

    def measure(
        self,
        contact: ContactSolution,
        lattice: ReactionLattice,
        history: BondHistory,
    ) -> Mapping[str, np.ndarray]:
        """Compute the bin edges, (bins + 1,) eV, and three densities per site of the lattice, (bins,) 1/eV."""
        edges = np.linspace(self.lower, self.upper, self.bins + 1)
        forming, bonded = lattice.forming, history.state
        now = np.array(forming)
        if lattice.neighbours is not None and lattice.coupling is not None:
            taken = np.append(bonded, False)[
                lattice.neighbours
            ]  # slot -1 reads the appended False
            now += np.sum(lattice.coupling, axis=1, where=taken, dtype=np.float64)

        spectra = {
            "start": forming,
            "open": now[~bonded],
            "bonded": forming[bonded],
        }
        densities = {
            f"barriers_{name}": _density(values, edges, forming.size)
            for name, values in spectra.items()
        }
        return {"barrier_edges": edges, **densities}

    def draw(self, figure: str, axes: Axes, results: Sequence[Observed]) -> None:
        """Draw intrinsic barriers and those of all, unbonded and bonded sites; of several results all and unbonded."""
        alone, ends = len(results) == 1, []
        for result in results:
            measured = result.ageing.observables
            edges = measured["barrier_edges"][0]
            if alone and result.chemistry is not None:
                energy = np.linspace(edges[0], edges[-1], 801)
                intrinsic = result.chemistry.forming.density(energy)
                if np.isfinite(intrinsic).all():
                    axes.plot(
                        energy,
                        intrinsic,
                        color=figures.GREY,
                        lw=1.2,
                        label="intrinsic",
                    )
            for name, colour, dashes, label in _lines(result, alone):
                density = measured[f"barriers_{name}"].mean(axis=0)
                filled = np.flatnonzero(density > density.max() * 1e-3)
                if filled.size:
                    axes.stairs(
                        density, edges, color=colour, lw=1.4, ls=dashes, label=label
                    )
                    ends += [edges[filled[0]] - 0.05, edges[filled[-1] + 1] + 0.05]
        axes.set(
            xlabel="barrier to forming a bond (eV)",
            ylabel="density per site (1/eV)",
            ylim=(0, None),
        )
        if ends:
            axes.set_xlim(min(ends), max(ends))
        axes.legend(frameon=False, fontsize=8 if alone else 7)


def _lines(result: Observed, alone: bool) -> list[tuple[str, str, str, str]]:
    """What is drawn of a result: spectrum, colour, dashes, label."""
    last = f"{text.power_text(result.ageing.hold_times[-1])} s"
    if not alone:
        unbonded = f"{result.label}, unbonded at {last}"
        return [
            ("start", result.color, "-", result.label),
            ("open", result.color, "--", unbonded),
        ]
    lowered = (
        result.chemistry is not None and result.chemistry.activation_volume > 0
    )
    return [
        (
            "start",
            figures.BLUE,
            "-",
            "lowered by pressure" if lowered else "of the sites",
        ),
        ("open", figures.ORANGE, "-", f"unbonded at {last}"),
        ("bonded", figures.GREEN, "-", f"bonded at {last} (initial barrier)"),
    ]


class PressureSpectrum(Observable):
    """Histograms of the pressure at the sites as densities per site, 1/GPa.

    ``pressures``: all sites; ``pressures_bonded``: the sites bonded at the end, also per site of the lattice.
    """

    kind = "pressure-spectrum"

    outputs: ClassVar[Mapping[str, Output]] = {
        "pressure_edges": Output(
            ("pressure_edge",), "GPa", "edges of the bins of the pressure"
        ),
        "pressures": Output(
            ("pressure",), "1/GPa", "density per site of all sites"
        ),
        "pressures_bonded": Output(
            ("pressure",),
            "1/GPa",
            "density per site of the sites bonded at the end",
        ),
    }

    upper: Pressure = 20.0
    """upper edge of the histogram, GPa; the lower edge is 0"""
    bins: int = Field(default=200, ge=1, le=100_000)
    """number of bins of equal width"""

    def measure(
        self,
        contact: ContactSolution,
        lattice: ReactionLattice,
        history: BondHistory,
    ) -> Mapping[str, np.ndarray]:
        """Compute the bin edges, (bins + 1,) GPa, and two densities per site of the lattice, (bins,) 1/GPa."""
        edges = np.linspace(0.0, self.upper, self.bins + 1)
        pressure = lattice.pressures(contact)

        return {
            "pressure_edges": edges,
            "pressures": _density(pressure, edges, pressure.size),
            "pressures_bonded": _density(
                pressure[history.state], edges, pressure.size
            ),
        }
