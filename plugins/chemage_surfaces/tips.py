"""Tips: smooth bodies of revolution (``sphere``, ``spherical-cap``, ``cone``), and ``tip``, a body with its own
roughness at a place of a counterface.

Where two rough bodies touch, the contact is that of one body with the sum of both heights (K. L. Johnson, Contact
Mechanics, chapter 4), so that every contact solver takes a tip as it takes any other surface.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from chemage import InputError, Surface
from chemage.plugin import (
    CONTINUATIONS,
    Choice,
    Length,
    Scatter,
    Seed,
    SurfaceMaker,
    Unit,
    memory,
)
from chemage_surfaces._maps import (
    LARGEST_PART,
    SQUARE,
    Floats,
    Pair,
    Parts,
    Pixels,
    provenance,
    stream,
)

_JOHNSON = """@book{johnson1985,
  author = {Johnson, K. L.},
  title = {Contact Mechanics},
  publisher = {Cambridge University Press},
  year = {1985},
  doi = {10.1017/CBO9781139171731},
}"""
#: distinguishes the random numbers of this module from those of other makers with the same seed
_STREAM = 0x74697073
#: in words: what of the counterface the seed draws
_UNMEASURED = "waves that the image does not show"
_Seed = Annotated[int, Field(ge=0)]
#: standard deviations of the waves that an image does not show, by which a point may be higher than in the image
UNSEEN = 4.0
#: pixels along the sides of the largest grid that ``depth`` makes
LARGEST_PATCH = 1024
#: samples along the sides of the grids on which points that can touch are sought
FINER = 512


class _Body(SurfaceMaker):
    """A smooth body of revolution with its apex at height 0 in the middle of the grid; the seed is ignored."""

    #: whether the contact at any load is taken for that of a sphere of this radius
    hertzian: ClassVar[bool] = True

    radius: Length
    """radius of curvature R of the apex, nm"""
    pixels: Pixels
    """grid: one number for a square, or [nx, ny]"""
    pixel_size: Length
    """edge of a pixel, nm"""

    @abstractmethod
    def _heights(self, x: Floats, y: Floats) -> Floats:
        """Heights (nx, ny) at the squared distances ``x`` and ``y`` from the apex along both sides, nm²."""

    def around(self, x: Floats, y: Floats) -> Floats:
        """Heights at ``x`` and ``y`` nm from the apex, also beyond the grid: −∞ where the body has ended."""
        with np.errstate(invalid="ignore"):
            heights = self._heights(x**2, y**2)
        return np.where(np.isnan(heights), -math.inf, heights)

    @property
    def _corner(self) -> float:
        """Distance of the corners of the grid from the apex, nm."""
        return math.hypot(
            *(0.5 * (count - 1) * self.pixel_size for count in self.pixels)
        )

    def expected(self) -> dict[str, float]:
        """The grid and the radius."""
        nx, ny = self.pixels
        radius = {"radius": self.radius} if self.hertzian else {}
        return {
            "nx": nx,
            "ny": ny,
            "pixel_size": self.pixel_size,
            **radius,
            "periodic": 0.0,
        } | {"cpu_seconds": 1e-8 * nx * ny}

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """None: the seed is ignored."""
        return Scatter(0.0)

    def make(self, seed: Seed = 0) -> Surface:
        """Make the surface: heights (nx, ny) float64 nm, at most 0. ``seed`` is ignored.

        ``provenance["radius"]`` is R in nm, of bodies to which Hertz' theory applies. Surfaces with
        ``provenance["tip"]`` are tips: their contact must not reach the edge of the grid.
        """
        memory.require(
            3 * 8.0 * self.pixels[0] * self.pixels[1],
            f"pixels = {self.pixels}",
            "use fewer",
        )
        across, along = (
            ((np.arange(count) - 0.5 * (count - 1)) * self.pixel_size) ** 2
            for count in self.pixels
        )
        heights = self._heights(across, along)
        heights.setflags(write=False)
        radius = {"radius": self.radius} if self.hertzian else {}
        return Surface(
            heights=heights,
            pixel_size=self.pixel_size,
            periodic=False,
            provenance={**provenance(self), "tip": {}, **radius},
        )


class Sphere(_Body):
    """A sphere near its apex: the paraboloid −r²/(2R) with apex at height 0 in the middle of the grid; not periodic.

    Hertz' theory is that of a paraboloid, so that a numerical solution for this surface can be compared with the closed
    form at any load. A sphere is lower by the fraction r²/(4R²), 0.25 % at r = R/10, where the error of small-strain
    elasticity is of the same size.

    The apex has the pixel index ((nx − 1)/2, (ny − 1)/2): on a pixel for odd numbers, between pixels for even ones.
    Heights equal their mirror images to the last bit.
    """

    kind = "sphere"
    cite = (
        "K. L. Johnson, Contact Mechanics, Cambridge University Press (1985), ch. 4",
    )
    bibtex = (_JOHNSON,)

    @model_validator(mode="after")
    def _check(self) -> Self:
        lowest = sum(
            (0.5 * (count - 1) * self.pixel_size) ** 2 for count in self.pixels
        ) / (2 * self.radius)
        if lowest > 1e250:
            raise ValueError(
                f"radius = {self.radius:g} nm: the edge of the grid would lie {lowest:g} nm below the apex; "
                "give radius and pixel_size in nm"
            )
        return self

    def _heights(self, x: Floats, y: Floats) -> Floats:
        return -(
            (x / (2 * self.radius))[:, None] + (y / (2 * self.radius))[None, :]
        )


class SphericalCap(_Body):
    """A true sphere, not the paraboloid of ``sphere``, on a grid whose corners are less than R from the apex."""

    kind = "spherical-cap"
    hertzian = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self._corner >= self.radius:
            raise ValueError(
                f"radius = {self.radius:g} nm: the corners of the grid are {self._corner:.4g} nm from the apex, beyond "
                'the sphere; use fewer pixels, or kind = "sphere" (a paraboloid) or "cone"'
            )
        return self

    def _heights(self, x: Floats, y: Floats) -> Floats:
        return _cap(x[:, None] + y, self.radius)


class Cone(_Body):
    """A cone whose apex is a sphere of radius R that touches the cone smoothly, at the distance R cos α from the axis.

    Source of its contact: I. N. Sneddon, Int. J. Eng. Sci. 3, 47 (1965).
    """

    kind = "cone"
    hertzian = False

    half_angle: Annotated[Any, Unit("deg", gt=0, lt=90)]
    """angle α between the axis and the side, degrees"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self._corner / math.tan(math.radians(self.half_angle)) > 1e250:
            raise ValueError(
                f"half_angle = {self.half_angle:g} degrees: heights are out of range; give a blunter cone"
            )
        return self

    def _heights(self, x: Floats, y: Floats) -> Floats:
        angle = math.radians(self.half_angle)
        touch = self.radius * math.cos(angle)
        square = x[:, None] + y
        # on the side the cap is that of the circle of touch, and the cone goes on from there
        side = np.maximum(np.sqrt(square) - touch, 0.0)
        return _cap(np.minimum(square, touch**2), self.radius) - side / math.tan(
            angle
        )


