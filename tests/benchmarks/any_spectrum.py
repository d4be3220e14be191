"""Whether the intervals of `roughened` hold the slope and the β of surfaces that are not self-affine.

    python tests/benchmarks/any_spectrum.py [CASES] [beta]       # 60: about ten minutes; with beta an hour and a half
    python tests/benchmarks/any_spectrum.py --first 30 30        # the cases from 30 on
    python tests/benchmarks/any_spectrum.py --table FILE...      # the table from rows measured before

Each case is one of five families in turn: two power laws with a knee anywhere between roll-off and cut-off (also where
the image does not show it; H .3 to 1.2), an elliptic spectrum (ratio 2 to 6), a grating, terraces, and grooves of
random depth and width, the last three with self-affine roughness. All have random directions, rms slopes of .05 to .5
and no waves shorter than four fine pixels, which are a third of the image's. Images have 128² to 192² pixels of 1.5 to
5 nm, dilated by a paraboloid of 2 to 20 nm, with white noise of .03 to .1 nm. They are read by `measured` and carried
on to the fine pixels and the true cut-off by ten members of `roughened`, each with a seed, with the radius of the tip
given and not.

The truth is the surface itself below the image. The 90 % interval of its rms slope is that of the provenance; that of β
is Student's prediction interval of ln β from the members, with the contact `fft-bem` at the load that gives the true
surface 2 % of area. Rows are printed as CSV.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scans import dilated
from scipy import fft as sfft
from scipy import ndimage, stats

import chemage as ca

Rows = list[dict[str, Any]]
Rng = np.random.Generator
#: fine pixels per pixel of the image, and per shortest wavelength; side of the true surface to that of the image
FINE, SHORTEST, LARGER = 3, 4, 1.3
#: seeds of a case; share of the area that touches
SEEDS, AREA = 10, 0.02
FIELDS = (
    *("case", "family", "tip", "truth_slope", "slope", "slope_low", "slope_high"),
    *("truth_beta", "truth_error", "beta", "beta_low", "beta_high", "refused"),
)


def spread(rng: Rng, low: float, high: float) -> float:
    """A number with a uniform logarithm."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def drawn(rng: Rng, n: int, density: Callable[[Any, Any], Any]) -> np.ndarray:
    """Periodic Gaussian heights on n² pixels of edge 1, with this density of (qx, qy) down to the shortest waves."""
    qx, qy = 2 * np.pi * np.fft.fftfreq(n)[:, None], 2 * np.pi * np.fft.rfftfreq(n)
    with np.errstate(divide="ignore"):
        amplitude = np.sqrt(density(qx, qy))
    amplitude[0, 0] = 0
    amplitude[np.hypot(qx, qy) > 2 * np.pi / SHORTEST] = 0
    spectrum: Any = sfft.rfft2(rng.standard_normal((n, n)))
    return np.asarray(sfft.irfft2(spectrum * amplitude, s=(n, n)))


def self_affine(rng: Rng, n: int, image: int, ratio: float = 1.0) -> np.ndarray:
    """Power law with H .4 to 1 and a roll-off; with ``ratio`` wavelengths differ by this between two directions."""
    hurst, roll, angle = rng.uniform(0.4, 1.0), 2 * math.pi * spread(rng, 1, 8) / image, rng.uniform(0, math.pi)

    def density(qx: Any, qy: Any) -> Any:
        along, across = (qx * math.cos(angle + turn) + qy * math.sin(angle + turn) for turn in (0, math.pi / 2))
        return np.maximum(np.hypot(along * ratio**0.5, across / ratio**0.5), roll) ** (-2 - 2 * hurst)

    return drawn(rng, n, density)


def two_slopes(rng: Rng, n: int, image: int) -> np.ndarray:
    roll = 2 * math.pi * spread(rng, 1, 8) / image
    knee = spread(rng, roll, 2 * math.pi / SHORTEST)
    h1, h2 = rng.uniform(0.3, 1.2, 2)

    def density(qx: Any, qy: Any) -> Any:
        q = np.maximum(np.hypot(qx, qy), roll)
        return np.minimum(q, knee) ** (-2 - 2 * h1) * (np.maximum(q, knee) / knee) ** (-2 - 2 * h2)

    return drawn(rng, n, density)


def anisotropic(rng: Rng, n: int, image: int) -> np.ndarray:
    return self_affine(rng, n, image, ratio=rng.uniform(2, 6))


