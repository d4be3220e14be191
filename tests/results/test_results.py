"""What is written is read back bit for bit, by chemage and by xarray, and is never half there."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import subprocess
import sys
import threading
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import chemage
from chemage import Ageing, ContactSolution, ReactionLattice, Surface, load_scene
from chemage.plugin import BondHistory, DamagedError, StoreError, container

TRICKY = {
    "text": "µ ≥ 0, \"quoted\", 'single', \n",
    "empty": "",
    "none": None,
    "true": True,
    "nan": math.nan,
    "inf": -math.inf,
    "third": 1 / 3,
    "tiny": 5e-324,
    "big": 2**80,
    "nested": {"a": [1, [2.5, None]], "": {}},
}

OBJECTS = {
    "surface": Surface(heights=np.random.default_rng(0).normal(size=(5, 7)), pixel_size=0.1 + 0.2, provenance=TRICKY),
    "surface in single precision": Surface(
        heights=np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32), pixel_size=1.0, periodic=False
    ),
    "surface of one pixel": Surface(heights=[[5e-324]], pixel_size=1e-100),
    "contact": ContactSolution(
        pressure=np.eye(4),
        load=4.0,
        pixel_size=1.0,
        modulus=35.3,
        gap=1 - np.eye(4),
        displacement=-0.0,
        rms_slope=math.nan,
        rms_height=math.inf,
        converged=False,
        residual=1e-300,
        iterations=7,
        convergence={"history": [[0.1, 0.2]] * 5000, "levels": [{"pixels": [4, 4]}]},
        notes=("one", "µ", ""),
        provenance=TRICKY,
    ),
    "contact without anything": ContactSolution(pressure=np.zeros((1, 1)), load=0, pixel_size=1.0, modulus=1.0),
    "contact that compresses": ContactSolution(
        pressure=np.pad(np.ones((10, 10)), 200), load=100.0, pixel_size=1.0, modulus=1.0
    ),
    "lattice": ReactionLattice(
        pixels=(2, 3),
        sites=[0, 4, 5],
        forming=[1.0, -1.0, 0.0],
        breaking=[1.1, 1.2, 1e-9],
        neighbours=np.array([[1, -1], [0, -1], [-1, -1]]),
        coupling=np.array([[0.5, 0], [0.5, 0], [0, 0]], np.float32),
    ),
    "lattice without sites": ReactionLattice(pixels=(2, 3), sites=np.zeros(0, int), forming=np.zeros(0)),
    "lattice without sites that interact": ReactionLattice(
        pixels=(2, 3),
        sites=np.zeros(0, int),
        forming=np.zeros(0),
        neighbours=np.zeros((0, 8), np.int32),
        coupling=np.zeros((0, 8)),
    ),
    "history": BondHistory(
        hold_times=[0.0, 1.0],
        bonds=[0, 1],
        formed=[0, 2],
        broken=[0, 1],
        state=[True, False, False],
        time=1.0,
        temperature=300.0,
        engine="by-hand",
        resume={
            "words": np.arange(6, dtype=np.uint64).reshape(2, 3) + 2**63,
            "flag": np.array([True, False]),
            "scalar": np.array(2.5),
            "nothing": np.zeros((0, 2), np.float32),
            "short": np.array([-3], np.int8),
        },
    ),
    "history without sites": BondHistory(
        hold_times=[1.0],
        bonds=[0],
        formed=[0],
        broken=[0],
        state=np.zeros(0, bool),
        time=1.0,
        temperature=1.0,
        engine="",
    ),
    "ageing": Ageing(
        hold_times=[0.0, 1e-100, 1e100],
        bonds=[[0, 1, 2], [3, 4, 2**62]],
        sites=[9, 2**62],
        events=[0, 2**62],
        load=0.0,
        temperature=300.0,
        engine="bkl",
        contact={"kappa": math.nan, "patches": 3.0},
        observables={"one": np.array([1.0, math.nan]), "map": np.zeros((2, 3, 4), np.float32), "hold_times": np.eye(2)},
        provenance=TRICKY,
    ),
}


def same(one, two):
    """Equal to the last bit, with the same types; nan is nan, −0 is not 0."""
    assert type(one) is type(two), (one, two)
    if isinstance(one, np.ndarray):
        assert one.dtype == two.dtype
        assert one.shape == two.shape
        assert one.tobytes() == two.tobytes()
    elif isinstance(one, dict):
        assert one.keys() == two.keys()
        for name in one:
            same(one[name], two[name])
    elif isinstance(one, list | tuple):
        assert len(one) == len(two)
        for pair in zip(one, two, strict=True):
            same(*pair)
    elif isinstance(one, float):
        assert np.float64(one).tobytes() == np.float64(two).tobytes()
    else:
        assert one == two


@pytest.mark.parametrize("compact", [False, True])
@pytest.mark.parametrize("name", OBJECTS)
def test_objects_come_back_bit_for_bit(tmp_path, name, compact):
    before = OBJECTS[name]
    container.write(tmp_path / "x", {"it": before}, {"key": "a word"}, compact=compact)
    parts, about = container.read(tmp_path / "x", {"it": type(before)})
    after = parts["it"]
    assert about["key"] == "a word"
    assert after == before
    assert after.digest() == before.digest()
    same(after.todict(), before.todict())
    for value in after.todict().values():
        assert not (isinstance(value, np.ndarray) and value.flags.writeable)


@pytest.mark.long
@settings(max_examples=20)
@given(
    heights=hnp.arrays(
        st.sampled_from([np.float64, np.float32]),
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=6),
        elements=st.floats(-(2.0**100), 2.0**100, width=32),
    ),
    words=st.dictionaries(
        st.text(max_size=5), st.text(max_size=20) | st.floats() | st.booleans() | st.none(), max_size=4
    ),
)
def test_any_surface_comes_back(tmp_path_factory, heights, words):
    file = tmp_path_factory.mktemp("any") / "x.h5"
    before = Surface(heights=heights, pixel_size=1.0, provenance=words)
    chemage.write(file, before)
    same(chemage.read(file).todict(), before.todict())


def test_numpy_values_of_a_plugin_are_kept_as_plain_ones(tmp_path):
    record = {"n": np.int64(3), "x": np.float32(0.5), "list": np.arange(3), "path": tmp_path}
    chemage.write(tmp_path / "x.h5", Surface(heights=[[0.0]], pixel_size=1.0, provenance=record))
    after = chemage.read(tmp_path / "x.h5").provenance
    assert after == {"n": 3, "x": 0.5, "list": [0, 1, 2], "path": str(tmp_path)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory, small_text):
    """A finished run and its file."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "small.toml").write_text(small_text)
    run = chemage.run(load_scene(folder / "small.toml"))
    chemage.write(folder / "small.h5", run)
    return run, folder / "small.h5"


