"""A scene: one experiment, written down and validated, nothing computed yet.

A section that is absent is not modelled: no ``[interaction]``, no neighbour list; no ``[breaking]``, bonds last; no
``[forming]``, contact mechanics only. A number is in the internal unit of its field, a string carries its own.

The sections of a scene beside its components: how long a contact is held, where ageing is fitted, what is asked.

Variants of a scene that answer the same question: on other surfaces of the same kind, and on other grids, from whose
contacts that of vanishing pixels is extrapolated.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from operator import attrgetter, methodcaller
from typing import Any, Self

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator, model_validator

from chemage.ageing.fitting import FIT_WINDOW
from chemage.ageing.methods import AgeingMethod
from chemage.ageing.observables import Observable
from chemage.ageing.replicas import Common
from chemage.contacts.options import force_text
from chemage.contacts.role import ContactSolver
from chemage.contacts.search import SoughtLoad
from chemage.foundation.aliases import Data, Fields
from chemage.foundation.checks import Frozen, check_times, hold_times, meanings
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError, shown
from chemage.foundation.records import content_hash
from chemage.foundation.units import FilePath, Temperature, Time, convert, units_of
from chemage.friction.role import Rupture
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.site_grid import site_rule, site_shape
from chemage.plugins import context, registry
from chemage.plugins.hooks import KEYS, Beside
from chemage.plugins.options import PluginOptions, joined
from chemage.plugins.sources import implementing, nested, providers, stage_hooks
from chemage.scene.materials import MaterialValue
from chemage.surfaces.role import SurfaceMaker

#: a number in JSON
_NUMBER = re.compile(r"(?<=[ \[])-?\d[\d.e+-]*")
_PERCENT = re.compile(r"\s*([-+0-9.eE]+)\s*%\s*")
#: what a process of its own compiles (:data:`chemage.foundation.compiling.STAGES`) -> keys of the stages it is for
COMPILED = {"contact": KEYS[:2], "ageing": KEYS[2:]}
#: surfaces of an ensemble, unless more are allowed
MOST_SURFACES = 10_000
#: more than anybody can compute, and as many as counts and their squares can hold
SURFACES_LIMIT = 1_000_000
#: the smallest relative accuracy that may be asked for, and the longest budget, s
FINEST, LONGEST = 1e-9, 1e9
#: and this is the least that may be allowed: the first samples, and some that these lead to
LEAST = 10
REMEDY = 'give "2 %" or 0.02'


class Section(Frozen):
    """A frozen set of options that is no component."""


class Hold(Section):
    """How long, how hot, how often."""

    temperature: Temperature = 300.0
    """K"""
    start: Time | None = None
    """first hold time, s"""
    stop: Time | None = None
    """last hold time, s"""
    per_decade: int = Field(default=4, ge=1, le=1000)
    """hold times to a decade"""
    times: tuple[Time, ...] | None = None
    """the hold times themselves, s, instead of start, stop and per_decade"""
    replicas: int = Field(default=10, ge=1)
    """independent draws of the disorder and the kinetic noise"""
    seed: int = Field(default=0, ge=0)
    """of disorder and noise"""
    common: Common = "none"
    """random numbers that replica r has in common with replica r of other runs with this seed: "none", "disorder"
    (barriers, couplings and hydroxylation of a pixel) or "all" (the kinetic noise as well)"""

    @field_validator("times", mode="before")
    @classmethod
    def _times(cls, value: Any) -> Any:
        if isinstance(value, Sequence) and not isinstance(value, str):
            value = [convert(item, "s") for item in value]
        return (
            value
            if value is None or isinstance(value, str)
            else tuple(check_times(value).tolist())
        )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.times is None:
            if self.start is None or self.stop is None:
                raise ValueError(
                    'give start and stop (such as "1 ms" and "1e5 s"), or times'
                )
            hold_times(self.start, self.stop, self.per_decade)
        elif self.start is not None or self.stop is not None:
            raise ValueError("give either times, or start and stop")
        return self

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        if self.times is not None:
            return np.array(self.times)
        assert self.start is not None
        assert self.stop is not None
        return hold_times(self.start, self.stop, self.per_decade)


class FitWindow(Section):
    """Where the line of Δμ against log t is fitted."""

    start: Time = FIT_WINDOW[0]
    """s"""
    stop: Time = FIT_WINDOW[1]
    """s"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stop <= self.start:
            raise ValueError(
                f"stop ({self.stop:g} s) must be after start ({self.start:g} s)"
            )
        return self


