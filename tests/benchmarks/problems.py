"""Answers to the ten problems of ``chemage benchmark``: by chemage, and without it.

    python tests/benchmarks/problems.py chemage plugins/chemage_benchmark/answers/chemage.csv
    python tests/benchmarks/problems.py brute-force plugins/chemage_benchmark/answers/brute-force.csv
    python tests/benchmarks/problems.py references plugins/chemage_benchmark

``brute-force`` uses numpy and scipy alone: closed forms, quadrature, every joint state, dense matrices. ``references``
writes the references into the problems: the value without chemage, and both standard errors together, with one for the
digits in which answers are written. All answers take a minute of CPU time.
"""

from __future__ import annotations

import csv
import re
import sys
import time
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_simpson, quad, simpson, solve_ivp
from scipy.linalg import expm
from scipy.special import exp1

import chemage as ca
from chemage.plugin import Drive, Ramp, pull

KB, EV_PER_NN_NM = 8.617333262e-5, 6.241509074
NU, KT = 1e13, 8.617333262e-5 * 300
#: contact modulus, GPa
MODULUS = 35.3
#: relative error of quadratures and closed forms, of which no digit is in doubt that is written down
EXACT = 1e-9
#: relative error of five digits
DIGITS = 1e-5
#: of the replicas
SEEDS = range(16)
#: name -> value and standard error
Answers = dict[str, tuple[float, float]]


def rate(energy, kelvin=300.0):
    return NU * np.exp(-np.maximum(energy, 0.0) / (KB * kelvin))


def known(error: float = EXACT, **values: float) -> Answers:
    return {name: (float(one), error * abs(float(one))) for name, one in values.items()}


def mean_of(names: Iterable[str], runs) -> Answers:
    """Means and standard errors over runs (r, names)."""
    runs = np.asarray(runs, float)
    errors = runs.std(axis=0, ddof=1) / len(runs) ** 0.5
    return dict(zip(names, zip(runs.mean(axis=0), errors, strict=True), strict=True))


def limit(name: str, sizes, values) -> Answers:
    """Of what is linear in ``sizes``, at 0."""
    (_, value), covariance = np.polyfit(sizes, values, 1, cov=True)
    return {name: (value, covariance[1, 1] ** 0.5)}


def lattice(n: int, forming, breaking=None) -> ca.ReactionLattice:
    """Independent sites."""
    fields = {"forming": np.broadcast_to(forming, n).copy()}
    if breaking is not None:
        fields["breaking"] = np.broadcast_to(breaking, n).copy()
    return ca.ReactionLattice(pixels=(n, 1), sites=np.arange(n), **fields)


def fft_bem(heights, pixel: float, load, **surface):
    made = ca.Surface(heights=heights, pixel_size=pixel, **surface)
    return ca.contact("fft-bem", modulus=MODULUS, tolerance=1e-9, threads=1).solve(made, load)


# -- 1 to 3: contacts --------------------------------------------------------------------------------------------------

RADIUS, LOAD = 30.0, 50.0


def brute_1() -> Answers:
    """Hertz."""
    edge = (0.75 * LOAD * RADIUS / MODULUS) ** (1 / 3)
    area = np.pi * edge**2
    return known(area=area, mean_pressure=LOAD / area, approach=edge**2 / RADIUS)


def chemage_1() -> Answers:
    sizes = np.geomspace(0.03, 0.12, 40)
    areas, ways = [], []
    for pixel in sizes:
        n = 2 * round(4.5 / pixel)
        tip = ca.surface("sphere", radius=RADIUS, pixels=n, pixel_size=pixel).make()
        found = ca.contact("fft-bem", modulus=MODULUS, tolerance=1e-7, threads=1).solve(tip, LOAD)
        areas.append(found.area)
        ways.append(found.displacement)
    return {
        **limit("area", sizes, areas),
        **limit("mean_pressure", sizes, LOAD / np.array(areas)),
        **limit("approach", sizes**2, ways),
    }


