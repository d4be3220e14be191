"""Two other boundary element codes as contact solvers, for comparison: Tamaas and ContactMechanics.

Neither is a dependency: a library is imported when its solver is checked or used, and not before. Both receive the
problem without units (edge of a pixel, rms height and nominal pressure are 1), so that no tolerance of theirs is a
length or a force, and what they return is judged by the operator of ``fft-bem``.
"""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from chemage import ContactSolution, InputError, Surface, errors
from chemage.plugin import ConvergenceError, Unit, threads
from chemage_contact._grid import Convolution
from chemage_contact._operators import (
    Floats,
    FreeHalfSpace,
    PeriodicHalfSpace,
    Team,
)
from chemage_contact._solvers import GRID, NO_LOAD, HalfSpaceSolver

#: multiple of the tolerance that errors of the gap may have where a library does not say whether it converged
MARGIN = 100.0

_TAMAAS = """@article{frerot2020,
  author = {Fr{\\'e}rot, L. and Anciaux, G. and Rey, V. and Pham-Ba, S. and Molinari, J.-F.},
  title = {Tamaas: a library for elastic-plastic contact of periodic rough surfaces},
  journal = {Journal of Open Source Software},
  volume = {5},
  pages = {2121},
  year = {2020},
  doi = {10.21105/joss.02121},
}"""

_ROETTGER = """@article{roettger2022,
  author = {R{\\"o}ttger, M. C. and others},
  title = {Contact.engineering---{Create}, analyze and publish digital surface twins from topography measurements across many scales},
  journal = {Surface Topography: Metrology and Properties},
  volume = {10},
  pages = {035032},
  year = {2022},
  doi = {10.1088/2051-672X/ac860a},
}"""  # noqa: E501


class PeerSolution(NamedTuple):
    """What a library returns: pressure in units of the nominal one, iterations, and whether it says that it
    converged; None: it does not say."""

    pressure: Floats
    iterations: int
    converged: bool | None


