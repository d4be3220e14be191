"""Can a straight line in log t agree with all else that the paper says? The best density of barriers for each model.

    python tests/benchmarks/straight_line.py FOLDER            # an hour of CPU; rerun to resume
    python tests/benchmarks/straight_line.py FOLDER NAME...    # the models of these names alone, "reference" first
    python tests/benchmarks/straight_line.py FOLDER --blocking # what neighbours do to the density found

Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), report six rates, the onsets of the logarithmic regime, the
order of the slopes, the range of the barriers, a friction drop along a straight line in log t from 1 to 1e5 s (Fig. 2,
with ΔV, h' = 0.1), and an interaction of 0.5 eV. For each model of ``MODELS`` the density of ten nodes is sought
that has the least χ² of rates and times while each local slope (one line per decade, 1 s to 1e5 s) deviates from their
mean by at most 25, 15 and 10 %, or by anything. Contacts and the table straight_line.csv are kept in FOLDER.

The search is that of ``ten_nodes.py``: all densities age the same sites with the same random numbers. Rates of the
surfaces used are scaled to the mean over 16. Each density found ages other surfaces as well.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from ten_nodes import AREAS, LOCAL, NODES, READINGS, SHARE, TIMES, Search, ends_of, line, reported

import chemage as ca
from chemage import ContactSolution, ReactionLattice
from chemage.plugin import EV_PER_GPA_NM3, StoreError, container, override, random, scene_data, threads

SLOPES = (0.05, 0.1, 0.2)
#: surfaces of each slope, of the search and of the check: the rougher, the fewer bonds there are on one
USED, JUDGES = ((7,), (7, 8), (7, 8, 9)), ((11,), (11, 12), (11, 12, 13))
#: largest deviation of a local slope from their mean, in the order of the search from a start and from the reference
DOWN, UP = (np.inf, 0.25, 0.15, 0.10, 0.15, 0.25), (np.inf, 0.15)
#: densities at the nodes from which the reference is searched
STARTS = {
    "ramp": [0.02, 0.2, 0.4, 0.6, 0.8, 1, 1, 0.7, 0.3, 0.05],
    "uniform": [1.0] * 10,
    "md-silica": [0.01, 0.4, 0.96, 1.54, 2.1, 2.7, 3.4, 2.9, 1.96, 0.01],
}
HEAD = """\
# The density of ten nodes with the least χ² of rates and times in each model, with straightness demanded or not
# made by: python tests/benchmarks/straight_line.py FOLDER
# local slopes: a line per decade from 1 s on, over their mean; nodes: 0.80 0.84 0.88 0.92 0.96 1.00 1.05 1.10 1.20 1.40 eV
"""


class Model(NamedTuple):
    """What a model changes in the scene silica-rough, its rule for φ, and ΔV (nm³) with the pressure."""

    changes: dict[str, Any] = {}
    rule: str = "pair"
    volume: float = 0.0064


WEAK, HALF = {"interaction.strength": 0.1}, {"chemistry.hydroxylation": 0.5}
MODELS = {
    "reference": Model(),
    **{f"I_b = {value:g} eV": Model({"interaction.strength": value}) for value in (0.1, 0.2, 0.3, 1.0)},
    **{f"ΔV = {value:g} Å³": Model(volume=value / 1000) for value in (3.2, 4.8, 8.0, 10.0)},
    **{f"E* = {value:g} GPa": Model({"contact.modulus": value}) for value in (25.0, 35.79, 69.0)},
    "φ per ordered pair": Model(rule="ordered"),
    "φ per site that forms": Model(rule="receiver"),
    "φ per bonded site": Model(rule="actor"),
    "four neighbours": Model(rule="four"),
    "mean over eight neighbours": Model({"interaction.strength": 0.0625}),
    **{f"ε = {value:g}": Model({"interaction.bias": value}) for value in (0.0, 0.3, 0.5)},
    "half hydroxylated": Model(HALF),
    "2.45 OH/nm²": Model({"chemistry.site_density": 2.45}),
    "bonds last": Model({"breaking": None}),
    **{f"breaking {value:g} eV": Model({"breaking.mean": value}) for value in (1.0, 1.2)},
    "breaking 1.1 ± 0.1 eV": Model({"breaking.std": 0.1}),
    **{f"ν = {value:g} Hz": Model({"chemistry.attempt_frequency": value}) for value in (1e12, 1e14)},
    "I_b = 0.1 eV, half hydroxylated": Model(WEAK | HALF),
    "bonds last, ν = 1e12 Hz": Model({"breaking": None, "chemistry.attempt_frequency": 1e12}),
    "I_b = 0.1 eV, E* = 69 GPa": Model(WEAK | {"contact.modulus": 69.0}),
}
#: the reference first, whose best density is where others start; and models under other demands
ASKED = ("one peak", "one window", "to 1e4 s", "free rates")
ORDER = ["reference", *(f"reference; {asked}" for asked in ASKED), "I_b = 0.1 eV; free factor", *MODELS]


def solved_contact(scene: ca.Scene, folder: Path) -> ContactSolution:
    """The contact of the surface of a scene, kept in ``folder``."""
    surface, solver = cast("Any", scene.surface), cast("Any", scene.contact)
    path = folder / f"contact-{surface.rms_slope:g}-{scene.surface_seed}-{solver.modulus:g}.npz"
    try:
        return container.read(path, {"contact": ContactSolution})[0]["contact"]
    except StoreError:
        solved = solver.solve(surface.make(scene.surface_seed), scene.load)
        container.write(path, {"contact": solved}, force=True, compact=True)
        return solved


def coupled(lattice: ReactionLattice, rule: str, pairs: Any) -> ReactionLattice:
    """Another rule for φ. Row i is what the bond of site i adds to the barriers of its neighbours."""
    assert lattice.neighbours is not None
    assert lattice.coupling is not None
    there, rng = lattice.neighbours >= 0, np.random.default_rng(3)
    own = rng.random(len(there))
    if rule == "four":
        coupling = np.where([0, 1, 0, 1, 1, 0, 1, 0], lattice.coupling, np.float32(0))
    else:
        phi = {"ordered": rng.random(there.shape), "receiver": own[lattice.neighbours], "actor": own[:, None]}[rule]
        coupling = np.where(there, pairs.strength * (phi - pairs.bias), 0).astype(np.float32)
    # a lattice refuses couplings that are not symmetric, but its kinetics are defined by them as well
    ReactionLattice._check_graph = lambda self, n: None
    return lattice.model_copy(update={"coupling": coupling})


class Curves:
    """Δμ of densities under six conditions, those with ΔV first."""

    def __init__(self, model: Model, folder: Path, seeds: Sequence[Sequence[int]] = USED) -> None:
        self.volumes, self.sites = (model.volume, 0.0), []
        self.counts = np.repeat([len(each) for each in seeds], [len(each) for each in seeds])
        for slope, seed in ((slope, seed) for slope, each in zip(SLOPES, seeds, strict=True) for seed in each):
            changes = {"surface.rms_slope": slope, "surface.seed": seed, **model.changes}
            self.scene = ca.parse_scene(override(scene_data("silica-rough")[0], changes))
            solved, disorder = solved_contact(self.scene, folder), np.random.SeedSequence([0, 0])
            chemistry: Any = self.scene.chemistry
            lattice = chemistry.on(solved, disorder)
            uniform = random.uniforms(disorder, random.FORMING, lattice.random_index)
            lowered = EV_PER_GPA_NM3 * lattice.pressures(solved).astype(np.float64)
            if model.rule != "pair":
                lattice = coupled(lattice, model.rule, chemistry.interaction)
            self.sites.append((SLOPES.index(slope), lattice, uniform, lowered))

    def __call__(self, shares: Sequence[np.ndarray]) -> np.ndarray:
        """Mean over surfaces, of densities with ``shares`` (n, 10) of the hat functions: (n, 6, m)."""
        tables = [ca.barriers("tabulated", energies=list(NODES), weights=list(row / AREAS)) for row in shares]
        engine: Any = self.scene.engine

        def aged(number: int) -> list[np.ndarray]:
            at, (_, lattice, uniform, lowered) = number // len(self.sites), self.sites[number % len(self.sites)]
            energies = tables[at].quantile(uniform)
            sites = [lattice.model_copy(update={"forming": energies - each * lowered}) for each in self.volumes]
            noise = random.CommonSeed([0, 1])
            return [engine.run(each, TIMES, temperature=300.0, seed=noise).bonds for each in sites]

        total = np.zeros((len(tables), 2, 3, TIMES.size))
        for number, bonds in enumerate(threads.in_order(aged, len(tables) * len(self.sites), 2, None)):
            at, place = divmod(number, len(self.sites))
            total[at, :, self.sites[place][0]] += np.array(bonds) * 3.0 / self.scene.load / self.counts[place]
        return total.reshape(len(tables), 6, TIMES.size)


def surfaces(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean rate of 16 surfaces over that of USED, and of JUDGES, (6,) each; covariance of ln β between surfaces."""
    path, start = folder / "surfaces.npy", np.array(STARTS["md-silica"]) * AREAS
    if not path.exists():
        every = [Curves(Model(), folder, ((seed,),) * 3)([start / start.sum()])[0] for seed in range(7, 23)]
        np.save(path, (np.array(every) @ line(10, 1e4)).T)
    rates = np.load(path)
    used, judges = (
        np.array([each.mean() / each[np.array(seeds[at % 3]) - 7].mean() for at, each in enumerate(rates)])
        for seeds in (USED, JUDGES)
    )
    return used, judges, np.cov(np.log(rates)) * (1 + 1 / rates.shape[1])


