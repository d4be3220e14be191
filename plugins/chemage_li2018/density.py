"""``chemage study density``: calibration of the density of barriers to the published ageing rates.

Families of densities with at most three parameters age the contacts of the paper; the family and the parameters closest
to the six published β are found by interpolation between computed densities, and computed again on every surface,
together with the set of densities that fit equally well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import chemage
from chemage_li2018 import density_fit as fit
from chemage_li2018.density_fit import FAMILIES, Family
from chemage_li2018.density_rates import SLOPES, SURFACES, TIMES, Rates, logarithms, mean_logarithms, slope_of
from chemage_silica import MDSilica

#: the density of versions before 0.2.0, and one that differs from it: their scatter between surfaces is the error model
TRIANGLE = chemage.barriers("tabulated", energies=[0.8, 1.1, 1.4], weights=[0, 1, 0])
OTHER = chemage.barriers("tabulated", energies=[0.8, 0.88, 1.12, 1.4], weights=[0, 0.6, 1, 0])


#: candidates for the set beyond its size
SPARE = 2
#: candidates for the best density
CANDIDATES = 6


@dataclass(frozen=True)
class Size:
    """How much is computed."""

    surfaces: tuple[int, ...] = SURFACES
    #: surfaces that every density of the search ages
    search: tuple[int, ...] = SURFACES[:4]
    #: densities of a family, by the number of its parameters, and further ones about the best of them
    design: tuple[int, int, int] = (8, 16, 32)
    refined: int = 8
    #: densities of the chosen family in the region that fits equally well
    final: int = 16
    #: surfaces that those and the set age
    closer: tuple[int, ...] = SURFACES[:12]
    pixels: int = 2500


QUICK = Size(SURFACES[:3], SURFACES[:1], (4, 6, 16), 2, 12, SURFACES[:2], 400)


@dataclass(frozen=True)
class Density:
    """A density, aged on every surface."""

    name: str
    barriers: chemage.plugin.Barriers
    #: parameters of the family; empty for the triangle
    parameters: np.ndarray
    #: Δμ, mean over surfaces, (volumes, slopes, m)
    curves: np.ndarray
    #: β, geometric mean over surfaces, (6,), with ΔV first
    beta: np.ndarray
    chi_squared: float

    @property
    def excess(self) -> float:
        """The largest deviation of a rate or a ratio over its bound; see :func:`chemage_li2018.density_fit.excess`."""
        return float(fit.excess(self.beta))

    @property
    def onsets(self) -> tuple[float, float]:
        """Hold times at which the slope of Δμ first reaches half of β for h' = 0.1, with ΔV and without, s."""
        first, second = (_onset(curve) for curve in self.curves[:, SLOPES.index(0.1)])
        return first, second

    @property
    def crossing(self) -> float:
        """Hold time at which Δμ of the largest slope falls below that of the smallest, with ΔV, s; nan if never."""
        # no bond at all on few sites after a short time is far below any bond
        rough, smooth = np.log(np.maximum(self.curves[0, [-1, 0]], 1e-300))
        difference = rough - smooth
        below = np.flatnonzero(difference < 0)
        if not below.size or below[0] == 0:
            return float("nan")
        at = int(below[0])
        part = difference[at - 1] / (difference[at - 1] - difference[at])
        return float(TIMES[at - 1] * (TIMES[at] / TIMES[at - 1]) ** part)

    def claims(self) -> dict[str, bool]:
        """Whether each published claim that was not fitted holds."""
        one_second, later = (int(np.argmin(np.abs(np.log(TIMES / time)))) for time in (1.0, 1e3))
        with_volume, without = self.onsets
        return {
            "6.4 Å³: Δμ rises with h' at 1 s": bool((np.diff(self.curves[0, :, one_second]) > 0).all()),
            "6.4 Å³: Δμ falls with h' at 1000 s": bool((np.diff(self.curves[0, :, later]) < 0).all()),
            "6.4 Å³: the crossing is between 1 and 10 s": 1 <= self.crossing <= 10,
            "6.4 Å³: the logarithmic regime starts at about 1 s (0.3 to 3 s)": 0.3 <= with_volume <= 3,
            "ΔV = 0: the logarithmic regime starts at about 10 s (3 to 30 s)": 3 <= without <= 30,
            "ΔV = 0: Δμ falls with h' at all times": bool((np.diff(self.curves[1], axis=0) < 0).all()),
        }


def _onset(curve: np.ndarray) -> float:
    x = np.log10(TIMES)
    steep = np.flatnonzero(np.gradient(curve, x) >= 0.5 * slope_of(curve))
    return float(TIMES[steep[0]])


@dataclass(frozen=True)
class Study:
    """What the study found."""

    size: Size
    errors: fit.Errors
    #: best of each family by interpolation: family, parameters, β, χ², excess
    families: list[tuple[Family, np.ndarray, np.ndarray, float, float]]
    family: Family
    triangle: Density
    best: Density
    members: list[Density]
    #: rms difference between interpolated and computed ln β of the members
    interpolation_error: float