class Peer(HalfSpaceSolver):
    """A library that solves the hard-wall contact on an elastic half-space, and the measure of its errors."""

    library: ClassVar[str]
    """name of the distribution, and in lower case of the extra of chemage that installs it"""
    module: ClassVar[str]

    tolerance: float = Field(default=1e-6, gt=0, lt=1, allow_inf_nan=False)
    """relative error at which the library stops, by its own measure; ``convergence`` has the errors of the gap as
    ``fft-bem`` measures them"""
    max_iterations: int = Field(default=10_000, ge=1)
    """largest number of iterations"""

    @property
    def limit(self) -> float | None:
        """Largest pressure, GPa; None: the body is elastic at any pressure."""
        return getattr(self, "hardness", None)

    @abstractmethod
    def _answer(
        self,
        library: Any,
        heights: Floats,
        stiffness: float,
        ceiling: float,
        periodic: bool,
    ) -> PeerSolution:
        """The contact of ``heights`` with an rms of 1 on pixels of 1 under a mean pressure of 1; ``stiffness`` is the
        contact modulus in these units, ``ceiling`` the largest pressure."""

    @property
    def declared_error(self) -> float | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As of ``fft-bem``; none where the pressure is limited, which has no closed form here."""
        return min(1e-3 + 30 * self.tolerance, 1.0) if self.limit is None else None

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`chemage.plugin.ContactSolver.check`; the library must be installed."""
        self._imported()
        if surface.keys() >= GRID:
            self._check_limit(
                load / (surface["nx"] * surface["ny"] * surface["pixel_size"] ** 2)
            )

    def _imported(self) -> Any:
        with warnings.catch_warnings(action="ignore"):  # that there is no MPI
            return errors.optional_module(self.module, self.library.lower())

    def _check_limit(self, pressure: float) -> None:
        if self.limit is not None and pressure >= self.limit:
            raise InputError.of(
                "hardness",
                self.limit,
                f"the nominal pressure is {pressure:.6g} GPa, which no contact area can carry",
                f"give a hardness above {pressure:.6g} GPa, or a smaller load",
            )

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        library, periodic = (
            self._imported(),
            self.is_nominally_flat(surface.periodic),
        )
        nominal, size = load / surface.nominal_area, surface.pixel_size
        self._check_limit(nominal)
        heights = np.array(surface.heights, dtype=np.float64)
        heights -= heights.mean()
        unit = float(heights.std())
        if min(heights.shape) < 2 or not unit > 1e-12 * float(
            np.abs(surface.heights).max()
        ):
            raise InputError(
                f"contact {self.kind!r} needs two pixels along each side and heights that differ; use contact 'fft-bem'"
            )
        answer = PeerSolution(np.zeros(surface.shape), 0, True)
        measures = {"tolerance": self.tolerance, "rms_gap": 0.0, "penetration": 0.0}
        if load > 0:
            stiffness = self.modulus * unit / (size * nominal)
            ceiling = math.inf if self.limit is None else self.limit / nominal
            answer = self._answer(
                library, heights / unit, stiffness, ceiling, periodic
            )
            measures |= _gap_errors(
                answer.pressure, heights / unit, stiffness, ceiling, periodic
            )
        worst = max(measures["rms_gap"], measures["penetration"])
        said = (
            answer.converged
            if answer.converged is not None
            else worst < MARGIN * self.tolerance
        )
        if not said or not math.isfinite(worst):
            raise ConvergenceError(
                f"{self.kind}: {self.library} did not reach the tolerance of {self.tolerance:g} in at most "
                f"{self.max_iterations} iterations (rms gap {measures['rms_gap']:.3g}, penetration "
                f"{measures['penetration']:.3g}): raise max_iterations, or accept a larger tolerance",
                history=[],
                residual=worst,
                tolerance=self.tolerance,
            )
        pressure = answer.pressure * nominal
        if self.limit is not None:
            np.minimum(pressure, self.limit, out=pressure)
        version = (
            str(getattr(library, "__version__", "")).partition("+")[0]
            or "of unknown version"
        )
        force = float(pressure.sum()) * size**2
        if load > 0 and not abs(force / load - 1.0) < 1e-3:
            raise ConvergenceError(
                f"{self.kind}: the pressure adds up to {force:.6g} nN, the load is {load:.6g} nN"
            )
        return self.solution(
            surface,
            pressure=pressure,
            load=load,
            residual=worst,
            iterations=answer.iterations,
            convergence=measures
            | {"force_error": abs(force / load - 1.0) if load > 0 else 0.0},
            notes=() if load > 0 else NO_LOAD,
            provenance=self.provenance(surface)
            | {"library": f"{self.library} {version}"},
        )


def _gap_errors(
    pressure: Floats,
    heights: Floats,
    stiffness: float,
    ceiling: float,
    periodic: bool,
) -> dict[str, float]:
    """rms gap where the pressure is between 0 and its largest value, and largest penetration where it is 0, relative to
    the rms height, from the pressure alone."""
    make = PeriodicHalfSpace if periodic else FreeHalfSpace
    body = make(pressure.shape, (1.0, 1.0))  # pyright: ignore[reportArgumentType]
    with Team(threads.available()) as team:
        operator = Convolution(
            body, body.symbol(), np.float64, "scipy", team, floating=False
        )
        gap = operator.apply(pressure) / stiffness - heights
    elastic, open_ = (
        (pressure > 0) & (pressure < ceiling * (1 - 1e-12)),
        pressure == 0,
    )
    if not elastic.any():
        return {"rms_gap": 0.0, "penetration": 0.0}
    level = float(gap[elastic].mean())
    deepest = level - float(gap[open_].min()) if open_.any() else 0.0
    return {
        "rms_gap": float(np.std(gap[elastic])),
        "penetration": max(deepest, 0.0),
    }


