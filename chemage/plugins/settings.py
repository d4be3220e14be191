"""Options and preference of plugins as users set them: in a scene, or for a block of Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from chemage.foundation.errors import InputError
from chemage.plugins import in_use
from chemage.plugins.options import PluginOptions
from chemage.plugins.registry import current


def options_for(name: str, given: Mapping[str, Any]) -> PluginOptions:
    """The validated options of the plugin ``name``.

    Raises
    ------
    InputError
        There is no such plugin, it has no options, or some are not valid (listed in ``problems``).
    """
    return current().options_class(name)(**given)


def joined(outer: Mapping[str, PluginOptions], inner: Mapping[str, PluginOptions]) -> dict[str, PluginOptions]:
    """Options of plugins, where those that ``inner`` sets replace those of ``outer``, each by itself."""
    found = dict(outer)
    for name, options in inner.items():
        # two classes: the plugin was imported again in between
        same = name in found and type(found[name]) is type(options)
        found[name] = found[name].replace(**_set(options)) if same else options
    return found


def _set(options: PluginOptions) -> dict[str, Any]:
    return {field: getattr(options, field) for field in options.model_fields_set}


def completed(data: Mapping[str, Any]) -> dict[str, Any]:
    """Scene data with the options and the preference of the block in use, where the data do not set them.

    Worker processes know the scene only.
    """
    section = data.get("plugins", {})
    given = {
        name: {field: value for field, value in options.todict().items() if field in options.model_fields_set}
        for name, options in in_use.options().items()
    }
    if not isinstance(section, Mapping) or not (given or in_use.preference()):
        return dict(data)
    made: dict[str, Any] = {**section}
    if in_use.preference():
        made.setdefault("prefer", list(in_use.preference()))
    for name, options in given.items():
        own = made.get(name, {})
        made[name] = {**options, **own} if isinstance(own, Mapping) else own
    return {**data, "plugins": made}


@contextmanager
def plugin_options(name: str, /, **options: Any) -> Iterator[PluginOptions]:
    """Set options of the plugin ``name`` within a block, as ``[plugins.NAME]`` does in a scene.

    ``with chemage.plugin_options("hardness", peak="2 GPa"): chemage.age(...)``. In a block inside another, options that
    the inner one does not set keep the value of the outer one. Where a scene is run within the block, its own
    ``[plugins.NAME]`` comes before the block.

    Raises
    ------
    InputError
        There is no such plugin, it has no options, or some are not valid.
    """
    try:
        made = options_for(name, options)
    except InputError as error:
        if not error.problems:
            raise
        lines = "; ".join(f"{path}: {message}" for path, message in error.problems)
        raise InputError(f"options of plugin {name!r}: {lines}", error.problems) from None
    together = joined(in_use.options(), {name: made})
    with in_use.applied(together, None):
        yield together[name]


@contextmanager
def prefer_plugins(*names: str) -> Iterator[None]:
    """Let these plugins come first within a block, as ``[plugins] prefer`` does in a scene.

    Raises
    ------
    InputError
        One of them is not installed.
    """
    current().check_preference(names, "prefer_plugins")
    with in_use.applied(in_use.options(), names):
        yield
