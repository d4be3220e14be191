"""The bonds of sites that are independent of each other: what the bonds of a window are compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from chemage import EV_PER_GPA_NM3, KB, Chemistry

#: quantiles of the barriers, and pressures between which is interpolated
FORMING, BREAKING, PRESSURES = 512, 8, 33


class Independent(NamedTuple):
    """The share of reactive sites that are bonded, by pressure and time.

    The closed form of a site that forms its bond at the rate k_f and breaks it at k_b, over quantiles of the barriers.
    It need not be exact, because it only has to resemble the bonds.
    """

    #: GPa
    pressures: np.ndarray
    #: (pressures, m)
    share: np.ndarray

    @classmethod
    def of(cls, chemistry: Chemistry, highest: float, times: np.ndarray, kelvin: float) -> Independent:
        """The share at ``times`` (m,) s, for pressures up to ``highest`` GPa."""
        pressures = np.linspace(0.0, highest or 1.0, PRESSURES)
        lowered = chemistry.activation_volume * EV_PER_GPA_NM3 * pressures[:, None]
        forming = _rates(chemistry.forming.quantile(_middles(FORMING)) - lowered, chemistry, kelvin)[..., None]
        breaking = np.zeros(1)
        if chemistry.breaking is not None:
            breaking = _rates(chemistry.breaking.quantile(_middles(BREAKING)), chemistry, kelvin)
        total = forming + breaking
        most = np.divide(forming, total, out=np.zeros_like(total), where=total > 0)
        with np.errstate(under="ignore", over="ignore"):
            share = [-(most * np.expm1(-np.minimum(total * time, 1e300))).mean(axis=(1, 2)) for time in times]
        return cls(pressures, chemistry.hydroxylation * np.stack(share, axis=-1))

    def bonds(self, pressure: np.ndarray, group: np.ndarray, groups: int) -> np.ndarray:
        """The expected bonds in each of ``groups`` groups of sites: (groups, m). Site i is in ``group[i]``."""
        count = self.pressures.size
        right = np.clip(np.searchsorted(self.pressures, pressure), 1, count - 1)
        part = np.clip(pressure / self.pressures[1] - (right - 1), 0.0, 1.0)
        at, shape = group * count + right, groups * count
        weights = np.bincount(at, part, shape) + np.bincount(at - 1, 1 - part, shape)
        return weights.reshape(groups, count) @ self.share


def _middles(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count


def _rates(barriers: np.ndarray, chemistry: Chemistry, kelvin: float) -> np.ndarray:
    with np.errstate(under="ignore", over="ignore"):
        return chemistry.attempt_frequency * np.exp(-np.maximum(barriers, 0.0) / (KB * kelvin))
