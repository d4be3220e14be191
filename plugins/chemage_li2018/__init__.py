"""Studies: figures and tables of the paper, calibration of its barriers, scaling of friction by contact area."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The commands ``chemage reproduce`` and ``chemage study``."""
    from chemage_li2018.command import reproduce, study

    return [("reproduce", reproduce), ("study", study)]
