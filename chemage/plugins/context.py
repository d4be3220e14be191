"""What holds in this context: the options and the order of plugins that a block or a scene sets, and who takes part.

A plugin takes part in a result if it answered the hook of a stage, or changed its answer. Every implementation of a
hook is wrapped when it is registered; one that answers None, or a wrapper that returns the very object it received, has
changed nothing and is not noted. What it answers is checked at once, so that a fault names the plugin.

Kept in context variables, so that two threads can run two scenes; the threads of replicas and the worker processes of a
sweep set them anew.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType
from typing import Any

#: the variable that names the plugins that come first, separated by commas
PREFER = "CHEMAGE_PREFER"
_options: ContextVar[Mapping[str, Any]] = ContextVar(
    "chemage_plugin_options", default=MappingProxyType({})
)
_prefer: ContextVar[tuple[str, ...] | None] = ContextVar(
    "chemage_preferred_plugins", default=None
)


def options() -> Mapping[str, Any]:
    """Name of a plugin -> its options, where some are set."""
    return _options.get()


def preference() -> tuple[str, ...]:
    """Names of the plugins that come first: of the scene or block in use, else of ``CHEMAGE_PREFER``."""
    names = _prefer.get()
    if names is not None:
        return names
    return tuple(filter(None, map(str.strip, os.environ.get(PREFER, "").split(","))))


@contextmanager
def applied(
    options: Mapping[str, Any], prefer: tuple[str, ...] | None
) -> Iterator[None]:
    """Set the options of plugins, and unless it is None the preference, within a block."""
    before = _options.set(options)
    order = _prefer.set(_prefer.get() if prefer is None else prefer)
    try:
        yield
    finally:
        _prefer.reset(order)
        _options.reset(before)


# -- who takes part ---------------------------------------------------------------------------------------------------

#: name of a plugin -> its distribution and version, and in square brackets its options, where it has some
Plugins = dict[str, str]

#: checks what one plugin, or chemage's own implementation (""), answered; raises PluginError
Check = Callable[[Any, str], None]

_noted: ContextVar[Plugins | None] = ContextVar(
    "chemage_plugins_taking_part", default=None
)
_check: ContextVar[Check | None] = ContextVar("chemage_check_of_answers", default=None)


@contextmanager
def taking_part(check: Check | None = None) -> Iterator[Plugins]:
    """The plugins that take part in the hook calls of this block, in this thread; each answer passes ``check``."""
    plugins: Plugins = {}
    outer = _noted.get()
    token, checked = _noted.set(plugins), _check.set(check)
    try:
        yield plugins
    finally:
        _check.reset(checked)
        _noted.reset(token)
        if outer is not None:
            # what a plugin uses takes part in what the plugin answers
            outer.update(plugins)


def note(name: str, source: str) -> None:
    """Note that a plugin takes part in the stage that is running in this thread; nothing outside a stage."""
    plugins = _noted.get()
    if plugins is not None:
        plugins[name] = source


def record_participation(
    implementation: Any, name: str, source: Callable[[], str], *, many: bool
) -> None:
    """Wrap a hook implementation (pluggy's ``HookImpl``) so that its part in an answer is noted, and that is checked.

    ``source`` is asked at that moment, because it contains the options then in use. ``many`` is for hooks that collect
    all answers: an empty one adds nothing. Chemage's own implementation has the name "" and takes no part.
    """
    function = implementation.function

    def answered(answer: Any) -> None:
        who = ""
        if name:
            note(name, version := source())
            who = f"plugin {name!r} ({version})"
        if (check := _check.get()) is not None:
            check(answer, who)

    def plain(*arguments: Any) -> Any:
        answer = function(*arguments)
        if answer is not None and not (many and not answer):
            answered(answer)
        return answer

    def wrapper(*arguments: Any) -> Generator[None, Any, Any]:
        steps = function(*arguments)
        next(steps)
        try:
            received = yield
        except BaseException as error:
            try:
                steps.throw(error)
            except StopIteration as end:
                answered(end.value)
                return end.value
        else:
            try:
                steps.send(received)
            except StopIteration as end:
                if end.value is not received:
                    answered(end.value)
                return end.value
        steps.close()
        raise RuntimeError(f"hook wrapper of plugin {name!r} yields twice")

    def old_wrapper(*arguments: Any) -> Generator[None, Any, None]:
        steps = function(*arguments)
        next(steps)
        outcome = yield
        before = (
            outcome.exception,
            None if outcome.exception else outcome.get_result(),
        )
        try:
            steps.send(outcome)
        except StopIteration:
            pass
        else:
            steps.close()
            raise RuntimeError(f"hook wrapper of plugin {name!r} yields twice")
        after = (outcome.exception, None if outcome.exception else outcome.get_result())
        if before[0] is not after[0] or before[1] is not after[1]:
            answered(after[1])

    if implementation.wrapper:
        implementation.function = wrapper
    elif implementation.hookwrapper:
        implementation.function = old_wrapper
    else:
        implementation.function = plain
