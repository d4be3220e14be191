"""Ten small, exactly specified problems, and the command that scores answers to them; docs/accuracy.md."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage benchmark``."""
    from chemage_benchmark.command import benchmark

    return [("benchmark", benchmark)]
