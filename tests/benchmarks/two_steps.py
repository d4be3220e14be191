"""What ageing in two steps tells of the density of barriers, beside as many numbers from contacts that only rest.

python tests/benchmarks/two_steps.py

Independent sites without inference: the density is a Gaussian process before the data, errors are normal, so that the
posterior is known in closed form. An energy is *visible* where its standard deviation is at most half of that before.
"""

from __future__ import annotations

import numpy as np

from chemage.plugin import KB

ENERGIES = np.arange(0.5, 1.6, 0.005)
BREAKING, NU = 1.1, 1e13


def bonded(start: np.ndarray, kelvin: float, times: np.ndarray) -> np.ndarray:
    """(m, n) shares of bonded sites of each energy at ``times`` (s) from those at the ``start`` (n,)."""
    forming, breaking = (NU * np.exp(-np.asarray(e) / (KB * kelvin)) for e in (ENERGIES, BREAKING))
    rate = forming + breaking
    return forming / rate + (start - forming / rate) * np.exp(-rate * times[:, None])


def told(rows: list[np.ndarray], error: float = 0.03) -> tuple[np.ndarray, float]:
    """Standard deviation after over before the data, and the information, nats."""
    response = np.concatenate(rows) * 0.005
    prior = np.exp(-(((ENERGIES[:, None] - ENERGIES) / 0.06) ** 2) / 2)
    signal = response @ prior @ response.T
    noise = (error * 0.25) ** 2 * np.eye(len(signal))
    posterior = prior - prior @ response.T @ np.linalg.solve(signal + noise, response @ prior)
    information = 0.5 * np.linalg.slogdet(np.eye(len(signal)) + signal / noise[0, 0])[1]
    return np.sqrt(np.maximum(np.diag(posterior), 0.0)), float(information)


def main() -> None:
    none, long, six = np.zeros(ENERGIES.size), np.geomspace(1, 1e5, 12), np.geomspace(1, 1e5, 6)
    cold = bonded(none, 300.0, six)
    rested = bonded(none, 300.0, np.array([1e5]))[0]
    hot = bonded(none, 350.0, np.array([1e3]))[0]
    designs = {
        "12 times at 300 K": [bonded(none, 300.0, long)],
        "6 at 300 K, 6 at 350 K in other contacts": [cold, bonded(none, 350.0, six)],
        "6 at 300 K, then 6 of the same contact at 350 K": [cold, bonded(rested, 350.0, six)],
        "6 at 300 K, then 6 at 400 K": [cold, bonded(rested, 400.0, six)],
        "6 at 300 K, 6 at 300 K after 1000 s at 350 K": [cold, bonded(hot, 300.0, six)],
    }
    for name, rows in designs.items():
        left, information = told(rows)
        seen = ENERGIES[left <= 0.5]
        print(f"{name}: {information:.1f} nats; visible from {seen.min():.2f} to {seen.max():.2f} eV")


if __name__ == "__main__":
    main()
