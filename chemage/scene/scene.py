"""A scene: one experiment, written down; TOML data in, a validated :class:`Scene` out.

A section that is absent is not modelled: no ``[interaction]``, no neighbour list; no ``[breaking]``, bonds last; no
``[forming]``, contact mechanics only. A number is in the internal unit of its field, a string carries its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, Self

from pydantic import (
    Field,
    SerializeAsAny,
    ValidationError,
    field_validator,
)

from chemage.ageing.kinetics import EVERY_SITE
from chemage.ageing.methods import AgeingMethod, check_contact, check_method, wants_states
from chemage.ageing.observables import Observable, check_outputs
from chemage.contacts.options import force_text, nominal_pressure, normal_force
from chemage.contacts.role import ContactSolver, ContactTheory
from chemage.foundation.components import Component
from chemage.foundation.errors import ChemageError, InputError, PluginError, SceneError, UnknownKindError, shown
from chemage.foundation.files import check_data
from chemage.foundation.messages import explain, nearest
from chemage.foundation.records import content_hash
from chemage.foundation.units import in_words
from chemage.friction.role import Rupture
from chemage.kinetics.role import Engine
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.site_grid import site_rule, site_shape
from chemage.plugins import in_use, registry
from chemage.plugins.options import PluginOptions
from chemage.plugins.settings import joined, options_for
from chemage.plugins.sources import implementing, providers, stage_hooks
from chemage.scene.asked import EnsembleOptions, accuracies
from chemage.scene.holding import FitWindow, Hold
from chemage.scene.materials import MaterialValue, filled
from chemage.scene.section import Section
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

    def todict(self) -> dict[str, Any]:
        """The scene as plain TOML-like data, every option spelled out; :func:`parse_scene` reads it back."""
        data: dict[str, Any] = {"name": self.name}
        if self.title:
            data["title"] = self.title
        return {**data, **self._sections(lambda component: component.todict())}

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
            known = self.surface.expected()
            pixels = int(known["nx"]), int(known["ny"])
            return pixels, site_shape(pixels, known["pixel_size"], self.chemistry.site_density)
        except (ChemageError, KeyError):  # reported where the scene is checked
            return None

    @property
    def solver(self) -> ContactSolver:
        """The contact solver, with the gap where sites are smaller than pixels."""
        grids = self.site_grids
        return self.contact.with_gap() if grids and site_rule(*grids) == "reconstructed" else self.contact

    @property
    def keeps_states(self) -> bool:
        """Whether the rupture law or an observable asks for the state of every site at every hold time."""
        if self.engine is None or self.ageing is not None:
            return False
        return wants_states(self.engine, self.rupture, self.observe)

    def components(self) -> list[Component]:
        """Every component of the scene."""
        parts: list[Component | None] = [self.surface, self.contact, self.engine, self.ageing, self.rupture]
        parts += self.observe
        if self.chemistry is not None:
            parts += [self.chemistry.forming, self.chemistry.breaking, self.chemistry.interaction]
        return [part for part in parts if part is not None]

    def _sections(
        self, options_of: Callable[[Component], dict[str, Any]], solver: ContactSolver | None = None
    ) -> dict[str, Any]:
        """Every section that is there; ``options_of`` gives the options of a component."""
        data: dict[str, Any] = {
            "surface": {**options_of(self.surface), "seed": self.surface_seed},
            "contact": {**options_of(solver or self.contact), "load": self.load},
        }
        if self.chemistry is not None:
            parts = self.chemistry
            data["forming"] = options_of(parts.forming)
            if parts.breaking is not None:
                data["breaking"] = options_of(parts.breaking)
            if parts.interaction is not None:
                data["interaction"] = options_of(parts.interaction)
            own = options_of(parts)
            data["chemistry"] = {name: own[name] for name in _CHEMISTRY_OPTIONS if name in own}
        if self.hold is not None and self.engine is not None:
            data["engine"] = options_of(self.engine)
            if self.ageing is not None:
                data["ageing"] = options_of(self.ageing)
            if self.rupture is not None:
                data["rupture"] = options_of(self.rupture)
            data["hold"] = self.hold.model_dump(mode="json", exclude_none=True)
            data["fit"] = self.fit.model_dump(mode="json")
        if self.ensemble is not None:
            data["ensemble"] = self.ensemble.model_dump(mode="json", exclude_none=True)
        if self.accuracy:
            data["accuracy"] = dict(self.accuracy)
        if self.observe:
            data["observe"] = [options_of(one) for one in self.observe]
        if self.plugins or self.prefer:
            prefer = {"prefer": list(self.prefer)} if self.prefer else {}
            data["plugins"] = prefer | {name: options_of(options) for name, options in self.plugins.items()}
        return _without_none(data)

    def in_use(self) -> AbstractContextManager[None]:
        """A block in which plugins have the options that this scene sets, and come in its order."""
        return in_use.applied(self.plugins, self.prefer or None)

    def completed(self) -> Self:
        """This scene with the options of plugins that a block (:func:`chemage.plugin_options`) sets and it does not."""
        if not in_use.options():
            return self
        return self.model_copy(update={"plugins": joined(in_use.options(), self.plugins)})

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
        hooks = {"surface": ["chemage_make_surface"], "contact": ["chemage_solve_contact"]}
        hooks["aging"] = sorted({*stage_hooks()} - {*hooks["surface"], *hooks["contact"]})
        parts = {"surface": [self.surface], "contact": [self.contact]}
        parts["aging"] = [one for one in self.components() if one is not self.surface and one is not self.contact]
        extra: dict[str, Any] = {}
        for stage, components in parts.items():
            names = {*implementing(*hooks[stage]), *providers(*components)}
            extra[stage] = {
                name: changed for name in names & set(self.plugins) if (changed := self.plugins[name].changed())
            }
        if self.prefer:
            extra["surface"]["prefer"] = self.prefer
        return self._keys(extra)

    def _keys(self, extra: Mapping[str, Any]) -> dict[str, str]:
        data = self._sections(lambda component: component.identity(), self.solver)

        def key(stage: str, *parts: Any) -> str:
            more = [extra[stage]] if extra.get(stage) else []
            return content_hash([*parts, *more] if len(parts) + len(more) > 1 else parts[0])

        surface = key("surface", data["surface"])
        contact = key("contact", surface, data["contact"])
        if "chemistry" in data:
            data["chemistry"].pop("site_density", None)  # see _site_key
        kinetic = [data.get(name) for name in ("forming", "breaking", "interaction", "chemistry", "engine", "hold")]
        # without these the key is that of scenes written before there were any
        law = [{name: data[name]} for name in ("ageing", "rupture") if name in data]
        aging = key("aging", contact, *kinetic, data.get("observe"), *law, *self._site_key())
        result = [aging, data.get("fit")]
        if limits := self.chemistry.given_limits() if self.chemistry is not None else {}:
            result.append(limits)
        return {"surface": surface, "contact": contact, "aging": aging, "result": content_hash(result)}

    def _site_key(self) -> list[Any]:
        """What the key of ageing contains of the sites: nothing where they are pixels, as before there was a choice."""
        grids = self.site_grids
        if self.chemistry is None or not self.ages or (grids and grids[0] == grids[1]):
            return []
        return [{"sites": grids[1] if grids else self.chemistry.site_density}]

    def digest(self) -> str:
        """Content hash of the whole scene."""
        return content_hash(self.todict())

    def cite(self) -> list[str]:
        """What to cite when a result of this scene is used."""
        sources = [one.source for one in self.from_material]
        return list(dict.fromkeys([*(text for part in self.components() for text in part.cite), *sources]))


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


_CHEMISTRY_OPTIONS = [name for name in Chemistry.model_fields if name not in ("forming", "breaking", "interaction")]
ROLE_OF = {
    "surface": "surface",
    "contact": "contact",
    "forming": "barriers",
    "breaking": "barriers",
    "interaction": "interaction",
    "engine": "engine",
    "ageing": "ageing",
    "rupture": "rupture",
}
SECTIONS = [
    *("name", "title", "material", *ROLE_OF, "chemistry", "hold", "fit", "observe", "ensemble", "accuracy"),
    *("plugins", "sweep"),
]
#: sections that no scene can do without
REQUIRED = ("surface", "contact")


def with_plugins(keys: Mapping[str, str], plugins: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """The keys of stages in which ``plugins`` (stage -> name -> source) took part."""
    return {stage: content_hash([key, plugins[stage]]) if plugins.get(stage) else key for stage, key in keys.items()}


def _without_none(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, list | tuple):
        return [_without_none(value) for value in data]
    return data


class _Problems(list[tuple[str, str]]):
    """Collects what is wrong, so that a user sees all of it at once."""

    def take(self, path: str, error: Exception) -> None:
        if isinstance(error, ValidationError):
            self.extend(explain(error, path))
        elif isinstance(error, InputError) and error.problems:
            self.extend((f"{path}.{field}" if field else path, message) for field, message in error.problems)
        else:
            self.append((path, str(error)))


def parse_scene(data: Mapping[str, Any], source: str = "the scene") -> Scene:
    """A validated scene from plain data (a parsed TOML file); ``[sweep]`` must have been taken out before.

    Raises
    ------
    SceneError
        Listing everything that is wrong, each with its path in the file.
    """
    problems, made = _Problems(), {}
    _check_size(data, source)
    data = in_words(data)
    data, material, from_material = _with_material(data, problems)
    for name in data:
        if name not in SECTIONS:
            problems.append((name, f"no such section{nearest(name, SECTIONS)}; the sections are {', '.join(SECTIONS)}"))
    sections: dict[str, dict[str, Any]] = {}
    for name in (*ROLE_OF, "chemistry", "hold", "fit", "ensemble"):
        if name in data:
            if isinstance(data[name], Mapping):
                sections[name] = dict(data[name])
            else:
                problems.append((name, f"{shown(data[name])} is not a section; write [{name}] with options below it"))
    for name in REQUIRED:
        if name not in data:
            problems.append((name, "is required; every scene needs a surface and a contact"))
    surface_seed = sections.get("surface", {}).pop("seed", 0)
    given, load = sections.get("contact", {}).pop("load", None), 0.0
    for name, role in ROLE_OF.items():
        if name in sections:
            made[name] = _choice(role, name, sections[name], problems)
    if "contact" in sections:
        load = _load(given, made.get("surface"), made.get("contact"), problems)
    chemistry = _chemistry(sections, made, problems)
    hold, engine = _kinetics(sections, made, problems)
    fit = _section(FitWindow, "fit", sections, problems) or FitWindow()
    wish, accuracy = _asked(sections, data.get("accuracy", {}), problems)
    observe = []
    items = data.get("observe", [])
    if not isinstance(items, list):
        problems.append(("observe", "write each observable as [[observe]] with its kind"))
        items = []
    for number, item in enumerate(items):
        if isinstance(item, Mapping):
            observe.append(_choice("observable", f"observe.{number}", dict(item), problems))
        else:
            problems.append((f"observe.{number}", f"{shown(item)} is not a section; write [[observe]] with its kind"))
    prefer, settings = _plugins(data.get("plugins", {}), problems)
    if not problems:
        try:
            check_outputs(observe)
        except PluginError as error:
            problems.append(("observe", str(error)))
    if engine is not None and chemistry is not None and not problems:
        _check_ageing(made, chemistry, engine, observe, problems)
    if not problems:
        try:
            return Scene(
                name=data.get("name", "scene"),
                title=data.get("title", ""),
                surface=made["surface"],
                surface_seed=surface_seed,
                contact=made["contact"],
                load=float(load or 0.0),
                chemistry=chemistry,
                engine=engine,
                ageing=made.get("ageing"),
                rupture=made.get("rupture"),
                hold=hold,
                fit=fit,
                observe=tuple(observe),
                ensemble=wish,
                accuracy=accuracy,
                plugins=settings,
                prefer=prefer,
                material=material,
                from_material=from_material,
            )
        except ValidationError as error:
            problems.extend((path.replace("surface_seed", "surface.seed"), message) for path, message in explain(error))
    raise SceneError(source, problems)


def _asked(
    sections: Mapping[str, Any], accuracy: Any, problems: _Problems
) -> tuple[EnsembleOptions | None, dict[str, float]]:
    """Over how many surfaces the answer is a mean, and how accurate it is to be."""
    wish = _section(EnsembleOptions, "ensemble", sections, problems)
    try:
        return wish, accuracies(accuracy)
    except InputError as error:
        text = str(error)
        field, _, message = text.removeprefix("accuracy").partition(" = ")
        problems.append((f"accuracy{field}", message))
    return wish, {}


def _with_material(
    data: Mapping[str, Any], problems: _Problems
) -> tuple[dict[str, Any], str, tuple[MaterialValue, ...]]:
    """The data of a scene with the values of its material, the name of the material, and the values that are its."""
    try:
        made, material, used = filled(data)
    except UnknownKindError as error:
        problems.append(("material", str(error)))
        return {name: part for name, part in data.items() if name != "material"}, "", ()
    return made, material.name if material is not None else "", used


def _load(given: Any, surface: SurfaceMaker | None, contact: ContactSolver | None, problems: _Problems) -> float:
    """The load in nN; a nominal pressure is multiplied by the nominal area that the surface will have."""
    try:
        if given is None:
            raise InputError('is required; give the normal force, such as load = "20 uN", or a nominal pressure')
        if nominal_pressure(given) is None:
            return normal_force(given, None, flat=True)
        if surface is None or contact is None:
            return 0.0  # what is wrong with them is reported
        return contact.normal_force(given, surface.expected())
    except ChemageError as error:
        problems.append(("contact.load", str(error).removeprefix("load = ").removeprefix("load: ")))
    return 0.0


def _check_ageing(
    made: Mapping[str, Any],
    chemistry: Chemistry,
    engine: Engine,
    observe: Sequence[Observable],
    problems: _Problems,
) -> None:
    method, rupture, contact = made.get("ageing"), made.get("rupture"), made["contact"]
    try:
        check_contact(f"contact {contact.kind!r}", contact.gives_map, method or EVERY_SITE, chemistry)
        check_method(method or EVERY_SITE, chemistry, engine, rupture, observe)
    except InputError as error:
        problems.take("engine" if method is None else "ageing", error)


def _check_size(data: Any, source: str) -> None:
    if not isinstance(data, Mapping) or not all(isinstance(name, str) for name in data):
        raise SceneError(source, [("", f"{shown(data)} is not a table of sections")])
    try:
        check_data(dict(data))
    except InputError as error:
        raise SceneError(source, error.problems) from None


def _plugins(section: Any, problems: _Problems) -> tuple[tuple[str, ...], dict[str, PluginOptions]]:
    if not isinstance(section, Mapping):
        problems.append(("plugins", f"{section!r} is not a section; write [plugins.NAME] with options below it"))
        return (), {}
    prefer, made = section.get("prefer", []), {}
    if not isinstance(prefer, list | tuple) or not all(isinstance(name, str) for name in prefer):
        problems.append(("plugins.prefer", f'{prefer!r}: give a list of names of plugins, such as ["my-plugin"]'))
    else:
        try:
            registry.current().check_preference(prefer, "it")
        except InputError as error:
            problems.append(("plugins.prefer", str(error)))
    for name, options in section.items():
        if name == "prefer":
            continue
        path = f"plugins.{name}"
        if not isinstance(options, Mapping):
            problems.append((path, f"{options!r} is not a section; write [{path}] with options below it"))
            continue
        try:
            made[name] = options_for(name, options)
        except InputError as error:
            problems.take(path, error)
    return tuple(prefer), made


def _choice(role: str, path: str, options: dict[str, Any], problems: _Problems) -> Any:
    plugins = registry.current()
    kind = options.pop("kind", None)
    if not isinstance(kind, str):
        problems.append((f"{path}.kind", f"is required; installed: {', '.join(plugins.kinds(role)) or 'none'}"))
        return None
    try:
        return plugins.make(role, kind, options)
    except PluginError:
        raise
    except ChemageError as error:
        problems.take(f"{path}.kind" if not getattr(error, "problems", None) else path, error)
        return None


def _section(cls: type[Any], name: str, sections: Mapping[str, Any], problems: _Problems) -> Any:
    if name not in sections:
        return None
    known = list(cls.model_fields)
    try:
        return cls(**sections[name])
    except ValidationError as error:
        problems.extend(
            (path, message + nearest(path.rpartition(".")[2], known) if message == "no such option" else message)
            for path, message in explain(error, name)
        )
    except ChemageError as error:
        problems.take(name, error)
    return None


def _chemistry(sections: Mapping[str, Any], made: Mapping[str, Any], problems: _Problems) -> Chemistry | None:
    if "forming" not in sections:
        for name in ("breaking", "interaction", "chemistry", "hold", "ageing", "rupture"):
            if name in sections:
                problems.append((name, "needs [forming], the barriers to forming a bond; add it, or leave this out"))
        return None
    parts = {name: made.get(name) for name in ("forming", "breaking", "interaction")}
    options = dict(sections.get("chemistry", {}))
    for name in [name for name in parts if name in options]:
        problems.append((f"chemistry.{name}", f"is a section of its own; write [{name}]"))
        del options[name]
    if parts["forming"] is None:
        return None
    try:
        return Chemistry(**{name: part for name, part in parts.items() if part is not None}, **options)
    except InputError as error:
        problems.take("chemistry", error)
    return None


def _kinetics(
    sections: Mapping[str, Any], made: Mapping[str, Any], problems: _Problems
) -> tuple[Hold | None, Engine | None]:
    if "forming" not in sections:
        if "engine" in sections:
            problems.append(("engine", "needs [forming] and [hold]; add them, or leave this out"))
        return None, None
    for name in ("hold", "engine"):
        if name not in sections:
            problems.append((name, "is required where bonds form"))
    return _section(Hold, "hold", sections, problems), made.get("engine")
