"""Stated against true errors of methods of ageing on random scenes of 10 to some 10⁴ sites.

Tips and rough surfaces of random size, slope, Hurst exponent, spectrum and load, with a random chemistry and
temperature. The truth is the kinetics of every site with the exact engine ``next-reaction``, beside the same sites
without interaction with the same barriers and noise, whose bonds are known by a quadrature of their own (a control
variate); small contacts are simulated side by side, apart from each other. Constants were chosen on other contacts and
on scenes of the seeds ``TUNING``; those of ``VALIDATION`` were used for nothing.

With ``--wide`` the temperatures are 50 to 600 K, the pressures up to 20 GPa, and barriers, couplings and attempt
frequencies of all sizes with which ten bonds at least are there in the end. Contacts and those of the tables are small,
tables have the hold times that are asked for alone, and the kinetics of every site stop where their own error, which is
counted, is half of the stated one. Without interaction the same contacts are compared with the quadrature alone.

``python tests/benchmarks/closure_errors.py FILE`` appends a line per scene to FILE, and resumes an interrupted run;
``--table`` prints the coverage. Another method is measured by its own function beside ``closure``.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import chemage as ca
from chemage.ageing.ageing import beta_parts
from chemage.plugin import random, statistics
from chemage_ageing import _table

TUNING, VALIDATION = (1000, 2000), 3000
TIMES = 10.0 ** np.arange(-4, 6)
#: hold times of β
WINDOW = slice(5, 9)
MODULUS, PIXEL = 35.3, 0.4518
#: contacts of one chemistry, whose table they share
CONTACTS, WIDE_CONTACTS = 12, 4
#: pixels and most sites of rough contacts and tips of ``--wide``, and sites along a side of the contacts of its tables
WIDE_PIXELS, WIDE_SITES, WIDE_SIDE = (64, 128), 3000, 64
#: relative standard error of the kinetics that is aimed at, at each hold time; seconds of a scene; fewest replicas
NOISE, SECONDS, FEWEST = 0.004, 1.0, 8
#: sites that are simulated side by side, where a contact has fewer
TILED = 3000


class Scene(NamedTuple):
    """One contact with its chemistry."""

    name: str
    contact: ca.ContactSolution
    chemistry: ca.Chemistry
    #: K
    temperature: float


class Truth(NamedTuple):
    """Bonds of every site's kinetics."""

    #: (m,) mean, and its standard error
    bonds: np.ndarray
    noise: np.ndarray
    #: of the slope per decade over :data:`WINDOW`
    slope: float
    slope_noise: float
    replicas: int


def chemistry(rng: np.random.Generator) -> tuple[ca.Chemistry, float]:
    """A random chemistry and temperature (K)."""
    forming: Any = ca.barriers("md-silica")
    if rng.random() < 0.3:
        forming = ca.barriers("gaussian", mean=rng.uniform(0.9, 1.1), std=rng.uniform(0.05, 0.12))
    temperature = float(rng.uniform(250, 400))
    # bonds break up to ten times until the last hold time
    breaks = 10 ** rng.uniform(-3, 1)
    return ca.chemistry(
        forming=forming,
        breaking=ca.barriers(
            "gaussian", mean=ca.plugin.KB * temperature * math.log(1e13 * TIMES[-1] / breaks), std=0.02
        ),
        interaction=ca.interaction("elastic-pairs", strength=10 ** rng.uniform(-1.3, -0.2), bias=0.1),
        activation_volume=rng.uniform(0.0, 0.008),
    ), temperature


def wide_chemistry(rng: np.random.Generator) -> tuple[ca.Chemistry, float]:
    """A random chemistry and temperature (K) of ``--wide``."""
    temperature, frequency = float(rng.uniform(50, 600)), float(10 ** rng.uniform(11, 14))
    volume = rng.uniform(0.0, 0.008)
    reached = ca.plugin.KB * temperature * math.log(frequency * TIMES[-1])
    lowered = 20 * volume * ca.plugin.EV_PER_GPA_NM3
    middle, width = reached * rng.uniform(0.6, 1.3) + lowered * rng.uniform(0.0, 1.0), rng.uniform(0.02, 0.3)
    kind = rng.integers(3)
    forming: Any = ca.barriers("md-silica")
    if kind == 1:
        forming = ca.barriers("gaussian", mean=middle, std=width / 3)
    if kind == 2:
        forming = ca.barriers("uniform", lower=max(middle - width, 0.0), upper=middle + width)
    breaks = 10 ** rng.uniform(-3, 1)
    mean = ca.plugin.KB * temperature * math.log(frequency * TIMES[-1] / breaks)
    return ca.chemistry(
        forming=forming,
        breaking=ca.barriers("gaussian", mean=mean, std=0.02) if rng.random() < 0.5 else None,
        interaction=ca.interaction("elastic-pairs", strength=10 ** rng.uniform(-1.3, -0.2), bias=0.1),
        activation_volume=volume,
        attempt_frequency=frequency,
    ), temperature


