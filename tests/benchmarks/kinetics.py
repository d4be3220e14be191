"""The cost of the engines: events per second, growth with the lattice, memory, compilation, the paper's contact.

    python tests/benchmarks/kinetics.py                      # all sections but the reference contact
    python tests/benchmarks/kinetics.py --only events rough  # some sections
    python tests/benchmarks/kinetics.py --reference          # ten replicas of the paper's contact, 20 and 500 uN
    python tests/benchmarks/kinetics.py --markdown out.md    # the tables, to a file as well

Times are CPU seconds of this process unless stated otherwise; a run's time includes all of its own set-up.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import chemage
from chemage import ReactionLattice
from chemage.plugin import random as cr

TIMES = np.geomspace(1e-3, 1e5, 33)
ENGINES = ("rejection-free", "bkl", "next-reaction")


def lattice_on(pixels: tuple[int, int], sites: np.ndarray, seed: int) -> ReactionLattice:
    """Barriers uniform on .8 to 1.4 eV less 0.04 P, P Rayleigh of mean 1.6 GPa; breaking 1.1 ± .02 eV; I_b = .5 eV."""
    pairs = chemage.interaction("elastic-pairs", strength=0.5, bias=0.1)
    pressure = 1.6 * np.sqrt(-4.0 / np.pi * np.log(cr.uniforms(seed, 900, sites)))
    forming = 0.8 + 0.6 * cr.uniforms(seed, cr.FORMING, sites) - 0.04 * pressure
    breaking = chemage.barriers("gaussian", mean=1.1, std=0.02).quantile(cr.uniforms(seed, cr.BREAKING, sites))
    neighbours = pairs.neighbours(pixels, True, sites)
    coupling = pairs.coupling(sites, neighbours, seed)
    for array in (forming, breaking, coupling):
        array.setflags(write=False)
    return ReactionLattice(
        pixels=pixels, sites=sites, forming=forming, breaking=breaking, neighbours=neighbours, coupling=coupling
    )


def full(side: int, seed: int = 1) -> ReactionLattice:
    """``side`` × ``side`` pixels, all in contact, periodic."""
    return lattice_on((side, side), np.arange(side * side), seed)


def rough_sites(side: int, fraction: float, seed: int = 3) -> np.ndarray:
    """Where a random field of Hurst exponent .8 is highest: patches of all sizes, ``fraction`` of the pixels."""
    rng = np.random.default_rng(seed)
    q = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side)[None, :])
    amplitude = np.where((q > 0) & (q < 0.1), np.maximum(q, 3.0 / side) ** -1.8, 0.0)
    heights = np.fft.ifft2(np.fft.fft2(rng.normal(size=(side, side))) * amplitude).real
    return np.flatnonzero(heights > np.quantile(heights, 1.0 - fraction))


def timed(call, repeat: int = 3):
    """The result of ``call`` and the least CPU and wall seconds of ``repeat`` calls."""
    cpu, wall, result = np.inf, np.inf, None
    for _ in range(repeat):
        begin, started = time.process_time(), time.perf_counter()
        result = call()
        cpu, wall = min(cpu, time.process_time() - begin), min(wall, time.perf_counter() - started)
    return result, cpu, wall


def table(title: str, head: list[str], rows: list[list[str]]) -> str:
    lines = [f"### {title}", "", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows), ""])


def warm_up() -> None:
    small = full(5)
    for kind in ENGINES:
        chemage.engine(kind).run(small, [1.0], temperature=300)
    bare = ReactionLattice(pixels=(5, 5), sites=small.sites, forming=small.forming, breaking=small.breaking)
    chemage.engine("independent").run(bare, [1.0], temperature=300)


def events() -> str:
    lattice, build, _ = timed(lambda: full(1000))
    rows = []
    for kind in ENGINES:
        history, cpu, _ = timed(lambda kind=kind: chemage.engine(kind).run(lattice, TIMES, temperature=300, seed=0))
        rows.append([kind, f"{history.events}", f"{cpu:.2f}", f"{history.events / cpu / 1e6:.2f}", f"{build:.2f}"])
    head = ["engine", "events", "run, s", "million events/s", "disorder and lattice, s"]
    return table("1000 × 1000 sites in full contact, 300 K to 1e5 s", head, rows)


def rough_geometry() -> str:
    rows = []
    for name, side, fraction, temperature, end in (
        ("1e6 sites, 300 K to 1e5 s", 2230, 0.2, 300.0, 1e5),
        ("1e5 sites, 300 K to 1e5 s", 705, 0.2, 300.0, 1e5),
        ("1e5 sites, 400 K to 300 s", 705, 0.2, 400.0, 300.0),
    ):
        sites = rough_sites(side, fraction)
        lattice, build, _ = timed(lambda side=side, sites=sites: lattice_on((side, side), sites, 3))
        times = np.geomspace(1e-3, end, 33)
        for kind, options in (*((kind, {}) for kind in ENGINES), ("next-reaction", {"threads": 2})):
            engine = chemage.engine(kind, **options)
            history, cpu, wall = timed(
                lambda engine=engine, times=times, lattice=lattice, temperature=temperature: engine.run(
                    lattice, times, temperature=temperature, seed=0
                )
            )
            label = kind + (", 2 threads" if options else "")
            rate = f"{history.events / cpu / 1e6:.2f}"
            rows.append([name, label, f"{history.events}", f"{cpu:.2f}", f"{wall:.2f}", rate, f"{build:.2f}"])
    head = ["rough geometry", "engine", "events", "run, s", "wall, s", "million events/s", "disorder and lattice, s"]
    return table("Rough geometry, a fifth of the pixels in contact", head, rows)


def grow(kind: str, side: int) -> dict[str, float]:
    """One lattice in a process of its own: seconds per event, and peak memory above that of the process before."""
    warm_up()

    def memory(what: str) -> int:
        text = Path("/proc/self/status").read_text(encoding="ascii")
        return int(next(line for line in text.splitlines() if line.startswith(what)).split()[1]) * 1024

    before = memory("VmRSS")
    lattice = full(side)
    built = memory("VmHWM")
    held = memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets the peak
    count, cpu = 0, 0.0
    for seed in range(max(1, round(300_000 / side**2))):
        begin = time.process_time()
        count += chemage.engine(kind).run(lattice, TIMES, temperature=300, seed=seed).events
        cpu += time.process_time() - begin
    sizes = {"lattice": held, "run": memory("VmHWM"), "build": built}
    return {"event": cpu / count, **{name: (size - before) / side**2 for name, size in sizes.items()}}


def own_process(code: str, **environment: str) -> dict[str, float]:
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n{code}"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, **environment})
    return json.loads(done.stdout.splitlines()[-1])


def scaling() -> str:
    rows = []
    for kind in ENGINES:
        found = {}
        for side in (100, 316, 1000, 3163):
            code = f"import json, kinetics; print(json.dumps(kinetics.grow({kind!r}, {side})))"
            found[side] = own_process(code)
        last = found[3163]
        rows.append(
            [
                kind,
                *(f"{found[side]['event'] * 1e9:.0f}" for side in found),
                f"{last['event'] / found[100]['event']:.1f}",
                f"{last['lattice']:.0f}",
                f"{last['run']:.0f}",
                f"{last['build']:.0f}",
            ]
        )
    head = [
        "engine",
        "1e4",
        "1e5",
        "1e6",
        "1e7 sites, ns per event",
        "growth",
        "lattice, bytes per site",
        "lattice and run, peak",
        "building the lattice, peak",
    ]
    return table("Growth with the number of sites: full contact", head, rows)


FIRST_CALL = """
import json, time
from chemage.plugin import registry
import numpy as np
from chemage import ReactionLattice
near = dict(neighbours=[[1], [0]], coupling=[[0.1], [0.1]])
lattice = ReactionLattice(pixels=(1, 2), sites=[0, 1], forming=[0.9, 0.9], breaking=[1.0, 1.0], **near)
if {kind!r} == "independent":  # after the one above, whose validation has started numba: 0.25 s once per process
    lattice = ReactionLattice(pixels=(1, 2), sites=[0, 1], forming=[0.9, 0.9], breaking=[1.0, 1.0])
