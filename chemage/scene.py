"""A scene file: one experiment, written down. TOML in, validated :class:`Scene` out.

A section that is absent is not modelled: no ``[interaction]``, no neighbour list; no ``[breaking]``, bonds last; no
``[forming]``, contact mechanics only. A number is in the internal unit of its field, a string carries its own.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, ValidationError, field_validator, model_validator

from chemage import registry
from chemage.errors import ChemageError, InputError, PluginError, SceneError, StoreError
from chemage.objects import hold_times
from chemage.reactions import Chemistry
from chemage.spec import ContactSolver, Engine, Observable, Spec, SurfaceMaker, check_times, explain, force, nearest
from chemage.units import Temperature, Time, convert


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, use_attribute_docstrings=True)


class Hold(_Section):
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
    """of disorder and noise; replica r depends on seed and r alone"""

    @field_validator("times", mode="before")
    @classmethod
    def _times(cls, value: Any) -> Any:
        if isinstance(value, Sequence) and not isinstance(value, str):
            return tuple(check_times([convert(item, "s") for item in value]).tolist())
        return value

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.times is None:
            if self.start is None or self.stop is None:
                raise ValueError('give start and stop (such as "1 ms" and "1e5 s"), or times')
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


class FitWindow(_Section):
    """Where the line of Δμ against log t is fitted."""

    start: Time = 10.0
    """s"""
    stop: Time = 1e4
    """s"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stop <= self.start:
            raise ValueError(f"stop ({self.stop:g} s) must be after start ({self.start:g} s)")
        return self


class Scene(_Section):
    """One validated experiment: every choice made, nothing computed yet."""

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
    hold: Hold | None = None
    fit: FitWindow = FitWindow()
    observe: tuple[SerializeAsAny[Observable], ...] = ()

    @field_validator("name")
    @classmethod
    def _file_name(cls, name: str) -> str:
        if name.startswith(".") or any(letter in "/\\" or not letter.isprintable() for letter in name):
            raise ValueError("it names the result file; leave out slashes, a leading dot and invisible characters")
        return name

    def todict(self) -> dict[str, Any]:
        """The scene as plain TOML-like data, every option spelled out; :func:`parse_scene` reads it back."""
        data: dict[str, Any] = {"name": self.name}
        if self.title:
            data["title"] = self.title
        return {**data, **self._sections(lambda choice: choice.todict())}

    def _sections(self, told: Callable[[Spec], dict[str, Any]]) -> dict[str, Any]:
        """Every section that is there; ``told`` says what is to be told of a choice."""
        data: dict[str, Any] = {
            "surface": {**told(self.surface), "seed": self.surface_seed},
            "contact": {**told(self.contact), "load": self.load},
        }
        if self.chemistry is not None:
            parts = self.chemistry
            data["forming"] = told(parts.forming)
            if parts.breaking is not None:
                data["breaking"] = told(parts.breaking)
            if parts.interaction is not None:
                data["interaction"] = told(parts.interaction)
            data["chemistry"] = {name: getattr(parts, name) for name in _CHEMISTRY_OPTIONS}
        if self.hold is not None and self.engine is not None:
            data["engine"] = told(self.engine)
            data["hold"] = self.hold.model_dump(mode="json", exclude_none=True)
            data["fit"] = self.fit.model_dump(mode="json")
        if self.observe:
            data["observe"] = [told(one) for one in self.observe]
        return _without_none(data)

    def keys(self) -> dict[str, str]:
        """Content hash of each stage: of its own options and of the stages it rests on, and of nothing else.

        ``surface``, ``contact``, ``aging``, and ``result``, which is ageing and the fit to it. Options that only change
        the speed, and the scene's name, are in none of them.
        """
        data = self._sections(lambda choice: choice.identity())
        surface = _hash(data["surface"])
        contact = _hash([surface, data["contact"]])
        kinetic = [data.get(name) for name in ("forming", "breaking", "interaction", "chemistry", "engine", "hold")]
        aging = _hash([contact, *kinetic, data.get("observe")])
        return {"surface": surface, "contact": contact, "aging": aging, "result": _hash([aging, data.get("fit")])}

    def digest(self) -> str:
        """Content hash of the whole scene."""
        return _hash(self.todict())

    def cite(self) -> list[str]:
        """What to cite when a result of this scene is used."""
        parts: list[Any] = [self.surface, self.contact, self.engine, *self.observe]
        if self.chemistry is not None:
            parts += [self.chemistry.forming, self.chemistry.breaking, self.chemistry.interaction]
        return list(dict.fromkeys(text for part in parts if part is not None for text in part.cite))


_CHEMISTRY_OPTIONS = [name for name in Chemistry.model_fields if name not in ("forming", "breaking", "interaction")]
_ROLE_OF = {
    "surface": "surface",
    "contact": "contact",
    "forming": "barriers",
    "breaking": "barriers",
    "interaction": "interaction",
    "engine": "engine",
}
SECTIONS = ["name", "title", *_ROLE_OF, "chemistry", "hold", "fit", "observe", "sweep"]
#: sections that no scene can do without
REQUIRED = ("surface", "contact")


