"""Speed against accuracy, measured on a user's own scene.

Each option that a component declares for it (``Component.trade``: option -> values from fast to accurate) is varied on
its own, everything else as in the scene, and the result is compared with the most accurate one. Replicas keep their
disorder, so β differs by the option and by kinetic noise only; its standard error gives the size of the noise. A
surface that can be sampled more coarsely is, every installed engine that can treat the lattice runs it, and replicas
are traded against the error of β.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

import numpy as np

from chemage.ageing.age import age
from chemage.ageing.aging import Aging
from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.contacts.stage import solve_contact
from chemage.experiments.scene import Scene
from chemage.foundation.errors import ConvergenceError, InputError
from chemage.foundation.text import jsonable
from chemage.plugins import registry
from chemage.surfaces.stage import make_surface
from chemage.surfaces.surface import Surface

T = TypeVar("T")
#: called with what is being measured
Report = Callable[[str], None]
_COARSER = (4, 2)


@dataclass(frozen=True)
class Row:
    """One value of one option. Errors are relative to its reference; nan where there is nothing to compare."""

    knob: str
    setting: str
    #: of the stage that the option belongs to, summed over threads
    cpu_seconds: float
    wall_seconds: float
    area_fraction: float = math.nan
    #: relative
    area_error: float = math.nan
    #: relative L2 over all pixels
    pressure_error: float = math.nan
    beta: float = math.nan
    #: standard error over replicas
    beta_stderr: float = math.nan
    #: whether the scene has this value
    own: bool = False
    remark: str = ""


@dataclass
class Tradeoff:
    """Every measured row, by option, from fast to accurate."""

    scene: str
    rows: list[Row] = field(default_factory=list)

    def todict(self) -> dict[str, Any]:
        """One JSON-able object; nan is None."""
        return jsonable({"scene": self.scene, "rows": [asdict(row) for row in self.rows]})


def tradeoff(scene: Scene, *, report: Report | None = None) -> Tradeoff:
    """Measure what each value of the options of ``scene`` costs and how large its errors are.

    Every setting runs once on a small or coarse surface before it is timed, so that compilation is not counted.
    """
    return _Measurement(scene, report or (lambda _: None)).run()


class _Measurement:
    def __init__(self, scene: Scene, report: Report) -> None:
        self.scene, self.report = scene, report
        self.found = Tradeoff(scene.name)

    def run(self) -> Tradeoff:
        self.report("the scene as it is, to compile")
        surface = make_surface(self.scene.surface, self.scene.surface_seed)
        contact = solve_contact(self.scene.contact, surface, self.scene.load)
        for option, values in self.scene.contact.trade.items():
            self._contact_option(surface, option, values)
        self._pixels(contact)
        if self.scene.chemistry is not None:
            self._engines(contact)
            self._replicas(contact)
        return self.found

    def _contact_option(self, surface: Surface, option: str, values: tuple[Any, ...]) -> None:
        solver = self.scene.contact
        self.report("reference contact")
        exact = solve_contact(self._most_accurate(solver), surface, self.scene.load)
        small = self._small(surface)
        for value in values:
            self.report(f"contact.{option} = {value}")
            try:
                turned = solver.replace(**{option: value})
                solve_contact(turned, small, self.scene.load * small.nominal_area / surface.nominal_area)
                contact, cpu, wall = measured(lambda turned=turned: solve_contact(turned, surface, self.scene.load))
            except (InputError, ConvergenceError) as error:
                self._add(f"contact.{option}", value, remark=str(error))
                continue
            self._add(
                f"contact.{option}",
                value,
                (cpu, wall),
                area_fraction=contact.area_fraction,
                area_error=relative(contact.area, exact.area),
                pressure_error=l2_error(contact.pressure, exact.pressure),
                **self._beta(self._aged(contact)),
                own=turned == solver,
                remark=f"{contact.iterations} iterations",
            )

    @staticmethod
    def _most_accurate(solver: ContactSolver) -> ContactSolver:
        """Every option at its accurate end."""
        return solver.replace(**{option: values[-1] for option, values in solver.trade.items()})

    def _small(self, surface: Surface) -> Surface:
        maker = self.scene.surface.coarser(_COARSER[0])
        return surface if maker is None else make_surface(maker, self.scene.surface_seed)

    def _pixels(self, fine: ContactSolution) -> None:
        """The same surface on coarser pixels: area and contour, but not β, because a pixel is a site."""
        for factor in (*_COARSER, 1):
            maker = self.scene.surface.coarser(factor) if factor > 1 else self.scene.surface
            if maker is None:
                continue
            self.report(f"pixels {factor} times larger")
            contact, cpu, wall = measured(
                lambda maker=maker: solve_contact(
                    self.scene.contact, make_surface(maker, self.scene.surface_seed), self.scene.load
                )
            )
            self._add(
                "surface.pixels",
                f"{contact.shape[0]} x {contact.shape[1]}",
                (cpu, wall),
                area_fraction=contact.area_fraction,
                area_error=relative(contact.corrected_area, fine.corrected_area),
                own=factor == 1,
                remark=f"corrected for pixels {contact.corrected_area / contact.nominal_area:.5f}",
            )

    def _engines(self, contact: ContactSolution) -> None:
        """Exact engines differ by noise: the remark is the difference from the scene's own in standard errors."""
        assert self.scene.engine is not None
        plugins = registry.current()
        own = self._beta(self._aged(contact))
        for kind in plugins.kinds("engine"):
            same = kind == self.scene.engine.kind
            self.report(f"engine {kind}")
            try:
                engine = self.scene.engine if same else plugins.make("engine", kind, {})
                self._aged(contact, engine=engine, replicas=1)
                aging, cpu, wall = measured(lambda engine=engine: self._aged(contact, engine=engine))
            except InputError:
                self._add("engine", kind, remark="not for this lattice")
                continue
            found = self._beta(aging)
            spread = math.hypot(found["beta_stderr"], own["beta_stderr"])
            away = abs(found["beta"] - own["beta"]) / spread if spread > 0 else 0.0
            remark = "" if same else f"{away:.1f} standard errors away"
            self._add(
                "engine", kind, (cpu, wall), area_fraction=contact.area_fraction, **found, own=same, remark=remark
            )

    def _replicas(self, contact: ContactSolution) -> None:
        assert self.scene.hold is not None
        for replicas in sorted({2, 5, 10, 20, self.scene.hold.replicas}):
            self.report(f"{replicas} replicas")
            aging, cpu, wall = measured(lambda replicas=replicas: self._aged(contact, replicas=replicas))
            self._add(
                "hold.replicas",
                replicas,
                (cpu, wall),
                area_fraction=contact.area_fraction,
                **self._beta(aging),
                own=replicas == self.scene.hold.replicas,
            )

    def _aged(self, contact: ContactSolution, engine: Any = None, replicas: int | None = None) -> Aging | None:
        scene = self.scene
        if scene.chemistry is None or scene.hold is None or scene.engine is None:
            return None
        return age(
            contact,
            scene.chemistry,
            engine=engine or scene.engine,
            hold_times=scene.hold.hold_times,
            temperature=scene.hold.temperature,
            replicas=replicas or scene.hold.replicas,
            seed=scene.hold.seed,
            common=scene.hold.common,
        )

    def _beta(self, aging: Aging | None) -> dict[str, float]:
        try:
            fit = aging.fit(self.scene.fit.start, self.scene.fit.stop) if aging is not None else None
        except InputError:
            fit = None
        if fit is None:
            return {"beta": math.nan, "beta_stderr": math.nan}
        return {"beta": fit.beta, "beta_stderr": fit.beta_stderr}

    def _add(self, knob: str, setting: Any, seconds: tuple[float, float] = (math.nan, math.nan), **found: Any) -> None:
        self.found.rows.append(Row(knob, str(setting), *seconds, **found))


def measured(task: Callable[[], T]) -> tuple[T, float, float]:
    """What ``task`` returns, its CPU seconds over all threads, its wall seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = task()
    return result, time.process_time() - cpu, time.perf_counter() - wall


def relative(value: float, exact: float) -> float:
    """|value − exact| / |exact|; nan where ``exact`` is 0 or undefined."""
    return abs(value - exact) / abs(exact) if exact else math.nan


def l2_error(values: np.ndarray, exact: np.ndarray) -> float:
    """Relative L2 difference of two arrays of one shape; nan where ``exact`` vanishes."""
    size = float(np.linalg.norm(exact.astype(np.float64).ravel()))
    difference = values.astype(np.float64)
    difference -= exact
    return float(np.linalg.norm(difference.ravel())) / size if size else math.nan
