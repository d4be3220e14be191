"""Records: frozen, validated objects of arrays and numbers, the base of everything that passes from stage to stage.

Arrays are C-contiguous and read-only, mappings and lists are read-only at any depth; records are equal when their
content is. ``todict``/``fromdict`` work as in ASE. Each array declares its dimensions, unit and meaning in ``arrays``;
the store and the documentation are made from that.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import zlib
from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache
from textwrap import indent
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.checks import Frozen, is_boolean, meanings
from chemage.foundation.errors import InputError, UnitError, shortened
from chemage.foundation.files import FileStamp, open_file
from chemage.foundation.memory import require
from chemage.foundation.text import html_table
from chemage.foundation.units import array_in, carried, in_range


def merged_approximations(*lists: Any) -> list[Data]:
    """Join lists of approximations, each entry once; what is no mapping with a ``kind`` is left out."""
    entries: list[Data] = []
    for candidates in lists:
        if not isinstance(candidates, Iterable) or isinstance(
            candidates, str | Mapping
        ):
            continue
        for entry in candidates:
            if (
                isinstance(entry, Mapping)
                and isinstance(entry.get("kind"), str)
                and dict(entry) not in entries
            ):
                entries.append(dict(entry))
    return entries


def merged_changes(*changes: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    """Join what plugins answered or changed, see :attr:`Record.changes`."""
    return {
        name: sorted({what for each in changes for what in each.get(name, ())})
        for name in dict.fromkeys(name for each in changes for name in each)
    }


def approximation_made_by(component: Any) -> list[Data]:
    """The approximation that a component, or every component of a class, makes; empty if it is exact."""
    if component.exact:
        return []
    entry: Data = {"role": component.role, "kind": component.qualified_kind()}
    if component.declared_error is not None:
        entry |= {
            "declared_error": float(component.declared_error),
            "of": component.error_of,
        }
    return [entry]


def content_hash(content: Any) -> str:
    """128 bits as 32 hexadecimal digits; the order of the entries of a dict does not count."""
    try:
        return text_hash(json.dumps(content, sort_keys=True))
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError.of(
            "content", content, f"is not made of plain JSON values ({error})"
        ) from None


def checksum(content: Any, before: int = 0) -> int:
    """CRC-32 of bytes, or of those of a contiguous array, after others: a quarter of a second for each 10⁹ bytes, to see
    changes by."""
    return zlib.crc32(content, before)


def text_hash(text: str, size: int = 16) -> str:
    """``size`` bytes as hexadecimal digits."""
    return hashlib.blake2b(text.encode(), digest_size=size).hexdigest()


@lru_cache(maxsize=64)
def file_hash(path: str, stamp: FileStamp) -> str:
    """128 bits of the content of a file as hexadecimal digits; it is read once as long as its ``stamp`` stays.

    Raises
    ------
    StoreError
        The file cannot be read.
    """
    with open_file(path) as file:
        return hashlib.file_digest(
            file, lambda: hashlib.blake2b(digest_size=16)
        ).hexdigest()


def frozen(array: Any, *dtypes: type[np.generic]) -> np.ndarray:
    """``array`` C-contiguous and read-only, of the first of ``dtypes`` unless it already has one of them.

    An array that is read-only already is taken as it is, without a copy: a maker that hands over its own fresh array
    calls ``array.setflags(write=False)`` first and saves the copy.
    """
    values = array_in(array)
    if values.size > _LARGE:  # a view may repeat one number
        require(
            8.0 * values.size,
            f"an array of shape {values.shape}",
            "give a smaller one",
        )
    if values.dtype.kind not in "fiubc":
        raise ValueError(f"expected numbers, not {_kind(values)}")
    if dtypes and values.dtype not in dtypes:
        target = np.dtype(dtypes[0])
        mixed = values.size and (
            values.dtype.kind == "c"
            or (values.dtype.kind == "b") != (target.kind == "b")
        )
        if mixed and not (target.kind == "b" and _is_zero_or_one(values)):
            raise ValueError(f"expected {_KINDS[target.kind]}, not {_kind(values)}")
        if target.kind in "iu" and values.dtype.kind == "f" and values.size:
            raise ValueError(f"expected whole numbers, not {values.dtype}")
        if target.kind == "i" and values.dtype.kind in "iu" and values.size:
            limits = np.iinfo(target.name)
            if int(values.min()) < limits.min or int(values.max()) > limits.max:
                raise ValueError(
                    f"values from {values.min()} to {values.max()} do not fit {target}"
                )
        with np.errstate(over="ignore"):
            values = values.astype(target)
        values.setflags(write=False)
    if values.dtype.kind == "b" and not is_boolean(np.ascontiguousarray(values)):
        raise ValueError(
            "bytes other than 0 and 1 in an array of bool; make it with values != 0"
        )
    if not (
        values.flags.c_contiguous and values.flags.aligned and values.dtype.isnative
    ) or _can_change(values):
        values = np.array(
            values, values.dtype.newbyteorder("="), order="C", copy=True
        )
        values.setflags(write=False)
    return values


def _refuse(self: Any, *arguments: Any, **options: Any) -> Any:
    raise TypeError(
        "a result is read-only; change a copy: dict(...) of a mapping, model_copy(update=...) of a record"
    )


class ReadOnlyDict(dict[Any, Any]):
    """A mapping in a result; a copy of it can be changed."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


