"""The page of the calibration, which is ``docs/barrier_density.md``."""

from __future__ import annotations

from importlib import resources

import numpy as np

from chemage_studies.density import fit
from chemage_studies.density.rates import SLOPES, TIMES
from chemage_studies.density.study import Density, Study
from chemage_studies.markdown import filled, table

VOLUMES = ("6.4 Å³", "0")


def _word(within: bool) -> str:
    return "yes" if within else "**no**"


def _band(values: list[float], digits: int) -> str:
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _rates_table(study: Study) -> str:
    rows = []
    for at, published in enumerate(fit.PUBLISHED):
        best, triangle = study.best.beta[at], study.triangle.beta[at]
        rows.append(
            [
                f"{SLOPES[at % 3]:g}",
                VOLUMES[at // 3],
                f"{published:.2f}",
                f"{best:.4f}",
                f"{100 * (best / published - 1):+.1f} %",
                _word(abs(best / published - 1) <= fit.WITHIN_BETA),
                _band([float(one.beta[at]) for one in study.members], 3),
                f"{triangle:.4f} ({100 * (triangle / published - 1):+.1f} %)",
            ]
        )
    columns = ["h'", "ΔV", "published β", "best", "difference", "within 6 %", "set", "triangle"]
    return table(columns, rows)


def _ratios_table(study: Study) -> str:
    published, (least, most) = fit.PUBLISHED_RATIOS, fit.rounded_ratios()
    best, triangle = fit.ratios(study.best.beta), fit.ratios(study.triangle.beta)
    rows = [
        [
            f"{slope:g}",
            f"{published[at]:.2f} ({least[at]:.3f} to {most[at]:.3f})",
            f"{best[at]:.3f}",
            f"{best[at] - published[at]:+.3f}",
            _word(abs(best[at] - published[at]) <= fit.WITHIN_RATIO),
            _band([float(fit.ratios(one.beta)[at]) for one in study.members], 3),
            f"{triangle[at]:.3f}",
            f"{100 * study.errors.surface_of_ratios[at]:.1f} %",
        ]
        for at, slope in enumerate(SLOPES)
    ]
    columns = ["h'", "published (rounding)", "best", "difference", "within 0.04", "set", "triangle", "between surfaces"]
    return table(columns, rows)


def _families_table(study: Study) -> str:
    rows = []
    for family, parameters, beta, chi, excess in study.families:
        named = ", ".join(f"{name} {value:.3g}" for name, value in zip(family.parameters, parameters, strict=True))
        rows.append(
            [
                family.name,
                named,
                f"{chi:.1f}",
                " ".join(f"{100 * value:+.0f}" for value in beta / fit.PUBLISHED - 1),
                " ".join(f"{value:.2f}" for value in fit.ratios(beta)),
                f"{excess:.2f}",
            ]
        )
    columns = ["family", "parameters of least χ²", "χ²", "differences of the six β (%)", "ratios", "largest/bound"]
    return table(columns, rows)


def _members_table(study: Study) -> str:
    rows = []
    for number, one in enumerate([study.best, *study.members]):
        rows.append(
            [
                str(number),
                *(f"{value:.4g}" for value in one.parameters),
                f"{one.chi_squared:.1f}",
                " ".join(f"{value:.3f}" for value in one.beta),
                " ".join(f"{value:.3f}" for value in fit.ratios(one.beta)),
                f"{one.crossing:.1f}",
                ", ".join(f"≤ {TIMES[0]:.1f}" if onset <= TIMES[0] else f"{onset:.1f}" for onset in one.onsets),
                "yes" if all(one.claims().values()) else "no",
            ]
        )
    columns = ["member", *study.family.parameters, "χ²", "β: 6.4 Å³, then ΔV = 0", "ratios"]
    return table([*columns, "crossing (s)", "start of the log regime (s): 6.4 Å³, 0", "all claims"], rows)


def _claims_table(study: Study) -> str:
    every: list[Density] = [study.best, *study.members]
    rows = [
        [
            claim,
            _word(study.triangle.claims()[claim]),
            _word(study.best.claims()[claim]),
            f"{sum(one.claims()[claim] for one in every)} of {len(every)}",
        ]
        for claim in study.best.claims()
    ]
    return table(["published claim", "triangle", "best", "members, the best included"], rows)


def page(study: Study, figures: str) -> str:
    """Write the study as Markdown; ``figures`` is the folder of its figures, relative to the page."""
    import jinja2

    text = resources.files("chemage_studies.density").joinpath("density.md.j2").read_text(encoding="utf-8")
    best, published = study.best, fit.PUBLISHED
    inside = (np.abs(best.beta / published - 1) <= fit.WITHIN_BETA).sum()
    close = np.abs(fit.ratios(best.beta) - fit.PUBLISHED_RATIOS) <= fit.WITHIN_RATIO
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(text)
    return filled(
        template.render(
            figures=figures,
            study=study,
            inside=int(inside),
            close=int(close.sum()),
            largest=100 * float(np.abs(best.beta / published - 1).max()),
            farthest=float(np.abs(fit.ratios(best.beta) - fit.PUBLISHED_RATIOS).max()),
            rates=_rates_table(study),
            ratios=_ratios_table(study),
            families=_families_table(study),
            members=_members_table(study),
            claims=_claims_table(study),
            surface=[100 * value for value in study.errors.surface],
            band=[
                100 * (max(one.beta[at] for one in study.members) / min(one.beta[at] for one in study.members) - 1)
                for at in range(6)
            ],
            best=dict(zip(study.family.parameters, best.parameters, strict=True)),
            interpolation=100 * study.interpolation_error,
            equal=fit.EQUAL,
            method=100 * fit.METHOD,
            triangle=study.triangle,
            satisfied={
                "all": len(best.claims()),
                "best": sum(best.claims().values()),
                "triangle": sum(study.triangle.claims().values()),
            },
        )
    )
