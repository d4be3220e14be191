"""Libraries that chemage uses where they are installed."""

from __future__ import annotations

import importlib
from typing import Any

from chemage.foundation.errors import MissingError


def optional_module(name: str, extra: str) -> Any:
    """Import the library ``name``, which ``pip install 'chemage[extra]'`` installs.

    Raises
    ------
    MissingError
        It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise MissingError(f"{name} is not installed; run: pip install 'chemage[{extra}]'") from None