def compute(rates: Rates, size: Size) -> Study:
    """Calibrate every family, choose the best, and age its best density and the set on every surface."""
    references = rates.curves("error model", [TRIANGLE, OTHER], size.surfaces, 1)
    every = logarithms(references)
    errors = fit.Errors.between(every)

    # what the surfaces of the search lack to the mean over all of them, which hardly depends on the density
    def lacking(seeds: Sequence[int]) -> np.ndarray:
        positions = [size.surfaces.index(seed) for seed in seeds]
        return (every.mean(axis=1) - every[:, positions].mean(axis=1)).mean(axis=0)

    fits = [_searched(rates, size, family, lacking(size.search), errors) for family in FAMILIES]
    families = []
    for fitted in fits:
        value = fitted.interpolated(fitted.best)[0]
        beta = np.exp(value)
        families.append((fitted.family, fitted.best, beta, float(errors.chi_squared(value)), float(fit.excess(beta))))
    chosen = _chosen(fits, errors)
    final = _final(rates, size, chosen, lacking(size.closer), errors)
    close = [np.round(values, 4) for values in fit.within_bounds(final, errors, CANDIDATES)]
    best = min(_aged(rates, size, chosen.family, close, "best", errors), key=lambda density: density.excess)
    candidates = [
        np.round(values, 4) for values in fit.equally_good(final, errors, MDSilica.MEMBERS + SPARE, best.parameters)
    ]
    aged = _aged(rates, size, chosen.family, candidates, "members", errors, size.closer, lacking(size.closer))
    # the interpolation has an error: those that turn out to fit worst are left out
    members = sorted(
        sorted(aged, key=lambda density: density.chi_squared)[: MDSilica.MEMBERS], key=lambda density: int(density.name)
    )
    predicted = final.interpolated(np.stack([density.parameters for density in aged]))
    computed = np.log([density.beta for density in aged])
    return Study(
        size,
        errors,
        families,
        chosen.family,
        _made("triangle", TRIANGLE, np.array([]), references[0], errors),
        best,
        members,
        float(np.sqrt(np.mean((predicted - computed) ** 2))),
    )


def _chosen(fits: Sequence[fit.Fitted], errors: fit.Errors) -> fit.Fitted:
    """Of the families that fit equally well, χ² within 1 of the least, choose that with the fewest nodes."""
    least = [float(errors.chi_squared(fitted.interpolated(fitted.best))[0]) for fitted in fits]
    good = [(len(fitted.family.nodes(*fitted.best)[0]), chi, fitted) for fitted, chi in zip(fits, least, strict=True)]
    return min((row for row in good if row[1] <= min(least) + 1), key=lambda row: row[:2])[2]


def _searched(rates: Rates, size: Size, family: Family, shift: np.ndarray, errors: fit.Errors) -> fit.Fitted:
    """Find the best of a family, from densities all over its bounds and then from more about the best of these."""

    def aged(parameters: np.ndarray) -> np.ndarray:
        barriers = [family.barriers(values) for values in parameters]
        return mean_logarithms(rates.curves(family.name, barriers, size.search, 1)) + shift

    parameters = fit.design(family, size.design[len(family.bounds) - 1])
    values = aged(parameters)
    first = fit.fitted(family, parameters, values, errors)
    more = fit.design(family, size.refined, first.best)
    return fit.fitted(family, np.vstack([parameters, more]), np.vstack([values, aged(more)]), errors)


def _final(rates: Rates, size: Size, chosen: fit.Fitted, shift: np.ndarray, errors: fit.Errors) -> fit.Fitted:
    """Age densities of the chosen family on more surfaces, all over the part of its bounds that fits equally well."""
    box = fit.region(chosen, errors)
    family = Family(chosen.family.name, chosen.family.parameters, box, chosen.family.nodes)
    parameters = fit.design(family, size.final)
    barriers = [family.barriers(values) for values in parameters]
    values = mean_logarithms(rates.curves(f"{family.name}, closer", barriers, size.closer, 1)) + shift
    return fit.fitted(family, parameters, values, errors)


def _aged(
    rates: Rates,
    size: Size,
    family: Family,
    parameters: Sequence[np.ndarray],
    stage: str,
    errors: fit.Errors,
    surfaces: Sequence[int] | None = None,
    shift: np.ndarray | float = 0.0,
) -> list[Density]:
    """Age densities of a family, on all surfaces or on some and corrected by ``shift``."""
    barriers = [family.barriers(values) for values in parameters]
    curves = rates.curves(stage, barriers, surfaces or size.surfaces, 1)
    return [
        _made(str(number), density, values, of_surfaces, errors, shift)
        for number, (density, values, of_surfaces) in enumerate(zip(barriers, parameters, curves, strict=True))
    ]


def _made(
    name: str,
    barriers: chemage.plugin.Barriers,
    parameters: np.ndarray,
    curves: np.ndarray,
    errors: fit.Errors,
    shift: np.ndarray | float = 0.0,
) -> Density:
    """Summarise the curves of one density, (surfaces, volumes, slopes, m)."""
    value = mean_logarithms(curves[None])[0] + shift
    return Density(name, barriers, parameters, curves.mean(axis=0), np.exp(value), float(errors.chi_squared(value)))
