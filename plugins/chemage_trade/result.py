"""The map of speed against accuracy as users have it: its fronts, and the cheapest settings for an accuracy.

The settings between speed and accuracy that a scene has, and the changes to the scene file that each of them is.

These are the values of options in ``trade`` of its components, at any depth; coarser grids; other solvers, engines and
methods of ageing.
"""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, permutations
from typing import Any

from chemage import ChemageError, Scene, load_scene
from chemage.plugin import TradeMap, TradePoint, plan, registry, statistics, text

#: names of what is chosen, besides the options of components
SOLVER, ENGINE, AGEING = "contact", "engine", "ageing"
#: the section whose components only measure
OBSERVABLES = "observe"
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
    changed: dict[str, Any] = {}
    for one in combination:
        changed |= one.changes
    return load_scene(scene, changed)


def go_together(combination: Combination) -> bool:
    """Whether settings can be combined: no two of one option, and none of a component that another one replaces."""
    paths = [path for one in combination for path in one.changes]
    if any(
        f"{inner}.".startswith(f"{outer}.")
        for inner, outer in permutations(paths, 2)
    ):
        return False
    method = any(one.name == AGEING and not one.exact for one in combination)
    return not (
        method and any(one.name.partition(".")[0] == ENGINE for one in combination)
    )


def choices(scene: Scene, notes: list[str]) -> list[TradeSetting]:
    """Every setting that ``scene`` has besides its own values; what is not tried is noted in words."""
    found = [*_options(scene, notes), *_grids(scene), *_kinds(scene, SOLVER, notes)]
    if scene.ages:
        found += _kinds(scene, ENGINE, notes)
        if scene.ageing is not None:
            every = {AGEING: None}
            found.append(
                TradeSetting(AGEING, "every site", every, "ageing", exact=True)
            )
        found += _kinds(scene, AGEING, notes)
    return found


def _options(scene: Scene, notes: list[str]) -> Iterator[TradeSetting]:
    """The values in ``trade`` of every component, but those of the scene."""
    for path, part in scene.nested().items():
        section = path.partition(".")[0]
        stage = "contact" if section in ("surface", "contact") else "ageing"
        for option, values in part.trade.items():
            name = f"{path}.{option}"
            if section == OBSERVABLES:
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
    last = len(values) - 1
    if last < MOST_VALUES:
        return values
    chosen = {round(k * last / (MOST_VALUES - 1)) for k in range(MOST_VALUES)}
    if own in values and (at := values.index(own)) not in chosen:
        chosen.remove(min(chosen - {0, last}, key=lambda k: abs(k - at)))
        chosen.add(at)
    return tuple(values[k] for k in sorted(chosen))


def _grids(scene: Scene) -> Iterator[TradeSetting]:
    """Coarser grids of the contact, with the sites in place."""
    for factor in COARSER:
        if (coarse := scene.coarser(factor)) is not None:
            yield TradeSetting(
                TradePoint.GRID,
                f"{factor} times coarser",
                changes(scene, coarse),
                "contact",
            )


def _kinds(scene: Scene, role: str, notes: list[str]) -> Iterator[TradeSetting]:
    """Other components of a role; methods of ageing at each value of their options."""
    plugins, own = registry.current(), scene.component(role)
    for kind, cls in plugins.usable(role):
        if type(own) is cls:
            continue
        tried: list[dict[str, Any]] = [{}]
        if (
            role == SOLVER
        ):  # the options that it has in common with that of the scene
            shared = scene.contact.model_fields_set & cls.model_fields.keys()
            tried = [{name: getattr(own, name) for name in shared}]
        elif role == AGEING and cls.trade:
            tried = [
                {name: value}
                for name, values in cls.trade.items()
                for value in values
            ]
        for options in tried:
            words = (
                []
                if role == SOLVER
                else [f"{name} {value}" for name, value in options.items()]
            )
            label = ", ".join([kind, *words])
            try:
                component = plugins.make(role, kind, options)
                other = _with(scene, role, component)
                before = 0.0
                if role == AGEING and other is not None:
                    before = plan(other).preparation()
                if before > PREPARATION:
                    raise ChemageError(
                        f"it may need {before:.0f} CPU seconds before its first answer"
                    )
            except ChemageError as error:
                notes.append(
                    f"{role} {label}: not tried: {str(error).splitlines()[0]}"
                )
                continue
            if before > 0:
                notes.append(
                    f"ageing {label}: up to {before:.2g} CPU seconds, needed once, are not in its times"
                )
            if other is not None:
                stage = "contact" if role == SOLVER else "ageing"
                exact = role == ENGINE and component.exact
                yield TradeSetting(role, label, changes(scene, other), stage, exact)


