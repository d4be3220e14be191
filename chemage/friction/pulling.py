"""Pulling a contact: the role that follows its bonds while a drive moves it, and what comes of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import model_validator

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import (
    Seed,
    check_times,
    checked_seed,
    expect,
    temperature_value,
)
from chemage.foundation.components import Component, takes
from chemage.foundation.errors import InputError
from chemage.foundation.figures import BLUE, from_zero
from chemage.foundation.outputs import recording
from chemage.foundation.records import Doubles, Flags, Indices, Number, Plain
from chemage.foundation.result import (
    Medium,
    OfRecord,
    Panel,
    Picture,
    Rows,
    displays,
)
from chemage.foundation.units import Force, Length, QuantityLike, Unit
from chemage.kinetics.history import (
    BondHistory,
    Followed,
    checked_start,
    counters_of,
)
from chemage.kinetics.role import Ramp
from chemage.lattices.chemistry import Chemistry, effective_forming
from chemage.lattices.lattice import ABSENT, ReactionLattice
from chemage.lattices.role import Barriers
from chemage.lattices.site_grid import SITE_POSITIONS
from chemage.plugins import registry
from chemage.plugins.sources import noted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: relative error of the balance of energy above which a pull contradicts itself
BALANCE = 1e-9
#: quantiles between which the barriers of new partners are interpolated
QUANTILES = 1 << 16


class Drive(Component):
    """What pulls at a contact, and how its bonds yield: all bonds are springs between the slider and their sites.

    The slider moves at ``speed``, or a spring K pulls it whose far end has that speed. It is then always in balance,
    K(Vt − X) = κ Σ stretch + friction, and rests where the spring pulls less than that.
    """

    speed: Annotated[Any, Unit("nm/s", ge=0)]
    """speed of the drive, nm/s; 0: it stands still, and its force relaxes"""
    spring: Annotated[Any, Unit("nN/nm", ge=0)] | None = None
    """K, stiffness of the spring that pulls the slider, nN/nm; default: the slider itself has the speed"""
    friction: Force = 0.0
    """friction of the slider beside that of the bonds, nN; default: none"""
    bond_stiffness: Annotated[Any, Unit("nN/nm", ge=0)]
    """κ, stiffness of a bond with what holds it, nN/nm"""
    transition_distance: Length
    """Δx, from the bound state to the transition state along the pull, nm"""
    shape: Literal["cusp", "cubic", "constant"] = "cubic"
    """energy along the pull: a cusp (ν = 1/2), linear-cubic (ν = 2/3), or Bell's constant distance (ν = 1); default:
    linear-cubic"""
    partner: Literal["kept", "renewed"] = "renewed"
    """``renewed``: with every spacing of slip a site meets another site of the counter-body, both barriers of which are
    drawn from the distributions; ``kept``: it has the barriers of the lattice throughout; default: renewed"""
    spacing: Length | None = None
    """d, between the sites of the counter-body, nm; default: that of the sites of the lattice"""

    @property
    def exponent(self) -> float:
        """ν of the shape."""
        return {"cusp": 0.5, "cubic": 2.0 / 3.0, "constant": 1.0}[self.shape]


class Partners(NamedTuple):
    """The sites of the counter-body: a site meets another one with every spacing of slip."""

    #: (q,) eV, quantiles of the intrinsic forming barrier at equal steps of probability, interpolated between them
    forming: np.ndarray
    #: (q,) eV, of the breaking barrier
    breaking: np.ndarray
    #: (n,) eV, what the forming barrier of a site has beside that of its partner, such as that of the pressure
    shift: np.ndarray
    #: nm, between two of them
    spacing: float


def partners_of(
    chemistry: Chemistry, lattice: ReactionLattice, contact: ContactSolution
) -> Partners:
    """Partners with the barriers of ``chemistry``: between 65,536 quantiles, at the pressure of each site, as far from
    each other as the sites of ``lattice``; a site that is not in contact meets none."""
    pressure = lattice.pressures(contact)
    shift = effective_forming(
        np.where(lattice.forming < ABSENT / 2, 0.0, ABSENT),
        chemistry.activation_volume,
        pressure,
    )
    spacing = lattice.pixel_size
    if chemistry.site_density == "given":
        pixels = lattice.pixels[0] * lattice.pixels[1]
        spacing *= (pixels / len(contact.observables[SITE_POSITIONS])) ** 0.5
    forming, breaking = (
        np.empty(0) if barriers is None else _quantiles(barriers)  # pyright: ignore[reportArgumentType]: hashable it is
        for barriers in (chemistry.forming, chemistry.breaking)
    )
    return Partners(forming, breaking, shift, spacing)


@lru_cache(maxsize=8)
def _quantiles(barriers: Barriers) -> np.ndarray:
    """Of a distribution, at equal steps; kept, because a run pulls hundreds of times with the same one."""
    quantiles = np.maximum.accumulate(
        barriers.quantile((np.arange(QUANTILES) + 0.5) / QUANTILES)
    )
    quantiles.setflags(write=False)
    return quantiles


class PullHistory(Followed):
    """What is measured while a contact is pulled, and its bonds at the end; a pull or a hold can go on from it."""

    of_times = "times"

    arrays = {
        "times": (("times",), "s", "time since the contact was made"),
        "displacement": (
            ("times",),
            "nm",
            "of the slider, since it was first pulled",
        ),
        "force": (("times",), "nN", "of the drive"),
        "bonds": (("times",), "", "number of bonds"),
        "formed": (("times",), "", "bonds formed so far"),
        "broken": (("times",), "", "bonds broken so far"),
        "work": (("times",), "nN nm", "done by the drive so far"),
        "dissipated": (("times",), "nN nm", "lost so far where bonds broke"),
        "rubbed": (
            ("times",),
            "nN nm",
            "lost so far to the friction of the slider",
        ),
        "stored": (("times",), "nN nm", "elastic energy of bonds and spring"),
        "state": (("site",), "", "whether each site is bonded at the end"),
        "stretch": (
            ("site",),
            "nm",
            "of each bond at the end, 0 where there is none",
        ),
        "forming": (
            ("site",),
            "eV",
            "barrier to forming a bond with the present partner, no neighbour bonded",
        ),
        "breaking": (
            ("site",),
            "eV",
            "barrier to breaking the bond, or one with the present partner",
        ),
        "avalanches": (
            ("size",),
            "",
            "number of slips in which 2^j to 2^(j+1) bonds broke",
        ),
    }

    times: Doubles
    """(m,) s since the contact was made"""
    displacement: Doubles
    """(m,) nm"""
    force: Doubles
    """(m,) nN"""
    bonds: Indices
    """(m,)"""
    formed: Indices
    """(m,) since the contact was made"""
    broken: Indices
    """(m,) since the contact was made"""
    work: Doubles
    """(m,) nN nm since the first pull, as the next three"""
    dissipated: Doubles
    """(m,) nN nm"""
    rubbed: Doubles
    """(m,) nN nm"""
    stored: Doubles
    """(m,) nN nm"""
    state: Flags
    """(n,) bool at the last time"""
    stretch: Doubles
    """(n,) nm at the last time"""
    forming: Doubles
    """(n,) eV: the forming barriers at the end, with the present partners"""
    breaking: Doubles
    """(n,) eV: the breaking barriers at the end, of a bond with the partner with which it formed"""
    avalanches: Indices
    """(j,) slips by their number of ruptures; a slip is a fall of the force by more than 5 % of the largest force"""
    largest_drop: Number = 0.0
    """nN, of the force in one slip that has ended"""
    peak: Number
    """the largest force of this pull so far, nN, between the times as well; what goes on under the same conditions is
    the same pull"""
    peak_displacement: Number
    """where it was reached, nm"""
    peak_time: Number
    """when it was reached, s"""
    least: Number = 0.0
    """the smallest force of this pull so far, nN, between the times as well"""
    drive: Plain
    """what pulled"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_times(self.times)
        for name, (dims, _, _) in self.arrays.items():
            length = {"times": self.times.size, "site": self.state.size}.get(
                dims[0]
            )
            values = getattr(self, name)
            if values.ndim != 1 or length not in (None, values.size):
                raise ValueError(f"{name}: shape {values.shape}; give ({length},)")
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                raise ValueError(f"{name}: has values that are not finite")
        return self

    @property
    def imbalance(self) -> np.ndarray:
        """Work less what was dissipated, rubbed and is stored, relative to the work, (m,); rounding if the pull began
        with unstretched bonds."""
        lost = self.work - self.dissipated - self.rubbed - self.stored
        return lost / np.maximum(
            np.maximum(self.work, self.dissipated + self.rubbed + self.stored),
            1e-300,
        )

    @property
    def history(self) -> BondHistory:
        """The bonds, from which a hold goes on: the contact is unloaded, and its bonds are relaxed."""
        names = ("bonds", "formed", "broken", "state", "time", "temperature")
        return BondHistory(
            hold_times=self.times,
            engine=self.engine,
            resume=counters_of(self.resume),
            **{name: getattr(self, name) for name in names},
        )

    @classmethod
    def of_parts(cls, parts: Sequence[Any], **changes: Any) -> Self:
        """See :meth:`Followed.of_parts`; the peak and the least force are those of all."""
        changes["least"] = min(one.least for one in parts)
        highest = max(parts, key=lambda one: one.peak)
        for name in ("peak", "peak_displacement", "peak_time"):
            changes[name] = getattr(highest, name)
        return super().of_parts(parts, **changes)

    def without(self, lost: np.ndarray) -> Self:
        """See :meth:`Followed.without`; the energy of these bonds is dissipated, and where no spring pulls, the force
        falls by theirs."""
        stretch, kappa = self.stretch * lost, self.drive["bond_stiffness"]
        energy = 0.5 * kappa * float((stretch**2).sum())
        rigid = self.drive["spring"] is None
        fallen = rigid * kappa * float(stretch.sum())
        force = np.maximum(self.force[-1:] - fallen, 0.0)
        return (
            super()
            .without(lost)
            .model_copy(
                update={
                    "force": force,
                    "least": min(self.least, float(force[0])),
                    "dissipated": self.dissipated[-1:] + energy,
                    "stored": np.maximum(self.stored[-1:] - energy, 0.0),
                    "stretch": self.stretch - stretch,
                }
            )
        )

    def lattice_after(self, lattice: ReactionLattice) -> ReactionLattice:
        """``lattice``, which was pulled, with the partners that its sites have now; to pull on, take ``lattice``."""
        both = {"forming": self.forming, "breaking": self.breaking}
        return lattice.model_copy(update=both)

    def fault(self) -> str:
        """See :meth:`Followed.fault`."""
        if self.stretch.size and (
            float(self.stretch.min()) < 0 or self.stretch[~self.state].any()
        ):
            return "stretch: a bond is compressed, or a site without a bond is stretched"
        for name in (
            "displacement",
            "formed",
            "broken",
            "work",
            "dissipated",
            "rubbed",
        ):
            values = getattr(self, name)
            if np.any(values[1:] < values[:-1]) or (values.size and values[0] < 0):
                return f"{name} falls, or is negative"
        if np.any(self.force < 0) or self.peak < self.force.max(initial=0.0):
            return "force: is negative, or above the peak"
        # a recorded force is rounded once more
        if self.least > self.force.min(initial=np.inf) + BALANCE * self.peak:
            return "force: is below the least force"
        if (worst := float(np.abs(self.imbalance).max(initial=0.0))) > BALANCE:
            return f"the balance of energy is violated by {worst:.2g} of the work"
        return super().fault()

    def __repr__(self) -> str:
        return f"<PullHistory peak {self.peak:.4g} nN, {self.displacement[-1]:.4g} nm by {self.time:g} s ({self.engine})>"

    __str__ = __repr__


