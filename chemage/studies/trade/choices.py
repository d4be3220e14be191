"""The settings between speed and accuracy that a scene has, and the changes to the scene file that each of them is.

These are the values of options in ``trade`` of its components, at any depth; coarser grids; other solvers, engines and
methods of ageing.

A scene of which the CPU time is measured, as a task: in the process that computes it, on one thread.

The result is what a map of speed against accuracy compares: measures of the contact, the distance of its pressures from
those of a reference, and the friction drop of each replica.
"""

from __future__ import annotations

import json
import math
import re
import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any, Self, TypeVar

import numpy as np

from chemage.ageing.methods import check_method, expected_cost
from chemage.contacts.solution import ContactSolution
from chemage.foundation.errors import ChemageError
from chemage.foundation.records import content_hash
from chemage.foundation.text import jsonable
from chemage.plugins import registry
from chemage.plugins.sources import nested
from chemage.scene.files import load_scene
from chemage.scene.plan import cost
from chemage.scene.provenance import versions
from chemage.scene.run import Run, aged, contact_of
from chemage.scene.scene import Scene, coarser
from chemage.scene.warm_up import form, warm_up
from chemage.studies.tasks import Outcome, Recent, Task, Worker, content_of

#: names of what is chosen, besides the options of components
GRID, SOLVER, ENGINE, AGEING = "grid of the contact", "contact", "engine", "ageing"
#: at most so many values of one option are tried, the first, the last and the scene's own among them
MOST_VALUES = 8
#: factors by which pixels are made larger
COARSER = (4, 2)
#: what an ageing method may cost before it gives its first answer, CPU seconds
PREPARATION = 10.0
_WORD = re.compile(r"[A-Za-z_-][A-Za-z0-9_-]*")
_KEY = re.compile(r'"([A-Za-z0-9_-]+)" = ')


@dataclass(frozen=True)
class TradeSetting:
    """One value of one thing that can be chosen, other than that of the scene."""

    #: what is chosen, such as ``contact.tolerance``; a combination has one setting of each
    name: str
    label: str
    #: dotted path -> value that has to be set in the scene
    changes: Mapping[str, Any]
    #: whether only the contact depends on it, or only the ageing
    stage: str
    #: declared not to change what is computed but for noise, as an exact engine
    exact: bool = False

    @property
    def words(self) -> str:
        """The setting in words."""
        return f"{self.name} {self.label}"


#: a combination of settings
Combination = tuple[TradeSetting, ...]


def applied(scene: Scene, combination: Combination) -> Scene:
    """``scene`` with every setting.

    Raises
    ------
    ChemageError
        They do not go together.
    """
    return load_scene(
        scene,
        {path: value for one in combination for path, value in one.changes.items()},
    )


def go_together(combination: Combination) -> bool:
    """Whether settings can be combined: no two of one option, and none of a component that another one replaces."""
    paths = [path for one in combination for path in one.changes]
    if any(
        f"{inner}.".startswith(f"{outer}.") for inner, outer in permutations(paths, 2)
    ):
        return False
    method = any(one.name == AGEING and not one.exact for one in combination)
    return not (
        method and any(one.name.partition(".")[0] == ENGINE for one in combination)
    )


def choices(scene: Scene, notes: list[str]) -> list[TradeSetting]:
    """Every setting that ``scene`` has besides its own values; what is not tried is noted in words."""
    found = [
        *_options(scene, notes),
        *_grids(scene),
        *_kinds(scene, SOLVER, _with_solver, notes),
    ]
    if scene.ages:
        found += _kinds(scene, ENGINE, _with_engine, notes)
        if scene.ageing is not None:
            found.append(
                TradeSetting(AGEING, "every site", {AGEING: None}, "ageing", exact=True)
            )
        found += _kinds(scene, AGEING, _with_method, notes)
    return found


def _options(scene: Scene, notes: list[str]) -> Iterator[TradeSetting]:
    """The values in ``trade`` of every component, but those of the scene."""
    for section, component in scene.sections().items():
        stage = "contact" if section in ("surface", "contact") else "ageing"
        for path, part in nested(component, section):
            for option, values in part.trade.items():
                name = f"{path}.{option}"
                if section.startswith("observe"):
                    notes.append(
                        f"{name}: not tried, because it changes what is measured"
                    )
                    continue
                if stage == "ageing" and not scene.ages:
                    notes.append(
                        f"{name}: not tried, because the scene stops at the contact"
                    )
                    continue
                own = getattr(part, option, None)
                tried = _some(tuple(values), own)
                if len(tried) < len(values):
                    notes.append(
                        f"{name}: {len(tried)} of {len(values)} values are tried"
                    )
                yield from (
                    TradeSetting(name, str(value), {name: value}, stage)
                    for value in tried
                    if value != own
                )


def _some(values: tuple[Any, ...], own: Any) -> tuple[Any, ...]:
    if len(values) <= MOST_VALUES:
        return values
    chosen = {
        round(k * (len(values) - 1) / (MOST_VALUES - 1)) for k in range(MOST_VALUES)
    }
    if own in values and values.index(own) not in chosen:
        nearest = min(
            chosen - {0, len(values) - 1}, key=lambda k: abs(k - values.index(own))
        )
        chosen = chosen - {nearest} | {values.index(own)}
    return tuple(values[k] for k in sorted(chosen))


