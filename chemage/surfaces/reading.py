"""Reading from files of other formats: what a file holds, the role of a reader, and the one look-up of readers."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from chemage.foundation.components import Component
from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.files import FileStamp, file_stamp, open_file, regular_file
from chemage.foundation.ownership import in_words
from chemage.foundation.units import carried
from chemage.plugins import context, registry
from chemage.plugins.context import note
from chemage.plugins.loading import PluginRecord
from chemage.plugins.sources import providers
from chemage.surfaces.surface import Surface


@dataclass(frozen=True, eq=False)
class HeightMap:
    """An image as its file holds it: heights may be missing, pixels may have two sides, units may be unknown.

    A :class:`chemage.Surface` has none of these; steps that the user chooses lead from one to the other.
    """

    #: (nx, ny), float32 or float64, higher = nearer to the counter-body; nan where a height is missing
    heights: np.ndarray
    #: nm per unit of the heights; None: the file does not state it
    height_unit: float | None
    #: edges of a pixel along x and y, nm; None: the file does not state them
    pixel_size: tuple[float, float] | None
    #: whether the file says that the image repeats
    periodic: bool = False
    #: what to call the file in messages
    source: str = "the file"
    #: what else identifies the image, such as its format and channel: plain JSON values
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        heights = self.heights
        if (
            not isinstance(heights, np.ndarray)
            or heights.dtype.kind != "f"
            or carried(heights) is not None
        ):
            raise InputError.of(
                "heights",
                type(heights).__name__,
                "is no plain array of real numbers",
            )
        if isinstance(heights, np.ma.MaskedArray):
            object.__setattr__(self, "heights", heights.filled(np.nan))
        if heights.ndim != 2 or heights.size == 0:
            raise InputError(
                f"{self.source} holds an array of shape {heights.shape}; an image has two dimensions (nx, ny)"
            )
        sizes = (
            *(self.pixel_size or ()),
            *(() if self.height_unit is None else (self.height_unit,)),
        )
        if not all(
            isinstance(size, int | float | np.number)
            and np.isfinite(size)
            and size > 0
            for size in sizes
        ):
            raise InputError(
                f"{self.source} states pixels of {self.pixel_size} nm and a height unit of {self.height_unit} nm; "
                "both must be above 0: give pixel_size and height_unit"
            )


class Reader(Component, ABC):
    """Role ``reader``: reads a file format into a Surface or another chemage object."""

    role = "reader"
    error_of = "the heights"
    #: file name endings that this reader accepts, with the dot
    suffixes: ClassVar[tuple[str, ...]] = ()
    #: bytes with one of which every file of this format begins; empty: there are none
    marks: ClassVar[tuple[bytes, ...]] = ()
    #: whether it reads many formats through a library, and is asked after all others
    general: ClassVar[bool] = False

    @classmethod
    def claims(cls, head: bytes, path: str | PathLike[str]) -> bool | None:
        """Whether a file that begins with ``head`` (at most 64 kB) is in this format; None: its content cannot tell.

        Here by its ``marks``.
        """
        return head.startswith(cls.marks) if cls.marks else None

    @abstractmethod
    def read(self, path: str | PathLike[str]) -> Any:
        """The object in the file."""

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """The image in the file as it is, also where heights are missing, pixels are not square, or units unknown.

        Here it is the surface that :meth:`read` returns. Override it for a format of instruments.
        """
        surface = self.read(path)
        if not isinstance(surface, Surface):
            raise InputError(
                f"{path}: reader {self.kind!r} gives a {type(surface).__name__}, not a surface"
            )
        size = surface.pixel_size
        return HeightMap(
            surface.heights, 1.0, (size, size), surface.periodic, source=str(path)
        )


#: bytes at the beginning of a file by which readers recognise it
HEAD = 1 << 16


def reader_for(path: str | PathLike[str]) -> Reader:
    """The installed reader for the content of ``path``, else for its ending, with its default options.

    Readers that recognise the content come first; then those of the ending that cannot tell; then general readers,
    which read many formats; then those of the ending, whose errors say what is wrong with the file. Of several, that of
    a preferred plugin (``[plugins] prefer``) is taken, else chemage's own, so that no result changes when a plugin is
    installed, else that of the ending. A reader that cannot be used, or asked, is left out with a warning.

    Raises
    ------
    StoreError
        No installed reader recognises the content or accepts the ending.
    InputError
        Several do, and none comes first.
    """
    ending = Path(path).suffix.lower()
    readers, general = _readers()
    kinds = _first(_able(path, readers, general, ending))[0]
    if not kinds:
        if not regular_file(path).st_size:
            raise StoreError(
                f"{path} is empty, or a file of the system without a size; name another file"
            )
        known_endings = ", ".join(sorted(readers)) or "nothing"
        what = f"files ending in {ending!r}" if ending else "a file without ending"
        name = (
            f'"{min(general)}", which says why it cannot read it'
            if general
            else "..."
        )
        raise StoreError(
            f"path = {str(path)!r}: no reader for {what} (there are readers for {known_endings}), nor for its content; "
            f"name one with reader = {name}"
        )
    if len(kinds) > 1:
        kinds = {
            kind: kinds[kind] for kind in kinds if kind in readers.get(ending, {})
        } or kinds
    if len(kinds) > 1:
        raise InputError(
            f"path = {str(path)!r}: the readers {', '.join(sorted(kinds))} all read {ending or 'it'}; give reader = "
            "..., or prefer the plugin of one of them "
            f"({', '.join(sorted({kinds[kind].name for kind in kinds}))})"
        )
    reader = registry.current().component("reader", next(iter(kinds)))()
    for name, source in providers(reader).items():
        note(name, source)
    return reader


def _able(
    path: str | PathLike[str],
    readers: dict[str, dict[str, PluginRecord]],
    general: set[str],
    ending: str,
) -> dict[str, PluginRecord]:
    """The readers of the first group that has any, in the order that :func:`reader_for` states."""
    plugins = registry.current()
    of_ending = readers.get(ending, {})
    everyone = {
        kind: record for kinds in readers.values() for kind, record in kinds.items()
    }
    try:
        head = _head(path, file_stamp(path))
    except StoreError:  # the reader of the ending says so
        return {
            kind: record
            for kind, record in of_ending.items()
            if kind not in general
        } or of_ending

    def claims(kind: str) -> bool | None:
        with _left_out(f"{path}: reader {kind!r} ({everyone[kind].source})"):
            return plugins.component("reader", kind).claims(head, path)
        return False

    said = {kind: claims(kind) for kind in everyone if kind not in general}
    open_ = {
        kind: record
        for kind, record in of_ending.items()
        if kind in said and said[kind] is None
    }
    claiming = {kind: everyone[kind] for kind in said if said[kind]}
    if claiming:  # a preferred plugin comes before them
        return claiming | {
            kind: record
            for kind, record in open_.items()
            if record.name in context.preference()
        }
    if open_:
        return open_
    for kind in general & everyone.keys():
        said[kind] = kind in of_ending or (bool(head) and claims(kind))
    by_general = {kind: everyone[kind] for kind in general if said.get(kind)}
    return by_general or of_ending


@lru_cache(maxsize=8)
def _head(path: str | PathLike[str], stamp: FileStamp) -> bytes:
    """The beginning of a file, read once as long as it does not change."""
    with open_file(path) as file:
        return file.read(HEAD)


def _readers() -> tuple[dict[str, dict[str, PluginRecord]], set[str]]:
    """Ending -> kind of each reader that accepts it -> the plugin it is from; and the kinds of general readers."""
    plugins = registry.current()
    readers: dict[str, dict[str, PluginRecord]] = {}
    general: set[str] = set()
    for kind, cls in plugins.usable("reader"):
        record = plugins.offer("reader", kind)
        with _left_out(f"reader {kind!r} ({record.source})"):
            endings = [*map(str.lower, cls.suffixes)]
            if cls.general:
                general.add(kind)
            for ending in endings:
                readers.setdefault(ending, {})[kind] = record
    return readers, general


@contextmanager
def _left_out(what: str) -> Iterator[None]:
    """Warn of what a reader raises, so that others read."""
    try:
        yield
    except (Exception, SystemExit) as error:
        text = f"{what} is left out: {in_words(error)}"
        warnings.warn(text, registry.PluginWarning, stacklevel=3)


def _first(kinds: dict[str, PluginRecord]) -> tuple[dict[str, PluginRecord], str]:
    """Those of the readers ``kinds`` that come first, and why."""
    first, why = registry.current().first(kinds.values())
    return {kind: record for kind, record in kinds.items() if record in first}, why


def shared_endings() -> list[str]:
    """A sentence for each file ending that several readers accept: which is used, and how to change that."""
    said = []
    readers, general = _readers()
    for ending, kinds in sorted(readers.items()):
        kinds = {
            kind: record for kind, record in kinds.items() if kind not in general
        }
        if len(kinds) < 2:
            continue
        first, why = _first(kinds)
        listed = " and ".join(
            f"{kind!r} ({record.source})" for kind, record in sorted(kinds.items())
        )
        wins = (
            f"{next(iter(first))!r} is used, because {why}"
            if len(first) == 1
            else "none is used by default"
        )
        other = next(
            iter(
                {
                    kind: record
                    for kind, record in kinds.items()
                    if kind not in first
                }
                or kinds
            )
        )
        said.append(
            f"the readers {listed} all read {ending}; {wins}; to change this, write reader = "
            f'"{other}" where the file is named, or {registry.prefer_another(kinds[other].name)}'
        )
    return said
