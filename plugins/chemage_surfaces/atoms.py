"""The surface of atoms: the height map on which a probe sphere rests, and the reactive sites among the uppermost atoms.

ASE reads the file; lengths of ASE are in Å.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
)

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from chemage import InputError, Surface
from chemage.plugin import (
    SITE_POSITIONS,
    FilePath,
    FileStamp,
    Length,
    Output,
    Scatter,
    Seed,
    StoreError,
    SurfaceMaker,
    Unit,
    file_hash,
    file_stamp,
    memory,
)
from chemage_surfaces._maps import provenance

if TYPE_CHECKING:
    import ase

#: nm
ANGSTROM = 0.1
#: an H so near to an O is bonded to it, Å
OH = 1.2
#: pixels are made smaller by up to this factor to fit a periodic cell, and stretched along y by this part at most
FINER, STRETCH, GOOD = 1.5, 0.01, 1e-3
#: sine of the angle by which an axis of the cell may lie off x or y
OFF = 1e-6
_LARSEN = """@article{larsen2017,
  author = {Hjorth Larsen, A. and others},
  title = {The atomic simulation environment: a {Python} library for working with atoms},
  journal = {Journal of Physics: Condensed Matter},
  volume = {29},
  pages = {273002},
  year = {2017},
  doi = {10.1088/1361-648X/aa680e},
}"""


class Structure(NamedTuple):
    """What is used of an ``ase.Atoms``: plain values that can be stored."""

    numbers: tuple[int, ...]
    #: Å
    positions: tuple[tuple[float, float, float], ...]
    #: Å
    cell: tuple[tuple[float, float, float], ...]
    pbc: tuple[bool, bool, bool]


def _structure(atoms: Any) -> Any:
    if not hasattr(atoms, "get_atomic_numbers"):
        return atoms
    return Structure(
        tuple(atoms.numbers.tolist()),
        tuple(map(tuple, atoms.positions.tolist())),
        tuple(map(tuple, atoms.cell.array.tolist())),
        tuple(atoms.pbc.tolist()),
    )


class Atoms(SurfaceMaker):
    """Atoms, z upwards: where the lowest point of a probe sphere is that rests on spheres around them.

    The axes a and b of the cell lie along x and y. Where both are periodic the surface is; its pixels are at most as
    large as ``resolution``, so that they fit the cell. The highest point is at height 0. The atoms that the probe
    touches are the uppermost ones; the positions of those among them that are ``sites`` are recorded, for
    ``site_density = "given"`` in ``[chemistry]``. The seed is ignored.
    """

    kind = "atoms"
    cite = ("A. Hjorth Larsen et al., J. Phys.: Condens. Matter 29, 273002 (2017)",)
    bibtex = (_LARSEN,)
    outputs: ClassVar[Mapping[str, Output]] = {
        SITE_POSITIONS: Output(("surface_site", "xy"), "nm", "sites of the surface")
    }

    file: FilePath | None = None
    """path of a file that ASE reads; None: ``atoms`` are given"""
    format: str | None = None
    """format of the file, as ASE names it; default: by its ending or content"""
    index: int = -1
    """which of several structures in the file; default: the last one"""
    atoms: Annotated[Structure, BeforeValidator(_structure)] | None = None
    """an ``ase.Atoms`` in place of a file"""
    resolution: Length
    """largest edge of a pixel, nm; that of a surface that is not periodic"""
    probe_radius: Annotated[Any, Unit("nm", ge=0)] = 0.14
    """radius of the probe sphere, nm; default: 0.14 nm, of a water molecule"""
    radii: Literal["vdw", "covalent"] = "vdw"
    """radii of the atoms, as ASE has them: of van der Waals or covalent; default: vdw"""
    sites: str = Field(default="hydroxyl", min_length=1)
    """which uppermost atoms are sites: ``hydroxyl``, every O with just one H, or the symbol of an element; default:
    hydroxyl"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        from ase.data import atomic_numbers

        if (self.file is None) == (self.atoms is None):
            raise ValueError("file, atoms: give one of them")
        if self.sites != "hydroxyl" and self.sites not in atomic_numbers:
            raise ValueError(
                f"sites = {self.sites!r}: is no element; give its symbol, or 'hydroxyl'"
            )
        return self

    def make(self, seed: Seed = 0) -> Surface:
        """The surface, made once as long as the file does not change. ``seed`` is ignored.

        Raises
        ------
        StoreError
            ASE cannot read the file.
        InputError
            The cell is not right-angled along x and y, only one of its axes is periodic, the probe falls between the
            atoms, or the radius of an element is not known.
        """
        return _made(self, None if self.file is None else file_stamp(self.file))  # pyright: ignore[reportArgumentType]

    def content(self) -> dict[str, str]:
        """A hash of the content of the file, so that an edited file is another surface."""
        if self.file is None:
            return {}
        return {"file_blake2b": file_hash(self.file, file_stamp(self.file))}

    def expected(self) -> dict[str, float]:
        """Grid, rms slope and number of sites."""
        surface = self.make()
        return {
            "nx": surface.shape[0],
            "ny": surface.shape[1],
            "pixel_size": surface.pixel_size,
            "rms_slope": surface.rms_slope,
            "periodic": float(surface.periodic),
            "sites": len(surface.observables[SITE_POSITIONS]),
        }

    def scatter(self, contact: Mapping[str, float]) -> Scatter:
        """None: the seed is ignored."""
        return Scatter(0.0)

    def read(self) -> ase.Atoms:
        """The atoms, as ASE has them."""
        import ase
        from ase.io import read

        if self.atoms is not None:
            return ase.Atoms(**self.atoms._asdict())
        path: Any = self.file
        try:
            found: Any = read(path, index=self.index, format=self.format)
        except Exception as error:  # each format has its own
            raise StoreError(
                f"{self.file}: ASE cannot read it ({type(error).__name__}: {error}); check format and index"
            ) from error
        return found


