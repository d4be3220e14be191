"""``chemage plugins new``: the folder of a plugin that works from the first minute, with tests of its promises."""

from __future__ import annotations

import keyword
import re
from pathlib import Path

from chemage.errors import InputError, StoreError
from chemage.spec import ROLES, nearest

_PROJECT = """[build-system]
requires = ["setuptools>=64"]
build-backend = "setuptools.build_meta"

[project]
name = "{distribution}"
version = "0.1.0"
description = "{kind}: a {role} for chemage"
dependencies = ["chemage"]

[project.optional-dependencies]
test = ["chemage[test]"]

[project.entry-points.chemage]
{package} = "{package}"

[tool.setuptools]
packages = ["{package}"]
"""

_INIT = '''"""{kind}: a {role} for chemage."""

from chemage import hookimpl


@hookimpl
def chemage_register():
    """What this plugin offers; strings, so that the module is imported only when it is used."""
    return {{"{role}": {{"{kind}": "{package}.{module}:{cls}"}}}}
'''

_TEST = '''"""The promises of the role, checked by chemage's own kit; add what only this choice promises."""

from chemage.testing import parametrize_with_checks
from {package}.{module} import {cls}


@parametrize_with_checks([{cls}()])
def test_keeps_the_promises_of_its_role(choice, check):
    check(choice)
'''

_READER_TEST = '''"""A file written by hand, and one that is not of the format."""

import numpy as np
import pytest

from chemage.errors import StoreError
from {package}.{module} import {cls}


def test_a_table_becomes_a_surface(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 1\\n0 0.5 2\\n0.5 0 3\\n0.5 0.5 4\\n")
    surface = {cls}().read(tmp_path / "a.xyz")
    np.testing.assert_array_equal(surface.heights, [[1, 2], [3, 4]])
    assert surface.pixel_size == 0.5


def test_another_format_is_refused(tmp_path):
    (tmp_path / "b.xyz").write_text("no numbers here\\n")
    with pytest.raises(StoreError, match="not a table"):
        {cls}().read(tmp_path / "b.xyz")
'''

_README = """# {distribution}

A {role} for chemage, of kind `{kind}`.

    pip install -e '.[test]'
    chemage plugins show {kind}
    python -m pytest
"""

