"""Checks of a distribution of barriers, and of an interaction between neighbouring sites."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import signature
from itertools import product
from typing import Any

import numpy as np

from chemage.foundation.components import call_with
from chemage.lattices.lattice import ReactionLattice
from chemage.lattices.role import Barriers, Interaction
from chemage.testing.answers import independent_calls
from chemage.testing.checks import (
    Checks,
    Questions,
    known,
    naming,
    require,
    seeds_are_harmless,
    whole,
)

check_barriers = whole(Barriers)


_LOWEST, _HIGHEST = 2.0**-53, 1 - 2.0**-53
#: no bond is stronger than about 11 eV, and a barrier of 0.001 eV is none at any temperature
_SMALL, _LARGE = 1e-3, 20.0


check_interaction = whole(Interaction)


#: edge of a pixel, nm
_PIXEL = 0.4518
_Grid = tuple[int, int]
_GRIDS = ((1, 1), (1, 2), (2, 2), (1, 7), (2, 5), (3, 3), (7, 5), (13, 11))


def _graph(
    component: Interaction,
    grid: _Grid,
    periodic: bool,
    sites: np.ndarray,
    seed: Any = 0,
    size: float = _PIXEL,
    positions: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours of each site, and the energies; neither may need the sites to be writable."""
    where = {"pixel_size": size, "positions": positions}
    neighbours = call_with(component.neighbours, grid, periodic, sites, **where)
    rows = neighbours.ndim == 2 and len(neighbours) == sites.size
    require(
        rows,
        f"{grid[0]}x{grid[1]} grid, {sites.size} sites: neighbours of shape {neighbours.shape}",
    )
    given = np.array(neighbours)
    given.setflags(write=False)
    return neighbours, call_with(
        component.coupling,
        sites,
        given,
        seed,
        pixels=grid,
        periodic=periodic,
        **where,
    )


def _every_site(grid: _Grid) -> np.ndarray:
    """As a component receives them, which must not change them."""
    sites = np.arange(grid[0] * grid[1], dtype=np.int64)
    sites.setflags(write=False)
    return sites


def _patches_of_sites(grid: _Grid) -> Iterator[np.ndarray]:
    every = _every_site(grid)
    yield every
    yield every[np.random.default_rng(every.size).random(every.size) < 0.6]
    yield every[:0]


