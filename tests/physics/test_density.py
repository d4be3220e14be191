"""The calibration of the density of barriers: its data, its posterior, its members; on coarse surfaces."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import chemage as ca
from chemage_bonds import parse_columns
from chemage_li2018 import density_fit as fit
from chemage_li2018 import density_page
from chemage_li2018.density import DEFAULT, QUICK, REFERENCES
from chemage_li2018.density_fit import FAMILIES, LOWER, UPPER, Reported
from chemage_li2018.density_rates import FITTED, JUDGES, SURFACES, TIMES, DensityCurves
from chemage_li2018.published import Reading
from chemage_silica import MDSilica

DOCS = Path(__file__).parents[2] / "plugins" / "chemage_li2018" / "docs" / "barrier_density.md"
DECADES = np.log10(TIMES)
READINGS = len(fit.READINGS)
NO_SHIFT = Reported(np.zeros((READINGS, 6)), np.zeros((READINGS, 2)), np.zeros(1))
SURFACE = 0.05**2 * np.ones((6, 6)) + 0.003**2 * np.eye(6)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=list(FAMILIES))
def test_every_density_of_a_family_is_on_its_range(family):
    assert len(family.ranges) <= 3
    energies = np.linspace(LOWER - 0.1, UPPER + 0.1, 80_001)
    for parameters in family.design(16):
        density = family.barriers(parameters).density(energies)
        assert (density >= 0).all()
        assert not density[(energies < LOWER - 1e-9) | (energies > UPPER + 1e-9)].any()
        assert np.sum(density) * (energies[1] - energies[0]) == pytest.approx(1, abs=2e-3)


def lines(betas: list[float], starts: list[float]) -> np.ndarray:
    """Curves of one density that grow by a β per decade from a hold time on, (1, 6, m)."""
    rows = [beta * np.maximum(0, DECADES - np.log10(start)) for beta, start in zip(betas, starts, strict=True)]
    return np.array(rows)[None]


def test_what_the_paper_reports_is_read_from_curves():
    """2 log10(t/1 s) and log10(t/0.1 s) cross at 10 s; slopes at h' = 0.1 start at 1 s with ΔV and at 10 s without."""
    found = Reported.of(lines([2, 1, 1, 1, 1, 1], [1, 1, 0.1, 1, 10, 1]))
    beta = np.exp(found.beta[0])
    assert beta[fit.OURS, 0] == pytest.approx(2)
    assert beta[-1] == pytest.approx([2, 1, 1, 1, 1, 1])
    assert np.exp(found.onsets[0, -1]) == pytest.approx([1, 10], rel=0.4)
    assert np.exp(found.crossing[0, 0]) == pytest.approx(10, rel=0.01)


def test_a_curve_that_bends_has_another_slope_under_every_reading():
    curves = (DECADES + 3) ** 2 * np.ones((1, 6, 1))
    found = np.exp(Reported.of(curves).beta[0])
    for beta, reading in zip(found, fit.READINGS, strict=True):
        for start, value in zip(reading.starts, beta[[0, 3]], strict=True):
            if start is None:
                continue
            middle = 0.5 * (np.log10(start) + np.log10(reading.end))
            assert value == pytest.approx(2 * (middle + 3), rel=1e-6)


def test_a_line_from_its_own_half_slope_time_is_found_wherever_it_starts():
    """Slope β from one hold time on, and a tenth of it before: the line from there on has β, whatever the end is."""
    for start in (0.1, 1.7, 30.0):
        x = DECADES - np.log10(start)
        curves = np.where(x > 0, x, 0.1 * x) * np.ones((1, 6, 1))
        for end in (1e4, 1e5):
            beta = fit.fitted(curves, Reading((None, None), end))
            assert beta == pytest.approx(np.ones((1, 6)), rel=0.03)


def test_the_half_slope_time_belongs_to_the_line_that_starts_there():
    """θ ∝ (log t)² has the slope 2x, and the line from x₀ to x₁ has x₀ + x₁: half of it is reached at x₀ = x₁/3."""
    curves = (DECADES + 3) ** 2 * np.ones((1, 6, 1))
    found = Reported.of(curves)
    for at, reading in enumerate(fit.READINGS):
        if None in reading.starts:
            last = np.log10(reading.end) + 3
            assert np.exp(found.beta[0, at]) == pytest.approx(np.full(6, 4 * last / 3), rel=0.01)
            assert found.onsets[0, at] == pytest.approx(np.log(10) * (last / 3 - 3) * np.ones(2), abs=0.1)


def test_readings_have_equal_weights_by_kind_and_judges_calibrate_nothing():
    assert fit.READING_WEIGHTS.sum() == pytest.approx(1)
    assert fit.READING_WEIGHTS[[0, 3, 5]] == pytest.approx([1 / 9, 1 / 6, 1 / 15])
    assert not set(SURFACES) & set(JUDGES)


def test_a_common_factor_of_the_surface_is_cheap_and_a_ratio_is_not():
    errors = fit.covariance(SURFACE, fit.PUBLISHED, 0.01)
    at = Reported(np.broadcast_to(fit.PAPER.beta, (1, READINGS, 6)), np.zeros((1, READINGS, 2)), np.zeros((1, 1)))

    def shifted(by: np.ndarray | float) -> float:
        return float(at._replace(beta=at.beta + by).chi_squared(fit.PAPER, errors)[0, 0])

    assert shifted(0.0) == pytest.approx(0, abs=1e-12)
    assert shifted(0.05) < 2
    assert shifted(0.05 * np.array([1, 1, 1, -1, -1, -1])) > 20


