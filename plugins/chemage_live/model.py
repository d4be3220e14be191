"""What a page shows of a scene at settings of its sliders, as plain columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from chemage import ContactSolution, InputError, Run, parse_scene, run
from chemage.plugin import (
    Curve,
    figures,
    override,
    result_of,
    text,
    value_at,
)

#: while a slider moves: pixels along a side, and sites times replicas, at most
PIXELS, SITES = 512, 1200


class LiveScene:
    """A scene that follows sliders, and the last result."""

    last: Run

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data = data
        self.own = parse_scene(data)
        #: of the last result: its scene, and its sites
        self.scene = None
        self.sites = 1.0

    def at(self, changes: Mapping[str, Any], quick: bool = False) -> str:
        """Compute the result with the ``changes`` (dotted path -> value), of which the scene may have some; ``quick``:
        with less, which is returned in words.

        Raises
        ------
        ChemageError
            As of any run; or nothing ages.
        """
        options = self.own.todict()
        own = {
            path: value
            for path, value in changes.items()
            if value_at(options, path) is not None
        }
        scene = parse_scene(override(self.data, own))
        hold = scene.hold
        if hold is None:
            problem = "ages nothing; live shows ageing"
            raise InputError.of("scene", scene.name, problem)
        less = []
        grids = scene.site_grids
        most = math.ceil(max(grids[0]) / PIXELS) if quick and grids else 1
        for factor in range(most, 1, -1):
            if (coarser := scene.coarser(factor)) is not None:
                scene = coarser
                less.append(f"pixels {factor} times larger")
                break
        replicas = max(2, int(SITES / self.sites))
        if quick and replicas < hold.replicas:
            less.append(f"{replicas} of {hold.replicas} replicas")
            scene = scene.with_hold(replicas=replicas)
        if scene != self.scene:
            self.last = run(scene, warn=False, progress=False)
            self.scene = scene
            ageing: Any = self.last.ageing
            self.sites = max(1.0, float(ageing.sites.mean()))
        return ", ".join(less)

    @property
    def curve(self) -> Curve:
        """The curve over hold time that users look for first."""
        return min(result_of(self.last).curves(), key=lambda one: one.rank)

    def sources(self, most: int) -> dict[str, Any]:
        """The columns of the curve, and of the map of pressure where there is one: the largest in each of ``most``
        blocks along a side, nan where there is no contact."""
        curve, contact = self.curve, self.last.contact
        half = curve.half_width if curve.half_width.size else 0.0
        sources: dict[str, Any] = {
            self.own.name: with_ends(curve.x, curve.mean, half)
        }
        if isinstance(contact, ContactSolution):
            blocks = figures.pooled(contact.pressure, np.max, most)
            # as many digits as there are colours
            rounded = blocks.round(text.decimals(blocks.max() / 256))
            seen = np.where(blocks > 0, rounded, np.nan).T
            width, height = np.multiply(contact.shape, contact.pixel_size)
            sources[f"{self.own.name}/contact pressure (GPa)"] = {
                "image": [seen],
                "width": [width],
                "height": [height],
            }
        return sources


def with_ends(x: np.ndarray, y: np.ndarray, half: Any) -> dict[str, np.ndarray]:
    """The columns of a curve with the ends of its intervals, whose ``half`` is nan where it is not known."""
    half = np.nan_to_num(half)
    return {"x": x, "y": y, "low": y - half, "high": y + half}


def table(runs: Sequence[Run]) -> str:
    """The numbers of runs beside each other, and their notes, as HTML."""
    results = [result_of(one) for one in runs]
    columns = [dict(result.rows()[len(result.facts()) :]) for result in results]
    names = dict.fromkeys(chain(*columns))
    names.pop("wall time", None)
    headings = ("", *(result.heading for result in results))
    rows = [(name, *(one.get(name, "") for one in columns)) for name in names]
    notes = ("notes", *("; ".join(result.notes()) for result in results))
    return text.html_table("", [headings, *rows, notes])
