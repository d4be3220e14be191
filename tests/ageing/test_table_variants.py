"""One table as people export it: read to the same numbers, or refused with what to do; never read to others."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca

ROWS = [(0.01, 12.5, 0.4), (1, 25.25, 0.8), (100, 40, 1.125), (1000, 51.5, 1.5), (10000, 60.75, 2)]
TIMES, VALUES, ERRORS = (np.array(column, dtype=float) for column in zip(*ROWS, strict=True))


def table(header, form="{:g}", mark=", ", decimal=".", rows=ROWS, more=(), ends="\n"):
    """The table as a text; ``more`` cells end every row."""
    lines = [header] + [
        mark.join([*(form.format(x).replace(".", decimal) for x in row), *(str(cell) for cell in more)]) for row in rows
    ]
    return ends.join(lines) + ends


H = "hold_time (s), friction_drop (nN), error (nN)"
SEMI = "hold time [s];friction drop [nN];error [nN]"
FULL = "hold_time (s), friction_drop (nN), error (nN), load (nN), temperature (K)"
COMMENTED = "# measured with tip 3\n# "
READ = {
    "plain": table(H),
    "CRLF": table(H, ends="\r\n"),
    "old Macintosh ends": table(H, ends="\r"),
    "byte order mark": "\ufeff" + table(H),
    "UTF-16": table(H).encode("utf-16"),
    "UTF-16 without a mark": table(H).encode("utf-16-le"),
    "Windows code page": table("hold_time (s), friction_drop (µN), error (µN)", rows=[(t, v / 1e3, e / 1e3) for t, v, e
                               in ROWS], form="{:.9g}").encode("cp1252"),
    "semicolons": table(SEMI, mark=";"),
    "semicolons, decimal commas": table(SEMI, mark=";", decimal=","),
    "tabs, decimal commas": table(SEMI.replace(";", "\t"), mark="\t", decimal=","),
    "blanks": table("t(s) ΔF(nN) error(nN)", mark=" "),
    "blanks, decimal commas": table("t (s)   ΔF (nN)   error (nN)", mark="  ", decimal=","),
    "aligned by blanks": table("hold time (s)   friction drop (nN)   error (nN)", form="{:>12g}", mark=" "),
    "quoted decimal commas": table('"hold_time (s)","friction_drop (nN)","error (nN)"', form='"{:g}"', mark=",",
                                   decimal=","),
    "exponents": table(H, form="{:.4E}"),
    "exponents with commas": table(SEMI, form="{:.3E}", mark=";", decimal=","),
    "three decimals everywhere": table(H, form="{:.3f}"),
    "sep= line": "sep=;\n" + table(SEMI, mark=";", decimal=","),
    "sep= comma": "sep=,\n" + table(H, mark=","),
    "units after a comma": table('"t, s","ΔF, nN","error, nN"'),
    "units after a slash": table("t / s;ΔF / nN;error / nN", mark=";"),
    "units after an underscore": table("hold_time_s,friction_drop_nN,error_nN"),
    "units below": table("hold time\tΔF\terror\ns\tnN\tnN", mark="\t"),
    "units in brackets below": table("t;ΔF;sigma\n[s];[nN];[nN]", mark=";"),
    "units with the numbers": "hold_time;friction_drop;error\n" + "".join(
        f"{t:g} s;{v:g} nN;{e:g} nN\n" for t, v, e in ROWS),
    "milliseconds, micronewtons": table("Time (ms), ΔF (μN), err (uN)", rows=[(t * 1e3, v / 1e3, e / 1e3) for t, v, e
                                        in ROWS], form="{:.9g}"),
    "seconds and minutes": table("holding time (min), friction rise (nN), se", rows=[(t / 60, v, e) for t, v, e in ROWS],
                                 form="{:.17g}"),
    "percent": "t (s), ΔF (nN), error (%)\n" + "".join(f"{t:g}, {v:g}, {100 * e / v:.15g}\n" for t, v, e in ROWS),
    "percent with the numbers": "t (s);ΔF (nN);error\n" + "".join(
        f"{t:g};{v:g};{100 * e / v:.15g} %\n" for t, v, e in ROWS),
    "rows in any order": table(H, rows=ROWS[::-1]),
    "columns in any order": "error (nN), t (s), ΔF (nN)\n" + "".join(f"{e:g}, {t:g}, {v:g}\n" for t, v, e in ROWS),
    "unknown columns": table(H + ", humidity (%), remark", more=(50, "dry")),
    "lines before the header": "Tip 3; 2024\nRamp 5\n" + table(SEMI, mark=";"),
    "header in a comment": COMMENTED + table("t (s) ΔF (nN) error (nN)", mark=" "),
    "comments": COMMENTED + "\n" + table(H).replace("\n100,", "\n# a remark\n100,"),
    "empty lines and ends": table(H + ",,", more=("", "")).replace("\n1,", "\n\n,,,,\n1,"),
    "no-break blanks and minus": table(H).replace("0.01,", "1e\u22122,").replace(", ", ",\u00a0"),
    "upper case": table("HOLD TIME (s), FRICTION DROP (nN), ERROR (nN)"),
    "Δ": table("t (s), ΔF (nN), σ (nN)"),
    "value and quantity": table("hold_time (s), value (nN), error, quantity", more=("friction_drop",)),
    "load in the table": table(FULL, more=(50, 300)),
    "degrees": table("t (s), ΔF (nN), error (nN), F_N (µN), T (°C)", more=(0.05, 26.85)),
    "degrees C": table("t (s);ΔF (nN);error;normal load (nN);temp (C)", mark=";", decimal=",", more=(50, "26,85")),
}  # fmt: skip
REFUSED = {
    "thousands": (table("t (s);ΔF (nN)", mark=";", rows=[(1, 3)]) + "10;5\n1.000;7\n", r"1.000 may be 1000 or 1.000"),
    "thousands with commas": ("t (s);ΔF (nN)\n1;3\n10;5\n1,000;7\n", "1,000 may be 1000 or 1.000"),
    "both marks": ("t (s);ΔF (nN)\n1;3\n10;5\n1.000,5;7\n", "1.000,5 has marks of thousands"),
    "millions": ("t (s);ΔF (nN)\n1;3\n10;5\n1,000,000;7\n", "marks of thousands"),
    "commas and points": ("t (s);ΔF (nN)\n0,5;3\n10;5.5\n", "decimal comma, where others have a point"),
    "blanks of thousands": ("t (s);ΔF (nN)\n1;3\n10;5\n1 000;7\n", "'1 000' is not a number"),
    "commas twice": ("t (s),ΔF (nN)\n0,1,3,5\n1,0,5,5\n", "4 values under 2 columns"),
    "no header": ("1, 2\n3, 4\n", "column 1 is '1'; the columns are hold_time"),
    "no unit of time": ("t, ΔF (nN)\n1, 2\n10, 3\n", "hold_time has no unit"),
    "no unit of force": ("t (s), ΔF\n1, 2\n10, 3\n", "friction_drop has no unit"),
    "force in grams": ("t (s), ΔF (g)\n1, 2\n10, 3\n", "gram"),
    "capital seconds": ("t (S), ΔF (nN)\n1, 2\n10, 3\n", "siemens"),
    "two values": ("t (s), ΔF (nN), Δμ\n1, 2, 1\n10, 3, 2\n", "both there; give one"),
    "twice the same": ("t (s), ΔF (nN), ΔF (uN)\n1, 2, 1\n10, 3, 2\n", "is there twice"),
    "an error or a difference": ("t (s), ΔF (nN), dF (nN)\n1, 2, 1\n10, 3, 2\n", "may be an error or a difference"),
    "standard deviation": ("t (s), ΔF (nN), std (nN)\n1, 2, 1\n10, 3, 2\n", "may be the scatter of single"),
    "a slip": ("t (s), ΔF (nN), eror (nN)\n1, 2, 1\n10, 3, 2\n", "did you mean 'error'"),
    "Python's marks": ("t (s);ΔF (nN)\n1;2\n1_0;3\n", "'1_0' is not a number"),
    "a limit": ("t (s);ΔF (nN)\n1;<2\n10;3\n", "'<2' is not a number"),
    "below absolute zero": ("t (s);ΔF (nN);T (°C)\n1;2;-300\n10;3;-300\n", "temperature: -26.85 is not above zero"),
    "negative times": ("t (s);ΔF (nN)\n-1;2\n10;3\n", "is negative"),
}


def check(curve, errors=True):
    np.testing.assert_allclose(curve.hold_times, TIMES, rtol=1e-12)
    np.testing.assert_allclose(curve.values, VALUES, rtol=1e-12)
    if errors:
        np.testing.assert_allclose(curve.error, ERRORS, rtol=1e-12)
    assert curve.quantity == "friction_drop"
    assert curve.load in (None, pytest.approx(50))
    assert curve.temperature in (None, pytest.approx(300))


@pytest.mark.parametrize("name", READ)
def test_a_table_is_read_right_however_it_was_exported(tmp_path, name):
    text = READ[name]
    file = tmp_path / "m.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    (curve,) = ca.plugin.read_table(file)
    check(curve)
    assert bool(curve.notes) == (name not in QUIET), curve.notes


#: tables in which nothing was left out or taken for another name
QUIET = {
    name for name, text in READ.items()
    if isinstance(text, bytes) or not any(
        word in text for word in ("t (", "t(", "t,", "t /", "t;", "F", "Time", "holding", "humidity", "Ramp", "Δ")
    ) or text.startswith("HOLD")
} - {"units in brackets below"} | {"load in the table"}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_may_mean_two_things_or_nothing_is_refused_with_the_remedy(tmp_path, name):
    text, message = REFUSED[name]
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ca.InputError, match=message) as caught:
        ca.plugin.read_table(tmp_path / "m.csv")
    assert "m.csv" in str(caught.value)


def test_an_excel_file_and_a_frame_are_the_same_table(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    pandas = pytest.importorskip("pandas")
    book = openpyxl.Workbook()
    book.active.append(["Tip 3"])
    book.active.append(["hold time (s)", "ΔF (nN)", "error (nN)", "load (nN)", "T (°C)", "who"])
    for row in ROWS:
        book.active.append([*row, 50, 26.85, "me"])
    book.create_sheet("empty")
    book.save(tmp_path / "m.xlsx")
    (curve,) = ca.plugin.read_table(tmp_path / "m.xlsx")
    check(curve)
    assert curve.notes == (
        "1 line before the names of the columns left out", "read ΔF (nN) as friction_drop, T (°C) as temperature",
        "1 column left out: who",
    )  # fmt: skip
    frame = pandas.DataFrame({"ΔF (nN)": VALUES, "error (nN)": ERRORS}, index=pandas.Index(TIMES, name="t (s)"))
    check(*ca.plugin.read_table(frame))
    frame = pandas.DataFrame(dict(zip([("t", "s"), ("ΔF", "nN"), ("se", "")], (TIMES, VALUES, ERRORS), strict=True)))
    check(*ca.plugin.read_table(frame.sort_values(("t", "s"), ascending=False)))
    book.active.append([pandas.Timestamp("2024-05-01"), 1, 1, 50, 26.85])
    book.save(tmp_path / "m.xlsx")
    with pytest.raises(ca.InputError, match="spreadsheets make dates of numbers"):
        ca.plugin.read_table(tmp_path / "m.xlsx")


def test_without_the_library_an_excel_file_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    (tmp_path / "m.xlsx").write_bytes(b"PK")
    with pytest.raises(ca.InputError, match=r"openpyxl is not installed; run: pip install 'chemage\[excel\]'"):
        ca.plugin.read_table(tmp_path / "m.xlsx")


def test_several_loads_and_temperatures_are_several_curves(tmp_path):
    text = table(FULL, more=(50, 300)) + "".join(f"{t:g}, {v:g}, {e:g}, 80, 300\n" for t, v, e in ROWS)
    (tmp_path / "m.csv").write_text(text)
    curves = ca.plugin.read_table(tmp_path / "m.csv")
    assert [curve.load for curve in curves] == [50, 80]
    assert [curve.name for curve in curves] == ["m, 50 nN, 300 K", "m, 80 nN, 300 K"]
    with pytest.raises(ca.InputError, match=r"holds 2 curves, m, 50 nN.*chemage\.read_curves"):
        ca.read_measurements(tmp_path / "m.csv")
