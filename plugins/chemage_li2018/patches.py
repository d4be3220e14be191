"""What changes the number of contact patches N_p, which is below the paper's in the rows of its Table 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import chemage
from chemage import Surface, make_surface, parse_scene, solve_contact
from chemage.plugin import label_patches, override, scene_data
from chemage_li2018 import published
from chemage_li2018.published import Row
from chemage_li2018.sweeps import ROW, SURFACE_SEEDS, Mean, mean

#: rows in which N_p differs least between surfaces: enough to see a change of some per cent
STEADY = ("circle", "diamond", "asterisk")
_MEASURES = ("patches", "perimeter_to_area")


class Change(NamedTuple):
    """N_p and C/A with one thing changed, relative to those as computed, over rows and surfaces."""

    name: str
    patches: Mean
    perimeter_to_area: Mean


class PatchStudy(NamedTuple):
    """N_p of the rows of Table 1, and what changes it."""

    seeds: tuple[int, ...]
    #: way to count -> (rows, surfaces)
    counts: dict[str, np.ndarray]
    #: what is changed about the contact of the steady rows
    changes: list[Change]

    @property
    def ratios(self) -> np.ndarray:
        """N_p as computed over the paper's, (rows, surfaces)."""
        paper = np.array([float(row.patches) for row in published.TABLE_1])
        return next(iter(self.counts.values())) / paper[:, None]


# -- ways to count ----------------------------------------------------------------------------------------------------


def _large(contact: np.ndarray, least: int) -> int:
    labels, count = label_patches(contact, True)
    return int(np.count_nonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] >= least))


def _above(pressure: np.ndarray, share: float) -> int:
    threshold = share * pressure[pressure > 0].mean()
    return label_patches(pressure > threshold, True)[1]


COUNTS: dict[str, Callable[[np.ndarray], int]] = {
    "as computed": lambda p: label_patches(p > 0, True)[1],
    "4 neighbours": lambda p: label_patches(p > 0, True, corners=False)[1],
    "cut at the edges": lambda p: label_patches(p > 0, False)[1],
    "both": lambda p: label_patches(p > 0, False, corners=False)[1],
    "without single pixels": lambda p: _large(p > 0, 2),
    "p > 2 % of the mean": lambda p: _above(p, 0.02),
    "p > 10 % of the mean": lambda p: _above(p, 0.1),
}

# -- changes of the contact -------------------------------------------------------------------------------------------

#: what is changed -> options of the scene
OPTIONS: dict[str, dict[str, Any]] = {
    "as computed": {},
    "load 10 % higher": {"contact.load": 22000.0},
    "tolerance 1e-3 instead of 1e-5": {"contact.tolerance": 1e-3},
    "pixels of twice the size": {"surface.pixels": 1250, "surface.pixel_size": 2 * 0.4518},
}


