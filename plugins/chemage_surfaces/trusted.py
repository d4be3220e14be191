"""How far the spectrum of an image can be trusted: down to the wavelength below which tip, noise, pixels or the end of
the spectrum decide. What they change above is corrected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from chemage import Surface
from chemage_surfaces._maps import Floats
from chemage_surfaces.measures import measure
from chemage_surfaces.spectra import (
    FEWEST,
    FEWEST_BINS,
    ROBUST,
    SIGNIFICANT,
    Binned,
    binned,
    fit_power_law,
    logs,
    rolled,
)

#: roll-offs that are tried where noise is fitted
ROLLS = 12
#: noise of this share of the density of the surface ends what is trusted; and its relative uncertainty, as noise is
#: not white, and waves shorter than two pixels look like it
NOISE_SHARE, NOISE_DOUBT = 0.25, 0.5
#: relative uncertainty of the correction for a tip of known and of estimated radius
KNOWN_TIP, ESTIMATED_TIP = 0.35, 0.6
#: share of the Nyquist wavenumber up to which an image is used: heights are samples, and waves shorter than two pixels
#: appear as longer ones
SAMPLED = 0.7
#: why a spectrum ends where nothing but its pixels ends it
TO_PIXELS = "two pixels"


def _noise(data: Binned) -> float:
    """The density of white noise, nm⁴, fitted together with roll-off and power law; 0 where none is seen."""
    values, variance = logs(data)
    at = math.exp(float(np.average(np.log(data.q), weights=1 / variance)))
    deviation = np.sqrt(variance)

    def fitted(roll: float) -> Any:
        x = np.log(np.maximum(data.q, roll) / at)

        def residuals(p: Floats) -> Floats:
            return (values - np.logaddexp(p[0] - (2 + 2 * p[1]) * x, p[2])) / deviation

        start = [float(np.interp(math.log(at), np.log(data.q), values)), 0.7, values[-1] - 1.5]
        bounds = ([-np.inf, -1.0, values[-1] - 12], [np.inf, 3.0, values[-1] + 1])
        return least_squares(residuals, start, loss="huber", f_scale=ROBUST, bounds=bounds)

    rolls = [0.0, *np.exp(np.linspace(math.log(data.q[0]), math.log(data.q[-FEWEST]), ROLLS))]
    best = min((fitted(roll) for roll in rolls), key=lambda one: one.cost)
    _, _, without = rolled(data)
    degrees = max(len(data.q) - 3, 1)
    gain = without.misfit * max(len(data.q) - 2, 1) - 2 * best.cost
    return math.exp(best.x[2]) if gain > SIGNIFICANT * max(2 * best.cost / degrees, 1.0) else 0.0


@dataclass(frozen=True)
class Trusted:
    """The part of the spectrum of an image that the surface decides, with the effects of tip and noise corrected; and
    why it ends there."""

    data: Binned
    limit: str
    #: white noise, nm⁴, which was subtracted
    noise: float = 0.0
    #: radius of the tip, nm, given or estimated; 0: none
    radius: float = 0.0
    #: what was added to the logarithms of the densities, each with its relative uncertainty
    corrections: tuple[tuple[Floats, float], ...] = ()

    def without(self, which: int) -> Binned:
        """The data with a correction less by its uncertainty."""
        if which >= len(self.corrections):
            return self.data
        added, doubt = self.corrections[which]
        return replace(self.data, density=self.data.density * np.exp(-doubt * added))


def trusted(surface: Surface, resolution: float | None = None, tip_radius: float | None = None) -> Trusted:
    """What to trust of the spectrum of ``surface``: wavelengths above ``resolution`` (nm) if it is given; else above
    two pixels (three of an image that does not repeat), those that a tip has changed too much to correct, those at
    which white noise has 25 % of the density, and the end of the spectrum."""
    data, limit = binned(surface), TO_PIXELS
    if resolution is not None:
        return Trusted(data.part(0, 2 * math.pi / resolution), "as given")
    folded = np.zeros(len(data.q))
    if (cut := data.cut) is not None:
        # the last bin before the end is filled in part
        data, limit = data.part(0, cut * (1 - 1e-9)), "the spectrum ends"
    elif not surface.periodic:
        data, limit = data.part(0, SAMPLED * math.pi / surface.pixel_size), "waves shorter than two pixels"
        folded = _folded(data, math.pi / surface.pixel_size)
    measures = measure(surface.heights.astype(np.float64), (surface.pixel_size, surface.pixel_size))
    radius = measures.tip_radius() if tip_radius is None else tip_radius
    tip = measures.tip_share(radius, data.q) if radius else np.zeros(len(data.q))
    changed = np.nonzero(np.isinf(tip))[0]
    if changed.size:
        kept = int(changed[0])
        if kept < 2 * FEWEST and tip_radius is None:  # hardly a tip
            radius, tip = 0.0, np.zeros(len(data.q))
        else:
            data, tip, limit = data.first(kept), tip[:kept], "the tip"
    folded = folded[: len(data.q)]
    # folded waves are no noise
    plain = replace(data, density=data.density / (1 + folded))
    noise = _noise(plain) if len(data.q) >= 3 * FEWEST and (data.density > 0).all() else 0.0
    clean = data.density - noise
    noisy = np.nonzero(noise > NOISE_SHARE * clean)[0]
    kept = int(noisy[0]) if noisy.size else len(clean)
    share = clean[:kept] / data.density[:kept]
    if noise > 0 and kept >= 2 * FEWEST:
        data = Binned(data.q[:kept], clean[:kept], data.modes[:kept] * share**2)
        tip, limit = tip[:kept], "noise" if noisy.size else limit
    else:
        noise = 0.0
    folded = folded[: len(data.q)]
    corrections = [(tip, KNOWN_TIP if tip_radius else ESTIMATED_TIP), (-np.log1p(folded / 2), 1.0)]
    if noise:
        corrections.append((np.log(share), NOISE_DOUBT))
    data = replace(data, density=data.density * np.exp(tip) / (1 + folded / 2))
    return Trusted(data, limit, noise, radius, tuple(corrections))


def _folded(data: Binned, nyquist: float) -> Floats:
    """The share of the density that is of waves shorter than two pixels, if the power law went on: Σ C(|q + G|)/C(q)
    over the eight nearest reciprocal vectors G of the pixels, averaged over directions. An instrument that averages
    over its pixels has less of it, so that half is corrected."""
    law = fit_power_law(data.part(0, 0.5 * nyquist)) if (data.q < 0.5 * nyquist).sum() >= FEWEST_BINS else None
    if law is None or not math.isfinite(law.hurst):
        return np.zeros(len(data.q))
    angle = (np.arange(16) + 0.5) * math.pi / 32
    qx, qy = data.q[:, None] * np.cos(angle), data.q[:, None] * np.sin(angle)
    share = np.zeros(qx.shape)
    for i, j in ((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)):
        away = np.hypot(qx + 2 * i * nyquist, qy + 2 * j * nyquist)
        share += (away / data.q[:, None]) ** (-2 - 2 * min(max(law.hurst, 0.0), 1.0))
    return share.mean(axis=1)
