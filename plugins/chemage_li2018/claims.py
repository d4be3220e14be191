"""Claims of the paper in words, and whether they hold for what was computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import FIT_WINDOW
from chemage_li2018 import shapes
from chemage_li2018.comparisons import COMMON, Claim
from chemage_li2018.published import DATA, SLOPES, TABLE_1
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
    area = np.transpose([group.of("area_fraction") for group in groups.values()])
    force = np.transpose([group.at(1e3) for group in groups.values()])
    offset = mean(map(_offset, area, force))
    power = shapes.Exponent.of(area, force)
    yield Claim(
        "ΔF is linear in A up to A/A0 = 0.22, without an offset",
        f"ΔF ∝ A to the power {power}; offset {offset} of the mean ΔF, up to A/A0 = {area.max():.3f} (1e3 s)",
        power.within(1.0, STRAIGHT) and abs(offset.value) < STRAIGHT,
    )
    means = {load: mean(values) for load, values in drop.items()}
    small = np.array([one.value for load, one in means.items() if load <= 50])
    yield Claim(
        "Δμ is constant at small loads and falls at large loads",
        _listed("{:g} µN {}", means.items()) + " (1e3 s)",
        bool(np.ptp(small) / small.mean() < 0.15 and means[500.0].value < small.min()),
    )
    density = groups.each(lambda group: group.observed("pressures").cumsum(axis=1))
    shares = {load: total / total[:, -1:] for load, total in density.items()}
    distances = {
        load: mean(np.abs(share - shares[20.0]).max(axis=1))
        for load, share in shares.items()
    }
    yield Claim(
        "the distribution of the contact pressure does not depend on the load at small loads",
        "largest distance of the cumulative distributions from that at 20 µN: "
        + _listed("{:g} µN {}", distances.items()),
        max(one.value for load, one in distances.items() if load <= 100) < 0.06
        and distances[500.0].value > 2 * distances[50.0].value,
    )


def _offset(x: np.ndarray, y: np.ndarray) -> float:
    """The offset of the line through y (x), over the mean of y."""
    return float(np.polyfit(x, y, 1)[1] / y.mean())


def _listed(pattern: str, values: Iterable[Iterable[Any]], between: str = ", ") -> str:
    """Values filled into a pattern, one after the other."""
    return between.join(pattern.format(*row) for row in values)


# -- Fig. 3: roughness ------------------------------------------------------------------------------------------------


def _trend(studies: Studies) -> Iterable[Claim]:
    rows, holds = [], []
    for volume, points in studies["rows"].by_volume().items():
        by_slope = points.circle().by(SLOPE)
        for time in (1.0, 1e3):
            found = by_slope.means(lambda one, time=time: one.coefficient_at(time))
            first, last = found[SLOPES[0]], found[SLOPES[-1]]
            trend = "rises" if last.value > first.value else "falls"
            rows.append((volume, time, trend, first, last))
            holds.append(trend == ("rises" if volume and time == 1.0 else "falls"))
    yield Claim(
        "with ΔV, Δμ rises with h' at 1 s and falls by 1e3 s; without, it falls at both",
        _listed("ΔV = {:g} Å³, {:g} s: {} from {} to {}", rows, "; "),
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
        + _listed("{1} s ({0})", found.items()),
        all(1 <= time.value <= 10 for time in found.values()),
        calibrated=True,
    )


def _onset(studies: Studies) -> Iterable[Claim]:
    volumes = studies["rows"].by_volume()
    starts = volumes.means(lambda points: onsets(points.circle().by(SLOPE)[0.1]))
    claimed = {6.4: 1.0, 0.0: 10.0}
    yield Claim(
        "the logarithmic regime starts at about 1 s with ΔV and at about 10 s without",
        f"the slope reaches half of β at {starts[6.4]} s with ΔV and at {starts[0.0]} s without (h' = 0.1)",
        all(
            time / ABOUT <= starts[volume].value <= time * ABOUT
            for volume, time in claimed.items()
        ),
        calibrated=True,
    )


class _AreaLine(NamedTuple):
    """The line through Δμ against A/A0 of rows and slopes."""

    #: rms deviation of the rows, relative
    deviation: float
    r2: float
    #: over the mean Δμ, of each surface
    offset: Mean

    @classmethod
    def of(cls, points: PointSet, time: float) -> _AreaLine:
        """The line at a hold time (s)."""
        area, drop = cls.coordinates(points, time)
        each = points.by(SEED).values()
        offsets = mean(_offset(*cls.coordinates(group, time)) for group in each)
        line = np.polynomial.Polynomial.fit(area, drop, 1)
        deviation = float(np.sqrt(np.mean((drop / line(area) - 1) ** 2)))
        return cls(deviation, float(np.corrcoef(area, drop)[0, 1] ** 2), offsets)

    @staticmethod
    def coordinates(points: PointSet, time: float) -> np.ndarray:
        """A/A0 and Δμ at a hold time (s), means over the surfaces of each row and slope, (2, rows × slopes)."""
        groups = points.by(*TABLE_1[0].options, SLOPE).values()
        means = [
            (group.of("area_fraction").mean(), group.coefficient_at(time).mean())
            for group in groups
        ]
        return np.transpose(means)

    def __str__(self) -> str:
        return f"{self.deviation:.1%} (R² = {self.r2:.3f})"


def _against_areas(studies: Studies) -> Iterable[Claim]:
    volumes = studies["rows"].by_volume()
    lines = {
        (volume, time): _AreaLine.of(volumes[volume], time)
        for volume in (6.4, 0.0)
        for time in (1.0, 1e3)
    }
    deviations = {at: line.deviation for at, line in lines.items()}
    early, late, first, last = lines.values()
    error = np.nan_to_num(late.offset.scatter)
    yield Claim(
        "with ΔV, Δμ is linear in A/A0, with a positive offset at 1e3 s",
        f"rms deviation from the line {early} at 1 s, where Δμ falls with A, and {late} at 1e3 s; "
        f"offset at 1e3 s {late.offset} of the mean Δμ",
        max(early.deviation, late.deviation) < STRAIGHT
        and late.offset.value > 2 * error,
    )
    offsets = first.offset.value, last.offset.value
    yield Claim(
        "without ΔV, Δμ is proportional to A/A0 at all times",
        f"rms deviation from the line {first} at 1 s and {last} at 1e3 s; offset {first.offset} and {last.offset} "
        "of the mean Δμ",
        max(first.deviation, last.deviation, *np.abs(offsets)) < STRAIGHT,
    )
    yield Claim(
        "at equal A/A0 the other parameters of the roughness hardly matter",
        "rms deviation of the rows from the line in A/A0: "
        + _listed("ΔV = {0[0]:g} Å³, {0[1]:g} s: {1:.1%}", deviations.items(), "; "),
        max(deviations.values()) < STRAIGHT,
    )


# -- Fig. 4 to 6, Table 1, κ ------------------------------------------------------------------------------------------


def centres(edges: np.ndarray) -> np.ndarray:
    """The middles between ``edges`` (k + 1,)."""
    return 0.5 * (edges[1:] + edges[:-1])


def barrier_moments(
    points: PointSet, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (eV) of densities (..., k) of the barriers of ``points`` to forming."""
    energy = centres(points[0].observables["barrier_edges"])
    weights = density / density.sum(axis=-1, keepdims=True)
    middle = weights @ energy
    away = energy - middle[..., None]
    return middle, np.sqrt((weights * away**2).sum(axis=-1))


