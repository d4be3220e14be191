"""Errors of contact ``persson`` against solved contacts: the rows of Table 1 of the paper, loads of 5 to 500 µN.

Each surface is solved on 1250² pixels of 0.9036 nm. The bonds of both contacts are those of ageing ``closure``, so that
the differences are those of the contact alone: area, mean pressure, bonds after 1000 s, β. The last column is by how
much the bonds after 1000 s of the solved contact change if its rim is left out, as ``persson`` leaves it out. Run with
``python tests/benchmarks/persson_errors.py``; it takes about a minute, and writes a table in Markdown.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

import chemage as ca
from chemage_li2018.published import TABLE_1

LOADS = (5e3, 50e3, 500e3)
SLOPE, PIXELS, PIXEL = 0.1, 1250, 0.9036
MODULUS = 35.3


def compared(surface: Any, load: float, scene: ca.Scene) -> list[float]:
    """Relative errors of area, mean pressure, bonds after 1000 s and β; and the effect of the rim on the bonds."""
    chemistry = scene.chemistry
    assert chemistry is not None
    run: dict[str, Any] = {
        "engine": ca.engine("rejection-free"),
        "temperature": 300.0,
        "hold_times": ca.hold_times(1.0, 1e5, 4),
        "method": ca.ageing_method("closure"),
    }
    solved = ca.contact("fft-bem", modulus=MODULUS, gap=True).solve(surface.make(1), load)
    theory = ca.contact("persson", modulus=MODULUS).statistics(surface, load, 1)
    statistics = ca.plugin.contact_statistics(solved, chemistry)
    without = statistics.model_copy(update={"missing": None})
    curves = [ca.age(contact, chemistry, **run) for contact in (solved, theory, without)]
    at = int(np.argmin(np.abs(np.log(curves[0].hold_times / 1e3))))
    bonds = [curve.bonds[0, at] for curve in curves]
    beta = [curve.fit().beta for curve in curves]
    return [
        theory.contact_area / solved.corrected_area - 1,
        theory.mean_contact_pressure / (load / solved.corrected_area) - 1,
        bonds[1] / bonds[0] - 1,
        beta[1] / beta[0] - 1,
        bonds[2] / bonds[0] - 1,
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=0, help="only so many rows of Table 1; default: all")
    rows = parser.parse_args().rows
    scene = ca.parse_scene(ca.plugin.scene_data("silica-rough")[0])
    print("| H | ζ | η | load (µN) | A/A0 | area | mean pressure | bonds, 1000 s | β | without the rim |")
    print("|" + "---|" * 10)
    every = []
    for row in TABLE_1[: rows or None]:
        surface: Any = ca.surface(
            "self-affine",
            pixels=PIXELS,
            pixel_size=PIXEL,
            rms_slope=SLOPE,
            hurst=row.hurst,
            zeta=row.zeta,
            eta=row.eta,
        )
        for load in LOADS:
            errors = compared(surface, load, scene)
            every.append(errors)
            fraction = ca.plugin.theory.persson_area_fraction(load / (PIXELS * PIXEL) ** 2 / MODULUS / SLOPE)
            cells = " | ".join(f"{100 * error:+.1f}" for error in errors)
            print(
                f"| {row.hurst:g} | {row.zeta:g} | {row.eta:g} | {load / 1e3:g} | {fraction:.3g} | {cells} |",
                flush=True,
            )
    found = np.array(every)
    rms = ", ".join(f"{100 * math.sqrt(float(np.mean(one**2))):.1f}" for one in found.T)
    print(f"\nPer cent. rms of the columns: {rms}; largest area error {100 * np.abs(found[:, 0]).max():.1f}.")


if __name__ == "__main__":
    main()
