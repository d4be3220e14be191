"""The reproduction's own arithmetic, and its sweeps on coarse surfaces; the paper's numbers are in test_paper.py."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import chemage
from chemage import InputError
from chemage_li2018 import (
    claims,
    command,
    estimates,
    figures,
    measures,
    published,
    reproduction_page,
    sweeps,
)
from chemage_li2018.comparisons import Line, lines
from chemage_li2018.published import PublishedNumber
from chemage_li2018.sweeps import Mean, PointSet, StudyPoint, studies_of
from chemage_silica import MDSilica

PIXELS = 320
SEED = sweeps.SURFACE_SEEDS[0]
LOADS = [point["contact.load"] for point in sweeps.members("loads")]
STRENGTHS = [point["interaction.strength"] for point in sweeps.members("interaction")]


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, chemage.SweepResult], Path]:
    """Every target of one coarse surface, with few replicas."""
    folder = tmp_path_factory.mktemp("reproduction")
    made = {}
    for base, data in sweeps.scenes(list(sweeps.TARGETS), (SEED,), PIXELS).items():
        columns = data["sweep"]["zip"][0]
        columns["hold.replicas"] = [min(count, 4) for count in columns["hold.replicas"]]
        if base != "rough":  # warm contacts form and break bonds without end
            data = {**data, "hold": {**data["hold"], "stop": 1e3}}
            columns["hold.stop"] = [1e3] * len(columns["hold.replicas"])
        made[base] = chemage.sweep(data, folder / base)
    return made, folder


def points(coarse: tuple[dict[str, chemage.SweepResult], Path], *targets: str) -> sweeps.Studies:
    read = [StudyPoint.of(point) for point in coarse[0]["rough"]]
    return studies_of(read, targets)


def test_every_target_of_the_paper_is_there():
    """Figures 1 to 6, Table 1, κ, the supplement and the text; studies of our own have names of their own."""
    assert {*(f"fig{number}" for number in range(1, 7)), "table1", "kappa"} <= set(sweeps.TARGETS)
    assert {"maps", "areas", "barriers", "estimates"} <= set(sweeps.TARGETS)
    assert {"interaction", "temperature", "tips"} <= set(sweeps.TARGETS)
    assert set(figures.NAMES) == set(reproduction_page.CAPTIONS)
    assert set(sweeps.TARGETS) - set(figures.NAMES) <= {"estimates", "calibration"}


@pytest.mark.long
def test_every_target_is_drawn_and_written(coarse: tuple[dict[str, chemage.SweepResult], Path]):
    results, folder = coarse
    assert not any(result.failed for result in results.values())
    names = [name for name in sweeps.TARGETS if name not in ("temperature", "tips")]
    made = [StudyPoint.of(point) for point in results["rough"]]
    found = command.write(made, names, folder, seeds=(SEED,), pixels=PIXELS)
    text = (folder / "reproduction.md").read_text(encoding="utf-8")
    for name in set(figures.NAMES) & set(names):
        assert (folder / reproduction_page.FIGURES / f"{name}.png").stat().st_size > 10_000
        assert f"{reproduction_page.FIGURES}/{name}.png" in text
    assert {line.target for line in found.lines} == {"kappa", "table1", "fig3", "fig6"}
    assert {claim.target for claim in found.claims} == {"fig2", "fig3", "fig4", "fig5", "table1", "interaction"} | {
        "estimates",
        "calibration",
    }
    assert all(claim.sentence in text for claim in found.claims)
    assert {claim.word for claim in found.claims if claim.test and claim.test.errors is None} == {"cannot tell"}
    assert all(one.statement in text for one in found.estimates)


@pytest.mark.long
def test_claims_about_kinetics_do_not_need_fine_pixels(coarse: tuple[dict[str, chemage.SweepResult], Path]):
    """Trend, saturation and barriers follow from barriers and mean pressure; they hold on coarse surfaces too.

    The times in the claims on Fig. 3 depend on the density, which is fitted to none of them; the page has them.
    """
    found = points(coarse, "fig3", "fig4", "interaction")
    made = claims.claims(found, ["fig3", "fig4", "interaction"])
    chosen = [one for one in made if one.target != "fig3" or one.sentence.startswith("with ΔV, Δμ rises")]
    assert len(chosen) == 3
    assert [one.sentence for one in chosen if one.test is None or not one.test.accepts(one.test.values)] == []


@pytest.mark.long
def test_fig5_is_straight_at_every_slope_without_activation_volume(
    coarse: tuple[dict[str, chemage.SweepResult], Path],
):
    """At 320 pixels with four replicas a few hundred sites are left, hence the margin; the page has 0.95."""
    group = studies_of([StudyPoint.of(p) for p in coarse[0]["rough"]], ["fig5"])["rows"]
    x, y = measures.morphology(group.by_volume()[0.0].by("rms_slope")[0.05])
    assert np.corrcoef(x, y)[0, 1] > 0.9


@pytest.mark.long
def test_contacts_are_shared_between_figures(coarse: tuple[dict[str, chemage.SweepResult], Path]):
    """28 contacts per surface: seven loads, seven rows at three slopes of which one is a load, and Fig. 6."""
    rough = coarse[0]["rough"]
    assert len({rough.contact_key(point.index) for point in rough}) == 28


def size(scene) -> int:
    """The number of points of a sweep."""
    axes = dict(scene["sweep"])
    groups = [next(iter(group.values())) for group in axes.pop("zip", ())]
    return math.prod(len(values) for values in [*groups, *axes.values()])


def test_every_member_of_the_density_is_computed():
    for study in ("members", "warm members"):
        assert {point["forming.member"] for point in sweeps.members(study)} == set(range(MDSilica.MEMBERS))


def test_the_replicas_are_as_many_as_those_of_the_paper():
    """Four at 200 µN and above, where a replica has ten times the sites of one at 20 µN and less noise."""
    for study in ("rows", "interaction", "front", "slopes"):
        assert {point["hold.replicas"] for point in sweeps.members(study)} == {10}
    counts = {point["contact.load"]: point["hold.replicas"] for point in sweeps.members("loads")}
    assert {count for load, count in counts.items() if load < 2e5} == {10}
    assert counts[2e5] == counts[5e5] == 4


def test_one_target_needs_only_its_own_points():
    data = sweeps.scenes(["fig6"], (101, 102), PIXELS)
    assert list(data) == ["rough"]
    assert size(data["rough"]) == 2 * 5
    assert size(sweeps.scenes(["table1"], (101,), PIXELS)["rough"]) == 7
    assert "surface.seed" not in sweeps.scenes(["tips"], (101,))["tip"]["sweep"]["zip"][0]


def test_equal_points_of_two_targets_are_computed_once_with_the_most_replicas():
    """Fig. 1 needs one replica of the reference, and Fig. 2 ten."""
    both = sweeps.scenes(["fig1", "fig2"], (101,), PIXELS)["rough"]["sweep"]["zip"][0]
    assert len(both["contact.load"]) == len(LOADS)
    assert both["hold.replicas"][both["contact.load"].index(20000.0)] == 10


def test_seeds_were_not_used_to_fit_the_barriers():
    """The density and the scene are fitted and chosen on seeds below 100."""
    assert min(sweeps.SURFACE_SEEDS) > 100


# -- words ------------------------------------------------------------------------------------------------------------


def test_a_mean_has_the_digits_of_its_own_error():
    """Four surfaces with 95.7 ± 25: the mean is known to ± 12.5, and is not 100."""
    assert str(Mean(95.7, 25.0, 4)) == "96 ± 25"
    assert line("113", 95.7, 25.0).shown == "-15.3%"


def line(paper: str, value: float, scatter: float = math.nan, **more: Any) -> Line:
    return Line("fig3", "β", PublishedNumber.of(paper), Mean(value, scatter, 4), **more)


def test_a_published_number_stands_for_its_rounding():
    assert PublishedNumber.of("0.01")[1:] == pytest.approx((0.005, 0.015))
    assert PublishedNumber.of("0.20")[1:] == pytest.approx((0.195, 0.205))
    assert PublishedNumber.of("160")[1:] == pytest.approx((159.5, 160.5))
    assert PublishedNumber.of("2 to 2.3")[1:] == (2.0, 2.3)
    assert PublishedNumber.of("2 to 2.3").value is None


def test_a_number_agrees_where_one_more_surface_may_have_it():
    """Four surfaces: one more lies within t(3) s √(1 + 1/4) = 3.56 s of their mean with 95 %."""
    assert Mean(1.0, 0.1, 4).one_more == pytest.approx(3.1824 * 0.1 * math.sqrt(1.25), rel=1e-4)
    assert line("1.00", 1.3, 0.1).word == "predicted"
    assert line("1.00", 1.4, 0.1).word == "disagrees"
    assert line("2 to 2.3", 2.5, 0.1).word == "predicted"
    assert line("1.00", 1.3).word == "cannot tell"


def test_a_number_that_would_agree_if_it_were_half_as_large_again_tells_nothing():
    """3.56 s + 0.84 s are noticed in 80 %: a factor of 1.44 for s = 0.1, and of 1.88 for 0.2."""
    assert line("1.00", 1.0, 0.1).noticed == pytest.approx(1.445, abs=0.01)
    assert line("1.00", 1.0, 0.2).word == "cannot tell"
    assert line("0.01", 0.0149, 0.0001).word == "predicted"


def test_a_number_that_rests_on_a_reading_or_on_a_choice_is_not_predicted():
    readings = {"the same": Mean(1.1, 0.1, 4), "another": Mean(2.0, 0.1, 4)}
    assert line("1.00", 1.0, 0.1, readings=readings).word == "read as"
    assert line("1.00", 1.0, 0.1, readings=readings).refused == ["another"]
    assert line("1.00", 1.0, 0.1, chosen=True).word == "read as"


def test_a_fitted_number_is_never_called_predicted():
    for value in (1.0, 1.05, 3.0):
        assert line("1.0", value, calibrated=True).word == "calibrated"


@pytest.mark.long
def test_the_six_fitted_beta_are_called_calibrated(coarse: tuple[dict[str, chemage.SweepResult], Path]):
    found = lines(points(coarse, "fig3"), ["fig3"])
    assert [one.word for one in found] == ["calibrated"] * 6
    text = reproduction_page.page(
        reproduction_page.Reproduction(found, []),
        ["fig3"],
        seeds=(101,),
        pixels=PIXELS,
        versions=NO_VERSIONS,
    )
    assert "| yes |" not in text
    assert text.count("| calibrated |") == 6


NO_VERSIONS: dict[str, str] = {"chemage": "0", "numpy": "0", "numba": "0", "processor": "none"}


def test_what_disagrees_is_listed():
    text = reproduction_page.page(
        reproduction_page.Reproduction([line("1.0", 2.0, 0.01)], []),
        ["fig2"],
        seeds=(101, 102),
        pixels=2500,
        versions=NO_VERSIONS,
    )
    assert "Disagree: β (+100.0%)" in text
    assert text.count("**disagrees**") == 1
    assert "Coarse surfaces" not in text


# -- arithmetic -------------------------------------------------------------------------------------------------------


def synthetic(strength: float, drop: float, seed: int) -> StudyPoint:
    times = np.logspace(-3, 5, 33)
    changes = {**sweeps.members("interaction")[0], "interaction.strength": strength, "surface.seed": seed}
    return StudyPoint(changes, {"load": 2e4}, times, np.full(33, drop * (1 + 0.01 * seed)), np.zeros(33))


def test_a_claim_that_is_false_is_reported_as_false():
    """Friction that keeps falling beyond 0.5 eV is no saturation."""
    for end, word in ((1.0, "disagrees"), (0.5, "predicted")):
        made = [synthetic(x, 100 - 60 * min(x, end), seed) for x in STRENGTHS for seed in range(4)]
        (claim,) = claims.claims({"interaction": PointSet(made)}, ["interaction"])
        assert claim.word == word
        assert claim.test is not None
        assert claim.test.accepts(claim.test.values) == (word == "predicted")


def straight(beta: float, start: float) -> StudyPoint:
    """Δμ = β log10(t / start) from ``start`` on, under a load of 2 nN."""
    times = np.logspace(-3, 5, 33)
    changes = {"chemistry.activation_volume": 0.0064}
    return StudyPoint(
        changes, {"beta": beta, "load": 2.0}, times, 2 * beta * np.maximum(0, np.log10(times / start)), np.zeros(33)
    )


def test_onset_of_an_exact_line():
    """ΔF = max(0, log10 t/3 s) has half its slope at 3 s, to within the spacing of the hold times."""
    assert measures.onsets(PointSet([straight(1.0, 3.0)]))[0] == pytest.approx(3.0, rel=0.4)


def test_slope_over_a_window():
    assert PointSet([straight(0.3, 1.0)]).beta((1e2, 1e5))[0] == pytest.approx(0.3)


def test_crossing_of_two_exact_lines():
    """2 log10 t and 1 + log10 t meet at 10 s; lines that do not cross have none."""
    lower, upper = PointSet([straight(2.0, 1.0)]), PointSet([straight(1.0, 0.1)])
    assert measures.crossings(lower, upper) == pytest.approx([10.0], rel=0.01)
    assert np.isnan(measures.crossings(upper, PointSet([straight(2.0, 0.1)]))).all()


def test_summit_of_a_parabola():
    kelvin = [250.0, 300.0, 350.0]
    assert measures.summit(kelvin, [-((t - 310.0) ** 2) for t in kelvin]) == pytest.approx(310.0)
    assert measures.summit(kelvin, [3.0, 2.0, 1.0]) == 250.0


def test_adhesive_force_that_explains_the_tips():
    """(23 + F) / (393 + F) is the ratio of the bonds per decade, 345/589.5, to the power 3/2: F is about 278 nN."""
    share = (15 * 23 / (1.5 * 393)) ** 1.5
    force = (share * 393 - 23) / (1 - share)
    text = " ".join(reproduction_page.REASONS["tips"].split())
    assert f"about {force:.0f} nN" in text
    assert "a ratio of 1.7 at" in text


def test_the_literal_activation_volume():
    """0.04 Å³ is 0.00004 nm³, a thousandth of 0.04 eV/GPa (6.4 Å³) but for the factor 6.24."""
    assert chemage.plugin.convert("0.04 angstrom**3", "nm**3") == pytest.approx(0.04e-3)


def test_bands_over_the_members_are_relative_to_the_default():
    def point(member: int, beta: float, slope: float, volume: float) -> StudyPoint:
        one = straight(beta, 1.0)
        changes = {"forming.member": member, "surface.rms_slope": slope, "chemistry.activation_volume": volume}
        changes["chemistry.hydroxylation"] = 0.5 if slope == 0.4 else 1.0
        return StudyPoint(changes, one.summary, one.hold_times, one.friction_drop, one.friction_drop_half_width)

    def row(member: int, beta: float) -> list[StudyPoint]:
        lattice = [(h, v) for v in sweeps.VOLUMES for h in published.SLOPES] + [(0.4, sweeps.WITH_PRESSURE)]
        return [point(member, beta, slope, volume) for slope, volume in lattice]

    members = [*row(0, 1.0), *row(1, 0.9), *row(2, 1.2)]
    found = estimates.bands({"members": PointSet(members), "slopes": PointSet(row(0, 0.45)[:6]), "front": fronts()})
    assert len(found) == 7
    for band in found:
        assert (band.low, band.high) == pytest.approx((-0.1, 0.2))
        assert band.members == 3
    assert found[1].line.difference == pytest.approx(0.0)
    assert [band.line.word for band in found] == ["calibrated"] * 6 + ["cannot tell"]


@pytest.mark.parametrize("steady", [True, False])
def test_every_density_must_have_the_trends_of_the_paper(steady: bool):
    """Lines that cross at 10 s (with ΔV) and parallel lines (without); one density may have parallel ones in both."""

    def point(member: int, lines: tuple[StudyPoint, StudyPoint], volume: float) -> list[StudyPoint]:
        return [
            replace(
                line,
                changes={"forming.member": member, "surface.rms_slope": slope, "chemistry.activation_volume": volume},
            )
            for slope, line in zip((0.05, 0.2), lines, strict=True)
        ]

    crossing, parallel = (straight(2.0, 0.5), straight(1.0, 0.02)), (straight(2.0, 0.1), straight(1.0, 0.1))
    group = [*point(0, crossing, 0.0064), *point(0, parallel, 0.0)]
    group += [*point(1, crossing if steady else parallel, 0.0064), *point(1, parallel, 0.0)]
    (found,) = claims.claims({"members": PointSet(group)}, ["calibration"])
    assert found.word == ("calibrated" if steady else "disagrees")


def fronts() -> PointSet:
    """The points of Fig. 6, all of one curve."""
    return PointSet(replace(straight(0.45, 1.0), changes=changes) for changes in sweeps.members("front"))


@pytest.mark.long
def test_estimates_are_labelled(coarse: tuple[dict[str, chemage.SweepResult], Path]):
    found = list(estimates.estimates(points(coarse, "estimates")))
    assert [one.word for one in found] == ["cannot tell", "calibrated", *4 * [""]]
    assert any("extrapolation" in one.how for one in found)


# -- input ------------------------------------------------------------------------------------------------------------


def test_unknown_target_names_the_nearest():
    with pytest.raises(InputError, match=r"no target 'fig7'.*did you mean 'fig"):
        sweeps.chosen(["fig7"])
    assert sweeps.chosen([]) == sweeps.chosen(["all"]) == list(sweeps.TARGETS)


def test_surfaces_too_coarse_for_the_shortest_wave_are_refused():
    with pytest.raises(InputError, match="320 or more"):
        sweeps.scenes(["fig1"], (101,), 256)


def test_published_numbers_are_the_ones_checked():
    assert published.BETA == [0.89, 0.45, 0.20, 0.98, 0.49, 0.24]
    assert [row.patches for row in published.TABLE_1] == ["160", "499", "1013", "75", "14", "435", "113"]


# -- the page in the documentation ------------------------------------------------------------------------------------

DOCS = Path(__file__).parents[2] / "plugins" / "chemage_li2018" / "docs"


def test_the_page_uses_the_five_words_and_no_other():
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    fitted = [line for line in text.splitlines() if line.startswith("| fig3 | β")]
    assert len(fitted) == 6
    assert all("| calibrated |" in line for line in fitted)
    words = {"calibrated", "predicted", "read as", "cannot tell", "**disagrees**", "–"}
    for title in ("Numbers", "Calibration", "Claims", "Estimates of the text"):
        table = text.partition(f"## {title}\n\n")[2].partition("\n\n")[0].splitlines()[2:]
        assert table, title
        assert {line.strip("| ").split(" | ")[-1] for line in table} <= words, title


@pytest.mark.long
def test_the_page_is_what_the_command_writes_of_the_stored_points():
    assert reproduction_page.of_points(DOCS / "reproduction.npz")[1] == (DOCS / "reproduction.md").read_text("utf-8")


def test_stored_points_are_those_that_were_computed(tmp_path):
    one = straight(0.3, 1.0)
    changes = {**sweeps.members("loads")[0], "surface.seed": 101}
    noise = np.linspace(0.01, 0.02, 33)
    point = replace(one, changes=changes, observables={"pressures": np.arange(3.0)}, friction_drop_half_width=noise)
    # of one replica
    other = replace(straight(0.5, 2.0), hold_times=np.logspace(-3, 4, 29), friction_drop=np.arange(29.0))
    other = replace(other, friction_drop_half_width=np.full(29, np.nan))
    sweeps.save_points(tmp_path / "points.npz", [point, other], {"pixels": 320})
    (first, second), about = sweeps.read_points(tmp_path / "points.npz")
    assert about == {"pixels": 320}
    assert (first.changes, first.summary) == (point.changes, point.summary)
    np.testing.assert_array_equal(second.hold_times, other.hold_times)
    np.testing.assert_allclose(first.friction_drop, point.friction_drop, rtol=1e-6)
    np.testing.assert_array_equal(first.observables["pressures"], [0, 1, 2])
    np.testing.assert_allclose(first.friction_drop_half_width, noise, rtol=1e-6)
    np.testing.assert_array_equal(second.friction_drop_half_width, other.friction_drop_half_width)
    assert not second.observables


def test_the_page_is_of_several_surfaces_that_tuned_nothing():
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    assert "8 surfaces per row (seeds 101 to 108)" in text
    assert "2500 x 2500 pixels" in " ".join(text.split())


def test_every_figure_of_the_page_exists():
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    for name in figures.NAMES:
        assert f"(figures/reproduction/{name}.png)" in text
        assert (DOCS / "figures" / "reproduction" / f"{name}.png").is_file()


def test_what_the_density_was_fitted_to_is_not_called_predicted():
    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    for statement in ("the order of the slopes reverses", "the logarithmic regime starts", "the form of the barrier"):
        line = next(line for line in text.splitlines() if statement in line)
        assert line.endswith("| calibrated |"), statement
