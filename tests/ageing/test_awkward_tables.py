"""Tables as instruments, spreadsheets and students write them: read to the numbers that they mean, or refused."""

from __future__ import annotations

import datetime
import math

import numpy as np
import pytest

import chemage as ca

TIMES = np.array([0.01, 1, 100, 1000, 10000])
VALUES = np.array([12.5, 25.25, 40, 51.5, 60.75])
ERRORS = np.array([0.5, 0.75, 1.125, 1.5, 2])
#: of each row
REPLICATES = VALUES[:, None] + ERRORS[:, None] * np.array([-1, 0.5, 2, -1.5])


def text(header, *columns, mark=";", decimal=".", form="{:.12g}", after=""):
    """A table with these columns of numbers or texts."""
    rows = [
        mark.join(x if isinstance(x, str) else form.format(x).replace(".", decimal) for x in row)
        for row in zip(*columns, strict=True)
    ]
    return "\n".join([header, *rows]) + "\n" + after


def spelled(form, *columns, decimal="."):
    return [form.format(*row).replace(".", decimal) for row in zip(*columns, strict=True)]


def book(path, sheets, merged=()):
    """An Excel file: title -> rows; ``merged`` ranges of the last sheet."""
    openpyxl = pytest.importorskip("openpyxl")
    made = openpyxl.Workbook()
    made.remove(made.active)
    for title, rows in sheets.items():
        sheet = made.create_sheet(title)
        for row in rows:
            sheet.append(row)
    for part in merged:
        made.worksheets[-1].merge_cells(part)
    made.save(path)


