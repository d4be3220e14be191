"""Surfaces from files: a height map as it is (``from-file``), or an image with every step to a surface
(``measured``)."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import model_validator

from chemage import InputError, Surface
from chemage.plugin import (
    FileStamp,
    Length,
    Reader,
    Unit,
    file_hash,
    memory,
    reader_for,
)
from chemage_surfaces._maps import (
    SQUARE,
    Floats,
    HeightUnit,
    ImageMaker,
    PixelSides,
    in_nm,
    provenance,
    same_pixels,
    stated,
    surface_of,
)
from chemage_surfaces.findings import (
    Detector,
    Finding,
    Scan,
    blocks,
    dead_lines,
    gaps,
    offsets,
    saturation,
    scars,
    sentinels,
    spikes,
)
from chemage_surfaces.readers import Instrument
from chemage_surfaces.steps import (
    cropped,
    filled,
    find_scars,
    hann,
    line_offsets,
    resampled,
    trend,
)


class FromFile(ImageMaker):
    """Heights from a file; higher points are nearer to the counter-body.

    The ending of the file selects one of the installed readers, unless ``reader`` is given. A map is not periodic
    unless the file or ``periodic`` states that it is.
    """

    kind = "from-file"

    pixel_size: Length | None = None
    """edge of a pixel, nm; required if the file states none, and refused if it states another"""
    height_unit: HeightUnit | None = None
    """unit of the heights in the file, such as "um", or a factor that converts them to nm; None: as the file states,
    else nm"""
    detrend: Literal["none", "mean", "plane"] = "none"
    """trend to subtract: none, the mean height, or the least-squares plane"""
    periodic: bool | None = None
    """whether the map is periodic; None: as the file states, else not"""

    def from_file(self, reader: Reader, stamp: FileStamp) -> Surface:
        """See :meth:`ImageMaker.from_file`."""
        content = file_hash(self.path, stamp)
        image = reader.height_map(self.path)
        sides = image.pixel_size
        if self.pixel_size is not None:
            sides = (self.pixel_size, self.pixel_size)
            same_pixels(image, sides)
        unit = (
            self.height_unit
            or image.height_unit
            or getattr(reader, "default_unit", None)
        )
        surface = surface_of(replace(image, height_unit=unit, pixel_size=sides))
        heights = surface.heights
        if self.detrend != "none":
            with np.errstate(
                over="ignore", invalid="ignore"
            ):  # what is not finite is refused below
                centred = heights - heights.mean(dtype=np.float64)
                # on a full grid the two tilts and the mean are orthogonal, so that each is a separate projection
                for axis, count in enumerate(
                    heights.shape if self.detrend == "plane" else ()
                ):
                    x = np.arange(count) - 0.5 * (count - 1)
                    if count > 1:
                        tilt = (x @ centred.mean(axis=1 - axis)) / (x @ x)
                        centred -= (
                            (tilt * x)[:, None]
                            if axis == 0
                            else (tilt * x)[None, :]
                        )
                heights = centred.astype(heights.dtype, copy=False)
        return Surface(
            heights=heights,
            pixel_size=surface.pixel_size,
            periodic=surface.periodic if self.periodic is None else self.periodic,
            provenance={
                **provenance(self),
                "reader": reader.kind,
                "file_blake2b": content,
            },
        )


#: an image is a grid of at least this many pixels along each side
FEWEST = 4
#: of the heights
MOST_MISSING = 0.5
#: shares of the heights that are interpolated where nothing else is asked for
FEW_SPIKES, FEW_MISSING = 1e-3, 0.05
#: rms slopes outside are those of a wrong unit
SLOPES = (1e-8, 10.0)
#: kind of a finding -> the option that decides on it
_OPTIONS = {
    "repeated heights": "missing",
    "dead lines": "missing",
    **{name: name for name in ("missing", "spikes", "scars")},
}
_DEGREES = {"mean": 0, "plane": 1, "quadratic": 2}
_Coordinate = Annotated[Any, Unit("nm", ge=0)]


class Measured(ImageMaker):
    """A measured image and the steps that make a surface of it, in the order of the options: units, crop, lines, scars,
    spikes, missing heights, trend, pixels, window.

    A few spikes (up to 0.1 % of the pixels) and missing heights (up to 5 %, with lines and numbers that stand for none)
    are interpolated with a warning that counts them. No other step is taken that is not asked for: an image with more
    of them, with pixels that are not square, or with units that nobody states is refused with the option that helps;
    of other artefacts a warning says which option removes them. ``provenance["steps"]`` records what each step did.
    Scan lines run along x.
    """

    kind = "measured"

    height_unit: HeightUnit | None = None
    """unit of the heights in the file, such as "um", or a factor that converts them to nm; overrides the unit in the
    file, and is required if the file has none"""
    pixel_size: PixelSides | None = None
    """edge of a pixel, nm, or both edges [along x, along y]; required if the file states none, and refused if it states
    others"""
    crop: tuple[_Coordinate, _Coordinate, Length, Length] | None = None
    """part to use, [x, y, width, height] in nm from the first pixel, rounded to whole pixels; None: all"""
    lines: Literal["none", "differences", "constant", "linear", "quadratic"] = (
        "none"
    )
    """how to align scan lines: not, by the medians of the differences from line to line, or by subtracting a polynomial
    from each, without the points far from it"""
    scars: Literal["keep", "interpolate"] = "keep"
    """what to do with scars, that is stretches of up to three scan lines that lie off the lines on both sides"""
    spikes: Literal["few", "refuse", "keep", "interpolate"] = "few"
    """what to do with spikes, that is pixels far from the median around them: interpolate up to 0.1 % of the pixels and
    refuse more, refuse any, keep them, or interpolate all"""
    spike_threshold: Annotated[Any, Unit("", ge=3, le=1e6)] = 15.0
    """distance of a spike from the median of the 5 x 5 pixels around it, in robust standard deviations of such
    distances"""
    missing: Literal["few", "refuse", "interpolate"] = "few"
    """what to do with missing heights: solve Laplace's equation in the gaps of up to 5 % of the heights and refuse
    more, refuse any, or solve it in all"""
    detrend: Literal["none", "mean", "plane", "quadratic"] = "none"
    """trend to subtract: none, the mean height, or the least-squares plane or paraboloid"""
    resample: Length | None = None
    """edge of square pixels to average over or to interpolate to, nm; None: as they are, and they must be square"""
    window: Literal["none", "hann", "mirror"] = "none"
    """how to make the image periodic: not, by a Hann window over the heights about their mean (same rms height, flat
    edges), or by mirror images beyond two edges (twice the pixels along each side)"""
    periodic: bool | None = None
    """whether the image is one period; None: as the file states, else not; a window makes it periodic"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.window != "none" and self.periodic is not None:
            raise ValueError(
                f"window = {self.window!r}, periodic = {self.periodic}: a window makes an image periodic that is not; "
                "leave out one of them"
            )
        return self

    def from_file(self, reader: Reader, stamp: FileStamp) -> Surface | str:
        """See :meth:`ImageMaker.from_file`."""
        image = self._prepared(reader)
        if image.faults:
            return image.faults[0]
        for one in image.findings:
            if getattr(self, _OPTIONS.get(one.kind, "kind")) != "interpolate":
                warnings.warn(
                    f"{image.source}: {one.text}", UserWarning, stacklevel=2
                )
        image.heights.setflags(write=False)
        made = {
            "reader": reader.kind,
            "file_blake2b": file_hash(self.path, stamp),
            "steps": image.steps,
        }
        return image.surface(**provenance(self), **made, **image.unfit())

    def image(self) -> Image:
        """The image after all steps that it allows: also where heights are missing, spikes are left or pixels are not
        square, so that it makes no surface. Errors as of :meth:`make`, but for these."""
        return self._prepared(self.reader or reader_for(self.path))

    def of_channel(self, name: str | None) -> Self:
        """The same steps on another channel of the file.

        Raises
        ------
        InputError
            The reader takes no channel.
        """
        if name is None:
            return self
        reader: Any = self.reader or reader_for(self.path)
        option = getattr(reader, "channel_option", "")
        if not option:
            raise InputError(
                f"channel = {name!r}: the reader {reader.kind!r} knows no channels; leave it out"
            )
        return self.replace(reader=reader.replace(**{option: name}))

    def channels(self) -> list[str]:
        """Names of the channels of heights in the file, where the reader knows several."""
        reader = self.reader or reader_for(self.path)
        return reader.channels(self.path) if isinstance(reader, Instrument) else []

    def retrace(self) -> Surface | None:
        """The image of the other direction of the scan lines after the same steps; None where the file has none that
        makes a surface. Its difference is the noise."""
        find = getattr(self.reader or reader_for(self.path), "retrace", None)
        other = None if find is None else find(self.path)
        if other is None:
            return None
        image = self.replace(reader=other, spikes="interpolate").image()
        if image.faults:
            return None
        return image.surface(channel=image.steps[0].get("channel", ""))

    def _prepared(self, reader: Reader) -> Image:
        read = reader.height_map(self.path)
        if self.pixel_size is not None:
            same_pixels(read, self.pixel_size)
        unit, sides = stated(
            read,
            self.height_unit or read.height_unit,
            self.pixel_size or read.pixel_size,
        )
        memory.require(
            12 * 8.0 * read.heights.size,
            read.source,
            "crop the file in the program that wrote it",
        )
        periodic = read.periodic if self.periodic is None else self.periodic
        image = Image(
            in_nm(read.heights.astype(np.float64), unit),
            sides,
            periodic,
            read.source,
            [],
        )
        image.did(
            "read",
            reader=reader.kind,
            height_unit_nm=unit,
            pixel_size_nm=list(sides),
            **read.notes,
        )
        image.heights[~np.isfinite(image.heights)] = np.nan
        what = ""
        if self.crop is not None:
            what = f"crop = {list(self.crop)}: "
            try:
                image.heights, taken = cropped(image.heights, sides, self.crop)
            except ValueError as error:
                raise InputError(f"{what}{error}") from None
            image.periodic = periodic and image.heights.shape == read.heights.shape
            image.did("crop", first_pixel=taken[:2], pixels=taken[2:])
        nx, ny = image.heights.shape
        if min(nx, ny) < FEWEST:
            image.refuse(
                "pixels",
                f"{what}{nx} x {ny} pixels are no image; give an image of at least {FEWEST} x {FEWEST} pixels",
            )
            return image
        self._mend(image)
        if self.detrend != "none":
            if image.periodic and self.detrend != "mean":
                raise InputError(
                    f"detrend = {self.detrend!r}: {image.source} is periodic, and without this trend its edges would "
                    'not fit; give "mean" or "none", or periodic = false'
                )
            subtracted = trend(image.heights, _DEGREES[self.detrend])
            image.heights = image.heights - subtracted
            image.did(
                "detrend", trend=self.detrend, range_nm=float(np.ptp(subtracted))
            )
        self._square(image)
        if self.window != "none" and image.periodic:
            raise InputError(
                f"window = {self.window!r}: {image.source} is periodic already; leave it out"
            )
        if image.faults:
            return image
        if self.window != "none":
            if self.window == "hann":
                image.heights = hann(image.heights)
            else:  # mirror images beyond two edges: (2 nx, 2 ny), periodic without a step
                nx, ny = image.heights.shape
                image.heights = np.pad(
                    image.heights, ((0, nx), (0, ny)), mode="symmetric"
                )
            image.periodic = True
            image.did("window", window=self.window)
        surface = image.surface()
        slope = surface.rms_slope
        if slope and not SLOPES[0] <= slope <= SLOPES[1]:
            image.refuse(
                "units",
                f"an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms on pixels of "
                f"{image.sides[0]:.3g} nm) is not that of a surface; one of the units is wrong: give height_unit and "
                "pixel_size",
            )
        return image

    def _mend(self, image: Image) -> None:
        """Remove artefacts where this was asked for or they are few; note the others, or refuse the image."""
        for detector in (sentinels, dead_lines):
            found = self._find(image, detector)
            if found is None or found.where is None:
                image.note(found)
            else:
                image.remove(found)
        # before alignment makes equal heights differ
        image.note(self._find(image, saturation))
        missing = self._find(image, gaps)
        if self.lines == "none":
            image.note(self._find(image, offsets))
        else:
            self._align(image)
        if self.scars == "interpolate":
            where = find_scars(image.heights)
            if where.any():
                text = f"{where.sum()} pixels lie off the lines on both sides"
                image.remove(Finding("scars", text, where=where))
            image.did("scars", pixels=int(where.sum()))
        else:
            image.note(self._find(image, scars))
        left = missing is not None and self._is_left(image, missing, FEW_MISSING)
        if self.spikes != "keep":
            found = self._find(image, spikes)
            if found is not None and not self._is_left(image, found, FEW_SPIKES):
                image.take_out(found)
                image.did("spikes", replaced=found.count)
        if left:
            return
        if missing is not None:
            image.did("missing", interpolated=missing.count)
        try:
            image.heights = filled(image.heights, image.periodic)
        except ValueError as error:
            raise InputError(f"{image.source}: {error}") from None
        image.note(self._find(image, blocks))

    def _find(self, image: Image, detector: Detector) -> Finding | None:
        return detector(
            Scan(image.heights, image.sides, image.periodic, self.spike_threshold)
        )

    def _align(self, image: Image) -> None:
        """Align scan lines."""
        if image.periodic:
            raise InputError(
                f"lines = {self.lines!r}: {image.source} is periodic, and aligned lines would not fit at its "
                "edges; leave it out, or give periodic = false"
            )
        subtracted = line_offsets(
            image.heights,
            {"constant": 0, "linear": 1, "quadratic": 2}.get(self.lines),
        )
        image.heights = image.heights - subtracted
        image.did("lines", lines=self.lines, rms_nm=float(subtracted.std()))

    def _is_left(self, image: Image, found: Finding, few: float) -> bool:
        """Whether pixels that could be interpolated are not, as more than the share ``few`` of all is only by
        request; the decision is among the findings."""
        option, count = found.kind, image.heights.size
        action = getattr(self, option)
        gone = int(np.isnan(image.heights).sum())
        most = {"refuse": 0, "few": few * count}.get(action, math.inf)
        if option == "missing" and gone > MOST_MISSING * count:
            left = True
            remedy = ", which is too many to interpolate; crop the image to a part that was measured"
        else:
            left = found.count > most
            first = found.first
            remedy = f', the first at pixel {first}; give {option} = "interpolate"'
            remedy += (
                ' to replace them, or spikes = "keep" if they are part of the surface'
                if option == "spikes"
                else ", or crop the image"
            )
        if not left:
            remedy = ", and interpolated"
            if action == "few":
                remedy += f'; {option} = "interpolate" says that this is meant'
        elif option == "missing" and (part := image.measured_part()) is not None:
            remedy = (
                f", where the scan was stopped or has an edge; give crop = {part}"
            )
        image.note(
            replace(
                found,
                text=found.text + remedy,
                consequence="refused" if left else "mended",
            )
        )
        return left

    def _square(self, image: Image) -> None:
        """Make pixels square, or leave them with a fault."""
        dx, dy = image.sides
        side = self.resample
        if side is None:
            if abs(dx - dy) > SQUARE * dx:
                image.refuse(
                    "pixels",
                    f"pixels of {dx:.6g} x {dy:.6g} nm are not square; give resample = "
                    f'"{min(dx, dy):.6g} nm", or pixel_size if these lengths are wrong',
                )
            return
        if image.faults:
            return
        pixels = image.heights.shape[0] * dx * image.heights.shape[1] * dy / side**2
        memory.require(
            8 * 8.0 * pixels, f"resample = {side:g} nm", "give larger pixels"
        )
        try:
            image.heights = resampled(
                image.heights, image.sides, side, image.periodic
            )
        except ValueError as error:
            raise InputError(f"resample = {side:g} nm: {error}") from None
        image.sides = (side, side)
        image.did("resample", pixel_size_nm=side, pixels=list(image.heights.shape))


