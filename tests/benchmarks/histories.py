"""Programmes of steps beside single runs, and slip against the transport equation.

python tests/benchmarks/histories.py loads --pixels 512 --count 20
python tests/benchmarks/histories.py holds --sites 1000000
python tests/benchmarks/histories.py chains --count 200
python tests/benchmarks/histories.py slip --k-on 1 1e4 --speed 0.01 1e4
python tests/benchmarks/histories.py maximum
python tests/benchmarks/histories.py peaks
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import numba as nb
import numpy as np

import chemage as ca
from chemage.plugin import pull
from chemage_kinetics import _pulling as kernel
from chemage_kinetics.pulling import _Job as kernel_job

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
        f"bonds {run.ageing.bonds[0, -1]}, contact {run.timings['contact']:.1f} s, steps {run.timings['ageing']:.1f} s"
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


class FewBonds:
    """Equal sites few of which are bonded at a time: the kernel of the pull itself follows them through steps without
    end, because to hand over a million sites at every step would take a hundred times as long as their few events."""

    def __init__(self, sites: int, model) -> None:
        from pulled_models import lattice_of

        how = lattice_of(sites, model.forming, 0.8), np.zeros(1), 300.0, 0, None, model.drive, None
        run = kernel_job("event-driven", *how).prepared()
        # of no size to what sums the energy of all bonds, which nobody needs here
        self.run, self.sites, self.time = run._replace(words=run.words[:0]), sites, 0.0

    def go(self, speed: float, times) -> np.ndarray:
        """(m, 2) force (nN) and work (nN nm) of the drive, per site, at ``times`` (s) of a step at this speed."""
        seen = self.time + np.asarray(times)
        fresh = {"samples": np.zeros((seen.size, 6)), "tallies": np.zeros((seen.size, 3), np.int64)}
        run = self.run = self.run._replace(drive=self.run.drive._replace(speed=speed), times=seen, **fresh)
        run.counts[[kernel.HOLD, kernel.DONE]] = 0
        while not run.counts[kernel.DONE]:
            kernel.advance(run, None, 1 << 19)
        self.time = float(seen[-1])
        halt(run, self.time)
        return run.samples[:, [kernel.FORCE, kernel.WORKED]] / self.sites

    def stretches(self) -> np.ndarray:
        """nm, of all bonds."""
        out = np.empty(self.run.counts[kernel.BONDS])
        listed(self.run, out)
        return out


@nb.njit
def halt(run, time):
    """Go to ``time`` (s), before which nothing happens."""
    span = time - run.reals[kernel.HIGH] - run.reals[kernel.LOW]
    work, _, way = kernel._work(run, span)
    run.reals[kernel.LEFT] = max(run.reals[kernel.LEFT] - kernel.tree_total(run.rates) * span, 0.0)
    kernel._two_sum(run.reals, kernel.WORK, work)
    run.reals[kernel.HIGH], run.reals[kernel.LOW] = time, 0.0
    kernel._shift(way, run)


@nb.njit
def listed(run, out):
    """The stretch of every bond, nm."""
    n = 0
    for slot in range(run.heads.size):
        i = run.heads[slot]
        while i >= 0:
            out[n] = kernel._present_stretch(i, run)
            n += 1
            i = run.links[i, 0]


def few_bonds(k_on: float, speed: float, names: set[str], error: float) -> dict[str, tuple[float, float]]:
    """The figures ``names`` of `slip_figures`, of sites that go through the steps again and again until the
    standard errors are ``error``. There is no long hold, in which all sites would bind: the force after one is that of
    the bonds of steady sliding alone, which are collected for it."""
    from test_slip import slip_programme

    model, exact, steps = slip_programme(k_on, speed, holds=["short"])
    slide = model.mean_stretch / speed
    contact = FewBonds(int(np.clip(1e3 * (1 + 1 / (k_on * slide)), 1e5, 4e6)), model)
    contact.go(speed, [40 * slide])
    chain = dict(zip(exact, steps, strict=True))
    chain.pop("steady")
    noise = {name: variance / mean**2 for name, (mean, variance) in exact.items() if variance}
    wanted = {name: noise[name] / error**2 / contact.sites for name in noise.keys() & names}
    # the least force of the step down takes the most, and nothing but the two speeds
    often = ["peak of the step up", "faster", "least of the step down"]
    full = max((wanted[name] for name in wanted if name != often[-1]), default=0.0)
    seen: dict[str, list[float]] = {name: [] for name in chain}
    for number in range(max(10, math.ceil(max(wanted.values(), default=0.0)))):
        whole = number < max(10, full)
        for name in chain if whole else often:
            moving, times = chain[name]
            times = times if whole or name != often[-1] else np.append(times[:2], times[1] + 6 * slide)
            rows = contact.go(moving, times[1:])
            mean = np.diff(rows[:, 1])[-1] / np.diff(times)[-1] / moving if moving else 0.0
            seen[name].append(mean if exact[name][1] is None else rows[0, 0])
    answer = {}
    for name in names & {*chain}:
        mean, variance = exact[name]
        found = np.array(seen[name])
        spread = found.var(ddof=1) if variance is None else variance / contact.sites
        answer[name] = (found.mean() / mean - 1, (spread / found.size) ** 0.5 / mean)
    if names & {"steady", "after a long hold"}:
        answer |= long_hold(k_on, speed, contact, error)
    return answer


def long_hold(k_on: float, speed: float, contact: FewBonds, error: float) -> dict[str, tuple[float, float]]:
    """Steady force, and force after the long hold of the bonds of steady sliding."""
    from pulled_models import Transport, lattice_of
    from test_slip import SLIDER, at, slip_programme

    model, exact, steps = slip_programme(k_on, speed, holds=["long"])
    force, variance = exact["after a long hold"]
    long, transport = steps[1][1][-1], Transport(model)
    bonds: list[np.ndarray] = []
    works = []
    # by so far that hardly a bond that will survive is seen twice: the rate grows e-fold within 0.0083 nm
    way, count = min(4 * model.mean_stretch, model.mean_stretch + 0.04), 10
    slides = math.ceil(variance / force**2 / error**2 / contact.sites / count)
    for _ in range(count):
        begin = contact.go(speed, [0.0])[0, 1]
        for _ in range(slides):
            end = contact.go(speed, [way / speed])[0, 1]
            stretch = contact.stretches()
            # others survive with a probability of less than e^-40
            bonds.append(stretch[transport.breaking(stretch) * long < 40])
        works.append((end - begin) / (slides * way * model.mean_force))
    stretch = np.concatenate(bonds)
    # those that form at rest bear no force
    lattice = lattice_of(stretch.size, 3.0, 0.8)
    start = pull(SLIDER.engine, lattice, at(0.0), [0.0], temperature=300, start=np.ones(stretch.size, bool))
    kappa = model.drive.bond_stiffness
    energy, all_of_them = np.array([kappa * (stretch**2).sum() / 2]), np.array([kappa * stretch.sum()])
    start = start.handed_on().model_copy(
        update={"stretch": stretch, "force": all_of_them, "peak": all_of_them[0], "work": energy, "stored": energy}
    )
    held = pull(SLIDER.engine, lattice, at(0.0), [long], temperature=300, start=start)
    sites = count * slides * contact.sites
    return {
        "after a long hold": (held.force[-1] / sites / force - 1, (variance / sites) ** 0.5 / force),
        "steady": (np.mean(works) - 1, np.std(works, ddof=1) / count**0.5),
    }


def slip_case(k_on: float, speed: float, most: int, error: float) -> dict[str, tuple[float, float]]:
    """All figures of one case; those with larger errors than ``error`` are of the few bonds there are, which go on."""
    from test_slip import slip_figures, slip_programme

    _, exact, _ = slip_programme(k_on, speed)
    need = max((variance or 0.0) / mean**2 for mean, variance in exact.values()) / error**2
    answer = slip_figures(k_on, speed, int(min(need, most)), 20)
    names = {name for name in exact if answer[name][1] > error * 1.05}
    return answer | {name: value for name, value in few_bonds(k_on, speed, names, error).items() if name in names}


def slip(k_ons: list[float], speeds: list[float], most: int, error: float) -> None:
    """All figures of equal sites in every case."""
    every, total = {}, 0.0
    for k_on, speed in product(k_ons, speeds):
        seconds, answer = spent(lambda k=k_on, v=speed: slip_case(k, v, most, error))
        total += seconds
        largest = answer.pop("largest of a replica")
        shown = ", ".join(f"{name} {100 * off:+.2f} ± {100 * e:.2f}" for name, (off, e) in answer.items())
        print(f"{k_on:g}/s, {speed:g} nm/s: {shown} % ({seconds:.0f} s)", flush=True)
        every[k_on, speed] = np.array(list(answer.values())), largest
    values = np.array([one for one, _ in every.values()])
    print(f"{'':30}rms, largest in standard errors; weighted mean, largest deviation, largest standard error, in %")
    for number, name in enumerate(answer):
        off, error = values[:, number].T
        z, weights = off / error, error**-2.0
        mean, spread = np.average(off, weights=weights), weights.sum() ** -0.5
        print(
            f"{name:30}{np.sqrt(np.mean(z**2)):.2f} {np.abs(z).max():.2f}; {100 * mean:+.3f} ± {100 * spread:.3f}, "
            f"{100 * np.abs(off).max():.2f}, {100 * error.max():.2f}"
        )
    off, error = values.reshape(-1, 2).T
    within = (np.abs(off) <= 3 * error) & (np.abs(off) <= 0.01)
    print(f"{within.sum()} of {off.size} figures within 3 standard errors and 1 %; {total:.0f} s of CPU")


def maximum(k_ons: list[float], bonds: float) -> None:
    """Where steady friction is largest (Schallamach), over k_on."""
    from test_slip import place_of_maximum

    for k_on in k_ons:
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
    parser.add_argument("--k-on", type=float, nargs="+", default=[10.0**n for n in range(5)], help="1/s")
    parser.add_argument("--speed", type=float, nargs="+", default=[10.0**n for n in range(-2, 5)], help="nm/s")
    parser.add_argument("--bonds", type=float, default=1e5)
    parser.add_argument("--most", type=int, default=300_000)
    parser.add_argument("--error", type=float, default=0.0031)
    chosen = parser.parse_args()
    if chosen.what == "loads":
        loads(chosen.pixels, chosen.count)
    elif chosen.what == "holds":
        holds(chosen.sites)
    elif chosen.what == "slip":
        slip(chosen.k_on, chosen.speed, chosen.most, chosen.error)
    elif chosen.what == "maximum":
        maximum(chosen.k_on, chosen.bonds)
    elif chosen.what == "peaks":
        peaks()
    else:
        chains(chosen.count)


if __name__ == "__main__":
    main()
