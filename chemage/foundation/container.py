"""The one container of what chemage keeps on disk, and its one seal, so that damage is an error and never a number.

A container holds records by name, and what they are about as plain values. It has the layout of NetCDF-4, in which any
HDF5 program opens it, or where chemage alone reads it (contacts of a study, tables in the cache folder) that of an npz
archive, in which a small, mostly empty map is written twenty times as fast into a tenth of the room. Either ends with a
seal: the SHA-256 of each of its parts, and of this list. Readers of HDF5 and zip ignore what follows their content;
chemage compares before it parses, because a damaged file can crash the library that reads it. A text for people is a
JSON object with the SHA-256 of what comes before in its last field.

A seal says that nothing was damaged, and not who wrote it. So no link, virtual dataset or external storage is followed
out of a container, and what it announces must fit into memory before any of it is read.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np

from chemage.foundation import codec
from chemage.foundation.aliases import AnyPath, Data, Fields
from chemage.foundation.errors import (
    ChemageError,
    DamagedError,
    StoreError,
    imported,
    shortened,
)
from chemage.foundation.files import (
    DEEPEST,
    LARGEST_DESCRIPTION,
    open_file,
    preflight,
    read_bytes,
    write_file,
)
from chemage.foundation.memory import capacity, readable
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
#: what a file below SMALL bytes may hold, which a stranger can make of zeros: bytes of data, and chunks of a dataset
SMALL, _UNPACKED, _CHUNKS = 1_000_000, 50_000_000, 20_000
#: members of the root among which groups of chemage are looked for, and datasets in one of its files
_MEMBERS, _DATASETS = 1000, 2000


class Arrays(Record):
    """Arrays by name, for what has no class of its own, such as a table in a cache."""

    values: Named
    """name -> array"""


# -- containers -------------------------------------------------------------------------------------------------------


def write(
    path: AnyPath,
    parts: Mapping[str, Record],
    about: Fields | None = None,
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
    preflight(path, force=force)
    # made in memory and written at once: HDF5 crashes the process when the disk fills up under it
    content = (
        archive(parts, about) if compact else _hdf5(parts, about, derived or {})
    )
    write_file(path, content, force=force)


def read(
    path: AnyPath,
    kinds: Mapping[str, type[Record] | str],
    *,
    links: bool = True,
) -> tuple[Data, Data]:
    """The records in a container whose names are among ``kinds`` (classes, or ``"module:Class"`` of those that are
    imported where a record is there), and what they are about.

    Without ``links``, a path that is one is refused.

    Raises
    ------
    StoreError
        The file is missing, not one of chemage's, or of another version.
    DamagedError
        What it holds is not what was written.
    """
    source = Path(path)
    with open_file(source, links=links) as stream:
        if stream.read(len(_ARCHIVE)) == _ARCHIVE:
            return _read_archive(stream, source, kinds)
        with _parsed(stream, source) as file, decoding(source):
            _check_ours(file, source)
            about = {
                name: codec.scalar(value)
                for name, value in file.attrs.items()
                if not name.startswith("_")
            }
            records = {}
            for name, kind in kinds.items():
                if name in file:
                    cls = _class(kind)
                    with decoding(source, name):
                        records[name] = codec.read_group(file[name], cls)
    return records, about


def _class(kind: type[Record] | str) -> type[Record]:
    return imported(kind) if isinstance(kind, str) else kind


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
    with hdf5(path) as file:
        with decoding(path):
            _check_ours(file, path)
        yield file


@contextmanager
def hdf5(path: AnyPath) -> Iterator[Any]:
    """An HDF5 file of any program, open for reading (an h5py file); one of chemage's is verified.

    Links in it, and datasets for which :func:`check_dataset` was not called, may lead to other files.

    Raises
    ------
    StoreError
        The file is missing, not in HDF5, or of another version of chemage.
    DamagedError
        What it holds is not what was written, or cannot be read.
    """
    with open_file(path) as stream, _parsed(stream, Path(path)) as file:
        yield file


def is_ours(path: Path) -> bool:
    """Whether ``path`` is a file in the layout of NetCDF-4 that chemage wrote; a damaged HDF5 file is an error."""
    with open_file(path) as stream:
        if stream.read(len(_HDF5)) != _HDF5:
            return False
        if _end_of(stream)[1] is not None:
            return True
        with _parsed(stream, path) as file:
            return _is_marked(file)


def is_intact(path: Path) -> bool:
    """Whether a container carries a seal, which then fits; nothing of it is parsed.

    Raises
    ------
    DamagedError
        The seal does not fit; the message names the parts.
    StoreError
        The file cannot be read.
    """
    with open_file(path) as stream:
        return _is_checked(stream, path)


@contextmanager
def _parsed(stream: IO[bytes], path: Path) -> Iterator[Any]:
    """An HDF5 file, of which a seal fits; one that chemage wrote has one."""
    import h5py

    verified = _is_checked(stream, path)
    stream.seek(0)
    begin = stream.read(len(_HDF5))
    try:
        file = h5py.File(stream, "r")
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        kind = DamagedError if begin in (_HDF5, b"") else StoreError
        raise kind(
            f"{path} cannot be read: it is not an HDF5 file, or is truncated or damaged ({error})"
        ) from error
    with file:
        with decoding(path):
            if not verified and _is_marked(file):
                _check_layout(file, path)
                raise DamagedError(
                    f"{path} is damaged: its checksums are missing; {_CUT}"
                )
        yield file


def _is_marked(file: Any) -> bool:
    """Whether anything in an HDF5 file says that chemage wrote it."""
    names = file if len(file) <= _MEMBERS else ()
    own = [
        file[name]
        for name in names
        if type(file.get(name, getlink=True)).__name__ == "HardLink"
    ]
    return any(
        name.startswith("chemage") for place in (file, *own) for name in place.attrs
    )


def _check_layout(file: Any, path: Path) -> None:
    version = codec.scalar(file.attrs.get("chemage", "of another version"))
    layout = int(codec.scalar(file.attrs.get("chemage_format", FORMAT)))
    if layout > FORMAT:
        raise StoreError(
            f"{path} was written by chemage {version}; update chemage to read it"
        )
    if layout < FORMAT:
        raise StoreError(
            f"{path} was written by chemage {version}; read it with chemage 0.2, and write it again"
        )


def _check_ours(file: Any, path: Path) -> None:
    """Refuse an HDF5 file that is no container, or that leads to other files."""
    if "chemage_format" not in file.attrs:
        raise StoreError(f"{path} is an HDF5 file, but not one of chemage's")
    _check_layout(file, path)
    datasets = list(islice(_datasets(file, path, set()), _DATASETS + 1))
    if len(datasets) > _DATASETS:
        raise DamagedError(
            f"{path} holds more than {_DATASETS} datasets, which chemage never writes"
        )
    size = sum(_size_of(dataset, path) for dataset in datasets)
    _check_size(size, str(path))


def _datasets(group: Any, path: Path, groups: set[int]) -> Iterator[Any]:
    """All datasets in a group and below it, by hard links alone; ``groups`` are those that were met."""
    import h5py

    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise DamagedError(
                f"{path}: {group.name.rstrip('/')}/{name} is a link, which chemage never writes"
            )
        item = group[name]
        if isinstance(item, h5py.Group):
            place = hash(item.id)
            if place in groups:
                raise DamagedError(
                    f"{path}: {item.name} contains itself, or is there twice"
                )
            if str(item.name).count("/") > DEEPEST:
                raise DamagedError(
                    f"{path}: {shortened(item.name)} is nested more than {DEEPEST} deep"
                )
            groups.add(place)
            yield from _datasets(item, path, groups)
        elif isinstance(item, h5py.Dataset):
            yield item


def check_dataset(dataset: Any, path: AnyPath) -> int:
    """The size in bytes of a dataset of an HDF5 file, which is within the file and fits into memory.

    Raises
    ------
    StoreError
        It does not, has its data in other files, or is too large for a file as small as this.
    """
    size = _size_of(dataset, path)
    numbers = 8 * dataset.size  # as which they are read
    check_unpacked(
        max(size, numbers), dataset.file.id.get_filesize(), f"{path}:{dataset.name}"
    )
    return size


def _size_of(dataset: Any, path: AnyPath) -> int:
    name = f"{path}:{dataset.name}"
    if dataset.external or dataset.is_virtual:
        raise StoreError(
            f"{name} keeps its data in other files, which are not read; copy the data into this file"
        )
    size = dataset.size * dataset.dtype.itemsize
    _check_size(size, name)
    stored = dataset.file.id.get_filesize()
    if dataset.chunks and stored < SMALL:
        chunks = math.prod(
            -(-side // part)
            for side, part in zip(dataset.shape, dataset.chunks, strict=True)
        )
        if chunks > _CHUNKS:
            raise StoreError(
                f"{name} is cut into {chunks} chunks in a file of {readable(stored)}; use larger chunks"
            )
    return size


def check_unpacked(size: float, stored: float, name: str) -> None:
    """Refuse ``size`` bytes of data where they do not fit into memory, or come out of a small file of ``stored`` bytes.

    Raises
    ------
    StoreError
        With both numbers.
    """
    if stored < SMALL and size > _UNPACKED:
        raise StoreError(
            f"{name} has {readable(size)} of data in a file of {readable(stored)}: files below {readable(SMALL)} may "
            f"hold {readable(_UNPACKED)}; save it without compression if it is meant"
        )
    _check_size(size, name)


def _check_size(size: float, name: str) -> None:
    if size > (there := capacity()):
        raise StoreError(
            f"{name} has {readable(size)} of data, but there are {readable(there)} of memory"
        )


@contextmanager
def decoding(path: AnyPath, part: str = "") -> Iterator[None]:
    """What cannot be read of a file, or of a part of it, is damage: libraries raise errors of all kinds."""
    try:
        yield
    except ChemageError as error:
        if not part:
            raise
        raise DamagedError(f"{path}: {part} is damaged: {error}") from error
    except Exception as error:
        named = f"{path}: {part}" if part else path
        raise DamagedError(
            f"{named} is damaged: {shortened(' '.join(str(error).split()), 200)}"
        ) from error


# -- layouts ----------------------------------------------------------------------------------------------------------


def _hdf5(
    parts: Mapping[str, Record],
    about: Fields | None,
    derived: Mapping[str, codec.Derived],
) -> memoryview:
    """A sealed container in the layout of NetCDF-4."""
    import h5netcdf
    import h5py

    from chemage.foundation.names import __version__

    image = io.BytesIO()
    with (
        h5py.File(image, "w", track_order=True) as hdf5,
        h5netcdf.File(hdf5, "w") as file,
    ):
        header = {
            "chemage": __version__,
            "chemage_format": FORMAT,
            "Conventions": "CF-1.8",
        }
        for name, value in {**header, **(about or {})}.items():
            file.attrs[name] = value
        ends = []
        for name, record in parts.items():
            codec.write_group(file.create_group(name), hdf5[name], record)
            if name in derived:
                codec.write_derived(hdf5[name], derived[name])
            file.flush()
            ends.append((name, image.getbuffer().nbytes))
    return seal(image, ends)


def archive(parts: Mapping[str, Record], about: Fields | None = None) -> memoryview:
    """A sealed container as an npz archive; of an array that is mostly zeros, only what is not zero is kept."""
    entries: dict[str, np.ndarray] = {}
    texts: Data = {}
    for part, record in parts.items():
        values, arrays = codec.encode(record)
        sparse: dict[str, list[int]] = {}
        for name, array in arrays.items():
            where = np.flatnonzero(array)
            if 2 * where.size < array.size:
                sparse[name] = list(array.shape)
                entries[f"{part}/{name}:where"] = (
                    where.astype(np.int32) if array.size < 2**31 else where
                )
                entries[f"{part}/{name}:values"] = array.ravel()[where]
            else:
                entries[f"{part}/{name}"] = array
        texts[part] = {"values": codec.exact(values), "sparse": sparse}
    text = json.dumps(
        {"parts": texts, "about": codec.exact(about or {})}, default=codec.plain
    )
    image, record = io.BytesIO(), np.frombuffer(text.encode(), dtype=np.uint8)
    np.savez(image, allow_pickle=False, record=record, **entries)
    return seal(image)


def _read_archive(
    stream: IO[bytes], path: Path, kinds: Mapping[str, type[Record] | str]
) -> tuple[Data, Data]:
    if not _is_checked(stream, path):
        raise DamagedError(f"{path} is damaged: its checksum is missing; {_CUT}")
    with decoding(path), ZipFile(stream) as file:
        lengths = {
            info.filename.removesuffix(".npy"): info.file_size
            for info in file.infolist()
        }
        _check_size(sum(lengths.values()), str(path))

        def array(name: str) -> np.ndarray:
            with file.open(f"{name}.npy") as member:
                return read_array(member, lengths[name])

        stored: Data = json.loads(bytes(array("record")))
        if "parts" in stored:
            entries, prefix = dict(stored["parts"]), "{}/"
        else:  # chemage 0.2.0 kept one record, without a name
            entries, prefix = dict.fromkeys(kinds, stored), ""
        records = {}
        for name, kind in kinds.items():
            if name in entries:
                cls = _class(kind)
                entry = entries[name]
                with decoding(path, name):
                    own = prefix.format(name)
                    arrays = _arrays_in(array, list(lengths), own, entry["sparse"])
                    values = codec.inexact(entry["values"])
                    records[name] = codec.decode(cls, values, arrays)
    return records, codec.inexact(stored.get("about", {}))


def _arrays_in(
    array: Callable[[str], np.ndarray],
    names: Sequence[str],
    prefix: str,
    sparse: Mapping[str, Sequence[int]],
) -> dict[str, np.ndarray]:
    """The arrays of an archive whose names begin with ``prefix``; ``sparse``: the shapes of those with zeros."""
    arrays: dict[str, np.ndarray] = {}
    for name, shape in sparse.items():
        values = array(f"{prefix}{name}:values")
        _check_size(math.prod(shape) * values.itemsize, f"{prefix}{name}")
        arrays[name] = np.zeros(tuple(shape), dtype=values.dtype)
        arrays[name].ravel()[array(f"{prefix}{name}:where")] = values
    for name in names:
        if name.startswith(prefix) and name != "record" and ":" not in name:
            arrays[name.removeprefix(prefix)] = array(name)
    for values in arrays.values():
        values.setflags(write=False)
    return arrays


def read_array(stream: IO[bytes], length: int) -> np.ndarray:
    """An array in the format of ``numpy.save`` from a stream of ``length`` bytes, as it was written.

    Raises
    ------
    ValueError
        The stream holds objects, less than its header announces, or something else.
    """
    version = np.lib.format.read_magic(stream)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read(stream)
    # a short file may announce an array that does not fit into any memory
    if math.prod(int(side) for side in shape) * dtype.itemsize > length:
        raise ValueError("it holds less than it announces")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


# -- the seal ---------------------------------------------------------------------------------------------------------


def seal(
    content: io.BytesIO, parts: Sequence[tuple[str, int]] = (("content", 0),)
) -> memoryview:
    """Add a seal to the end of ``content``, and return all of it.

    ``parts`` are the names of successive parts and where each ends; the last one reaches to the end of the content.
    """
    table, begin = [], 0
    *before, (last, _) = parts
    with content.getbuffer() as inner:
        for name, end in [*before, (last, len(inner))]:
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
    damaged = [
        name
        for name, length, stored in table
        if _sha256_of(stream, length) != stored
    ]
    if not damaged and sum(length for _, length, _ in table) != begin:
        damaged = ["its end"]
    if damaged:
        raise DamagedError(
            f"{path}: {', '.join(damaged)} {'is' if len(damaged) == 1 else 'are'} {_CHANGED}"
        )
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


def sealed_json(content: Fields, **layout: Any) -> bytes:
    """A mapping as JSON with its checksum as the last field; ``layout`` are options of :func:`json.dumps`."""
    body = (
        json.dumps(content, **layout).rstrip().removesuffix("}").rstrip().encode()
    )
    return body + b', "sha256": "' + _sha256(body) + b'"}\n'


def read_json(path: AnyPath, *, links: bool = True) -> Data:
    """The mapping that :func:`sealed_json` made into the content of a file, without its checksum.

    Without ``links``, a path that is one is refused.

    Raises
    ------
    StoreError
        The file is missing, cannot be read, or is a JSON object of another program, without a checksum.
    DamagedError
        The checksum is missing or does not fit.
    """
    text = read_bytes(path, LARGEST_DESCRIPTION, links=links)
    is_sealed = check_json(text, path)
    with decoding(path):
        content = json.loads(text)
        if is_sealed:
            del content["sha256"]
        elif isinstance(content, dict) and not _TRACE.search(text):
            raise StoreError(f"{path} is no file of chemage: it has no checksum")
        else:
            raise ValueError(f"its checksum is missing; {_CUT}")
    return content


def check_json(text: bytes, path: AnyPath) -> bool:
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
