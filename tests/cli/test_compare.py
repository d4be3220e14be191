"""``chemage compare``: tables, CSV, JSON, figures, measurements, and user errors as one message each."""

from __future__ import annotations

import csv
import io
import json

import pytest

TABLE = (
    "hold_time (s), friction_coefficient_drop, error\n1,0.2,0.05\n10,0.8,0.05\n100,1.5,0.05\n1e3,2.2,0.1\n1e4,2.7,0.1\n"
)


@pytest.fixture(scope="module")
def made():
    """File name -> content, of what :func:`two` made the first time."""
    return {}


@pytest.fixture
def two(small, command, made):
    """Two result files of one scene under two loads."""
    for load in (40, 80):
        name = f"at{load}.h5"
        if name not in made:
            done = command("run", small, "--no-figures", "--out", name, "--set", f"contact.load={load}")
            assert done.status == 0, done.err
            made[name] = (small.parent / name).read_bytes()
        (small.parent / name).write_bytes(made[name])
    return small.parent


def test_a_table_names_every_file_and_says_whether_the_chemistry_is_the_same(two, command):
    done = command("compare", "at40.h5", "at80.h5")
    assert done.status == 0
    assert done.err == ""
    head = done.out.splitlines()[0].split()
    assert head == ["more:", "--all", "at40", "at80"]
    assert "Chemistry: the same in all results." in done.out
    assert "  contact.load: 40.0 | 80.0\n" in done.out
    every = command("compare", "at40.h5", "at80.h5", "--all").out
    assert every.splitlines()[1].split() == ["at40", "at80"]
    for label in ("load", "friction drop ΔF at 1 s", "bonds per contact area", "ageing rate per decade β"):
        assert label in every
    line = next(line for line in every.splitlines() if line.split()[:1] == ["load"])
    assert line.split() == ["load", "40", "nN", "80", "nN"]


def test_no_simulation_is_called_measured(two, command):
    assert "offset" in command("compare", "at40.h5", "at80.h5", "--all").out
    for how in ((), ("--json",), ("--all",)):
        assert "measured" not in command("compare", "at40.h5", "at80.h5", *how).out


def test_the_fields_that_differ_are_listed_with_both_values(two, small, command):
    command("run", small, "--no-figures", "--out", "strong.h5", "--set", "interaction.strength=0.1", "--seed", 1)
    out = command("compare", "at40.h5", "strong.h5").out
    assert "Chemistry: differs in interaction.strength." in out
    assert "interaction.strength: 0.5 | 0.1" in out


def test_many_results_are_told_four_at_a_time(two, command):
    names = []
    for number in range(5):
        names.append(f"copy{number}.h5")
        (two / names[-1]).write_bytes((two / f"at{40 if number < 4 else 80}.h5").read_bytes())
    lines = [line.split() for line in command("compare", *names, "--all").out.splitlines()]
    assert ["copy0", "copy1", "copy2", "copy3"] in lines
    assert lines.index(["copy4"]) > lines.index(["load", *["40", "nN"] * 4])
    assert ["load", "80", "nN"] in lines


def test_json_and_csv_are_one_document_each(two, command):
    told = json.loads(command("compare", "at40.h5", "at80.h5", "--json", "--at", "1 min").out)
    assert told["same_chemistry"] is True
    assert [one["load"]["value"] for one in told["results"]] == [40, 80]
    assert [one["time"]["value"] for one in told["results"][0]["at"]] == [60, 1e5]
    rows = list(csv.DictReader(io.StringIO(command("compare", "at40.h5", "at80.h5", "--csv").out)))
    assert [float(row["load (nN)"]) for row in rows] == [40, 80]
    alone = json.loads(command("show", "at80.h5", "--json").out)
    assert float(rows[1]["beta"]) == alone["beta"]["value"]


def test_a_name_that_a_spreadsheet_would_compute_is_a_text_in_csv(two, command):
    (two / "=1+1.h5").write_bytes((two / "at40.h5").read_bytes())
    names, cells, _ = csv.reader(io.StringIO(command("compare", "=1+1.h5", "at80.h5", "--csv").out))
    assert cells[names.index("name")] == "'=1+1"
    assert not [cell for cell in cells if cell.startswith("=")]


@pytest.mark.long
def test_figures_and_measurements_are_drawn_and_fitted(two, command):
    (two / "afm.csv").write_text(TABLE, encoding="utf-8")
    done = command("compare", "at40.h5", "at80.h5", "--measured", "afm.csv", "--figures", "out", "--format", "svg")
    assert done.status == 0, done.err
    names = sorted(path.name for path in (two / "out").iterdir())
    assert names == [
        "barriers.svg",
        "bonds-per-area.svg",
        "friction-coefficient-drop.svg",
        "friction-drop.svg",
        "pressures.svg",
    ]
    assert all(f"out/{name}" in done.out for name in names)
    assert done.out.count("Δμ = β log10(1 + t/t_c)") == 3
    again = command("compare", "at40.h5", "at80.h5", "--figures", "out", "--format", "svg")
    assert again.status == 2
    assert "already there" in again.err
    assert command("compare", "at40.h5", "at80.h5", "--figures", "out", "--format", "svg", "--force").status == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nowhere.h5",), "nowhere.h5 does not exist"),
        (("at40.h5", "at40.h5"), "given twice"),
        (("at40.h5", "--json", "--csv"), "choose one"),
        (("at40.h5", "--figures", "f", "--format", "bmp"), "choose png, pdf or svg"),
        (("at40.h5", "--at", "1 nm"), "nanometer"),
        (("at40.h5", "--at", "0 s"), "must be above zero"),
        (("at40.h5", "--measured", "bad.csv"), "line 3, column hold_time: -1 is negative"),
        (("at40.h5", "--measured", "none.csv"), "none.csv does not exist"),
        (("at40.h5", "--measured", "rise.csv", "--offset", "0.1"), "is a rise already; leave offset out"),
        (("at40.h5", "--measured", "rise.csv", "--sheet", "wet"), "has no sheets"),
        (("at40.h5", "--figures", "at80.h5"), "cannot make the folder at80.h5"),
        (("small.toml",), "no reader for files ending in '.toml'"),
    ],
)
def test_user_errors_are_one_message_and_status_2(two, command, words, message):
    (two / "bad.csv").write_text("hold_time (s), friction_coefficient_drop\n2,1\n-1,1\n", encoding="utf-8")
    (two / "rise.csv").write_text(TABLE, encoding="utf-8")
    before = sorted(path.name for path in two.iterdir())
    done = command("compare", *words)
    assert done.status == 2
    assert message in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert sorted(path.name for path in two.iterdir()) == before
