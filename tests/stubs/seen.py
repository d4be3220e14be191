"""What commands show, as objects: the one place where tests of results and sweeps reach into chemage.

``figures`` are those of `chemage plot`, ``scene_schema`` is the output of `chemage schema`, ``SweepData`` is what is
listed and drawn of a sweep, and ``survey_of`` what a sweep finds out before it computes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import chemage as ca
from chemage.foundation import limits
from chemage.foundation.drawn import drawn_data
from chemage.foundation.result import Table, result_of
from chemage.results.comparison import Comparison, Entry
from chemage.results.drawing import comparison_figures, drawn_picture, window_figure
from chemage.results.drawing import figures as every_figure
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
    "every_figure",
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


class Figures(Mapping[str, Any]):
    """The figures of a result by their names; where one is asked for that chemage draws, no other is drawn."""

    def __init__(self, thing: Any, **choice: Any) -> None:
        self.thing, self.choice = thing, choice
        self.pictures = result_of(thing).pictures(**choice)
        self.drawn: dict[str, Any] = {}

    @cached_property
    def every(self) -> dict[str, Any]:
        return every_figure(self.thing, **self.choice) | self.drawn

    def __getitem__(self, name: str) -> Any:
        if "every" in vars(self) or name not in self.pictures:
            return self.every[name]
        if name not in self.drawn:
            self.drawn[name] = drawn_picture(self.pictures[name])
        return self.drawn[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.every)

    def __len__(self) -> int:
        return len(self.every)


def figures(thing: Any, panels: Sequence[str] = (), **choice: Any) -> Mapping[str, Any]:
    return every_figure(thing, panels, **choice) if panels else Figures(thing, **choice)


def report(files: Sequence[str | Path], **options) -> str:
    """The text of a report of these files."""
    with TemporaryDirectory() as folder:
        return ca.write_report(files, Path(folder) / "report.html", **options).read_text(encoding="utf-8")
