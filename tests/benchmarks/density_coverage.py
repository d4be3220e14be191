"""How often the members of ``md-silica`` hold what a known density has: ``python tests/benchmarks/density_coverage.py``.

    python tests/benchmarks/density_coverage.py FOLDER [CASES]      # 40 cases; FOLDER is that of `chemage study density`

Densities drawn from the prior, with a random reading and method, give rates and times with the errors of the study, to
which it is calibrated; β under conditions without a published rate is compared with the range of the members.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from chemage_li2018 import density_fit as fit
from chemage_li2018.density import DensityStudy, Size, compute
from chemage_li2018.density_fit import OURS, Reported
from chemage_li2018.density_rates import CONDITIONS, DensityCurves
from chemage_silica import MDSilica


def held(rates: DensityCurves, study: DensityStudy, cases: int) -> np.ndarray:
    """Whether the range of the members holds β under each condition without a rate, (cases, conditions)."""
    prior, shift = study.prior, Reported(*(of.mean(axis=0) for of in study.shifts))
    rng = np.random.default_rng(27)
    within = np.exp(prior.log_weight)
    truths = rng.choice(len(within), cases, p=within / within.sum())
    barriers = [prior.barriers(at) for at in truths]
    curves = rates.curves("synthetic", barriers, study.size.search, CONDITIONS)
    computed, found = Reported.of(curves.mean(axis=1)), []
    for beta, onsets, crossing in zip(*computed, strict=True):
        reading = rng.choice(len(fit.READINGS), p=fit.READING_WEIGHTS)
        mean = beta[reading, :6] + shift.beta[reading]
        error = fit.METHODS[rng.integers(len(fit.METHODS))] * rng.standard_normal(6)
        printed = np.exp(rng.multivariate_normal(mean, prior.surface) + error).round(2)
        published = Reported(
            np.log(np.maximum(printed, fit.ROUNDING)),
            onsets[reading] + fit.ONSET_ERROR * rng.standard_normal(2),
            crossing + fit.CROSSING_ERROR * rng.standard_normal(1),
        )
        weight = prior.posterior(published).sum(axis=(1, 2))
        members = fit.spanning(prior.reported, weight, MDSilica.MEMBERS)
        ours = prior.reported.beta[members, OURS, 6:]
        true = beta[OURS, 6:]
        found.append((ours.min(axis=0) <= true) & (true <= ours.max(axis=0)))
    return np.array(found)


def main(folder: Path, cases: int) -> None:
    rates = DensityCurves(folder / "rates", lambda *_: None)
    found = held(rates, compute(rates, Size()), cases)
    for condition, column in zip(CONDITIONS[6:], found.T, strict=True):
        print(f"{condition}: {column.sum()} of {cases}")
    print(f"together {found.mean():.1%}; standard error of 95 %: {np.sqrt(0.95 * 0.05 / cases):.1%}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 40)
