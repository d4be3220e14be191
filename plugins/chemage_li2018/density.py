"""``chemage study density``: calibration of the density of barriers to what the paper reports.

Families of densities with at most three parameters age the contacts of the paper. Between computed densities the curves
are interpolated, so that every family is drawn all over its box; each draw is weighted by the published rates, the
start of the logarithmic regime and the order of the slopes. Members that span what this leaves open are computed again
on every surface. Densities drawn from the prior test the calibration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import chemage
from chemage_li2018 import density_fit as fit
from chemage_li2018.density_fit import (
    FAMILIES,
    FREE_END,
    OURS,
    PAPER,
    DensityPrior,
    Emulator,
    Reported,
)
from chemage_li2018.density_rates import (
    FITTED,
    SURFACES,
    TIMES,
    TIP,
    UNUSED,
    DensityCurves,
)
from chemage_li2018.shapes import first_reaching
from chemage_silica import MDSilica

#: the density of versions before 0.2.0, and one that was fitted to the rates alone, which misses the onsets; they are
#: compared with the members, and their scatter between surfaces is the error model
TRIANGLE = chemage.barriers("tabulated", energies=[0.8, 1.1, 1.4], weights=[0, 1, 0])
RATES_ALONE = chemage.barriers(
    "tabulated", energies=[0.8, 1.1536, 1.1992, 1.4], weights=[0.136, 1, 0, 0]
)


@dataclass(frozen=True)
class Size:
    """How much is computed."""

    surfaces: tuple[int, ...] = SURFACES
    #: surfaces that every density of the search ages
    search: int = 4
    #: densities of a family, by the number of its parameters
    design: tuple[int, int, int] = (12, 24, 56)
    #: densities that test the calibration
    cases: int = 40
    pixels: int = 2500

    def parameters(self, family: fit.DensityFamily) -> np.ndarray:
        """Parameters of the densities of a family that are computed, (n, k)."""
        return family.design(self.design[len(family.bounds) - 1])


QUICK = Size(SURFACES[:3], 1, (8, 12, 20), 4, 400)


@dataclass(frozen=True)
class Density:
    """A density, aged on every surface."""

    name: str
    barriers: chemage.plugin.Barriers
    #: what the paper would report of it, one density
    reported: Reported
    #: χ² of the six rates with an error of the method of 1 %, by window, and of the times with our own window
    rates: np.ndarray
    times: float

    @property
    def beta(self) -> np.ndarray:
        """β, geometric mean over surfaces, (6,), with ΔV first, over the window of our own scenes."""
        return np.exp(self.reported.beta[0, OURS])


@dataclass(frozen=True)
class Tips:
    """One density for the rough contacts, for a tip in atomic force microscopy, and for both."""

    #: parameters of the best density for rough, tip and both, (3, k); misfit of rough and tip of each, (3, 2); start of
    #: the logarithmic regime on the tip (s), and exponent of the growth before, (3, 2)
    parameters: np.ndarray
    misfit: np.ndarray
    growth: np.ndarray


@dataclass(frozen=True)
class DensityStudy:
    """What the study found."""

    size: Size
    prior: DensityPrior
    #: (N, windows, methods)
    weight: np.ndarray
    triangle: Density
    rates_alone: Density
    members: list[Density]
    #: ln β of each member as interpolated, over the window of our own scenes, (members, 6)
    interpolated: np.ndarray
    #: of each case, whether the range of the members holds β under each unused condition, (cases, conditions)
    held: np.ndarray
    tips: Tips


def compute(rates: DensityCurves, size: Size) -> DensityStudy:
    """Weigh the draws of every family, and age the members on every surface."""
    references = rates.curves("error model", [TRIANGLE, RATES_ALONE], size.surfaces)
    every = np.stack([Reported.of(curves).beta for curves in references])
    surface = np.mean([np.cov(beta[:, OURS].T) for beta in every], axis=0)
    # what the surfaces of the search lack to the mean over all of them, which hardly depends on the density
    shift = (every.mean(axis=1) - every[:, : size.search].mean(axis=1)).mean(axis=0)
    emulators = [_emulated(rates, size, family) for family in FAMILIES]
    # our own mean has the error of its surfaces as well
    surface = surface * (1 + 1 / len(size.surfaces))
    prior = DensityPrior.of(emulators, surface, shift)
    weight = prior.posterior(PAPER)
    chosen = _members(prior, weight)
    barriers = [prior.barriers(at) for at in chosen]
    aged = rates.curves("members", barriers, size.surfaces)
    names = [prior.families[int(prior.family[at])].name for at in chosen]
    parameters = size.parameters(FREE_END)
    tip = rates.curves(
        "tip", [FREE_END.barriers(row) for row in parameters], [0], [TIP]
    )[:, 0]
    emulators = _emulated(rates, size, FREE_END), Emulator(FREE_END, parameters, tip)
    return DensityStudy(
        size,
        prior,
        weight,
        _density("triangle", TRIANGLE, references[0], surface),
        _density("rates alone", RATES_ALONE, references[1], surface),
        [_density(*row, surface) for row in zip(names, barriers, aged, strict=True)],
        prior.reported.beta[chosen, OURS, :6],
        _held(rates, size, prior, shift),
        _tips(rates, *emulators, surface, shift),
    )


def _emulated(rates: DensityCurves, size: Size, family: fit.DensityFamily) -> Emulator:
    parameters = size.parameters(family)
    barriers = [family.barriers(values) for values in parameters]
    curves = rates.curves(
        family.name, barriers, size.surfaces[: size.search], (*FITTED, *UNUSED)
    )
    return Emulator(family, parameters, curves.mean(axis=1))


def _members(prior: DensityPrior, weight: np.ndarray) -> np.ndarray:
    """The draw of least misfit, and those that span what is open."""
    of_draws = weight.sum(axis=(1, 2))
    best = int(np.argmax(of_draws))
    return fit.spanning(prior.reported.predictions(), of_draws, best, MDSilica.MEMBERS)


def _density(
    name: str,
    barriers: chemage.plugin.Barriers,
    curves: np.ndarray,
    surface: np.ndarray,
) -> Density:
    """Summarise the curves of one density, (surfaces, conditions, m)."""
    # β is the geometric mean over surfaces, as in the error model; times are those of the mean curve
    reported = Reported.of(curves.mean(axis=0)[None])._replace(
        beta=Reported.of(curves).beta.mean(axis=0)[None]
    )
    errors = fit.covariance(surface, fit.PUBLISHED, fit.METHODS[0])
    times = float(reported.misfit_of_times(PAPER)[0, OURS])
    return Density(
        name, barriers, reported, reported.chi_squared(PAPER, errors)[0], times
    )


def _held(
    rates: DensityCurves,
    size: Size,
    prior: DensityPrior,
    shift: np.ndarray,
) -> np.ndarray:
    """Calibrate to rates of known densities, and compare β under conditions without a rate with the computed one."""
    rng = np.random.default_rng(27)
    within = np.exp(prior.log_weight)
    truths = rng.choice(len(within), size.cases, p=within / within.sum())
    barriers = [prior.barriers(at) for at in truths]
    search = size.surfaces[: size.search]
    curves = rates.curves("synthetic", barriers, search, (*FITTED, *UNUSED))
    computed = Reported.of(curves.mean(axis=1))
    held = []
    for case in range(size.cases):
        window = rng.integers(len(fit.WINDOWS))
        method = fit.METHODS[rng.integers(len(fit.METHODS))]
        beta = computed.beta[case, window, :6] + shift[window]
        beta = np.exp(
            rng.multivariate_normal(beta, prior.surface)
            + method * rng.standard_normal(6)
        )
        published = Reported(
            np.log(np.maximum(beta.round(2), fit.ROUNDING)),
            computed.onsets[case, window] + fit.ONSET_ERROR * rng.standard_normal(2),
            computed.crossing[case] + fit.CROSSING_ERROR * rng.standard_normal(1),
        )
        members = _members(prior, prior.posterior(published))
        ours = prior.reported.beta[members, OURS, 6:]
        true = computed.beta[case, OURS, 6:]
        held.append((ours.min(axis=0) <= true) & (true <= ours.max(axis=0)))
    return np.array(held)


#: of atomic force microscopy (Tian et al., Phys. Rev. Lett. 124, 026801 (2020)): a logarithmic regime from 0.1 s on;
#: from 5 to 90 ms friction grows as a power of time, 1 with these two standard deviations
TIP_ONSET, TIP_LINEAR, TIP_EXPONENT = 0.1, (5e-3, 90e-3), 0.2


def _tips(
    rates: DensityCurves,
    rough: Emulator,
    tip: Emulator,
    surface: np.ndarray,
    shift: np.ndarray,
) -> Tips:
    """Fit a density whose lower end is free to the rough contacts, to a tip, and to both."""
    prior = DensityPrior.of([rough], surface, shift)
    with_method = prior.chi_squared(0.04)
    of_rough = (with_method + prior.reported.misfit_of_times(PAPER)).min(axis=1)
    _, of_tip = _growth(tip(np.array(prior.parameters))[:, 0])
    best = [int(np.argmin(misfit)) for misfit in (of_rough, of_tip, of_rough + of_tip)]
    # the chosen ones are aged, because a curve between others has an error where few sites have reacted
    growth, of_tip = _growth(
        rates.curves("tips", [prior.barriers(at) for at in best], [0], [TIP])[:, 0, 0]
    )
    misfit = np.stack([of_rough[best], of_tip], axis=1)
    return Tips(np.array([prior.parameters[at] for at in best]), misfit, growth)


def _growth(curves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start of the logarithmic regime (s) and exponent of the growth before, of curves (n, m) on a tip, (n, 2); and
    their misfit, (n,)."""
    half = 0.5 * fit.slope(curves, (1.0, 1e3))
    first, last = TIP_LINEAR
    inside = (first <= TIMES) & (last >= TIMES)
    exponent = np.polyfit(
        np.log(TIMES[inside]), np.log(np.maximum(curves[:, inside], 1e-6)).T, 1
    )[0]
    start = first_reaching(TIMES, np.gradient(curves, np.log10(TIMES), axis=-1), half)
    misfit = (np.log(start / TIP_ONSET) / fit.ONSET_ERROR) ** 2 + (
        (exponent - 1) / (0.5 * TIP_EXPONENT)
    ) ** 2
    return np.stack([start, exponent], axis=1), misfit
