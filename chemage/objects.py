"""The objects that pass from stage to stage: Surface → ContactSolution → ReactionLattice → BondHistory → Aging.

Validated once, frozen, arrays C-contiguous and read-only, equal when their content is. ``todict``/``fromdict`` as in
ASE. Each array declares its dimensions and unit in ``arrays``; the store and the docs are made from that.
"""

from __future__ import annotations

import hashlib
import json
import math
import threading
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from chemage import measures
from chemage.errors import InputError
from chemage.spec import explain
from chemage.units import EV_PER_GPA_NM3

if TYPE_CHECKING:
    from ase import Atoms

    from chemage.spec import Interaction


def frozen(array: Any, *dtypes: type[np.generic]) -> np.ndarray:
    """``array`` C-contiguous and read-only, of the first of ``dtypes`` unless it already has one of them.

    An array that is read-only already is taken as it is, without a copy: a maker that hands over its own fresh array
    calls ``array.setflags(write=False)`` first and saves the copy.
    """
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise ValueError(f"{np.ma.count_masked(array)} values are masked; fill or crop missing data first")
    given = np.asarray(array)
    if dtypes and given.dtype not in [np.dtype(kind) for kind in dtypes]:
        if given.dtype.kind not in "fiub":
            raise ValueError(f"expected numbers, not {given.dtype}")
        target = np.dtype(dtypes[0])
        if target.kind in "iu" and given.dtype.kind == "f" and given.size:
            raise ValueError(f"expected whole numbers, not {given.dtype}")
        if target.kind == "i" and given.dtype.kind in "iu" and given.size:
            limits = np.iinfo(target.name)
            if int(given.min()) < limits.min or int(given.max()) > limits.max:
                raise ValueError(f"values from {given.min()} to {given.max()} do not fit {target}")
        given = given.astype(target)
        given.setflags(write=False)
    if given.flags.writeable or not given.flags.c_contiguous:
        given = np.array(given, order="C", copy=True)
        given.setflags(write=False)
    return given


def _array(*dtypes: type[np.generic]) -> BeforeValidator:
    return BeforeValidator(lambda value: frozen(value, *dtypes))


Reals = Annotated[np.ndarray, _array(np.float64, np.float32)]
Doubles = Annotated[np.ndarray, _array(np.float64)]
Indices = Annotated[np.ndarray, _array(np.int64)]
Shorts = Annotated[np.ndarray, _array(np.int32)]
Flags = Annotated[np.ndarray, _array(np.bool_)]
Named = Annotated[dict[str, np.ndarray], AfterValidator(lambda value: {n: frozen(a) for n, a in value.items()})]


class Record(BaseModel):
    """Base of the frozen objects."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        arbitrary_types_allowed=True,
        use_attribute_docstrings=True,
        allow_inf_nan=True,
    )
    #: field name -> (dimension names, unit, meaning)
    arrays: ClassVar[dict[str, tuple[tuple[str, ...], str, str]]] = {}

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            lines = [f"{path}: {message}" if path else message for path, message in explain(error)]
            raise InputError(f"{type(self).__name__}: " + "; ".join(lines)) from None

    def todict(self) -> dict[str, Any]:
        """Field name -> value; arrays stay arrays."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    @classmethod
    def fromdict(cls, fields: Mapping[str, Any]) -> Self:
        """The inverse of :meth:`todict`."""
        return cls(**fields)

    @cached_property
    def _digest(self) -> str:
        digest = hashlib.blake2b(type(self).__name__.encode(), digest_size=16)

        def feed(value: Any) -> None:
            if isinstance(value, np.ndarray):
                digest.update(f"{value.dtype.str}{value.shape}".encode())
                digest.update(np.ascontiguousarray(value).data)
            elif isinstance(value, Mapping):
                digest.update(b"{")
                for name in sorted(value):
                    digest.update(json.dumps(name).encode() + b":")
                    feed(value[name])
                digest.update(b"}")
            else:
                digest.update(json.dumps(value, default=str, sort_keys=True).encode())

        feed(self.todict())
        return digest.hexdigest()

    def digest(self) -> str:
        """Content hash over every field, arrays included."""
        return self._digest

    def __reduce__(self) -> tuple[Any, ...]:
        # built anew, so that the arrays of the copy are read-only as well (pickle drops that flag)
        return _rebuilt, (type(self), self.todict())

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some fields changed, validated again (pydantic's own would keep the digest of the original)."""
        return type(self).fromdict({**self.todict(), **(update or {})})

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        return self

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.digest() == self.digest()  # pyright: ignore[reportAttributeAccessIssue]

    def __hash__(self) -> int:
        return hash(self.digest())

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.digest()[:8]}>"

    __str__ = __repr__


