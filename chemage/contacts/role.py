"""The roles that solve contacts, and the second stage: a solver presses a surface on a half-space."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

from chemage.contacts.options import beyond_elasticity, normal_force
from chemage.contacts.search import OVER, SoughtLoad
from chemage.contacts.solution import Contact, ContactSolution, ContactStatistics
from chemage.foundation import container
from chemage.foundation.checks import expect
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import kept, recording
from chemage.foundation.progress import logged, of_plugins
from chemage.foundation.records import merged_changes
from chemage.foundation.units import QuantityLike, convert
from chemage.plugins import registry
from chemage.plugins.sources import approximation_of, approximations, providers
from chemage.surfaces.surface import Roughness, Surface

#: what precedes a file of results with a contact of the mean contact pressure of a load
AS = "as "


class ContactSolver(Component, ABC):
    """Role ``contact``: presses a surface against an elastic half-space."""

    role = "contact"
    #: the ``declared_error`` of a solver for an elastic half-space is the largest relative error (L2 norm) of its
    #: pressure; the checks compare it with closed forms to within this. None: another model, or no claim
    error_of = "the pressure"
    # not annotated for type checkers, so that a class can make them properties
    if TYPE_CHECKING:
        implemented_properties = cast("tuple[str, ...]", ())
        gives_map = True
        adheres = False
    else:
        #: what a solution of this solver carries
        implemented_properties: ClassVar[tuple[str, ...]] = ("pressure",)
        #: gives the pressure at each pixel; False for a :class:`ContactTheory`
        gives_map: ClassVar[bool] = True
        #: its surfaces adhere: its solutions have contact without load and under a pull, which is a load below zero
        adheres: ClassVar[bool] = False

    @abstractmethod
    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        """Solve for ``load`` in nN (finite, ≥ 0 unless the class ``adheres``). ``start`` is a neighbouring
        solution to begin from, or None."""

    def expected(
        self, surface: Mapping[str, float], load: float
    ) -> dict[str, float]:
        """Estimate what a solve will give and cost from :meth:`SurfaceMaker.expected`, as far as it is known:
        ``area_fraction``, ``cpu_seconds``, ``bytes`` (peak memory), ``gap_bytes`` (of the gap and the plastic
        displacement, where the solution has them), ``max_pressure`` (GPa, that the solver allows), ``tabor``
        (Tabor's parameter of a sphere that adheres). Used by ``chemage
        check`` and to plan sweeps."""
        return {}

    def check(
        self, surface: Mapping[str, float], load: float
    ) -> Sequence[str] | None:
        """Refuse, before anything is computed, what :meth:`solve` would refuse: a surface of which
        :meth:`SurfaceMaker.expected` gives ``surface``, under ``load`` nN. Used by ``chemage check``.

        What can be solved but is doubtful is returned as sentences, each of which is a warning of the plan; None: there
        is nothing to warn of.

        Raises
        ------
        InputError
            As :meth:`solve`, as far as it is known.
        """

    def is_nominally_flat(self, periodic: bool) -> bool:
        """Whether the contact has a nominal area, so that its load may be given as a nominal pressure; ``periodic``:
        whether the grid of the surface repeats. Override it where the class decides which boundary a surface has."""
        return periodic

    def provenance(self, surface: Surface | Roughness) -> dict[str, Any]:
        """How a contact of this surface was made, for its ``provenance``: kind, options, and the surface's own."""
        options = self.identity()
        return {
            "kind": options.pop("kind"),
            "options": options,
            "surface": surface.provenance,
        }

    def normal_force(
        self, load: QuantityLike, surface: Surface | Roughness | Mapping[str, float]
    ) -> float:
        """``load`` in nN: a force (nN, or a string with its unit), or a nominal pressure such as ``"10 MPa"``, which is
        multiplied by the nominal area of ``surface``: one that is made, its roughness, or what
        :meth:`SurfaceMaker.expected` gives of it. That of a mean contact pressure such as ``"3 GPa over contact"`` is a
        :class:`SoughtLoad`, which :meth:`solve` finds.

        Raises
        ------
        InputError
            The load is negative and nothing adheres, not finite or of another dimension, or it is a pressure and the
            surface has no nominal area: it is a tip, not periodic, or not known yet. A mean contact pressure is not
            below the hardness.
        """
        if isinstance(load, SoughtLoad):
            return load
        if (pressure := sought_pressure(load)) is not None:
            return self._sought(pressure, surface)
        area: float | None
        if isinstance(surface, Mapping):
            on_grid = {"nx", "ny", "pixel_size"} <= surface.keys()
            area = (
                surface["nx"] * surface["ny"] * surface["pixel_size"] ** 2
                if on_grid
                else None
            )
            periodic = (
                surface.get("periodic", 0.0 if "radius" in surface else 1.0) != 0
            )
        else:
            area, periodic = (
                surface.nominal_area,
                getattr(surface, "periodic", True),
            )
        return normal_force(
            load, area, flat=self.is_nominally_flat(periodic), signed=self.adheres
        )

    def _sought(
        self, pressure: float, surface: Surface | Roughness | Mapping[str, float]
    ) -> SoughtLoad:
        """Where the search for the load of a mean contact ``pressure`` (GPa) begins."""
        if not isinstance(surface, Mapping):
            pixel = getattr(surface, "pixel_size", 1.0)
            known = {"ny": 1.0, "pixel_size": pixel, "rms_slope": surface.rms_slope}
            known["nx"] = surface.nominal_area / pixel**2
            known["periodic"] = float(getattr(surface, "periodic", True))
            radius = surface.provenance.get("radius")
            surface = known | ({} if radius is None else {"radius": radius})
        pixel = surface.get("pixel_size", 1.0)
        nominal = surface.get("nx", 1.0) * surface.get("ny", 1.0) * pixel**2
        most = self.expected(surface, nominal).get("max_pressure", math.inf)
        if pressure >= most:
            raise InputError.of(
                "load",
                f"{pressure:g} GPa {OVER}",
                f"is not below the hardness of {most:g} GPa, at which all of the contact flows",
                "give a smaller pressure, or a force",
            )

        def area(load: float) -> float:
            fraction = self.expected(surface, load).get("area_fraction", 0.1)
            return nominal * max(fraction, 1e-300)

        return SoughtLoad.of(pressure, area, 0.1 * nominal, pixel**2)

    def warm_up(self, surface: Mapping[str, float], load: float) -> None:
        """Compile what :meth:`solve` will need for a surface of which :meth:`SurfaceMaker.expected` gives ``surface``,
        under ``load`` nN; solve nothing. Default: nothing is compiled.

        In the first run after an installation, a second process calls it while the first one solves, so that it should
        begin with what a solve needs last. Whatever it raises there is ignored.
        """

    def with_gap(self) -> Self:
        """This solver, with the gap in its solutions if it has the option ``gap``, for sites smaller than pixels."""
        return (
            self.replace(gap=True) if getattr(self, "gap", None) is False else self
        )

    def reference(self) -> Self:
        """The solver with which ``chemage tradeoff`` measures the errors of this one: the same contact, as accurately
        as this class can solve it.

        Here every option in ``trade`` has its most accurate value. Override it where the class can do better than
        that; otherwise the error of the most accurate setting is not known, unless the solver estimates it
        (``ContactSolution.convergence["pressure_error"]``).
        """
        return super().reference()

    def solve(
        self,
        surface: Surface,
        load: QuantityLike,
        *,
        start: ContactSolution | None = None,
    ) -> ContactSolution:
        """The contact of ``surface`` under ``load``: a force (nN, or a string with its unit), a nominal pressure
        such as ``"10 MPa"``, see :meth:`normal_force`, or the load at which the mean contact pressure is
        ``"3 GPa over contact"``, see :meth:`SoughtLoad.found`.

        Raises
        ------
        InputError
            The load is negative or not finite, or the solver cannot treat this surface.
        ConvergenceError
            The tolerance was not reached.
        """
        expect(
            "surface", surface, Surface, "make one with chemage.surface(...).make()"
        )
        if start is not None:
            expect(
                "start",
                start,
                ContactSolution,
                "give a solution of a neighbouring load",
            )
        force = self.normal_force(load, surface)
        if isinstance(force, SoughtLoad):
            return force.found(
                lambda each, near: self.solve(surface, each, start=near), start
            )
        with recording() as recorded:
            solution = self._solve(surface, force, start)
        return (
            solution.model_copy(update=kept(solution, recorded))
            if recorded
            else solution
        )


def contact(kind: str, **options: Any) -> Any:
    """A contact solver: ``chemage.contact("fft-bem", modulus="35.3 GPa").solve(surface, load="20 uN")``."""
    return registry.current().make("contact", kind, options)


def is_sought(load: object) -> bool:
    """Whether a load is one such as ``"3 GPa over contact"`` or ``"as rough.h5"``; no file is read."""
    return isinstance(load, str) and (load.startswith(AS) or load.endswith(OVER))


def sought_pressure(load: object) -> float | None:
    """The mean contact pressure (GPa) in a load such as ``"3 GPa over contact"``, or ``"as rough.h5"``: of the contact
    in a file of results; None in another load.

    Raises
    ------
    InputError
        It is not above zero and finite.
    StoreError
        There is no such file.
    """
    if not isinstance(load, str) or not is_sought(load):
        return None
    if load.startswith(AS):
        kinds = {"contact": ContactSolution, "statistics": ContactStatistics}
        found = container.read(load.removeprefix(AS), kinds)[0].values()
        pressure = sum(contact.mean_contact_pressure for contact in found)
    else:
        pressure = convert(load.removesuffix(OVER), "GPa", "load")
    if not 0 < pressure < math.inf:
        problem = "must be a pressure that is finite and above zero, or a file with a contact"
        raise InputError.of("load", load, problem, f'give "3 GPa {OVER}"')
    return pressure


def sphere_radius(contact: Contact) -> float | None:
    """Radius (nm) of the sphere that was pressed, by the ``provenance`` of its contact; None: another surface."""
    made = contact.provenance.get("surface")
    radius = made.get("radius") if isinstance(made, Mapping) else None
    return (
        float(radius)
        if isinstance(radius, int | float) and not isinstance(radius, bool)
        else None
    )


def elasticity_notes(contact: Contact) -> tuple[str, ...]:
    """That linear elasticity does not hold in a contact, in words; empty where it does."""
    # that of a sphere is mostly the slope of its flanks
    slope = contact.rms_slope if sphere_radius(contact) is None else math.nan
    largest = contact.measure("max_pressure")
    beyond = beyond_elasticity(
        contact.modulus, slope, contact.mean_contact_pressure, largest
    )
    return (beyond,) if beyond else ()


def expect_contact(value: Any, cls: type[Contact] = ContactSolution) -> None:
    """Raise an InputError if ``value`` is no contact, or none with a map where ``cls`` is as by default."""
    expect(
        "contact",
        value,
        cls,
        "make one with chemage.contact(...).solve(surface, load)",
    )


def solve_contact(
    solver: ContactSolver,
    surface: Surface,
    load: QuantityLike,
    *,
    start: ContactSolution | None = None,
) -> ContactSolution:
    """The contact of ``surface`` under ``load`` (a force or a nominal pressure), by the hook ``chemage_solve_contact``.

    The plugins that took part, here or at the surface, are noted in the solution's ``provenance``.
    """
    expect(
        "solver",
        solver,
        ContactSolver,
        'make one with chemage.contact("hertz", ...)',
    )
    expect("surface", surface, Surface, "make one with chemage.surface(...).make()")
    force = solver.normal_force(load, surface)
    if isinstance(force, SoughtLoad):
        return force.found(
            lambda each, near: solve_contact(solver, surface, each, start=near),
            start,
        )
    with logged(
        "contact",
        f"{solver.kind}, load {force:g} nN, {surface.shape[0]} x {surface.shape[1]} pixels",
    ) as out:
        solution, took_part, recorded = registry.current().answer(
            "chemage_solve_contact",
            ContactSolution,
            solver=solver,
            surface=surface,
            load=force,
            start=start,
        )
        # a plugin that answers with another solver may record which
        kind = solution.provenance.get("kind")
        used = (
            approximation_of("contact", kind)
            if isinstance(kind, str) and kind != solver.qualified_kind()
            else []
        )
        approximate = [
            *surface.approximate,
            *approximations(solver),
            *used,
            *solution.unloaded(),
        ]
        plugins = surface.plugins | providers(solver) | took_part.plugins
        solution = solution.noting(
            plugins,
            approximate,
            kept(solution, surface.recorded | recorded),
            merged_changes(surface.changes, took_part.changes),
        )
        out(
            f"{solution.iterations} iterations, residual {solution.residual:.3g}; {of_plugins(solution.plugins)}"
        )
    return solution
