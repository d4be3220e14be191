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

from chemage.foundation.quantities import ErrorPart, Quantity, number_text
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
#: Pressures at a rim are the same that differ by less than this share of what as many different ones would; of m that are,
#: the count scatters ALIKE √m as much, for a straight rim may be anywhere between two lines of pixels (closed forms of
#: tips and waves). Each pixel that may hide a gap has a rim of four.
SAME, ALIKE = 0.2, 1.2
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
    flow = contact.plastic_displacement
    flows = flow is not None and bool(flow.any())
    limit = contact.pressure.max() if flows else math.inf
    count, alike = 0.0, 1.0
    if contact.contact_pixels != "centres":
        edge, hidden = _rim(contact)
        # where material flows, all pressures are the same
        alike = _alike(contact.pressure[edge & (contact.pressure < limit)])
        edges = contact.perimeter / contact.pixel_size + 4 * hidden
        count = math.sqrt(edges) / contact.sites.size
    cut = not contact.periodic and _touches_edge(contact)
    alone = contact.patches == 1
    wide = 2 if cut or alone else 1
    scatter = max(wide, alike) * COUNT * count
    half = math.hypot(wide * RIM * factor * excess, scatter) * area
    shift = (wide * OVER - 1) * excess * area
    found["area"]["pixel"] = (half - shift, half + shift)
    attraction = told.get("attraction", 0.0)
    covered = math.sqrt(contact.sites.size / contact.pressure.size)
    highest = max(float(np.abs(contact.pressure).max()), attraction)
    patch = math.sqrt(area / max(contact.patches, 1))
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


def _rim(contact: ContactSolution) -> tuple[np.ndarray, int]:
    """The pixels (nx, ny) at the rim of the contact, and how many others may hide a gap smaller than themselves: those
    that bear less than half the mean pressure of their four neighbours, which is what a parabola that touches zero
    between pixels leaves, twice over."""
    mode = "wrap" if contact.periodic else "edge"
    touching: np.ndarray = contact.contact
    pressure: np.ndarray = contact.pressure
    there, borne = (np.pad(x, 1, mode) for x in (touching, pressure))
    within, around = touching.copy(), np.zeros(pressure.shape)
    for shift, axis in ((0, 0), (2, 0), (0, 1), (2, 1)):
        beside = [slice(1, -1), slice(1, -1)]
        beside[axis] = slice(shift, shift + pressure.shape[axis])
        within &= there[tuple(beside)]
        around += borne[tuple(beside)]
    if contact.touching is not None:  # tension needs no gap nearby
        return touching & ~within, 0
    hidden = within & (pressure < around / 8)
    return touching & ~within | hidden, int(np.count_nonzero(hidden))


def _alike(pressures: np.ndarray) -> float:
    """By how much the count of pixels at a rim scatters more than that of independent ones: those that a symmetry of
    surface and pixels makes alike, which have the same pressure, are counted or missed together."""
    if not pressures.size:
        return 1.0
    steps = np.diff(np.sort(pressures), prepend=-math.inf)
    distinct = np.count_nonzero(
        steps > SAME * np.median(pressures) / pressures.size
    )
    each = pressures.size / distinct
    return ALIKE * math.sqrt(each) if each >= 2 else 1.0


def _tension(contact: ContactSolution) -> float:
    """The force that pulls over the one that presses, at most 1."""
    pull = -float(np.minimum(contact.pressure, 0).sum())
    pressed = float(np.maximum(contact.pressure, 0).sum())
    return min(pull / pressed, 1.0) if pressed else 0.0


def _touches_edge(contact: ContactSolution) -> bool:
    there = contact.contact
    return bool(there[[0, -1]].any() or there[:, [0, -1]].any())


def _middle(low: float, high: float, grid: float) -> float:
    """The middle of an interval; what the grid gave where that is not known."""
    return (low + high) / 2 if math.isfinite(low + high) else grid


def stated(contact: ContactSolution, quantity: Quantity) -> Quantity:
    """``quantity`` of ``contact`` with its errors, and with the interval that they make together. The area is the middle
    of its interval, which need not contain that on the grid, and what is said of it follows."""
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
        low, high = (
            max(area - below, contact.least_area),
            min(area + above, contact.nominal_area),
        )
        middle = _middle(low, high, area)
        if name == "mean_contact_pressure":
            low, high = (
                value * area / high,
                value * area / low if low > 0 else math.inf,
            )
            quantity = quantity.but(value=value * area / middle)
        elif name != "corrected_area":
            low, high = value / area * low, value / area * high
            quantity = quantity.but(value=value / area * middle)
        return quantity.within(
            low, high, (high - low) / 2 / NORMAL_LIMIT, stated="ends"
        )
    least = {"area": contact.least_area, "load": 0.0}.get(name, -math.inf)
    most = contact.nominal_area if name == "area" else math.inf
    low, high = max(value - below, least), min(value + above, most)
    if name == "area" and not math.isclose(
        middle := _middle(low, high, area), area
    ):
        quantity = quantity.but(
            value=middle, reason=f"{number_text(area)} on the grid"
        )
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
