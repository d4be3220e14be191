"""What notebooks show of a result: a picture of it and its main numbers.

Results are in rooms above the one that draws, and import nothing of it. The module that draws is therefore known here
by its name alone, as the modules of public names are, and imported when something is to be drawn.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from chemage.foundation.names import PICTURES


def draw(thing: Any, *arguments: Any, **options: Any) -> Any:
    """Draw ``thing`` by the function of :mod:`chemage.results.pictures` for its class."""
    return import_module(f"chemage.{PICTURES}").draw(thing, *arguments, **options)


def html(thing: Any) -> str:
    """The picture of ``thing`` and a table of its main numbers, as HTML without references to anything else."""
    return import_module(f"chemage.{PICTURES}").html(thing)