class BarriersChecks(Checks[Barriers], of=Barriers):
    """What every distribution of barriers must do."""

    @known
    def quantile_is_monotone(self) -> None:
        """Barriers are finite doubles that do not fall as the uniform number rises, from 2^-53 to 1 - 2^-53."""
        uniform = np.concatenate(
            [
                [_LOWEST, 1e-12, 1e-6],
                np.linspace(1e-4, 1 - 1e-4, 2001),
                [1 - 1e-6, _HIGHEST],
            ]
        )
        energy = self.component.quantile(uniform)
        require(
            energy.shape == uniform.shape and energy.dtype == np.float64,
            f"quantile() returned {energy.dtype} of shape {energy.shape} for float64 of {uniform.shape}",
        )
        require(
            np.isfinite(energy).all(),
            "a barrier is not finite for a uniform number between 2^-53 and 1 - 2^-53",
        )
        falls = np.flatnonzero(np.diff(energy) < 0)
        require(
            not falls.size,
            f"the quantile function falls at u = {uniform[falls[:1]]}",
        )

    def barriers_are_in_ev(self) -> None:
        """Barriers are energies in eV of a chemical bond, and lie between options named ``lower`` and ``upper``."""
        low, middle, high = self.component.quantile(
            np.array([_LOWEST, 0.5, _HIGHEST])
        ).tolist()
        require(
            middle == 0 or _SMALL <= abs(middle) <= _LARGE,
            f"half of the barriers are below {middle:.4g} eV; expected {_SMALL} to {_LARGE} eV: are they in k_BT, "
            "kJ/mol or J? (1 eV is 38.7 k_BT at 300 K, 96.5 kJ/mol, 1.6e-19 J)",
        )
        for name, unit in self.units().items():
            bound = getattr(self.component, name)
            if (
                name in ("lower", "upper")
                and isinstance(bound, float)
                and unit == "eV"
            ):
                end, beyond = (
                    (low, bound - low) if name == "lower" else (high, high - bound)
                )
                require(
                    beyond <= 1e-9 * max(abs(bound), 1.0),
                    f"{name} = {bound} eV, but barriers reach {end} eV",
                )

    def barrier_is_the_pixels_own(self) -> None:
        """The barrier of a pixel depends only on its own number, not on other pixels; the numbers stay as they were."""
        component = self.component
        uniform, others = np.random.default_rng(1).random(1000), np.full(1000, 0.3)
        kept = uniform.copy()
        energy = component.quantile(uniform)
        require(
            np.array_equal(uniform, kept),
            "quantile() changed the array of uniform numbers",
        )
        first = energy.tobytes()
        component.quantile(others)
        require(
            energy.tobytes() == first,
            "a later call changed the barriers that an earlier one returned",
        )
        uniform.setflags(write=False)
        for part in (slice(None, None, -1), slice(10, 11), slice(3, 700, 7)):
            alone = component.quantile(np.ascontiguousarray(uniform[part]))
            same = np.allclose(alone, energy[part], rtol=1e-13, atol=0)
            require(same, "a barrier depends on the other numbers in the call")
        grid = component.quantile(uniform.reshape(20, 50))
        same = grid.shape == (20, 50) and np.allclose(
            grid.ravel(), energy, rtol=1e-13
        )
        require(same, "the barriers do not have the shape of the numbers")
        many = np.random.default_rng(2).random(70_000)
        last, alone = (
            component.quantile(many)[-100:],
            component.quantile(many[-100:]),
        )
        same = np.allclose(last, alone, rtol=1e-13, atol=0)
        require(
            same, "a barrier depends on the other numbers in a call with 70,000"
        )
        require(
            component.quantile(np.empty(0)).shape == (0,),
            "no pixels: expected an empty array",
        )

    calls_are_independent = independent_calls

    @known
    def density_agrees_with_quantile(self) -> None:
        """∫ density (1/eV) between two quantiles is the probability between them; a point mass has density inf."""
        component = self.component
        levels = np.linspace(1e-3, 1 - 1e-3, 1999)
        energies = component.quantile(levels)
        low, high = energies[:-1], energies[1:]
        masses = high[high == low]
        known = not masses.size or np.isposinf(component.density(masses)).all()
        require(known, f"a point mass (at {masses[:3]} eV) has density inf")
        # intervals at a point mass hold an unknown part of it
        usable = ~np.isin(low, masses) & ~np.isin(high, masses)
        low, width = low[usable], (high - low)[usable]
        # midpoints: a density may jump at a quantile
        middle = low[:, None] + (np.arange(16) + 0.5) / 16 * width[:, None]
        density = component.density(middle)
        require(
            density.shape == middle.shape,
            f"density of shape {density.shape} for energies of {middle.shape}",
        )
        possible = (density >= 0).all() and np.isfinite(density).all()
        require(possible, "the density is negative or infinite between quantiles")
        total = density.mean(axis=1) * width
        for part in np.array_split(np.arange(low.size), 12):
            integral = float(total[part].sum())
            wanted = part.size * float(levels[1] - levels[0])
            require(
                abs(integral - wanted) < 1e-3,
                f"the density integrates to {integral:.5f} from {low[part[:1]]} eV over {width[part].sum():.5f} eV; "
                f"the quantile function puts {wanted:.5f} there",
            )
        far = component.density(np.array([energies[0] - 1e3, energies[-1] + 1e3]))
        require(np.allclose(far, 0, atol=1e-6), f"density {far} a thousand eV away")

    def members_are_other_distributions(self) -> None:
        """``members(count)`` returns at most ``count`` distributions that differ from this one, always the same ones,
        and that have no members themselves: a run ages each of them."""
        component = self.component
        members, again = list(component.members(3)), component.members(3)
        require(
            len(members) <= 3, f"members(3) returned {len(members)} distributions"
        )
        require(
            len(component.members(0)) == 0, "members(0) returned a distribution"
        )
        uniform = np.linspace(0.005, 0.995, 199)
        own = component.quantile(uniform)
        for member, second in zip(members, again, strict=True):
            require(
                isinstance(member, Barriers),
                f"members() returned {member!r}, which is no distribution of barriers",
            )
            require(
                not len(member.members(3)),
                f"{member!r} is a member and has members itself",
            )
            energy = member.quantile(uniform)
            require(
                np.isfinite(energy).all(),
                f"{member!r} is a member and has barriers that are not finite",
            )
            require(
                not np.array_equal(energy, own),
                f"{member!r} is a member with the barriers of the distribution itself",
            )
            same = np.array_equal(second.quantile(uniform), energy)
            require(
                same,
                "members() returned other distributions at the second call, so that a run would not repeat",
            )

    def members_are_sound(self) -> None:
        """What ``members()`` returns are distributions like this one: monotone, in eV, a barrier of its own for each
        pixel, and a density that agrees."""
        for member in self.component.members(3):
            checks = BarriersChecks(member)
            with naming(f"{member!r} is a member"):
                checks.quantile_is_monotone()
                checks.barriers_are_in_ev()
                checks.barrier_is_the_pixels_own()
                checks.density_agrees_with_quantile()

    def trade_keeps_the_barriers(self) -> None:
        """Every value of ``trade`` gives the median of the last to within a tenth."""
        for name, variants in self.trade_variants():
            medians = [
                float(variant.quantile(np.array([0.5]))[0])
                for _, variant in variants
            ]
            require(
                np.allclose(medians, medians[-1], rtol=0.1),
                f"trade of {name!r} is another distribution and not one at another accuracy: medians {medians} eV",
            )

    def questions(self) -> Questions:
        middle = (np.arange(37) + 0.5) / 37
        for what, uniform in (
            ("37 barriers", middle),
            ("37 others", middle**2),
            ("the last of them", middle[-1:]),
        ):
            yield (
                what,
                lambda barriers, uniform=uniform: barriers.quantile(uniform.copy()),
            )
        energies = np.linspace(0.3, 2.9, 53)
        for what, energy in (
            ("the density", energies),
            ("that of other energies", energies + 0.011),
        ):
            yield (
                what,
                lambda barriers, energy=energy: barriers.density(energy.copy()),
            )


