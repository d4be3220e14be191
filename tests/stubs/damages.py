"""Damage of every kind to what chemage writes: single files, edits with h5py, folders of sweeps; and what must not be
read or written although a path names it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
        "ageing": run.ageing,
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
        if points_of(folder) != expected:
            return f"{what}: other results"
    except ca.ChemageError as error:  # also where a contact was removed, of which all points are done
        return "refused" if folder.name in str(error) else f"{what}: {error}"
    left = after["points"] - after["done"] + after["contacts"] - after["contacts_done"]
    return f"{what}: not repaired" if left else "repaired" if spoilt else "identical"


# -- campaigns --------------------------------------------------------------------------------------------------------

#: how a case may end
GOOD = ("refused", "repaired", "identical")
#: the kinds of :func:`written` in the layout of NetCDF-4
HDF5 = ("run", "contact", "ageing", "surface", "inference")


def outcome(read: Callable[[], Any], expected: Any, what: str) -> str:
    """What reading a damaged file came to; ``expected`` is what it says undamaged."""
    try:
        value = read()
    except ca.ChemageError:
        return "refused"
    except Exception as error:
        return f"{what}: {type(error).__name__}: {error}"
    return "identical" if value == expected else f"{what}: believed"


# -- odd files where paths stand ------------------------------------------------------------------------------------

#: what begins the command of a user who cannot write in a read-only folder; the superuser can
BOUND = ["setpriv", "--bounding-set=-dac_override"] if os.getuid() == 0 else []
#: what begins a command that sees a full disk in the folder ``full``; only the superuser can mount one
FULL = [
    "unshare",
    "--mount",
    "sh",
    "-c",
    'mount -t tmpfs -o size=4k t full; head -c 4096 /dev/zero > full/a; exec "$@"',
    "-",
]
#: a library before that of the system, by which the clock is set back by a year while a command runs
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>
int clock_gettime(clockid_t which, struct timespec *now) {
    static int asked;
    int (*real)(clockid_t, struct timespec *) = dlsym(RTLD_NEXT, "clock_gettime");
    int status = real(which, now);
    if (which == CLOCK_REALTIME && ++asked > 20) now->tv_sec -= 365 * 86400;
    return status;
}
"""
ODD = ("pipe", "device", "folder", "loop", "null")


@contextmanager
def odd_file(path: Path, kind: str) -> Iterator[None]:
    """An odd file, or none, at ``path`` in the block; a link leads to a file, or a folder, that nothing may change."""
    victim = path.with_name("victim")
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "null":
            path.symlink_to("/dev/null")
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path)
        case "link":
            victim.write_text("mine")
            path.symlink_to(victim)
        case "link to a folder":
            victim.mkdir()
            path.symlink_to(victim)
        case "read-only":
            path.parent.chmod(0o555)
    try:
        yield
        if kind.startswith("link") and (victim.read_text() if victim.is_file() else [*victim.iterdir()]) not in (
            "mine",
            [],
        ):
            raise AssertionError(f"{path} was written through")
    finally:
        path.parent.chmod(0o777)
        for left in (path, victim):
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left)
            else:
                left.unlink(missing_ok=True)


def _toml(scene: dict[str, Any], **more: Any) -> str:
    """A scene as TOML; ``more`` are fields by section."""
    lines = [f'name = "{scene["name"]}"']
    for section in {**scene, **more}:
        fields = scene.get(section, {})
        if section != "name":
            lines += [f"[{section}]"]
            lines += [f"{name} = {json.dumps(value)}" for name, value in {**fields, **more.get(section, {})}.items()]
    return "\n".join(lines)


def random_scene(rng: np.random.Generator) -> dict[str, Any]:
    """A small scene like ``SCENE`` with other numbers and another engine."""
    radius, load = rng.uniform(10, 40), rng.uniform(5, 40)
    forming = {"kind": "gaussian", "mean": rng.uniform(0.8, 1.0), "std": rng.uniform(0.05, 0.15)}
    return {
        **SCENE,
        "surface": {**SCENE["surface"], "radius": f"{radius} nm"},
        "contact": {**SCENE["contact"], "load": f"{load} nN"},
        "forming": forming,
        "engine": {"kind": str(rng.choice(["bkl", "rejection-free"]))},
        "hold": {**SCENE["hold"], "replicas": int(rng.integers(1, 6)), "seed": int(rng.integers(2**31))},
    }


def write_scenes(folder: Path, scene: dict[str, Any]) -> dict[str, str]:
    """Write scenes of every kind that names a file: name -> TOML."""
    run, mean = _toml(scene), _toml(scene, accuracy={"beta": "60 %"})
    scenes = {
        "run": run,
        "mean": mean,
        "sweep": run + '\n[sweep]\n"hold.seed" = [0, 1]',
        "map": _toml(scene, accuracy={"beta": "60 %"}, ensemble={"map": "odd.json"}),
        "table": _toml({**scene, "forming": {"kind": "tabulated", "path": "odd.csv"}}),
        "inferred": _toml({**scene, "forming": {"kind": "inferred", "path": "odd.h5"}}),
    }
    for ending in ("npy", "txt", "h5", "x3p"):
        surface = {"kind": "from-file", "path": f"odd.{ending}", "pixel_size": "1 nm"}
        scenes[f"surface-{ending}"] = _toml({**scene, "surface": surface})
    for name, text in scenes.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return scenes


