"""The shape of an inferred density in numbers: shares of the sites by energy, and the peaks that the data support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from chemage.plugin import Quantity, algebra
from chemage_inference.energies import averaging
from chemage_inference.forecast import WIDE, band
from chemage_inference.result import Inference, sampled_quantity

#: parts into which the visible energies are cut, at most
PARTS = 6
#: share of the samples in which a peak must be higher than the valleys beside it
SURE = 0.95
#: share of the sites below which the visible energies count as empty
EMPTY = 0.01
#: share of the sites that is taken as none
LEAST = 5e-4
#: height of a maximum of the mean over its largest value above which it is named
STANDS_OUT = 0.1


@dataclass(frozen=True)
class Peak:
    """A peak of the density, averaged over the resolution."""

    #: eV
    energy: float
    #: eV, 90 % band of its position
    band: tuple[float, float]
    #: 1/eV
    height: float

    def text(self, step: float) -> str:
        """The energy with its band, which is at least a ``step`` of the energies (eV) wide."""
        low, high = (f"{end:.3f}" for end in self.band)
        return (
            f"{self.energy:.3f} ± {0.5 * step:.3f} eV"
            if low == high
            else f"{self.energy:.3f} eV ({low} to {high})"
        )


def between(inference: Inference, edges: Sequence[float]) -> np.ndarray:
    """(k + 1, S) shares of the sites whose barriers lie below, between and above ``edges`` (k,), eV."""
    below = [_integral(inference, edge) for edge in edges]
    return np.diff([0 * below[0], *below, 0 * below[0] + 1], axis=0)


def shares(inference: Inference) -> list[Quantity]:
    """Shares of the sites below, in equal parts of, and above the visible energies; no part is finer than the
    resolution."""
    low, high = inference.visible_range
    if not high > low:
        return []
    count = int(np.clip((high - low) / inference.resolution, 1, PARTS))
    edges = np.linspace(low, high, count + 1).tolist()
    names = [f"{edge:.3f}" for edge in edges]
    where = ["below " + names[0], *map(" to ".join, pairwise(names))]
    said = [
        "bonded before the first hold time",
        *[""] * count,
        "seen as not reacted",
    ]
    rows = zip(
        [*where, "above " + names[-1]], said, between(inference, edges), strict=True
    )
    found = []
    for label, of, part in rows:
        one = Quantity(f"share {label}", "%", f"sites {label} eV", of=of)
        part = np.where(part < LEAST, 0.0, 100 * part)
        some = np.quantile(part, 0.95) > 0
        found.append(
            sampled_quantity(one, part)
            if some
            else one.but(reason="less than 0.1 %")
        )
    return found


def empty(inference: Inference) -> bool:
    """Whether hardly any barriers can lie within the visible energies."""
    return band(between(inference, inference.visible_range)[1], WIDE)[1] < EMPTY


def peaks(inference: Inference) -> list[Peak]:
    """Peaks within the visible energies which nearly all samples have, from low to high energies."""
    energies, samples = _seen(inference)
    if energies.size < 3 or empty(inference):
        return []
    mean = samples.mean(axis=0)
    kept: list[int] = []
    for at in sorted(_maxima(mean).tolist(), key=lambda place: -mean[place]):
        if all(_apart(samples, mean, at, other) for other in kept) and _above_ends(
            samples, mean, at
        ):
            kept.append(at)
    sure = []
    for at in sorted(kept):
        left, right = _domain(mean, at, kept)
        places = energies[left + samples[:, left:right].argmax(axis=1)]
        sure.append(Peak(float(energies[at]), band(places, WIDE), float(mean[at])))
    return sure


def unresolved(inference: Inference) -> list[float]:
    """Energies (eV) of maxima of the mean inside the visible energies that are none of :func:`peaks`.

    Averaged over the resolution, too few samples have them.
    """
    energies = _seen(inference)[0]
    if energies.size < 3 or empty(inference):
        return []
    mean = inference.density[np.isin(inference.energies, energies)]
    sure = [peak.energy for peak in peaks(inference)]
    inner = _maxima(mean)
    high = energies[inner[mean[inner] > STANDS_OUT * mean.max()]].tolist()
    return [
        at
        for at in high
        if all(abs(at - other) > inference.resolution for other in sure)
    ]


def trend(inference: Inference) -> tuple[float, float]:
    """Shares of the samples whose density is higher, and lower, at the upper end of the visible energies."""
    _, samples = _seen(inference)
    if samples.shape[1] < 2:
        return 0.0, 0.0
    return float((samples[:, -1] > samples[:, 0]).mean()), float(
        (samples[:, -1] < samples[:, 0]).mean()
    )


def rises(inference: Inference) -> tuple[bool, bool]:
    """Whether nearly all samples rise from the valley beside the outermost peaks to the lower and to the upper end.

    A peak beyond the visible energies may cause it.
    """
    there = peaks(inference)
    energies, samples = _seen(inference)
    if not there:
        return False, False
    mean = samples.mean(axis=0)
    first, last = (
        int(np.argmin(np.abs(energies - peak.energy)))
        for peak in (there[0], there[-1])
    )
    below, above = int(mean[: first + 1].argmin()), last + int(mean[last:].argmin())
    lower = below > 0 and (samples[:, 0] > samples[:, below]).mean() >= SURE
    upper = (
        above < mean.size - 1
        and (samples[:, -1] > samples[:, above]).mean() >= SURE
    )
    return bool(lower), bool(upper)


def _seen(inference: Inference) -> tuple[np.ndarray, np.ndarray]:
    """Visible energies, and the densities of the samples there, averaged over the resolution."""
    energies = inference.energies
    if not inference.visible.any():
        return energies[:0], inference.samples[:, :0]
    low, high = inference.visible_range
    inside = (energies >= low) & (energies <= high)
    return energies[inside], algebra.product(
        inference.samples[:, inside],
        averaging(energies[inside], inference.resolution).T,
    )


def _maxima(mean: np.ndarray) -> np.ndarray:
    """Places of the maxima inside."""
    return np.flatnonzero((mean[1:-1] >= mean[:-2]) & (mean[1:-1] > mean[2:])) + 1


def _apart(samples: np.ndarray, mean: np.ndarray, at: int, other: int) -> bool:
    """Whether nearly all samples have a valley between two maxima."""
    left, right = sorted((at, other))
    valley = left + int(mean[left : right + 1].argmin())
    lower = np.minimum(samples[:, left], samples[:, right])
    return bool((samples[:, valley] < lower).mean() >= SURE)


def _above_ends(samples: np.ndarray, mean: np.ndarray, at: int) -> bool:
    """Whether nearly all samples are higher at a maximum than at the lowest place on either side of it."""
    left, right = int(mean[: at + 1].argmin()), at + int(mean[at:].argmin())
    return bool(
        (samples[:, at] > np.maximum(samples[:, left], samples[:, right])).mean()
        >= SURE
    )


def _domain(mean: np.ndarray, at: int, kept: list[int]) -> tuple[int, int]:
    """Where a peak reaches to: the lowest places towards its neighbours, or towards the ends."""
    first = max((place for place in kept if place < at), default=0)
    last = min((place for place in kept if place > at), default=mean.size - 1)
    return first + int(mean[first : at + 1].argmin()), at + int(
        mean[at : last + 1].argmin()
    ) + 1


def _integral(inference: Inference, upper: float) -> np.ndarray:
    """(S,) integral of the densities up to an energy."""
    energies, samples = inference.energies, inference.samples
    step = np.diff(energies)
    whole = np.concatenate(
        [
            np.zeros((len(samples), 1)),
            np.cumsum(0.5 * step * (samples[:, 1:] + samples[:, :-1]), axis=1),
        ],
        axis=1,
    )
    at = int(
        np.clip(
            np.searchsorted(energies, upper, side="right") - 1, 0, energies.size - 2
        )
    )
    part = min(upper - energies[at], step[at])
    slope = (samples[:, at + 1] - samples[:, at]) / step[at]
    return whole[:, at] + part * (samples[:, at] + 0.5 * part * slope)
