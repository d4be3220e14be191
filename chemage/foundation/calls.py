"""Calls of methods whose later arguments are passed to those that name them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import lru_cache
from typing import Any


def call_with(method: Callable[..., Any], *arguments: Any, **offered: Any) -> Any:
    """Call ``method`` with ``arguments`` and with those of ``offered`` that its signature names.

    By this, a role's method can be offered more than when the component was written.
    """
    named = _named(getattr(method, "__func__", method))
    return method(*arguments, **{name: value for name, value in offered.items() if named is None or name in named})


@lru_cache(maxsize=1024)
def _named(function: Callable[..., Any]) -> frozenset[str] | None:
    """The names that a function takes; None: any."""
    parameters = inspect.signature(function).parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in parameters):
        return None
    return frozenset(one.name for one in parameters)
