"""The golden record: what users see of twenty scenes, as numbers with tolerances and as the text of first screens.

    python tests/golden/golden.py [NAME...]            # regenerate the record, and print what changed in it
    python tests/golden/golden.py --digests TREE TREE  # bytes of surfaces, pressures and bonds in two checkouts

The second form runs the scenes with the sources of each checkout on this machine. These bytes are not stored: the last
bits belong to a processor.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RECORD = HERE / "record"

TIP = "silica-tip --set hold.replicas=12"
PATCH = "--set surface.pixels=128 --set surface.zeta=8 --set hold.replicas=4"
BEM = "--set contact.kind=adhesive-bem --set 'contact.work_of_adhesion=10 mJ/m**2' --set 'contact.range=2 nm'"
PULLED = (
    "--set rupture.kind=pulled --set 'rupture.speed=100 nm/s' --set 'rupture.distance=1 nm' "
    "--set 'rupture.bond_stiffness=10 nN/nm' --set 'rupture.transition_distance=0.03 nm'"
)
BELL = "--set rupture.kind=bell --set 'rupture.transition_distance=0.03 nm' --set 'rupture.loading_rate=1 uN/s'"
DMT = "--set contact.kind=dmt --set 'contact.work_of_adhesion=0.1 J/m**2'"
HARD = "--set contact.kind=fft-bem --set 'contact.hardness=2 GPa'"
#: scenes of one run each, which are checked, run and shown: name -> scene with its options
RUNS = {
    "tip": TIP,
    "afm-tip": "silica-afm-tip --set hold.replicas=12",
    "linear-tip": "silica-linear-tip --set hold.replicas=12",
    "humid-tip": "silica-humid-tip --set hold.replicas=12",
    "history": "silica-history --set hold.replicas=4",
    "pulled-tip": f"{TIP} {PULLED}",
    "bell-tip": f"{TIP} {BELL}",
    "bkl-tip": f"{TIP} --set engine.kind=bkl",
    "adhesive-tip": f"{TIP} {DMT}",
    "hard-tip": f"{TIP} {HARD}",
    "rough": f"silica-rough {PATCH} --set 'contact.load=52.5 nN'",
    "patch": f"silica-patch {PATCH} --set 'contact.load=52 nN'",
    "adhesion": f"silica-patch {PATCH} --set 'contact.load=52 nN' {BEM} --set contact.coarse=note",
    "challenge": "contact-challenge --set surface.pixels=256 --set surface.zeta=32",
    "image-tip": "image-tip.toml",
}
#: name -> commands, of which what they print is recorded; later ones read files of earlier ones
CASES = {
    **{
        name: [
            f"check {scene} --json",
            f"run {scene} --no-figures -o {name}.h5 --json",
            f"show {name}.h5",
            f"show {name}.h5 --csv",
        ]
        for name, scene in RUNS.items()
    },
    "mean": [
        f"run silica-patch {PATCH} --set 'contact.load=52 nN' --surfaces 4 --no-figures -o mean.h5 --json",
        "show mean.h5",
        "show mean.h5 --csv",
    ],
    "sweep": ["sweep tips.toml -o tips --json", "show tips", "show tips --csv"],
    "compare": [
        f"run {TIP} --no-figures -q -o tip.h5",
        f"run {RUNS['rough']} --no-figures -q -o rough.h5",
        "compare tip.h5 rough.h5",
        "compare tip.h5 rough.h5 --json",
    ],
    "infer": ["infer tip.csv --scene known-tip.toml --no-figures -o inferred.h5 --json", "show inferred.h5"],
    "rate-state": ["rate-state trace.csv --json", "rate-state trace.csv"],
}
FILES = ["tests/golden/image-tip.toml", "tests/golden/tips.toml", "tests/golden/known-tip.toml"]
FILES += ["tests/golden/trace.csv", "tests/data/topographies/afm.txt", "docs/data/tip.csv"]

#: names of numbers that depend on the machine or on the version of the sources
IGNORED = re.compile(r"(^|\.)(seconds|cpu_seconds|memory|machine_speed|file|keys|versions|timings|path|wall.*)(\.|$)")
#: names of numbers of a contact, which are as exact as the solver's iteration
CONTACT = re.compile(r"area|kappa|pressure|perimeter|residual|slope|height|approach|error|share")


def printed(command: str) -> str:
    """What ``chemage COMMAND`` prints, run in this process and folder; a failure is an error."""
    from chemage.cli import app

    out, err = io.StringIO(), io.StringIO()
    arguments, leave = sys.argv, os._exit
    sys.argv = ["chemage", *shlex.split(command)]
    os._exit = sys.exit  # type: ignore[assignment]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            app.main()
    except SystemExit as stop:
        if stop.code:
            raise RuntimeError(f"chemage {command}: {err.getvalue()}") from None
    finally:
        sys.argv, os._exit = arguments, leave
    return out.getvalue()


@contextlib.contextmanager
def folder() -> Iterator[None]:
    """A fresh working folder with the files that the commands read."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as fresh:
        for file in FILES:
            shutil.copy(ROOT / file, fresh)
        os.chdir(fresh)
        try:
            yield
        finally:
            os.chdir(here)


