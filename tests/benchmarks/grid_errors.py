"""The estimated error of the contact area on a grid, against finer grids.

    python tests/benchmarks/grid_errors.py [number of surfaces]      # 40 surfaces: about five minutes

Random self-affine surfaces (H 0.3, 0.5, 0.8; 4 to 64 pixels per shortest wavelength on the grid in question) at
A/A0 between 0.006 and 0.9. The area of a grid and of grids two (and four) times coarser is extrapolated to vanishing
pixels as ``chemage tradeoff`` does it, and compared with the extrapolation from grids of 1024² and 2048² pixels.
"""

from __future__ import annotations

import sys

import numpy as np

import chemage as ca
from chemage.scene.scene import vanishing_pixels

MODULUS, SLOPE, SIDE = 35.3, 0.1, 128.0
GRIDS = (64, 128, 256, 512, 1024, 2048)
#: grids whose error is estimated; the uncertainty of the truth is a twentieth of theirs or less
JUDGED = (128, 256)


def contacts(seed: int) -> dict[int, ca.ContactSolution]:
    """One random surface at a random load, on every grid that resolves it."""
    rng = np.random.default_rng(seed)
    hurst, zeta, eta = rng.choice([0.3, 0.5, 0.8]), int(rng.choice([8, 16, 32])), rng.choice([1.0, 3.0])
    pressure = 10 ** rng.uniform(-2.5, -0.2) * MODULUS * SLOPE
    solver = ca.contact("fft-bem", modulus=MODULUS, tolerance=1e-6)
    found = {}
    for pixels in GRIDS:
        if zeta <= pixels / 4:
            maker = ca.surface(
                "self-affine",
                pixels=pixels,
                pixel_size=SIDE / pixels,
                rms_slope=SLOPE,
                hurst=hurst,
                zeta=zeta,
                eta=eta,
            )
            found[pixels] = solver.solve(maker.make(seed), pressure * SIDE**2)
    return found


def main() -> None:
    away: dict[int, list[float]] = {2: [], 3: []}
    error, estimate, orders = [], [], []
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 40):
        solved = contacts(seed)
        truth = vanishing_pixels([solved[pixels] for pixels in (1024, 2048)])
        assert truth is not None
        orders.append([solved[pixels].corrected_area / truth.area - 1 for pixels in (256, 512, 1024)])
        for pixels in JUDGED:
            for grids in away:
                used = [solved[p] for p in (pixels // 4, pixels // 2, pixels)[-grids:] if p in solved]
                limit = vanishing_pixels(used) if len(used) == grids else None
                if limit is None:
                    continue
                away[grids].append((limit.area - truth.area) / limit.area_stderr)
                error.append(solved[pixels].corrected_area / truth.area - 1)
                estimate.append(solved[pixels].corrected_area / limit.area - 1)
    print("relative error of the corrected area, mean over surfaces, 256², 512², 1024²:", np.mean(orders, axis=0))
    print(f"estimates: mean {np.mean(estimate):.4f}, true errors: mean {np.mean(error):.4f}")
    print("| grids | estimates | mean, standard errors | within 1 | within 2 | furthest |\n|" + " --- |" * 6)
    for grids, values in away.items():
        z = np.array(values)
        shares = (np.mean(np.abs(z) < 1), np.mean(np.abs(z) < 2))
        print(
            f"| {grids} | {z.size} | {z.mean():+.2f} | {100 * shares[0]:.0f} % | {100 * shares[1]:.0f} % | "
            f"{np.abs(z).max():.1f} |"
        )


if __name__ == "__main__":
    main()