def row_of(search: Search, judges: np.ndarray, name: str, start: str, limit: float) -> dict[str, str]:
    """What the density found gives, and which sentences fail: rates at the level of 5 %, times and ends at two
    standard deviations; ``judges`` are the curves on other surfaces."""
    reading, shares = int(np.argmin(search.cost(limit, search.curves, search.shares))), search.shares
    asked, search.asked = search.asked, search.asked.replace("free rates", "")
    rest, other = (search.misfit(curves, shares, reading, limit) for curves in (search.curves, judges))
    search.asked = asked
    beta, times, local = reported(search.curves, reading)
    uneven, elsewhere = (np.abs(slopes - 1).max() for slopes in (local, reported(judges, reading)[2]))
    weights, (first, second, end) = shares / AREAS, READINGS[reading]
    fails = {
        "rates": np.sum(rest[:6] ** 2) > 12.6,
        "onsets": np.abs(rest[6:8]).max() > 2,
        "order": abs(rest[8]) > 2,
        "ends": ends_of(shares).min() < SHARE / 2,
        "straight": uneven > (0.15 if limit == np.inf else limit) + 0.005,
    }
    numbers = {
        "chi2_rates chi2_times": (".1f", [np.sum(rest[:6] ** 2), np.sum(rest[6:9] ** 2)]),
        "chi2_rates_other_surfaces": (".1f", [np.sum(other[:6] ** 2)]),
        "local_slopes_per_decade": (".3f", local),
        "deviation_percent other_surfaces": (".1f", [100 * uneven, 100 * elsewhere]),
        "beta": (".3f", beta),
        "onset_with_s onset_without_s crossing_s": (".2g", np.exp(times)),
        "ends_percent": (".1f", 100 * ends_of(shares)),
        "density_at_nodes": (".3f", weights / weights.max()),
    }
    row = {"model": name, "start": start, "demanded_percent": f"{100 * limit:g}"}
    row |= {"fails": " ".join(each for each, failed in fails.items() if failed) or "none"}
    row |= {"fitted_s": f"{first:g} or {second:g} to {end:g}"}
    return row | {key: " ".join(format(value, form) for value in values) for key, (form, values) in numbers.items()}


