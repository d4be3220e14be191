"""Tips: shapes against closed forms of their contact, places and roughness, and their mean over places."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from seen import result_of

import chemage as ca
from chemage.plugin import Scatter, SceneError, roughness

GRID = {"pixels": 129, "pixel_size": 0.25}
MODULUS = 35.3
FFT = {"kind": "fft-bem", "modulus": MODULUS}
SOLVER = ca.contact("fft-bem", modulus=MODULUS)
FLAT = ca.contact("hertz", modulus=MODULUS)
WAVES = {"pixels": 128, "pixel_size": 0.25, "hurst": 0.8, "zeta": 8}
ROUGH = {"kind": "self-affine", **WAVES, "rms_slope": 0.1}
BALL = {"kind": "sphere", "radius": 30, "pixels": 64, "pixel_size": 0.25}


def tip(**options):
    return ca.surface("tip", **options)


def load_of(slope, edge):
    """Sneddon: F = 2 E* ∫ r² f'(r) / √(a² − r²) dr from 0 to a, for a body f(r) and a contact of radius a."""
    integral, _ = quad(lambda angle: (edge * np.sin(angle)) ** 2 * slope(edge * np.sin(angle)), 0, np.pi / 2, limit=200)
    return 2 * MODULUS * integral


def edge_at(slope, load):
    return brentq(lambda edge: load_of(slope, edge) - load, 1e-3, 15)


def cone_slope(radius, angle):
    touch = radius * np.cos(angle)
    return lambda r: r / np.sqrt(radius**2 - r**2) if r < touch else 1 / np.tan(angle)


@pytest.mark.parametrize(
    ("body", "slope"),
    [
        ({"kind": "sphere", "radius": 30}, lambda r: r / 30),
        ({"kind": "spherical-cap", "radius": 30}, lambda r: r / np.sqrt(900 - r**2)),
        ({"kind": "cone", "radius": 2, "half_angle": "80 deg"}, cone_slope(2, np.radians(80))),
        ({"kind": "cone", "radius": 20, "half_angle": "75 deg"}, cone_slope(20, np.radians(75))),
    ],
)
def test_each_shape_has_the_contact_of_its_closed_form(body, slope):
    load = 300.0
    made = SOLVER.solve(tip(body=body | GRID).make(), load)
    edge = edge_at(slope, load)
    assert np.sqrt(made.area / np.pi) == pytest.approx(edge, rel=0.02)


def test_the_closed_form_is_that_of_hertz_and_of_sneddon():
    assert load_of(lambda r: r / 30, 5.0) == pytest.approx(4 * MODULUS * 5.0**3 / (3 * 30), rel=1e-9)
    angle = np.radians(80)
    assert load_of(lambda r: 1 / np.tan(angle), 5.0) == pytest.approx(
        np.pi / 2 * MODULUS * 25 / np.tan(angle), rel=1e-9
    )


def test_a_smooth_tip_on_a_flat_is_its_body():
    sphere = ca.surface(**BALL).make()
    flat = {"kind": "self-affine", **WAVES, "rms_slope": 0}
    for made in (
        tip(body=BALL),
        tip(body=BALL, counterface=flat),
        tip(body=BALL, counterface=flat, own_roughness=flat),
    ):
        surface = made.make(3)
        assert np.abs(surface.heights - sphere.heights).max() <= 1e-12
        made, ball = (SOLVER.solve(one, 50.0).pressure for one in (surface, sphere))
        np.testing.assert_allclose(made, ball, rtol=0, atol=1e-12)
    hertz = [FLAT.solve(one, 50.0).pressure for one in (tip(body=BALL).make(), sphere)]
    np.testing.assert_array_equal(hertz[0], hertz[1])


