"""The objects that pass between stages: validated once, read-only, equal by content."""

from __future__ import annotations

import copy
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import chemage as ca
from chemage.errors import InputError
from chemage.objects import Aging, BondHistory, ContactSolution, ReactionLattice, Record, Surface, effective_forming
from chemage.units import EV_PER_GPA_NM3


def surface(**changes):
    heights = np.arange(12.0).reshape(3, 4)
    return Surface(**{"heights": heights, "pixel_size": 0.5, "provenance": {"kind": "ramp"}, **changes})


def contact(**changes):
    pressure = np.zeros((4, 5))
    pressure[1, 1:3] = 2.0, 4.0
    pressure[3, 0] = 6.0
    return ContactSolution(**{"pressure": pressure, "load": 3.0, "pixel_size": 0.5, "modulus": 10.0, **changes})


def lattice(**changes):
    fields = {
        "pixels": (3, 3),
        "sites": [1, 4, 7],
        "forming": [0.8, 0.9, 1.0],
        "breaking": [1.1, 1.1, 1.2],
        "neighbours": [[1, -1], [0, 2], [1, -1]],
        "coupling": [[0.1, 0.0], [0.1, -0.2], [-0.2, 0.0]],
        "pixel_size": 0.45,
    }
    return ReactionLattice(**{**fields, **changes})


def history(**changes):
    fields = {
        "hold_times": [1.0, 10.0],
        "bonds": [1, 2],
        "formed": [2, 4],
        "broken": [1, 2],
        "state": [True, False, True],
        "time": 10.0,
        "temperature": 300.0,
        "engine": "by-hand",
        "resume": {"words": np.array([3], np.uint64)},
    }
    return BondHistory(**{**fields, **changes})


def aging(**changes):
    fields = {
        "hold_times": [1.0, 10.0, 100.0],
        "bonds": [[10, 20, 30], [12, 24, 30]],
        "sites": [50, 50],
        "events": [40, 44],
        "load": 60.0,
        "temperature": 300.0,
        "engine": "by-hand",
        "observables": {"x": np.array([[1.0], [2.0]])},
    }
    return Aging(**{**fields, **changes})


MAKERS = [surface, contact, lattice, history, aging]
all_objects = pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)


def arrays_of(record: Record):
    for name, value in record.todict().items():
        if isinstance(value, np.ndarray):
            yield name, value
        elif isinstance(value, dict):
            yield from ((f"{name}.{key}", item) for key, item in value.items() if isinstance(item, np.ndarray))


# -- what holds for all -----------------------------------------------------------------------------------------------


@all_objects
def test_arrays_are_contiguous_and_read_only(make):
    found = dict(arrays_of(make()))
    assert found
    for name, array in found.items():
        assert array.flags.c_contiguous, name
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@all_objects
def test_fields_are_frozen(make):
    record = make()
    for name in type(record).model_fields:
        with pytest.raises(ValidationError, match="frozen"):
            setattr(record, name, None)


@all_objects
def test_equal_content_is_equal(make):
    assert make() == make()
    assert hash(make()) == hash(make())
    assert make().digest() == make().digest()
    assert make() != "something else"


@all_objects
def test_every_field_is_part_of_the_digest(make):
    record = make()
    seen = {record.digest()}
    changed = {
        float: lambda value: (0.0 if math.isnan(value) else value) + 0.25,
        int: lambda value: value + 1,
        bool: lambda value: not value,
        str: lambda value: value + "x",
        tuple: lambda value: (*value, "x") if not value or isinstance(value[0], str) else tuple(v + 1 for v in value),
        dict: lambda value: {**value, "extra": np.ones(2) if make is aging or "words" in value else 1.5},
    }
    optional = {
        "gap": np.zeros((4, 5)),
        "displacement": 0.5,
        "breaking": np.ones(3),
        "contact": {"load": 1.0},
        "observables": {},
        "provenance": {"kind": "other"},
    }
    for name in type(record).model_fields:
        value = getattr(record, name)
        if name == "neighbours":
            change = {"neighbours": None, "coupling": None}
        elif name == "coupling":
            change = {"coupling": value * 2}
        elif name in optional:
            change = {name: optional[name]}
        elif name == "sites" and make is lattice:
            change = {name: value + 1}
        elif isinstance(value, np.ndarray):
            change = {name: ~value if value.dtype == bool else value + 1}
        else:
            change = {name: changed[type(value)](value)}
        digest = type(record).fromdict({**record.todict(), **change}).digest()
        assert digest not in seen, f"{name} is no part of the digest"
        seen.add(digest)


