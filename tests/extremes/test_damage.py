"""Damaged files of every kind that chemage writes: each is an error, or reads as it was, and none is a crash.

They are read in a process of its own, so that a crash of the interpreter is seen. ``CHEMAGE_FUZZ=20`` tries
twenty times as many.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import warnings

import damages
import numpy as np
import pytest

import chemage
from chemage.plugin import StoreError

SCRIPT = """
import sys, warnings
from pathlib import Path

import numpy as np

import chemage
from chemage import Ageing, ContactSolution, ReactionLattice, Surface
from chemage.plugin import BondHistory
from chemage.foundation import container
from chemage.studies.folder import Folder

count, folder = int(sys.argv[1]), Path(sys.argv[2])
rng = np.random.default_rng(0)
pressure = np.where(rng.random((12, 9)) < 0.3, rng.random((12, 9)), 0.0)
contact = ContactSolution(pressure=pressure, load=3.0, pixel_size=0.5, modulus=35.3, notes=("a note",),
                          convergence={"history": [[0.1, 0.01]]}, provenance={"kind": "by-hand"})
history = BondHistory(hold_times=[0.1, 1.0], bonds=[1, 2], formed=[1, 3], broken=[0, 1], state=[True, True, False],
                      time=1.0, temperature=300.0, engine="by-hand", resume={"words": np.arange(9, dtype=np.uint64)})
ageing = Ageing(hold_times=[0.1, 1.0, 10.0], bonds=[[1, 2, 3], [0, 2, 2]], sites=[4, 4], events=[9, 9], load=3.0,
              temperature=300.0, engine="by-hand", observables={"map": rng.random((2, 3, 4))})
lattice = ReactionLattice(pixels=(4, 4), sites=[0, 1, 5], forming=[1.0, 0.9, 0.8],
                          neighbours=[[1], [0], [-1]], coupling=[[0.1], [0.1], [0.0]])
surface = Surface(heights=rng.normal(size=(12, 9)), pixel_size=0.5)
point = {"status": "done", "point": 3, "changes": {"contact.load": 3.0}, "summary": {"beta": 1 / 3}, "ageing": None}
grid = {"axes": [{"paths": ["hold.seed"], "values": [[0], [1]]}], "base": {"name": "x"}, "source": "x.toml"}
manifest = {"format": 2, "digest": "0" * 32, "versions": {"chemage": "0.2.0"}, "grid": grid, "resolved": [[[0], [1]]],
            "units": {}, "contacts": ["a" * 32], "contact_of": [0, 0], "keys": ["b" * 32, "c" * 32]}
sweep = Folder(folder / "sweep")
sweep.path.mkdir()
sweep.clear_parts()


def stored(thing):
    return lambda path: chemage.write(path, thing, force=True), lambda path: chemage.read(path)


def checkpoint(path):
    container.write(path, {"history": history, "contact": contact}, {"checkpoint": "key", "run": "run"}, force=True)


def read_checkpoint(path):
    return container.read(path, {"history": BondHistory, "contact": ContactSolution})


def in_sweep(place, write, read):
    def put(path):
        write()
        path.write_bytes(place.read_bytes())

    def get(path):
        place.write_bytes(path.read_bytes())
        return read()

    return put, get


def keep_contact():
    sweep.contact("aa").unlink(missing_ok=True)
    sweep.keep_contact("aa", contact)


def state_and_point():
    content = sweep.read_point("aa")
    if sweep.state("aa") != content["status"]:
        raise AssertionError("two answers")
    if content["status"] == "damaged":
        raise chemage.plugin.StoreError("damaged")
    return content


WAYS = {
    "ageing": stored(ageing), "contact": stored(contact), "history": stored(history), "lattice": stored(lattice),
    "surface": stored(surface), "checkpoint": (checkpoint, read_checkpoint),
    "contact of a sweep": in_sweep(sweep.contact("aa"), keep_contact,
                                   lambda: sweep.read_contact("aa")),
    "point of a sweep": in_sweep(sweep.point("aa"), lambda: sweep.write_point("aa", point), state_and_point),
    "manifest": in_sweep(sweep.manifest, lambda: sweep.write_manifest(manifest),
                         sweep.read_manifest),
}
(sweep.path / "contacts").mkdir()
damaged = folder / "damaged.h5"


def spoil(whole, number):
    text = bytearray(whole)
    where = int(rng.integers(len(text)))
    match number % 6:
        case 0 | 1 | 2:
            text[where] ^= 1 << int(rng.integers(8))
        case 3:
            del text[where:]
        case 4:
            text[where : where + 64] = bytes(64)
        case 5:
            text[where:where] = rng.bytes(int(rng.integers(1, 9)))
    return bytes(text)


