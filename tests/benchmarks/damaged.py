"""Damage files and folders of results, and put pipes, devices and links where paths stand; count what is believed.

    python tests/benchmarks/damaged.py files|edits|sweeps|kernels|places [COUNT] [SEED]

``files``: random damage of single files of each kind, inferences and means over surfaces included. ``edits``: every
attribute and dataset edited in place with h5py. ``sweeps``: one file of a sweep damaged, removed or replaced, then the
same sweep is run again. ``kernels``: compiled kernels that numba keeps. ``places``: the command line with an odd file
in each place where a path can stand. Everything must be refused with one error, made again, or the same.
"""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import chemage as ca

sys.path.insert(0, str(Path(__file__).parents[1] / "stubs"))
import damages

#: s after which a command hangs
PATIENCE = 300


def files(count: int, rng: np.random.Generator, folder: Path) -> Iterator[str]:
    """Random damage of single files."""
    kinds = damages.written(folder)
    mean = ca.ensemble({**damages.SCENE, "accuracy": {"beta": "60 %"}})
    kinds["mean"] = folder / "mean.h5", damages.read_whole
    ca.write(kinds["mean"][0], mean)
    wholes = {name: (path.read_bytes(), read(path)) for name, (path, read) in kinds.items()}
    for name in itertools.islice(itertools.cycle(kinds), count):
        path, read = kinds[name]
        content, expected = wholes[name]
        path.write_bytes(damages.spoiled(rng, content))
        yield damages.outcome(lambda read=read, path=path: read(path), expected, name)


def edits(count: int, rng: np.random.Generator, folder: Path) -> Iterator[str]:
    """Edits in place with h5py."""
    kinds = damages.written(folder)
    several = [(name, *edit) for name in damages.HDF5 for edit in damages.edits(kinds[name][0])]
    wholes = {name: (kinds[name][0].read_bytes(), kinds[name][1](kinds[name][0])) for name in damages.HDF5}
    for number in rng.permutation(len(several))[:count]:
        name, what, edit = several[number]
        path, read = kinds[name]
        path.write_bytes(wholes[name][0])
        damages.edited(path, edit)
        # an edit that is not noticed is believed, even where what is read is the same
        yield damages.outcome(lambda read=read, path=path: read(path), None, f"{name}: {what}")


def sweeps(count: int, rng: np.random.Generator, folder: Path) -> Iterator[str]:
    """Damage of one file of a sweep."""
    ca.sweep(damages.SWEEP, folder / "whole")
    expected = damages.points_of(folder / "whole")
    for _ in range(count):
        shutil.copytree(folder / "whole", folder / "damaged")
        yield damages.after_damage(rng, folder / "damaged", expected)
        shutil.rmtree(folder / "damaged")


KERNEL = """
import chemage as ca, damages, json
run = ca.run(damages.SCENE, warn=False)
print(json.dumps([part.digest() for part in run.parts().values()]))
"""


def kernels(count: int, rng: np.random.Generator, folder: Path) -> Iterator[str]:
    """Damage of compiled kernels: each kind of file of numba, one after the other."""
    cache = folder / "kernels"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join([*sys.path[:1], environment.get("PYTHONPATH", "")])

    def computed() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", KERNEL]
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=300, check=False, cwd=folder
        )

    expected = computed().stdout
    assert expected, "the kernels cannot be compiled"
    whole = {path: path.read_bytes() for path in sorted(cache.rglob("*.nb?"))}
    for path in itertools.islice(itertools.cycle(rng.permutation(list(whole))), count):
        for other, content in whole.items():
            other.write_bytes(content)
        path.write_bytes(damages.spoiled(rng, whole[path]))
        done = computed()
        if done.stdout == expected and not done.returncode:
            yield "identical"
        else:
            yield f"{path.name}: exit {done.returncode} {done.stderr.strip().splitlines()[-1:]} {done.stdout[:40]}"


def places(count: int, rng: np.random.Generator, folder: Path) -> Iterator[str]:
    """The command line with an odd file in each place, a full disk or a clock that is set back; random scenes."""
    cases = list(damages.places(folder))
    environment = {**os.environ, "CHEMAGE_CACHE": str(folder / "cache"), "MPLCONFIGDIR": str(folder / "cache")}
    (folder / "cache").mkdir()
    (folder / "cache").chmod(0o777)
    for number in itertools.islice(itertools.cycle(rng.permutation(len(cases))), count):
        damages.write_scenes(folder, damages.random_scene(rng))
        yield damages.placed(*cases[number], env=environment, timeout=PATIENCE)


def main() -> None:
    """Make one campaign, and print how its cases ended; exit status 1 if one of them did not end well."""
    campaign = {"files": files, "edits": edits, "sweeps": sweeps, "kernels": kernels, "places": places}[sys.argv[1]]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    rng = np.random.default_rng(int(sys.argv[3]) if len(sys.argv) > 3 else 0)
    begin, ends = time.process_time(), Counter[str]()
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings(action="ignore"):
        for end in campaign(count, rng, Path(name)):
            ends[end] += 1
            if end not in damages.GOOD:
                print(end, flush=True)
    print(f"{sum(ends.values())} cases: {dict(ends)}, {time.process_time() - begin:.0f} s of CPU time")
    sys.exit(not set(ends) <= set(damages.GOOD))


if __name__ == "__main__":
    main()