def test_a_run_comes_back_whole(finished):
    run, file = finished
    again = chemage.read(file)
    for name in ("scene", "timings", "versions", "keys", "cite"):
        same(getattr(again, name), getattr(run, name))
    assert (again.surface, again.contact, again.ageing) == (run.surface, run.contact, run.ageing)
    same(again.summary(), run.summary())


def test_the_root_says_what_the_run_was(finished):
    run, file = finished
    with h5py.File(file) as opened:
        told = {name: opened.attrs[name] for name in ("scene", "versions", "keys")}
    assert json.loads(told["scene"])["hold"]["seed"] == 5
    assert json.loads(told["keys"]) == run.keys
    assert {"chemage", "numpy", "scipy", "numba", "python"} <= json.loads(told["versions"]).keys()


@pytest.mark.parametrize(
    ("group", "dims", "units"),
    [
        ("surface", {"x": 48, "y": 48}, {"heights": "nm", "x": "nm", "y": "nm"}),
        ("contact", {"x": 48, "y": 48}, {"pressure": "GPa", "x": "nm", "y": "nm"}),
        (
            "ageing",
            {"replica": 3, "hold_time": 17},
            {"hold_time": "s", "bonds": "1", "sites": "1", "friction_drop": "nN"},
        ),
    ],
)
def test_xarray_reads_every_group(finished, group, dims, units):
    run, file = finished
    with xarray.open_dataset(file, group=group, engine="h5netcdf") as data:
        assert dict(data.sizes) == dims
        for name, unit in units.items():
            assert data[name].attrs["units"] == unit, name
            assert data[name].attrs["long_name"]
        thing = getattr(run, group)
        for name, (dimensions, _, _) in thing.arrays.items():
            if getattr(thing, name) is not None:
                stored = data[thing.stored_names.get(name, name)]
                assert stored.dims == dimensions
                assert np.array_equal(stored.values, getattr(thing, name))
        if group == "ageing":
            assert "hold_time" in data.coords
            assert data["bonds"].sel(hold_time=100.0, method="nearest").shape == (3,)
        else:
            assert set(data.coords) == {"x", "y"}
            assert data.x.values[:2] == pytest.approx([0.2259, 0.6777])


def test_xarray_reads_the_observables(finished):
    run, file = finished
    with xarray.open_dataset(file, group="ageing/observables", engine="h5netcdf") as data:
        assert set(data.data_vars) == set(run.ageing.observables)


# -- what follows from the bonds ---------------------------------------------------------------------------------------

FRICTION = [f"friction{quantity}_drop{error}" for quantity in ("", "_coefficient") for error in ("", "_stderr")]


