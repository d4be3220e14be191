"""A measured or computed height map."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, SerializeAsAny, field_validator

from chemage.errors import InputError, PluginError, StoreError
from chemage.objects import Surface
from chemage.spec import Reader, Seed, SurfaceMaker
from chemage.units import Length, Unit
from chemage_surfaces._options import provenance


def _named_unit(value: Any) -> Any:
    """A unit by its name alone, "um", is one of it."""
    return f"1 {value}" if isinstance(value, str) and value[:1].isalpha() else value


FilePath = Annotated[str, BeforeValidator(lambda value: str(value) if isinstance(value, Path) else value)]


class FromFile(SurfaceMaker):
    """Heights from a file, higher = nearer to the counter-body.

    The file's ending chooses among the installed readers, unless ``reader`` names one. A measured map is taken as not
    periodic unless the file or ``periodic`` says otherwise.
    """

    kind = "from-file"

    path: FilePath
    """the file"""
    reader: SerializeAsAny[Reader] | None = None
    """kind of reader, or a table with its ``kind`` and options; None: by the file's ending"""
    pixel_size: Length | None = None
    """edge of a pixel, nm; needed where the file does not state it, and taken before what it states"""
    height_unit: Annotated[float, Unit("nm", gt=0), BeforeValidator(_named_unit)] = 1.0
    """unit of the heights in the file, nm: "um", or a number to multiply them by"""
    detrend: Literal["none", "mean", "plane"] = "none"
    """what to subtract: nothing, the mean height, or the plane of least squares"""
    periodic: bool | None = None
    """whether the map repeats; None: what the file says, else no"""

    @field_validator("reader", mode="before")
    @classmethod
    def _reader(cls, value: Any) -> Any:
        from chemage import registry

        if isinstance(value, str):
            return registry.current().make("reader", value, {})
        if isinstance(value, dict):
            if "kind" not in value:
                raise ValueError('name the reader: kind = "..."')
            return registry.fromdict("reader", value)
        return value

    def identity(self) -> dict[str, Any]:
        """Kind, options, and a hash of the file's bytes: an edited file is another surface.

        Raises
        ------
        StoreError
            The file cannot be read.
        """
        return {**super().identity(), "file_blake2b": self._file_hash()}

    def expected(self) -> dict[str, float]:
        found = self.make()
        nx, ny = found.shape
        return {"nx": nx, "ny": ny, "pixel_size": found.pixel_size}

    def _file_hash(self) -> str:
        try:
            with open(self.path, "rb") as file:
                return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
        except OSError as error:
            raise StoreError(f"{self.path}: {error.strerror or error}") from None

    def make(self, seed: Seed = 0) -> Surface:
        """The surface in the file. ``seed`` is ignored.

        Raises
        ------
        StoreError
            The file is missing, truncated, or not of the reader's format.
        InputError
            No reader or several answer to the file's ending; the pixel size is unknown; heights are not finite.
        """
        reader = self.reader or self._by_ending()
        if self.pixel_size is not None and "pixel_size" in type(reader).model_fields:
            reader = reader.replace(pixel_size=self.pixel_size)
        content = self._file_hash()
        found = reader.read(self.path)
        if not isinstance(found, Surface):
            raise InputError(f"{self.path}: reader {reader.kind!r} gives a {type(found).__name__}, not a surface")
        heights = found.heights
        if self.height_unit != 1:
            heights = heights * heights.dtype.type(self.height_unit)
        if self.detrend != "none":
            heights = _without_trend(heights, plane=self.detrend == "plane")
        return Surface(
            heights=heights,
            pixel_size=found.pixel_size if self.pixel_size is None else self.pixel_size,
            periodic=found.periodic if self.periodic is None else self.periodic,
            provenance={**provenance(self), "reader": reader.kind, "file_blake2b": content},
        )

    def _by_ending(self) -> Reader:
        from chemage import registry

        current, ending = registry.current(), Path(self.path).suffix.lower()
        answering, known = {}, set()
        for kind in current.kinds("reader"):
            try:
                cls = current.choice("reader", kind)
            except PluginError:
                continue  # `chemage plugins check` reports it; it must not stop the readers that work
            known |= set(cls.suffixes)
            if ending in cls.suffixes:
                answering[kind] = cls
        if not answering:
            raise InputError(
                f"path = {self.path!r}: no reader for files ending in {ending!r} (there are readers for "
                f"{', '.join(sorted(known))}); name one with reader = ..."
            )
        if len(answering) > 1:
            raise InputError(
                f"path = {self.path!r}: readers {', '.join(sorted(answering))} all answer; give reader = ..."
            )
        return next(iter(answering.values()))()


def _without_trend(heights: np.ndarray, *, plane: bool) -> np.ndarray:
    """Heights less their mean, or less their plane of least squares."""
    result = heights - heights.mean(dtype=np.float64)
    if plane:
        # on a full grid the two tilts and the mean are orthogonal, so each is a projection of its own
        for axis, count in enumerate(heights.shape):
            x = np.arange(count) - 0.5 * (count - 1)
            if count > 1:
                tilt = (x @ result.mean(axis=1 - axis)) / (x @ x)
                result -= (tilt * x)[:, None] if axis == 0 else (tilt * x)[None, :]
    return result.astype(heights.dtype, copy=False)