_BODIES = {
    "surface": '''"""A wavy surface."""

import numpy as np
from pydantic import Field

from chemage.objects import Surface
from chemage.spec import SurfaceMaker
from chemage.units import Length


class {cls}(SurfaceMaker):
    """One cosine along x."""

    kind = "{kind}"

    amplitude: Length = 1.0
    """half the height from valley to crest, nm"""
    pixels: int = Field(default=64, ge=1, le=100_000)
    """along each side; one wavelength"""
    pixel_size: Length = 0.5
    """edge of a pixel, nm"""

    def make(self, seed=0):
        x = 2 * np.pi * np.arange(self.pixels) / self.pixels
        heights = np.repeat(self.amplitude * np.cos(x)[:, None], self.pixels, axis=1)
        return Surface(
            heights=heights, pixel_size=self.pixel_size, periodic=True, provenance={{"maker": self.todict()}}
        )
''',
    "contact": '''"""A bed of independent springs."""

import numpy as np
from pydantic import Field

from chemage.objects import ContactSolution
from chemage.spec import ContactSolver
from chemage.units import Pressure


class {cls}(ContactSolver):
    """Winkler's foundation: each pixel pushes back in proportion to its own overlap, p = E* (h − d) / thickness."""

    kind = "{kind}"
    implemented_properties = ("pressure", "displacement")

    modulus: Pressure = 35.3
    """contact modulus E*, GPa"""
    aspect: float = Field(default=0.1, gt=0, le=1e6)
    """thickness of the bed over the longer side of the surface"""

    def _solve(self, surface, load, start):
        thickness = self.aspect * max(surface.shape) * surface.pixel_size
        heights = np.sort(surface.heights, axis=None)[::-1].astype(np.float64)
        overlap = load * thickness / (self.modulus * surface.pixel_size**2)  # sum of h − d over the contact, nm
        # with the m highest pixels in contact d = (sum of them − overlap) / m; the right m is where d lies between
        below = np.cumsum(heights[0] - heights) - np.arange(1, heights.size + 1) * (heights[0] - heights)
        touching = max(int(np.searchsorted(-below, overlap, side="left")), 1)
        level = heights[:touching].mean() - overlap / touching
        pressure = np.maximum(surface.heights.astype(np.float64) - level, 0.0)
        total = pressure.sum()
        pressure *= load / surface.pixel_size**2 / total if total > 0 else 0.0
        return ContactSolution(
            pressure=pressure, load=load, pixel_size=surface.pixel_size, modulus=self.modulus,
            periodic=surface.periodic, rms_slope=surface.rms_slope, rms_height=surface.rms_height,
            displacement=float(heights[0] - level),
            provenance={{"solver": self.todict(), "surface": surface.provenance}},
        )
''',
    "barriers": '''"""Exponentially distributed barriers."""

from typing import Annotated

import numpy as np

from chemage.spec import Barriers
from chemage.units import Energy, Unit


class {cls}(Barriers):
    """Barriers above a threshold, exponentially rarer the higher they are."""

    kind = "{kind}"

    threshold: Energy = 0.8
    """the lowest barrier, eV"""
    scale: Annotated[float, Unit("eV", gt=0)] = 0.1
    """mean height above the threshold, eV"""

    def quantile(self, uniform):
        return self.threshold - self.scale * np.log1p(-np.asarray(uniform))

    def density(self, energy):
        above = (np.asarray(energy, dtype=np.float64) - self.threshold) / self.scale
        return np.where(above >= 0, np.exp(-np.maximum(above, 0.0)) / self.scale, 0.0)
''',
    "interaction": '''"""Four nearest neighbours, all pairs alike."""

import numpy as np

from chemage.spec import Interaction
from chemage.units import Energy


class {cls}(Interaction):
    """A bonded neighbour across a pixel's edge adds the same energy everywhere."""

    kind = "{kind}"

    strength: Energy = 0.2
    """what each bonded neighbour adds to the forming barrier, eV"""

    def neighbours(self, pixels, periodic, sites):
        nx, ny = pixels
        x, y = np.divmod(sites, ny)
        found = np.full((sites.size, 4), -1, dtype=np.int32)
        for slot, (dx, dy) in enumerate([(-1, 0), (0, -1), (0, 1), (1, 0)]):
            i, j = x + dx, y + dy
            inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
            flat = (i % nx) * ny + j % ny
            at = np.searchsorted(sites, flat).clip(max=max(sites.size - 1, 0))
            there = (sites[at] == flat) if sites.size else np.zeros(0, dtype=bool)
            there &= (flat != sites) & (inside | periodic)
            # on a grid one or two pixels wide the same neighbour lies on both sides; it counts once
            there &= ~(found == at[:, None]).any(axis=1)
            found[there, slot] = at[there]
        return found

    def coupling(self, sites, neighbours, seed):
        return np.where(neighbours >= 0, self.strength, 0.0)
''',
    "engine": '''"""Gillespie's direct method, as short as it can be: exact, and slow on many sites."""

import numpy as np
from ase.units import kB
from numba import njit

from chemage.objects import BondHistory
from chemage.spec import Engine


@njit
def _advance(rng, forming, breaking, neighbours, coupling, nu, beta, stops, bonded, time, counts):
    n = forming.size
    rates = np.zeros(n)
    due = -1.0  # when the pending event happens; drawn once, kept across hold times
    total = 0.0
    for at in range(stops.size):
        while n > 0:
            if due < 0.0:
                total = 0.0
                for i in range(n):
                    barrier = breaking[i] if bonded[i] else forming[i]
                    if not bonded[i]:
                        for slot in range(neighbours.shape[1]):
                            if neighbours[i, slot] >= 0 and bonded[neighbours[i, slot]]:
                                barrier += coupling[i, slot]
                    rates[i] = nu * np.exp(-max(barrier, 0.0) * beta)
                    total += rates[i]
                due = time + rng.standard_exponential() / total if total > 0.0 else np.inf
            if due > stops[at]:
                break
            time, due = due, -1.0
            left, site = rng.random() * total, n - 1
            for i in range(n):
                if rates[i] > 0.0:
                    site = i  # the last that can happen, should rounding leave a remainder
                    left -= rates[i]
                    if left < 0.0:
                        break
            bonded[site] = not bonded[site]
            counts[at, 1 if bonded[site] else 2] += 1
        counts[at, 0] = np.sum(bonded)


class {cls}(Engine):
    """Draws the next event from all rates, summed anew each time. Gillespie, J. Comput. Phys. 22, 403 (1976)."""

    kind = "{kind}"
    #: the pending event is not kept beyond a run, so going on is exact in distribution but not bit for bit
    restart = False

    def _run(self, lattice, hold_times, temperature, seed, start):
        n = lattice.sites.size
        bonded, time, before = np.zeros(n, dtype=bool), 0.0, np.zeros(2, dtype=np.int64)
        if isinstance(start, BondHistory):
            bonded, time = np.array(start.state), start.time
            before[:] = start.formed[-1], start.broken[-1]
        elif start is not None:
            bonded = np.array(start)
        counts = np.zeros((hold_times.size, 3), dtype=np.int64)
        none = lattice.neighbours is None
        _advance(
            np.random.default_rng(seed), lattice.forming,
            np.full(n, np.inf) if lattice.breaking is None else lattice.breaking,
            np.zeros((n, 0), dtype=np.int32) if none else lattice.neighbours,
            np.zeros((n, 0)) if none else lattice.coupling.astype(np.float64),
            lattice.attempt_frequency, 1 / (kB * temperature), hold_times, bonded, time, counts,
        )
        formed, broken = before[0] + np.cumsum(counts[:, 1]), before[1] + np.cumsum(counts[:, 2])
        return BondHistory(
            hold_times=hold_times, bonds=counts[:, 0], formed=formed, broken=broken, state=bonded,
            time=float(hold_times[-1]), temperature=temperature, engine=self.kind, lattice_hash=lattice.digest(),
        )
''',
    "observable": '''"""Bonds in large patches."""

import numpy as np
from pydantic import Field

from chemage.measures import label_patches
from chemage.spec import Observable


class {cls}(Observable):
    """Share of the bonds that lie in patches of at least ``pixels`` pixels."""

    kind = "{kind}"

    pixels: int = Field(default=100, ge=1)
    """what counts as a large patch"""

    def measure(self, contact, lattice, history):
        labels = label_patches(contact.contact, contact.periodic)[0].ravel()
        large = np.bincount(labels)[labels[lattice.sites]] >= self.pixels
        bonds = np.count_nonzero(history.state)
        return {{"bonds_in_large_patches": np.count_nonzero(history.state & large) / bonds if bonds else 0.0}}
''',
    "reader": '''"""Heights as a table of x, y, z."""

from pathlib import Path

import numpy as np

from chemage.errors import StoreError
from chemage.objects import Surface
from chemage.spec import Reader


class {cls}(Reader):
    """Three columns x, y, z in nm on a regular grid, y fastest."""

    kind = "{kind}"
    suffixes = (".xyz",)

    def read(self, path):
        try:
            x, y, z = np.loadtxt(Path(path), unpack=True, ndmin=2)
        except (OSError, ValueError) as error:
            raise StoreError(f"{{path}} is not a table of x, y, z: {{error}}") from error
        ny = np.unique(y).size
        if z.size % ny or np.any(np.diff(x[:ny])):
            raise StoreError(f"{{path}}: the points do not fill a grid with y fastest")
        step = float(y[1] - y[0]) if ny > 1 else 1.0
        return Surface(heights=z.reshape(-1, ny), pixel_size=step, periodic=False, provenance={{"file": str(path)}})
''',
}


