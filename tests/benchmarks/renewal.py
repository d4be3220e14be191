"""Slip that renews rough contacts against the size of their patches: python tests/benchmarks/renewal.py [--pixels 1024].

Spectra that differ in rms slope, Hurst exponent and shortest wave, and loads, so that mean chords 4A/C span a decade.
Prints D_c of ages, the integral of the overlap with the first contact, and the power law between D_c and chord.
"""

from __future__ import annotations

import argparse
import time
from itertools import product

import numpy as np

import chemage as ca


def main(pixels: int, surfaces: int) -> None:
    """Print a line for each surface, and the law."""
    chords, lengths = [], []
    for zeta, hurst, slope, part in product((8, 24, 64), (0.3, 0.8), (0.05, 0.2), (0.005, 0.03)):
        begin, side = time.process_time(), 0.4518 * pixels
        load = part * 35.3 * slope / 2.2 * side**2
        scene = {
            "name": "rough",
            "surface": {
                "kind": "self-affine",
                "pixels": pixels,
                "pixel_size": "0.4518 nm",
                "rms_slope": slope,
                "hurst": hurst,
                "zeta": zeta,
                "eta": 3,
            },
            "contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": f"{load} nN"},
        }
        found = ca.slip_length(ca.parse_scene(scene), surfaces=surfaces)
        length, chord, overlap = found.quantities()
        chords.append(chord.value)
        lengths.append(length.value)
        print(
            f"zeta {zeta} H {hurst} h' {slope} A/A0 {part}:",
            f"D_c {length.bare()} chord {chord.bare()} overlap {overlap.bare()} left {found.left:.2f}",
            f"{time.process_time() - begin:.0f} CPU s",
            flush=True,
        )
    ratio = np.array(lengths) / chords
    power, _ = np.polyfit(np.log(chords), np.log(lengths), 1)
    print(
        f"chords {min(chords):.2f} to {max(chords):.2f} nm; D_c ~ chord^{power:.2f};",
        f"ratio {ratio.mean():.2f} ± {ratio.std():.2f}",
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pixels", type=int, default=512)
    parser.add_argument("--surfaces", type=int, default=3)
    given = parser.parse_args()
    main(given.pixels, given.surfaces)