def test_a_blunt_cap_is_a_sphere_and_the_cone_is_smooth():
    cap, ball = (ca.surface(kind, radius=1e6, **GRID).make().heights for kind in ("spherical-cap", "sphere"))
    np.testing.assert_allclose(cap, ball, rtol=1e-9, atol=1e-15)
    cone = ca.surface("cone", radius=5, half_angle="60 deg", pixels=[2001, 1], pixel_size=0.01).make().heights[:, 0]
    slopes = np.diff(cone) / 0.01
    assert np.abs(np.diff(slopes)).max() < 1.2 * 0.01 / 5 / np.cos(np.radians(30)) ** 3
    assert slopes[0] == pytest.approx(1 / np.tan(np.radians(60)), rel=1e-9)


def test_the_counterface_below_the_tip_is_that_of_its_place():
    below = ca.surface(**ROUGH).make(7).heights
    options = {"body": BALL, "counterface": ROUGH, "counterface_seed": 7}
    fixed = tip(place=[14.5, "10 nm"], **options).make(2)
    smooth = ca.surface(**BALL).make().heights
    np.testing.assert_array_equal(fixed.heights, smooth + below[26:90, 8:72])
    assert fixed.provenance["tip"]["counterface"]["first_pixel"] == [26, 8]
    drawn = tip(**options).make(2)
    x, y = drawn.provenance["tip"]["counterface"]["first_pixel"]
    np.testing.assert_array_equal(drawn.heights, smooth + np.roll(below, (-x, -y), (0, 1))[:64, :64])


def test_the_seed_draws_place_and_roughness():
    both = tip(body=BALL, own_roughness=ROUGH, counterface=ROUGH)
    records = [both.make(seed).provenance["tip"] for seed in range(40)]
    places = np.array([record["counterface"]["first_pixel"] for record in records])
    assert len({tuple(place) for place in places}) == 40
    assert 0 <= places.min() < 30 < 98 < places.max() < 128
    assert len({str(record["own_roughness"]["surface"]["seed"]) for record in records}) == 40
    one = both.replace(roughness_seed=1)
    parts = [one.make(seed).provenance["tip"] for seed in (1, 2)]
    assert parts[0]["own_roughness"] == parts[1]["own_roughness"]
    assert parts[0]["counterface"]["first_pixel"] != parts[1]["counterface"]["first_pixel"]
    assert both.make(5).heights.tobytes() == both.make(5).heights.tobytes()
    assert one.replace(place=[16, 16]).scatter({}) == tip(body=BALL).scatter({}) == Scatter(0.0)
    assert both.scatter({}) == Scatter(None, "the seed draws the own roughness and the place")


def scene(**changes):
    return {
        "surface": {"kind": "tip", "body": BALL, "own_roughness": ROUGH, "counterface": ROUGH, "seed": 3},
        "contact": {"kind": "fft-bem", "modulus": MODULUS, "load": 50.0},
        "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
        "chemistry": {"activation_volume": "6.4 angstrom**3"},
        "engine": {"kind": "independent"},
        "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5},
    } | changes


def test_the_scatter_over_places_is_that_of_separate_runs():
    parsed = ca.parse_scene(scene(contact=FFT | {"load": 10.0}))
    mean = ca.ensemble(parsed, surfaces=5)
    runs = []
    for surface, hold in mean.levels[0]["seeds"]:
        seeded = parsed.with_hold(seed=hold, common="all").model_copy(update={"surface_seed": surface})
        runs.append(ca.run(seeded))
    betas, areas = [run.fit().beta for run in runs], [run.contact.quantity("area").value for run in runs]
    assert len(set(areas)) == 5
    beta = mean.estimate("beta")
    assert beta.value == pytest.approx(np.mean(betas), rel=1e-12)
    assert beta.half_width == pytest.approx(2.7764451 * np.std(betas, ddof=1) / np.sqrt(5), rel=1e-6)
    assert mean.estimate("area").value == pytest.approx(np.mean(areas), rel=1e-12)
    assert set(beta.errors) == {"surfaces", "replicas"}


