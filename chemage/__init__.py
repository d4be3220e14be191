"""chemage: chemical ageing of frictional contacts.

scene → surface → contact → reaction lattice → kinetics → friction → ageing → store → report. The names below are the
public ones, for users and for plugins; each is imported when it is first used. Type checkers read ``__init__.pyi``.
"""

from __future__ import annotations

from typing import Any

from chemage.foundation import machine
from chemage.foundation.names import HOME, MODULES
from chemage.foundation.version import __version__ as __version__

machine.provide_kernels()

__all__ = ["__version__", *sorted(HOME), *sorted(MODULES)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name in MODULES:
        value: Any = import_module(f"chemage.{MODULES[name]}")
    elif name in HOME:
        value = getattr(import_module(f"chemage.{HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'chemage' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
