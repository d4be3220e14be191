"""Materials: named sets of values, each with its source, that fill what a scene does not say.

A plugin ships a material as a TOML file, in which every value has a table of its own at its path in a scene, with
``value``, ``how`` it is known, ``source`` and, if there is more to say, ``note``. The scene that is computed, stored
and hashed contains the values alone, as if it had given them itself.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from chemage.foundation.aliases import Data, Fields
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    PluginError,
    UnknownKindError,
    explain,
    nearest,
    shown,
)
from chemage.foundation.files import check_data
from chemage.foundation.text import html_table
from chemage.lattices.chemistry import Chemistry
from chemage.plugins import registry

#: how a value may be known
HOW = ("measured", "calculated", "calibrated", "estimated")
_ENTRIES = ("value", "how", "source", "note")
_TEXTS = ("title", "about")


def filled_sections() -> dict[str, str]:
    """Sections of a scene that a material fills -> role of its component; "" for the options of the chemistry."""
    return {
        name: role
        for stage in registry.stages()
        if stage.of_material
        for name, role in stage.roles.items()
    }


@dataclass(frozen=True)
class MaterialValue:
    """One value of a material."""

    #: dotted path in a scene, such as ``chemistry.hardness``
    path: str
    #: as a scene gives it
    value: Any
    #: ``measured``, ``calculated``, ``calibrated`` or ``estimated``
    how: str
    #: where it is from: a paper, a table
    source: str
    #: what else a user should know of it
    note: str = ""

    @property
    def section(self) -> str:
        """The section that it stands in."""
        return self.path.partition(".")[0]

    @property
    def option(self) -> str:
        """Its name there."""
        return self.path.partition(".")[2]

    @property
    def text(self) -> str:
        """The value as a line of text."""
        return (
            self.value if isinstance(self.value, str) else _toml_value(self.value)
        )


@dataclass(frozen=True)
class Material:
    """A named set of values with their sources; :func:`material` finds it."""

    name: str
    title: str
    about: str
    values: tuple[MaterialValue, ...]
    #: distribution and version of the plugin that ships it
    source: str = ""

    def options(self, section: str) -> Data:
        """The values in one section of a scene: ``ca.contact(kind, **silica.options("contact"))``."""
        return {
            entry.option: entry.value
            for entry in self.values
            if entry.section == section
        }

    def chemistry(self, **changes: Any) -> Chemistry:
        """The :class:`chemage.Chemistry` of the material, with ``changes`` to its options.

        Raises
        ------
        InputError
            The material has no barriers to forming a bond and ``changes`` give none, or an option is wrong.
        """
        parts = {
            name: registry.current().fromdict(role, self.options(name))
            for name, role in filled_sections().items()
            if role
            and name in Chemistry.model_fields
            and name not in changes
            and self.options(name)
        }
        return Chemistry(**{**parts, **self.options("chemistry"), **changes})

    @property
    def cite(self) -> tuple[str, ...]:
        """The sources, each once."""
        return tuple(dict.fromkeys(entry.source for entry in self.values))

    def todict(self) -> Data:
        """Plain JSON values."""
        values = [
            {
                "path": entry.path,
                **{name: getattr(entry, name) for name in _ENTRIES},
            }
            for entry in self.values
        ]
        return {
            "name": self.name,
            "title": self.title,
            "about": self.about,
            "from": self.source,
            "values": values,
        }

    def toml(self) -> str:
        """The sections of a scene that the material fills, with the source of each value as a comment."""
        lines = [f"# {self.name}: {self.title}"]
        for section in filled_sections():
            values = [entry for entry in self.values if entry.section == section]
            if values:
                lines += ["", f"[{section}]"]
            for entry in values:
                lines.append(
                    f"# {entry.how}: {entry.source}"
                    + (f"; {entry.note}" if entry.note else "")
                )
                lines.append(f"{entry.option} = {_toml_value(entry.value)}")
        return "\n".join(lines) + "\n"

    def _repr_html_(self) -> str:
        rows = (
            (entry.path, entry.text, entry.how, entry.source, entry.note)
            for entry in self.values
        )
        return html_table(f"material {self.name}: {self.title}", rows)


def _toml_value(value: Any) -> str:
    import tomli_w

    return (
        tomli_w.dumps({"x": value}).partition(" = ")[2].strip()
        if not isinstance(value, Mapping)
        else _inline(value)
    )


def _inline(table: Fields) -> str:
    return (
        "{ "
        + ", ".join(
            f"{name} = {_toml_value(value)}" for name, value in table.items()
        )
        + " }"
    )


def material(name: str) -> Material:
    """The installed material ``name``, with the source of every value: ``chemage.material("silica")``.

    Raises
    ------
    UnknownKindError
        No installed plugin ships it.
    PluginError
        Its file cannot be read, or two plugins ship a material of this name.
    """
    plugins = registry.current()
    targets = plugins.materials()
    if not isinstance(name, str) or name not in targets:
        installed = f"installed: {', '.join(sorted(targets)) or 'none'}"
        raise UnknownKindError(
            f"no material {shown(name)}{nearest(str(name)[:200], list(targets))}; {installed}"
        )
    record, target = plugins.target("materials", name)
    where = (
        f"material {name!r} of plugin {record.name!r} ({record.source}): {target}"
    )
    try:
        data = tomllib.loads(registry.scene_text(target))
        check_data(data)
        return _read(name, data, record.source)
    except Exception as error:  # whatever importing another's package raises
        raise PluginError(f"{where}: {error}") from error


def _read(name: str, data: Fields, source: str) -> Material:
    values: list[MaterialValue] = []
    for section, options in data.items():
        if section in _TEXTS:
            if not isinstance(options, str):
                raise InputError(f"{section}: give a text")
            continue
        if section not in filled_sections():
            names = [*_TEXTS, *filled_sections()]
            raise InputError(
                f"{section}: no such section{nearest(section, names)}; the sections are {', '.join(names)}"
            )
        if not isinstance(options, Mapping):
            raise InputError(
                f"{section}: write each value as [{section}.NAME] with value, how and source below it"
            )
        values += [
            _value(f"{section}.{option}", entry)
            for option, entry in options.items()
        ]
    if not values:
        raise InputError("has no values")
    return Material(
        name, data.get("title", ""), data.get("about", ""), tuple(values), source
    )


def _value(path: str, entry: Any) -> MaterialValue:
    if not isinstance(entry, Mapping) or "value" not in entry:
        raise InputError(
            f"{path}: write [{path}] with value, how and source below it"
        )
    if unknown := [name for name in entry if name not in _ENTRIES]:
        raise InputError(
            f"{path}.{unknown[0]}: no such entry; the entries are {', '.join(_ENTRIES)}"
        )
    if entry.get("how") not in HOW:
        raise InputError(
            f"{path}.how = {shown(entry.get('how'))}: give one of {', '.join(HOW)}"
        )
    for text in ("source", "note"):
        words = entry.get(text, "")
        if not isinstance(words, str) or (text == "source" and not words.strip()):
            raise InputError(
                f"{path}.{text}: give a text, such as the paper in which the value is"
            )
    return MaterialValue(
        path,
        entry["value"],
        entry["how"],
        entry["source"].strip(),
        entry.get("note", "").strip(),
    )


def material_problems(name: str | None = None) -> list[str]:
    """What is wrong with the installed materials, or with one of them, a sentence each."""
    problems: list[str] = []
    for each in sorted(registry.current().materials()) if name is None else [name]:
        try:
            problems += problems_of(material(each))
        except ChemageError as error:
            problems.append(str(error))
    return problems


def problems_of(material: Material) -> list[str]:
    """What is wrong with the values of a material, a sentence each: options that do not exist, values that components
    refuse."""
    problems: list[str] = []
    plugins = registry.current()
    for section, role in filled_sections().items():
        options = material.options(section)
        if section == "contact":
            for name, value in options.items():
                problems += _contact_problems(f"{section}.{name}", name, value)
        elif not role:
            for name, value in options.items():
                problems += _field_problems(
                    f"{section}.{name}", Chemistry, name, value
                )
        elif options:
            try:
                plugins.fromdict(role, options)
            except ChemageError as error:
                problems.append(f"{section}: {error}")
    return [
        f"material {material.name!r} ({material.source}): {problem}"
        for problem in problems
    ]


def _contact_problems(path: str, name: str, value: Any) -> list[str]:
    plugins = registry.current()
    if name in ("kind", "load"):
        return [f"{path}: is no property of a material"]
    having = [
        cls for _, cls in plugins.usable("contact") if name in cls.model_fields
    ]
    if not having:
        return [f"{path}: no installed contact has this option"]
    return list(
        dict.fromkeys(
            text
            for cls in having
            for text in _field_problems(path, cls, name, value)
        )
    )


def _field_problems(path: str, cls: Any, name: str, value: Any) -> list[str]:
    names = [
        option for option in cls.model_fields if option not in filled_sections()
    ]
    if name not in names:
        return [
            f"{path}: no such option{nearest(name, names)}; the options are {', '.join(names)}"
        ]
    info = cls.model_fields[name]
    kind: Any = info.annotation
    for mark in info.metadata:
        kind = Annotated[kind, mark]
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        return [f"{path}: {message}" for _, message in explain(error)]
    except ChemageError as error:
        return [f"{path}: {error}"]
    return []


def filled(
    data: Fields,
) -> tuple[Data, Material | None, tuple[MaterialValue, ...]]:
    """Scene data with the values of its ``material`` where the scene gives none; the material, and the values used.

    Sections of the chemistry are filled where the scene has bonds, that is [hold] or [forming]. A section whose kind is
    another than the material's keeps its own options; a section or an option that is ``false`` is left out.

    Raises
    ------
    UnknownKindError, PluginError
        See :func:`material`.
    """
    sections = {
        name: section for name, section in data.items() if name != "material"
    }
    if "material" not in data:
        return sections, None, ()
    chosen = material(data["material"])
    used: list[MaterialValue] = []
    bonds = "hold" in sections or isinstance(sections.get("forming"), Mapping)
    for section in filled_sections():
        if sections.get(section) is False and section != "contact":
            del sections[section]
            continue
        table = sections.get(section, {})
        values = {
            entry.option: entry
            for entry in chosen.values
            if entry.section == section
        }
        if (
            not values
            or not isinstance(table, Mapping)
            or not (bonds if section != "contact" else table)
        ):
            continue
        fitting = _fitting(section, table, values)
        own = {
            name: value
            for name, value in table.items()
            if value is not False or name not in fitting
        }
        added = {
            name: entry for name, entry in fitting.items() if name not in table
        }
        sections[section] = {
            **{name: entry.value for name, entry in added.items()},
            **own,
        }
        used += added.values()
    return sections, chosen, tuple(used)


def _fitting(
    section: str, table: Fields, values: Mapping[str, MaterialValue]
) -> dict[str, MaterialValue]:
    """The values of a material that a section can use."""
    if section == "contact":
        try:
            fields = (
                registry.current()
                .component("contact", table.get("kind", ""))
                .model_fields
            )
        except ChemageError:  # reported where the scene is read
            return {}
        return {name: entry for name, entry in values.items() if name in fields}
    if (
        "kind" in table
        and "kind" in values
        and table["kind"] != values["kind"].value
    ):
        return {}
    return dict(values)
