"""Claims of the paper in words, and whether they hold for what was computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from chemage_li2018 import shapes
from chemage_li2018.comparisons import COMMON, Claim, Studies, by_volume, circle, rows
from chemage_li2018.published import SLOPES
from chemage_li2018.sweeps import LOAD, MEMBER, SEED, SLOPE, VOLUME, VOLUMES, Mean, Point, by, curve, grouped, mean

#: largest factor between a time and one that the paper calls about so long
ABOUT = 3.0
#: largest rms deviation from a line, relative to the values, that a figure shows as straight
STRAIGHT = 0.05


def claims(studies: Studies, targets: Sequence[str]) -> list[Claim]:
    """Compare the claims of ``targets`` in the paper with the computed ``studies``."""
    return [claim for target in targets if target in _CLAIMS for claim in _CLAIMS[target](studies)]


# -- Fig. 2: load -----------------------------------------------------------------------------------------------------


def _fig2(studies: Studies) -> Iterable[Claim]:
    points = studies["loads"]
    yield _logarithmic(points)
    yield _load_claim(points)
    yield _area_claim(points)
    yield _coefficient_claim(points)
    yield _pressure_claim(points)


def _logarithmic(points: list[Point]) -> Claim:
    chosen = by(points, LOAD)[20000.0]
    times, drop = chosen[0].hold_times, np.array([p.friction_drop for p in chosen])
    statement = "ΔF grows with log t from 1 s to 1e5 s"
    if len(chosen) < 3:
        return Claim("fig2", statement, "needs three surfaces for the errors of the shape", None)
    compared = shapes.growth(times, drop, (1.0, 1e5))
    (change, error), best = compared.change, compared.laws[0]
    return Claim(
        "fig2",
        statement,
        f"from the first to the last decade the local slope changes by {change:+.1%} ± {2 * error:.1%}; "
        f"the best law is the {best.name}, the logarithm has AICc +{compared.criterion('logarithm'):.1f}",
        bool(compared.holds("logarithm") or abs(change) + 2 * error <= COMMON),
        compared.laws,
    )


def _over_loads(points: list[Point], time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    groups = by(points, LOAD)
    loads = np.array(list(groups))
    drop = np.array([mean(p.at(time) for p in group).value for group in groups.values()])
    area = np.array([mean(p.summary["area_fraction"] for p in group).value for group in groups.values()])
    return loads, drop, area


def _load_claim(points: list[Point]) -> Claim:
    groups = by(points, LOAD)
    reference = [p.at(1e3) / 20e3 for p in groups[20e3]]
    low, high = (
        mean(p.at(1e3) / load / of_surface for p, of_surface in zip(groups[load], reference, strict=True))
        for load in (50e3, 500e3)
    )
    return Claim(
        "fig2",
        "ΔF is linear in the load at small loads, and sublinear at large loads",
        f"ΔF/F_N at 50 µN is {low} of that at 20 µN, at 500 µN {high} (1e3 s)",
        abs(low.value - 1) < 0.1 and high.value < 0.97,
    )


def _area_claim(points: list[Point]) -> Claim:
    groups = list(by(points, SEED).values())
    area, drop = (np.array([_over_loads(group, 1e3)[part] for group in groups]) for part in (2, 1))
    offset = mean(np.polyfit(x, y, 1)[1] / y.mean() for x, y in zip(area, drop, strict=True))
    power = shapes.exponent(area, drop)
    # a single surface has no interval
    straight = power.within(1.0, STRAIGHT) if len(groups) > 1 else abs(power.value - 1) <= STRAIGHT
    return Claim(
        "fig2",
        "ΔF is linear in A up to A/A0 = 0.22, without an offset",
        f"ΔF ∝ A to the power {power}; offset {offset} of the mean ΔF, up to A/A0 = {area.max():.3f} (1e3 s)",
        bool(straight and abs(offset.value) < STRAIGHT),
    )


def _coefficient_claim(points: list[Point]) -> Claim:
    means = {load: mean(p.at(1e3) / load for p in group) for load, group in by(points, LOAD).items()}
    loads, ratio = np.array(list(means)), np.array([of_load.value for of_load in means.values()])
    return Claim(
        "fig2",
        "Δμ is constant at small loads and falls at large loads",
        ", ".join(f"{load / 1000:g} µN {of_load}" for load, of_load in means.items()) + " (1e3 s)",
        bool(np.ptp(ratio[loads <= 50e3]) / ratio[loads <= 50e3].mean() < 0.15 and ratio[-1] < ratio[:4].min()),
    )


def _pressure_claim(points: list[Point]) -> Claim:
    groups = by(points, LOAD)
    reference = [_cumulative(point) for point in groups[20000.0]]
    distances = {
        load / 1000: mean(np.abs(_cumulative(p) - of_20).max() for p, of_20 in zip(group, reference, strict=True))
        for load, group in groups.items()
    }
    small = max(distance.value for load, distance in distances.items() if load <= 100)
    return Claim(
        "fig2",
        "the distribution of the contact pressure does not depend on the load at small loads",
        "largest distance of the cumulative distributions from that at 20 µN: "
        + ", ".join(f"{load:g} µN {distance}" for load, distance in distances.items()),
        bool(small < 0.06 and distances[500.0].value > 2 * distances[50.0].value),
    )


def _cumulative(point: Point) -> np.ndarray:
    density = point.observables["pressures"]
    return np.cumsum(density) / np.sum(density)


# -- Fig. 3: roughness ------------------------------------------------------------------------------------------------


def _fig3(studies: Studies) -> Iterable[Claim]:
    volumes = by_volume(studies["rows"])
    yield _trend_claim(volumes)
    yield _reversal_claim(volumes[6.4])
    yield _onset_claim({volume: circle(points) for volume, points in volumes.items()})
    yield _offset_claim(volumes[6.4])
    yield _proportional_claim(volumes[0.0])
    yield _others_claim(volumes)


def _trend_claim(volumes: dict[float, list[Point]]) -> Claim:
    parts, holds = [], []
    for volume, points in volumes.items():
        by_slope = by(circle(points), SLOPE)
        for time in (1.0, 1e3):
            first, *_, last = (mean(p.at(time) / p.summary["load"] for p in by_slope[h]) for h in SLOPES)
            trend = "rises" if last.value > first.value else "falls"
            parts.append(f"ΔV = {volume:g} Å³, {time:g} s: {trend} from {first} to {last}")
            holds.append(trend == ("rises" if volume and time == 1.0 else "falls"))
    return Claim(
        "fig3",
        "with ΔV, Δμ rises with h' at 1 s and falls by 1e3 s; without, it falls at both",
        "; ".join(parts),
        all(holds),
        calibrated=True,
    )


def crossing(lower: list[Point], upper: list[Point]) -> float:
    """Hold time at which Δμ of the points ``lower`` first exceeds that of ``upper``, s; nan if it never does."""
    times = lower[0].hold_times
    gap = curve(lower, lambda p: p.coefficient) - curve(upper, lambda p: p.coefficient)
    below = np.flatnonzero(gap < 0)
    if not below.size or below[-1] + 1 == times.size:
        return math.nan
    last, x = below[-1], np.log10(times)
    share = -gap[last] / (gap[last + 1] - gap[last])
    return float(10 ** (x[last] + share * (x[last + 1] - x[last])))


def _reversal_claim(points: list[Point]) -> Claim:
    found = {}
    for row, group in rows(points):
        by_slope = by(group, SLOPE)
        pairs = zip(by_slope[SLOPES[0]], by_slope[SLOPES[-1]], strict=True)
        found[row.name] = mean(crossing([smooth], [rough]) for smooth, rough in pairs)
    return Claim(
        "fig3",
        "with ΔV, the order of the slopes reverses between 1 and 10 s, for every row",
        "Δμ of h' = 0.05 passes that of h' = 0.2 at " + ", ".join(f"{t} s ({row})" for row, t in found.items()),
        all(1 <= time.value <= 10 for time in found.values()),
        calibrated=True,
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


def _onset_claim(volumes: dict[float, list[Point]]) -> Claim:
    with_pressure, without = (mean(onset([p]) for p in by(volumes[volume], SLOPE)[0.1]) for volume in (6.4, 0.0))
    return Claim(
        "fig3",
        "the logarithmic regime starts at about 1 s with ΔV and at about 10 s without",
        f"the slope reaches half of β at {with_pressure} s with ΔV and at {without} s without (h' = 0.1)",
        bool(1 / ABOUT <= with_pressure.value <= ABOUT and 10 / ABOUT <= without.value <= 10 * ABOUT),
        calibrated=True,
    )


def against_area(points: Sequence[Point], time: float) -> tuple[np.ndarray, np.ndarray]:
    """A/A0 and Δμ at a hold time (s), means over surfaces, (rows, slopes)."""
    groups = [list(by(group, SLOPE).values()) for _, group in rows(points)]
    area = [[mean(p.summary["area_fraction"] for p in g).value for g in groups_of_slope] for groups_of_slope in groups]
    drop = [
        [mean(p.at(time) / p.summary["load"] for p in g).value for g in groups_of_slope] for groups_of_slope in groups
    ]
    return np.array(area), np.array(drop)


class _Line(NamedTuple):
    """The line of Δμ against A/A0 over rows and slopes."""

    #: rms of Δμ over the line, less one
    deviation: float
    r2: float
    #: relative to the mean Δμ, over surface seeds
    offset: Mean

    @classmethod
    def of(cls, points: Sequence[Point], time: float) -> _Line:
        area, drop = (part.ravel() for part in against_area(points, time))
        offsets = []
        for group in by(points, SEED).values():
            x, y = (part.ravel() for part in against_area(group, time))
            offsets.append(float(np.polyfit(x, y, 1)[1] / y.mean()))
        line = np.polynomial.Polynomial.fit(area, drop, 1)
        deviation = float(np.sqrt(np.mean((drop / line(area) - 1) ** 2)))
        return cls(deviation, float(np.corrcoef(area, drop)[0, 1] ** 2), mean(offsets))

    def __str__(self) -> str:
        return f"{self.deviation:.1%} (R² = {self.r2:.3f})"


def _offset_claim(points: list[Point]) -> Claim:
    early, late = _Line.of(points, 1.0), _Line.of(points, 1e3)
    offset = late.offset
    return Claim(
        "fig3",
        "with ΔV, Δμ is linear in A/A0, with a positive offset at 1e3 s",
        f"rms deviation from the line {early} at 1 s, where Δμ falls with A, and {late} at 1e3 s; "
        f"offset at 1e3 s {offset} of the mean Δμ",
        bool(
            max(early.deviation, late.deviation) < STRAIGHT
            and offset.value > 2 * (offset.scatter if offset.count > 1 else 0.0)
        ),
    )


def _proportional_claim(points: list[Point]) -> Claim:
    early, late = _Line.of(points, 1.0), _Line.of(points, 1e3)
    return Claim(
        "fig3",
        "without ΔV, Δμ is proportional to A/A0 at all times",
        f"rms deviation from the line {early} at 1 s and {late} at 1e3 s; offset {early.offset} and {late.offset} "
        "of the mean Δμ",
        bool(
            max(early.deviation, late.deviation) < STRAIGHT
            and max(abs(early.offset.value), abs(late.offset.value)) < STRAIGHT
        ),
    )


def _others_claim(volumes: dict[float, list[Point]]) -> Claim:
    parts, worst = [], []
    for volume, points in volumes.items():
        for time in (1.0, 1e3):
            found = _Line.of(points, time).deviation
            parts.append(f"ΔV = {volume:g} Å³, {time:g} s: {found:.1%}")
            worst.append(found)
    return Claim(
        "fig3",
        "at equal A/A0 the other parameters of the roughness hardly matter",
        "rms deviation of the rows from the line in A/A0: " + "; ".join(parts),
        max(worst) < STRAIGHT,
    )


# -- Fig. 4 to 6, Table 1, κ ------------------------------------------------------------------------------------------


def _fig4(studies: Studies) -> Iterable[Claim]:
    with_volume = by_volume(studies["slopes"])[6.4]
    groups = by(with_volume, SLOPE)
    pressures = [mean(p.summary["mean_contact_pressure"] for p in groups[h]) for h in SLOPES]
    pressure = [of_slope.value for of_slope in pressures]
    means, widths = [], []
    for slope in SLOPES:
        edges = groups[slope][0].observables["barrier_edges"]
        density = curve(groups[slope], lambda p: p.observables["barriers_start"])
        centre = 0.5 * (edges[1:] + edges[:-1])
        means.append(float(np.average(centre, weights=density)))
        widths.append(float(np.sqrt(np.average((centre - means[-1]) ** 2, weights=density))))
    listed = ", ".join(
        f"h' = {h:g}: {p} GPa, {m:.3f} and {w:.3f} eV"
        for h, p, m, w in zip(SLOPES, pressures, means, widths, strict=True)
    )
    yield Claim(
        "fig4",
        "a larger slope raises and widens the pressure, and lowers and widens E_form(t = 0)",
        f"mean pressure, and mean and standard deviation of the barrier: {listed}",
        pressure == sorted(pressure) and means == sorted(means, reverse=True) and widths == sorted(widths),
    )


def morphology(points: Sequence[Point]) -> tuple[np.ndarray, np.ndarray]:
    """C/A (1/nm) and Δμ·A0/A at 1e3 s of every point."""
    x = np.array([p.summary["perimeter_to_area"] for p in points])
    return x, np.array([p.at(1e3) / p.summary["load"] / p.summary["area_fraction"] for p in points])


def _fig5(studies: Studies) -> Iterable[Claim]:
    for slope, group in by(by_volume(studies["rows"])[0.0], SLOPE).items():
        x, y = morphology(group)
        rise, height = np.polyfit(x, y, 1)
        change = rise * (x.max() - x.min()) / (height + rise * x.mean())
        means = np.array(
            [[part.mean() for part in morphology(groups_of_slope)] for _, groups_of_slope in rows(group)]
        ).T
        straight, of_means = np.corrcoef(x, y)[0, 1], np.corrcoef(means)[0, 1]
        yield Claim(
            "fig5",
            f"Δμ·A0/A rises linearly, and weakly, with C/A at h' = {slope:g} (ΔV = 0)",
            f"correlation {straight:.3f} of the {x.size} surfaces, {of_means:.3f} of the means of the rows; "
            f"change by {change:.1%} between C/A = {x.min():.2f} and {x.max():.2f} /nm",
            bool(min(straight, of_means) > 0.95 and 0 < change < 0.4),
        )


_MORE_PATCHES = {
    "a lower H": ("circle", "square", "diamond"),
    "a higher ζ": ("triangle down", "triangle up", "circle"),
    "a higher η": ("cross", "circle", "asterisk"),
}


def _table1(studies: Studies) -> Iterable[Claim]:
    ratios, errors = [], []
    for row, group in rows(studies["table"]):
        found = mean(p.summary["patches"] for p in group)
        ratios.append(found.value / float(row.patches) - 1)
        errors.append(found.scatter / float(row.patches) * math.sqrt(1 + 1 / found.count))
    low, shift = sum(r < 0 for r in ratios), float(np.mean(ratios))
    error = math.sqrt(sum(e * e for e in errors)) / len(errors)
    known = math.isfinite(error)
    yield Claim(
        "table1",
        "N_p of the seven rows together: ours do not differ from the paper's on the whole",
        f"ours are lower in {low} of 7 rows, by {-shift:.1%} on average"
        + (f"; the scatter between surfaces allows ±{2 * error:.1%} (two standard deviations)" if known else ""),
        abs(shift) <= (2 * error if known else 0.1) and 0 < low < 7,
    )
    counts = {row.name: np.array([p.summary["patches"] for p in group]) for row, group in rows(studies["table"])}
    for what, names in _MORE_PATCHES.items():
        pairs = list(pairwise(names))
        share = np.mean([np.all([counts[a] < counts[b] for a, b in pairs], axis=0)])
        yield Claim(
            "table1",
            f"{what} gives more patches",
            " < ".join(f"{mean(counts[name])} ({name})" for name in names) + f"; so on {share:.0%} of the surfaces",
            all(counts[a].mean() < counts[b].mean() for a, b in pairs),
        )


def _interaction(studies: Studies) -> Iterable[Claim]:
    groups = by(studies["interaction"], "interaction.strength")
    without = [p.at(1e3) for p in groups[0.0]]
    drop = {
        strength: mean(p.at(1e3) / free for p, free in zip(group, without, strict=True))
        for strength, group in groups.items()
    }
    shown = ", ".join(f"{strength:g} eV {relative}" for strength, relative in drop.items())
    early, late = drop[0.0].value - drop[0.5].value, drop[0.5].value - drop[1.0].value
    yield Claim(
        "interaction",
        "ΔF falls with I_b and saturates from about 0.5 eV",
        f"ΔF relative to I_b = 0 at 1e3 s: {shown}",
        bool(early > 0 and abs(late) < 0.2 * early),
    )


# -- temperature and tips ---------------------------------------------------------------------------------------------


def summit(kelvin: Sequence[float], values: Sequence[float]) -> float:
    """Temperature of the largest of ``values``, from the parabola through it and its neighbours, or an end."""
    top = int(np.argmax(values))
    if top in (0, len(values) - 1):
        return float(kelvin[top])
    a, b, _ = np.polyfit(kelvin[top - 1 : top + 2], values[top - 1 : top + 2], 2)
    return float(-b / (2 * a))


def _summits(points: list[Point], value: Callable[[Point], float] = Point.beta) -> Mean:
    """Temperature of the largest value, mean over surfaces."""
    surfaces = by(points, SEED).values() if SEED in points[0].changes else [points]
    groups = [by(group, "hold.temperature") for group in surfaces]
    return mean(summit(list(group), [value(one[0]) for one in group.values()]) for group in groups)


def _temperature(studies: Studies) -> Iterable[Claim]:
    for study, name in (("warm rough", "rough contact"), ("warm tip", "tip")):
        top = _summits(studies[study])
        early, late = (_summits(studies[study], lambda p, w=w: p.beta(w)) for w in ((1.0, 1e3), (1e2, 1e4)))
        members = by(studies["warm members"], MEMBER).values() if study == "warm rough" else []
        of_members = [_summits(group).value for group in members]
        over = f"over the members of the density {min(of_members):.0f} to {max(of_members):.0f} K; " if members else ""
        drops = ((time, _summits(studies[study], lambda p, t=time: p.at(t))) for time in (1e2, 1e4))
        yield Claim(
            "temperature",
            f"ageing is not monotonic in temperature and is largest near room temperature, {name}",
            f"β (10 to 1e4 s) is largest at {_kelvin(top)}, over 1 to 1e3 s at {_kelvin(early)} and over 100 to 1e4 s "
            f"at {_kelvin(late)}; {over}ΔF at " + ", ".join(f"{time:g} s at {_kelvin(t)}" for time, t in drops),
            abs(top.value - 300) <= 30,
        )


def _kelvin(temperature: Mean) -> str:
    return f"{temperature if temperature.count > 1 else format(temperature.value, '.0f')} K"


def _tips(studies: Studies) -> Iterable[Claim]:
    for radius, group in by(studies["tips"], "surface.radius").items():
        load = np.array([p.changes[LOAD] for p in group])
        drop = np.array([p.at(1e3) for p in group])
        # half a 95 % interval is two standard errors
        error = np.array([p.friction_drop_half_width[p.index(1e3)] / 2 for p in group])
        laws = shapes.of_load(load, drop, error)
        line = next(law for law in laws if law.name == "line")
        power = next(law for law in laws if law.name == "power")
        more = line.criterion - laws[0].criterion
        offset, slope = line.parameters
        yield Claim(
            "tips",
            f"ΔF of a tip is linear in the load, with an offset (radius {radius:g} nm)",
            f"line {offset:.0f} nN + {slope:.2f} F_N at 1e3 s; the best law is the {laws[0].name}, "
            f"the line has AICc +{more:.1f}; as a power of the load: {power.parameters[1]:.2f}",
            bool(more <= shapes.EQUAL and offset > 0),
            laws,
        )
    if "slopes" in studies:
        yield _tips_over_rough(studies)


def _tips_over_rough(studies: Studies) -> Claim:
    groups = by(by_volume(studies["slopes"])[6.4], SLOPE)
    rough = {slope: mean(p.beta() for p in group) for slope, group in groups.items()}
    tips = [p.beta() for p in studies["tips"]]
    ratios = [tip / beta.value for tip in tips for beta in rough.values()]
    return Claim(
        "tips",
        "β of single asperities is one to two orders of magnitude above that of rough contacts",
        f"{min(tips):.2g} to {max(tips):.2g} for tips, "
        + ", ".join(f"{beta} (h' = {slope:g})" for slope, beta in rough.items())
        + f": a factor of {min(ratios):.2g} to {max(ratios):.2g}",
        bool(min(ratios) >= 10 and max(ratios) <= 100),
    )


# -- the density, and what is not tested ------------------------------------------------------------------------------


def _calibration(studies: Studies) -> Iterable[Claim]:
    failing = []
    members = by(studies["members"], MEMBER)
    for number, points in members.items():
        groups = grouped((p for p in points if p.changes[SLOPE] in SLOPES), VOLUME, SLOPE)
        for volume in VOLUMES:
            ends = [groups[volume, slope][0].coefficient for slope in (SLOPES[0], SLOPES[-1])]
            first, later = (points[0].index(time) for time in (1.0, 1e3))
            rises = ends[1][first] > ends[0][first]
            if rises != bool(volume) or ends[1][later] >= ends[0][later]:
                failing.append(number)
    yield Claim(
        "calibration",
        "the form of the barrier density does not matter qualitatively",
        f"with ΔV, Δμ rises with h' at 1 s and falls at 1e3 s, and without it falls at both, for "
        f"{len(members) - len(set(failing))} of {len(members)} densities, on one surface (h' = 0.05 and 0.2)",
        not failing,
        calibrated=True,
    )


def _untested(_: Studies) -> Iterable[Claim]:
    for statement, reason in _UNTESTED.items():
        yield Claim("estimates", statement, reason, None)


_UNTESTED = {
    "larger systems give the same": "not computed: a system of twice the size has 5000 × 5000 pixels per surface",
    "the interaction has little effect on rupture": "an assumption of the model: E_break does not depend on neighbours",
    "h' = 0.26 extrapolates to about 1": "about measured surfaces; h' is a given number here",
}


_CLAIMS: dict[str, Callable[[Studies], Iterable[Claim]]] = {
    "fig2": _fig2,
    "fig3": _fig3,
    "fig4": _fig4,
    "fig5": _fig5,
    "table1": _table1,
    "interaction": _interaction,
    "temperature": _temperature,
    "tips": _tips,
    "estimates": _untested,
    "calibration": _calibration,
}
