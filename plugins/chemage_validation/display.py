"""How predictions beside published numbers are shown: a table of verdicts, one of tests, one of sources, a figure."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from chemage.plugin import Panel, Picture, Result, Table, displays, figures
from chemage_validation.table import DATA, ValidatedRow, Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what a record has as it is in rows.toml
PLAIN = ("name", "sentence", "published", "error", "set", "number", "claimed")
#: distance from the published number, over that of the limit, beyond which a point is drawn at the edge
EDGE = 3.0
#: verdicts in the order of their colours
COLOURED = ("calibrated", "wrong", "held out and right", "cannot tell")


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _accepted(one: ValidatedRow) -> str:
    low, high = (_number(end) for end in one.row.limits[1:3])
    if low == "-inf":
        return f"below {high}"
    return f"above {low}" if high == "inf" else f"{low} to {high}"


def _refusals(one: ValidatedRow) -> str:
    return "; ".join(
        f"{name}: {'never' if math.isnan(end) else f'from {_number(end)}'}"
        for name, end in one.refused.items()
    )


def _record(one: ValidatedRow) -> dict[str, Any]:
    row, (source, doi) = one.row, one.row.cited
    return {
        **{name: getattr(row, name) for name in PLAIN},
        "source": source,
        "doi": doi,
        "calibrated_on": " ".join(row.used),
        "accepted_low": row.limits.low if one.test else math.nan,
        "accepted_high": row.limits.high if one.test else math.nan,
        "power": one.test.power if one.test else {},
        "refused_from": one.refused,
        "verdict": one.verdict,
        "reason": one.reason,
    }


@displays(Validation)
class ValidationDisplay(Result):
    """Predictions beside published numbers as users see them."""

    width = 110
    errors = "95 % intervals over surfaces, or over groups of replicas of a tip"
    please_cite = "Please cite what was measured:"

    def __init__(self, validation: Validation) -> None:
        self.validation = validation

    @property
    def name(self) -> str:
        return "validation"

    @property
    def title(self) -> str:
        return "Published numbers and predictions"

    def facts(self) -> list[tuple[str, str]]:
        count = Counter(one.verdict for one in self.validation.rows)
        used = {one.row.set for one in self.validation.rows}
        return [
            ("verdicts", ", ".join(f"{n} {word}" for word, n in count.items())),
            *(
                (f"set {name}", f"{where['scene']}; {where['said']}")
                for name, where in DATA["sets"].items()
                if name in used
            ),
            ("*", "the set was made from this number"),
        ]

    def tables(self) -> list[Table]:
        """Verdicts, tests, sources."""
        verdicts, tests, sources = [], [], []
        for one in self.validation.rows:
            row = one.row
            mark = "*" if row.calibrated else ""
            found = one.prediction.text()
            verdicts.append(
                (row.name, row.published, row.set + mark, found, one.verdict)
            )
            if one.test is not None:
                tests.append((row.name, row.number, _accepted(one), _refusals(one)))
            else:
                tests.append((row.name, one.reason, "", ""))
            said = f"{row.sentence}: {row.published}, error {row.error}"
            sources.append((row.name, said, "; ".join(row.cited)))
        columns = (
            ("row", "published", "set", "prediction", "verdict"),
            ("row", "compared", "accepted", "refused in 80 %, towards"),
            ("row", "published number", "source"),
        )
        titles = ("Verdicts", "Tests", "Sources")
        rows = (verdicts, tests, sources)
        return [
            Table(title, heads, lines, title, in_detail=False)
            for title, heads, lines in zip(titles, columns, rows, strict=True)
        ]

    def notes(self) -> list[str]:
        return [
            f"{one.row.name}: {one.reason}"
            for one in self.validation.rows
            if one.reason and one.test is not None
        ]

    def numbers(self) -> dict[str, Any]:
        rows = self.validation.rows
        return {
            "rows": [
                _record(one) | {one.prediction.name: one.prediction.todict()}
                for one in rows
            ]
        }

    def columns(self) -> dict[str, Any]:
        rows = self.validation.rows
        records = [one.prediction.numbers() | _record(one) for one in rows]
        return {name: [one[name] for one in records] for name in records[0]}

    def cite(self) -> tuple[list[str], str]:
        found = (", ".join(one.row.cited) for one in self.validation.rows)
        return list(dict.fromkeys(found)), ""

    def pictures(self) -> dict[str, Picture]:
        """Distance of each prediction from the published number, over that of the limit beyond which it is refused."""
        height = 1.2 + 0.25 * len(self._drawn())
        return {
            "validation": Picture((Panel(self._draw, name="rows"),), (6.4, height))
        }

    def _drawn(self) -> list[ValidatedRow]:
        return [one for one in self.validation.rows if one.test is not None]

    def _draw(self, axes: Axes, medium: Any = None) -> None:
        there = {one.verdict for one in self._drawn()}
        colors = dict(zip(COLOURED, figures.PALETTE, strict=False))
        colors = {name: color for name, color in colors.items() if name in there}
        for height, one in enumerate(self._drawn()):
            found, row = one.prediction, one.row
            ends = np.array([found.value, found.low, found.high]) - row.claimed
            near, far = np.abs(np.array(row.limits[1:3]) - row.claimed)
            if ends[0] > 0:
                near, far = far, near
            scale = near if math.isfinite(near) else far
            value, low, high = np.clip(ends / scale, -EDGE, EDGE)
            limits = np.where(np.isfinite(row.limits[1:3]), (-1, 1), (-EDGE, EDGE))
            axes.barh(height, np.ptp(limits), 1, limits[0], color="0.92", zorder=0)
            axes.plot([low, high], [height, height], color=colors[one.verdict])
            marker = "o" if abs(value) < EDGE else "<" if value < 0 else ">"
            axes.plot(value, height, marker, ms=4, color=colors[one.verdict])
        for verdict, color in colors.items():
            axes.plot([], [], "o-", ms=4, color=color, label=verdict)
        axes.barh(0, 0, color="0.92", label="accepted")
        names = [one.row.name for one in self._drawn()]
        axes.set_yticks(range(len(names)), names)
        axes.set(
            xlim=(-1.05 * EDGE, 1.05 * EDGE),
            xlabel="prediction − published, over the distance of the limit",
        )
        axes.invert_yaxis()
        figures.legend(axes)
