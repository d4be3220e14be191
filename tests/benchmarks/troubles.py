"""Whether `chemage.infer` names what is wrong with measurements, and whether forecasts hold where it names nothing.

    python tests/benchmarks/troubles.py [--out FOLDER] [--seed 1000] [--count 200] [--clean 3] [--quick]

Each case has four curves of a sphere, made by the forward model below, which shares no code with the inference: Hertz'
pressures, sites that react with ν exp(−(E − ΔV p)/k_BT), and noise of 3 % - and one trouble that nobody declares. Three
conditions are left out and forecast. One case in ``--clean`` has no trouble. Finished cases are kept in FOLDER, with
their inferences, and only the criticism of these is repeated. Thresholds were chosen with seeds below 1000.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

import chemage as ca

KB, EV = 8.617333262e-5, 6.241509  # eV/K; eV in 1 GPa nm³
NU, VOLUME, FORCE, RADIUS, MODULUS, PIXEL = 1e13, 6.4e-3, 3.0, 30.0, 35.3, 0.4518
SCENE: dict[str, Any] = {
    "name": "troubles",
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 64, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
    "forming": {"kind": "uniform", "lower": "0.8 eV", "upper": "1.4 eV"},
    "chemistry": {"activation_volume": "6.4 angstrom**3", "bond_force": "3 nN"},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "per_decade": 4, "replicas": 200},
}
ENERGIES = np.linspace(0.3, 2.0, 1701)
TIMES = np.logspace(-2, 4, 9)
#: nN, K and hold times (s) that are left out
LEFT_OUT = (
    (200.0, 300.0, np.logspace(-1, 4, 6)), (50.0, 345.0, np.logspace(-2, 3, 6)), (60.0, 315.0, np.logspace(-2, 4, 6)),
)  # fmt: skip
#: trouble -> its three strengths
TROUBLES: dict[str, tuple[float, ...]] = {
    "common factor": (0.05, 0.1, 0.2),
    "factor of one curve": (0.05, 0.1, 0.2),
    "drift": (0.05, 0.1, 0.2),  # at the ends of the hold times, in opposite directions
    "offset": (0.02, 0.05, 0.1),  # of the largest value
    "correlated": (1.0, 2.0, 3.0),  # standard errors, over 5 e-folds
    "outliers": (1.0, 2.0, 4.0),  # points, by 8 standard errors
    "errors too small": (1.5, 2.0, 3.0),
    "temperature of one curve": (5.0, 10.0, 20.0),  # K
    "interaction": (0.05, 0.1, 0.2),  # eV where all sites are bonded
    "bond force": (0.1, 0.25, 0.5),
    "kelvin": (0.0, 0.0, 0.0),  # 27 K for 27 °C
}
#: what the critic calls them
NAMES = {"factor of one curve": "factor", "correlated": "correlated", "outliers": "outlier",
         "errors too small": "scaled", "temperature of one curve": "temperature"}  # fmt: skip
#: share of the left-out points inside bands of 90 % from which the forecasts of a case hold
HOLDS = 0.8


def sites(load: float) -> np.ndarray:
    """GPa at each site under a sphere."""
    radius = (0.75 * load * RADIUS / MODULUS) ** (1 / 3)
    x = (np.arange(64) - 31.5) * PIXEL
    inside = 1 - (x[:, None] ** 2 + x**2) / radius**2
    return 1.5 * load / (np.pi * radius**2) * np.sqrt(inside[inside > 0])


def drop(weights: np.ndarray, load: float, kelvin: float, times: np.ndarray, interaction: float = 0.0) -> np.ndarray:
    """ΔF, nN. Bonds raise all barriers by ``interaction`` × bonded share: sites then see a time that runs slower."""
    kt, pressure = KB * kelvin, sites(load)
    rates = NU * np.exp(-(ENERGIES - VOLUME * EV * np.quantile(pressure, (np.arange(20) + 0.5) / 20)[:, None]) / kt)

    def share(clock: np.ndarray) -> np.ndarray:
        return np.array([(-np.expm1(-one * rates)).mean(axis=0) @ weights for one in clock])

    if not interaction:
        return FORCE * pressure.size * share(times)
    clock = np.geomspace(1e-9, 1e5, 600)
    slow = np.exp(interaction * share(clock) / kt)
    real = clock[0] + np.concatenate([[0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(clock))])
    return FORCE * pressure.size * share(np.exp(np.interp(np.log(times), np.log(real), np.log(clock))))


def drawn(rng: np.random.Generator) -> np.ndarray:
    """A density of one or two peaks and a background, of sum 1."""
    weights = np.zeros(ENERGIES.size)
    for _ in range(rng.integers(1, 3)):
        weights += rng.uniform(0.3, 1) * np.exp(
            -0.5 * ((ENERGIES - rng.uniform(0.72, 1.1)) / rng.uniform(0.04, 0.12)) ** 2
        )
    weights += rng.uniform(0, 0.3) * ((ENERGIES > 0.65) & (rng.uniform(1.1, 1.4) > ENERGIES))
    return weights / weights.sum()


def measured(seed: int, trouble: str, strength: float) -> tuple[list[ca.MeasuredCurve], np.ndarray, int]:
    """Curves with a trouble, the density, and the curve that has it."""
    rng = np.random.default_rng([seed, 46])
    weights, sign = drawn(rng), float(rng.choice([-1.0, 1.0]))
    loads, kelvins = (rng.uniform(20, 40), rng.uniform(80, 120)), (300.0, rng.uniform(320, 335))
    one, curves = int(rng.integers(4)), []
    bad = rng.permutation(4 * TIMES.size)[: int(strength) if trouble == "outliers" else 0]
    for number, (load, kelvin) in enumerate((load, kelvin) for load in loads for kelvin in kelvins):
        this = number == one
        true = kelvin + sign * strength * (trouble == "temperature of one curve" and this)
        values = drop(weights, load, true, TIMES, strength if trouble == "interaction" else 0.0)
        errors = np.hypot(0.03 * values, 0.003 * values.max())
        noise = rng.standard_normal(TIMES.size)
        if trouble == "correlated":
            near = np.exp(-np.abs(np.log(TIMES)[:, None] - np.log(TIMES)) / 5)
            noise = strength * np.linalg.cholesky(near) @ noise
        if trouble == "errors too small":
            noise = strength * noise
        noise = noise + 8 * sign * np.isin(np.arange(TIMES.size) + TIMES.size * number, bad)
        if trouble in ("common factor", "bond force") or (trouble == "factor of one curve" and this):
            values = values * (1 + sign * strength)
        if trouble == "drift":
            values = values * (1 + sign * strength * np.linspace(-1, 1, TIMES.size))
        values = values + errors * noise
        if trouble == "offset":
            values = values + sign * strength * FORCE * sites(loads[0]).size
        stated = 27.0 if trouble == "kelvin" and kelvin == 300 else kelvin
        curves.append(
            ca.MeasuredCurve(
                name="abcd"[number], load=load, temperature=stated, hold_times=TIMES, values=values, errors=errors
            )
        )
    return curves, weights, one


def infer(folder: Path, seed: int, trouble: str, strength: float) -> dict[str, Any]:
    """What forecasts of the left-out conditions do; the inference is kept."""
    curves, weights, one = measured(seed, trouble, strength)
    row: dict[str, Any] = {"seed": seed, "trouble": trouble, "strength": strength, "curve": "abcd"[one]}
    begin = time.process_time()
    try:
        found = ca.infer(curves, SCENE, families=(), samples=400, seed=seed)
    except ca.InputError as error:
        return {**row, "refused": str(error), "seconds": time.process_time() - begin}
    row["seconds"] = time.process_time() - begin
    ca.write(folder / f"{seed}.h5", found, force=True)
    row["held"], row["off"] = [], []
    interaction = strength if trouble == "interaction" else 0.0
    for load, kelvin, times in LEFT_OUT:
        truth = drop(weights, load, kelvin, times, interaction)
        made = found.forecast(load=load, temperature=kelvin, hold_times=times, samples=400)
        low, high = made.band(0.9)
        floor = 1e-3 * FORCE * sites(load).size
        row["held"] += ((truth >= low - floor) & (truth <= high + floor)).tolist()
        row["off"] += (made.median / truth - 1).round(3).tolist()
    return {**row, "notes": list(found.notes)}


def judged(folder: Path, row: dict[str, Any]) -> dict[str, Any]:
    """Whether the trouble of a case is named, or what is named instead, or whether it is said to go unnoticed."""
    trouble, strength = row["trouble"], row["strength"]
    if "refused" in row:
        return {"refused": 1, "named": "°C meant" in row["refused"]}
    found = ca.read(folder / f"{row['seed']}.h5")
    begin = time.process_time()
    named, missed = found.critic.named, found.critic.missed
    seconds = time.process_time() - begin
    kind = NAMES.get(trouble, trouble)
    kinds = (
        {"kelvin" for note in row["notes"] if "°C meant" in note}
        | {cause.kind.replace("outliers", "outlier") for cause in named}
        | ({"outlier"} if found.suspects() and trouble != "clean" else set())
    )
    at_ends = {"drift": 100 * strength / 3, "offset": strength * found.values.max()}
    size = at_ends.get(trouble, strength * (100 if kind == "factor" else 1))
    unseen = trouble in ("common factor", "bond force") or any(
        cause.kind == kind and cause.least > size for cause in missed
    )
    return {
        "held": np.mean(row["held"]),
        "holds": np.mean(row["held"]) >= HOLDS,
        "named": kind in kinds,
        "first": bool(named) and named[0].kind.replace("outliers", "outlier") == kind,
        "wrong": bool(named) and kind not in kinds,
        "unseen": unseen,
        "silent": not named and np.mean(row["held"]) < HOLDS and not unseen,
        "seconds": seconds,
        "what": [f"{cause.kind} {cause.where} {cause.odds:.1f}" for cause in named],
    }


def main() -> None:
    """Run the cases that are asked for, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("troubles-benchmark"))
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--clean", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="end sampling at 100 effective samples")
    given = parser.parse_args()
    if given.quick:
        from chemage_inference import sampling

        sampling.ENOUGH, sampling.AGREED = 100, 1.06
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "cases.jsonl"
    rows = {row["seed"]: row for row in map(json.loads, path.read_text().splitlines() if path.exists() else [])}
    table: dict[tuple[str, float], list[dict[str, Any]]] = defaultdict(list)
    kinds = [(name, at) for at in range(3) for name in TROUBLES]
    for number in range(given.count):
        seed = given.seed + number
        if seed not in rows:
            clean, at = number % given.clean == 0, (number - number // given.clean - 1) % len(kinds)
            trouble, strength = ("clean", 0.0) if clean else (kinds[at][0], TROUBLES[kinds[at][0]][kinds[at][1]])
            rows[seed] = infer(given.out, seed, trouble, strength)
            with path.open("a") as file:
                file.write(json.dumps(rows[seed]) + "\n")
        table[rows[seed]["trouble"], rows[seed]["strength"]].append(one := judged(given.out, rows[seed]))
        print(seed, rows[seed]["trouble"], rows[seed]["strength"], one.get("held"), one.get("what"), flush=True)
    columns = "refused", "held", "holds", "named", "first", "wrong", "unseen", "silent", "seconds"
    print(f"{'trouble':26s} {'':5s} cases {' '.join(f'{name:>8s}' for name in columns)}")
    for (trouble, strength), some in sorted(table.items()):
        numbers = [[one[name] for one in some if name in one] for name in columns]
        shown = [f"{sum(n):8.0f}" if name not in ("held", "seconds") else f"{np.mean(n or [np.nan]):8.2f}"
                 for name, n in zip(columns, numbers, strict=True)]  # fmt: skip
        print(f"{trouble:26s} {strength:5g} {len(some):5d} {' '.join(shown)}")


if __name__ == "__main__":
    main()