@lru_cache(maxsize=2)
def _made(maker: Atoms, stamp: FileStamp | None) -> Surface:
    atoms = maker.read()
    sides, periodic = _sides(atoms)
    shape, size = _grid(sides, maker.resolution, periodic)
    scale = np.array([1.0, shape[1] * size / sides[1] if periodic else 1.0])
    memory.require(
        3 * 16.0 * shape[0] * shape[1],
        f"resolution = {maker.resolution:g} nm",
        "use larger pixels",
    )
    places = ANGSTROM * atoms.positions
    if periodic:
        places[:, :2] %= sides
    reach = _radii(atoms, maker.radii) + maker.probe_radius
    heights, owner = _rolled(places, reach, shape, size / scale, sides, periodic)
    if (bare := np.count_nonzero(owner < 0)) > 0:
        raise InputError(
            f"surface 'atoms': at {bare} of {owner.size} pixels the probe touches no atom; use a larger probe_radius, or "
            "a cell that the atoms fill"
        )
    uppermost = np.isin(np.arange(len(atoms)), owner)
    chosen = list(_sites(atoms, maker.sites, uppermost))
    file = {} if stamp is None else maker.content()
    return Surface(
        heights=heights - heights.max(),
        pixel_size=size,
        periodic=periodic,
        provenance={
            **provenance(maker),
            **file,
            "atoms": len(atoms),
            "stretched_along_y": float(scale[1]),
        },
        observables={SITE_POSITIONS: places[chosen, :2] * scale},
        outputs={name: output.todict() for name, output in maker.outputs.items()},
    )


def _sides(atoms: ase.Atoms) -> tuple[np.ndarray, bool]:
    """Sides of the cell along x and y, nm, and whether it repeats."""
    cell = ANGSTROM * np.asarray(atoms.cell.array, dtype=np.float64)
    sides = np.diagonal(cell)[:2].copy()
    if not (sides > 0).all():
        raise InputError(
            "surface 'atoms': the cell has no side along x or y; set one, such as with atoms.center(vacuum=5, axis=2)"
        )
    off = np.abs(cell[:2] - np.diag([*sides, 0.0])[:2]).max(axis=1)
    if (off > OFF * sides).any():
        raise InputError(
            "surface 'atoms': the axes a and b of the cell must lie along x and y; build a right-angled cell, such as "
            "with orthogonal=True or ase.build.make_supercell, and turn it with atoms.rotate(..., rotate_cell=True)"
        )
    repeats = atoms.pbc[:2]
    if repeats[0] != repeats[1]:
        raise InputError(
            f"surface 'atoms': pbc = {atoms.pbc.tolist()}; make both a and b periodic, or none"
        )
    return sides, bool(repeats[0])


