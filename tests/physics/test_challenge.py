"""The study of the Contact-Mechanics Challenge: its problem is that of the publication, and it says what it found."""

from __future__ import annotations

import csv
import math
import re

import numpy as np
import pytest

import chemage as ca
from chemage_li2018 import challenge


def test_the_scene_is_the_problem_of_the_publication():
    """Müser et al. 2017: E* 25 MPa, H 0.8, 100 µm, roll-off at 20 µm, cut-off at 0.1 µm, rms gradient 1, 250 kPa."""
    scene = ca.load_scene("contact-challenge")
    surface, side = scene.surface, scene.surface.pixels[0] * scene.surface.pixel_size
    assert (surface.hurst, surface.rms_slope, scene.contact.modulus) == (0.8, 1.0, 0.025)
    assert side == pytest.approx(1e5)
    assert side / surface.eta == pytest.approx(2e4)
    assert side / surface.zeta == pytest.approx(100)
    assert scene.load / side**2 == pytest.approx(2.5e-4)


def test_parts_change_one_thing_each():
    parts = challenge.sweeps(quick=False, file=None)
    assert set(parts) >= {"loads", "shape", "pixels", "sides"}
    for name, data in parts.items():
        (columns,) = data["sweep"]["zip"]
        points = len(next(iter(columns.values())))
        for at in range(points):
            changed = {path: column[at] for path, column in columns.items()}
            scene = ca.parse_scene(ca.plugin.override({k: v for k, v in data.items() if k != "sweep"}, changed))
            surface = scene.surface
            side = surface.pixels[0] * surface.pixel_size
            assert side / surface.eta == pytest.approx(2e4)
            assert side / surface.zeta == pytest.approx(100)
            assert side == pytest.approx(1e5) or name not in ("loads", "shape", "pixels")
            assert name == "loads" or scene.load / side**2 == pytest.approx(2.5e-4)
            assert name not in ("sides", "loads", "shape") or surface.pixel_size == pytest.approx(24.4140625)


@pytest.mark.long
def test_the_study_writes_what_it_found_and_goes_on_where_it_ended(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    done = command("study", "challenge", "--quick", "--out", "s")
    assert done.status == 0, done.err
    page, table, drawn = (tmp_path / line for line in done.out.split())
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text) == [f"figures/{drawn.name}"]
    assert "nan" not in text
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    loads = [row for row in rows if row["part"] == "loads" and row["seed"] == "1"]
    for name, sign in (("area", 1), ("corrected", 1), ("mean_gap", -1), ("largest", 1)):
        values = [float(row[name]) for row in loads]
        assert np.all(sign * np.diff(values) > 0), name
    # between Persson's theory and that of Bush, Gibson & Thomas (Hyun & Robbins, Tribol. Int. 40, 1413 (2007))
    for row in loads:
        kappa = float(row["corrected"]) / (float(row["pressure"]) / 0.025)
        assert math.sqrt(8 / math.pi) < kappa < math.sqrt(2 * math.pi)
    shape = next(row for row in rows if row["part"] == "shape")
    assert shape["mean_gap"] == next(row["mean_gap"] for row in loads if row["pressure"] == shape["pressure"])
    again = command("study", "challenge", "--quick", "--out", "s", "--force")
    assert again.status == 0
    assert table.read_text(encoding="utf-8").splitlines()[1].startswith("loads,fft-bem,1,256")


@pytest.mark.long
def test_a_surface_by_file_is_pressed_at_every_load(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    rough = ca.surface("self-affine", pixels=64, pixel_size=100, rms_slope=1, hurst=0.8, zeta=8, eta=2).make(1)
    np.savetxt("map.txt", rough.heights, header="pixel_size = 100 nm")
    done = command("study", "challenge", "--surface", "map.txt", "--out", "s")
    assert done.status == 0, done.err
    text = (tmp_path / "s" / "challenge.md").read_text(encoding="utf-8")
    assert "The surface is that of a file, on 64² pixels" in text
    assert "## Pixels" not in text
    refused = command("study", "tips", "--surface", "map.txt")
    assert refused.status == 2
    assert "makes its own surfaces" in refused.err


def test_mean_gap_of_a_contact_follows_from_its_approach():
    data = {"name": "one", **challenge.sweeps(quick=True, file=None)["shape"]}
    scene = ca.parse_scene({name: value for name, value in data.items() if name != "sweep"})
    surface = ca.make_surface(scene.surface, 1)
    contact = ca.solve_contact(scene.contact, surface, scene.load)
    assert contact.gap is not None
    assert contact.displacement is not None
    top = surface.heights.max() - surface.heights.mean()
    assert top - contact.displacement == pytest.approx(contact.gap.mean(), rel=1e-4)


def test_a_law_that_is_linear_in_the_pixel_is_extrapolated_exactly():
    assert challenge.extrapolated(2 + 0.3 * 2, 2 + 0.3) == pytest.approx(2)
