"""What an accuracy costs, beside the cheapest settings that somebody who knew everything would choose.

    python tests/benchmarks/price.py FILE [first last]      # scenes 1000 to 1009: half an hour, resumable
    python tests/benchmarks/price.py FILE --table
    python tests/benchmarks/price.py FILE reference         # the scene silica-rough

For each scene, `ca.ensemble` is asked for 5, 2 and 1 % of β, and its CPU time is compared with two others, from
what is measured on a few surfaces with each grid (CPU seconds, bias against the scene's own grid) and from the
scatter between surfaces and between replicas:

- the oracle: the grid, the replicas r and the number n of surfaces that are cheapest for somebody who knows scatter and
  bias, and so needs no pilot and no corrections, but shows the interval from these surfaces: Student's limit for n - 1
  times the root of (surfaces + replicas/r) / n, which fits into the root of accuracy² - bias²;
- the naive way: the scene's own grid with ten replicas on each surface, and the n of the oracle for it.

In brackets is the ratio to an oracle that need not show its interval, with 1.96 in place of Student's limit and two
surfaces at least.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path

import numpy as np
from scipy import stats
from unseen_scenes import unseen

import chemage as ca
from chemage.studies.ensembles.computations import computations
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.running import Sampler

ASKED = (0.05, 0.02, 0.01)
SURFACES, REPLICAS = 6, 10
CHOICES = (1, 2, 3, 5, 10)
NORMAL = 1.96


def needed(variance: float, width: float, shown: bool) -> int:
    """Samples of which the 95 % interval has at most this half width."""
    count = max(2, math.ceil(NORMAL**2 * variance / width**2))
    while shown and stats.t.ppf(0.975, count - 1) * math.sqrt(variance / count) > width:
        count += 1
    return count


def measured(scene: ca.Scene) -> dict[str, object]:
    """The dial's price, and what the oracle knows."""
    scene = scene.completed()
    computed = computations(scene.model_copy(update={"ensemble": None, "accuracy": {}}))
    for one in computed:  # compiled before anything is timed
        one.compute(1, 1)
    dial: dict[str, list[float]] = {}
    made: ca.Ensemble | None = None
    for asked in ASKED:
        begin = time.process_time()
        sampler = Sampler(with_request(scene, accuracy={"beta": asked}))
        made = sampler.run()
        cpu = time.process_time() - begin
        dial[str(asked)] = [cpu, *[int(level["samples"]) for level in made.levels]]
    assert made is not None
    beta = made.rows["0"][:, 0]  # the last has most samples
    scatter = float(beta.std(ddof=1) / beta.mean())
    quantities = made.quantities
    grids, own = [], None
    for one in reversed(computed):
        rows, contact, replica, within = [], [], [], []
        for seed in range(SURFACES):
            begin = time.process_time()
            few = one.with_replicas(1).compute(700 + seed, 700 + seed)
            middle = time.process_time()
            many = one.with_replicas(REPLICAS).compute(700 + seed, 700 + seed)
            end = time.process_time()
            del few
            each = ((end - middle) - (middle - begin)) / (REPLICAS - 1)
            replica.append(each)
            contact.append((middle - begin) - each)
            rows.append(quantities.row(many)[0])
            within.append(quantities.replica_rows(many)[:, 0].var(ddof=1))
        beta = np.array(rows)
        own = beta if own is None else own
        change = beta / own - 1
        grids.append(
            {
                "factor": one.factor,
                "contact": float(np.median(contact)),
                "replica": max(float(np.median(replica)), 1e-4),
                "bias": float(change.mean()),
                "bias_error": float(change.std(ddof=1) / math.sqrt(SURFACES)),
                "replicas": math.sqrt(float(np.mean(within))) / float(own.mean()),
            }
        )
    return {"name": scene.name, "dial": dial, "scatter": scatter, "grids": grids}


def prices(line: dict, asked: float, shown: bool) -> tuple[float, float, str]:
    """CPU seconds of the oracle and of the naive way, and what the oracle chooses."""
    replicas = line["grids"][0]["replicas"] ** 2
    # the first level of the dial has one replica a surface
    surfaces = max(line["scatter"] ** 2 - replicas, 1e-8)
    found = []
    for grid in line["grids"]:
        left = asked**2 - grid["bias"] ** 2
        if left <= 0:
            continue
        for r in CHOICES:
            count = needed(surfaces + replicas / r, math.sqrt(left), shown)
            cost = count * (grid["contact"] + r * grid["replica"])
            found.append((cost, f"{count} surfaces, pixels x {grid['factor']}, {r} replicas"))
    grid = line["grids"][0]
    naive = needed(surfaces + replicas / 10, asked, shown)
    best, words = min(found)
    return best, naive * (grid["contact"] + 10 * grid["replica"]), words


def table(lines: list[dict]) -> None:
    """Prices of each scene, and the ratios."""
    for asked in ASKED:
        ratios = []
        for line in lines:
            dial, *counts = line["dial"][str(asked)]
            best, naive, words = prices(line, asked, shown=True)
            limit, *_ = prices(line, asked, shown=False)
            ratios.append(dial / best)
            print(
                f"{line['name']:12s} {100 * asked:g} %: dial {dial:7.1f} s {counts}, oracle {best:7.1f} s ({words}), "
                f"naive {naive:7.1f} s; dial/oracle {dial / best:.2f} ({dial / limit:.2f}), "
                f"naive/dial {naive / dial:.1f}"
            )
        print(f"{100 * asked:g} %: dial/oracle median {np.median(ratios):.2f}, largest {max(ratios):.2f}")


def main() -> None:
    path = Path(sys.argv[1])
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    words = sys.argv[2:]
    scenes = []
    if words == ["reference"]:
        scenes = [ca.load_scene("silica-rough")]
    elif words != ["--table"]:
        first, last = (int(word) for word in words) if words else (1000, 1009)
        scenes = [unseen(number) for number in range(first, last + 1)]
    for scene in scenes:
        if any(line["name"] == scene.name for line in lines):
            continue
        lines.append(measured(scene))
        with open(path, "a") as stream:
            stream.write(json.dumps(lines[-1]) + "\n")
        print(scene.name, flush=True)
    table(lines)


if __name__ == "__main__":
    main()
