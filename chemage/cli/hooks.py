"""What can be plugged into the command line: further subcommands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from chemage.plugins.hooks import hookspec


@hookspec
def chemage_cli() -> Sequence[tuple[str, Any]]:  # pyright: ignore[reportReturnType]
    """Add subcommands: ``[(name, function), ...]``; the signature of the function is its command line (typer)."""
