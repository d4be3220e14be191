"""How often the error bars that chemage prints hold the truth, by repetition.

    python tests/benchmarks/error_bars.py FOLDER [CASE ...] [--blocks N]     # all cases: about a quarter of an hour
    python tests/benchmarks/error_bars.py FOLDER --table

Every case knows the truth in closed form, or from a pool of surfaces hundreds of times larger than a trial. It is
repeated in blocks with seeds of their own; finished blocks are kept in FOLDER/error_bars.jsonl, so that the same
command resumes an interrupted one. The table is docs/data/error_bars.csv.
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from grid_errors import vanishing_pixels
from scipy import stats

import chemage as ca
from chemage import ensemble
from chemage.ageing.models import Interval
from chemage.foundation.outputs import MeasuredOutput
from chemage.plugin import KB, Output, statistics
from chemage.studies.ensembles.quantities import Spread, half_width, regressed
from chemage_ageing import _table
from chemage_ageing._table import bonded_share
from chemage_li2018.sweeps import mean
from chemage_surfaces import fit_roughness

#: trials of a block
BLOCK = 50
COUNTS = (2, 3, 5, 10)


class Held(NamedTuple):
    """Whether one error bar held the truth, and how often it should; an interval that is not known is none."""

    bar: str
    held: bool
    claimed: float = 0.95


#: a case computes the trials of one block
Case = Callable[[np.random.Generator, int], Iterable[Held]]
CASES: dict[str, Case] = {}


def case(function: Case) -> Case:
    CASES[function.__name__] = function
    return function


def within(interval: Interval, truth: float) -> bool:
    return bool(interval.low <= truth <= interval.high)


def one_standard_error(count: int) -> float:
    """How often a mean of ``count`` normal values lies within its own standard error of the truth."""
    return float(2 * stats.t.cdf(1.0, count - 1) - 1)


# -- replicas of ageing: sites that react independently, whose mean bonds are a closed form --------------------------

TIMES = np.geomspace(1e-3, 1e5, 17)
WINDOW = ("10 s", "1e4 s")
CHEMISTRY = ca.chemistry(
    forming=ca.barriers("uniform", lower=0.8, upper=1.4), activation_volume="6.4 angstrom**3", site_density="pixel"
)


@cache
def tip(load: float) -> ca.ContactSolution:
    surface = ca.make_surface(ca.surface("sphere", radius=30.0, pixels=48, pixel_size=0.4518))
    return ca.contact("hertz", modulus=35.3).solve(surface, load)


def expected_bonds(contact: ca.ContactSolution, kelvin: float = 300.0) -> np.ndarray:
    """(m,) the mean over all replicas."""
    return bonded_share(CHEMISTRY, kelvin, TIMES, contact.pressure.ravel()[contact.sites]).sum(axis=0)


def aged(contact: ca.ContactSolution, replicas: int, seed: int, kelvin: float = 300.0, **more: Any) -> ca.Ageing:
    engine = ca.engine("independent")
    common = {"hold_times": TIMES, "temperature": kelvin, "replicas": replicas, "seed": seed, "threads": 1}
    return ca.age(contact, CHEMISTRY, engine=engine, **common, **more)


def with_bonds(like: ca.Ageing, bonds: np.ndarray) -> ca.Ageing:
    """An ageing curve with other replicas."""
    ones = np.full(len(bonds), max(float(like.sites.max()), float(np.max(bonds))))
    fields = {"load": like.load, "bond_force": like.bond_force, "front_factor": like.front_factor}
    return ca.Ageing(hold_times=like.hold_times, bonds=bonds, sites=ones, temperature=like.temperature, **fields)


def _replicas(rng: np.random.Generator, trials: int, load: float, words: str) -> Iterable[Held]:
    contact = tip(load)
    bonds = expected_bonds(contact)
    drawn = aged(contact, sum(COUNTS) * trials, int(rng.integers(2**40)))
    truth = with_bonds(drawn, bonds[None]).fit()
    few = int(np.argmin(np.abs(np.log(bonds))))
    first = 0
    for count in COUNTS:
        for _ in range(trials):
            one = with_bonds(drawn, drawn.bonds[first : first + count])
            first += count
            fit = ca.fit_ageing(one, window=WINDOW)
            yield Held(f"β and b, {words}, {count} replicas", within(fit.beta_interval, truth.beta))
            yield Held(f"cut-off time, {words}, {count} replicas", within(fit.cutoff_interval, truth.cutoff_time))
            away = np.abs(one.mean_friction_drop - one.bond_force * one.front_factor * bonds)
            half = one.friction_drop_half_width
            for at, what in ((-1, "at the last time"), (few, "with one bond per replica")):
                if np.isfinite(half[at]):
                    yield Held(f"ΔF and Δμ {what}, {words}, {count} replicas", bool(away[at] <= half[at]))
            yield Held(
                f"standard error of β, {words}, {count} replicas",
                bool(abs(fit.beta - truth.beta) <= fit.beta_stderr),
                one_standard_error(count),
            )


@case
def replicas(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """A tip with 157 sites."""
    return _replicas(rng, trials, 50.0, "157 sites")


@case
def few_sites(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """A tip with 9 sites."""
    return _replicas(rng, trials, 0.75, "9 sites")


@case
def skewed_replicas(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Replicas that differ by a factor with a logarithm of standard deviation 0.5."""
    like = aged(tip(50.0), 1, 0)
    curve = 1e6 * np.log10(TIMES / 1e-5)
    for count in COUNTS:
        for _ in range(trials):
            factor = np.exp(0.5 * rng.standard_normal((count, 1)) - 0.125)
            fit = ca.fit_ageing(with_bonds(like, factor * curve), window=WINDOW)
            truth = 1e6 * like.bond_force * like.front_factor / like.load
            yield Held(f"β, replicas very skewed, {count} replicas", within(fit.beta_interval, truth))


