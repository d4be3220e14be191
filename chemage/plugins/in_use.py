"""What a block or a scene sets for plugins: their options, and which of them come first.

Kept in context variables, so that two threads can run two scenes; the threads of replicas and the worker processes of a
sweep set them anew.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType
from typing import Any

#: the variable that names the plugins that come first, separated by commas
PREFER = "CHEMAGE_PREFER"
_options: ContextVar[Mapping[str, Any]] = ContextVar("chemage_plugin_options", default=MappingProxyType({}))
_prefer: ContextVar[tuple[str, ...] | None] = ContextVar("chemage_preferred_plugins", default=None)


def options() -> Mapping[str, Any]:
    """Name of a plugin -> its options, where some are set."""
    return _options.get()


def preference() -> tuple[str, ...]:
    """Names of the plugins that come first: of the scene or block in use, else of ``CHEMAGE_PREFER``."""
    names = _prefer.get()
    if names is not None:
        return names
    return tuple(filter(None, (name.strip() for name in os.environ.get(PREFER, "").split(","))))


@contextmanager
def applied(options: Mapping[str, Any], prefer: tuple[str, ...] | None) -> Iterator[None]:
    """Set the options of plugins, and unless it is None the preference, within a block."""
    before = _options.set(options)
    order = _prefer.set(_prefer.get() if prefer is None else prefer)
    try:
        yield
    finally:
        _prefer.reset(order)
        _options.reset(before)