def by_hand(record, body, below, load=50.0):
    """The heights of a place, and the contact of these heights."""
    x, y = record["counterface"]["first_pixel"]
    heights = body.heights + np.roll(below.heights, (-x, -y), (0, 1))[: body.shape[0], : body.shape[1]]
    surface = ca.Surface(heights=heights, pixel_size=body.pixel_size, periodic=False, provenance={})
    return SOLVER.solve(surface, load)


def test_the_average_of_a_scan_is_the_mean_over_places_computed_one_by_one():
    rough_body = tip(body=BALL, own_roughness=ROUGH, roughness_seed=4)
    one = {"kind": "tip", "body": BALL, "own_roughness": ROUGH, "roughness_seed": 4, "counterface": ROUGH, "seed": 3}
    mean = ca.ensemble(ca.parse_scene(scene(surface=one)), surfaces=6)
    body, below = rough_body.make(0), ca.surface(**ROUGH).make(0)
    maker = rough_body.replace(counterface=ROUGH)
    made = [maker.make(seed).provenance["tip"] for seed, _ in mean.levels[0]["seeds"]]
    areas = [by_hand(record, body, below).quantity("area").value for record in made]
    area = mean.estimate("area")
    assert area.value == pytest.approx(np.mean(areas), rel=1e-12)
    assert area.half_width == pytest.approx(2.5705818 * np.std(areas, ddof=1) / np.sqrt(6), rel=1e-6)


@pytest.mark.long
def test_random_places_sample_all_places_alike():
    body = BALL | {"radius": 10, "pixels": 24}
    small = ROUGH | {"pixels": 32, "zeta": 4}
    ball, below = ca.surface(**body).make(), ca.surface(**small).make(0)
    corners = [(x, y) for x in range(0, 32, 2) for y in range(0, 32, 2)]
    scan = np.array([by_hand({"counterface": {"first_pixel": at}}, ball, below, 10.0).area for at in corners])
    scanned = tip(body=body, counterface=small)
    drawn = np.array([SOLVER.solve(scanned.make(seed), 10.0).area for seed in range(300)])
    assert abs(drawn.mean() - scan.mean()) < 4 * scan.std() / np.sqrt(300)
    assert drawn.std() == pytest.approx(scan.std(), rel=0.2)


def test_a_load_from_deflection_and_spring_constant():
    for load in ("20 nm * 2.5 N/m", "0.02 um * 2.5 nN/nm", "50 nN"):
        parsed = ca.parse_scene(scene(contact={"kind": "fft-bem", "modulus": MODULUS, "load": load}))
        assert parsed.load == pytest.approx(50, rel=1e-15)
    for wrong in ("20 nm * 2.5 N", "20 N * 2 N/m", "-20 nm * 2.5 N/m", "20 nm * 2.5 N/m * 2"):
        with pytest.raises(SceneError, match=r"contact\.load"):
            ca.parse_scene(scene(contact={"kind": "fft-bem", "modulus": MODULUS, "load": wrong}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"place": [16, 16]}, "there is no counterface"),
        ({"apex": "down"}, "sphere has its apex up; leave apex out"),
        ({"roughness_seed": 1}, "there is no own_roughness"),
        ({"counterface": ROUGH | {"pixel_size": 0.5}}, "those of the body are 0.25 nm"),
        ({"own_roughness": ROUGH | {"pixels": 32}}, "32 x 32 pixels, but the body has 64 x 64"),
        ({"counterface": BALL | {"pixels": 128}, "place": [7, 16]}, r"leaves the counterface along x; give 8 to 24 nm"),
        ({"body": {"kind": "spherical-cap", "radius": 5, "pixels": 64, "pixel_size": 0.25}}, "beyond the sphere"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ca.InputError, match=message):
        tip(**{"body": BALL, **options}).make(1)


