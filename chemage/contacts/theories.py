"""Contacts from the roughness of a surface alone: statistics, and no map of the pressure."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.contacts.statistics import ContactStatistics
from chemage.foundation.checks import Seed, expect
from chemage.foundation.errors import InputError
from chemage.foundation.units import QuantityLike
from chemage.plugins.sources import approximations, providers
from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.surface import Roughness, Surface


class ContactTheory(ContactSolver, ABC):
    """A contact of role ``contact`` that needs no heights and gives no map: area and distribution of the pressure."""

    exact: ClassVar[bool] = False
    error_of: ClassVar[str] = "the contact area"
    implemented_properties: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def _statistics(self, roughness: Roughness, load: float) -> ContactStatistics:
        """Predict the contact under ``load`` in nN (finite, ≥ 0)."""

    def relative_error(self, roughness: Roughness, load: float) -> float | None:
        """Relative error of the contact area under ``load`` in nN that 5 of 100 surfaces exceed; default: the declared
        error."""
        return self.declared_error

    def is_nominally_flat(self, periodic: bool) -> bool:
        """A theory is of the nominal pressure, also where the surface does not repeat."""
        return True

    def statistics(
        self, surface: Roughness | Surface | SurfaceMaker, load: QuantityLike, seed: Seed = 0
    ) -> ContactStatistics:
        """The contact of ``surface`` under ``load``: a force (nN, or a string with its unit) or a nominal pressure.

        A maker of surfaces is asked for its roughness (:meth:`SurfaceMaker.roughness`), which for a spectrum needs no
        heights, so that the surface may have any size.

        Raises
        ------
        InputError
            The load is negative or not finite.
        """
        parts: list[ContactSolver | SurfaceMaker] = [self]
        if isinstance(surface, SurfaceMaker):
            parts.append(surface)
            surface = surface.roughness(seed)
        elif isinstance(surface, Surface):
            surface = Roughness.of(surface)
        expect("surface", surface, Roughness, "give a surface, the maker of one, or its Roughness")
        force = self.normal_force(load, surface)
        made, error = self._statistics(surface, force), self.relative_error(surface, force)
        own = [
            {**one, "declared_error": error, "of": self.error_of} for one in approximations(self) if error is not None
        ]
        others = [one for one in approximations(*parts) if one["kind"] != self.kind]
        return made.noting(surface.plugins | providers(*parts), [*surface.approximate, *own, *others])

    def _solve(self, surface: Surface, load: float, start: ContactSolution | None) -> ContactSolution:
        raise InputError(no_map(self, "the pressure at each pixel cannot be given; call its method statistics"))


def no_map(theory: ContactSolver, what: str) -> str:
    """The one sentence of what a contact without a map cannot do."""
    return f"contact {theory.kind!r} gives statistics and no map, so that {what}; or use a contact that is solved"
