"""Speed against accuracy, measured on a user's own scene.

Each option that a component of any section declares for it (``Component.trade``: option -> values from fast to
accurate) is varied on its own, everything else as in the scene, and the result is compared with that of a reference
which is more accurate than all of them (``Component.reference``). Replicas keep their disorder and their kinetic noise,
so that the difference in β is due to the option; its standard error is that of the paired difference. A surface that
can be sampled more coarsely is, every installed engine that can treat the lattice runs it, and replicas are traded
against the error of β.

All errors of the area are errors of :attr:`ContactSolution.corrected_area`, which depends least on the pixels.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

import numpy as np

from chemage.ageing.aging import Aging
from chemage.ageing.paired import paired_difference
from chemage.contacts.solution import ContactSolution
from chemage.contacts.stage import solve_contact
from chemage.experiments.extrapolation import vanishing_pixels
from chemage.experiments.run import aged
from chemage.experiments.scene import Scene
from chemage.experiments.sections import sections
from chemage.experiments.settings import COARSER, REPLICAS, Setting, planned, settings, with_section
from chemage.experiments.settings import reference as best_of
from chemage.foundation.approximations import in_words
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.text import jsonable
from chemage.plugins import registry
from chemage.plugins.sources import approximations
from chemage.surfaces.stage import make_surface
from chemage.surfaces.surface import Surface

T = TypeVar("T")
#: called with what is being measured
Report = Callable[[str], None]
#: A difference from the reference is the error of a setting if it is so many times the error of the reference.
_RESOLVED = 10.0
#: standard errors on either side that hold the truth in 95 % of cases, where the error is a normal one
NORMAL_LIMIT = 1.96


@dataclass(frozen=True)
class Row:
    """One value of one option. What is not known is nan: errors that the reference does not resolve, for example."""

    option: str
    setting: str
    #: of the stage that the option belongs to, summed over threads
    cpu_seconds: float
    wall_seconds: float
    #: pixels in contact
    area_fraction: float = math.nan
    #: corrected area over nominal area
    corrected_fraction: float = math.nan
    #: of the corrected area, relative
    area_error: float = math.nan
    #: standard error of ``area_error``, where it rests on an extrapolation, and half the width of its 95 % interval
    area_error_stderr: float = math.nan
    area_error_half_width: float = math.nan
    #: L2 norm of the difference from the reference over all pixels, relative
    pressure_error: float = math.nan
    #: the same as the solver itself estimates it, without the reference
    pressure_estimate: float = math.nan
    beta: float = math.nan
    #: standard error over replicas, and half the width of Student's 95 % interval
    beta_stderr: float = math.nan
    beta_half_width: float = math.nan
    #: β less that of the reference, or of the engine of the scene
    beta_difference: float = math.nan
    #: of the paired difference over replicas, as for ``beta``
    beta_difference_stderr: float = math.nan
    beta_difference_half_width: float = math.nan
    #: whether the scene has this value
    own: bool = False
    remark: str = ""


@dataclass
class Tradeoff:
    """Every measured row, by option, from fast to accurate."""

    scene: str
    rows: list[Row] = field(default_factory=list)
    #: what the errors are relative to, in words
    notes: list[str] = field(default_factory=list)

    def todict(self) -> dict[str, Any]:
        """One JSON-able object; nan is None."""
        return jsonable({"scene": self.scene, "rows": [asdict(row) for row in self.rows], "notes": self.notes})


def tradeoff(scene: Scene, *, report: Report | None = None) -> Tradeoff:
    """Measure what each value of the options of ``scene`` costs and how large its errors are.

    Every setting runs once on a small or coarse surface before it is timed, so that compilation is not counted.
    """
    with scene.in_use():
        return _Measurement(scene, report or (lambda _: None)).run()


@dataclass(frozen=True)
class _Reference:
    """The result that others are compared with, and the component of the section with which it was made."""

    component: Component
    contact: ContactSolution
    aging: Aging | None

    @property
    def error(self) -> float:
        """Its relative error of the pressure, as its solver estimates it; nan if it does not."""
        return estimated_error(self.contact)

    def resolves(self, setting: Setting, value: Any, difference: float) -> bool:
        """Whether ``difference`` from this result is the error of one with the option of ``setting`` at ``value``."""
        if setting.section == "contact" and not math.isnan(self.error):
            return difference >= _RESOLVED * self.error
        # nothing shows that the reference is better than a result with the same value
        return setting.of(self.component) != value


class _Measurement:
    def __init__(self, scene: Scene, report: Report) -> None:
        # every contact has the gap if sites need it
        self.scene, self.report = scene.model_copy(update={"contact": scene.solver}), report
        self.found = Tradeoff(scene.name)

    def run(self) -> Tradeoff:
        self.report(f"the scene as it is, to compile; then {planned(self.scene)}")
        surface = make_surface(self.scene.surface, self.scene.surface_seed)
        contact = solve_contact(self.scene.contact, surface, self.scene.load)
        by_section: dict[str, list[Setting]] = {}
        for setting in settings(self.scene):
            by_section.setdefault(setting.section, []).append(setting)
            if len(setting.values) < setting.named:
                self.found.notes.append(f"{setting.name}: {len(setting.values)} of {setting.named} values are tried")
        # the contact first, whose references and errors are known best
        for section in sorted(by_section, key=lambda name: name != "contact"):
            self._section(section, by_section[section], surface, contact)
        self._pixels(contact)
        if self.scene.chemistry is not None:
            self._engines(contact)
            self._replicas(contact)
        return self.found

    def _section(self, section: str, found: list[Setting], surface: Surface, contact: ContactSolution) -> None:
        """Every setting of the component of a section, with the stage that it belongs to."""
        names = ", ".join(setting.name for setting in found)
        if section.startswith("observe"):
            self.found.notes.append(
                f"{names}: not tried, because an option of an observable changes what is measured, and not β"
            )
            return
        if section not in ("surface", "contact") and not self.scene.ages:
            self.found.notes.append(f"{names}: not tried, because the scene stops at the contact")
            return
        own = sections(self.scene)[section]

        def computed(component: Component) -> tuple[ContactSolution, Aging | None, tuple[float, float]]:
            return self._computed(section, component, surface, contact)

        reference = self._reference(section, own, found, computed)
        for setting in found:
            for value in setting.values:
                self.report(f"{setting.name} = {value}")
                try:
                    turned = setting.turned(own, value)
                    if section == "contact":
                        self._warm(turned, surface)
                    solution, aging, seconds = computed(turned)
                except ChemageError as error:
                    self._add(setting.name, value, remark=str(error))
                    continue
                comparable = reference if reference and _same_grid(solution, reference.contact) else None
                self._add(
                    setting.name,
                    value,
                    seconds,
                    **areas(solution),
                    **self._errors(solution, reference, setting, value),
                    pressure_estimate=estimated_error(solution) if section == "contact" else math.nan,
                    **self._beta(aging),
                    **self._difference(aging, comparable.aging if comparable else None),
                    own=turned == own,
                    remark="; ".join(
                        filter(
                            None, [f"{solution.iterations} iterations" if section == "contact" else "", _marked(turned)]
                        )
                    ),
                )

    def _computed(
        self, section: str, component: Any, surface: Surface, contact: ContactSolution
    ) -> tuple[ContactSolution, Aging | None, tuple[float, float]]:
        """Contact and ageing with another component in a section, and the CPU and wall seconds of its stage."""
        if section == "surface":
            made, *seconds = measured(lambda: make_surface(component, self.scene.surface_seed))
            solution = solve_contact(self.scene.contact, made, self.scene.load)
            return solution, self._aged(solution, common="all"), (seconds[0], seconds[1])
        if section == "contact":
            solution, *seconds = measured(lambda: solve_contact(component, surface, self.scene.load))
            return solution, self._aged(solution, common="all"), (seconds[0], seconds[1])
        scene = with_section(self.scene, section, component)
        aged(scene, contact, observe=(), common="all", replicas=1)  # to compile
        aging, *seconds = measured(lambda: aged(scene, contact, observe=(), common="all"))
        return contact, aging, (seconds[0], seconds[1])

    def _reference(
        self, section: str, own: Component, found: list[Setting], computed: Callable[[Component], Any]
    ) -> _Reference | None:
        """The reference of a section; None if it cannot be computed."""
        self.report(f"reference {section}")
        options = ""
        try:
            best = best_of(own)
            prefix = f"{section}."
            options = ", ".join(f"{one.name.removeprefix(prefix)} = {one.of(best)}" for one in found)
            contact, aging, _ = computed(best)
        except ChemageError as error:
            self.found.notes.append(f"{section}: no reference ({options}), so errors are not measured: {error}")
            return None
        made = _Reference(best, contact, aging)
        if section == "contact":
            known = "not known" if math.isnan(made.error) else f"estimated as {made.error:.1e}"
            what = f"errors are differences from a reference ({options}); its own error of the pressure is {known}"
        else:
            what = f"differences are those from a reference ({options}), whose own error is not known"
        self.found.notes.append(f"{section}: {what}")
        return made

    def _warm(self, solver: Any, surface: Surface) -> None:
        """Solve a smaller contact, so that compilation is not counted."""
        small = self._small(surface)
        solve_contact(solver, small, self.scene.load * small.nominal_area / surface.nominal_area)

    @staticmethod
    def _errors(
        contact: ContactSolution, reference: _Reference | None, setting: Setting, value: Any
    ) -> dict[str, float]:
        """Errors of area and pressure, of settings of which these depend."""
        if reference is None or setting.section not in ("surface", "contact"):
            return {}
        pressure = math.nan
        if _same_grid(contact, reference.contact):
            pressure = l2_error(contact.pressure, reference.contact.pressure)
        if not reference.resolves(setting, value, pressure):
            return {}
        return {
            "area_error": relative(contact.corrected_area, reference.contact.corrected_area),
            "pressure_error": pressure,
        }

    def _small(self, surface: Surface) -> Surface:
        maker = self.scene.surface.coarser(COARSER[0])
        return surface if maker is None else make_surface(maker, self.scene.surface_seed)

    def _pixels(self, fine: ContactSolution) -> None:
        """The same surface on coarser pixels: area and contour, but not β, because a pixel is a site."""
        found: list[tuple[ContactSolution, float, float]] = []
        for factor in (*COARSER, 1):
            maker = self.scene.surface.coarser(factor) if factor > 1 else self.scene.surface
            if maker is None:
                continue
            self.report(f"pixels {factor} times larger")
            found.append(
                measured(
                    lambda maker=maker: solve_contact(
                        self.scene.contact, make_surface(maker, self.scene.surface_seed), self.scene.load
                    )
                )
            )
        limit = vanishing_pixels([contact for contact, _, _ in found])
        known: dict[str, float] = {}
        if limit is not None:
            self.found.notes.append(
                f"surface.pixels: errors are differences from {limit.area / fine.nominal_area:.5f}, the corrected A/A0 "
                f"extrapolated to vanishing pixels"
            )
            error = limit.area_stderr / limit.area
            known = {"area_error_stderr": error, "area_error_half_width": NORMAL_LIMIT * error}
        for contact, cpu, wall in found:
            self._add(
                "surface.pixels",
                f"{contact.shape[0]} x {contact.shape[1]}",
                (cpu, wall),
                **areas(contact),
                area_error=relative(contact.corrected_area, limit.area) if limit else math.nan,
                **known,
                own=contact.shape == fine.shape,
            )

    def _engines(self, contact: ContactSolution) -> None:
        """Exact engines differ by noise: the remark is the difference from the scene's own in standard errors.

        All of them run on the same disorder.
        """
        assert self.scene.engine is not None
        plugins = registry.current()
        own = self._aged(contact, common="disorder")
        for kind in plugins.kinds("engine"):
            same = kind == self.scene.engine.kind
            self.report(f"engine {kind}")
            try:
                engine = self.scene.engine if same else plugins.make("engine", kind, {})
                self._aged(contact, engine=engine, replicas=1, common="disorder")
                aging, cpu, wall = measured(lambda engine=engine: self._aged(contact, engine=engine, common="disorder"))
            except InputError:
                self._add("engine", kind, remark="not for this lattice")
                continue
            difference = {} if same else self._difference(aging, own)
            self._add(
                "engine",
                kind,
                (cpu, wall),
                **areas(contact),
                **self._beta(aging),
                **difference,
                own=same,
                remark="; ".join(filter(None, [away(**difference) if difference else "", _marked(engine)])),
            )

    def _replicas(self, contact: ContactSolution) -> None:
        assert self.scene.hold is not None
        for replicas in sorted({*REPLICAS, self.scene.hold.replicas}):
            self.report(f"{replicas} replicas")
            aging, cpu, wall = measured(lambda replicas=replicas: self._aged(contact, replicas=replicas))
            self._add(
                "hold.replicas",
                replicas,
                (cpu, wall),
                **areas(contact),
                **self._beta(aging),
                own=replicas == self.scene.hold.replicas,
            )

    def _aged(self, contact: ContactSolution, **changes: Any) -> Aging | None:
        return aged(self.scene, contact, observe=(), **changes)

    def _beta(self, aging: Aging | None) -> dict[str, float]:
        try:
            fit = aging.fit(self.scene.fit.start, self.scene.fit.stop) if aging is not None else None
        except InputError:
            fit = None
        if fit is None:
            return {}
        return {"beta": fit.beta, "beta_stderr": fit.beta_stderr, "beta_half_width": fit.beta_half_width}

    def _difference(self, aging: Aging | None, other: Aging | None) -> dict[str, float]:
        """The paired difference of β; empty where there is none."""
        if aging is None or other is None:
            return {}
        try:
            found = paired_difference(aging, other, window=(self.scene.fit.start, self.scene.fit.stop))
        except InputError:
            return {}
        return {
            "beta_difference": found.value,
            "beta_difference_stderr": found.stderr,
            "beta_difference_half_width": found.half_width,
        }

    def _add(
        self, option: str, setting: Any, seconds: tuple[float, float] = (math.nan, math.nan), **found: Any
    ) -> None:
        self.found.rows.append(Row(option, str(setting), *seconds, **found))


def _same_grid(one: ContactSolution, other: ContactSolution) -> bool:
    """Whether pixels, which are sites, are the same, so that β can be compared."""
    return one.shape == other.shape and one.pixel_size == other.pixel_size


def _marked(component: Component) -> str:
    """What is approximate about a component, for the remark of its row."""
    text = in_words(approximations(component))
    return f"approximate: {text}" if text else ""


def measured(task: Callable[[], T]) -> tuple[T, float, float]:
    """What ``task`` returns, its CPU seconds over all threads, its wall seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = task()
    return result, time.process_time() - cpu, time.perf_counter() - wall


