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


def title(one: Inference) -> str:
    """What was inferred from what."""
    names = ", ".join(dict.fromkeys(curve["name"] for curve in one.curves))
    return f"Density of forming barriers inferred from {names if len(names) < 40 else 'measured curves'}"


def facts(one: Inference) -> Rows:
    """What the numbers are of; medians, and intervals of 90 % of the posterior."""
    facts_ = [
        ("measured", measured_text(one)),
        ("visible energies", visible_text(one)),
        *([("density", density_text(one))] if one.visible.any() else []),
    ]
    facts_.append(("largest residual", _largest_residual(one)))
    if suspects := one.suspects():
        facts_.append(("suspect points", "; ".join(suspects)))
    kept, sampling = len(one.samples), one.diagnostics
    text = "{} kept, {effective_samples:.0f} effective, R-hat {r_hat:.3f}; seed {}"
    return [*facts_, ("samples", text.format(kept, one.seed, **sampling))]


def measured_text(one: Inference) -> str:
    """Curves, points and conditions."""
    count = len(one.curves)
    loads = _several([curve["load"] for curve in one.curves], "nN")
    temperatures = _several([curve["temperature"] for curve in one.curves], "K")
    times = f"{words.power_text(one.hold_times.min())} to {words.power_text(one.hold_times.max())} s"
    curves = f"{count} curve{'s' if count > 1 else ''}"
    return f"{one.hold_times.size} points of {curves}, {times}, {loads}, {temperatures}"


def visible_text(one: Inference) -> str:
    """The range of energies that the data see."""
    low, high = one.visible_range
    if not math.isfinite(low):
        return "none: at every energy the band is as wide as that of the prior"
    return f"{low:.3f} to {high:.3f} eV, resolution {one.resolution:.3f} eV"


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
    there = peaks(one)
    unsure = "".join(
        f"; the maximum at {energy:.3f} eV is not resolved"
        for energy in unresolved(one)
    )
    places = [peak.text(one.energies[1] - one.energies[0]) for peak in there]
    if places:
        ends = [
            end
            for end, up in zip(("lower", "upper"), rises(one), strict=True)
            if up
        ]
        more = (
            f"; rises again towards the {' and the '.join(ends)} end"
            if ends
            else ""
        )
        if len(places) > 1:
            return f"{len(places)} peaks: {', '.join(places[:-1])} and {places[-1]}{more}{unsure}"
        return f"one peak at {places[0]}{more}{unsure}"
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
    rows_ = []
    for name, score in sorted(one.scores.items(), key=lambda item: -item[1]):
        fit: Mapping[str, Any] = one.families.get(name, {})
        less = "best" if score == best else f"{score - best:.1f}"
        if name == SMOOTH:
            rows_.append(("smooth density", less, f"{one.chi2:.1f}", "as above"))
            continue
        chi2 = f"{fit['chi2']:.1f}" if "chi2" in fit else ""
        rows_.append(
            (
                name,
                less,
                chi2,
                _parameters(fit) if best - score <= EXCLUDED else "excluded",
            )
        )
    return rows_


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
    low68, high68 = one.band(0.68)
    low90, high90 = one.band(WIDE)
    name = f"{label} at {words.power_text(one.hold_times[-1])} s{unseen_text(one)}"
    ends = f"{low90[-1]:.4g} to {high90[-1]:.4g}"
    if one.bounds_only:
        return name, NONE, NONE, ends
    return (
        name,
        f"{one.median[-1]:.4g} nN",
        f"{low68[-1]:.4g} to {high68[-1]:.4g}",
        ends,
    )


def unseen_text(one: Forecast) -> str:
    """The largest share of a forecast that comes from energies which the data do not see, where it matters."""
    if one.bounds_only:
        return f" (up to {100 * one.unseen:.0f} % unseen: bounds only)"
    return (
        f" (up to {100 * one.unseen:.0f} % unseen)" if one.unseen > UNSEEN else ""
    )


def experiment_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    """(planned measurement, expected reduction of the variance, standard deviation afterwards)."""
    falls, deviation = f"{100 * one['reduction']:.0f} %", f"{one['deviation']:.3g}"
    return experiment_text(one), falls, deviation


def experiment_text(one: Mapping[str, Any]) -> str:
    """A planned measurement in words."""
    text = f"{words.power_text(float(one['hold_time']))} s"
    for name, unit in (("load", "nN"), ("temperature", "K")):
        if name in one:
            text += f", {one[name]:g} {unit}"
    return text


def _parameters(fit: Mapping[str, Any]) -> str:
    values, errors = fit.get("parameters", {}), fit.get("errors", {})
    texts = []
    for name, value in values.items():
        word, _, unit = name.partition(" (")
        texts.append(
            f"{word} {words.plus_minus(value, errors.get(name, math.nan), unit.removesuffix(')'))}"
        )
    return "; ".join(texts) if len(texts) <= 3 else f"{len(texts)} weights"


def _several(values: list[float], unit: str) -> str:
    different = sorted(set(values))
    if len(different) > 3:
        return f"{different[0]:g} to {different[-1]:g} {unit}"
    return f"{', '.join(f'{value:g}' for value in different)} {unit}"


def _largest_residual(one: Inference) -> str:
    residuals = one.residuals
    at = int(np.abs(residuals).argmax())
    return f"{residuals[at]:+.1f} standard errors at {words.power_text(one.hold_times[at])} s"
