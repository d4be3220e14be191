"""Predictions of one set of parameters beside published numbers; docs/accuracy.md."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl

NAMES = {
    "validate": "chemage_validation.table:validate",
    "Validation": "chemage_validation.table:Validation",
}


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return NAMES


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage validate``."""
    from chemage_validation.command import validate

    return [("validate", validate)]
