"""Inferences of tests end early: bands are within a tenth of their width then."""

from __future__ import annotations

import pytest
from inferring import few_effective


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    few_effective(monkeypatch)
