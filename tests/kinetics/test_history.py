"""The history of one replica."""

from __future__ import annotations

import pytest

from chemage import InputError


@pytest.fixture
def history(examples):
    return examples.history


def test_history(history):
    assert history().events == 6
    with pytest.raises(InputError, match="BondHistory: hold_times, bonds, formed, broken: must be one-dimensional"):
        history(bonds=[1])
    with pytest.raises(InputError, match="temperature"):
        history(temperature=0)
    with pytest.raises(InputError, match="bonds: expected whole numbers"):
        history(bonds=[1.0, 2.0])
