"""A contact between a surface and an elastic half-space under a load, as a map of the pressure or as its statistics."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from chemage.contacts import errors, patches
from chemage.contacts.patches import Above
from chemage.foundation.checks import MOST_BINS, checked_count
from chemage.foundation.codec import dataset, frame
from chemage.foundation.errors import InputError, nearest
from chemage.foundation.outputs import Observing
from chemage.foundation.quantities import Quantity, Rank, by_name
from chemage.foundation.records import (
    Doubles,
    Flags,
    Named,
    Number,
    Plain,
    PositiveNumber,
    Reals,
    Record,
    SignedNumber,
    frozen,
    read_only,
    require_finite,
)
from chemage.foundation.result import draw_result, notebook_html
from chemage.foundation.units import LARGEST, QuantityLike, convert
from chemage.surfaces.surface import PixelMap, Surface

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: the measures users compare: property of :class:`Contact` or, where it needs the map, of :class:`ContactSolution`
MEASURES: dict[str, Quantity] = by_name(
    (
        Quantity(
            "area_fraction",
            "1",
            "area fraction",
            "A/A0",
            "contact area over nominal area",
            Rank.FIRST,
        ),
        Quantity("area", "nm2", "contact area", "A"),
        Quantity(
            "grid_area",
            "nm2",
            "contact area on the grid",
            meaning="area of the pixels in contact",
            rank=Rank.REST,
        ),
        Quantity(
            "corrected_area",
            "nm2",
            "contact area less the excess of pixels at its rim",
            rank=Rank.REST,
        ),
        Quantity(
            "kappa",
            "1",
            "area-load coefficient",
            "κ",
            "area-load coefficient A h'_rms E* / F_N",
        ),
        Quantity("patches", "1", "patches", "", "contact patches"),
        Quantity(
            "perimeter_to_area",
            "1/nm",
            "perimeter to area",
            "C/A",
            "contact perimeter over contact area",
        ),
        Quantity(
            "mean_contact_pressure",
            "GPa",
            "mean contact pressure",
            "",
            "mean pressure over the contact",
        ),
        Quantity("max_pressure", "GPa", "largest pressure", rank=Rank.REST),
        Quantity("nominal_area", "nm2", "nominal area", rank=Rank.REST),
        Quantity(
            "nominal_pressure",
            "GPa",
            "nominal pressure",
            "",
            "load over nominal area",
            Rank.REST,
        ),
        Quantity("load", "nN", "load", "", "normal force"),
        Quantity("modulus", "GPa", "contact modulus", "E*"),
        Quantity(
            "rms_slope", "1", "rms slope", "", "rms slope of the surface", Rank.REST
        ),
        Quantity(
            "rms_height",
            "nm",
            "rms height",
            "",
            "rms height of the surface",
            Rank.REST,
        ),
    )
)
#: the same of contacts that know where the material flows
FLOW_MEASURES: dict[str, Quantity] = by_name(
    (
        Quantity(
            "yielded_area",
            "1",
            "share of the contact area where the material flows",
        ),
        Quantity(
            "yielded_load",
            "1",
            "share of the load carried where the material flows",
        ),
    )
)
RMS_PRESSURE = Quantity(
    "rms_pressure",
    "GPa",
    "rms pressure",
    meaning="root mean square of the pressure over the nominal area",
    rank=Rank.REST,
)
DISPLACEMENT = Quantity(
    "displacement",
    "nm",
    "approach",
    meaning="rigid approach of the bodies",
    rank=Rank.REST,
)
#: relative error of the force up to which rounding may be the cause
LOAD_ERROR = 1e-6


class Contact(Observing, Record):
    """What a contact answers, whether its map is known or its statistics alone.

    A measure that needs no map is a property of this class, one that does of :class:`ContactSolution`; with its line in
    :data:`MEASURES` every summary has it.
    """

    #: whether the pressure at each pixel is known
    has_map: ClassVar[bool]
    if TYPE_CHECKING:
        load: float
        modulus: float
        rms_slope: float
        rms_height: float
        notes: tuple[str, ...]
        provenance: dict[str, Any]

        carries: str

        @property
        def contact_area(self) -> float: ...
        @property
        def carried(self) -> float: ...
        @property
        def borne(self) -> float: ...
        @property
        def nominal_area(self) -> float: ...
        def _above(self, pressure: float) -> Above: ...

    @property
    def area_fraction(self) -> float:
        """A / A0."""
        return self.contact_area / self.nominal_area

    @property
    def nominal_pressure(self) -> float:
        """F_N / A0, GPa."""
        return self.load / self.nominal_area

    @property
    def mean_contact_pressure(self) -> float:
        """Mean pressure over the contact F_N / A, GPa; nan without contact. Of a contact that ``carries`` another force
        than the load, that force over A; with adhesion, the mean over the pixels that touch."""
        force = self.carried if self.carries else self.load
        return force / self.contact_area if self.contact_area > 0 else math.nan

    @property
    def kappa(self) -> float:
        """κ = A h'_rms E* / F_N; nan without load."""
        return (
            self.contact_area * self.rms_slope * self.modulus / self.load
            if self.load > 0
            else math.nan
        )

    def load_fault(self, error: float) -> str:
        """Why the pressure does not add up to the load within the relative ``error``, or that which the solver states
        of its pressure, in words; "" where it does or where ``carries`` says that it does not."""
        stated = getattr(self, "convergence", {}).get("pressure_error")
        error = max(
            error, LOAD_ERROR, stated if isinstance(stated, int | float) else 0.0
        )
        if self.carries or abs(self.carried - self.load) <= error * self.borne:
            return ""
        return (
            f"the pressure adds up to {self.carried:.6g} nN, and the load is {self.load:.6g} nN; where it cannot carry "
            'the load, say why in the field carries, such as carries = "the pressure is capped at 2 GPa"'
        )

    def unloaded(self) -> list[dict[str, Any]]:
        """What :attr:`carries` says, as an approximation that every result names; empty where it says nothing."""
        text = f"{self.carried:.4g} of {self.load:.4g} nN: {self.carries}"
        return (
            [
                {
                    "kind": self.provenance.get("kind") or type(self).__name__,
                    "carries": text,
                }
            ]
            if self.carries
            else []
        )

    def above(self, hardness: QuantityLike) -> Above:
        """Which shares of contact area and load lie above a ``hardness`` (GPa, or a string with its unit).

        An elastic solution overestimates the pressure there, which plastic flow would limit. Both shares are nan
        without contact.

        Raises
        ------
        InputError
            The hardness is not above zero and finite, or has no unit of pressure.
        """
        value = convert(hardness, "GPa")
        if not 0 < value < math.inf:
            raise InputError.of(
                "hardness",
                hardness,
                "must be finite and above zero",
                "give a pressure in GPa",
            )
        return self._above(value)

    @classmethod
    def knows(cls, measure: str) -> bool:
        """Whether a contact of this class can have the ``measure``."""
        return measure in cls.model_fields or hasattr(cls, measure)

    def measure(self, name: str) -> float:
        """One of :data:`MEASURES`; nan where it needs a map, and this contact has none."""
        if name in ("area", "grid_area"):
            return self.contact_area
        return getattr(self, name) if self.knows(name) else math.nan

    def measures(self) -> dict[str, float]:
        """:data:`MEASURES` as this contact has them, on its grid; nan where one needs a map and there is none."""
        return {name: self.measure(name) for name in MEASURES}

    def summary(self) -> dict[str, float]:
        """The measures users compare, as plain numbers: those of :meth:`quantities`, the best estimates."""
        measures = self.measures()
        known = {one.name: one.value for one in self.quantities()}
        return {name: known.get(name, value) for name, value in measures.items()}

    def quantities(self) -> list[Quantity]:
        """The measures, and the numbers that were recorded; without those that this contact does not have."""
        every = MEASURES | FLOW_MEASURES
        found = [
            every[name].but(value=value) for name, value in self.measures().items()
        ]
        found += [
            output.quantity()
            for output in self.measured.values()
            if output.is_number
        ]
        return [one for one in found if one.known]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the map of the pressure, or without one the contact area above each pressure, into ``ax`` or into a new
        figure of pyplot; return the axes."""
        return draw_result(self, ax)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions (x and y in nm) and units of the file. Needs xarray."""
        return dataset(self)

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def __str__(self) -> str:
        return repr(self)