def test_nested_content_cannot_be_confused():
    def of(provenance):
        return surface(provenance=provenance).digest()

    distinct = [{"a": {"b": 1}}, {"a": {}, "b": 1}, {"a": {"b": {}}}, {"a": 1, "b": 1}, {"a": "1", "b": 1}, {"ab": 1}]
    assert len({of(provenance) for provenance in distinct}) == len(distinct)
    assert of({"a": 1, "b": 2}) == of({"b": 2, "a": 1})


def test_dtype_and_shape_are_content():
    flat = np.arange(6.0)
    digests = {surface(heights=flat.reshape(shape)).digest() for shape in ((2, 3), (3, 2), (1, 6))}
    assert len(digests) == 3
    assert surface(heights=np.ones((2, 2))) != surface(heights=np.ones((2, 2), np.float32))


@all_objects
def test_todict_and_fromdict_are_inverse(make):
    record = make()
    assert type(record).fromdict(record.todict()) == record


@all_objects
def test_pickled_and_copied_records_are_equal_and_still_read_only(make):
    record = make()
    for again in (pickle.loads(pickle.dumps(record)), copy.copy(record), copy.deepcopy(record)):
        assert again == record
        for name, array in arrays_of(again):
            assert not array.flags.writeable, name


def test_a_changed_copy_is_validated_and_has_a_digest_of_its_own():
    made = history()
    before = made.digest()
    changed = made.model_copy(update={"engine": "other"})
    assert changed.engine == "other"
    assert made.digest() == before != changed.digest()
    assert changed == history(engine="other")
    with pytest.raises(InputError, match="temperature"):
        made.model_copy(update={"temperature": -1})
    assert made.model_copy() == made


@all_objects
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


@all_objects
def test_repr_is_one_short_line(make):
    text = repr(make())
    assert text.startswith(f"<{type(make()).__name__} ")
    assert len(text) < 120
    assert "\n" not in text
    assert str(make()) == text


@all_objects
def test_unknown_fields_are_refused(make):
    with pytest.raises(InputError, match="colour: no such option"):
        make(colour="red")


@all_objects
def test_missing_fields_are_named(make):
    cls = type(make())
    with pytest.raises(InputError, match=f"^{cls.__name__}: .*is required"):
        cls()


# -- arrays that come in ----------------------------------------------------------------------------------------------


def test_a_writeable_array_is_copied_and_the_users_stays_theirs():
    mine = np.ones((2, 3))
    made = surface(heights=mine)
    mine[0, 0] = 7
    assert made.heights[0, 0] == 1
    assert mine.flags.writeable


def test_a_read_only_array_is_not_copied():
    mine = np.ones((2, 3))
    mine.setflags(write=False)
    assert surface(heights=mine).heights is mine


def test_single_precision_is_kept_and_integers_become_double():
    assert surface(heights=np.ones((2, 2), np.float32)).heights.dtype == np.float32
    assert surface(heights=np.ones((2, 2), np.int16)).heights.dtype == np.float64
    assert surface(heights=[[1, 2], [3, 4]]).heights.dtype == np.float64
    assert surface(heights=np.ones((2, 2), ">f8")).heights.dtype == np.dtype("=f8")


def test_a_strided_array_becomes_contiguous():
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
def test_heights_that_are_refused(heights, problem):
    with pytest.raises(InputError, match=problem):
        surface(heights=heights)


def test_a_mask_that_hides_nothing_is_no_mask():
    assert surface(heights=np.ma.masked_greater([[1.0, 2.0]], 5)).heights.tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("size", [0, -1, math.nan, math.inf, "a"])
