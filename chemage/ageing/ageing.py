"""The result of ageing: bonds of several replicas against hold time, and what files and tables derive from them.

The contact is elastic at any pressure, and its bonds carry any shear stress. The options ``hardness`` and
``shear_strength`` of the chemistry say where the material would yield, see :func:`elastic_limits`; they change no bond.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import Field, model_validator

from chemage.ageing.fitting import (
    BETA,
    CUTOFF,
    DROPS,
    FIT_WINDOW,
    B,
    Fit,
    FitData,
    Friction,
    fit_ageing,
    line_slopes,
    line_weights,
    why_not_fitted,
)
from chemage.ageing.replicas import COMMON
from chemage.contacts.role import sphere_radius
from chemage.contacts.solution import Contact
from chemage.foundation.checks import check_times
from chemage.foundation.codec import Derived, dataset, frame
from chemage.foundation.errors import InputError
from chemage.foundation.outputs import MeasuredOutput, Observing, measured
from chemage.foundation.quantities import (
    HOLD_TIME,
    Curve,
    ErrorPart,
    Quantity,
    Rank,
    by_name,
)
from chemage.foundation.records import (
    Counts,
    Doubles,
    Indices,
    Named,
    Number,
    Plain,
    PositiveNumber,
    Record,
    SignedNumber,
    require_finite,
)
from chemage.foundation.result import draw_result, notebook_html
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import percent
from chemage.foundation.units import QuantityLike
from chemage.friction.role import Rupture
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.site_grid import ONE_PER_PIXEL

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: standard deviations from what is possible at which an estimate is taken for a fault
FAR = 8.0
#: the name of the error that is due to the distribution of barriers
BARRIERS = "barriers"
#: what all sites together do, beside what is fitted
BONDS: dict[str, Curve] = by_name(
    (
        Curve("bonds", "1", "bonds", rank=Rank.REST),
        Curve("bonds_per_area", "1/nm2", "bonds per contact area"),
        Curve("bonded_fraction", "1", "fraction of sites bonded", rank=Rank.REST),
    )
)


class Ageing(Observing, Record):
    """Bonds of several replicas against hold time, and the static friction rise they make."""

    arrays = {
        "hold_times": (("hold_time",), "s", "time since the contact was made"),
        "bonds": (("replica", "hold_time"), "", "number of bonds"),
        "sites": (("replica",), "", "number of reactive sites"),
        "events": (("replica",), "", "bonds formed and broken"),
        "rupture_force": (
            ("replica", "hold_time"),
            "nN",
            "force that breaks all bonds",
        ),
        "member_ratios": (
            ("member", "hold_time"),
            "",
            "bonds of other distributions of barriers over those of this one",
        ),
    }
    stored_names = {"hold_times": "hold_time"}
    added = (
        "rupture_force",
        "outputs",
        "elasticity",
        "errors",
        "error_sources",
        "events",
        "member_ratios",
        "unfitted",
    )

    hold_times: Doubles
    """(m,) s"""
    bonds: Counts
    """(replicas, m), of the whole contact; float64 where a method estimates them, see :class:`AgedBonds`"""
    sites: Counts
    """(replicas,), of the whole contact"""
    events: Indices | None = None
    """(replicas,); None: not known"""
    load: SignedNumber
    """nN"""
    temperature: PositiveNumber
    """K"""
    bond_force: Number = 3.0
    """⟨f⟩, mean force to rupture a bond, nN"""
    front_factor: float = Field(default=1.0, ge=0, allow_inf_nan=False)
    """fraction of the bonds that are loaded at the same time as the detachment front passes"""
    rupture_force: Doubles | None = None
    """force that breaks all bonds, nN, (replicas, m); None: bonds × ``bond_force`` × ``front_factor``"""
    errors: Named = {}
    """what an error is due to -> (m,) relative standard error, or bound, of the mean number of bonds, nan where it
    is not known; beside the scatter of the replicas, or a part of it, as ``error_sources`` says"""
    error_sources: dict[str, str] = {}
    """the same names -> how that error is known, in words"""
    member_ratios: Doubles | None = None
    """(members, m) bonds of other distributions of barriers that the same data allow over those of this one, with the
    same random numbers; None: none were aged"""
    engine: str = ""
    """kind of the engine"""
    notes: tuple[str, ...] = ()
    """notes of the first replica's run"""
    contact: dict[str, float] = {}
    """the contact's measures, see :meth:`ContactSolution.summary`"""
    elasticity: dict[str, float] = {}
    """limits of the elastic model that the chemistry gives (``hardness``, ``shear_strength``, GPa), and the shares of
    contact area and load above the hardness (``area_above_hardness``, ``load_above_hardness``)"""
    observables: Named = {}
    """name -> (replicas, ...)"""
    outputs: dict[str, dict[str, Any]] = {}
    """name of an observable's output -> dims, unit and description, as far as they are declared"""
    unfitted: str = ""
    """why no line is fitted, where the times are not those of one hold"""
    provenance: Plain = {}
    """how it was made: plain JSON values"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.hold_times.ndim != 1:
            raise ValueError(
                f"hold_times: shape {self.hold_times.shape}; give a one-dimensional array"
            )
        if (
            self.bonds.ndim != 2
            or self.bonds.shape[1] != self.hold_times.size
            or self.bonds.shape[0] < 1
        ):
            raise ValueError(
                f"bonds: shape {self.bonds.shape}; give (replicas, {self.hold_times.size})"
            )
        require_finite("sites", self.sites, "give counts")
        check_times(self.hold_times)
        require_finite("bonds", self.bonds, "give counts")
        for name in ("sites", "events"):
            counted = getattr(self, name)
            if counted is None:
                continue
            if counted.shape != self.bonds.shape[:1]:
                raise ValueError(
                    f"{name}: give one number for each of the {self.replicas} replicas"
                )
            if counted.min(initial=0) < 0:
                raise ValueError(
                    f"{name}: {counted.min()} is negative; give counts"
                )
        self._check_errors()
        if (negative := self.bonds < -self._scatter).any():
            raise ValueError(
                f"bonds: {self.bonds[negative][0]} is negative; give counts"
            )
        if (
            too_many := self.bonds - self._scatter
            > self.sites[:, None] * (1 + 1e-12)
        ).any():
            replica, at = np.argwhere(too_many)[0]
            raise ValueError(
                f"bonds: {self.bonds[replica, at]} of replica {replica} at {self.hold_times[at]:g} s, which has only "
                f"{self.sites[replica]} sites; a site has one bond at most"
            )
        if self.rupture_force is not None:
            if self.rupture_force.shape != self.bonds.shape:
                raise ValueError(
                    f"rupture_force: shape {self.rupture_force.shape}; give {self.bonds.shape}, as for bonds"
                )
            if not (
                np.isfinite(self.rupture_force) & (self.rupture_force >= 0)
            ).all():
                raise ValueError(
                    "rupture_force: has numbers that are negative or not finite; give forces in nN"
                )
        if (
            self.member_ratios is not None
            and self.member_ratios.shape[1:] != self.hold_times.shape
        ):
            raise ValueError(
                f"member_ratios: shape {self.member_ratios.shape}; give (members, {self.hold_times.size})"
            )
        for name, output in self.outputs.items():
            values = self.observables.get(name)
            if values is None or values.ndim != 1 + len(output["dims"]):
                raise ValueError(
                    f"outputs: {name!r} does not belong to an observable with dims {output['dims']}"
                )
        return self

    @property
    def _scatter(self) -> np.ndarray:
        """(m,) by how much estimates of a replica may miss what is possible; 0 for counts.

        Limited to it, their mean would be biased.
        """
        if self.bonds.dtype.kind == "i":
            return np.zeros(self.hold_times.size)
        stated = sum(self.errors.values(), np.zeros(self.hold_times.size)) * np.abs(
            self.bonds.mean(axis=0)
        )
        far = FAR * (self.bonds.std(axis=0) + stated * math.sqrt(self.replicas))
        return np.where(np.isnan(far), np.inf, far)

    def _check_errors(self) -> None:
        if self.errors.keys() != self.error_sources.keys():
            raise ValueError(
                f"error_sources: say how each of the errors {', '.join(self.errors) or '(none)'} is known"
            )
        for name, error in self.errors.items():
            if error.shape != self.hold_times.shape or error.dtype.kind != "f":
                raise ValueError(
                    f"errors: {name!r} must be one relative error for each of the hold times"
                )
            if (error < 0).any() or np.isinf(error).any():
                raise ValueError(
                    f"errors: {name!r} has numbers that are negative or infinite; give relative errors"
                )

    def declared(self, name: str) -> tuple[tuple[str, ...], str, str] | None:
        """See :meth:`Record.declared`; what was recorded has replicas as well."""
        field, _, key = name.partition("/")
        if field == "errors":
            return ("hold_time",), "", self.error_sources.get(key, "")
        found = super().declared(name)
        return (
            (("replica", *found[0]), *found[1:])
            if field == "observables" and found is not None
            else found
        )

    @property
    def measured(self) -> dict[str, MeasuredOutput]:
        """What observables measured and components recorded, with dimensions and units, by name."""
        return measured(self.observables, self.outputs)

    @property
    def random_numbers(self) -> str:
        """The seed, and which random numbers other runs have in common with this one, in words; "" if not recorded."""
        if (common := self.provenance.get("common")) not in COMMON:
            return ""
        return f"seed {self.provenance.get('seed', '?')}, {COMMON[common]}"

    @property
    def site_grid(self) -> str:
        """What the grid of sites is to the pixels of the contact, in words."""
        return self.provenance.get("sites", {}).get("words", ONE_PER_PIXEL)

    @property
    def replicas(self) -> int:
        """Number of replicas."""
        return self.bonds.shape[0]

    @property
    def method(self) -> str | None:
        """Kind of the method of ageing; None for the kinetics of every site."""
        return self.provenance.get("ageing", {}).get("kind")

    @property
    def error_words(self) -> str:
        """The errors of the mean that the scatter of the replicas does not contain, at the last hold time, in words."""
        last = [
            (name, float(error[-1]))
            for name, error in self.errors.items()
            if error.size
        ]
        parts = [
            f"{name} {percent(error)} ({self.error_sources[name]})"
            for name, error in last
        ]
        return "; ".join(parts)

    @property
    def stated_error(self) -> np.ndarray:
        """(m,) relative standard error of a mean without replicas, from :attr:`errors`; 0 beside a scatter of replicas.

        That of the distribution of barriers is left out: it is an error of the input.
        """
        parts = [
            error
            for name, error in self.errors.items()
            if name != BARRIERS and self.replicas == 1
        ]
        return np.sqrt(
            sum(
                (np.nan_to_num(error) ** 2 for error in parts),
                np.zeros(self.hold_times.size),
            )
        )

    @property
    def rupture(self) -> str | None:
        """Kind of the rupture law; None where the force per bond is that of the chemistry."""
        return self.provenance.get(Rupture.role, {}).get("kind")

    @property
    def friction_drop(self) -> np.ndarray:
        """ΔF, nN, (replicas, m): the force of the rupture law; without one, N ⟨f⟩ × front factor."""
        if self.rupture_force is not None:
            return self.rupture_force
        return self.bonds * (self.bond_force * self.front_factor)

    @property
    def friction_coefficient_drop(self) -> np.ndarray:
        """Δμ = ΔF / F_N, (replicas, m); nan without load, and under a pull."""
        if self.load <= 0:
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
    def site_area(self) -> float:
        """What the sites in contact cover, nm²: the contact area on the grid, unless sites are not pixels, where the
        rim is known better from the sites; nan where it is not known."""
        sites = self.provenance.get("sites")
        if isinstance(sites, dict) and {"touching", "spacing"} <= sites.keys():
            return sites["touching"] * sites["spacing"] ** 2
        return self.contact.get("grid_area", math.nan)

    @property
    def mean_shear_stress(self) -> float:
        """ΔF at the last hold time over the area of the sites, mean over replicas, GPa; nan where that is not known."""
        area = self.site_area
        return (
            float(self.friction_drop[:, -1].mean() / area)
            if area > 0 and self.hold_times.size
            else math.nan
        )

    @property
    def friction_drop_stderr(self) -> np.ndarray:
        """Standard error of the mean ΔF, nN, (m,); nan for a single replica."""
        return standard_error(self.friction_drop)

    @property
    def friction_coefficient_drop_stderr(self) -> np.ndarray:
        """Standard error of the mean Δμ, (m,); nan for a single replica or without load."""
        return standard_error(self.friction_coefficient_drop)

    @property
    def friction_drop_half_width(self) -> np.ndarray:
        """Half the width of Student's 95 % interval of the mean ΔF, nN, (m,); nan for a single replica."""
        return half_width(self.friction_drop)

    @property
    def friction_coefficient_drop_half_width(self) -> np.ndarray:
        """Half the width of Student's 95 % interval of the mean Δμ, (m,); nan for a single replica or without load."""
        return half_width(self.friction_coefficient_drop)

    def betas(self, window: tuple[float, float] = FIT_WINDOW) -> np.ndarray:
        """(replicas,) β of each replica: the slope of its line over ``window`` (s); their mean is that of :meth:`fit`.

        Raises
        ------
        InputError
            Fewer than two different hold times in the window.
        """
        if reason := why_not_fitted(self.hold_times, window):
            raise InputError(reason)
        return line_slopes(self.hold_times, self.friction_drop, window) / self.load

    def fit(
        self,
        start: QuantityLike = FIT_WINDOW[0],
        stop: QuantityLike = FIT_WINDOW[1],
    ) -> Fit:
        """Line of Δμ against log10 t over ``start`` ≤ t ≤ ``stop`` (s): β, cut-off time, and their errors.

        See :func:`chemage.fit_ageing`, of which this is the line over a window. Standard errors are jackknife errors
        over replicas. A single replica has none: its hold times share their bonds, so that their scatter about the line
        says nothing of the error.

        Raises
        ------
        InputError
            Fewer than two different hold times in the window, or no load.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            fit = fit_ageing(self, window=(start, stop))
        if not np.isfinite(fit.beta):
            raise InputError(
                "friction: its fit is out of the range of numbers; check load and bond_force"
            )
        return fit

    def fit_data(self, quantity: Friction | None) -> FitData:
        """The friction drop of every replica, for :func:`chemage.fit_ageing`."""
        chosen: Friction = quantity or "friction_coefficient_drop"
        if chosen == "friction_coefficient_drop" and self.load <= 0:
            raise InputError(
                f"load = {self.load:g}: the friction coefficient is undefined; fit quantity='friction_drop'"
            )
        scale = 1 / self.load if chosen == "friction_coefficient_drop" else 1.0
        return FitData(self.friction_drop, chosen, scale, simulated=True)

    def plot(
        self,
        ax: Axes | None = None,
        *,
        quantity: Friction | None = None,
        fit: bool = True,
        color: str | None = None,
        label: str = "",
    ) -> Axes:
        """Draw friction against hold time into ``ax``, or into a new figure of pyplot; return the axes.

        Means with their 95 % intervals of ``quantity``, "friction_coefficient_drop" (default where there is a load) or
        "friction_drop"; and with ``fit`` the line of :meth:`fit`. ``color`` and ``label`` are those of the curve.
        """
        return draw_result(
            self, ax, quantity=quantity, fit=fit, color=color, label=label
        )

    def curves(self) -> list[Curve]:
        """ΔF, Δμ, bonds per contact area and per site, and what was recorded at every hold time, as means over the
        replicas; without those that are not known, such as Δμ without load."""
        drops = {
            "friction_drop": self.friction_drop,
            "friction_coefficient_drop": self.friction_coefficient_drop,
        }
        with np.errstate(invalid="ignore", divide="ignore"):
            drops["bonds"] = self.bonds
            drops["bonds_per_area"] = self.bonds / self.site_area
            drops["bonded_fraction"] = self.bonds / self.sites[:, None]
        every = DROPS | BONDS
        found = []
        for name, values in drops.items():
            curve = every[name].of_replicas(self.hold_times, values, self.over)
            found.append(curve.but(known=self.stated_error * curve.mean))
        found += [
            output.curve(self.hold_times, self.over)
            for output in self.measured.values()
            if output.is_curve
        ]
        if self.load <= 0:  # there is no coefficient of friction
            found[0] = found[0].but(rank=Rank.FIRST)
        return [one for one in found if np.isfinite(one.mean).any()]

    @property
    def over(self) -> str:
        """What means are taken over."""
        return (
            f"mean of {self.replicas} replicas, 95 %"
            if self.replicas > 1
            else "1 replica"
        )

    def quantities(
        self, window: tuple[float, float] = FIT_WINDOW
    ) -> list[Quantity]:
        """The limits of the elastic model, what was recorded, and the fit over ``window`` (s); where there is none,
        why."""
        numbers = [Quantity("sites", "1", "sites", value=float(self.sites.mean()))]
        last = f"at {self.hold_times[-1]:g} s"
        for name, value in elastic_measures(self).items():
            of = (
                last
                if name in ("mean_shear_stress", "shear_stress_to_strength")
                else ""
            )
            numbers.append(ELASTIC_MEASURES[name].but(value=value, of=of))
        numbers += [
            output.quantity()
            for output in self.measured.values()
            if output.is_number
        ]
        fit, reason = fit_or_reason(self, window)
        if fit is None:
            return [
                *numbers,
                BETA.but(reason=f"not fitted: {reason}"),
                *(one.but(reason="not fitted") for one in (B, CUTOFF)),
            ]
        beta, *others = fit.quantities()
        how = f"measured here, {self.replicas} replicas on this one surface"
        replicas = (
            {"replicas": ErrorPart(fit.beta_stderr, how)}
            if self.replicas > 1
            else {}
        )
        return [
            *numbers,
            beta.but(errors=replicas | beta_parts(self, window)),
            *others,
        ]

    def to_xarray(self) -> xarray.Dataset:
        """The arrays with the names, dimensions and units of the file, and the curves of friction of the file: means
        over replicas, standard errors and half widths of 95 % intervals. Needs xarray."""
        return dataset(
            self,
            {
                name: (dims, values, {"units": unit})
                for name, (dims, values, unit, _) in stored_curves(self).items()
            },
        )

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each hold time (s), in columns named as in the table of a sweep. Needs pandas.

        Means over replicas of bonds, ΔF (nN) and Δμ, with standard errors and half widths of 95 % intervals; errors
        beside the scatter of the replicas (``error.NAME``, relative); what observables measured at every hold time.
        """
        attributes = {
            "replicas": self.replicas,
            "load": self.load,
            "temperature": self.temperature,
        }
        columns = {
            name: values
            for curve in self.curves()
            for name, values in curve.numbers().items()
        }
        columns |= {f"error.{name}": error for name, error in self.errors.items()}
        return frame(
            {HOLD_TIME.name: self.hold_times, **columns}, HOLD_TIME.name, attributes
        )

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def __repr__(self) -> str:
        return (
            f"<Ageing {self.replicas} replicas, {self.hold_times.size} hold times to {self.hold_times[-1]:g} s, "
            f"friction drop {self.mean_friction_drop[-1]:.4g} nN>"
        )

    __str__ = __repr__


