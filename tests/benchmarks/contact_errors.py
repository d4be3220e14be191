"""Claimed errors of fft-bem against independently evaluated ones, over random contacts that are hard in some way.

    python tests/benchmarks/contact_errors.py                      # all families, all precisions: about 15 minutes
    python tests/benchmarks/contact_errors.py spikes --count 30    # one family
    python tests/benchmarks/contact_errors.py pressure             # only the estimate of the pressure error
    python tests/benchmarks/contact_errors.py intervals --count 500 --seed 2 --rows FILE      # stated intervals: an hour

The errors of the gap are evaluated in double precision by ``tests/stubs/independent_contact.py``. The error of the
pressure is measured against the same contact solved to a tolerance of 1e-11 in double precision (whose gap is checked
in the same way), or against the dense active-set solution where the grid is small.

``intervals`` are those of area, rms and largest pressure and approach, of random contacts over solvers, bodies, laws,
boundaries and precisions. Iteration alone: against a smaller tolerance on the same pixels. All errors: against pixels
of a quarter, or the closed form of a sphere. Factors were calibrated with seeds 1 to 4, 31 and 32; others judge them.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "stubs"))

from independent_contact import Body, Errors, dense_solution, evaluate

import chemage as ca
from chemage import ContactSolution, InputError, Surface
from chemage.plugin import ConvergenceError
from chemage_contact import FFTBEM
from chemage_surfaces import SelfAffine

MODULUS = 35.3
#: tolerances asked for in each precision: the smallest one allowed or nearly so, and the default
TOLERANCES = {"single": (1e-6, 1e-5), "mixed": (1e-12, 1e-5), "double": (1e-12, 1e-5)}


@dataclass
class Case:
    """One contact to solve."""

    heights: np.ndarray
    mean: float
    """GPa"""
    body: Body = field(default_factory=lambda: Body(MODULUS, 0.5))

    def solve(self, **options: Any) -> ContactSolution:
        surface = Surface(heights=self.heights, pixel_size=self.body.pixel, periodic=self.body.periodic)
        solver = FFTBEM(
            modulus=MODULUS,
            thickness=self.body.thickness,
            poisson_ratio=self.body.poisson,
            threads=1,
            on_failure="return",
            **options,
        )
        return solver.solve(surface, self.mean * surface.nominal_area)


def noise(rng: np.random.Generator, shape: tuple[int, int], smooth: int = 1) -> np.ndarray:
    h = rng.standard_normal(shape)
    for _ in range(smooth):
        h = h + np.roll(h, 1, 0) + np.roll(h, 1, 1) + np.roll(h, (1, 1), (0, 1))
    return h / h.std()


def rough(rng: np.random.Generator, pixels: int, **options: Any) -> np.ndarray:
    options = {
        "hurst": float(rng.choice([0.3, 0.5, 0.8])),
        "zeta": float(rng.choice([4, 16, pixels // 4, pixels // 2])),
        "eta": float(rng.choice([1, 3])),
        "rms_slope": float(10 ** rng.uniform(-2, 0)),
    } | options
    options["eta"] = min(options["eta"], options["zeta"])
    maker = SelfAffine(pixels=pixels, pixel_size=0.5, **options)
    return np.array(maker.make(int(rng.integers(1 << 30))).heights)


def slope(h: np.ndarray, pixel: float = 0.5) -> float:
    dx, dy = (np.roll(h, 1, axis) - h for axis in (0, 1))
    return float(np.sqrt(np.mean(dx**2 + dy**2))) / pixel


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def few_pixels(rng: np.random.Generator) -> Case:
    """One to about ten pixels in contact, grids of 6 to 24 pixels."""
    shape = (int(rng.integers(6, 25)), int(rng.integers(6, 25)))
    h = noise(rng, shape, int(rng.integers(0, 3)))
    return Case(h, MODULUS * slope(h) * log_uniform(rng, 1e-4, 5.0 / h.size))


def light(rng: np.random.Generator) -> Case:
    """Self-affine surfaces at vanishing load, periodic and free."""
    h = rough(rng, int(rng.choice([64, 101, 128])))
    return Case(h, MODULUS * slope(h) * log_uniform(rng, 1e-9, 1e-3), Body(MODULUS, 0.5, bool(rng.random() < 0.7)))


def spikes(rng: np.random.Generator) -> Case:
    """Single high pixels on a plane, near the load where the plane begins to touch."""
    n = int(rng.choice([24, 48, 64, 128]))
    h = np.zeros((n, n))
    count = int(rng.choice([1, 1, 2, 5]))
    h.ravel()[rng.choice(h.size, count, replace=False)] = rng.uniform(0.5, 1.0, count)
    # A pixel sinks by about 1.12 pixel·p/E*.
    touching = float(h.max()) * MODULUS / (1.12 * 0.5) / h.size
    return Case(h, touching * log_uniform(rng, 0.1, 30.0), Body(MODULUS, 0.5, bool(rng.random() < 0.8)))


def outliers(rng: np.random.Generator) -> Case:
    """Single pixels 3 to 300 rms heights above a rough surface."""
    h = rough(rng, int(rng.choice([64, 128])))
    count = int(rng.choice([1, 1, 3]))
    rms, top = h.std(), h.max()
    h.ravel()[rng.choice(h.size, count, replace=False)] = top + rms * 10 ** rng.uniform(0.5, 2.5, count)
    touching = float(h.max() - top) * MODULUS / (1.12 * 0.5) / h.size
    return Case(h, touching * log_uniform(rng, 0.1, 30.0))


def worn(rng: np.random.Generator) -> Case:
    """Rough surfaces whose summits are cut off, smooth or with a little roughness left."""
    h = rough(rng, int(rng.choice([64, 128])))
    level = float(np.quantile(h, rng.choice([0.6, 0.9, 0.99])))
    left = h.std() * float(rng.choice([0.0, 1e-6, 1e-4, 1e-2]))
    h = np.minimum(h, level) + left * noise(rng, h.shape) * (h > level)
    return Case(h, MODULUS * slope(h) * log_uniform(rng, 1e-7, 0.3))


def full(rng: np.random.Generator) -> Case:
    """Loads of 1 to 1e6 times the load of full contact, periodic and free."""
    n = int(rng.choice([48, 64, 128]))
    h = rough(rng, n)
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(n, 0.5)[:, None], np.fft.rfftfreq(n, 0.5))
    closing = -float(np.fft.irfft2(np.fft.rfft2(h) * q * MODULUS / 2, s=h.shape).min())
    return Case(h, closing * log_uniform(rng, 1.0, 1e6), Body(MODULUS, 0.5, bool(rng.random() < 0.7)))


def layers(rng: np.random.Generator) -> Case:
    """Layers of 0.001 to 1000 pixels, Poisson's ratio from 0 to 0.5."""
    h = rough(rng, int(rng.choice([64, 128])))
    nu = float(rng.choice([0.0, 0.25, 0.45, 0.49, 0.5]))
    body = Body(MODULUS, 0.5, True, log_uniform(rng, 5e-4, 500.0), nu)
    symbol = body.symbol(h.shape)
    stiff = 1 / np.where(symbol > 0, symbol, np.inf)
    closing = -float(np.fft.irfft2(np.fft.rfft2(h) * stiff, s=h.shape).min())
    return Case(h, closing * log_uniform(rng, 1e-4, 0.9), body)


