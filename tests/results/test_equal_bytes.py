"""The table "Equal bytes" of docs/file-format.md: what it promises holds, for every kind of result and setting."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "tests" / "stubs" / "kinds_of_results.py"
#: column of the table -> environments that must agree as it says
SETTINGS = {
    "threads, processes": [{"CHEMAGE_THREADS": "1"}, {"CHEMAGE_THREADS": "3"}],
    "BLAS threads": [{"OPENBLAS_NUM_THREADS": "1"}, {"OPENBLAS_NUM_THREADS": "2"}],
    "BLAS kernel": [{"OPENBLAS_CORETYPE": "Prescott"}, {"OPENBLAS_CORETYPE": "Haswell"}],
    "numpy's instructions": [
        {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
        {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    ],
}
#: what a cell says -> relative difference that it allows; None: any
ALLOWED = {"same": 0.0, "last digits": 1e-9, "tolerance": 1e-4, "another chain": None, "another realisation": None}


def table() -> dict[str, dict[str, str]]:
    """Kind of result, of which a row may have several -> column -> promise."""
    text = (ROOT / "docs" / "file-format.md").read_text(encoding="utf-8").partition("## Equal bytes")[2]
    lines = [line for line in text.partition("\n## ")[0].splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    rows = [row for row in rows if len(row) == len(rows[0])]
    promises = [(row[0], dict(zip(rows[0][1:], row[1:], strict=True))) for row in rows[2:]]
    return {kind: each for kinds, each in promises for kind in kinds.split("; ")}


def results(environment: dict[str, str], path: Path) -> dict[str, np.ndarray]:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("OPENBLAS_")}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", PROGRAM, path], env=clean | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    with np.load(path) as file:
        return dict(file)


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    return results({}, tmp_path_factory.mktemp("usual") / "usual.npz")


def test_the_table_says_nothing_that_is_not_tested():
    for promises in table().values():
        assert promises.keys() == {*SETTINGS, "other versions"}
        assert set(promises.values()) <= {*ALLOWED, "no promise"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("column", "number"),
    [
        pytest.param(column, number, marks=pytest.mark.campaign if number or column == "BLAS threads" else ())
        for column, every in SETTINGS.items()
        for number in range(len(every))
    ],
)
def test_a_column_holds(column, number, usual, tmp_path):
    found, promises = results(SETTINGS[column][number], tmp_path / "found.npz"), table()
    assert {name.rpartition("/")[0] for name in found} == promises.keys()
    for name, expected in usual.items():
        allowed = ALLOWED[promises[name.rpartition("/")[0]][column]]
        if allowed == 0:
            assert found[name].tobytes() == expected.tobytes(), f"{name}: {column}"
        elif allowed is not None:
            most = allowed * np.nanmax(np.abs(expected))
            np.testing.assert_allclose(found[name], expected, rtol=0, atol=most, err_msg=f"{name}: {column}")
