"""An ensemble in words: its estimates with their intervals, and the parts of their errors by name."""

from __future__ import annotations

import math

from chemage.foundation.approximations import in_words
from chemage.foundation.text import percent, plus_minus
from chemage.studies.ensembles.ensemble import SOURCES, Ensemble, Estimate
from chemage.studies.ensembles.goals import column_of

#: what every ± of an ensemble is
TITLE = "± is half the width of a 95 % interval"
#: relative differences that rounding makes
EXACT = 1e-12

Rows = list[tuple[str, str]]


def rows(made: Ensemble) -> Rows:
    """What was averaged, the main estimates with their intervals, and the parts of the error of the first."""
    names = made.quantities.names
    found = averaged(made)
    if "beta" in names:
        found.append(("beta", text(made, "beta", None, "per decade") + _fitted(made)))
        one = made.b
        found.append(("b = beta/ln 10", plus_minus(one.value, one.half_width, "per e-fold")))
    for curve, unit in (("friction_drop", "nN"), ("friction_coefficient_drop", "")):
        if curve in names:
            for time in moments(made):
                found.append((f"{curve.replace('_', ' ')} at {time:g} s", text(made, curve, time, unit)))
    if "area_fraction" in names:
        found.append(("area fraction A/A0", text(made, "area_fraction")))
    found += [(name.replace("_", " "), text(made, name)) for name in _asked_measures(made)]
    for part, size, how in errors(made.estimate(names[0])):
        shown = f"{size} (standard error)" if size.endswith("%") else size
        found.append((f"error of {names[0]}: {part}", f"{shown}, {how}"))
    if approximate := in_words(made.approximate):
        found.append(("approximate", approximate))
    found += [(f"plugin {name}", source) for name, source in made.plugins.items()]
    if made.stopped:
        found.append(("ended because", made.stopped))
    return found


def over(made: Ensemble) -> str:
    """What the mean is over, in few words."""
    if made.controlled:
        return f"{made.surfaces} surfaces and {made.levels[-1]['samples']} sketches"
    return f"{made.surfaces} surfaces" if made.random else f"{made.surfaces} replicas on one surface"


def averaged(made: Ensemble) -> Rows:
    """What was averaged, with its grids and replicas."""
    first, *others = made.levels
    mean = f"{first['samples']} random surfaces: {first['words']} each"
    if not made.random:
        mean = f"{first['samples']} replicas on the one surface: {first['words'].partition(',')[0]}"
    found = [("mean over", mean)]
    for level in others:
        if level.get("control"):
            found.append(("regressed on", f"the area of the contact of {level['samples']} surfaces: {level['words']}"))
            continue
        found.append(("corrected by", f"{level['samples']} of these differences: {level['words']}"))
    return found


def errors(one: Estimate) -> list[tuple[str, str, str]]:
    """The parts of the error of an estimate: what each is due to, its standard error, and how it is known."""
    found = []
    for part, error in one.errors.items():
        size = error.size / abs(one.value) if one.value else math.nan
        shown = percent(size) if math.isfinite(size) else "not known"
        found.append((SOURCES.get(part, part), shown, error.how))
    return found


def moments(made: Ensemble) -> list[float]:
    """The hold times that are shown: the last, and those that were asked for."""
    if not made.hold_times.size:
        return []
    first = int(made.quantities.has_beta)
    columns = [column_of(name, made.quantities) - first for name in made.goals]
    asked = {number for number in columns if 0 <= number < made.hold_times.size}
    return [float(made.hold_times[number]) for number in sorted({*asked, made.hold_times.size - 1})]


def _asked_measures(made: Ensemble) -> list[str]:
    """Measures of the contact that were asked for and are not shown in any case."""
    return [name for name in made.quantities.measures if name in made.goals and name != "area_fraction"]


def text(made: Ensemble, name: str, time: float | None = None, unit: str = "") -> str:
    """An estimate with its interval, and what was asked for."""
    one = made.estimate(name, time)
    shown = interval_text(one, unit)
    if math.isfinite(one.relative) and one.half_width > EXACT * abs(one.value):
        shown += f", ± {percent(one.relative)}" if one.relative < 1 else ", not distinguishable from 0"
    asked = [goal for goal in made.goals if _is_about(made, goal, name, time)]
    return shown + "".join(f" ({100 * made.goals[goal]:.3g} % asked)" for goal in asked)


def interval_text(one: Estimate, unit: str = "") -> str:
    """An estimate with its interval, or why there is none."""
    if not math.isfinite(one.value):
        return "-"
    if one.half_width <= EXACT * abs(one.value) or not any(part.size != 0 for part in one.errors.values()):
        return f"{one.value:.4g} {unit}".strip() + ", the same in all samples"
    shown = plus_minus(one.value, one.half_width, unit)
    if math.isnan(one.half_width):
        unknown = [SOURCES.get(part, part) for part, error in one.errors.items() if math.isnan(error.size)]
        shown += f", interval not known{': ' * bool(unknown)}{', '.join(unknown)}"
    return shown


def _fitted(made: Ensemble) -> str:
    return ", {} hold times from {:g} to {:g} s".format(int(made.quantities.fitted.sum()), *made.quantities.span)


def _is_about(made: Ensemble, goal: str, name: str, time: float | None) -> bool:
    """Whether a goal is about this quantity at this hold time."""
    same = goal.partition("@")[0].strip() == name
    return same and column_of(goal, made.quantities) == made.quantities.column(name, time)
