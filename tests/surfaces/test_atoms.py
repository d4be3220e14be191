"""The surface of atoms: heights against closed forms, periodic images, sites, and what it refuses."""

from __future__ import annotations

import ase.io
import numpy as np
import pytest
from ase import Atoms
from ase.build import fcc100
from ase.data import covalent_radii, vdw_radii
from ase.spacegroup import crystal

import chemage as ca
from chemage import InputError
from chemage.plugin import SITE_POSITIONS, StoreError


def made(atoms: Atoms, **options) -> ca.Surface:
    return ca.surface("atoms", **{"atoms": atoms, "resolution": 0.05, **options}).make()


def grid(surface: ca.Surface) -> tuple[np.ndarray, np.ndarray]:
    x, y = surface.coordinates().values()
    return x[:, None], y


def caps(surface: ca.Surface, places, radii) -> np.ndarray:
    """The envelope of spheres at ``places`` (nm), as long as every pixel is above one of them."""
    x, y = grid(surface)
    heights = np.full(surface.shape, -np.inf)
    for (a, b, c), radius in zip(places, radii, strict=True):
        square = radius**2 - (x - a) ** 2 - (y - b) ** 2
        heights = np.maximum(heights, np.where(square >= 0, c + np.sqrt(np.maximum(square, 0)), -np.inf))
    return heights - heights.max()


def silica() -> tuple[Atoms, int]:
    """A slab of cristobalite with a hydroxyl for each O of its upper and of its lower face, and how many are above."""
    slab = crystal(("Si", "O"), [(0, 0, 0), (0.125, 0.125, 0.125)], spacegroup=227, cellpar=[7.16] * 3 + [90] * 3)
    slab = slab.repeat((2, 3, 1))
    z = slab.positions[:, 2]
    oxygen = slab.numbers == 8
    upper = np.flatnonzero(oxygen & (z > z[oxygen].max() - 0.1))
    slab = slab[z <= z[oxygen].max() + 0.1]
    z = slab.positions[:, 2]
    oxygen = slab.numbers == 8
    upper, lower = (np.flatnonzero(oxygen & (abs(z - edge) < 0.1)) for edge in (z[oxygen].max(), z[oxygen].min()))
    for faces, up in ((upper, 0.97), (lower, -0.97)):
        slab += Atoms(f"H{len(faces)}", positions=slab.positions[faces] + [0, 0, up])
    slab.center(vacuum=5, axis=2)
    slab.pbc = (True, True, False)
    return slab, len(upper)


@pytest.mark.parametrize("radii", ["vdw", "covalent"])
def test_one_atom_is_a_sphere_of_its_radius_and_that_of_the_probe(radii):
    surface = made(Atoms("O", [(1.5, 1.5, 5)], cell=(3, 3, 30)), probe_radius="0.3 nm", radii=radii)
    table = {"vdw": vdw_radii, "covalent": covalent_radii}[radii]
    assert surface.shape == (6, 6)
    assert not surface.periodic
    np.testing.assert_allclose(surface.heights, caps(surface, [(0.15, 0.15, 0)], [0.1 * table[8] + 0.3]), atol=1e-14)


def test_two_atoms_are_the_upper_of_both_spheres_and_meet_where_both_are_as_high():
    pair = Atoms("OSi", [(1, 1.5, 5), (4, 1.5, 5.5)], cell=(5, 3, 30))
    surface = made(pair, probe_radius=0.2, resolution=0.01)
    radii = 0.1 * vdw_radii[[8, 14]] + 0.2
    np.testing.assert_allclose(surface.heights, caps(surface, 0.1 * pair.positions, radii), atol=1e-13)
    # on the line through both: x where R1² − (x − x1)² is the height of the other sphere
    line = surface.heights[:, 15]
    assert surface.heights.argmin() % 30 in (0, 29)
    x = surface.coordinates()["x"]
    assert 0.1 < x[10 + line[10:40].argmin()] < 0.4


