"""What is shown first of a result: the numbers of one ordered list, in a table of at most 12 lines; ``--all`` shows the
rest."""

from __future__ import annotations

from collections.abc import Sequence

from chemage.foundation.outputs import RECORDED
from chemage.foundation.quantities import Quantity, Rank, by_name
from chemage.foundation.result import Result

#: the number by which a kind of result is known -> the names of those that are shown first, in order. Of other kinds
#: all is shown
FIRST = {
    "friction_drop": (
        "beta",
        "friction_coefficient_drop",
        "friction_drop",
        "area",
        "area_fraction",
        "mean_contact_pressure",
        "patches",
        "beta_scatter_between_surfaces",
    ),
    "area": (
        "area",
        "area_fraction",
        "kappa",
        "mean_contact_pressure",
        "patches",
        "perimeter_to_area",
        "load",
    ),
}


def first_numbers(result: Result) -> list[Quantity]:
    """Those of the list, curves at their last point, and what was recorded, or asked of a mean; what is not known comes
    last, with the reason. None of a kind of result without a list."""
    curves = [curve for curve in result.curves() if not curve.is_distribution]
    found = by_name([*(curve.last() for curve in curves), *result.quantities()])
    listed = next((names for name, names in FIRST.items() if name in found), ())
    goals = getattr(getattr(result, "record", None), "goals", ())
    more = [
        one.name
        for one in found.values()
        if one.rank <= Rank.TABLE
        and (one.name.startswith(RECORDED) or one.name in goals or "@" in one.name)
    ]
    names = dict.fromkeys((*listed, *more) if listed else ())
    chosen = [found[name] for name in names if name in found]
    return sorted(chosen, key=lambda one: not one.known)


def beside(several: Sequence[Sequence[Quantity]]) -> list[list[Quantity | None]]:
    """The numbers of several results in rows, without what does not fit beside others."""
    every = [by_name(numbers) for numbers in several]
    names = dict.fromkeys(name for numbers in every for name in numbers)
    return [
        [
            None
            if one is None
            else one.but(
                of=one.of * one.of.startswith("at "),
                reason=one.reason.partition(":")[0] * (not one.known),
            )
            for one in (numbers.get(name) for numbers in every)
        ]
        for name in names
    ]
