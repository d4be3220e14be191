"""Rate-and-state friction of a slider on a spring: the two laws of evolution, integrated through changes of speed.

μ = μ₀ + a ln(V/V₀) + b ln(V₀θ/D_c), dμ/dt = K (V_load − V), with dθ/dt = 1 − Vθ/D_c (ageing law; Dieterich, J.
Geophys. Res. 84, 2161 (1979)) or −(Vθ/D_c) ln(Vθ/D_c) (slip law; Ruina, J. Geophys. Res. 88, 10359 (1983)).
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

import numpy as np

Law: TypeAlias = Literal["ageing", "slip"]
LAWS: tuple[Law, ...] = "ageing", "slip"


class Parameters(NamedTuple):
    """Of a law."""

    #: direct effect, and evolution
    a: float
    b: float
    #: D_c, µm
    slip_length: float
    #: of spring and machine, over the normal force, 1/µm
    stiffness: float


class Loading(NamedTuple):
    """The speeds of the load point, each from its time on; the first is V₀, at which sliding has become steady."""

    #: (n,) s, and µm/s
    times: np.ndarray
    speeds: np.ndarray

    def displacement(self, times: np.ndarray) -> np.ndarray:
        """(m,) µm of the load point since its first time."""
        spans = np.append(np.diff(self.times), np.inf)
        passed = np.clip(times[:, None] - self.times, 0.0, spans)
        return passed @ self.speeds


def change(
    law: Law, one: Parameters, loading: Loading, times: np.ndarray, steps: int = -1
) -> np.ndarray:
    """(m,) μ − μ₀ at ``times`` (m,), s, rising; NaN from where the slider is unstable, or after so many
    ``steps`` of integration, if they are bounded.

    With x = ln(V/V₀), y = ln(V₀θ/D_c) and the time in D_c/V₀ all is of order one: y' = exp(−y) − exp(x) or −exp(x)(x +
    y), and a x' = K D_c (V_load/V₀ − exp(x)) − b y'.
    """
    from chemage_rate_state._kernels import states

    a, b, length, stiffness = one
    unit, first = loading.speeds[0] / length, loading.times[0]
    pull, ratios = stiffness * length / a, loading.speeds / loading.speeds[0]
    ends = np.append(unit * (loading.times[1:] - first), np.inf)
    found = states(
        law == "slip", b / a, pull, ends, ratios, unit * (times - first), steps
    )
    return a * found[:, 0] + b * found[:, 1]
