"""How much β differs between self-affine surfaces of other seeds, and the law by which it is estimated.

    python tests/benchmarks/surface_scatter.py              # the law against the measurements in two CSV files
    python tests/benchmarks/surface_scatter.py --measure    # surface_scatter.csv again: about fifteen minutes
    python tests/benchmarks/surface_scatter.py --scenes     # unseen_scatter.csv again: about fifteen minutes

Of each setting in ``surface_scatter.csv``, 24 surfaces (seeds 1 to 24) are pressed and aged with six replicas each;
the standard deviation of β between surfaces is corrected for that of the means over replicas. ``unseen_scatter.csv``
has the scenes 0 to 27 and some from 1000 on of ``unseen_scenes.py`` with surfaces of their own and one replica each, on
their cheapest grid, and the standard deviation of the friction drop at 1000 s as well. With 24 or 32 surfaces a
standard deviation has an error of 15 or 13 %.

With r = ζ/η the law c η^(−1) (A/A0)^(−1/2) r^(a + b H) is fitted to the rows ``fit`` and to the scenes below 1000, and
compared with the others.
"""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path

import numpy as np
from unseen_scenes import unseen

import chemage as ca
from chemage.contacts.solution import MEASURES
from chemage.studies.ensembles.computations import computations, seed_of
from chemage.studies.ensembles.quantities import Quantities

FILE = Path(__file__).with_name("surface_scatter.csv")
SCENES = Path(__file__).with_name("unseen_scatter.csv")
SETTING = ("pixels", "zeta", "eta", "hurst", "rms_slope", "pressure", "strength", "activation_volume")
SURFACES, REPLICAS = 24, 6
NUMBERS, OWN_SURFACES = (*range(28), *range(1000, 1009)), 32


def rows(file: Path = FILE) -> list[dict[str, str]]:
    """The measurements: a setting (pressure in MPa, energy in eV, volume in nm³) or scene, and what was found."""
    with file.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


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
        ageing = ca.age(contact, silica, engine=engine, hold_times=times, temperature=300.0, replicas=REPLICAS)
        fit = ageing.fit("10 s", "1e4 s")
        found.append((contact.area_fraction, contact.patches, fit.beta, fit.beta_stderr))
    area, patches, beta, noise = np.array(found).T
    between = max(0.0, float(beta.var(ddof=1) - np.mean(noise**2)))
    return {"area": area.mean(), "patches": patches.mean(), "beta": beta.mean(), "scatter": between**0.5 / beta.mean()}


def measure() -> None:
    """Print the table of the settings again."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow([*SETTING, "area", "patches", "beta", "scatter", "use"])
    for row in rows():
        found = measured({name: float(row[name]) for name in SETTING})
        writer.writerow([*(row[name] for name in SETTING), *(f"{value:.4g}" for value in found.values()), row["use"]])
        sys.stdout.flush()


def measure_scenes() -> None:
    """Print the table of the scenes again."""
    print("number,zeta,eta,hurst,surfaces,area,patches,scatter,drop_scatter")
    for number in NUMBERS:
        scene = unseen(number).completed()
        assert scene.hold is not None
        with scene.in_use():
            cheapest, quantities = computations(scene)[0], Quantities.of(scene, tuple(MEASURES))
            count = max(8, min(OWN_SURFACES, round(40 / cheapest.seconds)))
            seeds = [(seed_of(scene.surface_seed, 0, k, 0), seed_of(scene.hold.seed, 0, k, 1)) for k in range(count)]
            found = np.array([quantities.row(cheapest.compute(*pair)) for pair in seeds])
        names = (("area_fraction", None), ("patches", None), ("beta", None), ("friction_drop", 1e3))
        area, patches, beta, drop = (found[:, quantities.column(*name)] for name in names)
        scatter, of_drop = (one.std(ddof=1) / one.mean() for one in (beta, drop))
        spectrum = ",".join(f"{getattr(scene.surface, name):g}" for name in ("zeta", "eta", "hurst"))
        print(
            f"{number},{spectrum},{count},{area.mean():.4g},{patches.mean():.4g},{scatter:.4g},{of_drop:.4g}",
            flush=True,
        )


def table() -> dict[str, np.ndarray]:
    """All measurements: A/A0, ζ, η, H, scatter, and whether the law is fitted to them."""
    found = []
    for row in (*rows(), *rows(SCENES)):
        numbers = [float(row[name]) for name in ("area", "zeta", "eta", "hurst", "scatter")]
        found.append([*numbers, float(row["use"] == "fit" if "use" in row else int(row["number"]) < 1000)])
    names = ("area", "zeta", "eta", "hurst", "scatter", "fit")
    return dict(zip(names, np.array(found).T, strict=True))


def fitted(name: str, found: np.ndarray, terms: list[np.ndarray], fit: np.ndarray) -> None:
    """Fit the logarithm of ``found`` as a sum of ``terms`` to the rows ``fit``, and print it."""
    design = np.column_stack([np.ones(found.size), *terms])
    numbers, *_ = np.linalg.lstsq(design[fit], np.log(found[fit]), rcond=None)
    away = np.exp(np.log(found) - design @ numbers)
    print(f"{name}: c = {math.exp(numbers[0]):.3g}, exponents {', '.join(f'{value:.3f}' for value in numbers[1:])}")
    for use, which in (("fit", fit), ("check", ~fit)):
        ratio = away[which]
        spread = math.exp(np.log(ratio).std())
        print(
            f"  {use}: {which.sum()}, measured over estimated {ratio.min():.2f} to {ratio.max():.2f}, rms {spread:.2f}"
        )


def main() -> None:
    of = table()
    fit, ratio = of["fit"] > 0, np.log(of["zeta"] / of["eta"])
    fitted("scatter of β", of["scatter"] * of["eta"] * np.sqrt(of["area"]), [ratio, of["hurst"] * ratio], fit)


if __name__ == "__main__":
    if "--measure" in sys.argv:
        measure()
    elif "--scenes" in sys.argv:
        measure_scenes()
    else:
        main()
