"""What is recovered from scans with the artefacts of a microscope, beside what SurfaceTopography makes of them.

    python tests/benchmarks/scans.py [CASES] [beta]       # 200: about a quarter of an hour; with beta two hours

Each case is a part of a self-affine surface (H .5 to .9, rms slope .03 to .6, roll-off between an eighth of the scan
and the scan, pixels of 1 to 10 nm), on a grid twice as fine, dilated by a paraboloid of 5 to 30 nm, sampled on 256² or
512² pixels, with white noise, 1/f noise in time, offsets between lines, bow, drift, tilt, spikes and scars. The section
`roughness` aligns and repairs it; H and the rms slope above the shortest trusted wavelength are compared with those of
the surface itself, with the tip's radius given and not.

SurfaceTopography gets the repaired scan, as it knows neither spikes nor scars, aligns lines, subtracts a curved trend
and takes the density of a Hann window down to its own limit of reliability for the tip; a straight line is fitted to
the logarithms, as it offers no fit.

With ``beta`` the true surface and `roughened` on the scan, both at half of the scan's pixels, are pressed at the same
load to an area of about 2 % and aged.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft as sfft

import chemage as ca
from chemage_surfaces.roughness_fit import fit_roughness
from chemage_surfaces.spectra import Binned

FINE = 2


def self_affine(n: int, side: float, hurst: float, slope: float, roll: float, rng: np.random.Generator) -> np.ndarray:
    """Periodic heights with the density max(q, 2π/roll)^(−2−2H) up to two pixels."""
    q = np.hypot(2 * np.pi * np.fft.fftfreq(n, side)[:, None], 2 * np.pi * np.fft.rfftfreq(n, side))
    amplitude = np.maximum(q, 2 * np.pi / roll) ** (-1 - hurst)
    amplitude[0, 0] = 0
    amplitude[q > np.pi / side] = 0
    spectrum: Any = sfft.rfft2(rng.standard_normal((n, n))) * amplitude
    weight = np.full(q.shape, 2.0)
    weight[:, 0] = weight[:, -1] = 1
    found = math.sqrt(float((np.abs(spectrum) ** 2 * weight * q**2).sum())) / n**2
    return np.asarray(sfft.irfft2(spectrum, s=(n, n))) * (slope / found)


def dilated(heights: np.ndarray, side: float, radius: float) -> np.ndarray:
    """The heights at which a paraboloid touches."""
    reach = min(int(math.sqrt(radius * np.ptp(heights)) / side + 1), 60)
    for axis in (0, 1):
        lowered = heights
        best = heights.copy()
        for k in range(1, reach + 1):
            lowered = heights - (k * side) ** 2 / (2 * radius)
            np.maximum(best, np.roll(lowered, k, axis), out=best)
            np.maximum(best, np.roll(lowered, -k, axis), out=best)
        heights = best
    return heights


def scan(case: int) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """What is true of a case, the surface on pixels half as large, and the scan; scan lines along the first index."""
    rng = np.random.default_rng([2018, case])

    def spread(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    hurst, side, n = rng.uniform(0.5, 0.9), spread(1, 10), int(rng.choice([256, 512]))
    slope, radius = spread(0.03, 0.6), spread(5, 30)
    roll = n * side / spread(1, 8)
    # twice the scan, so that it does not repeat
    whole = self_affine(2 * FINE * n, side / FINE, hurst, slope, roll, rng)
    true = whole[: n * FINE, : n * FINE]
    image = dilated(whole, side / FINE, radius)[: n * FINE : FINE, : n * FINE : FINE].copy()
    rms = float(image.std())
    image += spread(1e-3, 2e-2) * rms * rng.standard_normal((n, n))
    # line after line with a way back as long, 1/f in power
    frequency = np.fft.rfftfreq(2 * n * n)
    weight = np.concatenate([[0.0], frequency[1:] ** -0.5])
    series = np.fft.irfft(weight * np.fft.rfft(rng.standard_normal(2 * n * n))).reshape(n, 2 * n)[:, :n]
    image += spread(1e-3, 3e-2) * rms * series.T / series.std()
    image += spread(1e-2, 0.5) * rms * rng.standard_normal(n)
    x = (np.arange(n) - n / 2) / n
    bow, tilt_x, tilt_y, drift = rng.uniform(-1, 1, 4) * rms * np.array([12, 10, 10, 3])
    image += bow * x[:, None] ** 2 + tilt_x * x[:, None] + tilt_y * x + drift * (x + x**2)
    spikes = int(rng.integers(0, max(1, int(5e-4 * n * n))))
    where = rng.integers(0, n, (2, spikes))
    image[tuple(where)] += rng.choice([-1, 1], spikes) * rng.uniform(5, 30, spikes) * rms
    for _ in range(int(rng.integers(0, 6))):
        length = int(rng.integers(16, n // 3))
        i, j = int(rng.integers(0, n - length)), int(rng.integers(0, n))
        image[i : i + length, j] += rng.choice([-1, 1]) * rng.uniform(1, 5) * rms
    return {"hurst": hurst, "side": side, "radius": radius, "slope": slope, "roll": roll}, true, image


def slope_of(q: np.ndarray, density: np.ndarray, low: float, high: float) -> float:
    """rms slope of the waves from ``low`` to ``high``: h'² = ∫ C q³ dq/(2π)."""
    at = np.geomspace(low, high, 2000)
    values = np.exp(np.interp(np.log(at), np.log(q), np.log(density)))
    return math.sqrt(float(np.trapezoid(values * at**4, np.log(at))) / (2 * math.pi))


