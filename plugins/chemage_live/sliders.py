"""Sliders: which options of a scene they move, and over which values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from chemage import InputError, Scene
from chemage.plugin import convert, value_at

#: the ends of a slider are this many times below and above the value of the scene; of temperatures, the second
SPAN, WARMTH = 5.0, 1.3
#: moved where nothing is said, as far as the scene has them
FIRST = ("contact.load", "hold.temperature", "surface.radius", "surface.rms_slope")


@dataclass(frozen=True)
class Control:
    """One option and the values that it takes."""

    #: dotted path into the scene
    path: str
    #: what the option is, as it is declared
    meaning: str
    #: as a scene says them: numbers, or texts with their unit
    values: Sequence[Any]
    #: position of the scene's own value
    start: int


def sliders_of(scene: Scene, asked: Sequence[str], count: int) -> list[Control]:
    """The sliders of a scene: those ``asked`` for (``PATH`` or ``PATH=LOW, HIGH``), else :data:`FIRST`. ``count``
    values each, and the scene's own.

    Raises
    ------
    InputError
        A path is no number of the scene, or a range is none.
    """
    values = scene.todict()
    found = [path for path in FIRST if isinstance(value_at(values, path), float)]
    return [_slider(scene, text, count) for text in asked or found]


def _slider(scene: Scene, asked: str, count: int) -> Control:
    path, given, ends = asked.partition("=")
    own, unit = value_at(scene.todict(), path), scene.unit(path)
    if not isinstance(own, float):
        raise InputError.of("slide", path, "is no number of this scene")
    span = WARMTH if unit == "K" else SPAN
    bounds = [own / span, own * span]
    if given:
        bounds = [float(convert(end.strip(), unit)) for end in ends.split(",")]
    low, high = bounds if len(bounds) == 2 else (0.0, 0.0)
    if not low < high:
        problem = f'is no range; write "{path}=LOW, HIGH"'
        raise InputError.of("slide", asked, problem)
    space = np.geomspace if low > 0 else np.linspace
    values = sorted({own, *(float(f"{x:.4g}") for x in space(low, high, count))})
    texts = [f"{value:.6g} {unit}" if unit else value for value in values]
    return Control(path, scene.meaning(path), texts, values.index(own))
