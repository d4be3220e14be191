"""What commands show, as objects: the one place where tests of results, plans, sweeps and maps reach into chemage.

``figures`` are those of `chemage plot`, ``plan`` is what `chemage check` prints, ``scene_schema`` is the output of
`chemage schema`, ``tradeoff`` is `chemage tradeoff`, ``SweepData`` is what is listed and drawn of a sweep, and
``survey_of`` what a sweep finds out before it computes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import chemage as ca
from chemage.foundation import limits
from chemage.foundation.drawn import drawn_data
from chemage.foundation.result import Table, result_of
from chemage.results.comparison import Comparison, Entry
from chemage.results.drawing import comparison_figures, figures, window_figure
from chemage.scene.display import published
from chemage.scene.plan import plan
from chemage.scene.scene import heading
from chemage.scene.schema import options_of, scene_schema
from chemage.studies.sweeps.running import read_grid, show_progress, survey_of
from chemage.studies.sweeps.views import HOLD_TIME, SweepData, swept_rows
from chemage.studies.trade.choices import choices
from chemage.studies.trade.mapping import planned, tradeoff
from chemage.studies.trade.trade_map import TradeMap, TradePoint

__all__ = [
    "HOLD_TIME",
    "Comparison",
    "Entry",
    "SweepData",
    "Table",
    "TradeMap",
    "TradePoint",
    "comparison_figures",
    "drawn_data",
    "figures",
    "heading",
    "limits",
    "options_of",
    "plan",
    "planned",
    "published",
    "read_grid",
    "report",
    "result_of",
    "scene_schema",
    "show_progress",
    "survey_of",
    "swept_rows",
    "tradeoff",
    "tried_values",
    "window_figure",
]


def report(files: Sequence[str | Path], **options) -> str:
    """The text of a report of these files."""
    with TemporaryDirectory() as folder:
        return ca.write_report(files, Path(folder) / "report.html", **options).read_text(encoding="utf-8")


def tried_values(scene: ca.Scene, option: str) -> tuple[list[str], list[str]]:
    """The values of an option that a map of speed and accuracy tries, and what it notes of them."""
    notes: list[str] = []
    return [one.label for one in choices(scene, notes) if one.name == option], notes