def whole(made, below):
    """The contact of the tip of a made surface with all of the counterface."""
    body = ca.surface(**made.provenance["options"]["body"])
    size = made.pixel_size
    x, y = (
        (np.arange(count) + 0.5) * size - at
        for count, at in zip(below.shape, made.provenance["tip"]["counterface"]["place"], strict=True)
    )
    heights = below.heights + body.around(x, y)
    return ca.Surface(heights=heights, pixel_size=size, periodic=False, provenance={})


def assert_the_patch_is_enough(maker, below, seed, load):
    made = maker.make(seed)
    patch, full = (SOLVER.solve(surface, load) for surface in (made, whole(made, below)))
    assert patch.displacement < made.provenance["tip"]["below"]
    assert patch.area == full.area
    assert patch.pressure.max() == pytest.approx(full.pressure.max(), rel=1e-3)
    assert patch.displacement == pytest.approx(full.displacement, rel=1e-4)
    x, y = made.provenance["tip"]["counterface"]["first_pixel"]
    nx, ny = made.shape
    there = full.pressure[x : x + nx, y : y + ny]
    assert there.sum() == pytest.approx(full.pressure.sum(), rel=1e-12)
    np.testing.assert_allclose(patch.pressure, there, rtol=0, atol=1e-3 * there.max())


SCAN = {"kind": "measured", "height_unit": "nm", "pixel_size": "2 nm"}
BLUNT = {"kind": "cone", "radius": 20, "half_angle": "75 deg", "pixels": 32, "pixel_size": 0.5}


@pytest.fixture
def image(tmp_path):
    """A scan of 128 nm; its hills are steeper than the side of the tip."""
    rough = ca.surface("self-affine", pixels=64, pixel_size=2.0, rms_slope=0.5, hurst=0.8, zeta=16, eta=2).make(1)
    np.save(tmp_path / "scan.npy", rough.heights)
    carried = {"kind": "roughened", "pixel_size": 0.5, "hurst": 0.8, "cutoff": "2 nm"}
    return carried | {"surface": SCAN | {"path": str(tmp_path / "scan.npy")}}


def test_the_patch_holds_what_touches_of_the_whole_scan(image):
    below = ca.surface(**image).make()
    maker = tip(body=BLUNT, counterface=image, counterface_seed=0, depth="1.5 nm")
    shapes = set()
    for seed in range(6):
        assert_the_patch_is_enough(maker, below, seed, 20.0)
        shapes.add(maker.make(seed).shape)
    assert (32, 32) in shapes
    assert len(shapes) > 2


def test_a_tip_that_touches_elsewhere_is_moved_there_and_one_that_touches_there_too_is_refused(image):
    maker = tip(body=BLUNT, counterface=image)
    moves, refused = [], 0
    for seed in range(8):
        made = maker.make(seed)
        record = made.provenance["tip"]
        middle = np.array(record["counterface"]["first_pixel"]) + 16
        moves.append(np.abs(middle - np.array(record["counterface"]["place"]) / 0.5).max())
        assert record["below"] >= 0
        try:
            assert SOLVER.solve(made, 20.0).displacement <= record["below"]
        except ca.InputError:
            refused += 1
            with pytest.raises(ca.InputError, match=r"beyond its grid .*give the tip depth = '\S+ nm'|edge of its"):
                SOLVER.solve(made, 20.0)
    assert min(moves) <= 1
    assert max(moves) > 16
    assert 0 < refused < 8


SMALL = {"pixels": 32, "pixel_size": 0.25}


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "cone", "radius": 2, "half_angle": "80 deg"},
        {"kind": "spherical-cap", "radius": 30},
        {"kind": "sphere", "radius": 30},
    ],
)
def test_a_contact_at_the_edge_of_the_grid_is_refused(body):
    for surface in (ca.surface(**body, **SMALL).make(), tip(body=body | SMALL).make()):
        assert not SOLVER.solve(surface, 10.0).notes
        with pytest.raises(ca.InputError, match=r"edge of (its|the) grid.*smaller load"):
            SOLVER.solve(surface, 300.0)
    with pytest.raises(ca.InputError, match=r"edge of (its|the) grid"):
        ca.run(scene(surface={"kind": "tip", "body": body | SMALL}, contact={"load": 300.0} | FFT))


