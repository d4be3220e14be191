"""The mean of the first level with a control: a cheap number of each surface, known on many more surfaces.

This is double sampling with a regression estimator (Cochran, Sampling Techniques, 3rd ed. (1977), section 12.6), known
as multifidelity Monte Carlo where the number is a cheaper model (Peherstorfer, Willcox & Gunzburger, SIAM J. Sci.
Comput. 38, A3163 (2016)). Of n samples y of the first level and N ≥ n of the control x,

    mean = ȳ_n + α (x̄_N − x̄_n),   variance = σ²(1 − ρ²)/n + σ²ρ²/N

with the slope α of y against x and their correlation ρ; the two terms are uncorrelated, since the residuals of a
regression are uncorrelated with x.
"""

from __future__ import annotations

import numpy as np


def regressed(values: list[np.ndarray]) -> list[np.ndarray]:
    """The samples of each level with those of the first freed from what the control, the last of them, explains, and
    those of the control in units of each quantity.

    Parameters
    ----------
    values
        (samples, quantities) of each level, and (N, 1) of the control on the surfaces of the first level and on more.
    """
    first, control = values[0], values[-1][:, 0]
    pairs = control[: len(first)]
    centred = pairs - pairs.mean()
    square = float(centred @ centred)
    slope = centred @ first / square if square > 0 else np.zeros(first.shape[1])
    about = control - control.mean()
    return [first - np.outer(about[: len(first)], slope), *values[1:-1], np.outer(about, slope)]