# -- fits to measurements, and the bootstrap --------------------------------------------------------------------------


@case
def measurements(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Measurements with errors that grow with time, normal ones and skewed ones."""
    for points in (4, 8, 25):
        times, error = np.geomspace(1.0, 1e4, points), np.geomspace(0.02, 0.08, points)
        for skewed in (False, True):
            for _ in range(trials):
                noise = rng.exponential(1.0, points) - 1.0 if skewed else rng.standard_normal(points)
                values = 0.45 * np.log10(times / 5.0) + error * noise
                data = ca.Measurements("m", times, values, "friction_coefficient_drop", error)
                fit = ca.fit_ageing(data, model="line")
                what = f"{'skewed' if skewed else 'normal'} errors, {points} points"
                yield Held(f"β of measurements, {what}", within(fit.beta_interval, 0.45))
                yield Held(f"cut-off time of measurements, {what}", within(fit.cutoff_interval, 5.0))


@case
def bootstrap(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Bootstrap intervals, of measurements and of replicas."""
    for points in (5, 10, 25):
        times = np.geomspace(1.0, 1e4, points)
        for _ in range(trials):
            values = 0.45 * np.log10(times / 5.0) + 0.05 * rng.standard_normal(points)
            data = ca.Measurements("m", times, values, "friction_coefficient_drop")
            for kind in ("residuals", "pairs"):
                fit = ca.fit_ageing(data, model="line", bootstrap=kind, samples=1000, seed=int(rng.integers(2**31)))
                yield Held(f"bootstrap of {kind}, β, {points} points", within(fit.beta_interval, 0.45))
    like = aged(tip(50.0), 1, 0)
    scale = like.bond_force * like.front_factor / like.load
    for count in (3, 5, 10, 20):
        for _ in range(trials):
            factor = rng.normal(1e6, 5e4, (count, 1))
            bonds = factor * np.log10(TIMES / 1e-5) + rng.normal(0.0, 3e4, (count, TIMES.size))
            fit = ca.fit_ageing(
                with_bonds(like, bonds),
                window=WINDOW,
                bootstrap="replicas",
                samples=1000,
                seed=int(rng.integers(2**31)),
            )
            yield Held(f"bootstrap of replicas, β, {count} replicas", within(fit.beta_interval, 1e6 * scale))


# -- activation energies ----------------------------------------------------------------------------------------------


@case
def arrhenius(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Bonds that rise with ln t, shifted from replica to replica, more so at low temperature."""
    energy, level, kelvins = 0.8, 0.3, np.array([280.0, 295.0, 310.0, 330.0, 350.0])
    times = np.geomspace(1e-6, 1e8, 57)
    log_prefactor = (level - 0.1) / 0.02 - math.log(1e13)
    scatter = np.array([0.03, 0.02, 0.02, 0.01, 0.01])
    plans: dict[str, list[int]] = {f"{count} replicas": [count] * 5 for count in (2, 3, 5, 10)}
    plans |= {"3 to 10 replicas": [3, 5, 5, 10, 10], "5 to 20 replicas": [5, 5, 10, 10, 20]}
    for words, counts in plans.items():
        for shared in (0.0, 0.02):
            if shared and len(set(counts)) > 1:
                continue
            for _ in range(trials):
                together, curves = rng.standard_normal(max(counts)) * shared, []
                for kelvin, count, alone in zip(kelvins, counts, scatter, strict=True):
                    shift = together[:count] + alone * rng.standard_normal(count)
                    share = 0.02 * (np.log(times) + math.log(1e13) - energy / (KB * kelvin)) + 0.1 + shift[:, None]
                    curves.append(_of_share(kelvin, times, share))
                found = ca.arrhenius(curves, level, quantity="bonds_per_site", window=("1e9 s", "1e10 s"))
                one, what = found.energies[0], f"{words}{', common disorder' if shared else ''}"
                yield Held(f"activation energy, {what}", within(one.energy_interval, energy))
                yield Held(f"prefactor, {what}", within(one.prefactor_interval, math.exp(log_prefactor)))
    for count in (3, 5):
        for _ in range(trials):
            curves = [
                _of_share(
                    kelvin,
                    times,
                    0.02 * (np.log(times) + math.log(1e13) - energy / (KB * kelvin)) + 0.1 + 0.02 * rng.normal(),
                )
                for kelvin in kelvins[:count]
            ]
            found = ca.arrhenius(curves, level, quantity="bonds_per_site", window=("1e9 s", "1e10 s"))
            bar = f"activation energy, one replica, {count} temperatures"
            yield Held(bar, within(found.energies[0].energy_interval, energy))


def _of_share(kelvin: float, times: np.ndarray, share: np.ndarray) -> ca.Ageing:
    rows = np.atleast_2d(np.clip(share, 0, 1))
    given = {"load": 1e6, "bond_force": 1.0, "front_factor": 1.0, "temperature": float(kelvin)}
    return ca.Ageing(hold_times=times, bonds=1e6 * rows, sites=np.full(len(rows), 1e6), **given)


# -- surfaces ---------------------------------------------------------------------------------------------------------

POOL = 3000
ROUGH = {
    "name": "pool",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 60.0, "tolerance": 1e-4},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 1, "seed": 5},
}  # fmt: skip
_folder = Path()


@cache
def pool() -> Any:
    """An ensemble of many small rough contacts, with 7 patches or so each."""
    return ensemble(ca.parse_scene(ROUGH), surfaces=POOL, samples=_folder / "pool")


@case
def surfaces(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Ensembles of a number of surfaces, drawn from the pool."""
    every = pool()
    names = ("beta", "friction_coefficient_drop", "area_fraction", "patches")
    for count in COUNTS:
        for _ in range(trials):
            rows = every.rows["0"][rng.choice(POOL, count, replace=False)]
            level = dict(every.levels[0]) | {"samples": count, "variance_of": count}
            one = every.model_copy(update={"rows": {"0": rows}, "levels": (level,)})
            for name in names:
                truth, found = every.estimate(name).value, one.estimate(name)
                if math.isnan(found.half_width):
                    continue
                held = bool(abs(found.value - truth) <= found.half_width)
                yield Held(f"ensemble, {name}, {count} surfaces", held)


@case
def two_levels(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """The mean of one level and the mean difference of another, with few samples of each."""
    for counts in ((10, 5), (40, 5), (40, 20)):
        for ratio, words in ((0.1, "small differences"), (0.5, "differences half as large")):
            for _ in range(trials):
                rows = [rng.standard_normal((counts[0], 1)), ratio * rng.standard_normal((counts[1], 1))]
                spreads = [Spread(one.var(axis=0, ddof=1), len(one) - 1) for one in rows]
                half = half_width(spreads, list(counts), np.zeros(1))[0]
                off = abs(sum(float(one.mean()) for one in rows))
                yield Held(f"ensemble on two grids, {counts[0]} and {counts[1]} surfaces, {words}", bool(off <= half))


@case
def sketched(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """The mean of a level that is regressed on a number of each surface."""
    for counts in ((6, 40), (16, 160), (40, 400)):
        for correlation in (0.8, 0.97):
            for _ in range(trials):
                surface, own = rng.standard_normal(counts[1]), rng.standard_normal(counts[0])
                level = correlation * surface[: counts[0]] + np.sqrt(1 - correlation**2) * own
                rows = regressed([level[:, None], surface[:, None]])
                spreads = [Spread.of(one, len(one), len(one) - 1, not number) for number, one in enumerate(rows)]
                half = half_width(spreads, list(counts), np.zeros(1))[0]
                words = f"{counts[0]} of {counts[1]} sketches with kinetics, correlation {correlation:g}"
                yield Held(f"ensemble, {words}", bool(abs(sum(float(one.mean()) for one in rows)) <= half))


@case
def seeds_of_sweeps(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Means over the seeds of a sweep: one axis, and two axes, of which the surface scatters more."""
    for count in COUNTS:
        for _ in range(trials):
            values = rng.standard_normal((count, 1))
            held = bool(abs(values.mean()) <= statistics.crossed_half_width(values, 1)[0])
            yield Held(f"sweep, mean over {count} seeds", held)
    for shape in ((3, 3), (3, 10), (10, 3)):
        for ratio in (0.25, 1.0):
            for _ in range(trials):
                values = rng.standard_normal((shape[0], 1)) + ratio * rng.standard_normal(shape)
                held = bool(abs(values.mean()) <= statistics.crossed_half_width(values, 2))
                size = "a quarter of the scatter" if ratio < 1 else "the scatter"
                yield Held(
                    f"sweep, mean over {shape[0]} seeds of the surface and {shape[1]} of the hold, with {size}", held
                )


@case
def observables(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Numbers that an observable measures: small counts, and exponentially distributed values."""
    for count in COUNTS:
        for _ in range(trials):
            for words, values, truth in (
                ("counts of 3 on average", rng.poisson(3.0, count).astype(float), 3.0),
                ("counts of 0.3 on average", rng.poisson(0.3, count).astype(float), 0.3),
                ("exponential values", rng.exponential(1.0, count), 1.0),
            ):
                shown = MeasuredOutput("x", values, Output((), "", "")).summary()
                if math.isnan(shown["half_width"]):
                    continue
                held = bool(abs(shown["mean"] - truth) <= shown["half_width"])
                yield Held(f"observable, {words}, {count} replicas", held)


# -- grids, spectra, studies ------------------------------------------------------------------------------------------


@case
def grids(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """The area of a disc at a random place, extrapolated from three grids."""
    for _ in range(trials):
        radius, shift = rng.uniform(2.0, 3.5), rng.uniform(-0.5, 0.5, 2)
        found = []
        for pixels in (24, 48, 96):
            size = 12.0 / pixels
            x = (np.arange(pixels) + 0.5) * size - 6.0
            inside = np.hypot(x[:, None] - shift[0], x[None, :] - shift[1]) < radius
            pressure = np.where(inside, 1.0, 0.0)
            load = float(pressure.sum()) * size**2
            found.append(ca.ContactSolution(pressure=pressure, load=load, pixel_size=size, modulus=35.3))
        limit = vanishing_pixels(found)
        assert limit is not None
        off = abs(limit.area - math.pi * radius**2)
        yield Held("error of the contact grid, discs", bool(off <= statistics.NORMAL_LIMIT * limit.area_stderr))


@case
def spectra(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Fits of the spectra of self-affine surfaces, whole periods and cut-out parts; a third of the trials."""
    for _ in range(max(1, trials // 3)):
        hurst, seed = float(rng.choice([0.4, 0.6, 0.8])), int(rng.integers(2**40))
        maker = ca.surface("self-affine", pixels=256, pixel_size=1.0, rms_slope=0.1, hurst=hurst, zeta=64, eta=8)
        whole: Any = ca.make_surface(maker, seed)
        part = ca.Surface(heights=np.ascontiguousarray(whole.heights[:128, :128]), pixel_size=1.0, periodic=False)
        for words, surface in (("periodic", whole), ("cut out", part)):
            try:
                found = fit_roughness(surface)
            except ca.InputError:
                yield Held(f"Hurst exponent, {words}", False, 0.683)
                continue
            yield Held(f"Hurst exponent, {words}", abs(found.hurst - hurst) <= found.hurst_error, 0.683)
            if found.roll_off_interval is not None:
                low, high = found.roll_off_interval
                yield Held(f"roll-off, {words}", low <= 256 / 8 <= high, 0.683)


@case
def one_more_surface(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """The interval for one more surface, of the comparison with the paper."""
    for count in COUNTS:
        for _ in range(trials):
            found = mean(rng.standard_normal(count))
            held = bool(abs(rng.standard_normal() - found.value) <= found.one_more)
            yield Held(f"study of the paper, one more surface, {count} surfaces", held)


@case
def closure_table(rng: np.random.Generator, trials: int) -> Iterable[Held]:
    """Nodes of the table of ageing ``closure``, each against the mean of the others of its block; a fifth of the
    trials."""
    chemistry = CHEMISTRY.replace(interaction=ca.interaction("elastic-pairs", strength=0.5))
    count = max(4, trials // 5)
    nodes = []
    for seed in rng.integers(2**31, size=count):
        engine = ca.engine("next-reaction")
        nodes.append(
            _table._Samples(_table.Setting(chemistry, engine, 300.0, 0.4518, 8, (0, 4), 0.02, int(seed)), 2).enough()
        )
    for what, neighbours in (("inside", 8), ("rim", 5)):
        values, errors = (np.array([getattr(one, name)[neighbours] for one in nodes]) for name in ("change", "error"))
        others = (values.sum(axis=0) - values) / (count - 1)
        # the others have an error as well
        away = np.abs(values - others) / math.sqrt(1 + 1 / (count - 1))
        for at, words in ((8, "10 s"), (32, "10⁴ s")):
            for off, error in zip(away[:, at], errors[:, at], strict=True):
                yield Held(f"table of closure, {what} at {words}", bool(off <= error), 0.683)


# -- blocks and the table ---------------------------------------------------------------------------------------------


def block(name: str, number: int, trials: int = BLOCK) -> dict[str, tuple[int, int, float]]:
    """Held, trials and claim of every bar of a case, in one block."""
    words = [number, *name.encode()]
    counts: dict[str, list[float]] = defaultdict(lambda: [0, 0, 0.0])
    for one in CASES[name](np.random.default_rng(words), trials):
        entry = counts[one.bar]
        entry[0], entry[1], entry[2] = entry[0] + bool(one.held), entry[1] + 1, one.claimed
    return {bar: (int(entry[0]), int(entry[1]), entry[2]) for bar, entry in counts.items()}


def added(lines: Iterable[dict[str, Any]]) -> dict[str, tuple[int, int, float]]:
    total: dict[str, tuple[int, int, float]] = {}
    for line in lines:
        for bar, (held, trials, claimed) in line["bars"].items():
            before = total.get(bar, (0, 0, claimed))
            total[bar] = (before[0] + held, before[1] + trials, claimed)
    return total


def low(held: int, trials: int, claimed: float) -> bool:
    """Whether a bar holds the truth too rarely: two per cent less than it should, beyond the error of counting."""
    return held / trials < claimed - 0.02 - 2 * math.sqrt(claimed * (1 - claimed) / trials)


def table(lines: list[dict[str, Any]]) -> None:
    """Print one row for each error bar, with the numbers of replicas, surfaces or points in brackets."""
    print("| error bar | claimed, % | holds the truth, % | ± | trials of each | case |\n|" + " --- |" * 6)
    for name in CASES:
        rows: dict[str, list[tuple[str, int, int, float]]] = defaultdict(list)
        for bar, (held, trials, claimed) in added(line for line in lines if line["case"] == name).items():
            found = re.fullmatch(r"(.*), (\d+ (?:replicas|surfaces|points))(.*)", bar)
            words, count = (found[1] + found[3], found[2]) if found else (bar, "")
            rows[words].append((count, held, trials, claimed))
        for words, parts in rows.items():
            claims = dict.fromkeys(f"{100 * claimed:.3g}" for *_, claimed in parts)
            shares = []
            for k, (count, held, trials, claimed) in enumerate(parts):
                share = f"{100 * held / trials:.1f}"
                unit = count if k == len(parts) - 1 else count.partition(" ")[0]
                shares.append((f"**{share}**" if low(held, trials, claimed) else share) + f" ({unit})" * bool(count))
            trials, claimed = parts[0][2], parts[0][3]
            error = 100 * math.sqrt(claimed * (1 - claimed) / trials)
            print(f"| {words} | {', '.join(claims)} | {', '.join(shares)} | {error:.1f} | {trials} | {name} |")


def main() -> None:
    global _folder
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}; default: all")
    parser.add_argument("--blocks", type=int, default=20, help=f"blocks of {BLOCK} trials")
    parser.add_argument("--table", action="store_true", help="compute nothing")
    given = parser.parse_args()
    _folder = given.folder
    _folder.mkdir(parents=True, exist_ok=True)
    log = _folder / "error_bars.jsonl"
    lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    done = {(line["case"], line["block"]) for line in lines}
    if not given.table:
        for number in range(given.blocks):
            for name in given.cases or CASES:
                if (name, number) in done:
                    continue
                lines.append({"case": name, "block": number, "bars": block(name, number)})
                with open(log, "a") as stream:
                    stream.write(json.dumps(lines[-1]) + "\n")
    table(lines)


if __name__ == "__main__":
    main()
