"""Checks of a distribution of barriers."""

from __future__ import annotations

import numpy as np

from chemage.lattices.role import Barriers
from chemage.testing.checks import (
    calls_are_independent,
    check_of,
    options_of,
    require,
    speed_changes_nothing,
    trade_variants,
    whole,
)

check_barriers = whole(Barriers)


_LOWEST, _HIGHEST = 2.0**-53, 1 - 2.0**-53
#: no bond is stronger than about 11 eV, and a barrier of 0.001 eV is none at any temperature
_SMALL, _LARGE = 1e-3, 20.0


@check_of("barriers")
def _quantile_is_monotone(component: Barriers) -> None:
    """Barriers are finite doubles that do not fall as the uniform number rises, from 2^-53 to 1 - 2^-53."""
    uniform = np.concatenate([[_LOWEST, 1e-12, 1e-6], np.linspace(1e-4, 1 - 1e-4, 2001), [1 - 1e-6, _HIGHEST]])
    energy = component.quantile(uniform)
    require(
        energy.shape == uniform.shape and energy.dtype == np.float64,
        f"quantile() returned {energy.dtype} of shape {energy.shape} for float64 of {uniform.shape}",
    )
    require(np.isfinite(energy).all(), "a barrier is not finite for a uniform number between 2^-53 and 1 - 2^-53")
    falls = np.flatnonzero(np.diff(energy) < 0)
    require(not falls.size, f"the quantile function falls at u = {uniform[falls[:1]]}")


@check_of("barriers")
def _barriers_are_in_ev(component: Barriers) -> None:
    """Barriers are energies in eV of a chemical bond, and lie between options named ``lower`` and ``upper``."""
    middle = float(component.quantile(np.array([0.5]))[0])
    require(
        middle == 0 or _SMALL <= abs(middle) <= _LARGE,
        f"half of the barriers are below {middle:.4g} eV; expected {_SMALL} to {_LARGE} eV: are they in k_BT, kJ/mol "
        "or J? (1 eV is 38.7 k_BT at 300 K, 96.5 kJ/mol, 1.6e-19 J)",
    )
    options = options_of(component)
    ends = component.quantile(np.array([_LOWEST, _HIGHEST]))
    for name, sign, end in (("lower", 1, ends[0]), ("upper", -1, ends[1])):
        bound = getattr(component, name, None)
        if isinstance(bound, float) and options.get(name, ((), None, ""))[1] == "eV":
            slack = 1e-9 * max(abs(bound), 1.0)
            require(sign * (end - bound) >= -slack, f"{name} = {bound} eV, but barriers reach {end} eV")


@check_of("barriers")
def _barrier_is_the_pixels_own(component: Barriers) -> None:
    """The barrier of a pixel depends only on its own number, neither on other pixels nor on earlier or concurrent
    calls; the numbers stay as they were."""
    uniform = np.random.default_rng(1).random(1000)
    kept = uniform.copy()
    energy = component.quantile(uniform)
    require(np.array_equal(uniform, kept), "quantile() changed the array of uniform numbers")
    first = energy.tobytes()
    component.quantile(np.full(1000, 0.3))
    require(energy.tobytes() == first, "a later call changed the barriers that an earlier one returned")
    uniform.setflags(write=False)
    calls_are_independent(lambda numbers: component.quantile(numbers).tobytes(), [uniform, np.full(1000, 0.3)])
    for part in (slice(None, None, -1), slice(10, 11), slice(3, 700, 7)):
        alone = component.quantile(np.ascontiguousarray(uniform[part]))
        require(
            np.allclose(alone, energy[part], rtol=1e-13, atol=0), "a barrier depends on the other numbers in the call"
        )
    grid = component.quantile(uniform.reshape(20, 50))
    require(
        grid.shape == (20, 50) and np.allclose(grid.ravel(), energy, rtol=1e-13),
        "the barriers do not have the shape of the numbers",
    )
    require(component.quantile(np.empty(0)).shape == (0,), "no pixels: expected an empty array")


@check_of("barriers")
def _density_agrees_with_quantile(component: Barriers) -> None:
    """∫ density (1/eV) between two quantiles is the probability between them; a point mass has density inf."""
    levels = np.linspace(1e-3, 1 - 1e-3, 1999)
    energies = component.quantile(levels)
    low, high = energies[:-1], energies[1:]
    masses = np.unique(high[high == low])
    if masses.size:
        require(np.isposinf(component.density(masses)).all(), f"a point mass (at {masses[:3]} eV) has density inf")
    # intervals at a point mass hold an unknown part of it
    usable = ~np.isin(low, masses) & ~np.isin(high, masses)
    low, high = low[usable], high[usable]
    # midpoints: a density may jump at a quantile
    count = 16
    middle = low[:, None] + (np.arange(count) + 0.5) * (high - low)[:, None] / count
    density = component.density(middle)
    require(density.shape == middle.shape, f"density of shape {density.shape} for energies of {middle.shape}")
    require(
        (density >= 0).all() and np.isfinite(density).all(), "the density is negative or infinite between quantiles"
    )
    total = density.mean(axis=1) * (high - low)
    for part in np.array_split(np.arange(low.size), 12):
        integral, wanted = float(total[part].sum()), part.size * float(levels[1] - levels[0])
        if part.size:
            require(
                abs(integral - wanted) < 1e-3,
                f"the density integrates to {integral:.5f} between {low[part[0]]:.5f} and {high[part[-1]]:.5f} eV; the "
                f"quantile function puts {wanted:.5f} there",
            )
    far = component.density(np.array([energies[0] - 1e3, energies[-1] + 1e3]))
    require(np.allclose(far, 0, atol=1e-6), f"density {far} a thousand eV away")


@check_of("barriers")
def _members_are_other_distributions(component: Barriers) -> None:
    """``members(count)`` returns at most ``count`` distributions that differ from this one, always the same ones, and
    that have no members themselves: a run ages each of them."""
    members = list(component.members(3))
    require(len(members) <= 3, f"members(3) returned {len(members)} distributions")
    require(len(component.members(0)) == 0, "members(0) returned a distribution")
    if not members:
        return
    for member in members:
        require(isinstance(member, Barriers), f"members() returned {member!r}, which is no distribution of barriers")
        require(not len(member.members(3)), f"{member!r} is a member and has members itself")
    uniform = np.linspace(0.005, 0.995, 199)
    own, *others = (member.quantile(uniform) for member in [component, *members])
    require(
        all(np.isfinite(member).all() and not np.array_equal(member, own) for member in others),
        "a member has the same barriers as the distribution itself, or barriers that are not finite",
    )
    again = [member.quantile(uniform) for member in component.members(3)]
    require(
        [member.tobytes() for member in again] == [member.tobytes() for member in others],
        "members() returned other distributions at the second call, so that a run would not repeat",
    )


@check_of("barriers")
def _speed_does_not_change_the_barriers(component: Barriers) -> None:
    """Options in ``speed_only`` do not change a bit of any barrier; ``trade`` changes the median by a tenth at most."""
    uniform = np.linspace(0.01, 0.99, 99)
    speed_changes_nothing(component, lambda variant: variant.quantile(uniform).tobytes(), "barriers")
    for name, variants in trade_variants(component):
        medians = [float(variant.quantile(np.array([0.5]))[0]) for _, variant in variants]
        require(
            np.allclose(medians, medians[-1], rtol=0.1),
            f"trade of {name!r} is another distribution and not one at another accuracy: medians {medians} eV",
        )
