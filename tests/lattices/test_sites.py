"""Sites that are not pixels: the contact reconstructed below the pixel, or averaged, and what follows from it."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from scene_files import checked

import chemage as ca
from chemage import ContactSolution, InputError, parse_scene
from chemage.plugin import contact_sites

SPACING = 0.4518
DENSITY = 1 / SPACING**2
SOLVER = ca.contact("fft-bem", modulus=35.3, gap=True)


def rough(pixels, seed=1, side=256 * SPACING, solver=SOLVER):
    maker = ca.surface("self-affine", pixels=pixels, pixel_size=side / pixels, rms_slope=0.1, hurst=0.8, zeta=16, eta=2)
    return solver.solve(maker.make(seed), 0.03 * side**2)


@pytest.fixture(scope="module")
def contacts():
    return {pixels: rough(pixels) for pixels in (64, 128, 256, 512)}


def chemistry(**options):
    return ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.4), **options)


def grid(shape, pixel_size, density):
    """The grid of the sites on a contact of that many pixels, of which two are in contact."""
    pressure = np.zeros(shape)
    pressure[:2, 0] = 1.0
    flat = ContactSolution(pressure=pressure, load=2 * pixel_size**2, pixel_size=pixel_size, modulus=1.0)
    return contact_sites(flat, density)


def load(sites):
    return sites.pressure.sum(dtype=np.float64) * sites.spacing**2


# -- which grid -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pixel_size", "density", "shape"),
    [
        (0.4518, 4.9, (100, 64)),
        (0.45, 4.9, (100, 64)),
        (0.4518, "pixel", (100, 64)),
        (5.0, "pixel", (100, 64)),
        (0.9036, 4.9, (200, 128)),
        (0.2259, 4.9, (50, 32)),
        (5.0, 4.9, (1107, 708)),
        (0.01, 4.9, (2, 1)),
    ],
)
def test_sites_are_pixels_or_have_the_spacing_of_their_density(pixel_size, density, shape):
    assert grid((100, 64), pixel_size, density).shape == shape


@pytest.mark.parametrize("pixels", [2500, 16384])
def test_the_reference_pixels_are_sites_whatever_their_number(pixels):
    assert grid((pixels, 2), SPACING, 4.9).shape == (pixels, 2)


def test_where_pixels_are_sites_nothing_changes(contacts):
    contact = contacts[256]
    sites = contact_sites(contact, 4.9)
    assert sites.sites is contact.sites
    assert sites.pressure.tobytes() == contact.pressure.ravel()[contact.sites].tobytes()
    pairs = ca.interaction("elastic-pairs", strength="0.5 eV")
    own, pixel = (chemistry(interaction=pairs, **more).on(contact, 3) for more in ({}, {"site_density": "pixel"}))
    assert own == pixel
    assert own.pressure is None
    assert own.origin is None
    aged = [
        ca.age(contact, silica, engine=ca.engine("rejection-free"), hold_times=[1.0, 1e3], temperature=300, replicas=2)
        for silica in (chemistry(), chemistry(site_density="pixel"), chemistry(site_density=4.91))
    ]
    assert all(np.array_equal(aged[0].bonds, one.bonds) for one in aged)
    assert aged[0].site_grid == "one site per pixel"


# -- smaller than pixels ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pixels", [64, 128, 512])
@pytest.mark.parametrize("gap", [True, False])
def test_sites_carry_the_load(contacts, pixels, gap):
    for periodic, density in itertools.product((True, False), (DENSITY, 0.37 * DENSITY, 1.7 * DENSITY)):
        contact = contacts[pixels].model_copy(update={"periodic": periodic, **({} if gap else {"gap": None})})
        sites = contact_sites(contact, density)
        assert sites.rule != "pixels"
        assert load(sites) == pytest.approx(contact.pressure.sum(dtype=np.float64) * contact.pixel_size**2, rel=1e-12)
        assert np.all(np.diff(sites.sites) > 0)
        assert np.all(sites.pressure > 0)
        assert sites.sites[-1] < math.prod(sites.shape)


@pytest.mark.parametrize(
    ("pixels", "within", "bins", "same"), [(128, 0.02, 0.035, 0.97), (64, 0.06, 0.055, 0.95), (512, 0.03, 0.035, 0.97)]
)
def test_another_contact_grid_has_the_same_sites_in_contact(contacts, pixels, within, bins, same):
    # patches of 2 to 10 pixels on the coarsest grid. Limits: the mean over 12 surfaces (of the number of sites 0.6, 2.6
    # and -1.9 %) and three standard errors of a mean over four
    fine = [contacts[256], *(rough(256, seed) for seed in (2, 3, 4))]
    others = [contact_sites(one, DENSITY) for one in (contacts[pixels], *(rough(pixels, seed) for seed in (2, 3, 4)))]
    assert {sites.shape for sites in others} == {(256, 256)}
    expected = np.concatenate([one.pressure[one.contact] for one in fine])
    found = np.concatenate([sites.pressure for sites in others])
    assert found.size == pytest.approx(expected.size, rel=within)
    # bonds at a time are barriers below a threshold, which pressure lowers
    edges = [0, 0.5, 1, 2, 4, 99]
    assert np.abs(np.histogram(found, edges)[0] - np.histogram(expected, edges)[0]).max() < bins * expected.size
    common = sum(np.isin(sites.sites, one.sites).sum() for sites, one in zip(others, fine, strict=True))
    assert common > same * expected.size


@pytest.mark.parametrize("pixels", [258, 264, 320, 384, 512, pytest.param(288, marks=pytest.mark.long)])
def test_the_number_of_sites_does_not_swing_with_the_ratio(contacts, pixels):
    """Sites as large as 1 to 2 pixels: over four surfaces within 0.7 % (three standard errors) of a contact solved on
    the grid of sites, also beside the pixels that are sites; where half of the square decided it was −1.9 to +1.4 %."""
    fine = [contacts[256], *(rough(256, seed) for seed in (2, 3, 4))]
    others = [contact_sites(rough(pixels, seed), DENSITY) for seed in (1, 2, 3, 4)]
    assert {sites.shape for sites in others} == {(256, 256)}
    found = sum(sites.sites.size for sites in others)
    assert found == pytest.approx(sum(one.sites.size for one in fine), rel=0.007)


@pytest.mark.parametrize("periodic", [True, False])
def test_the_error_of_the_number_of_sites_follows_the_rim(contacts, periodic):
    """Edges between sites, counted on the whole grid; the error is larger without the gap and on coarser pixels."""
    errors = []
    for pixels, gap in ((128, True), (64, True), (64, False)):
        contact = contacts[pixels].model_copy(update={"periodic": periodic} | ({} if gap else {"gap": None}))
        sites = contact_sites(contact, DENSITY)
        whole = np.pad(np.isin(np.arange(256 * 256), sites.sites).reshape(256, 256), 0 if periodic else 1)
        edges = sum(np.count_nonzero(whole != np.roll(whole, 1, axis)) for axis in (0, 1))
        assert sites._edges() == edges
        errors.append(sites.relative_error(contact))
    assert 0.005 < errors[0] < errors[1] < errors[2] < 0.3
    assert contact_sites(contacts[256], DENSITY).relative_error(contacts[256]) == 0.0


def test_pixels_that_are_nearly_sites_say_how_many_there_are():
    """One site per pixel within half a percent of the spacing: within one percent of the sites."""

    def words(pixel_size, **options):
        surface = ca.Surface(heights=-np.hypot(*np.indices((9, 9)) - 4.0), pixel_size=pixel_size)
        call = {"engine": ca.engine("independent"), "hold_times": [1.0], "temperature": 300.0, "replicas": 1}
        return ca.age(SOLVER.solve(surface, 20.0), chemistry(**options), **call).site_grid

    assert words(0.45) == "one site per pixel, 0.78 % more than site_density"
    assert words(0.4535) == "one site per pixel, 0.77 % fewer than site_density"
    assert words(SPACING) == words(0.45, site_density="pixel") == "one site per pixel"


def test_repeating_pixels_would_be_worse(contacts):
    coarse, fine = contacts[64], contacts[256]
    assert 16 * coarse.sites.size > 1.06 * fine.sites.size


def test_a_shifted_contact_has_shifted_sites(contacts):
    contact, shift, factor = contacts[64], (13, -29), 4
    moved = contact.model_copy(
        update={name: np.roll(getattr(contact, name), shift, (0, 1)) for name in ("pressure", "gap")}
    )
    here, there = (contact_sites(one, DENSITY) for one in (contact, moved))
    maps = []
    for sites in (here, there):
        full = np.zeros(sites.shape)
        full.ravel()[sites.sites] = sites.pressure
        maps.append(full)
    rolled = np.roll(maps[0], (factor * shift[0], factor * shift[1]), (0, 1))
    np.testing.assert_allclose(maps[1], rolled, rtol=1e-9, atol=1e-9)


def hertz(pixel_size, radius=6.0, density=100.0):
    """Contact of a sphere with the given contact radius (nm), and its sites."""
    modulus, tip = 35.3, 30.0
    surface = ca.surface("sphere", radius=tip, pixels=round(16 / pixel_size) + 4, pixel_size=pixel_size).make()
    force = radius**3 * modulus / (0.75 * tip)
    solution = ca.contact("hertz", modulus=modulus, gap=True).solve(surface, force)
    sites = contact_sites(solution, density)
    x, y = np.divmod(sites.sites, sites.shape[1])
    r = sites.spacing * np.hypot(x + 0.5 - sites.shape[0] / 2, y + 0.5 - sites.shape[1] / 2)
    highest = 1.5 * force / (math.pi * radius**2)
    return sites, r / radius, sites.pressure / highest


@pytest.mark.parametrize(
    ("pixel_size", "area", "error"), [(3.2, 0.04, 0.12), (2.0, 0.03, 0.08), (1.0, 0.01, 0.04), (0.5, 0.01, 0.02)]
)
def test_a_coarse_sphere_is_that_of_hertz(pixel_size, area, error):
    sites, r, pressure = hertz(pixel_size)
    assert sites.sites.size * sites.spacing**2 == pytest.approx(math.pi * 36, rel=area)
    exact = np.sqrt(np.maximum(1 - r**2, 0))
    assert np.linalg.norm(pressure - exact) < error * np.linalg.norm(exact)
    assert r.max() < 1 + 0.3 * pixel_size / 6


def test_a_coarse_wave_has_the_width_of_westergaard():
    # p̄/p* = 0.2 of a sinusoid covers 0.2952 of it; a grid of one pixel per site covers 0.15 sites more at either edge
    side, modulus, amplitude = 64.0, 35.3, 0.5
    full = math.pi * modulus * amplitude / side
    for pixels in (64, 32):
        x = np.arange(pixels) * (side / pixels)
        heights = np.repeat(amplitude * np.cos(2 * np.pi * (x + 0.3) / side)[:, None], 8, axis=1)
        surface = ca.Surface(heights=heights, pixel_size=side / pixels)
        contact = SOLVER.solve(surface, 0.2 * full * surface.nominal_area)
        sites = contact_sites(contact, 16.0 * (pixels / side) ** 2)
        share = sites.sites.size / math.prod(sites.shape)
        assert share == pytest.approx(0.2952 + 2 * 0.15 * sites.spacing / side, abs=1.1 * sites.spacing / side)
        x = np.divmod(sites.sites, sites.shape[1])[0] * sites.spacing + 0.3
        inside = 0.2 - np.sin(np.pi * x / side) ** 2
        exact = 2 * 0.2 * full * np.cos(np.pi * x / side) / 0.2 * np.sqrt(np.maximum(inside, 0))
        assert np.linalg.norm(np.abs(exact) - sites.pressure) < 0.06 * np.linalg.norm(exact)


# -- larger than pixels, and odd contacts -----------------------------------------------------------------------------


@pytest.mark.parametrize(("pixels", "rule"), [(2, "reconstructed"), (5, "averaged")])
def test_larger_sites_have_the_mean_pressure_of_their_pixels(pixels, rule):
    pressure = np.zeros((4 * pixels, 4 * pixels))
    block = pressure[pixels : 2 * pixels, pixels : 2 * pixels]
    block[:] = 1.0 + np.arange(pixels**2).reshape(pixels, pixels)
    size = 1 / pixels
    contact = ContactSolution(
        pressure=pressure, load=block.sum() * size**2, pixel_size=size, modulus=35.3, periodic=False
    )
    sites = contact_sites(contact, 1.0)
    assert (sites.shape, sites.rule, sites.sites.tolist()) == ((4, 4), rule, [5])
    assert sites.pressure.tolist() == [pytest.approx(block.mean(), rel=1e-12)]


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 2), (3, 5)])
@pytest.mark.parametrize("density", [0.3, 3.1, 40.0])
def test_small_grids_in_contact_everywhere_or_at_one_pixel(periodic, shape, density):
    for pressure in (np.full(shape, 2.0), np.eye(*shape)[::-1], np.where(np.arange(math.prod(shape)) == 0, 1.0, 0.0)):
        contact = ContactSolution(
            pressure=pressure.reshape(shape),
            gap=np.where(pressure > 0, 0.0, 0.1).reshape(shape),
            load=float(pressure.sum()),
            pixel_size=1.0,
            modulus=35.3,
            periodic=periodic,
        )
        sites = contact_sites(contact, density)
        area = math.prod(shape) / math.prod(sites.shape)
        assert sites.pressure.sum() * area == pytest.approx(pressure.sum(), rel=1e-12)
        if np.all(pressure == 2.0):
            assert sites.sites.size == math.prod(sites.shape)
            np.testing.assert_allclose(sites.pressure, 2.0, rtol=1e-12)


def test_no_contact_has_no_sites():
    contact = ContactSolution(pressure=np.zeros((4, 4)), load=0.0, pixel_size=5.0, modulus=35.3)
    for density in (4.9, 0.01):
        assert chemistry(site_density=density).on(contact).sites.size == 0


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e60])
def test_extreme_pressures_place_the_same_sites(contacts, scale):
    contact = contacts[64]
    factor = np.float64(scale)
    other = contact.model_copy(
        update={"pressure": contact.pressure * factor, "load": contact.load * max(scale, 1e-90), "gap": None}
    )
    plain = contact_sites(contact.model_copy(update={"gap": None}), DENSITY)
    np.testing.assert_array_equal(contact_sites(other, DENSITY).sites, plain.sites)


# -- what follows -----------------------------------------------------------------------------------------------------


def test_a_site_keeps_its_barrier_on_every_contact_grid(contacts):
    fine, coarse = (chemistry().on(contacts[pixels], 5) for pixels in (256, 64))
    assert fine.pixels == coarse.pixels
    both, first, second = np.intersect1d(fine.sites, coarse.sites, return_indices=True)
    assert both.size > 0.95 * fine.sites.size
    assert np.array_equal(fine.forming[first], coarse.forming[second])


def test_lattices_know_their_pressures(contacts):
    coarse, fine = contacts[64], contacts[256]
    lattice = chemistry(activation_volume="6.4 angstrom**3").on(coarse)
    assert lattice.pressures(coarse) is lattice.pressure
    plain = chemistry().on(coarse)
    lowered = 0.0064 * ca.plugin.EV_PER_GPA_NM3 * plain.pressures(coarse)
    np.testing.assert_allclose(plain.forming - lattice.forming, lowered, rtol=0, atol=1e-12)
    without = lattice.model_copy(update={"pressure": None})
    assert np.array_equal(without.pressures(fine), fine.pressure.ravel()[without.sites])
    with pytest.raises(InputError, match=r"256 x 256 sites and has no pressure.*64 x 64 pixels"):
        without.pressures(coarse)


def test_atoms_of_sites_lie_on_the_pixels_they_are_in(contacts):
    contact = contacts[64]
    atoms = chemistry().on(contact).to_atoms()
    pixels = np.floor(atoms.positions[:, :2] / 10 / contact.pixel_size).astype(int) % 64
    near = [np.roll(contact.contact, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    assert np.any(near, axis=0)[pixels[:, 0], pixels[:, 1]].all()
    assert contact.contact[pixels[:, 0], pixels[:, 1]].mean() > 0.8


@pytest.mark.parametrize(
    ("density", "problem"),
    [
        (0, "site_density: .*greater than 0"),
        (-4.9, "site_density: .*greater than 0"),
        (math.nan, "site_density: .*finite"),
        ("pixels", "site_density: .*cannot be read as a quantity"),
        ("4.9 nm", "site_density: .*1/nm"),
        (True, "site_density: "),
        ([4.9], "site_density: "),
    ],
)
def test_a_density_that_is_none_is_one_error(density, problem):
    with pytest.raises(InputError, match=problem) as caught:
        chemistry(site_density=density)
    assert str(caught.value).count("site_density") == 1


@pytest.mark.parametrize(("density", "problem"), [(1e40, "sites on this contact"), (1e-40, "less than one site")])
def test_a_density_that_does_not_fit_the_contact_is_one_error(contacts, density, problem):
    with pytest.raises(InputError, match=problem):
        chemistry(site_density=density).on(contacts[64])


def test_more_sites_than_memory_holds_are_refused_before_memory_is_asked_for(contacts):
    with pytest.raises(InputError, match=r"sites in contact.*site_density"):
        chemistry(site_density=1e10).on(contacts[64])


def test_the_option_goes_round():
    for density in ("pixel", 2.5, "4.9 /nm**2", "4.9e14 /cm**2"):
        made = chemistry(site_density=density)
        assert ca.Chemistry.fromdict(json.loads(json.dumps(made.todict()))) == made
    assert chemistry(site_density="4.9e14 /cm**2").site_density == pytest.approx(4.9)
    assert chemistry().digest() != chemistry(site_density="pixel").digest() != chemistry(site_density=5.5).digest()


# -- scenes -----------------------------------------------------------------------------------------------------------


def scene(pixels=32, size="0.9036 nm", **chemical):
    return {
        "name": "coarse",
        "surface": {"kind": "self-affine", "pixels": pixels, "pixel_size": size, "rms_slope": 0.1, "hurst": 0.8,
                    "zeta": 6, "seed": 2},
        "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 60.0},
        "forming": {"kind": "uniform", "lower": 0.7, "upper": 1.2},
        "chemistry": chemical,
        "engine": {"kind": "rejection-free"},
        "hold": {"start": "1 s", "stop": "1e4 s", "per_decade": 1, "replicas": 2},
        "observe": [{"kind": "pressure-spectrum"}],
    }  # fmt: skip


def test_a_scene_asks_for_the_gap_and_says_what_was_reconstructed(command, tmp_path):
    made = parse_scene(scene())
    words = "64 x 64 sites on 32 x 32 pixels, 4 sites per pixel: pressure and rim reconstructed below the pixel"
    assert made.contact.todict()["gap"] is False
    assert made.solver.todict()["gap"] is True
    assert checked(command, tmp_path, scene())["stages"]["sites"] == words
    result = ca.run(made)
    assert result.contact.gap is not None
    words += f"; their number within {100 * result.ageing.provenance['sites']['relative_error']:.2g} %"
    assert result.summary()["site_grid"] == words
    ca.write(tmp_path / "run.h5", result)
    again = ca.read(tmp_path / "run.h5")
    assert again.ageing.site_grid == words
    assert again.ageing.provenance["sites"]["sites"] == [64, 64]
    spectrum = result.ageing.observables
    assert (spectrum["pressures"].sum(axis=1) * np.diff(spectrum["pressure_edges"][0])[0]).min() > 0.99


def test_keys_contain_the_sites_where_they_are_not_pixels():
    old, default, other = (
        parse_scene(scene(**chemical)).keys()
        for chemical in ({"site_density": "pixel"}, {}, {"site_density": "9 /nm**2"})
    )
    assert old["surface"] == default["surface"] == other["surface"]
    assert old["contact"] != default["contact"] == other["contact"]  # the gap
    assert len({keys["ageing"] for keys in (old, default, other)}) == 3
    small = [parse_scene(scene(size="0.4518 nm", **more)).keys() for more in ({}, {"site_density": "pixel"})]
    assert small[0] == small[1]


def test_a_scene_whose_sites_do_not_fit_is_refused_before_it_runs(command, tmp_path):
    for density in (1e40, 1e-40, 1e12):
        with pytest.raises(ValueError, match="site_density"):
            checked(command, tmp_path, scene(site_density=density))
    tip = scene(site_density=1e10)
    # a solver that does not estimate the area of contact beforehand
    tip["surface"] = {"kind": "sphere", "radius": 30, "pixels": 32, "pixel_size": 1.0}
    with pytest.raises(ValueError, match=r"sites per pixel: .*site_density"):
        checked(command, tmp_path, tip)


def test_pressure_and_gap_at_the_rim_of_hertz_have_one_factor():
    """p = B √d inside and gap = 4B/(3E*) d^(3/2) outside, which the reconstruction takes for every rim."""
    from chemage_contact import Hertz

    hertz, radius, edge = Hertz(modulus=35.3), 30.0, 6.0
    peak = 2 * 35.3 * edge / (math.pi * radius)
    for distance in (1e-2, 1e-3):
        line = ca.Surface(heights=np.zeros((1, 2)), pixel_size=2 * (edge + distance), periodic=False)
        factor = peak * math.sqrt(1 - (1 - distance / edge) ** 2) / math.sqrt(distance)
        gap = 4 * factor / (3 * 35.3) * distance**1.5
        assert hertz._open_gap(line, edge, radius) == pytest.approx(gap, rel=2 * distance / edge)


def test_a_stored_contact_without_gap_is_aged_and_says_so(contacts, tmp_path):
    ca.write(tmp_path / "contact.h5", contacts[64].model_copy(update={"gap": None}))
    again = ca.read(tmp_path / "contact.h5")
    assert again.gap is None
    aged = ca.age(again, chemistry(), engine=ca.engine("rejection-free"), hold_times=[1.0], temperature=300, replicas=1)
    assert "the rim halfway between pixels because the contact has no gap" in aged.site_grid


def test_shear_stress_is_per_area_of_the_sites():
    """On pixels as large as three by three sites, which cover more than the contact, and on pixels that are sites."""
    tip = {"radius": "40 nm", "pixel_size": 0.4518 * 3, "pixels": 40}
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.3, upper=0.31))
    found = []
    for changes in ({}, {"pixel_size": 0.4518, "pixels": 120}):
        surface = ca.surface("sphere", **{**tip, **changes}).make()
        contact = ca.contact("fft-bem", modulus=35.3, gap=True).solve(surface, "300 nN")
        call = {"engine": ca.engine("independent"), "hold_times": [1e5], "temperature": 300.0, "replicas": 1}
        found.append((contact, ca.age(contact, chemistry, **call)))
    (coarse, aged), (fine, expected) = found
    assert (aged.bonds == aged.sites).all()
    assert coarse.area > 1.05 * fine.area == 1.05 * expected.site_area
    # every site is bonded: 3 nN on 1/(4.9 nm²)
    assert expected.mean_shear_stress == pytest.approx(3.0 / 0.4518**2)
    assert aged.mean_shear_stress == pytest.approx(expected.mean_shear_stress, rel=0.005)
    assert aged.site_area == pytest.approx(expected.site_area, rel=0.05)
