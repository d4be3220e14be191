"""Error messages in plain words. Help and errors use it: it imports nothing heavy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from chemage.foundation.errors import shown

if TYPE_CHECKING:
    from pydantic import ValidationError


def explain(error: ValidationError, prefix: str = "") -> list[tuple[str, str]]:
    """Pydantic's error as ``(path, message)`` pairs in plain words."""
    problems = []
    for item in error.errors(include_url=False):
        path = ".".join(str(part) for part in (*([prefix] if prefix else []), *item["loc"]))
        message = item["msg"].removeprefix("Value error, ")
        value = item.get("input")
        if item["type"] == "extra_forbidden":
            message = "no such option"
        elif item["type"] == "missing":
            message = "is required"
        elif isinstance(value, int | float | str | bool):
            # many messages begin with the value already; that 0 is in "greater than 0" does not count
            begins = message.startswith((shown(value), f'"{value}"'))
            message = message if begins else f"{shown(value)}: {message}"
        problems.append((path, message))
    return problems


def in_lines(problems: Sequence[tuple[str, str]]) -> str:
    """``(path, message)`` pairs as one text."""
    return "; ".join(f"{path}: {message}" if path else message for path, message in problems)


def nearest(word: str, known: Sequence[str]) -> str:
    """``" (did you mean 'x'?)"`` when a known word is close, else nothing."""
    import difflib

    match = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" (did you mean {match[0]!r}?)" if match else ""
