"""The problems with their reference answers, and how answers are read and judged."""

from __future__ import annotations

import csv
import io
import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

from chemage import InputError
from chemage.plugin import UnitError, convert, nearest, tables

#: combined standard errors within which an answer is right, and the part of the reference that its own counts at most
ALLOWED, OWN = 3.0, 0.01
#: columns that are needed, and others
COLUMNS, MORE = ("problem", "answer", "value"), ("error", "unit")


@dataclass(frozen=True)
class ReferenceAnswer:
    """A number that a problem asks for."""

    name: str
    unit: str
    value: float
    #: standard error, of both methods and of an answer with five digits together
    error: float
    #: two independent ones by which it was found
    methods: tuple[str, str]


@dataclass(frozen=True)
class BenchmarkProblem:
    """A problem that is specified exactly."""

    name: str
    title: str
    statement: str
    answers: dict[str, ReferenceAnswer]


@dataclass(frozen=True)
class ScoredAnswer:
    """An answer beside its reference."""

    problem: str
    reference: ReferenceAnswer
    value: float
    #: its own standard error; 0 where none is given
    error: float = 0.0

    @property
    def per_cent(self) -> float:
        """Difference from the reference."""
        return 100 * (self.value / self.reference.value - 1)

    @property
    def in_errors(self) -> float:
        """Difference in standard errors of the reference."""
        return (self.value - self.reference.value) / self.reference.error

    @property
    def right(self) -> bool:
        """Whether both agree within :data:`ALLOWED` standard errors; an own one of more than :data:`OWN` counts as that."""
        own = min(self.error, OWN * abs(self.reference.value))
        both = math.hypot(self.reference.error, own)
        return abs(self.value - self.reference.value) <= ALLOWED * both


@cache
def problems() -> dict[str, BenchmarkProblem]:
    """All of them by name."""
    found = {}
    for number in range(1, 11):
        name = f"ageing-{number}"
        file = f"problems/{name}.toml"
        text = (
            resources.files("chemage_benchmark").joinpath(file).read_text("utf-8")
        )
        data = tomllib.loads(text)
        answers = [ReferenceAnswer(**one) for one in data.pop("answer")]
        by_name = {one.name: one for one in answers}
        found[name] = BenchmarkProblem(name=name, answers=by_name, **data)
    return found


def scored(file: Path) -> list[ScoredAnswer]:
    """Read the answers of a CSV; rows without a value are not answered.

    Raises
    ------
    InputError
        A column or row is wrong; it names the line.
    """
    text = tables.read_text(file)
    # spreadsheets write semicolons
    mark = tables.separator_of(text.partition("\n")[0]) or ","
    rows = csv.DictReader(io.StringIO(text), delimiter=mark)
    rows.fieldnames = columns = [name.strip() for name in rows.fieldnames or ()]
    wrong = [f"no column {name}" for name in COLUMNS if name not in columns]
    for name in columns:
        if name not in (*COLUMNS, *MORE) or columns.count(name) > 1:
            wrong.append(f"column {name!r}")
    if wrong:
        raise InputError(
            f"{file}: {wrong[0]}; give problem, answer, value and, where they are known, error and unit, each once "
            "(`chemage benchmark --csv` prints the rows)"
        )
    found: dict[tuple[str, str], ScoredAnswer] = {}
    try:
        for row in rows:
            if (one := _answer(row)) is None:
                continue
            place = one.problem, one.reference.name
            if place in found:
                raise InputError(
                    f"{' '.join(place)} has a value already; leave one"
                )
            found[place] = one
    except (csv.Error, InputError) as error:
        raise InputError(f"{file}, line {rows.line_num}: {error}") from None
    return [*found.values()]


def _answer(row: dict[str, str]) -> ScoredAnswer | None:
    if None in row or None in row.values():
        raise InputError(
            "another number of cells than the first line; give one for each column"
        )
    cells = {name: text.strip() for name, text in row.items()}
    if not cells["value"]:
        return None
    known = problems()
    if (name := cells["problem"]) not in known:
        raise InputError(
            f"no problem {name!r}{nearest(name, [*known])}; `chemage benchmark` lists them"
        )
    answers = known[name].answers
    if (asked := cells["answer"]) not in answers:
        raise InputError(
            f"{name} asks for no {asked!r}{nearest(asked, [*answers])}; its answers are {', '.join(answers)}"
        )
    reference = answers[asked]
    numbers = [
        _number(one, cells.get(one) or "0", cells.get("unit", ""), reference.unit)
        for one in ("value", "error")
    ]
    if numbers[1] < 0:
        raise InputError(
            f"error {cells['error']} is negative; give a standard error"
        )
    return ScoredAnswer(name, reference, *numbers)


def _number(name: str, cell: str, unit: str, wanted: str) -> float:
    try:
        number = float(cell)
        if not math.isfinite(number):
            raise ValueError
    except ValueError:
        raise InputError(
            f"{name} {cell!r} is not a finite number; write 1.5 or 1.5e3, and units in the column unit"
        ) from None
    if unit in ("", wanted):
        return number
    try:
        return convert(f"{cell} {unit}", "" if wanted == "1" else wanted)
    except UnitError:
        what = "a pure number" if wanted == "1" else wanted
        raise InputError(
            f"unit {unit!r} is not one of {what}; give {wanted}, or leave it empty"
        ) from None
