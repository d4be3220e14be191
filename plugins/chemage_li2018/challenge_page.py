"""What `chemage study challenge` writes: the page, its figure, and all contacts as a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chemage.plugin import figures, progress, text, theory
from chemage_li2018.challenge import (
    ADHESIVE,
    RANGE,
    REFERENCE,
    WORK,
    Row,
    Study,
    compute,
    extrapolated,
    resolved_range,
)
from chemage_li2018.pages import filled, free_folder, table, write_pages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE = "challenge.png"


def write_study(out: Path, *, quick: bool = False, force: bool = False, surface: Path | None = None) -> list[Path]:
    """Run the study, write page, figure and table into ``out``, and return their paths; its sweeps are there as well.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    texts: dict[str, Callable[[], str]] = {"challenge.md": lambda: page(study), "challenge.csv": lambda: rows(study)}
    free_folder(out, [*texts, f"figures/{FIGURE}"], force=force)
    with progress.progress_bars() as report:
        study = compute(out / "sweeps", report, quick=quick, file=surface)
    return write_pages(out, texts, {FIGURE: lambda: figure(study)}, force=force)


def rows(study: Study) -> str:
    """Every contact, one line each."""
    stream = io.StringIO()
    written = [asdict(row) for row in study.rows]
    writer = csv.DictWriter(stream, list(written[0]), lineterminator="\n")
    writer.writeheader()
    for row in written:
        writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
    return stream.getvalue()


def _grouped(found: Sequence[Row], key: Callable[[Row], float]) -> dict[float, list[Row]]:
    """Rows by a number, ascending; numbers that differ by rounding are one."""
    keys = sorted({float(f"{key(row):.9g}") for row in found})
    return {at: [row for row in found if float(f"{key(row):.9g}") == at] for at in keys}


def _percent(values: Sequence[float]) -> str:
    return text.mean_text(100 * np.array(values)) if len(values) > 1 else f"{100 * values[0]:.4g}"


def _loads(study: Study) -> str:
    lines = []
    for pressure, found in _grouped(study.of("loads"), lambda row: row.pressure).items():
        scaled = pressure / study.modulus / study.slope
        area = np.mean([row.corrected for row in found])
        lines.append(
            [
                f"{1e6 * pressure:.4g}",
                f"{scaled:.3g}",
                _percent([row.area for row in found]),
                _percent([row.corrected for row in found]),
                f"{area / scaled:.3f}",
                f"{100 * study.persson(pressure):.3g}",
                text.mean_text(np.array([row.mean_gap for row in found]))
                if len(found) > 1
                else f"{found[0].mean_gap:.0f}",
            ]
        )
    heads = ["p (kPa)", "p/(E\\* h'_rms)", "A/A0 of pixels (%)", "A/A0 (%)", "κ", "Persson (%)", "mean gap (nm)"]
    return table(heads, lines)


def _pixels(study: Study) -> str:
    """Area of each size of the pixels, and its extrapolation from that size and twice it."""
    lines, coarser = [], None
    for size, found in reversed(_grouped(study.of("pixels"), lambda row: row.pixel_size).items()):
        area = [row.area for row in found]
        finest = [extrapolated(*pair) for pair in zip(coarser, area, strict=True)] if coarser else []
        lines.append(
            [
                f"{found[0].pixels}²",
                f"{_shortest(study) / size:.1f}",
                *(f"{100 * np.mean(values):.4f}" if values else "" for values in (area, finest)),
                f"{100 * np.mean([row.corrected for row in found]):.4f}",
                f"{np.mean([row.mean_gap for row in found]):.1f}",
                f"{np.mean([row.patches for row in found]):.0f}",
            ]
        )
        coarser = area
    heads = ["grid", "pixels per shortest wave", "of pixels", "extrapolated", "corrected at the rim"]
    return table([*heads, "mean gap (nm)", "patches"], lines)


def _shortest(study: Study) -> float:
    """Length of the shortest wave, nm: the study's surfaces have 2.048 pixels for it on the coarsest grid."""
    return 2.048 * max(row.pixel_size for row in study.of("pixels"))


def _sides(study: Study) -> str:
    lines = []
    for side, found in _grouped(
        [*study.of("sides"), *study.reference], lambda row: row.pixels * row.pixel_size
    ).items():
        area = np.array([row.corrected for row in found])
        gap = np.array([row.mean_gap for row in found])
        lines.append(
            [
                f"{side / 1e3:.0f}",
                f"{side / 2e4:.3g}",
                f"{len(found)}",
                f"{100 * area.mean():.3f}",
                f"{100 * area.std(ddof=1):.3f}",
                f"{gap.mean():.0f}",
                f"{gap.std(ddof=1):.0f}",
            ]
        )
    heads = ["side (µm)", "over the roll-off", "surfaces", "A/A0 (%)", "s.d.", "mean gap (nm)", "s.d."]
    return table(heads, lines)


