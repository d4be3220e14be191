"""The surface and what is measured on it."""

from __future__ import annotations

import math

import numpy as np
import pytest


@pytest.fixture
def surface(examples):
    return examples.surface


def test_surface_measures(surface):
    made = surface()
    assert made.shape == (3, 4)
    assert made.nominal_area == 12 * 0.25
    assert made.rms_height == pytest.approx(np.std(np.arange(12)))
    assert surface(periodic=False).rms_slope == pytest.approx(math.hypot(4, 1) / 0.5)  # a plane
    assert surface(heights=[[3.0]]).rms_slope == 0
    assert surface(heights=[[3.0]], periodic=False).rms_slope == 0
