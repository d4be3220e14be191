"""What can be plugged into experiments: scenes and materials that a plugin ships."""

from __future__ import annotations

from collections.abc import Mapping

from chemage.plugins.hooks import hookspec


@hookspec
def chemage_scenes() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Ship scenes: ``{name: "package:file.toml"}``."""


@hookspec
def chemage_materials() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Ship materials: ``{name: "package:file.toml"}``; their values fill what a scene does not say."""