LENGTH, AMPLITUDE, PRESSURE = 100.0, 1.0, 0.22


def brute_2() -> Answers:
    """Westergaard."""
    part = PRESSURE / (np.pi * MODULUS * AMPLITUDE / LENGTH)
    fraction = 2 / np.pi * np.arcsin(part**0.5)
    return known(contact_fraction=fraction, peak_pressure=2 * PRESSURE / part**0.5)


def chemage_2() -> Answers:
    pixels = np.unique(np.geomspace(300, 3000, 40).astype(int))
    fractions, peaks = [], []
    for n in pixels:
        wave = AMPLITUDE * np.cos(2 * np.pi * np.arange(n) / n)
        found = fft_bem(np.tile(wave[:, None], (1, 4)), LENGTH / n, f"{PRESSURE} GPa")
        fractions.append(found.area_fraction)
        peaks.append(found.pressure.max())
    return {
        **limit("contact_fraction", 1 / pixels, fractions),
        **limit("peak_pressure", 1 / pixels, peaks),
    }


WAVES = [(1, 0, 0.3, 0.0), (0, 1, 0.2, 0.5), (2, -1, 0.15, 1.0), (3, 2, 0.1, 2.0), (-4, 5, 0.05, 3.0)]


def waves() -> np.ndarray:
    i, j = np.indices((32, 32))
    return sum(a * np.cos(2 * np.pi * (m * i + n * j) / 32 + phase) for m, n, a, phase in WAVES)


def measured(pressure: np.ndarray) -> dict[str, float]:
    numbers = {"area_fraction": (pressure > 0).mean(), "largest_pressure": pressure.max()}
    return {**numbers, "rms_pressure": (pressure**2).mean() ** 0.5}


def brute_3() -> Answers:
    """Linear equations of the pixels in contact, which change until no pressure or gap is negative."""
    q = 2 * np.pi * np.fft.fftfreq(32)
    size = np.hypot(*np.meshgrid(q, q, indexing="ij"))
    size[0, 0] = np.inf
    green = np.fft.ifft2(2 / (MODULUS * size)).real
    i, j = np.indices((32, 32)).reshape(2, -1)
    response = green[i[:, None] - i, j[:, None] - j]
    heights, touching = waves().ravel(), np.ones(1024, bool)
    for _ in range(1000):
        n = int(touching.sum())
        system = np.ones((n + 1, n + 1))
        system[:n, :n] = response[np.ix_(touching, touching)]
        system[n, n], system[:n, n] = 0.0, -1.0
        solved = np.linalg.solve(system, np.append(heights[touching], 0.5 * 1024))
        pressure = np.zeros(1024)
        pressure[touching] = solved[:n]
        gap = response @ pressure - heights - solved[n]
        wrong = (pressure < 0) | (gap < -1e-12) & ~touching
        if not wrong.any():
            return known(**measured(pressure))
        touching = touching & (pressure >= 0) | (gap < -1e-12) & ~touching
    raise RuntimeError("the pixels in contact go on changing")


def chemage_3() -> Answers:
    found = fft_bem(waves(), 1.0, "0.5 GPa", periodic=True)
    return known(1e-7, **measured(np.asarray(found.pressure, float)))


# -- 4 and 5: bonds in time --------------------------------------------------------------------------------------------

HOLDS = {"bonded_1s": 1.0, "bonded_100s": 100.0, "bonded_10000s": 1e4}


def brute_4() -> Answers:
    """(k_BT/ΔE) [Ein(k₁t) − Ein(k₂t)], Ein(x) = E₁(x) + ln x + γ."""
    times = np.array([*HOLDS.values()])

    def entire(x):
        return exp1(x) + np.log(x) + np.euler_gamma

    shares = KT / 0.6 * (entire(rate(0.8) * times) - entire(rate(1.4) * times))
    return known(**dict(zip(HOLDS, shares, strict=True)))


