"""A contact with its options on sliders: in a browser, in a notebook, or as one HTML file; docs/scenes.md."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return {"live": "chemage_live.page:Page"}


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage live``."""
    from chemage_live.command import live

    return [("live", live)]
