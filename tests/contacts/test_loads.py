"""A load may be a nominal pressure; a contact modulus may be the elastic constants of two bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest
import tomli_w
from scene_files import checked

import chemage as ca
from chemage.testing import rough_surface

SOLVER = ca.contact("fft-bem", modulus="35.3 GPa", threads=1)


def scene(**changes):
    """A small rough contact without chemistry."""
    data = {
        "surface": {
            "kind": "self-affine",
            "pixels": 32,
            "pixel_size": "0.5 nm",
            "rms_slope": 0.1,
            "hurst": 0.8,
            "zeta": 4,
            "eta": 1,
        },
        "contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "10 MPa"},
    }
    return ca.plugin.override(data, changes)


# -- load as a nominal pressure ---------------------------------------------------------------------------------------


def test_a_pressure_is_multiplied_by_the_nominal_area():
    surface = rough_surface()
    found = SOLVER.solve(surface, "10 MPa")
    assert found.load == 0.01 * surface.nominal_area
    assert found.nominal_pressure == pytest.approx(0.01, rel=1e-15)
    same = SOLVER.solve(surface, found.load)
    assert np.array_equal(found.pressure, same.pressure)
    assert ca.solve_contact(SOLVER, surface, "10 MPa") == found
    assert [one.load for one in SOLVER.sweep(surface, ["20 MPa", "10 MPa"])] == [2 * found.load, found.load]


@pytest.mark.parametrize("text", ["10 MPa", "0.01 GPa", "1e7 Pa", "100 bar", "10 N/mm**2", "10 newton/millimeter**2"])
def test_every_unit_of_pressure_is_read(text):
    surface = rough_surface()
    assert SOLVER.normal_force(text, surface) == pytest.approx(0.01 * surface.nominal_area, rel=1e-15)


@pytest.mark.parametrize(("load", "force"), [("20 uN", 2e4), (20.0, 20.0), ("2 kgf", 19.6133e9)])
def test_a_force_is_taken_as_it_is(load, force):
    assert SOLVER.normal_force(load, rough_surface()) == pytest.approx(force, rel=1e-15)


def test_a_scene_stores_the_force_so_that_equal_loads_have_equal_keys():
    given = ca.parse_scene(scene())
    force = 0.01 * 32 * 32 * 0.5**2
    assert given.load == force
    assert given.todict()["contact"]["load"] == force
    assert given.keys() == ca.parse_scene(scene(**{"contact.load": f"{force!r} nN"})).keys()
    surface = ca.make_surface(given.surface, given.surface_seed)
    assert SOLVER.normal_force("10 MPa", surface) == force  # to the last bit: one way to find the area
    assert ca.run(given).contact.load == force


@pytest.mark.parametrize(
    ("load", "text"), [("10 MPa", "2.56 nN, nominal pressure 10 MPa"), (64, "64 nN, nominal pressure 0.25 GPa")]
)
def test_check_shows_force_and_pressure(command, tmp_path, load, text):
    stages = checked(command, tmp_path, scene(**{"contact.load": load}))["stages"]
    assert stages["contact"] == f"fft-bem at {text}, E* 35.3 GPa"


def test_a_theory_takes_a_pressure_of_any_surface(command, tmp_path):
    theory = ca.contact("persson", modulus="35.3 GPa")
    flat = ca.surface("self-affine", pixels=32, pixel_size="0.5 nm", rms_slope=0.1, hurst=0.8, zeta=4, eta=1)
    assert theory.statistics(flat, "10 MPa").nominal_pressure == pytest.approx(0.01, rel=1e-15)
    image = rough_surface(periodic=False)
    assert theory.statistics(image, "10 MPa").load == 0.01 * image.nominal_area
    text = checked(command, tmp_path, scene(**{"contact.kind": "persson"}))["stages"]["contact"]
    assert "persson at 2.56 nN, nominal pressure 10 MPa" in text


def test_a_tip_has_no_nominal_area():
    tip = ca.surface("sphere", radius="30 nm", pixels=64, pixel_size="0.4518 nm")
    hertz = ca.contact("hertz", modulus="35.3 GPa")
    for load in (lambda: hertz.solve(tip.make(), "10 MPa"), lambda: SOLVER.solve(tip.make(), "10 MPa")):
        with pytest.raises(ca.InputError, match=r"load = '10 MPa'.*no meaning; give the normal force"):
            load()
    with pytest.raises(ca.plugin.SceneError, match=r"contact\.load: '10 MPa': .*nominal area"):
        ca.load_scene("silica-tip", {"contact.load": "10 MPa"})


def test_the_boundary_decides_about_an_image():
    image = rough_surface(periodic=False)
    with pytest.raises(ca.InputError, match="no meaning"):
        SOLVER.solve(image, "10 MPa")
    assert SOLVER.replace(boundary="periodic").normal_force("10 MPa", image) == 0.01 * image.nominal_area
    with pytest.raises(ca.InputError, match="no meaning"):
        SOLVER.replace(boundary="free").normal_force("10 MPa", rough_surface())


def test_the_area_must_be_known_before_the_surface_is_made():
    with pytest.raises(ca.InputError, match="not known before it is made"):
        SOLVER.normal_force("10 MPa", {"periodic": 1.0})


@pytest.mark.parametrize(
    ("load", "message"),
    [
        ("-1 MPa", "must be finite and not negative"),
        ("-1 nN", "must be finite and not negative"),
        ("1 m", "a load is a force, such as .* or a nominal pressure"),
        ("1 xyz", "a load is a force"),
        ([1], "a load is a force"),
        ("1e300 GPa", "out of range"),
    ],
)
def test_wrong_loads_are_refused(load, message):
    with pytest.raises(ca.InputError, match=message):
        SOLVER.solve(rough_surface(), load)
    with pytest.raises(ca.plugin.SceneError, match=message):
        ca.parse_scene(scene(**{"contact.load": load}))


def test_no_pressure_is_no_load():
    assert SOLVER.solve(rough_surface(), "0 MPa").area == 0


def test_a_sweep_of_pressures_keeps_the_pressure_where_the_size_changes(tmp_path):
    data = scene() | {"sweep": {"contact.load": ["10 MPa", "0.02 GPa"], "surface.pixels": [16, 32]}}
    swept = ca.sweep(data, tmp_path / "out")
    table = swept.table().to_xarray()
    assert table["nominal_pressure"].attrs["units"] == "GPa"
    assert table["nominal_pressure"].values.tolist() == [0.01, 0.02]
    assert [point.summary["load"] for point in swept] == [0.64, 2.56, 1.28, 5.12]


def test_a_sweep_does_not_mix_forces_and_pressures(tmp_path):
    data = scene() | {"sweep": {"contact.load": ["10 MPa", "2 nN"]}}
    with pytest.raises(ca.plugin.SceneError, match="all loads as forces, or all as nominal pressures"):
        ca.sweep(data, tmp_path / "out")


def test_set_takes_a_pressure(command, tmp_path):
    path = tmp_path / "swept.toml"
    data = scene(**{"contact.load": "1 nN"}) | {"sweep": {"surface.rms_slope": [0.1, 0.2]}}
    path.write_text(tomli_w.dumps(data))
    assert "contacts to solve" in command("check", path, "--set", 'contact.load="10 MPa"').out


# -- the contact modulus of two bodies --------------------------------------------------------------------------------


def test_two_equal_bodies_are_half_as_stiff_as_one_against_a_rigid_one():
    one = ca.contact_modulus("72 GPa", 0.17)
    assert one == pytest.approx(72 / (1 - 0.17**2), rel=1e-15)
    assert ca.contact_modulus(72, 0.17, "72 GPa", 0.17) == pytest.approx(one / 2, rel=1e-15)


def test_the_compliances_of_two_bodies_add():
    """Steel (210 GPa, 0.3) on glass (70 GPa, 0.22): 1/E* = 0.91/210 + 0.9516/70 per GPa."""
    assert ca.contact_modulus(210, 0.3, "70 GPa", 0.22) == pytest.approx(1 / (0.91 / 210 + 0.9516 / 70), rel=1e-15)


def test_the_constants_of_the_paper_give_its_modulus():
    assert ca.contact_modulus("69 GPa", 0.19, "69 GPa", 0.19) == pytest.approx(35.79, abs=0.005)


@pytest.mark.parametrize("kind", ["fft-bem", "hertz", "persson"])
def test_every_solver_takes_elastic_constants(kind):
    solver = ca.contact(kind, modulus={"young": ["72 GPa", 210], "poisson": [0.17, 0.3]})
    assert solver == ca.contact(kind, modulus=ca.contact_modulus(72, 0.17, 210, 0.3))
    rigid = ca.contact(kind, modulus={"young": "72 GPa", "poisson": 0.17})
    assert rigid.modulus == pytest.approx(72 / (1 - 0.17**2))


def test_an_isotropic_body_is_a_transversely_isotropic_one():
    """Lamé's constants of E = 72 GPa and ν = 0.17, rigid and elastic counter-body."""
    lame, shear = 72 * 0.17 / 1.17 / 0.66, 72 / 2.34
    body = {"c11": lame + 2 * shear, "c13": lame, "c33": f"{lame + 2 * shear!r} GPa", "c44": shear}
    assert ca.contact("hertz", modulus=body).modulus == pytest.approx(ca.contact_modulus(72, 0.17))
    both = ca.contact("hertz", modulus={**body, "young": "210 GPa", "poisson": 0.3})
    assert both.modulus == pytest.approx(ca.contact_modulus(72, 0.17, 210, 0.3))