ROWS = [list(row) for row in zip(TIMES, VALUES, ERRORS, strict=True)]
SEM = REPLICATES.std(axis=1, ddof=1) / 2
MEAN = REPLICATES.mean(axis=1)
#: name -> table, arguments, and what differs from TIMES, VALUES and ERRORS
READ = {
    "German Excel": (
        text("Haltezeit [s];Reibkraftzunahme [nN];Standardfehler [nN];Normalkraft [nN];Temperatur [°C]",
             TIMES, VALUES, ERRORS, [50.0] * 5, [26.85] * 5, decimal=",").encode("utf-8-sig"), {}, {}),
    "German Excel, text with tabs": (
        text("Kontaktzeit (s)\tÄnderung der Reibkraft (nN)\tUnsicherheit (nN)", TIMES, VALUES, ERRORS, mark="\t",
             decimal=",").encode("utf-16"), {}, {}),
    "German code page, minutes": (
        text("Wartezeit (Min.);delta F (nN);±", TIMES / 60, VALUES, ERRORS, decimal=",", form="{:.17g}").encode("cp1252"),
        {}, {}),
    "units in a second row": (
        text("Zeit;Reibungszunahme;Messfehler\ns;µN;µN", TIMES, VALUES / 1e3, ERRORS / 1e3), {}, {}),
    "two header rows, an empty cell for the merged one": (
        text("hold time (s),friction drop (nN),\n,mean,SEM", TIMES, VALUES, ERRORS, mark=","), {}, {}),
    "names, parts and units below each other": (
        text("t;Friction drop;;load\n;average;std. error;\ns;nN;nN;nN", TIMES, VALUES, ERRORS, [50.0] * 5), {}, {}),
    "log10(t/s)": (text("log10(t/s), ΔF (nN), error (nN)", np.log10(TIMES), VALUES, ERRORS, mark=","), {}, {}),
    "units after in": (text("Zeit in s;Zunahme der Reibung in nN;Std.Abw. in nN;n", TIMES, VALUES, 2 * ERRORS, [4.0] * 5),
                       {}, {}),
    "lg t, German": (
        text("lg t [s];Reibkraftanstieg [nN];Fehler [nN]", np.log10(TIMES), VALUES, ERRORS, decimal=","), {}, {}),
    "log10 of minutes": (
        text("log₁₀(hold time (min));ΔF (nN);σ (nN)", np.log10(TIMES / 60), VALUES, ERRORS, form="{:.17g}"), {}, {}),
    "ln t beside t": (
        text("t (s);ln(t/s);ΔF (nN);σ (nN)", TIMES, np.log(TIMES), VALUES, ERRORS), {}, {}),
    "errors up and down": (
        text("hold time (s);friction drop (nN);error + (nN);error - (nN)", TIMES, VALUES, 1.2 * ERRORS, 0.8 * ERRORS),
        {}, {}),
    "errors up and down in the cell": (
        text("hold time (s);friction drop (nN)", TIMES, spelled("{:g} +{:g}/-{:g}", VALUES, 1.5 * ERRORS, ERRORS / 2)),
        {}, {}),
    "limits of 95 %": (
        text("t (s), ΔF (nN), 95 % upper (nN), 95 % lower (nN)", TIMES, VALUES, VALUES + 1.959963984540054 * ERRORS,
             VALUES - 1.959963984540054 * ERRORS, mark=",", form="{:.17g}"), {}, {}),
    "two sigma": (text("t (s), ΔF (nN), 2σ error (nN)", TIMES, VALUES, 2 * ERRORS, mark=","), {}, {}),
    "± in a cell with its unit": (
        text("hold time;friction drop", spelled("{:g} s", TIMES), spelled("({:g} ± {:g}) nN", VALUES, ERRORS)), {}, {}),
    "± in a cell, German": (
        text("Haltezeit (s);Reibungszunahme (nN)", TIMES, spelled("{:g} +/- {:g}", VALUES, ERRORS, decimal=","),
             decimal=","), {}, {}),
    "± of two standard errors in a cell": (
        text("t (s);ΔF ± 2 SE (nN)", TIMES, spelled("{:g} ± {:g}", VALUES, 2 * ERRORS)), {}, {}),
    "± in % in a cell, blanks": (
        text("t (s)   ΔF (nN)", TIMES, spelled("{:g} ± {:.15g}%", VALUES, 100 * ERRORS / VALUES), mark="   "), {}, {}),
    "errors of the last digits": (
        text("t (s);ΔF (nN)", TIMES, spelled("{:.3f}({:.0f})", VALUES, 1000 * ERRORS)), {}, {}),
    "replicates": (
        text("t (s);ΔF 1 (nN);ΔF 2 (nN);ΔF 3 (nN);ΔF 4 (nN)", TIMES, *REPLICATES.T), {}, {"values": MEAN, "errors": SEM}),
    "replicates with their mean": (
        text("t (s);ΔF1 (nN);ΔF2 (nN);ΔF3 (nN);ΔF4 (nN);mean;std", TIMES, *REPLICATES.T, MEAN, 2 * SEM), {},
        {"values": MEAN, "errors": SEM}),
    "replicates, some missing": (
        text("t;ΔF run 1;ΔF run 2;ΔF run 3\ns;nN;nN;nN", TIMES, VALUES - 1, VALUES + 1, ["", "-", "n/a", "", "NaN"]), {},
        {"errors": np.ones(5)}),
    "standard deviation and number": (
        text("t (s);ΔF (nN);std (nN);n", TIMES, VALUES, 3 * ERRORS, [9.0] * 5), {}, {}),
    "markers of what is missing": (
        text("t (s);ΔF (nN);error (nN)", [*TIMES, 2e4, 3e4, 4e4, 5e4], [*VALUES, "NaN", "n.a.", "#DIV/0!", ""],
             [*ERRORS, "NaN", "", "1", ""]), {}, {}),
    "footnotes": (
        text("t (s);ΔF (nN);error (nN)", TIMES, [*spelled("{:g}", VALUES)[:3], "51.5*", "60.75†"], ERRORS,
             after="\n* new tip; other sample\n† see the lab book\n"), {}, {}),
    "relative errors": (
        text("t (s);ΔF (nN);rel. error (%)", TIMES, VALUES, 100 * ERRORS / VALUES, form="{:.17g}"), {}, {}),
    "hours": (text("Haltezeit (Std);ΔF (µN);Fehler (nN)", TIMES / 3600, VALUES / 1e3, ERRORS, form="{:.17g}"), {}, {}),
    "a clock": (
        text("hold time;ΔF (nN);error (nN)", ["0:00:00.01", "00:00:01", "00:01:40", "0:16:40", "2:46:40"], VALUES,
             ERRORS), {}, {}),
    "powers of ten": (
        text("t (s);ΔF (nN);error (nN)", ["10^-2", "10⁰", "1·10^2", "1,0×10³", "1,0*10^4"], VALUES, ERRORS,
             decimal=","), {}, {}),
    "friction above sliding friction": (
        text("t (s);static friction (nN);error (nN);kinetic friction (nN)", TIMES, VALUES + 20, ERRORS, [20.0] * 5),
        {}, {}),
    "friction with an offset": (
        text("t (s);F (nN);error (nN)", TIMES, VALUES + 20, ERRORS), {"offset": "0.02 uN"}, {}),
    "friction above the first point": (
        text("t (s);friction force (nN);error (nN)", [0.001, *TIMES], [20, *(VALUES + 20)], [0.25, *ERRORS]),
        {"offset": "first"}, {"errors": np.hypot(ERRORS, 0.25)}),
    "a load that is merged over rows": (
        text("t (s);ΔF (nN);error (nN);load (nN)", TIMES, VALUES, ERRORS, ["50", "", "", "", ""]), {}, {"load": 50}),
    "a table that pandas wrote": (
        text(",t (s),ΔF (nN),ΔF (nN).1", ["0", "1", "2", "3", "4"], TIMES, VALUES - 1, VALUES + 1, mark=",").replace(
            "(nN).1", ".1 (nN)"), {}, {"errors": np.ones(5)}),
    "two merged headings in Excel": (
        ({"data": [["hold time (s)", "friction drop (nN)", None], [None, "mean", "SE"], *ROWS]},
         ["A1:A2", "B1:C1"]), {}, {}),
    "a title merged above replicates in Excel": (
        ({"data": [["Silica on silica, 3.5.", None, None], ["t (s)", "ΔF (nN)", None], [None, "run 1", "run 2"],
                   *([t, v - 1, v + 1] for t, v in zip(TIMES, VALUES, strict=True))]}, ["A1:C1", "B2:C2"]), {},
        {"errors": np.ones(5)}),
    "the sheet with hold times": (
        ({"about": [["load", "temperature"], ["50 nN", "300 K"]],
          "data": [["t (s)", "ΔF (nN)", "error (nN)"], *ROWS]}, []), {}, {}),
    "one of two sheets": (
        ({"dry": [["t (s)", "ΔF (nN)"], [1, 2], [2, 3]], "wet": [["t (s)", "ΔF (nN)", "error (nN)"], *ROWS]}, []),
        {"sheet": "wet"}, {}),
    "times of Excel": (
        ({"data": [["t", "ΔF (nN)", "error (nN)"], *([datetime.timedelta(seconds=t), v, e] for t, v, e in ROWS)]}, []),
        {}, {}),
}  # fmt: skip
REFUSED = {
    "the whole friction": (
        "t (s);friction force (nN)\n1;2\n10;3\n", {},
        r"column 2, 'friction force \(nN\)', is the whole friction.*--offset first.*friction_drop \(nN\)"),
    "an offset of a rise": ("t (s);ΔF (nN)\n1;2\n10;3\n", {"offset": 1}, "is a rise already; leave offset out"),
    "two offsets": ("t (s);F (nN);offset (nN)\n1;2;1\n10;3;1\n", {"offset": 1}, "has a column offset, and offset is"),
    "log of an unknown base": ("log t (s);ΔF (nN)\n1;2\n10;3\n", {}, "may be of base 10 or e"),
    "a logarithm without a unit": ("log10(t);ΔF (nN)\n1;2\n10;3\n", {}, "hold_time has no unit"),
    "a logarithm beyond numbers": ("log10(t/s);ΔF (nN)\n1;2\n400;3\n", {}, "'400' is not a finite number"),
    "limits of an unknown interval": (
        "t (s);ΔF (nN);upper (nN);lower (nN)\n1;2;3;1\n10;3;4;2\n", {}, "does not say of which interval"),
    "one limit": ("t (s);ΔF (nN);error + (nN)\n1;2;3\n10;3;4\n", {}, "'error \\+ .nN.': give both sides"),
    "one error": ("t (s);ΔF (nN);error - (nN)\n1;2;3\n10;3;4\n", {}, "'error - .nN.': give both sides"),
    "a scatter without a number": ("t (s);ΔF (nN);SD\n1;2;3\n10;3;4\n", {}, "add a column n"),
    "an error twice": ("t (s);ΔF (nN);error\n1;2±1;1\n10;3±1;1\n", {}, "line 2: a value with its error, beside"),
    "replicates with errors": ("t (s);ΔF1 (nN);ΔF2 (nN)\n1;2±1;3\n10;3±1;4\n", {}, "line 2: a value with its error"),
    "a negative error": ("t (s);ΔF (nN);error\n1;2;-1\n10;3;1\n", {}, "line 2, column error: -1: a standard error"),
    "scatters in the cells": ("t (s);ΔF ± SD (nN)\n1;2±1\n10;3±1\n", {}, "has cells whose errors may be scatters"),
    "an interval": ("t (s);ΔF (nN);95 % CI (nN)\n1;2;1\n10;3;1\n", {}, "half or the whole of an interval"),
    "errors of some values": ("t (s);ΔF (nN)\n1;2±1\n10;3\n", {}, "1 values of m have no error"),
    "a time with an error": ("t (s);ΔF (nN)\n1±1;2\n10;3\n", {}, "line 2, column hold_time: '1±1' has an error"),
    "conditions in the headings": (
        "t (s);ΔF 300 (nN);ΔF 350 (nN)\n1;2;3\n10;3;4\n", {}, "is there twice; keep one, or number replicates"),
    "one replicate": ("t (s);ΔF1 (nN);ΔF2 (nN)\n1;2;3\n10;3;\n", {}, "line 3: has one replicate"),
    "samples beside each other": (
        "t (s);ΔF (nN);t (s);ΔF (nN)\n1;2;1;2\n10;3;10;3\n", {}, "the column hold_time is there twice"),
    "a mean below the table": (
        "t (s);ΔF (nN)\n1;2\n10;3\nmean;2.5\n", {}, "line 4, column hold_time: 'mean' is not a number"),
    "a sheet that is not there": (
        ({"dry": [["t (s)", "ΔF (nN)"], [1, 2], [2, 3]]}, []), {"sheet": "dri"}, "no sheet 'dri' .did you mean 'dry'"),
    "several sheets": (
        ({name: [["t (s)", "ΔF (nN)"], [1, 2], [2, 3]] for name in ("dry", "wet")}, []), {},
        "the sheets dry, wet hold tables; choose one as the sheet .--sheet 'dry'."),
    "a sheet of a text": ("t (s);ΔF (nN)\n1;2\n10;3\n", {"sheet": "dry"}, "has no sheets"),
}  # fmt: skip


