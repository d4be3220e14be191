"""The role that solves a contact."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Self

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import expect, force
from chemage.foundation.components import Component
from chemage.surfaces.surface import Surface


class ContactSolver(Component, ABC):
    """Role ``contact``: presses a surface against an elastic half-space."""

    role = "contact"
    #: what a solution of this solver carries
    implemented_properties: ClassVar[tuple[str, ...]] = ("pressure",)
    #: of a solver for an elastic half-space, the largest relative error (L2 norm) of its pressure; the checks compare
    #: it with closed forms to within this. None: another model, or no claim
    declared_error: ClassVar[float | None] = None
    error_of: ClassVar[str] = "the pressure"

    @abstractmethod
    def _solve(self, surface: Surface, load: float, start: ContactSolution | None) -> ContactSolution:
        """Solve for ``load`` in nN (finite, ≥ 0). ``start`` is a neighbouring solution to begin from, or None."""

    def expected(self, surface: Mapping[str, float], load: float) -> dict[str, float]:
        """Estimate what a solve will give and cost from :meth:`SurfaceMaker.expected`, as far as it is known:
        ``area_fraction``, ``cpu_seconds``, ``bytes`` (peak memory), ``gap_bytes`` (of the gap, where the solution has
        one). Used by ``chemage check`` and to plan sweeps."""
        return {}

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """Refuse, before anything is computed, what :meth:`solve` would refuse: a surface of which
        :meth:`SurfaceMaker.expected` gives ``surface``, under ``load`` nN. Used by ``chemage check``.

        Raises
        ------
        InputError
            As :meth:`solve`, as far as it is known.
        """

    def with_gap(self) -> Self:
        """This solver, with the gap in its solutions if it has the option ``gap``, for sites smaller than pixels."""
        return self.replace(gap=True) if getattr(self, "gap", None) is False else self

    def reference(self) -> Self:
        """The solver with which ``chemage tradeoff`` measures the errors of this one: the same contact, as accurately
        as this class can solve it.

        Here every option in ``trade`` has its most accurate value. Override it where the class can do better than
        that; otherwise the error of the most accurate setting is not known, unless the solver estimates it
        (``ContactSolution.convergence["pressure_error"]``).
        """
        return super().reference()

    def solve(self, surface: Surface, load: float | str, *, start: ContactSolution | None = None) -> ContactSolution:
        """The contact of ``surface`` under ``load`` (nN, or a string with its unit).

        Raises
        ------
        InputError
            The load is negative or not finite, or the solver cannot treat this surface.
        ConvergenceError
            The tolerance was not reached.
        """
        expect("surface", surface, Surface, "make one with chemage.surface(...).make()")
        if start is not None:
            expect("start", start, ContactSolution, "give a solution of a neighbouring load")
        return self._solve(surface, force(load), start)