@pytest.mark.parametrize("probe", [0.0, 0.14, 1.0])
def test_the_corrugation_of_a_100_face_is_the_closed_form(probe):
    """In the hollow between four atoms the probe rests on all of them, or on the atom below."""
    slab = fcc100("Cu", (2, 2, 3), vacuum=5, periodic=True)
    spacing, count = 0.1 * slab.cell[0, 0] / 2, 32
    slab.translate((5 * spacing / count, 5 * spacing / count, 0))  # atoms and hollows on centres of pixels
    surface = made(slab, probe_radius=probe, resolution=spacing / count)
    assert surface.periodic
    assert surface.shape == (2 * count, 2 * count)
    radius, below = 0.1 * vdw_radii[29] + probe, spacing / np.sqrt(2)
    on_four = radius - np.sqrt(radius**2 - spacing**2 / 2) if radius > below else np.inf
    assert surface.heights.max() == 0
    tops = np.argwhere(surface.heights > -1e-12)
    assert len(tops) == 4
    for x, y in (tops + count // 2) % (2 * count):
        assert -surface.heights[x, y] == pytest.approx(min(on_four, below), abs=1e-12)
    # on a bridge it rests on two
    if probe:
        saddle = surface.heights.max(axis=0).min()
        assert -saddle == pytest.approx(radius - np.sqrt(radius**2 - spacing**2 / 4), abs=1e-12)


def test_an_atom_at_the_edge_reaches_around_a_periodic_cell():
    middle, edge = (
        made(Atoms("O", [(place, place, 5)], cell=(4, 4, 30), pbc=(1, 1, 0)), probe_radius=0.15) for place in (2, 0)
    )
    np.testing.assert_allclose(np.roll(edge.heights, (4, 4), (0, 1)), middle.heights, atol=1e-13)
    # in a cell smaller than the spheres the images overlap
    small = made(Atoms("O", [(0.3, 0.4, 5)], cell=(1, 1, 30), pbc=(1, 1, 0)), probe_radius=0.15, resolution=0.01)
    large = made(Atoms("O", [(0.3, 0.4, 5)], cell=(1, 1, 30), pbc=(1, 1, 0)).repeat((3, 3, 1)), probe_radius=0.15,
                 resolution=0.01)  # fmt: skip
    np.testing.assert_allclose(np.tile(small.heights, (3, 3)), large.heights, atol=1e-13)


def test_pixels_fit_a_periodic_cell():
    surface = made(Atoms("O9", np.indices((3, 3)).reshape(2, -1).T @ [[1.37, 0, 0], [0, 2.11, 0]],
                         cell=(4.11, 6.33, 30), pbc=(1, 1, 0)))  # fmt: skip
    nx, ny = surface.shape
    assert surface.pixel_size <= 0.05
    assert nx * surface.pixel_size == pytest.approx(0.411, rel=1e-12)
    assert ny * surface.pixel_size == pytest.approx(0.633, rel=2e-3)
    assert surface.provenance["stretched_along_y"] == pytest.approx(ny * surface.pixel_size / 0.633)


# -- sites ------------------------------------------------------------------------------------------------------------


def test_the_hydroxyls_of_the_upper_face_are_the_sites(tmp_path):
    slab, count = silica()
    assert count == 24
    ase.io.write(tmp_path / "slab.extxyz", slab)
    surface = ca.surface("atoms", file=str(tmp_path / "slab.extxyz"), resolution="0.04 nm").make()
    sites = surface.observables[SITE_POSITIONS]
    assert sites.shape == (count, 2)
    upper = slab.positions[(slab.numbers == 1) & (slab.positions[:, 2] > slab.positions[:, 2].mean())]
    np.testing.assert_allclose(np.sort(sites[:, 0]), np.sort(upper[:, 0]) / 10, atol=1e-6)
    assert surface.measured[SITE_POSITIONS].unit == "nm"
    # a water molecule above is none, and hides what is below
    wet = slab + Atoms("OH2", upper[0] + np.array([[0, 0, 2.5], [0.7, 0, 3.1], [-0.7, 0, 3.1]]))
    assert len(made(wet).observables[SITE_POSITIONS]) == count - 1
    assert len(made(slab, sites="H").observables[SITE_POSITIONS]) == count
    bare = slab[slab.numbers != 1]
    assert len(made(bare, probe_radius=0.1).observables[SITE_POSITIONS]) == 0
    assert len(made(bare, probe_radius=0.1, sites="O").observables[SITE_POSITIONS]) >= count


SCENE = {
    "name": "hydroxyls",
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": "200 nN"},
    "forming": {"kind": "uniform", "lower": 0.6, "upper": 0.8},
    "chemistry": {"site_density": "given", "activation_volume": "1 angstrom**3"},
    "engine": {"kind": "independent"},
    "hold": {"start": 1, "stop": 1e3, "per_decade": 1, "replicas": 2},
}


@pytest.mark.filterwarnings("ignore::chemage.PlanWarning")
def test_only_the_hydroxyls_in_contact_react(tmp_path):
    slab, count = silica()
    ase.io.write(tmp_path / "slab.extxyz", slab)
    scene = {**SCENE, "surface": {"kind": "atoms", "file": str(tmp_path / "slab.extxyz"), "resolution": "0.04 nm"}}
    run = ca.run(scene)
    lattice = ca.parse_scene(scene).completed().chemistry.on(run.contact)
    x, y = (run.surface.observables[SITE_POSITIONS] // run.surface.pixel_size).astype(int).T
    touching = run.contact.contact[x, y]
    assert 0 < touching.sum() <= count
    assert (run.ageing.sites == touching.sum()).all()
    assert sorted(lattice.sites) == sorted((x * run.contact.shape[1] + y)[touching])
    np.testing.assert_array_equal(
        np.sort(lattice.pressures(run.contact)), np.sort(run.contact.pressure[x, y][touching])
    )
    assert run.ageing.site_grid == f"the {count} sites of the surface"
    assert run.ageing.site_area == run.contact.contact_area
    ca.write(tmp_path / "a.h5", run)
    assert ca.read(tmp_path / "a.h5").ageing == run.ageing
    pixels = {**scene, "chemistry": {**scene["chemistry"], "site_density": "pixel"}}
    assert ca.parse_scene(pixels).keys()["ageing"] != ca.parse_scene(scene).keys()["ageing"]


def test_a_surface_without_sites_and_sites_that_share_a_pixel_are_refused():
    ball = {"kind": "sphere", "radius": 30, "pixels": 32, "pixel_size": 0.45}
    with pytest.raises(InputError, match="surface 'sphere' has no sites; use one that has, or give sites per nm²"):
        ca.plugin.plan(ca.parse_scene({**SCENE, "surface": ball}).completed())
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=1, upper=2), site_density="given")
    tip = ca.surface(**ball).make()
    with pytest.raises(InputError, match="this surface has no sites"):
        chemistry.on(ca.solve_contact(ca.contact("hertz", modulus=35), tip, 1))
    coarse = ca.solve_contact(ca.contact("fft-bem", modulus=35), made(silica()[0], resolution=0.5), 1)
    with pytest.raises(InputError, match="two sites of the surface lie in one pixel; use smaller pixels"):
        chemistry.on(coarse)
    with pytest.raises(InputError, match=r"simulate every site, without \[ageing\]"):
        ca.plugin.contact_statistics(coarse, chemistry)


