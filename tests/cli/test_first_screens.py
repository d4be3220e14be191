"""What a user reads first of a result: few lines, the numbers that are looked for, each inside its own interval; and the
same numbers as JSON."""

from __future__ import annotations

import json
import re

import pytest

import chemage as ca

#: beginnings of the rows, in order
ROWS = (
    *("ageing rate per decade β", "friction coefficient drop Δμ at 100000 s", "friction drop ΔF at 100000 s"),
    *("contact area A", "area fraction A/A0", "mean contact pressure", "patches"),
)
SCATTER = "scatter of β between surfaces, relative"
MOST = 12


def screen(out):
    """The lines beside warnings, differing fields and remarks, none of them empty."""
    lines = out.splitlines()
    assert all(line.strip() for line in lines), "an empty line"
    return [line for line in lines if not line.startswith(("note: ", "  ", "Chemistry: ", "Other differences"))]


def labels(lines):
    return [re.split(" {2,}", line.strip())[0] for line in lines]


@pytest.fixture
def done(small, command):
    """The small rough contact, computed."""
    assert command("run", small, "--no-figures").status == 0
    return small.parent


def test_a_run_begins_with_what_is_looked_for_and_ends_with_its_files(small, command):
    lines = screen(command("run", small).out)
    assert len(lines) <= MOST
    assert lines[0].startswith("A small rough contact: 95 % intervals over replicas on one surface")
    assert labels(lines[1:]) == [*ROWS, SCATTER, "result", "figures"]
    assert [line.split() for line in lines[-2:]] == [["result", "small.h5"], ["figures", "small-figures"]]
    # a run and `show` have the same screen
    assert screen(command("show", "small.h5").out) == lines[:-2]


def test_everything_else_is_there_on_request(done, command):
    every = command("show", "small.h5", "--all").out
    for label in (
        *ROWS,
        SCATTER,
        "engine",
        "temperature",
        "cut-off time t_c",
        "contact area on the grid",
        "every ± is",
    ):
        assert label in every, label
    assert len(every.splitlines()) > 3 * MOST


def test_warnings_are_never_cut(small, command):
    """Nine thousand times its force a bond: the shear stress is beyond any strength; and an approximate engine."""
    weak = ["--set", "chemistry.shear_strength=1e-3", "--set", "chemistry.hardness=0.01"]
    out = command("run", small, "--no-figures", *weak).out
    assert len(screen(out)) <= MOST
    assert out.count("\nnote: ") == 2
    assert "of the shear strength of 0.001 GPa" in out


def test_a_comparison_has_one_screen_with_the_fields_that_differ(done, small, command):
    words = ["--set", "contact.load=80", "--set", "interaction.strength=0.1"]
    assert command("run", small, "--no-figures", "--out", "other.h5", *words).status == 0
    out = command("compare", "small.h5", "other.h5").out
    lines = screen(out)
    assert len(lines) <= MOST
    assert lines[0].split()[-2:] == ["small", "other"]
    assert labels(lines[1:]) == [*ROWS, SCATTER]
    assert "  interaction.strength: 0.5 | 0.1\n" in out
    assert "  contact.load: 40.0 | 80.0\n" in out
    for file, place in (("small.h5", 1), ("other.h5", 2)):
        area = ca.read(file).contact.quantity("area")
        assert re.split(" {2,}", lines[4].strip())[place] == area.but(reason="").text()
    every = command("compare", "small.h5", "other.h5", "--all").out
    assert "friction drop ΔF at 1 s" in every
    assert "bonds per contact area" in every


def test_a_mean_begins_alike(small, command):
    lines = screen(command("run", small, "--surfaces", 3).out)
    assert len(lines) <= MOST
    assert lines[0].startswith("A small rough contact: 95 % intervals with the scatter between surfaces")
    assert labels(lines[1:]) == [*ROWS, SCATTER, "result", "samples", "figures"]
    assert "(measured here on 3)" in lines[8]
    assert screen(command("show", "small.h5").out) == lines[:9]


def test_what_was_asked_of_a_mean_is_on_its_screen(small, command):
    lines = screen(command("run", small, "--accuracy", "kappa=60%", "--accuracy", "friction_drop@10 s=60%").out)
    assert labels(lines[1:]) == [
        *ROWS,
        SCATTER,
        "area-load coefficient κ",
        "friction drop ΔF at 10 s",
        *labels(lines[-3:]),
    ]


def test_the_first_table_of_a_report_is_the_same(done, command):
    rows = [line.strip() for line in screen(command("show", "small.h5").out)[1:]]
    assert command("report", "small.h5").status == 0
    page = (done / "report.html").read_text(encoding="utf-8")
    table = page[page.index("<table") : page.index("</table>")]
    cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", table)[2:]
    assert [tuple(re.split(" {2,}", row)) for row in rows] == list(zip(cells[::2], cells[1::2], strict=True))