def _cap(square: Floats, radius: float) -> Floats:
    """Height of a sphere at squared distances from its axis; without cancellation near the apex."""
    return -square / (radius + np.sqrt(radius**2 - square))


class Tip(SurfaceMaker):
    """A tip at a place of a counterface: the sum of the heights of a body, of its own roughness, and of the part of the
    counterface below it.

    The seed draws the roughness and the place, so that an ensemble is the mean over tips and places; with
    ``roughness_seed`` it is over the places of one tip, which is the average of a scan. The counterface is one surface,
    that of ``counterface_seed``. x and y are those of the counterface. ``provenance["tip"]`` has the place.

    The grid is the part that can touch, see ``depth``; of a measured body, which ends with its image, it is that of the
    body. ``provenance["tip"]["below"]`` says how far (nm) all points beyond the grid are below the highest one: a contact
    with a larger approach is refused. Beyond the grid the tip is taken as smooth. Of a counterface of more than 2²⁴
    pixels only this part is made.
    """

    kind = "tip"

    body: Choice[SurfaceMaker]
    """shape, a table: ``sphere`` (paraboloid), ``spherical-cap``, ``cone``, or a measured shape"""
    apex: Literal["up", "down"] = "up"
    """where the apex of a measured body is in its file: the highest point (as an image shows a tip), or the lowest"""
    own_roughness: Choice[SurfaceMaker] | None = None
    """roughness of the tip, such as ``self-affine``: a part as large as the body, from a random place; None: smooth"""
    roughness_seed: _Seed | None = None
    """seed of the roughness; None: that of the surface, so that every seed is another tip"""
    counterface: Choice[SurfaceMaker] | None = None
    """the other body, generated or measured; None: flat"""
    counterface_seed: _Seed | None = None
    """seed of the counterface; None: 0, or where seeds draw only what an image does not show, that of the surface"""
    place: (
        tuple[Annotated[Any, Unit("nm", ge=0)], Annotated[Any, Unit("nm", ge=0)]]
        | None
    ) = None
    """[x, y] of the middle of the tip on the counterface, nm from its edges, to whole pixels; None: random, uniform
    over all places where the tip's grid lies on the counterface"""
    depth: Length | None = None
    """the grid of the body is moved and enlarged to hold all points that are up to this far below the highest one, nm:
    a contact with a smaller approach touches no others; None: to hold the highest one"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for option, part in (
            ("place", "counterface"),
            ("depth", "counterface"),
            ("roughness_seed", "own_roughness"),
        ):
            if getattr(self, option) is not None and getattr(self, part) is None:
                raise ValueError(
                    f"{option} = {getattr(self, option)}: there is no {part}; give {part}, or leave it out"
                )
        if self.depth is not None and not isinstance(self.body, _Body):
            raise ValueError(
                f"depth = {self.depth:g} nm: a {self.body.kind} body ends with its grid; leave depth out"
            )
        if self.apex == "down" and isinstance(self.body, _Body):
            raise ValueError(
                f"apex = 'down': {self.body.kind} has its apex up; leave apex out"
            )
        return self

    @property
    def _drawn(self) -> list[str]:
        """What another seed changes."""
        parts = {
            "body": getattr(self.body.scatter({}), "relative", None) != 0,
            "own_roughness": self.own_roughness is not None
            and self.roughness_seed is None,
            "place": self.counterface is not None and self.place is None,
            _UNMEASURED: self._continues,
        }
        return [name for name, drawn in parts.items() if drawn]

    @property
    def _continues(self) -> bool:
        """Whether the seed draws what an image of the counterface does not show."""
        if self.counterface is None or self.counterface_seed is not None:
            return False
        scatter = self.counterface.scatter({})
        return scatter is not None and scatter.between == CONTINUATIONS

    def expected(self) -> dict[str, float]:
        """What the body expects; of a tip that is not smooth on a flat, only the grid and the time."""
        expected = self.body.expected()
        seconds, smooth = expected.get("cpu_seconds", 0.0), True
        for name, maker in (
            ("own_roughness", self.own_roughness),
            ("counterface", self.counterface),
        ):
            if maker is not None:
                part, smooth = maker.expected(), False
                self._check_part(name, expected, part)
                seconds += part.get("cpu_seconds", 0.0)
        if smooth:
            return expected
        known = {
            name: expected[name]
            for name in ("nx", "ny", "pixel_size")
            if name in expected
        }
        return {**known, "periodic": 0.0, "cpu_seconds": seconds}

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """Unknown where the seed draws the roughness or the place, else none."""
        drawn = self._drawn
        if not drawn:
            return Scatter(0.0)
        source = f"the seed draws the {' and the '.join(drawn)}".replace("_", " ")
        between = "surfaces"
        if drawn == [_UNMEASURED]:
            between = CONTINUATIONS
        elif set(drawn) <= {"place", _UNMEASURED}:
            between = "places"
        return Scatter(None, source, between)

    def members(self, count: int) -> Sequence[Self]:
        """Those of the parts."""
        parts = {
            name: maker.members(count) for name, maker in self._parts().items()
        }
        found = [{} for _ in range(max(map(len, parts.values())))]
        for name, members in parts.items():
            for options, member in zip(found, members, strict=False):
                options[name] = member
        return [self.replace(**options) for options in found]

    @property
    def unknown(self) -> str:
        """What is not known of the parts."""
        return "; ".join(
            filter(None, (one.unknown for one in self._parts().values()))
        )

    def _parts(self) -> dict[str, SurfaceMaker]:
        """The makers of the parts that there are."""
        parts = {
            "body": self.body,
            "own_roughness": self.own_roughness,
            "counterface": self.counterface,
        }
        return {name: maker for name, maker in parts.items() if maker is not None}

    def make(self, seed: Seed = 0) -> Surface:
        """The tip and the counterface below it: heights (nx, ny) float64 nm, not periodic.

        Raises
        ------
        InputError
            The pixels of the parts differ, a part is smaller than the body, or the tip leaves the counterface.
        """
        seed = stream(seed)
        body = self.body.make(seed)
        heights = body.heights.astype(np.float64) * (
            1.0 if self.apex == "up" else -1.0
        )
        record: dict[str, Any] = {"body": body.provenance}
        below, beyond = None, -math.inf
        if self.counterface is not None:
            maker = self.counterface
            below_seed: Seed = self.counterface_seed or 0
            if self._continues:
                below_seed = stream(seed, _STREAM, 3)
            whole = getattr(maker, "whole_or_parts", maker.make)(below_seed)
            first = self._first(
                "counterface",
                whole,
                body.shape,
                body.pixel_size,
                self.place,
                stream(seed, _STREAM, 2),
                record,
            )
            if isinstance(self.body, _Body):
                first, below, heights, beyond = _Patch.under(
                    self.body, whole, first, self.depth or 0.0
                )
                record["counterface"]["first_pixel"] = list(first)
            else:
                below = _cut(whole, first, body.shape)
        if self.own_roughness is not None:
            own = seed if self.roughness_seed is None else self.roughness_seed
            rough = self.own_roughness.make(stream(own, _STREAM, 0))
            first = self._first(
                "own_roughness",
                rough,
                heights.shape,
                body.pixel_size,
                None,
                stream(own, _STREAM, 1),
                record,
            )
            heights += _cut(rough, first, heights.shape)
        if below is not None:
            heights += below
        if beyond > -math.inf:
            record["below"] = float(heights.max()) - beyond
        heights.setflags(write=False)
        smooth = self.own_roughness is None and self.counterface is None
        radius = (
            {"radius": body.provenance["radius"]}
            if smooth and "radius" in body.provenance
            else {}
        )
        return Surface(
            heights=heights,
            pixel_size=body.pixel_size,
            periodic=smooth and body.periodic,
            provenance={
                **provenance(self, seed if self._drawn else None),
                "tip": record,
                **radius,
            },
        )

    def _check_part(
        self, name: str, body: Mapping[str, float], part: Mapping[str, float]
    ) -> None:
        """Refuse a part whose pixels differ from those of the body, or which is smaller."""
        known = {"nx", "ny", "pixel_size"}
        if not known <= body.keys() or not known <= part.keys():
            return
        side = body["pixel_size"]
        if abs(part["pixel_size"] - side) > SQUARE * side:
            raise InputError(
                f"{name}: pixels of {part['pixel_size']:.6g} nm, but those of the body are {side:.6g} nm; give both "
                'the same pixel_size (of an image: resample, or kind = "roughened")'
            )
        if part["nx"] < body["nx"] or part["ny"] < body["ny"]:
            raise InputError(
                f"{name}: {part['nx']:g} x {part['ny']:g} pixels, but the body has {body['nx']:g} x {body['ny']:g}; "
                f"give a larger {name}, or a body on fewer pixels"
            )

    def _first(
        self,
        name: str,
        surface: Surface | Parts,
        shape: Pair,
        pixel_size: float,
        place: tuple[float, float] | None,
        stream: np.random.SeedSequence,
        record: dict[str, Any],
    ) -> Pair:
        """The first pixel of the part of ``surface`` under the body at ``place``, or at a random one."""
        grids = [
            {"nx": nx, "ny": ny, "pixel_size": size}
            for (nx, ny), size in (
                (shape, pixel_size),
                (surface.shape, surface.pixel_size),
            )
        ]
        self._check_part(name, *grids)
        rng = np.random.Generator(np.random.Philox(stream))
        first = []
        for axis, (count, width) in enumerate(
            zip(surface.shape, shape, strict=True)
        ):
            last = count - 1 if surface.periodic else count - width
            start = (
                int(rng.integers(last + 1))
                if place is None
                else round(place[axis] / pixel_size - width / 2)
            )
            if not surface.periodic and not 0 <= start <= last:
                low = 0.5 * width * pixel_size
                high = (count - 0.5 * width) * pixel_size
                raise InputError(
                    f"place = {list(place or ())}: the tip leaves the {name} along {'xy'[axis]}; give {low:.6g} to "
                    f"{high:.6g} nm"
                )
            first.append(start)
        (x, y), (nx, ny) = first, shape
        record[name] = {"surface": surface.provenance, "first_pixel": first}
        record[name]["place"] = [
            (x + 0.5 * nx) * pixel_size,
            (y + 0.5 * ny) * pixel_size,
        ]
        return x, y


def _cut(surface: Surface | Parts, first: Pair, shape: Pair) -> Floats:
    """Heights of ``shape`` pixels from ``first`` on, nm."""
    if isinstance(surface, Parts):
        x, y = (
            start + count // 2 for start, count in zip(first, shape, strict=True)
        )
        return surface.heights(first, shape, (x, y), 1)
    rows, columns = (
        np.arange(start, start + count) % side
        for start, count, side in zip(first, shape, surface.shape, strict=True)
    )
    return surface.heights[np.ix_(rows, columns)].astype(np.float64)


class _Patch(NamedTuple):
    """The part of a counterface that can touch a body."""

    first: Pair
    #: heights of the two, nm
    counterface: Floats
    body: Floats
    #: highest point of their sum beyond the patch, nm
    beyond: float

    @classmethod
    def under(
        cls, body: _Body, surface: Surface | Parts, first: Pair, depth: float
    ) -> Self:
        """The patch under a body whose grid begins at the pixel ``first``, or what holds all points up to ``depth``
        (nm) below the highest one. Of :class:`Parts` they are sought as far around as the image says that they may be.
        """
        size, shape, begin = (
            surface.pixel_size,
            np.array(body.pixels),
            np.array(first),
        )
        middle, apex = begin + shape // 2, begin + 0.5 * (shape - 1)
        low, beyond = 0 * shape, -math.inf

        if isinstance(surface, Parts):
            low, heights, beyond = _searched(body, surface, middle, apex, depth)
        elif surface.periodic:
            low = middle - np.array(surface.shape) // 2
            heights = _cut(surface, _pair(low), surface.shape)
        else:
            heights = surface.heights
        shapes = _body_at(body, low - apex, heights.shape, size)
        both = heights + shapes
        if beyond > both.max() - depth:
            raise InputError(
                f"depth = {depth:g} nm: by the long waves of the image, points may be as high as those that were found "
                f"within {LARGEST_PART * size:.3g} nm; give another place, or an image on smaller pixels"
            )
        start = begin - low
        # of the points that can touch, with a pixel around them
        can = np.argwhere(both >= both.max() - depth)
        least = np.maximum(can.min(axis=0) - 1, 0)
        most = np.minimum(can.max(axis=0) + 2, both.shape)
        end = start + shape
        inside = (start >= 0).all() and (end <= both.shape).all()
        if not inside or (least < start).any() or (most > end).any():
            shape = np.maximum(shape, most - least)
            start = np.clip((least + most - shape) // 2, 0, both.shape - shape)
        if shape.max() > max(LARGEST_PATCH, *body.pixels):
            raise InputError(
                f"depth = {depth:g} nm: points that can touch are {shape.max() * size:.4g} nm apart, {shape.max()} pixels; "
                f"more than {LARGEST_PATCH} are not made: give a smaller depth, larger pixels, or another place"
            )
        (x, y), (end_x, end_y) = start, start + shape
        part = np.s_[x:end_x, y:end_y]
        both[part] = -math.inf
        return cls(
            first=_pair(low + start),
            counterface=heights[part].astype(np.float64),
            body=shapes[part],
            beyond=max(beyond, float(both.max())),
        )


def _searched(
    body: _Body, surface: Parts, middle: np.ndarray, apex: np.ndarray, depth: float
) -> tuple[np.ndarray, Floats, float]:
    """First pixel and heights of the part that may hold the points up to ``depth`` below the highest one; and the highest
    point that may lie elsewhere, nm. They are sought by the long waves of the image, and where these leave more than a
    part, by shorter and shorter waves on finer and finer grids."""
    size, step = surface.pixel_size, surface.side / surface.pixel_size
    low, heights, beyond = np.zeros(2), surface.coarse, -math.inf
    unsure = UNSEEN * surface.unseen(0)
    while True:
        shape = heights.shape
        corner = low + 0.5 * (step - 1) - apex
        lower = heights + _body_at(body, corner, shape, size, step) - unsure
        upper = (
            heights + _body_at(body, corner, shape, size, step, step / 2) + unsure
        )
        can = np.argwhere(upper >= lower.max() - depth)
        # of the cells around the points that can touch
        least, most = can.min(axis=0), can.max(axis=0) + 1
        extent = float((most - least).max() * step)
        finer = math.ceil(extent / FINER)
        is_last = extent <= LARGEST_PART or finer >= step
        if is_last and extent > LARGEST_PART:
            least = np.array(np.unravel_index(lower.argmax(), shape))
            most = least + 1
        start, end = low + least * step, low + most * step
        if is_last:
            reach = 2 * np.array(body.pixels)
            reach = np.clip(
                (end - start) / 2, reach, np.maximum(reach, LARGEST_PART // 2)
            )
            centre = (start + end) / 2
            start = np.maximum(centre - reach, 0)
            end = np.minimum(np.ceil(centre + reach), surface.shape)
            least = np.ceil((start.astype(int) - low) / step).astype(int)
            most = np.floor((end - low) / step).astype(int)
        (x, y), (end_x, end_y) = np.maximum(least, 0), most
        upper[x:end_x, y:end_y] = -math.inf
        beyond = max(beyond, float(upper.max()))
        if is_last:
            first, end = start.astype(int), end.astype(int)
            part = surface.heights(
                _pair(first), _pair(end - first), _pair(middle), 1
            )
            return first, part, beyond
        low, step = np.maximum(np.floor(start), 0).astype(int), finer
        counts = np.ceil((np.minimum(end, surface.shape) - low) / step).astype(int)
        heights = surface.heights(_pair(low), _pair(counts), _pair(middle), step)
        unsure = UNSEEN * surface.unseen(step)


def _body_at(
    body: _Body,
    low: Floats,
    counts: Pair,
    size: float,
    side: float = 1.0,
    near: float = 0.0,
) -> Floats:
    """Heights of the body at ``counts`` places from ``low`` on, ``side`` apart and up to ``near`` closer to the apex: in
    pixels of ``size``, from the apex."""
    x, y = (
        np.maximum(np.abs(start + side * np.arange(count)) - near, 0) * size
        for start, count in zip(low, counts, strict=True)
    )
    return body.around(x, y)


def _pair(values: np.ndarray) -> Pair:
    x, y = values.tolist()
    return x, y
