"""The reaction lattice: the sites that can react, their barriers and couplings, and nothing else."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import model_validator

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import checked_states
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import Observing
from chemage.foundation.records import (
    Doubles,
    Indices,
    Named,
    Plain,
    PositiveNumber,
    Reals,
    Record,
    Shorts,
    require_finite,
)
from chemage.lattices.states import check_transitions

if TYPE_CHECKING:
    from ase import Atoms


#: random numbers of pairs of pixels are told apart up to here
MOST_PIXELS = 2**48
#: eV or GPa; what engines compute from a barrier stays a number
LARGEST = 1e302
#: kernels count sites in 32 bits
MOST_SITES = 2**31 - 1


def _in_range(name: str, values: np.ndarray, remedy: str) -> None:
    require_finite(name, values, remedy)
    if (
        max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))
        > LARGEST
    ):
        raise ValueError(f"{name}: beyond {LARGEST:g}, out of range; {remedy}")


#: forming barrier of a site that is not in contact, eV: it forms no bond at any temperature
ABSENT = 1000.0


class ReactionLattice(Observing, Record):
    """A graph of the sites that can react, and nothing else.

    There is one site in a pixel, or none; with ``positions`` there may be several. A site forms a bond at the rate
    ν exp(−E/k_B T) with E = ``forming`` + Σ ``coupling`` over its bonded neighbours, and breaks it with E =
    ``breaking``; a barrier at or below zero means the rate ν. Can be built from plain arrays.
    """

    arrays = {
        "sites": (("site",), "", "flat pixel index"),
        "positions": (("site", "xy"), "nm", "position of the site"),
        "pressure": (("site",), "GPa", "pressure on the site"),
        "forming": (
            ("site",),
            "eV",
            "barrier to forming a bond with no neighbour bonded",
        ),
        "breaking": (("site",), "eV", "barrier to breaking the bond"),
        "neighbours": (
            ("site", "slot"),
            "",
            "position of the neighbour in the list of sites, -1 = none",
        ),
        "coupling": (
            ("site", "slot"),
            "eV",
            "what a bonded neighbour adds to the forming barrier",
        ),
        "transitions": (
            ("transition", "before_after"),
            "",
            "number of the state before and after each further transition",
        ),
        "transition_barriers": (("site", "transition"), "eV", "its barrier"),
        "transition_terms": (
            ("transition", "term"),
            "",
            "share of the couplings that its barrier feels, and factor of its rate",
        ),
    }

    added = (
        "positions",
        "pressure",
        "origin",
        "states",
        "initial",
        "transitions",
        "transition_barriers",
        "transition_terms",
        "observables",
        "outputs",
    )

    pixels: tuple[int, int]
    """(nx, ny) of the grid the sites lie on: that of the pixels of the contact, or a grid of sites of its own"""
    sites: Indices
    """(n,) int64 flat index of the pixel of each site, ascending; without ``positions`` no pixel twice"""
    positions: Doubles | None = None
    """(n, 2) x and y in nm, from the corner of the grid; None: one site in the centre of each pixel in ``sites``"""
    pressure: Reals | None = None
    """(n,) GPa; None: that of the pixels of the contact, which are the sites"""
    origin: tuple[float, float] | None = None
    """corner of the grid of sites, nm from that of the pixels of the contact; None: the same corner"""
    forming: Doubles
    """(n,) eV"""
    breaking: Doubles | None = None
    """(n,) eV; None: bonds never break"""
    neighbours: Shorts | None = None
    """(n, k) int32, -1 = none; None: nothing interacts"""
    coupling: Reals | None = None
    """(n, k) eV, symmetric"""
    states: tuple[str, ...] | None = None
    """names of the states of a site, "free" and "bonded" first; None: these two alone"""
    initial: int | None = None
    """number of the state in which sites begin; None: those to which free sites under the pressure of the contact
    come in time without bonds"""
    transitions: Indices | None = None
    """(t, 2) numbers of the states before and after each further transition"""
    transition_barriers: Doubles | None = None
    """(n, t) eV"""
    transition_terms: Doubles | None = None
    """(t, 2) share of the couplings of bonded neighbours that is added to the barrier, and factor of the rate"""
    attempt_frequency: PositiveNumber = 1e13
    """ν, Hz"""
    pixel_size: PositiveNumber = 1.0
    """nm; for viewing, and to place ``positions`` in their pixels"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        n = self.sites.size
        if min(self.pixels) < 1:
            raise ValueError(f"pixels: {self.pixels}; give two positive numbers")
        if self.pixels[0] * self.pixels[1] > MOST_PIXELS:
            raise ValueError(
                f"pixels: {self.pixels} is a grid of more than {MOST_PIXELS} pixels; give a smaller one"
            )
        if n > MOST_SITES:
            raise ValueError(f"sites: {n}; a lattice has at most {MOST_SITES}")
        if self.sites.ndim != 1:
            raise ValueError(
                f"sites: shape {self.sites.shape}; give a one-dimensional array"
            )
        if n:
            if (
                self.sites[0] < 0
                or self.sites[-1] >= self.pixels[0] * self.pixels[1]
            ):
                raise ValueError(
                    f"sites: from {self.sites[0]} to {self.sites[-1]}, outside the grid of {self.pixels}"
                )
            # compared, not subtracted: a difference could overflow
            before, after = self.sites[:-1], self.sites[1:]
            if self.positions is None and np.any(after == before):
                twice = int(after[after == before][0])
                raise ValueError(
                    f"sites: pixel {twice} is listed twice; list each once, or give positions as well"
                )
            if np.any(after < before):
                raise ValueError(
                    "sites: not in ascending order; sort them (and what goes with them)"
                )
        for name in ("forming", "breaking", "pressure"):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (n,):
                raise ValueError(
                    f"{name}: shape {values.shape}, but there are {n} sites; give one value per site"
                )
            _in_range(
                name,
                values,
                "give pressures in GPa"
                if name == "pressure"
                else "give barriers in eV",
            )
        if self.origin is not None and not np.isfinite(self.origin).all():
            raise ValueError(
                f"origin: {self.origin} is not finite; give x and y in nm"
            )
        if self.positions is not None:
            self._check_positions(self.positions, n)
        self._check_graph(n)
        check_transitions(self)
        return self

    def _check_positions(self, positions: np.ndarray, n: int) -> None:
        if positions.shape != (n, 2):
            raise ValueError(
                f"positions: shape {positions.shape}, but there are {n} sites; give x and y of each in nm"
            )
        require_finite("positions", positions, "give x and y in nm")
        centres = np.stack(np.divmod(self.sites, self.pixels[1]), axis=1) + 0.5
        # a site on the edge of two pixels may be counted to either, whatever the rounding
        outside = (
            np.abs(positions / self.pixel_size - centres).max(axis=1, initial=0)
            > 0.5 + 1e-6
        )
        if outside.any():
            site = int(np.argmax(outside))
            raise ValueError(
                f"positions[{site}]: ({positions[site, 0]:g}, {positions[site, 1]:g}) nm is outside pixel "
                f"{int(self.sites[site])}, whose centre is at ({centres[site, 0] * self.pixel_size:g}, "
                f"{centres[site, 1] * self.pixel_size:g}) nm with pixels of {self.pixel_size:g} nm; "
                "give the pixel of each site in sites, positions in nm, and pixel_size"
            )

    def _check_graph(self, n: int) -> None:
        neighbours, coupling = self.neighbours, self.coupling
        if (neighbours is None) != (coupling is None):
            raise ValueError("neighbours and coupling: give both, or neither")
        if neighbours is None or coupling is None:
            return
        if (
            neighbours.ndim != 2
            or neighbours.shape[0] != n
            or coupling.shape != neighbours.shape
        ):
            raise ValueError(
                f"neighbours {neighbours.shape} and coupling {coupling.shape}: both must be ({n}, k) for {n} sites"
            )
        _in_range(
            "coupling",
            coupling,
            "give energies in eV, 0 where there is no neighbour",
        )
        from chemage.lattices.kernels import find_fault

        fault, site, slot = find_fault(neighbours, coupling)
        if fault:
            other = int(neighbours[site, slot])
            problem = {
                1: f"neighbours[{site}, {slot}] = {other} is not a site; give 0 to {n - 1}, or -1 for none",
                2: f"neighbours[{site}, {slot}]: site {site} is its own neighbour; remove it",
                3: f"neighbours[{site}]: site {other} is listed twice; list each neighbour once",
                4: f"neighbours: site {site} lists {other}, but not the other way round; list each pair from both ends",
                5: f"coupling[{site}, {slot}]: the pair ({site}, {other}) has two values; "
                "give both ends the same energy (the coupling must be symmetric)",
            }[fault]
            raise ValueError(problem)

    @property
    def interacting(self) -> bool:
        """Whether any two sites are coupled."""
        return self.neighbours is not None

    @cached_property
    def random_index(self) -> np.ndarray:
        """(n,) int64: what the random numbers of each site belong to, in :mod:`chemage.plugin.random` and in engines.

        The pixel of the site; for the second site of a pixel and further ones, that plus once, twice, … the number of
        pixels. Two sites of one pixel have independent random numbers by this.
        """
        if self.positions is None:
            return self.sites
        new = np.append(True, np.diff(self.sites) > 0)[: self.sites.size]
        order = np.arange(self.sites.size)
        rank = order - np.maximum.accumulate(np.where(new, order, 0))
        index = self.sites + rank * (self.pixels[0] * self.pixels[1])
        index.setflags(write=False)
        return index

    def pressures(self, contact: ContactSolution) -> np.ndarray:
        """The pressure on each site of this lattice, (n,) GPa, which was made on ``contact``.

        Raises
        ------
        InputError
            The lattice has no pressures, and its grid is not that of the pixels of ``contact``.
        """
        if self.pressure is not None:
            return self.pressure
        if self.pixels != contact.shape:
            raise InputError(
                f"the lattice is on {self.pixels[0]} x {self.pixels[1]} sites and has no pressure, but the contact has "
                f"{contact.shape[0]} x {contact.shape[1]} pixels; give the contact that the lattice was made on"
            )
        return contact.pressure.ravel()[self.sites]

    def per_pixel(self, values: np.ndarray) -> np.ndarray:
        """The sum of ``values`` (n,) over the sites of each pixel: (nx, ny) float64, 0 where there is no site."""
        sums = np.bincount(
            self.sites, weights=values, minlength=self.pixels[0] * self.pixels[1]
        )
        return sums.reshape(self.pixels)

    def to_atoms(self, state: np.ndarray | None = None) -> Atoms:
        """The sites as ASE atoms for viewing: O where bonded, H elsewhere; barriers in ``arrays``. Å as in ASE."""
        from ase import Atoms

        n = self.sites.size
        bonded = (
            np.zeros(n, dtype=bool)
            if state is None
            else checked_states("state", state, n)
        )
        step = 10.0 * self.pixel_size
        x, y = np.divmod(self.sites, self.pixels[1])
        plane = np.stack([(x + 0.5) * step, (y + 0.5) * step], axis=1)
        if self.positions is not None:
            plane = 10.0 * self.positions
        if self.origin is not None:
            plane = plane + 10.0 * np.array(self.origin)
        atoms = Atoms(
            numbers=np.where(bonded, 8, 1),
            positions=np.column_stack([plane, np.zeros(n)]),
            cell=[self.pixels[0] * step, self.pixels[1] * step, 10.0],
            pbc=False,
        )
        atoms.new_array("forming", np.array(self.forming))
        if self.breaking is not None:
            atoms.new_array("breaking", np.array(self.breaking))
        return atoms

    def __repr__(self) -> str:
        kind = "interacting" if self.interacting else "independent"
        return f"<ReactionLattice {self.sites.size} {kind} sites on {self.pixels[0]}x{self.pixels[1]} pixels>"

    __str__ = __repr__
