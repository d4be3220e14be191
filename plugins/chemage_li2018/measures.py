"""What tests of claims compute, each with the claim and its rivals as they would be measured; see claims.toml."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from chemage.plugin import FIT_WINDOW, ClaimTest, Limits
from chemage_li2018 import shapes
from chemage_li2018.published import SLOPES, TABLE_1, window
from chemage_li2018.sweeps import VOLUMES, WITH_PRESSURE, Groups, PointSet, Studies


def _together(groups: Groups, value: Callable[[PointSet], np.ndarray]) -> np.ndarray:
    """The value of each group by surfaces, (n, groups)."""
    return np.transpose([value(group) for group in groups.values()])


# -- Fig. 2: load -----------------------------------------------------------------------------------------------------


def growth(studies: Studies) -> ClaimTest:
    """ΔF against log t, whose slope in every decade is near the mean; also true of log(1 + t/τ), the law of the field."""
    points = studies["loads"].by("load")[20000.0]
    inside = (points.times >= 0.999) & (points.times <= 1.001e5)
    times, curves = points.times[inside], points.drop[:, inside]
    slope, start = shapes.fit(np.log10(times), curves.mean(axis=0))
    rise = slope * np.log10(times[-1] / times[0])
    return ClaimTest(
        curves,
        lambda y: [np.abs(shapes.local_slopes(times, y) - 1).max()],
        lambda slopes: start + rise * shapes.grown(times, slopes),
    )


def small_loads(studies: Studies) -> ClaimTest:
    """ΔF against load, up to 50 µN."""
    groups = studies["loads"].by_load()
    few = Groups((load, group) for load, group in groups.items() if load <= 50)
    drop = _together(few, lambda group: group.at(1e3))
    return _law(np.broadcast_to(list(few), drop.shape), drop, shapes.power)


def _law(
    x: np.ndarray,
    y: np.ndarray,
    statistics: Callable[..., Sequence[float]],
    errors: np.ndarray | None = None,
) -> ClaimTest:
    """A test of y (x) of surfaces, (n, k) both, by the numbers of :func:`shapes.law`."""
    middle, height = x.mean(axis=0), y.mean()

    def truth(numbers: Sequence[float]) -> np.ndarray:
        law = shapes.law(middle, *numbers)
        return np.stack([middle, height * law / law.mean()])

    return ClaimTest(
        np.stack([x, y], axis=1),
        lambda found: statistics(*found),
        truth,
        None if errors is None else np.stack([0 * errors, errors]),
    )


def large_loads(studies: Studies) -> ClaimTest:
    """Δμ at 20 and at 500 µN."""
    groups = studies["loads"].by_load()
    coefficient = _together(groups, lambda group: group.coefficient_at(1e3))
    ends = [list(groups).index(load) for load in (20.0, 500.0)]
    return ClaimTest(
        coefficient[:, ends], lambda found: [found[1] / found[0]], np.array
    )


def areas(studies: Studies) -> ClaimTest:
    """ΔF against contact area."""
    groups = studies["loads"].by_load()
    area = _together(groups, lambda group: group.of("area_fraction"))
    drop = _together(groups, lambda group: group.at(1e3))
    return _law(area, drop, shapes.power)


def pressures(studies: Studies) -> ClaimTest:
    """Distributions of pressure, up to 100 µN."""
    groups = studies["loads"].by_load()
    small = [load for load in groups if load <= 100]
    density = np.stack([groups[load].observed("pressures") for load in small], axis=1)
    same = density[:, small.index(20.0)].mean(axis=0)
    bins = np.arange(same.size) + 0.5
    loads = np.array(small) / 20.0

    def stretched(factors: np.ndarray) -> np.ndarray:
        return np.array([np.interp(bins / one, bins, same) / one for one in factors])

    def statistics(found: np.ndarray) -> list[float]:
        total = found.cumsum(axis=1)
        shares = total / total[:, -1:]
        return [float(np.abs(shares - shares[small.index(20.0)]).max())]

    return ClaimTest(
        density, statistics, lambda numbers: stretched(loads ** numbers[0])
    )


# -- Fig. 3: roughness ------------------------------------------------------------------------------------------------


def _of_slopes(points: PointSet) -> np.ndarray:
    """Δμ of the least and the largest slope at 1 s and 1e3 s with ΔV, then without, (n, 2, 2, 2)."""
    groups = points.by("activation_volume", "rms_slope")
    values = [
        [groups[volume, slope].coefficient_at(time) for time in (1.0, 1e3)]
        for volume, slope in product(VOLUMES, (SLOPES[0], SLOPES[-1]))
    ]
    return np.moveaxis(np.reshape(values, (2, 2, 2, -1)), -1, 0)


def trends(studies: Studies) -> ClaimTest:
    """Δμ against slope, early and late, with ΔV and without."""
    return _with_trends(_of_slopes(studies["rows"].by_row()[TABLE_1[0]]))


def every_member(studies: Studies) -> ClaimTest:
    """The same for every member of the density, on one surface."""
    groups = studies["members"].by("member").values()
    # one surface, whose noise hardly differs between members
    values = np.stack([_of_slopes(group) for group in groups], axis=1)
    return _with_trends(values, np.zeros(values.shape[1:]))


def _with_trends(values: np.ndarray, errors: np.ndarray | None = None) -> ClaimTest:
    """Whether Δμ (n, ..., volumes, slopes, times) rises with the slope, falls, falls and falls."""
    smooth = values.mean(axis=0)[..., 0, :]

    def statistics(found: np.ndarray) -> list[float]:
        ratios = (found[..., 1, :] / found[..., 0, :]).reshape(-1, 4)
        return [ratios[:, 0].min(), *ratios[:, 1:].max(axis=0)]

    def truth(ratios: Sequence[float]) -> np.ndarray:
        return np.stack([smooth, smooth * np.reshape(ratios, (2, 2))], axis=-2)

    return ClaimTest(values, statistics, truth, errors)


def crossings(lower: PointSet, upper: PointSet) -> np.ndarray:
    """Hold time at which Δμ of each of ``lower`` first exceeds that of ``upper``, s, (n,); nan if it never does."""
    gap = upper.coefficient - lower.coefficient
    never = (gap <= 0).all(axis=1) | (gap[:, -1] > 0)
    return np.where(never, np.nan, shapes.last_positive(lower.times, gap))


def onsets(points: PointSet) -> np.ndarray:
    """Hold time at which the local slope dΔμ/dlog10 t first reaches half of the fitted slope, s, (n,).

    The fit is over the hold times of :data:`~chemage_li2018.published.PREFERRED`.
    """
    slope = np.gradient(points.coefficient, np.log10(points.times), axis=1)
    fitted = points.beta(window(points[0].varied("activation_volume")))
    return shapes.first_reaching(points.times, slope, 0.5 * fitted)


def reversal(studies: Studies) -> ClaimTest:
    """When Δμ of the least slope passes that of the largest."""
    rows = studies["rows"].by_volume()[6.4].by_row()

    def of_row(group: PointSet) -> np.ndarray:
        by_slope = group.by("rms_slope")
        return crossings(by_slope[SLOPES[0]], by_slope[SLOPES[-1]])

    values = _together(rows, of_row)
    return ClaimTest(
        values,
        lambda found: [found.min(), found.max()],
        lambda times: np.repeat(times, (1, values.shape[1] - 1)),
    )


def beginnings(studies: Studies) -> ClaimTest:
    """When the logarithmic regime begins at h' = 0.1, with ΔV and without."""
    volumes = studies["rows"].by_volume()
    circles = (volumes[volume].by_row()[TABLE_1[0]] for volume in (6.4, 0.0))
    chosen = [points.by("rms_slope")[0.1] for points in circles]
    values = np.transpose([onsets(points) for points in chosen])
    return ClaimTest(values, list, np.array)