def test_pixel_sizes_that_are_refused(size):
    with pytest.raises(InputError, match="Surface: pixel_size"):
        surface(pixel_size=size)


# -- surface ----------------------------------------------------------------------------------------------------------


def test_surface_measures():
    made = surface()
    assert made.shape == (3, 4)
    assert made.nominal_area == 12 * 0.25
    assert made.rms_height == pytest.approx(np.std(np.arange(12)))
    assert surface(periodic=False).rms_slope == pytest.approx(math.hypot(4, 1) / 0.5)  # a plane
    assert surface(heights=[[3.0]]).rms_slope == 0
    assert surface(heights=[[3.0]], periodic=False).rms_slope == 0


# -- contact ----------------------------------------------------------------------------------------------------------


def test_contact_measures():
    made = contact(rms_slope=0.1, rms_height=2.0)
    assert made.shape == (4, 5)
    assert made.contact.sum() == 3
    assert made.sites.tolist() == [6, 7, 15]
    assert made.area == 3 * 0.25
    assert made.area_fraction == 3 / 20
    assert made.nominal_area == 5.0
    assert made.nominal_pressure == 3.0 / 5.0
    assert made.mean_contact_pressure == 3.0 / 0.75
    assert made.patches == 2
    assert made.patch_sizes.tolist() == [2, 1]
    assert made.perimeter == (6 + 4) * 0.5
    assert made.perimeter_to_area == 5.0 / 0.75
    assert made.kappa == 0.75 * 0.1 * 10.0 / 3.0
    assert made.corrected_area == pytest.approx(0.75 - (math.pi - 1 + math.log(2)) / 24 * 5.0 * 0.5)
    assert not made.contact.flags.writeable
    assert not made.sites.flags.writeable
    summary = made.summary()
    assert json.loads(json.dumps(summary)) == summary
    assert summary["max_pressure"] == 6.0


def test_no_contact_is_a_valid_contact():
    none = contact(pressure=np.zeros((4, 5)), load=0.0)
    assert (none.area, none.area_fraction, none.patches, none.perimeter) == (0, 0, 0, 0)
    assert none.patch_sizes.size == 0
    for name in ("perimeter_to_area", "mean_contact_pressure", "kappa"):
        assert math.isnan(getattr(none, name)), name
    edges, density = none.pressure_histogram(4)
    assert density.tolist() == [0, 0, 0, 0]
    assert edges.size == 5


def test_pressure_histogram_is_a_density_over_the_contact():
    edges, density = contact().pressure_histogram(3)
    assert edges.tolist() == [0, 2, 4, 6]
    assert density.tolist() == [0, pytest.approx(1 / 6), pytest.approx(2 / 6)]
    assert np.sum(density * np.diff(edges)) == pytest.approx(1)
    edges, density = contact().pressure_histogram(2, upper=5.0)
    assert edges[-1] == 5
    assert np.sum(density * np.diff(edges)) == pytest.approx(2 / 3)  # what lies above is not counted


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"pressure": [[1.0, -2.0]]}, r"pressure: its smallest value is -2 GPa; a hard wall only pushes"),
        ({"pressure": [[1.0, np.nan]]}, "pressure: 1 of 2 values are not finite; the solver that made it is at fault"),
        ({"pressure": np.ones(3)}, r"pressure: shape \(3,\)"),
        ({"pressure": np.ones((0, 3))}, r"pressure: shape \(0, 3\)"),
        ({"gap": np.ones((2, 2))}, r"gap: shape \(2, 2\), but pressure has \(4, 5\)"),
        ({"load": -1.0}, "load: -1.0"),
        ({"load": math.nan}, "load: nan"),
        ({"load": math.inf}, "load: inf"),
        ({"modulus": 0.0}, "modulus: 0.0"),
        ({"iterations": -1}, "iterations: -1"),
    ],
)
def test_contacts_that_are_refused(changes, problem):
    with pytest.raises(InputError, match=f"ContactSolution: {problem}"):
        contact(**changes)


def test_the_neighbour_graph_is_made_once_per_interaction():
    made = contact()
    pairs = ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1)
    first = made.graph(pairs)
    assert made.graph(pairs.replace(strength=0.5)) is first  # equal options, the same graph
    assert first.dtype == np.int32
    assert not first.flags.writeable


