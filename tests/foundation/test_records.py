"""Records: validated once, read-only, equal by content."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import math
import pickle
import pydoc
import re
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

import chemage as ca
from chemage import InputError


@pytest.fixture
def surface(examples):
    return examples.surface


@pytest.fixture
def history(examples):
    return examples.history


@pytest.fixture(params=["surface", "contact", "lattice", "history", "ageing"])
def make(request, examples):
    """A function that makes a record; every kind in turn."""
    return getattr(examples, request.param)


def arrays_of(record):
    for name, value in record.todict().items():
        if isinstance(value, np.ndarray):
            yield name, value
        elif isinstance(value, dict):
            yield from ((f"{name}.{key}", item) for key, item in value.items() if isinstance(item, np.ndarray))


def test_arrays_are_contiguous_and_read_only(make):
    found = dict(arrays_of(make()))
    assert found
    for name, array in found.items():
        assert array.flags.c_contiguous, name
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_fields_are_frozen(make):
    record = make()
    for name in type(record).model_fields:
        with pytest.raises(ValidationError, match="frozen"):
            setattr(record, name, None)


def test_equal_content_is_equal(make):
    assert make() == make()
    assert hash(make()) == hash(make())
    assert make().digest() == make().digest()
    assert make() != "something else"


def test_every_field_is_part_of_the_digest(make):
    record = make()
    seen = {record.digest()}
    changed = {
        float: lambda value: (0.0 if math.isnan(value) else value) + 0.25,
        int: lambda value: value + 1,
        bool: lambda value: not value,
        str: lambda value: value + "x",
        tuple: lambda value: (*value, "x") if not value or isinstance(value[0], str) else tuple(v + 1 for v in value),
        dict: lambda value: {**value, "extra": np.ones(2) if make.__name__ == "ageing" or "words" in value else 1.5},
    }
    optional = {
        "gap": np.zeros((4, 5)),
        "plastic_displacement": np.zeros((4, 5)),
        "touching": np.ones((4, 5), dtype=bool),
        "contact_pixels": "centres",
        "displacement": 0.5,
        "breaking": np.ones(3),
        "positions": np.array([[0.2, 0.7], [0.7, 0.7], [1.1, 0.7]]),
        "origin": (0.1, 0.2),
        "contact": {"load": 1.0},
        "elasticity": {"hardness": 10.0},
        "observables": {} if make.__name__ == "ageing" else {"y": np.ones(2)},
        "provenance": {"kind": "other"},
        "states": np.array([[False, False, True], [True, False, True]]),
        "rupture_force": np.ones((2, 3)),
        "member_ratios": np.ones((4, 3)),
        "outputs": {"x": {"dims": ["bin"], "unit": "nm", "description": ""}},
    }
    further = {
        "states": ("free", "bonded", "dry"),
        "initial": 0,
        "transitions": np.array([[2, 0]]),
        "transition_barriers": np.ones((3, 1)),
        "transition_terms": np.ones((1, 2)),
    }
    others = {
        "states": ("free", "bonded", "wet"),
        "initial": 2,
        "transitions": np.array([[0, 2]]),
        "transition_barriers": np.zeros((3, 1)),
        "transition_terms": np.zeros((1, 2)),
    }
    for name in type(record).model_fields:
        value = getattr(record, name)
        if make.__name__ == "lattice" and name in further:  # they belong together
            change = {**further, name: others[name]}
        elif name == "neighbours":
            change = {"neighbours": None, "coupling": None}
        elif name == "coupling":
            change = {"coupling": value * 2}
        elif name == "positions":
            change = {name: (np.stack(np.divmod(record.sites, record.pixels[1]), axis=1) + 0.4) * record.pixel_size}
        elif name in ("errors", "error_sources"):  # each error has its source
            change = {"errors": {"x": np.full(record.hold_times.size, 0.1)}, "error_sources": {"x": name}}
        elif name in optional:
            change = {name: optional[name]}
        elif name == "pressure" and value is None:
            change = {name: np.array([1.0, 2.0, 3.0])}
        elif name == "sites" and make.__name__ == "lattice":
            change = {name: value + 1}
        elif isinstance(value, np.ndarray):
            change = {name: ~value if value.dtype == bool else value + 1}
        else:
            change = {name: changed[dict if isinstance(value, dict) else type(value)](value)}
        digest = type(record).fromdict({**record.todict(), **change}).digest()
        assert digest not in seen, f"{name} is no part of the digest"
        seen.add(digest)


def test_nested_content_cannot_be_confused(surface):
    def of(provenance):
        return surface(provenance=provenance).digest()

    distinct = [{"a": {"b": 1}}, {"a": {}, "b": 1}, {"a": {"b": {}}}, {"a": 1, "b": 1}, {"a": "1", "b": 1}, {"ab": 1}]
    assert len({of(provenance) for provenance in distinct}) == len(distinct)
    assert of({"a": 1, "b": 2}) == of({"b": 2, "a": 1})


def test_dtype_and_shape_are_content(surface):
    flat = np.arange(6.0)
    digests = {surface(heights=flat.reshape(shape)).digest() for shape in ((2, 3), (3, 2), (1, 6))}
    assert len(digests) == 3
    assert surface(heights=np.ones((2, 2))) != surface(heights=np.ones((2, 2), np.float32))


def test_todict_and_fromdict_are_inverse(make):
    record = make()
    assert type(record).fromdict(record.todict()) == record


def test_pickled_and_copied_records_are_equal_and_still_read_only(make):
    record = make()
    for again in (pickle.loads(pickle.dumps(record)), copy.copy(record), copy.deepcopy(record)):
        assert again == record
        for name, array in arrays_of(again):
            assert not array.flags.writeable, name


def test_a_changed_copy_is_validated_and_has_a_digest_of_its_own(history):
    made = history()
    before = made.digest()
    changed = made.model_copy(update={"engine": "other"})
    assert changed.engine == "other"
    assert made.digest() == before != changed.digest()
    assert changed == history(engine="other")
    with pytest.raises(InputError, match="temperature"):
        made.model_copy(update={"temperature": -1})
    assert made.model_copy() == made


def test_every_array_declares_dimensions_unit_and_meaning(make):
    record = make()
    own = {name for name in type(record).model_fields if isinstance(getattr(record, name), np.ndarray)}
    assert own <= set(type(record).arrays)
    for name, (dimensions, unit, meaning) in type(record).arrays.items():
        value = getattr(record, name)
        if value is not None:
            assert len(dimensions) == value.ndim, name
        assert isinstance(unit, str)
        assert meaning


def test_repr_is_one_short_line(make):
    text = repr(make())
    assert text.startswith(f"<{type(make()).__name__} ")
    assert len(text) < 120
    assert "\n" not in text
    assert str(make()) == text


def test_unknown_fields_are_refused(make):
    with pytest.raises(InputError, match="colour: no such option"):
        make(colour="red")


def test_missing_fields_are_named(make):
    cls = type(make())
    with pytest.raises(InputError, match=f"^{cls.__name__}: .*is required"):
        cls()


# -- arrays that come in ----------------------------------------------------------------------------------------------


def test_a_writeable_array_is_copied_and_the_users_stays_theirs(surface):
    mine = np.ones((2, 3))
    made = surface(heights=mine)
    mine[0, 0] = 7
    assert made.heights[0, 0] == 1
    assert mine.flags.writeable


def test_a_read_only_array_is_not_copied(surface):
    mine = np.ones((2, 3))
    mine.setflags(write=False)
    assert surface(heights=mine).heights is mine


def test_single_precision_is_kept_and_integers_become_double(surface):
    assert surface(heights=np.ones((2, 2), np.float32)).heights.dtype == np.float32
    assert surface(heights=np.ones((2, 2), np.int16)).heights.dtype == np.float64
    assert surface(heights=[[1, 2], [3, 4]]).heights.dtype == np.float64
    assert surface(heights=np.ones((2, 2), ">f8")).heights.dtype == np.dtype("=f8")


def test_a_strided_array_becomes_contiguous(surface):
    made = surface(heights=np.arange(24.0).reshape(4, 6)[::2, ::3])
    assert made.heights.flags.c_contiguous
    assert made.heights.tolist() == [[0, 3], [12, 15]]


@pytest.mark.parametrize(
    ("heights", "problem"),
    [
        ([["a", "b"]], "expected numbers, not <U1"),
        (np.ones((2, 2), complex), "expected numbers, not complex128"),
        (np.ones((2, 2), object), "expected numbers, not object"),
        (np.ma.masked_greater([[1.0, 9.0]], 5), "1 values are masked; fill or crop missing data first"),
        ([[1.0, np.nan], [np.inf, 1.0]], "heights: 2 of 4 values are not finite; fill or crop missing data first"),
        (np.ones(4), r"heights: shape \(4,\); give a two-dimensional, non-empty array"),
        (np.ones((2, 2, 2)), r"shape \(2, 2, 2\)"),
        (np.ones((0, 4)), r"shape \(0, 4\)"),
        ([[1.0], [1.0, 2.0]], "Surface: heights"),
    ],
)
def test_heights_that_are_refused(surface, heights, problem):
    with pytest.raises(InputError, match=problem):
        surface(heights=heights)


def test_a_mask_that_hides_nothing_is_no_mask(surface):
    assert surface(heights=np.ma.masked_greater([[1.0, 2.0]], 5)).heights.tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("size", [0, -1, math.nan, math.inf, "a"])
def test_pixel_sizes_that_are_refused(surface, size):
    with pytest.raises(InputError, match="Surface: pixel_size"):
        surface(pixel_size=size)


# -- what help shows --------------------------------------------------------------------------------------------------

PUBLIC = [ca.Surface, ca.ContactSolution, ca.ReactionLattice, ca.Ageing, ca.Ensemble, *(
    getattr(ca.plugin, name) for name in ("BondHistory", "PullHistory", "ContactStatistics", "Roughness", "RuptureForce")
)]  # fmt: skip


@pytest.mark.parametrize("cls", PUBLIC)
def test_help_shows_every_field_of_a_record_with_its_unit(cls):
    shown = pydoc.plain(pydoc.render_doc(cls))
    before, _, fields = inspect.getdoc(cls).partition("\n\nAttributes\n----------\n")
    assert before.endswith(".")
    for name in cls.model_fields:
        assert f" |  {name}\n |      " in shown, name
        unit = cls.arrays.get(name, ((), "", ""))[1].replace("1", "")
        meaning = re.search(rf"^{name}\n((?:    .*\n?)+)", fields, re.M)[1]
        assert unit in meaning.replace("²", "2"), name


def test_help_shows_the_parts_of_a_run_with_their_units():
    text = inspect.getdoc(ca.Run)
    assert all(f"\n{field.name}\n    " in text for field in dataclasses.fields(ca.Run))
    assert "Stage -> wall time, s." in text


def test_docstrings_of_records_are_not_made_before_somebody_asks():
    program = "from chemage.foundation.checks import _texts_below as read; import chemage; chemage.Ageing; "
    program += "print(read.cache_info().misses)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
