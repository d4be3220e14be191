"""Checks of a reader of files."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from chemage.foundation.errors import ChemageError
from chemage.foundation.records import Record
from chemage.surfaces.reading import Reader
from chemage.testing.checks import check_of, refuses, require, run_checks


def check_reader(component: Reader, **inputs: Any) -> None:
    """Run every check of the role ``reader``; raises AssertionError if one fails.

    ``inputs`` is ``path``, a file that the reader can read.
    """
    run_checks(component, Reader, inputs)


@check_of("reader")
def _suffixes_are_named(component: Reader) -> None:
    suffixes = type(component).suffixes
    require(isinstance(suffixes, tuple) and suffixes, f"suffixes = {suffixes!r}: name the file endings that it reads")
    require(all(s.startswith(".") and s == s.lower() for s in suffixes), f"{suffixes}: lower case, with the dot")


@check_of("reader")
def _bad_files_are_refused(component: Reader, path: Any = None) -> None:
    """A missing, empty or truncated file, or one of another format, raises a ChemageError that names the file."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        suffix = type(component).suffixes[0]
        files = {"missing": folder / f"missing{suffix}", "folder": folder}
        contents = {"empty": b"", "foreign": b"\x89not this format at all\r\n\x1a\n\x00" * 20}
        if path is not None:
            good = Path(path).read_bytes()
            contents["truncated"] = good[: len(good) // 2]
            suffix = Path(path).suffix
        for label, content in contents.items():
            files[label] = folder / f"{label}{suffix}"
            files[label].write_bytes(content)
        for label, file in files.items():
            message = refuses(f"a {label} file", lambda file=file: component.read(file), ChemageError)
            require(file.name in message, f"a {label} file: the message does not name it: {message}")


@check_of("reader")
def _reads_its_file(component: Reader, path: Any = None) -> None:
    if path is None:
        return
    first, second = component.read(path), component.read(str(path))
    require(first is not None, "read() returned None")
    if isinstance(first, Record):
        require(first == second, "reading the file as Path and as str gave different objects")
