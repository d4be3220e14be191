"""What tests of the kit share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from kit_examples import caught_by

from chemage.plugin import Component


@pytest.fixture
def caught(request: pytest.FixtureRequest) -> Callable[..., tuple[str, str]]:
    """``caught(component, check)``: the check that fails and its message, where only ``check`` is run.

    With ``--long`` and without ``-m``, by hand, all checks run in their order, so that the first that fails is the one
    that is compared.
    """
    everything = request.config.getoption("long") and not request.config.getoption("markexpr")

    def run(component: Component, check: str, **inputs: Any) -> tuple[str, str]:
        names = () if everything else (check,)
        return caught_by(component, *names, **inputs)

    return run