def moderate(rng: np.random.Generator) -> Case:
    """Self-affine surfaces at 0.1 to 90 % contact."""
    h = rough(rng, int(rng.choice([64, 96, 128, 192, 256])))
    return Case(h, MODULUS * slope(h) * log_uniform(rng, 5e-4, 0.8), Body(MODULUS, 0.5, bool(rng.random() < 0.85)))


FAMILIES: dict[str, tuple[Callable[[np.random.Generator], Case], int]] = {
    "few_pixels": (few_pixels, 500),
    "light": (light, 300),
    "spikes": (spikes, 200),
    "outliers": (outliers, 100),
    "worn": (worn, 100),
    "full": (full, 100),
    "layers": (layers, 100),
    "moderate": (moderate, 100),
}


def cases(name: str, count: int | None = None, seed: int = 0) -> Iterator[Case]:
    """The first cases of a family; the same ones on every machine."""
    make, default = FAMILIES[name]
    for k in range(default if count is None else count):
        yield make(np.random.default_rng([seed, len(name), ord(name[0]), k]))


def rounding(found: Errors) -> float:
    """What the rounding of both evaluations may add to an error, relative to its scale."""
    scale = min(found.rms_height, found.approach) if found.approach > 0 < found.rms_height else found.rms_height
    return 10 * found.rounding / scale if scale > 0 else 0.0


