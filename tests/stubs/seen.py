"""What commands show, as objects: the one place where tests of results and sweeps reach into chemage.

``figures`` are those of `chemage plot`, ``scene_schema`` is the output of `chemage schema`, ``SweepData`` is what is
listed and drawn of a sweep, and ``survey_of`` what a sweep finds out before it computes.
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
from chemage.scene.scene import heading
from chemage.scene.schema import options_of, scene_schema
from chemage.studies.sweeps.running import read_grid, show_progress, survey_of
from chemage.studies.sweeps.views import HOLD_TIME, SweepData, swept_rows

__all__ = [
    "HOLD_TIME",
    "Comparison",
    "Entry",
    "SweepData",
    "Table",
    "comparison_figures",
    "drawn_data",
    "figures",
    "heading",
    "limits",
    "options_of",
    "published",
    "read_grid",
    "report",
    "result_of",
    "scene_schema",
    "show_progress",
    "survey_of",
    "swept_rows",
    "window_figure",
]


def report(files: Sequence[str | Path], **options) -> str:
    """The text of a report of these files."""
    with TemporaryDirectory() as folder:
        return ca.write_report(files, Path(folder) / "report.html", **options).read_text(encoding="utf-8")
