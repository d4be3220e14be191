"""Sliding that renews a contact: how long sites stay in it, in slip, while one rough surface moves over another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from chemage import (
    ContactSolution,
    InputError,
    Scene,
    Surface,
    load_scene,
    make_surface,
    solve_contact,
)
from chemage.plugin import Curve, Quantity, Rank, contact_of

SLIP_LENGTH = Quantity(
    "slip_length",
    "nm",
    "slip length of renewal",
    "D_c",
    "mean slip since the sites in contact came into it",
    Rank.FIRST,
)
PATCH = Quantity("mean_chord", "nm", "mean chord of a patch", "4A/C")
OVERLAP = Quantity(
    "overlap_length", "nm", "integral of the overlap with the first contact"
)
SLIP = Quantity("slip", "nm", "slip")
SURVIVAL = Curve(
    "unrenewed", "1", "share of the sites that stayed in contact", axis_of=SLIP
)
OVERLAPPED = Curve(
    "overlap", "1", "share of the first contact that is in contact", axis_of=SLIP
)
#: slip over the mean chord of a patch, unless it is given; seeds between the two surfaces
CHORDS, APART = 6.0, 1_000_003
Report = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Renewal:
    """What stays in contact while surfaces slide."""

    name: str
    #: (m,) nm
    slips: np.ndarray
    #: (surfaces, m) share of the sites in contact that have been there for this slip; of the first contact's sites, those
    #: that are in contact after it
    unrenewed: np.ndarray
    overlap: np.ndarray
    #: (surfaces,) nm
    mean_chords: np.ndarray

    def quantities(self) -> list[Quantity]:
        """Means over pairs of surfaces."""
        lengths = [_integral(self.slips, one) for one in self.unrenewed]
        overlaps = [_integral(self.slips, one) for one in self.overlap]
        return [
            SLIP_LENGTH.of_replicas(np.array(lengths)),
            PATCH.of_replicas(self.mean_chords),
            OVERLAP.of_replicas(np.array(overlaps)),
        ]

    def curves(self) -> list[Curve]:
        """Both shares against slip."""
        over = f"mean of {len(self.unrenewed)} pairs of surfaces, 95 %"
        return [
            curve.of_replicas(self.slips, values, over)
            for curve, values in (
                (SURVIVAL, self.unrenewed),
                (OVERLAPPED, self.overlap),
            )
        ]

    @property
    def left(self) -> float:
        """Share that no slip renewed, of which the slip length knows nothing."""
        return float(self.unrenewed[:, -1].mean())


def _integral(slips: np.ndarray, share: np.ndarray) -> float:
    """∫ of a share, whose end falls as before: exponentially, by its mean so far."""
    seen = float(np.trapezoid(share, slips))
    return seen / (1.0 - float(share[-1])) if share[-1] < 1 else math.inf


def slip_length(
    scene: Any,
    surfaces: int = 3,
    slip: float | None = None,
    report: Report | None = None,
) -> Renewal:
    """Slide two surfaces of ``scene`` over each other in steps of a pixel, under its load, each contact solved from the one
    before; a surface that is not random slides on a flat one, whose sites are followed.

    Two equal rough surfaces have heights over √2, so that both together have the spectrum of one. Sites of both bodies are
    followed: the age of a site is the slip since it came into contact, and D_c the mean age (the state θ of the ageing law
    in steady sliding is D_c/V).

    Parameters
    ----------
    surfaces
        Pairs of surfaces, from which the intervals are.
    slip
        nm, up to half the side; default: six mean chords of a patch, or that.

    Raises
    ------
    InputError
        The scene has no contact of pixels, its random surfaces do not repeat, or the slip is below a pixel or above half
        the side.
    """
    loaded = load_scene(scene) if isinstance(scene, str) else scene
    pairs, pixels = [], None
    for number in range(surfaces):
        seed = loaded.surface_seed + number
        one = _slid(
            loaded, seed, slip, pixels, lambda s, n: report and report(s, n)
        )
        pixels = one.unrenewed.size - 1
        pairs.append(one)
    stacked = (
        np.stack([getattr(one, name) for one in pairs]) for name in _Pair._fields
    )
    unrenewed, overlap, chords, pixel_sizes = stacked
    slips = float(pixel_sizes[0]) * np.arange(unrenewed.shape[1])
    return Renewal(loaded.name, slips, unrenewed, overlap, chords)


class _Pair(NamedTuple):
    """Of one pair of surfaces."""

    #: (m,) see :class:`Renewal`
    unrenewed: np.ndarray
    overlap: np.ndarray
    mean_chord: float
    pixel_size: float


def _slid(
    scene: Scene, seed: int, slip: float | None, pixels: int | None, report: Report
) -> _Pair:
    lower = make_surface(scene.surface, seed)
    flat = not scene.is_random
    if not (flat or lower.periodic):
        raise InputError(
            f"{scene.name}: the surface is random and does not repeat, so that none can slide over another; give a "
            "periodic one"
        )
    upper = None if flat else make_surface(scene.surface, seed + APART)

    def pressed(step: int, start: ContactSolution | None) -> ContactSolution:
        surface = lower
        if upper is not None:
            both = lower.heights + np.roll(upper.heights, step, axis=0)
            surface = Surface(
                heights=both / math.sqrt(2),
                pixel_size=lower.pixel_size,
                periodic=lower.periodic,
            )
        if start is None:
            return contact_of(scene, surface)
        return solve_contact(scene.solver, surface, start.load, start=start)

    contact = pressed(0, None)
    if not isinstance(contact, ContactSolution) or not contact.sites.size:
        raise InputError(
            f"{scene.name}: no pixel is in contact; nothing can be renewed"
        )
    chord = 4 / contact.perimeter_to_area  # C follows the edges of pixels
    pixel = contact.pixel_size
    half = lower.heights.shape[0] // 2
    if pixels is None:
        pixels = round((slip or min(CHORDS * chord, half * pixel)) / pixel)
    if not 1 <= pixels <= half:
        raise InputError(
            f"slip = {slip:g} nm: give one from a pixel of {pixel:g} nm to half the side, {half * pixel:g} nm"
        )
    # in the frames of both bodies; of a surface that slides on a flat one, in that of the flat one
    frames = [_Frame(contact.contact, pixels) for _ in range(1 if flat else 2)]
    for step in range(1, pixels + 1):
        report(step, pixels)
        if flat:
            now = [np.roll(contact.contact, step, axis=0)]
        else:
            contact = pressed(step, contact)
            now = [contact.contact, np.roll(contact.contact, -step, axis=0)]
        for frame, there in zip(frames, now, strict=True):
            frame.move(there)
    unrenewed = np.mean([frame.unrenewed for frame in frames], axis=0)
    overlap = np.mean([frame.overlap for frame in frames], axis=0)
    return _Pair(unrenewed, overlap, chord, pixel)


class _Frame:
    """Sites of one body, and for how many steps they have been in contact."""

    def __init__(self, contact: np.ndarray, steps: int) -> None:
        self.first, self.step = contact, 0
        #: -1: not in contact
        self.age = contact.astype(np.int32) - 1
        self.overlap = np.ones(steps + 1)
        #: sites in contact at all steps at which it is known whether they came so long before, and those that did
        self.seen, self.stayed = np.zeros((2, steps + 1), dtype=np.int64)
        self._count()

    @property
    def unrenewed(self) -> np.ndarray:
        return self.stayed / self.seen

    def move(self, contact: np.ndarray) -> None:
        self.step += 1
        self.age = np.where(contact, self.age + 1, -1)
        both = np.count_nonzero(contact & self.first)
        self.overlap[self.step] = both / np.count_nonzero(self.first)
        self._count()

    def _count(self) -> None:
        ages = np.bincount(self.age[self.age >= 0], minlength=self.step + 1)
        self.stayed[: self.step + 1] += ages[::-1].cumsum()[::-1]
        self.seen[: self.step + 1] += ages.sum()