def new(name: str, role: str, folder: Path) -> list[Path]:
    """Write a plugin of kind ``name`` for ``role`` into ``folder``/chemage-``name``; the files written.

    Raises
    ------
    InputError
        ``name`` is no name for a kind, or there is no such role.
    StoreError
        The folder is there already, or cannot be made.
    """
    if role not in _BODIES:
        raise InputError(f"no role {role!r}{nearest(role, list(ROLES))}; the roles are {', '.join(ROLES)}")
    module = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) or keyword.iskeyword(module):
        raise InputError.of(
            "name", name, "is no name for a kind", "use lower-case words joined by -, such as my-barriers"
        )
    package = f"chemage_{module}"
    words = {
        "kind": name,
        "role": role,
        "module": module,
        "package": package,
        "distribution": f"chemage-{name}",
        "cls": "".join(part.capitalize() for part in name.split("-")),
    }
    contents = {
        Path("pyproject.toml"): _PROJECT,
        Path("README.md"): _README,
        Path(package, "__init__.py"): _INIT,
        Path(package, f"{module}.py"): _BODIES[role],
        Path("tests", f"test_{module}.py"): _READER_TEST if role == "reader" else _TEST,
    }
    target = folder / f"chemage-{name}"
    try:
        target.mkdir()
        for path, template in contents.items():
            (target / path).parent.mkdir(parents=True, exist_ok=True)
            (target / path).write_text(template.format(**words), encoding="utf-8")
    except FileExistsError:
        raise StoreError(f"{target} is already there; choose another name or folder") from None
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror}") from error
    return [target / path for path in contents]
