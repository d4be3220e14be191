"""Measurements of ageing, and the fit of β and the cut-off time to them or to a simulated result.

Two models are fitted, and every answer says which:

``"line"``
    Δμ = β log10(t / t_c) over a window of hold times, the definition of β in the literature.
``"curve"``
    Δμ = β log10(1 + t / t_c), which is 0 at t = 0 and becomes the line for t ≫ t_c; any hold times, 0 included.

Intervals come from the bootstrap with a fixed seed: the same data give the same digits.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from chemage.errors import InputError, StoreError, UnitError
from chemage.objects import Aging
from chemage.text import with_interval
from chemage.units import convert

Quantity = Literal["friction_coefficient_drop", "friction_drop"]
Model = Literal["line", "curve"]
Bootstrap = Literal["residuals", "pairs", "replicas"]

#: quantity -> its unit inside chemage
UNIT: dict[str, str] = {"friction_coefficient_drop": "", "friction_drop": "nN"}
#: quantity -> how it is written
SYMBOL: dict[str, str] = {"friction_coefficient_drop": "Δμ", "friction_drop": "ΔF"}
_COLUMNS = ("hold_time", *UNIT, "error")
_EXAMPLE = "hold_time (s), friction_coefficient_drop, error"


# -- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measurements:
    """A measured curve of ageing: one value a row, rows in order of hold time."""

    name: str
    #: (m,) s, ≥ 0, non-decreasing; a time that occurs again is a repeated measurement
    hold_times: np.ndarray
    #: (m,) Δμ, or ΔF in nN
    values: np.ndarray
    #: what ``values`` are
    quantity: Quantity
    #: (m,) standard errors in the unit of ``values``, or None
    error: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("hold_times", "values", "error"):
            if (given := getattr(self, name)) is not None:
                array = np.array(given, dtype=np.float64)
                array.setflags(write=False)
                object.__setattr__(self, name, array)
        if self.quantity not in UNIT:
            raise InputError.of("quantity", self.quantity, f"choose {' or '.join(UNIT)}")
        _check_data(self.hold_times, self.values, self.error)

    def as_quantity(self, quantity: Quantity, load: float | None) -> Measurements | None:
        """The same measurements as ΔF or Δμ under ``load`` nN; None where that cannot be told."""
        if quantity == self.quantity:
            return self
        if not load:
            return None
        factor = load if quantity == "friction_drop" else 1 / load
        error = None if self.error is None else self.error * factor
        return Measurements(self.name, self.hold_times, self.values * factor, quantity, error)


def read_measurements(path: str | Path) -> Measurements:
    """Read a CSV file of hold times and Δμ or ΔF.

    The first line that is neither empty nor a comment (``#``) names the columns, with their units in brackets::

        # silica on silica, 50 % humidity
        hold_time (s), friction_coefficient_drop, error
        1,   0.12, 0.02
        10,  0.31, 0.02

    Columns may come in any order: ``hold_time`` with a unit of time; ``friction_coefficient_drop`` (no unit, or %) or
    ``friction_drop`` with a unit of force; and, if known, ``error``, the standard error of the value, in the value's
    unit unless it names its own. Commas, semicolons or tabs separate columns; numbers have a decimal point. Rows are in
    order of hold time.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        Naming the line and column that is wrong.
    """
    source = Path(path)
    try:
        text = source.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{source} cannot be read as a table of measurements: {reason}") from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip(" \t,;") and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{source}: there is nothing in it; the first line names the columns, such as {_EXAMPLE}")
    (number, header), *rest = lines
    separator = next((mark for mark in (";", "\t") if mark in header), ",")
    columns, quantity = _header(_cells(header, separator), f"{source}, line {number}")
    rows = [_row(_cells(line, separator), columns, f"{source}, line {number}") for number, line in rest]
    _check_order([number for number, _ in rest], [row["hold_time"] for row in rows], source)
    if len(rows) < 2:
        raise InputError(f"{source}: {len(rows)} rows of numbers; a course in time needs at least two")
    error = np.array([row["error"] for row in rows]) if "error" in columns else None
    return Measurements(
        source.stem,
        np.array([row["hold_time"] for row in rows]),
        np.array([row[quantity] for row in rows]),
        quantity,
        error,
    )


@dataclass(frozen=True)
class _Column:
    place: int
    unit: str
    factor: float


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _header(cells: list[str], where: str) -> tuple[dict[str, _Column], Quantity]:
    found: dict[str, tuple[int, str | None]] = {}
    for place, cell in enumerate(cells):
        match = re.fullmatch(r"(?P<name>[^(\[]*?)\s*(?:[(\[]\s*(?P<unit>.*?)\s*[)\]])?", cell)
        name = match["name"].strip().lower().replace(" ", "_") if match else cell
        if match is None or name not in _COLUMNS:
            from chemage.spec import nearest

            known = "hold_time, friction_coefficient_drop or friction_drop, and error"
            raise InputError(
                f"{where}: column {place + 1} is {cell!r}{nearest(name, _COLUMNS)}; the columns are {known}, "
                f"named on the first line, such as {_EXAMPLE}"
            )
        if name in found:
            raise InputError(f"{where}: the column {name} is there twice; keep one")
        found[name] = place, match["unit"]
    if "hold_time" not in found:
        raise InputError(f"{where}: no column hold_time; write the header as {_EXAMPLE}")
    given = [name for name in get_args(Quantity) if name in found]
    if len(given) != 1:
        raise InputError(
            f"{where}: {'both' if given else 'neither'} friction_coefficient_drop (Δμ) "
            f"{'and' if given else 'nor'} friction_drop (ΔF); give one of them"
        )
    quantity: Quantity = given[0]
    units = {"hold_time": "s", quantity: UNIT[quantity], "error": UNIT[quantity]}
    columns = {}
    for name in (name for name in ("hold_time", quantity, "error") if name in found):
        place, unit = found[name]
        if unit is None and name == "error":
            unit = columns[quantity].unit
        columns[name] = _Column(place, unit or "", _factor(name, unit, units[name], where))
    return columns, quantity


def _factor(name: str, unit: str | None, target: str, where: str) -> float:
    if unit in (None, "", "1"):
        if target:
            raise UnitError(f"{where}: the column {name} has no unit; write it as {name} ({target})")
        return 1.0
    try:
        return convert(f"1 {unit}", target)
    except UnitError as error:
        raise UnitError(f"{where}: the column {name} ({unit}): {error}") from None


def _row(cells: list[str], columns: dict[str, _Column], where: str) -> dict[str, float]:
    while len(cells) > len(columns) and not cells[-1]:
        cells = cells[:-1]
    if len(cells) != len(columns):
        more = "; write decimals with a point, and separate columns by semicolons or tabs" * (len(cells) > len(columns))
        raise InputError(f"{where}: {len(cells)} values under {len(columns)} columns{more}")
    row = {}
    for name, column in columns.items():
        cell = cells[column.place]
        try:
            value = float(cell)
        except ValueError:
            raise InputError(
                f"{where}, column {name}: {cell!r} is not a number" + "; write a decimal point" * ("," in cell)
            ) from None
        if not math.isfinite(value):
            raise InputError(f"{where}, column {name}: {cell!r} is not a finite number; leave that row out")
        if name == "hold_time" and value < 0:
            raise InputError(f"{where}, column hold_time: {cell} is negative; hold times count from first contact")
        if name == "error" and value <= 0:
            raise InputError(f"{where}, column error: {cell} is not above zero; leave the column out if unknown")
        row[name] = value * column.factor
    return row


def _check_order(lines: list[int], times: list[float], source: Path) -> None:
    for number, before, after in zip(lines[1:], times, times[1:], strict=False):
        if after < before:
            raise InputError(
                f"{source}, line {number}, column hold_time: {after:g} s comes after {before:g} s; "
                "sort the rows by hold time"
            )


def _check_data(times: np.ndarray, values: np.ndarray, error: np.ndarray | None) -> None:
    from chemage.spec import check_times

    check_times(times)
    for name, array in (("values", values), ("error", error)):
        if array is None:
            continue
        if array.shape != times.shape:
            raise InputError.of(name, array.shape, f"there are {times.size} hold times; give one number for each")
        if not np.isfinite(array).all():
            raise InputError(f"{name}: holds numbers that are not finite; leave those out")
    if error is not None and (error <= 0).any():
        raise InputError("error: holds numbers that are not above zero; leave it out if errors are not known")


# -- fitting ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Interval:
    """Ends of a confidence interval; an end that the data do not bound is infinite (for a time: 0 or infinite)."""

    low: float
    high: float


@dataclass(frozen=True)
class AgingFit:
    """β and cut-off time, with bootstrap intervals."""

    model: Model
    quantity: Quantity
    #: per decade: pure numbers for Δμ, nN for ΔF
    beta: float
    beta_interval: Interval
    #: s; nan where the data do not tell it
    cutoff_time: float
    cutoff_interval: Interval
    #: s; None: all hold times
    window: tuple[float, float] | None
    #: hold times (or rows) used
    points: int
    #: root mean square distance of the data from the fit, in the unit of the quantity
    rms_residual: float
    bootstrap: Bootstrap
    samples: int
    confidence: float

    def __call__(self, hold_times: np.ndarray | float) -> np.ndarray:
        """The fitted value at ``hold_times`` (s)."""
        return self.beta * _basis(self.model, np.asarray(hold_times, dtype=np.float64), math.log10(self.cutoff_time))

    def beta_text(self) -> str:
        """β with its interval and unit."""
        text = with_interval(self.beta, self.beta_interval.low, self.beta_interval.high)
        return f"{text} {UNIT[self.quantity]}".strip()

    def cutoff_text(self) -> str:
        """The cut-off time with its interval."""
        return f"{with_interval(self.cutoff_time, self.cutoff_interval.low, self.cutoff_interval.high)} s"

    def describe(self) -> str:
        """The model, in words."""
        symbol = SYMBOL[self.quantity]
        where = "all hold times" if self.window is None else f"{self.window[0]:g} s to {self.window[1]:g} s"
        shape = "log10(t/t_c)" if self.model == "line" else "log10(1 + t/t_c)"
        return f"{symbol} = β {shape}, {self.points} points, {where}"

    def todict(self) -> dict[str, object]:
        """Plain JSON values; what is not finite is None."""
        from chemage.runs import jsonable

        return jsonable(
            {
                "model": self.model,
                "formula": self.describe().partition(",")[0],
                "quantity": self.quantity,
                "unit": UNIT[self.quantity],
                "beta": self.beta,
                "beta_interval": [self.beta_interval.low, self.beta_interval.high],
                "cutoff_time": self.cutoff_time,
                "cutoff_time_interval": [self.cutoff_interval.low, self.cutoff_interval.high],
                "window": list(self.window) if self.window else None,
                "points": self.points,
                "rms_residual": self.rms_residual,
                "bootstrap": self.bootstrap,
                "samples": self.samples,
                "confidence": self.confidence,
            }
        )


def fit_aging(
    data: Measurements | Aging,
    *,
    model: Model = "line",
    window: tuple[float | str, float | str] | None = None,
    quantity: Quantity | None = None,
    bootstrap: Bootstrap | None = None,
    samples: int = 2000,
    confidence: float = 0.95,
    seed: int = 0,
) -> AgingFit:
    """Fit β and the cut-off time t_c to measurements or to a simulated result, with bootstrap intervals.

    Least squares; rows count by 1/error² where errors are given, equally otherwise.

    Parameters
    ----------
    data
        Measurements, or a simulated result, of which the mean over replicas is fitted.
    model
        ``"line"``: β log10(t/t_c); ``"curve"``: β log10(1 + t/t_c).
    window
        First and last hold time to use (s, or strings with units); None: 10 s to 1e4 s for the line of a simulated
        result, all hold times otherwise. The line never uses t = 0.
    quantity
        What to fit of a simulated result: Δμ (default) or ΔF. Measurements are fitted as they are.
    bootstrap
        What is drawn anew. ``"residuals"`` (default for measurements): distances from the fit, at the same hold times;
        ``"pairs"``: whole rows, where the scatter depends on time in a way the errors do not tell; ``"replicas"``
        (default for several replicas): whole replicas, so that errors correlated in time are kept. It knows nothing of
        the scatter between surfaces.
    samples, confidence, seed
        Bootstrap samples, coverage, and the seed they are drawn with. Percentile intervals, widened for small numbers
        as Student's t is (Hesterberg, Am. Stat. 69, 371 (2015), expanded percentile interval).

    Raises
    ------
    InputError
        Fewer than three different hold times in the window, or options that do not go together.
    """
    if model not in get_args(Model):
        raise InputError.of("model", model, f"choose {' or '.join(get_args(Model))}")
    if samples < 100:
        raise InputError.of("samples", samples, "is too few for an interval", "give 100 or more")
    if not 0 < confidence < 1:
        raise InputError.of("confidence", confidence, "must lie between 0 and 1", "give 0.95, say")
    simulated = isinstance(data, Aging)
    if simulated:
        quantity = quantity or "friction_coefficient_drop"
        curves = data.friction_drop if quantity == "friction_drop" else data.friction_coefficient_drop
        if quantity == "friction_coefficient_drop" and data.load == 0:
            raise InputError("load = 0: the friction coefficient is undefined; fit quantity='friction_drop'")
        times, error = data.hold_times, None
        window = window or (("10 s", "1e4 s") if model == "line" else None)
    else:
        if quantity not in (None, data.quantity):
            raise InputError.of("quantity", quantity, f"these are measurements of {data.quantity}")
        quantity = data.quantity
        times, curves, error = data.hold_times, data.values[None, :], data.error
    kind: Bootstrap = bootstrap or ("replicas" if curves.shape[0] > 1 else "residuals")
    if kind not in get_args(Bootstrap):
        raise InputError.of("bootstrap", kind, f"choose {', '.join(get_args(Bootstrap))}")
    if kind == "replicas" and curves.shape[0] < 2:
        raise InputError("bootstrap = 'replicas': there is a single curve; choose residuals or pairs")
    limits = None if window is None else (convert(window[0], "s"), convert(window[1], "s"))
    low, high = limits or (0.0, math.inf)
    use = (times >= low * (1 - 1e-9)) & (times <= high * (1 + 1e-9)) & ((times > 0) | (model == "curve"))
    if (count := np.unique(times[use]).size) < 3:
        raise InputError(
            f"{count} different hold times between {low:g} s and {high:g} s; "
            f"a fit of two numbers with errors needs three, widen the window"
        )
    t, y = times[use], curves[:, use]
    weight = np.ones(t.size) if error is None else 1 / error[use] ** 2
    weight = weight / weight.mean()
    mean = y.mean(axis=0)
    slopes, cutoffs = _solve(model, t, mean[None, :], weight[None, :])
    beta, log_cutoff = float(slopes[0]), float(cutoffs[0])
    if math.isnan(log_cutoff):
        fitted = np.full(t.size, float((weight * mean).sum() / weight.sum()))
    else:
        fitted = beta * _basis(model, t, float(np.clip(log_cutoff, *_bounds(t))))
    generator = np.random.default_rng(seed)
    heights, weights, freedom = _resampled(kind, generator, samples, y, fitted, weight)
    slopes, cutoffs = _solve(model, t, heights, weights)
    ends = _expanded(confidence, freedom)
    return AgingFit(
        model,
        quantity,
        beta,
        _interval(slopes, ends),
        _time(log_cutoff),
        _cutoff_interval(cutoffs, slopes, ends),
        limits,
        t.size,
        float(np.sqrt(np.mean((mean - fitted) ** 2))),
        kind,
        samples,
        confidence,
    )


def _time(log_time: float) -> float:
    """10**log_time, s; what is beyond the range of numbers is nan."""
    return float(10.0**log_time) if abs(log_time) < 300 else math.nan


def _basis(model: Model, t: np.ndarray, log_cutoff: np.ndarray | float) -> np.ndarray:
    """The model at β = 1; ``t`` and ``log_cutoff`` broadcast."""
    if model == "line":
        return np.log10(t) - log_cutoff
    # log10(1 + t/t_c) without overflow where t_c is far below t
    log_t = np.log(t, out=np.full(t.shape, -np.inf), where=t > 0)
    return np.logaddexp(0.0, log_t - np.multiply(log_cutoff, math.log(10))) / math.log(10)


def _solve(model: Model, t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares for each row of ``y`` (b, m) with weights ``w`` (b or 1, m): β and log10 t_c, (b,) each.

    log10 t_c is ±inf or nan where no finite cut-off time is best.
    """
    return _solve_line(t, y, w) if model == "line" else _solve_curve(t, y, w)


def _solve_line(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.log10(t)
    total = w.sum(axis=1)
    centre, height = (w * x).sum(axis=1) / total, (w * y).sum(axis=1) / total
    away = x - centre[:, None]
    spread = (w * away**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (w * away * y).sum(axis=1) / spread
        # a resample of one hold time, or a line that does not rise, crosses zero nowhere that means anything
        return slope, np.where(slope > 0, centre - height / slope, np.nan)


def _bounds(t: np.ndarray) -> tuple[float, float]:
    """Where log10 t_c is searched: beyond, the curve is a constant or a straight line in t, and t_c means nothing."""
    return math.log10(t[t > 0].min()) - 30.0, math.log10(t.max()) + 4.0


def _solve_curve(t: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For a given t_c the best β is a ratio of sums, so only log10 t_c is searched: a coarse grid, then ever finer."""
    lowest, highest = _bounds(t)
    grid = np.arange(lowest, highest + 0.05, 0.1)
    basis = _basis("curve", t, grid[:, None])
    w = np.broadcast_to(w, y.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = ((w * y) @ basis.T) ** 2 / (w @ (basis**2).T)
        # a resample of t = 0 alone says nothing: 0/0
        centre, step = grid[np.nan_to_num(gain, nan=-1.0).argmax(axis=1)], 0.1
        at_end = (centre <= grid[0]) | (centre >= grid[-1])
        offsets = np.linspace(-1.0, 1.0, 9)
        while step > 1e-7:
            tried = centre[:, None] + step * offsets
            shapes = _basis("curve", t, tried[:, :, None])
            products = np.einsum("bm,bkm->bk", w * y, shapes)
            gain = products**2 / np.einsum("bm,bkm->bk", w, shapes**2)
            best = np.nan_to_num(gain, nan=-1.0).argmax(axis=1)[:, None]
            centre = np.take_along_axis(tried, best, axis=1)[:, 0]
            step /= 4.0
        shapes = _basis("curve", t, centre[:, None])
        slope = (w * y * shapes).sum(axis=1) / (w * shapes**2).sum(axis=1)
    limit = np.where(centre > 0.5 * (lowest + highest), np.inf, -np.inf)
    return slope, np.where(slope > 0, np.where(at_end, limit, centre), np.nan)


def _resampled(
    kind: Bootstrap,
    generator: np.random.Generator,
    samples: int,
    curves: np.ndarray,
    fitted: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Bootstrap data: values (b, m), weights (b or 1, m), and the degrees of freedom behind them."""
    replicas, points = curves.shape
    if kind == "replicas":
        # deviations are stretched, since a draw from r replicas has (r − 1)/r of the variance
        drawn = generator.multinomial(replicas, np.full(replicas, 1 / replicas), samples) / replicas
        mean = curves.mean(axis=0)
        return mean + (drawn @ curves - mean) * math.sqrt(replicas / (replicas - 1)), weight[None, :], replicas - 1
    mean = curves.mean(axis=0)
    if kind == "pairs":
        times_drawn = generator.multinomial(points, np.full(points, 1 / points), samples)
        return np.broadcast_to(mean, (samples, points)), times_drawn * weight, points - 2
    scaled = (mean - fitted) * np.sqrt(weight)
    scaled = (scaled - scaled.mean()) * math.sqrt(points / (points - 2))
    drawn = generator.integers(0, points, (samples, points))
    return fitted + scaled[drawn] / np.sqrt(weight), weight[None, :], points - 2


def _expanded(confidence: float, freedom: int) -> tuple[float, float]:
    """Percentiles (in per cent) whose normal distance is Student's t for ``freedom``: a small sample's wider tails."""
    from scipy import stats

    tail = float(stats.norm.cdf(stats.t.ppf((1 - confidence) / 2, max(freedom, 1))))
    return 100 * tail, 100 * (1 - tail)


def _interval(values: np.ndarray, ends: tuple[float, float]) -> Interval:
    # order statistics, not interpolated: infinite values must not turn into nan
    finite = np.sort(values[~np.isnan(values)])
    if not finite.size:
        return Interval(math.nan, math.nan)
    low, high = (np.percentile(finite, end, method="nearest") for end in ends)
    return Interval(float(low), float(high))


def _cutoff_interval(log_times: np.ndarray, slopes: np.ndarray, ends: tuple[float, float]) -> Interval:
    """Where more samples than a tail holds do not rise at all, the data set no bounds: 0 to infinity."""
    if np.count_nonzero(~(slopes > 0)) > ends[0] / 100 * slopes.size:
        return Interval(0.0, math.inf)
    logs = _interval(log_times, ends)
    with np.errstate(over="ignore"):
        return Interval(float(np.power(10.0, logs.low)), float(np.power(10.0, logs.high)))