def test_a_measured_tip_at_the_edge_is_refused_and_an_image_pressed_flat_has_a_note(tmp_path):
    np.save(tmp_path / "shape.npy", ca.surface("cone", radius=2, half_angle="80 deg", **SMALL).make().heights)
    image = {"kind": "measured", "path": str(tmp_path / "shape.npy"), "height_unit": "nm", "pixel_size": 0.25}
    with pytest.raises(ca.InputError, match=r"edge of its grid \(32 x 32 pixels of 0.25 nm\)"):
        SOLVER.solve(tip(body=image).make(), 300.0)
    pressed = SOLVER.solve(ca.surface(**image).make(), 200.0)
    (note,) = pressed.notes
    assert note.startswith("contact at the edge of the grid")
    edge = pressed.pressure.sum() - pressed.pressure[1:-1, 1:-1].sum()
    assert f": {100 * edge / pressed.pressure.sum():.2g} % of the load" in note
    assert not SOLVER.replace(boundary="periodic").solve(ca.surface(**image).make(), 300.0).notes


@pytest.mark.parametrize("apex", ["up", "down"])
def test_a_measured_tip_is_the_shape_of_its_file(tmp_path, apex):
    rng = np.random.default_rng(1)
    shape = ca.surface("cone", radius=5, half_angle="70 deg", **SMALL).make().heights + rng.normal(0, 0.02, (32, 32))
    np.savetxt(tmp_path / "tip.txt", (shape.T if apex == "up" else -shape.T) / 1e3)
    body = {"kind": "measured", "path": str(tmp_path / "tip.txt"), "height_unit": "um", "pixel_size": 0.25}
    made = tip(body=body, apex=apex, counterface=ROUGH, counterface_seed=7, place=[14.5, 10]).make(2)
    x, y = made.provenance["tip"]["counterface"]["first_pixel"]
    direct = shape + ca.surface(**ROUGH).make(7).heights[x : x + 32, y : y + 32]
    np.testing.assert_allclose(made.heights, direct, rtol=0, atol=1e-12)
    given = ca.Surface(heights=direct, pixel_size=0.25, periodic=False, provenance={})
    np.testing.assert_allclose(SOLVER.solve(made, 20.0).pressure, SOLVER.solve(given, 20.0).pressure, rtol=0, atol=1e-9)


def test_parts_of_a_large_surface_are_like_the_whole(image, monkeypatch):
    """Waves of the image are those of the whole; random ones have its spectrum, and parts around one pixel the same."""
    maker = ca.surface(**image)
    plan = maker.plan(maker.surface.make())
    kept = plan.image(plan.completed(3), *plan.places(plan.shape, 0.5))
    slope, height = (math.sqrt(plan.law.moment(power, plan.law.best)) for power in (3.0, 1.0))
    added = maker.make(3).heights - kept
    monkeypatch.setattr("chemage_surfaces.roughened.MOST_WHOLE", 0)
    parts = maker.whole_or_parts(3)
    assert (parts.shape, parts.provenance) == (plan.shape, maker.make(3).provenance)
    slopes, squares = [], []
    for x in range(0, 128, 32):
        first, shape = (x, 60), (128, 160)
        own = parts.heights(first, shape, (x + 64, 140), 1) - kept[x : x + 128, 60:220]
        slopes.append(roughness.rms_slope(own, 0.5, False) ** 2)
        squares.append(np.mean(own**2))
    assert np.sqrt(np.mean(slopes)) == pytest.approx(slope, rel=0.05)
    assert np.sqrt(np.mean(squares)) == pytest.approx(height, rel=0.1)
    assert added.std() == pytest.approx(height, rel=0.1)
    small, large = (parts.heights(*part, (80, 90), 1) for part in (((70, 80), (32, 32)), ((40, 60), (128, 96))))
    np.testing.assert_allclose(small, large[30:62, 20:52], rtol=0, atol=1e-12)
    # every third pixel, of which the middle is one, has the waves that it can show
    every = parts.heights((40, 60), (42, 32), (80, 90), 3)
    assert (every - large[1:126:3, 1:96:3]).std() == pytest.approx(parts.unseen(3), rel=0.2)
    assert parts.unseen(0) == pytest.approx(height)
    assert parts.unseen(1) < parts.unseen(3) < height