def by_chemage(truth: dict[str, float], maker: Any, true: Any, radius: float | None) -> dict[str, float]:
    fit = fit_roughness(maker.make(), tip_radius=radius)
    assert fit.data is not None
    low, high = float(fit.data.q[0]), float(fit.data.q[-1])
    q = np.geomspace(low, high, 500)
    roll = 0.0 if fit.roll_off is None else 2 * math.pi / fit.roll_off
    law = fit.density * (np.maximum(q, roll) / high) ** (-2 - 2 * fit.hurst)
    return {
        "hurst": fit.hurst - truth["hurst"],
        "error": fit.hurst_error,
        "slope": slope_of(q, law, low, high) / slope_of(true.q, true.density, low, high) - 1,
        "decades": math.log10(high / max(low, 2 * math.pi / truth["roll"])),
        "resolution": fit.resolution,
    }


def by_library(truth: dict[str, float], image: np.ndarray, true: Any) -> dict[str, float]:
    from SurfaceTopography import Topography

    side = truth["side"]
    tip = {
        "instrument": {
            "type": "microscope-based",
            "parameters": {"tip_radius": {"value": truth["radius"], "unit": "nm"}},
        }
    }
    topography: Any = Topography(image, tuple(side * n for n in image.shape), unit="nm", info=tip)
    topography = topography.scan_line_align().detrend("curvature")
    q, density = topography.power_spectrum_from_area(reliable=True)
    good = np.isfinite(density) & (density > 0) & (q > 2.5 * 2 * math.pi / (side * len(image)))
    q, density = q[good], density[good]
    inside = q > 1.5 * 2 * math.pi / truth["roll"]  # the roll-off is told to it
    power = np.polyfit(np.log(q[inside]), np.log(density[inside]), 1)[0]
    return {
        "hurst": -power / 2 - 1 - truth["hurst"],
        "slope": slope_of(q, density, q[0], q[-1]) / slope_of(true.q, true.density, q[0], q[-1]) - 1,
        "decades": math.log10(q[-1] / max(q[0], 2 * math.pi / truth["roll"])),
    }


def of_itself(truth: dict[str, float], true: Any, shortest: float) -> dict[str, float]:
    """What the same waves of the surface itself give: the limit of any scan."""
    data = true.part(0, 2 * math.pi / shortest)
    roll, _, law = data.rolled()
    low, high = float(data.q[0]), float(data.q[-1])
    q = np.geomspace(low, high, 500)
    fitted = law(np.maximum(q, roll or 0.0))
    return {
        "hurst": law.hurst - truth["hurst"],
        "slope": slope_of(q, fitted, low, high) / slope_of(data.q, data.density, low, high) - 1,
        "decades": math.log10(high / max(low, 2 * math.pi / truth["roll"])),
    }