def _with(scene: Scene, role: str, component: Any) -> Scene | None:
    """The scene with another component; None for a contact that has no map."""
    update = {role: component}
    if role == SOLVER:
        if not component.gives_map:
            return None
        component.check(scene.surface.expected(), scene.load)
    elif role == ENGINE:
        chemistry = scene.chemistry
        component.check(chemistry is not None and chemistry.interaction is not None)
    else:
        update[OBSERVABLES] = scene.observe if component.observes else ()
    return scene.model_copy(update=update)


def most_accurate(scene: Scene) -> Scene:
    """The most accurate settings of every section, and the kinetics of every site."""
    changed: dict[str, Any] = {AGEING: None} if scene.ageing is not None else {}
    for path, part in scene.nested().items():
        if path.partition(".")[0] in (OBSERVABLES, *changed):
            continue
        own, best = part.todict(), part.reference().todict()
        changed |= {
            f"{path}.{name}": value
            for name, value in best.items()
            if value != own.get(name)
        }
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
        old = old if isinstance(old, Mapping) else {}
        component = other.sections().get(name)
        if not isinstance(new, Mapping):
            changed[name] = [] if new is None and name == OBSERVABLES else new
        elif old and old.get("kind") == new.get("kind"):
            for key in {**old, **new}:
                if old.get(key) != new.get(key):
                    changed[f"{name}.{key}"] = new.get(key)
        elif component is None:
            changed[name] = new
        else:
            kept = {*component.model_fields_set, "kind", "seed", "load"}
            changed[name] = {key: new[key] for key in new if key in kept}
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


#: the accuracies for which the cheapest settings are named
WITHIN = (0.1, 0.03, 0.01, 0.003)
#: observables of the ageing: β, and the friction drop at hold times
BETA, DROP = "beta", "friction_drop"
#: distance of the distribution of pressure from that of the reference over the mean pressure
DISTRIBUTION = "pressure_distribution"
#: measures of the contact that are shown
SHOWN_MEASURES = ("corrected_area", DISTRIBUTION, "patches", "perimeter_to_area")
#: observable -> what it is, in words
WORDS = {
    BETA: "β",
    "corrected_area": "corrected contact area",
    DISTRIBUTION: "distribution of pressure",
    "patches": "number of patches",
    "perimeter_to_area": "perimeter over area",
}
_KEYS = (
    "observable",
    "within",
    "error",
    "settings_error",
    "replicas_error",
    "replicas",
    "best",
)
#: replicas that are thought of
MOST_REPLICAS = 100_000


def words(observable: str) -> str:
    """An observable in words."""
    name, _, time = observable.partition("@")
    if name == DROP:
        return f"ΔF at {text.power_text(float(time.removesuffix(' s')))} s"
    return WORDS.get(name, name.replace("_", " "))


@dataclass(frozen=True)
class Cheapest:
    """The cheapest settings within an accuracy."""

    observable: str
    within: float
    #: None: none was found
    point: TradePoint | None
    #: replicas that the accuracy needs; None where there are none, or their number does not matter
    replicas: int | None = None
    seconds: float = math.nan
    #: relative, 95 %: of all, of the settings, and of the replicas
    error: float = math.nan
    settings_error: float = math.nan
    replicas_error: float = 0.0
    #: the smallest error of the settings that was found
    best: float = math.nan

    @property
    def options(self) -> str:
        """The settings as options of the command line; "" where the scene has them."""
        if self.point is None:
            return ""
        more = {"hold.replicas": self.replicas} if self.replicas is not None else {}
        return pasted({**self.point.changes, **more})

    def text(self, wider: Sequence[float] = ()) -> str:
        """What was found, in words; ``wider`` are accuracies for which it is the cheapest as well."""
        accuracies = [f"{100 * accuracy:.2g}" for accuracy in (*wider, self.within)]
        within = " and ".join(
            filter(None, (", ".join(accuracies[:-1]), accuracies[-1]))
        )
        if self.point is None:
            best = ""
            if self.best < self.within:
                best = f" with at most {MOST_REPLICAS:,} replicas"
            elif math.isfinite(self.best):
                best = f"; the best is known to {text.percent(self.best)}"
            return f"within {within} %: none found{best}"
        error = f"error {text.percent(self.error)}"
        if self.replicas_error:
            error += f" (settings {text.percent(self.settings_error)}, replicas {text.percent(self.replicas_error)})"
        how = self.options or "as the scene is"
        return f"within {within} %: {self.seconds:.2g} CPU s, {error}: {how}"

    def todict(self) -> dict[str, Any]:
        """One JSON-able object."""
        fields = {name: getattr(self, name) for name in _KEYS}
        of = {
            "found": self.point is not None,
            "options": self.options,
            "cpu_seconds": self.seconds,
        }
        return text.jsonable(fields | of)