def _spectrum(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """The Fourier transform of the heights, and the wave numbers in units of q_L."""
    n = surface.heights.shape[0]
    along = np.fft.fftfreq(n, 1 / n)
    return np.fft.fft2(surface.heights), np.hypot(along[:, None], along[None, :])


def _with_spectrum(surface: Surface, changed: np.ndarray, slope: float) -> Surface:
    options = {"pixel_size": surface.pixel_size, "periodic": True}
    surface = Surface(heights=np.fft.ifft2(changed).real, **options)
    return Surface(heights=surface.heights * (slope / surface.rms_slope), **options)


def _no_plateau(surface: Surface, row: Row, slope: float) -> Surface:
    """The surface without waves longer than the roll-off."""
    waves, q = _spectrum(surface)
    return _with_spectrum(surface, np.where(q < row.eta * (1 - 1e-9), 0, waves), slope)


def _equal_amplitudes(surface: Surface, row: Row, slope: float) -> Surface:
    """The surface with the phases of its waves, and amplitudes that are exactly those of the spectrum."""
    waves, q = _spectrum(surface)
    inside = (q >= 1 - 1e-9) & (q <= row.zeta * (1 + 1e-9))
    density = np.where(inside, np.maximum(q, row.eta) ** (-2 - 2 * row.hurst), 0.0)
    size = np.abs(waves)
    return _with_spectrum(surface, np.where(size > 0, waves / np.where(size > 0, size, 1), 0) * np.sqrt(density), slope)


SPECTRA: dict[str, Callable[[Surface, Row, float], Surface]] = {
    "no waves longer than the roll-off": _no_plateau,
    "amplitudes without scatter (random phases only)": _equal_amplitudes,
}


def _base(pixels: int | None) -> dict[str, Any]:
    data, _ = scene_data("silica-rough")
    data = {name: data[name] for name in ("surface", "contact")} | {"name": "reproduction-patches"}
    data = override(data, {"surface.rms_slope": published.SLOPES[0]})
    if pixels is not None:
        data = override(data, {"surface.pixels": pixels, "surface.pixel_size": 2500 * 0.4518 / pixels})
    return data


def scenes(seeds: Sequence[int], pixels: int | None = None) -> dict[str, dict[str, Any]]:
    """Make scene data of the sweeps, by what is changed about the contact; none has ageing."""
    sweeps = {}
    for name, options in OPTIONS.items():
        if pixels is not None and "surface.pixels" in options:
            continue
        chosen = [row for row in published.TABLE_1 if not options or row.name in STEADY]
        points = [(row, seed) for row in chosen for seed in seeds]
        columns: dict[str, list[Any]] = {
            path: [getattr(row, path.partition(".")[2]) for row, _ in points] for path in ROW
        }
        columns["surface.seed"] = [seed for _, seed in points]
        sweeps[name] = {**override(_base(pixels), options), "sweep": {"zip": [columns]}}
    return sweeps


def study(
    results: dict[str, chemage.SweepResult], seeds: Sequence[int], pixels: int | None, report: Callable[[str], None]
) -> PatchStudy:
    """Count the patches of completed sweeps, and solve the contacts of surfaces with other spectra."""
    measured: dict[tuple[str, str, int], tuple[float, ...]] = {}
    counts = {name: np.zeros((len(published.TABLE_1), len(seeds)), dtype=np.int64) for name in COUNTS}
    for name, result in results.items():
        for point in result:
            values = point.values
            place, row = _row(values)
            measured[name, row.name, values["surface.seed"]] = tuple(point.summary[name] for name in _MEASURES)
            if name == "as computed":
                pressure = point.contact().pressure
                for way, count in COUNTS.items():
                    counts[way][place, list(seeds).index(values["surface.seed"])] = count(pressure)
    for name, change in SPECTRA.items():
        for row in (row for row in published.TABLE_1 if row.name in STEADY):
            for seed in seeds:
                report(f"{name}, {row.name}, surface {seed}")
                measured[name, row.name, seed] = _other(row, seed, pixels, change)
    changes = [
        Change(name, *(_ratio(measured, name, seeds, place) for place in range(2)))
        for name in [*OPTIONS, *SPECTRA]
        if (name, STEADY[0], seeds[0]) in measured and name != "as computed"
    ]
    return PatchStudy(tuple(seeds), counts, changes)


def _ratio(
    measured: dict[tuple[str, str, int], tuple[float, ...]], name: str, seeds: Sequence[int], place: int
) -> Mean:
    return mean(
        measured[name, row, seed][place] / measured["as computed", row, seed][place] for row in STEADY for seed in seeds
    )


def _row(values: dict[str, Any]) -> tuple[int, Row]:
    for place, row in enumerate(published.TABLE_1):
        if all(abs(values[path] - getattr(row, path.partition(".")[2])) < 1e-9 for path in ROW):
            return place, row
    raise KeyError(values)


def _other(
    row: Row, seed: int, pixels: int | None, change: Callable[[Surface, Row, float], Surface]
) -> tuple[float, ...]:
    options = {path: getattr(row, path.partition(".")[2]) for path in ROW} | {"surface.seed": seed}
    scene = parse_scene(override(_base(pixels), options))
    surface = change(make_surface(scene.surface, scene.surface_seed), row, published.SLOPES[0])
    contact = solve_contact(scene.contact, surface, scene.load)
    return tuple(float(getattr(contact, name)) for name in _MEASURES)


# -- the page ---------------------------------------------------------------------------------------------------------

_PAGE = """# Number of patches

The number of contact patches N_p is below that of the paper's Table 1 in {low} of its seven rows, by
{shift:.1%} on average. Output of `chemage reproduce patches --seeds {count}`: {pixels} x {pixels} pixels,
h'_rms = 0.05, 20 µN, surface seeds {first} to {last}; mean ± standard deviation between surfaces.

## Ways to count

{counts}

*As computed*: pixels with p > 0 that share an edge or a corner are one patch, across the edges of the periodic
surface as well. *4 neighbours*: corners do not connect. *Cut at the edges*: a patch that crosses an edge counts
twice. *Both*: these two. *p > 2 % of the mean*: pixels with less than this share of the mean contact pressure
count as open.

## Changes of the contact

On the rows {steady}, where N_p varies least; the paper's N_p is {needed:.3f} times ours there, while its
C/A is ours within two per cent; mean ± standard deviation over rows and surfaces.

{changes}

The contact depends on load, modulus and slope only through F_N/(E* h'_rms): E* = 35.79 GPa instead of 35.3 is a
load 1.4 % lower, and a slope that is 1 % larger a load 1 % lower.

## Chance

The paper has one realisation per row. If its rows share one random field, as ours of one seed do, their N_p
rise and fall together: the ratio of ours to the paper's, averaged over the rows, is {together} over our
surfaces, and {above} of {count} surfaces have at least the paper's N_p on average. If its rows are independent,
the seven together are {independent:.1f} standard deviations above ours.

{verdict}
"""


def page(counted: PatchStudy, pixels: int) -> str:
    """Write the page as Markdown."""
    names = list(counted.counts)
    head = ["| row | paper | " + " | ".join(names) + " |", "| " + " | ".join(["---"] * (len(names) + 2)) + " |"]
    rows = [
        f"| {row.name} | {row.patches} | " + " | ".join(str(mean(counted.counts[n][i])) for n in names) + " |"
        for i, row in enumerate(published.TABLE_1)
    ]
    paper = np.array([float(row.patches) for row in published.TABLE_1])[:, None]
    last = "| mean of ours / paper | | " + " | ".join(f"{(counted.counts[n] / paper).mean():.3f}" for n in names) + " |"
    ratios = counted.ratios
    shift = ratios.mean(axis=1)
    steady = [i for i, row in enumerate(published.TABLE_1) if row.name in STEADY]
    errors = ratios.std(axis=1, ddof=1) * np.sqrt(1 + 1 / ratios.shape[1])
    independent = float(np.sum((1 - shift) / errors) / np.sqrt(len(shift)))
    above = int(np.count_nonzero(ratios.mean(axis=0) >= 1))
    changed = ["| changed | N_p relative to as computed | C/A relative to as computed |", "| --- | --- | --- |"]
    changed += [f"| {name.name} | {name.patches} | {name.perimeter_to_area} |" for name in counted.changes]
    return _PAGE.format(
        low=int(np.count_nonzero(shift < 1)),
        shift=1 - shift.mean(),
        count=len(counted.seeds),
        pixels=pixels,
        first=counted.seeds[0],
        last=counted.seeds[-1],
        counts="\n".join([*head, *rows, last]),
        steady=", ".join(STEADY),
        needed=1 / shift[steady].mean(),
        changes="\n".join(changed),
        together=mean(ratios.mean(axis=0)),
        above=above,
        independent=independent,
        verdict=_verdict(above, len(counted.seeds), independent),
    )


def _verdict(above: int, count: int, independent: float) -> str:
    if abs(independent) <= 2:
        return "Chance is enough to explain the difference, whichever of the two holds."
    shared = "likely" if above >= 0.1 * count else "unlikely"
    return (
        f"As one random field shared by the rows the difference is {shared} by chance, as seven independent surfaces "
        "it is not. Which of the two holds, and what else may differ, is open: the paper's surfaces are not published."
    )


def seeds_of(count: int) -> tuple[int, ...]:
    """The surface seeds of the study: at least two, for a scatter."""
    return SURFACE_SEEDS[: max(2, count)]
