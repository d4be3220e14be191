"""What holds in this context: the options and the order of plugins that a block or a scene sets, and who takes part.

A plugin takes part in a result if it answered the hook of a stage, or changed its answer. Every implementation of a
hook is wrapped when it is registered; one that answers None, or a wrapper whose answer has the content that it received,
has changed nothing and is not noted. What it answers is checked at once, so that a fault names the plugin.

Kept in context variables, so that two threads can run two scenes; the threads of replicas and the worker processes of a
sweep set them anew.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import pluggy

from chemage.foundation.aliases import Fields
from chemage.foundation.errors import PluginError
from chemage.foundation.ownership import name_owner
from chemage.plugins.loading import PluginRecord, is_stage

#: the variable that names the plugins that come first, separated by commas
PREFER = "CHEMAGE_PREFER"
_options: ContextVar[Fields] = ContextVar(
    "chemage_plugin_options", default=MappingProxyType({})
)
_prefer: ContextVar[tuple[str, ...] | None] = ContextVar(
    "chemage_preferred_plugins", default=None
)


def options() -> Fields:
    """Name of a plugin -> its options, where some are set."""
    return _options.get()


def preference() -> tuple[str, ...]:
    """Names of the plugins that come first: of the scene or block in use, else of ``CHEMAGE_PREFER``."""
    names = _prefer.get()
    if names is not None:
        return names
    return tuple(
        filter(None, map(str.strip, os.environ.get(PREFER, "").split(",")))
    )


@contextmanager
def applied(options: Fields, prefer: tuple[str, ...] | None) -> Iterator[None]:
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


class TakingPart(NamedTuple):
    """Who took part, and what each of them answered or changed: ``hook``, or ``hook.field``."""

    plugins: Plugins
    changes: dict[str, set[str]]


#: checks what one plugin, or chemage's own implementation (""), answered; raises PluginError
Check = Callable[[Any, str], None]

_noted: ContextVar[TakingPart | None] = ContextVar(
    "chemage_plugins_taking_part", default=None
)
_check: ContextVar[Check | None] = ContextVar(
    "chemage_check_of_answers", default=None
)


@contextmanager
def taking_part(check: Check | None = None) -> Iterator[TakingPart]:
    """The plugins that take part in the hook calls of this block, in this thread; each answer passes ``check``."""
    here = TakingPart({}, {})
    outer = _noted.get()
    token, checked = _noted.set(here), _check.set(check)
    try:
        yield here
    finally:
        _check.reset(checked)
        _noted.reset(token)
        if outer is not None:
            # what a plugin uses takes part in what the plugin answers
            outer.plugins.update(here.plugins)
            for name, changes in here.changes.items():
                note_changes(name, changes)


def note(name: str, source: str) -> None:
    """Note that a plugin takes part in the stage that is running in this thread; nothing outside a stage."""
    if (noted := _noted.get()) is not None:
        noted.plugins[name] = source


def note_changes(name: str, changes: Iterable[str]) -> None:
    """Note what a plugin answered or changed, likewise."""
    if (noted := _noted.get()) is not None:
        noted.changes.setdefault(name, set()).update(changes)


def record_participation(
    implementation: Any,
    hook: Any,
    record: PluginRecord | None,
    source_in_use: Callable[[PluginRecord], str],
) -> None:
    """Wrap an implementation of a hook (pluggy's ``HookImpl``) so that its part in an answer is noted, and that is
    checked.

    ``source_in_use`` is asked at that moment, because it contains the options then in use. Chemage's own implementation
    has no ``record`` and takes no part.
    """
    function = implementation.function

    def own(*arguments: Any) -> Any:
        answer = function(*arguments)
        if answer is not None:
            _checked(answer, "")
        return answer

    if record is None:
        implementation.function = own
        return
    source = partial(source_in_use, record)
    plugin = _Implementation(implementation, hook, record, source)
    if implementation.hookwrapper:
        implementation.wrapper, implementation.hookwrapper = True, False
        plugin.function = _new_style(function)
    if not hook.spec.argnames:  # it answers what a plugin offers, once
        implementation.function = plugin.offer
    else:
        wraps = implementation.wrapper
        implementation.function = plugin.wrapper if wraps else plugin.plain


def _checked(answer: Any, who: str) -> None:
    if (check := _check.get()) is not None:
        check(answer, who)


class _Implementation:
    """An implementation of a hook by a plugin: what it answers, records and changes is noted, by content; what it raises
    names it; and what it is given stays as it is.
    """

    def __init__(
        self,
        implementation: Any,
        hook: Any,
        record: PluginRecord,
        source: Callable[[], str],
    ) -> None:
        self.function = self.code = implementation.function
        self.arguments = implementation.argnames
        self.hook, self.many = hook.name, not is_stage(hook)
        self.record, self.source = record, source

    @property
    def who(self) -> str:
        return f"plugin {self.record.name!r} ({self.source()})"

    def offer(self, *arguments: Any) -> Any:
        """Call an implementation whose answer is no part of a result."""
        return self.naming(partial(self.function, *arguments))

    def plain(self, *arguments: Any) -> Any:
        """Call an implementation that answers."""
        content = _content()
        before = content.state(None)
        answer = self.run(arguments, partial(self.function, *arguments))
        if answer is not None and not (self.many and not answer):
            self.note([""])
            _checked(answer, self.who)
        else:
            self.note(content.changed_fields(before, content.state(None)))
        return answer

    def wrapper(self, *arguments: Any) -> Generator[None, Any, Any]:
        """Call an implementation that may change the answer of others."""
        content = _content()
        steps = self.function(*arguments)
        end = self.run(arguments, partial(_advance, steps.send, None))
        received, before, passing = None, {}, None
        if not end:
            try:
                received = yield
            except BaseException as error:
                passing = error
                resume = partial(_advance, steps.throw, error)
            else:
                before = content.state(received)
                resume = partial(_advance, steps.send, received)
            end = self.run(arguments, resume, passing) or steps.close()
        if not end:
            raise PluginError(f"hook wrapper of {self.who} yields twice")
        (answer,) = end
        same = answer is received and passing is None
        after = content.state(answer, before if same else {})
        changed = [""] if passing else content.changed_fields(before, after)
        if changed:
            self.note(changed)
            answer = content.rebuilt(answer, self.who) if same else answer
            _checked(answer, self.who)
        return answer

    def note(self, fields: Sequence[str]) -> None:
        """Note that it answered or changed these ``fields``; "": the whole answer."""
        if fields:
            note(self.record.name, self.source())
            changes = [f"{self.hook}.{one}".strip(".") for one in fields]
            note_changes(self.record.name, changes)

    def naming(
        self, step: Callable[[], Any], passing: BaseException | None = None
    ) -> Any:
        """What a step of the plugin's own code gives; ``passing`` is an exception of others that it is given."""
        try:
            return step()
        except (Exception, SystemExit) as error:
            if error is not passing and self.record.distribution != "chemage":
                name_owner(error, f"the hook {self.hook}", self.code, self.who)
            raise

    def run(
        self,
        arguments: Sequence[Any],
        step: Callable[[], Any],
        passing: BaseException | None = None,
    ) -> Any:
        """The same, which must leave its arguments as they are.

        Raises
        ------
        PluginError
            It changed one of them in place: others use that as well, and may have used it already.
        """
        content = _content()
        given = dict(zip(self.arguments, arguments, strict=True))
        before = content.contents(given)
        answer = self.naming(step, passing)
        if paths := content.differences(before, content.contents(given, before)):
            error = PluginError(
                f"{self.who}: {self.hook} changed {paths[0]} in place, which others use as well; leave its arguments as "
                "they are, and answer with a changed copy"
            )
            name_owner(error, f"the hook {self.hook}", self.code, self.who)
            raise error
        return answer


def _advance(resume: Callable[[Any], Any], value: Any) -> tuple[Any, ...]:
    """Go on with a wrapper: () where it yields, (what it returns,) where it ends."""
    try:
        resume(value)
    except StopIteration as end:
        return (end.value,)
    return ()


def _new_style(function: Callable[..., Any]) -> Callable[..., Any]:
    """A wrapper of the old style, which is given pluggy's ``Result``, as one of the new."""

    def wrapper(*arguments: Any) -> Generator[None, Any, Any]:
        steps = function(*arguments)
        next(steps)
        try:
            outcome = pluggy.Result((yield), None)
        except BaseException as error:
            outcome = pluggy.Result(None, error)
        if not _advance(steps.send, outcome):
            yield  # a second time, which is an error
        return outcome.get_result()

    return wrapper


def _content() -> Any:
    # it imports numpy, which the command line can do without
    from chemage.plugins import content

    return content