@pytest.mark.parametrize("load", [5, 40, 400, 4000])
def test_every_number_shown_first_is_inside_its_own_interval(small, command, load):
    """The area on the grid lies outside: pixels at the rim count as a whole."""
    out = command("run", small, "--no-figures", "--set", f"contact.load={load}").out
    shown = json.loads(command("show", "small.h5", "--json").out)
    first = ("beta", "area", "area_fraction", "mean_contact_pressure", "kappa")
    for name in first:
        assert shown[name]["low"] <= shown[name]["value"] <= shown[name]["high"], name
    for name in ("friction_drop", "friction_coefficient_drop"):
        for low, value, high in zip(*(shown[name][part] for part in ("low", "value", "high")), strict=True):
            assert low is high is None or low <= value <= high  # replicas that are all equal have no interval
    contact, area = ca.read("small.h5").contact, shown["area"]
    assert area["value"] == pytest.approx((area["low"] + area["high"]) / 2)
    assert shown["grid_area"]["value"] == contact.area == contact.sites.size * contact.pixel_size**2
    if contact.area_fraction < 1:
        assert area["high"] < contact.area
        assert f"({float(f'{contact.area:.4g}'):g} on the grid)" in out
    # what follows from the area
    assert shown["area_fraction"]["value"] == pytest.approx(area["value"] / contact.nominal_area)
    assert shown["mean_contact_pressure"]["value"] == pytest.approx(load / area["value"])
    assert shown["kappa"]["value"] == pytest.approx(area["value"] * contact.rms_slope * contact.modulus / load)
    # what is counted stays as it is
    assert shown["perimeter_to_area"]["value"] == contact.perimeter / contact.area
    bonds = shown["bonds"]["value"][-1] / contact.area
    assert shown["bonds_per_area"]["value"][-1] == pytest.approx(bonds)


def test_a_tip_that_covers_its_area_without_bias_says_nothing_of_the_grid(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = command("run", "silica-tip", "--no-figures", "--replicas", 3).out
    assert len(screen(out)) <= MOST
    assert "on the grid" not in out
    assert SCATTER not in out


# -- JSON -------------------------------------------------------------------------------------------------------------

#: what a number has
PARTS = {"value", "unit", "low", "high"}
#: names of the same number in flat tables
FLAT = re.compile(r".*_(stderr|half_width|low|high)")


def check_numbers(numbers, names):
    """Every top-level number has its parts, and one name."""
    for name in names:
        assert set(numbers[name]) >= PARTS, name
    for name, value in numbers.items():
        assert not isinstance(value, int | float) or isinstance(value, bool), f"{name} is a bare number"
        assert not FLAT.fullmatch(name), name
        if isinstance(value, dict) and "value" in value:
            assert set(value) <= PARTS | {"level", "reason"}, name
            assert isinstance(value["unit"], str), name
            assert value["unit"], name


def test_json_of_runs_and_means_has_value_unit_low_and_high_of_every_number(small, command):
    names = (
        "beta",
        "b",
        "cutoff_time",
        "friction_drop",
        "friction_coefficient_drop",
        "area",
        "patches",
        "load",
        "replicas",
    )
    run = json.loads(command("run", small, "--no-figures", "--json").out)
    check_numbers(run, (*names, "sites", "events", "bonds_per_area", "beta_scatter_between_surfaces", "hold_time"))
    mean = json.loads(command("run", small, "--surfaces", 3, "--no-figures", "--json", "--out", "mean.h5").out)
    assert mean.pop("samples_taken") == 0  # a count of files
    check_numbers(mean, (*names[:2], *names[3:], "beta_scatter_between_surfaces", "hold_time"))
    for numbers in (run, mean):
        assert (numbers["friction_drop"]["unit"], numbers["area"]["unit"], numbers["beta"]["unit"]) == (
            "nN",
            "nm2",
            "1",
        )
        assert len(numbers["friction_drop"]["value"]) == len(numbers["hold_time"]["value"])
    beta = ca.read("small.h5").fit()
    assert [run["beta"][part] for part in ("value", "low", "high")] == [beta.beta, *beta.beta_interval]


def test_json_of_a_contact_a_history_of_bonds_and_a_comparison(done, small, command):
    result = ca.read("small.h5")
    ca.write("contact.h5", result.contact)
    ca.write("ageing.h5", result.ageing)
    check_numbers(
        json.loads(command("show", "contact.h5", "--json").out), ("area", "kappa", "max_pressure", "pressures")
    )
    check_numbers(json.loads(command("show", "ageing.h5", "--json").out), ("beta", "area", "friction_drop"))
    told = json.loads(command("compare", "small.h5", "ageing.h5", "--json").out)
    for one in told["results"]:
        check_numbers(one, ("beta", "area"))
        for moment in one["at"]:
            check_numbers(moment, ("time", "friction_drop", "bonds_per_area"))
    # the area is one number everywhere
    assert len({one["area"]["value"] for one in told["results"]}) == 1


def test_json_of_a_sweep(small, command):
    small.write_text(small.read_text() + '[sweep]\n"contact.load" = [20, 40]\n')
    assert command("run", small).status == 0
    told = json.loads(command("show", "small-sweep", "--json").out)
    for point in told["results"]:
        point.pop("point")
        check_numbers(point, ("beta", "area", "patches", "last_friction_drop"))
    for number in range(2):
        run = json.loads(command("show", f"small-sweep/{number}", "--json").out)
        for name in ("area", "kappa", "mean_contact_pressure"):
            assert told["results"][number][name]["value"] == run[name]["value"]


def test_check_says_what_is_wrong_as_json_too(small, command):
    good = command("check", small, "--json")
    assert (good.status, json.loads(good.out)["valid"]) == (0, True)
    for words, field in (
        (["--set", "surface.hurst=7"], "surface.hurst"),
        (["--set", "surface.hurts=0.7"], "surface.hurts"),
    ):
        done = command("check", small, "--json", *words)
        told = json.loads(done.out)
        assert (done.status, told["valid"]) == (2, False)
        assert [one["field"] for one in told["problems"]] == [field]
        assert told["error"] in done.err
    missing = command("check", "nowhere.toml", "--json")
    assert missing.status == 2
    assert "nowhere.toml" in json.loads(missing.out)["error"]
    small.write_text(small.read_text() + '[sweep]\n"surface.hurst" = [0.8, 7]\n')
    assert json.loads(command("check", small, "--json").out)["valid"] is False
