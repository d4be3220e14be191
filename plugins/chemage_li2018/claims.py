"""Claims of the paper in words, and whether they hold for what was computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from chemage.plugin import FIT_WINDOW
from chemage_li2018 import shapes
from chemage_li2018.comparisons import COMMON, Claim
from chemage_li2018.published import SLOPES
from chemage_li2018.sweeps import (
    KELVIN,
    LOAD,
    MEMBER,
    RADIUS,
    SEED,
    SLOPE,
    STRENGTH,
    VOLUME,
    VOLUMES,
    Mean,
    PointSet,
    Studies,
    mean,
)

#: largest factor between a time and one that the paper calls about so long
ABOUT = 3.0
#: largest rms deviation from a line, relative to the values, that a figure shows as straight
STRAIGHT = 0.05


def claims(studies: Studies, targets: Sequence[str]) -> list[Claim]:
    """Compare the claims of ``targets`` in the paper with the computed ``studies``."""
    found = []
    for target in targets:
        for judge in _JUDGES.get(target, ()):
            found += [claim._replace(target=target) for claim in judge(studies)]
    return found


# -- Fig. 2: load -----------------------------------------------------------------------------------------------------


def _logarithmic(studies: Studies) -> Iterable[Claim]:
    chosen = studies["loads"].by(LOAD)[20000.0]
    statement = "ΔF grows with log t from 1 s to 1e5 s"
    if len(chosen) < 3:
        yield Claim(statement, "needs three surfaces for the errors of the shape", None)
        return
    compared = shapes.growth(chosen.times, chosen.drop, (1.0, 1e5))
    (change, error), best = compared.change, compared.laws[0]
    yield Claim(
        statement,
        f"from the first to the last decade the local slope changes by {change:+.1%} ± {2 * error:.1%}; "
        f"the best law is the {best.name}, the logarithm has AICc +{compared.criterion('logarithm'):.1f}",
        bool(compared.holds("logarithm") or abs(change) + 2 * error <= COMMON),
        compared.laws,
    )


def _over_loads(studies: Studies) -> Iterable[Claim]:
    groups = studies["loads"].by_load()
    # over loads and surfaces
    drop = {load: group.at(1e3) / load / 1000 for load, group in groups.items()}
    low, high = (mean(drop[load] / drop[20.0]) for load in (50.0, 500.0))
    yield Claim(
        "ΔF is linear in the load at small loads, and sublinear at large loads",
        f"ΔF/F_N at 50 µN is {low} of that at 20 µN, at 500 µN {high} (1e3 s)",
        abs(low.value - 1) < 0.1 and high.value < 0.97,
    )
    area = np.array([group.of("area_fraction") for group in groups.values()]).T
    force = np.array([group.at(1e3) for group in groups.values()]).T
    offset = mean(
        np.polyfit(x, y, 1)[1] / y.mean() for x, y in zip(area, force, strict=True)
    )
    power = shapes.Exponent.of(area, force)
    # a single surface has no interval
    straight = (
        power.within(1.0, STRAIGHT)
        if len(area) > 1
        else abs(power.value - 1) <= STRAIGHT
    )
    yield Claim(
        "ΔF is linear in A up to A/A0 = 0.22, without an offset",
        f"ΔF ∝ A to the power {power}; offset {offset} of the mean ΔF, up to A/A0 = {area.max():.3f} (1e3 s)",
        bool(straight and abs(offset.value) < STRAIGHT),
    )
    means = {load: mean(values) for load, values in drop.items()}
    small = np.array([one.value for load, one in means.items() if load <= 50])
    yield Claim(
        "Δμ is constant at small loads and falls at large loads",
        ", ".join(f"{load:g} µN {of_load}" for load, of_load in means.items())
        + " (1e3 s)",
        bool(np.ptp(small) / small.mean() < 0.15 and means[500.0].value < small.min()),
    )
    shares = {}
    for load, group in groups.items():
        density = group.observed("pressures")
        shares[load] = np.cumsum(density, axis=1) / density.sum(axis=1, keepdims=True)
    distances = {
        load: mean(np.abs(share - shares[20.0]).max(axis=1))
        for load, share in shares.items()
    }
    yield Claim(
        "the distribution of the contact pressure does not depend on the load at small loads",
        "largest distance of the cumulative distributions from that at 20 µN: "
        + ", ".join(f"{load:g} µN {distance}" for load, distance in distances.items()),
        max(distance.value for load, distance in distances.items() if load <= 100)
        < 0.06
        and distances[500.0].value > 2 * distances[50.0].value,
    )


# -- Fig. 3: roughness ------------------------------------------------------------------------------------------------


def _trend(studies: Studies) -> Iterable[Claim]:
    parts, holds = [], []
    for volume, points in studies["rows"].by_volume().items():
        by_slope = points.circle().by(SLOPE)
        for time in (1.0, 1e3):
            first, last = (
                mean(by_slope[slope].coefficient_at(time))
                for slope in (SLOPES[0], SLOPES[-1])
            )
            trend = "rises" if last.value > first.value else "falls"
            parts.append(
                f"ΔV = {volume:g} Å³, {time:g} s: {trend} from {first} to {last}"
            )
            holds.append(trend == ("rises" if volume and time == 1.0 else "falls"))
    yield Claim(
        "with ΔV, Δμ rises with h' at 1 s and falls by 1e3 s; without, it falls at both",
        "; ".join(parts),
        all(holds),
        calibrated=True,
    )


def crossings(lower: PointSet, upper: PointSet) -> np.ndarray:
    """Hold time at which Δμ of each of ``lower`` first exceeds that of ``upper``, s, (n,); nan if it never does."""
    gap = upper.coefficient - lower.coefficient
    never = (gap <= 0).all(axis=1) | (gap[:, -1] > 0)
    return np.where(never, np.nan, shapes.last_positive(lower.times, gap))


def onsets(points: PointSet) -> np.ndarray:
    """Hold time at which the local slope dΔF/dlog10 t first reaches half of the fitted slope, s, (n,)."""
    slope = np.gradient(points.coefficient, np.log10(points.times), axis=1)
    return shapes.first_reaching(points.times, slope, 0.5 * points.of("beta"))


def _reversal(studies: Studies) -> Iterable[Claim]:
    found = {}
    for row, group in studies["rows"].by_volume()[6.4].by_row().items():
        by_slope = group.by(SLOPE)
        found[row.name] = mean(crossings(by_slope[SLOPES[0]], by_slope[SLOPES[-1]]))
    yield Claim(
        "with ΔV, the order of the slopes reverses between 1 and 10 s, for every row",
        "Δμ of h' = 0.05 passes that of h' = 0.2 at "
        + ", ".join(f"{t} s ({row})" for row, t in found.items()),
        all(1 <= time.value <= 10 for time in found.values()),
        calibrated=True,
    )


def _onset(studies: Studies) -> Iterable[Claim]:
    volumes = studies["rows"].by_volume()
    with_pressure, without = (
        mean(onsets(volumes[volume].circle().by(SLOPE)[0.1])) for volume in (6.4, 0.0)
    )
    yield Claim(
        "the logarithmic regime starts at about 1 s with ΔV and at about 10 s without",
        f"the slope reaches half of β at {with_pressure} s with ΔV and at {without} s without (h' = 0.1)",
        bool(
            1 / ABOUT <= with_pressure.value <= ABOUT
            and 10 / ABOUT <= without.value <= 10 * ABOUT
        ),
        calibrated=True,
    )


class _AreaLine(NamedTuple):
    """The line of Δμ against A/A0 over rows and slopes."""

    #: rms of Δμ over the line, less one
    deviation: float
    r2: float
    #: relative to the mean Δμ, over surface seeds
    offset: Mean

    @staticmethod
    def coordinates(points: PointSet, time: float) -> np.ndarray:
        """A/A0 and Δμ at a hold time (s), means over the surfaces of each row and slope, (2, rows × slopes)."""
        means = []
        for group in points.by_row().values():
            for of_slope in group.by(SLOPE).values():
                means.append(
                    (
                        of_slope.of("area_fraction").mean(),
                        of_slope.coefficient_at(time).mean(),
                    )
                )
        return np.array(means).T

    @classmethod
    def of(cls, points: PointSet, time: float) -> _AreaLine:
        area, drop = cls.coordinates(points, time)
        offsets = []
        for group in points.by(SEED).values():
            x, y = cls.coordinates(group, time)
            offsets.append(float(np.polyfit(x, y, 1)[1] / y.mean()))
        line = np.polynomial.Polynomial.fit(area, drop, 1)
        deviation = float(np.sqrt(np.mean((drop / line(area) - 1) ** 2)))
        return cls(deviation, float(np.corrcoef(area, drop)[0, 1] ** 2), mean(offsets))

    def __str__(self) -> str:
        return f"{self.deviation:.1%} (R² = {self.r2:.3f})"


def _against_areas(studies: Studies) -> Iterable[Claim]:
    volumes = studies["rows"].by_volume()
    lines = {
        (volume, time): _AreaLine.of(volumes[volume], time)
        for volume in (6.4, 0.0)
        for time in (1.0, 1e3)
    }
    worst = {
        volume: max(lines[volume, time].deviation for time in (1.0, 1e3))
        for volume in volumes
    }
    early, late = lines[6.4, 1.0], lines[6.4, 1e3]
    error = late.offset.scatter if late.offset.count > 1 else 0.0
    yield Claim(
        "with ΔV, Δμ is linear in A/A0, with a positive offset at 1e3 s",
        f"rms deviation from the line {early} at 1 s, where Δμ falls with A, and {late} at 1e3 s; "
        f"offset at 1e3 s {late.offset} of the mean Δμ",
        worst[6.4] < STRAIGHT and late.offset.value > 2 * error,
    )
    early, late = lines[0.0, 1.0], lines[0.0, 1e3]
    yield Claim(
        "without ΔV, Δμ is proportional to A/A0 at all times",
        f"rms deviation from the line {early} at 1 s and {late} at 1e3 s; offset {early.offset} and {late.offset} "
        "of the mean Δμ",
        worst[0.0] < STRAIGHT
        and max(abs(early.offset.value), abs(late.offset.value)) < STRAIGHT,
    )
    yield Claim(
        "at equal A/A0 the other parameters of the roughness hardly matter",
        "rms deviation of the rows from the line in A/A0: "
        + "; ".join(
            f"ΔV = {v:g} Å³, {time:g} s: {line.deviation:.1%}"
            for (v, time), line in lines.items()
        ),
        max(worst.values()) < STRAIGHT,
    )


# -- Fig. 4 to 6, Table 1, κ ------------------------------------------------------------------------------------------


def barrier_moments(
    edges: np.ndarray, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (eV) of densities (..., k) of the barrier between ``edges`` (k + 1)."""
    centre = 0.5 * (edges[1:] + edges[:-1])
    weights = density / density.sum(axis=-1, keepdims=True)
    middle = weights @ centre
    return middle, np.sqrt((weights * (centre - middle[..., None]) ** 2).sum(axis=-1))


