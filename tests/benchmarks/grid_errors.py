"""The estimated error of the contact area on a grid, against finer grids.

    python tests/benchmarks/grid_errors.py [number of surfaces]      # 40 surfaces: about five minutes

Random self-affine surfaces (H 0.3, 0.5, 0.8; 4 to 64 pixels per shortest wavelength on the grid in question) at
A/A0 between 0.006 and 0.9. The area of a grid and of grids two (and four) times coarser is extrapolated to vanishing
pixels as ``chemage tradeoff`` does it, and compared with the extrapolation from grids of 1024² and 2048² pixels.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import chemage as ca

MODULUS, SLOPE, SIDE = 35.3, 0.1, 128.0
GRIDS = (64, 128, 256, 512, 1024, 2048)
#: grids whose error is estimated; the uncertainty of the truth is a twentieth of theirs or less
JUDGED = (128, 256)
#: Order in the pixel size of the error of the corrected area: what the correction leaves of the excess at the contour,
#: whose pixels are a fixed part of all pixels. This script measures it.
ORDER = 1


@dataclass(frozen=True)
class Limit:
    """The corrected area in the limit of vanishing pixels."""

    #: nm²
    area: float
    #: standard error, nm²
    area_stderr: float


def vanishing_pixels(contacts: Sequence[ca.ContactSolution]) -> Limit | None:
    """Extrapolate the corrected area of contacts of one surface on two or more grids to vanishing pixels (Richardson).

    The line through area against pixel size (order 1) is fitted by least squares. The area on each grid is uncertain by
    the pixels along the contour, of length C, each of which is in contact or not: their share that belongs to the
    contact is uniformly distributed, with variance 1/12, and there are C/a of them, so that the standard error is
    a² √(C/12a). From this follow the weights and the standard error of the limit. None where the grids do not
    determine it: one grid, or a contact without a contour.
    """
    sizes = np.array([contact.pixel_size for contact in contacts])
    contours = np.array([contact.perimeter for contact in contacts])
    if np.unique(sizes).size < 2 or not contours.all():
        return None
    areas = np.array([contact.corrected_area for contact in contacts])
    sigma = sizes**2 * np.sqrt(contours / (12.0 * sizes))
    # in units of the coarsest pixels and of the largest error, for any units of length
    design = np.stack([np.ones_like(sizes), (sizes / sizes.max()) ** ORDER], axis=1) * (sigma.max() / sigma)[:, None]
    inverse = np.linalg.inv(design.T @ design)
    limit = float((inverse @ design.T @ (areas * sigma.max() / sigma))[0])
    return Limit(limit, math.sqrt(float(inverse[0, 0])) * float(sigma.max()))


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
