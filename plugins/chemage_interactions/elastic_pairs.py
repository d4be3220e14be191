"""The elastic interaction of bonded neighbours."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from chemage import InputError, Interaction, Seed, Unit


def _read_only(array: np.ndarray, dtype: type[np.generic]) -> np.ndarray:
    """A read-only view: numba compiles a kernel anew for writable arrays, so all are given in one way."""
    view = np.ascontiguousarray(array, dtype=dtype).view()
    view.setflags(write=False)
    return view


class ElasticPairs(Interaction):
    """A bond changes the forming barriers of its eight nearest neighbours, each by ΔE_in = I_b (φ_in − ε).

    φ_in is uniform on (0, 1), one number for each pair of neighbouring pixels, drawn once. It is a function of the seed
    and the two pixels alone: a pair keeps it when load, contact or strength change. Li, Pastewka & Szlufarska,
    Phys. Rev. E 98, 023001 (2018), eqs. 4 and 5.
    """

    kind = "elastic-pairs"
    cite: ClassVar[tuple[str, ...]] = ("Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",)

    strength: Annotated[float, Unit("eV", ge=0)]
    """I_b, eV"""
    bias: Annotated[float, Unit("")] = 0.1
    """ε: the share of pairs where a bond helps its neighbour to form"""

    def neighbours(self, pixels: tuple[int, int], periodic: bool, sites: np.ndarray) -> np.ndarray:
        """The eight nearest pixels that are sites: (n, 8) int32, -1 where there is none.

        Columns 0…7 are the steps (−1,−1), (−1,0), (−1,1), (0,−1), (0,1), (1,−1), (1,0), (1,1). On a periodic grid one
        or two pixels wide, steps that lead to the same pixel count once, and no site is its own neighbour.

        Raises
        ------
        InputError
            ``sites`` are not ascending pixel indices of the grid.
        """
        from chemage_interactions import _kernels

        nx, ny = pixels
        sites = _read_only(sites, np.int64)
        starts = _kernels.row_starts(sites, nx, ny)
        if starts.size == 0 or sites.size > np.iinfo(np.int32).max:
            raise InputError(f"sites: not ascending pixel indices, or outside the grid of {nx} x {ny} pixels")
        out = np.empty((sites.size, len(_kernels.SLOTS)), dtype=np.int32)
        _kernels.eight_neighbours(sites, starts, nx, ny, bool(periodic), out)
        out.setflags(write=False)
        return out

    def coupling(self, sites: np.ndarray, neighbours: np.ndarray, seed: Seed) -> np.ndarray:
        """ΔE_in of each neighbour, (n, k) float32 eV, symmetric bit for bit; 0 where there is none.

        Rounded to 6e-8 of their value, a millionth of k_BT at room temperature, for 32 bytes less a site and a line of
        memory less an event. Engines add and take away the rounded number exactly.
        """
        from chemage import random
        from chemage_interactions import _kernels

        out = np.empty(neighbours.shape, np.float32)
        key = random.key(seed)
        _kernels.pair_couplings(
            _read_only(sites, np.int64),
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