class InteractionChecks(Checks[Interaction], of=Interaction):
    """What every interaction must do."""

    def questions(self) -> Questions:
        def ask(*given: Any) -> Any:
            return lambda interaction: _graph(interaction, *given)

        for number in range(14, 19):
            every, grid = _every_site((number, 9)), (number, 9)
            plain = (grid, True, every[::2], 3, _PIXEL)
            changed = {
                "other sites": (grid, True, every[1::2], *plain[3:]),
                "turned": (grid[::-1], *plain[1:]),
                "not periodic": (grid, False, *plain[2:]),
                "another seed": (*plain[:3], 4, _PIXEL),
                "larger pixels": (*plain[:4], 1.3 * _PIXEL),
            }
            what = list(changed)[number - 14]
            yield f"half of a grid of {number}x9 pixels", ask(*plain)
            yield (
                f"half of a grid of {number}x9 pixels, {what}",
                ask(*changed[what]),
            )

    @known
    def graph_is_sound(self) -> None:
        """The graph is symmetric, with one energy per pair, no self-loops and no double edges, on all small grids."""
        for grid, periodic in product(_GRIDS, (True, False)):
            for sites in _patches_of_sites(grid):
                where = f"{grid[0]}x{grid[1]} grid, periodic={periodic}, {sites.size} sites"
                neighbours, coupling = _graph(self.component, grid, periodic, sites)
                require(
                    neighbours.dtype == np.int32,
                    f"{where}: neighbours are {neighbours.dtype}, not int32",
                )
                require(
                    coupling.shape == neighbours.shape,
                    f"{where}: coupling {coupling.shape}",
                )
                require(
                    (coupling[neighbours < 0] == 0).all(),
                    f"{where}: energy without a neighbour",
                )
                fields: dict[str, Any] = {
                    "neighbours": neighbours,
                    "coupling": coupling,
                }
                with naming(where):
                    ReactionLattice(
                        pixels=grid,
                        sites=sites,
                        forming=np.ones(sites.size),
                        **fields,
                    )

    def _pairs(
        self, grid: _Grid, periodic: bool, sites: np.ndarray, seed: Any = 0
    ) -> dict[tuple[int, int], float]:
        """The energies of pairs of neighbours as pixels, each from both ends."""
        neighbours, coupling = _graph(self.component, grid, periodic, sites, seed)
        there = neighbours >= 0
        ends = (
            np.broadcast_to(sites[:, None], there.shape)[there],
            sites[neighbours[there]],
        )
        return dict(
            zip(
                zip(*(end.tolist() for end in ends), strict=True),
                coupling[there].tolist(),
                strict=True,
            )
        )

    calls_are_independent = independent_calls

    def graph_is_the_same_everywhere(self) -> None:
        """On a full periodic grid that is not square, all sites have the same neighbours around them, across the edges
        too: rows and columns are not mixed up, and nothing is missing at the edges."""
        for nx, ny in ((24, 18), (18, 24)):
            graph = self._pairs((nx, ny), True, _every_site((nx, ny)))
            require(graph, f"no site has a neighbour on a full {nx}x{ny} grid")
            place = np.arange(nx * ny).reshape(nx, ny)
            # rows or columns may be staggered, so the graph must repeat after two
            for step in ((2, 0), (0, 2)):
                moved = (
                    np.roll(place, (-step[0], -step[1]), (0, 1)).ravel().tolist()
                )
                missing = sorted(
                    {(moved[a], moved[b]) for a, b in graph} - graph.keys()
                )
                pairs = [[divmod(pixel, ny) for pixel in pair] for pair in missing]
                require(
                    not pairs,
                    f"full periodic grid of {nx}x{ny} pixels: the graph is not the same everywhere. Pixels {pairs[:1]} "
                    f"are no neighbours, but those {step} before them are ({len(pairs)} such pairs); a pixel (x, y) "
                    "has the index x·ny + y, and the grid repeats in both directions",
                )

    def patch_keeps_its_graph(self) -> None:
        """A patch has the same graph at the edges of a grid that is not periodic as inside a larger grid: nothing wraps
        where nothing is periodic."""
        small, large, corner = (8, 6), (60, 52), (26, 22)
        inside = _every_site(small)
        for sites in (
            inside,
            inside[np.random.default_rng(3).random(inside.size) < 0.7],
        ):
            x, y = np.divmod(sites, small[1])
            embedded = (x + corner[0]) * large[1] + y + corner[1]
            back = dict(zip(embedded.tolist(), sites.tolist(), strict=True))
            mine = self._pairs(small, False, sites).keys()
            for periodic in (False, True):
                its = {
                    (back[a], back[b])
                    for a, b in self._pairs(large, periodic, embedded)
                }
                differing = [
                    [divmod(pixel, small[1]) for pixel in pair]
                    for pair in sorted(mine ^ its)
                ]
                require(
                    not differing,
                    f"pixels {differing[:1]} of a patch are neighbours on one of two grids alone: of 8x6 pixels, not "
                    f"periodic, and of 60x52 with periodic={periodic} and the patch in its middle",
                )

    @known
    def pair_keeps_its_energy(self) -> None:
        """The energy of a pair of pixels does not depend on the other sites of the contact."""
        grid = (13, 11)
        everywhere, here, _ = _patches_of_sites(grid)
        all_pairs, some = (
            self._pairs(grid, True, sites, 3) for sites in (everywhere, here)
        )
        require(all_pairs and some, "no site has a neighbour on a full 13x11 grid")
        chosen = set(here.tolist())
        expected = {
            pair: energy
            for pair, energy in all_pairs.items()
            if chosen.issuperset(pair)
        }
        require(
            some == expected,
            "pairs or their energies changed when other sites were removed",
        )

    def sites_may_be_many(self) -> None:
        """Beyond 65,536 sites a patch has the neighbours and the energies that it has alone."""
        edge, far = 9, np.arange(257)
        grid = (edge * (far.size + 10), edge * far.size)
        lone = (edge * far[:, None] * grid[1] + edge * far).ravel()
        x, y = np.divmod(np.arange(35), 5)
        patch = (grid[0] - 40 + x) * grid[1] + 40 + y
        alone = self._pairs(grid, True, patch, 3)
        among = self._pairs(grid, True, np.append(lone, patch), 3)
        chosen = set(patch.tolist())
        require(
            alone == {k: v for k, v in among.items() if chosen.issuperset(k)},
            f"the last 35 of {lone.size + 35} sites are other neighbours, or with other energies, than without the rest",
        )

    def sites_need_not_be_pixels(self) -> None:
        """An interaction that takes ``positions`` treats sites in the centres of their pixels as without positions, and
        several sites in a pixel."""
        if "positions" not in signature(self.component.neighbours).parameters:
            return
        for grid, periodic in product(((13, 11), (7, 5)), (True, False)):
            every = _every_site(grid)
            centres = (np.stack(np.divmod(every, grid[1]), axis=1) + 0.5) * _PIXEL
            own, given = (
                _graph(self.component, grid, periodic, every, 3, _PIXEL, places)
                for places in (None, centres)
            )
            require(
                all(map(np.array_equal, own, given)),
                "with positions (nm, from the corner of the grid) in the centres of the pixels, neighbours or energies "
                "are others than without positions",
            )
            shift = 0.25 * _PIXEL * np.array([1.0, 1.0])
            places = np.stack([centres - shift, centres + shift], axis=1).reshape(
                -1, 2
            )
            double = np.repeat(every, 2)
            neighbours, coupling = _graph(
                self.component, grid, periodic, double, 3, _PIXEL, places
            )
            with naming(f"two sites in each pixel of {grid}, periodic={periodic}"):
                ReactionLattice(
                    pixels=grid,
                    sites=double,
                    positions=places,
                    forming=np.ones(double.size),
                    neighbours=neighbours,
                    coupling=coupling,
                    pixel_size=_PIXEL,
                )
            require(
                np.count_nonzero(neighbours >= 0) >= np.count_nonzero(own[0] >= 0),
                f"two sites in each pixel of {grid}, periodic={periodic}, have fewer neighbours in all than one",
            )

    def energies_are_in_ev(self) -> None:
        """Energies are in eV: the largest is between 1e-6 and 10 eV, unless all are zero."""
        largest = float(
            np.abs(
                _graph(self.component, (13, 11), True, _every_site((13, 11)), 1)[1]
            ).max()
        )
        require(
            largest == 0 or 1e-6 <= largest <= 10,
            f"the largest energy of a pair is {largest:.3g} eV; expected 1e-6 to 10 eV: is it in k_BT, kJ/mol or J?",
        )

    def coupling_follows_its_seed(self) -> None:
        """The same seed gives the same energies, other seeds give others or none does."""
        grid = (13, 11)
        seeds_are_harmless(
            lambda seed: self._pairs(grid, True, _every_site(grid), seed),
            "coupling",
        )

    def lengths_are_in_nm(self) -> None:
        """On pixels twice as large, with all lengths among the options doubled, graph and energies are the same."""
        # an energy is stress times volume
        larger = self.rescaled(stress=1 / 8, length=2)
        for grid in ((13, 11), (11, 13)):
            own = _graph(self.component, grid, True, _every_site(grid), 3)
            for one, two in zip(
                own,
                _graph(larger, grid, True, _every_site(grid), 3, 2 * _PIXEL),
                strict=True,
            ):
                require(
                    one.shape == two.shape
                    and np.allclose(one, two, rtol=1e-9, atol=1e-12),
                    "with pixels and all lengths among the options doubled, neighbours or energies differ; is a length "
                    "in pixels, or a size of pixels assumed?",
                )