Start = PullHistory | BondHistory | np.ndarray | None


class Pulling(Component, ABC):
    """Role ``pulling``: follows bonds that are stretched, break and form while a drive moves the slider."""

    role = "pulling"
    error_of = "the force"

    def warm_up(
        self, lattice: ReactionLattice, drive: Drive, temperature: float
    ) -> None:
        """Compile what :meth:`run` will need."""
        self.run(lattice, drive, [0.0], temperature=temperature)

    @abstractmethod
    def _run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: np.ndarray,
        temperature: float,
        seed: Seed,
        start: Start,
        partners: Partners | None,
    ) -> PullHistory:
        """Run on validated input: ``times`` (m,) s, not before the end of ``start``; ``partners`` None where sites keep
        theirs. One that follows ramps adds ``ramp=None``: a :class:`Ramp` as :meth:`Ramp.checked` gives it."""

    def run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: Sequence[float] | np.ndarray,
        *,
        temperature: QuantityLike,
        seed: Seed = 0,
        start: Start = None,
        partners: Partners | None = None,
        ramp: Ramp | None = None,
    ) -> PullHistory:
        """Pull at the bonds on ``lattice`` and give force and bonds at each of ``times``.

        Parameters
        ----------
        lattice
            Sites, barriers and couplings; its breaking barriers are those that the force lowers.
        drive
            What pulls.
        times
            (m,) seconds since the contact was made, non-decreasing, ≥ 0; the pull begins at the time of ``start``.
        temperature
            Kelvin, or a string with its unit.
        seed
            An int or a ``numpy.random.SeedSequence``; the same seed gives the same bytes.
        start
            None (nothing bonded at time 0), a bool array (n,), a hold, whose bonds are unstretched, or a pull, which
            goes on. With the same lattice, drive, temperature and seed it goes on bit for bit.
        partners
            What sites meet, where the drive renews their partners; see :func:`chemage.plugin.partners_of`.

        Raises
        ------
        InputError
            Naming the argument that is wrong.
        """
        expect(
            "lattice",
            lattice,
            ReactionLattice,
            "make one with chemistry.on(contact), or from arrays",
        )
        expect(
            "drive", drive, Drive, "make one with chemage.plugin.Drive(speed=...)"
        )
        moments, kelvin = check_times(times), temperature_value(temperature)
        if not isinstance(seed, np.random.SeedSequence):
            seed = checked_seed(seed)
        n = lattice.sites.size
        if lattice.states is not None:
            raise InputError(
                f"lattice: a pull follows sites that are free or bonded, but these are {', '.join(lattice.states)}; hold "
                "without a drive, or leave out the transitions"
            )
        if lattice.breaking is None:
            raise InputError(
                "lattice: bonds last on it, so that no force breaks them; give breaking barriers"
            )
        start = checked_start(start, Followed, lattice, moments, "times")
        if drive.partner == "renewed" and partners is None:
            raise InputError(
                "partners: sites meet others; give chemage.plugin.partners_of(...), or partner='kept'"
            )
        if partners is not None:
            spacing = partners.spacing if drive.spacing is None else drive.spacing
            partners = partners._replace(spacing=spacing)
            quantiles = min(partners.forming.size, partners.breaking.size)
            if partners.shift.shape != (n,) or quantiles < 2 or not spacing > 0:
                raise InputError(
                    "partners: give two quantiles or more of each barrier, one shift for each site, and a spacing above 0"
                )
        how = {}
        if ramp is not None:
            how["ramp"] = ramp.checked(lattice, kelvin, drive.speed)
            if not takes(self._run, "ramp"):
                raise InputError(
                    f"pulling {self.kind!r} takes no ramp; pull in steps"
                )
        if drive.partner == "kept":
            partners = None
        with recording() as recorded:
            pulled = self._run(
                lattice, drive, moments, kelvin, seed, start, partners, **how
            )
        return pulled.finished(start, recorded)