# -- lattice ----------------------------------------------------------------------------------------------------------


def test_a_lattice_from_plain_arrays():
    made = lattice()
    assert made.interacting
    assert not lattice(neighbours=None, coupling=None).interacting
    assert made.neighbours.dtype == np.int32
    assert made.sites.dtype == np.int64
    assert lattice(sites=[], forming=[], breaking=[], neighbours=np.empty((0, 8), int), coupling=np.empty((0, 8)))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"pixels": (0, 3)}, r"pixels: \(0, 3\); give two positive numbers"),
        ({"sites": [[1, 4, 7]]}, r"sites: shape \(1, 3\)"),
        ({"sites": [1, 4, 9]}, r"sites: from 1 to 9, outside the grid of \(3, 3\)"),
        ({"sites": [-1, 4, 7]}, r"sites: from -1 to 7, outside"),
        ({"sites": [1, 4, 4]}, "sites: pixel 4 is listed twice; list each once"),
        ({"sites": [4, 1, 7]}, "sites: not in ascending order; sort them"),
        ({"sites": [1.0, 4.0, 7.0]}, "sites: expected whole numbers, not float64"),
        ({"forming": [0.8, 0.9]}, r"forming: shape \(2,\), but there are 3 sites; give one value a site"),
        ({"forming": [0.8, 0.9, np.nan]}, "forming: 1 of 3 values are not finite; give barriers in eV"),
        ({"breaking": [1.1]}, r"breaking: shape \(1,\), but there are 3 sites"),
        ({"breaking": [1.1, np.inf, 1.1]}, "breaking: 1 of 3 values are not finite"),
        ({"coupling": None}, "neighbours and coupling: give both, or neither"),
        ({"neighbours": None}, "neighbours and coupling: give both, or neither"),
        ({"coupling": [[0.1], [0.1], [0.1]]}, r"neighbours \(3, 2\) and coupling \(3, 1\): both must be \(3, k\)"),
        ({"coupling": [[0.1, 0], [0.1, np.nan], [np.nan, 0]]}, "coupling: 2 of 6 values are not finite"),
        ({"neighbours": [[1, -1], [0, 3], [1, -1]]}, r"neighbours\[1, 1\] = 3 is not a site; give 0 to 2, or -1"),
        ({"neighbours": [[1, -2], [0, 2], [1, -1]]}, r"neighbours\[0, 1\] = -2 is not a site"),
        ({"neighbours": [[0, -1], [1, 2], [1, -1]]}, r"neighbours\[0, 0\]: site 0 is its own neighbour; remove it"),
        ({"neighbours": [[1, 1], [0, 2], [1, -1]]}, r"neighbours\[0\]: site 1 is listed twice"),
        ({"neighbours": [[1, -1], [-1, 2], [1, -1]]}, "site 0 lists 1, but not the other way round"),
        ({"neighbours": [[-1, -1], [0, 2], [1, -1]]}, "site 1 lists 0, but not the other way round"),
        (
            {"coupling": [[0.3, 0.0], [0.1, -0.2], [-0.2, 0.0]]},
            r"coupling\[0, 0\]: the pair \(0, 1\) has two values; give both ends the same energy",
        ),
        ({"neighbours": np.array([[2**32 + 1, -1], [0, 2], [1, -1]])}, "do not fit int32"),
        ({"attempt_frequency": 0.0}, "attempt_frequency: 0.0"),
    ],
)
def test_lattices_that_are_refused(changes, problem):
    with pytest.raises(InputError, match=f"ReactionLattice: .*{problem}"):
        lattice(**changes)