def _distributions(studies: Studies) -> Iterable[Claim]:
    groups = studies["slopes"].by_volume()[6.4].by(SLOPE)
    pressures = [mean(group.of("mean_contact_pressure")) for group in groups.values()]
    edges = studies["slopes"][0].observables["barrier_edges"]
    density = np.array(
        [group.observed("barriers_start").mean(axis=0) for group in groups.values()]
    )
    means, widths = barrier_moments(edges, density)
    listed = ", ".join(
        f"h' = {h:g}: {p} GPa, {m:.3f} and {w:.3f} eV"
        for h, p, m, w in zip(groups, pressures, means, widths, strict=True)
    )
    pressure = [one.value for one in pressures]
    yield Claim(
        "a larger slope raises and widens the pressure, and lowers and widens E_form(t = 0)",
        f"mean pressure, and mean and standard deviation of the barrier: {listed}",
        bool(min(*np.diff(pressure), *np.diff(widths), *-np.diff(means)) >= 0),
    )


def morphology(points: PointSet) -> tuple[np.ndarray, np.ndarray]:
    """C/A (1/nm) and Δμ·A0/A at 1e3 s of every point."""
    return points.of("perimeter_to_area"), points.coefficient_at(1e3) / points.of(
        "area_fraction"
    )


def _morphologies(studies: Studies) -> Iterable[Claim]:
    for slope, group in studies["rows"].by_volume()[0.0].by(SLOPE).items():
        x, y = morphology(group)
        rise, height = np.polyfit(x, y, 1)
        change = rise * (x.max() - x.min()) / (height + rise * x.mean())
        means = np.array(
            [np.mean(morphology(of_row), axis=1) for of_row in group.by_row().values()]
        )
        straight, of_means = np.corrcoef(x, y)[0, 1], np.corrcoef(means.T)[0, 1]
        yield Claim(
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


def _patches(studies: Studies) -> Iterable[Claim]:
    counts, ratios = {}, []
    for row, group in studies["table"].by_row().items():
        counts[row.name] = group.of("patches")
        ratios.append(mean(counts[row.name] / float(row.patches)))
    low = sum(one.value < 1 for one in ratios)
    shift = float(np.mean([one.value - 1 for one in ratios]))
    # of one more surface, and the mean of those of the rows
    error = math.hypot(
        *(one.scatter * math.sqrt(1 + 1 / one.count) for one in ratios)
    ) / len(ratios)
    known = math.isfinite(error)
    yield Claim(
        "N_p of the seven rows together: ours do not differ from the paper's on the whole",
        f"ours are lower in {low} of 7 rows, by {-shift:.1%} on average"
        + (
            f"; the scatter between surfaces allows ±{2 * error:.1%} (two standard deviations)"
            if known
            else ""
        ),
        abs(shift) <= (2 * error if known else 0.1) and 0 < low < 7,
    )
    for what, names in _MORE_PATCHES.items():
        pairs = list(pairwise(names))
        share = np.mean([np.all([counts[a] < counts[b] for a, b in pairs], axis=0)])
        yield Claim(
            f"{what} gives more patches",
            " < ".join(f"{mean(counts[name])} ({name})" for name in names)
            + f"; so on {share:.0%} of the surfaces",
            all(counts[a].mean() < counts[b].mean() for a, b in pairs),
        )


def _saturation(studies: Studies) -> Iterable[Claim]:
    groups = studies["interaction"].by(STRENGTH)
    drop = {
        strength: mean(group.at(1e3) / groups[0.0].at(1e3))
        for strength, group in groups.items()
    }
    early, late = drop[0.0].value - drop[0.5].value, drop[0.5].value - drop[1.0].value
    yield Claim(
        "ΔF falls with I_b and saturates from about 0.5 eV",
        "ΔF relative to I_b = 0 at 1e3 s: "
        + ", ".join(f"{at:g} eV {relative}" for at, relative in drop.items()),
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


def _summits(points: PointSet, value: Callable[[PointSet], np.ndarray]) -> Mean:
    """Temperature of the largest value, mean over surfaces."""
    groups = points.by(KELVIN)
    of_surfaces = np.array([value(group) for group in groups.values()]).T
    return mean(summit(list(groups), values) for values in of_surfaces)


def _temperature(studies: Studies) -> Iterable[Claim]:
    for study, name in (("warm rough", "rough contact"), ("warm tip", "tip")):
        top, early, late = (
            _summits(studies[study], lambda group, w=window: group.beta(w))
            for window in (FIT_WINDOW, (1.0, 1e3), (1e2, 1e4))
        )
        over = ""
        if study == "warm rough":
            groups = studies["warm members"].by(MEMBER).values()
            of_members = [_summits(group, PointSet.beta).value for group in groups]
            over = f"over the members of the density {min(of_members):.0f} to {max(of_members):.0f} K; "
        drops = (
            (time, _summits(studies[study], lambda group, t=time: group.at(t)))
            for time in (1e2, 1e4)
        )
        yield Claim(
            f"ageing is not monotonic in temperature and is largest near room temperature, {name}",
            f"β (10 to 1e4 s) is largest at {_kelvin(top)}, over 1 to 1e3 s at {_kelvin(early)} and over 100 to 1e4 s "
            f"at {_kelvin(late)}; {over}ΔF at "
            + ", ".join(f"{time:g} s at {_kelvin(t)}" for time, t in drops),
            abs(top.value - 300) <= 30,
        )


def _kelvin(temperature: Mean) -> str:
    return f"{temperature if temperature.count > 1 else format(temperature.value, '.0f')} K"


def _tips(studies: Studies) -> Iterable[Claim]:
    for radius, group in studies["tips"].by(RADIUS).items():
        # half a 95 % interval is two standard errors
        laws = shapes.of_load(
            group.swept(LOAD), group.at(1e3), group.half_width_at(1e3) / 2
        )
        named = {law.name: law for law in laws}
        more = named["line"].criterion - laws[0].criterion
        offset, slope = named["line"].parameters
        yield Claim(
            f"ΔF of a tip is linear in the load, with an offset (radius {radius:g} nm)",
            f"line {offset:.0f} nN + {slope:.2f} F_N at 1e3 s; the best law is the {laws[0].name}, "
            f"the line has AICc +{more:.1f}; as a power of the load: {named['power'].parameters[1]:.2f}",
            bool(more <= shapes.EQUAL and offset > 0),
            laws,
        )
    if "slopes" not in studies:
        return
    groups = studies["slopes"].by_volume()[6.4].by(SLOPE)
    rough = {slope: mean(group.beta()) for slope, group in groups.items()}
    tips = studies["tips"].beta()
    ratios = [tips / beta.value for beta in rough.values()]
    least, most = float(np.min(ratios)), float(np.max(ratios))
    yield Claim(
        "β of single asperities is one to two orders of magnitude above that of rough contacts",
        f"{min(tips):.2g} to {max(tips):.2g} for tips, "
        + ", ".join(f"{beta} (h' = {slope:g})" for slope, beta in rough.items())
        + f": a factor of {least:.2g} to {most:.2g}",
        least >= 10 and most <= 100,
    )


# -- the density, and what is not tested ------------------------------------------------------------------------------


def _every_member(studies: Studies) -> Iterable[Claim]:
    failing = set()
    members = studies["members"].by(MEMBER)
    for number, points in members.items():
        groups = points.by(VOLUME, SLOPE)
        for volume in VOLUMES:
            smooth, rough = (groups[volume, slope] for slope in (SLOPES[0], SLOPES[-1]))
            rises, rises_late = (
                rough.coefficient_at(t)[0] > smooth.coefficient_at(t)[0]
                for t in (1.0, 1e3)
            )
            if rises != bool(volume) or rises_late:
                failing.add(number)
    yield Claim(
        "the form of the barrier density does not matter qualitatively",
        f"with ΔV, Δμ rises with h' at 1 s and falls at 1e3 s, and without it falls at both, for "
        f"{len(members) - len(failing)} of {len(members)} densities, on one surface (h' = 0.05 and 0.2)",
        not failing,
        calibrated=True,
    )


def _untested(_: Studies) -> Iterable[Claim]:
    size = "not computed: a system of twice the size has 5000 × 5000 pixels per surface"
    yield Claim("larger systems give the same", size, None)
    assumed = "an assumption of the model: E_break does not depend on neighbours"
    yield Claim("the interaction has little effect on rupture", assumed, None)
    yield Claim(
        "h' = 0.26 extrapolates to about 1",
        "about measured surfaces; h' is a given number here",
        None,
    )


#: target -> what judges its claims
_JUDGES: dict[str, tuple[Callable[[Studies], Iterable[Claim]], ...]] = {
    "fig2": (_logarithmic, _over_loads),
    "fig3": (_trend, _reversal, _onset, _against_areas),
    "fig4": (_distributions,),
    "fig5": (_morphologies,),
    "table1": (_patches,),
    "interaction": (_saturation,),
    "temperature": (_temperature,),
    "tips": (_tips,),
    "calibration": (_every_member,),
    "estimates": (_untested,),
}