def chemage_4() -> Answers:
    n, engine = 400_000, ca.engine("independent")
    sites = lattice(n, 0.8 + 0.6 * (np.arange(n) + 0.5) / n)
    runs = [engine.run(sites, [*HOLDS.values()], temperature=300, seed=seed).bonds / n for seed in SEEDS]
    return mean_of(HOLDS, runs)


MOMENTS = {"bonds_1s": 1.0, "bonds_10s": 10.0, "bonds_100s": 100.0, "bonds_1000s": 1000.0}
FORMING, BREAKING = 0.76 + 0.02 * np.arange(9), 0.84 + 0.01 * np.arange(9)


def couplings() -> dict[tuple[int, int], float]:
    found = {}
    for i, j in product(range(9), range(9)):
        down, right = abs(i // 3 - j // 3), abs(i % 3 - j % 3)
        if max(down, right) == 1:
            found[i, j] = 0.03 if down + right == 1 else -0.02
    return found


def brute_5() -> Answers:
    """The master equation of 512 joint states."""
    pairs, matrix = couplings(), np.zeros((512, 512))
    for state, site in product(range(512), range(9)):
        bonded = [j for j in range(9) if state >> j & 1]
        energy = FORMING[site] + sum(pairs.get((site, j), 0.0) for j in bonded)
        flow = rate(BREAKING[site] if site in bonded else energy)
        matrix[state ^ 1 << site, state] += flow
        matrix[state, state] -= flow
    count = np.array([state.bit_count() for state in range(512)])
    means = {name: float(count @ expm(matrix * at)[:, 0]) for name, at in MOMENTS.items()}
    return known(**means)


def chemage_5() -> Answers:
    count, pairs = 4000, couplings()
    graph, energies = np.full((9, 8), -1), np.zeros((9, 8))
    for i in range(9):
        for slot, j in enumerate(j for j in range(9) if (i, j) in pairs):
            graph[i, slot], energies[i, slot] = j, pairs[i, j]
    start = 9 * np.arange(count)[:, None, None]
    sites = ca.ReactionLattice(
        pixels=(9 * count, 1),
        sites=np.arange(9 * count),
        forming=np.tile(FORMING, count),
        breaking=np.tile(BREAKING, count),
        neighbours=np.where(graph >= 0, graph + start, -1).reshape(-1, 8).astype(np.int32),
        coupling=np.tile(energies, (count, 1)).astype(np.float32),
    )
    engine = ca.engine("rejection-free")
    runs = [engine.run(sites, [*MOMENTS.values()], temperature=300, seed=seed).bonds / count for seed in SEEDS]
    return mean_of(MOMENTS, runs)


# -- 6 to 8: forces ----------------------------------------------------------------------------------------------------

RATES = {"10": 10.0, "1e3": 1e3, "1e5": 1e5}
BARRIER, REACH = 1.0, 0.05


def brute_6() -> Answers:
    """Bell: (k_BT/Δx) e^y E₁(y); cubic: ∫S dF."""
    found = {}
    for name, speed in RATES.items():
        y = rate(BARRIER) * KT / (REACH * EV_PER_NN_NM * speed)
        found |= known(**{f"bell_{name}": KT / (REACH * EV_PER_NN_NM) * np.exp(y) * exp1(y)})
        nu = 2 / 3
        # ends where the barrier is k_BT, long after the bond has broken
        force = np.linspace(0, (1 - (KT / BARRIER) ** nu) * BARRIER / (nu * REACH * EV_PER_NN_NM), 200_001)
        left = 1 - nu * force * REACH * EV_PER_NN_NM / BARRIER
        hazard = NU * left ** (1 / nu - 1) * np.exp(-BARRIER / KT * left ** (1 / nu)) / speed
        survival = np.exp(-cumulative_simpson(hazard, x=force, initial=0))
        assert survival[-1] < 1e-12
        found |= known(1e-8, **{f"cubic_{name}": simpson(survival, x=force)})
    return found


def chemage_6() -> Answers:
    """Bonds that are pulled and do not form again: the integral of how many are left over the force."""
    n, found = 20_000, {}
    for shape, (name, speed) in product(("bell", "cubic"), RATES.items()):
        drive = Drive(
            speed=speed / 10.0,
            bond_stiffness=10.0,
            transition_distance=REACH,
            partner="kept",
            shape="constant" if shape == "bell" else "cubic",
        )
        means, forces = [], np.linspace(0, 3.6, 1801)
        for seed in SEEDS:
            pulled = pull(
                ca.pulling("event-driven"),
                lattice(n, 1000.0, BARRIER),
                drive,
                forces / speed,
                temperature=300,
                seed=seed,
                start=np.ones(n, bool),
            )
            assert pulled.bonds[-1] == 0
            means.append([simpson(pulled.bonds / n, x=forces)])
        found |= mean_of([f"{shape}_{name}"], means)
    return found


K_ON, STIFFNESS, YIELDING = 100.0, 10.0, 0.8
SPEEDS = {"force_1": 1.0, "force_10": 10.0, "force_100": 100.0}


def yields(stretch):
    return rate(YIELDING - STIFFNESS * stretch * REACH * EV_PER_NN_NM)


def brute_7() -> Answers:
    """Ḟ∫tS dt/(1/k_on + ∫S dt)."""
    found = {}
    for name, speed in SPEEDS.items():
        stretch = np.linspace(0, 0.4, 400_001)
        survival = np.exp(-cumulative_simpson(yields(stretch) / speed, x=stretch, initial=0))
        below = speed / K_ON + simpson(survival, x=stretch)
        found |= known(1e-7, **{name: STIFFNESS * simpson(stretch * survival, x=stretch) / below})
    return found


def slider(speed: float) -> Drive:
    return Drive(
        speed=speed,
        bond_stiffness=STIFFNESS,
        transition_distance=REACH,
        partner="kept",
        shape="constant",
    )


def chemage_7() -> Answers:
    n, found = 5000, {}
    for name, speed in SPEEDS.items():
        means, first = [], 0.6 + 10 * speed / K_ON
        for seed in SEEDS:
            pulled = pull(
                ca.pulling("event-driven"),
                lattice(n, KT * np.log(NU / K_ON), YIELDING),
                slider(speed),
                np.array([first, 3 * first]) / speed,
                temperature=300,
                seed=seed,
            )
            means.append([(pulled.work[1] - pulled.work[0]) / (2 * first) / n])
        found |= mean_of([name], means)
    return found


SPEED, REST = 100.0, 0.02
#: nm that are slid each time
WAY = 3.0


def brute_8(steps: int = 8000) -> Answers:
    """∂n/∂t + V ∂n/∂s = −k(s) n by cohorts of bonds, and Richardson's extrapolation of a second order in the step."""
    coarse, fine = _slid(steps // 2), _slid(steps)
    return {name: (fine[name] + (fine[name] - coarse[name]) / 3, abs(fine[name] - coarse[name]) / 3) for name in fine}


def _slid(steps: int) -> dict[str, float]:
    stretch, amount, found = np.zeros(0), np.zeros(0), {}
    rest = np.append(0, np.geomspace(1e-7, 1, steps // 2) * REST)
    sliding = np.linspace(0, WAY / SPEED, steps + 1)
    for name, times, speed in (("steady", sliding, SPEED), ("after_hold", rest, 0.0), ("peak", sliding, SPEED)):
        forces = []
        for span in np.diff(times):
            way = speed * span
            lasts = np.exp(-span * (yields(stretch) + 4 * yields(stretch + way / 2) + yields(stretch + way)) / 6)
            free = 1 - amount.sum()
            # of the bonds that form in this step a part breaks in it
            after = 1 - amount @ lasts
            born = -np.expm1(-K_ON * span) * (free + after) / 2 * np.exp(-span / 2 * yields(way / 4))
            stretch, amount = np.append(stretch + way, way / 2), np.append(amount * lasts, born)
            if not speed and stretch.size > 1 and stretch[-2] == 0:
                amount[-2] += amount[-1]
                stretch, amount = stretch[:-1], amount[:-1]
            alive = amount > 1e-15
            stretch, amount = stretch[alive], amount[alive]
            forces.append(STIFFNESS * stretch @ amount)
        found[name] = _largest(times[1:], np.array(forces)) if name == "peak" else forces[-1]
    return found


def _largest(times, forces) -> float:
    """Of a polynomial through what is within 2 % of the largest, so that noise has no part in it."""
    near = forces > 0.98 * forces.max()
    middle = times[np.argmax(forces)]
    curve = np.polynomial.Polynomial.fit(times[near] - middle, forces[near], 4)
    return float(curve(np.linspace(times[near][0], times[near][-1], 2001) - middle).max())


def chemage_8() -> Answers:
    n, span = 40_000, WAY / SPEED
    engine, runs = ca.pulling("event-driven"), []
    for seed in SEEDS:
        sites, at = lattice(n, KT * np.log(NU / K_ON), YIELDING), {"temperature": 300, "seed": seed}
        first = pull(engine, sites, slider(SPEED), [span / 2, span], **at)
        rest = pull(engine, sites, slider(0.0), [span, span + REST], start=first.handed_on(), **at)
        # the peak is that of the bonds of the hold
        times = span + REST + np.linspace(0, 0.3 / SPEED, 601)
        last = pull(engine, sites, slider(SPEED), times, start=rest.handed_on(), **at)
        found = (first.force[-1], rest.force[-1], _largest(times, last.force))
        runs.append(np.array(found) / n)
    return mean_of(("steady", "after_hold", "peak"), runs)


# -- 9 and 10: steps of load and temperature ---------------------------------------------------------------------------

TIP, PIXEL, VOLUME = 200.0, 0.45, 0.0064
#: durations, s
FIRST, SECOND = 10.0, 1e4


def brute_9() -> Answers:
    """Of a site at r: barriers uniform, lowered by ΔV p(r); integrals over barriers and over the smaller contact."""
    energies, weights = np.polynomial.legendre.leggauss(2000)
    energies, weights = 1.1 + 0.3 * energies, weights / 2
    radii = {load: (0.75 * load * TIP / MODULUS) ** (1 / 3) for load in (20_000.0, 5_000.0)}

    def unbonded(r: float, load: float, span: float) -> np.ndarray:
        peak = 1.5 * load / (np.pi * radii[load] ** 2)
        pressure = peak * np.sqrt(max(1 - (r / radii[load]) ** 2, 0.0))
        return np.exp(-span * rate(energies - VOLUME * EV_PER_NN_NM * pressure))

    def over(load: float, share: Callable[[float], np.ndarray]) -> float:
        # ∫2πr dr by u = √(1 − r²/a²)
        edge = radii[load]
        value = quad(lambda u: u * (weights @ share(edge * np.sqrt(1 - u * u))), 0, 1, epsabs=1e-9, epsrel=1e-9)[0]
        return 2 * np.pi * edge**2 / PIXEL**2 * value

    high, low = radii
    return known(
        1e-6,
        before=over(high, lambda r: 1 - unbonded(r, high, FIRST)),
        kept=over(low, lambda r: 1 - unbonded(r, high, FIRST)),
        gained=over(low, lambda r: unbonded(r, high, FIRST) * (1 - unbonded(r, low, SECOND))),
    )


def chemage_9() -> Answers:
    scene = ca.parse_scene(
        {
            "name": "benchmark",
            "surface": {"kind": "sphere", "radius": TIP, "pixels": 224, "pixel_size": PIXEL},
            "contact": {"kind": "hertz", "modulus": MODULUS, "load": 20_000.0},
            "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
            "chemistry": {"activation_volume": VOLUME, "site_density": "pixel"},
            "engine": {"kind": "independent"},
            "hold": {"temperature": 300, "replicas": 400},
            "step": [{"duration": FIRST}, {"load": 5_000.0, "duration": SECOND}],
        }
    )
    seen = ca.run(scene).ageing.observables
    before, kept = seen["bonds_0"], seen["bonds_0"] - seen["step_lost"][:, 1]
    found = mean_of(("before", "kept", "gained"), np.transpose([before, kept, seen["bonds_1"] - kept]))
    # sums over pixels differ from the integrals by up to that
    return {name: (value, np.hypot(error, 6e-4 * value)) for name, (value, error) in found.items()}


HEATED = {"bonded_20s": (280.0, 340.0), "bonded_40s": (340.0, 340.0), "bonded_60s": (340.0, 280.0)}


def brute_10() -> Answers:
    """θ̇ = k_f (1 − θ) − k_b θ."""
    share, found = 0.0, {}
    for name, (begin, end) in HEATED.items():

        def change(at, theta, begin=begin, end=end):
            kelvin = begin + (end - begin) * at / 20.0
            return rate(0.95, kelvin) * (1 - theta) - rate(0.96, kelvin) * theta

        solved = solve_ivp(change, (0, 20.0), [share], rtol=1e-11, atol=1e-13, method="LSODA")
        share = solved.y[0, -1]
        found |= known(1e-7, **{name: share})
    return found


def chemage_10() -> Answers:
    n, runs = 200_000, []
    for seed in SEEDS:
        shares, state = [], None
        for number, (begin, end) in enumerate(HEATED.values()):
            state = ca.engine("independent").run(
                lattice(n, 0.95, 0.96),
                [20.0 * number, 20.0 * (number + 1)],
                temperature=begin,
                seed=seed,
                start=state,
                ramp=None if begin == end else Ramp(end),
            )
            shares.append(state.bonds[-1] / n)
        runs.append(shares)
    return mean_of(HEATED, runs)


# -- files -------------------------------------------------------------------------------------------------------------


def answers(way: str, number: int) -> Answers:
    return globals()[f"{way.partition('-')[0]}_{number}"]()


def write(way: str, file: Path) -> None:
    rows = [("problem", "answer", "value", "error")]
    for number in range(1, 11):
        begin = time.process_time()
        found = answers(way, number)
        print(f"ageing-{number}: {time.process_time() - begin:.1f} s", file=sys.stderr)
        rows += [(f"ageing-{number}", name, f"{value:.9g}", f"{error:.2g}") for name, (value, error) in found.items()]
    with file.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)


def references(folder: Path) -> None:
    both = []
    for way in ("brute-force", "chemage"):
        with (folder / "answers" / f"{way}.csv").open() as lines:
            both.append({(row["problem"], row["answer"]): row for row in csv.DictReader(lines)})
    for file in sorted((folder / "problems").glob("*.toml")):
        text = file.read_text()
        for (problem, name), row in both[0].items():
            if problem != file.stem:
                continue
            value, own = float(row["value"]), both[1][problem, name]
            away = float(own["value"]) - value
            error = np.linalg.norm([float(row["error"]), float(own["error"]), DIGITS * value])
            print(f"{problem:10} {name:20} {value:.9g} ± {error:.2g}: {away / error:+.2f} errors")
            block = re.compile(rf'(name = "{re.escape(name)}"\nunit = ".*"\nvalue = ).*\nerror = .*')
            text, hits = block.subn(rf"\g<1>{value:.9g}\nerror = {error:.2g}", text)
            assert hits == 1, (problem, name)
        file.write_text(text)


if __name__ == "__main__":
    _, way, path = sys.argv
    if way == "references":
        references(Path(path))
    else:
        write(way, Path(path))