def test_friction_and_its_errors_are_beside_the_bonds(finished):
    run, file = finished
    with xarray.open_dataset(file, group="ageing", engine="h5netcdf") as data:
        summary = run.summary()
        for name in (*FRICTION, "friction_drop_half_width", "friction_coefficient_drop_half_width"):
            assert data[name].dims == ("hold_time",)
            # what is not known is null in JSON
            assert [None if math.isnan(value) else value for value in data[name].values.tolist()] == summary[name]
            assert data[name].attrs["comment"] == "derived"
        assert data["friction_coefficient_drop_stderr"].attrs["units"] == "1"
        for name in ("beta", "beta_stderr", "beta_half_width", "cutoff_time", "cutoff_time_low"):
            assert data.attrs[name] == summary[name]
        assert data.attrs["fit_window"].tolist() == list(run.window)
        derived = set(json.loads(data.attrs["derived"]))
        assert {*FRICTION, "beta", "fit_window"} <= derived
        assert not derived & set(Ageing.model_fields)


def test_curves_carry_the_dimension_scale_of_the_hold_times(finished):
    with h5py.File(finished[1]) as opened:
        ageing = opened["ageing"]
        for name in (*FRICTION, "bonds"):
            assert ageing[name].dims[ageing[name].ndim - 1][0] == ageing["hold_time"]


def test_the_fit_is_that_of_the_window_of_the_scene(finished, tmp_path):
    run = finished[0]
    narrow = dataclasses.replace(run, scene={**run.scene, "fit": {"start": 1.0, "stop": 100.0}})
    chemage.write(tmp_path / "run.h5", narrow)
    chemage.write(tmp_path / "ageing.h5", run.ageing)
    for file, fit in (("run.h5", narrow.fit()), ("ageing.h5", run.ageing.fit())):
        with h5py.File(tmp_path / file) as opened:
            assert opened["ageing"].attrs["beta"] == [fit.beta]


def test_what_cannot_be_derived_is_absent(tmp_path):
    chemage.write(tmp_path / "x.h5", OBJECTS["ageing"])
    with h5py.File(tmp_path / "x.h5") as opened:
        ageing = opened["ageing"]
        assert "friction_drop" in ageing
        assert "friction_coefficient_drop" not in ageing, "there is no load"
        assert "beta" not in ageing.attrs


def test_derived_numbers_are_computed_again_and_never_read(finished, tmp_path):
    run, _ = finished
    wrong = SimpleNamespace(
        variables={"friction_drop": (("hold_time",), run.ageing.hold_times, "nN", "wrong")}, attributes={"beta": 7.0}
    )
    container.write(tmp_path / "x.h5", run.parts(), run.attributes(), derived={"ageing": wrong})
    again = chemage.read(tmp_path / "x.h5")
    assert again.ageing == run.ageing
    assert again.summary() == run.summary()


def test_observables_share_the_dimensions_of_their_result(tmp_path):
    declared = {"a": {"dims": ["hold_times", "bin"], "unit": "", "description": ""}}
    ageing = OBJECTS["ageing"].model_copy(update={"observables": {"a": np.ones((2, 3, 4))}, "outputs": declared})
    chemage.write(tmp_path / "x.h5", ageing)
    assert chemage.read(tmp_path / "x.h5") == ageing
    with xarray.open_dataset(tmp_path / "x.h5", group="ageing/observables", engine="h5netcdf") as data:
        assert dict(data["a"].sizes) == {"replica": 2, "hold_time": 3, "bin": 4}
    if not hasattr(xarray, "open_datatree"):  # since 2024.10
        return
    with xarray.open_datatree(tmp_path / "x.h5", engine="h5netcdf") as tree:
        assert tree["ageing/observables"]["a"].sel(hold_time=0.0).shape == (2, 4)


def test_a_pressure_map_is_compressed_and_noise_is_not(tmp_path):
    chemage.write(tmp_path / "sparse.h5", OBJECTS["contact that compresses"])
    assert (tmp_path / "sparse.h5").stat().st_size < OBJECTS["contact that compresses"].pressure.nbytes / 10


# -- the same everywhere ---------------------------------------------------------------------------------------------

DIGESTS = """
import json, chemage
from chemage import load_scene
digests = []
for seed in (5, 5, 6):
    run = chemage.run(load_scene("small.toml", {"hold.seed": seed, "surface.seed": seed}))
    digests.append([run.surface.digest(), run.contact.digest(), run.ageing.digest()])
print(json.dumps(digests))
"""


@pytest.mark.long
def test_digests_are_the_same_in_every_process_and_differ_between_seeds(small):
    seen = []
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        words = [sys.executable, "-c", DIGESTS]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
        seen.append(json.loads(done.stdout))
    assert seen[0] == seen[1]
    first, again, other = seen[0]
    assert first == again
    assert all(one != two for one, two in zip(first, other, strict=True))


# -- one file, whole or not at all -----------------------------------------------------------------------------------