class EnsembleOptions(Section):
    """Over how many surfaces the answer is a mean."""

    surfaces: int | None = Field(default=None, ge=1, le=SURFACES_LIMIT)
    """how many; 1: the one of the scene alone; default: as many as the accuracy or the budget decides"""
    budget: Time | None = Field(default=None, gt=0, le=LONGEST)
    """wall time that may be taken, s"""
    most: int = Field(default=MOST_SURFACES, ge=LEAST, le=SURFACES_LIMIT)
    """surfaces that are allowed"""
    map: FilePath | None = None
    """file with the map of this scene (``chemage tradeoff SCENE -o FILE``), by whose measured costs and errors the
    settings are chosen; default: by estimates"""


def accuracies(options: Any) -> dict[str, float]:
    """A mapping of quantities, written as ``name`` or ``name@time``, to relative accuracies: numbers, or strings with a
    percent sign.

    Raises
    ------
    InputError
        It is no mapping, or an accuracy is not above 0 and below 1.
    """
    if not isinstance(options, Mapping):
        raise InputError(
            f'accuracy = {shown(options)}: give names and accuracies, such as {{"beta": "2 %"}}'
        )
    return {
        str(name): _accuracy(str(name), value) for name, value in options.items()
    }


def _accuracy(name: str, value: Any) -> float:
    percent = _PERCENT.fullmatch(value) if isinstance(value, str) else None
    try:
        number = float(percent[1]) / 100 if percent else convert(value, "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        problem = "is no number"
    elif not FINEST <= number < 1:
        problem = f"must lie between {FINEST:g} and 1: it is half the width of the 95 % interval over the mean"
    else:
        return number
    message = f"{shown(value)}: {problem}; {REMEDY}"
    raise InputError(f"accuracy.{name} = {message}", [(name, message)])


def budget_seconds(value: Any) -> float:
    """A budget of wall time, s.

    Raises
    ------
    InputError
        It is no time, or not above zero.
    """
    try:
        seconds = convert(value, "s")
    except ChemageError as error:
        raise InputError(f"budget: {error}") from None
    if not 0 < seconds <= LONGEST:
        raise InputError.of(
            "budget",
            value,
            f"must be above 0 s, at most {LONGEST:g} s",
            'give a time such as "60 s"',
        )
    return seconds


class Scene(Section):
    """One validated experiment: every component chosen, nothing computed yet."""

    name: str = Field(default="scene", min_length=1, max_length=100)
    """also the name of the result file"""
    title: str = ""
    surface: SerializeAsAny[SurfaceMaker]
    surface_seed: int = Field(default=0, ge=0)
    contact: SerializeAsAny[ContactSolver]
    load: float
    """nN; a :class:`chemage.contacts.search.SoughtLoad` where a mean contact pressure is given"""
    chemistry: Chemistry | None = None
    engine: SerializeAsAny[Engine] | None = None
    ageing: SerializeAsAny[AgeingMethod] | None = None
    """how the bonds are found; None: by the kinetics of every site"""
    rupture: SerializeAsAny[Rupture] | None = None
    hold: Hold | None = None
    fit: FitWindow = FitWindow()
    observe: tuple[SerializeAsAny[Observable], ...] = ()
    ensemble: EnsembleOptions | None = None
    """over how many surfaces the answer is a mean; None: the one surface of this scene"""
    accuracy: Mapping[str, float] = {}
    """quantity -> relative half width of its 95 % interval; the answer is a mean over as many surfaces as that needs"""
    others: Fields = {}
    """components or options of stages that have no field here, by section"""
    plugins: Mapping[str, SerializeAsAny[PluginOptions]] = {}
    """options of plugins, by the name of the plugin"""
    material: str = ""
    """name of the material whose values fill what the scene did not say; "" without one"""
    from_material: tuple[MaterialValue, ...] = ()
    """the values that are the material's; they are in the components as well, which decide the keys"""
    prefer: tuple[str, ...] = ()
    """names of the plugins that come first where several answer a stage, read a file or have a kind"""

    @field_validator("load", mode="wrap")
    @classmethod
    def _keep_sought(cls, load: Any, handler: Callable[[Any], float]) -> float:
        return load if isinstance(load, SoughtLoad) else handler(load)

    @field_validator("name")
    @classmethod
    def _file_name(cls, name: str) -> str:
        return file_name(name)

    # -- what it consists of ------------------------------------------------------------------------------------------

    @classmethod
    def fields_of(cls, parts: Fields) -> Data:
        """The fields of a scene with these :attr:`parts`."""
        fields: Data = {"others": {}}
        for stage in registry.stages():
            if stage.section in parts:
                place = (
                    fields
                    if stage.section in cls.model_fields
                    else fields["others"]
                )
                place[stage.section] = parts[stage.section]
            for path, beside in stage.entries.items():
                if path in parts:
                    fields[beside.field] = parts[path]
        return fields

    @property
    def parts(self) -> Data:
        """What it says to each stage, as :mod:`chemage.plugins.hooks` has it: ``parts["forming"]`` is a component,
        ``parts["contact.load"]`` a number; what it does not model is not there."""
        parts: Data = {}
        for stage in registry.stages():
            value = (
                getattr(self, stage.section)
                if stage.section in Scene.model_fields
                else None
            )
            value = self.others.get(stage.section) if value is None else value
            if value is None or (isinstance(value, tuple | Mapping) and not value):
                continue
            if stage.only_with and getattr(self, stage.only_with) is None:
                continue
            for name in stage.parts:
                if (part := getattr(value, name)) is not None:
                    parts[name] = part
            parts[stage.section] = value
            for path, beside in stage.entries.items():
                parts[path] = getattr(self, beside.field)
        return parts

    def sections(self) -> dict[str, Component]:
        """Every component by the path of its section, such as ``forming`` or ``observe.0``, in the order of stages."""
        components: dict[str, Component] = {}
        for path, part in self.parts.items():
            if isinstance(part, tuple):
                components |= {
                    f"{path}.{number}": component
                    for number, component in enumerate(part)
                }
            elif isinstance(part, Component) and part.role:
                components[path] = part
        return components

    def nested(self) -> dict[str, Component]:
        """Every component at any depth by its path, such as ``contact.inner``; each before its parts."""
        return {
            path: part
            for section, component in self.sections().items()
            for path, part in nested(component, section)
        }

    def component(self, section: str) -> Any:
        """The component or the options of a section; None where the scene has none."""
        return self.parts.get(section)

    def components(self) -> list[Component]:
        """Every component of the scene, those of the chemistry last."""
        chemical = {name for stage in registry.stages() for name in stage.parts}
        sections = self.sections()
        return [
            sections[path] for path in sorted(sections, key=chemical.__contains__)
        ]

    def unit(self, path: str) -> str:
        """The unit of the option at ``path``, such as ``contact.load``; "" where it is no quantity."""
        if (entry := _entry(path)) is not None:
            return entry.unit
        return units_of(self._owner(path)).get(path.rpartition(".")[2], "")

    def meaning(self, path: str) -> str:
        """What the option at ``path`` is, as it is declared; "" where that is not said."""
        if (entry := _entry(path)) is not None:
            return str(entry.schema.get("description", ""))
        return meanings(self._owner(path)).get(path.rpartition(".")[2], "")

    def _owner(self, path: str) -> type[Frozen]:
        """The class that declares the option at ``path``; one without options where there is none."""
        section = path.rpartition(".")[0]
        plugin = self.plugins.get(section.removeprefix("plugins."))
        owner = plugin or (self.parts | self.sections()).get(section)
        return type(owner) if isinstance(owner, Frozen) else Frozen

    def todict(self) -> Data:
        """The scene as plain TOML-like data, every option spelled out; :func:`parse_scene` reads it back."""
        data: Data = {
            "name": self.name,
            **({"title": self.title} if self.title else {}),
        }
        with self.in_use():
            data |= _sections(self.parts, methodcaller("todict"))
            for stage in reversed(registry.stages()):
                decided = stage.fills(data) if stage.section in data else {}
                for section, options in decided.items():
                    own = data.pop(section)
                    if left := {k: own[k] for k in own if k not in options}:
                        data[section] = left
        if self.plugins or self.prefer:
            prefer = {"prefer": list(self.prefer)} if self.prefer else {}
            data["plugins"] = prefer | {
                name: options.todict() for name, options in self.plugins.items()
            }
        return _without_none(data)

    def cite(self) -> list[str]:
        """What to cite when a result of this scene is used."""
        sources = [value.source for value in self.from_material]
        if self.chemistry is not None and self.chemistry.transitions:
            further = self.chemistry.transitions.values()
            sources += [each.source for each in further if each.source]
        return list(
            dict.fromkeys(
                [
                    *(text for part in self.components() for text in part.cite),
                    *sources,
                ]
            )
        )

    # -- what it asks for ---------------------------------------------------------------------------------------------

    @property
    def is_ensemble(self) -> bool:
        """Whether the answer is a mean over surfaces, for :func:`chemage.ensemble`, and not one run."""
        wish = self.ensemble
        return bool(self.accuracy) or (
            wish is not None and (wish.surfaces != 1 or wish.budget is not None)
        )

    def given_load(self, what: str) -> float:
        """The load (nN), which ``what`` has to know before a contact is solved.

        Raises
        ------
        InputError
            The load is found for each contact.
        """
        if isinstance(self.load, SoughtLoad):
            problem = f"is another load on each surface, and {what} needs one"
            remedy = "give a force or a nominal pressure"
            raise InputError.of("load", self.load.written, problem, remedy)
        return self.load

    @property
    def is_random(self) -> bool:
        """Whether another seed gives another surface, as far as its maker says."""
        scatter = self.surface.scatter({})
        return scatter is None or scatter.relative != 0

    @property
    def ages(self) -> bool:
        """Whether the scene goes on after the contact."""
        return (
            self.chemistry is not None
            and self.hold is not None
            and self.engine is not None
        )

    @property
    def site_grids(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Pixels and sites along the sides of the surface; None without ageing, and where they are not known before."""
        if self.chemistry is None or not self.ages or not self.contact.gives_map:
            return None
        try:
            expected = self.surface.expected()
            pixels = int(expected["nx"]), int(expected["ny"])
            return pixels, site_shape(
                pixels, expected["pixel_size"], self.chemistry.site_density
            )
        except (ChemageError, KeyError):  # reported where the scene is checked
            return None

    @property
    def solver(self) -> ContactSolver:
        """The contact solver, with the gap where sites are smaller than pixels."""
        return self.solved_parts["contact"]

    @property
    def solved_parts(self) -> Data:
        """:attr:`parts` with the :attr:`solver` for the contact, and the :attr:`site_grids` as ``grids``."""
        parts, grids = self.parts, self.site_grids
        if grids and site_rule(*grids) == "reconstructed":
            parts["contact"] = self.contact.with_gap()
        return parts | {"grids": grids}

    def coarser(self, factor: int) -> Self | None:
        """The scene with the contact on pixels ``factor`` times larger and the sites where they are; None where its
        surface has no coarser grid. Sites that are pixels get the density of the scene's own pixels."""
        maker = self.surface.coarser(factor) if self.contact.gives_map else None
        return None if maker is None else self.on(maker)

    def on(self, maker: SurfaceMaker) -> Self | None:
        """The scene on the pixels of ``maker``, which makes the same surface; None where its own are not known."""
        expected = self.surface.expected()
        if "pixel_size" not in expected:
            return None
        update: Data = {"surface": maker}
        if self.chemistry is not None and self.chemistry.site_density == "pixel":
            update["chemistry"] = self.chemistry.replace(
                site_density=expected["pixel_size"] ** -2
            )
        return self.model_copy(update=update)

    def warm_up(self, *compiled: str) -> None:
        """Compile what a run needs, or of that what ``compiled`` names ("contact", "ageing"), and compute nothing."""
        keys = {key for name in compiled or COMPILED for key in COMPILED[name]}
        with self.in_use():
            parts = self.solved_parts
            for stage in registry.stages():
                if stage.key in keys and stage.section in parts:
                    stage.warm_up(parts)

    def form(self) -> str:
        """What kernels may depend on: the scene without its numbers. Scenes of one form share their kernels, up to
        those that depend on a number of pixels."""
        data = json.dumps(self.todict() | {"name": "", "title": ""}, sort_keys=True)
        return f"{_NUMBER.sub('', data)} {self.surface.expected().get('nx')}"

    def in_use(self) -> AbstractContextManager[None]:
        """A block in which plugins have the options that this scene sets, and come in its order."""
        return context.applied(self.plugins, self.prefer or None)

    def completed(self) -> Self:
        """This scene with the options of plugins that a block (:func:`chemage.plugin_options`) sets and it does not."""
        if not context.options():
            return self
        return self.model_copy(
            update={"plugins": joined(context.options(), self.plugins)}
        )

    # -- keys ---------------------------------------------------------------------------------------------------------

    def keys(self) -> dict[str, str]:
        """Content hash of each stage: of its own options, of the stages it rests on, and of nothing else.

        The plugins that take part are known only when the stage has run; a finished run's keys contain them, with their
        options.

        ``surface``, ``contact``, ``ageing``, and ``result``, which is ageing, the fit to it, and the limits of the
        material with which it is compared. Options that only change the speed, and the scene's name, are in none of
        them.
        """
        return self._keys({})

    def with_hold(self, **values: Any) -> Self:
        """The scene with these values in its hold, if it has one."""
        return (
            self
            if self.hold is None
            else self.model_copy(
                update={"hold": self.hold.model_copy(update=values)}
            )
        )

    def bare(self, **hold: Any) -> Self:
        """The scene with one replica, without what the numbers do not need; ``hold``: further values of its hold."""
        update: Data = {"observe": (), "ensemble": None, "accuracy": {}}
        return self.with_hold(
            **{"replicas": 1, "common": "all", **hold}
        ).model_copy(update=update)

    def task_keys(self) -> dict[str, str]:
        """Like :meth:`keys`, and also of what the scene sets for plugins that may take part in the stage.

        By these keys a sweep finds out which of its points share a contact.
        """
        if not (self.plugins or self.prefer):
            return self.keys()
        stages, parts = registry.stages(), self.parts
        extra: Data = {}
        for key in ("surface", "contact", "ageing"):
            within = [stage for stage in stages if (stage.key or "ageing") == key]
            hooks = {hook for stage in within for hook in stage.hooks}
            if key == "ageing":  # and every hook of no declared stage
                hooks |= {*stage_hooks()} - {
                    hook for stage in stages for hook in stage.hooks
                }
            components = [
                parts.get(name) for stage in within for name in stage.roles
            ]
            names = {*implementing(*sorted(hooks)), *providers(*components)}
            extra[key] = {
                name: changed
                for name in names & set(self.plugins)
                if (changed := self.plugins[name].changed())
            }
        if self.prefer:
            extra["surface"]["prefer"] = self.prefer
        return self._keys(extra)

    def _keys(self, extra: Fields) -> dict[str, str]:
        stages, parts = registry.stages(), self.solved_parts
        sections = _without_none(_sections(parts, methodcaller("identity")))
        content: dict[str, list[Any]] = {key: [] for key in KEYS}
        for stage in sorted(stages, key=attrgetter("always_in_key"), reverse=True):
            if stage.key:
                content[stage.key] += stage.key_entries(sections)
        for stage in stages:
            for key, end in stage.key_ends(parts).items():
                content[key].append(end)
        keys: dict[str, str] = {}
        for key, entries in content.items():
            whole = [
                *list(keys.values())[-1:],
                *entries,
                *([extra[key]] if extra.get(key) else []),
            ]
            keys[key] = content_hash(whole if len(whole) > 1 else whole[0])
        return keys

    def digest(self) -> str:
        """Content hash of the whole scene."""
        return content_hash(self.todict())


def _entry(path: str) -> Beside | None:
    """The entry of a section at ``path`` that is no option of its component."""
    found = (stage.entries.get(path) for stage in registry.stages())
    return next(filter(None, found), None)


def _sections(parts: Fields, options_of: Callable[[Component], Data]) -> Data:
    """Every section that is there, lists of tables last; ``options_of`` gives the options of a component."""
    data: Data = {}
    for stage in sorted(registry.stages(), key=attrgetter("many")):
        data |= stage.todict(parts, options_of)
    return data


def file_name(name: str) -> str:
    """``name`` if it can name a scene and its result file; else a ValueError that says why."""
    if name[:1] in ("", ".") or not name.isprintable() or {*"/\\"} & {*name}:
        raise ValueError(
            "it names the result file; leave out slashes, a leading dot and invisible characters"
        )
    return name


def heading(scene: Fields, name: str = "") -> str:
    """The title of plain scene data, or else its name, or ``name``, with the values that a title names first."""
    if title := scene.get("title"):
        return str(title)
    name = name or str(scene.get("name", ""))
    kind, load = (
        scene.get(section, {}).get(field)
        for section, field in (("surface", "kind"), ("contact", "load"))
    )
    if kind is None or not isinstance(load, int | float):
        return name
    return f"{name}: {kind} at {force_text(load)}"


def _without_none(data: Any) -> Any:
    if isinstance(data, dict):
        left = {}
        for key, value in data.items():
            if value is not None:
                inner = isinstance(value, dict | list | tuple)
                left[key] = _without_none(value) if inner else value
        return left
    if isinstance(data, list | tuple):
        return [*map(_without_none, data)]
    return data
