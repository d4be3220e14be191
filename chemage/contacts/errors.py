"""The errors of a solved contact by name: how far below and above a measure the truth may be, in its unit; less than zero
where pixels make it too large or too small.

Each is half of a 95 % interval: ``iteration``, what the solver left undone; ``pixel``, what smaller pixels would
change; ``branch``, where the surfaces adhere, what the contact reached from the other side has. A solver states its own
in ``convergence["errors"]``, measure -> error -> one number, or two, of which a sign says the side; the rest follows
from the pressure here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from chemage.foundation.quantities import ErrorPart, Quantity
from chemage.foundation.statistics import NORMAL_LIMIT

#: a :class:`chemage.contacts.solution.ContactSolution`, whose module imports this one
ContactSolution: TypeAlias = Any

#: how each is known
HOW = {
    "iteration": "estimated by the solver",
    "pixel": "calibrated on other contacts",
    "branch": "the contact from the other side",
}
#: of a load that was sought
HOW_SOUGHT = {
    "search": "the mean contact pressure that was reached",
    "area": "the error of the contact area",
}
#: the same of a closed form
HOW_EXACT = {
    "iteration": "a closed form",
    "pixel": "the difference from the closed form",
}
#: measures with errors of their own; those of others follow from the area
MEASURES = ("area", "max_pressure", "rms_pressure", "displacement")
#: those that follow from it
OF_AREA = ("area_fraction", "corrected_area", "kappa", "mean_contact_pressure")
#: calibrated on contacts at a pixel and at a quarter of it (``tests/benchmarks/contact_errors.py intervals``), with e the
#: share of the area that is excess at its rim, and c the root of the rim's length over the contact area, both in pixels, as
#: which a rim of independent pixels scatters. The interval of the area is about the area without 1 − OVER of that excess,
#: and need not contain that on the grid; RIM·e and COUNT·c are its half width. OVER and that are twice as large for a single
#: patch, whose pixels are not independent, and for a free surface that touches at its edge. Those of other measures are
#: about a value that is higher by the first of OF_RIM, and have the second as half width, times (e + c)^1.5 and the
#: measure; of the approach, the larger of itself and of √(area of a patch) times largest pressure over E*. To that comes by
#: how much the largest pressure may be exceeded between two pixels, above the approach TOP of what pixels miss of the
#: highest point (``convergence["summit"]``), and where material flows, for the rms pressure, FLOWN (e + c). Where a free
#: surface touches at its edge, the approach is half as well known, and rms and largest pressure have no limit; half as well
#: known is the rms pressure of a single patch. Where bodies attract each other, pressures count as their largest attraction
#: at least (``convergence["attraction"]``), and half widths but that of the area are 1 + PULLED·t as large, t being tension
#: over pressure. A solver whose rim is less well known multiplies RIM by ``convergence["pixel_factor"]``
OVER, RIM, COUNT, FLOWN, PULLED, TOP = 0.05, 0.09, 0.5, 0.15, 5.0, 0.7
OF_RIM = {
    "max_pressure": (0.12, 0.35),
    "rms_pressure": (0.05, 0.14),
    "displacement": (0.1, 0.101),
}
#: below and above
Ends = tuple[float, float]


def errors(contact: ContactSolution) -> dict[str, dict[str, Ends]]:
    """The errors of ``contact``: measure -> name -> how far below and above; nan: not known."""
    if not contact.sites.size:
        return {}
    found = {name: {"iteration": (math.nan, math.nan)} for name in MEASURES}
    _iteration(contact, found)
    _pixel(contact, found)
    stated: Mapping[str, Mapping[str, Any]] = contact.convergence.get("errors", {})
    for name, parts in stated.items():
        for part, size in parts.items():
            size = math.nan if size is None else size
            if part == "branch":
                size = [min(size, 0.0), max(size, 0.0)]
            low, up = size if isinstance(size, list) else (-size, size)
            found.setdefault(name, {})[part] = -low, up
    return found


def _iteration(contact: ContactSolution, found: dict[str, dict[str, Ends]]) -> None:
    """From what the solver says of its pressure and of its gap."""
    told = contact.convergence
    norm, most = told.get("pressure_error"), told.get("pressure_error_max")
    if not isinstance(norm, int | float):
        return
    rms, highest = contact.rms_pressure, contact.max_pressure
    # in doubt are the pixels that bear less than three times the error
    typical = 3 * norm * rms * math.sqrt(contact.pressure.size / contact.sites.size)
    few = np.count_nonzero(np.abs(contact.pressure[contact.contact]) < typical)
    sizes = {
        "area": float(few) * contact.pixel_size**2,
        "rms_pressure": norm * rms,
        "max_pressure": (norm if most is None else most) * highest,
    }
    if contact.displacement is not None:
        gap = max(told.get("rms_gap", norm), told.get("penetration", 0.0))
        sizes["displacement"] = gap * told.get("scale", abs(contact.displacement))
    for name, size in sizes.items():
        found[name]["iteration"] = (size, size)


def _pixel(contact: ContactSolution, found: dict[str, dict[str, Ends]]) -> None:
    """From the share of the area that is at the rim."""
    area, told = contact.area, contact.convergence
    excess = 1 - contact.corrected_area / area
    factor = float(told.get("pixel_factor", 1.0))
    count = 0.0
    if contact.contact_pixels != "centres":
        count = math.sqrt(contact.perimeter * contact.pixel_size**3) / area
    cut = not contact.periodic and _touches_edge(contact)
    alone = contact.patches == 1
    wide = 2 if cut or alone else 1
    half = wide * math.hypot(RIM * factor * excess, COUNT * count) * area
    shift = (wide * OVER - 1) * excess * area
    found["area"]["pixel"] = (half - shift, half + shift)
    attraction = told.get("attraction", 0.0)
    covered = math.sqrt(contact.sites.size / contact.pressure.size)
    highest = max(float(np.abs(contact.pressure).max()), attraction)
    patch = math.sqrt(area / max(contact.patches, 1))
    flow = contact.plastic_displacement
    flows = flow is not None and bool(flow.any())
    approach = max(
        abs(contact.displacement or 0.0), patch * highest / contact.modulus
    )
    rms = max(contact.rms_pressure, attraction * covered)
    rim = excess + count
    pulled = 1 + PULLED * _tension(contact)
    scales = {
        "max_pressure": (highest, contact.missed_peak, 0.0),
        "rms_pressure": (rms, FLOWN * flows * rim * rms, 0.0),
        "displacement": (approach, 0.0, TOP * told.get("summit", 0.0)),
    }
    for name, (scale, more, higher) in scales.items():
        shift, half = (part * rim**1.5 * scale for part in OF_RIM[name])
        half *= pulled * (2 if cut or (alone and name == "rms_pressure") else 1)
        half = math.hypot(half, more)
        found[name]["pixel"] = (half - shift, half + shift + higher)
    if flows:
        found["max_pressure"]["pixel"] = (0.0, 0.0)
    elif cut:
        for name in ("max_pressure", "rms_pressure"):
            found[name]["pixel"] = (math.nan, math.nan)


def _tension(contact: ContactSolution) -> float:
    """The force that pulls over the one that presses, at most 1."""
    pull = -float(np.minimum(contact.pressure, 0).sum())
    pressed = float(np.maximum(contact.pressure, 0).sum())
    return min(pull / pressed, 1.0) if pressed else 0.0


def _touches_edge(contact: ContactSolution) -> bool:
    there = contact.contact
    return bool(there[[0, -1]].any() or there[:, [0, -1]].any())


def stated(contact: ContactSolution, quantity: Quantity) -> Quantity:
    """``quantity`` of ``contact`` with its errors, and with the interval that they make together."""
    name, value, area = quantity.name, quantity.value, contact.area
    found = contact.errors
    how = HOW_SOUGHT | (HOW_EXACT if contact.contact_pixels == "centres" else HOW)
    parts = found.get(name) or (found.get("area") if name in OF_AREA else None)
    if not parts or not quantity.known or not value:
        return quantity
    # a part that ends on one side of the value moves the interval, and widens it on the other side
    shift = sum(min(up, 0.0) - min(down, 0.0) for down, up in parts.values())
    wide = [
        (max(down + min(up, 0.0), 0.0), max(up + min(down, 0.0), 0.0))
        for down, up in parts.values()
    ]
    below, above = (math.hypot(*ends) for ends in zip(*wide, strict=True))
    below, above = below - shift, above + shift
    if name not in found:
        low, high = max(area - below, contact.least_area), area + above
        if name == "mean_contact_pressure":
            low, high = (
                value * area / high,
                value * area / low if low > 0 else math.inf,
            )
        elif name != "corrected_area":
            low, high = value / area * low, value / area * high
        return quantity.within(
            low, high, (high - low) / 2 / NORMAL_LIMIT, stated="ends"
        )
    least = {"area": contact.least_area, "load": 0.0}.get(name, -math.inf)
    low, high = max(value - below, least), value + above
    return quantity.within(
        low,
        high,
        (high - low) / 2 / NORMAL_LIMIT,
        stated="ends",
        errors={
            part: ErrorPart(
                (down + up) / 2 / NORMAL_LIMIT,
                how.get(part, "stated by the solver"),
            )
            for part, (down, up) in parts.items()
        },
    )
