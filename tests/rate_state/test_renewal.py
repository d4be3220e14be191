"""Slip that renews a contact, against closed forms and chords counted independently."""

from __future__ import annotations

import json
from itertools import groupby

import numpy as np
import pytest

import chemage as ca
from chemage import InputError

ROUGH = {
    "name": "rough",
    "surface": {
        "kind": "self-affine",
        "pixels": 128,
        "pixel_size": "0.5 nm",
        "rms_slope": 0.1,
        "hurst": 0.8,
        "zeta": 12,
    },
    "contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "1 uN"},
}
SPHERE = {
    "name": "sphere",
    "surface": {"kind": "sphere", "radius": "200 nm", "pixels": 128, "pixel_size": "0.5 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "1 uN"},
}


def quantities(renewal):
    return {one.name: one.value for one in renewal.quantities()}


def test_a_disc_is_renewed_after_the_mean_age_of_its_chords():
    """Chords L of a disc: ⟨L²⟩/2⟨L⟩ = 8a/3π."""
    found = quantities(ca.slip_length(ca.parse_scene(SPHERE), surfaces=1))
    radius = (3 * 1000 * 200 / (4 * 35.3)) ** (1 / 3)
    assert found["slip_length"] == pytest.approx(8 * radius / (3 * np.pi), rel=5e-3)
    assert found["mean_chord"] == pytest.approx(np.pi * radius / 2, rel=0.02)


def test_ages_are_those_of_runs_of_contacts_that_are_counted_one_by_one():
    """A few steps of two rough surfaces, with loops over sites."""
    scene = ca.parse_scene(ROUGH)
    renewal = ca.slip_length(scene, surfaces=1, slip=2.0)
    lower, upper = (ca.make_surface(scene.surface, seed).heights for seed in (0, 1_000_003))
    maps, start = [], None
    for step in range(5):
        heights = (lower + np.roll(upper, step, axis=0)) / np.sqrt(2)
        start = ca.solve_contact(scene.solver, ca.Surface(heights=heights, pixel_size=0.5), 1000.0, start=start)
        maps.append(start.contact)
    shares = []
    for rolled in (0, 1):
        frame = np.array([np.roll(one, -rolled * step, axis=0) for step, one in enumerate(maps)])
        stayed, seen = np.zeros(5), np.zeros(5)
        for site in range(frame[0].size):
            there = frame.reshape(5, -1)[:, site]
            for last in range(5):
                if there[last]:
                    (_, run), *_ = ((key, len(list(group))) for key, group in groupby(there[last::-1]))
                    for lag in range(last + 1):
                        seen[lag] += 1
                        stayed[lag] += run > lag
        shares.append(stayed / seen)
    assert renewal.unrenewed[0] == pytest.approx(np.mean(shares, axis=0), abs=1e-12)


def test_what_is_not_renewed_falls_with_slip():
    renewal = ca.slip_length(ca.parse_scene(ROUGH), surfaces=2)
    assert (renewal.unrenewed[:, 0] == 1).all()
    assert (np.diff(renewal.unrenewed.mean(axis=0)) <= 1e-3).all()
    found = quantities(renewal)
    assert 0.5 < found["slip_length"] / found["mean_chord"] < 3


@pytest.mark.parametrize("slip", [0.1, 40.0])
def test_a_slip_below_a_pixel_or_beyond_half_the_side_is_refused(slip):
    with pytest.raises(InputError, match=r"from a pixel of 0\.5 nm to half the side, 32 nm"):
        ca.slip_length(ca.parse_scene(ROUGH), surfaces=1, slip=slip)


def test_random_surfaces_that_do_not_repeat_are_refused(monkeypatch):
    lone = ca.Surface(heights=np.zeros((8, 8)), pixel_size=0.5, periodic=False)
    monkeypatch.setattr("chemage_rate_state.renewal.make_surface", lambda *_: lone)
    with pytest.raises(InputError, match="does not repeat"):
        ca.slip_length(ca.parse_scene(ROUGH), surfaces=1)


def test_the_command_prints_the_slip_length(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rough.toml").write_text(
        'name = "rough"\n[surface]\nkind = "self-affine"\npixels = 64\npixel_size = "0.5 nm"\nrms_slope = 0.1\n'
        'hurst = 0.8\nzeta = 8\n[contact]\nkind = "fft-bem"\nmodulus = "35.3 GPa"\nload = "0.3 uN"\n'
    )
    done = command("slip-length", "rough.toml", "--surfaces", "2", "--slip", "3 nm")
    assert "slip length of renewal D_c" in done.out
    found = json.loads(command("slip-length", "rough.toml", "--surfaces", "2", "--slip", "3 nm", "--json").out)
    assert found["slip_length"]["value"] > 0
    assert "of the sites stay longer than this slip" in done.out


def test_a_sweep_gives_lines_for_each_point(command, tmp_path, monkeypatch):
    """Discs are renewed in proportion to their chord: D_c/(4A/C) = (8a/3π)/(πa/2)."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "discs.toml").write_text(
        'name = "discs"\n[surface]\nkind = "sphere"\nradius = "200 nm"\npixels = 256\npixel_size = "0.5 nm"\n'
        '[contact]\nkind = "hertz"\nmodulus = "35.3 GPa"\nload = "1 uN"\n'
        '[sweep]\n"contact.load" = ["0.3 uN", "0.6 uN", "1.5 uN", "3 uN"]\n'
    )
    found = json.loads(command("slip-length", "discs.toml", "--out", "discs.png", "--json").out)
    loads = (300.0, 600.0, 1500.0, 3000.0)
    for load, text in zip(loads, ("0.3 uN", "0.6 uN", "1.5 uN", "3 uN"), strict=True):
        length, chord = (found[f"{name} at contact.load = {text}"]["value"] for name in ("slip_length", "mean_chord"))
        assert length == pytest.approx(8 * (3 * load * 200 / (4 * 35.3)) ** (1 / 3) / (3 * np.pi), rel=5e-3)
        assert length / chord == pytest.approx(16 / (3 * np.pi**2), rel=0.02)
    assert (tmp_path / "discs.png").stat().st_size > 1000
    assert command("slip-length", "discs.toml").out.count("slip length of renewal D_c at contact.load = ") == 4
