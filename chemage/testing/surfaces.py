"""Checks of what makes a surface, and of a reader of files."""

from __future__ import annotations

import math
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
from chemage.testing.answers import Questions, asks
from chemage.testing.checks import (
    check_of,
    options_of,
    refuses,
    require,
    require_estimates,
    require_plain,
    rescaled,
    seeds_are_harmless,
    trade_variants,
    whole,
)

check_surface_maker = whole(SurfaceMaker)


def _random(component: SurfaceMaker) -> bool:
    return component.make(0).heights.tobytes() != component.make(1).heights.tobytes()


@check_of(SurfaceMaker)
def _makes_a_surface(component: SurfaceMaker) -> None:
    """``make()`` returns a Surface with finite heights and a record of how it was made, the same as ``make(0)``."""
    surface = component.make(0)
    require(isinstance(surface, Surface), f"make() returned {type(surface).__name__}; expected a chemage.Surface")
    require(np.isfinite(surface.heights).all(), "heights are not finite")
    require_plain(surface.provenance, "provenance")
    require(
        surface.provenance, "provenance is empty; record how the surface was made, such as self.todict() and the seed"
    )
    require(component.make() == surface, "make() and make(0) differ")
    require(component.make(seed=0) == surface, "make(0) and make(seed=0) differ")


@check_of(SurfaceMaker)
def _surface_follows_its_seed(component: SurfaceMaker) -> None:
    """The same seed gives the same bytes, other seeds give others or none does, and wrong seeds are InputErrors."""
    seeds_are_harmless(lambda seed: component.make(seed).heights.tobytes(), "make")
    if _random(component):
        for seed in (-1, 0.5):
            refuses(f"make({seed})", lambda seed=seed: component.make(seed))  # pyright: ignore[reportArgumentType]


@check_of(SurfaceMaker)
def _surface_has_its_options(component: SurfaceMaker) -> None:
    """Options named ``pixels``, ``pixel_size`` (nm), ``rms_slope``, ``rms_height`` (nm) and ``periodic`` are properties
    of the surface, on grids that are not square too."""
    for maker in (component, *_other_grids(component)):
        surface = maker.make(0)
        pixels = getattr(maker, "pixels", None)
        if pixels is not None:
            shape = (pixels, pixels) if isinstance(pixels, int) else tuple(pixels)
            require(surface.shape == shape, f"pixels = {pixels}, but the surface has {surface.shape} (nx, ny) pixels")
        size = getattr(maker, "pixel_size", None)
        if isinstance(size, float):
            require(
                math.isclose(surface.pixel_size, size, rel_tol=1e-9),
                f"pixel_size = {size} nm, but the surface has pixels of {surface.pixel_size} nm",
            )
        if isinstance(getattr(maker, "periodic", None), bool):
            stated = maker.periodic  # pyright: ignore[reportAttributeAccessIssue]
            require(surface.periodic == stated, f"periodic = {stated}, but the surface says {surface.periodic}")
        for name in ("rms_slope", "rms_height"):
            wanted = getattr(maker, name, None)
            if isinstance(wanted, float):
                _require_roughness(maker, name, wanted)


