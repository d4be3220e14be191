"""What is wrong with an image, or not random in it: the artefacts of instruments, and structures that no random surface
has. Each detector is a function of a scan; all of them are in ``ARTEFACTS`` and ``STRUCTURES``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import fft as sfft

from chemage import Surface
from chemage.plugin import roughness, threads
from chemage_surfaces._maps import Floats
from chemage_surfaces.measures import MOST_SKEWNESS, Measures
from chemage_surfaces.steps import (
    filled,
    find_groups,
    find_scars,
    find_spikes,
    hann,
    trend,
)

Mask: TypeAlias = NDArray[np.bool_]

#: a height is repeated if it is this many times more frequent than others near it, and at least in so many pixels
REPEATED, LEAST_REPEATED = 10.0, 9
#: and differs from the heights beside it this many times more than neighbours do
STANDS_OFF = 4.0
#: a repeated height beyond all others by this share of their range is no height
BEYOND = 0.1
#: share of a line that is equal to the line before, or to the pixel before
ALIKE = 0.9
#: share of dead lines above which the image was enlarged
MOST_DEAD = 0.25
#: lines that detectors of whole images need along each side
FEWEST_LINES = 48
#: rms steps between lines over those between columns, of the medians over a line: scatter of isotropic images is below
OFFSET = 2.5
#: and of the rms slope, where they change it
OFFSET_SLOPE = 0.15
#: a step of one line over the robust standard deviation of such steps, of lines and of columns
JUMP = 10.0
#: share of the mean square height that a paraboloid has where it is bow or drift
BOWED = 0.9
#: density of a periodic wave over that of waves near it, periods that it has in the image, and the share of the mean
#: square height or slope from which it matters, and from which no random surface replaces it
PEAK, FEWEST_PERIODS, LEAST_PERIODIC, MOST_PERIODIC = 30.0, 4, 0.01, 0.1
#: waves near an axis, on which offsets of lines, bow and drift are; and those along it that are compared
CROSS, ALONG = 3, 16
#: most periodic waves that are named
MOST_WAVES = 64
#: share of saturated pixels from which the heights are not those of the surface
MOST_SATURATED = 0.01
#: terraces: rms difference of neighbours over their robust standard deviation, share of the heights that are on levels,
#: and depth of the histogram between two levels
STEEP, ON_LEVELS, VALLEY = 1.6, 0.75, 0.5
#: share of the mean square slope of steps from which they matter, and from which no random surface replaces them
LEAST_STEPS, MOST_STEPS = 0.05, 0.5

#: structures that a surface can have beside a random one
PERIODIC, TERRACES = "periodic structure", "terraces"

#: ``mended``: the pixels were replaced; ``noted``: nothing was changed; ``no fit``: the surface can be used as it is, but
#: no random surface replaces it; ``refused``: it makes no surface without a decision of the user
Consequence = Literal["mended", "noted", "no fit", "refused"]


@dataclass(frozen=True, eq=False)
class Finding:
    """An artefact or a structure in an image: what it is, where, and what follows from it."""

    kind: str
    #: what it is, how much of it there is, and the option that helps
    text: str
    consequence: Consequence = "noted"
    #: pixels, (nx, ny); None: the image as a whole
    where: Mask | None = field(default=None, repr=False)
    #: wave vectors, 1/nm, (n, 2)
    waves: Floats | None = field(default=None, repr=False)
    #: the level that each height is on, nm, (nx, ny)
    levels: Floats | None = field(default=None, repr=False)

    @property
    def count(self) -> int:
        """Pixels that are marked."""
        return 0 if self.where is None else int(self.where.sum())

    @property
    def first(self) -> tuple[int, ...]:
        """The first pixel that is marked."""
        return (
            () if self.where is None else tuple(np.argwhere(self.where)[0].tolist())
        )

    def line(self) -> str:
        """The finding as a line of a table."""
        return f"{self.kind:<19} {self.consequence}: {self.text}"


@dataclass(eq=False)
class Scan:
    """An image as detectors see it: heights (nx, ny) in nm, nan where they are missing, scan lines along x."""

    heights: Floats
    #: edges of a pixel along x and y, nm
    sides: tuple[float, float]
    periodic: bool = False
    #: distance of spikes, in robust standard deviations
    threshold: float = 15.0

    @cached_property
    def there(self) -> Mask:
        """Pixels that have a height."""
        return np.isfinite(self.heights)

    @cached_property
    def large(self) -> bool:
        """Whether there are enough lines, and heights that differ, for a statement on the whole image."""
        known = self.heights[self.there]
        return (
            min(self.heights.shape) >= FEWEST_LINES
            and known.size > 0.5 * self.heights.size
            and float(np.ptp(known)) > 1e-12 * float(np.abs(known).max())
        )

    @cached_property
    def level(self) -> Floats:
        """All heights less their least-squares plane; of an image that repeats, less their mean."""
        whole = filled(self.heights, self.periodic)
        return whole - trend(whole, 0 if self.periodic else 1)

    @cached_property
    def groups(self) -> tuple[Mask, Mask]:
        """Groups of pixels cut off from all around them: those beyond twice the range of the others, and the rest."""
        from scipy import ndimage

        whole = _nearest(self.heights, self.there)
        whole = whole - trend(whole, 1)
        groups = find_groups(whole, self.threshold) & self.there
        label, _ = labelled(groups)
        # between jumps of the level there are whole lines
        for i, box in enumerate(ndimage.find_objects(label), 1):
            sizes = zip(box, groups.shape, strict=True)
            if any(part.stop - part.start > ALIKE * size for part, size in sizes):
                groups[box] &= label[box] != i
        low, high = np.quantile(whole[self.there & ~groups], (0.001, 0.999))
        label, count = labelled(groups)
        levels = np.asarray(ndimage.median(whole, label, np.arange(1, count + 1)))
        far = np.abs(levels - 0.5 * (low + high)) > 1.5 * (high - low)
        beyond = np.concatenate([[False], far])[label]
        return beyond, groups & ~beyond

    def steps(self, axis: int) -> Floats:
        """Medians, over each line across ``axis``, of the difference to the next line, less their own median: nm per
        nm. Both axes have lines of one length, so that they can be compared."""
        count = min(self.heights.shape)
        lines = np.moveaxis(self.heights, axis, 1)[:count]
        with np.errstate(invalid="ignore"):
            steps = np.diff(lines, axis=1)
        known = np.isfinite(steps).any(axis=0)
        steps[:, ~known] = 0.0
        medians = np.nanmedian(steps, axis=0) / self.sides[axis]
        return medians - np.median(medians)


Detector: TypeAlias = Callable[[Scan], Finding | None]


def examine(scan: Scan, detectors: Sequence[Detector]) -> list[Finding]:
    """What the detectors find."""
    return [
        found for detector in detectors if (found := detector(scan)) is not None
    ]


# -- pixels ------------------------------------------------------------------------------------------------------------


def gaps(scan: Scan) -> Finding | None:
    """Heights that are missing: in the file, or because a finding before took them out."""
    missing = ~scan.there
    if not missing.any():
        return None
    text = f"{missing.sum()} of {missing.size} heights are missing"
    return Finding("missing", text, where=missing)


def repeated_heights(scan: Scan) -> tuple[list[float], list[float]]:
    """Heights that many pixels share although few share those near them: those that stand for no height, and those at
    which the instrument was saturated."""
    heights, count = np.unique(scan.heights[scan.there], return_counts=True)
    if len(heights) < 4 * LEAST_REPEATED:
        return [], []
    window = min(10, len(heights) // 4)
    padded = np.pad(count.astype(np.float64), window, mode="reflect")
    near = np.median(
        np.lib.stride_tricks.sliding_window_view(padded, 2 * window + 1), axis=1
    )
    many = np.nonzero(count > np.maximum(REPEATED * near, LEAST_REPEATED - 1))[0]
    # a surface made of levels has many of them
    if len(many) > 3 or count[many].sum() > 0.5 * count.sum():
        return [], []
    rest = np.delete(heights, many)
    span = float(rest[-1] - rest[0])
    false, saturated = [], []
    for height in heights[many]:
        if rest[0] - BEYOND * span <= height <= rest[-1] + BEYOND * span and not (
            rest[0] < height < rest[-1]
        ):
            saturated.append(float(height))
        elif not rest[0] < height < rest[-1] or _stands_off(scan, float(height)):
            false.append(float(height))
    return false, saturated


def _stands_off(scan: Scan, height: float) -> bool:
    """Whether pixels of this height differ from those beside them by more than neighbours do."""
    marked = scan.heights == height
    off, typical = [], []
    for axis in (0, 1):
        steps = np.abs(np.diff(scan.heights, axis=axis))
        lines = np.moveaxis(marked, axis, 0)
        edge = np.moveaxis(lines[1:] != lines[:-1], 0, axis)
        off.append(steps[edge])
        typical.append(steps[~edge])
    edges, others = (np.concatenate(each) for each in (off, typical))
    return bool(np.nanmedian(edges) > STANDS_OFF * np.nanmedian(others[others > 0]))


def sentinels(scan: Scan) -> Finding | None:
    """Pixels with a number that stands for no height, such as 0 or −32768."""
    false, _ = repeated_heights(scan)
    where = np.isin(scan.heights, false)
    if not false or not where.any():
        return None
    values = " and ".join(f"{value:.6g} nm" for value in false)
    text = f"{where.sum()} pixels have the same height of {values}, which stands for none"
    return Finding("repeated heights", text, where=where)


def saturation(scan: Scan) -> Finding | None:
    """Pixels at the highest or the lowest height that the instrument could record."""
    _, saturated = repeated_heights(scan)
    where = np.isin(scan.heights, saturated)
    if not saturated or not where.any():
        return None
    share = float(where.mean())
    text = (
        f"{where.sum()} pixels ({share:.2g} of all) are at the end of the range of the heights, so that the surface goes "
        "on beyond; scan again with a larger range, or crop the image"
    )
    return Finding(
        "saturation", text, "no fit" if share > MOST_SATURATED else "noted", where
    )


def dead_lines(scan: Scan) -> Finding | None:
    """Lines of one height, and lines that repeat the line before."""
    heights = scan.heights
    where = np.zeros(heights.shape, dtype=bool)
    enlarged = False
    for axis in (0, 1):
        # each column of ``lines`` is a line
        lines, marked = np.moveaxis(heights, axis, 1), np.moveaxis(where, axis, 1)
        if min(lines.shape) < 8:
            continue
        steps = np.diff(lines, axis=1)
        same = np.zeros(lines.shape[1])
        same[1:] = (steps == 0).mean(axis=0)
        # the middle of a shape whose lines beyond are alike too is no fault
        twins = (lines[:, 3:] == lines[:, :-3]).mean(axis=0) > ALIKE
        same[2:-1][twins & (same[3:] < ALIKE)] = 0.0
        flat = (np.diff(lines, axis=0) == 0).mean(axis=0)
        dead = np.zeros(lines.shape[1], dtype=bool)
        for alike in (same, flat):
            if np.median(alike) < 0.5 * ALIKE:
                dead |= alike > ALIKE
            elif alike is same:
                enlarged = True
        if dead.mean() > MOST_DEAD:
            enlarged = True
        elif dead.any() and not _level_off(steps, dead):
            marked[:, dead] = True
    where &= scan.there
    if where.any():
        text = f"{where.sum()} pixels are in lines that have one height or repeat the line before"
        return Finding("dead lines", text, where=where)
    if enlarged and scan.large:
        text = "most lines repeat the line before: the image was enlarged; resample it to the pixels of the scan"
        return Finding("repeated lines", text)
    return None


def _level_off(steps: Floats, dead: Mask) -> bool:
    """Whether the steps next to the dead lines are small, too, as in the middle of a symmetric shape."""
    sizes = np.median(np.abs(np.nan_to_num(steps)), axis=0)
    alive = ~(dead[1:] | dead[:-1])
    if not alive.any():
        return True
    typical = float(np.median(sizes[alive]))
    places = np.nonzero(alive)[0]
    ends = [np.abs(places - line).argmin() for line in np.nonzero(dead)[0]]
    return float(np.median(sizes[places[ends]])) < 0.3 * typical


def spikes(scan: Scan) -> Finding | None:
    """Single pixels and groups of them far from all around them."""
    if not scan.there.any():
        return None
    where = (
        find_spikes(scan.heights, scan.threshold, scan.periodic) | scan.groups[0]
    )
    if not where.any():
        return None
    text = f"{where.sum()} of {where.size} pixels are spikes"
    return Finding("spikes", text, where=where)


def blocks(scan: Scan) -> Finding | None:
    """Groups of pixels that steep steps cut off, at heights that others have."""
    if not scan.large:
        return None
    where = scan.groups[1]
    share = _slope_share(scan, where)
    if share < LEAST_STEPS:
        return None
    text = (
        f"{where.sum()} pixels are cut off from those around them by steps, and have {share:.2g} of the mean square "
        "slope; if they are none of the surface, crop the image to a part without them"
    )
    return Finding(
        "blocks", text, "no fit" if share > MOST_STEPS else "noted", where
    )


def labelled(where: Mask) -> tuple[NDArray[np.intp], int]:
    """The number of the group of each marked pixel, groups joined at corners too; and how many there are."""
    from scipy import ndimage

    found: Any = ndimage.label(where, np.ones((3, 3)))
    return found


def scars(scan: Scan) -> Finding | None:
    """Stretches of a few scan lines off the lines on both sides, which are no ridges: the lines beyond go on level."""
    from scipy import ndimage

    if min(scan.heights.shape) < 2 * 8:
        return None
    where = find_scars(scan.heights)
    if not where.any():
        return None
    lines = np.pad(scan.heights, ((0, 0), (2, 2)), mode="edge")
    marked = np.pad(where, ((0, 0), (2, 2)))
    edge, sharp = np.zeros(where.shape), np.zeros(where.shape)
    count = where.shape[1]
    for one, two in ((1, 0), (3, 4)):
        here, beside, beyond = (lines[:, k : k + count] for k in (2, one, two))
        border = where & ~marked[:, one : one + count]
        edge += border
        sharp += border & (np.abs(here - beside) > 2 * np.abs(beside - beyond))
    label, found = labelled(where)
    number = np.arange(found + 1)
    share = ndimage.sum(sharp, label, number) / np.maximum(
        ndimage.sum(edge, label, number), 1
    )
    where = (share > 0.6)[label] & where
    if not where.any():
        return None
    text = (
        f"{where.sum()} pixels lie off the lines on both sides and have {_slope_share(scan, where):.2g} of the mean "
        'square slope; give scars = "interpolate" if they are none of the surface'
    )
    return Finding("scars", text, where=where)


def _nearest(heights: Floats, there: Mask) -> Floats:
    """Heights, with that of the nearest pixel where they are missing."""
    from scipy import ndimage

    if there.all():
        return heights
    nearest = ndimage.distance_transform_edt(
        ~there, return_distances=False, return_indices=True
    )
    return heights[tuple(nearest)]  # pyright: ignore[reportArgumentType]


def _slope_share(scan: Scan, where: Mask) -> float:
    """Share of the mean square slope of pairs of pixels one of which is marked."""
    part = total = 0.0
    for axis in (0, 1):
        steps = np.diff(scan.heights, axis=axis)
        square = (
            np.nan_to_num(steps - np.nanmedian(steps)) ** 2 / scan.sides[axis] ** 2
        )
        lines = np.moveaxis(where, axis, 0)
        either = np.moveaxis(lines[1:] | lines[:-1], 0, axis)
        total += float(square.sum())
        part += float(square[either].sum())
    return part / total if total else 0.0


# -- lines and trends --------------------------------------------------------------------------------------------------


def offsets(scan: Scan) -> Finding | None:
    """Offsets between scan lines, along the lines or, if they were read so, across them; and jumps of the level."""
    if not scan.large:
        return None
    along, across = (scan.steps(axis) for axis in (0, 1))
    # bow and drift change the steps slowly
    rms = [_robust(np.diff(steps)) / math.sqrt(2) for steps in (along, across)]
    if min(rms) <= 0:
        return None
    slopes = [
        float(np.nanstd(np.diff(scan.heights, axis=axis))) / scan.sides[axis]
        for axis in (0, 1)
    ]
    ratio = rms[1] / rms[0]
    if max(ratio, 1 / ratio) > OFFSET and max(rms) > OFFSET_SLOPE * max(slopes):
        along_x = ratio > 1
        x, y = "xy" if along_x else "yx"
        remedy = (
            'give lines = "differences"'
            if along_x
            else "scan lines should run along x: give --transpose, or turn the image"
        )
        text = (
            f"lines along {x} are offset: the rms slope along {y} is {slopes[along_x] / slopes[not along_x]:.3g} times "
            f"that along {x}; {remedy}, unless the surface was ground along {x}"
        )
        return Finding("line offsets", text)
    from scipy import ndimage

    across = across - ndimage.median_filter(across, 9, mode="nearest")
    least = max(JUMP * max(_robust(across), rms[0]), slopes[1])
    jumps = np.nonzero(np.abs(across) > least)[0]
    if not jumps.size:
        return None
    where = np.zeros(scan.heights.shape, dtype=bool)
    where[:, jumps + 1] = True
    text = (
        f"the level jumps at {len(jumps)} lines, the first at line {jumps[0] + 1}; give lines = "
        '"differences" unless the surface has steps there'
    )
    return Finding("level jumps", text, where=where)


def _robust(values: Floats) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def bow(scan: Scan) -> Finding | None:
    """A paraboloid over the whole image: bow of the scanner along x, drift along y."""
    if not scan.large or scan.periodic:
        return None
    curved = trend(scan.level, 2)
    share = float(np.mean(curved**2) / max(float(np.mean(scan.level**2)), 1e-300))
    if share < BOWED:
        return None
    x, y = (float(np.ptp(curved.mean(axis=axis))) for axis in (1, 0))
    name = "bow along x" if x > y else "bow or drift along y"
    text = (
        f'{name} of {max(x, y):.3g} nm has {share:.2g} of the mean square height; give detrend = "quadratic" if the '
        "surface is not curved"
    )
    return Finding("bow", text)


# -- structures --------------------------------------------------------------------------------------------------------


def periodic_structure(scan: Scan) -> Finding | None:
    """Waves whose density is far above that of all waves near them: gratings, lattices, interference."""
    if not scan.large:
        return None
    heights = scan.level
    if not scan.periodic:
        heights = hann(heights - trend(heights, 2))
    nx, ny = heights.shape
    spectrum: Any = sfft.rfft2(heights, workers=threads.available())
    power = spectrum.real**2 + spectrum.imag**2
    i, j = np.meshgrid(
        np.fft.fftfreq(nx, 1 / nx), np.arange(power.shape[1]), indexing="ij"
    )
    q = np.stack([i / (nx * scan.sides[0]), j / (ny * scan.sides[1])], axis=-1)
    q *= 2 * math.pi
    # what tilt, bow and offsets leave is none of the surface
    power[np.hypot(i, j) < FEWEST_PERIODS] = 0.0
    peaks = _peaks(power, np.hypot(q[..., 0], q[..., 1]))
    if not peaks:
        return None
    part = np.zeros(power.shape, dtype=bool)
    for a, b in peaks:
        part[_beside(a, b, 1, power.shape)] = True
    power *= roughness.multiplicity(ny)
    height, slope = (
        float((power * moment)[part].sum() / (power * moment).sum())
        for moment in (1.0, (q**2).sum(axis=-1))
    )
    share = max(height, slope)
    if share < LEAST_PERIODIC:
        return None
    rms = math.sqrt(float(power[part].sum())) / (nx * ny)
    waves = np.array([q[peak] for peak in peaks])
    strongest = waves[0]
    text = (
        f"{len(peaks)} periodic waves, the strongest of {2 * math.pi / float(np.hypot(*strongest)):.4g} nm at "
        f"{math.degrees(math.atan2(strongest[1], strongest[0])):.0f}° from x, of {rms:.3g} nm rms, with {height:.2g} of "
        f"the mean square height and {slope:.2g} of the mean square slope; a random surface does not repeat: take the "
        'image itself, as the surface "measured" or "roughened"'
    )
    refuse = share > MOST_PERIODIC
    return Finding(PERIODIC, text, "no fit" if refuse else "noted", waves=waves)


def _peaks(power: Floats, q: Floats) -> list[tuple[int, int]]:
    """Places of the waves whose density is far above the median at their wavenumber, and above that near them, those
    that add most to the slope first."""
    used = power > 0
    if not used.any():
        return []
    which = np.floor(8 * np.log(np.maximum(q, q[used].min()))).astype(np.int64)
    which -= which.min()
    bins = [power[(which == k) & used] for k in range(which.max() + 1)]
    ring = np.array([np.median(one) if one.size else math.inf for one in bins])
    # the median of an exponential distribution is ln 2 times its mean
    high = np.argwhere(power * math.log(2) > PEAK * ring[which])
    strength = power[tuple(high.T)] * q[tuple(high.T)] ** 2
    taken, peaks = np.zeros(power.shape, dtype=bool), []
    for a, b in high[np.argsort(-strength)][: 8 * MOST_WAVES].tolist():
        if not taken[a, b] and power[a, b] * math.log(2) > PEAK * _around(
            power, a, b
        ):
            peaks.append((a, b))
        taken[_beside(a, b, 2, power.shape)] = True
    return peaks[:MOST_WAVES]


def _beside(a: int, b: int, reach: int, shape: tuple[int, ...]) -> Any:
    """Indices of the waves up to ``reach`` beside one."""
    rows = np.arange(a - reach, a + reach + 1) % shape[0]
    return np.ix_(rows, np.arange(max(b - reach, 0), min(b + reach + 1, shape[1])))


def _around(power: Floats, a: int, b: int) -> float:
    """The density near a wave: of the waves around it, and along its axis where it is near one, which offsets of lines
    fill."""
    nx, half = power.shape
    rows, columns = np.arange(a - 7, a + 8), np.arange(b - 7, b + 8)
    away = np.maximum(np.abs(rows - a)[:, None], np.abs(columns - b))
    # a wave and its conjugate are one
    rows = np.where(columns < 0, -rows[:, None], rows[:, None]) % nx
    columns = np.broadcast_to(np.abs(columns), rows.shape)
    # a spectrum that ends leaves nothing beyond
    order = np.hypot(np.minimum(rows, nx - rows), columns)
    longer = order <= 1.02 * math.hypot(min(a, nx - a), b)
    near = [(rows, columns, (away >= 4) & longer)]
    along = np.arange(-ALONG, ALONG + 1)
    # what falls steeply along the axis is no peak
    for side in (along <= -4, along >= 4):
        if b <= CROSS:
            there = side & (min(a, nx - a) + along >= FEWEST_PERIODS)
            way = 1 if 2 * a <= nx else -1
            near.append(((a + way * along) % nx, np.full(along.shape, b), there))
        if min(a, nx - a) <= CROSS:
            there = side & (b + along >= FEWEST_PERIODS)
            near.append((np.full(along.shape, a), b + along, there))
    found = 0.0
    for i, j, usable in near:
        usable = usable & (j < half)
        values = power[i[usable], j[usable]]
        values = values[values > 0]
        if len(values) > FEWEST_PERIODS:
            found = max(found, float(np.median(values)))
    return found


def dilation(scan: Scan) -> Finding | None:
    """Valleys far sharper than peaks, from which the radius of the tip cannot be told."""
    if not scan.large:
        return None
    measures = Measures.of(scan.heights, scan.sides)
    skewness = min(
        float(axis.skewness[:3].min()) for axis in (measures.x, measures.y)
    )
    if not skewness > MOST_SKEWNESS or measures.tip_radius():
        return None
    text = (
        f"valleys are far sharper than peaks (skewness {skewness:.2g} of second differences), as a tip leaves them whose "
        "radius is not seen; the fit needs it as tip_radius"
    )
    return Finding("dilation", text)


def terraces(scan: Scan) -> Finding | None:
    """Levels of the heights with steep steps between them."""
    from scipy import ndimage
    from scipy.signal import find_peaks

    if not scan.large:
        return None
    heights = scan.level
    steep, flat = [], []
    for axis in (0, 1):
        step = np.diff(heights, axis=axis)
        middle = float(np.median(step))
        robust = 1.4826 * float(np.median(np.abs(step - middle)))
        steep.append(float(step.std()) / max(robust, 1e-300))
        flat.append(robust)
        # terraces are level, and their mean plane is not
        across = np.arange(heights.shape[axis]) * middle
        heights = heights - (across[:, None] if axis == 0 else across)
    if max(steep) < STEEP:
        return None
    low, high = np.quantile(heights, (0.002, 0.998))
    if not high > low:
        return None
    bins = 400
    count, edges = np.histogram(heights, bins, (float(low), float(high)))
    width = max(min(flat) / (edges[1] - edges[0]), 1.5)
    smooth = ndimage.gaussian_filter1d(
        count.astype(np.float64), min(width, bins / 20), mode="constant"
    )
    smooth = np.pad(smooth, 1)
    peaks, about = find_peaks(smooth, height=0.05 * smooth.max(), prominence=0)
    peaks = peaks[about["prominences"] > VALLEY * smooth[peaks]]
    if len(peaks) < 2:
        return None
    levels = edges[0] + (peaks - 0.5) * (edges[1] - edges[0])
    spacing = float(np.median(np.diff(levels)))
    away = np.abs(heights[..., None] - levels).min(axis=-1)
    on = float(np.mean(away < 0.25 * spacing))
    if on < ON_LEVELS:
        return None
    edge = np.zeros(heights.shape, dtype=bool)
    nearest = np.abs(heights[..., None] - levels).argmin(axis=-1)
    edge[1:] |= nearest[1:] != nearest[:-1]
    edge[:, 1:] |= nearest[:, 1:] != nearest[:, :-1]
    share = _slope_share(scan, edge)
    text = (
        f"{on:.2g} of the heights are on {len(levels)} levels, {spacing:.3g} nm apart, and the steps between them have "
        f"{share:.2g} of the mean square slope; a random surface has none: take the image itself, as the surface "
        '"measured" or "roughened"'
    )
    refuse = share > MOST_STEPS
    return Finding(
        TERRACES,
        text,
        "no fit" if refuse else "noted",
        edge,
        levels=levels[nearest],
    )


#: of instruments
ARTEFACTS: tuple[Detector, ...] = (
    sentinels,
    dead_lines,
    gaps,
    saturation,
    scars,
    spikes,
    blocks,
    offsets,
)
#: what a fit of a random surface leaves out or does not have
STRUCTURES: tuple[Detector, ...] = (bow, dilation, periodic_structure, terraces)


def examined(surface: Surface) -> list[Finding]:
    """What is found in a surface before it is fitted; artefacts of a measured one were found when it was made."""
    side = surface.pixel_size
    scan = Scan(surface.heights.astype(np.float64), (side, side), surface.periodic)
    known = surface.provenance.get("kind") == "measured"
    found = examine(scan, STRUCTURES if known else (*ARTEFACTS, *STRUCTURES))
    kinds = {one.kind for one in found}
    spoilt = surface.provenance.get("unfit", ())
    return [
        *(
            Finding(kind, text, "no fit")
            for kind, text in spoilt
            if kind not in kinds
        ),
        *found,
    ]
