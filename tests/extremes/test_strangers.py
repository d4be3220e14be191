"""Files from strangers: what they name elsewhere is not touched, what never ends is not read, what they say is text."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings
from contextlib import contextmanager, nullcontext

import damages
import h5py
import numpy as np
import pytest

import chemage as ca
from chemage import InputError, errors
from chemage.plugin import ExecutorError, SceneError, StoreError, container, figures


def surface_of(path, **options):
    return ca.surface("from-file", path=str(path), **{"pixel_size": 1.0, **options}).make()


# -- what is no ordinary file -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["pipe.npy", "pipe.txt", "pipe.h5", "pipe.csv"])
def test_pipes_are_refused_and_nothing_waits_for_them(tmp_path, name):
    pipe = tmp_path / name
    os.mkfifo(pipe)
    with pytest.raises(StoreError, match="is a pipe, not a file; save it to a file first"):
        surface_of(pipe)
    with pytest.raises(StoreError, match="is a pipe, not a file; save it to a file first"):
        ca.read(pipe)
    with pytest.raises(StoreError, match="is a pipe, not a file; save it to a file first"):
        ca.read_measurements(pipe)
    with pytest.raises(StoreError, match="is a pipe, not a file; save it to a file first"):
        ca.barriers("tabulated", path=str(pipe))


def test_pipes_and_devices_are_no_scenes(tmp_path, command):
    pipe = tmp_path / "scene.toml"
    os.mkfifo(pipe)
    for path in (pipe, "/dev/zero"):
        done = command("check", path)
        assert done.status == 2
        assert " is a pipe, not a file" in done.err or "is a device" in done.err or "neither a file" in done.err


class Waits(Exception):
    """A file that is opened waits for the other end of a pipe."""


@contextmanager
def at_once():
    """Nothing in the block waits for longer than any machine needs."""

    def ring(*_):
        raise Waits

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(60)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def a_pipe(path):
    os.mkfifo(path)


def a_device(path):
    path.symlink_to("/dev/zero")


def a_folder(path):
    path.mkdir()


ODD = [a_pipe, a_device, a_folder]


@pytest.mark.parametrize("odd", ODD)
def test_a_map_that_a_scene_names_is_an_ordinary_file(tmp_path, odd):
    odd(tmp_path / "map.json")
    scene = {**damages.SCENE, "accuracy": {"beta": "5 %"}, "ensemble": {"map": str(tmp_path / "map.json")}}
    with at_once(), pytest.raises(StoreError, match=r"map\.json.*(is a device|is a pipe|directory)"):
        ca.ensemble(scene)


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("place", ["point", "contact", "sweep.json", ".lock", "results.csv"])
def test_what_is_no_file_in_a_sweep_is_refused_or_counted(swept, odd, place):
    scene, folder = swept
    store = ca.load_sweep(folder).store
    key, contact = ca.load_sweep(folder).keys[1], ca.load_sweep(folder).contact_key(1)
    path = {"point": store.point(key), "contact": store.contact(contact)}.get(place, folder / place)
    path.unlink(missing_ok=True)
    odd(path)
    refused = "is a device|is a pipe|is a link|directory|is a folder|cannot write"
    with at_once():
        if place == "sweep.json":
            with pytest.raises(StoreError, match=refused):
                ca.load_sweep(folder).status()
        else:
            state = ca.load_sweep(folder).status()
            assert (state["damaged"], state["contacts_damaged"]) == (place == "point", place == "contact")
        repaired = place in ("point", "contact") and odd is not a_folder
        replaced = place == "results.csv" and odd is a_device  # the link is, and not what it leads to
        with pytest.warns(UserWarning, match="1 files are damaged") if repaired else nullcontext():
            if repaired or replaced:
                assert ca.sweep(scene, folder).status()["contacts_done"] == 2
            else:
                with pytest.raises(StoreError, match=refused), warnings.catch_warnings(action="ignore"):
                    ca.sweep(scene, folder)
    assert os.path.lexists("/dev/zero")


@pytest.mark.parametrize("odd", ODD)
def test_checkpoints_that_are_no_files_are_refused(tmp_path, odd):
    odd(tmp_path / "contact.h5")
    with at_once(), pytest.raises(StoreError, match=r"contact\.h5.*(is a device|is a pipe|is a link|directory)"):
        ca.run(damages.SCENE, checkpoints=tmp_path, warn=False)


@pytest.mark.parametrize("place", ["checkpoints", "figures", "samples", "points"])
def test_nothing_is_written_through_a_link_to_a_folder(tmp_path, place):
    elsewhere, folder = tmp_path / "elsewhere", tmp_path / place
    elsewhere.mkdir()
    if place == "points":  # in a folder of samples
        (tmp_path / "samples").mkdir()
        folder = tmp_path / "samples" / "points"
    folder.symlink_to(elsewhere)
    mean = {**damages.SCENE, "accuracy": {"beta": "60 %"}}
    write = {
        "checkpoints": lambda: ca.run(damages.SCENE, checkpoints=folder, warn=False),
        "figures": lambda: figures.save_figures({}, folder),
    }.get(place, lambda: ca.ensemble(mean, samples=tmp_path / "samples"))
    with pytest.raises(StoreError, match=rf"{place} is a link, which is not followed"):
        write()
    assert list(elsewhere.iterdir()) == []


def test_loops_of_links_and_null_bytes_are_names_of_nothing(tmp_path):
    loop = tmp_path / "loop.npy"
    loop.symlink_to(loop)
    with pytest.raises(StoreError, match="Too many levels"):
        surface_of(loop)
    for call in (surface_of, ca.read, ca.load_scene, ca.read_measurements):
        for path in (str(loop), "a\0b.npy", "a\0b.toml"):
            with pytest.raises(StoreError):
                call(path)


# -- HDF5 ------------------------------------------------------------------------------------------


@pytest.fixture
def secret(tmp_path):
    path = tmp_path / "secret.h5"
    with h5py.File(path, "w") as file:
        file["heights"] = np.ones((4, 4))
    (tmp_path / "secret.bin").write_bytes(np.ones((4, 4)).tobytes())
    return path


def test_heights_outside_the_file_are_not_read(tmp_path, secret):
    external, virtual, linked = (tmp_path / f"{name}.h5" for name in ("external", "virtual", "linked"))
    with h5py.File(external, "w") as file:
        file.create_dataset("heights", (4, 4), "f8", external=[(str(tmp_path / "secret.bin"), 0, 128)])
    with h5py.File(virtual, "w") as file:
        layout = h5py.VirtualLayout((4, 4), "f8")
        layout[:] = h5py.VirtualSource(secret, "heights", (4, 4))
        file.create_virtual_dataset("heights", layout)
    with h5py.File(linked, "w") as file:
        file["heights"] = h5py.ExternalLink(str(secret), "/heights")
        file["soft"] = h5py.SoftLink("/heights")
        file["group"] = h5py.ExternalLink(str(secret), "/")
    for path, name in ((external, "heights"), (virtual, "heights"), (linked, "heights"), (linked, "soft")):
        with pytest.raises(StoreError, match=r"other files|another file"):
            surface_of(path, reader={"kind": "hdf5", "dataset": name})
    with pytest.raises(StoreError, match="another file"):
        surface_of(linked, reader={"kind": "hdf5", "dataset": "group/heights"})


@pytest.mark.parametrize("way", ["external", "virtual", "linked", "soft", "group"])
def test_a_result_brings_in_nothing_from_elsewhere(tmp_path, secret, way):
    """Even where its seal fits, which a stranger can make as well as chemage."""
    path, pipe = tmp_path / "x.h5", tmp_path / "pipe"
    os.mkfifo(pipe)
    ca.write(path, ca.Surface(heights=np.zeros((4, 4)), pixel_size=1.0))
    with h5py.File(path, "r+") as file:
        surface = file["surface"]
        attributes = dict(surface["heights"].attrs)
        if way != "group":
            del surface["heights"]
        if way == "external":
            surface.create_dataset("heights", (4, 4), "f8", external=[(str(tmp_path / "secret.bin"), 0, 128)])
        elif way == "virtual":
            layout = h5py.VirtualLayout((4, 4), "f8")
            layout[:] = h5py.VirtualSource(secret, "heights", (4, 4))
            surface.create_virtual_dataset("heights", layout)
        elif way == "linked":
            surface["heights"] = h5py.ExternalLink(str(secret), "/heights")
        elif way == "soft":
            file["away"] = h5py.ExternalLink(str(pipe), "/")
            surface["heights"] = h5py.SoftLink("/away/heights")
        else:
            file["contact"] = h5py.ExternalLink(str(pipe), "/contact")
        if way in ("external", "virtual"):
            surface["heights"].attrs.update({name: attributes[name] for name in ("units", "long_name")})
    damages.sealed_again(path)
    with at_once(), pytest.raises(StoreError, match=r"keeps its data in other files|is a link, which chemage"):
        ca.read(path)


def test_sizes_are_added_up_before_anything_is_read(tmp_path, monkeypatch):
    """Hard links, and arrays that compress: each fits, all of them do not."""
    path = tmp_path / "x.h5"
    ca.write(path, ca.Surface(heights=np.zeros((100, 100)), pixel_size=1.0))
    with h5py.File(path, "r+") as file:
        big = file["surface"].create_dataset("big", (4_000_000,), "f8", chunks=(1000,), compression="gzip")
        for number in range(9):
            file[f"surface/more{number}"] = big
    damages.sealed_again(path)
    assert path.stat().st_size < 200_000
    monkeypatch.setenv("CHEMAGE_MEMORY", "200 MB")
    with pytest.raises(StoreError, match=r"x\.h5 has 320 MB of data, but there are 200 MB of memory"):
        ca.read(path)


def test_an_archive_announces_no_more_than_it_holds(tmp_path, monkeypatch):
    path = tmp_path / "x.npz"
    container.write(path, {"table": container.Arrays(values={"zeros": np.zeros(1000)})}, compact=True)
    content = path.read_bytes().replace(b"[1000]", b"[9e99]")
    for seen, given in ((b"[1000]", b"[1000000000000]"), (b"(0,), }      ", b"(30000000,), }")):
        path.write_bytes(content[: content.rfind(b"\n[[")].replace(b"[9e99]", b"[1000]").replace(seen, given))
        damages.sealed_again(path)
        monkeypatch.setenv("CHEMAGE_MEMORY", "1 GB")
        with pytest.raises(StoreError, match=r"damaged|of data, but there are"):
            container.read(path, {"table": container.Arrays})


@pytest.mark.parametrize("dataset", ["surface/heights", None])
def test_a_result_is_verified_where_its_map_alone_is_read(tmp_path, dataset):
    path = tmp_path / "x.h5"
    ca.write(path, ca.Surface(heights=np.zeros((4, 4)), pixel_size=1.0))
    reader = {"kind": "hdf5", **({"dataset": dataset} if dataset else {})}
    assert not surface_of(path, reader=reader).heights.any()
    damages.edited(path, lambda file: file["surface/heights"].__setitem__((0, 0), 1.0))
    with pytest.raises(StoreError, match="its checksums are missing"):
        surface_of(path, reader=reader)


def test_a_small_file_that_announces_a_huge_map_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("CHEMAGE_MEMORY", "1 GB")
    with h5py.File(tmp_path / "huge.h5", "w") as file:
        file.create_dataset("heights", (100_000, 100_000), "f8", chunks=(100, 100))
    with pytest.raises(StoreError, match=r"80 GB of data, but there are 1 GB"):
        surface_of(tmp_path / "huge.h5")
    np.save(tmp_path / "huge.npy", np.zeros((3, 3)))
    content = (tmp_path / "huge.npy").read_bytes().replace(b"(3, 3), }      ", b"(30000, 30000),}")
    (tmp_path / "huge.npy").write_bytes(content)
    with pytest.raises(StoreError, match="truncated"):
        surface_of(tmp_path / "huge.npy")


@pytest.mark.parametrize(
    ("given", "periodic"),
    [
        ("no", False),
        ("yes", True),
        ("False", False),
        (b"true", True),
        (0, False),
        (np.int8(1), True),
        (np.array([1]), True),
    ],
)
def test_periodic_means_what_it_says(tmp_path, given, periodic):
    with h5py.File(tmp_path / "map.h5", "w") as file:
        file.create_dataset("heights", data=np.eye(4)).attrs["periodic"] = given
    assert surface_of(tmp_path / "map.h5").periodic is periodic


@pytest.mark.parametrize(
    ("name", "value"),
    [("periodic", "perhaps"), ("periodic", 2), ("periodic", [0, 1]), ("pixel_size", [1.0, 2.0]), ("pixel_size", "1 s")],
)
def test_attributes_that_say_nothing_are_refused(tmp_path, name, value):
    with h5py.File(tmp_path / "map.h5", "w") as file:
        file.create_dataset("heights", data=np.eye(4)).attrs[name] = value
    with pytest.raises((StoreError, InputError), match=r"periodic|pixel_size|1 s"):
        surface_of(tmp_path / "map.h5", pixel_size=None)


# -- TOML ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = " + "[" * 90 + "]" * 90, "nested more than 32 deep"),
        ("x = " + "9" * 5000, "not valid TOML"),
        ("x = " + "9" * 200, "more than 256 bits"),
        ("title = '" + "a" * 1_000_001 + "'", "1000001 characters"),
    ],
)
def test_scenes_too_deep_or_too_large(tmp_path, text, said):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=said):
        ca.load_scene(path)


# -- text ------------------------------------------------------------------------------------------


def test_what_is_printed_does_not_move_the_cursor(command, small, tmp_path):
    title = "\x1b[2J\x1b]0;owned\x07 red\r\x9b31m \u202egnp"
    done = command("run", small, "--set", f"title={json.dumps(title)}", "--no-figures")
    assert done.status == 0, done.err
    shown = command("show", "small.h5").out
    for text in (done.out, shown):
        assert "\\x1b[2J" in text
        assert not any(letter in text for letter in "\x1b\x07\r\x9b\u202e")
    missing = command("show", "\x1b[2Jno.h5")
    assert "\x1b" not in missing.err
    assert errors.printable("Δµ\t1\n") == "Δµ\t1\n"


PROGRAM = [sys.executable, "-m", "chemage"]


@pytest.mark.parametrize(
    "words",
    [*(pytest.param(one, marks=pytest.mark.long) for one in ("show small.h5", "check small.toml")), "--version"],
)
def test_outputs_that_are_closed_before_the_start_leave_no_traceback(command, small, words):
    assert command("run", small, "--no-figures").status == 0
    for closed in (">&-", ">&- 2>&-"):
        line = f"{' '.join(PROGRAM)} {words} {closed}"
        done = subprocess.run(line, shell=True, cwd=small.parent, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


def test_too_little_address_space_is_one_line(small):
    line = f"ulimit -v 700000; {' '.join(PROGRAM)} run small.toml"
    done = subprocess.run(line, shell=True, cwd=small.parent, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "the address space of this process is limited to 717 MB" in done.stderr


INTERRUPTED = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "typer": raise KeyboardInterrupt
sys.meta_path.insert(0, Finder())
from chemage.cli import main
main()
"""