def _of_rows(points: PointSet, time: float) -> np.ndarray:
    """A/A0 and Δμ at a hold time (s) of the rows of Table 1 at every slope, (n, 2, slopes × rows)."""
    groups = points.by("rms_slope", "hurst", "zeta", "eta")
    values = [
        [group.of("area_fraction"), group.coefficient_at(time)]
        for slope in SLOPES
        for row in TABLE_1
        for group in [groups[slope, *row.options.values()]]
    ]
    return np.moveaxis(np.array(values), -1, 0).swapaxes(1, 2)


def line_in_area(studies: Studies) -> ClaimTest:
    """Δμ against A/A0 with ΔV, at 1e3 s."""
    values = _of_rows(studies["rows"].by_volume()[6.4], 1e3)
    return _law(values[:, 0], values[:, 1], shapes.line)


def proportional_to_area(studies: Studies) -> ClaimTest:
    """Δμ against A/A0 without ΔV, at 1 s and at 1e3 s."""
    points = studies["rows"].by_volume()[0.0]
    rows = [_of_rows(points, time) for time in (1.0, 1e3)]
    every = [_law(one[:, 0], one[:, 1], shapes.power) for one in rows]
    return ClaimTest(
        np.stack([one.values for one in every], axis=1),
        lambda found: [*shapes.power(*found[0]), *shapes.power(*found[1])],
        lambda numbers: np.stack([one.truth(numbers) for one in every]),
    )


