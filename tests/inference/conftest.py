"""Inferences of tests end at fewer effective samples: bands are within a tenth of their width then."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """A third of the effective samples that are usual."""
    monkeypatch.setattr("chemage.inference.sampling.ENOUGH", 100)
    monkeypatch.setattr("chemage.inference.sampling.AGREED", 1.06)
