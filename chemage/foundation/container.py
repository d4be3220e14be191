"""The one container of what chemage keeps on disk, and its one seal, so that damage is an error and never a number.

A container holds records by name, and what they are about as plain values. It has the layout of NetCDF-4, in which any
HDF5 program opens it, or where chemage alone reads it (contacts of a study, tables in the cache folder) that of an npz
archive, in which a small, mostly empty map is written twenty times as fast into a tenth of the room. Either ends with a
seal: the SHA-256 of each of its parts, and of this list. Readers of HDF5 and zip ignore what follows their content;
chemage compares before it parses, because a damaged file can crash the library that reads it. A text for people is a
JSON object with the SHA-256 of what comes before in its last field.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np

from chemage.foundation import codec
from chemage.foundation.errors import ChemageError, DamagedError, StoreError
from chemage.foundation.files import fresh_file
from chemage.foundation.records import Named, Record

#: layout of the file; a reader refuses a newer one
FORMAT = 2
#: the first bytes of an HDF5 file, and of an npz archive
_HDF5, _ARCHIVE = b"\x89HDF\r\n\x1a\n", b"PK\x03\x04"
#: what ends a sealed file: length and SHA-256 of the list of parts
_END = re.compile(rb"\nchemage seal (\d{8}) ([0-9a-f]{64})\n\Z")
_END_LENGTH = len("\nchemage seal \n") + 8 + 1 + 64
_FIELD = re.compile(rb',\s*"sha256": "([0-9a-f]{64})"\s*\}\s*\Z')
_TRACE = re.compile(rb"sha256|[0-9a-f]{64}")
_CHANGED = "not what chemage wrote: it is damaged, or another program changed it"
_CUT = "it was cut short, or another program wrote to it"


class Arrays(Record):
    """Arrays by name, for what has no class of its own, such as a table in a cache."""

    values: Named
    """name -> array"""


# -- containers -------------------------------------------------------------------------------------------------------


def write(
    path: str | os.PathLike[str],
    parts: Mapping[str, Record],
    about: Mapping[str, Any] | None = None,
    *,
    derived: Mapping[str, codec.Derived] | None = None,
    compact: bool = False,
    force: bool = False,
) -> None:
    """Write records by name, and what they are ``about`` (strings and numbers), to ``path``.

    ``derived`` are numbers to store beside the records of those names, for other programs: :func:`read` does not read
    them. With ``compact`` the file is an npz archive.

    Raises
    ------
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    arrays = [array for record in parts.values() for array in codec.encode(record)[1].values()]
    size = sum(0.02 * array.nbytes if codec.compresses(array) else array.nbytes for array in arrays)
    with fresh_file(path, force=force, size=size) as part:
        # made in memory and written at once: HDF5 crashes the process when the disk fills up under it
        part.write_bytes(archive(parts, about or {}) if compact else _hdf5(parts, about or {}, derived or {}))


def read(path: str | os.PathLike[str], kinds: Mapping[str, type[Record]]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The records in a container whose names are among ``kinds``, and what they are about.

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or of another version.
    DamagedError
        What it holds is not what was written.
    """
    source = Path(path)
    if _begin(source).startswith(_ARCHIVE):
        return _read_archive(source, kinds)
    with opened(source) as file:
        about = {name: codec.scalar(value) for name, value in file.attrs.items() if not name.startswith("_")}
        records = {}
        for name, kind in kinds.items():
            if name in file:
                with _decoding(source, name):
                    records[name] = codec.read_group(file[name], kind)
    return records, about


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A container in the layout of NetCDF-4, verified and open for reading (an h5py file).

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or of another version.
    DamagedError
        What it holds is not what was written.
    """
    verified = is_intact(path)
    with _unverified(path) as file:
        if "chemage_format" not in file.attrs:
            raise StoreError(f"{path} is an HDF5 file, but not one of chemage's")
        version = codec.scalar(file.attrs.get("chemage", "of another version"))
        layout = int(codec.scalar(file.attrs["chemage_format"]))
        if layout > FORMAT:
            raise StoreError(f"{path} was written by chemage {version}; update chemage to read it")
        if layout < FORMAT:
            raise StoreError(f"{path} was written by chemage {version}; read it with chemage 0.2, and write it again")
        if not verified:
            raise DamagedError(f"{path} is damaged: its checksums are missing; {_CUT}")
        yield file


def is_ours(path: Path) -> bool:
    """Whether ``path`` is a file in the layout of NetCDF-4 that chemage wrote; a damaged HDF5 file is an error."""
    if _begin(path) != _HDF5:
        return False
    with open(path, "rb") as stream:
        if _end_of(stream)[1] is not None:
            return True
    with _unverified(path) as file:
        return "chemage_format" in file.attrs


def is_intact(path: Path) -> bool:
    """Whether a container carries a seal, which then fits; nothing of it is parsed.

    Raises
    ------
    DamagedError
        The seal does not fit; the message names the parts.
    StoreError
        The file cannot be read.
    """
    try:
        with open(path, "rb") as stream:
            return _is_checked(stream, path)
    except DamagedError:
        raise
    except OSError as error:
        raise _unreadable(path, error) from error


def _begin(path: Path) -> bytes:
    """The first bytes of a file."""
    try:
        with open(path, "rb") as stream:
            return stream.read(len(_HDF5))
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> StoreError:
    if isinstance(error, FileNotFoundError):
        return StoreError(f"{path} does not exist")
    return StoreError(f"{path} cannot be read: {error.strerror or error}")


@contextmanager
def _unverified(path: Path) -> Iterator[Any]:
    """An HDF5 file."""
    import h5py

    try:
        file = h5py.File(path, "r")
    except (OSError, KeyError) as error:
        kind = DamagedError if _begin(path) in (_HDF5, b"") else StoreError
        raise kind(f"{path} cannot be read: it is damaged or was cut short ({error})") from error
    with _decoding(path), file:
        yield file


@contextmanager
def _decoding(path: str | os.PathLike[str], part: str = "") -> Iterator[None]:
    """What cannot be read of a file, or of a part of it, is damage: libraries raise errors of many kinds."""
    try:
        yield
    except ChemageError as error:
        if not part:
            raise
        raise DamagedError(f"{path}: {part} is damaged: {error}") from error
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError, BadZipFile) as error:
        named = f"{path}: {part}" if part else path
        raise DamagedError(f"{named} is damaged: {' '.join(str(error).split())}") from error


