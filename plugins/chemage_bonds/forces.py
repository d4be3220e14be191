"""The elastic interaction of bonded neighbours, and the same force for every bond."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from chemage import InputError
from chemage.plugin import (
    Bonded,
    Energy,
    Force,
    Interaction,
    Rupture,
    Seed,
    Unit,
    checked_count,
    checked_seed,
    memory,
)

#: random numbers of pairs of pixels are told apart up to here
MOST_PIXELS = 2**48


def _read_only(array: np.ndarray, dtype: type[np.generic]) -> np.ndarray:
    """A read-only view: numba would compile a kernel a second time for writable arrays."""
    view = np.ascontiguousarray(array, dtype=dtype).view()
    view.setflags(write=False)
    return view


def _pixels_in(sites: np.ndarray) -> np.ndarray:
    listed = np.asarray(sites)
    if listed.ndim != 1 or (listed.size and listed.dtype.kind not in "iu"):
        raise InputError(
            f"sites: {listed.dtype} of shape {listed.shape}; give a list of pixel indices"
        )
    if listed.size and not (
        int(listed.min()) >= 0 and int(listed.max()) < MOST_PIXELS
    ):
        raise InputError(
            f"sites: from {listed.min()} to {listed.max()}; pixel indices are from 0 to {MOST_PIXELS - 1}"
        )
    return _read_only(listed, np.int64)


class ElasticPairs(Interaction):
    """A bond changes the forming barriers of its eight nearest neighbours, each by ΔE_in = I_b (φ_in − ε).

    φ_in is uniform on (0, 1), one number for each pair of neighbouring pixels. It is a function of the seed and of the
    two pixels alone, so a pair keeps it when load, contact or strength change. Li, Pastewka & Szlufarska,
    Phys. Rev. E 98, 023001 (2018), eqs. 4 and 5.
    """

    kind = "elastic-pairs"
    cite = ("Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",)

    strength: Annotated[Energy, Unit("eV", ge=0, le=1e6)]
    """I_b, the strength of the interaction, eV"""
    bias: Annotated[Any, Unit("", ge=-1e6, le=1e6)] = 0.1
    """ε: the share of pairs in which a bond lowers its neighbour's forming barrier; default: 0.1"""

    def neighbours(
        self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray
    ) -> np.ndarray:
        """The positions in ``sites`` of the eight nearest pixels: (n, 8) int32, -1 for a pixel that is no site.

        Columns 0…7 are the steps (−1,−1), (−1,0), (−1,1), (0,−1), (0,1), (1,−1), (1,0), (1,1). On a periodic grid one
        or two pixels wide, steps that lead to the same pixel count once, and no site is its own neighbour.

        Raises
        ------
        InputError
            ``sites`` are not ascending, or not pixels of the grid.
        """
        from chemage_bonds import _kernels

        if not isinstance(pixels, tuple | list) or len(pixels) != 2:
            raise InputError.of("pixels", pixels, "must be two whole numbers")
        nx, ny = (checked_count("pixels", side) for side in pixels)
        sites = _pixels_in(sites)
        # where each row of pixels begins
        memory.require(8.0 * nx, f"pixels = {pixels}", "give a smaller grid")
        if nx * ny > MOST_PIXELS:
            raise InputError.of(
                "pixels",
                pixels,
                f"is a grid of more than {MOST_PIXELS} pixels",
                "give a smaller one",
            )
        starts = _kernels.row_starts(sites, nx, ny)
        if starts.size == 0 or sites.size > np.iinfo(np.int32).max:
            raise InputError(
                f"sites: must be ascending pixel indices on the grid of {nx} x {ny} pixels, at most 2**31 - 1 of them; "
                "sort them, remove duplicates, or enlarge the grid"
            )
        out = np.empty((sites.size, len(_kernels.SLOTS)), dtype=np.int32)
        _kernels.eight_neighbours(sites, starts, nx, ny, bool(periodic), out)
        out.setflags(write=False)
        return out

    def coupling(
        self, sites: np.ndarray, neighbours: np.ndarray, seed: Seed
    ) -> np.ndarray:
        """ΔE_in of each neighbour, (n, k) float32 eV, symmetric bit for bit; 0 where there is none.

        Single precision rounds them by 6e-8 of their value, a millionth of k_BT at room temperature, and saves 32 bytes
        per site and one cache line per event. Engines add and subtract the rounded number exactly.
        """
        from chemage.plugin import random
        from chemage_bonds import _kernels

        sites, neighbours = _pixels_in(sites), np.asarray(neighbours)
        if (
            neighbours.ndim != 2
            or len(neighbours) != sites.size
            or neighbours.dtype.kind not in "iu"
        ):
            raise InputError(
                f"neighbours: shape {neighbours.shape} for {sites.size} sites; give what `neighbours` gave"
            )
        if neighbours.size and not (
            int(neighbours.min()) >= -1 and int(neighbours.max()) < sites.size
        ):
            raise InputError(
                f"neighbours: from {neighbours.min()} to {neighbours.max()}, but there are {sites.size} sites; "
                "give what `neighbours` gave"
            )
        out = np.empty(neighbours.shape, np.float32)
        key = random.key(
            seed if isinstance(seed, np.random.SeedSequence) else checked_seed(seed)
        )
        _kernels.pair_couplings(
            sites,
            _read_only(neighbours, np.int32),
            key[0],
            key[1],
            random.PAIR,
            self.strength,
            self.bias,
            out,
        )
        out.setflags(write=False)
        return out


class MeanForce(Rupture):
    """Every bond breaks at the same mean force: ΔF = N ⟨f⟩ × front factor. Li et al. 2018."""

    kind = "mean-force"
    cite = ("Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",)

    bond_force: Force | None = None
    """⟨f⟩, mean force to rupture a bond, nN; default: that of the chemistry"""
    front_factor: float | None = Field(default=None, gt=0, le=1)
    """fraction of the bonds that carry load at once as the detachment front passes; default: that of the chemistry"""

    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN, (m,)."""
        force = (
            bonded.chemistry.bond_force
            if self.bond_force is None
            else self.bond_force
        )
        factor = (
            bonded.chemistry.front_factor
            if self.front_factor is None
            else self.front_factor
        )
        return bonded.bonds * (force * factor)
