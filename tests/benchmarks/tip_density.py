"""Whether one density of barriers serves rough contacts and a tip: ``python tests/benchmarks/tip_density.py FOLDER``.

Friction of silica tips grows in proportion to time from 5 to 90 ms and logarithmically from 0.1 s on (Tian et al., Phys.
Rev. Lett. 124, 026801 (2020)). Densities whose lower end is free age the rough contacts of Li et al. (2018) and the tip
of the scene ``silica-afm-tip``. FOLDER keeps the curves of the rough contacts, as ``rates`` of ``chemage study density``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import chemage as ca
from chemage_li2018 import density_fit as fit
from chemage_li2018.density_rates import CONDITIONS, SURFACES, TIMES, DensityCurves
from chemage_li2018.shapes import first_reaching

#: start of the logarithmic regime, s; hold times (s) between which friction grows as a power of time, 1 with this error
ONSET, LINEAR, EXPONENT = 0.1, (5e-3, 90e-3), 0.1
#: relative error of each rate of the rough contacts, one standard deviation; draws of the disorder on the tip
METHOD, DRAWS = 0.04, 200
#: of ln β between surfaces, nearly a common factor, and what 32 surfaces have more than the four, which hardly depends on
#: the density (`chemage study density`)
SCATTER = np.array([0.039, 0.053, 0.085, 0.040, 0.050, 0.072])
SHIFT = np.array([-0.0316, -0.0423, -0.0767, -0.0324, -0.0395, -0.0654])
#: readings with one window for all conditions
ONE_WINDOW = [at for at, of in enumerate(fit.READINGS) if of.starts[0] and of.starts[0] == of.starts[1]]
FREE_END = fit.DensityFamily(
    "triangle with a free lower end",
    {"lower end (eV)": (0.66, 0.8), "peak − lower end (eV)": (0.02, 0.5), "at the lower end/peak": (0.0, 0.5)},
    lambda lower, rise, start: ((lower, lower + rise, fit.UPPER), (start, 1, 0)),
)


def on_tip(parameters: np.ndarray) -> np.ndarray:
    """Δμ of densities (n, 3) on the tip, (n, 1, m)."""
    hold = {"hold.start": "1 ms", "hold.stop": "1e5 s", "hold.replicas": DRAWS, "hold.common": "all"}
    curves = []
    for row in parameters:
        energies, weights = (list(values) for values in FREE_END.nodes(*row.tolist()))
        density = {"forming.energies": energies, "forming.weights": weights}
        found = ca.run(ca.load_scene("silica-afm-tip", {**hold, **density}))
        assert found.ageing is not None
        curves.append(found.ageing.mean_friction_coefficient_drop)
    return np.array(curves)[:, None]


def growth(curves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start of the logarithmic regime (s) and exponent of the growth before, (n, 2), and their misfit, (n,)."""
    x = np.log10(TIMES)
    half = 0.5 * fit.slope(curves, (1.0, 1e3))
    start = first_reaching(TIMES, np.gradient(curves, x, axis=-1), half)
    inside = (LINEAR[0] <= TIMES) & (LINEAR[1] >= TIMES)
    exponent = np.polyfit(x[inside], np.log10(np.maximum(curves[:, inside], 1e-6)).T, 1)[0]
    misfit = (np.log(start / ONSET) / fit.ONSET_ERROR) ** 2 + ((exponent - 1) / EXPONENT) ** 2
    return np.stack([start, exponent], axis=1), misfit


def main(folder: Path) -> None:
    """Print the best density for the rough contacts, for the tip, and for both."""
    parameters = FREE_END.design(56)
    rates = DensityCurves(folder, lambda *_: None)
    densities = [FREE_END.barriers(row) for row in parameters]
    rough = rates.curves("rough", densities, SURFACES[:4], CONDITIONS).mean(axis=1)
    drawn = FREE_END.design(1 << 12, seed=11)
    made = fit.Emulator(FREE_END, parameters, rough)
    reported = fit.Reported.of(made(drawn))
    reported.beta[:, :, :6] += SHIFT
    errors = fit.covariance(np.outer(SCATTER, SCATTER) + made.error, fit.PUBLISHED, METHOD)
    every = reported.chi_squared(fit.PAPER, errors) + reported.misfit_of_times(fit.PAPER)
    of_rough = every[:, ONE_WINDOW].min(axis=1)
    _, of_tip = growth(fit.Emulator(FREE_END, parameters, on_tip(parameters))(drawn)[:, 0])
    best = [int(np.argmin(misfit)) for misfit in (of_rough, of_tip, of_rough + of_tip)]
    # computed, because a curve between others has an error where few sites have reacted
    found, of_tip = growth(on_tip(drawn[best])[:, 0])
    for name, row, at, tip, (start, exponent) in zip(
        ("rough", "tip", "both"), drawn[best], best, of_tip, found, strict=True
    ):
        shown = ", ".join(f"{key} {value:.3g}" for key, value in zip(FREE_END.ranges, row, strict=True))
        print(f"{name}: {shown}: misfit of rough contacts {of_rough[at]:.1f}, of the tip {tip:.1f}")
        print(f"    logarithmic from {start:.2g} s, exponent before {exponent:.2f}")
    print(f"both above the sum: {of_rough[best[2]] + of_tip[2] - of_rough[best[0]] - of_tip[1]:.1f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