def _distributions(studies: Studies) -> Iterable[Claim]:
    groups = studies["slopes"].by_volume()[6.4].by(SLOPE)
    pressures = groups.means(lambda group: group.of("mean_contact_pressure"))
    moments = groups.each(
        lambda group: barrier_moments(
            group, group.observed("barriers_start").mean(axis=0)
        )
    )
    rows = [(slope, pressures[slope], *moments[slope]) for slope in groups]
    pressure = [one.value for one in pressures.values()]
    means, widths = np.transpose(list(moments.values()))
    yield Claim(
        "a larger slope raises and widens the pressure, and lowers and widens E_form(t = 0)",
        "mean pressure, and mean and standard deviation of the barrier: "
        + _listed("h' = {:g}: {} GPa, {:.3f} and {:.3f} eV", rows),
        bool(min(*np.diff(pressure), *np.diff(widths), *-np.diff(means)) >= 0),
    )


def morphology(points: PointSet) -> tuple[np.ndarray, np.ndarray]:
    """C/A (1/nm) and Δμ·A0/A at 1e3 s of every point."""
    per_area = points.coefficient_at(1e3) / points.of("area_fraction")
    return points.of("perimeter_to_area"), per_area


def _morphologies(studies: Studies) -> Iterable[Claim]:
    for slope, group in studies["rows"].by_volume()[0.0].by(SLOPE).items():
        x, y = morphology(group)
        rise, height = np.polyfit(x, y, 1)
        change = rise * np.ptp(x) / (height + rise * x.mean())
        rows = group.by_row().values()
        means = [np.mean(morphology(row), axis=1) for row in rows]
        straight, of_means = (
            np.corrcoef(np.array(each))[0, 1] for each in ((x, y), np.transpose(means))
        )
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
    groups = studies["table"].by_row()
    counts = {row.name: group.of("patches") for row, group in groups.items()}
    ratios = [mean(counts[row.name] / float(row.patches)) for row in groups]
    low = sum(one.value < 1 for one in ratios)
    shift = float(np.mean([one.value - 1 for one in ratios]))
    # of one more surface, and the mean of those of the rows; None for one surface alone
    errors = [one.scatter * math.sqrt(1 + 1 / one.count) for one in ratios]
    error = 2 * math.hypot(*errors) / len(ratios)
    allowed = (
        f"; the scatter between surfaces allows ±{error:.1%} (two standard deviations)"
    )
    known = math.isfinite(error)
    yield Claim(
        "N_p of the seven rows together: ours do not differ from the paper's on the whole",
        f"ours are lower in {low} of 7 rows, by {-shift:.1%} on average"
        + allowed * known,
        abs(shift) <= (error if known else 0.1) and 0 < low < 7,
    )
    for what, names in _MORE_PATCHES.items():
        chosen = np.array([counts[name] for name in names])
        share = (np.diff(chosen, axis=0) > 0).all(axis=0).mean()
        found = [(mean(counts[name]), name) for name in names]
        yield Claim(
            f"{what} gives more patches",
            _listed("{} ({})", found, " < ") + f"; so on {share:.0%} of the surfaces",
            bool((np.diff(chosen.mean(axis=1)) > 0).all()),
        )


