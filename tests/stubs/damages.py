"""Damage of every kind to what chemage writes: single files, edits with h5py, folders of sweeps; and what must not be
read or written although a path names it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import chemage as ca
from chemage.plugin import container

SCENE: dict[str, Any] = {
    "name": "small",
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 24, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
    "forming": {"kind": "gaussian", "mean": 0.9, "std": 0.1},
    "engine": {"kind": "bkl"},
    "hold": {"start": "1 ms", "stop": "1e4 s", "replicas": 3},
}
SWEEP = {**SCENE, "sweep": {"contact.load": [10, 20], "hold.seed": [0, 1]}}


def spoiled(rng: np.random.Generator, content: bytes) -> bytes:
    """The content of a file after one of eight kinds of damage."""
    text, where = bytearray(content), int(rng.integers(max(1, len(content))))
    match int(rng.integers(8)):
        case 0 | 1:
            text[where] ^= 1 << int(rng.integers(8))
        case 2:
            del text[where:]
        case 3:
            text[where : where + 64] = bytes(len(text[where : where + 64]))
        case 4:
            text[where:where] = rng.bytes(int(rng.integers(1, 9)))
        case 5:
            del text[where : where + int(rng.integers(1, 9))]
        case 6:
            text += rng.bytes(int(rng.integers(1, 99)))
        case 7:
            other = int(rng.integers(len(content)))
            text[where : where + 16], text[other : other + 16] = text[other : other + 16], text[where : where + 16]
    return bytes(text)


# -- edits with h5py --------------------------------------------------------------------------------------------------

Edit = Callable[[h5py.File], None]


def _other(value: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(value, str):
        return value.replace("1", "2") if "1" in value else value + "1"
    if isinstance(value, bytes):
        return value + b"1"
    value = np.array(value)
    if value.dtype.kind == "b":
        return ~value
    if value.dtype.kind not in "iuf":
        return None
    return value + np.ones((), value.dtype)


def _set_attribute(place: str, name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        value = _other(file[place].attrs[name])
        if value is None:
            del file[place].attrs[name]
        else:
            file[place].attrs[name] = value

    return edit


def _delete_attribute(place: str, name: str) -> Edit:
    return lambda file: file[place].attrs.__delitem__(name)


def _set_values(place: str) -> Edit:
    def edit(file: h5py.File) -> None:
        values = np.array(file[place][()])
        if values.size:
            values.flat[0] = values.flat[0] + 1
            file[place][...] = values
        else:
            del file[place]

    return edit


def edits(path: Path) -> Iterator[tuple[str, Edit]]:
    """Every attribute and dataset of a file, changed and deleted; and groups, links and the scene beside them."""
    with h5py.File(path) as file:
        places = ["/"]
        file.visit(places.append)
        for place in places:
            for name in file[place].attrs:
                yield f"{place}@{name} changed", _set_attribute(place, name)
                yield f"{place}@{name} deleted", _delete_attribute(place, name)
            if place == "/":
                continue
            yield f"{place} deleted", lambda file, place=place: file.__delitem__(place)
            if isinstance(file[place], h5py.Dataset) and file[place].dtype.kind in "iuf":
                yield f"{place} changed", _set_values(place)
        marks = [name for name in file.attrs if name.startswith("chemage")]
    yield "a group", lambda file: file.create_group("mine")
    yield "an attribute", lambda file: file.attrs.__setitem__("mine", 1)
    yield "an old layout", lambda file: file.attrs.__setitem__("chemage_format", 1)

    def unmarked(file: h5py.File) -> None:
        for name in marks:
            del file.attrs[name]

    yield "no marks", unmarked


def edited(path: Path, edit: Edit) -> None:
    """Edit a file in place, as any program can."""
    with h5py.File(path, "r+") as file:
        edit(file)


def sealed_again(path: Path) -> None:
    """Give a file a seal that fits, as a stranger could who knows how it is written."""
    import io

    content = path.read_bytes()
    end = content.rfind(b'\n[["')
    path.write_bytes(container.seal(io.BytesIO(content[:end] if end > 0 else content)))


# -- one file of each kind ------------------------------------------------------------------------------------------


def read_whole(path: Path) -> Any:
    """What a result file says, to compare."""
    result = ca.read(path)
    if isinstance(result, ca.Run):
        return {name: part.digest() for name, part in result.parts().items()}, result.attributes(), result.summary()
    return type(result).__name__, result.digest()


def written(folder: Path) -> dict[str, tuple[Path, Callable[[Path], Any]]]:
    """One file of each kind -> (path, what reads it)."""
    from made_inference import made_inference

    run = ca.run(SCENE, warn=False)
    rng = np.random.default_rng(0)
    results = {
        "run": run,
        "contact": run.contact,
        "aging": run.aging,
        "surface": ca.Surface(heights=rng.normal(size=(9, 7)), pixel_size=0.5),
        "inference": made_inference(members=8),
    }
    files: dict[str, tuple[Path, Callable[[Path], Any]]] = {}
    for name, result in results.items():
        files[name] = folder / f"{name}.h5", read_whole
        ca.write(files[name][0], result)
    table = container.Arrays(values={"numbers": rng.normal(size=50), "zeros": np.zeros(99)})
    container.write(folder / "table.npz", {"table": table}, {"setting": "x"}, compact=True)
    files["table in a cache"] = folder / "table.npz", lambda path: container.read(path, {"table": container.Arrays})
    (folder / "map.json").write_bytes(container.sealed_json({"trade_map": 1, "values": rng.normal(size=20).tolist()}))
    files["text"] = folder / "map.json", container.read_json
    return files


# -- folders of sweeps ------------------------------------------------------------------------------------------------


def points_of(folder: Path) -> str:
    """What a sweep found out, without what depends on the clock, and its contacts byte by byte."""
    result = ca.load_sweep(folder)
    points = [result.store.read_point(key) for key in result.keys]
    for point in points:
        point.get("summary", {}).pop("timings", None)
    contacts = [result[index].contact().digest() for index in range(len(result))]
    return json.dumps([points, contacts], sort_keys=True)


def damage_sweep(rng: np.random.Generator, folder: Path) -> tuple[Path, str]:
    """Damage, remove or replace one file of a sweep: the file, and how."""
    files = sorted(
        path for path in folder.rglob("*") if path.is_file() and path.suffix in (".json", ".npz", ".csv", ".h5")
    )
    path = files[int(rng.integers(len(files)))]
    how = int(rng.integers(12))
    content = path.read_bytes()
    if how < 7:
        while (other := spoiled(rng, content)) == content:
            pass
        path.write_bytes(other)
        return path, "spoiled"
    path.unlink()
    match how:
        case 7:
            return path, "removed"
        case 8:
            os.mkfifo(path)
            return path, "a pipe"
        case 9:
            elsewhere = folder.parent / "elsewhere"
            elsewhere.write_bytes(content)
            path.symlink_to(elsewhere)
            return path, "a link"
        case 10:
            path.symlink_to("/dev/zero")
            return path, "a link to a device"
        case _:
            same = [other for other in files if other.suffix == path.suffix and other != path]
            shutil.copy(same[int(rng.integers(len(same)))], path) if same else path.write_bytes(b"")
            return path, "another file"


def after_damage(rng: np.random.Generator, folder: Path, expected: str) -> str:
    """Damage a sweep and run it again: ``refused``, ``identical`` or ``repaired`` if all went well, else what went
    wrong; :func:`points_of` says what is ``expected``."""
    path, how = damage_sweep(rng, folder)
    what = f"{path.relative_to(folder)} {how}"
    try:
        before = ca.load_sweep(folder).status()
        spoilt = before["points"] - before["done"] + before["contacts"] - before["contacts_done"]
        if not spoilt and points_of(folder) != expected:
            return f"{what}: believed"
        if spoilt != (path.parent.name == "contacts" or path.parents[1].name == "points"):
            return f"{what}: {spoilt} files are counted as damaged or missing"
        ca.sweep(SWEEP, folder)
        after = ca.load_sweep(folder).status()
    except ca.ChemageError as error:
        return "refused" if folder.name in str(error) else f"{what}: {error}"
    if points_of(folder) != expected:
        return f"{what}: other results"
    left = after["points"] - after["done"] + after["contacts"] - after["contacts_done"]
    return f"{what}: not repaired" if left else "repaired" if spoilt else "identical"
