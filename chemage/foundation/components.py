"""Components: everything that can be exchanged is one frozen class.

Its fields are its options, ``kind`` is its name in a scene, one method does the work. A role is an abstract subclass of
:class:`Component`; a plugin subclasses a role, gives it a ``kind`` and declares its options as pydantic fields with
units from :mod:`chemage.foundation.units`. A method never changes its meaning; arguments are only ever added.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

from pydantic import (
    SerializationInfo,
    SerializerFunctionWrapHandler,
    model_serializer,
)

from chemage.foundation import names, ownership
from chemage.foundation.aliases import Data, Fields
from chemage.foundation.checks import Frozen, is_table, meanings
from chemage.foundation.errors import ChemageError, InputError, PluginError
from chemage.foundation.outputs import Output, record_by
from chemage.foundation.ownership import Owned, name_owner
from chemage.foundation.records import content_hash
from chemage.foundation.text import html_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_IDENTITY = {"chemage": "identity"}


class Component(Owned, Frozen):
    """Frozen, validated options of one component. Equal options mean equal objects and equal :meth:`digest`."""

    role: ClassVar[str] = ""
    #: the name that selects this component in a scene
    kind: ClassVar[str] = ""
    #: what to cite when a result used this component
    cite: ClassVar[tuple[str, ...]] = ()
    #: the BibTeX entries of :attr:`cite`, in the same order, "" where there is none; () for none at all
    bibtex: ClassVar[tuple[str, ...]] = ()
    #: options that change how fast an answer comes and never the answer, such as a number of threads: no part of
    #: :meth:`digest`, nor of the keys by which a sweep knows what it has computed
    speed_only: ClassVar[tuple[str, ...]] = ()
    #: option -> values from fast to accurate, which ``chemage tradeoff`` tries
    trade: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    #: figures that :meth:`draw` can draw: name -> caption
    figures: ClassVar[Mapping[str, str]] = {}
    # not annotated for type checkers, so that a class can make any of these a property
    if TYPE_CHECKING:
        exact = True
        declared_error = cast("float | None", None)
        error_of = cast("str", "")
        outputs = cast("Mapping[str, Output]", {})
    else:
        #: whether the answer is free of approximations; a result in which an approximate component took part says so
        exact: ClassVar[bool] = True
        #: of an approximate component, the largest relative error of :attr:`error_of`; None: not known
        declared_error: ClassVar[float | None] = None
        #: what :attr:`declared_error` is the error of, in words
        error_of: ClassVar[str] = "what it computes"
        #: the numbers, curves and maps that :meth:`record` is given, or that an observable measures
        outputs: ClassVar[Mapping[str, Output]] = {}

    def __init__(self, /, **options: Any) -> None:
        try:
            super().__init__(**options)
        except ChemageError:  # an option is wrong
            raise
        except Exception as error:
            name_owner(
                error, self._title(), type(self), ownership.plugin_of(type(self))
            )
            raise

    @classmethod
    def _title(cls) -> str:
        return f"{cls.role} {cls.kind!r}" if cls.kind else cls.__name__

    @classmethod
    def qualified_kind(cls) -> str:
        """:attr:`kind`, after the name of its plugin where it is not built in: ``"grit:winkler"``."""
        return names.spelling(cls, everywhere=True)

    def model_copy(
        self, *, update: Fields | None = None, deep: bool = False
    ) -> Self:
        """As :meth:`replace`: options are always validated."""
        return self.replace(**(update or {}))

    @model_serializer(mode="wrap")
    def _with_kind(
        self, handler: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> Data:
        fields, is_identity = handler(self), info.context is _IDENTITY
        if is_identity:
            fields = {
                name: value
                for name, value in fields.items()
                if name not in self.speed_only
            } | self.content()
        # a component inside a component keeps its kind too: without it two chemistries would have one digest
        if not self.kind:
            return fields
        return {
            "kind": names.spelling(type(self), everywhere=is_identity),
            **fields,
        }

    def __eq__(self, other: object) -> bool:
        # by options alone: pydantic would compare what a class keeps in private attributes as well
        return type(other) is type(self) and all(
            getattr(self, name) == getattr(other, name)
            for name in type(self).model_fields
        )

    def __hash__(self) -> int:
        return hash(
            (type(self), *(getattr(self, name) for name in type(self).model_fields))
        )

    def todict(self) -> Data:
        """``{"kind": ..., option: value}`` of plain JSON values; :meth:`fromdict` reads it back."""
        return self.model_dump(mode="json")

    def content(self) -> dict[str, str]:
        """What decides the answer beside the options, such as the hash of a table that the class reads: name -> value.

        It is part of :meth:`identity`, also where the component is a part of another one, so that results of an older
        table are not taken for those of a newer one.
        """
        return {}

    def identity(self) -> Data:
        """What decides the answer: all options but those that only change the speed, and :meth:`content`."""
        return self.model_dump(mode="json", context=_IDENTITY)

    @classmethod
    def fromdict(cls, fields: Fields) -> Self:
        """The inverse of :meth:`todict`; :func:`chemage.plugin.fromdict` finds the class by its kind as well."""
        if not is_table(fields):
            raise InputError.of(
                "fields", fields, "is not a table of options by name"
            )
        options = dict(fields)
        kind = options.pop("kind", cls.kind)
        if str(kind).rpartition(":")[2] != cls.kind:
            raise InputError.of(
                "kind",
                kind,
                f"these are not the options of {cls.role or cls.__name__} {cls.kind!r}",
            )
        return cls(**options)

    def _repr_html_(self) -> str:
        title = self._title().replace("'", "")
        texts = meanings(type(self))
        rows = (
            (name, str(getattr(self, name)), texts.get(name, ""))
            for name in type(self).model_fields
        )
        return html_table(title, rows)

    def digest(self) -> str:
        """Content hash of kind and options (see :attr:`speed_only`), the same in every process."""
        return content_hash({"role": self.role, **self.identity()})

    def replace(self, **changes: Any) -> Self:
        """A copy with some options changed, validated again."""
        options = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**options, **changes})

    def reference(self) -> Self:
        """The component with which ``chemage tradeoff`` compares the values in :attr:`trade`.

        Here each of these options has its last, most accurate value. Override it where the class can do better.
        """
        return (
            self.replace(
                **{option: values[-1] for option, values in self.trade.items()}
            )
            if self.trade
            else self
        )

    def record(self, **values: Any) -> None:
        """Record some of :attr:`outputs`, in the unit that they declare, while the component works: of a surface, a
        contact, an engine, a rupture law or a method of ageing. The stage keeps them with its result.

        An engine that goes on from a history finds what was recorded before in its ``observables``: a number is that of
        the whole run, a curve has one entry for each hold time of the part that is computed.
        """
        if unknown := values.keys() - self.outputs.keys():
            raise PluginError(
                f"{self._title()} records {min(unknown)!r}, which it does not declare; add it to outputs"
            )
        record_by(
            self._title(),
            {name: self.outputs[name].of(value) for name, value in values.items()},
        )

    def draw(self, figure: str, axes: Axes, results: Sequence[Any]) -> None:
        """Draw one of :attr:`figures` into ``axes``: of one result, or of several that are compared.

        ``results`` are those in which a component of this kind took part, each a :class:`chemage.plugin.PlottedResult`:
        its ``component`` is the component of that result, whose options may differ from those of this one.
        """
        raise NotImplementedError(
            f"{self.role} {self.kind!r} names the figure {figure!r} but does not draw it"
        )


def call_with(method: Callable[..., Any], *arguments: Any, **offered: Any) -> Any:
    """Call ``method`` with ``arguments`` and with those of ``offered`` that its signature names.

    By this, a role's method can be offered more than when the component was written.
    """
    taken = {name: value for name, value in offered.items() if takes(method, name)}
    return method(*arguments, **taken)


def takes(method: Callable[..., Any], name: str) -> bool:
    """Whether the signature of ``method`` has an argument of this name."""
    named = _named(getattr(method, "__func__", method))
    return named is None or name in named


@lru_cache(maxsize=1024)
def _named(function: Callable[..., Any]) -> frozenset[str] | None:
    """The names that a function takes; None: any."""
    parameters = inspect.signature(function).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    return frozenset(parameter.name for parameter in parameters)