def _grid(
    sides: np.ndarray, largest: float, periodic: bool
) -> tuple[tuple[int, int], float]:
    """Pixels along x and y, and their edge, nm."""
    if not periodic:
        nx, ny = np.maximum(np.rint(sides / largest), 1).astype(int).tolist()
        return (nx, ny), largest
    first = math.ceil(sides[0] / largest * (1 - 1e-9))
    best = math.inf, 0, 0
    for nx in range(first, math.ceil(FINER * first) + 1):
        ny = max(round(float(sides[1]) * nx / float(sides[0])), 1)
        misfit = abs(ny / nx * float(sides[0] / sides[1]) - 1)
        best = min(best, (misfit, nx, ny))
        if misfit < GOOD:
            break
    misfit, nx, ny = best
    if misfit > STRETCH:
        raise InputError.of(
            "resolution",
            largest,
            f"square pixels do not fit the cell of {sides[0]:.4g} x {sides[1]:.4g} nm",
            "use smaller ones, or repeat the cell",
        )
    return (nx, ny), float(sides[0]) / nx


def _radii(atoms: ase.Atoms, kind: str) -> np.ndarray:
    """(n,) nm."""
    from ase.data import covalent_radii, vdw_radii

    table = covalent_radii if kind == "covalent" else vdw_radii
    radii = ANGSTROM * table[atoms.numbers]
    symbols = np.array(atoms.get_chemical_symbols())
    if unknown := np.unique(symbols[np.isnan(radii)]).tolist():
        raise InputError(
            f"surface 'atoms': ASE has no {kind} radius of {', '.join(unknown)}; set radii to the other table"
        )
    return radii


def _rolled(
    places: np.ndarray,
    reach: np.ndarray,
    shape: tuple[int, int],
    steps: np.ndarray,
    sides: np.ndarray,
    periodic: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Height (nx, ny) of the centre of the probe, whose distance from an atom that it touches is its ``reach``, and the
    atom that it touches there, -1: none."""
    heights = np.full(shape, -np.inf)
    owner = np.full(shape, -1)
    shifts = [np.zeros(2)]
    if periodic:
        times = np.ceil(reach.max() / sides).astype(int)
        ranges = [np.arange(-count, count + 1) for count in times]
        shifts = [sides * (i, j) for i in ranges[0] for j in ranges[1]]
    for shift in shifts:
        for atom, (place, radius) in enumerate(zip(places, reach, strict=True)):
            middle = place[:2] + shift
            begin = np.maximum(np.ceil((middle - radius) / steps - 0.5), 0).astype(
                int
            )
            end = np.minimum(
                np.floor((middle + radius) / steps + 0.5), shape
            ).astype(int)
            if (begin >= end).any():
                continue
            x, y = (
                (np.arange(first, last) + 0.5) * step - centre
                for first, last, step, centre in zip(
                    begin, end, steps, middle, strict=True
                )
            )
            square = radius**2 - x[:, None] ** 2 - y**2
            height = place[2] + np.sqrt(np.maximum(square, 0.0))
            part = slice(begin[0], end[0]), slice(begin[1], end[1])
            higher = (square >= 0) & (height > heights[part])
            heights[part][higher] = height[higher]
            owner[part][higher] = atom
    return heights, owner


def _sites(atoms: ase.Atoms, which: str, uppermost: np.ndarray) -> Iterator[int]:
    """The atoms that are sites: of hydroxyls the O, where the probe touches it or its H."""
    if which != "hydroxyl":
        symbols = np.array(atoms.get_chemical_symbols())
        yield from np.flatnonzero((symbols == which) & uppermost).tolist()
        return
    from ase.neighborlist import neighbor_list

    oxygen, hydrogen = neighbor_list("ij", atoms, {("O", "H"): OH})
    for atom in np.flatnonzero(atoms.numbers == 8).tolist():
        bonded = hydrogen[(oxygen == atom)]
        if bonded.size == 1 and uppermost[[atom, *bonded]].any():
            yield atom
