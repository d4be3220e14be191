"""Contacts of an elastic half-space whose pressure is known, and what follows from the pressure of any other one. The
slopes of the known ones are small, so that pressures stay far below a hardness that a solver may add."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.surfaces.surface import Surface

PIXEL = 0.5


class HalfSpace(NamedTuple):
    """How well a contact is that of an elastic half-space, from its pressure alone."""

    #: rms of the gap over the contact, relative to the rms height
    gap: float
    #: largest overlap outside of it, relative to the rms height
    overlap: float
    #: the contact modulus that closes the gap best, relative to that of the solution; nan for a few pixels
    modulus: float
    #: rms of the gap that this leaves, relative to the heights in contact
    rest: float

    @classmethod
    def of(cls, surface: Surface, solution: ContactSolution) -> HalfSpace:
        """Those of the contact of ``surface``."""
        heights = surface.heights.astype(np.float64)
        lifted = _indentation(surface, solution.pressure.astype(np.float64))
        gap = lifted / solution.modulus - heights
        touching = gap[solution.contact]
        level, scale = float(touching.mean()), surface.rms_height
        one, two = (array[solution.contact] for array in (lifted, heights))
        one, two = one - one.mean(), two - two.mean()
        modulus = rest = math.nan
        if touching.size > 8:
            modulus = float(one @ one / (one @ two)) / solution.modulus
            left = two - one / (modulus * solution.modulus)
            rest = float(np.std(left) / np.std(two))
        return cls(
            float(np.std(touching)) / scale,
            max(level - float(gap.min()), 0.0) / scale,
            modulus,
            rest,
        )


def _indentation(surface: Surface, pressure: np.ndarray) -> np.ndarray:
    """The displacement (nm) of a half-space with a contact modulus of 1 GPa, up to a constant where it is periodic:
    u(q) = 2 p(q)/|q| there, else that of uniformly loaded squares: Love, Phil. Trans. R. Soc. A 228, 377 (1929)."""
    size = surface.pixel_size
    if surface.periodic:
        qx, qy = (2 * np.pi * np.fft.fftfreq(n, size) for n in surface.shape)
        q = np.hypot(qx[:, None], qy)
        q[0, 0] = np.inf
        return np.fft.ifft2(2 * np.fft.fft2(pressure) / q).real
    from scipy.signal import fftconvolve

    x, y = (np.arange(1 - n, n) * size for n in surface.shape)
    kernel = 0.0
    for i, j in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        a, b = (x + i * size / 2)[:, None], y + j * size / 2
        corner = a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))
        kernel = kernel + i * j * corner / np.pi
    return fftconvolve(kernel, pressure, mode="valid")


class Known(NamedTuple):
    """A surface, the load (nN) for a contact modulus of 1 GPa, and the pressure (GPa) at that modulus."""

    name: str
    surface: Surface
    load: float
    pressure: np.ndarray
    #: relative L2 error of the pressure that the size of the pixels may cause
    pixels: float


def flat() -> Known:
    """A flat surface: the pressure is uniform."""
    surface = Surface(
        heights=np.zeros((16, 24)),
        pixel_size=PIXEL,
        periodic=True,
        provenance={"known": "flat"},
    )
    pressure = np.full(surface.shape, 0.002)
    return Known(
        "a flat surface", surface, 0.002 * surface.nominal_area, pressure, 1e-4
    )


def sinusoid(axis: int, mean: float, pixels: int = 64, width: int = 6) -> Known:
    """One wave along ``axis`` at ``mean`` times the pressure p* of full contact. Westergaard, J. Appl. Mech. 6, A49
    (1939); Johnson, Contact Mechanics (1985), section 13.2."""
    full = 0.005  # p*/E* = π amplitude/λ
    angle = 2 * np.pi * (np.arange(pixels) + 0.5) / pixels
    heights = full * pixels * PIXEL / math.pi * np.cos(angle)
    if mean >= 1:
        profile = full * (mean + np.cos(angle))
        name, error = "a sinusoid in full contact", 0.01
    else:
        half = 0.5 * (
            angle[:, None] + (np.arange(32) - 15.5) / 32 * 2 * np.pi / pixels
        )
        inside = np.sqrt(
            np.maximum(mean - np.sin(half) ** 2, 0.0)
        )  # sin²(πa/λ) = mean
        profile = (2 * full * np.abs(np.cos(half)) * inside).mean(axis=1)
        profile *= mean * full / profile.mean()
        name = f"a sinusoid at {mean:g} of the load of full contact (Westergaard)"
        error = 0.03
    heights, pressure = (
        np.moveaxis(np.repeat(values[:, None], width, axis=1), 0, axis)
        for values in (heights, profile)
    )
    surface = Surface(
        heights=heights,
        pixel_size=PIXEL,
        periodic=True,
        provenance={"known": "sinusoid"},
    )
    return Known(
        f"{name}, along {'xy'[axis]}",
        surface,
        mean * full * surface.nominal_area,
        pressure,
        error,
    )


def _centred(pixels: int, parts: int = 1) -> np.ndarray:
    """The middles of ``parts`` of each of so many pixels (nm), from the middle of all."""
    return (np.arange(parts * pixels) - (parts * pixels - 1) / 2) * PIXEL / parts


def paraboloid(shape: tuple[int, int] = (48, 48), radius: float = 30.0) -> Surface:
    """A tip with its apex in the middle; it records its radius for solvers that need one."""
    x, y = map(_centred, shape)
    heights = -(x[:, None] ** 2 + y**2) / (2 * radius)
    return Surface(
        heights=heights,
        pixel_size=PIXEL,
        periodic=False,
        provenance={"radius": radius},
    )


def hertz(shape: tuple[int, int] = (28, 23)) -> Known:
    """A paraboloid on a grid that is little larger than its contact. Hertz, J. reine angew. Math. 92, 156 (1881)."""
    edge = 10.3 * PIXEL
    radius = 100 * edge
    surface = paraboloid(shape, radius)
    x, y = (_centred(n, 16) for n in shape)
    inside = np.sqrt(np.maximum(1 - (x[:, None] ** 2 + y**2) / edge**2, 0.0))
    pressure = inside.reshape(shape[0], 16, shape[1], 16).mean(axis=(1, 3))
    load = 4 * edge**3 / (3 * radius)
    pressure *= load / (pressure.sum() * PIXEL**2)
    return Known(
        "a paraboloid with free boundaries (Hertz)", surface, load, pressure, 0.03
    )