def test_an_interruption_while_the_program_is_loaded_is_one_line():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "\ninterrupted; nothing was written\n")


def test_a_fault_of_the_program_is_one_line_and_its_place_is_in_the_log(command, small, monkeypatch):
    def fail(*args, **options):
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr(ca.Scene, "in_use", fail)
    done = command("check", small, "--log", small.parent / "log.txt")
    assert (done.status, done.out) == (3, "")
    assert done.err.count("\n") == 1
    assert "ZeroDivisionError: by hand" in done.err
    assert 'raise ZeroDivisionError("by hand")' in (small.parent / "log.txt").read_text()


@pytest.mark.long
@pytest.mark.parametrize("closing", ["| head -1", ">&-", "> /dev/full"])
def test_closed_and_full_outputs_leave_no_traceback(small, closing):
    line = f"{sys.executable} -m chemage schema {closing}; exit 0"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


# -- folders of sweeps ------------------------------------------------------------------------------------------


@pytest.fixture
def swept(tiny, tmp_path):
    scene = tiny.scene(sweep={"contact.load": [1.0, 2.0]})
    ca.sweep(scene, tmp_path / "out")
    return scene, tmp_path / "out"


def rewritten(folder, **changes):
    """Change entries of a manifest as a stranger could, who knows how it is written."""
    manifest = folder / "sweep.json"
    manifest.write_bytes(container.sealed_json({**container.read_json(manifest), **changes}))