def fit_or_reason(
    ageing: Ageing, window: tuple[float, float]
) -> tuple[Fit | None, str]:
    """The line of Δμ over ``window`` (s), or None and why it cannot be fitted, in words."""
    if reason := ageing.unfitted or why_not_fitted(ageing.hold_times, window):
        return None, reason
    try:
        return ageing.fit(*window), ""
    except InputError as error:
        return None, str(error)


def beta_parts(ageing: Ageing, window: tuple[float, float]) -> dict[str, ErrorPart]:
    """Parts of the error of β over ``window`` (s) that the scatter of the replicas does not contain: those of the mean
    number of bonds where there are no replicas, and that of the distribution of barriers.

    Errors of the bonds at different hold times may have any signs, also opposite ones early and late, so that their
    parts in the slope are added up by magnitude.
    """
    if ageing.replicas > 1 and ageing.member_ratios is None:
        return {}
    fit, _ = fit_or_reason(ageing, window)
    if fit is None:
        return {}
    parts = {}
    if ageing.replicas == 1:
        use, weights = line_weights(ageing.hold_times, window)
        slopes = np.abs(weights) * ageing.mean_friction_coefficient_drop[use]
        parts = {
            name: float(np.sum(slopes * error[use]))
            for name, error in ageing.errors.items()
            if name != BARRIERS
        }
    if ageing.member_ratios is not None:
        drops = ageing.member_ratios * ageing.mean_friction_coefficient_drop
        of_members = line_slopes(ageing.hold_times, drops, window)
        if np.isfinite(of_members).all():
            parts[BARRIERS] = float(of_members.std(ddof=1))
    return {
        name: ErrorPart(size, ageing.error_sources[name])
        for name, size in parts.items()
    }


