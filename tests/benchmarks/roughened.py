"""Whether a measured image, carried on to the site spacing, gives the contact and the ageing of the surface itself.

    python tests/benchmarks/roughened.py                  # ten surfaces: about a minute
    python tests/benchmarks/roughened.py --seeds 1 2      # some of them
    python tests/benchmarks/roughened.py --table FILE     # the table from rows measured before (CSV, as printed)

Each surface of the scene silica-rough is low-passed and sampled on pixels 10 and 25 times larger (4.5 and 11.3 nm):
these are the "measured" images. The surface maker ``roughened`` carries each on to the site spacing with its true Hurst
exponent and its short cut-off; the amplitude is fitted to the image. Printed as CSV: κ, with the area corrected for
pixels too, β, and the rms slope of the original and of the two others. The table has mean and standard deviation
between surfaces.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

import chemage as ca

FACTORS = (10, 25)
FIELDS = ("seed", "image_nm", "rms_slope", "area_fraction", "kappa", "kappa_corrected", "patches", "beta", "stderr")


def image(heights: np.ndarray, factor: int) -> np.ndarray:
    """The heights on pixels ``factor`` times larger: waves shorter than two of them are cut off, isotropically."""
    nx, ny = (count // factor for count in heights.shape)
    spectrum = np.fft.fft2(heights)
    kx, ky = (np.rint(np.fft.fftfreq(count) * count).astype(int) for count in (nx, ny))
    few = spectrum[np.ix_(kx % heights.shape[0], ky % heights.shape[1])] / factor**2
    few[np.hypot(kx[:, None] / nx, ky / ny) >= 0.5 * (1 - 1e-9)] = 0.0
    return np.fft.ifft2(few).real


def measured(scene: ca.Scene, surface: ca.Surface) -> dict[str, float]:
    """Contact and ageing of ``surface`` at the load and the chemistry of ``scene``."""
    contact = ca.solve_contact(scene.contact, surface, scene.load)
    times = ca.hold_times("10 s", "1e4 s", per_decade=4)
    ageing = ca.age(contact, scene.chemistry, engine=scene.engine, hold_times=times, temperature=300.0, replicas=10)
    fit = ageing.fit("10 s", "1e4 s")
    return {
        "rms_slope": surface.rms_slope,
        "area_fraction": contact.area_fraction,
        "kappa": contact.kappa,
        "kappa_corrected": contact.kappa * contact.corrected_area / contact.area,
        "patches": contact.patches,
        "beta": fit.beta,
        "stderr": fit.beta_stderr,
    }


def rows(seed: int) -> list[dict[str, float]]:
    """The original of ``seed``, and what is carried on from its images."""
    scene = ca.load_scene("silica-rough")
    maker = scene.surface
    original = maker.make(seed)
    found = [{"seed": seed, "image_nm": 0.0, **measured(scene, original)}]
    for factor in FACTORS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "image.npy"
            np.save(path, image(original.heights, factor))
            side = factor * original.pixel_size
            rough = ca.surface(
                "roughened",
                surface={
                    "kind": "measured",
                    "path": str(path),
                    "height_unit": "nm",
                    "pixel_size": side,
                    "periodic": True,
                },
                pixel_size=original.pixel_size,
                hurst=maker.hurst,
                cutoff=maker.expected()["shortest_wavelength"],
            ).make(1000 + seed)
        found.append({"seed": seed, "image_nm": round(side, 4), **measured(scene, rough)})
    return found


def table(found: list[dict[str, float]]) -> str:
    """Mean and standard deviation between surfaces, and the mean difference of pairs with its standard error."""
    lines = [
        "| surface | n | rms slope | κ | κ, corrected area | N_p | β | β less that of the original |",
        "| --- " * 8 + "|",
    ]
    sizes = sorted({row["image_nm"] for row in found})
    first = {row["seed"]: row for row in found if row["image_nm"] == 0}
    for size in sizes:
        mine = [row for row in found if row["image_nm"] == size]
        name = "original" if size == 0 else f"from an image at {size:.1f} nm"
        cells = [name, str(len(mine))]
        for field in ("rms_slope", "kappa", "kappa_corrected", "patches", "beta"):
            values = np.array([row[field] for row in mine])
            cells.append(f"{values.mean():.4g} ± {values.std(ddof=1):.2g}")
        apart = np.array([row["beta"] - first[row["seed"]]["beta"] for row in mine])
        error = apart.std(ddof=1) / len(mine) ** 0.5
        cells.append("" if size == 0 else f"{apart.mean():+.3f} ± {error:.3f}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=range(1, 11))
    parser.add_argument("--table", type=Path)
    options = parser.parse_args()
    if options.table is not None:
        with options.table.open(encoding="utf-8") as stream:
            print(table([{name: float(value) for name, value in row.items()} for row in csv.DictReader(stream)]))
        return
    writer = csv.DictWriter(sys.stdout, FIELDS)
    writer.writeheader()
    found = []
    for seed in options.seeds:
        for row in rows(seed):
            writer.writerow({name: f"{value:.6g}" for name, value in row.items()})
            sys.stdout.flush()
            found.append(row)
    if len(options.seeds) > 1:
        print(table(found), file=sys.stderr)


if __name__ == "__main__":
    main()