# -- layouts ----------------------------------------------------------------------------------------------------------


def _hdf5(parts: Mapping[str, Record], about: Mapping[str, Any], derived: Mapping[str, codec.Derived]) -> memoryview:
    """A sealed container in the layout of NetCDF-4."""
    import h5netcdf
    import h5py

    from chemage.foundation.names import __version__

    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as hdf5, h5netcdf.File(hdf5, "w") as file:
        header = {"chemage": __version__, "chemage_format": FORMAT, "Conventions": "CF-1.8"}
        for name, value in {**header, **about}.items():
            file.attrs[name] = value
        ends = []
        for name, record in parts.items():
            codec.write_group(file.create_group(name), hdf5[name], record)
            if name in derived:
                codec.write_derived(hdf5[name], derived[name])
            file.flush()
            ends.append((name, image.getbuffer().nbytes))
    return seal(image, ends)


def archive(parts: Mapping[str, Record], about: Mapping[str, Any] | None = None) -> memoryview:
    """A sealed container as an npz archive; of an array that is mostly zeros, only what is not zero is kept."""
    entries: dict[str, np.ndarray] = {}
    texts: dict[str, Any] = {}
    for part, record in parts.items():
        values, arrays = codec.encode(record)
        sparse: dict[str, list[int]] = {}
        for name, array in arrays.items():
            where = np.flatnonzero(array)
            if 2 * where.size < array.size:
                sparse[name] = list(array.shape)
                entries[f"{part}/{name}:where"] = where.astype(np.int32) if array.size < 2**31 else where
                entries[f"{part}/{name}:values"] = array.ravel()[where]
            else:
                entries[f"{part}/{name}"] = array
        texts[part] = {"values": codec.exact(values), "sparse": sparse}
    text = json.dumps({"parts": texts, "about": codec.exact(about or {})}, default=codec.plain)
    image = io.BytesIO()
    np.savez(image, allow_pickle=False, record=np.frombuffer(text.encode(), dtype=np.uint8), **entries)
    return seal(image)


def _read_archive(path: Path, kinds: Mapping[str, type[Record]]) -> tuple[dict[str, Any], dict[str, Any]]:
    if not is_intact(path):
        raise DamagedError(f"{path} is damaged: its checksum is missing; {_CUT}")
    with _decoding(path), np.load(path, allow_pickle=False) as file:
        stored: dict[str, Any] = json.loads(bytes(file["record"]))
        if "parts" in stored:
            entries, prefix = dict(stored["parts"]), "{}/"
        else:  # chemage 0.2.0 kept one record, without a name
            entries, prefix = dict.fromkeys(kinds, stored), ""
        records = {}
        for name, kind in kinds.items():
            if name in entries:
                with _decoding(path, name):
                    arrays = _arrays_in(file, prefix.format(name), entries[name]["sparse"])
                    records[name] = codec.decode(kind, codec.inexact(entries[name]["values"]), arrays)
    return records, codec.inexact(stored.get("about", {}))