class ReadOnlyList(list[Any]):
    """A list in a result; a copy of it can be changed."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return list, (list(self),)


#: types of what cannot be changed
_CONSTANT = str, int, float, bool, type(None)


def read_only(value: Any) -> Any:
    """``value`` with its mappings, lists and arrays read-only, at any depth."""
    if isinstance(value, ReadOnlyDict | ReadOnlyList):
        return value
    if isinstance(value, Mapping):
        inner = dict(value)
        for name, one in inner.items():
            if type(one) not in _CONSTANT:
                inner[name] = read_only(one)
        return ReadOnlyDict(inner)
    if type(value) in (list, tuple):
        return (ReadOnlyList if type(value) is list else tuple)(
            map(read_only, value)
        )
    if type(value) is np.ndarray and _can_change(value):
        value = value.copy()
        value.setflags(write=False)
    return value


#: numbers of an array that is checked against the memory
_LARGE = 1 << 27
_KINDS = {
    "f": "numbers",
    "i": "whole numbers",
    "u": "whole numbers",
    "b": "True or False",
}


def _is_zero_or_one(values: np.ndarray) -> bool:
    return (
        values.dtype.kind in "iu"
        and int(values.min()) >= 0
        and int(values.max()) <= 1
    )


def _kind(values: np.ndarray) -> str:
    return "True or False" if values.dtype.kind == "b" else str(values.dtype)


def _can_change(array: np.ndarray) -> bool:
    """Whether somebody else could still write to the memory of an array, by itself or by what it is a view of."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return True
        owner = owner.base
    return False


def _array(*dtypes: type[np.generic]) -> BeforeValidator:
    return BeforeValidator(lambda value: frozen(value, *dtypes))


Reals = Annotated[np.ndarray, _array(np.float64, np.float32)]
Doubles = Annotated[np.ndarray, _array(np.float64)]
Indices = Annotated[np.ndarray, _array(np.int64)]
#: whole numbers, or estimates of them
Counts = Annotated[np.ndarray, _array(np.int64, np.float64)]
Shorts = Annotated[np.ndarray, _array(np.int32)]
Flags = Annotated[np.ndarray, _array(np.bool_)]
Named = Annotated[
    dict[str, np.ndarray],
    AfterValidator(lambda value: {n: frozen(a) for n, a in value.items()}),
]


def _plain(value: Data) -> Data:
    try:
        json.dumps(value, default=str)
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"expected plain JSON values ({error})") from None
    return value


#: a dictionary of plain JSON values
Plain = Annotated[Data, AfterValidator(_plain)]
#: a quantity in a record: what is zero or a number that computations can hold
_Ranged = AfterValidator(lambda value: in_range(value, ""))
Number = Annotated[float, Field(ge=0, allow_inf_nan=False), _Ranged]
SignedNumber = Annotated[float, Field(allow_inf_nan=False), _Ranged]
PositiveNumber = Annotated[float, Field(gt=0, allow_inf_nan=False), _Ranged]


class _Documented(type(Frozen)):
    """Of records, whose fields are read from the source when somebody asks for the docstring."""

    @property
    def __doc__(cls) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """That of the class, with its fields below it."""
        lines = [inspect.cleandoc(vars(cls).get("__doc__") or ""), ""]
        lines += ["Attributes", "----------"]
        for name, meaning in meanings(cls).items():  # pyright: ignore[reportArgumentType]
            lines += [name, indent(meaning, "    ")]
        return "\n".join(lines)