def areas(contact: ContactSolution) -> dict[str, float]:
    """The area fractions of a row."""
    return {
        "area_fraction": contact.area_fraction,
        "corrected_fraction": contact.corrected_area / contact.nominal_area,
    }


def estimated_error(contact: ContactSolution) -> float:
    """The relative error of the pressure as the solver estimates it; nan if it does not."""
    error = contact.convergence.get("pressure_error")
    return float(error) if isinstance(error, int | float) else math.nan


def away(beta_difference: float, beta_difference_stderr: float, **_: float) -> str:
    """A difference in standard errors, in words; empty where its error is not known."""
    if not beta_difference_stderr > 0:
        return "the same bonds" if beta_difference == 0 == beta_difference_stderr else ""
    return f"{abs(beta_difference) / beta_difference_stderr:.1f} standard errors away"


def relative(value: float, exact: float) -> float:
    """|value − exact| / |exact|; nan where ``exact`` is 0 or undefined."""
    return abs(value - exact) / abs(exact) if exact else math.nan


def l2_error(values: np.ndarray, exact: np.ndarray) -> float:
    """Relative L2 difference of two arrays of one shape; nan where ``exact`` vanishes."""
    size = float(np.linalg.norm(exact.astype(np.float64).ravel()))
    difference = values.astype(np.float64)
    difference -= exact
    return float(np.linalg.norm(difference.ravel())) / size if size else math.nan
