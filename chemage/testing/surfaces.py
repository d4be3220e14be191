"""Checks of what makes a surface, and of a reader of files."""

from __future__ import annotations

import math
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.files import create, read_bytes, write_file
from chemage.foundation.records import Record
from chemage.surfaces.reading import HeightMap, Reader
from chemage.surfaces.role import Scatter, SurfaceMaker
from chemage.surfaces.surface import Surface
from chemage.testing.answers import as_bytes, independent_calls
from chemage.testing.checks import (
    Checks,
    Questions,
    is_number,
    known,
    refuses,
    require,
    require_estimates,
    require_plain,
    seeds_are_harmless,
    whole,
)

check_surface_maker = whole(SurfaceMaker)


def _seam(heights: np.ndarray, axis: int) -> tuple[float, float]:
    """How the edge compares with the inside: mean square second difference at the edge over the largest inside; and a
    measure that is about 1 if a correlated surface goes on across the edge, and infinite if that cannot be told."""
    rows = np.moveaxis(heights.astype(np.float64), axis, 0)
    second = np.mean(
        (np.roll(rows, -1, 0) - 2 * rows + np.roll(rows, 1, 0)) ** 2, axis=1
    )
    inside = float(second[1:-1].max())
    edge = float(max(second[0], second[-1]))
    smallest = 1e-20 * float(np.mean(rows**2)) + 1e-300
    kink = edge / max(inside, smallest) if edge > smallest else 0.0
    near = float(np.median(np.mean(np.diff(rows, axis=0) ** 2, axis=1)))
    far = float(
        np.median(
            np.mean(
                (rows[rows.shape[0] // 2 :] - rows[: -(rows.shape[0] // 2)]) ** 2,
                axis=1,
            )
        )
    )
    step = float(np.mean((rows[0] - rows[-1]) ** 2))
    # told apart only if neighbours are much more alike than distant rows, and the edge is not tapered to nothing
    if near == 0 or near > 0.2 * far or step < 0.05 * near or kink > 2:
        return kink, math.inf
    return kink, step / near


class SurfaceChecks(Checks[SurfaceMaker], of=SurfaceMaker):
    """What everything that makes a surface must do."""

    def _random(self) -> bool:
        return (
            self.component.make(0).heights.tobytes()
            != self.component.make(1).heights.tobytes()
        )

    def makes_a_surface(self) -> None:
        """``make()`` returns a Surface with finite heights and a record of how it was made, the same as ``make(0)``."""
        surface = self.component.make(0)
        require(
            isinstance(surface, Surface),
            f"make() returned {type(surface).__name__}; expected a chemage.Surface",
        )
        require(np.isfinite(surface.heights).all(), "heights are not finite")
        require_plain(surface.provenance, "provenance")
        require(
            surface.provenance,
            "provenance is empty; record how the surface was made, as self.todict() and the seed",
        )
        require(self.component.make() == surface, "make() and make(0) differ")
        require(
            self.component.make(seed=0) == surface,
            "make(0) and make(seed=0) differ",
        )

    def surface_follows_its_seed(self) -> None:
        """The same seed gives the same bytes, other seeds give others or none does, and wrong seeds are InputErrors."""
        seeds_are_harmless(
            lambda seed: self.component.make(seed).heights.tobytes(), "make"
        )
        if self._random():
            wrong: tuple[Any, ...] = (-1, 0.5)
            for seed in wrong:
                refuses(
                    f"make({seed})", lambda seed=seed: self.component.make(seed)
                )

    calls_are_independent = independent_calls

    def surface_has_its_options(self) -> None:
        """Options named ``pixels``, ``pixel_size`` (nm), ``rms_slope``, ``rms_height`` (nm) and ``periodic`` are
        properties of the surface, on grids that are not square too."""
        count = 16 if self._random() else 1
        for maker in self._grids():
            surface, pixels = maker.make(0), getattr(maker, "pixels", None)
            wanted = {
                name: getattr(maker, name, None)
                for name in ("pixel_size", "periodic")
            }
            wanted["shape"] = (
                (pixels, pixels) if isinstance(pixels, int) else pixels
            )
            for name, value in wanted.items():
                its = getattr(surface, name)
                if isinstance(value, float | bool | tuple):
                    require(
                        np.allclose(its, value, rtol=1e-9, atol=0.0),
                        f"{name} = {value}, but the surface has {its}",
                    )
            for name in ("rms_slope", "rms_height"):
                value = getattr(maker, name, None)
                if isinstance(value, float):
                    values = np.array(
                        [getattr(maker.make(seed), name) for seed in range(count)]
                    )
                    mean = float(np.sqrt(np.mean(values**2)))
                    require(
                        abs(mean - value)
                        <= 0.05 * value
                        + 10 * float(values.std()) / math.sqrt(count),
                        f"{name} = {value}, but surfaces of {surface.shape} pixels have {mean:.4g} (nm, or slopes of "
                        "the Fourier series where they are periodic)",
                    )

    def _grids(self) -> list[SurfaceMaker]:
        """The component, and on grids that are not square, as far as it accepts them."""
        pixels, makers = getattr(self.component, "pixels", None), [self.component]
        if pixels is None:
            return makers
        n = int(np.max(pixels))
        for shape in ((n, max(n * 5 // 8, 1)), (max(n * 5 // 8, 1), n)):
            try:
                makers.append(self.component.replace(pixels=shape))
            except InputError:
                continue
        return makers

    def lengths_scale_together(self) -> None:
        """With all lengths among its options doubled, the same surface is twice as large: pixels and nanometres, or two
        units of length, are not mixed up."""
        lengths = {
            name: getattr(self.component, name)
            for name, unit in self.units().items()
            if unit == "nm"
        }
        if lengths.get("pixel_size") is None:
            return
        try:
            larger = self.rescaled(length=2).make(0)
        except InputError:
            return
        surface = self.component.make(0)
        if None in lengths.values() and np.array_equal(
            larger.heights, surface.heights
        ):
            return  # their unit is not among the options, but stated by a file
        require(
            larger.shape == surface.shape
            and math.isclose(larger.pixel_size, 2 * surface.pixel_size),
            f"with all lengths doubled: {larger.shape} pixels of {larger.pixel_size} nm; "
            f"expected {surface.shape} of {2 * surface.pixel_size} nm",
        )
        away = float(np.abs(larger.heights / 2.0 - surface.heights).max())
        require(
            away <= 1e-5 * float(np.abs(surface.heights).max()),
            f"with all lengths ({', '.join(sorted(lengths))}) doubled, heights are not twice as large: the rms height "
            f"grows from {surface.rms_height:.4g} to {larger.rms_height:.4g} nm; is one of them taken in pixels, or in "
            "another unit?",
        )

    def recorded_radius_is_the_tips(self) -> None:
        """A ``radius`` (nm) in the provenance is that of the apex, which is the highest point, in the middle of the
        grid, on a surface that is not periodic: solvers for a sphere rely on it."""
        for maker in self._grids():
            surface = maker.make(0)
            radius = surface.provenance.get("radius")
            if not is_number(radius) or min(surface.shape) < 8:
                return
            x, y = (
                (np.arange(n) - (n - 1) / 2) * surface.pixel_size
                for n in surface.shape
            )
            squared = x[:, None] ** 2 + y**2
            near = squared <= (4 * surface.pixel_size) ** 2
            heights = surface.heights.astype(np.float64)
            paraboloid = -squared / (2 * radius)
            away = float(np.ptp((heights - paraboloid)[near]))
            allowed = 0.05 * float(np.ptp(paraboloid[near]))
            top = tuple(
                map(int, np.unravel_index(np.argmax(heights), surface.shape))
            )
            require(
                away <= allowed,
                f"provenance has radius = {radius} nm, but near the middle of {surface.shape} pixels the heights are "
                f"not those of a sphere with this radius and its apex up: they differ by {away:.3g} nm, {allowed:.3g} "
                f"nm are allowed, and the highest pixel is {top}",
            )
            require(
                not surface.periodic,
                "a single sphere (provenance has a radius) is not periodic; pass periodic=False",
            )

    def edges_fit_where_periodic(self) -> None:
        """A periodic surface goes on across its edges as it does inside; a random one that does at every seed is marked
        periodic."""
        random = self._random()
        surfaces = [self.component.make(seed) for seed in range(4 if random else 1)]
        if (
            min(surfaces[0].shape) < 8
            or getattr(self.component, "periodic", None) is not None
        ):
            return  # with an option of that name it is the user's statement
        seams = np.array(
            [
                [_seam(surface.heights, axis) for axis in (0, 1)]
                for surface in surfaces
            ]
        )
        for axis, worst in zip("xy", seams[:, :, 0].min(axis=0), strict=True):
            require(
                worst <= 9 or not surfaces[0].periodic,
                f"the surface says that it is periodic (the default), but along {axis} its curvature at the edge is "
                f"{math.sqrt(worst):.3g} times the largest inside; pass periodic=False, or make the edges fit",
            )
        require(
            surfaces[0].periodic or not random or (seams[:, :, 1] > 2).any(),
            "the surface says that it is not periodic, but at every seed it goes on smoothly across both edges; pass "
            "periodic=True",
        )

    def surface_is_as_expected(self) -> None:
        """The properties that ``expected()`` returns are those of the surface: lengths in nm, the slope as a ratio."""
        for maker in self._grids():
            surface, expected = maker.make(0), maker.expected()
            exact = {
                "nx": surface.shape[0],
                "ny": surface.shape[1],
                "pixel_size": surface.pixel_size,
            }
            names = (
                *exact,
                "rms_slope",
                "shortest_wavelength",
                "radius",
                "periodic",
                "sites",
                "cpu_seconds",
            )
            require_estimates("expected()", expected, *names)
            for name in exact.keys() & expected.keys():
                require(
                    expected[name] == exact[name],
                    f"expected() has {name} = {expected[name]}, not {exact[name]}",
                )
            slope = expected.get("rms_slope", surface.rms_slope)
            shortest = expected.get("shortest_wavelength", 0.0)
            require(
                math.isclose(slope, surface.rms_slope, rel_tol=0.3, abs_tol=1e-9),
                f"expected() has rms_slope = {slope}, the surface has {surface.rms_slope}",
            )
            if shortest > 0 and surface.periodic and surface.rms_height > 0:
                qx, qy = (
                    2 * np.pi * np.fft.fftfreq(n, surface.pixel_size)
                    for n in surface.shape
                )
                squared = qx[:, None] ** 2 + qy**2
                power = (
                    np.abs(np.fft.fft2(surface.heights - np.mean(surface.heights)))
                    ** 2
                    * squared
                )
                beyond = float(
                    power[np.sqrt(squared) > 1.25 * 2 * np.pi / shortest].sum()
                    / power.sum()
                )
                require(
                    beyond < 0.25,
                    f"expected() has shortest_wavelength = {shortest:.4g} nm, but {beyond:.0%} of the mean square "
                    "slope is in shorter waves",
                )

    def roughness_is_the_surfaces(self) -> None:
        """``roughness()`` has the nominal area of the surface, and about its rms slope and rms height if it gives
        one."""
        surface, roughness = self.component.make(3), self.component.roughness(3)
        for name, allowed in (
            ("nominal_area", 1e-9),
            ("rms_slope", 0.3),
            ("rms_height", 0.5),
        ):
            mine, its = getattr(roughness, name), getattr(surface, name)
            require(
                math.isnan(mine)
                or math.isclose(mine, its, rel_tol=allowed, abs_tol=1e-12),
                f"roughness() has {name} = {mine:.4g}, the surface has {its:.4g}",
            )

    def _require_same_surface(
        self, how: str, other: Any, most: float, factor: int = 0
    ) -> None:
        """Require that ``other`` makes a surface as large on fewer pixels, ``factor`` times as large where it is given,
        whose heights are those of the fine grid at its pixels, or their means, to ``most`` rms heights."""
        if other is None:
            return
        require(
            isinstance(other, SurfaceMaker),
            f"{how} returned {type(other).__name__}",
        )
        fine, made = self.component.make(3), other.make(3)
        ratio = made.pixel_size / fine.pixel_size
        require(
            made.heights.size < fine.heights.size
            and np.allclose(np.multiply(made.shape, ratio), fine.shape, rtol=1e-9)
            and (not factor or math.isclose(ratio, factor)),
            f"{how}: {made.shape} pixels of {made.pixel_size} nm for {fine.shape} of {fine.pixel_size} nm",
        )
        heights = fine.heights.astype(np.float64)
        rows, columns = (
            np.rint(np.arange(n) * ratio).astype(int).clip(max=m - 1)
            for n, m in zip(made.shape, fine.shape, strict=True)
        )
        candidates = [heights[np.ix_(rows, columns)]]
        if factor:
            candidates.append(
                heights.reshape(made.shape[0], factor, made.shape[1], factor).mean(
                    axis=(1, 3)
                )
            )
        away = min(
            float(np.std(made.heights - one)) / (float(np.std(one)) or math.inf)
            for one in candidates
        )
        require(
            away <= most,
            f"{how} makes another surface at the same seed: heights differ by {away:.2g} rms heights from those of the "
            "fine grid",
        )

    def coarser_is_the_same_surface(self) -> None:
        """``coarser(2)`` is None, or makes the same surface of the same size on pixels twice as large."""
        self._require_same_surface("coarser(2)", self.component.coarser(2), 0.5, 2)

    def sketch_is_the_same_surface(self) -> None:
        """``sketch()`` is None, or makes the same surface of the same size on fewer pixels."""
        self._require_same_surface("sketch()", self.component.sketch(), 0.7)

    def members_are_other_surfaces(self) -> None:
        """``members(count)`` returns at most ``count`` makers of surfaces as large as this one that differ from it, always
        the same ones, and that have no members themselves: a mean computes each of them."""
        component = self.component
        members, own = list(component.members(3)), component.make(2)
        require(len(members) <= 3, f"members(3) returned {len(members)} makers")
        require(not component.members(0), "members(0) returned a maker")
        require(
            members == list(component.members(3)),
            "members() returned other makers at the second call, so that a mean would not repeat",
        )
        for member in members:
            is_sound = isinstance(member, SurfaceMaker) and not member.members(3)
            require(is_sound, f"members() returned {member!r}, which is none")
            made = member.make(2)
            alike = (made.shape, made.pixel_size) == (own.shape, own.pixel_size)
            require(
                alike and not np.array_equal(made.heights, own.heights),
                f"{member!r} is a member that makes {made!r}; give other heights on the pixels of {own!r}",
            )

    def questions(self) -> Questions:
        for seed in (31, 32):
            yield (
                f"the surface of seed {seed}",
                lambda maker, seed=seed: _of_image(maker.make(seed)),
            )
        yield (
            "the roughness",
            lambda maker: attrgetter("rms_slope", "rms_height")(
                maker.roughness(31)
            ),
        )

    def trade_keeps_the_surface(self) -> None:
        """Every value of ``trade`` gives a surface of the same size and roughness."""
        for name, variants in self.trade_variants():
            made = {what: variant.make(2) for what, variant in variants}
            last = [*made.values()][-1]
            sides = np.multiply(last.shape, last.pixel_size)
            for what, other in made.items():
                require(
                    np.allclose(
                        np.multiply(other.shape, other.pixel_size), sides, rtol=0.01
                    )
                    and math.isclose(
                        other.rms_height,
                        last.rms_height,
                        rel_tol=0.3,
                        abs_tol=1e-12,
                    ),
                    f"trade of {name!r} is another surface and not one at another accuracy: {what} gives {other!r}, "
                    f"the last value {last!r}",
                )

    def scatter_agrees_with_the_seed(self) -> None:
        """``scatter()`` is None or a Scatter, 0 if and only if the seed does not change the surface; it takes the
        measures of any contact."""
        random = self._random()
        for contact in (
            {},
            {"patches": 0, "area_fraction": 0.0},
            {"patches": 30, "area_fraction": 0.02},
        ):
            scatter = self.component.scatter(contact)
            right = isinstance(scatter, Scatter | None)
            require(
                right,
                f"scatter({contact}) returned {scatter!r}; give a chemage.plugin.Scatter",
            )
            require(
                scatter is None or (scatter.relative == 0) != random,
                f"scatter({contact}) is {scatter}, but the seed {'changes' if random else 'does not change'} the "
                "surface",
            )


check_reader = whole(
    Reader,
    path="a file that the reader can read",
    surface="the Surface in this file: heights in nm, pixel size and whether it is periodic, known from elsewhere",
)


def _alike(one: np.ndarray, two: np.ndarray) -> bool:
    """Equal to a ten thousandth of the range, which a format of 16 bits keeps."""
    return one.shape == two.shape and bool(
        np.abs(one - two).max() <= 1e-4 * max(float(np.ptp(two)), 1e-300)
    )


def _difference(found: np.ndarray, wanted: np.ndarray) -> str:
    """What turns the heights that were read into the expected ones, if it is something simple."""
    turned = {
        "": found,
        "mirrored along x": found[::-1],
        "mirrored along y": found[:, ::-1],
        "turned by 180 degrees": found[::-1, ::-1],
        "transposed": found.T,
        "in another order of rows and columns": found.ravel().reshape(
            found.shape, order="F"
        ),
    }
    for how, heights in turned.items():
        if heights.shape != wanted.shape:
            continue
        one, two = heights - heights.mean(), wanted - wanted.mean()
        factor = float((one * two).sum() / max(float((two * two).sum()), 1e-300))
        if factor and _alike(one / factor, two):
            parts = [how] if how else []
            if math.isclose(factor, -1, rel_tol=1e-3):
                parts.append("upside down")
            elif not math.isclose(factor, 1, rel_tol=1e-3):
                parts.append(f"{factor:.4g} times as large")
            elif not parts:
                parts.append(
                    f"{float(heights.mean() - wanted.mean()):.4g} nm higher"
                )
            return ": they are " + " and ".join(parts)
    return f": they differ by up to {np.abs(found - wanted).max():.3g} nm"


def _of_image(read: Any) -> Any:
    """What counts of a surface, a height map or another object."""
    return [
        getattr(read, name, None)
        for name in ("heights", "pixel_size", "height_unit", "periodic")
    ] + [type(read)]


class ReaderChecks(Checks[Reader], of=Reader):
    """What every reader of files must do."""

    def suffixes_are_named(self, path: Any = None) -> None:
        """``suffixes`` names the file endings that the reader accepts, in lower case and with the dot."""
        suffixes = self.cls.suffixes
        require(
            isinstance(suffixes, tuple) and suffixes,
            f"suffixes = {suffixes!r}: name the file endings that it reads",
        )
        for ending in suffixes:
            fits = (
                isinstance(ending, str)
                and ending.startswith(".")
                and ending == ending.lower()
                and len(ending) > 1
            )
            require(
                fits, f"{suffixes}: {ending!r} must be in lower case, with the dot"
            )
        ending = Path(path or f"file{suffixes[0]}").suffix.lower()
        require(
            ending in suffixes,
            f"the file ends in {ending!r}, but suffixes = {suffixes}",
        )

    def bad_files_are_refused(self, path: Any = None) -> None:
        """A missing, empty or truncated file, or one of another format, raises a ChemageError that names the file."""
        with TemporaryDirectory() as name:
            contents = {
                "empty": b"",
                "foreign": b"\x89not this format at all\r\n\x1a\n\x00" * 20,
            }
            suffix = self.cls.suffixes[0]
            if path is not None:
                good, suffix = read_bytes(path), Path(path).suffix
                contents["truncated"] = good[: len(good) // 2]
            files = {
                what: Path(name) / f"{what}{suffix}"
                for what in ("missing", *contents)
            } | {"folder": Path(name)}
            for what, content in contents.items():
                create(files[what], content)
            for what, file in files.items():
                message = refuses(
                    f"a {what} file",
                    lambda file=file: self.component.read(file),
                    ChemageError,
                )
                require(
                    file.name in message,
                    f"a {what} file: the message does not name it: {message}",
                )

    def reads_its_file(self, path: Any) -> None:
        """The file is read into a Surface or another object of chemage, the same each time, and stays as it was."""
        before = read_bytes(path)
        first = self.component.read(path)
        require(read_bytes(path) == before, "reading changed the file")
        given = "None" if first is None else type(first).__name__
        require(
            isinstance(first, Record),
            f"read() returned {given}; expected a chemage.Surface or another object of it",
        )
        require(
            first == self.component.read(str(path)),
            "reading the file as Path and as str gave different objects",
        )
        require(
            first == self.component.read(Path(path)),
            "reading the file twice gave different objects",
        )

    calls_are_independent = independent_calls

    def file_is_in_nm(self, path: Any) -> None:
        """Heights and pixel size are in nm, as far as it can be told without the surface: slopes are neither below 1e-8
        nor above 100, and a pixel is between 1e-3 and 1e6 nm."""
        surface = self.component.read(path)
        if not isinstance(surface, Surface):
            return
        require(
            1e-3 <= surface.pixel_size <= 1e6,
            f"pixels of {surface.pixel_size:.3g} nm; is the pixel size in m or µm? Surface.pixel_size is in nm",
        )
        slope = surface.rms_slope
        require(
            slope == 0 or 1e-8 <= slope <= 100,
            f"an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms, pixels of "
            f"{surface.pixel_size:.3g} nm); are heights or pixel size in m? Both are in nm",
        )

    @known
    def known_surface_is_read(self, path: Any, surface: Surface) -> None:
        """The file that holds ``surface`` gives just that: heights in nm with x as the first index, pixel size in nm,
        periodicity."""
        read: Any = self.component.read(path)
        require(
            isinstance(read, Surface),
            f"read() returned {type(read).__name__}; expected a chemage.Surface",
        )
        turned = (
            ": x and y are swapped" if read.shape == surface.shape[::-1] else ""
        )
        require(
            read.shape == surface.shape,
            f"{read.shape} pixels (nx, ny), expected {surface.shape}{turned}",
        )
        heights = read.heights.astype(np.float64)
        wanted = surface.heights.astype(np.float64)
        require(
            _alike(heights, wanted),
            f"other heights than those in the file{_difference(heights, wanted)}",
        )
        size, right = read.pixel_size, surface.pixel_size
        require(
            math.isclose(size, right, rel_tol=1e-6),
            f"pixels of {size} nm, expected {right} nm",
        )
        require(
            read.periodic == surface.periodic,
            f"periodic is {read.periodic}, expected {surface.periodic} (the default of chemage.Surface is True)",
        )

    def stated_pixel_size_counts(self, path: Any) -> None:
        """An option ``pixel_size`` overrides the pixel size in the file."""
        stated = self.component.read(path)
        if "pixel_size" in self.cls.model_fields and isinstance(stated, Surface):
            size = 2.5 * stated.pixel_size
            other = self.component.replace(pixel_size=size).read(path).pixel_size
            require(
                math.isclose(other, size),
                f"pixel_size = {size} nm was given, but the surface has pixels of {other} nm",
            )

    def questions(self, path: Any = None, **_: Any) -> Questions:
        if path is not None:
            yield "the file", lambda reader: _of_image(reader.read(path))
            yield "its image", lambda reader: _of_image(reader.height_map(path))

    def place_of_the_file_does_not_matter(self, path: Any) -> None:
        """A copy of the file in another folder, with a blank in its name and its ending in capitals, gives the same;
        and a path gives what the file holds now."""
        with TemporaryDirectory() as name:
            copy = Path(name) / f"a copy{Path(path).suffix.upper()}"
            create(copy, read_bytes(path))
            for read in (self.component.read, self.component.height_map):
                same = as_bytes(_of_image(read(copy))) == as_bytes(
                    _of_image(read(path))
                )
                require(
                    same,
                    f"a copy of the file, {copy.name!r}, is read as something else",
                )
            write_file(copy, b"", force=True)
            refuses(
                "a file that was emptied after it was read",
                lambda: self.component.read(copy),
                ChemageError,
            )

    def height_map_is_the_surface(self, path: Any) -> None:
        """``height_map`` gives a HeightMap with the heights, the pixels and the periodicity of the surface that
        ``read`` gives, as far as the file states them; heights that are missing are nan. An option ``pixel_size``
        counts there too.
        """
        surface, image = self.component.read(path), self.component.height_map(path)
        require(
            isinstance(image, HeightMap),
            f"height_map() returned {type(image).__name__}; give a HeightMap",
        )
        require_plain(dict(image.notes), "the notes of the height map")
        if not isinstance(surface, Surface):
            return
        require(
            image.heights.shape == surface.shape,
            f"the image has {image.heights.shape} pixels, not {surface.shape}",
        )
        there, size = np.isfinite(image.heights), surface.pixel_size
        if image.height_unit is not None and there.any():
            read = surface.heights.astype(np.float64)[there]
            away = float(
                np.ptp(
                    image.heights.astype(np.float64)[there] * image.height_unit
                    - read
                )
            )
            require(
                away <= 1e-4 * max(float(np.ptp(read)), 1e-300),
                f"heights of the image times height_unit = {image.height_unit:g} nm differ from those of the surface "
                f"by up to {away:.3g} nm",
            )
        if image.pixel_size is not None:
            right = np.allclose(image.pixel_size, size, rtol=1e-6, atol=0.0)
            require(
                right,
                f"the pixels of the image are {image.pixel_size} nm, those of the surface {size} nm",
            )
            require(
                image.periodic == surface.periodic,
                f"the image has periodic = {image.periodic}, the surface has not",
            )
        if "pixel_size" in self.cls.model_fields:
            stated = (
                self.component.replace(pixel_size=2.5 * size)
                .height_map(path)
                .pixel_size
            )
            right = stated is None or np.allclose(stated, 2.5 * size, atol=0.0)
            require(
                right,
                f"pixel_size = {2.5 * size} nm was given, but the image has pixels of {stated} nm",
            )
