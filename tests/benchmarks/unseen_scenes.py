"""Rough scenes of a wide range, drawn at random, on which promises are tested: number n is the same scene for ever.

Numbers below 1000 are for tuning (what is known before of errors and costs was measured on them), numbers from 1000 on
for tests, so that nothing is tested on what it was tuned on.
"""

from __future__ import annotations

import math

import numpy as np

import chemage as ca

#: an attempt on a bond that is faster than this many per second of hold makes a scene of hours
MOST_BREAKS = 300.0


def unseen(number: int) -> ca.Scene:
    """Scene ``number``: loads of 2 to 200 µN, rms slopes .03 to .3, H .5 to .9, with and without pressure in the
    barriers, interactions of 0 to .7 eV, 250 to 400 K, grids of 512² to 2500²."""
    rng = np.random.default_rng([20261122, number])
    pixels = int(rng.choice([512, 768, 1024, 1536, 2048, 2500]))
    size = 0.4518
    # 8 to 20 pixels per shortest wavelength
    zeta = round(pixels / float(rng.uniform(8.0, 20.0)), 1)
    slope = float(10 ** rng.uniform(math.log10(0.03), math.log10(0.3)))
    # A/A0 = 2.2 p/(E* slope) between .004 and .25, with loads of 2 to 200 µN
    modulus, area = 35.3, (pixels * size) ** 2
    low, high = (share * area * modulus * slope / 2.2 for share in (0.004, 0.25))
    low, high = max(low, 2e3), min(high, 2e5)
    load = float(np.exp(rng.uniform(math.log(low), math.log(max(high, 1.01 * low)))))
    temperature = float(rng.uniform(250.0, 400.0))
    strength = float(rng.choice([0.0, rng.uniform(0.05, 0.7)]))
    breaking = float(rng.choice([0.0, 1.1]))
    if 1e13 * math.exp(-breaking / (8.617e-5 * temperature)) * 1e4 > MOST_BREAKS:
        breaking = 0.0
    data: dict[str, object] = {
        "name": f"unseen-{number}",
        "surface": {
            "kind": "self-affine",
            "pixels": pixels,
            "pixel_size": size,
            "rms_slope": round(slope, 4),
            "hurst": round(float(rng.uniform(0.5, 0.9)), 2),
            "zeta": zeta,
            "eta": round(float(rng.uniform(1.0, 6.0)), 1),
            "seed": number,
        },
        "contact": {"kind": "fft-bem", "modulus": modulus, "load": float(f"{load:.4g}")},
        "forming": {"kind": "md-silica"},
        "chemistry": {
            "activation_volume": str(rng.choice(["0", "6.4"])) + " angstrom**3",
            "attempt_frequency": "1e13 Hz",
            "bond_force": "3 nN",
        },
        "engine": {"kind": "rejection-free"},
        "hold": {"temperature": round(temperature, 1), "start": 1e-3, "stop": 1e4, "replicas": 10, "seed": number},
    }
    if breaking:
        data["breaking"] = {"kind": "gaussian", "mean": breaking, "std": 0.02}
    if strength:
        data["interaction"] = {"kind": "elastic-pairs", "strength": round(strength, 3), "bias": 0.1}
    return ca.parse_scene(data, f"scene {number}")
