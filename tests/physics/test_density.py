"""The calibration of the density of barriers: its fit, on coarse surfaces; and that nothing is computed twice."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca
from chemage_bonds import parse_columns
from chemage_li2018 import density_fit as fit
from chemage_li2018 import density_page
from chemage_li2018.density import OTHER, QUICK, TRIANGLE
from chemage_li2018.density_fit import FAMILIES, LOWER, UPPER
from chemage_li2018.density_rates import SLOPES, TIMES, VOLUMES, Rates, logarithms, slope_of
from chemage_silica import MDSilica


def rates(folder, stages=None):
    return Rates(folder, lambda stage, done, total: stages.append(stage) if stages is not None else None, QUICK.pixels)


@pytest.mark.parametrize("family", FAMILIES, ids=[one.name for one in FAMILIES])
def test_every_density_of_a_family_is_on_the_published_range(family):
    assert len(family.parameters) == len(family.bounds) <= 3
    energies = np.linspace(LOWER - 0.1, UPPER + 0.1, 80_001)
    for parameters in fit.design(family, 16):
        density = family.barriers(parameters).density(energies)
        assert (density >= 0).all()
        assert not density[(energies < LOWER - 1e-9) | (energies > UPPER + 1e-9)].any()
        assert np.sum(density) * (energies[1] - energies[0]) == pytest.approx(1, abs=2e-3)


def test_the_published_ratios_have_the_range_of_their_rounding():
    least, most = fit.rounded_ratios()
    assert least[2] == pytest.approx(0.195 / 0.245)
    assert most[2] == pytest.approx(0.205 / 0.235)
    assert (least < fit.ratios(fit.PUBLISHED)).all()
    assert (fit.ratios(fit.PUBLISHED) < most).all()


def test_a_common_factor_of_the_surface_is_cheap_and_a_ratio_is_not():
    rng = np.random.default_rng(1)
    common = 0.05 * rng.standard_normal((2, 32, 1)) + 0.003 * rng.standard_normal((2, 32, 6))
    errors = fit.Errors.between(np.log(fit.PUBLISHED) + common)
    at = np.log(fit.PUBLISHED)
    assert errors.chi_squared(at) == pytest.approx(0, abs=1e-12)
    assert errors.chi_squared(at + 0.05) < 2
    assert errors.chi_squared(at + 0.05 * np.array([1, 1, 1, -1, -1, -1])) > 20
    np.testing.assert_allclose(errors.surface, 0.05, rtol=0.4)


def test_the_excess_is_one_at_the_bounds():
    assert fit.excess(fit.PUBLISHED) < 0.1
    assert fit.excess(fit.PUBLISHED * (1 + fit.WITHIN_BETA)) == pytest.approx(1)
    shifted = fit.PUBLISHED.copy()
    shifted[0] = (fit.PUBLISHED_RATIOS[0] + fit.WITHIN_RATIO) * shifted[3]
    assert fit.excess(shifted) == pytest.approx(1)


def test_the_fit_finds_the_density_that_made_the_rates():
    family = FAMILIES[-2]
    truth = np.array([1.17, 0.05, 0.2])

    def model(parameters):
        return np.log(fit.PUBLISHED) + (np.atleast_2d(parameters) - truth) @ np.array(
            [[1, 2, 3, 1, 1, 2], [1, 0, 2, 0, 1, 1], [0.5, -1, 0.3, 0.2, 0.1, -0.4]]
        )

    errors = fit.Errors(1e-4 * np.eye(6), np.zeros(6), np.zeros(3))
    parameters = fit.design(family, 32)
    found = fit.fitted(family, parameters, model(parameters), errors)
    np.testing.assert_allclose(found.best, truth, atol=2e-3)
    members = fit.equally_good(found, errors, 5, found.best)
    assert (errors.chi_squared(model(members)) < fit.EQUAL + 0.1).all()
    low, high = np.array(fit.region(found, errors)).T
    assert ((low <= members) & (members <= high)).all()


def test_densities_age_the_same_sites_and_nothing_is_computed_twice(tmp_path):
    first = rates(tmp_path)
    curves = first.curves("a", [TRIANGLE, OTHER], QUICK.surfaces[:1], 1)
    assert curves.shape == (2, 1, len(VOLUMES), len(SLOPES), TIMES.size)
    assert (np.diff(curves, axis=-1).mean(axis=-1) > 0).all()
    assert logarithms(curves).shape == (2, 1, 6)
    kept = next(tmp_path.glob("*.jsonl")).read_text()
    # an interrupted run leaves half a line
    next(tmp_path.glob("*.jsonl")).write_text(kept + '{"density": "')
    again = rates(tmp_path)
    again._contact = None  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_allclose(again.curves("a", [TRIANGLE], QUICK.surfaces[:1], 1), curves[:1], atol=1e-8)


def test_a_line_has_its_slope():
    assert slope_of(0.3 * np.log10(TIMES) + 1) == pytest.approx(0.3)


@pytest.mark.long
def test_the_study_writes_its_page_and_a_table_that_md_silica_can_read(tmp_path):
    paths = density_page.write_study(tmp_path / "study", quick=True)
    assert all(path.stat().st_size > 0 for path in paths)
    page = paths[0].read_text(encoding="utf-8")
    assert all(family.name in page for family in FAMILIES)
    assert "None" not in page
    rows = parse_columns(paths[1].read_text(encoding="utf-8"), "table")
    assert sorted(set(rows[:, 0])) == list(range(MDSilica.MEMBERS + 1))


def test_the_shipped_table_has_the_header_of_the_study():
    from importlib import resources

    text = resources.files("chemage_silica").joinpath("md_silica_barriers.csv").read_text(encoding="utf-8")
    assert text.startswith(density_page.HEADER.format(count=MDSilica.MEMBERS))


def test_an_unknown_study_is_refused():
    from chemage_li2018.command import study

    with pytest.raises(ca.InputError, match="no study 'densty'"):
        study("densty")