# -- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cell": [(4, 0, 0), (2, 4, 0), (0, 0, 9)]}, "the axes a and b of the cell must lie along x and y"),
        ({"cell": [(0, 4, 0), (4, 0, 0), (0, 0, 9)]}, "the cell has no side along x or y"),
        ({"cell": None}, "the cell has no side along x or y; set one"),
        ({"pbc": (1, 0, 0)}, "make both a and b periodic, or none"),
        ({"cell": (40, 40, 9)}, "the probe touches no atom; use a larger probe_radius"),
        ({"symbols": "Fe"}, "ASE has no vdw radius of Fe; set radii to the other table"),
    ],
)
def test_what_has_no_height_map_is_refused_with_the_remedy(change, message):
    with pytest.raises(InputError, match=message):
        made(Atoms(**{"symbols": "O", "positions": [(1, 1, 1)], "cell": (2, 2, 9), "pbc": False, **change}))


def test_options_that_contradict_each_other_are_refused(tmp_path):
    with pytest.raises(InputError, match="file, atoms: give one of them"):
        ca.surface("atoms", resolution=1)
    with pytest.raises(InputError, match="sites = 'silanol': is no element; give its symbol, or 'hydroxyl'"):
        ca.surface("atoms", file="a.xyz", resolution=1, sites="silanol")
    (tmp_path / "a.xyz").write_text("no atoms\n")
    with pytest.raises(StoreError, match=r"ASE cannot read it .*; check format and index"):
        ca.surface("atoms", file=str(tmp_path / "a.xyz"), resolution=1).make()


def test_atoms_in_python_and_in_a_file_are_one_surface(tmp_path):
    slab, _ = silica()
    ase.io.write(tmp_path / "frames.traj", [slab[:3], slab])
    options = {"resolution": 0.1, "probe_radius": 0.2}
    given = ca.surface("atoms", atoms=slab, **options)
    read = ca.surface("atoms", file=str(tmp_path / "frames.traj"), index=1, format="traj", **options)
    np.testing.assert_array_equal(given.make().heights, read.make().heights)
    again = type(given).fromdict(given.todict())
    assert (again, again.digest()) == (given, given.digest())
    before = read.digest()
    ase.io.write(tmp_path / "frames.traj", [slab[:3], slab[:-1]])
    assert read.digest() != before
