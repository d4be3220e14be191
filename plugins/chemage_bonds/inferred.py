"""A distribution of barriers that was inferred from measured ageing."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from pydantic import Field

from chemage import InputError, read
from chemage.plugin import Barriers, FilePath, FileStamp, file_hash, file_stamp
from chemage_bonds.distributions import PiecewiseLinearDensity, doubles
from chemage_inference import Inference

#: eV above the last energy, and width of the range, where barriers lie that do not react within the measured times
_GAP, _WIDTH = 0.5, 0.1


@lru_cache(maxsize=8)
def _read(path: str, stamp: FileStamp) -> tuple[Inference, str]:
    """The densities in a file and the hash of its content, read once as long as its stamp stays."""
    result = read(path)
    if not isinstance(result, Inference):
        raise InputError(
            f"{path} holds a {type(result).__name__}, not an inference; `chemage infer` makes such files"
        )
    return result, file_hash(path, stamp)


@lru_cache(maxsize=64)
def _distribution(
    path: str, stamp: FileStamp, member: int
) -> tuple[PiecewiseLinearDensity | None, float, float]:
    """A density, None where it is zero; its integral, at most 1; and the energy above which the rest lies."""
    table, _ = _read(path, stamp)
    if member > len(table.samples):
        raise InputError(
            f"member = {member}: {path} has members 1 to {len(table.samples)}; 0 is the mean of the posterior"
        )
    density = table.density if member == 0 else table.samples[member - 1]
    integral = float(np.trapezoid(density, table.energies))
    inside = (
        PiecewiseLinearDensity(table.energies, density) if integral > 0 else None
    )
    return inside, min(integral, 1.0), float(table.energies[-1]) + _GAP


class Inferred(Barriers):
    """The density of forming barriers that ``chemage infer`` found, or a member of its ensemble.

    Sites whose barriers the data do not see, because they lie above those that react within the measured hold times,
    get barriers half an eV above the last energy and never bond. A run with member 0 ages some members as well, and
    their scatter is its error ``barriers``. The file is read when barriers are needed, and its content is part of the
    keys.
    """

    kind = "inferred"

    path: FilePath
    """result file of ``chemage infer``"""
    member: int = Field(default=0, ge=0)
    """0: the mean of the posterior; 1, 2, …: a sample of it; default: 0"""

    def content(self) -> dict[str, str]:
        """A hash of the content of the file, so that an edited file is another distribution.

        Raises
        ------
        StoreError
            The file cannot be read.
        """
        return {"file_blake2b": _read(self.path, file_stamp(self.path))[1]}

    def members(self, count: int) -> Sequence[Inferred]:
        """Members evenly spaced among the samples; none of a member."""
        if self.member != 0:
            return ()
        there = len(_read(self.path, file_stamp(self.path))[0].samples)
        count = min(count, there)
        return [
            self.replace(member=int((number + 0.5) * there / count) + 1)
            for number in range(count)
        ]

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        """Barriers (eV) at the probabilities ``uniform``, same shape."""
        inside, share, first = self._in_use()
        u = doubles(uniform)
        beyond = first + _WIDTH * np.clip(
            (u - share) / max(1 - share, 1e-300), 0.0, 1.0
        )
        if inside is None:
            return beyond
        return np.where(
            u < share, inside.quantile(np.minimum(u / share, 1.0)), beyond
        )

    def density(self, energy: np.ndarray) -> np.ndarray:
        """Probability density (1/eV) at ``energy`` (eV), same shape."""
        inside, share, first = self._in_use()
        e = doubles(energy, "eV")
        beyond = np.where(
            (e >= first) & (e <= first + _WIDTH), (1 - share) / _WIDTH, 0.0
        )
        return beyond if inside is None else share * inside.density(e) + beyond

    def _in_use(self) -> tuple[PiecewiseLinearDensity | None, float, float]:
        return _distribution(self.path, file_stamp(self.path), self.member)