class ContactSolution(PixelMap, Contact):
    """The pressure between a surface and an elastic half-space under a load."""

    arrays = {
        "pressure": (("x", "y"), "GPa", "contact pressure"),
        "gap": (("x", "y"), "nm", "gap between the surfaces, 0 in contact"),
        "plastic_displacement": (("x", "y"), "nm", "height lost by plastic flow"),
        "touching": (
            ("x", "y"),
            "1",
            "whether the surfaces touch, where they adhere",
        ),
    }

    has_map = True
    added = (
        "carries",
        "touching",
        "observables",
        "outputs",
        "plastic_displacement",
    )

    pressure: Reals
    """(nx, ny) GPa, ≥ 0; contact is where it is positive. With ``touching`` it may be negative: tension, by which the
    surfaces adhere where they touch, and attract each other where they do not"""
    load: SignedNumber
    """normal force, nN; negative where the surfaces adhere and are pulled"""
    pixel_size: PositiveNumber
    """edge of a pixel, nm"""
    modulus: PositiveNumber
    """contact modulus E*, GPa"""
    periodic: bool = True
    """whether the grid repeats"""
    contact_pixels: Literal["loaded", "centres"] = "loaded"
    """which pixels carry pressure: ``loaded``, those in which the bodies touch anywhere, more than the contact covers;
    ``centres``, those whose centre lies in the contact, which cover its area without bias"""
    rms_slope: float = math.nan
    """of the surface"""
    rms_height: float = math.nan
    """of the surface, nm"""
    gap: Reals | None = None
    """(nx, ny) nm ≥ 0, where the solver gives it"""
    plastic_displacement: Reals | None = None
    """(nx, ny) nm ≥ 0, what heights lose where the pressure is the hardness, if the solver has one; it stays when the
    load is removed, see :meth:`residual_surface`"""
    touching: Flags | None = None
    """(nx, ny), with adhesion: the pixels in contact, those of zero gap; None: those of positive pressure"""
    displacement: float | None = Field(default=None, allow_inf_nan=False)
    """rigid approach of the bodies, nm, where the solver gives it"""
    carries: str = ""
    """why the pressure does not add up to the load, in words; empty: it does, within the error that is stated"""
    converged: bool = True
    """whether the tolerance was reached"""
    residual: float = 0.0
    """the solver's convergence measure at the end; 0 for a closed form"""
    iterations: int = Field(default=0, ge=0)
    """of the solver"""
    convergence: Plain = {}
    """the solver's own account of its error: plain JSON values. ``pressure_error``, where it is given, is the estimated
    error of the pressure: its L2 norm relative to that of the pressure; ``errors``, see :mod:`chemage.contacts.errors`"""
    notes: tuple[str, ...] = ()
    """what the user should know of this solution, in words"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pressure.ndim != 2 or self.pressure.size == 0:
            raise ValueError(
                f"pressure: shape {self.pressure.shape}; give a two-dimensional, non-empty array (nx, ny)"
            )
        require_finite(
            "pressure", self.pressure, "the solver that made it is at fault"
        )
        for name in ("gap", "plastic_displacement", "touching"):
            if (values := getattr(self, name)) is None:
                continue
            if values.shape != self.pressure.shape:
                raise ValueError(
                    f"{name}: shape {values.shape}, but pressure has {self.pressure.shape}"
                )
            require_finite(name, values, "the solver that made it is at fault")
        if (
            self.plastic_displacement is not None
            and (lowest := float(self.plastic_displacement.min())) < 0
        ):
            raise ValueError(
                f"plastic_displacement: its smallest value is {lowest:g} nm; flow only lowers, it is ≥ 0"
            )
        if float(self.pressure.max()) > LARGEST:
            raise ValueError(
                f"pressure: up to {self.pressure.max():g} GPa, out of range; give pressures in GPa"
            )
        lowest = float(self.pressure.min())
        if self.touching is not None:
            if lowest < -LARGEST:
                raise ValueError(
                    f"pressure: down to {lowest:g} GPa, out of range; give pressures in GPa"
                )
        elif lowest < 0:
            raise ValueError(
                f"pressure: its smallest value is {lowest:g} GPa; a hard wall only pushes, it must be ≥ 0, unless the "
                "surfaces adhere and touching says where"
            )
        if self.load < 0 and self.touching is None:
            raise ValueError(
                f"load: {self.load} nN is negative; without adhesion nothing can be pulled"
            )
        return self

    @cached_property
    def contact(self) -> np.ndarray:
        """(nx, ny) bool: pixels in contact."""
        return frozen(self.pressure > 0) if self.touching is None else self.touching

    @cached_property
    def sites(self) -> np.ndarray:
        """(n,) int64: flat indices of the pixels in contact, ascending."""
        return frozen(np.flatnonzero(self.contact), np.int64)

    @property
    def carried(self) -> float:
        """The force that the pressure adds up to, nN."""
        return float(self.pressure.sum(dtype=np.float64)) * self.pixel_size**2

    @property
    def borne(self) -> float:
        """The forces on all pixels without their signs, nN: that by which errors of the load are measured."""
        if self.touching is None:
            return self.load
        return (
            float(np.abs(self.pressure).sum(dtype=np.float64)) * self.pixel_size**2
        )

    @property
    def mean_contact_pressure(self) -> float:
        if self.touching is None or not self.sites.size:
            return super().mean_contact_pressure
        return float(self.pressure[self.touching].mean(dtype=np.float64))

    @property
    def contact_area(self) -> float:
        """Contact area A on the grid, nm²: pixels with positive pressure, or with adhesion those that touch. The best
        estimate, less their excess at the rim, is ``quantity("area")``; :attr:`area_fraction`, :attr:`kappa` and
        :attr:`mean_contact_pressure` are on the grid as well."""
        return self.sites.size * self.pixel_size**2

    @property
    def area(self) -> float:
        """The same."""
        return self.contact_area

    @property
    def area_fraction(self) -> float:
        """A / A0."""
        return self.sites.size / self.pressure.size

    @property
    def corrected_area(self) -> float:
        """A less the pixels' excess at the rim (Yastrebov et al. 2017), nm²; A itself where there is no such excess
        (see ``contact_pixels``). Not below :attr:`least_area`."""
        if self.contact_pixels == "centres":
            return self.area
        rim = patches.perimeter(
            self.contact, self.pixel_size, self.periodic, border=False
        )
        corrected = patches.corrected_area(self.area, rim, self.pixel_size)
        return max(corrected, self.least_area)

    @property
    def least_area(self) -> float:
        """The area that bears the load at the hardness where the material flows, nm²; else 0."""
        flow = self.plastic_displacement
        if flow is None or not flow.any():
            return 0.0
        return self.carried / self.max_pressure

    @property
    def rms_pressure(self) -> float:
        """Root mean square of the pressure over the nominal area, GPa."""
        return math.sqrt(float(np.mean(np.square(self.pressure, dtype=np.float64))))

    @cached_property
    def errors(self) -> dict[str, dict[str, tuple[float, float]]]:
        """The errors of area, largest and rms pressure and displacement by name (``iteration``, ``pixel``, ``branch``):
        how far below and above the value the truth may be, each half of a 95 % interval; nan: not known. Below zero: the
        value on the grid is too large, or too small."""
        return read_only(errors.errors(self))

    def quantities(self) -> list[Quantity]:
        """See :meth:`Contact.quantities`; with intervals, and further measures that have errors."""
        more = [
            one.but(value=value)
            for one, value in (
                (RMS_PRESSURE, self.rms_pressure),
                (DISPLACEMENT, self.displacement),
            )
            if value is not None
        ]
        return [errors.stated(self, one) for one in (*super().quantities(), *more)]

    def quantity(self, name: str) -> Quantity:
        """A number of this contact with its interval and its errors by name: ``contact.quantity("area").errors``.

        Raises
        ------
        InputError
            It has none of this name.
        """
        known = by_name(self.quantities())
        if name not in known:
            raise InputError.of(
                "name",
                name,
                f"is no number of this contact{nearest(name, list(known))}",
                f"give one of {', '.join(known)}",
            )
        return known[name]

    @cached_property
    def _patches(self) -> patches.Patches:
        return patches.patches(self.contact, self.periodic)

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
        return patches.perimeter(self.contact, self.pixel_size, self.periodic)

    @property
    def perimeter_to_area(self) -> float:
        """C / A, 1/nm; nan without contact."""
        return self.perimeter / self.area if self.area > 0 else math.nan

    def pressure_histogram(
        self, bins: int = 50, upper: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distribution of the pressure over the contact, from zero or with adhesion from the largest tension: bin edges
        (bins + 1,) GPa and density (bins,) 1/GPa."""
        if upper is not None and not (
            isinstance(upper, int | float) and 0 < upper < math.inf
        ):
            raise InputError.of(
                "upper",
                upper,
                "must be finite and above zero",
                "give a pressure in GPa",
            )
        values = self.pressure[self.contact]
        top = (
            upper
            if upper is not None
            else (float(values.max(initial=0.0)) if values.size else 1.0)
        )
        least = float(values.min(initial=0.0))
        counts, edges = np.histogram(
            values,
            bins=checked_count("bins", bins, most=MOST_BINS),
            range=(least, top),
        )
        return edges, counts / (max(values.size, 1) * np.diff(edges))

    def _above(self, pressure: float) -> Above:
        return patches.above(self.pressure, pressure, self.contact)

    @property
    def yielded(self) -> Above:
        """Which shares of contact area and load lie where the material flows; both nan where that is not known."""
        if self.plastic_displacement is None or not self.sites.size:
            return Above(math.nan, math.nan)
        flows = self.plastic_displacement > 0
        force = (
            float(self.pressure.sum(where=flows, dtype=np.float64))
            * self.pixel_size**2
        )
        return Above(
            float(np.count_nonzero(flows)) / self.sites.size, force / self.carried
        )

    def measures(self) -> dict[str, float]:
        """See :meth:`Contact.measures`; with :data:`FLOW_MEASURES` where they are known."""
        flow = (
            {}
            if self.plastic_displacement is None
            else dict(zip(FLOW_MEASURES, self.yielded, strict=True))
        )
        return super().measures() | flow

    def residual_surface(self, surface: Surface) -> Surface:
        """What ``surface``, of which this is the contact, is after the load is removed: its heights less
        :attr:`plastic_displacement`. Solve with it to unload, and to load again: up to the load of this contact it does
        not flow.

        Raises
        ------
        InputError
            The solver has no hardness, or the surface is another one.
        """
        if self.plastic_displacement is None:
            raise InputError(
                "this contact is elastic and leaves the surface as it was; give its solver a hardness"
            )
        same = surface.shape == self.shape and surface.pixel_size == self.pixel_size
        if not (
            same
            and math.isclose(
                surface.rms_height, self.rms_height, rel_tol=1e-6, abs_tol=1e-300
            )
        ):
            raise InputError(
                f"surface: {surface!r} is not the one of {self!r}; give the surface that was solved"
            )
        made = {
            name: value
            for name, value in surface.provenance.items()
            if name != "radius"
        }  # no sphere any more
        solver = {
            name: self.provenance[name]
            for name in ("kind", "options")
            if name in self.provenance
        }
        return Surface(
            heights=surface.heights
            - self.plastic_displacement.astype(surface.heights.dtype),
            pixel_size=surface.pixel_size,
            periodic=surface.periodic,
            provenance={
                **made,
                "flowed": [*made.get("flowed", []), {"load": self.load, **solver}],
            },
        )

    @property
    def max_pressure(self) -> float:
        """Largest pressure, GPa."""
        return float(self.pressure.max())

    def __repr__(self) -> str:
        return f"<ContactSolution {self.load:g} nN, area fraction {self.area_fraction:.4g}, {self.patches} patches>"


