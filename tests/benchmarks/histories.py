"""Programmes of steps beside single runs, and slip against the transport equation.

python tests/benchmarks/histories.py loads --pixels 512 --count 20
python tests/benchmarks/histories.py holds --sites 1000000
python tests/benchmarks/histories.py chains --count 200
python tests/benchmarks/histories.py slip
python tests/benchmarks/histories.py maximum
python tests/benchmarks/histories.py peaks
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import chemage as ca

ROOT = Path(__file__).parents[2]
sys.path += [str(ROOT / "tests" / "stubs"), str(ROOT / "tests" / "history")]


def spent(task) -> tuple[float, object]:
    """CPU seconds of this process, and what came of it."""
    begin = time.process_time()
    done = task()
    return time.process_time() - begin, done


def loads(pixels: int, count: int) -> None:
    """A programme of loads up and down beside as many runs."""
    data = ca.load_scene("silica-rough").todict()
    for name in ("fit", "observe"):
        data.pop(name, None)
    share = pixels / 2500
    data["surface"] |= {"pixels": pixels, "zeta": data["surface"]["zeta"] * share}
    data["hold"] = {"replicas": 1, "temperature": 300}
    full = data["contact"]["load"] * share**2
    up = np.linspace(1, 5, count // 2)
    values = [full * float(one) for one in (*up, *up[::-1] - 0.2)]
    steps = [{"load": load, "duration": 100.0} for load in values]
    scene = ca.parse_scene({**data, "step": steps})
    warm = {**data, "surface": {**data["surface"], "pixels": 64, "zeta": 16}}
    ca.run({**warm, "contact": {**data["contact"], "load": 100.0}, "step": steps[:1]}, warn=False)
    programme, run = spent(lambda: ca.run(scene, threads=1, warn=False))
    singles = 0.0
    for load in values:
        single = {**data, "contact": {**data["contact"], "load": load}, "step": [{"duration": 100.0}]}
        singles += spent(lambda single=single: ca.run(single, threads=1, warn=False))[0]
    print(f"{count} loads on {pixels}²: programme {programme:.1f} s, single runs {singles:.1f} s of CPU")
    print(
        f"bonds {run.aging.bonds[0, -1]}, contact {run.timings['contact']:.1f} s, steps {run.timings['ageing']:.1f} s"
    )


def holds(sites: int) -> None:
    """Independent sites through a slide-hold-slide of four holds."""
    from pulled_models import lattice_of
    from test_slip import SLIDER

    from chemage_history import Programme
    from chemage_history.programme import follow

    protocol = {"kind": "slide-hold-slide", "speed": 10.0, "distance": 0.6, "holds": [0.1, 1.0, 10.0, 100.0]}
    programme = Programme(protocol=protocol, drive=SLIDER)
    for n in (100, sites):
        lattice = lattice_of(n, 0.7, 1.1)

        def chain(lattice=lattice):
            state = None
            for segment in programme.segments:
                state = follow(segment, lattice, state, ca.engine("auto"), SLIDER, temperature=300)
            return state

        seconds, end = spent(chain)
    print(f"{sites} sites, four holds: {seconds:.1f} s of CPU, {int(end.formed[-1] + end.broken[-1])} events")


def chains(count: int) -> None:
    """Random programmes at once, by hand and in pieces."""
    from test_slip import chain_trial

    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            chain_trial(seed, Path(folder) / str(seed))
    print(f"{count} random programmes: same bytes")


def slip(decades: int, bonds: float, most: float) -> None:
    """All figures of equal sites, for k_on of 1 to 10⁴ /s and 0.01 to 10⁴ nm/s."""
    from test_slip import slip_figures

    every = {}
    for k_on in 10.0 ** np.arange(decades):
        for speed in 10.0 ** np.arange(-2, -2 + 7 * decades // 5):
            seconds, answer = spent(lambda k=k_on, v=speed: slip_figures(k, v, bonds, most, 20))
            shown = ", ".join(f"{name} {100 * off:+.2f} ± {100 * error:.2f}" for name, (off, error) in answer.items())
            print(f"{k_on:g}/s, {speed:g} nm/s: {shown} % ({seconds:.0f} s)", flush=True)
            largest = answer.pop("largest of a replica")
            every[k_on, speed] = np.array(list(answer.values())), largest
    values = np.array([one for one, _ in every.values()])
    names = list(answer)
    print(
        f"{'':24}rms, largest in standard errors; weighted mean, largest, and largest where errors are below 1/3, in %"
    )
    for number, name in enumerate(names):
        off, error = values[:, number].T
        there = error > 0
        z, small = off[there] / error[there], there & (error < 0.0033)
        weights = error[there] ** -2.0
        mean, spread = np.average(off[there], weights=weights), weights.sum() ** -0.5
        print(
            f"{name:24}{np.sqrt(np.mean(z**2)):.2f} {np.abs(z).max():.2f}; {100 * mean:+.3f} ± {100 * spread:.3f}, "
            f"{100 * np.abs(off).max():.2f}, {100 * np.abs(off[small]).max(initial=0.0):.2f} ({small.sum()} of {off.size})"
        )


def maximum(decades: int, bonds: float) -> None:
    """Where steady friction is largest (Schallamach), over k_on."""
    from test_slip import place_of_maximum

    for k_on in 10.0 ** np.arange(decades):
        exact, found, error = place_of_maximum(k_on, bonds, 20)
        print(f"k_on {k_on:g}/s: V*/k_on {exact:.5f} nm, measured {found:.5f} ± {error:.5f} nm", flush=True)


def peaks() -> None:
    """The peak of a pull of sites all of which are bonded at first, over κ max(sS), towards slow pulls."""
    from test_slip import peak_after_rest

    for speed in 10.0 ** np.arange(-4, 5):
        force, mean, error, old = peak_after_rest(1.0, speed, 1_000_000)
        print(
            f"{speed:g} nm/s: {force:.4f} ± {error:.4f} nN per site (transport equation {mean:.4f}), "
            f"{force / old:.3f} of that of old bonds alone",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["loads", "holds", "chains", "slip", "maximum", "peaks"])
    parser.add_argument("--pixels", type=int, default=512)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--sites", type=int, default=1_000_000)
    parser.add_argument("--decades", type=int, default=5)
    parser.add_argument("--bonds", type=float, default=1e5)
    parser.add_argument("--most", type=float, default=4e6)
    chosen = parser.parse_args()
    if chosen.what == "loads":
        loads(chosen.pixels, chosen.count)
    elif chosen.what == "holds":
        holds(chosen.sites)
    elif chosen.what == "slip":
        slip(chosen.decades, chosen.bonds, chosen.most)
    elif chosen.what == "maximum":
        maximum(chosen.decades, chosen.bonds)
    elif chosen.what == "peaks":
        peaks()
    else:
        chains(chosen.count)


if __name__ == "__main__":
    main()