def places(folder: Path) -> Iterator[tuple[str, list[str], Path, str]]:
    """Commands with an odd file where a path stands: (what, words, path, kind of file)."""
    (folder / "clock.c").write_text(CLOCK, encoding="utf-8")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "clock.so", "clock.c", "-ldl"], cwd=folder, check=True)
    folder.chmod(0o777)
    scenes = write_scenes(folder, SCENE)
    ca.write(folder / "done.h5", ca.run(SCENE, warn=False))
    ca.sweep(SWEEP, folder / "swept")
    (folder / "measured.csv").write_text("hold_time (s),friction_drop (nN)\n1,1\n10,2\n100,3\n")
    reading = [(name, [word, f"{name}.toml"], "odd.csv" if name == "table" else "") for word in ("check", "run")
               for name in scenes if name not in ("run", "mean", "sweep")]  # fmt: skip
    files = {"map": "odd.json", "inferred": "odd.h5", **{name: f"odd.{name[8:]}" for name in scenes if "-" in name}}
    reading = [(f"{words[0]} {name}", words, file or files[name]) for name, words, file in reading]
    reading += [(word, [word, "odd.h5"], "odd.h5") for word in ("show", "plot", "report", "compare", "cite")]
    reading += [
        ("scene", ["run", "odd.toml"], "odd.toml"),
        ("map shown", ["show", "odd.json"], "odd.json"),
        ("option map", ["check", "mean.toml", "--map", "odd.json"], "odd.json"),
        ("measured", ["infer", "odd.csv", "--scene", "run.toml"], "odd.csv"),
        ("planned", ["infer", "measured.csv", "--scene", "run.toml", "--next", "odd.csv"], "odd.csv"),
        ("scene of infer", ["infer", "measured.csv", "--scene", "odd.toml"], "odd.toml"),
        ("report measured", ["report", "done.h5", "--measured", "odd.csv"], "odd.csv"),
    ]
    for what, words, file in reading:
        for kind in ODD:
            yield f"{what}: {kind}", words, folder / file, kind
    (folder / "checkpoints").mkdir()
    for kind in (*ODD, "link"):
        yield (
            f"checkpoint: {kind}",
            ["run", "run.toml", "--checkpoints", "checkpoints"],
            folder / "checkpoints/contact.h5",
            kind,
        )
    writing = [
        ("run", ["run", "run.toml", "-o", "odd.h5", "--force"], "odd.h5"),
        ("sweep", ["run", "sweep.toml", "-o", "odd"], "odd"),
        ("report", ["report", "done.h5", "-o", "odd.html", "--force"], "odd.html"),
        ("figures", ["run", "run.toml", "-o", "new.h5"], "new-figures"),
        ("samples", ["run", "mean.toml", "-o", "new.h5"], "new-samples"),
        ("checkpoints", ["run", "run.toml", "-o", "new.h5", "--checkpoints", "odd"], "odd"),
        ("init", ["init", "odd.toml"], "odd.toml"),
        ("log", ["check", "run.toml", "--log", "odd.log"], "odd.log"),
        ("compared figures", ["compare", "done.h5", "--figures", "odd"], "odd"),
    ]
    for what, words, file in writing:
        folders = file in ("odd", "new-figures", "new-samples")
        link = [] if what == "sweep" else ["link to a folder"] if folders else ["link", "folder"]  # it may be elsewhere
        for kind in ("pipe", "device", "read-only", *link):
            yield f"write {what}: {kind}", words, folder / file, kind
        yield f"write {what}: clock", words, folder / file, "clock"
        if os.getuid() == 0:
            inside = [f"full/{word}" if word.startswith(("odd", "new")) else word for word in words]
            yield f"write {what}: full disk", inside, folder / "full", "folder"


def placed(what: str, words: list[str], path: Path, kind: str, **options: Any) -> str:
    """What a command comes to with an odd file in its way: ``refused`` by one error and exit status 2, or, where a link
    is in place of a file to write, ``identical`` if the link is replaced and what it leads to stays."""
    folder = next(place for place in path.parents if (place / "run.toml").exists())
    before = set(folder.iterdir())
    with odd_file(path, kind):
        command = [*(BOUND if kind == "read-only" else []), sys.executable, "-m", "chemage", *words]
        if what.endswith("full disk"):
            command = [*FULL, *command]
        if kind == "clock":
            options["env"] = {**options["env"], "LD_PRELOAD": str(folder / "clock.so")}
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **options)
        except subprocess.TimeoutExpired:
            return f"{what}: hangs"
    for left in set(folder.iterdir()) - before:
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    errors = [line for line in done.stderr.splitlines() if line.startswith("chemage: ") and "warning" not in line]
    if "Traceback" in done.stderr or len(errors) != (done.returncode == 2):
        return f"{what}: exit {done.returncode}, {done.stderr[-300:]}"
    if done.returncode == 2:
        return "refused"
    return (
        "identical"
        if not done.returncode and kind.startswith(("link", "device", "clock"))
        else f"{what}: exit {done.returncode}"
    )
