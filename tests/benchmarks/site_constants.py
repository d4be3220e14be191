"""Where the constants of the reconstruction below the pixel come from, and the errors that docs/model.md quotes.

    python tests/benchmarks/site_constants.py          # about five minutes

1. How many pixels the reconstructed rim lies beyond the true one (``BEYOND`` and the like of ``site_grid``): the shift
   at which sites are as many as they should be. For contacts solved by fft-bem, of which every loaded pixel counts,
   that is the number of pixels in contact on the grid of sites; for hertz, which counts the centres of pixels, it is
   the area of Hertz.
2. Numbers of sites on pixels twice and four times as large as sites and half as large, for twelve surfaces whose
   patches have few pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import chemage as ca
from chemage.lattices import site_grid

SPACING, MODULUS = 0.4518, 35.3
SOLVER = ca.contact("fft-bem", modulus=MODULUS, gap=True)
SHIFTS = np.arange(-0.30, 0.301, 0.05)


def rough(pixels: int, sites: int, zeta: float, eta: float, pressure: float, seed: int) -> ca.ContactSolution:
    """A rough contact of ``sites`` along a side, solved on ``pixels``; mean pressure in GPa."""
    side = sites * SPACING
    maker = ca.surface(
        "self-affine", pixels=pixels, pixel_size=side / pixels, rms_slope=0.1, hurst=0.8, zeta=zeta, eta=eta
    )
    return SOLVER.solve(maker.make(seed), pressure * side**2)


def counted(contact: ca.ContactSolution, density: float, name: str, shift: float) -> int:
    """Sites in contact, if the constant ``name`` were ``shift``."""
    kept = getattr(site_grid, name)
    setattr(site_grid, name, shift)
    try:
        return site_grid._made(contact, density).sites.size
    finally:
        setattr(site_grid, name, kept)


def root(contacts: Sequence[ca.ContactSolution], expected: float, density: float, name: str) -> float:
    """The shift at which all ``contacts`` together have the ``expected`` number of sites."""
    found = [sum(counted(one, density, name, float(shift)) for one in contacts) for shift in SHIFTS]
    return float(np.interp(-expected, -np.array(found, float), SHIFTS))


def without_gap(contacts: Sequence[ca.ContactSolution]) -> list[ca.ContactSolution]:
    return [one.model_copy(update={"gap": None}) for one in contacts]


def loaded_pixels() -> None:
    print("| surface | pixels | shift with gap | without |\n| --- | --- | --- | --- |")
    for seed in (1, 2, 3):
        fine = rough(1024, 1024, 60, 1, 0.0157, seed).sites.size
        for pixels in (512, 256):
            coarse = [rough(pixels, 1024, 60, 1, 0.0157, seed)]
            shifts = [
                root(contacts, fine, SPACING**-2, name)
                for contacts, name in ((coarse, "BEYOND"), (without_gap(coarse), "BEYOND_WITHOUT_GAP"))
            ]
            print(
                f"| self-affine, seed {seed} | {1024 // pixels} sites | {shifts[0]:+.3f} | {shifts[1]:+.3f} |",
                flush=True,
            )


def centres() -> None:
    print("\n| sphere, contact radius | shift with gap | without |\n| --- | --- | --- |")
    radius = 30.0
    for edge in (2.0, 3.0, 5.0, 10.0):
        force = edge**3 * MODULUS / (0.75 * radius)
        solver = ca.contact("hertz", modulus=MODULUS, gap=True)
        # even and odd numbers of pixels, and pixels of slightly other sizes, place the rim differently on them
        contacts = []
        for pixels in (32, 33):
            for size in np.linspace(0.95, 1.05, 10):
                surface = ca.surface("sphere", radius=radius, pixels=pixels, pixel_size=float(size)).make()
                contacts.append(solver.solve(surface, force))
        expected = len(contacts) * math.pi * edge**2 * 16.0
        shifts = [
            root(some, expected, 16.0, name)
            for some, name in (
                (contacts, "BEYOND_CENTRES"),
                (without_gap(contacts), "BEYOND_CENTRES_WITHOUT_GAP"),
            )
        ]
        print(f"| {edge:g} pixels | {shifts[0]:+.3f} | {shifts[1]:+.3f} |", flush=True)


def few_pixels() -> None:
    print("\n| pixels | sites, mean over 12 surfaces | least | most | scatter |\n| --- | --- | --- | --- | --- |")
    fine = [rough(256, 256, 16, 2, 0.03, seed).sites.size for seed in range(1, 13)]
    for pixels in (128, 64, 512):
        found = [
            100 * (site_grid._made(rough(pixels, 256, 16, 2, 0.03, seed), SPACING**-2).sites.size / expected - 1)
            for seed, expected in enumerate(fine, 1)
        ]
        print(
            f"| {256 / pixels:g} sites | {np.mean(found):+.1f} % | {min(found):+.1f} % | {max(found):+.1f} % "
            f"| {np.std(found, ddof=1):.1f} % |",
            flush=True,
        )


if __name__ == "__main__":
    loaded_pixels()
    centres()
    few_pixels()