def test_two_threads_that_write_one_file_leave_one_whole_one(tmp_path):
    things = [Surface(heights=np.full((50, 50), float(i)), pixel_size=1.0) for i in range(8)]
    failed = []

    def write(thing):
        try:
            chemage.write(tmp_path / "x.h5", thing)
        except StoreError as error:
            failed.append(str(error))

    threads = [threading.Thread(target=write, args=(thing,)) for thing in things]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(failed) == 7
    assert all("already there" in text or "appeared while" in text for text in failed)
    assert chemage.read(tmp_path / "x.h5") in things
    assert [p.name for p in tmp_path.iterdir()] == ["x.h5"]


def test_an_object_that_fails_half_way_leaves_nothing(tmp_path, monkeypatch):
    real, count = h5py.Group.create_dataset, iter(range(100))

    def fail(*args, **options):
        if next(count) == 2:
            raise ValueError("a bug")
        return real(*args, **options)

    monkeypatch.setattr(h5py.Group, "create_dataset", fail)
    with pytest.raises(ValueError, match="a bug"):
        chemage.write(tmp_path / "x.h5", OBJECTS["contact"])
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("error")
def test_files_without_hard_links_work_too(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", refuse)
    chemage.write(tmp_path / "x.h5", OBJECTS["surface"])
    assert chemage.read(tmp_path / "x.h5") == OBJECTS["surface"]
    with pytest.raises(StoreError, match="already there"):
        chemage.write(tmp_path / "x.h5", OBJECTS["surface"])


def test_one_object_is_read_alone(finished):
    _, file = finished
    parts, attributes = container.read(file, {"ageing": Ageing})
    assert list(parts) == ["ageing"]
    assert attributes["chemage_format"] == container.FORMAT


# -- checksums --------------------------------------------------------------------------------------------------------


def write_two(path):
    container.write(path, {"contact": OBJECTS["contact"], "ageing": OBJECTS["ageing"]}, {"scene": "{}"})


@pytest.mark.parametrize(("group", "array"), [("contact", "pressure"), ("ageing", "bonds")])
def test_damage_is_named_by_file_and_group(tmp_path, group, array):
    file = tmp_path / "x.h5"
    write_two(file)
    with h5py.File(file) as opened:
        place = opened[group][array].id.get_offset()
    data = bytearray(file.read_bytes())
    data[place] ^= 1
    file.write_bytes(data)
    with pytest.raises(DamagedError, match=rf"x\.h5: {group} is not what chemage wrote: it is damaged, or another"):
        chemage.read(file)


def change_number(file):
    file["ageing/bonds"][0, 0] = 7


def remove_attribute(file):
    del file["ageing"].attrs["bond_force"]


def add_group(file):
    file.create_group("mine")


@pytest.mark.parametrize("change", [change_number, remove_attribute, add_group])
def test_what_another_program_changed_is_not_believed(tmp_path, change):
    file = tmp_path / "x.h5"
    chemage.write(file, OBJECTS["ageing"])
    with h5py.File(file, "r+") as opened:
        change(opened)
    with pytest.raises(DamagedError, match=r"x\.h5( is damaged: its checksums are missing|.* not what chemage wrote)"):
        chemage.read(file)


def test_files_of_0_1_are_refused_with_a_way_out(tmp_path):
    file = tmp_path / "x.h5"
    chemage.write(file, OBJECTS["history"])
    with h5py.File(file, "r+") as opened:
        opened.attrs["chemage_format"], opened.attrs["chemage"] = 1, "0.1.3"
    with pytest.raises(StoreError, match=r"written by chemage 0\.1\.3; read it with chemage 0\.2, and write it again"):
        chemage.read(file)


def test_other_programs_read_sealed_files(tmp_path):
    chemage.write(tmp_path / "x.h5", OBJECTS["contact"])
    with xarray.open_dataset(tmp_path / "x.h5", group="contact", engine="h5netcdf") as data:
        assert np.array_equal(data["pressure"], OBJECTS["contact"].pressure)


def test_a_file_has_its_name_only_when_it_is_on_the_disk(tmp_path, monkeypatch):
    order = []
    real = {name: getattr(os, name) for name in ("fsync", "replace", "link")}

    def noted(name):
        def call(*arguments, **options):
            order.append((name, os.readlink(f"/proc/self/fd/{arguments[0]}") if name == "fsync" else str(arguments[1])))
            return real[name](*arguments, **options)

        return call

    for name in real:
        monkeypatch.setattr(os, name, noted(name))
    chemage.write(tmp_path / "x.h5", OBJECTS["ageing"])
    (first, part), (second, target), (third, folder) = order
    assert (first, second, third) in (("fsync", "link", "fsync"), ("fsync", "replace", "fsync"))
    assert part.endswith(".part")
    assert (target, folder) == (str(tmp_path / "x.h5"), str(tmp_path))
