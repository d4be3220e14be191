"""Bonds that break under a force that grows at a constant rate: their mean rupture force and its distribution.

A force F lowers the barrier ΔE of a bond to q ΔE, with q = (1 − νFΔx/ΔE)^(1/ν), and the bond breaks at the rate
k(F) = ν₀ q^(1−ν) exp(−qΔE/k_BT): Dudko, Hummer and Szabo, Phys. Rev. Lett. 96, 108101 (2006), with ν = 1/2 for a
cusp, 2/3 for a linear-cubic potential and 1 for Bell's law. The factor q^(1−ν) makes the published rate fall again once
less than (1 − ν) k_BT of the barrier is left, where the expansion behind it does not hold. Here the rate stays at its
largest value from there on, because no bond breaks more slowly under more force, and it is ν₀ where no barrier is left,
as for every barrier at or below zero. The integrated hazard has a closed form throughout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.special import exp1

from chemage import Chemistry, InputError
from chemage.plugin import (
    EV_PER_GPA_NM3,
    KB,
    Bonded,
    Length,
    Output,
    PlottedResult,
    Rupture,
    Unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: shape of the energy along the reaction coordinate -> ν
EXPONENTS = {"cusp": 0.5, "cubic": 2.0 / 3.0, "constant": 1.0}
#: bonds over which a distribution is averaged at most, and the forces at which it is recorded
BONDS, FORCES = 1000, 400
#: nodes of the quadrature below and above a hazard of LOW; below NONE survival is 1, above ALL it is 0
NODES, NONE, LOW, ALL = (28, 48), 1e-15, 1e-2, 50.0


def scaled_exp1(log_x: np.ndarray) -> np.ndarray:
    """e^x E₁(x) from ln x, without overflow or underflow."""
    near = np.exp(np.clip(log_x, -30.0, 6.0))
    i = np.exp(-np.maximum(log_x, 6.0))
    far = i * (
        1 - i * (1 - 2 * i * (1 - 3 * i * (1 - 4 * i * (1 - 5 * i * (1 - 6 * i)))))
    )
    return np.where(
        log_x > 6.0,
        far,
        np.where(log_x < -30.0, -np.euler_gamma - log_x, np.exp(near) * exp1(near)),
    )


class ForceRamp(NamedTuple):
    """Bonds under a force that grows at a constant rate; energies in k_BT, arrays (n,) for the bonds."""

    barrier: np.ndarray
    """ΔE/k_BT, not negative"""
    exponent: float
    """ν"""
    thermal: float
    """k_BT/Δx, nN"""
    attempts: float
    """ν₀ k_BT/(Δx Ḟ), attempts while the force grows by k_BT/Δx"""

    @property
    def top(self) -> np.ndarray:
        """By how much the barrier is lowered where the rate is largest."""
        return np.maximum(self.barrier - (1 - self.exponent), 0.0)

    @property
    def largest(self) -> np.ndarray:
        """The hazard while the force grows by k_BT/Δx at the largest rate before the barrier vanishes."""
        left = self.barrier - self.top
        share = np.divide(
            left, self.barrier, out=np.ones_like(left), where=self.barrier > 0
        )
        # a barrier below (1 − ν) k_BT is not lowered any more: it keeps the rate that it has without force
        return self.attempts * share ** (1 - self.exponent) * np.exp(-left)

    def force(self, lowered: np.ndarray) -> np.ndarray:
        """The force in units of k_BT/Δx that lowers the barriers (n, ...) by so many k_BT."""
        barrier = self.barrier.reshape(-1, *(1,) * (np.ndim(lowered) - 1))
        part = lowered / np.maximum(barrier, 1e-300)
        share = -np.expm1(self.exponent * np.log1p(-np.minimum(part, 1.0 - 1e-16)))
        full = np.where(part >= 1.0, 1.0, share)
        return barrier / self.exponent * full

    def hazard(self, force: np.ndarray) -> np.ndarray:
        """The hazard (n, f) collected up to ``force`` (f,), in units of k_BT/Δx."""
        barrier, top, slope = (
            column[:, None] for column in (self.barrier, self.top, self.largest)
        )
        corner, end = self.force(top), barrier / self.exponent
        share = np.clip(
            1 - self.exponent * force / np.maximum(barrier, 1e-300), 0.0, 1.0
        )
        lowered = np.minimum(
            barrier * -np.expm1(np.log(np.maximum(share, 1e-300)) / self.exponent),
            top,
        )
        grown = self.attempts * np.exp(lowered - barrier) * -np.expm1(-lowered)
        beyond = np.clip(force, corner, end) - corner
        return grown + slope * beyond + self.attempts * np.maximum(force - end, 0.0)

    def density(self, force: np.ndarray) -> np.ndarray:
        """Probability density (n, f) of the force at rupture, in units of Δx/k_BT."""
        barrier, slope = self.barrier[:, None], self.largest[:, None]
        share = np.clip(
            1 - self.exponent * force / np.maximum(barrier, 1e-300), 1e-300, 1.0
        )
        left = share ** (1 / self.exponent)
        rate = self.attempts * left ** (1 - self.exponent) * np.exp(-left * barrier)
        rate = np.where(left * barrier < barrier - self.top[:, None], slope, rate)
        rate = np.where(force >= barrier / self.exponent, self.attempts, rate)
        return rate * np.exp(-self.hazard(force))

    def mean(self) -> np.ndarray:
        """The mean rupture force (n,), in units of k_BT/Δx: the integral of the survival over the force."""
        top, slope = self.top, self.largest
        log_unit = (
            np.log(self.attempts) - self.barrier
        )  # of the hazard while the force grows by k_BT/Δx, without force
        first, middle, last = (
            np.minimum(np.logaddexp(0.0, np.log(hazard) - log_unit), top)
            for hazard in (NONE, LOW, ALL)
        )
        total = self.force(first)
        for nodes, begin, end in zip(
            NODES, (first, middle), (middle, last), strict=True
        ):
            at, weights = np.polynomial.legendre.leggauss(nodes)
            half = (end - begin)[:, None] / 2
            lowered = begin[:, None] + half * (at + 1)
            # dF/dG; never at its end, which `top` keeps away from the barrier unless ν = 1
            left = 1 - lowered / np.maximum(self.barrier, 1e-300)[:, None]
            slopes = (
                np.maximum(left, 1e-300) ** (self.exponent - 1)
                if self.exponent < 1
                else 1.0
            )
            survival = np.exp(
                np.exp(log_unit[:, None] + lowered) * np.expm1(-lowered)
            )
            total += (
                np.einsum("...i,i->...", slopes * survival, weights) * half[:, 0]
            )
        corner, end = self.force(top), self.barrier / self.exponent
        at_corner = np.exp(
            -self.attempts * np.exp(top - self.barrier) * -np.expm1(-top)
        )
        return total + at_corner * (
            -np.expm1(-slope * (end - corner)) / slope
            + np.exp(-slope * (end - corner)) / self.attempts
        )


class UnderForce(Rupture):
    """A law for bonds under a force that grows at a constant rate, each over its own breaking barrier."""

    states = True
    figures = {
        "rupture-forces": "Distribution of the rupture forces of the bonds there are at the last hold time."
    }
    outputs = {
        "mean_bond_force": Output(
            ("hold_time",), "nN", "mean rupture force of a bond, 0 without bonds"
        ),
        "bond_force_grid": Output(
            ("bond_force",), "nN", "forces at which the distribution is given"
        ),
        "bond_force_density": Output(
            ("bond_force",),
            "1/nN",
            "probability density of the rupture force of the bonds at the last hold time",
        ),
    }

    transition_distance: Length
    """Δx, from the bound state to the transition state along the pull, nm"""
    loading_rate: Annotated[Any, Unit("nN/s", gt=0)] | None = None
    """at which the force on a bond grows, nN/s; default: speed × stiffness"""
    speed: Annotated[Any, Unit("nm/s", gt=0)] | None = None
    """of the pull, nm/s; with ``stiffness``, instead of the loading rate"""
    stiffness: Annotated[Any, Unit("nN/nm", gt=0)] | None = None
    """of a bond with what holds it, nN/nm"""
    front_factor: float | None = Field(default=None, gt=0, le=1)
    """fraction of the bonds that carry load at once as the detachment front passes; default: that of the chemistry"""

    @model_validator(mode="after")
    def _loaded(self) -> Self:
        given = [
            name
            for name in ("speed", "stiffness")
            if getattr(self, name) is not None
        ]
        if (self.loading_rate is None) != (len(given) == 2) or (
            self.loading_rate is not None and given
        ):
            raise ValueError(
                "give either loading_rate, or both speed and stiffness"
            )
        return self

    @property
    def rate(self) -> float:
        """The loading rate, nN/s."""
        return self.loading_rate or (self.speed or 0.0) * (self.stiffness or 0.0)

    @property
    def exponent(self) -> float:
        """ν."""
        return 1.0

    def ramp(
        self, barriers: np.ndarray, temperature: float, attempt_frequency: float
    ) -> ForceRamp:
        """Bonds with these ``barriers`` (n,) eV at ``temperature`` (K) under the loading rate."""
        thermal = KB * temperature / EV_PER_GPA_NM3 / self.transition_distance
        barrier = np.maximum(np.asarray(barriers, np.float64), 0.0) / (
            KB * temperature
        )
        return ForceRamp(
            barrier, self.exponent, thermal, attempt_frequency * thermal / self.rate
        )

    def mean_forces(
        self,
        barriers: np.ndarray,
        temperature: float,
        attempt_frequency: float = 1e13,
    ) -> np.ndarray:
        """The mean rupture force of a bond over each of ``barriers`` (n,) eV: (n,) nN. ``temperature`` in K, ν₀ in
        Hz."""
        ramp = self.ramp(barriers, temperature, attempt_frequency)
        return ramp.thermal * self._mean(ramp)

    def _mean(self, ramp: ForceRamp) -> np.ndarray:
        """In units of k_BT/Δx."""
        return ramp.mean()

    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN, (m,): the sum of the mean rupture forces of all bonds."""
        barriers, nu = bonded.lattice.breaking, bonded.lattice.attempt_frequency
        if barriers is None:
            raise InputError(self._lasting())
        each = self.mean_forces(barriers, bonded.temperature, nu)
        total = np.array([each[state].sum() for state in bonded.states])
        mean = np.divide(
            total, bonded.bonds, out=np.zeros(total.size), where=bonded.bonds > 0
        )
        grid, density = self._distribution(bonded, barriers[bonded.states[-1]])
        self.record(
            mean_bond_force=mean, bond_force_grid=grid, bond_force_density=density
        )
        return total * (
            bonded.chemistry.front_factor
            if self.front_factor is None
            else self.front_factor
        )

    def _distribution(
        self, bonded: Bonded, barriers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The forces up to which the strongest barrier of the chemistry carries, and the density of ``barriers``."""
        nu, breaking = bonded.lattice.attempt_frequency, bonded.chemistry.breaking
        highest = (
            1.0
            if breaking is None
            else float(breaking.quantile(np.array([0.9999]))[0])
        )
        end = 1.2 * float(
            self.mean_forces(np.array([highest]), bonded.temperature, nu)[0]
        )
        ramp = self.ramp(np.array([highest]), bonded.temperature, nu)
        grid = np.linspace(0.0, max(end, 12 * ramp.thermal), FORCES)
        chosen = np.sort(barriers)[
            np.linspace(0, barriers.size - 1, min(barriers.size, BONDS)).astype(int)
        ]
        if not chosen.size:
            return grid, np.zeros(FORCES)
        ramp = self.ramp(chosen, bonded.temperature, nu)
        return grid, ramp.density(grid / ramp.thermal).mean(axis=0) / ramp.thermal

    def _lasting(self) -> str:
        return (
            f"rupture {self.kind!r} needs the barriers to breaking a bond, and here bonds last; give [breaking], or "
            "use 'mean-force'"
        )

    def check(self, chemistry: Chemistry, temperature: float) -> Sequence[str]:
        """See :meth:`chemage.plugin.Rupture.check`: forces and rates that the barrier does not allow."""
        if chemistry.breaking is None:
            raise InputError(self._lasting())
        barrier = max(float(chemistry.breaking.quantile(np.array([0.5]))[0]), 0.0)
        ramp = self.ramp(
            np.array([barrier]), temperature, chemistry.attempt_frequency
        )
        mean = float(self._mean(ramp)[0]) * ramp.thermal
        most = ramp.thermal * float(ramp.barrier[0]) / self.exponent
        about = f"rupture {self.kind!r}: over a barrier of {barrier:.3g} eV at {temperature:g} K"
        doubts = []
        if (
            "bond_force" in chemistry.model_fields_set
            and chemistry.bond_force > most
        ):
            least = most * self.transition_distance / chemistry.bond_force
            doubts.append(
                f"{about} a bond with transition_distance = {self.transition_distance:g} nm breaks at {mean:.3g} nN "
                f"and carries at most {most:.3g} nN; bond_force = {chemistry.bond_force:g} nN of the chemistry is not "
                f"used, and would need a distance below {least:.3g} nm"
            )
        if float(ramp.hazard(np.array([most / ramp.thermal]))[0, 0]) < 5:
            doubts.append(
                f"{about} the barrier vanishes before most bonds break: at {self.rate:.3g} nN/s the law is beyond its "
                "range; use a smaller loading rate"
            )
        if mean < ramp.thermal:
            doubts.append(
                f"{about} bonds break at {mean:.3g} nN, below k_BT/Δx = {ramp.thermal:.3g} nN: they break by "
                f"themselves before {self.rate:.3g} nN/s loads them; use a larger loading rate, or higher barriers "
                "in [breaking]"
            )
        return doubts

    def draw(
        self, figure: str, axes: Axes, results: Sequence[PlottedResult]
    ) -> None:
        """Draw the distribution of the rupture forces of each result, mean over its replicas."""
        end = 0.0
        for result in results:
            if (
                result.ageing is None
                or "bond_force_grid" not in result.ageing.observables
            ):
                continue
            measured: Mapping[str, Any] = result.ageing.observables
            grid = measured["bond_force_grid"][0]
            density = measured["bond_force_density"].mean(axis=0)
            axes.plot(grid, density, color=result.color, lw=1.4, label=result.label)
            end = max(
                end, float(grid[density > 1e-3 * density.max()].max(initial=0.0))
            )
        axes.set(
            xlabel="rupture force of a bond (nN)",
            ylabel="probability density (1/nN)",
            ylim=(0, None),
        )
        axes.set_xlim(0, 1.05 * end or None)
        if len(results) > 1:
            axes.legend(frameon=False, fontsize=7)


BELL = """@article{bell1978,
  author = {Bell, G. I.},
  title = {Models for the specific adhesion of cells to cells},
  journal = {Science},
  volume = {200},
  pages = {618--627},
  year = {1978},
  doi = {10.1126/science.347575},
}"""
EVANS = """@article{evans1997,
  author = {Evans, E. and Ritchie, K.},
  title = {Dynamic strength of molecular adhesion bonds},
  journal = {Biophysical Journal},
  volume = {72},
  pages = {1541--1555},
  year = {1997},
  doi = {10.1016/S0006-3495(97)78802-7},
}"""
DUDKO = """@article{dudko2006,
  author = {Dudko, O. K. and Hummer, G. and Szabo, A.},
  title = {Intrinsic rates and activation free energies from single-molecule pulling experiments},
  journal = {Physical Review Letters},
  volume = {96},
  pages = {108101},
  year = {2006},
  doi = {10.1103/PhysRevLett.96.108101},
}"""
FRIDDLE = """@article{friddle2008,
  author = {Friddle, R. W.},
  title = {Unified model of dynamic forced barrier crossing in single molecules},
  journal = {Physical Review Letters},
  volume = {100},
  pages = {138302},
  year = {2008},
  doi = {10.1103/PhysRevLett.100.138302},
}"""


class Bell(UnderForce):
    """Force lowers the barrier by F Δx: ⟨F⟩ = (k_BT/Δx) e^y E₁(y), y = k₀k_BT/(ΔxḞ), up to the force ΔE/Δx.

    Bell, Science 200, 618 (1978); Evans and Ritchie, Biophys. J. 72, 1541 (1997). Every bond has its own breaking
    barrier. Beyond ΔE/Δx no barrier is left, and the rate stays at the attempt frequency.
    """

    kind = "bell"
    cite = (
        "G. I. Bell, Science 200, 618 (1978)",
        "E. Evans, K. Ritchie, Biophys. J. 72, 1541 (1997)",
    )
    bibtex = (BELL, EVANS)

    def _mean(self, ramp: ForceRamp) -> np.ndarray:
        log_end = np.full(
            ramp.barrier.shape, np.log(ramp.attempts)
        )  # of the hazard rate at ΔE/Δx
        left = np.exp(ramp.attempts * np.expm1(-ramp.barrier))
        return scaled_exp1(log_end - ramp.barrier) + left * (
            1 / ramp.attempts - scaled_exp1(log_end)
        )


class DudkoHummerSzabo(UnderForce):
    """The mean rupture force over a barrier that moves and vanishes under force, by the integral of the survival.

    Dudko, Hummer and Szabo, Phys. Rev. Lett. 96, 108101 (2006), for any loading rate and without their asymptotic mean.
    """

    kind = "dudko-hummer-szabo"
    cite = ("O. K. Dudko, G. Hummer, A. Szabo, Phys. Rev. Lett. 96, 108101 (2006)",)
    bibtex = (DUDKO,)

    shape: Literal["cusp", "cubic", "constant"] = "cubic"
    """energy along the pull: a cusp (ν = 1/2), linear-cubic (ν = 2/3), or Bell's constant distance (ν = 1)"""

    @property
    def exponent(self) -> float:
        """ν."""
        return EXPONENTS[self.shape]


class Friddle(DudkoHummerSzabo):
    """The closed form ⟨F⟩ ≈ F_c {1 − [1 − (k_BT/ΔE) e^x E₁(x)]^ν}, F_c = ΔE/(νΔx), x = k₀k_BT/(ΔxḞ).

    Friddle, Phys. Rev. Lett. 100, 138302 (2008): the force at the mean lowering of the barrier. Exact for ν = 1.
    """

    kind = "friddle"
    cite = ("R. W. Friddle, Phys. Rev. Lett. 100, 138302 (2008)",)
    bibtex = (FRIDDLE,)

    @property
    def exact(self) -> bool:
        """Whether it is Bell's law."""
        return self.exponent == 1.0

    def _mean(self, ramp: ForceRamp) -> np.ndarray:
        lowered = scaled_exp1(np.log(ramp.attempts) - ramp.barrier)
        return np.where(
            ramp.barrier > 0,
            ramp.force(np.minimum(lowered, ramp.barrier)),
            1 / ramp.attempts,
        )
