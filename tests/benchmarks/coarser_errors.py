"""How far the answers of a coarser contact grid, with the sites in place, are from those of a scene's own grid.

    python tests/benchmarks/coarser_errors.py FILE [first last]     # scenes 0 to 27: an hour, goes on where it stopped
    python tests/benchmarks/coarser_errors.py FILE --table

On six surfaces of each scene of ``unseen_scenes.py`` the kinetics of six replicas have the same random numbers on both
grids. Scenes are ordered by the pixel size times perimeter over area of the coarse contact, of which the square is in
proportion to the errors; ``COARSER_ERRORS`` of the self-affine surface is the root mean square of what the last line
says, rounded up. The scenes from 1000 on, on which promises are tested, take no part.
"""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path

import numpy as np
from unseen_scenes import unseen

from chemage.studies.ensembles.computations import computations
from chemage.studies.ensembles.goals import Request, with_request

SURFACES, REPLICAS = 6, 6


def measured(number: int) -> list[dict[str, float]]:
    """Relative differences on each surface, for each coarser grid that pays."""
    scene = unseen(number)
    quantities = Request.of(with_request(scene, accuracy={"beta": 0.02})).quantities
    first, size = int(quantities.has_beta), quantities.hold_times.size
    late = np.flatnonzero(quantities.hold_times >= 1.0)
    *coarser, own = (one.with_replicas(REPLICAS) for one in computations(scene))
    found = []
    for seed in range(500, 500 + SURFACES):
        fine = own.compute(seed, seed)
        row = quantities.row(fine)
        for one in coarser:
            coarse = one.compute(seed, seed)
            change = quantities.row(coarse) / row - 1
            curve = change[first : first + size][late]
            found.append(
                {
                    "scene": number,
                    "factor": one.factor,
                    "pixels_per_wavelength": scene.surface.pixels[0] / scene.surface.zeta / one.factor,  # pyright: ignore[reportAttributeAccessIssue]
                    **{name: coarse.measures[name] for name in ("area_fraction", "patches", "perimeter_to_area")},
                    "pixel_size": scene.surface.pixel_size * one.factor,  # pyright: ignore[reportAttributeAccessIssue]
                    "true_area_fraction": fine.measures["area_fraction"],
                    "hurst": scene.surface.hurst,  # pyright: ignore[reportAttributeAccessIssue]
                    "beta": float(change[0]),
                    "friction_drop": float(np.sqrt(np.mean(curve**2))),
                    "friction_drop_mean": float(curve.mean()),
                }
            )
    return found


def table(lines: list[dict[str, float]]) -> None:
    """Means over the surfaces of each scene, and errors over the square of pixel size times perimeter over area."""

    def of_scene(line: dict[str, float]) -> tuple[float, float]:
        return line["scene"], line["factor"]

    rows = []
    for (number, factor), group in itertools.groupby(sorted(lines, key=of_scene), key=of_scene):
        own = list(group)
        of = {name: np.array([line[name] for line in own]) for name in own[0]}
        rim = float((of["perimeter_to_area"] * of["pixel_size"]).mean())
        wavelength, area = of["pixels_per_wavelength"][0], of["area_fraction"].mean()
        words = f"scene {number:.0f}, pixels x {factor:.0f}, {wavelength:4.1f} per wavelength, A/A0 {area:.4f}"
        error = float(of["beta"].std(ddof=1) / np.sqrt(SURFACES))
        rows.append((rim, words, float(of["beta"].mean()), error, float(np.sqrt(np.mean(of["friction_drop"] ** 2)))))
    rows.sort()
    for rim, words, beta, error, drop in rows:
        print(f"{rim:.3f}  {words}: beta {100 * beta:+.2f} ± {100 * error:.2f} %, friction drop rms {100 * drop:.2f} %")
    rims, betas, drops = (np.array([row[k] for row in rows]) for k in (0, 2, 4))
    half = rims.size // 2
    for name, values in (("beta", betas), ("friction drop", drops)):
        parts = [float(np.sqrt(np.mean(one**2))) for one in ((values / rims**2)[:half], (values / rims**2)[half:])]
        every = float(np.sqrt(np.mean((values / rims**2) ** 2)))
        print(f"{name}: rms {100 * every:.2f} % of the square ({100 * parts[0]:.2f} below, {100 * parts[1]:.2f} above)")


def main() -> None:
    path = Path(sys.argv[1])
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    if "--table" not in sys.argv:
        first, last = (int(word) for word in sys.argv[2:4]) if len(sys.argv) > 3 else (0, 27)
        for number in range(first, last + 1):
            if any(line["scene"] == number for line in lines):
                continue
            new = measured(number)
            lines += new
            with open(path, "a") as stream:
                stream.writelines(json.dumps(line) + "\n" for line in new)
            print(f"scene {number}: {len(new)} differences", flush=True)
    table(lines)


if __name__ == "__main__":
    main()
