"""Studies: figures and tables of the paper, calibration of its barriers; scenes of further comparisons."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The commands ``chemage reproduce`` and ``chemage study``."""
    from chemage_li2018.command import reproduce, study

    return [("reproduce", reproduce), ("study", study)]


@hookimpl
def chemage_scenes() -> dict[str, str]:
    """The scenes of this package."""
    challenge = (f"contact-challenge-{what}" for what in ("loads", "pixels", "sizes"))
    return {
        name: f"chemage_li2018:scenes/{name}.toml"
        for name in (*challenge, "silica-patches")
    }
