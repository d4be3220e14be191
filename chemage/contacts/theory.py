"""Theories of the area of contact and of the distribution of the pressure: their class, and closed forms. Pressures in
GPa."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from chemage.contacts.role import ContactSolver
from chemage.contacts.search import SoughtLoad
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.checks import Seed, expect
from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.units import QuantityLike
from chemage.plugins.sources import approximations, providers
from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.surface import Roughness, Surface


class ContactTheory(ContactSolver, ABC):
    """A contact of role ``contact`` that needs no heights and gives no map: area and distribution of the pressure."""

    exact = False
    error_of = "the contact area"
    implemented_properties = ()
    gives_map = False

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
        self,
        surface: Roughness | Surface | SurfaceMaker,
        load: QuantityLike,
        seed: Seed = 0,
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
        expect(
            "surface",
            surface,
            Roughness,
            "give a surface, the maker of one, or its Roughness",
        )
        force = self.normal_force(load, surface)
        if isinstance(force, SoughtLoad):
            known = surface
            return force.found(lambda each, _: self.statistics(known, each))
        statistics = self._statistics(surface, force)
        error = self.relative_error(surface, force)
        if fault := statistics.load_fault(0.0):
            raise PluginError(f"contact {self.kind!r}: {fault}")
        approximate = approximations(*parts)
        own = (
            []
            if error is None
            else [
                entry
                for entry in approximate
                if entry["kind"] == self.qualified_kind()
            ]
        )
        own = [
            {**entry, "declared_error": error, "of": self.error_of} for entry in own
        ]
        others = [
            entry for entry in approximate if entry["kind"] != self.qualified_kind()
        ]
        others += statistics.unloaded()
        return statistics.noting(
            surface.plugins | providers(*parts),
            [*surface.approximate, *own, *others],
            changes=surface.changes,
        )

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        raise InputError(
            no_map(
                self,
                "the pressure at each pixel cannot be given; call its method statistics",
            )
        )


def no_map(theory: ContactSolver, what: str) -> str:
    """The one sentence of what a contact without a map cannot do."""
    return f"contact {theory.kind!r} gives statistics and no map, so that {what}; or use a contact that is solved"


def persson_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Persson's contact fraction erf(√2 x), x = p̄/(E* h'_rms). Persson, J. Chem. Phys. 115, 3840 (2001)."""
    from scipy.special import erf

    return erf(np.sqrt(2) * x)


def bgt_area_fraction(x: float | np.ndarray) -> float | np.ndarray:
    """Asymptotic contact fraction √(2π) x of Bush, Gibson & Thomas, Wear 35, 87 (1975), x = p̄/(E* h'_rms)."""
    return np.sqrt(2 * np.pi) * x


def persson_pressure_density(
    pressure: np.ndarray, mean_pressure: float, modulus: float, rms_slope: float
) -> np.ndarray:
    """Persson's density of the pressure p > 0 over the nominal area (1/GPa); its integral is the contact fraction.

    [exp(−(p−p̄)²/2σ²) − exp(−(p+p̄)²/2σ²)]/(σ√(2π)) with σ = E* h'_rms/2.
    """
    sigma = 0.5 * modulus * rms_slope
    p = np.asarray(pressure, dtype=np.float64)
    near = np.exp(-0.5 * ((p - mean_pressure) / sigma) ** 2)
    # the difference of the two Gaussians as a product: no cancellation at small mean pressure
    return (
        -near
        * np.expm1(-2 * p * mean_pressure / sigma**2)
        / (sigma * math.sqrt(2 * math.pi))
    )