def _grids(scene: Scene) -> Iterator[TradeSetting]:
    """Coarser grids of the contact, with the sites in place."""
    for factor in COARSER:
        if (coarse := coarser(scene, factor)) is not None:
            yield TradeSetting(
                GRID, f"{factor} times coarser", changes(scene, coarse), "contact"
            )


def _kinds(
    scene: Scene,
    role: str,
    made: Callable[[Scene, Any], Scene | None],
    notes: list[str],
) -> Iterator[TradeSetting]:
    """Other components of a role, which ``made`` puts into the scene; methods of ageing at each value of their
    options."""
    plugins, own = registry.current(), scene.component(role)
    for kind in plugins.kinds(role):
        if own is not None and kind == own.kind:
            continue
        cls = plugins.component(role, kind)
        trade = cls.trade if role == AGEING else {}
        shared = {}
        if role == SOLVER:  # the options that it has in common with that of the scene
            shared = {
                name: getattr(own, name)
                for name in scene.contact.model_fields_set
                if name in cls.model_fields
            }
        for options in [
            {name: value} for name, values in trade.items() for value in values
        ] or [{}]:
            label = ", ".join(
                [kind, *(f"{name} {value}" for name, value in options.items())]
            )
            try:
                component = plugins.make(role, kind, shared | options)
                other = made(scene, component)
                before = _prepared(scene, component) if role == AGEING else 0.0
                if before > PREPARATION:
                    raise ChemageError(
                        f"it may need {before:.0f} CPU seconds before its first answer"
                    )
            except ChemageError as error:
                notes.append(f"{role} {label}: not tried: {str(error).splitlines()[0]}")
                continue
            if before > 0:
                notes.append(
                    f"ageing {label}: up to {before:.2g} CPU seconds, needed once, are not in its times"
                )
            if other is not None:
                stage = "contact" if role == SOLVER else "ageing"
                yield TradeSetting(
                    role,
                    label,
                    changes(scene, other),
                    stage,
                    role == ENGINE and component.exact,
                )


def _with_solver(scene: Scene, solver: Any) -> Scene | None:
    """None if it has no map."""
    if not solver.gives_map:
        return None
    solver.check(scene.surface.expected(), scene.load)
    return scene.model_copy(update={"contact": solver})


def _with_engine(scene: Scene, engine: Any) -> Scene:
    engine.check(
        scene.chemistry is not None and scene.chemistry.interaction is not None
    )
    return scene.model_copy(update={"engine": engine})


def _with_method(scene: Scene, method: Any) -> Scene:
    return scene.model_copy(
        update={"ageing": method, "observe": scene.observe if method.observes else ()}
    )


def _prepared(scene: Scene, method: Any) -> float:
    """CPU seconds that a method of ageing may need before its first answer, such as for a table.

    Raises
    ------
    ChemageError
        The method does not fit the scene.
    """
    assert scene.chemistry is not None
    assert scene.engine is not None
    check_method(method, scene.chemistry, scene.engine, scene.rupture, ())
    if scene.site_grids:
        method.check_sites(scene.site_grids[1], None)
    costs = cost(scene)
    assert scene.hold is not None
    seconds = expected_cost(
        method,
        costs.sites or 1.0,
        {"cpu_seconds": costs.kinetics_cpu_seconds or 0.0},
        1,
        chemistry=scene.chemistry,
        temperature=scene.hold.temperature,
        mean_pressure=costs.mean_pressure,
    )
    return max(
        0.0,
        seconds.get("cpu_seconds_most", 0.0) - seconds.get("cpu_seconds_least", 0.0),
    )


def most_accurate(scene: Scene) -> Scene:
    """The most accurate settings of every section, and the kinetics of every site."""
    changed: dict[str, Any] = {AGEING: None} if scene.ageing is not None else {}
    for section, component in scene.sections().items():
        parts = (
            ()
            if section.startswith("observe") or section in changed
            else nested(component, section)
        )
        for path, part in parts:
            best = part.reference()
            options = {
                name: value
                for name, value in best.todict().items()
                if value != part.todict().get(name)
            }
            changed |= {f"{path}.{name}": value for name, value in options.items()}
    return load_scene(scene, changed)


# -- a setting as changes to the scene file ----------------------------------------------------------------------------


def changes(own: Scene, other: Scene) -> dict[str, Any]:
    """What has to be set in ``own`` for ``other``: dotted path -> plain value; a component of another kind as a
    whole."""
    changed: dict[str, Any] = {}
    before, after = _plain(own), _plain(other)
    for name in {**before, **after}:
        old, new = before.get(name), after.get(name)
        if old == new:
            continue
        if (
            isinstance(old, Mapping)
            and isinstance(new, Mapping)
            and old.get("kind") == new.get("kind")
        ):
            keys = {**old, **new}
            changed |= {
                f"{name}.{key}": new.get(key)
                for key in keys
                if old.get(key) != new.get(key)
            }
        elif (
            isinstance(new, Mapping)
            and (component := other.sections().get(name)) is not None
        ):
            besides = {"seed", "load"} & new.keys()
            options = component.model_fields_set
            changed[name] = {
                key: value
                for key, value in new.items()
                if key in options | {"kind", *besides}
            }
        else:
            changed[name] = [] if new is None and name == "observe" else new
    return changed


