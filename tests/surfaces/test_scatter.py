"""What another seed gives: what makers say, and what a run prints."""

from __future__ import annotations

import pytest

import chemage as ca

OPTIONS = {"pixels": 64, "pixel_size": 0.5, "hurst": 0.8, "zeta": 16}


def test_makers_say_what_another_seed_gives():
    assert ca.surface("sphere", radius=30, pixels=8, pixel_size=1).between() == ""
    rough = ca.surface("self-affine", rms_slope=0.1, **OPTIONS)
    assert rough.between() == "surfaces"
    assert rough.replace(rms_slope=0.0).between() == "", "flat at every seed"


@pytest.mark.long
def test_a_run_says_it_beside_the_error_of_the_replicas(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    changes = ["--set", "surface.pixels=256", "--set", "surface.zeta=15", "--set", "contact.load='2 uN'"]
    done = command("run", "silica-patch", "--no-figures", "--replicas", "3", "-o", "rough.h5", *changes)
    assert done.status == 0, done.err
    text = " ".join(done.out.split())
    assert "they do not include the scatter between surfaces" in text
    assert "β differs between surfaces by more than between replicas" in text
    assert "error of β: replicas" in text
    tip = command("run", "silica-tip", "--no-figures", "--replicas", "3", "-o", "tip.h5")
    assert "differs between" not in tip.out, "its surface does not depend on a seed"
    page = tmp_path / "page.html"
    command("report", "rough.h5", "tip.h5", "-o", str(page))
    assert "β differs between surfaces" in page.read_text(encoding="utf-8")