def pulling(kind: str, **options: Any) -> Any:
    """An engine that follows the bonds of a contact that is pulled."""
    return registry.current().make("pulling", kind, options)


def pull(
    engine: Pulling,
    lattice: ReactionLattice,
    drive: Drive,
    times: Sequence[float] | np.ndarray,
    *,
    temperature: QuantityLike,
    seed: Seed = 0,
    start: Start = None,
    ramp: Ramp | None = None,
    contact: ContactSolution | None = None,
    chemistry: Chemistry | None = None,
) -> PullHistory:
    """Pull one replica, through the hook ``chemage_pull_bonds``; arguments as for :meth:`Pulling.run`.

    With a ``chemistry`` and the ``contact`` on which the lattice was made, new partners have its barriers. The plugins
    that took part are noted in the ``provenance`` of the result.

    Raises
    ------
    PluginError
        What the engine or a plugin gave contradicts itself or the lattice.
    """
    expect(Pulling.role, engine, Pulling, 'make one with chemage.pulling("...")')
    expect("drive", drive, Drive, "make one with chemage.plugin.Drive(speed=...)")
    partners = None
    if drive.partner == "renewed" and chemistry is not None and contact is not None:
        partners = partners_of(chemistry, lattice, contact)
    pulled, took_part, recorded = registry.current().answer(
        "chemage_pull_bonds",
        PullHistory,
        engine=engine,
        lattice=lattice,
        drive=drive,
        times=check_times(times),
        temperature=temperature_value(temperature),
        seed=seed,
        start=start,
        partners=partners,
        ramp=ramp,
        contact=contact,
        chemistry=chemistry,
    )
    return noted(pulled, recorded, took_part, engine)


