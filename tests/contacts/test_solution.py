"""The contact: its measures, and what is no contact."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from chemage import InputError


@pytest.fixture
def contact(examples):
    return examples.contact


def test_contact_measures(contact):
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


def test_pixels_found_by_their_centres_have_no_excess(contact):
    """The correction is for pixels that carry any load; centres cover the area without bias."""
    loaded, centres = contact(), contact(contact_pixels="centres")
    assert loaded.contact_pixels == "loaded"
    assert centres.corrected_area == centres.area == loaded.area > loaded.corrected_area
    assert centres.summary()["corrected_area"] == centres.area
    with pytest.raises(InputError, match="contact_pixels"):
        contact(contact_pixels="corners")


def test_no_contact_is_a_valid_contact(contact):
    none = contact(pressure=np.zeros((4, 5)), load=0.0)
    assert (none.area, none.area_fraction, none.patches, none.perimeter) == (0, 0, 0, 0)
    assert none.patch_sizes.size == 0
    for name in ("perimeter_to_area", "mean_contact_pressure", "kappa"):
        assert math.isnan(getattr(none, name)), name
    edges, density = none.pressure_histogram(4)
    assert density.tolist() == [0, 0, 0, 0]
    assert edges.size == 5


def test_pressure_histogram_is_a_density_over_the_contact(contact):
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
def test_contacts_that_are_refused(contact, changes, problem):
    with pytest.raises(InputError, match=f"ContactSolution: {problem}"):
        contact(**changes)