def stored_curves(
    ageing: Ageing,
) -> dict[str, tuple[tuple[str, ...], np.ndarray, str, str]]:
    """The curves of friction that a file has: name -> (dimensions, values, unit, meaning)."""
    return {
        name: ((HOLD_TIME.name,), curve.numbers()[name], unit, meaning)
        for curve in ageing.curves()
        if curve.name in DROPS
        for name, unit, meaning in curve.columns()
    }


def derived(ageing: Ageing, window: tuple[float, float] = FIT_WINDOW) -> Derived:
    """The curves and the fit over ``window`` (first and last hold time, s), to be stored beside ``ageing``.

    Without two hold times in the window there is no fit.
    """
    fit, _ = fit_or_reason(ageing, window)
    if fit is None:
        return Derived(stored_curves(ageing), {})
    numbers: dict[str, Any] = {
        name: value
        for one in fit.quantities()
        for name, value in one.numbers().items()
    }
    ends = {
        "fit_window": np.array(window, dtype=np.float64),
        "fit_range": np.array(fit.span),
    }
    return Derived(stored_curves(ageing), numbers | ends)


#: what is reported, where it is known
ELASTIC_MEASURES: dict[str, Quantity] = by_name(
    (
        Quantity(
            "hardness", "GPa", "hardness", "", "hardness of the material", Rank.REST
        ),
        Quantity(
            "area_above_hardness",
            "1",
            "share of the contact area above the hardness",
        ),
        Quantity(
            "load_above_hardness", "1", "share of the load above the hardness"
        ),
        Quantity(
            "mean_shear_stress",
            "GPa",
            "mean shear stress",
            "",
            "friction drop at the last hold time over the area of the sites in contact, mean over replicas",
        ),
        Quantity(
            "shear_strength",
            "GPa",
            "shear strength",
            "",
            "shear strength of the material",
            Rank.REST,
        ),
        Quantity(
            "shear_stress_to_strength", "1", "mean shear stress over shear strength"
        ),
        Quantity(
            "work_of_adhesion",
            "J/m2",
            "work of adhesion",
            "",
            "work of adhesion of the surfaces",
            Rank.REST,
        ),
        Quantity(
            "pull_off_to_load",
            "1",
            "pull-off force 2πwR over the load",
            "",
            "of the sphere, which is without adhesion",
        ),
    )
)
#: a share of area or load, or a ratio of stress to strength, above this is noted
NOTED_ELASTIC = 0.05