@displays(PullHistory)
class PullDisplay(OfRecord[PullHistory]):
    """A pull as users see it."""

    def facts(self) -> Rows:
        pull = self.record
        return [
            ("sites", str(pull.state.size)),
            (
                "peak",
                f"{pull.peak:.4g} nN at {pull.peak_displacement:.4g} nm, {pull.peak_time:.4g} s",
            ),
            (
                f"at {pull.time:g} s",
                f"{pull.force[-1]:.4g} nN, {pull.bonds[-1]} bonds",
            ),
            (
                "work",
                f"{pull.work[-1]:.4g} nN nm, of which {pull.dissipated[-1]:.4g} nN nm were lost with bonds",
            ),
            ("formed and broken so far", f"{pull.formed[-1]}, {pull.broken[-1]}"),
            (
                "slips",
                f"{pull.avalanches.sum()}, the largest by {pull.largest_drop:.4g} nN",
            ),
            ("temperature", f"{pull.temperature:g} K"),
            ("pulled by", pull.engine),
        ]

    def pictures(self) -> dict[str, Picture]:
        return {
            "pull": Picture(
                (
                    Panel(
                        self._draw,
                        "Force of the drive against the displacement of the slider.",
                    ),
                )
            )
        }

    def _draw(self, axes: Axes, medium: Medium) -> None:
        pull = self.record
        axes.plot(pull.displacement, pull.force, color=BLUE, lw=1.2)
        axes.plot([pull.peak_displacement], [pull.peak], "o", color=BLUE, ms=3.5)
        axes.set(xlabel="displacement (nm)", ylabel="force (nN)")
        from_zero(axes)