def _plain(scene: Scene) -> dict[str, Any]:
    return json.loads(json.dumps(scene.todict()))


def pasted(changed: Mapping[str, Any]) -> str:
    """The same as options of the command line: ``--set contact.tolerance=0.001``."""
    return " ".join(
        f"--set {shlex.quote(f'{path}={_toml(value)}')}"
        for path, value in changed.items()
    )


def _toml(value: Any) -> str:
    """A value in TOML, which is JSON but for tables; a plain word needs no quotes on the command line."""
    if value is None or (isinstance(value, str) and _WORD.fullmatch(value)):
        return str(value)
    return _KEY.sub(r"\1 = ", json.dumps(value, separators=(", ", " = ")))


T = TypeVar("T")

#: distance of the distribution of pressure from that of the reference over the mean pressure
DISTRIBUTION = "pressure_distribution"


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """What ``work`` returns, and its CPU seconds over all threads of this process."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


@dataclass(frozen=True)
class Timed(Task):
    """A scene of which the CPU time is measured."""

    #: with whose pressures those of the scene are compared; None: with none
    reference: Scene | None = None

    @classmethod
    def measuring(cls, scene: Scene, **more: Any) -> Self:
        """The task that measures a scene."""
        reference, estimates = more.get("reference"), cost(scene)
        keys = scene.task_keys()
        against = None if reference is None else _contact_key(reference)
        return cls(
            # options that change the speed alone are in the data of the scene, and in no key of its stages
            key=content_hash([keys["result"], _data(scene), against]),
            ageing=content_hash([keys["aging"], _data(scene)]),
            contact=_contact_key(scene),
            surface=keys["surface"],
            source=scene,
            contact_seconds=estimates.contact_cpu_seconds or 0.0,
            ageing_seconds=estimates.kinetics_cpu_seconds or 0.0,
            bytes=max(estimates.contact_bytes or 0.0, estimates.replica_bytes or 0.0),
            **more,
        )

    def outcome(self, worker: Worker) -> Outcome:
        """Compute and time the scene; what it needs is compiled before."""
        scene = self.scene
        with scene.in_use():
            worker.stage = "contact"
            solved = _solution(worker.owner, scene)
            distance = 0.0
            if self.reference is not None:
                distance = _distance(
                    solved.contact, _solution(worker.owner, self.reference).contact
                )
            worker.stage = "ageing"
            _compile(scene, solved.contact)
            aging, seconds = timed(lambda: aged(scene, solved.contact))
        made = Run(
            scene.todict(),
            solved.contact,
            aging=aging,
            timings={"contact": solved.seconds, "ageing": seconds},
            versions=versions(scene, (solved.contact, aging)),
        )
        content = content_of(made, self)
        return Outcome(content=content | jsonable({DISTRIBUTION: distance}))


# -- in the worker ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solved:
    """A contact, and the CPU seconds of making its surface and solving it."""

    contact: ContactSolution
    seconds: float


# that of the reference, which every task uses, and that of the task
_solutions: Recent[_Solved] = Recent(2)
#: forms of scenes that this process has compiled everything for, and whether it has solved a contact
_compiled: set[str] = set()


def _solution(owner: str, scene: Scene) -> _Solved:
    def solve() -> ContactSolution:
        return contact_of(scene)

    def measured() -> _Solved:
        warm_up(scene, "contact")
        if not _compiled:  # the first contact of a process takes longer
            solve()
            _compiled.add("contact")
        return _Solved(*timed(solve))

    return _solutions.get(f"{owner} {_contact_key(scene)}", measured)


def _compile(scene: Scene, contact: ContactSolution) -> None:
    """Age one replica where no scene of this form was aged, so that compilation, or a table that a method of ageing
    makes once, is in no time."""
    if scene.ages and (name := f"{form(scene)} {scene.ageing!r}") not in _compiled:
        aged(scene, contact, replicas=1)
        _compiled.add(name)


def _data(scene: Scene) -> dict[str, Any]:
    return scene.todict() | {"name": "", "title": ""}


def _contact_key(scene: Scene) -> str:
    data = scene.todict()
    return content_hash(
        [scene.task_keys()["contact"], data["surface"], data["contact"]]
    )


def _distance(contact: ContactSolution, reference: ContactSolution) -> float:
    """Wasserstein distance of the distributions of pressure over the contact, over the mean pressure."""
    from scipy import stats

    pressure, other = (
        solution.pressure[solution.contact] for solution in (contact, reference)
    )
    if not pressure.size or not other.size:
        return math.nan
    return float(stats.wasserstein_distance(pressure, other)) / float(
        np.abs(other).mean(dtype=np.float64)
    )