for kind, (put, get) in WAYS.items():
    print(kind, flush=True)
    original = folder / "original.h5"
    original.unlink(missing_ok=True)
    put(original)
    whole, expected, caught, changed = original.read_bytes(), get(original), 0, 0
    for number in range(count):
        spoiled = spoil(whole, number)
        changed += spoiled != whole
        damaged.write_bytes(spoiled)
        try:
            found = get(damaged)
        except chemage.ChemageError as error:
            caught += 1
            if "damaged" not in str(error):
                sys.exit(f"{number}: the message does not say what is wrong: {error}")
            continue
        if found != expected:
            sys.exit(f"{number}: other content, and no error")
    print("caught", caught, "of", changed, flush=True)
"""


# some 1.3 % of the changes hit bytes between the blocks of a file, where they are of no consequence
@pytest.mark.parametrize(("count", "share"), [(30, 0.9), pytest.param(250, 0.97, marks=pytest.mark.long)])
def test_no_damage_is_believed(tmp_path, count, share):
    count *= int(os.environ.get("CHEMAGE_FUZZ", "1"))
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", SCRIPT, str(count), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120 + 2 * count,
        check=False,
    )
    assert done.returncode == 0, (done.stdout[-200:], done.stderr[-2000:])
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("caught")]
    assert len(rows) == 9
    assert min(int(caught) / int(changed) for _, caught, _, changed in rows) > share


# -- edits and damaged sweeps, in this process ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    with warnings.catch_warnings(action="ignore"):
        return damages.written(tmp_path_factory.mktemp("files"))


@pytest.mark.parametrize("step", [23, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["run", "surface", "inference"])
def test_no_edit_in_place_is_believed(files, tmp_path, kind, step):
    """Each attribute and dataset, root and derived values included: HDF5 drops the seal, and the marks stay."""
    path, read = files[kind]
    whole, copy = path.read_bytes(), tmp_path / "edited.h5"
    believed = []
    for what, edit in list(damages.edits(path))[::-step]:
        copy.write_bytes(whole)
        damages.edited(copy, edit)
        try:
            read(copy)
        except StoreError:
            continue
        believed.append(what)
    assert believed == []


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("swept") / "out"
    with warnings.catch_warnings(action="ignore"):
        chemage.sweep(damages.SWEEP, folder)
    return folder, damages.points_of(folder)


@pytest.mark.parametrize("count", [4, pytest.param(60, marks=pytest.mark.campaign)])
def test_a_damaged_sweep_is_counted_and_made_again_or_refused(swept, tmp_path, count):
    whole, expected = swept
    rng = np.random.default_rng(4)
    for number in range(count):
        folder = tmp_path / str(number)
        shutil.copytree(whole, folder)
        with warnings.catch_warnings(action="ignore"):
            assert damages.after_damage(rng, folder, expected) in ("refused", "repaired", "identical")


@pytest.mark.parametrize(("place", "source"), [("contacts", ""), ("points", ""), ("points", "sweep.json")])
def test_the_file_of_another_point_is_not_believed(swept, tmp_path, place, source):
    whole, expected = swept
    shutil.copytree(whole, tmp_path / "out")
    one, other, *_ = sorted(path for path in (tmp_path / "out" / place).rglob("*") if path.is_file())
    shutil.copy(whole / source if source else other, one)
    state = chemage.load_sweep(tmp_path / "out").status()
    assert (state["damaged"], state["contacts_damaged"]) == ((1, 0) if place == "points" else (0, 1))
    with pytest.warns(UserWarning, match=rf"1 files are damaged and are computed again: {place}/"):
        chemage.sweep(damages.SWEEP, tmp_path / "out")
    assert damages.points_of(tmp_path / "out") == expected


def test_every_command_has_the_same_count_of_what_is_damaged(swept, tmp_path, command, monkeypatch):
    shutil.copytree(swept[0], tmp_path / "out")
    monkeypatch.chdir(tmp_path)
    result = chemage.load_sweep("out")
    for point in (0, 2):
        path = result.store.point(result.keys[point])
        path.write_bytes(path.read_bytes().replace(b"done", b"dome"))
    path = result.store.contact(result.contact_key(3))
    path.write_bytes(path.read_bytes()[:-100])
    assert "2 of 4 points done, 2 contacts (1 damaged), 2 damaged" in command("show", "out").out
    rows = [line.split() for line in command("status", "out").out.splitlines()]
    assert ["all", "4", "2", "0", "0", "2"] in rows
    assert ["contacts", "2", "1", "1"] in rows
    collected = command("sweep", "--collect", "out")
    assert collected.status == 1
    assert "2 of 4 points are damaged in out; no tables were written\ndamaged: points 0,2" in collected.err
    path.write_bytes((swept[0] / path.relative_to("out")).read_bytes())
    with warnings.catch_warnings(action="default"):
        assert "out: 2 of 4 points are complete and compared (2 damaged)" in command("compare", "out").err
