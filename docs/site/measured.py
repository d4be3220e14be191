"""Draw the figures of what was measured, from the tables in ``docs/data``: ``python docs/site/measured.py``."""

from __future__ import annotations

import csv
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

DOCS = Path(__file__).parents[1]
DATA = DOCS / "data"
#: name of a figure -> what draws it
FIGURES: dict[str, Any] = {}


def rows(name: str) -> list[dict[str, str]]:
    """The rows of a table; lines that begin with # say what it is."""
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def numbers(table: list[dict[str, str]], column: str) -> np.ndarray:
    return np.array([float(row[column]) for row in table])


def drawn(width: float, panels: int = 1) -> Any:
    """Register a function that draws into the axes of a figure of this many panels."""

    def register(function: Any) -> Any:
        def figure() -> Figure:
            made = Figure(figsize=(width, 3.6), layout="constrained")
            axes = made.subplots(1, panels, squeeze=False)[0]
            function(*axes)
            return made

        FIGURES[function.__name__] = figure
        return function

    return register


def diagonal(axes: Any, low: float, high: float, factor: float) -> None:
    """The line y = x, and the band of a factor around it."""
    ends = np.array([low, high])
    axes.fill_between(ends, ends / factor, ends * factor, color="0.9", label=f"within a factor of {factor:g}")
    axes.loglog(ends, ends, color="0.5", lw=1)


@drawn(9.5, panels=3)
def contact_benchmark(*panels: Any) -> None:
    """Error of the pressure against CPU time, one panel per grid, on the reference surface."""
    cases = json.loads((DATA / "contact_benchmark.json").read_text(encoding="utf-8"))
    cases = [case for case in cases if (case["hurst"], case["zeta"]) == (0.8, 150) and case["area"] < 1]
    for axes, grid in zip(panels, sorted({case["grid"] for case in cases}), strict=True):
        for number, case in enumerate(case for case in cases if case["grid"] == grid):
            ours = [solve for solve in case["ours"] if solve["precision"] == "mixed"]
            label = f"{case['pressure'] * 1e3:g} MPa, A/A₀ = {case['area']:.2g}"
            cpu, error = ([solve[key] for solve in ours] for key in ("cpu", "error"))
            axes.loglog(cpu, error, "o-", color=f"C{number}", markersize=4, label=label)
            for peer, marker in zip(case["peers"], "s^", strict=True):
                axes.loglog(peer["cpu"], peer["error"], marker, color=f"C{number}", markersize=8, mfc="none")
        axes.set(xlabel="CPU time (s)", title=f"{grid}² pixels")
        axes.legend(fontsize=7)
    panels[0].set_ylabel("relative error of the pressure")


@drawn(8)
def error_bars(axes: Any) -> None:
    """How often error bars hold the truth, less what they claim."""
    kinds = defaultdict(list)
    for row in rows("error_bars"):
        kinds[row["case"].replace("_", " ")].append(row)
    for height, bars in enumerate(reversed(kinds.values())):
        off = numbers(bars, "holds_percent") - numbers(bars, "claimed_percent")
        error = numbers(bars, "standard_error_percent")
        short = off + 2 * error < -2
        spread = height + np.linspace(-0.25, 0.25, len(bars)) if len(bars) > 1 else np.array([height])
        for chosen, color in ((~short, "C0"), (short, "C3")):
            axes.errorbar(off[chosen], spread[chosen], xerr=error[chosen], fmt="o", color=color, ms=3, lw=0.8)
    axes.axvline(0, color="0.5", lw=1)
    axes.set_yticks(range(len(kinds)), list(reversed(kinds)), fontsize=7)
    axes.set(xlabel="holds the truth, less what is claimed (percentage points)", xlim=(-20, 15))