def betas(truth: dict[str, float], maker: Any, true: Any) -> float:
    """β of the surface carried on from the scan, over that of the true one, less 1; means over four seeds."""
    scene = ca.load_scene("silica-rough")
    load = 0.01 * 35.3 * truth["slope"] * true.nominal_area
    times = ca.hold_times("10 s", "1e4 s", per_decade=4)

    def beta(surface: Any) -> float:
        contact = ca.solve_contact(scene.contact, surface, load)
        ageing = ca.age(contact, scene.chemistry, engine=scene.engine, hold_times=times, temperature=300.0, replicas=32)
        return ageing.fit("10 s", "1e4 s").beta

    rough = ca.surface(
        "roughened",
        surface=maker,
        pixel_size=truth["side"] / FINE,
        tip_radius=truth["radius"],
        fit_from=truth["side"] * max(maker.make().shape) / 4.3,
    )
    return float(np.mean([beta(rough.make(seed)) for seed in range(4)])) / beta(true) - 1


def main() -> None:
    warnings.simplefilter("ignore")
    cases = next((int(word) for word in sys.argv[1:] if word.isdigit()), 200)
    found: dict[str, list[dict[str, float]]] = {"radius given": [], "radius not given": [], "SurfaceTopography": []}
    found["the surface itself"] = []
    ratios = []
    for case in range(cases):
        began = time.process_time()
        truth, true, image = scan(case)
        surface = ca.Surface(heights=true, pixel_size=truth["side"] / FINE, periodic=False)
        density = Binned.of(surface)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scan.npy"
            np.save(path, image)
            options = {"lines": "differences", "scars": "interpolate", "spikes": "interpolate", "detrend": "quadratic"}
            maker = ca.surface("measured", path=str(path), height_unit="nm", pixel_size=truth["side"], **options)
            for name, radius in (("radius given", truth["radius"]), ("radius not given", None)):
                try:
                    found[name].append(by_chemage(truth, maker, density, radius))
                except ca.InputError as error:
                    print(case, name, error, flush=True)
                else:
                    if radius is not None:
                        shortest = found[name][-1]["resolution"]
                        found["the surface itself"].append(of_itself(truth, density, shortest))
            try:
                found["SurfaceTopography"].append(by_library(truth, maker.make().heights, density))
            except Exception as error:  # what it cannot do is counted
                print(case, "SurfaceTopography", type(error).__name__, error, flush=True)
            if "beta" in sys.argv:
                try:
                    ratios.append(betas(truth, maker, surface))
                    print(case, f"beta {ratios[-1]:+.3f}", flush=True)
                except ca.InputError as error:
                    print(case, "beta", error, flush=True)
        last = " ".join(f"{name}: {rows[-1]['hurst']:+.3f}" for name, rows in found.items() if rows)
        print(case, last, f"{time.process_time() - began:.1f} s", flush=True)
    for name, rows in found.items():
        for least in (0.0, 1.0):
            part = [row for row in rows if row["decades"] >= least]
            if not part:
                continue
            hurst, slope = (np.abs([row[key] for row in part]) for key in ("hurst", "slope"))
            line = f"{name}, at least {least:g} decades: {len(part)} of {cases}; slope within 10 % in "
            line += f"{np.mean(slope < 0.1):.1%}, H within .05 in {np.mean(hurst < 0.05):.1%}, mean error of H "
            line += f"{np.mean([row['hurst'] for row in part]):+.3f}, rms {np.sqrt(np.mean(hurst**2)):.3f}"
            if "error" in part[0]:
                inside = hurst < 1.645 * np.array([row["error"] for row in part])
                line += f"; 90 % intervals hold in {np.mean(inside):.1%}"
            print(line)
    if ratios:
        print(
            f"beta within 5 % in {np.mean(np.abs(ratios) < 0.05):.1%} of {len(ratios)}, median {np.median(ratios):+.3f}"
        )


if __name__ == "__main__":
    main()
