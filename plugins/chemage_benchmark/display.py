"""How problems, and the score of answers to them, are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from chemage.plugin import Result, Table, text
from chemage_benchmark.problems import (
    ALLOWED,
    OWN,
    BenchmarkProblem,
    ScoredAnswer,
    problems,
)

#: what a row of answers has
ROW = ("problem", "answer", "value", "error", "unit")


class ProblemsDisplay(Result):
    """All problems, or the statement of one."""

    def __init__(self, chosen: Sequence[BenchmarkProblem]) -> None:
        self.chosen = chosen

    @property
    def title(self) -> str:
        return "Problems; `chemage benchmark NAME` states one"

    def facts(self) -> list[tuple[str, str]]:
        return [
            (one.name, f"{one.title}: {', '.join(one.answers)}")
            for one in self.chosen
        ]

    def tables(self) -> list[Table]:
        """The statement of one, and the rows to fill in."""
        if len(self.chosen) > 1:
            return []
        statement = [self.chosen[0].statement.rstrip()]
        title = "Rows of the CSV; give five digits or more"
        return [
            Table("", (), (), remarks=statement, in_detail=False),
            Table(title, ROW, self._empty(), in_detail=False),
        ]

    def numbers(self) -> dict[str, Any]:
        return {one.name: asdict(one) for one in self.chosen}

    def columns(self) -> dict[str, Any]:
        return dict(zip(ROW, zip(*self._empty(), strict=True), strict=True))

    def _empty(self) -> list[tuple[str, ...]]:
        """Rows to fill in."""
        return [
            (one.name, asked.name, "", "", asked.unit)
            for one in self.chosen
            for asked in one.answers.values()
        ]


class ScoreDisplay(Result):
    """Answers beside the references."""

    width = 120

    def __init__(self, name: str, answers: Sequence[ScoredAnswer]) -> None:
        self.file = name
        self.answers = answers

    @property
    def name(self) -> str:
        return self.file

    @property
    def title(self) -> str:
        return f"Answers to the benchmark: {self.name}"

    @property
    def answered(self) -> int:
        """Problems of which every number is given."""
        return sum(one in ("right", "wrong") for one in self.outcomes().values())

    def outcomes(self) -> dict[str, str]:
        """Problem -> "right", "wrong", "incomplete" or "not answered"."""
        found = {}
        for name, problem in problems().items():
            right = [one.right for one in self.answers if one.problem == name]
            if len(right) == len(problem.answers):
                found[name] = "right" if all(right) else "wrong"
            else:
                found[name] = "incomplete" if right else "not answered"
        return found

    def facts(self) -> list[tuple[str, str]]:
        found = self.outcomes()
        rows = [("answered", f"{self.answered} of {len(found)} problems")]
        for outcome in ("right", "wrong", "incomplete", "not answered"):
            names = [name for name, one in found.items() if one == outcome]
            if names:
                rows.append((outcome, f"{len(names)}: {', '.join(names)}"))
        rule = f"within {ALLOWED:g} standard errors of reference and answer, that of the answer at most {text.percent(OWN)}"
        return [*rows, ("right is", f"{rule}; of a problem all answers")]

    def tables(self) -> list[Table]:
        """Every answer."""
        rows = []
        for one in self.answers:
            known = one.reference
            reference = text.plus_minus(known.value, known.error)
            unit = "" if known.unit == "1" else known.unit
            row = one.problem, known.name, f"{one.value:.6g} {unit}", reference
            away = f"{one.per_cent:+.2g}", f"{one.in_errors:+.2g}"
            rows.append((*row, *away, "right" if one.right else "wrong"))
        columns = ("problem", "answer", "value", "reference ± its standard error")
        more = ("difference (%)", "in reference errors", "")
        return [Table("", [*columns, *more], rows, in_detail=False)]

    def numbers(self) -> dict[str, Any]:
        found = self.outcomes()
        return {
            "name": self.name,
            "answered": self.answered,
            "right": [*found.values()].count("right"),
            "problems": found,
            "answers": [self._row(one) for one in self.answers],
        }

    def columns(self) -> dict[str, Any]:
        rows = [self._row(one) for one in self.answers]
        return {name: [row[name] for row in rows] for name in (rows or [()])[0]}

    def _row(self, one: ScoredAnswer) -> dict[str, Any]:
        return {
            "problem": one.problem,
            "answer": one.reference.name,
            "value": one.value,
            "error": one.error,
            "unit": one.reference.unit,
            "reference": one.reference.value,
            "reference_error": one.reference.error,
            "per_cent": one.per_cent,
            "in_errors": one.in_errors,
            "right": one.right,
        }
