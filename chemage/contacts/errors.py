"""The errors of a solved contact by name: how far below and above a measure the truth may be, in its unit.

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

from chemage.contacts import patches
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
#: share of the area that is excess at its rim and c = (patches)^¼/(pixels in contact)^¾, by which the number of pixels
#: in a circle scatters: the corrected area is within RIM·e and COUNT·c of the area, other measures within a factor times
#: (e + c)^1.5, of the approach of the larger of itself and of √(area of a patch) times largest pressure over E*. To that
#: comes by how much the largest pressure may be exceeded between two pixels, above the approach the highest point of the
#: surface (``convergence["summit"]``), and where material flows, for the rms pressure, FLOWN of the error of the area.
#: Where a free surface touches at its edge, rms and largest pressure have no limit. Where bodies attract each other,
#: pressures count as their largest attraction at least (``convergence["attraction"]``), and COUNT and the error of the rms
#: pressure are 1 + PULLED·t as large, t being tension over pressure. A solver whose rim is less well known multiplies all
#: of them by ``convergence["pixel_factor"]``, and states in ``convergence["sticking"]`` the part of the area by which it
#: may be held by the grid
RIM, COUNT, FLOWN, PULLED = 0.03, 1.7, 0.17, 1.2
FACTORS = {"max_pressure": 0.9, "rms_pressure": 0.3, "displacement": 0.16}
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
            ends = size if isinstance(size, list) else [size] * 2
            down, up = (math.nan if end is None else float(end) for end in ends)
            if part == "branch":
                down, up = min(down, 0.0), max(up, 0.0)
            found.setdefault(name, {})[part] = abs(down), abs(up)
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
    area, corrected = contact.area, contact.corrected_area
    excess = 0.0
    if contact.contact_pixels != "centres":
        bare = patches.corrected_area(area, contact.perimeter, contact.pixel_size)
        excess = 1 - bare / area
    factor = float(contact.convergence.get("pixel_factor", 1.0))
    count = contact.patches**0.25 / contact.sites.size**0.75 if excess else 0.0
    stuck = float(contact.convergence.get("sticking", 0.0)) if excess else 0.0
    pulled = 1 + PULLED * _tension(contact)
    half = area * math.hypot(RIM * factor * excess, COUNT * pulled * count, stuck)
    found["area"]["pixel"] = (
        max(area - corrected + half, 0.0),
        max(corrected + half - area, 0.0),
    )
    attraction = contact.convergence.get("attraction", 0.0)
    covered = math.sqrt(contact.sites.size / contact.pressure.size)
    highest = max(float(np.abs(contact.pressure).max()), attraction)
    patch = math.sqrt(area / max(contact.patches, 1))
    flow = contact.plastic_displacement
    flows = flow is not None and bool(flow.any())
    rms = contact.rms_pressure
    lost = FLOWN * flows * found["area"]["pixel"][0] / area * rms
    approach = max(
        abs(contact.displacement or 0.0), patch * highest / contact.modulus
    )
    scales = {
        "max_pressure": (highest, contact.missed_peak, 0.0),
        "rms_pressure": (pulled * max(rms, attraction * covered), lost, 0.0),
        "displacement": (
            approach,
            0.0,
            contact.convergence.get("summit", 0.0),
        ),
    }
    for name, (scale, more, higher) in scales.items():
        half = factor * FACTORS[name] * (excess + count) ** 1.5 * scale
        both = math.hypot(half, more, stuck * scale)
        found[name]["pixel"] = (both, both + higher)
    if flows:
        found["max_pressure"]["pixel"] = (0.0, 0.0)
    elif not contact.periodic and _touches_edge(contact):
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
    below, above = (
        math.hypot(*(ends[side] for ends in parts.values())) for side in (0, 1)
    )
    if name not in found:
        low, high = max(area - below, contact.least_area), area + above
        if name == "mean_contact_pressure":
            low, high = (
                value * area / high,
                value * area / low if low > 0 else math.inf,
            )
        elif name == "corrected_area":
            low, high = min(low, value), 2 * value - min(low, value)
        else:
            low, high = value / area * low, value / area * high
        return quantity.within(
            low, high, (high - low) / 2 / NORMAL_LIMIT, stated="half_width"
        )
    least = {"area": contact.least_area, "load": 0.0}.get(name, -math.inf)
    low, high = max(value - below, least), value + above
    return quantity.within(
        low,
        high,
        (high - low) / 2 / NORMAL_LIMIT,
        stated="half_width",
        errors={
            part: ErrorPart(
                (down + up) / 2 / NORMAL_LIMIT,
                how.get(part, "stated by the solver"),
            )
            for part, (down, up) in parts.items()
        },
    )
