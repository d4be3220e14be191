"""What six published ageing rates say of the density of barriers: ``python tests/benchmarks/six_rates.py [FIGURE]``.

Each rate is a linear functional of the density near `md-silica`: its derivative comes from the forward model of
``chemage.infer`` on rough contacts of the slopes of the paper. With the errors of the published rates, the posterior
under a normal prior with the covariance of the prior of ``chemage.infer`` follows in closed form.
"""

from __future__ import annotations

import sys

import numpy as np

import chemage as ca
from chemage.plugin import KB, figures
from chemage_inference.energies import energy_grid
from chemage_inference.forward import make_condition
from chemage_inference.problem import Prior

SLOPES, VOLUMES = (0.05, 0.1, 0.2), (6.4e-3, 0.0)
TIMES = np.geomspace(10, 1e4, 13)
PUBLISHED = np.array([[0.89, 0.45, 0.20], [0.98, 0.49, 0.24]])
#: relative scatter of a rate between surfaces, which both volumes of a slope share, and of their ratio; of the method
SURFACE, RATIO, METHOD = np.array([0.041, 0.055, 0.083]), np.array([0.005, 0.009, 0.018]), 0.01
PIXELS, WHOLE, LOAD = 1024, 2500, 20e3


def derivatives() -> tuple[np.ndarray, np.ndarray, np.ndarray, Prior]:
    """Energies (n,), rates (6,) at `md-silica`, their derivatives by the density (6, n), and the prior."""
    base = ca.load_scene("silica-rough", {"surface.pixels": PIXELS})
    assert base.chemistry is not None
    grid = energy_grid(base.chemistry, np.array([300.0]), TIMES, 0.5)
    density = ca.barriers("md-silica").density(grid.nodes)
    load = LOAD * (PIXELS / WHOLE) ** 2
    x = np.log10(TIMES) - np.log10(TIMES).mean()
    weights = x / (x @ x) / load
    rates, rows = [], []
    for volume in VOLUMES:
        for slope in SLOPES:
            surface = base.surface.replace(rms_slope=slope)
            contact = base.solver.solve(surface.make(1), load)
            chemistry = base.chemistry.replace(activation_volume=volume)
            value, by_density = make_condition(chemistry, contact, 300.0, TIMES, grid).linear(density)
            rates.append(weights @ value)
            rows.append(weights @ by_density)
    return grid.nodes, np.array(rates), np.stack(rows), Prior(grid.nodes)


def covariance(rates: np.ndarray) -> np.ndarray:
    """(6, 6) of the logarithms of the published rates."""
    found = np.diag((0.005 / np.sqrt(3) / PUBLISHED.ravel()) ** 2 + METHOD**2)
    for one in range(6):
        for other in range(6):
            if one % 3 == other % 3:
                found[one, other] += SURFACE[one % 3] ** 2
    return found + np.diag(np.tile(RATIO**2 / 2, 2))


def main() -> None:
    """Print how many numbers the six rates fix, and where the density becomes narrower than the prior."""
    energies, rates, rows, prior = derivatives()
    print("rates of the forward model:", np.round(rates, 3))
    areas = np.full(energies.size, energies[1] - energies[0])
    samples = prior.sample(4000, areas, np.random.default_rng(0))
    before = np.cov(samples.T)
    kernel = rows / rates[:, None]
    errors = covariance(rates)
    gain = before @ kernel.T @ np.linalg.inv(kernel @ before @ kernel.T + errors)
    after = before - gain @ kernel @ before
    root = np.linalg.inv(np.linalg.cholesky(errors))
    singular = np.linalg.eigvalsh(root @ kernel @ before @ kernel.T @ root.T)[::-1]
    print("signal to noise of the independent combinations:", np.round(np.sqrt(np.maximum(singular, 0)), 2))
    print("effective parameters:", round(float(np.sum(singular / (1 + singular))), 2))
    width = 2.446 * KB * 300
    mean = np.exp(-0.5 * ((energies[:, None] - energies) / (width / 2.355)) ** 2)
    mean /= mean.sum(axis=1, keepdims=True)
    ratio = np.sqrt(np.diag(mean @ after @ mean.T) / np.diag(mean @ before @ mean.T))
    seen = energies[ratio < 0.7]
    print("standard deviation over that of the prior, least:", round(float(ratio.min()), 3))
    print("visible:", f"{seen[0]:.3f} to {seen[-1]:.3f} eV" if seen.size else "nothing")
    for low, high in ((0.7, 0.8), (0.8, 0.9), (0.9, 1.0), (1.0, 1.1), (1.1, 1.2), (1.2, 1.3)):
        part = np.where((energies >= low) & (energies < high), areas, 0.0)
        print(f"share of the sites from {low} to {high} eV: deviation falls to "
              f"{100 * np.sqrt(part @ after @ part / (part @ before @ part)):.0f} % of that of the prior")  # fmt: skip
    if len(sys.argv) > 1:
        draw(sys.argv[1], energies, kernel, ratio)


def draw(path: str, energies: np.ndarray, kernel: np.ndarray, ratio: np.ndarray) -> None:
    """Draw what each rate sees, and by how much the six narrow the density."""

    figure, (left, right) = figures.panels(9.6, 3.8, 2)
    for number, row in enumerate(kernel):
        label = f"h' = {SLOPES[number % 3]}, ΔV = {'6.4 Å³' if number < 3 else '0'}"
        left.plot(energies, row, color=figures.PALETTE[number % 3], ls="-" if number < 3 else "--", label=label)
    left.set(
        xlabel="forming barrier (eV)", ylabel="d ln β by the density (1/(1/eV) per node)", title="what each rate sees"
    )
    left.legend(frameon=False, fontsize=7)
    right.plot(energies, ratio, color=figures.BLACK)
    right.axhline(0.7, color=figures.PALETTE[4], lw=0.8, ls="--")
    right.set(
        xlabel="forming barrier (eV)",
        ylabel="posterior over prior",
        title="standard deviation of the density",
        ylim=(0, 1.1),
    )
    figure.savefig(path)


if __name__ == "__main__":
    main()
