"""Reading from files of other formats: the role of a reader, and the one look-up of readers by file ending."""

from __future__ import annotations

from abc import ABC, abstractmethod
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

from chemage.foundation.components import Component
from chemage.foundation.errors import InputError, PluginError, StoreError
from chemage.plugins import registry
from chemage.plugins.sources import note_providers


class Reader(Component, ABC):
    """Role ``reader``: reads a file format into a Surface or another chemage object."""

    role = "reader"
    error_of: ClassVar[str] = "the heights"
    #: file name endings that this reader accepts, with the dot
    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def read(self, path: str | PathLike[str]) -> Any:
        """The object in the file."""


def reader_for(path: str | PathLike[str]) -> Reader:
    """The installed reader for the ending of ``path``, with its default options.

    A reader that cannot be imported is left out: ``chemage plugins check`` reports it, and it must not stop the readers
    that work.

    Raises
    ------
    StoreError
        No installed reader accepts the ending.
    InputError
        Several do.
    """
    plugins, ending = registry.current(), Path(path).suffix.lower()
    answering: dict[str, Any] = {}
    known: set[str] = set()
    for kind in plugins.kinds("reader"):
        try:
            cls = plugins.component("reader", kind)
        except PluginError:
            continue
        known |= set(cls.suffixes)
        if ending in cls.suffixes:
            answering[kind] = cls
    if not answering:
        known_endings = ", ".join(sorted(known)) or "nothing"
        what = f"files ending in {ending!r}" if ending else "a file without ending"
        raise StoreError(
            f"path = {str(path)!r}: no reader for {what} (there are readers for {known_endings}); "
            "name one with reader = ..."
        )
    if len(answering) > 1:
        raise InputError(f"path = {str(path)!r}: readers {', '.join(sorted(answering))} all answer; give reader = ...")
    reader = next(iter(answering.values()))()
    note_providers(reader)
    return reader
