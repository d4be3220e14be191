"""The scenes of the Contact-Mechanics Challenge and of tips beside rough contacts vary what they say, nothing else."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

import chemage as ca
from chemage.plugin import override, scene_data


def points(name: str) -> list[ca.Scene]:
    """The scene of every point of a sweep."""
    data, _ = scene_data(name)
    axes: dict[str, Any] = data.pop("sweep")
    groups = [list(zip(*group.values(), strict=True)) for group in axes.pop("zip", ())]
    paths = [*(tuple(group) for group in scene_data(name)[0]["sweep"].get("zip", ())), *((path,) for path in axes)]
    values = [*groups, *([(value,) for value in column] for column in axes.values())]
    chosen = itertools.product(*values)
    return [
        ca.parse_scene(override(data, dict(zip(itertools.chain(*paths), itertools.chain(*of), strict=True))))
        for of in chosen
    ]


def assert_problem(scene: ca.Scene) -> None:
    """Müser et al. 2017: E* 25 MPa, H 0.8, roll-off at 20 µm, cut-off at 0.1 µm, rms gradient 1."""
    surface: Any = scene.surface
    side = surface.pixels[0] * surface.pixel_size
    assert (surface.hurst, surface.rms_slope, scene.contact.todict()["modulus"]) == (0.8, 1.0, 0.025)
    assert side / surface.eta == pytest.approx(2e4)
    assert side / surface.zeta == pytest.approx(100)


def pressures(scenes: list[ca.Scene]) -> list[float]:
    sides: list[Any] = [scene.surface for scene in scenes]
    return [scene.load / (side.pixels[0] * side.pixel_size) ** 2 for scene, side in zip(scenes, sides, strict=True)]


def test_the_scene_is_the_problem_of_the_publication():
    scene = ca.load_scene("contact-challenge")
    assert_problem(scene)
    assert pressures([scene]) == pytest.approx([2.5e-4])


@pytest.mark.parametrize(("what", "count"), [("loads", 32), ("pixels", 6), ("sizes", 12)])
def test_parts_change_one_thing_each(what, count):
    scenes = points(f"contact-challenge-{what}")
    assert len(scenes) == count
    surfaces: list[Any] = [scene.surface for scene in scenes]
    for scene in scenes:
        assert_problem(scene)
    sizes = {round(surface.pixel_size, 6) for surface in surfaces}
    sides = {round(surface.pixels[0] * surface.pixel_size) for surface in surfaces}
    loads = {round(pressure, 9) for pressure in pressures(scenes)}
    assert (len(loads), len(sizes), len(sides)) == {"loads": (8, 1, 1), "pixels": (1, 3, 1), "sizes": (1, 1, 3)}[what]


def test_tips_and_rough_contacts_have_one_chemistry_and_the_papers_nominal_pressure():
    tips, patches = points("silica-tips"), points("silica-patches")
    chemistries = {repr(scene.chemistry) for scene in (*tips, *patches, ca.load_scene("silica-patch"))}
    assert len(chemistries) == 1
    assert len({scene.surface.todict()["pixel_size"] for scene in (*tips, *patches)}) == 1
    reference = ca.load_scene("silica-rough")
    assert pressures(patches) == pytest.approx(len(patches) * pressures([reference]), rel=2e-3)
    surfaces: list[Any] = [scene.surface for scene in (*patches, reference)]
    shortest = [one.pixels[0] * one.pixel_size / one.zeta for one in surfaces]
    assert shortest == pytest.approx([shortest[-1]] * len(shortest), rel=0.02)


def test_the_tips_span_what_the_comparison_is_about():
    tips = points("silica-tips")
    radii, loads = {scene.surface.todict()["radius"] for scene in tips}, {scene.load for scene in tips}
    assert (min(radii), max(radii)) == (10, 100)
    assert (min(loads), max(loads)) == (20, 400)
    assert len(tips) == len(radii) * len(loads) == 16


def test_a_study_that_does_not_exist_is_named(command):
    done = command("study", "dnsity")
    assert done.status == 2
    assert "no study 'dnsity'" in done.err
    assert "there is: density" in done.err