@given(st.integers(2, 6), st.integers(1, 4), st.randoms(use_true_random=False))
def test_one_wrong_entry_in_a_sound_graph_is_found(n, k, chance):
    """Any single change of an entry of a complete graph makes it one-sided, doubled, foreign or its own."""
    k = min(k, n - 1)
    ring = [[(i + s) % n for s in range(1, k + 1)] for i in range(n)]
    both = [sorted({*row, *(j for j in range(n) if i in ring[j])}) for i, row in enumerate(ring)]
    wide = max(map(len, both))
    neighbours = np.array([row + [-1] * (wide - len(row)) for row in both])
    coupling = np.where(neighbours >= 0, 0.1, 0.0)
    sound = {"pixels": (n, 1), "sites": np.arange(n), "forming": np.ones(n), "coupling": coupling}
    ReactionLattice(neighbours=neighbours, **sound)
    i, s = chance.randrange(n), chance.randrange(wide)
    wrong = chance.choice([j for j in range(-2, n + 1) if j != neighbours[i, s]])
    changed = neighbours.copy()
    changed[i, s] = wrong
    with pytest.raises(InputError, match=r"ReactionLattice: (neighbours|coupling)"):
        ReactionLattice(neighbours=changed, **sound)


def test_to_atoms_shows_sites_bonds_and_barriers():
    made = lattice()
    atoms = made.to_atoms(np.array([True, False, True]))
    assert atoms.get_chemical_symbols() == ["O", "H", "O"]
    assert np.allclose(atoms.positions, np.array([[0.5, 1.5, 0], [1.5, 1.5, 0], [2.5, 1.5, 0]]) * 4.5)
    assert atoms.arrays["forming"].tolist() == [0.8, 0.9, 1.0]
    assert atoms.arrays["breaking"].tolist() == [1.1, 1.1, 1.2]
    assert atoms.cell.lengths()[:2].tolist() == [13.5, 13.5]
    assert lattice(breaking=None).to_atoms().get_chemical_symbols() == ["H", "H", "H"]
    assert len(lattice(sites=[], forming=[], breaking=None, neighbours=None, coupling=None).to_atoms()) == 0


def test_effective_barrier_is_equation_3():
    barrier = effective_forming(np.array([1.0, 1.0]), 0.0064, np.array([0.0, 2.0], np.float32))
    assert barrier.tolist() == [1.0, pytest.approx(1.0 - 2 * 0.0064 * EV_PER_GPA_NM3, rel=1e-15)]
    assert barrier[1] == pytest.approx(0.92, abs=1e-3)  # 0.04 eV per GPa
    assert barrier.dtype == np.float64


# -- history ----------------------------------------------------------------------------------------------------------


def test_history():
    assert history().events == 6
    with pytest.raises(InputError, match="BondHistory: hold_times, bonds, formed, broken: must be one-dimensional"):
        history(bonds=[1])
    with pytest.raises(InputError, match="temperature"):
        history(temperature=0)
    with pytest.raises(InputError, match="bonds: expected whole numbers"):
        history(bonds=[1.0, 2.0])


# -- ageing -----------------------------------------------------------------------------------------------------------


def test_friction_drop_is_bonds_times_force():
    made = aging(bond_force=3.0, front_factor=0.5)
    assert made.replicas == 2
    assert made.friction_drop.tolist() == [[15, 30, 45], [18, 36, 45]]
    assert made.friction_coefficient_drop.tolist() == [[0.25, 0.5, 0.75], [0.3, 0.6, 0.75]]
    assert made.mean_friction_drop.tolist() == [16.5, 33, 45]
    assert made.mean_friction_coefficient_drop.tolist() == pytest.approx([0.275, 0.55, 0.75])
    # standard error of two values is half their difference
    assert made.friction_drop_stderr.tolist() == pytest.approx([1.5, 3, 0])
    assert made.friction_coefficient_drop_stderr.tolist() == pytest.approx([0.025, 0.05, 0])


def test_no_load_has_a_drop_of_the_friction_force_but_no_coefficient():
    made = aging(load=0.0)
    assert np.isfinite(made.friction_drop).all()
    assert np.isnan(made.friction_coefficient_drop).all()
    fit = made.fit(1, 100)
    assert math.isnan(fit.beta)
    assert fit.friction_rate > 0