def _other_grids(component: SurfaceMaker) -> list[SurfaceMaker]:
    """The component on grids that are not square, as far as it accepts them."""
    pixels = getattr(component, "pixels", None)
    if pixels is None:
        return []
    n = pixels if isinstance(pixels, int) else max(pixels)
    makers = []
    for shape in ((n, max(n * 5 // 8, 1)), (max(n * 5 // 8, 1), n)):
        try:
            makers.append(component.replace(pixels=shape))
        except InputError:
            continue
    return makers


def _require_roughness(maker: SurfaceMaker, name: str, wanted: float) -> None:
    count = 16 if _random(maker) else 1
    values = np.array([getattr(maker.make(seed), name) for seed in range(count)])
    mean = float(np.sqrt(np.mean(values**2)))
    scatter = float(values.std() / math.sqrt(count))
    unit = " nm" if name == "rms_height" else " (of the Fourier series where the surface is periodic)"
    require(
        abs(mean - wanted) <= 0.05 * wanted + 10 * scatter,
        f"{name} = {wanted}, but surfaces of {maker.make(0).shape} pixels have {mean:.4g}{unit}",
    )


@check_of(SurfaceMaker)
def _lengths_scale_together(component: SurfaceMaker) -> None:
    """With all lengths among its options doubled, the same surface is twice as large: pixels and nanometres, or two
    units of length, are not mixed up."""
    lengths = {name for name, (_, unit, _) in options_of(component).items() if unit == "nm"}
    if "pixel_size" not in lengths or getattr(component, "pixel_size", None) is None:
        return
    try:
        larger = rescaled(component, length=2).make(0)
    except InputError:
        return
    surface = component.make(0)
    left_open = any(getattr(component, name) is None for name in lengths)
    if left_open and np.array_equal(larger.heights, surface.heights):
        return  # their unit is not among the options, but stated by a file
    require(
        larger.shape == surface.shape and math.isclose(larger.pixel_size, 2 * surface.pixel_size),
        f"with all lengths doubled: {larger.shape} pixels of {larger.pixel_size} nm; "
        f"expected {surface.shape} of {2 * surface.pixel_size} nm",
    )
    scale = float(np.abs(surface.heights).max())
    away = float(np.abs(larger.heights / 2.0 - surface.heights).max())
    ratio = larger.rms_height / surface.rms_height if surface.rms_height > 0 else math.nan
    require(
        away <= 1e-5 * scale,
        f"with all lengths ({', '.join(sorted(lengths))}) doubled, heights are not twice as large: the rms height "
        f"grows {ratio:.4g} times; is one of them taken in pixels, or in another unit?",
    )


@check_of(SurfaceMaker)
def _recorded_radius_is_the_tips(component: SurfaceMaker) -> None:
    """A ``radius`` (nm) in the provenance is that of the apex, which is the highest point, in the middle of the grid,
    on a surface that is not periodic: solvers for a sphere rely on it."""
    for maker in (component, *_other_grids(component)):
        surface = maker.make(0)
        radius = surface.provenance.get("radius")
        if not isinstance(radius, int | float) or min(surface.shape) < 8:
            return
        middle = [(n - 1) / 2 for n in surface.shape]
        x, y = ((np.arange(n) - c) * surface.pixel_size for n, c in zip(surface.shape, middle, strict=True))
        near = np.hypot(x[:, None], y) <= 4 * surface.pixel_size
        heights = surface.heights.astype(np.float64)
        paraboloid = -(x[:, None] ** 2 + y**2) / (2 * radius)
        away = float(np.ptp((heights - paraboloid)[near]))
        top = tuple(map(int, np.unravel_index(np.argmax(heights), surface.shape)))
        require(
            away <= 0.05 * float(np.ptp(paraboloid[near])),
            f"provenance has radius = {radius} nm, but near the middle of {surface.shape} pixels the heights are not "
            f"those of a sphere with this radius and its apex up: they differ by {away:.3g} nm of "
            f"{np.ptp(paraboloid[near]):.3g} nm, and the highest pixel is {top}",
        )
        require(not surface.periodic, "a single sphere (provenance has a radius) is not periodic; pass periodic=False")


@check_of(SurfaceMaker)
def _edges_fit_where_periodic(component: SurfaceMaker) -> None:
    """A periodic surface goes on across its edges as it does inside; a random one that does at every seed is marked
    periodic."""
    random = _random(component)
    surfaces = [component.make(seed) for seed in range(4 if random else 1)]
    if min(surfaces[0].shape) < 8 or getattr(component, "periodic", None) is not None:
        return  # with an option of that name it is the user's statement
    seams = np.array([[_seam(surface.heights, axis) for axis in (0, 1)] for surface in surfaces])
    if surfaces[0].periodic:
        worst = seams[:, :, 0].min(axis=0)
        for axis in (0, 1):
            require(
                worst[axis] <= 9,
                f"the surface says that it is periodic (the default), but along {'xy'[axis]} its curvature at the edge "
                f"is {math.sqrt(worst[axis]):.3g} times the largest inside; pass periodic=False, or make the edges fit",
            )
    elif random:
        require(
            not (seams[:, :, 1] <= 2).all(),
            "the surface says that it is not periodic, but at every seed it goes on smoothly across both edges; "
            "pass periodic=True",
        )


def _seam(heights: np.ndarray, axis: int) -> tuple[float, float]:
    """How the edge compares with the inside: mean square second difference at the edge over the largest inside; and a
    measure that is about 1 if a correlated surface goes on across the edge, and infinite if that cannot be told."""
    rows = np.moveaxis(heights.astype(np.float64), axis, 0)
    second = np.mean((np.roll(rows, -1, 0) - 2 * rows + np.roll(rows, 1, 0)) ** 2, axis=1)
    inside = float(second[1:-1].max())
    edge = float(max(second[0], second[-1]))
    smallest = 1e-20 * float(np.mean(rows**2)) + 1e-300
    kink = edge / max(inside, smallest) if edge > smallest else 0.0
    near = float(np.median(np.mean(np.diff(rows, axis=0) ** 2, axis=1)))
    far = float(np.median(np.mean((rows[rows.shape[0] // 2 :] - rows[: -(rows.shape[0] // 2)]) ** 2, axis=1)))
    step = float(np.mean((rows[0] - rows[-1]) ** 2))
    # told apart only if neighbours are much more alike than distant rows, and the edge is not tapered to nothing
    if near == 0 or near > 0.2 * far or step < 0.05 * near or kink > 2:
        return kink, math.inf
    return kink, step / near


@check_of(SurfaceMaker)
def _surface_is_as_expected(component: SurfaceMaker) -> None:
    """The properties that ``expected()`` returns are those of the surface: lengths in nm, the slope as a ratio."""
    for maker in (component, *_other_grids(component)):
        _require_expected(maker)


def _require_expected(component: SurfaceMaker) -> None:
    surface, expected = component.make(0), component.expected()
    exact = {"nx": surface.shape[0], "ny": surface.shape[1], "pixel_size": surface.pixel_size}
    names = (*exact, "rms_slope", "shortest_wavelength", "radius", "periodic", "cpu_seconds")
    require_estimates("expected()", expected, dict.fromkeys(names, math.inf))
    for name in exact.keys() & expected.keys():
        require(expected[name] == exact[name], f"expected() has {name} = {expected[name]}, not {exact[name]}")
    if "rms_slope" in expected:
        slope = expected["rms_slope"]
        require(
            math.isclose(slope, surface.rms_slope, rel_tol=0.3, abs_tol=1e-9),
            f"expected() has rms_slope = {slope}, the surface has {surface.rms_slope}",
        )
    shortest = expected.get("shortest_wavelength", 0.0)
    if shortest > 0 and surface.periodic and surface.rms_height > 0:
        qx, qy = (2 * np.pi * np.fft.fftfreq(n, surface.pixel_size) for n in surface.shape)
        squared = qx[:, None] ** 2 + qy**2
        power = np.abs(np.fft.fft2(surface.heights - np.mean(surface.heights))) ** 2 * squared
        beyond = float(power[np.sqrt(squared) > 1.25 * 2 * np.pi / shortest].sum() / power.sum())
        require(
            beyond < 0.25,
            f"expected() has shortest_wavelength = {shortest:.4g} nm, but {beyond:.0%} of the mean square slope is in "
            "shorter waves",
        )


@check_of(SurfaceMaker)
def _roughness_is_the_surfaces(component: SurfaceMaker) -> None:
    """``roughness()`` has the nominal area of the surface, and about its rms slope and rms height if it gives one."""
    surface, roughness = component.make(3), component.roughness(3)
    for name, allowed in (("nominal_area", 1e-9), ("rms_slope", 0.3), ("rms_height", 0.5)):
        mine, its = getattr(roughness, name), getattr(surface, name)
        require(
            math.isnan(mine) or math.isclose(mine, its, rel_tol=allowed, abs_tol=1e-12),
            f"roughness() has {name} = {mine:.4g}, the surface has {its:.4g}",
        )


@check_of(SurfaceMaker)
def _coarser_is_the_same_surface(component: SurfaceMaker) -> None:
    """``coarser(2)`` is None, or makes the same surface of the same size on pixels twice as large."""
    if (coarse := component.coarser(2)) is not None:
        fine, made = _on_fewer_pixels("coarser(2)", component, coarse)
        doubled = tuple(2 * n for n in made.shape) == fine.shape
        require(doubled, f"coarser(2): {made.shape} pixels for {fine.shape}; expected half as many along each side")
        blocks = fine.heights.astype(np.float64).reshape(made.shape[0], 2, made.shape[1], 2)
        _same_shape("coarser(2)", made, [blocks.mean(axis=(1, 3)), blocks[:, 0, :, 0]], 0.5)


@check_of(SurfaceMaker)
def _sketch_is_the_same_surface(component: SurfaceMaker) -> None:
    """``sketch()`` is None, or makes the same surface of the same size on fewer pixels."""
    if (sketch := component.sketch()) is not None:
        fine, made = _on_fewer_pixels("sketch()", component, sketch)
        rows, columns = (
            np.rint(np.arange(n) * made.pixel_size / fine.pixel_size).astype(int).clip(max=m - 1)
            for n, m in zip(made.shape, fine.shape, strict=True)
        )
        _same_shape("sketch()", made, [fine.heights.astype(np.float64)[np.ix_(rows, columns)]], 0.7)


def _on_fewer_pixels(how: str, component: SurfaceMaker, other: Any) -> tuple[Surface, Surface]:
    """A surface of the component, and the same one of ``other``, which must be as large on fewer pixels."""
    require(isinstance(other, SurfaceMaker), f"{how} returned {type(other).__name__}")
    fine, made = component.make(3), other.make(3)
    sizes = [(n * made.pixel_size, m * fine.pixel_size) for n, m in zip(made.shape, fine.shape, strict=True)]
    require(
        made.heights.size < fine.heights.size and all(math.isclose(*pair) for pair in sizes),
        f"{how}: {made.shape} pixels of {made.pixel_size} nm for {fine.shape} of {fine.pixel_size} nm",
    )
    return fine, made


def _same_shape(how: str, made: Surface, candidates: list[np.ndarray], most: float) -> None:
    """Require that the heights differ from those of one of the candidates by at most ``most`` rms heights."""

    def apart(heights: np.ndarray) -> float:
        difference, level = made.heights - np.mean(made.heights), heights - np.mean(heights)
        size = float(np.linalg.norm(level))
        return float(np.linalg.norm(difference - level)) / size if size else 0.0

    away = min(map(apart, candidates))
    require(
        away <= most,
        f"{how} makes another surface at the same seed: heights differ by {away:.2g} rms heights from those of the "
        "fine grid",
    )


@asks(SurfaceMaker)
def _surfaces_asked(component: SurfaceMaker) -> Questions:
    def ask(seed: int) -> Any:
        def asked(maker: SurfaceMaker) -> Any:
            made = maker.make(seed)
            return made.heights, made.pixel_size, made.periodic

        return asked

    for seed in (31, 32):
        yield f"the surface of seed {seed}", ask(seed)
    yield "the roughness", lambda maker: [getattr(maker.roughness(31), name) for name in ("rms_slope", "rms_height")]


@check_of(SurfaceMaker)
def _trade_keeps_the_surface(component: SurfaceMaker) -> None:
    """Every value of ``trade`` gives a surface of the same size and roughness."""
    for name, variants in trade_variants(component):
        made = [(what, variant.make(2)) for what, variant in variants]
        last = made[-1][1]
        for what, other in made:
            sizes = [n * other.pixel_size / (m * last.pixel_size) for n, m in zip(other.shape, last.shape, strict=True)]
            require(
                all(math.isclose(size, 1, rel_tol=0.01) for size in sizes)
                and math.isclose(other.rms_height, last.rms_height, rel_tol=0.3, abs_tol=1e-12),
                f"trade of {name!r} is another surface and not one at another accuracy: {what} gives {other!r}, the "
                f"last value {last!r}",
            )


@check_of(SurfaceMaker)
def _scatter_agrees_with_the_seed(component: SurfaceMaker) -> None:
    """``scatter()`` is None or a Scatter, 0 if and only if the seed does not change the surface; it takes the measures
    of any contact."""
    random = _random(component)
    for contact in ({}, {"patches": 0, "area_fraction": 0.0}, {"patches": 30, "area_fraction": 0.02}):
        scatter = component.scatter(contact)
        if scatter is None:
            continue
        require(
            isinstance(scatter, Scatter),
            f"scatter({contact}) returned {type(scatter).__name__}, not a chemage.plugin.Scatter",
        )
        require(
            (scatter.relative == 0) != random,
            f"scatter({contact}).relative is {scatter.relative}, but the seed "
            f"{'changes' if random else 'does not change'} the surface",
        )


check_reader = whole(
    Reader,
    path="a file that the reader can read",
    surface="the Surface in this file: heights in nm, pixel size and whether it is periodic, known from elsewhere",
)


@check_of(Reader)
def _suffixes_are_named(component: Reader, path: Any = None) -> None:
    """``suffixes`` names the file endings that the reader accepts, in lower case and with the dot."""
    suffixes = type(component).suffixes
    require(isinstance(suffixes, tuple) and suffixes, f"suffixes = {suffixes!r}: name the file endings that it reads")
    require(
        all(isinstance(s, str) and s.startswith(".") and s == s.lower() and len(s) > 1 for s in suffixes),
        f"{suffixes}: lower case, with the dot",
    )
    if path is not None:
        ending = Path(path).suffix.lower()
        require(ending in suffixes, f"the file ends in {ending!r}, but suffixes = {suffixes}")


@check_of(Reader)
def _bad_files_are_refused(component: Reader, path: Any = None) -> None:
    """A missing, empty or truncated file, or one of another format, raises a ChemageError that names the file."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        suffix = type(component).suffixes[0]
        files = {"missing": folder / f"missing{suffix}", "folder": folder}
        contents = {"empty": b"", "foreign": b"\x89not this format at all\r\n\x1a\n\x00" * 20}
        if path is not None:
            good = read_bytes(path)
            contents["truncated"] = good[: len(good) // 2]
            suffix = Path(path).suffix
        for label, content in contents.items():
            files[label] = folder / f"{label}{suffix}"
            create(files[label], content)
        for label, file in files.items():
            message = refuses(f"a {label} file", lambda file=file: component.read(file), ChemageError)
            require(file.name in message, f"a {label} file: the message does not name it: {message}")


@check_of(Reader, needs=("path",))
def _reads_its_file(component: Reader, path: Any = None) -> None:
    """The file is read into a Surface or another object of chemage, the same each time, and stays as it was."""
    before = read_bytes(path)
    first = component.read(path)
    require(read_bytes(path) == before, "reading changed the file")
    require(
        isinstance(first, Record),
        f"read() returned {'None' if first is None else type(first).__name__}; expected a chemage.Surface (or another "
        "object of chemage)",
    )
    require(first == component.read(str(path)), "reading the file as Path and as str gave different objects")
    require(first == component.read(Path(path)), "reading the file twice gave different objects")


@check_of(Reader, needs=("path",))
def _file_is_in_nm(component: Reader, path: Any = None) -> None:
    """Heights and pixel size are in nm, as far as it can be told without the surface: slopes are neither below 1e-8 nor
    above 100, and a pixel is between 1e-3 and 1e6 nm."""
    surface = component.read(path)
    if not isinstance(surface, Surface):
        return
    require(
        1e-3 <= surface.pixel_size <= 1e6,
        f"pixels of {surface.pixel_size:.3g} nm; is the pixel size in m or µm? Surface.pixel_size is in nm",
    )
    slope = surface.rms_slope
    require(
        slope == 0 or 1e-8 <= slope <= 100,
        f"an rms slope of {slope:.3g} (heights of {surface.rms_height:.3g} nm rms, pixels of {surface.pixel_size:.3g} "
        "nm); are heights or pixel size in m? Both are in nm",
    )


@check_of(Reader, needs=("path", "surface"), known=True)
def _known_surface_is_read(component: Reader, path: Any = None, surface: Surface | None = None) -> None:
    """The file that holds ``surface`` gives just that: heights in nm with x as the first index, pixel size in nm,
    periodicity."""
    read = component.read(path)
    if not isinstance(read, Surface) or surface is None:
        raise AssertionError(f"read() returned {type(read).__name__}; expected a chemage.Surface")
    require(
        read.shape == surface.shape,
        f"{read.shape} pixels (nx, ny), expected {surface.shape}"
        + (": x and y are swapped" if read.shape == surface.shape[::-1] else ""),
    )
    heights, wanted = read.heights.astype(np.float64), surface.heights.astype(np.float64)
    require(_alike(heights, wanted), f"other heights than those in the file{_difference(heights, wanted)}")
    require(
        math.isclose(read.pixel_size, surface.pixel_size, rel_tol=1e-6),
        f"pixels of {read.pixel_size} nm, expected {surface.pixel_size} nm",
    )
    require(
        read.periodic == surface.periodic,
        f"periodic is {read.periodic}, expected {surface.periodic} (the default of chemage.Surface is True)",
    )


def _alike(one: np.ndarray, two: np.ndarray) -> bool:
    """Equal to a ten thousandth of the range, which a format of 16 bits keeps."""
    return one.shape == two.shape and bool(np.abs(one - two).max() <= 1e-4 * max(float(np.ptp(two)), 1e-300))


def _difference(found: np.ndarray, wanted: np.ndarray) -> str:
    """What turns the heights that were read into the expected ones, if it is something simple."""
    turned = {
        "": found,
        "mirrored along x": found[::-1],
        "mirrored along y": found[:, ::-1],
        "turned by 180 degrees": found[::-1, ::-1],
        "transposed": found.T,
        "in another order of rows and columns": found.ravel().reshape(found.shape, order="F"),
    }
    for how, heights in turned.items():
        if heights.shape != wanted.shape:
            continue
        one, two = heights - heights.mean(), wanted - wanted.mean()
        factor = float((one * two).sum() / max(float((two * two).sum()), 1e-300))
        if factor and _alike(one / factor, two):
            parts = [how] if how else []
            if not math.isclose(factor, 1, rel_tol=1e-3):
                parts.append(
                    "upside down" if math.isclose(factor, -1, rel_tol=1e-3) else f"{factor:.4g} times as large"
                )
            elif not parts:
                parts.append(f"{float(heights.mean() - wanted.mean()):.4g} nm higher")
            return ": they are " + " and ".join(parts)
    return f": they differ by up to {np.abs(found - wanted).max():.3g} nm"


@check_of(Reader, needs=("path",))
def _stated_pixel_size_counts(component: Reader, path: Any = None) -> None:
    """An option ``pixel_size`` overrides the pixel size in the file."""
    stated = component.read(path)
    if "pixel_size" in type(component).model_fields and isinstance(stated, Surface):
        other = component.replace(pixel_size=2.5 * stated.pixel_size).read(path)
        require(
            math.isclose(other.pixel_size, 2.5 * stated.pixel_size),
            f"pixel_size = {2.5 * stated.pixel_size} nm was given, but the surface has pixels of {other.pixel_size} nm",
        )


@asks(Reader)
def _readers_asked(component: Reader, path: Any = None, **_: Any) -> Questions:
    if path is not None:
        yield "the file", lambda reader: _of_image(reader.read(path))
        yield "its image", lambda reader: _of_image(reader.height_map(path))


def _of_image(read: Any) -> Any:
    """What counts of a surface, a height map or another object."""
    return [getattr(read, name, None) for name in ("heights", "pixel_size", "height_unit", "periodic")] + [type(read)]


@check_of(Reader, needs=("path",))
def _place_of_the_file_does_not_matter(component: Reader, path: Any = None) -> None:
    """A copy of the file in another folder, with a blank in its name and its ending in capitals, gives the same; and a
    path gives what the file holds now."""
    with TemporaryDirectory() as name:
        copy = Path(name) / f"a copy{Path(path).suffix.upper()}"
        create(copy, read_bytes(path))
        ways = (component.read, component.height_map)
        same = all(_same(_of_image(read(copy)), _of_image(read(path))) for read in ways)
        require(same, f"a copy of the file, {copy.name!r}, is read as something else")
        write_file(copy, b"", force=True)
        refuses("a file that was emptied after it was read", lambda: component.read(copy), ChemageError)


def _same(one: list[Any], two: list[Any]) -> bool:
    return all(np.array_equal(a, b, equal_nan=isinstance(a, np.ndarray)) for a, b in zip(one, two, strict=True))


@check_of(Reader, needs=("path",))
def _height_map_is_the_surface(component: Reader, path: Any = None) -> None:
    """``height_map`` gives a HeightMap with the heights, the pixels and the periodicity of the surface that ``read``
    gives, as far as the file states them; heights that are missing are nan. An option ``pixel_size`` counts there too.
    """
    surface, image = component.read(path), component.height_map(path)
    require(isinstance(image, HeightMap), f"height_map() returned {type(image).__name__}; give a HeightMap")
    require_plain(dict(image.notes), "the notes of the height map")
    if not isinstance(surface, Surface):
        return
    require(image.heights.shape == surface.shape, f"the image has {image.heights.shape} pixels, not {surface.shape}")
    there = np.isfinite(image.heights)
    if image.height_unit is not None and there.any():
        heights = image.heights.astype(np.float64)[there] * image.height_unit
        read = surface.heights.astype(np.float64)[there]
        away = float(np.ptp(heights - read))
        require(
            away <= 1e-4 * max(float(np.ptp(read)), 1e-300),
            f"heights of the image times height_unit = {image.height_unit:g} nm differ from those of the surface by up "
            f"to {away:.3g} nm",
        )
    if image.pixel_size is not None:
        size = surface.pixel_size
        right = all(math.isclose(edge, size, rel_tol=1e-6) for edge in image.pixel_size)
        require(right, f"the pixels of the image are {image.pixel_size} nm, those of the surface {size} nm")
        require(image.periodic == surface.periodic, f"the image has periodic = {image.periodic}, the surface has not")
    if "pixel_size" in type(component).model_fields:
        stated = component.replace(pixel_size=2.5 * surface.pixel_size).height_map(path).pixel_size
        right = stated is None or all(math.isclose(edge, 2.5 * surface.pixel_size) for edge in stated)
        require(right, f"pixel_size = {2.5 * surface.pixel_size} nm was given, but the image has pixels of {stated} nm")
