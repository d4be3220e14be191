"""The page from a microscope to a prediction: its scene, on its real image, gives the numbers that it prints."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest

import chemage as ca

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8").partition("## A tip on an image")[2]


@pytest.mark.long
def test_the_scene_of_the_page_gives_the_numbers_of_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "tests" / "data" / "topographies" / "afm.txt", tmp_path)
    (scene,) = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    mean = ca.ensemble(ca.parse_scene(tomllib.loads(scene), "tip"), surfaces=8)
    for name, label in (("beta", "ageing rate per decade β"), ("area_fraction", "area fraction A/A0")):
        printed = re.findall(rf"^ {label} +([\d.]+) ± ([\d.]+)", PAGE, re.MULTILINE)[0]
        found = mean.estimate(name)
        for number, text in zip((found.value, found.half_width), printed, strict=True):
            # to the last printed digit
            assert number == pytest.approx(float(text), abs=0.6 * 10.0 ** -len(text.partition(".")[2]))
    assert set(mean.estimate("beta").errors) == {"surfaces", "replicas", "measurement"}
    assert "error of β: scatter between places" in PAGE
    assert "error of β: scatter between replicas" in PAGE