def blocking(folder: Path) -> None:
    """Print, for the density of the reference within 15 %, Δμ at 1e3 s and the local slopes by interaction."""
    shares, strengths = np.load(folder / "best.npy"), (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)
    models = [Model({"interaction.strength": strength}) for strength in strengths]
    curves = [Curves(model, folder)([shares])[0, 1] for model in models]
    at = int(np.argmin(np.abs(TIMES - 1e3)))
    for strength, curve in zip(strengths, curves, strict=True):
        remaining = (LOCAL @ curve) / (LOCAL @ curves[0])
        print(f"I_b = {strength} eV: Δμ {curve[at] / curves[4][at]:.3f} of that at 0.5 eV; "
              f"slope over that without interaction, by decade from 1 s on {remaining.round(2)}")  # fmt: skip


def main() -> None:
    """Search every model, and write what was found."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    if sys.argv[2:] == ["--blocking"]:
        return blocking(folder)
    used, judged, surface = surfaces(folder)
    path, best = folder / "straight_line.csv", folder / "best.npy"
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()[3:])) if path.exists() else []
    for name in [name for name in sys.argv[2:] or ORDER if name not in {row["model"] for row in rows}]:
        base, _, asked = name.partition("; ")
        many, least = name in ORDER[:2], np.inf
        steps = 5 if many else 6
        starts = {key: np.array(row) * AREAS for key, row in STARTS.items()} if many else {"reference": np.load(best)}
        curves, judges = Curves(MODELS[base], folder), Curves(MODELS[base], folder, JUDGES) if many else None
        for start, shares in starts.items():
            search = Search(curves, used, surface, asked)
            search.differences(shares / shares.sum())
            for limit in DOWN if many else UP:
                search.descend(limit, steps)
                if many and limit in (np.inf, 0.10):
                    search.differences(search.shares)
                    search.descend(limit, steps)
                cost = search.cost(limit, search.curves, search.shares).min()
                if name == "reference" and limit == 0.15 and cost < least:
                    least = cost
                    np.save(best, search.shares)
                others = judges([search.shares])[0] * judged[:, None] if judges else np.full_like(search.curves, np.nan)
                rows.append(row_of(search, others, name, start, limit))
                print(*list(rows[-1].values())[:9], flush=True)
                with path.open("w", encoding="utf-8", newline="") as file:
                    file.write(HEAD)
                    writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
                    writer.writeheader()
                    writer.writerows(rows)


if __name__ == "__main__":
    main()
