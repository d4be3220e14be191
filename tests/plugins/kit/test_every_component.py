"""A check finds a component that breaks it: kind, options, citations."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest
from kit_examples import Flat, broken, failing
from pydantic import Field

from chemage import InputError


class Bare(Flat):
    note: str = ""
    loose: float = 1.0
    """takes nan"""


class Listed(Flat):
    numbers: list[float] = Field(default=[1.0])
    """a list has no hash"""


class Thawed(Flat):
    model_config: ClassVar[Any] = {"frozen": False}


class Stubborn(Flat):
    def replace(self, **changes):
        return Stubborn(low=0.1)


class Rejecting(Flat):
    """Says no without saying to what."""

    def __init__(self, **options):
        if options:
            raise InputError("no")
        super().__init__()


@pytest.mark.parametrize(
    ("component", "check", "said"),
    [
        (broken(Flat, kind="")(), "has_kind_and_role", "kind is empty"),
        (broken(Flat, kind="Flat Out")(), "has_kind_and_role", "lower-case"),
        (broken(Flat, __doc__=" ")(), "has_kind_and_role", "no docstring"),
        (broken(Flat, cite="Hertz (1881)")(), "citations_are_strings", "is a str"),
        (broken(Flat, cite=(1881,))(), "citations_are_strings", "non-empty str"),
        (Bare(), "options_are_described", "'note' has no description"),
        (broken(Flat, speed_only=("threads",))(), "speed_only_names_options", "names threads"),
        (Thawed(), "options_are_frozen", "can be set"),
        (Bare(), "wrong_options_are_refused", "loose = nan"),
        (Rejecting(), "wrong_options_are_refused", "does not name it"),
        (broken(Flat, todict=lambda self: {"kind": "flat", "low": self})(), "options_go_round", "not plain JSON"),
        (broken(Flat, todict=lambda self: {"low": 0.8})(), "options_go_round", "kind None"),
        (Stubborn(), "options_go_round", "replace() returned"),
        (Listed(), "options_go_round", "unhashable"),
        (broken(Flat)(), "options_go_round", "pickle: PicklingError"),
    ],
)
def test_what_every_component_owes(component, check, said):
    assert said in failing(component, check)