@dataclass
class Tradeoff(TradeMap):
    """What was measured of the settings of a scene and of their combinations, and which of them pay."""

    def of(self, observable: str) -> list[TradePoint]:
        """The points that can be compared at an observable: for one of the contact, those that differ there."""
        ageing = TradePoint.of_ageing(observable)
        return [
            point
            for point in self.points
            if not math.isnan(point.deviation(observable).bound)
            and (ageing or point.contact_only)
        ]

    def front(self, observable: str) -> list[TradePoint]:
        """The Pareto front, from fast to accurate: no other point is both faster and more accurate."""
        return pareto(
            self.of(observable),
            lambda point: (
                point.seconds(observable),
                point.deviation(observable).bound,
            ),
        )

    def marked(self) -> Tradeoff:
        """The same with the front of every observable marked in the points."""
        fronts = {
            name: list(map(id, self.front(name))) for name in self.observables
        }
        points = [
            replace(
                point,
                front=[
                    name for name, front in fronts.items() if id(point) in front
                ],
            )
            for point in self.points
        ]
        return replace(self, points=points)

    def cheapest(self, observable: str, within: float) -> Cheapest:
        """The settings that give an observable of one surface within an accuracy at the least cost, with as many
        replicas as that needs."""
        bounds, found = [math.inf], []
        for point in self.of(observable):
            bounds.append(point.deviation(observable).bound)
            if bounds[-1] < within:
                found += self._with_replicas(point, observable, within, bounds[-1])
        none = Cheapest(observable, within, None, best=min(bounds))
        return min(found, key=lambda one: one.seconds, default=none)

    def _with_replicas(
        self, point: TradePoint, observable: str, within: float, bound: float
    ) -> list[Cheapest]:
        """The point with as many replicas as the accuracy needs; nothing where these are too many."""
        found = Cheapest(
            observable, within, point, error=bound, settings_error=bound
        )
        contact, replica = self.seconds_of(point)
        if not TradePoint.of_ageing(observable):
            return [replace(found, seconds=contact)]
        if not point.replicates:
            return [replace(found, seconds=contact + replica)]
        scatter = statistics.NORMAL_LIMIT * point.scatter.get(observable, math.nan)
        needed = scatter**2 / (within**2 - bound**2)
        if not needed <= MOST_REPLICAS:
            return []
        count = max(2, math.ceil(needed))
        noise = scatter / math.sqrt(count)
        return [
            replace(
                found,
                replicas=count,
                seconds=contact + replica * count,
                error=math.hypot(bound, noise),
                replicas_error=noise,
            )
        ]

    def sentences(self) -> dict[str, list[str]]:
        """Observable -> the cheapest settings within each of the accuracies, in words."""
        texts: dict[str, list[str]] = {}
        for name in self.observables:
            found = [self.cheapest(name, within) for within in WITHIN]
            texts[name] = []
            for _, same in groupby(
                found, key=lambda one: (id(one.point), one.replicas)
            ):
                *wider, last = same
                texts[name].append(last.text([one.within for one in wider]))
        return texts

    def summary(self) -> dict[str, Any]:
        """One JSON-able object: the map, and the cheapest settings within each of the accuracies."""
        cheapest = []
        for name in self.observables:
            cheapest += [self.cheapest(name, within).todict() for within in WITHIN]
        return {
            "scene": self.name,
            "notes": self.notes,
            "map": self.todict(),
            "cheapest": cheapest,
            "sentences": self.sentences(),
        }


def pareto(points: Sequence[Any], of: Any) -> list[Any]:
    """The points on the front, from fast to accurate; ``of`` gives (cost, error)."""
    front, least = [], math.inf
    for point in sorted(points, key=of):
        error = of(point)[1]
        if error < least:
            front.append(point)
            least = error
    return front