def test_one_replica_has_no_standard_error():
    one = aging(bonds=[[10, 20, 30]], sites=[50], events=[30], observables={})
    assert np.isnan(one.friction_drop_stderr).all()


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"hold_times": [[1.0, 10.0, 100.0]]}, r"hold_times: shape \(1, 3\)"),
        ({"hold_times": [1.0, 10.0]}, r"bonds: shape \(2, 3\); give \(replicas, 2\)"),
        ({"bonds": [10, 20, 30]}, r"bonds: shape \(3,\)"),
        ({"bonds": np.empty((0, 3), int), "sites": [], "events": []}, r"bonds: shape \(0, 3\)"),
        ({"sites": [50]}, "sites, events: give one number for each of the 2 replicas"),
        ({"events": [1, 2, 3]}, "sites, events: give one number for each of the 2 replicas"),
        ({"load": -1}, "load: -1"),
        ({"bond_force": -3.0}, "bond_force: -3.0"),
        ({"temperature": math.nan}, "temperature: nan"),
    ],
)
def test_ageings_that_are_refused(changes, problem):
    with pytest.raises(InputError, match=f"Aging: {problem}"):
        aging(**changes)


def line(slope, cutoff, times, replicas=1, load=30.0, force=3.0, noise=0):
    """An Aging whose bonds lie on slope·log10(t/cutoff), plus whole-number ``noise`` (replicas, m)."""
    exact = slope * np.log10(np.asarray(times) / cutoff)
    bonds = np.rint(exact).astype(int) + np.zeros((replicas, 1), int) + noise
    return Aging(
        hold_times=times,
        bonds=bonds,
        sites=[10**6] * replicas,
        events=[0] * replicas,
        load=load,
        temperature=300.0,
        bond_force=force,
    )


def test_fit_of_an_exact_line_is_exact():
    times = 10.0 ** np.arange(0, 6)
    fit = line(1000, 1e-2, times, replicas=4).fit("10 s", "1e4 s")
    assert fit.points == 4
    assert fit.friction_rate == pytest.approx(3000.0, rel=1e-12)
    assert fit.beta == pytest.approx(100.0, rel=1e-12)
    assert fit.cutoff_time == pytest.approx(1e-2, rel=1e-10)
    assert fit.beta_stderr == pytest.approx(0, abs=1e-10)
    assert fit.cutoff_time_stderr == pytest.approx(0, abs=1e-12)


def test_fit_sees_only_its_window():
    times = 10.0 ** np.arange(-2.0, 7.0)
    bent = line(1000, 1e-3, times).bonds.copy()
    bent[0, times < 10] = 0
    bent[0, times > 1e4] = 10**6
    made = aging(hold_times=times, bonds=bent, sites=[1], events=[1], load=3.0, observables={})
    assert made.fit(10, 1e4).beta == pytest.approx(1000)
    # the ends belong to the window, also when rounding put them an ulp outside
    assert made.fit(10 * (1 + 1e-12), 1e4 * (1 - 1e-12)).points == 4
    assert made.fit(10.1, 9e3).points == 2


def test_time_zero_is_no_part_of_a_fit():
    made = aging(hold_times=[0.0, 1.0, 10.0])
    assert made.fit(0, 10).points == 2


@pytest.mark.parametrize("window", [(20, 90), (1e3, 1e4), (100, 1), (1, 5), ("1 h", "1 day")])
def test_a_window_with_less_than_two_times_is_refused(window):
    with pytest.raises(InputError, match=r"fit window = .*holds [01] of the hold times; widen it"):
        aging().fit(*window)


def test_hold_times_that_repeat_are_one():
    with pytest.raises(InputError, match="holds 2 of the hold times"):
        aging(hold_times=[10.0, 10.0, 100.0]).fit(1, 50)


def test_fit_refuses_what_is_no_time():
    with pytest.raises(InputError, match="gigapascal"):
        aging().fit("1 GPa", "10 s")


def test_a_line_that_falls_has_no_cutoff():
    made = aging(bonds=[[30, 20, 10], [31, 20, 12]])
    fit = made.fit(1, 100)
    assert fit.beta < 0
    assert math.isnan(fit.cutoff_time)
    assert fit.beta_stderr > 0