def check(case: Case, precision: str, tolerance: float) -> dict[str, Any]:
    """Solve and evaluate."""
    solution = case.solve(precision=precision, tolerance=tolerance)
    found = evaluate(case.body, case.heights, solution.pressure)
    load = case.mean * case.heights.size * case.body.pixel**2
    slack = rounding(found)
    return {
        "claimed": solution.residual,
        "true": found.error,
        "honest": found.error <= 1.01 * solution.residual + slack,
        "load": abs(found.load / load - 1),
        "converged": solution.converged,
        "kept": not solution.converged
        or found.error <= 1.01 * tolerance + slack
        or "exact up to" in str(solution.notes),
        "stepped": any("slow convergence" in note or "cautiously" in note for note in solution.notes),
        "notes": solution.notes,
        "iterations": solution.iterations,
        "solution": solution,
    }


def gap_table(names: list[str], count: int | None, verbose: bool) -> None:
    print(
        "| family | precision, tolerance | cases | converged | other method | claim below the truth | "
        "largest claim / truth excess | tolerance not kept | largest error of the load |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in names:
        for precision, tolerances in TOLERANCES.items():
            for tolerance in tolerances:
                rows = []
                for k, case in enumerate(cases(name, count)):
                    try:
                        row = check(case, precision, tolerance)
                    except Exception as error:
                        row = {"converged": False, "honest": False, "kept": False, "stepped": False, "load": 0.0}
                        row |= {"claimed": 0.0, "true": 0.0, "notes": (f"{type(error).__name__}: {error}",)}
                        row |= {"iterations": 0}
                    row.pop("solution", None)
                    if verbose and not (row["honest"] and row["converged"] and row["kept"] and not row["stepped"]):
                        print("   ", name, k, precision, tolerance, row, file=sys.stderr)
                    rows.append(row)
                excess = max((r["true"] / r["claimed"] for r in rows if not r["honest"] and r["claimed"]), default=1.0)
                print(
                    f"| {name} | {precision} {tolerance:g} | {len(rows)} | {sum(r['converged'] for r in rows)} | "
                    f"{sum(r['stepped'] for r in rows)} | {sum(not r['honest'] for r in rows)} | {excess:.1e} | "
                    f"{sum(not r['kept'] for r in rows)} | {max(r['load'] for r in rows):.0e} |",
                    flush=True,
                )


#: families, tolerance and precision for the estimate of the pressure error, and how many cases
ESTIMATES = (
    ("moderate", 1e-3, "mixed", 60),
    ("moderate", 1e-5, "mixed", 150),
    ("moderate", 1e-7, "mixed", 40),
    ("moderate", 1e-5, "single", 40),
    ("light", 1e-5, "mixed", 60),
    ("few_pixels", 1e-5, "mixed", 100),
    ("outliers", 1e-5, "mixed", 50),
    ("worn", 1e-5, "mixed", 60),
    ("layers", 1e-5, "mixed", 80),
)


def estimates(family: str, tolerance: float, precision: str, count: int, seed: int) -> np.ndarray:
    """Estimated over true error of the pressure, (n, 2): relative L2 norm and largest error over largest pressure.

    Cases whose pressure is exact up to rounding are left out.
    """
    rows = []
    for case in cases(family, count, seed):
        solution = case.solve(precision=precision, tolerance=tolerance)
        if case.heights.size <= 600:
            exact = dense_solution(case.body.matrix(case.heights.shape), case.heights, case.mean)
        else:
            exact = case.solve(precision="double", tolerance=1e-11 if family != "layers" else 1e-9).pressure
        difference = solution.pressure.astype(np.float64) - exact
        true = np.array([np.linalg.norm(difference) / np.linalg.norm(exact), np.abs(difference).max() / exact.max()])
        if true[0] > (3e-7 if precision == "single" else 1e-9):
            found = solution.convergence
            rows.append(np.array([found["pressure_error"], found["pressure_error_max"]]) / true)
    return np.array(rows).reshape(-1, 2)


def estimate_table(count: int | None, seed: int) -> None:
    print(
        "| family, tolerance, precision | cases | estimate / truth: L2 norm (least, median, largest) | largest error |"
    )
    print("| --- | --- | --- | --- |")
    found = []
    for family, tolerance, precision, number in ESTIMATES:
        ratios = estimates(family, tolerance, precision, number if count is None else count, seed)
        found.append(ratios)
        shown = [", ".join(f"{x:.2f}" for x in np.quantile(ratios[:, k], [0, 0.5, 1])) for k in (0, 1)]
        print(f"| {family} {tolerance:g} {precision} | {len(ratios)} | {shown[0]} | {shown[1]} |", flush=True)
    ratios = np.concatenate(found)
    inside = np.mean((ratios > 1 / 3) & (ratios < 3), axis=0)
    print(f"\n{len(ratios)} contacts: within a factor 3 {inside[0]:.1%} (L2), {inside[1]:.1%} (largest).")


MEASURED = ("area", "rms_pressure", "max_pressure", "displacement")
SOLVERS = ("fft-bem", "hardness", "layer", "single", "free", "sphere", "exponential", "dugdale", "adhesive sphere")
#: edge of a pixel, nm
SIZE = 0.5


def contact_of(solver: str, rng: np.random.Generator) -> tuple[Callable[[int], Surface], float, Any, dict[str, float]]:
    """A random contact: its surface on pixels divided by a number, load, solver, and what a closed form knows."""
    adheres = solver in SOLVERS[6:]
    n = int(rng.choice([40, 56] if adheres else [64, 96, 128]))
    work, reach, options, seed = 0.0, 0.0, {"modulus": MODULUS, "threads": 1}, int(rng.integers(1 << 30))
    if adheres:
        work = log_uniform(rng, 3e-3, 0.5)
        reach = float(np.sqrt(SIZE * work / MODULUS / log_uniform(rng, 0.1, 0.49)))
        law = str(rng.choice(["exponential", "dugdale"])) if solver == "adhesive sphere" else solver
        options |= {
            "work_of_adhesion": work,
            "range": reach,
            "law": law,
            "start": str(rng.choice(["apart", "contact"])),
        }
        options["tolerance"] = float(rng.choice([1e-3, 1e-4, 1e-5]))
    else:
        options["tolerance"] = float(rng.choice([1e-3, 1e-4, 1e-5, 1e-6]))
        options["precision"] = "single" if solver == "single" else str(rng.choice(["mixed", "double"]))
    if "sphere" in solver:
        radius = log_uniform(rng, 5, 300)
        edge = float(rng.uniform(1.2, (0.25 if adheres else 0.35) * n)) * SIZE
        load = 4 * MODULUS * edge**3 / 3 / radius

        def made(parts: int) -> Surface:
            return ca.surface("sphere", radius=radius, pixels=n * parts, pixel_size=SIZE / parts).make()

        known = {}
        if adheres:
            load = float(rng.choice([0.0, 0.3 * load, load, -0.6 * np.pi * work * radius]))
            maugis: Any = ca.contact("maugis", modulus=MODULUS, work_of_adhesion=work, range=reach)
            if options["law"] == "dugdale" and load > -maugis.pull_off(radius):
                state = maugis.at_load(radius, load)
                if state.outer < 0.45 * n * SIZE:
                    known = {"area": np.pi * state.edge**2, "displacement": state.displacement}
        elif rng.random() < 0.3:
            options["hardness"] = 1.5 * load / np.pi / edge**2 * float(rng.uniform(0.5, 0.98))
        else:
            known = {"area": np.pi * edge**2, "displacement": edge**2 / radius}
        return made, load, ca.contact("adhesive-bem" if adheres else "fft-bem", **options), known
    zeta = n / 2 ** rng.uniform(1, 4)
    shape = {"hurst": float(rng.choice([0.3, 0.5, 0.8])), "zeta": zeta, "eta": min(float(rng.choice([1, 3])), zeta / 2)}
    shape["rms_slope"] = log_uniform(rng, 1e-2, 0.8)

    def made(parts: int) -> Surface:
        return SelfAffine(pixels=n * parts, pixel_size=SIZE / parts, **shape).make(seed)

    pressure = MODULUS * shape["rms_slope"] * log_uniform(rng, 5e-4, 0.5)
    if adheres:
        pressure *= float(rng.random() < 0.75)
    if solver == "free" or (adheres and rng.random() < 0.25):
        options["boundary"] = "free"
    if solver == "layer":
        options |= {
            "thickness": SIZE * n * log_uniform(rng, 0.03, 3),
            "poisson_ratio": float(rng.choice([0, 0.25, 0.45])),
        }
    if solver == "hardness" or (solver == "single" and rng.random() < 0.5):
        options["hardness"] = max(MODULUS * shape["rms_slope"] * log_uniform(rng, 0.2, 1.6), 1.02 * pressure)
    return made, pressure * (n * SIZE) ** 2, ca.contact("adhesive-bem" if adheres else "fft-bem", **options), {}


def truth_of(contact: ContactSolution, known: dict[str, float]) -> dict[str, float]:
    """Area without the pixels of its rim, and the other measures, or what is known of them."""
    found = {name: contact.quantity(name).value for name in MEASURED}
    return found | {"area": contact.corrected_area} | known


def judged(solver: str, number: int, seed: int) -> dict[str, Any]:
    """A contact with what it states of its errors, on smaller pixels, and at a smaller tolerance."""
    made, load, chosen, known = contact_of(solver, np.random.default_rng([seed, SOLVERS.index(solver), number]))
    contact = chosen.solve(made(1), load)
    precise = {"tolerance": 1e-7, "max_iterations": 20000, "on_failure": "return"}
    precise |= {"precision": "double"} if "precision" in type(chosen).model_fields else {}
    tight = chosen.replace(**precise).solve(made(1), load)
    finer = chosen.replace(**precise | {"tolerance": 1e-5}).solve(made(4), load)
    exact = truth_of(finer, known)
    row: dict[str, Any] = {"solver": solver, "number": number, "pixels": int(contact.sites.size), "load": load}
    row |= {"patches": contact.patches, "factor": contact.convergence.get("pixel_factor", 1.0), "known": len(known)}
    row |= {"bare": contact.corrected_area, "options": {k: v for k, v in chosen.identity().items() if v}}
    for name in MEASURED:
        quantity, parts = contact.quantity(name), contact.errors[name]
        same = tight.quantity(name).value - quantity.value
        below, above = parts["iteration"]
        row[name] = {"value": quantity.value, "low": quantity.low, "high": quantity.high, "true": exact[name]}
        row[name] |= {"parts": parts, "same": same, "iterated": -below * 1.001 <= same + 1e-7 * abs(quantity.value)}
        row[name]["iterated"] &= same - 1e-7 * abs(quantity.value) <= above * 1.001
        slack = 1e-6 * abs(quantity.value)
        row[name]["holds"] = not (exact[name] < quantity.low - slack or exact[name] > quantity.high + slack)
        row[name]["known"] = bool(np.isfinite(quantity.low))
    return row


def interval_table(count: int, seed: int, rows_file: str | None) -> None:
    rows: list[dict[str, Any]] = []
    failed: dict[str, int] = {}
    for number in range(count):
        solver = SOLVERS[number % len(SOLVERS)]
        try:
            rows.append(judged(solver, number, seed))
        except (InputError, ConvergenceError) as error:
            failed[solver] = failed.get(solver, 0) + 1
            print(f"   {solver} {number}: {error}"[:150], file=sys.stderr)
            continue
        if rows_file:
            with Path(rows_file).open("a") as file:
                file.write(json.dumps(rows[-1], default=float) + "\n")
    print_intervals(rows, failed)


def print_intervals(rows: list[dict[str, Any]], failed: dict[str, int]) -> None:
    print("| solver | contacts | " + " | ".join(f"{m}: iteration; all; half width" for m in MEASURED) + " |")
    print("|---" * (2 + len(MEASURED)) + "|")
    for solver in (*SOLVERS, "all"):
        some = [row for row in rows if solver in ("all", row["solver"])]
        cells = []
        for name in MEASURED:
            known = [row[name] for row in some if row[name]["known"]]
            if not known:
                cells.append("-")
                continue
            width = np.median([(one["high"] - one["low"]) / 2 / (abs(one["value"]) or 1.0) for one in known])
            shares = [np.mean([one[key] for one in known]) for key in ("iterated", "holds")]
            cells.append(f"{shares[0]:.1%}; {shares[1]:.1%}; {width:.1%}")
        number = f"{len(some)}" + (f" ({failed[solver]} refused)" if solver in failed else "")
        print(f"| {solver} | {number} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*", default=[], help=f"some of {', '.join(FAMILIES)}, pressure, intervals")
    parser.add_argument("--count", type=int, help="cases per family")
    parser.add_argument("--seed", type=int, default=1, help="of the contacts for the estimate of the pressure error")
    parser.add_argument("--rows", help="file to which the contacts of intervals are appended")
    parser.add_argument("--verbose", action="store_true", help="print every case that is not plain success")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    names = [name for name in arguments.families or FAMILIES if name in FAMILIES]
    if "intervals" in arguments.families:
        interval_table(arguments.count or 500, arguments.seed, arguments.rows)
    if names:
        gap_table(names, arguments.count, arguments.verbose)
    if "pressure" in arguments.families or not arguments.families:
        print()
        estimate_table(arguments.count, arguments.seed)


if __name__ == "__main__":
    main()