def elastic_limits(contact: Contact, chemistry: Chemistry) -> dict[str, float]:
    """The limits that ``chemistry`` gives, and the shares of area and load of ``contact`` above the hardness.

    This is what :attr:`Ageing.elasticity` stores; it is empty where no limit is given.
    """
    limits = chemistry.given_limits()
    if "hardness" in limits:
        area, load = contact.above(limits["hardness"])
        if math.isfinite(area) and math.isfinite(load):
            limits |= {"area_above_hardness": area, "load_above_hardness": load}
    radius = sphere_radius(contact)
    # a solver with adhesion says where the surfaces touch
    if (
        "work_of_adhesion" in limits
        and radius
        and contact.load > 0
        and getattr(contact, "touching", None) is None
    ):
        limits["pull_off_to_load"] = (
            2 * math.pi * limits["work_of_adhesion"] * radius / contact.load
        )
    return limits


def elastic_measures(ageing: Ageing | None) -> dict[str, float]:
    """Those of :data:`ELASTIC_MEASURES` that are known of a result; none without ageing."""
    if ageing is None:
        return {}
    measures = dict(ageing.elasticity)
    if math.isfinite(stress := ageing.mean_shear_stress):
        measures["mean_shear_stress"] = stress
        if "shear_strength" in measures:
            measures["shear_stress_to_strength"] = (
                stress / measures["shear_strength"]
            )
    return {name: measures[name] for name in ELASTIC_MEASURES if name in measures}


