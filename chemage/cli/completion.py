"""What the shell offers as the next word: names of scenes, fields of a scene, kinds of components, endings of files.

Nothing is imported that takes long: names come from the registry, fields from the text of the scene. Where nothing is
offered, the shell offers files.
"""

from __future__ import annotations

import os
import shlex
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from chemage.foundation.aliases import Fields
from chemage.plugins import registry


def scenes(incomplete: str) -> list[str]:
    """Installed scenes, and scene files of this folder; nothing for a path, which the shell completes."""

    return _beginning(incomplete, registry.current().scenes(), "*.toml")


def installed_scenes(incomplete: str) -> list[str]:
    """Installed scenes."""

    return _beginning(incomplete, registry.current().scenes())


def results(incomplete: str) -> list[str]:
    """Result files of this folder, and folders of sweeps."""
    return _beginning(incomplete, (), "*.h5", "*.hdf5", "*/sweep.json")


def sweeps(incomplete: str) -> list[str]:
    """Folders of sweeps in this folder."""
    return _beginning(incomplete, (), "*/sweep.json")


def fields(incomplete: str) -> list[str]:
    """``section.field=`` for every field that the scene on this line sets."""
    return _beginning(incomplete, [f"{path}=" for path in _paths(_scene())])


def kinds(incomplete: str) -> list[str]:
    """Kinds of installed components, and plugins with options."""

    plugins = registry.current()
    named = [
        record.name
        for record in plugins.records
        if record.options and not record.error
    ]
    return _beginning(
        incomplete,
        {*(kind for role in plugins.roles for kind in plugins.kinds(role)), *named},
    )


def roles(incomplete: str) -> list[str]:
    """Roles of components."""

    return _beginning(incomplete, registry.current().roles)


def one_of(*words: str) -> Callable[[str], list[str]]:
    """Make a function that offers these words."""

    def offered(incomplete: str) -> list[str]:
        return _beginning(incomplete, words)

    return offered


def _beginning(incomplete: str, words: Iterable[str], *patterns: str) -> list[str]:
    """The words, and what of this folder matches ``patterns``, that begin with what is typed."""
    found = {path.parts[0] for pattern in patterns for path in Path().glob(pattern)}
    return sorted(word for word in {*words, *found} if word.startswith(incomplete))


def _scene() -> Fields:
    """The data of the scene on this line, as it is written; empty where there is none."""

    plugins = registry.current()
    try:
        # an option without its value ends the parsing, and arguments before it are lost
        words = shlex.split(
            os.environ.get("_TYPER_COMPLETE_ARGS")
            or os.environ.get("COMP_WORDS")
            or ""
        )
        name = next(
            word
            for word in words
            if word in plugins.scenes() or word.endswith(".toml")
        )
        if name in plugins.scenes():
            return tomllib.loads(
                registry.scene_text(plugins.target("scenes", name)[1])
            )
        from chemage.foundation.files import described

        return tomllib.loads(described(Path(name)))
    except Exception:  # the shell cannot show an error
        return {}


def _paths(data: Fields, prefix: str = "") -> list[str]:
    paths = []
    for name, value in data.items():
        if isinstance(value, Mapping):
            paths += _paths(value, f"{prefix}{name}.")
        elif not (
            isinstance(value, list)
            and any(isinstance(item, Mapping) for item in value)
        ):
            paths.append(f"{prefix}{name}")
    return paths
