"""A kind of result that the framework has never heard of is shown, drawn, compared and reported as any other."""

from __future__ import annotations

import ast
import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from seen import Table

import chemage as ca
from chemage.plugin import Panel, Picture, Result

SOURCES = Path(ca.__file__).parent
#: data classes of results, and the classes that show them
KINDS = {
    *("Run", "Ageing", "ContactSolution", "ContactStatistics", "Surface", "BondHistory", "SweepResult", "Point"),
    *("Ensemble", "Inference", "InferenceResult", "Forecast", "Arrhenius", "TradeMap"),
}
#: rooms in which contacts, histories and maps are arguments of a computation, and checks of what a plugin returns
COMPUTING = {"surfaces", "contacts", "kinetics", "friction", "ageing", "scene", "studies", "inference", "testing"}


class Grains(Result):
    """Grains of wear, counted in time."""

    errors = "counting errors"

    def __init__(self, name: str, counts: list[int]) -> None:
        self._name, self.counts = name, np.array(counts)

    @property
    def name(self) -> str:
        return self._name

    def rows(self) -> list[tuple[str, str]]:
        return [("grains at the end", f"{self.counts[-1]} <b>"), ("largest step", str(np.diff(self.counts).max()))]

    def numbers(self):
        return {"grains": int(self.counts[-1]), "each": self.counts.tolist()}

    def summary(self, beside=False):
        return [(f"{self.counts[-1]}", "grains at the end")]

    def notes(self):
        return ["grains below 10 nm are not seen"]

    def pictures(self):
        drawn = Panel(lambda axes, medium: axes.plot(self.counts), "Grains against time.")
        return {"grains": Picture((drawn,), title=self.name)}

    def tables(self):
        rows = [(str(time), str(count)) for time, count in enumerate(self.counts)]
        return [Table("Counts", ("time (s)", "grains"), rows, "Counts", in_detail=False)]

    def columns(self):
        return {"time (s)": range(self.counts.size), "grains": self.counts}

    def cite(self):
        return ["M. Counter, Grains, 1999"], ""


class GrainReader(ca.plugin.Reader):
    """Reads counts of grains, one a line."""

    kind = "grains"
    suffixes = (".grains",)

    def read(self, path):
        return Grains(Path(path).stem, [int(line) for line in Path(path).read_text().split()])


@pytest.fixture
def files(tmp_path, monkeypatch, isolated_registry):
    ca.register(GrainReader)
    monkeypatch.chdir(tmp_path)
    for name, counts in (("dry", [0, 3, 9]), ("wet", [0, 1, 2])):
        Path(f"{name}.grains").write_text("\n".join(map(str, counts)))
    return ["dry.grains", "wet.grains"]


def test_it_is_shown_as_text_json_and_csv(files, command):
    text = command("show", files[0]).out
    for words in ("dry", "grains at the end", "9 <b>", "Counts", "note: grains below 10 nm are not seen"):
        assert words in text
    assert json.loads(command("show", files[0], "--json").out) == {"grains": 9, "each": [0, 3, 9]}
    assert list(csv.reader(io.StringIO(command("show", files[0], "--csv").out)))[1:] == [
        ["0", "0"],
        ["1", "3"],
        ["2", "9"],
    ]
    assert "Counter" in command("cite", files[0], "--format", "text").out


def test_it_is_drawn_into_a_file_and_a_notebook(files, command):
    assert command("plot", files[0]).out == "dry-figures/grains.png\n"
    shown = Grains("dry", [0, 3])._repr_html_()
    assert "data:image/png" in shown
    assert "3 &lt;b&gt;" in shown


def test_it_stands_beside_others(files, command):
    lines = [line.split() for line in command("compare", *files).out.splitlines()]
    assert ["dry", "wet"] in lines
    assert ["largest", "step", "6", "1"] in lines
    told = json.loads(command("compare", *files, "--json").out)["results"]
    assert [(one["name"], one["grains"]) for one in told] == [("dry", 9), ("wet", 2)]
    table = list(csv.DictReader(io.StringIO(command("compare", *files, "--csv").out)))
    assert [row["grains"] for row in table] == ["9", "2"]


def test_it_stands_beside_kinds_that_are_built_in(files, command, examples):
    ca.write("ageing.h5", examples.ageing())
    rows = dict(ca.compare_files(["ageing.h5", files[0]]).table())
    assert rows["grains at the end"] == ["-", "9 <b>"]
    assert rows["engine"][1] == "-"
    assert command("report", "ageing.h5", files[0]).status == 0


def test_it_has_a_page(files, command):
    assert command("report", *files).status == 0
    page = Path("report.html").read_text()
    for words in ("Grains against time.", "9 &lt;b&gt;", "grains below 10 nm", "M. Counter, Grains, 1999"):
        assert words in page
    assert page.count("<svg ") == 2
    assert "Errors are counting errors." in page


def test_a_file_of_something_else_is_named(files, command, isolated_registry, monkeypatch):
    monkeypatch.setattr(GrainReader, "read", lambda self, path: 3)
    done = command("show", files[0])
    assert (done.status, done.out) == (2, "")
    assert "an int is no result" in done.err


def test_kinds_of_results_are_told_apart_in_three_places_at_most():
    """Everything else asks the result itself."""
    places = []
    for path in sorted(SOURCES.rglob("*.py")):
        if path.relative_to(SOURCES).parts[0] in COMPUTING and path.name != "display.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
                names = {getattr(part, "id", "") for part in ast.walk(node.args[1])}
                places += [f"{path.relative_to(SOURCES)}:{node.lineno}"] * bool(names & KINDS)
    assert len(places) <= 3, places
