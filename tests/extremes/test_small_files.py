"""Small files cost little: what takes time or memory in them is counted before it is parsed.

No clock is read: what took a time that grows with the square or cube of a length would not end at these lengths. Costs
are measured by ``tests/benchmarks/hostile_files.py``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import h5py
import hostile_files as hostile
import numpy as np
import pytest
from internals import in_one_unit, parse_toml, plain_warnings

import chemage as ca
from chemage import InputError, errors
from chemage.plugin import SceneError, StoreError, open_file, write_file

#: of a run of one letter; its cube is 10^13
LONG = 20_000


def heights_of(path, **options):
    return ca.surface("from-file", path=str(path), pixel_size=1.0, **options).make()


# -- text ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("between", [" ", "a ", "a(", "(", ", ", " /", "[ ", "()", '"', "_"])
def test_headings_of_any_kind_are_read_in_linear_time(tmp_path, between):
    path = tmp_path / "t.csv"
    path.write_text(f"hold_time{between * (LONG // len(between))}x (s;b\n1;2\n")
    with pytest.raises(InputError):
        ca.read_measurements(path)
    path.write_text(f"hold_time (s); friction_coefficient_drop; {between * (LONG // 9)}x (s\n1;2;3\n2;3;4\n")
    assert ca.read_measurements(path).values.tolist() == [2, 3]


@pytest.mark.parametrize(
    "text", ["1" * LONG + "!", "1" + " " * LONG + "!", "1_" * LONG + "!", "1 m" + "*m" * LONG + "!"]
)
def test_quantities_are_read_in_linear_time(text):
    assert in_one_unit([text]) is None


@pytest.mark.parametrize("line", ["width:{0}x{0};", "pixel size ={0}x{0},", "# channel:{0}", "a{0}b", "1,1{0}x"])
def test_headers_of_maps_are_read_in_linear_time(tmp_path, line):
    path = tmp_path / "map.txt"
    path.write_text(f"# {line.format(' ' * LONG)}\n1 2\n3 4\n")
    assert heights_of(path).shape == (2, 2)


def test_a_table_has_a_bounded_number_of_rows_columns_and_units(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(hostile.HEAD + "1,1\n" * 100_001)
    with pytest.raises(InputError, match="100001 rows below 2 columns; a table has at most 100000"):
        ca.read_measurements(path)
    path.write_text("hold_time,friction_coefficient_drop\n" + "".join(f"1 s*{i}/{i},1\n" for i in range(1, 200)))
    with pytest.raises(InputError, match="more than 100 units; write one above the column"):
        ca.read_measurements(path)


@pytest.mark.parametrize("key", ["a.", '"!".', "'a b'."])
def test_keys_and_tables_of_scenes_have_a_bounded_number_of_parts(key):
    for text in (f"{key * 20_000}a = 1", f"[{key * 20_000}a]"):
        with pytest.raises(SceneError, match="a key of more than 32 parts"):
            parse_toml(text, "the scene")
    with pytest.raises(SceneError, match="has 10001 entries; give at most 10000"):
        parse_toml("".join(f"a{number} = 1\n" for number in range(10_001)), "the scene")


# -- workbooks ----------------------------------------------------------------------------------------------------


CELLS = b"<row><c><v>1</v></c></row>"
FIRST, STRINGS = "xl/worksheets/sheet1.xml", "xl/sharedStrings.xml"


@pytest.mark.parametrize(
    ("parts", "refusal"),
    [
        ({FIRST: hostile.SHEET % (b'<row r="999999999"/>', b"")}, "cells at row 1048577"),
        ({FIRST: hostile.SHEET % (b'<row r="2"><c r="XFE2"><v>1</v></c></row>', b"")}, "column 16385"),
        ({FIRST: hostile.SHEET % (CELLS * 100_001, b"")}, "elements are too many"),
        ({FIRST: (hostile.SHEET % (CELLS * 100_001, b"")).decode().encode("utf-16")}, "elements are too many"),
        ({FIRST: hostile.SHEET % (b"", b'<hyperlink ref="A1"/>' * 10_001)}, "elements are too many"),
        ({STRINGS: hostile.STRINGS % bytes(1 << 26)}, "10 parts of 671.* bytes in all"),
        ({f"xl/{number}.xml": b"" for number in range(1000)}, "1009 parts"),
        ({FIRST: b'<!DOCTYPE a [<!ENTITY b "c">]><a/>'}, "its XML defines entities"),
    ],
)
def test_what_a_workbook_unpacks_to_is_counted_before_it_is_parsed(tmp_path, parts, refusal):
    pytest.importorskip("openpyxl")
    path = tmp_path / "t.xlsx"
    path.write_bytes(hostile.workbook(parts))
    with pytest.raises(StoreError, match=refusal):
        ca.read_measurements(path)


def test_cells_far_from_a_table_cost_no_more_than_themselves(tmp_path, monkeypatch):
    pytest.importorskip("openpyxl")
    far = b"<row><c><v>1</v></c><c><v>2</v></c></row>" * 2 + b'<row r="4000"><c r="XFD4000"><v>1</v></c></row>'
    path = tmp_path / "t.xlsx"
    path.write_bytes(hostile.workbook({FIRST: hostile.SHEET % (far, b"")}))
    cells = []
    own = ca.foundation.tables._cell
    monkeypatch.setattr(ca.foundation.tables, "_cell", lambda value, at: cells.append(at) or own(value, at))
    with pytest.raises(InputError):
        ca.read_measurements(path)
    assert len(cells) == 2 + 2 + 16384


# -- HDF5 and archives ----------------------------------------------------------------------------------------------


def test_groups_of_hdf5_are_nested_as_deep_as_people_nest_them(tmp_path):
    path = tmp_path / "x.h5"
    path.write_bytes(hostile.hdf5(lambda file: hostile.nested(file, 30, "g")))
    assert heights_of(path).shape == (4, 4)
    path.write_bytes(hostile.hdf5(lambda file: hostile.nested(file, 1600, "g")))
    with pytest.raises(StoreError, match="nested more than 32 deep"):
        heights_of(path)
    path.write_bytes(hostile.sealed(lambda file: hostile.nested(file, 1600, "g")))
    with pytest.raises(StoreError, match="nested more than 32 deep"):
        ca.read(path)
    path.write_bytes(hostile.sealed(lambda file: hostile.two_ways(file, 31)))
    with pytest.raises(StoreError, match="is there twice"):
        ca.read(path)


def test_a_small_file_holds_no_large_map(tmp_path):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("heights", (2600, 2600), "i1")
    with pytest.raises(StoreError, match=r"54.1 MB of data in a file of .*: files below 1 MB may hold 50 MB"):
        heights_of(path)
    with h5py.File(path, "w") as file:
        file.create_dataset("heights", (1000, 1000), "f4", chunks=(5, 5))
    with pytest.raises(StoreError, match="is cut into 40000 chunks"):
        heights_of(path)
    scan = tmp_path / "x.x3p"
    scan.write_bytes(hostile.scan((2600, 2600), kind="I", data=2 * 2600**2))
    with pytest.raises(StoreError, match=r"54\.1 MB of data"):
        heights_of(scan)


def test_parts_of_scans_are_nested_and_overlap_no_more_than_they_do_in_real_ones(tmp_path):
    for name, content, refusal in (
        ("x.x3p", hostile.scan((2, 2), "<a>" * 900 + "<b/>" * LONG + "</a>" * 900), "nested more than 20 deep"),
        ("y.x3p", hostile.scan((2, 2), " " * (1 << 24)), "main.xml has more"),
        ("x.cdf", hostile.netcdf(3000, 200), "its variables overlap"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(StoreError, match=refusal):
            heights_of(path)


@pytest.mark.campaign
def test_small_files_of_every_kind_cost_less_than_2_s_and_500_mb(tmp_path):
    pytest.importorskip("openpyxl")
    done = subprocess.run([sys.executable, hostile.__file__, "300"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, "\n".join(line for line in done.stdout.splitlines() if line.startswith("!"))


# -- what is no file, and names -------------------------------------------------------------------------------------


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="no such file on this system")
def test_a_file_that_states_no_size_is_empty(command):
    with open_file("/proc/version") as stream:  # as /proc/kmsg, which has no end
        assert stream.read() == b""
    done = command("show", "/proc/version")
    assert done.status == 2
    assert "is empty, or a file of the system without a size" in done.err


def test_a_pipe_without_an_ending_is_called_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(StoreError, match="pipe is a pipe, not a file; save it to a file first"):
        heights_of(tmp_path / "pipe")


#: what Python makes of two names that are no ASCII, and no UTF-8
ODD = [os.fsencode("é 1").decode("ascii", "surrogateescape"), "\udcff"]


def test_names_in_other_encodings_are_shown():
    assert [errors.printable(name) for name in ODD] == ["é 1", r"\udcff"]


@pytest.mark.parametrize("name", ODD)
def test_results_of_any_name_are_reported(tmp_path, command, name):
    ageing = ca.Ageing(hold_times=[0.1, 1.0, 10.0], bonds=[[1, 2, 3], [0, 2, 2]], sites=[4, 4], events=[9, 9], load=3.0,
                     temperature=300.0, engine="by-hand")  # fmt: skip
    path = tmp_path / f"{name}.h5"
    ca.write(path, ageing)
    for words in (("show",), ("report", "--out", tmp_path / f"{name}.html"), ("plot", "--out", tmp_path / "x.svg")):
        done = command(words[0], path, *words[1:])
        assert done.status == 0, done.err
    assert errors.printable(name) in Path(tmp_path, f"{name}.html").read_text("utf-8")


@pytest.mark.parametrize("name", ODD)
def test_a_scene_file_of_any_name_names_its_result(tmp_path, name):
    path = tmp_path / f"{name}.toml"
    write_file(path, hostile.SCENE + "modulus = 35\n")
    assert ca.load_scene(path).name == {"\udcff": "\ufffd"}.get(name, "é 1")


# -- views, and warnings --------------------------------------------------------------------------------------------


def test_a_view_that_repeats_one_number_is_refused_before_it_is_copied():
    endless = np.broadcast_to(np.float64(1.0), (10**7, 10**7))
    with pytest.raises(InputError, match=r"shape \(10000000, 10000000\): about 800 TB of memory needed"):
        ca.Surface(heights=endless, pixel_size=1.0)
    with pytest.raises(InputError, match="800 TB of memory needed"):
        ca.ContactSolution(pressure=endless, load=1.0, pixel_size=1.0, modulus=35.0)


def test_warnings_of_a_command_are_messages_also_where_python_makes_errors_of_them(monkeypatch, capsys):
    monkeypatch.setenv("PYTHONWARNINGS", "error,ignore::DeprecationWarning")
    monkeypatch.setattr(sys, "warnoptions", ["error", "ignore::DeprecationWarning"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain_warnings()
        warnings.warn("a few sites", UserWarning, stacklevel=1)
    assert "chemage: warning: a few sites" in capsys.readouterr().err
    assert os.environ["PYTHONWARNINGS"] == "ignore::DeprecationWarning"
