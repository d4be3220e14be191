"""Checks of a contact solver, with contacts of a half-space whose pressure is known, and the independent test of any
other one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.contacts.theory import ContactTheory
from chemage.foundation.errors import InputError
from chemage.surfaces.surface import Roughness, Surface
from chemage.testing.answers import Questions, asks
from chemage.testing.checks import (
    check_of,
    options_of,
    refuses,
    require,
    require_estimates,
    require_plain,
    rescaled,
    trade_variants,
    whole,
)
from chemage.testing.known_contacts import every_known_contact, flat, paraboloid


def half_space_errors(surface: Surface, solution: ContactSolution) -> tuple[float, float]:
    """Errors of a periodic contact on an elastic half-space, relative to the rms height: rms of the gap over the
    contact, and largest overlap outside. From the pressure alone, with u(q) = 2 p(q)/(E* |q|)."""
    qx, qy = (2 * np.pi * np.fft.fftfreq(n, surface.pixel_size) for n in surface.shape)
    q = np.hypot(qx[:, None], qy)
    q[0, 0] = np.inf
    spectrum = np.fft.fft2(solution.pressure.astype(np.float64))
    gap = np.fft.ifft2(2 * spectrum / (solution.modulus * q)).real - surface.heights
    touching = gap[solution.contact]
    level = float(touching.mean())
    overlap = max(level - float(gap.min()), 0.0)
    return float(np.sqrt(np.mean((touching - level) ** 2))) / surface.rms_height, overlap / surface.rms_height


check_contact_solver = whole(
    ContactSolver,
    surfaces="surfaces to solve besides those of the checks",
    force_tolerance="the accepted relative error of the force",
)


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


def _solvable(
    component: ContactSolver, surfaces: Sequence[Surface] = (), force: float = 0.02
) -> list[tuple[Surface, float]]:
    """The surfaces that the solver accepts, each with a load (nN) that brings a part of it into contact.

    ``force`` is that load relative to E* h'_rms A0, at which a half-space is in full contact or nearly so.
    """
    accepted = []
    own = (
        rough_surface(),
        paraboloid(),
        rough_surface((24, 36), seed=3),
        rough_surface((20, 30), seed=4, periodic=False),
    )
    for surface in (*surfaces, *own):
        try:
            light = component.solve(surface, 1e-3 * surface.nominal_area)
        except InputError:
            continue
        require(
            isinstance(light, ContactSolution), f"solve() returned {type(light).__name__}; expected a ContactSolution"
        )
        accepted.append((surface, force * light.modulus * surface.rms_slope * surface.nominal_area))
    require(accepted, "refused rough surfaces and a paraboloid; give surfaces=[...] that it accepts")
    return accepted


def same_pressure(one: np.ndarray, two: np.ndarray, tolerance: float) -> bool:
    """Whether the relative L2 difference of two pressures is at most ``tolerance``."""
    return one.shape == two.shape and difference(one, two) <= tolerance


def difference(one: np.ndarray, two: np.ndarray) -> float:
    """Relative L2 difference of two pressures."""
    size = float(np.linalg.norm(two))
    return float(np.linalg.norm(one - two)) / size if size else math.inf


def _tolerance(component: ContactSolver, least: float) -> float:
    """How far two equivalent solutions may differ: ``least``, or the error that the solver declares."""
    return max(least, component.declared_error or 0.0)


@asks(ContactSolver)
def _contacts_asked(component: ContactSolver, surfaces: Sequence[Surface] = (), **_: Any) -> Questions:
    def ask(surface: Surface, load: float) -> Any:
        def asked(solver: ContactSolver) -> Any:
            found = solver.solve(surface, load)
            return found.pressure, found.gap, found.displacement, found.modulus, found.notes

        return asked

    def theory(slope: float, load: float) -> Any:
        roughness = Roughness(rms_slope=slope, rms_height=1.0, nominal_area=1e6)

        def asked(solver: Any) -> Any:
            found = solver.statistics(roughness, load)
            return found.pressure, found.area, found.missing

        return asked

    if isinstance(component, ContactTheory):
        for slope, load in ((0.11, 1.3e5), (0.12, 1.3e5), (0.11, 1.7e5)):
            yield f"a slope of {slope} under {load:g} nN", theory(slope, load)
        return
    for number, (surface, load) in enumerate(_solvable(component, surfaces)):
        radius = surface.provenance.get("radius")
        higher = {"provenance": {"radius": radius / 1.07}} if radius else {}
        yield f"surface {number}", ask(surface, 0.91 * load)
        other = surface.model_copy(update={"heights": 1.07 * surface.heights, **higher})
        yield f"surface {number} with higher summits", ask(other, 0.91 * load)
        yield f"surface {number} with higher summits under another load", ask(other, 0.73 * load)
        if not radius:
            larger = other.model_copy(update={"pixel_size": 1.3 * surface.pixel_size})
            yield f"surface {number} with higher summits and larger pixels", ask(larger, 0.73 * load)


# -- the form of the answer -------------------------------------------------------------------------------------------


@check_of(ContactSolver, unless=(ContactTheory,), known=True)
def _contact_carries_the_load(component: ContactSolver, surfaces: Sequence[Surface] = (), force_tolerance=1e-6) -> None:
    """The pressure (GPa) adds up to the load (nN), and some but not all pixels are in contact. It is nowhere negative,
    unless the surfaces adhere: then there is tension (or ``carries`` says where the attraction is left out), and
    ``touching`` says where they touch."""
    for surface, load in _solvable(component, surfaces):
        solution = component.solve(surface, load)
        require(solution.load == load, f"the load is {load} nN, the solution has {solution.load} nN")
        force = float(solution.pressure.sum(dtype=np.float64)) * solution.pixel_size**2
        require(
            bool(solution.carries and component.adheres) or abs(force - load) <= force_tolerance * solution.borne,
            f"the pressure integrates to {force!r} nN, the load is {load!r} nN (1 GPa nm² is 1 nN)",
        )
        require(0 < solution.sites.size < solution.pressure.size, f"{solution.area_fraction=}: expected some contact")
        told = solution.touching is not None
        require(
            told == component.adheres,
            f"adheres = {component.adheres}, and the solution has touching: {told}; with adhesion it must, else not",
        )
        if component.adheres:
            require(
                solution.pressure.min() < 0 or bool(solution.carries),
                "adheres, but there is no tension, and carries does not say where the attraction is",
            )
        else:
            require(solution.pressure.min() >= 0, "negative pressure")


@check_of(ContactSolver, unless=(ContactTheory,))
def _contact_is_deterministic(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """The same contact gives the same bytes, whatever was solved before; the surface stays as it was."""
    solvable = _solvable(component, surfaces)
    heights = [surface.heights.tobytes() for surface, _ in solvable]
    first = [component.solve(surface, load).pressure.tobytes() for surface, load in solvable]
    for (surface, load), pressure in zip(solvable, first, strict=True):
        component.solve(surface, 0.4 * load)
        again = component.solve(surface, load).pressure.tobytes()
        require(again == pressure, "two solutions of the same contact differ")
    require([surface.heights.tobytes() for surface, _ in solvable] == heights, "the heights of the surface changed")


@check_of(ContactSolver, unless=(ContactTheory,))
def _solution_describes_itself(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Grid, pixel size, periodicity and roughness are the surface's, the modulus is the solver's, and all that it
    implements is there."""
    for surface, load in _solvable(component, surfaces):
        solution = component.solve(surface, load)
        require(solution.shape == surface.shape, f"a solution of {solution.shape} pixels for {surface.shape}")
        for name in ("pixel_size", "periodic"):
            mine, its = getattr(solution, name), getattr(surface, name)
            require(mine == its, f"{name} is {mine}, the surface has {its}")
        for name in ("rms_slope", "rms_height"):
            mine, its = getattr(solution, name), getattr(surface, name)
            require(math.isclose(mine, its, rel_tol=1e-6), f"{name} is {mine}, the surface has {its}")
        if "GPa" in str(options_of(component).get("modulus", ((), None, ""))[1]):
            mine, its = solution.modulus, getattr(component, "modulus", None)
            require(its is None or math.isclose(mine, its), f"modulus is {mine} GPa, the solver has {its} GPa")
        for name in component.implemented_properties:
            # an option switches on what takes memory
            complete = component.with_gap().solve(surface, load) if name == "gap" else solution
            require(getattr(complete, name, None) is not None, f"implements {name!r}, but the solution has none")
        require(solution.converged, "did not converge, and did not raise ConvergenceError")
        require(math.isfinite(solution.residual), f"residual {solution.residual}")
        require_plain(solution.provenance, "provenance")
        require(solution.provenance, "provenance is empty; record how the contact was solved, such as self.todict()")
        require_plain(solution.convergence, "convergence")