def _hash(data: Any) -> str:
    return hashlib.blake2b(json.dumps(data, sort_keys=True).encode(), digest_size=16).hexdigest()


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
    for name in data:
        if name not in SECTIONS:
            problems.append((name, f"no such section{nearest(name, SECTIONS)}; the sections are {', '.join(SECTIONS)}"))
    sections: dict[str, dict[str, Any]] = {}
    for name in (*_ROLE_OF, "chemistry", "hold", "fit"):
        if name in data:
            if isinstance(data[name], Mapping):
                sections[name] = dict(data[name])
            else:
                problems.append((name, f"{data[name]!r} is not a section; write [{name}] with options below it"))
    for name in REQUIRED:
        if name not in data:
            problems.append((name, "is required; every scene needs a surface and a contact"))
    surface_seed = sections.get("surface", {}).pop("seed", 0)
    given, load = sections.get("contact", {}).pop("load", None), 0.0
    for name, role in _ROLE_OF.items():
        if name in sections:
            made[name] = _choice(role, name, sections[name], problems)
    if "contact" in sections:
        try:
            if given is None:
                raise InputError('is required; give the normal force, such as load = "20 uN"')
            load = force(given)
        except ChemageError as error:
            problems.append(("contact.load", str(error).removeprefix("load = ")))
    chemistry = _chemistry(sections, made, problems)
    hold, engine = _kinetics(sections, made, problems)
    fit = _section(FitWindow, "fit", sections, problems) or FitWindow()
    observe = []
    items = data.get("observe", [])
    if not isinstance(items, list):
        problems.append(("observe", "write each observable as [[observe]] with its kind"))
        items = []
    for number, item in enumerate(items):
        if isinstance(item, Mapping):
            observe.append(_choice("observable", f"observe.{number}", dict(item), problems))
        else:
            problems.append((f"observe.{number}", f"{item!r} is not a section; write [[observe]] with its kind"))
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
                hold=hold,
                fit=fit,
                observe=tuple(observe),
            )
        except ValidationError as error:
            renamed = {"surface_seed": "surface.seed"}
            problems.extend((renamed.get(path, path), message) for path, message in explain(error))
    raise SceneError(source, problems)


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
        for name in ("breaking", "interaction", "chemistry", "hold"):
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


# -- files ------------------------------------------------------------------------------------------------------------


def installed_text(name: str) -> str:
    """The text of an installed scene."""
    target = registry.current().scene_target(name)
    try:
        return registry.scene_text(target)
    except Exception as error:  # whatever importing another's package raises
        raise PluginError(f"the installed scene {name!r} ({target}) cannot be read: {error}") from error


def scene_data(where: str | Path) -> tuple[dict[str, Any], str]:
    """The parsed TOML of a scene file, or of an installed scene by name, and a name for messages.

    A relative ``path`` in a section of a file is taken from the folder of that file.
    """
    path = Path(where)
    plugins = registry.current()
    if path.suffix != ".toml" and str(where) in plugins.scenes():
        text, source, folder = installed_text(str(where)), str(where), None
    else:
        if not path.exists():
            names = list(plugins.scenes())
            raise StoreError(
                f"{where} is neither a file nor an installed scene{nearest(str(where), names)}; "
                f"installed: {', '.join(sorted(names)) or 'none'}"
            )
        try:
            text, source, folder = path.read_text(encoding="utf-8-sig"), str(path), path.parent
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"{path} cannot be read as a scene: {error}") from error
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SceneError(source, [("", f"not valid TOML: {error}")]) from None
    if folder is not None:
        data = located(data, folder)
    data.setdefault("name", path.stem)
    return data, source


def located(data: Any, folder: Path) -> Any:
    """A copy of scene data in which every relative ``path``, also one that is swept, starts from ``folder``."""
    if isinstance(data, list):
        return [located(item, folder) for item in data]
    if not isinstance(data, Mapping):
        return data
    made: dict[str, Any] = {}
    for name, value in data.items():
        if name.rpartition(".")[2] != "path":
            made[name] = located(value, folder)
        elif isinstance(value, list):
            made[name] = [str(folder / item) if isinstance(item, str) else item for item in value]
        else:
            made[name] = str(folder / value) if isinstance(value, str) else value
    return made


def override(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of scene data with dotted paths set: ``{"surface.rms_slope": 0.2}``; ``None`` removes what is there."""
    copy = deepcopy(dict(data))
    for path, value in changes.items():
        *parents, last = path.split(".")
        place: Any = copy
        for name in parents:
            place = place[_position(path, name, place)] if isinstance(place, list) else place.setdefault(name, {})
            if not isinstance(place, dict | list):
                raise InputError(f"{path}: {name!r} is a value, not a section", [(path, f"{name!r} is a value")])
        if isinstance(place, list):
            number = _position(path, last, place)
            place[number : number + 1] = [] if value is None else [deepcopy(value)]
        elif value is None:
            place.pop(last, None)
        else:
            place[last] = deepcopy(value)
    return copy


def _position(path: str, name: str, items: list[Any]) -> int:
    if name.isdigit() and int(name) < len(items):
        return int(name)
    problem = f"{name!r} is no position in a list of {len(items)}"
    raise InputError(f"{path}: {problem}", [(path, problem)])


def is_sweep(where: str | Path) -> bool:
    """Whether a scene file or an installed scene has ``[sweep]`` in it."""
    return "sweep" in scene_data(where)[0]


def load_scene(where: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """A validated scene from a TOML file or the name of an installed scene, with dotted-path ``changes`` applied."""
    data, source = scene_data(where)
    data = override(data, changes or {})
    if "sweep" in data:
        raise SceneError(source, [("sweep", "this scene is a sweep of many; use chemage.sweep, or `chemage run`")])
    return parse_scene(data, source)
