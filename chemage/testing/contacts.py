"""Checks of a contact solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import InputError
from chemage.surfaces.surface import Surface
from chemage.testing.checks import (
    check_of,
    refuses,
    require,
    require_estimates,
    require_plain,
    run_checks,
    speed_variants,
)


def check_contact_solver(component: ContactSolver, **inputs: Any) -> None:
    """Run every check of the role ``contact``; raises AssertionError if one fails.

    ``inputs`` are ``surfaces`` to solve besides those of the checks, and ``force_tolerance``, the accepted relative
    error of the force.
    """
    run_checks(component, ContactSolver, inputs)


def rough_surface(shape: tuple[int, int] = (32, 32), seed: int = 0, **fields: Any) -> Surface:
    """Make a small random surface for tests: rms slope 0.1, pixels of 0.5 nm."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    heights = np.zeros(shape)
    top = [max(1, n // 4) if n > 1 else 0 for n in shape]
    for i in range(top[0] + 1):
        for j in range(-top[1], top[1] + 1):
            size = math.hypot(i / shape[0], j / shape[1])
            if size > 0:
                phase, height = rng.random(), rng.standard_normal()
                heights += height * (size * max(shape)) ** -1.8 * np.cos(2 * np.pi * (i * x + j * y + phase))
    fields = {"pixel_size": 0.5, **fields}
    slope = Surface(heights=heights, **fields).rms_slope
    return Surface(heights=heights * (0.1 / slope if slope > 0 else 0), **fields)


def _paraboloid(pixels: int = 48, radius: float = 30.0, pixel_size: float = 0.5) -> Surface:
    x = (np.arange(pixels) - (pixels - 1) / 2) * pixel_size
    heights = -(x[:, None] ** 2 + x**2) / (2 * radius)
    return Surface(heights=heights, pixel_size=pixel_size, periodic=False, provenance={"radius": radius})


def _solvable(component: ContactSolver, surfaces: Sequence[Surface]) -> list[tuple[Surface, float]]:
    """The surfaces that the solver accepts, each with a load (nN) that brings a part of it into contact."""
    accepted = []
    for surface in (*surfaces, rough_surface(), _paraboloid()):
        try:
            light = component.solve(surface, 1e-3 * surface.nominal_area)
        except InputError:
            continue
        require(
            isinstance(light, ContactSolution), f"solve() returned {type(light).__name__}; expected a ContactSolution"
        )
        accepted.append((surface, 0.02 * light.modulus * surface.rms_slope * surface.nominal_area))
    require(accepted, "refused a rough periodic surface and a paraboloid; give surfaces=[...] that it accepts")
    return accepted


@check_of("contact")
def _contact_carries_the_load(component: ContactSolver, surfaces: Sequence[Surface] = (), force_tolerance=1e-6) -> None:
    for surface, load in _solvable(component, surfaces):
        solution = component.solve(surface, load)
        require(solution.load == load, f"the load is {load} nN, the solution has {solution.load} nN")
        force = float(solution.pressure.sum(dtype=np.float64)) * solution.pixel_size**2
        require(
            math.isclose(force, load, rel_tol=force_tolerance),
            f"the pressure integrates to {force!r} nN, the load is {load!r} nN",
        )
        require(0 < solution.sites.size < solution.pressure.size, f"{solution.area_fraction=}: expected some contact")
        require(solution.pressure.min() >= 0, "negative pressure")


@check_of("contact")
def _solution_describes_itself(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(component, surfaces):
        solution = component.solve(surface, load)
        require(solution.shape == surface.shape, f"a solution of {solution.shape} pixels for {surface.shape}")
        for name in ("pixel_size", "periodic"):
            mine, its = getattr(solution, name), getattr(surface, name)
            require(mine == its, f"{name} is {mine}, the surface has {its}")
        for name in ("rms_slope", "rms_height"):
            mine, its = getattr(solution, name), getattr(surface, name)
            require(math.isclose(mine, its, rel_tol=1e-6), f"{name} is {mine}, the surface has {its}")
        for name in component.implemented_properties:
            # an option of the same name may switch on what takes memory
            complete = (
                component.replace(**{name: True}).solve(surface, load)
                if name in type(component).model_fields
                else solution
            )
            require(getattr(complete, name, None) is not None, f"implements {name!r}, but the solution has none")
        require(solution.converged, "did not converge, and did not raise ConvergenceError")
        require(math.isfinite(solution.residual), f"residual {solution.residual}")
        require_plain(solution.provenance, "provenance")
        require(solution.provenance, "provenance is empty; record how the contact was solved, such as self.todict()")
        require_plain(solution.convergence, "convergence")


@check_of("contact")
def _gap_is_closed_in_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Hard wall: gap ≥ 0, p·gap = 0, within the solver's tolerance."""
    for surface, load in _solvable(component, surfaces):
        with_gap = component.replace(gap=True) if "gap" in type(component).model_fields else component
        solution = with_gap.solve(surface, load)
        if solution.gap is None:
            continue
        scale = 1e-3 * surface.rms_height
        require(solution.gap.min() >= -scale, f"the bodies overlap by {-solution.gap.min():g} nm")
        gap = float(np.abs(solution.gap[solution.contact]).max())
        require(gap <= 10 * scale, f"a gap of {gap:g} nm where the pressure is positive")


@check_of("contact")
def _no_load_is_no_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, _ in _solvable(component, surfaces):
        solution = component.solve(surface, 0)
        require(solution.sites.size == 0 and solution.load == 0, f"{solution.sites.size} pixels in contact at load 0")


@check_of("contact")
def _wrong_load_is_refused(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    surface, load = _solvable(component, surfaces)[0]
    for wrong in (-1.0, math.nan, math.inf, "20 GPa", "20", True):
        refuses(f"load {wrong!r}", lambda wrong=wrong: component.solve(surface, wrong))
    require(
        component.solve(surface, f"{load!r} nN") == component.solve(surface, load),
        "a load with its unit gave another solution",
    )


@check_of("contact")
def _contact_is_deterministic(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(component, surfaces):
        first, second = component.solve(surface, load), component.solve(surface, load)
        require(first.pressure.tobytes() == second.pressure.tobytes(), "two solutions of the same contact differ")


def same_pressure(one: np.ndarray, two: np.ndarray, tolerance: float) -> bool:
    return float(np.linalg.norm(one - two)) <= tolerance * float(np.linalg.norm(two))


@check_of("contact")
def _contact_scales(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Elasticity is scale-free: lengths ×3 and load ×9, modulus and load ×2, or a raised surface are equivalent."""
    for surface, load in _solvable(component, surfaces):
        plain = component.solve(surface, load)
        if "modulus" in type(component).model_fields:
            stiff = component.replace(modulus=2 * plain.modulus).solve(surface, 2 * load)
            require(
                same_pressure(stiff.pressure / 2, plain.pressure, 1e-3),
                "twice the modulus and load do not give twice the pressure",
            )
        for what, other, force in (
            ("three times the size", surface.heights * 3, 9 * load),
            ("raised by 5 nm", surface.heights + 5, load),
        ):
            size = surface.pixel_size * (3 if force > load else 1)
            radius = surface.provenance.get("radius")
            known = {"radius": radius * size / surface.pixel_size} if radius else {}
            changed = Surface(heights=other, pixel_size=size, periodic=surface.periodic, provenance=known)
            try:
                solution = component.solve(changed, force)
            except InputError:  # the solver needs more than heights and radius
                continue
            require(same_pressure(solution.pressure, plain.pressure, 1e-3), f"{what}: the pressure differs")


@check_of("contact")
def _contact_grows_with_load(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(component, surfaces):
        areas = [component.solve(surface, factor * load).sites.size for factor in (0.3, 1.0, 2.0)]
        require(areas == sorted(areas) and areas[0] < areas[-1], f"pixels in contact at increasing load: {areas}")


@check_of("contact")
def _speed_does_not_change_the_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Options in ``speed_only``, such as the number of threads, do not change a bit of the pressure."""
    for surface, load in _solvable(component, surfaces):
        pressure = component.solve(surface, load).pressure
        for what, variant in speed_variants(component):
            require(
                variant.solve(surface, load).pressure.tobytes() == pressure.tobytes(), f"{what}: the pressure differs"
            )


@check_of("contact")
def _contact_cost_is_estimated(component: ContactSolver) -> None:
    """``expected()`` returns finite numbers, from few or many properties of a surface."""
    many = {"nx": 64.0, "ny": 48.0, "pixel_size": 0.5, "rms_slope": 0.1, "shortest_wavelength": 4.0}
    for surface in ({}, {"nx": 64.0, "ny": 48.0}, many):
        for load in (0.0, 1.0, 1e9):
            bounds = {"area_fraction": 1.0, "cpu_seconds": math.inf, "bytes": math.inf, "gap_bytes": math.inf}
            require_estimates(f"expected({surface}, {load})", component.expected(surface, load), bounds)


@check_of("contact")
def _start_changes_nothing(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    for surface, load in _solvable(component, surfaces):
        start, cold = component.solve(surface, 0.5 * load), component.solve(surface, load)
        warm = component.solve(surface, load, start=start)
        require(same_pressure(warm.pressure, cold.pressure, 1e-2), "the solution depends on the start")


@check_of("contact")
def _reference_solves_the_same_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """``reference()`` returns a solver of the same class, with the same contact up to the errors of the component."""
    reference = component.reference()
    require(isinstance(reference, type(component)), f"reference() returned {reference!r}")
    for surface, load in _solvable(component, surfaces):
        pressure = component.solve(surface, load).pressure
        require(
            same_pressure(pressure, reference.solve(surface, load).pressure, 1e-2), "reference() solves another contact"
        )


@check_of("contact")
def _odd_grids_are_solved(component: ContactSolver) -> None:
    """Grids that are not square, odd, one pixel wide or one pixel are solved, or refused with an InputError."""
    for shape in ((15, 32), (9, 7), (1, 16), (1, 1)):
        for surface in (rough_surface(shape), rough_surface(shape, periodic=False)):
            try:
                solution = component.solve(surface, 1e-2 * surface.nominal_area)
            except InputError:
                continue
            require(solution.shape == shape, f"a solution of {solution.shape} for {shape}")
