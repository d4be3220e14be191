"""Rows of published numbers, each with its test, its prediction and a verdict by rule; rows.toml has the numbers."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from typing import Any

import numpy as np

from chemage import InputError, Run, load_scene, run
from chemage.plugin import ClaimTest, Limits, Quantity, decisions
from chemage_validation import measures

#: words of tests -> verdicts
VERDICTS = {
    decisions.PREDICTED: "held out and right",
    decisions.CALIBRATED: "calibrated",
    decisions.DISAGREES: "wrong",
    decisions.CANNOT: "cannot tell",
}
NOT_AVAILABLE = "number not available"
#: steps from the published number to a rival, in which is looked for the least error that is refused
STEPS = 20
#: what a list of hold times replaces, and a history of steps
RANGE = dict.fromkeys(("hold.start", "hold.stop", "hold.per_decade"))
REPLACED = {
    "hold.times": RANGE,
    "step": {**RANGE, **dict.fromkeys(("fit", "observe"))},
}

DATA: dict[str, Any] = tomllib.loads(
    resources.files(__package__ or "").joinpath("rows.toml").read_text("utf-8")
)


@dataclass(frozen=True, kw_only=True)
class PublishedRow:
    """A published number, and how it is predicted."""

    name: str
    sentence: str
    published: str
    error: str = "not stated"
    #: key of ``[sources]``
    source: str
    #: key of ``[sets]``; "": there is nothing to predict
    set: str = ""
    #: changes of its scene, one for each case
    cases: Sequence[Mapping[str, Any]] = ({},)
    observe: str = ""
    compare: str = "value"
    #: what is compared, in words
    number: str = ""
    claimed: float = math.nan
    rivals: Mapping[str, float] = field(default_factory=dict)
    #: why the test cannot decide about the number
    beyond: str = ""
    #: why there is no number
    unavailable: str = ""

    @property
    def cited(self) -> tuple[str, str]:
        """Its source, and the DOI or address of that."""
        source = DATA["sources"][self.source]
        return source["text"], source["doi"]

    @property
    def used(self) -> Sequence[str]:
        """The rows from which its set of parameters was made."""
        return DATA["sets"][self.set]["used"] if self.set else ()

    @property
    def calibrated(self) -> bool:
        """Whether its set of parameters was made from it."""
        return self.name in self.used

    @property
    def limits(self) -> Limits:
        """Half way to the nearest rivals."""
        halves = [(self.claimed + rival) / 2 for rival in self.rivals.values()]
        low = max((x for x in halves if x < self.claimed), default=-math.inf)
        high = min((x for x in halves if x > self.claimed), default=math.inf)
        return Limits(self.number, low, high)

    def test(self, values: np.ndarray) -> ClaimTest:
        """The test of its number with values (samples, k)."""
        compared = measures.COMPARISONS[self.compare]
        middle = values.mean(axis=0)
        return ClaimTest(
            values,
            lambda found: [compared.number(found)],
            lambda numbers: compared.values(numbers[0], middle),
            limits=[self.limits],
            claimed=[self.claimed],
            rivals={name: [rival] for name, rival in self.rivals.items()},
        )


ROWS = tuple(PublishedRow(**row) for row in DATA["rows"])


@dataclass(frozen=True)
class ValidatedRow:
    """A row with what was computed for it."""

    row: PublishedRow
    test: ClaimTest | None = None
    #: why what was computed is no answer; "": it is one
    doubt: str = ""

    @cached_property
    def verdict(self) -> str:
        """One of five, by rule."""
        if self.row.unavailable:
            return NOT_AVAILABLE
        if self.test is None or self.row.beyond or self.doubt:
            return VERDICTS[decisions.CANNOT]
        return VERDICTS[self.test.word(calibrated=self.row.calibrated)]

    @cached_property
    def reason(self) -> str:
        """Why there is no verdict; "" where there is one."""
        given = self.row.beyond or self.row.unavailable or self.doubt
        if given or self.test is None or self.verdict != VERDICTS[decisions.CANNOT]:
            return given
        return self.test.remedy

    @cached_property
    def prediction(self) -> Quantity:
        """The number with a 95 % interval of its samples."""
        words = self.row.number or self.row.sentence
        empty = Quantity("prediction", "1", words, stated="ends", reason="none")
        if self.test is None:
            return empty
        drawn = self.test.drawn(self.test.values.mean(axis=0))
        low, high = np.nanquantile(drawn, [0.025, 0.975])
        (value,) = self.test.numbers(self.test.values)
        return empty.but(value=float(value), reason="").within(
            float(low), float(high)
        )

    @cached_property
    def refused(self) -> dict[str, float]:
        """Towards each rival the number from which the test refuses a model in 80 %; nan if it never does."""
        found = {}
        if self.test is None:
            return found
        for name, rival in self.row.rivals.items():
            found[name] = math.nan
            for number in np.linspace(self.row.claimed, rival, STEPS + 1):
                if self.test.refused(self.test.truth([number])) >= decisions.POWER:
                    found[name] = float(number)
                    break
        return found


@dataclass(frozen=True)
class Validation:
    """All rows."""

    rows: Sequence[ValidatedRow]


def _samples(row: PublishedRow, known: dict[str, Run]) -> tuple[np.ndarray, str]:
    """Values (samples, k) of a row, and why they are no answer; ``known`` keeps runs that other rows need."""
    where = DATA["sets"][row.set]
    observe = getattr(measures, row.observe)
    found, doubts = [], {}
    # without surfaces the samples are groups of replicas
    for seed in range(1, where.get("surfaces", 0) + 1) or [None]:
        runs = []
        for case in row.cases:
            changes = {**where.get("change", {}), **case}
            if seed is not None:
                changes["surface.seed"] = seed
            for name, replaced in REPLACED.items():
                if name in changes:
                    changes = {**replaced, **changes}
            key = json.dumps([where["scene"], changes], sort_keys=True)
            if key not in known:
                known[key] = run(load_scene(where["scene"], changes), warn=False)
            runs.append(known[key])
            doubts[measures.unsteady(known[key])] = None
        pairs = [runs] if row.observe == "activation" else [[one] for one in runs]
        values = [observe(*pair) for pair in pairs]
        if seed is not None:
            values = [one.mean(axis=0, keepdims=True) for one in values]
        found.append(np.concatenate(values, axis=1))
    return np.concatenate(found), "; ".join(filter(None, doubts))


def validate(
    names: Sequence[str] = (), report: Callable[[int, int], None] | None = None
) -> Validation:
    """Predict the published numbers, or those called ``names``, and judge each by rule.

    Raises
    ------
    InputError
        There is no such row.
    """
    known = [row.name for row in ROWS]
    if missing := [name for name in names if name not in known]:
        raise InputError(f"row: {missing[0]!r}; there are {', '.join(known)}")
    chosen = [row for row in ROWS if not names or row.name in names]
    runs, found = {}, []
    for number, row in enumerate(chosen):
        if report is not None:
            report(number, len(chosen))
        if not row.observe:
            found.append(ValidatedRow(row))
            continue
        values, doubt = _samples(row, runs)
        found.append(ValidatedRow(row, row.test(values), doubt))
    return Validation(found)