@pytest.mark.parametrize(
    "changes",
    [
        {"keys": ["../../evil", "0" * 32]},
        {"contacts": ["/etc/passwd", "0" * 32]},
        {"keys": [7, "0" * 32]},
        {"contact_of": [0, 9]},
        {"contact_of": [True, 0]},
        {"grid": {"axes": 3}},
        {"versions": []},
        {"resolved": []},
    ],
)
def test_a_manifest_names_nothing_outside_its_folder(swept, changes):
    scene, folder = swept
    rewritten(folder, **changes)
    with pytest.raises(StoreError, match=r"sweep\.json"):
        ca.load_sweep(folder)
    with pytest.raises(StoreError, match=r"sweep\.json"):
        ca.sweep(scene, folder)


@pytest.mark.parametrize("name", [".parts", ".lock", "points", "contacts"])
def test_links_in_a_folder_of_results_are_not_followed(swept, tmp_path, name):
    import shutil

    scene, folder = swept
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine").write_text("mine")
    place = folder / name
    if place.is_dir():
        shutil.rmtree(place)
    place.unlink(missing_ok=True)
    place.symlink_to(elsewhere / "mine" if name == ".lock" else elsewhere)
    with pytest.raises(StoreError, match="is a link"):
        ca.sweep(scene, folder)
    assert [path.name for path in elsewhere.iterdir()] == ["mine"]
    assert (elsewhere / "mine").read_text() == "mine"


# -- clusters ------------------------------------------------------------------------------------------


@pytest.fixture
def start(tiny, tmp_path, monkeypatch):
    """Start a sweep on Dask; what its cluster is started with is noted, and it does not start."""
    options = []

    def refuse(**given):
        options.append(given)
        raise RuntimeError("not started")

    monkeypatch.setattr("distributed.LocalCluster", refuse)

    def start(detail):
        options.clear()
        with pytest.raises((ExecutorError, InputError)) as caught:
            ca.sweep(tiny.scene(sweep={"hold.seed": [0, 1]}), tmp_path / "out", executor=f"dask:{detail}".strip(":"))
        return str(caught.value), *options

    return start


def test_a_cluster_on_this_machine_is_reached_from_this_machine_alone(start):
    _, options = start("")
    assert (options["host"], options["dashboard_address"]) == ("127.0.0.1", "127.0.0.1:0")