def page(study: Study) -> str:
    """Write the study as Markdown."""
    import jinja2

    source = resources.files("chemage_li2018").joinpath("challenge.md.j2").read_text(encoding="utf-8")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(source)
    at = study.reference
    assert study.shape is not None
    sizes = study.shape.patches
    return filled(
        template.render(
            figure=f"figures/{FIGURE}",
            count=len(at),
            grid=at[0].pixels,
            cutoff=f"{_shortest(study) / 1e3:.3g}" if study.of("pixels") else "",
            loads=_loads(study),
            area=_percent([row.corrected for row in at]),
            persson=f"{100 * study.persson(REFERENCE):.2f}",
            largest=f"{1e3 * np.mean([row.largest for row in at]):.0f}",
            pixels=_pixels(study) if study.of("pixels") else "",
            sides=_sides(study) if study.of("sides") else "",
            patches=f"{sizes.size}",
            half=f"{int(np.searchsorted(np.cumsum(sizes), 0.5 * sizes.sum())) + 1}",
            biggest=f"{100 * sizes[0] / sizes.sum():.0f}",
            tamaas=_tamaas(study),
            adhesion=_adhesion(study),
        )
    )


def _tamaas(study: Study) -> str:
    if "tamaas" not in study.differences:
        return "With Tamaas (`pip install 'chemage[tamaas]'`) the study solves one surface with it as well."
    ours, theirs = study.of("fft-bem")[0], study.of("tamaas")[0]
    return (
        f"Tamaas gives {theirs.area * theirs.pixels**2:.0f} pixels in contact on a surface of 50 µm with "
        f"{ours.pixels}² pixels, `fft-bem` {ours.area * ours.pixels**2:.0f}; their pressures differ by "
        f"{study.differences['tamaas']:.1e} (relative L2 norm, tolerances of 1e-6)."
    )


def _adhesion(study: Study) -> dict[str, str]:
    """What the section on adhesion says; empty of a surface from a file."""
    if not (plain := study.of("fft-bem")):
        return {}
    zone = study.modulus * RANGE**2 / WORK
    said = {"zone": f"{zone:.2g}", "needed": f"{0.5 * zone:.2f}", "side": f"{2e2 / zone:.0f}", "range": ""}
    for row in study.of(ADHESIVE):
        said |= {"range": f"{resolved_range(study.modulus, row.pixel_size):.1f}", "grid": f"{row.pixels}²"}
        said |= {"with_it": f"{100 * row.area:.3f}", "without": f"{100 * plain[0].area:.3f}"}
    return said


def figure(study: Study) -> Figure:
    """Draw area and mean gap against pressure, and the distributions at the reference load."""
    drawn, axes = figures.plots(11.4, 6.4, 3, 5, dpi=90)
    area, gap, pressures, gaps, sizes = axes
    reference = np.geomspace(1e-5, 3e-3, 60)
    scaled = reference / study.modulus / study.slope
    seeds = _grouped(study.of("loads"), lambda row: row.seed)
    for number, found in enumerate(seeds.values()):
        x = np.array([row.pressure for row in found]) / study.modulus / study.slope
        label = "fft-bem" if number == 0 else None
        style = {"marker": "o", "ms": 3.5, "lw": 0.8, "color": figures.BLUE, "alpha": 0.8}
        area.plot(x, [row.corrected / at for row, at in zip(found, x, strict=True)], label=label, **style)
        gap.plot(x, [row.mean_gap / 1e3 for row in found], **style)
    persson = np.array([study.persson(float(each)) for each in reference])
    area.plot(scaled, persson / scaled, color=figures.ORANGE, ls="--", label="Persson")
    area.axhline(np.sqrt(2 * np.pi), color=figures.GREY, lw=1, ls=":", label="Bush, Gibson & Thomas")
    area.set(xscale="log", xlabel="p/(E* h'rms)", ylabel="κ = A E* h'rms / F", ylim=(1.4, 3.3))
    area.legend(frameon=False, fontsize=8, loc="upper left")
    gap.set(xscale="log", xlabel="p/(E* h'rms)", ylabel="mean gap (µm)")
    assert study.shape is not None
    edges, density = study.shape.pressure
    middles = 0.5 * (edges[1:] + edges[:-1])
    pressures.stairs(1e-3 * density, 1e3 * edges, color=figures.BLUE, label="fft-bem")
    expected = theory.persson_pressure_density(middles, REFERENCE, study.modulus, study.slope)
    pressures.plot(1e3 * middles, 1e-3 * expected, color=figures.ORANGE, ls="--", label="Persson")
    pressures.set(yscale="log", xlabel="pressure at 250 kPa (MPa)", ylabel="density (1/MPa)")
    pressures.legend(frameon=False, fontsize=8)
    edges, density = study.shape.gap
    gaps.stairs(1e3 * density, edges / 1e3, color=figures.BLUE)
    gaps.set(xlabel="gap at 250 kPa (µm)", ylabel="density (1/µm)", ylim=(0, None))
    ordered = study.shape.patches / 1e6
    sizes.plot(ordered, np.arange(1, ordered.size + 1), color=figures.BLUE)
    sizes.set(xscale="log", yscale="log", xlabel="patch size at 250 kPa (µm²)", ylabel="patches of at least this size")
    return drawn
