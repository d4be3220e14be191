"""Speed against accuracy: what each setting of a scene costs, and what it changes."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl

NAMES = {
    "Tradeoff": "chemage_trade.result:Tradeoff",
    "tradeoff": "chemage_trade.mapping:tradeoff",
}


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return NAMES


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage tradeoff``."""
    from chemage_trade.command import tradeoff

    return [("tradeoff", tradeoff)]