def elastic_notes(ageing: Ageing | None) -> tuple[str, ...]:
    """What the user should know of pressures and stresses beyond :data:`NOTED_ELASTIC`, in words."""
    measures = elastic_measures(ageing)
    notes = []
    area = measures.get("area_above_hardness", 0.0)
    load = measures.get("load_above_hardness", 0.0)
    if max(area, load) > NOTED_ELASTIC:
        notes.append(
            f"{_percent(area)} of the contact area, which carries {_percent(load)} of the load, is above the hardness "
            f"of {measures['hardness']:g} GPa: the elastic solution overestimates the pressure there, which plastic "
            "flow would limit"
        )
    if (
        ageing is not None
        and measures.get("shear_stress_to_strength", 0.0) > NOTED_ELASTIC
    ):
        stress, strength = measures["mean_shear_stress"], measures["shear_strength"]
        notes.append(
            f"at {ageing.hold_times[-1]:g} s the bonds carry a mean shear stress of {stress:.3g} GPa, "
            f"{_percent(stress / strength)} of the shear strength of {strength:g} GPa: the model does not limit it, "
            "but the solid would yield at its strength"
        )
    if text := neglected_adhesion(
        measures.get("work_of_adhesion", 0.0), measures.get("pull_off_to_load", 0.0)
    ):
        notes.append(text)
    return tuple(notes)


def neglected_adhesion(work: float, share: float) -> str:
    """That adhesion (``work`` in J/m²) holds a sphere with a ``share`` of the load which the contact leaves out, in
    words; "" where it is small."""
    if share <= NOTED_ELASTIC:
        return ""
    return (
        f"a work of adhesion of {work:g} J/m² holds this sphere with up to {_percent(share)} of the load (2πwR, DMT), "
        "and the contact is solved without adhesion: its area and pressures are those of a smaller load; use a contact "
        "with adhesion"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if share < 0.1 else f"{100 * share:.0f} %"


def bond_errors(ageing: Ageing | None) -> dict[str, Any]:
    """The errors of the mean beside the scatter of the replicas; empty where there are none."""
    if ageing is None or not ageing.errors:
        return {}
    return {
        "bond_errors": {
            name: error.tolist() for name, error in ageing.errors.items()
        },
        "bond_error_sources": ageing.error_sources,
    }
