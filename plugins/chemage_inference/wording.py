"""An inference in words: what was measured and is visible, the shape of the density, families, and forecasts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from chemage.plugin import text as words
from chemage_inference.forecast import UNSEEN, WIDE, Forecast, band
from chemage_inference.result import (
    EXCLUDED,
    Inference,
)
from chemage_inference.shape import (
    between,
    empty,
    peaks,
    rises,
    trend,
    unresolved,
)

#: (name, text)
Rows = list[tuple[str, str]]
#: what stands for a number that is not known
NONE = "-"
#: samples that have to agree on a slope
SURE = 0.95
#: scores that differ by less do not tell two models apart
APART = 2.0
#: name of the smooth density among the scores
SMOOTH = "density"
#: planned measurements that are shown
MOST_EXPERIMENTS = 5


def facts(one: Inference) -> Rows:
    """What the numbers are of; medians, and intervals of 90 % of the posterior."""
    count, times, kept = len(one.curves), one.hold_times, len(one.samples)
    low, high = one.visible_range
    worst = int(np.abs(one.residuals).argmax())
    conditions = [
        f"{times.size} points of {count} curve{'s' if count > 1 else ''}",
        f"{words.power_text(times.min())} to {words.power_text(times.max())} s",
        _several([curve["load"] for curve in one.curves], "nN"),
        _several([curve["temperature"] for curve in one.curves], "K"),
    ]
    visible = "none: at every energy the band is as wide as that of the prior"
    if one.visible.any():
        visible = f"{low:.3f} to {high:.3f} eV, resolution {one.resolution:.3f} eV"
    samples = (
        "{} kept, {effective_samples:.0f} effective, R-hat {r_hat:.3f}; seed {}"
    )
    rows = {
        "measured": ", ".join(conditions),
        "visible energies": visible,
        "density": density_text(one) if one.visible.any() else "",
        "largest residual": f"{one.residuals[worst]:+.1f} standard errors at {words.power_text(times[worst])} s",
        "suspect points": "; ".join(one.suspects()),
        "samples": samples.format(kept, one.seed, **one.diagnostics),
    }
    return [(name, text) for name, text in rows.items() if text]


def density_text(one: Inference) -> str:
    """The peaks that the data support, or how the density runs."""
    if not one.visible.any():
        return "nothing is visible"
    below, inside, above = (
        band(part, WIDE)[1] for part in between(one, one.visible_range)
    )
    if empty(one):
        sides = [
            side
            for side, most in (("below", below), ("above", above))
            if most > 0.01
        ]
        share = "0.1" if inside < 1e-3 else f"{100 * inside:.1f}"
        return f"hardly any inside (at most {share} % of the sites); barriers lie {' and '.join(sides)}"
    unsure = "".join(
        f"; the maximum at {energy:.3f} eV is not resolved"
        for energy in unresolved(one)
    )
    step = one.energies[1] - one.energies[0]
    if places := [peak.text(step) for peak in peaks(one)]:
        *others, last = places
        found = f"one peak at {last}"
        if others:
            found = f"{len(places)} peaks: {', '.join(others)} and {last}"
        sides = zip(("lower", "upper"), rises(one), strict=True)
        if ends := " and the ".join(end for end, up in sides if up):
            found += f"; rises again towards the {ends} end"
        return found + unsure
    up, down = trend(one)
    run = "rises" if up >= SURE else "falls" if down >= SURE else ""
    towards = (
        f"{run} towards the upper end of the visible energies"
        if run
        else "flat within the band"
    )
    return f"no peak {'that the data support' if unsure else 'inside'}; {towards}{unsure}"


def family_rows(one: Inference) -> list[tuple[str, str, str, str]]:
    """Models by their score, the best first: (name, score less that of the best, χ², parameters)."""
    if not one.scores:
        return []
    best = max(one.scores.values())
    rows = []
    for name, score in sorted(one.scores.items(), key=lambda item: -item[1]):
        less = "best" if score == best else f"{score - best:.1f}"
        if name == SMOOTH:
            rows.append(("smooth density", less, f"{one.chi2:.1f}", "as above"))
            continue
        fit = one.families.get(name, {})
        chi2 = f"{fit['chi2']:.1f}" if fit else ""
        about = _parameters(fit) if best - score <= EXCLUDED else "excluded"
        rows.append((name, less, chi2, about))
    return rows


def family_verdict(one: Inference) -> list[str]:
    """What the scores say, a sentence; none without scores."""
    if len(one.scores) < 2:
        return []
    best = max(one.scores.values())
    close = [name for name, score in one.scores.items() if best - score < APART]
    *others, last = (
        "the smooth density" if name == SMOOTH else name for name in close
    )
    if not others:
        return [f"Hold times that were left out are predicted best by {last}."]
    return [
        f"The data do not tell apart {', '.join(others)} and {last}: scores within {APART:g}."
    ]


def forecast_row(label: str, one: Forecast) -> tuple[str, str, str, str]:
    """(label, median of ΔF at the last hold time, its 68 and 90 % bands), or only bounds of 90 %."""
    name = f"{label} at {words.power_text(one.hold_times[-1])} s{unseen_text(one)}"
    inner, outer = (
        "{:.4g} to {:.4g}".format(*(end[-1] for end in one.band(level)))
        for level in (0.68, WIDE)
    )
    if one.bounds_only:
        return name, NONE, NONE, outer
    return name, f"{one.median[-1]:.4g} nN", inner, outer


def unseen_text(one: Forecast) -> str:
    """The largest share of a forecast that comes from energies which the data do not see, where it matters."""
    if one.unseen <= UNSEEN:
        return ""
    alone = ": bounds only" if one.bounds_only else ""
    return f" (up to {100 * one.unseen:.0f} % unseen{alone})"


def experiment_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    """(planned measurement, expected reduction of the variance, standard deviation afterwards)."""
    plan = [f"{words.power_text(float(one['hold_time']))} s"]
    for name, unit in (("load", "nN"), ("temperature", "K")):
        if name in one:
            plan.append(f"{one[name]:g} {unit}")
    falls, deviation = f"{100 * one['reduction']:.0f} %", f"{one['deviation']:.3g}"
    return ", ".join(plan), falls, deviation


def _parameters(fit: Mapping[str, Any]) -> str:
    texts = []
    for name, value in fit.get("parameters", {}).items():
        word, _, unit = name.removesuffix(")").partition(" (")
        error = fit["errors"].get(name, math.nan)
        texts.append(f"{word} {words.plus_minus(value, error, unit)}")
    return "; ".join(texts) if len(texts) <= 3 else f"{len(texts)} weights"


def _several(values: list[float], unit: str) -> str:
    different = sorted(set(values))
    if len(different) > 3:
        return f"{different[0]:g} to {different[-1]:g} {unit}"
    return f"{', '.join(f'{value:g}' for value in different)} {unit}"
