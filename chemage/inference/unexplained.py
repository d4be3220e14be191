"""The error of data that no density of barriers explains."""

from __future__ import annotations

import numpy as np

from chemage.foundation.errors import InputError


class UnexplainedError(InputError):
    """No non-negative density of barriers explains the data; carries the density that comes closest."""

    def __init__(
        self,
        message: str,
        *,
        energies: np.ndarray,
        density: np.ndarray,
        fitted: np.ndarray,
        residuals: np.ndarray,
        chi2: float,
    ) -> None:
        super().__init__(message)
        #: (n,) eV, and (n,) 1/eV: the non-negative density of least χ²
        self.energies, self.density = energies, density
        #: (m,) nN, and (m,) (measured − fitted)/error
        self.fitted, self.residuals = fitted, residuals
        self.chi2 = chi2