@drawn(8, panels=2)
def site_errors(left: Any, right: Any) -> None:
    """Bonds on coarser contact grids less those on 2500² pixels."""
    times = {"1s": 1, "10s": 10, "100s": 100, "1000s": 1e3, "1e4s": 1e4, "1e5s": 1e5}
    for axes, pixels in ((left, "1250"), (right, "625")):
        for row in rows("site_errors"):
            if row["pixels_along_side"] == pixels:
                placed = row["sites_are"] == "placed"
                name = "sites placed below the pixel" if placed else "pixels repeated"
                label = name if row["seed"] == "3" else None
                values = [float(row[f"bonds_{time}_percent"]) for time in times]
                axes.semilogx(list(times.values()), values, "o-", color="C0" if placed else "C3", ms=4, label=label)
        axes.axhline(0, color="0.5", lw=1)
        axes.set(xlabel="hold time (s)", title=f"{pixels}² pixels", ylim=(-1, 8.5))
    left.set_ylabel("error of the bonds (%)")
    left.legend(fontsize=8)


@drawn(9, panels=2)
def approximations(left: Any, right: Any) -> None:
    """Errors of closure against hold time, and of persson against the area of contact."""
    table = rows("closure_errors")
    time = numbers(table, "hold_time_s")
    left.semilogx(time, numbers(table, "largest_error_percent"), "v-", color="C3", label="largest")
    left.semilogx(time, numbers(table, "rms_error_percent"), "o-", color="C0", label="rms")
    left.semilogx(time, numbers(table, "median_stated_percent"), "--", color="0.4", label="stated (median)")
    left.set(xlabel="hold time (s)", ylabel="error of the bonds (%)", title="closure", ylim=(0, None))
    left.legend(fontsize=8)
    table = rows("persson_errors")
    area = numbers(table, "area_fraction")
    for column, marker, label in (
        ("area_percent", "s", "contact area"),
        ("bonds_1000s_percent", "o", "bonds after 1000 s"),
        ("beta_percent", "v", "β"),
    ):
        right.semilogx(area, numbers(table, column), marker, mfc="none", label=label)
    right.axhline(0, color="0.5", lw=1)
    right.set(xlabel="A/A₀ of the solved contact", ylabel="error (%)", title="persson, not calibrated", ylim=(-50, 3))
    right.legend(fontsize=8)


@drawn(4.8)
def check_estimates(axes: Any) -> None:
    """CPU time that ``chemage check`` states, and measured."""
    table = [row for row in rows("check_estimates") if " to " not in row["cpu_s_estimated"]]
    diagonal(axes, 0.01, 10, 2)
    axes.loglog(numbers(table, "cpu_s_estimated"), numbers(table, "cpu_s_measured"), "o", color="C0")
    axes.set(xlabel="estimated CPU time (s)", ylabel="measured CPU time (s)")
    axes.legend(fontsize=8)


@drawn(4.8)
def contact_tolerance(axes: Any) -> None:
    """CPU time of the reference contact against its error."""
    table = rows("contact_tolerance")
    for precision in ("single", "mixed", "double"):
        chosen = [row for row in table if row["precision"] == precision]
        axes.semilogy(numbers(chosen, "cpu_s"), numbers(chosen, "pressure_error_l2"), "o", label=precision)
    axes.set(xlabel="CPU time (s)", ylabel="relative error of the pressure", xlim=(0, None))
    axes.legend(title="precision", fontsize=8)


@drawn(4.8)
def kinetics_sizes(axes: Any) -> None:
    """Time per event against the number of sites."""
    sizes = ["1e4", "1e5", "1e6", "1e7"]
    for row in rows("kinetics_sizes"):
        time = [float(row[f"ns_per_event_{size}_sites"]) for size in sizes]
        axes.semilogx([float(size) for size in sizes], time, "o-", label=row["engine"])
    axes.set(xlabel="sites", ylabel="time per event (ns)", ylim=(0, None))
    axes.legend(fontsize=8)


if __name__ == "__main__":
    folder = DOCS / "figures" / "measured"
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in FIGURES.items():
        figure().savefig(folder / f"{name}.png", dpi=110)
        print(name)