engine = chemage.engine({kind!r}, **{options!r})
begin = time.process_time()
engine.run(lattice, [1.0], temperature=300)
print(json.dumps({{"seconds": time.process_time() - begin}}))
"""


def compilation() -> str:
    rows = []
    for kind, options in (
        *((kind, {}) for kind in (*ENGINES, "independent")),
        *((kind, {"superbasins": True}) for kind in ENGINES),
    ):
        with tempfile.TemporaryDirectory() as folder:
            seconds = [
                own_process(FIRST_CALL.format(kind=kind, options=options), NUMBA_CACHE_DIR=folder)["seconds"]
                for _ in range(2)
            ]
        rows.append([kind + (", superbasins" if options else ""), f"{seconds[0]:.1f}", f"{seconds[1]:.3f}"])
    return table("First call, CPU seconds", ["engine", "nothing cached", "cached"], rows)


def without_interaction() -> str:
    rows = []
    n = 1_000_000
    forming = 0.8 + 0.6 * cr.uniforms(1, cr.FORMING, np.arange(n))
    breaking = chemage.barriers("gaussian", mean=1.1, std=0.02).quantile(cr.uniforms(1, cr.BREAKING, np.arange(n)))
    lattice = ReactionLattice(pixels=(1000, 1000), sites=np.arange(n), forming=forming, breaking=breaking)
    engine = chemage.engine("independent")
    for temperature in (300.0, 400.0, 1000.0):
        history, cpu, _ = timed(lambda t=temperature: engine.run(lattice, TIMES, temperature=t, seed=0), 1)
        _, mean, _ = timed(lambda t=temperature: engine.mean(lattice, TIMES, temperature=t), 1)
        rows.append([f"{temperature:.0f} K", f"{history.events:.2e}", f"{cpu:.2f}", f"{mean:.2f}"])
    head = ["independent, 1e6 sites, 33 hold times to 1e5 s", "events", "sample, s", "exact mean, s"]
    return table("Sites that do not interact", head, rows)


def superbasins() -> str:
    """A site that flips 1e4 times between two events of its neighbours; the rest of a patch of 25 sites is slow."""
    rng = np.random.default_rng(5)
    base = full(5)
    forming, breaking = 1.0 + 0.05 * rng.random(25), 1.0 + 0.05 * rng.random(25)
    forming[12] = breaking[12] = 0.76
    lattice = ReactionLattice(
        pixels=(5, 5),
        sites=base.sites,
        forming=forming,
        breaking=breaking,
        neighbours=base.neighbours,
        coupling=np.asarray(base.coupling) / 10,
    )
    rows = []
    for kind in ENGINES:
        for on in (False, True):
            engine = chemage.engine(kind, superbasins=on)
            engine.run(lattice, [1.0], temperature=300)
            history, cpu, _ = timed(lambda engine=engine: engine.run(lattice, [1e5, 3e5], temperature=300, seed=1), 1)
            rows.append([kind, "on" if on else "off", f"{history.events}", f"{cpu * 1e3:.1f}"])
    return table("One site that flickers", ["engine", "superbasins", "events", "run, ms"], rows)


def reference() -> str:
    """Ten replicas of the paper's contact through `chemage.age`, as a user runs it."""
    silica = chemage.chemistry(
        forming=chemage.barriers("md-silica"),
        breaking=chemage.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
        activation_volume="6.4 angstrom**3",
        interaction=chemage.interaction("elastic-pairs", strength=0.5, bias=0.1),
    )
    surface = chemage.surface(
        "self-affine", pixels=2500, pixel_size="0.4518 nm", rms_slope=0.1, hurst=0.8, zeta=150, eta=3
    ).make(seed=1)
    rows = []
    for load in ("20 uN", "500 uN"):
        contact = chemage.contact("fft-bem", modulus="35.3 GPa").solve(surface, load=load)
        for kind in ("rejection-free", "next-reaction", "auto"):
            engine = chemage.engine(kind)

            def age(engine=engine, contact=contact):
                return chemage.age(
                    contact, silica, engine=engine, hold_times=TIMES, temperature="300 K", replicas=10, seed=0
                )

            lattice, build, _ = timed(lambda contact=contact: silica.on(contact, seed=0), 1)
            _, run, _ = timed(lambda e=engine, x=lattice: e.run(x, TIMES, temperature=300, seed=0), 1)
            ageing, cpu, wall = timed(age, 1)
            rows.append(
                [
                    load,
                    kind,
                    f"{int(ageing.sites[0])}",
                    f"{int(ageing.events.sum())}",
                    f"{build:.2f}",
                    f"{run:.2f}",
                    f"{cpu:.2f}",
                    f"{wall:.2f}",
                ]
            )
    head = ["load", "engine", "sites", "events of all", "one lattice, s", "one run, s", "ten, CPU s", "ten, wall s"]
    return table("Ten replicas of the reference contact to 1e5 s", head, rows)


SECTIONS = {
    "events": events,
    "rough": rough_geometry,
    "scaling": scaling,
    "compilation": compilation,
    "independent": without_interaction,
    "superbasins": superbasins,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, help="sections to run")
    parser.add_argument("--reference", action="store_true", help="only the paper's contact (solves it first)")
    parser.add_argument("--markdown", type=Path, help="also write the tables to this file")
    options = parser.parse_args()
    warm_up()
    chosen = [reference] if options.reference else [SECTIONS[name] for name in options.only or SECTIONS]
    tables = []
    for section in chosen:
        tables.append(section())
        print(tables[-1], flush=True)
    if options.markdown:
        options.markdown.write_text("\n".join(tables), encoding="utf-8")


if __name__ == "__main__":
    main()