def leaves(data: Any, name: str = "") -> dict[str, Any]:
    """Dotted name -> number or text of nested JSON."""
    if isinstance(data, dict | list) and data:
        pairs = data.items() if isinstance(data, dict) else enumerate(data)
        return {k: v for key, value in pairs for k, v in leaves(value, f"{name}.{key}".lstrip(".")).items()}
    return {} if IGNORED.search(name) else {name: data}


def outputs(name: str) -> dict[str, Any]:
    """Command -> what it prints: leaves of JSON, columns of CSV, or lines of text without those of times and files."""
    found: dict[str, Any] = {}
    for command in CASES[name]:
        text = printed(command)
        if "--json" in command:
            found[command] = leaves(json.loads(text))
        elif "--csv" in command:
            head, *rows = csv.reader(io.StringIO(text))
            columns = dict(zip(head, zip(*rows, strict=True), strict=True))
            found[command] = leaves({key: [_number(cell) for cell in cells] for key, cells in columns.items()})
        elif text:
            found[command] = [line.rstrip() for line in text.splitlines() if "wall time" not in line]
    return found


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs by more than the tolerance of its kind, a line each."""
    found = []
    for command in old | new:
        one, other = old.get(command), new.get(command)
        if isinstance(one, dict) and isinstance(other, dict):
            for key in one | other:
                if key not in one or key not in other:
                    found.append(f"{command}: {key}: {'new' if key not in one else 'gone'}")
                elif not agree(key, one, other):
                    found.append(f"{command}: {key}: {one[key]!r} -> {other[key]!r}")
        elif one != other:
            found += [f"{command}: - {line}" for line in one or [] if line not in (other or [])]
            found += [f"{command}: + {line}" for line in other or [] if line not in (one or [])]
    return found


def agree(key: str, old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Whether two numbers agree: integers and text exactly, contacts within 1e-6, the rest within 1e-9."""
    one, other = old[key], new[key]
    if not isinstance(one, float) or not isinstance(other, int | float):
        return one == other
    within = 1e-6 if CONTACT.search(key) else 1e-9
    return math.isclose(one, other, rel_tol=within, abs_tol=1e-12) or (math.isnan(one) and math.isnan(other))


def main(names: list[str]) -> None:
    """Regenerate the record of these cases, or of all, and print what changed."""
    RECORD.mkdir(exist_ok=True)
    for name in names or CASES:
        file = RECORD / f"{name}.json"
        old = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        with folder():
            new = json.loads(json.dumps(outputs(name)))
        for line in differences(old, new) if old else [f"{name}: new"]:
            print(f"{name}: {line}")
        file.write_text(json.dumps(new, ensure_ascii=False, indent=0) + "\n", encoding="utf-8")


DIGESTS = """
import hashlib, json, sys
import numpy as np
import chemage as ca

def digest(array):
    return "-" if array is None else hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:16]

for line in sys.stdin:
    name, scene, changes = json.loads(line)
    run = ca.run(ca.load_scene(scene, changes), warn=False, threads=1)
    ageing = getattr(run, "ageing", None) or getattr(run, "aging", None)
    parts = [run.surface and run.surface.heights, getattr(run.contact, "pressure", None), ageing and ageing.bonds]
    print(json.dumps([name, ca.__file__, *map(digest, parts)]), flush=True)
"""


def digests(tree: Path) -> dict[str, list[str]]:
    """Name of each scene -> digests of surface, pressure and bonds, with the sources of ``tree``."""
    lines = []
    for name, options in RUNS.items():
        scene, *words = shlex.split(options)
        pairs = (word.split("=", 1) for word in words if word != "--set")
        lines.append(json.dumps([name, scene, {path: _value(text) for path, text in pairs}]))
    with tempfile.TemporaryDirectory() as place:
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", place, str(tree)]
        subprocess.run(pip, check=True)
        with folder():
            done = subprocess.run(
                [sys.executable, "-c", DIGESTS],
                input="\n".join(lines),
                env=os.environ | {"PYTHONPATH": place},
                check=True,
                capture_output=True,
                text=True,
            )
    found = {}
    for line in done.stdout.splitlines():
        name, source, *parts = json.loads(line)
        if not source.startswith(place):
            raise RuntimeError(f"{source} is not of {tree}")
        found[name] = parts
    return found


def _value(text: str) -> Any:
    """A value of ``--set``: TOML where it is, else text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def compare(one: Path, other: Path) -> int:
    """Print which bytes differ between two checkouts; the number of scenes of which some do."""
    old, new = digests(one), digests(other)
    differ = 0
    for name in old:
        parts = zip(("surface", "pressure", "bonds"), old[name], new[name], strict=True)
        changed = [part for part, a, b in parts if a != b]
        print(f"{name}: {', '.join(changed) + ' differ' if changed else 'same bytes'}")
        differ += bool(changed)
    return differ


if __name__ == "__main__":
    if sys.argv[1:2] == ["--digests"]:
        sys.exit(compare(*map(Path, sys.argv[2:4])))
    main(sys.argv[1:])
