"""chemage: chemical ageing of frictional contacts.

scene → surface → contact → reaction lattice → kinetics → friction → ageing → store → report. The names below are those
for users, each imported when it is first used; those for plugins are in :mod:`chemage.plugin`. Type checkers read
``__init__.pyi``.
"""

from __future__ import annotations

import sys
from typing import Any

from chemage.foundation import moved, names
from chemage.foundation.names import __version__ as __version__

sys.meta_path.append(moved.Finder())  # pyright: ignore[reportArgumentType]

__all__ = ["__version__", *sorted(names.USERS)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in names.USERS:
        value = globals()[name] = names.load(name)
        return value
    if name in names.HOME or name in names.MODULES:
        from warnings import warn

        warn(
            f"chemage.{name} is now chemage.plugin.{name}",
            DeprecationWarning,
            stacklevel=2,
        )
        return names.load(name)
    from chemage.plugins.registry import named

    return named(name)


def __dir__() -> list[str]:
    from chemage.plugins.registry import current

    return [*__all__, *current().offered("names")]
