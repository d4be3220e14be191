"""The load at which the mean contact pressure is a given one, by a bracketed search over contacts."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, Self, TypeVar

from chemage.contacts.solution import Contact, ContactSolution
from chemage.foundation.errors import InputError

#: what follows a pressure that is the mean over the contact and not over the nominal area
OVER = "over contact"
#: relative error of the pressure to which a search is held, on few pixels half of one of them; the number of pixels that
#: a contact of a symmetric grid may gain at once, and the largest error that these may excuse
TOLERANCE, AT_ONCE, LARGEST = 1e-3, 8, 0.1
#: logarithms of loads from which the slope of the pressure is taken differ by so much: pixels are steps
APART = 1.0
#: how much less the slope may be than between them, beside what the error of the area makes of it: so that 68 of 72
#: spheres have the load of Hertz in their interval
CURVED = 1.4
#: steps until the load is bracketed, and the longest of them, of the logarithm of the load
STEPS, LONGEST = 12, math.log(16)
#: contacts of a search, as measured on rough surfaces
CONTACTS = 6
_C = TypeVar("_C", bound=Contact)


def crossing(excess: Callable[[float], float], x: float) -> float:
    """Where ``excess``, which grows, vanishes, near ``x``; if it jumps there, within :data:`TOLERANCE`."""
    from scipy.optimize import brentq

    # the mean pressure of a sphere grows with the third root of the load, others more slowly
    here, power = excess(x), 3.0
    for _ in range(STEPS):
        last, below = x, here
        x -= min(max(power * here, -LONGEST), LONGEST)
        here, power = excess(x), 2 * power
        if abs(here) < 1e-9 or 0 < abs(here - below) < TOLERANCE * abs(x - last):
            break
        if here * below < 0:
            root: object = brentq(excess, last, x, xtol=TOLERANCE)
            assert isinstance(root, float)
            return root
    return x


class SoughtLoad(float):
    """The load (nN) that is expected to give a mean contact pressure; the contact is solved under the one that does."""

    #: GPa
    pressure: float

    @classmethod
    def of(
        cls,
        pressure: float,
        area: Callable[[float], float],
        begin: float,
        least: float,
    ) -> Self:
        """That at which ``area(load)`` (nm²), which is about ``begin`` and at ``least`` a pixel, bears ``pressure``."""
        found = crossing(
            lambda x: x - math.log(pressure * area(math.exp(x))),
            math.log(pressure * begin),
        )
        new = cls(max(math.exp(found), pressure * least))
        new.pressure = pressure
        return new

    @property
    def written(self) -> str:
        """As it is written in a scene."""
        return f"{self.pressure!r} GPa {OVER}"

    def found(
        self,
        solve: Callable[[float, _C | None], _C],
        start: _C | None = None,
    ) -> _C:
        """The contact of this mean pressure, of those that ``solve(load, neighbour)`` gives.

        What was asked, reached, and how, is in its notes and its ``provenance``. Its load has the errors of the pressure
        that was reached and of the area, over the slope of the pressure with the load (both as logarithms).

        Raises
        ------
        InputError
            No contact has this pressure: the surface or the solver does not allow it, or it is left out by a jump.
        """
        # a contact may be large: the last one and the best one are kept
        offs: dict[float, float] = {}
        refused, last, best = InputError(""), start, start

        @cache
        def excess(x: float) -> float:
            nonlocal refused, last, best
            try:
                # few digits, so that the load does not depend on the rounding of a library
                last = solve(float(f"{math.exp(x):.7g}"), last)
            except InputError as error:
                # such as beyond the edge of the grid: too much load
                refused = error
                return 1.0
            off = math.log(max(last.mean_contact_pressure, 1e-300) / self.pressure)
            if abs(off) < min(map(abs, offs.values()), default=math.inf):
                best = last
            offs[x] = off
            return 0.0 if abs(off) <= max(TOLERANCE, 0.5 / _pixels(last)) else off

        at = crossing(excess, math.log(self))
        if not offs or best is None:
            raise refused
        if max(offs) - min(offs) < APART:
            excess(at - APART)
        at, off = min(offs.items(), key=lambda one: abs(one[1]))
        contact = best
        held = max(TOLERANCE, min(AT_ONCE / _pixels(contact), LARGEST))
        reached = contact.mean_contact_pressure
        if abs(off) > held:
            why = f"is not reached: the nearest is {reached:.4g} GPa at {contact.load:.4g} nN"
            if str(refused):
                why += f", and more load is refused ({refused})"
            remedy = "give another pressure, or a force"
            raise InputError.of("load", self.written, why, remedy)
        note = (
            f"mean contact pressure {reached:.6g} GPa ({self.pressure:.6g} GPa asked for, held to {100 * held:.2g} %) at "
            f"a load of {contact.load:.6g} nN, found in {len(offs)} contacts"
        )
        sought = {
            "mean_contact_pressure": self.pressure,
            "reached": reached,
            "tolerance": held,
            "load": contact.load,
            "contacts": len(offs),
        }
        update = {
            "notes": (*contact.notes, note),
            "provenance": {**contact.provenance, "sought": sought},
        }
        if isinstance(contact, ContactSolution):
            far = max(offs, key=lambda x: abs(x - at))
            slope = abs((offs[far] - off) / (far - at)) if far != at else 0.0
            errors = _load_errors(contact, off, slope, abs(far - at))
            told = contact.convergence
            told = {**told, "errors": {**told.get("errors", {}), "load": errors}}
            update["convergence"] = told
        return contact.model_copy(update=update)


def _load_errors(
    contact: ContactSolution, off: float, slope: float, apart: float
) -> dict[str, Any]:
    """How far the load (nN) may be, by how far the logarithm of the pressure is ``off``, and by the area, where the
    pressure grows with a ``slope``, known from contacts whose logarithms of loads are so far ``apart``."""
    # of a copy: a contact keeps what it has computed of its errors
    area = contact.model_copy().quantity("area")
    if not slope or not 0 < area.low < area.high:
        return {"search": None, "area": None}
    unsure = math.sqrt(2) * area.half_width / contact.area / apart
    power = min((CURVED + 2 * unsure / slope) / slope, 99.0)
    search, *ends = (
        contact.load * (ratio**power - 1)
        for ratio in (
            math.exp(abs(off)),
            min(area.low / contact.area, 1.0),
            max(area.high / contact.area, 1.0),
        )
    )
    return {"search": search, "area": ends}


def _pixels(contact: Contact) -> float:
    """In contact; without a map an area has no smallest part."""
    return contact.sites.size if isinstance(contact, ContactSolution) else math.inf
