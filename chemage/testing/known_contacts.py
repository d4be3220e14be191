"""Contacts of an elastic half-space whose pressure is known. Their slopes are small, so that pressures stay far below a
hardness that a solver may add."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chemage.surfaces.surface import Surface

PIXEL = 0.5


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
        half = 0.5 * (angle[:, None] + (np.arange(32) - 15.5) / 32 * 2 * np.pi / pixels)
        inside = np.sqrt(np.maximum(mean - np.sin(half) ** 2, 0.0))  # sin²(πa/λ) = mean
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


def paraboloid(
    pixels: int = 48, radius: float = 30.0, pixel_size: float = PIXEL
) -> Surface:
    """A tip with its apex in the middle; it records its radius for solvers that need one."""
    x = (np.arange(pixels) - (pixels - 1) / 2) * pixel_size
    heights = -(x[:, None] ** 2 + x**2) / (2 * radius)
    return Surface(
        heights=heights,
        pixel_size=pixel_size,
        periodic=False,
        provenance={"radius": radius},
    )


def hertz(pixels: int = 28) -> Known:
    """A paraboloid on a grid that is little larger than its contact. Hertz, J. reine angew. Math. 92, 156 (1881)."""
    edge = 10.3 * PIXEL
    radius = 100 * edge
    surface = paraboloid(pixels, radius)
    x = (np.arange(16 * pixels) - (16 * pixels - 1) / 2) * PIXEL / 16
    inside = np.sqrt(np.maximum(1 - (x[:, None] ** 2 + x**2) / edge**2, 0.0))
    pressure = inside.reshape(pixels, 16, pixels, 16).mean(axis=(1, 3))
    load = 4 * edge**3 / (3 * radius)
    pressure *= load / (pressure.sum() * PIXEL**2)
    return Known(
        "a paraboloid with free boundaries (Hertz)", surface, load, pressure, 0.03
    )