def _saturation(studies: Studies) -> Iterable[Claim]:
    groups = studies["interaction"].by(STRENGTH)
    alone = groups[0.0].at(1e3)
    drop = groups.means(lambda group: group.at(1e3) / alone)
    early, late = drop[0.0].value - drop[0.5].value, drop[0.5].value - drop[1.0].value
    yield Claim(
        "ΔF falls with I_b and saturates from about 0.5 eV",
        "ΔF relative to I_b = 0 at 1e3 s: " + _listed("{:g} eV {}", drop.items()),
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
        points = studies[study]
        top, early, late = (
            _summits(points, lambda group, w=window: group.beta(w))
            for window in (FIT_WINDOW, (1.0, 1e3), (1e2, 1e4))
        )
        over = ""
        if study == "warm rough":
            members = studies["warm members"].by(MEMBER)
            tops = [_summits(group, PointSet.beta).value for group in members.values()]
            over = f"over the members of the density {min(tops):.0f} to {max(tops):.0f} K; "
        drops = [
            (time, _kelvin(_summits(points, lambda group, t=time: group.at(t))))
            for time in (1e2, 1e4)
        ]
        yield Claim(
            f"ageing is not monotonic in temperature and is largest near room temperature, {name}",
            f"β (10 to 1e4 s) is largest at {_kelvin(top)}, over 1 to 1e3 s at {_kelvin(early)} and over 100 to 1e4 s "
            f"at {_kelvin(late)}; {over}ΔF at " + _listed("{:g} s at {}", drops),
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
    rough = groups.means(PointSet.beta)
    tips = studies["tips"].beta()
    ratios = np.divide.outer(tips, [beta.value for beta in rough.values()])
    yield Claim(
        "β of single asperities is one to two orders of magnitude above that of rough contacts",
        f"{min(tips):.2g} to {max(tips):.2g} for tips, "
        + _listed("{1} (h' = {0:g})", rough.items())
        + f": a factor of {ratios.min():.2g} to {ratios.max():.2g}",
        bool(ratios.min() >= 10 and ratios.max() <= 100),
    )


# -- the density, and what is not tested ------------------------------------------------------------------------------


def _every_member(studies: Studies) -> Iterable[Claim]:
    members = studies["members"].by(MEMBER)
    trends = members.each(_has_trends)
    yield Claim(
        "the form of the barrier density does not matter qualitatively",
        f"with ΔV, Δμ rises with h' at 1 s and falls at 1e3 s, and without it falls at both, for "
        f"{sum(trends.values())} of {len(members)} densities, on one surface (h' = 0.05 and 0.2)",
        all(trends.values()),
        calibrated=True,
    )


def _has_trends(member: PointSet) -> bool:
    """Whether Δμ rises with the slope as it should, with ΔV and without, early and late."""
    groups, trends = member.by(VOLUME, SLOPE), []
    for volume in VOLUMES:
        smooth, rough = (groups[volume, slope] for slope in (SLOPES[0], SLOPES[-1]))
        rises = rough.coefficient > smooth.coefficient
        early, late = (rises[0, smooth.nearest_to(time)] for time in (1.0, 1e3))
        trends += [early == bool(volume), not late]
    return all(trends)


def _untested(_: Studies) -> Iterable[Claim]:
    for statement, reason in DATA["untested"].items():
        yield Claim(statement, reason, None)


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
