"""What commands show, as objects: the one place where tests of results, plans, sweeps and maps reach into chemage.

``figures`` are those of `chemage plot`, ``plan`` is what `chemage check` prints, ``scene_schema`` is the output of
`chemage schema`, ``tradeoff`` is `chemage tradeoff`, ``survey_of`` what a sweep finds out before it computes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import chemage as ca
from chemage.foundation.result import result_of
from chemage.results.comparison import Comparison, Entry
from chemage.results.drawing import comparison_figures, figures, window_figure
from chemage.scene.plan import plan
from chemage.scene.schema import scene_schema
from chemage.studies.sweeps.running import read_grid, survey_of
from chemage.studies.trade.mapping import tradeoff
from chemage.studies.trade.trade_map import Point, TradeMap

__all__ = [
    "Comparison",
    "Entry",
    "Point",
    "TradeMap",
    "comparison_figures",
    "figures",
    "plan",
    "read_grid",
    "report",
    "result_of",
    "scene_schema",
    "survey_of",
    "tradeoff",
    "window_figure",
]


def report(files: Sequence[str | Path], **options) -> str:
    """The text of a report of these files."""
    with TemporaryDirectory() as folder:
        return ca.write_report(files, Path(folder) / "report.html", **options).read_text(encoding="utf-8")
