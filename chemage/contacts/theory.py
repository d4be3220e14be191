"""Theories of the area of contact and of the pressure distribution. Pressures in GPa."""

from __future__ import annotations

import math

import numpy as np


def kappa(area: float, rms_slope: float, modulus: float, load: float) -> float:
    """κ = A h'_rms E* / F_N, the area–load coefficient; nan without load."""
    return area * rms_slope * modulus / load if load > 0 else math.nan


def persson_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Persson's contact fraction erf(√2 x), x = p̄/(E* h'_rms). Persson, J. Chem. Phys. 115, 3840 (2001)."""
    from scipy.special import erf

    return erf(np.sqrt(2) * x)


def bgt_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Asymptotic contact fraction √(2π) x of Bush, Gibson & Thomas, Wear 35, 87 (1975), x = p̄/(E* h'_rms)."""
    return np.sqrt(2 * np.pi) * x


def persson_pressure_density(
    pressure: np.ndarray, mean_pressure: float, modulus: float, rms_slope: float
) -> np.ndarray:
    """Persson's density of the pressure p > 0 over the nominal area (1/GPa); its integral is the contact fraction.

    [exp(−(p−p̄)²/2σ²) − exp(−(p+p̄)²/2σ²)]/(σ√(2π)) with σ = E* h'_rms/2.
    """
    sigma = 0.5 * modulus * rms_slope
    p = np.asarray(pressure, dtype=np.float64)
    near = np.exp(-0.5 * ((p - mean_pressure) / sigma) ** 2)
    # the difference of the two Gaussians as a product: no cancellation at small mean pressure
    return -near * np.expm1(-2 * p * mean_pressure / sigma**2) / (sigma * math.sqrt(2 * math.pi))
