"""The reproduction's own arithmetic, and its sweep on coarse surfaces; the paper's numbers are in test_paper.py."""

import math
from pathlib import Path

import numpy as np
import pytest

import chemage
from chemage import InputError
from chemage.sweeps.running import read_grid
from chemage_studies.reproduction import checks, command, published, studies
from chemage_studies.reproduction.points import Mean, Point, studies_of

PIXELS = 320


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> tuple[chemage.SweepResult, Path]:
    folder = tmp_path_factory.mktemp("reproduction")
    data = studies.scene(list(studies.TARGETS), (7,), PIXELS)
    data["hold"]["replicas"] = 4
    return chemage.sweep(data, folder / "sweep"), folder


def test_every_target_is_drawn_and_written(coarse: tuple[chemage.SweepResult, Path]):
    result, folder = coarse
    assert not result.failed
    lines, claims = command.write(result, list(studies.TARGETS), folder, seeds=(7,), pixels=PIXELS)
    text = (folder / "reproduction.md").read_text(encoding="utf-8")
    for name in studies.TARGETS:
        assert (folder / "figures" / f"{name}.png").stat().st_size > 10_000
        assert f"figures/{name}.png" in text
    assert {line.target for line in lines} == {"kappa", "table1", "fig3", "fig6"}
    assert {claim.target for claim in claims} == {"fig1", "fig2", "fig3", "fig4", "fig5"}
    assert all(claim.statement in text for claim in claims)


def test_claims_about_kinetics_do_not_need_fine_pixels(coarse: tuple[chemage.SweepResult, Path]):
    """Crossing, onset and saturation follow from barriers and mean pressure; they hold on coarse surfaces too."""
    result, _ = coarse
    found = studies_of((Point.of(point) for point in result), ["fig3", "fig4"])
    assert [claim.holds for claim in checks.claims(found, ["fig3", "fig4"])] == [True, True, True]


def test_contacts_are_shared_between_figures(coarse: tuple[chemage.SweepResult, Path]):
    result, _ = coarse
    contacts = {result.contact_key(point.index) for point in result}
    assert len(result) == 31
    assert len(contacts) == 19


def test_one_target_needs_only_its_own_points():
    grid = read_grid(studies.scene(["fig6"], (7, 8), PIXELS))
    assert grid.size == 2


def line(paper: float, value: float, scatter: float) -> checks.Line:
    return checks.Line("fig3", "β", paper, Mean(value, scatter, 4), 0.1)


def test_verdicts():
    assert line(1.0, 1.09, math.nan).within == "yes"
    assert line(1.0, 1.2, math.nan).within == "no"
    assert line(1.0, 1.2, 0.11).within == "scatter"
    assert line(1.0, 1.2, 0.09).within == "no"


def synthetic(strength: float, drop: float) -> Point:
    times = np.logspace(-3, 5, 33)
    changes = {**studies.members("interaction")[0], "interaction.strength": strength, "surface.seed": 7}
    return Point(changes, {"load": 2e4}, times, np.full(33, drop), np.zeros(33))


def test_a_claim_that_is_false_is_reported_as_false():
    """Friction that keeps falling beyond 0.5 eV is no saturation."""
    falling = [synthetic(strength, 100 - 60 * strength) for strength in studies.STRENGTHS]
    (claim,) = checks.claims({"interaction": falling}, ["fig4"])
    assert not claim.holds
    level = [synthetic(strength, 100 - 60 * min(strength, 0.5)) for strength in studies.STRENGTHS]
    (claim,) = checks.claims({"interaction": level}, ["fig4"])
    assert claim.holds


def test_onset_of_an_exact_line():
    """ΔF = max(0, log10 t/3 s) has half its slope at 3 s, to within the spacing of the hold times."""
    times = np.logspace(-3, 5, 33)
    drop = np.maximum(0.0, np.log10(times / 3.0))
    found = checks.onset([Point({}, {"beta": 1.0, "load": 1.0}, times, drop, np.zeros(33))])
    assert found == pytest.approx(3.0, rel=0.4)


def test_unknown_target_names_the_nearest():
    with pytest.raises(InputError, match=r"no target 'fig7'.*did you mean 'fig"):
        studies.chosen(["fig7"])
    assert studies.chosen([]) == studies.chosen(["all"]) == list(studies.TARGETS)


def test_surfaces_too_coarse_for_the_shortest_wave_are_refused():
    with pytest.raises(InputError, match="320 or more"):
        studies.scene(["fig1"], (7,), 256)


def test_published_numbers_are_the_ones_checked():
    assert published.BETA[6.4] == {0.05: 0.89, 0.1: 0.45, 0.2: 0.20}
    assert published.BETA[0.0] == {0.05: 0.98, 0.1: 0.49, 0.2: 0.24}
    assert [row.patches for row in published.TABLE_1] == [160, 499, 1013, 75, 14, 435, 113]