def tip(rng: np.random.Generator, most: float = 1e4) -> ca.ContactSolution:
    """A Hertz contact of 10 to ``most`` sites."""
    sites, radius = 10 ** rng.uniform(1.0, math.log10(most)), 10 ** rng.uniform(0.4, 2.3)
    edge = PIXEL * math.sqrt(sites / math.pi)
    radius = max(radius, 1.3 * edge)  # below 15 GPa
    load = 4 * MODULUS * edge**3 / (3 * radius)
    surface = ca.surface("sphere", radius=radius, pixels=2 * math.ceil(1.3 * edge / PIXEL) + 6, pixel_size=PIXEL)
    return ca.contact("hertz", modulus=MODULUS).solve(surface.make(), load)


def rough(rng: np.random.Generator, sizes: tuple[int, ...] = (128, 256, 512)) -> ca.ContactSolution:
    """A solved contact of a self-affine surface."""
    shares = [0.4, 0.4, 0.2] if len(sizes) == 3 else None
    pixels = int(rng.choice(sizes, p=shares))
    slope = 10 ** rng.uniform(-1.5, -0.7)
    zeta = pixels / 10 ** rng.uniform(math.log10(2.05), math.log10(20))
    options = {"pixels": pixels, "pixel_size": PIXEL, "rms_slope": slope, "hurst": rng.uniform(0.2, 0.9)}
    surface = ca.surface("self-affine", zeta=zeta, eta=min(3.0, zeta), **options).make(int(rng.integers(2**31)))
    fraction = 10 ** rng.uniform(-2.5, -0.7)
    load = fraction * slope * MODULUS / 2 * (pixels * PIXEL) ** 2
    return ca.contact("fft-bem", modulus=MODULUS).solve(surface, load)