def _rebuilt(cls: type[Record], fields: dict[str, Any]) -> Record:
    return cls(**fields)


def _require_finite(name: str, values: np.ndarray, remedy: str) -> None:
    bad = int(values.size - np.count_nonzero(np.isfinite(values)))
    if bad:
        raise ValueError(f"{name}: {bad} of {values.size} values are not finite; {remedy}")


class Surface(Record):
    """A rough (or spherical) body, given by its heights on a pixel grid."""

    arrays = {"heights": (("x", "y"), "nm", "height, higher = nearer to the counter-body")}

    heights: Reals
    """(nx, ny) nm, higher = nearer to the counter-body; float64, or float32 as given"""
    pixel_size: float = Field(gt=0, allow_inf_nan=False)
    """edge of a pixel, nm"""
    periodic: bool = True
    """whether the grid repeats"""
    provenance: dict[str, Any] = {}
    """how it was made: plain JSON values"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.heights.ndim != 2 or self.heights.size == 0:
            raise ValueError(f"heights: shape {self.heights.shape}; give a two-dimensional, non-empty array (nx, ny)")
        _require_finite("heights", self.heights, "fill or crop missing data first")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny) pixels."""
        nx, ny = self.heights.shape
        return nx, ny

    @property
    def nominal_area(self) -> float:
        """A0, nm²."""
        return self.heights.size * self.pixel_size**2

    @cached_property
    def rms_height(self) -> float:
        """Root mean square height about the mean, nm."""
        return measures.rms_height(self.heights)

    @cached_property
    def rms_slope(self) -> float:
        """Root mean square slope h'_rms: spectral where periodic, central differences otherwise."""
        return measures.rms_slope(self.heights, self.pixel_size, self.periodic)

    def psd(self, bins: int = 60) -> tuple[np.ndarray, np.ndarray]:
        """Radially averaged power spectral density, mean square height = ∫C d²q/(2π)²: q (1/nm) and C(q) (nm⁴).

        See :func:`chemage.measures.psd`; a surface that is not periodic is tapered with a Hann window.
        """
        return measures.psd(self.heights, self.pixel_size, self.periodic, bins)

    def __repr__(self) -> str:
        nx, ny = self.shape
        return f"<Surface {nx}x{ny} pixels of {self.pixel_size:g} nm, rms height {self.rms_height:.4g} nm>"

    __str__ = __repr__