def mixed(rng: Rng, n: int, image: int, structure: np.ndarray) -> np.ndarray:
    """The structure with roughness that has a tenth to nine tenths of the mean square slope."""
    rough = self_affine(rng, n, image)
    share = rng.uniform(0.1, 0.9)
    return math.sqrt(1 - share) * structure / slope_of(structure) + math.sqrt(share) * rough / slope_of(rough)


def across(rng: Rng, n: int) -> np.ndarray:
    """The coordinate along a random direction, pixels."""
    angle, x = rng.uniform(0, math.pi), np.arange(float(n)) - n / 2
    return x[:, None] * math.cos(angle) + x * math.sin(angle)


def grating(rng: Rng, n: int, image: int) -> np.ndarray:
    """Trapezoids of a random period, width and steepness, by their Fourier series."""
    period, width, edge = spread(rng, 24, image / 4), rng.uniform(0.25, 0.75), rng.uniform(0.05, 0.25)
    at, heights = across(rng, n), np.zeros((n, n))
    for k in range(1, int(period / SHORTEST) + 1):
        heights += np.sinc(k * width) * width * np.sinc(k * edge) * np.cos(2 * math.pi * k * at / period)
    return mixed(rng, n, image, heights)


def terraces(rng: Rng, n: int, image: int) -> np.ndarray:
    """Steps of one height on a slope, less their mean plane, or around hills; both meander."""
    hills = drawn(rng, n, lambda qx, qy: np.exp(-((np.hypot(qx, qy) * image / spread(rng, 12, 40)) ** 2)))
    levels = hills / hills.std() * rng.uniform(0.8, 2.0)
    steps, angle, x = rng.choice([0, 1]) * rng.uniform(4, 14), rng.uniform(0, math.pi), np.arange(n) / n
    plane = round(steps * math.cos(angle)) * x[:, None] + round(steps * math.sin(angle)) * x
    heights = np.floor(levels + plane) - plane
    # edges as wide as the shortest waves
    spectrum: Any = sfft.rfft2(ndimage.gaussian_filter(heights, 1.0, mode="wrap"))
    spectrum[np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)) > 1 / SHORTEST] = 0
    return mixed(rng, n, image, np.asarray(sfft.irfft2(spectrum, s=(n, n))))


def ground(rng: Rng, n: int, image: int) -> np.ndarray:
    """Grooves of random place, depth and width along one direction."""
    x, profile = np.arange(float(long := 2 * n)), np.zeros(2 * n)
    for _ in range(int(rng.uniform(0.02, 0.08) * long)):
        width = spread(rng, 4, image / 8)
        away = np.abs(x - rng.uniform(0, long)) / width
        profile -= width * spread(rng, 0.1, 1) * np.maximum(0.0, 1 - away ** rng.uniform(1, 2))
    spectrum = np.fft.rfft(profile - profile.mean())
    spectrum[np.fft.rfftfreq(long) > 1 / SHORTEST] = 0
    finer = 16 * np.fft.irfft(spectrum, 16 * long)
    heights = np.interp(across(rng, n) + long / 2, np.arange(16 * long) / 16, finer)
    return mixed(rng, n, image, heights)


FAMILIES = (two_slopes, anisotropic, grating, terraces, ground)


def slope_of(heights: np.ndarray) -> float:
    return ca.Surface(heights=heights, pixel_size=1.0, periodic=False).rms_slope