def test_a_density_without_barriers_at_an_end_of_the_published_range_is_unlikely():
    assert fit.range_weight(((0.8, 1.1, 1.4), (0, 1, 0))) == 0
    assert fit.range_weight(((0.8, 1.1, 1.2, 1.4), (0, 1, 0, 0))) < -10
    # 1 % of a uniform density on 0.8 to 1.3 eV reaches beyond: a factor of 2 too little, two standard deviations
    assert fit.range_weight(((0.8, 1.3, 1.30001, 1.4), (1, 1, 0.05, 0.05))) == pytest.approx(-2, abs=0.2)


def emulator() -> fit.Emulator:
    """A family of two parameters whose curves are known in closed form."""
    ranges = {"rate": (0.5, 1.5), "start": (0.5, 1.5)}
    family = fit.DensityFamily("known", ranges, lambda *_: ((0.8, 1.4), (1, 1)))
    parameters = family.design(32)
    curves = np.concatenate([known(*row) for row in parameters])
    return fit.Emulator(family, parameters, curves)


def known(rate: float, start: float) -> np.ndarray:
    shape = 1 / (1 + np.exp(-(DECADES[None] - start * np.array([0.0, 0, -1, 1, 1, 0.5])[:, None])))
    return (rate * shape * fit.PUBLISHED[:, None] * (DECADES + 3))[None]


def test_curves_between_computed_densities():
    made = emulator()
    np.testing.assert_allclose(made(np.array([[1.03, 0.93]])), known(1.03, 0.93), atol=4e-3)
    assert np.sqrt(np.diag(made.error)).max() < 0.02


def test_the_members_span_what_is_open_and_hold_the_truth():
    """Rates that a known density makes under a reading that the fit does not know."""
    prior = fit.DensityPrior.of([emulator()], SURFACE, NO_SHIFT, 1 << 11)
    truth, reading = Reported.of(known(1.1, 0.8)), 3
    paper = Reported(truth.beta[0, reading], truth.onsets[0, reading], truth.crossing[0])
    weight = prior.posterior(paper)
    assert weight.sum() == pytest.approx(1)
    of_draws = weight.sum(axis=(1, 2))
    members = fit.spanning(prior.reported, of_draws, 16)
    assert len(set(members)) == 16
    assert members[0] == np.argmax(of_draws)
    assert fit.spanning(prior.reported, of_draws, 16, first=5)[0] == 5
    times = prior.reported.onsets[:, fit.PREFER], prior.reported.crossing
    values = np.concatenate([prior.reported.beta.reshape(len(of_draws), -1), *times], axis=1)
    low, high = fit.interval(values, of_draws)
    spanned = values[members]
    width = high - low
    assert (np.abs(spanned.min(axis=0) - low) <= 0.35 * width + 1e-9).all()
    assert (np.abs(spanned.max(axis=0) - high) <= 0.35 * width + 1e-9).all()
    true = truth.beta[0, fit.OURS]
    ours = prior.reported.beta[members, fit.OURS]
    assert ((ours.min(axis=0) <= true) & (true <= ours.max(axis=0))).all()


def test_densities_age_the_same_sites_and_nothing_is_computed_twice(tmp_path):
    two = [barriers for _, barriers in REFERENCES[2:]]
    first = DensityCurves(tmp_path, lambda *_: None, QUICK.pixels)
    curves = first.curves("a", two, QUICK.surfaces[:1])
    assert curves.shape == (2, 1, len(FITTED), TIMES.size)
    assert (np.diff(curves, axis=-1).mean(axis=-1) > 0).all()
    again = DensityCurves(tmp_path, lambda *_: None, QUICK.pixels)
    again._of_surface = lambda *_: pytest.fail("computed twice")  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_array_equal(again.curves("a", two, QUICK.surfaces[:1]), curves)


@pytest.mark.campaign
def test_the_study_writes_its_page_and_a_table_that_md_silica_can_read(tmp_path):
    paths = density_page.write_study(tmp_path / "study", quick=True)
    assert all(path.stat().st_size > 0 for path in paths)
    page = paths[0].read_text(encoding="utf-8")
    assert all(name in page for name in FAMILIES)
    assert "None" not in page
    rows = parse_columns(paths[1].read_text(encoding="utf-8"), "table")
    assert sorted(set(rows[:, 0])) == list(range(MDSilica.MEMBERS))


def test_member_0_is_the_default_of_the_study():
    energies = np.linspace(LOWER, UPPER, 601)
    shipped = ca.barriers("md-silica").density(energies)
    assert shipped == pytest.approx(FAMILIES[DEFAULT[0]].barriers(DEFAULT[1]).density(energies), abs=1e-4)


def test_the_default_agrees_with_the_paper_on_surfaces_that_had_no_part_in_its_calibration():
    """Six rates, from 1 and 10 s to 1e4 s, and three times; the triangle with its peak at 1.1 eV is told from it."""
    text = DOCS.read_text(encoding="utf-8")
    row = re.search(r"\| 1 s with ΔV and 10 s without to 10000 s \|[^|]*\|(.*)\|", text)
    assert row
    default, _, late, _ = (float(cell.split("/")[1]) for cell in row[1].split("|"))
    assert default <= 8
    assert late > 20
    row = re.search(r"\| default \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", text)
    assert row
    first, second, crossing = map(float, row.groups())
    assert 0.5 <= first <= 2
    assert 5 <= second <= 20
    assert 1 <= crossing <= 10


def test_the_page_is_of_the_shipped_table():
    text = DOCS.read_text(encoding="utf-8")
    members = text.partition("## Members")[2].splitlines()
    rows = [line.split(" | ") for line in members if re.match(r"\| \d+ \|", line)]
    assert [int(row[0].strip("| ")) for row in rows] == list(range(MDSilica.MEMBERS))


def test_an_unknown_study_is_refused():
    from chemage_li2018.command import study

    with pytest.raises(ca.InputError, match="no study 'densty'"):
        study("densty")
