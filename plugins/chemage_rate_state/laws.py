"""Rate-and-state friction of a slider on a spring: the two laws of evolution, integrated through changes of speed.

μ = μ₀ + a ln(V/V₀) + b ln(V₀θ/D_c), dμ/dt = K (V_load − V), with dθ/dt = 1 − Vθ/D_c (ageing law; Dieterich, J.
Geophys. Res. 84, 2161 (1979)) or −(Vθ/D_c) ln(Vθ/D_c) (slip law; Ruina, J. Geophys. Res. 88, 10359 (1983)).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

Law: TypeAlias = Literal["ageing", "slip"]
LAWS: tuple[Law, ...] = ("ageing", "slip")
#: relative and absolute error of a step of the integration
RELATIVE, ABSOLUTE = 1e-9, 1e-11
#: steps between two times at most
MOST_STEPS = 500


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
        ways = np.append(0.0, np.cumsum(np.diff(self.times) * self.speeds[:-1]))
        at = np.maximum(np.searchsorted(self.times, times, "right") - 1, 0)
        return ways[at] + self.speeds[at] * (times - self.times[at])


def change(
    law: Law, parameters: Parameters, loading: Loading, times: np.ndarray
) -> np.ndarray:
    """(m,) μ − μ₀ at ``times`` (m,), s, not falling.

    With x = ln(V/V₀), y = ln(V₀θ/D_c) and the time in D_c/V₀ all is of order one: y' = exp(−y) − exp(x) or −exp(x)(x +
    y), and a x' = K D_c (V_load/V₀ − exp(x)) − b y'.

    Raises
    ------
    FloatingPointError
        The slider is unstable, so that its speed leaves the range of numbers.
    """
    found = np.zeros(times.size)
    state: Sequence[float] = (0.0, 0.0)
    unit = loading.speeds[0] / parameters.slip_length
    ends = np.append(loading.times[1:], times[-1])
    parts = zip(loading.times, ends, loading.speeds, strict=True)
    for number, (begin, end, speed) in enumerate(parts):
        if number == 0:
            continue  # steady
        inside = (times > begin) & (times <= end)
        passed = (times[inside] - begin) * unit
        span = (end - begin) * unit
        if span <= 0:
            continue
        if not np.isfinite(span):
            raise FloatingPointError("a slip length of 0")
        ratio = speed / loading.speeds[0]
        wanted = (
            passed
            if passed.size and passed[-1] >= span
            else np.append(passed, span)
        )
        x, y = _integrated(law, parameters, ratio, state, wanted)
        found[inside] = (parameters.a * x + parameters.b * y)[: passed.size]
        state = float(x[-1]), float(y[-1])
    return found


def _integrated(
    law: Law,
    parameters: Parameters,
    ratio: float,
    state: Sequence[float],
    times: np.ndarray,
) -> np.ndarray:
    """(2, m) x and y at ``times`` (m,), in D_c/V₀, from ``state`` at 0."""
    from scipy.integrate import ODEintWarning, odeint

    a, b, length, stiffness = (float(one) for one in parameters)
    pull, ratio = stiffness * length, float(ratio)

    def rates(_: float, at: Sequence[float]) -> tuple[float, float]:
        x, y = float(at[0]), float(at[1])
        speed = math.exp(x)
        evolved = math.exp(-y) - speed if law == "ageing" else -speed * (x + y)
        return (pull * (ratio - speed) - b * evolved) / a, evolved

    with warnings.catch_warnings():
        warnings.simplefilter("error", ODEintWarning)
        how = {"rtol": RELATIVE, "atol": ABSOLUTE, "mxstep": MOST_STEPS}
        try:
            found = odeint(rates, state, np.append(0.0, times), tfirst=True, **how)
        except (ODEintWarning, ArithmeticError) as error:
            raise FloatingPointError(str(error)) from None
    return found[1:].T
