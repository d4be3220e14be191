"""Barrier distributions as quantile functions: monotone, in their support, consistent with their density; options."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid

import chemage as ca
from chemage import InputError
from chemage.plugin import StoreError

energies = st.floats(-2, 4).map(lambda x: round(x, 6))


@st.composite
def gaussians(draw):
    mean, std = draw(energies), draw(st.floats(1e-4, 1.0))
    bounds = sorted(draw(st.tuples(energies, energies)))
    lower = bounds[0] if draw(st.booleans()) else None
    upper = bounds[1] if draw(st.booleans()) and bounds[1] > bounds[0] else None
    return ca.barriers("gaussian", mean=mean, std=std, lower=lower, upper=upper)


@st.composite
def uniforms(draw):
    lower = draw(energies)
    return ca.barriers("uniform", lower=lower, upper=lower + draw(st.floats(1e-6, 2)))


@st.composite
def tables(draw):
    steps = draw(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=8))
    weights = draw(st.lists(st.floats(0, 1e3), min_size=len(steps) + 1, max_size=len(steps) + 1))
    if not any(weights):
        weights[draw(st.integers(0, len(steps)))] = 1.0
    return ca.barriers("tabulated", energies=np.concatenate([[0.5], 0.5 + np.cumsum(steps)]), weights=weights)


@st.composite
def samples(draw):
    return ca.barriers("tabulated", samples=draw(st.lists(energies, min_size=1, max_size=9)))


any_barriers = st.one_of(gaussians(), uniforms(), tables(), samples(), st.just(ca.barriers("md-silica")))
#: from the smallest to the largest number the generator can give
UNIFORM = np.unique(
    np.concatenate([2.0 ** -np.arange(1, 54), 1 - 2.0 ** -np.arange(1, 54), (np.arange(400) + 0.5) / 400])
)


@given(any_barriers)
def test_quantile_is_finite_and_rises_with_its_argument(barriers):
    values = barriers.quantile(UNIFORM)
    assert values.shape == UNIFORM.shape
    assert np.all(np.isfinite(values))
    assert np.all(np.diff(values) >= -4 * np.spacing(np.abs(values).max()))


@given(any_barriers)
def test_shapes_are_kept(barriers):
    for shape in [(), (0,), (3,), (2, 5)]:
        assert barriers.quantile(np.full(shape, 0.25)).shape == shape
        assert barriers.density(np.full(shape, 1.0)).shape == shape


@given(st.one_of(gaussians(), uniforms(), tables()))
def test_density_between_two_quantiles_integrates_to_the_difference_of_their_arguments(barriers):
    # the midpoint rule with 200 points in each of the intervals that the quantiles themselves choose, cut at the points
    # of a table: an interval may span a range in which the density is zero
    edge = barriers.quantile(np.arange(1, 400) / 400)
    knots = np.unique([*edge, *(e for e in getattr(barriers, "energies", None) or () if edge[0] < e < edge[-1])])
    inside = knots[:-1, None] + np.diff(knots)[:, None] * (np.arange(200) + 0.5) / 200
    part = np.concatenate([[0.0], np.cumsum(barriers.density(inside).mean(axis=1) * np.diff(knots))])
    share = np.diff(part[np.searchsorted(knots, edge)]) * 400
    assert np.abs(share - 1).max() < 2e-2


@given(tables(), st.floats(0.0, 1.0))
def test_quantile_of_a_table_inverts_the_integral_of_its_density(barriers, part):
    x, p = np.array(barriers.energies), np.array(barriers.weights)
    energy = x[0] + part * (x[-1] - x[0])
    inner = x[x < energy]
    knots = np.append(inner, energy)
    # the trapezoidal rule is exact between the points of the table
    below = trapezoid(np.interp(knots, x, p), knots) / trapezoid(p, x)
    found = barriers.quantile(np.array(min(below, 1.0)))
    back = np.append(x[x < found], found)
    again = trapezoid(np.interp(back, x, p), back) / trapezoid(p, x)
    assert again == pytest.approx(below, abs=1e-13)
    if barriers.density(np.array(energy)) > 1e-3:
        assert found == pytest.approx(energy, abs=1e-10)


@given(tables())
def test_density_of_a_table_is_normalised_and_zero_outside(barriers):
    x = np.array(barriers.energies)
    assert trapezoid(barriers.density(x), x) == pytest.approx(1, rel=1e-12)
    assert not barriers.density(np.array([x[0] - 1e-9, x[-1] + 1e-9, -5.0, 50.0])).any()


@given(st.lists(energies, min_size=1, max_size=9))
def test_ordered_samples_are_quantiles_of_their_distribution(values):
    barriers = ca.barriers("tabulated", samples=values)
    at = np.linspace(0, 1, len(values))
    np.testing.assert_allclose(barriers.quantile(at), np.sort(values), rtol=0, atol=1e-14)


def test_repeated_samples_are_point_masses():
    barriers = ca.barriers("tabulated", samples=[1.0, 1.2, 1.0, 1.0])
    np.testing.assert_array_equal(barriers.quantile(np.array([0.1, 0.5, 0.66])), 1.0)
    assert barriers.density(np.array(1.0)) == math.inf
    np.testing.assert_allclose(barriers.density(np.array([1.1, 1.2, 1.3, 0.9])), [5 / 3, 5 / 3, 0, 0])
    alone = ca.barriers("tabulated", samples=[1.1])
    np.testing.assert_array_equal(alone.quantile(UNIFORM), 1.1)
    np.testing.assert_array_equal(alone.density(np.array([1.1, 1.2])), [math.inf, 0])


@pytest.mark.parametrize("bounds", [{}, {"lower": 1.1}, {"upper": "1.2 eV"}, {"lower": 0.5, "upper": 1.5}])
def test_no_spread_puts_every_barrier_at_the_mean(bounds):
    barriers = ca.barriers("gaussian", mean="1.1 eV", std=0, **bounds)
    np.testing.assert_array_equal(barriers.quantile(UNIFORM), 1.1)
    np.testing.assert_array_equal(barriers.density(np.array([1.0, 1.1])), [0, math.inf])


@given(gaussians())
def test_truncated_barriers_stay_between_the_bounds(barriers):
    values = barriers.quantile(UNIFORM)
    if barriers.lower is not None:
        assert values.min() >= barriers.lower
        assert barriers.density(np.array(barriers.lower - 1e-6)) == 0
    if barriers.upper is not None:
        assert values.max() <= barriers.upper
        assert barriers.density(np.array(barriers.upper + 1e-6)) == 0


# -- options and files ------------------------------------------------------------------------------------------------


def test_units():
    assert ca.barriers("gaussian", mean="1100 meV", std="0.02 eV") == ca.barriers("gaussian", mean=1.1, std=0.02)
    assert ca.barriers("uniform", lower="800 meV", upper=1.4).lower == 0.8
    in_mev = ca.barriers("tabulated", energies=[800, 1400], weights=[1, 1], energy_unit="meV")
    np.testing.assert_allclose(in_mev.quantile(np.array([0.0, 0.5, 1.0])), [0.8, 1.1, 1.4])


@pytest.mark.parametrize(
    "text", ["0.8 0\n1.1 2\n1.4 0\n", "energy,density\n0.8,0\n1.1,2 # peak\n\n1.4,0", "0.8;0\n1.1;2\n1.4;0"]
)
def test_a_table_from_a_file_is_the_table(tmp_path, text):
    (tmp_path / "table.csv").write_text("# from somewhere\n" + text)
    barriers = ca.barriers("tabulated", path=tmp_path / "table.csv")
    assert barriers == ca.barriers("tabulated", energies=[0.8, 1.1, 1.4], weights=[0, 2, 0])
    rising = 0.8 + 0.3 * np.sqrt(2 * UNIFORM[UNIFORM <= 0.5])
    np.testing.assert_allclose(barriers.quantile(UNIFORM[UNIFORM <= 0.5]), rising, rtol=1e-14)
    # the result of a run keeps the numbers: the file may go
    (tmp_path / "table.csv").unlink()
    assert ca.plugin.fromdict("barriers", barriers.todict()) == barriers


def test_one_column_is_samples(tmp_path):
    (tmp_path / "md.txt").write_text("barrier\n1.2\n0.9\n1.0\n")
    barriers = ca.barriers("tabulated", path=str(tmp_path / "md.txt"))
    assert barriers == ca.barriers("tabulated", samples=[1.2, 0.9, 1.0])


@pytest.mark.parametrize(
    ("kind", "options", "error", "words"),
    [
        ("gaussian", {"mean": 1, "std": -0.1}, InputError, "std"),
        ("gaussian", {"mean": 1, "std": float("nan")}, InputError, "std"),
        ("gaussian", {"mean": float("inf"), "std": 1}, InputError, "mean"),
        ("gaussian", {"mean": "300 K", "std": 1}, InputError, "kelvin"),
        ("gaussian", {"mean": 1, "std": 1, "lower": 2, "upper": 2}, InputError, "not above lower"),
        ("gaussian", {"mean": 1, "std": 0, "lower": 2}, InputError, "no barrier is inside"),
        ("gaussian", {"mean": 1, "std": 1, "min": 2}, InputError, "no such option"),
        ("uniform", {"lower": 1, "upper": 1}, InputError, "not above lower"),
        ("uniform", {"lower": 1}, InputError, "upper: is required"),
        ("tabulated", {}, InputError, "nothing given"),
        ("tabulated", {"energies": [1, 2]}, InputError, "energies given; give energies and weights"),
        ("tabulated", {"samples": [1], "path": "x"}, InputError, "samples, path given"),
        ("tabulated", {"energies": [1, 2], "weights": [1]}, InputError, "equal length"),
        ("tabulated", {"energies": [1], "weights": [1]}, InputError, "at least two"),
        (
            "tabulated",
            {"energies": [1, 2, 2], "weights": [1, 1, 1]},
            InputError,
            r"energies\[2\] = 2 does not exceed 2",
        ),
        ("tabulated", {"energies": [2, 1], "weights": [1, 1]}, InputError, r"energies\[1\] = 1 does not exceed 2"),
        ("tabulated", {"energies": [1, 2], "weights": [1, -1]}, InputError, r"weights\[1\] = -1 is negative"),
        ("tabulated", {"energies": [1, 2], "weights": [0, 0]}, InputError, "at least one value must be positive"),
        ("tabulated", {"energies": [1, float("nan")], "weights": [1, 1]}, InputError, r"energies\[1\] = nan"),
        ("tabulated", {"energies": [1, 2], "weights": [1, float("inf")]}, InputError, r"weights\[1\] = inf"),
        ("tabulated", {"samples": []}, InputError, "none given"),
        ("tabulated", {"samples": [1, float("nan")]}, InputError, "not finite"),
        ("tabulated", {"samples": ["a"]}, InputError, "samples"),
        ("tabulated", {"samples": [1], "energy_unit": "nm"}, InputError, "nanometer"),
        ("tabulated", {"path": "gone.csv"}, StoreError, "gone.csv does not exist"),
        ("md-silica", {"mean": 1}, InputError, "no such option"),
        ("md-silica", {"member": 16}, InputError, "member: 16.*16"),
        ("md-silica", {"member": -1}, InputError, "member: -1.*0"),
        ("md-silica", {"member": 1.5}, InputError, "member: 1.5"),
        ("md-silica", {"member": True}, InputError, "member: True"),
    ],
)
def test_wrong_options_are_refused_in_words(tmp_path, monkeypatch, kind, options, error, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words):
        ca.barriers(kind, **options)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "holds no numbers"),
        (b"# only words\n", "holds no numbers"),
        (b"\xff\xfe\x00\x01", "not a text file"),
        (b"1 2\n3 x\n", "line 2, column 2: 'x' is not a number"),
        (b"1 2\n3\n", "line 2: 1 columns where line 1 has 2"),
        (b"1 2\nnan 3\n", "line 2.*not finite"),
        (b"1 2 3\n", "3 columns"),
        (b"energy density\nx y\n", "line 2"),
    ],
)
def test_files_that_are_no_table_are_refused_in_words(tmp_path, content, words):
    (tmp_path / "table.csv").write_bytes(content)
    with pytest.raises((StoreError, InputError), match=words):
        ca.barriers("tabulated", path=tmp_path / "table.csv")


@pytest.mark.parametrize("made", [ca.barriers("gaussian", mean=1.0, std=0.1), ca.barriers("md-silica"),
                                  ca.barriers("uniform", lower=0.8, upper=1.2)])  # fmt: skip
def test_masked_values_are_refused_and_units_are_honoured(made):
    for asked in (made.quantile, made.density):
        with pytest.raises(ca.ChemageError, match="1 values are masked"):
            asked(np.ma.array([0.5, 0.9], mask=[False, True]))
    energies = xr.DataArray([900.0, 1100.0], attrs={"units": "meV"})
    np.testing.assert_allclose(made.density(energies), made.density(np.array([0.9, 1.1])), rtol=1e-12)