@dataclass(eq=False)
class Image:
    """An image on its way to a surface."""

    #: (nx, ny) nm, nan where they are missing
    heights: Floats
    #: edges of a pixel along x and y, nm
    sides: tuple[float, float]
    periodic: bool
    #: what to call it in messages
    source: str
    #: what was done, as plain JSON values
    steps: list[dict[str, Any]]
    #: artefacts, and why it is no surface yet
    findings: list[Finding] = field(default_factory=list)

    @property
    def faults(self) -> list[str]:
        """Why it is no surface yet, each with the option that helps."""
        return [
            f"{self.source}: {one.text}"
            for one in self.findings
            if one.consequence == "refused"
        ]

    def unfit(self) -> dict[str, Any]:
        """What a fit must know, for the provenance of the surface: kinds and texts of artefacts that spoil it."""
        spoilt = [
            [x.kind, x.text] for x in self.findings if x.consequence == "no fit"
        ]
        return {"unfit": spoilt} if spoilt else {}

    def note(self, found: Finding | None) -> None:
        """Add a finding, if there is one."""
        if found is not None:
            self.findings.append(found)

    def refuse(self, kind: str, text: str) -> None:
        """Say why it makes no surface."""
        self.findings.append(Finding(kind, text, "refused"))

    def take_out(self, found: Finding) -> None:
        """Take out the heights at the place of a finding."""
        if found.where is not None:
            self.heights = np.where(found.where, np.nan, self.heights)

    def remove(self, found: Finding) -> None:
        """Add a finding, and take out the heights at its place."""
        self.note(
            replace(found, text=found.text + ", removed", consequence="mended")
        )
        self.take_out(found)

    def measured_part(self) -> list[float] | None:
        """The part [x, y, width, height] (nm) outside of which whole lines or columns at the ends are missing, if it is
        nearly complete."""
        there = np.isfinite(self.heights)
        part, box = [], []
        for axis in (0, 1):
            # a line in which the scan was stopped
            share = there.mean(axis=1 - axis)
            known = np.nonzero((share >= 0.5 * share.max()) & (share > 0))[0]
            if not known.size:
                return None
            box.append(slice(known[0], known[-1] + 1))
            part.append((known[0], len(known)))
        if (
            there[tuple(box)].mean() < 1 - FEW_MISSING
            or there[tuple(box)].all() == there.all()
        ):
            return None
        first = next(
            (step["first_pixel"] for step in self.steps if step["step"] == "crop"),
            [0, 0],
        )
        starts = [
            (start + before) * side
            for (start, _), before, side in zip(
                part, first, self.sides, strict=True
            )
        ]
        return [
            float(f"{number:.9g}")
            for number in (
                *starts,
                *(n * side for (_, n), side in zip(part, self.sides, strict=True)),
            )
        ]

    def surface(self, **provenance: Any) -> Surface:
        """The surface, where there is no fault."""
        return Surface(
            heights=self.heights,
            pixel_size=self.sides[0],
            periodic=self.periodic,
            provenance=provenance,
        )

    def did(self, step: str, **numbers: Any) -> None:
        """Record a step."""
        self.steps.append({"step": step, **numbers})
