"""What changes the number of contact patches N_p, which is below the paper's in the rows of its Table 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import chemage
from chemage import Surface, make_surface, parse_scene, solve_contact
from chemage.plugin import label_patches, override, scene_data
from chemage_li2018 import published
from chemage_li2018.pages import render
from chemage_li2018.published import TABLE_1, PaperSurface
from chemage_li2018.sweeps import SEED, SLOPE, SURFACE_SEEDS, Mean, coarse, mean

#: rows in which N_p differs least between surfaces: enough to see a change of some per cent
STEADY = ("circle", "diamond", "asterisk")
_STEADY_ROWS = [row for row in TABLE_1 if row.name in STEADY]
_MEASURES = ("patches", "perimeter_to_area")
AS_COMPUTED = "as computed"


class PatchStudy(NamedTuple):
    """N_p of the rows of Table 1, and what changes it."""

    seeds: tuple[int, ...]
    #: way to count -> (rows, surfaces)
    counts: dict[str, np.ndarray]
    #: what is changed about the contact of the steady rows -> N_p and C/A relative to those as computed
    changes: dict[str, tuple[Mean, ...]]


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


def _no_plateau(surface: Surface, row: PaperSurface, slope: float) -> Surface:
    """The surface without waves longer than the roll-off."""
    waves, q = _spectrum(surface)
    return _with_spectrum(surface, np.where(q < row.eta * (1 - 1e-9), 0, waves), slope)


def _equal_amplitudes(surface: Surface, row: PaperSurface, slope: float) -> Surface:
    """The surface with the phases of its waves, and amplitudes that are exactly those of the spectrum."""
    waves, q = _spectrum(surface)
    inside = (q >= 1 - 1e-9) & (q <= row.zeta * (1 + 1e-9))
    density = np.where(inside, np.maximum(q, row.eta) ** (-2 - 2 * row.hurst), 0.0)
    size = np.abs(waves)
    return _with_spectrum(surface, np.where(size > 0, waves / np.where(size > 0, size, 1), 0) * np.sqrt(density), slope)


SPECTRA: dict[str, Callable[[Surface, PaperSurface, float], Surface]] = {
    "no waves longer than the roll-off": _no_plateau,
    "amplitudes without scatter (random phases only)": _equal_amplitudes,
}


def _base(pixels: int | None) -> dict[str, Any]:
    data, _ = scene_data("silica-rough")
    data = {name: data[name] for name in ("surface", "contact")} | {"name": "reproduction-patches"}
    return override(data, {SLOPE: published.SLOPES[0], **(coarse(pixels) if pixels is not None else {})})


def scenes(seeds: Sequence[int], pixels: int | None = None) -> dict[str, dict[str, Any]]:
    """Make scene data of the sweeps, by what is changed about the contact; none has ageing."""
    sweeps = {}
    for name, options in OPTIONS.items():
        if pixels is not None and "surface.pixels" in options:
            continue
        points = [row.options | {SEED: seed} for row in (_STEADY_ROWS if options else TABLE_1) for seed in seeds]
        columns = {path: [point[path] for point in points] for path in points[0]}
        sweeps[name] = {**override(_base(pixels), options), "sweep": {"zip": [columns]}}
    return sweeps


def study(
    results: dict[str, chemage.SweepResult], seeds: Sequence[int], pixels: int | None, report: Callable[[str], None]
) -> PatchStudy:
    """Count the patches of completed sweeps, and solve the contacts of surfaces with other spectra."""
    # points are row by row, seed by seed
    measured = {
        name: np.array([[point.summary[one] for one in _MEASURES] for point in result])
        for name, result in results.items()
    }
    counts: dict[str, list[int]] = {name: [] for name in COUNTS}
    for point in results[AS_COMPUTED]:
        pressure = point.contact().pressure
        for name, count in COUNTS.items():
            counts[name].append(count(pressure))
    of_rows = measured.pop(AS_COMPUTED).reshape(len(TABLE_1), len(seeds), -1)
    reference = np.concatenate([of_rows[TABLE_1.index(row)] for row in _STEADY_ROWS])
    for name, change in SPECTRA.items():
        found = []
        for row in _STEADY_ROWS:
            for seed in seeds:
                report(f"{name}, {row.name}, surface {seed}")
                scene = parse_scene(override(_base(pixels), row.options | {SEED: seed}))
                surface = change(make_surface(scene.surface, scene.surface_seed), row, published.SLOPES[0])
                contact = solve_contact(scene.contact, surface, scene.load)
                found.append([float(getattr(contact, one)) for one in _MEASURES])
        measured[name] = np.array(found)
    changes = {name: tuple(mean(column) for column in (of / reference).T) for name, of in measured.items()}
    every = {name: np.reshape(of, (len(TABLE_1), len(seeds))) for name, of in counts.items()}
    return PatchStudy(tuple(seeds), every, changes)


def page(counted: PatchStudy, pixels: int) -> str:
    """Write the page as Markdown."""
    paper = np.array([[float(row.patches)] for row in TABLE_1])
    table = []
    for place, row in enumerate(TABLE_1):
        table.append([row.name, row.patches, *(mean(of[place]) for of in counted.counts.values())])
    table.append(["mean of ours / paper", "", *(f"{(of / paper).mean():.3f}" for of in counted.counts.values())])
    ratios = counted.counts[AS_COMPUTED] / paper
    shift = ratios.mean(axis=1)
    errors = ratios.std(axis=1, ddof=1) * np.sqrt(1 + 1 / len(counted.seeds))
    return render(
        "patches",
        seeds=counted.seeds,
        pixels=pixels,
        counts=list(counted.counts),
        table=table,
        changes=counted.changes,
        steady=STEADY,
        needed=1 / np.mean([shift[TABLE_1.index(row)] for row in _STEADY_ROWS]),
        low=int(np.count_nonzero(shift < 1)),
        shift=shift,
        together=mean(ratios.mean(axis=0)),
        above=int(np.count_nonzero(ratios.mean(axis=0) >= 1)),
        independent=float(np.sum((1 - shift) / errors) / np.sqrt(len(shift))),
    )


def seeds_of(count: int) -> tuple[int, ...]:
    """The surface seeds of the study: at least two, for a scatter."""
    return SURFACE_SEEDS[: max(2, count)]