def test_jackknife_error_of_the_slope_is_that_of_a_mean():
    """The slope is linear in the data, so its jackknife error is the standard error of the replicas' own slopes."""
    times = 10.0 ** np.arange(1, 5)
    noise = np.random.default_rng(0).integers(-40, 40, (7, 4))
    made = line(1000, 1e-2, times, replicas=7, noise=noise)
    x = np.log10(times)
    slopes = np.polyfit(x, made.friction_drop.T, 1)[0]
    fit = made.fit(10, 1e4)
    assert fit.friction_rate == pytest.approx(slopes.mean(), rel=1e-12)
    assert fit.friction_rate_stderr == pytest.approx(slopes.std(ddof=1) / math.sqrt(7), rel=1e-12)
    assert fit.beta_stderr == pytest.approx(fit.friction_rate_stderr / made.load, rel=1e-12)


def test_jackknife_error_of_the_cutoff_is_that_of_the_delta_method():
    times = 10.0 ** np.arange(1, 5)
    noise = np.random.default_rng(1).integers(-8, 8, (40, 4))
    made = line(1000, 1e-2, times, replicas=40, noise=noise)
    fit = made.fit(10, 1e4)
    slopes, intercepts = np.polyfit(np.log10(times), made.friction_drop.T, 1)
    covariance = np.cov(slopes, intercepts) / 40
    # log10 of the cut-off is −intercept/slope
    gradient = np.array([intercepts.mean() / slopes.mean() ** 2, -1 / slopes.mean()])
    expected = fit.cutoff_time * math.log(10) * math.sqrt(gradient @ covariance @ gradient)
    assert fit.cutoff_time_stderr == pytest.approx(expected, rel=0.02)


def test_the_error_of_one_replica_is_that_of_least_squares():
    times = 10.0 ** np.arange(1, 7)
    noise = np.random.default_rng(2).integers(-30, 30, (1, 6))
    made = line(1000, 1e-2, times, noise=noise)
    (_, _), covariance = np.polyfit(np.log10(times), made.friction_drop[0], 1, cov=True)
    assert made.fit(10, 1e6).friction_rate_stderr == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-10)
    assert math.isnan(made.fit(10, 100).friction_rate_stderr)  # two points lie on a line


# -- hold times -------------------------------------------------------------------------------------------------------


def test_hold_times_are_round_decades():
    times = ca.hold_times("1 ms", "1e5 s", per_decade=4)
    assert times.size == 33
    assert times[0] == 1e-3
    assert times[-1] == 1e5
    assert times[::4].tolist() == [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5]
    assert np.allclose(np.diff(np.log10(times)), 0.25, atol=1e-9)


@given(st.floats(1e-12, 1e6), st.floats(1.0, 1e9), st.integers(1, 20))
def test_hold_times_start_stop_and_rise(start, ratio, per_decade):
    times = ca.hold_times(start, start * ratio, per_decade)
    assert times[0] == pytest.approx(start, rel=1e-11)
    assert times[-1] == start * ratio
    assert (np.diff(times) > 0).all()
    steps = np.diff(np.log10(times))
    assert np.allclose(steps[:-1], 1 / per_decade, atol=1e-9)
    assert times.size <= math.log10(ratio) * per_decade + 2.001


def test_hold_times_are_short_decimals():
    # 0.0011 * 100 is 0.11000000000000001
    assert ca.hold_times(0.0011, 110, 1).tolist() == [0.0011, 0.011, 0.11, 1.1, 11, 110]


def test_the_end_is_added_when_it_is_no_step():
    assert ca.hold_times(1, 50, 1).tolist() == [1, 10, 50]
    assert ca.hold_times(2, 2).tolist() == [2]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((0, 1), "start = 0: must be above zero; hold times are spaced in log t"),
        ((-1, 1), "start = -1"),
        ((math.nan, 1), "start = nan"),
        ((1, 0.5), "stop = 0.5: must be finite and not before start"),
        ((1, math.inf), "stop = inf"),
        (("1 nm", 2), "nanometer"),
        ((1, 10, 0), "per_decade = 0: must be at least 1"),
    ],
)
def test_hold_times_that_are_refused(arguments, problem):
    with pytest.raises(InputError, match=problem):
        ca.hold_times(*arguments)
