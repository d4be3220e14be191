"""The benchmark: both shipped sets of answers are right, wrong ones are not, and every message has a remedy."""

from __future__ import annotations

import csv
import importlib.resources
import json
import math

import problems as recomputed
import pytest

from chemage import InputError
from chemage_benchmark.display import ScoreDisplay
from chemage_benchmark.problems import ALLOWED, ScoredAnswer, problems, scored

SHIPPED = importlib.resources.files("chemage_benchmark") / "answers"
WAYS = ("chemage", "brute-force")
ASKED = [(name, one) for name, problem in problems().items() for one in problem.answers.values()]


def rows(way: str) -> dict[tuple[str, str], dict[str, str]]:
    with (SHIPPED / f"{way}.csv").open() as lines:
        return {(row["problem"], row["answer"]): row for row in csv.DictReader(lines)}


@pytest.mark.parametrize("way", WAYS)
def test_both_shipped_answers_are_right(way):
    found = ScoreDisplay(way, scored(SHIPPED / f"{way}.csv")).numbers()
    assert found["answered"] == found["right"] == 10


def test_references_are_those_of_both_methods():
    """The value without chemage, with both standard errors and that of five digits: all agree within three of these."""
    both = [rows(way) for way in ("brute-force", "chemage")]
    away = []
    for name, asked in ASKED:
        exact, own = (one[name, asked.name] for one in both)
        assert asked.value == pytest.approx(float(exact["value"]), rel=1e-8)
        digits = recomputed.DIGITS * asked.value
        error = math.hypot(float(exact["error"]), float(own["error"]), digits)
        assert asked.error == pytest.approx(error, rel=0.05)
        away.append(abs(float(own["value"]) - asked.value) / asked.error)
        assert 0 < asked.error < 0.02 * abs(asked.value)
        assert len(asked.methods) == 2
    assert max(away) < ALLOWED
    assert sorted(away)[len(away) // 2] < 1.5


@pytest.mark.parametrize(("name", "asked"), ASKED, ids=lambda one: getattr(one, "name", one))
def test_what_is_off_by_five_errors_or_a_factor_is_wrong(name, asked):
    assert ScoredAnswer(name, asked, asked.value + 2.9 * asked.error).right
    for value in (asked.value + 5 * asked.error, asked.value - 5 * asked.error, 2 * asked.value, 0.0):
        assert not ScoredAnswer(name, asked, value).right
    # a standard error of its own counts, but not one that makes everything right
    assert ScoredAnswer(name, asked, 1.02 * asked.value, 0.01 * asked.value).right
    assert not ScoredAnswer(name, asked, 1.5 * asked.value, asked.value).right


@pytest.mark.long
@pytest.mark.parametrize("number", range(1, 11))
@pytest.mark.parametrize("way", WAYS)
def test_answers_are_reproduced(way, number):
    """Other processors round otherwise: within half a standard error."""
    for name, (value, error) in recomputed.answers(way, number).items():
        shipped = rows(way)[f"ageing-{number}", name]
        assert value == pytest.approx(float(shipped["value"]), abs=0.5 * error, rel=1e-8)


@pytest.fixture
def call(command):
    """What ``chemage benchmark`` prints."""

    def printed(*arguments):
        found = command("benchmark", *arguments)
        assert found.status == 0, found.err
        return found.out

    return printed


def test_problems_are_listed_stated_and_filled_in(call, tmp_path):
    assert call().count("ageing-") == 10
    assert "3 x 3" in call("ageing-5")
    assert json.loads(call("ageing-5", "--json"))["ageing-5"]["answers"]["bonds_1s"]["value"] > 1
    file = tmp_path / "mine.csv"
    file.write_text(call("--csv"))
    assert "0 of 10" in call(file)
    one = problems()["ageing-1"].answers["area"]
    # other units; an answer of three
    text = file.read_text().replace("ageing-1,area,,,nm**2", f"ageing-1,area,{one.value * 1e-6},,um**2")
    file.write_text(text)
    found = json.loads(call(file, "--json"))
    assert found["problems"]["ageing-1"] == "incomplete"
    assert found["answers"][0]["right"]
    assert found["answers"][0]["value"] == pytest.approx(one.value)
    assert call(file, "--csv").splitlines()[0].startswith("problem,answer,value,error,unit,ref")


def test_a_wrong_number_makes_its_problem_wrong(tmp_path):
    file = tmp_path / "mine.csv"
    lines = (SHIPPED / "chemage.csv").read_text().splitlines()
    cells = lines[1].split(",")
    lines[1] = ",".join([*cells[:2], str(2 * float(cells[2])), *cells[3:]])
    file.write_text("\n".join(lines).replace(",", ";"))
    found = ScoreDisplay("mine", scored(file)).numbers()
    assert (found["answered"], found["right"]) == (10, 9)
    assert found["problems"]["ageing-1"] == "wrong"
    assert found["answers"][0]["per_cent"] == pytest.approx(100, abs=1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no column problem; give"),
        ("problem,answer\n", "no column value; give"),
        ("problem,answer,value,weight\n", "column 'weight'; give"),
        ("problem,answer,value,value\n", "column 'value'; give"),
        ("problem,answer,value\nageing-0,area,1\n", "line 2: no problem 'ageing-0'.*did you mean.*lists them"),
        ("problem,answer,value\nageing-1,aera,1\n", "ageing-1 asks for no 'aera'.*'area'.*its answers are area"),
        ("problem,answer,value\nageing-1,area,1 nm2\n", "value '1 nm2' is not a finite number; write"),
        ("problem,answer,value\nageing-1,area,inf\n", "not a finite number"),
        ("problem,answer,value,error\nageing-1,area,1,-1\n", "error -1 is negative; give"),
        ("problem,answer,value,unit\nageing-1,area,1,nm\n", r"unit 'nm' is not one of nm\*\*2; give nm"),
        ("problem,answer,value,unit\nageing-2,contact_fraction,1,nm\n", "unit 'nm' is not one of a pure number"),
        ("problem,answer,value\nageing-1,area\n", "line 2: another number of cells"),
        ("problem,answer,value\nageing-1,area,1,2\n", "line 2: another number of cells"),
        (
            "problem,answer,value\nageing-1,area,1\nageing-1,area,2\n",
            "line 3: ageing-1 area has a value already; leave",
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_said(tmp_path, text, message):
    file = tmp_path / "mine.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        scored(file)


def test_what_is_neither_a_problem_nor_a_file_is_said(command):
    found = command("benchmark", "ageing-11")
    assert found.status
    assert "no problem (did you mean 'ageing-1'?), and no file" in found.err