@check_of(ContactSolver, unless=(ContactTheory,), known=True)
def _no_load_is_no_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """At load 0 no pixel is in contact, unless the surfaces adhere."""
    if component.adheres:
        return
    for surface, _ in _solvable(component, surfaces):
        solution = component.solve(surface, 0)
        require(solution.sites.size == 0 and solution.load == 0, f"{solution.sites.size} pixels in contact at load 0")


@check_of(ContactSolver, unless=(ContactTheory,))
def _wrong_load_is_refused(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Negative and infinite loads, and loads in another dimension, are InputErrors, and with adhesion a pull that parts
    the surfaces; a load may have its unit."""
    surface, load = _solvable(component, surfaces)[0]
    pull = -1e3 * load if component.adheres else -1.0
    for wrong in (pull, math.nan, math.inf, "20 nm", "20", True):
        refuses(f"load {wrong!r}", lambda wrong=wrong: component.solve(surface, wrong))
    require(
        component.solve(surface, f"{load!r} nN") == component.solve(surface, load),
        "a load with its unit gave another solution",
    )


@check_of(ContactSolver, unless=(ContactTheory,))
def _contact_cost_is_estimated(component: ContactSolver) -> None:
    """``expected()`` returns finite numbers, from few or many properties of a surface."""
    many = {"nx": 64.0, "ny": 48.0, "pixel_size": 0.5, "rms_slope": 0.1, "shortest_wavelength": 4.0}
    for surface in ({}, {"nx": 64.0, "ny": 48.0}, many):
        for load in (0.0, 1.0, 1e9):
            bounds: dict[str, float] = dict.fromkeys(("cpu_seconds", "bytes", "gap_bytes", "max_pressure"), math.inf)
            bounds["area_fraction"] = 1.0
            require_estimates(f"expected({surface}, {load})", component.expected(surface, load), bounds)


# -- where the contact is ---------------------------------------------------------------------------------------------


@check_of(ContactSolver, unless=(ContactTheory,))
def _summits_touch_first(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """At a load of a fraction of a pixel's, the highest pixel carries it: heights are not upside down, mirrored,
    transposed or shifted by a pixel."""
    for surface, _ in _solvable(component, surfaces):
        modulus = component.solve(surface, 0).modulus
        solution = component.solve(surface, 1e-3 * modulus * surface.rms_slope * surface.pixel_size**2)
        heights = surface.heights.astype(np.float64)
        top = heights >= heights.max() - 1e-9 * (heights.max() - heights.min())
        where = [tuple(map(int, place)) for place in np.argwhere(top)[:4]]
        at = tuple(map(int, np.unravel_index(np.argmax(solution.pressure), surface.shape)))
        require(
            (solution.pressure[top] > 0).all(),
            f"at a very small load the highest pixels, {where}, are not in contact; the largest pressure is at {at}, "
            f"which is {heights.max() - heights[at]:.3g} nm lower (rms height {surface.rms_height:.3g} nm)",
        )
        high = heights >= np.quantile(heights, 0.9)
        size = np.maximum(solution.pressure, 0)  # with adhesion the load is less than what presses
        share = float(size[high].sum() / size.sum())
        require(
            share > 0.5,
            f"at a very small load the highest tenth of the surface carries {share:.0%} of it; expected nearly all",
        )


@check_of(ContactSolver, unless=(ContactTheory,))
def _contact_turns_with_the_surface(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Mirroring, transposing or (where periodic) shifting the surface does the same to the pressure, and no more."""
    for surface, load in _solvable(component, surfaces):
        plain = component.solve(surface, load).pressure
        turns: dict[str, Any] = {
            "mirrored along x": lambda array: array[::-1],
            "mirrored along y": lambda array: array[:, ::-1],
            "transposed": lambda array: array.T,
        }
        if surface.periodic:
            turns["shifted by (3, 5) pixels"] = lambda array: np.roll(array, (3, 5), (0, 1))
        for what, turn in turns.items():
            turned = Surface(
                heights=np.ascontiguousarray(turn(surface.heights)),
                pixel_size=surface.pixel_size,
                periodic=surface.periodic,
                provenance=surface.provenance,
            )
            try:
                solution = component.solve(turned, load)
            except InputError:  # a grid that the solver does not accept
                continue
            require(solution.shape == turned.shape, f"surface {what}: a solution of {solution.shape}")
            away = difference(solution.pressure, turn(plain))
            require(
                away <= _tolerance(component, 1e-2),
                f"surface {what}: the pressure is not that of the surface as it was, {what}; they differ by {away:.2g} "
                "(relative L2 norm)",
            )


@check_of(ContactSolver, unless=(ContactTheory,))
def _gap_is_closed_in_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Where a gap (nm) is given: it is nowhere negative, and zero where the pressure is positive, to a hundredth of the
    rms height or ten times the declared error of it."""
    for surface, load in _solvable(component, surfaces):
        solution = component.with_gap().solve(surface, load)
        if solution.gap is None:
            continue
        scale = max(1e-3, component.declared_error or 0.0) * surface.rms_height
        require(solution.gap.min() >= -scale, f"the bodies overlap by {-solution.gap.min():g} nm")
        gap = float(np.abs(solution.gap[solution.contact]).max())
        require(gap <= 10 * scale, f"a gap of {gap:g} nm where the pressure is positive")


@check_of(ContactSolver, unless=(ContactTheory,))
def _contact_scales(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """Lengths ×3 and load ×9, stresses and load ×2, or a raised surface are equivalent: no unit and no length is
    hidden in the solver."""
    for surface, load in _solvable(component, surfaces):
        plain = component.solve(surface, load)
        if "modulus" in type(component).model_fields:
            stiff = rescaled(component, stress=2).solve(surface, 2 * load)
            require(
                same_pressure(stiff.pressure / 2, plain.pressure, _tolerance(component, 1e-3)),
                "twice the modulus and load do not give twice the pressure",
            )
        for what, other, size, solver in (
            ("three times the size", surface.heights * 3, 3, rescaled(component, length=3)),
            ("raised by 5 nm", surface.heights + 5, 1, component),
        ):
            radius = surface.provenance.get("radius")
            provenance = {"radius": radius * size} if radius else {}
            changed = Surface(
                heights=other, pixel_size=surface.pixel_size * size, periodic=surface.periodic, provenance=provenance
            )
            try:
                solution = solver.solve(changed, load * size**2)
            except InputError:  # the solver needs more than heights and radius
                continue
            same = same_pressure(solution.pressure, plain.pressure, _tolerance(component, 1e-3))
            require(same, f"{what}: the pressure differs")


@check_of(ContactSolver, unless=(ContactTheory,))
def _contact_grows_with_load(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """A larger load brings more pixels into contact, and where it is given, a larger approach (nm)."""
    for surface, load in _solvable(component, surfaces):
        solutions = [component.solve(surface, factor * load) for factor in (0.3, 1.0, 2.0)]
        areas = [solution.sites.size for solution in solutions]
        require(areas == sorted(areas) and areas[0] < areas[-1], f"pixels in contact at increasing load: {areas}")
        approaches = [solution.displacement for solution in solutions if solution.displacement is not None]
        require(
            approaches == sorted(approaches) and len(set(approaches)) == len(approaches),
            f"displacement (approach of the bodies, nm) at increasing load: {approaches}; expected it to increase",
        )


# -- how large the pressure is ----------------------------------------------------------------------------------------


@check_of(ContactSolver, unless=(ContactTheory,), known=True)
def _known_contacts_are_found(component: ContactSolver) -> None:
    """Where ``declared_error`` is given: flat, sinusoidal (Westergaard) and spherical (Hertz) surfaces on an elastic
    half-space have the pressure of the closed form, to within that error."""
    if component.declared_error is None:
        return
    error, solved = component.declared_error, 0
    modulus = getattr(component, "modulus", None)
    for case in every_known_contact():
        try:
            scale = modulus if isinstance(modulus, float) else component.solve(case.surface, 0).modulus
            solution = component.solve(case.surface, scale * case.load)
        except InputError:
            continue
        solved += 1
        exact = scale * case.pressure
        away, peak = difference(solution.pressure, exact), float(solution.pressure.max() / exact.max())
        require(
            away <= error + case.pixels,
            f"{case.name}: the pressure differs from the closed form by {away:.2g} (relative L2 norm); "
            f"declared_error = {error:g}, and the pixels allow for {case.pixels:g}. In contact are "
            f"{solution.area_fraction:.3f} of the pixels, expected {np.mean(exact > 0):.3f}; the largest pressure is "
            f"{peak:.3f} of the expected one",
        )
    require(solved, "declares an error, but refuses all surfaces with a closed form")


@check_of(ContactSolver, unless=(ContactTheory,), known=True)
def _contact_obeys_the_half_space(component: ContactSolver) -> None:
    """Where ``declared_error`` is given: on periodic rough surfaces the gap that follows from the pressure is zero in
    contact and positive outside, to within that error; a solution that is given up early is found."""
    if component.declared_error is None:
        return
    error = 3 * component.declared_error + 1e-4
    for shape, seed in (((32, 32), 5), ((24, 40), 6)):
        rough = rough_surface(shape, seed)
        surface = Surface(heights=0.05 * rough.heights, pixel_size=rough.pixel_size, provenance={"rough": seed})
        for force in (0.01, 0.1, 0.4):
            try:
                modulus = component.solve(surface, 0).modulus
                solution = component.solve(surface, force * modulus * surface.rms_slope * surface.nominal_area)
            except InputError:
                continue
            gap, overlap = half_space_errors(surface, solution)
            require(
                max(gap, overlap) <= error,
                f"a rough surface of {shape} pixels, {solution.area_fraction:.3f} of it in contact: from the pressure "
                f"follow a gap of {gap:.2g} rms heights in the contact and an overlap of {overlap:.2g} outside; "
                f"expected at most {error:.2g} (declared_error = {component.declared_error:g})",
            )


@check_of(ContactSolver, unless=(ContactTheory,))
def _start_changes_nothing(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """The solution does not depend on ``start``, be it of another load or of another surface."""
    for surface, load in _solvable(component, surfaces):
        cold = component.solve(surface, load)
        for start in (
            component.solve(surface, 0.5 * load),
            component.solve(surface, 0),
            _elsewhere(component, surface),
        ):
            try:
                warm = component.solve(surface, load, start=start)
            except InputError:
                require(start is None or start.shape != surface.shape, "refused a start at another load")
                continue
            same = same_pressure(warm.pressure, cold.pressure, _tolerance(component, 1e-2))
            require(same, "the solution depends on the start")


def _elsewhere(component: ContactSolver, surface: Surface) -> ContactSolution | None:
    """A contact of another grid, as far as the solver accepts one."""
    cut = Surface(
        heights=np.ascontiguousarray(surface.heights[: surface.shape[0] // 2]),
        pixel_size=surface.pixel_size,
        periodic=surface.periodic,
        provenance=surface.provenance,
    )
    try:
        return component.solve(cut, 1e-3 * cut.nominal_area)
    except InputError:
        return None


# -- speed, and grids -------------------------------------------------------------------------------------------------


@check_of(ContactSolver, unless=(ContactTheory,))
def _trade_is_from_fast_to_accurate(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """The values of each option of ``trade`` give the same contact, the last ones nearly so."""
    surface, load = _solvable(component, surfaces)[0]
    for name, variants in trade_variants(component):
        pressures = [variant.solve(surface, load).pressure.astype(np.float64) for _, variant in variants]
        if any(pressure.shape != pressures[-1].shape for pressure in pressures):
            raise AssertionError(f"trade of {name!r} changes the grid of the solution")
        errors = [difference(pressure, pressures[-1]) for pressure in pressures[:-1]]
        listed = ", ".join(f"{what}: {error:.2g}" for (what, _), error in zip(variants, errors, strict=False))
        require(
            max(errors) <= 0.3,
            f"trade of {name!r} is another contact and not one at another accuracy; pressures differ from those of the "
            f"last value by {listed}",
        )
        require(
            len(errors) < 2 or errors[-1] <= max(0.5 * errors[0], 1e-3),
            f"trade of {name!r} is not from fast to accurate; pressures differ from those of the last value: {listed}",
        )


@check_of(ContactSolver, unless=(ContactTheory,))
def _reference_solves_the_same_contact(component: ContactSolver, surfaces: Sequence[Surface] = ()) -> None:
    """``reference()`` returns a solver of the same class, with the same contact up to the errors of the component."""
    reference = component.reference()
    require(isinstance(reference, type(component)), f"reference() returned {reference!r}")
    for surface, load in _solvable(component, surfaces):
        pressure = component.solve(surface, load).pressure
        require(
            same_pressure(pressure, reference.solve(surface, load).pressure, 1e-2), "reference() solves another contact"
        )


@check_of(ContactSolver, unless=(ContactTheory,))
def _odd_grids_are_solved(component: ContactSolver) -> None:
    """Grids that are not square, odd, one pixel wide or one pixel are solved, or refused with an InputError."""
    for shape in ((15, 32), (9, 7), (1, 16), (1, 1)):
        for surface in (rough_surface(shape), rough_surface(shape, periodic=False)):
            try:
                solution = component.solve(surface, 1e-2 * surface.nominal_area)
            except InputError:
                continue
            require(solution.shape == shape, f"a solution of {solution.shape} for {shape}")


# -- theories without a map -------------------------------------------------------------------------------------------


@check_of(ContactSolver, known=True)
def _statistics_carry_the_load(component: ContactSolver) -> None:
    """Of a theory, which gives no map: the pressures of its statistics add up to the load at any load, the area grows
    with the load and is no larger than the nominal area, and a map is refused."""
    if not isinstance(component, ContactTheory):
        return
    roughness = Roughness(rms_slope=0.1, rms_height=1.0, nominal_area=1e6)
    areas = []
    for load in (0.0, 1e2, 1e4, 1e6, 1e8):
        statistics = component.statistics(roughness, load)
        force = float(statistics.pressure @ statistics.area)
        require(math.isclose(force, load, rel_tol=1e-6), f"the pressures add up to {force:g} nN at {load:g} nN")
        require(statistics.nominal_area == 1e6, f"nominal_area = {statistics.nominal_area:g} nm², expected 1e6 nm²")
        require(
            statistics.contact_area <= 1e6 * (1 + 1e-9),
            f"the contact area {statistics.contact_area:g} is above the nominal",
        )
        require(component.statistics(roughness, load) == statistics, "a second call gave another contact")
        areas.append(statistics.contact_area)
    require(areas[0] == 0.0 and bool(np.all(np.diff(areas) > 0)), f"the area does not grow with the load: {areas} nm²")
    refuses("a map", lambda: component.solve(flat().surface, 1.0))