def test_a_scene_shows_and_keeps_the_contact_modulus(command, tmp_path):
    given = ca.parse_scene(scene(**{"contact.modulus": {"young": ["72 GPa"] * 2, "poisson": [0.17, 0.17]}}))
    plain = ca.parse_scene(scene(**{"contact.modulus": given.contact.modulus}))
    assert given.keys() == plain.keys()
    assert given.todict()["contact"]["modulus"] == plain.contact.modulus
    assert f"E* {given.contact.modulus:.6g} GPa" in checked(command, tmp_path, given.todict())["stages"]["contact"]


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"young": "72 GPa"}, "poisson is missing"),
        ({"young": "72 GPa", "poison": 0.2}, r"no such elastic constant \(did you mean 'poisson'"),
        ({"young": ["72 GPa", 70], "poisson": 0.2}, "young has 2 entries and poisson 1"),
        ({"young": [1, 2, 3], "poisson": [0.1, 0.2, 0.3]}, "young has 3 entries"),
        ({"young": [], "poisson": []}, "young has 0 entries"),
        ({"young": "0 GPa", "poisson": 0.2}, "must be finite and positive"),
        ({"young": "72 nm", "poisson": 0.2}, "is a quantity of nanometer"),
        ({"young": math.inf, "poisson": 0.2}, "must be finite and positive"),
        ({"young": 72, "poisson": 0.6}, "above -1 and at most 0.5"),
        ({"young": 72, "poisson": -1}, "above -1 and at most 0.5"),
        ({"young": 72, "poisson": math.nan}, "above -1 and at most 0.5"),
        ({"young": True, "poisson": 0.2}, "is not a quantity"),
        ({"c11": 3, "c13": 1, "c33": 2}, "c44 is missing; give c11, c13, c33 and c44"),
        ({"c11": 3, "c12": 1, "c13": 1, "c33": 2, "c44": 1}, "c12 and c66 do not enter"),
        ({"c11": 3, "c13": 2.5, "c33": 2, "c44": 1}, r"c13 = 2.5: must be smaller than √\(c11 c33\) = 2.44949"),
        ({"c11": 3, "c13": 1, "c33": 2, "c44": "-1 GPa"}, "must be finite and positive"),
        ({"c11": 3, "c13": 1, "c33": 2, "c44": 1, "young": 3}, "poisson is missing"),
    ],
)
def test_wrong_elastic_constants_are_refused(constants, message):
    with pytest.raises(ca.InputError, match=message):
        ca.contact("hertz", modulus=constants)
    with pytest.raises(ca.plugin.SceneError, match=message):
        ca.parse_scene(scene(**{"contact.modulus": constants}))


def test_a_solver_of_a_third_party_gets_it_with_the_type_of_its_option(command, tmp_path):
    class Springs(ca.plugin.ContactSolver):
        """A bed of springs."""

        kind = "springs-of-a-test"
        stiffness: ca.plugin.ContactModulus = 10.0
        """contact modulus, GPa"""

        def _solve(self, surface, load, start):
            raise NotImplementedError

    made = Springs(stiffness={"young": 10, "poisson": 0.5})
    assert made.stiffness == pytest.approx(10 / 0.75)
    assert Springs.fromdict(made.todict()) == made
    with ca.plugin.registry.using(ca.plugin.registry.Registry()):
        ca.register(Springs)
        on_springs = scene() | {"contact": {"kind": Springs.kind, "load": 20, "stiffness": 13.0}}
        assert "E* 13 GPa" in checked(command, tmp_path, on_springs)["stages"]["contact"]


def test_a_counter_body_has_both_constants():
    with pytest.raises(ca.InputError, match="give both, or neither"):
        ca.contact_modulus(72, 0.17, 72)
