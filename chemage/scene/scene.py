"""A scene: one experiment, written down and validated, nothing computed yet.

A section that is absent is not modelled: no ``[interaction]``, no neighbour list; no ``[breaking]``, bonds last; no
``[forming]``, contact mechanics only. A number is in the internal unit of its field, a string carries its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, Self

from pydantic import BaseModel, Field, SerializeAsAny, field_validator

from chemage.ageing.methods import AgeingMethod
from chemage.ageing.observables import Observable
from chemage.contacts.options import force_text
from chemage.contacts.role import ContactSolver, ContactTheory
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError
from chemage.foundation.records import content_hash
from chemage.foundation.units import unit_of
from chemage.friction.role import Rupture
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.site_grid import site_rule, site_shape
from chemage.plugins import context, registry
from chemage.plugins.hooks import KEYS
from chemage.plugins.options import PluginOptions, joined
from chemage.plugins.sources import implementing, providers, stage_hooks
from chemage.scene.materials import MaterialValue
from chemage.scene.scene import EnsembleOptions, FitWindow, Hold, Section
from chemage.surfaces.role import SurfaceMaker


class Scene(Section):
    """One validated experiment: every component chosen, nothing computed yet."""

    name: str = Field(default="scene", min_length=1, max_length=100)
    """also the name of the result file"""
    title: str = ""
    surface: SerializeAsAny[SurfaceMaker]
    surface_seed: int = Field(default=0, ge=0)
    contact: SerializeAsAny[ContactSolver]
    load: float
    """nN"""
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
    others: Mapping[str, SerializeAsAny[Component]] = {}
    """components of stages that have no field here, by section"""
    plugins: Mapping[str, SerializeAsAny[PluginOptions]] = {}
    """options of plugins, by the name of the plugin"""
    material: str = ""
    """name of the material whose values fill what the scene did not say; "" without one"""
    from_material: tuple[MaterialValue, ...] = ()
    """the values that are the material's; they are in the components as well, which decide the keys"""
    prefer: tuple[str, ...] = ()
    """names of the plugins that come first where several answer a stage or read a file"""

    @field_validator("name")
    @classmethod
    def _file_name(cls, name: str) -> str:
        return file_name(name)

    # -- what it consists of ------------------------------------------------------------------------------------------

    @classmethod
    def fields_of(cls, parts: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of a scene with these :attr:`parts`."""
        fields: dict[str, Any] = {"others": {}}
        for stage in registry.current().stages():
            if stage.section in parts:
                place = fields if stage.section in cls.model_fields else fields["others"]
                place[stage.section] = parts[stage.section]
            paths = {beside.field: f"{stage.section}.{name}" for name, beside in stage.beside.items()}
            fields |= {name: parts[path] for name, path in paths.items() if path in parts}
        return fields

    @property
    def parts(self) -> dict[str, Any]:
        """What it says to each stage, as :mod:`chemage.plugins.hooks` has it: ``parts["forming"]`` is a component,
        ``parts["contact.load"]`` a number; what it does not model is not there."""
        parts: dict[str, Any] = {}
        for stage in registry.current().stages():
            value = getattr(self, stage.section) if stage.section in Scene.model_fields else None
            value = self.others.get(stage.section) if value is None else value
            if value is None or value == () or value == {}:
                continue
            if stage.only_with and getattr(self, stage.only_with) is None:
                continue
            parts |= {name: part for name in stage.parts if (part := getattr(value, name)) is not None}
            parts[stage.section] = value
            parts |= {f"{stage.section}.{name}": getattr(self, beside.field) for name, beside in stage.beside.items()}
        return parts

    def sections(self) -> dict[str, Component]:
        """Every component by the path of its section, such as ``forming`` or ``observe.0``, in the order of stages."""
        components: dict[str, Component] = {}
        for path, part in self.parts.items():
            if isinstance(part, tuple):
                components |= {f"{path}.{number}": component for number, component in enumerate(part)}
            elif isinstance(part, Component) and part.role:
                components[path] = part
        return components

    def component(self, section: str) -> Any:
        """The component or the options of a section; None where the scene has none."""
        return self.parts.get(section)

    def components(self) -> list[Component]:
        """Every component of the scene, those of the chemistry last."""
        chemical = {name for stage in registry.current().stages() for name in stage.parts}
        return [part for _, part in sorted(self.sections().items(), key=lambda item: item[0] in chemical)]

    def unit(self, path: str) -> str:
        """The unit of the option at ``path``, such as ``contact.load``; "" where it is no quantity."""
        section, _, option = path.rpartition(".")
        beside = {
            f"{stage.section}.{name}": entry.unit
            for stage in registry.current().stages()
            for name, entry in stage.beside.items()
        }
        if path in beside:
            return beside[path]
        owner = self.plugins.get(section.removeprefix("plugins.")) or self.parts.get(section)
        info = type(owner).model_fields.get(option) if isinstance(owner, BaseModel) else None
        return unit_of(info) if info is not None else ""

    def todict(self) -> dict[str, Any]:
        """The scene as plain TOML-like data, every option spelled out; :func:`parse_scene` reads it back."""

        def options_of(component: Component) -> dict[str, Any]:
            return component.todict()

        data: dict[str, Any] = {"name": self.name, **({"title": self.title} if self.title else {})}
        data |= _sections(self.parts, options_of)
        if self.plugins or self.prefer:
            prefer = {"prefer": list(self.prefer)} if self.prefer else {}
            data["plugins"] = prefer | {name: options_of(options) for name, options in self.plugins.items()}
        return _without_none(data)

    def cite(self) -> list[str]:
        """What to cite when a result of this scene is used."""
        sources = [value.source for value in self.from_material]
        return list(dict.fromkeys([*(text for part in self.components() for text in part.cite), *sources]))

    # -- what it asks for ---------------------------------------------------------------------------------------------

    @property
    def is_ensemble(self) -> bool:
        """Whether the answer is a mean over surfaces, for :func:`chemage.ensemble`, and not one run."""
        wish = self.ensemble
        return bool(self.accuracy) or (wish is not None and (wish.surfaces != 1 or wish.budget is not None))

    @property
    def ages(self) -> bool:
        """Whether the scene goes on after the contact."""
        return self.chemistry is not None and self.hold is not None and self.engine is not None

    @property
    def site_grids(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Pixels and sites along the sides of the surface; None without ageing, and where they are not known before."""
        if self.chemistry is None or not self.ages or isinstance(self.contact, ContactTheory):
            return None
        try:
            expected = self.surface.expected()
            pixels = int(expected["nx"]), int(expected["ny"])
            return pixels, site_shape(pixels, expected["pixel_size"], self.chemistry.site_density)
        except (ChemageError, KeyError):  # reported where the scene is checked
            return None

    @property
    def solver(self) -> ContactSolver:
        """The contact solver, with the gap where sites are smaller than pixels."""
        grids = self.site_grids
        return self.contact.with_gap() if grids and site_rule(*grids) == "reconstructed" else self.contact

    @property
    def solved_parts(self) -> dict[str, Any]:
        """:attr:`parts` with the :attr:`solver` for the contact, and the :attr:`site_grids` as ``grids``."""
        return {**self.parts, "contact": self.solver, "grids": self.site_grids}

    def in_use(self) -> AbstractContextManager[None]:
        """A block in which plugins have the options that this scene sets, and come in its order."""
        return context.applied(self.plugins, self.prefer or None)

    def completed(self) -> Self:
        """This scene with the options of plugins that a block (:func:`chemage.plugin_options`) sets and it does not."""
        if not context.options():
            return self
        return self.model_copy(update={"plugins": joined(context.options(), self.plugins)})

    # -- keys ---------------------------------------------------------------------------------------------------------

    def keys(self) -> dict[str, str]:
        """Content hash of each stage: of its own options, of the stages it rests on, and of nothing else.

        The plugins that take part are known only when the stage has run; a finished run's keys contain them, with their
        options.

        ``surface``, ``contact``, ``aging``, and ``result``, which is ageing, the fit to it, and the limits of the
        material with which it is compared. Options that only change the speed, and the scene's name, are in none of
        them.
        """
        return self._keys({})

    def task_keys(self) -> dict[str, str]:
        """Like :meth:`keys`, and also of what the scene sets for plugins that may take part in the stage.

        By these keys a sweep finds out which of its points share a contact.
        """
        if not (self.plugins or self.prefer):
            return self.keys()
        stages, parts = registry.current().stages(), self.parts
        extra: dict[str, Any] = {}
        for key in ("surface", "contact", "aging"):
            within = [stage for stage in stages if (stage.key or "aging") == key]
            hooks = {hook for stage in within for hook in stage.hooks}
            if key == "aging":  # and every hook of no declared stage
                hooks |= {*stage_hooks()} - {hook for stage in stages for hook in stage.hooks}
            components = [parts.get(name) for stage in within for name in (stage.section, *stage.parts)]
            names = {*implementing(*sorted(hooks)), *providers(*components)}
            extra[key] = {
                name: changed for name in names & set(self.plugins) if (changed := self.plugins[name].changed())
            }
        if self.prefer:
            extra["surface"]["prefer"] = self.prefer
        return self._keys(extra)

    def _keys(self, extra: Mapping[str, Any]) -> dict[str, str]:
        stages, parts = registry.current().stages(), self.solved_parts
        sections = _without_none(_sections(parts, lambda component: component.identity()))
        content: dict[str, list[Any]] = {key: [] for key in KEYS}
        for stage in (
            *(stage for stage in stages if stage.always_in_key),
            *(stage for stage in stages if not stage.always_in_key),
        ):
            if stage.key:
                content[stage.key] += stage.key_entries(sections)
        for stage in stages:
            for key, end in stage.key_ends(parts).items():
                content[key].append(end)
        keys: dict[str, str] = {}
        for key, entries in content.items():
            whole = [*list(keys.values())[-1:], *entries, *([extra[key]] if extra.get(key) else [])]
            keys[key] = content_hash(whole if len(whole) > 1 else whole[0])
        return keys

    def digest(self) -> str:
        """Content hash of the whole scene."""
        return content_hash(self.todict())


def _sections(parts: Mapping[str, Any], options_of: Callable[[Component], dict[str, Any]]) -> dict[str, Any]:
    """Every section that is there, lists of tables last; ``options_of`` gives the options of a component."""
    data: dict[str, Any] = {}
    for stage in sorted(registry.current().stages(), key=lambda stage: stage.many):
        data |= stage.todict(parts, options_of)
    return data


def file_name(name: str) -> str:
    """``name`` if it can name a scene and its result file; else a ValueError that says why."""
    if not name or name.startswith(".") or any(letter in "/\\" or not letter.isprintable() for letter in name):
        raise ValueError("it names the result file; leave out slashes, a leading dot and invisible characters")
    return name


def heading(scene: Mapping[str, Any], name: str = "") -> str:
    """The title of plain scene data, or else its name, or ``name``, with the values that a title names first."""
    if title := scene.get("title"):
        return str(title)
    name = name or str(scene.get("name", ""))
    kind, load = (scene.get(section, {}).get(field) for section, field in (("surface", "kind"), ("contact", "load")))
    if kind is None or not isinstance(load, int | float):
        return name
    return f"{name}: {kind} at {force_text(load)}"


def _without_none(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, list | tuple):
        return [_without_none(value) for value in data]
    return data
