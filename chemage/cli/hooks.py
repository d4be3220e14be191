"""The hook of the command line: further commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from chemage.plugins.hooks import hookspec


@hookspec
def chemage_cli() -> Sequence[tuple[str, Any]]:  # pyright: ignore[reportReturnType]
    """Add commands: ``[(name, function), ...]``; typer makes the command line from the signature of the function."""
