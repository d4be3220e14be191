"""Barriers to the formation of siloxane bridges."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage.plugin import Barriers, content_hash
from chemage_bonds import PiecewiseLinearDensity, parse_columns

#: members of ``md_silica_barriers.csv``
_MEMBERS = 16


@lru_cache(maxsize=1)
def _table() -> tuple[PiecewiseLinearDensity, ...]:
    """The densities of the table, by member."""
    name = "md_silica_barriers.csv"
    text = (
        resources.files("chemage_silica").joinpath(name).read_text(encoding="utf-8")
    )
    rows = parse_columns(text, name)
    return tuple(
        PiecewiseLinearDensity(*rows[rows[:, 0] == member, 1:].T)
        for member in range(_MEMBERS)
    )


_LIU = """@article{liu2012,
  author = {Liu, Y. and Szlufarska, I.},
  title = {Chemical origins of frictional aging},
  journal = {Physical Review Letters},
  volume = {109},
  pages = {186102},
  year = {2012},
  doi = {10.1103/PhysRevLett.109.186102},
}"""


class MDSilica(Barriers):
    """Barriers to forming a siloxane bridge: a stand-in for the published distribution, calibrated to the published β.

    The published distribution spans 0.8 to 1.4 eV and is not tabulated. The members span what the published rates and
    times leave open. ``member`` 0, on which the scenes rest, has the least misfit; the range of a result over all of
    them is its calibration error. The study ``chemage study density`` calibrates them. The table and its provenance are
    in ``md_silica_barriers.csv`` in this package; the kind ``tabulated`` reads other tables or samples.
    """

    kind = "md-silica"
    cite = (
        "Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",
        "Y. Liu, I. Szlufarska, Phys. Rev. Lett. 109, 186102 (2012)",
    )
    bibtex = ("", _LIU)
    #: number of members: ``member`` is from 0 to one less
    MEMBERS: ClassVar[int] = _MEMBERS

    member: int = Field(default=0, ge=0, lt=_MEMBERS)
    """0: least misfit; 1 to 15: with it, span what the published rates and times leave open; default: 0"""

    def content(self) -> dict[str, str]:
        """A hash of the density, so that results of another table are not taken for those of this one."""
        table = _table()[self.member]
        text = (
            np.concatenate([table.energies, table.density_values]).round(9).tolist()
        )
        return {"density_blake2b": content_hash(text)}

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        """Barriers (eV) at the probabilities ``uniform``, same shape."""
        return _table()[self.member].quantile(uniform)

    def density(self, energy: np.ndarray) -> np.ndarray:
        """Probability density (1/eV) at ``energy`` (eV), same shape."""
        return _table()[self.member].density(energy)
