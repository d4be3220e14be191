"""Speed against accuracy, measured on a user's own scene.

The map of settings and of their combinations is measured by :mod:`chemage.studies.trade.mapping`; this adds rows about
the first of its surfaces. Each option that a component of any section declares for it (``Component.trade``: option ->
values from fast to accurate) is varied on its own, everything else as in the scene, and the result is compared with
that of a reference which is more accurate than all of them (``Component.reference``). Replicas keep their disorder and
their kinetic noise, so that the difference in β is due to the option; its standard error is that of the paired
difference. A surface that can be sampled more coarsely is, every installed engine that can treat the lattice runs it,
and replicas are traded against the error of β.

All errors of the area are errors of :attr:`ContactSolution.corrected_area`, which depends least on the pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

import numpy as np

from chemage.ageing.aging import Aging
from chemage.contacts.role import ContactTheory, no_map
from chemage.contacts.solution import ContactSolution
from chemage.foundation import threads
from chemage.foundation.approximations import in_words
from chemage.foundation.checks import checked_count
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError
from chemage.foundation.statistics import half_width, standard_error
from chemage.foundation.text import jsonable
from chemage.plugins import registry
from chemage.plugins.sources import approximations
from chemage.scene.run import aged
from chemage.scene.scene import Scene
from chemage.scene.variants import coarser, vanishing_pixels
from chemage.studies.trade.choices import ENGINE, grid, of_value
from chemage.studies.trade.mapping import Computed, Mapper, timed
from chemage.studies.trade.settings import COARSER, REPLICAS, Setting, planned, settings, with_section
from chemage.studies.trade.settings import reference as best_of
from chemage.studies.trade.trade_map import WITHIN, TradeMap

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
    #: the same settings and their combinations on several surfaces, measured repeatedly
    map: TradeMap | None = None

    def todict(self) -> dict[str, Any]:
        """One JSON-able object; nan is None."""
        found: dict[str, Any] = {"rows": [asdict(row) for row in self.rows], "notes": self.notes}
        if self.map is not None:
            cheapest = [self.map.cheapest(name, within) for name in self.map.observables for within in WITHIN]
            found |= {
                "map": self.map.todict(),
                "cheapest": [one.todict() for one in cheapest],
                "sentences": self.map.sentences(),
            }
        return jsonable({"scene": self.scene, **found})


def tradeoff(scene: Scene, *, rounds: int | None = None, report: Report | None = None) -> Tradeoff:
    """Measure what each value of the options of ``scene`` costs and how large its errors are, and the map of their
    combinations.

    Everything is compiled before it is timed. ``rounds`` is how often everything is computed for the map, each time on
    another surface where the surface is random; default: three to six, by the cost of the scene.
    """
    if rounds is not None:
        checked_count("rounds", rounds)
    with scene.in_use(), threads.restored():
        threads.limit(1)  # CPU times of several threads depend on how busy the machine is
        return _Measurement(scene, rounds, report or (lambda _: None)).run()


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
    """The rows, from the first round of the map."""

    def __init__(self, scene: Scene, rounds: int | None, report: Report) -> None:
        # every contact has the gap if sites need it
        self.scene, self.report = scene.model_copy(update={"contact": scene.solver}), report
        self.found = Tradeoff(scene.name)
        self._given, self._rounds = scene, rounds

    def run(self) -> Tradeoff:
        if isinstance(self.scene.contact, ContactTheory):
            raise InputError(no_map(self.scene.contact, "there is no pressure whose error could be measured"))
        self.report(f"the scene as it is, to compile; then {planned(self.scene)}")
        self.mapper = Mapper(self._given, rounds=self._rounds, report=self.report)
        self.mapper.warm_up()
        self.mapper.begin(0)
        contact = self.mapper.compute().contact
        by_section: dict[str, list[Setting]] = {}
        for setting in settings(self.scene):
            by_section.setdefault(setting.section, []).append(setting)
            if len(setting.values) < setting.named:
                self.found.notes.append(f"{setting.name}: {len(setting.values)} of {setting.named} values are tried")
        # the contact first, whose references and errors are known best
        for section in sorted(by_section, key=lambda name: name != "contact"):
            self._section(section, by_section[section])
        self._pixels(contact)
        if self.scene.chemistry is not None:
            self._engines(contact)
            self._replicas(contact)
        self.mapper.first_round()
        self.mapper.further_rounds()
        self.found.map = self.mapper.made()
        return self.found

    def _section(self, section: str, found: list[Setting]) -> None:
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
        own = self._given.sections()[section]
        reference = self._reference(section, own, found)
        for setting in found:
            for value in setting.values:
                self.report(f"{setting.name} = {value}")
                same = value == setting.of(own)
                stage = "contact" if section in ("surface", "contact") else "ageing"
                try:
                    turned = own if same else setting.turned(own, value)
                    computed = self.mapper.compute(() if same else (of_value(setting, value, stage),))
                except ChemageError as error:
                    self._add(setting.name, value, remark=str(error))
                    continue
                solution, aging = computed.contact, computed.aging
                comparable = reference if reference and _same_grid(solution, reference.contact) else None
                self._add(
                    setting.name,
                    value,
                    _stage_seconds(section, computed),
                    **areas(solution),
                    **self._errors(solution, reference, setting, value),
                    pressure_estimate=estimated_error(solution) if section == "contact" else math.nan,
                    **self._beta(aging),
                    **self._difference(aging, comparable.aging if comparable else None),
                    own=same,
                    remark="; ".join(
                        filter(
                            None, [f"{solution.iterations} iterations" if section == "contact" else "", _marked(turned)]
                        )
                    ),
                )

    def _reference(self, section: str, own: Component, found: list[Setting]) -> _Reference | None:
        """The reference of a section; None if it cannot be computed."""
        self.report(f"reference {section}")
        options = ""
        try:
            best = best_of(own)
            prefix = f"{section}."
            options = ", ".join(f"{one.name.removeprefix(prefix)} = {one.of(best)}" for one in found)
            computed = self.mapper.computed(with_section(self._given, section, best))
        except ChemageError as error:
            self.found.notes.append(f"{section}: no reference ({options}), so errors are not measured: {error}")
            return None
        made = _Reference(best, computed.contact, computed.aging)
        if section == "contact":
            known = "not known" if math.isnan(made.error) else f"estimated as {made.error:.1e}"
            what = f"errors are differences from a reference ({options}); its own error of the pressure is {known}"
        else:
            what = f"differences are those from a reference ({options}), whose own error is not known"
        self.found.notes.append(f"{section}: {what}")
        return made

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

    def _pixels(self, fine: ContactSolution) -> None:
        """The same surface on coarser pixels: area and contour, but not β, because a pixel is a site."""
        found: list[tuple[ContactSolution, float, float]] = []
        for factor in (*COARSER, 1):
            if factor > 1 and coarser(self._given, factor) is None:
                continue
            self.report(f"pixels {factor} times larger")
            computed = self.mapper.compute((grid(factor),) if factor > 1 else ())
            making, solving = computed.solved.making, computed.solved.solving
            found.append((computed.contact, making.cpu + solving.cpu, making.wall + solving.wall))
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
            if (reason := self.mapper.slow.get((ENGINE, kind))) is not None:
                self._add("engine", kind, remark=reason)
                continue
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
        one, two = self.mapper.betas(aging), self.mapper.betas(other)
        if one is None or two is None or len(one) != len(two):
            return {}
        each = one - two
        return {
            "beta_difference": float(each.mean()),
            "beta_difference_stderr": float(standard_error(each)),
            "beta_difference_half_width": float(half_width(each)),
        }

    def _add(
        self, option: str, setting: Any, seconds: tuple[float, float] = (math.nan, math.nan), **found: Any
    ) -> None:
        self.found.rows.append(Row(option, str(setting), *seconds, **found))


def _stage_seconds(section: str, computed: Computed) -> tuple[float, float]:
    """CPU and wall seconds of the stage to which a section belongs."""
    stages = {"surface": computed.solved.making, "contact": computed.solved.solving}
    seconds = stages.get(section, computed.ageing)
    return seconds.cpu, seconds.wall


def _same_grid(one: ContactSolution, other: ContactSolution) -> bool:
    """Whether pixels, which are sites, are the same, so that β can be compared."""
    return one.shape == other.shape and one.pixel_size == other.pixel_size


def _marked(component: Component) -> str:
    """What is approximate about a component, for the remark of its row."""
    text = in_words(approximations(component))
    return f"approximate: {text}" if text else ""


def measured(task: Callable[[], T]) -> tuple[T, float, float]:
    """What ``task`` returns, its CPU seconds over all threads, its wall seconds."""
    result, seconds = timed(task)
    return result, seconds.cpu, seconds.wall


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