def scenes(seed: int, count: int) -> Iterator[Scene]:
    """Random scenes; the k-th is the same for every ``count``."""
    for number in range(count):
        own, temperature = chemistry(np.random.default_rng([seed, number // CONTACTS]))
        for trial in range(100):
            rng = np.random.default_rng([seed, number // CONTACTS, number, trial])
            contact = tip(rng) if number % 2 else rough(rng)
            if 10 <= np.count_nonzero(contact.contact) <= 30_000:
                break
        yield Scene(f"{seed}/{number} {'tip' if number % 2 else 'rough'}", contact, own, temperature)


def wide_scenes(seed: int, count: int) -> Iterator[Scene]:
    """Random scenes of ``--wide`` with contacts of up to 20 GPa."""
    group = number = 0
    while number < count:
        group += 1
        own, temperature = wide_chemistry(np.random.default_rng([seed, group]))
        for trial in range(WIDE_CONTACTS):
            rng = np.random.default_rng([seed, group, trial])
            contact = rough(rng, WIDE_PIXELS) if trial % 2 else tip(rng, WIDE_SITES)
            factor = float(np.random.default_rng([seed, group, trial, 1]).uniform(0.1, 20)) / contact.pressure.max()
            contact = ca.ContactSolution(
                pressure=factor * contact.pressure,
                load=factor * contact.load,
                pixel_size=contact.pixel_size,
                modulus=factor * MODULUS,
                periodic=contact.periodic,
            )
            here = contact.pressure[contact.contact]
            if 10 <= here.size <= 30_000 and independent(own, temperature, here).sum(axis=0)[-1] > 10:
                yield Scene(f"{seed}/{group}/{trial}", contact, own, temperature)
                number += 1


def independent(own: ca.Chemistry, temperature: float, pressure: np.ndarray) -> np.ndarray:
    """(n, m) share of bonded sites that do not interact: by trapezoids over the logits of the ranks of the forming
    barriers, by Gauss and Hermite over the breaking ones, between pressures by splines."""
    from scipy.interpolate import CubicSpline
    from scipy.special import expit

    logits = np.linspace(-36, 36, 801)
    forming = own.forming.quantile(expit(logits))
    weights = expit(logits) * expit(-logits)
    weights /= weights.sum()
    kt = ca.plugin.KB * temperature
    breaking, parts = np.array([np.inf]), np.ones(1)
    if own.breaking is not None:
        deviations, parts = np.polynomial.hermite_e.hermegauss(48)
        breaking, parts = own.breaking.mean + own.breaking.std * deviations, parts / parts.sum()  # pyright: ignore
    b = own.attempt_frequency * np.exp(-np.maximum(breaking, 0.0) / kt)
    lowered = own.activation_volume * ca.plugin.EV_PER_GPA_NM3 * float(pressure.max()) / kt
    nodes = np.linspace(0.0, float(pressure.max()), 160 + int(8 * lowered))
    shares = np.zeros((nodes.size, TIMES.size))
    for number, node in enumerate(nodes):
        lowered = forming - own.activation_volume * ca.plugin.EV_PER_GPA_NM3 * node
        a = (own.attempt_frequency * np.exp(-np.maximum(lowered, 0.0) / kt))[:, None]
        for column, time_ in enumerate(TIMES):
            shares[number, column] = weights @ (a / (a + b) * -np.expm1(-(a + b) * time_)) @ parts
    return np.exp(CubicSpline(nodes, np.log(np.maximum(shares, 1e-300)))(np.asarray(pressure, dtype=np.float64)))


def tiled(contact: ca.ContactSolution) -> tuple[ca.ContactSolution, int]:
    """Copies of a small contact apart from each other, and their number."""
    count = int(math.sqrt(TILED / np.count_nonzero(contact.contact)))
    if count < 2 or contact.periodic:
        return contact, 1
    rows, columns = (np.flatnonzero(contact.contact.any(axis=axis)) for axis in (1, 0))
    box = contact.pressure[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    pressure = np.tile(np.pad(box, ((0, 1), (0, 1))), (count, count))
    load = float(pressure.sum()) * contact.pixel_size**2
    return ca.ContactSolution(
        pressure=pressure, load=load, pixel_size=contact.pixel_size, modulus=MODULUS, periodic=False
    ), count**2


def truth(scene: Scene, wanted: np.ndarray | float = NOISE, kind: str = "next-reaction", seed: int = 7) -> Truth:
    """The kinetics of every site with an exact engine, until the relative errors are below ``wanted``."""
    contact, copies = tiled(scene.contact)
    engine, free = ca.engine(kind), scene.chemistry.replace(interaction=None)
    pressure = contact.pressure[contact.contact]
    exact = independent(free, scene.temperature, pressure).sum(axis=0) / copies
    changes: list[np.ndarray] = []
    begin = time.process_time()
    while True:
        replica = len(changes)
        disorder, noise = (np.random.SeedSequence(seed, spawn_key=(replica, k)) for k in range(2))
        both = []
        for own in (scene.chemistry, free):
            lattice = ca.plugin.build_lattice(own, contact, disorder)
            common = random.CommonSeed(noise.entropy, spawn_key=noise.spawn_key)  # pyright: ignore[reportArgumentType]
            both.append(
                ca.plugin.run_kinetics(engine, lattice, TIMES, temperature=scene.temperature, seed=common).bonds
            )
        changes.append((both[0].astype(float) - both[1]) / copies)
        if replica + 1 < FEWEST or (replica + 1) % FEWEST:
            continue
        values = np.array(changes)
        bonds, error = exact + values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(len(values))
        late = time.process_time() - begin > SECONDS
        if late or (error <= wanted * bonds).all():
            slopes = slope(values)
            return Truth(bonds, error, slope(bonds), slopes.std(ddof=1) / math.sqrt(len(values)), len(values))


def slope(curves: np.ndarray) -> Any:
    """Slope per decade over :data:`WINDOW`."""
    decades = np.log10(TIMES[WINDOW])
    weights = (decades - decades.mean()) / np.var(decades) / decades.size
    return curves[..., WINDOW] @ weights


def closure(scene: Scene, folder: str) -> ca.Ageing:
    """Ageing ``closure`` of a scene."""
    method = ca.ageing_method("closure", accuracy=0.02, folder=folder)
    fields: dict[str, Any] = {"temperature": scene.temperature, "hold_times": TIMES, "engine": ca.engine("auto")}
    return ca.age(scene.contact, scene.chemistry, method=method, **fields)


METHODS: dict[str, Callable[[Scene, str], ca.Ageing]] = {"closure": closure}


def measured(scene: Scene, method: str, folder: str, kind: str = "") -> dict[str, Any]:
    """One line of the file; the truth to half of the stated error by the engine ``kind``, if it is named."""
    found = METHODS[method](scene, folder)
    bonds, stated = found.bonds.mean(axis=0, dtype=float), np.zeros(TIMES.size)
    for error in found.errors.values():
        stated = np.hypot(stated, error)
    known = truth(scene, np.maximum(stated / 2, NOISE / 8), kind) if kind else truth(scene)
    free = scene._replace(chemistry=scene.chemistry.replace(interaction=None))
    exact = independent(free.chemistry, scene.temperature, scene.contact.pressure[scene.contact.contact]).sum(axis=0)
    alone = METHODS[method](free, folder).bonds.mean(axis=0, dtype=float)
    return {
        "scene": scene.name,
        "method": method,
        "sites": int(np.count_nonzero(scene.contact.contact)),
        "patches": scene.contact.summary()["patches"],
        "error": (bonds / known.bonds - 1).tolist(),
        "stated": stated.tolist(),
        "noise": (known.noise / known.bonds).tolist(),
        "beta": [float(slope(bonds) / known.slope - 1), known.slope_noise / abs(known.slope)],
        "beta_stated": math.hypot(*(part.size for part in beta_parts(found, (10.0, 1e4)).values())) / abs(known.slope),
        "replicas": known.replicas,
        "bonds": known.bonds.tolist(),
        "alone": (alone / exact - 1).tolist(),
    }


def table(lines: list[dict[str, Any]]) -> None:
    """Print the coverage of ± 1.96 standard errors, the noise of the truth included."""
    error, stated, noise = (np.array([line[name] for line in lines]) for name in ("error", "stated", "noise"))
    limits = np.array([statistics.student_limit(line["replicas"] - 1) for line in lines])
    z = np.abs(error) / np.hypot(stated, noise * limits[:, None] / statistics.NORMAL_LIMIT)
    print("| hold time (s) | within 95 % (per cent) | rms error (%) | largest (%) | median stated (%) | noise (%) |")
    print("|---|---|---|---|---|---|")
    for k, hold in enumerate(TIMES):
        numbers = [np.sqrt(np.mean(error[:, k] ** 2)), np.abs(error[:, k]).max(), np.median(stated[:, k])]
        numbers.append(np.median(noise[:, k]))
        row = " | ".join(f"{100 * number:.2f}" for number in numbers)
        print(f"| {hold:g} | {100 * (z[:, k] <= 1.96).mean():.1f} | {row} |")
    own = (z <= 1.96).mean(axis=1)
    spread = own.std(ddof=1) / math.sqrt(len(lines))
    print(f"\nAll: {100 * own.mean():.1f} ± {100 * spread:.1f} % of {z.size} statements on {len(lines)} scenes.")
    several = np.array([line["bonds"] for line in lines]) >= 1
    print(f"From one bond on: {100 * (z[several] <= 1.96).mean():.1f} % of {np.count_nonzero(several)}.")
    print(f"Without interaction: {100 * max(np.abs(line['alone']).max() for line in lines):.3f} % at most.")
    beta, claimed = np.array([line["beta"] for line in lines]), np.array([line["beta_stated"] for line in lines])
    held = np.abs(beta[:, 0]) <= 1.96 * np.hypot(claimed, beta[:, 1])
    print(f"β: {100 * held.mean():.1f} %; rms error {100 * np.sqrt(np.mean(beta[:, 0] ** 2)):.2f} %.")


def main() -> None:
    """Measure what is missing, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--method", default="closure", choices=METHODS)
    parser.add_argument("--seed", type=int, default=VALIDATION)
    parser.add_argument("--scenes", type=int, default=96)
    parser.add_argument("--wide", action="store_true", help="50 to 600 K, up to 20 GPa")
    parser.add_argument("--engine", default="rejection-free", help="exact engine of the truth of --wide")
    parser.add_argument("--folder", default="", help="folder of tables; default: the cache folder of the user")
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    lines = [json.loads(line) for line in options.file.read_text().splitlines()] if options.file.exists() else []
    if not options.table:
        done = {line["scene"] for line in lines}
        drawn = (wide_scenes if options.wide else scenes)(options.seed, options.scenes)
        kind = options.engine if options.wide else ""
        if options.wide:
            _table.PER_DECADE, _table.SIDE = 1, WIDE_SIDE
        for scene in drawn:
            if scene.name not in done:
                lines.append(measured(scene, options.method, options.folder, kind))
                with options.file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(lines[-1]) + "\n")
    table(lines)


if __name__ == "__main__":
    main()
