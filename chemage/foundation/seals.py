"""Checksums of stored files, so that damage on disk is an error and never a number.

A binary file ends with a seal: the SHA-256 of each of its parts, and of this list. HDF5 and zip readers ignore what
follows their own content, so that any program opens a sealed file; chemage compares before it parses, because a damaged
file can crash the library that reads it. A JSON file holds the SHA-256 of what comes before in its last field.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from chemage.foundation.errors import DamagedError

#: what ends a sealed file: length and SHA-256 of the list of parts
_END = re.compile(rb"\nchemage seal (\d{8}) ([0-9a-f]{64})\n\Z")
_END_LENGTH = len("\nchemage seal \n") + 8 + 1 + 64
_FIELD = re.compile(rb',\s*"sha256": "([0-9a-f]{64})"\s*\}\s*\Z')
_CHANGED = "not what chemage wrote: it is damaged, or another program changed it"


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


def check_seal(path: Path) -> bool:
    """Whether the file carries a seal, which then fits its content.

    Raises
    ------
    DamagedError
        It does not fit; the message names the parts.
    OSError
        The file cannot be read.
    """
    with open(path, "rb") as stream:
        return _checked(stream, path) is not None


def unsealed(content: bytes | memoryview, path: Path) -> memoryview | None:
    """The content of a sealed file that was read whole, without its seal; None if it has none.

    Raises
    ------
    DamagedError
        The seal does not fit.
    """
    stream = io.BytesIO(content)
    begin = _checked(stream, path)
    return None if begin is None else memoryview(content)[:begin]


def has_seal(path: Path) -> bool:
    """Whether the file carries a seal, which may not fit."""
    try:
        with open(path, "rb") as stream:
            return _end_of(stream)[1] is not None
    except OSError:
        return False


def _end_of(stream: IO[bytes]) -> tuple[int, re.Match[bytes] | None]:
    """Where the last line of a seal begins, and that line if there is one."""
    last = stream.seek(0, os.SEEK_END) - _END_LENGTH
    stream.seek(max(0, last))
    return last, _END.search(stream.read())


def _checked(stream: IO[bytes], path: Path) -> int | None:
    """Compare a stream with its seal: where the content ends, None without a seal."""
    last, end = _end_of(stream)
    if end is None:
        return None
    begin = last - int(end[1])
    stream.seek(max(0, begin))
    text = stream.read(last - max(0, begin))
    if begin < 0 or _sha256(text) != end[2]:
        raise DamagedError(f"{path}: its checksums are {_CHANGED}")
    stream.seek(0)
    _compare(stream, json.loads(text), begin, path)
    return begin


def _compare(stream: IO[bytes], table: Sequence[tuple[str, int, str]], size: int, path: Path) -> None:
    """Compare the parts of a stream, ``size`` bytes together, with the list of the seal."""
    damaged = []
    for name, length, stored in table:
        found, left = hashlib.sha256(), length
        while left > 0 and (piece := stream.read(min(left, 1 << 20))):
            found.update(piece)
            left -= len(piece)
        if found.hexdigest() != stored:
            damaged.append(name)
    if not damaged and sum(length for _, length, _ in table) != size:
        damaged = ["its end"]
    if damaged:
        raise DamagedError(f"{path}: {', '.join(damaged)} {'is' if len(damaged) == 1 else 'are'} {_CHANGED}")


def _sha256(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode()


def to_sealed_json(content: Mapping[str, Any], **layout: Any) -> bytes:
    """A mapping as JSON with its checksum as the last field; ``layout`` are options of :func:`json.dumps`."""
    body = json.dumps(content, **layout).rstrip().removesuffix("}").rstrip().encode()
    return body + b', "sha256": "' + _sha256(body) + b'"}\n'


def from_sealed_json(text: bytes, path: Path) -> tuple[dict[str, Any], bool]:
    """The mapping in a JSON file, without its checksum, and whether it had one.

    Raises
    ------
    DamagedError
        The checksum does not fit, or the text is no JSON object.
    """
    is_sealed = check_json_seal(text, path)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DamagedError(f"{path} is damaged: {error}") from None
    if not isinstance(content, dict):
        raise DamagedError(f"{path} is damaged: it holds no JSON object")
    if is_sealed:
        del content["sha256"]
    return content, is_sealed


def check_json_seal(text: bytes, path: Path) -> bool:
    """Whether a JSON file carries a checksum, which then fits; the file is not parsed.

    Raises
    ------
    DamagedError
        It does not fit.
    """
    end = _FIELD.search(text, max(0, len(text) - 200))
    if end is not None and _sha256(text[: end.start()]) != end[1]:
        raise DamagedError(f"{path} is {_CHANGED}")
    return end is not None
