"""Whether a budget is kept, and what twice the time gives.

    python tests/benchmarks/budget.py [SCENE SECONDS REPEATS]     # silica-patch, 6 s, 8 times: two and a half minutes

Each repetition has other seeds. Wall time includes everything that ``ca.ensemble`` does. An idle machine is needed.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import chemage as ca


def main() -> None:
    name, seconds, repeats = sys.argv[1:] if len(sys.argv) == 4 else ("silica-patch", "6", "8")
    scene = ca.load_scene(name).completed()
    assert scene.hold is not None
    ca.ensemble(scene, surfaces=2)  # compiles
    budgets = (float(seconds), 2 * float(seconds))
    widths, walls = [], []
    for number in range(int(repeats)):
        hold = scene.hold.model_copy(update={"seed": 100 + number})
        other = scene.model_copy(update={"surface_seed": 100 + number, "hold": hold})
        row = []
        for budget in budgets:
            begin = time.monotonic()
            made = ca.ensemble(other, budget=budget)
            walls.append((time.monotonic() - begin) / budget)
            row.append(made.estimate("beta").relative)
            print(
                f"budget {budget:g} s: {walls[-1] * budget:.2f} s, {made.surfaces} surfaces, ± {100 * row[-1]:.2f} %",
                flush=True,
            )
        widths.append(row)
    ratio = np.median([first / second for first, second in widths])
    print(f"{name}: time over budget at most {max(walls):.3f}, median {np.median(walls):.3f}")
    print(f"twice the time: interval narrower by {ratio:.2f} (median of {repeats}); sqrt(2) is 1.41")


if __name__ == "__main__":
    main()
