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
    entries: list[dict[str, Any]] = []
    for candidates in lists:
        if not isinstance(candidates, Iterable) or isinstance(candidates, str | Mapping):
            continue
        for entry in candidates:
            if isinstance(entry, Mapping) and isinstance(entry.get("kind"), str) and dict(entry) not in entries:
                entries.append(dict(entry))
    return entries


def of_component(component: Any) -> list[dict[str, Any]]:
    """The approximation that a component, or every component of a class, makes; empty if it is exact."""
    if component.exact:
        return []
    entry: dict[str, Any] = {"role": component.role, "kind": component.kind}
    if component.declared_error is not None:
        entry |= {"declared_error": float(component.declared_error), "of": component.error_of}
    return [entry]


def in_words(approximations: Iterable[Mapping[str, Any]]) -> str:
    """The one sentence by which everything that prints a number marks it: ``KIND (declared error 2 % of ...)``."""
    return "; ".join(f"{entry['kind']} ({_error_in_words(entry)})" for entry in approximations)


def _error_in_words(entry: Mapping[str, Any]) -> str:
    error = entry.get("declared_error")
    if not isinstance(error, int | float):
        return "no error declared"
    return f"declared error {100 * error:.3g} % of {entry.get('of') or 'what it computes'}"