class Tamaas(Peer):
    """Hard-wall contact by Tamaas, a library under the AGPL-3.0: whoever offers its results as a service must offer
    the source as well. chemage is not derived from it, does not install it, and imports it only where this solver is
    chosen: ``pip install 'chemage[tamaas]'``.

    Algorithms of Polonsky and Keer as improved by Rey, and with a ``hardness`` the one of Kato, which limits the
    pressure. Periodic surfaces only. Tamaas does not say how many iterations it made.
    """

    kind = "tamaas"
    library = "tamaas"
    module = "tamaas"
    cite = (
        "L. Frérot, G. Anciaux, V. Rey, S. Pham-Ba, J.-F. Molinari, J. Open Source Softw. 5, 2121 (2020)",
    )
    bibtex = (_TAMAAS,)

    boundary: Literal["auto", "periodic"] = "auto"
    """periodic: repeat also a surface that is not periodic; auto: refuse one"""
    hardness: Annotated[Any, Unit("GPa", gt=0)] | None = None
    """largest pressure, GPa; default: the body is elastic at any pressure"""

    def is_nominally_flat(self, periodic: bool) -> bool:
        """It is: others are refused."""
        return True

    def check(self, surface: Mapping[str, float], load: float) -> None:
        """See :meth:`Peer.check`."""
        self._check_periodic(
            surface.get("periodic", 0.0 if "radius" in surface else 1.0) != 0
        )
        super().check(surface, load)

    def _check_periodic(self, periodic: bool) -> None:
        if not periodic and self.boundary == "auto":
            raise InputError(
                "contact 'tamaas' needs a periodic surface, and this one is not: use contact 'fft-bem' or "
                "'contactmechanics', or repeat it with boundary = 'periodic'"
            )

    def _solve(
        self, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        self._check_periodic(surface.periodic)
        return super()._solve(surface, load, start)

    def _answer(
        self,
        library: Any,
        heights: Floats,
        stiffness: float,
        ceiling: float,
        periodic: bool,
    ) -> PeerSolution:
        library.set_log_level(library.LogLevel.error)
        model = library.ModelFactory.createModel(
            library.model_type.basic_2d,
            [float(n) for n in heights.shape],
            list(heights.shape),
        )
        model.E, model.nu = stiffness, 0.0

        def solved(solver: Any) -> tuple[Floats, float]:
            solver.max_iter = self.max_iterations
            try:
                error = float(solver.solve(1.0))
            except FloatingPointError as failure:
                raise ConvergenceError(f"{self.kind}: {failure}") from failure
            return np.array(model.traction, dtype=np.float64).reshape(
                heights.shape
            ), error

        if math.isfinite(ceiling):
            pressure, _ = solved(
                library.KatoSaturated(model, heights, self.tolerance, ceiling)
            )
            if float(pressure.max()) >= ceiling * (1 - 1e-12):
                return PeerSolution(
                    pressure, 0, None
                )  # it returns 0 whatever its error is
            # nothing flows; contacts of a few pixels are elastic, and it stops before it has solved them
            model.traction[...] = 0.0
        pressure, error = solved(
            library.PolonskyKeerRey(model, heights, self.tolerance)
        )
        return PeerSolution(pressure, 0, error <= self.tolerance)


class ContactMechanics(Peer):
    """Hard-wall contact by ContactMechanics (MIT licence), imported only where this solver is chosen: ``pip install
    'chemage[contactmechanics]'``.

    Conjugate gradients of Polonsky and Keer with restarts, on a periodic or a free half-space.
    """

    kind = "contactmechanics"
    library = "ContactMechanics"
    module = "ContactMechanics"
    cite = ("M. C. Röttger et al., Surf. Topogr.: Metrol. Prop. 10, 035032 (2022)",)
    bibtex = (_ROETTGER,)

    boundary: Literal["auto", "periodic", "free"] = "auto"
    """periodic or free (an isolated contact on an infinite half-space); auto: periodic if the surface is"""

    def _answer(
        self,
        library: Any,
        heights: Floats,
        stiffness: float,
        ceiling: float,
        periodic: bool,
    ) -> PeerSolution:
        with warnings.catch_warnings(action="ignore"):
            from SurfaceTopography import Topography

            sides = tuple(float(n) for n in heights.shape)
            half_space = (
                library.PeriodicFFTElasticHalfSpace
                if periodic
                else library.FreeFFTElasticHalfSpace
            )
            substrate = half_space(heights.shape, stiffness, sides)
            topography = Topography(
                heights, physical_sizes=sides, periodic=periodic
            )
            system = library.Systems.NonSmoothContactSystem(substrate, topography)
            found = system.minimize_proxy(
                external_force=float(heights.size),
                pentol=self.tolerance,
                maxiter=self.max_iterations,
            )
        force = np.asarray(found.jac, dtype=np.float64)[
            : heights.shape[0], : heights.shape[1]
        ]
        return PeerSolution(
            np.maximum(np.sign(force.sum()) * force, 0.0),
            int(found.nit),
            bool(found.success),
        )
