"""Does a contact remember a load? Bonds after the load has fallen, against time: python tests/benchmarks/load_memory.py

A piece of self-affine silica rests for t₁ under F₁ and then under F₂ < F₁, as in Dillavou and Rubinstein, Phys. Rev.
Lett. 120, 224101 (2018), where area and friction first fall and then rise. For each programme: bonds lost at once, with
their sites; the largest fall of the mean after that, in % of the bonds just after the step and in standard errors of
replicas; when it is reached, and when the mean is above its value just after the step again, for good.
"""

from __future__ import annotations

import argparse

import numpy as np

import chemage as ca

#: nominal pressure under F₁, MPa
PRESSURE = 60.0


def after_the_step(share: float, first: float, then: float, breaking: float, replicas: int, **chemistry):
    """Times after the step (s), bonds of each replica, and how many were lost at once."""
    data = ca.load_scene("silica-patch").todict()
    for name in ("fit", "observe"):
        data.pop(name, None)
    data["surface"]["pixels"] = 256
    data["contact"]["load"] = f"{PRESSURE:g} MPa"
    data["breaking"] |= {"mean": breaking}
    data["hold"] = {"replicas": replicas, "temperature": 300}
    data["chemistry"] = {**data.get("chemistry", {}), **chemistry}
    steps = [{"duration": first}, {"load": f"{share * PRESSURE:g} MPa", "duration": then, "points": 60}]
    ageing = ca.run({**data, "step": steps}, warn=False).ageing
    seen = ageing.observables
    own = np.arange(ageing.hold_times.size) >= int(seen["step_points"][0, 0])
    times = ageing.hold_times[own] - ageing.hold_times[own][0]
    return times, ageing.bonds[:, own].astype(float), seen["step_lost"][:, 1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicas", type=int, default=60)
    parser.add_argument("--then", type=float, default=1e7)
    parser.add_argument("--breaking", type=float, nargs="+", default=[1.1])
    parser.add_argument("--share", type=float, nargs="+", default=[0.9, 0.5, 0.1])
    parser.add_argument("--first", type=float, nargs="+", default=[1e2, 1e3, 1e4, 1e5, 1e6])
    chosen = parser.parse_args()
    for breaking in chosen.breaking:
        for share in chosen.share:
            for first in chosen.first:
                times, bonds, lost = after_the_step(share, first, chosen.then, breaking, chosen.replicas)
                change = bonds - bonds[:, :1]
                mean, error = change.mean(axis=0), change.std(axis=0, ddof=1) / len(bonds) ** 0.5
                at = int(np.argmin(mean))
                begun = bonds[:, 0].mean()
                rise = bonds[:, -1] - bonds[:, at]
                rise, spread = rise.mean(), rise.std(ddof=1) / rise.size**0.5
                below = np.flatnonzero(mean < 0)
                again = "never below" if not below.size else "not again"
                if below.size and below[-1] + 1 < times.size:
                    again = f"above again from {times[below[-1] + 1]:.2g} s"
                print(
                    f"breaking {breaking:g} eV, F2/F1 {share:g}, t1 {first:g} s: {begun:.1f} bonds, "
                    f"{lost.mean():.1f} lost at once; falls by {-100 * mean[at] / begun:.2f} % "
                    f"({-mean[at] / max(error[at], 1e-9):.1f} s.e.) at {times[at]:.2g} s, {again}; "
                    f"then rises by {100 * rise / begun:.2f} % ({rise / max(spread, 1e-9):.1f} s.e.)",
                    flush=True,
                )


if __name__ == "__main__":
    main()