class Record(Frozen, metaclass=_Documented):
    """Base of the frozen objects."""

    model_config = ConfigDict(
        validate_default=False, arbitrary_types_allowed=True, allow_inf_nan=True
    )
    #: field name -> (dimension names, unit, meaning)
    arrays: ClassVar[dict[str, tuple[tuple[str, ...], str, str]]] = {}
    #: fields whose arrays have another name in files, that of their dimension
    stored_names: ClassVar[dict[str, str]] = {}
    #: fields that records stored earlier do not have: where empty, no part of the digest, nor of the file
    added: ClassVar[tuple[str, ...]] = ()

    def __init__(self, **fields: Any) -> None:
        for name, (_, unit, _) in self.arrays.items():
            if name in fields and carried(fields[name]) is not None:
                try:
                    fields[name] = array_in(fields[name], unit)
                except UnitError as error:
                    raise UnitError(
                        f"{type(self).__name__}: {name}: {error}"
                    ) from None
        super().__init__(**fields)
        for name, value in vars(self).items():
            if type(value) not in _CONSTANT:
                vars(self)[name] = read_only(value)

    def todict(self) -> Data:
        """Field name -> value; arrays stay arrays."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    @classmethod
    def fromdict(cls, fields: Fields) -> Self:
        """The inverse of :meth:`todict`."""
        return cls(**fields)

    def coordinates(self) -> dict[str, np.ndarray]:
        """Coordinates of the dimensions of ``arrays`` where they have some: name -> values in nm."""
        return {}

    @cached_property
    def _digest(self) -> str:
        digest = hashlib.blake2b(type(self).__name__.encode(), digest_size=16)

        def feed(value: Any) -> None:
            if isinstance(value, np.ndarray):
                digest.update(f"{value.dtype.str}{value.shape}".encode())
                digest.update(np.ascontiguousarray(value).data)
            elif isinstance(value, Mapping):
                digest.update(b"{")
                for name in sorted(value):
                    digest.update(json.dumps(name).encode() + b":")
                    feed(value[name])
                digest.update(b"}")
            else:
                digest.update(
                    json.dumps(value, default=str, sort_keys=True).encode()
                )

        feed(
            {
                name: value
                for name, value in self.todict().items()
                if not self.is_left_out(name, value)
            }
        )
        return digest.hexdigest()

    def declared(self, name: str) -> tuple[tuple[str, ...], str, str] | None:
        """Dimensions, unit and meaning of an array, or of ``field/name`` among named arrays; None: not declared."""
        return self.arrays.get(name)

    def is_left_out(self, name: str, value: Any) -> bool:
        """Whether a field is one of :attr:`added` and empty."""
        return name in self.added and (
            value is None or (isinstance(value, Mapping | str) and not value)
        )

    def digest(self) -> str:
        """Content hash over every field, arrays included."""
        return self._digest

    def __reduce__(self) -> tuple[Any, ...]:
        # built anew, so that the arrays of the copy are read-only as well (pickle drops that flag)
        return type(self).fromdict, (self.todict(),)

    def model_copy(
        self, *, update: Fields | None = None, deep: bool = False
    ) -> Self:
        """A copy with some fields changed, validated again (pydantic's own would keep the digest of the original)."""
        return type(self).fromdict({**self.todict(), **(update or {})})

    @property
    def plugins(self) -> dict[str, str]:
        """The plugins that answered or changed a stage on the way to this record: name -> distribution and version."""
        return getattr(self, "provenance", {}).get("plugins", {})

    @property
    def changes(self) -> dict[str, list[str]]:
        """What each of these plugins answered or changed: name -> ``hook``, where it answered, or ``hook.field``."""
        return getattr(self, "provenance", {}).get("changes", {})

    @property
    def approximate(self) -> list[Data]:
        """The approximations on the way to this record, as in :mod:`chemage.foundation.records`."""
        return merged_approximations(
            getattr(self, "provenance", {}).get("approximate")
        )

    def noting(
        self,
        plugins: Mapping[str, str],
        approximate: Iterable[Fields] = (),
        kept: Fields | None = None,
        changes: Mapping[str, Iterable[str]] | None = None,
    ) -> Self:
        """This record, with the plugins that took part in it (name -> version) and what they answered or changed, and the
        approximations on the way to it, added to its ``provenance``; and with the fields ``kept``, see
        :func:`chemage.foundation.outputs.kept`."""
        before: Data = getattr(self, "provenance", {})
        provenance = dict(before)
        if plugins:
            provenance["plugins"] = {**self.plugins, **plugins}
        if changes:
            provenance["changes"] = merged_changes(self.changes, changes)
        if entries := merged_approximations(before.get("approximate"), approximate):
            provenance["approximate"] = entries
        update = dict(kept or {})
        if provenance != before:
            update["provenance"] = provenance
        return self.model_copy(update=update) if update else self

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        return self

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.digest() == self.digest()  # pyright: ignore[reportAttributeAccessIssue]

    def __hash__(self) -> int:
        return hash(self.digest())

    def _repr_html_(self) -> str:
        rows, texts = [], meanings(type(self))
        for name, value in self.todict().items():
            unit, meaning = (
                self.arrays[name][1:] if name in self.arrays else ("", "")
            )
            shown = (
                f"{value.dtype} {value.shape}"
                if isinstance(value, np.ndarray)
                else shortened(value)
            )
            rows.append((name, shown, unit, meaning or texts.get(name, "")))
        return html_table(repr(self), rows)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.digest()[:8]}>"

    __str__ = __repr__


def require_finite(name: str, values: np.ndarray, remedy: str) -> None:
    bad = int(values.size - np.count_nonzero(np.isfinite(values)))
    if bad:
        raise ValueError(
            f"{name}: {bad} of {values.size} values are not finite; {remedy}"
        )