@pytest.mark.long
def test_a_tip_on_a_scan_of_20_um_takes_little_memory_and_its_patch_is_enough(tmp_path):
    rough = ca.surface("self-affine", pixels=256, pixel_size=78.125, rms_slope=0.03, hurst=0.8, zeta=64, eta=2).make(1)
    np.save(tmp_path / "scan.npy", rough.heights)
    scan = SCAN | {"path": str(tmp_path / "scan.npy"), "pixel_size": 78.125}
    carried = {"kind": "roughened", "pixel_size": 0.5, "hurst": 0.8, "cutoff": "2 nm", "surface": scan}
    maker = tip(body=BLUNT, counterface=carried, counterface_seed=0, depth="1 nm")
    made = maker.make(1)
    tracemalloc.start()
    assert made.heights.tobytes() == maker.make(1).heights.tobytes()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3e8
    record = made.provenance["tip"]["counterface"]
    with pytest.raises(ca.InputError, match="memory needed"):
        ca.surface(**carried | {"pixel_size": 0.1}).make()
    # the same place on a grid of 100 nm around it
    parts = maker.counterface.whole_or_parts(0)
    middle = [round(at / 0.5 - 16) + 16 for at in record["place"]]
    x, y = (at - 100 for at in middle)
    heights = parts.heights((x, y), (200, 200), tuple(middle), 1)
    at = (np.arange(200) - 100 + 0.5) * 0.5
    around = ca.Surface(heights=heights + maker.body.around(at, at), pixel_size=0.5, periodic=False, provenance={})
    patch, full = (SOLVER.solve(surface, 20.0) for surface in (made, around))
    assert patch.displacement < made.provenance["tip"]["below"]
    assert (patch.area, patch.displacement) == pytest.approx((full.area, full.displacement), rel=1e-4)


@pytest.mark.parametrize(("own", "between"), [({}, "places"), ({"own_roughness": ROUGH}, "surfaces")])
def test_the_scatter_is_named_by_what_the_seed_draws(own, between):
    surface = {"kind": "tip", "body": BALL, "counterface": ROUGH, "seed": 3, **own}
    mean = ca.ensemble(ca.parse_scene(scene(surface=surface, contact=FFT | {"load": 5.0})), surfaces=3)
    shown = result_of(mean)
    rows = dict(shown.rows())
    assert rows["mean over"].startswith(f"3 random {between}: 64 x 64 pixels")
    assert f"scatter of β between {between}, relative" in rows
    assert f"with the scatter between {between}" in shown.errors


def test_a_scan_that_may_touch_further_away_than_is_searched_is_refused(image, monkeypatch):
    monkeypatch.setattr("chemage_surfaces.roughened.MOST_WHOLE", 0)
    monkeypatch.setattr("chemage_surfaces.tips.LARGEST_PART", 64)
    maker = tip(body=BLUNT, counterface=image, depth="1 nm")
    messages = []
    for seed in range(6):
        try:
            assert maker.make(seed).provenance["tip"]["below"] >= 1.0
        except ca.InputError as error:
            messages.append(str(error))
    assert messages
    assert all("points may be as high as those that were found within 32 nm; give another" in text for text in messages)