def written(folder, content):
    if isinstance(content, tuple):
        book(folder / "m.xlsx", *content)
        return folder / "m.xlsx"
    (folder / "m.csv").write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / "m.csv"


@pytest.mark.parametrize("name", READ)
def test_a_table_is_read_to_what_it_means(tmp_path, name):
    content, how, other = READ[name]
    (curve,) = ca.plugin.read_table(written(tmp_path, content), **how)
    expected = {"values": VALUES, "errors": ERRORS} | other
    assert curve.quantity == "friction_drop"
    np.testing.assert_allclose(curve.hold_times, TIMES, rtol=1e-9)
    np.testing.assert_allclose(curve.values, expected["values"], rtol=1e-9)
    assert curve.error is not None
    np.testing.assert_allclose(curve.error, expected["errors"], rtol=1e-9)
    assert curve.load in (other.get("load"), pytest.approx(50) if "load" not in other else 50)
    assert curve.temperature in (None, pytest.approx(300))


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_table_does_not_say_is_asked_for(tmp_path, name):
    content, how, message = REFUSED[name]
    with pytest.raises(ca.InputError, match=message) as caught:
        ca.plugin.read_table(written(tmp_path, content), **how)
    assert "m." in str(caught.value)


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("ln t beside t", "1 column left out: ln(t/s)"),
        ("errors up and down", "of errors up and down their mean is taken"),
        ("replicates", "means of 4 replicates, errors their scatter over the root of 4, uncertain by 41 %"),
        ("replicates with their mean", "2 columns left out: mean, std"),
        ("markers of what is missing", "rows without a value are left out: line 7, line 8, line 9, line 10"),
        ("footnotes", "2 lines without numbers left out: * new tip other sample; † see the lab book"),
        ("friction above the first point", "rises above 20 at 0.001 s: sites that bonded before are not counted"),
        ("a load that is merged over rows", "an empty cell of conditions means what is above it: line 3"),
        ("the sheet with hold times", "sheet 'data' is read; 1 others are left out"),
    ],
)
def test_what_was_understood_and_left_out_is_noted(tmp_path, name, note):
    content, how, _ = READ[name]
    (curve,) = ca.plugin.read_table(written(tmp_path, content), **how)
    assert note in "\n".join(curve.notes)


