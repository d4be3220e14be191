"""Checks of a contact solver, with contacts of a half-space whose pressure is known, and the independent test of any
other one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import product
from operator import attrgetter
from typing import Any

import numpy as np

from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.contacts.theory import ContactTheory
from chemage.foundation.errors import InputError, MissingError
from chemage.surfaces.surface import Roughness, Surface
from chemage.testing.answers import as_bytes, independent_calls
from chemage.testing.checks import (
    Checks,
    Questions,
    known,
    refuses,
    require,
    require_estimates,
    require_plain,
    whole,
)
from chemage.testing.known_contacts import (
    HalfSpace,
    flat,
    hertz,
    paraboloid,
    sinusoid,
)

check_contact_solver = whole(
    ContactSolver,
    surfaces="surfaces to solve besides those of the checks",
    force_tolerance="the accepted relative error of the force",
)


def rough_surface(
    shape: tuple[int, int] = (32, 32), seed: int = 0, **fields: Any
) -> Surface:
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
                heights += (
                    height
                    * (size * max(shape)) ** -1.8
                    * np.cos(2 * np.pi * (i * x + j * y + phase))
                )
    fields = {"pixel_size": 0.5, **fields}
    slope = Surface(heights=heights, **fields).rms_slope
    return Surface(heights=heights * (0.1 / slope if slope > 0 else 0), **fields)


def _accepted(
    component: ContactSolver, surface: Surface, load: float
) -> ContactSolution | None:
    """The contact; None where the solver refuses it."""
    try:
        return component.solve(surface, load)
    except MissingError:
        raise
    except InputError:
        return None


def difference(one: np.ndarray, two: np.ndarray) -> float:
    """Relative L2 difference of two pressures."""
    size = float(np.linalg.norm(two))
    return (
        float(np.linalg.norm(one - two)) / size
        if size and one.shape == two.shape
        else math.inf
    )


def _on_surfaces(
    function: Callable[[Any, Surface, ContactSolution], None],
) -> Callable[..., None]:
    """Declare a check of a solver with its solution on each surface that it accepts."""

    @wraps(function)
    def check(self: ContactChecks, surfaces: Sequence[Surface] = ()) -> None:
        for surface, load in self._solvable(surfaces):
            function(self, surface, self.component.solve(surface, load))

    return check


class ContactChecks(Checks[ContactSolver], of=ContactSolver):
    """What every solver that gives a map of the pressure must do."""

    unless = (ContactTheory,)

    def _solvable(
        self, surfaces: Sequence[Surface] = ()
    ) -> list[tuple[Surface, float]]:
        """The surfaces that the solver accepts, each with a load (nN) that brings a part of it into contact: a fiftieth
        of E* h'_rms A0, at which a half-space is in full contact or nearly so."""
        accepted = []
        own = (
            rough_surface(),
            paraboloid(),
            rough_surface((27, 36), seed=3),
            rough_surface((20, 31), seed=4, periodic=False),
        )
        for surface in (*surfaces, *own):
            light = _accepted(self.component, surface, 1e-3 * surface.nominal_area)
            if light is not None:
                given = type(light).__name__
                require(
                    isinstance(light, ContactSolution),
                    f"solve() returned {given}; expected a ContactSolution",
                )
                accepted.append(
                    (
                        surface,
                        0.02
                        * light.modulus
                        * surface.rms_slope
                        * surface.nominal_area,
                    )
                )
        require(
            accepted,
            "refused rough surfaces and a paraboloid; give surfaces=[...] that it accepts",
        )
        return accepted

    def _pressed(self, surface: Surface, load: float) -> ContactSolution | None:
        """The contact under the ``load`` (nN) times the modulus of the solver in GPa; None where it is refused."""
        none = _accepted(self.component, surface, 0)
        return (
            None
            if none is None
            else _accepted(self.component, surface, none.modulus * load)
        )

    def _require_same(
        self, what: str, one: np.ndarray, two: np.ndarray, least: float
    ) -> None:
        """Require that two equivalent solutions differ by ``least`` at most, or by the error that the solver
        declares."""
        away = difference(one, two)
        require(
            away <= max(least, self.component.declared_error or 0.0),
            f"{what}: the pressures differ by {away:.2g} (relative L2 norm)",
        )

    def questions(self, surfaces: Sequence[Surface] = (), **_: Any) -> Questions:
        of_map = attrgetter("pressure", "gap", "displacement", "modulus", "notes")
        of_theory = attrgetter("pressure", "area", "missing")

        def ask(surface: Surface, load: float) -> Any:
            return lambda solver: [
                of_map(one.solve(surface, load))
                for one in (solver, solver.with_gap())
            ]

        if isinstance(self.component, ContactTheory):
            for slope, load in ((0.11, 1.3e5), (0.12, 1.3e5), (0.11, 1.7e5)):
                given = (
                    Roughness(rms_slope=slope, rms_height=1.0, nominal_area=1e6),
                    load,
                )
                yield (
                    f"a slope of {slope} under {load:g} nN",
                    lambda theory, given=given: of_theory(
                        theory.statistics(*given)
                    ),
                )
            return
        for number, (surface, load) in enumerate(self._solvable(surfaces)):
            radius = surface.provenance.get("radius")
            higher = {"provenance": {"radius": radius / 1.07}} if radius else {}
            yield f"surface {number}", ask(surface, 0.91 * load)
            # what is kept of a load that is nearly the same would show
            yield f"surface {number} under another load", ask(surface, 0.93 * load)
            other = surface.model_copy(
                update={"heights": 1.07 * surface.heights, **higher}
            )
            yield f"surface {number} with higher summits", ask(other, 0.91 * load)
            yield (
                f"surface {number} with higher summits under another load",
                ask(other, 0.73 * load),
            )
            if not radius:
                larger = other.model_copy(
                    update={"pixel_size": 1.3 * surface.pixel_size}
                )
                yield (
                    f"surface {number} with higher summits and larger pixels",
                    ask(larger, 0.73 * load),
                )

    # -- the form of the answer ----------------------------------------------------------------------------------------

    @known
    def contact_carries_the_load(
        self, surfaces: Sequence[Surface] = (), force_tolerance=1e-6
    ) -> None:
        """The pressure (GPa) adds up to the load (nN), and some but not all pixels are in contact. It is nowhere
        negative, unless the surfaces adhere: then there is tension (or ``carries`` says where the attraction is left
        out), and ``touching`` says where they touch."""
        component = self.component
        for surface, load in self._solvable(surfaces):
            solution = component.solve(surface, load)
            require(
                solution.load == load,
                f"the load is {load} nN, the solution has {solution.load} nN",
            )
            elsewhere = component.adheres and solution.carries
            require(
                elsewhere
                or abs(solution.carried - load) <= force_tolerance * solution.borne,
                f"the pressure integrates to {solution.carried!r} nN, the load is {load!r} nN (1 GPa nm² is 1 nN)",
            )
            require(
                0 < solution.sites.size < solution.pressure.size,
                f"{solution.area_fraction=}: expected some contact",
            )
            told = solution.touching is not None
            require(
                told == component.adheres,
                f"adheres = {component.adheres}, and the solution has touching: {told}; with adhesion it must, "
                "else not",
            )
            least = solution.pressure.min()
            require(least >= 0 or component.adheres, "negative pressure")
            require(
                least < 0 or elsewhere or not component.adheres,
                "adheres, but there is no tension, and carries does not say where the attraction is",
            )

    @_on_surfaces
    def contact_is_deterministic(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """The same contact gives the same bytes, whatever was solved before; the surface stays as it was."""
        heights, solver = surface.heights.tobytes(), self.component.with_gap()
        first, _, again = (
            solver.solve(surface, factor * solution.load) for factor in (1, 0.4, 1)
        )
        for name in ("pressure", "gap", "displacement"):
            require(
                as_bytes(getattr(first, name)) == as_bytes(getattr(again, name)),
                f"two solutions of the same contact differ in their {name}",
            )
        require(
            surface.heights.tobytes() == heights,
            "the heights of the surface changed",
        )

    calls_are_independent = independent_calls

    @_on_surfaces
    def solution_describes_itself(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """Grid, pixel size, periodicity and roughness are the surface's, the modulus is the solver's, and all that it
        implements is there."""
        for name in ("shape", "pixel_size", "periodic", "rms_slope", "rms_height"):
            mine, its = getattr(solution, name), getattr(surface, name)
            same = mine == its or (
                name.startswith("rms") and math.isclose(mine, its, rel_tol=1e-6)
            )
            require(same, f"{name} is {mine}, the surface has {its}")
        if "GPa" in self.units().get("modulus", ""):
            mine, its = solution.modulus, getattr(self.component, "modulus", None)
            require(
                its is None or math.isclose(mine, its),
                f"modulus is {mine} GPa, the solver has {its} GPa",
            )
        for name in self.component.implemented_properties:
            # an option switches on what takes memory
            complete = (
                self.component.with_gap().solve(surface, solution.load)
                if name == "gap"
                else solution
            )
            require(
                getattr(complete, name, None) is not None,
                f"implements {name!r}, but the solution has none",
            )
        require(
            solution.converged,
            "did not converge, and did not raise ConvergenceError",
        )
        require(math.isfinite(solution.residual), f"residual {solution.residual}")
        require_plain(solution.provenance, "provenance")
        require(
            solution.provenance,
            "provenance is empty; record how the contact was solved, such as self.todict()",
        )
        require_plain(solution.convergence, "convergence")

    @known
    def no_load_is_no_contact(self, surfaces: Sequence[Surface] = ()) -> None:
        """At load 0 no pixel is in contact, unless the surfaces adhere."""
        for surface, _ in (
            () if self.component.adheres else self._solvable(surfaces)
        ):
            solution = self.component.solve(surface, 0)
            require(
                solution.sites.size == 0 and solution.load == 0,
                f"{solution.sites.size} pixels in contact at load 0",
            )

    @_on_surfaces
    def wrong_load_is_refused(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """Negative and infinite loads, and loads in another dimension, are InputErrors, and with adhesion a pull that
        parts the surfaces; a load may have its unit."""
        pull = -1e3 * solution.load if self.component.adheres else -1.0
        for wrong in (pull, math.nan, math.inf, "20 nm", "20", True):
            refuses(
                f"load {wrong!r}",
                lambda wrong=wrong: self.component.solve(surface, wrong),
            )
        again = self.component.solve(surface, f"{solution.load!r} nN")
        require(again == solution, "a load with its unit gave another solution")

    def contact_cost_is_estimated(self) -> None:
        """``expected()`` returns finite numbers, from few or many properties of a surface."""
        few = {"nx": 64.0, "ny": 48.0}
        many = {
            **few,
            "pixel_size": 0.5,
            "rms_slope": 0.1,
            "shortest_wavelength": 4.0,
        }
        for surface, load in product(({}, few, many), (0.0, 1.0, 1e9)):
            what = f"expected({surface}, {load})"
            expected = self.component.expected(surface, load)
            require_estimates(
                what,
                expected,
                "cpu_seconds",
                "bytes",
                "gap_bytes",
                "max_pressure",
                "area_fraction",
            )
            share = expected.get("area_fraction", 0.0)
            require(share <= 1, f"{what}: area_fraction = {share!r}")

    # -- where the contact is ------------------------------------------------------------------------------------------

    @_on_surfaces
    def summits_touch_first(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """At a load of a fraction of a pixel's, the highest pixel carries it: heights are not upside down, mirrored,
        transposed or shifted by a pixel."""
        light = 1e-3 * solution.modulus * surface.rms_slope * surface.pixel_size**2
        pressure = self.component.solve(surface, light).pressure
        heights = surface.heights.astype(np.float64)
        top = heights >= heights.max() - 1e-9 * np.ptp(heights)
        at = tuple(map(int, np.unravel_index(np.argmax(pressure), surface.shape)))
        require(
            (pressure[top] > 0).all(),
            f"at a very small load the highest pixels, {np.argwhere(top)[:4].tolist()}, are not in contact; the "
            f"largest pressure is at {at}, which is {heights.max() - heights[at]:.3g} nm lower",
        )
        size = np.maximum(
            pressure, 0
        )  # with adhesion the load is less than what presses
        share = float(size[heights >= np.quantile(heights, 0.9)].sum() / size.sum())
        require(
            share > 0.5,
            f"at a very small load the highest tenth of the surface carries {share:.0%} of it; expected nearly all",
        )

    @_on_surfaces
    def contact_turns_with_the_surface(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """Mirroring, transposing or (where periodic) shifting the surface does the same to the pressure, and no
        more."""
        turns: dict[str, Callable[[np.ndarray], np.ndarray]] = {
            "mirrored along x": np.flipud,
            "mirrored along y": np.fliplr,
            "transposed": np.transpose,
        }
        if surface.periodic:
            turns["shifted by (3, 5) pixels"] = lambda array: np.roll(
                array, (3, 5), (0, 1)
            )
        for what, turn in turns.items():
            turned = _accepted(
                self.component,
                surface.model_copy(update={"heights": turn(surface.heights)}),
                solution.load,
            )
            if turned is not None:
                self._require_same(
                    f"surface {what}",
                    turned.pressure,
                    turn(solution.pressure),
                    1e-2,
                )

    @_on_surfaces
    def gap_is_closed_in_contact(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """Where a gap (nm) is given, at any load: it is nowhere negative, zero where the pressure is positive, to a
        hundredth of the rms height or ten times the declared error of it, and elsewhere not."""
        scale = max(1e-3, self.component.declared_error or 0.0) * surface.rms_height
        for factor in (0.5, 2):
            found = self.component.with_gap().solve(surface, factor * solution.load)
            if found.gap is None:
                return
            require(
                found.gap.min() >= -scale,
                f"the bodies overlap by {-found.gap.min():g} nm",
            )
            closed, open_ = found.gap[found.contact], found.gap[~found.contact]
            gap = float(np.abs(closed).max())
            require(
                gap <= 10 * scale,
                f"a gap of {gap:g} nm where the pressure is positive, at {found.load:.4g} nN",
            )
            require(
                np.mean(open_) > gap,
                f"outside the contact the mean gap is {np.mean(open_):g} nm",
            )

    @_on_surfaces
    def contact_scales(self, surface: Surface, solution: ContactSolution) -> None:
        """Lengths ×3 and load ×9, stresses and load ×2, or a raised surface are equivalent: no unit and no length is
        hidden in the solver."""
        if "modulus" in self.cls.model_fields:
            stiff = self.rescaled(stress=2).solve(surface, 2 * solution.load)
            self._require_same(
                "twice the modulus and load",
                stiff.pressure / 2,
                solution.pressure,
                1e-3,
            )
        radius = surface.provenance.get("radius")
        for what, heights, size in (
            ("three times the size", surface.heights * 3, 3),
            ("raised by 5 nm", surface.heights + 5, 1),
        ):
            provenance = {"radius": radius * size} if radius else {}
            changes = {
                "heights": heights,
                "pixel_size": surface.pixel_size * size,
                "provenance": provenance,
            }
            solver = self.rescaled(length=size)
            scaled = _accepted(
                solver, surface.model_copy(update=changes), solution.load * size**2
            )
            if (
                scaled is not None
            ):  # the solver needs no more than heights and radius
                self._require_same(what, scaled.pressure, solution.pressure, 1e-3)

    @_on_surfaces
    def contact_grows_with_load(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """A larger load brings more pixels into contact, and where it is given, a larger approach (nm)."""
        solutions = [
            self.component.solve(surface, factor * solution.load)
            for factor in (0.3, 1.0, 2.0)
        ]
        areas = [one.sites.size for one in solutions]
        require(
            areas == sorted(areas) and areas[0] < areas[-1],
            f"pixels in contact at increasing load: {areas}",
        )
        approaches = [
            one.displacement for one in solutions if one.displacement is not None
        ]
        require(
            approaches == sorted(set(approaches)),
            f"displacement (approach of the bodies, nm) at increasing load: {approaches}; expected it to increase",
        )

    # -- how large the pressure is -------------------------------------------------------------------------------------

    @known
    def known_contacts_are_found(self) -> None:
        """Where ``declared_error`` is given: flat, sinusoidal (Westergaard) and spherical (Hertz) surfaces on an
        elastic half-space have the pressure of the closed form, to within that error."""
        error, solved = self.component.declared_error, 0
        if error is None:
            return
        waves = [sinusoid(axis, mean) for mean in (1.5, 0.2) for axis in (0, 1)]
        for case in (flat(), *waves[:2], hertz(), *waves[2:]):
            solution = self._pressed(case.surface, case.load)
            if solution is None:
                continue
            solved += 1
            exact = solution.modulus * case.pressure
            away = difference(solution.pressure, exact)
            peak = float(solution.pressure.max() / exact.max())
            require(
                away <= error + case.pixels,
                f"{case.name}: the pressure differs from the closed form by {away:.2g} (relative L2 norm); "
                f"declared_error = {error:g}, and the pixels allow for {case.pixels:g}. In contact are "
                f"{solution.area_fraction:.3f} of the pixels, expected {np.mean(exact > 0):.3f}; the largest pressure "
                f"is {peak:.3f} of the expected one",
            )
        require(
            solved, "declares an error, but refuses all surfaces with a closed form"
        )

    @known
    def contact_obeys_the_half_space(
        self, surfaces: Sequence[Surface] = ()
    ) -> None:
        """On rough surfaces the gap that follows from the pressure is zero in contact and positive outside, to within
        the ``declared_error``, so that a solution that is given up early is found. Where none is declared, the contact
        may be that of another model; if it is that of a half-space, it is with the modulus of the solution, with
        adhesion too."""
        declared = self.component.declared_error
        if declared is None:
            for surface, load in self._solvable(surfaces):
                for factor in (1, 5):
                    solution = _accepted(self.component, surface, factor * load)
                    if solution is not None:
                        self._require_modulus(surface, solution)
            return
        error = 3 * declared + 1e-4
        for shape, seed, periodic in (
            ((32, 32), 5, True),
            ((25, 40), 6, True),
            ((20, 31), 7, False),
        ):
            rough = rough_surface(shape, seed, periodic=periodic)
            surface = rough.model_copy(
                update={
                    "heights": 0.05 * rough.heights,
                    "provenance": {"rough": seed},
                }
            )
            for force in (0.01, 0.1, 0.4):
                solution = self._pressed(
                    surface, force * surface.rms_slope * surface.nominal_area
                )
                if solution is None:
                    continue
                gap, overlap, *_ = HalfSpace.of(surface, solution)
                require(
                    max(gap, overlap) <= error,
                    f"a rough surface of {shape} pixels, {solution.area_fraction:.3f} of it in contact: from the "
                    f"pressure follow a gap of {gap:.2g} rms heights in the contact and an overlap of {overlap:.2g} "
                    f"outside; expected at most {error:.2g} (declared_error = {declared:g})",
                )

    def _require_modulus(self, surface: Surface, solution: ContactSolution) -> None:
        """Require of a contact of a half-space, which any other model is far from, that its modulus is the stated
        one."""
        found = HalfSpace.of(surface, solution)
        require(
            not found.rest < 0.03
            or (
                math.isclose(found.modulus, 1.0, rel_tol=0.05)
                and found.overlap < 0.05
            ),
            f"a surface of {surface.shape} pixels under {solution.load:.4g} nN: the pressure is that of a half-space "
            f"whose modulus is {found.modulus:.3f} of the {solution.modulus:g} GPa that the solution has, with an "
            f"overlap of {found.overlap:.2g} rms heights outside the contact; the contact modulus is E* = E/(1 - ν²) "
            "against a rigid body",
        )

    @_on_surfaces
    def start_changes_nothing(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """The solution does not depend on ``start``, be it of another load or of another surface."""
        half = surface.model_copy(
            update={"heights": surface.heights[: surface.shape[0] // 2]}
        )
        others = [
            self.component.solve(surface, share * solution.load)
            for share in (0.5, 0)
        ]
        for start in (
            *others,
            _accepted(self.component, half, 1e-3 * half.nominal_area),
        ):
            try:
                warm = self.component.solve(surface, solution.load, start=start)
            except InputError:
                require(
                    start is None or start.shape != surface.shape,
                    "refused a start at another load",
                )
                continue
            self._require_same(
                "the solution depends on the start",
                warm.pressure,
                solution.pressure,
                1e-2,
            )

    # -- speed, and grids ----------------------------------------------------------------------------------------------

    def trade_is_from_fast_to_accurate(
        self, surfaces: Sequence[Surface] = ()
    ) -> None:
        """The values of each option of ``trade`` give the same contact, the last ones nearly so."""
        surface, load = self._solvable(surfaces)[0]
        for name, variants in self.trade_variants():
            *others, last = (
                variant.solve(surface, load).pressure.astype(np.float64)
                for _, variant in variants
            )
            require(
                all(one.shape == last.shape for one in others),
                f"trade of {name!r} changes the grid of the solution",
            )
            errors = [difference(pressure, last) for pressure in others]
            listed = ", ".join(
                f"{what}: {error:.2g}"
                for (what, _), error in zip(variants, errors, strict=False)
            )
            require(
                max(errors) <= 0.3,
                f"trade of {name!r} is another contact and not one at another accuracy; pressures differ from those of "
                f"the last value by {listed}",
            )
            require(
                len(errors) < 2 or errors[-1] <= max(0.5 * errors[0], 1e-3),
                f"trade of {name!r} is not from fast to accurate; pressures differ from those of the last value: "
                f"{listed}",
            )

    @_on_surfaces
    def reference_solves_the_same_contact(
        self, surface: Surface, solution: ContactSolution
    ) -> None:
        """``reference()`` returns a solver of the same class, with the same contact up to the errors of the
        component."""
        reference = self.component.reference()
        require(
            isinstance(reference, self.cls), f"reference() returned {reference!r}"
        )
        away = difference(
            solution.pressure, reference.solve(surface, solution.load).pressure
        )
        require(away <= 1e-2, "reference() solves another contact")

    def odd_grids_are_solved(self) -> None:
        """Grids that are not square, odd, one pixel wide or one pixel are solved, or refused with an InputError."""
        for shape in ((15, 32), (9, 7), (1, 16), (1, 1)):
            for surface in (
                rough_surface(shape),
                rough_surface(shape, periodic=False),
            ):
                solution = _accepted(
                    self.component, surface, 1e-2 * surface.nominal_area
                )
                require(
                    solution is None or solution.shape == shape,
                    f"a solution of another shape than {shape}: {solution}",
                )


class TheoryChecks(Checks[ContactSolver], of=ContactSolver):
    """What every theory without a map must do."""

    # -- theories without a map ----------------------------------------------------------------------------------------

    @known
    def statistics_carry_the_load(self) -> None:
        """Of a theory, which gives no map: the pressures of its statistics add up to the load at any load, the area
        grows with the load and is no larger than the nominal area, and a map is refused."""
        component = self.component
        if not isinstance(component, ContactTheory):
            return
        roughness = Roughness(rms_slope=0.1, rms_height=1.0, nominal_area=1e6)
        areas = []
        for load in (0.0, 1e2, 1e4, 1e6, 1e8):
            statistics = component.statistics(roughness, load)
            force, area = statistics.carried, statistics.contact_area
            require(
                math.isclose(force, load, rel_tol=1e-6),
                f"the pressures add up to {force:g} nN at {load:g} nN",
            )
            require(
                statistics.nominal_area == 1e6,
                f"nominal_area = {statistics.nominal_area:g} nm², expected 1e6 nm²",
            )
            require(
                area <= 1e6 * (1 + 1e-9),
                f"the contact area {area:g} is above the nominal",
            )
            require(
                component.statistics(roughness, load) == statistics,
                "a second call gave another contact",
            )
            areas.append(area)
            for what, stress, length in (
                ("twice the modulus and load", 2, 1),
                ("three times the lengths", 1, 3),
            ):
                sizes = {
                    "rms_height": 1.0 * length,
                    "nominal_area": 1e6 * length**2,
                }
                other = self.rescaled(stress=stress, length=length).statistics(
                    roughness.model_copy(update=sizes), stress * length**2 * load
                )
                share = other.contact_area / other.nominal_area
                require(
                    math.isclose(share, area / 1e6, rel_tol=1e-3),
                    f"{what}: {share:.4g} of the surface is in contact, and not {area / 1e6:.4g}",
                )
        require(
            areas[0] == 0.0 and bool(np.all(np.diff(areas) > 0)),
            f"the area does not grow with the load: {areas} nm²",
        )
        refuses("a map", lambda: component.solve(flat().surface, 1.0))
