"""A check finds a component that breaks it: readers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kit_examples import Csv, broken, calls, failing, flat_surface

from chemage import testing
from chemage.plugin import StoreError


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "map.csv"
    np.savetxt(path, testing.rough_surface((6, 5)).heights, delimiter=",")
    return path


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ({"suffixes": ()}, "suffixes_are_named", "name the file endings"),
        ({"suffixes": ("csv",)}, "suffixes_are_named", "with the dot"),
        ({"read": lambda self, path: np.loadtxt(path)}, "bad_files_are_refused", "a missing file: raised FileNotFound"),
        ({"read": lambda self, path: 1}, "bad_files_are_refused", "returned 1"),
        ({"read": lambda self, path: _raise(StoreError("bad"))}, "bad_files_are_refused", "does not name it"),
        ({"read": lambda self, path: None}, "reads_its_file", "returned None"),
        ({"read": lambda self, path: flat_surface([[float(next(calls))]])}, "reads_its_file", "different objects"),
    ],
)
def test_readers(change, check, said, csv):
    assert said in failing(broken(Csv, **change)(), check, path=csv)


def _raise(error: Exception) -> Any:
    raise error
