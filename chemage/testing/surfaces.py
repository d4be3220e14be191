"""Checks of a surface maker."""

from __future__ import annotations

import math

import numpy as np

from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.surface import Surface
from chemage.testing.checks import (
    check_of,
    refuses,
    require,
    require_estimates,
    require_plain,
    run_checks,
    seeds_are_harmless,
)


def check_surface_maker(component: SurfaceMaker) -> None:
    """Run every check of the role ``surface``; raises AssertionError if one fails."""
    run_checks(component, SurfaceMaker, {})


@check_of("surface")
def _makes_a_surface(component: SurfaceMaker) -> None:
    surface = component.make(0)
    require(isinstance(surface, Surface), f"make() returned {type(surface).__name__}; expected a chemage.Surface")
    require(np.isfinite(surface.heights).all(), "heights are not finite")
    require_plain(surface.provenance, "provenance")
    require(
        surface.provenance, "provenance is empty; record how the surface was made, such as self.todict() and the seed"
    )
    require(component.make() == surface, "make() and make(0) differ")


@check_of("surface")
def _surface_follows_its_seed(component: SurfaceMaker) -> None:
    seeds_are_harmless(lambda seed: component.make(seed).heights.tobytes(), "make")
    if component.make(0).heights.tobytes() != component.make(1).heights.tobytes():
        for seed in (-1, 0.5):
            refuses(f"make({seed})", lambda seed=seed: component.make(seed))  # pyright: ignore[reportArgumentType]


@check_of("surface")
def _surface_is_as_expected(component: SurfaceMaker) -> None:
    """The properties that ``expected()`` returns are those of the surface."""
    surface, expected = component.make(0), component.expected()
    exact = {"nx": surface.shape[0], "ny": surface.shape[1], "pixel_size": surface.pixel_size}
    known = (*exact, "rms_slope", "shortest_wavelength", "radius")
    require_estimates("expected()", expected, dict.fromkeys(known, math.inf))
    for name in exact.keys() & expected.keys():
        require(expected[name] == exact[name], f"expected() has {name} = {expected[name]}, not {exact[name]}")
    if "rms_slope" in expected:
        slope = expected["rms_slope"]
        require(
            math.isclose(slope, surface.rms_slope, rel_tol=0.3, abs_tol=1e-9),
            f"expected() has rms_slope = {slope}, the surface has {surface.rms_slope}",
        )