def rows_on_one_curve(studies: Studies) -> ClaimTest:
    """Δμ against A/A0 of all rows and slopes, about parabolas in the logarithms."""
    volumes = studies["rows"].by_volume()
    conditions = product((6.4, 0.0), (1.0, 1e3))
    each = [_of_rows(volumes[volume], time) for volume, time in conditions]
    values = np.stack(each, axis=1)

    def curve(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        fit = np.polynomial.Polynomial.fit(np.log(x), np.log(y), 2)
        return np.exp(fit(np.log(x)))

    middle = values.mean(axis=0)
    smooth = np.stack([[x, curve(x, y)] for x, y in middle])
    rows = np.tile(np.linspace(-1, 1, len(TABLE_1)), len(SLOPES))
    patches = np.tile([float(row.patches) for row in TABLE_1], len(SLOPES))
    edges = np.tile([float(row.perimeter_to_area) for row in TABLE_1], len(SLOPES))

    def truth(numbers: Sequence[float]) -> np.ndarray:
        alternating, of_patches, of_edges, one_row = numbers
        effect = 1 + alternating * np.cos(7 * rows) + one_row * (rows == 0)
        effect *= (patches / 160) ** of_patches * (edges / 0.44) ** of_edges
        return np.stack([smooth[:, 0], smooth[:, 1] * effect], axis=1)

    return ClaimTest(
        values, lambda found: [shapes.rms(y, curve(x, y)) for x, y in found], truth
    )


# -- Fig. 4 to 6, Table 1 ---------------------------------------------------------------------------------------------


def centres(edges: np.ndarray) -> np.ndarray:
    """The middles between ``edges`` (k + 1,)."""
    return 0.5 * (edges[1:] + edges[:-1])


def moments(points: PointSet, density: str, edges: str) -> np.ndarray:
    """Mean and standard deviation of an observed density of every point, (2, n)."""
    weights, middle = points.observed(density), centres(points[0].observables[edges])
    weights = weights / weights.sum(axis=-1, keepdims=True)
    mean = weights @ middle
    return np.stack([mean, np.sqrt((weights * (middle - mean[:, None]) ** 2).sum(-1))])


def distributions(studies: Studies) -> ClaimTest:
    """Mean and width of pressures and of barriers against slope."""
    groups = studies["slopes"].by_volume()[6.4].by("rms_slope")
    each = [
        [
            *moments(group, "pressures", "pressure_edges"),
            *moments(group, "barriers_start", "barrier_edges"),
        ]
        for group in groups.values()
    ]

    def statistics(found: np.ndarray) -> list[float]:
        pressure, spread, barrier, width = (found[1:] / found[:-1]).T
        return [pressure.min(), spread.min(), barrier.max(), width.min()]

    values = np.moveaxis(np.array(each), -1, 0)
    first = values.mean(axis=0)[0]
    return ClaimTest(
        values,
        statistics,
        lambda ratios: first * np.array(ratios) ** np.arange(3)[:, None],
    )


def morphology(points: PointSet) -> tuple[np.ndarray, np.ndarray]:
    """C/A (1/nm) and Δμ·A0/A at 1e3 s of every point."""
    per_area = points.coefficient_at(1e3) / points.of("area_fraction")
    return points.of("perimeter_to_area"), per_area


def against_morphology(studies: Studies, at: float) -> ClaimTest:
    """Δμ·A0/A of the rows against C/A at one slope, without ΔV."""
    rows = studies["rows"].by_volume()[0.0].by("rms_slope")[at].by_row()
    x, y = (_together(rows, lambda group, k=k: morphology(group)[k]) for k in (0, 1))

    def statistics(x: np.ndarray, y: np.ndarray) -> list[float]:
        slope, height = shapes.fit(x, y)
        straight = slope * x.std() / (y.std() or np.inf)
        return [straight, slope * np.ptp(x) / (height + slope * x.mean())]

    middle = x.mean(axis=0)
    slope, height = shapes.fit(middle, y.mean(axis=0))
    height += slope * middle.mean()
    u = (middle - middle.min()) / np.ptp(middle)

    def truth(numbers: Sequence[float]) -> np.ndarray:
        shape = np.interp(u, np.linspace(0, 1, len(numbers)), numbers)
        rise = abs(slope) * np.ptp(middle) * (shape - shape.mean())
        return np.stack([middle, height + rise])

    values = np.stack([x, y], axis=1)
    test = ClaimTest(values, lambda found: statistics(*found), truth)
    least = np.nan
    if test.decidable:
        # a line with this noise has a lower correlation in one of fifty draws
        least = float(np.quantile(test.drawn(truth((0, 1)))[:, 0], 0.02))
    limits = (
        Limits("correlation of the means of the rows", low=least),
        Limits("rise", low=0.0, high=0.2, percent=True),
    )
    return replace(test, limits=limits)


def patches(studies: Studies, at: Sequence[str]) -> ClaimTest:
    """N_p of three rows."""
    groups = {row.name: group for row, group in studies["table"].by_row().items()}
    return ClaimTest(
        np.transpose([groups[name].of("patches") for name in at]),
        lambda found: [(found[1:] / found[:-1]).min()],
        np.array,
    )


def saturation(studies: Studies) -> ClaimTest:
    """ΔF against I_b."""
    groups = studies["interaction"].by("strength")
    strengths = np.array(list(groups))
    start, half, last = (int(np.argmin(abs(strengths - x))) for x in (0.0, 0.5, 1.0))

    def statistics(y: np.ndarray) -> list[float]:
        fall = y[start] - y[half]
        late = (y[half] - y[last]) / fall if fall else np.inf
        return [y[half] / y[start], late]

    return ClaimTest(
        _together(groups, lambda group: group.at(1e3)),
        statistics,
        lambda numbers: np.interp(strengths, np.linspace(0, 1, len(numbers)), numbers),
    )


# -- temperature and tips ---------------------------------------------------------------------------------------------


def summit(
    kelvin: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray
) -> float:
    """Temperature of the largest of ``values``, from the parabola through it and its neighbours, or an end."""
    top = int(np.argmax(values))
    if top in (0, len(values) - 1):
        return float(kelvin[top])
    a, b, _ = np.polyfit(kelvin[top - 1 : top + 2], values[top - 1 : top + 2], 2)
    return float(-b / (2 * a))


def warmth(studies: Studies, at: str) -> ClaimTest:
    """The temperature of the largest β."""
    groups = studies[at].by("temperature")
    kelvin = np.array(list(groups))
    windows = {"β over 1 to 1e3 s": (1.0, 1e3), "β over 100 to 1e4 s": (1e2, 1e4)}

    def beta(window: tuple[float, float]) -> np.ndarray:
        return _together(groups, lambda group: group.beta(window)).clip(0)

    errors = None
    if at == "warm tip":
        half = _together(groups, lambda group: group.of("beta_half_width"))[0]
        # hot contacts lose bonds, and have no β
        errors = half / 2 / beta(FIT_WINDOW)[0].clip(0.1 * beta(FIT_WINDOW).max())
    return ClaimTest(
        beta(FIT_WINDOW),
        lambda found: [summit(kelvin, found)],
        lambda numbers: np.exp(-(((kelvin - numbers[0]) / 80) ** 2)),
        errors,
        {name: beta(window) for name, window in windows.items()},
    )


def tip_line(studies: Studies, at: float) -> ClaimTest:
    """ΔF of a tip against load, over replicas."""
    group = studies["tips"].by("radius")[at]
    drop = group.at(1e3)
    # half a 95 % interval is two standard errors
    errors = group.half_width_at(1e3) / 2 / drop
    return _law(group.swept("load")[None], drop[None], shapes.line, errors)


def orders_of_magnitude(studies: Studies) -> ClaimTest:
    """β of tips over β of rough contacts, at the loads of the paper's tips."""
    slopes = studies["slopes"].by_volume()[6.4].by("rms_slope")
    rough = _together(slopes, lambda group: group.beta(window(WITH_PRESSURE)))
    chosen = np.isin(studies["tips"].swept("load"), [23.0, 393.0])
    tips = studies["tips"].beta()[chosen]
    ratios = tips[:, None] / rough[:, None]
    return ClaimTest(
        ratios,
        lambda found: [float(np.exp(np.log(found).mean()))],
        lambda numbers: np.resize(numbers, ratios.shape[1:]),
    )


def area_against_slope(studies: Studies) -> ClaimTest:
    """Contact area against 1/h'."""
    groups = studies["slopes"].by_volume()[6.4].by("rms_slope")
    area = _together(groups, lambda group: group.of("area_fraction"))
    return _law(np.broadcast_to(1 / np.array(SLOPES), area.shape), area, shapes.power)
