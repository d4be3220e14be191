"""What is checked before anything that came from outside is read: kind and size of files, depth and size of data.

Files may come from strangers: a pipe would block for ever, a device never end, and a short file can hold data whose
depth ends the interpreter. See docs/security.md.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from chemage.foundation.errors import InputError, StoreError, shortened
from chemage.foundation.memory import capacity, readable

#: tables inside tables, lists inside lists
DEEPEST = 32
#: characters of one text, and of a number written out
LONGEST_TEXT = 1_000_000
#: whole numbers beyond this many bits are neither counts nor seeds
MOST_BITS = 256
#: bytes of a file that describes something: a scene, a cluster, the manifest of a sweep
LARGEST_DESCRIPTION = 1 << 30


def regular_file(path: str | os.PathLike[str], most: float | None = None) -> os.stat_result:
    """Check that ``path`` is an ordinary file, of at most ``most`` bytes (default: what fits into memory).

    Raises
    ------
    StoreError
        It is missing, a folder, a pipe, a device or a loop of links, or larger than that.
    """
    shown = shortened(os.fspath(path), 300)
    try:
        found = os.stat(path)
    except OSError as error:
        raise StoreError(f"{shown}: {error.strerror or error}") from None
    except (ValueError, TypeError):  # a null byte in the name
        raise StoreError(f"{shown!r} is no name of a file") from None
    if stat.S_ISDIR(found.st_mode):
        raise StoreError(f"{shown}: Is a directory; name a file")
    if not stat.S_ISREG(found.st_mode):
        raise StoreError(f"{shown} is a device or a pipe; name an ordinary file")
    limit = most if most is not None else capacity()
    if limit is not None and found.st_size > limit:
        raise StoreError(f"{shown} has {readable(found.st_size)}, more than the {readable(limit)} that can be read")
    return found


def described(path: Path) -> str:
    """The text of a file that describes something, UTF-8 with or without a byte order mark.

    Raises
    ------
    StoreError
        It is no ordinary file, too large, or not text.
    """
    regular_file(path, LARGEST_DESCRIPTION)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise StoreError(f"{path} is not a text file") from None
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from None


def json_in(path: Path) -> Any:
    """The JSON data in a file.

    Raises
    ------
    StoreError
        It is no ordinary file, too large, not JSON, or nested too deeply.
    """
    text = described(path)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise StoreError(f"{path} cannot be read: {reason}") from None


def check_data(data: Any) -> None:
    """Check the size of parsed TOML or JSON data: depth, length of texts, size of whole numbers.

    Raises
    ------
    InputError
        Naming the path of what is too deep, too long or too large.
    """
    for path, item in _walk(data):
        if isinstance(item, int) and item.bit_length() > MOST_BITS:
            raise InputError("", [(path, f"a whole number of more than {MOST_BITS} bits; give a smaller one")])
        if isinstance(item, str) and len(item) > LONGEST_TEXT:
            raise InputError("", [(path, f"a text of {len(item)} characters; give at most {LONGEST_TEXT}")])


def _walk(data: Any) -> Iterator[tuple[str, Any]]:
    left: list[tuple[str, Any, int]] = [("", data, 0)]
    while left:
        path, item, depth = left.pop()
        if depth > DEEPEST:
            raise InputError("", [(shortened(path), f"is nested more than {DEEPEST} deep; write it flatter")])
        yield path, item
        if isinstance(item, dict):
            if not all(isinstance(name, str) for name in item):
                raise InputError("", [(shortened(path), "has names that are no texts")])
            left += [(f"{path}.{name}".lstrip("."), part, depth + 1) for name, part in item.items()]
        elif isinstance(item, list):
            # numbers are by far the most frequent, and only large ones matter
            left += [
                (f"{path}.{number}", part, depth + 1)
                for number, part in enumerate(item)
                if not isinstance(part, float) and not (type(part) is int and abs(part) < 2**63)
            ]
