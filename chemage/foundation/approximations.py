"""What is approximate about a result, as data in its ``provenance`` and in words.

Each approximation is a mapping with ``kind``, the name of what approximates, and optionally ``declared_error``, the
largest relative error, ``of``, what that is the error of, and ``role``. A stage notes those of its components whose
``exact`` is False; a plugin that answers a stage adds its own to ``provenance["approximate"]`` of its answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def merged(*lists: Any) -> list[dict[str, Any]]:
    """Join lists of approximations, each entry once; what is no mapping with a ``kind`` is left out."""
    found: list[dict[str, Any]] = []
    for one in lists:
        for entry in one if isinstance(one, Iterable) and not isinstance(one, str | Mapping) else ():
            if isinstance(entry, Mapping) and isinstance(entry.get("kind"), str) and dict(entry) not in found:
                found.append(dict(entry))
    return found


def of_component(component: Any) -> list[dict[str, Any]]:
    """The approximation that a component, or every component of a class, makes; empty if it is exact."""
    if component.exact:
        return []
    found: dict[str, Any] = {"role": component.role, "kind": component.kind}
    if component.declared_error is not None:
        found |= {"declared_error": float(component.declared_error), "of": component.error_of}
    return [found]


def in_words(approximations: Iterable[Mapping[str, Any]]) -> str:
    """The one sentence by which everything that prints a number marks it: ``KIND (declared error 2 % of ...)``."""
    return "; ".join(_in_words(one) for one in approximations)


def _in_words(one: Mapping[str, Any]) -> str:
    error = one.get("declared_error")
    if not isinstance(error, int | float):
        return f"{one['kind']} (no error declared)"
    return f"{one['kind']} (declared error {100 * error:.3g} % of {one.get('of') or 'what it computes'})"
