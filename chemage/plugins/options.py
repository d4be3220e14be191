"""Options: a component as an option of another one, the options of a plugin, and the blocks that set them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Generic, Self, TypeVar, overload

from pydantic import BeforeValidator, SerializeAsAny

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.names import FACTORIES
from chemage.foundation.units import units_of
from chemage.plugins import context
from chemage.plugins.registry import current

_T = TypeVar("_T")

if TYPE_CHECKING:

    class Choice(Generic[_T]):
        """To a type checker: a component when it is read, and all that may be given for one when it is set."""

        @overload
        def __get__(self, instance: None, owner: Any) -> Self: ...
        @overload
        def __get__(self, instance: object, owner: Any) -> _T: ...
        def __get__(self, instance: Any, owner: Any) -> Any: ...
        def __set__(self, instance: Any, value: _T | str | Fields) -> None: ...

else:

    class Choice:
        """The type of a field that holds a component of a role, such as ``Choice[ContactSolver]``.

        The value may be a component, its kind, or a table with its ``kind`` and options, as in a scene. It is stored
        with all its options; its plugin is named in results; a wrong option is reported by its path.
        """

        def __class_getitem__(cls, role: type) -> Any:
            if not getattr(role, "role", ""):
                raise TypeError(
                    f"Choice[{role!r}]: give the class of a role, such as chemage.plugin.ContactSolver"
                )
            return Annotated[
                SerializeAsAny[role], BeforeValidator(partial(_chosen, role))
            ]


def _chosen(role: Any, value: Any) -> Any:
    try:
        if isinstance(value, str):
            return current().make(role.role, value, {})
        if isinstance(value, Mapping):
            return current().fromtable(role.role, value)
    except ChemageError as error:
        raise ValueError(str(error)) from None
    if not isinstance(value, role):
        maker = (
            f'chemage.{FACTORIES.get(role.role, role.role)}("...")'
            if role.role != "reader"
            else "a reader"
        )
        raise ValueError(
            f"expected a component made with {maker}, its kind, or a table with kind and options"
        )
    return value


class PluginOptions(Component):
    """Base of the options of a plugin: a frozen class whose fields are the options, each with a default.

    The module of the plugin names its class, ``CHEMAGE_OPTIONS = "module:Options"``. A scene sets the options in
    ``[plugins.NAME]``, Python with :func:`chemage.plugin_options`; hooks read them with :meth:`current`.
    """

    @classmethod
    def current(cls) -> Self:
        """The options in use in this thread: of the scene that runs or of the block, else the defaults.

        A thread that a plugin starts itself sees the defaults, unless it runs in a copy of the context of its parent
        (``contextvars.copy_context().run``).
        """
        for options in context.options().values():
            if type(options) is cls:
                return options
        return cls()

    def changed(self) -> Data:
        """The options that decide the answer and differ from their defaults, as plain JSON values."""
        defaults = type(self)().identity()
        return {
            name: value
            for name, value in self.identity().items()
            if value != defaults[name]
        }

    def text(self) -> str:
        """The options that decide the answer in one line: ``peak = 2.0 GPa, smooth = true``."""
        units = units_of(type(self))
        shown = {
            name: "none"
            if value is None
            else f"{json.dumps(value, sort_keys=True)} {units.get(name, '')}".rstrip()
            for name, value in self.identity().items()
        }
        return ", ".join(f"{name} = {value}" for name, value in shown.items())


def options_for(name: str, options: Fields) -> PluginOptions:
    """The validated options of the plugin ``name``.

    Raises
    ------
    InputError
        There is no such plugin, it has no options, or some are not valid (listed in ``problems``).
    """
    return current().options_class(name)(**options)


def joined(
    outer: Mapping[str, PluginOptions], inner: Mapping[str, PluginOptions]
) -> dict[str, PluginOptions]:
    """Options of plugins, where those that ``inner`` sets replace those of ``outer``, each by itself."""
    together = dict(outer)
    for name, options in inner.items():
        # two classes: the plugin was imported again in between
        same = name in together and type(together[name]) is type(options)
        together[name] = (
            together[name].replace(**_set(options)) if same else options
        )
    return together


def _set(options: PluginOptions) -> Data:
    return {field: getattr(options, field) for field in options.model_fields_set}


def completed(data: Fields) -> Data:
    """Scene data with the options and the preference of the block in use, where the data do not set them.

    Worker processes know the scene only.
    """
    section = data.get("plugins", {})
    in_block = {
        name: {
            field: value
            for field, value in options.todict().items()
            if field in options.model_fields_set
        }
        for name, options in context.options().items()
    }
    if not isinstance(section, Mapping) or not (in_block or context.preference()):
        return dict(data)
    joint: Data = {**section}
    if context.preference():
        joint.setdefault("prefer", list(context.preference()))
    for name, options in in_block.items():
        own = joint.get(name, {})
        joint[name] = {**options, **own} if isinstance(own, Mapping) else own
    return {**data, "plugins": joint}


@contextmanager
def plugin_options(name: str, /, **options: Any) -> Iterator[PluginOptions]:
    """Set options of the plugin ``name`` within a block, as ``[plugins.NAME]`` does in a scene.

    ``with chemage.plugin_options("hardness", peak="2 GPa"): chemage.age(...)``. In a block inside another, options that
    the inner one does not set keep the value of the outer one. Where a scene is run within the block, its own
    ``[plugins.NAME]`` comes before the block.

    Raises
    ------
    InputError
        There is no such plugin, it has no options, or some are not valid.
    """
    try:
        inner = options_for(name, options)
    except InputError as error:
        if not error.problems:
            raise
        lines = "; ".join(f"{path}: {message}" for path, message in error.problems)
        raise InputError(
            f"options of plugin {name!r}: {lines}", error.problems
        ) from None
    together = joined(context.options(), {name: inner})
    with context.applied(together, None):
        yield together[name]


@contextmanager
def prefer_plugins(*names: str) -> Iterator[None]:
    """Let these plugins come first within a block, as ``[plugins] prefer`` does in a scene.

    Raises
    ------
    InputError
        One of them is not installed.
    """
    current().check_preference(names, "prefer_plugins")
    with context.applied(context.options(), names):
        yield