class ContactSolution(Record):
    """The pressure between a surface and an elastic half-space under a load."""

    arrays = {
        "pressure": (("x", "y"), "GPa", "contact pressure"),
        "gap": (("x", "y"), "nm", "gap between the surfaces, 0 in contact"),
    }

    pressure: Reals
    """(nx, ny) GPa, ≥ 0; contact is where it is positive"""
    load: float = Field(ge=0, allow_inf_nan=False)
    """normal force, nN"""
    pixel_size: float = Field(gt=0, allow_inf_nan=False)
    """edge of a pixel, nm"""
    modulus: float = Field(gt=0, allow_inf_nan=False)
    """contact modulus E*, GPa"""
    periodic: bool = True
    """whether the grid repeats"""
    rms_slope: float = math.nan
    """of the surface"""
    rms_height: float = math.nan
    """of the surface, nm"""
    gap: Reals | None = None
    """(nx, ny) nm ≥ 0, where the solver gives it"""
    displacement: float | None = None
    """rigid approach of the bodies, nm, where the solver gives it"""
    converged: bool = True
    """whether the tolerance was reached"""
    residual: float = 0.0
    """the solver's convergence measure at the end; 0 for a closed form"""
    iterations: int = Field(default=0, ge=0)
    convergence: dict[str, Any] = {}
    """what the solver says of its error: plain JSON values"""
    notes: tuple[str, ...] = ()
    """what the user should know of this solution, in words"""
    provenance: dict[str, Any] = {}
    _graphs: dict[Interaction, np.ndarray] = PrivateAttr(default_factory=dict)
    _graphs_lock: threading.Lock = PrivateAttr(default_factory=threading.Lock)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pressure.ndim != 2 or self.pressure.size == 0:
            raise ValueError(f"pressure: shape {self.pressure.shape}; give a two-dimensional, non-empty array (nx, ny)")
        if self.gap is not None and self.gap.shape != self.pressure.shape:
            raise ValueError(f"gap: shape {self.gap.shape}, but pressure has {self.pressure.shape}")
        _require_finite("pressure", self.pressure, "the solver that made it is at fault")
        lowest = float(self.pressure.min())
        if lowest < 0:
            raise ValueError(f"pressure: its smallest value is {lowest:g} GPa; a hard wall only pushes, it must be ≥ 0")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(nx, ny) pixels."""
        nx, ny = self.pressure.shape
        return nx, ny

    @cached_property
    def contact(self) -> np.ndarray:
        """(nx, ny) bool: pixels in contact."""
        return frozen(self.pressure > 0)

    @cached_property
    def sites(self) -> np.ndarray:
        """(n,) int64: flat indices of the pixels in contact, ascending."""
        return frozen(np.flatnonzero(self.contact), np.int64)

    @property
    def nominal_area(self) -> float:
        """A0, nm²."""
        return self.pressure.size * self.pixel_size**2

    @property
    def nominal_pressure(self) -> float:
        """F_N / A0, GPa."""
        return self.load / self.nominal_area

    @property
    def area(self) -> float:
        """Contact area A, nm²: pixels with positive pressure."""
        return self.sites.size * self.pixel_size**2

    @property
    def area_fraction(self) -> float:
        """A / A0."""
        return self.sites.size / self.pressure.size

    @property
    def corrected_area(self) -> float:
        """A less the pixels' excess at the rim (Yastrebov et al. 2017), nm²."""
        return measures.corrected_area(self.area, self.perimeter, self.pixel_size)

    @cached_property
    def _patches(self) -> measures.Patches:
        return measures.patches(self.contact, self.periodic)

    @property
    def patches(self) -> int:
        """Number of connected (8 neighbours) contact patches."""
        return self._patches.count

    @property
    def patch_sizes(self) -> np.ndarray:
        """Pixels in each patch, largest first, (patches,) int64."""
        return self._patches.sizes

    @cached_property
    def perimeter(self) -> float:
        """C, nm: total length of pixel edges between contact and non-contact."""
        return measures.perimeter(self.contact, self.pixel_size, self.periodic)

    @property
    def perimeter_to_area(self) -> float:
        """C / A, 1/nm; nan without contact."""
        return self.perimeter / self.area if self.area > 0 else math.nan

    @property
    def mean_contact_pressure(self) -> float:
        """Mean pressure over the contact F_N / A, GPa; nan without contact."""
        return self.load / self.area if self.area > 0 else math.nan

    @property
    def kappa(self) -> float:
        """κ = A h'_rms E* / F_N; nan without load."""
        return measures.kappa(self.area, self.rms_slope, self.modulus, self.load)

    def pressure_histogram(self, bins: int = 50, upper: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Distribution of the pressure over the contact: bin edges (bins + 1,) GPa and density (bins,) 1/GPa."""
        values = self.pressure[self.contact]
        top = upper if upper is not None else (float(values.max()) if values.size else 1.0)
        counts, edges = np.histogram(values, bins=bins, range=(0.0, top))
        return edges, counts / (max(values.size, 1) * np.diff(edges))

    def graph(self, interaction: Interaction) -> np.ndarray:
        """Which pixels in contact are neighbours, as ``interaction`` sees it: (n, k) int32, made once and shared."""
        with self._graphs_lock:
            known = self._graphs.get(interaction)
            if known is None:
                known = frozen(interaction.neighbours(self.shape, self.periodic, self.sites), np.int32)
                self._graphs[interaction] = known
            return known

    def summary(self) -> dict[str, float]:
        """The measures users compare, as plain numbers."""
        return {
            "area_fraction": self.area_fraction,
            "area": self.area,
            "corrected_area": self.corrected_area,
            "kappa": self.kappa,
            "patches": self.patches,
            "perimeter_to_area": self.perimeter_to_area,
            "mean_contact_pressure": self.mean_contact_pressure,
            "max_pressure": float(self.pressure.max()),
            "nominal_area": self.nominal_area,
            "nominal_pressure": self.nominal_pressure,
            "load": self.load,
            "modulus": self.modulus,
            "rms_slope": self.rms_slope,
            "rms_height": self.rms_height,
        }

    def __repr__(self) -> str:
        return f"<ContactSolution {self.load:g} nN, area fraction {self.area_fraction:.4g}, {self.patches} patches>"

    __str__ = __repr__


class ReactionLattice(Record):
    """A graph of the sites that can react, and nothing else.

    A site forms a bond at the rate ν exp(−E/k_B T) with E = ``forming`` + Σ ``coupling`` over its bonded neighbours,
    and breaks it with E = ``breaking``; a barrier at or below zero means the rate ν. Can be built from plain arrays.
    """

    arrays = {
        "sites": (("sites",), "", "flat pixel index"),
        "forming": (("sites",), "eV", "barrier to forming a bond with no neighbour bonded"),
        "breaking": (("sites",), "eV", "barrier to breaking the bond"),
        "neighbours": (("sites", "slot"), "", "position of the neighbour in the list of sites, -1 = none"),
        "coupling": (("sites", "slot"), "eV", "what a bonded neighbour adds to the forming barrier"),
    }

    pixels: tuple[int, int]
    """(nx, ny) of the grid the sites lie on"""
    sites: Indices
    """(n,) int64 flat pixel index, ascending, no site twice"""
    forming: Doubles
    """(n,) eV"""
    breaking: Doubles | None = None
    """(n,) eV; None: bonds never break"""
    neighbours: Shorts | None = None
    """(n, k) int32, -1 = none; None: nothing interacts"""
    coupling: Reals | None = None
    """(n, k) eV, symmetric"""
    attempt_frequency: float = Field(default=1e13, gt=0, allow_inf_nan=False)
    """ν, Hz"""
    pixel_size: float = Field(default=1.0, gt=0, allow_inf_nan=False)
    """nm, for viewing only"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        n = self.sites.size
        if min(self.pixels) < 1:
            raise ValueError(f"pixels: {self.pixels}; give two positive numbers")
        if self.sites.ndim != 1:
            raise ValueError(f"sites: shape {self.sites.shape}; give a one-dimensional array")
        if n:
            if self.sites[0] < 0 or self.sites[-1] >= self.pixels[0] * self.pixels[1]:
                raise ValueError(f"sites: from {self.sites[0]} to {self.sites[-1]}, outside the grid of {self.pixels}")
            steps = np.diff(self.sites)
            if np.any(steps == 0):
                twice = int(self.sites[1:][steps == 0][0])
                raise ValueError(f"sites: pixel {twice} is listed twice; list each once")
            if np.any(steps < 0):
                raise ValueError("sites: not in ascending order; sort them (and what goes with them)")
        for name in ("forming", "breaking"):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (n,):
                raise ValueError(f"{name}: shape {values.shape}, but there are {n} sites; give one value a site")
            _require_finite(name, values, "give barriers in eV")
        self._check_graph(n)
        return self

    def _check_graph(self, n: int) -> None:
        neighbours, coupling = self.neighbours, self.coupling
        if (neighbours is None) != (coupling is None):
            raise ValueError("neighbours and coupling: give both, or neither")
        if neighbours is None or coupling is None:
            return
        if neighbours.ndim != 2 or neighbours.shape[0] != n or coupling.shape != neighbours.shape:
            raise ValueError(
                f"neighbours {neighbours.shape} and coupling {coupling.shape}: both must be ({n}, k) for {n} sites"
            )
        _require_finite("coupling", coupling, "give energies in eV, 0 where there is no neighbour")
        from chemage.graph import find_fault

        fault, site, slot = find_fault(neighbours, coupling)
        if fault:
            other = int(neighbours[site, slot])
            problem = {
                1: f"neighbours[{site}, {slot}] = {other} is not a site; give 0 to {n - 1}, or -1 for none",
                2: f"neighbours[{site}, {slot}]: site {site} is its own neighbour; remove it",
                3: f"neighbours[{site}]: site {other} is listed twice; list each neighbour once",
                4: f"neighbours: site {site} lists {other}, but not the other way round; list each pair from both ends",
                5: f"coupling[{site}, {slot}]: the pair ({site}, {other}) has two values; "
                "give both ends the same energy (the coupling must be symmetric)",
            }[fault]
            raise ValueError(problem)

    @property
    def interacting(self) -> bool:
        """Whether any two sites are coupled."""
        return self.neighbours is not None

    def to_atoms(self, state: np.ndarray | None = None) -> Atoms:
        """The sites as ASE atoms for viewing: O where bonded, H elsewhere; barriers in ``arrays``. Å as in ASE."""
        from ase import Atoms

        n = self.sites.size
        bonded = np.zeros(n, dtype=bool) if state is None else np.asarray(state, dtype=bool)
        step = 10.0 * self.pixel_size
        x, y = np.divmod(self.sites, self.pixels[1])
        atoms = Atoms(
            numbers=np.where(bonded, 8, 1),
            positions=np.stack([(x + 0.5) * step, (y + 0.5) * step, np.zeros(n)], axis=1),
            cell=[self.pixels[0] * step, self.pixels[1] * step, 10.0],
            pbc=False,
        )
        atoms.new_array("forming", np.array(self.forming))
        if self.breaking is not None:
            atoms.new_array("breaking", np.array(self.breaking))
        return atoms

    def __repr__(self) -> str:
        kind = "interacting" if self.interacting else "independent"
        return f"<ReactionLattice {self.sites.size} {kind} sites on {self.pixels[0]}x{self.pixels[1]} pixels>"

    __str__ = __repr__


class BondHistory(Record):
    """Bonds at each hold time of one run; a run can go on from it."""

    arrays = {
        "hold_times": (("hold_times",), "s", "time since the contact was made"),
        "bonds": (("hold_times",), "", "number of bonds"),
        "formed": (("hold_times",), "", "bonds formed so far"),
        "broken": (("hold_times",), "", "bonds broken so far"),
        "state": (("sites",), "", "whether each site is bonded at the end"),
    }

    hold_times: Doubles
    """(m,) s"""
    bonds: Indices
    """(m,) number of bonds"""
    formed: Indices
    """(m,) bonds formed since the start"""
    broken: Indices
    """(m,) bonds broken since the start"""
    state: Flags
    """(n,) bool at the last hold time"""
    time: float = Field(ge=0, allow_inf_nan=False)
    """the last hold time, s"""
    temperature: float = Field(gt=0, allow_inf_nan=False)
    """K"""
    engine: str
    """kind of the engine"""
    lattice_hash: str = ""
    """content hash of the lattice"""
    notes: tuple[str, ...] = ()
    """what the user should know of this run, in words"""
    resume: Named = {}
    """what the engine needs to go on bit for bit; private to it"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        shape = self.hold_times.shape
        if self.hold_times.ndim != 1 or not (self.bonds.shape == self.formed.shape == self.broken.shape == shape):
            raise ValueError("hold_times, bonds, formed, broken: must be one-dimensional and of equal length")
        return self

    @property
    def events(self) -> int:
        """Bonds formed and broken, together."""
        return int(self.formed[-1] + self.broken[-1])

    def then(self, later: BondHistory) -> BondHistory:
        """This history and ``later``, which went on from it, as one.

        Raises
        ------
        InputError
            ``later`` has another number of sites or begins before this one ends.
        """
        if later.state.size != self.state.size or later.hold_times[0] < self.time:
            raise InputError.of("later", repr(later), "did not go on from this history", "pass what start=... gave")
        joined = {
            name: np.concatenate([getattr(self, name), getattr(later, name)])
            for name in ("hold_times", "bonds", "formed", "broken")
        }
        return BondHistory(**{**later.todict(), **joined})

    def __repr__(self) -> str:
        return f"<BondHistory {self.bonds[-1]} bonds at {self.time:g} s after {self.events} events ({self.engine})>"

    __str__ = __repr__


class Fit(NamedTuple):
    """A straight line of Δμ against log10 t."""

    beta: float
    """dΔμ/dlog10 t, per decade"""
    beta_stderr: float
    cutoff_time: float
    """where the line meets Δμ = 0, s"""
    cutoff_time_stderr: float
    friction_rate: float
    """dΔF/dlog10 t, nN per decade"""
    friction_rate_stderr: float
    points: int
    """hold times in the window"""


class Aging(Record):
    """Bonds of several replicas against hold time, and the static friction rise they make."""

    arrays = {
        "hold_times": (("hold_times",), "s", "time since the contact was made"),
        "bonds": (("replica", "hold_times"), "", "number of bonds"),
        "sites": (("replica",), "", "number of reactive sites"),
        "events": (("replica",), "", "bonds formed and broken"),
    }

    hold_times: Doubles
    """(m,) s"""
    bonds: Indices
    """(replicas, m)"""
    sites: Indices
    """(replicas,)"""
    events: Indices
    """(replicas,)"""
    load: float = Field(ge=0, allow_inf_nan=False)
    """nN"""
    temperature: float = Field(gt=0, allow_inf_nan=False)
    """K"""
    bond_force: float = Field(default=3.0, ge=0, allow_inf_nan=False)
    """⟨f⟩, mean force to rupture a bond, nN"""
    front_factor: float = Field(default=1.0, ge=0, allow_inf_nan=False)
    """fraction of the bonds that load at once as the detachment front passes"""
    engine: str = ""
    notes: tuple[str, ...] = ()
    """what the first replica's run had to say"""
    contact: dict[str, float] = {}
    """the contact's measures, see :meth:`ContactSolution.summary`"""
    observables: Named = {}
    """name -> (replicas, ...)"""
    provenance: dict[str, Any] = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.hold_times.ndim != 1:
            raise ValueError(f"hold_times: shape {self.hold_times.shape}; give a one-dimensional array")
        if self.bonds.ndim != 2 or self.bonds.shape[1] != self.hold_times.size or self.bonds.shape[0] < 1:
            raise ValueError(f"bonds: shape {self.bonds.shape}; give (replicas, {self.hold_times.size})")
        if not self.sites.shape == self.events.shape == self.bonds.shape[:1]:
            raise ValueError(f"sites, events: give one number for each of the {self.bonds.shape[0]} replicas")
        return self

    @property
    def replicas(self) -> int:
        """Number of replicas."""
        return self.bonds.shape[0]

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF = N ⟨f⟩ × front factor, nN, (replicas, m)."""
        return self.bonds * (self.bond_force * self.front_factor)

    @property
    def friction_coefficient_drop(self) -> np.ndarray:
        """Δμ = ΔF / F_N, (replicas, m); nan without load."""
        if self.load == 0:
            return np.full(self.bonds.shape, np.nan)
        return self.friction_drop / self.load

    @property
    def mean_friction_drop(self) -> np.ndarray:
        """ΔF averaged over replicas, nN, (m,)."""
        return self.friction_drop.mean(axis=0)

    @property
    def mean_friction_coefficient_drop(self) -> np.ndarray:
        """Δμ averaged over replicas, (m,)."""
        return self.friction_coefficient_drop.mean(axis=0)

    @property
    def friction_drop_stderr(self) -> np.ndarray:
        """Standard error of the mean ΔF, nN, (m,); nan for a single replica."""
        return _standard_error(self.friction_drop)

    @property
    def friction_coefficient_drop_stderr(self) -> np.ndarray:
        """Standard error of the mean Δμ, (m,); nan for a single replica or without load."""
        return _standard_error(self.friction_coefficient_drop)

    def fit(self, start: float | str = 10.0, stop: float | str = 1e4) -> Fit:
        """Line of Δμ against log10 t over ``start`` ≤ t ≤ ``stop`` (s): β, cut-off time, and their standard errors.

        Least squares with equal weights on the mean over replicas. With two replicas or more the errors are jackknife
        errors over replicas; with one they come from the scatter about the line, which understates them because
        neighbouring hold times share their bonds.

        Raises
        ------
        InputError
            Fewer than two different hold times in the window.
        """
        from chemage.units import convert

        low, high = convert(start, "s"), convert(stop, "s")
        # a hold time given as 10.000000000000002 belongs to the window that starts at 10
        inside = (self.hold_times >= low * (1 - 1e-9)) & (self.hold_times <= high * (1 + 1e-9)) & (self.hold_times > 0)
        if np.unique(self.hold_times[inside]).size < 2:
            raise InputError.of(
                "fit window",
                (low, high),
                f"holds {int(inside.sum())} of the hold times",
                "widen it, or take more hold times per decade",
            )
        x = np.log10(self.hold_times[inside])
        drop = self.friction_drop[:, inside]

        def line(y: np.ndarray) -> tuple[float, float]:
            slope = float((x - x.mean()) @ (y - y.mean()) / np.sum((x - x.mean()) ** 2))
            intercept = float(y.mean() - slope * x.mean())
            return slope, -intercept / slope if slope > 0 else math.nan

        slope, log_cutoff = line(drop.mean(axis=0))
        r = self.replicas
        if r > 1:
            total = drop.sum(axis=0)
            left_out = np.array([line((total - drop[i]) / (r - 1)) for i in range(r)])
            slope_error, cutoff_error = np.sqrt((r - 1) / r * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))
        elif x.size > 2:
            y = drop[0]
            spread = np.sum((y - y.mean() - slope * (x - x.mean())) ** 2) / (x.size - 2)
            sxx = np.sum((x - x.mean()) ** 2)
            slope_error = math.sqrt(spread / sxx)
            height_error = math.sqrt(spread / x.size)
            cutoff_error = (
                math.hypot(height_error / slope, slope_error * (x.mean() - log_cutoff) / slope)
                if slope > 0
                else math.nan
            )
        else:
            slope_error = cutoff_error = math.nan
        scale = 1 / self.load if self.load > 0 else math.nan
        with np.errstate(over="ignore"):
            cutoff = float(np.power(10.0, log_cutoff))
        return Fit(
            slope * scale,
            float(slope_error) * scale,
            cutoff,
            cutoff * math.log(10) * float(cutoff_error),
            slope,
            float(slope_error),
            int(inside.sum()),
        )

    def __repr__(self) -> str:
        return (
            f"<Aging {self.replicas} replicas, {self.hold_times.size} hold times to {self.hold_times[-1]:g} s, "
            f"friction drop {self.mean_friction_drop[-1]:.4g} nN>"
        )

    __str__ = __repr__


def _standard_error(values: np.ndarray) -> np.ndarray:
    if values.shape[0] < 2:
        return np.full(values.shape[1:], np.nan)
    return values.std(axis=0, ddof=1) / math.sqrt(values.shape[0])


def hold_times(start: float | str, stop: float | str, per_decade: int = 4) -> np.ndarray:
    """Hold times from ``start`` to ``stop`` (s, both included), ``per_decade`` to a decade, evenly in log t.

    Times are whole multiples of 1/``per_decade`` decades above ``start``; ``stop`` is added if it is not one of them.
    """
    from chemage.units import convert

    low, high = convert(start, "s"), convert(stop, "s")
    if not (math.isfinite(low) and low > 0):
        raise InputError.of("start", start, "must be above zero", "hold times are spaced in log t; start at 1 ms, say")
    if not (math.isfinite(high) and high >= low):
        raise InputError.of("stop", stop, f"must be finite and not before start ({low:g} s)")
    if per_decade < 1:
        raise InputError.of("per_decade", per_decade, "must be at least 1")
    decades = math.log10(high / low)
    count = math.floor(decades * per_decade + 1e-9)
    times = low * 10.0 ** (np.arange(count + 1) / per_decade)
    # 0.001 * 10**(4/4) is 0.01, not 0.010000000000000002
    times = np.array([float(f"{t:.12g}") for t in times])
    if high > times[-1] * (1 + 1e-9):
        times = np.append(times, high)
    times[-1] = high
    return times


def effective_forming(intrinsic: np.ndarray, activation_volume: float, pressure: np.ndarray) -> np.ndarray:
    """E_intrinsic − ΔV·P in eV; ΔV in nm³, P in GPa. Li, Pastewka & Szlufarska 2018, eq. 3."""
    return intrinsic - activation_volume * EV_PER_GPA_NM3 * pressure.astype(np.float64, copy=False)
