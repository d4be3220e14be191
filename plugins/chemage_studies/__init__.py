"""Studies: reproduction of the figures and tables of the paper, and scaling of friction by contact area."""

from __future__ import annotations

from typing import Any

from chemage import hookimpl


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The commands ``chemage reproduce`` and ``chemage study``."""
    from chemage_studies.reproduction.command import reproduce
    from chemage_studies.tips.command import study

    return [("reproduce", reproduce), ("study", study)]