def test_rows_that_are_there_twice_are_noted(tmp_path):
    file = written(tmp_path, "t (s);ΔF (nN)\n1;2\n10;3\n10;3.5\n10;3\n")
    assert ca.read_measurements(file).notes[-1] == "1 rows repeat another one and count twice"


def test_a_coefficient_of_friction_has_an_offset_without_a_unit(tmp_path):
    file = written(tmp_path, "Haltezeit (s);Haftreibungskoeffizient\n1;0.5\n10;0.75\n")
    curve = ca.read_measurements(file, offset=0.25)
    assert curve.quantity == "friction_coefficient_drop"
    assert curve.values.tolist() == [0.25, 0.5]
    assert math.isclose(ca.read_measurements(file, offset="5 %").values[0], 0.45)


@pytest.mark.parametrize(("unit", "error"), [("", 0.01), (" (%)", 5e-4)])
def test_errors_in_percent_are_shares_of_the_value_unless_it_is_in_percent_too(tmp_path, unit, error):
    file = written(tmp_path, f"t (s);Δμ{unit};error (%)\n1;0.2;{0.05 if unit else 5}\n10;0.2;{0.05 if unit else 5}\n")
    found = ca.read_measurements(file).error
    assert found is not None
    assert found.tolist() == pytest.approx([error] * 2)
