"""A check finds a component that breaks it: kind, options, citations."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest
from kit_examples import Bed, Flat, broken, caught_by, failing, mutant
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


def _needs_ageing(self, figure, axes, results):
    for one in results:
        axes.plot(one.ageing.hold_times, one.ageing.bonds.mean(axis=0), label=one.label)


def _needs_maps(self, figure, axes, results):
    for one in results:
        axes.imshow(one.contact.pressure)


def _first(self, figure, axes, results):
    (_one,) = results
    axes.plot([0, 1])


def _formula(self, figure, axes, results):
    axes.plot([0, 1])
    axes.set_title("$x_$")


def _right(self, figure, axes, results):
    for one in results:
        axes.plot([one.component.low, one.component.high], [0, 1], color=one.color, label=one.label)


SHOWN = {"shown": "What is shown."}


@pytest.mark.parametrize(
    ("changes", "check", "said"),
    [
        ({"figures": ("shown",)}, "figures_are_named", "give a mapping"),
        ({"figures": {"a/b": "A caption."}}, "figures_are_named", "a figure is saved as a file"),
        ({"figures": {"": "A caption."}}, "figures_are_named", "a figure is saved as a file"),
        ({"figures": {"pressure": "A caption."}}, "figures_are_named", "a figure of chemage"),
        ({"figures": {"shown": " "}}, "figures_are_named", "has no caption"),
        ({"figures": SHOWN}, "components_draw_their_figures", "does not draw it"),
        ({"figures": SHOWN, "draw": lambda *given: None}, "components_draw_their_figures", "left the axes empty"),
        ({"figures": SHOWN, "draw": _needs_maps}, "components_draw_their_figures", "AttributeError"),
        ({"figures": SHOWN, "draw": _first}, "components_draw_their_figures", "ValueError"),
        ({"figures": SHOWN, "draw": _formula}, "components_draw_their_figures", "ValueError"),
    ],
)
def test_figures_of_components(changes, check, said):
    assert said in failing(mutant(Flat, f"figure {said} {check}", **changes)(), check)


def test_a_contact_without_ageing_is_drawn_too():
    bed = mutant(Bed, "draws ageing", figures=SHOWN, draw=_needs_ageing)
    assert "NoneType" in failing(bed(), "components_draw_their_figures")


def test_a_component_that_draws_passes():
    assert caught_by(mutant(Flat, "draws", figures=SHOWN, draw=_right)()) == ("", "")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"exact": "no"}, "give True or False"),
        ({"exact": False, "declared_error": 0.1, "error_of": ""}, "say what the declared error"),
        ({"declared_error": 0.1}, "but exact is True"),
        ({"exact": False, "declared_error": 0.0}, "largest relative error of the barriers"),
        ({"exact": False, "declared_error": "2 %"}, "largest relative error of the barriers"),
    ],
)
def test_approximations_are_declared(changes, said):
    assert said in failing(mutant(Flat, f"approximate {said}", **changes)(), "approximations_are_declared")


@pytest.mark.parametrize("error", [None, 0.05])
def test_an_approximate_component_passes(error):
    assert caught_by(mutant(Flat, f"within {error}", exact=False, declared_error=error)()) == ("", "")
