"""What plugins are given and what they answer, compared by content: also what is changed in place is seen.

A checksum (CRC-32) of each field, 4 GB/s on one core of the machine of reference, is taken before and after the code of
a plugin runs; nothing is where no plugin implements the hook.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from chemage.foundation.errors import InputError, PluginError
from chemage.foundation.outputs import recorded
from chemage.foundation.records import Record, checksum

#: path of a field -> checksum
Contents = dict[str, int]
#: in a path, before what a record derives from its fields and keeps
_DERIVED = "\0"


def contents(
    value: Any, before: Contents | None = None, path: str = ""
) -> Contents:
    """The checksum of each field in ``value``, at any depth.

    What a record has derived from its fields since the contents ``before`` is forgotten, so that it is derived anew by
    who can be trusted.
    """
    return dict(_parts(value, path, before))


def _parts(
    value: Any, path: str, before: Contents | None
) -> Iterator[tuple[str, int]]:
    text = type(value).__qualname__
    inner: Iterable[tuple[str, Any]] = ()
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        text = f"{data.dtype} {value.shape}"
        if data.dtype.hasobject:
            inner = [("", data.tolist())]
        else:
            data = data.reshape(-1).view(np.uint8)
            yield path, checksum(data.data, checksum(text.encode()))
            return
    elif isinstance(value, Record):
        fields = type(value).model_fields
        for name in vars(value).keys() - fields.keys():
            if before is not None and f"{path}{_DERIVED}{name}" not in before:
                vars(value).pop(name, None)
        inner = [
            (f"{'.' if name in fields else _DERIVED}{name}", one)
            for name, one in [*vars(value).items()]
        ]
    elif isinstance(value, BaseModel):
        inner = [
            (f".{name}", getattr(value, name)) for name in type(value).model_fields
        ]
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        inner = [
            (f".{each.name}", getattr(value, each.name))
            for each in dataclasses.fields(value)
        ]
    elif isinstance(value, Mapping):
        inner = [(f"[{name!r}]", one) for name, one in value.items()]
    elif isinstance(value, list | tuple):
        inner = [(f"[{at}]", one) for at, one in enumerate(value)]
    elif isinstance(value, np.random.SeedSequence):
        text = f"{value.state}"
    else:
        text += repr(value)
    yield path, checksum(text.encode())
    for name, one in inner:
        yield from _parts(one, path + name, before)


def differences(before: Contents, after: Contents) -> list[str]:
    """The paths at which two contents differ, the deepest first; what one of them alone has derived does not count."""
    return [
        re.sub(r"^\['(\w+)'\]", r"\1", path.replace(_DERIVED, "."))
        for path in sorted({**before, **after}, key=len, reverse=True)
        if before.get(path) != after.get(path)
        and (_DERIVED not in path or (path in before and path in after))
    ]


def state(answer: Any, before: Contents | None = None) -> Contents:
    """The contents of an answer, and of what is recorded beside it in this thread."""
    return contents([answer, recorded()], before)


def changed_fields(before: Contents, after: Contents) -> list[str]:
    """The fields in which two such states differ, sorted; "" for an answer that has none."""
    found = (re.search(r"[^\W\d]\w*", path) for path in differences(before, after))
    return sorted({match[0] if match else "" for match in found})


def rebuilt(value: Any, who: str) -> Any:
    """What was changed in place, validated again and with nothing derived from what it was before."""
    if not isinstance(value, Record):
        return value
    try:
        return type(value).fromdict(value.todict())
    except InputError as error:
        raise PluginError(f"{who} changed it in place: {error}") from error
