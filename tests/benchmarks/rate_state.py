"""Fits of rate-and-state laws to tables: intervals on synthetic traces of an integrator of its own.

    python tests/benchmarks/rate_state.py coverage --cases 600 --seed 0
    python tests/benchmarks/rate_state.py rivals --cases 20
    python tests/benchmarks/rate_state.py forward --rsfmodel /path/to/rsfmodel

Each trace is written as a table of time, displacement and friction with a uniform clock, and read as a user's. ``coverage``
counts by class how often 95 % intervals hold the truth, and how often the speeds are found; ``rivals`` how often the other
law is refused, or the better fit is that of the right law. ``forward`` compares with rsfmodel (MIT,
github.com/jrleeman/rsfmodel). Times are CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

LAWS: tuple[Any, ...] = ("ageing", "slip")


@dataclass(frozen=True)
class Case:
    """The truth of a trace, in µm and s."""

    law: Any
    a: float
    b: float
    slip_length: float
    stiffness: float
    speeds: tuple[float, ...]
    #: how long each speed lasts, and the interval of the clock
    spans: tuple[float, ...]
    interval: float
    #: of the friction: kind, standard deviation and, of "ar", memory
    noise: str = "white"
    size: float = 0.0
    memory: float = 0.0
    #: of friction: with displacement or time, over the whole trace
    drift: str = "none"
    trend: float = 0.0
    #: of the displacement: noise over its range, and decimals
    jitter: float = 0.0
    decimals: int = 12
    seed: int = 0
    programme: str = ""

    @property
    def changes(self) -> np.ndarray:
        return np.cumsum(self.spans)[:-1]

    @property
    def critical(self) -> float:
        """K/k_c, k_c = (b − a)/D_c."""
        return self.stiffness * self.slip_length / (self.b - self.a)


def solved(case: Case, times: np.ndarray) -> np.ndarray:
    """(m,) friction at ``times`` (m,), less μ₀: the equations for μ and ln θ, by LSODA."""
    from scipy.integrate import solve_ivp

    first = case.speeds[0]

    def rates(_: float, state: np.ndarray, pulled: float) -> list[float]:
        friction, aged = state
        theta = np.exp(aged)
        speed = first * np.exp((friction - case.b * (aged - np.log(case.slip_length / first))) / case.a)
        if not speed < 1e6 * first:
            raise FloatingPointError("unstable")
        way = speed * theta / case.slip_length
        evolved = (1 - way) / theta if case.law == "ageing" else -way * np.log(way) / theta
        return [case.stiffness * (pulled - speed), evolved]

    found, state, begin = np.zeros(times.size), [0.0, np.log(case.slip_length / first)], 0.0
    for span, speed in zip(case.spans, case.speeds, strict=True):
        end = begin + span
        inside = (times > begin) & (times <= end)
        at = np.unique(np.append(times[inside], end))
        with np.errstate(all="ignore"):
            part = solve_ivp(rates, (begin, end), state, "LSODA", at, args=(speed,), rtol=1e-9, atol=1e-12)
        if not part.success or part.y.shape[1] != at.size:
            raise FloatingPointError("unstable")
        found[inside], state, begin = part.y[0, : inside.sum()], part.y[:, -1], end
    return found


def noise_of(case: Case, size: int, rng: np.random.Generator) -> np.ndarray:
    """(size,) of standard deviation 1."""
    found = rng.standard_normal(2 * size)
    if case.noise == "ar":
        for k in range(1, found.size):
            found[k] = case.memory * found[k - 1] + np.sqrt(1 - case.memory**2) * found[k]
    elif case.noise == "1/f":
        power = np.append(0.0, np.arange(1, size + 1) ** -0.5)
        found = np.fft.irfft(np.fft.rfft(found) * power)
        found /= found.std()
    return found[size:]


def table_of(case: Case, path: Path) -> Path:
    """Write the trace as an instrument does."""
    rng = np.random.default_rng([case.seed, 1])
    whole = sum(case.spans)
    times = case.interval * np.arange(1, int(whole / case.interval + 1e-9) + 1)
    corners = np.append(0.0, np.cumsum(case.spans)), np.append(0.0, np.cumsum(np.multiply(case.spans, case.speeds)))
    way = np.interp(times, *corners)
    friction = 0.6 + solved(case, times) + case.size * noise_of(case, times.size, rng)
    friction += case.trend * {"none": 0, "displacement": way / way[-1], "time": times / whole}[case.drift]
    way = np.round(way + case.jitter * np.ptp(way) * rng.standard_normal(way.size), case.decimals)
    lines = (f"{t:.10g},{x:.12g},{f:.9g}" for t, x, f in zip(times, way, friction, strict=True))
    path.write_text("time (s),displacement (um),friction_coefficient\n" + "\n".join(lines) + "\n")
    return path


PROGRAMMES = ("up and down", "unequal", "hold", "holds", "mixed")
NOISES = ("white", "ar", "1/f")
DRIFTS = ("none", "displacement", "time")


def drawn(number: int, seed: int) -> Case:
    """One case: laws, programmes and noises take turns, the rest is drawn."""
    rng = np.random.default_rng([seed, number])
    programme, noise, law = PROGRAMMES[number % 5], NOISES[number // 5 % 3], LAWS[number // 15 % 2]
    while True:
        length, a = 10 ** rng.uniform(0, 1.7), 10 ** rng.uniform(-2.5, -1.7)
        weakens = rng.random() < 0.75
        b = a * (rng.uniform(1.1, 2.0) if weakens else rng.uniform(0.4, 0.9))
        over = 10 ** rng.uniform(np.log10(1.05), np.log10(30))
        stiffness = (over * (b - a) if weakens else a * 10 ** rng.uniform(-0.7, 1)) / length
        slow = 10 ** rng.uniform(-1, 1)
        fast = float(rng.choice([2, 3, 5, 10]))
        way = rng.uniform(10, 30)
        ways = {
            "up and down": [(1, way), (fast, way), (1, way)],
            "unequal": [(one, rng.uniform(8, 40)) for one in _differing(rng, int(rng.integers(2, 5)))],
            "hold": [(1, way), (0, rng.uniform(10, 100)), (1, way)],
            "holds": [(1, way), (0, rng.uniform(5, 20)), (1, way), (0, rng.uniform(30, 100)), (1, way)],
            "mixed": [(1, way), (fast, way), (0, rng.uniform(10, 60)), (1, way)],
        }[programme]
        speeds = [slow * one for one, _ in ways]
        # a hold lasts so many D_c at the first speed
        spans = [length * part / (slow * (one or 1)) for one, part in ways]
        interval = max(length / max(speeds) / rng.uniform(4, 20), sum(spans) / 4000)
        case = Case(
            law, a, b, length, stiffness, tuple(speeds), tuple(spans), interval, noise=noise, programme=programme
        )
        try:
            solved(case, np.array([sum(spans)]))
        except (FloatingPointError, ValueError):
            continue  # a step too large for the spring
        decimals, jitter = [(12, 0.0), (int(np.ceil(3 - np.log10(length))), 0.0), (12, 1e-4)][int(rng.integers(3))]
        drift = DRIFTS[int(rng.integers(3))]
        return replace(
            case,
            size=a * 10 ** rng.uniform(-1.5, -0.7),
            memory=rng.uniform(0.2, 0.9),
            drift=drift,
            trend=rng.uniform(-0.02, 0.02) * (drift != "none"),
            jitter=jitter,
            decimals=decimals,
            seed=int(rng.integers(2**31)),
        )


def _differing(rng: np.random.Generator, count: int) -> list[float]:
    speeds = [1.0]
    while len(speeds) < count:
        one = float(rng.choice([0.3, 1, 2, 3, 10]))
        if one != speeds[-1]:
            speeds.append(one)
    return speeds


def coverage(cases: int, seed: int, first: int) -> None:
    """How often intervals hold the truth, by class."""
    from chemage_rate_state.fit import fit_rate_state
    from chemage_rate_state.traces import read_trace

    names = ("a", "b", "slip_length", "stiffness")
    held: dict[str, list[Any]] = defaultdict(list)
    begin, slowest, read, refused = time.process_time(), 0.0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, first + cases):
            case = drawn(number, seed)
            path = table_of(case, Path(folder) / "trace.csv")
            started = time.process_time()
            weak = case.b > case.a
            over = f"K/k_c {case.critical:.3g}" if weak else "strengthening"
            what = f"{number} {case.law} {case.programme} {case.noise} {case.drift} {case.jitter:g} {over}:"
            inside, line = [False] * 4, ""
            try:
                trace = read_trace(path)
                loading = trace.loading
                right = loading.speeds.size == len(case.speeds) and np.allclose(
                    loading.speeds, case.speeds, rtol=0.01, atol=1e-3 * max(case.speeds)
                )
                read += right
                fit = fit_rate_state(trace, case.law)
                found = {one.name: one for one in fit.quantities()}
                inside = [found[name].low <= getattr(case, name) <= found[name].high for name in names]
                for name, one in zip(names, inside, strict=True):
                    true, own = getattr(case, name), found[name]
                    line += f" {name} {own.value / true:.3f} [{own.low / true:.3f}, {own.high / true:.3f}]"
                    line += "" if one else "!"
                refused += not fit.explains
                line += f" {fit.words()[:30]}" + ("" if right else f" SPEEDS {loading.speeds} of {case.speeds}")
            except ValueError as error:
                line = f" FAILED {error}"
            seconds = time.process_time() - started
            slowest = max(slowest, seconds)
            near = (
                "strengthening"
                if not weak
                else "K/k_c " + ("< 1.5" if case.critical < 1.5 else "< 5" if case.critical < 5 else "> 5")
            )
            for one in (
                "all",
                case.law,
                case.programme,
                case.noise,
                f"drift {case.drift}",
                f"jitter {case.jitter:g}",
                near,
            ):
                held[one].append(inside)
            print(what + line, f"{seconds:.1f} s", flush=True)
    for one, inside in held.items():
        shares = 100 * np.mean(inside, axis=0)
        print(
            f"{one:20} {len(inside):4}", *(f"{name} {share:.1f} %" for name, share in zip(names, shares, strict=True))
        )
    print(f"speeds right {read} of {cases}, true laws not said to explain {refused},", end=" ")
    print(f"slowest {slowest:.1f} s, {time.process_time() - begin:.0f} CPU s")


def rivals(cases: int, seed: int) -> None:
    """How often the other law fits worse, is refused, and is told from the right one by the difference that is asked."""
    from chemage_rate_state.fit import TOLD, fit_rate_state
    from chemage_rate_state.traces import read_trace

    better = refused = told = wrongly = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(cases):
            case = drawn(number, seed)
            trace = read_trace(table_of(case, Path(folder) / "trace.csv"))
            true, other = (fit_rate_state(trace, one) for one in sorted(LAWS, key=lambda one: one != case.law))
            away = other.misfit - true.misfit
            better += away > 0
            told += away >= TOLD
            wrongly += away <= -TOLD
            refused += not other.explains
            print(number, case.law, f"{away:.1f}", f"p {other.probability:.2g}", flush=True)
    print(f"of {cases}: right law better {better}, other law refused {refused},", end=" ")
    print(f"told apart by {TOLD:g}: rightly {told}, wrongly {wrongly}")


def forward(folder: str) -> None:
    """Largest difference from rsfmodel over the largest change."""
    from chemage_rate_state.laws import Loading, Parameters, change

    sys.path.insert(0, folder)
    import scipy.integrate

    scipy.integrate.cumtrapz = scipy.integrate.cumulative_trapezoid  # a name that newer scipy has not
    from rsfmodel import rsf, staterelations

    for law, relation in zip(LAWS, (staterelations.DieterichState, staterelations.RuinaState), strict=True):
        model = rsf.Model()
        model.mu0, model.a, model.k, model.vref = 0.6, 0.008, 1e-3, 1.0
        state = relation()
        state.b, state.Dc = 0.01, 10.0
        model.state_relations = [state]
        model.time = np.arange(0, 80.01, 0.01)
        speeds = np.where(model.time < 10, 1.0, 10.0)
        model.loadpoint_velocity = speeds
        theirs = np.array(model.solve().friction) - 0.6
        at = float(model.time[np.argmax(speeds > 5)])
        loading = Loading(np.array([0.0, at]), np.array([1.0, 10.0]))
        ours = change(law, Parameters(0.008, 0.01, 10.0, 1e-3), loading, np.array(model.time))
        print(law, f"{np.abs(ours - theirs).max() / np.abs(ours).max():.1e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["coverage", "rivals", "forward"])
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rsfmodel", default="")
    given = parser.parse_args()
    if given.what == "coverage":
        coverage(given.cases, given.seed, given.first)
    elif given.what == "rivals":
        rivals(given.cases, given.seed)
    else:
        forward(given.rsfmodel)
