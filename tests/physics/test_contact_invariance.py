"""What elasticity leaves unchanged: scales, translations, rotations, superposition; and what must grow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chemage import Surface
from chemage_contact import FFTBEM

SHAPES = st.tuples(st.integers(3, 40), st.integers(3, 40))
MEANS = st.floats(1e-4, 3.0)


def heights_of(shape, seed):
    """Noise smoothed once, so that contacts are a few pixels wide."""
    h = np.random.default_rng(seed).standard_normal(shape)
    return h + np.roll(h, 1, 0) + np.roll(h, 1, 1) + np.roll(h, (1, 1), (0, 1))


def pressed(heights, mean, modulus=35.3, pixel=0.5, periodic=True, **options):
    surface = Surface(heights=heights, pixel_size=pixel, periodic=periodic)
    options = {"tolerance": 1e-8} | options
    return FFTBEM(modulus=modulus, threads=1, **options).solve(surface, mean * surface.nominal_area)


def same(a, b, rtol=1e-5):
    np.testing.assert_allclose(a, b, atol=rtol * np.abs(b).max())


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, factor=st.floats(1e-7, 1e4))
@settings(max_examples=40)
def test_pressure_and_modulus_scale_together(shape, seed, mean, factor):
    h = heights_of(shape, seed)
    same(pressed(h, mean * factor, modulus=35.3 * factor).pressure / factor, pressed(h, mean).pressure)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, factor=st.floats(1e-12, 1e6))
@settings(max_examples=40)
def test_heights_and_pressure_scale_together(shape, seed, mean, factor):
    h = heights_of(shape, seed)
    plain, scaled = pressed(h, mean), pressed(h * factor, mean * factor)
    same(scaled.pressure / factor, plain.pressure)
    assert scaled.displacement == pytest.approx(plain.displacement * factor, rel=1e-5)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, factor=st.floats(1e-3, 1e3), periodic=st.booleans())
@settings(max_examples=40)
def test_a_larger_body_of_the_same_form_bears_the_same_pressure(shape, seed, mean, factor, periodic):
    h = heights_of(shape, seed)
    plain = pressed(h, mean, periodic=periodic)
    same(pressed(h * factor, mean, pixel=0.5 * factor, periodic=periodic).pressure, plain.pressure)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, shift=st.tuples(st.integers(0, 40), st.integers(0, 40)))
@settings(max_examples=40)
def test_translation(shape, seed, mean, shift):
    h = heights_of(shape, seed)
    moved = pressed(np.roll(h, shift, (0, 1)), mean).pressure
    same(moved, np.roll(pressed(h, mean).pressure, shift, (0, 1)))


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, turns=st.integers(1, 3), periodic=st.booleans())
@settings(max_examples=40)
def test_rotation_and_reflection(shape, seed, mean, turns, periodic):
    h = heights_of(shape, seed)
    plain = pressed(h, mean, periodic=periodic).pressure
    same(pressed(np.rot90(h, turns), mean, periodic=periodic).pressure, np.rot90(plain, turns))
    same(pressed(h.T, mean, periodic=periodic).pressure, plain.T)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS, offset=st.floats(-1e6, 1e6))
@settings(max_examples=25)
def test_raising_the_surface_changes_nothing(shape, seed, mean, offset):
    h = heights_of(shape, seed)
    same(pressed(h + offset, mean).pressure, pressed(h, mean).pressure, rtol=1e-4)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=MEANS)
@settings(max_examples=25)
def test_repeating_the_surface_repeats_the_pressure(shape, seed, mean):
    h = heights_of(shape, seed)
    same(pressed(np.tile(h, (2, 3)), mean).pressure, np.tile(pressed(h, mean).pressure, (2, 3)))


@given(shape=SHAPES, seeds=st.tuples(st.integers(0, 99), st.integers(100, 199)))
@settings(max_examples=25)
def test_superposition_at_full_contact(shape, seeds):
    one, two = (heights_of(shape, seed) for seed in seeds)
    mean = 1e3
    together = pressed(one + two, mean).pressure
    assert together.min() > 0
    same(together, pressed(one, mean).pressure + pressed(two, mean).pressure - mean, rtol=1e-9)


@given(shape=SHAPES, seed=st.integers(0, 99), mean=st.floats(1e-4, 1.0), factor=st.floats(1.05, 10))
@settings(max_examples=40)
def test_more_load_means_more_of_everything(shape, seed, mean, factor):
    h = heights_of(shape, seed)
    less, more = pressed(h, mean), pressed(h, factor * mean)
    assert np.all(more.contact >= less.contact)  # no pixel leaves the contact
    assert more.displacement is not None
    assert less.displacement is not None
    assert more.displacement > less.displacement
    assert np.all(more.pressure >= less.pressure - 1e-5 * more.pressure.max())


@given(shape=st.tuples(st.integers(128, 150), st.integers(128, 150)), seed=st.integers(0, 99), mean=MEANS)
@settings(max_examples=12)
def test_every_method_finds_the_same(shape, seed, mean):
    """With the split operator on any size, and with transforms alone on the coarse grids."""
    h = heights_of(shape, seed)
    mixed = pressed(h, mean).pressure
    same(pressed(h, mean, precision="double", levels=1).pressure, mixed)
    same(pressed(h, mean, precision="single", tolerance=1e-5).pressure, mixed, rtol=5e-3)
