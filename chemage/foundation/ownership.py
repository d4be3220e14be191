"""Whose code raised an exception: the base class of all that plugins subclass, and the note in which an exception names
its owner.
"""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from chemage.foundation.errors import PluginError

F = TypeVar("F", bound=Callable[..., Any])
#: attribute of an exception that names its owner in a note
_OWNER = "chemage_owner"


def _unknown(code: Any) -> str:
    return f"{code.__module__}.{code.__qualname__}"


#: gives the plugin that a class or function is from, in words; "" for chemage's own. The registry sets it.
plugin_of: Callable[[Any], str] = _unknown


def owner_of(error: BaseException) -> tuple[str, str]:
    """The plugin in whose code ``error`` arose, and where, in words; both "" where it is chemage's, or not known."""
    return getattr(error, _OWNER, ("", ""))


def in_words(error: BaseException) -> str:
    """Type and message of an exception, and where in a plugin it arose, in one line."""
    text = f"{type(error).__name__}: {error}"
    return "; ".join(filter(None, [text, owner_of(error)[1]]))


def name_owner(error: BaseException, what: str, code: Any, owner: str) -> None:
    """Note in ``error`` that it arose in ``what`` of the plugin ``owner``, and in which line of its ``code``, a function or
    a class.

    An exception that names its owner already keeps it: the innermost is nearest to the cause.
    """
    if owner_of(error)[0] or not owner:
        return
    package, begin = (
        str(code.__module__).partition(".")[0],
        getattr(code, "__code__", None),
    )
    where = f", {begin.co_filename}:{begin.co_firstlineno}" if begin else ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if str(frame.f_globals.get("__name__")).partition(".")[0] == package:
            where = f", {frame.f_code.co_filename}:{line}"
    note = f"in {what} of {owner}: {_unknown(code)}{where}"
    setattr(error, _OWNER, (owner, note))
    error.add_note(note)


def naming_owner(function: F, title: Callable[..., str], promised: str = "") -> F:
    """``function``, such that what it raises names the plugin it is from, and ``title`` of its first argument.

    Where it must return something, ``promised`` says what; None is a PluginError then.
    """

    def owner(arguments: tuple[Any, ...]) -> str:
        first = arguments[0] if arguments else None
        cls = first if isinstance(first, type) else type(first)
        return plugin_of(cls if issubclass(cls, Owned) else function)

    def named(error: BaseException, arguments: tuple[Any, ...]) -> None:
        name_owner(error, title(*arguments[:1]), function, owner(arguments))

    @wraps(function)
    def generator(*arguments: Any, **options: Any) -> Any:
        try:
            return (yield from function(*arguments, **options))
        except (Exception, SystemExit) as error:
            named(error, arguments)
            raise

    @wraps(function)
    def method(*arguments: Any, **options: Any) -> Any:
        try:
            answer = function(*arguments, **options)
        except (Exception, SystemExit) as error:
            named(error, arguments)
            raise
        if answer is None and promised:
            error = PluginError(
                f"{title(*arguments[:1])} of {owner(arguments) or 'chemage'}: {function.__name__} returned None; "
                f"expected {'an' if promised[0] in 'AEIOU' else 'a'} {promised}"
            )
            named(error, arguments)
            raise error
        return answer

    return generator if inspect.isgeneratorfunction(function) else method  # pyright: ignore[reportReturnType]


class Owned:
    """Base of the classes that plugins subclass: what a method of theirs raises names its plugin, and the line."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if _is_own(cls):
            return
        for name, member in [*vars(cls).items()]:
            declared = next(
                (
                    vars(base)[name]
                    for base in cls.__mro__[1:]
                    if name in vars(base) and _is_own(base)
                ),
                None,
            )
            if declared is not None and not name.startswith("__"):
                setattr(cls, name, _naming(member, declared))


def _is_own(cls: type) -> bool:
    return cls.__module__.startswith("chemage.")


def _naming(member: Any, declared: Any) -> Any:
    """A method or property such that what it raises names its owner; ``declared`` as chemage declares it."""

    def title(subject: Any = None) -> str:
        named = getattr(subject, "_title", None)  # of components and stages
        cls = subject if isinstance(subject, type) else type(subject)
        return named() if named else cls.__qualname__

    if isinstance(member, property) and member.fget is not None:
        return property(
            naming_owner(member.fget, title),
            member.fset,
            member.fdel,
            member.__doc__,
        )
    if isinstance(member, classmethod):
        return classmethod(
            naming_owner(member.__func__, title, _promised(declared.__func__))
        )
    if inspect.isfunction(member):
        return naming_owner(member, title, _promised(declared))
    return member


def _promised(declared: Any) -> str:
    """What a method of chemage returns by its annotation; "" where that may be None or anything."""
    returns = str(getattr(declared, "__annotations__", {}).get("return", "Any"))
    return "" if "None" in returns or returns in ("Any", "object") else returns
