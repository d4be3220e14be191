"""What follows from the bonds of a result, for files and tables: friction with its errors, and the fit of β."""

from __future__ import annotations

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.fitting import FIT_WINDOW, Fit
from chemage.foundation.codec import Derived
from chemage.foundation.errors import InputError

#: at each hold time: name -> (unit, meaning)
CURVES: dict[str, tuple[str, str]] = {
    "friction_drop": ("nN", "friction drop, mean over replicas"),
    "friction_drop_stderr": ("nN", "its standard error"),
    "friction_drop_half_width": ("nN", "half the width of its 95 % interval"),
    "friction_coefficient_drop": ("1", "friction coefficient drop, mean over replicas"),
    "friction_coefficient_drop_stderr": ("1", "its standard error"),
    "friction_coefficient_drop_half_width": ("1", "half the width of its 95 % interval"),
}
#: numbers of the fit: name -> (unit, meaning)
FIT: dict[str, tuple[str, str]] = {
    "beta": ("1", "slope of the friction coefficient drop per decade of hold time"),
    "beta_stderr": ("1", "standard error of beta"),
    "beta_half_width": ("1", "half the width of the 95 % interval of beta"),
    "b": ("1", "beta over ln 10, the slope per factor e of hold time"),
    "b_stderr": ("1", "standard error of b"),
    "b_half_width": ("1", "half the width of the 95 % interval of b"),
    "cutoff_time": ("s", "cut-off time"),
    "cutoff_time_stderr": ("s", "standard error of the cut-off time"),
    "cutoff_time_low": ("s", "lower end of the 95 % interval of the cut-off time"),
    "cutoff_time_high": ("s", "upper end of the 95 % interval of the cut-off time"),
}


def curves(aging: Aging) -> dict[str, np.ndarray]:
    """Those of :data:`CURVES`, (m,) each; nan where a number is not known: no load, or a single replica."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            "friction_drop": aging.mean_friction_drop,
            "friction_drop_stderr": aging.friction_drop_stderr,
            "friction_drop_half_width": aging.friction_drop_half_width,
            "friction_coefficient_drop": aging.mean_friction_coefficient_drop,
            "friction_coefficient_drop_stderr": aging.friction_coefficient_drop_stderr,
            "friction_coefficient_drop_half_width": aging.friction_coefficient_drop_half_width,
        }


def fit_numbers(fit: Fit) -> dict[str, float]:
    """Those of :data:`FIT`; nan where a number is not known."""
    return {
        "beta": fit.beta,
        "beta_stderr": fit.beta_stderr,
        "beta_half_width": fit.beta_half_width,
        "b": fit.b,
        "b_stderr": fit.b_stderr,
        "b_half_width": fit.b_half_width,
        "cutoff_time": fit.cutoff_time,
        "cutoff_time_stderr": fit.cutoff_time_stderr,
        "cutoff_time_low": fit.cutoff_interval.low,
        "cutoff_time_high": fit.cutoff_interval.high,
    }


def derived(aging: Aging, window: tuple[float, float] = FIT_WINDOW) -> Derived:
    """The curves and the fit over ``window`` (first and last hold time, s), to be stored beside ``aging``.

    Without load there is no coefficient of friction; without two hold times in the window there is no fit.
    """
    found = {name: values for name, values in curves(aging).items() if aging.load > 0 or "coefficient" not in name}
    variables = {name: (("hold_time",), values, *CURVES[name]) for name, values in found.items()}
    try:
        fit = aging.fit(*window)
    except InputError:
        return Derived(variables, {})
    return Derived(
        variables,
        {**fit_numbers(fit), "fit_window": np.array(window, dtype=np.float64), "fit_range": np.array(fit.span)},
    )
