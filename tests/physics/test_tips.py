"""The study of tips: what its parts claim, on a few contacts; and that it writes down what it found."""

from __future__ import annotations

import csv
import math
import re

import numpy as np
import pytest

import chemage as ca
from chemage import ContactSolution
from chemage_li2018 import pages, tips


@pytest.fixture(scope="module")
def study():
    return tips.compute(0.1, lambda *_: None, quick=True)


def test_tips_and_rough_contacts_have_one_chemistry_and_the_papers_nominal_pressure():
    patch = ca.load_scene("silica-patch")
    tip = tips._scene(tips._tips()[0], 0.1)
    assert tip.chemistry == patch.chemistry
    assert tip.surface.pixel_size == patch.surface.pixel_size
    reference = ca.load_scene("silica-rough")
    sizes = [one.surface.pixels[0] * one.surface.pixel_size for one in (patch, reference)]
    loads = [one.load for one in (patch, reference)]
    assert loads[0] / sizes[0] ** 2 == pytest.approx(loads[1] / sizes[1] ** 2, rel=2e-3)
    shortest = [size / one.surface.zeta for size, one in zip(sizes, (patch, reference), strict=True)]
    assert shortest[0] == pytest.approx(shortest[1], rel=0.02)


def test_the_tips_span_what_the_study_is_about():
    scenes = [tips._scene(data, 0.1) for data in tips._tips()]
    radii, loads = {one.surface.radius for one in scenes}, {one.load for one in scenes}
    assert (min(radii), max(radii)) == (10, 100)
    assert (min(loads), max(loads)) == (20, 400)
    assert len(scenes) == len(radii) * len(loads) == 16


def test_rough_contacts_are_pressed_to_the_area_of_a_tip():
    patch = ca.load_scene("silica-patch", {"surface.pixels": 256, "surface.zeta": 15, "contact.load": 210})
    rough = patch.surface.make(3)
    for sites in (150, 400, 1500):
        contact = tips._pressed_to(patch, rough, sites)
        assert contact.sites.size == pytest.approx(sites, rel=0.02)


@pytest.mark.long
def test_uniform_contacts_bond_more_under_more_pressure_and_with_time(study):
    assert (np.diff(study.uniform, axis=0) > 0).mean() > 0.97
    # bonds break as well, so that a contact whose sites are all bonded fluctuates about that
    free = study.uniform[:, :-1] < 0.99 / 0.4518**2
    assert (np.diff(study.uniform, axis=1)[free] >= 0).all()
    # no more bonds than sites, 1/0.4518² a square nanometre
    assert study.uniform.max() < 1 / 0.4518**2


def test_a_contact_of_one_pressure_is_predicted_as_that_uniform_contact(study):
    for pressure in (1e-9, 0.37, 2.0, 9.1, 40.0):
        even = ContactSolution(pressure=np.full((8, 8), pressure), load=1.0, pixel_size=0.4518, modulus=35.3)
        expected = tips.of_pressure(study, np.array([pressure]))[0]
        np.testing.assert_allclose(tips._of_field(study, even), expected, rtol=1e-12)
    rng = np.random.default_rng(0)
    mixed = ContactSolution(pressure=rng.uniform(0.0, 18.0, (9, 9)), load=1.0, pixel_size=0.4518, modulus=35.3)
    expected = tips.of_pressure(study, mixed.pressure[mixed.contact]).mean(axis=0)
    np.testing.assert_allclose(tips._of_field(study, mixed), expected, rtol=1e-12)


def test_area_explains_most_pressure_nearly_all_of_the_rest_and_the_rim_some(study):
    nothing, area, mean, field, rim = (one.rms for one in study.collapses)
    assert area < 0.6 * nothing
    assert mean < 0.35 * area
    assert field < 0.35 * area
    assert rim <= field
    # the few replicas of a quick study are most of what is left
    assert rim < 3 * study.noise
    assert study.noise < 0.05
    late = study.contacts[0].at(1e3)
    assert 0 < study.rim[late] < 0.1


def test_bonds_are_counted_per_the_area_of_the_pixels(study):
    one = study.group("tip")[0]
    bonds = one.aging.mean_friction_drop / 3.0
    np.testing.assert_allclose(one.density * one.contact.sites.size * 0.4518**2, bonds, rtol=1e-12)
    spread = one.aging.friction_drop_stderr / 3.0 / one.contact.area
    np.testing.assert_allclose(one.density_error, spread, rtol=1e-12)


@pytest.mark.long
def test_the_study_writes_a_page_tables_and_figures_and_keeps_what_is_there(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    done = command("study", "tips", "--quick", "--out", "s")
    assert done.status == 0, done.err
    paths = [tmp_path / line for line in done.out.split()]
    assert [path.name for path in paths if path.suffix != ".png"] == ["tips.md", "tips-contacts.csv", "tips-curves.csv"]
    assert all(path.stat().st_size > 1000 for path in paths)
    text = paths[0].read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert sorted(shown) == sorted(f"figures/{path.name}" for path in paths if path.suffix == ".png")
    assert "nan" not in text
    rows = list(csv.DictReader(paths[1].read_text(encoding="utf-8").splitlines()))
    assert {row["interaction (eV)"] for row in rows} == {"0.1", "0.5"}
    for row in rows:
        drop, density = float(row["friction drop at 1000 s (nN)"]), float(row["bonds per area at 1000 s (1/nm^2)"])
        assert drop == pytest.approx(3 * density * float(row["area (nm^2)"]), rel=1e-4)
    lines = paths[2].read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 21 * len(rows)
    before = paths[0].read_bytes()
    again = command("study", "tips", "--quick", "--out", "s")
    assert again.status == 2
    assert "already there" in again.err
    assert paths[0].read_bytes() == before


def test_a_study_that_does_not_exist_is_named(command):
    done = command("study", "tops")
    assert done.status == 2
    assert "no study 'tops'" in done.err
    assert "there are: tips, density" in done.err


def test_paragraphs_are_filled_and_tables_are_not():
    wide = "| " + "x " * 100 + "|"
    filled = pages.filled(f"# A\n\nword\n{'w ' * 100}\n\n- {'a ' * 80}\n- b\n\n{wide}\n")
    assert all(len(line) <= 120 for line in filled.splitlines() if not line.startswith("|"))
    assert wide in filled
    assert "\n- b" in filled
    assert math.isclose(filled.count("w "), 100, abs_tol=3)
