"""Barriers to the formation of siloxane bridges."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import ClassVar

import numpy as np
from pydantic import Field

from chemage.plugin import Barriers, content_hash
from chemage_bonds import PiecewiseLinearDensity, parse_columns

#: members of the set in ``md_silica_barriers.csv`` beside the best density, which is member 0
_MEMBERS = 16


@lru_cache(maxsize=1)
def _table() -> tuple[PiecewiseLinearDensity, ...]:
    """The densities of the table, by member."""
    name = "md_silica_barriers.csv"
    text = resources.files("chemage_silica").joinpath(name).read_text(encoding="utf-8")
    rows = parse_columns(text, name)
    return tuple(PiecewiseLinearDensity(*rows[rows[:, 0] == member, 1:].T) for member in range(_MEMBERS + 1))


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

    The published distribution spans 0.8 to 1.4 eV and is not tabulated. ``member`` 0 is the density of a family of
    three parameters whose six ageing rates are closest to the published ones; ``member`` 1 to 16 are densities of the
    family that fit equally well within the errors of the published rates. The spread of a result over the members is
    its calibration error. The study ``chemage study density`` calibrates them. The table and its provenance are in
    ``md_silica_barriers.csv`` in this package; the kind ``tabulated`` reads other tables or samples.
    """

    kind = "md-silica"
    cite: ClassVar[tuple[str, ...]] = (
        "Z. Li, L. Pastewka, I. Szlufarska, Phys. Rev. E 98, 023001 (2018)",
        "Y. Liu, I. Szlufarska, Phys. Rev. Lett. 109, 186102 (2012)",
    )
    bibtex: ClassVar[tuple[str, ...]] = ("", _LIU)
    #: number of members beside the best density: ``member`` is from 0 to this
    MEMBERS: ClassVar[int] = _MEMBERS

    member: int = Field(default=0, ge=0, le=_MEMBERS)
    """0: the best density; 1 to 16: a density of the set that fits equally well; default: 0"""

    def content(self) -> dict[str, str]:
        """A hash of the density, so that results of another table are not taken for those of this one."""
        table = _table()[self.member]
        text = np.concatenate([table.energies, table.density_values]).round(9).tolist()
        return {"density_blake2b": content_hash(text)}

    def quantile(self, uniform: np.ndarray) -> np.ndarray:
        """Barriers (eV) at the probabilities ``uniform``, same shape."""
        return _table()[self.member].quantile(uniform)

    def density(self, energy: np.ndarray) -> np.ndarray:
        """Probability density (1/eV) at ``energy`` (eV), same shape."""
        return _table()[self.member].density(energy)
