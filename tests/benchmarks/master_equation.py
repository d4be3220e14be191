"""Every engine with every option against the master equation of random small lattices.

    python tests/benchmarks/master_equation.py                 # 300 lattices, about 15 minutes of processor time
    python tests/benchmarks/master_equation.py --lattices 30 --runs 100 --engines bkl

The lattices have 2 to 9 sites with rates over 60 decades; see `random_hold` in `tests/stubs/flickering.py`. One of the
sites flickers, up to 60 times, and for options that can follow more of it up to 1e25 times on every other lattice. Each
is run to its hold time at once, or through up to two hold times before, or resumed at these. Printed are, for each
engine and option, the smallest p-value, and how probable all of them are if they are uniform (Kolmogorov and Smirnov);
every single one goes to the standard error.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from chemage.plugin import registry
from chemage.testing.small_systems import Group
from chemage_kinetics import engines

sys.path.insert(0, str(Path(__file__).parents[1] / "stubs"))
from flickering import GroupHold, chance_of, held, random_hold, solution

#: sites of the lattices, in turn; nine take half a second to solve, and a few attempts until one site is in doubt
SHAPES = ((1, 2), (1, 2), (2, 2), (1, 2), (2, 3), (1, 2), (1, 2), (2, 2), (1, 3), (2, 3)) * 2
SHAPES = (*SHAPES[:-1], (3, 3))
#: option -> values; of the options that an engine does not have the first is meant
OPTIONS = {"superbasins": (False, True), "threads": (1, 2)}


def variants(kinds: list[str]) -> list[tuple[str, dict[str, object]]]:
    """Engines with all combinations of their options."""
    found = []
    for kind in kinds:
        names = [name for name in OPTIONS if name in registry.current().component("engine", kind).model_fields]
        for values in itertools.product(*(OPTIONS[name] for name in names)):
            found.append((kind, dict(zip(names, values, strict=True))))
    return found


def uncoupled(hold: GroupHold) -> GroupHold:
    """The same sites without interaction."""
    group = Group(hold.group.forming, hold.group.breaking)
    first = 2 ** len(group.forming) - 1 if hold.start else 0
    probabilities, events = solution(group, hold.time, hold.temperature, first)
    return replace(hold, group=group, probabilities=probabilities, events=events)


def main() -> None:
    """Run the lattices and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lattices", type=int, default=300)
    parser.add_argument("--runs", type=int, default=200, help="runs of every lattice with every engine and option")
    parser.add_argument("--first", type=int, default=0, help="number of the first lattice")
    parser.add_argument("--engines", nargs="*", default=registry.current().kinds("engine"))
    options = parser.parse_args()
    engines.PIECE = engines.SITE_PIECE = 1  # so that threads share small lattices
    chances: dict[str, list[float]] = defaultdict(list)
    seconds: dict[str, float] = defaultdict(float)
    worst = []
    for number in range(options.first, options.first + options.lattices):
        shape = SHAPES[number % len(SHAPES)]
        calm = random_hold(number, *shape)
        hot = random_hold(number, *shape, flips=1e25) if number % 2 else calm
        for at, (kind, values) in enumerate(variants(options.engines)):
            rng = np.random.default_rng((number, at))
            engine = registry.current().make("engine", kind, values)
            hold = hot if values.get("superbasins") or not engine.interacting else calm
            if not engine.interacting or (kind == "auto" and number % 5 == 0):
                hold = uncoupled(hold)
            # only `next-reaction` follows a site that flickers in each of several patches
            copies = 1 if values.get("superbasins") and kind in ("bkl", "rejection-free") else int(rng.integers(1, 4))
            through = np.sort(10.0 ** -rng.exponential(2.0, int(rng.integers(3))))
            began = time.process_time()
            counts = held(
                engine, hold, copies, -(-options.runs // copies), through=through.tolist(), restart=rng.uniform() < 0.5
            )
            name = " ".join([kind, *(f"{option}={value}" for option, value in values.items())])
            chances[name].append(chance_of(counts, hold.probabilities, rng))
            seconds[name] += time.process_time() - began
            worst.append((chances[name][-1], name, number))
            print(f"{number}\t{name}\t{chances[name][-1]:.6g}", file=sys.stderr, flush=True)
    print("| engine and options | lattices | smallest p-value | p-value of uniformity | CPU s |")
    print("| --- | --- | --- | --- | --- |")
    everything = np.concatenate(list(chances.values()))
    for name, values in [*chances.items(), ("all", everything)]:
        even = stats.kstest(values, "uniform").pvalue
        print(f"| {name} | {len(values)} | {min(values):.2g} | {even:.2g} | {seconds[name]:.0f} |")
    for chance, name, number in sorted(worst)[:5]:
        print(f"lattice {number}, {name}: p = {chance:.2g}")


if __name__ == "__main__":
    main()
