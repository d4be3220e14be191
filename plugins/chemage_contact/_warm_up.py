"""Compile the kernels of a solve without solving: each is called once, on no rows and on arrays of one pixel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernels as kernels
from ._grid import PRECISIONS, Settings
from ._operators import Substrate
from ._resampling import grids
from ._split import divides, suits

Array = NDArray[Any]
Call = tuple[Callable[..., None], tuple[Any, ...]]


def compile_kernels(body: Substrate, settings: Settings, heights: Any = np.float64) -> None:
    """Compile what a solve on ``body`` calls, the last kernel first.

    ``heights``: dtype of the heights of the surface. The order is the reverse of that in which a solve calls them, so
    that a second process that does this while the first one solves compiles what the first one has not reached yet.
    """
    for kernel, args in reversed(list(_calls(body, settings, np.dtype(heights)))):
        kernel(0, 0, *args)


def _frozen(dtype: Any) -> Array:
    array = np.zeros((1, 1), dtype)
    array.setflags(write=False)
    return array


def _calls(body: Substrate, settings: Settings, heights: Any) -> Iterator[Call]:
    """The kernels of a solve with their arguments, in the order in which they are first called."""
    state, work = PRECISIONS[settings.precision]
    shapes = grids(body.shape, settings.levels)
    part = np.zeros((1, 7))
    surface = kernels.Heights(_frozen(heights), 0.0, 1.0)
    yield kernels.moments, (surface.values, 0.0, 1.0, part)
    axis = kernels.Axis(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1))
    if len(shapes) > 1:
        yield kernels.resample, (surface.values, axis, axis, np.zeros((1, 1)))
    p = np.zeros((1, 1), state)
    for number, shape in enumerate(reversed(shapes)):
        finest = shape == body.shape
        here = body if finest else body.regrid(shape)
        if number:
            yield kernels.resample_pressure, (p, axis, axis, p)
        else:
            yield from _convolution(here, state)
        yield kernels.totals, (p, p, part)
        yield kernels.scale, (p, state(1), part)
        yield from _descent(here, settings, surface if finest else kernels.Heights(_frozen(state)), part)
    if state != work:
        yield from _convolution(body, state)
        yield kernels.subtract, (*_blocks(), p, surface, 1.0, 0.0, kernels.State(p, p), part)
    yield kernels.correct, (*_blocks(), _search(work), np.zeros((1, 1), work), 1.0, 1.0, part)


def _blocks() -> tuple[kernels.Blocks]:
    return (kernels.Blocks(16, 1, np.zeros(1, np.uint8)),)


def _search(work: Any) -> kernels.Search:
    return kernels.Search(*(np.zeros((1, 1), work) for _ in range(5)))


def _convolution(body: Substrate, dtype: Any) -> Iterator[Call]:
    """What a convolution in ``dtype`` calls."""
    spectrum = np.zeros((1, 1), np.result_type(dtype, np.complex64))
    periodic = body.padded == body.shape
    if periodic and body.shape[1] % 2 == 0:
        yield kernels.multiply_packed, (spectrum, np.zeros((1, 1), dtype), spectrum[0])
    else:
        yield kernels.multiply, (spectrum, np.zeros((1, 1), dtype))


def _descent(body: Substrate, settings: Settings, heights: kernels.Heights, part: Array) -> Iterator[Call]:
    """The kernels of the iteration on one grid."""
    state, work = PRECISIONS[settings.precision]
    p, one = np.zeros((1, 1), state), np.zeros((1, 1), work)
    both, search, blocks = kernels.State(p, p), _search(work), _blocks()
    yield from _convolution(body, work)
    yield kernels.subtract, (*blocks, one, heights, 1.0, 0.0, both, part)
    yield kernels.residual, (*blocks, both, 0.0, one, part)
    yield kernels.indicator, (*blocks, one, one, True)
    split = suits(body, settings.any_size)
    if split:
        axis = kernels.Axis(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1, work))
        if divides(body.shape):
            yield kernels.restrict, (*blocks, one, one)
            yield kernels.local, (*blocks, one, one, one, one, part)
        else:
            yield kernels.restrict_between, (*blocks, one, axis, axis, one)
            yield kernels.local_between, (*blocks, one, one, one, axis, axis, one, part)
    else:
        yield from _convolution(body, work)
    yield kernels.products, (*blocks, search, 1.0, 1.0, part)
    yield kernels.direction, (*blocks, search, 1.0, 1.0, True, True, part)
    spectrum = np.zeros((1, 1), np.result_type(work, np.complex64))
    if not split:
        yield kernels.quadratic_form, (spectrum, one, 1, part)
    yield kernels.projection, (*blocks, p, one, 1.0, 1.0, part)
    yield kernels.move, (*blocks, p, one, 1.0, 1.0, 1.0, part)
    if not split:
        yield kernels.multiply, (spectrum, one)
    yield kernels.advance, (*blocks, both, one, 1.0, part)