class ContactStatistics(Contact):
    """What is left of a contact when its map is forgotten: area by pressure, and by missing neighbours.

    It is made of a solved contact by :func:`chemage.plugin.contact_statistics`, or given by a theory.
    """

    has_map = False
    added = ("carries", "observables", "outputs")
    arrays = {
        "pressure": (("class",), "GPa", "mean pressure of the class"),
        "area": (("class",), "nm2", "contact area of the class"),
        "missing": (
            ("class", "neighbours"),
            "nm2",
            "contact area of the class whose sites lack so many neighbours",
        ),
    }

    pressure: Doubles
    """(n,) GPa, ascending, > 0"""
    area: Doubles
    """(n,) nm² ≥ 0"""
    missing: Doubles | None = None
    """(n, k + 1) nm²: area whose sites lack 0, 1, … k neighbours that a site inside the contact has; None: not known,
    which leaves the rim out"""
    load: Number
    """normal force, nN"""
    nominal_area: PositiveNumber  # pyright: ignore[reportIncompatibleMethodOverride]
    """A0, nm²"""
    modulus: PositiveNumber
    """contact modulus E*, GPa"""
    rms_slope: float = math.nan
    """of the surface"""
    rms_height: float = math.nan
    """of the surface, nm"""
    carries: str = ""
    """why the pressure does not add up to the load, in words; empty: it does, within the error that is stated"""
    notes: tuple[str, ...] = ()
    """what the user should know of this contact, in words"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pressure.ndim != 1 or self.area.shape != self.pressure.shape:
            raise ValueError(
                f"area: shape {self.area.shape}; give one area for each of the pressures"
            )
        for name in ("pressure", "area"):
            require_finite(
                name, getattr(self, name), "give pressures in GPa, areas in nm²"
            )
        if (self.pressure <= 0).any() or (np.diff(self.pressure) <= 0).any():
            raise ValueError(
                "pressure: must be above zero and ascending; give the mean pressure of each class"
            )
        if (self.area < 0).any():
            raise ValueError(f"area: {self.area.min():g} nm² is negative")
        if self.missing is not None:
            if (
                self.missing.ndim != 2
                or len(self.missing) != self.area.size
                or self.missing.shape[1] < 1
            ):
                raise ValueError(
                    f"missing: shape {self.missing.shape}; give ({self.area.size}, neighbours + 1)"
                )
            if not np.allclose(
                self.missing.sum(axis=1), self.area, rtol=1e-9, atol=0.0
            ):
                raise ValueError("missing: its rows do not add up to area")
        return self

    @property
    def contact_area(self) -> float:
        """Contact area A, nm²."""
        return float(self.area.sum())

    @property
    def carried(self) -> float:
        """The force that the pressures add up to, nN."""
        return float(np.sum(self.pressure * self.area))

    @property
    def borne(self) -> float:
        """The same: nothing pulls."""
        return self.load

    @property
    def converged(self) -> bool:
        """Nothing was iterated."""
        return True

    def _above(self, pressure: float) -> Above:
        if not self.contact_area > 0:
            return Above(math.nan, math.nan)
        beyond, force = self.pressure > pressure, self.area * self.pressure
        return Above(
            float(self.area[beyond].sum()) / self.contact_area,
            float(force[beyond].sum()) / float(force.sum()),
        )

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each class of pressure: ``pressure`` (GPa) and ``area`` (nm²). Needs pandas."""
        return frame(
            {"pressure": self.pressure, "area": self.area},
            "pressure",
            self.summary(),
        )

    def __repr__(self) -> str:
        return f"<ContactStatistics {self.load:g} nN, area fraction {self.area_fraction:.4g}>"
