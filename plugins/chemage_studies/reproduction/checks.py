"""Comparison of the numbers and claims of the paper with the computed results."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from chemage_studies.reproduction import published
from chemage_studies.reproduction.points import Mean, Point, curve, grouped, mean
from chemage_studies.reproduction.published import TOLERANCE

Studies = dict[str, list[Point]]

SLOPE, SEED, LOAD, VOLUME = "surface.rms_slope", "surface.seed", "contact.load", "chemistry.activation_volume"


class Line(NamedTuple):
    """A published number and ours."""

    target: str
    quantity: str
    paper: float
    ours: Mean
    tolerance: float

    @property
    def difference(self) -> float:
        """(ours − paper) / paper."""
        return self.ours.value / self.paper - 1

    @property
    def within(self) -> str:
        """``"yes"`` within the tolerance, ``"scatter"`` within two standard deviations between seeds, else ``"no"``."""
        if abs(self.difference) <= self.tolerance:
            return "yes"
        wide = 2 * self.ours.scatter
        return "scatter" if math.isfinite(wide) and abs(self.ours.value - self.paper) <= wide else "no"


class Claim(NamedTuple):
    """A statement of the paper, our result, and whether the statement holds for it."""

    target: str
    statement: str
    found: str
    holds: bool


def lines(studies: Studies, targets: Sequence[str]) -> list[Line]:
    """Compare the published numbers of ``targets`` with those of the computed ``studies``."""
    made: list[Line] = []

    def add(target: str, quantity: str, paper: float, points: Sequence[Point], name: str, tolerance: str = "") -> None:
        ours = mean(p.summary[name] for p in points)
        made.append(Line(target, quantity, paper, ours, TOLERANCE[tolerance or name]))

    if "kappa" in targets:
        by_load = {load / 1000: group for (load,), group in grouped(studies["loads"], LOAD).items()}
        for load, paper in published.AREA_FRACTION.items():
            add("kappa", f"A/A0 at {load:g} µN", paper, by_load[load], "area_fraction")
        add("kappa", "κ at 20 µN, h' = 0.1", published.KAPPA, by_load[20.0], "kappa")
        for row, points in _rows(studies["rows"]):
            add("kappa", f"κ, Table 1 {row.name}", published.KAPPA_ROWS, points, "kappa")
    if "table1" in targets:
        for row, points in _rows(studies["rows"]):
            add("table1", f"N_p, {row.name}", row.patches, points, "patches")
            add("table1", f"C/A (1/nm), {row.name}", row.perimeter_to_area, points, "perimeter_to_area")
    if "fig3" in targets:
        for volume, points in _by_volume(studies["slopes"]).items():
            for slope, paper in published.BETA[volume].items():
                chosen = [p for p in points if math.isclose(p.changes[SLOPE], slope)]
                add("fig3", f"β, h' = {slope:g}, ΔV = {volume:g} Å³", paper, chosen, "beta")
    if "fig6" in targets:
        add("fig6", "β, h' = 0.4, half hydroxylated, front", published.FIG_6_BETA, studies["front"], "beta", "fig6")
    return made


def _rows(points: Sequence[Point]) -> list[tuple[published.Row, list[Point]]]:
    groups = grouped(points, "surface.hurst", "surface.zeta", "surface.eta")
    return [(row, groups[row.hurst, row.zeta, row.eta]) for row in published.TABLE_1]


WORDS = {"yes": "within", "scatter": "within the scatter between seeds", "no": "OUTSIDE"}


def _by_volume(points: Sequence[Point]) -> dict[float, list[Point]]:
    """Group points by the activation volume in Å³."""
    return {6.4 if volume else 0.0: group for (volume,), group in grouped(points, VOLUME).items()}


# -- claims -----------------------------------------------------------------------------------------------------------


def claims(studies: Studies, targets: Sequence[str]) -> list[Claim]:
    """Compare the claims of ``targets`` in the paper with the computed ``studies``."""
    made: list[Claim] = []
    if "fig1" in targets:
        made.append(_logarithmic(studies["loads"]))
    if "fig2" in targets:
        made += [
            _load_claim(studies["loads"]),
            _area_claim(studies["loads"]),
            _coefficient_claim(studies["loads"]),
            _pressure_claim(studies["loads"]),
        ]
    if "fig3" in targets:
        made += [_crossing_claim(studies["slopes"]), _onset_claim(studies["slopes"])]
    if "fig4" in targets:
        made.append(_saturation_claim(studies["interaction"]))
    if "fig5" in targets:
        made.append(_morphology_claim(studies["rows"]))
    return made


def _logarithmic(points: list[Point]) -> Claim:
    chosen = grouped(points, LOAD)[(20000.0,)]
    times, drop = chosen[0].hold_times, curve(chosen, lambda p: p.friction_drop)
    inside = (times >= 0.999) & (times <= 1.001e5)
    straight = np.corrcoef(np.log10(times[inside]), drop[inside])[0, 1] ** 2
    return Claim(
        "fig1",
        "ΔF grows with log t from 1 s to 1e5 s",
        f"R² of the line over 1 s to 1e5 s: {straight:.4f}",
        bool(straight > 0.98),
    )


def _over_loads(points: list[Point], time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    groups = grouped(points, LOAD)
    loads = np.array([load for (load,) in groups])
    drop = np.array([mean(p.at(time) for p in group).value for group in groups.values()])
    area = np.array([mean(p.summary["area_fraction"] for p in group).value for group in groups.values()])
    return loads, drop, area


def _load_claim(points: list[Point]) -> Claim:
    loads, drop, _ = _over_loads(points, 1e3)
    ratio = drop / loads
    low = ratio[(loads >= 20e3) & (loads <= 50e3)]
    reference = ratio[loads == 20e3][0]
    return Claim(
        "fig2",
        "ΔF is linear in the load at small loads, and sublinear at large loads",
        f"ΔF/F_N at 50 µN is {low[-1] / reference:.3f} of that at 20 µN, at 500 µN {ratio[-1] / reference:.3f} (1e3 s)",
        bool(abs(low[-1] / reference - 1) < 0.1 and ratio[-1] / reference < 0.97),
    )


def _area_claim(points: list[Point]) -> Claim:
    _, drop, area = _over_loads(points, 1e3)
    slope = float(area @ drop / (area @ area))
    worst = float(np.max(np.abs(drop / (slope * area) - 1)[area > 0.005]))
    straight = np.corrcoef(area, drop)[0, 1] ** 2
    return Claim(
        "fig2",
        "ΔF is linear in A up to A/A0 = 0.22",
        f"R² = {straight:.5f}; largest deviation from proportionality {worst:.1%} up to A/A0 = {area.max():.3f}",
        bool(straight > 0.995),
    )


def _coefficient_claim(points: list[Point]) -> Claim:
    loads, drop, _ = _over_loads(points, 1e3)
    ratio = drop / loads
    return Claim(
        "fig2",
        "Δμ is constant at small loads and falls at large loads",
        ", ".join(f"{load / 1000:g} µN {value:.3f}" for load, value in zip(loads, ratio, strict=True)) + " (1e3 s)",
        bool(np.ptp(ratio[loads <= 50e3]) / ratio[loads <= 50e3].mean() < 0.15 and ratio[-1] < ratio[:4].min()),
    )


def _pressure_claim(points: list[Point]) -> Claim:
    groups = grouped(points, LOAD)
    distances = {}
    reference = _pressure_cdf(groups[(20000.0,)])
    for (load,), group in groups.items():
        distances[load / 1000] = float(np.max(np.abs(_pressure_cdf(group) - reference)))
    small = max(value for load, value in distances.items() if load <= 100)
    return Claim(
        "fig2",
        "the distribution of the contact pressure does not depend on the load at small loads",
        "largest distance of the cumulative distributions from that at 20 µN: "
        + ", ".join(f"{load:g} µN {value:.3f}" for load, value in distances.items()),
        bool(small < 0.06 and distances[500.0] > 2 * distances[50.0]),
    )


def _pressure_cdf(points: list[Point]) -> np.ndarray:
    density = curve(points, lambda p: p.observables["pressures"].mean(axis=0))
    return np.cumsum(density) / np.sum(density)


def _crossing_claim(points: list[Point]) -> Claim:
    parts, holds = [], []
    for volume, group in _by_volume(points).items():
        slopes = sorted({p.changes[SLOPE] for p in group})
        by_slope = {key[0]: found for key, found in grouped(group, SLOPE).items()}
        for time in (1.0, 1e3):
            values = [mean(p.at(time) / p.summary["load"] for p in by_slope[h]).value for h in slopes]
            trend = "rises" if values[-1] > values[0] else "falls"
            parts.append(f"ΔV = {volume:g} Å³, {time:g} s: {trend} from {values[0]:.3f} to {values[-1]:.3f}")
            holds.append(trend == ("rises" if volume and time == 1.0 else "falls"))
    return Claim(
        "fig3",
        "with ΔV, Δμ rises with h' at 1 s and falls by 1e3 s; without, it falls at both",
        "; ".join(parts),
        all(holds),
    )


def onset(points: list[Point]) -> float:
    """Hold time at which the local slope dΔF/dlog10 t first reaches half of the fitted slope, s."""
    times, drop = points[0].hold_times, curve(points, lambda p: p.friction_drop)
    x = np.log10(times)
    slope = np.gradient(drop, x)
    beta = mean(p.summary["beta"] * p.summary["load"] for p in points).value
    first = int(np.argmax(slope >= 0.5 * beta))
    if first == 0:
        return float(times[0])
    share = (0.5 * beta - slope[first - 1]) / (slope[first] - slope[first - 1])
    return float(10 ** (x[first - 1] + share * (x[first] - x[first - 1])))


def _onset_claim(points: list[Point]) -> Claim:
    found = {
        volume: onset([p for p in group if p.changes[SLOPE] == 0.1]) for volume, group in _by_volume(points).items()
    }
    with_pressure, without = found[6.4], found[0.0]
    return Claim(
        "fig3",
        "the logarithmic regime starts at about 1 s with ΔV and at about 10 s without",
        f"the slope reaches half of β at {with_pressure:.2g} s with ΔV and at {without:.2g} s without (h' = 0.1)",
        bool(with_pressure < 2 and 3 < without / with_pressure < 40),
    )


def _saturation_claim(points: list[Point]) -> Claim:
    groups = {key[0]: found for key, found in grouped(points, "interaction.strength").items()}
    drop = {strength: mean(p.at(1e3) for p in group).value for strength, group in groups.items()}
    shown = ", ".join(f"{strength:g} eV {value / drop[0.0]:.3f}" for strength, value in drop.items())
    early, late = drop[0.0] - drop[0.5], drop[0.5] - drop[1.0]
    return Claim(
        "fig4",
        "ΔF falls with I_b and saturates from about 0.5 eV",
        f"ΔF relative to I_b = 0 at 1e3 s: {shown}",
        bool(early > 0 and 0 <= late < 0.2 * early),
    )


def _morphology_claim(points: list[Point]) -> Claim:
    x = np.array([p.summary["perimeter_to_area"] for p in points])
    y = np.array([p.at(1e3) / p.summary["load"] / p.summary["area_fraction"] for p in points])
    slope, height = np.polyfit(x, y, 1)
    change = slope * (x.max() - x.min()) / (height + slope * x.mean())
    straight = np.corrcoef(x, y)[0, 1]
    return Claim(
        "fig5",
        "Δμ·A0/A rises linearly, and weakly, with C/A",
        f"correlation {straight:.3f}; change by {change:.1%} between C/A = {x.min():.2f} and {x.max():.2f} /nm",
        bool(straight > 0.7 and 0 < change < 0.4),
    )
