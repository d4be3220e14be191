"""How far the spectrum of an image can be trusted: down to the wavelength below which tip, noise, pixels or the end of
the spectrum decide. What they change above is corrected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from chemage import InputError, Surface
from chemage_surfaces._maps import Floats
from chemage_surfaces.findings import Finding
from chemage_surfaces.measures import Measures
from chemage_surfaces.spectra import (
    CROSS,
    FEWEST,
    FEWEST_BINS,
    ROBUST,
    SIGNIFICANT,
    Binned,
)
from chemage_surfaces.steps import hann, trend

#: roll-offs that are tried where noise is fitted
ROLLS = 12
#: noise of this share of the density of the surface ends what is trusted; and its relative uncertainty, as noise is
#: not white, and waves shorter than two pixels look like it
NOISE_SHARE, NOISE_DOUBT = 0.25, 0.5
#: correlation of an image with its retrace below which they are not of one place
LEAST_ALIKE = 0.3
#: relative uncertainty of the correction for a tip of known and of estimated radius
KNOWN_TIP, ESTIMATED_TIP = 0.35, 0.6
#: share of the Nyquist wavenumber up to which an image is used: heights are samples, and waves shorter than two pixels
#: appear as longer ones
SAMPLED = 0.7
#: pixels per shortest trusted wavelength from which they are finer than what the instrument resolves
FINE = 6.0
#: why a spectrum ends where nothing but its pixels ends it
TO_PIXELS = "two pixels"


def fitted_noise(data: Binned) -> tuple[float, float]:
    """The density of white noise, nm⁴, fitted together with roll-off and power law, 0 where none is seen; and the
    roll-off, 1/nm, 0 without one."""
    values, variance, at = data.logs()
    deviation = np.sqrt(variance)

    def fitted(roll: float) -> Any:
        x = np.log(np.maximum(data.q, roll) / at)

        def residuals(p: Floats) -> Floats:
            return (
                values - np.logaddexp(p[0] - (2 + 2 * p[1]) * x, p[2])
            ) / deviation

        start = [
            float(np.interp(math.log(at), np.log(data.q), values)),
            0.7,
            values[-1] - 1.5,
        ]
        bounds = ([-np.inf, -1.0, values[-1] - 12], [np.inf, 3.0, values[-1] + 1])
        return least_squares(
            residuals, start, loss="huber", f_scale=ROBUST, bounds=bounds
        )

    rolls = [0.0, *data.rolls(ROLLS).tolist()]
    fits = [fitted(roll) for roll in rolls]
    number = min(range(len(rolls)), key=lambda k: fits[k].cost)
    best = fits[number]
    _, _, without = data.rolled()
    degrees = max(len(data.q) - 3, 1)
    gain = without.misfit * max(len(data.q) - 2, 1) - 2 * best.cost
    seen = gain > SIGNIFICANT * max(2 * best.cost / degrees, 1.0)
    return math.exp(best.x[2]) if seen else 0.0, rolls[number]


@dataclass(frozen=True)
class Trusted:
    """The part of the spectrum of an image that the surface decides, with the effects of tip and noise corrected; and
    why it ends there."""

    data: Binned
    limit: str
    #: rms height of the noise that was subtracted, nm
    noise: float = 0.0
    #: radius of the tip, nm, given or estimated; 0: none
    radius: float = 0.0
    #: what was added to the logarithms of the densities, each with its relative uncertainty
    corrections: tuple[tuple[Floats, float], ...] = ()

    @property
    def seen(self) -> Floats:
        """The densities as the image has them, nm⁴."""
        found = self.data.density
        for added, _ in self.corrections:
            found = found * np.exp(-added)
        return found

    def fine_pixels(self, side: float) -> Finding | None:
        """That pixels of ``side`` (nm) are finer than what the instrument resolves."""
        if not len(self.data.q) or self.limit not in ("the tip", "noise"):
            return None
        shortest = 2 * math.pi / float(self.data.q[-1])
        text = (
            f"pixels of {side:.4g} nm are finer than the scan resolves: {self.limit} decides waves shorter than "
            f"{shortest:.4g} nm"
        )
        return Finding("fine pixels", text) if shortest > FINE * side else None

    def without(self, which: int) -> Binned:
        """The data with a correction less by its uncertainty."""
        if which >= len(self.corrections):
            return self.data
        added, doubt = self.corrections[which]
        return replace(
            self.data, density=self.data.density * np.exp(-doubt * added)
        )


def noise_between(trace: Surface, retrace: Surface) -> Surface:
    """The noise of one image (nm), from its retrace: their difference over √2, after the retrace was shifted along the
    scan lines (x) to fit best, as the scanner's hysteresis moves it. It contains what else differs, such as creep.

    Raises
    ------
    InputError
        They differ in pixels, or in what they show.
    """
    if (trace.shape, trace.pixel_size) != (retrace.shape, retrace.pixel_size):
        raise InputError(
            f"retrace: {retrace!r}, but the image is {trace!r}; give the other direction of the same scan"
        )
    first, second = (one.heights.astype(np.float64) for one in (trace, retrace))
    a, b = (
        np.fft.rfft(hann(heights - trend(heights, 1)), axis=0)
        for heights in (first, second)
    )
    # the bow of the scanner has another sign on the way back
    a[: CROSS + 1] = b[: CROSS + 1] = 0
    cross = (a * b.conj()).sum(axis=1)
    n = len(first)
    correlation = np.fft.irfft(cross, n)
    start = float(n // 2 - (int(np.argmax(correlation)) + n // 2) % n)
    if correlation.max() * n / 2 < LEAST_ALIKE * float(
        np.linalg.norm(a) * np.linalg.norm(b)
    ):
        raise InputError(
            f"retrace: {retrace!r} does not show what {trace!r} shows; leave the retrace out"
        )
    from scipy import ndimage

    wave = 2 * np.pi * np.fft.rfftfreq(n)
    best: Any = minimize_scalar(
        lambda shift: -float((cross * np.exp(-1j * wave * shift)).real.sum()),
        bounds=(start - 1, start + 1),
    )
    moved = ndimage.shift(second, (-best.x, 0), order=5, mode="nearest")
    # what was beyond the edge is not known
    kept = slice(max(math.ceil(-best.x), 0), n - max(math.ceil(best.x), 0))
    difference = np.zeros_like(first)
    difference[kept] = (first - moved)[kept]
    difference[kept] -= trend(difference[kept], 1)
    return Surface(
        heights=difference / math.sqrt(2),
        pixel_size=trace.pixel_size,
        periodic=trace.periodic,
    )


def trusted(
    surface: Surface,
    resolution: float | None = None,
    tip_radius: float | None = None,
    retrace: Surface | None = None,
    data: Binned | None = None,
    with_noise: bool = False,
) -> Trusted:
    """What to trust of the spectrum of ``surface``, or of the part ``data`` of it: wavelengths above ``resolution`` (nm)
    if it is given; else above two pixels (three of an image that does not repeat), those that a tip has changed too much
    to correct, those at which noise has 25 % of the density, and the end of the spectrum. Noise is white, unless
    ``retrace`` shows it; ``with_noise`` it is left in."""
    limit = TO_PIXELS
    if data is None:
        data = Binned.of(surface)
    if resolution is not None:
        return Trusted(data.part(0, 2 * math.pi / resolution), "as given")
    folded = np.zeros(len(data.q))
    if (cut := data.cut) is not None:
        # the last bin before the end is filled in part
        data, limit = data.part(0, cut * (1 - 1e-9)), "the spectrum ends"
    elif not surface.periodic:
        data, limit = (
            data.part(0, SAMPLED * math.pi / surface.pixel_size),
            "waves shorter than two pixels",
        )
        folded = _folded(data, math.pi / surface.pixel_size)
    fewest = FEWEST_BINS if with_noise else 2 * FEWEST
    radius, tip = _of_tip(surface, data, tip_radius, fewest)
    if len(tip) < len(data.q):
        data, limit = data.first(len(tip)), "the tip"
    folded = folded[: len(data.q)]
    noise, rms = np.zeros(len(data.q)), 0.0
    if retrace is not None:
        difference = noise_between(surface, retrace)
        found = Binned.of(difference)
        noise, rms = found.density[: len(data.q)], found.rms
    elif not with_noise and len(data.q) >= 3 * FEWEST and (data.density > 0).all():
        # folded waves are no noise
        white, _ = fitted_noise(replace(data, density=data.density / (1 + folded)))
        noise, rms = (
            np.full(len(data.q), white),
            math.sqrt(white) / surface.pixel_size,
        )
    clean = data.density - noise
    noisy = np.nonzero(noise > NOISE_SHARE * clean)[0]
    kept = int(noisy[0]) if noisy.size else len(clean)
    share = clean[:kept] / data.density[:kept]
    if rms and (kept >= 2 * FEWEST or retrace is not None):
        data = Binned(data.q[:kept], clean[:kept], data.modes[:kept] * share**2)
        tip, limit = tip[:kept], "noise" if noisy.size else limit
    else:
        rms, share = 0.0, np.ones(len(data.q))
    folded = folded[: len(data.q)]
    corrections = [
        (tip, KNOWN_TIP if tip_radius else ESTIMATED_TIP),
        (-np.log1p(folded / 2), 1.0),
    ]
    if rms:
        corrections.append((np.log(share), NOISE_DOUBT))
    data = replace(data, density=data.density * np.exp(tip) / (1 + folded / 2))
    return Trusted(data, limit, rms, radius, tuple(corrections))


def _of_tip(
    surface: Surface, data: Binned, tip_radius: float | None, fewest: int
) -> tuple[float, Floats]:
    """The radius of the tip (nm), given or seen, and what it took from the logarithms of the first bins, up to where it
    took too much. One that would leave fewer than ``fewest`` bins is not seen."""
    side = surface.pixel_size
    measures = Measures.of(surface.heights.astype(np.float64), (side, side))
    radius = measures.tip_radius() if tip_radius is None else tip_radius
    if not radius:
        return 0.0, np.zeros(len(data.q))
    tip = measures.tip_share(radius, data.q)
    changed = np.nonzero(np.isinf(tip))[0]
    kept = int(changed[0]) if changed.size else len(tip)
    if kept < min(fewest, len(tip)) and tip_radius is None:
        return 0.0, np.zeros(len(data.q))
    return radius, tip[:kept]


def _folded(data: Binned, nyquist: float) -> Floats:
    """The share of the density that is of waves shorter than two pixels, if the power law went on: Σ C(|q + G|)/C(q)
    over the eight nearest reciprocal vectors G of the pixels, averaged over directions. An instrument that averages
    over its pixels has less of it, so that half is corrected."""
    law = (
        data.part(0, 0.5 * nyquist).power_law()
        if (data.q < 0.5 * nyquist).sum() >= FEWEST_BINS
        else None
    )
    if law is None or not math.isfinite(law.hurst):
        return np.zeros(len(data.q))
    angle = (np.arange(16) + 0.5) * math.pi / 32
    qx, qy = data.q[:, None] * np.cos(angle), data.q[:, None] * np.sin(angle)
    share = np.zeros(qx.shape)
    for i, j in (
        (i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)
    ):
        away = np.hypot(qx + 2 * i * nyquist, qy + 2 * j * nyquist)
        share += (away / data.q[:, None]) ** (
            -2 - 2 * min(max(law.hurst, 0.0), 1.0)
        )
    return share.mean(axis=1)
