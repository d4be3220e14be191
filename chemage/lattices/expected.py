"""How many bonds form and break, estimated before any lattice is made."""

from __future__ import annotations

import numpy as np

from chemage.foundation.units import KB
from chemage.lattices.chemistry import Chemistry, effective_forming

#: quantiles of the forming barrier, of the breaking barrier and of the pressure that the mean is taken over
FORMING, BREAKING, PRESSURES = 512, 8, 8
#: events with an interaction over those without
COUPLED = 0.5


def expected_events(chemistry: Chemistry, pressure: float, hold_time: float, temperature: float) -> float:
    """Bonds formed and broken per reactive site until ``hold_time``, the mean over barriers and pressures.

    The closed form of a site that forms a bond at the rate k_f and breaks it at the rate k_b. Couplings mostly raise
    barriers; with an ``interaction`` half of the events of sites without are expected (measured on rough contacts from
    250 to 500 K and strengths of 0.1 to 0.5 eV: 0.39 to 0.64).

    Parameters
    ----------
    pressure
        Mean contact pressure, GPa; the pressures about it are taken to be distributed as a Rayleigh distribution, that
        of a rough contact at a small load.
    hold_time, temperature
        s, K.
    """
    rayleigh = np.sqrt(-4 / np.pi * np.log1p(-_middles(PRESSURES))) * pressure
    intrinsic = chemistry.forming.quantile(_middles(FORMING))
    barriers = effective_forming(intrinsic, chemistry.activation_volume, rayleigh[:, None])
    forming = _rates(barriers, chemistry, temperature)[..., None]
    share = 1.0 if chemistry.interaction is None else COUPLED
    if chemistry.breaking is None:
        return share * float(-np.expm1(-_product(forming, hold_time)).mean())
    breaking = _rates(chemistry.breaking.quantile(_middles(BREAKING)), chemistry, temperature)
    total = forming + breaking
    bonded = np.divide(forming, total, out=np.zeros_like(total), where=total > 0)
    # the mean of 1 - exp(-k t) over the hold time
    risen = _risen(_product(total, hold_time))
    formed = _product(forming, hold_time) * (1 - bonded * risen)
    broken = _product(breaking, hold_time) * bonded * risen
    return share * float(np.minimum(formed + broken, 1e300).mean())


def _middles(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count


def _rates(barriers: np.ndarray, chemistry: Chemistry, temperature: float) -> np.ndarray:
    with np.errstate(under="ignore", over="ignore"):
        return chemistry.attempt_frequency * np.exp(-np.maximum(barriers, 0.0) / (KB * temperature))


def _product(rates: np.ndarray, hold_time: float) -> np.ndarray:
    with np.errstate(under="ignore", over="ignore"):
        return np.minimum(rates * hold_time, 1e300)


def _risen(x: np.ndarray) -> np.ndarray:
    """1 − (1 − e^−x)/x without cancellation for small x."""
    small = x < 1e-4
    safe = np.where(small, 1.0, x)
    return np.where(small, x / 2, 1 + np.expm1(-safe) / safe)
