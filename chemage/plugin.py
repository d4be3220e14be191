"""What plugins use: the classes of the roles and what they receive and return, types of options, checks, hooks.

Further names that plugins need, such as ``Surface`` and ``InputError``, are in :mod:`chemage`, for users too. No other
module is an interface: all may move. Each name is imported when it is first used; type checkers read ``plugin.pyi``.
"""

from __future__ import annotations

from typing import Any

from chemage.foundation import names

__all__ = sorted({*names.HOME, *names.MODULES} - names.USERS)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        from chemage.plugins.registry import named

        return named(name)
    value = globals()[name] = names.load(name)
    return value


def __dir__() -> list[str]:
    return __all__
