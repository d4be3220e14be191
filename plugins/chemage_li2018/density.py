"""``chemage study density``: calibration of the density of barriers to what the paper reports.

Families of densities with at most three parameters age the contacts of the paper. Between computed densities the curves
are interpolated, so that every family is drawn all over its box; each draw is weighted by the published rates, the
start of the logarithmic regime and the order of the slopes. Members that span what this leaves open are computed again
on every surface. Surfaces that have no part in this judge the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import chemage
from chemage_li2018 import density_fit as fit
from chemage_li2018.density_fit import OURS, PAPER, PREFER, DensityPrior, Reported
from chemage_li2018.density_rates import CONDITIONS, JUDGES, SURFACES, DensityCurves
from chemage_silica import MDSilica

#: family and parameters of the default density; it moves only if the data ask for it, because everything that was
#: computed with it moves as well: if twice ln of the likelihood, and of the posterior density, are more than STAYS below
#: the largest
DEFAULT, STAYS = ("shoulder and peak", (0.849, 1.0516, 0.1351)), 2.0
Named = tuple[str, chemage.plugin.Barriers]


def _table(name: str, energies: list[float], weights: list[float]) -> Named:
    return name, chemage.barriers("tabulated", energies=energies, weights=weights)


#: densities that are compared; the triangle with its peak at 1.1 eV is that of versions before 0.2.0, and the last was
#: fitted to the rates alone, over 10 to 1e4 s
REFERENCES: list[Named] = [
    ("default", fit.FAMILIES[DEFAULT[0]].barriers(DEFAULT[1])),
    _table("triangle, peak 1.04 eV", [0.8, 1.04, 1.4], [0, 1, 0]),
    _table("triangle, peak 1.1 eV", [0.8, 1.1, 1.4], [0, 1, 0]),
    _table("rates alone", [0.8, 1.1536, 1.1992, 1.4], [0.136, 1, 0, 0]),
]


class Size(NamedTuple):
    """How much is computed."""

    surfaces: tuple[int, ...] = SURFACES
    #: surfaces that every density of the search ages, and those that only judge
    search: tuple[int, ...] = SURFACES[:4]
    judges: tuple[int, ...] = JUDGES
    #: densities of a family, by the number of its parameters
    design: tuple[int, int, int] = (12, 24, 56)
    pixels: int = 2500


QUICK = Size(SURFACES[:3], SURFACES[:1], JUDGES[:3], (8, 12, 20), 400)


class Aged(NamedTuple):
    """Densities (k), aged on every surface of a set."""

    densities: list[Named]
    #: Δμ, (k, surfaces, conditions, m), and what the paper would report of their means over surfaces
    curves: np.ndarray
    reported: Reported
    #: covariance of ln β of one surface about the mean over these, (6, 6)
    surface: np.ndarray

    @classmethod
    def on(
        cls,
        rates: DensityCurves,
        stage: str,
        densities: list[Named],
        seeds: Sequence[int],
    ) -> Aged:
        """Age densities on the surfaces of these seeds."""
        curves = rates.curves(stage, [barriers for _, barriers in densities], seeds)
        every = Reported.of(curves.reshape(-1, *curves.shape[2:])).beta
        every = every.reshape(*curves.shape[:2], *every.shape[1:])
        surface = np.mean([np.cov(one.T) for one in every[:, :, PREFER]], axis=0)
        # geometric means of β, as in the error model; times are those of the mean curve
        reported = Reported.of(curves.mean(axis=1))._replace(beta=every.mean(axis=1))
        # our own mean has the error of its surfaces as well
        return cls(densities, curves, reported, surface * (1 + 1 / len(seeds)))

    def beta(self, reading: int = OURS) -> np.ndarray:
        """β, (k, 6), with ΔV first."""
        return np.exp(self.reported.beta[:, reading])

    def rates(self) -> np.ndarray:
        """χ² of the six rates with an error of the method of 1 %, (k, readings)."""
        errors = fit.covariance(self.surface, fit.PUBLISHED, fit.METHODS[0])
        return self.reported.chi_squared(PAPER, errors)


class DensityStudy(NamedTuple):
    """What the study found."""

    size: Size
    prior: DensityPrior
    #: (N, readings, methods)
    weight: np.ndarray
    #: of the default density: what twice ln of its likelihood and of its posterior density are below the largest
    below: list[float]
    #: the reference densities on the surfaces that calibrate and on those that judge; and the members
    calibrated: Aged
    judged: Aged
    members: Aged
    #: what the paper would report of the members as interpolated
    interpolated: Reported
    #: what all surfaces have more than those of the search, of each reference density
    shifts: Reported


def compute(rates: DensityCurves, size: Size) -> DensityStudy:
    """Weigh the draws of every family, age the members on every surface, and judge them on others."""
    calibrated = Aged.on(rates, "references", REFERENCES, size.surfaces)
    searched = Reported.of(calibrated.curves[:, : len(size.search)].mean(axis=1))
    shifts = Reported(*map(np.subtract, calibrated.reported, searched))
    shift = Reported(*(of.mean(axis=0) for of in shifts))
    emulators = []
    for family in fit.FAMILIES.values():
        parameters = family.design(size.design[len(family.ranges) - 1])
        barriers = [family.barriers(values) for values in parameters]
        curves = rates.curves(family.name, barriers, size.search, CONDITIONS)
        emulators.append(fit.Emulator(family, parameters, curves.mean(axis=1)))
    prior = DensityPrior.of(emulators, calibrated.surface, shift)
    weight = prior.posterior(PAPER)
    likelihood = prior.reported.log_likelihood(PAPER, prior.covariance)
    of_draws = weight.sum(axis=(1, 2))
    rest = [
        np.abs(row - DEFAULT[1]).sum() if family.name == DEFAULT[0] else np.inf
        for family, row in prior.draws
    ]
    now = int(np.argmin(rest))
    every = likelihood.max(axis=(1, 2)), np.log(of_draws + 1e-300)
    below = [float(2 * (of.max() - of[now])) for of in every]
    first = now if min(below) <= STAYS else None
    chosen = fit.spanning(prior.reported, of_draws, MDSilica.MEMBERS, first)
    members = [(prior.draws[at][0].name, prior.barriers(at)) for at in chosen]
    aged = Aged.on(rates, "members", members, size.surfaces)
    return DensityStudy(
        size,
        prior,
        weight,
        below,
        calibrated,
        Aged.on(rates, "judges", REFERENCES, size.judges),
        aged,
        Reported(
            prior.reported.beta[chosen, :, :6],
            *(of[chosen] for of in prior.reported[1:]),
        ),
        shifts,
    )
