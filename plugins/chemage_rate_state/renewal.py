"""Sliding that renews a contact: how long sites stay in it, in slip, while one rough surface moves over another."""

from __future__ import annotations

import math
from collections.abc import Callable
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
from chemage.plugin import (
    Panel,
    Picture,
    Quantity,
    Rank,
    Result,
    contact_of,
    displays,
    figures,
    text,
)

SLIP_LENGTH = Quantity(
    "slip_length",
    "nm",
    "slip length of renewal",
    "D_c",
    "mean slip since the sites in contact came into it",
    Rank.FIRST,
)
CHORD = Quantity("mean_chord", "nm", "mean chord of a patch", "4A/C")
#: slip over the mean chord of a patch, unless it is given; seeds between the two surfaces
CHORDS, APART = 6.0, 1_000_003
#: share of sites that a slip did not renew from which it is said to be short
LEFT = 0.1
Report = Callable[[int, int], None]


class Renewal(NamedTuple):
    """What stays in contact while surfaces slide."""

    #: (m,) nm
    slips: np.ndarray
    #: (surfaces, m) share of the sites in contact that have been there for this slip
    unrenewed: np.ndarray
    #: (surfaces,) nm
    mean_chords: np.ndarray
    #: which point of a sweep it is; "" outside sweeps
    of: str = ""

    def quantities(self) -> list[Quantity]:
        """Means over pairs of surfaces. The share that no slip renewed falls as before: exponentially, by its mean so far."""
        last = self.unrenewed[:, -1]
        lengths = np.trapezoid(self.unrenewed, self.slips, axis=1) / (1 - last)
        means = (
            SLIP_LENGTH.of_replicas(lengths),
            CHORD.of_replicas(self.mean_chords),
        )
        return [one.but(name=one.name + self.of, of=self.of[1:]) for one in means]


def slip_length(
    scene: Any,
    surfaces: int = 3,
    slip: float | None = None,
    report: Report = lambda step, steps: None,
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
    shares, chords, slips = [], [], np.zeros(1)
    for number in range(surfaces):
        seed = loaded.surface_seed + number
        slips, share, chord = _slid(loaded, seed, slip, report)
        slip = slips[-1]
        shares.append(share)
        chords.append(chord)
    return Renewal(slips, np.stack(shares), np.array(chords))


def _slid(
    scene: Scene, seed: int, slip: float | None, report: Report
) -> tuple[np.ndarray, np.ndarray, float]:
    """Slips, shares of sites that stayed, and the mean chord of a patch, of one pair of surfaces."""
    lower, upper = make_surface(scene.surface, seed), None
    if scene.is_random:
        upper = make_surface(scene.surface, seed + APART)
        if not lower.periodic:
            raise InputError(
                f"{scene.name}: the surface is random and does not repeat, so that none can slide over another; give a "
                "periodic one"
            )

    def both(step: int) -> Surface:
        if upper is None:
            return lower
        heights = lower.heights + np.roll(upper.heights, step, axis=0)
        return Surface(heights=heights / math.sqrt(2), pixel_size=lower.pixel_size)

    contact = contact_of(scene, both(0))
    if not isinstance(contact, ContactSolution) or not contact.sites.size:
        raise InputError(
            f"{scene.name}: no pixel is in contact; nothing can be renewed"
        )
    chord = 4 / contact.perimeter_to_area  # C follows the edges of pixels
    pixel, half = contact.pixel_size, lower.heights.shape[0] // 2
    steps = round((slip or min(CHORDS * chord, half * pixel)) / pixel)
    if not 1 <= steps <= half:
        raise InputError(
            f"slip = {slip:g} nm: give one from a pixel of {pixel:g} nm to half the side, {half * pixel:g} nm"
        )
    # steps since a site came into contact, in the frames of both bodies; of a surface that slides on a flat one, in that
    # of the flat one
    frames = 1 if upper is None else 2
    ages = np.full((frames, *lower.heights.shape), -1, dtype=np.int32)
    # sites in contact at all steps at which it is known whether they came so long before, and those that did
    seen, stayed = np.zeros((2, frames, steps + 1), dtype=np.int64)
    for step in range(steps + 1):
        if upper is None:
            now = [np.roll(contact.contact, step, axis=0)]
        else:
            if step:
                contact = solve_contact(
                    scene.solver, both(step), contact.load, start=contact
                )
            now = [contact.contact, np.roll(contact.contact, -step, axis=0)]
        ages = np.where(now, ages + 1, -1)
        for k, age in enumerate(ages):
            counts = np.bincount(age[age >= 0], minlength=steps + 1)
            stayed[k] += counts[::-1].cumsum()[::-1]
            seen[k, : step + 1] += counts.sum()
        report(step, steps)
    return pixel * np.arange(steps + 1), (stayed / seen).mean(axis=0), chord


@displays(Renewal)
class RenewalDisplay(Result):
    """How fast slip renews a contact, or those of a sweep, as users see it."""

    errors = "95 % intervals over pairs of surfaces (Student's t)"

    def __init__(self, *renewals: Renewal) -> None:
        self.renewals = renewals

    @property
    def name(self) -> str:
        return "Renewal by slip"

    def quantities(self) -> list[Quantity]:
        return [one for part in self.renewals for one in part.quantities()]

    def notes(self) -> list[str]:
        left = max(one.unrenewed[:, -1].mean() for one in self.renewals)
        words = f"{text.percent(left)} of the sites stay longer than this slip: give a larger one"
        return [words] if left >= LEFT else []

    def pictures(self) -> dict[str, Picture]:
        """The share of sites that stayed, against slip."""
        return {"renewal": Picture([Panel(self.plotted)])}

    def plotted(self, axes: Any, medium: Any = None) -> None:
        """Draw the means over pairs of surfaces."""
        for one in self.renewals:
            axes.plot(one.slips, one.unrenewed.mean(axis=0), label=one.of)
        axes.set(
            xlabel="slip (nm)", ylabel="share of the sites that stayed in contact"
        )
        figures.legend(axes)
