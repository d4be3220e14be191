"""How much β differs between self-affine surfaces of other seeds, and the law by which it is estimated.

    python tests/benchmarks/surface_scatter.py              # the law against surface_scatter.csv
    python tests/benchmarks/surface_scatter.py --measure    # the measurements again, as CSV: about fifteen minutes

For each setting, 24 surfaces (seeds 1 to 24) are pressed and aged with six replicas each; the standard deviation of β
between surfaces is corrected for that of the means over replicas. With 24 surfaces it has an error of 15 %. The law
c N_p^(−1/2) (A/A0)^(−1/4) is fitted to the rows ``fit``, and compared with the rows ``check`` as well.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

import chemage as ca

FILE = Path(__file__).with_name("surface_scatter.csv")
SETTING = ("pixels", "zeta", "eta", "hurst", "rms_slope", "pressure", "strength", "activation_volume")
SURFACES, REPLICAS = 24, 6


def rows() -> list[dict[str, str]]:
    """The measurements: a setting (pressure in MPa, energy in eV, volume in nm³) and what was found."""
    with FILE.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def law(patches: float, area: float) -> float:
    """The law without its constant."""
    return patches**-0.5 * area**-0.25


def measured(setting: dict[str, float]) -> dict[str, float]:
    """A/A0 and patches (means), β, and its relative standard deviation between surfaces."""
    pixels = int(setting["pixels"])
    maker = ca.surface(
        "self-affine",
        pixels=pixels,
        pixel_size="0.4518 nm",
        **{name: setting[name] for name in ("zeta", "eta", "hurst", "rms_slope")},
    )
    silica = ca.chemistry(
        forming=ca.barriers("md-silica"),
        breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
        interaction=ca.interaction("elastic-pairs", strength=setting["strength"], bias=0.1),
        activation_volume=setting["activation_volume"],
    )
    times = ca.hold_times("1 s", "1e4 s", per_decade=4)
    found = []
    for seed in range(1, SURFACES + 1):
        load = 1e-3 * setting["pressure"] * (pixels * 0.4518) ** 2
        contact = ca.contact("fft-bem", modulus="35.3 GPa").solve(maker.make(seed), load)
        engine = ca.engine("rejection-free")
        aging = ca.age(contact, silica, engine=engine, hold_times=times, temperature=300.0, replicas=REPLICAS)
        fit = aging.fit("10 s", "1e4 s")
        found.append((contact.area_fraction, contact.patches, fit.beta, fit.beta_stderr))
    area, patches, beta, noise = np.array(found).T
    between = max(0.0, float(beta.var(ddof=1) - np.mean(noise**2)))
    return {"area": area.mean(), "patches": patches.mean(), "beta": beta.mean(), "scatter": between**0.5 / beta.mean()}


def measure() -> None:
    """Print the table again."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow([*SETTING, "area", "patches", "beta", "scatter", "use"])
    for row in rows():
        found = measured({name: float(row[name]) for name in SETTING})
        writer.writerow([*(row[name] for name in SETTING), *(f"{value:.4g}" for value in found.values()), row["use"]])
        sys.stdout.flush()


def main() -> None:
    ratio = {"fit": [], "check": []}
    for row in rows():
        ratio[row["use"]].append(float(row["scatter"]) / law(float(row["patches"]), float(row["area"])))
    constant = float(np.exp(np.mean(np.log(ratio["fit"]))))
    print(f"β scatters by {constant:.3f} N_p^(-1/2) (A/A0)^(-1/4)")
    for use, found in ratio.items():
        away = np.array(found) / constant
        print(f"  {use}: {len(found)} settings, measured over estimated {away.min():.2f} to {away.max():.2f}")


if __name__ == "__main__":
    if "--measure" in sys.argv:
        measure()
    else:
        main()