def case_of(case: int) -> tuple[dict[str, float], ca.Surface, np.ndarray]:
    """Pixel of the image, radius of the tip; the true surface below the image; and the image."""
    rng = np.random.default_rng([2027, case])
    n, side = int(rng.integers(128, 193)), spread(rng, 1.5, 5)
    slope, radius, noise = spread(rng, 0.05, 0.5), spread(rng, 2, 20), spread(rng, 0.03, 0.1)
    size: Any = sfft.next_fast_len(int(LARGER * FINE * n))
    whole = FAMILIES[case % len(FAMILIES)](rng, size, FINE * n)
    start = (len(whole) - FINE * n) // 2
    part = slice(start, start + FINE * n)
    whole *= slope * side / FINE / slope_of(whole[part, part])
    image = dilated(whole, side / FINE, radius)[part, part][FINE // 2 :: FINE, FINE // 2 :: FINE]
    image = image + noise * rng.standard_normal(image.shape)
    true = ca.Surface(heights=whole[part, part], pixel_size=side / FINE, periodic=False)
    return {"side": side, "radius": radius}, true, image


def aged(surface: ca.Surface, load: float) -> Any:
    """The fit of β."""
    scene: Any = ca.load_scene("silica-rough")
    times = ca.hold_times("10 s", "1e4 s", per_decade=4)
    contact = ca.solve_contact(scene.contact, surface, load)
    ageing = ca.age(contact, scene.chemistry, engine=scene.engine, hold_times=times, temperature=300.0, replicas=8)
    return ageing.fit("10 s", "1e4 s")


def predicted(values: Sequence[float]) -> tuple[float, float, float]:
    """The middle of positive ``values``, and a 90 % prediction interval of one more, from their logarithms."""
    logs = np.log(values)
    reach = stats.t.ppf(0.95, len(logs) - 1) * logs.std(ddof=1) * math.sqrt(1 + 1 / len(logs))
    low, middle, high = np.exp(logs.mean() + reach * np.array([-1, 0, 1]))
    return float(middle), float(low), float(high)


def rows(case: int, beta: bool) -> Rows:
    """The intervals of a case, with the radius of the tip given and not; β only where it is given."""
    truth, true, image = case_of(case)
    found: Rows = []
    load, known = 0.0, {}
    if beta:
        load = 0.5 * AREA * 35.3 * true.rms_slope * true.nominal_area
        contact = ca.solve_contact(ca.load_scene("silica-rough").contact, true, load)
        load *= AREA / contact.area_fraction
        fit = aged(true, load)
        known = {"truth_beta": fit.beta, "truth_error": fit.beta_stderr}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.npy"
        np.save(path, image)
        scan = ca.surface("measured", path=str(path), height_unit="nm", pixel_size=truth["side"])
        for tip, radius in (("given", truth["radius"]), ("not given", None)):
            row = {"case": case, "family": FAMILIES[case % len(FAMILIES)].__name__, "tip": tip}
            found.append(row)
            row["truth_slope"], side = true.rms_slope, truth["side"] / FINE
            options = {"pixel_size": side, "cutoff": SHORTEST * side, "tip_radius": radius}
            try:
                rough: Any = ca.surface("roughened", surface=scan, **options)
                record: Any = rough.make(0).provenance["roughened"]
            except ca.InputError as error:
                row["refused"] = str(error).replace(folder, "").lstrip("/")
                continue
            row["slope"], (row["slope_low"], row["slope_high"]) = record["rms_slope"], record["rms_slope_interval"]
            if beta and radius is not None:
                row |= known
                made = [maker.make(seed) for seed, maker in enumerate(rough.members(SEEDS))]
                row["beta"], row["beta_low"], row["beta_high"] = predicted([aged(one, load).beta for one in made])
    return found


def table(found: Rows) -> str:
    """By family: intervals that hold, their median width, the median of best over truth, and refusals."""
    warnings.simplefilter("ignore")
    lines = ["tip        family        slope holds  high/low  best/truth  β holds  high/low  best/truth  refused"]
    for tip in ("given", "not given"):
        for family in (*(one.__name__ for one in FAMILIES), "all"):
            mine = [row for row in found if row["tip"] == tip and family in (row["family"], "all")]
            line = f"{tip:<10} {family:<12}"
            for name in ("slope", "beta"):
                keys = (f"truth_{name}", name, f"{name}_low", f"{name}_high")
                values = np.array([[float(row[key]) for key in keys] for row in mine if row.get(name)]).reshape(-1, 4)
                true, best, low, high = values.T
                inside = int(((low <= true) & (true <= high)).sum())
                line += f"  {inside:>3} of {len(true):<3} {np.median(high / low):9.3g} {np.median(best / true):9.3g} "
            lines.append(f"{line} {sum(bool(row.get('refused')) for row in mine):>6}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", metavar="CASES or beta")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--table", nargs="+", type=Path)
    options = parser.parse_args()
    if options.table:
        lines = (path.read_text(encoding="utf-8").splitlines() for path in options.table)
        print(table([row for one in lines for row in csv.DictReader(one)]))
        return
    warnings.simplefilter("ignore")
    found: Rows = []
    writer = csv.DictWriter(sys.stdout, FIELDS)
    writer.writeheader()
    cases = next((int(word) for word in options.words if word.isdigit()), 60)
    for case in range(options.first, options.first + cases):
        found += (new := rows(case, "beta" in options.words))
        for row in new:
            writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
        sys.stdout.flush()
    print(table(found), file=sys.stderr)


if __name__ == "__main__":
    main()