def _arrays_in(file: Any, prefix: str, sparse: Mapping[str, Sequence[int]]) -> dict[str, np.ndarray]:
    """The arrays of an archive whose names begin with ``prefix``; ``sparse``: the shapes of those with zeros."""
    arrays: dict[str, np.ndarray] = {}
    for name, shape in sparse.items():
        values = file[f"{prefix}{name}:values"]
        arrays[name] = np.zeros(tuple(shape), dtype=values.dtype)
        arrays[name].ravel()[file[f"{prefix}{name}:where"]] = values
    for name in file.files:
        if name.startswith(prefix) and name != "record" and ":" not in name:
            arrays[name.removeprefix(prefix)] = file[name]
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


# -- the seal ---------------------------------------------------------------------------------------------------------


def seal(content: io.BytesIO, parts: Sequence[tuple[str, int]] = ()) -> memoryview:
    """Add a seal to the end of ``content``, and return all of it.

    ``parts`` are the names of successive parts and where each ends; the last one reaches to the end of the content.
    """
    table = []
    with content.getbuffer() as inner:
        begin, names = 0, [name for name, _ in parts] or ["content"]
        for name, end in zip(names, [*(end for _, end in parts[:-1]), len(inner)], strict=True):
            with inner[begin:end] as part:
                table.append([name, end - begin, hashlib.sha256(part).hexdigest()])
            begin = end
    text = b"\n" + json.dumps(table).encode()
    content.seek(0, io.SEEK_END)
    content.write(text + b"\nchemage seal %08d %s\n" % (len(text), _sha256(text)))
    return content.getbuffer()


def _end_of(stream: IO[bytes]) -> tuple[int, re.Match[bytes] | None]:
    """Where the last line of a seal begins, and that line if there is one."""
    last = stream.seek(0, os.SEEK_END) - _END_LENGTH
    stream.seek(max(0, last))
    return last, _END.search(stream.read())


def _is_checked(stream: IO[bytes], path: Path) -> bool:
    """Whether a stream has a seal, which then fits."""
    last, end = _end_of(stream)
    if end is None:
        return False
    begin = last - int(end[1])
    stream.seek(max(0, begin))
    text = stream.read(last - max(0, begin))
    if begin < 0 or _sha256(text) != end[2]:
        raise DamagedError(f"{path}: its checksums are {_CHANGED}")
    stream.seek(0)
    table = json.loads(text)
    damaged = [name for name, length, stored in table if _sha256_of(stream, length) != stored]
    if not damaged and sum(length for _, length, _ in table) != begin:
        damaged = ["its end"]
    if damaged:
        raise DamagedError(f"{path}: {', '.join(damaged)} {'is' if len(damaged) == 1 else 'are'} {_CHANGED}")
    return True


def _sha256_of(stream: IO[bytes], length: int) -> str:
    """The checksum of the next ``length`` bytes."""
    digest = hashlib.sha256()
    while length > 0 and (piece := stream.read(min(length, 1 << 20))):
        digest.update(piece)
        length -= len(piece)
    return digest.hexdigest()


def _sha256(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode()


# -- JSON -------------------------------------------------------------------------------------------------------------


def sealed_json(content: Mapping[str, Any], **layout: Any) -> bytes:
    """A mapping as JSON with its checksum as the last field; ``layout`` are options of :func:`json.dumps`."""
    body = json.dumps(content, **layout).rstrip().removesuffix("}").rstrip().encode()
    return body + b', "sha256": "' + _sha256(body) + b'"}\n'


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The mapping that :func:`sealed_json` made into the content of a file, without its checksum.

    Raises
    ------
    StoreError
        It is a JSON object of another program, without a checksum.
    DamagedError
        The checksum is missing or does not fit.
    OSError
        The file is missing, or cannot be read.
    """
    text = Path(path).read_bytes()
    is_sealed = check_json(text, path)
    with _decoding(path):
        content = json.loads(text)
        if is_sealed:
            del content["sha256"]
        elif isinstance(content, dict) and not _TRACE.search(text):
            raise StoreError(f"{path} is no file of chemage: it has no checksum")
        else:
            raise ValueError(f"its checksum is missing; {_CUT}")
    return content


def check_json(text: bytes, path: str | os.PathLike[str]) -> bool:
    """Whether the text of a JSON file carries a checksum, which then fits; it is not parsed.

    Raises
    ------
    DamagedError
        It does not fit.
    """
    end = _FIELD.search(text, max(0, len(text) - 200))
    if end is not None and _sha256(text[: end.start()]) != end[1]:
        raise DamagedError(f"{path} is {_CHANGED}")
    return end is not None
